//! Chapter 3: path planning.

mod alignment;
mod light;
mod maximization;
mod search;

use super::{BUDGET, Experiment};

/// Distance of the climb's points in 3.3, metres.
const THESIS_STEP: f64 = 0.1e-6;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment::new(&["3.2"], 3, light::profile),
    Experiment::new(&["3.3"], 30, search::methods),
    Experiment::new(&["3.4", BUDGET], 20, alignment::devices),
    Experiment::new(&["3.5"], 18, maximization::peak),
];
