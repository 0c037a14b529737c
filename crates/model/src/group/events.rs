//! Mode changes of several joints, found and passed side by side.
//!
//! A joint by itself looks for whatever may happen in a step. Here is looked for what happens nearly always: one body comes
//! to rest or breaks away, once, at an instant that one step of Newton's method finds. A joint of which that is not true is
//! left to be finished by itself. The formulas are those of there, and what is worked out for a joint does not depend on who
//! lies beside it.

#![expect(
    clippy::inline_always,
    clippy::needless_bitwise_bool,
    reason = "what is not inlined does not get the instructions of its caller, and a short cut is a branch"
)]

use super::lanes::{Accelerations, Angles, Bodies, Course, Ends, Input, Lanes};
use super::{Moving, States};
use crate::each::Each;
use crate::integrate::LAST_STEP;
use crate::joint::BREAK_AWAY_DELAY;
use crate::nystrom::{LAGRANGE, POINTS, SERIES, SLOW};

/// How one body of each joint moves within a step: a [`Motion`](crate::nystrom::Motion) of each.
struct Motions<const N: usize> {
    velocity: Each<N>,
    decay: Each<N>,
    accelerations: [Each<N>; POINTS],
}

impl<const N: usize> Motions<N> {
    /// In steps of which so many make a second.
    #[inline(always)]
    fn new(
        body: &Bodies<N>,
        s: &Moving<N>,
        a: &Accelerations<N>,
        torques: &[Each<N>; POINTS],
        rate: Each<N>,
    ) -> Self {
        let mut accelerations = [Each([0.0; N]); POINTS];
        let mut scale = rate;
        for (k, sum) in accelerations.iter_mut().enumerate() {
            if k == 0 {
                // The first point is the start.
                *sum = a.at(torques[0]);
                continue;
            }
            for j in 0..POINTS {
                *sum = *sum + LAGRANGE[POINTS - 1][j][k] * a.at(torques[j]);
            }
            *sum = scale * *sum;
            scale = scale * ((k + 1) as f64 * rate);
        }
        Self {
            velocity: s.velocity,
            decay: body.decay,
            accelerations,
        }
    }

    /// Way since the start and velocity after `t` seconds, for decays of at most one over that time.
    #[inline(always)]
    fn after(&self, t: Each<N>) -> Angles<N> {
        let p = phi(-(self.decay * t));
        let [a, b, c, d] = self.accelerations;
        let t2 = t * t;
        let way = (p[2] * a + t * (p[3] * b)) + t2 * (p[4] * c + t * (p[5] * d));
        let velocity = (p[1] * a + t * (p[2] * b)) + t2 * (p[3] * c + t * (p[4] * d));
        (
            t * (p[1] * self.velocity + t * way),
            p[0] * self.velocity + t * velocity,
        )
    }

    /// Acceleration after `t` seconds, at the velocity then.
    #[inline(always)]
    fn acceleration(&self, t: Each<N>, velocity: Each<N>) -> Each<N> {
        let [a, b, c, d] = self.accelerations;
        a + t * (b + t * (0.5 * c + t * ((1.0 / 6.0) * d))) - self.decay * velocity
    }
}

/// `phi_0` to `phi_5` as [`nystrom`](crate::nystrom) has them, for `z` from -1 to 1.
#[inline(always)]
fn phi<const N: usize>(z: Each<N>) -> [Each<N>; 6] {
    let c = SERIES.map(|c| Each([c; N]));
    let z2 = z * z;
    let z4 = z2 * z2;
    let mut p5 = ((c[0] + c[1] * z) + z2 * (c[2] + c[3] * z))
        + z4 * ((c[4] + c[5] * z) + z2 * (c[6] + c[7] * z));
    let slow = Each([SLOW; N]) - z.abs();
    if slow.any_negative() {
        let more = ((c[8] + c[9] * z) + z2 * (c[10] + c[11] * z))
            + z4 * ((c[12] + c[13] * z) + z2 * (c[14] + c[15] * z));
        p5 = (p5 + z4 * z4 * more).select(p5, |i| slow[i] < 0.0);
    }
    let [one, half, sixth, part] = [1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0].map(|c| Each([c; N]));
    [
        (one + z) + z2 * ((half + z * sixth) + z2 * (part + z * p5)),
        (one + z * half) + z2 * ((sixth + z * part) + z2 * p5),
        (half + z * sixth) + z2 * (part + z * p5),
        (sixth + z * part) + z2 * p5,
        part + z * p5,
        p5,
    ]
}

/// The body of each joint of which the mode changes first: the motor where its mode has changed by the end of the step.
struct Chosen<const N: usize> {
    /// Negative where it is the motor.
    motor: Each<N>,
    /// Its mode before, as a sign.
    sign: Each<N>,
    level: Each<N>,
    motions: Motions<N>,
}

impl<const N: usize> Chosen<N> {
    /// Of the motor's and the load's.
    #[inline(always)]
    fn of(&self, motor: Each<N>, load: Each<N>) -> Each<N> {
        motor.select(load, |i| self.motor[i] < 0.0)
    }

    /// Their modes under these torques once they are at rest: one that was stuck breaks away, one that slid sticks or
    /// turns round.
    #[inline(always)]
    fn sign_after(&self, psi: Each<N>) -> Each<N> {
        let (zero, one) = (Each([0.0; N]), Each([1.0; N]));
        let towards = one.select((-one).select(zero, |i| psi[i] < 0.0), |i| psi[i] > 0.0);
        let held = self.level - psi.abs();
        zero.select(towards, |i| (self.sign[i] != 0.0) & (held[i] >= 0.0))
    }
}

/// A state so many seconds later, as long as these accelerations stay the same.
#[inline(always)]
fn later<const N: usize>(
    (angle, velocity): Angles<N>,
    acceleration: Each<N>,
    late: Each<N>,
) -> Angles<N> {
    let gain = late * acceleration;
    (angle + late * (velocity + 0.5 * gain), velocity + gain)
}

/// Where cubics with these values and slopes at both ends of a `length` fall below zero, nearly:
/// [`descent`](crate::integrate::descent)'s first guess.
#[inline(always)]
fn fall_of_cubic<const N: usize>(
    (start, rate): (Each<N>, Each<N>),
    (value, slope): (Each<N>, Each<N>),
    length: Each<N>,
) -> Each<N> {
    let (rate, slope, rise) = (rate * length, slope * length, value - start);
    let bend = rise - rate;
    let root = (rate * rate - 4.0 * bend * start)
        .max(Each([0.0; N]))
        .sqrt();
    let rises = |i: usize| rate[i] > 0.0;
    let over = (rate + root).select(2.0 * start, rises);
    let under = (-2.0 * bend).select(root - rate, rises);
    let s = over / under;
    let a = rate + slope - 2.0 * rise;
    let b = 3.0 * rise - 2.0 * rate - slope;
    let falls = rate + s * (2.0 * b + 3.0 * s * a);
    let s = s - (start + s * (rate + s * (b + s * a))) / falls;
    s * length
}

impl<const N: usize> Lanes<N> {
    /// Finishes the steps in which a mode changes once, and leaves what is negative in the margin to be finished.
    #[inline(always)]
    pub(super) fn pass(&self, s: &mut States<N>, input: &Input<N>, ends: &mut Ends<N>) {
        let (zero, whole) = (Each([0.0; N]), self.length);
        let (motor, load) = self.motions(s, &ends.course);
        let chosen = self.choose(s, input, ends, (&motor, &load));

        // One step of Newton's method from the root of the cubic through both ends.
        let start = (
            (s.motor.angle, s.motor.velocity),
            (s.load.angle, s.load.velocity),
        );
        let at_start = self.margin(&chosen, input, &start, zero);
        let at_end = self.margin(&chosen, input, &(ends.motor, ends.load), whole);
        let guess = fall_of_cubic(at_start, at_end, whole);
        let inside = guess.min(whole - guess);
        let guess = guess.select(zero, |i| inside[i] > 0.0);
        let (by_motor, by_load) = (motor.after(guess), load.after(guess));
        let there = (
            (s.motor.angle + by_motor.0, by_motor.1),
            (s.load.angle + by_load.0, by_load.1),
        );
        let (value, slope) = self.margin(&chosen, input, &there, guess);
        let newton = value / slope;
        let root = guess - newton;
        // Between the guess and the end on whose side the root must lie.
        let after = (root - guess).min(whole - root);
        let between = after.select((guess - root).min(root), |i| value[i] >= 0.0);
        let delay = Each([BREAK_AWAY_DELAY; N]).select(zero, |i| chosen.sign[i] == 0.0);
        let time = (root + delay).min(whole);
        let late = time - guess;
        let (qm, vm) = later(there.0, motor.acceleration(guess, there.0.1), late);
        let (ql, vl) = later(there.1, load.acceleration(guess, there.1.1), late);

        // The other body keeps its mode: the load until then, the motor to the end.
        let twist = self.ratio * qm - ql;
        let torque = self.torque(twist);
        let (_, load_keeps) = self.keep(s, input, &ends.course, (vm, vl, torque), time);
        let other = load_keeps.select(ends.motor_keeps, |i| chosen.motor[i] < 0.0);

        // What happens to the one, and from there to the end.
        let sign =
            chosen.sign_after(chosen.of(input.drive - self.ratio * torque, input.outside + torque));
        let is_motor = |i: usize| chosen.motor[i] < 0.0;
        let from = States {
            motor: Moving {
                angle: qm,
                velocity: zero.select(vm, is_motor),
                sign: sign.select(s.motor.sign, is_motor),
            },
            load: Moving {
                angle: ql,
                velocity: vl.select(zero, is_motor),
                sign: s.load.sign.select(sign, is_motor),
            },
            load_torque: s.load_torque,
        };
        let accelerations = self.accelerations(&from, input);
        let course = self.course(&from, accelerations, twist, torque);
        let rest = whole - time;
        let (motor, load) = self.motions(&from, &course);
        let (by_motor, by_load) = (motor.after(rest), load.after(rest));
        let motor = (qm + by_motor.0, by_motor.1);
        let load = (ql + by_load.0, by_load.1);
        let torque = self.torque(self.ratio * motor.0 - load.0);
        let (motor_keeps, load_keeps) =
            self.keep(&from, input, &course, (motor.1, load.1, torque), rest);
        let keeps = other.min(motor_keeps).min(load_keeps);

        let begun = at_start.0.max(at_start.1);
        let one = Each([1.0; N]);
        let margin = &ends.margin;
        let slow = self.length * self.motor.decay.max(self.load.decay);
        // Whatever is no number is not done.
        let done = one.select(zero, |i| {
            (margin[i] < 0.0)
                & (slow[i] <= 1.0)
                & (begun[i] > 0.0)
                & (inside[i] > 0.0)
                & (newton[i].abs() < LAST_STEP)
                & (between[i] >= 0.0)
                & (keeps[i] >= 0.0)
        });
        let is_done = |i: usize| done[i] > 0.0;
        s.motor.sign = from.motor.sign.select(s.motor.sign, is_done);
        s.load.sign = from.load.sign.select(s.load.sign, is_done);
        ends.motor.0 = motor.0.select(ends.motor.0, is_done);
        ends.motor.1 = motor.1.select(ends.motor.1, is_done);
        ends.load.0 = load.0.select(ends.load.0, is_done);
        ends.load.1 = load.1.select(ends.load.1, is_done);
        ends.margin = zero.select(ends.margin, is_done);
    }

    #[inline(always)]
    fn motions(&self, s: &States<N>, course: &Course<N>) -> (Motions<N>, Motions<N>) {
        let Course {
            motor,
            load,
            torques,
        } = course;
        (
            Motions::new(&self.motor, &s.motor, motor, torques, self.rate),
            Motions::new(&self.load, &s.load, load, torques, self.rate),
        )
    }

    #[inline(always)]
    fn choose(
        &self,
        s: &States<N>,
        input: &Input<N>,
        ends: &Ends<N>,
        (motor, load): (&Motions<N>, &Motions<N>),
    ) -> Chosen<N> {
        let psi = input.drive - self.ratio * ends.torque;
        let changed = self
            .motor
            .holds(&s.motor, psi)
            .min(s.motor.sign * ends.motor.1);
        let is_motor = |i: usize| changed[i] < 0.0;
        let (a, b) = (&motor.accelerations, &load.accelerations);
        Chosen {
            motor: changed,
            sign: s.motor.sign.select(s.load.sign, is_motor),
            level: self.motor.level.select(self.load.level, is_motor),
            motions: Motions {
                velocity: motor.velocity.select(load.velocity, is_motor),
                decay: motor.decay.select(load.decay, is_motor),
                accelerations: [
                    a[0].select(b[0], is_motor),
                    a[1].select(b[1], is_motor),
                    a[2].select(b[2], is_motor),
                    a[3].select(b[3], is_motor),
                ],
            },
        }
    }

    /// How far the chosen bodies are from the end of their modes after `t` seconds, and its rate of change: as a
    /// joint's by itself.
    #[inline(always)]
    fn margin(
        &self,
        chosen: &Chosen<N>,
        input: &Input<N>,
        ((qm, vm), (ql, vl)): &(Angles<N>, Angles<N>),
        t: Each<N>,
    ) -> (Each<N>, Each<N>) {
        let twist = self.ratio * *qm - *ql;
        let torque = self.torque(twist);
        let psi = chosen.of(input.drive - self.ratio * torque, input.outside + torque);
        let hardening = twist.abs().min(self.bend);
        let stiffness = self.linear + 3.0 * self.cubic * hardening * hardening;
        let (velocity, other) = (chosen.of(*vm, *vl), chosen.of(*vl, *vm));
        let pull = stiffness * self.ratio * other;
        let slips = pull.select(-pull, |i| psi[i] < 0.0);
        let is_stuck = |i: usize| chosen.sign[i] == 0.0;
        let sliding = chosen.motions.acceleration(t, velocity) * chosen.sign;
        (
            (chosen.level - psi.abs()).select(velocity * chosen.sign, is_stuck),
            slips.select(sliding, is_stuck),
        )
    }
}
