//! The one reader of CSV files that a person brings: columns by name, in SI units where they have one.

mod which;

pub use crate::table::{Gaps, Numbers, Table};
pub use crate::units::LengthUnit;
pub(crate) use crate::units::{
    CURRENT, DIMENSIONS, OTHER_UNITS, TIME, ending, foreign, of_name, share, unit_of, without_unit,
};
use pigtail_hal::Error;
use pigtail_hal::quantity::Dimension;
use pigtail_numerics::signal::quantile;
use pigtail_sysid::timeline::{Even, Uneven, even};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use which::locate;

/// What the rows are called where they themselves count time.
const ROWS: &str = "rows";

/// A column as it is named on a command line: `NAME` or `NAME:UNIT`.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    name: String,
    /// Seconds between samples: of a column that counts them, or of the rows themselves where it has no name.
    period: Option<f64>,
}

impl FromStr for Named {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            return Err("is empty; accepted is the name of a column".to_owned());
        }
        Ok(Self::new(text.trim()))
    }
}

impl Named {
    /// The column's name; empty where the rows themselves count time.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A column by its name alone.
    pub fn new(name: impl Into<String>) -> Self {
        let name = name.into();
        // `NAME:RATE Hz` counts samples; so do the rows where the name is `rows`.
        let rate = name
            .strip_suffix(" Hz")
            .and_then(|text| text.rsplit_once(':'))
            .and_then(|(name, rate)| Some((name, rate.trim().parse::<f64>().ok()?)))
            .filter(|(_, rate)| *rate > 0.0 && rate.is_finite());
        if let Some((counts, rate)) = rate {
            return Self {
                name: if counts == ROWS {
                    String::new()
                } else {
                    counts.to_owned()
                },
                period: Some(1.0 / rate),
            };
        }
        Self { name, period: None }
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

/// The same in other words and without their units.
const USUAL: [&str; 9] = [
    "t",
    "time",
    "zeit",
    "timestamp",
    "time stamp",
    "datetime",
    "elapsed",
    "elapsed time",
    "time_ms",
];

/// The column of time: the named one, or one with a usual name. With a `rate` (hertz) the rows are so many a second,
/// or the named column counts samples.
///
/// # Errors
///
/// When no column was named and none has a usual name.
pub fn time_named(table: &Table, given: Option<&Named>, rate: Option<f64>) -> Result<Named, Error> {
    found_time(table, given, rate).ok_or_else(|| {
        let message = format!(
            "no column is named as time usually is; name one with --time, or say how many rows a second there are with \
             --rate: {}",
            table.there_are()
        );
        table.error("--time", message)
    })
}

/// The column of time with a usual name, where there is one.
pub fn usual_time(table: &Table, rate: Option<f64>) -> Option<Named> {
    found_time(table, None, rate)
}

fn found_time(table: &Table, given: Option<&Named>, rate: Option<f64>) -> Option<Named> {
    let period = rate.map(f64::recip);
    let name = given.map(|n| n.name.clone());
    if period.is_some() {
        return Some(Named {
            name: name.unwrap_or_default(),
            period,
        });
    }
    given.cloned().or_else(|| usual(table)).or_else(|| {
        let period = table.period()?;
        Some(Named {
            name: String::new(),
            period: Some(period),
        })
    })
}

fn usual(table: &Table) -> Option<Named> {
    let exact = TIMES
        .iter()
        .find(|name| table.has(name))
        .map(|n| (*n).to_owned());
    let nearly = || {
        // `Time [s]`, `Zeit (ms)`, `Timestamp`.
        let bare = |name: &str| {
            let low = without_unit(name).to_lowercase();
            ["_s", "_ms", "_us", "_ns"]
                .iter()
                .find_map(|unit| low.strip_suffix(unit))
                .unwrap_or(&low)
                .to_owned()
        };
        table
            .names()
            .iter()
            .find(|n| USUAL.contains(&&*bare(n)))
            .cloned()
    };
    // An index of moments without a name, as pandas writes it.
    let only = || {
        let names = table.names();
        let mut moments = (0..names.len()).filter(|k| table.is_moments(*k));
        let only = moments.next().filter(|_| moments.next().is_none());
        only.map(|k| names[k].clone())
    };
    exact.or_else(nearly).or_else(only).map(Named::new)
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

/// Leaves out rows that say again what the row before them says, their time too, where one is; how many there were.
pub(crate) fn once(columns: &mut [Column]) -> usize {
    if !columns.iter().any(|c| c.dimension == TIME) {
        return 0;
    }
    let rows = columns.first().map_or(0, |c| c.values.len());
    let again = |k: usize| k > 0 && columns.iter().all(|c| c.values[k] == c.values[k - 1]);
    let keep: Vec<bool> = (0..rows).map(|k| !again(k)).collect();
    for column in columns.iter_mut() {
        let mut keep = keep.iter();
        column
            .values
            .retain(|_| keep.next().copied().unwrap_or(true));
    }
    keep.iter().filter(|k| !**k).count()
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
/// When a column is not there or named twice, its unit is of something else, a
/// field is no number, or too many have no value.
pub fn read(table: &Table, wanted: &[Wanted]) -> Result<Vec<Column>, Error> {
    let mut places = Vec::with_capacity(wanted.len());
    let mut columns = Vec::with_capacity(wanted.len());
    for want in wanted {
        if want.named.name.is_empty() {
            // The rows themselves count time.
            places.push(usize::MAX);
            columns.push(Column {
                name: ROWS.to_owned(),
                unit: "s",
                dimension: TIME,
                values: Vec::new(),
                by: By::Option,
            });
            continue;
        }
        let (place, column) = locate(table, want)?;
        if let Some(k) = places.iter().position(|p| *p == place) {
            let message = format!(
                "is named twice, by {} and {}; accepted are different columns",
                wanted[k].option, want.option
            );
            return Err(table.error(&*table.names()[place], message));
        }
        places.push(place);
        columns.push(column);
    }
    let there: Vec<usize> = places
        .iter()
        .copied()
        .filter(|p| *p != usize::MAX)
        .collect();
    let numbers = table.numbers(&there, Gaps::Allowed)?;
    let rows = numbers.lines.len();
    let mut read = numbers.columns.into_iter();
    for ((column, place), want) in columns.iter_mut().zip(&places).zip(wanted) {
        if *place == usize::MAX {
            let period = want.named.period.unwrap_or(1.0);
            column.values = (0..rows).map(|k| k as f64 * period).collect();
            continue;
        }
        column.values = read.next().unwrap_or_default();
        let (_, size) = column.dimension.unit(column.unit).unwrap_or(("", 1.0));
        let size = want.named.period.unwrap_or(size);
        for value in &mut column.values {
            *value *= size;
        }
    }
    own_times(table, &places)?;
    for column in columns.iter().filter(|c| c.dimension == TIME) {
        of_a_motion(table, column)?;
    }
    for column in &columns {
        let rows = column.values.len();
        if rows == 0 {
            return Err(table.error(
                "",
                "has no rows below its line of names; accepted are rows of numbers",
            ));
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

/// Longest time between rows of any record that is read here, seconds: creep of a piezo over days has more of them.
const SLOWEST: f64 = 1000.0;

/// That rows lie as far apart as those of a record: where time is said in a unit that nobody named it is wrong by thousands.
fn of_a_motion(table: &Table, time: &Column) -> Result<(), Error> {
    let steps: Vec<f64> = time
        .values
        .windows(2)
        .map(|w| w[1] - w[0])
        .filter(|step| step.is_finite())
        .collect();
    let usual = quantile(&steps, 0.5);
    if usual.is_nan() || usual < SLOWEST {
        return Ok(());
    }
    let message = format!(
        "rows are {usual} s apart, by its being in {}; accepted is less than {SLOWEST} s: is it in another unit (as \
         \"{}:ns\")?",
        time.unit, time.name
    );
    Err(table.error(&*time.name, message))
}

/// Where channels have columns of time of their own, these are to say the same.
fn own_times(table: &Table, places: &[usize]) -> Result<(), Error> {
    let names = table.names();
    if names.first().is_none_or(|n| n != "time_ms") || names.get(2).is_none_or(|n| n != "time_ms 2")
    {
        return Ok(());
    }
    // The time that was asked for is to be theirs, too.
    let mut own: Vec<usize> = places
        .iter()
        .filter(|p| **p != usize::MAX)
        .map(|p| p - p % 2)
        .collect();
    own.dedup();
    let times = table.numbers(&own, Gaps::Allowed)?.columns;
    for (k, column) in times.iter().enumerate().skip(1) {
        let step = times[0]
            .get(1)
            .zip(times[0].first())
            .map_or(1.0, |(b, a)| (b - a).abs());
        let apart = column
            .iter()
            .zip(&times[0])
            .find(|(a, b)| (*a - *b).abs() > 0.01 * step);
        if apart.is_some() {
            let message = format!(
                "its times are others than those of {}; accepted are channels of one sample time, exported together, and a \
                 time of theirs (--time \"{}\")",
                names[own[0] + 1],
                names[own[k]]
            );
            return Err(table.error(&*names[own[k] + 1], message));
        }
    }
    Ok(())
}

/// The unit of what has none.
const UNITLESS: &str = "1";

/// A remark for each column whose unit had to be assumed.
pub fn remarks(columns: &[Column]) -> Vec<String> {
    columns
        .iter()
        .filter(|c| c.by == By::Nothing)
        .map(|c| match c.unit {
            UNITLESS => format!("column {} taken as a ratio", c.name),
            unit => format!("column {} taken as in {unit}", c.name),
        })
        .collect()
}

/// How a file was read, in words: what stands between its fields, which columns serve as what and in which units, how
/// many samples a second.
pub fn understood(
    table: &Table,
    wanted: &[Wanted],
    columns: &[Column],
    even: Option<&Even>,
) -> String {
    let mut text = table.understood();
    for (want, column) in wanted.iter().zip(columns) {
        let role = want.option.trim_start_matches("--");
        let by = match column.by {
            By::Nothing => ", taken so",
            By::Option | By::Name => "",
        };
        let unit = match column.unit {
            UNITLESS => "as a ratio".to_owned(),
            unit => format!("in {unit}"),
        };
        let _ = write!(text, "; {role} is {} {unit}{by}", column.name);
        // Whoever says how many rows a second there are overrules a column of time, and is told so.
        if column.name == ROWS
            && let Some(time) = usual(table)
        {
            let _ = write!(text, ", not its column {}", time.name());
        }
    }
    if let Some(even) = even {
        let samples = even.samples();
        let _ = write!(text, "; {samples} samples at {:.6} Hz", 1.0 / even.period);
        if even.gaps > 0 {
            let _ = write!(text, ", {} gaps", even.gaps);
        }
    }
    text
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
                    let unit = match w.named.period {
                        Some(period) => format!("{} Hz", 1.0 / period),
                        None => c.unit.to_owned(),
                    };
                    (
                        w.option.trim_start_matches("--"),
                        format!("{}:{unit}", c.name),
                    )
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_hal::quantity::{ANGLE, LENGTH};
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
        Ok(read(&Table::open(&path)?, &[wanted])?.remove(0))
    }

    #[test]
    fn a_column_of_time_that_is_not_used_is_said() {
        let (_folder, path) = file("t_s,x\n0,1\n0.001,2\n");
        let table = Table::open(&path).unwrap();
        let time = time_named(&table, None, Some(200.0)).unwrap();
        let wanted = [Wanted {
            option: "--time",
            named: &time,
            of: &[TIME],
        }];
        let columns = read(&table, &wanted).unwrap();
        let said = understood(&table, &wanted, &columns, None);
        assert!(
            said.contains("time is rows in s, not its column t_s"),
            "{said}"
        );
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
    fn a_column_is_meant_by_its_name_without_its_unit_where_no_other_is() {
        const LENGTHS: &[Dimension] = &[LENGTH];
        let of = |header: &str, named: &str| read_one(&format!("{header}\n2,3\n"), named, LENGTHS);
        for (header, named) in [
            ("x_mm,y_mm", "x"),
            ("x (mm),y", "x"),
            ("x/mm,y/mm", "X"),
            ("X_MM,y", "x_mm"),
            ("Position in mm,y", "position"),
            ("Position in mm,y", "Position in mm"),
            ("Position mm,y", "Position"),
        ] {
            let column = of(header, named).expect(header);
            assert_eq!((column.unit, column.values[0]), ("mm", 2e-3), "{header}");
        }
        assert_eq!(of("x_\u{b5}m,y", "x_um").expect("a column").unit, "um");
        // Either could be meant; the unit is another one than is said; what is no unit belongs to the name.
        for (header, named) in [("x_mm,x_um", "x"), ("x_mm,y", "x:um"), ("x_ref,y", "x")] {
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
