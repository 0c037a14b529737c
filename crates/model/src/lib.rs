//! The equations of a pigtailing machine, and no machine's numbers.
//!
//! Everyone may know these equations: the twin integrates them, control inverts them. What a
//! particular machine's parameters are is another matter; they are handed in.
//!
//! Equation numbers refer to *Coordinated Control of Two Macro / Micro Manipulators for Fiber
//! Pigtailling Automation* (MIT). All quantities are SI: metres, radians, seconds, newton
//! metres, volts.
//!
//! - [`frames`]: points that know the frame in which they are stated;
//! - [`motor`], [`transmission`], [`friction`], [`presliding`], [`lugre`]: the parts of a joint, (2.3)-(2.8),
//!   (2.12), (2.13);
//! - [`joint`]: the joint whole, (2.1)-(2.13), with its stick-slip transitions located in time by
//!   [`integrate`]; [`mod@group`] and [`batch`]: many of them side by side, by the vector [`instructions`] that there are;
//! - [`fivebar`], [`leadscrew`]: from joints to the endpoint;
//! - [`hysteresis`], [`piezo`]: the micro manipulator; [`pulse`]: the impulse (4.7);
//! - [`mod@cure`]: an adhesive under a lamp;
//! - [`optics`]: how much light passes from a fiber to a chip and back.
//!
//! Start with [`joint`]. In go parameters, a state and an input over a time; out comes the next state:
//!
//! ```
//! use pigtail_model::fivebar::FiveBar;
//!
//! // The endpoint of the thesis's five-bar, from its joints and back.
//! let bar = FiveBar::new(40e-3, 45e-3, 72.5e-3).expect("links that reach each other");
//! let joints = bar.inverse(0.0, 82.5e-3).expect("home is within reach");
//! let (x, y) = bar.forward(joints).expect("so are its joints");
//! assert!(x.abs() < 1e-12 && (y - 82.5e-3).abs() < 1e-12);
//! ```

pub mod batch;
pub mod cure;
pub mod each;
pub mod exponential;
pub mod fivebar;
pub mod frames;
pub mod friction;
pub mod group;
pub mod hysteresis;
pub mod instructions;
pub mod integrate;
pub mod joint;
pub mod leadscrew;
pub mod lugre;
pub mod motor;
mod nystrom;
pub mod optics;
pub mod piezo;
pub mod presliding;
pub mod pulse;
pub mod transmission;
pub mod windup;

/// A parameter that its equation cannot take.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("`{parameter}` is {value}; accepted is {accepted}")]
pub struct Invalid {
    /// The parameter, named as in its constructor.
    pub parameter: &'static str,
    /// The value that was given, SI.
    pub value: f64,
    /// What would be accepted.
    pub accepted: String,
}

impl Invalid {
    pub(crate) fn new(parameter: &'static str, value: f64, accepted: impl Into<String>) -> Self {
        Self {
            parameter,
            value,
            accepted: accepted.into(),
        }
    }

    pub(crate) fn positive(parameter: &'static str, value: f64) -> Result<f64, Self> {
        if value > 0.0 && value.is_finite() {
            Ok(value)
        } else {
            Err(Self::new(parameter, value, "a finite number above zero"))
        }
    }

    pub(crate) fn non_negative(parameter: &'static str, value: f64) -> Result<f64, Self> {
        if value >= 0.0 && value.is_finite() {
            Ok(value)
        } else {
            Err(Self::new(
                parameter,
                value,
                "a finite number of zero or more",
            ))
        }
    }
}
