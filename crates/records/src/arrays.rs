//! Columns of files that are no text: Parquet, and MATLAB's .mat up to version 7 (level 5).

use matfile::{MatFile, NumericData};
use parquet::basic::{LogicalType, TimeUnit, Type};
use parquet::column::reader::ColumnReader;
use parquet::data_type::Int96;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use std::fs::File;

/// Columns of numbers, as a file has them.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Arrays {
    /// What the file is.
    pub(crate) kind: &'static str,
    /// Names of the columns.
    pub(crate) names: Vec<String>,
    /// The columns, of one length each; NaN where there is no value.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Columns that are moments: counted in seconds from the first.
    pub(crate) moments: Vec<bool>,
    /// Columns that hold something else than numbers: what.
    pub(crate) others: Vec<Option<&'static str>>,
    /// Seconds between rows, where the file says so.
    pub(crate) period: Option<f64>,
    /// What was left out for being of another length, and that.
    pub(crate) left_out: Vec<(String, usize)>,
}

/// What a moment of a Parquet column counts, seconds; `None` where it counts none.
fn tick(logical: Option<&LogicalType>) -> Option<f64> {
    let unit = match logical? {
        LogicalType::Timestamp(of) | LogicalType::Time(of) => &of.unit,
        _ => return None,
    };
    Some(match unit {
        TimeUnit::MILLIS => 1e-3,
        TimeUnit::MICROS => 1e-6,
        TimeUnit::NANOS => 1e-9,
    })
}

/// A number, and whether it counts time: the ticks of a moment, with which the seconds are counted from the first.
enum Cell {
    Number(f64),
    Ticks(i64, f64),
    Missing,
    Other(&'static str),
}

fn cell(field: &Field, tick: Option<f64>) -> Cell {
    match field {
        Field::Null => Cell::Missing,
        Field::Bool(v) => Cell::Number(f64::from(u8::from(*v))),
        Field::Byte(v) => Cell::Number(f64::from(*v)),
        Field::Short(v) => Cell::Number(f64::from(*v)),
        Field::Int(v) => Cell::Number(f64::from(*v)),
        Field::Long(v) => tick.map_or(Cell::Number(*v as f64), |s| Cell::Ticks(*v, s)),
        Field::UByte(v) => Cell::Number(f64::from(*v)),
        Field::UShort(v) => Cell::Number(f64::from(*v)),
        Field::UInt(v) => Cell::Number(f64::from(*v)),
        Field::ULong(v) => Cell::Number(*v as f64),
        Field::Float16(v) => Cell::Number(f64::from(*v)),
        Field::Float(v) => Cell::Number(f64::from(*v)),
        Field::Double(v) => Cell::Number(*v),
        Field::TimeMillis(v) => Cell::Ticks(i64::from(*v), 1e-3),
        Field::TimestampMillis(v) => Cell::Ticks(*v, 1e-3),
        Field::TimeMicros(v) | Field::TimestampMicros(v) => Cell::Ticks(*v, 1e-6),
        Field::Date(_) => Cell::Other("dates"),
        Field::Decimal(_) => field
            .to_string()
            .parse()
            .map_or(Cell::Other("decimals"), Cell::Number),
        Field::Str(_) | Field::Bytes(_) => Cell::Other("texts"),
        Field::Group(_) | Field::ListInternal(_) | Field::MapInternal(_) => Cell::Other("lists"),
    }
}

/// The columns of a Parquet file.
pub(crate) fn parquet(file: File) -> Result<Arrays, String> {
    let bad = |error: parquet::errors::ParquetError| {
        let text = error.to_string();
        match text.split_once("Disabled feature at compile time: ") {
            Some((_, codec)) => format!(
                "is compressed by {codec}, which is not read here; accepted is Parquet by snappy, gzip, zstd or without compression"
            ),
            None => format!("is no Parquet that can be read: {text}"),
        }
    };
    let reader = SerializedFileReader::new(file).map_err(bad)?;
    let schema = reader.metadata().file_metadata().schema();
    let fields = schema.get_fields();
    let ticks: Vec<Option<f64>> = fields
        .iter()
        .map(|f| tick(f.get_basic_info().logical_type_ref()))
        .collect();
    let names: Vec<String> = fields.iter().map(|f| f.name().to_owned()).collect();
    let count = names.len();
    let mut columns = vec![Vec::new(); count];
    let mut others = vec![None; count];
    let mut first: Vec<Option<i64>> = vec![None; count];
    for row in reader.get_row_iter(None).map_err(bad)? {
        let row = row.map_err(bad)?;
        for (k, (_, field)) in row.get_column_iter().enumerate().take(count) {
            let value = match cell(field, ticks[k]) {
                Cell::Number(v) => v,
                Cell::Missing => f64::NAN,
                Cell::Ticks(v, size) => {
                    let zero = *first[k].get_or_insert(v);
                    (i128::from(v) - i128::from(zero)) as f64 * size
                }
                Cell::Other(what) => {
                    others[k] = Some(what);
                    f64::NAN
                }
            };
            columns[k].push(value);
        }
    }
    for (k, column) in columns.iter_mut().enumerate() {
        if let Some(moments) = old_moments(&reader, k).map_err(bad)? {
            let zero = moments.iter().copied().flatten().next();
            let from = |v: i64| (i128::from(v) - i128::from(zero.unwrap_or(v))) as f64 * 1e-9;
            *column = moments
                .into_iter()
                .map(|m| m.map_or(f64::NAN, from))
                .collect();
        }
    }
    Ok(Arrays {
        kind: "Parquet",
        names,
        columns,
        moments: first.iter().map(Option::is_some).collect(),
        others,
        period: None,
        left_out: Vec::new(),
    })
}

/// Moments as Spark and others write them (INT96), nanoseconds: a row tells them to a millisecond only, in which a servo takes many
/// samples. `None` of any other column, and of files in which columns hold several.
fn old_moments(
    reader: &SerializedFileReader<File>,
    k: usize,
) -> Result<Option<Vec<Option<i64>>>, parquet::errors::ParquetError> {
    let schema = reader.metadata().file_metadata().schema_descr();
    let fields = schema.root_schema().get_fields();
    let is_flat = fields.len() == schema.num_columns() && fields.iter().all(|f| f.is_primitive());
    if !is_flat || schema.column(k).physical_type() != Type::INT96 {
        return Ok(None);
    }
    let mut moments = Vec::new();
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group)?;
        let ColumnReader::Int96ColumnReader(mut column) = group.get_column_reader(k)? else {
            return Ok(None);
        };
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        let (mut there, mut values) = (Vec::new(), Vec::new());
        let is_optional = schema.column(k).max_def_level() > 0;
        column.read_records(rows, is_optional.then_some(&mut there), None, &mut values)?;
        let mut values = values.iter().map(Int96::to_nanos);
        if is_optional {
            moments.extend(
                there
                    .iter()
                    .map(|level| (*level > 0).then(|| values.next()).flatten()),
            );
        } else {
            moments.extend(values.map(Some));
        }
    }
    Ok(Some(moments))
}

/// Numbers of a .mat that say how far apart samples are: a period or a rate.
const PERIODS: [&str; 5] = ["Ts", "dt", "T_s", "ts", "period"];
const RATES: [&str; 5] = ["fs", "Fs", "rate", "f_s", "sample_rate"];

/// Real parts, and imaginary ones where there are some.
#[expect(
    clippy::cast_lossless,
    reason = "one macro for the types that are narrower than a number here and those that are not"
)]
fn numbers(data: &NumericData) -> [Option<Vec<f64>>; 2] {
    macro_rules! wide {
        ($real:expr, $imaginary:expr) => {{
            let imaginary = $imaginary.as_ref();
            [
                Some($real.iter().map(|v| *v as f64).collect()),
                imaginary.map(|values| values.iter().map(|v| *v as f64).collect()),
            ]
        }};
    }
    match data {
        NumericData::Int8 { real, imag } => wide!(real, imag),
        NumericData::UInt8 { real, imag } => wide!(real, imag),
        NumericData::Int16 { real, imag } => wide!(real, imag),
        NumericData::UInt16 { real, imag } => wide!(real, imag),
        NumericData::Int32 { real, imag } => wide!(real, imag),
        NumericData::UInt32 { real, imag } => wide!(real, imag),
        NumericData::Int64 { real, imag } => wide!(real, imag),
        NumericData::UInt64 { real, imag } => wide!(real, imag),
        NumericData::Single { real, imag } => wide!(real, imag),
        NumericData::Double { real, imag } => wide!(real, imag),
    }
}

/// Columns of a .mat: vectors by their names, matrices as `name_1`, `name_2`, complex ones as `name_re` and
/// `name_im`; those of the length that most have.
pub(crate) fn mat(bytes: &[u8]) -> Result<Arrays, String> {
    let parsed = MatFile::parse(bytes)
        .map_err(|error| {
        format!(
            "is no .mat of version 5 to 7 that can be read: {error} (arrays of int32 are not: save them as double)"
        )
    })?;
    let mut period = None;
    let mut all: Vec<(String, Vec<f64>)> = Vec::new();
    for array in parsed.arrays() {
        let parts = numbers(array.data());
        let is_complex = parts[1].is_some();
        for (values, part) in parts.into_iter().zip(["_re", "_im"]) {
            let Some(values) = values else { continue };
            let name = if is_complex {
                format!("{}{part}", array.name())
            } else {
                array.name().to_owned()
            };
            let name = name.as_str();
            match array.size()[..] {
                [1, 1] => {
                    let value = values
                        .first()
                        .copied()
                        .filter(|v| *v > 0.0 && v.is_finite());
                    if PERIODS.contains(&name) {
                        period = value;
                    } else if RATES.contains(&name) {
                        period = value.map(|rate| 1.0 / rate);
                    }
                }
                [1, _] | [_, 1] => all.push((name.to_owned(), values)),
                [rows, columns]
                    if rows > 0
                        && columns > 0
                        && rows.checked_mul(columns) == Some(values.len()) =>
                {
                    // Samples along the longer side.
                    for k in 0..rows.min(columns) {
                        let column = if rows >= columns {
                            values[k * rows..(k + 1) * rows].to_vec()
                        } else {
                            values.iter().skip(k).step_by(rows).copied().collect()
                        };
                        all.push((format!("{name}_{}", k + 1), column));
                    }
                }
                _ => {}
            }
        }
    }
    let length = all
        .iter()
        .map(|(_, v)| {
            let as_long = all.iter().filter(|(_, o)| o.len() == v.len()).count();
            (as_long, v.len())
        })
        .max()
        .map(|(_, length)| length)
        .ok_or("has no vectors of numbers; accepted are numeric arrays beside each other, not in a struct or table")?;
    let other = all.iter().filter(|(_, v)| v.len() != length);
    let left_out = other.map(|(name, v)| (name.clone(), v.len())).collect();
    all.retain(|(_, v)| v.len() == length);
    let (names, columns): (Vec<_>, Vec<_>) = all.into_iter().unzip();
    Ok(Arrays {
        kind: "MATLAB's .mat",
        moments: vec![false; names.len()],
        others: vec![None; names.len()],
        names,
        columns,
        period,
        left_out,
    })
}
