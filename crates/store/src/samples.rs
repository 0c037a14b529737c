//! The samples of an experiment: columns of numbers, kept with its run as CSV and as Parquet.

use crate::rows::{Cell, Column, Kind, Table};
use crate::runs::Run;
use anyhow::Result;

/// Columns of one length.
#[derive(Debug, Clone, Default)]
pub struct Samples(Vec<(Column, Vec<f64>)>);

impl Samples {
    /// With a column more: its name with the unit, and what it means. One without values is left out.
    #[must_use]
    pub fn with(mut self, name: &str, about: &str, values: Vec<f64>) -> Self {
        if !values.is_empty() {
            self.0
                .push((Column::new(name, Kind::Number, about), values));
        }
        self
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// As rows; a column that ends earlier has no values from there on.
    pub fn table(&self) -> Table {
        let columns: Vec<Column> = self.0.iter().map(|(column, _)| column.clone()).collect();
        let mut table = Table::new(&columns.into());
        let rows = self.0.iter().map(|(_, values)| values.len()).max();
        for row in 0..rows.unwrap_or(0) {
            let cells = self.0.iter().map(|(_, values)| {
                let value = values.get(row).copied().filter(|value| value.is_finite());
                Cell::Number(value)
            });
            table.add(cells.collect());
        }
        table
    }

    /// Writes `samples.csv` and `samples.parquet` into a run, if there are any.
    ///
    /// # Errors
    ///
    /// When a file cannot be written.
    pub fn keep(&self, run: &Run) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        let table = self.table();
        run.write("samples.csv", table.to_csv()?)?;
        run.write("samples.parquet", table.to_parquet()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_ends_earlier_has_no_values_from_there_on() {
        let samples = Samples::default()
            .with("time_s", "time", vec![0.0, 0.5])
            .with("none", "of what is not there", Vec::new())
            .with("x_um", "place", vec![1.25]);
        let csv = samples.table().to_csv().unwrap();
        assert_eq!(csv, b"time_s,x_um\n0,1.25\n0.5,\n");
        assert!(Samples::default().is_empty());
    }
}
