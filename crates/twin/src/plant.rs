//! The truth about a machine and a device: `plant.toml`.

mod joint;
mod production;
mod setting;
mod spread;

pub use joint::{FrictionPlant, JointPlant, LoadLaw, MotorPlant, TransmissionPlant};
pub use production::{AdhesivePlant, HandlingPlant};
pub use setting::{CameraPlant, ElectronicsPlant, FloorPlant, TemperaturePlant, ThermalPlant};
pub(super) use spread::uniform;
pub use spread::{Misplacement, Spread, Variation};

use pigtail_hal::spec::OUTPUTS;
use pigtail_hal::{config, quantity};
use pigtail_model::Invalid;
use pigtail_model::fivebar::FiveBar;
use pigtail_model::hysteresis::{Creep, Hysteresis, HysteresisParameters};
use rand::RngExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The content of a `plant.toml`: a nominal specimen, and how far others lie from it.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// The mechanism of a five-bar, and its two joints.
    pub five_bar: FiveBarPlant,
    /// A z-stage.
    pub z_stage: ZStagePlant,
    /// A micro manipulator.
    pub micro: MicroPlant,
    /// Where both manipulators stand.
    pub placement: Placements,
    /// The device to be pigtailed.
    pub device: Device,
    /// A fiber.
    pub fiber: Fiber,
    /// Laser and photodiodes.
    pub light: Light,
    /// Light that misses the input guide.
    pub scatter: Scatter,
    /// Probes at the outputs of the axes.
    pub probe: Probe,
    /// How far things lie from where they should.
    pub misplacement: Misplacement,
    /// How far specimens differ.
    pub variation: Variation,
    /// Vibration of each holder against the chip.
    #[serde(default)]
    pub floor: FloorPlant,
    /// Parts that warm up.
    #[serde(default)]
    pub thermal: ThermalPlant,
    /// The room's temperature, and what it does.
    #[serde(default)]
    pub temperature: TemperaturePlant,
    /// The camera, where the datasheet errs about it.
    #[serde(default)]
    pub camera: CameraPlant,
    /// What stands between control and the machine's parts.
    #[serde(default)]
    pub electronics: ElectronicsPlant,
    /// What fixes a fiber to the chip.
    #[serde(default)]
    pub bond: BondPlant,
    /// What fixes a fiber in the production cycle.
    #[serde(default)]
    pub adhesive: AdhesivePlant,
    /// Grippers, dispenser and conveyor.
    #[serde(default)]
    pub handling: HandlingPlant,
}

/// What fixes a fiber to the chip: a weld, solder, an adhesive.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BondPlant {
    /// How long it takes to set, seconds: the fiber is fixed where its tip was meanwhile, on average.
    #[serde(with = "quantity::NonNegativeTime")]
    pub time: f64,
}

/// The mechanism of a five-bar, and its two joints.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FiveBarPlant {
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
    /// Friction in the bearings between the links, which couples the joints.
    #[serde(default)]
    pub bearings: BearingPlant,
    /// Share of a joint's load inertia that is mass at the endpoint, as if the links weighed nothing: by it each
    /// joint feels the other's acceleration, centripetal and Coriolis forces. Zero leaves the joints apart.
    #[serde(default, with = "quantity::Fraction")]
    pub carried: f64,
    /// Both joints are alike.
    pub joint: JointPlant,
}

/// The bearings between the links of a five-bar: two elbows and the tip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BearingPlant {
    /// Torque at which each slides, N m; zero for none.
    #[serde(with = "quantity::NonNegativeTorque")]
    pub friction: f64,
    /// How far each gives way before it slides, `q_0` of an exponential, radians.
    #[serde(with = "quantity::PositiveAngle")]
    pub presliding: f64,
}

impl Default for BearingPlant {
    fn default() -> Self {
        Self {
            friction: 0.0,
            presliding: 1e-3,
        }
    }
}

/// A z-stage.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ZStagePlant {
    /// Travel for one turn of the screw, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub lead: f64,
    /// Of its drive.
    pub joint: JointPlant,
}

/// A micro manipulator.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MicroPlant {
    /// Displacement per volt, metres a volt.
    #[serde(with = "quantity::PositivePiezoGain")]
    pub gain: f64,
    /// First resonance, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub resonance: f64,
    /// Its damping ratio.
    #[serde(with = "quantity::Fraction")]
    pub damping: f64,
    /// Share of one axis's displacement that appears in the other.
    #[serde(with = "quantity::Fraction")]
    pub coupling: f64,
    /// Largest difference between the way back and the way forward over full stroke, as a share of
    /// the range.
    #[serde(with = "quantity::Fraction")]
    pub hysteresis: f64,
    /// Share of half the range over which the slack of the hysteresis's plays falls off.
    #[serde(with = "quantity::Positive")]
    pub spread: f64,
    /// How much a loop leans to one side: share of the displacement at full stroke.
    #[serde(with = "quantity::Fraction")]
    pub skew: f64,
    /// How much the displacement saturates: share of it at full stroke.
    #[serde(with = "quantity::Fraction")]
    pub saturation: f64,
    /// Creep: share of a step by which displacement goes on in a decade of time.
    #[serde(with = "quantity::Fraction")]
    pub creep: f64,
    /// Noise of each axis, rms, metres: white at its amplifier, so no faster at the tip than its resonances let it.
    #[serde(with = "quantity::NonNegativeLength")]
    pub noise: f64,
    /// A second resonance, if there is one.
    #[serde(default)]
    pub second: Option<ModePlant>,
    /// What a piezo did before: the largest of some voltages that it was driven to before it came to rest in
    /// the middle, as a share of half its range. Zero for one that was demagnetised.
    #[serde(default, with = "quantity::Fraction")]
    pub history: f64,
}

/// A second resonance of a micro axis.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModePlant {
    /// Where it lies, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub resonance: f64,
    /// Its damping ratio.
    #[serde(with = "quantity::Fraction")]
    pub damping: f64,
    /// Share of the displacement that goes by it and not by the first.
    #[serde(with = "quantity::Fraction")]
    pub share: f64,
}

/// Where both manipulators stand.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placements {
    /// The input's manipulator.
    pub left: PlacementPlant,
    /// The outputs' manipulator.
    pub right: PlacementPlant,
}

/// Where a manipulator stands.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlacementPlant {
    /// Its endpoint at home in the chip's frame, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub home: [f64; 3],
    /// Its rotation about y, radians.
    #[serde(with = "quantity::Angle")]
    pub yaw: f64,
    /// Its rotation about its z, radians.
    #[serde(default, with = "quantity::Angle")]
    pub roll: f64,
    /// Its rotation about its x, radians.
    #[serde(default, with = "quantity::Angle")]
    pub pitch: f64,
    /// How far its z-stage leans from square to the plane of its five-bar, towards x and towards y, radians.
    #[serde(default, with = "quantity::Angles::<2>")]
    pub squareness: [f64; 2],
}

/// The device to be pigtailed.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Device {
    /// The input port in the chip's frame, metres.
    #[serde(with = "quantity::Lengths::<3>")]
    pub input: [f64; 3],
    /// The output ports, metres.
    #[serde(with = "quantity::Points::<OUTPUTS, 3>")]
    pub outputs: [[f64; 3]; OUTPUTS],
    /// Radii of the guides' mode in x and y, metres.
    #[serde(with = "quantity::Lengths::<2>")]
    pub mode_radius: [f64; 2],
    /// Angle of both facets, radians.
    #[serde(with = "quantity::Angle")]
    pub facet: f64,
    /// Refractive index of the guides.
    #[serde(with = "quantity::Positive")]
    pub index: f64,
    /// Rotation of the chip about y in its fixture, radians.
    #[serde(default, with = "quantity::Angle")]
    pub turn: f64,
    /// Light that each branch lets through, relative to a half without loss.
    #[serde(default = "whole")]
    pub transmission: [f64; OUTPUTS],
    /// A second, weaker lobe of the guides' mode: its share of the light at the peak.
    #[serde(default, with = "quantity::Fraction")]
    pub side_lobe: f64,
    /// How far above the mode it stands, metres.
    #[serde(default, with = "quantity::Length")]
    pub side_lobe_at: f64,
    /// Interference in the gap, between its brightest and its darkest, decibels.
    #[serde(default, with = "quantity::NonNegative")]
    pub ripple_db: f64,
    /// Speed at which it drifts away in x, metres a second.
    #[serde(default, with = "quantity::Speed")]
    pub drift: f64,
    /// When that begins, seconds of machine time.
    #[serde(default, with = "quantity::NonNegativeTime")]
    pub drift_from: f64,
}

fn one() -> f64 {
    1.0
}

/// The core of the thesis's sensing fiber, metres.
fn stated_core() -> f64 {
    100e-6
}

fn whole() -> [f64; OUTPUTS] {
    [1.0; OUTPUTS]
}

/// A fiber.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fiber {
    /// Radius of its mode, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub mode_radius: f64,
}

/// Laser and photodiodes.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Wavelength in vacuum, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub wavelength: f64,
    /// Refractive index of what fills the gaps between fibers and chip: 1 for air, about 1.5 for adhesive. The
    /// angle at which light leaves, how fast its beam spreads, and ripples follow from it.
    #[serde(default = "one", with = "quantity::Positive")]
    pub gap_index: f64,
    /// Photodiode signal of one output when everything couples perfectly, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub full: f64,
    /// What a photodiode's amplifier gives in the dark, volts.
    #[serde(with = "quantity::NonNegativeVoltage")]
    pub offset: f64,
    /// Noise of a photodiode sample, rms, volts.
    #[serde(with = "quantity::NonNegativeVoltage")]
    pub noise: f64,
    /// How far the offsets wander within some seconds, rms, volts.
    #[serde(default, with = "quantity::NonNegativeVoltage")]
    pub drift: f64,
    /// Room light on each photodiode, volts. It flickers with the mains.
    #[serde(default, with = "quantity::NonNegativeVoltage")]
    pub stray: f64,
    /// How far the laser's power wanders, rms, relative to its mean...
    #[serde(default, with = "quantity::NonNegative")]
    pub wander: f64,
    /// ...within about so long, seconds.
    #[serde(default = "minute", with = "quantity::PositiveTime")]
    pub wander_time: f64,
}

fn minute() -> f64 {
    60.0
}

/// Probes at the outputs of the axes.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Noise of a reading, rms, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub noise: f64,
}

/// Light that misses the input guide.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scatter {
    /// Share of [`Light::full`] in a sensing fiber deep below the top, nothing being coupled.
    #[serde(with = "quantity::NonNegative")]
    pub level: f64,
    /// Diameter of the core for which `level` is stated, metres: it grows with the core's area.
    #[serde(default = "stated_core", with = "quantity::PositiveLength")]
    pub core: f64,
    /// 1/e radius of its distribution around the outputs, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub spread: f64,
    /// Fluctuation, rms, relative to the level.
    #[serde(with = "quantity::NonNegative")]
    pub fluctuation: f64,
    /// Bandwidth of the fluctuation, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub bandwidth: f64,
}

impl Plant {
    /// Parses and checks the content of a `plant.toml`; `file` is its name in errors.
    ///
    /// # Errors
    ///
    /// When a key is missing, unknown or out of range.
    pub fn parse(file: &str, text: &str) -> Result<Self, pigtail_hal::Error> {
        config::parse::<Self>(file, text)?.checked(file)
    }

    /// The same of what has been parsed.
    ///
    /// # Errors
    ///
    /// As [`Self::parse`].
    pub fn of(file: &str, table: toml::Table) -> Result<Self, pigtail_hal::Error> {
        config::read::<Self>(file, table)?.checked(file)
    }

    fn checked(self, file: &str) -> Result<Self, pigtail_hal::Error> {
        self.check()
            .map_err(|(key, message)| pigtail_hal::Error::new(file, key, message))?;
        Ok(self)
    }
}

impl Plant {
    /// Numbers that are good of their kind and still make no machine.
    fn check(&self) -> Result<(), (&'static str, String)> {
        self.device.check(self.light.gap_index)?;
        self.check_joints()?;
        self.floor.check()?;
        self.camera.check()?;
        self.electronics.check()?;
        self.temperature.check()?;
        if self.micro.second.is_some_and(|mode| mode.damping >= 1.0) {
            let message = "1 is overdamped; accepted is a number from 0 to below 1".to_owned();
            return Err(("micro.second.damping", message));
        }
        if self.micro.damping >= 1.0 {
            let message = "1 is overdamped; accepted is a number from 0 to below 1".to_owned();
            return Err(("micro.damping", message));
        }
        self.micro.check(&self.variation)?;
        let v = &self.variation;
        for (key, value) in [
            ("variation.inertia", v.inertia),
            ("variation.friction", v.friction),
            ("variation.stiffness", v.stiffness),
            ("variation.motor", v.motor),
            ("variation.micro_gain", v.micro_gain),
            ("variation.hysteresis", v.hysteresis),
            ("variation.creep", v.creep),
            ("variation.links", v.links),
            ("variation.loss", v.loss),
            ("variation.resonance", v.resonance),
            ("variation.damping", v.damping),
        ] {
            let widest = match v.spread {
                Spread::Uniform => 0.5,
                Spread::Normal => 1.0,
            };
            if value > widest {
                let message = format!("{value} is too wide; accepted is 0 to {widest}");
                return Err((key, message));
            }
        }
        FiveBar::new(
            self.five_bar.base,
            self.five_bar.proximal,
            self.five_bar.distal,
        )
        .map_err(|invalid| ("five_bar", invalid.to_string()))?
        .inverse(self.five_bar.home[0], self.five_bar.home[1])
        .map_err(|why| {
            (
                "five_bar.home",
                format!("{why}; accepted is a place in reach"),
            )
        })?;
        Ok(())
    }

    fn check_joints(&self) -> Result<(), (&'static str, String)> {
        for (key, joint) in [
            ("five_bar.joint.presliding", &self.five_bar.joint),
            ("z_stage.joint.presliding", &self.z_stage.joint),
        ] {
            let slips = joint.friction != LoadLaw::CoulombPresliding;
            if slips && (joint.presliding <= 0.0 || joint.load_friction.coulomb() <= 0.0) {
                let message =
                    "maxwell-slip or lugre friction needs a way to rise; accepted are a presliding \
                               and a Coulomb friction of the load above zero"
                        .to_owned();
                return Err((key, message));
            }
        }
        let unrest = [
            ("five_bar.joint.unrest", &self.five_bar.joint.unrest),
            ("z_stage.joint.unrest", &self.z_stage.joint.unrest),
        ];
        for (key, unrest) in unrest {
            unrest.check().map_err(|message| (key, message))?;
        }
        Ok(())
    }
}

impl Device {
    /// Numbers that are good of their kind and still make no device.
    pub(super) fn check(&self, gap_index: f64) -> Result<(), (&'static str, String)> {
        if !(1.0..=3.0).contains(&gap_index) {
            let message = format!("{gap_index} fills no gap; accepted is 1 to 3");
            return Err(("light.gap_index", message));
        }
        for radius in self.mode_radius {
            if radius <= 0.0 {
                let message =
                    format!("{radius} m is not positive; accepted are lengths above zero");
                return Err(("device.mode_radius", message));
            }
        }
        for share in self.transmission {
            if !(0.0..=1.0).contains(&share) {
                let message = format!("{share} lets through what is not there; accepted is 0 to 1");
                return Err(("device.transmission", message));
            }
        }
        if self.turn.abs() > 0.1 {
            let message = format!(
                "{:.1} deg is no chip in its fixture; accepted is -5.7 to 5.7 deg",
                self.turn.to_degrees()
            );
            return Err(("device.turn", message));
        }
        if self.ripple_db > 10.0 {
            let message = format!("{} is beyond reason; accepted is 0 to 10", self.ripple_db);
            return Err(("device.ripple_db", message));
        }
        if !(1.0..=5.0).contains(&self.index) {
            let message = format!("{} is no guide's index; accepted is 1 to 5", self.index);
            return Err(("device.index", message));
        }
        let steepest = (1.0_f64.min(gap_index / self.index)).asin().min(PI / 3.0);
        if self.facet.abs() >= steepest {
            let message = format!(
                "light of an index of {} does not leave a facet of {:.1} deg; accepted is less than \
                 {:.1} deg",
                self.index,
                self.facet.to_degrees(),
                steepest.to_degrees()
            );
            return Err(("device.facet", message));
        }
        Ok(())
    }
}

impl MicroPlant {
    /// A specimen of an axis's hysteresis and creep, sampled every `period` seconds.
    pub(super) fn draw(
        &self,
        variation: &Variation,
        period: f64,
        rng: &mut impl RngExt,
    ) -> Result<(Hysteresis, Creep), Invalid> {
        let mut vary = |value: f64| value * variation.factor(rng, variation.hysteresis);
        // As far as there are such piezos.
        let (hysteresis, _) = Hysteresis::nearest(&HysteresisParameters {
            opening: vary(self.hysteresis).min(0.2),
            spread: vary(self.spread).clamp(0.3, 10.0),
            skew: vary(self.skew).min(0.2),
            saturation: vary(self.saturation).min(0.1),
        })?;
        let creep = self.creep * variation.factor(rng, variation.creep);
        let creep = Creep::new(creep.min(0.1), period)?;
        Ok((hysteresis, creep))
    }

    /// That every specimen is a piezo; of normal distributions, that the middle one is.
    fn check(&self, variation: &Variation) -> Result<(), (&'static str, String)> {
        let (hysteresis, creep) = match variation.spread {
            Spread::Uniform => (variation.hysteresis, variation.creep),
            Spread::Normal => (0.0, 0.0),
        };
        let most = 1.0 + hysteresis;
        for (key, value, bound) in [
            ("micro.hysteresis", self.hysteresis, 0.2 / most),
            ("micro.skew", self.skew, 0.2 / most),
            ("micro.saturation", self.saturation, 0.1 / most),
            ("micro.creep", self.creep, 0.1 / (1.0 + creep)),
        ] {
            if value > bound {
                return Err((
                    key,
                    format!("{value} is too much; accepted is 0 to {bound:.3}"),
                ));
            }
        }
        let (least, most) = (0.3 / (1.0 - hysteresis), 10.0 / most);
        if !(least..=most).contains(&self.spread) {
            let message = format!(
                "{} is no spread; accepted is {least:.3} to {most:.3}",
                self.spread
            );
            return Err(("micro.spread", message));
        }
        Ok(())
    }
}
