//! Light that was off for a part of a scan, or a detector that died in its midst: what is left of a peak has its middle elsewhere.
//!
//! A shape that is fitted to all readings takes what is dark for its flank. One that is fitted to the others alone says how bright
//! it would be where it is dark: where it is bright there, and the readings are told far better so, a part of the peak was not seen.

use super::Refusal;
use super::shape::{Datum, Fit, NUMBERS, Shape, fit, flat_squares};
use super::unsteady::lines;
use pigtail_model::frames::Displacement;
use pigtail_numerics::signal::quantile;
use std::ops::Range;

/// Lines of a scan are dark below the first share of the brightest one's light, and bright above the second.
const DARK: f64 = 0.15;
const BRIGHT: f64 = 0.3;

/// So many of the steepest falls and rises are tried, each way that a scan may be cut in.
const TRIED: usize = 3;

/// Where it is dark it would be brighter than this share of the peak, at so many readings.
const MISSING: f64 = 0.35;
const AT_LEAST: usize = 3;

/// What is left, squared, is less than the first share of what it was, and by so many times the noise's variance; beside an explanation that
/// has a fold, and so one for each reading, it is no more than the second.
const BETTER: f64 = 0.9;
const SIGNIFICANT: f64 = 40.0;
const AS_GOOD: f64 = 1.3;

/// A reading that is so many of the usual deviations off even so is wild: it says nothing of either.
const WILD: f64 = 10.0;

/// More readings than about so many tell nothing new.
const ENOUGH: usize = 3000;

/// Refuses a peak that is told better as a part of another one; by all readings, those that stand apart from it too.
pub(super) fn check(found: &Fit, read: &[(usize, Datum)], folded: bool) -> Result<(), Refusal> {
    let stride = read.len().div_ceil(ENOUGH) | 1;
    let data: Vec<Seen> = read
        .iter()
        .step_by(stride)
        .map(|(_, d)| Seen {
            left: d.residual(&found.shape, found.level).powi(2),
            datum: Datum {
                sign: 1.0,
                share: 0.0,
                at_least: false,
                ..*d
            },
        })
        .collect();
    let at = |of: fn(&Datum) -> f64| lines(data.iter().map(|d| of(&d.datum)));
    for groups in [at(|d| d.at.y), at(|d| d.at.x), (0..data.len()).collect()] {
        for dark in dark_parts(&brightness(&groups, &data)) {
            let (far, near): (Vec<_>, Vec<_>) = groups
                .iter()
                .zip(&data)
                .partition(|(group, _)| dark.contains(*group));
            let [far, near]: [Vec<Seen>; 2] =
                [far, near].map(|part| part.into_iter().map(|p| *p.1).collect());
            let Some(other) = other(found, near, &far) else {
                continue;
            };
            let sure = other.before - other.after > SIGNIFICANT * other.after / data.len() as f64;
            let better = other.after < BETTER * other.before && sure;
            if better || (folded && other.after < AS_GOOD * other.before) {
                return Err(other.unseen);
            }
        }
    }
    Ok(())
}

/// A reading as it was read, and what the peak of all of them leaves of it, squared.
#[derive(Debug, Clone, Copy)]
struct Seen {
    datum: Datum,
    left: f64,
}

/// The mean power of each group, as a share from the darkest to the brightest.
fn brightness(groups: &[usize], data: &[Seen]) -> Vec<f64> {
    let count = groups.iter().max().map_or(0, |last| last + 1);
    let mut sums = vec![(0.0, 0.0); count];
    for (group, d) in groups.iter().zip(data) {
        sums[*group].0 += d.datum.power;
        sums[*group].1 += 1.0;
    }
    let means: Vec<f64> = sums
        .iter()
        .map(|(sum, n)| sum / f64::max(*n, 1.0))
        .collect();
    let low = means.iter().copied().fold(f64::INFINITY, f64::min);
    let high = means.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    means.iter().map(|m| (m - low) / (high - low)).collect()
}

/// Ranges of groups that are dark, each beside one that is bright: from a fall or to a rise.
fn dark_parts(brightness: &[f64]) -> Vec<Range<usize>> {
    let n = brightness.len();
    let steepest = |falls: bool| {
        let of = |k: usize| {
            let (a, b) = (brightness[k - 1], brightness[k]);
            if falls { (a, b) } else { (b, a) }
        };
        let step = |k: &usize| of(*k).0 - of(*k).1;
        let mut steps: Vec<usize> = (1..n)
            .filter(|k| of(*k).0 > BRIGHT && of(*k).1 < DARK)
            .collect();
        steps.sort_by(|a, b| step(b).total_cmp(&step(a)));
        steps.truncate(TRIED);
        steps
    };
    let (falls, rises) = (steepest(true), steepest(false));
    let to_end = falls.iter().map(|fall| *fall..n);
    let from_start = rises.iter().map(|rise| 0..*rise);
    let between = falls
        .iter()
        .flat_map(|fall| rises.iter().map(move |rise| *fall..*rise));
    // One reading in so many may be wild.
    let is_dark = |part: &Range<usize>| {
        let bright = part.clone().filter(|k| brightness[*k] > BRIGHT).count();
        !part.is_empty() && 50 * bright <= part.len()
    };
    to_end
        .chain(from_start)
        .chain(between)
        .filter(is_dark)
        .collect()
}

/// Another explanation: what all readings leave, squared, before and by it, and what it says was not seen.
struct Other {
    before: f64,
    after: f64,
    unseen: Refusal,
}

/// A peak of the bright readings alone beside dark ones; `None` where it would not be bright there.
fn other(found: &Fit, mut near: Vec<Seen>, far: &[Seen]) -> Option<Other> {
    if near.len() < 3 * NUMBERS || far.len() < AT_LEAST {
        return None;
    }
    let own = alone(found, &near)?;
    let off = |d: &Seen| (d.datum.power - own.shape.power(d.datum.at)).abs();
    let usual = 1.4826 * quantile(&near.iter().map(off).collect::<Vec<_>>(), 0.5);
    let all = near.len();
    near.retain(|d| off(d) < WILD * usual + 0.05 * own.shape.height.abs());
    // Many are no accident.
    if 50 * (all - near.len()) > all.max(100) {
        return None;
    }
    let own = if near.len() < all {
        alone(found, &near)?
    } else {
        own
    };
    let missing: Vec<Displacement> = far
        .iter()
        .map(|d| d.datum.at)
        .filter(|at| own.shape.share(*at) > MISSING)
        .collect();
    if own.shape.height <= 0.0 || missing.len() < AT_LEAST {
        return None;
    }
    let sum = missing
        .iter()
        .fold(Displacement::default(), |sum, at| sum + *at);
    let dark: Vec<Datum> = far.iter().map(|d| d.datum).collect();
    Some(Other {
        before: near.iter().chain(far).map(|d| d.left).sum(),
        after: own.squares + flat_squares(&dark),
        unseen: Refusal::Unseen {
            at: sum * (1.0 / missing.len() as f64),
            readings: missing.len(),
        },
    })
}

/// The peak of some readings alone.
fn alone(found: &Fit, near: &[Seen]) -> Option<Fit> {
    let data: Vec<Datum> = near.iter().map(|d| d.datum).collect();
    let by = |a: &&Datum, b: &&Datum| a.power.total_cmp(&b.power);
    let top = data.iter().max_by(by)?;
    [found.shape.at, top.at]
        .into_iter()
        .filter_map(|at| fit(&data, &Shape { at, ..found.shape }, 0.0, false))
        .min_by(|a, b| a.squares.total_cmp(&b.squares))
}
