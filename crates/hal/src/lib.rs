//! The boundary between control and a pigtailing machine.
//!
//! Everything that crosses the wires is here and nothing else: a [`Command`] goes out and a
//! [`Measurement`] comes back, once a servo cycle, through the one trait [`Machine`]. What
//! stands behind it, a digital twin, a recording or hardware, cannot be told from this side,
//! and what control may know of it is only what these types can carry.
//!
//! Read in this order:
//!
//! 1. [`machine`]: the trait;
//! 2. [`command`] and [`measurement`]: what is said in one cycle, and [`pulse`], what an amplifier
//!    plays out inside of it;
//! 3. [`spec`]: the datasheet (`machine.toml`), which both sides may read;
//! 4. [`fault`]: how a machine says that it has stopped;
//! 5. [`mod@bench`]: the layer above volts, poses and light;
//! 6. [`quantity`] and [`config`]: numbers with units, and files that explain their mistakes.
//!
//! Inside the project all numbers are SI in `f64`; the doc of each field says the unit. Wire
//! values have types of their own: [`Counts`] and [`Volts`].
//!
//! ```
//! use pigtail_hal::{AxisName, Command, Volts};
//!
//! // What is said in one cycle: nothing but a volt on the left z-stage.
//! let at: AxisName = "left.z".parse()?;
//! let mut command = Command::IDLE;
//! command.motors[at.side.index()][at.axis.index()] = Volts(1.0);
//! assert_eq!(at.to_string(), "left.z");
//! # Ok::<(), String>(())
//! ```

pub mod bench;
pub mod command;
pub mod config;
pub mod digest;
pub mod fault;
pub mod machine;
pub mod measurement;
pub mod pulse;
pub mod quantity;
pub mod spec;

pub use bench::Bench;
pub use command::{Command, FiberHandling, Handled};
pub use config::Error;
pub use fault::{Fault, Rule};
pub use machine::Machine;
pub use measurement::{LightSample, Measurement, TipFix, VisionFrame};
pub use pulse::{Pulse, Unplayable};
pub use quantity::{Counts, Volts};
pub use spec::{Axis, AxisName, Channel, Side, Spec};
