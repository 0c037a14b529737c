//! One joint: motor, flexible transmission and load, each with friction, (2.1)-(2.13).
//!
//! # How a step is taken
//!
//! Each body is in a [`Mode`]: it slides forward, slides backward, or is stuck. While the modes
//! stay, the equations of motion are smooth and one classical fourth-order Runge-Kutta step of a
//! whole servo cycle is accurate to a nanometre. What spoils a fixed-step method is the
//! instant at which a mode changes. After each trial step this integrator therefore looks for
//! two kinds of event: the velocity of a sliding body reaches zero, or the torque on a stuck body
//! reaches its static friction. The earliest is found as a root on the map of the step itself,
//! the state is taken there, the velocity is set to exactly zero, the mode is decided by (2.7)
//! and (2.8), and the rest of the step is taken from there.

use crate::Invalid;
use crate::friction::{Friction, Mode};
use crate::integrate::{descent, interior_minimum};
use crate::lugre::LuGre;
use crate::motor::Motor;
use crate::presliding::{Contact, MaxwellSlip, Presliding};
use crate::transmission::Transmission;

/// What a joint is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointParameters {
    /// Inertia of the motor `J_m`, kg m^2.
    pub motor_inertia: f64,
    /// Inertia of the load `J_l`, kg m^2.
    pub load_inertia: f64,
    /// Turns of the output for one turn of the motor, `r`.
    pub ratio: f64,
    /// The motor.
    pub motor: Motor,
    /// The transmission between them.
    pub transmission: Transmission,
    /// Friction on the motor.
    pub motor_friction: Friction,
    /// Friction on the load.
    pub load_friction: Friction,
    /// How far the load gives way before it slides, radians: under [`Contact`] at most `q_p`, zero
    /// for not at all; under [`MaxwellSlip`] along an exponential of `q_0`.
    pub presliding: f64,
    /// Constant torque on the load from outside, such as a preloading spring, N m.
    pub load_torque: f64,
}

/// A joint whose load gives way by the law `P`, ready to be integrated. Its changing part is a
/// [`JointState`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint<P = Contact> {
    parameters: JointParameters,
    presliding: P,
    inverse_motor_inertia: f64,
    inverse_load_inertia: f64,
    /// Rates at which viscous friction and back emf slow the bodies down, 1/s.
    motor_decay: f64,
    load_decay: f64,
    max_step: f64,
}

/// Positions, velocities and modes of a joint, and what its law of presliding remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointState<S = ()> {
    /// Motor angle `q_m`, radians.
    pub motor_angle: f64,
    /// Load angle `q_l`, radians.
    pub load_angle: f64,
    /// Motor velocity, rad/s; exactly zero while the motor is stuck.
    pub motor_velocity: f64,
    /// Load velocity, rad/s; exactly zero while the load is stuck.
    pub load_velocity: f64,
    /// What the motor does.
    pub motor_mode: Mode,
    /// What the load does.
    pub load_mode: Mode,
    /// Torque on the load from outside beside the constant one, N m: an input, held until it is
    /// set anew.
    pub load_torque: f64,
    /// What the law of presliding remembers.
    pub presliding: S,
}

/// What the accelerations are made of beside viscous friction and the spring, while the modes and
/// the voltage stay. A stuck body has all of its constants zero.
#[derive(Clone, Copy)]
pub(crate) struct Forcing {
    pub(crate) motor_gain: f64,
    pub(crate) motor_constant: f64,
    pub(crate) motor_spring: f64,
    pub(crate) load_constant: f64,
    pub(crate) load_spring: f64,
}

/// The end of a step, and the bodies' accelerations at both ends (the last to the accuracy of an
/// inner stage), which tell whether a velocity may have dipped inside.
struct Trial<S> {
    end: JointState<S>,
    motor_rates: (f64, f64),
    load_rates: (f64, f64),
}

/// A motor voltage as a function of time.
pub trait Voltage {
    /// The voltage `time` seconds after the start, volts.
    fn at(&self, time: f64) -> f64;
    /// Its rate of change, V/s.
    fn rate(&self, time: f64) -> f64;
    /// Whether it never changes.
    fn is_held(&self) -> bool {
        false
    }
}

/// A voltage that is held.
impl Voltage for f64 {
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "folds away in the hot loop")]
    fn at(&self, _: f64) -> f64 {
        *self
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "folds away in the hot loop")]
    fn rate(&self, _: f64) -> f64 {
        0.0
    }

    fn is_held(&self) -> bool {
        true
    }
}

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
const BREAK_AWAY_DELAY: f64 = 1e-11;

/// Share of its level within which [`MaxwellSlip`] friction counts as in balance with the torque
/// on the load: a ten-millionth of a micrometre on the way, and no endless ringing down.
const BALANCE: f64 = 1e-9;

impl JointParameters {
    /// The longest step, seconds, that resolves this joint's fastest motion: its viscous friction
    /// and, with the transmission wound up to the load's static friction, its resonance against
    /// a load that is held with `contact` N m/rad. Runge and Kutta's scheme falls apart at not quite
    /// twice that.
    pub fn coarsest_step(&self, contact: f64) -> f64 {
        let level = self.load_friction.static_level() + self.load_torque.abs();
        let twist = self.transmission.twist(level);
        let stiffness = self.transmission.stiffness(twist);
        let resonance = (stiffness
            * (self.ratio * self.ratio / self.motor_inertia + 1.0 / self.load_inertia)
            + contact / self.load_inertia)
            .sqrt();
        let motor = (self.motor.damping() + self.motor_friction.viscous()) / self.motor_inertia;
        let load = self.load_friction.viscous() / self.load_inertia;
        1.5 / resonance.max(motor).max(load)
    }
}

impl Joint {
    /// A joint after the thesis, integrated in steps of at most `max_step` seconds.
    ///
    /// One step a servo cycle errs by less than a thousandth of an encoder count: 3e-5 um on a
    /// z-stage, 1.4e-3 um on a five-bar whose load slides (1e-4 um in slow scans), whose viscous
    /// friction is stiff. The error falls with the fourth power of the step: 6e-5 um on a five-bar
    /// at half a cycle, and at 50 us reference solutions are met to 2e-3 nm.
    ///
    /// # Errors
    ///
    /// When an inertia, the ratio or the step is not positive, or the presliding is negative.
    pub fn new(parameters: JointParameters, max_step: f64) -> Result<Self, Invalid> {
        Invalid::non_negative("presliding", parameters.presliding)?;
        let contact = Contact::new(
            parameters.load_friction.static_level(),
            parameters.presliding,
        );
        Self::with(parameters, contact, max_step)
    }
}

impl Joint<MaxwellSlip> {
    /// A joint whose load friction is Maxwell-slip elements that slide at the Coulomb level, beside
    /// viscous friction. Static friction has no part in it.
    ///
    /// # Errors
    ///
    /// When an inertia, the ratio, the step, the Coulomb level or the presliding is not positive.
    pub fn maxwell_slip(mut parameters: JointParameters, max_step: f64) -> Result<Self, Invalid> {
        let friction = parameters.load_friction;
        let elements = MaxwellSlip::new(friction.coulomb(), parameters.presliding)?;
        let balance = BALANCE * friction.coulomb();
        parameters.load_friction = Friction::new(balance, 0.0, friction.viscous())?;
        Self::with(parameters, elements, max_step)
    }
}

impl Joint<LuGre> {
    /// A joint whose load friction is LuGre's, beside viscous friction: it gives way along an exponential
    /// of the presliding to the static level, which falls to the Coulomb level well above `stribeck` rad/s.
    ///
    /// # Errors
    ///
    /// When an inertia, the ratio, the step, the Coulomb level, the presliding or `stribeck` is not
    /// positive.
    pub fn lugre(
        mut parameters: JointParameters,
        stribeck: f64,
        max_step: f64,
    ) -> Result<Self, Invalid> {
        let friction = parameters.load_friction;
        let bristle = LuGre::new(&friction, parameters.presliding, stribeck)?;
        let balance = BALANCE * friction.coulomb();
        parameters.load_friction = Friction::new(balance, 0.0, friction.viscous())?;
        Self::with(parameters, bristle, max_step)
    }
}

impl<P: Presliding> Joint<P> {
    fn with(parameters: JointParameters, presliding: P, max_step: f64) -> Result<Self, Invalid> {
        let p = &parameters;
        Invalid::positive("ratio", p.ratio)?;
        if !p.load_torque.is_finite() {
            return Err(Invalid::new(
                "load_torque",
                p.load_torque,
                "a finite number",
            ));
        }
        let inverse_motor_inertia = 1.0 / Invalid::positive("motor_inertia", p.motor_inertia)?;
        let inverse_load_inertia = 1.0 / Invalid::positive("load_inertia", p.load_inertia)?;
        let motor_decay = (p.motor.damping() + p.motor_friction.viscous()) * inverse_motor_inertia;
        let load_decay = p.load_friction.viscous() * inverse_load_inertia;
        Ok(Self {
            presliding,
            inverse_motor_inertia,
            inverse_load_inertia,
            motor_decay,
            load_decay,
            max_step: Invalid::positive("max_step", max_step)?,
            parameters,
        })
    }

    pub(crate) fn motor_decay(&self) -> f64 {
        self.motor_decay
    }

    pub(crate) fn load_decay(&self) -> f64 {
        self.load_decay
    }

    pub(crate) fn max_step(&self) -> f64 {
        self.max_step
    }

    /// What the joint is made of.
    pub fn parameters(&self) -> &JointParameters {
        &self.parameters
    }

    /// Twist of the transmission `r q_m - q_l`, radians.
    pub fn twist(&self, state: &JointState<P::State>) -> f64 {
        self.parameters.ratio * state.motor_angle - state.load_angle
    }

    /// Torques other than friction on a motor at rest, `psi_m` of (2.7), N m.
    pub fn motor_psi(&self, state: &JointState<P::State>, voltage: f64) -> f64 {
        self.parameters.motor.gain() * voltage
            - self.parameters.ratio * self.parameters.transmission.torque(self.twist(state))
    }

    /// Torques other than friction on a load at rest, `psi_l` of (2.8), N m.
    pub fn load_psi(&self, state: &JointState<P::State>) -> f64 {
        self.parameters.transmission.torque(self.twist(state))
            + self.parameters.load_torque
            + state.load_torque
            - self
                .presliding
                .torque(&state.presliding, state.load_angle, state.load_velocity)
    }

    /// Position of the output `q_o = q_l - F_l / k_c` (2.12), radians.
    pub fn output(&self, state: &JointState<P::State>) -> f64 {
        let friction = self.parameters.load_friction.torque(
            state.load_mode,
            self.load_psi(state),
            state.load_velocity,
        );
        self.presliding.output(state.load_angle, friction)
    }

    /// Kinetic energy and energy in transmission and contact, joules.
    pub fn energy(&self, state: &JointState<P::State>) -> f64 {
        0.5 * self.parameters.motor_inertia * state.motor_velocity * state.motor_velocity
            + 0.5 * self.parameters.load_inertia * state.load_velocity * state.load_velocity
            + self.parameters.transmission.energy(self.twist(state))
            + self.presliding.energy(&state.presliding, state.load_angle)
    }

    /// Advances `state` by `duration` seconds under a voltage that is smooth over that time. At a
    /// jump of the voltage, advance to it and then from it.
    pub fn advance(
        &self,
        state: &mut JointState<P::State>,
        voltage: impl Voltage + Copy,
        duration: f64,
    ) {
        self.resolve(state, voltage.at(0.0));
        let mut time = 0.0;
        let mut events = 0;
        while time < duration && !self.is_at_rest_under(state, &voltage) {
            let step = (duration - time).min(self.max_step);
            let seen = Seen {
                voltage: &voltage,
                since: time,
            };
            let forcing = self.forcing(state);
            let load_held =
                state.load_mode == Mode::Stuck && !self.parameters.load_friction.is_free();
            let trial = if load_held {
                self.step_motor(state, &forcing, &seen, step)
            } else {
                self.step(state, &forcing, &seen, step)
            };
            match self.first_event(state, &forcing, &seen, &trial, step) {
                Some((body, after, at)) if events < MAX_EVENTS => {
                    *state = at;
                    self.change_mode(state, body, seen.at(after));
                    events += 1;
                    time += after;
                }
                _ => {
                    *state = trial.end;
                    time += step;
                }
            }
        }
    }

    /// Both bodies stuck, and nothing to come that could move them.
    #[inline]
    fn is_at_rest_under(&self, state: &JointState<P::State>, voltage: &impl Voltage) -> bool {
        self.is_at_rest(state) && voltage.is_held()
    }

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

    /// Decides the modes of bodies at rest, as the first thing after a jump of the voltage.
    pub fn resolve(&self, state: &mut JointState<P::State>, voltage: f64) {
        if state.motor_mode == Mode::Stuck {
            state.motor_mode = self
                .parameters
                .motor_friction
                .at_rest(self.motor_psi(state, voltage));
        }
        if state.load_mode == Mode::Stuck {
            state.load_mode = self.parameters.load_friction.at_rest(self.load_psi(state));
        }
    }

    pub(crate) fn is_at_rest(&self, state: &JointState<P::State>) -> bool {
        state.motor_mode == Mode::Stuck
            && state.load_mode == Mode::Stuck
            && !self.parameters.motor_friction.is_free()
            && !self.parameters.load_friction.is_free()
    }

    pub(crate) fn forcing(&self, state: &JointState<P::State>) -> Forcing {
        let p = &self.parameters;
        let moves = |mode: Mode, friction: &Friction| {
            if mode == Mode::Stuck && !friction.is_free() {
                0.0
            } else {
                1.0
            }
        };
        let motor = moves(state.motor_mode, &p.motor_friction) * self.inverse_motor_inertia;
        let load = moves(state.load_mode, &p.load_friction) * self.inverse_load_inertia;
        Forcing {
            motor_gain: motor * p.motor.gain(),
            motor_constant: -motor * state.motor_mode.sign() * p.motor_friction.coulomb(),
            motor_spring: motor * p.ratio,
            load_constant: load
                * (p.load_torque + state.load_torque
                    - state.load_mode.sign() * p.load_friction.coulomb()),
            load_spring: load,
        }
    }

    /// (2.9) and (2.10) with the modes frozen: accelerations of motor and load.
    #[inline]
    fn accelerations(
        &self,
        forcing: &Forcing,
        voltage: f64,
        twist: f64,
        (motor_velocity, load_velocity): (f64, f64),
        presliding: f64,
    ) -> (f64, f64) {
        let torque = self.parameters.transmission.torque(twist);
        (
            forcing.motor_constant + forcing.motor_gain * voltage
                - self.motor_decay * motor_velocity
                - forcing.motor_spring * torque,
            forcing.load_constant - self.load_decay * load_velocity
                + forcing.load_spring * (torque - presliding),
        )
    }

    /// The trial step that ends at `time`: for the few steps that contain an event.
    #[cold]
    #[inline(never)]
    fn trial_until<V: Voltage>(
        &self,
        s: &JointState<P::State>,
        forcing: &Forcing,
        seen: &Seen<V>,
        time: f64,
    ) -> Trial<P::State> {
        self.step(s, forcing, seen, time)
    }

    /// One classical fourth-order Runge-Kutta step of `h` seconds with the modes frozen.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "called once in the hot loop; 15 % of a joint cycle"
    )]
    fn step<V: Voltage>(
        &self,
        s: &JointState<P::State>,
        forcing: &Forcing,
        seen: &Seen<V>,
        h: f64,
    ) -> Trial<P::State> {
        let r = self.parameters.ratio;
        let half = 0.5 * h;
        let (u1, u2, u4) = (seen.at(0.0), seen.at(half), seen.at(h));
        let twist = r * s.motor_angle - s.load_angle;
        let (vm, vl) = (s.motor_velocity, s.load_velocity);
        let held = |moved: f64, velocity: f64| {
            self.presliding
                .torque(&s.presliding, s.load_angle + moved, velocity)
        };
        let a = |u, twist, vm, vl, moved| {
            self.accelerations(forcing, u, twist, (vm, vl), held(moved, vl))
        };
        let (am1, al1) = a(u1, twist, vm, vl, 0.0);
        // The angles' stages written out in accelerations: the same scheme in fewer operations.
        let drift = half * (r * vm - vl);
        let (am2, al2) = a(
            u2,
            twist + drift,
            vm + half * am1,
            vl + half * al1,
            half * vl,
        );
        let bend = half * half * (r * am1 - al1);
        let (am3, al3) = a(
            u2,
            twist + drift + bend,
            vm + half * am2,
            vl + half * al2,
            half * (vl + half * al1),
        );
        let bend = h * half * (r * am2 - al2);
        let (am4, al4) = a(
            u4,
            twist + 2.0 * drift + bend,
            vm + h * am3,
            vl + h * al3,
            h * (vl + half * al2),
        );
        let sixth = h * (1.0 / 6.0);
        let (am23, al23) = (am2 + am3, al2 + al3);
        Trial {
            end: JointState {
                motor_angle: s.motor_angle + h * (vm + sixth * (am1 + am23)),
                load_angle: s.load_angle + h * (vl + sixth * (al1 + al23)),
                motor_velocity: vm + sixth * (am1 + 2.0 * am23 + am4),
                load_velocity: vl + sixth * (al1 + 2.0 * al23 + al4),
                ..*s
            },
            motor_rates: (am1, am4),
            load_rates: (al1, al4),
        }
    }

    /// The same step while the load is stuck: only the motor moves.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "as for `step`")]
    fn step_motor<V: Voltage>(
        &self,
        s: &JointState<P::State>,
        forcing: &Forcing,
        seen: &Seen<V>,
        h: f64,
    ) -> Trial<P::State> {
        let r = self.parameters.ratio;
        let half = 0.5 * h;
        let twist = r * s.motor_angle - s.load_angle;
        let vm = s.motor_velocity;
        let a = |u: f64, angle: f64, velocity: f64| {
            forcing.motor_constant + forcing.motor_gain * u
                - self.motor_decay * velocity
                - forcing.motor_spring * self.parameters.transmission.torque(twist + r * angle)
        };
        let a1 = a(seen.at(0.0), 0.0, vm);
        let a2 = a(seen.at(half), half * vm, vm + half * a1);
        let a3 = a(seen.at(half), half * (vm + half * a1), vm + half * a2);
        let a4 = a(seen.at(h), h * (vm + half * a2), vm + h * a3);
        let sixth = h * (1.0 / 6.0);
        Trial {
            end: JointState {
                motor_angle: s.motor_angle + h * (vm + sixth * (a1 + a2 + a3)),
                motor_velocity: vm + sixth * (a1 + 2.0 * (a2 + a3) + a4),
                ..*s
            },
            motor_rates: (a1, a4),
            load_rates: (0.0, 0.0),
        }
    }

    /// The earliest mode change in a trial step of `length`, its time after the start, and the
    /// state just before it.
    #[inline]
    fn first_event<V: Voltage>(
        &self,
        start: &JointState<P::State>,
        forcing: &Forcing,
        seen: &Seen<V>,
        trial: &Trial<P::State>,
        length: f64,
    ) -> Option<(Body, f64, JointState<P::State>)> {
        let motor = self.event_of(Body::Motor, start, forcing, seen, (trial, length));
        let Some(time) = motor else {
            let time = self.event_of(Body::Load, start, forcing, seen, (trial, length))?;
            return Some((
                Body::Load,
                time,
                self.trial_until(start, forcing, seen, time).end,
            ));
        };
        // The load matters only if it changes before the motor does.
        let until = self.trial_until(start, forcing, seen, time);
        match self.event_of(Body::Load, start, forcing, seen, (&until, time)) {
            Some(earlier) if earlier < time => {
                let at = self.trial_until(start, forcing, seen, earlier);
                Some((Body::Load, earlier, at.end))
            }
            _ => Some((Body::Motor, time, until.end)),
        }
    }

    /// When the mode of one body ends within a trial step, if it does.
    #[inline]
    fn event_of<V: Voltage>(
        &self,
        body: Body,
        start: &JointState<P::State>,
        forcing: &Forcing,
        seen: &Seen<V>,
        (trial, length): (&Trial<P::State>, f64),
    ) -> Option<f64> {
        let at_end = self.margin(body, &trial.end, seen.at(length));
        if at_end < 0.0 {
            return Some(self.event_before(
                body,
                start,
                forcing,
                seen,
                (length, at_end, &trial.end),
            ));
        }
        // A velocity may have dipped below zero and come back. The torque on a stuck body cannot,
        // as long as the other body does not turn round, which would be an event itself.
        let (rates, mode) = match body {
            Body::Motor => (trial.motor_rates, start.motor_mode),
            Body::Load => (trial.load_rates, start.load_mode),
        };
        let rates = (rates.0 * mode.sign(), rates.1 * mode.sign());
        if rates.0 < 0.0 && rates.1 > 0.0 {
            self.event_in_dip(body, start, forcing, seen, (rates, length, at_end))
        } else {
            None
        }
    }

    #[cold]
    fn event_in_dip<V: Voltage>(
        &self,
        body: Body,
        start: &JointState<P::State>,
        forcing: &Forcing,
        seen: &Seen<V>,
        (rates, length, at_end): ((f64, f64), f64, f64),
    ) -> Option<f64> {
        let at_start = self.margin(body, start, seen.at(0.0));
        let (time, lowest) = interior_minimum(at_start, rates.0, at_end, rates.1, length)?;
        if lowest >= 0.0 {
            return None;
        }
        let middle = self.trial_until(start, forcing, seen, time).end;
        let dip = self.margin(body, &middle, seen.at(time));
        (dip < 0.0).then(|| self.event_before(body, start, forcing, seen, (time, dip, &middle)))
    }

    /// The time at which a margin that is negative at `end` became so.
    #[cold]
    fn event_before<V: Voltage>(
        &self,
        body: Body,
        start: &JointState<P::State>,
        forcing: &Forcing,
        seen: &Seen<V>,
        (length, at_end, end): (f64, f64, &JointState<P::State>),
    ) -> f64 {
        let rate_of = |s: &JointState<P::State>, time: f64| {
            let (u, rate) = (seen.at(time), seen.voltage.rate(seen.since + time));
            self.margin_rate(body, s, forcing, (u, rate))
        };
        let margin_and_rate = |s: &JointState<P::State>, time: f64| {
            (self.margin(body, s, seen.at(time)), rate_of(s, time))
        };
        let at =
            |time: f64| margin_and_rate(&self.trial_until(start, forcing, seen, time).end, time);
        let (margin, rate) = margin_and_rate(start, 0.0);
        if margin <= 0.0 && rate <= 0.0 {
            return 0.0;
        }
        let end = (length, at_end, rate_of(end, length));
        let time = descent(at, (margin, rate), end);
        let mode = match body {
            Body::Motor => start.motor_mode,
            Body::Load => start.load_mode,
        };
        if mode == Mode::Stuck {
            (time + BREAK_AWAY_DELAY).min(length)
        } else {
            time
        }
    }

    /// How far a body is from the end of its mode, positive while the mode lasts: the speed of
    /// one that slides, the torque that is missing to break away for one that is stuck.
    #[inline]
    fn margin(&self, body: Body, s: &JointState<P::State>, voltage: f64) -> f64 {
        let (friction, mode, velocity) = match body {
            Body::Motor => (
                &self.parameters.motor_friction,
                s.motor_mode,
                s.motor_velocity,
            ),
            Body::Load => (&self.parameters.load_friction, s.load_mode, s.load_velocity),
        };
        if friction.is_free() {
            f64::INFINITY
        } else if mode == Mode::Stuck {
            friction.static_level() - self.psi(body, s, voltage).abs()
        } else {
            velocity * mode.sign()
        }
    }

    /// Rate of change of [`Self::margin`] under a voltage and its rate of change.
    fn margin_rate(
        &self,
        body: Body,
        s: &JointState<P::State>,
        forcing: &Forcing,
        (voltage, voltage_rate): (f64, f64),
    ) -> f64 {
        let p = &self.parameters;
        let twist = self.twist(s);
        let mode = match body {
            Body::Motor => s.motor_mode,
            Body::Load => s.load_mode,
        };
        if mode == Mode::Stuck {
            // psi changes by the other body's motion through the spring, and with the voltage.
            let spring = p.transmission.stiffness(twist) * p.ratio;
            let psi_rate = match body {
                Body::Motor => spring * s.load_velocity + p.motor.gain() * voltage_rate,
                Body::Load => spring * s.motor_velocity,
            };
            return -psi_rate * self.psi(body, s, voltage).signum();
        }
        let (motor, load) = self.accelerations(
            forcing,
            voltage,
            twist,
            (s.motor_velocity, s.load_velocity),
            self.presliding
                .torque(&s.presliding, s.load_angle, s.load_velocity),
        );
        mode.sign()
            * match body {
                Body::Motor => motor,
                Body::Load => load,
            }
    }

    #[inline]
    fn psi(&self, body: Body, s: &JointState<P::State>, voltage: f64) -> f64 {
        match body {
            Body::Motor => self.motor_psi(s, voltage),
            Body::Load => self.load_psi(s),
        }
    }
}
