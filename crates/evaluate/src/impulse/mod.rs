//! Impulse control on a twin (thesis 4.3): what pulses do to an axis, which pulse is best, and what a
//! loop of them makes of a target.

mod bench;
pub mod condition;
pub mod contest;
pub mod response;
pub mod run;
pub mod shapes;
pub mod waveform;
