//! A machine commissioned: from its datasheet to a calibration that was tried on devices.
//!
//! Steps, each of which believes what the ones before it have found, and none of which needs what it is to
//! replace: first whether the axes move, and the right way; the photodiodes in the dark; gains; windup; the
//! piezos; and at last an acceptance test on devices, judged by control's own word. A step that fails is said,
//! with what it fails for, and the machine is not accepted.

use crate::align::Align;
use crate::calibrations::{Belief, Change};
use crate::characterize::Step;
use crate::identify::{IdentifyWindup, Model};
use crate::job::{Ended, Job, Order, Work};
use crate::piezos::{MeasureRatios, SeePiezos};
use crate::setup::Setup;
use crate::tune::{Method, Tune, step_of};
use pigtail_control::fast::Ratio;
use pigtail_control::outcome::Outcome;
use pigtail_control::piezo::camera::{Seen, SeenMicro};
use pigtail_control::procedure::FiberReport;
use pigtail_control::shaking::Measured;
use pigtail_control::station::{Observer, Station};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{
    Axis, AxisName, Channel, Command, Error, Fault, Machine, Measurement, Rule, Side, Spec,
};
use pigtail_numerics::rounded;
use pigtail_numerics::statistics::Sorted;
use pigtail_twin::Specimen;
use serde::Serialize;
use serde_json::{Map, Value, json};

/// A step of commissioning, in order.
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
)]
#[strum(serialize_all = "kebab-case")]
pub enum StepName {
    /// Whether every axis moves, and the right way, and at what voltage
    Axes,
    /// The photodiodes without light
    Dark,
    /// Servo gains of both kinds of axis, tried on all axes
    Gains,
    /// Windup of the five-bars' joints
    Windup,
    /// Hysteresis of the piezos of both micros
    Piezos,
    /// How far the tips of both manipulators shake
    Shaking,
    /// Devices aligned with all that was found
    Acceptance,
}

/// What a step came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// As it should be.
    Passed,
    /// Not as it should be, or not to be done.
    Failed,
}

/// A step, as documents have it. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepDocument {
    /// Its name.
    pub name: &'static str,
    /// Machine time, seconds.
    pub seconds: f64,
    /// What it came to.
    pub verdict: Verdict,
    /// Why it failed; empty where it did not.
    pub why: String,
    /// What was measured, in units that its keys name.
    pub values: Map<String, Value>,
}

/// What `commission` prints as JSON and keeps as `summary.json`. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CommissionDocument {
    /// The rig as it was named.
    pub rig: String,
    /// What the machine may be.
    pub fleet: String,
    /// The machine's seed.
    pub seed: u64,
    /// Machine time of all steps, seconds.
    pub seconds_machine: f64,
    /// The steps that were done.
    pub steps: Vec<StepDocument>,
    /// Whether every step that was done has passed, and the acceptance test was among them.
    pub accepted: bool,
    /// What is not known of the machine, and what that costs.
    pub unknown: Vec<&'static str>,
    /// The file that holds the calibration that was found: the rig's with `--write`, else the run's; empty where
    /// nothing was found.
    pub calibration: String,
    /// Path of the report; empty where there is none.
    pub report: String,
}

/// A machine that was commissioned.
#[derive(Debug, Clone)]
pub struct Commissioned {
    /// What to print.
    pub document: CommissionDocument,
    /// What was found.
    pub changes: Vec<Change>,
    /// All that is believed with it.
    pub belief: Belief,
}

/// What is to be done.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The steps, in any order: they are done in their own.
    pub steps: Vec<StepName>,
    /// Devices of the acceptance test.
    pub devices: u64,
    /// When, for the tables.
    pub date: String,
    /// By which run.
    pub run: String,
}

/// What no step measures yet.
const UNKNOWN: [&str; 3] = [
    "settling and lag of the micros: believed as they are in the calibration; one that rings costs turns of the \
     last circle",
    "home, yaw and squareness of the stages: vision sees where tips are, at every device",
    "mode widths: those of the recipe; others cost falls back to the slow procedure",
];

/// The first device of the acceptance test: nobody's production comes so far.
const DEVICES: u64 = 900_000;

/// Commissions the twin that a seed draws. `watch` is told of each step when it has been done.
///
/// # Errors
///
/// Bad input, and records that cannot be kept. A machine that fails is no error.
pub fn commission(
    setup: &Setup,
    seed: u64,
    plan: &Plan,
    observer: &mut dyn Observer,
    watch: impl FnMut(&StepDocument),
) -> Result<Commissioned, Ended> {
    let mut twins = |setup: &Setup, seed| -> Result<Box<dyn Machine>, Error> {
        Ok(Box::new(setup.twin(seed)?))
    };
    commission_with(setup, seed, plan, &mut twins, observer, watch)
}

/// The machine of a seed, with the device of this seed in place.
pub type Machines<'m> = dyn FnMut(&Setup, u64) -> Result<Box<dyn Machine>, Error> + 'm;

/// The same with machines that are no twins as a seed draws them.
///
/// # Errors
///
/// As [`commission`], and what `machines` gives.
pub fn commission_with(
    setup: &Setup,
    seed: u64,
    plan: &Plan,
    machines: &mut Machines<'_>,
    observer: &mut dyn Observer,
    mut watch: impl FnMut(&StepDocument),
) -> Result<Commissioned, Ended> {
    let setup = setup.at(seed)?.into_owned();
    let mut bench = Bench {
        belief: setup.rig.belief(),
        setup,
        seed,
        plan,
        machines,
        changes: Vec::new(),
        seconds: 0.0,
        observer,
    };
    let mut steps = Vec::new();
    for name in <StepName as strum::VariantArray>::VARIANTS {
        if !plan.steps.contains(name) {
            continue;
        }
        let before = bench.seconds;
        let (verdict, why, values) = match bench.step(*name) {
            Ok(Found { values, why }) if why.is_empty() => (Verdict::Passed, why, values),
            Ok(Found { values, why }) => (Verdict::Failed, why, values),
            Err(error @ (Ended::Input(_) | Ended::Unrecorded(_))) => return Err(error),
            Err(ended) => (Verdict::Failed, ended.to_string(), Map::new()),
        };
        let step = StepDocument {
            name: name.into(),
            seconds: rounded(bench.seconds - before, 1e-4),
            verdict,
            why,
            values,
        };
        watch(&step);
        steps.push(step);
    }
    let tried = steps
        .iter()
        .any(|step| step.name == <&str>::from(StepName::Acceptance));
    let document = CommissionDocument {
        rig: bench.setup.rig.name.clone(),
        fleet: bench.setup.fleet_name().to_owned(),
        seed,
        seconds_machine: rounded(bench.seconds, 1e-4),
        accepted: tried && steps.iter().all(|step| step.verdict == Verdict::Passed),
        steps,
        unknown: UNKNOWN.to_vec(),
        calibration: String::new(),
        report: String::new(),
    };
    Ok(Commissioned {
        document,
        changes: bench.changes,
        belief: bench.belief,
    })
}

/// What the camera saw of both micros, how far each goes in y for a displacement in x, and how the fibers ended of the last
/// device that was to tell.
type PiezosFound = ([SeenMicro; SIDES], [Option<Ratio>; SIDES], Vec<FiberReport>);

/// What a step found: values, and why that will not do, if it will not.
struct Found {
    values: Map<String, Value>,
    why: String,
}

/// A machine on the way to being commissioned.
struct Bench<'b, 'm> {
    setup: Setup,
    belief: Belief,
    seed: u64,
    plan: &'b Plan,
    machines: &'b mut Machines<'m>,
    changes: Vec<Change>,
    /// Machine time so far.
    seconds: f64,
    observer: &'b mut dyn Observer,
}

impl Bench<'_, '_> {
    fn step(&mut self, name: StepName) -> Result<Found, Ended> {
        match name {
            StepName::Axes => self.axes(),
            StepName::Dark => self.dark(),
            StepName::Gains => self.gains(),
            StepName::Windup => self.windup(),
            StepName::Piezos => self.piezos(),
            StepName::Shaking => self.shaking(),
            StepName::Acceptance => self.acceptance(),
        }
    }

    /// A job on the machine, with a device in place.
    fn run<J: Job>(&mut self, job: &J, seed: u64) -> Result<J::Output, Ended> {
        let mut clock = Clock {
            machine: (self.machines)(&self.setup, seed)?,
            time: 0.0,
        };
        let result = self.setup.perform(&mut clock, job, seed, self.observer);
        self.seconds += clock.time;
        result
    }

    /// Believes what was found from now on.
    fn believe(&mut self, change: Change) -> Result<(), Error> {
        self.belief.change(&change)?;
        self.setup.rig = self.setup.rig.with_belief(&self.belief)?;
        self.changes.push(change);
        Ok(())
    }

    /// Believes what may not last.
    fn try_out(&mut self, change: &Change) -> Result<(), Error> {
        self.belief.change(change)?;
        self.setup.rig = self.setup.rig.with_belief(&self.belief)?;
        Ok(())
    }

    fn origin(&self, what: &str) -> String {
        format!("commission, {what}, run {}", self.plan.run)
    }

    fn axes(&mut self) -> Result<Found, Ended> {
        let moved = self.run(&CheckAxes, self.seed)?;
        let mut values = Map::new();
        let mut why = String::new();
        for axis in moved {
            let name = axis.at.to_string();
            if why.is_empty() {
                why = axis
                    .wrong()
                    .map_or_else(String::new, |wrong| format!("{name} {wrong}"));
            }
            values.insert(
                name,
                json!({
                    "forward_V": rounded(axis.forward.volts, 1e-4),
                    "backward_V": rounded(axis.backward.volts, 1e-4),
                    "way_counts": [axis.forward.counts, axis.backward.counts],
                    "way_of_output_um": axis.forward.output.map(|way| rounded(1e6 * way, 1e-4)),
                }),
            );
        }
        Ok(Found { values, why })
    }

    fn dark(&mut self) -> Result<Found, Ended> {
        let levels = self.run(&Dark, self.seed)?;
        let spec = &self.setup.rig.spec.photodiode;
        let mut why = String::new();
        let mut values = Map::new();
        for (name, (mean, sigma)) in levels {
            if mean > MOST_DARK * spec.range {
                why = format!("the photodiode {name} reads {mean:.2} V without light");
            }
            values.insert(
                name.to_owned(),
                json!({"mean_V": rounded(mean, 1e-6), "noise_V": rounded(sigma, 1e-6)}),
            );
        }
        Ok(Found { values, why })
    }

    /// Tunes an axis of each kind, and steps all of them: gains that one of them does not bear are made less.
    fn gains(&mut self) -> Result<Found, Ended> {
        /// How often, and by what, before it is given up.
        const GENTLER: usize = 4;
        const BY: f64 = 0.8;
        let mut values = Map::new();
        let mut why = String::new();
        for (kind, table) in [(Axis::A, "five_bar"), (Axis::Z, "z")] {
            let at = AxisName {
                side: Side::Left,
                axis: kind,
            };
            let method = Method::Simplex;
            let tune = Tune {
                at,
                method,
                trials: method.usual_trials(),
                step: step_of(&self.setup.rig, kind),
                seed: self.seed,
            };
            let tuned = self.run(&tune, self.seed)?.document;
            let mut gains = tuned.gains;
            let mut gentler = 0;
            let wrong = loop {
                let origin = self.origin(&format!("tune {at}"));
                self.try_out(&Change {
                    table: format!("gains.{table}"),
                    values: gains.values(&self.plan.date, &origin),
                    weights: None,
                })?;
                let wrong = self.step_all(kind, &mut values)?;
                if wrong.is_none() || gentler == GENTLER {
                    break wrong;
                }
                gains = gains.times(BY);
                gentler += 1;
            };
            let origin = self.origin(&format!("tune {at}"));
            self.believe(Change {
                table: format!("gains.{table}"),
                values: gains.values(&self.plan.date, &origin),
                weights: None,
            })?;
            if let Some(wrong) = wrong.filter(|_| why.is_empty()) {
                why = format!("{wrong} does not come to rest under the gains that were found");
            }
            let specified = tuned.specified.map(|specified| specified.met);
            values.insert(
                table.to_owned(),
                json!({
                    "kp_V_per_count": gains.kp,
                    "ki_V_per_count_s": gains.ki,
                    "kd_V_s_per_count": gains.kd,
                    "times_gentler": gentler,
                    "rise_ms": tuned.rise_ms,
                    "settling_ms": tuned.settling_ms,
                    "specified_met": specified,
                }),
            );
        }
        Ok(Found { values, why })
    }

    /// Steps all axes of a kind, and notes how they answer. One that does not come to rest, if there is one.
    fn step_all(
        &mut self,
        kind: Axis,
        values: &mut Map<String, Value>,
    ) -> Result<Option<AxisName>, Ended> {
        let mut wrong = None;
        let alike = |axis: &Axis| (*axis == Axis::Z) == (kind == Axis::Z);
        for side in Side::ALL {
            for axis in Axis::ALL.into_iter().filter(alike) {
                let at = AxisName { side, axis };
                let step = Step {
                    at,
                    size: step_of(&self.setup.rig, axis),
                };
                let (response, _) = self.run(&step, self.seed)?;
                if !response.settled {
                    wrong = wrong.or(Some(at));
                }
                values.insert(
                    at.to_string(),
                    json!({
                        "rise_ms": response.rise_ms,
                        "settling_ms": response.settling_ms,
                        "overshoot_percent": response.overshoot_percent,
                        "settled": response.settled,
                    }),
                );
            }
        }
        Ok(wrong)
    }

    fn windup(&mut self) -> Result<Found, Ended> {
        let at = AxisName {
            side: Side::Left,
            axis: Axis::A,
        };
        let job = IdentifyWindup {
            at,
            model: Model::Memory,
            seed: self.seed,
        };
        let identified = self.run(&job, self.seed)?;
        let d = &identified.document;
        let mut values = Map::new();
        values.insert(
            at.to_string(),
            json!({
                "w_max_um": d.w_max_um,
                "q_um": d.q_um,
                "residual_um": d.residual_um,
                "gap_without_um": d.uncompensated_um,
                "gap_with_um": d.compensated_um,
            }),
        );
        if d.factor < LEAST_FACTOR {
            let why = format!(
                "{at}: the model makes its gap {:.1} times narrower only",
                d.factor
            );
            return Ok(Found { values, why });
        }
        let origin = self.origin(&format!("identify windup {at}"));
        self.believe(Change {
            table: "windup.five_bar".to_owned(),
            values: identified.values(&self.plan.date, &origin),
            weights: None,
        })?;
        Ok(Found {
            values,
            why: String::new(),
        })
    }

    /// By the camera first, then, with what that found, by the light of a device.
    fn piezos(&mut self) -> Result<Found, Ended> {
        // What is to be found is not believed meanwhile.
        let believed = std::mem::take(&mut self.setup.rig.calibration.hysteresis);
        let found = self.piezos_found();
        self.setup.rig.calibration.hysteresis = believed;
        let (micros, ratios, fibers) = found?;
        let (mut values, mut why) = (Map::new(), String::new());
        let all = Side::ALL.into_iter().zip(&micros).zip(ratios);
        for ((side, micro), ratio) in all {
            let Some(ratio) = ratio else {
                if why.is_empty() {
                    let name = side.name();
                    why = format!("no light told how far {name} goes in y{}", ended(&fibers));
                }
                continue;
            };
            let nm =
                |of: fn(&Seen) -> f64| micro.piezos.each_ref().map(|p| rounded(1e9 * of(p), 1e-3));
            values.insert(
                side.name().to_owned(),
                json!({
                    "residual_nm": nm(|piezo| piezo.residual),
                    "known_nm": nm(|piezo| piezo.known),
                    "drift_nm_s": nm(|piezo| piezo.drift),
                    "ratio": rounded(ratio.ratio, 1e-5),
                    "ratio_deviation": rounded(ratio.deviation, 1e-5),
                    "scale_by_macro": rounded(ratio.scale, 1e-5),
                }),
            );
            if (ratio.scale - 1.0).abs() > SCALE && why.is_empty() {
                why = format!(
                    "{} goes {:.1} % farther by the macro than by the camera",
                    side.name(),
                    100.0 * (ratio.scale - 1.0)
                );
                continue;
            }
            let model = micro.model(ratio.ratio);
            let residual = micro.piezos.iter().map(|piezo| piezo.residual);
            let residual = residual.fold(0.0, f64::max);
            let text = serde_json::to_string_pretty(&model)
                .map_err(|error| Error::new("weights", "", error.to_string()))?;
            let file = format!("weights-{}.json", side.name());
            let origin = self.origin(&format!("piezos by camera, {}", side.name()));
            self.believe(Change {
                table: format!("hysteresis.{}", side.name()),
                values: vec![
                    ("model", toml_edit::value(model.piezos[0].name())),
                    ("weights", toml_edit::value(&file)),
                    ("micro", toml_edit::Item::None),
                    (
                        "residual",
                        toml_edit::value(format!("{:.5} um", 1e6 * residual)),
                    ),
                    ("date", toml_edit::value(&self.plan.date)),
                    ("origin", toml_edit::value(origin)),
                ],
                weights: Some((file, text + "\n")),
            })?;
        }
        Ok(Found { values, why })
    }

    /// What the camera saw of both micros, how far each goes in y for a displacement in x, and how the fibers ended of
    /// the device that told.
    fn piezos_found(&mut self) -> Result<PiezosFound, Ended> {
        /// Before light has told: as far as in x.
        const RATIO: f64 = 1.0;
        let micros = self.run(&SeePiezos, self.seed)?;
        for (side, micro) in Side::ALL.into_iter().zip(&micros) {
            let hystereses = &mut self.setup.rig.calibration.hysteresis;
            hystereses.set(side, Some(micro.model(RATIO)));
        }
        let (mut ratios, mut fibers) = ([None; SIDES], Vec::new());
        for device in self.spare_devices() {
            let (found, ended) = self.run(&MeasureRatios, device)?;
            for (ratio, found) in ratios.iter_mut().zip(found) {
                *ratio = ratio.or(found);
            }
            fibers = ended;
            if ratios.iter().all(Option::is_some) {
                break;
            }
        }
        Ok((micros, ratios, fibers))
    }

    /// Devices that are tried one after the other, until one has told what is to be known: nobody's production, and none
    /// of the acceptance test.
    fn spare_devices(&self) -> impl Iterator<Item = u64> + use<> {
        /// So many.
        const TRIED: u64 = 3;
        let machine = Specimen::from(self.seed).machine();
        (1..=TRIED).map(move |k| Specimen::of(machine, DEVICES - k).seed())
    }

    /// Watches the tips of a device before they are attached.
    fn shaking(&mut self) -> Result<Found, Ended> {
        let (recipe, believed) = (&mut self.setup.rig.recipe, &mut self.setup.rig.calibration);
        let watch = std::mem::replace(&mut recipe.fast.watch, WATCH);
        // What is to be found is not believed meanwhile.
        let before = std::mem::take(&mut believed.shaking);
        let fibers = self.watched();
        self.setup.rig.recipe.fast.watch = watch;
        self.setup.rig.calibration.shaking = before;
        let fibers = fibers?;
        let mut values = Map::new();
        let mut why = String::new();
        for side in Side::ALL {
            let of_side = fibers.iter().filter(|fiber| fiber.side == side);
            let watched = of_side.filter_map(|fiber| fiber.shaking);
            let watched = watched.map(|found| Measured {
                spread: found.spread.max(ANOTHER),
                ..found
            });
            let Some(found) = watched.min_by(|a, b| a.spread.total_cmp(&b.spread)) else {
                if why.is_empty() {
                    why = format!("no tip of {} was watched{}", side.name(), ended(&fibers));
                }
                continue;
            };
            values.insert(
                side.name().to_owned(),
                json!({
                    "deviation_nm": rounded(1e9 * found.deviation, 1e-3),
                    "spread": rounded(found.spread, 1e-3),
                    "left": rounded(found.left, 1e-4),
                }),
            );
            let origin = self.origin(&format!("shaking, {}", side.name()));
            self.believe(Change {
                table: format!("shaking.{}", side.name()),
                values: vec![
                    (
                        "deviation",
                        toml_edit::value(format!("{:.2} nm", 1e9 * found.deviation)),
                    ),
                    ("spread", toml_edit::value(rounded(found.spread, 1e-3))),
                    ("left", toml_edit::value(rounded(found.left, 1e-4))),
                    ("date", toml_edit::value(&self.plan.date)),
                    ("origin", toml_edit::value(origin)),
                ],
                weights: None,
            })?;
        }
        Ok(Found { values, why })
    }

    /// Fibers of devices that were aligned to watch their tips, until tips of both sides were watched.
    fn watched(&mut self) -> Result<Vec<FiberReport>, Ended> {
        let mut fibers = Vec::new();
        for device in self.spare_devices() {
            fibers.extend(self.run(&Align::default(), device)?.fibers);
            let watched = |side: Side| {
                let mut of_side = fibers.iter().filter(|fiber| fiber.side == side);
                of_side.any(|fiber| fiber.shaking.is_some())
            };
            if Side::ALL.into_iter().all(watched) {
                break;
            }
        }
        Ok(fibers)
    }

    fn acceptance(&mut self) -> Result<Found, Ended> {
        let machine = Specimen::from(self.seed).machine();
        let (mut aligned, mut fibers, mut why) = (0_u64, 0_u64, String::new());
        let mut seconds = Vec::new();
        for k in 0..self.plan.devices {
            let device = Specimen::of(machine, DEVICES + k).seed();
            for fiber in self.run(&Align::default(), device)?.fibers {
                fibers += 1;
                if fiber.outcome == Outcome::NotAttempted {
                    continue;
                }
                seconds.push(fiber.seconds());
                if fiber.outcome.is_aligned() {
                    aligned += 1;
                } else if why.is_empty() {
                    why = format!("device {}, {}: {}", k + 1, fiber.port, fiber.outcome);
                }
            }
        }
        let seconds = Sorted::new(seconds);
        let mut values = Map::new();
        values.insert("devices".to_owned(), json!(self.plan.devices));
        values.insert("fibers".to_owned(), json!(fibers));
        values.insert("aligned".to_owned(), json!(aligned));
        for (name, share) in [("seconds_p50", 0.5), ("seconds_max", 1.0)] {
            let value = seconds.percentile(share).map(|value| rounded(value, 1e-4));
            values.insert(name.to_owned(), json!(value));
        }
        Ok(Found { values, why })
    }
}

/// How the first fiber ended that was not aligned, if there is one, to go on with after what that prevented.
fn ended(fibers: &[FiberReport]) -> String {
    let ended = fibers.iter().find(|fiber| !fiber.outcome.is_aligned());
    ended.map_or_else(String::new, |fiber| {
        format!(": {}, {}", fiber.port, fiber.outcome)
    })
}

/// No photodiode reads more than this share of its range without light.
const MOST_DARK: f64 = 0.1;

/// For how long tips are watched whether they shake, in x and in y, seconds.
const WATCH: f64 = 2.0;

/// However well it is seen, a tip shakes on another day and with another fiber by some tenth more or less: an estimate.
const ANOTHER: f64 = 0.1;

/// Camera and macro do not differ by more of a micro's way: some tens of micrometres, of which its model is known to one.
const SCALE: f64 = 0.06;

/// A model of windup that makes the gap less than so many times narrower is worth nothing.
const LEAST_FACTOR: f64 = 3.0;

/// A machine and its clock.
struct Clock {
    machine: Box<dyn Machine>,
    time: f64,
}

impl Machine for Clock {
    fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let measured = self.machine.exchange(command)?;
        self.time = measured.time;
        Ok(measured)
    }

    fn stop(&mut self) {
        self.machine.stop();
    }
}

/// Whether each axis moves under a voltage, and where to: every axis by itself, no loop closed.
struct CheckAxes;

/// How an axis answered a voltage that rose until it moved.
#[derive(Debug, Clone, Copy)]
struct Answer {
    /// The voltage, without sign; that of the amplifier where it did not move.
    volts: f64,
    /// How far it went, counts.
    counts: i64,
    /// How far its output went by its probe, metres; `None` without one.
    output: Option<f64>,
}

struct MovedAxis {
    at: AxisName,
    forward: Answer,
    backward: Answer,
}

impl MovedAxis {
    /// What is wrong with it.
    fn wrong(&self) -> Option<&'static str> {
        match (self.forward.counts, self.backward.counts) {
            (0, _) | (_, 0) => Some("does not move under its amplifier's voltage"),
            (forward, backward) if forward < 0 && backward > 0 => Some(
                "moves the wrong way: its motor or its encoder is connected the other way round",
            ),
            (forward, backward) if forward < 0 || backward > 0 => {
                Some("moves the same way whatever the sign of its voltage")
            }
            _ => None,
        }
    }
}

impl Job for CheckAxes {
    type Output = Vec<MovedAxis>;

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let mut station = work.station()?;
        let all = Side::ALL.into_iter();
        let all: Vec<_> = all
            .flat_map(|side| Axis::ALL.map(|axis| AxisName { side, axis }))
            .collect();
        for at in &all {
            station.hold_voltage(*at, Volts(0.0));
        }
        let mut moved = Vec::with_capacity(all.len());
        for at in all {
            let forward = rise(&mut station, at, 1.0)?;
            let backward = rise(&mut station, at, -1.0)?;
            moved.push(MovedAxis {
                at,
                forward,
                backward,
            });
        }
        Ok(moved)
    }

    fn order(&self) -> Order {
        Order::Other
    }

    fn breaks(&self) -> &'static [Rule] {
        // A voltage under which nothing moves yet is what is looked for.
        &[Rule::MotorStall]
    }
}

/// Raises the voltage of an axis until it has moved a little.
fn rise(station: &mut Station, at: AxisName, sign: f64) -> Result<Answer, Ended> {
    /// Volts a second.
    const RATE: f64 = 5.0;
    /// So far is far enough, counts.
    const FAR: i64 = 8;
    /// In which everything comes to rest, seconds.
    const REST: f64 = 0.05;
    let limit = station.spec().drive(at.axis).voltage;
    let step = RATE * station.spec().period();
    let (Counts(start), from) = (station.encoder(at), station.probe(at));
    let mut volts = 0.0;
    let gone = |station: &Station| station.encoder(at).0 - start;
    while gone(station).abs() < FAR && volts < limit {
        volts = (volts + step).min(limit);
        station.hold_voltage(at, Volts(sign * volts));
        station.cycle()?;
    }
    let counts = if volts < limit { gone(station) } else { 0 };
    station.hold_voltage(at, Volts(0.0));
    station.run(REST)?;
    let output = station.probe(at).zip(from).map(|(now, then)| now - then);
    Ok(Answer {
        volts,
        counts,
        output,
    })
}

/// The photodiodes without the laser.
struct Dark;

impl Job for Dark {
    /// Name, mean and standard deviation of each, volts.
    type Output = Vec<(&'static str, (f64, f64))>;

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        /// Seconds.
        const LOOK: f64 = 1.0;
        let mut station = work.station()?;
        station.laser(false);
        station.run(0.02)?;
        let each = Channel::ALL.into_iter().map(|channel| {
            let level = station.level(channel, LOOK)?;
            Ok((channel.name(), (level.mean, level.sigma)))
        });
        each.collect()
    }

    fn order(&self) -> Order {
        Order::Other
    }
}
