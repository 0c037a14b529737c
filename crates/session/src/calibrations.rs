//! The versions of a rig's calibration: what was believed when, and by which run.
//!
//! A rig's folder has its current belief in `calibration.toml`, with the weights that it names beside it. Each
//! version is a folder below `calibrations`, named by its number, with the same files and a `calibration.json` that
//! says when, by what and with which hashes it was written. A version is never changed. To write is to make a new
//! version whole, and then to put its `calibration.toml` in place of the current one in one move: who is killed
//! meanwhile leaves either the old belief or the new one. Weights are named by their content, so that the old
//! calibration never finds the new one's.

mod belief;
mod difference;
mod find;
mod state;

pub use belief::{Belief, Change, SHORT};
pub(crate) use difference::newest_date;
pub use difference::{Difference, TableRow, differences, rows};
pub use find::{Found, find};
pub use state::{On, Part, RunsOn, notes};

use crate::bench::BenchCalibration;
use crate::rig::{FILES, Rig, is_built_in, rig_folder, shipped};
use pigtail_hal::bench::spec::BenchSpec;
use pigtail_hal::digest::hash;
use pigtail_hal::{Error, Spec};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

/// The belief.
pub const FILE: &str = "calibration.toml";

/// What is said of a belief that was kept.
pub const ABOUT: &str = "calibration.json";

/// The folder of the versions.
const FOLDER: &str = "calibrations";

/// The number that was given last: none is given twice, even where a version was deleted. Who writes holds it.
const LAST: &str = "last";

/// Where a belief that is kept came from. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct About {
    /// Its number, where it is a version of a rig.
    pub version: Option<u32>,
    /// When it was written, in RFC 3339.
    pub date: String,
    /// The command; or `by hand`, or `as it was before` any version.
    pub origin: String,
    /// The run that found it, where one did.
    pub run: Option<String>,
    /// The tables that are other than before.
    pub tables: Vec<String>,
    /// Every file of it.
    pub files: Vec<FileHash>,
}

/// A file and its SHA-256.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileHash {
    /// Its name.
    pub file: String,
    /// SHA-256 of its content.
    pub sha256: String,
}

impl About {
    /// Of a belief, but for its number.
    pub fn of(belief: &Belief, origin: &Origin, tables: Vec<String>) -> Self {
        let hashed = |(file, text): (&str, &str)| FileHash {
            file: file.to_owned(),
            sha256: hash(text),
        };
        Self {
            version: None,
            date: origin.date.clone(),
            origin: origin.what.clone(),
            run: origin.run.clone(),
            tables,
            files: belief.files().map(hashed).collect(),
        }
    }

    /// SHA-256 of the calibration itself.
    pub fn sha256(&self) -> &str {
        let calibration = self.files.iter().find(|file| file.file == FILE);
        calibration.map_or("", |file| &file.sha256)
    }

    /// Whether a file of it is of this name and SHA-256.
    fn has(&self, name: &str, sha256: &str) -> bool {
        let same = |file: &FileHash| file.file == name && file.sha256 == sha256;
        self.files.iter().any(same)
    }

    /// Whether a belief has the files that this one had.
    fn is_of(&self, belief: &Belief) -> bool {
        let same = |(name, text): (&str, &str)| self.has(name, &hash(text));
        self.files.len() == 1 + belief.weights.len() && belief.files().all(same)
    }
}

/// Who writes a belief, and when.
#[derive(Debug, Clone)]
pub struct Origin {
    /// The command.
    pub what: String,
    /// When, in RFC 3339.
    pub date: String,
    /// The run that found it.
    pub run: Option<String>,
}

/// A version in the list of them. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Listed {
    /// What is said of it.
    #[serde(flatten)]
    pub about: About,
    /// SHA-256 of its `calibration.toml`.
    pub sha256: String,
    /// Whether it is what the rig believes now.
    pub current: bool,
    /// What is wrong with its files; `null` where they are as they were written.
    pub damage: Option<String>,
}

/// What came of writing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Written {
    /// The version that the rig has now.
    pub version: u32,
    /// The file that was replaced.
    pub file: String,
    /// SHA-256 of its content now.
    pub sha256: String,
    /// The version as which the calibration was kept that stood there and was none.
    pub kept: Option<u32>,
    /// What is other than before; nothing where no version was made.
    pub changes: Vec<Difference>,
}

/// Whether a rig is a person's own, which may be written to.
pub fn is_own(rig: &str) -> bool {
    rig_folder(rig).is_some_and(|folder| shipped(&folder).is_none())
}

/// The versions of a rig.
#[derive(Debug, Clone)]
pub struct Versions {
    rig: PathBuf,
}

impl Versions {
    /// Of a rig as it was named.
    ///
    /// # Errors
    ///
    /// Where it is in no folder.
    pub fn of(rig: &str) -> Result<Self, Error> {
        let nowhere = || {
            let message = "is no folder, and what is built in has no versions; accepted is a rig of your own: `pigtail rig \
                           my-rig` makes one";
            Error::new(rig, "", message)
        };
        let rig = rig_folder(rig).ok_or_else(nowhere)?;
        Ok(Self { rig })
    }

    /// Of a rig that may be written to.
    ///
    /// # Errors
    ///
    /// Where it is built in, is the one that ships, or cannot be written.
    pub fn writable(rig: &str) -> Result<Self, Error> {
        let own = "accepted is a rig of your own: `pigtail rig my-rig` makes one, then name it with --rig my-rig";
        let Some(folder) = rig_folder(rig) else {
            let what = if is_built_in(rig) {
                "is built in, and never written to"
            } else {
                "is no rig"
            };
            let message = format!("{what}; {own}");
            return Err(Error::new(rig, "", message));
        };
        if let Some(marker) = shipped(&folder) {
            let message = format!(
                "marks the rig that ships, which is never written to; {own} (in a copy that you made yourself, \
                 remove this file)"
            );
            return Err(Error::new(marker.display().to_string(), "", message));
        }
        let versions = Self { rig: folder };
        drop(versions.lock()?);
        Ok(versions)
    }

    fn folder(&self, version: u32) -> PathBuf {
        self.rig.join(FOLDER).join(format!("{version:04}"))
    }

    /// The belief that the rig has now.
    ///
    /// # Errors
    ///
    /// When it cannot be read.
    pub fn current(&self) -> Result<Belief, Error> {
        Belief::read(&self.rig.join(FILE))
    }

    /// Whether a calibration fits the rig's datasheet.
    fn check(&self, belief: &Belief) -> Result<(), Error> {
        let path = self.rig.join(FILES[0]);
        let name = path.display().to_string();
        let text = fs::read_to_string(&path)
            .map_err(|error| Error::new(&name, "", format!("cannot be read: {error}")))?;
        if BenchSpec::is_of(&name, &text)? {
            let spec = BenchSpec::parse(&name, &text)?;
            return BenchCalibration::parse(&belief.name, &belief.text, &spec).map(drop);
        }
        belief.check(&Spec::parse(&name, &text)?)
    }

    /// The numbers that there are, ascending.
    fn numbers(&self) -> Vec<u32> {
        let entries = fs::read_dir(self.rig.join(FOLDER));
        let names = entries.into_iter().flatten().flatten();
        let number = |entry: fs::DirEntry| entry.file_name().to_str()?.parse().ok();
        let mut numbers: Vec<u32> = names.filter_map(number).collect();
        numbers.sort_unstable();
        numbers
    }

    fn about(&self, version: u32) -> Result<About, Error> {
        about_in(&self.folder(version))
    }

    /// A version, and what is said of it.
    ///
    /// # Errors
    ///
    /// When there is none of this number, or it is not as it was written.
    pub fn version(&self, version: u32) -> Result<(About, Belief), Error> {
        let numbers = self.numbers();
        if !numbers.contains(&version) {
            let message = match (numbers.first(), numbers.last()) {
                (Some(first), Some(last)) => format!(
                    "has no version {version}; accepted is one of {first} to {last}, as `pigtail calibration list` \
                     has them"
                ),
                _ => format!(
                    "has no version {version}: none has been written yet; accepted is the calibration as it is"
                ),
            };
            return Err(Error::new(self.rig.display().to_string(), "", message));
        }
        let folder = self.folder(version);
        let about = about_in(&folder)?;
        Ok((about.clone(), verified(&folder, &about)?))
    }

    /// All versions, the oldest first.
    ///
    /// # Errors
    ///
    /// When the rig's calibration or what is said of a version cannot be read.
    pub fn list(&self) -> Result<Vec<Listed>, Error> {
        let now = self.number_of(&self.current()?);
        let listed = |version: u32| {
            let about = self.about(version)?;
            let damage = verified(&self.folder(version), &about).err();
            Ok(Listed {
                sha256: about.sha256().to_owned(),
                current: now == Some(version),
                damage: damage.map(|error| error.to_string()),
                about,
            })
        };
        self.numbers().into_iter().map(listed).collect()
    }

    /// The newest version that a belief is.
    pub fn number_of(&self, belief: &Belief) -> Option<u32> {
        let same = |version: &u32| self.about(*version).is_ok_and(|about| about.is_of(belief));
        self.numbers().into_iter().rev().find(same)
    }

    /// The newest version that a rig believes which read a calibration of this SHA-256.
    fn number_by(&self, sha256: &str, rig: &Rig) -> Option<u32> {
        let same = |version: &u32| {
            self.about(*version).is_ok_and(|about| {
                let mut weights = rig.weights();
                about.has(FILE, sha256) && weights.all(|(name, text)| about.has(name, &hash(text)))
            })
        };
        self.numbers().into_iter().rev().find(same)
    }

    /// The newest version, if there is any.
    pub fn newest(&self) -> Option<u32> {
        self.numbers().pop()
    }

    /// Makes a new version of the current calibration by a change, and the rig believes it. A current calibration
    /// that is no version is kept as one first. Where nothing changes nothing is written.
    ///
    /// # Errors
    ///
    /// When the change cannot be made, its result is no calibration, or it cannot be written.
    pub fn write(
        &self,
        origin: &Origin,
        change: impl FnOnce(&mut Belief) -> Result<(), Error>,
    ) -> Result<Written, Error> {
        let mut last = self.lock()?;
        let before = self.current()?;
        let mut belief = before.clone();
        change(&mut belief)?;
        belief.name_by_content()?;
        self.check(&belief)?;
        let file = self.rig.join(FILE);
        // From what is not TOML everything differs.
        let readable = before.document().is_ok();
        let nothing = Belief::of("", String::new(), |_| None);
        let changes = differences(if readable { &before } else { &nothing }, &belief)?;
        let kept = match self.number_of(&before) {
            Some(version) if changes.is_empty() => {
                return Ok(Written {
                    version,
                    file: file.display().to_string(),
                    sha256: hash(&before.text),
                    kept: None,
                    changes,
                });
            }
            Some(_) => None,
            None => {
                let by_hand = Origin {
                    what: match self.newest() {
                        Some(_) => "by hand".to_owned(),
                        None => "as it was before".to_owned(),
                    },
                    run: None,
                    ..origin.clone()
                };
                let newest = self.newest().and_then(|newest| self.version(newest).ok());
                let newest = newest.map_or(nothing, |(_, newest)| newest);
                let tables = differences(&newest, &before).unwrap_or_default();
                let tables = tables_of(&tables);
                let mut plain = before.clone();
                // A version's files stand beside each other.
                if before
                    .weights
                    .iter()
                    .any(|(file, _)| file.contains(['/', '\\']))
                {
                    plain.name_by_content()?;
                }
                Some(self.keep(&mut last, &plain, &by_hand, tables)?)
            }
        };
        let version = self.keep(&mut last, &belief, origin, tables_of(&changes))?;
        for (name, content) in &belief.weights {
            write_whole(&self.rig.join(name), content)?;
        }
        write_whole(&file, &belief.text)?;
        Ok(Written {
            version,
            file: file.display().to_string(),
            sha256: hash(&belief.text),
            kept,
            changes,
        })
    }

    /// Makes an old version current again, as a new one.
    ///
    /// # Errors
    ///
    /// As [`Self::version`] and [`Self::write`].
    pub fn rollback(&self, version: u32, date: &str) -> Result<Written, Error> {
        let (_, old) = self.version(version)?;
        let origin = Origin {
            what: format!("calibration rollback {version}"),
            date: date.to_owned(),
            run: None,
        };
        self.write(&origin, |belief| {
            *belief = old;
            Ok(())
        })
    }

    /// Takes what a run found, or a whole calibration, into the rig.
    ///
    /// # Errors
    ///
    /// As [`Self::write`].
    pub fn apply(&self, found: &Found, date: &str) -> Result<Written, Error> {
        let run = found.about.as_ref().and_then(|about| about.run.clone());
        let origin = Origin {
            what: match &run {
                Some(_) => "calibration apply".to_owned(),
                None => format!("calibration apply {}", found.named),
            },
            date: date.to_owned(),
            run,
        };
        self.write(&origin, |belief| match &found.about {
            // What else was believed when it ran is no finding of the run.
            Some(about) if about.version.is_none() => about
                .tables
                .iter()
                .try_for_each(|table| belief.take(&found.belief, table)),
            _ => {
                belief.clone_from(&found.belief);
                Ok(())
            }
        })
    }

    /// Writes a version, which nobody believes yet.
    fn keep(
        &self,
        last: &mut File,
        belief: &Belief,
        origin: &Origin,
        tables: Vec<String>,
    ) -> Result<u32, Error> {
        let name = self.rig.join(FOLDER).join(LAST);
        let failed = |error: std::io::Error| cannot_write(&name, &error);
        let mut text = String::new();
        last.rewind().map_err(failed)?;
        last.read_to_string(&mut text).map_err(failed)?;
        let given: u32 = text.trim().parse().unwrap_or(0);
        let version = 1 + given.max(self.newest().unwrap_or(0));
        last.rewind().map_err(failed)?;
        last.write_all(format!("{version}\n").as_bytes())
            .and_then(|()| last.sync_all())
            .map_err(failed)?;
        let about = About {
            version: Some(version),
            ..About::of(belief, origin, tables)
        };
        let folder = self.folder(version);
        let partial = folder.with_extension(format!("partial-{}", std::process::id()));
        let write = || -> Result<(), Error> {
            fs::create_dir_all(&partial).map_err(|error| cannot_write(&partial, &error))?;
            for (file, text) in belief.files() {
                write_whole(&partial.join(file), text)?;
            }
            let json = serde_json::to_string_pretty(&about)
                .map_err(|error| cannot_write(&partial, &error.into()))?;
            write_whole(&partial.join(ABOUT), &(json + "\n"))?;
            fs::rename(&partial, &folder).map_err(|error| cannot_write(&folder, &error))
        };
        write().inspect_err(|_| {
            // The error is what the user has to know.
            let _ = fs::remove_dir_all(&partial);
        })?;
        Ok(version)
    }

    /// Waits until nobody else writes.
    fn lock(&self) -> Result<File, Error> {
        let folder = self.rig.join(FOLDER);
        let path = folder.join(LAST);
        let open = || {
            fs::create_dir_all(&folder)?;
            let mut options = File::options();
            options.read(true).write(true).create(true).truncate(false);
            let file = options.open(&path)?;
            // Not every file system has locks.
            let _ = file.lock();
            Ok(file)
        };
        open().map_err(|error| cannot_write(&path, &error))
    }
}

/// The tables in which there are differences, each once.
fn tables_of(differences: &[Difference]) -> Vec<String> {
    let mut tables: Vec<_> = differences.iter().map(|d| d.table.clone()).collect();
    tables.dedup();
    tables
}

fn cannot_write(path: &Path, error: &std::io::Error) -> Error {
    Error::new(
        path.display().to_string(),
        "",
        format!("cannot be written: {error}"),
    )
}

/// Writes a file whole or not at all.
fn write_whole(path: &Path, text: &str) -> Result<(), Error> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(format!(".partial-{}", std::process::id()));
    let write = || {
        let mut file = File::create(&partial)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&partial, path)
    };
    write().map_err(|error| {
        // The error is what the user has to know.
        let _ = fs::remove_file(&partial);
        cannot_write(path, &error)
    })
}

/// What is said of the belief in a folder.
fn about_in(folder: &Path) -> Result<About, Error> {
    let path = folder.join(ABOUT);
    let name = path.display().to_string();
    let text = fs::read_to_string(&path)
        .map_err(|error| Error::new(&name, "", format!("cannot be read: {error}")))?;
    serde_json::from_str(&text).map_err(|error| {
        let message =
            format!("{error}; accepted is what was written with the calibration beside it");
        Error {
            line: Some(error.line()).filter(|line| *line > 0),
            ..Error::new(&name, "", message)
        }
    })
}

/// The belief in a folder, which must be what is said of it.
fn verified(folder: &Path, about: &About) -> Result<Belief, Error> {
    for FileHash { file, sha256 } in &about.files {
        let path = folder.join(file);
        let name = path.display().to_string();
        let content = fs::read(&path)
            .map_err(|error| Error::new(&name, "", format!("cannot be read: {error}")))?;
        let is = hash(content);
        if is != *sha256 {
            let message = format!(
                "has been changed since it was written: its SHA-256 is {}, {ABOUT} says {}; accepted is the file as \
                 it was, or another version",
                &is[..SHORT],
                sha256.get(..SHORT).unwrap_or(sha256)
            );
            return Err(Error::new(name, "", message));
        }
    }
    Belief::read(&folder.join(FILE))
}
