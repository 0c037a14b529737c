//! Control of a pigtailing machine.
//!
//! This crate sees only what a real machine can measure: it depends on the boundary
//! (`pigtail-hal`) and on the equations (`pigtail-model`), never on anything that stands behind
//! the boundary. Its modules in the order in which data flows:
//!
//! 1. [`recipe`]: what is to be done; [`calibration`]: what is believed of the machine;
//! 2. [`procedure`], the thesis's, [`fast`], [`nudge`], without a micro, and [`baselines`], what these
//!    have to beat: straight lines over a bench with a camera, a [`cell`], and [`align`], over one without; the
//!    [`reactor`] runs them, side by side where there are two;
//! 3. [`search`] and [`sweep`]: finding light, and [`methods`], the ways to do so that the thesis
//!    compares; [`peak`] and [`conical_scan`]: getting to its maximum, the
//!    latter by what is known of the [`beam`]; [`tip_estimator`]: where vision sees the tips;
//! 4. [`trajectory`], paths and the profiles along them, and [`kinematics`]: from a wanted motion
//!    to encoder counts;
//! 5. [`servo`]: from counts to volts, every cycle;
//! 6. [`station`]: owns the machine's time, one exchange after the other.
//!
//! The numbers that alignment goes by stand in [`tuning`].
//!
//! Below all of these [`impulse`] moves an axis by far less than an encoder count.
//!
//! Beside these stand the experiments: [`characterize`], [`identify`] and [`tune`] on one axis,
//! [`maximization`] on a fiber at its peak, [`contour`] on both joints of a five-bar, [`piezo`] on the
//! micro. What works on somebody else's records, apart from any machine, is the room `sysid`.
//!
//! There are no clocks, no threads and no files here: time comes from the machine.
//!
//! # The one rule
//!
//! What a machine measures is all that may be asked of it:
//!
//! ```
//! fn light(machine: &mut dyn pigtail_hal::Machine) -> bool {
//!     let measured = machine.exchange(&pigtail_hal::Command::IDLE);
//!     measured.is_ok_and(|measurement| measurement.light.is_some())
//! }
//! ```
//!
//! A search that wants to be told the truth does not compile, be the machine a twin or not:
//!
//! ```compile_fail,E0599
//! fn light(machine: &mut dyn pigtail_hal::Machine) -> f64 {
//!     machine.truth().input.map_or(0.0, |fiber| fiber.coupling)
//! }
//! ```
//!
//! Nor does one that wants to know what it works on:
//!
//! ```compile_fail,E0432
//! use pigtail_twin::Twin;
//! ```

pub mod align;
pub mod baselines;
pub mod beam;
pub mod belief;
pub mod calibration;
pub mod cell;
pub mod characterize;
pub mod compensation;
pub mod contour;
pub mod dynamics;
pub mod fast;
pub mod flicker;
pub mod hold;

pub mod conical_scan;
pub mod gap_by_light;
pub mod identify;
pub mod impulse;
pub mod job;
pub mod kinematics;
mod last_tries;
mod last_turns;
pub mod maximization;
pub mod methods;
pub mod nudge;
pub mod outcome;
pub mod peak;
pub mod piezo;
pub mod procedure;
pub mod reactor;
pub mod recipe;

mod ring_down;
pub mod rise;
pub mod search;
pub mod servo;
pub mod shaking;
pub mod stages;
pub mod station;
pub mod still_there;
pub mod sweep;
pub mod tip_estimator;
pub mod trajectory;
pub mod tune;
pub mod tuning;
mod upward;
