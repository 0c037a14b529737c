//! Rows in columns that say their unit: in memory, as Parquet and as CSV.

use anyhow::{Context, Result, anyhow, ensure};
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::column::reader::get_typed_column_reader;
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows of a group in a file of many rows: what is in memory at a time.
pub const GROUP: usize = 16_384;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers from zero on.
    Whole,
    /// Texts.
    Text,
    /// Yes or no.
    Flag,
    /// Numbers.
    Number,
}

/// A column of the rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Its name, with its unit.
    pub name: String,
    /// What it means.
    pub about: String,
    kind: Kind,
    required: bool,
}

impl Column {
    /// A column in which a row may have no value.
    pub fn new(name: &str, kind: Kind, about: &str) -> Self {
        Self {
            name: name.to_owned(),
            about: about.to_owned(),
            kind,
            required: false,
        }
    }

    /// A column in which every row has a value.
    pub fn required(name: &str, kind: Kind, about: &str) -> Self {
        Self {
            required: true,
            ..Self::new(name, kind, about)
        }
    }

    /// What it holds.
    pub fn kind(&self) -> Kind {
        self.kind
    }
}

/// Values of a column without its nulls, and which rows have one.
#[derive(Debug, Clone, PartialEq)]
struct Cells {
    present: Vec<i16>,
    values: Values,
}

#[derive(Debug, Clone, PartialEq)]
enum Values {
    Whole(Vec<i64>),
    Text(Vec<ByteArray>),
    Flag(Vec<bool>),
    Number(Vec<f64>),
}

/// Some rows in memory, column by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    columns: Arc<[Column]>,
    cells: Vec<Cells>,
    rows: usize,
}

/// A value of a row, where it has one.
pub enum Cell<'a> {
    /// Of a column of whole numbers.
    Whole(u64),
    /// Of one of texts.
    Text(Option<&'a str>),
    /// Of one of flags.
    Flag(Option<bool>),
    /// Of one of numbers.
    Number(Option<f64>),
}

impl Table {
    /// No rows yet.
    pub fn new(columns: &Arc<[Column]>) -> Self {
        let empty = |column: &Column| Cells {
            present: Vec::new(),
            values: match column.kind {
                Kind::Whole => Values::Whole(Vec::new()),
                Kind::Text => Values::Text(Vec::new()),
                Kind::Flag => Values::Flag(Vec::new()),
                Kind::Number => Values::Number(Vec::new()),
            },
        };
        Self {
            columns: Arc::clone(columns),
            cells: columns.iter().map(empty).collect(),
            rows: 0,
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Adds a row with a value of its kind for each column.
    pub fn add(&mut self, row: Vec<Cell>) {
        debug_assert_eq!(row.len(), self.cells.len());
        for (cells, cell) in self.cells.iter_mut().zip(row) {
            let present = match (&mut cells.values, cell) {
                (Values::Whole(values), Cell::Whole(value)) => {
                    keep(values, Some(value.cast_signed()))
                }
                (Values::Text(values), Cell::Text(value)) => {
                    keep(values, value.map(ByteArray::from))
                }
                (Values::Flag(values), Cell::Flag(value)) => keep(values, value),
                (Values::Number(values), Cell::Number(value)) => keep(values, value),
                _ => unreachable!("a row has the columns of its table"),
            };
            cells.present.push(i16::from(present));
        }
        self.rows += 1;
    }

    /// The rows as a Parquet file in memory.
    ///
    /// # Errors
    ///
    /// When the encoder fails.
    pub fn to_parquet(&self) -> Result<Vec<u8>> {
        let mut file = Vec::new();
        let mut writer = Writer::new(&mut file, &self.columns)?;
        writer.group(self)?;
        writer.finish()?;
        Ok(file)
    }

    /// The rows as CSV, with a header; what has no value is empty.
    ///
    /// # Errors
    ///
    /// When the encoder fails.
    pub fn to_csv(&self) -> Result<Vec<u8>> {
        let mut columns: Vec<_> = self
            .cells
            .iter()
            .map(|cells| {
                let texts: Vec<String> = match &cells.values {
                    Values::Whole(v) => v.iter().map(|v| v.cast_unsigned().to_string()).collect(),
                    Values::Text(v) => v
                        .iter()
                        .map(|v| String::from_utf8_lossy(v.data()).into_owned())
                        .collect(),
                    Values::Flag(v) => v.iter().map(bool::to_string).collect(),
                    Values::Number(v) => v.iter().map(f64::to_string).collect(),
                };
                let mut texts = texts.into_iter();
                cells.present.iter().map(move |present| {
                    let text = if *present == 0 { None } else { texts.next() };
                    text.unwrap_or_default()
                })
            })
            .collect();
        let mut csv = csv::Writer::from_writer(Vec::new());
        csv.write_record(self.columns.iter().map(|column| &column.name))?;
        for _ in 0..self.rows {
            csv.write_record(columns.iter_mut().filter_map(Iterator::next))?;
        }
        Ok(csv.into_inner()?)
    }

    fn write(&self, group: &mut SerializedRowGroupWriter<impl Write + Send>) -> Result<()> {
        let mut index = 0;
        while let Some(mut column) = group.next_column()? {
            let cells = &self.cells[index];
            let present = (!self.columns[index].required).then_some(&cells.present[..]);
            match &cells.values {
                Values::Whole(v) => column.typed::<Int64Type>().write_batch(v, present, None)?,
                Values::Text(v) => column
                    .typed::<ByteArrayType>()
                    .write_batch(v, present, None)?,
                Values::Flag(v) => column.typed::<BoolType>().write_batch(v, present, None)?,
                Values::Number(v) => column.typed::<DoubleType>().write_batch(v, present, None)?,
            };
            column.close()?;
            index += 1;
        }
        Ok(())
    }

    /// Reads a column's values of a group from its place in the file; a column without one has none.
    fn read(
        &mut self,
        index: usize,
        place: Option<usize>,
        group: &dyn RowGroupReader,
    ) -> Result<()> {
        let rows = usize::try_from(group.metadata().num_rows())?;
        let cells = &mut self.cells[index];
        let before = cells.present.len();
        let required = self.columns[index].required;
        let Some(index) = place else {
            cells.present.resize(before + rows, 0);
            return Ok(());
        };
        match &mut cells.values {
            Values::Whole(v) => read::<Int64Type>(group, index, rows, &mut cells.present, v)?,
            Values::Text(v) => read::<ByteArrayType>(group, index, rows, &mut cells.present, v)?,
            Values::Flag(v) => read::<BoolType>(group, index, rows, &mut cells.present, v)?,
            Values::Number(v) => read::<DoubleType>(group, index, rows, &mut cells.present, v)?,
        }
        if required {
            cells.present.resize(before + rows, 1);
        }
        ensure!(cells.present.len() == before + rows, "a column ends early");
        Ok(())
    }

    fn cells(&self, name: &str) -> &Cells {
        let index = self.columns.iter().position(|column| column.name == name);
        &self.cells[index.expect("asked for by a name of ours")]
    }

    /// The values of a column of whole numbers.
    pub fn wholes(&self, name: &str) -> Vec<u64> {
        match &self.cells(name).values {
            Values::Whole(values) => values.iter().map(|value| value.cast_unsigned()).collect(),
            _ => Vec::new(),
        }
    }

    /// The values of a column of numbers.
    pub fn numbers(&self, name: &str) -> Vec<Option<f64>> {
        let cells = self.cells(name);
        let Values::Number(values) = &cells.values else {
            return Vec::new();
        };
        spread(&cells.present, values)
            .map(Option::<&f64>::copied)
            .collect()
    }

    /// The values of a column of texts.
    pub fn texts(&self, name: &str) -> Vec<Option<String>> {
        let cells = self.cells(name);
        let Values::Text(values) = &cells.values else {
            return Vec::new();
        };
        spread(&cells.present, values)
            .map(|value| value.map(|bytes| String::from_utf8_lossy(bytes.data()).into_owned()))
            .collect()
    }

    /// The values of a column of flags.
    pub fn flags(&self, name: &str) -> Vec<Option<bool>> {
        let cells = self.cells(name);
        let Values::Flag(values) = &cells.values else {
            return Vec::new();
        };
        spread(&cells.present, values)
            .map(Option::<&bool>::copied)
            .collect()
    }
}

fn keep<T>(values: &mut Vec<T>, value: Option<T>) -> bool {
    let present = value.is_some();
    values.extend(value);
    present
}

/// The values with their nulls back in place.
fn spread<'a, T>(present: &'a [i16], values: &'a [T]) -> impl Iterator<Item = Option<&'a T>> {
    let mut values = values.iter();
    present
        .iter()
        .map(move |p| if *p == 0 { None } else { values.next() })
}

fn read<T: DataType>(
    group: &dyn RowGroupReader,
    index: usize,
    rows: usize,
    present: &mut Vec<i16>,
    values: &mut Vec<T::T>,
) -> Result<()> {
    let mut reader = get_typed_column_reader::<T>(group.get_column_reader(index)?);
    let mut left = rows;
    while left > 0 {
        let (read, ..) = reader.read_records(left, Some(present), None, values)?;
        ensure!(read > 0, "a column ends early");
        left -= read;
    }
    Ok(())
}

fn schema(columns: &[Column]) -> Result<Arc<Type>> {
    let field = |column: &Column| {
        let (physical, logical) = match column.kind {
            Kind::Whole => (Physical::INT64, Some(LogicalType::integer(64, false))),
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Kind::Flag => (Physical::BOOLEAN, None),
            Kind::Number => (Physical::DOUBLE, None),
        };
        let repetition = if column.required {
            Repetition::REQUIRED
        } else {
            Repetition::OPTIONAL
        };
        Type::primitive_type_builder(&column.name, physical)
            .with_logical_type(logical)
            .with_repetition(repetition)
            .build()
            .map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<_, _>>()?;
    Ok(Arc::new(
        Type::group_type_builder("rows")
            .with_fields(fields)
            .build()?,
    ))
}

/// Writes a Parquet file, group by group.
pub struct Writer<W: Write + Send>(SerializedFileWriter<W>);

impl<W: Write + Send> Writer<W> {
    /// Begins a file of these columns.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn new(file: W, columns: &[Column]) -> Result<Self> {
        // What the columns mean travels with them. Nothing here may depend on the day or the
        // machine: the same rows are the same bytes.
        let about = columns
            .iter()
            .map(|column| KeyValue::new(column.name.clone(), column.about.clone()))
            .collect();
        let properties = WriterProperties::builder()
            .set_created_by(format!("pigtail {}", env!("CARGO_PKG_VERSION")))
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_key_value_metadata(Some(about))
            .build();
        Ok(Self(SerializedFileWriter::new(
            file,
            schema(columns)?,
            Arc::new(properties),
        )?))
    }

    /// Writes some rows as a group of their own.
    ///
    /// # Errors
    ///
    /// When they cannot be written.
    pub fn group(&mut self, table: &Table) -> Result<()> {
        if table.rows > 0 {
            let mut group = self.0.next_row_group()?;
            table.write(&mut group)?;
            group.close()?;
        }
        Ok(())
    }

    /// Ends the file, which is none before, and gives back what it was written to.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn finish(self) -> Result<W> {
        Ok(self.0.into_inner()?)
    }
}

/// A Parquet file of rows.
pub struct Rows {
    reader: SerializedFileReader<File>,
    columns: Arc<[Column]>,
    /// Where each column is in the file, which may be older than a column.
    places: Vec<Option<usize>>,
}

impl Rows {
    /// Opens a file that must have these columns, in their order. One in which a row may have no value may be missing, as
    /// in a file that is older than the column: no row has a value of it.
    ///
    /// # Errors
    ///
    /// When it cannot be read, is no Parquet, or has other columns.
    pub fn open(path: &Path, columns: &Arc<[Column]>) -> Result<Self> {
        let reader = SerializedFileReader::new(File::open(path)?)?;
        let there = reader.metadata().file_metadata().schema().get_fields();
        let wanted = schema(columns)?;
        let mut due = 0;
        let mut places = Vec::with_capacity(columns.len());
        for (field, column) in wanted.get_fields().iter().zip(columns.iter()) {
            let is_there = there.get(due) == Some(field);
            ensure!(
                is_there || !column.required,
                "its columns are not those of these rows"
            );
            places.push(is_there.then_some(due));
            due += usize::from(is_there);
        }
        ensure!(
            due == there.len(),
            "its columns are not those of these rows"
        );
        Ok(Self {
            reader,
            columns: Arc::clone(columns),
            places,
        })
    }

    /// Opens a file of rows whatever its columns are.
    ///
    /// # Errors
    ///
    /// When it cannot be read, is no Parquet, or has a column of a kind that rows do not have.
    pub fn open_any(path: &Path) -> Result<Self> {
        let reader = SerializedFileReader::new(File::open(path)?)?;
        let column = |field: &Arc<Type>| {
            let kind = match (field.is_primitive()).then(|| field.get_physical_type()) {
                Some(Physical::INT64) => Kind::Whole,
                Some(Physical::BYTE_ARRAY) => Kind::Text,
                Some(Physical::BOOLEAN) => Kind::Flag,
                Some(Physical::DOUBLE) => Kind::Number,
                _ => return Err(anyhow!("its column {} is none of rows", field.name())),
            };
            let new = if field.get_basic_info().repetition() == Repetition::REQUIRED {
                Column::required
            } else {
                Column::new
            };
            Ok(new(field.name(), kind, ""))
        };
        let schema = reader.metadata().file_metadata().schema();
        let columns: Vec<Column> = schema
            .get_fields()
            .iter()
            .map(column)
            .collect::<Result<_>>()?;
        Ok(Self {
            reader,
            places: (0..columns.len()).map(Some).collect(),
            columns: columns.into(),
        })
    }

    /// The columns of the file.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Number of rows, as the file says.
    pub fn rows(&self) -> u64 {
        self.reader
            .metadata()
            .file_metadata()
            .num_rows()
            .unsigned_abs()
    }

    /// The groups of rows in turn, with only the named columns filled; all where none is named.
    pub fn groups(&self, names: &[&str]) -> impl Iterator<Item = Result<Table>> {
        (0..self.reader.num_row_groups()).map(move |index| {
            let group = self.reader.get_row_group(index)?;
            let mut table = Table::new(&self.columns);
            self.read_group(&mut table, group.as_ref(), names)?;
            Ok(table)
        })
    }

    fn read_group(
        &self,
        table: &mut Table,
        group: &dyn RowGroupReader,
        names: &[&str],
    ) -> Result<()> {
        for (index, column) in self.columns.iter().enumerate() {
            if names.is_empty() || names.contains(&column.name.as_str()) {
                table.read(index, self.places[index], group)?;
            }
        }
        table.rows += usize::try_from(group.metadata().num_rows())?;
        Ok(())
    }

    /// Hands each value of a column of numbers on, without its nulls; a group of rows is in memory at a time.
    ///
    /// # Errors
    ///
    /// When the file is damaged.
    pub fn each_number(&self, name: &str, mut each: impl FnMut(f64)) -> Result<()> {
        for table in self.groups(&[name]) {
            if let Values::Number(values) = &table?.cells(name).values {
                for value in values {
                    each(*value);
                }
            }
        }
        Ok(())
    }

    /// All values of a column of numbers, without its nulls.
    ///
    /// # Errors
    ///
    /// When the file is damaged.
    pub fn numbers(&self, name: &str) -> Result<Vec<f64>> {
        let mut all = Vec::new();
        self.each_number(name, |value| all.push(value))?;
        Ok(all)
    }
}

/// Writes the rows of `parts` into one file, in larger groups. The bytes depend on the rows
/// alone, not on where a part ends.
///
/// # Errors
///
/// When a part is damaged or `out` cannot be written.
pub fn merge(parts: &[PathBuf], columns: &Arc<[Column]>, out: impl Write + Send) -> Result<()> {
    let mut writer = Writer::new(out, columns)?;
    let mut waiting = Table::new(columns);
    for part in parts {
        let rows = Rows::open(part, columns).with_context(|| part.display().to_string())?;
        for index in 0..rows.reader.num_row_groups() {
            let group = rows.reader.get_row_group(index)?;
            rows.read_group(&mut waiting, group.as_ref(), &[])
                .with_context(|| part.display().to_string())?;
            while waiting.rows >= GROUP {
                let rest = waiting.split_off(GROUP);
                writer.group(&waiting)?;
                waiting = rest;
            }
        }
    }
    writer.group(&waiting)?;
    writer.finish()?;
    Ok(())
}

impl Table {
    /// Keeps the first rows and returns the others.
    fn split_off(&mut self, rows: usize) -> Self {
        let mut rest = Self::new(&self.columns);
        rest.rows = self.rows - rows;
        self.rows = rows;
        for (cells, rest) in self.cells.iter_mut().zip(&mut rest.cells) {
            rest.present = cells.present.split_off(rows);
            let kept: usize = cells.present.iter().filter(|p| **p != 0).count();
            match (&mut cells.values, &mut rest.values) {
                (Values::Whole(from), Values::Whole(to)) => *to = from.split_off(kept),
                (Values::Text(from), Values::Text(to)) => *to = from.split_off(kept),
                (Values::Flag(from), Values::Flag(to)) => *to = from.split_off(kept),
                (Values::Number(from), Values::Number(to)) => *to = from.split_off(kept),
                _ => unreachable!("both have the same columns"),
            }
        }
        rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(bytes: &[u8], columns: &Arc<[Column]>) -> Result<Rows> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("rows.parquet");
        std::fs::write(&path, bytes)?;
        Rows::open(&path, columns)
    }

    #[test]
    fn rows_that_are_older_than_a_column_are_read_without_it() {
        let seed = Column::required("seed", Kind::Whole, "");
        let (old, new) = (["gap_um", "rule_s"], "idle_s");
        let number = |name: &str| Column::new(name, Kind::Number, "");
        let columns: Arc<[Column]> = vec![seed.clone(), number(old[0]), number(old[1])].into();
        let mut table = Table::new(&columns);
        for seed in [3, 4] {
            table.add(vec![
                Cell::Whole(seed),
                Cell::Number(None),
                Cell::Number(Some(seed as f64)),
            ]);
        }
        let bytes = table.to_parquet().expect("in memory");
        let later: Arc<[Column]> =
            vec![seed.clone(), number(old[0]), number(new), number(old[1])].into();
        let rows = opened(&bytes, &later).expect("older rows");
        let read = rows.groups(&[]).next().expect("a group").expect("rows");
        assert_eq!(read.wholes("seed"), [3, 4]);
        assert_eq!(read.numbers(new), [None, None]);
        assert_eq!(read.numbers(old[1]), [Some(3.0), Some(4.0)]);
        // What was always there must be there, and nothing else may be.
        let required: Arc<[Column]> = vec![
            seed.clone(),
            number(old[0]),
            number(old[1]),
            Column::required(new, Kind::Whole, ""),
        ]
        .into();
        assert!(opened(&bytes, &required).is_err());
        let fewer: Arc<[Column]> = vec![seed, number(old[0])].into();
        assert!(opened(&bytes, &fewer).is_err());
    }
}
