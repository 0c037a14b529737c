//! By how much light differs from one turn of a circle to the next, of its own: a laser wanders.

use crate::beam::Peak;

/// What turns that follow each other have told of it so far, whatever they went around: all of them have the same laser.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Flicker {
    /// Sum of squares of shares of the light.
    squares: f64,
    /// Of so many pairs of turns.
    pairs: f64,
}

impl Flicker {
    /// Takes in two peaks of turns that follow each other. What noise makes of them is none of it.
    pub fn add(&mut self, before: &Peak, after: &Peak) {
        let noise = before.full_deviation.hypot(after.full_deviation);
        let apart = (after.full - before.full).powi(2) - noise * noise;
        self.squares += 0.5 * apart / (after.full * before.full);
        self.pairs += 1.0;
    }

    /// Standard deviation of a turn's light, as a share of it; none before two turns were seen.
    pub fn deviation(&self) -> f64 {
        (self.squares / self.pairs.max(1.0)).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_model::frames::Displacement;

    #[test]
    fn what_turns_differ_by_beside_noise_is_the_lasers() {
        let peak = |full: f64| Peak {
            at: Displacement::ZERO,
            full,
            full_deviation: 10e-3,
            deviations: [0.0; 2],
        };
        let mut flicker = Flicker::default();
        assert_eq!(flicker.deviation(), 0.0);
        // As far apart as noise makes them.
        let far = 2.0_f64.sqrt() * 10e-3;
        flicker.add(&peak(2.0), &peak(2.0 + far));
        assert!(flicker.deviation() < 1e-9);
        for _ in 0..1000 {
            flicker.add(&peak(2.0), &peak(2.0 + far.hypot(2.0_f64.sqrt() * 20e-3)));
        }
        assert!((flicker.deviation() / 0.01 - 1.0).abs() < 0.01);
    }
}
