//! The store's rows for other programs: a row a fiber, or a row a phase, as CSV or Parquet.

use super::Database;
use super::query::{Fiber, Listed, Produced, Shown};
use crate::rows::{Cell, Column, Kind, Table};
use anyhow::{Context, Result};
use pigtail_hal::Error;
use std::fs;
use std::path::{Path, PathBuf};

/// What a row is.
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
)]
#[strum(serialize_all = "kebab-case")]
pub enum Rows {
    /// A fiber, with a column for each phase
    Fibers,
    /// A phase of a fiber, each time that it was entered
    Phases,
    /// A fiber of a tray, as it was produced
    Pigtails,
}

/// How a file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated values; what is not there is empty.
    Csv,
    /// Parquet, with what each column means in its metadata.
    Parquet,
}

/// Writes the rows of some runs to a file, whole or not at all, and returns how many there are.
///
/// # Errors
///
/// When the store cannot be read or the file not written.
pub fn export(
    database: &Database,
    runs: &[Listed],
    rows: Rows,
    format: Format,
    file: &Path,
) -> Result<usize> {
    let mut shown = Vec::new();
    for run in runs {
        // One that was abandoned meanwhile has no rows.
        shown.extend(database.shown(&run.run)?);
    }
    let table = table(&shown, rows);
    let content = match format {
        Format::Csv => table.to_csv()?,
        Format::Parquet => table.to_parquet()?,
    };
    write_whole(file, &content).context("no rows were exported")?;
    Ok(table.rows())
}

/// Writes a file whole or not at all.
///
/// # Errors
///
/// When it cannot be written.
pub fn write_whole(file: &Path, content: &[u8]) -> Result<(), Error> {
    let mut partial = file.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    fs::write(&partial, content)
        .and_then(|()| fs::rename(&partial, file))
        .inspect_err(|_| {
            // Half a file helps nobody.
            let _ = fs::remove_file(&partial);
        })
        .map_err(|error| {
            let message = format!(
                "cannot be written ({error}); accepted is a file in a folder that may be written"
            );
            Error::new(file.display().to_string(), "", message)
        })
}

fn table(runs: &[Shown], rows: Rows) -> Table {
    let phases = phase_names(runs);
    let columns = match rows {
        Rows::Fibers => fiber_columns(&phases),
        Rows::Phases => phase_columns(),
        Rows::Pigtails => pigtail_columns(),
    };
    let mut table = Table::new(&columns.into());
    for run in runs {
        if rows == Rows::Pigtails {
            for pigtail in &run.pigtails {
                table.add(pigtail_row(run, pigtail));
            }
            continue;
        }
        for fiber in &run.fibers {
            match rows {
                Rows::Fibers => table.add(fiber_row(run, fiber, &phases)),
                Rows::Phases | Rows::Pigtails => {
                    for index in 0..fiber.phases.len() {
                        table.add(phase_row(run, fiber, index));
                    }
                }
            }
        }
    }
    table
}

/// The names of all phases, in the order in which they first come.
fn phase_names(runs: &[Shown]) -> Vec<&str> {
    let mut names = Vec::new();
    for phase in runs
        .iter()
        .flat_map(|run| &run.fibers)
        .flat_map(|fiber| &fiber.phases)
    {
        if !names.contains(&phase.name.as_str()) {
            names.push(phase.name.as_str());
        }
    }
    names
}

/// What tells a run and its device from others.
fn run_columns() -> Vec<Column> {
    let text = |name: &str, about: &str| Column::new(name, Kind::Text, about);
    vec![
        text("run", "the name of the run's folder"),
        text("started", "when the run began, RFC 3339"),
        text(
            "state",
            "complete, interrupted, running or fault: how far the run came",
        ),
        text("version", "the program's version"),
        text("rig", "the rig as it was named"),
        text("recipe", "the recipe as it was named"),
        text("procedure", "how the device was aligned"),
        text("scenario", "how the truth was changed"),
        text("seed", "replays the device: pigtail align --seed"),
        text("port", "the fiber's port"),
    ]
}

fn run_cells<'a>(run: &'a Shown, fiber: &'a Fiber) -> Vec<Cell<'a>> {
    let device = run.device.as_ref();
    let text = |value: &'a str| Cell::Text(Some(value));
    vec![
        text(&run.listed.run),
        text(&run.listed.started),
        text(run.listed.state.name()),
        text(&run.listed.version),
        Cell::Text(device.map(|d| d.rig.as_str())),
        Cell::Text(device.map(|d| d.recipe.as_str())),
        Cell::Text(device.map(|d| d.procedure.as_str())),
        Cell::Text(device.map(|d| d.scenario.as_str())),
        text(&run.listed.seed),
        text(&fiber.port),
    ]
}

fn fiber_columns(phases: &[&str]) -> Vec<Column> {
    let number = |name: &str, about: &str| Column::new(name, Kind::Number, about);
    let mut columns = run_columns();
    columns.extend([
        Column::new(
            "outcome",
            Kind::Text,
            "what control says of it; null where the run ended early",
        ),
        Column::new("detail", Kind::Text, "the same in a sentence"),
        Column::new(
            "within_tolerance",
            Kind::Flag,
            "whether it really is; null unless attached",
        ),
        Column::new(
            "collision",
            Kind::Flag,
            "whether anything touched the chip: the truth",
        ),
        number("seconds", "machine time of the fiber"),
    ]);
    for phase in phases {
        let about = format!(
            "machine time of the phase {phase}, all times it was entered; null unless it was"
        );
        columns.push(number(&format!("{phase}_s"), &about));
    }
    let truth = "the truth; null unless attached";
    columns.extend([
        number("offset_x_um", &format!("across the chip, {truth}")),
        number("offset_y_um", &format!("up from the chip, {truth}")),
        number(
            "offset_z_um",
            &format!("gap beyond the wanted one, {truth}"),
        ),
        number("coupling_loss_db", &format!("at this interface, {truth}")),
    ]);
    columns
}

fn fiber_row<'a>(run: &'a Shown, fiber: &'a Fiber, phases: &[&str]) -> Vec<Cell<'a>> {
    let mut row = run_cells(run, fiber);
    row.extend([
        Cell::Text(fiber.outcome.as_deref()),
        Cell::Text(fiber.detail.as_deref()),
        Cell::Flag(fiber.within_tolerance),
        Cell::Flag(run.device.as_ref().and_then(|device| device.collision)),
        Cell::Number(Some(fiber.seconds)),
    ]);
    for name in phases {
        let entered = fiber.phases.iter().filter(|phase| phase.name == *name);
        let seconds = entered.map(|phase| phase.seconds).reduce(|sum, s| sum + s);
        row.push(Cell::Number(seconds));
    }
    row.extend(fiber.offset_um.map(Cell::Number));
    row.push(Cell::Number(fiber.coupling_loss_db));
    row
}

fn phase_columns() -> Vec<Column> {
    let mut columns = run_columns();
    columns.extend([
        Column::new("phase", Kind::Text, "the phase's name"),
        Column::new("start_s", Kind::Number, "when it began, machine time"),
        Column::new("seconds", Kind::Number, "how long it took, machine time"),
    ]);
    columns
}

fn phase_row<'a>(run: &'a Shown, fiber: &'a Fiber, index: usize) -> Vec<Cell<'a>> {
    let phase = &fiber.phases[index];
    let mut row = run_cells(run, fiber);
    row.extend([
        Cell::Text(Some(&phase.name)),
        Cell::Number(Some(phase.start_s)),
        Cell::Number(Some(phase.seconds)),
    ]);
    row
}

fn pigtail_columns() -> Vec<Column> {
    let text = |name: &str, about: &str| Column::new(name, Kind::Text, about);
    let number = |name: &str, about: &str| Column::new(name, Kind::Number, about);
    vec![
        text("run", "the name of the run's folder"),
        text("started", "when the run began, RFC 3339"),
        text("state", "how far the run came"),
        text("version", "the program's version"),
        text("seed", "the seed of the tray"),
        text("device", "serial number of the device"),
        text("place", "its place on the tray"),
        text("port", "the fiber's port"),
        text("fiber", "serial number of the fiber"),
        text("fiber_place", "where it lay"),
        text("recipe", "the production recipe"),
        text("calibration", "SHA-256 of the calibration"),
        text("operator", "who was at the machine"),
        text("outcome", "pigtailed, or why not"),
        number(
            "added_loss_db",
            "loss that cure and release have added, by the light",
        ),
        number("sigma_db", "its standard deviation"),
        number(
            "off_um",
            "how far from its peak it is after that, by the light",
        ),
        number("off_sigma_um", "its standard deviation"),
        number("shift_um", "how far the adhesive has shifted it in all"),
        number("seconds", "machine time of the fiber"),
    ]
}

fn pigtail_row<'a>(run: &'a Shown, pigtail: &'a Produced) -> Vec<Cell<'a>> {
    let text = |value: &'a str| Cell::Text(Some(value));
    vec![
        text(&run.listed.run),
        text(&run.listed.started),
        text(run.listed.state.name()),
        text(&run.listed.version),
        text(&run.listed.seed),
        text(&pigtail.device),
        text(&pigtail.place),
        text(&pigtail.port),
        text(&pigtail.fiber),
        text(&pigtail.fiber_place),
        text(&pigtail.recipe),
        text(&pigtail.calibration),
        text(&pigtail.operator),
        text(&pigtail.outcome),
        Cell::Number(pigtail.added_loss_db),
        Cell::Number(pigtail.sigma_db),
        Cell::Number(pigtail.off_um),
        Cell::Number(pigtail.off_sigma_um),
        Cell::Number(pigtail.shift_um),
        Cell::Number(Some(pigtail.seconds)),
    ]
}
