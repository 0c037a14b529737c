//! The flexible transmission, (2.6).

use crate::Invalid;

/// A hardening torsional spring: timing belt or harmonic drive. Its stiffness rises with the twist, without
/// end in (2.6); a real gear's rises to a bound and no further.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transmission {
    linear: f64,
    cubic: f64,
    bend: f64,
    stiffest: f64,
}

impl Transmission {
    /// The spring (2.6), with `linear` stiffness `k_s` (N m/rad) and `cubic` stiffness `k_h` (N m/rad^3).
    ///
    /// # Errors
    ///
    /// When `linear` is not positive or `cubic` is negative.
    pub fn new(linear: f64, cubic: f64) -> Result<Self, Invalid> {
        Ok(Self {
            linear: Invalid::positive("linear", linear)?,
            cubic: Invalid::non_negative("cubic", cubic)?,
            bend: f64::INFINITY,
            stiffest: 0.0,
        })
    }

    /// The same, but that its stiffness rises to `bound` times that at rest and no further.
    ///
    /// # Errors
    ///
    /// When `bound` is less than one.
    pub fn bounded(self, bound: f64) -> Result<Self, Invalid> {
        let more = Invalid::non_negative("bound", bound - 1.0)?;
        Ok(Self {
            // A spring that does not harden never gets there.
            bend: if self.cubic > 0.0 {
                (more * self.linear / (3.0 * self.cubic)).sqrt()
            } else {
                f64::INFINITY
            },
            stiffest: bound * self.linear,
            ..self
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

    /// Twist from which on the stiffness rises no further, radians; infinite in (2.6).
    pub fn bend(&self) -> f64 {
        self.bend
    }

    /// Stiffness from there on, N m/rad; any number in (2.6).
    pub fn stiffest(&self) -> f64 {
        self.stiffest
    }

    /// Torque (2.6) on the load in N m for a twist `r q_m - q_l` in radians; positive twist
    /// drives the load forward.
    #[inline]
    pub fn torque(&self, twist: f64) -> f64 {
        let hardening = twist.clamp(-self.bend, self.bend);
        hardening * (self.linear + self.cubic * hardening * hardening)
            + self.stiffest * (twist - hardening)
    }

    /// The twist (radians) at which its torque is `torque` (N m), by Newton's method: the torque
    /// rises steadily and nowhere less steeply than nearer to rest, so that from above it is found without
    /// fail.
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
        let hardening = twist.abs().min(self.bend);
        self.linear + 3.0 * self.cubic * hardening * hardening
    }

    /// Energy stored at a twist, joules.
    pub fn energy(&self, twist: f64) -> f64 {
        let hardening = twist.abs().min(self.bend);
        let square = hardening * hardening;
        let beyond = twist.abs() - hardening;
        square * (0.5 * self.linear + 0.25 * self.cubic * square)
            + beyond * (self.torque(hardening) + 0.5 * self.stiffest * beyond)
    }
}
