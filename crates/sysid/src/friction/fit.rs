//! The parameters of a law that tell a record's force best.

use super::{LEAST, Law, Record, Sample};
use pigtail_numerics::nonlinear::minimise;
use pigtail_numerics::regression::{least_squares, matrix, relative};
use pigtail_numerics::signal::quantile;

pub(super) fn residuals(law: Law, parameters: &[f64], samples: &[Sample], from: usize) -> Vec<f64> {
    law.predict(parameters, samples)
        .iter()
        .zip(samples)
        .skip(from)
        .map(|(told, s)| s.force - told)
        .collect()
}

/// At which samples a contact has forgotten the state in which their stretch began, once the displacement has ranged over the ways of both
/// directions. What it began in is told by the force of one sample: its noise shows in all of a first transition, and the more of them
/// there are the less their scatter tells of that. All, where hardly any has.
pub(super) fn settled(law: Law, values: &[f64], samples: &[Sample]) -> Vec<bool> {
    let reach = law
        .ways(values)
        .iter()
        .sum::<f64>()
        .max(2.0 * law.way(values));
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let settled: Vec<bool> = samples
        .iter()
        .map(|s| {
            if s.begins {
                (low, high) = (s.displacement, s.displacement);
            }
            (low, high) = (low.min(s.displacement), high.max(s.displacement));
            high - low >= reach
        })
        .collect();
    if 2 * settled.iter().filter(|s| **s).count() < samples.len() {
        return vec![true; samples.len()];
    }
    settled
}

/// What a law leaves of the force at the samples that count.
pub(super) fn counted(
    law: Law,
    parameters: &[f64],
    samples: &[Sample],
    counts: &[bool],
) -> Vec<f64> {
    let left = residuals(law, parameters, samples, 0)
        .into_iter()
        .zip(counts);
    left.filter_map(|(left, counts)| counts.then_some(left))
        .collect()
}

pub(super) fn error(law: Law, parameters: &[f64], samples: &[Sample], from: usize) -> f64 {
    let measured: Vec<f64> = samples[from..].iter().map(|s| s.force).collect();
    relative(&residuals(law, parameters, samples, from), &measured)
}

/// The parameters that fit best, from several ways over which the level may be reached, or from `near`.
pub(super) fn fit(
    law: Law,
    record: &Record,
    samples: &[Sample],
    near: Option<&[f64]>,
) -> Option<Vec<f64>> {
    let force = record.largest_force();
    let (low, high) = record.range(|s| s.displacement);
    let speeds: Vec<f64> = record
        .samples
        .windows(2)
        .filter(|w| !w[1].begins && w[1].displacement != w[0].displacement)
        .map(|w| ((w[1].displacement - w[0].displacement) / (w[1].time - w[0].time)).abs())
        .collect();
    let counts = near.map_or_else(
        || vec![true; samples.len()],
        |near| settled(law, near, samples),
    );
    let scaled = |coded: &[f64]| -> Vec<f64> {
        // Nothing physical lies e^60 away.
        if coded.iter().any(|c| c.abs() > 60.0) {
            return vec![f64::NAN; samples.len()];
        }
        let parameters = law.decoded(coded, force);
        let residuals = counted(law, &parameters, samples, &counts);
        residuals.into_iter().map(|l| l / force).collect()
    };
    let squares = |coded: &[f64]| -> f64 { scaled(coded).iter().map(|l| l * l).sum() };
    let mut starts: Vec<(f64, Vec<f64>)> = if let Some(near) = near {
        vec![(0.0, law.coded(near, force))]
    } else {
        let shares = [0.003, 0.01, 0.03, 0.08, 0.15, 0.25, 0.4];
        let speeds: &[f64] = if law.needs_time() {
            &[quantile(&speeds, 0.2), quantile(&speeds, 0.7)]
        } else {
            &[1.0]
        };
        shares
            .iter()
            .flat_map(|share| speeds.iter().map(move |speed| (share, speed)))
            .flat_map(|(share, speed)| {
                let start = law.start(force, share * (high - low), *speed);
                // A static level far above, next to, or below the sliding one: LuGre has a minimum near each.
                let ratios: &[f64] = if law.needs_time() {
                    &[0.8, 1.02, 1.1, 1.6]
                } else {
                    &[1.0]
                };
                let with = |ratio: &f64| {
                    let mut start = start.clone();
                    if law.needs_time() {
                        start[2] = ratio * start[0];
                    }
                    let coded = law.coded(&start, force);
                    (squares(&coded), coded)
                };
                ratios.iter().map(with).collect::<Vec<_>>()
            })
            .collect()
    };
    if law.needs_time() && near.is_none() {
        for share in [0.01, 0.03, 0.1, 0.3] {
            if let Some((coulomb, still, speed)) = stribeck(samples, share * (high - low)) {
                let mut start = law.start(coulomb, share * (high - low), speed);
                start[2] = still;
                let coded = law.coded(&start, force);
                starts.push((squares(&coded), coded));
            }
        }
    }
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let tried = if law.needs_time() { 8 } else { 3 };
    let (coded, _) = starts
        .iter()
        .take(tried)
        .filter_map(|(_, start)| minimise(scaled, start))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(law.decoded(&coded, force))
}

/// Coulomb and static friction and the speed between them, by the force where it has slid for `way` since it turned:
/// `g = f_c + (f_s - f_c) exp(-(v / v_s)^2)`, linear but for the speed.
fn stribeck(samples: &[Sample], way: f64) -> Option<(f64, f64, f64)> {
    const SPEEDS: usize = 12;
    let (mut speeds, mut forces) = (Vec::new(), Vec::new());
    let mut turned = samples.first()?.displacement;
    let mut sign = 0.0;
    for w in samples.windows(2) {
        let step = w[1].displacement - w[0].displacement;
        if w[1].begins || step * sign < 0.0 {
            turned = w[0].displacement;
        }
        if step != 0.0 {
            sign = step.signum();
        }
        if !w[1].begins && step != 0.0 && (w[1].displacement - turned).abs() > way {
            speeds.push((step / (w[1].time - w[0].time)).abs());
            forces.push(sign * w[1].force);
        }
    }
    let (slow, fast) = (quantile(&speeds, 0.05), quantile(&speeds, 0.95));
    if speeds.len() < LEAST || slow.is_nan() || slow <= 0.0 || fast <= slow {
        return None;
    }
    let one = vec![1.0; speeds.len()];
    (0..=SPEEDS)
        .filter_map(|k| {
            let speed = slow * (fast / slow).powf(k as f64 / SPEEDS as f64);
            let falls: Vec<f64> = speeds
                .iter()
                .map(|v| (-(v / speed).powi(2)).exp())
                .collect();
            let found = least_squares(&matrix(&[&one, &falls]), &forces)?;
            let (coulomb, still) = (found.values[0], found.values[0] + found.values[1]);
            (coulomb > 0.0 && still > 0.0)
                .then_some((found.relative_error_percent, (coulomb, still, speed)))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, found)| found)
}
