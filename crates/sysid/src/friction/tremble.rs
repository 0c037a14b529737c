//! A displacement that goes to and fro about its motion: steps of a coarse sensor, smoothed or not, a hum, play.
//!
//! Where a contact turns is read off the displacement, and what trembles moves the farthest place outward, noise as well as all else that
//! is slower than a sample. Noise is looked at where laws are fitted; the rest shows beside parabolas through the motion, and, where no
//! parabola through the motion is as fine, by the force: where a contact gives way it says where it is.

use super::fit::settled;
use super::smooth::parabola;
use super::{Fitted, LEAST, Record, Sample, residuals, turned};
use crate::steady::SURE;
use pigtail_numerics::signal::{independent, quantile, rms};

/// Parabolas from one turn to the next.
const EACH: usize = 8;

/// Turns of a motion are so many times as wide as those that a law looks at, a fifth of the stroke: what trembles turns by more than a
/// fiftieth of it. Once, until a hum of half the way had not been seen.
const WIDE: f64 = 10.0;

/// So many times the noise from sample to sample it is where it trembles.
const MORE: f64 = 1.5;

/// The third quartile of the sizes of normal numbers over their deviation.
const QUARTILE: f64 = 1.1503;

/// Samples on either side of parabolas of which there are so many from one turn to the next.
pub(super) fn reach(record: &Record) -> usize {
    let (low, high) = record.range(|s| s.displacement);
    let turns = turned(&record.samples, WIDE * (high - low)).len().max(1);
    record.samples.len() / (2 * EACH * turns)
}

/// By how much, as a standard deviation. Zero where it is the noise of each sample.
pub(super) fn tremble(record: &Record) -> f64 {
    let (samples, reach) = (&record.samples, reach(record));
    if reach < 2 {
        return 0.0;
    }
    let beside: Vec<f64> = (0..samples.len())
        .step_by(reach.div_ceil(4))
        .filter_map(|k| Some((samples[k].displacement - parabola(samples, k, reach)?[0]).abs()))
        .collect();
    let size = quantile(&beside, 0.75) / QUARTILE;
    let noise = noise(&record.samples);
    if size > MORE * noise {
        (size * size - noise * noise).sqrt()
    } else {
        0.0
    }
}

/// Deviation of the displacement's noise from sample to sample, by how far each lies from the line through its neighbours: by their
/// moments, or as if they were evenly apart, where that leaves less. Of samples that were taken unevenly a second difference is mostly
/// speed, and of some that were stamped unevenly a line by their moments.
pub(super) fn noise(samples: &[Sample]) -> f64 {
    let beside = |share: &dyn Fn(&[Sample]) -> f64| {
        let sizes: Vec<f64> = samples
            .windows(3)
            .filter(|w| !w[1].begins && !w[2].begins)
            .map(|w| {
                let share = share(w);
                let [before, own, behind] = [0, 1, 2].map(|k| w[k].displacement);
                let beside = own - before - share * (behind - before);
                beside.abs() / (1.0 + share * share + (1.0 - share).powi(2)).sqrt()
            })
            .collect();
        quantile(&sizes, 0.75) / QUARTILE
    };
    let by_time = |w: &[Sample]| {
        let share = (w[1].time - w[0].time) / (w[2].time - w[0].time);
        if share.is_finite() { share } else { 0.5 }
    };
    beside(&|_| 0.5).min(beside(&by_time))
}

/// A contact slides where a law's force is within this share of a side's level.
const SLIDES: f64 = 0.03;

/// By how much the displacement is another one where the contact gives way than the one that is written, as a standard deviation, by what
/// a law leaves of the force there beyond what it leaves where the contact slides, and what noise of each sample makes of it.
///
/// Steps of a coarse sensor that were smoothed, and a motion that was, turn elsewhere than the contact did, alike at each turn: batches all
/// have the same of it, and do not tell.
fn astray(record: &Record, fitted: &Fitted) -> f64 {
    let (law, values) = (fitted.law, &fitted.values);
    let [forward, backward] = law.sides(values);
    let both = forward + backward;
    let told = law.predict(values, &record.samples);
    let left = residuals(law, values, &record.samples, 0);
    let counts = settled(law, values, &record.samples);
    let (mut gives, mut slides) = (Vec::new(), Vec::new());
    for ((told, left), _) in told
        .iter()
        .zip(left)
        .zip(counts)
        .filter(|(_, counts)| *counts)
    {
        let near = (forward - told).abs().min((backward + told).abs());
        if near < SLIDES * both {
            slides.push(left);
        } else {
            gives.push(left);
        }
    }
    if gives.len() < LEAST || slides.len() < LEAST {
        return 0.0;
    }
    let stiffness = 0.5 * both / law.way(values);
    let own = rms(slides.iter().copied()).hypot(stiffness * record.noise);
    let chance = (2.0 / independent(&gives) + 2.0 / independent(&slides)).sqrt();
    let power = rms(gives.iter().copied()).powi(2);
    if power > own * own * (1.0 + SURE * chance) {
        (power - own * own).sqrt() / stiffness
    } else {
        0.0
    }
}

/// Makes laws less sure by it: a way by the half of a step whose error has that deviation, or by what the force says of the displacement, a
/// stiffness by as large a share, and a level by the share of the stroke where the contact's state is another one for it.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    let trembles = 3f64.sqrt() * record.tremble;
    let (low, high) = record.range(|s| s.displacement);
    for fitted in laws {
        let by = trembles.max(astray(record, fitted));
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
