//! Chapter 4.

use super::Experiment;

pub(super) const EXPERIMENTS: &[Experiment] = &[];
