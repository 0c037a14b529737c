//! How far a record's motion went.

use super::{Equations, Moved, POSITION, Record, Settings, VOLTAGE};
use pigtail_numerics::signal::quantile;

/// What an axis was seen to do: what its datasheet may promise at least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Range of the positions, m or rad.
    pub stroke: f64,
    /// Highest speed, m/s or rad/s.
    pub speed: f64,
    /// Acceleration that it reached for a hundredth of the time, m/s^2 or rad/s^2.
    pub acceleration: f64,
    /// Largest magnitude of the voltage, V.
    pub voltage: f64,
    /// Noise of a position, standard deviation, m or rad.
    pub noise: f64,
    /// Up to what frequency its position was kept, hertz.
    pub bandwidth: f64,
}

impl Motion {
    pub(super) fn of(record: &Record, columns: &Equations, moved: &Moved, set: &Settings) -> Self {
        let all = |column: usize| {
            let stretches = record.even.stretches.iter();
            stretches.flat_map(move |s| s.columns[column].iter().copied())
        };
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let most = all(POSITION).fold(f64::NEG_INFINITY, f64::max);
        let least = all(POSITION).fold(f64::INFINITY, f64::min);
        let accelerations: Vec<f64> = columns.acceleration.iter().map(|a| a.abs()).collect();
        Self {
            stroke: most - least,
            speed: largest(&columns.velocity),
            acceleration: quantile(&accelerations, 0.99),
            voltage: all(VOLTAGE).fold(0.0, |m: f64, u| m.max(u.abs())),
            noise: moved.white,
            bandwidth: set.cutoff(record.even.period),
        }
    }
}
