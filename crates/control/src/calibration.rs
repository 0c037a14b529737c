//! The belief about a machine: `calibration.toml`.

use pigtail_hal::{Error, Spec, config, quantity};
use serde::Deserialize;

/// The content of a `calibration.toml`. Written by the programs that measure, never by hand in
/// daily use; every table says when and by which run it was found.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// The servo gains.
    pub gains: Gains,
    /// Dimensions and places.
    pub geometry: Geometry,
}

/// Servo gains of each kind of axis.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Of a five-bar joint.
    pub five_bar: AxisGains,
    /// Of a z-stage.
    pub z: AxisGains,
}

/// Gains of the PID (2.14).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisGains {
    /// Proportional, V/count.
    #[serde(deserialize_with = "quantity::non_negative_proportional")]
    pub kp: f64,
    /// Integral, V/(count s).
    #[serde(deserialize_with = "quantity::non_negative_integral")]
    pub ki: f64,
    /// Derivative, V s/count.
    #[serde(deserialize_with = "quantity::non_negative_derivative")]
    pub kd: f64,
    /// Bound of the integral's part of the voltage, volts.
    #[serde(deserialize_with = "quantity::positive_voltage")]
    pub integral_limit: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// Dimensions and places.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// The five-bars.
    pub five_bar: FiveBarGeometry,
    /// The z-stages.
    pub z: ZGeometry,
    /// The micro manipulators.
    pub micro: MicroGeometry,
    /// Where the input's manipulator stands.
    pub left: PlacementBelief,
    /// Where the outputs' manipulator stands.
    pub right: PlacementBelief,
}

/// Links of the five-bars.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FiveBarGeometry {
    /// Distance of the bases, metres.
    #[serde(deserialize_with = "quantity::non_negative_length")]
    pub base: f64,
    /// Length of the proximal links, metres.
    #[serde(deserialize_with = "quantity::positive_length")]
    pub proximal: f64,
    /// Length of the distal links, metres.
    #[serde(deserialize_with = "quantity::positive_length")]
    pub distal: f64,
    /// Endpoint at home, from the middle of the bases, metres.
    #[serde(deserialize_with = "quantity::lengths")]
    pub home: [f64; 2],
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// Screws of the z-stages.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZGeometry {
    /// Travel for one turn of the screw, metres.
    #[serde(deserialize_with = "quantity::positive_length")]
    pub lead: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// Micro manipulators.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MicroGeometry {
    /// Displacement of an axis per volt, metres a volt.
    #[serde(deserialize_with = "quantity::positive_piezo_gain")]
    pub gain: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// Where a manipulator stands.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacementBelief {
    /// Its endpoint at home in the chip's frame, metres.
    #[serde(deserialize_with = "quantity::lengths")]
    pub home: [f64; 3],
    /// Its rotation about y, radians.
    #[serde(deserialize_with = "quantity::angle")]
    pub yaw: f64,
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
        let calibration: Self = config::parse(file, text)?;
        crate::kinematics::check_workspace(&calibration.geometry.five_bar, spec)
            .map_err(|message| Error::new(file, "geometry.five_bar", message))?;
        Ok(calibration)
    }
}
