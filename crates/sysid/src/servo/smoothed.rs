//! A position, or a voltage, that was smoothed before it was written.
//!
//! A mean over some time takes of a motion what is fast, the more the faster it is, and a voltage that is written as it was seems to have
//! moved more than there was. What inertia and friction make of a smoothed motion is the force smoothed alike: so the force, smoothed by
//! ourselves, is told by the columns as they are, where otherwise it is told by columns smoothed by ourselves as well. Noise of a voltage
//! is the same in both.

use super::bent::{NAMES, less_sure};
use super::other::{SURELY, differs, symmetric};
use super::{Equations, LATE, LEAST_EQUATIONS, Unknown, Variant};
use nalgebra::DMatrix;
use pigtail_numerics::regression::{Solution, least_squares, least_squares_alone};
use pigtail_numerics::signal::quantile;
use std::ops::Range;

/// Widths of a mean that are tried, equations.
const WIDTHS: [f64; 10] = [1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0];

/// A parameter is another one where it changes by this share.
const OTHER: f64 = 0.02;

/// What was smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Of {
    Position,
    Voltage,
}

struct Found {
    of: Of,
    width: f64,
    /// What is left, squared, as a share of what is left of a record that was not smoothed.
    ratio: f64,
    solution: Solution,
}

/// Where the record shows that one of its columns was smoothed parameters are less sure by what that changes, and where one is another
/// one by it none is known.
pub(super) fn smoothed(
    columns: &Equations,
    variants: &mut [Variant],
    unknown: &mut Vec<Unknown>,
    remarks: &mut Vec<String>,
) {
    if columns.one_way || columns.force.len() < LEAST_EQUATIONS {
        return;
    }
    let x = symmetric(columns);
    let Some(plain) = least_squares(&x, &columns.force) else {
        return;
    };
    let step = quantile(&differences(&columns.time), 0.5);
    let blocks = blocks(&columns.time, step);
    let tried = WIDTHS.iter().flat_map(|width| {
        [Of::Position, Of::Voltage].map(|of| tell(&x, columns, &blocks, (of, *width)))
    });
    let all: Vec<Found> = tried.flatten().collect();
    let best = all.iter().min_by(|a, b| a.ratio.total_cmp(&b.ratio));
    let Some(found) = best else {
        return;
    };
    // Over how long it was averaged is not known: any width that tells it may be right.
    let may_be = || all.iter().filter(|f| f.of == found.of);
    let (what, other) = match found.of {
        Of::Position => ("position", "voltage"),
        Of::Voltage => ("voltage", "position"),
    };
    let over = found.width * step;
    remarks.push(format!(
        "the {what} is smoother than what moved the axis, as one that was averaged over some {over:.2e} s before it was written: \
         parameters are less sure by what that changes; write it as it was, or the {other} averaged alike"
    ));
    let is_another = |f: &Found, j: usize| differs(&plain, &f.solution, &[j], OTHER);
    let another = (0..NAMES.len()).find_map(|j| Some((j, may_be().find(|f| is_another(f, j))?)));
    if let Some((j, other_by)) = another {
        unknown.push(Unknown {
            parameters: NAMES.concat(),
            because: format!(
                "the {what} is that of a mean over some {over:.2e} s: with the {other} averaged alike the {} would be {:.4e} instead of \
                 {:.4e}",
                NAMES[j][0].replace('_', " "),
                other_by.solution.values[j],
                plain.values[j]
            ),
        });
    }
    for (j, names) in NAMES.iter().enumerate() {
        let off = may_be()
            .map(|f| (plain.values[j] - f.solution.values[j]).abs())
            .fold(0.0, f64::max);
        less_sure(variants, names, off);
    }
}

/// What one column's being smoothed tells, where it tells the record surely better than that none was.
fn tell(
    x: &DMatrix<f64>,
    columns: &Equations,
    blocks: &[Range<usize>],
    (of, width): (Of, f64),
) -> Option<Found> {
    let mean = |column: &[f64]| mean(column, blocks, width);
    // The middle of a mean lies so far from a block's ends.
    let aside = (0.5 * width).ceil() as usize;
    let rows: Vec<usize> = blocks
        .iter()
        .flat_map(|b| b.start + aside..b.end.saturating_sub(aside))
        .collect();
    if rows.len() < LEAST_EQUATIONS {
        return None;
    }
    let over: Vec<Vec<f64>> = x.column_iter().map(|c| mean(c.as_slice())).collect();
    let over = DMatrix::from_fn(x.nrows(), x.ncols(), |i, j| over[j][i]);
    let (target, smoothed, not) = match of {
        Of::Position => {
            // Where a mean turns what was averaged does, nearly: friction's step is averaged as the force is.
            let mut smoothed = x.clone();
            smoothed.set_column(2, &over.column(2));
            (mean(&columns.force), smoothed, over)
        }
        Of::Voltage => (columns.force.clone(), over, x.clone()),
    };
    let target: Vec<f64> = rows.iter().map(|i| target[*i]).collect();
    let solution = least_squares_alone(&smoothed.select_rows(&rows), &target)?;
    let other = least_squares_alone(&not.select_rows(&rows), &target)?;
    let squares = |s: &Solution| s.residuals.iter().map(|r| r * r).sum::<f64>();
    let ratio = squares(&solution) / squares(&other);
    if ratio.is_nan() || ratio >= LATE * LATE {
        return None;
    }
    let pairs = other.residuals.iter().zip(&solution.residuals);
    let less: Vec<f64> = pairs.map(|(a, b)| a * a - b * b).collect();
    // Of means that overlap neighbours go together.
    let batch = (4.0 * width).ceil() as usize;
    let sums: Vec<f64> = less.chunks_exact(batch).map(|c| c.iter().sum()).collect();
    let n = sums.len() as f64;
    let middle = sums.iter().sum::<f64>() / n;
    let scatter = sums.iter().map(|s| (s - middle).powi(2)).sum::<f64>() / (n - 1.0);
    (n > 5.0 && middle > SURELY * (scatter / n).sqrt()).then(|| {
        Some(Found {
            of,
            width,
            ratio,
            solution: least_squares(&smoothed.select_rows(&rows), &target)?,
        })
    })?
}

fn differences(values: &[f64]) -> Vec<f64> {
    values.windows(2).map(|w| w[1] - w[0]).collect()
}

/// Rows that follow each other evenly.
fn blocks(time: &[f64], step: f64) -> Vec<Range<usize>> {
    let gaps = (1..time.len()).filter(|k| time[*k] - time[k - 1] > 1.5 * step);
    let mut from = 0;
    gaps.chain(std::iter::once(time.len()))
        .map(|to| std::mem::replace(&mut from, to)..to)
        .collect()
}

/// Means over so many equations about each; at a block's ends over what there is of it.
fn mean(column: &[f64], blocks: &[Range<usize>], width: f64) -> Vec<f64> {
    let half = 0.5 * (width - 1.0);
    let whole = half as usize;
    let share = half - whole as f64;
    let mut all = column.to_vec();
    for block in blocks {
        let own = &column[block.clone()];
        let last = own.len() - 1;
        let mut sums = vec![0.0];
        for (k, value) in own.iter().enumerate() {
            sums.push(sums[k] + value);
        }
        for k in 0..own.len() {
            let (from, to) = (k.saturating_sub(whole), (k + whole).min(last));
            let inside = sums[to + 1] - sums[from];
            let ends = own[k.saturating_sub(whole + 1)] + own[(k + whole + 1).min(last)];
            let weight = (to + 1 - from) as f64 + 2.0 * share;
            all[block.start + k] = (inside + share * ends) / weight;
        }
    }
    all
}
