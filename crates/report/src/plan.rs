//! The report of a plan: the ways to align beside each other.

use super::figure::{Axes, WHOLE, decades_of};
use super::html::{self, figure, fixed, number, page};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::plan::{PlanDocument, SearchRow};

/// The report of a plan as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn plan(d: &PlanDocument) -> Result<String> {
    let title = format!("Ways to align {} on {}, seed {}", d.recipe, d.rig, d.seed);
    let body = html! {
        h2 { "First light" }
        p {
            "Machine time to cover the whole area: by the closed form of the scan rate, by the one of the photodiode's \
             rate, and as the twin took it. The first two methods serve a device's three fibers at once; a fiber's \
             share is in the last column but one."
        }
        (figure(&times(&d.searches), "The times of the table below. What the twin cannot do has no dot of its own."))
        (searches(d))
        h2 { "Whole procedures" }
        p { "From the tray to an attached fiber, over devices of successive seeds." }
        (procedures(d))
        p.soft { "pigtail " (d.version) }
    };
    Ok(page(&title, &body))
}

fn name(row: &SearchRow) -> String {
    format!("{}, {} um, {:.0} Hz", row.method, row.mesh_um, row.scan_hz)
}

/// Times of each search on a logarithmic axis.
fn times(rows: &[SearchRow]) -> Markup {
    let names: Vec<String> = rows.iter().map(name).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let of = |value: &dyn Fn(&SearchRow) -> Option<f64>| -> Vec<(f64, f64)> {
        let rows = rows.iter().rev().enumerate();
        rows.filter_map(|(k, row)| Some((value(row)?, k as f64)))
            .collect()
    };
    let series = [
        ("by scan rate", of(&|r| Some(r.closed_form_seconds))),
        ("by photodiode", of(&|r| Some(r.photodiode_limited_seconds))),
        ("measured on the twin", of(&|r| r.measured_seconds)),
        ("light found after", of(&|r| r.found_seconds)),
    ];
    let all = series
        .iter()
        .flat_map(|(_, points)| points.iter().map(|p| p.0));
    let axes = Axes {
        width: WHOLE,
        x: (decades_of(all), "machine time, s"),
        y: (-0.6..rows.len() as f64 - 0.4, ""),
    };
    let plot = Plot::new(&axes).log_x().rows(&names);
    let add = |plot: Plot, (name, points): &(&str, Vec<_>)| plot.dots(name, "large", points);
    series.iter().fold(plot, add).draw()
}

fn searches(d: &PlanDocument) -> Markup {
    let header = [
        "method",
        "mesh\num",
        "scan\nHz",
        "photodiode\nHz",
        "by scan rate\ns",
        "by photodiode\ns",
        "measured\ns",
        "a fiber\ns",
        "found after\ns",
    ];
    let rows: Vec<Vec<String>> = d
        .searches
        .iter()
        .map(|r| {
            vec![
                r.method.to_owned(),
                r.mesh_um.to_string(),
                fixed(r.scan_hz, 1),
                fixed(r.photodiode_hz, 0),
                fixed(r.closed_form_seconds, 1),
                fixed(r.photodiode_limited_seconds, 1),
                number(r.measured_seconds, 1),
                number(r.seconds_per_fiber, 1),
                number(r.found_seconds, 1),
            ]
        })
        .collect();
    html! {
        (html::table(&header.map(str::to_owned), &rows))
        @for row in d.searches.iter().filter(|row| !row.note.is_empty()) {
            p.soft { (name(row)) ": " (row.note) }
        }
    }
}

fn procedures(d: &PlanDocument) -> Markup {
    let header = [
        "procedure",
        "devices",
        "aligned",
        "mean a fiber\ns",
        "longest fiber\ns",
    ];
    let rows: Vec<Vec<String>> = d
        .procedures
        .iter()
        .map(|r| {
            vec![
                r.procedure.to_owned(),
                r.devices.to_string(),
                r.successes.to_string(),
                fixed(r.mean_seconds_per_fiber, 2),
                fixed(r.max_seconds_per_fiber, 2),
            ]
        })
        .collect();
    html::table(&header.map(str::to_owned), &rows)
}
