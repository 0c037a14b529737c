//! What may be run in a session, and the ways in which it may end.

use crate::align::Align;
use crate::characterize::{Frequency, Resolution, Sine, Step};
use crate::contour::FollowContour;
use crate::first_light::FirstLight;
use crate::follow::Follow;
use crate::identify::{IdentifyWindup, MeasureWindup, ScanWindup};
use crate::impulse::Impulse;
use crate::piezos::IdentifyPiezos;
use crate::produce::Kept;
use crate::pulses::{BreakAway, LeastPulse, PlayPulses};
use crate::rig::Rig;
use crate::tune::Tune;
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::station::{Observer, Station};
use pigtail_hal::{Error, Fault, Machine, Rule};
use pigtail_machines::record::RecordError;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Something to be done on a machine.
pub trait Job {
    /// What comes of it.
    type Output;

    /// Does it.
    ///
    /// # Errors
    ///
    /// The way in which it ended without its result.
    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended>;

    /// The same as a record keeps it, so that a replay can do it again.
    fn order(&self) -> Order;

    /// Work that takes longer hangs, seconds of machine time.
    fn longest(&self) -> f64 {
        f64::INFINITY
    }

    /// Rules of the guard that it breaks on purpose, and which are left out while it runs.
    fn breaks(&self) -> &'static [Rule] {
        &[]
    }

    /// What tells its record from those of other jobs of one run; nothing where there are none.
    fn label(&self) -> Cow<'static, str> {
        Cow::Borrowed("")
    }
}

/// A job that is told from others of its kind in one run.
#[derive(Debug)]
pub struct Labelled<J> {
    /// What tells it: small letters, digits and dashes.
    pub label: String,
    /// The job.
    pub job: J,
}

impl<J: Job> Job for Labelled<J> {
    type Output = J::Output;

    fn run(&self, work: &mut Work<'_>) -> Result<J::Output, Ended> {
        self.job.run(work)
    }

    fn order(&self) -> Order {
        self.job.order()
    }

    fn longest(&self) -> f64 {
        self.job.longest()
    }

    fn breaks(&self) -> &'static [Rule] {
        self.job.breaks()
    }

    fn label(&self) -> Cow<'static, str> {
        Cow::Owned(self.label.clone())
    }
}

/// What a step of a reference breaks: it is farther away than any motion would be behind, the servo answers it
/// with all that it has, and a transmission gives way under that.
pub(crate) const STEP: &[Rule] = &[
    Rule::ServoFollowing,
    Rule::EndpointSpeed,
    Rule::OutputFollowing,
    Rule::MotorStall,
];

/// What a job works with: the machine behind its guard, what is believed of it, and who watches.
pub struct Work<'w> {
    pub(crate) machine: &'w mut dyn Machine,
    pub(crate) rig: &'w Rig,
    pub(crate) observer: &'w mut dyn Observer,
}

impl<'w> Work<'w> {
    /// What is known of the machine.
    pub fn rig(&self) -> &'w Rig {
        self.rig
    }

    /// Takes control of the machine, which stands at home.
    ///
    /// # Errors
    ///
    /// When the machine has a fault.
    pub fn station(&mut self) -> Result<Station<'_>, Fault> {
        Station::new(self.machine, &self.rig.calibration, self.observer)
    }
}

/// Why a job ended without its result.
#[derive(Debug, thiserror::Error)]
pub enum Ended {
    /// It cannot be done with this rig, or not as it was asked for.
    #[error(transparent)]
    Input(#[from] Error),
    /// The machine stopped, and is safe.
    #[error(transparent)]
    Fault(#[from] Fault),
    /// The machine is well; what was looked for is not there, or was lost.
    #[error("{0}")]
    Outcome(Outcome),
    /// It cannot be recorded.
    #[error(transparent)]
    Unrecorded(#[from] RecordError),
}

impl From<Outcome> for Ended {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Stopped(fault) => Self::Fault(fault),
            outcome => Self::Outcome(outcome),
        }
    }
}

impl From<Halt> for Ended {
    fn from(halt: Halt) -> Self {
        match halt {
            Halt::Fault(fault) => Self::Fault(fault),
            Halt::Outcome(outcome) => outcome.into(),
        }
    }
}

/// A job as a record keeps it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "job", rename_all = "kebab-case")]
pub enum Order {
    /// Align a device.
    Align(Align),
    /// A step response.
    Step(Step),
    /// A sine.
    Sine(Sine),
    /// The resolution test.
    Resolution(Resolution),
    /// A frequency response.
    Frequency(Frequency),
    /// Tune an axis.
    Tune(Tune),
    /// Identify the windup of an axis.
    IdentifyWindup(IdentifyWindup),
    /// Measure the windup of an axis.
    MeasureWindup(MeasureWindup),
    /// Identify the piezos of a micro.
    IdentifyPiezos(IdentifyPiezos),
    /// Bring an axis to a target by pulses.
    Impulse(Impulse),
    /// Search for first light.
    FirstLight(FirstLight),
    /// Follow a peak.
    Follow(Follow),
    /// Follow a contour.
    FollowContour(Box<FollowContour>),
    /// Drive an axis along a path.
    ScanWindup(ScanWindup),
    /// Find where a motor breaks away.
    BreakAway(BreakAway),
    /// Play pulses.
    PlayPulses(PlayPulses),
    /// Find the least pulse that moves an axis.
    LeastPulse(LeastPulse),
    /// Produce a tray.
    Produce(Box<Kept>),
    /// Something that nobody can do again from what was kept: it is recorded all the same.
    Other,
}
