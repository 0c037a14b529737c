//! Figures of the kinds that reports have in common.

use super::plot::Plot;
use maud::Markup;
use std::ops::Range;

/// Height of every figure, and the widths of a half and a whole one, in SVG units.
pub(super) const HEIGHT: u32 = 350;
pub(super) const HALF: u32 = 450;
pub(super) const WHOLE: u32 = 900;

/// Axes of a figure.
pub(super) struct Axes<'a> {
    pub(super) width: u32,
    pub(super) x: (Range<f64>, &'a str),
    pub(super) y: (Range<f64>, &'a str),
}

/// Named curves in one plot.
pub(super) fn curves(axes: &Axes, curves: &[(&str, Vec<(f64, f64)>)]) -> Markup {
    all(Plot::new(axes), curves).draw()
}

/// Named curves over what is counted, such as pulses.
pub(super) fn over_count(axes: &Axes, curves: &[(&str, Vec<(f64, f64)>)]) -> Markup {
    all(Plot::new(axes).whole_x(), curves).draw()
}

/// A plot with named curves.
pub(super) fn all(plot: Plot, curves: &[(&str, Vec<(f64, f64)>)]) -> Plot {
    let line = |plot: Plot, (name, points): &(&str, Vec<(f64, f64)>)| plot.line(name, points);
    curves.iter().fold(plot, line)
}

/// A cloud of points.
pub(super) fn points(axes: &Axes, points: &[(f64, f64)]) -> Markup {
    Plot::new(axes).dots("", "small", points).draw()
}

/// A histogram of `values` over a range in so many bars, to be drawn.
pub(super) fn bars(
    width: u32,
    values: &[f64],
    range: &Range<f64>,
    count: usize,
    x: &str,
    y: &str,
) -> Plot {
    let size = (range.end - range.start) / count as f64;
    let mut heights = vec![0.0; count];
    for value in values {
        let k = ((value - range.start) / size) as usize;
        heights[k.min(count - 1)] += 1.0;
    }
    let highest = heights.iter().fold(1.0, |h: f64, v| h.max(*v));
    let axes = Axes {
        width,
        x: (range.clone(), x),
        y: (0.0..1.08 * highest, y),
    };
    let boxes: Vec<_> = heights
        .iter()
        .enumerate()
        .filter(|(_, height)| **height > 0.0)
        .map(|(k, height)| {
            let left = range.start + k as f64 * size;
            [(left, 0.0), (left + 0.92 * size, *height)]
        })
        .collect();
    Plot::new(&axes).whole_y().boxes("", "c0", &boxes)
}

/// A range around `values` with some room, at least `least` wide.
pub(super) fn range_of(values: impl Iterator<Item = f64>, least: f64) -> Range<f64> {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
        (l.min(v), h.max(v))
    });
    if low > high {
        return -0.5 * least..0.5 * least;
    }
    let (middle, width) = (0.5 * (low + high), (1.08 * (high - low)).max(least));
    middle - 0.5 * width..middle + 0.5 * width
}

/// A range around `values`, which are positive, for a logarithmic axis.
pub(super) fn decades_of(values: impl Iterator<Item = f64>) -> Range<f64> {
    let logs = range_of(values.filter(|v| *v > 0.0).map(f64::log10), 0.3);
    10_f64.powf(logs.start)..10_f64.powf(logs.end)
}

/// A curve thinned to `columns` columns of which each keeps its lowest and its highest point: it
/// looks the same, noise and all.
pub(super) fn envelope(curve: &[(f64, f64)], columns: usize) -> Vec<(f64, f64)> {
    let size = curve.len().div_ceil(columns).max(1);
    if size <= 2 {
        return curve.to_vec();
    }
    let mut thin = Vec::with_capacity(2 * columns);
    for column in curve.chunks(size) {
        let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        if let (Some(low), Some(high)) = (column.iter().min_by(by), column.iter().max_by(by)) {
            let (first, last) = if low.0 <= high.0 {
                (low, high)
            } else {
                (high, low)
            };
            thin.extend([*first, *last]);
        }
    }
    thin
}
