//! The production cycle: a tray of devices and fibers in, pigtailed devices out.
//!
//! In go a [`tray`] (what lies where), a production [`recipe`] (phases with parameters, limits and what to do on each
//! outcome), and a [`Station`](pigtail_control::station::Station); out come events, a bar for whatever each manipulator did,
//! and what became of every device. [`check`] finds all mistakes of tray and recipes before anything moves, [`plan`] says what
//! the cycle will take and what limits it, [`run`] runs it, and [`teach`] learns what the adhesive does from one fiber to the
//! next. This room reads no files and knows no clock but the machine's.
//!
//! ```
//! use pigtail_cycle::recipe::Production;
//! let fast = Production::parse("produce-fast.toml", include_str!("../../../recipes/produce-fast.toml"))?;
//! assert_eq!(fast.ports.len(), 3);
//! # Ok::<(), pigtail_hal::Error>(())
//! ```

pub mod cell;
pub mod check;
mod losses;
pub mod plan;
pub mod recipe;
pub mod run;
pub mod spread;
pub mod steadiness;
pub mod teach;
pub mod tray;
