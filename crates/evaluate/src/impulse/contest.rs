//! The shapes of a study on machines: each measured through the probe on one of them, as
//! `characterize AXIS impulse` would, and then believed by loops on others.

use super::condition::Condition;
use super::response::{can_play, measured};
use super::run::{Task, run_as, summary};
use super::shapes::{Effort, Judged, Study, study};
use super::waveform::Family;
use pigtail_control::impulse::belief::ImpulseBelief;
use pigtail_hal::{Axis, AxisName};
use pigtail_numerics::rounded;
use pigtail_session::impulse::{Estimator, believed};
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use rayon::prelude::*;
use serde::Serialize;

/// The machines of the loops have seeds from here on after the study's.
const LOOPS_FROM: u64 = 10_000;
/// The way that they go, metres: a z-stage's is the thesis's (4.3.2).
const TARGETS: [f64; 2] = [1.5e-6, 1e-7];

/// What `characterize AXIS impulse --shapes` prints. Amplitudes are in units of the motor's static
/// friction, as a voltage (fsm). Keys are a contract.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ShapesDocument {
    /// The axis.
    pub axis: String,
    /// The seed of the search; the machines that judge, and those of the loops, are others.
    pub seed: u64,
    /// The voltage that all shapes peak at with their highest `a_1`.
    pub peak_fsm: f64,
    /// The displacements at which they are compared, nanometres.
    pub at_nm: [f64; 3],
    /// How far the loops go, nanometres.
    pub target_nm: f64,
    /// Loops with each shape.
    pub runs: u64,
    /// The thesis's shape first.
    pub shapes: Vec<Row>,
}

/// A shape.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What it is called.
    pub shape: &'static str,
    /// Whether an amplifier that knows sums of sines plays it.
    pub playable: bool,
    /// Its second harmonic, or what rectangles and bumps have in place of it.
    pub a2_fsm: f64,
    /// Its third.
    pub a3_fsm: f64,
    /// Its fourth.
    pub a4_fsm: f64,
    /// Its length, milliseconds.
    pub period_ms: f64,
    /// The `a_1` that moves the nominal machine as far as the thesis's pulse does at most, or the highest
    /// at the peak voltage.
    pub a1_most_fsm: f64,
    /// Displacements from the 10th to the 90th percentile over machines that differ, at each of the
    /// compared displacements, nanometres.
    pub spread_nm: [f64; 3],
    /// The same over the displacement, on average, percent.
    pub spread_percent: f64,
    /// The `a_1` with which nine of ten machines move.
    pub dead_zone_fsm: f64,
    /// Displacement without any `a_1`: 90th percentile, nanometres.
    pub least_nm: f64,
    /// Residual vibration: how far the transmission swings about the twist that it keeps, as a way of
    /// the output, 90th percentile at the middle displacement, nanometres.
    pub vibration_nm: f64,
    /// From the pulse's beginning until all is at rest, likewise, milliseconds.
    pub rest_ms: f64,
    /// Displacement by the highest `a_1` of the nominal machine, nanometres.
    pub reach_nm: f64,
    /// What the search made small.
    pub cost: f64,
    /// Loops on machines; `null` where no amplifier of the rig plays it.
    pub loops: Option<Loops>,
}

/// Loops with a shape under the thesis's uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Loops {
    /// Share whose true error is within the tolerance in the end, percent.
    pub within_tolerance_percent: f64,
    /// The same of loops that keep to the curve as it was measured, and learn nothing.
    pub fixed_within_percent: f64,
    /// The true error in the end, 90th percentile, nanometres.
    pub error_p90_nm: f64,
    /// Pulses, 90th percentile.
    pub pulses_p90: f64,
    /// Machine time to settle of those that do, 90th percentile, seconds.
    pub settled_p90_s: Option<f64>,
}

/// Compares shapes on an axis, and so many loops with each.
///
/// # Errors
///
/// A rig that cannot be asked ([`can_play`]), that no one has calibrated, or whose plant the study does
/// not know; a fault.
pub fn contest(
    setup: &Setup,
    at: AxisName,
    seed: u64,
    effort: &Effort,
    runs: u64,
) -> Result<(ShapesDocument, Study), Ended> {
    can_play(setup, at.axis)?;
    let belief = believed(&setup.rig, at)?;
    let study = study(setup, at, seed, effort)?;
    let mut task = Task::usual(
        at,
        match at.axis {
            Axis::A | Axis::B => TARGETS[0],
            Axis::Z => TARGETS[1],
        },
    );
    task.condition = Condition::Thesis;
    let shapes = study
        .shapes
        .iter()
        .map(|judged| {
            let loops = match shaped(belief, judged, study.unit) {
                Some(shape) => Some(loops(setup, &task, seed, &shape, runs)?),
                None => None,
            };
            Ok(row(judged, &study, loops))
        })
        .collect::<Result<Vec<Row>, Ended>>()?;
    let document = ShapesDocument {
        axis: at.to_string(),
        seed,
        peak_fsm: rounded(study.peak / study.unit, 1e-3),
        at_nm: study.compared.map(|d| rounded(1e9 * d, 1e-2)),
        target_nm: rounded(1e9 * task.target, 1e-2),
        runs,
        shapes,
    };
    Ok((document, study))
}

/// What would be believed of a shape before it is measured: its amplitudes in the unit that was
/// measured, and the extent of its `a_1`. `None` for one that is no sum of sines.
fn shaped(belief: &ImpulseBelief, judged: &Judged, unit: f64) -> Option<ImpulseBelief> {
    if judged.wave.family != Family::Sines {
        return None;
    }
    let volts = |nominal: f64| nominal / unit * belief.unit;
    let [_, a2, a3, a4] = judged.wave.amplitudes;
    let mut shaped = belief.clone();
    shaped.fixed = [a2, a3, a4].map(volts);
    shaped.period = judged.wave.period;
    shaped.curve = vec![[0.0, 0.0], [volts(judged.most), judged.merit.reach]];
    Some(shaped)
}

/// The shape measured on the machine of `seed`, and loops on others.
fn loops(
    setup: &Setup,
    task: &Task,
    seed: u64,
    shape: &ImpulseBelief,
    runs: u64,
) -> Result<Loops, Ended> {
    let belief = measured(setup, task.at, seed, shape)?;
    let of = |estimator| {
        let task = Task { estimator, ..*task };
        let documents = (0..runs)
            .into_par_iter()
            .map(|k| {
                let seed = seed.wrapping_add(LOOPS_FROM).wrapping_add(k);
                run_as(setup, &task, Some(belief.clone()), seed)
            })
            .collect::<Result<Vec<_>, Ended>>()?;
        Ok::<_, Ended>(summary(&task, &documents))
    };
    let (row, fixed) = (of(Estimator::Recursive)?, of(Estimator::Curve)?);
    Ok(Loops {
        fixed_within_percent: fixed.within_tolerance_percent,
        within_tolerance_percent: row.within_tolerance_percent,
        error_p90_nm: row.error_nm.p90,
        pulses_p90: row.pulses.p90,
        settled_p90_s: row.settled_s.map(|s| s.p90),
    })
}

fn row(judged: &Judged, study: &Study, loops: Option<Loops>) -> Row {
    let nm = |metres: f64| rounded(1e9 * metres, 1e-2);
    let fsm = |volts: f64| rounded(volts / study.unit, 1e-3);
    let m = &judged.merit;
    let relative = m.spread.iter().zip(study.compared).map(|(s, d)| s / d);
    let [_, a2, a3, a4] = judged.wave.amplitudes;
    Row {
        shape: judged.name,
        playable: judged.wave.family == Family::Sines,
        a2_fsm: fsm(a2),
        a3_fsm: fsm(a3),
        a4_fsm: fsm(a4),
        period_ms: rounded(1e3 * judged.wave.period, 1e-4),
        a1_most_fsm: fsm(judged.most),
        spread_nm: m.spread.map(nm),
        spread_percent: rounded(100.0 * relative.sum::<f64>() / 3.0, 1e-2),
        dead_zone_fsm: fsm(m.dead_zone),
        least_nm: nm(m.least),
        vibration_nm: nm(m.vibration),
        rest_ms: rounded(1e3 * m.rest, 1e-2),
        reach_nm: nm(m.reach),
        cost: rounded(m.cost, 1e-4),
        loops,
    }
}
