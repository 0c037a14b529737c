//! How far specimens lie from what a plant says.

use pigtail_hal::quantity;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use schemars::JsonSchema;
use serde::Deserialize;

/// How widths of [`Misplacement`] and [`Variation`] are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Spread {
    /// Half ranges of uniform distributions.
    #[default]
    Uniform,
    /// Standard deviations of normal distributions, up to three of them; of the logarithm where a value is
    /// varied by a factor.
    Normal,
}

/// Nothing lies farther off than so many standard deviations.
const FARTHEST: f64 = 3.0;

impl Spread {
    /// From zero, by a distribution of this width.
    pub(in super::super) fn offset(self, rng: &mut impl RngExt, width: f64) -> f64 {
        match self {
            Self::Uniform => uniform(rng, width),
            Self::Normal => loop {
                let z: f64 = StandardNormal.sample(rng);
                if z.abs() <= FARTHEST {
                    break width * z;
                }
            },
        }
    }

    /// From one, by a distribution of this relative width.
    fn factor(self, rng: &mut impl RngExt, width: f64) -> f64 {
        match self {
            Self::Uniform => 1.0 + uniform(rng, width),
            Self::Normal => self.offset(rng, width).exp(),
        }
    }
}

/// How far things lie from where they should.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Misplacement {
    /// What the widths are.
    #[serde(default)]
    pub spread: Spread,
    /// The chip across, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub chip_x: f64,
    /// The chip along the guides, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub chip_z: f64,
    /// Each fiber in its holder, across, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub fiber_x: f64,
    /// Each fiber in its holder, along, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub fiber_z: f64,
    /// Chip and fiber together, up or down, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub y: f64,
    /// Tilt of each fiber about x and y, radians.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub tilt: f64,
    /// Roll of each polarization-maintaining fiber about its own axis, of its slow axis from the guides'
    /// polarization, radians. It costs light at the input and extinction at all of them.
    #[serde(default, with = "quantity::NonNegativeAngle")]
    pub roll: f64,
    /// Each manipulator's home, along each axis, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub home: f64,
}

/// How far parameters lie from their nominal values, relative, at most a half.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Variation {
    /// What the widths are.
    #[serde(default)]
    pub spread: Spread,
    /// Of inertias.
    #[serde(with = "quantity::Fraction")]
    pub inertia: f64,
    /// Of friction, static, Coulomb and viscous together.
    #[serde(with = "quantity::Fraction")]
    pub friction: f64,
    /// Of transmissions.
    #[serde(with = "quantity::Fraction")]
    pub stiffness: f64,
    /// Of motor constants and resistances.
    #[serde(with = "quantity::Fraction")]
    pub motor: f64,
    /// Of the gains of the micro axes.
    #[serde(with = "quantity::Fraction")]
    pub micro_gain: f64,
    /// Of the micro axes' hysteresis: its opening, spread, skew and saturation.
    #[serde(with = "quantity::Fraction")]
    pub hysteresis: f64,
    /// Of their creep.
    #[serde(with = "quantity::Fraction")]
    pub creep: f64,
    /// Of the five-bars' links and the lead of the screws.
    #[serde(with = "quantity::Fraction")]
    pub links: f64,
    /// Greatest excess loss of each branch of the device.
    #[serde(with = "quantity::Fraction")]
    pub loss: f64,
    /// Of the resonances of the micro axes of one machine, among each other.
    #[serde(default, with = "quantity::Fraction")]
    pub resonance: f64,
    /// Of their damping.
    #[serde(default, with = "quantity::Fraction")]
    pub damping: f64,
}

impl Variation {
    /// What to multiply a parameter of this width with.
    pub(in super::super) fn factor(&self, rng: &mut impl RngExt, width: f64) -> f64 {
        self.spread.factor(rng, width)
    }
}

impl Misplacement {
    /// How far something of this width lies off, metres or radians.
    pub(in super::super) fn offset(&self, rng: &mut impl RngExt, width: f64) -> f64 {
        self.spread.offset(rng, width)
    }
}

/// Uniform in plus and minus `half_range`.
pub(in super::super) fn uniform(rng: &mut impl RngExt, half_range: f64) -> f64 {
    half_range * (2.0 * rng.random::<f64>() - 1.0)
}
