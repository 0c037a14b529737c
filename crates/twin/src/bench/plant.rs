//! The truth about a bench and a device: `plant.toml` beside a datasheet of the kind `bench`.

use crate::plant::{Device, Fiber, FloorPlant, Light, Scatter};
use pigtail_hal::{Error, config, quantity};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::PI;

/// The content of a bench's `plant.toml`.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchPlant {
    /// The stages that go far.
    pub coarse: CoarsePlant,
    /// The stages that go exactly.
    pub fine: FinePlant,
    /// Where the arms' frames are.
    pub origin: Origins,
    /// The device to be pigtailed.
    pub device: Device,
    /// A fiber.
    pub fiber: Fiber,
    /// Laser, and what the meter makes of it.
    pub light: Light,
    /// The power meter.
    pub meter: MeterPlant,
    /// Light that misses the input guide.
    pub scatter: Scatter,
    /// How far things lie from where they should.
    pub misplacement: BenchMisplacement,
    /// How far specimens differ.
    pub variation: BenchVariation,
    /// Parts that warm up.
    pub thermal: BenchThermal,
    /// Vibration of each arm against the chip.
    #[serde(default)]
    pub floor: FloorPlant,
}

/// Steppers.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoarsePlant {
    /// How far an axis falls short when it turns back, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub backlash: f64,
    /// How far it wanders about where its screw has it, rms, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub repeatability: f64,
    /// Travel in which it has wandered, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub correlation: f64,
    /// Lead of its screw, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub screw: f64,
    /// Amplitude of the screw's error, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub screw_error: f64,
    /// Noise of what counts at the motor, rms, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub encoder: f64,
}

/// Piezos in closed loops of the second order.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FinePlant {
    /// Of the closed loop, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub bandwidth: f64,
    /// Its damping ratio.
    #[serde(with = "quantity::Fraction")]
    pub damping: f64,
    /// What it shakes by itself, rms, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub jitter: f64,
    /// Noise of its sensor, rms, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub sensor: f64,
    /// How late its sensor is, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub sensor_lag: f64,
    /// Share of a displacement that creeps without being seen by the sensor.
    #[serde(with = "quantity::Fraction")]
    pub creep: f64,
    /// How soon, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub creep_time: f64,
}

/// Origins of the arms' frames in the chip's frame. The left one is not turned; the right one is by half a turn about y.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Origins {
    /// The input's arm, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub left: [f64; 3],
    /// The outputs' arm, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub right: [f64; 3],
}

/// A power meter.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeterPlant {
    /// Noise of a sample relative to it, rms.
    #[serde(with = "quantity::Fraction")]
    pub relative: f64,
    /// It takes the mean of so long before the moment that a sample is said to be of, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub averaging: f64,
    /// From that moment until the sample is heard of, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub latency: f64,
}

/// How far things lie from where they should: standard deviations of normal distributions, up to three of them.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchMisplacement {
    /// The chip in its fixture across, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub chip_x: f64,
    /// Up, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub chip_y: f64,
    /// Along the guides, against a stop, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub chip_z: f64,
    /// Each fiber in its holder, across, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub fiber_x: f64,
    /// Up, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub fiber_y: f64,
    /// Along, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub fiber_z: f64,
    /// Tilt of each fiber about x and about y, radians.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub tilt: f64,
    /// What teaching erred by across, of each arm, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub taught: f64,
    /// How far each arm's z leans, towards x and towards y, radians.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub squareness: f64,
}

/// How far specimens differ, relative.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchVariation {
    /// Bandwidth and damping of the fine loops, standard deviation.
    #[serde(rename = "loop", with = "quantity::Fraction")]
    pub closed_loop: f64,
    /// Greatest excess loss of each branch of the device.
    #[serde(with = "quantity::Fraction")]
    pub loss: f64,
}

/// Parts that warm up.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchThermal {
    /// Steady creep of each arm against the chip along each axis, standard deviation, metres a second.
    #[serde(with = "quantity::NonNegativeSpeed")]
    pub rms: f64,
}

impl BenchPlant {
    /// Parses and checks the content of a `plant.toml`; `file` is its name in errors.
    ///
    /// # Errors
    ///
    /// When a key is missing, unknown or out of range.
    pub fn parse(file: &str, text: &str) -> Result<Self, Error> {
        let plant: Self = config::parse(file, text)?;
        plant
            .check()
            .map_err(|(key, message)| Error::new(file, key, message))?;
        Ok(plant)
    }

    fn check(&self) -> Result<(), (&'static str, String)> {
        self.device.check(self.light.gap_index)?;
        self.floor.check()?;
        let within = |key, value: f64, low: f64, high: f64, unit: &str| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err((
                key,
                format!("{value} {unit} is out of range; accepted is {low} to {high} {unit}"),
            ))
        };
        let (f, m) = (&self.fine, &self.misplacement);
        within("fine.bandwidth", f.bandwidth, 1.0, 200.0, "Hz")?;
        within("fine.damping", f.damping, 0.2, 0.95, "")?;
        within("fine.creep", f.creep, 0.0, 0.1, "")?;
        within("fine.sensor_lag", f.sensor_lag, 0.0, 0.1, "s")?;
        within("meter.relative", self.meter.relative, 0.0, 0.5, "")?;
        within("meter.averaging", self.meter.averaging, 0.0, 0.1, "s")?;
        within("meter.latency", self.meter.latency, 0.0, 0.5, "s")?;
        within("variation.loop", self.variation.closed_loop, 0.0, 0.05, "")?;
        within("misplacement.tilt", m.tilt, 0.0, 0.1 * PI, "rad")?;
        within("misplacement.squareness", m.squareness, 0.0, 0.1, "rad")
    }
}
