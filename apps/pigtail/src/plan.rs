//! `pigtail plan`.

use crate::common::{Common, write_table};
use crate::methods::{duration, duration_or_dash};
use crate::running::stopped;
use crate::{DONE, Failure, running, tray_plan};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pigtail_evaluate::plan::{PlanDocument, plan, rows};
use pigtail_report as report;
use pigtail_session::calibrations::Part;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use serde::Serialize;
use std::io::{self, Write};
use std::time::Duration;

/// Compare the ways to align: by formula, and on the rig's twin
///
/// The thesis weighs three searches for first light by closed forms, (3.3)-(3.5). This runs each of
/// them over its whole area on the twin, at the recipe's mesh and at twice it, and sets the machine
/// time beside the formula by scan rate and the one by the photodiode's rate. A method that the
/// rig's photodiodes are too slow for runs on a rig whose are not, and says so. The whole procedures
/// follow, over some devices. Takes one or two minutes.
///
/// Writes a folder `runs/<time>-plan-<seed>/` with `report.html` (look at it) and `summary.json` (what
/// `--json` prints).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail plan                          the default rig and recipe
  pigtail plan --seed 7 --json          another machine and device, as one JSON document
  pigtail plan --rig my-rig/ --recipe my-chip.toml --devices 100")]
pub(crate) struct Arguments {
    #[command(flatten)]
    common: Common,
    /// A recipe file, or the name of one below `recipes`
    #[arg(long, default_value = DEFAULT_RECIPE_NAME)]
    recipe: String,
    /// Devices that each procedure aligns, of successive seeds
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    devices: u64,
    /// What a tray will take, from recipe and machine alone, and what limits it: a tray file, or the name of one below
    /// `trays`
    #[arg(long, value_name = "FILE", conflicts_with_all = ["recipe", "devices", "fleet"])]
    tray: Option<String>,
}

/// A plan, and where its report is.
#[derive(Serialize)]
struct Reported<'d> {
    #[serde(flatten)]
    plan: &'d PlanDocument,
    /// Path of the report.
    report: String,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let common = &arguments.common;
    if let Some(tray) = &arguments.tray {
        return tray_plan::run(common, tray);
    }
    let mut setup = common.setup(&arguments.recipe)?;
    running::warn(&setup, Part::ALIGNMENT);
    let run = running::begin(&mut setup, &common.runs, "plan", common.seed, false)?;
    let bar = ProgressBar::new(rows(&setup) as u64);
    if let Ok(style) = ProgressStyle::with_template("plan [{bar:20}] {elapsed} {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    let mut step = |name: &str| {
        bar.set_message(name.to_owned());
        bar.inc(1);
    };
    bar.enable_steady_tick(Duration::from_millis(200));
    let planned = plan(&setup, common.seed, arguments.devices, &mut step);
    bar.finish_and_clear();
    let document = planned.map_err(|ended| stopped(&run, &setup, ended))?;
    let reported = Reported {
        plan: &document,
        report: run.path("report.html").display().to_string(),
    };
    let on = running::on(&setup, &reported, None);
    run.write_json("summary.json", &on)?;
    run.write("report.html", report::plan(&document)?)?;
    run.finish("done")?;
    let mut text = Vec::new();
    if common.json {
        serde_json::to_writer(&mut text, &on).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        print_tables(&mut text, &document).map_err(anyhow::Error::from)?;
        text.extend(format!("Report: {}\n", reported.report).bytes());
        text.extend(running::line(&setup).bytes());
    }
    crate::print(&text)?;
    Ok(DONE)
}

fn print_tables(out: &mut impl Write, document: &PlanDocument) -> io::Result<()> {
    let header = [
        "first light",
        "mesh\num",
        "scan\nHz",
        "by scan\nrate",
        "by photo-\ndiode",
        "measured",
        "a fiber",
        "found\nafter",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    let mut notes = Vec::new();
    for row in &document.searches {
        let mut name = row.method.to_owned();
        if !row.note.is_empty() {
            let known = notes.iter().position(|note| *note == &row.note);
            let number = known.unwrap_or_else(|| {
                notes.push(&row.note);
                notes.len() - 1
            });
            name = format!("{name} ({})", number + 1);
        }
        rows.push(vec![
            name,
            row.mesh_um.to_string(),
            format!("{:.0}", row.scan_hz),
            duration(row.closed_form_seconds),
            duration(row.photodiode_limited_seconds),
            duration_or_dash(row.measured_seconds),
            duration_or_dash(row.seconds_per_fiber),
            duration_or_dash(row.found_seconds),
        ]);
    }
    write_table(out, &rows)?;
    for (i, note) in notes.iter().enumerate() {
        writeln!(out, "({}) {note}", i + 1)?;
    }
    writeln!(out)?;
    let header = [
        "procedure",
        "devices\naligned",
        "mean\na fiber",
        "longest\nfiber",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    for row in &document.procedures {
        rows.push(vec![
            row.procedure.to_owned(),
            format!("{} of {}", row.successes, row.devices),
            duration(row.mean_seconds_per_fiber),
            duration(row.max_seconds_per_fiber),
        ]);
    }
    write_table(out, &rows)?;
    writeln!(
        out,
        "\nFirst light: machine time to cover the whole area on the twin of seed {}; the first two \
         methods\nserve a device's three fibers at once. Procedures: from the tray to an attached \
         fiber. Simulated in {:.0} s.",
        document.seed, document.wall_seconds
    )
}
