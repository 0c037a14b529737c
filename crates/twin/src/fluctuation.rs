//! What wanders slowly around its mean: scattered light, a laser's power.

use crate::sensors::normal;
use rand::Rng;

/// A slow relative fluctuation: an Ornstein-Uhlenbeck process around one.
#[derive(Debug, Clone)]
pub(super) struct Fluctuation {
    decay: f64,
    kick: f64,
    deviation: f64,
}

impl Fluctuation {
    pub(super) fn new(rms: f64, bandwidth: f64, period: f64, rng: &mut impl Rng) -> Self {
        let decay = (-std::f64::consts::TAU * bandwidth * period).exp();
        Self {
            decay,
            kick: rms * (1.0 - decay * decay).sqrt(),
            deviation: rms * normal(rng),
        }
    }

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    pub(super) fn next(&mut self, rng: &mut impl Rng) -> f64 {
        self.deviation = self.decay * self.deviation + self.kick * normal(rng);
        (1.0 + self.deviation).max(0.0)
    }
}
