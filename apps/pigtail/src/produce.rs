//! `pigtail produce`.

use crate::common::Common;
use crate::journal::{Head, Journal, Left, Who, resumed};
use crate::progress::light;
use crate::tray_plan::planned;
use crate::{DONE, FAULT, Failure, NEGATIVE, campaign, running, trays};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pigtail_control::station::{Observer, Sample};
use pigtail_cycle::plan::Plan;
use pigtail_cycle::run::{Event, Pigtail};
use pigtail_evaluate::campaign::Commissioned;
use pigtail_evaluate::produce::{Heard, ProduceDocument, Told, produce};
use pigtail_hal::Side;
use pigtail_hal::digest::hash;
use pigtail_report as report;
use pigtail_session::calibrations::{Part, RunsOn};
use pigtail_session::own::Own;
use pigtail_session::produce::{DEFAULT_TRAY, InPlace, Loaded};
use pigtail_session::setup::Setup;
use pigtail_store::database::{Database, Pigtail as Entered};
use pigtail_twin::Specimen;
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// More would take a machine for a week.
const MOST_TIMES: i64 = 1000;

/// Produce a tray: pick, adhesive, align, cure and release every fiber of every device
///
/// Both manipulators work side by side on the twin that the seed draws: the machine, and a device of its own in each place of
/// the tray. Adhesive cures under the lamp for as long as the recipe says and pulls at the fiber meanwhile; the micro follows
/// the light's peak until the gel point, and goes beyond it by what earlier fibers have taught. Tray and recipes are checked
/// whole before anything moves.
///
/// Writes a folder `runs/<time>-produce-<seed>/` with `report.html` (a Gantt chart with the critical path), `summary.json`,
/// `journal.jsonl` (each device as it was done: what `--resume` goes on from), and enters every fiber in the store of runs.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail produce                       the example tray on the default rig
  pigtail produce --tray my-tray.toml --seed 7 --operator 'M. Weber'
  pigtail produce --tray four --json    events, one a line; the last line is the result
  pigtail produce --tray my-tray.toml --seed 7 --resume 20261124T101500-produce-7
                                        goes on with a tray whose run was killed
  pigtail produce --times 60 --fleet shift
                                        eight hours on one machine, while the room warms up and cools down
  pigtail produce --trays 200 --fleet workshop --commissioned
                                        two hundred trays, each on a machine of its own")]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) common: Common,
    /// A tray file, or the name of one below `trays`
    #[arg(long, value_name = "FILE", default_value = DEFAULT_TRAY)]
    tray: String,
    /// Who is at the machine; it is kept with every fiber
    #[arg(long, value_name = "NAME", default_value = "")]
    operator: String,
    /// Goes on with the tray of a run that was interrupted, or with --trays behind the last one that it has done, by the run's name or
    /// folder
    #[arg(long, value_name = "RUN")]
    pub(crate) resume: Option<String>,
    /// With --resume: a person has taken the half-done device off the machine. It counts as rejected also where its recipe
    /// calls a person for it
    #[arg(long, requires = "resume")]
    cleared: bool,
    /// Commissions the machine first, as a machine of a fleet needs it
    #[arg(long = "commissioned", alias = "commission")]
    pub(crate) commission: bool,
    /// Whether the micro follows the light's peak until the gel point, in place of what the recipes say
    #[arg(long, value_name = "true|false")]
    track: Option<bool>,
    /// Whether it then goes beyond the peak by the shift that is expected, in place of what the recipes say
    #[arg(long, value_name = "true|false")]
    precompensate: Option<bool>,
    /// How often the tray comes, filled anew each time, one right after the other: a shift on a machine that goes on
    ///
    /// Devices, fibers and places of the second and of those behind it have its number behind their names, as YB-0001/2.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MOST_TIMES))]
    times: Option<u32>,
    /// Records the exchanges with the machine: some megabytes a minute of machine time
    #[arg(long)]
    record: bool,
    /// Let the machine's time keep to the clock
    #[arg(long)]
    real_time: bool,
    /// Runs so many trays, each on the machine that its own seed draws, from SEED on, and sums them up
    ///
    /// With --commissioned each machine is commissioned first (kept in `commissioned/` below the runs); nothing is run on
    /// one that is refused. The JSON has the same keys, over all trays, and how many fibers were passed wrongly and chips
    /// touched, with exact 95 % intervals; it is the same, byte for byte, whatever the number of threads.
    #[arg(long, value_name = "N", value_parser = crate::trays::whole,
        conflicts_with_all = ["cleared", "record", "real_time", "operator"])]
    pub(crate) trays: Option<u64>,
    /// How many trays to run at a time, with --trays [default: one for each core]
    #[arg(long, value_name = "T", value_parser = campaign::threads, requires = "trays")]
    pub(crate) threads: Option<usize>,
}

/// The last line of `--json`.
#[derive(Serialize)]
struct Last<'d> {
    devices: usize,
    fibers: usize,
    #[serde(rename = "yield")]
    passed: f64,
    seconds_per_fiber: &'d pigtail_evaluate::produce::Percentiles,
    align_seconds: &'d pigtail_evaluate::produce::Percentiles,
    devices_per_hour: f64,
    idle_percent: &'d pigtail_evaluate::produce::Sides,
    loss_db_after_cure: &'d pigtail_evaluate::produce::Percentiles,
    shift_um: &'d pigtail_evaluate::produce::Shift,
    rejected: &'d std::collections::BTreeMap<String, usize>,
}

impl<'d> Last<'d> {
    fn of(d: &'d ProduceDocument) -> Self {
        Self {
            devices: d.devices,
            fibers: d.fibers,
            passed: d.passed,
            seconds_per_fiber: &d.seconds_per_fiber,
            align_seconds: &d.align_seconds,
            devices_per_hour: d.devices_per_hour,
            idle_percent: &d.idle_percent,
            loss_db_after_cure: &d.loss_db_after_cure,
            shift_um: &d.shift_um,
            rejected: &d.rejected,
        }
    }
}

/// Tray, recipes and rig, all of them checked: every mistake at once.
pub(crate) fn load(common: &Common, tray: &str) -> Result<(Loaded, Setup), Failure> {
    let loaded = Loaded::read(tray)?;
    let setup = common.setup_with(loaded.device_recipe(), &Own::default(), false, &[])?;
    let wrong = loaded.check(&setup.rig.spec, &setup.rig.calibration);
    if wrong.is_empty() {
        return Ok((loaded, setup));
    }
    let all: Vec<String> = wrong.iter().map(ToString::to_string).collect();
    Err(anyhow::anyhow!(
        "{} mistake{}, and nothing has moved:\n  {}",
        all.len(),
        if all.len() == 1 { "" } else { "s" },
        all.join("\n  ")
    )
    .into())
}

/// What the store may have missed of a run that was killed between its journal and the store.
fn complete(left: &Left, loaded: &Loaded, runs: &Path) -> Result<(), Failure> {
    let entered: Vec<Entered> = left
        .fibers
        .iter()
        .filter_map(|pigtail| entered(loaded, pigtail, &left.who))
        .collect();
    if let Some(database) = Database::open(runs)? {
        database.complete(&left.run, &entered)?;
    }
    Ok(())
}

/// What a person sees: a line on a terminal, plain lines elsewhere, or events.
struct View {
    json: bool,
    bar: ProgressBar,
    left: String,
    right: String,
    light: f64,
    devices: (usize, usize, usize),
    fibers: usize,
    passed: usize,
    start: Option<f64>,
    /// When the last device was done, seconds of machine time.
    done_at: f64,
    now: f64,
    /// Seconds a device by the plan.
    each: f64,
    failed: Option<std::io::Error>,
}

impl View {
    fn new(json: bool, before: usize, all: usize, each: f64) -> Self {
        let live = std::io::stderr().is_terminal();
        let bar = if live {
            ProgressBar::with_draw_target(Some(all as u64), ProgressDrawTarget::stderr_with_hz(10))
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template("[{bar:12}] {prefix}\n{msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self {
            json,
            bar,
            left: String::new(),
            right: String::new(),
            light: 0.0,
            devices: (before, all, before),
            fibers: 0,
            passed: 0,
            start: None,
            done_at: 0.0,
            now: 0.0,
            each,
            failed: None,
        }
    }

    fn line(&mut self, text: &impl Serialize) {
        let written = serde_json::to_string(text)
            .map_err(std::io::Error::other)
            .and_then(|line| writeln!(std::io::stdout(), "{line}"));
        if let Err(why) = written {
            self.failed.get_or_insert(why);
        }
    }

    fn show(&self) {
        let (done, all, before) = self.devices;
        let start = self.start.unwrap_or(self.now);
        let seconds = self.now - start;
        let here = done - before;
        // Of those that are done: the time of one that is not yet would count for all that are to come.
        let each = if here > 0 {
            (self.done_at - start) / here as f64
        } else {
            self.each
        };
        let passed = if here > 0 {
            format!("{:.0} %", 100.0 * self.passed as f64 / here as f64)
        } else {
            "-".to_owned()
        };
        let ahead = (all - before) as f64 * each - seconds;
        let fiber = seconds / self.fibers.max(1) as f64;
        self.bar.set_position(done as u64);
        // Two lines of 80 columns.
        self.bar.set_prefix(format!(
            "device {}/{all}  fibers {}  yield {passed}  {fiber:.0} s a fiber  {:.0} min left",
            (done + 1).min(all),
            self.fibers,
            (ahead / 60.0).max(0.0).ceil(),
        ));
        self.bar.set_message(format!(
            "left {:9} right {:9} {}",
            self.left,
            self.right,
            light(self.light)
        ));
    }

    fn hear(&mut self, heard: &Heard) {
        match heard {
            Heard::Event(event) => {
                match event {
                    Event::Begin { time, .. } => {
                        self.start.get_or_insert(*time);
                        self.now = *time;
                    }
                    Event::Did(bar) => {
                        let of = if bar.side == Side::Left.name() {
                            &mut self.left
                        } else {
                            &mut self.right
                        };
                        bar.what.clone_into(of);
                        self.now = self.now.max(bar.end);
                    }
                    Event::Fiber(_) => self.fibers += 1,
                    Event::Device(_) => {}
                }
                if self.json && !matches!(event, Event::Device(_)) {
                    self.line(event);
                }
            }
            Heard::Device(told) => {
                let produced = &told.produced;
                self.devices.0 += 1;
                self.passed += usize::from(produced.rejected.is_empty());
                self.now = produced.end;
                self.done_at = produced.end;
                if self.json {
                    #[derive(Serialize)]
                    struct Tagged<'t> {
                        event: &'static str,
                        #[serde(flatten)]
                        told: &'t Told,
                    }
                    self.line(&Tagged {
                        event: "device",
                        told,
                    });
                } else if !std::io::stderr().is_terminal() {
                    let how = if produced.rejected.is_empty() {
                        "passed"
                    } else {
                        &produced.rejected
                    };
                    eprintln!(
                        "{} {how}, {:.0} s, {}/{}",
                        produced.serial,
                        produced.end - produced.start,
                        self.devices.0,
                        self.devices.1
                    );
                }
            }
        }
        self.show();
    }
}

/// The light and the phases of an alignment, on the line of a terminal.
struct Light<'v>(&'v std::cell::RefCell<View>);

impl Observer for Light<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        let mut view = self.0.borrow_mut();
        let of = if port == "input" {
            &mut view.left
        } else {
            &mut view.right
        };
        phase.clone_into(of);
        view.now = time;
        view.show();
    }

    fn sample(&mut self, sample: &Sample) {
        // As often as somebody can read it.
        if let Ok(mut view) = self.0.try_borrow_mut()
            && sample.time - view.now > 0.1
        {
            view.now = sample.time;
            view.light = sample.light.into_iter().fold(0.0, f64::max);
            view.show();
        }
    }
}

#[expect(
    clippy::too_many_lines,
    reason = "a tray from its file to its report, in order"
)]
pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let common = &arguments.common;
    let (mut loaded, mut setup) = load(common, &arguments.tray)?;
    let in_place = InPlace {
        track: arguments.track,
        precompensate: arguments.precompensate,
        times: arguments.times,
    };
    loaded.put(in_place);
    let mut configuration = setup.rig.hashes.clone();
    configuration.extend(loaded.hashes.iter().cloned());
    let head = Head {
        tray: loaded.tray.name.clone(),
        seed: common.seed,
        rig: setup.rig.name.clone(),
        fleet: setup.fleet_name().to_owned(),
        configuration,
        in_place,
        commissioned: arguments.commission,
    };
    if let Some(asked) = arguments.trays {
        return trays::run(arguments, setup, &loaded, asked, &head);
    }
    setup.options.real_time = arguments.real_time;
    setup.rig.hashes.extend(loaded.hashes.iter().cloned());
    let left = match &arguments.resume {
        Some(named) => resumed(named, &common.runs, &head, &loaded, arguments.cleared)?,
        None => Left::default(),
    };
    // Of a machine that is commissioned: what that began with.
    let rig = RunsOn::of(&setup.rig);
    if arguments.commission {
        setup = commissioned(&setup, common)?;
    } else {
        running::warn(&setup, Part::ALIGNMENT);
    }
    let planned = planned(&loaded, &setup);
    let run = running::begin(
        &mut setup,
        &common.runs,
        "produce",
        common.seed,
        arguments.record,
    )?;
    complete(&left, &loaded, &common.runs)?;
    let before = left.told;
    let who = Who {
        operator: arguments.operator.clone(),
        calibration: hash(
            setup
                .rig
                .sources
                .iter()
                .map(|source| source.text.as_str())
                .collect::<String>(),
        ),
    };
    let journal = Journal::begin(&run, &head, &who, &before)?;
    let all = loaded.tray.devices.len();
    let view = std::cell::RefCell::new(View::new(
        common.json,
        before.len(),
        all,
        planned.seconds_per_device,
    ));
    let wall = Instant::now();
    let mut failed: Option<anyhow::Error> = None;
    let mut hear = |heard: Heard| {
        let kept = journal.keep(&heard).and_then(|()| {
            if let Heard::Event(Event::Fiber(pigtail)) = heard
                && let Some(entered) = entered(&loaded, pigtail, &who)
            {
                run.pigtail(&entered)?;
            }
            Ok(())
        });
        if let Err(why) = kept {
            failed.get_or_insert(why);
        }
        view.borrow_mut().hear(&heard);
    };
    let ended = produce(
        &setup,
        &loaded,
        common.seed,
        &before,
        &mut Light(&view),
        &mut hear,
    );
    view.borrow().bar.finish_and_clear();
    let outcome = ended.map_err(|ended| running::stopped(&run, &setup, ended))?;
    if let Some(why) = failed {
        return Err(why.into());
    }
    let document = &outcome.document;
    run.write_json(
        "summary.json",
        &running::on_rig(rig.clone(), document, None),
    )?;
    run.write("report.html", report::produce(document, &outcome.run.bars)?)?;
    running::close_records(&run, &setup)?;
    match &document.fault {
        Some(fault) => run.fault(fault)?,
        None => run.finish(&format!(
            "{} of {} passed",
            document.devices - document.rejected.values().sum::<usize>(),
            document.devices
        ))?,
    }
    let mut text = Vec::new();
    if common.json {
        if let Some(why) = &document.called {
            let event = serde_json::json!({ "event": "call", "why": why });
            text.extend(format!("{event}\n").bytes());
        }
        if let Some(fault) = &document.fault {
            let event = serde_json::json!({ "event": "fault", "why": fault.to_string() });
            text.extend(format!("{event}\n").bytes());
        }
        serde_json::to_writer(&mut text, &Last::of(document)).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        words(&mut text, document, &planned, wall).map_err(anyhow::Error::from)?;
        let report = run.path("report.html");
        text.extend(format!("Report: {}\n", report.display()).bytes());
        text.extend(running::ran_on(&rig, arguments.commission).bytes());
    }
    crate::print(&text)?;
    Ok(match (&document.fault, document.rejected.is_empty()) {
        (Some(_), _) => FAULT,
        (None, true) => DONE,
        (None, false) => NEGATIVE,
    })
}

fn words(
    out: &mut impl Write,
    d: &ProduceDocument,
    plan: &Plan,
    wall: Instant,
) -> std::io::Result<()> {
    let or = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
    writeln!(
        out,
        "{} devices, {} fibers, yield {:.1} %",
        d.devices,
        d.fibers,
        100.0 * d.passed
    )?;
    for (cause, n) in &d.rejected {
        writeln!(out, "rejected for {cause}: {n}")?;
    }
    if let Some(fault) = &d.fault {
        writeln!(out, "the machine has stopped, and is safe: {fault}")?;
    }
    if let Some(called) = &d.called {
        writeln!(out, "a person is called: {called}")?;
    }
    writeln!(
        out,
        "{:.1} devices an hour ({:.1} planned), {} s a fiber (median)",
        d.devices_per_hour,
        plan.devices_per_hour,
        or(d.seconds_per_fiber.p50)
    )?;
    writeln!(
        out,
        "idle: left {:.1} %, right {:.1} %; under the lamp: left {:.1} %, right {:.1} %",
        d.idle_percent.left, d.idle_percent.right, d.held_percent.left, d.held_percent.right
    )?;
    writeln!(
        out,
        "loss after cure {} dB (median), {} dB (99 %); shifted {} um in all, {} um from the peak in the end (medians)",
        or(d.loss_db_after_cure.p50),
        or(d.loss_db_after_cure.p99),
        or(d.shift_um.untracked),
        or(d.shift_um.tracked)
    )?;
    writeln!(
        out,
        "{:.0} s of machine time in {:.1} s",
        d.seconds,
        wall.elapsed().as_secs_f64()
    )
}

/// A fiber as the store has it.
fn entered<'a>(loaded: &'a Loaded, pigtail: &'a Pigtail, who: &'a Who) -> Option<Entered<'a>> {
    let device = loaded
        .tray
        .devices
        .iter()
        .find(|device| device.serial == pigtail.device)?;
    Some(Entered {
        device: &pigtail.device,
        place: &device.place,
        port: &pigtail.port,
        fiber: &pigtail.fiber,
        fiber_place: &pigtail.place,
        recipe: loaded.tray.recipe_of(device),
        calibration: &who.calibration,
        operator: &who.operator,
        outcome: if pigtail.passed {
            "pigtailed"
        } else {
            &pigtail.cause
        },
        added_loss_db: pigtail.cured.map(|cured| cured.after_release_db),
        sigma_db: pigtail.cured.map(|cured| cured.sigma_db),
        off_um: pigtail
            .cured
            .map(|cured| [cured.off_um, cured.off_sigma_um, cured.shift_um]),
        seconds: pigtail.seconds,
    })
}

/// The setup with what commissioning has found of its machine.
fn commissioned(setup: &Setup, common: &Common) -> Result<Setup, Failure> {
    let machine = Specimen::from(common.seed).machine();
    let stop = AtomicBool::new(false);
    let machines = Commissioned::of(setup, &[machine], &common.runs, 1, &stop, |_, _| ())?;
    match machines.setup_of(machine)? {
        Some(found) => Ok((*found).clone()),
        None => {
            Err(anyhow::anyhow!("machine {machine} was refused when it was commissioned").into())
        }
    }
}
