//! A loop of pulses on a twin, and what the truth says of it (thesis 4.3.2, 4.3.3).

use super::condition::Condition;
use super::response::{can_play, measured};
use pigtail_control::impulse::Impulses;
use pigtail_control::impulse::belief::ImpulseBelief;
use pigtail_control::impulse::law::{Settings, Step, check_gain};
use pigtail_control::impulse::response::Response;
use pigtail_control::station::Unobserved;
use pigtail_hal::{Axis, AxisName, Command, Error, Fault, Machine, Measurement, Spec};
use pigtail_numerics::rounded;
use pigtail_numerics::statistics::Sorted;
use pigtail_session::impulse::{Approached, Estimator, Impulse, believed, kind_of, taken_over};
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use pigtail_twin::Twin;
use rayon::prelude::*;
use serde::Serialize;
use strum::VariantArray;

/// What is asked of a loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task {
    /// The axis.
    pub at: AxisName,
    /// The way to go from where it stands, metres.
    pub target: f64,
    /// How it knows what pulses do.
    pub estimator: Estimator,
    /// What is uncertain.
    pub condition: Condition,
    /// Gain, pulses, tolerance, and whether to stop.
    pub settings: Settings,
    /// Time between pulses in which all comes to rest, seconds; `None` for what is believed enough.
    pub rest: Option<f64>,
}

impl Task {
    /// Up to eight pulses with a gain of one, by what is known best.
    pub fn usual(at: AxisName, target: f64) -> Self {
        Self {
            at,
            target,
            estimator: Estimator::default(),
            condition: Condition::default(),
            settings: Settings {
                gain: 1.0,
                pulses: 8,
                tolerance: tolerance(at.axis),
                stop: true,
            },
            rest: None,
        }
    }
}

/// The error that the thesis reaches: 10 nm on a z-stage, 0.15 um on a five-bar.
pub fn tolerance(axis: Axis) -> f64 {
    match axis {
        Axis::A | Axis::B => 1.5e-7,
        Axis::Z => 1e-8,
    }
}

/// What `pigtail impulse` prints. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PulseDocument {
    /// The axis.
    pub axis: String,
    /// The seed.
    pub seed: u64,
    /// The way to go, nanometres.
    pub target_nm: f64,
    /// Pulses that were played.
    pub pulses: usize,
    /// The truth: how far the output still is from the target, nanometres.
    pub error_nm: f64,
    /// Machine time from the first measurement until the true error came to be within the tolerance
    /// to stay, seconds; `null` if it did not.
    pub settled_s: Option<f64>,
    /// How it knew what pulses do.
    pub estimator: &'static str,
    /// What was uncertain.
    pub condition: &'static str,
    /// `k_c`.
    pub gain: f64,
    /// The tolerance, nanometres.
    pub tolerance_nm: f64,
    /// Whether the loop itself holds that it has settled.
    pub believed: bool,
    /// Each moment of rest.
    pub steps: Vec<StepRow>,
}

/// A moment of rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StepRow {
    /// Machine time since the first measurement, seconds.
    pub time_s: f64,
    /// The error by the sensor, nanometres.
    pub measured_nm: f64,
    /// The true one.
    pub error_nm: f64,
    /// `a_1` of the pulse that follows over the voltage at which the motor breaks away, forward where
    /// positive; `null` after the last.
    pub a1_fsm: Option<f64>,
    /// The displacement that is expected of it, nanometres.
    pub expected_nm: f64,
}

/// A twin that notes the truth about one output in every cycle.
struct Watched {
    twin: Twin,
    at: AxisName,
    /// Time and true output, seconds and metres.
    seen: Vec<(f64, f64)>,
}

impl Machine for Watched {
    fn spec(&self) -> &Spec {
        self.twin.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let measurement = self.twin.exchange(command)?;
        if let Some(output) = self.twin.output(self.at) {
            self.seen.push((measurement.time, output));
        }
        Ok(measurement)
    }

    fn stop(&mut self) {
        self.twin.stop();
    }
}

/// Whether a task can be done on a rig.
///
/// # Errors
///
/// Which option or key is wrong, and what would be accepted.
pub fn check(setup: &Setup, task: &Task) -> Result<(), Error> {
    can_play(setup, task.at.axis)?;
    let belief = believed(&setup.rig, task.at)?;
    check_gain(task.settings.gain)
        .map_err(|outcome| Error::new("--gain", "", outcome.to_string()))?;
    let drive = setup.rig.spec.drive(task.at.axis);
    let most = belief.curve.last().map_or([0.0; 2], |last| *last);
    belief
        .shape()
        .pulse(most[0], true)
        .check(drive)
        .map_err(|why| {
            let file = format!("{}/calibration.toml", setup.rig.name);
            Error::new(
                file,
                format!("impulse.{}", kind_of(task.at)),
                why.to_string(),
            )
        })?;
    let reach = most[1] * f64::from(task.settings.pulses);
    if task.target.abs() > reach {
        let message = format!(
            "{:.0} nm are more than {} pulses can do; accepted is at most {:.0} nm to either side",
            task.target * 1e9,
            task.settings.pulses,
            reach * 1e9
        );
        return Err(Error::new("--target-nm", "", message));
    }
    Ok(())
}

/// Runs a loop on the twin that `seed` draws, under the task's condition.
///
/// # Errors
///
/// Bad input; a fault.
pub fn run(setup: &Setup, task: &Task, seed: u64) -> Result<PulseDocument, Ended> {
    run_as(setup, task, None, seed)
}

/// The same by another belief than the rig's.
///
/// # Errors
///
/// As [`run`].
pub fn run_as(
    setup: &Setup,
    task: &Task,
    belief: Option<ImpulseBelief>,
    seed: u64,
) -> Result<PulseDocument, Ended> {
    let unit = match &belief {
        Some(belief) => belief.unit,
        None => believed(&setup.rig, task.at)?.unit,
    };
    let changed = task.condition.applied(setup, task.at, seed)?;
    let twin = changed.twin(seed)?;
    let mut watched = Watched {
        twin,
        at: task.at,
        seen: Vec::new(),
    };
    let job = Impulse {
        at: task.at,
        target: task.target,
        estimator: task.estimator,
        settings: task.settings,
        rest: task.rest,
        belief,
    };
    let approached = changed.perform(&mut watched, &job, seed, &mut Unobserved)?;
    let Approached {
        target,
        begun,
        driven: done,
        estimator,
    } = approached;
    let nm = |metres: f64| rounded(metres * 1e9, 1e-2);
    let true_error = |time: f64| {
        let k = watched.seen.partition_point(|(t, _)| *t < time - 1e-9);
        let last = watched.seen.len().saturating_sub(1);
        target - watched.seen[k.min(last)].1
    };
    let errors: Vec<f64> = done
        .steps
        .iter()
        .map(|step| true_error(step.time))
        .collect();
    let out = errors
        .iter()
        .rposition(|error| error.abs() > task.settings.tolerance);
    let first = out.map_or(0, |k| k + 1);
    let row = |step: &Step, error: f64| StepRow {
        time_s: rounded(step.time - begun, 1e-4),
        measured_nm: nm(step.error),
        error_nm: nm(error),
        a1_fsm: step.pulse.map(|volts| rounded(volts / unit, 1e-4)),
        expected_nm: nm(step.expected),
    };
    Ok(PulseDocument {
        axis: task.at.to_string(),
        seed,
        target_nm: nm(task.target),
        pulses: done.pulses(),
        error_nm: nm(errors.last().copied().unwrap_or(task.target)),
        settled_s: done
            .steps
            .get(first)
            .map(|step| rounded(step.time - begun, 1e-4)),
        estimator,
        condition: task.condition.name(),
        gain: task.settings.gain,
        tolerance_nm: nm(task.settings.tolerance),
        believed: done.settled,
        steps: done
            .steps
            .iter()
            .zip(&errors)
            .map(|(step, error)| row(step, *error))
            .collect(),
    })
}

/// Pulses in one direction without any loop (Figs. 4.23, 4.24).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Resolution {
    /// What each pulse was to do, nanometres.
    pub step_nm: f64,
    /// Mean of what they did.
    pub mean_nm: f64,
    /// Standard deviation.
    pub deviation_nm: f64,
    /// The least of them.
    pub least_nm: f64,
    /// The greatest.
    pub greatest_nm: f64,
    /// The output after each, nanometres.
    pub position_nm: Vec<f64>,
}

/// Plays pulses of one amplitude forward, such as to move the output by `step` metres each.
///
/// # Errors
///
/// A fault.
pub fn resolution(setup: &Setup, task: &Task, step: f64, seed: u64) -> Result<Resolution, Ended> {
    const PULSES: usize = 40;
    /// Pulses from which the amplitude is found, on the machine.
    const TRIED: u32 = 12;
    let belief = believed(&setup.rig, task.at)?;
    let changed = task.condition.applied(setup, task.at, seed)?;
    let position = changed.experiment(seed, |station| {
        let tolerance = task.settings.tolerance;
        let (impulses, noise) = taken_over(station, belief, task.at, task.rest, tolerance)?;
        let impulses = Impulses {
            readings: 100,
            ..impulses
        };
        let deviation = (2.0 / f64::from(impulses.readings)).sqrt() * noise;
        let mut response = Response::recursive(belief, deviation);
        for _ in 0..TRIED {
            let a1 = response.choose(step, 1.0, true).a1;
            let moved = impulses.respond(station, belief.shape().pulse(a1, true))?;
            response.learn(a1, true, moved.net);
        }
        let pulse = belief
            .shape()
            .pulse(response.choose(step, 1.0, true).a1, true);
        let start = impulses.measure(station)?;
        let mut position = vec![0.0];
        for _ in 0..PULSES {
            impulses.play(station, pulse)?;
            impulses.relax(station)?;
            position.push(impulses.measure(station)? - start);
        }
        Ok(position)
    })?;
    let steps: Vec<f64> = position.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let n = steps.len() as f64;
    let mean = steps.iter().sum::<f64>() / n;
    let squares: f64 = steps.iter().map(|d| (d - mean).powi(2)).sum();
    let nm = |metres: f64| rounded(metres * 1e9, 1e-2);
    Ok(Resolution {
        step_nm: nm(step),
        mean_nm: nm(mean),
        deviation_nm: nm((squares / (n - 1.0)).sqrt()),
        least_nm: nm(steps.iter().copied().fold(f64::INFINITY, f64::min)),
        greatest_nm: nm(steps.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
        position_nm: position.into_iter().map(nm).collect(),
    })
}

/// What `pigtail impulse --machines` prints. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Campaign {
    /// The axis.
    pub axis: String,
    /// The seed of the first run; the others follow.
    pub seed: u64,
    /// The way to go, nanometres.
    pub target_nm: f64,
    /// The tolerance, nanometres.
    pub tolerance_nm: f64,
    /// Pulses at most.
    pub most_pulses: u32,
    /// What was asked for.
    #[serde(flatten)]
    pub row: CampaignRow,
    /// The same by each estimator under each condition, over some of the seeds.
    pub comparison: Vec<CampaignRow>,
}

/// Some runs together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CampaignRow {
    /// How they knew what pulses do.
    pub estimator: &'static str,
    /// What was uncertain.
    pub condition: &'static str,
    /// Runs.
    pub runs: u64,
    /// Share of them whose true error is below 10 nm in the end, percent.
    pub below_10nm_percent: f64,
    /// Share of them whose true error is within the tolerance in the end, percent.
    pub within_tolerance_percent: f64,
    /// The true error in the end, its magnitude, nanometres.
    pub error_nm: Share,
    /// Pulses that were played.
    pub pulses: Share,
    /// Machine time until the true error was within the tolerance, seconds, of those runs.
    pub settled_s: Option<Share>,
}

/// Percentiles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Share {
    /// Half are below.
    pub p50: f64,
    /// Nine tenths are.
    pub p90: f64,
    /// 99 of 100 are.
    pub p99: f64,
}

fn share(values: Vec<f64>, unit: f64) -> Option<Share> {
    let sorted = Sorted::new(values);
    let at = |share: f64| Some(rounded(sorted.percentile(share)?, unit));
    Some(Share {
        p50: at(0.5)?,
        p90: at(0.9)?,
        p99: at(0.99)?,
    })
}

/// Runs a task on so many successive seeds.
///
/// # Errors
///
/// As [`run`].
pub fn runs(
    setup: &Setup,
    task: &Task,
    seed: u64,
    count: u64,
) -> Result<Vec<PulseDocument>, Ended> {
    (0..count)
        .into_par_iter()
        .map(|k| run(setup, task, seed.wrapping_add(k)))
        .collect()
}

/// What runs have in common.
pub fn summary(task: &Task, documents: &[PulseDocument]) -> CampaignRow {
    let n = documents.len().max(1) as f64;
    let percent = |below: f64| {
        let good = documents
            .iter()
            .filter(|d| d.error_nm.abs() < below)
            .count();
        rounded(100.0 * good as f64 / n, 1e-2)
    };
    let nothing = Share {
        p50: 0.0,
        p90: 0.0,
        p99: 0.0,
    };
    let errors = documents.iter().map(|d| d.error_nm.abs()).collect();
    let pulses = documents.iter().map(|d| d.pulses as f64).collect();
    CampaignRow {
        estimator: task.estimator.name(),
        condition: task.condition.name(),
        runs: documents.len() as u64,
        below_10nm_percent: percent(10.0),
        within_tolerance_percent: percent(task.settings.tolerance * 1e9),
        error_nm: share(errors, 1e-2).unwrap_or(nothing),
        pulses: share(pulses, 1.0).unwrap_or(nothing),
        settled_s: share(documents.iter().filter_map(|d| d.settled_s).collect(), 1e-4),
    }
}

/// A task by each estimator under each condition.
///
/// # Errors
///
/// As [`run`].
pub fn compare(
    setup: &Setup,
    task: &Task,
    seed: u64,
    count: u64,
) -> Result<Vec<CampaignRow>, Ended> {
    let mut rows = Vec::new();
    for &condition in Condition::VARIANTS {
        for &estimator in Estimator::VARIANTS {
            let task = Task {
                estimator,
                condition,
                ..*task
            };
            rows.push(summary(&task, &runs(setup, &task, seed, count)?));
        }
    }
    Ok(rows)
}

/// Gains at which the loop's stability (4.12) is looked at.
pub const GAINS: [f64; 5] = [0.5, 1.0, 1.5, 1.9, 2.1];

/// A loop with each of [`GAINS`] on a specimen whose response is known: nothing uncertain, a curve
/// that was measured on it, and pulses enough to see where it goes.
///
/// # Errors
///
/// As [`run`].
pub fn stability(setup: &Setup, at: AxisName, seed: u64) -> Result<Vec<PulseDocument>, Ended> {
    const PULSES: u32 = 40;
    let belief = measured(setup, at, seed, believed(&setup.rig, at)?)?;
    let target = 0.5 * belief.curve.last().map_or(0.0, |last| last[1]);
    GAINS
        .par_iter()
        .map(|&gain| {
            let mut task = Task::usual(at, target);
            task.estimator = Estimator::Curve;
            task.condition = Condition::Quiet;
            task.settings.gain = gain;
            task.settings.pulses = PULSES;
            task.settings.stop = false;
            run_as(setup, &task, Some(belief.clone()), seed)
        })
        .collect()
}
