//! Chapter 3.

use super::Experiment;

pub(super) const EXPERIMENTS: &[Experiment] = &[];
