//! The tables, how an older database becomes one of today, and what a seal is over.
//!
//! A version that is out in the world never changes: to change the tables, append a step to
//! [`STEPS`]. A seal is over every value that is not null, so that a step may add tables and
//! columns, null in the rows that are there, and old seals hold; it may not rename or remove any.

use rusqlite::types::ValueRef;
use rusqlite::{Connection, Result, Transaction, TransactionBehavior};
use sha2::{Digest, Sha256};

/// In the header of every store, so that another program's database is not taken for one: "pigt".
pub(super) const APPLICATION: i32 = 0x7069_6774;

/// `STEPS[i]` turns version i into version i + 1; version 0 is an empty database.
pub(super) const STEPS: &[&str] = &[
    "
    CREATE TABLE runs (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        name TEXT NOT NULL UNIQUE,      -- of its folder
        kind TEXT NOT NULL,             -- the command, such as align or identify windup
        seed TEXT NOT NULL,             -- decimal: it may be beyond what INTEGER holds
        state TEXT NOT NULL
            CHECK (state IN ('running', 'complete', 'interrupted', 'fault')),
        outcome TEXT,
        version TEXT NOT NULL,          -- of the program
        command TEXT NOT NULL,          -- a JSON array
        pid INTEGER NOT NULL,
        started TEXT NOT NULL,          -- RFC 3339
        finished TEXT,
        wall_seconds REAL,
        machine_seconds REAL
    ) STRICT;
    CREATE TABLE configurations (
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        ordinal INTEGER NOT NULL,
        file TEXT NOT NULL,
        sha256 TEXT NOT NULL,
        PRIMARY KEY (run, ordinal)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE devices (
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        ordinal INTEGER NOT NULL,
        seed TEXT NOT NULL,             -- of the first; each next one has the next
        count INTEGER NOT NULL,         -- more than one in a campaign, whose rows are in Parquet
        rig TEXT NOT NULL,
        recipe TEXT NOT NULL,
        procedure TEXT NOT NULL,
        scenario TEXT NOT NULL,
        collision INTEGER,
        smallest_gap_um REAL,
        PRIMARY KEY (run, ordinal)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE fibers (
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        ordinal INTEGER NOT NULL,
        port TEXT NOT NULL,
        outcome TEXT NOT NULL,
        detail TEXT NOT NULL,
        seconds REAL NOT NULL,          -- of machine time
        offset_x_um REAL,               -- the twin's truth, as are all that follow
        offset_y_um REAL,
        offset_z_um REAL,
        coupling_loss_db REAL,
        within_tolerance INTEGER,
        PRIMARY KEY (run, ordinal)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE phases (
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        ordinal INTEGER NOT NULL,
        port TEXT NOT NULL,
        name TEXT NOT NULL,
        start_s REAL NOT NULL,          -- of machine time
        seconds REAL NOT NULL,
        PRIMARY KEY (run, ordinal)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE calibrations (
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        ordinal INTEGER NOT NULL,
        file TEXT NOT NULL,
        entry TEXT NOT NULL,            -- the table of it that was written
        sha256 TEXT NOT NULL,           -- of the whole file afterwards
        PRIMARY KEY (run, ordinal)
    ) STRICT, WITHOUT ROWID;
    CREATE INDEX calibrations_by_content ON calibrations (sha256);
    CREATE TABLE faults (
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        ordinal INTEGER NOT NULL,
        rule TEXT NOT NULL,
        axis TEXT NOT NULL,
        value TEXT NOT NULL,
        accepted TEXT NOT NULL,
        time_s REAL NOT NULL,           -- of machine time
        PRIMARY KEY (run, ordinal)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE files (
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        path TEXT NOT NULL,             -- inside the run's folder, with slashes
        bytes INTEGER NOT NULL,
        sha256 TEXT NOT NULL,
        PRIMARY KEY (run, path)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE seals (                -- apart from the runs, so that a run cannot just be gone
        name TEXT PRIMARY KEY,
        sha256 TEXT NOT NULL            -- over all that the other tables say of the run
    ) STRICT, WITHOUT ROWID;
",
    "
    CREATE TABLE pigtails (             -- fibers of a tray, as they were produced
        run INTEGER NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        ordinal INTEGER NOT NULL,
        device TEXT NOT NULL,           -- serial number
        place TEXT NOT NULL,            -- of the device on the tray
        port TEXT NOT NULL,
        fiber TEXT NOT NULL,            -- serial number
        fiber_place TEXT NOT NULL,
        recipe TEXT NOT NULL,
        calibration TEXT NOT NULL,      -- SHA-256
        operator TEXT NOT NULL,
        outcome TEXT NOT NULL,          -- pigtailed, or why not
        added_loss_db REAL,             -- by the light
        sigma_db REAL,
        seconds REAL NOT NULL,          -- of machine time
        PRIMARY KEY (run, ordinal)
    ) STRICT, WITHOUT ROWID;
",
    // How far from its peak the cure has left a fiber, and shifted it in all, by the light.
    "
    ALTER TABLE pigtails ADD COLUMN off_um REAL;
    ALTER TABLE pigtails ADD COLUMN off_sigma_um REAL;
    ALTER TABLE pigtails ADD COLUMN shift_um REAL;
",
];

/// The tables that a seal is over, the column that names the run, and the order of their rows.
const SEALED: [(&str, &str, &str); 9] = [
    ("runs", "id", "id"),
    ("configurations", "run", "ordinal"),
    ("devices", "run", "ordinal"),
    ("fibers", "run", "ordinal"),
    ("phases", "run", "ordinal"),
    ("calibrations", "run", "ordinal"),
    ("faults", "run", "ordinal"),
    ("files", "run", "path"),
    ("pigtails", "run", "ordinal"),
];

/// The version that a database says it has.
pub(super) fn version(connection: &Connection) -> Result<i64> {
    connection.pragma_query_value(None, "user_version", |row| row.get(0))
}

/// Brings a database to the last of `steps`, all of the way or not at all.
pub(super) fn migrate(connection: &Connection, steps: &[&str]) -> Result<()> {
    let transaction = Transaction::new_unchecked(connection, TransactionBehavior::Immediate)?;
    // Another process may have done it while this one waited.
    let from = usize::try_from(version(&transaction)?).unwrap_or(usize::MAX);
    for step in steps.iter().skip(from) {
        transaction.execute_batch(step)?;
    }
    if from < steps.len() {
        transaction.pragma_update(None, "user_version", steps.len())?;
    }
    transaction.commit()
}

/// Whether the tables are those that the steps make, to the letter.
pub(super) fn is_ours(connection: &Connection) -> Result<bool> {
    let ours = Connection::open_in_memory()?;
    migrate(&ours, STEPS)?;
    let tables = |connection: &Connection| {
        connection
            .prepare("SELECT name, coalesce(sql, '') FROM sqlite_schema ORDER BY name")?
            .query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?
            .collect::<Result<Vec<(String, String)>>>()
    };
    Ok(tables(connection)? == tables(&ours)?)
}

/// SHA-256, hexadecimal, over a text of all that the store says of a run: table, column, type,
/// length and value of everything that is not null. Numbers are their bits.
pub(super) fn seal(connection: &Connection, run: i64) -> Result<String> {
    let mut hash = Sha256::new();
    for (table, key, order) in SEALED {
        let mut statement = connection.prepare(&format!(
            "SELECT * FROM {table} WHERE {key} = ?1 ORDER BY {order}"
        ))?;
        let names: Vec<String> = statement.column_names().map(str::to_owned).collect();
        let mut rows = statement.query([run])?;
        while let Some(row) = rows.next()? {
            hash.update(format!("{table}\n"));
            for (index, name) in names.iter().enumerate() {
                let (kind, value) = match row.get_ref(index)? {
                    ValueRef::Null => continue,
                    ValueRef::Integer(value) => ("integer", value.to_string().into_bytes()),
                    ValueRef::Real(value) => ("real", value.to_bits().to_string().into_bytes()),
                    ValueRef::Text(value) => ("text", value.to_vec()),
                    ValueRef::Blob(value) => ("blob", value.to_vec()),
                };
                hash.update(format!("{name} {kind} {} ", value.len()));
                hash.update(&value);
                hash.update("\n");
            }
        }
    }
    Ok(pigtail_hal::digest::hex(&hash.finalize()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first() -> Connection {
        let connection = Connection::open_in_memory().expect("a database");
        migrate(&connection, STEPS).expect("today's version");
        connection
            .execute_batch(
                "INSERT INTO runs (name, kind, seed, state, version, command, pid, started)
                 VALUES ('r', 'align', '7', 'complete', '0.1.0', '[]', 1, 'then');
                 INSERT INTO phases VALUES (1, 0, 'input', 'coarse', 0.0, 0.5);",
            )
            .expect("rows");
        connection
    }

    fn today() -> i64 {
        i64::try_from(STEPS.len()).expect("a few")
    }

    /// The steps to today's version, and two more.
    fn and(more: [&'static str; 2]) -> Vec<&'static str> {
        STEPS.iter().copied().chain(more).collect()
    }

    #[test]
    fn an_older_database_becomes_one_of_today_and_its_seals_hold() {
        let connection = first();
        let before = seal(&connection, 1).expect("a seal");
        let steps = and([
            "ALTER TABLE phases ADD COLUMN samples INTEGER; CREATE TABLE more (run INTEGER);",
            "UPDATE runs SET machine_seconds = NULL;",
        ]);
        let newer = today() + 2;
        migrate(&connection, &steps).expect("two versions more");
        assert_eq!(version(&connection), Ok(newer));
        assert_eq!(seal(&connection, 1).as_ref(), Ok(&before));
        migrate(&connection, &steps).expect("nothing to do");
        assert_eq!(version(&connection), Ok(newer));
    }

    #[test]
    fn a_step_that_fails_changes_nothing() {
        let connection = first();
        let steps = and(["DELETE FROM phases;", "no SQL at all;"]);
        migrate(&connection, &steps).expect_err("it cannot be done");
        assert_eq!(version(&connection), Ok(today()));
        let phases: i64 = connection
            .query_row("SELECT count(*) FROM phases", [], |row| row.get(0))
            .expect("a number");
        assert_eq!(phases, 1);
    }

    #[test]
    fn a_seal_is_over_every_value() {
        let connection = first();
        let before = seal(&connection, 1).expect("a seal");
        for change in [
            "UPDATE phases SET seconds = 0.5000000000000001",
            "UPDATE phases SET seconds = 0.5, port = 'output1'",
            "UPDATE phases SET port = 'input'; UPDATE runs SET seed = '8'",
            "UPDATE runs SET seed = '7'; DELETE FROM phases",
        ] {
            connection.execute_batch(change).expect("a change");
            assert_ne!(seal(&connection, 1).as_ref(), Ok(&before), "{change}");
        }
    }
}
