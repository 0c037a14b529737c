//! Whether the level of friction goes with the speed, which a law of displacement alone does not know.

use super::{Fitted, Record, residuals};
use pigtail_numerics::regression::{least_squares, matrix};
use pigtail_numerics::signal::quantile;

/// A level that differs by less than this share of itself between slow and fast is one.
const LEAST: f64 = 0.02;

/// Deviations by which it differs at least.
const SURE: f64 = 5.0;

/// It slides where it has come so many times the way since it turned.
const SLID: f64 = 3.0;

/// Samples on either side over which a speed is taken.
const REACH: usize = 3;

/// Levels at the slowest and at the fastest twentieth of the sliding, N.
pub(super) fn levels(record: &Record, fitted: &Fitted) -> Option<[f64; 2]> {
    let law = fitted.law;
    if !record.has_time || law.needs_time() {
        return None;
    }
    let samples = &record.samples;
    let way = law.way(&fitted.values);
    let left = residuals(law, &fitted.values, samples, 0);
    let (mut columns, mut force): ([Vec<f64>; 5], Vec<f64>) = Default::default();
    let (mut turned, mut sign) = (samples.first()?.displacement, 0.0);
    for k in REACH..samples.len().saturating_sub(REACH) {
        let near = &samples[k - REACH..=k + REACH];
        let step = near[2 * REACH].displacement - near[0].displacement;
        if near[1..].iter().any(|s| s.begins) || step * sign <= 0.0 {
            (turned, sign) = (samples[k].displacement, step.signum());
            continue;
        }
        let far = (samples[k].displacement - turned).abs() / way;
        let speed = (step / (near[2 * REACH].time - near[0].time)).abs();
        if far < SLID || speed <= 0.0 {
            continue;
        }
        // What other contacts have that still give way goes with how far they have come.
        let row = [speed.ln(), 1.0, sign, (-far).exp(), (-far / SLID).exp()];
        columns.iter_mut().zip(row).for_each(|(c, v)| c.push(v));
        force.push(sign * left[k]);
    }
    if force.len() < super::LEAST {
        return None;
    }
    let (slow, fast) = (quantile(&columns[0], 0.05), quantile(&columns[0], 0.95));
    let middle = 0.5 * (slow + fast);
    columns[0].iter_mut().for_each(|speed| *speed -= middle);
    let all: Vec<&[f64]> = columns.iter().map(|c| &c[..]).collect();
    let found = least_squares(&matrix(&all), &force)?;
    let (slope, std) = (found.values[0], found.std_correlated[0]);
    let level = 0.5
        * law
            .sides(&fitted.values)
            .iter()
            .map(|s| s.abs())
            .sum::<f64>();
    let half = 0.5 * slope * (fast - slow);
    let told = slope.abs() > SURE * std && 2.0 * half.abs() > LEAST * level;
    told.then_some([level - half, level + half])
}

/// Finds which levels go with the speed, and makes them no surer than by how much they do.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    for fitted in laws {
        fitted.by_speed = levels(record, fitted);
        let Some([slow, fast]) = fitted.by_speed else {
            continue;
        };
        for (name, known) in fitted.law.parameters().iter().zip(&mut fitted.known) {
            if name.contains("friction") {
                known.std_correlated = known.std_correlated.hypot(0.5 * (fast - slow));
            }
        }
    }
}
