//! Single axes and piezos, driven and asked past every motion: what experiments do, and what only a machine driven by volts can.

use super::Station;
use crate::compensation::online::Told;
use crate::impulse::belief::ImpulseBelief;
use crate::outcome::Outcome;
use crate::servo::{Pid, PidState};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::MICRO_AXES;
use pigtail_hal::{AxisName, Pulse, Side};
use pigtail_model::frames::{Displacement, Macro, Point};
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

    /// Gives an axis back to its servo, whose state starts afresh, to hold it where its encoder is.
    pub fn close_loop(&mut self, at: AxisName) {
        let here = self.encoder(at);
        self.reference(at, here);
        let arm = &mut self.arms[at.side.index()];
        arm.held[at.axis.index()] = None;
        arm.states[at.axis.index()] = PidState::default();
    }

    /// Has the amplifier of an axis play a pulse from the start of the next cycle on.
    ///
    /// # Errors
    ///
    /// Why the amplifier cannot, by the datasheet; nothing is played then.
    pub fn pulse(&mut self, at: AxisName, pulse: Pulse) -> Result<(), Outcome> {
        pulse
            .check(self.spec().drive(at.axis))
            .map_err(|why| Outcome::Unplayable { at, why })?;
        self.command.pulses[at.side.index()][at.axis.index()] = Some(pulse);
        Ok(())
    }

    /// What is believed of pulses on a five-bar; `None` where no one has measured it.
    pub fn five_bar_pulses(&self) -> Option<ImpulseBelief> {
        self.five_bar_pulses.clone()
    }

    /// What the transmission of an axis holds back at this moment, by what is believed of it, radians
    /// of the output.
    pub fn windup(&self, at: AxisName) -> f64 {
        self.arms[at.side.index()].windup[at.axis.index()]
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

    /// Where the probes at the outputs see an endpoint; `None` on a rig without probes.
    pub fn probed_endpoint(&self, side: Side) -> Option<Point<Macro>> {
        let arm = self.spec().probe.as_ref()?.arm;
        let [a, b, z] = self.measurement.probes?[side.index()];
        self.arms[side.index()]
            .kinematics
            .endpoint_from_probes([a / arm, b / arm], z)
            .ok()
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

    /// Believes from now on that the piezos of a side make so much displacement in y for one in x.
    pub fn set_micro_ratio(&mut self, side: Side, ratio: f64) {
        if let Some(piezos) = &mut self.arms[side.index()].piezos {
            piezos.set_ratio(ratio);
        }
    }

    /// The displacement in y for one in x of a side's micro, as believed; `None` without a model.
    pub fn micro_ratio(&self, side: Side) -> Option<f64> {
        let piezos = self.arms[side.index()].piezos.as_ref()?;
        Some(piezos.ratio())
    }

    /// Learns what was seen of the piezos of a side, and makes use of it within so many seconds where that is worth it. The tip does
    /// not leave its place `at` by that (metres from its centre). Whether it does.
    pub fn learn_micro(&mut self, side: Side, told: &Told, at: Displacement, within: f64) -> bool {
        let cycles = (within * self.spec().servo.rate).round() as u32;
        self.arms[side.index()].learn(told, at, cycles)
    }

    /// How many times as far as is believed each piezo of a side goes, where that was learned and is made use of.
    pub fn learned_strokes(&self, side: Side) -> Option<[f64; MICRO_AXES]> {
        self.arms[side.index()].online.used()
    }

    /// The displacement commanded to a micro, metres.
    pub fn micro(&self, side: Side) -> Displacement {
        self.arms[side.index()].micro
    }
}
