//! `pigtail commission`.

use crate::choice::choice;
use crate::common::{Common, write_table};
use crate::found::{self, FoundDocument, WriteArguments};
use crate::running::{self, stopped};
use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pigtail_control::station::Unobserved;
use pigtail_report as report;
use pigtail_session::commission::{
    CommissionDocument, Plan, StepDocument, StepName, Verdict, commission,
};
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_store::rows::{Cell, Column, Kind, Table};
use pigtail_store::runs::Run;
use serde_json::Value;
use std::io::{self, Write};
use strum::VariantArray;

/// Commission a machine: from its datasheet to a calibration that was tried on devices
///
/// Through encoders, photodiodes, probes and vision alone: whether every axis moves and the right way, the
/// photodiodes in the dark, gains, windup, the piezos; then devices are aligned with what was found. The
/// machine is accepted if every step passes, by what can be measured: the truth is not asked. What no step
/// can know is said.
///
/// What is found is kept with the run, and written into the rig with --write.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail commission --fleet workshop --seed 7     the machine that seed 7 draws of what labs have
  pigtail commission --rig my-rig --write          and believe what is found from now on
  pigtail commission --steps axes,dark             the first two steps alone

Exit codes:
  0  accepted, or the steps that were asked for have passed
  1  not accepted
  2  bad input, explained on standard error")]
pub(crate) struct Arguments {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    write: WriteArguments,
    /// A recipe file, or the name of one below `recipes`: the devices of the acceptance test
    #[arg(long, default_value = DEFAULT_RECIPE_NAME)]
    recipe: String,
    /// The steps to do, with commas between them [default: all]
    #[arg(long, value_name = "STEP,...", value_delimiter = ',', value_parser = choice::<StepName>())]
    steps: Vec<StepName>,
    /// Devices of the acceptance test
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    devices: u64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let (common, write) = (&arguments.common, arguments.write);
    write.check(&common.rig)?;
    let mut setup = common.setup(&arguments.recipe)?;
    let seed = common.seed;
    let run = running::begin(&mut setup, &common.runs, "commission", seed, false)?;
    let steps = match arguments.steps.as_slice() {
        [] => StepName::VARIANTS.to_vec(),
        steps => steps.to_vec(),
    };
    let plan = Plan {
        devices: arguments.devices,
        date: run.date(),
        run: run.name(),
        steps,
    };
    let bar = ProgressBar::new(plan.steps.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("commission [{bar:20}] {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    let told = |step: &StepDocument| {
        bar.inc(1);
        bar.set_message(format!("{} done", step.name));
    };
    let mut done = commission(&setup, seed, &plan, &mut Unobserved, told)
        .map_err(|ended| stopped(&run, &setup, ended))?;
    bar.finish_and_clear();
    let kept = match done.changes.as_slice() {
        [] => None,
        changes => Some(found::keep(
            write,
            &run,
            common,
            &setup,
            "commission",
            changes,
        )?),
    };
    let document = &mut done.document;
    document.calibration = kept
        .as_ref()
        .map_or_else(String::new, |kept| kept.path().to_owned());
    document.report = run.path("report.html").display().to_string();
    run.write("report.html", report::commission(document, &setup, &plan))?;
    keep_values(&run, &document.steps)?;
    let printed = running::on(&setup, &*document, kept.as_ref());
    run.write_json("summary.json", &printed)?;
    let passed = document
        .steps
        .iter()
        .all(|step| step.verdict == Verdict::Passed);
    run.finish(if document.accepted {
        "accepted"
    } else {
        "not accepted"
    })?;
    let mut words = Vec::new();
    account(&mut words, document, kept.as_ref()).map_err(anyhow::Error::from)?;
    let text = running::told(common.json, &printed, &setup, || {
        String::from_utf8_lossy(&words).into_owned()
    })?;
    crate::print(text.as_bytes())?;
    Ok(if passed { DONE } else { NEGATIVE })
}

/// Keeps what was measured, a row for each number, as CSV and as Parquet.
fn keep_values(run: &Run, steps: &[StepDocument]) -> anyhow::Result<()> {
    let columns = [
        Column::new("step", Kind::Text, "of commissioning"),
        Column::new(
            "of",
            Kind::Text,
            "the axis, side or photodiode; empty for all",
        ),
        Column::new("quantity", Kind::Text, "with its unit"),
        Column::new("number", Kind::Number, "of a list, from 0"),
        Column::new("value", Kind::Number, "1 for yes, 0 for no"),
    ];
    let mut table = Table::new(&columns.to_vec().into());
    for step in steps {
        for (of, value) in &step.values {
            let all = Value::Object(std::iter::once((of.clone(), value.clone())).collect());
            let (of, inner) = match value {
                Value::Object(_) => (of.as_str(), value),
                _ => ("", &all),
            };
            for (quantity, value) in inner.as_object().into_iter().flatten() {
                let several = match value {
                    Value::Array(several) => several.as_slice(),
                    value => std::slice::from_ref(value),
                };
                for (k, value) in several.iter().enumerate() {
                    let number = match value {
                        Value::Bool(yes) => Some(f64::from(u8::from(*yes))),
                        value => value.as_f64(),
                    };
                    let texts = [step.name, of, quantity].map(|text| Cell::Text(Some(text)));
                    let numbers = [Some(k as f64), number].map(Cell::Number);
                    table.add(texts.into_iter().chain(numbers).collect());
                }
            }
        }
    }
    run.write("samples.csv", table.to_csv()?)?;
    run.write("samples.parquet", table.to_parquet()?)
}

/// What a person wants to know of it.
fn account(
    out: &mut impl Write,
    document: &CommissionDocument,
    kept: Option<&FoundDocument>,
) -> io::Result<()> {
    let header = ["step", "verdict", "s"].map(str::to_owned).to_vec();
    let rows = document.steps.iter().map(|step| {
        let verdict = match step.verdict {
            Verdict::Passed => "passed",
            Verdict::Failed => "failed",
        };
        vec![
            step.name.to_owned(),
            verdict.to_owned(),
            format!("{:.1}", step.seconds),
        ]
    });
    write_table(
        out,
        &std::iter::once(header).chain(rows).collect::<Vec<_>>(),
    )?;
    for step in document.steps.iter().filter(|step| !step.why.is_empty()) {
        writeln!(out, "{}: {}", step.name, step.why)?;
    }
    let verdict = match (document.accepted, document.steps.last()) {
        (true, _) => "Accepted",
        (false, Some(last)) if last.name != <&str>::from(StepName::Acceptance) => {
            "Not tried on devices"
        }
        _ => "Not accepted",
    };
    writeln!(
        out,
        "\n{verdict}, after {:.0} s of machine time.",
        document.seconds_machine
    )?;
    for unknown in &document.unknown {
        writeln!(out, "Not known: {unknown}.")?;
    }
    if let Some(kept) = kept {
        write!(out, "{}", kept.account())?;
    }
    writeln!(out, "Report: {}", document.report)
}
