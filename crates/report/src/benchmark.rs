//! The report of a benchmark: a row an algorithm.

use super::campaign::percent;
use super::figure::{Axes, CURVES, GRID, INK, SOFT, WHOLE, draw};
use super::html::{self, figure, number, page};
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::benchmark::{BenchmarkDocument, Measured};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Room for names at the left, SVG units.
const NAMES: i32 = 190;
const BAD: RGBColor = RGBColor(179, 38, 30);

/// The header, units below names, and a row an algorithm.
pub fn table(document: &BenchmarkDocument) -> Vec<Vec<String>> {
    let header = [
        "algorithm",
        "right",
        "wrong",
        "touched",
        "fault",
        "lost",
        "a right\nfiber, s",
        "p50\ns",
        "p99\ns",
        "readings",
        "p50 xy\num",
        "p99 xy\num",
        "p99 z\num",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    rows.extend(document.algorithms.iter().map(|row| {
        vec![
            row.name.to_owned(),
            row.right.to_string(),
            row.wrong.to_string(),
            row.touched.to_string(),
            row.faults.to_string(),
            row.lost.to_string(),
            number(row.seconds_per_right_fiber, 2),
            number(row.seconds_per_fiber.p50, 2),
            number(row.seconds_per_fiber.p99, 2),
            number(row.readings_per_right_fiber, 0),
            number(row.offset_xy_um.p50, 3),
            number(row.offset_xy_um.p99, 3),
            number(row.offset_z_um.p99, 2),
        ]
    }));
    rows
}

/// The report as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn benchmark(measured: &Measured) -> Result<String> {
    let document = &measured.document;
    let title = format!(
        "{} algorithms, {} devices from seed {}, {}",
        document.algorithms.len(),
        document.devices,
        document.seed,
        document.scenario
    );
    let names: Vec<&str> = document.algorithms.iter().map(|row| row.name).collect();
    let body = html! {
        @if let Some((header, rows)) = table(document).split_first() { (html::table(header, rows)) }
        p.soft {
            "Right: said to be aligned, and by the twin's truth within " (document.tolerance_xy_um)
            " um in x and y and " (document.tolerance_z_um) " um in z. Wrong: said to be, and is not. \
             Touched: something hit the chip. Fault: the guard or the machine stopped it. Lost: all others. \
             Seconds a right fiber and readings: all that was spent, over the right fibers."
        }
        h2 { "What came of the fibers" }
        (figure(
            &shares(document)?,
            "Share of the fibers of each algorithm: right, lost, then wrong, touched and fault together."
        ))
        h2 { "Seconds" }
        (figure(
            &boxes(
                &names,
                &measured.seconds,
                "machine time of a device over its three fibers, s",
                None
            )?,
            "Each device is a dot. The box holds the middle half, its line is the median; whiskers end at \
             1 % and 99 %."
        ))
        h2 { "Offsets" }
        (figure(
            &boxes(
                &names,
                &measured.offsets,
                "offset across, the greater of x and y, um",
                Some(document.tolerance_xy_um)
            )?,
            "The truth about each attached fiber, whatever was said of it. The red line is the tolerance."
        ))
        (entries(document))
        (replays(document))
    };
    Ok(page(&title, &body))
}

fn entries(document: &BenchmarkDocument) -> Markup {
    let between = |[low, high]: [f64; 2]| format!("{} to {}", percent(low), percent(high));
    html! {
        h2 { "Entries" }
        div.scroll { table {
            tr { th { "algorithm" } th { "what it does" } th { "right, 95 %" } th { "wrong, 95 %" } }
            @for row in &document.algorithms {
                tr {
                    td { (row.name) }
                    td { (row.about) }
                    td { (between(row.right_confidence)) }
                    td { (between(row.wrong_confidence)) }
                }
            }
        } }
    }
}

/// How to see again what was not right.
fn replays(document: &BenchmarkDocument) -> Markup {
    let causes = || {
        let rows = document.algorithms.iter();
        rows.flat_map(|row| {
            row.replay
                .iter()
                .map(move |(cause, seeds)| (row, cause, seeds))
        })
        .filter_map(|(row, cause, seeds)| Some((row.name, cause, seeds.first()?, seeds)))
    };
    if causes().next().is_none() {
        return Markup::default();
    }
    html! {
        h2 { "Not right" }
        div.scroll { table {
            tr { th { "algorithm" } th { "counted as" } th { "seeds, the first" } th { "replay" } }
            @for (name, cause, first, seeds) in causes() {
                @let shown: Vec<String> = seeds.iter().take(8).map(u64::to_string).collect();
                tr {
                    td { (name) }
                    td { (cause) }
                    td { (shown.join(", ")) }
                    td { code {
                        "pigtail benchmark --algorithm " (name) " --scenario " (document.scenario)
                        " --devices 1 --seed " (first) " --json"
                    } }
                }
            }
        } }
    }
}

/// Where the row of an algorithm is, from 0 (bottom) up.
fn level(k: usize, rows: usize) -> f64 {
    (rows - 1 - k) as f64
}

fn name_at(root: &super::figure::Root, name: &str, y: i32) -> Result<()> {
    let style = ("sans-serif", 15).into_font().color(&INK);
    let style = style.pos(Pos::new(HPos::Right, VPos::Center));
    root.draw(&Text::new(name.to_owned(), (NAMES - 10, y), style))?;
    Ok(())
}

/// Shares of the fibers as bars that add up to all of them.
fn shares(document: &BenchmarkDocument) -> Result<Markup> {
    let rows = document.algorithms.len();
    let axes = Axes {
        width: WHOLE,
        x: (0.0..100.0, "fibers, %"),
        y: (-0.6..rows as f64 - 0.4, ""),
    };
    draw(&axes, |root| {
        let mut chart = ChartBuilder::on(root)
            .margin(8)
            .margin_right(24)
            .x_label_area_size(46)
            .y_label_area_size(NAMES as u32 - 8)
            .build_cartesian_2d(axes.x.0.clone(), axes.y.0.clone())?;
        mesh(&mut chart, axes.x.1, |v| format!("{v:.0}"))?;
        for (k, row) in document.algorithms.iter().enumerate() {
            let y = level(k, rows);
            let mut from = 0.0;
            for (count, colour) in [
                (row.right, CURVES[2]),
                (row.lost, RGBColor(190, 198, 206)),
                (row.wrong + row.touched + row.faults, BAD),
            ] {
                let to = from + 100.0 * count as f64 / document.fibers as f64;
                if count > 0 {
                    chart.draw_series([Rectangle::new(
                        [(from, y - 0.3), (to, y + 0.3)],
                        colour.filled(),
                    )])?;
                }
                from = to;
            }
            name_at(root, row.name, chart.backend_coord(&(0.0, y)).1)?;
        }
        Ok(())
    })
}

/// A box an algorithm, and its values as dots, on a logarithmic axis.
fn boxes(names: &[&str], values: &[Vec<f64>], x: &str, limit: Option<f64>) -> Result<Markup> {
    // What is exactly nothing has no logarithm.
    let log = |value: f64| value.max(1e-4).log10();
    let all = values.iter().flatten().copied().chain(limit).map(log);
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
        (l.min(v), h.max(v))
    });
    let range = if low > high {
        0.0..1.0
    } else {
        low - 0.1..high + 0.1
    };
    let rows = names.len();
    let axes = Axes {
        width: WHOLE,
        x: (range, x),
        y: (-0.6..rows as f64 - 0.4, ""),
    };
    draw(&axes, |root| {
        let mut chart = ChartBuilder::on(root)
            .margin(8)
            .margin_right(24)
            .x_label_area_size(46)
            .y_label_area_size(NAMES as u32 - 8)
            .build_cartesian_2d(axes.x.0.clone(), axes.y.0.clone())?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc(axes.x.1)
            .x_labels(0)
            .y_labels(0)
            .axis_desc_style(("sans-serif", 15).into_font().color(&INK))
            .axis_style(SOFT)
            .draw()?;
        let top = rows as f64 - 0.4;
        for (x, label) in decades(&axes.x.0) {
            chart.draw_series([PathElement::new(vec![(x, -0.6), (x, top)], GRID)])?;
            let (left, bottom) = chart.backend_coord(&(x, -0.6));
            let style = ("sans-serif", 14).into_font().color(&INK);
            let style = style.pos(Pos::new(HPos::Center, VPos::Top));
            root.draw(&Text::new(label, (left, bottom + 6), style))?;
        }
        if let Some(limit) = limit {
            let x = log(limit);
            chart.draw_series([PathElement::new(
                vec![(x, -0.6), (x, rows as f64 - 0.4)],
                BAD.stroke_width(2),
            )])?;
        }
        for (k, (name, values)) in names.iter().zip(values).enumerate() {
            let y = level(k, rows);
            name_at(root, name, chart.backend_coord(&(axes.x.0.start, y)).1)?;
            // Dots are spread by their order, which is by value: a pattern, but no two in one place.
            chart.draw_series(values.iter().enumerate().map(|(i, value)| {
                let aside = 0.28 * (((i * 7) % 13) as f64 / 6.0 - 1.0);
                Circle::new((log(*value), y + aside), 2, CURVES[0].mix(0.35).filled())
            }))?;
            let sorted = pigtail_numerics::statistics::Sorted::new(values.clone());
            let at = |share| sorted.percentile(share).map(log);
            let (Some(q1), Some(median), Some(q3), Some(p1), Some(p99)) =
                (at(0.25), at(0.5), at(0.75), at(0.01), at(0.99))
            else {
                continue;
            };
            chart.draw_series([
                PathElement::new(vec![(p1, y), (q1, y)], INK.stroke_width(1)),
                PathElement::new(vec![(q3, y), (p99, y)], INK.stroke_width(1)),
                PathElement::new(
                    vec![(median, y - 0.3), (median, y + 0.3)],
                    INK.stroke_width(3),
                ),
            ])?;
            chart.draw_series([Rectangle::new(
                [(q1, y - 0.3), (q3, y + 0.3)],
                INK.stroke_width(1),
            )])?;
        }
        Ok(())
    })
}

/// Values of one, two and five that a logarithmic axis shows, and how they are written.
fn decades(range: &std::ops::Range<f64>) -> Vec<(f64, String)> {
    let first = range.start.floor() as i32;
    (first..=range.end.ceil() as i32)
        .flat_map(|decade| [1.0, 2.0, 5.0].map(|m: f64| (m.log10() + f64::from(decade), decade)))
        .filter(|(x, _)| range.contains(x))
        .map(|(x, decade)| {
            let digits = (-decade).max(0) as usize;
            (x, format!("{:.digits$}", 10_f64.powf(x)))
        })
        .collect()
}

type Chart<'a, 'b> = ChartContext<
    'b,
    SVGBackend<'a>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn mesh(chart: &mut Chart, x: &str, number: impl Fn(f64) -> String) -> Result<()> {
    let font = |size: i32| ("sans-serif", size).into_font().color(&INK);
    chart
        .configure_mesh()
        .x_desc(x)
        .x_labels(9)
        .y_labels(0)
        .disable_y_mesh()
        .x_label_formatter(&|value| number(*value))
        .label_style(font(14))
        .axis_desc_style(font(15))
        .axis_style(SOFT)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .draw()?;
    Ok(())
}
