//! Whether magnitude and phase of one row are of one frequency.
//!
//! A response has both of one place; columns that were brought together row by row may be some rows apart. Each of the two puts a
//! mode elsewhere then, and a fit between them.

use super::Record;
use super::search::squares;
use crate::Unknown;
use nalgebra::Complex;

/// Rows by which a magnitude may be too late or too early.
const APART: [isize; 5] = [1, 2, 3, 4, 6];

/// A shift is one that leaves less than this share of what is left without.
const TELLS: f64 = 0.6;

/// The same with the magnitude of so many rows on.
fn shifted(record: &Record, by: isize) -> Record {
    let n = record.response.len();
    let rows = (0..n).filter_map(|k| Some((k, k.checked_add_signed(by).filter(|of| *of < n)?)));
    let (mut frequency, mut response, mut weight) = (Vec::new(), Vec::new(), Vec::new());
    for (k, of) in rows {
        let (size, turn) = (record.response[of].norm(), record.response[k].arg());
        frequency.push(record.frequency[k]);
        response.push(Complex::from_polar(size, turn));
        weight.push(record.weight[of]);
    }
    Record {
        frequency,
        response,
        weight,
        ..record.clone()
    }
}

/// That magnitude and phase are of one row, or by how many rows they are not, of a response told by `coded`.
pub(super) fn of_one(record: &Record, coded: &[f64]) -> Result<(), Unknown> {
    let left = |record: &Record, coded: &[f64]| {
        let points = record.frequency.len() as f64;
        (squares(&record.residuals(coded)) / points).sqrt()
    };
    let plain = left(record, coded);
    let told = |by: isize| {
        let moved = shifted(record, by);
        let (settled, _) = moved.settle(coded)?;
        Some((left(&moved, &settled), by))
    };
    let best = APART
        .iter()
        .flat_map(|rows| [*rows, -rows])
        .filter_map(told)
        .min_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((other, by)) if other < TELLS * plain => Err(Unknown::all(format!(
            "its magnitude is {} rows {} than its phase: so it is told to {:.0} % of what is left where both are of one row; and \
             which of the two is of the row's frequency nobody knows",
            by.abs(),
            if by > 0 { "later" } else { "earlier" },
            100.0 * other / plain
        ))),
        _ => Ok(()),
    }
}
