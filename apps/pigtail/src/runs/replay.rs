//! `pigtail runs replay`.

use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use pigtail_session::records::{RECORD, records_in};
use pigtail_session::replay::{ReplayDocument, replay};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Run the same control again on what a run recorded, and compare every command
///
/// The machine's answers come from the record; what control says to them must be what it said then, bit
/// for bit. The first difference is named. A record that was cut short, as by a kill, is replayed to its
/// end. A run that worked on several machines has a record of each: all of them are replayed, or the one that
/// is named. Exit codes: 0 the same, 1 a difference, 2 no record that can be read.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail runs replay 20261121T024402-7
  pigtail runs replay runs/20261121T024402-7/exchanges.pigtail --json")]
pub(super) struct Arguments {
    /// Its name, as `pigtail runs list` tells it, its folder, or the record itself
    run: PathBuf,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// The records of a run, wherever it is: one for each machine that it worked on.
pub(super) fn records_of(run: &Path, runs: &Path) -> Vec<PathBuf> {
    if run.is_file() {
        return vec![run.to_owned()];
    }
    let name = run.file_name().unwrap_or_default().to_string_lossy();
    [
        run.to_owned(),
        runs.join(run),
        runs.join(format!(".{name}.partial")),
    ]
    .iter()
    .map(|folder| records_in(folder))
    .find(|records| !records.is_empty())
    // What is not there is an error of whoever reads it.
    .unwrap_or_else(|| vec![runs.join(run).join(RECORD)])
}

/// What a replay of a run prints as JSON that worked on several machines.
#[derive(Serialize)]
struct ReplaysDocument {
    /// Whether all of them are the same.
    same: bool,
    /// Each record.
    records: Vec<ReplayDocument>,
}

pub(super) fn run(arguments: &Arguments, runs: &Path) -> Result<u8, Failure> {
    let records = records_of(&arguments.run, runs);
    let several = records.len() > 1;
    let mut documents = Vec::with_capacity(records.len());
    for record in &records {
        let document = replay(record)?;
        if !arguments.json {
            let name = record.file_name().filter(|_| several);
            let name = name.map_or_else(String::new, |n| format!("{}: ", n.to_string_lossy()));
            crate::print(format!("{name}{}\n", told(&document)).as_bytes())?;
        }
        documents.push(document);
    }
    let same = documents.iter().all(|document| document.same);
    if arguments.json {
        let json = match documents.pop() {
            Some(document) if !several => serde_json::to_string(&document),
            last => {
                documents.extend(last);
                let records = documents;
                serde_json::to_string(&ReplaysDocument { same, records })
            }
        };
        crate::print(format!("{}\n", json.map_err(anyhow::Error::from)?).as_bytes())?;
    }
    Ok(if same { DONE } else { NEGATIVE })
}

/// What came of a replay, in a line.
fn told(document: &ReplayDocument) -> String {
    let said = format!(
        "{} exchanges, {:.3} s of machine time",
        document.exchanges, document.seconds
    );
    let end = if document.cut {
        "; the record ends before its run did"
    } else {
        ""
    };
    match &document.difference {
        Some(difference) => format!("not the same after {said}: {difference}"),
        None if document.left > 0 => format!(
            "not the same: control ends after {said}, and {} more were recorded",
            document.left
        ),
        None => format!("the same commands to the last bit: {said}{end}"),
    }
}
