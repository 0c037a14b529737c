//! A file of columns and how it is written.

use crate::arrays::{self, Arrays};
use crate::cells;
use crate::columns::{DIMENSIONS, OTHER_UNITS, ending, of_name, unit_of};
use crate::layout::{self, Layout};
use pigtail_hal::Error;
use pigtail_hal::quantity::Dimension;
use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// A file of columns: text whose fields are divided by commas, semicolons, tabs, bars or blanks, Parquet, or MATLAB's
/// .mat up to version 7. What stands above the rows of a text may be anything; lines that begin with `#` or `%` are
/// comments.
#[derive(Debug, Clone)]
pub struct Table {
    path: PathBuf,
    layout: Layout,
    content: Content,
}

/// What a file holds.
#[derive(Debug, Clone)]
enum Content {
    Text(String),
    Arrays(Arrays),
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
    /// Reads a file and tells how it is written.
    ///
    /// # Errors
    ///
    /// When it cannot be read, or is no text of columns.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let refuse = |line, message: String| Error {
            line,
            ..Error::new(path.display().to_string(), "", message)
        };
        let bytes = std::fs::read(path)
            .map_err(|error| refuse(None, format!("cannot be read: {error}")))?;
        let found = if bytes.starts_with(b"PAR1") {
            let file = std::fs::File::open(path)
                .map_err(|error| refuse(None, format!("cannot be read: {error}")))?;
            Some(arrays::parquet(file))
        } else if bytes.starts_with(b"MATLAB 5.0") {
            Some(arrays::mat(&bytes))
        } else {
            None
        };
        if let Some(found) = found {
            let arrays = found.map_err(|message| refuse(None, message))?;
            return Ok(Self {
                path: path.to_owned(),
                layout: Layout::of_arrays(arrays.names.clone(), arrays.kind, arrays.period),
                content: Content::Arrays(arrays),
            });
        }
        if let Some(what) = binary(&bytes) {
            let message = format!(
                "is {what}; accepted is text, Parquet, or .mat of version 5 to 7: columns of numbers"
            );
            return Err(refuse(None, message));
        }
        let (mut text, encoding) = layout::decode(bytes);
        if !text.contains('\n') {
            // Lines as Macs ended them.
            text = text.replace('\r', "\n");
        }
        if text.trim().is_empty() {
            return Err(refuse(
                None,
                "is empty; accepted are columns of numbers".to_owned(),
            ));
        }
        if let Some((line, code)) = not_text(&text) {
            let message = format!(
                "has a character of number {code}, which no text has; accepted is text, Parquet, or .mat of version 5 to 7"
            );
            return Err(refuse(Some(line), message));
        }
        let is_unit =
            |unit: &str| unit_of(&DIMENSIONS, unit).is_some() || OTHER_UNITS.contains(&unit);
        let layout = layout::layout(&text, encoding, is_unit).ok_or_else(|| {
            refuse(
                None,
                "has no rows of numbers; accepted are columns of them, divided by commas, semicolons, tabs, bars or \
                 blanks"
                    .to_owned(),
            )
        })?;
        if let Some((line, count)) = layout.other {
            let mut message = format!(
                "has {} fields; accepted are {count}, as in {}",
                layout.names.len(),
                if line == 1 {
                    "its first line".to_owned()
                } else {
                    format!("line {line}")
                }
            );
            if layout.delimiter == b',' && 2 * count == layout.names.len() {
                message += ": are there commas between the fields and in the numbers? Semicolons or tabs between them \
                            tell which is which";
            }
            return Err(refuse(Some(layout.first_line), message));
        }
        Ok(Self {
            path: path.to_owned(),
            layout,
            content: Content::Text(text),
        })
    }

    /// Keeps how it is written and forgets its rows: they are read, and those of a long record are large.
    pub(crate) fn forget(&mut self) {
        self.content = Content::Text(String::new());
    }

    /// How the file is written, in words.
    pub fn understood(&self) -> String {
        self.layout.understood()
    }

    /// Seconds between its rows, where the lines above them say so.
    pub fn period(&self) -> Option<f64> {
        self.layout.period
    }

    fn rows(
        &self,
        mut see: impl FnMut(usize, &[Cow<str>]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let width = self.layout.names.len();
        let Content::Text(text) = &self.content else {
            return Ok(());
        };
        let body = text.get(self.layout.body..).unwrap_or_default();
        let mut row = Vec::with_capacity(width);
        for (k, line) in body.lines().enumerate() {
            if let None | Some(b'#' | b'%') = line.trim_start().as_bytes().first() {
                if line.trim_end().ends_with("END_HEADER") {
                    let message =
                        "another recording begins here; accepted is one recording in a file";
                    return Err(Error {
                        line: Some(self.layout.first_line + k),
                        ..self.error("", message)
                    });
                }
                continue;
            }
            cells::split_into(line, self.layout.delimiter, &mut row);
            let number = self.layout.first_line + k;
            if self.layout.trailing && row.len() == width + 1 {
                row.pop();
            }
            if row.len() != width {
                let message = format!(
                    "has {} fields; accepted are {width}, as in {}",
                    row.len(),
                    match self.layout.names_line {
                        Some(1) => "its first line".to_owned(),
                        Some(line) => format!("line {line}"),
                        None => "the other rows".to_owned(),
                    }
                );
                return Err(Error {
                    line: Some(number),
                    ..self.error("", message)
                });
            }
            see(number, &row)?;
        }
        Ok(())
    }

    /// The names of its columns.
    pub fn names(&self) -> &[String] {
        &self.layout.names
    }

    /// Whether there is a column of that name.
    pub fn has(&self, name: &str) -> bool {
        self.layout.names.iter().any(|n| n == name)
    }

    /// Which column has that name.
    ///
    /// # Errors
    ///
    /// When none has.
    pub fn place(&self, name: &str) -> Result<usize, Error> {
        let place = self.names().iter().position(|n| n == name);
        place.ok_or_else(|| self.error(name, format!("no such column; {}", self.there_are())))
    }

    /// The names, as an error says them, and how they were read.
    pub(crate) fn there_are(&self) -> String {
        let mut text = format!(
            "there are {} (read as {})",
            self.names().join(", "),
            self.understood()
        );
        if let Content::Arrays(arrays) = &self.content {
            for (name, length) in &arrays.left_out {
                let _ = write!(
                    text,
                    "; {name} is left out: it has {length} values, and the others another number"
                );
            }
        }
        text
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
        let text = match &self.content {
            Content::Arrays(arrays) => return self.of_arrays(arrays, places, gaps),
            Content::Text(text) => text,
        };
        // About as many as there are, by the length of the first one.
        let body = text.get(self.layout.body..).unwrap_or_default();
        let rows = body.len() / (body.lines().next().map_or(0, str::len) + 1);
        let mut lines = Vec::with_capacity(rows);
        let mut columns = vec![Vec::with_capacity(rows); places.len()];
        let headed = |place: usize, field: &str| {
            field == self.layout.names[place] && self.layout.names_line.is_some()
        };
        // Of a column of moments, the first one.
        let mut first: Vec<Option<i128>> = vec![None; places.len()];
        self.rows(|line, row| {
            for ((place, column), first) in places.iter().zip(&mut columns).zip(&mut first) {
                let field = &*row[*place];
                let value =
                    number(field, gaps, self.layout.decimal_comma, first).map_err(|why| {
                        let message = if headed(*place, field) {
                            "the names of the columns stand here again, as where several recordings were written into \
                             one file; accepted is one recording in a file"
                                .to_owned()
                        } else {
                            format!("\"{field}\" {why}; accepted is {accepted}")
                        };
                        Error {
                            line: Some(line),
                            ..self.error(&*self.layout.names[*place], message)
                        }
                    })?;
                column.push(value);
            }
            lines.push(line);
            Ok(())
        })?;
        Ok(Numbers { lines, columns })
    }

    fn of_arrays(&self, arrays: &Arrays, places: &[usize], gaps: Gaps) -> Result<Numbers, Error> {
        let columns: Vec<Vec<f64>> = places.iter().map(|p| arrays.columns[*p].clone()).collect();
        for (place, column) in places.iter().zip(&columns) {
            let name = &*self.layout.names[*place];
            if let Some(what) = arrays.others[*place] {
                let message = format!("holds {what}; accepted are numbers");
                return Err(self.error(name, message));
            }
            let bad = |v: &f64| v.is_infinite() || (gaps == Gaps::Refused && v.is_nan());
            if let Some(row) = column.iter().position(bad) {
                let message = format!(
                    "{} in row {} is not finite; accepted is a finite number",
                    column[row],
                    row + 1
                );
                return Err(self.error(name, message));
            }
        }
        let rows = columns.first().map_or(0, Vec::len);
        Ok(Numbers {
            lines: (1..=rows).collect(),
            columns,
        })
    }

    /// What unit a column's header or name says.
    pub(crate) fn own_unit(&self, place: usize) -> Option<(Dimension, &'static str)> {
        self.layout.units[place]
            .as_deref()
            .and_then(|unit| unit_of(&DIMENSIONS, unit))
            .or_else(|| of_name(&self.layout.names[place]))
    }

    /// What may be a unit in a column's header or name, as it is written.
    pub(crate) fn unit_text(&self, place: usize) -> Option<&str> {
        let header = self.layout.units[place].as_deref();
        header.or_else(|| ending(&self.layout.names[place]))
    }

    /// The unit that a column's header or name says.
    pub(crate) fn unit(&self, place: usize) -> Option<&'static str> {
        self.own_unit(place).map(|(_, unit)| unit)
    }

    /// The file as a table of numbers without names, its first line too; NaN where a field is none. `None` of a file
    /// that has names.
    pub(crate) fn grid(&self) -> Result<Option<Vec<Vec<f64>>>, Error> {
        let Content::Text(_) = &self.content else {
            return Ok(None);
        };
        let value = |text: &str| cells::number(text, self.layout.decimal_comma);
        let mut rows = Vec::new();
        if self.layout.names_line.is_some() {
            let names = self.names();
            if names.len() < 4 || !names[1..].iter().all(|n| value(n).is_some()) {
                return Ok(None);
            }
            rows.push(names.iter().map(|n| value(n).unwrap_or(f64::NAN)).collect());
        }
        self.rows(|_, row| {
            rows.push(row.iter().map(|f| value(f).unwrap_or(f64::NAN)).collect());
            Ok(())
        })?;
        Ok(Some(rows))
    }

    /// Whether a column is of moments, which are read as seconds.
    pub(crate) fn is_moments(&self, place: usize) -> bool {
        match &self.content {
            Content::Arrays(arrays) => arrays.moments[place],
            Content::Text(_) => false,
        }
    }
}

/// A number, NaN where there is none; of a moment the seconds since the first one.
fn number(
    text: &str,
    gaps: Gaps,
    decimal_comma: bool,
    first: &mut Option<i128>,
) -> Result<f64, String> {
    if let Some(value) = cells::number(text, decimal_comma) {
        return if value.is_finite() {
            Ok(value)
        } else {
            Err("is not finite".to_owned())
        };
    }
    if gaps == Gaps::Allowed && cells::is_missing(text) {
        return Ok(f64::NAN);
    }
    if let Some(moment) = cells::moment(text) {
        let first = *first.get_or_insert(moment);
        return Ok((moment - first) as f64 * 1e-9);
    }
    Err(if decimal_comma && text.contains('.') {
        "has a decimal point, where other numbers have a comma".to_owned()
    } else if text.parse::<f64>().is_ok() {
        "is not finite".to_owned()
    } else if !decimal_comma && text.contains(',') {
        "has a comma, where other numbers have none".to_owned()
    } else {
        "is no number".to_owned()
    })
}

/// The line of a character that no text has at its beginning, counted from one, and the character's number.
fn not_text(text: &str) -> Option<(usize, u32)> {
    /// Bytes that are looked at: what is none shows it soon, and a record may have a bad end.
    const BEGINNING: usize = 4096;
    let other = |c: char| c < ' ' && !['\t', '\n', '\r', '\x0c', '\x1a'].contains(&c);
    let beginning = text.char_indices().take_while(|(at, _)| *at < BEGINNING);
    let (at, found) = beginning.into_iter().find(|(_, c)| other(*c))?;
    let line = text[..at].matches('\n').count() + 1;
    Some((line, u32::from(found)))
}

/// What a file is that is no text.
fn binary(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [b'M', b'A', b'T', b'L', b'A', b'B', b' ', ..] => {
            Some("a MATLAB file of version 7.3 (save it with '-v7')")
        }
        // A matrix's type, one of a few, in 32 bits: no text has three zeros.
        [0..=52, 0, 0, 0, ..] => Some("a MATLAB file of version 4 (save it with '-v7')"),
        [0x89, b'H', b'D', b'F', ..] => Some("an HDF5 file (.mat of version 7.3 among them)"),
        [b'P', b'K', 3, 4, ..] => Some("a ZIP archive or a spreadsheet"),
        [0x1f, 0x8b, ..] => Some("a compressed file (gzip)"),
        _ => None,
    }
}
