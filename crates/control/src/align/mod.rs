//! One alignment for every bench.

use crate::outcome::Outcome;
use crate::procedure::{FiberReport, PORTS};
use crate::recipe::Recipe;
use crate::station::Observer;
use pigtail_hal::Side;
use pigtail_hal::bench::{Bench, Meter, Pose};

/// A pose that was taught: coarse group at `pose`, fine group in its middle, the fiber's tip touches the facet at the port's
/// peak.
#[derive(Debug, Clone, PartialEq)]
pub struct Taught {
    /// The arm.
    pub arm: usize,
    /// The port on its side.
    pub port: usize,
    /// The coarse group's pose.
    pub pose: Pose,
    /// Standard deviation of the peak in x and in y, metres.
    pub across: f64,
    /// How far off the facet is in z at the most, metres.
    pub bound_z: f64,
    /// Standard deviation of that, metres.
    pub sigma_z: f64,
}

/// What is believed of a bench that has no vision.
#[derive(Debug, Clone, PartialEq)]
pub struct Belief {
    /// Poses that were taught.
    pub taught: Vec<Taught>,
    /// What measures the light of each output.
    pub meters: Vec<Meter>,
}

/// Aligns the fibers of a device.
pub fn align(
    _bench: &mut dyn Bench,
    _belief: &Belief,
    _recipe: &Recipe,
    _observer: &mut dyn Observer,
) -> Vec<FiberReport> {
    let report = |(index, port): (usize, &&'static str)| FiberReport {
        port,
        side: if index == 0 { Side::Left } else { Side::Right },
        outcome: Outcome::NotAttempted,
        shaking: None,
        place: None,
        phases: Vec::new(),
    };
    PORTS.iter().enumerate().map(report).collect()
}
