//! What the store says of the runs.

use super::{Database, FILE, FileHash, LOCK, State, is_held, partial_folder};
use pigtail_hal::Error;
use rusqlite::{Connection, OptionalExtension, Row};
use serde::Serialize;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A run in the list of runs. Keys are a contract, as in every document.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Listed {
    /// The name of its folder.
    pub run: String,
    /// The command, such as `align` or `identify windup`.
    pub kind: String,
    /// Its seed, in decimals: it may be beyond what JSON's readers hold.
    pub seed: String,
    /// How many devices it is about: with seeds from `seed` on.
    pub devices: u64,
    /// How far it came.
    pub state: State,
    /// How it ended, in a few words; `null` before that.
    pub outcome: Option<String>,
    /// Machine time of its fibers, seconds; `null` where there are none.
    pub machine_seconds: Option<f64>,
    /// How long the program was at it, seconds; `null` before its end.
    pub wall_seconds: Option<f64>,
    /// When it began, in RFC 3339.
    pub started: String,
    /// When it ended; `null` before that.
    pub finished: Option<String>,
    /// The program's version.
    pub version: String,
}

/// All that the store says of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shown {
    /// What the list says.
    #[serde(flatten)]
    pub listed: Listed,
    /// Where its files are.
    pub folder: PathBuf,
    /// The command line.
    pub command: Vec<String>,
    /// Everything that was read.
    pub configuration: Vec<Configuration>,
    /// Its device, or a campaign's first.
    pub device: Option<Device>,
    /// The fibers, with their phases.
    pub fibers: Vec<Fiber>,
    /// The fibers of a tray, as they were produced.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pigtails: Vec<Produced>,
    /// The calibrations that it wrote.
    pub calibrations: Vec<Calibration>,
    /// What the machine stopped for.
    pub faults: Vec<FaultRow>,
    /// The files that it left.
    pub files: Vec<FileHash>,
    /// The hash over all of this; `null` before its end.
    pub seal: Option<String>,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Configuration {
    /// Its name.
    pub file: String,
    /// SHA-256 of its content.
    pub sha256: String,
    /// The last run before this that wrote a calibration of this content; `null` where none did.
    pub written_by: Option<String>,
}

/// What was aligned and how.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Device {
    /// The seed, in decimals.
    pub seed: String,
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// How it was aligned.
    pub procedure: String,
    /// How the truth was changed.
    pub scenario: String,
    /// Whether anything touched the chip: the truth.
    pub collision: Option<bool>,
    /// The least distance of anything from the chip: the truth.
    pub smallest_gap_um: Option<f64>,
}

/// A fiber, as far as it came.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fiber {
    /// The port.
    pub port: String,
    /// What control says of it; `null` where the run ended before it did.
    pub outcome: Option<String>,
    /// The same in a sentence.
    pub detail: Option<String>,
    /// Its machine time, seconds; of the phases that are known where the run ended before it did.
    pub seconds: f64,
    /// Where it really is: across the chip, up from it, and gap beyond the wanted one.
    pub offset_um: [Option<f64>; 3],
    /// Loss at this interface, decibels: the truth.
    pub coupling_loss_db: Option<f64>,
    /// Whether it really is where it should be.
    pub within_tolerance: Option<bool>,
    /// Its phases, as they came.
    pub phases: Vec<Phase>,
}

/// A phase of a fiber.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Phase {
    /// Its name.
    pub name: String,
    /// When it began, seconds of machine time.
    pub start_s: f64,
    /// How long it took, seconds of machine time.
    pub seconds: f64,
}

/// A calibration that was written.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibration {
    /// The file.
    pub file: String,
    /// The table of it that was written.
    pub table: String,
    /// SHA-256 of the whole file afterwards.
    pub sha256: String,
}

/// What the machine stopped for.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FaultRow {
    /// The rule that was broken.
    pub rule: String,
    /// The axis or instrument.
    pub axis: String,
    /// The value, with its unit.
    pub value: String,
    /// What would have been accepted.
    pub limit: String,
    /// Machine time, seconds.
    pub time_s: f64,
}

const LISTED: &str = "SELECT id, name, kind, seed, state, outcome, machine_seconds, wall_seconds,
    started, finished, version, coalesce((SELECT sum(count) FROM devices WHERE run = id), 0)
    FROM runs";

fn listed(row: &Row) -> rusqlite::Result<(i64, Listed)> {
    let state: String = row.get("state")?;
    let listed = Listed {
        run: row.get("name")?,
        kind: row.get("kind")?,
        seed: row.get("seed")?,
        devices: count(row, 11)?,
        state: match state.as_str() {
            "complete" => State::Complete,
            "interrupted" => State::Interrupted,
            "fault" => State::Fault,
            _ => State::Running,
        },
        outcome: row.get("outcome")?,
        machine_seconds: row.get("machine_seconds")?,
        wall_seconds: row.get("wall_seconds")?,
        started: row.get("started")?,
        finished: row.get("finished")?,
        version: row.get("version")?,
    };
    Ok((row.get("id")?, listed))
}

impl Database {
    /// All runs, in the order in which they began.
    ///
    /// # Errors
    ///
    /// When the store cannot be read.
    pub fn runs_listed(&self) -> Result<Vec<Listed>, Error> {
        let mut runs = self.read(|store| {
            let mut statement = store.prepare(&format!("{LISTED} ORDER BY id"))?;
            let rows = statement.query_map([], listed)?;
            rows.map(|row| row.map(|(_, run)| run))
                .collect::<rusqlite::Result<Vec<_>>>()
        })?;
        for run in &mut runs {
            self.see_whether_it_runs(run);
        }
        Ok(runs)
    }

    /// All that is known of a run; `None` where none has that name.
    ///
    /// # Errors
    ///
    /// When the store cannot be read.
    pub fn shown(&self, name: &str) -> Result<Option<Shown>, Error> {
        let shown = self.read(|store| {
            let run = store
                .query_row(&format!("{LISTED} WHERE name = ?1"), [name], listed)
                .optional()?;
            run.map(|(run, listed)| self.show(store, run, listed))
                .transpose()
        })?;
        Ok(shown.map(|mut shown| {
            self.see_whether_it_runs(&mut shown.listed);
            shown
        }))
    }

    /// A run whose process is gone did not come to its end, whatever it could still say.
    fn see_whether_it_runs(&self, run: &mut Listed) {
        if run.state == State::Running && !is_held(self.runs(), &run.run) {
            run.state = State::Interrupted;
        }
    }

    /// Where a run's files are: hidden, where it was interrupted.
    pub(super) fn folder_of(&self, name: &str) -> PathBuf {
        let (hidden, folder) = (partial_folder(self.runs(), name), self.runs().join(name));
        if !folder.exists() && hidden.exists() {
            hidden
        } else {
            folder
        }
    }

    fn show(&self, store: &Connection, run: i64, listed: Listed) -> rusqlite::Result<Shown> {
        let command: String =
            store.query_row("SELECT command FROM runs WHERE id = ?1", [run], |r| {
                r.get(0)
            })?;
        Ok(Shown {
            folder: self.folder_of(&listed.run),
            // One that was changed is no list; verify says so.
            command: serde_json::from_str(&command).unwrap_or_else(|_| vec![command]),
            configuration: all(
                store,
                "SELECT file, sha256, (SELECT runs.name FROM calibrations
                    JOIN runs ON runs.id = calibrations.run
                    WHERE calibrations.sha256 = configurations.sha256 AND runs.id < ?1
                    ORDER BY runs.id DESC LIMIT 1)
                 FROM configurations WHERE run = ?1 ORDER BY ordinal",
                run,
                |row| {
                    Ok(Configuration {
                        file: row.get(0)?,
                        sha256: row.get(1)?,
                        written_by: row.get(2)?,
                    })
                },
            )?,
            device: all(
                store,
                "SELECT seed, rig, recipe, procedure, scenario, collision, smallest_gap_um
                 FROM devices WHERE run = ?1 ORDER BY ordinal",
                run,
                |row| {
                    Ok(Device {
                        seed: row.get(0)?,
                        rig: row.get(1)?,
                        recipe: row.get(2)?,
                        procedure: row.get(3)?,
                        scenario: row.get(4)?,
                        collision: row.get(5)?,
                        smallest_gap_um: row.get(6)?,
                    })
                },
            )?
            .into_iter()
            .next(),
            fibers: fibers(store, run)?,
            pigtails: pigtails(store, run)?,
            calibrations: all(
                store,
                "SELECT file, entry, sha256 FROM calibrations WHERE run = ?1 ORDER BY ordinal",
                run,
                |row| {
                    Ok(Calibration {
                        file: row.get(0)?,
                        table: row.get(1)?,
                        sha256: row.get(2)?,
                    })
                },
            )?,
            faults: all(
                store,
                "SELECT rule, axis, value, accepted, time_s FROM faults WHERE run = ?1
                 ORDER BY ordinal",
                run,
                |row| {
                    Ok(FaultRow {
                        rule: row.get(0)?,
                        axis: row.get(1)?,
                        value: row.get(2)?,
                        limit: row.get(3)?,
                        time_s: row.get(4)?,
                    })
                },
            )?,
            files: files(store, run)?,
            seal: store
                .query_row(
                    "SELECT sha256 FROM seals WHERE name = ?1",
                    [&listed.run],
                    |row| row.get(0),
                )
                .optional()?,
            listed,
        })
    }
}

/// A number that we only write positive; of one that was changed, verify tells.
fn count(row: &Row, column: usize) -> rusqlite::Result<u64> {
    let value: i64 = row.get(column)?;
    Ok(u64::try_from(value).unwrap_or(u64::MAX))
}

fn all<T>(
    store: &Connection,
    sql: &str,
    run: i64,
    row: impl FnMut(&Row) -> rusqlite::Result<T>,
) -> rusqlite::Result<Vec<T>> {
    store.prepare(sql)?.query_map([run], row)?.collect()
}

pub(super) fn files(store: &Connection, run: i64) -> rusqlite::Result<Vec<FileHash>> {
    all(
        store,
        "SELECT path, bytes, sha256 FROM files WHERE run = ?1 ORDER BY path",
        run,
        |row| {
            Ok(FileHash {
                path: row.get(0)?,
                bytes: count(row, 1)?,
                sha256: row.get(2)?,
            })
        },
    )
}

/// A fiber of a tray, as it was produced.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Produced {
    /// Serial number of the device.
    pub device: String,
    /// Its place on the tray.
    pub place: String,
    /// The port.
    pub port: String,
    /// Serial number of the fiber.
    pub fiber: String,
    /// Where that lay.
    pub fiber_place: String,
    /// The production recipe.
    pub recipe: String,
    /// SHA-256 of the calibration.
    pub calibration: String,
    /// The operator's name; empty where none was given.
    pub operator: String,
    /// `pigtailed`, or why it is not.
    pub outcome: String,
    /// Loss that cure and release have added, by the light, decibels.
    pub added_loss_db: Option<f64>,
    /// Its standard deviation, decibels.
    pub sigma_db: Option<f64>,
    /// How far from its peak it is after cure and release, by the light, micrometres.
    pub off_um: Option<f64>,
    /// Its standard deviation, micrometres.
    pub off_sigma_um: Option<f64>,
    /// How far the adhesive has shifted it in all, micrometres.
    pub shift_um: Option<f64>,
    /// Machine time, seconds.
    pub seconds: f64,
}

fn pigtails(store: &Connection, run: i64) -> rusqlite::Result<Vec<Produced>> {
    all(
        store,
        "SELECT device, place, port, fiber, fiber_place, recipe, calibration, operator, outcome, added_loss_db, sigma_db,
                off_um, off_sigma_um, shift_um, seconds
         FROM pigtails WHERE run = ?1 ORDER BY ordinal",
        run,
        |row| {
            Ok(Produced {
                device: row.get(0)?,
                place: row.get(1)?,
                port: row.get(2)?,
                fiber: row.get(3)?,
                fiber_place: row.get(4)?,
                recipe: row.get(5)?,
                calibration: row.get(6)?,
                operator: row.get(7)?,
                outcome: row.get(8)?,
                added_loss_db: row.get(9)?,
                sigma_db: row.get(10)?,
                off_um: row.get(11)?,
                off_sigma_um: row.get(12)?,
                shift_um: row.get(13)?,
                seconds: row.get(14)?,
            })
        },
    )
}

/// The fibers of a run, and those of which only phases are known since it ended early.
fn fibers(store: &Connection, run: i64) -> rusqlite::Result<Vec<Fiber>> {
    let mut fibers = all(
        store,
        "SELECT port, outcome, detail, seconds, offset_x_um, offset_y_um, offset_z_um,
                coupling_loss_db, within_tolerance
         FROM fibers WHERE run = ?1 ORDER BY ordinal",
        run,
        |row| {
            Ok(Fiber {
                port: row.get(0)?,
                outcome: row.get(1)?,
                detail: row.get(2)?,
                seconds: row.get(3)?,
                offset_um: [row.get(4)?, row.get(5)?, row.get(6)?],
                coupling_loss_db: row.get(7)?,
                within_tolerance: row.get(8)?,
                phases: Vec::new(),
            })
        },
    )?;
    let phases = all(
        store,
        "SELECT port, name, start_s, seconds FROM phases WHERE run = ?1 ORDER BY ordinal",
        run,
        |row| {
            let phase = Phase {
                name: row.get(1)?,
                start_s: row.get(2)?,
                seconds: row.get(3)?,
            };
            Ok((row.get::<_, String>(0)?, phase))
        },
    )?;
    for (port, phase) in phases {
        let known = fibers.iter().position(|fiber| fiber.port == port);
        let index = known.unwrap_or_else(|| {
            fibers.push(Fiber {
                port,
                outcome: None,
                detail: None,
                seconds: 0.0,
                offset_um: [None; 3],
                coupling_loss_db: None,
                within_tolerance: None,
                phases: Vec::new(),
            });
            fibers.len() - 1
        });
        let fiber = &mut fibers[index];
        if fiber.outcome.is_none() {
            fiber.seconds += phase.seconds;
        }
        fiber.phases.push(phase);
    }
    Ok(fibers)
}

/// The names of all runs that have a folder among `runs`, hidden or not. Those that the store does
/// not know were made before there was one, or brought from elsewhere. Ask for them before the store
/// is read: else a run that begins in between would be taken for one of them.
///
/// # Errors
///
/// When the folder cannot be read.
pub fn folders(runs: &Path) -> Result<Vec<String>, Error> {
    let failed = |error: io::Error| {
        let what = match error.kind() {
            io::ErrorKind::NotFound => "no such folder".to_owned(),
            _ => format!("cannot be read: {error}"),
        };
        Error::new(
            runs.display().to_string(),
            "",
            format!("{what}; accepted is a folder of runs, such as `pigtail align` makes"),
        )
    };
    let mut names = Vec::new();
    for entry in fs::read_dir(runs).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let hidden = file
            .strip_prefix('.')
            .and_then(|name| name.strip_suffix(".partial"))
            .filter(|name| !name.starts_with(FILE));
        let name = hidden.unwrap_or(&file);
        let is_run = match hidden {
            // One that was killed before it was entered left nothing in it.
            Some(_) => has_files(&path),
            None => path.join("run.json").exists(),
        };
        if is_run {
            names.push(name.to_owned());
        }
    }
    names.sort();
    names.dedup();
    Ok(names)
}

/// Whether there is anything but a lock in a folder.
fn has_files(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|mut entries| {
        entries.any(|entry| entry.is_ok_and(|entry| entry.file_name() != LOCK))
    })
}
