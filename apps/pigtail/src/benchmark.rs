//! `pigtail benchmark`.

use crate::choice::choice;
use crate::common::{Common, write_table};
use crate::running::{self, stopped};
use crate::{DONE, Failure};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pigtail_evaluate::benchmark::{ALGORITHMS, Algorithm, BenchmarkDocument, run as compare};
use pigtail_report as report;
use pigtail_session::calibrations::Part;
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_session::scenario::Scenario;
use std::io::{self, Write};

/// Compare alignment algorithms on the same devices
///
/// Every algorithm aligns the devices of the same seeds, each on its own drawn machine, with the same
/// guard around it. It sees commands, encoders, photodiodes, vision, datasheet and calibration; the
/// twin's truth decides afterwards. A fiber is right, wrong (said to be aligned, and is not), touched
/// (something hit the chip), stopped by a fault, or lost. Seconds and readings (light samples that it
/// looked at) are those of all devices over the number of right fibers, so that giving up is not
/// cheap. To enter your own: `apps/pigtail/examples/my_algorithm.rs`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail benchmark
  pigtail benchmark --scenario stray --devices 100
  pigtail benchmark --algorithm fast --algorithm thesis --seed 7000 --json")]
pub(crate) struct Arguments {
    #[command(flatten)]
    common: Common,
    /// A recipe file, or the name of one below `recipes`
    #[arg(long, default_value = DEFAULT_RECIPE_NAME)]
    recipe: String,
    /// Devices that each algorithm aligns, of successive seeds
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    devices: u64,
    /// What is wrong with device, fixture or light
    #[arg(long, value_parser = choice::<Scenario>(), default_value = <&str>::from(Scenario::default()))]
    scenario: Scenario,
    /// Only this algorithm; may be given several times
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(
        ALGORITHMS.iter().map(|algorithm| algorithm.name)))]
    algorithm: Vec<String>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let common = &arguments.common;
    let mut setup = common.setup(&arguments.recipe)?;
    arguments.scenario.apply(&mut setup);
    let asked = &arguments.algorithm;
    let algorithms: Vec<Algorithm> = ALGORITHMS
        .iter()
        .filter(|algorithm| asked.is_empty() || asked.iter().any(|name| name == algorithm.name))
        .copied()
        .collect();
    running::warn(&setup, Part::ALIGNMENT);
    let run = running::begin(&mut setup, &common.runs, "benchmark", common.seed, false)?;
    let bar = ProgressBar::new(arguments.devices * algorithms.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("benchmark [{bar:20}] {percent} % {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    let done = |name: &'static str| {
        bar.set_message(name);
        bar.inc(1);
    };
    let mut measured = compare(&setup, &algorithms, common.seed, arguments.devices, &done)
        .map_err(|ended| stopped(&run, &setup, ended))?;
    bar.finish_and_clear();
    measured.document.report = run.path("report.html").display().to_string();
    let on = running::on(&setup, &measured.document, None);
    run.write_json("summary.json", &on)?;
    run.write("report.html", report::benchmark(&measured)?)?;
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

fn print(out: &mut impl Write, document: &BenchmarkDocument) -> io::Result<()> {
    write_table(out, &report::benchmark_table(document))?;
    writeln!(
        out,
        "\n{} devices from seed {}, {} fibers an algorithm, scenario {}. A fiber is right within \
         {} um in x and y\nand {} um in z of the truth. Seconds and readings are all that was spent, \
         over the right fibers.",
        document.devices,
        document.seed,
        document.fibers,
        document.scenario,
        document.tolerance_xy_um,
        document.tolerance_z_um
    )?;
    writeln!(out, "Report: {}", document.report)
}
