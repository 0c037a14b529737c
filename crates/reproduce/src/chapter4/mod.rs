//! Chapter 4: nonlinear control methods.

mod hysteresis;
mod impulse;

use super::Experiment;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment::new(
        &["4.3", "4.4", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10"],
        25,
        hysteresis::piezos,
    ),
    Experiment::new(&["4.11"], 1, impulse::input),
    Experiment::new(&["4.12", "4.24"], 6, impulse::z_resolution),
    Experiment::new(&["4.13", "4.14", "4.15", "4.16"], 2, impulse::single_pulse),
    Experiment::new(&["4.17", "4.18", "4.19"], 15, impulse::z_response),
    Experiment::new(&["4.20"], 10, impulse::z_control),
    Experiment::new(&["4.21"], 15, impulse::five_bar_response),
    Experiment::new(&["4.22"], 4, impulse::five_bar_control),
    Experiment::new(&["4.23"], 4, impulse::five_bar_resolution),
];
