//! Several joints stepped side by side.
//!
//! While no mode changes, a step of one joint is a chain of a few dozen operations each of which
//! waits for the one before. Joints do not wait for each other: point by point over all of them,
//! a processor does two or more at once. A joint in whose step a mode may change is taken out and
//! its step finished by itself, as [`Joint::advance`] does it; of many joints those are finished side by side
//! (`pool.rs`, `events.rs`).
//!
//! Which instructions there are is found out when the program runs. All of them add and multiply alike and in a [`Group`] none
//! is fused: the same joints go the same way, to the last bit, on two lanes and on eight. A [`Batch`](crate::batch::Batch) fuses
//! where it can, as what waits for a product and a sum waits for one operation then.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

mod events;
mod lanes;
mod pool;

use crate::each::{Each, Way};
use crate::friction::Mode;
use crate::instructions::Instructions;
use crate::joint::{Joint, JointState};
use lanes::{Ends, Lanes};
pub(crate) use pool::{Block, LANES, Pools};
use pulp::{Simd, WithSimd};

/// `N` joints that are stepped together.
#[derive(Debug, Clone, PartialEq)]
pub struct Group<const N: usize> {
    joints: [Joint; N],
    lanes: Lanes<N>,
    /// In a cycle.
    steps: usize,
}

/// The [`JointState`]s of a group.
#[derive(Debug, Clone, PartialEq)]
#[repr(align(64))]
pub struct States<const N: usize> {
    motor: Moving<N>,
    load: Moving<N>,
    load_torque: Each<N>,
}

/// Angles, velocities and modes (as signs) of one body of each joint.
#[derive(Debug, Clone, PartialEq)]
struct Moving<const N: usize> {
    angle: Each<N>,
    velocity: Each<N>,
    sign: Each<N>,
}

impl<const N: usize> States<N> {
    /// Of these joints.
    pub fn new(states: [JointState; N]) -> Self {
        let of = |value: fn(&JointState) -> f64| Each::of(|i| value(&states[i]));
        Self {
            motor: Moving {
                angle: of(|s| s.motor_angle),
                velocity: of(|s| s.motor_velocity),
                sign: of(|s| s.motor_mode.sign()),
            },
            load: Moving {
                angle: of(|s| s.load_angle),
                velocity: of(|s| s.load_velocity),
                sign: of(|s| s.load_mode.sign()),
            },
            load_torque: of(|s| s.load_torque),
        }
    }

    /// That of one joint.
    #[inline]
    pub fn get(&self, i: usize) -> JointState {
        JointState {
            motor_angle: self.motor.angle[i],
            load_angle: self.load.angle[i],
            motor_velocity: self.motor.velocity[i],
            load_velocity: self.load.velocity[i],
            motor_mode: Mode::towards(self.motor.sign[i]),
            load_mode: Mode::towards(self.load.sign[i]),
            load_torque: self.load_torque[i],
            presliding: (),
        }
    }

    /// Sets that of one joint.
    #[inline]
    pub fn set(&mut self, i: usize, state: &JointState) {
        self.motor.angle[i] = state.motor_angle;
        self.motor.velocity[i] = state.motor_velocity;
        self.motor.sign[i] = state.motor_mode.sign();
        self.load.angle[i] = state.load_angle;
        self.load.velocity[i] = state.load_velocity;
        self.load.sign[i] = state.load_mode.sign();
        self.load_torque[i] = state.load_torque;
    }

    /// Angle of a motor, radians.
    #[inline]
    pub fn motor_angle(&self, i: usize) -> f64 {
        self.motor.angle[i]
    }

    /// Angles of all motors, radians.
    #[inline]
    pub fn motor_angles(&self) -> [f64; N] {
        self.motor.angle.0
    }

    /// Velocity of a motor, rad/s.
    #[inline]
    pub fn motor_velocity(&self, i: usize) -> f64 {
        self.motor.velocity[i]
    }

    #[inline(always)]
    fn go_to(&mut self, ends: &Ends<N>) {
        (self.motor.angle, self.motor.velocity) = ends.motor;
        (self.load.angle, self.load.velocity) = ends.load;
    }

    /// Sets the torques on the loads from outside beside the constant ones, N m.
    #[inline]
    pub fn set_load_torques(&mut self, torques: [f64; N]) {
        // Most are none, from one cycle to the next: what is written number by number cannot be read as a vector at once.
        if self.load_torque.0 != torques {
            self.load_torque = Each(torques);
        }
    }
}

impl<const N: usize> Group<N> {
    /// A group of these joints, which is advanced by cycles of `cycle` seconds. All of them take as many
    /// steps as the one that needs most.
    pub fn new(joints: [Joint; N], cycle: f64) -> Self {
        let longest = |h: f64, joint: &Joint| h.min(joint.scheme().length);
        // A hair more than a whole number of steps is that number.
        let steps = (cycle / joints.iter().fold(cycle, longest) - 1e-9).ceil();
        let length = cycle / steps;
        Self {
            lanes: Lanes::new(&joints, length),
            steps: steps as usize,
            joints,
        }
    }

    /// The joints.
    pub fn joints(&self) -> &[Joint; N] {
        &self.joints
    }

    /// Advances all states by a cycle, each under a held voltage.
    #[inline]
    pub fn advance(&self, states: &mut States<N>, voltages: [f64; N]) {
        self.advance_by(Instructions::widest(), states, voltages);
    }

    /// The same by instructions of one's choice, to the same bits.
    #[inline]
    pub fn advance_by(
        &self,
        instructions: Instructions,
        states: &mut States<N>,
        voltages: [f64; N],
    ) {
        instructions.run(Cycle {
            group: self,
            states,
            voltages: Each(voltages),
        });
    }

    /// The same; where the outputs are then, as [`Self::outputs`] says.
    #[inline]
    pub fn advance_outputs(
        &self,
        instructions: Instructions,
        states: &mut States<N>,
        voltages: [f64; N],
    ) -> [f64; N] {
        instructions.run(ToOutputs(Cycle {
            group: self,
            states,
            voltages: Each(voltages),
        }))
    }

    /// Positions of the outputs (2.12), radians: [`Joint::output`] of each.
    #[inline(always)]
    pub fn outputs(&self, states: &States<N>) -> [f64; N] {
        self.lanes.outputs::<General>(states)
    }

    #[inline(always)]
    fn step<W: Way>(&self, s: &mut States<N>, voltages: &Each<N>) {
        let input = self.lanes.input(s, *voltages);
        let Some(mut ends) = self.lanes.step::<W>(s, &input) else {
            return;
        };
        if ends.margin.any_negative() {
            self.finish(s, voltages, &mut ends);
        }
        s.go_to(&ends);
    }

    /// Finishes the steps in which a mode may change, joint by joint.
    #[inline(never)]
    fn finish(&self, s: &mut States<N>, voltages: &Each<N>, ends: &mut Ends<N>) {
        for (i, joint) in self.joints.iter().enumerate() {
            if ends.margin[i] < 0.0 {
                let state = ends.finish(i, s.get(i), joint, voltages[i], self.lanes.length[i]);
                (ends.motor.0[i], ends.motor.1[i]) = (state.motor_angle, state.motor_velocity);
                (ends.load.0[i], ends.load.1[i]) = (state.load_angle, state.load_velocity);
                s.motor.sign[i] = state.motor_mode.sign();
                s.load.sign[i] = state.load_mode.sign();
            }
        }
    }
}

/// Any transmissions, to the same bits on every machine.
struct General;

impl Way for General {
    const FUSED: bool = false;
    const HARDENS: bool = true;
    const BENDS: bool = true;
}

/// A cycle of a group.
struct Cycle<'a, const N: usize> {
    group: &'a Group<N>,
    states: &'a mut States<N>,
    voltages: Each<N>,
}

impl<const N: usize> WithSimd for Cycle<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for _ in 0..self.group.steps {
            self.group.step::<General>(self.states, &self.voltages);
        }
    }
}

/// The same, and where it brings the outputs.
struct ToOutputs<'a, const N: usize>(Cycle<'a, N>);

impl<const N: usize> WithSimd for ToOutputs<'_, N> {
    type Output = [f64; N];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f64; N] {
        let Cycle {
            group,
            states,
            voltages,
        } = self.0;
        let cycle = Cycle {
            group,
            states: &mut *states,
            voltages,
        };
        cycle.with_simd(simd);
        group.outputs(states)
    }
}
