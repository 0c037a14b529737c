//! The reports of models from a person's own records.

use super::figure::{Axes, HALF, WHOLE, bars, curves, envelope, points, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_numerics::signal::{autocorrelation, quantile};
use pigtail_records::{Answer, Shown, capital, short};
use std::fmt::Write as _;

/// Columns of a curve over time, and points of a cloud: more would show no more.
const COLUMNS: usize = 900;
const POINTS: usize = 4000;

/// Lags of the autocorrelation, samples.
const LAGS: usize = 100;

/// What an axis shows, brought to a size that can be read: its factor and unit.
fn readable(values: &[f64], unit: &str) -> (f64, String) {
    let sizes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
    let most = quantile(&sizes, 0.999);
    let (prefixes, base): (&[(&str, f64)], &str) = match unit {
        "m" => (&[("m", 1.0), ("mm", 1e3), ("um", 1e6), ("nm", 1e9)], "m"),
        "m/s" => (
            &[("m/s", 1.0), ("mm/s", 1e3), ("um/s", 1e6), ("nm/s", 1e9)],
            "m/s",
        ),
        "N" => (&[("kN", 1e-3), ("N", 1.0), ("mN", 1e3), ("uN", 1e6)], "N"),
        "N m" => (&[("N m", 1.0), ("mN m", 1e3), ("uN m", 1e6)], "N m"),
        "rad" => (&[("deg", 57.295_779_513), ("mdeg", 57_295.779_513)], "rad"),
        "rad/s" => (
            &[("deg/s", 57.295_779_513), ("mdeg/s", 57_295.779_513)],
            "rad/s",
        ),
        other => (&[("", 1.0)], other),
    };
    let fits = prefixes.iter().find(|(_, factor)| most * factor >= 0.5);
    let (name, factor) = fits.or(prefixes.last()).copied().unwrap_or(("", 1.0));
    let name = if name.is_empty() { base } else { name };
    (factor, name.to_owned())
}

/// An identification from a record as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn record(title: &str, answer: &Answer, shown: Option<&Shown>) -> Result<String> {
    let mut body = format!("<h1>{}</h1>\n", escape(title));
    let class = if answer.is_whole() { "good" } else { "bad" };
    let _ = writeln!(
        body,
        "<p class=\"{class}\">{}</p>",
        escape(&capital(&answer.verdict))
    );
    let percent = |e: Option<f64>| e.map_or("-".to_owned(), |e| format!("{} %", short(e)));
    let _ = writeln!(
        body,
        "<p>Relative error {} on the record, {} on what it was not fitted to; condition {}.</p>",
        percent(answer.relative_error_percent),
        percent(answer.validation_error_percent),
        answer.condition.map_or("-".to_owned(), short)
    );
    for remark in &answer.remarks {
        let _ = writeln!(body, "<p class=\"soft\">{}</p>", escape(remark));
    }
    parameters(&mut body, answer);
    let Some(shown) = shown else {
        return Ok(page(title, &body));
    };
    account(&mut body, shown)?;
    for extra in &shown.figures {
        let series: Vec<(&str, Vec<(f64, f64)>)> = extra
            .curves
            .iter()
            .map(|(name, points)| (name.as_str(), envelope(points, COLUMNS)))
            .collect();
        let all = || series.iter().flat_map(|(_, points)| points.iter());
        let axes = Axes {
            width: WHOLE,
            x: (range_of(all().map(|p| p.0), 1e-9), &extra.x),
            y: (range_of(all().map(|p| p.1), 1e-9), &extra.y),
        };
        body.push_str(&figure(&curves(&axes, &series)?, &escape(&extra.caption)));
    }
    for table in &shown.tables {
        let _ = writeln!(body, "<h2>{}</h2>", escape(&table.title));
        body.push_str("<div class=\"scroll\"><table>\n<tr>");
        for cell in &table.header {
            let _ = write!(body, "<th>{}</th>", escape(cell));
        }
        body.push_str("</tr>\n");
        for row in &table.rows {
            body.push_str("<tr>");
            for cell in row {
                let _ = write!(body, "<td>{cell}</td>");
            }
            body.push_str("</tr>\n");
        }
        body.push_str("</table></div>\n");
    }
    Ok(page(title, &body))
}

fn parameters(body: &mut String, answer: &Answer) {
    body.push_str(
        "<div class=\"scroll\"><table>\n<tr><th>parameter</th><th></th><th>value</th>\
         <th>standard deviation<small>if what is left were white</small></th>\
         <th>standard deviation<small>as it is correlated</small></th></tr>\n",
    );
    for (parameter, unit) in &answer.parameters {
        let name = parameter.name.replace('_', " ");
        let cells = parameter.known.map_or_else(
            || "<td class=\"bad\">not known</td><td></td><td></td>".to_owned(),
            |k| {
                format!(
                    "<td>{}</td><td>{}</td><td>{}</td>",
                    short(k.value),
                    short(k.std),
                    short(k.std_correlated)
                )
            },
        );
        let _ = writeln!(
            body,
            "<tr><td>{name}</td><td>{}</td>{cells}</tr>",
            escape(unit)
        );
    }
    body.push_str("</table></div>\n");
}

fn account(body: &mut String, shown: &Shown) -> Result<()> {
    let a = &shown.account;
    if a.time.is_empty() {
        return Ok(());
    }
    let (what, unit) = shown.quantity;
    let left = a.left();
    let (scale, name) = readable(&a.measured, unit);
    let (fine, fine_name) = readable(&left, unit);
    let (px, pname) = readable(&a.position, shown.position);
    let (vx, vname) = readable(&a.velocity, &format!("{}/s", shown.position));
    let over = |values: &[f64], factor: f64| -> Vec<(f64, f64)> {
        let scaled = values.iter().map(|v| factor * v);
        envelope(
            &a.time.iter().copied().zip(scaled).collect::<Vec<_>>(),
            COLUMNS,
        )
    };
    let y = format!("{what}, {name}");
    let y_left = format!("residual, {fine_name}");
    let plot = |series: &[(&str, Vec<(f64, f64)>)], y: &str| {
        let all = || series.iter().flat_map(|(_, points)| points.iter());
        let axes = Axes {
            width: WHOLE,
            x: (range_of(all().map(|p| p.0), 1e-9), "time, s"),
            y: (range_of(all().map(|p| p.1), 1e-9), y),
        };
        curves(&axes, series)
    };
    let both = [
        ("measured", over(&a.measured, scale)),
        ("modelled", over(&a.modelled, scale)),
    ];
    body.push_str(&figure(
        &plot(&both, &y)?,
        &format!("The {what} in the record and by the model."),
    ));
    body.push_str(&figure(
        &plot(&[("residual", over(&left, fine))], &y_left)?,
        "Measured less modelled, over time.",
    ));
    body.push_str("<div class=\"pair\">\n");
    let every = left.len().div_ceil(POINTS).max(1);
    let cloud = |x: &[f64], factor: f64, label: &str| {
        let cloud: Vec<(f64, f64)> = (0..left.len())
            .step_by(every)
            .map(|k| (factor * x[k], fine * left[k]))
            .collect();
        let axes = Axes {
            width: HALF,
            x: (range_of(cloud.iter().map(|p| p.0), 1e-9), label),
            y: (range_of(cloud.iter().map(|p| p.1), 1e-9), &y_left),
        };
        points(&axes, &cloud)
    };
    body.push_str(&figure(
        &cloud(&a.position, px, &format!("position, {pname}"))?,
        "The residual against position.",
    ));
    body.push_str(&figure(
        &cloud(&a.velocity, vx, &format!("velocity, {vname}"))?,
        "The residual against velocity.",
    ));
    let scaled: Vec<f64> = left.iter().map(|l| fine * l).collect();
    let (low, high) = (quantile(&scaled, 0.001), quantile(&scaled, 0.999));
    let range = range_of([low, high].into_iter(), 1e-9);
    let inside: Vec<f64> = scaled
        .iter()
        .copied()
        .filter(|v| range.contains(v))
        .collect();
    body.push_str(&figure(
        &bars(HALF, &inside, &range, 60, &y_left, "samples")?,
        "Histogram of the residual, without its furthest thousandths.",
    ));
    let correlation: Vec<(f64, f64)> = autocorrelation(&left, LAGS)
        .into_iter()
        .enumerate()
        .map(|(lag, c)| (lag as f64, c))
        .collect();
    let edge = 1.96 / (left.len() as f64).sqrt();
    let last = correlation.len().saturating_sub(1) as f64;
    let axes = Axes {
        width: HALF,
        x: (0.0..last.max(1.0), "lag, samples"),
        y: (
            range_of(correlation.iter().map(|p| p.1).chain([-0.2]), 1e-9),
            "autocorrelation",
        ),
    };
    let series = [
        ("of the residual", correlation),
        ("95 % of white noise", vec![(0.0, edge), (last, edge)]),
    ];
    body.push_str(&figure(
        &curves(&axes, &series)?,
        "Autocorrelation of the residual: white noise would fall to the line at once.",
    ));
    body.push_str("</div>\n");
    Ok(())
}
