//! Several joints stepped side by side.
//!
//! While no mode changes, a step of one joint is a chain of a few dozen operations each of which
//! waits for the one before. Joints do not wait for each other: point by point over all of them,
//! a processor does two or more at once. A joint in whose step a mode may change is taken out and
//! its step finished by itself, as [`Joint::advance`] does it.
//!
//! Which instructions there are is found out when the program runs. All of them add and multiply alike and none
//! is fused: the same joints go the same way, to the last bit, on two lanes and on eight.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use crate::each::Each;
use crate::friction::{Friction, Mode};
use crate::instructions::Instructions;
use crate::joint::{Joint, JointState, SLOWS};
use crate::nystrom::{self, POINTS, Row};
use pulp::{Simd, WithSimd};

/// `N` joints that are stepped together.
#[derive(Debug, Clone, PartialEq)]
pub struct Group<const N: usize> {
    joints: [Joint; N],
    ratio: Each<N>,
    gain: Each<N>,
    linear: Each<N>,
    cubic: Each<N>,
    bend: Each<N>,
    unbend: Each<N>,
    stiffest: Each<N>,
    load_torque: Each<N>,
    /// Stiffness of the contacts, N m/rad.
    contact: Each<N>,
    motor: Bodies<N>,
    load: Bodies<N>,
    /// In a cycle.
    steps: usize,
    /// Of a step, seconds.
    length: f64,
}

/// One body of each joint.
#[derive(Debug, Clone, PartialEq)]
struct Bodies<const N: usize> {
    inverse_inertia: Each<N>,
    decay: Each<N>,
    coulomb: Each<N>,
    viscous: Each<N>,
    /// Static friction, and infinitely much of it for a body that nothing holds: it has no modes.
    level: Each<N>,
    /// One for a body that nothing holds.
    free: Each<N>,
    points: [Rows<N>; POINTS - 1],
    end: Rows<N>,
}

/// A [`Row`] of each joint.
#[derive(Debug, Clone, PartialEq)]
struct Rows<const N: usize> {
    keep: Each<N>,
    drift: Each<N>,
    velocity: [Each<N>; POINTS],
    angle: [Each<N>; POINTS],
    /// Velocity and way by an acceleration that is the same at all points.
    all_velocity: Each<N>,
    all: Each<N>,
}

/// The [`JointState`]s of a group.
#[derive(Debug, Clone, PartialEq)]
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

    /// Sets the torques on the loads from outside beside the constant ones, N m.
    #[inline]
    pub fn set_load_torques(&mut self, torques: [f64; N]) {
        self.load_torque = Each(torques);
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
        let of = |value: fn(&Joint) -> f64| Each::of(|i| value(&joints[i]));
        let bodies = |friction: fn(&Joint) -> Friction,
                      inertia: fn(&Joint) -> f64,
                      decay: fn(&Joint) -> f64| {
            let decays: Each<N> = of(decay);
            let weights = decays.0.map(|decay| nystrom::Weights::new(decay, length));
            let of_friction = |value: fn(Friction) -> f64| -> Each<N> {
                Each::of(|i| value(friction(&joints[i])))
            };
            Bodies {
                inverse_inertia: Each::of(|i| 1.0 / inertia(&joints[i])),
                decay: decays,
                coulomb: of_friction(|f| f.coulomb()),
                viscous: of_friction(|f| f.viscous()),
                level: of_friction(|f| {
                    if f.is_free() {
                        f64::INFINITY
                    } else {
                        f.static_level()
                    }
                }),
                free: of_friction(|f| f64::from(u8::from(f.is_free()))),
                points: std::array::from_fn(|k| Rows::new(|i| weights[i].points[k])),
                end: Rows::new(|i| weights[i].end),
            }
        };
        Self {
            ratio: of(|j| j.parameters().ratio),
            gain: of(|j| j.parameters().motor.gain()),
            linear: of(|j| j.parameters().transmission.linear()),
            cubic: of(|j| j.parameters().transmission.cubic()),
            bend: of(|j| j.parameters().transmission.bend()),
            unbend: of(|j| -j.parameters().transmission.bend()),
            stiffest: of(|j| j.parameters().transmission.stiffest()),
            load_torque: of(|j| j.parameters().load_torque),
            contact: of(Joint::contact),
            motor: bodies(
                |j| j.parameters().motor_friction,
                |j| j.parameters().motor_inertia,
                Joint::motor_decay,
            ),
            load: bodies(
                |j| j.parameters().load_friction,
                |j| j.parameters().load_inertia,
                Joint::load_decay,
            ),
            steps: steps as usize,
            length,
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
    pub fn outputs(&self, s: &States<N>) -> [f64; N] {
        let twist = self.ratio * s.motor.angle - s.load.angle;
        let psi = self.torque(twist) + self.load_torque + s.load_torque;
        let slides = -s.load.sign * self.load.coulomb - self.load.viscous * s.load.velocity;
        let stuck = |i: usize| s.load.sign[i] == 0.0 && self.load.free[i] == 0.0;
        let friction = (-psi).select(slides, stuck);
        (s.load.angle - friction / self.contact).0
    }

    #[inline(always)]
    fn step(&self, s: &mut States<N>, voltages: &Each<N>) {
        let drive = self.gain * *voltages;
        let outside = self.load_torque + s.load_torque;
        let twist = self.ratio * s.motor.angle - s.load.angle;
        let torque = self.torque(twist);
        let holds = self.holds(s, drive, outside, torque);
        if holds.any_negative() {
            self.resolve(s, voltages, &holds);
        }
        let motor = self.motor.accelerations(&s.motor, drive, -self.ratio);
        let load = self.load.accelerations(&s.load, outside, Each([1.0; N]));
        if motor.by.all_zero() && load.by.all_zero() {
            return;
        }
        // From one torque to the next is the chain that everything else waits for: what does not belong
        // to it is kept out of it.
        let mut torques = [torque; POINTS];
        for point in 1..POINTS {
            let (m, l) = (&self.motor.points[point - 1], &self.load.points[point - 1]);
            let qm = m.drift * s.motor.velocity + m.all * motor.alone;
            let ql = l.drift * s.load.velocity + l.all * load.alone;
            let mut w = twist + (self.ratio * qm - ql);
            let by_motor = self.ratio * motor.by;
            for (j, torque) in torques[..point].iter().enumerate() {
                w = w + (m.angle[j] * by_motor - l.angle[j] * load.by) * *torque;
            }
            torques[point] = self.torque(w);
        }
        let (mut qm, mut vm) = self.motor.end(&s.motor, &motor, &torques);
        let (mut ql, mut vl) = self.load.end(&s.load, &load, &torques);
        let at_end = self.torque(self.ratio * qm - ql);
        let margin = self
            .holds(s, drive, outside, at_end)
            .min(
                self.motor
                    .slides(&s.motor, vm, &motor, &torques, self.length),
            )
            .min(self.load.slides(&s.load, vl, &load, &torques, self.length));
        if margin.any_negative() {
            let ends = Ends {
                margin,
                torques,
                accelerations: (motor, load),
                motor: (qm, vm),
                load: (ql, vl),
            };
            ((qm, vm), (ql, vl)) = self.finish(s, voltages, &ends);
        }
        (s.motor.angle, s.motor.velocity) = (qm, vm);
        (s.load.angle, s.load.velocity) = (ql, vl);
    }

    /// Decides anew what happens to bodies at rest that nothing holds any more.
    #[inline(never)]
    fn resolve(&self, s: &mut States<N>, voltages: &Each<N>, holds: &Each<N>) {
        for (i, joint) in self.joints.iter().enumerate() {
            if holds[i] < 0.0 {
                let mut state = s.get(i);
                joint.resolve(&mut state, voltages[i]);
                s.set(i, &state);
            }
        }
    }

    /// Finishes the steps in which a mode may change, joint by joint.
    #[inline(never)]
    fn finish(
        &self,
        s: &mut States<N>,
        voltages: &Each<N>,
        ends: &Ends<N>,
    ) -> (Angles<N>, Angles<N>) {
        let (motor, load) = &ends.accelerations;
        let ((mut qm, mut vm), (mut ql, mut vl)) = (ends.motor, ends.load);
        for i in 0..N {
            if ends.margin[i] < 0.0 {
                let mut state = s.get(i);
                let end = JointState {
                    motor_angle: qm[i],
                    load_angle: ql[i],
                    motor_velocity: vm[i],
                    load_velocity: vl[i],
                    ..state
                };
                let torques = ends.torques.map(|torque| torque[i]);
                let accelerations = (motor.of(i, torques), load.of(i, torques));
                let to = (end, self.length);
                self.joints[i].finish(&mut state, voltages[i], accelerations, to);
                (qm[i], vm[i]) = (state.motor_angle, state.motor_velocity);
                (ql[i], vl[i]) = (state.load_angle, state.load_velocity);
                s.motor.sign[i] = state.motor_mode.sign();
                s.load.sign[i] = state.load_mode.sign();
            }
        }
        ((qm, vm), (ql, vl))
    }

    /// Torques of the transmissions, N m.
    #[inline(always)]
    fn torque(&self, twist: Each<N>) -> Each<N> {
        let hardening = twist.max(self.unbend).min(self.bend);
        hardening * (self.linear + self.cubic * hardening * hardening)
            + self.stiffest * (twist - hardening)
    }

    /// By how much static friction holds the stuck bodies, N m; negative where it does not.
    #[inline(always)]
    fn holds(&self, s: &States<N>, drive: Each<N>, outside: Each<N>, torque: Each<N>) -> Each<N> {
        let motor = self.motor.holds(&s.motor, drive - self.ratio * torque);
        motor.min(self.load.holds(&s.load, outside + torque))
    }
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
            self.group.step(self.states, &self.voltages);
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

/// Where a step leads to, as far as no mode changes.
struct Ends<const N: usize> {
    /// Negative where one may.
    margin: Each<N>,
    /// Of the transmissions at each point, N m.
    torques: [Each<N>; POINTS],
    accelerations: (Accelerations<N>, Accelerations<N>),
    motor: Angles<N>,
    load: Angles<N>,
}

/// Angles and velocities.
type Angles<const N: usize> = (Each<N>, Each<N>);

/// Accelerations of bodies beside their decay, rad/s^2: without the transmissions' torques, and by each
/// N m of them. Nothing moves a stuck one.
struct Accelerations<const N: usize> {
    alone: Each<N>,
    by: Each<N>,
}

impl<const N: usize> Accelerations<N> {
    /// That of one body at each point.
    fn of(&self, i: usize, torques: [f64; POINTS]) -> [f64; POINTS] {
        torques.map(|torque| self.alone[i] + self.by[i] * torque)
    }
}

/// So much more friction, N m, holds a body that slides: whether it would hold is not asked.
const SLIDES: f64 = 1e9;

impl<const N: usize> Bodies<N> {
    /// Under these torques on the bodies, and a transmission's torque times `ratio`.
    #[inline(always)]
    fn accelerations(&self, s: &Moving<N>, drive: Each<N>, ratio: Each<N>) -> Accelerations<N> {
        let by = (s.sign * s.sign).max(self.free) * self.inverse_inertia;
        Accelerations {
            alone: by * (drive - s.sign * self.coulomb),
            by: by * ratio,
        }
    }

    /// By how much static friction holds the stuck ones against these torques, N m.
    #[inline(always)]
    fn holds(&self, s: &Moving<N>, psi: Each<N>) -> Each<N> {
        self.level + SLIDES * (s.sign * s.sign) - psi.abs()
    }

    /// Angles and velocities at the end of a step.
    #[inline(always)]
    fn end(
        &self,
        s: &Moving<N>,
        a: &Accelerations<N>,
        torques: &[Each<N>; POINTS],
    ) -> (Each<N>, Each<N>) {
        let row = &self.end;
        let of = |weights: &[Each<N>; POINTS]| {
            (weights[0] * torques[0] + weights[1] * torques[1])
                + (weights[2] * torques[2] + weights[3] * torques[3])
        };
        let way = row.drift * s.velocity + row.all * a.alone + a.by * of(&row.angle);
        let gain = row.all_velocity * a.alone + a.by * of(&row.velocity);
        (s.angle + way, row.keep * s.velocity + gain)
    }

    /// Negative where one has come to rest in a step of `h` seconds to velocities `to`, or may have.
    #[inline(always)]
    fn slides(
        &self,
        s: &Moving<N>,
        to: Each<N>,
        a: &Accelerations<N>,
        torques: &[Each<N>; POINTS],
        h: f64,
    ) -> Each<N> {
        let speed = s.sign * s.velocity;
        let rate =
            |torque: Each<N>, v: Each<N>| s.sign * (a.alone + a.by * torque - self.decay * v);
        let (first, last) = (rate(torques[0], s.velocity), rate(torques[POINTS - 1], to));
        // As `may_dip`: only if all of these are negative.
        let dips = first.max(-last).max(speed + (SLOWS * h) * first);
        (s.sign * to).min(dips)
    }
}

impl<const N: usize> Rows<N> {
    fn new(row: impl Fn(usize) -> Row) -> Self {
        Self {
            keep: Each::of(|i| row(i).keep),
            drift: Each::of(|i| row(i).drift),
            velocity: std::array::from_fn(|j| Each::of(|i| row(i).velocity[j])),
            angle: std::array::from_fn(|j| Each::of(|i| row(i).angle[j])),
            all_velocity: Each::of(|i| row(i).velocity.iter().sum()),
            all: Each::of(|i| row(i).angle.iter().sum()),
        }
    }
}
