//! One group to its peak, where there is light already: nothing else moves.

use super::Dark;
use super::observed::Observed;
use crate::beam::Beam;
use crate::conical_scan::{ConicalScan, Watch};
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::recipe::Recipe;
use crate::station::Unobserved;
use crate::still_there::Foreseen;
use crate::tuning::TUNING;
use pigtail_hal::Bench;
use pigtail_hal::bench::{Degree, Group, Meter};
use pigtail_model::frames::Displacement;
use pigtail_numerics::line::Line;
use std::f64::consts::TAU;

/// Where a peak was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Place of the group, x and y, metres: it stands there.
    pub at: [f64; 2],
    /// Standard deviation of where the peak is from there, metres, as believed.
    pub deviation: f64,
    /// The light there beside the dark, volts.
    pub light: f64,
}

/// Brings a group to the light's peak on circles, and to rest there: the same as the alignment does at a gap.
///
/// It is the peak of all light, and so certain: where much of it is scattered, a port's own peak is elsewhere (back at
/// 114 um on the twin of `bench-piezo` by 2 um, at 40 um by up to 40 nm, at 20 um by up to 15 nm).
///
/// The laser is switched off and on again to know the dark, unless its level is given, volts. `gap` says how wide the
/// light is believed to be, by the recipe's modes, metres.
///
/// # Errors
///
/// A fault; [`LightLost`](crate::outcome::Outcome::LightLost) where there is no light, [`MicroRange`](crate::outcome::Outcome::MicroRange) where the group does not reach the
/// peak; [`Unsure`](crate::outcome::Outcome::Unsure) and [`Misshapen`](crate::outcome::Outcome::Misshapen) where it stands near something that is no peak for sure.
pub fn find_peak(
    bench: &mut dyn Bench,
    group: Group,
    meter: Meter,
    recipe: &Recipe,
    gap: f64,
    dark: Option<f64>,
) -> Result<Found, Halt> {
    let mut unobserved = Unobserved;
    let mut bench = Observed::new(bench, &mut unobserved);
    let bench = Reactor::new(&mut bench);
    bench.run(climb(&bench, (group, meter), recipe, gap, dark))
}

async fn climb(
    bench: &Reactor<'_>,
    (group, meter): (Group, Meter),
    recipe: &Recipe,
    gap: f64,
    dark: Option<f64>,
) -> Result<Found, Halt> {
    let dark = match dark {
        None => Dark::measure(bench, meter).await?,
        Some(mean) => Dark {
            mean,
            sigma: bench.caps().channels[meter.0].resolution,
        },
    };
    let beam = Beam::new(&recipe.mode, recipe.ports.exit_angle);
    let settling = bench.settling(group);
    let shape = &recipe.fast.conical_scan;
    let mut scan = begin(bench, (group, meter), beam, recipe, &dark, gap);
    let radius = circles(bench, group, beam.width(gap), shape.radius);
    let (_, sigma) = bench.look(meter.0, TUNING.taught.look).await?;
    scan.set_noise(sigma.max(dark.sigma), TUNING.taught.look as f64 - 2.0);
    scan.set_radius(radius);
    let near = scan
        .centre(
            bench,
            gap,
            TUNING.circle.centred * beam.width(gap),
            "centre",
            1,
        )
        .await;
    scan.rest(bench, gap).await?;
    near?;
    // What is heard first is light of the way to rest, by as much as a meter's filter remembers.
    bench.wait(scan.period() + settling).await?;
    let still = Still::of(bench, meter, scan.period()).await?;
    let noise = still.sigma.max(dark.sigma);
    scan.set_noise(noise, still.degrees);
    scan.set_radius(radius);
    let accuracy = recipe
        .fast
        .accuracy
        .max(TUNING.taught.known * beam.width(gap));
    let long = bench.now() + TUNING.taught.turns * scan.period();
    let last = scan
        .last_turns(bench, gap, (accuracy, 1.0), "final", &|| {
            bench.is_past(long).into()
        })
        .await;
    if let Err(Halt::Outcome(_)) = &last {
        // It stands where it was believed last, and not on a circle.
        scan.rest(bench, gap).await?;
    }
    let (Foreseen { level: light, .. }, known) = last?;
    let place = scan.place(gap);
    // By how much a turn's peak is off for a volt that swings along with it.
    let volt = beam.width(gap) / (2.0 * radius * (-radius * radius).exp() * light);
    // A pose is no better than its steps, which are the same on every turn.
    let axes = bench.caps().groups[group.0].axes;
    let step =
        [Degree::X, Degree::Y].map(|of| axes[of.index()].map_or(0.0, |axis| axis.resolution));
    let steps = step[0].max(step[1]) / (6.0 * scan.samples() as f64).sqrt();
    let known = known.at_most.deviation();
    Ok(Found {
        at: [place.x, place.y],
        deviation: known
            .hypot(TUNING.taught.leads * still.hum * volt)
            .hypot(steps),
        light,
    })
}

/// Circles that begin where a group stands at a gap, metres. A coarse group goes along the beam: no peak walks for the fine one.
pub(super) fn begin<'r>(
    bench: &Reactor<'_>,
    (group, meter): (Group, Meter),
    beam: Beam,
    recipe: &'r Recipe,
    dark: &Dark,
    gap: f64,
) -> ConicalScan<'r> {
    let at = bench.across(group).unwrap_or(Displacement::ZERO);
    let watch = Watch {
        group,
        meter,
        background: dark.mean,
        noise: dark.sigma,
        still: dark.sigma,
        still_degrees: f64::INFINITY,
    };
    let shape = &recipe.fast.conical_scan;
    ConicalScan::new(
        watch,
        beam,
        shape,
        bench,
        (at, gap),
        Displacement::ZERO,
        None,
    )
    .wary()
}

/// The light of a fiber that stands still at its peak.
struct Still {
    /// Standard deviation of a sample, volts.
    sigma: f64,
    /// By how many degrees of freedom that is known.
    degrees: f64,
    /// Amplitude that a turn makes of what swings at about its own rate beyond chance, volts: turns that follow each other see much the same
    /// of it, so it is no less in their mean. It counts in full along each axis: an error of one size in a direction that nobody knows is within
    /// two thirds of a deviation half of the time only where the deviation is that size.
    hum: f64,
}

impl Still {
    /// By samples of some turns of a period, seconds.
    async fn of(bench: &Reactor<'_>, meter: Meter, period: f64) -> Result<Self, Halt> {
        let rate = bench.caps().channels[meter.0].rate;
        let turn = (period * rate).round().max(4.0) as usize;
        let seen = bench
            .samples(
                meter.0,
                TUNING.taught.steady.max(TUNING.taught.looked_at * turn),
            )
            .await?;
        let line = Line::through(seen.iter().copied());
        let left: Vec<_> = seen.iter().map(|(t, v)| (*t, line.left(*t, *v))).collect();
        let degrees = left.len() as f64 - 2.0;
        let variance = left.iter().map(|(_, left)| left * left).sum::<f64>() / degrees;
        let turns = left.chunks_exact(turn).map(|turn| {
            let part = |of: fn(f64) -> f64| -> f64 {
                let each = turn.iter().map(|(t, left)| left * of(TAU * t / period));
                each.sum::<f64>()
            };
            (part(f64::cos).powi(2) + part(f64::sin).powi(2)) / turn.len() as f64
        });
        let n = turns.len() as f64;
        let at_rate = turns.sum::<f64>() / n;
        let chance = variance * (1.0 + TUNING.taught.chance / n.sqrt());
        let beyond = if at_rate > chance {
            at_rate - variance
        } else {
            0.0
        };
        Ok(Self {
            sigma: variance.sqrt(),
            degrees,
            hum: (4.0 * beyond / turn as f64).sqrt(),
        })
    }
}

/// Radius of circles of a group, in widths: the one that is wanted, or as much as its range has.
pub(super) fn circles(bench: &Reactor<'_>, group: Group, width: f64, wanted: f64) -> f64 {
    let range = range(bench, group, Degree::X).min(range(bench, group, Degree::Y));
    wanted.min(TUNING.taught.circle * range / width)
}

/// How far a group goes to either side, metres.
pub(super) fn range(bench: &Reactor<'_>, group: Group, degree: Degree) -> f64 {
    let axis = bench.caps().groups[group.0].axes[degree.index()];
    axis.map_or(0.0, |axis| axis.range.1.min(-axis.range.0))
}
