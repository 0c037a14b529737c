//! Holding a fiber at its peak while adhesive pulls at it.
//!
//! Small circles find the peak again and again, and the micro follows it: what the adhesive moves before its gel point is made
//! up for. Where it stands at the end tells how far the fiber was pulled, once what piezos creep and machines drift meanwhile is told apart: a
//! peak that is followed before anything pulls shows how they do, and what comes later is foreseen, as they creep by the logarithm of time
//! and warm up steadily.

use crate::align::Observed;
use crate::conical_scan::{ConicalScan, Watch};
use crate::job::AtPeak;
use crate::outcome::Halt;
use crate::reactor::{Reactor, both_well};
use crate::recipe::Recipe;
use crate::station::{Unobserved, fine};
use crate::tuning::TUNING;
use nalgebra::{Matrix2, Vector2};
use pigtail_hal::Bench;
use pigtail_hal::bench::{Event, Meter};
use pigtail_model::frames::Displacement;
use pigtail_numerics::line::Line;

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
    /// How the peak was going meanwhile.
    pub creep: Creep,
}

/// How a peak goes on that nothing pulls at: by the logarithm of the time since something moved, as piezos creep, and steadily, as
/// machines warm up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Creep {
    /// Since when, seconds of the bench.
    since: f64,
    /// For each factor of e in time, the micro's x and y, metres.
    by: Displacement,
    /// The same for each second.
    drift: Displacement,
}

/// How fast a fiber drifts against its chip along an axis, standard deviation, metres a second.
pub const DRIFTS: f64 = TUNING.hold.drifts;

impl Creep {
    /// Of places at times; none where they are too few to tell.
    ///
    /// In a second, creep and a drift look alike: beforehand the drift is none, give or take [`DRIFTS`], and as much of it is believed as the
    /// places tell it apart.
    fn through(since: f64, seen: &[(f64, Displacement)]) -> Self {
        let along = |of: fn(&Displacement) -> f64| {
            let points = seen.iter().map(|(t, at)| (*t - since, of(at)));
            creep_and_drift(points).unwrap_or([0.0; 2])
        };
        let [[by_x, drift_x], [by_y, drift_y]] = if seen.len() < TUNING.hold.turns {
            [[0.0; 2]; 2]
        } else {
            [along(|at| at.x), along(|at| at.y)]
        };
        Self {
            since,
            by: Displacement::new(by_x, by_y),
            drift: Displacement::new(drift_x, drift_y),
        }
    }

    /// How far it goes from one time to another, metres.
    pub fn between(&self, from: f64, to: f64) -> Displacement {
        self.by * ((to - self.since) / (from - self.since)).ln() + self.drift * (to - from)
    }
}

/// What places along an axis at times go by for each factor of e in time, and for each second; nothing where all times are one.
fn creep_and_drift(points: impl Iterator<Item = (f64, f64)> + Clone) -> Option<[f64; 2]> {
    let logarithmic = Line::through(points.clone().map(|(t, x)| (t.ln(), x)));
    let n = points.clone().count() as f64;
    let left = points
        .clone()
        .map(|(t, x)| logarithmic.left(t.ln(), x).powi(2));
    let noise = left.sum::<f64>() / (n - 2.0);
    let mean = points.clone().fold([0.0; 3], |[a, b, c], (t, x)| {
        [a + t.ln() / n, b + t / n, c + x / n]
    });
    let (mut squares, mut sums) = (Matrix2::zeros(), Vector2::zeros());
    for (t, x) in points {
        let row = Vector2::new(t.ln() - mean[0], t - mean[1]);
        squares += row * row.transpose();
        sums += row * (x - mean[2]);
    }
    squares[(1, 1)] += noise / (TUNING.hold.drifts * TUNING.hold.drifts);
    let [by, drift] = (squares.try_inverse()? * sums).into();
    Some([by, drift])
}

/// Follows the peak of a fiber that is held, whose micro has rested since a time of the bench, until another, then goes beyond it and comes to rest there: as far as
/// `beyond` says of how far the fiber was pulled until then, metres in the manipulator's x and y.
///
/// # Errors
///
/// The bench's fault; [`Outcome::MicroRange`](crate::outcome::Outcome::MicroRange) where the micro does not reach.
pub fn follow(
    bench: &mut dyn Bench,
    recipe: &Recipe,
    held: &AtPeak,
    (since, until): (f64, f64),
    beyond: impl FnOnce(Displacement) -> Displacement,
) -> Result<Followed, Halt> {
    let mut unobserved = Unobserved;
    let mut bench = Observed::new(bench, &mut unobserved);
    let bench = Reactor::new(&mut bench);
    bench.run(followed(&bench, recipe, held, (since, until), beyond))
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
    (since, until): ([f64; 2], f64),
    beyond: [&mut dyn FnMut(Displacement) -> Displacement; 2],
) -> Result<[Followed; 2], Halt> {
    let mut unobserved = Unobserved;
    let mut bench = Observed::new(bench, &mut unobserved);
    let bench = Reactor::new(&mut bench);
    let mut slower = recipe.clone();
    slower.fast.conical_scan.period *= TUNING.hold.slower;
    let [a, b] = beyond;
    let (a, b) = bench.run(both_well(
        followed(&bench, recipe, held[0], (since[0], until), a),
        followed(&bench, &slower, held[1], (since[1], until), b),
    ))?;
    Ok([a, b])
}

async fn followed(
    bench: &Reactor<'_>,
    recipe: &Recipe,
    held: &AtPeak,
    (since, until): (f64, f64),
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
    scan.set_radius(TUNING.hold.smaller * shape.radius);
    let (mut turns, mut seen) = (0, Vec::new());
    while bench.now() + 2.0 * scan.period() < until {
        scan.turn(bench, gap).await?;
        let Some(peak) = scan.peak() else { continue };
        if peak.full < 3.0 * peak.full_deviation {
            continue;
        }
        let here = scan.place(gap);
        let by = peak.at - scan.place(0.0);
        scan.expect_at(here + by * TUNING.hold.gain, gap);
        turns += 1;
        // The first come from the rest before.
        if turns > TUNING.hold.begins {
            seen.push((bench.now(), here + by));
        }
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
        creep: Creep::through(since, &seen),
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
    let mut sums = [[(0.0, 0.0); TUNING.hold.parts]; N];
    loop {
        let lights = match bench.next(end)? {
            Event::Light(light) => vec![light],
            Event::Batch(lights) => lights,
            Event::Time => break,
            _ => continue,
        };
        for light in lights {
            // Below zero, of a sample from just before, is the first.
            let part = (TUNING.hold.parts as f64 * (light.time - start) / seconds) as usize;
            for (meter, parts) in meters.iter().zip(&mut sums) {
                let volts = light.volts[meter.0];
                if !volts.is_nan() {
                    let (n, sum) = &mut parts[part.min(TUNING.hold.parts - 1)];
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_piezos_creep_later_is_foreseen_by_what_they_did_before() {
        let law = |t: f64| Displacement::new(-0.02e-6, 0.08e-6) * (t - 3.0).ln();
        let seen = |turns: u32| -> Vec<(f64, Displacement)> {
            let times = (0..turns).map(|k| 3.2 + 0.024 * f64::from(k));
            // A generator of no randomness: to either side of the law.
            let off = |k: usize| Displacement::new(4e-9, -4e-9) * [1.0, -1.0][k % 2];
            times
                .enumerate()
                .map(|(k, t)| (t, law(t) + off(k)))
                .collect()
        };
        let creep = Creep::through(3.0, &seen(40));
        let foreseen = creep.between(4.2, 13.6);
        assert!(
            (foreseen - (law(13.6) - law(4.2))).norm() < 0.01e-6,
            "{foreseen:?}"
        );
        // Nor is a drift seen where there is none.
        assert!(creep.drift.norm() < 0.005e-6, "{creep:?}");
        // What a few turns tell is noise.
        let few = Creep::through(3.0, &seen(8)).between(4.2, 13.6);
        assert!(few.norm() == 0.0, "{few:?}");
    }

    #[test]
    fn a_machine_that_warms_up_is_seen_to_in_some_seconds_and_not_in_one() {
        let law = |t: f64| {
            let creeps = Displacement::new(-0.02e-6, 0.08e-6) * (t - 3.0).ln();
            creeps + Displacement::new(0.02e-6, -0.01e-6) * (t - 3.0)
        };
        let foreseen = |seconds: f64| {
            let turns = (seconds / 0.024) as usize;
            let seen: Vec<(f64, Displacement)> = (0..turns)
                .map(|k| {
                    let t = 3.2 + 0.024 * k as f64;
                    let noise = [1.0, 1.0, -1.0, -1.0][k % 4] * 20e-9;
                    (t, law(t) + Displacement::new(noise, -noise))
                })
                .collect();
            let from = 3.2 + seconds;
            let by = Creep::through(3.0, &seen).between(from, from + 10.0);
            (by - (law(from + 10.0) - law(from))).norm()
        };
        assert!(foreseen(6.0) < 0.03e-6, "{}", foreseen(6.0));
        assert!(foreseen(1.0) > 0.1e-6, "{}", foreseen(1.0));
        assert!(foreseen(1.0) < 0.3e-6, "{}", foreseen(1.0));
    }
}
