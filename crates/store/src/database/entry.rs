//! One run in the store, from its beginning to its end.

use super::{Database, FileHash, schema};
use pigtail_hal::{Error, Fault};
use pigtail_numerics::rounded;
use rusqlite::{Connection, ErrorCode, OptionalExtension, params};
use serde::Serialize;

/// How far a run has come.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Serialize,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// A process is at it
    Running,
    /// It came to its end
    Complete,
    /// Its process ended before it did
    Interrupted,
    /// The machine stopped it
    Fault,
}

impl State {
    /// Its name in tables and files.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// What is known of a run when it begins.
#[derive(Debug, Clone, Copy)]
pub struct Beginning<'a> {
    /// The name of its folder.
    pub name: &'a str,
    /// The command, such as `align` or `identify windup`.
    pub kind: &'a str,
    /// Its seed.
    pub seed: u64,
    /// When, in RFC 3339.
    pub started: &'a str,
    /// Name and SHA-256 of every configuration that was read.
    pub configuration: &'a [(String, String)],
}

/// The devices of a run.
#[derive(Debug, Clone, Copy)]
pub struct Devices<'a> {
    /// The first one's seed; each next one has the next.
    pub seed: u64,
    /// How many there are.
    pub count: u64,
    /// The rig as it was named.
    pub rig: &'a str,
    /// The recipe as it was named.
    pub recipe: &'a str,
    /// How they are aligned.
    pub procedure: &'a str,
    /// How the truth was changed.
    pub scenario: &'a str,
}

/// How the fibers of a run's one device ended.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Aligned {
    /// Each fiber, in the order of alignment.
    pub fibers: Vec<AlignedFiber>,
    /// Whether anything touched the chip; `None` where nobody knows.
    pub collision: Option<bool>,
    /// The least distance of anything from the chip, micrometres.
    pub smallest_gap_um: Option<f64>,
}

/// How one fiber ended.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignedFiber {
    /// The port.
    pub port: String,
    /// What control says of it.
    pub outcome: String,
    /// The same in a sentence.
    pub detail: String,
    /// Machine time, seconds.
    pub seconds: f64,
    /// Where it really is, x, y and z, micrometres.
    pub offset_um: Option<[f64; 3]>,
    /// Loss at this interface, decibels.
    pub coupling_loss_db: Option<f64>,
    /// Whether it really is where it should be.
    pub within_tolerance: Option<bool>,
}

/// A fiber of a tray as it was produced: who was where, with what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pigtail<'a> {
    /// Serial number of the device.
    pub device: &'a str,
    /// Its place on the tray.
    pub place: &'a str,
    /// The port.
    pub port: &'a str,
    /// Serial number of the fiber.
    pub fiber: &'a str,
    /// Where that lay.
    pub fiber_place: &'a str,
    /// The production recipe.
    pub recipe: &'a str,
    /// SHA-256 of the calibration.
    pub calibration: &'a str,
    /// The operator's name; empty where none was given.
    pub operator: &'a str,
    /// `pigtailed`, or why it is not.
    pub outcome: &'a str,
    /// Loss that cure and release have added, by the light, decibels.
    pub added_loss_db: Option<f64>,
    /// Its standard deviation, decibels.
    pub sigma_db: Option<f64>,
    /// How far from its peak it is after cure and release, by the light, micrometres; its standard deviation; and how far
    /// the adhesive has shifted it in all.
    pub off_um: Option<[f64; 3]>,
    /// Machine time, seconds.
    pub seconds: f64,
}

/// Enters a fiber of a tray; a port of a device is done with once in a run.
fn insert(store: &Connection, run: i64, pigtail: &Pigtail) -> rusqlite::Result<usize> {
    store.execute(
        "INSERT INTO pigtails SELECT ?1, count(*), ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13,
         ?14, ?15, ?16
         FROM pigtails WHERE run = ?1
         HAVING NOT EXISTS (SELECT 1 FROM pigtails WHERE run = ?1 AND device = ?2 AND port = ?4)",
        params![
            run,
            pigtail.device,
            pigtail.place,
            pigtail.port,
            pigtail.fiber,
            pigtail.fiber_place,
            pigtail.recipe,
            pigtail.calibration,
            pigtail.operator,
            pigtail.outcome,
            pigtail.added_loss_db,
            pigtail.sigma_db,
            rounded(pigtail.seconds, 1e-6),
            pigtail.off_um.map(|off| off[0]),
            pigtail.off_um.map(|off| off[1]),
            pigtail.off_um.map(|off| off[2])
        ],
    )
}

impl Database {
    /// Enters those of these fibers that a run which was killed had noted, but not entered any more. A run that has ended
    /// is left as it is.
    ///
    /// # Errors
    ///
    /// When they cannot be written.
    pub fn complete(&self, run: &str, pigtails: &[Pigtail]) -> Result<(), Error> {
        self.write(|store| {
            let open = "SELECT id FROM runs WHERE name = ?1 AND NOT EXISTS (SELECT 1 FROM seals WHERE seals.name = ?1)";
            let run = store.query_row(open, [run], |row| row.get(0)).optional()?;
            if let Some(run) = run {
                for pigtail in pigtails {
                    insert(store, run, pigtail)?;
                }
            }
            Ok(())
        })
    }
}

/// How a run ended.
#[derive(Debug, Clone, Copy)]
pub struct End<'a> {
    /// How far it came.
    pub state: State,
    /// In a few words.
    pub outcome: &'a str,
    /// When, in RFC 3339.
    pub finished: &'a str,
    /// How long this process was at it, seconds.
    pub wall_seconds: f64,
}

/// A run in the store, while it is being written.
#[derive(Debug)]
pub struct Entry {
    database: Database,
    run: i64,
    name: String,
}

impl Entry {
    /// Enters a run that begins; gives the store back where the name is taken.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn begin(
        database: Database,
        beginning: &Beginning,
    ) -> Result<Result<Self, Database>, Error> {
        let entered = database.write(|store| match enter(store, beginning) {
            Err(error) if error.sqlite_error_code() == Some(ErrorCode::ConstraintViolation) => {
                Ok(None)
            }
            other => other.map(Some),
        })?;
        let Some(run) = entered else {
            return Ok(Err(database));
        };
        let name = beginning.name.to_owned();
        Ok(Ok(Self {
            database,
            run,
            name,
        }))
    }

    /// Takes up a run again that had ended early, or enters one that began before there was a store.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn resume(database: Database, beginning: &Beginning) -> Result<Self, Error> {
        let run = database.write(|store| {
            let name = [beginning.name];
            let known = store.query_row("SELECT id FROM runs WHERE name = ?1", name, |r| r.get(0));
            match known {
                Err(rusqlite::Error::QueryReturnedNoRows) => enter(store, beginning),
                Err(error) => Err(error),
                Ok(run) => {
                    store.execute("DELETE FROM seals WHERE name = ?1", name)?;
                    store.execute(
                        "UPDATE runs SET state = 'running', pid = ?2 WHERE id = ?1",
                        params![run, std::process::id()],
                    )?;
                    Ok(run)
                }
            }
        })?;
        let name = beginning.name.to_owned();
        Ok(Self {
            database,
            run,
            name,
        })
    }

    /// Enters the devices that it is about.
    ///
    /// # Errors
    ///
    /// When they cannot be written.
    pub fn devices(&self, devices: &Devices) -> Result<(), Error> {
        let run = self.run;
        self.database.write(|store| {
            store.execute("DELETE FROM devices WHERE run = ?1", [run])?;
            store.execute(
                "INSERT INTO devices (run, ordinal, seed, count, rig, recipe, procedure, scenario)
                 VALUES (?1, 0, ?2, ?3, ?4, ?5, ?6, ?7)",
                params![
                    run,
                    devices.seed.to_string(),
                    devices.count,
                    devices.rig,
                    devices.recipe,
                    devices.procedure,
                    devices.scenario
                ],
            )
        })?;
        Ok(())
    }

    /// Enters a phase of a fiber that is over: when it began and how long it took, seconds of
    /// machine time.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn phase(&self, port: &str, name: &str, start: f64, seconds: f64) -> Result<(), Error> {
        let run = self.run;
        self.database.write(|store| {
            store.execute(
                "INSERT INTO phases (run, ordinal, port, name, start_s, seconds)
                 SELECT ?1, count(*), ?2, ?3, ?4, ?5 FROM phases WHERE run = ?1",
                params![
                    run,
                    port,
                    name,
                    rounded(start, 1e-6),
                    rounded(seconds, 1e-6)
                ],
            )
        })?;
        Ok(())
    }

    /// Enters a fiber of a tray that is done with.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn pigtail(&self, pigtail: &Pigtail) -> Result<(), Error> {
        let run = self.run;
        self.database.write(|store| insert(store, run, pigtail))?;
        Ok(())
    }

    /// Enters how the fibers of its one device ended.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn aligned(&self, aligned: &Aligned) -> Result<(), Error> {
        let run = self.run;
        self.database.write(|store| {
            for (ordinal, fiber) in aligned.fibers.iter().enumerate() {
                enter_fiber(store, run, ordinal, fiber)?;
            }
            store.execute(
                "UPDATE devices SET collision = ?2, smallest_gap_um = ?3
                 WHERE run = ?1 AND ordinal = 0",
                params![run, aligned.collision, aligned.smallest_gap_um],
            )?;
            let seconds: f64 = aligned.fibers.iter().map(|fiber| fiber.seconds).sum();
            store.execute(
                "UPDATE runs SET machine_seconds = ?2 WHERE id = ?1",
                params![run, rounded(seconds, 1e-4)],
            )
        })?;
        Ok(())
    }

    /// Enters a calibration that it wrote: file, table of it, and the hash of the whole file.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn calibrated(&self, file: &str, table: &str, sha256: &str) -> Result<(), Error> {
        let run = self.run;
        self.database.write(|store| {
            store.execute(
                "INSERT INTO calibrations (run, ordinal, file, entry, sha256)
                 SELECT ?1, count(*), ?2, ?3, ?4 FROM calibrations WHERE run = ?1",
                params![run, file, table, sha256],
            )
        })?;
        Ok(())
    }

    /// Enters the machine's fault.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn fault(&self, fault: &Fault) -> Result<(), Error> {
        let run = self.run;
        self.database.write(|store| {
            store.execute(
                "INSERT INTO faults (run, ordinal, rule, axis, value, accepted, time_s)
                 SELECT ?1, count(*), ?2, ?3, ?4, ?5, ?6 FROM faults WHERE run = ?1",
                params![
                    run,
                    fault.rule.text(),
                    fault.axis,
                    fault.value,
                    fault.limit,
                    fault.time
                ],
            )
        })?;
        Ok(())
    }

    /// Enters its end and the files it left, seals it, and has `place` put them where they belong.
    /// What cannot be put there is not entered as ended.
    ///
    /// # Errors
    ///
    /// When it cannot be written, or `place` fails.
    pub fn end(
        &self,
        end: &End,
        files: &[FileHash],
        place: impl FnOnce() -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let (run, name) = (self.run, &self.name);
        let mut failed = None;
        let ended = self.database.write(|store| {
            store.execute(
                "UPDATE runs SET state = ?2, outcome = ?3, finished = ?4,
                 wall_seconds = coalesce(wall_seconds, 0) + ?5 WHERE id = ?1",
                params![
                    run,
                    end.state.name(),
                    end.outcome,
                    end.finished,
                    end.wall_seconds
                ],
            )?;
            store.execute("DELETE FROM files WHERE run = ?1", [run])?;
            for file in files {
                store.execute(
                    "INSERT INTO files (run, path, bytes, sha256) VALUES (?1, ?2, ?3, ?4)",
                    params![run, file.path, file.bytes, file.sha256],
                )?;
            }
            store.execute(
                "INSERT OR REPLACE INTO seals (name, sha256) VALUES (?1, ?2)",
                params![name, schema::seal(store, run)?],
            )?;
            place().map_err(|error| {
                failed = Some(error);
                rusqlite::Error::ExecuteReturnedResults
            })
        });
        match (ended, failed) {
            (_, Some(error)) => Err(error),
            (ended, None) => Ok(ended?),
        }
    }

    /// Takes it out of the store again: nothing ran.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn abandon(self) -> Result<(), Error> {
        let run = self.run;
        self.database
            .write(|store| store.execute("DELETE FROM runs WHERE id = ?1", [run]))?;
        self.database.remove_if_unused();
        Ok(())
    }
}

fn enter(store: &Connection, beginning: &Beginning) -> rusqlite::Result<i64> {
    let command: Vec<String> = std::env::args_os()
        .map(|argument| argument.to_string_lossy().into_owned())
        .collect();
    let command = serde_json::Value::from(command).to_string();
    store.execute(
        "INSERT INTO runs (name, kind, seed, state, version, command, pid, started)
         VALUES (?1, ?2, ?3, 'running', ?4, ?5, ?6, ?7)",
        params![
            beginning.name,
            beginning.kind,
            beginning.seed.to_string(),
            env!("CARGO_PKG_VERSION"),
            command,
            std::process::id(),
            beginning.started
        ],
    )?;
    let run = store.last_insert_rowid();
    for (ordinal, (file, sha256)) in beginning.configuration.iter().enumerate() {
        store.execute(
            "INSERT INTO configurations (run, ordinal, file, sha256) VALUES (?1, ?2, ?3, ?4)",
            params![run, ordinal, file, sha256],
        )?;
    }
    Ok(run)
}

fn enter_fiber(
    store: &Connection,
    run: i64,
    ordinal: usize,
    fiber: &AlignedFiber,
) -> rusqlite::Result<usize> {
    let offset = fiber.offset_um;
    store.execute(
        "INSERT INTO fibers (run, ordinal, port, outcome, detail, seconds, offset_x_um,
         offset_y_um, offset_z_um, coupling_loss_db, within_tolerance)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)",
        params![
            run,
            ordinal,
            fiber.port,
            fiber.outcome,
            fiber.detail,
            fiber.seconds,
            offset.map(|[x, _, _]| x),
            offset.map(|[_, y, _]| y),
            offset.map(|[_, _, z]| z),
            fiber.coupling_loss_db,
            fiber.within_tolerance
        ],
    )
}
