//! What can be said of many from some: percentiles, and how sure a share is.

use crate::rounded;
use serde::Serialize;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// The confidence of every interval here.
pub const CONFIDENCE: f64 = 0.95;
/// The standard normal quantile of the two-sided interval of that confidence.
const QUANTILE: f64 = 1.959_963_984_540_054;

/// Values in order, to ask percentiles of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sorted(Vec<f64>);

impl Sorted {
    /// Sorts the values. Those that are no numbers are left out.
    pub fn new(mut values: Vec<f64>) -> Self {
        values.retain(|value| !value.is_nan());
        values.sort_by(f64::total_cmp);
        Self(values)
    }

    /// The values, least first.
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// The percentile by nearest rank: the least value that at least this share (0 to 1) of all
    /// values does not exceed. Always a value that really came; `None` where none did.
    pub fn percentile(&self, share: f64) -> Option<f64> {
        let count = self.0.len();
        // A share such as 0.999 is a little off in binary: 999 of 1000 must not become 1000.
        let rank = (share * count as f64 - 1e-9).ceil() as usize;
        self.0.get(rank.clamp(1, count.max(1)) - 1).copied()
    }

    /// The mean; `None` without a value.
    pub fn mean(&self) -> Option<f64> {
        let count = self.0.len();
        (count > 0).then(|| rounded(self.0.iter().sum::<f64>() / count as f64, 1e-6))
    }

    /// The percentiles that a campaign tells of everything it measures.
    pub fn percentiles(&self) -> Percentiles {
        Percentiles {
            mean: self.mean(),
            p50: self.percentile(0.5),
            p90: self.percentile(0.9),
            p99: self.percentile(0.99),
            p999: self.percentile(0.999),
            max: self.0.last().copied(),
        }
    }
}

/// The mean, and percentiles by nearest rank; `null` where there is no value.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// The mean.
    pub mean: Option<f64>,
    /// The median.
    pub p50: Option<f64>,
    /// The value that 90 % do not exceed.
    pub p90: Option<f64>,
    /// The value that 99 % do not exceed.
    pub p99: Option<f64>,
    /// The value that 99.9 % do not exceed.
    pub p999: Option<f64>,
    /// The greatest.
    pub max: Option<f64>,
}

/// Wilson's score interval of a probability, from `hits` in `trials` independent trials, with a
/// confidence of [`CONFIDENCE`] (E. B. Wilson, 1927). Unlike the textbook interval it is right at
/// 0 and at 100 %. Without a trial nothing is known: 0 to 1.
pub fn wilson(hits: u64, trials: u64) -> [f64; 2] {
    if trials == 0 {
        return [0.0, 1.0];
    }
    let n = trials as f64;
    let (p, zz) = (hits as f64 / n, QUANTILE * QUANTILE);
    let middle = p + zz / (2.0 * n);
    let half = QUANTILE * (p * (1.0 - p) / n + zz / (4.0 * n * n)).sqrt();
    let scale = 1.0 + zz / n;
    // At the ends the bound is exact, and rounding must not move it.
    let low = if hits == 0 {
        0.0
    } else {
        (middle - half) / scale
    };
    let high = if hits == trials {
        1.0
    } else {
        (middle + half) / scale
    };
    [low, high]
}

/// Probability that something lies farther than `tolerance` from where it is wanted: it is believed to be `off`
/// that, but for an error that is anywhere within a `bound`, as likely here as there, and a normal one of
/// deviation `sigma`. All in one unit; `bound` and `sigma` are zero or more.
///
/// ```
/// # use pigtail_numerics::statistics::outside;
/// assert!((outside(2.0, 0.0, 0.0, 1.0) - 0.0455).abs() < 1e-4);
/// // A bound that dominates is no normal deviate: nothing lies beyond it.
/// assert_eq!(outside(2.0, 0.0, 1.9, 0.0), 0.0);
/// ```
pub fn outside(tolerance: f64, off: f64, bound: f64, sigma: f64) -> f64 {
    /// A deviation or bound of less than this share of the tolerance changes nothing.
    const NONE: f64 = 1e-9;
    let (bound, sigma) = (bound.max(NONE * tolerance), sigma.max(NONE * tolerance));
    let tail = |a: f64| 0.5 * libm::erfc(a * FRAC_1_SQRT_2);
    let density = |a: f64| (-0.5 * a * a).exp() / TAU.sqrt();
    // The tail's integral from `a` on.
    let beyond = |a: f64| density(a) - a * tail(a);
    let side = |off: f64| {
        let [near, far] = [-bound, bound].map(|by| beyond((tolerance - off + by) / sigma));
        0.5 * sigma / bound * (near - far)
    };
    (side(off) + side(-off)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_outside_is_what_draws_say() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        for (off, bound, sigma) in [(0.3, 1.9, 0.2), (0.0, 2.5, 0.1), (1.5, 0.5, 0.5)] {
            const DRAWS: u32 = 100_000;
            let draws = (0..DRAWS).filter(|_| {
                let even = bound * (2.0 * rng.random::<f64>() - 1.0);
                // Twelve even draws are nearly normal.
                let normal: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                let at: f64 = off + even + sigma * normal;
                at.abs() > 2.0
            });
            let share = draws.count() as f64 / f64::from(DRAWS);
            let told = outside(2.0, off, bound, sigma);
            assert!((share - told).abs() < 5e-3, "{share} drawn, {told} told");
        }
    }

    #[test]
    fn percentiles_are_values_that_came() {
        let sorted = Sorted::new((1..=1000).rev().map(f64::from).collect());
        for (share, value) in [
            (0.0, 1.0),
            (0.0005, 1.0),
            (0.5, 500.0),
            (0.5001, 501.0),
            (0.9, 900.0),
            (0.99, 990.0),
            (0.999, 999.0),
            (0.9991, 1000.0),
            (1.0, 1000.0),
        ] {
            assert_eq!(sorted.percentile(share), Some(value), "{share}");
        }
        // The textbook's five numbers.
        let sorted = Sorted::new(vec![50.0, 15.0, 40.0, 20.0, 35.0, f64::NAN]);
        for (share, value) in [
            (0.05, 15.0),
            (0.3, 20.0),
            (0.4, 20.0),
            (0.5, 35.0),
            (1.0, 50.0),
        ] {
            assert_eq!(sorted.percentile(share), Some(value), "{share}");
        }
        assert_eq!(Sorted::new(vec![7.0]).percentile(0.001), Some(7.0));
        assert_eq!(Sorted::default().percentile(0.5), None);
        assert_eq!(Sorted::default().percentiles(), Percentiles::default());
    }

    /// Against values computed elsewhere from the same formula, to six digits.
    #[test]
    fn wilson_s_interval_is_the_known_one() {
        for (hits, trials, [low, high]) in [
            (0, 10, [0.0, 0.277_533]),
            (10, 10, [0.722_467, 1.0]),
            (1, 10, [0.017_876, 0.404_150]),
            (5, 10, [0.236_593, 0.763_407]),
            (81, 263, [0.255_289, 0.366_210]),
            (3000, 3000, [0.998_721, 1.0]),
        ] {
            let [l, h] = wilson(hits, trials);
            assert!(
                (l - low).abs() < 1e-6 && (h - high).abs() < 1e-6,
                "{hits}/{trials}: {l} {h}"
            );
        }
        assert_eq!(wilson(0, 0), [0.0, 1.0]);
    }
}
