//! `pigtail identify`.

use crate::choice::choice;
use crate::common::Common;
use crate::found::{self, FoundDocument, WriteArguments};
use crate::progress::Busy;
use crate::running::{self, stopped};
use crate::{DONE, Failure};
use clap::{Args, Subcommand};
use pigtail_control::calibration::Windups;
use pigtail_control::station::Unobserved;
use pigtail_hal::AxisName;
use pigtail_report as report;
use pigtail_session::calibrations::Change;
use pigtail_session::identify::{Identified, IdentifyWindup, Model, WindupDocument};
use pigtail_session::own::Own;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_store::samples::Samples;
use std::fmt::Write as _;

/// Identify what control should know of the machine
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Windup(WindupArguments),
    Servo(crate::records::ServoArguments),
    Friction(crate::records::FrictionArguments),
    Resonance(crate::records::ResonanceArguments),
    Hysteresis(crate::hysteresis::IdentifyArguments),
}

/// Identify the windup of a transmission, and what compensating it is worth (thesis 2.4)
///
/// Scans the axis back and forth while a probe measures its output, fits the thesis's function
/// (2.20) and a model that remembers every reversal that matters, and tries both on scans that they
/// were not fitted to. A `calibration.toml` with the model goes into the run's folder, and with --write into the
/// rig; from then on every motion of that kind of axis is compensated with it.
///
/// The gap is the largest spread of the output over the same wanted output, after two full ways: what
/// the thesis reads off as the difference between the forward and the backward path.
///
/// With `--data` instead of an axis, a transmission is identified from a person's own record of the encoders
/// on both of its sides, in angles (or lengths) of the output: their time skew first, then (2.20), compliance with
/// the torque, hysteresis with memory and an error of the ratio. The model that tells best what it was
/// not fitted to is reported, and a fragment of a `calibration.toml` written beside the report. What the
/// record does not tell has no value, and the exit code is 1.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail identify windup fivebar
  pigtail identify windup fivebar --rig my-rig --write
  pigtail identify windup --data d.csv --motor mot1_deg --load se1_deg --torque torque1_Nm
  pigtail identify windup --data d.csv --motor q_m:rad --gear-ratio 0.0125 --load q_l:rad")]
#[command(group(clap::ArgGroup::new("from").required(true).args(["axis", "data"])))]
#[command(group(clap::ArgGroup::new("machine").multiple(true).args(["model", "rig", "fleet", "calibration", "write"]).conflicts_with("data")))]
struct WindupArguments {
    /// fivebar, z, or left.a, left.b, left.z, right.a, right.b, right.z
    axis: Option<AxisName>,
    #[command(flatten)]
    record: crate::records::WindupRecordArguments,
    /// Which model to write and to report
    #[arg(long, value_parser = choice::<Model>(), default_value = "memory")]
    model: Model,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    write: WriteArguments,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    match &arguments.what {
        What::Windup(arguments) => run_windup(arguments),
        What::Servo(arguments) => crate::records::servo(arguments),
        What::Friction(arguments) => crate::records::friction(arguments),
        What::Resonance(arguments) => crate::records::resonance(arguments),
        What::Hysteresis(arguments) => crate::hysteresis::identify(arguments),
    }
}

fn run_windup(arguments: &WindupArguments) -> Result<u8, Failure> {
    let Some(at) = arguments.axis else {
        let common = &arguments.common;
        return crate::records::windup(&arguments.record, common.json, &common.runs);
    };
    let (common, write) = (&arguments.common, arguments.write);
    write.check(&common.rig)?;
    let kind = Windups::default().table(at);
    let mut setup = common.setup_with(DEFAULT_RECIPE_NAME, &Own::default(), true, &[&kind])?;
    let entry = setup.rig.calibration.windup.table(at);
    let (runs, seed) = (&arguments.common.runs, arguments.common.seed);
    let run = running::begin(&mut setup, runs, "identify windup", seed, true)?;
    let job = IdentifyWindup {
        at,
        model: arguments.model,
        seed,
    };
    let busy = Busy::new("identify windup", "scanning the axis");
    let identified = setup.run(&job, seed, &mut Unobserved);
    drop(busy);
    let mut identified = identified.map_err(|ended| stopped(&run, &setup, ended))?;
    identified.document.report = run.path("report.html").display().to_string();
    let change = Change {
        table: entry,
        values: identified.values(
            &run.date(),
            &format!("identify windup {at}, run {}", run.name()),
        ),
        weights: None,
    };
    let what = format!("identify windup {at}");
    let found = found::keep(write, &run, common, &setup, &what, &[change])?;
    identified.document.calibration = found.written();
    let document = running::on(&setup, &identified.document, Some(&found));
    run.write_json("summary.json", &document)?;
    run.write("report.html", report::windup(&identified)?)?;
    samples(&identified).keep(&run)?;
    let text = running::told(common.json, &document, &setup, || {
        account(&identified.document, &found)
    })?;
    running::close_records(&run, &setup)?;
    run.finish("done")?;
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

/// The scan that it was identified from, and the one that compensation was tried on, in columns.
fn samples(identified: &Identified) -> Samples {
    let um = |radians: &[f64]| {
        radians
            .iter()
            .map(|r| r * identified.um_per_radian)
            .collect()
    };
    let [before, after] = &identified.before_and_after;
    let record = &identified.record;
    Samples::default()
        .with("time_s", "from the scan's begin", record.time())
        .with(
            "input_um",
            "motor, in micrometres of the output",
            um(&record.input),
        )
        .with("output_um", "output by its probe", um(&record.output))
        .with(
            "wanted_um",
            "the output that was wanted",
            um(&record.wanted),
        )
        .with(
            "uncompensated_input_um",
            "the first trial's motor, without compensation",
            um(&before.input),
        )
        .with("uncompensated_output_um", "its output", um(&before.output))
        .with(
            "compensated_input_um",
            "the same trial's motor, with compensation",
            um(&after.input),
        )
        .with("compensated_output_um", "its output", um(&after.output))
}

/// What a person wants to know of it.
fn account(d: &WindupDocument, found: &FoundDocument) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{}: W_max {:.3} um, Q {:.3} um; the model leaves {:.3} um rms of the windup",
        d.axis, d.w_max_um, d.q_um, d.residual_um
    );
    let _ = writeln!(
        text,
        "Gap between the paths, and peak-to-peak error of the output, um:"
    );
    let _ = writeln!(
        text,
        "  {:24} {:>15} {:>15} {:>15}",
        "scan", "none", "reversal", "memory"
    );
    for row in &d.scans {
        let [none, reversal, memory] = row.peak_to_peak_um;
        let _ = writeln!(
            text,
            "  {:24} {:7.2} {none:7.2} {:7.2} {reversal:7.2} {:7.2} {memory:7.2}",
            row.name, row.uncompensated_um, row.reversal_um, row.memory_um
        );
    }
    let _ = writeln!(
        text,
        "The gap over the full range of {:.0} um is {:.1} times narrower, the error at least {:.1} times \
         less on every scan.",
        d.range_um, d.factor, d.worst_factor
    );
    text += &found.account();
    let _ = writeln!(text, "Report: {}", d.report);
    text
}
