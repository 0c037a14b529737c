//! Belief held against truth: what a procedure, an experiment or an algorithm is worth on twins.

pub mod benchmark;
pub mod campaign;
pub mod contour;
pub mod entry;
pub mod hysteresis;
pub mod impulse;
pub mod loops;
pub mod maximize;
pub mod methods;
pub mod plan;
pub mod simulate;
