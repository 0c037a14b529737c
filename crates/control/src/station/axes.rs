//! Single axes and piezos, driven and asked past every motion: what experiments do.

use super::Station;
use crate::servo::{Pid, PidState};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::MICRO_AXES;
use pigtail_hal::{AxisName, Side};
use pigtail_model::frames::Displacement;
use pigtail_model::windup::{Windup, WindupState};

impl Station<'_> {
    /// Sets the reference of one axis alone, encoder counts from home. Ends any motion of that
    /// manipulator.
    pub fn reference(&mut self, at: AxisName, counts: Counts) {
        let arm = &mut self.arms[at.side.index()];
        arm.motion = None;
        arm.references[at.axis.index()] = counts;
    }

    /// Gives one axis another controller. Its state starts afresh.
    pub fn set_pid(&mut self, at: AxisName, pid: Pid) {
        let arm = &mut self.arms[at.side.index()];
        arm.pids[at.axis.index()] = pid;
        arm.states[at.axis.index()] = PidState::default();
    }

    /// Compensates the windup of one axis by this model from now on. Its state starts afresh.
    pub fn set_windup(&mut self, at: AxisName, windup: Windup) {
        let arm = &mut self.arms[at.side.index()];
        arm.windups[at.axis.index()] = windup;
        arm.windup_states[at.axis.index()] = WindupState::default();
        arm.windup[at.axis.index()] = 0.0;
    }

    /// Takes an axis from its servo and holds this voltage on its motor, from the next cycle on until
    /// it is given back.
    pub fn hold_voltage(&mut self, at: AxisName, volts: Volts) {
        self.arms[at.side.index()].held[at.axis.index()] = Some(volts);
    }

    /// The encoder of an axis.
    pub fn encoder(&self, at: AxisName) -> Counts {
        self.measurement.encoders[at.side.index()][at.axis.index()]
    }

    /// The voltage that an axis was given in this cycle, volts.
    pub fn voltage(&self, at: AxisName) -> f64 {
        self.command.motors[at.side.index()][at.axis.index()].0
    }

    /// The probe at the output of an axis, metres from home; `None` on a rig without probes.
    pub fn probe(&self, at: AxisName) -> Option<f64> {
        self.measurement
            .probes
            .map(|probes| probes[at.side.index()][at.axis.index()])
    }

    /// Displaces a tip so far in its manipulator's frame with the micro, held within its range.
    pub fn move_micro(&mut self, side: Side, to: Displacement) {
        self.playing.fine[side.index()] = None;
        let arm = &mut self.arms[side.index()];
        arm.micro = to;
        arm.micro_volts = None;
    }

    /// Gives the piezos of a micro these voltages, past every model, until it is moved again.
    pub fn micro_volts(&mut self, side: Side, volts: [Volts; MICRO_AXES]) {
        self.arms[side.index()].micro_volts = Some(volts);
    }

    /// The displacement commanded to a micro, metres.
    pub fn micro(&self, side: Side) -> Displacement {
        self.arms[side.index()].micro
    }
}
