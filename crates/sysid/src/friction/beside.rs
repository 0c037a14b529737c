//! Forces beside friction: a spring, a damper, a mass.

use super::smooth::parabola;
use super::sure::{Other, by_other};
use super::tremble;
use super::{Fitted, Law, Record, fit, turned};
use pigtail_numerics::regression::{least_squares, matrix, relative};
use pigtail_numerics::signal::rms;

/// What friction leaves of a force has to be more than this to be looked at, per cent, and what it and another force
/// leave at most this share of that for the other one to be named.
const LEFT: f64 = 3.0;
const TWICE: f64 = 0.5;

const ROUNDS: usize = 6;

/// What else the force has in it, where that and friction tell it twice as well as the best law of friction, which leaves
/// `error` per cent.
pub(super) fn beside(record: &Record, error: f64) -> Option<String> {
    if error < LEFT {
        return None;
    }
    // A skew may have been taken for what is beside.
    let samples = record.raw.as_deref().unwrap_or(&record.samples);
    let (low, high) = record.range(|s| s.displacement);
    let turns = turned(samples, high - low).len().max(1);
    let reach = (samples.len() / turns / 20).clamp(2, 50);
    let motion: Vec<Option<[f64; 3]>> = (0..samples.len())
        .map(|k| parabola(samples, k, reach))
        .collect();
    let kept: Vec<usize> = (0..samples.len())
        .filter(|k| motion[*k].is_some())
        .collect();
    if kept.len() < super::LEAST {
        return None;
    }
    let known = if record.has_time { 3 } else { 1 };
    let columns: Vec<Vec<f64>> = (0..known)
        .map(|j| {
            kept.iter()
                .map(|k| motion[*k].map_or(0.0, |m| m[j]))
                .collect()
        })
        .collect();
    let force: Vec<f64> = kept.iter().map(|k| samples[*k].force).collect();
    let one = vec![1.0; kept.len()];
    let (mut of, mut left) = (vec![0.0; known], f64::INFINITY);
    for _ in 0..ROUNDS {
        let mut bare = samples.to_vec();
        for (s, motion) in bare.iter_mut().zip(&motion) {
            let part = motion.map_or(0.0, |m| m.iter().zip(&of).map(|(m, v)| m * v).sum());
            s.force -= part;
        }
        let bare = Record {
            samples: bare,
            ..record.clone()
        };
        let law = Law::Presliding;
        let friction = law.predict(&fit(law, &bare, &bare.samples, None)?, &bare.samples);
        let friction: Vec<f64> = kept.iter().map(|k| friction[*k]).collect();
        let mut all: Vec<&[f64]> = vec![&friction, &one];
        all.extend(columns.iter().map(|c| &c[..]));
        let found = least_squares(&matrix(&all), &force)?;
        of.copy_from_slice(&found.values[2..]);
        left = relative(&found.residuals, &force);
    }
    if left.is_nan() || left > TWICE * error {
        return None;
    }
    let size = |j: usize| of[j].abs() * rms(columns[j].iter().copied());
    let largest = (0..known).max_by(|a, b| size(*a).total_cmp(&size(*b)))?;
    let what = [
        "displacement, as of a spring",
        "velocity, as of viscous friction",
        "acceleration, as of a mass",
    ][largest];
    Some(format!(
        "beside friction its force has a part that goes with the {what}, of {:.3e} in SI units: with it {left:.3} % of the force \
         are left, without it {error:.3} %. No law here has that part; take it out of the force first",
        of[largest]
    ))
}

/// Makes laws less sure by what a little of such a force, too little to be named, makes of their parameters.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    let (samples, reach) = (&record.samples, tremble::reach(record));
    if !record.has_time || reach < 2 {
        return;
    }
    let motion: Vec<[f64; 3]> = (0..samples.len())
        .map(|k| parabola(samples, k, reach).unwrap_or_default())
        .collect();
    let columns: Vec<Vec<f64>> = (0..3)
        .map(|j| {
            // A constant is an offset.
            let mean = motion.iter().map(|m| m[j]).sum::<f64>() / motion.len() as f64;
            let size = rms(motion.iter().map(|m| m[j] - mean)).max(f64::MIN_POSITIVE);
            motion.iter().map(|m| (m[j] - mean) / size).collect()
        })
        .collect();
    for fitted in laws {
        // A law of speed knows what goes with it.
        let known = if fitted.law.needs_time() { 1 } else { 3 };
        let others: Vec<Other<'_>> = columns[..known].iter().map(|c| Other::Force(c)).collect();
        by_other(fitted, record, &others);
    }
}
