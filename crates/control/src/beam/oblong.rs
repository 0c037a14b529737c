//! How much wider a spot of light is one way than the other.

use crate::tuning::TUNING;

/// How oblong a spot is, by the turns around it so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Oblong {
    /// How well the light tells, one over its variance; and the sum of what it told, so weighted.
    pub(super) told: f64,
    pub(super) sum: f64,
}

impl Oblong {
    /// One that is known to a standard deviation.
    pub(super) fn known(share: f64, deviation: f64) -> Self {
        let told = deviation.powi(-2);
        Self {
            told,
            sum: share * told,
        }
    }

    /// By which share the inverse square of the width is more in x, and less in y.
    pub fn share(&self) -> f64 {
        let usual = TUNING.beam.usual;
        // How far the light alone has it beyond what any usual one is, and how well it tells that.
        let alone = self.sum / self.told;
        let beyond = alone.abs() - TUNING.beam.unusual * usual;
        let share = if beyond * self.told.sqrt() > TUNING.beam.unusual {
            alone
        } else {
            self.sum / (self.told + 1.0 / (usual * usual))
        };
        share.clamp(-TUNING.beam.most_oblong, TUNING.beam.most_oblong)
    }
}
