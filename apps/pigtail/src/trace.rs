//! `pigtail trace`.

use crate::common::{Common, spaced};
use crate::progress::Busy;
use crate::running::{self, stopped};
use crate::{DONE, Failure};
use clap::{Args, ValueEnum};
use pigtail_control::contour::{Contour, ContourSample};
use pigtail_control::trajectory::Shape;
use pigtail_evaluate::contour::{ContourDocument, Plan, Traced, trace};
use pigtail_hal::quantity::{LENGTH, SPEED, Sign, TORQUE};
use pigtail_hal::{Error, Side};
use pigtail_report as report;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_store::samples::Samples;
use std::fmt::Write as _;

/// Follow a contour with both joints of a five-bar, with and without compensation (thesis 2.4.5)
///
/// Identifies the windup of both joints, then follows the contour without compensation, with the
/// thesis's model and with the one that remembers; and all of it again on the same machine with a
/// preload. Errors are distances between where the endpoint was wanted and where the probes at the
/// joints saw it, but for a displacement of the whole. No calibration is changed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail trace square
  pigtail trace square --coupling \"0.02 N m\"      friction in the bearings between the links
  pigtail trace circle --size \"2 mm\" --speed \"2 mm/s\" --profile s-curve")]
pub(crate) struct Arguments {
    /// What to follow
    #[arg(value_enum)]
    path: PathName,
    #[command(flatten)]
    common: Common,
    /// Whose endpoint
    #[arg(long, value_enum, default_value = "left")]
    side: SideName,
    /// Side of the square, diameter of the circle
    #[arg(long, default_value = "300 um", value_parser = length)]
    size: f64,
    /// Speed along it
    #[arg(long, default_value = "0.2 mm/s", value_parser = speed)]
    speed: f64,
    /// How speed rises and falls
    #[arg(long, value_enum, default_value = "trapezoid")]
    profile: ProfileName,
    /// Friction in each bearing between the links; without it what the rig's plant says
    #[arg(long, value_name = "TORQUE", value_parser = torque)]
    coupling: Option<f64>,
    /// Preload of the second machine, relative to the static friction of the load
    #[arg(long, value_name = "SHARE", default_value_t = 1.2, value_parser = crate::positive)]
    preload: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PathName {
    Square,
    Circle,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SideName {
    Left,
    Right,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ProfileName {
    /// Limited in speed and acceleration
    Trapezoid,
    /// Limited in jerk too
    SCurve,
}

fn length(text: &str) -> Result<f64, String> {
    LENGTH.parse(&spaced(text), Sign::Positive)
}

fn speed(text: &str) -> Result<f64, String> {
    SPEED.parse(&spaced(text), Sign::Positive)
}

fn torque(text: &str) -> Result<f64, String> {
    TORQUE.parse(&spaced(text), Sign::NonNegative)
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let mut setup = arguments.common.setup(DEFAULT_RECIPE_NAME)?;
    let plan = Plan {
        contour: match arguments.path {
            PathName::Square => Contour::Square,
            PathName::Circle => Contour::Circle,
        },
        side: match arguments.side {
            SideName::Left => Side::Left,
            SideName::Right => Side::Right,
        },
        size: arguments.size,
        speed: arguments.speed,
        shape: match arguments.profile {
            ProfileName::Trapezoid => Shape::Trapezoid,
            ProfileName::SCurve => Shape::SCurve,
        },
        coupling: arguments.coupling,
        preload: arguments.preload,
    };
    // Slower would be followed for hours; faster is what the datasheet forbids.
    let slowest = plan.size / 600.0;
    if plan.speed < slowest {
        let message = format!(
            "{} m/s takes longer than half an hour a lap; accepted is at least {slowest:.2e} m/s",
            plan.speed
        );
        return Err(Error::new("--speed", "", message).into());
    }
    let half = 0.5 * setup.rig.spec.five_bar.workspace;
    if 0.5 * plan.size > half {
        let message = format!(
            "{} m around home leaves the workspace; accepted is at most {} m",
            plan.size,
            2.0 * half
        );
        return Err(Error::new("--size", "", message).into());
    }
    // Beyond that the motors cannot hold it: a gear of 80 makes light of friction, not of springs.
    if plan.preload > 5.0 {
        let message = format!("{} is too strong; accepted is at most 5", plan.preload);
        return Err(Error::new("--preload", "", message).into());
    }
    let most = setup.plant.five_bar.joint.load_friction.static_level();
    if plan.coupling.is_some_and(|coupling| coupling > most) {
        let message = format!(
            "{} N m is more than the joints' own friction; accepted is at most {most} N m",
            plan.coupling.unwrap_or_default()
        );
        return Err(Error::new("--coupling", "", message).into());
    }
    let seed = arguments.common.seed;
    let run = running::begin(&mut setup, &arguments.common.runs, "trace", seed, true)?;
    let busy = Busy::new("trace", "identifying windup and following the contour");
    let traced = trace(&setup, &plan, seed);
    drop(busy);
    let (document, traced) = traced.map_err(|error| stopped(&run, &setup, error))?;
    running::close_records(&run, &setup)?;
    let on = running::on(&setup, &document, None);
    run.write_json("summary.json", &on)?;
    run.write("report.html", report::contour(&document, &traced)?)?;
    samples(&traced).keep(&run)?;
    let text = running::told(arguments.common.json, &on, &setup, || {
        let report = run.path("report.html").display().to_string();
        format!("{}Report: {report}\n", account(&document))
    })?;
    run.finish("done")?;
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

/// The last lap of each, in columns.
fn samples(traced: &[Traced]) -> Samples {
    let longest = traced.iter().map(|(_, samples)| samples.len()).max();
    let numbers = (1..=longest.unwrap_or(0)).map(|k| k as f64).collect();
    let numbered = Samples::default().with("cycle", "of the last lap", numbers);
    traced.iter().fold(numbered, |all, (row, samples)| {
        let name = |what: &str| format!("{what}_um_{}_preload_{}", row.compensation, row.preload);
        let um = |of: fn(&ContourSample) -> f64| samples.iter().map(|s| 1e6 * of(s)).collect();
        all.with(&name("wanted_x"), "where it was wanted", um(|s| s.wanted.x))
            .with(&name("wanted_y"), "where it was wanted", um(|s| s.wanted.y))
            .with(
                &name("measured_x"),
                "where the probes saw it",
                um(|s| s.measured.x),
            )
            .with(
                &name("measured_y"),
                "where the probes saw it",
                um(|s| s.measured.y),
            )
    })
}

/// What a person wants to know of it.
fn account(d: &ContourDocument) -> String {
    let mut text = format!(
        "{} of {:.0} um at {:.0} um/s, {} five-bar, {} N m in each bearing between the links\n\
         Distance from where the endpoint was wanted, um:\n  {:12} {:>8} {:>9} {:>8} {:>16}\n",
        d.path,
        d.size_um,
        d.speed_um_s,
        d.side,
        d.coupling_nm,
        "model",
        "preload",
        "greatest",
        "rms",
        "shift in x, y"
    );
    for row in &d.rows {
        let _ = writeln!(
            text,
            "  {:12} {:>8} {:9.2} {:8.2} {:8.2} {:7.2}",
            row.compensation, row.preload, row.max_um, row.rms_um, row.shift_um[0], row.shift_um[1]
        );
    }
    text
}
