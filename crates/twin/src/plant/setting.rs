//! What surrounds the mechanics in a `plant.toml`: floor, temperature, camera and electronics. Nothing of it
//! by default.

use pigtail_hal::quantity;
use schemars::JsonSchema;
use serde::Deserialize;

/// Vibration of each holder against the chip, as a floor gives it to a table.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FloorPlant {
    /// Rms along x, y and z, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub rms: [f64; 3],
    /// The band that it lies in begins here, hertz...
    #[serde(with = "quantity::PositiveFrequency")]
    pub low: f64,
    /// ...and ends here.
    #[serde(with = "quantity::PositiveFrequency")]
    pub high: f64,
}

impl Default for FloorPlant {
    fn default() -> Self {
        Self {
            rms: [0.0; 3],
            low: 10.0,
            high: 200.0,
        }
    }
}

/// Steady creep of parts that warm up, along x, y and z of the chip's frame, metres a second.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ThermalPlant {
    /// Of the chip.
    #[serde(with = "quantity::Speeds::<3>")]
    pub chip: [f64; 3],
    /// Of the left holder.
    #[serde(with = "quantity::Speeds::<3>")]
    pub left: [f64; 3],
    /// Of the right holder.
    #[serde(with = "quantity::Speeds::<3>")]
    pub right: [f64; 3],
}

/// The camera as it really is, where the datasheet errs about it.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraPlant {
    /// How far everything is seen from where it is, in x and z, beside what each fiber brings, metres.
    #[serde(with = "quantity::Lengths::<2>")]
    pub bias: [f64; 2],
    /// Error of its scale in x and z: what a metre from a port is seen too long.
    pub scale: [f64; 2],
    /// Half ranges of the fixed error of a fiber in x and z, as many times what the datasheet says.
    pub error: [f64; 2],
    /// Noise of a frame, rms, as many times what the datasheet says.
    pub noise: f64,
    /// Latency, as many times what the datasheet says.
    pub latency: f64,
}

impl Default for CameraPlant {
    fn default() -> Self {
        Self {
            bias: [0.0; 2],
            scale: [0.0; 2],
            error: [1.0; 2],
            noise: 1.0,
            latency: 1.0,
        }
    }
}

/// What stands between control and the machine's parts.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ElectronicsPlant {
    /// How much later than they were told motors and piezos get their voltages, whole servo cycles, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub delay: f64,
    /// Error of interpolation of the encoders, amplitude, counts.
    pub interpolation: f64,
    /// Counts in which it repeats: a period of the encoder's lines.
    pub counts_per_line: f64,
}

impl Default for ElectronicsPlant {
    fn default() -> Self {
        Self {
            delay: 0.0,
            interpolation: 0.0,
            counts_per_line: 4.0,
        }
    }
}

/// More than this no servo is late, seconds.
const LATEST: f64 = 10e-3;

impl FloorPlant {
    pub(crate) fn check(&self) -> Result<(), (&'static str, String)> {
        if self.rms.iter().any(|rms| *rms < 0.0) {
            let message = "is negative; accepted are three lengths of zero or more";
            return Err(("floor.rms", message.to_owned()));
        }
        if self.low >= self.high {
            let message = format!(
                "{} Hz does not end above {} Hz; accepted is a band that does",
                self.high, self.low
            );
            return Err(("floor.high", message));
        }
        Ok(())
    }
}

impl CameraPlant {
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        if self.scale.iter().any(|scale| !(-0.5..=0.5).contains(scale)) {
            let message = format!("{:?} is no scale; accepted is -0.5 to 0.5", self.scale);
            return Err(("camera.scale", message));
        }
        for (key, times) in [
            ("camera.error", self.error[0]),
            ("camera.error", self.error[1]),
            ("camera.noise", self.noise),
            ("camera.latency", self.latency),
        ] {
            if !(0.0..=100.0).contains(&times) {
                return Err((key, "is beyond reason; accepted is 0 to 100".to_owned()));
            }
        }
        Ok(())
    }
}

impl ElectronicsPlant {
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        if self.delay > LATEST {
            let message = format!("{} s is no servo; accepted is 0 to 10 ms", self.delay);
            return Err(("electronics.delay", message));
        }
        if !(0.0..=100.0).contains(&self.interpolation) {
            let message = format!("{} counts; accepted is 0 to 100", self.interpolation);
            return Err(("electronics.interpolation", message));
        }
        if !(self.counts_per_line.is_finite() && self.counts_per_line >= 1.0) {
            let message = format!("{}; accepted is 1 or more", self.counts_per_line);
            return Err(("electronics.counts_per_line", message));
        }
        Ok(())
    }
}
