//! One joint: motor, flexible transmission and load, each with friction, (2.1)-(2.13).
//!
//! # How a step is taken
//!
//! Each body is in a [`Mode`]: it slides forward, slides backward, or is stuck. While the modes
//! stay, the equations of motion are smooth and one step of a whole servo cycle is accurate to a
//! tenth of a nanometre (an exponential Nystrom method: viscous friction is solved exactly, the
//! transmission's torque is interpolated). What spoils a fixed-step method is the instant at
//! which a mode changes. After each trial step this integrator therefore looks for
//! two kinds of event: the velocity of a sliding body reaches zero, or the torque on a stuck body
//! reaches its static friction. The earliest is found as a root on what the step has interpolated,
//! the state is taken there, the velocity is set to exactly zero, the mode is decided by (2.7)
//! and (2.8), and the rest of the step is taken from there.

mod step;

use crate::Invalid;
use crate::friction::{Friction, Mode};
use crate::lugre::LuGre;
use crate::motor::Motor;
use crate::presliding::{Contact, MaxwellSlip, Presliding};
use crate::transmission::Transmission;
pub(crate) use step::{BREAK_AWAY_DELAY, SLOWS, Scheme};

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
    scheme: Scheme,
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

/// Share of its level within which [`MaxwellSlip`] friction counts as in balance with the torque
/// on the load: a ten-millionth of a micrometre on the way, and no endless ringing down.
const BALANCE: f64 = 1e-9;

impl JointParameters {
    /// The longest step, seconds, that resolves this joint's resonance, with the transmission wound up to
    /// the load's static friction, against a load that is held with `contact` N m/rad. Steps fall apart
    /// at twice that. Viscous friction and back emf are solved exactly and set no bound.
    pub fn coarsest_step(&self, contact: f64) -> f64 {
        let level = self.load_friction.static_level() + self.load_torque.abs();
        let twist = self.transmission.twist(level);
        let stiffness = self.transmission.stiffness(twist);
        let resonance = (stiffness
            * (self.ratio * self.ratio / self.motor_inertia + 1.0 / self.load_inertia)
            + contact / self.load_inertia)
            .sqrt();
        1.5 / resonance
    }
}

impl Joint {
    pub(crate) fn contact(&self) -> f64 {
        self.presliding.stiffness()
    }

    /// A joint after the thesis, integrated in steps of at most `max_step` seconds.
    ///
    /// One step a servo cycle errs by 2e-6 um on a z-stage; on a five-bar by 1.3e-5 um in slow scans,
    /// 1e-4 um in a sine of 8 Hz, and 2.2e-4 um where the full voltage jolts it from rest. At 50 us
    /// reference solutions are met to 1e-3 nm.
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
        Invalid::positive("max_step", max_step)?;
        Ok(Self {
            presliding,
            inverse_motor_inertia,
            inverse_load_inertia,
            motor_decay,
            load_decay,
            scheme: Scheme::new(motor_decay, load_decay, max_step),
            parameters,
        })
    }

    pub(crate) fn motor_decay(&self) -> f64 {
        self.motor_decay
    }

    pub(crate) fn load_decay(&self) -> f64 {
        self.load_decay
    }

    pub(crate) fn scheme(&self) -> &Scheme {
        &self.scheme
    }

    pub(crate) fn scheme_for(&self, length: f64) -> Scheme {
        Scheme::new(self.motor_decay, self.load_decay, length)
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

    /// Decides the modes of bodies at rest, as the first thing after a jump of the voltage. A body that
    /// nothing holds has none.
    pub fn resolve(&self, state: &mut JointState<P::State>, voltage: f64) {
        let (motor, load) = (
            &self.parameters.motor_friction,
            &self.parameters.load_friction,
        );
        if state.motor_mode == Mode::Stuck && !motor.is_free() {
            state.motor_mode = motor.at_rest(self.motor_psi(state, voltage));
        }
        if state.load_mode == Mode::Stuck && !load.is_free() {
            state.load_mode = load.at_rest(self.load_psi(state));
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
}
