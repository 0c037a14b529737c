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
        let rank = rank(share, self.0.len() as u64) as usize;
        self.0.get(rank - 1).copied()
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

impl Percentiles {
    /// Of values that are too many to be held: `read` hands each of them, in any order, to what it is given, and is
    /// called four times. Exactly what [`Sorted::percentiles`] gives, in a few megabytes however many there are: each
    /// reading finds two more bytes of the values that are asked for, in the order of [`f64::total_cmp`].
    ///
    /// # Errors
    ///
    /// Those of `read`.
    ///
    /// ```
    /// # use pigtail_numerics::statistics::{Percentiles, Sorted};
    /// let values = [3.0, -1.0, f64::NAN, 2.0];
    /// let of = Percentiles::of(|each| -> Result<(), ()> { values.iter().for_each(|v| each(*v)); Ok(()) })?;
    /// assert_eq!(of, Sorted::new(values.to_vec()).percentiles());
    /// # Ok::<(), ()>(())
    /// ```
    pub fn of<E>(mut read: impl FnMut(&mut dyn FnMut(f64)) -> Result<(), E>) -> Result<Self, E> {
        let mut ranks: Vec<Rank> = Vec::new();
        let mut mean = None;
        for shift in [48, 32, 16, 0] {
            let mut prefixes: Vec<u64> = ranks.iter().map(|rank| rank.prefix).collect();
            prefixes.dedup();
            if shift == 48 {
                prefixes.push(0);
            }
            let mut counts = vec![vec![0_u64; 1 << 16]; prefixes.len()];
            let mut sum = Sum::default();
            let mut count = 0_u64;
            read(&mut |value| {
                if value.is_nan() {
                    return;
                }
                let key = key(value);
                let above = key.checked_shr(shift + 16).unwrap_or(0);
                if let Some(of) = prefixes.iter().position(|prefix| *prefix == above) {
                    counts[of][(key >> shift) as usize & 0xffff] += 1;
                }
                sum.add(value);
                count += 1;
            })?;
            if shift == 48 {
                if count == 0 {
                    return Ok(Self::default());
                }
                mean = Some(rounded(sum.value() / count as f64, 1e-6));
                ranks = [0.5, 0.9, 0.99, 0.999, 1.0]
                    .map(|share| Rank {
                        prefix: 0,
                        left: rank(share, count) - 1,
                    })
                    .to_vec();
            }
            for rank in &mut ranks {
                let of = prefixes.iter().position(|prefix| *prefix == rank.prefix);
                let bins = of.map_or(&[][..], |of| &counts[of]);
                // The bin in which it lies, and how many there are below it.
                for (bin, count) in bins.iter().enumerate() {
                    if rank.left < *count {
                        rank.prefix = rank.prefix << 16 | bin as u64;
                        break;
                    }
                    rank.left -= count;
                }
            }
        }
        let value = |index: usize| Some(of_key(ranks[index].prefix));
        Ok(Self {
            mean,
            p50: value(0),
            p90: value(1),
            p99: value(2),
            p999: value(3),
            max: value(4),
        })
    }
}

/// A value that is being looked for: what is known of its key, from the highest bits on, and how many of those that
/// begin like that come before it.
#[derive(Debug, Clone, Copy)]
struct Rank {
    prefix: u64,
    left: u64,
}

/// A number as one whose order is that of [`f64::total_cmp`].
fn key(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits >> 63 == 1 {
        !bits
    } else {
        bits | 1 << 63
    }
}

fn of_key(key: u64) -> f64 {
    f64::from_bits(if key >> 63 == 1 {
        key & !(1 << 63)
    } else {
        !key
    })
}

/// A sum that loses nothing to the order of its terms (Neumaier, 1974).
#[derive(Debug, Clone, Copy, Default)]
pub struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    /// Adds a term.
    pub fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        self.lost += if self.sum.abs() >= term.abs() {
            (self.sum - sum) + term
        } else {
            (term - sum) + self.sum
        };
        self.sum = sum;
    }

    /// What it comes to.
    pub fn value(self) -> f64 {
        self.sum + self.lost
    }
}

/// The rank, from one, of a percentile among so many values.
fn rank(share: f64, count: u64) -> u64 {
    // A share such as 0.999 is a little off in binary: 999 of 1000 must not become 1000.
    let rank = (share * count as f64 - 1e-9).ceil() as u64;
    rank.clamp(1, count.max(1))
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

/// The exact interval of a probability, from `hits` in `trials` independent trials, with a confidence of [`CONFIDENCE`]
/// (C. J. Clopper and E. S. Pearson, 1934): wherever the probability lies in truth, the interval holds it at least so often. Without a
/// hit it ends at `1 - 0.025^(1/n)`. Without a trial nothing is known: 0 to 1.
///
/// ```
/// # use pigtail_numerics::statistics::exact;
/// let [_, most] = exact(0, 200);
/// assert!((most - (1.0 - 0.025_f64.powf(1.0 / 200.0))).abs() < 1e-9);
/// ```
pub fn exact(hits: u64, trials: u64) -> [f64; 2] {
    /// Halvings: to the last bit.
    const HALVINGS: u32 = 60;
    let tail = 0.5 * (1.0 - CONFIDENCE);
    // Where the probability of so many hits or fewer falls to a share.
    let falls_to = |hits: u64, share: f64| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let p = 0.5 * (low + high);
            if at_most(hits, trials, p) > share {
                low = p;
            } else {
                high = p;
            }
        }
        0.5 * (low + high)
    };
    let low = match hits {
        0 => 0.0,
        _ => falls_to(hits - 1, 1.0 - tail),
    };
    let high = if hits >= trials {
        1.0
    } else {
        falls_to(hits, tail)
    };
    [low, high]
}

/// Probability of so many hits or fewer in independent trials that hit with probability `p`, between 0 and 1.
fn at_most(hits: u64, trials: u64, p: f64) -> f64 {
    let n = trials as f64;
    let (log_p, log_q) = (p.ln(), (-p).ln_1p());
    let mut log_term = n * log_q;
    let mut sum = log_term.exp();
    for k in 0..hits.min(trials) {
        let k = k as f64;
        log_term += ((n - k) / (k + 1.0)).ln() + log_p - log_q;
        sum += log_term.exp();
    }
    sum.min(1.0)
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
    /// Beyond so many deviations less than 1e-18 is left, which is none.
    const FAR: f64 = 9.0;
    let (bound, sigma) = (bound.max(NONE * tolerance), sigma.max(NONE * tolerance));
    if tolerance - off.abs() - bound > FAR * sigma {
        return 0.0;
    }
    let tail = |a: f64| 0.5 * libm::erfc(a * FRAC_1_SQRT_2);
    let density = |a: f64| (-0.5 * a * a).exp() / TAU.sqrt();
    // The tail's integral from `a` on.
    let beyond = |a: f64| density(a) - a * tail(a);
    let side = |off: f64| {
        let [near, far] = [-bound, bound].map(|by| beyond((tolerance - off + by) / sigma));
        0.5 * sigma / bound * (near - far)
    };
    let one = side(off);
    // About the middle both are the same.
    let other = if off == 0.0 { one } else { side(-off) };
    (one + other).clamp(0.0, 1.0)
}

/// How likely a value is, a density: it lies anywhere within a `bound` of nought, as likely here as there, but for a normal
/// error of deviation `sigma`. All in one unit; `bound` and `sigma` are zero or more, and not both zero.
///
/// ```
/// # use pigtail_numerics::statistics::within;
/// assert!((within(0.5, 1.0, 1e-3) - 0.5).abs() < 1e-9);
/// assert!((within(1.0, 0.0, 1.0) - 0.24197).abs() < 1e-5);
/// ```
pub fn within(value: f64, bound: f64, sigma: f64) -> f64 {
    /// A bound of less than this share of the deviation, and a deviation of less than this share of the bound, change nothing.
    const NONE: f64 = 1e-6;
    let (bound, sigma) = (bound.max(NONE * sigma), sigma.max(NONE * bound));
    let tail = |a: f64| 0.5 * libm::erfc(a * FRAC_1_SQRT_2);
    let [near, far] = [-bound, bound].map(|by| tail((value.abs() + by) / sigma));
    0.5 * (near - far) / bound
}

/// The mean of values that are each known to a standard deviation, weighted by how well, and how well it is known itself: where they
/// differ by more than they say, that is believed.
pub fn pooled(told: impl Iterator<Item = (f64, f64)> + Clone) -> (f64, f64) {
    let weight = |deviation: f64| deviation.powi(-2);
    let sums = |(n, whole, sum), (value, deviation)| {
        let weight = weight(deviation);
        (n + 1.0, whole + weight, sum + weight * value)
    };
    let (n, whole, sum) = told.clone().fold((0.0, 0.0, 0.0), sums);
    let mean = sum / whole;
    let apart = |(value, deviation): (f64, f64)| weight(deviation) * (value - mean).powi(2);
    let apart = told.map(apart).sum::<f64>() / f64::max(n - 1.0, 1.0);
    (mean, (apart.max(1.0) / whole).sqrt())
}

/// Whether two sets of values may have one distribution (Kolmogorov, Smirnov): the greatest distance of their cumulative
/// shares, 0 to 1, and the probability that chance alone makes it as great, by the asymptotic law with Stephens's
/// correction for few values. The values of a set are taken as independent; `None` where a set has none.
///
/// ```
/// # use pigtail_numerics::statistics::{Sorted, kolmogorov_smirnov};
/// let a = Sorted::new((0..100).map(f64::from).collect());
/// let b = Sorted::new((0..100).map(|k| f64::from(k) + 30.0).collect());
/// let (distance, chance) = kolmogorov_smirnov(&a, &b).unwrap();
/// assert!((distance - 0.3).abs() < 1e-9 && chance < 1e-3);
/// ```
pub fn kolmogorov_smirnov(a: &Sorted, b: &Sorted) -> Option<(f64, f64)> {
    let (a, b) = (a.values(), b.values());
    if a.is_empty() || b.is_empty() {
        return None;
    }
    let (n, m) = (a.len() as f64, b.len() as f64);
    let (mut i, mut j, mut distance) = (0, 0, 0.0_f64);
    while i < a.len() && j < b.len() {
        // Equal values are passed in both before the shares are compared.
        let at = a[i].min(b[j]);
        while i < a.len() && a[i] <= at {
            i += 1;
        }
        while j < b.len() && b[j] <= at {
            j += 1;
        }
        distance = distance.max((i as f64 / n - j as f64 / m).abs());
    }
    let root = (n * m / (n + m)).sqrt();
    let lambda = (root + 0.12 + 0.11 / root) * distance;
    // The series alternates; near zero it converges slowly, and its sum is one.
    let chance = if lambda < 0.2 {
        1.0
    } else {
        let term = |k: i32| {
            let sign = if k % 2 == 1 { 2.0 } else { -2.0 };
            sign * (-2.0 * f64::from(k * k) * lambda * lambda).exp()
        };
        (1..=50).map(term).sum::<f64>().clamp(0.0, 1.0)
    };
    Some((distance, chance))
}

/// The standard deviation of a normal distribution about zero that holds as much as 19 of 20 draws lie within of some distributions together,
/// each of a weight, a mean and a deviation.
///
/// Where one of several is likely and narrow, and another is unlikely and broad, their common variance is that of the broad one, though most
/// draws lie within the narrow one.
pub fn spread_of_mixture(parts: &[(f64, f64, f64)]) -> f64 {
    /// Deviations of a normal distribution within which 19 of 20 draws lie, and how often an interval is halved.
    const WITHIN: f64 = 1.959_964;
    const HALVED: usize = 60;
    let all: f64 = parts.iter().map(|(weight, ..)| weight).sum();
    let below = |z: f64| 0.5 * libm::erfc(-z * FRAC_1_SQRT_2);
    let beyond = |half: f64| {
        let each = parts.iter().map(|(weight, mean, std)| {
            let std = std.max(f64::MIN_POSITIVE);
            weight * (below((-half - mean) / std) + below((mean - half) / std))
        });
        each.sum::<f64>() / all
    };
    let mut low = 0.0;
    let mut high = parts
        .iter()
        .map(|(_, mean, std)| mean.abs() + 4.0 * std)
        .fold(0.0, f64::max);
    if !high.is_finite() {
        return f64::INFINITY;
    }
    for _ in 0..HALVED {
        let half = 0.5 * (low + high);
        if beyond(half) > 0.05 {
            low = half;
        } else {
            high = half;
        }
    }
    high / WITHIN
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

    #[test]
    fn percentiles_are_the_same_where_values_are_not_held() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(7);
        for count in [0, 1, 2, 3, 10, 999, 1000, 1001, 20_000] {
            let mut values: Vec<f64> = (0..count)
                .map(|k| match k % 5 {
                    0 => -rng.random::<f64>(),
                    1 => 1e-300 * rng.random::<f64>(),
                    2 => 0.25,
                    3 => 1e6 * rng.random::<f64>(),
                    _ => -0.0,
                })
                .collect();
            values.push(f64::NAN);
            let read = |each: &mut dyn FnMut(f64)| -> Result<(), ()> {
                for value in &values {
                    each(*value);
                }
                Ok(())
            };
            let told = Percentiles::of(read).expect("nothing fails");
            let held = Sorted::new(values.clone()).percentiles();
            assert_eq!(told, held, "{count}");
            // Zeros have a sign, and an order.
            assert_eq!(told.p50.map(f64::to_bits), held.p50.map(f64::to_bits));
        }
        assert_eq!(Percentiles::of(|_| Err("lost")), Err("lost"));
    }

    #[test]
    fn a_sum_loses_nothing() {
        let mut sum = Sum::default();
        for term in [1.0, 1e100, 1.0, -1e100] {
            sum.add(term);
        }
        assert_eq!(sum.value(), 2.0);
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

    /// Against values from tables of the method, to four digits.
    #[test]
    fn the_exact_interval_is_the_known_one() {
        for (hits, trials, [low, high]) in [
            (0, 10, [0.0, 0.308_5]),
            (1, 10, [0.002_5, 0.445_0]),
            (5, 10, [0.187_1, 0.812_9]),
            (10, 10, [0.691_5, 1.0]),
            (2, 800, [0.000_303, 0.009_002]),
            (0, 0, [0.0, 1.0]),
        ] {
            let [l, h] = exact(hits, trials);
            assert!(
                (l - low).abs() < 1e-4 && (h - high).abs() < 1e-4,
                "{hits}/{trials}: {l} {h}"
            );
        }
    }

    #[test]
    fn equal_distributions_are_told_apart_by_chance_as_often_as_said() {
        // Pairs of 60 values of one distribution: a chance below 0.1 in about a tenth of them.
        let mut state = 1_u64;
        let mut draw = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64
        };
        let mut below = 0;
        for _ in 0..2000 {
            let [a, b] = [0, 1].map(|_| Sorted::new((0..60).map(|_| draw()).collect()));
            below += u32::from(kolmogorov_smirnov(&a, &b).unwrap().1 < 0.1);
        }
        assert!((120..260).contains(&below), "{below} of 2000");
        let same = Sorted::new(vec![1.0, 1.0, 2.0]);
        assert_eq!(kolmogorov_smirnov(&same, &same), Some((0.0, 1.0)));
        assert_eq!(kolmogorov_smirnov(&same, &Sorted::default()), None);
    }

    #[test]
    fn a_mixture_is_as_broad_as_most_of_it() {
        assert!((spread_of_mixture(&[(2.0, 0.0, 0.3)]) - 0.3).abs() < 1e-6);
        // A hundredth that lies far off is beyond what 19 of 20 are within; a tenth is not.
        let with =
            |weight: f64| spread_of_mixture(&[(1.0 - weight, 0.0, 1.0), (weight, 50.0, 1.0)]);
        assert!((1.0..1.1).contains(&with(0.01)), "{}", with(0.01));
        assert!((24.0..27.0).contains(&with(0.1)), "{}", with(0.1));
    }
}
