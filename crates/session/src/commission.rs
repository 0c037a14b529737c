//! A machine commissioned: from its datasheet to a calibration that was tried on devices.
//!
//! Steps, each of which believes what the ones before it have found, and none of which needs what it is to
//! replace: first whether the axes move, and the right way; the photodiodes in the dark; gains; windup; the
//! piezos; and at last an acceptance test on devices, judged by control's own word. A step that fails is said,
//! with what it fails for, and the machine is not accepted.

mod acceptance;
mod checks;
mod gains;
mod geometry;
mod positioned;
mod steps;

pub use positioned::commission_bench;

use crate::calibrations::{Belief, Change};
use crate::job::{Ended, Job};
use crate::setup::Setup;
use checks::Clock;
use pigtail_control::job::FiberReport;
use pigtail_control::recipe::Sweep;
use pigtail_control::station::Observer;
use pigtail_hal::{Error, Machine};
use pigtail_numerics::rounded;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// A step of commissioning, in order.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    strum::Display,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum StepName {
    /// Whether every axis moves, and the right way, and at what voltage (or whether it comes to where it is told to)
    Axes,
    /// The photodiodes without light
    Dark,
    /// Servo gains of both kinds of axis, tried on all axes
    Gains,
    /// Windup of the five-bars' joints
    Windup,
    /// Where both stages stand and how their axes lie, by the camera
    Geometry,
    /// Hysteresis of the piezos of both micros
    Piezos,
    /// How both micros swing when they are told to go elsewhere at once: resonance, damping, settling and lag
    Dynamics,
    /// How far the tips of both manipulators shake
    Shaking,
    /// How light spreads over a gap in the scale of both micros, where vision cannot know the gap
    Spread,
    /// How wide the spot of light is at the chip
    Spot,
    /// Lag, backlash and spot of both arms by light, on a bench that is controlled by position
    Groups,
    /// Devices aligned with all that was found
    Acceptance,
}

impl StepName {
    /// Those of a bench that is controlled by position, in order.
    pub const OF_BENCHES: [Self; 4] = [Self::Axes, Self::Dark, Self::Groups, Self::Acceptance];

    /// Those of a machine of volts, in order.
    pub fn of_machines() -> Vec<Self> {
        let all = <Self as strum::VariantArray>::VARIANTS.iter().copied();
        all.filter(|name| *name != Self::Groups).collect()
    }
}

/// What a step came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// As it should be.
    Passed,
    /// Not as it should be, or not to be done.
    Failed,
}

/// A step, as documents have it. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepDocument {
    /// Its name.
    pub name: StepName,
    /// Machine time, seconds.
    pub seconds: f64,
    /// What it came to.
    pub verdict: Verdict,
    /// Why it failed; empty where it did not.
    pub why: String,
    /// What was measured, in units that its keys name.
    pub values: Map<String, Value>,
}

impl StepDocument {
    /// Of what a step found within so many seconds.
    fn of(name: StepName, seconds: f64, Found { values, why }: Found) -> Self {
        Self {
            name,
            seconds: rounded(seconds, 1e-4),
            verdict: if why.is_empty() {
                Verdict::Passed
            } else {
                Verdict::Failed
            },
            why,
            values,
        }
    }
}

/// A step that is done, and all that is believed with it: from there a commissioning that was interrupted goes on.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StepDone {
    /// The step.
    pub step: StepDocument,
    /// What is believed from then on.
    pub belief: Belief,
    /// The tables of it that were found, by this step and those before it.
    pub tables: Vec<String>,
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

impl CommissionDocument {
    /// Of the steps that were done on a machine: its rig, fleet and seed, and machine time in seconds.
    fn of(
        (rig, fleet, seed): (&str, &str, u64),
        seconds: f64,
        steps: Vec<StepDocument>,
        unknown: Vec<&'static str>,
    ) -> Self {
        let tried = steps.iter().any(|step| step.name == StepName::Acceptance);
        Self {
            rig: rig.to_owned(),
            fleet: fleet.to_owned(),
            seed,
            seconds_machine: rounded(seconds, 1e-4),
            accepted: tried && steps.iter().all(|step| step.verdict == Verdict::Passed),
            steps,
            unknown,
            calibration: String::new(),
            report: String::new(),
        }
    }
}

/// A machine that was commissioned.
#[derive(Debug, Clone)]
pub struct Commissioned {
    /// What to print.
    pub document: CommissionDocument,
    /// All that is believed with what was found.
    pub belief: Belief,
    /// The tables of it that were found.
    pub tables: Vec<String>,
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
    /// Steps that a run has done before, which was interrupted or had one that failed: those that passed, up to the first that did not,
    /// are taken over, for each step believes what the ones before it found.
    pub before: Vec<StepDone>,
}

impl Plan {
    /// The steps that are taken over, if the first of `all` are among them.
    fn taken_over(&self, all: &[StepName]) -> &[StepDone] {
        let wanted = all.iter().filter(|name| self.steps.contains(name));
        let passed = self.before.iter().zip(wanted).take_while(|(done, name)| {
            done.step.name == **name && done.step.verdict == Verdict::Passed
        });
        &self.before[..passed.count()]
    }
}

/// What no step measures yet.
const UNKNOWN: [&str; 1] =
    ["where the stages stand in y: the camera looks along it, and light finds it at every device"];

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
    watch: impl FnMut(&StepDone),
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
    mut watch: impl FnMut(&StepDone),
) -> Result<Commissioned, Ended> {
    let setup = setup.at(seed)?.into_owned();
    let mut bench = Bench {
        belief: setup.rig.belief(),
        setup,
        seed,
        plan,
        machines,
        tables: Vec::new(),
        aligned: (Vec::new(), 0),
        seconds: 0.0,
        observer,
    };
    let all = StepName::of_machines();
    let before = plan.taken_over(&all);
    let mut steps: Vec<_> = before.iter().map(|done| done.step.clone()).collect();
    bench.seconds = steps.iter().map(|step| step.seconds).sum();
    if let Some(last) = before.last() {
        let rig = bench.setup.rig.with_belief(&last.belief);
        bench.setup.rig = rig.map_err(Ended::Input)?;
        (bench.belief, bench.tables) = (last.belief.clone(), last.tables.clone());
    }
    let wanted = all.iter().filter(|name| plan.steps.contains(name));
    for name in wanted.skip(before.len()) {
        let before = bench.seconds;
        let found = match bench.step(*name) {
            Ok(found) => found,
            Err(NotDone::Ended(error @ (Ended::Input(_) | Ended::Unrecorded(_)))) => {
                return Err(error);
            }
            Err(not_done) => Found {
                values: Map::new(),
                why: not_done.to_string(),
            },
        };
        let step = StepDocument::of(*name, bench.seconds - before, found);
        let done = StepDone {
            step,
            belief: bench.belief.clone(),
            tables: bench.tables.clone(),
        };
        watch(&done);
        steps.push(done.step);
    }
    let names = (&*bench.setup.rig.name, bench.setup.fleet_name(), seed);
    let document = CommissionDocument::of(names, bench.seconds, steps, UNKNOWN.to_vec());
    Ok(Commissioned {
        document,
        belief: bench.belief,
        tables: bench.tables,
    })
}

/// What a step found: values, and why that will not do, if it will not.
struct Found {
    values: Map<String, Value>,
    why: String,
}

/// Why a step was not done.
#[derive(Debug, thiserror::Error)]
enum NotDone {
    #[error(transparent)]
    Ended(#[from] Ended),
    /// What it found is none of what a calibration may hold: it is left out, and the step has failed.
    #[error("what was found is not to be believed: {0}")]
    Unbelievable(Error),
}

/// A machine on the way to being commissioned.
struct Bench<'b, 'm> {
    setup: Setup,
    belief: Belief,
    seed: u64,
    plan: &'b Plan,
    machines: &'b mut Machines<'m>,
    /// The tables that were found.
    tables: Vec<String>,
    /// Fibers of spare devices that were aligned already, and how many devices that were.
    aligned: (Vec<FiberReport>, usize),
    /// Machine time so far.
    seconds: f64,
    observer: &'b mut dyn Observer,
}

impl Bench<'_, '_> {
    fn step(&mut self, name: StepName) -> Result<Found, NotDone> {
        match name {
            StepName::Axes => self.axes(),
            StepName::Dark => self.dark(),
            StepName::Gains => self.gains(),
            StepName::Windup => self.windup(),
            StepName::Geometry => self.geometry(),
            StepName::Piezos => self.on_slow_lines(Self::piezos),
            StepName::Dynamics => self.on_slow_lines(Self::dynamics),
            StepName::Shaking => self.shaking(),
            StepName::Spread => self.spread(),
            StepName::Spot => self.spot(),
            StepName::Acceptance => self.acceptance(),
            StepName::Groups => Ok(Found {
                values: Map::new(),
                why: "is of a bench that is controlled by position".to_owned(),
            }),
        }
    }

    /// A step during which nobody knows yet how micros swing: one that is swept near its resonance goes anywhere, and swings on for long.
    fn on_slow_lines(
        &mut self,
        step: impl FnOnce(&mut Self) -> Result<Found, NotDone>,
    ) -> Result<Found, NotDone> {
        /// Of the recipe's lines: 15 a second instead of 42, where the softest that labs have resonate at 50 Hz.
        const SLOWER: f64 = 3.0;
        let sweep = self.setup.rig.recipe.fast.sweep;
        self.setup.rig.recipe.fast.sweep = Sweep {
            speed: sweep.speed / SLOWER,
            flyback: sweep.flyback * SLOWER,
        };
        let found = step(self);
        self.setup.rig.recipe.fast.sweep = sweep;
        found
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
    fn believe(&mut self, change: Change) -> Result<(), NotDone> {
        self.try_out(&change)?;
        if !self.tables.contains(&change.table) {
            self.tables.push(change.table);
        }
        Ok(())
    }

    /// Believes nothing of a table from now on.
    fn disbelieve(&mut self, table: String) -> Result<(), NotDone> {
        let mut belief = self.belief.clone();
        let rig = (belief.remove(&table)).and_then(|()| self.setup.rig.with_belief(&belief));
        self.setup.rig = rig.map_err(NotDone::Unbelievable)?;
        self.belief = belief;
        if !self.tables.contains(&table) {
            self.tables.push(table);
        }
        Ok(())
    }

    /// Believes what may not last.
    fn try_out(&mut self, change: &Change) -> Result<(), NotDone> {
        let mut belief = self.belief.clone();
        let rig = (belief.change(change)).and_then(|()| self.setup.rig.with_belief(&belief));
        self.setup.rig = rig.map_err(NotDone::Unbelievable)?;
        self.belief = belief;
        Ok(())
    }

    fn origin(&self, what: &str) -> String {
        format!("commission, {what}, run {}", self.plan.run)
    }
}
