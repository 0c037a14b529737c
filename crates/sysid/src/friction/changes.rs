//! Whether a contact is one and the same throughout a record.

use super::{Fitted, Record, turned};
use crate::Unknown;
use crate::steady::{between, chi_squared};
use pigtail_numerics::regression::{Solution, least_squares, matrix};
use pigtail_numerics::signal::independent;

/// Parts of a record that are held against each other, and reversals that each has at least.
const PARTS: usize = 4;
const TURNS: usize = 3;

/// Degrees of the polynomials by which a level may go on slowly, and places at which they are looked at.
const SLOW: usize = 3;
const PLACES: usize = 40;

/// Deviations by which they differ where they do.
const SURE: f64 = 5.0;

/// Shares of the level beyond which a change is said, and beyond which there is no one level.
const SAID: f64 = 0.1;
const MOST: f64 = 0.3;

/// By how much force and offset differ within the record, as shares of the level, where they do for certain.
struct Change {
    level: f64,
    offset: f64,
}

/// Of each part, times what the law tells of the force, and the offset beside it, shares of the level, each with its deviation.
fn parts(record: &Record, fitted: &Fitted) -> Option<Vec<[(f64, f64); 2]>> {
    let samples = &record.samples;
    let told = fitted.law.predict(&fitted.values, samples);
    let [forward, backward] = fitted.law.sides(&fitted.values);
    let (level, middle) = (0.5 * (forward + backward), 0.5 * (forward - backward));
    let (low, high) = record.range(|s| s.displacement);
    let n = samples.len();
    let mut parts: Vec<[(f64, f64); 2]> = Vec::with_capacity(PARTS);
    for part in 0..PARTS {
        let rows = part * n / PARTS..(part + 1) * n / PARTS;
        if turned(&samples[rows.clone()], high - low).len() < TURNS {
            return None;
        }
        let force: Vec<f64> = samples[rows.clone()]
            .iter()
            .map(|s| s.force / level)
            .collect();
        let own: Vec<f64> = told[rows].iter().map(|f| (f - middle) / level).collect();
        let found = least_squares(&matrix(&[&own, &vec![1.0; own.len()]]), &force)?;
        parts.push([0, 1].map(|j| (found.values[j], found.std_correlated[j])));
    }
    Some(parts)
}

/// By how much times of what the law tells, and the offset beside it, range over the record as they go on slowly, shares of the level; zero
/// where chance makes them so once in ten thousand times.
///
/// A level that warms up, or wears in, goes on within each part of a record as well: each part's own scatter is that, and parts that differ by
/// it seem to differ by chance. Polynomials of time beside the law take it out.
fn slow(record: &Record, fitted: &Fitted) -> Option<[f64; 2]> {
    let law = fitted.law;
    let told = law.predict(&fitted.values, &record.samples);
    let [forward, backward] = law.sides(&fitted.values);
    let (level, middle) = (0.5 * (forward + backward), 0.5 * (forward - backward));
    let n = told.len();
    let force: Vec<f64> = record.samples.iter().map(|s| s.force / level).collect();
    let size: Vec<f64> = told.iter().map(|f| (f - middle) / level).collect();
    let one = vec![1.0; n];
    let beside = |column: &[f64]| -> Vec<Vec<f64>> {
        let at = |k: usize| polynomials((k as f64 + 0.5) / n as f64);
        (0..SLOW)
            .map(|j| {
                column
                    .iter()
                    .enumerate()
                    .map(|(k, c)| c * at(k)[j])
                    .collect()
            })
            .collect()
    };
    let slow = [beside(&size), beside(&one)];
    let fit = |of: &[&Vec<Vec<f64>>]| -> Option<Solution> {
        let more = of.iter().flat_map(|columns| columns.iter().map(|c| &c[..]));
        let columns: Vec<&[f64]> = [&size[..], &one[..]].into_iter().chain(more).collect();
        least_squares(&matrix(&columns), &force)
    };
    let squares = |s: &Solution| s.residuals.iter().map(|r| r * r).sum::<f64>();
    let all = fit(&[&slow[0], &slow[1]])?;
    let points = independent(&all.residuals);
    let ranges = |j: usize| {
        let without = fit(&[&slow[1 - j]])?;
        let gained = points * (squares(&without) / squares(&all)).ln();
        if gained < chi_squared(SLOW as f64) {
            return Some(0.0);
        }
        let own = &all.values[2 + SLOW * j..2 + SLOW * (j + 1)];
        let value = |k: usize| {
            let at = polynomials(k as f64 / PLACES as f64);
            at.iter().zip(own).map(|(p, v)| p * v).sum::<f64>()
        };
        let (low, high) = (0..=PLACES)
            .map(value)
            .fold((0.0_f64, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        Some(high - low)
    };
    Some([ranges(0)?, ranges(1)?])
}

/// Legendre's polynomials of the first degrees at a share of the record; each is zero in the mean.
fn polynomials(share: f64) -> [f64; SLOW] {
    let x = 2.0 * share - 1.0;
    [x, 1.5 * x * x - 0.5, 2.5 * x * x * x - 1.5 * x]
}

/// Makes laws less sure by what parts of the record differ by beyond what they know: a force that is another one by some share is told by
/// ways that may be so much off, too.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    for fitted in laws {
        let parts = parts(record, fitted).unwrap_or_default();
        let [size, offset] = [0, 1].map(|j| {
            let own: Vec<(f64, f64)> = parts.iter().map(|p| p[j]).collect();
            between(&own)
        });
        // A level that was each of those between two is known to half of what they are apart.
        let slow = slow(record, fitted).unwrap_or_default();
        let (size, offset) = (size.max(0.5 * slow[0]), offset.max(0.5 * slow[1]));
        let level = fitted.law.sides(&fitted.values)[0];
        for (name, known) in fitted.law.parameters().iter().zip(&mut fitted.known) {
            let by = if *name == "offset" {
                offset * level
            } else {
                size * known.value
            };
            known.std_correlated = known.std_correlated.hypot(by);
        }
    }
}

fn change(record: &Record, fitted: &Fitted) -> Change {
    let parts = parts(record, fitted).unwrap_or_default();
    let apart = |j: usize| {
        let of = |p: &[(f64, f64); 2]| p[j];
        let by = |a: &(f64, f64), b: &(f64, f64)| a.0.total_cmp(&b.0);
        let (Some(least), Some(most)) = (
            parts.iter().map(of).min_by(by),
            parts.iter().map(of).max_by(by),
        ) else {
            return 0.0;
        };
        let off = most.0 - least.0;
        if off > SURE * least.1.hypot(most.1) {
            off
        } else {
            0.0
        }
    };
    let slow = slow(record, fitted).unwrap_or_default();
    Change {
        level: apart(0).max(slow[0]),
        offset: apart(1).max(slow[1]),
    }
}

/// That a contact's force is the same throughout: a remark where it differs, no answer where it differs by much.
pub(super) fn same(record: &Record, fitted: &Fitted) -> Result<Option<String>, Unknown> {
    let Change { level, offset } = change(record, fitted);
    if level > MOST || offset > MOST {
        let (what, share) = if level >= offset {
            ("size", level)
        } else {
            ("offset", offset)
        };
        return Err(Unknown::all(format!(
            "its force changes within the record: its {what} differs by {:.0} % of the level from one part to another. Was a load, a gain or a \
             sensor's zero another one?",
            100.0 * share
        )));
    }
    let said = level.max(offset) > SAID;
    Ok(said.then(|| {
        format!(
            "its force changes within the record: parts differ in size by {:.0} %, in offset by {:.0} % of the level; what is told is \
             of their mean, and as unsure as that",
            100.0 * level,
            100.0 * offset
        )
    }))
}
