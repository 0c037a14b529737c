//! The equations of joints side by side: what a step brings while no mode changes, and whether one may.

#![expect(
    clippy::inline_always,
    clippy::needless_bitwise_bool,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::{Moving, States};
use crate::each::{Each, Way};
use crate::friction::Friction;
use crate::joint::{Joint, JointState, SLOWS};
use crate::nystrom::{POINTS, Row, Weights};

/// Parameters of `N` joints.
#[derive(Debug, Clone, PartialEq)]
#[repr(align(64))] // As all that holds eight numbers each: a vector of them that lay across two lines would be read as two.
pub(crate) struct Lanes<const N: usize> {
    pub(super) ratio: Each<N>,
    pub(super) gain: Each<N>,
    pub(super) linear: Each<N>,
    pub(super) cubic: Each<N>,
    pub(super) bend: Each<N>,
    pub(super) unbend: Each<N>,
    pub(super) stiffest: Each<N>,
    pub(super) load_torque: Each<N>,
    /// Stiffness of the contacts, N m/rad.
    pub(super) contact: Each<N>,
    pub(super) motor: Bodies<N>,
    pub(super) load: Bodies<N>,
    /// Of a step, seconds, and one over it.
    pub(super) length: Each<N>,
    pub(super) rate: Each<N>,
}

/// One body of each joint.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bodies<const N: usize> {
    pub(super) inverse_inertia: Each<N>,
    pub(super) decay: Each<N>,
    pub(super) coulomb: Each<N>,
    pub(super) viscous: Each<N>,
    /// Static friction, and infinitely much of it for a body that nothing holds: it has no modes.
    pub(super) level: Each<N>,
    /// One for a body that nothing holds.
    pub(super) free: Each<N>,
    pub(super) points: [Rows<N>; POINTS - 1],
    pub(super) end: Rows<N>,
}

/// A [`Row`] of each joint.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rows<const N: usize> {
    pub(super) keep: Each<N>,
    pub(super) drift: Each<N>,
    pub(super) velocity: [Each<N>; POINTS],
    pub(super) angle: [Each<N>; POINTS],
    /// Velocity and way by an acceleration that is the same at all points.
    pub(super) all_velocity: Each<N>,
    pub(super) all: Each<N>,
}

impl<const N: usize> Lanes<N> {
    /// Of joints that are advanced by steps of `length` seconds.
    pub(super) fn new(joints: &[Joint; N], length: f64) -> Self {
        let of = |value: fn(&Joint) -> f64| Each::of(|i| value(&joints[i]));
        let bodies = |friction: fn(&Joint) -> Friction,
                      inertia: fn(&Joint) -> f64,
                      decay: fn(&Joint) -> f64| {
            let decays: Each<N> = of(decay);
            let weights = decays.0.map(|decay| Weights::new(decay, length));
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
            length: Each([length; N]),
            rate: Each([1.0 / length; N]),
        }
    }

    #[inline(always)]
    pub(super) fn accelerations<W: Way>(
        &self,
        s: &States<N>,
        input: &Input<N>,
    ) -> (Accelerations<N>, Accelerations<N>) {
        (
            self.motor
                .accelerations::<W>(&s.motor, input.drive, -self.ratio),
            self.load
                .accelerations::<W>(&s.load, input.outside, Each([1.0; N])),
        )
    }

    /// From a twist and its torque.
    #[inline(always)]
    pub(super) fn course<W: Way>(
        &self,
        s: &States<N>,
        (motor, load): (Accelerations<N>, Accelerations<N>),
        twist: Each<N>,
        torque: Each<N>,
    ) -> Course<N> {
        // From one torque to the next is the chain that everything else waits for: what does not belong
        // to it is kept out of it.
        let mut torques = [torque; POINTS];
        for point in 1..POINTS {
            let (m, l) = (&self.motor.points[point - 1], &self.load.points[point - 1]);
            let qm = (m.drift * s.motor.velocity).plus::<W>(m.all, motor.alone);
            let ql = (l.drift * s.load.velocity).plus::<W>(l.all, load.alone);
            let mut w = twist + (-ql).plus::<W>(self.ratio, qm);
            let by_motor = self.ratio * motor.by;
            for (j, torque) in torques[..point].iter().enumerate() {
                let by = (m.angle[j] * by_motor).less::<W>(l.angle[j], load.by);
                w = w.plus::<W>(by, *torque);
            }
            torques[point] = self.torque::<W>(w);
        }
        Course {
            motor,
            load,
            torques,
        }
    }

    /// Negative where the mode of a motor or of a load may change in a step of `h` seconds that ends with these
    /// velocities and torques of the transmissions.
    #[inline(always)]
    pub(super) fn keep<W: Way>(
        &self,
        s: &States<N>,
        input: &Input<N>,
        course: &Course<N>,
        (vm, vl, torque): (Each<N>, Each<N>, Each<N>),
        h: Each<N>,
    ) -> (Each<N>, Each<N>) {
        let Course {
            motor,
            load,
            torques,
        } = course;
        let psi = input.drive.less::<W>(self.ratio, torque);
        let motor_slides = self.motor.slides::<W>(&s.motor, vm, motor, torques, h);
        let load_slides = self.load.slides::<W>(&s.load, vl, load, torques, h);
        (
            self.motor.holds::<W>(&s.motor, psi).min(motor_slides),
            self.load
                .holds::<W>(&s.load, input.outside + torque)
                .min(load_slides),
        )
    }

    /// Torques of the transmissions, N m.
    #[inline(always)]
    pub(super) fn torque<W: Way>(&self, twist: Each<N>) -> Each<N> {
        if !W::HARDENS {
            return self.linear * twist;
        }
        if !W::BENDS {
            return twist * self.linear.plus::<W>(self.cubic * twist, twist);
        }
        let hardening = twist.max(self.unbend).min(self.bend);
        let stiffness = self.linear.plus::<W>(self.cubic * hardening, hardening);
        (self.stiffest * (twist - hardening)).plus::<W>(hardening, stiffness)
    }

    /// Their stiffnesses, N m/rad.
    #[inline(always)]
    pub(super) fn stiffness<W: Way>(&self, twist: Each<N>) -> Each<N> {
        if !W::HARDENS {
            return self.linear;
        }
        let hardening = twist.abs().min(self.bend);
        self.linear
            .plus::<W>(3.0 * self.cubic * hardening, hardening)
    }

    /// Positions of the outputs (2.12), radians.
    #[inline(always)]
    pub(super) fn outputs<W: Way>(&self, s: &States<N>) -> [f64; N] {
        let twist = self.ratio * s.motor.angle - s.load.angle;
        let psi = self.torque::<W>(twist) + self.load_torque + s.load_torque;
        let slides = -s.load.sign * self.load.coulomb - self.load.viscous * s.load.velocity;
        // No short cut, which would be a branch for each.
        let stuck = |i: usize| (s.load.sign[i] == 0.0) & (self.load.free[i] == 0.0);
        let friction = (-psi).select(slides, stuck);
        (s.load.angle - friction / self.contact).0
    }

    #[inline(always)]
    pub(super) fn input(&self, s: &States<N>, voltages: Each<N>) -> Input<N> {
        Input {
            drive: self.gain * voltages,
            outside: self.load_torque + s.load_torque,
        }
    }

    /// Lets go what nothing holds, and says where a step leads to from there; `None` where nothing moves.
    #[inline(always)]
    pub(super) fn step<W: Way>(&self, s: &mut States<N>, input: &Input<N>) -> Option<Ends<N>> {
        let twist = (-s.load.angle).plus::<W>(self.ratio, s.motor.angle);
        let torque = self.torque::<W>(twist);
        let motor = input.drive.less::<W>(self.ratio, torque);
        let load = input.outside + torque;
        self.motor.release::<W>(&mut s.motor, motor);
        self.load.release::<W>(&mut s.load, load);
        let accelerations = self.accelerations::<W>(s, input);
        if accelerations.0.by.all_zero() && accelerations.1.by.all_zero() {
            return None;
        }
        let course = self.course::<W>(s, accelerations, twist, torque);
        let motor = self
            .motor
            .end::<W>(&s.motor, &course.motor, &course.torques);
        let load = self.load.end::<W>(&s.load, &course.load, &course.torques);
        let torque = self.torque::<W>((-load.0).plus::<W>(self.ratio, motor.0));
        let to = (motor.1, load.1, torque);
        let (motor_keeps, load_keeps) = self.keep::<W>(s, input, &course, to, self.length);
        Some(Ends {
            margin: motor_keeps.min(load_keeps),
            motor_keeps,
            course,
            motor,
            load,
            torque,
        })
    }
}

/// Torques from outside on motors, voltage times gain, and on loads, N m.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct Input<const N: usize> {
    pub(super) drive: Each<N>,
    pub(super) outside: Each<N>,
}

/// What moves the bodies in a step, as far as no mode changes.
#[derive(Debug, Clone)]
pub(super) struct Course<const N: usize> {
    pub(super) motor: Accelerations<N>,
    pub(super) load: Accelerations<N>,
    /// Of the transmissions at each point, N m.
    pub(super) torques: [Each<N>; POINTS],
}

/// Where it leads to.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct Ends<const N: usize> {
    /// Negative where a mode may change...
    pub(super) margin: Each<N>,
    /// ...and where that of a motor may.
    pub(super) motor_keeps: Each<N>,
    pub(super) course: Course<N>,
    pub(super) motor: Angles<N>,
    pub(super) load: Angles<N>,
    /// Of the transmissions, N m.
    pub(super) torque: Each<N>,
}

/// Angles and velocities.
pub(super) type Angles<const N: usize> = (Each<N>, Each<N>);

/// Accelerations of bodies beside their decay, rad/s^2: without the transmissions' torques, and by each
/// N m of them. Nothing moves a stuck one.
#[derive(Debug, Clone)]
pub(super) struct Accelerations<const N: usize> {
    pub(super) alone: Each<N>,
    pub(super) by: Each<N>,
}

impl<const N: usize> Ends<N> {
    /// The state of a joint at the end of a step that begins in `state`, as the joint finds it by itself.
    pub(super) fn finish(
        &self,
        i: usize,
        mut state: JointState,
        joint: &Joint,
        voltage: f64,
        length: f64,
    ) -> JointState {
        let end = JointState {
            motor_angle: self.motor.0[i],
            load_angle: self.load.0[i],
            motor_velocity: self.motor.1[i],
            load_velocity: self.load.1[i],
            ..state
        };
        let torques = self.course.torques.map(|torque| torque[i]);
        let accelerations = (
            self.course.motor.of(i, torques),
            self.course.load.of(i, torques),
        );
        joint.finish(&mut state, voltage, accelerations, (end, length));
        state
    }
}

impl<const N: usize> Accelerations<N> {
    /// At these torques.
    #[inline(always)]
    pub(super) fn at<W: Way>(&self, torque: Each<N>) -> Each<N> {
        self.alone.plus::<W>(self.by, torque)
    }

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
    pub(super) fn accelerations<W: Way>(
        &self,
        s: &Moving<N>,
        drive: Each<N>,
        ratio: Each<N>,
    ) -> Accelerations<N> {
        let by = s.sign.abs().max(self.free) * self.inverse_inertia;
        Accelerations {
            alone: by * drive.less::<W>(s.sign, self.coulomb),
            by: by * ratio,
        }
    }

    /// Those that are stuck and that static friction does not hold against these torques begin to slide.
    #[inline(always)]
    fn release<W: Way>(&self, s: &mut Moving<N>, psi: Each<N>) {
        let holds = self.holds::<W>(s, psi);
        if holds.any_negative() {
            let towards = Each([1.0; N]).select(Each([-1.0; N]), |i| psi[i] > 0.0);
            s.sign = towards.select(s.sign, |i| holds[i] < 0.0);
        }
    }

    /// By how much static friction holds the stuck ones against these torques, N m.
    #[inline(always)]
    pub(super) fn holds<W: Way>(&self, s: &Moving<N>, psi: Each<N>) -> Each<N> {
        let slides = Each([SLIDES; N]);
        self.level.plus::<W>(slides, s.sign.abs()) - psi.abs()
    }

    /// Angles and velocities at the end of a step.
    #[inline(always)]
    fn end<W: Way>(
        &self,
        s: &Moving<N>,
        a: &Accelerations<N>,
        torques: &[Each<N>; POINTS],
    ) -> (Each<N>, Each<N>) {
        let row = &self.end;
        let way = (row.drift * s.velocity).plus::<W>(row.all, a.alone);
        let way = way.plus::<W>(a.by, sum::<W, N>(&row.angle, torques));
        let gain = row.all_velocity * a.alone;
        let gain = gain.plus::<W>(a.by, sum::<W, N>(&row.velocity, torques));
        (s.angle + way, gain.plus::<W>(row.keep, s.velocity))
    }

    /// Negative where one has come to rest in a step of `h` seconds to velocities `to`, or may have.
    #[inline(always)]
    fn slides<W: Way>(
        &self,
        s: &Moving<N>,
        to: Each<N>,
        a: &Accelerations<N>,
        torques: &[Each<N>; POINTS],
        h: Each<N>,
    ) -> Each<N> {
        let speed = s.sign * s.velocity;
        let first = s.sign * a.at::<W>(torques[0]).less::<W>(self.decay, s.velocity);
        let last = s.sign * a.at::<W>(torques[POINTS - 1]).less::<W>(self.decay, to);
        // As `may_dip`: only if all of these are negative.
        let dips = first.max(-last).max(speed.plus::<W>(SLOWS * h, first));
        (s.sign * to).min(dips)
    }
}

/// What the torques at all points add up to by these weights. (No closure: one that is called twice may be left a
/// call, and gets none of its caller's instructions then.)
#[inline(always)]
pub(super) fn sum<W: Way, const N: usize>(
    weights: &[Each<N>; POINTS],
    torques: &[Each<N>; POINTS],
) -> Each<N> {
    (weights[0] * torques[0]).plus::<W>(weights[1], torques[1])
        + (weights[2] * torques[2]).plus::<W>(weights[3], torques[3])
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
