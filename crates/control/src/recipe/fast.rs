//! Parameters of the fast procedure, and of alignment without a camera.

use super::{Recipe, Retry};
use pigtail_hal::{Spec, quantity};
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};

/// The modes of fiber and guides, by design. What is really so only has to be alike.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// Radius at which the field has fallen to 1/e, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub radius: f64,
    /// Of the laser in vacuum, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub wavelength: f64,
    /// Refractive index of what fills the gap while a fiber is aligned: 1 for air, about 1.5 for adhesive.
    /// `ports.exit_angle` is the angle into the same.
    #[serde(default = "air", with = "quantity::Positive")]
    pub gap_index: f64,
}

fn air() -> f64 {
    1.0
}

impl Default for Mode {
    fn default() -> Self {
        Self {
            radius: 2.5e-6,
            wavelength: 1.3e-6,
            gap_index: air(),
        }
    }
}

/// The fast procedure.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(transform = with_former_names)]
pub struct Fast {
    /// Time for which the dark is measured on the way, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub dark: f64,
    /// Gap at which the input's light is searched, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub input_gap: f64,
    /// Distance of the lines of that search, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub input_spacing: f64,
    /// Gap at which an output's light is searched, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub output_gap: f64,
    /// Distance of the lines of that search, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub output_spacing: f64,
    /// Standard deviations above the background that count as light: what is none is seen soon.
    #[serde(with = "quantity::Positive")]
    pub significance: f64,
    /// How much further up than `raster.y` and its margin to search, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub overscan: f64,
    /// How well the peak must be known in the end, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub accuracy: f64,
    /// By how much vision may see the last gap off before it is corrected, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub gap_tolerance: f64,
    /// By how much a tip may be seen to stand elsewhere than where its search starts, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub straight: f64,
    /// Gap at which light that may be none is looked at once more, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub doubtful_gap: f64,
    /// How far the peak may walk otherwise than expected on the approach, metres. What strays
    /// farther is none, and the chip is near.
    #[serde(with = "quantity::PositiveLength")]
    pub stray: f64,
    /// Share of the light before the approach that must be there after it, the gap taken into
    /// account.
    #[serde(with = "quantity::Fraction")]
    pub accept: f64,
    /// For how long every tip is watched before it is attached, in x and in y, whether it shakes; seconds. A tip that
    /// may shake too much is watched anyway.
    #[serde(with = "quantity::NonNegativeTime")]
    pub watch: f64,
    /// The sensing fiber over the chip's top.
    pub sensing: OverTop,
    /// Lines of a search.
    pub sweep: Sweep,
    /// The conical scan, or dither. Recipes of old call it `orbit`.
    #[serde(alias = "orbit")]
    pub conical_scan: ConicalScan,
    /// What is tried again before a fiber is given up.
    pub retry: Retry,
}

/// An alias is no property of a schema by itself.
fn with_former_names(schema: &mut Schema) {
    let keys = schema.get_mut("properties").and_then(|p| p.as_object_mut());
    if let Some(keys) = keys
        && let Some(mut scan) = keys.get("conical_scan").cloned()
    {
        scan["description"] = "The former name of `conical_scan`.".into();
        scan["deprecated"] = true.into();
        keys.insert("orbit".to_owned(), scan);
    }
}

impl Default for Fast {
    fn default() -> Self {
        Self {
            dark: 0.5,
            input_gap: 60e-6,
            input_spacing: 10e-6,
            output_gap: 80e-6,
            output_spacing: 17e-6,
            significance: 5.5,
            overscan: 20e-6,
            accuracy: 20e-9,
            gap_tolerance: 0.4e-6,
            straight: 1.5e-6,
            doubtful_gap: 25e-6,
            stray: 6e-6,
            accept: 0.5,
            watch: 0.0,
            sensing: OverTop::default(),
            sweep: Sweep::default(),
            conical_scan: ConicalScan::default(),
            retry: Retry::default(),
        }
    }
}

/// The sensing fiber over the chip's top.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OverTop {
    /// Its gap: there the guided light is about as wide as its core, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub gap: f64,
    /// How far below the top it starts, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub below: f64,
    /// How far above the top its middle goes, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub height: f64,
    /// Speed upward, m/s.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
    /// How far to either side to try again, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub sidestep: f64,
}

impl Default for OverTop {
    fn default() -> Self {
        Self {
            gap: 500e-6,
            below: 200e-6,
            height: 52e-6,
            speed: 2.5e-3,
            sidestep: 35e-6,
        }
    }
}

/// Lines of a search: across at constant speed, and back.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Sweep {
    /// Speed across, m/s.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
    /// Time to fly back, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub flyback: f64,
}

impl Sweep {
    /// The same with lines gone along so many times as slowly.
    #[must_use]
    pub fn slower(self, times: f64) -> Self {
        Self {
            speed: self.speed / times,
            ..self
        }
    }
}

impl Default for Sweep {
    fn default() -> Self {
        Self {
            speed: 5.5e-3,
            flyback: 8e-3,
        }
    }
}

/// Circles around the peak.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ConicalScan {
    /// Time of a turn, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub period: f64,
    /// Radius, in distances at which the light has fallen to 1/e.
    #[serde(with = "quantity::Positive")]
    pub radius: f64,
    /// Most turns in one place.
    pub turns: u32,
    /// How many times as long a turn takes each time that turns are to take longer: a micro that swings along with them at one rate does not
    /// at another...
    #[serde(with = "quantity::Positive")]
    pub slower: f64,
    /// ...and at most, all together.
    #[serde(with = "quantity::Positive")]
    pub slowest: f64,
    /// Whether the light on the circles teaches how much farther one piezo of a micro goes than the other, where the machine is one
    /// that drives its piezos by volts.
    pub learn: bool,
}

impl Default for ConicalScan {
    fn default() -> Self {
        Self {
            period: 24e-3,
            radius: 0.55,
            turns: 10,
            slower: 1.3,
            slowest: 2.0,
            learn: true,
        }
    }
}

impl Fast {
    /// Whether a machine can do it.
    pub(super) fn check(&self, recipe: &Recipe, spec: &Spec) -> Result<(), (&'static str, String)> {
        self.retry.check()?;
        let um = 1e6;
        for (key, gap) in [
            ("fast.input_gap", self.input_gap),
            ("fast.output_gap", self.output_gap),
        ] {
            let (least, most) = (self.doubtful_gap, recipe.coarse.far);
            if !(gap > least && gap < most) {
                return Err((
                    key,
                    format!(
                        "{:.1} um is not between `fast.doubtful_gap`, {:.1} um, and `coarse.far`, \
                         {:.1} um; accepted is a gap between them",
                        gap * um,
                        least * um,
                        most * um
                    ),
                ));
            }
        }
        let sample = 1.0 / spec.photodiode.rate;
        // Each with the least and the most that is accepted, in SI.
        for (key, value, least, most) in [
            (
                "fast.doubtful_gap",
                self.doubtful_gap,
                recipe.approach.gap,
                1e-3,
            ),
            ("fast.dark", self.dark, 4.0 * sample, 10.0),
            ("fast.stray", self.stray, 1e-7, 20e-6),
            ("fast.straight", self.straight, 1e-7, 1e-4),
            ("fast.accuracy", self.accuracy, 1e-9, 1e-6),
            ("fast.gap_tolerance", self.gap_tolerance, 1e-8, 1e-5),
            ("fast.overscan", self.overscan, 0.0, 1e-3),
            ("fast.watch", self.watch, 0.0, 100.0),
            ("fast.sensing.gap", self.sensing.gap, 1e-5, 2e-3),
            ("fast.sensing.height", self.sensing.height, 0.0, 1e-3),
            ("fast.sensing.below", self.sensing.below, 1e-5, 2e-3),
            (
                "fast.sensing.speed",
                self.sensing.speed,
                1e-5,
                spec.five_bar.speed,
            ),
            (
                "fast.sensing.sidestep",
                self.sensing.sidestep,
                1e-7,
                0.5 * spec.micro.range,
            ),
            ("fast.input_spacing", self.input_spacing, 1e-6, 1e-4),
            ("fast.output_spacing", self.output_spacing, 1e-6, 1e-4),
            ("fast.sweep.speed", self.sweep.speed, 1e-4, 0.1),
            ("fast.sweep.flyback", self.sweep.flyback, spec.period(), 1.0),
            (
                "fast.conical_scan.period",
                self.conical_scan.period,
                6.0 * sample,
                10.0,
            ),
            (
                "fast.conical_scan.radius",
                self.conical_scan.radius,
                0.05,
                2.0,
            ),
            (
                "fast.conical_scan.turns",
                f64::from(self.conical_scan.turns),
                1.0,
                1000.0,
            ),
            (
                "fast.conical_scan.slower",
                self.conical_scan.slower,
                1.0,
                10.0,
            ),
            (
                "fast.conical_scan.slowest",
                self.conical_scan.slowest,
                1.0,
                100.0,
            ),
            ("mode.radius", recipe.mode.radius, 1e-7, 1e-4),
            ("mode.wavelength", recipe.mode.wavelength, 1e-7, 2e-5),
            ("mode.gap_index", recipe.mode.gap_index, 1.0, 3.0),
        ] {
            if !(least..=most).contains(&value) {
                return Err((
                    key,
                    format!("is {value:e} in SI units; accepted is {least:e} to {most:e}"),
                ));
            }
        }
        Ok(())
    }
}
