//! `pigtail impulse`.

use crate::choice::choice;
use crate::common::{believed, in_unit, write_table};
use crate::progress::Busy;
use crate::running::{self, stopped};
use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use pigtail_evaluate::impulse::condition::Condition;
use pigtail_evaluate::impulse::run::{
    Campaign, CampaignRow, PulseDocument, Resolution, StepRow, Task, check, compare, resolution,
    run as run_one, runs, stability, summary, tolerance,
};
use pigtail_hal::quantity::{LENGTH, Sign, TIME};
use pigtail_hal::{Axis, AxisName, Error};
use pigtail_report as report;
use pigtail_session::calibrations::Part;
use pigtail_session::impulse::Estimator;
use pigtail_session::job::Ended;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, Named};
use pigtail_session::setup::Setup;
use pigtail_store::samples::Samples;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Bring an axis to a target by pulses, far finer than its encoder (thesis 4.3)
///
/// The servo lets go of the axis; pulses of the amplifier move it, and the probe at its output says how
/// far it still is (4.9)-(4.12). How far a pulse moves it is known from `pigtail characterize AXIS
/// impulse` and, unless told otherwise, corrected by every pulse. What the machine differs by is drawn
/// by the seed, as the condition says; the error at the end is the truth.
///
/// The exit code is 1 where the loop has not settled within its pulses.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail impulse z --target-nm 100
  pigtail impulse fivebar --target-nm 2000 --rest-ms 250     the thesis's rate
  pigtail impulse z --target-nm 100 --estimator parabola     the thesis's law
  pigtail impulse z --target-nm 100 --machines 1000 --json   a campaign over machines")]
pub(crate) struct Arguments {
    /// fivebar, z, or left.a, left.b, left.z, right.a, right.b, right.z
    axis: AxisName,
    /// The way to go, nanometres; backward where negative
    #[arg(long, value_name = "NM", value_parser = in_unit(LENGTH, "nm", Sign::Any))]
    target_nm: f64,
    /// What to draw: machine, device, fixture and noise
    #[arg(long, default_value_t = 0, value_parser = crate::from_zero::<u64>)]
    seed: u64,
    /// A folder with the three files of a rig, or the name of one below `rigs`
    #[arg(long, default_value = DEFAULT_RIG_NAME)]
    rig: String,
    /// A calibration in place of the rig's: the number of a version, a run that found it, or a file
    #[arg(long, value_name = "VERSION|RUN|FILE")]
    calibration: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Where to write the run's folder
    #[arg(long, alias = "into", value_name = "FOLDER", default_value = "runs", value_parser = folder)]
    runs: PathBuf,
    /// How it knows what pulses do
    #[arg(long, value_parser = choice::<Estimator>(), default_value = <&str>::from(Estimator::default()))]
    estimator: Estimator,
    /// What is uncertain about the machine
    #[arg(long, value_parser = choice::<Condition>(), default_value = <&str>::from(Condition::default()))]
    condition: Condition,
    /// `k_c` of (4.10): the share of the error that a pulse is to take away, above 0 and below 2
    #[arg(long, default_value_t = 1.0)]
    gain: f64,
    /// Pulses at most
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pulses: u32,
    /// Error that is small enough, nanometres; 10 on z, 150 on a five-bar
    #[arg(long, value_name = "NM", value_parser = in_unit(LENGTH, "nm", Sign::Positive))]
    tolerance_nm: Option<f64>,
    /// Time in which all comes to rest after a pulse, milliseconds; what is believed enough if not given
    #[arg(long, value_name = "MS", value_parser = in_unit(TIME, "ms", Sign::Positive))]
    rest_ms: Option<f64>,
    /// On so many machines, a run on each, and what they have in common
    #[arg(long, value_name = "M", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    machines: Option<u64>,
}

/// Parses a folder. A number would be what `--machines` is now.
fn folder(text: &str) -> Result<PathBuf, String> {
    if text.parse::<u64>().is_ok() {
        return Err(format!(
            "accepted is a folder; that of {text} machines is --machines {text}"
        ));
    }
    Ok(PathBuf::from(text))
}

/// Longest rest that anyone would wait for, milliseconds.
const LONGEST_REST: f64 = 10_000.0;

/// Runs of each row of a campaign's comparison, at most.
const COMPARED: u64 = 100;

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let calibration = believed(
        &arguments.rig,
        arguments.calibration.as_deref(),
        &arguments.runs,
    )?;
    let mut setup = Setup::load_named(&Named {
        rig: &arguments.rig,
        recipe: DEFAULT_RECIPE_NAME,
        calibration: calibration.as_deref(),
        ..Named::default()
    })?;
    let at = arguments.axis;
    let period = 1e3 * setup.rig.spec.period();
    if let Some(rest) = arguments
        .rest_ms
        .filter(|ms| !(period..=LONGEST_REST).contains(ms))
    {
        let message = format!("{rest} ms is no rest; accepted is {period} to {LONGEST_REST} ms");
        return Err(Error::new("--rest-ms", "", message).into());
    }
    let mut task = Task::usual(at, 1e-9 * arguments.target_nm);
    task.estimator = arguments.estimator;
    task.condition = arguments.condition;
    task.settings.gain = arguments.gain;
    task.settings.pulses = arguments.pulses;
    task.settings.tolerance = arguments
        .tolerance_nm
        .map_or_else(|| tolerance(at.axis), |nm| 1e-9 * nm);
    task.rest = arguments.rest_ms.map(|ms| 1e-3 * ms);
    check(&setup, &task)?;
    running::warn(&setup, &[Part::Impulse]);
    let kind = format!("impulse {at}");
    let (seed, recorded) = (arguments.seed, arguments.machines.is_none());
    let run = running::begin(&mut setup, &arguments.runs, &kind, seed, recorded)?;
    let busy = Busy::new("impulse", "closing loops");
    let done = match arguments.machines {
        None => single(arguments, &setup, &task),
        Some(count) => campaign(arguments, &setup, &task, count),
    };
    drop(busy);
    let done = done.map_err(|error| stopped(&run, &setup, error))??;
    run.write("summary.json", format!("{}\n", done.json))?;
    run.write("report.html", done.html)?;
    done.samples.keep(&run)?;
    let report = run.path("report.html").display().to_string();
    running::close_records(&run, &setup)?;
    run.finish(if done.code == DONE {
        "done"
    } else {
        "negative"
    })?;
    let text = if arguments.json {
        format!("{}\n", done.json)
    } else {
        format!("{}Report: {report}\n{}", done.text, running::line(&setup))
    };
    crate::print(text.as_bytes())?;
    Ok(done.code)
}

/// What a command leaves to be printed and kept.
struct Done {
    json: String,
    text: String,
    html: String,
    samples: Samples,
    code: u8,
}

type Experiment = Result<anyhow::Result<Done>, Ended>;

fn single(arguments: &Arguments, setup: &Setup, task: &Task) -> Experiment {
    let seed = arguments.seed;
    let document = run_one(setup, task, seed)?;
    // The one that was asked for is recorded, not what it is compared with.
    let setup = &Setup {
        records: None,
        ..setup.clone()
    };
    // From four sides, by the thesis's law at its rate, and as asked for (Fig. 4.22).
    let mut sides = Vec::new();
    for (estimator, rest) in [
        (Estimator::Parabola, Some(0.25)),
        (task.estimator, task.rest),
    ] {
        for share in [-1.0, -0.5, 0.5, 1.0] {
            let task = Task {
                target: share * task.target,
                estimator,
                rest,
                ..*task
            };
            sides.push(run_one(setup, &task, seed)?);
        }
    }
    let gains = stability(setup, task.at, seed)?;
    // Figs. 4.23, 4.24.
    let step = match task.at.axis {
        Axis::A | Axis::B => 2e-7,
        Axis::Z => 2e-8,
    };
    let steps = resolution(setup, task, step, seed)?;
    let mut text = format!(
        "{}: {} nm by {} pulse(s): {:.1} nm off in truth, estimator {}, condition {}\n",
        document.axis,
        document.target_nm,
        document.pulses,
        document.error_nm,
        document.estimator,
        document.condition
    );
    let _ = writeln!(
        text,
        "  {}",
        document.settled_s.map_or_else(
            || format!("not settled to {} nm", document.tolerance_nm),
            |s| format!("settled to {} nm after {s:.2} s", document.tolerance_nm)
        )
    );
    let _ = writeln!(
        text,
        "  40 pulses of {} nm in one direction: mean {:.1} nm, deviation {:.1} nm, {:.1} to {:.1} nm",
        steps.step_nm, steps.mean_nm, steps.deviation_nm, steps.least_nm, steps.greatest_nm
    );
    let code = if document.settled_s.is_some() {
        DONE
    } else {
        NEGATIVE
    };
    let all = Single {
        document: &document,
        resolution: &steps,
        from: &sides,
        gains: &gains,
    };
    Ok(serde_json::to_string(&running::on(setup, &all, None))
        .map_err(anyhow::Error::from)
        .and_then(|json| {
            let html = report::pulses(&document, &sides, &gains, &steps)?;
            Ok(Done {
                json,
                text,
                html,
                samples: samples(&document, &steps),
                code,
            })
        }))
}

/// Each moment of rest of the loop, and of the pulses in one direction, in columns.
fn samples(document: &PulseDocument, resolution: &Resolution) -> Samples {
    let of = |what: fn(&StepRow) -> f64| document.steps.iter().map(what).collect();
    Samples::default()
        .with(
            "time_s",
            "from the first measurement to a moment of rest",
            of(|step| step.time_s),
        )
        .with(
            "measured_nm",
            "the error by the sensor",
            of(|step| step.measured_nm),
        )
        .with("error_nm", "the true error", of(|step| step.error_nm))
        .with(
            "a1_fsm",
            "a1 of the pulse that follows, over the voltage at which the motor breaks away",
            of(|step| step.a1_fsm.unwrap_or(f64::NAN)),
        )
        .with(
            "expected_nm",
            "what that pulse is expected to do",
            of(|step| step.expected_nm),
        )
        .with(
            "resolution_position_nm",
            "the output after each pulse in one direction, without a loop",
            resolution.position_nm.clone(),
        )
}

/// How the loop of each machine ended, in columns.
fn samples_of_machines(documents: &[PulseDocument]) -> Samples {
    let of = |what: fn(&PulseDocument) -> f64| documents.iter().map(what).collect();
    Samples::default()
        .with("seed", "of the machine", of(|d| d.seed as f64))
        .with("pulses", "that were played", of(|d| d.pulses as f64))
        .with("error_nm", "the true error at the end", of(|d| d.error_nm))
        .with(
            "settled_s",
            "until the true error came to stay within the tolerance; nothing where it did not",
            of(|d| d.settled_s.unwrap_or(f64::NAN)),
        )
}

/// A run, and what its report shows beside it.
#[derive(serde::Serialize)]
struct Single<'a> {
    #[serde(flatten)]
    document: &'a PulseDocument,
    resolution: &'a Resolution,
    /// From four sides.
    from: &'a [PulseDocument],
    /// With each gain, on a machine whose response is known.
    gains: &'a [PulseDocument],
}

fn campaign(arguments: &Arguments, setup: &Setup, task: &Task, count: u64) -> Experiment {
    let seed = arguments.seed;
    let documents = runs(setup, task, seed, count)?;
    let campaign = Campaign {
        axis: task.at.to_string(),
        seed,
        target_nm: arguments.target_nm,
        tolerance_nm: 1e9 * task.settings.tolerance,
        most_pulses: task.settings.pulses,
        row: summary(task, &documents),
        comparison: compare(setup, task, seed, count.min(COMPARED))?,
    };
    let mut text = Vec::new();
    let rows = table(&campaign);
    Ok(write_table(&mut text, &rows)
        .map_err(anyhow::Error::from)
        .and_then(|()| {
            Ok(Done {
                json: serde_json::to_string(&running::on(setup, &campaign, None))?,
                text: String::from_utf8(text)?,
                html: report::pulse_campaign(&campaign, &documents)?,
                samples: samples_of_machines(&documents),
                code: DONE,
            })
        }))
}

fn table(campaign: &Campaign) -> Vec<Vec<String>> {
    let header = [
        "condition",
        "estimator",
        "runs",
        "below 10 nm\n%",
        "within tolerance\n%",
        "error p50\nnm",
        "p90\nnm",
        "pulses p90",
        "settled p90\ns",
    ];
    let row = |row: &CampaignRow| {
        vec![
            row.condition.to_owned(),
            row.estimator.to_owned(),
            row.runs.to_string(),
            format!("{:.1}", row.below_10nm_percent),
            format!("{:.1}", row.within_tolerance_percent),
            format!("{:.1}", row.error_nm.p50),
            format!("{:.1}", row.error_nm.p90),
            format!("{:.0}", row.pulses.p90),
            row.settled_s
                .map_or_else(|| "-".to_owned(), |s| format!("{:.2}", s.p90)),
        ]
    };
    let mut rows = vec![header.map(str::to_owned).to_vec(), row(&campaign.row)];
    rows.extend(campaign.comparison.iter().map(row));
    rows
}
