//! A rig, a machine, a job and an observer: the one way to run anything.

pub mod align;
pub mod characterize;
pub mod faults;
pub mod guarded;
pub mod identify;
pub mod own;
pub mod procedure;
pub mod record;
pub mod replay;
pub mod rig;
pub mod scenario;
pub mod tune;
