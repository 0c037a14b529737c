//! One group to its peak, where there is light already: nothing else moves.

use super::observed::Observed;
use super::{Dark, LOOK, NEAR, STEADY};
use crate::beam::Beam;
use crate::conical_scan::{ConicalScan, Watch};
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::recipe::Recipe;
use crate::station::Unobserved;
use crate::still_there::Foreseen;
use pigtail_hal::Bench;
use pigtail_hal::bench::{Degree, Group, Meter};
use pigtail_model::frames::Displacement;

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

/// How well a peak is to be known, in widths, where the recipe's accuracy is finer.
const KNOWN: f64 = 0.03;

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
    let here = bench.pose(group, bench.now()).map(|at| at.pose);
    let at = here.map_or(Displacement::ZERO, |at| Displacement::new(at.x(), at.y()));
    let beam = Beam::new(&recipe.mode, recipe.ports.exit_angle);
    let watch = Watch {
        group,
        meter,
        background: dark.mean,
        noise: dark.sigma,
        still: dark.sigma,
        still_degrees: f64::INFINITY,
    };
    let shape = &recipe.fast.conical_scan;
    let still = Displacement::ZERO;
    let mut scan = ConicalScan::new(watch, beam, shape, bench, (at, gap), still, None);
    let radius = circles(bench, group, beam.width(gap), shape.radius);
    let noise = async |samples: usize| -> Result<(f64, f64), Halt> {
        let (_, sigma) = bench.look(meter.0, samples).await?;
        Ok((sigma.max(dark.sigma), samples as f64 - 2.0))
    };
    let (sigma, degrees) = noise(LOOK).await?;
    scan.set_noise(sigma, degrees);
    scan.set_radius(radius);
    let near = scan
        .centre(bench, gap, NEAR * beam.width(gap), "centre", 1)
        .await;
    scan.rest(bench, gap).await?;
    near?;
    let (sigma, degrees) = noise(STEADY).await?;
    scan.set_noise(sigma, degrees);
    scan.set_radius(radius);
    let accuracy = recipe.fast.accuracy.max(KNOWN * beam.width(gap));
    let last = match scan.settle(bench, gap, accuracy, "final", &|| true).await {
        Ok(peak) => scan.confirm(bench, gap, &peak, "final").await,
        Err(halt) => Err(halt),
    };
    if let Err(Halt::Outcome(_)) = &last {
        // It stands where it was believed last, and not on a circle.
        scan.rest(bench, gap).await?;
    }
    let (Foreseen { level: light, .. }, known) = last?;
    let place = scan.place(gap);
    Ok(Found {
        at: [place.x, place.y],
        deviation: known.sigma,
        light,
    })
}

/// Radius of circles of a group, in widths: the one that is wanted, or as much as its range has.
pub(super) fn circles(bench: &Reactor<'_>, group: Group, width: f64, wanted: f64) -> f64 {
    /// Share of its range that circles take.
    const CIRCLE: f64 = 0.3;
    let range = range(bench, group, Degree::X).min(range(bench, group, Degree::Y));
    wanted.min(CIRCLE * range / width)
}

/// How far a group goes to either side, metres.
pub(super) fn range(bench: &Reactor<'_>, group: Group, degree: Degree) -> f64 {
    let axis = bench.caps().groups[group.0].axes[degree.index()];
    axis.map_or(0.0, |axis| axis.range.1.min(-axis.range.0))
}
