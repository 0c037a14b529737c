//! `pigtail characterize`.

use crate::common::{Common, OwnAxes, in_unit, write_table};
use crate::found::{self, WriteArguments};
use crate::progress::Busy;
use crate::running::{self, stopped};
use crate::way::{Way, way};
use crate::{DONE, Failure};
use clap::{Args, ValueEnum};
use pigtail_control::characterize::Trace;
use pigtail_control::station::Unobserved;
use pigtail_evaluate::impulse::contest::{ShapesDocument, contest};
use pigtail_evaluate::impulse::response::{self, Form, MACHINES, response};
use pigtail_evaluate::impulse::shapes::{Effort, Study};
use pigtail_evaluate::loops::windup;
use pigtail_hal::quantity::{FREQUENCY, Sign, TIME};
use pigtail_hal::{Axis, AxisName, Error};
use pigtail_report as report;
use pigtail_session::calibrations::Change;
use pigtail_session::characterize::{Frequency, Resolution, Sine, Step, metres_per_count};
use pigtail_session::impulse::kind_of;
use pigtail_session::job::Ended;
use pigtail_session::own::Own;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_session::setup::Setup;
use pigtail_session::tune::step_of;
use pigtail_store::runs::Run;
use pigtail_store::samples::Samples;
use serde::Serialize;
use std::fmt::Write as _;

/// Measure what an axis can do: step, sine, resolution, frequency response, windup or pulses
///
/// step        rise (10 to 90 %), settling (until the encoder stays within one
///             count), overshoot; by the probe where the load comes to rest,
///             and when it stays within 5 to 0.2 um of there
/// sine        gain and phase at the encoder and at the output
/// resolution  1000 steps in one direction; the step size is raised by a count
///             until at most 1 % of the steps move the output by less than
///             half the mean (thesis 2.5)
/// frequency   gain, phase and coherence up to 300 Hz, from a random
///             reference; of the open loop gain and phase margin and the peak
///             of the sensitivity, with their standard deviations
/// windup      input against output forward and back, on this machine and on
///             the same one with other load friction, preload and law of
///             friction (thesis 2.4.1, 2.4.2)
/// impulse     what pulses of the amplifier move: one of them, the map over
///             both harmonics, the second harmonic that leaves no dead zone,
///             the parabola (4.8), its spread, and how to relax the
///             transmission between pulses (thesis 4.3.1); with --write into
///             the rig's calibration
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
pub(crate) struct Arguments {
    /// fivebar, z, or left.a, left.b, left.z, right.a, right.b, right.z
    axis: AxisName,
    /// What to measure
    #[arg(value_enum)]
    what: What,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    own: OwnAxes,
    /// Size of the step, or amplitude of sine or noise: counts, or "81 um" of z, "0.9 deg" of a joint
    #[arg(long, value_parser = way)]
    size: Option<Way>,
    /// Frequency of the sine, hertz; 10 for a five-bar joint, 8 for z
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive))]
    frequency: Option<f64>,
    /// Steps of the resolution test
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(10..=10_000))]
    steps: u32,
    /// With impulse: instead, which pulse would be best at equal peak voltage: the thesis's, more
    /// harmonics, other lengths and other families, each optimised over the whole uncertainty on the
    /// plant as it is written, and what loops make of it on other machines (thesis 4.3.4)
    #[arg(long)]
    shapes: bool,
    /// With impulse: second harmonic of the pulses, in units of the voltage at which the motor breaks away
    /// (fsm), such as `--shapes` finds it; what leaves no dead zone is searched for if not given
    #[arg(long, value_name = "FSM", value_parser = crate::positive)]
    a2: Option<f64>,
    /// The third beside it; 0 if not given
    #[arg(long, value_name = "FSM", requires = "a2", value_parser = harmonic)]
    a3: Option<f64>,
    /// The fourth beside it; 0 if not given
    #[arg(long, value_name = "FSM", requires = "a2", value_parser = harmonic)]
    a4: Option<f64>,
    /// With impulse: length of the pulses, milliseconds; 1 if not given
    #[arg(long, value_name = "MS", value_parser = in_unit(TIME, "ms", Sign::Positive))]
    period_ms: Option<f64>,
    /// With impulse: record the exchanges with every machine, some 0.2 GB, so that they can be replayed; what
    /// works on fewer machines is always recorded
    #[arg(long, conflicts_with = "shapes")]
    record: bool,
    #[command(flatten)]
    write: WriteArguments,
}

/// Parses a harmonic.
fn harmonic(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| format!("\"{text}\" is not a finite number"))
}

/// The longest pulse, milliseconds: beyond, an axis has time to come to rest in it.
const LONGEST_PULSE: f64 = 10.0;

/// What is fixed of the pulses.
fn form(arguments: &Arguments) -> Form {
    let other = |given: Option<f64>| given.unwrap_or(0.0);
    Form {
        fixed: arguments
            .a2
            .map(|a2| [a2, other(arguments.a3), other(arguments.a4)]),
        period: arguments
            .period_ms
            .map_or(Form::THESIS.period, |ms| 1e-3 * ms),
    }
}

/// Options that only pulses have.
fn check_pulses(arguments: &Arguments) -> Result<(), Error> {
    let refuse = |option: &str, message: String| Err(Error::new(option, "", message));
    let own = [
        ("--shapes", arguments.shapes),
        ("--a2", arguments.a2.is_some()),
        ("--period-ms", arguments.period_ms.is_some()),
        ("--write", arguments.write.is_asked()),
    ];
    let mut asked = own.iter().filter(|(_, given)| *given);
    match (asked.next(), asked.next()) {
        (Some((option, _)), _) if arguments.what != What::Impulse => {
            let message = "only pulses have it; accepted is `characterize AXIS impulse`";
            return refuse(option, message.to_owned());
        }
        (Some(("--shapes", _)), Some((option, _))) => {
            let message = "goes without --shapes, which chooses by itself; accepted is one of both";
            return refuse(option, message.to_owned());
        }
        _ => {}
    }
    if let Some(ms) = arguments.period_ms.filter(|ms| *ms > LONGEST_PULSE) {
        let message = format!("{ms} ms is no pulse; accepted is at most {LONGEST_PULSE} ms");
        return refuse("--period-ms", message);
    }
    Ok(())
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
    /// What was measured; none where the experiment has no one record.
    samples: Samples,
}

impl Outcome {
    fn with_samples(self, trace: &Trace) -> Self {
        Self {
            samples: samples(trace),
            ..self
        }
    }
}

/// A record in columns, a row a cycle.
pub(crate) fn samples(trace: &Trace) -> Samples {
    let time = (1..=trace.encoder.len()).map(|k| k as f64 * trace.period);
    let of = |values: &[f64]| values.to_vec();
    Samples::default()
        .with(
            "time_s",
            "from the experiment's begin to the end of the cycle",
            time.collect(),
        )
        .with(
            "reference_counts",
            "where the servo wants the axis",
            of(&trace.reference),
        )
        .with(
            "encoder_counts",
            "motor encoder, from where the experiment began",
            of(&trace.encoder),
        )
        .with("voltage_v", "motor voltage", of(&trace.voltage))
        .with(
            "output_m",
            "output by its probe, from where the experiment began",
            of(&trace.output),
        )
}

fn result(document: &impl Serialize, text: String, html: String) -> anyhow::Result<Outcome> {
    Ok(Outcome {
        json: serde_json::to_string(document)?,
        text,
        html,
        samples: Samples::default(),
    })
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let at = arguments.axis;
    let own = Own::read(&arguments.own.from)?;
    own.concerns(at.axis)?;
    let common = &arguments.common;
    check_pulses(arguments)?;
    if arguments.write.is_asked() && !own.is_empty() {
        let message = "writes into a rig, and an axis of --from is in none; accepted is a rig that has it, such as \
                       `pigtail rig my-rig --from` makes";
        return Err(Error::new("--write", "", message).into());
    }
    arguments.write.check(&common.rig)?;
    let replaced = format!("impulse.{}", kind_of(at));
    let without: &[&str] = match arguments.what {
        // Shapes are compared by loops, which begin with what is believed.
        What::Impulse if !arguments.shapes => &[&replaced],
        _ => &[],
    };
    let mut setup = common.setup_with(DEFAULT_RECIPE_NAME, &own, true, without)?;
    let size = arguments
        .size
        .map(|size| size.counts(&setup.rig, at.axis, "--size", 1))
        .transpose()?;
    if let Some(hertz) = arguments
        .frequency
        .filter(|f| *f > 0.2 * setup.rig.spec.servo.rate)
    {
        let message = format!(
            "{hertz} Hz is too fast for the servo; accepted is at most {} Hz",
            0.2 * setup.rig.spec.servo.rate
        );
        return Err(Error::new("--frequency", "", message).into());
    }
    let (runs, seed) = (&arguments.common.runs, arguments.common.seed);
    let recorded = arguments.what != What::Impulse || arguments.record;
    let kind = format!("characterize {at}");
    let run = running::begin(&mut setup, runs, &kind, seed, recorded)?;
    let busy = Busy::new("characterize", "measuring");
    let done = match arguments.what {
        What::Windup => on_variants(arguments, &setup),
        What::Impulse if arguments.shapes => shapes(arguments, &setup),
        What::Impulse => pulses(arguments, &setup, &run),
        _ => experiment(arguments, size, &setup),
    };
    drop(busy);
    let done = done.map_err(|ended| stopped(&run, &setup, ended))??;
    done.samples.keep(&run)?;
    running::close_records(&run, &setup)?;
    run.write("summary.json", format!("{}\n", done.json))?;
    run.write("report.html", done.html)?;
    let report = run.path("report.html").display().to_string();
    run.finish("done")?;
    let text = if common.json {
        format!("{}\n", done.json)
    } else {
        format!("{}Report: {report}\n{}", done.text, running::line(&setup))
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

type Experiment = Result<anyhow::Result<Outcome>, Ended>;

fn experiment(arguments: &Arguments, size: Option<i64>, setup: &Setup) -> Experiment {
    let (at, seed) = (arguments.axis, arguments.common.seed);
    let usual = step_of(&setup.rig, at.axis);
    let mut text = String::new();
    Ok(match arguments.what {
        // Those that take machines of their own are not asked here.
        What::Windup | What::Impulse => return on_variants(arguments, setup),
        What::Step => return step(arguments, size, setup),
        What::Sine => {
            let hertz = arguments
                .frequency
                .unwrap_or(if at.axis == Axis::Z { 8.0 } else { 10.0 });
            let amplitude = size.unwrap_or(usual / 4) as f64;
            let job = Sine {
                at,
                frequency: hertz,
                amplitude,
            };
            let (d, trace) = setup.run(&job, seed, &mut Unobserved)?;
            let _ = writeln!(
                text,
                "{at}: sine of {hertz} Hz, {amplitude} counts: gain {:.4}, phase {:.2} deg at the \
                 encoder",
                d.encoder_gain, d.encoder_phase_deg
            );
            if let (Some(gain), Some(phase)) = (d.output_gain, d.output_phase_deg) {
                let _ = writeln!(text, "  gain {gain:.4}, phase {phase:.2} deg at the output");
            }
            let scale = metres_per_count(&setup.rig, at.axis).ok();
            report::sine(&d, &trace, scale)
                .and_then(|html| result(&running::on(setup, &d, None), text, html))
                .map(|outcome| outcome.with_samples(&trace))
        }
        What::Resolution => {
            let steps = arguments.steps;
            let rows = setup.run(&Resolution { at, steps }, seed, &mut Unobserved)?;
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
            let most = rows.iter().map(|(_, test)| test.increments.len()).max();
            let numbered = (1..=most.unwrap_or(0)).map(|k| k as f64).collect();
            let numbered = Samples::default().with("step", "its number", numbered);
            let samples = rows.iter().fold(numbered, |samples, (row, test)| {
                let name = format!("increment_of_{}_counts_um", row.counts_per_step);
                let um = test.increments.iter().map(|metres| 1e6 * metres).collect();
                samples.with(&name, "what each step moved the output", um)
            });
            report::resolution(&rows)
                .and_then(|html| result(&documents, text, html))
                .map(|outcome| Outcome { samples, ..outcome })
        }
        What::Frequency => return frequency(arguments, size, setup),
    })
}

/// What a step tells.
fn step(arguments: &Arguments, size: Option<i64>, setup: &Setup) -> Experiment {
    let (at, seed) = (arguments.axis, arguments.common.seed);
    let usual = step_of(&setup.rig, at.axis);
    let mut text = String::new();
    let size = size.unwrap_or(usual);
    let (d, trace) = setup.run(&Step { at, size }, seed, &mut Unobserved)?;
    let _ = writeln!(
        text,
        "{at}: step of {} counts: rise {:.1} ms, settling {:.1} ms, overshoot {:.1} %",
        d.step, d.rise_ms, d.settling_ms, d.overshoot_percent
    );
    if let Some(load) = &d.load {
        let _ = writeln!(
            text,
            "  load at rest at {:.3} um, where {:.3} um is the step without windup",
            load.rest_um, load.wanted_um
        );
        let settled = load.settling.iter().map(|row| {
            let after = row
                .settling_ms
                .map_or_else(|| "-".to_owned(), |ms| format!("{ms:.1} ms"));
            format!("{} um: {after}", row.band_um)
        });
        let settled: Vec<_> = settled.collect();
        let _ = writeln!(text, "  load settles within +- {}", settled.join(", "));
    }
    Ok(report::step(&d, &trace)
        .and_then(|html| result(&running::on(setup, &d, None), text, html))
        .map(|outcome| outcome.with_samples(&trace)))
}

/// What a random reference tells.
fn frequency(arguments: &Arguments, size: Option<i64>, setup: &Setup) -> Experiment {
    let (at, seed) = (arguments.axis, arguments.common.seed);
    let usual = step_of(&setup.rig, at.axis);
    let mut text = String::new();
    let amplitude = size.unwrap_or(usual / 20) as f64;
    let job = Frequency {
        at,
        amplitude,
        seed,
    };
    let (d, responses, trace) = setup.run(&job, seed, &mut Unobserved)?;
    let hertz = |f: Option<f64>| f.map_or_else(|| "-".to_owned(), |f| format!("{f:.1} Hz"));
    let _ = writeln!(
        text,
        "{at}: bandwidth (-3 dB) {} at the encoder, {} at the output; coherence at least {:.3}{}",
        hertz(d.bandwidth_hz),
        hertz(d.output_bandwidth_hz),
        d.lowest_coherence,
        d.output_lowest_coherence
            .map_or_else(String::new, |c| format!(" and {c:.3}"))
    );
    for line in report::margins(&d.open_loop) {
        let _ = writeln!(text, "  {line}");
    }
    Ok(report::frequency(&d, &responses)
        .and_then(|html| result(&running::on(setup, &d, None), text, html))
        .map(|outcome| outcome.with_samples(&trace)))
}

/// What pulses do.
fn pulses(arguments: &Arguments, setup: &Setup, run: &Run) -> Experiment {
    let at = arguments.axis;
    let (d, figures, found) =
        response(setup, at, &form(arguments), MACHINES, arguments.common.seed)?;
    let origin = format!("characterize {at} impulse, run {}", run.name());
    let change = Change {
        table: format!("impulse.{}", kind_of(at)),
        values: found.table(&run.date(), &origin),
        weights: None,
    };
    let what = format!("characterize {at} impulse");
    let (write, common) = (arguments.write, &arguments.common);
    let kept = match found::keep(write, run, common, setup, &what, &[change]) {
        Ok(kept) => kept,
        Err(failure) => return Ok(Err(failure.into())),
    };
    let harmonics = arguments.a2.map_or_else(
        || format!("no dead zone from a2 = {:.2} fsm on", d.a2_fsm),
        |_| {
            let [a2, a3, a4] = [d.a2_fsm, d.a3_fsm, d.a4_fsm];
            let dead = d.dead_zone_fsm;
            format!("dead zone {dead:.2} fsm with a2, a3, a4 = {a2:.2}, {a3:.2}, {a4:.2} fsm")
        },
    );
    let mut text = format!(
        "{}: breaks away at {:.4} V (1 fsm); transmission relaxed by: {}\n  {harmonics}; b = {:.2} nm, R2 = \
         {:.3}; {:.1} nm at a1 = {} fsm, {:.1} to {:.1} nm over machines that differ (p10, p90)\n",
        d.axis,
        d.fsm_v,
        d.relax,
        d.b_nm,
        d.r2,
        d.displacement_nm.value,
        d.displacement_nm.a1,
        d.spread.p10,
        d.spread.p90
    );
    text += &kept.account();
    Ok(report::response(&d, &figures)
        .and_then(|html| result(&running::on(setup, &d, Some(&kept)), text, html))
        .map(|outcome| Outcome {
            samples: samples_of_pulses(&figures.trace, &found),
            ..outcome
        }))
}

/// A single pulse in truth, and the curve of displacements that was measured, in columns.
fn samples_of_pulses(pulse: &response::Trace, found: &response::Found) -> Samples {
    let (motor, output) = pulse.angles.iter().copied().unzip();
    let (volts, metres) = found.curve.iter().map(|[a, x]| (*a, *x)).unzip();
    Samples::default()
        .with("time_s", "from a pulse's begin", pulse.time.clone())
        .with("voltage_v", "of the pulse", pulse.voltage.clone())
        .with("motor_rad", "behind the gear: the truth", motor)
        .with("load_rad", "the truth", output)
        .with(
            "output_m",
            "displacement of the output: the truth",
            pulse.output.clone(),
        )
        .with("curve_a1_v", "amplitude of the first harmonic", volts)
        .with("curve_output_m", "what it moved the output", metres)
}

/// Loops with each shape.
const LOOPS: u64 = 300;

/// Which pulse would be best.
fn shapes(arguments: &Arguments, setup: &Setup) -> Experiment {
    let (at, seed) = (arguments.axis, arguments.common.seed);
    let (d, study) = contest(setup, at, seed, &Effort::FULL, LOOPS)?;
    let mut text = format!(
        "{}: pulses that peak at {:.2} fsm, at {:.0}, {:.0} and {:.0} nm, on the plant as it is written \
         with friction and state at rest drawn; loops of {:.0} nm on {} machines\n",
        d.axis, d.peak_fsm, d.at_nm[0], d.at_nm[1], d.at_nm[2], d.target_nm, d.runs
    )
    .into_bytes();
    Ok(write_table(&mut text, &shapes_table(&d))
        .map_err(anyhow::Error::from)
        .and_then(|()| {
            let html = report::shapes(&d, &study)?;
            result(
                &running::on(setup, &d, None),
                String::from_utf8(text)?,
                html,
            )
        })
        .map(|outcome| Outcome {
            samples: samples_of_shapes(&study),
            ..outcome
        }))
}

/// Every shape at the displacement at which they are compared.
fn samples_of_shapes(study: &Study) -> Samples {
    study.shapes.iter().fold(Samples::default(), |all, shape| {
        let (time, volts) = shape.played(200).unzip();
        let name = shape.name.replace(' ', "_");
        all.with(&format!("{name}_time_s"), "from the pulse's begin", time)
            .with(&format!("{name}_V"), "of the nominal joint's motor", volts)
    })
}

fn shapes_table(d: &ShapesDocument) -> Vec<Vec<String>> {
    let header = [
        "shape",
        "a2\nfsm",
        "a3\nfsm",
        "a4\nfsm",
        "T\nms",
        "spread\n%",
        "dead zone\nfsm",
        "least\nnm",
        "vibration\nnm",
        "at rest\nms",
        "reach\nnm",
        "fixed\n%",
        "learnt\n%",
        "pulses\np90",
        "settled p90\ns",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    for s in &d.shapes {
        let numbers = [
            (s.a2_fsm, 2),
            (s.a3_fsm, 2),
            (s.a4_fsm, 2),
            (s.period_ms, 2),
            (s.spread_percent, 1),
            (s.dead_zone_fsm, 2),
            (s.least_nm, 1),
            (s.vibration_nm, 1),
            (s.rest_ms, 1),
            (s.reach_nm, 0),
        ];
        let mut row = vec![s.shape.to_owned()];
        row.extend(numbers.map(|(value, digits)| format!("{value:.digits$}")));
        row.extend(s.loops.map_or(["-"; 4].map(str::to_owned), |l| {
            [
                format!("{:.1}", l.fixed_within_percent),
                format!("{:.1}", l.within_tolerance_percent),
                format!("{:.0}", l.pulses_p90),
                l.settled_p90_s
                    .map_or_else(|| "-".to_owned(), |s| format!("{s:.2}")),
            ]
        }));
        rows.push(row);
    }
    rows
}

/// Windup on machines that differ.
fn on_variants(arguments: &Arguments, setup: &Setup) -> Experiment {
    let (d, loops) = windup(setup, arguments.axis, arguments.common.seed)?;
    let mut text = format!(
        "{}: windup over {:.0} um, forward and back\n",
        d.axis, d.range_um
    );
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    let header = [
        "machine",
        "windup\num",
        "W_max\num",
        "Q\num",
        "(2.20) leaves\num",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    rows.extend(d.cases.iter().map(|case| {
        vec![
            case.name.clone(),
            number(Some(case.windup_um)),
            number(case.w_max_um),
            number(case.q_um),
            number(case.residual_um),
        ]
    }));
    text += &report::text::table(&rows, report::text::room());
    if let Some(laws) = d.laws() {
        let _ = writeln!(text, "{laws}");
    }
    let longest = loops.iter().max_by_key(|of| of.record.input.len());
    let time = longest.map_or_else(Vec::new, |of| of.record.time());
    let timed = Samples::default().with("time_s", "from the scan's begin", time);
    let samples = loops.iter().fold(timed, |samples, of| {
        let name = of.case.name.replace(' ', "_");
        let um = |radians: &[f64]| radians.iter().map(|r| r * of.um_per_radian).collect();
        samples
            .with(
                &format!("input_um_{name}"),
                "motor, in micrometres of the output",
                um(&of.record.input),
            )
            .with(
                &format!("output_um_{name}"),
                "output by its probe",
                um(&of.record.output),
            )
    });
    Ok(report::loops(&d, &loops)
        .and_then(|html| result(&running::on(setup, &d, None), text, html))
        .map(|outcome| Outcome { samples, ..outcome }))
}
