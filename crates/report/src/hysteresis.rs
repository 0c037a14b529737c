//! The reports of models of hysteresis.

use super::figure::{Axes, HALF, WHOLE, curves, envelope, range_of};
use super::html::{figure, fixed, page, th};
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::compensation::hysteresis::straight;
use pigtail_records::hysteresis::{Inverted, Tried};

/// Points of a curve: more would show no more.
const POINTS: usize = 3000;

pub(super) type Curve<'a> = (&'a str, Vec<(f64, f64)>);

/// Named curves on axes that fit them.
pub(super) fn plot(width: u32, x: &str, y: &str, series: &[Curve]) -> Markup {
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width,
        x: (range_of(all().map(|p| p.0), 1e-6), x),
        y: (range_of(all().map(|p| p.1), 1e-6), y),
    };
    curves(&axes, series)
}

/// A fitted or tried model as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn tried(title: &str, tried: &Tried) -> Result<String> {
    let (r, judged) = (&tried.record, tried.judged.clone());
    let model = tried.document.model;
    let every = judged.len().div_ceil(POINTS);
    let thin = |of: &dyn Fn(usize) -> (f64, f64)| -> Vec<(f64, f64)> {
        judged.clone().step_by(every).map(of).collect()
    };
    let loops = [
        ("measured", thin(&|k| (r.input[k], r.output[k]))),
        (model, thin(&|k| (r.input[k], tried.prediction[k]))),
    ];
    let what = if tried.document.fitted.is_some() {
        "the part held back"
    } else {
        "what was judged"
    };
    let from = judged.start.min(r.known_from());
    let errors = |prediction: &[f64]| -> Vec<(f64, f64)> {
        let all: Vec<_> = (0..r.len())
            .map(|k| (r.time[k], prediction[k] - r.output[k]))
            .collect();
        let mut points = envelope(&all, 600);
        points.retain(|p| p.0 >= r.time[from]);
        points
    };
    let over_time = [
        ("straight line", errors(&straight(r, judged.clone()))),
        (model, errors(&tried.prediction)),
    ];
    let own = [(
        model,
        thin(&|k| (r.output[k], tried.prediction[k] - r.output[k])),
    )];
    let body = html! {
        (head(tried))
        (figure(
            &plot(WHOLE, "voltage, V", "displacement, um", &loops),
            format!("Displacement against voltage over {what}: measured, and by the model.")
        ))
        div.pair {
            (figure(
                &plot(HALF, "time, s", "error, um", &over_time),
                "Errors over the record: of the best straight line, and of the model."
            ))
            (figure(
                &plot(HALF, "displacement, um", "error, um", &own),
                "The model's error against displacement: what is left of the loops."
            ))
        }
    };
    Ok(page(title, &body))
}

fn head(tried: &Tried) -> Markup {
    let d = &tried.document;
    let percent = |um: f64| fixed(100.0 * um / d.range_um, 3);
    let mut rows = Vec::new();
    for (name, part) in [("fitted", &d.fitted), ("held back", &d.held_back)] {
        if let Some(p) = part {
            rows.push((name, p.rms_um, p.max_um, p.uncompensated_rms_um));
        }
    }
    if d.fitted.is_none() {
        let line = 0.01 * d.uncompensated_percent * d.range_um;
        rows.push(("predicted", d.rms_um, d.max_um, line));
    }
    html! {
        p {
            "Model " b { (d.model) } " of " (d.functions) " functions; range " (fixed(d.range_um, 3))
            " um; " (fixed(d.improvement, 1))
            " times better than the best straight line, by root mean square."
        }
        div.scroll { table {
            tr {
                th {}
                (th("rms", "um")) (th("rms", "% of range"))
                (th("max", "um")) (th("max", "% of range"))
                (th("line's rms", "um"))
            }
            @for (name, rms, max, line) in rows {
                tr {
                    td { (name) }
                    td { (fixed(rms, 4)) } td { (percent(rms)) }
                    td { (fixed(max, 4)) } td { (percent(max)) }
                    td { (fixed(line, 4)) }
                }
            }
        } }
    }
}

/// The voltages for a path as one HTML text; beside those of a record, where there are some.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn inverted(title: &str, inverted: &Inverted, tried: Option<&Tried>) -> Result<String> {
    let over_time = |column: &[f64]| -> Vec<(f64, f64)> {
        let all: Vec<_> = inverted
            .time
            .iter()
            .copied()
            .zip(column.iter().copied())
            .collect();
        envelope(&all, 1200)
    };
    let mut series = vec![("by the model", over_time(&inverted.volts))];
    if let Some(tried) = tried {
        series.push(("in the record", over_time(&tried.record.input)));
    }
    let wanted = [("wanted", over_time(&inverted.wanted))];
    let body = html! {
        @if let Some(tried) = tried { (head(tried)) }
        (figure(
            &plot(WHOLE, "time, s", "voltage, V", &series),
            "The voltage for the path."
        ))
        (figure(
            &plot(WHOLE, "time, s", "wanted displacement, um", &wanted),
            "The path."
        ))
    };
    Ok(page(title, &body))
}
