//! `pigtail runs`.

mod replay;

use crate::choice::choice;
use crate::common::write_table;
use crate::{DONE, Failure, NEGATIVE, exchanges, kinds};
use clap::{Args, Subcommand};
use pigtail_hal::Error;
use pigtail_store::compare::{Side, compare as compared};
use pigtail_store::database::export::{Format, Rows, export, write_whole};
use pigtail_store::database::query::{Fiber, Listed, Produced, Shown, folders};
use pigtail_store::database::verify::{Verified, without_store};
use pigtail_store::database::{Database, FILE, State};
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// List, show, compare, export and verify runs: how a device was aligned, years later
///
/// Every run is entered in a database beside the runs' folders, `pigtail.db` (SQLite): the command,
/// the program's version, the hash of everything that was read, each phase when it ends, how each fiber
/// ended, calibrations that were written, faults, and the hash of every file.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
    /// The folder of runs
    #[arg(long, value_name = "FOLDER", default_value = "runs", global = true)]
    runs: PathBuf,
}

#[derive(Debug, Subcommand)]
enum What {
    List(ListArguments),
    Show(ShowArguments),
    Compare(CompareArguments),
    Export(ExportArguments),
    Verify(VerifyArguments),
    Replay(replay::Arguments),
}

/// List the runs, the newest last
///
/// A run is complete, running, stopped by a fault of the machine, or interrupted: its process was
/// killed, or ended early. What is there of an interrupted one is in a hidden folder,
/// `.<run>.partial`. Runs that were made before there was a store, or brought from elsewhere, are told
/// apart as not in the store.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail runs list
  pigtail runs list --seed 7                how the device of seed 7 was aligned, campaigns too
  pigtail runs list --state fault --json
  pigtail runs list --runs /data/line3 --kind align --last 20")]
struct ListArguments {
    #[command(flatten)]
    filter: Filter,
    /// Only the last N
    #[arg(long, value_name = "N", value_parser = crate::from_zero::<usize>)]
    last: Option<usize>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Which runs.
#[derive(Debug, Args)]
struct Filter {
    /// Only those of a command, such as align, identify or "identify windup"
    #[arg(long)]
    kind: Option<String>,
    /// Only those in which the device of this seed was
    #[arg(long, value_parser = crate::from_zero::<u64>)]
    seed: Option<u64>,
    /// Only those that came so far
    #[arg(long, value_parser = choice::<State>())]
    state: Option<State>,
}

impl Filter {
    fn takes(&self, run: &Listed) -> bool {
        let has_seed = |seed: u64| {
            let first = run.seed.parse::<u64>().ok();
            first.is_some_and(|first| seed >= first && seed - first < run.devices.max(1))
        };
        let is_of = |kind: &String| {
            let rest = run.kind.strip_prefix(kind.as_str());
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
        };
        self.kind.as_ref().is_none_or(is_of)
            && self.seed.is_none_or(has_seed)
            && self.state.is_none_or(|state| run.state == state)
    }

    fn takes_all(&self) -> bool {
        self.kind.is_none() && self.seed.is_none() && self.state.is_none()
    }
}

/// Show all that is known of a run
///
/// Where a configuration that was read is a calibration that an earlier run wrote, that run is named.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail runs show 20261121T115745-0
  pigtail runs show runs/20261121T115745-0 --json")]
struct ShowArguments {
    /// Its name, as `pigtail runs list` tells it, or its folder
    run: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Compare two runs: what they found, how it is distributed, their samples over each other
///
/// Values of the two summaries that are not alike are listed with their change, gains and responses among them. Of
/// campaigns the columns of their rows are set beside each other: percentiles, the greatest distance of the two
/// distributions, and how often chance alone makes it as great. With --report a page is written that draws them, and the
/// samples of single runs, over each other.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail runs compare 20261121T024402-tune-0 20261121T030110-tune-0
  pigtail runs compare runs/20261121T140935-campaign-0 old/20261120T101010-campaign-0 --report compared.html")]
struct CompareArguments {
    /// A run, by its name or folder
    a: String,
    /// Another one
    b: String,
    /// A page to write
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Export the fibers of alignments, their phases, the pigtails of trays, or all samples of a run, as CSV or Parquet
///
/// A row a fiber with a column for each phase, or a row for each time that a phase was entered; the run,
/// the device and how it was aligned stand in each. What a Parquet column means is also in the file's
/// metadata. A campaign's rows are in Parquet already, in its folder, and are not repeated.
///
/// With --samples of one run: a row for each servo cycle of all that it recorded, with references, encoders, voltages,
/// probes and light. Whatever runs on a machine records it (`runs replay`), but for what works on many machines.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail runs export --csv fibers.csv
  pigtail runs export --parquet phases.parquet --rows phases
  pigtail runs export --to pigtails.csv --rows pigtails
  pigtail runs export --to line3.csv --runs /data/line3 --state complete
  pigtail runs export --samples 20261121T024402-tune-0 --to cycles.parquet")]
#[group(id = "where", required = true, multiple = false, args = ["csv", "parquet", "to"])]
struct ExportArguments {
    /// A CSV file to write
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// A Parquet file to write
    #[arg(long, value_name = "FILE")]
    parquet: Option<PathBuf>,
    /// A file to write, whose name ends in .csv or .parquet
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    /// What a row is
    #[arg(long, value_parser = choice::<Rows>(), default_value = "fibers")]
    rows: Rows,
    /// Instead, every servo cycle that this run recorded, by its name or folder
    #[arg(long, value_name = "RUN", conflicts_with_all = ["rows", "kind", "seed", "state"])]
    samples: Option<PathBuf>,
    #[command(flatten)]
    filter: Filter,
}

/// Verify that runs are still what was written
///
/// Hashes every file of every run again, and all that the store says of it, and compares them with what
/// was entered when the run ended: a byte that changed, a file that is gone, one that was not there and
/// a changed row of the database are told with the run and the file. SQLite checks its own file too.
///
/// This finds damage and slips. It does not stop a forger: the hashes are in the same database, with no
/// secret in them, and whoever can write there can write new ones. To be sure against that too, keep a
/// copy of pigtail.db where nobody can change it.
#[derive(Debug, Args)]
#[command(after_help = "\
Exit codes:
  0  all is as it was written
  1  something is not; each run and file is named
  2  the database itself is damaged or cannot be read")]
struct VerifyArguments {
    /// Only this run, by its name or folder
    run: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let runs = &arguments.runs;
    match &arguments.what {
        What::List(arguments) => list(arguments, runs),
        What::Show(arguments) => show(arguments, runs),
        What::Compare(arguments) => compare(arguments, runs),
        What::Export(arguments) => write_rows(arguments, runs),
        What::Verify(arguments) => verify(arguments, runs),
        What::Replay(arguments) => replay::run(arguments, runs),
    }
}

/// A folder of runs.
struct Folder {
    database: Option<Database>,
    known: Vec<Listed>,
    /// Names of those that the store knows nothing of.
    others: Vec<String>,
}

impl Folder {
    fn open(runs: &Path) -> Result<Self, Error> {
        let mut others = folders(runs)?;
        let Some(database) = Database::open(runs)? else {
            return Ok(Self {
                database: None,
                known: Vec::new(),
                others,
            });
        };
        let known = database.runs_listed()?;
        others.retain(|name| !known.iter().any(|run| run.run == *name));
        Ok(Self {
            database: Some(database),
            known,
            others,
        })
    }
}

fn list(arguments: &ListArguments, runs: &Path) -> Result<u8, Failure> {
    let Folder {
        mut known,
        mut others,
        ..
    } = Folder::open(runs)?;
    known.retain(|run| arguments.filter.takes(run));
    if !arguments.filter.takes_all() {
        // Nothing is known of them by which they could be told apart.
        others.clear();
    }
    let first = arguments.last.map_or(0, |n| known.len().saturating_sub(n));
    let shown = &known[first..];
    if arguments.json {
        let document = json!({ "runs": shown, "not_in_store": others });
        crate::print(format!("{document}\n").as_bytes())?;
        return Ok(DONE);
    }
    let mut text = Vec::new();
    if !shown.is_empty() {
        write_table(&mut text, &table(shown)).map_err(anyhow::Error::from)?;
    }
    let mut end = String::new();
    if !others.is_empty() {
        let _ = writeln!(
            end,
            "Not in the store, so nothing but their folders is known:"
        );
        for name in &others {
            let _ = writeln!(end, "  {name}");
        }
    }
    if shown.is_empty() && others.is_empty() {
        let _ = writeln!(end, "No runs in {}.", runs.display());
    }
    text.extend(end.into_bytes());
    crate::print(&text)?;
    Ok(DONE)
}

/// A row a run.
fn table(runs: &[Listed]) -> Vec<Vec<String>> {
    let seconds = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |s| format!("{s:.2}"));
    let header = [
        "run",
        "state",
        "outcome",
        "machine\ns",
        "kind",
        "seed",
        "took\ns",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    rows.extend(runs.iter().map(|run| {
        vec![
            run.run.clone(),
            run.state.name().to_owned(),
            run.outcome.clone().unwrap_or_else(|| "-".to_owned()),
            seconds(run.machine_seconds),
            run.kind.clone(),
            run.seed.clone(),
            seconds(run.wall_seconds),
        ]
    }));
    rows
}

/// The name of a run that was named or whose folder was.
fn name_of(run: &str) -> String {
    let last = Path::new(run).file_name().unwrap_or_default();
    let last = last.to_string_lossy();
    let hidden = last
        .strip_prefix('.')
        .and_then(|l| l.strip_suffix(".partial"));
    hidden.unwrap_or(&last).to_owned()
}

/// What to say of a run that the store does not know.
fn unknown(name: &str, runs: &Path, others: &[String]) -> Failure {
    let message = if others.iter().any(|other| other == name) {
        format!(
            "is not in the store {}: it was made before there was one, or brought from elsewhere, and \
             only its folder is known; accepted is a run that `pigtail runs list` shows in its table",
            runs.join(FILE).display()
        )
    } else {
        format!(
            "no such run in {}; accepted is a name that `pigtail runs list` shows",
            runs.display()
        )
    };
    Error::new(name, "", message).into()
}

fn show(arguments: &ShowArguments, runs: &Path) -> Result<u8, Failure> {
    let Folder {
        database, others, ..
    } = Folder::open(runs)?;
    let name = name_of(&arguments.run);
    let shown = match &database {
        Some(database) => database.shown(&name)?,
        None => None,
    };
    let shown = shown.ok_or_else(|| unknown(&name, runs, &others))?;
    let text = if arguments.json {
        let json = serde_json::to_string(&shown).map_err(anyhow::Error::from)?;
        format!("{json}\n")
    } else {
        account(&shown)
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

fn compare(arguments: &CompareArguments, runs: &Path) -> Result<u8, Failure> {
    let folder = |run: &str| {
        let found = [PathBuf::from(run), runs.join(run)];
        let found = found.into_iter().find(|folder| folder.is_dir());
        found.ok_or_else(|| unknown(run, runs, &[]))
    };
    let (a, b) = (folder(&arguments.a)?, folder(&arguments.b)?);
    kinds::alike(&a, &b)?;
    let (a, b) = (Side::read(&a)?, Side::read(&b)?);
    let found = compared(&a, &b);
    if let Some(file) = &arguments.report {
        let page = pigtail_report::compare(&found, &a, &b)?;
        write_whole(file, page.as_bytes())?;
    }
    let mut text = if arguments.json {
        let json = serde_json::to_string(&found).map_err(anyhow::Error::from)?;
        format!("{json}\n")
    } else {
        pigtail_report::compared(&found)
    };
    if let (Some(file), false) = (&arguments.report, arguments.json) {
        let _ = writeln!(text, "Report: {}", file.display());
    }
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

/// What a person wants to know of a run.
fn account(run: &Shown) -> String {
    let listed = &run.listed;
    let mut text = String::new();
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "{name:10} {value}");
    };
    line("run", &listed.run);
    line("kind", &listed.kind);
    line("seed", &listed.seed);
    line("state", listed.state.name());
    line("outcome", listed.outcome.as_deref().unwrap_or("-"));
    line("command", &run.command.join(" "));
    line("version", &listed.version);
    line("started", &listed.started);
    line("finished", listed.finished.as_deref().unwrap_or("-"));
    if let Some(seconds) = listed.wall_seconds {
        line("took", &format!("{seconds:.3} s"));
    }
    if let Some(seconds) = listed.machine_seconds {
        line("machine", &format!("{seconds:.4} s of machine time"));
    }
    line("folder", &run.folder.display().to_string());
    if let Some(device) = &run.device {
        line("rig", &device.rig);
        line("recipe", &device.recipe);
        line("procedure", &device.procedure);
        line("scenario", &device.scenario);
        if listed.devices > 1 {
            let devices = format!(
                "{}, of seeds from {} on; their rows are in the run's Parquet files",
                listed.devices, device.seed
            );
            line("devices", &devices);
        }
        if let Some(gap) = device.smallest_gap_um {
            let touched = if device.collision == Some(true) {
                ": it was touched"
            } else {
                ""
            };
            line("nearest", &format!("{gap:.3} um from the chip{touched}"));
        }
    }
    line(
        "seal",
        run.seal
            .as_deref()
            .unwrap_or("none: it did not come to its end"),
    );
    text.push_str("\nread, by SHA-256\n");
    for read in &run.configuration {
        let _ = writeln!(text, "  {}  {}", read.sha256, read.file);
        if let Some(by) = &read.written_by {
            let _ = writeln!(text, "    as written by {by}");
        }
    }
    if !run.calibrations.is_empty() {
        text.push_str("\ncalibrations written\n");
        for written in &run.calibrations {
            let _ = writeln!(
                text,
                "  {}  {}, {}",
                written.sha256, written.file, written.table
            );
        }
    }
    for fault in &run.faults {
        let _ = writeln!(
            text,
            "\nfault: {} on {} at {:.4} s: {}, where {} is accepted",
            fault.rule, fault.axis, fault.time_s, fault.value, fault.limit
        );
    }
    for fiber in &run.fibers {
        text.push('\n');
        text.push_str(&fiber_account(fiber));
    }
    if !run.pigtails.is_empty() {
        text.push_str("\npigtails, after cure and release by the light\n");
        text.push_str(&pigtail_report::text::table(
            &pigtail_rows(&run.pigtails),
            pigtail_report::text::room(),
        ));
    }
    if !run.files.is_empty() {
        text.push_str("\nfiles, by SHA-256\n");
        for file in &run.files {
            let _ = writeln!(
                text,
                "  {}  {} ({} bytes)",
                file.sha256, file.path, file.bytes
            );
        }
    }
    text
}

fn pigtail_rows(pigtails: &[Produced]) -> Vec<Vec<String>> {
    let known = |value: Option<f64>, sigma: Option<f64>| match (value, sigma) {
        (Some(value), Some(sigma)) => format!("{value:.3} +- {sigma:.3}"),
        _ => "-".to_owned(),
    };
    let header = [
        "device",
        "port",
        "fiber",
        "from",
        "outcome",
        "added, dB",
        "off, um",
    ];
    let rows = pigtails.iter().map(|p| {
        vec![
            p.device.clone(),
            p.port.clone(),
            p.fiber.clone(),
            p.fiber_place.clone(),
            p.outcome.clone(),
            known(p.added_loss_db, p.sigma_db),
            known(p.off_um, p.off_sigma_um),
        ]
    });
    std::iter::once(header.map(str::to_owned).to_vec())
        .chain(rows)
        .collect()
}

fn fiber_account(fiber: &Fiber) -> String {
    let mut text = String::new();
    let ended = fiber
        .detail
        .as_deref()
        .unwrap_or("the run ended before it did");
    let _ = write!(text, "{}: {ended}, {:.4} s", fiber.port, fiber.seconds);
    if let [Some(x), Some(y), Some(z)] = fiber.offset_um {
        let _ = write!(text, "; in truth {x:.3}, {y:.3}, {z:.2} um off");
    }
    if let Some(loss) = fiber.coupling_loss_db {
        let _ = write!(text, ", {loss:.2} dB lost");
    }
    text.push('\n');
    for phase in &fiber.phases {
        let _ = writeln!(
            text,
            "  {:10} {:8.4} s, from {:.4} s",
            phase.name, phase.seconds, phase.start_s
        );
    }
    text
}

fn write_rows(arguments: &ExportArguments, runs: &Path) -> Result<u8, Failure> {
    let (file, format) = match (&arguments.csv, &arguments.parquet, &arguments.to) {
        (Some(file), ..) => (file, Format::Csv),
        (_, Some(file), _) => (file, Format::Parquet),
        (.., Some(file)) => match file.extension().and_then(|end| end.to_str()) {
            Some("csv") => (file, Format::Csv),
            Some("parquet") => (file, Format::Parquet),
            _ => {
                let message = format!(
                    "{} does not tell what to write; accepted is a name that ends in .csv or .parquet",
                    file.display()
                );
                return Err(Error::new("--to", "", message).into());
            }
        },
        (None, None, None) => unreachable!("one of them is required"),
    };
    if let Some(run) = &arguments.samples {
        let rows = exchanges::export(&replay::records_of(run, runs), format, file)?;
        let text = format!("{rows} cycles written to {}\n", file.display());
        crate::print(text.as_bytes())?;
        return Ok(DONE);
    }
    let Folder {
        database,
        mut known,
        ..
    } = Folder::open(runs)?;
    let Some(database) = database else {
        let message = format!(
            "has no store of runs ({FILE}); accepted is a folder in which a run was made since there is \
             one"
        );
        return Err(Error::new(runs.display().to_string(), "", message).into());
    };
    known.retain(|run| arguments.filter.takes(run));
    let rows = export(&database, &known, arguments.rows, format, file)?;
    let text = format!("{rows} rows written to {}\n", file.display());
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

fn verify(arguments: &VerifyArguments, runs: &Path) -> Result<u8, Failure> {
    let only = arguments.run.as_deref().map(name_of);
    let verified = match Database::open(runs)? {
        Some(database) => database.verify(only.as_deref())?,
        None => without_store(runs)?,
    };
    if let Some(name) = &only
        && verified.looked_at() == 0
    {
        return Err(unknown(name, runs, &verified.not_in_store));
    }
    let text = if arguments.json {
        let json = serde_json::to_string(&verified).map_err(anyhow::Error::from)?;
        format!("{json}\n")
    } else {
        verdict(&verified, runs)
    };
    crate::print(text.as_bytes())?;
    Ok(if verified.is_well() { DONE } else { NEGATIVE })
}

fn verdict(verified: &Verified, runs: &Path) -> String {
    let mut text = String::new();
    for problem in &verified.problems {
        let _ = match &problem.file {
            Some(file) => writeln!(text, "{}: {file}: {}", problem.run, problem.what),
            None => writeln!(text, "{}: {}", problem.run, problem.what),
        };
    }
    for (names, what) in [
        (
            &verified.not_sealed,
            "not verified, since it did not come to its end",
        ),
        (
            &verified.not_in_store,
            "not verified, since it is not in the store",
        ),
    ] {
        for name in names {
            let _ = writeln!(text, "{name}: {what}");
        }
    }
    let bad: std::collections::BTreeSet<_> = verified.problems.iter().map(|p| &p.run).collect();
    let _ = writeln!(
        text,
        "{} runs in {} verified, {} files: {}",
        verified.runs,
        runs.display(),
        verified.files,
        match bad.len() {
            0 => "all as they were written".to_owned(),
            n => format!("{n} not as they were written"),
        }
    );
    text
}
