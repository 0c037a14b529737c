//! Whether runs are still what was written.

use super::query::{files as files_of, folders};
use super::{Database, damaged, files, schema};
use pigtail_hal::Error;
use rusqlite::Connection;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// What was looked at, and what is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verified {
    /// Runs of which everything was hashed again.
    pub runs: usize,
    /// Their files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Runs that were interrupted or are running: nothing says what their files should be.
    pub not_sealed: Vec<String>,
    /// Runs of which the store knows nothing.
    pub not_in_store: Vec<String>,
    /// What is not as it was written.
    pub problems: Vec<Problem>,
}

/// Something that is not as it was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// The run.
    pub run: String,
    /// The file; `null` where the store is meant.
    pub file: Option<String>,
    /// What is wrong.
    pub what: String,
}

impl Verified {
    /// Runs of which the store knows something, or should.
    pub fn looked_at(&self) -> usize {
        self.runs + self.not_sealed.len() + self.problems.len()
    }

    /// Whether all is as it was written.
    pub fn is_well(&self) -> bool {
        self.problems.is_empty()
    }
}

/// What the store says that has to be checked against the folder of a run.
struct Sealed {
    name: String,
    files: Vec<files::FileHash>,
}

impl Database {
    /// Hashes all that the store says and all files again, of one run or of all.
    ///
    /// # Errors
    ///
    /// When the database itself is damaged or cannot be read.
    pub fn verify(&self, only: Option<&str>) -> Result<Verified, Error> {
        self.check_integrity()?;
        let mut verified = Verified {
            runs: 0,
            files: 0,
            bytes: 0,
            not_sealed: Vec::new(),
            not_in_store: folders(self.runs())?,
            problems: Vec::new(),
        };
        let mut there = BTreeSet::new();
        let mut sealed = Vec::new();
        self.read(|store| {
            let seals = seals(store)?;
            let mut statement = store.prepare("SELECT id, name, state FROM runs ORDER BY id")?;
            let mut rows = statement.query([])?;
            while let Some(row) = rows.next()? {
                let (run, name): (i64, String) = (row.get(0)?, row.get(1)?);
                there.insert(name.clone());
                if only.is_some_and(|only| only != name) {
                    continue;
                }
                let seal = seals.get(&name);
                match seal {
                    Some(seal) if *seal == schema::seal(store, run)? => {}
                    Some(_) => verified.row(&name, "what the store says of it was changed"),
                    None if row.get::<_, String>(2)? == "running" => {
                        verified.not_sealed.push(name);
                        continue;
                    }
                    None => verified.row(&name, "its seal is gone from the store"),
                }
                let files = files_of(store, run)?;
                sealed.push(Sealed { name, files });
            }
            for name in seals.keys().filter(|name| !there.contains(*name)) {
                if only.is_none_or(|only| only == name) {
                    verified.row(name, "it was sealed, and is gone from the store");
                }
            }
            let orphans = |row: &rusqlite::Row| row.get::<_, String>(0);
            let mut check = store.prepare("PRAGMA foreign_key_check")?;
            let orphans: BTreeSet<String> =
                check.query_map([], orphans)?.collect::<Result<_, _>>()?;
            for table in orphans {
                verified.row("(no run)", &format!("rows of {table} belong to no run"));
            }
            Ok(())
        })?;
        for run in &sealed {
            self.verify_files(run, &mut verified);
        }
        let is_meant = |name: &String| only.is_none_or(|only| only == name);
        verified
            .not_in_store
            .retain(|name| !there.contains(name) && is_meant(name));
        Ok(verified)
    }

    /// SQLite's own word on the database, once its tables are known to be those that we ask for.
    fn check_integrity(&self) -> Result<(), Error> {
        if !self.read(schema::is_ours)? {
            return Err(damaged(
                &self.path(),
                "its tables are not those that pigtail made",
            ));
        }
        let found: String =
            self.read(|store| store.query_row("PRAGMA integrity_check(1)", [], |row| row.get(0)))?;
        if found == "ok" {
            Ok(())
        } else {
            Err(damaged(&self.path(), &found))
        }
    }

    fn verify_files(&self, run: &Sealed, verified: &mut Verified) {
        let folder = self.folder_of(&run.name);
        verified.runs += 1;
        let there = match files::list(&folder) {
            Ok(there) => there,
            Err(error) => {
                let what = format!("{}: cannot be read: {error}", folder.display());
                verified.row(&run.name, &what);
                return;
            }
        };
        for file in &run.files {
            verified.files += 1;
            let what = match files::hash(&folder.join(&file.path)) {
                Ok((bytes, _)) if bytes != file.bytes => {
                    format!("has {bytes} bytes, and was written with {}", file.bytes)
                }
                Ok((_, hash)) if hash != file.sha256 => format!(
                    "was changed: its SHA-256 is {}..., and was {}...",
                    short(&hash),
                    short(&file.sha256)
                ),
                Ok((bytes, _)) => {
                    verified.bytes += bytes;
                    continue;
                }
                Err(error) => format!("cannot be read: {error}"),
            };
            verified.file(&run.name, &file.path, what);
        }
        for path in there {
            if !run.files.iter().any(|file| file.path == path) {
                verified.file(&run.name, &path, "was not written by the run".to_owned());
            }
        }
    }
}

impl Verified {
    fn row(&mut self, run: &str, what: &str) {
        self.problems.push(Problem {
            run: run.to_owned(),
            file: None,
            what: what.to_owned(),
        });
    }

    fn file(&mut self, run: &str, file: &str, what: String) {
        self.problems.push(Problem {
            run: run.to_owned(),
            file: Some(file.to_owned()),
            what,
        });
    }
}

fn seals(store: &Connection) -> rusqlite::Result<BTreeMap<String, String>> {
    store
        .prepare("SELECT name, sha256 FROM seals")?
        .query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?
        .collect()
}

fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}

/// What there is to say of a folder of runs without a store.
///
/// # Errors
///
/// When the folder cannot be read.
pub fn without_store(runs: &Path) -> Result<Verified, Error> {
    Ok(Verified {
        runs: 0,
        files: 0,
        bytes: 0,
        not_sealed: Vec::new(),
        not_in_store: folders(runs)?,
        problems: Vec::new(),
    })
}
