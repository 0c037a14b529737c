//! A DC motor in voltage mode, (2.3)-(2.5).

use crate::Invalid;

/// A DC motor fed by a voltage source, its inductance neglected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motor {
    torque_constant: f64,
    back_emf: f64,
    resistance: f64,
}

impl Motor {
    /// A motor from its torque constant `k_m` (N m/A), its back-emf constant `k_b` (V s/rad) and
    /// its winding resistance `R` (ohm).
    ///
    /// # Errors
    ///
    /// When a parameter is not positive.
    pub fn new(torque_constant: f64, back_emf: f64, resistance: f64) -> Result<Self, Invalid> {
        Ok(Self {
            torque_constant: Invalid::positive("torque_constant", torque_constant)?,
            back_emf: Invalid::positive("back_emf", back_emf)?,
            resistance: Invalid::positive("resistance", resistance)?,
        })
    }

    /// Torque at standstill for one volt, `k_m / R` of (2.5), N m/V.
    pub fn gain(&self) -> f64 {
        self.torque_constant / self.resistance
    }

    /// Damping by the back emf, `k_m k_b / R` of (2.5), N m s/rad.
    pub fn damping(&self) -> f64 {
        self.gain() * self.back_emf
    }

    /// The nearest voltage to `voltage` (V) at which no more than `current` (A) flows at a shaft speed of
    /// `velocity` (rad/s).
    pub fn within(&self, current: f64, voltage: f64, velocity: f64) -> f64 {
        let (own, room) = (self.back_emf * velocity, self.resistance * current);
        voltage.clamp(own - room, own + room)
    }

    /// Torque (2.5) in N m at `voltage` (V) and shaft speed `velocity` (rad/s).
    pub fn torque(&self, voltage: f64, velocity: f64) -> f64 {
        self.gain() * voltage - self.damping() * velocity
    }
}
