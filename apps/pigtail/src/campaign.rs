//! `pigtail campaign`.

use crate::bench;
use crate::choice::choice;
use crate::common::believed;
use crate::running;
use crate::stop;
use crate::{DONE, Failure, NEGATIVE};
use anyhow::{Result, anyhow};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pigtail_control::outcome::OutcomeCode;
use pigtail_evaluate::campaign::shard::{self, Shard};
use pigtail_evaluate::campaign::{
    self, CampaignDocument, Commissioned, Device, Plan, Store, summarize,
};
use pigtail_hal::Error;
use pigtail_report as report;
use pigtail_session::bench::{BenchSetup, is_bench};
use pigtail_session::calibrations::RunsOn;
use pigtail_session::faults::Faults;
use pigtail_session::fleet::NOMINAL;
use pigtail_session::piezos::PiezoModel;
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, Named};
use pigtail_session::scenario::Scenario;
use pigtail_session::setup::Setup;
use serde::Serialize;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
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
  A fiber is aligned if control says so, the twin's truth is within 0.1, 0.1 and 2 um
  (macro-only, which has no micro: 0.2, 0.2 and 2 um), and nothing touched the chip. If control says so and the truth is farther off, it is `wrong_aligned`: counted
  apart, as it is what one fears most. Every other outcome is a cause of failure by its own name.
  Times are machine time of every fiber that was attempted; offsets have no sign. Percentiles are
  by nearest rank, intervals by Wilson at 95 %.

Columns of the rows:
  seed, port, outcome, detail, within_tolerance, collision, seconds, a column `<phase>_s` for each
  phase of the procedure, other_s, offset_x_um, offset_y_um, offset_z_um, coupling_loss_db,
  smallest_gap_um, believed_x_um, believed_z_um, level_x, level_y, level_z, stated_outside, injected, rule,
  device_s, left_idle_s, right_idle_s, both_moving_s. What each means is also in the file's metadata.

Examples:
  pigtail campaign --devices 1000                 a thousand devices with seeds 0 to 999
  pigtail campaign --devices 100 --seed 500       a hundred with seeds 500 to 599
  pigtail campaign --fleet workshop --machines 30 --devices 10
                                                  ten on each of 30 machines such as labs have
  pigtail campaign --resume runs/20261121T024402-campaign-0
                                                  go on with one that was stopped
  pigtail campaign --devices 1000000 --shard 3/100
                                                  the third of a hundred parts, on any machine
  pigtail campaign --merge runs/campaign-0-1f3a5c7e9b2d
                                                  and all of them together

Exit codes:
  0  all devices are done and every fiber is aligned
  1  some fibers are not aligned, or the campaign was interrupted
  2  bad input, explained on standard error")]
pub(crate) struct Arguments {
    /// How many devices to align; with --machines, on each of them [default: 100; with --machines 1]
    #[arg(long, value_name = "N", value_parser = whole)]
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
    /// By which model of its piezos' hysteresis each machine is commissioned [default: memory]
    #[arg(long, value_parser = choice::<PiezoModel>())]
    piezo_model: Option<PiezoModel>,
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
    #[arg(long, value_parser = crate::from_zero::<u64>)]
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
    /// Run only the I-th of N parts of the campaign, from 1, wherever the others are run
    ///
    /// Leaves one Parquet file in a folder below the runs that is named after what was asked for, the same for
    /// all its shards, and enters nothing in the store of runs. A shard that is there is not run again.
    #[arg(long, value_name = "I/N", conflicts_with = "resume")]
    shard: Option<Shard>,
    /// Make one campaign of all shards in this folder, the same, byte for byte, as if it had been run in one piece
    #[arg(
        long,
        value_name = "FOLDER",
        conflicts_with_all = ["devices", "machines", "fleet", "commissioned", "piezo_model", "procedure", "scenario", "faults",
            "seed", "rig", "calibration", "recipe", "threads", "resume", "shard"]
    )]
    merge: Option<PathBuf>,
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

pub(crate) fn threads(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|value| (1..=THREADS).contains(value))
        .ok_or_else(|| format!("accepted is a whole number from 1 to {THREADS}"))
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let started = Instant::now();
    // Before there is a folder that a Ctrl-C could leave behind.
    let stop = stop::on_signal()?;
    if let Some(folder) = &arguments.merge {
        let (store, setup) = shard::merge(folder, &arguments.runs)?;
        let rig = RunsOn::of(&setup.rig);
        return finish(arguments, &rig, &store, store.done(), None, started);
    }
    let threads = arguments
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    if let Some(shard) = arguments.shard {
        return run_shard(arguments, shard, threads, &stop);
    }
    let (on, mut store) = open(arguments)?;
    let before = store.done();
    let commissioned = if store.plan().commissioned {
        let kept = arguments.resume.as_deref().and_then(Path::parent);
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
    ended.map_err(|error| kept(&store, &error))?;
    finish(
        arguments,
        &on.rig(),
        &store,
        before,
        commissioned.as_ref(),
        started,
    )
}

/// Says what is not lost by an error.
fn kept(store: &Store, error: &anyhow::Error) -> anyhow::Error {
    anyhow!("{error:#}; {}", resumable(store))
}

/// Sums up a campaign whose devices are done, as far as they are, of which some had been `before`.
fn finish(
    arguments: &Arguments,
    rig: &RunsOn,
    store: &Store,
    before: u64,
    commissioned: Option<&Commissioned>,
    started: Instant,
) -> Result<u8, Failure> {
    store.collect().map_err(|error| kept(store, &error))?;
    let summary = summarize(store, started.elapsed().as_secs_f64())?;
    let accepted = commissioned.map(Commissioned::accepted);
    let document = CampaignDocument {
        accepted: accepted.or(summary.accepted),
        ..summary
    };
    if !store.was_whole() {
        let report = report::campaign(store, &document)?;
        let on = running::on_rig(rig.clone(), &document, None);
        let finished = store.finish(&document, &on, &report);
        finished.map_err(|error| kept(store, &error))?;
    }
    let mut text = Vec::new();
    if arguments.json {
        let on = running::on_rig(rig.clone(), &document, None);
        serde_json::to_writer(&mut text, &on).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        let told = report::text::campaign(&document, store.done() - before, report::text::room());
        text.extend(told.bytes());
        text.extend(running::ran_on(rig, store.plan().commissioned).bytes());
    }
    crate::print(&text)?;
    if !document.complete {
        crate::say(&format!("interrupted: {}", resumable(store)));
    }
    Ok(if document.is_success() {
        DONE
    } else {
        NEGATIVE
    })
}

/// What a shard prints as JSON. Keys are a contract.
#[derive(Serialize)]
struct ShardDocument {
    /// Which of how many.
    shard: String,
    /// The folder of all of them.
    folder: String,
    /// Its rows; `null` where it has none, or was stopped.
    file: Option<String>,
    /// Its devices.
    devices: u64,
    /// Those that were done just now.
    done: u64,
    /// Whether its file is there, or it needs none.
    complete: bool,
    /// How long this took, seconds.
    wall_seconds: f64,
}

/// One part of a campaign.
fn run_shard(
    arguments: &Arguments,
    shard: Shard,
    threads: usize,
    stop: &AtomicBool,
) -> Result<u8, Failure> {
    let started = Instant::now();
    let (setup, plan) = planned(arguments, None)?;
    let folder = shard::folder(&arguments.runs, &plan, &setup)?;
    let machines = if plan.commissioned {
        let seeds = shard.machine_seeds(&plan);
        Some(commission(&setup, &seeds, &arguments.runs, threads, stop)?)
    } else {
        None
    };
    let range = shard.devices(&plan);
    let progress = Progress::new(range.end - range.start, 0);
    let mut counts = (0_u64, 0_u64);
    let watch = |device: &Device| progress.device(device, &mut counts);
    let ran = shard::run(
        &folder,
        shard,
        &setup,
        machines.as_ref(),
        threads,
        stop,
        watch,
    );
    progress.bar.finish_and_clear();
    let ran = ran?;
    let document = ShardDocument {
        shard: shard.to_string(),
        folder: folder.display().to_string(),
        complete: ran.file.is_some() || ran.devices == 0,
        file: ran.file.map(|file| file.display().to_string()),
        devices: ran.devices,
        done: ran.done,
        wall_seconds: started.elapsed().as_secs_f64(),
    };
    let text = if arguments.json {
        serde_json::to_string(&document).map_err(anyhow::Error::from)? + "\n"
    } else {
        told(&document)
    };
    crate::print(text.as_bytes())?;
    Ok(if document.complete { DONE } else { NEGATIVE })
}

/// What a person wants to know of a shard.
fn told(document: &ShardDocument) -> String {
    let ShardDocument {
        shard,
        folder,
        devices,
        done,
        wall_seconds,
        ..
    } = document;
    let end = match &document.file {
        _ if *devices == 0 => "no devices are in it\n".to_owned(),
        None => {
            format!("interrupted after {done} of {devices} devices, and nothing is kept of it\n")
        }
        Some(file) if *done == 0 => format!("was there: {file}\n"),
        Some(file) => format!("{done} devices in {wall_seconds:.1} s: {file}\n"),
    };
    format!("shard {shard}: {end}When all are done: pigtail campaign --merge {folder}\n")
}

/// Commissions the machines that were not before.
pub(crate) fn commission(
    setup: &Setup,
    seeds: &[u64],
    runs: &Path,
    threads: usize,
    stop: &AtomicBool,
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
        ("--piezo-model", arguments.piezo_model.is_some()),
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
    let devices = devices.unwrap_or(DEVICES);
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
    let (rig, recipe) = names(arguments, begun.as_ref());
    if is_bench(&rig)? {
        let calibration = believed(&rig, arguments.calibration.as_deref(), &arguments.runs)?;
        let named = Named {
            rig: &rig,
            recipe: &recipe,
            calibration: calibration.as_deref(),
            ..Named::default()
        };
        return open_benches(arguments, begun.as_ref(), &named);
    }
    let (setup, plan) = planned(arguments, begun.as_ref())?;
    let store = match &arguments.resume {
        Some(folder) => Store::resume(folder, &plan)?,
        None => Store::begin(&arguments.runs, plan)?,
    };
    Ok((On::Machines(Box::new(setup)), store))
}

/// What is named, else as it was begun, else what is usual.
fn named(given: Option<&String>, begun: Option<&String>, default: &str) -> String {
    given
        .or(begun)
        .map_or_else(|| default.to_owned(), Clone::clone)
}

/// Rig and recipe.
fn names(arguments: &Arguments, begun_as: Option<&Plan>) -> (String, String) {
    let rig = begun_as.map(|plan| &plan.rig);
    let recipe = begun_as.map(|plan| &plan.recipe);
    (
        named(arguments.rig.as_ref(), rig, DEFAULT_RIG_NAME),
        named(arguments.recipe.as_ref(), recipe, DEFAULT_RECIPE_NAME),
    )
}

/// What is asked for, where it is not said as it was begun, and what it runs on.
fn planned(arguments: &Arguments, begun_as: Option<&Plan>) -> Result<(Setup, Plan), Failure> {
    let (rig, recipe) = names(arguments, begun_as);
    let calibration = believed(&rig, arguments.calibration.as_deref(), &arguments.runs)?;
    let by_name = Named {
        rig: &rig,
        recipe: &recipe,
        calibration: calibration.as_deref(),
        ..Named::default()
    };
    let mut setup = Setup::load_named(&by_name)?;
    let scenario = match (arguments.scenario, begun_as) {
        (Some(scenario), _) => scenario,
        (None, Some(plan)) => plan.scenario()?,
        (None, None) => Scenario::default(),
    };
    let fleet = named(
        arguments.fleet.as_ref(),
        begun_as.map(|plan| &plan.fleet),
        NOMINAL,
    );
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
        (None, Some(machines), None) => (machines, 1),
        (None, None, None) => (DEVICES, 1),
    };
    enough_seeds(seed, devices)?;
    campaign::check(&setup, seed)?;
    running::warn(&setup, procedure.believes());
    let commissioned = arguments.commissioned || begun_as.is_some_and(|plan| plan.commissioned);
    setup.piezo_model = match (arguments.piezo_model, begun_as) {
        (Some(_), _) if !commissioned => {
            let message = "is what machines are commissioned by, and none is; accepted is it beside --commissioned. \
                           Else the calibration says by which model a machine runs";
            return Err(Error::new("--piezo-model", "", message).into());
        }
        (Some(model), _) => model,
        (None, Some(plan)) => plan.piezo_model,
        (None, None) => PiezoModel::default(),
    };
    let plan = Plan::new(&setup, procedure, seed, devices)
        .with_devices_each(each)
        .with_commissioned(commissioned);
    Ok((setup, plan))
}

/// Devices where nobody says how many.
const DEVICES: u64 = 100;

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
