//! From the moments at which a record was read to samples at equal distances.

mod grid;

use grid::{Grid, peak};
use pigtail_numerics::signal::quantile;

/// What a record's moments turned out to be, and its columns on an even grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Even {
    /// Time between samples, seconds: the mean where none is missing.
    pub period: f64,
    /// Stretches without a gap.
    pub stretches: Vec<Stretch>,
    /// Root mean square deviation of a moment from the even grid, in periods.
    pub jitter: f64,
    /// Gaps too long to be bridged.
    pub gaps: usize,
    /// Rows that were missing and have been bridged, or had no value.
    pub bridged: usize,
    /// Rows that say again what the row before them says; left out.
    pub twice: usize,
    /// Whether columns had to be interpolated.
    pub interpolated: bool,
    /// Which clock the samples were taken by.
    pub clock: Clock,
}

/// Which clock a record's samples were taken by, as their own smoothness tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Even stamps: there is nothing to tell.
    Even,
    /// The stamps deviate and the samples were taken when they say.
    Stamps,
    /// The stamps deviate, the samples do not: they were taken evenly and stamped unevenly.
    Nominal,
    /// The stamps are coarser than the samples are apart, which were taken evenly.
    Coarse,
    /// The record does not tell: what the stamps are off by is lost in its noise. Taken as even.
    Untold,
}

/// A stretch of a record without a gap.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The first sample's moment, seconds.
    pub start: f64,
    /// The columns.
    pub columns: Vec<Vec<f64>>,
}

/// So many of something, in words.
pub fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// A record that has no even grid.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Uneven {
    /// Fewer than two rows with a value in every column.
    #[error("has {} with a value in every column", counted(*.0, "row"))]
    TooShort(usize),
    /// Time does not rise.
    #[error("time {after} s comes after {before} s in data row {row}")]
    Falls {
        /// The row, from one.
        row: usize,
        /// The time before, seconds.
        before: f64,
        /// The time in it, seconds.
        after: f64,
    },
}

/// Moments that deviate by less than this share of a period, rms, count as even.
const EVEN: f64 = 0.02;

/// Least certainty of the share of a stamp's deviation at which its sample was taken late too, for that to be told.
const TOLD: f64 = 0.2;

/// Brings columns to an even grid. Rows in which a column has no value (NaN) are left out, rows that are there
/// twice too; what is missing for at most five periods is bridged by straight lines, at longer gaps the record is cut.
///
/// A stamp that deviates may belong to a sample that was taken late, or to one that was only written down late. The
/// first column, which moves smoothly, tells which: beside its neighbours a sample that was taken late lies off by
/// its lateness times the speed.
///
/// # Errors
///
/// When time does not rise, or next to nothing is there.
pub fn even(time: &[f64], columns: &[&[f64]]) -> Result<Even, Uneven> {
    let Grid {
        kept,
        twice,
        coarse,
        period,
        gaps,
        parts,
        places,
        clocks,
    } = Grid::of(time, columns)?;
    let unusable = time.len() - twice - kept.len();
    let column = columns.first().copied().unwrap_or(time);
    let rows: usize = parts.iter().map(ExactSizeIterator::len).sum();
    // Every stretch weighs as its length.
    let step = |i: usize| {
        if parts[i].len() > 20 {
            clocks[i].1
        } else {
            period
        }
    };
    let own = (0..parts.len())
        .map(|i| step(i) * parts[i].len() as f64)
        .sum::<f64>()
        / rows as f64;
    let near = (own / period - 1.0).abs() < 0.2;
    let guess = period;
    let period = if near { own } else { period };
    let mut late = vec![0.0; kept.len()];
    for (part, (start, step)) in parts.iter().zip(&clocks) {
        let step = if part.len() > 20 { *step } else { guess };
        for k in part.clone() {
            late[k] = (time[kept[k]] - start - step * places[k] as f64) / period;
        }
    }
    let squares: f64 = late.iter().map(|l| l * l).sum();
    let jitter = (squares / rows as f64).sqrt();
    let mut bridged = unusable;
    for part in &parts {
        for k in part.start + 1..part.end {
            if kept[k] == kept[k - 1] + 1 {
                bridged += places[k] - places[k - 1] - 1;
            }
        }
    }
    let clock = if coarse {
        Clock::Coarse
    } else if jitter <= EVEN && peak(&late) <= 5.0 * EVEN {
        Clock::Even
    } else {
        told(column, &kept, &places, &parts, &late)
    };
    let stretches = parts
        .iter()
        .zip(&clocks)
        .map(|(part, (start, _))| {
            let rows = &kept[part.clone()];
            let believed = clock == Clock::Stamps;
            let on = |column: &&[f64]| {
                if believed {
                    on_stamps(time, column, rows, period)
                } else {
                    on_places(column, rows, &places[part.clone()])
                }
            };
            Stretch {
                start: if believed || part.len() <= 20 {
                    time[rows[0]]
                } else {
                    *start
                },
                columns: columns.iter().map(on).collect(),
            }
        })
        .collect();
    Ok(Even {
        period,
        stretches,
        jitter,
        gaps,
        bridged,
        twice,
        interpolated: clock == Clock::Stamps || bridged > 0,
        clock,
    })
}

/// The moments at which rows were taken, where a smooth column tells that it was evenly while they were stamped unevenly, and a
/// remark on it.
pub fn taken(time: &[f64], column: &[f64]) -> Option<(Vec<f64>, String)> {
    let even = even(time, &[column]).ok()?;
    if !matches!(even.clock, Clock::Nominal | Clock::Coarse) {
        return None;
    }
    let grid = Grid::of(time, &[column]).ok()?;
    let on_grids: usize = grid.parts.iter().map(ExactSizeIterator::len).sum();
    if on_grids < time.len() {
        return None;
    }
    let clocks = grid.parts.iter().zip(&grid.clocks);
    let moments = clocks
        .flat_map(|(part, (start, step))| {
            grid.places[part.clone()]
                .iter()
                .map(move |place| start + step * *place as f64)
        })
        .collect();
    Some((moments, even.remarks().pop()?))
}

/// Which clock the samples were taken by: a column's miss of the curve through its neighbours, beside what its
/// stamp's deviation times its speed would have it miss.
fn told(
    column: &[f64],
    kept: &[usize],
    places: &[usize],
    parts: &[std::ops::Range<usize>],
    late: &[f64],
) -> Clock {
    let miss = |v: [f64; 5]| v[2] - (4.0 * (v[1] + v[3]) - (v[0] + v[4])) / 6.0;
    let (mut pairs, mut sizes) = (Vec::new(), Vec::new());
    for part in parts {
        for k in part.start + 2..part.end.saturating_sub(2) {
            if places[k + 2] - places[k - 2] != 4 {
                continue;
            }
            let value = |i: usize| column[kept[i]];
            let window = [k - 2, k - 1, k, k + 1, k + 2];
            // Each sample's own speed, by neighbours whose deviations are known no better: first order is enough.
            let speed = |i: usize| {
                0.5 * (value((i + 1).min(part.end - 1))
                    - value(i.saturating_sub(1).max(part.start)))
            };
            let expected = miss(window.map(|i| late[i] * speed(i)));
            let is = miss(window.map(value));
            pairs.push((expected, is));
            sizes.push(is.abs());
        }
    }
    // A spike tells nothing of clocks.
    let far = 30.0 * quantile(&sizes, 0.9);
    pairs.retain(|(_, is)| is.abs() <= far);
    let (mut ee, mut ei) = (0.0, 0.0);
    for (expected, is) in &pairs {
        ee += expected * expected;
        ei += expected * is;
    }
    if ee <= 0.0 || pairs.len() < 20 {
        return Clock::Untold;
    }
    let share = ei / ee;
    let left: f64 = pairs.iter().map(|(e, i)| (i - share * e).powi(2)).sum();
    let sure = (left / pairs.len() as f64 / ee).sqrt();
    if sure > TOLD {
        Clock::Untold
    } else if share > 0.5 {
        Clock::Stamps
    } else {
        Clock::Nominal
    }
}

/// A column on the grid, its samples taken as of their moments: the cubic through four of them.
fn on_stamps(time: &[f64], column: &[f64], rows: &[usize], period: f64) -> Vec<f64> {
    let start = time[rows[0]];
    let last = time[rows[rows.len() - 1]];
    let n = ((last - start) / period + 1e-6) as usize + 1;
    let mut at = 0;
    (0..n)
        .map(|k| {
            let moment = start + k as f64 * period;
            while at + 2 < rows.len() && time[rows[at + 1]] < moment {
                at += 1;
            }
            let straight = |a: usize, b: usize| {
                let share = ((moment - time[a]) / (time[b] - time[a])).clamp(0.0, 1.0);
                column[a] + share * (column[b] - column[a])
            };
            let line = straight(rows[at], rows[at + 1]);
            if at == 0 || at + 2 >= rows.len() {
                return line;
            }
            let near = &rows[at - 1..at + 3];
            let steps = near.windows(2).map(|w| time[w[1]] - time[w[0]]);
            let (least, most) =
                steps.fold((f64::INFINITY, 0.0_f64), |(l, m), s| (l.min(s), m.max(s)));
            if least < 0.05 * period || most > 2.5 * period {
                return line;
            }
            near.iter()
                .map(|i| {
                    let others = near.iter().filter(|j| *j != i);
                    column[*i]
                        * others
                            .map(|j| (moment - time[*j]) / (time[*i] - time[*j]))
                            .product::<f64>()
                })
                .sum()
        })
        .collect()
}

/// A column on the grid, its samples taken as of their places on it; straight lines between them.
fn on_places(column: &[f64], rows: &[usize], places: &[usize]) -> Vec<f64> {
    let first = places[0];
    let mut values = Vec::with_capacity(places[places.len() - 1] - first + 1);
    values.push(column[rows[0]]);
    for (w, p) in rows.windows(2).zip(places.windows(2)) {
        let (a, b, n) = (column[w[0]], column[w[1]], p[1] - p[0]);
        values.extend((1..=n).map(|k| a + (b - a) * k as f64 / n as f64));
    }
    values
}

impl Even {
    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.stretches
            .iter()
            .map(|s| s.columns.first().map_or(0, Vec::len))
            .sum()
    }

    /// What had to be done to the record, for whoever brought it; empty for an even record.
    pub fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if self.bridged > 0 {
            let n = self.bridged;
            remarks.push(format!(
                "{} bridged by straight lines",
                counted(n, "missing sample")
            ));
        }
        if self.gaps > 0 {
            let n = self.gaps;
            remarks.push(format!(
                "cut at {} longer than five sample periods",
                counted(n, "gap")
            ));
        }
        if self.twice > 0 {
            remarks.push(format!(
                "{} there twice; one of each was taken",
                if self.twice == 1 {
                    "1 row is".to_owned()
                } else {
                    format!("{} rows are", self.twice)
                }
            ));
        }
        let taken = match self.clock {
            Clock::Even => return remarks,
            Clock::Stamps => {
                "the samples were taken when they say, and were brought to an even grid"
            }
            Clock::Nominal => {
                "the motion is smoother without them: the samples were taken evenly and stamped late"
            }
            Clock::Coarse => "the stamps are coarser than the samples, which were taken as even",
            Clock::Untold => {
                "that is lost in the noise of the position, and the samples were taken as even"
            }
        };
        remarks.push(format!(
            "moments deviate by {:.0} % of a sample period from even ones; {taken}",
            100.0 * self.jitter
        ));
        remarks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_record_is_left_as_it_is() {
        let time: Vec<f64> = (0..100).map(|k| 0.001 * f64::from(k)).collect();
        let x: Vec<f64> = time.iter().map(|t| t.sin()).collect();
        let even = even(&time, &[&x]).unwrap();
        assert_eq!(even.stretches[0].columns[0], x);
        assert!(even.remarks().is_empty());
    }

    #[test]
    fn holes_are_bridged_and_gaps_cut() {
        let time: Vec<f64> = (0..300)
            .filter(|k| !(100..102).contains(k) && !(200..230).contains(k))
            .map(|k| 0.01 * f64::from(k))
            .collect();
        let mut x: Vec<f64> = time.iter().map(|t| 2.0 * t).collect();
        x[50] = f64::NAN;
        let even = even(&time, &[&x]).unwrap();
        assert_eq!((even.gaps, even.stretches.len(), even.bridged), (1, 2, 3));
        assert_eq!(even.samples(), 200 + 70);
        for stretch in &even.stretches {
            for (k, x) in stretch.columns[0].iter().enumerate() {
                let exact = 2.0 * (stretch.start + 0.01 * k as f64);
                assert!((x - exact).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn jitter_is_measured_and_time_that_falls_is_refused() {
        let wobble = |k: i32| 0.2 * (f64::from((k * 7919) % 100) / 50.0 - 1.0);
        let time: Vec<f64> = (0..2000)
            .map(|k| 0.01 * (f64::from(k) + wobble(k)))
            .collect();
        let even_one = even(&time, &[&time]).unwrap();
        assert!(
            (even_one.jitter - 0.115).abs() < 0.03,
            "{}",
            even_one.jitter
        );
        assert_eq!(even_one.clock, Clock::Stamps);
        let sampled_evenly: Vec<f64> = (0..2000).map(|k| (0.01 * f64::from(k)).sin()).collect();
        assert_eq!(
            even(&time, &[&sampled_evenly]).unwrap().clock,
            Clock::Nominal
        );
        let falls = even(&[0.0, 1.0, 0.5], &[&[1.0, 1.0, 1.0]]);
        assert!(matches!(falls, Err(Uneven::Falls { row: 3, .. })));
    }
}
