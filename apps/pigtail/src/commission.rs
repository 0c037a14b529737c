//! `pigtail commission`.

use crate::choice::choice;
use crate::common::{Common, believed, write_table};
use crate::found::{self, FoundDocument, WriteArguments};
use crate::running::{self, stopped};
use crate::{DONE, Failure, NEGATIVE, bench, stop};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pigtail_control::recipe::Accept;
use pigtail_control::station::Unobserved;
use pigtail_hal::Error;
use pigtail_report as report;
use pigtail_session::bench::{BenchCalibration, BenchSetup, is_bench};
use pigtail_session::calibrations::{Belief, RunsOn};
use pigtail_session::commission::{
    CommissionDocument, Plan, StepDocument, StepName, Verdict, commission, commission_bench,
};
use pigtail_session::fleet::NOMINAL;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, Named};
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
/// On a bench that is controlled by position the steps are axes, dark, groups and acceptance: light tells how its groups
/// lag behind, how far its axes fall short when they turn back, and how wide the spot is.
///
/// What is found is kept with the run, and written into the rig with --write.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail commission --fleet workshop --seed 7     the machine that seed 7 draws of what labs have
  pigtail commission --rig my-rig --write          and believe what is found from now on
  pigtail commission --steps axes,dark             the first two steps alone
  pigtail commission --rig bench-piezo             one that is controlled by position

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
    if is_bench(&common.rig)? {
        return run_bench(arguments);
    }
    arguments.all_are_of("a machine of volts", StepName::is_of_machines)?;
    let mut setup = common.setup(&arguments.recipe)?;
    let seed = common.seed;
    let run = running::begin(&mut setup, &common.runs, "commission", seed, false)?;
    let all = StepName::VARIANTS.iter().copied();
    let plan = arguments.plan(&run, all.filter(|step| step.is_of_machines()));
    let progress = Progress::of(&plan);
    let done = commission(&setup, seed, &plan, &mut Unobserved, |step| {
        progress.tell(step);
    })
    .map_err(|ended| stopped(&run, &setup, ended))?;
    progress.0.finish_and_clear();
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
    let rig = RunsOn::of(&setup.rig);
    let of = (&*setup.rig.hashes, &setup.rig.recipe.accept);
    arguments.tell(&run, &plan, of, done.document, kept.as_ref(), rig)
}

/// The same of a bench that is controlled by position.
fn run_bench(arguments: &Arguments) -> Result<u8, Failure> {
    let (common, write) = (&arguments.common, arguments.write);
    bench::refuse(&[("--fleet", common.fleet != NOMINAL)])?;
    let of_benches = StepName::OF_BENCHES;
    arguments.all_are_of("a bench that is controlled by position", |step| {
        of_benches.contains(&step)
    })?;
    let calibration = believed(&common.rig, common.calibration.as_deref(), &common.runs)?;
    let mut setup = BenchSetup::load_named(&Named {
        rig: &common.rig,
        recipe: &arguments.recipe,
        calibration: calibration.as_deref(),
        ..Named::default()
    })?;
    let run = Run::begin(&common.runs, "commission", common.seed, &setup.rig.hashes)?;
    setup.options.stop = stop::on_signal()?;
    let plan = arguments.plan(&run, of_benches);
    let progress = Progress::of(&plan);
    let done = commission_bench(&setup, common.seed, &plan, &mut Unobserved, |step| {
        progress.tell(step);
    });
    progress.0.finish_and_clear();
    let unfit = |error: Error| {
        run.abandon();
        Failure::from(error)
    };
    let done = done.map_err(unfit)?;
    let spec = &setup.rig.spec;
    let check = |belief: &Belief| {
        let read = BenchCalibration::parse(&belief.name, &belief.text, spec);
        read.map(drop).map_err(unfit)
    };
    let kept = match done.changes.as_slice() {
        [] => None,
        changes => {
            let what = ("commission", setup.rig.believing.as_deref());
            Some(found::keep_checked(
                write, &run, common, what, &check, changes,
            )?)
        }
    };
    let rig = RunsOn::of_bench(&setup.rig);
    let of = (&*setup.rig.hashes, &setup.rig.recipe.accept);
    arguments.tell(&run, &plan, of, done.document, kept.as_ref(), rig)
}

impl Arguments {
    /// That all steps that were asked for are of this kind of rig.
    fn all_are_of(&self, kind: &str, is: impl Fn(StepName) -> bool) -> Result<(), Error> {
        let Some(other) = self.steps.iter().find(|step| !is(**step)) else {
            return Ok(());
        };
        let names = StepName::VARIANTS.iter().filter(|step| is(**step));
        let names: Vec<&str> = names.map(<&str>::from).collect();
        let message = format!(
            "is {}, which {kind} has not; accepted is {}",
            <&str>::from(other),
            names.join(", ")
        );
        Err(Error::new("--steps", "", message))
    }

    fn plan(&self, run: &Run, all: impl IntoIterator<Item = StepName>) -> Plan {
        Plan {
            devices: self.devices,
            date: run.date(),
            run: run.name(),
            steps: match self.steps.as_slice() {
                [] => all.into_iter().collect(),
                steps => steps.to_vec(),
            },
        }
    }

    /// Keeps what was done with its run, and prints it.
    fn tell(
        &self,
        run: &Run,
        plan: &Plan,
        (hashes, accept): (&[(String, String)], &Accept),
        mut document: CommissionDocument,
        kept: Option<&FoundDocument>,
        rig: RunsOn,
    ) -> Result<u8, Failure> {
        let path = kept.map(FoundDocument::path);
        document.calibration = path.map_or_else(String::new, str::to_owned);
        document.report = run.path("report.html").display().to_string();
        let page = report::commission(&document, hashes, accept, plan);
        run.write("report.html", page)?;
        keep_values(run, &document.steps)?;
        let line = running::ran_on(&rig, false);
        let printed = running::on_rig(rig, &document, kept);
        run.write_json("summary.json", &printed)?;
        run.finish(if document.accepted {
            "accepted"
        } else {
            "not accepted"
        })?;
        let text = if self.common.json {
            serde_json::to_string(&printed).map_err(anyhow::Error::from)? + "\n"
        } else {
            let mut words = Vec::new();
            account(&mut words, &document, kept).map_err(anyhow::Error::from)?;
            String::from_utf8_lossy(&words).into_owned() + &line
        };
        crate::print(text.as_bytes())?;
        let passed = |step: &StepDocument| step.verdict == Verdict::Passed;
        Ok(if document.steps.iter().all(passed) {
            DONE
        } else {
            NEGATIVE
        })
    }
}

/// How far it is, on a terminal.
struct Progress(ProgressBar);

impl Progress {
    fn of(plan: &Plan) -> Self {
        let bar = ProgressBar::new(plan.steps.len() as u64);
        if let Ok(style) = ProgressStyle::with_template("commission [{bar:20}] {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self(bar)
    }

    fn tell(&self, step: &StepDocument) {
        self.0.inc(1);
        self.0.set_message(format!("{} done", step.name));
    }
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
