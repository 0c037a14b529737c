//! The datasheet of a machine: what its maker would print, and both sides may read.

mod names;

pub use names::{AXES, Axis, AxisName, CHANNELS, Channel, MICRO_AXES, OUTPUTS, SIDES, Side};

use crate::quantity;
use schemars::JsonSchema;
use serde::Deserialize;

/// The datasheet: `machine.toml`. Both manipulators are alike.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// The machine's name.
    pub name: String,
    /// The servo card.
    pub servo: ServoSpec,
    /// Both joints of a five-bar, and the limits of its endpoint.
    pub five_bar: FiveBarSpec,
    /// The linear stage of each manipulator.
    pub z_stage: ZStageSpec,
    /// One at each endpoint.
    pub micro: MicroSpec,
    /// The laser at the input fiber's far end.
    #[serde(default)]
    pub laser: LaserSpec,
    /// The photodiodes with their amplifier and A/D converter.
    pub photodiode: PhotodiodeSpec,
    /// The camera above the chip.
    pub vision: VisionSpec,
    /// The large-core multimode fiber mounted beside the output fiber.
    pub sensing_fiber: SensingFiberSpec,
    /// Probes at the outputs.
    pub probe: Option<ProbeSpec>,
    /// The holder at a manipulator's endpoint.
    #[serde(default)]
    pub holder: HolderSpec,
    /// What fixes a fiber to the chip.
    #[serde(default)]
    pub bond: BondSpec,
    /// What a guard stops the machine at.
    #[serde(default)]
    pub guard: GuardSpec,
    /// Grippers, dispenser and conveyor.
    #[serde(default)]
    pub handling: HandlingSpec,
}

/// How long grippers, dispenser and conveyor take, as their makers say.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HandlingSpec {
    /// To grip a fiber at its place on the tray, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub pick: f64,
    /// To put adhesive on a tip: for each nanolitre, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub wet: f64,
    /// To open a holder, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub release: f64,
    /// To bring the next device, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub index: f64,
}

impl Default for HandlingSpec {
    fn default() -> Self {
        Self {
            pick: 2.0,
            wet: 0.05,
            release: 0.3,
            index: 3.0,
        }
    }
}

/// What fixes a fiber to the chip: a weld, solder, an adhesive.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BondSpec {
    /// For how long a fiber has to be held until it is fixed, at most, seconds. It is fixed where its tip was on average, so that
    /// what shakes faster averages out. Nought: in an instant, wherever it happens to be.
    #[serde(with = "quantity::NonNegativeTime")]
    pub time: f64,
}

/// The holder at a manipulator's endpoint, a box behind its fiber's tip.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HolderSpec {
    /// How far the fiber's tip stands out of it, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub tip: f64,
    /// Its width across the chip, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub width: f64,
    /// Its height, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub height: f64,
}

impl Default for HolderSpec {
    fn default() -> Self {
        Self {
            tip: 5e-3,
            width: 6e-3,
            height: 6e-3,
        }
    }
}

/// What a guard stops the machine at, beyond the limits that are stated elsewhere. Every key has a
/// default.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GuardSpec {
    /// How many times the datasheet's speed an endpoint may have.
    #[serde(with = "quantity::Positive")]
    pub overspeed: f64,
    /// How far an endpoint may be from where its servo wants it in x and y, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub following_xy: f64,
    /// The same in z, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub following_z: f64,
    /// Least distance of a tip from the chip by vision and encoders, three standard deviations less,
    /// metres.
    #[serde(with = "quantity::PositiveLength")]
    pub clearance: f64,
    /// How far a fiber's tip may stand from where its holder should have it, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub placement: f64,
    /// What a transmission may hide of a motion of the endpoint in x and y, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub windup: f64,
    /// The same in z, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub windup_z: f64,
    /// By what time of a motion an output follows its motor where a probe watches it: what resists its
    /// speed winds the transmission up. Twice as much is accepted, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub lag: f64,
    /// By what angle a manipulator may stand askew beside what is known of that, standard deviation, radians: what goes across goes so
    /// much of that along, too, and a frame shows it. Stages that are bolted to a table stand askew by 2 to 5 mrad before they are
    /// measured.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub askew: f64,
    /// By what share of a way lead, links and the camera's scale may be wrong, standard deviation: what was seen from afar is known
    /// as much worse.
    #[serde(with = "quantity::Positive")]
    pub scale: f64,
    /// By what angle a facet may be cut otherwise than by design, standard deviation, radians: where a tip is beside its port, the facet
    /// may stand out by so much more. Polishers state 0.3 to 0.5 degrees at most.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub facet: f64,
    /// How long a photodiode may read the end of its range, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub saturated: f64,
    /// How far z goes back when the machine stops, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub retract: f64,
}

impl GuardSpec {
    /// Standard deviations of what vision knows that are taken off a distance from the chip.
    pub const SIGMAS: f64 = 3.0;
    /// Cycles until a stop takes effect: what was measured at the end of one is answered in the next, and an amplifier
    /// behind a fieldbus gets that a cycle later.
    pub const REACTION: f64 = 2.0;
    /// A z-stage is braked by so many times the acceleration that it is moved with, at least: it is driven back with more
    /// than half of its voltage.
    pub const BRAKES: f64 = 2.0;
    /// Nearer than this a fiber is where it is because its light led it there, metres: whoever goes aside then, to where an inclined facet
    /// stands out, is believed to come nearer to it.
    pub const LED: f64 = 30e-6;
    /// What hysteresis may make of a way of a micro, as a share of it.
    pub const HYSTERESIS: f64 = 0.25;
    /// What is known of a tip is never worth more than the last 200 frames, 8 s: chip and holders warm, by 0.01 um/s and more, and the mean of all frames
    /// of a tip that stands for minutes is where it was long ago.
    pub const FORGETS: f64 = 1.0 / 200.0;

    /// By how much more or less than the `slope` of its design a facet may stand out, metres for a metre aside of its port.
    pub fn steeper(&self, slope: f64) -> f64 {
        Self::SIGMAS * self.facet * (1.0 + slope * slope)
    }
}

impl Default for GuardSpec {
    fn default() -> Self {
        Self {
            overspeed: 1.5,
            following_xy: 300e-6,
            following_z: 15e-6,
            clearance: 1e-6,
            placement: 150e-6,
            windup: 150e-6,
            windup_z: 2e-6,
            lag: 1.5e-3,
            askew: 2e-3,
            scale: 2e-3,
            facet: 0.15_f64.to_radians(),
            saturated: 50e-3,
            retract: 500e-6,
        }
    }
}

/// The servo card.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ServoSpec {
    /// Servo cycles a second, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub rate: f64,
    /// Amplifiers that have heard of no command for so long let go of their motors, seconds.
    #[serde(default = "watchdog", with = "quantity::PositiveTime")]
    pub watchdog: f64,
}

fn watchdog() -> f64 {
    1e-3
}

/// A geared motor driven in voltage mode.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DriveSpec {
    /// Motor turns for one turn of the output, `1/r` of the thesis.
    #[serde(with = "quantity::Positive")]
    pub gear_ratio: f64,
    /// Encoder counts in one turn of the motor.
    pub counts_per_turn: u32,
    /// The amplifier saturates at plus and minus this voltage, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub voltage: f64,
    /// Highest speed of the motor, radians a second.
    #[serde(with = "quantity::PositiveRotation")]
    pub speed: f64,
    /// The voltage at which the motor turns for certain with its axis at rest, volts. A quarter of
    /// what the amplifier gives where it is not said.
    #[serde(default, with = "quantity::Optional::<quantity::PositiveVoltage>")]
    pub start: Option<f64>,
    /// What an amplifier plays out by itself.
    pub pulse: Option<PulseSpec>,
    /// What the response to a step must be.
    pub step: Option<StepSpec>,
}

/// What the response to a step must be, of the size that the axis is tuned with.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StepSpec {
    /// Longest time from 10 to 90 % of the step, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub rise: f64,
    /// Longest time until the encoder stays within one count, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub settling: f64,
}

/// What an amplifier plays out by itself ([`Pulse`](crate::Pulse)).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PulseSpec {
    /// Greatest magnitude of a pulse's voltage, volts. May be above what it can hold.
    #[serde(with = "quantity::PositiveVoltage")]
    pub voltage: f64,
    /// It plays harmonics up to this frequency as they are, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub bandwidth: f64,
}

impl DriveSpec {
    /// The voltage at which the motor turns for certain with its axis at rest, volts.
    pub fn start(&self) -> f64 {
        self.start.unwrap_or(0.25 * self.voltage)
    }

    /// Motor angle of one encoder count, radians.
    pub fn count(&self) -> f64 {
        std::f64::consts::TAU / f64::from(self.counts_per_turn)
    }
}

/// Both joints of a five-bar, and the limits of its endpoint.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FiveBarSpec {
    /// Each joint's motor, gear and amplifier.
    pub drive: DriveSpec,
    /// Edge of the square workspace around home, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub workspace: f64,
    /// Highest speed of the endpoint, metres a second.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
    /// Highest acceleration of the endpoint, metres a second squared.
    #[serde(with = "quantity::PositiveAcceleration")]
    pub acceleration: f64,
    /// Highest jerk of the endpoint, metres a second cubed.
    #[serde(with = "quantity::PositiveJerk")]
    pub jerk: f64,
}

/// A z-stage.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ZStageSpec {
    /// The motor, belt and amplifier.
    pub drive: DriveSpec,
    /// Travel, centred on home, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub travel: f64,
    /// Highest speed, metres a second.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
    /// Highest acceleration, metres a second squared.
    #[serde(with = "quantity::PositiveAcceleration")]
    pub acceleration: f64,
    /// Highest jerk, metres a second cubed.
    #[serde(with = "quantity::PositiveJerk")]
    pub jerk: f64,
}

/// A micro manipulator: two piezo axes at right angles.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MicroSpec {
    /// Range of each axis, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub range: f64,
    /// Amplifier input over that range, from zero, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub voltage: f64,
    /// Angle of the first axis from the manipulator's x, radians.
    #[serde(with = "quantity::Angle")]
    pub angle: f64,
    /// Smallest step of the D/A converter at the endpoint, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub resolution: f64,
    /// By when it has come to rest where it was told to be, seconds, of which its maker is sure.
    #[serde(default = "MicroSpec::usual_settling", with = "quantity::PositiveTime")]
    pub settling: f64,
}

impl MicroSpec {
    /// Of a stage with a resonance of 100 Hz or more: eleven time constants at a damping of 0.7, two and a half
    /// at 0.15.
    const fn usual_settling() -> f64 {
        25e-3
    }
}

/// The photodiodes with their amplifier and A/D converter.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotodiodeSpec {
    /// Samples a second, hertz. Divides the servo rate.
    #[serde(with = "quantity::PositiveFrequency")]
    pub rate: f64,
    /// Bandwidth of diode and amplifier, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub bandwidth: f64,
    /// Range of the converter, from zero, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub range: f64,
    /// Resolution of the converter, bits.
    pub bits: u32,
}

/// The laser at the input fiber's far end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LaserSpec {
    /// Least power that it can be set to, or dimmed to by an attenuator, percent of its full power. A hundred where it is on or off.
    #[serde(deserialize_with = "percent")]
    pub least_percent: u8,
}

impl Default for LaserSpec {
    fn default() -> Self {
        Self { least_percent: 100 }
    }
}

impl LaserSpec {
    /// The nearest that it can be set to, percent of its full power.
    pub fn nearest(&self, percent: u8) -> u8 {
        percent.clamp(self.least_percent, 100)
    }
}

fn percent<'de, D: serde::Deserializer<'de>>(from: D) -> Result<u8, D::Error> {
    let percent = u8::deserialize(from)?;
    if (1..=100).contains(&percent) {
        return Ok(percent);
    }
    Err(serde::de::Error::custom(format!(
        "{percent} percent, where 1 to 100 are accepted"
    )))
}

impl VisionSpec {
    /// How old a frame is that is still good for something, seconds: one that a busy computer has held up.
    pub fn oldest(&self) -> f64 {
        2.0 * self.latency.max(1.0 / self.rate)
    }
}

impl PhotodiodeSpec {
    /// Smallest step of the converter, volts.
    pub fn step(&self) -> f64 {
        self.range / f64::from(1_u32 << self.bits)
    }
}

/// The camera above the chip.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VisionSpec {
    /// Frames a second, hertz. Divides the servo rate.
    #[serde(with = "quantity::PositiveFrequency")]
    pub rate: f64,
    /// From exposure to the arrival of the result, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub latency: f64,
    /// Standard deviation of the independent noise of one frame, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub sigma: f64,
    /// Bound of its fixed error across the chip (x), metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub accuracy_x: f64,
    /// Bound of its fixed error along the waveguide (z), metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub accuracy_z: f64,
    /// Standard deviation of where a facet lies along z in its frame, metres: polishing, and how well the frame is laid on a
    /// device. Nothing if it is not said.
    #[serde(default, with = "quantity::NonNegativeLength")]
    pub facet_z: f64,
    /// How far aside of the first port of a side a tip may be for its fixed error to be within these bounds, metres; left out:
    /// as far as it goes. On longer ways what a manipulator's lead, links and stand are believed to be adds up.
    #[serde(default, with = "quantity::Optional::<quantity::PositiveLength>")]
    pub field_aside: Option<f64>,
    /// The same of how far from the facet it may be, metres.
    #[serde(default, with = "quantity::Optional::<quantity::PositiveLength>")]
    pub field_away: Option<f64>,
}

impl VisionSpec {
    /// A fixed error may be so many times what the datasheet states: whoever measured it had a target, and a day, of his
    /// own. A choice.
    const STATED: f64 = 1.25;

    /// What is believed of the bounds of the fixed error in x and z, metres.
    pub fn believed(&self) -> [f64; 2] {
        [self.accuracy_x, self.accuracy_z].map(|stated| Self::STATED * stated)
    }
}

/// The large-core multimode fiber mounted beside the output fiber (thesis 3.2.1, method 3).
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensingFiberSpec {
    /// Core diameter, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub core: f64,
    /// From the output fiber's tip to the sensing fiber's, in the manipulator's frame, metres.
    /// Set back in z, so that it cannot touch the chip while the output fiber is brought there.
    #[serde(with = "quantity::Lengths::<3>")]
    pub offset: [f64; 3],
}

/// Probes at the outputs: capacitance probes beside the base links of the five-bars, an
/// interpolating encoder on the z-stages (thesis 2.4.1, 2.5). Read every servo cycle.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProbeSpec {
    /// Distance of a capacitance probe from its joint, metres: it measures that times the angle.
    #[serde(with = "quantity::PositiveLength")]
    pub arm: f64,
}

impl Spec {
    /// Parses and checks the content of a `machine.toml`; `file` is its name in errors.
    ///
    /// # Errors
    ///
    /// When a key is missing, unknown or out of range, or rates do not divide.
    pub fn parse(file: &str, text: &str) -> Result<Self, crate::Error> {
        let spec: Self = crate::config::parse(file, text)?;
        let error = |key: &str, message: String| crate::Error::new(file, key, message);
        for (key, rate) in [
            ("photodiode.rate", spec.photodiode.rate),
            ("vision.rate", spec.vision.rate),
        ] {
            let cycles = spec.servo.rate / rate;
            if cycles < 1.0 || (cycles - cycles.round()).abs() > 1e-9 {
                return Err(error(
                    key,
                    format!(
                        "{rate} Hz does not divide the servo rate; accepted is {} Hz divided by \
                         a whole number",
                        spec.servo.rate
                    ),
                ));
            }
        }
        for (key, drive) in [
            ("five_bar.drive", &spec.five_bar.drive),
            ("z_stage.drive", &spec.z_stage.drive),
        ] {
            if let Some(pulse) = drive.pulse
                && !(10.0..=1e6).contains(&pulse.bandwidth)
            {
                return Err(error(
                    &format!("{key}.pulse.bandwidth"),
                    format!(
                        "{} Hz is out of range; accepted is 10 to 1000000 Hz",
                        pulse.bandwidth
                    ),
                ));
            }
            if drive.counts_per_turn == 0 {
                return Err(error(
                    &format!("{key}.counts_per_turn"),
                    "0 counts; accepted is one or more".to_owned(),
                ));
            }
        }
        spec.check_ranges()
            .map_err(|(key, message)| error(key, message))?;
        Ok(spec)
    }

    /// Numbers that are good of their kind and still make no machine.
    fn check_ranges(&self) -> Result<(), (&'static str, String)> {
        let within = |key, value: f64, low: f64, high: f64, unit: &str, scale: f64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            let message = format!(
                "{} {unit} is out of range; accepted is {} to {} {unit}",
                value * scale,
                low * scale,
                high * scale
            );
            Err((key, message))
        };
        within("servo.rate", self.servo.rate, 100.0, 1e5, "Hz", 1.0)?;
        within("vision.rate", self.vision.rate, 1.0, 1e3, "Hz", 1.0)?;
        within(
            "photodiode.rate",
            self.photodiode.rate,
            10.0,
            1e6,
            "Hz",
            1.0,
        )?;
        within(
            "photodiode.bits",
            f64::from(self.photodiode.bits),
            1.0,
            24.0,
            "bits",
            1.0,
        )?;
        within(
            "vision.latency",
            self.vision.latency,
            0.0,
            1.0 / self.vision.rate,
            "ms",
            1e3,
        )?;
        let [x, y, z] = self.sensing_fiber.offset;
        within("sensing_fiber.offset (x)", x.abs(), 0.0, 5e-3, "um", 1e6)?;
        within("sensing_fiber.offset (y)", y.abs(), 0.0, 5e-3, "um", 1e6)?;
        // It must not touch the chip while the output fiber is brought there.
        within("sensing_fiber.offset (z)", z, -5e-3, -1e-6, "um", 1e6)?;
        let rpm = std::f64::consts::TAU / 60.0;
        for (key, drive) in [
            ("five_bar.drive.speed", &self.five_bar.drive),
            ("z_stage.drive.speed", &self.z_stage.drive),
        ] {
            within(key, drive.speed, 10.0 * rpm, 1e5 * rpm, "rpm", 1.0 / rpm)?;
        }
        // Crossing the workspace takes a minute at most, by each of the limits alone: what is
        // slower was mistyped.
        let (f, z) = (&self.five_bar, &self.z_stage);
        within("five_bar.workspace", f.workspace, 1e-4, 1.0, "mm", 1e3)?;
        within("z_stage.travel", z.travel, 1e-4, 1.0, "mm", 1e3)?;
        for (key, speed, way) in [
            ("five_bar.speed", f.speed, f.workspace),
            ("z_stage.speed", z.speed, z.travel),
        ] {
            within(key, speed, way / 60.0, 10.0, "mm/s", 1e3)?;
        }
        for (key, acceleration, way) in [
            ("five_bar.acceleration", f.acceleration, f.workspace),
            ("z_stage.acceleration", z.acceleration, z.travel),
        ] {
            within(key, acceleration, way / 900.0, 1e3, "m/s2", 1.0)?;
        }
        for (key, jerk, way) in [
            ("five_bar.jerk", f.jerk, f.workspace),
            ("z_stage.jerk", z.jerk, z.travel),
        ] {
            within(key, jerk, way / 6750.0, 1e6, "m/s3", 1.0)?;
        }
        Ok(())
    }

    /// The servo period, seconds.
    pub fn period(&self) -> f64 {
        1.0 / self.servo.rate
    }

    /// The drive of an axis.
    pub fn drive(&self, axis: Axis) -> &DriveSpec {
        match axis {
            Axis::A | Axis::B => &self.five_bar.drive,
            Axis::Z => &self.z_stage.drive,
        }
    }
}
