//! Tuning one axis, and the document that says how it went.

use crate::job::{Ended, Job, Order, STEP, Work};
use crate::rig::Rig;
use pigtail_control::calibration::AxisGains;
use pigtail_control::characterize::{StepResponse, Trace, step_response};
use pigtail_control::station::Station;
use pigtail_control::tune::{Experiment, Gains, Search, random_neighbourhood, simplex};
use pigtail_hal::{Axis, AxisName, Fault, Rule};
use pigtail_numerics::rounded;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::fmt::{self, Display, Formatter};

/// How gains are searched.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
    Serialize,
    serde::Deserialize,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Nelder and Mead's simplex on the logarithms of the gains
    Simplex,
    /// The thesis's random neighbourhood search
    Random,
}

impl Method {
    /// Trials after which it has found what there is to find.
    pub fn usual_trials(self) -> u32 {
        match self {
            Self::Simplex => 50,
            Self::Random => 100,
        }
    }
}

/// Tune an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tune {
    /// The axis.
    pub at: AxisName,
    /// The search.
    pub method: Method,
    /// Trials of each start.
    pub trials: u32,
    /// The larger step, counts.
    pub step: i64,
    /// Whether the cost is that of this step alone, and not averaged over it and half of it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub one_size: bool,
    /// What random trials are drawn by; the seed of the machine in its document.
    pub seed: u64,
}

/// The step with which an axis is tuned if none is given: 700 um of the five-bar, 81 um of z.
pub fn usual_step(axis: Axis) -> i64 {
    match axis {
        Axis::A | Axis::B => 400,
        Axis::Z => 1300,
    }
}

/// The same way in counts of the rig's own encoders: an encoder of another axis has others.
pub fn step_of(rig: &Rig, axis: Axis) -> i64 {
    let way = match axis {
        // Radians of a joint, and metres.
        Axis::A | Axis::B => 400.0 * TAU / (2000.0 * 80.0),
        Axis::Z => 1300.0 * 0.635e-3 / (2048.0 * 5.0),
    };
    ((way / way_of_count(rig, axis)).round() as i64).max(20)
}

/// The way of an axis's output for a count of its encoder: radians of a five-bar joint, metres of z.
pub fn way_of_count(rig: &Rig, axis: Axis) -> f64 {
    let drive = rig.spec.drive(axis);
    let turn = match axis {
        Axis::A | Axis::B => TAU,
        Axis::Z => rig.calibration.geometry.z.lead,
    };
    turn / drive.gear_ratio / f64::from(drive.counts_per_turn)
}

/// So many unsafe trials are borne: where there are more, the starts themselves are not to be trusted.
const MOST_UNSAFE: u32 = 20;

/// The rules that gains can break. Whatever else stops the machine is no result of a trial.
const PROVOKED: [Rule; 2] = [Rule::EncoderSpeed, Rule::Workspace];

/// How long a response is watched, seconds.
const WINDOW: f64 = 0.15;

/// Three starts far apart, as factors of the gains that are believed.
const STARTS: [Gains; 3] = [[0.4, 0.3, 0.5], [2.0, 0.3, 0.6], [0.6, 2.0, 2.0]];

/// What `tune` prints as JSON and keeps as `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TuningDocument {
    /// The axis as it was named.
    pub axis: String,
    /// The search.
    pub search: Method,
    /// Trials of the search that found the gains.
    pub trials: u32,
    /// ITAE of a step over its size, averaged over two sizes, ms^2; up to half as much again for gains that
    /// miss what is specified.
    pub cost: f64,
    /// The gains.
    pub gains: GainsRow,
    /// From 10 to 90 % of the larger step, milliseconds.
    pub rise_ms: f64,
    /// Until the encoder stays within one count, milliseconds.
    pub settling_ms: f64,
    /// Overshoot, percent of the step.
    pub overshoot_percent: f64,
    /// What the datasheet asks for, if anything.
    pub specified: Option<SpecifiedRow>,
    /// Trials that the guard stopped: they count as infinitely bad.
    pub unsafe_trials: u32,
    /// Machine time of all starts together, seconds.
    pub seconds_machine: f64,
    /// The searches from their starts.
    pub starts: Vec<StartRow>,
    /// The seed of the machine.
    pub seed: u64,
    /// The calibration that was written; empty when none was.
    pub calibration: String,
    /// Path of the report.
    pub report: String,
}

/// A step response that the datasheet asks for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpecifiedRow {
    /// Longest time from 10 to 90 %, milliseconds.
    pub rise_ms: f64,
    /// Longest time until the encoder stays within one count, milliseconds.
    pub settling_ms: f64,
    /// Whether both are kept.
    pub met: bool,
}

impl Display for SpecifiedRow {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        write!(
            f,
            "rise {:.1} ms, settling {:.1} ms: {}",
            self.rise_ms,
            self.settling_ms,
            if self.met { "kept" } else { "missed" }
        )
    }
}

/// Gains in the units of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GainsRow {
    /// V/count.
    pub kp: f64,
    /// V/(count s).
    pub ki: f64,
    /// V s/count.
    pub kd: f64,
}

impl GainsRow {
    fn new([kp, ki, kd]: Gains) -> Self {
        // Four digits say more than the flat valley knows.
        let digits = |value: f64| {
            let unit = 10_f64.powi(3 - value.abs().log10().floor() as i32);
            (value * unit).round() / unit
        };
        Self {
            kp: digits(kp),
            ki: digits(ki),
            kd: digits(kd),
        }
    }

    /// As keys of a table of a calibration; found on a `date`, by an `origin`.
    pub fn values(&self, date: &str, origin: &str) -> Vec<(&'static str, toml_edit::Item)> {
        vec![
            ("kp", toml_edit::value(format!("{} V/count", self.kp))),
            ("ki", toml_edit::value(format!("{} V/(count s)", self.ki))),
            ("kd", toml_edit::value(format!("{} V s/count", self.kd))),
            ("date", toml_edit::value(date)),
            ("origin", toml_edit::value(origin)),
        ]
    }

    /// All of them so many times as large.
    #[must_use]
    pub fn times(&self, by: f64) -> Self {
        Self::new(self.gains().map(|gain| by * gain))
    }

    /// As the searches have them.
    pub fn gains(&self) -> Gains {
        [self.kp, self.ki, self.kd]
    }
}

/// A search from one start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StartRow {
    /// Where it started.
    pub start: GainsRow,
    /// Where it ended.
    pub end: GainsRow,
    /// Its trials.
    pub trials: u32,
    /// Cost at the start, ms^2; `null` for gains that rang or ran away.
    pub cost_at_start: Option<f64>,
    /// Cost at the end, ms^2.
    pub cost: f64,
    /// The trial whose gains are within 5 % of the final cost.
    pub trials_to_5_percent: u32,
}

/// A tuned axis: the document, the searches, and the responses before and after.
#[derive(Debug, Clone)]
pub struct Tuned {
    /// What to print.
    pub document: TuningDocument,
    /// The path of each start.
    pub searches: Vec<Search>,
    /// The response under the gains that it began with: those that are believed, where they hold the axis.
    pub before: Trace,
    /// The response under the gains that were found.
    pub after: Trace,
}

impl Job for Tune {
    type Output = Tuned;

    /// Gains that the guard stops are a result of the search, not its end: the machine is cleared and brought
    /// back to where it stood. The observer is told of each trial.
    fn run(&self, work: &mut Work<'_>) -> Result<Tuned, Ended> {
        let rig = work.rig();
        tune(&mut work.station()?, rig, self)
    }

    fn order(&self) -> Order {
        Order::Tune(*self)
    }

    fn breaks(&self) -> &'static [Rule] {
        STEP
    }
}

/// Brings a machine back that gains have stopped.
fn recover(station: &mut Station, experiment: &Experiment, fault: Fault) -> Result<(), Ended> {
    if !PROVOKED.contains(&fault.rule) {
        return Err(fault.into());
    }
    station.set_pid(experiment.at, experiment.pid(station, experiment.safe));
    Ok(station.recover(fault)?)
}

/// Whether gains hold the axis, by their response: it comes to rest in time. None of them may be nothing, of which a
/// search could make no other, and a single count may not be worth all of the amplifier's `voltage`.
fn will_do(response: &Trace, experiment: &Experiment, voltage: f64) -> bool {
    let settling = step_response(response, experiment.step as f64).settling;
    settling < experiment.window
        && experiment.safe.iter().all(|gain| *gain > 0.0)
        && experiment.safe[0] < voltage
}

/// Gains by the datasheet alone, rising: the least gives all of the amplifier's voltage for a few steps' error. The
/// integral and the damping are such as servos of tens of milliseconds have.
fn ladder(station: &Station, experiment: &Experiment) -> [Gains; 5] {
    /// Per second.
    const INTEGRAL: f64 = 100.0;
    /// Seconds.
    const DAMPING: f64 = 1.5e-3;
    let whole = station.spec().drive(experiment.at.axis).voltage / experiment.step as f64;
    [0.3, 1.0, 3.0, 10.0, 30.0].map(|factor| {
        let kp = factor * whole;
        [kp, INTEGRAL * kp, DAMPING * kp]
    })
}

/// Gains to begin with where those that are believed do not hold the axis: the best of the [`ladder`]. They are safe
/// from now on.
fn begin_afresh(
    station: &mut Station,
    experiment: &mut Experiment,
    mut unsafe_trials: u32,
) -> Result<(Trace, u32), Ended> {
    let ladder = ladder(station, experiment);
    let mut best = (f64::INFINITY, ladder[0]);
    for gains in ladder {
        experiment.safe = best.1;
        match experiment.cost(station, gains) {
            Ok(cost) if cost < best.0 => best = (cost, gains),
            Ok(_) => {}
            Err(fault) => {
                unsafe_trials += 1;
                recover(station, experiment, fault)?;
            }
        }
    }
    experiment.safe = best.1;
    Ok((experiment.response(station, best.1)?, unsafe_trials))
}

fn tune(station: &mut Station, rig: &Rig, plan: &Tune) -> Result<Tuned, Ended> {
    let believed: &AxisGains = match plan.at.axis {
        Axis::A | Axis::B => &rig.calibration.gains.five_bar,
        Axis::Z => &rig.calibration.gains.z,
    };
    let drive = rig.spec.drive(plan.at.axis);
    let mut experiment = Experiment {
        at: plan.at,
        step: plan.step,
        one_size: plan.one_size,
        window: WINDOW,
        safe: [believed.kp, believed.ki, believed.kd],
        integral_limit: believed.integral_limit,
        specified: drive.step,
    };
    let (before, mut unsafe_trials) = match experiment.response(station, experiment.safe) {
        Ok(before) if will_do(&before, &experiment, drive.voltage) => (before, 0),
        Ok(_) => begin_afresh(station, &mut experiment, 0)?,
        Err(fault) => {
            experiment.safe = ladder(station, &experiment)[0];
            recover(station, &experiment, fault)?;
            begin_afresh(station, &mut experiment, 1)?
        }
    };
    let safe = experiment.safe;
    let mut searches = Vec::with_capacity(STARTS.len());
    for (i, factors) in STARTS.iter().enumerate() {
        let start: Gains = std::array::from_fn(|k| safe[k] * factors[k]);
        let (mut trial, mut best) = (0, f64::INFINITY);
        let mut cost = |gains: Gains| -> Result<f64, Ended> {
            let cost = match experiment.cost(station, gains) {
                Ok(cost) => cost,
                Err(fault) => {
                    unsafe_trials += 1;
                    if unsafe_trials > MOST_UNSAFE {
                        return Err(fault.into());
                    }
                    recover(station, &experiment, fault)?;
                    f64::INFINITY
                }
            };
            trial += 1;
            best = f64::min(best, cost);
            station.tell_trial(i, trial, best);
            Ok(cost)
        };
        searches.push(match plan.method {
            Method::Simplex => simplex(start, plan.trials, 1.6, &mut cost)?,
            Method::Random => {
                let mut rng = Pcg64Mcg::seed_from_u64(plan.seed ^ (i as u64 + 1));
                random_neighbourhood(start, plan.trials, 1.6, &mut rng, &mut cost)?
            }
        });
    }
    let chosen = choose(station, &experiment, plan.step, &searches)?;
    let document = TuningDocument {
        axis: plan.at.to_string(),
        search: plan.method,
        trials: chosen.search.trials,
        cost: rounded(chosen.cost, 1e-3),
        gains: chosen.gains,
        rise_ms: rounded(chosen.response.rise * 1e3, 1e-3),
        settling_ms: rounded(chosen.response.settling * 1e3, 1e-3),
        overshoot_percent: rounded(chosen.response.overshoot * 100.0, 1e-3),
        specified: experiment.specified.map(|s| SpecifiedRow {
            rise_ms: rounded(s.rise * 1e3, 1e-3),
            settling_ms: rounded(s.settling * 1e3, 1e-3),
            met: experiment.missed(&chosen.response, 1.0) == 0.0,
        }),
        unsafe_trials,
        seconds_machine: rounded(station.time(), 1e-4),
        starts: searches.iter().map(start_row).collect(),
        seed: plan.seed,
        calibration: String::new(),
        report: String::new(),
    };
    let after = chosen.trace;
    Ok(Tuned {
        document,
        searches,
        before,
        after,
    })
}

/// The gains among equals that rise and settle first.
fn choose<'s>(
    station: &mut Station,
    experiment: &Experiment,
    step: i64,
    searches: &'s [Search],
) -> Result<Chosen<'s>, Ended> {
    // Costs this close cannot be told apart in so flat a valley: of those, the gains that rise
    // and settle first, and as specified if any of them do.
    let least = searches
        .iter()
        .map(|s| s.best().cost)
        .fold(f64::INFINITY, f64::min);
    let mut near = Vec::new();
    for search in searches {
        for found in search.path.iter().filter(|p| p.cost <= 1.02 * least) {
            let gains = GainsRow::new(found.gains);
            let trace = experiment.response(station, gains.gains())?;
            let response = step_response(&trace, step as f64);
            near.push(Chosen {
                search,
                cost: found.cost,
                gains,
                trace,
                response,
            });
        }
    }
    let kept = |c: &Chosen| experiment.missed(&c.response, 1.0) == 0.0;
    if near.iter().any(kept) {
        near.retain(kept);
    }
    let fastest = |of: fn(&Chosen) -> f64| near.iter().map(of).fold(f64::INFINITY, f64::min);
    let rise = fastest(|c| c.response.rise);
    let settling = fastest(|c| c.response.settling);
    let slowness = |c: &Chosen| c.response.rise / rise + c.response.settling / settling;
    Ok(near
        .into_iter()
        .min_by(|a, b| slowness(a).total_cmp(&slowness(b)))
        .expect("the search with the least cost is among those near it"))
}

/// Gains among those that may be chosen.
struct Chosen<'s> {
    search: &'s Search,
    cost: f64,
    gains: GainsRow,
    trace: Trace,
    response: StepResponse,
}

fn start_row(search: &Search) -> StartRow {
    let (first, best) = (search.path[0], search.best());
    let near = search.path.iter().find(|p| p.cost <= 1.05 * best.cost);
    StartRow {
        start: GainsRow::new(first.gains),
        end: GainsRow::new(best.gains),
        trials: search.trials,
        cost_at_start: first.cost.is_finite().then(|| rounded(first.cost, 1e-3)),
        cost: rounded(best.cost, 1e-3),
        trials_to_5_percent: near.map_or(search.trials, |p| p.trial),
    }
}
