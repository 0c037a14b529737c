//! What an experiment found out about its rig: kept with its run, and written into the rig where that is asked for.

use crate::Failure;
use crate::common::Common;
use crate::running::stopped;
use clap::Args;
use pigtail_hal::Error;
use pigtail_session::calibrations::{
    ABOUT, About, Belief, Change, Difference, FILE, Origin, Versions, Written, differences, is_own,
};
use pigtail_session::rig::{Named, belief};
use pigtail_session::setup::Setup;
use pigtail_store::runs::{Run, now};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;

/// Whether to write into the rig.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct WriteArguments {
    /// Write what is found into the rig, as a new version of its calibration. Without it the rig is left as it
    /// is: what is found is kept with the run
    #[arg(long, conflicts_with = "calibration")]
    write: bool,
    /// What is done anyway; for scripts of old
    #[arg(long, hide = true, conflicts_with = "write")]
    dry_run: bool,
}

impl WriteArguments {
    /// That the rig can be written to, if it is to be, before any experiment.
    pub(crate) fn check(self, rig: &str) -> Result<(), Error> {
        if self.write {
            Versions::writable(rig)?;
        }
        Ok(())
    }

    /// Whether it is to be.
    pub(crate) fn is_asked(self) -> bool {
        self.write
    }
}

/// What became of what was found. Keys are a contract.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct FoundDocument {
    /// The tables that were found.
    tables: Vec<String>,
    /// The whole calibration with them, kept with the run.
    file: String,
    /// What changes in the rig's calibration.
    changes: Vec<Difference>,
    /// The version of the rig that it is; `null` where it was not written.
    version: Option<u32>,
    /// The version as which the rig's calibration was kept that was none.
    kept: Option<u32>,
    /// The run's folder, to name it by.
    #[serde(skip)]
    folder: String,
    /// The rig to take it into: one of a person's own.
    #[serde(skip)]
    rig: String,
    /// The rig's file that was written.
    #[serde(skip)]
    written: Option<String>,
}

/// Keeps what a command found with its run, and writes it into the rig if that is asked for.
pub(crate) fn keep(
    write: WriteArguments,
    run: &Run,
    common: &Common,
    setup: &Setup,
    what: &str,
    changes: &[Change],
) -> Result<FoundDocument, Failure> {
    let check = |found: &Belief| {
        let checked = found.check(&setup.rig.spec);
        checked.map_err(|error| stopped(run, setup, error.into()))
    };
    let believing = setup.rig.believing.as_deref();
    let mut found = believed_of(common, believing)?;
    for change in changes {
        found.change(change)?;
    }
    let tables: Vec<_> = changes.iter().map(|change| change.table.clone()).collect();
    let found = (&found, &*tables);
    keep_tables(write, run, common, (what, believing), &check, found)
}

/// The calibration of the rig, or the one that was named in its place.
fn believed_of(common: &Common, believing: Option<&Path>) -> Result<Belief, Error> {
    belief(&Named {
        rig: &common.rig,
        calibration: believing,
        ..Named::default()
    })
}

/// The same of any rig, and of a whole belief, some tables of which were found. `check` whether it is a calibration of the rig. What found
/// it, and the calibration that was named in place of the rig's.
pub(crate) fn keep_tables(
    write: WriteArguments,
    run: &Run,
    common: &Common,
    (what, believing): (&str, Option<&Path>),
    check: &dyn Fn(&Belief) -> Result<(), Failure>,
    (believed, tables): (&Belief, &[String]),
) -> Result<FoundDocument, Failure> {
    let origin = Origin {
        what: what.to_owned(),
        date: now(),
        run: Some(run.name()),
    };
    let before = believed_of(common, believing)?;
    let mut found = before.clone();
    for table in tables {
        found.take(believed, table)?;
    }
    "what was found".clone_into(&mut found.name);
    check(&found)?;
    for (file, text) in found.files() {
        run.write(file, text)?;
    }
    let about = About::of(&found, &origin, tables.to_vec());
    run.write_json(ABOUT, &about)?;
    let mut document = FoundDocument {
        tables: tables.to_vec(),
        file: run.path(FILE).display().to_string(),
        changes: differences(&before, &found)?,
        version: None,
        kept: None,
        folder: run.path("").display().to_string(),
        rig: Some(&common.rig)
            .filter(|rig| is_own(rig))
            .map_or_else(|| "my-rig".to_owned(), Clone::clone),
        written: None,
    };
    if write.write {
        let versions = Versions::writable(&common.rig)?;
        let written = versions.write(&origin, |belief| {
            tables
                .iter()
                .try_for_each(|table| belief.take(believed, table))
        })?;
        for table in &document.tables {
            run.calibrated(Some(&written.file), table)?;
        }
        document.changes = written.changes;
        document.version = Some(written.version);
        document.kept = written.kept;
        document.written = Some(written.file);
    }
    Ok(document)
}

impl FoundDocument {
    /// The rig's file that was written; empty where none was.
    pub(crate) fn written(&self) -> String {
        self.written.clone().unwrap_or_default()
    }

    /// The file that holds it: the rig's if that was written, else the run's.
    pub(crate) fn path(&self) -> &str {
        self.written.as_ref().unwrap_or(&self.file)
    }

    /// What a person wants to know of it.
    pub(crate) fn account(&self) -> String {
        let mut text = match (&self.written, self.version) {
            (Some(file), Some(version)) => written_as(file, version, self.kept),
            _ => format!("Found, and not written into the rig: {}\n", self.file),
        };
        text += &changed(&self.changes);
        if self.version.is_none() {
            let run = self.folder.trim_end_matches('/');
            let _ = writeln!(
                text,
                "To take it: `pigtail calibration apply {run} --rig {}`, or --write with this command; to run on it: \
                 --calibration {run}",
                self.rig
            );
        }
        text
    }
}

fn written_as(file: &str, version: u32, kept: Option<u32>) -> String {
    let before = kept.map_or_else(String::new, |kept| {
        format!("; what was there and was no version is kept as version {kept}")
    });
    format!("Written to {file}, version {version}{before}\n")
}

/// What came of writing, for a person.
pub(crate) fn account(written: &Written) -> String {
    if written.changes.is_empty() {
        return format!(
            "Nothing changes: {} is version {} as it is\n",
            written.file, written.version
        );
    }
    written_as(&written.file, written.version, written.kept) + &changed(&written.changes)
}

/// A line a key that changes; one for a table that comes or goes as a whole.
pub(crate) fn changed(changes: &[Difference]) -> String {
    let mut text = String::new();
    for of_table in changes.chunk_by(|a, b| a.table == b.table) {
        let table = &of_table[0].table;
        if of_table.len() > 1 && of_table.iter().all(|d| d.new.is_none()) {
            let _ = writeln!(text, "  {table}: {} keys are gone", of_table.len());
            continue;
        }
        for Difference { key, old, new, .. } in of_table {
            let told = |value: &Option<String>| value.clone().unwrap_or_else(|| "-".to_owned());
            let _ = writeln!(text, "  {table}.{key}: {} -> {}", told(old), told(new));
        }
    }
    text
}
