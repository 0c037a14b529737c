//! What light has told of a machine: how micros swing, how tips shake, how light spreads and how wide its spot is.

use crate::beam::SpotSize;
use crate::gap_by_light::Spread;
use crate::shaking::Measured;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_hal::{Side, quantity};
use schemars::JsonSchema;
use serde::Deserialize;

/// How each manipulator's micro swings where it has been measured.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MicroDynamics {
    /// Of the input's manipulator.
    pub left: Option<DynamicsBelief>,
    /// Of the outputs' manipulator.
    pub right: Option<DynamicsBelief>,
}

impl MicroDynamics {
    /// What was measured of a manipulator's micro.
    pub fn of(&self, side: Side) -> Option<&DynamicsBelief> {
        [&self.left, &self.right][side.index()].as_ref()
    }
}

/// How a micro swings, as it was measured; what goes by it counts in place of what [`MicroGeometry`](super::MicroGeometry) says.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DynamicsBelief {
    /// Resonances of both piezos' axes, hertz.
    #[serde(with = "quantity::Frequencies::<2>")]
    pub resonance: [f64; MICRO_AXES],
    /// Their damping ratios.
    pub damping: [f64; MICRO_AXES],
    /// By when it has come to rest where it was told to be, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub settling: f64,
    /// How many turns a second it follows at most, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub bandwidth: f64,
    /// From when it is told to be somewhere until a photodiode's sample of it, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub lag: f64,
    /// How well that is known, one standard deviation, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub lag_deviation: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// How far each manipulator's tips shake where it has been measured.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shakings {
    /// Of the input's manipulator.
    pub left: Option<ShakingBelief>,
    /// Of the outputs' manipulator.
    pub right: Option<ShakingBelief>,
}

impl Shakings {
    /// What was measured of a manipulator's tips.
    pub fn of(&self, side: Side) -> Option<Measured> {
        let belief = [&self.left, &self.right][side.index()];
        belief.as_ref().map(|belief| Measured {
            deviation: belief.deviation,
            spread: belief.spread,
            left: belief.left,
            left_spread: belief.left_spread,
        })
    }
}

/// How far a tip that is held is from where it is held, as it was measured.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShakingBelief {
    /// Standard deviation along an axis, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub deviation: f64,
    /// How well it is known: the standard deviation of its natural logarithm.
    #[serde(with = "quantity::Positive")]
    pub spread: f64,
    /// Which share of its variance is left of the mean over as long as a bond takes.
    #[serde(default = "all", with = "quantity::Positive")]
    pub left: f64,
    /// How well that is known: the standard deviation of its natural logarithm. Without it `left` is the most that it may be.
    #[serde(default, with = "quantity::NonNegative")]
    pub left_spread: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

fn all() -> f64 {
    1.0
}

/// How light spreads over a gap in the scale of each manipulator's micro where it has been measured.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spreads {
    /// Of the input's manipulator.
    pub left: Option<SpreadBelief>,
    /// Of the outputs' manipulator.
    pub right: Option<SpreadBelief>,
}

impl Spreads {
    /// What was measured with a manipulator's micro.
    pub fn of(&self, side: Side) -> Option<Spread> {
        let belief = [&self.left, &self.right][side.index()];
        belief.as_ref().map(|belief| Spread {
            length: [belief.x, belief.y],
            deviation: [belief.deviation_x, belief.deviation_y],
            correlation: belief.correlation,
        })
    }
}

/// How light spreads over a gap, in a micro's own scale, as it was measured: the squared width of its spot grows by `(x z)^2` over that at no
/// gap.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpreadBelief {
    /// Along x: the wavelength over 2 pi, but for the micro's scale.
    #[serde(with = "quantity::PositiveLength")]
    pub x: f64,
    /// Along y.
    #[serde(with = "quantity::PositiveLength")]
    pub y: f64,
    /// How well that along x is known: the standard deviation of its natural logarithm.
    #[serde(with = "quantity::Positive")]
    pub deviation_x: f64,
    /// How well that along y is.
    #[serde(with = "quantity::Positive")]
    pub deviation_y: f64,
    /// By how much both err alike: the correlation of their logarithms. Where it is not said, wholly.
    #[serde(default = "all", with = "quantity::NonNegative")]
    pub correlation: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// How wide the spot of light at the chip is in the scale of each manipulator's micro where it has been measured.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spots {
    /// Of the input's manipulator.
    pub left: Option<SpotBelief>,
    /// Of the outputs' manipulator.
    pub right: Option<SpotBelief>,
}

impl Spots {
    /// What was measured with a manipulator's micro.
    pub fn of(&self, side: Side) -> Option<SpotSize> {
        let belief = [&self.left, &self.right][side.index()];
        belief.as_ref().map(|belief| SpotSize {
            radius: [belief.x, belief.y],
            deviation: [belief.deviation_x, belief.deviation_y],
        })
    }
}

/// How wide the spot of light is where a fiber and a guide touch, in a micro's own scale, as it was measured over some fibers: the distance
/// from the peak at which the light has fallen to 1/e, which is the radius of both modes where these are alike.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotBelief {
    /// Along x.
    #[serde(with = "quantity::PositiveLength")]
    pub x: f64,
    /// Along y.
    #[serde(with = "quantity::PositiveLength")]
    pub y: f64,
    /// How well that along x is known of the next fiber: the standard deviation of its natural logarithm.
    #[serde(with = "quantity::Positive")]
    pub deviation_x: f64,
    /// How well that along y is.
    #[serde(with = "quantity::Positive")]
    pub deviation_y: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}
