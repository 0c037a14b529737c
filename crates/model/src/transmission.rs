//! The flexible transmission, (2.6).

use crate::Invalid;

/// A hardening torsional spring: timing belt or harmonic drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transmission {
    linear: f64,
    cubic: f64,
}

impl Transmission {
    /// A spring with `linear` stiffness `k_s` (N m/rad) and `cubic` stiffness `k_h` (N m/rad^3).
    ///
    /// # Errors
    ///
    /// When `linear` is not positive or `cubic` is negative.
    pub fn new(linear: f64, cubic: f64) -> Result<Self, Invalid> {
        Ok(Self {
            linear: Invalid::positive("linear", linear)?,
            cubic: Invalid::non_negative("cubic", cubic)?,
        })
    }

    /// Linear stiffness `k_s`, N m/rad.
    pub fn linear(&self) -> f64 {
        self.linear
    }

    /// Cubic stiffness `k_h`, N m/rad^3.
    pub fn cubic(&self) -> f64 {
        self.cubic
    }

    /// Torque (2.6) on the load in N m for a twist `r q_m - q_l` in radians; positive twist
    /// drives the load forward.
    pub fn torque(&self, twist: f64) -> f64 {
        twist * (self.linear + self.cubic * twist * twist)
    }

    /// The twist (radians) at which its torque is `torque` (N m), by Newton's method: the torque
    /// rises steadily and ever more steeply, so that from above it is found without fail.
    pub fn twist(&self, torque: f64) -> f64 {
        let mut twist = torque / self.linear;
        for _ in 0..60 {
            let step = (self.torque(twist) - torque) / self.stiffness(twist);
            twist -= step;
            if step.abs() <= 1e-15 * twist.abs() {
                break;
            }
        }
        twist
    }

    /// Stiffness at a twist, N m/rad.
    pub fn stiffness(&self, twist: f64) -> f64 {
        self.linear + 3.0 * self.cubic * twist * twist
    }

    /// Energy stored at a twist, joules.
    pub fn energy(&self, twist: f64) -> f64 {
        let square = twist * twist;
        square * (0.5 * self.linear + 0.25 * self.cubic * square)
    }
}
