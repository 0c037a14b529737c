//! Chapter 2: control of the macro manipulator.

mod compensation;
mod coupling;
mod resolution;
mod servo;
mod windup;

pub(super) use resolution::pid as pid_resolution;

use super::Experiment;
use pigtail_hal::{Axis, AxisName, Side};

/// The joint on which the five-bar's figures are made, as by `pigtail characterize fivebar`.
pub(super) const FIVE_BAR: AxisName = AxisName {
    side: Side::Left,
    axis: Axis::A,
};

/// The z-stage of z's figures.
pub(super) const Z: AxisName = AxisName {
    side: Side::Left,
    axis: Axis::Z,
};

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment::new(&["2.2"], 1, coupling::joints),
    Experiment::new(&["2.3", "2.4"], 8, servo::five_bar_gains),
    Experiment::new(&["2.5"], 8, servo::z_gains),
    Experiment::new(&["2.6"], 2, servo::five_bar_sine),
    Experiment::new(&["2.7"], 1, servo::z_sine),
    Experiment::new(
        &["2.8", "2.10", "2.13", "2.14", "2.15"],
        4,
        windup::measured,
    ),
    Experiment::new(&["2.9", "2.12"], 4, windup::simulated),
    Experiment::new(&["2.11"], 3, windup::z_stage),
    Experiment::new(
        &["2.16", "2.17", "2.18", "2.19", "2.20"],
        6,
        compensation::scans,
    ),
    Experiment::new(&["2.21", "2.22", "2.23"], 9, compensation::squares),
    Experiment::new(&["2.24", "2.25"], 3, resolution::z_stage),
    Experiment::new(&["2.26"], 2, resolution::five_bar),
];
