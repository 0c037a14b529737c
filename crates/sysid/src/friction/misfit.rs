//! How far a contact is of another law than the one that is fitted, and what that makes of the parameters.
//!
//! Noise differs from one stroke to the next, and what a law cannot tell comes again wherever the contact is in the same state.
//! Batches of a record all have the same of it, so that their scatter says nothing of it: it has to be asked for. What a law
//! leaves is held against what other laws tell (R. Davidson and J. `MacKinnon`, *Several Tests for Model Specification in the
//! Presence of Alternative Hypotheses*, Econometrica 49, 1981), elements of every length among them.

use super::{Fitted, Law, Record, Sample, residuals};
use nalgebra::{DMatrix, DVector};
use pigtail_numerics::signal::quantile;

/// Ways, evenly on a logarithmic scale, over which elements of a contact slip; the least as a share of the stroke, the largest is half of it.
const WAYS: usize = 12;
const SHORTEST: f64 = 1.0 / 300.0;

/// Shares of all speeds at whose quantiles a level may fall.
const SPEEDS: [f64; 3] = [0.2, 0.5, 0.8];

/// A record's parts, each of blocks here and there: every one is told by the others.
const PARTS: usize = 8;
const BLOCKS: usize = 5;

/// What keeps columns that are nearly the same apart, of columns of length one: little where a record has seen many strokes,
/// much where it has seen few.
const RIDGES: [f64; 2] = [1e-6, 1e-3];

/// A neighbour leaves less than so many times as much.
const NEIGHBOUR: f64 = 2.0;

/// Rate of change from the sample before to the one after.
fn rates(samples: &[Sample], of: impl Fn(usize) -> f64) -> Vec<f64> {
    let n = samples.len();
    let rate = |k: usize| {
        let from = if k == 0 || samples[k].begins {
            k
        } else {
            k - 1
        };
        let to = if k + 1 == n || samples[k + 1].begins {
            k
        } else {
            k + 1
        };
        let time = samples[to].time - samples[from].time;
        if time > 0.0 {
            (of(to) - of(from)) / time
        } else {
            0.0
        }
    };
    (0..n).map(rate).collect()
}

/// What a contact's force may go with: the deflection of elements that slip after ways of every length, each direction for
/// itself (any Maxwell-slip contact is a sum of them); where it has time, levels that fall with speed.
fn states(record: &Record) -> Vec<Vec<f64>> {
    let samples = &record.samples;
    let (low, high) = record.range(|s| s.displacement);
    let mut columns = vec![vec![1.0; samples.len()]];
    for i in 0..WAYS {
        let share = i as f64 / (WAYS - 1) as f64;
        let way = 0.5 * (high - low) * (2.0 * SHORTEST).powf(share);
        let mut deflection = 0.0_f64;
        let mut last = samples[0].displacement;
        let of_way: Vec<f64> = samples
            .iter()
            .map(|s| {
                let step = if s.begins { 0.0 } else { s.displacement - last };
                last = s.displacement;
                deflection = (deflection + step / way).clamp(-1.0, 1.0);
                deflection
            })
            .collect();
        columns.push(of_way.iter().map(|d| d.max(0.0)).collect());
        columns.push(of_way.iter().map(|d| d.min(0.0)).collect());
    }
    if record.has_time {
        let speeds = rates(samples, |k| samples[k].displacement);
        let sizes: Vec<f64> = speeds.iter().map(|v| v.abs()).collect();
        for share in SPEEDS {
            let speed = quantile(&sizes, share);
            if speed > 0.0 {
                let falls = |v: &f64| v.signum() * (-(v / speed).powi(2)).exp();
                columns.push(speeds.iter().map(falls).collect());
            }
        }
    }
    columns
}

/// Share of the power of `left` that goes with the columns: as much as each part of it is told by what the others say. Where
/// there is nothing to tell, columns tell less than nothing of a part that they were not fitted to, by as much as a chance
/// could gain; so what is above zero is none.
fn told(columns: &[&[f64]], left: &[f64], ridge: f64) -> f64 {
    let (n, p) = (left.len(), columns.len());
    let lengths: Vec<f64> = columns
        .iter()
        .map(|c| c.iter().map(|v| v * v).sum::<f64>().sqrt())
        .collect();
    let used: Vec<usize> = (0..p).filter(|j| lengths[*j] > 0.0).collect();
    let x = DMatrix::from_fn(n, used.len(), |i, j| columns[used[j]][i] / lengths[used[j]]);
    let y = DVector::from_column_slice(left);
    let block = n.div_ceil(PARTS * BLOCKS);
    let rows_of = |part: usize| {
        (0..BLOCKS).map(move |b| {
            let from = ((b * PARTS + part) * block).min(n);
            from..(from + block).min(n)
        })
    };
    let moments: Vec<(DMatrix<f64>, DVector<f64>)> = (0..PARTS)
        .map(|part| {
            let mut sums = (
                DMatrix::zeros(used.len(), used.len()),
                DVector::zeros(used.len()),
            );
            for rows in rows_of(part) {
                let own = x.rows(rows.start, rows.len());
                sums.0 += own.tr_mul(&own);
                sums.1 += own.tr_mul(&y.rows(rows.start, rows.len()));
            }
            sums
        })
        .collect();
    let (mut before, mut after) = (0.0, 0.0);
    for part in 0..PARTS {
        let mut normal = DMatrix::identity(used.len(), used.len()) * ridge;
        let mut right = DVector::zeros(used.len());
        for (_, other) in moments.iter().enumerate().filter(|(k, _)| *k != part) {
            normal += &other.0;
            right += &other.1;
        }
        let Some(values) = normal.cholesky().map(|c| c.solve(&right)) else {
            return 0.0;
        };
        for rows in rows_of(part) {
            let own = y.rows(rows.start, rows.len());
            before += own.norm_squared();
            after += (own - x.rows(rows.start, rows.len()) * &values).norm_squared();
        }
    }
    if before > 0.0 {
        (1.0 - after / before).max(0.0)
    } else {
        0.0
    }
}

/// Finds how much of what each law leaves goes with the contact's state, and makes its parameters as unsure as that asks for.
///
/// The fit leaves nothing that its parameters could tell; how much of the misfit they took for themselves it does not show. As
/// much as is left may have gone into any one of them: its deviation is the change that leaves as much again, as if
/// all samples had one error in common. Where a neighbour tells the force nearly as well, what both know, the level and the stiffness at rest, is
/// also known no better than the two agree.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    let samples = &record.samples;
    let predicted: Vec<Vec<f64>> = laws
        .iter()
        .map(|l| l.law.predict(&l.values, samples))
        .collect();
    // What another law would tell is a state too, and a law's own stands for what it would have to take back.
    let states = states(record);
    for (fitted, own) in laws.iter_mut().zip(&predicted) {
        // A skew too small to be seen goes with the rate of the force.
        let rate = rates(samples, |k| own[k]);
        let mut few: Vec<&[f64]> = predicted.iter().map(|c| &c[..]).collect();
        if record.has_time {
            few.push(&rate);
        }
        let many: Vec<&[f64]> = states
            .iter()
            .map(|c| &c[..])
            .chain(few.iter().copied())
            .collect();
        let left = residuals(fitted.law, &fitted.values, samples, 0);
        // Short records do not tell many columns from each other, and few columns are not every contact: what tells most.
        let share = RIDGES
            .iter()
            .map(|ridge| told(&many, &left, *ridge))
            .fold(told(&few, &left, RIDGES[0]), f64::max);
        fitted.misfit_percent = share.sqrt() * fitted.relative_error_percent;
        let together = (share * samples.len() as f64).sqrt();
        for known in fitted.known.iter_mut().filter(|_| share > 0.0) {
            known.std_correlated = known.std_correlated.hypot(together * known.std);
        }
    }
    let all: Vec<(f64, f64, f64)> = laws
        .iter()
        .map(|l| {
            let (level, stiffness) = (l.law.level(&l.values), l.law.stiffness(&l.values));
            (l.relative_error_percent, level, stiffness)
        })
        .collect();
    for (k, fitted) in laws.iter_mut().enumerate() {
        if fitted.misfit_percent <= 0.0 {
            continue;
        }
        let (left, level, stiffness) = all[k];
        let beside = all.iter().filter(|other| other.0 < NEIGHBOUR * left);
        let (by_level, by_stiffness) = beside.fold((0.0_f64, 0.0_f64), |(l, s), other| {
            (
                l.max((other.1 - level).abs()),
                s.max((other.2 - stiffness).abs()),
            )
        });
        for (name, known) in fitted.law.parameters().iter().zip(&mut fitted.known) {
            let by = match *name {
                "stiffness" => by_stiffness,
                _ if Law::is_level(name) => by_level,
                _ => continue,
            };
            known.std_correlated = known.std_correlated.hypot(by);
        }
    }
}
