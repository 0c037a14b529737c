//! Two runs beside each other: what their summaries say differently, how their rows are distributed, and their
//! samples over the same axis.

use crate::rows::{Kind, Rows};
use anyhow::{Context, Result};
use pigtail_hal::Error;
use pigtail_numerics::statistics::{Percentiles, Sorted, kolmogorov_smirnov};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// What of a summary says where it lies, what it is called by, or repeats what was found as text for a calibration: it
/// differs always.
const PLACES: [&str; 6] = [
    "report",
    "run",
    "calibration",
    "found",
    "rows",
    "rows_sha256",
];

/// Rows from which on a table of a summary is a curve, and its values are not listed one by one.
const CURVE: usize = 8;

/// What a row of a summary is called by.
const NAMES: [&str; 6] = ["name", "axis", "port", "procedure", "method", "part"];

/// Columns with their values.
pub type Columns = Vec<(String, Vec<f64>)>;

/// What is known of a run from its folder.
#[derive(Debug)]
pub struct Side {
    /// The name of its folder.
    pub name: String,
    /// Values of `summary.json` by their keys, such as `seconds_per_fiber.p99` or `starts[1].cost`.
    summary: BTreeMap<String, Value>,
    /// Tables of numbers of the summary by their keys, such as a frequency response: over the first column.
    pub curves: BTreeMap<String, Columns>,
    /// Columns of numbers of `rows.parquet`; empty where there is none.
    pub rows: Columns,
    /// Columns of numbers of `samples.csv`, time first; empty where there is none.
    pub samples: Columns,
}

impl Side {
    /// Reads the folder of a run.
    ///
    /// # Errors
    ///
    /// When it has no summary, or a file of it cannot be read.
    pub fn read(folder: &Path) -> Result<Self> {
        let place = |file: &str| folder.join(file).display().to_string();
        let told = |file: &str, what: String| Error::new(place(file), "", what);
        let text = fs::read_to_string(folder.join("summary.json")).map_err(|error| {
            let what = format!("cannot be read ({error}); accepted is a run that came to its end");
            told("summary.json", what)
        })?;
        let value: Value = serde_json::from_str(&text)
            .map_err(|error| told("summary.json", format!("is no JSON: {error}")))?;
        let (mut summary, mut curves) = (BTreeMap::new(), BTreeMap::new());
        flatten("", &value, &mut summary, &mut curves);
        summary.retain(|key, _| !PLACES.contains(&key.split('.').next().unwrap_or_default()));
        let rows = folder.join("rows.parquet");
        let rows = if rows.exists() {
            numbers(&rows).with_context(|| place("rows.parquet"))?
        } else {
            Vec::new()
        };
        let samples = folder.join("samples.csv");
        let samples = if samples.exists() {
            table(&samples).with_context(|| place("samples.csv"))?
        } else {
            Vec::new()
        };
        let name = folder.file_name().unwrap_or(folder.as_os_str());
        Ok(Self {
            name: name.to_string_lossy().into_owned(),
            summary,
            curves,
            rows,
            samples,
        })
    }
}

fn flatten(
    key: &str,
    value: &Value,
    to: &mut BTreeMap<String, Value>,
    curves: &mut BTreeMap<String, Columns>,
) {
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                let dot = if key.is_empty() { "" } else { "." };
                flatten(&format!("{key}{dot}{name}"), value, to, curves);
            }
        }
        Value::Array(values) => {
            if let Some(columns) = curve(values) {
                curves.insert(key.to_owned(), columns);
                return;
            }
            let names = names(values);
            for (k, value) in values.iter().enumerate() {
                let name = names.get(k).cloned().unwrap_or_else(|| k.to_string());
                flatten(&format!("{key}[{name}]"), value, to, curves);
            }
        }
        _ => {
            to.insert(key.to_owned(), value.clone());
        }
    }
}

/// What each row is called by, where all have names, and no two the same.
fn names(rows: &[Value]) -> Vec<String> {
    let of = |field: &str| -> Option<Vec<String>> {
        let names: Vec<String> = rows
            .iter()
            .map(|row| row.get(field)?.as_str().map(str::to_owned))
            .collect::<Option<_>>()?;
        let each: std::collections::BTreeSet<_> = names.iter().collect();
        (each.len() == names.len()).then_some(names)
    };
    NAMES.iter().find_map(|field| of(field)).unwrap_or_default()
}

/// Rows of numbers as columns, where there are enough of them; flags are left out, and what a row has no number of is none.
fn curve(rows: &[Value]) -> Option<Columns> {
    let first = rows.first().filter(|_| rows.len() >= CURVE)?.as_object()?;
    let is_plain = |value: &Value| value.is_number() || value.is_null() || value.is_boolean();
    let all_plain = |row: &Value| {
        row.as_object()
            .is_some_and(|row| row.values().all(is_plain))
    };
    if !rows.iter().all(all_plain) {
        return None;
    }
    let is_number = |name: &&String| rows.iter().any(|row| row[name.as_str()].is_number());
    let column = |name: &String| {
        let values = rows.iter().map(|row| row[name.as_str()].as_f64());
        let values = values.map(|value| value.unwrap_or(f64::NAN)).collect();
        (name.clone(), values)
    };
    let mut columns: Columns = first.keys().filter(is_number).map(column).collect();
    // Fields come by name from the document's text; a frequency or a time is what a curve goes over.
    let over = |name: &str| name != "hz" && !name.ends_with("_s") && !name.starts_with("a1");
    columns.sort_by_key(|(name, _)| over(name));
    (columns.len() > 1).then_some(columns)
}

fn numbers(path: &Path) -> Result<Columns> {
    let rows = Rows::open_any(path)?;
    let of_numbers = rows.columns().iter().filter(|c| c.kind() == Kind::Number);
    of_numbers
        .map(|c| Ok((c.name.clone(), rows.numbers(&c.name)?)))
        .collect()
}

/// The columns of a CSV file in which every cell is a number.
fn table(path: &Path) -> Result<Columns> {
    let mut reader = csv::Reader::from_path(path)?;
    let names: Vec<String> = reader.headers()?.iter().map(str::to_owned).collect();
    let mut columns: Vec<Option<Vec<f64>>> = vec![Some(Vec::new()); names.len()];
    for record in reader.records() {
        for (column, cell) in columns.iter_mut().zip(&record?) {
            // What is not there is no number, and no word either.
            let value = if cell.is_empty() {
                Ok(f64::NAN)
            } else {
                cell.parse()
            };
            match (value, column.as_mut()) {
                (Ok(value), Some(values)) => values.push(value),
                _ => *column = None,
            }
        }
    }
    let columns = names.into_iter().zip(columns);
    Ok(columns.filter_map(|(n, c)| Some((n, c?))).collect())
}

/// A value that two summaries have, and not alike.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Where it stands in the summaries.
    pub key: String,
    /// Its value in the first run.
    pub a: Value,
    /// Its value in the second run.
    pub b: Value,
    /// What the second is greater, as a share of the first's magnitude; null for what is no number, and for a first
    /// of zero.
    pub change: Option<f64>,
}

/// A column that two campaigns have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Distribution {
    /// The name of the column, with its unit.
    pub column: String,
    /// Values in the first run and in the second.
    pub values: [usize; 2],
    /// Percentiles in the first run and in the second.
    pub percentiles: [Percentiles; 2],
    /// Greatest distance of the cumulative shares, 0 to 1.
    pub distance: f64,
    /// Probability that chance alone makes that distance as great, if values were independent. Devices of the same
    /// seeds are alike in both runs: then chance makes it smaller, and this is too great rather than too small.
    pub chance: f64,
}

/// A curve that two summaries have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curve {
    /// Where it stands in the summaries, with its column.
    pub key: String,
    /// The column that it goes over.
    pub over: String,
    /// Points in the first run and in the second.
    pub points: [usize; 2],
    /// The greatest difference of the second from the first, where both are; null where they nowhere are.
    pub greatest: Option<f64>,
    /// Where that is.
    pub at: Option<f64>,
    /// The root mean square of the difference.
    pub rms: Option<f64>,
}

/// Two runs beside each other.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The first run.
    pub a: String,
    /// The second run.
    pub b: String,
    /// How many values of the summaries are the same.
    pub same: usize,
    /// Those that are not.
    pub differences: Vec<Difference>,
    /// Keys that the first summary has alone.
    pub only_in_a: Vec<String>,
    /// Keys that the second summary has alone.
    pub only_in_b: Vec<String>,
    /// Curves that both summaries have.
    pub curves: Vec<Curve>,
    /// Columns of numbers that both have rows of.
    pub distributions: Vec<Distribution>,
}

/// Compares two runs.
pub fn compare(a: &Side, b: &Side) -> Comparison {
    let only = |one: &Side, other: &Side| {
        let keys = one.summary.keys();
        keys.filter(|key| !other.summary.contains_key(*key))
            .cloned()
            .collect()
    };
    let mut same = 0;
    let mut differences = Vec::new();
    for (key, of_a) in &a.summary {
        match b.summary.get(key) {
            Some(of_b) if of_a == of_b => same += 1,
            Some(of_b) => differences.push(Difference {
                key: key.clone(),
                a: of_a.clone(),
                b: of_b.clone(),
                // A seed is a name, not a size.
                change: (key != "seed").then(|| change(of_a, of_b)).flatten(),
            }),
            None => {}
        }
    }
    Comparison {
        a: a.name.clone(),
        b: b.name.clone(),
        same,
        differences,
        only_in_a: only(a, b),
        only_in_b: only(b, a),
        curves: curves(a, b),
        distributions: distributions(a, b),
    }
}

fn curves(a: &Side, b: &Side) -> Vec<Curve> {
    let mut all = Vec::new();
    for (key, of_a) in &a.curves {
        let Some(of_b) = b.curves.get(key) else {
            continue;
        };
        let ((over, x_a), (other, x_b)) = (&of_a[0], &of_b[0]);
        if over != other {
            continue;
        }
        for (name, y_a) in &of_a[1..] {
            let Some((_, y_b)) = of_b.iter().find(|(n, _)| n == name) else {
                continue;
            };
            let differences: Vec<(f64, f64)> = x_a
                .iter()
                .zip(y_a)
                .filter_map(|(x, y)| Some((*x, between(x_b, y_b, *x)? - y)))
                .filter(|(_, d)| d.is_finite())
                .collect();
            let greatest = differences
                .iter()
                .max_by(|p, q| p.1.abs().total_cmp(&q.1.abs()));
            let squares: f64 = differences.iter().map(|(_, d)| d * d).sum();
            all.push(Curve {
                key: format!("{key}.{name}"),
                over: over.clone(),
                points: [y_a.len(), y_b.len()],
                greatest: greatest.map(|(_, d)| *d),
                at: greatest.map(|(x, _)| *x),
                rms: greatest.map(|_| (squares / differences.len() as f64).sqrt()),
            });
        }
    }
    all
}

/// A curve at `x`, between its points; `None` outside of them.
fn between(xs: &[f64], ys: &[f64], x: f64) -> Option<f64> {
    let after = xs.iter().position(|of| *of >= x)?;
    if xs[after] == x {
        return Some(ys[after]);
    }
    let before = after.checked_sub(1)?;
    let share = (x - xs[before]) / (xs[after] - xs[before]);
    Some(ys[before] + share * (ys[after] - ys[before]))
}

fn change(a: &Value, b: &Value) -> Option<f64> {
    let (a, b) = (a.as_f64()?, b.as_f64()?);
    (a != 0.0).then(|| (b - a) / a.abs())
}

fn distributions(a: &Side, b: &Side) -> Vec<Distribution> {
    let both = a.rows.iter().filter_map(|(name, of_a)| {
        let (_, of_b) = b.rows.iter().find(|(other, _)| other == name)?;
        let of_a = Sorted::new(of_a.clone());
        let of_b = Sorted::new(of_b.clone());
        let (distance, chance) = kolmogorov_smirnov(&of_a, &of_b)?;
        Some(Distribution {
            column: name.clone(),
            values: [of_a.values().len(), of_b.values().len()],
            percentiles: [of_a.percentiles(), of_b.percentiles()],
            distance,
            chance,
        })
    });
    both.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side(folder: &Path, summary: &str, samples: &str) -> Side {
        fs::write(folder.join("summary.json"), summary).unwrap();
        fs::write(folder.join("samples.csv"), samples).unwrap();
        Side::read(folder).unwrap()
    }

    #[test]
    fn what_differs_is_named_by_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let samples = "time_s,phase,v\n0,a,1\n1,b,2\n";
        let a = side(
            folder.path(),
            r#"{"x": {"y": [1, 2]}, "was": 1, "z": "s", "report": "here"}"#,
            samples,
        );
        let b = side(
            folder.path(),
            r#"{"x": {"y": [1, 3]}, "is": 1, "z": "s", "report": "there"}"#,
            samples,
        );
        let found = compare(&a, &b);
        assert_eq!(found.same, 2);
        assert_eq!(found.only_in_a, ["was"]);
        assert_eq!(found.only_in_b, ["is"]);
        let difference = &found.differences[0];
        assert_eq!(difference.key, "x.y[1]");
        assert_eq!(difference.change, Some(0.5));
        assert_eq!(found.differences.len(), 1);
        // Words are no curve.
        let names: Vec<_> = a.samples.iter().map(|c| c.0.as_str()).collect();
        assert_eq!(names, ["time_s", "v"]);
    }

    #[test]
    fn rows_of_numbers_are_a_curve_and_named_rows_keep_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let with = |gain: f64| {
            let rows =
                (0..10).map(|k| format!(r#"{{"gain": {}, "hz": {k}}}"#, gain * f64::from(k)));
            let rows: Vec<_> = rows.collect();
            let steps = r#"[{"name": "z", "v": 1}, {"name": "a", "v": 2}]"#;
            format!(r#"{{"response": [{}], "steps": {steps}}}"#, rows.join(","))
        };
        let a = side(folder.path(), &with(1.0), "t,x\n0,1\n");
        let b = side(folder.path(), &with(1.5), "t,x\n0,1\n");
        assert!(a.summary.contains_key("steps[z].v"), "{:?}", a.summary);
        let found = compare(&a, &b);
        assert!(found.differences.is_empty());
        let curve = &found.curves[0];
        assert_eq!(
            (curve.key.as_str(), curve.over.as_str()),
            ("response.gain", "hz")
        );
        assert_eq!((curve.greatest, curve.at), (Some(4.5), Some(9.0)));
    }

    #[test]
    fn a_run_without_a_summary_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = Side::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("summary.json"), "{error}");
    }
}
