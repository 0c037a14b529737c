//! A response whose frequencies wander off what is said of them, as they do where rows were lost here and there before they were numbered.
//!
//! Each row that was lost takes all behind it one row farther, so that how far off a frequency is walks from row to row. A frequency that is off
//! moves a response along its own curve; what noise, a mean or another model leave goes across it as well. So what is left is told by a walk
//! along the curve, and by one across it, a model's numbers free beside either (a Kalman filter whitens what is left and what they change
//! alike; P. de Jong, *The diffuse Kalman filter*, 1991), and the two are held against each other.

use super::Record;
use super::renumbered::{BEFOREHAND, Numbers, UNLIKELY};
use super::search::squares;
use crate::Unknown;
use crate::steady::chi_squared;
use nalgebra::{Complex, DMatrix, DVector};
use pigtail_numerics::signal::independent;
use std::f64::consts::TAU;

/// Sizes of a walk that are tried, rows squared from row to row: each this many times the one before, from one that moves the response by
/// its noise at the last row.
const SIZES: i32 = 14;
const LARGER: f64 = 2.5;

/// A walk along the curve has to tell so many times what one across it does: of noise that goes with its neighbours both tell alike, and either,
/// made of few stretches that know nothing of each other, by chance a good part more. Set after 4 of 50 good responses with such noise
/// had been refused by a difference alone.
const ACROSS: f64 = 2.0;

/// A walk of a size, in rows squared from row to row, by how much likelier what is left is with it, twice the logarithm, and what it leaves,
/// squared, of itself.
#[derive(Debug, Clone, Copy)]
struct Walk {
    size: f64,
    gain: f64,
    left: f64,
}

/// By how much what is searched, `coded`, would be another one, for all that a response says of frequencies that wander.
///
/// # Errors
///
/// Where they do: chance makes a walk tell so much more once in ten thousand times. With it the share of what is left, squared, that is left then.
pub(super) fn open(
    record: &Record,
    coded: &[f64],
    numbers: &Numbers,
) -> Result<Vec<f64>, (Unknown, f64)> {
    let mut open = vec![0.0; coded.len()];
    let Some((curve, left)) = curve(record, coded, numbers) else {
        return Ok(open);
    };
    let Some(all) = beside(record, coded, left.clone()) else {
        return Ok(open);
    };
    let rows: Vec<f64> = record
        .frequency
        .iter()
        .map(|f| numbers.number(*f))
        .collect();
    let across: Vec<Complex<f64>> = curve.iter().map(|c| c * Complex::i()).collect();
    let (walks, none) = (walks(&all, &curve, &rows), walks(&all, &across, &rows));
    let most = |walks: &[Walk]| {
        walks
            .iter()
            .copied()
            .max_by(|a, b| a.gain.total_cmp(&b.gain))
    };
    let Some(best) = most(&walks) else {
        return Ok(open);
    };
    // Noise that goes with its neighbours' walks, but as much across the curve: what is left there tells how many points there are.
    let n = curve.len();
    let beside: Vec<f64> = (0..n)
        .filter(|i| curve[*i].norm() > 0.0)
        .map(|i| (Complex::new(left[i], left[n + i]) / curve[i] * curve[i].norm()).im)
        .collect();
    let own = independent(&beside) / beside.len().max(1) as f64;
    let usual = most(&none).map_or(0.0, |w| w.gain.max(0.0));
    let gain = |walk: &Walk| own * (walk.gain - ACROSS * usual);
    if gain(&best) > chi_squared(1.0) {
        return Err((wanders(&best, &rows), best.left));
    }
    let each = BEFOREHAND / walks.len() as f64;
    let likely = || walks.iter().map(|w| (w.size, each * (0.5 * gain(w)).exp()));
    let sum: f64 = likely().map(|(_, likely)| likely).sum();
    if sum / (1.0 + sum) < UNLIKELY {
        return Ok(open);
    }
    for frequency in open_of(record, coded, &mut open) {
        let (own, open) = frequency;
        let row = numbers.number(own / TAU).max(0.0);
        // As many rows were lost as a walk's variance says, and by chance so many more or fewer.
        let off = |size: f64| (size * row).powi(2) + size * row;
        let off = likely()
            .map(|(size, likely)| likely * off(size))
            .sum::<f64>()
            / (1.0 + sum);
        *open = (numbers.frequency(row + off.sqrt()) / numbers.frequency(row)).ln();
    }
    Ok(open)
}

/// Each mode's frequency, rad/s, and by how much its logarithm is open.
fn open_of<'a>(
    record: &Record,
    coded: &'a [f64],
    open: &'a mut [f64],
) -> impl Iterator<Item = (f64, &'a mut f64)> {
    let modes = 2 * record.modes(coded);
    let own = coded[..modes].iter().step_by(2).map(|f| f.exp());
    own.zip(open[..modes].iter_mut().step_by(2))
}

fn wanders(walk: &Walk, rows: &[f64]) -> Unknown {
    let last = rows.last().copied().unwrap_or(0.0);
    Unknown::all(format!(
        "its frequencies wander off what they are said to be, by about {:.1} % of a row squared from row to row, as where {:.0} of its {:.0} rows \
         had been lost or written twice here and there: were they numbered anew?",
        100.0 * walk.size,
        (walk.size * last).max(1.0),
        last + 1.0
    ))
}

/// By how much of its noise a response goes on from row to row, and what is left of it.
fn curve(
    record: &Record,
    coded: &[f64],
    numbers: &Numbers,
) -> Option<(Vec<Complex<f64>>, Vec<f64>)> {
    let (values, left) = record.linear(coded)?;
    let n = record.frequency.len();
    let noise = (squares(&left) / left.len() as f64).sqrt();
    if noise <= 0.0 {
        return None;
    }
    let told = |by: f64| {
        let moved = |f: &f64| numbers.frequency(numbers.number(*f) + by);
        let moved = record.frequency.iter().map(moved);
        let grid = Record {
            // What is told goes by the highest frequency, which stays.
            frequency: moved.chain([record.highest()]).collect(),
            response: vec![Complex::default(); n + 1],
            weight: record.weight.iter().copied().chain([1.0]).collect(),
            ..record.clone()
        };
        let told = grid.columns(coded) * DVector::from_column_slice(&values);
        let at = |i: usize| Complex::new(told[i], told[n + 1 + i]);
        (0..n).map(at).collect::<Vec<_>>()
    };
    let (ahead, behind) = (told(0.5), told(-0.5));
    let on = ahead.iter().zip(behind).map(|(a, b)| (a - b) / noise);
    Some((on.collect(), left))
}

/// What is left, and all that a model's numbers change.
fn beside(record: &Record, coded: &[f64], left: Vec<f64>) -> Option<Vec<Vec<f64>>> {
    let (columns, slopes) = (record.columns(coded), record.slopes_at(coded)?);
    let all = columns.column_iter().chain(slopes.column_iter());
    let all = all.map(|c| c.iter().copied().collect());
    Some(std::iter::once(left).chain(all).collect())
}

fn walks(all: &[Vec<f64>], along: &[Complex<f64>], rows: &[f64]) -> Vec<Walk> {
    let Some((none, own)) = likelihood(all, along, rows, 0.0) else {
        return Vec::new();
    };
    let power: f64 = along.iter().map(Complex::norm_sqr).sum();
    let least = 1.0 / (power * along.len() as f64);
    let walk = |k: i32| {
        let size = least * LARGER.powi(k);
        let (likely, left) = likelihood(all, along, rows, size)?;
        Some(Walk {
            size,
            gain: likely - none,
            left: left / own,
        })
    };
    (0..SIZES).filter_map(walk).collect()
}

/// Twice the logarithm of a restricted likelihood (H. Patterson and R. Thompson, 1971) of what is left, the first of `all`, the others free,
/// where each row is so many times `along` off as a walk of this size says; and what is left then, squared.
fn likelihood(
    all: &[Vec<f64>],
    along: &[Complex<f64>],
    rows: &[f64],
    size: f64,
) -> Option<(f64, f64)> {
    let (n, series) = (along.len(), all.len());
    let mut white = DMatrix::zeros(2 * n, series);
    let mut walk = vec![0.0; series];
    let (mut open, mut logarithms) = (0.0_f64, 0.0);
    for (i, along) in along.iter().enumerate() {
        let steps = if i > 0 { rows[i] - rows[i - 1] } else { 0.0 };
        open += size * steps;
        for (part, along) in [(i, along.re), (n + i, along.im)] {
            let variance = along * along * open + 1.0;
            let gain = open * along / variance;
            logarithms += variance.ln();
            for (j, own) in all.iter().enumerate() {
                let new = own[part] - along * walk[j];
                white[(part, j)] = new / variance.sqrt();
                walk[j] += gain * new;
            }
            open -= gain * along * open;
        }
    }
    let x = white.columns(1, series - 1);
    let scale: Vec<f64> = x.column_iter().map(|c| c.norm().max(1e-300)).collect();
    let x = DMatrix::from_fn(2 * n, series - 1, |i, j| x[(i, j)] / scale[j]);
    let normal = x.tr_mul(&x) + DMatrix::identity(series - 1, series - 1) * 1e-12;
    let normal = normal.cholesky()?;
    let y = white.column(0);
    let right = x.tr_mul(&y);
    let left = y.norm_squared() - right.dot(&normal.solve(&right));
    let lengths = normal.l_dirty().diagonal();
    let determinant: f64 = lengths.iter().chain(&scale).map(|d| 2.0 * d.ln()).sum();
    let freedom = (2 * n).saturating_sub(series - 1) as f64;
    let likely = -(freedom * left.ln() + logarithms + determinant);
    likely.is_finite().then_some((likely, left))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two modes and their noise at even frequencies, some of whose rows were lost before they were numbered.
    fn made(noise: f64, lost: impl Fn(usize) -> bool) -> (Record, Vec<f64>) {
        let at = |k: usize| 50.0 + 0.8 * k as f64;
        let drawn = |k: usize| {
            let bits = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            noise * ((bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
        };
        let told = |k: usize| {
            let f = at(k);
            let mode = |own: f64, size: f64| {
                size / Complex::new(1.0 - (f / own).powi(2), 2.0 * 0.02 * f / own)
            };
            let noise = Complex::new(drawn(k), drawn(k + 517));
            (mode(150.0, 1.0) + mode(260.0, 0.4)) * (1.0 + noise)
        };
        let response: Vec<Complex<f64>> = (0..400).filter(|k| !lost(*k)).map(told).collect();
        let frequency: Vec<f64> = (0..response.len()).map(at).collect();
        let record = Record::new(&frequency, &response, None).unwrap();
        let start = [
            (TAU * 148.0).ln(),
            0.02_f64.ln(),
            (TAU * 256.0).ln(),
            0.02_f64.ln(),
            0.0,
        ];
        let (coded, _) = record.settle(&start).unwrap();
        (record, coded)
    }

    #[test]
    fn rows_that_were_lost_here_and_there_show_and_none_do_where_none_were() {
        for noise in [0.003, 0.02] {
            let (record, coded) = made(noise, |_| false);
            let numbers = Numbers::of(&record.frequency).unwrap();
            let open = super::open(&record, &coded, &numbers).unwrap();
            let known = record.known(&coded).unwrap();
            assert!(open[0] < known.std[0], "{noise}: {open:?}");
            let (record, coded) = made(noise, |k| k * 7919 % 31 == 3);
            let numbers = Numbers::of(&record.frequency).unwrap();
            let (why, _) = super::open(&record, &coded, &numbers).unwrap_err();
            assert!(why.because.contains("numbered anew"), "{}", why.because);
        }
    }
}
