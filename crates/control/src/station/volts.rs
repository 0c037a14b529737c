//! What only a machine that is driven by volts can do.

use super::Station;
use crate::compensation::online::Told;
use crate::impulse::belief::ImpulseBelief;
use crate::kinematics::Kinematics;
use crate::outcome::Outcome;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_hal::{Axis, AxisName, Pulse, Side};
use pigtail_model::frames::{Displacement, Macro, Point};

/// What only a machine that is driven by volts can do, beside what every bench can.
pub trait VoltageMachine {
    /// The displacement in y for one in x of a side's micro, as believed; `None` without a model.
    fn micro_ratio(&self, side: Side) -> Option<f64>;
    /// Believes from now on that the piezos of a side make so much displacement in y for one in x.
    fn set_micro_ratio(&mut self, side: Side, ratio: f64);
    /// Learns what was seen of the piezos of a side, and makes use of it within so many seconds where that is worth it. The tip does
    /// not leave its place `at` by that (metres from its centre). Whether it does.
    fn learn_micro(&mut self, side: Side, told: &Told, at: Displacement, within: f64) -> bool;
    /// How many times as far as is believed each piezo of a side goes, where that was learned and is made use of.
    fn learned_strokes(&self, side: Side) -> Option<[f64; MICRO_AXES]>;
    /// Where the probes at the outputs see an endpoint; `None` on a rig without probes.
    fn probed_endpoint(&self, side: Side) -> Option<Point<Macro>>;
    /// The believed kinematics of a manipulator.
    fn kinematics(&self, side: Side) -> &Kinematics;
    /// What is believed of pulses on a five-bar; `None` where no one has measured it.
    fn five_bar_pulses(&self) -> Option<ImpulseBelief>;
    /// Axes that have swung at rest under their gains, and how many times as large as the calibration says these are since.
    fn gentler_gains(&self) -> Vec<(AxisName, f64)>;
    /// What the transmission of an axis holds back at this moment, by what is believed of it, radians of the output.
    fn windup(&self, at: AxisName) -> f64;
    /// Takes an axis from its servo and holds this voltage on its motor, until it is given back.
    fn hold_voltage(&mut self, at: AxisName, volts: Volts);
    /// Gives an axis back to its servo, whose state starts afresh, to hold it where its encoder is.
    fn close_loop(&mut self, at: AxisName);
    /// Has the amplifier of an axis play a pulse from the start of the next cycle on.
    ///
    /// # Errors
    ///
    /// Why the amplifier cannot, by the datasheet; nothing is played then.
    fn pulse(&mut self, at: AxisName, pulse: Pulse) -> Result<(), Outcome>;
}

impl VoltageMachine for Station<'_> {
    fn micro_ratio(&self, side: Side) -> Option<f64> {
        let piezos = self.arms[side.index()].piezos.as_ref()?;
        Some(piezos.ratio())
    }

    fn set_micro_ratio(&mut self, side: Side, ratio: f64) {
        if let Some(piezos) = &mut self.arms[side.index()].piezos {
            piezos.set_ratio(ratio);
        }
    }

    fn learn_micro(&mut self, side: Side, told: &Told, at: Displacement, within: f64) -> bool {
        let cycles = (within * self.spec().servo.rate).round() as u32;
        self.arms[side.index()].learn(told, at, cycles)
    }

    fn learned_strokes(&self, side: Side) -> Option<[f64; MICRO_AXES]> {
        self.arms[side.index()].online.used()
    }

    fn probed_endpoint(&self, side: Side) -> Option<Point<Macro>> {
        let arm = self.spec().probe.as_ref()?.arm;
        let [a, b, z] = self.measurement.probes?[side.index()];
        self.arms[side.index()]
            .kinematics
            .endpoint_from_probes([a / arm, b / arm], z)
            .ok()
    }

    fn kinematics(&self, side: Side) -> &Kinematics {
        Station::kinematics(self, side)
    }

    fn five_bar_pulses(&self) -> Option<ImpulseBelief> {
        self.five_bar_pulses.clone()
    }

    fn gentler_gains(&self) -> Vec<(AxisName, f64)> {
        let axes = Side::ALL
            .into_iter()
            .flat_map(|side| Axis::ALL.map(|axis| AxisName::new(side, axis)));
        axes.map(|at| {
            (
                at,
                self.arms[at.side.index()].states[at.axis.index()].share(),
            )
        })
        .filter(|(_, share)| *share < 1.0)
        .collect()
    }

    fn windup(&self, at: AxisName) -> f64 {
        self.arms[at.side.index()].windup[at.axis.index()]
    }

    fn hold_voltage(&mut self, at: AxisName, volts: Volts) {
        Station::hold_voltage(self, at, volts);
    }

    fn close_loop(&mut self, at: AxisName) {
        let here = self.encoder(at);
        self.reference(at, here);
        let arm = &mut self.arms[at.side.index()];
        arm.held[at.axis.index()] = None;
        let state = &mut arm.states[at.axis.index()];
        *state = state.afresh();
    }

    fn pulse(&mut self, at: AxisName, pulse: Pulse) -> Result<(), Outcome> {
        pulse
            .check(self.spec().drive(at.axis))
            .map_err(|why| Outcome::Unplayable { at, why })?;
        self.command.pulses[at.side.index()][at.axis.index()] = Some(pulse);
        Ok(())
    }
}
