//! Histograms in which one value among thousands can be seen.

use super::figure::Axes;
use super::plot::Plot;
use anyhow::Result;
use maud::Markup;
use std::ops::Range;

/// Bars of a histogram.
const BARS: usize = 60;
/// Where bars begin on the logarithmic axis: one of one value has a height too.
const FLOOR: f64 = 0.6;

/// How often values came, on a logarithmic axis, with marked values: a name, the value, and
/// whether it is a limit, which is shown even where no value comes near. `read` hands each value on with the kind that
/// it is of, below the number of `kinds`, and is called twice; nothing is drawn of no values.
pub(super) fn histogram(
    width: u32,
    kinds: &[&str],
    read: impl Fn(&mut dyn FnMut(usize, f64)) -> Result<()>,
    x: &str,
    marks: &[(&str, f64, bool)],
) -> Result<Option<Markup>> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    read(&mut |_, value| (low, high) = (low.min(value), high.max(value)))?;
    if low > high {
        return Ok(None);
    }
    let limits = marks.iter().filter(|mark| mark.2).map(|mark| mark.1);
    let range = range_of([low, high].into_iter().chain(limits));
    let size = (range.end - range.start) / BARS as f64;
    let mut counts = vec![[0_u64; BARS]; kinds.len()];
    read(&mut |kind, value| {
        counts[kind][(((value - range.start) / size) as usize).min(BARS - 1)] += 1;
    })?;
    let most = counts.iter().flatten().copied().max().unwrap_or(0).max(1);
    // Room for the names of marks above the highest bar.
    let decades = (most as f64 / FLOOR).log10();
    let axes = Axes {
        width,
        x: (range.clone(), x),
        y: (FLOOR..FLOOR * 10_f64.powf(1.35 * decades), "fibers"),
    };
    let mut plot = Plot::new(&axes).log_y();
    let share = 0.92 / kinds.len().max(1) as f64;
    for (k, (name, counts)) in kinds.iter().zip(&counts).enumerate() {
        let boxes: Vec<_> = counts
            .iter()
            .enumerate()
            .filter(|(_, count)| **count > 0)
            .map(|(i, count)| {
                let left = range.start + (i as f64 + k as f64 * share) * size;
                [(left, FLOOR), (left + share * size, *count as f64)]
            })
            .collect();
        plot = plot.boxes(name, ["c0", "c1", "c2"][k % 3], &boxes);
    }
    for (name, value, limit) in marks {
        plot = plot.mark_x(name, *value, if *limit { "limit" } else { "soft" });
    }
    Ok(Some(plot.draw()))
}

fn range_of(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
        (l.min(v), h.max(v))
    });
    let room = (0.02 * (high - low)).max(1e-3);
    low - room..high + room
}
