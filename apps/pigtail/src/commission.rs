//! `pigtail commission`.

use crate::choice::choice;
use crate::common::{Common, believed, write_table};
use crate::found::{self, FoundDocument, WriteArguments};
use crate::journal::{CommissionHead, CommissionJournal};
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
    CommissionDocument, Plan, StepDocument, StepDone, StepName, Verdict, commission,
    commission_bench,
};
use pigtail_session::fleet::NOMINAL;
use pigtail_session::piezos::PiezoModel;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, Named};
use pigtail_store::rows::{Cell, Column, Kind, Table};
use pigtail_store::runs::Run;
use serde_json::Value;
use std::io::{self, Write};

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
  pigtail commission --seed 7 --resume 20261124T101500-commission-7
                                                   what was interrupted, or failed, and the rest
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
    /// Goes on with a run of this machine that was interrupted, or that had a step which failed: by its name, or its folder. Steps
    /// that passed before the first that did not are taken over
    #[arg(long, value_name = "RUN")]
    resume: Option<String>,
    /// By which model of the piezos' hysteresis the machine is to run from then on
    #[arg(long, value_parser = choice::<PiezoModel>(), default_value = "memory")]
    piezo_model: PiezoModel,
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
    let all = StepName::of_machines();
    arguments.all_are_of("a machine of volts", &all)?;
    let mut setup = common.setup(&arguments.recipe)?;
    setup.piezo_model = arguments.piezo_model;
    let seed = common.seed;
    let head = arguments.head(setup.fleet_name(), &setup.rig.hashes);
    let before = arguments.before(&head)?;
    let run = running::begin(&mut setup, &common.runs, "commission", seed, false)?;
    let mut progress = Progress::begin(&run, &head, &before)?;
    let plan = arguments.plan(&run, &all, before);
    let done = commission(&setup, seed, &plan, &mut Unobserved, |step| {
        progress.tell(step);
    })
    .map_err(|ended| stopped(&run, &setup, ended))?;
    progress.end()?;
    let unfit = |error: Error| stopped(&run, &setup, error.into());
    let check = |belief: &Belief| belief.check(&setup.rig.spec).map_err(unfit);
    let what = ("commission", setup.rig.believing.as_deref());
    let keep = || {
        let found = (&done.belief, &*done.tables);
        found::keep_tables(write, &run, common, what, &check, found)
    };
    let kept = (!done.tables.is_empty()).then(keep).transpose()?;
    let rig = RunsOn::of(&setup.rig);
    let of = (&*setup.rig.hashes, &setup.rig.recipe.accept);
    arguments.tell(&run, &plan, of, done.document, kept.as_ref(), rig)
}

/// The same of a bench that is controlled by position.
fn run_bench(arguments: &Arguments) -> Result<u8, Failure> {
    let (common, write) = (&arguments.common, arguments.write);
    bench::refuse(&[
        ("--fleet", common.fleet != NOMINAL),
        (
            "--piezo-model",
            arguments.piezo_model != PiezoModel::default(),
        ),
    ])?;
    let all = StepName::OF_BENCHES;
    arguments.all_are_of("a bench that is controlled by position", &all)?;
    let calibration = believed(&common.rig, common.calibration.as_deref(), &common.runs)?;
    let mut setup = BenchSetup::load_named(&Named {
        rig: &common.rig,
        recipe: &arguments.recipe,
        calibration: calibration.as_deref(),
        ..Named::default()
    })?;
    let head = arguments.head(NOMINAL, &setup.rig.hashes);
    let before = arguments.before(&head)?;
    let run = Run::begin(&common.runs, "commission", common.seed, &setup.rig.hashes)?;
    setup.options.stop = stop::on_signal()?;
    let mut progress = Progress::begin(&run, &head, &before)?;
    let plan = arguments.plan(&run, &all, before);
    let done = commission_bench(&setup, common.seed, &plan, &mut Unobserved, |step| {
        progress.tell(step);
    });
    let unfit = |error: Error| {
        run.abandon();
        Failure::from(error)
    };
    let done = done.map_err(unfit)?;
    progress.end()?;
    let check = |belief: &Belief| {
        let read = BenchCalibration::parse(&belief.name, &belief.text, &setup.rig.spec);
        read.map(drop).map_err(unfit)
    };
    let what = ("commission", setup.rig.believing.as_deref());
    let keep = || {
        let found = (&done.belief, &*done.tables);
        found::keep_tables(write, &run, common, what, &check, found)
    };
    let kept = (!done.tables.is_empty()).then(keep).transpose()?;
    let rig = RunsOn::of_bench(&setup.rig);
    let of = (&*setup.rig.hashes, &setup.rig.recipe.accept);
    arguments.tell(&run, &plan, of, done.document, kept.as_ref(), rig)
}

impl Arguments {
    /// That all steps that were asked for are among those of this kind of rig.
    fn all_are_of(&self, kind: &str, all: &[StepName]) -> Result<(), Error> {
        let Some(other) = self.steps.iter().find(|step| !all.contains(step)) else {
            return Ok(());
        };
        let names: Vec<&str> = all.iter().map(<&str>::from).collect();
        let message = format!(
            "is {other}, which {kind} has not; accepted is {}",
            names.join(", ")
        );
        Err(Error::new("--steps", "", message))
    }

    /// What has to be the same to go on.
    fn head(&self, fleet: &str, hashes: &[(String, String)]) -> CommissionHead {
        CommissionHead {
            rig: self.common.rig.clone(),
            fleet: fleet.to_owned(),
            seed: self.common.seed,
            devices: self.devices,
            piezo_model: self.piezo_model,
            configuration: hashes.to_vec(),
        }
    }

    /// What the run that is gone on with has done.
    fn before(&self, head: &CommissionHead) -> Result<Vec<StepDone>, Failure> {
        match &self.resume {
            Some(named) => CommissionJournal::resumed(named, &self.common.runs, head),
            None => Ok(Vec::new()),
        }
    }

    fn plan(&self, run: &Run, all: &[StepName], before: Vec<StepDone>) -> Plan {
        Plan {
            devices: self.devices,
            date: run.date(),
            run: run.name(),
            steps: match self.steps.as_slice() {
                [] => all.to_vec(),
                steps => steps.to_vec(),
            },
            before,
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

/// How far it is: on a terminal, and on the disk, from where it is gone on with.
struct Progress {
    bar: ProgressBar,
    journal: CommissionJournal,
    kept: anyhow::Result<()>,
}

impl Progress {
    fn begin(run: &Run, head: &CommissionHead, before: &[StepDone]) -> Result<Self, Failure> {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("commission: {pos} steps done, {msg}") {
            bar.set_style(style);
        }
        Ok(Self {
            bar,
            journal: CommissionJournal::begin(run, head, before)?,
            kept: Ok(()),
        })
    }

    fn tell(&mut self, done: &StepDone) {
        self.bar.inc(1);
        self.bar.set_message(done.step.name.to_string());
        let kept = self.journal.keep(done);
        if self.kept.is_ok() {
            self.kept = kept;
        }
    }

    fn end(self) -> anyhow::Result<()> {
        self.bar.finish_and_clear();
        self.kept
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
                    let texts =
                        [<&str>::from(step.name), of, quantity].map(|text| Cell::Text(Some(text)));
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
            step.name.to_string(),
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
        (false, Some(last)) if last.name != StepName::Acceptance => "Not tried on devices",
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
