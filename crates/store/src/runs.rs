//! The folder of a run and its entry in the store: complete, or what there is of it.

use crate::database::{
    self, Aligned, Beginning, Database, Devices, End, Entry, FileHash, LOCK, Pigtail, State,
};
use anyhow::{Context, Result};
use pigtail_hal::digest::{hash, hex};
use pigtail_hal::{Error, Fault};
use serde::Serialize;
use std::cell::{Cell, RefCell};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;
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

/// A run while it is being written: in the store, and in a hidden folder beside its place, to be
/// moved there whole.
///
/// It ends in one of four ways. [`Run::finish`]: complete. [`Run::fault`]: the machine stopped; what
/// there is of it is moved to its place too. [`Run::abandon`], or dropped before anything was kept:
/// nothing ran, and nothing is left behind. Dropped otherwise, or killed: it is listed as interrupted,
/// and its hidden folder stays.
#[derive(Debug)]
pub struct Run {
    partial: PathBuf,
    folder: PathBuf,
    started: jiff::Zoned,
    clock: Instant,
    seed: u64,
    configuration: Vec<(String, String)>,
    /// Gone once it has ended.
    entry: Option<Entry>,
    /// Held as long as this process is at it, by which others know that it is.
    lock: Option<File>,
    /// What files are by whoever wrote them.
    known: RefCell<Vec<FileHash>>,
    /// Whether something was kept that must not get lost.
    evidence: Cell<bool>,
    ended: Cell<bool>,
}

impl Run {
    /// Begins a run below `runs`. `kind` is the command in words, such as `identify windup`; its
    /// folder is named after the time, the last word of a kind (not of the plain `align`) and the
    /// seed. `configuration` is name and SHA-256 of everything that was read.
    ///
    /// # Errors
    ///
    /// When the folder cannot be made, or the store is damaged, newer, or cannot be written.
    pub fn begin(
        runs: &Path,
        kind: &str,
        seed: u64,
        configuration: &[(String, String)],
    ) -> Result<Self> {
        let started = jiff::Zoned::now();
        let label = match kind.rsplit(' ').next() {
            Some("align") | None => String::new(),
            Some(word) => format!("-{word}"),
        };
        let stem = format!("{}{label}-{seed}", started.strftime("%Y%m%dT%H%M%S"));
        let failed = || {
            format!(
                "{}: no run can be written here; accepted is a writable folder",
                runs.display()
            )
        };
        fs::create_dir_all(runs).with_context(failed)?;
        let mut database = Database::open_or_create(runs)?;
        for n in 1.. {
            let name = if n == 1 {
                stem.clone()
            } else {
                format!("{stem}-{n}")
            };
            let (partial, folder) = (database::partial_folder(runs, &name), runs.join(&name));
            // Whoever makes the partial folder owns the name: runs may start side by side.
            match fs::create_dir(&partial) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(error).with_context(failed),
            }
            let entered = if folder.exists() {
                Ok(Err(database))
            } else {
                hold(&partial).with_context(failed).and_then(|lock| {
                    let beginning = Beginning {
                        name: &name,
                        kind,
                        seed,
                        started: &rfc3339(&started),
                        configuration,
                    };
                    Ok(Entry::begin(database, &beginning)?.map(|entry| (entry, lock)))
                })
            };
            match entered {
                Ok(Ok((entry, lock))) => {
                    return Ok(Self {
                        partial,
                        folder,
                        started,
                        clock: Instant::now(),
                        seed,
                        configuration: configuration.to_vec(),
                        entry: Some(entry),
                        lock: Some(lock),
                        known: RefCell::default(),
                        evidence: Cell::new(false),
                        ended: Cell::new(false),
                    });
                }
                Ok(Err(same)) => {
                    database = same;
                    fs::remove_dir_all(&partial).with_context(failed)?;
                }
                Err(error) => {
                    // Nothing is in it, and the error is what the user has to know.
                    let _ = fs::remove_dir_all(&partial);
                    return Err(error);
                }
            }
        }
        unreachable!("numbers do not end")
    }

    /// Where a file of the run will be.
    pub fn path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// Where a file of the run is to be written while it runs: it is hashed when the run ends (or
    /// [before](Self::wrote)), and stays where the run is interrupted.
    pub fn partial_path(&self, file: &str) -> PathBuf {
        self.partial.join(file)
    }

    /// Notes what a file at [`Self::partial_path`] has become, by whoever wrote it, so that it need not
    /// be read again.
    pub fn wrote(&self, file: &str, bytes: u64, sha256: &[u8]) {
        self.known.borrow_mut().push(FileHash {
            path: file.to_owned(),
            bytes,
            sha256: hex(sha256),
        });
    }

    /// Writes a file of the run.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn write(&self, file: &str, content: impl AsRef<[u8]>) -> Result<()> {
        self.evidence.set(true);
        fs::write(self.partial_path(file), content)
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

    /// Enters the devices that it is about.
    ///
    /// # Errors
    ///
    /// When they cannot be entered.
    pub fn devices(&self, devices: &Devices) -> Result<(), Error> {
        self.entry().devices(devices)
    }

    /// Enters a phase of a fiber that is over: when it began and how long it took, seconds of machine time.
    ///
    /// # Errors
    ///
    /// When it cannot be entered.
    pub fn phase(&self, port: &str, phase: &str, begun: f64, seconds: f64) -> Result<(), Error> {
        self.evidence.set(true);
        self.entry().phase(port, phase, begun, seconds)
    }

    /// Enters a fiber of a tray that is done with.
    ///
    /// # Errors
    ///
    /// When it cannot be entered.
    pub fn pigtail(&self, pigtail: &Pigtail) -> Result<(), Error> {
        self.evidence.set(true);
        self.entry().pigtail(pigtail)
    }

    /// Enters how the fibers of its device ended.
    ///
    /// # Errors
    ///
    /// When it cannot be entered.
    pub fn aligned(&self, aligned: &Aligned) -> Result<(), Error> {
        self.evidence.set(true);
        self.entry().aligned(aligned)
    }

    /// Enters that it wrote a table of a calibration, if it wrote one, with the file's hash as it is
    /// now.
    ///
    /// # Errors
    ///
    /// When it cannot be entered.
    pub fn calibrated(&self, file: Option<&str>, table: &str) -> Result<()> {
        let Some(file) = file else { return Ok(()) };
        self.evidence.set(true);
        let content = fs::read(file).with_context(|| format!("{file}: cannot be read"))?;
        Ok(self.entry().calibrated(file, table, &hash(content))?)
    }

    /// Notes where the run came from and how it ended, in a few words, and moves it to its place.
    ///
    /// # Errors
    ///
    /// When that cannot be done.
    pub fn finish(&self, outcome: &str) -> Result<()> {
        self.end(State::Complete, outcome)
    }

    /// Notes that the machine stopped. What there is of the run is evidence, and moves to its place.
    ///
    /// # Errors
    ///
    /// When that cannot be done.
    pub fn fault(&self, fault: &Fault) -> Result<()> {
        self.evidence.set(true);
        self.entry().fault(fault)?;
        self.end(State::Fault, fault.rule.text())
    }

    /// Leaves nothing behind, as nothing ran.
    pub fn abandon(&self) {
        self.evidence.set(false);
    }

    fn end(&self, state: State, outcome: &str) -> Result<()> {
        self.write_origin()?;
        let files = database::hash_all(&self.partial, &self.known.borrow())
            .with_context(|| format!("{}: cannot be read", self.partial.display()))?;
        let end = End {
            state,
            outcome,
            finished: &rfc3339(&jiff::Zoned::now()),
            wall_seconds: self.clock.elapsed().as_secs_f64(),
        };
        self.entry().end(&end, &files, || self.place())?;
        self.ended.set(true);
        // Whoever finds it knows what it is.
        let _ = fs::remove_file(self.path(LOCK));
        Ok(())
    }

    /// Moves the run to its place while it goes on, and gives what keeps it going: its entry, and
    /// the lock in its folder.
    ///
    /// # Errors
    ///
    /// When that cannot be done.
    pub fn go_on_in_place(mut self) -> Result<(Entry, File)> {
        self.write_origin()?;
        self.place()?;
        self.ended.set(true);
        self.entry
            .take()
            .zip(self.lock.take())
            .context("a run that has ended cannot go on")
    }

    fn write_origin(&self) -> Result<()> {
        self.write_json(
            "run.json",
            &Origin {
                version: env!("CARGO_PKG_VERSION"),
                started: rfc3339(&self.started),
                command: std::env::args_os()
                    .map(|a| a.to_string_lossy().into_owned())
                    .collect(),
                seed: self.seed,
                configuration: self
                    .configuration
                    .iter()
                    .map(|(file, sha256)| Configuration { file, sha256 })
                    .collect(),
            },
        )
    }

    fn place(&self) -> Result<()> {
        fs::rename(&self.partial, &self.folder)
            .with_context(|| format!("{}: cannot be written", self.folder.display()))
    }

    fn entry(&self) -> &Entry {
        self.entry.as_ref().expect("only its end takes it")
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
        if self.ended.get() || self.evidence.get() {
            return;
        }
        // There is nobody left to tell that it failed.
        let _ = fs::remove_dir_all(&self.partial);
        self.lock = None;
        let _ = self.entry.take().map(Entry::abandon);
    }
}

/// Holds the folder of a run until this process ends, however it does.
fn hold(folder: &Path) -> io::Result<File> {
    let lock = File::create(folder.join(LOCK))?;
    // Not every file system has locks.
    let _ = lock.try_lock();
    Ok(lock)
}

/// This moment, as RFC 3339 has it.
pub fn now() -> String {
    rfc3339(&jiff::Zoned::now())
}

/// A moment as RFC 3339 has it.
pub fn rfc3339(time: &jiff::Zoned) -> String {
    time.strftime("%Y-%m-%dT%H:%M:%S%:z").to_string()
}
