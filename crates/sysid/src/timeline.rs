//! From the moments at which a record was read to samples at equal distances.

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
    /// Whether columns had to be interpolated.
    pub interpolated: bool,
    /// Whether samples that are stamped unevenly were taken so: else they are even and the stamps are not.
    pub stamps_believed: bool,
}

/// A stretch of a record without a gap.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The first sample's moment, seconds.
    pub start: f64,
    /// The columns.
    pub columns: Vec<Vec<f64>>,
}

/// A record that has no even grid.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Uneven {
    /// Fewer than two rows with a value in every column.
    #[error("has {0} rows with a value in every column")]
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

/// Gaps of at most so many periods are bridged by a straight line.
const BRIDGE: f64 = 5.5;

/// Moments that deviate by less than this share of a period, rms, count as even.
const EVEN: f64 = 0.02;

/// Brings columns to an even grid. Rows in which a column has no value (NaN) are left out; what is
/// missing for at most five periods is bridged by straight lines, at longer gaps the record is cut.
///
/// # Errors
///
/// When time does not rise, or next to nothing is there.
pub fn even(time: &[f64], columns: &[&[f64]]) -> Result<Even, Uneven> {
    let whole = |k: &usize| columns.iter().all(|c| c[*k].is_finite()) && time[*k].is_finite();
    let kept: Vec<usize> = (0..time.len()).filter(whole).collect();
    if kept.len() < 2 {
        return Err(Uneven::TooShort(kept.len()));
    }
    for w in kept.windows(2) {
        if time[w[1]] <= time[w[0]] {
            return Err(Uneven::Falls {
                row: w[1] + 1,
                before: time[w[0]],
                after: time[w[1]],
            });
        }
    }
    let steps: Vec<f64> = kept.windows(2).map(|w| time[w[1]] - time[w[0]]).collect();
    let median = pigtail_numerics::signal::quantile(&steps, 0.5);
    let singles = || steps.iter().filter(|s| **s < 1.5 * median);
    let period = singles().sum::<f64>() / singles().count().max(1) as f64;
    let mut even = Even {
        period,
        stretches: Vec::new(),
        jitter: 0.0,
        gaps: 0,
        bridged: time.len() - kept.len(),
        interpolated: false,
        stamps_believed: true,
    };
    // The place of each sample on the grid: a moment that is late is followed by a short step.
    let mut places = vec![0_usize; kept.len()];
    let (mut from, mut late, mut jitter) = (0, 0.0, 0.0);
    let mut parts = Vec::new();
    for (k, step) in steps.iter().enumerate() {
        if *step > BRIDGE * period {
            parts.push(from..k + 1);
            from = k + 1;
            late = 0.0;
            even.gaps += 1;
            continue;
        }
        let way = step / period + late;
        let whole = way.round().max(1.0);
        late = 0.9 * (way - whole);
        jitter += (step / period - whole).powi(2);
        places[k + 1] = places[k] + whole as usize;
        if kept[k + 1] == kept[k] + 1 {
            even.bridged += whole as usize - 1;
        }
    }
    parts.push(from..kept.len());
    // A moment's deviation shows in two steps.
    even.jitter = (0.5 * jitter / steps.len() as f64).sqrt();
    even.interpolated = even.jitter > EVEN || even.bridged > 0;
    if even.jitter > EVEN {
        // Either the samples were taken at odd moments, or their stamps are odd: a motion is smooth on
        // the grid that it was sampled on.
        even.stamps_believed = {
            let column = columns.first().copied().unwrap_or(time);
            let (mut stamped, mut counted) = (0.0, 0.0);
            for part in &parts {
                let rows = &kept[part.clone()];
                if rows.len() > 5 {
                    stamped += roughness(&on_stamps(time, column, rows, period));
                    counted += roughness(&on_places(column, rows, &places[part.clone()]));
                }
            }
            stamped < counted
        };
    }
    for part in parts {
        let rows = &kept[part.clone()];
        if rows.len() < 2 {
            continue;
        }
        let start = time[rows[0]];
        let columns = columns
            .iter()
            .map(|column| {
                if even.jitter > EVEN && even.stamps_believed {
                    on_stamps(time, column, rows, period)
                } else {
                    on_places(column, rows, &places[part.clone()])
                }
            })
            .collect();
        even.stretches.push(Stretch { start, columns });
    }
    Ok(even)
}

/// How far samples lie from the cubic through their neighbours, squared and summed.
fn roughness(column: &[f64]) -> f64 {
    column
        .windows(5)
        .map(|w| (w[2] - (4.0 * (w[1] + w[3]) - (w[0] + w[4])) / 6.0).powi(2))
        .sum()
}

/// A column on the grid, its samples taken as of their moments.
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
            let (a, b) = (rows[at], rows[at + 1]);
            let share = ((moment - time[a]) / (time[b] - time[a])).clamp(0.0, 1.0);
            column[a] + share * (column[b] - column[a])
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
            remarks.push(format!("{n} missing samples bridged by straight lines"));
        }
        if self.gaps > 0 {
            let n = self.gaps;
            remarks.push(format!("cut at {n} gaps longer than five sample periods"));
        }
        if self.jitter > EVEN {
            remarks.push(format!(
                "moments deviate by {:.0} % of a sample period from even ones; {}",
                100.0 * self.jitter,
                if self.stamps_believed {
                    "the samples were brought to an even grid"
                } else {
                    "the motion is smoother without them, so the samples were taken as even"
                }
            ));
        }
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
        assert!(even_one.stamps_believed);
        let sampled_evenly: Vec<f64> = (0..2000).map(|k| (0.01 * f64::from(k)).sin()).collect();
        assert!(!even(&time, &[&sampled_evenly]).unwrap().stamps_believed);
        let falls = even(&[0.0, 1.0, 0.5], &[&[1.0, 1.0, 1.0]]);
        assert!(matches!(falls, Err(Uneven::Falls { row: 3, .. })));
    }
}
