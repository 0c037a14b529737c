//! Joints of one kind, stepped together: under held voltages in a few steps a cycle, finely where an
//! amplifier plays a pulse.

use super::TwinError;
use super::plant::{JointPlant, LoadLaw};
use super::sensors::normal;
use super::unrest::UnrestPlant;
use pigtail_hal::Pulse;
use pigtail_hal::quantity::Volts;
use pigtail_model::Invalid;
use pigtail_model::friction::Mode;
use pigtail_model::group::{Group, States};
use pigtail_model::instructions::Instructions;
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_model::lugre::LuGre;
use pigtail_model::presliding::{MaxwellSlip, Presliding};
use pigtail_model::pulse::{From, Pulse as Waveform};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// More integration steps in a servo cycle than this are not a stiff joint but a mistyped one.
const MOST_STEPS: f64 = 100.0;

/// Longest step, seconds, while a pulse plays and until what it set moving has come to rest: the
/// displacement is then that of reference solutions to 1e-3 nm.
const FINE_STEP: f64 = 25e-6;

/// What a pulse set moving is taken for a common motion after so many cycles.
const WAKE: u32 = 125;

/// A joint that has rested for so many cycles may have been displaced in the meantime.
const RESTED: u32 = 13;

/// Friction that drifts is changed every so many cycles.
const DRIFT_EVERY: u64 = 100;

/// Friction that differs along the travel is changed so often in a period.
const LOOKS: f64 = 64.0;

/// Joints of one kind.
#[derive(Debug, Clone)]
pub(super) struct Joints<const N: usize> {
    law: Law<N>,
    parameters: [JointParameters; N],
    playing: [Option<Playing>; N],
    /// Cycles for which each joint is still stepped finely.
    wake: [u32; N],
    /// Cycles since each joint's last pulse, as far as it matters.
    rested: [u32; N],
    /// By what factor each joint's friction has changed at once.
    stiffened: [f64; N],
    /// By what factor all friction has changed with time.
    drifted: f64,
    unrest: UnrestPlant,
    /// Whether there is anything of that.
    stirs: bool,
    stribeck: f64,
    instructions: Instructions,
    /// Constant torque on each load that makes its friction differ in the two directions, N m, and
    /// what it would displace the outputs by at rest, radians.
    lean: [(f64, f64); N],
    /// By what factor friction is higher where each joint stands, where that was last looked at (radians of
    /// the output), and where along its period the joint's home lies (radians of the period).
    place: [(f64, f64, f64); N],
    /// Most that each amplifier gives, amperes.
    current: f64,
    cycle: u64,
    period: f64,
    least: f64,
    /// What displaces motors at rest.
    rng: Pcg64Mcg,
}

/// A law of load friction, and the states under it.
#[derive(Debug, Clone)]
enum Law<const N: usize> {
    /// After the thesis: (2.7), (2.8), (2.12), (2.13).
    CoulombPresliding {
        coarse: Group<N>,
        fine: [Joint; N],
        states: States<N>,
    },
    /// Maxwell-slip elements.
    MaxwellSlip(Vec<Slipping<MaxwellSlip>>),
    /// LuGre.
    LuGre(Vec<Slipping<LuGre>>),
}

/// A joint whose load never holds rigidly.
#[derive(Debug, Clone, Copy)]
struct Slipping<P: Presliding> {
    coarse: Joint<P>,
    fine: Joint<P>,
    state: JointState<P::State>,
}

/// A pulse on its way.
#[derive(Debug, Clone, Copy)]
struct Playing {
    waveform: Waveform,
    /// How much of it has passed, seconds.
    since: f64,
}

impl<const N: usize> Joints<N> {
    /// Joints `name`, for errors, in cycles of `period` seconds of at least so many steps. `seed` is
    /// that of what happens to them at rest.
    pub(super) fn new(
        plant: &JointPlant,
        parameters: [JointParameters; N],
        name: &'static str,
        (period, least): (f64, f64),
        seed: u64,
    ) -> Result<Self, TwinError> {
        let (unrest, stribeck) = (plant.unrest, plant.stribeck);
        for p in &parameters {
            let contact = match plant.friction {
                LoadLaw::CoulombPresliding => 0.0,
                LoadLaw::MaxwellSlip => elements(p)?.initial_stiffness(),
                LoadLaw::LuGre => bristle(p, stribeck)?.initial_stiffness(),
            };
            let steps = steps(p, contact, period, least);
            if steps > MOST_STEPS {
                return Err(TwinError::Stiff { axis: name, steps });
            }
        }
        let homed = |p: &JointParameters| p.transmission.twist(-p.load_torque) / p.ratio;
        let law = match plant.friction {
            LoadLaw::CoulombPresliding => {
                let (coarse, fine) = pairs(&parameters, period, least)?;
                let states = States::new(std::array::from_fn(|i| JointState {
                    motor_angle: homed(&parameters[i]),
                    ..JointState::default()
                }));
                Law::CoulombPresliding {
                    coarse: Group::new(coarse, period),
                    fine,
                    states,
                }
            }
            LoadLaw::MaxwellSlip => Law::MaxwellSlip(
                parameters
                    .iter()
                    .map(|p| Ok(Slipping::at(slipping(p, period, least)?, homed(p))))
                    .collect::<Result<_, Invalid>>()?,
            ),
            LoadLaw::LuGre => Law::LuGre(
                parameters
                    .iter()
                    .map(|p| {
                        Ok(Slipping::at(
                            bristling(p, stribeck, period, least)?,
                            homed(p),
                        ))
                    })
                    .collect::<Result<_, Invalid>>()?,
            ),
        };
        let lean = parameters.map(|p| {
            let torque = -unrest.asymmetry * p.load_friction.coulomb();
            let level = p.load_friction.static_level();
            let yields = matches!(law, Law::CoulombPresliding { .. }) && level > 0.0;
            (
                torque,
                if yields {
                    torque * p.presliding / level
                } else {
                    0.0
                },
            )
        });
        let mut rng = Pcg64Mcg::seed_from_u64(seed ^ unrest.history.rotate_left(32));
        let mut place = [(1.0, f64::INFINITY, 0.0); N];
        if unrest.place != 0.0 {
            for (_, _, phase) in &mut place {
                *phase = TAU * rng.random::<f64>();
            }
        }
        Ok(Self {
            law,
            parameters,
            place,
            current: plant.motor.current,
            playing: [None; N],
            wake: [0; N],
            rested: [RESTED; N],
            stiffened: [1.0; N],
            drifted: 1.0,
            stirs: !unrest.is_none(),
            unrest,
            stribeck,
            instructions: Instructions::widest(),
            lean,
            cycle: 0,
            period,
            least,
            rng,
        })
    }

    /// One cycle under held voltages, torques on the loads from outside (N m), and pulses that
    /// begin. Angles of the outputs then, as [`Self::outputs`] says.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    pub(super) fn advance(
        &mut self,
        mut voltages: [f64; N],
        mut torques: [f64; N],
        pulses: [&Option<Pulse>; N],
    ) -> [f64; N] {
        if self.current.is_finite() {
            for (i, voltage) in voltages.iter_mut().enumerate() {
                let motor = &self.parameters[i].motor;
                *voltage = motor.within(self.current, *voltage, self.motor_velocity(i));
            }
        }
        if self.stirs {
            self.stir(&mut torques);
        }
        let begins = pulses.iter().any(|pulse| pulse.is_some());
        if begins || self.wake != [0; N] {
            self.advance_finely(voltages, torques, pulses);
        } else if let Law::CoulombPresliding { coarse, states, .. } = &mut self.law {
            states.set_load_torques(torques);
            let mut outputs = coarse.advance_outputs(self.instructions, states, voltages);
            for (output, (_, lean)) in outputs.iter_mut().zip(&self.lean) {
                *output -= lean;
            }
            return outputs;
        } else {
            self.law.advance(voltages, torques, self.period);
        }
        self.outputs()
    }

    #[cold]
    fn advance_finely(
        &mut self,
        voltages: [f64; N],
        torques: [f64; N],
        pulses: [&Option<Pulse>; N],
    ) {
        for i in 0..N {
            if let Some(pulse) = pulses[i] {
                if self.unrest.jolt > 0.0 && self.rested[i] >= RESTED {
                    let way = self.unrest.jolt * normal(&mut self.rng);
                    self.law.displace(i, way);
                }
                let (motor, velocity) = (&self.parameters[i].motor, self.motor_velocity(i));
                let within = |volts: Volts| motor.within(self.current, volts.0, velocity);
                let waveform = Waveform {
                    amplitudes: pulse.amplitudes.map(within),
                    period: pulse.period,
                };
                let since = 0.0;
                self.playing[i] = Some(Playing { waveform, since });
            }
            if let Some(playing) = &mut self.playing[i] {
                let on = (playing.waveform.period - playing.since).clamp(0.0, self.period);
                let waveform = From {
                    voltage: playing.waveform,
                    since: playing.since,
                };
                let wave = Some((waveform, on));
                self.law
                    .advance_one(i, (voltages[i], wave), torques[i], self.period);
                playing.since += self.period;
                if playing.since >= playing.waveform.period {
                    self.playing[i] = None;
                }
                self.wake[i] = WAKE;
                self.rested[i] = 0;
            } else {
                self.law
                    .advance_one(i, (voltages[i], None), torques[i], self.period);
                self.wake[i] = self.wake[i].saturating_sub(1);
                if self.law.is_stuck(i) {
                    self.wake[i] = 0;
                }
            }
        }
    }

    /// Friction is not the same at all times and in both directions.
    #[cold]
    fn stir(&mut self, torques: &mut [f64; N]) {
        for (torque, (lean, _)) in torques.iter_mut().zip(&self.lean) {
            *torque += lean;
        }
        for rested in &mut self.rested {
            *rested = (*rested + 1).min(RESTED);
        }
        if self.unrest.drift != 0.0 && self.cycle.is_multiple_of(DRIFT_EVERY) {
            let time = self.cycle as f64 * self.period;
            let share = (time / self.unrest.drift_time).min(1.0);
            self.drifted = 1.0 + self.unrest.drift * share;
            // What is drawn from valid levels by a factor above zero is valid too.
            let _ = self.scale_friction(self.drifted);
        }
        self.cycle += 1;
        if self.unrest.place != 0.0 {
            self.look_where_they_are();
        }
    }

    /// Friction is not the same everywhere.
    fn look_where_they_are(&mut self) {
        let mut changed = false;
        for i in 0..N {
            let at = self.output(i);
            let (factor, looked_at, phase) = &mut self.place[i];
            if (at - *looked_at).abs() >= self.unrest.place_period / LOOKS {
                *looked_at = at;
                let along = TAU * at / self.unrest.place_period + *phase;
                *factor = 1.0 + self.unrest.place * along.sin();
                changed = true;
            }
        }
        if changed {
            // What is drawn from valid levels by a factor above zero is valid too.
            let _ = self.scale_friction(self.drifted);
        }
    }

    /// All friction of a joint becomes so many times what it was drawn as.
    pub(super) fn stiffen(&mut self, i: usize, by: f64) {
        self.stiffened[i] *= by;
        // What is drawn from valid levels by a factor above zero is valid too.
        let _ = self.scale_friction(self.drifted);
    }

    fn scale_friction(&mut self, by: f64) -> Result<(), Invalid> {
        let mut scaled = self.parameters;
        let more = self.stiffened.iter().zip(&self.place);
        for (p, (more, (there, ..))) in scaled.iter_mut().zip(more) {
            let by = by * more * there;
            p.motor_friction = p.motor_friction.scaled(by)?;
            p.load_friction = p.load_friction.scaled(by)?;
            // The contact stays as stiff as it is.
            if matches!(self.law, Law::CoulombPresliding { .. }) {
                p.presliding *= by;
            }
        }
        match &mut self.law {
            Law::CoulombPresliding { coarse, fine, .. } => {
                let (new, finer) = pairs(&scaled, self.period, self.least)?;
                (*coarse, *fine) = (Group::new(new, self.period), finer);
            }
            Law::MaxwellSlip(joints) => {
                for (joint, p) in joints.iter_mut().zip(&scaled) {
                    (joint.coarse, joint.fine) = slipping(p, self.period, self.least)?;
                }
            }
            Law::LuGre(joints) => {
                for (joint, p) in joints.iter_mut().zip(&scaled) {
                    (joint.coarse, joint.fine) =
                        bristling(p, self.stribeck, self.period, self.least)?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn motor_angles(&self) -> [f64; N] {
        match &self.law {
            Law::CoulombPresliding { states, .. } => states.motor_angles(),
            _ => std::array::from_fn(|i| self.motor_angle(i)),
        }
    }

    pub(super) fn motor_angle(&self, i: usize) -> f64 {
        match &self.law {
            Law::CoulombPresliding { states, .. } => states.motor_angle(i),
            Law::MaxwellSlip(joints) => joints[i].state.motor_angle,
            Law::LuGre(joints) => joints[i].state.motor_angle,
        }
    }

    fn motor_velocity(&self, i: usize) -> f64 {
        match &self.law {
            Law::CoulombPresliding { states, .. } => states.motor_velocity(i),
            Law::MaxwellSlip(joints) => joints[i].state.motor_velocity,
            Law::LuGre(joints) => joints[i].state.motor_velocity,
        }
    }

    fn output(&self, i: usize) -> f64 {
        match &self.law {
            Law::CoulombPresliding { coarse, states, .. } => {
                coarse.joints()[i].output(&states.get(i)) - self.lean[i].1
            }
            Law::MaxwellSlip(joints) => joints[i].coarse.output(&joints[i].state),
            Law::LuGre(joints) => joints[i].coarse.output(&joints[i].state),
        }
    }

    /// Angles of the outputs, (2.12), radians.
    pub(super) fn outputs(&self) -> [f64; N] {
        match &self.law {
            Law::CoulombPresliding { coarse, states, .. } => {
                let outputs = coarse.outputs(states);
                std::array::from_fn(|i| outputs[i] - self.lean[i].1)
            }
            _ => std::array::from_fn(|i| self.output(i)),
        }
    }
}

impl<const N: usize> Law<N> {
    #[inline]
    fn advance(&mut self, voltages: [f64; N], torques: [f64; N], period: f64) {
        match self {
            Self::CoulombPresliding { coarse, states, .. } => {
                states.set_load_torques(torques);
                coarse.advance(states, voltages);
            }
            Self::MaxwellSlip(joints) => {
                for (i, joint) in joints.iter_mut().enumerate() {
                    joint.advance(voltages[i], torques[i], period);
                }
            }
            Self::LuGre(joints) => {
                for (i, joint) in joints.iter_mut().enumerate() {
                    joint.advance(voltages[i], torques[i], period);
                }
            }
        }
    }

    /// One joint alone, finely: a waveform for so many seconds, then the held voltage.
    fn advance_one(&mut self, i: usize, (held, wave): (f64, Wave), torque: f64, period: f64) {
        match self {
            Self::CoulombPresliding { fine, states, .. } => {
                let mut state = states.get(i);
                state.load_torque = torque;
                play(&fine[i], &mut state, (held, wave), period);
                states.set(i, &state);
            }
            Self::MaxwellSlip(joints) => joints[i].advance_finely((held, wave), torque, period),
            Self::LuGre(joints) => joints[i].advance_finely((held, wave), torque, period),
        }
    }

    fn is_stuck(&self, i: usize) -> bool {
        let (motor, load) = match self {
            Self::CoulombPresliding { states, .. } => {
                let state = states.get(i);
                (state.motor_mode, state.load_mode)
            }
            Self::MaxwellSlip(joints) => joints[i].modes(),
            Self::LuGre(joints) => joints[i].modes(),
        };
        motor == Mode::Stuck && load == Mode::Stuck
    }

    fn displace(&mut self, i: usize, by: f64) {
        match self {
            Self::CoulombPresliding { states, .. } => {
                let mut state = states.get(i);
                state.motor_angle += by;
                states.set(i, &state);
            }
            Self::MaxwellSlip(joints) => joints[i].state.motor_angle += by,
            Self::LuGre(joints) => joints[i].state.motor_angle += by,
        }
    }
}

/// A pulse on its way and for how long, seconds.
type Wave = Option<(From<Waveform>, f64)>;

/// A waveform first, then the held voltage.
fn play<P: Presliding>(
    joint: &Joint<P>,
    state: &mut JointState<P::State>,
    (held, wave): (f64, Wave),
    period: f64,
) {
    let on = wave.map_or(0.0, |(_, on)| on);
    if let Some((waveform, on)) = wave {
        joint.advance(state, waveform, on);
    }
    if period > on {
        joint.advance(state, held, period - on);
    }
}

impl<P: Presliding> Slipping<P> {
    fn at((coarse, fine): (Joint<P>, Joint<P>), motor_angle: f64) -> Self {
        let state = JointState {
            motor_angle,
            ..JointState::default()
        };
        Self {
            coarse,
            fine,
            state,
        }
    }

    fn advance(&mut self, voltage: f64, torque: f64, period: f64) {
        self.state.load_torque = torque;
        self.coarse.advance(&mut self.state, voltage, period);
    }

    fn advance_finely(&mut self, voltage: (f64, Wave), torque: f64, period: f64) {
        self.state.load_torque = torque;
        play(&self.fine, &mut self.state, voltage, period);
    }

    fn modes(&self) -> (Mode, Mode) {
        (self.state.motor_mode, self.state.load_mode)
    }
}

/// Steps a cycle that a joint needs.
fn steps(p: &JointParameters, contact: f64, period: f64, least: f64) -> f64 {
    (period / p.coarsest_step(contact)).ceil().max(least)
}

fn elements(p: &JointParameters) -> Result<MaxwellSlip, Invalid> {
    MaxwellSlip::new(p.load_friction.coulomb(), p.presliding)
}

/// Joints for common motions and for pulses.
fn pairs<const N: usize>(
    parameters: &[JointParameters; N],
    period: f64,
    least: f64,
) -> Result<([Joint; N], [Joint; N]), Invalid> {
    let (mut coarse, mut fine) = (Vec::with_capacity(N), Vec::with_capacity(N));
    for p in parameters {
        let step = period / steps(p, 0.0, period, least);
        coarse.push(Joint::new(*p, step)?);
        fine.push(Joint::new(*p, step.min(FINE_STEP))?);
    }
    Ok((
        std::array::from_fn(|i| coarse[i]),
        std::array::from_fn(|i| fine[i]),
    ))
}

/// The same under Maxwell-slip friction.
fn slipping(
    p: &JointParameters,
    period: f64,
    least: f64,
) -> Result<(Joint<MaxwellSlip>, Joint<MaxwellSlip>), Invalid> {
    let contact = elements(p)?.initial_stiffness();
    // Two steps where one would do: the elements' kinks are not smooth.
    let step = 0.5 * period / steps(p, contact, period, least);
    Ok((
        Joint::maxwell_slip(*p, step)?,
        Joint::maxwell_slip(*p, step.min(FINE_STEP))?,
    ))
}

fn bristle(p: &JointParameters, stribeck: f64) -> Result<LuGre, Invalid> {
    LuGre::new(&p.load_friction, p.presliding, stribeck)
}

/// The same under LuGre friction.
fn bristling(
    p: &JointParameters,
    stribeck: f64,
    period: f64,
    least: f64,
) -> Result<(Joint<LuGre>, Joint<LuGre>), Invalid> {
    let contact = bristle(p, stribeck)?.initial_stiffness();
    let step = period / steps(p, contact, period, least);
    Ok((
        Joint::lugre(*p, stribeck, step)?,
        Joint::lugre(*p, stribeck, step.min(FINE_STEP))?,
    ))
}
