//! Figures as SVG.

use anyhow::Result;
use maud::{Markup, PreEscaped};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;

/// Height of every figure, and the widths of a half and a whole one, in SVG units.
const HEIGHT: u32 = 420;
pub(super) const HALF: u32 = 540;
pub(super) const WHOLE: u32 = 1080;

pub(super) const INK: RGBColor = RGBColor(27, 39, 51);
pub(super) const SOFT: RGBColor = RGBColor(91, 107, 122);
pub(super) const GRID: RGBColor = RGBColor(226, 231, 236);
const BAND: RGBColor = RGBColor(243, 246, 249);
/// Colours of curves, told apart also by people who see red and green alike.
pub(super) const CURVES: [RGBColor; 4] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(170, 90, 150),
];

/// Axes of a figure.
pub(super) struct Axes<'a> {
    pub(super) width: u32,
    pub(super) x: (Range<f64>, &'a str),
    pub(super) y: (Range<f64>, &'a str),
}

/// Points coloured by their third number, from 0 (dark) to 1 (bright); bright ones on top.
pub(super) fn coloured(
    axes: &Axes,
    points: &[(f64, f64, f64)],
    cross: (f64, f64),
) -> Result<Markup> {
    let mut order: Vec<_> = points.iter().copied().filter(|p| p.2.is_finite()).collect();
    order.sort_by(|a, b| a.2.total_cmp(&b.2));
    draw(axes, |root| {
        let mut chart = chart(axes, root)?;
        mesh(axes, &mut chart)?;
        chart.draw_series(order.iter().map(|&(x, y, light)| {
            let radius = if light > 0.15 { 3 } else { 2 };
            Circle::new((x, y), radius, ViridisRGB.get_color(0.93 * light).filled())
        }))?;
        let arm = 0.02 * (axes.y.0.end - axes.y.0.start);
        let (x, y) = cross;
        for ends in [[(x - arm, y), (x + arm, y)], [(x, y - arm), (x, y + arm)]] {
            chart.draw_series(std::iter::once(PathElement::new(
                ends.to_vec(),
                RGBColor(200, 30, 30).stroke_width(2),
            )))?;
        }
        Ok(())
    })
}

/// Points coloured by their third number, from 0 (dark) to 1 (bright); bright ones on top.
pub(super) fn dots(axes: &Axes, points: &[(f64, f64, f64)]) -> Result<Markup> {
    let mut order: Vec<_> = points.iter().copied().filter(|p| p.2.is_finite()).collect();
    order.sort_by(|a, b| a.2.total_cmp(&b.2));
    draw(axes, |root| {
        let mut chart = chart(axes, root)?;
        mesh(axes, &mut chart)?;
        chart.draw_series(order.iter().map(|&(x, y, light)| {
            Circle::new((x, y), 2, ViridisRGB.get_color(0.93 * light).filled())
        }))?;
        Ok(())
    })
}

/// Cells of a `size`, each up to its first two numbers and coloured by the third, from 0 (dark) to 1
/// (bright).
pub(super) fn cells(
    axes: &Axes,
    points: &[(f64, f64, f64)],
    (width, height): (f64, f64),
) -> Result<Markup> {
    draw(axes, |root| {
        let mut chart = chart(axes, root)?;
        mesh(axes, &mut chart)?;
        chart.draw_series(points.iter().map(|&(x, y, value)| {
            let colour = ViridisRGB.get_color(value.clamp(0.0, 1.0));
            Rectangle::new([(x - width, y - height), (x, y)], colour.filled())
        }))?;
        Ok(())
    })
}

/// A curve over time with its phases marked: name, start and end of each.
pub(super) fn over_time(
    axes: &Axes,
    curve: &[(f64, f64)],
    phases: &[(&str, f64, f64)],
) -> Result<Markup> {
    draw(axes, |root| {
        let mut chart = chart(axes, root)?;
        let (bottom, top) = (axes.y.0.start, axes.y.0.end);
        chart.draw_series(phases.iter().step_by(2).map(|&(_, start, end)| {
            Rectangle::new([(start, bottom), (end, top)], BAND.filled())
        }))?;
        mesh(axes, &mut chart)?;
        chart.draw_series(std::iter::once(PathElement::new(
            curve.to_vec(),
            CURVES[0].stroke_width(1),
        )))?;
        let style = ("sans-serif", 14).into_font().color(&SOFT);
        let room = axes.x.0.end - axes.x.0.start;
        chart.draw_series(phases.iter().map(|&(name, start, end)| {
            // A name that does not fit into its phase would run into the next one.
            let fits = (end - start) / room * f64::from(axes.width) > 8.5 * name.len() as f64;
            let text = if fits { name } else { "" };
            Text::new(
                text.to_owned(),
                (start + 0.004 * room, top - 0.02 * (top - bottom)),
                style.clone(),
            )
        }))?;
        Ok(())
    })
}

/// Named curves in one plot.
pub(super) fn curves(axes: &Axes, curves: &[(&str, Vec<(f64, f64)>)]) -> Result<Markup> {
    draw(axes, |root| {
        let mut chart = chart(axes, root)?;
        mesh(axes, &mut chart)?;
        for ((name, points), colour) in curves.iter().zip(CURVES) {
            chart
                .draw_series(LineSeries::new(
                    points.iter().copied(),
                    colour.stroke_width(2),
                ))?
                .label(*name)
                .legend(move |(x, y)| {
                    PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(3))
                });
        }
        if curves.len() > 1 {
            chart
                .configure_series_labels()
                .position(emptiest_place(axes, curves))
                .margin(12)
                .background_style(WHITE.mix(0.8))
                .label_font(("sans-serif", 15).into_font().color(&INK))
                .draw()?;
        }
        Ok(())
    })
}

/// A cloud of points.
pub(super) fn points(axes: &Axes, points: &[(f64, f64)]) -> Result<Markup> {
    draw(axes, |root| {
        let mut chart = chart(axes, root)?;
        mesh(axes, &mut chart)?;
        let colour = CURVES[0].mix(0.5);
        chart.draw_series(points.iter().map(|p| Circle::new(*p, 1, colour.filled())))?;
        Ok(())
    })
}

/// A histogram of `values` over a range in so many bars.
pub(super) fn bars(
    width: u32,
    values: &[f64],
    range: &Range<f64>,
    count: usize,
    x: &str,
    y: &str,
) -> Result<Markup> {
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
    draw(&axes, |root| {
        let mut chart = chart(&axes, root)?;
        mesh(&axes, &mut chart)?;
        chart.draw_series(heights.iter().enumerate().filter(|(_, h)| **h > 0.0).map(
            |(k, h)| {
                let left = range.start + k as f64 * size;
                Rectangle::new([(left, 0.0), (left + 0.9 * size, *h)], CURVES[0].filled())
            },
        ))?;
        Ok(())
    })
}

/// Where a legend hides the fewest points: in a corner, or in the middle of what runs around it.
fn emptiest_place(axes: &Axes, curves: &[(&str, Vec<(f64, f64)>)]) -> SeriesLabelPosition {
    let share = |value: f64, range: &Range<f64>| (value - range.start) / (range.end - range.start);
    let hidden = |x: Range<f64>, y: Range<f64>| {
        let points = curves.iter().flat_map(|(_, points)| points);
        points
            .filter(|p| x.contains(&share(p.0, &axes.x.0)) && y.contains(&share(p.1, &axes.y.0)))
            .count()
    };
    let (low, high, middle) = (0.0..0.3, 0.7..1.0, 0.3..0.7);
    let places = [
        (low.clone(), low.clone(), SeriesLabelPosition::LowerLeft),
        (high.clone(), low.clone(), SeriesLabelPosition::LowerRight),
        (low, high.clone(), SeriesLabelPosition::UpperLeft),
        (high.clone(), high, SeriesLabelPosition::UpperRight),
        (middle.clone(), middle, SeriesLabelPosition::MiddleMiddle),
    ];
    places
        .into_iter()
        .min_by_key(|(x, y, _)| hidden(x.clone(), y.clone()))
        .map_or(SeriesLabelPosition::LowerLeft, |(_, _, place)| place)
}

pub(super) type Root<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<
    'b,
    SVGBackend<'a>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

/// Draws a figure. Its texts are escaped as it is drawn, so that it may stand in a page as it is.
pub(super) fn draw(axes: &Axes, content: impl FnOnce(&Root) -> Result<()>) -> Result<Markup> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (axes.width, HEIGHT)).into_drawing_area();
        content(&root)?;
        root.present()?;
    }
    Ok(PreEscaped(svg))
}

pub(super) fn chart<'a, 'b>(axes: &Axes, root: &'b Root<'a>) -> Result<Chart<'a, 'b>> {
    Ok(ChartBuilder::on(root)
        .margin(8)
        .margin_right(18)
        .x_label_area_size(46)
        .y_label_area_size(62)
        .build_cartesian_2d(axes.x.0.clone(), axes.y.0.clone())?)
}

pub(super) fn mesh(axes: &Axes, chart: &mut Chart) -> Result<()> {
    let font = |size: i32| ("sans-serif", size).into_font().color(&INK);
    let number = |value: &f64| {
        // Five digits are more than any axis here needs; trailing zeros are none.
        let text = format!("{value:.3}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        if text == "-0" {
            "0".to_owned()
        } else {
            text.to_owned()
        }
    };
    chart
        .configure_mesh()
        .x_desc(axes.x.1)
        .y_desc(axes.y.1)
        .x_labels(8)
        .y_labels(7)
        .x_label_formatter(&number)
        .y_label_formatter(&number)
        .label_style(font(14))
        .axis_desc_style(font(15))
        .axis_style(SOFT)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .draw()?;
    Ok(())
}

/// A range around `values` with some room, at least `least` wide.
pub(super) fn range_of(values: impl Iterator<Item = f64>, least: f64) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
        (l.min(v), h.max(v))
    });
    if low > high {
        return -0.5 * least..0.5 * least;
    }
    let (middle, width) = (0.5 * (low + high), (1.08 * (high - low)).max(least));
    middle - 0.5 * width..middle + 0.5 * width
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
