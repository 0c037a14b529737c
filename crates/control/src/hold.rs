//! Holding a fiber at its peak while adhesive pulls at it.
//!
//! Small circles find the peak again and again, and the micro follows it: what the adhesive moves before its gel point is made
//! up for. Where it stands at the end tells how far the fiber was pulled.

use crate::align::Observed;
use crate::conical_scan::{ConicalScan, Watch};
use crate::outcome::Halt;
use crate::procedure::AtPeak;
use crate::reactor::{Reactor, both_well};
use crate::recipe::Recipe;
use crate::station::{Unobserved, fine};
use pigtail_hal::Bench;
use pigtail_hal::bench::{Event, Meter};
use pigtail_model::frames::Displacement;

/// What following a peak has told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed {
    /// How far the micro went after the peak, its x and y, metres: against the pull.
    pub by: Displacement,
    /// How far beyond the peak it came to rest, metres.
    pub beyond: Displacement,
    /// Turns on which the peak was seen.
    pub turns: u32,
    /// Radius at which the light has fallen to 1/e, metres, as believed.
    pub width: f64,
}

/// Radius of the circles, of that of the fast procedure: they only have to keep what is there.
const SMALLER: f64 = 0.6;

/// Share of the way to where a turn has seen the peak that is gone: turns are noisy, and there are many.
const GAIN: f64 = 0.3;

/// Follows the peak of a fiber that is held until a time of the bench, then goes beyond it and comes to rest there: as far as
/// `beyond` says of how far the fiber was pulled until then, metres in the manipulator's x and y.
///
/// # Errors
///
/// The bench's fault; [`Outcome::MicroRange`](crate::outcome::Outcome::MicroRange) where the micro does not reach.
pub fn follow(
    bench: &mut dyn Bench,
    recipe: &Recipe,
    held: &AtPeak,
    until: f64,
    beyond: impl FnOnce(Displacement) -> Displacement,
) -> Result<Followed, Halt> {
    let mut unobserved = Unobserved;
    let mut bench = Observed::new(bench, &mut unobserved);
    let bench = Reactor::new(&mut bench);
    bench.run(followed(&bench, recipe, held, until, beyond))
}

/// Follows the peaks of two fibers of one guide at once, by the light that goes through both: their circles take times as two
/// to three, so that neither takes the other's for its own.
///
/// # Errors
///
/// As [`follow`].
pub fn follow_two(
    bench: &mut dyn Bench,
    recipe: &Recipe,
    held: [&AtPeak; 2],
    until: f64,
    beyond: [&mut dyn FnMut(Displacement) -> Displacement; 2],
) -> Result<[Followed; 2], Halt> {
    /// Of the time of a turn.
    const SLOWER: f64 = 1.5;
    let mut unobserved = Unobserved;
    let mut bench = Observed::new(bench, &mut unobserved);
    let bench = Reactor::new(&mut bench);
    let mut slower = recipe.clone();
    slower.fast.conical_scan.period *= SLOWER;
    let [a, b] = beyond;
    let (a, b) = bench.run(both_well(
        followed(&bench, recipe, held[0], until, a),
        followed(&bench, &slower, held[1], until, b),
    ))?;
    Ok([a, b])
}

async fn followed(
    bench: &Reactor<'_>,
    recipe: &Recipe,
    held: &AtPeak,
    until: f64,
    beyond: impl FnOnce(Displacement) -> Displacement,
) -> Result<Followed, Halt> {
    let group = fine(held.side);
    let watch = Watch {
        group,
        meter: Meter(held.channel.index()),
        background: held.background,
        noise: held.level.sigma,
        still: held.level.sigma,
        still_degrees: 20.0,
    };
    let beam = held.beam;
    let shape = &recipe.fast.conical_scan;
    let start = bench
        .pose(group, bench.now())
        .map_or(Displacement::ZERO, |at| {
            Displacement::new(at.pose.x(), at.pose.y())
        });
    let gap = held.gap;
    let mut scan = ConicalScan::new(watch, beam, shape, bench, (start, gap), held.walk, None);
    scan.set_radius(SMALLER * shape.radius);
    let mut turns = 0;
    while bench.now() + 2.0 * scan.period() < until {
        scan.turn(bench, gap).await?;
        let Some(peak) = scan.peak() else { continue };
        if peak.full < 3.0 * peak.full_deviation {
            continue;
        }
        let here = scan.place(gap);
        let by = (peak.at - scan.place(0.0)) * GAIN;
        scan.expect_at(here + by, gap);
        turns += 1;
    }
    let by = scan.place(gap) - start;
    let beyond = beyond(by * -1.0);
    scan.expect_at(scan.place(gap) + beyond, gap);
    scan.rest(bench, gap).await?;
    Ok(Followed {
        by,
        beyond,
        turns,
        width: scan.beam_width(gap),
    })
}

/// Mean of the light of some meters over the same while, and the standard deviation of each mean, volts: by how far the means of
/// parts of that while differ, as what is scattered, or shakes, fluctuates more slowly than light is sampled.
///
/// # Errors
///
/// The bench's fault.
pub fn levels<const N: usize>(
    bench: &mut dyn Bench,
    meters: [Meter; N],
    seconds: f64,
) -> Result<[(f64, f64); N], Halt> {
    let start = bench.now();
    let end = start + seconds;
    let mut sums = [[(0.0, 0.0); PARTS]; N];
    loop {
        let lights = match bench.next(end)? {
            Event::Light(light) => vec![light],
            Event::Batch(lights) => lights,
            Event::Time => break,
            _ => continue,
        };
        for light in lights {
            // Below zero, of a sample from just before, is the first.
            let part = (PARTS as f64 * (light.time - start) / seconds) as usize;
            for (meter, parts) in meters.iter().zip(&mut sums) {
                let volts = light.volts[meter.0];
                if !volts.is_nan() {
                    let (n, sum) = &mut parts[part.min(PARTS - 1)];
                    *n += 1.0;
                    *sum += volts;
                }
            }
        }
    }
    Ok(sums.map(|parts| {
        let means: Vec<f64> = parts
            .iter()
            .filter(|(n, _)| *n > 0.0)
            .map(|(n, sum)| sum / n)
            .collect();
        let n = f64::max(means.len() as f64, 2.0);
        let (all, sum) = parts
            .iter()
            .fold((0.0, 0.0), |(all, sum), part| (all + part.0, sum + part.1));
        let mean = sum / f64::max(all, 1.0);
        let squares: f64 = means.iter().map(|part| (part - mean).powi(2)).sum();
        (mean, (squares / (n - 1.0) / n).sqrt())
    }))
}

/// Parts of a look whose means are compared.
const PARTS: usize = 8;
