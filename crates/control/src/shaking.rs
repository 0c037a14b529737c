//! How far a tip that is held still is from where it is held, at any moment: noise of its piezos, vibration of
//! the table. It cannot be averaged away: a fiber is attached at one moment. Light tells of it: on a circle
//! around the peak it scatters by more than a photodiode does in the dark.

use crate::outcome::Outcome;
use crate::procedure::UNSURE;
use std::f64::consts::FRAC_1_SQRT_2;

/// What is known of a tip before it is seen: a standard deviation of so many metres, and that of its logarithm.
/// 95 % of the tips of amplifiers and tables such as workshops have lie between 2 and 32 nm.
const USUAL: (f64, f64) = (8e-9, 0.7);

/// What is usual from turn to turn: so many metres, worth so many degrees of freedom.
const USUAL_SLOW: (f64, f64) = (8e-9, 10.0);

/// How many standard deviations of the logarithm on either side, and steps for each, are looked at.
const REACH: f64 = 4.0;
const STEPS: i32 = 8;

/// Turns on a circle: how often, and by how much, the tip's place has scattered with the photodiode's noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Turns {
    /// Degrees of freedom.
    degrees: f64,
    /// Sum of squares, square metres.
    squares: f64,
    /// What the photodiode's noise alone makes of it, square metres.
    still: f64,
}

impl Turns {
    fn add(&mut self, seen: &Seen) {
        self.degrees += seen.degrees;
        self.squares += seen.degrees * seen.variance;
        self.still += seen.degrees * seen.still;
    }

    /// Variance of the tip alone, square metres; it may come out a little below zero.
    fn beyond(&self) -> f64 {
        (self.squares - self.still) / self.degrees
    }

    /// Logarithm of how likely they are for a tip of a variance.
    fn likelihood(&self, variance: f64) -> f64 {
        if self.degrees == 0.0 {
            return 0.0;
        }
        let expected = variance + self.still / self.degrees;
        -0.5 * (self.degrees * expected.ln() + self.squares / expected)
    }
}

/// What one turn says: the variance along an axis with the photodiode's noise, what that alone would make of it (both
/// square metres), and the degrees of freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// With the photodiode's noise.
    pub variance: f64,
    /// Of that noise alone.
    pub still: f64,
    /// Degrees of freedom.
    pub degrees: f64,
}

/// Variance of a tip's place along an axis, as it has been seen so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shaking {
    /// Of what is faster than a turn, on the circle that finds the peak.
    wide: Turns,
    /// The same on the small circle from which the tip comes to rest.
    small: Turns,
    /// Of what is slower: variance from turn to turn beyond what the photodiode makes of it, and its degrees of
    /// freedom; of the last turns.
    slow: (f64, f64),
    /// Whether it was looked at on its own, with the circle's middle held.
    watched: bool,
}

impl Shaking {
    /// Nothing yet, but of a tip that is to be watched on its own.
    pub fn watched() -> Self {
        Self {
            watched: true,
            ..Self::default()
        }
    }

    /// Whether the tip was watched on its own: what is seen in passing says no more.
    pub fn is_watched(&self) -> bool {
        self.watched
    }

    /// A turn on the circle that finds the peak.
    pub fn add_wide(&mut self, seen: &Seen) {
        self.wide.add(seen);
    }

    /// A turn on the small circle, after which the tip comes to rest.
    pub fn add_small(&mut self, seen: &Seen) {
        self.small.add(seen);
    }

    /// From turn to turn the peak's variance is so much where a photodiode's noise alone would make it `noise`
    /// (square metres), by so many degrees of freedom. What chance may have made of the noise is none of it: a few
    /// turns say little.
    pub fn set_slow(&mut self, variance: f64, noise: f64, degrees: f64) {
        /// Standard deviations of the noise's own variance.
        const CHANCE: f64 = 3.0;
        let most = noise * (1.0 + CHANCE * (2.0 / degrees).sqrt());
        let more = if variance > most {
            variance - noise
        } else {
            0.0
        };
        self.slow = (more, degrees);
    }

    /// Both, put together with what was seen by another circle.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let sum = |mut a: Turns, b: Turns| {
            a.degrees += b.degrees;
            a.squares += b.squares;
            a.still += b.still;
            a
        };
        if other.watched {
            return other;
        }
        Self {
            wide: sum(self.wide, other.wide),
            small: sum(self.small, other.small),
            slow: if other.slow.1 > 0.0 {
                other.slow
            } else {
                self.slow
            },
            watched: self.watched,
        }
    }

    /// Whether anything has been seen at all.
    pub fn is_known(&self) -> bool {
        self.wide.degrees + self.small.degrees > 0.0
    }

    /// Variance from turn to turn, square metres.
    fn slow(&self) -> f64 {
        let ((variance, degrees), (usual, worth)) = (self.slow, USUAL_SLOW);
        (variance * degrees + usual * usual * worth) / (degrees + worth)
    }

    /// Variances of a tip (square metres) and how probable each is, after what was seen.
    fn believed(&self) -> Vec<(f64, f64)> {
        /// A circle that shakes so many times as much as the other, by variance, shakes by other causes: its own
        /// resonance, which has died away on the small one.
        const RINGS: f64 = 6.0;
        /// A tip that shakes less than this is still, metres.
        const LEAST: f64 = 5e-9;
        let (wide, small) = (self.wide, self.small);
        let rings = small.degrees > 0.0
            && wide.degrees > 0.0
            && wide.beyond() > RINGS * small.beyond().max(LEAST * LEAST);
        let (usual, spread) = USUAL;
        let steps = (REACH * f64::from(STEPS)) as i32;
        let each = (-steps..=steps).map(|step| {
            let z = f64::from(step) / f64::from(STEPS);
            let deviation = usual * (spread * z).exp();
            let variance = deviation * deviation;
            let turns = small.likelihood(variance)
                + if rings {
                    0.0
                } else {
                    wide.likelihood(variance)
                };
            (variance, turns - 0.5 * z * z)
        });
        let each: Vec<_> = each.collect();
        let most = each
            .iter()
            .map(|(_, l)| *l)
            .fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = each.iter().map(|(_, l)| (l - most).exp()).sum();
        let probable = each.into_iter().map(|(v, l)| (v, (l - most).exp() / sum));
        probable.collect()
    }

    /// Standard deviation of the tip along an axis, metres.
    pub fn deviation(&self) -> f64 {
        let fast: f64 = self.believed().iter().map(|(v, share)| v * share).sum();
        (fast + self.slow()).sqrt()
    }

    /// Probability that a tip whose place is known to `deviation` (metres) is farther than `tolerance` from the peak
    /// at the moment at which it is attached, in x or in y.
    pub fn outside(&self, tolerance: f64, deviation: f64) -> f64 {
        let always = deviation * deviation + self.slow();
        let tail = |variance: f64| {
            let far = tolerance / (always + variance).sqrt();
            2.0 * libm::erfc(far * FRAC_1_SQRT_2)
        };
        let all: f64 = self
            .believed()
            .iter()
            .map(|(v, share)| share * tail(*v))
            .sum();
        all.min(1.0)
    }

    /// That such a tip is all but certainly within `tolerance`.
    ///
    /// # Errors
    ///
    /// [`Outcome::UnsurePlace`].
    pub fn is_sure(&self, tolerance: f64, deviation: f64) -> Result<(), Outcome> {
        let probability = self.outside(tolerance, deviation);
        if probability <= UNSURE {
            return Ok(());
        }
        Err(Outcome::UnsurePlace {
            deviation,
            shaking: self.deviation(),
            tolerance,
            probability,
            accepted: UNSURE,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seven degrees of freedom of a tip, seen by a photodiode that makes 8 nm of its noise.
    fn seen(deviation: f64) -> Seen {
        let still = 64e-18;
        Seen {
            variance: still + deviation * deviation,
            still,
            degrees: 7.0,
        }
    }

    #[test]
    fn a_tip_that_shakes_is_not_sure_however_well_its_peak_is_known() {
        let mut still = Shaking::default();
        assert!(!still.is_known());
        still.add_small(&seen(2e-9));
        still.add_wide(&seen(2e-9));
        assert!(still.outside(0.1e-6, 15e-9) < 1e-4);
        let mut shakes = Shaking::default();
        for _ in 0..10 {
            shakes.add_wide(&seen(30e-9));
        }
        assert!(
            (shakes.deviation() - 31e-9).abs() < 2e-9,
            "{}",
            shakes.deviation()
        );
        assert!(shakes.outside(0.1e-6, 1e-9) > 1e-3);
        // One that happened to look quieter than it is.
        let mut chance = Shaking::default();
        chance.add_small(&seen(17e-9));
        assert!(chance.outside(0.1e-6, 5e-9) > 1e-4);
        // One that rang on the wide circle, and no longer does.
        let mut rang = still;
        for _ in 0..4 {
            rang.add_wide(&seen(100e-9));
        }
        assert!(rang.outside(0.1e-6, 15e-9) < 1e-3);
        // One that was seen to wander from turn to turn.
        still.set_slow(16e-16, 1e-16, 10.0);
        assert!(still.outside(0.1e-6, 15e-9) > 1e-4);
    }

    #[test]
    fn what_is_said_of_tips_is_as_often_so() {
        // Tips of the usual kind, each seen by 21 degrees of freedom: what is called outside with a probability
        // adds up to those that are.
        let mut state = 5_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut normal = move || (0..12).fold(-6.0, |sum, _| sum + uniform());
        let (tolerance, still, trials) = (25e-9, 8e-9, 4000);
        let (mut said, mut are) = (0.0, 0.0);
        for _ in 0..trials {
            let deviation: f64 = USUAL.0 * (USUAL.1 * normal()).exp();
            let mut shaking = Shaking::default();
            let spread = deviation.hypot(still);
            let squares: f64 = (0..21).map(|_| (spread * normal()).powi(2)).sum();
            shaking.add_small(&Seen {
                variance: squares / 21.0,
                still: still * still,
                degrees: 21.0,
            });
            said += shaking.outside(tolerance, 0.0);
            // Of what wanders from turn to turn there is as much as is usual.
            let whole = deviation.hypot(USUAL_SLOW.0);
            for _ in 0..2 {
                are += f64::from(u8::from((whole * normal()).abs() > tolerance));
            }
        }
        assert!((said / are - 1.0).abs() < 0.1, "{said} {are}");
    }
}
