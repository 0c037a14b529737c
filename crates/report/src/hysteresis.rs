//! The reports of models of hysteresis.

use super::figure::{Axes, HALF, WHOLE, curves, envelope, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_control::compensation::hysteresis::straight;
use pigtail_records::hysteresis::{Inverted, Tried};
use std::fmt::Write as _;

/// Points of a curve: more would show no more.
const POINTS: usize = 3000;

pub(super) type Curve<'a> = (&'a str, Vec<(f64, f64)>);

/// Named curves on axes that fit them.
pub(super) fn plot(width: u32, x: &str, y: &str, series: &[Curve]) -> Result<String> {
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
    let mut body = head(title, tried);
    let (r, judged) = (&tried.record, tried.judged.clone());
    let every = judged.len().div_ceil(POINTS);
    let loops = |column: &[f64]| -> Vec<(f64, f64)> {
        judged
            .clone()
            .step_by(every)
            .map(|k| (r.input[k], column[k]))
            .collect()
    };
    let series = [
        ("measured", loops(&r.output)),
        (tried.document.model, loops(&tried.told)),
    ];
    let what = if tried.document.fitted.is_some() {
        "the part held back"
    } else {
        "what was judged"
    };
    body.push_str(&figure(
        &plot(WHOLE, "voltage, V", "displacement, um", &series)?,
        &format!("Displacement against voltage over {what}: measured, and by the model."),
    ));
    body.push_str("<div class=\"pair\">\n");
    let line = straight(r, judged.clone());
    let errors = |told: &[f64]| -> Vec<(f64, f64)> {
        let all: Vec<_> = (0..r.len())
            .map(|k| (r.time[k], told[k] - r.output[k]))
            .collect();
        envelope(&all, 600)
    };
    let from = judged.start.min(r.known_from());
    let after = |points: Vec<(f64, f64)>| -> Vec<(f64, f64)> {
        points.into_iter().filter(|p| p.0 >= r.time[from]).collect()
    };
    let series = [
        ("straight line", after(errors(&line))),
        (tried.document.model, after(errors(&tried.told))),
    ];
    body.push_str(&figure(
        &plot(HALF, "time, s", "error, um", &series)?,
        "Errors over the record: of the best straight line, and of the model.",
    ));
    let own = |k: usize| (r.output[k], tried.told[k] - r.output[k]);
    let series = [(
        tried.document.model,
        judged.clone().step_by(every).map(own).collect(),
    )];
    body.push_str(&figure(
        &plot(HALF, "displacement, um", "error, um", &series)?,
        "The model's error against displacement: what is left of the loops.",
    ));
    body.push_str("</div>\n");
    Ok(page(title, &body))
}

fn head(title: &str, tried: &Tried) -> String {
    let d = &tried.document;
    let mut body = format!("<h1>{}</h1>\n", escape(title));
    let _ = writeln!(
        body,
        "<p>Model <b>{}</b> of {} functions; range {:.3} um; {:.1} times better than the best \
         straight line, by root mean square.</p>",
        d.model, d.functions, d.range_um, d.improvement
    );
    body.push_str(
        "<div class=\"scroll\"><table>\n<tr><th></th><th></th><th>rms<small>um</small></th>\
         <th>rms<small>% of range</small></th><th>max<small>um</small></th>\
         <th>max<small>% of range</small></th><th>line's rms<small>um</small></th></tr>\n",
    );
    let mut row = |name: &str, rms: f64, max: f64, line: f64| {
        let percent = |um: f64| 100.0 * um / d.range_um;
        let _ = writeln!(
            body,
            "<tr><td>{name}</td><td></td><td>{rms:.4}</td><td>{:.3}</td><td>{max:.4}</td>\
             <td>{:.3}</td><td>{line:.4}</td></tr>",
            percent(rms),
            percent(max),
        );
    };
    for (name, part) in [("fitted", &d.fitted), ("held back", &d.held_back)] {
        if let Some(p) = part {
            row(name, p.rms_um, p.max_um, p.uncompensated_rms_um);
        }
    }
    if d.fitted.is_none() {
        let line = 0.01 * d.uncompensated_percent * d.range_um;
        row("predicted", d.rms_um, d.max_um, line);
    }
    body.push_str("</table></div>\n");
    body
}

/// The voltages for a path as one HTML text; beside those of a record, where there are some.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn inverted(title: &str, inverted: &Inverted, tried: Option<&Tried>) -> Result<String> {
    let mut body = tried.map_or_else(
        || format!("<h1>{}</h1>\n", escape(title)),
        |tried| head(title, tried),
    );
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
    body.push_str(&figure(
        &plot(WHOLE, "time, s", "voltage, V", &series)?,
        "The voltage for the path.",
    ));
    body.push_str(&figure(
        &plot(
            WHOLE,
            "time, s",
            "wanted displacement, um",
            &[("wanted", over_time(&inverted.wanted))],
        )?,
        "The path.",
    ));
    Ok(page(title, &body))
}
