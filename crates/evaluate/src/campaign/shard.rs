//! A campaign in shards: each is done by a process of its own, anywhere, and is one file.
//!
//! What shards of one campaign have in common is a folder, named after what was asked for, that all of them can
//! write to. A shard writes its rows beside their place and moves them there whole; one that is done is not done
//! again. Nothing else passes between them, and none of them touches the store of runs: that is [merged](merge)
//! into, in the end. Rows depend neither on the number of shards nor on who did them.

use super::plan::{PLAN, Plan};
use super::rows::{ROWS_PER_DEVICE, columns, devices, push};
use super::store::{Store, file_hash, part_name};
use super::{Commissioned, Device, device, each};
use anyhow::{Context, Result};
use pigtail_hal::Error;
use pigtail_hal::digest::{hash, hex};
use pigtail_session::setup::Setup;
use pigtail_store::rows::{GROUP, Rows, Table, Writer};
use pigtail_twin::Specimen;
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// One of several parts of a campaign, nearly equal in size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Which, from one.
    index: u64,
    /// Of how many.
    of: u64,
}

impl Shard {
    /// The shard of this index, from one, of so many.
    ///
    /// # Errors
    ///
    /// When there is none.
    pub fn new(index: u64, of: u64) -> Result<Self, String> {
        if index == 0 || index > of {
            return Err(format!(
                "{index}/{of} is no shard; accepted is I/N, with I from 1 to N"
            ));
        }
        Ok(Self { index, of })
    }

    /// All shards, of so many.
    pub fn all(of: u64) -> impl Iterator<Item = Self> {
        (1..=of).map(move |index| Self { index, of })
    }

    /// Its devices, counted from zero: all of a machine are in the same shard.
    pub fn devices(self, plan: &Plan) -> Range<u64> {
        let machines = u128::from(plan.machines());
        let first = |index: u64| {
            let machine = machines * u128::from(index) / u128::from(self.of);
            (machine as u64 * plan.devices_each).min(plan.devices)
        };
        first(self.index - 1)..first(self.index)
    }

    /// The seeds of its machines.
    pub fn machine_seeds(self, plan: &Plan) -> Vec<u64> {
        let devices = self.devices(plan);
        let machines = devices.start / plan.devices_each..devices.end.div_ceil(plan.devices_each);
        let seed = |machine| Specimen::of(plan.seed + machine, 0).machine();
        machines.map(seed).collect()
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("\"{text}\" is no shard; accepted is I/N, such as 3/100");
        let (index, of) = text.split_once('/').ok_or_else(wrong)?;
        let number = |text: &str| text.trim().parse::<u64>().map_err(|_| wrong());
        Self::new(number(index)?, number(of)?)
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

/// What was read of rig and recipe, so that whoever runs a shard needs neither their files nor their paths.
const SOURCES: &str = "sources.json";

/// The folder below `runs` for the shards of a campaign on this setup, made if it is not there: whoever asks for the
/// same campaign gets the same.
///
/// # Errors
///
/// When it cannot be written, or holds another campaign.
pub fn folder(runs: &Path, plan: &Plan, setup: &Setup) -> Result<PathBuf> {
    let text = serde_json::to_string_pretty(plan)? + "\n";
    let name = format!("campaign-{}-{}", plan.seed, &hash(&text)[..12]);
    let folder = runs.join(name);
    if folder.join(PLAN).exists() {
        Plan::read(&folder)?.check(&folder, plan)?;
        return Ok(folder);
    }
    let sources = serde_json::to_string(&setup.rig.sources)? + "\n";
    // The plan last: where it is, all is.
    fs::create_dir_all(&folder)
        .and_then(|()| {
            [(SOURCES, sources), (PLAN, text)]
                .into_iter()
                .try_for_each(|(file, text)| {
                    let partial = Partial(folder.join(unique(file)));
                    fs::write(&partial.0, text)?;
                    fs::rename(&partial.0, folder.join(file))
                })
        })
        .with_context(|| {
            format!(
                "{}: cannot be written; accepted is a folder that every shard can write to",
                folder.display()
            )
        })?;
    Ok(folder)
}

/// What the shards of a folder run: its plan, and rig and recipe as they were read when it was made. A fleet is read
/// again, by its name.
///
/// # Errors
///
/// When the folder is none of a campaign's, or something is not as it was.
pub fn setup(folder: &Path) -> Result<(Plan, Setup)> {
    let plan = Plan::read(folder)?;
    let path = folder.join(SOURCES);
    let text = fs::read_to_string(&path).map_err(|why| {
        let message = format!(
            "cannot be read ({why}); accepted is a folder of shards, such as `campaign --shard` makes"
        );
        Error::new(path.display().to_string(), "", message)
    })?;
    let sources = serde_json::from_str(&text).map_err(|why| {
        let message = format!("is damaged ({why}); accepted is it as it was written");
        Error::new(path.display().to_string(), "", message)
    })?;
    let setup = plan.of(Setup::from_sources(&plan.rig, &plan.recipe, sources)?)?;
    Ok((plan, setup))
}

/// The file of a shard, if there is one: its name holds the hash of its bytes.
fn done(folder: &Path, first: u64) -> Result<Option<PathBuf>> {
    let start = format!("{first:010}-");
    let there = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    for entry in there {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with(&start) && name.ends_with(".parquet") {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

/// How a shard ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ran {
    /// The file of its rows; `None` if it was stopped before its end, and left nothing.
    pub file: Option<PathBuf>,
    /// Its devices.
    pub devices: u64,
    /// Devices that were done just now: none if the file was there.
    pub done: u64,
}

/// Runs a shard of the campaign whose [`folder`] this is, on so many threads, if nobody has yet. One that is stopped,
/// or killed, leaves no file.
///
/// # Errors
///
/// When a device's plant cannot be built, or rows cannot be written.
pub fn run(
    folder: &Path,
    shard: Shard,
    setup: &Setup,
    machines: Option<&Commissioned>,
    threads: usize,
    stop: &AtomicBool,
    mut watch: impl FnMut(&Device),
) -> Result<Ran> {
    let plan = Plan::read(folder)?;
    let procedure = plan.procedure()?;
    let range = shard.devices(&plan);
    let count = range.end - range.start;
    let ran = |file, done| Ran {
        file,
        devices: count,
        done,
    };
    if count == 0 {
        return Ok(ran(None, 0));
    }
    if let Some(file) = done(folder, range.start)? {
        return Ok(ran(Some(file), 0));
    }
    let columns: Arc<_> = columns(procedure).into();
    // Two may be at the same shard: each writes a file of its own, with the same bytes in the end.
    let partial = Partial(folder.join(unique(&format!("{:010}", range.start))));
    let failed = || format!("{}: cannot be written", partial.0.display());
    let file = Hashing {
        file: BufWriter::new(File::create(&partial.0).with_context(failed)?),
        hash: Sha256::new(),
    };
    let mut writer = Writer::new(file, &columns)?;
    let mut table = Table::new(&columns);
    let mut kept = 0;
    let sink = |device: Device| {
        watch(&device);
        push(&mut table, procedure, &device);
        if table.rows() >= GROUP {
            writer.group(&table)?;
            kept += devices(&table);
            table = Table::new(&columns);
        }
        Ok(())
    };
    match machines {
        None => {
            let one = |seed| device(setup, procedure, seed);
            each(&plan, range.clone(), &one, threads, stop, sink)?;
        }
        Some(machines) => {
            let one = |seed| machines.device(procedure, seed);
            each(&plan, range.clone(), &one, threads, stop, sink)?;
        }
    }
    kept += devices(&table);
    if kept < count {
        return Ok(ran(None, kept));
    }
    writer.group(&table)?;
    let Hashing { file, hash } = writer.finish()?;
    file.into_inner()
        .map_err(io::IntoInnerError::into_error)
        .and_then(|file| file.sync_all())
        .with_context(failed)?;
    let path = folder.join(part_name(range.start, &hex(&hash.finalize())));
    fs::rename(&partial.0, &path).with_context(failed)?;
    Ok(ran(Some(path), count))
}

/// A file that is gone with this, unless it was moved away.
struct Partial(PathBuf);

impl Drop for Partial {
    fn drop(&mut self) {
        // Half a file helps nobody.
        let _ = fs::remove_file(&self.0);
    }
}

/// What no other process, here or elsewhere, calls a file that is to be moved to this place.
fn unique(file: &str) -> String {
    let time = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let nanoseconds = time.map_or(0, |since| since.as_nanos());
    let host = fs::read_to_string("/etc/hostname").unwrap_or_default();
    let host = &hash(host)[..8];
    format!(
        ".{file}-{host}-{}-{nanoseconds}.partial",
        std::process::id()
    )
}

/// A file, and the hash of all that was written to it.
struct Hashing {
    file: BufWriter<File>,
    hash: Sha256,
}

impl Write for Hashing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hash.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Takes the files of all shards in a folder into a new campaign below `runs`, as if it had done them itself; they
/// stay where they are.
///
/// # Errors
///
/// When one is missing or damaged, or the disk has too little room.
pub fn merge(folder: &Path, runs: &Path) -> Result<(Store, Setup)> {
    let (plan, setup) = setup(folder)?;
    let procedure = plan.procedure()?;
    let columns: Arc<_> = columns(procedure).into();
    let mut files = Vec::new();
    let mut due = 0;
    while due < plan.devices {
        let Some(file) = done(folder, due)? else {
            let message = format!(
                "the shard that begins with device {due} of {} is missing; accepted are all shards of one number: run \
                 those that have left no file again",
                plan.devices
            );
            return Err(Error::new(folder.display().to_string(), "", message).into());
        };
        let damaged = |why: &str| {
            let message = format!(
                "the shard is damaged ({why}); accepted is it as it was written: remove it and run it again"
            );
            Error::new(file.display().to_string(), "", message)
        };
        let hash = file_hash(&file).with_context(|| file.display().to_string())?;
        let named = file.file_name().unwrap_or_default().to_string_lossy();
        if named != part_name(due, &hash) {
            return Err(damaged("its bytes do not have the hash in its name").into());
        }
        let rows = Rows::open(&file, &columns).map_err(|why| damaged(&format!("{why:#}")))?;
        let rows = rows.rows();
        due += rows / ROWS_PER_DEVICE;
        if rows == 0 || rows % ROWS_PER_DEVICE != 0 || due > plan.devices {
            return Err(damaged(&format!("it has {rows} rows")).into());
        }
        files.push(file);
    }
    let mut store = Store::begin(runs, plan)?;
    store.adopt(files);
    Ok((store, setup))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_session::procedure::Procedure;

    #[test]
    fn shards_are_all_devices_and_no_device_twice() {
        let setup = Setup::load("afpm", "y-branch").expect("it ships");
        for (machines, each) in [(1, 1), (7, 1), (100, 1), (13, 4)] {
            let plan =
                Plan::new(&setup, Procedure::Fast, 5, machines * each).with_devices_each(each);
            for of in [1, 2, 3, 7, 250] {
                let mut due = 0;
                for shard in Shard::all(of) {
                    let range = shard.devices(&plan);
                    assert_eq!(range.start, due);
                    assert_eq!((range.end - range.start) % each, 0, "a machine is in one");
                    due = range.end;
                }
                assert_eq!(due, plan.devices);
            }
        }
    }

    #[test]
    fn what_is_no_shard_is_refused() {
        for text in ["0/3", "4/3", "1", "/3", "a/3", "1/0", "-1/3", "1/3/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
        assert_eq!("3/100".parse(), Shard::new(3, 100));
    }
}
