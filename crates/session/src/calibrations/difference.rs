//! A calibration as a person reads it, and where two of them differ.

use super::belief::{Belief, SHORT};
use pigtail_hal::Error;
use pigtail_hal::digest::hash;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use toml::Value;

/// A table of a calibration. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TableRow {
    /// Its dotted name.
    pub table: String,
    /// When it was found, where it says so.
    pub date: Option<String>,
    /// By which run, where it says so.
    pub origin: Option<String>,
    /// Its other keys: numbers to four digits, long arrays by how many values they have.
    pub keys: BTreeMap<String, String>,
}

/// A key in which two calibrations differ. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// The table, dotted.
    pub table: String,
    /// The key in it.
    pub key: String,
    /// What it was; `null` where it was not there.
    pub old: Option<String>,
    /// What it is; `null` where it is not there.
    pub new: Option<String>,
}

/// The tables by name, and their values by key.
type Tables = BTreeMap<String, BTreeMap<String, Value>>;

fn tables(belief: &Belief) -> Result<Tables, Error> {
    let root: toml::Table = toml::from_str(&belief.text)
        .map_err(|error| Error::new(&belief.name, "", error.message().to_owned()))?;
    let mut all = Tables::new();
    add(&mut all, "", root);
    for (name, table) in &mut all {
        // The same name may hold other weights.
        if let Some(Value::String(file)) = table.get_mut("weights")
            && name.starts_with("hysteresis.")
            && let Some((_, content)) = belief.weights.iter().find(|(name, _)| name == file)
        {
            *file = format!("{file} (sha {})", &hash(content)[..SHORT]);
        }
    }
    Ok(all)
}

fn add(all: &mut Tables, name: &str, table: toml::Table) {
    for (key, value) in table {
        let inside = if name.is_empty() {
            key.clone()
        } else {
            format!("{name}.{key}")
        };
        match value {
            Value::Table(table) => add(all, &inside, table),
            Value::Array(array) if array.iter().any(Value::is_table) => {
                for (i, value) in array.into_iter().enumerate() {
                    if let Value::Table(table) = value {
                        add(all, &format!("{inside}[{i}]"), table);
                    }
                }
            }
            value => {
                all.entry(name.to_owned()).or_default().insert(key, value);
            }
        }
    }
}

/// Longer arrays are summed up.
const LONG: usize = 4;

/// A value in a few characters.
fn short(value: &Value) -> String {
    match value {
        Value::String(text) => match text.split_once(' ') {
            Some((number, unit)) => match number.parse::<f64>() {
                Ok(number) => format!("{} {unit}", four_digits(number)),
                Err(_) => text.clone(),
            },
            None => text.clone(),
        },
        Value::Float(number) => four_digits(*number),
        Value::Array(values) if values.len() > LONG => format!("{} values", values.len()),
        Value::Array(values) => {
            let all: Vec<_> = values.iter().map(short).collect();
            format!("[{}]", all.join(", "))
        }
        other => other.to_string(),
    }
}

fn four_digits(number: f64) -> String {
    let rounded: f64 = format!("{number:.3e}").parse().unwrap_or(number);
    if rounded != 0.0 && !(1e-3..1e5).contains(&rounded.abs()) {
        format!("{rounded:e}")
    } else {
        rounded.to_string()
    }
}

/// A value in full, or what tells it from another that is as short.
fn exact(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(values) if values.len() > LONG => {
            let sha = hash(value.to_string());
            format!("{} values (sha {})", values.len(), &sha[..SHORT])
        }
        other => other.to_string(),
    }
}

/// The tables of a calibration, by name.
///
/// # Errors
///
/// When it is not TOML.
pub fn rows(belief: &Belief) -> Result<Vec<TableRow>, Error> {
    let row = |(table, mut keys): (String, BTreeMap<String, Value>)| {
        let mut said = |key: &str| keys.remove(key).as_ref().map(exact);
        TableRow {
            date: said("date"),
            origin: said("origin"),
            keys: keys.iter().map(|(k, v)| (k.clone(), short(v))).collect(),
            table,
        }
    };
    Ok(tables(belief)?.into_iter().map(row).collect())
}

/// The newest date in the text of a calibration; of what is not TOML there is none.
pub(crate) fn newest_date(text: &str) -> Option<String> {
    let rows = rows(&Belief::of("", text.to_owned(), |_| None)).ok()?;
    rows.into_iter().filter_map(|row| row.date).max()
}

/// The keys in which two calibrations differ, by table.
///
/// # Errors
///
/// When one of them is not TOML.
pub fn differences(old: &Belief, new: &Belief) -> Result<Vec<Difference>, Error> {
    let (old, new) = (tables(old)?, tables(new)?);
    let nothing = BTreeMap::new();
    let mut all = Vec::new();
    for table in old.keys().chain(new.keys()).collect::<BTreeSet<_>>() {
        let before = old.get(table).unwrap_or(&nothing);
        let after = new.get(table).unwrap_or(&nothing);
        for key in before.keys().chain(after.keys()).collect::<BTreeSet<_>>() {
            let (was, is) = (before.get(key), after.get(key));
            if was == is {
                continue;
            }
            let alike = was.map(short) == is.map(short);
            let told = if alike { exact } else { short };
            all.push(Difference {
                table: table.clone(),
                key: key.clone(),
                old: was.map(told),
                new: is.map(told),
            });
        }
    }
    Ok(all)
}
