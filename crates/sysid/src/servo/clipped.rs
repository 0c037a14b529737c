//! A voltage that the record does not show whole: cut off at a converter's or a logger's bound, sharply or softly.
//!
//! An amplifier that gave what is written is told from a record that was cut off by the motion itself: what the
//! axis does where the voltage is high is prediction of what it does where it is low.

use super::{Equations, Friction, Method, Record, Settings, VOLTAGE};
use crate::Unknown;
use pigtail_numerics::regression::least_squares;
use pigtail_numerics::signal::quantile;

/// Levels, as shares of the highest one, above which equations are left out.
const LEVELS: [f64; 6] = [0.95, 0.88, 0.8, 0.7, 0.6, 0.5];

/// So many times as many samples stand in the highest band as in the one below it, where a voltage is cut off. A
/// sine's are 2.4 times as many.
const PILED: f64 = 3.0;

/// Width of these bands, as a share of the highest level.
const BAND: f64 = 0.03;

/// A force is cut off where the motion asks for more than is written by this share of the highest level...
const SHORT: f64 = 0.02;

/// ... and by so many standard deviations; without samples piled up by so much more.
const SURE: f64 = 6.0;
const UNSEEN: f64 = 2.5;

/// Least share of the equations that have to be left.
const LEAST_LEFT: f64 = 0.3;

/// Which equations are to be believed, where a voltage was cut off; and the level of it, V. `None` where it was not.
///
/// # Errors
///
/// Where too little is left.
pub(super) fn clipped(
    record: &Record,
    set: &Settings,
    columns: &Equations,
) -> Result<Option<(Vec<bool>, f64)>, Unknown> {
    let volts: Vec<f64> = record
        .even
        .stretches
        .iter()
        .flat_map(|s| s.columns[VOLTAGE].iter().copied())
        .collect();
    // A share so small is spikes.
    let bounds = [-quantile(&volts, 0.0005), quantile(&volts, 0.9995)];
    if bounds.iter().any(|b| *b <= 0.0) {
        return Ok(None);
    }
    let piled = |side: usize| {
        let sign = [-1.0, 1.0][side];
        let within = |low: f64, high: f64| {
            let level = volts.iter().map(|u| sign * u / bounds[side]);
            level.filter(|l| *l >= low && *l < high).count() as f64
        };
        let top = within(1.0 - BAND, f64::INFINITY);
        top > 30.0 && top > PILED * within(1.0 - 2.0 * BAND, 1.0 - BAND).max(3.0)
    };
    let piled = [piled(0), piled(1)];
    let gain: Vec<f64> = columns.one.clone();
    let level = |i: usize| {
        let u = columns.force[i] / (set.force_per_volt * gain[i].max(0.1));
        let side = usize::from(u > 0.0);
        (side, u.abs() / bounds[side])
    };
    let n = columns.force.len();
    let x = columns.matrix(Friction::Asymmetric, Method::LeastSquares);
    // By how much more force the motion asks for than is written, and how sure that is, by what is below a level.
    let short = |below: f64, from: f64, to: f64, sides: [bool; 2]| -> Option<(f64, f64, bool)> {
        let kept = |i: &usize| {
            let (side, level) = level(*i);
            level < below || !sides[side]
        };
        let rows: Vec<usize> = (0..n).filter(kept).collect();
        if (rows.len() as f64) < LEAST_LEFT * n as f64 {
            return Some((f64::INFINITY, f64::INFINITY, false));
        }
        let force: Vec<f64> = rows.iter().map(|i| columns.force[*i]).collect();
        let found = least_squares(&x.select_rows(&rows), &force)?;
        let mut missing = [Vec::new(), Vec::new()];
        for i in 0..n {
            let (side, level) = level(i);
            if sides[side] && level >= from && level < to {
                let prediction: f64 = found
                    .values
                    .iter()
                    .enumerate()
                    .map(|(j, v)| v * x[(i, j)])
                    .sum();
                let sign = columns.force[i].signum();
                let most = set.force_per_volt * bounds[side] * gain[i].max(0.1);
                missing[side].push(sign * (prediction - columns.force[i]) / most);
            }
        }
        let all: Vec<f64> = missing.iter().flatten().copied().collect();
        if all.len() < 10 {
            return None;
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
        let by = mean(&all);
        let both =
            (0..2).all(|s| !sides[s] || missing[s].len() < 5 || mean(&missing[s]) > 0.5 * by);
        let spread = (all.iter().map(|m| (m - by).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        // Neighbours are not independent.
        let independent = (all.len() as f64 / 4.0).max(2.0);
        Some((by, by * independent.sqrt() / spread.max(1e-9), both))
    };
    let sides = if piled == [false, false] {
        [true, true]
    } else {
        piled
    };
    let wanted = if piled == [false, false] {
        UNSEEN * SHORT
    } else {
        SHORT
    };
    let Some((by, sure, both)) = short(LEVELS[0], LEVELS[0], f64::INFINITY, sides)
        .filter(|(by, ..)| by.is_finite())
        .into_iter()
        .chain(short(LEVELS[2], LEVELS[2], f64::INFINITY, sides).filter(|(by, ..)| by.is_finite()))
        .max_by(|a, b| a.0.total_cmp(&b.0))
    else {
        return Ok(None);
    };
    if by < wanted || sure < SURE || !both {
        return Ok(None);
    }
    for below in LEVELS {
        let enough = short(below, below - 0.12, below, sides);
        let (left, ..) = enough.unwrap_or((0.0, 0.0, true));
        if left.is_infinite() {
            break;
        }
        if left < 0.3 * SHORT {
            let keep = |i: usize| {
                let (side, level) = level(i);
                level < below || !sides[side]
            };
            let bound = (0..2)
                .filter(|s| sides[*s])
                .map(|s| bounds[s])
                .fold(0.0, f64::max);
            return Ok(Some(((0..n).map(keep).collect(), below * bound)));
        }
    }
    Err(Unknown::all(format!(
        "its voltage is cut off: where it is high the motion asks for {:.0} % more than is written, and what is below \
         tells too little",
        100.0 * by
    )))
}
