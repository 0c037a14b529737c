//! Samples of a voltage that drove nothing, single ones and short runs: signs that were turned, values that were lost, words of another
//! channel.
//!
//! A voltage may jump as it likes, and where many samples do none is an outlier by its size. What drove the axis is what its motion
//! answers to: samples apart from their neighbours are set aside where the motion is told better without them. Values that were lost are
//! no noise: a share of them that was written as nothing makes all forces, and with them an inertia, smaller by as much.

use super::{Equations, Friction, Method, Moved, Record, Settings, VOLTAGE};
use crate::Unknown;
use crate::timeline::counted;
use pigtail_numerics::regression::least_squares_alone;
use pigtail_numerics::signal::{quantiles, rms};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

/// Neighbours to either side by which a sample is judged.
const REACH: usize = 3;

/// A sample is doubtful where it is apart from the middle of its neighbours by so many usual deviations...
const FAR: f64 = 6.0;

/// ... and these agree with each other within this share of that.
const AGREE: f64 = 0.5;

/// Of a normal distribution, its deviation over its median and its third quartile.
const OF: [f64; 2] = [1.4826, 0.8696];

/// Equations to either side into which decimation smears a sample.
const SMEARED: usize = 3;

/// Largest share of doubtful samples that is looked at, and that is bridged: of more not all are told, for neighbours are doubtful, too.
/// The second was 0.25 until records with a tenth of their signs turned, of which 8 % were told, had been seen 1.3 to 2.8 % off.
const LOOKED: f64 = 0.25;
const MANY: f64 = 0.06;

/// Deviations by which the motion has to be told better without them. Without samples that did drive it it is told worse.
const SURE: f64 = 3.0;

/// Samples of the longest run that may be one of lost values: what is longer is part of a motion as often.
const LONGEST: usize = 40;

/// Deviations of noise in a difference of two samples, over that of one in its distance from the middle of its neighbours.
const EDGE: f64 = 1.3;

/// Share of a column's samples that are equal to the one before, beyond which equal values say nothing: it is written coarsely.
const COARSE: f64 = 0.05;

/// Share that a lost run leaves less than, once bridged, of what it leaves as it is written, over the equations that it is in.
const FAR_BETTER: f64 = 0.5;

/// From when to when voltages were lost, seconds.
pub(super) type Lost = Vec<[f64; 2]>;

/// The record without samples of its voltage that did not drive the axis, and when whole runs of them were.
///
/// # Errors
///
/// Where they are so many that others may be among those that are believed.
pub(super) fn told<'r>(
    record: &'r Record,
    moved: Option<&Moved>,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> Result<(Cow<'r, Record>, Lost), Unknown> {
    let own;
    let moved = if let Some(moved) = moved {
        moved
    } else {
        own = Moved::of(record, set);
        &own
    };
    let single = without(record, moved, set, remarks)?;
    let (whole, lost) = without_runs(&single, moved, set, remarks)?;
    let mended = match whole {
        Cow::Owned(mended) => Some(mended),
        Cow::Borrowed(_) => None,
    };
    Ok((mended.map_or(single, Cow::Owned), lost))
}

/// The record without runs of its voltage that did not drive the axis, each bridged, and when they were: what moved the axis meanwhile
/// nobody knows.
///
/// # Errors
///
/// Where they are so many that others may be among those that are believed.
fn without_runs<'r>(
    record: &'r Record,
    moved: &Moved,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> Result<(Cow<'r, Record>, Lost), Unknown> {
    let nothing = || Ok((Cow::Borrowed(record), Vec::new()));
    let (runs, written) = runs(record);
    let count = |runs: &[Vec<Range<usize>>]| runs.iter().flatten().map(Range::len).sum::<usize>();
    let share = |runs: &[Vec<Range<usize>>]| count(runs) as f64 / record.even.samples() as f64;
    if count(&runs) == 0 || share(&runs) > LOOKED {
        return nothing();
    }
    let period = record.even.period;
    let time = |stretch: usize, run: &Range<usize>| {
        let at = |k: usize| record.even.stretches[stretch].start + period * k as f64;
        [at(run.start), at(run.end)]
    };
    let mended = |runs: &[Vec<Range<usize>>]| {
        let mut mended = record.clone();
        for (stretch, runs) in mended.even.stretches.iter_mut().zip(runs) {
            let column = &mut stretch.columns[VOLTAGE];
            let mut flags = vec![false; column.len()];
            for run in runs {
                flags[run.clone()].fill(true);
            }
            bridge(column, &flags);
        }
        mended
    };
    let left = |record: &Record| {
        let columns = moved.equations(record, set);
        left(&columns).map(|left| (columns.time, left))
    };
    let Some(((times, before), (_, after))) = left(record).zip(left(&mended(&runs))) else {
        return nothing();
    };
    // A pulse that did drive it is told worse without it, whatever others are, and one that was lost by far better.
    let reach = reach(set, period);
    let told = |[from, to]: [f64; 2]| {
        let first = times.partition_point(|t| *t < from - reach);
        let last = times.partition_point(|t| *t <= to + reach);
        rms(after[first..last].iter().copied())
            < FAR_BETTER * rms(before[first..last].iter().copied())
    };
    let runs: Vec<Vec<Range<usize>>> = runs
        .into_iter()
        .enumerate()
        .map(|(stretch, runs)| {
            let lost = |run: &Range<usize>| told(time(stretch, run));
            runs.into_iter().filter(lost).collect()
        })
        .collect();
    let of_these = mended(&runs);
    let Some((_, after)) = left(&of_these) else {
        return nothing();
    };
    if !surely_less(&before, &after) {
        return nothing();
    }
    let times = runs.iter().map(Vec::len).sum::<usize>();
    // Values that were all written as one are all told.
    if share(&runs) > MANY && written.is_none() {
        return Err(Unknown::all(format!(
            "{:.0} % of the voltages, in {times} runs, are apart from those around and drove nothing, and there will be others that are \
             not told: were signs turned, or values lost?",
            100.0 * share(&runs)
        )));
    }
    remarks.push(format!(
        "{} of the voltage in {}, {:.2} % of all, {}drove nothing: the motion is told better without them, and the equations around them \
         were left out",
        counted(count(&runs), "sample"),
        counted(times, "run"),
        100.0 * share(&runs),
        written.map_or_else(
            || "apart from those around, ".to_owned(),
            |value| format!("written as {value} V, ")
        )
    ));
    let lost = runs
        .iter()
        .enumerate()
        .flat_map(|(stretch, runs)| runs.iter().map(move |run| time(stretch, run)))
        .collect();
    Ok((Cow::Owned(of_these), lost))
}

/// How far decimation smears a sample, seconds.
fn reach(set: &Settings, period: f64) -> f64 {
    (SMEARED * set.factor(period)) as f64 * period
}

/// Which equations no lost voltage is in; `None` where all.
pub(super) fn untouched(
    columns: &Equations,
    lost: &Lost,
    set: &Settings,
    period: f64,
) -> Option<Vec<bool>> {
    let reach = reach(set, period);
    let touched = |t: f64| {
        let near = |[from, to]: &[f64; 2]| (from - reach..=to + reach).contains(&t);
        lost.iter().any(near)
    };
    let keep: Vec<bool> = columns.time.iter().map(|t| !touched(*t)).collect();
    keep.contains(&false).then_some(keep)
}

/// Runs of each stretch that a voltage jumps into and back from, and the value as which lost ones were written, where it was one. All of
/// that value are then lost, also where the voltage around is near it.
fn runs(record: &Record) -> (Vec<Vec<Range<usize>>>, Option<f64>) {
    let volts = || {
        record
            .even
            .stretches
            .iter()
            .map(|s| &s.columns[VOLTAGE][..])
    };
    let steps: Vec<f64> = volts()
        .flat_map(|v| v.windows(2).map(|w| (w[1] - w[0]).abs()))
        .collect();
    if steps.is_empty() {
        return (Vec::new(), None);
    }
    let [half, most] = quantiles(steps.clone(), [0.5, 0.75]);
    let far = FAR * EDGE * (OF[0] * half).max(OF[1] * most);
    let found: Vec<Vec<Range<usize>>> = volts().map(|v| jumped(v, far)).collect();
    let mut values = BTreeMap::new();
    let mut all = 0;
    for (volts, runs) in volts().zip(&found) {
        for run in runs {
            all += run.len();
            for k in run.clone() {
                *values.entry(volts[k].to_bits()).or_insert(0) += 1;
            }
        }
    }
    let often = values.into_iter().max_by_key(|(_, n)| *n);
    let written = often
        .filter(|(_, n)| 2 * n > all && all > 3 && found.iter().map(Vec::len).sum::<usize>() > 1)
        .map(|(bits, _)| f64::from_bits(bits));
    // Where other values repeat as well, as of a coarse converter, not all of that one are lost.
    let coarse = |value: f64| {
        let repeats = |v: &[f64]| {
            let pairs = v.windows(2);
            pairs.filter(|w| w[0] == w[1] && w[0] != value).count()
        };
        volts().map(repeats).sum::<usize>() as f64 > COARSE * steps.len() as f64
    };
    let Some(value) = written.filter(|value| !coarse(*value)) else {
        return (found, None);
    };
    let with = volts().zip(found).map(|(volts, found)| {
        let mut flags = vec![false; volts.len()];
        for run in found {
            flags[run].fill(true);
        }
        let next = |k: usize| volts[k] == value && volts[k + 1] == value;
        for k in (1..volts.len().saturating_sub(2)).filter(|k| next(*k)) {
            flags[k..k + 2].fill(true);
        }
        flagged(&flags)
    });
    (with.collect(), Some(value))
}

/// Runs of what is flagged.
fn flagged(flags: &[bool]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for k in (0..flags.len()).filter(|k| flags[*k]) {
        match runs.last_mut() {
            Some(last) if last.end == k => last.end = k + 1,
            _ => runs.push(k..k + 1),
        }
    }
    runs
}

/// Runs into which a column jumps by more than `far`, and from which it jumps back to where it was.
fn jumped(volts: &[f64], far: f64) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    if far <= 0.0 || volts.len() < 2 * REACH + 2 {
        return runs;
    }
    let middle = |w: &[f64]| {
        let mut w = [w[0], w[1], w[2]];
        w.sort_unstable_by(f64::total_cmp);
        w[1]
    };
    let mut k = REACH;
    while k + REACH < volts.len() {
        let into = volts[k] - volts[k - 1];
        if into.abs() <= far {
            k += 1;
            continue;
        }
        let last = (k + LONGEST).min(volts.len() - REACH);
        let before = middle(&volts[k - REACH..k]);
        let end = (k + 1..=last).find(|end| {
            let back = volts[*end] - volts[end - 1];
            let behind = middle(&volts[*end..end + REACH]);
            back.abs() > far
                && back.signum() != into.signum()
                && (behind - before).abs() < AGREE * into.abs().min(back.abs())
        });
        match end {
            Some(end) => {
                runs.push(k..end);
                k = end + 1;
            }
            None => k += 1,
        }
    }
    runs
}

/// The record without single samples of its voltage that did not drive the axis, each bridged.
///
/// # Errors
///
/// Where they are so many that others may be among those that are believed.
fn without<'r>(
    record: &'r Record,
    moved: &Moved,
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
    let left = |record: &Record| left(&moved.equations(record, set));
    let Some((before, after)) = left(record).zip(left(&mended)) else {
        return Ok(Cow::Borrowed(record));
    };
    if !surely_less(&before, &after) {
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

/// Whether equations leave less after than before, beyond what chance makes of them.
fn surely_less(before: &[f64], after: &[f64]) -> bool {
    let (mut less, mut squares) = (0.0, 0.0);
    for (a, b) in before.iter().zip(after) {
        let by = a * a - b * b;
        less += by;
        squares += by * by;
    }
    less > SURE * squares.sqrt()
}

fn left(columns: &Equations) -> Option<Vec<f64>> {
    let x = columns.matrix(Friction::Asymmetric, Method::LeastSquares);
    Some(least_squares_alone(&x, &columns.force)?.residuals)
}

/// Which samples of each stretch are apart from neighbours that agree with each other; where some are, of the others by what these are
/// bridged to: neighbours may be doubtful themselves.
fn doubtful(record: &Record) -> Vec<Vec<bool>> {
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
