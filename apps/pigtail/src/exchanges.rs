//! What a run recorded, as rows for other programs: one for each exchange with the machine.

use anyhow::Result;
use pigtail_hal::{Axis, Channel, Command, Error, Measurement, Side};
use pigtail_machines::record::Reader;
use pigtail_store::database::export::{Format, write_whole};
use pigtail_store::rows::{Cell, Column, Kind, Table, Writer};
use std::path::{Path, PathBuf};

/// Rows that are in memory at once, besides the file.
const GROUP: usize = 20_000;

fn columns() -> Vec<Column> {
    let mut columns = vec![
        Column::new(
            "record",
            Kind::Text,
            "the file of the record: a machine has one each",
        ),
        Column::new(
            "time_s",
            Kind::Number,
            "machine time at the end of the cycle, since power-on",
        ),
        Column::new("laser", Kind::Flag, "whether the laser was to be on"),
    ];
    let mut add = |name: String, about: &str| columns.push(Column::new(&name, Kind::Number, about));
    for side in Side::ALL.map(Side::name) {
        for axis in Axis::ALL.map(Axis::name) {
            let of = |what: &str| format!("{side}_{axis}_{what}");
            add(
                of("reference_counts"),
                "where the servo wants the axis; null where no servo holds it",
            );
            add(of("encoder_counts"), "motor encoder, from home");
            add(
                of("voltage_v"),
                "motor voltage in this cycle; pulses are not in it",
            );
            add(
                of("probe_um"),
                "output by its probe, from home; null without one",
            );
        }
        for micro in ["x", "y"] {
            add(
                format!("{side}_micro_{micro}_v"),
                "input of the micro's amplifier",
            );
        }
    }
    for channel in Channel::ALL.map(Channel::name) {
        add(
            format!("{channel}_v"),
            "photodiode; null in cycles without a new sample",
        );
    }
    columns
}

fn row<'r>(record: &'r str, command: &Command, answer: &Measurement) -> Vec<Cell<'r>> {
    let number = |value: f64| Cell::Number(Some(value));
    let mut cells = vec![
        Cell::Text(Some(record)),
        number(answer.time),
        Cell::Flag(Some(command.laser)),
    ];
    for side in Side::ALL.map(Side::index) {
        for axis in Axis::ALL.map(Axis::index) {
            let reference = command.references[side][axis].map(|counts| counts.0 as f64);
            cells.push(Cell::Number(reference));
            cells.push(number(answer.encoders[side][axis].0 as f64));
            cells.push(number(command.motors[side][axis].0));
            let probe = answer.probes.map(|probes| 1e6 * probes[side][axis]);
            cells.push(Cell::Number(probe));
        }
        cells.extend(command.micro[side].map(|volts| number(volts.0)));
    }
    for channel in Channel::ALL {
        let light = answer.light.map(|light| light.volts[channel.index()].0);
        cells.push(Cell::Number(light));
    }
    cells
}

/// Writes every exchange of these records to a file, whole or not at all; returns how many there are.
///
/// # Errors
///
/// When a record cannot be read or the file not written.
pub(crate) fn export(records: &[PathBuf], format: Format, file: &Path) -> Result<usize> {
    let columns: std::sync::Arc<[Column]> = columns().into();
    let mut csv = Vec::new();
    let mut parquet = match format {
        Format::Parquet => Some(Writer::new(Vec::new(), &columns)?),
        Format::Csv => None,
    };
    let mut rows = 0;
    let mut put = |table: &Table| -> Result<()> {
        if let Some(parquet) = &mut parquet {
            parquet.group(table)?;
        } else {
            let text = table.to_csv()?;
            // The header once.
            let from = match rows {
                0 => 0,
                _ => text
                    .iter()
                    .position(|byte| *byte == b'\n')
                    .map_or(0, |at| at + 1),
            };
            csv.extend_from_slice(&text[from..]);
        }
        rows += table.rows();
        Ok(())
    };
    for record in records {
        let name = record.file_name().unwrap_or_default().to_string_lossy();
        let mut reader = Reader::open(record)?;
        let mut table = Table::new(&columns);
        while let Some(exchange) = reader.next_exchange()? {
            // A fault has no measurement.
            if let Ok(answer) = &exchange.answer {
                table.add(row(&name, &exchange.command, answer));
            }
            if table.rows() == GROUP {
                put(&table)?;
                table = Table::new(&columns);
            }
        }
        put(&table)?;
    }
    if rows == 0 {
        let message = "holds no exchange; accepted is a record of a machine that answered";
        let name = records
            .first()
            .map_or_else(String::new, |r| r.display().to_string());
        return Err(Error::new(name, "", message).into());
    }
    let content = match parquet {
        Some(parquet) => parquet.finish()?,
        None => csv,
    };
    write_whole(file, &content)?;
    Ok(rows)
}
