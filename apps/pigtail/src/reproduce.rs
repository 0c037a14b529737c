//! `pigtail reproduce`.

use crate::common::Common;
use crate::running::stopped;
use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pigtail_report as report;
use pigtail_reproduce::{Bench, ReproductionDocument, experiments, reproduce, select};
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_session::setup::Setup;
use pigtail_store::runs::Run;
use std::fmt::Write as _;
use std::time::Duration;

/// Run the experiments of the thesis on the twin, each result beside the printed one
///
/// Every figure with data and every number in the text of *Coordinated Control of Two Macro/Micro
/// Manipulators for Fiber Pigtailling Automation*, through the same control code as a real run. The
/// seed draws device, fixture and noise. What the thesis simulated is simulated with its model, the rig's
/// plant; what it measured is measured on the machine, which departs from the model where the rig's
/// measured.toml says so: the one in the middle of its make, unless a specimen is asked for. How near a
/// result must come goes by the kind of its claim. A report goes into a folder below `runs`, with the thesis's slips
/// as a section of their own.
///
/// The exit code is 1 where a claim does not hold for a reason that is not known. Those whose reason was
/// found stay in the list, and say it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail reproduce                 everything, about a minute on two cores
  pigtail reproduce --quick         with fewer steps, devices and runs
  pigtail reproduce 2.8 4.20        some figures
  pigtail reproduce 3 --seed 7      a chapter, with another device
  pigtail reproduce 2 --specimen    a chapter, on a machine that the seed draws
  pigtail reproduce budget          the times of 3.4")]
pub(crate) struct Arguments {
    /// Chapters (2, 3, 4), figures (2.8), or `budget`; everything where none is named
    #[arg(value_name = "CHAPTER|FIGURE")]
    names: Vec<String>,
    #[command(flatten)]
    common: Common,
    /// Take fewer steps, devices and runs
    #[arg(long)]
    quick: bool,
    /// Let the seed draw the machine too, instead of the thesis's own
    #[arg(long)]
    specimen: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let common = &arguments.common;
    let selected = select(&arguments.names)?;
    let setup = Setup::load(&common.rig, DEFAULT_RECIPE_NAME)?;
    let bench = Bench::new(setup, common.seed, arguments.quick, arguments.specimen)?;
    let run = Run::begin(
        &common.runs,
        "reproduce",
        common.seed,
        &bench.machine.rig.hashes,
    )?;
    let steps = experiments()
        .filter(|e| e.figures.iter().any(|id| selected.contains(id)))
        .count();
    let bar = ProgressBar::new(steps as u64);
    if let Ok(style) = ProgressStyle::with_template("reproduce [{bar:20}] {pos}/{len} {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    let made = reproduce(&bench, &selected, &|figures| {
        bar.set_message(figures.join(", "));
        bar.inc(1);
    });
    bar.finish_and_clear();
    let made = made.map_err(|ended| stopped(&run, &bench.machine, ended))?;
    run.write_json("summary.json", &made.document)?;
    run.write("report.html", report::thesis(&made)?)?;
    let report = run.path("report.html").display().to_string();
    run.finish(&format!(
        "{} of {} claims hold",
        made.document.held, made.document.of
    ))?;
    let text = if common.json {
        let json = serde_json::to_string(&made.document).map_err(anyhow::Error::from)?;
        format!("{json}\n")
    } else {
        format!("{}Report: {report}\n", account(&made.document))
    };
    crate::print(text.as_bytes())?;
    Ok(if made.document.is_as_known() {
        DONE
    } else {
        NEGATIVE
    })
}

/// What a person wants to know of it.
fn account(d: &ReproductionDocument) -> String {
    let mut text = String::new();
    let number = |value: f64| format!("{value}");
    for claim in &d.claims {
        let mark = if claim.holds {
            "holds"
        } else if claim.explained {
            "FAILS, explained"
        } else {
            "FAILS"
        };
        let ours = claim.ours.map_or_else(|| "-".to_owned(), number);
        let sign = match claim.kind {
            "below" => "< ",
            "above" => "> ",
            _ => "",
        };
        let _ = writeln!(
            text,
            "{:24} {:>9} {:>10} {:6} {mark}",
            claim.id,
            format!("{sign}{}", claim.thesis),
            ours,
            claim.unit
        );
    }
    for claim in d.claims.iter().filter(|c| !c.holds) {
        let _ = writeln!(
            text,
            "\n{}: {} ({})\n  {}",
            claim.id, claim.quantity, claim.tolerance, claim.note
        );
    }
    let _ = writeln!(
        text,
        "\n{} of {} claims hold; {} of the {} by which nothing of the plant was chosen ({:.0} s)",
        d.held, d.of, d.predicted, d.of_predicted, d.seconds
    );
    text
}
