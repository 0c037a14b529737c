//! What is believed of a tip that shakes, and whether that will do.

use super::{Measured, Shaking};
use crate::belief::Across;
use crate::outcome::Outcome;
use crate::tuning::TUNING;

/// Deviations that are less probable than this are all but impossible: all of them together are far below what is
/// called unsure.
const IMPOSSIBLE: f64 = 1e-12;

/// What is believed of a tip: worked out once for all that is asked of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Believed {
    pub(super) shaking: Shaking,
    /// Variances, square metres, and how probable each is.
    pub(super) probable: Vec<(f64, f64)>,
}

impl Believed {
    /// Standard deviation of the tip along an axis, the worse one, metres.
    pub fn deviation(&self) -> f64 {
        let [x, y] = self.shaking.slow();
        (self.fast() + x.max(y)).sqrt()
    }

    /// Variance of what is faster than a turn, square metres.
    fn fast(&self) -> f64 {
        self.probable.iter().map(|(v, share)| v * share).sum()
    }

    /// Deviation of what was seen.
    pub(super) fn known(&self) -> Measured {
        let mean_of = |of: &dyn Fn(f64) -> f64| {
            self.probable
                .iter()
                .map(|(v, share)| share * of(*v))
                .sum::<f64>()
        };
        let logarithm = mean_of(&|v| 0.5 * v.ln());
        let squares = mean_of(&|v| (0.5 * v.ln() - logarithm).powi(2));
        Measured {
            deviation: logarithm.exp(),
            spread: squares.sqrt(),
            left: 1.0,
            left_spread: 0.0,
        }
    }

    /// Probability that a tip whose place is `known` so well is farther than `tolerance` from the peak
    /// while its bond sets, on average, in x or in y.
    pub fn outside(&self, tolerance: f64, known: Across) -> f64 {
        let slow = self.shaking.slow();
        let always = [0, 1].map(|i| known.sigma[i].powi(2) + slow[i]);
        let tail = |variance: f64| {
            let sigma = always.map(|always| (always + variance).sqrt());
            Across { sigma, ..known }.outside(tolerance)
        };
        let lefts = self.shaking.lefts();
        let left_of = |v: f64| {
            lefts
                .iter()
                .map(|(left, share)| share * tail(left * v))
                .sum::<f64>()
        };
        // What is all but impossible counts as outside: its tail is not worth working out.
        let part = |(v, share): &(f64, f64)| {
            if *share < IMPOSSIBLE {
                *share
            } else {
                share * left_of(*v)
            }
        };
        let all: f64 = self.probable.iter().map(part).sum();
        all.min(1.0)
    }

    /// Whether a tip whose place is `known` so well may turn out to be within `tolerance` for sure where it is watched, or watched for longer:
    /// as still as it may yet be, it would be. Of one that was not watched nobody knows what is left of means over as long as a bond takes.
    pub fn may_be_sure(&self, tolerance: f64, known: Across) -> bool {
        let shaking = &self.shaking;
        let stillest = if shaking.watched {
            let seen = self.known();
            shaking.left().sqrt() * seen.deviation * (-TUNING.shaking.stiller * seen.spread).exp()
        } else {
            0.0
        };
        let place = known.seen(shaking.wider);
        let sigma = place.sigma.map(|sigma| sigma.hypot(stillest));
        Across { sigma, ..place }.outside(tolerance) <= TUNING.bond.unsure
    }

    /// Whether such a tip would be farther off than a `tolerance` much less probably were it known that stages stand square.
    pub fn is_for_askew(&self, tolerance: f64, known: Across) -> bool {
        let outside = |known: Across| {
            let (all, known) = self.shaking.widened(known);
            self.outside(tolerance / all, known)
        };
        outside(known.on_square_stages()) < TUNING.rise.less * outside(known)
    }

    /// How well it is expected to be known along an axis where a tip, of which the place is `known` so well, is while its bond sets.
    pub fn bonded(&self, known: Across) -> Across {
        let (left, fast) = (self.shaking.left(), self.fast());
        let (all, place) = self.shaking.widened(known);
        let slow = self.shaking.expected_slow();
        let shakes = slow.map(|slow| (left * fast + slow).max(0.0));
        let sigma = [0, 1].map(|i| (shakes[i] + place.sigma[i].powi(2)).sqrt());
        Across { sigma, ..place }.times(all)
    }

    /// That such a tip is all but certainly within `tolerance`.
    ///
    /// # Errors
    ///
    /// [`Outcome::UnsurePlace`].
    pub fn is_sure(&self, tolerance: f64, known: Across) -> Result<(), Outcome> {
        // Where all deviations are larger by a factor, the tolerance is as much smaller.
        let (all, known) = self.shaking.widened(known);
        let tolerance = tolerance / all;
        known.is_within(
            (tolerance, self.outside(tolerance, known)),
            self.deviation(),
        )
    }
}
