//! The belief about a machine: `calibration.toml`.

mod by_light;

pub use by_light::{
    DynamicsBelief, MicroDynamics, ShakingBelief, Shakings, SpotBelief, Spots, SpreadBelief,
    Spreads,
};

use crate::beam::Askew;
use crate::compensation::micro::MicroModel;
use crate::impulse::belief::ImpulseBeliefs;
use pigtail_hal::{Axis, AxisName, Error, Side, Spec, config, quantity};
use pigtail_model::windup::{ELEMENTS, Memory, POWERS, Reversal, Windup};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;

/// The content of a `calibration.toml`. Written by the programs that measure, never by hand in
/// daily use; every table says when and by which run it was found.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Servo gains of each kind of axis.
    pub gains: Gains,
    /// Dimensions and places.
    pub geometry: Geometry,
    /// Windup of each kind of axis where it has been identified.
    #[serde(default)]
    pub windup: Windups,
    /// Hysteresis of each manipulator's piezos where it has been identified.
    #[serde(default)]
    pub hysteresis: Hystereses,
    /// How far each manipulator's tips shake where it has been measured.
    #[serde(default)]
    pub shaking: Shakings,
    /// How light spreads over a gap in the scale of each manipulator's micro where it has been measured.
    #[serde(default)]
    pub spread: Spreads,
    /// How wide the spot of light at the chip is in the scale of each manipulator's micro where it has been measured.
    #[serde(default)]
    pub spot: Spots,
    /// How each manipulator's micro swings where it has been measured.
    #[serde(default)]
    pub dynamics: MicroDynamics,
    /// Pulses of each kind of axis where they have been measured.
    #[serde(default)]
    pub impulse: ImpulseBeliefs,
}

/// Hysteresis of each manipulator's piezos where it has been identified.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hystereses {
    /// Of the input's manipulator.
    pub left: Option<HysteresisBelief>,
    /// Of the outputs' manipulator.
    pub right: Option<HysteresisBelief>,
}

impl Hystereses {
    /// The model of a manipulator's piezos, where one was identified and its weights were read.
    pub fn of(&self, side: Side) -> Option<&MicroModel> {
        let belief = [&self.left, &self.right][side.index()];
        belief.as_ref()?.loaded.as_deref()
    }

    /// What was identified, for whoever reads the weights.
    pub fn beliefs(&mut self) -> impl Iterator<Item = &mut HysteresisBelief> {
        self.left.iter_mut().chain(self.right.iter_mut())
    }

    /// Believes a model that was identified just now, or none.
    pub fn set(&mut self, side: Side, model: Option<MicroModel>) {
        let belief = model.map(|model| HysteresisBelief {
            model: model.piezos[0].name().to_owned(),
            weights: None,
            micro: None,
            residual: 0.0,
            date: String::new(),
            origin: String::new(),
            loaded: Some(Box::new(model)),
        });
        *[&mut self.left, &mut self.right][side.index()] = belief;
    }
}

/// Hysteresis of a manipulator's piezos as it was identified.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HysteresisBelief {
    /// Name of the model.
    pub model: String,
    /// The file beside this one that holds its weights. A small model may stand in `micro` instead.
    // Control reads no files: whoever parses a calibration reads it, and calls `load`.
    pub weights: Option<String>,
    /// The model itself.
    #[serde(default)]
    #[schemars(schema_with = "written")]
    pub micro: Option<Box<MicroModel>>,
    /// Root mean square that the model left of the displacement, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub residual: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
    #[serde(skip)]
    loaded: Option<Box<MicroModel>>,
}

/// Nobody writes a model by hand: an editor is told no more of it than who does.
fn written(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"type": "object", "title": "a table that `identify hysteresis` writes"})
}

impl HysteresisBelief {
    /// Takes in the weights that were read from `file`.
    ///
    /// # Errors
    ///
    /// When they make no model, or another one than the calibration names.
    pub fn load(&mut self, file: &str, model: MicroModel) -> Result<(), Error> {
        model
            .check()
            .map_err(|invalid| Error::new(file, "", invalid.to_string()))?;
        if let Some(other) = model.piezos.iter().find(|m| m.name() != self.model) {
            let message = format!(
                "holds a model `{}`; accepted is `{}`, as the calibration says",
                other.name(),
                self.model
            );
            return Err(Error::new(file, "model", message));
        }
        self.loaded = Some(Box::new(model));
        Ok(())
    }
}

/// Windup where it has been identified: of each kind of axis, and of axes of their own, which differ as their friction does.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Windups {
    /// Of a five-bar joint.
    pub five_bar: Option<WindupBelief>,
    /// Of a z-stage.
    pub z: Option<WindupBelief>,
    /// Of the left manipulator's axes.
    #[serde(default)]
    pub left: AxisWindups,
    /// Of the right manipulator's axes.
    #[serde(default)]
    pub right: AxisWindups,
}

/// Windup of one manipulator's axes, each in place of that of its kind.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisWindups {
    /// Of the first joint of the five-bar.
    pub a: Option<WindupBelief>,
    /// Of the second.
    pub b: Option<WindupBelief>,
    /// Of the z-stage.
    pub z: Option<WindupBelief>,
}

impl Windups {
    /// Of an axis: its own, or that of its kind.
    pub fn of(&self, at: AxisName) -> Option<&WindupBelief> {
        let kind = match at.axis {
            Axis::A | Axis::B => &self.five_bar,
            Axis::Z => &self.z,
        };
        self.own(at).or(kind.as_ref())
    }

    /// Of an axis, where it was identified on its own.
    pub fn own(&self, at: AxisName) -> Option<&WindupBelief> {
        let side = [&self.left, &self.right][at.side.index()];
        match at.axis {
            Axis::A => side.a.as_ref(),
            Axis::B => side.b.as_ref(),
            Axis::Z => side.z.as_ref(),
        }
    }

    /// The table for what is found of an axis: that of its kind, unless it has its own, which would hide it.
    pub fn table(&self, at: AxisName) -> String {
        match (self.own(at), at.axis) {
            (Some(_), _) => format!("windup.{at}"),
            (None, Axis::A | Axis::B) => "windup.five_bar".to_owned(),
            (None, Axis::Z) => "windup.z".to_owned(),
        }
    }

    /// All of them, each by its key in the table.
    fn each(&self) -> impl Iterator<Item = (String, &WindupBelief)> {
        let kinds = [("five_bar", &self.five_bar), ("z", &self.z)];
        let kinds = kinds.map(|(key, belief)| (key.to_owned(), belief.as_ref()));
        let own = AxisName::ALL.map(|at| (at.to_string(), self.own(at)));
        let all = kinds.into_iter().chain(own);
        all.filter_map(|(key, belief)| Some((key, belief?)))
    }
}

/// Windup of an axis as it was identified.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WindupBelief {
    /// Which of the two models compensates it.
    pub model: WindupModel,
    /// `W_max` of (2.20), radians of the output.
    #[serde(with = "quantity::PositiveAngle")]
    pub w_max: f64,
    /// `Q` of (2.20), radians of the output.
    #[serde(with = "quantity::PositiveAngle")]
    pub q: f64,
    /// Hardening of [`Memory`]: the parts that go with the first to the fifth power of the torque,
    /// radians.
    #[serde(with = "quantity::Angles::<POWERS>")]
    pub hardening: [f64; POWERS],
    /// The elements of [`Memory`]: way (radians) and share of the torque, at most 16.
    pub elements: Vec<[f64; 2]>,
    /// Root mean square that the model left of the windup, radians.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub residual: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// A model of windup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum WindupModel {
    /// The thesis's, [`Reversal`].
    Reversal,
    /// With full memory, [`Memory`].
    Memory,
}

impl WindupBelief {
    /// The model it describes.
    pub fn windup(&self) -> Windup {
        match self.model {
            WindupModel::Reversal => Windup::Reversal(Reversal {
                maximum: self.w_max,
                way: self.q,
            }),
            WindupModel::Memory => {
                // Elements that are not there are infinitely stiff nothings.
                let mut ways = [1.0; ELEMENTS];
                let mut stiffness = [0.0; ELEMENTS];
                for (i, [way, share]) in self.elements.iter().take(ELEMENTS).enumerate() {
                    ways[i] = *way;
                    stiffness[i] = share / way;
                }
                Windup::Memory(Memory {
                    ways,
                    stiffness,
                    hardening: self.hardening,
                })
            }
        }
    }

    fn check(&self) -> Result<(), String> {
        if self.elements.len() > ELEMENTS {
            return Err(format!(
                "has {} elements; accepted are at most {ELEMENTS}",
                self.elements.len()
            ));
        }
        let good = |[way, share]: &[f64; 2]| *way > 0.0 && way.is_finite() && share.is_finite();
        if !self.elements.iter().all(good) {
            return Err(
                "has an element that is none; accepted are ways above zero and finite shares"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

/// Servo gains of each kind of axis.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Of a five-bar joint.
    pub five_bar: AxisGains,
    /// Of a z-stage.
    pub z: AxisGains,
}

/// Gains of the PID (2.14).
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisGains {
    /// Proportional, V/count.
    #[serde(with = "quantity::NonNegativeProportional")]
    pub kp: f64,
    /// Integral, V/(count s).
    #[serde(with = "quantity::NonNegativeIntegral")]
    pub ki: f64,
    /// Derivative, V s/count.
    #[serde(with = "quantity::NonNegativeDerivative")]
    pub kd: f64,
    /// Bound of the integral's part of the voltage, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub integral_limit: f64,
    /// How fast the slowest axis of its kind follows, at its output, where that is far less than its datasheet says, m/s.
    #[serde(default, with = "quantity::Optional::<quantity::PositiveSpeed>")]
    pub speed: Option<f64>,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// Dimensions and places.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// Links of the five-bars.
    pub five_bar: FiveBarGeometry,
    /// Screws of the z-stages.
    pub z: ZGeometry,
    /// Micro manipulators.
    pub micro: MicroGeometry,
    /// The input's manipulator.
    pub left: PlacementBelief,
    /// The outputs' manipulator.
    pub right: PlacementBelief,
}

impl Geometry {
    /// The manipulator of a side.
    pub fn of(&self, side: Side) -> &PlacementBelief {
        [&self.left, &self.right][side.index()]
    }
}

/// Links of the five-bars.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FiveBarGeometry {
    /// Distance of the bases, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub base: f64,
    /// Length of the proximal links, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub proximal: f64,
    /// Length of the distal links, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub distal: f64,
    /// Endpoint at home, from the middle of the bases, metres.
    #[serde(with = "quantity::Lengths::<2>")]
    pub home: [f64; 2],
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// Screws of the z-stages.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ZGeometry {
    /// Travel for one turn of the screw, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub lead: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// Micro manipulators.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MicroGeometry {
    /// Displacement of an axis per volt, metres a volt.
    #[serde(with = "quantity::PositivePiezoGain")]
    pub gain: f64,
    /// By when it has come to rest where it was told to be, seconds; the datasheet's where nobody has measured
    /// it.
    #[serde(default, with = "quantity::Optional::<quantity::PositiveTime>")]
    pub settling: Option<f64>,
    /// From when it is told to be somewhere until a photodiode's sample of it, seconds. What searches with it and circles on it goes by
    /// that; left out: that of the printed machine, a micro of 200 Hz and a photodiode of 1 kHz.
    #[serde(
        default = "MicroGeometry::printed_lag",
        with = "quantity::NonNegativeTime"
    )]
    pub lag: f64,
    /// How well that is known, one standard deviation, seconds.
    #[serde(
        default = "MicroGeometry::printed_lag_deviation",
        with = "quantity::NonNegativeTime"
    )]
    pub lag_deviation: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

impl MicroGeometry {
    const fn printed_lag() -> f64 {
        1.2e-3
    }

    const fn printed_lag_deviation() -> f64 {
        0.4e-3
    }
}

impl PlacementBelief {
    /// By what angles ways across go along the light, as is believed, on stages that may stand as far askew as a datasheet says.
    pub fn askew(&self, spec: &Spec) -> Askew {
        self.askew.unwrap_or(Askew {
            ways: [self.yaw.sin(), 0.0],
            deviation: spec.guard.askew,
        })
    }
}

/// Where a manipulator stands.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlacementBelief {
    /// Its endpoint at home in the chip's frame, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub home: [f64; 3],
    /// Its rotation about y, radians.
    #[serde(with = "quantity::Angle")]
    pub yaw: f64,
    /// By what angles its ways in x and in y go along the light too, radians, where that was measured. Without it ways in x do
    /// by its yaw, and neither is known better than the datasheet says.
    #[serde(default)]
    pub askew: Option<Askew>,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

impl Calibration {
    /// Parses and checks the content of a `calibration.toml`; `file` is its name in errors.
    ///
    /// # Errors
    ///
    /// When a key is missing, unknown or out of range, or the workspace of the datasheet cannot
    /// be reached with these dimensions.
    pub fn parse(file: &str, text: &str, spec: &Spec) -> Result<Self, Error> {
        let mut calibration: Self = config::parse(file, text)?;
        for (side, belief) in [
            ("left", &mut calibration.hysteresis.left),
            ("right", &mut calibration.hysteresis.right),
        ] {
            let Some(belief) = belief else { continue };
            let key = format!("hysteresis.{side}.micro");
            match (belief.weights.is_some(), belief.micro.take()) {
                (false, Some(micro)) => belief
                    .load(file, *micro)
                    .map_err(|error| Error::new(file, key, error.message))?,
                (true, None) => {}
                _ => {
                    let message = "and `weights` are two sources; accepted is one of them";
                    return Err(Error::new(file, key, message));
                }
            }
        }
        for (key, belief) in calibration.windup.each() {
            belief
                .check()
                .map_err(|message| Error::new(file, format!("windup.{key}.elements"), message))?;
        }
        for (name, belief) in [
            ("five_bar", &calibration.impulse.five_bar),
            ("z", &calibration.impulse.z),
        ] {
            if let Some(belief) = belief {
                belief.check().map_err(|(key, message)| {
                    Error::new(file, format!("impulse.{name}.{key}"), message)
                })?;
            }
        }
        for side in Side::ALL {
            let spread = calibration.spread.of(side).map(|spread| spread.correlation);
            if let Some(correlation) = spread.filter(|correlation| *correlation > 1.0) {
                let key = format!("spread.{}.correlation", side.name());
                let message = format!("is {correlation}; accepted is 0 to 1");
                return Err(Error::new(file, key, message));
            }
        }
        crate::kinematics::check_workspace(&calibration.geometry.five_bar, spec)
            .map_err(|message| Error::new(file, "geometry.five_bar", message))?;
        Ok(calibration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_goes_by_its_own_windup_and_else_by_that_of_its_kind() {
        let belief = |w_max: f64| WindupBelief {
            model: WindupModel::Reversal,
            w_max,
            q: 2e-3,
            hardening: [0.0; POWERS],
            elements: Vec::new(),
            residual: 0.0,
            date: String::new(),
            origin: String::new(),
        };
        let mut windups = Windups {
            five_bar: Some(belief(1e-3)),
            ..Windups::default()
        };
        windups.right.b = Some(belief(0.5e-3));
        let of = |side, axis| windups.of(AxisName::new(side, axis)).map(|w| w.w_max);
        assert_eq!(of(Side::Left, Axis::B), Some(1e-3));
        assert_eq!(of(Side::Right, Axis::A), Some(1e-3));
        assert_eq!(of(Side::Right, Axis::B), Some(0.5e-3));
        assert_eq!(of(Side::Right, Axis::Z), None);
        // What is found of an axis goes where it is looked for.
        let table = |side, axis| windups.table(AxisName::new(side, axis));
        assert_eq!(table(Side::Left, Axis::B), "windup.five_bar");
        assert_eq!(table(Side::Right, Axis::B), "windup.right.b");
        assert_eq!(table(Side::Left, Axis::Z), "windup.z");
    }
}
