//! Static, Coulomb and viscous friction, (2.7) and (2.8).

use crate::Invalid;

/// Which way a body moves, or that friction holds it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(i8)]
pub enum Mode {
    /// Slides with negative velocity.
    Backward = -1,
    /// Is held: its velocity is exactly zero.
    #[default]
    Stuck = 0,
    /// Slides with positive velocity.
    Forward = 1,
}

impl Mode {
    /// -1, 0 or +1.
    pub fn sign(self) -> f64 {
        f64::from(self as i8)
    }

    /// The direction in which `torque` pushes.
    pub fn towards(torque: f64) -> Self {
        if torque > 0.0 {
            Self::Forward
        } else if torque < 0.0 {
            Self::Backward
        } else {
            Self::Stuck
        }
    }
}

/// Friction on one body. Static friction is never below Coulomb friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    fixed: f64,
    coulomb: f64,
    viscous: f64,
}

impl Friction {
    /// Friction from its static level `f_s` (N m), its Coulomb level `f_c` (N m) and its viscous
    /// coefficient `b` (N m s/rad).
    ///
    /// # Errors
    ///
    /// When a parameter is negative or `f_s < f_c`: a body that breaks away would then be held
    /// by more than what held it before.
    pub fn new(static_level: f64, coulomb: f64, viscous: f64) -> Result<Self, Invalid> {
        let coulomb = Invalid::non_negative("coulomb_friction", coulomb)?;
        if static_level.is_nan() || static_level < coulomb || static_level.is_infinite() {
            return Err(Invalid::new(
                "static_friction",
                static_level,
                format!("at least the Coulomb friction, {coulomb}"),
            ));
        }
        Ok(Self {
            fixed: static_level,
            coulomb,
            viscous: Invalid::non_negative("viscous_friction", viscous)?,
        })
    }

    /// The same friction, all of it `by` times as high.
    ///
    /// # Errors
    ///
    /// When `by` is negative or not finite.
    pub fn scaled(&self, by: f64) -> Result<Self, Invalid> {
        Self::new(by * self.fixed, by * self.coulomb, by * self.viscous)
    }

    /// Static level `f_s`, N m.
    pub fn static_level(&self) -> f64 {
        self.fixed
    }

    /// Coulomb level `f_c`, N m.
    pub fn coulomb(&self) -> f64 {
        self.coulomb
    }

    /// Viscous coefficient `b`, N m s/rad.
    pub fn viscous(&self) -> f64 {
        self.viscous
    }

    /// Whether nothing can hold the body. Such a body is a case of its own: treated as one that
    /// sticks at a level of zero, it would change mode for ever without moving on in time.
    pub fn is_free(&self) -> bool {
        self.fixed <= 0.0
    }

    /// The mode of a body at zero velocity under the other torques `psi`, (2.7) and (2.8).
    pub fn at_rest(&self, psi: f64) -> Mode {
        if psi.abs() <= self.fixed {
            Mode::Stuck
        } else {
            Mode::towards(psi)
        }
    }

    /// Torque of friction on the body in N m: `-psi` where it is stuck, else
    /// `-sgn(v) f_c - b v`.
    pub fn torque(&self, mode: Mode, psi: f64, velocity: f64) -> f64 {
        match mode {
            Mode::Stuck if !self.is_free() => -psi,
            _ => -mode.sign() * self.coulomb - self.viscous * velocity,
        }
    }
}
