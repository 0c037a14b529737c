//! The report of a comparison: two runs over each other.

use super::figure::{Axes, HALF, WHOLE, all, curves, decades_of, envelope, range_of};
use super::html::{self, figure, page};
use super::plot::Plot;
use super::text::room;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_store::compare::{Comparison, Difference, Side};
use std::fmt::Write as _;

/// Points of a curve that a page keeps.
const POINTS: usize = 1500;
/// So many differences are read one by one; of more those of one name, as of all fibers of a tray, are one row.
const LINES: usize = 40;

/// The report of a comparison as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn compare(d: &Comparison, a: &Side, b: &Side) -> Result<String> {
    let title = format!("{} beside {}", d.a, d.b);
    let body = html! {
        p { "a is " (d.a) ", b is " (d.b) "." }
        p { (d.same) " values of the two summaries are the same, " (d.differences.len()) " are not." }
        @if !d.distributions.is_empty() {
            h2 { "Rows" }
            (html::table(&DISTRIBUTIONS.map(str::to_owned), &distributions(d)))
            p.soft { (CHANCE) }
            div.pair { (shares(d, a, b)) }
        }
        @if !d.curves.is_empty() {
            h2 { "Curves of the summaries" }
            (html::table(&CURVES.map(str::to_owned), &curve_rows(d)))
            (summary_curves(d, a, b))
        }
        (samples(a, b))
        @if !d.differences.is_empty() {
            h2 { "Differences" }
            (html::table(&DIFFERENCES.map(str::to_owned), &folded(d)))
            @if folded(d).len() < d.differences.len() {
                p.soft { (FOLDED) }
                details {
                    summary { "Each of the " (d.differences.len()) " values" }
                    (html::table(&DIFFERENCES.map(str::to_owned), &differences(d)))
                }
            }
        }
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
    if !d.curves.is_empty() {
        let mut rows = vec![CURVES.map(str::to_owned).to_vec()];
        rows.extend(curve_rows(d));
        text += &super::text::table(&rows, room());
    }
    let mut rows = vec![DIFFERENCES.map(str::to_owned).to_vec()];
    rows.extend(folded(d));
    if rows.len() > 1 {
        text += &super::text::table(&rows, room());
    }
    if rows.len() - 1 < d.differences.len() {
        let _ = writeln!(
            text,
            "{FOLDED} --json and --report have each of the {} values.",
            d.differences.len()
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

const DIFFERENCES: [&str; 4] = ["value", "a", "b", "change\n%"];

const FOLDED: &str =
    "(most of N): N values differ that differ in their index alone, and this one most.";

fn row(of: &Difference) -> Vec<String> {
    let text = |value: &serde_json::Value| match value {
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Number(number) if number.is_f64() => {
            number.as_f64().map_or_else(String::new, short)
        }
        other => other.to_string(),
    };
    let change = of
        .change
        .map_or_else(|| "-".to_owned(), |c| format!("{:+.2}", 100.0 * c));
    vec![of.key.clone(), text(&of.a), text(&of.b), change]
}

fn differences(d: &Comparison) -> Vec<Vec<String>> {
    d.differences.iter().map(row).collect()
}

/// The differences, those of one name in a row where there are many: hundreds of lines hide what differs most.
fn folded(d: &Comparison) -> Vec<Vec<String>> {
    if d.differences.len() <= LINES {
        return differences(d);
    }
    let mut names: Vec<(String, Vec<&Difference>)> = Vec::new();
    for of in &d.differences {
        let name = name(&of.key);
        match names.iter_mut().find(|(n, _)| *n == name) {
            Some((_, all)) => all.push(of),
            None => names.push((name, vec![of])),
        }
    }
    let size = |of: &Difference| of.change.map_or(0.0, f64::abs);
    let mut rows = Vec::with_capacity(names.len());
    for (_, all) in names {
        // Of two that differ alike the first.
        let most = all.iter().rev().max_by(|p, q| size(p).total_cmp(&size(q)));
        match most {
            Some(most) if all.len() > 1 => {
                let mut row = row(most);
                row[0] = format!("{} (most of {})", most.key, all.len());
                rows.push(row);
            }
            _ => rows.extend(all.into_iter().map(row)),
        }
    }
    rows
}

/// A key without what its rows are called by: `fibers[*].loss_db` of `fibers[3].loss_db`.
fn name(key: &str) -> String {
    let mut name = String::with_capacity(key.len());
    let mut inside = false;
    for c in key.chars() {
        inside &= c != ']';
        if !inside {
            name.push(c);
        }
        if c == '[' {
            inside = true;
            name.push('*');
        }
    }
    name
}

/// A range around values, of some width even where all are the same.
fn room_of(values: impl Iterator<Item = f64> + Clone) -> std::ops::Range<f64> {
    let greatest = values.clone().fold(0.0, |most: f64, v| most.max(v.abs()));
    range_of(values, (1e-3 * greatest).max(1e-12))
}

fn values<'a>(of: &'a [(String, Vec<f64>)], name: &str) -> &'a [f64] {
    of.iter().find(|(n, _)| n == name).map_or(&[], |(_, v)| v)
}

/// The shares of values below each: two distributions that are alike lie on each other.
fn shares(d: &Comparison, a: &Side, b: &Side) -> Markup {
    let draw = |column: &str| {
        let steps = |side: &Side| {
            let mut sorted: Vec<f64> = values(&side.rows, column).to_vec();
            sorted.retain(|value| value.is_finite());
            sorted.sort_by(f64::total_cmp);
            let count = sorted.len() as f64;
            let steps = sorted.iter().enumerate();
            let steps =
                steps.flat_map(|(k, v)| [(*v, k as f64 / count), (*v, (k + 1) as f64 / count)]);
            // Thousands of steps look like hundreds.
            let every = (2 * sorted.len()).div_ceil(POINTS).max(1);
            let last = (2 * sorted.len()).saturating_sub(1);
            let kept = steps
                .enumerate()
                .filter(|(k, _)| k % every == 0 || *k == last);
            kept.map(|(_, point)| point).collect::<Vec<_>>()
        };
        let lines = [(d.a.as_str(), steps(a)), (d.b.as_str(), steps(b))];
        let all_x = lines
            .iter()
            .flat_map(|(_, points)| points.iter().map(|p| p.0));
        let axes = Axes {
            width: HALF,
            x: (range_of(all_x, 1e-9), column),
            y: (-0.02..1.02, "share below"),
        };
        curves(&axes, &lines)
    };
    html! {
        @for of in &d.distributions {
            (figure(&draw(&of.column), html! { (of.column) ": share of the values below each." }))
        }
    }
}

const CURVES: [&str; 6] = [
    "curve",
    "over",
    "points\na, b",
    "rms\nb - a",
    "greatest\nb - a",
    "at",
];

fn curve_rows(d: &Comparison) -> Vec<Vec<String>> {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), short);
    let row = |of: &pigtail_store::compare::Curve| {
        vec![
            of.key.clone(),
            of.over.clone(),
            format!("{}, {}", of.points[0], of.points[1]),
            number(of.rms),
            number(of.greatest),
            number(of.at),
        ]
    };
    d.curves.iter().map(row).collect()
}

/// Curves that both summaries have, over each other; over frequencies on a logarithmic axis.
fn summary_curves(d: &Comparison, a: &Side, b: &Side) -> Markup {
    let draw = |of: &pigtail_store::compare::Curve| {
        let (key, column) = of.key.rsplit_once('.')?;
        let points = |side: &Side| {
            let columns = side.curves.get(key)?;
            let (x, y) = (values(columns, &of.over), values(columns, column));
            let finite = x.iter().copied().zip(y.iter().copied());
            Some(
                finite
                    .filter(|(x, y)| x.is_finite() && y.is_finite())
                    .collect::<Vec<_>>(),
            )
        };
        let lines = [(d.a.as_str(), points(a)?), (d.b.as_str(), points(b)?)];
        let every = || lines.iter().flat_map(|(_, points)| points.iter());
        let log = of.over == "hz" && every().all(|p| p.0 > 0.0);
        let across = every().map(|p| p.0);
        let axes = Axes {
            width: WHOLE,
            x: (
                if log {
                    decades_of(across)
                } else {
                    range_of(across, 1e-9)
                },
                of.over.as_str(),
            ),
            y: (room_of(every().map(|p| p.1)), of.key.as_str()),
        };
        let plot = if log {
            Plot::new(&axes).log_x()
        } else {
            Plot::new(&axes)
        };
        Some(all(plot, &lines).draw())
    };
    html! {
        @for svg in d.curves.iter().filter_map(draw) { (figure(&svg, html! {})) }
    }
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
                    .zip(values(&side.samples, name).iter().copied())
                    .filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
                (side.name.as_str(), envelope(&points, POINTS))
            }).collect();
            @let points = || lines.iter().flat_map(|(_, points)| points);
            @let axes = Axes {
                width: WHOLE,
                x: (range_of(points().map(|p| p.0), 1e-9), time),
                y: (room_of(points().map(|p| p.1)), name),
            };
            (figure(&curves(&axes, &lines), html! { (name) " of both runs; each curve keeps its lowest and highest points." }))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn many_values_of_one_name_are_one_row_and_none_is_lost() {
        let difference = |key: String, change: f64| Difference {
            key,
            a: json!(1.0),
            b: json!(1.0 + change),
            change: Some(change),
        };
        let mut differences: Vec<_> = (0..45)
            .map(|k| difference(format!("fibers[{k}].loss_db"), -0.1 * f64::from(k % 7)))
            .collect();
        differences.push(difference("wall_seconds".to_owned(), 0.5));
        differences.extend(["x", "y"].map(|axis| difference(format!("gains[{axis}].kp"), 0.2)));
        let mut d = Comparison {
            a: "one".to_owned(),
            b: "other".to_owned(),
            same: 3,
            differences,
            only_in_a: Vec::new(),
            only_in_b: Vec::new(),
            curves: Vec::new(),
            distributions: Vec::new(),
        };
        let keys = |d: &Comparison| -> Vec<String> {
            folded(d).into_iter().map(|row| row[0].clone()).collect()
        };
        let folded = [
            "fibers[6].loss_db (most of 45)",
            "wall_seconds",
            "gains[x].kp (most of 2)",
        ];
        assert_eq!(keys(&d), folded);
        let text = compared(&d);
        assert!(text.contains("each of the 48 values"), "{text}");
        d.differences.truncate(LINES);
        assert_eq!(keys(&d).len(), LINES);
        assert!(!compared(&d).contains("most of"));
    }
}
