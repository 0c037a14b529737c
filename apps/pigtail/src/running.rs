//! A run of a job on a twin: what every command that makes one does before and after.

use crate::found::FoundDocument;
use crate::{Failure, stop};
use anyhow::Result;
use pigtail_session::calibrations::{On, Part, RunsOn, notes};
use pigtail_session::job::Ended;
use pigtail_session::records::Records;
use pigtail_session::samples::Record;
use pigtail_session::setup::Setup;
use pigtail_store::rows::{Cell, Column, Kind, Table};
use pigtail_store::runs::Run;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Begins a run: from now on Ctrl-C stops the machine, and what jobs exchange with it is recorded, if wanted.
pub(crate) fn begin(
    setup: &mut Setup,
    runs: &Path,
    kind: &str,
    seed: u64,
    recorded: bool,
) -> Result<Run, Failure> {
    let run = Run::begin(runs, kind, seed, &setup.rig.hashes)?;
    setup.options.stop = stop::on_signal()?;
    setup.records = recorded.then(|| Arc::new(Records::new(run.partial_path(""))));
    Ok(run)
}

/// Says what is missing or out of date of what is believed of a rig and made use of, before anything runs.
pub(crate) fn warn(setup: &Setup, parts: &[Part]) {
    for note in notes(&setup.rig, parts) {
        crate::say(&format!("note: {note}"));
    }
}

/// A document with what it ran on, as a value to be kept and printed.
pub(crate) fn on<'d>(
    setup: &Setup,
    document: &'d impl Serialize,
    found: Option<&'d FoundDocument>,
) -> impl Serialize + 'd {
    on_rig(RunsOn::of(&setup.rig), document, found)
}

/// The same of any rig.
pub(crate) fn on_rig<'d>(
    rig: RunsOn,
    document: &'d impl Serialize,
    found: Option<&'d FoundDocument>,
) -> impl Serialize + 'd {
    On::with(rig, document, found)
}

/// What a command prints: its document, or words and what it ran on.
pub(crate) fn told(
    json: bool,
    document: &impl Serialize,
    setup: &Setup,
    words: impl FnOnce() -> String,
) -> Result<String> {
    Ok(if json {
        serde_json::to_string(document)? + "\n"
    } else {
        words() + &line(setup)
    })
}

/// What it ran on, in a line.
pub(crate) fn line(setup: &Setup) -> String {
    ran_on(&RunsOn::of(&setup.rig), false)
}

/// The same of a rig; `commissioned` where each machine was measured first, and what was found was believed.
pub(crate) fn ran_on(rig: &RunsOn, commissioned: bool) -> String {
    let first = if commissioned {
        "; each machine was commissioned first, from there on"
    } else {
        ""
    };
    format!("Ran on {rig}{first}\n")
}

/// Keeps the light samples of an alignment as CSV, and the same numbers as Parquet.
pub(crate) fn keep_samples(run: &Run, record: &Record) -> Result<()> {
    let csv = record.csv();
    let mut lines = csv.lines();
    let names = lines.next().unwrap_or_default().split(',');
    let columns: Vec<Column> = names
        .map(|name| match name {
            "fiber" => Column::new(name, Kind::Text, "the port whose fiber is worked on"),
            "phase" => Column::new(name, Kind::Text, "of its alignment"),
            _ => Column::new(name, Kind::Number, ""),
        })
        .collect();
    let columns: Arc<[Column]> = columns.into();
    let mut table = Table::new(&columns);
    for line in lines {
        let cells = line.split(',').zip(columns.iter());
        let cells = cells.map(|(cell, column)| match column.kind() {
            Kind::Text => Cell::Text(Some(cell)),
            _ => Cell::Number(cell.parse().ok()),
        });
        table.add(cells.collect());
    }
    run.write("samples.parquet", table.to_parquet()?)?;
    run.write("samples.csv", csv)
}

/// Waits until all records are on the disk.
pub(crate) fn close_records(run: &Run, setup: &Setup) -> Result<()> {
    if let Some(records) = &setup.records {
        for (file, written) in records.wait()? {
            run.wrote(&file, written.bytes, &written.sha256);
        }
    }
    Ok(())
}

/// What a run that did not come to its end leaves, and what it is to the user: a fault and an honest negative
/// their evidence, bad input nothing.
pub(crate) fn stopped(run: &Run, setup: &Setup, ended: Ended) -> Failure {
    let kept = close_records(run, setup).and_then(|()| match &ended {
        Ended::Fault(fault) => run.fault(fault),
        Ended::Outcome(outcome) => run.finish(outcome.name()),
        Ended::Input(_) | Ended::Unrecorded(_) => {
            run.abandon();
            Ok(())
        }
    });
    if let Err(why) = kept {
        crate::say(&format!(
            "error: what there is of the run stays where it is: {why:#}"
        ));
    }
    ended.into()
}
