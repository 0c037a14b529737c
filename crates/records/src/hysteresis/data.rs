//! Records that a person brings: columns of a CSV file.

use crate::columns::{Gaps, Numbers, Table, first_fall};
use pigtail_control::compensation::hysteresis::{Invalid, Record};
use pigtail_hal::Error;
use std::path::Path;

/// Names under which a column of time is found where none is named.
const TIMES: [&str; 6] = ["t_s", "time_s", "t", "time", "Time", "T"];

/// Which columns of a file.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Columns {
    /// The voltage's.
    pub input: String,
    /// The displacement's.
    pub output: String,
    /// The time's; samples are a second apart where there is none.
    pub time: Option<String>,
}

/// A record's file.
#[derive(Debug, Clone)]
pub struct Data(Table);

impl Data {
    /// Reads the names of its columns.
    ///
    /// # Errors
    ///
    /// When it cannot be read.
    pub fn open(path: &Path) -> Result<Self, Error> {
        Table::open(path).map(Self)
    }

    /// Whether there is a column of that name.
    pub fn has(&self, name: &str) -> bool {
        self.0.has(name)
    }

    /// The column of time: the named one, or one with a usual name.
    fn time(&self, named: Option<&str>) -> Option<String> {
        let usual = || TIMES.iter().find(|name| self.has(name)).copied();
        named.or_else(usual).map(str::to_owned)
    }

    /// Time, and columns beside it.
    fn with_time(
        &self,
        names: &[&str],
        time: Option<&str>,
    ) -> Result<(Vec<f64>, Vec<Vec<f64>>), Error> {
        let all = names.iter().chain(&time);
        let places = all
            .map(|name| self.0.place(name))
            .collect::<Result<Vec<_>, _>>()?;
        let Numbers { lines, mut columns } = self.0.numbers(&places, Gaps::Refused)?;
        let Some(name) = time else {
            return Ok(((0..lines.len()).map(|k| k as f64).collect(), columns));
        };
        let times = columns.pop().unwrap_or_default();
        if let Some((k, last)) = first_fall(&times) {
            let message = format!(
                "{} comes after {last}; accepted is time that rises throughout",
                times[k]
            );
            return Err(Error {
                line: Some(lines[k]),
                ..self.0.error(name, message)
            });
        }
        Ok((times, columns))
    }

    /// A record of these columns; displacement times `scale`.
    ///
    /// # Errors
    ///
    /// When a column is missing, or the record is none that a model could be made of or tried on.
    pub fn record(&self, columns: &Columns, scale: f64) -> Result<(Record, Columns), Error> {
        let found = Columns {
            time: self.time(columns.time.as_deref()),
            ..columns.clone()
        };
        if columns.input == columns.output {
            self.0.place(&columns.input)?;
            let message = "is both input and output; accepted are two columns";
            return Err(self.0.error(&*columns.input, message));
        }
        let names = [&*columns.input, &*columns.output];
        let (time, mut read) = self.with_time(&names, found.time.as_deref())?;
        let output = read.pop().unwrap_or_default();
        let output = output.into_iter().map(|x| scale * x).collect();
        let input = read.pop().unwrap_or_default();
        let record =
            Record::new(time, input, output).map_err(|invalid| self.explain(&invalid, &found))?;
        Ok((record, found))
    }

    /// A path without voltages: its times, seconds, and displacements times `scale`.
    ///
    /// # Errors
    ///
    /// When a column is missing, is not of numbers, or there are no rows.
    pub fn path(&self, columns: &Columns, scale: f64) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let time = self.time(columns.time.as_deref());
        let (time, mut read) = self.with_time(&[&columns.output], time.as_deref())?;
        if time.is_empty() {
            let message = "has no rows; accepted is a path of at least one point";
            return Err(self.0.error("", message));
        }
        let output = read.pop().unwrap_or_default();
        Ok((time, output.into_iter().map(|x| scale * x).collect()))
    }

    /// An error about a record, in the names of its file.
    pub fn explain(&self, invalid: &Invalid, columns: &Columns) -> Error {
        let key = match invalid.what {
            "input" => columns.input.as_str(),
            "output" => columns.output.as_str(),
            "time" => columns.time.as_deref().unwrap_or_default(),
            _ => "",
        };
        let message = format!("{}; accepted is {}", invalid.value, invalid.accepted);
        self.0.error(key, message)
    }
}
