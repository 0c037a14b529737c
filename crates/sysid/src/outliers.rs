//! Samples that no motion makes: spikes, dropouts, steps of a counter that slipped.
//!
//! A motion that is sampled fast enough is smooth: each sample lies near the cubic through its neighbours. One that
//! does not was read wrongly, and its neighbours tell what it should have been.

use crate::timeline::{Even, Stretch, counted};
use pigtail_numerics::signal::quantiles;
use std::ops::{Range, RangeInclusive};

/// What was set aside of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SetAside {
    /// Samples replaced by what their neighbours tell.
    pub spikes: usize,
    /// Places where the column steps as no motion does; the record was cut there.
    pub steps: usize,
}

/// A sample misses by so many of the usual misses.
const FAR: f64 = 12.0;

/// And by so much of a fast sample's way: friction that turns round is no spike.
const OF_WAY: f64 = 0.03;

/// Longest run of bad samples that is bridged.
const LONGEST: usize = 12;

/// Most places at which a column may step: where there are more, rows are missing that no stamp shows, or a counter loses counts.
pub const MOST_STEPS: usize = 8;

/// A step tells a column so many times better than a bad sample does, by the largest miss. A choice, after small spikes had been taken for steps.
const CLEARLY: f64 = 2.0;

/// Share of a column's samples beyond which misses are its noise, not spikes.
const MANY: f64 = 0.03;

fn miss(w: &[f64]) -> f64 {
    w[2] - (4.0 * (w[1] + w[3]) - (w[0] + w[4])) / 6.0
}

/// How far a smooth column may miss the curve through its neighbours.
fn limit<'a>(columns: impl Iterator<Item = &'a [f64]> + Clone) -> f64 {
    let misses: Vec<f64> = columns
        .clone()
        .flat_map(|c| c.windows(5).map(|w| miss(w).abs()))
        .collect();
    let [median, most] = quantiles(misses, [0.5, 0.95]);
    let usual = (1.4826 * median).max(0.5 * most);
    let steps: Vec<f64> = columns
        .flat_map(|c| c.windows(2).map(|w| (w[1] - w[0]).abs()))
        .collect();
    let [fast] = quantiles(steps, [0.99]);
    FAR * usual + OF_WAY * fast
}

/// Sets aside what no motion makes in a column of smooth motion, in all stretches of a record. What is there is
/// replaced by what its neighbours tell; at a step that stays the record is cut.
pub fn smooth(even: &mut Even, column: usize) -> SetAside {
    let most = limit(even.stretches.iter().map(|s| &s.columns[column][..]));
    let samples = even.samples();
    let bad = |s: &Stretch| {
        s.columns[column]
            .windows(5)
            .filter(|w| miss(w).abs() > most)
            .count()
    };
    let all: usize = even.stretches.iter().map(bad).sum();
    let mut aside = SetAside::default();
    if all == 0 || most <= 0.0 || all as f64 > MANY * samples as f64 {
        return aside;
    }
    let mut whole = Vec::new();
    for mut stretch in std::mem::take(&mut even.stretches) {
        let cuts = mend(&mut stretch.columns[column], most, &mut aside);
        let n = stretch.columns[column].len();
        let mut from = 0;
        for cut in cuts.into_iter().chain(std::iter::once(n..n)) {
            if cut.start > from + 1 {
                whole.push(Stretch {
                    start: stretch.start + even.period * from as f64,
                    columns: stretch
                        .columns
                        .iter()
                        .map(|c| c[from..cut.start].to_vec())
                        .collect(),
                });
            }
            from = cut.end;
        }
    }
    even.stretches = whole;
    aside
}

/// Mends a column; where it cannot be, the ranges that are to be cut out.
fn mend(column: &mut [f64], most: f64, aside: &mut SetAside) -> Vec<Range<usize>> {
    let n = column.len();
    let far: Vec<usize> = (2..n.saturating_sub(2))
        .filter(|k| miss(&column[k - 2..k + 3]).abs() > most)
        .collect();
    let mut clusters: Vec<Range<usize>> = Vec::new();
    for k in far {
        match clusters.last_mut() {
            Some(last) if k <= last.end + LONGEST + 2 => last.end = k + 1,
            _ => clusters.push(k..k + 1),
        }
    }
    let mut cuts = Vec::new();
    for cluster in clusters {
        // A step spread over some samples is smooth too: whether it is one is asked before longer runs are bridged.
        let mended = match (
            bridge(column, &cluster, most, 1..=1),
            step(column, &cluster, most),
        ) {
            // A bridge over a small step is nearly smooth: it is a step where that leaves much less. Where noise decides, it is a bad sample.
            (Some(one), Some((_, left))) if one.left <= CLEARLY * left => Ok(one),
            (_, Some((cut, _))) => Err(cut..cut),
            (Some(one), None) => Ok(one),
            (None, None) => bridge(column, &cluster, most, 2..=LONGEST)
                .ok_or(cluster.start.saturating_sub(2)..(cluster.end + 2).min(n)),
        };
        match mended {
            Ok(Bridge { run, values, .. }) => {
                aside.spikes += run.len();
                column[run].copy_from_slice(&values);
            }
            Err(cut) => {
                aside.steps += 1;
                cuts.push(cut);
            }
        }
    }
    cuts
}

/// Largest miss of a column.
fn largest(column: &[f64]) -> f64 {
    column.windows(5).map(|w| miss(w).abs()).fold(0.0, f64::max)
}

/// A run of samples, what they should have been, and the largest miss that leaves around.
struct Bridge {
    run: Range<usize>,
    values: Vec<f64>,
    left: f64,
}

/// The shortest run in a cluster without which the column is smooth, and what it should have been.
fn bridge(
    column: &[f64],
    cluster: &Range<usize>,
    most: f64,
    lengths: RangeInclusive<usize>,
) -> Option<Bridge> {
    let n = column.len();
    let (low, high) = (
        cluster.start.saturating_sub(2).max(2),
        (cluster.end + 2).min(n.saturating_sub(2)),
    );
    for length in lengths.filter(|l| low + l <= high) {
        for start in low..=high - length {
            let end = start + length;
            let x: [f64; 4] = [-2.0, -1.0, length as f64, length as f64 + 1.0];
            let y = [
                column[start - 2],
                column[start - 1],
                column[end],
                column[end + 1],
            ];
            let at = |t: f64| -> f64 {
                (0..4)
                    .map(|i| {
                        let others = (0..4).filter(|j| *j != i);
                        y[i] * others.map(|j| (t - x[j]) / (x[i] - x[j])).product::<f64>()
                    })
                    .sum()
            };
            let values: Vec<f64> = (0..length).map(|k| at(k as f64)).collect();
            let from = low.saturating_sub(4);
            let to = (high + 4).min(n);
            let mut window = column[from..to].to_vec();
            window[start - from..end - from].copy_from_slice(&values);
            // A curve over a long run is not as near as one through neighbours.
            let room = most * (1.0 + 0.5 * length as f64);
            let left = largest(&window);
            if left <= room {
                let run = start..end;
                return Some(Bridge { run, values, left });
            }
        }
    }
    None
}

/// Where a column steps in a cluster, smooth before and behind, and the largest miss there.
fn step(column: &[f64], cluster: &Range<usize>, most: f64) -> Option<(usize, f64)> {
    let n = column.len();
    let (low, high) = (cluster.start.saturating_sub(6), (cluster.end + 6).min(n));
    let left = |cut: usize| largest(&column[low..cut]).max(largest(&column[cut..high]));
    (cluster.start..=cluster.end)
        .map(|cut| (cut, left(cut)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .filter(|(_, left)| *left <= most)
}

/// Sets aside single samples of a column that may jump, such as a voltage: those whose neighbours agree with each
/// other and not with them.
pub fn jumping(even: &mut Even, column: usize) -> usize {
    let [often, seldom] = quantiles(off_neighbours(even, column), [0.9, 0.99]);
    single(even, column, (FAR * often).max(2.0 * seldom))
}

/// The same of a column that is followed slowly, such as a torque, in which a sample that stands alone means nothing: nothing of one of which
/// many do.
pub fn alone(even: &mut Even, column: usize) -> usize {
    let sizes = off_neighbours(even, column);
    let [often] = quantiles(sizes.clone(), [0.9]);
    let far = sizes.iter().filter(|s| **s > FAR * often).count();
    // Each one shows at its neighbours, too.
    if far as f64 > 3.0 * MANY * sizes.len() as f64 {
        return 0;
    }
    single(even, column, FAR * often)
}

/// How far a sample is from the middle of its neighbours.
fn off(w: &[f64]) -> f64 {
    w[1] - 0.5 * (w[0] + w[2])
}

fn off_neighbours(even: &Even, column: usize) -> Vec<f64> {
    let stretches = even.stretches.iter();
    stretches
        .flat_map(|s| s.columns[column].windows(3).map(|w| off(w).abs()))
        .collect()
}

fn single(even: &mut Even, column: usize, most: f64) -> usize {
    let mut aside = 0;
    if most <= 0.0 {
        return 0;
    }
    for stretch in &mut even.stretches {
        let column = &mut stretch.columns[column];
        for k in 1..column.len().saturating_sub(1) {
            let by = off(&column[k - 1..k + 2]);
            if by.abs() > most && (column[k + 1] - column[k - 1]).abs() < 0.3 * by.abs() {
                column[k] = 0.5 * (column[k - 1] + column[k + 1]);
                aside += 1;
            }
        }
    }
    aside
}

impl SetAside {
    /// What was done, for whoever brought the record.
    pub fn remarks(&self, what: &str) -> Vec<String> {
        let mut remarks = Vec::new();
        if self.spikes > 0 {
            remarks.push(format!(
                "{} of the {what}, apart as no motion makes them, set aside and bridged",
                counted(self.spikes, "sample")
            ));
        }
        if self.steps > 0 {
            remarks.push(format!(
                "the {what} jumps as no motion does at {}: the record was cut there",
                counted(self.steps, "place")
            ));
        }
        remarks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timeline::even;

    fn motion() -> (Vec<f64>, Vec<f64>) {
        let time: Vec<f64> = (0..4000).map(|k| 0.001 * f64::from(k)).collect();
        let noise = |k: usize| 1e-6 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0);
        let place = time
            .iter()
            .enumerate()
            .map(|(k, t)| 0.1 * (3.0 * t).sin() + noise(k))
            .collect();
        (time, place)
    }

    #[test]
    fn spikes_are_bridged_and_steps_cut() {
        let (time, good) = motion();
        let mut bad = good.clone();
        bad[1000] += 1e-3;
        for x in &mut bad[2000..2005] {
            *x = 0.0;
        }
        for x in &mut bad[3000..] {
            *x += 5e-4;
        }
        // Spread over one sample this would be nearly smooth.
        for x in &mut bad[3500..] {
            *x += 8e-5;
        }
        let mut record = even(&time, &[&bad]).unwrap();
        let aside = smooth(&mut record, 0);
        assert_eq!(
            (aside.spikes, aside.steps, record.stretches.len()),
            (6, 2, 3)
        );
        for (k, x) in record.stretches[0].columns[0].iter().enumerate() {
            assert!((x - good[k]).abs() < 1e-5, "{k}: {x} for {}", good[k]);
        }
        assert_eq!(record.stretches[0].columns[0].len(), 3000);
    }

    #[test]
    fn nothing_is_set_aside_of_what_is_smooth() {
        let (time, good) = motion();
        let mut record = even(&time, &[&good]).unwrap();
        let before = record.clone();
        assert_eq!(smooth(&mut record, 0), SetAside::default());
        assert_eq!(record, before);
    }
}
