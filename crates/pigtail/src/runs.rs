//! The folder of a run: complete or not there.

use crate::align::Document;
use crate::record::Record;
use crate::report;
use crate::rig::Setup;
use anyhow::{Context, Result};
use serde::Serialize;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// What `run.json` says of where a run came from.
#[derive(Debug, Serialize)]
struct Origin<'a> {
    version: &'a str,
    started: String,
    command: Vec<String>,
    seed: u64,
    /// File name and SHA-256 of every configuration that was read.
    configuration: Vec<Configuration<'a>>,
}

#[derive(Debug, Serialize)]
struct Configuration<'a> {
    file: &'a str,
    sha256: &'a str,
}

/// Makes sure that a run can be written below `runs` before a machine moves.
///
/// # Errors
///
/// When the folder cannot be made or written.
pub fn prepare(runs: &Path) -> Result<()> {
    let probe = runs.join(".writable");
    fs::create_dir_all(runs)
        .and_then(|()| File::create(&probe))
        .and_then(|_| fs::remove_file(&probe))
        .with_context(|| {
            format!(
                "{}: no run can be written here; accepted is a writable folder",
                runs.display()
            )
        })
}

/// Writes a run below `runs` and returns its report's path. The run's folder appears whole: it
/// is written beside its place and then moved.
///
/// # Errors
///
/// When something cannot be written. What was written is removed.
pub fn write(
    runs: &Path,
    setup: &Setup,
    document: &mut Document,
    record: &Record,
    started: &jiff::Zoned,
) -> Result<PathBuf> {
    let stem = format!("{}-{}", started.strftime("%Y%m%dT%H%M%S"), document.seed);
    let folder = free_name(runs, &stem);
    let partial = runs.join(format!(
        ".{}.partial-{}",
        folder.file_name().unwrap_or_default().to_string_lossy(),
        std::process::id()
    ));
    document.report = folder.join("report.html").display().to_string();
    let written = fs::create_dir_all(&partial)
        .map_err(Into::into)
        .and_then(|()| fill(&partial, setup, document, record, started))
        .and_then(|()| fs::rename(&partial, &folder).map_err(Into::into));
    if let Err(error) = written {
        // The first error is the one to tell of.
        let _ = fs::remove_dir_all(&partial);
        return Err(error.context(format!(
            "{}: the run could not be written",
            folder.display()
        )));
    }
    Ok(folder.join("report.html"))
}

/// A name that no run has yet: two runs of one seed may start in the same second.
fn free_name(runs: &Path, stem: &str) -> PathBuf {
    let mut path = runs.join(stem);
    let mut n = 1;
    while path.exists() {
        n += 1;
        path = runs.join(format!("{stem}-{n}"));
    }
    path
}

fn fill(
    folder: &Path,
    setup: &Setup,
    document: &Document,
    record: &Record,
    started: &jiff::Zoned,
) -> Result<()> {
    let origin = Origin {
        version: document.version,
        started: started.strftime("%Y-%m-%dT%H:%M:%S%:z").to_string(),
        command: std::env::args().collect(),
        seed: document.seed,
        configuration: setup
            .hashes
            .iter()
            .map(|(file, sha256)| Configuration { file, sha256 })
            .collect(),
    };
    let mut json = serde_json::to_string_pretty(&origin)?;
    json.push('\n');
    fs::write(folder.join("run.json"), json)?;
    let mut json = serde_json::to_string_pretty(document)?;
    json.push('\n');
    fs::write(folder.join("summary.json"), json)?;
    let mut samples = BufWriter::new(File::create(folder.join("samples.csv"))?);
    record.write_csv(&mut samples)?;
    samples.flush()?;
    fs::write(
        folder.join("report.html"),
        report::alignment(setup, document, record)?,
    )?;
    Ok(())
}
