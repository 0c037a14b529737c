//! `pigtail characterize`.

use super::common::{Common, OwnAxes};
use super::{DONE, Failure, stopped};
use crate::characterize::{
    ExperimentError, follow_sine, frequency, metres_per_count, on_twin, resolution, step,
};
use crate::impulse::response::{kind_of, response};
use crate::loops::windup;
use crate::records::own::Own;
use crate::report;
use crate::rig::{DEFAULT_RECIPE_NAME, Setup};
use crate::runs::Run;
use crate::tune::step_of;
use clap::{Args, ValueEnum};
use pigtail_hal::{Axis, AxisName, Error};
use serde::Serialize;
use std::fmt::Write as _;

/// Measure what an axis can do: step, sine, resolution, frequency response, windup or pulses
///
/// step        rise (10 to 90 %), settling (until the encoder stays within one count), overshoot
/// sine        gain and phase at the encoder and at the output
/// resolution  1000 steps in one direction; the step size is raised by a count until at most 1 %
///             of the steps move the output by less than half the mean (thesis 2.5)
/// frequency   gain, phase and coherence up to 300 Hz, from a random reference
/// windup      input against output forward and back, on this machine and on the same one with other
///             load friction, preload and law of friction (thesis 2.4.1, 2.4.2)
/// impulse     what pulses of the amplifier move: one of them, the map over both harmonics, the second
///             harmonic that leaves no dead zone, the parabola (4.8), its spread, and how to relax the
///             transmission between pulses (thesis 4.3.1); into the rig's calibration
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  pigtail characterize fivebar step
  pigtail characterize z sine --frequency 8
  pigtail characterize z resolution --json
  pigtail characterize z step --from plant.toml     your own axis, as identify servo wrote it"
)]
pub(super) struct Arguments {
    /// fivebar, z, or left.a, left.b, left.z, right.a, right.b, right.z
    axis: AxisName,
    /// What to measure
    #[arg(value_enum)]
    what: What,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    own: OwnAxes,
    /// Size of the step, or amplitude of sine or noise, counts
    #[arg(long, value_parser = clap::value_parser!(i64).range(1..), allow_negative_numbers = true)]
    size: Option<i64>,
    /// Frequency of the sine, hertz; 10 for a five-bar joint, 8 for z
    #[arg(long, value_name = "HERTZ", value_parser = super::positive)]
    frequency: Option<f64>,
    /// Steps of the resolution test
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(10..=10_000))]
    steps: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    Step,
    Sine,
    Resolution,
    Frequency,
    Windup,
    Impulse,
}

/// What an experiment leaves to be printed and kept.
struct Outcome {
    json: String,
    text: String,
    html: String,
}

fn result(document: &impl Serialize, text: String, html: String) -> anyhow::Result<Outcome> {
    Ok(Outcome {
        json: serde_json::to_string(document)?,
        text,
        html,
    })
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let at = arguments.axis;
    let own = Own::read(&arguments.own.from)?;
    own.concerns(at.axis)?;
    let setup = Setup::load_with(&arguments.common.rig, DEFAULT_RECIPE_NAME, &own, true)?;
    let range = setup.range_counts(at.axis);
    if let Some(size) = arguments.size.filter(|size| *size as f64 > 0.4 * range) {
        let message = format!(
            "{size} counts are beyond the axis's range; accepted is at most {:.0}",
            0.4 * range
        );
        return Err(Error::new("--size", "", message).into());
    }
    if let Some(hertz) = arguments
        .frequency
        .filter(|f| *f > 0.2 * setup.spec.servo.rate)
    {
        let message = format!(
            "{hertz} Hz is too fast for the servo; accepted is at most {} Hz",
            0.2 * setup.spec.servo.rate
        );
        return Err(Error::new("--frequency", "", message).into());
    }
    let run = Run::begin(
        &arguments.common.runs,
        &format!("characterize {at}"),
        arguments.common.seed,
        &setup.hashes,
    )?;
    let done = match arguments.what {
        What::Windup => on_variants(arguments, &setup),
        What::Impulse => pulses(arguments, &setup, &run),
        _ => on_twin(&setup, arguments.common.seed, |station| {
            experiment(arguments, &setup, station)
        }),
    }
    .map_err(|error| stopped(&run, error, &arguments.common.rig))??;
    run.write("summary.json", format!("{}\n", done.json))?;
    run.write("report.html", done.html)?;
    let report = run.path("report.html").display().to_string();
    run.finish("done")?;
    let text = if arguments.common.json {
        format!("{}\n", done.json)
    } else {
        format!("{}Report: {report}\n", done.text)
    };
    super::print(text.as_bytes())?;
    Ok(DONE)
}

type Experiment = Result<anyhow::Result<Outcome>, ExperimentError>;

fn experiment(
    arguments: &Arguments,
    setup: &Setup,
    station: &mut pigtail_control::station::Station,
) -> Experiment {
    let at = arguments.axis;
    let usual = step_of(setup, at.axis);
    let mut text = String::new();
    Ok(match arguments.what {
        // Those that take machines of their own are not asked here.
        What::Windup | What::Impulse => return on_variants(arguments, setup),
        What::Step => {
            let (d, trace) = step(station, at, arguments.size.unwrap_or(usual))?;
            let _ = writeln!(
                text,
                "{at}: step of {} counts: rise {:.1} ms, settling {:.1} ms, overshoot {:.1} %",
                d.step, d.rise_ms, d.settling_ms, d.overshoot_percent
            );
            report::step(&d, &trace).and_then(|html| result(&d, text, html))
        }
        What::Sine => {
            let hertz = arguments
                .frequency
                .unwrap_or(if at.axis == Axis::Z { 8.0 } else { 10.0 });
            let amplitude = arguments.size.unwrap_or(usual / 4) as f64;
            let (d, trace) = follow_sine(station, setup, at, hertz, amplitude)?;
            let _ = writeln!(
                text,
                "{at}: sine of {hertz} Hz, {amplitude} counts: gain {:.4}, phase {:.2} deg at the \
                 encoder",
                d.encoder_gain, d.encoder_phase_deg
            );
            if let (Some(gain), Some(phase)) = (d.output_gain, d.output_phase_deg) {
                let _ = writeln!(text, "  gain {gain:.4}, phase {phase:.2} deg at the output");
            }
            let scale = metres_per_count(setup, at.axis).ok();
            report::sine(&d, &trace, scale).and_then(|html| result(&d, text, html))
        }
        What::Resolution => {
            let rows = resolution(station, setup, at, arguments.steps)?;
            for (row, _) in &rows {
                let _ = writeln!(
                    text,
                    "{at}: {} steps of {} count(s): mean {:.4} um, deviation {:.4} um, largest {:.4} \
                     um, {:.1} % stuck{}",
                    row.steps,
                    row.counts_per_step,
                    row.mean_um,
                    row.std_um,
                    row.max_um,
                    100.0 * row.stuck_share,
                    row.resolution_um
                        .map_or_else(String::new, |r| format!(": resolution {r:.3} um"))
                );
            }
            let documents: Vec<_> = rows.iter().map(|(row, _)| row).collect();
            report::resolution(&rows).and_then(|html| result(&documents, text, html))
        }
        What::Frequency => {
            let amplitude = arguments.size.unwrap_or(usual / 20) as f64;
            let (d, responses) = frequency(station, setup, at, amplitude, arguments.common.seed)?;
            let hertz = |f: Option<f64>| f.map_or_else(|| "-".to_owned(), |f| format!("{f:.1} Hz"));
            let _ = writeln!(
                text,
                "{at}: bandwidth (-3 dB) {} at the encoder, {} at the output; coherence at least {:.3}",
                hertz(d.bandwidth_hz),
                hertz(d.output_bandwidth_hz),
                d.lowest_coherence
            );
            report::frequency(&d, &responses).and_then(|html| result(&d, text, html))
        }
    })
}

/// What pulses do; what was found is believed from now on.
fn pulses(arguments: &Arguments, setup: &Setup, run: &Run) -> Experiment {
    let at = arguments.axis;
    let (d, figures, found) = response(setup, at, arguments.common.seed)?;
    let origin = format!("characterize {at} impulse, run {}", run.name());
    let table = format!("impulse.{}", kind_of(at));
    let written = setup.write_calibration(&table, &found.table(&run.date(), &origin))?;
    if let Err(error) = run.calibrated(written.as_deref(), &table) {
        return Ok(Err(error));
    }
    let mut text = format!(
        "{}: breaks away at {:.4} V (1 fsm); transmission relaxed by: {}\n  no dead zone from a2 = \
         {:.2} fsm on; b = {:.2} nm, R2 = {:.3}; {:.1} nm at a1 = {} fsm, {:.1} to {:.1} nm over \
         machines that differ (p10, p90)\n",
        d.axis,
        d.fsm_v,
        d.relax,
        d.a2_fsm,
        d.b_nm,
        d.r2,
        d.displacement_nm.value,
        d.displacement_nm.a1,
        d.spread.p10,
        d.spread.p90
    );
    let _ = writeln!(
        text,
        "{}",
        written.map_or_else(
            || "The calibration was left as it is: the rig is in no folder of its own.".to_owned(),
            |file| format!("Written to {file}")
        )
    );
    Ok(report::response(&d, &figures).and_then(|html| result(&d, text, html)))
}

/// Windup on machines that differ.
fn on_variants(arguments: &Arguments, setup: &Setup) -> Experiment {
    let (d, loops) = windup(setup, arguments.axis, arguments.common.seed)?;
    let mut text = format!(
        "{}: windup over {:.0} um, forward and back, um\n  {:34} {:>8} {:>8} {:>8} {:>14}\n",
        d.axis, d.range_um, "machine", "windup", "W_max", "Q", "(2.20) leaves"
    );
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    for case in &d.cases {
        let _ = writeln!(
            text,
            "  {:34} {:8.2} {:>8} {:>8} {:>14}",
            case.name,
            case.windup_um,
            number(case.w_max_um),
            number(case.q_um),
            number(case.residual_um)
        );
    }
    if let Some(laws) = d.laws() {
        let _ = writeln!(text, "{laws}");
    }
    Ok(report::loops(&d, &loops).and_then(|html| result(&d, text, html)))
}
