//! A campaign's folder: what was asked for, and what is done.
//!
//! Parquet is readable only once its footer is written, so rows are kept as many small files,
//! `parts/<first device>-<hash>.parquet`, each written beside its place and moved there whole. A
//! campaign that is killed loses at most the part that was not full yet. When a campaign ends, by
//! itself or by Ctrl-C, its parts become one file, `rows.parquet`; they go when nothing is left to
//! be done.

use super::CampaignDocument;
use super::plan::{PLAN, Plan};
use super::rows::{ROWS_PER_DEVICE, columns};
use anyhow::{Context, Result};
use pigtail_hal::Error;
use pigtail_hal::digest::{self, hex};
use pigtail_session::procedure::Procedure;
use pigtail_store::database::{self, Beginning, Database, Devices, End, Entry, LOCK, State};
use pigtail_store::rows::{Column, Rows, Table, merge};
use pigtail_store::runs::{Run, rfc3339};
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// All rows, once the campaign has ended.
const ROWS: &str = "rows.parquet";
const SUMMARY: &str = "summary.json";
const PARTS: &str = "parts";
/// What a row takes on disk, with the parts that are beside it for a while: twice what was seen.
const BYTES_PER_ROW: u64 = 600;
/// What reports and summaries take.
const RESERVE: u64 = 4 << 20;

/// The folder of a campaign, held by this process alone.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    plan: Plan,
    procedure: Procedure,
    columns: Arc<[Column]>,
    parts: Vec<PathBuf>,
    done: u64,
    /// Its entry in the store of runs, as long as it goes on.
    entry: Option<Entry>,
    since: Instant,
    lock: File,
}

impl Drop for Store {
    /// Lets go of the folder at once: a process that was just being started may still hold a copy of the file.
    fn drop(&mut self) {
        let _ = self.lock.unlock();
    }
}

impl Store {
    /// Begins a campaign in a new folder below `runs`.
    ///
    /// # Errors
    ///
    /// When the disk has too little room, or cannot be written.
    pub fn begin(runs: &Path, plan: Plan) -> Result<Self> {
        let procedure = plan.procedure()?;
        check_room(runs, plan.devices)?;
        let run = Run::begin(runs, "campaign", plan.seed, &plan.configuration)?;
        let folder = run.path("");
        run.devices(&Devices {
            seed: plan.seed,
            count: plan.devices,
            rig: &plan.rig,
            recipe: &plan.recipe,
            procedure: &plan.procedure,
            scenario: &plan.scenario,
        })?;
        run.write_json(PLAN, &plan)?;
        let (entry, lock) = run.go_on_in_place()?;
        let parts = folder.join(PARTS);
        fs::create_dir(&parts)
            .with_context(|| format!("{}: cannot be written", parts.display()))?;
        let mut store = Self::new(&folder, plan, procedure, lock);
        store.entry = Some(entry);
        Ok(store)
    }

    /// Goes on with the campaign in `folder`, which must be the one that `plan` describes.
    ///
    /// # Errors
    ///
    /// When it is another, another process is at it, what is there is damaged, or the disk has too
    /// little room for what is left.
    pub fn resume(folder: &Path, plan: &Plan) -> Result<Self> {
        let begun = Plan::read(folder)?;
        begun.check(folder, plan)?;
        let procedure = begun.procedure()?;
        let lock = lock(folder)?;
        let mut store = Self::new(folder, begun, procedure, lock);
        if store.folder.join(PARTS).is_dir() || !store.rows_path().exists() {
            store.take_parts()?;
            check_room(folder, store.plan.devices - store.done)?;
        } else {
            store.take_rows()?;
        }
        if !store.was_whole() {
            store.entry = Some(store.enter_again()?);
        }
        Ok(store)
    }

    fn new(folder: &Path, plan: Plan, procedure: Procedure, lock: File) -> Self {
        Self {
            // Without the slash that an empty file name leaves behind.
            folder: folder.components().collect(),
            plan,
            procedure,
            columns: columns(procedure).into(),
            parts: Vec::new(),
            done: 0,
            entry: None,
            since: Instant::now(),
            lock,
        }
    }

    /// Takes up its entry in the store of runs again, or enters it where it began before there was
    /// one.
    fn enter_again(&self) -> Result<Entry> {
        let folder = fs::canonicalize(&self.folder)
            .with_context(|| format!("{}: cannot be found", self.folder.display()))?;
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let runs = folder.parent().unwrap_or(Path::new("/"));
        let plan = &self.plan;
        let beginning = Beginning {
            name: &name,
            kind: "campaign",
            seed: plan.seed,
            started: &rfc3339(&jiff::Zoned::now()),
            configuration: &plan.configuration,
        };
        let entry = Entry::resume(Database::open_or_create(runs)?, &beginning)?;
        entry.devices(&Devices {
            seed: plan.seed,
            count: plan.devices,
            rig: &plan.rig,
            recipe: &plan.recipe,
            procedure: &plan.procedure,
            scenario: &plan.scenario,
        })?;
        Ok(entry)
    }

    /// What the campaign is to do.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The procedure.
    pub fn procedure(&self) -> Procedure {
        self.procedure
    }

    /// The campaign's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where the file of all rows is once the campaign has ended.
    pub fn rows_path(&self) -> PathBuf {
        self.folder.join(ROWS)
    }

    /// Devices whose rows are kept: always the first ones.
    pub fn done(&self) -> u64 {
        self.done
    }

    /// An empty table for rows of this campaign.
    pub fn table(&self) -> Table {
        Table::new(&self.columns)
    }

    /// Keeps the rows of the devices that follow those that are done.
    ///
    /// # Errors
    ///
    /// When they cannot be written. What was kept before stays.
    pub fn append(&mut self, table: &Table) -> Result<()> {
        if table.rows() == 0 {
            return Ok(());
        }
        let bytes = table.to_parquet()?;
        let name = part_name(self.done, &digest::hash(&bytes));
        let path = self.folder.join(PARTS).join(name);
        fs::create_dir_all(self.folder.join(PARTS))
            .and_then(|()| write_whole(&path, |file| file.write_all(&bytes)))
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        self.parts.push(path);
        self.done += super::rows::devices(table);
        Ok(())
    }

    /// Takes files of rows from elsewhere, which are those of all devices in order.
    pub(super) fn adopt(&mut self, files: Vec<PathBuf>) {
        self.parts = files;
        self.done = self.plan.devices;
    }

    /// Whether there was nothing left to be done when the campaign was opened.
    pub fn was_whole(&self) -> bool {
        self.done == self.plan.devices && self.parts.is_empty()
    }

    /// Makes one file of all parts, where there are any still.
    ///
    /// # Errors
    ///
    /// When a part is damaged, or the file cannot be written.
    pub fn collect(&self) -> Result<()> {
        if self.was_whole() {
            return Ok(());
        }
        let path = self.rows_path();
        write_whole(&path, |file| {
            merge(&self.parts, &self.columns, file)
                .map_err(|error| io::Error::other(format!("{error:#}")))
        })
        .with_context(|| format!("{}: cannot be written", path.display()))
    }

    /// Opens the file of all rows.
    ///
    /// # Errors
    ///
    /// When it cannot be read.
    pub fn rows(&self) -> Result<Rows> {
        let path = self.rows_path();
        Rows::open(&path, &self.columns).with_context(|| path.display().to_string())
    }

    /// SHA-256 of the file of all rows.
    ///
    /// # Errors
    ///
    /// When it cannot be read.
    pub fn rows_hash(&self) -> Result<String> {
        let path = self.rows_path();
        file_hash(&path).with_context(|| format!("{}: cannot be read", path.display()))
    }

    /// Writes what the campaign comes to, the summary as a document of it; of a whole one, only the file of all rows stays.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn finish(
        &self,
        summary: &CampaignDocument,
        document: &impl Serialize,
        report: &str,
    ) -> Result<()> {
        let json = serde_json::to_string_pretty(document)? + "\n";
        for (name, text) in [(SUMMARY, json.as_str()), ("report.html", report)] {
            let path = self.folder.join(name);
            write_whole(&path, |file| file.write_all(text.as_bytes()))
                .with_context(|| format!("{}: cannot be written", path.display()))?;
        }
        let parts = self.folder.join(PARTS);
        if self.done == self.plan.devices && parts.exists() {
            // Out of the way first: half of them would look like a damaged campaign.
            let gone = self.folder.join(".parts");
            fs::rename(&parts, &gone)
                .and_then(|()| fs::remove_dir_all(&gone))
                .with_context(|| format!("{}: cannot be removed", parts.display()))?;
        }
        self.enter_end(summary)
    }

    /// Enters in the store of runs how far it came, and the files that there are.
    fn enter_end(&self, summary: &CampaignDocument) -> Result<()> {
        let Some(entry) = &self.entry else {
            return Ok(());
        };
        let files = database::hash_all(&self.folder, &[])
            .with_context(|| format!("{}: cannot be read", self.folder.display()))?;
        let end = End {
            state: if summary.complete {
                State::Complete
            } else {
                State::Interrupted
            },
            outcome: &format!("{} of {} fibers aligned", summary.aligned, summary.fibers),
            finished: &rfc3339(&jiff::Zoned::now()),
            wall_seconds: self.since.elapsed().as_secs_f64(),
        };
        entry.end(&end, &files, || Ok(()))
    }

    /// Finds the parts that are there, and how many devices they hold.
    fn take_parts(&mut self) -> Result<()> {
        let folder = self.folder.join(PARTS);
        let mut there = Vec::new();
        if folder.is_dir() {
            let entries = fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
            for entry in entries {
                let path = entry.with_context(|| folder.display().to_string())?.path();
                if path.extension().is_some_and(|e| e == "partial") {
                    // What a killed campaign was writing.
                    fs::remove_file(&path).with_context(|| path.display().to_string())?;
                } else {
                    there.push(path);
                }
            }
        }
        there.sort();
        for path in there {
            self.take_part(&path)
                .map_err(|why| Error::new(path.display().to_string(), "", format!(
                    "the rows are damaged ({why:#}); accepted are the parts as the campaign wrote \
                     them: remove this one and those after it, and the campaign goes on from there"
                )))?;
            self.parts.push(path);
        }
        Ok(())
    }

    fn take_part(&mut self, path: &Path) -> Result<()> {
        let name = part_name(self.done, &file_hash(path)?);
        let there = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let first = there.split('-').next().unwrap_or_default();
        anyhow::ensure!(
            first == format!("{:010}", self.done),
            "device {} should follow, and this part begins with {first}",
            self.done
        );
        anyhow::ensure!(there == name, "its bytes do not have the hash in its name");
        let rows = Rows::open(path, &self.columns)?.rows();
        let devices = rows / ROWS_PER_DEVICE;
        anyhow::ensure!(
            rows % ROWS_PER_DEVICE == 0 && self.done + devices <= self.plan.devices,
            "it has {rows} rows"
        );
        self.done += devices;
        Ok(())
    }

    /// Takes a campaign that is whole.
    fn take_rows(&mut self) -> Result<()> {
        let path = self.rows_path();
        let damaged = |why: String| {
            Error::new(
                path.display().to_string(),
                "",
                format!(
                    "the rows are damaged ({why}); accepted is the file that the campaign wrote, \
                     beside its {SUMMARY}"
                ),
            )
        };
        let summary = fs::read_to_string(self.folder.join(SUMMARY))
            .map_err(|error| damaged(format!("{SUMMARY} cannot be read: {error}")))?;
        let summary: serde_json::Value = serde_json::from_str(&summary)
            .map_err(|error| damaged(format!("{SUMMARY} is no JSON: {error}")))?;
        if summary["rows_sha256"].as_str() != Some(&self.rows_hash()?) {
            return Err(damaged(format!("their hash is not the one in {SUMMARY}")).into());
        }
        let rows = self
            .rows()
            .map_err(|error| damaged(format!("{error:#}")))?
            .rows();
        let wanted = self.plan.devices * ROWS_PER_DEVICE;
        if rows != wanted {
            return Err(damaged(format!("{rows} rows, where {wanted} are due")).into());
        }
        self.done = self.plan.devices;
        Ok(())
    }
}

/// Whether the disk has room for the rows of so many devices.
fn check_room(folder: &Path, devices: u64) -> Result<(), Error> {
    // The folder may not be there yet; one above it is.
    let mut there: PathBuf = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    while !there.exists() && there.pop() {}
    let room = match fs4::statvfs(&there) {
        Ok(disk) if disk.total_space() > 0 => disk.available_space(),
        // What does not tell is tried.
        _ => return Ok(()),
    };
    let bytes_per_device = ROWS_PER_DEVICE * BYTES_PER_ROW;
    let needed = devices
        .saturating_mul(bytes_per_device)
        .saturating_add(RESERVE);
    if needed <= room {
        return Ok(());
    }
    let gigabytes = |bytes: u64| bytes as f64 / 1e9;
    Err(Error::new(
        folder.display().to_string(),
        "devices",
        format!(
            "not enough disk: {devices} devices may need {:.3} GB and {:.3} GB are free; accepted \
             are up to {} devices here, or a --runs folder on a larger disk",
            gigabytes(needed),
            gigabytes(room),
            room.saturating_sub(RESERVE) / bytes_per_device
        ),
    ))
}

/// Holds a campaign's folder until this process ends, however it does.
fn lock(folder: &Path) -> Result<File> {
    let path = folder.join(LOCK);
    let file =
        File::create(&path).with_context(|| format!("{}: cannot be written", path.display()))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(Error::new(
            folder.display().to_string(),
            "",
            "another process is running this campaign; accepted is one at a time",
        )
        .into()),
        // Not every file system has locks.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
    }
}

/// Writes a file so that it is there whole or not at all, whatever happens.
fn write_whole(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    let written = (|| {
        let mut file = BufWriter::new(File::create(&partial)?);
        content(&mut file)?;
        file.into_inner()?.sync_all()?;
        fs::rename(&partial, path)
    })();
    if written.is_err() {
        // Half a file helps nobody, and its room may be what is missing.
        let _ = fs::remove_file(&partial);
    }
    written
}

/// A hash that is written to.
struct HashWriter<'a>(&'a mut Sha256);

/// SHA-256 of a file.
pub(super) fn file_hash(path: &Path) -> io::Result<String> {
    let mut hash = Sha256::new();
    io::copy(&mut File::open(path)?, &mut HashWriter(&mut hash))?;
    Ok(hex(&hash.finalize()))
}

impl Write for HashWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The name of a part or a shard: its first device, and the beginning of its hash.
pub(super) fn part_name(first: u64, hash: &str) -> String {
    format!("{first:010}-{}.parquet", &hash[..16])
}
