//! The one reader of CSV files that a person brings: columns by name, in SI units where they have one.

use pigtail_hal::Error;
use pigtail_hal::quantity::{
    ANGLE, Dimension, FORCE, FREQUENCY, LENGTH, LEVEL, RATIO, TIME, TORQUE, VOLTAGE,
};
use pigtail_sysid::timeline::{Even, Uneven, even};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// What a column may be of, each in any of its units.
const DIMENSIONS: [Dimension; 9] = [
    TIME, LENGTH, ANGLE, VOLTAGE, FORCE, TORQUE, FREQUENCY, RATIO, LEVEL,
];

/// A unit of places in a file.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
    Serialize,
    Deserialize,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum LengthUnit {
    /// Nanometres
    Nm,
    /// Micrometres
    Um,
    /// Millimetres
    Mm,
    /// Metres
    M,
}

impl LengthUnit {
    /// Metres in one.
    pub fn metres(self) -> f64 {
        LENGTH.unit(self.into()).map_or(1.0, |(_, metres)| metres)
    }

    /// Micrometres in one.
    pub fn micrometres(self) -> f64 {
        1e6 * self.metres()
    }
}

/// A column as it is named on a command line: `NAME` or `NAME:UNIT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named(String);

impl FromStr for Named {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            return Err("is empty; accepted is the name of a column".to_owned());
        }
        Ok(Self(text.trim().to_owned()))
    }
}

impl Named {
    /// A column by its name alone.
    pub fn new(name: impl Into<String>) -> Self {
        Self(name.into())
    }
}

/// What a command wants of a column.
#[derive(Debug, Clone)]
pub struct Wanted<'a> {
    /// The option that named it.
    pub option: &'static str,
    /// What was given.
    pub named: &'a Named,
    /// Of what it may be; the first is what it is where no unit is known.
    pub of: &'a [Dimension],
}

/// A column that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name in the file.
    pub name: String,
    /// Its unit there.
    pub unit: &'static str,
    /// What it is of.
    pub dimension: Dimension,
    /// Its values in SI units; NaN where the file has none.
    pub values: Vec<f64>,
    /// How the unit came to be known.
    pub by: By,
}

/// How a unit came to be known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// It was given with the column.
    Option,
    /// The column's name ends with it.
    Name,
    /// It was assumed.
    Nothing,
}

/// Share of rows without a value above which a column is none.
const MISSING: f64 = 0.2;

/// Names under which a column of time is found where none is named.
const TIMES: [&str; 7] = ["t_s", "time_s", "t", "time", "Time", "t_ms", "time_ms"];

/// A unit by its name, of one of these dimensions.
fn unit_of(dimensions: &[Dimension], name: &str) -> Option<(Dimension, &'static str)> {
    dimensions
        .iter()
        .find_map(|dimension| Some((*dimension, dimension.unit(name)?.0)))
}

/// What a column's name ends with.
fn of_name(name: &str) -> Option<(Dimension, &'static str)> {
    let bracketed = name
        .strip_suffix([']', ')'])
        .and_then(|rest| rest.rsplit_once(['[', '(']))
        .map(|(_, unit)| unit);
    let suffix = bracketed.or_else(|| name.rsplit_once('_').map(|(_, unit)| unit))?;
    unit_of(&DIMENSIONS, suffix.trim())
}

/// A CSV file whose first line names its columns. Lines that begin with `#` are comments.
#[derive(Debug, Clone)]
pub struct Table {
    path: PathBuf,
    names: Vec<String>,
}

/// Whether a field may be without a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gaps {
    /// It may: NaN.
    Allowed,
    /// Every field is a number.
    Refused,
}

/// Numbers of some columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers {
    /// The line of each row.
    pub lines: Vec<usize>,
    /// The columns, in the order in which they were asked for.
    pub columns: Vec<Vec<f64>>,
}

impl Table {
    /// Reads the names of a file's columns.
    ///
    /// # Errors
    ///
    /// When it cannot be read.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let headers = reader(path)
            .and_then(|mut reader| reader.headers().cloned())
            .map_err(|error| explain(path, &error))?;
        Ok(Self {
            path: path.to_owned(),
            names: headers.iter().map(str::to_owned).collect(),
        })
    }

    /// The names of its columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether there is a column of that name.
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// Which column has that name.
    ///
    /// # Errors
    ///
    /// When none has.
    pub fn place(&self, name: &str) -> Result<usize, Error> {
        let place = self.names.iter().position(|n| n == name);
        place.ok_or_else(|| {
            let message = format!("no such column; there are {}", self.names.join(", "));
            self.error(name, message)
        })
    }

    /// What is wrong with a column; with the file where `name` is empty.
    pub fn error(&self, name: impl Into<String>, message: impl Into<String>) -> Error {
        Error::new(self.path.display().to_string(), name, message)
    }

    /// The numbers of some columns.
    ///
    /// # Errors
    ///
    /// When a row has more or fewer fields than the first line, or a field is no number.
    pub fn numbers(&self, places: &[usize], gaps: Gaps) -> Result<Numbers, Error> {
        let accepted = match gaps {
            Gaps::Allowed => "a finite number, or nothing where one is missing",
            Gaps::Refused => "a finite number",
        };
        let mut lines = Vec::new();
        let mut columns = vec![Vec::new(); places.len()];
        let reader = reader(&self.path).map_err(|error| explain(&self.path, &error))?;
        for_each_row(&self.path, reader, |line, row| {
            for (place, column) in places.iter().zip(&mut columns) {
                let value = number(&row[*place], gaps).map_err(|(text, why)| Error {
                    line: Some(line),
                    ..self.error(
                        &*self.names[*place],
                        format!("\"{text}\" is {why}; accepted is {accepted}"),
                    )
                })?;
                column.push(value);
            }
            lines.push(line);
            Ok(())
        })?;
        Ok(Numbers { lines, columns })
    }
}

fn reader(path: &Path) -> csv::Result<csv::Reader<std::fs::File>> {
    csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_path(path)
}

fn for_each_row(
    path: &Path,
    mut reader: csv::Reader<std::fs::File>,
    mut see: impl FnMut(usize, &csv::ByteRecord) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut row = csv::ByteRecord::new();
    while reader
        .read_byte_record(&mut row)
        .map_err(|error| explain(path, &error))?
    {
        let line = row.position().map_or(0, |p| p.line() as usize);
        see(line, &row)?;
    }
    Ok(())
}

/// The line and the first `N` fields of each row below the first line, whatever that says. `what` such
/// a row is of, as an error message says it: `time and voltage`.
///
/// # Errors
///
/// When the file cannot be read, or a row does not begin with `N` numbers.
pub fn rows<const N: usize>(path: &Path, what: &str) -> Result<Vec<(usize, [f64; N])>, Error> {
    let reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .has_headers(false)
        .flexible(true)
        .from_path(path)
        .map_err(|error| explain(path, &error))?;
    let mut rows = Vec::new();
    for_each_row(path, reader, |line, row| {
        if line == 1 {
            return Ok(());
        }
        let mut values = [0.0; N];
        for (k, value) in values.iter_mut().enumerate() {
            let field = row.get(k).unwrap_or_default();
            *value = number(field, Gaps::Refused).map_err(|(text, why)| {
                let message =
                    format!("\"{text}\" is {why}; accepted is a row of {what}: {N} finite numbers");
                Error {
                    line: Some(line),
                    ..Error::new(path.display().to_string(), "", message)
                }
            })?;
        }
        rows.push((line, values));
        Ok(())
    })?;
    Ok(rows)
}

/// What is wrong with a CSV file.
fn explain(path: &Path, error: &csv::Error) -> Error {
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
        ..Error::new(path.display().to_string(), "", message)
    }
}

/// The column of time: the named one, or one with a usual name.
///
/// # Errors
///
/// When the file cannot be read, or no column was named and none has a usual name.
pub fn time_named(path: &Path, given: Option<&Named>) -> Result<Named, Error> {
    if let Some(given) = given {
        return Ok(given.clone());
    }
    let table = Table::open(path)?;
    usual(&table).ok_or_else(|| {
        let message = format!(
            "no column is named as time usually is; name one with --time: there are {}",
            table.names.join(", ")
        );
        table.error("--time", message)
    })
}

/// The column of time with a usual name, where there is one.
///
/// # Errors
///
/// When the file cannot be read.
pub fn usual_time(path: &Path) -> Result<Option<Named>, Error> {
    Ok(usual(&Table::open(path)?))
}

fn usual(table: &Table) -> Option<Named> {
    let name = TIMES.iter().find(|name| table.has(name));
    name.map(|name| Named::new(*name))
}

/// That a column of time rises wherever it has a value.
///
/// # Errors
///
/// When it does not.
pub fn rising(path: &Path, time: &Column) -> Result<(), Error> {
    let Some((k, last)) = first_fall(&time.values) else {
        return Ok(());
    };
    let message = format!(
        "time {} s comes after {last} s in data row {}; accepted is time that rises throughout",
        time.values[k],
        k + 1
    );
    Err(Error::new(path.display().to_string(), &time.name, message))
}

/// Columns, of which the first is time, on an even grid; `least` is how many samples are wanted.
///
/// # Errors
///
/// When time does not rise, or next to nothing is there.
pub(crate) fn on_even_grid(path: &Path, read: &[Column], least: usize) -> Result<Even, Error> {
    let columns: Vec<&[f64]> = read[1..].iter().map(|c| &c.values[..]).collect();
    even(&read[0].values, &columns).map_err(|uneven| {
        let message = match uneven {
            Uneven::Falls { .. } => format!("{uneven}; accepted is time that rises throughout"),
            Uneven::TooShort(_) => format!("{uneven}; accepted are at least {least}"),
        };
        Error::new(path.display().to_string(), &read[0].name, message)
    })
}

/// The first time that is not later than the one before it, and that one; none is where a value is
/// missing.
pub(crate) fn first_fall(times: &[f64]) -> Option<(usize, f64)> {
    let mut last = f64::NEG_INFINITY;
    for (k, value) in times.iter().enumerate() {
        if *value <= last {
            return Some((k, last));
        }
        if value.is_finite() {
            last = *value;
        }
    }
    None
}

/// Reads columns of a file.
///
/// # Errors
///
/// When the file cannot be read, a column is not there or named twice, its unit is of something else, a
/// field is no number, or too many have no value.
pub fn read(path: &Path, wanted: &[Wanted]) -> Result<Vec<Column>, Error> {
    let table = Table::open(path)?;
    let mut places = Vec::with_capacity(wanted.len());
    let mut columns = Vec::with_capacity(wanted.len());
    for want in wanted {
        let (place, column) = locate(&table, want)?;
        if let Some(k) = places.iter().position(|p| *p == place) {
            let message = format!(
                "is named twice, by {} and {}; accepted are different columns",
                wanted[k].option, want.option
            );
            return Err(table.error(&*table.names[place], message));
        }
        places.push(place);
        columns.push(column);
    }
    let numbers = table.numbers(&places, Gaps::Allowed)?;
    for (column, mut values) in columns.iter_mut().zip(numbers.columns) {
        let (_, size) = column.dimension.unit(column.unit).unwrap_or(("", 1.0));
        for value in &mut values {
            *value *= size;
        }
        column.values = values;
    }
    for column in &columns {
        let rows = column.values.len();
        if rows == 0 {
            return Err(table.error("", "has no rows below its line of names"));
        }
        let missing = column.values.iter().filter(|v| v.is_nan()).count();
        if missing as f64 > MISSING * rows as f64 {
            let message = format!(
                "{missing} of {rows} rows have no value; accepted are at most {:.0} %",
                100.0 * MISSING
            );
            return Err(table.error(&*column.name, message));
        }
    }
    Ok(columns)
}

/// A number, NaN where there is none.
fn number(field: &[u8], gaps: Gaps) -> Result<f64, (String, &'static str)> {
    let text = std::str::from_utf8(field)
        .map_err(|_| (String::from_utf8_lossy(field).into_owned(), "no text"))?;
    let missing = ["", "nan", "na", "n/a", "null", "-"];
    if gaps == Gaps::Allowed && missing.iter().any(|m| text.eq_ignore_ascii_case(m)) {
        return Ok(f64::NAN);
    }
    let value: f64 = text.parse().map_err(|_| (text.to_owned(), "no number"))?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err((text.to_owned(), "not finite"))
    }
}

fn locate(table: &Table, want: &Wanted) -> Result<(usize, Column), Error> {
    let text = &want.named.0;
    let names = &table.names;
    let find = |name: &str| names.iter().position(|n| n == name);
    let (place, given) = match (find(text), text.rsplit_once(':')) {
        (Some(place), _) => (place, None),
        (None, Some((name, unit))) if find(name).is_some() => {
            (find(name).unwrap_or_default(), Some(unit.trim()))
        }
        _ => {
            let message = format!(
                "no such column for {}; there are {}",
                want.option,
                names.join(", ")
            );
            return Err(table.error(&**text, message));
        }
    };
    let name = &names[place];
    let accepted = || {
        let units = want.of.iter().flat_map(|dimension| dimension.units);
        let names: Vec<&str> = units.map(|(unit, _)| *unit).collect();
        names.join(", ")
    };
    let suffix = of_name(name);
    let (dimension, unit, by) = match (given, suffix) {
        (Some(given), _) => {
            let Some((dimension, unit)) = unit_of(want.of, given) else {
                let message = format!(
                    "{} cannot be in \"{given}\"; accepted is {}",
                    want.option,
                    accepted()
                );
                return Err(table.error(&**name, message));
            };
            if let Some((_, own)) = suffix.filter(|(of, own)| *own != unit && want.of.contains(of))
            {
                let message = format!(
                    "is said to be in {given}, but its name says {own}; accepted is one of both: give the unit \
                     that its name has, or rename the column"
                );
                return Err(table.error(&**name, message));
            }
            (dimension, unit, By::Option)
        }
        (None, Some((dimension, unit))) if want.of.contains(&dimension) => {
            (dimension, unit, By::Name)
        }
        // A magnitude may be of anything over anything.
        (None, Some(_)) if want.of.contains(&RATIO) => (RATIO, RATIO.si(), By::Name),
        (None, Some((_, unit))) => {
            let message = format!(
                "its name says {unit}, which is no unit for {}; accepted is a column in {}, or its unit as \
                 \"{name}:UNIT\"",
                want.option,
                accepted()
            );
            return Err(table.error(&**name, message));
        }
        (None, None) => (want.of[0], want.of[0].si(), By::Nothing),
    };
    let column = Column {
        name: name.clone(),
        unit,
        dimension,
        values: Vec::new(),
        by,
    };
    Ok((place, column))
}

/// A remark for each column whose unit had to be assumed.
pub fn remarks(columns: &[Column]) -> Vec<String> {
    columns
        .iter()
        .filter(|c| c.by == By::Nothing)
        .map(|c| format!("column {} taken as in {}", c.name, c.unit))
        .collect()
}

/// Where a record was and what was read of it: what a fragment keeps.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The file, as an absolute path where that can be told.
    pub file: PathBuf,
    /// Role and `NAME:UNIT` of each column.
    pub columns: Vec<(&'static str, String)>,
}

impl Source {
    /// Of columns that were read, with the options that named them.
    pub fn new(path: &Path, wanted: &[Wanted], columns: &[Column]) -> Self {
        Self {
            file: std::path::absolute(path).unwrap_or_else(|_| path.to_owned()),
            columns: wanted
                .iter()
                .zip(columns)
                .map(|(w, c)| {
                    (
                        w.option.trim_start_matches("--"),
                        format!("{}:{}", c.name, c.unit),
                    )
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn file(content: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("r.csv");
        fs::write(&path, content).expect("a file");
        (folder, path)
    }

    fn read_one(content: &str, named: &str, of: &[Dimension]) -> Result<Column, Error> {
        let (_folder, path) = file(content);
        let named = Named::new(named);
        let wanted = Wanted {
            option: "--position",
            named: &named,
            of,
        };
        Ok(read(&path, &[wanted])?.remove(0))
    }

    #[test]
    fn units_come_from_the_option_or_the_name_and_must_agree() {
        const LENGTHS: &[Dimension] = &[LENGTH, ANGLE];
        let of = |header: &str, named: &str| read_one(&format!("{header}\n2\n"), named, LENGTHS);
        let value = |c: Result<Column, Error>| c.expect("a column").values[0];
        assert!((value(of("x_mm", "x_mm")) - 2e-3).abs() < 1e-15);
        assert!((value(of("x [um]", "x [um]")) - 2e-6).abs() < 1e-18);
        assert!((value(of("x", "x:deg")) - 2.0_f64.to_radians()).abs() < 1e-12);
        assert!((value(of("x", "x")) - 2.0).abs() < 1e-12);
        for (header, named) in [("x_mm", "x_mm:m"), ("x", "x:V"), ("x_V", "x_V"), ("x", "y")] {
            assert!(of(header, named).is_err(), "{header} {named}");
        }
    }

    #[test]
    fn a_unit_of_places_is_one_of_length() {
        use strum::VariantArray;
        for unit in LengthUnit::VARIANTS {
            assert!(LENGTH.unit(unit.into()).is_some(), "{unit:?}");
        }
        assert_eq!(LengthUnit::Nm.micrometres(), 1e-3);
        assert_eq!(LengthUnit::Mm.micrometres(), 1e3);
    }

    #[test]
    fn missing_values_are_none_and_words_are_refused() {
        let of = |rows: &str| read_one(&format!("x\n{rows}"), "x", &[LENGTH]);
        let column = of("1\nNaN\n3\n4\n5\n6\n").expect("a column");
        assert!(column.values[1].is_nan() && column.values.len() == 6);
        let error = of("1\ntwo\n").expect_err("no number");
        assert!(error.to_string().contains("line 3") && error.to_string().contains("two"));
        assert!(of("1\nNA\nNA\n").is_err());
        assert!(of("").is_err());
        assert!(of("inf\n").is_err());
    }
}
