//! What goes around any machine: guard, recorder and replay, stop, deadline, pace.
//!
//! In goes a [`Machine`](pigtail_hal::Machine), out comes another that control cannot tell from it. This crate
//! knows neither control nor the twin; one suite of tests (`tests/conformance.rs`) is for all of them. [`mod@bench`] has
//! the same for benches.
//!
//! Start with [`Guard`]; [`record`] has the format of a record, its writer and its reader.
//!
//! ```
//! use pigtail_hal::Machine;
//! use pigtail_machines::{Deadline, Panel};
//! use std::sync::Arc;
//!
//! /// A machine that a button stops, and that stops by itself after a minute of its time.
//! fn tame(machine: Box<dyn Machine>) -> impl Machine {
//!     Panel::new(Deadline::new(machine, 60.0), Arc::default())
//! }
//! # let _ = tame;
//! ```

pub mod bench;
mod deadline;
pub mod guard;
mod pace;
mod panel;
pub mod record;

pub use deadline::Deadline;
pub use guard::Guard;
pub use pace::Pace;
pub use panel::Panel;
pub use record::{Recorder, Replay};
