//! What drives a simulation, from a file: a value from each moment on.

use crate::columns::{self, Named, TIME, Table, Wanted, share, without_unit};
use pigtail_hal::Error;
use pigtail_hal::quantity::{ANGLE, Dimension, LENGTH, RATIO, VOLTAGE};
use pigtail_numerics::signal::quantile;
use pigtail_sysid::timeline::counted;
use std::fmt::Write as _;
use std::path::Path;

/// What a file's values are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Voltages, V.
    Voltage,
    /// A reference: counts where no unit is known, else m or rad.
    Reference,
}

/// Which columns of a file, where it does not tell.
#[derive(Debug, Clone, Default)]
pub struct Chosen {
    /// The column of times.
    pub time: Option<Named>,
    /// The column of values.
    pub value: Option<Named>,
    /// Rows a second, hertz.
    pub rate: Option<f64>,
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
            let name = without_unit(name);
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
             times and values alone, a column called {}, or its name as --column: there are {}",
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
pub fn read(path: &Path, kind: Kind, chosen: &Chosen) -> Result<Input, Error> {
    let table = Table::open(path)?;
    let time = match (&chosen.time, columns::usual_time(&table, chosen.rate)) {
        (Some(time), _) => columns::time_named(&table, Some(time), chosen.rate)?,
        (None, Some(time)) => time,
        (None, None) => Named::new(table.names().first().cloned().unwrap_or_default()),
    };
    let value = match &chosen.value {
        Some(value) => value.clone(),
        None => kind.column(&table, time.name())?,
    };
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
    let mut read = columns::read(&table, &list)?;
    let other = || {
        let unit = table.unit(table.place(value.name()).ok()?);
        unit.filter(|unit| !RATIO.units.iter().any(|(own, _)| own == unit))
    };
    if read[1].dimension == RATIO
        && let Some(unit) = other().or_else(|| share(value.name()))
    {
        let message = format!("is in {unit}; accepted are counts, lengths or angles");
        return Err(table.error(value.name(), message));
    }
    let mut understood = columns::understood(&table, &list, &read, None);
    columns::rising(path, &read[0])?;
    if let Some(day) = from_a_day(&mut read[0].values) {
        let _ = write!(understood, "; times are counted from the first, {day} s");
    }
    if let Some(early) = read[0].values.iter().find(|t| **t < 0.0) {
        let message = format!("time {early} s is below zero; accepted are times of zero or more");
        return Err(table.error(time.name(), message));
    }
    let all = read[0].values.iter().copied();
    let all = all.zip(read[1].values.iter().copied());
    let rows: Vec<(f64, f64)> = all
        .filter(|(t, v)| t.is_finite() && v.is_finite())
        .collect();
    let without = read[0].values.len() - rows.len();
    if without > 0 {
        let _ = write!(
            understood,
            "; {} without a value left out: what was before holds on",
            counted(without, "row")
        );
    }
    if let Some((often, longest)) = gaps(&rows) {
        let _ = write!(
            understood,
            "; {}, the longest {longest:.6} s, in which what was before holds on",
            counted(often, "gap")
        );
    }
    if rows.is_empty() {
        return Err(table.error("", "has no rows; accepted is a row for each change"));
    }
    Ok(Input {
        rows,
        of: read[1].dimension,
        understood,
    })
}

/// Counts times from the first one where that lies years behind zero: a clock said which day it was, and nobody simulates the time
/// since 1970. What the clock said.
fn from_a_day(times: &mut [f64]) -> Option<f64> {
    /// Three years.
    const YEARS: f64 = 1e8;
    let first = times.iter().copied().find(|t| t.is_finite());
    let first = first.filter(|t| *t > YEARS)?;
    for time in times {
        *time -= first;
    }
    Some(first)
}

/// How many gaps there are in rows that are taken evenly but for these, and the longest, seconds. Rows of changes come as they like.
fn gaps(rows: &[(f64, f64)]) -> Option<(usize, f64)> {
    /// Share of the steps that are alike, and by how much of one.
    const EVENLY: f64 = 0.9;
    const ALIKE: f64 = 0.01;
    let steps: Vec<f64> = rows.windows(2).map(|w| w[1].0 - w[0].0).collect();
    let usual = quantile(&steps, 0.5);
    let alike = |s: &&f64| (**s - usual).abs() <= ALIKE * usual;
    if steps.len() < 10 || (steps.iter().filter(alike).count() as f64) < EVENLY * steps.len() as f64
    {
        return None;
    }
    let long: Vec<f64> = steps.into_iter().filter(|s| *s > 1.5 * usual).collect();
    let longest = long.iter().copied().fold(0.0, f64::max);
    (!long.is_empty()).then_some((long.len(), longest))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Input, Error> {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("r.csv");
        std::fs::write(&path, text).expect("a file");
        read(&path, Kind::Reference, &Chosen::default())
    }

    #[test]
    fn times_of_a_day_are_counted_from_the_first() {
        let input = read_text("t_s,ref\n1700000000.5,1\n1700000001,2\n").expect("an input");
        let times: Vec<f64> = input.rows.iter().map(|r| r.0).collect();
        assert_eq!(times, [0.0, 0.5]);
        assert!(
            input.understood.contains("counted from the first"),
            "{}",
            input.understood
        );
    }

    #[test]
    fn columns_may_be_chosen() {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("r.csv");
        std::fs::write(&path, "n,a,b,\n0,1,2,\n1,3,4,\n").expect("a file");
        let chosen = Chosen {
            time: Some(Named::new("n")),
            value: Some(Named::new("b")),
            rate: Some(100.0),
        };
        let input = read(&path, Kind::Reference, &chosen).expect("an input");
        assert_eq!(input.rows, [(0.0, 2.0), (0.01, 4.0)]);
    }

    #[test]
    fn rows_without_a_value_and_gaps_are_said() {
        let mut text = "t_s,ref_um\n".to_owned();
        for k in (0..100).filter(|k| !(40..50).contains(k)) {
            let value = if k == 20 {
                "NaN".to_owned()
            } else {
                k.to_string()
            };
            let _ = writeln!(text, "{},{value}", 0.001 * f64::from(k));
        }
        let input = read_text(&text).expect("an input");
        assert_eq!(input.rows.len(), 89);
        let said = &input.understood;
        assert!(
            said.contains("1 row without a value left out") && said.contains("2 gaps, the longest"),
            "{said}"
        );
        let whole = read_text("t_s,ref_um\n0,0\n0.5,10\n7,20\n").expect("rows of changes");
        assert!(!whole.understood.contains("gap"), "{}", whole.understood);
    }

    #[test]
    fn a_column_that_is_called_after_its_unit_is_in_it() {
        let input = read_text("ms,um\n0,0\n10,5\n").expect("an input");
        assert_eq!(input.of, LENGTH);
        let (time, way) = input.rows[1];
        assert!((time - 0.01).abs() < 1e-12 && (way - 5e-6).abs() < 1e-15);
    }
}
