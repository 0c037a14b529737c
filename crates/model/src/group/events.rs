//! Mode changes of several joints, found and passed side by side.
//!
//! A joint by itself looks for whatever may happen in a step. Here is looked for what happens nearly always: one body comes
//! to rest or breaks away, once, at an instant that one step of Newton's method finds. A joint of which that is not true is
//! left to be finished by itself. The equations are those of there, some in a form that takes fewer operations, so that ways agree to
//! 1e-3 nm and not to the last bit; what is worked out for a joint does not depend on who lies beside it.

#![expect(
    clippy::inline_always,
    clippy::needless_bitwise_bool,
    reason = "what is not inlined does not get the instructions of its caller, and a short cut is a branch"
)]

use super::lanes::{Accelerations, Angles, Bodies, Course, Ends, Input, Lanes};
use super::{Moving, States};
use crate::each::{Each, Way};
use crate::integrate::LAST_STEP;
use crate::joint::BREAK_AWAY_DELAY;
use crate::nystrom::{LAGRANGE, POINTS, SERIES};

/// How one body of each joint moves within a step: a [`Motion`](crate::nystrom::Motion) of each.
///
/// Here a way is Taylor's series with what is left of it, `phi_5`: with `n` the accelerations beside the decay `d`, each derivative
/// of the velocity is that of `n` less `d` times the one before. A velocity is what `n` comes to less `d` times the way. That is the same as
/// with `phi_1` to `phi_5`, in half of the operations.
struct Motions<const N: usize> {
    velocity: Each<N>,
    decay: Each<N>,
    /// At the start and beside the decay, with its derivatives.
    accelerations: [Each<N>; POINTS],
    /// At the start, decay and all, with its derivatives.
    rates: [Each<N>; POINTS],
}

/// What torques at the points of a step are at its start, and their derivatives there. In steps of which so many make
/// a second.
#[inline(always)]
fn derivatives<W: Way, const N: usize>(
    torques: &[Each<N>; POINTS],
    rate: Each<N>,
) -> [Each<N>; POINTS] {
    // The first point is the start.
    let mut all = *torques;
    let mut scale = rate;
    for (k, sum) in all.iter_mut().enumerate().skip(1) {
        let l: [Each<N>; POINTS] = std::array::from_fn(|j| Each([LAGRANGE[POINTS - 1][j][k]; N]));
        *sum = scale * super::lanes::sum::<W, N>(&l, torques);
        scale = scale * ((k + 1) as f64 * rate);
    }
    all
}

impl<const N: usize> Motions<N> {
    /// Under torques with these derivatives.
    #[inline(always)]
    fn new<W: Way>(
        body: &Bodies<N>,
        s: &Moving<N>,
        a: &Accelerations<N>,
        torques: &[Each<N>; POINTS],
    ) -> Self {
        let mut accelerations = torques.map(|torque| a.by * torque);
        accelerations[0] = a.alone + accelerations[0];
        let mut rates = accelerations;
        let mut before = s.velocity;
        for rate in &mut rates {
            *rate = rate.less::<W>(body.decay, before);
            before = *rate;
        }
        Self {
            velocity: s.velocity,
            decay: body.decay,
            accelerations,
            rates,
        }
    }

    /// Way since the start and velocity after `t` seconds, for decays of at most one over that time.
    #[inline(always)]
    fn after<W: Way>(&self, t: Each<N>) -> Angles<N> {
        let [a, b, c, d] = self.accelerations;
        let [i, j, k, l] = self.rates;
        let t2 = t * t;
        let rest = phi_5::<W, N>(-(self.decay * t)) * l;
        let early = (0.5 * i).plus::<W>(t, SIXTH * j);
        let way = early.plus::<W>(t2, (PART * k).plus::<W>(t, rest));
        let way = (t * self.velocity).plus::<W>(t2, way);
        let late = (SIXTH * c).plus::<W>(t, PART * d);
        let gain = a.plus::<W>(t, 0.5 * b).plus::<W>(t2, late);
        let velocity = self.velocity.plus::<W>(t, gain);
        (way, velocity.less::<W>(self.decay, way))
    }

    /// Acceleration after `t` seconds, at the velocity then.
    #[inline(always)]
    fn acceleration<W: Way>(&self, t: Each<N>, velocity: Each<N>) -> Each<N> {
        let [a, b, c, d] = self.accelerations;
        let early = a.plus::<W>(t, b);
        let late = (0.5 * c).plus::<W>(t, SIXTH * d);
        early.plus::<W>(t * t, late).less::<W>(self.decay, velocity)
    }
}

const SIXTH: f64 = 1.0 / 6.0;
const PART: f64 = 1.0 / 24.0;

/// `phi_5` as [`nystrom`](crate::nystrom) has it, for `z` from -1 to 1 to 1e-10 of it: as a part of a way that is
/// less than a hundredth.
#[inline(always)]
fn phi_5<W: Way, const N: usize>(z: Each<N>) -> Each<N> {
    let c = SERIES.map(|c| Each([c; N]));
    let z2 = z * z;
    let z4 = z2 * z2;
    let early = c[0]
        .plus::<W>(c[1], z)
        .plus::<W>(z2, c[2].plus::<W>(c[3], z));
    let late = c[4]
        .plus::<W>(c[5], z)
        .plus::<W>(z2, c[6].plus::<W>(c[7], z));
    early.plus::<W>(z4, late.plus::<W>(z4, c[8].plus::<W>(c[9], z)))
}

/// The body of each joint of which the mode changes first: the motor where its mode has changed by the end of the step.
struct Chosen<const N: usize> {
    /// Negative where it is the motor.
    motor: Each<N>,
    /// Its mode before, as a sign.
    sign: Each<N>,
    level: Each<N>,
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
fn later<W: Way, const N: usize>(
    (angle, velocity): Angles<N>,
    acceleration: Each<N>,
    late: Each<N>,
) -> Angles<N> {
    let mean = velocity.plus::<W>(0.5 * late, acceleration);
    (
        angle.plus::<W>(late, mean),
        velocity.plus::<W>(late, acceleration),
    )
}

/// Where cubics with these values and slopes at both ends of a `length` fall below zero, nearly:
/// [`descent`](crate::integrate::descent)'s first guess.
#[inline(always)]
fn fall_of_cubic<W: Way, const N: usize>(
    (start, rate): (Each<N>, Each<N>),
    (value, slope): (Each<N>, Each<N>),
    length: Each<N>,
) -> Each<N> {
    let (rate, slope, rise) = (rate * length, slope * length, value - start);
    let bend = rise - rate;
    let root = (rate * rate)
        .less::<W>(4.0 * bend, start)
        .max(Each([0.0; N]))
        .sqrt();
    let rises = |i: usize| rate[i] > 0.0;
    let over = (rate + root).select(2.0 * start, rises);
    let under = (-2.0 * bend).select(root - rate, rises);
    // A step of Newton's method from `over / under`, as one fraction: a division takes as long as six products.
    let a = rate + slope - 2.0 * rise;
    let b = 3.0 * rise - 2.0 * rate - slope;
    let (square, over2) = (under * under, over * over);
    let falls = (rate * square)
        .plus::<W>(2.0 * b * over, under)
        .plus::<W>(3.0 * a, over2);
    let value = (start * under).plus::<W>(rate, over) * square;
    let value = value.plus::<W>((b * under).plus::<W>(a, over), over2);
    ((over * falls).less::<W>(Each([1.0; N]), value) / (under * falls)) * length
}

impl<const N: usize> Lanes<N> {
    /// Finishes the steps in which a mode changes once, and leaves what is negative in the margin to be finished.
    #[inline(always)]
    pub(super) fn pass<W: Way>(&self, s: &mut States<N>, input: &Input<N>, ends: &mut Ends<N>) {
        let (zero, whole) = (Each([0.0; N]), self.length);
        let (motor, load) = self.motions::<W>(s, &ends.course);
        let chosen = self.choose::<W>(s, input, ends);

        // One step of Newton's method from the root of the cubic through both ends.
        let start = (
            (s.motor.angle, s.motor.velocity),
            (s.load.angle, s.load.velocity),
        );
        let begins = chosen.of(motor.rates[0], load.rates[0]);
        let at_start = self.margin::<W>(&chosen, input, &start, (ends.course.torques[0], begins));
        let stops = chosen.of(
            motor.acceleration::<W>(whole, ends.motor.1),
            load.acceleration::<W>(whole, ends.load.1),
        );
        let to = (ends.motor, ends.load);
        let at_end = self.margin::<W>(&chosen, input, &to, (ends.torque, stops));
        let guess = fall_of_cubic::<W, N>(at_start, at_end, whole);
        let inside = guess.min(whole - guess);
        let guess = guess.select(zero, |i| inside[i] > 0.0);
        let (by_motor, by_load) = (motor.after::<W>(guess), load.after::<W>(guess));
        let there = (
            (s.motor.angle + by_motor.0, by_motor.1),
            (s.load.angle + by_load.0, by_load.1),
        );
        let torque = self.torque::<W>((-there.1.0).plus::<W>(self.ratio, there.0.0));
        let (motor_gains, load_gains) = (
            motor.acceleration::<W>(guess, there.0.1),
            load.acceleration::<W>(guess, there.1.1),
        );
        let gains = chosen.of(motor_gains, load_gains);
        let stiffness = self.stiffness::<W>((-there.1.0).plus::<W>(self.ratio, there.0.0));
        let twists = stiffness * (-there.1.1).plus::<W>(self.ratio, there.0.1);
        let (value, slope) = self.margin::<W>(&chosen, input, &there, (torque, gains));
        let newton = value / slope;
        let root = guess - newton;
        // Between the guess and the end on whose side the root must lie.
        let after = (root - guess).min(whole - root);
        let between = after.select((guess - root).min(root), |i| value[i] >= 0.0);
        let delay = Each([BREAK_AWAY_DELAY; N]).select(zero, |i| chosen.sign[i] == 0.0);
        let time = (root + delay).min(whole);
        let late = time - guess;
        let (qm, vm) = later::<W, N>(there.0, motor_gains, late);
        let (ql, vl) = later::<W, N>(there.1, load_gains, late);

        // The other body keeps its mode: the load until then, the motor to the end. The torque is that at the guess and by how much it
        // changes: that of the twist is longer to wait for.
        let twist = (-ql).plus::<W>(self.ratio, qm);
        let torque = torque.plus::<W>(late, twists);
        let (_, load_keeps) = self.keep::<W>(s, input, &ends.course, (vm, vl, torque), time);
        let other = load_keeps.select(ends.motor_keeps, |i| chosen.motor[i] < 0.0);

        // What happens to the one, and from there to the end.
        let sign = chosen.sign_after(chosen.of(
            input.drive.less::<W>(self.ratio, torque),
            input.outside + torque,
        ));
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
        let accelerations = self.accelerations::<W>(&from, input);
        let course = self.course::<W>(&from, accelerations, twist, torque);
        let rest = whole - time;
        let (motor, load) = self.motions::<W>(&from, &course);
        let (by_motor, by_load) = (motor.after::<W>(rest), load.after::<W>(rest));
        let motor = (qm + by_motor.0, by_motor.1);
        let load = (ql + by_load.0, by_load.1);
        let torque = self.torque::<W>((-load.0).plus::<W>(self.ratio, motor.0));
        let (motor_keeps, load_keeps) =
            self.keep::<W>(&from, input, &course, (motor.1, load.1, torque), rest);
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
    fn motions<W: Way>(&self, s: &States<N>, course: &Course<N>) -> (Motions<N>, Motions<N>) {
        let Course {
            motor,
            load,
            torques,
        } = course;
        let torques = derivatives::<W, N>(torques, self.rate);
        (
            Motions::new::<W>(&self.motor, &s.motor, motor, &torques),
            Motions::new::<W>(&self.load, &s.load, load, &torques),
        )
    }

    #[inline(always)]
    fn choose<W: Way>(&self, s: &States<N>, input: &Input<N>, ends: &Ends<N>) -> Chosen<N> {
        let psi = input.drive.less::<W>(self.ratio, ends.torque);
        let changed = self
            .motor
            .holds::<W>(&s.motor, psi)
            .min(s.motor.sign * ends.motor.1);
        let is_motor = |i: usize| changed[i] < 0.0;
        Chosen {
            motor: changed,
            sign: s.motor.sign.select(s.load.sign, is_motor),
            level: self.motor.level.select(self.load.level, is_motor),
        }
    }

    /// How far the chosen bodies are from the end of their modes, and its rate of change: as a joint's by itself, where the
    /// transmissions have these torques and the chosen bodies these accelerations.
    #[inline(always)]
    fn margin<W: Way>(
        &self,
        chosen: &Chosen<N>,
        input: &Input<N>,
        ((qm, vm), (ql, vl)): &(Angles<N>, Angles<N>),
        (torque, acceleration): (Each<N>, Each<N>),
    ) -> (Each<N>, Each<N>) {
        let twist = (-*ql).plus::<W>(self.ratio, *qm);
        let psi = chosen.of(
            input.drive.less::<W>(self.ratio, torque),
            input.outside + torque,
        );
        let stiffness = self.stiffness::<W>(twist);
        let (velocity, other) = (chosen.of(*vm, *vl), chosen.of(*vl, *vm));
        let pull = stiffness * self.ratio * other;
        let slips = pull.select(-pull, |i| psi[i] < 0.0);
        let is_stuck = |i: usize| chosen.sign[i] == 0.0;
        (
            (chosen.level - psi.abs()).select(velocity * chosen.sign, is_stuck),
            slips.select(acceleration * chosen.sign, is_stuck),
        )
    }
}
