//! Histograms in which one value among thousands can be seen.

use super::figure::{Axes, CURVES, GRID, INK, SOFT, chart, draw};
use anyhow::Result;
use maud::Markup;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

/// Bars of a histogram.
const BARS: usize = 60;
/// The colour of what must not be crossed.
const LIMIT: RGBColor = RGBColor(179, 38, 30);

/// How often values came, on a logarithmic axis, with marked values: a name, the value, and
/// whether it is a limit, which is shown even where no value comes near. `read` hands each value on, and is called
/// twice; nothing is drawn of no values.
pub(super) fn histogram(
    width: u32,
    read: impl Fn(&mut dyn FnMut(f64)) -> Result<()>,
    x: &str,
    marks: &[(&str, f64, bool)],
) -> Result<Option<Markup>> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    read(&mut |value| (low, high) = (low.min(value), high.max(value)))?;
    if low > high {
        return Ok(None);
    }
    let limits = marks.iter().filter(|mark| mark.2).map(|mark| mark.1);
    let range = range_of([low, high].into_iter().chain(limits));
    let size = (range.end - range.start) / BARS as f64;
    let mut counts = [0_u64; BARS];
    read(&mut |value| {
        counts[(((value - range.start) / size) as usize).min(BARS - 1)] += 1;
    })?;
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    // A bar of one has a height too.
    let height = |count: u64| {
        if count == 0 {
            0.0
        } else {
            (count as f64).log10() + HALF_DECADE
        }
    };
    let top = 1.15 * height(most) + 0.1;
    let axes = Axes {
        width,
        x: (range.clone(), x),
        y: (0.0..top, "fibers"),
    };
    draw(&axes, |root| {
        let mut chart = chart(&axes, root)?;
        let font = |size: i32| ("sans-serif", size).into_font().color(&INK);
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc(axes.x.1)
            .y_desc(axes.y.1)
            .x_labels(if width > 800 { 12 } else { 7 })
            .y_labels(0)
            .x_label_formatter(&|value| short(*value))
            .label_style(font(14))
            .axis_desc_style(font(15))
            .axis_style(SOFT)
            .draw()?;
        let room = range.end - range.start;
        for decade in 0..=most.ilog10() {
            let y = f64::from(decade) + HALF_DECADE;
            chart.draw_series([PathElement::new(
                vec![(range.start, y), (range.end, y)],
                GRID,
            )])?;
            chart.draw_series([Text::new(
                10_u64.pow(decade).to_string(),
                (range.start + 0.004 * room, y + 0.045 * top),
                ("sans-serif", 13).into_font().color(&SOFT),
            )])?;
        }
        chart.draw_series(
            counts
                .iter()
                .enumerate()
                .filter(|(_, count)| **count > 0)
                .map(|(k, count)| {
                    let left = range.start + k as f64 * size;
                    Rectangle::new(
                        [(left, 0.0), (left + 0.9 * size, height(*count))],
                        CURVES[0].filled(),
                    )
                }),
        )?;
        let inside = |mark: &&(&str, f64, bool)| range.contains(&mark.1);
        for (k, (name, value, limit)) in marks.iter().filter(inside).enumerate() {
            let colour = if *limit { LIMIT } else { SOFT };
            chart.draw_series([PathElement::new(
                vec![(*value, 0.0), (*value, top)],
                colour.stroke_width(2),
            )])?;
            // Names of marks that lie side by side go one below the other, and never out of the
            // picture.
            let right = value + 0.17 * room > range.end;
            let style = ("sans-serif", 14).into_font().color(&colour);
            let anchor = if right { HPos::Right } else { HPos::Left };
            let style = style.pos(Pos::new(anchor, VPos::Top));
            let aside = if right { -0.006 } else { 0.006 } * room;
            let y = top * (0.99 - 0.05 * (k % 4) as f64);
            chart.draw_series([Text::new((*name).to_owned(), (value + aside, y), style)])?;
        }
        Ok(())
    })
    .map(Some)
}

/// Height of a bar of one.
const HALF_DECADE: f64 = 0.5;

fn range_of(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
        (l.min(v), h.max(v))
    });
    if low > high {
        return 0.0..1.0;
    }
    let room = (0.02 * (high - low)).max(1e-3);
    // The numbers of the decades stand at the left.
    low - 3.0 * room..high + room
}

fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".to_owned()
    } else {
        text.to_owned()
    }
}
