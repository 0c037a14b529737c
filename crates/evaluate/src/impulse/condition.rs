//! What is not known of a machine under impulse control: changes to the truth, as the thesis assumes
//! them (4.3.2), and worse ones.

use super::response::joint_plant;
use pigtail_hal::AxisName;
use pigtail_session::job::Ended;
use pigtail_session::setup::{Setup, unfit};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Relative standard deviation of friction, of the motor's and the load's each.
const FRICTION: f64 = 0.1;
/// Share of an encoder count by which the motor is displaced at rest, rms: 3.1e-4 rad on a z-stage.
const STATE: f64 = 0.1;
/// Noise of a reading of the probe, rms, metres.
const NOISE: f64 = 4e-9;

/// What is uncertain. Control is told nothing of it.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
pub enum Condition {
    /// Friction of 10 %, a tenth of a count of the motor's place, 4 nm of a reading
    #[default]
    Thesis,
    /// Besides, friction is 30 % higher
    High,
    /// Besides, friction is 30 % lower
    Low,
    /// Besides, friction rises by 20 % in the first second
    Drift,
    /// Besides, the load's friction is 20 % higher forward and 20 % lower backward
    Directions,
    /// The specimen as it is drawn, and nothing else
    Quiet,
}

impl Condition {
    /// Its name in options and documents.
    pub fn name(self) -> &'static str {
        match self {
            Self::Thesis => "thesis",
            Self::High => "high",
            Self::Low => "low",
            Self::Drift => "drift",
            Self::Directions => "directions",
            Self::Quiet => "quiet",
        }
    }

    /// The rig with the truth changed as `seed` draws it.
    ///
    /// # Errors
    ///
    /// When the plant makes no machine.
    pub fn applied(self, setup: &Setup, at: AxisName, seed: u64) -> Result<Setup, Ended> {
        let mut setup = setup.clone();
        if self == Self::Quiet {
            return Ok(setup);
        }
        setup.plant.probe.noise = NOISE;
        // Drawn here, around a mean, instead of within bounds with the specimen.
        setup.plant.variation.friction = 0.0;
        let count = setup.rig.spec.drive(at.axis).count();
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let level = match self {
            Self::High => 1.3,
            Self::Low => 0.7,
            _ => 1.0,
        };
        let mut factor = || {
            let draw: f64 = StandardNormal.sample(&mut rng);
            level * (1.0 + FRICTION * draw).max(0.1)
        };
        let joint = joint_plant(&mut setup, at.axis);
        let scaled = |friction: pigtail_twin::plant::FrictionPlant, by: f64| {
            friction.times(by).map_err(unfit)
        };
        joint.load_friction = scaled(joint.load_friction, factor())?;
        joint.motor_friction = scaled(joint.motor_friction, factor())?;
        joint.unrest.jolt = STATE * count;
        match self {
            Self::Drift => {
                joint.unrest.drift = 0.2;
                joint.unrest.drift_time = 1.0;
            }
            Self::Directions => joint.unrest.asymmetry = 0.2,
            _ => {}
        }
        Ok(setup)
    }
}
