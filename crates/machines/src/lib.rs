//! What goes around any machine: guard, recorder and replay, stop, deadline, pace.
//!
//! Everything here implements [`Machine`](pigtail_hal::Machine), and control cannot tell one from
//! another. This crate knows neither control nor the twin.

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
