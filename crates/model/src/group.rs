//! Several joints stepped side by side.
//!
//! While no mode changes, a step of one joint is a chain of a few dozen operations each of which
//! waits for the one before. Joints do not wait for each other: stage by stage over all of them,
//! a processor does two or more at once. A joint in whose step a mode may change is taken out and
//! stepped by itself, as [`Joint::advance`] does it.

use crate::friction::Mode;
use crate::joint::{Forcing, Joint, JointState};

/// `N` joints that are stepped together.
#[derive(Debug, Clone, PartialEq)]
pub struct Group<const N: usize> {
    joints: [Joint; N],
    ratio: [f64; N],
    linear: [f64; N],
    cubic: [f64; N],
    motor_decay: [f64; N],
    load_decay: [f64; N],
    motor_level: [f64; N],
    load_level: [f64; N],
    /// Steps in so many seconds are the longest that any of them may take.
    max_step: f64,
}

/// A number for each joint.
type Each<const N: usize> = [f64; N];

impl<const N: usize> Group<N> {
    /// A group of these joints. All of them take as many steps as the one that needs most.
    pub fn new(joints: [Joint; N]) -> Self {
        let of = |value: fn(&Joint) -> f64| std::array::from_fn(|i| value(&joints[i]));
        Self {
            ratio: of(|j| j.parameters().ratio),
            linear: of(|j| j.parameters().transmission.linear()),
            cubic: of(|j| j.parameters().transmission.cubic()),
            motor_decay: of(Joint::motor_decay),
            load_decay: of(Joint::load_decay),
            motor_level: of(|j| level(j.parameters().motor_friction)),
            load_level: of(|j| level(j.parameters().load_friction)),
            max_step: joints
                .iter()
                .fold(f64::INFINITY, |h, j| h.min(j.max_step())),
            joints,
        }
    }

    /// The joints.
    pub fn joints(&self) -> &[Joint; N] {
        &self.joints
    }

    /// Advances all states by `duration` seconds, each under a held voltage.
    pub fn advance(&self, states: &mut [JointState; N], voltages: [f64; N], duration: f64) {
        let steps = (duration / self.max_step).ceil().max(1.0);
        let h = duration / steps;
        for (i, joint) in self.joints.iter().enumerate() {
            joint.resolve(&mut states[i], voltages[i]);
        }
        for _ in 0..steps as usize {
            self.step(states, &voltages, h);
        }
    }

    /// One step of `h` seconds.
    #[inline]
    fn step(&self, states: &mut [JointState; N], voltages: &[f64; N], h: f64) {
        if (0..N).all(|i| self.joints[i].is_at_rest(&states[i])) {
            return;
        }
        let forcing: [Forcing; N] = std::array::from_fn(|i| self.joints[i].forcing(&states[i]));
        let of =
            |value: fn(&Forcing) -> f64| -> Each<N> { std::array::from_fn(|i| value(&forcing[i])) };
        let motor_drive: Each<N> = std::array::from_fn(|i| {
            forcing[i].motor_constant + forcing[i].motor_gain * voltages[i]
        });
        let (motor_spring, load_constant, load_spring) = (
            of(|f| f.motor_spring),
            of(|f| f.load_constant),
            of(|f| f.load_spring),
        );
        let vm: Each<N> = std::array::from_fn(|i| states[i].motor_velocity);
        let vl: Each<N> = std::array::from_fn(|i| states[i].load_velocity);
        let twist: Each<N> =
            std::array::from_fn(|i| self.ratio[i] * states[i].motor_angle - states[i].load_angle);
        let accelerations = |w: &Each<N>, vm: &Each<N>, vl: &Each<N>| -> (Each<N>, Each<N>) {
            let (mut am, mut al) = ([0.0; N], [0.0; N]);
            for i in 0..N {
                let torque = w[i] * (self.linear[i] + self.cubic[i] * w[i] * w[i]);
                am[i] = motor_drive[i] - self.motor_decay[i] * vm[i] - motor_spring[i] * torque;
                al[i] = load_constant[i] - self.load_decay[i] * vl[i] + load_spring[i] * torque;
            }
            (am, al)
        };
        let half = 0.5 * h;
        let mut w = [0.0; N];
        let (mut m, mut l) = ([0.0; N], [0.0; N]);
        let (am1, al1) = accelerations(&twist, &vm, &vl);
        for i in 0..N {
            w[i] = twist[i] + half * (self.ratio[i] * vm[i] - vl[i]);
            m[i] = vm[i] + half * am1[i];
            l[i] = vl[i] + half * al1[i];
        }
        let (am2, al2) = accelerations(&w, &m, &l);
        for i in 0..N {
            w[i] = twist[i] + half * (self.ratio[i] * m[i] - l[i]);
            m[i] = vm[i] + half * am2[i];
            l[i] = vl[i] + half * al2[i];
        }
        let (am3, al3) = accelerations(&w, &m, &l);
        for i in 0..N {
            w[i] = twist[i] + h * (self.ratio[i] * m[i] - l[i]);
            m[i] = vm[i] + h * am3[i];
            l[i] = vl[i] + h * al3[i];
        }
        let (am4, al4) = accelerations(&w, &m, &l);
        let sixth = h * (1.0 / 6.0);
        let (mut qm, mut ql) = ([0.0; N], [0.0; N]);
        for i in 0..N {
            let (am23, al23) = (am2[i] + am3[i], al2[i] + al3[i]);
            qm[i] = h * (vm[i] + sixth * (am1[i] + am23));
            ql[i] = h * (vl[i] + sixth * (al1[i] + al23));
            m[i] = vm[i] + sixth * (am1[i] + 2.0 * am23 + am4[i]);
            l[i] = vl[i] + sixth * (al1[i] + 2.0 * al23 + al4[i]);
        }
        for i in 0..N {
            let state = &mut states[i];
            let joint = &self.joints[i];
            let end = JointState {
                motor_angle: state.motor_angle + qm[i],
                load_angle: state.load_angle + ql[i],
                motor_velocity: m[i],
                load_velocity: l[i],
                ..*state
            };
            let torque = joint.parameters().transmission.torque(joint.twist(&end));
            let motor = keeps(state.motor_mode, (am1[i], am4[i]), m[i], || {
                let psi = joint.parameters().motor.gain() * voltages[i] - self.ratio[i] * torque;
                self.motor_level[i] - psi.abs()
            });
            let load = keeps(state.load_mode, (al1[i], al4[i]), l[i], || {
                let psi = torque + joint.parameters().load_torque + state.load_torque;
                self.load_level[i] - psi.abs()
            });
            if motor && load {
                *state = end;
            } else {
                joint.advance(state, voltages[i], h);
            }
        }
    }
}

/// Static friction, and infinitely much of it for a body that nothing holds: it has no modes.
fn level(friction: crate::friction::Friction) -> f64 {
    if friction.is_free() {
        f64::INFINITY
    } else {
        friction.static_level()
    }
}

/// Whether a body certainly stays in its mode over a step with these accelerations at its ends, this
/// velocity at the end, and, if it is stuck, this margin to its static friction.
#[inline]
fn keeps(mode: Mode, rates: (f64, f64), velocity: f64, margin: impl Fn() -> f64) -> bool {
    match mode {
        Mode::Stuck => margin() >= 0.0,
        Mode::Forward => velocity >= 0.0 && !(rates.0 < 0.0 && rates.1 > 0.0),
        Mode::Backward => velocity <= 0.0 && !(rates.0 > 0.0 && rates.1 < 0.0),
    }
}
