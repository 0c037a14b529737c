//! `pigtail align`.

use crate::bench;
use crate::choice::choice;
use crate::common::{Common, OwnAxes, believed};
use crate::methods::{self, MethodArguments};
use crate::phases::Watcher;
use crate::running;
use crate::scan::{self, MapArguments};
use crate::{DONE, FAULT, Failure, NEGATIVE};
use clap::Args;
use pigtail_evaluate::align::{AlignmentDocument, align};
use pigtail_evaluate::entry;
use pigtail_report as report;
use pigtail_session::bench::is_bench;
use pigtail_session::faults::Faults;
use pigtail_session::own::Own;
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_session::scenario::Scenario;
use pigtail_twin::Specimen;
use pigtail_twin::faults::{Injection, Kind};
use std::ffi::OsString;
use std::io::Write;

/// Align the three fibers of one device on the rig's twin
///
/// The twin is drawn around the rig's `plant.toml` by the seed: another seed is another machine,
/// another device, another misplacement of everything. Control sees encoders, photodiodes and
/// vision, never the truth; the offsets in the table are the truth, asked for afterwards.
///
/// Writes a folder `runs/<time>-<seed>/` with `report.html` (look at it), `summary.json` (what
/// `--json` prints), `samples.csv` (every light sample with its place),
/// `exchanges.pigtail` (every exchange with the machine, for `pigtail runs replay`) and `run.json` (version
/// and configuration hashes).
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail align                         the default rig and recipe
  pigtail align --seed 7 --json         another machine and device, as one JSON document
  pigtail align --rig bench-piezo       a bench that is controlled by position, without a camera
  pigtail align --rig my-rig/           your own rig: machine.toml, plant.toml, calibration.toml
  pigtail align --recipe my-chip.toml   your own device
  pigtail align --from plant.toml       an axis of your own, as identify servo wrote it
  pigtail align --method macro-raster --mesh '10 um'
                                        a search for first light, its time by formula and really
  pigtail align --fault encoder-stuck:left.z@3.2s
                                        an encoder that stops counting: what the guard does
  pigtail align --map scan.csv --map-length-unit mm --map-power-unit dBm
                                        search and peak on a scan from your own bench")]
pub(crate) struct Arguments {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    own: OwnAxes,
    /// A recipe file, or the name of one below `recipes`
    #[arg(long, default_value = DEFAULT_RECIPE_NAME)]
    recipe: String,
    /// How to align
    #[arg(long, value_parser = choice::<Procedure>(), default_value = <&str>::from(Procedure::default()))]
    procedure: Procedure,
    /// What is wrong with device, fixture or light
    #[arg(long, value_parser = choice::<Scenario>(), default_value = <&str>::from(Scenario::default()))]
    scenario: Scenario,
    /// Which device on the machine of this seed, from 0
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = crate::from_zero::<u64>)]
    device: u64,
    /// Breaks something at a time: NAME[:WHERE][:SIZE]@TIME; may be given more than once, `help`
    /// lists what there is
    #[arg(long, value_name = "FAULT", value_parser = injection)]
    fault: Vec<Injection>,
    /// Breaks what a campaign with these `--faults` breaks on the device of this seed
    #[arg(long, value_name = "all|NAME,...", conflicts_with = "fault")]
    faults: Option<Faults>,
    /// Let the machine's time keep to the clock
    #[arg(long)]
    real_time: bool,
    /// Do not record the exchanges with the machine: a run that cannot be replayed
    #[arg(long)]
    no_record: bool,
    #[command(flatten)]
    method: MethodArguments,
    #[command(flatten, next_help_heading = "Your own light")]
    map: MapArguments,
}

fn injection(text: &str) -> Result<Injection, String> {
    if text == "help" {
        return Err(faults_known());
    }
    // A size may be written as elsewhere, `50 um`.
    text.replace(' ', "").parse()
}

fn faults_known() -> String {
    let all: Vec<String> = Kind::all()
        .map(|kind| format!("  {}", kind.about()))
        .collect();
    format!(
        "accepted is one of these, with @TIME behind it:\n{}",
        all.join("\n")
    )
}

/// What `align --fault help` is answered with, if that is what was asked: an answer, no error.
pub(crate) fn asked_for_faults(arguments: impl Iterator<Item = OsString>) -> Option<String> {
    let words: Vec<OsString> = arguments.skip(1).collect();
    if words.first()? != "align" {
        return None;
    }
    let pair = |two: &[OsString]| two[0] == "--fault" && two[1] == "help";
    let asked = words.windows(2).any(pair) || words.iter().any(|word| word == "--fault=help");
    asked.then(|| {
        format!(
            "{}\n\nSuch as `pigtail align --fault encoder-stuck:left.z@3.2s`.\n",
            faults_known().replacen("accepted is", "What can break:", 1)
        )
    })
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    if let Some(map) = arguments.map.map() {
        return scan::run(map, &arguments.map, &arguments.common);
    }
    let own = Own::read(&arguments.own.from)?;
    let common = &arguments.common;
    // A seed may name a device as well: that of a row of a campaign does.
    let named = Specimen::from(arguments.common.seed);
    let device = named.device().wrapping_add(arguments.device);
    let seed = Specimen::of(named.machine(), device).seed();
    if is_bench(&common.rig)? {
        return on_bench(arguments, &own, seed);
    }
    let mut setup = common.setup_with(&arguments.recipe, &own, false, &[])?;
    arguments.scenario.apply(&mut setup);
    setup.faults = match &arguments.faults {
        Some(faults) => faults.clone(),
        None if arguments.fault.is_empty() => Faults::None,
        None => Faults::Said(arguments.fault.clone()),
    };
    if let Some(method) = arguments.method.method() {
        return methods::run(method, &arguments.method, &arguments.common, &setup);
    }
    setup.options.real_time = arguments.real_time;
    running::warn(&setup, arguments.procedure.believes());
    let (runs, recorded) = (&arguments.common.runs, !arguments.no_record);
    let run = running::begin(&mut setup, runs, "align", seed, recorded)?;
    run.devices(&entry::devices(&setup, arguments.procedure, seed, 1))?;
    let full = setup.rig.spec.photodiode.range;
    let mut watcher = Watcher::of(&run, full);
    let ended = align(&setup, arguments.procedure, seed, &mut watcher);
    watcher.progress.finish();
    let record = &watcher.record;
    let mut document = ended.map_err(|ended| running::stopped(&run, &setup, ended))?;
    watcher.phases.all_entered()?;
    document.report = run.path("report.html").display().to_string();
    // The record goes on to the disk meanwhile.
    let on = running::on(&setup, &document, None);
    run.write_json("summary.json", &on)?;
    running::keep_samples(&run, record)?;
    run.write("report.html", report::alignment(&setup, &document, record)?)?;
    running::close_records(&run, &setup)?;
    run.aligned(&entry::aligned(&document))?;
    match &document.fault {
        Some(fault) => run.fault(fault)?,
        None => run.finish(&document.outcome())?,
    }
    let mut text = Vec::new();
    if common.json {
        serde_json::to_writer(&mut text, &on).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        text.extend(report::text::alignment(&document, report::text::room()).bytes());
        text.extend(running::line(&setup).bytes());
        if document.fault.is_some() && own.is_untuned() {
            let hint = "The gains of your axis are those to begin with: `pigtail tune` with the same --from finds \
                        better ones, and writes a calibration.toml that --from takes too.";
            writeln!(text, "{hint}").map_err(anyhow::Error::from)?;
        }
    }
    crate::print(&text)?;
    Ok(code(&document))
}

fn code(document: &AlignmentDocument) -> u8 {
    if document.fault.is_some() {
        FAULT
    } else if document.is_success() {
        DONE
    } else {
        NEGATIVE
    }
}

/// The same on a rig that is controlled by position.
fn on_bench(arguments: &Arguments, own: &Own, seed: u64) -> Result<u8, Failure> {
    bench::refuse(&[
        ("--from", !own.is_empty()),
        ("--procedure", arguments.procedure != Procedure::default()),
        ("--scenario", arguments.scenario != Scenario::default()),
        ("--fault", !arguments.fault.is_empty()),
        (
            "--faults",
            !matches!(arguments.faults, None | Some(Faults::None)),
        ),
        ("--method", arguments.method.method().is_some()),
        ("--real-time", arguments.real_time),
    ])?;
    let common = &arguments.common;
    let calibration = believed(&common.rig, common.calibration.as_deref(), &common.runs)?;
    let (document, json, line) =
        bench::run(common, &arguments.recipe, calibration.as_deref(), seed)?;
    let mut text = Vec::new();
    if common.json {
        text.extend(json);
        text.push(b'\n');
    } else {
        text.extend(report::text::alignment(&document, report::text::room()).bytes());
        text.extend(line.bytes());
    }
    crate::print(&text)?;
    Ok(code(&document))
}
