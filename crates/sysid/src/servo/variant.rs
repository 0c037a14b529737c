//! A law of friction, a method, and what they find.

use super::Axis;
use crate::Parameter;

/// A law of friction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Friction {
    /// Both directions alike, beside an offset.
    Symmetric,
    /// Each direction has its own.
    Asymmetric,
}

/// How the equations are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Ordinary least squares.
    LeastSquares,
    /// Least squares by Huber's weights.
    Weighted,
    /// Instrumental variables, from the closed loop replayed with what least squares found.
    Instrumental,
    /// Least squares where the axis moves, with one unknown more: how long after its sample a voltage
    /// acts. One that is held until the next sample acts half a period later on average.
    Delayed,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::LeastSquares,
        Self::Weighted,
        Self::Instrumental,
        Self::Delayed,
    ];
}

impl Friction {
    /// Its parameters' names, the inertia's first.
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::Symmetric => &["inertia", "viscous_friction", "coulomb_friction", "offset"],
            Self::Asymmetric => &[
                "inertia",
                "viscous_friction_forward",
                "coulomb_friction_forward",
                "viscous_friction_backward",
                "coulomb_friction_backward",
            ],
        }
    }
}

/// One way to the parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Its law of friction.
    pub friction: Friction,
    /// How it was solved.
    pub method: Method,
    /// What it found; the delay of the voltage last, where it was looked for.
    pub parameters: Vec<Parameter>,
    /// Whether the record says when its voltage acts, and the delay tells all of it: of [`Method::Delayed`] only.
    pub(super) tells_delay: bool,
    /// Whether the voltage shows to have been filtered, and what that makes of the answer was taken out: of [`Method::Delayed`] only.
    pub(super) filtered: bool,
    /// Values of the equations' columns: by the order of [`Friction::names`], whether or not they may be
    /// told, then the delay in samples, where it was looked for.
    pub values: Vec<f64>,
    /// Condition number of the equations.
    pub condition: f64,
    /// Relative error of force on the record it was fitted to, per cent.
    pub relative_error_percent: f64,
    /// The same on a second record; without one on the record's last part, fitted to the rest.
    pub validation_error_percent: Option<f64>,
}

impl Variant {
    /// What moves in a replay.
    pub fn axis(&self, force_per_volt: f64) -> Axis {
        let mut v = self.values.clone();
        v.resize(self.friction.names().len(), 0.0);
        match self.friction {
            Friction::Symmetric => Axis {
                force_per_volt,
                inertia: v[0],
                viscous: [v[1], v[1]],
                coulomb: [v[2], v[2]],
                offset: v[3],
            },
            Friction::Asymmetric => Axis {
                force_per_volt,
                inertia: v[0],
                viscous: [v[1], v[3]],
                coulomb: [v[2], v[4]],
                offset: 0.0,
            },
        }
    }
}
