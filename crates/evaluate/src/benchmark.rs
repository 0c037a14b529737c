//! Alignment algorithms on the same devices: a benchmark that anyone may enter.
//!
//! An algorithm is a function over a [`Station`](pigtail_control::station::Station). It may use all that a
//! station offers: commands out, encoders, photodiodes and vision back, datasheet and calibration. It can reach neither the twin nor
//! its truth, which alone decides what its fibers are worth. Times and readings are counted by the
//! machine and the station, not by the algorithm.
//!
//! Those that are compared by `pigtail benchmark` are in [`ALGORITHMS`]; to enter one's own there is
//! one line to add, or none: see `examples/my_algorithm.rs`.

use crate::align::{self, Judged, TOLERANCE_Z_UM, Way, align_in};
use crate::arms::{Arms, Time};
use pigtail_control::job::PORTS;
use pigtail_control::outcome::OutcomeCode;
use pigtail_control::station::Unobserved;
use pigtail_numerics::rounded;
use pigtail_numerics::statistics::{CONFIDENCE, Percentiles, Sorted, wilson};
use pigtail_session::job::Ended;
use pigtail_session::procedure::TOLERANCE_XY_UM;
use pigtail_session::setup::Setup;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

pub use pigtail_session::procedure::{ALGORITHMS, Algorithm};

/// Most seeds that are told of a cause.
const SEEDS: usize = 20;

/// What `benchmark` prints as JSON. Keys are a contract: more may come, none changes its name or
/// meaning. The same seed gives the same bytes, `report` apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchmarkDocument {
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// How the truth was changed.
    pub scenario: String,
    /// The first device's seed; each next one has the next.
    pub seed: u64,
    /// Devices that each algorithm aligned.
    pub devices: u64,
    /// Their fibers.
    pub fibers: u64,
    /// How near to the peak in x and y a fiber must be in truth, micrometres: the same for all.
    pub tolerance_xy_um: f64,
    /// How near to the wanted gap, micrometres.
    pub tolerance_z_um: f64,
    /// How probably each interval holds the truth.
    pub confidence_level: f64,
    /// A row an algorithm, in the order in which they were entered.
    pub algorithms: Vec<Row>,
    /// The program's version.
    pub version: &'static str,
    /// Path of the report; empty when none was written.
    pub report: String,
}

/// What an algorithm achieved. Every fiber is counted once: as right, wrong, touched, fault or lost.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The algorithm.
    pub name: &'static str,
    /// What it does, in a few words.
    pub about: &'static str,
    /// Fibers said to be aligned that really are, on devices that nothing touched.
    pub right: u64,
    /// Wilson's interval of their share.
    pub right_confidence: [f64; 2],
    /// Fibers said to be aligned that are not, or not attached.
    pub wrong: u64,
    /// Wilson's interval of their share.
    pub wrong_confidence: [f64; 2],
    /// All other fibers of devices that a fiber or the sensing fiber touched.
    pub touched: u64,
    /// Fibers at which the guard or the machine stopped it.
    pub faults: u64,
    /// All others, such as those without light and those never attempted.
    pub lost: u64,
    /// What the algorithm said of its fibers, and how often; `no_report` where it said nothing.
    pub outcomes: BTreeMap<&'static str, u64>,
    /// Machine time of all devices over the number of right fibers, seconds: what was spent on others
    /// counts. `null` without a right fiber.
    pub seconds_per_right_fiber: Option<f64>,
    /// Machine time of a device over its three fibers, seconds.
    pub seconds_per_fiber: Percentiles,
    /// Light samples that it looked at, all devices, over the number of right fibers. `null` without
    /// one.
    pub readings_per_right_fiber: Option<f64>,
    /// How far the attached fibers really are from the peak across: the greater of x and y, without
    /// sign, micrometres.
    pub offset_xy_um: Percentiles,
    /// How far their gap is from the wanted one, without sign, micrometres.
    pub offset_z_um: Percentiles,
    /// How much of the time of all devices each manipulator moved; `null` where no light was sampled.
    pub arms: Option<Arms>,
    /// Devices with a fiber that is not right, by what it is counted as: the first few seeds.
    pub replay: BTreeMap<&'static str, Vec<u64>>,
}

/// What a figure needs beside the document: of each algorithm what came of each device.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The document.
    pub document: BenchmarkDocument,
    /// Machine time of each device over its three fibers, seconds; a list an algorithm, in order.
    pub seconds: Vec<Vec<f64>>,
    /// Offsets across of each attached fiber, micrometres, as in [`Row::offset_xy_um`], in order.
    pub offsets: Vec<Vec<f64>>,
}

/// Runs every algorithm on the same devices, on all cores. `done` is told of each device that one of
/// them has finished, in any order.
///
/// # Errors
///
/// When the plant cannot be built.
pub fn run(
    setup: &Setup,
    algorithms: &[Algorithm],
    seed: u64,
    devices: u64,
    done: &(dyn Fn(&'static str) + Sync),
) -> Result<Measured, Ended> {
    let (mut rows, mut seconds, mut offsets) = (Vec::new(), Vec::new(), Vec::new());
    for algorithm in algorithms {
        let all: Vec<Judged> = (0..devices)
            .into_par_iter()
            .map(|device| {
                let way = Way {
                    name: algorithm.name,
                    tolerance_xy_um: TOLERANCE_XY_UM,
                };
                let seed = seed.wrapping_add(device);
                let aligned = align_in(setup, &way, algorithm.run, seed, &mut Unobserved);
                done(algorithm.name);
                aligned
            })
            .collect::<Result<_, _>>()?;
        let spent = Sorted::new(all.iter().map(seconds_per_fiber).collect());
        let off = Sorted::new(attached(&all, |o| o.x.abs().max(o.y.abs())).collect());
        rows.push(row(algorithm, &all, &spent, &off));
        seconds.push(spent.values().to_vec());
        offsets.push(off.values().to_vec());
    }
    Ok(Measured {
        document: BenchmarkDocument {
            rig: setup.rig.name.clone(),
            recipe: setup.rig.recipe_name.clone(),
            scenario: setup.scenario.name().to_owned(),
            seed,
            devices,
            fibers: devices * PORTS.len() as u64,
            tolerance_xy_um: TOLERANCE_XY_UM,
            tolerance_z_um: TOLERANCE_Z_UM,
            confidence_level: CONFIDENCE,
            algorithms: rows,
            version: env!("CARGO_PKG_VERSION"),
            report: String::new(),
        },
        seconds,
        offsets,
    })
}

fn seconds_per_fiber(device: &Judged) -> f64 {
    rounded(device.machine_seconds / PORTS.len() as f64, 1e-4)
}

fn attached(all: &[Judged], of: impl Fn(align::Offset) -> f64) -> impl Iterator<Item = f64> {
    all.iter()
        .flat_map(|device| &device.document.fibers)
        .filter_map(move |fiber| fiber.offset_um.map(&of))
}

/// What a fiber is counted as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Verdict {
    Right,
    /// Believed to be aligned, and it is not.
    Wrong,
    /// Something touched the chip.
    Touched,
    /// The machine stopped.
    Fault,
    Lost,
}

impl Verdict {
    /// That of a fiber with this outcome; `None` is one of which nothing is reported.
    fn of(outcome: Option<OutcomeCode>, within: Option<bool>, collision: bool) -> Self {
        match outcome {
            Some(OutcomeCode::Aligned) if within != Some(true) => Self::Wrong,
            _ if collision => Self::Touched,
            Some(OutcomeCode::Aligned) => Self::Right,
            Some(OutcomeCode::Fault) => Self::Fault,
            _ => Self::Lost,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Wrong => "wrong",
            Self::Touched => "touched",
            Self::Fault => "fault",
            Self::Lost => "lost",
        }
    }
}

fn row(algorithm: &Algorithm, all: &[Judged], spent: &Sorted, offsets: &Sorted) -> Row {
    let mut counts = BTreeMap::<Verdict, u64>::new();
    let mut outcomes = BTreeMap::new();
    let mut replay = BTreeMap::<&str, Vec<u64>>::new();
    for Judged { document, .. } in all {
        for k in 0..PORTS.len() {
            let fiber = document.fibers.get(k);
            let outcome = fiber.map(|fiber| fiber.outcome);
            let within = fiber.and_then(|fiber| fiber.within_tolerance);
            let verdict = Verdict::of(outcome, within, document.collision);
            *counts.entry(verdict).or_default() += 1;
            let outcome = outcome.map_or("no_report", OutcomeCode::name);
            *outcomes.entry(outcome).or_default() += 1;
            if verdict != Verdict::Right {
                let seeds = replay.entry(verdict.name()).or_default();
                if seeds.len() < SEEDS && seeds.last() != Some(&document.seed) {
                    seeds.push(document.seed);
                }
            }
        }
    }
    let count = |verdict| counts.get(&verdict).copied().unwrap_or(0);
    let fibers = (all.len() * PORTS.len()) as u64;
    let (right, wrong) = (count(Verdict::Right), count(Verdict::Wrong));
    let per_right = |sum: f64, digit| (right > 0).then(|| rounded(sum / right as f64, digit));
    Row {
        name: algorithm.name,
        about: algorithm.about,
        right,
        right_confidence: wilson(right, fibers),
        wrong,
        wrong_confidence: wilson(wrong, fibers),
        touched: count(Verdict::Touched),
        faults: count(Verdict::Fault),
        lost: count(Verdict::Lost),
        outcomes,
        seconds_per_right_fiber: per_right(all.iter().map(|a| a.machine_seconds).sum(), 1e-4),
        seconds_per_fiber: spent.percentiles(),
        readings_per_right_fiber: per_right(all.iter().map(|a| a.readings as f64).sum(), 0.1),
        offset_xy_um: offsets.percentiles(),
        offset_z_um: Sorted::new(attached(all, |o| o.z.abs()).collect()).percentiles(),
        arms: Time::sum(all.iter().filter_map(|a| a.document.arms)).arms(),
        replay,
    }
}

#[cfg(test)]
mod tests {
    use super::{OutcomeCode, Verdict};

    #[test]
    fn no_fiber_that_is_wrong_or_touched_counts_as_right() {
        for (outcome, within, collision, counted) in [
            (
                Some(OutcomeCode::Aligned),
                Some(true),
                false,
                Verdict::Right,
            ),
            (
                Some(OutcomeCode::Aligned),
                Some(false),
                false,
                Verdict::Wrong,
            ),
            (Some(OutcomeCode::Aligned), None, false, Verdict::Wrong),
            (
                Some(OutcomeCode::Aligned),
                Some(false),
                true,
                Verdict::Wrong,
            ),
            (
                Some(OutcomeCode::Aligned),
                Some(true),
                true,
                Verdict::Touched,
            ),
            (Some(OutcomeCode::NoLight), None, true, Verdict::Touched),
            (Some(OutcomeCode::NoLight), None, false, Verdict::Lost),
            (None, None, false, Verdict::Lost),
            (Some(OutcomeCode::Fault), None, false, Verdict::Fault),
        ] {
            assert_eq!(Verdict::of(outcome, within, collision), counted);
        }
    }
}
