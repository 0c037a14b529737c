//! Impulse control on a twin (thesis 4.3): what pulses do to an axis, and what a loop of them makes
//! of a target.

pub mod condition;
pub mod response;
pub mod run;
