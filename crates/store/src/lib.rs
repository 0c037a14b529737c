//! The store of runs: their folders, the database that lists them, seals, and rows as tables.

pub mod ledger;
pub mod rows;
pub mod runs;
