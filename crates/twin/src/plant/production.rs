//! Adhesive and handling in a `plant.toml`. Only what works on a tray makes use of them.

use pigtail_hal::quantity;
use schemars::JsonSchema;
use serde::Deserialize;

/// The adhesive as it really is, under the lamp as it really is.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AdhesivePlant {
    /// When it gels under the nominal lamp at room temperature, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub gel: f64,
    /// Conversion at the gel point. So great a share of the shrinkage comes before it.
    #[serde(with = "quantity::Fraction")]
    pub gel_conversion: f64,
    /// How far it pulls a fiber in all, down to the chip on average, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub pull: f64,
    /// The volume of which it does, nanolitres.
    #[serde(with = "quantity::Positive")]
    pub volume: f64,
    /// How far the mean of a machine is from straight down, standard deviation along each axis, of the pull. The mean after
    /// the gel point is from that before it by half as much.
    #[serde(with = "quantity::NonNegative")]
    pub askew: f64,
    /// From one fiber to the next, standard deviation along each axis, metres, of the pull before the gel point and,
    /// by itself, of that after it, each counted for the whole.
    #[serde(with = "quantity::NonNegativeLength")]
    pub scatter: f64,
    /// Share of the shift after the gel point that comes when the fiber is let go.
    #[serde(with = "quantity::Fraction")]
    pub released: f64,
    /// Of the lamp's irradiance, from one fiber to the next, standard deviation of its logarithm.
    #[serde(with = "quantity::NonNegative")]
    pub lamp_spread: f64,
    /// By how much the lamp warms the bond, kelvin.
    #[serde(with = "quantity::NonNegative")]
    pub lamp_warms: f64,
    /// By how much its own reaction would if no heat left it, kelvin.
    #[serde(with = "quantity::NonNegative")]
    pub reaction_warms: f64,
    /// Within what time it cools, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub cools: f64,
    /// Activation energy of the reaction, J/mol.
    #[serde(with = "quantity::NonNegative")]
    pub activation: f64,
    /// How far a kelvin pushes the fiber against the pull, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub expansion: f64,
}

impl Default for AdhesivePlant {
    fn default() -> Self {
        Self {
            gel: 10.0,
            gel_conversion: 0.5,
            pull: 1.5e-6,
            volume: 20.0,
            askew: 0.2,
            scatter: 0.2e-6,
            released: 0.1,
            lamp_spread: 0.03,
            lamp_warms: 3.0,
            reaction_warms: 10.0,
            cools: 2.0,
            activation: 0.0,
            expansion: 5e-9,
        }
    }
}

/// Grippers, dispenser and conveyor as they really are.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HandlingPlant {
    /// Probability that a gripper misses a fiber that lies where it should.
    #[serde(with = "quantity::Fraction")]
    pub missed: f64,
    /// How near a fiber must lie to be gripped, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub grips: f64,
    /// By what share a step takes longer or less long than the datasheet says, at most.
    #[serde(with = "quantity::Fraction")]
    pub spread: f64,
    /// Placement of a fiber on the tray, standard deviation along each axis, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub placed: f64,
}

impl Default for HandlingPlant {
    fn default() -> Self {
        Self {
            missed: 0.01,
            grips: 0.6e-3,
            spread: 0.05,
            placed: 0.1e-3,
        }
    }
}
