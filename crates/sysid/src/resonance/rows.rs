//! Whether what is told of one row is of one frequency.
//!
//! A response has magnitude and phase, or real and imaginary part, of one place; columns that were brought together row by row may be some
//! rows apart. Each of the two puts a mode elsewhere then, and a fit between them. A response that comes after its cause shows it, for its
//! magnitude tells its phase but for a delay (H. W. Bode, 1945).

use super::Record;
use super::search::{own_points, squares};
use crate::Unknown;
use crate::steady::chi_squared;
use crate::timeline::counted;
use nalgebra::Complex;

/// Rows by which a column may be too late or too early.
const APART: [isize; 5] = [1, 2, 3, 4, 6];

/// How likely it is that columns are so many rows apart, of one that says nothing of it. A choice.
const BEFOREHAND: f64 = 0.01;

/// What a row is made of.
#[derive(Debug, Clone, Copy)]
enum Columns {
    Sizes,
    Parts,
}

impl Columns {
    fn names(self) -> [&'static str; 2] {
        match self {
            Self::Sizes => ["magnitude", "phase"],
            Self::Parts => ["real part", "imaginary part"],
        }
    }

    /// The first column of one row and the second of another one.
    fn of(self, first: Complex<f64>, second: Complex<f64>) -> Complex<f64> {
        match self {
            Self::Sizes => Complex::from_polar(first.norm(), second.arg()),
            Self::Parts => Complex::new(first.re, second.im),
        }
    }
}

/// The same with the first column of so many rows on.
fn shifted(record: &Record, columns: Columns, by: isize) -> Record {
    let n = record.response.len();
    let rows = (0..n).filter_map(|k| Some((k, k.checked_add_signed(by).filter(|of| *of < n)?)));
    let (mut frequency, mut response, mut weight) = (Vec::new(), Vec::new(), Vec::new());
    for (k, of) in rows {
        frequency.push(record.frequency[k]);
        response.push(columns.of(record.response[of], record.response[k]));
        weight.push(record.weight[of]);
    }
    Record {
        frequency,
        response,
        weight,
        ..record.clone()
    }
}

/// By how much what is searched, `coded`, would be another one, for all that a response says of its columns' rows.
///
/// # Errors
///
/// Where they are some rows apart: chance makes a shift tell so much more once in ten thousand times.
pub(super) fn open(record: &Record, coded: &[f64]) -> Result<Vec<f64>, Unknown> {
    let of_points = |left: &[f64]| squares(left) / left.len() as f64;
    let own = record.residuals(coded);
    let (plain, points) = (of_points(&own), own_points(&own));
    let told = |(columns, by): (Columns, isize)| {
        let moved = shifted(record, columns, by);
        let (settled, _) = moved.settle(coded)?;
        let left = moved.residuals(&settled);
        let share = (of_points(&left) / plain).sqrt();
        // What a worse model leaves goes with its neighbours, whatever the noise does.
        let points = if share < 1.0 {
            own_points(&left)
        } else {
            points
        };
        let gain = -2.0 * points * share.ln();
        gain.is_finite()
            .then_some((gain, share, columns, by, settled))
    };
    let shifts = || APART.iter().flat_map(|rows| [*rows, -rows]);
    let all: Vec<_> = [Columns::Sizes, Columns::Parts]
        .into_iter()
        .flat_map(|columns| shifts().map(move |by| (columns, by)))
        .filter_map(told)
        .collect();
    let best = all.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((gain, share, columns, by, _)) = best
        && *gain > chi_squared(1.0)
    {
        let [first, second] = columns.names();
        return Err(Unknown::all(format!(
            "its {first} is {} {} than its {second}: so it is told to {:.0} % of what is left where both are of one row; and \
             which of the two is of the row's frequency nobody knows",
            counted(by.unsigned_abs(), "row"),
            if *by > 0 { "later" } else { "earlier" },
            100.0 * share
        )));
    }
    // A shift of rows that stand close is no shift to speak of, and as likely.
    let others = all
        .iter()
        .map(|(gain, .., other)| (BEFOREHAND * (0.5 * gain).exp(), other.as_slice()));
    Ok(off_by(coded, others))
}

/// Root mean square of how far off the numbers of a model are where other ones are each so many times as likely as that.
pub(super) fn off_by<'a>(
    coded: &[f64],
    others: impl Iterator<Item = (f64, &'a [f64])>,
) -> Vec<f64> {
    let mut all = 1.0;
    let mut squares = vec![0.0; coded.len()];
    for (likely, other) in others {
        all += likely;
        for (sum, (a, b)) in squares.iter_mut().zip(other.iter().zip(coded)) {
            *sum += likely * (a - b).powi(2);
        }
    }
    squares.iter().map(|sum| (sum / all).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A mode and its noise, magnitudes `rows` rows late.
    fn made(noise: f64, rows: usize) -> (Record, Vec<f64>) {
        let at = |k: usize| 50.0 + 0.5 * k as f64;
        let drawn = |k: usize| {
            let bits = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            noise * ((bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
        };
        let mode = |k: usize| {
            let f = at(k);
            let below = Complex::new(150.0_f64.powi(2) - f * f, 2.0 * 0.03 * 150.0 * f);
            let noise = Complex::new(drawn(k), drawn(k + 517));
            150.0_f64.powi(2) / below * (1.0 + noise)
        };
        let frequency: Vec<f64> = (6..400).map(at).collect();
        let response: Vec<Complex<f64>> = (6..400)
            .map(|k| Columns::Sizes.of(mode(k - rows), mode(k)))
            .collect();
        let record = Record::new(&frequency, &response, None).unwrap();
        let start = [(TAU * 150.0).ln(), 0.03_f64.ln(), 0.0];
        let (coded, _) = record.settle(&start).unwrap();
        (record, coded)
    }

    #[test]
    fn a_column_that_is_a_row_late_is_found_in_noise_and_none_is_where_none_is() {
        for noise in [0.003, 0.03] {
            let (record, coded) = made(noise, 0);
            let open = open(&record, &coded).unwrap();
            let known = record.known(&coded).unwrap();
            assert!(open[0] < known.std[0], "{open:?}");
            let (record, coded) = made(noise, 1);
            let why = super::open(&record, &coded).unwrap_err().because;
            assert!(why.contains("magnitude is 1 row later"), "{why}");
        }
    }
}
