//! Whether a contact is one and the same throughout a record.

use super::{Fitted, Record, turned};
use crate::Unknown;
use crate::steady::between;
use pigtail_numerics::regression::{least_squares, matrix};

/// Parts of a record that are held against each other, and reversals that each has at least.
const PARTS: usize = 4;
const TURNS: usize = 3;

/// Deviations by which they differ where they do.
const SURE: f64 = 5.0;

/// Shares of the level beyond which a change is said, and beyond which there is no one level.
const SAID: f64 = 0.1;
const MOST: f64 = 0.3;

/// By how much force and offset of the parts differ, as shares of the level, where they do for certain.
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

/// Makes laws less sure by what parts of the record differ by beyond what they know: a force that is another one by some share is told by
/// ways that may be so much off, too.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    for fitted in laws {
        let Some(parts) = parts(record, fitted) else {
            continue;
        };
        let [size, offset] = [0, 1].map(|j| {
            let own: Vec<(f64, f64)> = parts.iter().map(|p| p[j]).collect();
            between(&own)
        });
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

fn change(record: &Record, fitted: &Fitted) -> Option<Change> {
    let parts = parts(record, fitted)?;
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
    Some(Change {
        level: apart(0),
        offset: apart(1),
    })
}

/// That a contact's force is the same throughout: a remark where it differs, no answer where it differs by much.
pub(super) fn same(record: &Record, fitted: &Fitted) -> Result<Option<String>, Unknown> {
    let Some(Change { level, offset }) = change(record, fitted) else {
        return Ok(None);
    };
    if level > MOST || offset > MOST {
        let (what, share) = if level >= offset {
            ("size", level)
        } else {
            ("offset", offset)
        };
        return Err(Unknown::all(format!(
            "its force changes within the record: the {what} of its quarters differs by {:.0} % of the level. Was a load, a gain or a \
             sensor's zero another one?",
            100.0 * share
        )));
    }
    let said = level.max(offset) > SAID;
    Ok(said.then(|| {
        format!(
            "its force changes within the record: quarters differ in size by {:.0} %, in offset by {:.0} % of the level; what is told \
             is of their mean",
            100.0 * level,
            100.0 * offset
        )
    }))
}
