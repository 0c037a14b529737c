//! Records that a person brings: columns of a CSV file.

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

/// A CSV file's columns, by name.
#[derive(Debug, Clone)]
pub struct Table {
    file: String,
    names: Vec<String>,
    rows: Vec<(u64, csv::StringRecord)>,
}

/// What is wrong with a CSV file.
pub(crate) fn explain_csv(file: &str, error: &csv::Error) -> Error {
    let line = error.position().map(|p| p.line() as usize);
    let message = match error.kind() {
        csv::ErrorKind::Io(error) => format!("cannot be read: {error}"),
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => format!("has {len} fields; accepted are {expected_len}, as in its first line"),
        csv::ErrorKind::Utf8 { .. } => "is no text; accepted is UTF-8".to_owned(),
        _ => error.to_string(),
    };
    Error {
        line,
        ..Error::new(file, "", message)
    }
}

impl Table {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// When it cannot be read, or is no CSV with a line of names and rows of as many fields.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file = path.display().to_string();
        let bad = |error: csv::Error| explain_csv(&file, &error);
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_path(path)
            .map_err(bad)?;
        let names: Vec<String> = reader
            .headers()
            .map_err(bad)?
            .iter()
            .map(str::to_owned)
            .collect();
        let mut rows = Vec::new();
        for row in reader.into_records() {
            let row = row.map_err(bad)?;
            rows.push((row.position().map_or(0, csv::Position::line), row));
        }
        Ok(Self { file, names, rows })
    }

    /// Whether there is a column of that name.
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// The numbers of a column.
    ///
    /// # Errors
    ///
    /// When there is no such column, or a field of it is no number.
    pub fn column(&self, name: &str) -> Result<Vec<f64>, Error> {
        let Some(i) = self.names.iter().position(|n| n == name) else {
            let message = format!("no such column; there are {}", self.names.join(", "));
            return Err(Error::new(&self.file, name, message));
        };
        self.rows
            .iter()
            .map(|(line, row)| {
                let field = &row[i];
                let refused = |why: &str| Error {
                    line: Some(*line as usize),
                    ..Error::new(
                        &self.file,
                        name,
                        format!("\"{field}\" is {why}; accepted is a finite number"),
                    )
                };
                let value: f64 = field.parse().map_err(|_| refused("no number"))?;
                if value.is_finite() {
                    Ok(value)
                } else {
                    Err(refused("not finite"))
                }
            })
            .collect()
    }

    /// The time of each sample, seconds, and the column it came from: the named one, or one with a
    /// usual name, or none.
    ///
    /// # Errors
    ///
    /// When a column that is named is not there, or is not of numbers that rise.
    pub fn time(&self, named: Option<&str>) -> Result<(Vec<f64>, Option<String>), Error> {
        let usual = || TIMES.iter().find(|name| self.has(name)).copied();
        let Some(name) = named.or_else(usual) else {
            return Ok(((0..self.rows.len()).map(|k| k as f64).collect(), None));
        };
        let time = self.column(name)?;
        if let Some(k) = time.windows(2).position(|w| w[1] <= w[0]) {
            let message = format!(
                "{} comes after {}; accepted is time that rises throughout",
                time[k + 1],
                time[k]
            );
            return Err(Error {
                line: Some(self.rows[k + 1].0 as usize),
                ..Error::new(&self.file, name, message)
            });
        }
        Ok((time, Some(name.to_owned())))
    }

    /// A record of these columns; displacement times `scale`.
    ///
    /// # Errors
    ///
    /// When a column is missing, or the record is none that a model could be made of or tried on.
    pub fn record(&self, columns: &Columns, scale: f64) -> Result<(Record, Columns), Error> {
        let input = self.column(&columns.input)?;
        let output: Vec<f64> = self
            .column(&columns.output)?
            .into_iter()
            .map(|x| scale * x)
            .collect();
        if columns.input == columns.output {
            let message = "is both input and output; accepted are two columns";
            return Err(Error::new(&self.file, &columns.input, message));
        }
        let (time, name) = self.time(columns.time.as_deref())?;
        let found = Columns {
            time: name,
            ..columns.clone()
        };
        let record =
            Record::new(time, input, output).map_err(|invalid| self.explain(&invalid, &found))?;
        Ok((record, found))
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
        Error::new(&self.file, key, message)
    }
}
