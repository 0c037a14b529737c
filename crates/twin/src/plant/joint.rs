//! One joint of a `plant.toml`: motor, transmission and friction, and a specimen of them.

use super::Variation;
use crate::unrest::UnrestPlant;
use pigtail_hal::quantity;
use pigtail_model::Invalid;
use pigtail_model::friction::Friction;
use pigtail_model::joint::JointParameters;
use pigtail_model::motor::Motor;
use pigtail_model::transmission::Transmission;
use rand::RngExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The parameters of (2.1)-(2.13) for one joint, without the gear ratio of the datasheet.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JointPlant {
    /// `J_m`, kg m^2.
    #[serde(with = "quantity::PositiveInertia")]
    pub motor_inertia: f64,
    /// `J_l`, kg m^2.
    #[serde(with = "quantity::PositiveInertia")]
    pub load_inertia: f64,
    /// The law of load friction.
    #[serde(default)]
    pub friction: LoadLaw,
    /// Velocity above which `lugre` friction falls from its static to its Coulomb level, `v_s`, rad/s.
    #[serde(default = "stribeck", with = "quantity::PositiveRotation")]
    pub stribeck: f64,
    /// `q_p` under `coulomb-presliding`, `q_0` under `maxwell-slip` and `lugre`, radians.
    #[serde(with = "quantity::NonNegativeAngle")]
    pub presliding: f64,
    /// Constant torque on the load by a preloading spring (thesis 2.4.2), N m.
    #[serde(with = "quantity::Torque")]
    pub preload: f64,
    /// The motor.
    pub motor: MotorPlant,
    /// The transmission.
    pub transmission: TransmissionPlant,
    /// That on the motor.
    pub motor_friction: FrictionPlant,
    /// That on the load.
    pub load_friction: FrictionPlant,
    /// How a joint departs from its friction as given.
    #[serde(default)]
    pub unrest: UnrestPlant,
}

/// A law of load friction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LoadLaw {
    /// The thesis's: a rigid hold up to the static level, presliding in front of it.
    #[default]
    CoulombPresliding,
    /// Maxwell-slip elements that rise to the Coulomb level along an exponential.
    MaxwellSlip,
    /// A bristle that rises to the static level along an exponential; the level falls with speed.
    #[serde(rename = "lugre")]
    LuGre,
}

fn stribeck() -> f64 {
    0.01
}

/// The motor of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotorPlant {
    /// `k_m`, N m/A.
    #[serde(with = "quantity::PositiveTorqueConstant")]
    pub torque_constant: f64,
    /// `k_b`, V s/rad.
    #[serde(with = "quantity::PositiveBackEmf")]
    pub back_emf: f64,
    /// `R`, ohm.
    #[serde(with = "quantity::PositiveResistance")]
    pub resistance: f64,
    /// Most that its amplifier gives, amperes; without it, as much as the voltage drives.
    #[serde(default = "endless", with = "quantity::PositiveCurrent")]
    pub current: f64,
}

/// The transmission of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransmissionPlant {
    /// `k_s`, N m/rad.
    #[serde(with = "quantity::PositiveStiffness")]
    pub linear: f64,
    /// `k_h`, N m/rad^3.
    #[serde(with = "quantity::NonNegativeHardening")]
    pub cubic: f64,
    /// How far its stiffness rises as it hardens, relative to `k_s`; without it (2.6), without end.
    #[serde(default = "endless", with = "quantity::OneOrMore")]
    pub bound: f64,
}

fn endless() -> f64 {
    f64::INFINITY
}

impl TransmissionPlant {
    /// The spring, so many times as stiff.
    fn spring(&self, factor: f64) -> Result<Transmission, Invalid> {
        let spring = Transmission::new(factor * self.linear, factor * self.cubic)?;
        if self.bound.is_finite() {
            spring.bounded(self.bound)
        } else {
            Ok(spring)
        }
    }
}

/// Friction on one body.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(try_from = "FrictionKeys")]
#[schemars(with = "FrictionKeys")]
pub struct FrictionPlant(Friction);

#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FrictionKeys {
    /// Torque up to which it holds what is at rest, N m; at least the Coulomb level.
    #[serde(rename = "static", with = "quantity::NonNegativeTorque")]
    fixed: f64,
    /// Torque against what moves, N m.
    #[serde(with = "quantity::NonNegativeTorque")]
    coulomb: f64,
    /// Torque for each rad/s, N m s/rad.
    #[serde(with = "quantity::NonNegativeDamping")]
    viscous: f64,
}

impl TryFrom<FrictionKeys> for FrictionPlant {
    type Error = String;

    fn try_from(keys: FrictionKeys) -> Result<Self, String> {
        Friction::new(keys.fixed, keys.coulomb, keys.viscous)
            .map(Self)
            .map_err(|_| {
                format!(
                    "static friction {} N m is below Coulomb friction {} N m; accepted is a static \
                 friction of at least the Coulomb friction",
                    keys.fixed, keys.coulomb
                )
            })
    }
}

impl FrictionPlant {
    /// The same friction, `by` times as high.
    ///
    /// # Errors
    ///
    /// When `by` is negative or not finite.
    pub fn times(self, by: f64) -> Result<Self, Invalid> {
        self.scaled(by).map(Self)
    }

    /// Static level, N m.
    pub fn static_level(self) -> f64 {
        self.0.static_level()
    }

    /// Coulomb level, N m.
    pub fn coulomb(self) -> f64 {
        self.0.coulomb()
    }

    /// Torque for each rad/s, N m s/rad.
    pub fn viscous(self) -> f64 {
        self.0.viscous()
    }

    fn scaled(self, by: f64) -> Result<Friction, Invalid> {
        self.0.scaled(by)
    }
}

/// How far the load of a joint that is drawn gives way in front of its friction (2.12), at most, of what that friction winds its
/// transmission up: with more of it the output would go ahead of its motor, as no machine's does. A fleet that draws little friction and much
/// that gives way comes to it.
const MOST_PRESLIDING: f64 = 0.9;

impl JointPlant {
    /// The joint as it is written, behind a gear of `ratio` output turns a motor turn.
    ///
    /// # Errors
    ///
    /// When a parameter is out of range.
    pub fn nominal(&self, ratio: f64) -> Result<JointParameters, Invalid> {
        let motor = &self.motor;
        Ok(JointParameters {
            motor_inertia: self.motor_inertia,
            load_inertia: self.load_inertia,
            ratio,
            motor: Motor::new(motor.torque_constant, motor.back_emf, motor.resistance)?,
            transmission: self.transmission.spring(1.0)?,
            motor_friction: self.motor_friction.0,
            load_friction: self.load_friction.0,
            presliding: self.presliding,
            load_torque: self.preload,
        })
    }

    /// A specimen of this joint behind a gear of `ratio` output turns a motor turn.
    pub(crate) fn draw(
        &self,
        ratio: f64,
        variation: &Variation,
        rng: &mut impl RngExt,
    ) -> Result<JointParameters, Invalid> {
        let mut vary = |value: f64, width: f64| value * variation.factor(rng, width);
        let stiffness = vary(1.0, variation.stiffness);
        let mut joint = JointParameters {
            motor_inertia: vary(self.motor_inertia, variation.inertia),
            load_inertia: vary(self.load_inertia, variation.inertia),
            ratio,
            motor: Motor::new(
                vary(self.motor.torque_constant, variation.motor),
                vary(self.motor.back_emf, variation.motor),
                vary(self.motor.resistance, variation.motor),
            )?,
            transmission: self.transmission.spring(stiffness)?,
            motor_friction: self.motor_friction.scaled(vary(1.0, variation.friction))?,
            load_friction: self.load_friction.scaled(vary(1.0, variation.friction))?,
            presliding: vary(self.presliding, variation.stiffness),
            load_torque: self.preload,
        };
        if self.friction == LoadLaw::CoulombPresliding {
            let written = self.transmission.spring(1.0)?;
            let winds =
                |spring: &Transmission, friction: Friction| spring.twist(friction.static_level());
            // One that is written with more is meant so.
            let most =
                (self.presliding / winds(&written, self.load_friction.0)).max(MOST_PRESLIDING);
            let far = most * winds(&joint.transmission, joint.load_friction);
            joint.presliding = joint.presliding.min(far);
        }
        Ok(joint)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    /// The shipped five-bar's, which gives way by so many radians.
    fn joint(presliding: f64) -> JointPlant {
        toml::from_str(&format!(
            r#"
            motor_inertia = "2.15e-6 kg m2"
            load_inertia = "8.72e-5 kg m2"
            friction = "coulomb-presliding"
            presliding = "{presliding:e} rad"
            preload = "0 N m"
            motor = {{ torque_constant = "0.0185 N m/A", back_emf = "0.0185 V s/rad", resistance = "7.88 ohm" }}
            transmission = {{ linear = "53.3 N m/rad", cubic = "8.94e6 N m/rad3" }}
            motor_friction = {{ static = "3.27e-3 N m", coulomb = "3.15e-3 N m", viscous = "3.46e-6 N m s/rad" }}
            load_friction = {{ static = "0.12 N m", coulomb = "0.119 N m", viscous = "0.211 N m s/rad" }}
            "#
        ))
        .unwrap()
    }

    /// How far loads give way, of what their friction winds their transmissions up, of 2,000 specimens whose friction is spread by e^0.6.
    fn shares(joint: &JointPlant) -> Vec<f64> {
        let variation: Variation = toml::from_str(
            r#"
            spread = "normal"
            inertia = 0.15
            friction = 0.6
            stiffness = 0.3
            motor = 0.15
            micro_gain = 0.0
            hysteresis = 0.0
            creep = 0.0
            links = 0.0
            loss = 0.0
            "#,
        )
        .unwrap();
        let mut rng = Pcg64Mcg::seed_from_u64(7);
        let drawn = (0..2000).map(|_| joint.draw(1.0 / 80.0, &variation, &mut rng).unwrap());
        drawn
            .map(|p| p.presliding / p.transmission.twist(p.load_friction.static_level()))
            .collect()
    }

    #[test]
    fn no_output_that_is_drawn_goes_ahead_of_its_motor() {
        let shares = shares(&joint(4.712_388_98e-4));
        let most = shares.iter().fold(0.0, |most: f64, share| most.max(*share));
        assert!(most < MOST_PRESLIDING + 1e-12, "{most}");
        // Few come so far, or the fleet would be another.
        let there = shares.iter().filter(|share| **share > 0.89).count();
        assert!((20..300).contains(&there), "{there}");
    }

    #[test]
    fn one_that_is_written_so_is_meant_so() {
        let most = shares(&joint(4e-3)).into_iter().fold(0.0, f64::max);
        assert!(most > 2.0, "{most}");
    }
}
