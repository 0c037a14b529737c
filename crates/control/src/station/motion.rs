//! Motions of the macros: along paths that break no limit, until the axes have arrived; and back after a fault.

use super::{Started, Station, VoltageMachine};
use crate::outcome::{Halt, Outcome};
use crate::trajectory::{Arc, Limits, Line, Motion, Path, Refused, Shape};
use pigtail_hal::quantity::Counts;
use pigtail_hal::{Axis, AxisName, Command, Fault, Side};
use pigtail_model::frames::{Macro, Point};
use std::f64::consts::TAU;

/// How near, in encoder counts, an axis must come to count as arrived, and for how long.
const ARRIVED_COUNTS: i64 = 1;
const ARRIVED_SECONDS: f64 = 0.02;
/// An axis that has not arrived by then stays where friction holds it...
const SETTLE_SECONDS: f64 = 0.3;
/// ...unless it is so many counts away that something else must hold it.
const LOST_COUNTS: i64 = 10;
/// How long the machine is left to come to rest when it is taken up again.
const RECOVERY_SECONDS: f64 = 0.3;
/// How fast it is brought back then, as a share of the motors' highest speed.
const RECOVERY_PACE: f64 = 0.02;

/// The axes of a side come to rest at the end of a motion.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Arrival {
    /// Since the motion's end, seconds, and since all of them are where they should be.
    waited: f64,
    near: f64,
}

impl Arrival {
    /// After a cycle more; whether they have arrived, or will not.
    pub(super) fn step(&mut self, station: &Station, side: Side) -> bool {
        let period = station.spec().period();
        self.waited += period;
        let error = |axis: &Axis| station.following_error(AxisName { side, axis: *axis });
        let near = Axis::ALL
            .iter()
            .all(|axis| error(axis).abs() <= ARRIVED_COUNTS);
        self.near = if near { self.near + period } else { 0.0 };
        self.waited >= SETTLE_SECONDS || self.near >= ARRIVED_SECONDS
    }
}

impl Station<'_> {
    /// Takes the machine into its hands again after a fault that an experiment provoked: clears it, lets every
    /// axis come to rest where it stands, and brings all back to their references, slowly and each by itself:
    /// a path need not be possible from where they were left.
    ///
    /// # Errors
    ///
    /// The same fault where nothing can clear it, or whatever hinders the way back.
    pub fn recover(&mut self, fault: Fault) -> Result<(), Halt> {
        if self.machine.clear().is_none() {
            return Err(fault.into());
        }
        let to = Side::ALL.map(|side| self.arms[side.index()].references);
        // What was measured last is of before it stopped: the first command drives nothing.
        self.command.motors = Command::IDLE.motors;
        self.command.references = Command::IDLE.references;
        self.command.pulses = Command::NO_PULSES;
        self.measurement = self.machine.exchange(&self.command)?;
        for side in Side::ALL {
            for axis in Axis::ALL {
                self.close_loop(AxisName { side, axis });
            }
        }
        self.run(RECOVERY_SECONDS)?;
        let from = self.measurement.encoders;
        let period = self.spec().period();
        // Of the axis that takes the most cycles: by the encoders alone, which are right even where no
        // endpoint belongs to them.
        let mut cycles = 1.0_f64;
        for axis in Axis::ALL {
            let (i, drive) = (axis.index(), self.spec().drive(axis));
            let counts_per_radian = f64::from(drive.counts_per_turn) / TAU;
            let pace = RECOVERY_PACE * drive.speed * counts_per_radian * period;
            for (from, to) in from.iter().zip(&to) {
                cycles = cycles.max(((to[i].0 - from[i].0).abs() as f64 / pace).ceil());
            }
        }
        for k in 1..=cycles as u64 {
            let share = k as f64 / cycles;
            for (arm, (from, to)) in self.arms.iter_mut().zip(from.iter().zip(&to)) {
                arm.references = std::array::from_fn(|i| {
                    let way = (to[i].0 - from[i].0) as f64;
                    Counts(from[i].0 + (share * way).round() as i64)
                });
            }
            self.cycle()?;
        }
        for side in Side::ALL {
            self.settle(side)?;
        }
        Ok(())
    }

    /// Gives the motions that start from now on another profile. It begins with the thesis's
    /// trapezoid.
    pub fn set_shape(&mut self, shape: Shape) {
        self.shape = shape;
    }

    /// Starts a straight line from where the endpoint is wanted now, no faster than `speed` m/s.
    ///
    /// # Errors
    ///
    /// [`Outcome::Refused`] when it would break a limit; the endpoint then stays as it is.
    pub fn start_line(
        &mut self,
        side: Side,
        to: Point<Macro>,
        speed: Option<f64>,
    ) -> Result<(), Outcome> {
        self.start(side, Line::new(self.wanted(side), to), speed)
    }

    /// Starts an arc, which must begin where the endpoint is wanted now, no faster than `speed`
    /// m/s along it.
    ///
    /// # Errors
    ///
    /// As [`Self::start_line`].
    pub fn start_arc(&mut self, side: Side, arc: Arc, speed: Option<f64>) -> Result<(), Outcome> {
        self.start(side, arc, speed)
    }

    /// Starts a motion, unless it would break a limit somewhere on its way.
    fn start(
        &mut self,
        side: Side,
        path: impl Into<Path>,
        speed: Option<f64>,
    ) -> Result<(), Outcome> {
        let path = path.into();
        let (start, here) = (path.start(), self.wanted(side));
        if start != here {
            let why = Refused::Start { start, here };
            return Err(Outcome::Refused { side, why });
        }
        let motion = self.motion(side, path, speed)?;
        self.arms[side.index()].motion = Some(Started {
            motion,
            at: self.measurement.time,
            slower: 0.0,
        });
        Ok(())
    }

    /// A motion along a path, which breaks no limit.
    pub(super) fn motion(
        &self,
        side: Side,
        path: Path,
        speed: Option<f64>,
    ) -> Result<Motion, Outcome> {
        let checked = || {
            let motion = Motion::new(path, self.shape, &self.limits(side), speed)?;
            motion.check(self.kinematics(side), self.spec().period())?;
            Ok(motion)
        };
        checked().map_err(|why| Outcome::Refused { side, why })
    }

    /// The limits of a side's motions. An axis whose gains were made less, since it swung at rest, is pulled along by as much less force: it is not
    /// asked to gather speed faster, or it would lag behind and run past its end.
    fn limits(&self, side: Side) -> Limits {
        let mut limits = self.limits;
        let [a, b, z] = self.arms[side.index()].states.map(|state| state.share());
        for (rates, share) in [(&mut limits.xy, a.min(b)), (&mut limits.z, z)] {
            rates.acceleration *= share;
            rates.jerk *= share;
        }
        limits
    }

    /// Whether a motion is still being followed.
    pub fn moving(&self, side: Side) -> bool {
        self.arms[side.index()].motion.is_some()
    }

    /// Calls a motion off: the endpoint slows down as fast as the limits allow.
    pub fn brake(&mut self, side: Side) {
        if let Some(motion) = self.braked(side) {
            self.arms[side.index()].motion = Some(Started {
                motion,
                at: self.measurement.time,
                slower: 0.0,
            });
        }
    }

    /// What is left of a motion that is called off now.
    pub(super) fn braked(&self, side: Side) -> Option<Motion> {
        let started = self.arms[side.index()].motion.as_ref()?;
        let since = self.measurement.time - started.at;
        Some(started.motion.braked(since, &self.limits(side)))
    }

    /// Ends a motion where it is. For those slow enough to stop at once.
    pub fn halt(&mut self, side: Side) {
        self.arms[side.index()].motion = None;
    }

    /// Follows a straight line to its end and waits until the axes have arrived.
    ///
    /// # Errors
    ///
    /// A fault, [`Outcome::Refused`], or [`Outcome::NotArrived`].
    pub fn line(&mut self, side: Side, to: Point<Macro>, speed: Option<f64>) -> Result<(), Halt> {
        self.start_line(side, to, speed)?;
        while self.moving(side) {
            self.cycle()?;
        }
        self.settle(side)?;
        Ok(())
    }

    fn settle(&mut self, side: Side) -> Result<(), Halt> {
        let mut arrival = Arrival::default();
        loop {
            self.cycle()?;
            if arrival.step(self, side) {
                return Ok(self.arrived(side)?);
            }
        }
    }

    /// Whether the axes of a side are where friction may hold them from their references, or at them.
    pub(super) fn arrived(&self, side: Side) -> Result<(), Outcome> {
        for axis in Axis::ALL {
            let at = AxisName { side, axis };
            let counts = self.following_error(at).abs();
            if counts > LOST_COUNTS {
                return Err(Outcome::NotArrived { axis: at, counts });
            }
        }
        Ok(())
    }

    /// How far an axis is from its reference, encoder counts.
    pub(super) fn following_error(&self, at: AxisName) -> i64 {
        let reference = self.arms[at.side.index()].references[at.axis.index()];
        reference.0 - self.encoder(at).0
    }
}
