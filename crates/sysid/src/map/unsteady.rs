//! What changed while a map was scanned: the light, or how places are reached.
//!
//! A map is taken in time. Light that falls steadily while rows are scanned one after the other makes of a Gaussian the same Gaussian
//! elsewhere, as `exp(-k y) exp(-y^2/w^2)` is one around `-k w^2/2`: no map that was scanned once tells that, and how sure a place
//! is has to allow for it. What is less steady leaves its marks: rows that are brighter or dimmer than the shape or aside of
//! it, and columns that are not, or the other way round.

use super::Scan;
use super::parts;
use super::shape::{Datum, Fit, Shape};
use pigtail_model::frames::Displacement;

/// Change of the light over a scan that nobody sees, as a share of it, one standard deviation: a laser's power, the polarisation
/// in a fiber that was moved, a coupler that warms. A choice, as of benches that nobody has watched.
const UNSEEN: f64 = 0.25;

/// Rows and columns are looked at where a peak stands higher than this share.
const SEES: f64 = 0.1;

/// What changed while a map was scanned, beside what a peak of another shape would make alike of rows and columns.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Unsteady {
    /// By how much the light of rows (or columns) differs, rms, as a share of the peak.
    pub light: f64,
    /// How far aside of each other they are, rms, metres.
    pub aside: f64,
    /// How far a part of it, in the order in which it was taken, puts the peak from all of it, metres; zero where none is told far better by
    /// itself.
    pub parts: f64,
    /// How far off that and what nobody sees may put the peak, one standard deviation, metres.
    pub deviation: f64,
}

/// How rows or columns differ, squared: their light, as a share, and how far aside they are, metres.
#[derive(Debug, Clone, Copy, Default)]
struct Differ {
    light: f64,
    aside: f64,
}

impl Differ {
    /// Of readings that go together by a number, where a shape leaves something of each; `along` is the direction in which such readings lie.
    fn of(
        readings: &[(usize, Datum, f64)],
        shape: &Shape,
        noise: f64,
        along: Displacement,
    ) -> Self {
        let groups = readings
            .iter()
            .map(|(group, ..)| group + 1)
            .max()
            .unwrap_or(0);
        let (mut light, mut aside) = (Vec::new(), Vec::new());
        for group in 0..groups {
            let row = || readings.iter().filter(|(of, ..)| *of == group);
            let share = |d: &Datum| shape.height * shape.share(d.at);
            let all: f64 = row().map(|(_, d, _)| share(d).powi(2)).sum();
            if all == 0.0 {
                continue;
            }
            let gain = row().map(|(_, d, left)| share(d) * left).sum::<f64>() / all;
            light.push((gain, noise * noise / all, all));
            let [a, h, d] = shape.precision;
            let steep = |r: &Datum| {
                let off = r.at - shape.at;
                let slope = Displacement::new(a * off.x + h * off.y, h * off.x + d * off.y);
                2.0 * share(r) * (slope.x * along.x + slope.y * along.y)
            };
            let squares: f64 = row().map(|(_, d, _)| steep(d).powi(2)).sum();
            if squares > 0.0 {
                let left = row().map(|(_, d, left)| steep(d) * (left - gain * share(d)));
                aside.push((
                    left.sum::<f64>() / squares,
                    noise * noise / squares,
                    squares,
                ));
            }
        }
        // What noise makes is none of it.
        let beyond = |of: &[(f64, f64, f64)]| {
            let all: f64 = of.iter().map(|(.., weight)| weight).sum();
            let sum: f64 = of
                .iter()
                .map(|(value, own, weight)| (value * value - own) * weight)
                .sum();
            if all > 0.0 { sum / all } else { 0.0 }
        };
        Self {
            light: beyond(&light),
            aside: beyond(&aside),
        }
    }
}

impl Unsteady {
    /// What a fit leaves of readings tells; `noise` is that of a reading, as neighbours tell it.
    pub(super) fn of(scan: &Scan, found: &Fit, all: &[(usize, Datum)], noise: f64) -> Self {
        let shape = &found.shape;
        let seen: Vec<_> = all
            .iter()
            .filter(|(_, d)| !d.at_least && shape.share(d.at) > SEES)
            .map(|(_, d)| (*d, d.sign * d.residual(shape, found.level)))
            .collect();
        let by = |of: fn(&Datum) -> f64, along: Displacement| {
            let places = lines(seen.iter().map(|(d, _)| of(d)));
            let grouped = places
                .into_iter()
                .zip(&seen)
                .map(|(line, (d, left))| (line, *d, *left));
            Differ::of(&grouped.collect::<Vec<_>>(), shape, noise, along)
        };
        let rows = by(|d| d.at.y, Displacement::new(1.0, 0.0));
        let columns = by(|d| d.at.x, Displacement::new(0.0, 1.0));
        // A shape that is no Gaussian leaves as much of both.
        let light = (rows.light.max(0.0) - columns.light.max(0.0)).abs().sqrt();
        let aside = (rows.aside.max(0.0) - columns.aside.max(0.0)).abs().sqrt();
        let (rx, ry) = shape.radii();
        let unseen = |radius: f64, half: f64| 0.5 * UNSEEN * radius * radius / (2.0 * half);
        let unseen = unseen(rx, scan.half.x).max(unseen(ry, scan.half.y));
        // Light that differs by so much in all of half of the peak moves it by that share of its radius.
        let moves = light * rx.max(ry);
        let parts = parts::apart(scan, found, all);
        Self {
            light,
            aside,
            parts: parts.told,
            deviation: [moves, aside, parts.told, parts.open]
                .into_iter()
                .fold(unseen, f64::hypot),
        }
    }
}

/// Numbers of the lines that values stand on, in order; those of no grid are cut into as many as a grid of so many has.
pub(super) fn lines(values: impl Iterator<Item = f64>) -> Vec<usize> {
    let values: Vec<f64> = values.collect();
    let mut sorted = values.clone();
    sorted.sort_by(f64::total_cmp);
    let (Some(low), Some(high)) = (sorted.first(), sorted.last()) else {
        return Vec::new();
    };
    let count = (values.len() as f64).sqrt().ceil();
    let step = (high - low) / count;
    let mut edges: Vec<f64> = sorted
        .windows(2)
        .filter(|two| two[1] - two[0] > 0.2 * step)
        .map(|two| 0.5 * (two[0] + two[1]))
        .collect();
    if (edges.len() as f64) < 0.5 * count {
        edges = (1..count as usize).map(|k| low + step * k as f64).collect();
    }
    values
        .iter()
        .map(|value| edges.partition_point(|edge| edge < value))
        .collect()
}
