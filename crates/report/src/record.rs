//! The reports of models from a person's own records.

use super::figure::{Axes, HALF, WHOLE, bars, curves, decades_of, envelope, points, range_of};
use super::html::{self, figure, page, verdict};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_numerics::signal::{autocorrelation, quantile};
use pigtail_records::{Answer, Figure, Shown, capital, short};

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
    let percent = |e: Option<f64>| e.map_or("-".to_owned(), |e| format!("{} %", short(e)));
    let body = html! {
        p class=(verdict(answer.is_whole())) { (capital(&answer.verdict)) }
        p {
            "Relative error " (percent(answer.relative_error_percent)) " on the record"
            @if let Some(error) = answer.validation_error_percent { ", " (short(error)) " % on what it was not fitted to" }
            @if let Some(condition) = answer.condition { "; condition " (short(condition)) }
            "."
        }
        @for remark in &answer.remarks { p.soft { (capital(remark)) } }
        (parameters(answer))
        @if let Some(shown) = shown {
            (account(shown))
            @for extra in &shown.figures { (figure(&other(extra), &extra.caption)) }
            @for table in &shown.tables {
                h2 { (table.title) }
                (html::table(&table.header, &table.rows))
            }
        }
    };
    Ok(page(title, &body))
}

/// A figure that one kind of record brings along.
fn other(extra: &Figure) -> Markup {
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
    let log = extra.log_x;
    let axes = Axes {
        x: if log {
            (decades_of(all().map(|p| p.0)), axes.x.1)
        } else {
            axes.x
        },
        ..axes
    };
    let plot = if log {
        Plot::new(&axes).log_x()
    } else {
        Plot::new(&axes)
    };
    // What was measured lies broad below what tells of it.
    let add = |plot: Plot, (name, points): &(&str, Vec<(f64, f64)>)| match *name {
        "measured" => plot.line_as(name, "c0 broad", points),
        "modelled" => plot.line_as(name, "c1", points),
        _ => plot.line(name, points),
    };
    series.iter().fold(plot, add).draw()
}

fn parameters(answer: &Answer) -> Markup {
    let header = [
        "parameter",
        "unit",
        "value",
        "standard deviation\nif what is left were white",
        "standard deviation\nas it is correlated",
    ];
    let rows: Vec<Vec<String>> = answer
        .parameters
        .iter()
        .map(|(parameter, unit)| {
            let mut row = vec![name(parameter.name), (*unit).clone()];
            row.extend(parameter.known.map_or_else(
                || ["not known", "", ""].map(str::to_owned),
                |known| [known.value, known.std, known.std_correlated].map(short),
            ));
            row
        })
        .collect();
    html::table(&header.map(str::to_owned), &rows)
}

/// A key as words.
fn name(key: &str) -> String {
    key.replace('_', " ").replace("coulomb", "Coulomb")
}

fn account(shown: &Shown) -> Markup {
    let a = &shown.account;
    if a.time.is_empty() {
        return Markup::default();
    }
    let (what, unit) = shown.quantity;
    let residuals = a.residuals();
    let (scale, name) = readable(&a.measured, unit);
    let (fine, fine_name) = readable(&residuals, unit);
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
    let y_residual = format!("residual, {fine_name}");
    let axes = |points: &[&[(f64, f64)]], y| {
        let all = || points.iter().copied().flatten();
        let x = range_of(all().map(|p| p.0), 1e-9);
        let height = range_of(all().map(|p| p.1), 1e-9);
        Plot::new(&Axes {
            width: WHOLE,
            x: (x, "time, s"),
            y: (height, y),
        })
    };
    let [measured, modelled] = [&a.measured, &a.modelled].map(|values| over(values, scale));
    // What a good model tells would hide what was measured.
    let both = axes(&[&measured, &modelled], &y)
        .line_as("measured", "c0 broad", &measured)
        .line_as("modelled", "c1", &modelled);
    let left = over(&residuals, fine);
    let left = axes(&[&left], &y_residual).line("", &left);
    let every = residuals.len().div_ceil(POINTS).max(1);
    let cloud = |x: &[f64], factor: f64, label: &str| {
        let cloud: Vec<(f64, f64)> = (0..residuals.len())
            .step_by(every)
            .map(|k| (factor * x[k], fine * residuals[k]))
            .collect();
        let axes = Axes {
            width: HALF,
            x: (range_of(cloud.iter().map(|p| p.0), 1e-9), label),
            y: (range_of(cloud.iter().map(|p| p.1), 1e-9), &y_residual),
        };
        points(&axes, &cloud)
    };
    let scaled: Vec<f64> = residuals.iter().map(|l| fine * l).collect();
    let (low, high) = (quantile(&scaled, 0.001), quantile(&scaled, 0.999));
    let range = range_of([low, high].into_iter(), 1e-9);
    let inside: Vec<f64> = scaled
        .iter()
        .copied()
        .filter(|v| range.contains(v))
        .collect();
    html! {
        (figure(
            &both.draw(),
            format!("The {what} in the record and by the model.")
        ))
        (figure(
            &left.draw(),
            "Measured less modelled, over time."
        ))
        div.pair {
            (figure(
                &cloud(&a.position, px, &format!("position, {pname}")),
                "The residual against position."
            ))
            (figure(
                &cloud(&a.velocity, vx, &format!("velocity, {vname}")),
                "The residual against velocity."
            ))
            (figure(
                &bars(HALF, &inside, &range, 60, &y_residual, "samples").draw(),
                "Histogram of the residual, without its furthest thousandths."
            ))
            (correlation(&residuals))
        }
    }
}

/// How far what is left is like what was left before.
fn correlation(residuals: &[f64]) -> Markup {
    let correlation: Vec<(f64, f64)> = autocorrelation(residuals, LAGS)
        .into_iter()
        .enumerate()
        .map(|(lag, c)| (lag as f64, c))
        .collect();
    let edge = 1.96 / (residuals.len() as f64).sqrt();
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
    figure(
        &curves(&axes, &series),
        "Autocorrelation of the residual: white noise would fall to the line at once.",
    )
}
