//! `pigtail align`.

use super::common::Common;
use super::progress::Progress;
use super::{DONE, Failure, NEGATIVE, failure};
use crate::align::{Document, align};
use crate::record::Record;
use crate::report;
use crate::rig::{DEFAULT_RECIPE_NAME, Setup};
use crate::runs::Run;
use clap::Args;
use comfy_table::{
    CellAlignment, ContentArrangement, ContentLineStyle, LineStyle, Table, TableStyle,
};
use pigtail_control::station::{Observer, Sample};
use std::io::{self, Write};

/// Align the three fibers of one device on the rig's twin
///
/// The twin is drawn around the rig's `plant.toml` by the seed: another seed is another machine,
/// another device, another misplacement of everything. Control sees encoders, photodiodes and
/// vision, never the truth; the offsets in the table are the truth, asked for afterwards.
///
/// Writes a folder `runs/<time>-<seed>/` with `report.html` (look at it), `summary.json` (what
/// `--json` prints), `samples.csv` (every light sample with its place) and `run.json` (version
/// and configuration hashes).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail align                         the default rig and recipe
  pigtail align --seed 7 --json         another machine and device, as one JSON document
  pigtail align --rig my-rig/           your own rig: machine.toml, plant.toml, calibration.toml
  pigtail align --recipe my-chip.toml   your own device")]
pub(super) struct Arguments {
    #[command(flatten)]
    common: Common,
    /// A recipe file, or the name of one below `recipes`
    #[arg(long, default_value = DEFAULT_RECIPE_NAME)]
    recipe: String,
}

/// The record, and a progress bar beside it.
struct Watcher {
    record: Record,
    progress: Progress,
}

impl Observer for Watcher {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.record.phase(port, phase, time);
        self.progress.phase(port, phase, time);
    }

    fn sample(&mut self, sample: &Sample) {
        self.record.sample(sample);
        self.progress.sample(sample);
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let setup = Setup::load(&arguments.common.rig, &arguments.recipe)?;
    let run = Run::begin(&arguments.common.runs, "", arguments.common.seed)?;
    let full = setup.spec.photodiode.range;
    let mut watcher = Watcher {
        record: Record::default(),
        progress: Progress::new(full),
    };
    let mut document = align(&setup, arguments.common.seed, &mut watcher)
        .map_err(|error| failure(error, &arguments.common.rig))?;
    watcher.progress.finish();
    let record = &watcher.record;
    document.report = run.path("report.html").display().to_string();
    run.write_json("summary.json", &document)?;
    run.write("samples.csv", record.csv())?;
    run.write("report.html", report::alignment(&setup, &document, record)?)?;
    run.finish(&setup, arguments.common.seed)?;
    let mut text = Vec::new();
    if arguments.common.json {
        serde_json::to_writer(&mut text, &document).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        print_table(&mut text, &document).map_err(anyhow::Error::from)?;
    }
    super::print(&text)?;
    Ok(if document.is_success() {
        DONE
    } else {
        NEGATIVE
    })
}

/// Lines above and below the header and nothing else: numbers side by side need no grid.
const STYLE: TableStyle = TableStyle::new()
    .header_separator(LineStyle::none().fill('─').junction('─'))
    .content_lines(ContentLineStyle::none());

/// A row a fiber where the terminal is wide enough, else a column a fiber.
fn print_table(out: &mut impl Write, document: &Document) -> io::Result<()> {
    let rows = rows(document);
    let wide = table(&rows);
    let width = wide
        .lines()
        .map(|line| line.chars().count())
        .max()
        .unwrap_or(0);
    let room = wide.width().map_or(usize::MAX, usize::from);
    if width <= room {
        writeln!(out, "{}", wide.trim_fmt())?;
    } else {
        let columns = rows[0].len();
        let turned: Vec<Vec<String>> = (0..columns)
            .map(|i| rows.iter().map(|row| row[i].replace('\n', " ")).collect())
            .collect();
        writeln!(out, "{}", table(&turned).trim_fmt())?;
    }
    for fiber in document
        .fibers
        .iter()
        .filter(|fiber| fiber.outcome != "aligned")
    {
        writeln!(out, "{}: {}", fiber.port, fiber.detail)?;
    }
    if document.collision {
        writeln!(out, "A fiber hit the chip.")?;
    }
    writeln!(
        out,
        "\n{:.1} s of machine time a fiber. Offsets are the truth, from the twin of seed {}.",
        document.seconds_per_fiber, document.seed
    )?;
    writeln!(out, "Report: {}", document.report)
}

fn table(rows: &[Vec<String>]) -> Table {
    let mut table = Table::new();
    table
        .load_style(STYLE)
        .set_content_arrangement(ContentArrangement::Disabled);
    table.set_header(&rows[0]);
    table.add_rows(&rows[1..]);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// The header and a row a fiber.
fn rows(document: &Document) -> Vec<Vec<String>> {
    let names = document.phase_names();
    let mut header = vec!["fiber".to_owned(), "outcome".to_owned()];
    header.extend(names.iter().map(|name| format!("{name}\ns")));
    header.extend(["in all\ns", "x\num", "y\num", "z\num", "loss\ndB"].map(str::to_owned));
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
    };
    let mut rows = vec![header];
    rows.extend(document.fibers.iter().map(|fiber| {
        let mut row = vec![fiber.port.to_owned(), fiber.verdict().to_owned()];
        row.extend(names.iter().map(|name| number(fiber.seconds_in(name), 1)));
        let offset = fiber.offset_um;
        row.push(number(Some(fiber.seconds), 1));
        row.push(number(offset.map(|o| o.x), 3));
        row.push(number(offset.map(|o| o.y), 3));
        row.push(number(offset.map(|o| o.z), 2));
        row.push(number(fiber.coupling_loss_db, 2));
        row
    }));
    rows
}
