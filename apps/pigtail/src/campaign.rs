//! `pigtail campaign`.

use crate::bench;
use crate::choice::choice;
use crate::common::{believed, write_table};
use crate::running;
use crate::stop;
use crate::{DONE, Failure, NEGATIVE};
use anyhow::{Result, anyhow};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pigtail_control::outcome::OutcomeCode;
use pigtail_evaluate::align::TOLERANCE_Z_UM;
use pigtail_evaluate::campaign::{
    self, CampaignDocument, Commissioned, Device, Plan, Store, summarize,
};
use pigtail_hal::Error;
use pigtail_report as report;
use pigtail_session::bench::{BenchSetup, is_bench};
use pigtail_session::calibrations::RunsOn;
use pigtail_session::faults::Faults;
use pigtail_session::fleet::NOMINAL;
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, Named};
use pigtail_session::scenario::Scenario;
use pigtail_session::setup::Setup;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Align many devices, each on its own machine, and say how often and how well it went
///
/// Device i (from 0) is the one that `pigtail align --seed <SEED + i>` aligns: its plant, chip and
/// fixture are drawn around the rig's `plant.toml`. Every core works; the rows are the same, byte
/// for byte, whatever the number of threads.
///
/// Writes a folder `runs/<time>-campaign-<seed>/` with `report.html` (look at it), `summary.json`
/// (what `--json` prints), `rows.parquet` (a row a fiber), `campaign.json` and `run.json` (what
/// was asked for, versions and hashes). Until it ends, rows are in `parts/*.parquet`, each with
/// up to 256 devices or 10 s of work, readable at any time. Ctrl-C finishes the devices that were
/// begun, sums up what is done, and says how to go on; a campaign that is killed loses its last
/// part at most. Both go on with `--resume`, and end with the same rows as if they had never
/// stopped.
#[derive(Debug, Args)]
#[command(after_help = "\
What counts:
  A fiber is aligned if control says so, the twin's truth is within 0.1, 0.1 and 2 um, and nothing
  touched the chip. If control says so and the truth is farther off, it is `wrong_aligned`: counted
  apart, as it is what one fears most. Every other outcome is a cause of failure by its own name.
  Times are machine time of every fiber that was attempted; offsets have no sign. Percentiles are
  by nearest rank, intervals by Wilson at 95 %.

Columns of the rows:
  seed, port, outcome, detail, within_tolerance, collision, seconds, a column `<phase>_s` for each
  phase of the procedure, other_s, offset_x_um, offset_y_um, offset_z_um, coupling_loss_db,
  smallest_gap_um. What each means is also in the file's metadata.

Examples:
  pigtail campaign --devices 1000                 a thousand devices with seeds 0 to 999
  pigtail campaign --devices 100 --seed 500       a hundred with seeds 500 to 599
  pigtail campaign --fleet workshop --machines 30 --devices 10
                                                  ten on each of 30 machines such as labs have
  pigtail campaign --resume runs/20261121T024402-campaign-0
                                                  go on with one that was stopped

Exit codes:
  0  all devices are done and every fiber is aligned
  1  some fibers are not aligned, or the campaign was interrupted
  2  bad input, explained on standard error")]
pub(crate) struct Arguments {
    /// How many devices to align; with --machines, on each of them
    #[arg(long, value_name = "N", value_parser = whole, required_unless_present = "resume")]
    devices: Option<u64>,
    /// How many machines to align them on, one device after the other [default: one for each device]
    #[arg(long, value_name = "M", value_parser = whole)]
    machines: Option<u64>,
    /// What machines and devices may be: a fleet of the rig (nominal, thesis, workshop,
    /// harsh), or a TOML file [default: nominal]
    #[arg(long)]
    fleet: Option<String>,
    /// Commission each machine first, as `pigtail commission` does. What is found is kept in
    /// `commissioned/` below the runs, for the next campaign too; devices of a machine that is not
    /// accepted are not attempted
    #[arg(long)]
    commissioned: bool,
    /// How to align [default: fast]
    #[arg(long, value_parser = choice::<Procedure>())]
    procedure: Option<Procedure>,
    /// What is wrong with devices, fixture or light [default: nominal]
    #[arg(long, value_parser = choice::<Scenario>())]
    scenario: Option<Scenario>,
    /// What breaks: one fault into each device, drawn with its place and time by the device's seed.
    /// `all`, or names with commas between them; `pigtail align --fault help` lists them
    /// [default: none]
    #[arg(long, value_name = "all|NAME,...")]
    faults: Option<Faults>,
    /// The first device's seed; each next device has the next one [default: 0]
    #[arg(long, allow_negative_numbers = true)]
    seed: Option<u64>,
    /// A folder with the three files of a rig, or the name of one below `rigs` [default: afpm]
    #[arg(long)]
    rig: Option<String>,
    /// A calibration in place of the rig's: the number of a version, a run that found it, or a file. With
    /// --resume it is to be said again
    #[arg(long, value_name = "VERSION|RUN|FILE")]
    calibration: Option<String>,
    /// A recipe file, or the name of one below `recipes` [default: y-branch]
    #[arg(long)]
    recipe: Option<String>,
    /// How many devices to align at a time [default: one for each core]
    #[arg(long, value_name = "T", value_parser = threads)]
    threads: Option<usize>,
    /// Go on with the campaign in this folder, as it was begun
    ///
    /// What is not said again is taken from the campaign. What is must be the same: a campaign
    /// with another seed, procedure, scenario, number of devices, rig or recipe is another campaign.
    #[arg(long, value_name = "RUN")]
    resume: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Where to write the run's folder
    #[arg(
        long,
        value_name = "FOLDER",
        default_value = "runs",
        conflicts_with = "resume"
    )]
    runs: PathBuf,
}

fn whole(text: &str) -> Result<u64, String> {
    text.parse()
        .ok()
        .filter(|value| *value > 0)
        .ok_or_else(|| "accepted is a whole number above zero".to_owned())
}

/// More threads than this are a slip of the keyboard.
const THREADS: usize = 1024;

fn threads(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|value| (1..=THREADS).contains(value))
        .ok_or_else(|| format!("accepted is a whole number from 1 to {THREADS}"))
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let started = Instant::now();
    // Before there is a folder that a Ctrl-C could leave behind.
    let stop = stop::on_signal()?;
    let (on, mut store) = open(arguments)?;
    let threads = arguments
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let before = store.done();
    let commissioned = if store.plan().commissioned {
        let kept = arguments
            .resume
            .as_deref()
            .and_then(std::path::Path::parent);
        let runs = kept.unwrap_or(&arguments.runs);
        let seeds = store.plan().machine_seeds();
        match &on {
            On::Machines(setup) => Some(commission(setup, &seeds, runs, threads, &stop)?),
            On::Benches(_) => None,
        }
    } else {
        None
    };
    let progress = Progress::new(store.plan().devices, before);
    let mut counts = (0_u64, 0_u64);
    let watch = |device: &Device| progress.device(device, &mut counts);
    let ended = match (&on, &commissioned) {
        (On::Machines(setup), None) => campaign::run(&mut store, setup, threads, &stop, watch),
        (On::Benches(setup), None) => {
            campaign::run_benches(&mut store, setup, threads, &stop, watch)
        }
        (_, Some(machines)) => {
            campaign::run_commissioned(&mut store, machines, threads, &stop, watch)
        }
    };
    progress.bar.finish_and_clear();
    let kept = |error: anyhow::Error| anyhow!("{error:#}; {}", resumable(&store));
    ended.map_err(kept)?;
    store.collect().map_err(kept)?;
    let document = CampaignDocument {
        accepted: commissioned.as_ref().map(Commissioned::accepted),
        ..summarize(&store, started.elapsed().as_secs_f64())?
    };
    if !store.was_whole() {
        let report = report::campaign(&store, &document)?;
        let on = running::on_rig(on.rig(), &document, None);
        store.finish(&document, &on, &report).map_err(kept)?;
    }
    let mut text = Vec::new();
    if arguments.json {
        let on = running::on_rig(on.rig(), &document, None);
        serde_json::to_writer(&mut text, &on).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        print_summary(&mut text, &document, store.done() - before).map_err(anyhow::Error::from)?;
        text.extend(format!("Ran on {}\n", on.rig()).bytes());
    }
    crate::print(&text)?;
    if !document.complete {
        // Nobody may be there to read it.
        let _ = writeln!(io::stderr(), "interrupted: {}", resumable(&store));
    }
    Ok(if document.is_success() {
        DONE
    } else {
        NEGATIVE
    })
}

/// Commissions the machines that were not before.
fn commission(
    setup: &Setup,
    seeds: &[u64],
    runs: &std::path::Path,
    threads: usize,
    stop: &std::sync::atomic::AtomicBool,
) -> Result<Commissioned, Failure> {
    let target = ProgressDrawTarget::stderr_with_hz(10);
    let bar = ProgressBar::with_draw_target(Some(seeds.len() as u64), target);
    if let Ok(style) =
        ProgressStyle::with_template("{pos}/{len} machines commissioned [{wide_bar}] {eta} left")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    let done = Commissioned::of(setup, seeds, runs, threads, stop, |_, _| bar.inc(1));
    bar.finish_and_clear();
    Ok(done?)
}

fn resumable(store: &Store) -> String {
    format!(
        "{} of {} devices are done and kept; go on with: pigtail campaign --resume {}",
        store.done(),
        store.plan().devices,
        store.folder().display()
    )
}

/// What a campaign is on.
enum On {
    Machines(Box<Setup>),
    Benches(Box<BenchSetup>),
}

impl On {
    fn rig(&self) -> RunsOn {
        match self {
            Self::Machines(setup) => RunsOn::of(&setup.rig),
            Self::Benches(setup) => RunsOn::of_bench(&setup.rig),
        }
    }
}

/// A campaign on benches. What only machines of volts have may not be asked for.
fn open_benches(
    arguments: &Arguments,
    begun: Option<&Plan>,
    named: &Named,
) -> Result<(On, Store), Failure> {
    let usual = |name: &Option<String>| name.as_deref().is_none_or(|name| name == NOMINAL);
    let faults = !matches!(arguments.faults, None | Some(Faults::None));
    bench::refuse(&[
        ("--machines", arguments.machines.is_some()),
        ("--fleet", !usual(&arguments.fleet)),
        ("--commissioned", arguments.commissioned),
        (
            "--scenario",
            arguments.scenario.unwrap_or_default() != Scenario::Nominal,
        ),
        ("--faults", faults),
        (
            "--procedure",
            arguments.procedure.unwrap_or_default() != Procedure::default(),
        ),
    ])?;
    let setup = BenchSetup::load_named(named)?;
    let seed = arguments.seed.or(begun.map(|plan| plan.seed)).unwrap_or(0);
    let devices = arguments.devices.or(begun.map(|plan| plan.devices));
    let devices = devices.unwrap_or(1);
    enough_seeds(seed, devices)?;
    setup.twin(seed)?;
    let plan = Plan::of_benches(&setup, seed, devices);
    let store = match &arguments.resume {
        Some(folder) => Store::resume(folder, &plan)?,
        None => Store::begin(&arguments.runs, plan)?,
    };
    Ok((On::Benches(Box::new(setup)), store))
}

fn enough_seeds(seed: u64, devices: u64) -> Result<(), Error> {
    if seed.checked_add(devices).is_some() {
        return Ok(());
    }
    Err(Error::new(
        "--seed",
        "",
        format!(
            "is {seed}, and with {devices} devices seeds would run out; accepted is at most {}",
            u64::MAX - devices
        ),
    ))
}

/// The campaign to run, new or begun before. Nothing is written before all input is checked.
fn open(arguments: &Arguments) -> Result<(On, Store), Failure> {
    let begun = arguments.resume.as_deref().map(Plan::read).transpose()?;
    let named = |given: &Option<String>, begun: Option<&String>, default: &str| {
        given
            .as_ref()
            .or(begun)
            .map_or_else(|| default.to_owned(), Clone::clone)
    };
    let begun_as = begun.as_ref();
    let rig = named(
        &arguments.rig,
        begun_as.map(|plan| &plan.rig),
        DEFAULT_RIG_NAME,
    );
    let recipe = named(
        &arguments.recipe,
        begun_as.map(|plan| &plan.recipe),
        DEFAULT_RECIPE_NAME,
    );
    let calibration = believed(&rig, arguments.calibration.as_deref(), &arguments.runs)?;
    let names = Named {
        rig: &rig,
        recipe: &recipe,
        calibration: calibration.as_deref(),
        ..Named::default()
    };
    if is_bench(&rig)? {
        return open_benches(arguments, begun_as, &names);
    }
    let mut setup = Setup::load_named(&names)?;
    let scenario = match (arguments.scenario, begun_as) {
        (Some(scenario), _) => scenario,
        (None, Some(plan)) => plan.scenario()?,
        (None, None) => Scenario::default(),
    };
    let fleet = named(&arguments.fleet, begun_as.map(|plan| &plan.fleet), NOMINAL);
    setup = setup.of_fleet(&fleet)?;
    scenario.apply(&mut setup);
    setup.faults = match (&arguments.faults, begun_as) {
        (Some(faults), _) => faults.clone(),
        (None, Some(plan)) => plan.faults()?,
        (None, None) => Faults::None,
    };
    let procedure = match (arguments.procedure, begun_as) {
        (Some(procedure), _) => procedure,
        (None, Some(plan)) => plan.procedure()?,
        (None, None) => Procedure::default(),
    };
    let seed = arguments
        .seed
        .or(begun_as.map(|plan| plan.seed))
        .unwrap_or(0);
    let (devices, each) = match (arguments.devices, arguments.machines, begun_as) {
        (Some(each), Some(machines), _) => (machines.saturating_mul(each), each),
        (None, Some(machines), Some(plan)) => (
            machines.saturating_mul(plan.devices_each),
            plan.devices_each,
        ),
        (Some(devices), None, Some(plan)) if plan.devices_each > 1 => {
            (plan.machines().saturating_mul(devices), devices)
        }
        (Some(devices), None, _) => (devices, 1),
        (None, _, Some(plan)) => (plan.devices, plan.devices_each),
        (None, _, None) => (1, 1),
    };
    enough_seeds(seed, devices)?;
    campaign::check(&setup, seed)?;
    running::warn(&setup, procedure.believes());
    let commissioned = arguments.commissioned || begun_as.is_some_and(|plan| plan.commissioned);
    let plan = Plan::new(&setup, procedure, seed, devices)
        .with_devices_each(each)
        .with_commissioned(commissioned);
    let store = match &arguments.resume {
        Some(folder) => Store::resume(folder, &plan)?,
        None => Store::begin(&arguments.runs, plan)?,
    };
    Ok((On::Machines(Box::new(setup)), store))
}

/// A bar with the time that is left, on a terminal; nothing elsewhere.
struct Progress {
    bar: ProgressBar,
}

impl Progress {
    fn new(devices: u64, done: u64) -> Self {
        let target = ProgressDrawTarget::stderr_with_hz(10);
        let bar = ProgressBar::with_draw_target(Some(devices), target);
        if let Ok(style) =
            ProgressStyle::with_template("{pos}/{len} devices [{wide_bar}] {eta} left{msg}")
        {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_position(done);
        // What an earlier process did says nothing about how fast this one is.
        bar.reset_eta();
        bar.enable_steady_tick(Duration::from_millis(200));
        Self { bar }
    }

    /// One more device; `counts` are fibers that are not aligned and that are believed to be.
    fn device(&self, device: &Device, counts: &mut (u64, u64)) {
        let (failed, wrong) = counts;
        for fiber in &device.document.fibers {
            let aligned = fiber.outcome == OutcomeCode::Aligned;
            *failed += u64::from(!aligned);
            *wrong += u64::from(aligned && fiber.within_tolerance != Some(true));
        }
        if *failed + *wrong > 0 {
            self.bar
                .set_message(format!(", {failed} lost, {wrong} wrong"));
        }
        self.bar.inc(1);
    }
}

fn print_summary(
    out: &mut impl Write,
    document: &CampaignDocument,
    devices_now: u64,
) -> io::Result<()> {
    let percent = report::percent;
    let sure = &document.confidence;
    let machines = document.machines.max(1);
    let on = match document.devices_each {
        1 => String::new(),
        _ => format!(" on {machines} machines"),
    };
    let fleet = match document.fleet.as_str() {
        NOMINAL => String::new(),
        fleet => format!(", fleet {fleet}"),
    };
    writeln!(
        out,
        "{} devices{on}, seeds {} to {}, by the {} procedure, {}{fleet}\n",
        document.devices,
        document.seed,
        document.seed + machines - 1,
        document.procedure,
        document.scenario
    )?;
    for (what, part, of, [low, high]) in [
        (
            "fibers aligned",
            document.aligned,
            document.fibers,
            sure.fibers_aligned,
        ),
        (
            "whole devices",
            document.devices_aligned,
            document.devices,
            sure.devices_aligned,
        ),
        (
            "wrongly \"aligned\"",
            document.wrong.count,
            document.fibers,
            sure.fibers_wrong,
        ),
    ] {
        writeln!(
            out,
            "{what:17}  {part} of {of}: {} (95 %: {} to {})",
            percent(part as f64 / of.max(1) as f64),
            percent(low),
            percent(high)
        )?;
    }
    writeln!(out)?;
    if document.faults != "none" {
        print_faults(out, document)?;
    }
    let o = &document.offset_um;
    let header = ["", "mean", "p50", "p90", "p99", "p99.9", "max"]
        .map(str::to_owned)
        .to_vec();
    let rows = [
        ("time, s", &document.seconds_per_fiber, 2),
        ("x, um", &o.x, 3),
        ("y, um", &o.y, 3),
        ("z, um", &o.z, 3),
        ("loss, dB", &document.coupling_loss_db, 3),
    ]
    .into_iter()
    .map(|(name, of, digits)| {
        let number = |value: Option<f64>| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let mut row = vec![name.to_owned()];
        row.extend([of.mean, of.p50, of.p90, of.p99, of.p999, of.max].map(number));
        row
    });
    write_table(
        out,
        &std::iter::once(header).chain(rows).collect::<Vec<_>>(),
    )?;
    print_failed(out, document)?;
    writeln!(
        out,
        "\nTime is machine time a fiber; x, y and z are the truth, from the twins, without sign.\n\
         Tolerance: {}, {} and {} um. {}",
        Procedure::tolerance_of(&document.procedure),
        Procedure::tolerance_of(&document.procedure),
        TOLERANCE_Z_UM,
        if devices_now == 0 {
            "Nothing was left to be done.".to_owned()
        } else {
            let seconds = document.wall_seconds;
            format!(
                "{seconds:.1} s here, {:.1} devices/s.",
                devices_now as f64 / seconds.max(1e-3)
            )
        }
    )?;
    writeln!(out, "Rows: {}", document.rows)?;
    writeln!(out, "Report: {}", document.report)
}

/// Causes of failure, and seeds to replay them.
fn print_failed(out: &mut impl Write, document: &CampaignDocument) -> io::Result<()> {
    if !document.failed.is_empty() {
        writeln!(
            out,
            "\nNot aligned, and a seed to replay with `{}`:",
            document.replay_command()
        )?;
    }
    for (cause, count) in &document.failed {
        let seeds = document.replay.get(cause).map_or(&[][..], Vec::as_slice);
        let shown: Vec<_> = seeds.iter().take(5).map(u64::to_string).collect();
        writeln!(out, "  {count:5} {cause}: {}", shown.join(", "))?;
    }
    Ok(())
}

/// How devices ended on which something was broken on purpose.
fn print_faults(out: &mut impl Write, document: &CampaignDocument) -> io::Result<()> {
    let number = |n: u64| n.to_string();
    let header = [
        "broken", "devices", "stopped", "gave up", "aligned", "false", "touched", "failed",
    ]
    .map(str::to_owned)
    .to_vec();
    let rows = document.by_fault.iter().map(|(name, of)| {
        let mut row = vec![name.clone()];
        row.extend(
            [
                of.devices,
                of.tripped,
                of.given_up,
                of.aligned,
                of.false_aligned,
                of.collisions,
                of.broken,
            ]
            .map(number),
        );
        row
    });
    write_table(
        out,
        &std::iter::once(header).chain(rows).collect::<Vec<_>>(),
    )?;
    writeln!(out, "\nRules that stopped the machine:")?;
    for (rule, count) in &document.tripped {
        writeln!(out, "  {count:6} {rule}")?;
    }
    writeln!(out)
}

// Options whose defaults come from the campaign that goes on say their own defaults in words.
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_that_help_tells_are_those_that_are_used() {
        assert_eq!(Procedure::default().name(), "fast");
        assert_eq!(
            (DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME),
            ("afpm", "y-branch")
        );
    }
}
