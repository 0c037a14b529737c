//! The store of runs: how every device was aligned, for as long as the folder of runs is kept.
//!
//! One SQLite database, `pigtail.db`, beside the runs' folders. A run is entered when it begins, a
//! phase when it ends, everything else when the run does, each in one transaction; so whatever
//! happens to a process, what it entered stays. Any number of processes may read and write at once:
//! the database keeps a log of its own (WAL), and who has to wait waits. When a run ends, the hash
//! of each of its files is entered, and at last a seal, a hash over all that the store says of it.
//!
//! - [`Database`]: the database; `entry`: one run in it, while it is being written;
//! - `schema`: the tables;
//! - [`query`]: what is read back; [`verify`]: whether it is still what was written;
//!   [`export`]: its rows for other programs.

mod entry;
pub mod export;
mod files;
pub mod query;
mod schema;
pub mod verify;

pub use entry::{Aligned, AlignedFiber, Devices, Pigtail, State};
pub use entry::{Beginning, End, Entry};
pub use files::FileHash;
pub use files::{LOCK, hash_all};

use anyhow::{Context, Result};
use pigtail_hal::Error;
use rusqlite::{Connection, ErrorCode, OpenFlags, Transaction, TransactionBehavior};
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// The database in a folder of runs.
pub const FILE: &str = "pigtail.db";

/// How long who has to wait waits.
const PATIENCE: Duration = Duration::from_secs(30);

/// The database of a folder of runs.
#[derive(Debug)]
pub struct Database {
    connection: Connection,
    runs: PathBuf,
    /// Held as long as the connection: only an exclusive holder may remove the database.
    guard: Option<File>,
}

impl Database {
    /// Opens the store of a folder of runs, for writing and reading; `None` where it has none.
    ///
    /// # Errors
    ///
    /// When it is damaged, newer than this program, not a store, or cannot be opened.
    pub fn open(runs: &Path) -> Result<Option<Self>, Error> {
        let guard = guard(runs);
        Self::open_guarded(runs, guard)
    }

    /// The same, and makes one where there is none.
    ///
    /// # Errors
    ///
    /// As [`Database::open`], and when none can be made.
    pub fn open_or_create(runs: &Path) -> Result<Self, Error> {
        let path = runs.join(FILE);
        let guard = guard(runs);
        if !path.exists() {
            create(runs).map_err(|why| {
                Error::new(
                    path.display().to_string(),
                    "",
                    format!("cannot be made ({why:#}); accepted is a writable folder on a disk with room"),
                )
            })?;
        }
        Self::open_guarded(runs, guard)?.ok_or_else(|| {
            let message =
                "was there and is gone; accepted is a folder that nobody clears meanwhile";
            Error::new(path.display().to_string(), "", message)
        })
    }

    fn open_guarded(runs: &Path, guard: Option<File>) -> Result<Option<Self>, Error> {
        let path = runs.join(FILE);
        match fs::metadata(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            // SQLite would take it for a new one, and what was in it would be lost without a word.
            Ok(file) if file.is_file() && file.len() == 0 => {
                return Err(damaged(&path, "it is empty"));
            }
            _ => {}
        }
        let connection = connect(&path).map_err(|error| explain(&path, &error))?;
        let database = Self {
            connection,
            runs: runs.to_owned(),
            guard,
        };
        database.check()?;
        Ok(Some(database))
    }

    /// Whether this is a store that this program understands; an older one is made one of today.
    fn check(&self) -> Result<(), Error> {
        let name = self.path().display().to_string();
        let read = |pragma| {
            self.connection
                .pragma_query_value(None, pragma, |row| row.get::<_, i64>(0))
                .map_err(|error| self.explain(&error))
        };
        let application = read("application_id")?;
        if application != i64::from(schema::APPLICATION) {
            let message = "is a database, but no store of runs; accepted is the one that pigtail \
                           wrote: move this one elsewhere";
            return Err(Error::new(name, "", message));
        }
        let (version, ours) = (
            read("user_version")?,
            i64::try_from(schema::STEPS.len()).unwrap_or(i64::MAX),
        );
        if version > ours {
            return Err(Error::new(
                name,
                "user_version",
                format!(
                    "was written by a newer pigtail (version {version} of the tables); accepted by \
                     pigtail {} is up to version {ours}: use the newer program, nothing was changed",
                    env!("CARGO_PKG_VERSION")
                ),
            ));
        }
        if version < ours {
            schema::migrate(&self.connection, schema::STEPS).map_err(|e| self.explain(&e))?;
        }
        Ok(())
    }

    /// The database's file.
    pub fn path(&self) -> PathBuf {
        self.runs.join(FILE)
    }

    /// The folder of runs.
    pub fn runs(&self) -> &Path {
        &self.runs
    }

    fn explain(&self, error: &rusqlite::Error) -> Error {
        explain(&self.path(), error)
    }

    /// Does `work` in one transaction that may write.
    fn write<T>(&self, work: impl FnOnce(&Connection) -> rusqlite::Result<T>) -> Result<T, Error> {
        let run = || {
            let transaction =
                Transaction::new_unchecked(&self.connection, TransactionBehavior::Immediate)?;
            let done = work(&transaction)?;
            transaction.commit()?;
            Ok(done)
        };
        run().map_err(|error| self.explain(&error))
    }

    /// Reads by `work`, as everything was at one moment.
    fn read<T>(&self, work: impl FnOnce(&Connection) -> rusqlite::Result<T>) -> Result<T, Error> {
        let run = || {
            let transaction =
                Transaction::new_unchecked(&self.connection, TransactionBehavior::Deferred)?;
            work(&transaction)
        };
        run().map_err(|error| self.explain(&error))
    }

    /// Takes a store away again in which nothing was ever kept, where nobody else has it open: input
    /// that was bad leaves nothing behind.
    fn remove_if_unused(self) {
        let Self {
            connection,
            runs,
            guard,
        } = self;
        drop(connection);
        let Some(guard) = guard else { return };
        // Who comes now waits until this guard is gone, and then makes a new store.
        if guard.unlock().is_err() || guard.try_lock().is_err() {
            return;
        }
        let path = runs.join(FILE);
        let unused = connect(&path).and_then(|connection| {
            connection.query_row(
                "SELECT (SELECT count(*) FROM runs) + (SELECT count(*) FROM seals) = 0",
                [],
                |row| row.get(0),
            )
        });
        // Its log goes when the last connection does; where one is left, somebody has it open.
        let log = runs.join(format!("{FILE}-wal"));
        if unused == Ok(true) && !log.exists() {
            // Left behind it does no harm.
            let _ = fs::remove_file(path);
        }
    }
}

/// Holds a folder of runs against the removal of its store. Where folders cannot be locked nobody
/// removes one.
fn guard(runs: &Path) -> Option<File> {
    let folder = File::open(runs).ok()?;
    folder.lock_shared().ok()?;
    Some(folder)
}

fn connect(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let open = |path: &Path, flags| {
        let connection = Connection::open_with_flags(path, flags)?;
        connection.busy_timeout(PATIENCE)?;
        connection.pragma_update(None, "foreign_keys", true)?;
        // The log is synced when it goes into the database, at the latest when a run ends.
        connection.pragma_update(None, "synchronous", "NORMAL")?;
        schema::version(&connection)?;
        Ok(connection)
    };
    match open(path, flags) {
        // Where nothing can be written, not even beside it, a store can still be read: nobody
        // changes it meanwhile, and all of it is in it.
        Err(error) if cannot_write(&error) && !has_log(path) => {
            let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
                | OpenFlags::SQLITE_OPEN_NO_MUTEX
                | OpenFlags::SQLITE_OPEN_URI;
            open(Path::new(&immutable(path)), flags).map_err(|_| error)
        }
        other => other,
    }
}

/// Whether something was entered that is not in the database itself yet.
fn has_log(path: &Path) -> bool {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    fs::metadata(log).is_ok_and(|log| log.len() > 0)
}

fn cannot_write(error: &rusqlite::Error) -> bool {
    matches!(
        error.sqlite_error_code(),
        Some(
            ErrorCode::CannotOpen
                | ErrorCode::ReadOnly
                | ErrorCode::PermissionDenied
                | ErrorCode::DiskFull
                | ErrorCode::SystemIoFailure
        )
    )
}

/// A path as SQLite's URI of a file that does not change.
fn immutable(path: &Path) -> String {
    let path = path.to_string_lossy();
    let path = path
        .replace('%', "%25")
        .replace('?', "%3f")
        .replace('#', "%23");
    format!("file:{path}?immutable=1")
}

/// Makes an empty store: beside its place, and moved there whole, so that nobody ever finds half of
/// one. Whoever was quicker wins.
fn create(runs: &Path) -> Result<()> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let partial = runs.join(format!(".{FILE}.{}-{number}.partial", std::process::id()));
    let made = (|| {
        let connection = Connection::open(&partial)?;
        connection.pragma_update(None, "application_id", schema::APPLICATION)?;
        schema::migrate(&connection, schema::STEPS)?;
        connection.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(()))?;
        connection.close().map_err(|(_, error)| error)?;
        let path = runs.join(FILE);
        match fs::hard_link(&partial, &path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
            // Not every file system has links.
            Err(_) if !path.exists() => fs::rename(&partial, &path).context("it cannot be moved"),
            other => other.context("it cannot be moved"),
        }
    })();
    for end in ["", "-wal", "-shm", "-journal"] {
        let mut name = partial.as_os_str().to_owned();
        name.push(end);
        // Most of them are not there.
        let _ = fs::remove_file(name);
    }
    made
}

/// Whether a process is at a run: the lock in its folder is held. Where locks do not work, it is
/// believed to be.
fn is_held(runs: &Path, name: &str) -> bool {
    [partial_folder(runs, name), runs.join(name)]
        .iter()
        .filter_map(|folder| File::open(folder.join(LOCK)).ok())
        .any(|lock| match lock.try_lock_shared() {
            Ok(()) => false,
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => true,
        })
}

/// Where a run is while it is being written.
pub fn partial_folder(runs: &Path, name: &str) -> PathBuf {
    runs.join(format!(".{name}.partial"))
}

fn damaged(path: &Path, why: &str) -> Error {
    // SQLite cites what it cannot understand, lines and all.
    let why = why.split_whitespace().collect::<Vec<_>>().join(" ");
    Error::new(
        path.display().to_string(),
        "",
        format!(
            "the store of runs is damaged ({why}); nothing was changed. The runs' folders are whole \
             without it: put a copy of it from a backup here, or move it away with its {FILE}-wal \
             and -shm, try `sqlite3 {FILE} .recover` on it, and a new one is begun"
        ),
    )
}

/// What SQLite says, for a person.
fn explain(path: &Path, error: &rusqlite::Error) -> Error {
    let says = |what: &str| Error::new(path.display().to_string(), "", what);
    match error.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => damaged(path, "it is no database"),
        Some(ErrorCode::DiskFull) => says(
            "cannot be written: the disk is full; what was entered before is kept. Accepted is a \
             disk with room",
        ),
        Some(ErrorCode::ReadOnly | ErrorCode::CannotOpen | ErrorCode::PermissionDenied) => {
            says(&format!(
                "cannot be opened or written ({error}); accepted is a file that may be written, in a \
                 folder that may, on a disk with room"
            ))
        }
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => says(&format!(
            "another process has been writing to it for {} s; try again when it has ended",
            PATIENCE.as_secs()
        )),
        Some(ErrorCode::SystemIoFailure) => says(&format!(
            "cannot be read or written ({error}); what was entered before is kept. Accepted is a disk \
             that works and has room"
        )),
        // It says so itself, or has not the tables, columns and values that we write.
        _ => damaged(path, &error.to_string()),
    }
}
