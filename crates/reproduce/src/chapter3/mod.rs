//! Chapter 3: path planning.

mod alignment;
mod light;
mod macro_raster;
mod maximization;
mod search;
mod tradeoffs;

use super::{BUDGET, Experiment};

/// Distance of the climb's points in 3.3, metres.
const THESIS_STEP: f64 = 0.1e-6;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment::new(&["3.2"], 3, light::profile),
    Experiment::new(&["3.3"], 32, search::methods),
    Experiment::new(&["3.4", BUDGET], 40, alignment::devices),
    Experiment::new(&["3.5"], 45, maximization::peak),
];
