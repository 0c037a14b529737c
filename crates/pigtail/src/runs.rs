//! The folder of a run: complete or not there.

use crate::rig::Setup;
use anyhow::{Context, Result};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::{fs, io};

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

/// A run's folder while it is being written: beside its place, to be moved there whole. Dropped
/// before that, it leaves nothing behind.
#[derive(Debug)]
pub struct Run {
    partial: PathBuf,
    folder: PathBuf,
    started: jiff::Zoned,
}

impl Run {
    /// Begins a run below `runs`, named after the time, `label` and the seed.
    ///
    /// # Errors
    ///
    /// When the folder cannot be made.
    pub fn begin(runs: &Path, label: &str, seed: u64) -> Result<Self> {
        let started = jiff::Zoned::now();
        let stem = format!("{}{label}-{seed}", started.strftime("%Y%m%dT%H%M%S"));
        let failed = || {
            format!(
                "{}: no run can be written here; accepted is a writable folder",
                runs.display()
            )
        };
        fs::create_dir_all(runs).with_context(failed)?;
        let mut n = 1;
        let (partial, folder) = loop {
            let name = if n == 1 {
                stem.clone()
            } else {
                format!("{stem}-{n}")
            };
            let (partial, folder) = (runs.join(format!(".{name}.partial")), runs.join(name));
            // Whoever makes the partial folder owns the name: runs may start side by side.
            match fs::create_dir(&partial) {
                Ok(()) if !folder.exists() => break (partial, folder),
                Ok(()) => fs::remove_dir(&partial).with_context(failed)?,
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error).with_context(failed),
            }
            n += 1;
        };
        Ok(Self {
            partial,
            folder,
            started,
        })
    }

    /// Where a file of the run will be.
    pub fn path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// Writes a file of the run.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn write(&self, file: &str, content: impl AsRef<[u8]>) -> Result<()> {
        fs::write(self.partial.join(file), content)
            .with_context(|| format!("{}: cannot be written", self.path(file).display()))
    }

    /// Writes a value as JSON.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn write_json(&self, file: &str, value: &impl Serialize) -> Result<()> {
        let mut json = serde_json::to_string_pretty(value)?;
        json.push('\n');
        self.write(file, json)
    }

    /// Notes where the run came from, and moves it to its place.
    ///
    /// # Errors
    ///
    /// When that cannot be done.
    pub fn finish(self, setup: &Setup, seed: u64) -> Result<()> {
        self.finish_with(&setup.hashes, seed)
    }

    /// The same for a run of other files than a rig's: name and SHA-256 of each.
    ///
    /// # Errors
    ///
    /// When that cannot be done.
    pub fn finish_with(self, hashes: &[(String, String)], seed: u64) -> Result<()> {
        self.write_json(
            "run.json",
            &Origin {
                version: env!("CARGO_PKG_VERSION"),
                started: self.started.strftime("%Y-%m-%dT%H:%M:%S%:z").to_string(),
                command: std::env::args_os()
                    .map(|a| a.to_string_lossy().into_owned())
                    .collect(),
                seed,
                configuration: hashes
                    .iter()
                    .map(|(file, sha256)| Configuration { file, sha256 })
                    .collect(),
            },
        )?;
        fs::rename(&self.partial, &self.folder)
            .with_context(|| format!("{}: cannot be written", self.folder.display()))
    }

    /// The run's name, by which others refer to it.
    pub fn name(&self) -> String {
        self.folder
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }

    /// The day on which it began.
    pub fn date(&self) -> String {
        self.started.strftime("%Y-%m-%d").to_string()
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        // Moved to its place it is no longer here; else there is nobody left to tell.
        let _ = fs::remove_dir_all(&self.partial);
    }
}
