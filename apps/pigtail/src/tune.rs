//! `pigtail tune`.

use crate::choice::choice;
use crate::common::{Common, OwnAxes};
use crate::found::{self, FoundDocument, WriteArguments};
use crate::running::{self, stopped};
use crate::way::{Way, way};
use crate::{DONE, Failure};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pigtail_control::station::{Observer, Sample};
use pigtail_hal::{Axis, AxisName, Error};
use pigtail_report as report;
use pigtail_session::calibrations::Change;
use pigtail_session::own::Own;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_session::setup::Setup;
use pigtail_session::tune::{Method, Tune, TuningDocument, step_of};
use pigtail_store::runs::Run;
use std::fmt::Write as _;

/// Tune the PID of an axis on the machine
///
/// Steps the axis by two sizes and looks for the gains with the least ITAE (integral of time times
/// absolute error), from three starts far apart. Gains that ring or let the axis run away are cut
/// short and count as infinitely bad. Where the gains that are believed do not hold the axis, it begins with
/// the best of a few by the datasheet. A `calibration.toml` with the result goes into the run's folder below
/// `runs`, with a report with the path through gain space, and with --write into the rig. With --from the axis is
/// one of your own, and what goes into that folder is a fragment with its gains.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail tune fivebar                     the first joint of the left five-bar
  pigtail tune z --rig my-rig --write      into the rig, as a new version of its calibration
  pigtail tune right.b --search random     the thesis's own search, 100 trials
  pigtail tune z --from plant.toml         your own axis, as identify servo wrote it")]
pub(crate) struct Arguments {
    /// fivebar, z, or left.a, left.b, left.z, right.a, right.b, right.z
    axis: AxisName,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    own: OwnAxes,
    /// How to search
    #[arg(long, value_parser = choice::<Method>(), default_value = "simplex")]
    search: Method,
    /// Trials of each start, 100 at most; 50 for the simplex, 100 for the random search
    #[arg(long, value_parser = clap::value_parser!(u32).range(5..=100))]
    trials: Option<u32>,
    /// The larger of the two steps: counts, 20 or more, or "81 um" of z, "0.9 deg" of a joint; if not given, these
    /// two, which are 1300 and 400 counts of the shipped rig
    #[arg(long, value_parser = way)]
    step: Option<Way>,
    #[command(flatten)]
    write: WriteArguments,
}

/// Shows each trial.
struct Trials<'a>(&'a ProgressBar);

impl Observer for Trials<'_> {
    fn phase(&mut self, _: &str, _: &'static str, _: f64) {}

    fn sample(&mut self, _: &Sample) {}

    fn trial(&mut self, start: usize, trial: u32, best: f64) {
        self.0.inc(1);
        let start = start + 1;
        let message = format!("start {start}  trial {trial}  cost {best:.2} ms2");
        self.0.set_message(message);
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let at = arguments.axis;
    let own = Own::read(&arguments.own.from)?;
    own.concerns(at.axis)?;
    let (common, write) = (&arguments.common, arguments.write);
    if write.is_asked() && !own.is_empty() {
        let message = "writes into a rig, and an axis of --from is in none; accepted is a rig that has it, such as \
                       `pigtail rig my-rig --from` makes";
        return Err(Error::new("--write", "", message).into());
    }
    write.check(&common.rig)?;
    let mut setup = common.setup_with(DEFAULT_RECIPE_NAME, &own, true, &[])?;
    let step = match arguments.step {
        Some(step) => step.counts(&setup.rig, at.axis, "--step", 20)?,
        None => step_of(&setup.rig, at.axis),
    };
    let plan = Tune {
        at,
        method: arguments.search,
        trials: arguments.trials.unwrap_or(arguments.search.usual_trials()),
        step,
        seed: arguments.common.seed,
        one_size: false,
    };
    let seed = arguments.common.seed;
    let run = running::begin(&mut setup, &arguments.common.runs, "tune", seed, true)?;
    let bar = ProgressBar::new(u64::from(3 * plan.trials));
    if let Ok(style) = ProgressStyle::with_template("{prefix:17} [{bar:20}] {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(format!("tune {at}"));
    let mut tuned = setup
        .run(&plan, seed, &mut Trials(&bar))
        .map_err(|ended| stopped(&run, &setup, ended))?;
    bar.finish_and_clear();
    tuned.document.report = run.path("report.html").display().to_string();
    let found = {
        let table = format!(
            "gains.{}",
            if at.axis == Axis::Z { "z" } else { "five_bar" }
        );
        let origin = format!("tune {at}, run {}", run.name());
        let values = tuned.document.gains.values(&run.date(), &origin);
        if own.is_empty() {
            let change = Change {
                table,
                values,
                weights: None,
            };
            let found = found::keep(
                write,
                &run,
                common,
                &setup,
                &format!("tune {at}"),
                &[change],
            )?;
            tuned.document.calibration = found.written();
            Some(found)
        } else {
            tuned.document.calibration = beside(&run, &setup, at.axis, &values)?;
            None
        }
    };
    let document = running::on(&setup, &tuned.document, found.as_ref());
    run.write_json("summary.json", &document)?;
    run.write("report.html", report::tuning(&tuned)?)?;
    crate::characterize::samples(&tuned.after)
        .with(
            "encoder_before_counts",
            "the same step under the gains that it began with",
            tuned.before.encoder.clone(),
        )
        .keep(&run)?;
    let text = running::told(common.json, &document, &setup, || {
        account(&tuned.document, found.as_ref())
    })?;
    running::close_records(&run, &setup)?;
    run.finish("done")?;
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

/// The gains of an axis of a person's own as a fragment that `--from` takes; returns its path.
fn beside(
    run: &Run,
    setup: &Setup,
    axis: Axis,
    values: &[(&str, toml_edit::Item)],
) -> anyhow::Result<String> {
    let (name, before) = match axis {
        Axis::Z => ("z", &setup.rig.calibration.gains.z),
        Axis::A | Axis::B => ("five_bar", &setup.rig.calibration.gains.five_bar),
    };
    let mut document = toml_edit::DocumentMut::new();
    let mut gains = toml_edit::Table::new();
    gains.set_implicit(true);
    gains[name] = toml_edit::table();
    for (key, value) in values {
        gains[name][key] = value.clone();
    }
    gains[name]["integral_limit"] = toml_edit::value(format!("{} V", before.integral_limit));
    document["gains"] = toml_edit::Item::Table(gains);
    run.write("calibration.toml", document.to_string())?;
    Ok(run.path("calibration.toml").display().to_string())
}

/// What a person wants to know of it.
fn account(document: &TuningDocument, found: Option<&FoundDocument>) -> String {
    let mut text = String::new();
    let g = document.gains;
    let _ = writeln!(
        text,
        "{}: kp {} V/count, ki {} V/(count s), kd {} V s/count",
        document.axis, g.kp, g.ki, g.kd
    );
    let _ = writeln!(
        text,
        "rise {:.1} ms, settling {:.1} ms, overshoot {:.1} %, cost {:.2} ms2",
        document.rise_ms, document.settling_ms, document.overshoot_percent, document.cost
    );
    if let Some(specified) = document.specified {
        let _ = writeln!(text, "specified: {specified}");
    }
    for start in &document.starts {
        let _ = writeln!(
            text,
            "  from kp {}, ki {}, kd {}: cost {} to {:.2} ms2 in {} trials, within 5 % after {}",
            start.start.kp,
            start.start.ki,
            start.start.kd,
            start
                .cost_at_start
                .map_or_else(|| "infinite".to_owned(), |c| format!("{c:.2}")),
            start.cost,
            start.trials,
            start.trials_to_5_percent
        );
    }
    let _ = writeln!(text, "{:.0} s of machine time", document.seconds_machine);
    match found {
        Some(found) => text += &found.account(),
        None => {
            let _ = writeln!(text, "Written to {}", document.calibration);
        }
    }
    let _ = writeln!(text, "Report: {}", document.report);
    text
}
