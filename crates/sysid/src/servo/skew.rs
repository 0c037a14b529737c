//! By how much voltage and position of one row are of different moments.
//!
//! A voltage that is held until the next sample acts half a sample late, which every record shows and no fit needs to
//! know. Channels of two instruments are further apart, and may have clocks that run apart.

use super::{Friction, LATE, LATEST, Method, Moved, Record, SLOW, Settings, VOLTAGE, check};
use crate::{Parameter, Unknown};
use pigtail_numerics::regression::{least_squares_alone, over, tolerance};
use pigtail_numerics::signal::{between, quantile};
use std::borrow::Cow;
use std::fmt::Write as _;

/// A skew of the voltage, samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Skew {
    /// By how much later the voltage acts than its row's position was, at the record's beginning.
    pub(super) at_start: f64,
    /// By how much more at each sample.
    pub(super) drift: f64,
}

/// A delay that a held voltage has by itself, samples, is left.
const OWN: f64 = 1.0;

/// Clocks that come apart by less than this over a record, samples, are one.
const APART: f64 = 0.4;

/// Parts of a record whose skews are compared.
const PARTS: usize = 6;

const ROUNDS: usize = 6;

impl Skew {
    fn is_none(&self) -> bool {
        self.at_start == 0.0 && self.drift == 0.0
    }

    /// Settings that know whether stamps are as they were.
    pub(super) fn settings(&self, set: &Settings) -> Settings {
        Settings {
            as_stamped: self.is_none(),
            ..*set
        }
    }

    /// The record with the voltage moved to the position's moments.
    pub(super) fn taken_out<'r>(&self, record: &'r Record) -> Cow<'r, Record> {
        if self.is_none() {
            return Cow::Borrowed(record);
        }
        let mut record = record.clone();
        let injected = record.injected_column();
        for k in 0..record.even.stretches.len() {
            for column in std::iter::once(VOLTAGE).chain(injected) {
                let moved = self.moved(&record, k, column).into_owned();
                record.even.stretches[k].columns[column] = moved;
            }
        }
        Cow::Owned(record)
    }

    /// A column of a record's stretch, moved to the position's moments.
    fn moved<'r>(&self, record: &'r Record, stretch: usize, column: usize) -> Cow<'r, [f64]> {
        let stretches = &record.even.stretches;
        let old = &stretches[stretch].columns[column];
        if self.is_none() {
            return Cow::Borrowed(old);
        }
        let since = stretches[stretch].start - stretches[0].start;
        let before = (since / record.even.period).max(0.0);
        let at = |k: usize| k as f64 - (self.at_start + self.drift * (before + k as f64));
        // A straight line between samples would make what is fast smaller.
        (0..old.len()).map(|k| between(old, at(k))).collect()
    }

    /// Nobody knows which of two clocks that run apart tells seconds: parameters are less sure by what that makes of them,
    /// an inertia, which seconds are in twice, by twice as much.
    pub(super) fn widen(&self, parameters: &mut [Parameter]) {
        for parameter in parameters {
            let times = match parameter.name {
                "inertia" => 2.0,
                name if name.starts_with("viscous") => 1.0,
                _ => continue,
            };
            if let Some(known) = &mut parameter.known {
                let by = times * self.drift * known.value;
                known.std_correlated = known.std_correlated.hypot(by);
            }
        }
    }

    pub(super) fn remark(&self, period: f64) -> Option<String> {
        if self.is_none() {
            return None;
        }
        let mut text = format!(
            "voltage and position are not of the same moments: the voltage acts {:.3e} s ({:.1} samples) after its \
             row's position",
            self.at_start * period,
            self.at_start
        );
        if self.drift != 0.0 {
            let _ = write!(text, ", and its clock runs {:.1e} slower", self.drift);
        }
        Some(text + "; that was taken out")
    }
}

/// The skew that a record shows; none where it shows none.
///
/// # Errors
///
/// Where the channels are too far apart to be of one motion.
pub(super) fn skew(record: &Record, moved: &Moved, set: &Settings) -> Result<Skew, Unknown> {
    let mut skew = Skew::default();
    let estimate = |found: &Skew| estimate(record, moved, set, found);
    let Some(mut left) = estimate(&skew) else {
        return Ok(skew);
    };
    let plain = left.error;
    let mut found = skew;
    for _ in 0..ROUNDS {
        let more = left.skew;
        found.at_start += more.at_start;
        found.drift += more.drift;
        let samples = record.even.samples() as f64;
        let most = found
            .at_start
            .abs()
            .max((found.at_start + found.drift * samples).abs());
        if most.is_nan() || most > 3.0 * LATEST {
            return Ok(skew);
        }
        if more.is_none() {
            break;
        }
        let Some(next) = estimate(&found) else {
            return Ok(skew);
        };
        left = next;
        if more.at_start.abs() < 0.02 {
            break;
        }
    }
    let samples = record.even.samples() as f64;
    let most = found
        .at_start
        .abs()
        .max((found.at_start + found.drift * samples).abs());
    let more_than_held = !(-0.25..=OWN).contains(&found.at_start) || found.drift != 0.0;
    if left.error < LATE * plain && more_than_held {
        if most > LATEST {
            return Err(Unknown::all(format!(
                "its voltage and its position are not of the same moments: with the voltage {:.0} samples {} it is \
                 told better",
                most,
                if found.at_start > 0.0 {
                    "later"
                } else {
                    "earlier"
                }
            )));
        }
        skew = found;
    }
    Ok(skew)
}

struct Estimate {
    skew: Skew,
    error: f64,
}

/// What is left of the skew, by how the residuals of each part go with the force's rate.
fn estimate(record: &Record, moved: &Moved, set: &Settings, so_far: &Skew) -> Option<Estimate> {
    let mut columns = moved.equations_of(|k| so_far.moved(record, k, VOLTAGE), set);
    if let Some(keep) = columns.apart() {
        columns.retain(&keep);
    }
    let columns = columns;
    let n = columns.force.len();
    if n < 10 * PARTS {
        return None;
    }
    let speeds: Vec<f64> = columns.velocity.iter().map(|v| v.abs()).collect();
    let moving = SLOW * quantile(&speeds, 0.99);
    let moves = |i: usize| columns.velocity[i].abs() > moving;
    let x = columns.matrix(Friction::Asymmetric, Method::Delayed);
    let plain = columns.matrix(Friction::Asymmetric, Method::LeastSquares);
    let solution = over(&x, &columns.force, moves)?;
    // A rate that the other columns tell as well says nothing of when a voltage acts: what little of it is its own, noise
    // tells.
    let sliding: Vec<usize> = (0..n).filter(|i| moves(*i)).collect();
    if tolerance(&x.select_rows(&sliding), x.ncols() - 1) < check::OWN {
        return None;
    }
    let error = least_squares_alone(&plain, &columns.force)?.relative_error_percent;
    let (last, std) = (*solution.values.last()?, *solution.std_correlated.last()?);
    let mut skew = Skew {
        at_start: if last.abs() > 5.0 * std { last } else { 0.0 },
        drift: 0.0,
    };
    let period = record.even.period;
    let start = columns.time[0];
    let mut points = Vec::new();
    for part in 0..PARTS {
        let rows = part * n / PARTS..(part + 1) * n / PARTS;
        let (mut ll, mut lr, mut at, mut m) = (0.0, 0.0, 0.0, 0.0);
        for i in rows.filter(|i| moves(*i)) {
            let lag = columns.lag[i];
            ll += lag * lag;
            lr += lag * (solution.residuals[i] + last * lag);
            at += (columns.time[i] - start) / period;
            m += 1.0;
        }
        if ll > 0.0 && m > 5.0 {
            points.push((at / m, lr / ll));
        }
    }
    if points.len() == PARTS {
        let n = PARTS as f64;
        let (mx, my) = (
            points.iter().map(|p| p.0).sum::<f64>() / n,
            points.iter().map(|p| p.1).sum::<f64>() / n,
        );
        let xx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
        let slope = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>() / xx;
        let left: f64 = points
            .iter()
            .map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2))
            .sum();
        let sure = (left / (n - 2.0) / xx).sqrt();
        let whole = slope * record.even.samples() as f64;
        let known = so_far.drift != 0.0;
        if known || (slope.abs() > 6.0 * sure && whole.abs() > APART) {
            skew = Skew {
                at_start: my - slope * mx,
                drift: slope,
            };
        }
    }
    Some(Estimate { skew, error })
}
