//! The motor axes of a machine, all stepped together, under the laws of load friction that its rig
//! has chosen.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::TwinError;
use super::joints::Joints;
use super::plant::Plant;
use super::sensors::encode;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, SIDES};
use pigtail_hal::{Axis, Pulse, Spec};
use pigtail_model::each::held;
use pigtail_model::joint::JointParameters;
use std::f64::consts::TAU;

/// Steps a cycle with which a scanning five-bar joint errs by less than 1e-4 um (and by 5e-4 um after
/// a jolt of the full voltage); a z-stage needs one.
const STEPS: [f64; 2] = [2.0, 1.0];

/// All motor axes. An axis is homed with its preload on: the transmission carries it, so that
/// friction is at rest, and the encoder is zero there.
#[derive(Debug, Clone)]
pub(super) struct Drives {
    /// Left a and b, right a and b.
    five_bars: Joints<4>,
    /// Left, right.
    z_stages: Joints<2>,
    /// Motor angle at which each encoder was set to zero, radians.
    homes: [[f64; AXES]; SIDES],
    counts_per_radian: [f64; AXES],
    /// Amplitude of the encoders' error of interpolation (radians), and the lines in a radian; of each axis.
    interpolation: Option<[(f64, f64); AXES]>,
    /// What each amplifier can give, volts.
    limits: [[f64; AXES]; SIDES],
    /// How far outputs have stayed behind their motors, radians, and how much farther they will.
    slips: Option<[[(f64, f64); AXES]; SIDES]>,
}

impl Drives {
    /// The axes of a machine whose joints are these, left and right. `seed` is that of what happens
    /// to them at rest.
    pub(super) fn new(
        plant: &Plant,
        spec: &Spec,
        joints: &[[JointParameters; AXES]; SIDES],
        seed: u64,
    ) -> Result<Self, TwinError> {
        let [[la, lb, lz], [ra, rb, rz]] = *joints;
        let period = spec.period();
        let home = |p: &JointParameters| p.transmission.twist(-p.load_torque) / p.ratio;
        let (five_bar, z) = (&plant.five_bar.joint, &plant.z_stage.joint);
        Ok(Self {
            five_bars: Joints::new(
                five_bar,
                [la, lb, ra, rb],
                "of a five-bar",
                (period, STEPS[0]),
                seed,
            )?,
            z_stages: Joints::new(
                z,
                [lz, rz],
                "of a z-stage",
                (period, STEPS[1]),
                seed.wrapping_add(1),
            )?,
            homes: joints.map(|side| side.map(|p| home(&p))),
            counts_per_radian: Axis::ALL.map(|axis| 1.0 / spec.drive(axis).count()),
            interpolation: (plant.electronics.interpolation > 0.0).then(|| {
                let e = &plant.electronics;
                Axis::ALL.map(|axis| {
                    let count = spec.drive(axis).count();
                    (e.interpolation * count, TAU / (e.counts_per_line * count))
                })
            }),
            limits: [Axis::ALL.map(|axis| spec.drive(axis).voltage); SIDES],
            slips: None,
        })
    }

    /// One cycle under held voltages, pulses that begin, and torques on the loads from outside
    /// (N m). Angles of the outputs then, as [`Self::outputs`] says.
    #[inline(always)]
    pub(super) fn advance(
        &mut self,
        voltages: &[[Volts; AXES]; SIDES],
        pulses: &[[Option<Pulse>; AXES]; SIDES],
        torques: &[[f64; AXES]; SIDES],
    ) -> [[f64; AXES]; SIDES] {
        let before = self.slips.map(|_| self.outputs());
        let volts = |side: usize, axis: usize| {
            let (limit, Volts(volts)) = (self.limits[side][axis], voltages[side][axis]);
            held(volts, -limit, limit)
        };
        let (left, right) = (volts(0, 2), volts(1, 2));
        let [la, lb, ra, rb] = self.five_bars.advance(
            [volts(0, 0), volts(0, 1), volts(1, 0), volts(1, 1)],
            [torques[0][0], torques[0][1], torques[1][0], torques[1][1]],
            [&pulses[0][0], &pulses[0][1], &pulses[1][0], &pulses[1][1]],
        );
        let [lz, rz] = self.z_stages.advance(
            [left, right],
            [torques[0][2], torques[1][2]],
            [&pulses[0][2], &pulses[1][2]],
        );
        if let Some(before) = before {
            self.slip_on(&before);
        }
        self.behind([[la, lb, lz], [ra, rb, rz]])
    }

    /// What was to slip does so where its axis moves.
    #[cold]
    fn slip_on(&mut self, before: &[[f64; AXES]; SIDES]) {
        let now = self.outputs();
        let Some(slips) = &mut self.slips else { return };
        for (side, slips) in slips.iter_mut().enumerate() {
            for (axis, (behind, left)) in slips.iter_mut().enumerate() {
                let way = now[side][axis] - before[side][axis];
                // It goes on slipping in the direction in which it began.
                if *left > 0.0 && way * *behind >= 0.0 {
                    let part = way.clamp(-*left, *left);
                    *behind += part;
                    *left -= part.abs();
                }
            }
        }
    }

    /// An output will stay behind its motor by so much, radians.
    pub(super) fn slip(&mut self, side: usize, axis: usize, by: f64) {
        let slips = self.slips.get_or_insert([[(0.0, 0.0); AXES]; SIDES]);
        slips[side][axis].1 += by.abs();
    }

    /// An amplifier gives no more than this share of what it gave.
    pub(super) fn weaken(&mut self, side: usize, axis: usize, share: f64) {
        self.limits[side][axis] *= share;
    }

    /// All friction of a joint becomes so many times what it was.
    pub(super) fn scale_friction(&mut self, side: usize, axis: usize, by: f64) {
        match axis {
            2 => self.z_stages.stiffen(side, by),
            _ => self.five_bars.stiffen(2 * side + axis, by),
        }
    }

    /// Angles of the manipulators' outputs, (2.12), radians.
    pub(super) fn outputs(&self) -> [[f64; AXES]; SIDES] {
        let [la, lb, ra, rb] = self.five_bars.outputs();
        let [lz, rz] = self.z_stages.outputs();
        self.behind([[la, lb, lz], [ra, rb, rz]])
    }

    /// The same of outputs that have not slipped.
    #[inline]
    fn behind(&self, mut outputs: [[f64; AXES]; SIDES]) -> [[f64; AXES]; SIDES] {
        if let Some(slips) = &self.slips {
            for (outputs, slips) in outputs.iter_mut().zip(slips) {
                for (output, (behind, _)) in outputs.iter_mut().zip(slips) {
                    *output -= behind;
                }
            }
        }
        outputs
    }

    /// Angles of a manipulator's motors, radians.
    pub(super) fn motors(&self, side: usize) -> [f64; AXES] {
        [
            self.five_bars.motor_angle(2 * side),
            self.five_bars.motor_angle(2 * side + 1),
            self.z_stages.motor_angle(side),
        ]
    }

    /// What the manipulators' encoders read.
    #[inline(always)]
    pub(super) fn encoders(&self) -> [[Counts; AXES]; SIDES] {
        let [la, lb, ra, rb] = self.five_bars.motor_angles();
        let [lz, rz] = self.z_stages.motor_angles();
        let angles = [[la, lb, lz], [ra, rb, rz]];
        let mut counts = [[Counts(0); AXES]; SIDES];
        for (side, counts) in counts.iter_mut().enumerate() {
            for (i, counts) in counts.iter_mut().enumerate() {
                let mut angle = angles[side][i] - self.homes[side][i];
                if let Some(interpolation) = &self.interpolation {
                    let (amplitude, lines) = interpolation[i];
                    angle += amplitude * (lines * angle).sin();
                }
                *counts = encode(angle, self.counts_per_radian[i]);
            }
        }
        counts
    }
}
