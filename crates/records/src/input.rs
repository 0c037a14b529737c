//! What drives a simulation, from a file: a value from each moment on.

use crate::columns::{self, Named, TIME, Table, Wanted};
use pigtail_hal::Error;
use pigtail_hal::quantity::{ANGLE, Dimension, LENGTH, RATIO, VOLTAGE};
use std::path::Path;

/// What a file's values are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Voltages, V.
    Voltage,
    /// A reference: counts where no unit is known, else m or rad.
    Reference,
}

/// Values in the order of their moments.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Seconds, rising, and values in SI units or counts.
    pub rows: Vec<(f64, f64)>,
    /// What the values are of; a ratio for counts.
    pub of: Dimension,
    /// How the file was read, in words.
    pub understood: String,
}

/// Names under which values are found among more than two columns.
const VOLTAGES: [&str; 8] = [
    "u_V",
    "u",
    "voltage",
    "voltage_V",
    "V",
    "U",
    "Voltage",
    "command",
];
const REFERENCES: [&str; 8] = [
    "ref_count",
    "reference",
    "ref",
    "q_ref",
    "setpoint",
    "target",
    "desired",
    "Reference",
];

impl Kind {
    fn of(self) -> &'static [Dimension] {
        match self {
            Self::Voltage => &[VOLTAGE],
            Self::Reference => &[RATIO, LENGTH, ANGLE],
        }
    }

    fn option(self) -> &'static str {
        match self {
            Self::Voltage => "--input",
            Self::Reference => "--reference",
        }
    }

    fn names(self) -> [&'static str; 8] {
        match self {
            Self::Voltage => VOLTAGES,
            Self::Reference => REFERENCES,
        }
    }

    /// The column of values: the only one beside time, or one with a usual name, with or without a unit.
    fn column(self, table: &Table, time: &str) -> Result<Named, Error> {
        let others: Vec<&String> = table.names().iter().filter(|n| **n != time).collect();
        if let [only] = others[..] {
            return Ok(Named::new(only.clone()));
        }
        let bare = |name: &str| {
            let name = name.split(['[', '(']).next().unwrap_or_default().trim();
            name.rsplit_once('_')
                .map_or(name, |(bare, _)| bare)
                .to_owned()
        };
        let usual = |n: &&&String| {
            let names = self.names();
            names.contains(&n.as_str()) || names.contains(&&*bare(n))
        };
        let found: Vec<&&String> = others.iter().filter(usual).collect();
        if let [one] = found[..] {
            return Ok(Named::new((*one).clone()));
        }
        let message = format!(
            "has {} columns beside its times, and {} of them have a usual name for it; accepted is a file of \
             times and values alone, or a column called {}: there are {}",
            others.len(),
            found.len(),
            self.names()[1],
            table.names().join(", ")
        );
        Err(table.error(self.option(), message))
    }
}

/// Reads times and values. Rows without a value change nothing.
///
/// # Errors
///
/// When the file cannot be read, has no such columns, or time does not rise from zero.
pub fn read(path: &Path, kind: Kind, rate: Option<f64>) -> Result<Input, Error> {
    let table = Table::open(path)?;
    let time = match columns::usual_time(&table, rate) {
        Some(time) => time,
        None => Named::new(table.names().first().cloned().unwrap_or_default()),
    };
    let value = kind.column(&table, time.name())?;
    let list = [
        Wanted {
            option: "--time",
            named: &time,
            of: &[TIME],
        },
        Wanted {
            option: kind.option(),
            named: &value,
            of: kind.of(),
        },
    ];
    let read = columns::read(&table, &list)?;
    if read[1].dimension == RATIO
        && let Some(unit) = table.unit(table.place(value.name())?)
        && !RATIO.units.iter().any(|(own, _)| *own == unit)
    {
        let message = format!("is in {unit}; accepted are counts, lengths or angles");
        return Err(table.error(value.name(), message));
    }
    let understood = columns::understood(&table, &list, &read, None);
    columns::rising(path, &read[0])?;
    if let Some(early) = read[0].values.iter().find(|t| **t < 0.0) {
        let message = format!("time {early} s is below zero; accepted are times of zero or more");
        return Err(table.error(time.name(), message));
    }
    let rows: Vec<(f64, f64)> = read[0]
        .values
        .iter()
        .copied()
        .zip(read[1].values.iter().copied())
        .filter(|(t, v)| t.is_finite() && v.is_finite())
        .collect();
    if rows.is_empty() {
        return Err(table.error("", "has no rows; accepted is a row for each change"));
    }
    Ok(Input {
        rows,
        of: read[1].dimension,
        understood,
    })
}
