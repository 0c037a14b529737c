//! The report of a comparison: two runs over each other.

use super::figure::{Axes, HALF, WHOLE, curves, envelope, range_of};
use super::histogram::histogram;
use super::html::{self, figure, page};
use super::text::room;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_store::compare::{Comparison, Side};
use std::fmt::Write as _;

/// Points of a curve that a page keeps.
const POINTS: usize = 1500;
/// Lines of a terminal beyond which differences are counted.
const LINES: usize = 40;

/// The report of a comparison as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn compare(d: &Comparison, a: &Side, b: &Side) -> Result<String> {
    let title = format!("{} beside {}", d.a, d.b);
    let body = html! {
        p { (d.same) " values of the two summaries are the same, " (d.differences.len()) " are not." }
        @if !d.distributions.is_empty() {
            h2 { "Rows" }
            (html::table(&DISTRIBUTIONS.map(str::to_owned), &distributions(d)))
            p.soft { (CHANCE) }
            div.pair { (histograms(d, a, b)?) }
        }
        (samples(a, b))
        h2 { "Differences" }
        (html::table(&differences_header(d), &differences(d)))
        @for (run, keys) in [(&d.a, &d.only_in_a), (&d.b, &d.only_in_b)] {
            @if !keys.is_empty() { p { "Only in " (run) ": " (keys.join(", ")) } }
        }
    };
    Ok(page(&title, &body))
}

/// The same for a terminal.
pub fn compared(d: &Comparison) -> String {
    let mut text = format!("{} (a) beside {} (b)\n", d.a, d.b);
    if !d.distributions.is_empty() {
        let mut rows = vec![DISTRIBUTIONS.map(str::to_owned).to_vec()];
        rows.extend(distributions(d));
        text += &super::text::table(&rows, room());
        text += CHANCE;
        text.push('\n');
    }
    let mut rows = vec![["value", "a", "b", "change\n%"].map(str::to_owned).to_vec()];
    rows.extend(differences(d).into_iter().take(LINES));
    if rows.len() > 1 {
        text += &super::text::table(&rows, room());
    }
    let more = d.differences.len().saturating_sub(LINES);
    if more > 0 {
        let _ = writeln!(
            text,
            "{more} more values differ: --json and --report have all of them"
        );
    }
    let _ = write!(text, "{} values are the same", d.same);
    for (name, keys) in [("a", &d.only_in_a), ("b", &d.only_in_b)] {
        if !keys.is_empty() {
            let _ = write!(text, ", {} are in {name} alone", keys.len());
        }
    }
    text.push('\n');
    text
}

const DISTRIBUTIONS: [&str; 9] = [
    "column",
    "a\nvalues",
    "b\nvalues",
    "a\np50",
    "b\np50",
    "a\np99",
    "b\np99",
    "distance",
    "chance\n%",
];

const CHANCE: &str = "Distance: the greatest one of the shares below a value (Kolmogorov, Smirnov). Chance: how often two \
                      sets of independent values of one distribution are as far apart.";

/// A value in at most five digits.
fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&size) {
        let digits = (4 - size.log10().floor() as i32).clamp(0, 7) as usize;
        format!("{value:.digits$}")
    } else {
        format!("{value:.3e}")
    }
}

fn distributions(d: &Comparison) -> Vec<Vec<String>> {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), short);
    let row = |of: &pigtail_store::compare::Distribution| {
        let [a, b] = of.percentiles;
        vec![
            of.column.clone(),
            of.values[0].to_string(),
            of.values[1].to_string(),
            number(a.p50),
            number(b.p50),
            number(a.p99),
            number(b.p99),
            format!("{:.3}", of.distance),
            format!("{:.2}", 100.0 * of.chance),
        ]
    };
    d.distributions.iter().map(row).collect()
}

fn differences_header(d: &Comparison) -> Vec<String> {
    vec![
        "value".to_owned(),
        d.a.clone(),
        d.b.clone(),
        "change\n%".to_owned(),
    ]
}

fn differences(d: &Comparison) -> Vec<Vec<String>> {
    let text = |value: &serde_json::Value| match value {
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Number(number) if number.is_f64() => {
            number.as_f64().map_or_else(String::new, short)
        }
        other => other.to_string(),
    };
    let row = |of: &pigtail_store::compare::Difference| {
        let change = of
            .change
            .map_or_else(|| "-".to_owned(), |c| format!("{:+.2}", 100.0 * c));
        vec![of.key.clone(), text(&of.a), text(&of.b), change]
    };
    d.differences.iter().map(row).collect()
}

fn values<'a>(of: &'a [(String, Vec<f64>)], name: &str) -> &'a [f64] {
    of.iter().find(|(n, _)| n == name).map_or(&[], |(_, v)| v)
}

fn histograms(d: &Comparison, a: &Side, b: &Side) -> Result<Markup> {
    let mut all = Vec::new();
    for of in &d.distributions {
        let read = |each: &mut dyn FnMut(usize, f64)| {
            for (kind, side) in [a, b].into_iter().enumerate() {
                let finite = values(&side.rows, &of.column)
                    .iter()
                    .filter(|v| v.is_finite());
                finite.for_each(|value| each(kind, *value));
            }
            Ok(())
        };
        let caption = format!("{}, one run beside the other.", of.column);
        if let Some(svg) = histogram(HALF, &[&d.a, &d.b], read, &of.column, &[])? {
            all.push(figure(&svg, caption));
        }
    }
    Ok(html! { @for one in &all { (one) } })
}

/// Samples that both runs have, over the first column, which is time.
fn samples(a: &Side, b: &Side) -> Markup {
    let (Some((time, _)), Some((other, _))) = (a.samples.first(), b.samples.first()) else {
        return html! {};
    };
    if time != other {
        return html! {};
    }
    let both = a
        .samples
        .iter()
        .skip(1)
        .filter(|(name, _)| b.samples.iter().any(|(n, _)| n == name));
    html! {
        h2 { "Samples" }
        @for (name, _) in both {
            @let lines: Vec<(&str, Vec<(f64, f64)>)> = [a, b].into_iter().map(|side| {
                let points: Vec<(f64, f64)> = values(&side.samples, time).iter().copied()
                    .zip(values(&side.samples, name).iter().copied()).collect();
                (side.name.as_str(), envelope(&points, POINTS))
            }).collect();
            @let points = || lines.iter().flat_map(|(_, points)| points);
            @let axes = Axes {
                width: WHOLE,
                x: (range_of(points().map(|p| p.0), 1e-9), time),
                y: (range_of(points().map(|p| p.1), 1e-12), name),
            };
            (figure(&curves(&axes, &lines), html! { (name) " of both runs; each curve keeps its lowest and highest points." }))
        }
    }
}
