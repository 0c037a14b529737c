//! How friction departs from what it is at first.

use pigtail_hal::quantity;
use schemars::JsonSchema;
use serde::Deserialize;

/// How a joint departs from its friction as given: in the two directions, with time, and by what
/// happens to it at rest. Nothing of it by default.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UnrestPlant {
    /// Share of the load's Coulomb friction that forward motion meets more, and backward motion less.
    pub asymmetry: f64,
    /// Share by which all friction rises and falls along the travel...
    pub place: f64,
    /// ...once in so much of the output's turn, radians.
    #[serde(with = "quantity::PositiveAngle")]
    pub place_period: f64,
    /// Share by which all friction has changed...
    pub drift: f64,
    /// ...in so many seconds, steadily, and stays changed.
    #[serde(with = "quantity::PositiveTime")]
    pub drift_time: f64,
    /// By how much the motor of a joint that has rested for 5 ms is displaced before a pulse, rms,
    /// radians: what is not known of its internal state (thesis 4.3.1).
    #[serde(with = "quantity::NonNegativeAngle")]
    pub jolt: f64,
    /// Another number is another history of it, on the same specimen.
    pub history: u64,
}

impl Default for UnrestPlant {
    fn default() -> Self {
        Self {
            asymmetry: 0.0,
            place: 0.0,
            place_period: 0.1,
            drift: 0.0,
            drift_time: 1.0,
            jolt: 0.0,
            history: 0,
        }
    }
}

impl UnrestPlant {
    /// Whether there is nothing of it.
    pub(super) fn is_none(&self) -> bool {
        self.asymmetry == 0.0 && self.place == 0.0 && self.drift == 0.0 && self.jolt == 0.0
    }

    /// That it leaves some friction in either direction.
    pub(super) fn check(&self) -> Result<(), String> {
        for (key, value) in [
            ("asymmetry", self.asymmetry),
            ("place", self.place),
            ("drift", self.drift),
        ] {
            if !(-0.5..=0.5).contains(&value) {
                return Err(format!(
                    "has {key} = {value}, which is too much; accepted is -0.5 to 0.5"
                ));
            }
        }
        Ok(())
    }
}
