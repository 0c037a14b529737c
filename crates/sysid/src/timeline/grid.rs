//! Where the rows of a record lie on even grids: what is left out, what is bridged, how far samples are apart.

use super::Uneven;
use pigtail_numerics::signal::quantile;
use std::f64::consts::TAU;

/// Gaps of at most so many periods are bridged by a straight line.
const BRIDGE: f64 = 5.5;

/// Rows on either side by whose stamps the phase of the grid is told.
const SIDE: usize = 40;

/// Share of rows of one stamp with the row before beyond which stamps are coarser than samples.
const SAME_STAMP: f64 = 0.1;

/// Where a record's rows lie on even grids.
pub(super) struct Grid {
    /// The rows that are used.
    pub(super) kept: Vec<usize>,
    pub(super) twice: usize,
    /// Whether stamps are coarser than samples are apart.
    pub(super) coarse: bool,
    /// First guess of the time between samples, seconds.
    pub(super) period: f64,
    pub(super) gaps: usize,
    /// Stretches, as rows of `kept`.
    pub(super) parts: Vec<std::ops::Range<usize>>,
    /// The place of each row on the grid of its stretch.
    pub(super) places: Vec<usize>,
    /// Start and step of each stretch's grid, seconds.
    pub(super) clocks: Vec<(f64, f64)>,
}

impl Grid {
    pub(super) fn of(time: &[f64], columns: &[&[f64]]) -> Result<Self, Uneven> {
        let (kept, twice, equal) = usable(time, columns)?;
        let steps: Vec<f64> = kept.windows(2).map(|w| time[w[1]] - time[w[0]]).collect();
        let column = columns.first().copied().unwrap_or(time);
        let coarse = coarse(time, column, &kept, &steps, equal);
        let period = coarse.unwrap_or_else(|| comb(time, &kept, quantile(&steps, 0.5)));
        if period <= 0.0 {
            let row = kept[1] + 1;
            return Err(Uneven::Falls {
                row,
                before: time[kept[0]],
                after: time[kept[1]],
            });
        }
        let (mut parts, places) = places(time, &kept, &steps, period, coarse.is_some());
        let gaps = parts.len() - 1;
        parts.retain(|part| part.len() >= 2);
        if parts.is_empty() {
            return Err(Uneven::TooShort(kept.len()));
        }
        let clocks = parts
            .iter()
            .map(|part| clock_of(time, &kept, &places, part))
            .collect();
        Ok(Self {
            kept,
            twice,
            coarse: coarse.is_some(),
            period,
            gaps,
            parts,
            places,
            clocks,
        })
    }
}

/// Rows with a value in every column, without those that are there twice, how many of these there are, and how many
/// have the stamp of the row before.
fn usable(time: &[f64], columns: &[&[f64]]) -> Result<(Vec<usize>, usize, usize), Uneven> {
    let whole = |k: &usize| columns.iter().all(|c| c[*k].is_finite()) && time[*k].is_finite();
    let mut kept: Vec<usize> = (0..time.len()).filter(whole).collect();
    let all = kept.len();
    let same = |a: usize, b: usize| time[a] == time[b] && columns.iter().all(|c| c[a] == c[b]);
    kept.dedup_by(|b, a| same(*a, *b));
    if kept.len() < 2 {
        return Err(Uneven::TooShort(kept.len()));
    }
    let steps = || kept.windows(2).map(|w| (w[1], time[w[0]], time[w[1]]));
    let equal = steps().filter(|(_, before, after)| before == after).count();
    // A few of one stamp are no coarse clock.
    let fault = steps().find(|(_, before, after)| after < before || (after == before && equal < 3));
    if let Some((row, before, after)) = fault {
        return Err(Uneven::Falls {
            row: row + 1,
            before,
            after,
        });
    }
    let twice = all - kept.len();
    Ok((kept, twice, equal))
}

pub(super) fn peak(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
}

/// The period of samples whose stamps are coarser than they are apart, `None` where stamps are not: one line
/// through all of them, from which none is further than a stamp's own step.
fn coarse(
    time: &[f64],
    column: &[f64],
    kept: &[usize],
    steps: &[f64],
    equal: usize,
) -> Option<f64> {
    let n = kept.len();
    let usual = quantile(steps, 0.5);
    let uneven = steps
        .iter()
        .filter(|s| (**s - usual).abs() > 0.3 * usual)
        .count();
    if (uneven as f64) < 0.25 * n as f64 && (equal as f64) < SAME_STAMP * n as f64 {
        return None;
    }
    // Stamps of a coarse clock are few distances apart, or many at one place; those that jitter are any.
    let mut distances: Vec<f64> = steps.iter().take(2000).copied().collect();
    distances.sort_by(f64::total_cmp);
    distances.dedup_by(|b, a| (*b - *a).abs() < 0.01 * usual.max(1e-12));
    if distances.len() > 8 && (equal as f64) < SAME_STAMP * n as f64 {
        return None;
    }
    let long = quantile(steps, 0.99);
    let (start, period) = line(
        kept.iter()
            .enumerate()
            .map(|(k, row)| (k as f64, time[*row])),
    );
    let off = kept
        .iter()
        .enumerate()
        .map(|(k, row)| time[*row] - start - period * k as f64);
    let off = off.fold(0.0_f64, |m, o| m.max(o.abs()));
    if n < 20 || period <= 0.0 || off > 1.2 * long {
        return None;
    }
    if (equal as f64) >= SAME_STAMP * n as f64 {
        return Some(period);
    }
    // Stamps of two distances, or samples of which each so many is missing: what is smooth tells.
    let rough = |places: &dyn Fn(usize) -> f64| {
        let mut misses: Vec<f64> = (2..n - 2)
            .step_by((n / 20_000).max(1))
            .map(|k| {
                let x: Vec<f64> = (k - 2..=k + 2).map(|i| places(i) - places(k)).collect();
                let others = [0, 1, 3, 4];
                let (mut value, mut gain) = (column[kept[k]], 1.0);
                for i in others {
                    let weight: f64 = others
                        .iter()
                        .filter(|j| **j != i)
                        .map(|j| -x[*j] / (x[i] - x[*j]))
                        .product();
                    value -= weight * column[kept[k + i - 2]];
                    gain += weight * weight;
                }
                value.abs() / f64::sqrt(gain)
            })
            .collect();
        misses.retain(|m| m.is_finite());
        misses.iter().map(|m| m * m).sum::<f64>()
    };
    (rough(&|k| k as f64) < rough(&|k| time[kept[k]])).then_some(period)
}

/// A straight line's value at zero and its slope.
fn line(points: impl Iterator<Item = (f64, f64)> + Clone) -> (f64, f64) {
    let (mut n, mut sx, mut sy) = (0.0, 0.0, 0.0);
    for (x, y) in points.clone() {
        n += 1.0;
        sx += x;
        sy += y;
    }
    let (mx, my) = (sx / n, sy / n);
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in points {
        xx += (x - mx) * (x - mx);
        xy += (x - mx) * (y - my);
    }
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    (my - slope * mx, slope)
}

/// The period of the grid that stamps lie on, near a first guess of it: where they agree best on a phase, over ever
/// longer blocks. Rows that are missing change no phase.
fn comb(time: &[f64], kept: &[usize], guess: f64) -> f64 {
    const TRIED: i32 = 16;
    let mut period = guess;
    if kept.len() < 64 || guess <= 0.0 {
        return guess;
    }
    for block in [32, 256, 2048] {
        let agree = |period: f64| -> f64 {
            let blocks = kept.chunks(block).filter(|b| b.len() == block);
            let every = (kept.len() / block / 32).max(1);
            let size = |rows: &[usize]| phase(time, rows, period).0;
            blocks.step_by(every).map(size).sum()
        };
        let reach = 0.5 / block as f64;
        let tried =
            (-TRIED..=TRIED).map(|k| period * (1.0 + reach * f64::from(k) / f64::from(TRIED)));
        let best = tried
            .map(|p| (agree(p), p))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        // Where no period is better than the guess it stays: even stamps are told to the last bit.
        if let Some((value, better)) = best
            && value > agree(period) * (1.0 + 1e-9)
        {
            period = better;
        }
        if kept.len() < 8 * block {
            break;
        }
    }
    period
}

/// How well stamps agree on a phase of a grid, from zero to one, and the phase as a share of its period.
fn phase(time: &[f64], rows: &[usize], period: f64) -> (f64, f64) {
    let first = time[rows[0]];
    let (mut re, mut im) = (0.0, 0.0);
    for row in rows {
        let (sin, cos) = (TAU * ((time[*row] - first) / period).fract()).sin_cos();
        re += cos;
        im += sin;
    }
    let own = im.atan2(re) / TAU;
    (re.hypot(im) / rows.len() as f64, own)
}

/// Stretches without a gap, as rows of `kept`, and the place of each row on the grid of its stretch.
fn places(
    time: &[f64],
    kept: &[usize],
    steps: &[f64],
    period: f64,
    coarse: bool,
) -> (Vec<std::ops::Range<usize>>, Vec<usize>) {
    let longest = if coarse {
        BRIDGE * period + quantile(steps, 0.99)
    } else {
        BRIDGE * period
    };
    let mut places = vec![0_usize; kept.len()];
    let mut parts = Vec::new();
    let mut from = 0;
    for k in 0..=steps.len() {
        if k < steps.len() && steps[k] <= longest {
            continue;
        }
        let part = from..k + 1;
        if coarse {
            for (n, place) in places[part.clone()].iter_mut().enumerate() {
                *place = n;
            }
        } else {
            on_grid(time, &kept[part.clone()], period, &mut places[part.clone()]);
        }
        parts.push(part);
        from = k + 1;
    }
    (parts, places)
}

/// The place of each row on the grid: the nearest one to its stamp, by the phase that its neighbours agree on. Of two
/// rows at one place the earlier one was late, if the place before is free, or the later one early.
fn on_grid(time: &[f64], rows: &[usize], period: f64, places: &mut [usize]) {
    let n = rows.len();
    let first = time[rows[0]];
    let mut at: Vec<i64> = Vec::with_capacity(n);
    let mut phase_now = f64::NAN;
    for k in 0..n {
        if phase_now.is_nan() || k % (SIDE / 2) == 0 {
            let near = &rows[k.saturating_sub(SIDE)..(k + SIDE).min(n)];
            let offset = (time[near[0]] - first) / period;
            let found = offset + phase(time, near, period).1;
            phase_now = if phase_now.is_nan() {
                found
            } else {
                // The same phase, a little on.
                found - (found - phase_now).round()
            };
        }
        at.push(((time[rows[k]] - first) / period - phase_now).round() as i64);
    }
    for k in 1..n {
        if at[k] > at[k - 1] {
            continue;
        }
        let free_before = k < 2 || at[k - 2] < at[k] - 1;
        let free_behind = k + 1 >= n || at[k + 1] > at[k] + 1;
        if free_before {
            at[k - 1] = at[k] - 1;
        } else if free_behind {
            at[k] = at[k - 1] + 1;
        }
    }
    // What is still at one place: the row before makes room.
    for k in (1..n).rev() {
        at[k - 1] = at[k - 1].min(at[k] - 1);
    }
    for (place, at_k) in places.iter_mut().zip(&at) {
        *place = (at_k - at[0]) as usize;
    }
}

/// Start and period of a stretch by its stamps: a line through them.
fn clock_of(
    time: &[f64],
    kept: &[usize],
    places: &[usize],
    part: &std::ops::Range<usize>,
) -> (f64, f64) {
    let first = time[kept[part.start]];
    let (start, step) = line(
        part.clone()
            .map(|k| (places[k] as f64, time[kept[k]] - first)),
    );
    // What stamps are late by, they are late by one way: most of them are right.
    let off = |k: usize| time[kept[k]] - first - start - step * places[k] as f64;
    let all: Vec<f64> = part.clone().map(off).collect();
    (first + start + quantile(&all, 0.5), step)
}
