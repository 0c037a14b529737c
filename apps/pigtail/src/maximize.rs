//! `pigtail maximize`.

use crate::common::{Common, spaced, write_table};
use crate::progress::Busy;
use crate::running::{self, stopped};
use crate::{DONE, Failure};
use clap::Args;
use pigtail_control::recipe::Climb;
use pigtail_evaluate::maximize::{Asked, MaximizationDocument, Measured, maximize};
use pigtail_hal::quantity::{Dimension, LENGTH, Sign, TIME};
use pigtail_report as report;
use pigtail_session::calibrations::Part;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_store::samples::Samples;
use std::io::{self, Write};

/// Measure light throughput maximization: how well a fiber stays at its peak (thesis 3.3)
///
/// Brings the input and the first output's fiber to their peaks and then moves something: the device,
/// which drifts ever faster until the climb loses it (a step a pattern, 2.5 um/s with the thesis's
/// parameters); the macro; the piezos, which creep after a long way. Beside the nine-point climb stand
/// the fast procedure's circles and a micro at rest. Offsets are the truth, from the twin.
///
/// And the way in z with the peak walking aside, and the times of 3.4 by both procedures.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail maximize
  pigtail maximize --step '0.3 um' --dwell '8 ms' --json")]
pub(crate) struct Arguments {
    #[command(flatten)]
    common: Common,
    /// A recipe file, or the name of one below `recipes`
    #[arg(long, default_value = DEFAULT_RECIPE_NAME)]
    recipe: String,
    /// Distance of the nine points
    #[arg(long, default_value = "0.1 um", value_parser = quantity(LENGTH, Sign::Positive, 2e-6))]
    step: f64,
    /// Time at each point
    #[arg(long, default_value = "4 ms", value_parser = quantity(TIME, Sign::Positive, 0.1))]
    dwell: f64,
    /// Time between patterns
    #[arg(long, default_value = "4 ms", value_parser = quantity(TIME, Sign::NonNegative, 1.0))]
    pause: f64,
    /// Devices over which times are averaged
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    devices: u64,
    /// Record the exchanges with every machine, some 0.8 GB, so that the trials can be replayed
    #[arg(long)]
    record: bool,
}

/// A parser of quantities up to some SI value.
fn quantity(
    dimension: Dimension,
    sign: Sign,
    most: f64,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let value = dimension.parse(&spaced(text), sign)?;
        if value > most {
            let (unit, factor) = dimension.units[dimension.units.len() - 2];
            return Err(format!(
                "\"{text}\" is too much for a climb; accepted is at most {} {unit}",
                most / factor
            ));
        }
        Ok(value)
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let common = &arguments.common;
    let mut setup = common.setup(&arguments.recipe)?;
    let asked = Asked {
        climb: Climb {
            step: arguments.step,
            dwell: arguments.dwell,
            pause: arguments.pause,
            ..setup.rig.recipe.climb
        },
        seed: common.seed,
        devices: arguments.devices,
    };
    running::warn(&setup, Part::ALIGNMENT);
    let run = running::begin(
        &mut setup,
        &common.runs,
        "maximize",
        common.seed,
        arguments.record,
    )?;
    let busy = Busy::new("maximize", "following peaks that drift");
    let measured = maximize(&setup, &asked);
    drop(busy);
    let mut measured = measured.map_err(|ended| stopped(&run, &setup, ended))?;
    measured.document.report = run.path("report.html").display().to_string();
    running::close_records(&run, &setup)?;
    let on = running::on(&setup, &measured.document, None);
    run.write_json("summary.json", &on)?;
    run.write("report.html", report::maximize(&measured)?)?;
    samples(&measured).keep(&run)?;
    run.finish("done")?;
    let mut text = Vec::new();
    if common.json {
        serde_json::to_writer(&mut text, &on).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        print(&mut text, &measured.document).map_err(anyhow::Error::from)?;
        text.extend(running::line(&setup).bytes());
    }
    crate::print(&text)?;
    Ok(DONE)
}

/// Light over time while the peak drifts, in columns.
fn samples(measured: &Measured) -> Samples {
    measured
        .curves
        .iter()
        .fold(Samples::default(), |all, (speed, light)| {
            let name = |what: &str| format!("{what}_at_{}", speed.replace([' ', '/'], "_"));
            let of = |which: fn(&(f64, f64)) -> f64| light.iter().map(which).collect();
            let about = format!("since the peak began to drift at {speed}");
            all.with(&name("time_s"), &about, of(|point| point.0)).with(
                &name("light_percent"),
                "light, of that before",
                of(|point| point.1),
            )
        })
}

fn print(out: &mut impl Write, document: &MaximizationDocument) -> io::Result<()> {
    for table in report::maximize_tables(document) {
        writeln!(out, "{}", table.title)?;
        write_table(out, &table.rows)?;
        writeln!(out)?;
    }
    if let Some(a) = document.approach {
        writeln!(
            out,
            "While the gap closed by {:.1} um the peak walked {:.2} um aside ({:.2} by design), at \
             {:.2} um/s, the climb with it.",
            a.way_um, a.walk_um, a.expected_um, a.walk_um_s
        )?;
    }
    writeln!(
        out,
        "Offsets are the truth, from the twin of seed {}; times are means over {} devices.",
        document.seed, document.devices
    )?;
    writeln!(out, "Report: {}", document.report)
}
