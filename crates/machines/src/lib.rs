//! What may stand behind the boundary.
//!
//! Everything here implements [`Machine`](pigtail_hal::Machine), and control cannot tell one from
//! another. This crate does not know that control exists.

mod deadline;
pub mod guard;
mod pace;
mod panel;
pub mod record;
pub mod twin;

pub use deadline::{Deadline, OVERDUE};
pub use guard::Guard;
pub use pace::Pace;
pub use panel::Panel;
pub use record::{Recorder, Replay};
pub use twin::Twin;
