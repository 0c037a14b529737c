//! What surrounds the mechanics in a `plant.toml`: floor, temperature, camera and electronics. Nothing of it
//! by default.

use pigtail_hal::quantity;
use pigtail_hal::spec::MICRO_AXES;
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

/// The room's temperature over a shift, and what it does to a machine: `swing sin(2 pi t / period)` above the one at which the machine
/// was commissioned, of machine time `t`. What a camera's mount does is not among it: vision sees tips beside ports, both in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TemperaturePlant {
    /// How far it goes, kelvin.
    #[serde(with = "quantity::NonNegative")]
    pub swing: f64,
    /// Until it is back on the way up, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub period: f64,
    /// By what share of itself the stroke of each of a micro's two piezos grows in a kelvin.
    pub strokes: [f64; MICRO_AXES],
    /// By what share of itself the weight of the plays of their hysteresis grows in a kelvin: loops widen by a little more.
    pub hysteresis: f64,
    /// How far a kelvin moves the chip, along x, y and z of its frame, metres...
    #[serde(with = "quantity::Lengths::<3>")]
    pub chip: [f64; 3],
    /// ...the left holder...
    #[serde(with = "quantity::Lengths::<3>")]
    pub left: [f64; 3],
    /// ...and the right one.
    #[serde(with = "quantity::Lengths::<3>")]
    pub right: [f64; 3],
}

impl Default for TemperaturePlant {
    fn default() -> Self {
        Self {
            swing: 0.0,
            period: 57_600.0,
            strokes: [0.0; MICRO_AXES],
            hysteresis: 0.0,
            chip: [0.0; 3],
            left: [0.0; 3],
            right: [0.0; 3],
        }
    }
}

impl TemperaturePlant {
    /// How much warmer than when it was commissioned it is at a machine time, kelvin.
    pub(crate) fn warmer(&self, time: f64) -> f64 {
        if self.swing == 0.0 {
            return 0.0;
        }
        self.swing * (std::f64::consts::TAU * time / self.period).sin()
    }

    /// That piezos are piezos at both ends of what it goes through.
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        if self.swing > 100.0 {
            let message = format!("{} K is no room; accepted is 0 to 100", self.swing);
            return Err(("temperature.swing", message));
        }
        for (key, share) in [
            ("temperature.strokes", self.strokes[0]),
            ("temperature.strokes", self.strokes[1]),
            ("temperature.hysteresis", self.hysteresis),
        ] {
            let most = 0.5 / self.swing.max(1.0);
            if !(-most..=most).contains(&share) {
                let message = format!(
                    "{share} a kelvin is more than a half in all; accepted is -{most} to {most}"
                );
                return Err((key, message));
            }
        }
        Ok(())
    }
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
