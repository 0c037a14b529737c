//! How far a pulse moves a load, by a formula (thesis 4.3.4, which leaves it to whoever comes next).
//!
//! The pulse is over before the load moves: the motor winds the transmission up against a load that friction holds, and comes to rest;
//! then the load, drawn by the transmission, slides half a swing of its own against a motor that friction holds. With
//! `g = k_m/R`, `K = r^2 k_s`, `b` the motor's damping by back emf and viscous friction, `C` its Coulomb friction:
//!
//! ```text
//! it breaks away     t_0 = F T/(pi g (a_1 + 2 a_2)), m = t_0 (C - F/2)     F: its static friction
//! momentum alone     v_0 = T/J_m (2 g a_1/pi - C) + m/J_m                  at the pulse's end
//!                    x_0 = T^2/J_m (g (2 a_1 + a_2)/(2 pi) - C/2) + m/J_m (T - t_0/2)
//! its integrals      I   = T^3/J_m (g (a_1 (1/2 - 2/pi^2)/pi + a_2/(4 pi)) - C/6)
//!                    II  = T^4/J_m (g (a_1 (1/6 - 1/pi^2)/pi + a_2 (1/6 - 1/(4 pi^2))/(2 pi)) - C/24)
//! what holds back    v_1 = v_0 - (K I + b x_0)/J_m
//!                    x_1 = x_0 - (K II + b I)/J_m
//! it comes to rest   w = sqrt(K/J_m), y = x_1 + C/K, R^2 = y^2 + v_1^2/w^2, p = atan(v_1/(w y))
//!                    x   = sqrt(R^2 (1 - b/(J_m w) (p - sin(2 p)/2))) - C/K
//! the load           q   = (1 + exp(-pi z/sqrt(1 - z^2))) (r x - C_l/k_s),   z = b_l/(2 sqrt(k_s J_l))
//! ```
//!
//! and `q = 0` where `k_s r x` is less than the load's static friction: the dead zone. `v_1^2` is the parabola (4.8). A second harmonic has no
//! momentum, but is in `x_0`: it winds the transmission up to where the load is about to move, which takes the dead zone away.

use super::Pulse;
use crate::joint::JointParameters;
use std::f64::consts::PI;

/// Radians that a motor swings on its transmission in a pulse, at most: what holds it back counts to the first order only.
const SHORT: f64 = 0.5;

/// Why the approximation says nothing of a pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Outside {
    /// A joint that it does not describe.
    #[error(
        "the load gives way before it slides, is driven from outside, or the transmission hardens"
    )]
    Joint,
    /// A pulse that it does not describe.
    #[error(
        "the pulse has a third harmonic, is not one forward, or is not short beside the motor's swing on the transmission"
    )]
    Pulse,
    /// The motor comes to rest, or turns back, before the pulse is over.
    #[error("the motor comes to rest before the pulse is over")]
    StopsEarly,
    /// The transmission turns the motor back afterwards, or friction does not damp the load to half a swing.
    #[error("the transmission draws the motor back after the pulse")]
    DrawnBack,
}

impl Pulse {
    /// How far it moves the load of a joint that is at rest with nothing in its transmission, radians.
    ///
    /// # Errors
    ///
    /// Where it does not hold.
    pub fn displacement(&self, joint: &JointParameters) -> Result<f64, Outside> {
        let wound = self.winds(joint)?;
        let (load, stiffness) = (&joint.load_friction, joint.transmission.linear());
        if stiffness * wound <= load.static_level() {
            return Ok(0.0);
        }
        let damping = 0.5 * load.viscous() / (stiffness * joint.load_inertia).sqrt();
        if damping >= 1.0 {
            return Err(Outside::Joint);
        }
        let over = (-PI * damping / (1.0 - damping * damping).sqrt()).exp();
        let free = wound - load.coulomb() / stiffness;
        // Wound up most before the load moves, and the other way after it.
        let motor = joint.motor_friction.static_level();
        let left = over * free - load.coulomb() / stiffness;
        let stays = stiffness * joint.ratio * wound.max(left) < motor;
        if !stays || stiffness * left > load.static_level() {
            return Err(Outside::DrawnBack);
        }
        Ok((1.0 + over) * free)
    }

    /// How far it winds up a transmission whose load is held, radians of the output.
    fn winds(&self, joint: &JointParameters) -> Result<f64, Outside> {
        let (transmission, friction) = (&joint.transmission, &joint.motor_friction);
        let driven = joint.presliding > 0.0 || joint.load_torque != 0.0;
        if driven || transmission.cubic() != 0.0 {
            return Err(Outside::Joint);
        }
        let (inertia, t) = (joint.motor_inertia, self.period);
        let spring = joint.ratio * joint.ratio * transmission.linear();
        let swing = (spring / inertia).sqrt();
        let [a1, a2, a3, a4] = self.amplitudes.map(|a| a * joint.motor.gain());
        let forward = a1 >= 0.0 && a2 >= 0.0 && a1.max(a2) > friction.static_level();
        if !forward || a3 != 0.0 || a4 != 0.0 || swing * t > SHORT {
            return Err(Outside::Pulse);
        }
        let (slows, rubs) = (
            joint.motor.damping() + friction.viscous(),
            friction.coulomb(),
        );
        // Until the pulse breaks it away friction does not slow the motor down.
        let starts = friction.static_level() * t / (PI * (a1 + 2.0 * a2));
        let spared = starts * (rubs - 0.5 * friction.static_level());
        let speed = t * (2.0 * a1 / PI - rubs) + spared;
        let way =
            t.powi(2) * ((2.0 * a1 + a2) / (2.0 * PI) - 0.5 * rubs) + spared * (t - 0.5 * starts);
        let once = t.powi(3) * (a1 / PI * (0.5 - 2.0 / PI.powi(2)) + a2 / (4.0 * PI) - rubs / 6.0);
        let second = 1.0 / 6.0 - 0.25 / PI.powi(2);
        let twice = t.powi(4)
            * (a1 / PI * (1.0 / 6.0 - PI.powi(-2)) + 0.5 * a2 / PI * second - rubs / 24.0);
        let v = (speed - (spring * once + slows * way) / inertia) / inertia;
        let x = (way - (spring * twice + slows * once) / inertia) / inertia;
        if v < 0.0 {
            return Err(Outside::StopsEarly);
        }
        let held = rubs / spring;
        let (y, across) = (x + held, v / swing);
        let phase = across.atan2(y);
        let lost = slows / (inertia * swing) * (phase - 0.5 * (2.0 * phase).sin());
        let reach = ((y * y + across * across) * (1.0 - lost)).sqrt();
        Ok(joint.ratio * (reach - held))
    }
}
