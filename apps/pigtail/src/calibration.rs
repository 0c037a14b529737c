//! `pigtail calibration`.

use crate::common::write_table;
use crate::found::{account, changed};
use crate::{DONE, Failure};
use clap::{Args, Subcommand};
use pigtail_session::calibrations::{
    About, Belief, Difference, Listed, SHORT, TableRow, Versions, differences, find, rows,
};
use pigtail_session::rig::{DEFAULT_RIG_NAME, Named, belief};
use pigtail_store::runs::now;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;

/// List, show, compare, take and take back the versions of a rig's calibration
///
/// Whatever is written into a rig becomes a version of its calibration, below `calibrations` in the rig's folder: with
/// date, command, run, and the SHA-256 of each of its files. Versions are never changed, and no number is given
/// twice. A `calibration.toml` that was edited by hand is kept as a version of its own before another takes its place.
/// The rig that ships is never written to.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail calibration list --rig my-rig
  pigtail calibration show 3 --rig my-rig
  pigtail calibration diff 2 --rig my-rig          version 2 and what is believed now
  pigtail calibration apply runs/20260101T120000-tune-0 --rig my-rig
  pigtail calibration rollback 2 --rig my-rig")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
    /// A folder with the files of a rig, or the name of one below `rigs`
    #[arg(long, default_value = DEFAULT_RIG_NAME, global = true)]
    rig: String,
    /// Print JSON instead of text
    #[arg(long, global = true)]
    json: bool,
    /// The folder of runs
    #[arg(long, value_name = "FOLDER", default_value = "runs", global = true)]
    runs: PathBuf,
}

#[derive(Debug, Subcommand)]
enum What {
    /// List the versions: number, date, origin, tables that changed, hash, and which is current
    List,
    Show(ShowArguments),
    Diff(DiffArguments),
    Apply(ApplyArguments),
    Rollback(RollbackArguments),
}

/// Show a calibration as a person reads it: each table with date, origin and keys
///
/// Numbers are rounded to four digits, and long arrays are summed up; --toml prints the file as it is.
#[derive(Debug, Args)]
struct ShowArguments {
    /// The number of a version, a run, or a file; what the rig believes now if not given
    #[arg(value_name = "VERSION|RUN|FILE")]
    calibration: Option<String>,
    /// Print the file itself
    #[arg(long, conflicts_with = "json")]
    toml: bool,
}

/// Show the keys in which two calibrations differ
#[derive(Debug, Args)]
struct DiffArguments {
    /// The number of a version, a run, or a file
    #[arg(value_name = "A")]
    from: String,
    /// Another; what the rig believes now if not given
    #[arg(value_name = "B")]
    to: Option<String>,
}

/// Take what a run found, or a whole calibration, into the rig as a new version
///
/// Of a run only the tables are taken that it found: what else the rig has learnt since stays.
#[derive(Debug, Args)]
struct ApplyArguments {
    /// A run, the number of a version, or a file
    #[arg(value_name = "RUN|VERSION|FILE")]
    calibration: String,
}

/// Make an old version current again, as a new one: nothing gets lost
#[derive(Debug, Args)]
struct RollbackArguments {
    /// The number of the version
    version: u32,
}

/// What `calibration list` prints as JSON. Keys are a contract.
#[derive(Serialize)]
struct ListDocument<'a> {
    rig: &'a str,
    /// The version that the rig believes; `null` where its calibration is none of them.
    current: Option<u32>,
    /// SHA-256 of the rig's calibration.
    sha256: String,
    versions: Vec<Listed>,
}

/// What `calibration show` prints as JSON. Keys are a contract.
#[derive(Serialize)]
struct ShowDocument {
    /// The file.
    file: String,
    /// What is said of it, where it is a version or was found by a run.
    about: Option<About>,
    tables: Vec<TableRow>,
}

/// What `calibration diff` prints as JSON. Keys are a contract.
#[derive(Serialize)]
struct DiffDocument {
    from: String,
    to: String,
    differences: Vec<Difference>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let text = match &arguments.what {
        What::List => list(arguments)?,
        What::Show(of) => show(arguments, of)?,
        What::Diff(of) => diff(arguments, of)?,
        What::Apply(of) => {
            let versions = Versions::writable(&arguments.rig)?;
            let found = find(&arguments.rig, &of.calibration, &arguments.runs)?;
            let written = versions.apply(&found, &now())?;
            told(arguments.json, &written, || account(&written))?
        }
        What::Rollback(of) => {
            let versions = Versions::writable(&arguments.rig)?;
            let written = versions.rollback(of.version, &now())?;
            told(arguments.json, &written, || account(&written))?
        }
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

/// A document as JSON or in words.
fn told(
    json: bool,
    document: &impl Serialize,
    words: impl FnOnce() -> String,
) -> anyhow::Result<String> {
    Ok(if json {
        serde_json::to_string(document)? + "\n"
    } else {
        words()
    })
}

/// A calibration by its name, or what the rig believes now.
fn named(arguments: &Arguments, name: Option<&str>) -> Result<(Belief, Option<About>), Failure> {
    if let Some(name) = name {
        let found = find(&arguments.rig, name, &arguments.runs)?;
        return Ok((found.belief, found.about));
    }
    let rig = Named {
        rig: &arguments.rig,
        ..Named::default()
    };
    Ok((belief(&rig)?, None))
}

fn list(arguments: &Arguments) -> Result<String, Failure> {
    let versions = Versions::of(&arguments.rig)?;
    let now = versions.current()?;
    let document = ListDocument {
        rig: &arguments.rig,
        current: versions.number_of(&now),
        sha256: pigtail_hal::digest::hash(&now.text),
        versions: versions.list()?,
    };
    let text = told(arguments.json, &document, || {
        if document.versions.is_empty() {
            return format!(
                "{} has no versions yet: nothing has been written into it\n",
                arguments.rig
            );
        }
        let header = ["version", "date", "origin", "run", "tables", "sha", ""];
        let mut rows = vec![header.map(str::to_owned).to_vec()];
        rows.extend(document.versions.iter().map(|listed| {
            let about = &listed.about;
            let state = match (&listed.damage, listed.current) {
                (Some(_), _) => "damaged",
                (None, true) => "current",
                (None, false) => "",
            };
            vec![
                about
                    .version
                    .map_or_else(|| "-".to_owned(), |v| v.to_string()),
                about
                    .date
                    .get(..16)
                    .unwrap_or(&about.date)
                    .replace('T', " "),
                about.origin.clone(),
                about.run.clone().unwrap_or_else(|| "-".to_owned()),
                summed_up(&about.tables),
                listed.sha256.get(..SHORT).unwrap_or_default().to_owned(),
                state.to_owned(),
            ]
        }));
        let mut text = Vec::new();
        // To memory it cannot fail.
        let _ = write_table(&mut text, &rows);
        let mut text = String::from_utf8_lossy(&text).into_owned();
        for damage in document.versions.iter().filter_map(|v| v.damage.as_ref()) {
            let _ = writeln!(text, "{damage}");
        }
        if document.current.is_none() {
            text += "The rig's calibration was changed by hand since; what is written next keeps it as a version first.\n";
        }
        text
    })?;
    Ok(text)
}

/// Tables in a few words.
fn summed_up(tables: &[String]) -> String {
    match tables {
        [] => "-".to_owned(),
        [one] => one.clone(),
        [first, rest @ ..] => format!("{first} and {} more", rest.len()),
    }
}

fn show(arguments: &Arguments, of: &ShowArguments) -> Result<String, Failure> {
    let (belief, about) = named(arguments, of.calibration.as_deref())?;
    if of.toml {
        return Ok(belief.text);
    }
    let document = ShowDocument {
        file: belief.name.clone(),
        tables: rows(&belief)?,
        about,
    };
    let text = told(arguments.json, &document, || {
        let mut text = format!("{}\n", document.file);
        if let Some(about) = &document.about {
            let run = about.run.as_ref();
            let run = run.map_or_else(String::new, |run| format!(", run {run}"));
            let _ = writeln!(text, "{}, {}{run}", about.date, about.origin);
        }
        for row in &document.tables {
            let _ = writeln!(text, "\n[{}]", row.table);
            if let Some(date) = &row.date {
                let origin = row.origin.as_deref().unwrap_or("-");
                let _ = writeln!(text, "  {date}, by {origin}");
            }
            for (key, value) in &row.keys {
                let _ = writeln!(text, "  {key} = {value}");
            }
        }
        text
    })?;
    Ok(text)
}

fn diff(arguments: &Arguments, of: &DiffArguments) -> Result<String, Failure> {
    let (from, _) = named(arguments, Some(&of.from))?;
    let (to, _) = named(arguments, of.to.as_deref())?;
    let document = DiffDocument {
        differences: differences(&from, &to)?,
        from: from.name,
        to: to.name,
    };
    let text = told(arguments.json, &document, || {
        if document.differences.is_empty() {
            return format!("{} and {} say the same\n", document.from, document.to);
        }
        let changes = changed(&document.differences);
        format!("{} -> {}\n{changes}", document.from, document.to)
    })?;
    Ok(text)
}
