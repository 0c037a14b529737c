//! A displacement that goes to and fro about its motion: steps of a coarse sensor, smoothed or not, a hum, play.
//!
//! Where a contact turns is read off the displacement, and what trembles moves the farthest place outward, noise as well as all else that
//! is slower than a sample. Noise is looked at where laws are fitted; the rest shows beside parabolas through the motion.

use super::smooth::parabola;
use super::{Fitted, Record, turned};
use pigtail_numerics::signal::quantile;

/// Parabolas from one turn to the next.
const EACH: usize = 8;

/// Turns of a motion are so many times as wide as those that a law looks at, a fifth of the stroke: what trembles turns by more than a
/// fiftieth of it. Once, until a hum of half the way had not been seen.
const WIDE: f64 = 10.0;

/// So many times the noise from sample to sample it is where it trembles.
const MORE: f64 = 1.5;

/// The third quartile of the sizes of normal numbers over their deviation.
const QUARTILE: f64 = 1.1503;

/// By how much, as a standard deviation. Zero where it is the noise of each sample.
pub(super) fn tremble(record: &Record) -> f64 {
    let samples = &record.samples;
    let (low, high) = record.range(|s| s.displacement);
    let turns = turned(samples, WIDE * (high - low)).len().max(1);
    let reach = samples.len() / (2 * EACH * turns);
    if reach < 2 {
        return 0.0;
    }
    let beside: Vec<f64> = (0..samples.len())
        .step_by(reach.div_ceil(4))
        .filter_map(|k| Some((samples[k].displacement - parabola(samples, k, reach)?[0]).abs()))
        .collect();
    let size = quantile(&beside, 0.75) / QUARTILE;
    // Of white noise the second difference has six times the power.
    let seconds: Vec<f64> = samples
        .windows(3)
        .filter(|w| !w[1].begins && !w[2].begins)
        .map(|w| (w[0].displacement - 2.0 * w[1].displacement + w[2].displacement).abs())
        .collect();
    let noise = quantile(&seconds, 0.75) / (QUARTILE * 6f64.sqrt());
    if size > MORE * noise {
        (size * size - noise * noise).sqrt()
    } else {
        0.0
    }
}

/// Makes laws less sure by it: a way by the half of a step whose error has that deviation, a stiffness by as large a share, and a level by
/// the share of the stroke where the contact's state is another one for it.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    let by = 3f64.sqrt() * record.tremble;
    let (low, high) = record.range(|s| s.displacement);
    for fitted in laws {
        let way = fitted.law.way(&fitted.values);
        for (name, known) in fitted.law.parameters().iter().zip(&mut fitted.known) {
            let off = match *name {
                "stiffness" => known.value * by / way,
                name if name.starts_with("presliding") || name.ends_with("slip") => by,
                name if name.contains("friction") => known.value * by / (high - low),
                _ => 0.0,
            };
            known.std_correlated = known.std_correlated.hypot(off);
        }
    }
}
