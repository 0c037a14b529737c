//! Single samples of a voltage that drove nothing: signs that were turned, values that were lost, words of another channel.
//!
//! A voltage may jump as it likes, and where many samples do none is an outlier by its size. What drove the axis is what its motion
//! answers to: samples apart from their neighbours are set aside where the motion is told better without them.

use super::{Equations, Friction, Method, Moved, Record, Settings, VOLTAGE};
use crate::Unknown;
use crate::timeline::counted;
use pigtail_numerics::regression::least_squares_alone;
use pigtail_numerics::signal::quantiles;
use std::borrow::Cow;

/// Neighbours to either side by which a sample is judged.
const REACH: usize = 3;

/// A sample is doubtful where it is apart from the middle of its neighbours by so many usual deviations...
const FAR: f64 = 6.0;

/// ... and these agree with each other within this share of that.
const AGREE: f64 = 0.5;

/// Largest share of doubtful samples that is looked at, and that is bridged: of more not all are told, for neighbours are doubtful, too.
/// The second was 0.25 until records with a tenth of their signs turned, of which 8 % were told, had been seen 1.3 to 2.8 % off.
const LOOKED: f64 = 0.25;
const MANY: f64 = 0.06;

/// Deviations by which the motion has to be told better without them. Without samples that did drive it it is told worse.
const SURE: f64 = 3.0;

/// The record without the samples of its voltage that did not drive the axis, each bridged.
///
/// # Errors
///
/// Where they are so many that others may be among those that are believed.
pub(super) fn without<'r>(
    record: &'r Record,
    moved: Option<&Moved>,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> Result<Cow<'r, Record>, Unknown> {
    let doubtful = doubtful(record);
    let count = doubtful.iter().flatten().filter(|d| **d).count();
    let share = count as f64 / record.even.samples() as f64;
    if count == 0 || share > LOOKED {
        return Ok(Cow::Borrowed(record));
    }
    let mut mended = record.clone();
    for (stretch, doubtful) in mended.even.stretches.iter_mut().zip(&doubtful) {
        bridge(&mut stretch.columns[VOLTAGE], doubtful);
    }
    let own;
    let moved = if let Some(moved) = moved {
        moved
    } else {
        own = Moved::of(record, set);
        &own
    };
    let left = |record: &Record| left(&moved.equations(record, set));
    let Some((before, after)) = left(record).zip(left(&mended)) else {
        return Ok(Cow::Borrowed(record));
    };
    let (mut less, mut squares) = (0.0, 0.0);
    for (a, b) in before.iter().zip(&after) {
        let by = a * a - b * b;
        less += by;
        squares += by * by;
    }
    if less <= SURE * squares.sqrt() {
        return Ok(Cow::Borrowed(record));
    }
    if share > MANY {
        return Err(Unknown::all(format!(
            "{:.0} % of the voltages are apart from their neighbours and drove nothing, and there will be others that are not told: were \
             signs turned, or values lost?",
            100.0 * share
        )));
    }
    remarks.push(format!(
        "{} of the voltage, {:.2} % of all, apart from their neighbours, drove nothing: the motion is told better without them, \
         and they were set aside and bridged",
        counted(count, "single sample"),
        100.0 * share
    ));
    Ok(Cow::Owned(mended))
}

fn left(columns: &Equations) -> Option<Vec<f64>> {
    let x = columns.matrix(Friction::Asymmetric, Method::LeastSquares);
    Some(least_squares_alone(&x, &columns.force)?.residuals)
}

/// Which samples of each stretch are apart from neighbours that agree with each other; where some are, of the others by what these are
/// bridged to: neighbours may be doubtful themselves.
fn doubtful(record: &Record) -> Vec<Vec<bool>> {
    /// Of a normal distribution, its deviation over its median and its third quartile.
    const OF: [f64; 2] = [1.4826, 0.8696];
    const ROUNDS: usize = 4;
    let volts = || record.even.stretches.iter().map(|s| &s.columns[VOLTAGE]);
    let sizes: Vec<f64> = volts()
        .flat_map(|v| apart(v, v).map(|(by, _)| by).collect::<Vec<_>>())
        .collect();
    let mut flags: Vec<Vec<bool>> = volts().map(|v| vec![false; v.len()]).collect();
    if sizes.is_empty() {
        return flags;
    }
    let [half, most] = quantiles(sizes, [0.5, 0.75]);
    let far = FAR * (OF[0] * half).max(OF[1] * most);
    if far <= 0.0 {
        return flags;
    }
    for (volts, flags) in volts().zip(&mut flags) {
        let mut mended = volts.clone();
        for _ in 0..ROUNDS {
            let of = |(by, spread): (f64, f64)| by > far && spread < AGREE * by;
            let ends = std::iter::repeat_n(false, REACH.min(volts.len() / 2));
            let inside = apart(volts, &mended).map(of);
            let next: Vec<bool> = ends.clone().chain(inside).chain(ends).collect();
            if next.len() != volts.len() || next == *flags {
                break;
            }
            mended.clone_from(volts);
            bridge(&mut mended, &next);
            *flags = next;
        }
    }
    flags
}

/// How far each sample, but for those at the ends, is from the middle of its neighbours, and over how much the middle four of these
/// spread.
fn apart<'v>(volts: &'v [f64], near: &'v [f64]) -> impl Iterator<Item = (f64, f64)> + 'v {
    let own = volts.iter().skip(REACH);
    own.zip(near.windows(2 * REACH + 1)).map(|(own, w)| {
        let mut near = [0.0; 2 * REACH];
        near[..REACH].copy_from_slice(&w[..REACH]);
        near[REACH..].copy_from_slice(&w[REACH + 1..]);
        near.sort_unstable_by(f64::total_cmp);
        let middle = 0.5 * (near[REACH - 1] + near[REACH]);
        ((own - middle).abs(), near[REACH + 1] - near[REACH - 2])
    })
}

/// Puts straight lines in the place of what is doubtful.
fn bridge(column: &mut [f64], doubtful: &[bool]) {
    let mut k = 0;
    while k < doubtful.len() {
        if !doubtful[k] {
            k += 1;
            continue;
        }
        // Ends are never doubtful.
        let from = k - 1;
        while doubtful[k] {
            k += 1;
        }
        let (first, last) = (column[from], column[k]);
        for (step, value) in (1..).zip(&mut column[from + 1..k]) {
            *value = first + (last - first) * f64::from(step) / (k - from) as f64;
        }
    }
}
