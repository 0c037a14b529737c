//! The trade-offs that chapter 3 argues, each run: cores of the sensing fiber, gaps, dwells, steps, faster parts.

use super::super::Bench;
use super::super::picture::Points;
use super::THESIS_STEP;
use pigtail_control::maximization::Means;
use pigtail_control::methods::{Method, Space};
use pigtail_control::recipe::Climb;
use pigtail_control::station::Unobserved;
use pigtail_evaluate::align::{AlignmentDocument, align};
use pigtail_evaluate::maximize::tracking;
use pigtail_evaluate::plan::search_row;
use pigtail_model::optics::{Coupler, GaussianMode, Misalignment};
use pigtail_session::job::Ended;
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::{Setup, unfit};
use rayon::prelude::*;

/// Devices by the thesis's procedure, whatever became of them.
fn devices(setup: &Setup, seed: u64, devices: u64) -> Result<Vec<AlignmentDocument>, Ended> {
    (0..devices)
        .into_par_iter()
        .map(|k| {
            align(
                setup,
                Procedure::Thesis,
                seed.wrapping_add(k),
                &mut Unobserved,
            )
        })
        .collect()
}

/// Fibers that are aligned, of all.
fn good(documents: &[AlignmentDocument]) -> usize {
    let fibers = documents.iter().flat_map(|d| &d.fibers);
    fibers.filter(|fiber| fiber.is_good()).count()
}

/// Mean seconds in a phase of those fibers that are aligned.
fn seconds(documents: &[AlignmentDocument], phase: &str) -> f64 {
    let spent: Vec<f64> = documents
        .iter()
        .flat_map(|d| &d.fibers)
        .filter(|fiber| fiber.is_good())
        .filter_map(|fiber| fiber.seconds_in(phase))
        .collect();
    spent.iter().sum::<f64>() / spent.len() as f64
}

/// Cores of the sensing fiber, metres.
const CORES: [f64; 5] = [30e-6, 50e-6, 100e-6, 200e-6, 400e-6];

/// What came of each core of the sensing fiber.
pub(super) struct Core {
    /// Metres.
    pub diameter: f64,
    /// Fibers aligned...
    pub good: usize,
    /// ...of so many.
    pub of: usize,
    /// Mean time of looking for first light of those, seconds.
    pub seconds: f64,
}

/// Devices aligned with each core of the sensing fiber.
pub(super) fn cores(bench: &Bench) -> Result<Vec<Core>, Ended> {
    let n = bench.count(8, 3);
    CORES
        .iter()
        .map(|&core| {
            let mut setup = bench.machine.clone();
            setup.rig.spec.sensing_fiber.core = core;
            let done = devices(&setup, bench.seed, n)?;
            Ok(Core {
                diameter: core,
                good: good(&done),
                of: 3 * done.len(),
                seconds: seconds(&done, "sensing") + seconds(&done, "raster"),
            })
        })
        .collect()
}

/// How far aside light is still seen at some gaps, metres: with one fiber that is off, the other end being a large
/// sensor, and with both.
pub(super) struct Reach {
    single: Points,
    pair: Points,
    /// Gap up to which a pair that is 5 um off is seen, metres.
    pub pair_gap: f64,
    /// Reach of one fiber over that of both at 50 um.
    pub wider: f64,
    /// Reach of one fiber at 100 um over that at 50 um.
    pub back: f64,
}

impl Reach {
    /// Both as points in micrometres.
    pub(super) fn curves(&self) -> [(&'static str, Points); 2] {
        [
            ("one fiber", self.single.clone()),
            ("input and output", self.pair.clone()),
        ]
    }
}

/// Where the light of one fiber, and of a pair, falls below what the raster counts as light.
pub(super) fn reach(bench: &Bench) -> Result<Reach, Ended> {
    /// As far aside as the search's mesh leaves each fiber, metres.
    const MESH: f64 = 5e-6;
    let plant = &bench.nominal.plant;
    let [radius_x, radius_y] = plant.device.mode_radius;
    let radius = plant.fiber.mode_radius;
    let coupler = Coupler::new(
        GaussianMode { radius_x, radius_y },
        GaussianMode {
            radius_x: radius,
            radius_y: radius,
        },
        plant.light.wavelength / plant.light.gap_index,
    )
    .map_err(unfit)?;
    let least = bench.machine.rig.recipe.raster.significance * plant.light.noise / plant.light.full;
    let seen = |aside: f64, gap: f64, fibers: i32| {
        let at = Misalignment {
            x: aside,
            z: gap,
            ..Misalignment::default()
        };
        coupler.efficiency(&at).powi(fibers) >= least
    };
    let onset = |most: f64, seen: &dyn Fn(f64) -> bool| {
        let mut highest = 0.0;
        for k in 1..=2000 {
            let at = most * f64::from(k) / 2000.0;
            if seen(at) {
                highest = at;
            }
        }
        highest
    };
    let aside = |gap: f64, fibers| onset(60e-6, &|x| seen(x, gap, fibers));
    let curve = |fibers| -> Points {
        (0..=60)
            .map(|k| 5.0 * f64::from(k))
            .map(|um| (um, 1e6 * aside(1e-6 * um, fibers)))
            .collect()
    };
    Ok(Reach {
        single: curve(1),
        pair: curve(2),
        pair_gap: onset(1e-3, &|gap| seen(MESH, gap, 2)),
        wider: aside(50e-6, 1) / aside(50e-6, 2),
        back: aside(100e-6, 1) / aside(50e-6, 1),
    })
}

/// The thesis's climb.
fn climb(bench: &Bench) -> Climb {
    Climb {
        step: THESIS_STEP,
        dwell: 4e-3,
        pause: 4e-3,
        ..bench.machine.rig.recipe.climb
    }
}

/// Dwells that are compared, seconds; the thesis's is the second.
const DWELLS: [f64; 4] = [2e-3, 4e-3, 8e-3, 16e-3];

/// The fastest drift that is followed with each dwell, um/s over ms.
pub(super) fn dwells(bench: &Bench) -> Result<Points, Ended> {
    DWELLS
        .par_iter()
        .map(|&dwell| {
            let climb = Climb {
                dwell,
                pause: dwell,
                ..climb(bench)
            };
            let (row, _) = tracking(&bench.machine, bench.seed, Means::NinePoint(climb), "dwell")?;
            Ok((1e3 * dwell, row.limit_um_s))
        })
        .collect()
}

/// Steps that are compared, metres; the thesis's is the second.
const STEPS: [f64; 4] = [0.05e-6, 0.1e-6, 0.2e-6, 0.4e-6];

/// What came of each step of the climb.
pub(super) struct Step {
    /// Micrometres.
    pub um: f64,
    /// Fastest drift that was followed, um/s.
    pub followed: f64,
    /// Mean time of the climb, seconds.
    pub seconds: f64,
}

/// Drifts followed and devices climbed with each step.
pub(super) fn steps(bench: &Bench) -> Result<Vec<Step>, Ended> {
    let n = bench.count(6, 2);
    STEPS
        .par_iter()
        .map(|&step| {
            let climb = Climb {
                step,
                ..climb(bench)
            };
            let (row, _) = tracking(&bench.machine, bench.seed, Means::NinePoint(climb), "step")?;
            Ok(Step {
                um: 1e6 * step,
                followed: row.limit_um_s,
                seconds: climbed(&bench.machine, climb, bench.seed, n)?,
            })
        })
        .collect()
}

/// Mean time of a climb, seconds.
fn climbed(setup: &Setup, climb: Climb, seed: u64, n: u64) -> Result<f64, Ended> {
    let mut setup = setup.clone();
    setup.rig.recipe.climb = climb;
    Ok(seconds(&devices(&setup, seed, n)?, "climb"))
}

/// How many times faster: method 3 with photodiodes five times as fast, the climb with a micro twice as fast, and
/// with steps that vary.
pub(super) fn faster(bench: &Bench) -> Result<[f64; 3], Ended> {
    let n = bench.count(8, 3);
    let setup = &bench.machine;
    let three = Space::new(Method::Multimode, &setup.rig.recipe);
    let mut bright = setup.clone();
    bright.rig.spec.photodiode.rate *= 5.0;
    bright.rig.spec.photodiode.bandwidth *= 5.0;
    let quick = Space {
        frequency: 5.0 * three.frequency,
        ..three
    };
    let covered = |setup: &Setup, space: &Space| -> Result<f64, Ended> {
        let row = search_row(setup, space, bench.seed)?;
        Ok(row.measured_seconds.unwrap_or(f64::NAN))
    };
    let photodiodes = covered(setup, &three)? / covered(&bright, &quick)?;
    let usual = climb(bench);
    let mut stiff = setup.clone();
    stiff.plant.micro.resonance *= 2.0;
    let settling = &mut stiff.rig.calibration.geometry.micro.settling;
    *settling = settling.map(|seconds| 0.5 * seconds);
    let halved = Climb {
        dwell: 0.5 * usual.dwell,
        pause: 0.5 * usual.pause,
        ..usual
    };
    let varied = Climb {
        widest: Some(8.0 * usual.step),
        ..usual
    };
    let before = climbed(setup, usual, bench.seed, n)?;
    let micro = before / climbed(&stiff, halved, bench.seed, n)?;
    let varying = before / climbed(setup, varied, bench.seed, n)?;
    Ok([photodiodes, micro, varying])
}
