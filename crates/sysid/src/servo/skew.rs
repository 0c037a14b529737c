//! By how much voltage and position of one row are of different moments.
//!
//! A voltage that is held until the next sample acts half a sample late, which every record shows and no fit needs to
//! know. Channels of two instruments are further apart, and may have clocks that run apart.

use super::{
    Friction, LATE, LATEST, Method, Moved, Record, Settings, VOLTAGE, Variant, check, other,
};
use crate::Unknown;
use pigtail_numerics::bisection::onset;
use pigtail_numerics::regression::{least_squares_alone, over, tolerance};
use pigtail_numerics::signal::{between, rms};
use pigtail_numerics::statistics::outside;
use std::borrow::Cow;
use std::fmt::Write as _;

/// A skew of the voltage, samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Skew {
    /// By how much later the voltage acts than its row's position was, at the record's beginning.
    pub(super) at_start: f64,
    /// By how much more at each sample.
    pub(super) drift: f64,
    /// Of a held voltage that another clock reads, which drifts by whole samples.
    stairs: Option<Stairs>,
}

/// A drift by whole samples.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stairs {
    /// The share of the next sample at the record's beginning.
    share: f64,
    /// The largest drift that makes the steps that are there.
    most: f64,
}

/// A delay that a held voltage has by itself, samples, is left.
const OWN: f64 = 1.0;

/// Clocks that come apart by less than this over a record, samples, are one.
const APART: f64 = 0.4;

/// Parts of a record whose skews are compared.
const PARTS: usize = 6;

const ROUNDS: usize = 6;

/// Blocks of a record by which a drift by whole samples is looked for.
const BLOCKS: usize = 600;

impl Skew {
    /// By how much later the voltage acts so many samples behind the record's beginning.
    fn at(&self, samples: f64) -> f64 {
        let drifted = self.drift * samples;
        self.at_start
            + self
                .stairs
                .map_or(drifted, |stairs| (stairs.share + drifted).floor())
    }

    /// By how much clocks run apart, at most.
    fn apart(&self) -> f64 {
        self.stairs.map_or(self.drift, |stairs| stairs.most)
    }

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
        let at = |k: usize| k as f64 - self.at(before + k as f64);
        // A straight line between samples would make what is fast smaller.
        (0..old.len()).map(|k| between(old, at(k))).collect()
    }

    /// Nobody knows which of two clocks that run apart tells seconds: parameters lie in the middle of what the two make of them, and
    /// are less sure by half of what those differ by, an inertia, which seconds are in twice, by twice as much.
    pub(super) fn widen(&self, variant: &mut Variant) {
        for (j, parameter) in variant.parameters.iter_mut().enumerate() {
            let times = match parameter.name {
                "inertia" => 2.0,
                name if name.starts_with("viscous") => 1.0,
                _ => continue,
            };
            // They are told by the position's clock.
            let by = 0.5 * times * self.apart();
            if let Some(value) = variant.values.get_mut(j) {
                *value *= 1.0 - by;
            }
            if let Some(known) = &mut parameter.known {
                known.std_correlated = either(by * known.value, known.std_correlated);
                known.value *= 1.0 - by;
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
            let _ = write!(
                text,
                ", and its clock runs {:.1e} slower{} (which of the two tells seconds is not known: values lie between)",
                self.apart(),
                if self.stairs.is_some() {
                    ", by whole samples, as of a held voltage"
                } else {
                    ""
                }
            );
        }
        Some(text + "; that was taken out")
    }
}

/// The deviation of which 1.96 hold in 95 % what lies `aside` to one of two sides, known to `std`: as wide as both together need, which
/// is less than what a root of squares says, since it never lies farther.
fn either(aside: f64, std: f64) -> f64 {
    const Z: f64 = 1.96;
    let aside = aside.abs();
    let beyond = |edge: f64| outside(edge, aside, 0.0, std);
    let (_, edge) = onset((0.0, aside + Z * std), 40, |edge| beyond(edge) <= 0.05);
    edge / Z
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
    let stairs = left.stairs();
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
    // A held voltage's own delay is left in one that was moved by whole samples, and counts in neither. Steps that tell little better are what
    // an axis that starts and stops leaves beside its friction.
    if let Some(stairs) = stairs
        && estimate(&stairs).is_some_and(|next| next.delayed < LATE * left.delayed)
    {
        return Ok(stairs);
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
    /// Relative errors, per cent, without and with what is left of a delay.
    error: f64,
    delayed: f64,
    blocks: Vec<Block>,
    /// Samples of the record, and the variance of what is left of an equation.
    samples: f64,
    variance: f64,
}

/// What some neighbours say of the skew: the samples since the beginning, the squares of the force's rate, and what is left times it.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    at: f64,
    squares: f64,
    left: f64,
}

impl Estimate {
    /// A drift by whole samples, where it tells the blocks far better than one skew does, and better than an even drift.
    fn stairs(&self) -> Option<Skew> {
        /// Times the variance, by which one skew and an even drift tell them worse.
        const BETTER: [f64; 2] = [50.0, 10.0];
        /// Steps within a record, and how many drifts and beginnings of one are tried; then by how many finer steps, how often.
        const STEPS: (f64, f64) = (0.6, 15.0);
        const TRIED: i32 = 80;
        const FINER: (usize, usize) = (5, 3);
        let all: f64 = self.blocks.iter().map(|b| b.squares).sum();
        // What steps leave, and the skew beside them.
        let of = |step: &dyn Fn(f64) -> f64| -> (f64, f64) {
            let (mut with, mut own, mut left) = (0.0, 0.0, 0.0);
            for block in &self.blocks {
                let step = step(block.at);
                with += block.squares * step;
                own += step * (block.squares * step - 2.0 * block.left);
                left += block.left;
            }
            ((own - (left - with).powi(2) / all), (left - with) / all)
        };
        let (one, _) = of(&|_| 0.0);
        let even = {
            let sum = |f: fn(&Block) -> f64| self.blocks.iter().map(f).sum::<f64>() / all;
            let middle = sum(|b| b.squares * b.at);
            let [xx, xy] = self.blocks.iter().fold([0.0; 2], |[xx, xy], b| {
                let x = b.at - middle;
                [xx + b.squares * x * x, xy + x * b.left]
            });
            one - xy * xy / xx
        };
        let tell = |drift: f64, share: f64| of(&|at| (share + drift * at).floor());
        let ratio = (STEPS.1 / STEPS.0).powf(1.0 / f64::from(TRIED - 1));
        let better = |best: (f64, f64, f64), drift: f64, share: f64| {
            let (left, _) = tell(drift, share);
            if left < best.0 {
                (left, drift, share)
            } else {
                best
            }
        };
        let mut best = (f64::INFINITY, 0.0, 0.0);
        for k in 0..TRIED {
            let drift = STEPS.0 / self.samples * ratio.powi(k);
            for j in 0..TRIED {
                let share = f64::from(j) / f64::from(TRIED);
                best = better(best, drift, share);
                best = better(best, -drift, share);
            }
        }
        let (mut by, mut aside) = (ratio - 1.0, 1.0 / f64::from(TRIED));
        let steps = || (0..=2 * FINER.0).map(|k| k as f64 / FINER.0 as f64 - 1.0);
        for _ in 0..FINER.1 {
            let (_, drift, share) = best;
            for k in steps() {
                best = steps().fold(best, |best, j| {
                    better(best, drift * (1.0 + by * k), share + aside * j)
                });
            }
            (by, aside) = (by / FINER.0 as f64, aside / FINER.0 as f64);
        }
        let (left, drift, share) = best;
        if left > one - BETTER[0] * self.variance || left > even - BETTER[1] * self.variance {
            return None;
        }
        // A held voltage acts half a sample behind its row, and whole samples move no value aside.
        let (_, skew) = tell(drift, share);
        let whole = (skew - 0.5).round();
        let held = (skew - 0.5 - whole).abs() < 0.25;
        let farthest = |samples: f64| (skew + drift * samples).abs();
        if farthest(0.0).max(farthest(self.samples)) > LATEST {
            return None;
        }
        Some(Skew {
            at_start: if held { whole } else { skew },
            drift,
            stairs: Some(Stairs {
                share,
                most: self.most(drift, share),
            }),
        })
    }

    /// The largest drift that makes the same steps: of one step nobody knows when the next one would come.
    fn most(&self, drift: f64, share: f64) -> f64 {
        let whole = |at: f64| (share + drift * at).floor();
        if (whole(self.samples) - whole(0.0)).abs() > 1.0 {
            return drift;
        }
        let to_next = if drift > 0.0 {
            1.0 - share.fract()
        } else {
            share.fract()
        };
        let at = to_next / drift.abs();
        drift.signum() / at.max(self.samples - at)
    }
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
    // Beside a start, a stop or a turn the step of friction is smeared, and passes for a voltage of another moment.
    let slides = other::moves(&columns);
    let moves = |i: usize| slides[i];
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
        ..Skew::default()
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
                stairs: None,
            };
        }
    }
    let mut blocks = vec![(Block::default(), 0.0); BLOCKS];
    for i in &sliding {
        let (block, count) = &mut blocks[i * BLOCKS / n];
        let lag = columns.lag[*i];
        block.at += (columns.time[*i] - start) / period;
        block.squares += lag * lag;
        block.left += lag * (solution.residuals[*i] + last * lag);
        *count += 1.0;
    }
    let blocks = blocks.into_iter().filter(|(_, count)| *count > 0.0);
    Some(Estimate {
        skew,
        error,
        delayed: solution.relative_error_percent,
        blocks: blocks
            .map(|(block, count)| Block {
                at: block.at / count,
                ..block
            })
            .collect(),
        samples: record.even.samples() as f64,
        variance: rms(sliding.iter().map(|i| solution.residuals[*i])).powi(2),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_to_one_of_two_sides_is_held_by_as_much_as_that_takes() {
        assert!((either(0.0, 2.0) - 2.0).abs() < 1e-3);
        // Far aside one side of the noise counts: 1.645 of its deviations hold 95 %.
        assert!((1.96 * either(10.0, 1.0) - 11.645).abs() < 1e-3);
        assert!((1.96 * either(3.0, 0.0) - 3.0).abs() < 1e-6);
    }
}
