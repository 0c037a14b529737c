//! What can be wrong with a device, its fixture and its light: changes to the truth that a
//! procedure has to live with, or to say that it cannot.

use crate::setup::Setup;
use pigtail_hal::digest::hash;
use pigtail_twin::Plant;

/// A change to the rig's `plant.toml` as it was read; control is told nothing of it.
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
pub enum Scenario {
    /// The plant as it is
    #[default]
    Nominal,
    /// Three times the noise of the photodiodes
    Noise,
    /// Photodiodes whose offset wanders by 20 mV rms within some seconds
    Drift,
    /// A chip turned by 0.5 deg in its fixture
    Turn,
    /// Facets off by 1 deg
    Facet,
    /// A side lobe of 20 % of the light, 6 um above the peak
    SideLobe,
    /// Interference of 0.3 dB in the gap, in turns of half a wavelength
    Ripple,
    /// A device that lets through a tenth of the light
    Weak,
    /// Twice the misplacement of everything that is not seen, and of vision's error across
    Uncertain,
    /// Room light of 100 mV on every photodiode, flickering with the mains
    Stray,
    /// A second output that lets nothing through
    Dead,
}

impl Scenario {
    /// Its name in options and documents.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Changes the truth of a setup.
    pub fn apply(self, setup: &mut Setup) {
        setup.scenario = self;
        if self == Self::Nominal {
            return;
        }
        self.change(&mut setup.plant);
        if self == Self::Uncertain {
            setup.rig.spec.vision.accuracy_x *= 2.0;
        }
        let name = format!("scenario {}", self.name());
        let same = hash(&name);
        setup.rig.hashes.push((name, same));
    }

    /// Changes a truth.
    pub(crate) fn change(self, plant: &mut Plant) {
        match self {
            Self::Nominal => {}
            Self::Noise => plant.light.noise *= 3.0,
            Self::Drift => plant.light.drift = 20e-3,
            Self::Turn => plant.device.turn += 0.5_f64.to_radians(),
            Self::Facet => plant.device.facet += 1_f64.to_radians(),
            Self::SideLobe => {
                plant.device.side_lobe = 0.2;
                plant.device.side_lobe_at = 6e-6;
            }
            Self::Ripple => plant.device.ripple_db = 0.3,
            Self::Weak => plant.device.transmission = plant.device.transmission.map(|t| 0.1 * t),
            Self::Uncertain => {
                let m = &mut plant.misplacement;
                for half in [
                    &mut m.chip_x,
                    &mut m.chip_z,
                    &mut m.fiber_x,
                    &mut m.fiber_z,
                    &mut m.y,
                    &mut m.tilt,
                    &mut m.home,
                ] {
                    *half *= 2.0;
                }
            }
            Self::Stray => plant.light.stray = 0.1,
            Self::Dead => plant.device.transmission[1] = 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
    use strum::VariantArray;

    #[test]
    fn every_scenario_but_the_nominal_changes_the_truth_and_leaves_its_trace() {
        let nominal = Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("a rig");
        for &scenario in Scenario::VARIANTS {
            let mut setup = nominal.clone();
            scenario.apply(&mut setup);
            let same = scenario == Scenario::Nominal;
            assert_eq!(setup.plant == nominal.plant, same, "{}", scenario.name());
            assert_eq!(setup.rig.hashes == nominal.rig.hashes, same);
            assert_eq!(setup.rig.calibration, nominal.rig.calibration);
        }
    }
}
