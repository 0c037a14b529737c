//! The thesis's experiments on the twin, each result beside the printed one.

pub mod claims;
