//! How a joint is stepped, and the instants at which a mode changes found.

use super::{Joint, JointState, Voltage};
use crate::friction::Mode;
use crate::integrate::{descent, interior_minimum};
use crate::nystrom::{Motion, NODES, POINTS, Weights, dot};
use crate::presliding::Presliding;

/// A voltage seen from `since` seconds after its start.
#[derive(Clone, Copy)]
struct Seen<'v, V> {
    voltage: &'v V,
    since: f64,
}

impl<V: Voltage> Seen<'_, V> {
    #[inline]
    fn at(&self, time: f64) -> f64 {
        self.voltage.at(self.since + time)
    }
}

/// One of the two inertias.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Body {
    Motor,
    Load,
}

/// More mode changes than this in one step cannot be physics: the remaining time is then taken
/// with the modes as they are.
const MAX_EVENTS: usize = 64;

/// A body that breaks away does so this much after it reached its static friction, seconds: late
/// enough that rounding cannot stop it again, and far below what a position could show.
pub(crate) const BREAK_AWAY_DELAY: f64 = 1e-11;

/// As long as this, seconds, an acceleration stays the same.
const NEARBY: f64 = 2e-7;

/// A velocity that would not reach zero in a step if the body went on slowing down as it does at its
/// start, by this factor, does not.
pub(crate) const SLOWS: f64 = 2.0;

/// Whether a speed that is positive at both ends of a step of `length` seconds may have been below zero
/// in between, by its rates of change at both ends (the last to the accuracy of an inner point).
#[inline]
fn may_dip(speed: f64, rates: (f64, f64), length: f64) -> bool {
    rates.0 < 0.0 && rates.1 > 0.0 && speed + SLOWS * rates.0 * length < 0.0
}

/// Weights of both bodies for steps of one length, seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scheme {
    pub(crate) motor: Weights,
    pub(crate) load: Weights,
    pub(crate) length: f64,
}

impl Scheme {
    /// For these decays, 1/s.
    pub(super) fn new(motor_decay: f64, load_decay: f64, length: f64) -> Self {
        Self {
            motor: Weights::new(motor_decay, length),
            load: Weights::new(load_decay, length),
            length,
        }
    }
}

impl<P: Presliding> Joint<P> {
    /// Advances `state` by `duration` seconds under a voltage that is smooth over that time. At a
    /// jump of the voltage, advance to it and then from it.
    pub fn advance(
        &self,
        state: &mut JointState<P::State>,
        voltage: impl Voltage + Copy,
        duration: f64,
    ) {
        self.resolve(state, voltage.at(0.0));
        self.go_on(state, &voltage, (0.0, duration), 0);
    }

    /// Goes on from `time` of `duration` after so many events.
    fn go_on<V: Voltage>(
        &self,
        state: &mut JointState<P::State>,
        voltage: &V,
        (mut time, duration): (f64, f64),
        mut events: usize,
    ) {
        while time < duration && !(self.is_at_rest(state) && voltage.is_held()) {
            let length = (duration - time).min(self.scheme.length);
            let seen = Seen {
                voltage,
                since: time,
            };
            // Where nothing changes after its end a whole step is taken, and read off before.
            let own;
            let scheme = if length == self.scheme.length || voltage.is_held() {
                &self.scheme
            } else {
                own = self.scheme_for(length);
                &own
            };
            let step = Step::new(self, *state, seen, scheme);
            let end = if length == scheme.length {
                step.end(scheme)
            } else {
                step.at(&step.motions(), length)
            };
            time += if events < MAX_EVENTS && step.may_change(&end, length) {
                self.take(state, &step, (end, length), &mut events)
            } else {
                *state = end;
                length
            };
        }
    }

    /// Takes a step of `length` seconds in which a mode may change to the first that does, or to its
    /// `end`. Returns how far, seconds.
    fn take<V: Voltage>(
        &self,
        state: &mut JointState<P::State>,
        step: &Step<P, V>,
        (end, length): (JointState<P::State>, f64),
        events: &mut usize,
    ) -> f64 {
        if let Some((body, after, at)) = step.first_event(&end, length) {
            *state = at;
            self.change_mode(state, body, step.seen.at(after));
            *events += 1;
            after
        } else {
            *state = end;
            length
        }
    }
}

impl Joint {
    /// Takes a whole step under a held voltage with these accelerations at its points and this `end`
    /// as far as its modes last, and the rest of its time from there.
    pub(crate) fn finish(
        &self,
        state: &mut JointState,
        voltage: f64,
        (motor, load): ([f64; POINTS], [f64; POINTS]),
        (end, length): (JointState, f64),
    ) {
        let step = Step {
            joint: self,
            start: *state,
            seen: Seen {
                voltage: &voltage,
                since: 0.0,
            },
            motor,
            load,
            length,
        };
        let mut events = 0;
        let time = self.take(state, &step, (end, length), &mut events);
        self.go_on(state, &voltage, (time, length), events);
    }
}

impl<P: Presliding> Joint<P> {
    /// What happens to a body when its mode ends: one that was stuck breaks away, one that slid
    /// has come to rest and sticks or turns round.
    fn change_mode(&self, state: &mut JointState<P::State>, body: Body, voltage: f64) {
        match body {
            Body::Motor => {
                let psi = self.motor_psi(state, voltage);
                state.motor_mode = if state.motor_mode == Mode::Stuck {
                    Mode::towards(psi)
                } else {
                    self.parameters.motor_friction.at_rest(psi)
                };
                state.motor_velocity = 0.0;
            }
            Body::Load => {
                self.presliding
                    .turn(&mut state.presliding, state.load_angle);
                let psi = self.load_psi(state);
                state.load_mode = if state.load_mode == Mode::Stuck {
                    Mode::towards(psi)
                } else {
                    self.parameters.load_friction.at_rest(psi)
                };
                state.load_velocity = 0.0;
            }
        }
    }
}

/// A step from `start` with the modes as they are there.
struct Step<'s, P: Presliding, V> {
    joint: &'s Joint<P>,
    start: JointState<P::State>,
    seen: Seen<'s, V>,
    /// Accelerations beside the decay at each of the points, rad/s^2.
    motor: [f64; POINTS],
    load: [f64; POINTS],
    length: f64,
}

/// How both bodies move within a step.
struct Motions {
    motor: Motion,
    load: Motion,
}

impl<'s, P: Presliding, V: Voltage> Step<'s, P, V> {
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "called once in the hot loop")]
    fn new(
        joint: &'s Joint<P>,
        start: JointState<P::State>,
        seen: Seen<'s, V>,
        scheme: &Scheme,
    ) -> Self {
        let f = joint.forcing(&start);
        let ratio = joint.parameters.ratio;
        let (vm, vl) = (start.motor_velocity, start.load_velocity);
        let twist = joint.twist(&start);
        // Accelerations but for the transmission's torque. From one torque to the next is the chain
        // that everything else waits for: what does not belong to it is kept out of it.
        let motor = NODES.map(|s| f.motor_constant + f.motor_gain * seen.at(s * scheme.length));
        let mut load = [f.load_constant; POINTS];
        let by_motor = ratio * f.motor_spring;
        let mut torques = [0.0; POINTS];
        for i in 0..POINTS {
            let (mut w, mut moved, mut velocity) = (twist, 0.0, vl);
            if i > 0 {
                let (m, l) = (&scheme.motor.points[i - 1], &scheme.load.points[i - 1]);
                moved = l.way(vl, &load);
                w += ratio * m.way(vm, &motor) - moved;
                for (j, torque) in torques[..i].iter().enumerate() {
                    w -= (m.angle[j] * by_motor + l.angle[j] * f.load_spring) * torque;
                }
                if !P::RIGID {
                    let by_spring = torques.map(|torque| f.load_spring * torque);
                    moved += dot(&l.angle, &by_spring);
                    velocity = l.velocity(vl, &load) + dot(&l.velocity, &by_spring);
                }
            }
            torques[i] = joint.parameters.transmission.torque(w);
            if !P::RIGID {
                let angle = start.load_angle + moved;
                let held = joint.presliding.torque(&start.presliding, angle, velocity);
                load[i] -= f.load_spring * held;
            }
        }
        Self {
            joint,
            start,
            seen,
            motor: std::array::from_fn(|i| motor[i] - f.motor_spring * torques[i]),
            load: std::array::from_fn(|i| load[i] + f.load_spring * torques[i]),
            length: scheme.length,
        }
    }

    /// The state at the end of the whole step.
    #[inline]
    fn end(&self, scheme: &Scheme) -> JointState<P::State> {
        let s = &self.start;
        let (motor, load) = (&scheme.motor.end, &scheme.load.end);
        JointState {
            motor_angle: s.motor_angle + motor.way(s.motor_velocity, &self.motor),
            load_angle: s.load_angle + load.way(s.load_velocity, &self.load),
            motor_velocity: motor.velocity(s.motor_velocity, &self.motor),
            load_velocity: load.velocity(s.load_velocity, &self.load),
            ..*s
        }
    }

    #[inline]
    fn motions(&self) -> Motions {
        let (s, h) = (&self.start, self.length);
        Motions {
            motor: Motion::new(s.motor_velocity, self.joint.motor_decay, &self.motor, h),
            load: Motion::new(s.load_velocity, self.joint.load_decay, &self.load, h),
        }
    }

    /// The state after `t` seconds.
    #[inline]
    fn at(&self, motions: &Motions, t: f64) -> JointState<P::State> {
        let s = &self.start;
        let (motor, load) = (motions.motor.after(t), motions.load.after(t));
        JointState {
            motor_angle: s.motor_angle + motor.0,
            load_angle: s.load_angle + load.0,
            motor_velocity: motor.1,
            load_velocity: load.1,
            ..*s
        }
    }

    /// Whether the mode of a body may end before `end`, which is after `length` seconds.
    #[inline]
    fn may_change(&self, end: &JointState<P::State>, length: f64) -> bool {
        [Body::Motor, Body::Load].into_iter().any(|body| {
            self.margin(body, end, length) < 0.0 || self.may_dip(body, end, length).is_some()
        })
    }

    /// The earliest mode change before `end`, its time after the start, and the state just before it.
    #[inline]
    fn first_event(
        &self,
        end: &JointState<P::State>,
        length: f64,
    ) -> Option<(Body, f64, JointState<P::State>)> {
        let motions = self.motions();
        let Some((time, at)) = self.event_of(Body::Motor, &motions, end, length) else {
            let (time, at) = self.event_of(Body::Load, &motions, end, length)?;
            return Some((Body::Load, time, at));
        };
        // The load matters only if it changes before the motor does.
        match self.event_of(Body::Load, &motions, &at, time) {
            Some((earlier, at)) if earlier < time => Some((Body::Load, earlier, at)),
            _ => Some((Body::Motor, time, at)),
        }
    }

    /// When the mode of one body ends before `end`, if it does, and the state then.
    #[inline]
    fn event_of(
        &self,
        body: Body,
        motions: &Motions,
        end: &JointState<P::State>,
        length: f64,
    ) -> Option<(f64, JointState<P::State>)> {
        let margin = self.margin(body, end, length);
        if margin < 0.0 {
            let rate = self.margin_rate(body, motions, end, length);
            return Some(self.event_before(body, motions, (length, margin, rate)));
        }
        let rate = self.may_dip(body, end, length)?;
        self.event_in_dip(body, motions, rate, (end, length, margin))
    }

    /// Whether a velocity may have dipped below zero and come back: its speed's rate of change at the
    /// start then. The torque on a stuck body cannot, as long as the other body does not turn round,
    /// which would be an event itself.
    #[inline]
    fn may_dip(&self, body: Body, end: &JointState<P::State>, length: f64) -> Option<f64> {
        let s = &self.start;
        let (mode, velocity, at_end, decay, accelerations) = match body {
            Body::Motor => (
                s.motor_mode,
                s.motor_velocity,
                end.motor_velocity,
                self.joint.motor_decay,
                &self.motor,
            ),
            Body::Load => (
                s.load_mode,
                s.load_velocity,
                end.load_velocity,
                self.joint.load_decay,
                &self.load,
            ),
        };
        let sign = mode.sign();
        let rate = |point: usize, velocity: f64| (accelerations[point] - decay * velocity) * sign;
        let rates = (rate(0, velocity), rate(POINTS - 1, at_end));
        may_dip(velocity * sign, rates, length).then_some(rates.0)
    }

    #[cold]
    fn event_in_dip(
        &self,
        body: Body,
        motions: &Motions,
        rate: f64,
        (end, length, at_end): (&JointState<P::State>, f64, f64),
    ) -> Option<(f64, JointState<P::State>)> {
        let at_start = self.margin(body, &self.start, 0.0);
        let end_rate = self.margin_rate(body, motions, end, length);
        let (time, lowest) = interior_minimum(at_start, rate, at_end, end_rate, length)?;
        if lowest >= 0.0 {
            return None;
        }
        let state = self.at(motions, time);
        let dip = self.margin(body, &state, time);
        let rate = self.margin_rate(body, motions, &state, time);
        (dip < 0.0).then(|| self.event_before(body, motions, (time, dip, rate)))
    }

    /// The time at which a margin became negative that is so at an `end` (time, margin, rate of change), and
    /// the state then.
    fn event_before(
        &self,
        body: Body,
        motions: &Motions,
        end: (f64, f64, f64),
    ) -> (f64, JointState<P::State>) {
        let margin = self.margin(body, &self.start, 0.0);
        let rate = self.margin_rate(body, motions, &self.start, 0.0);
        if margin <= 0.0 && rate <= 0.0 {
            return (0.0, self.start);
        }
        let mut seen = (0.0, self.start);
        let mut time = descent(
            |time| {
                seen = (time, self.at(motions, time));
                let margin = self.margin(body, &seen.1, time);
                (margin, self.margin_rate(body, motions, &seen.1, time))
            },
            (margin, rate),
            end,
        );
        let mode = match body {
            Body::Motor => self.start.motor_mode,
            Body::Load => self.start.load_mode,
        };
        if mode == Mode::Stuck {
            time = (time + BREAK_AWAY_DELAY).min(end.0);
        }
        let (looked_at, mut state) = seen;
        let late = time - looked_at;
        if late.abs() > NEARBY {
            return (time, self.at(motions, time));
        }
        for (motion, angle, velocity) in [
            (
                &motions.motor,
                &mut state.motor_angle,
                &mut state.motor_velocity,
            ),
            (
                &motions.load,
                &mut state.load_angle,
                &mut state.load_velocity,
            ),
        ] {
            let gain = late * motion.acceleration(looked_at, *velocity);
            *angle += late * (*velocity + 0.5 * gain);
            *velocity += gain;
        }
        (time, state)
    }

    /// How far a body is from the end of its mode in state `s` after `t` seconds, positive while the mode
    /// lasts: the speed of one that slides, the torque that is missing to break away for one that is stuck.
    #[inline]
    fn margin(&self, body: Body, s: &JointState<P::State>, t: f64) -> f64 {
        let p = &self.joint.parameters;
        let (friction, mode, velocity) = match body {
            Body::Motor => (&p.motor_friction, s.motor_mode, s.motor_velocity),
            Body::Load => (&p.load_friction, s.load_mode, s.load_velocity),
        };
        if friction.is_free() {
            f64::INFINITY
        } else if mode != Mode::Stuck {
            velocity * mode.sign()
        } else {
            friction.static_level() - self.psi(body, s, t).abs()
        }
    }

    /// Rate of change of [`Self::margin`].
    #[inline]
    fn margin_rate(&self, body: Body, motions: &Motions, s: &JointState<P::State>, t: f64) -> f64 {
        let (mode, motion, velocity) = match body {
            Body::Motor => (s.motor_mode, &motions.motor, s.motor_velocity),
            Body::Load => (s.load_mode, &motions.load, s.load_velocity),
        };
        if mode != Mode::Stuck {
            return motion.acceleration(t, velocity) * mode.sign();
        }
        // psi changes by the other body's motion through the spring, and with the voltage.
        let p = &self.joint.parameters;
        let spring = p.transmission.stiffness(self.joint.twist(s)) * p.ratio;
        let rate = match body {
            Body::Motor => {
                let rate = self.seen.voltage.rate(self.seen.since + t);
                spring * s.load_velocity + p.motor.gain() * rate
            }
            Body::Load => spring * s.motor_velocity,
        };
        -rate * self.psi(body, s, t).signum()
    }

    #[inline]
    fn psi(&self, body: Body, s: &JointState<P::State>, t: f64) -> f64 {
        match body {
            Body::Motor => self.joint.motor_psi(s, self.seen.at(t)),
            Body::Load => self.joint.load_psi(s),
        }
    }
}
