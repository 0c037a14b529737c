//! Models of an axis from a record that a person brings: what the commands answer.
//!
//! In go files as they come from somebody's bench, out come answers: parameters with units and how sure they
//! are, a verdict in a sentence, and what was assumed. It reads; what is found in columns of numbers is
//! `pigtail-sysid`'s business. Start with [`columns`], how a column is named and what unit it has:
//!
//! ```
//! use pigtail_records::columns::Named;
//!
//! let column: Named = "position:mm".parse()?;
//! # let _ = column;
//! # Ok::<(), String>(())
//! ```

mod arrays;
mod cells;
pub mod columns;
pub mod fragment;
pub mod friction;
pub mod hysteresis;
pub mod input;
mod layout;
pub mod map;
pub mod part;
pub mod resonance;
pub mod servo;
mod table;
pub mod twin;
mod units;
pub mod windup;

use pigtail_sysid::{Account, Parameter, Unknown};
use serde_json::{Map, Value, json};
use std::fmt::Write as _;

/// What an identification from a record answers, whatever it identified.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Answer {
    /// The parameters, each with its unit.
    pub parameters: Vec<(Parameter, String)>,
    /// Relative error on the record, per cent.
    pub relative_error_percent: Option<f64>,
    /// Relative error on what it was not fitted to, per cent.
    pub validation_error_percent: Option<f64>,
    /// Condition number of the equations.
    pub condition: Option<f64>,
    /// What to think of it, in a sentence.
    pub verdict: String,
    /// What cannot be known from the record.
    pub unknown: Vec<Unknown>,
    /// What was done to the record, and assumed of it.
    pub remarks: Vec<String>,
    /// What else there is to say, by its JSON key.
    pub more: Map<String, Value>,
}

/// Begins every verdict on what a record does not tell.
pub const NOT_IDENTIFIABLE: &str = "not identifiable from this record";

impl Answer {
    /// The answer where nothing can be known: the parameters by name and unit, without values.
    pub fn nothing(
        names: impl IntoIterator<Item = (&'static str, String)>,
        unknown: Unknown,
        remarks: &[String],
    ) -> Self {
        let names = names.into_iter();
        Self {
            parameters: names
                .map(|(name, unit)| (Parameter { name, known: None }, unit))
                .collect(),
            verdict: format!("{NOT_IDENTIFIABLE}, because {}", unknown.because),
            unknown: vec![unknown],
            remarks: remarks.to_vec(),
            ..Self::default()
        }
    }

    /// Whether every parameter is known.
    pub fn is_whole(&self) -> bool {
        self.unknown.is_empty() && self.parameters.iter().all(|(p, _)| p.known.is_some())
    }

    /// What the record does not tell of its parameters, as a sentence; `None` where it tells all.
    pub fn doubts(&self) -> Option<String> {
        let mut parts = Vec::new();
        for unknown in &self.unknown {
            let names: Vec<&str> = self
                .parameters
                .iter()
                .map(|(p, _)| p.name)
                .filter(|name| unknown.covers(name))
                .collect();
            if !names.is_empty() {
                parts.push(format!("{}, because {}", names.join(", "), unknown.because));
            }
        }
        (!parts.is_empty()).then(|| format!("{NOT_IDENTIFIABLE}: {}", parts.join("; ")))
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let mut document = json!({
            "parameters": parameters_json(&self.parameters, &self.unknown),
            "relative_error_percent": self.relative_error_percent,
            "validation_error_percent": self.validation_error_percent,
            "condition": self.condition,
            "verdict": self.verdict,
            "remarks": self.remarks,
        });
        if let Some(map) = document.as_object_mut() {
            map.extend(self.more.clone());
        }
        document
    }

    /// The parameters as lines of text: value, standard deviation, and in brackets the one with all that is
    /// correlated in what the model leaves.
    pub fn lines(&self) -> String {
        let mut text = String::new();
        for (parameter, unit) in &self.parameters {
            let _ = match parameter.known {
                Some(k) => {
                    let sure = if k.std.is_finite() {
                        format!(" +- {:>10} ({})", short(k.std), short(k.std_correlated))
                    } else {
                        // Nobody says how sure a fragment was.
                        String::new()
                    };
                    writeln!(
                        text,
                        "  {:28} {:>13}{sure} {unit}",
                        parameter.name,
                        short(k.value)
                    )
                }
                None => writeln!(text, "  {:28} {:>13}", parameter.name, "not known"),
            };
        }
        text
    }
}

/// Parameters, each with its unit.
fn with_units(parameters: &[Parameter], unit: impl Fn(&str) -> String) -> Vec<(Parameter, String)> {
    let with_unit = |p: &Parameter| (p.clone(), unit(p.name));
    parameters.iter().map(with_unit).collect()
}

/// Parameters with their units as JSON; of those that are not known, why.
fn parameters_json(parameters: &[(Parameter, String)], unknown: &[Unknown]) -> Map<String, Value> {
    let value = |(parameter, unit): &(Parameter, String)| {
        let value = if let Some(known) = parameter.known {
            json!({
                "value": known.value,
                "std": known.std,
                "unit": unit,
                "std_correlated": known.std_correlated,
            })
        } else {
            let why = unknown.iter().find(|u| u.covers(parameter.name));
            json!({
                "value": null,
                "std": null,
                "unit": unit,
                "because": why.map(|u| &u.because),
            })
        };
        (parameter.name.to_owned(), value)
    };
    parameters.iter().map(value).collect()
}

/// A parameter in a table: its value, plus or minus a standard deviation.
fn told(name: &str, value: f64, std: f64, unit: &str) -> String {
    let name = name.replace('_', " ").replace("coulomb", "Coulomb");
    format!("{name} {} ± {} {unit}", short(value), short(std))
}

/// Those of some samples that a figure shows: more than some thousand points look no different.
fn shown_of(samples: std::ops::Range<usize>) -> impl Iterator<Item = usize> {
    let every = samples.len().div_ceil(4000).max(1);
    samples.step_by(every)
}

/// A number with five significant digits; a dash for none.
pub fn short(value: f64) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        let digits = if value == 0.0 {
            1
        } else {
            (4 - value.abs().log10().floor() as i32).clamp(0, 8) as usize
        };
        format!("{value:.digits$}")
    } else {
        format!("{value:.4e}")
    }
}

/// A sentence with a capital.
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

/// A figure of a report: curves or points of a name, their axes, and what is to be seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What lies on x.
    pub x: String,
    /// What lies on y.
    pub y: String,
    /// Whether x is shown by its logarithm.
    pub log_x: bool,
    /// Curves by name.
    pub curves: Vec<(String, Vec<(f64, f64)>)>,
    /// The caption.
    pub caption: String,
}

/// A table of a report: its header and rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rows {
    /// What it is of.
    pub title: String,
    /// The first row.
    pub header: Vec<String>,
    /// The rest: texts, some of more lines than one.
    pub rows: Vec<Vec<String>>,
}

/// What a report shows beside the answer.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Shown {
    /// Measured and modelled.
    pub account: Account,
    /// What was measured, such as `force`, and its unit.
    pub quantity: (&'static str, &'static str),
    /// Unit of the position: `m`, `rad`.
    pub position: &'static str,
    /// Tables.
    pub tables: Vec<Rows>,
    /// Other figures.
    pub figures: Vec<Figure>,
}
