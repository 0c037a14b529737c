//! The store of runs: their folders, the database that lists them, seals, and rows as tables.
//!
//! In goes what a run is about, phase by phase, and its files; out come lists, rows for other programs, and
//! whether a run is still what was written. It knows nothing of machines. Start with [`runs::Run`], a run
//! while it is being written; then [`database`], the run database, and [`rows`], tables as Parquet and CSV.
//!
//! ```
//! use pigtail_store::rows::{Cell, Column, Kind, Table};
//!
//! let columns = [
//!     Column::required("seed", Kind::Whole, "the device's seed"),
//!     Column::new("seconds", Kind::Number, "machine time; null unless attempted"),
//! ];
//! let mut table = Table::new(&columns.into());
//! table.add(vec![Cell::Whole(7), Cell::Number(Some(0.75))]);
//! table.add(vec![Cell::Whole(8), Cell::Number(None)]);
//! assert_eq!(table.to_csv()?, b"seed,seconds\n7,0.75\n8,\n");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod compare;
pub mod database;
pub mod rows;
pub mod runs;
pub mod samples;
