//! A response whose points were averaged with their neighbours before they were written.
//!
//! Means over more than a peak's width make a wider peak of it, in magnitude and phase alike, and points on it and beside it: a few modes
//! tell that to some per cent, with dampings two and three times too large. The same modes, averaged as the points were, tell it better.

use super::Record;
use super::rows::off_by;
use super::search::squares;
use nalgebra::{Complex, DVector};
use pigtail_numerics::nonlinear::minimise;
use pigtail_numerics::signal::independent;
use std::f64::consts::{PI, TAU};

/// Points that may have been averaged.
const POINTS: [usize; 7] = [3, 5, 7, 11, 17, 27, 41];

/// Of a response that its modes tell, what is left is the noise of single points, and its power that of their second differences. A response is
/// asked about where it is so many times that.
const MORE: f64 = 2.0;

/// Share of a damping from which the one before the mean is looked for.
const NARROWER: f64 = 0.4;

/// Of how likely a mean is no more than this logarithm counts.
const SURELY: f64 = 300.0;

/// What was averaged.
#[derive(Debug, Clone, Copy)]
enum Mean {
    /// Real and imaginary part.
    Parts,
    /// Magnitude and phase.
    Sizes,
}

/// Means of so many neighbours; of fewer at the ends.
fn means(values: &[f64], points: usize) -> Vec<f64> {
    let reach = points / 2;
    (0..values.len())
        .map(|k| {
            let near = &values[k.saturating_sub(reach)..(k + reach + 1).min(values.len())];
            near.iter().sum::<f64>() / near.len() as f64
        })
        .collect()
}

/// A response as it is after a mean.
fn after(mean: Mean, points: usize, told: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let pairs = |a: Vec<f64>, b: Vec<f64>| a.into_iter().zip(b);
    match mean {
        Mean::Parts => {
            let parts: Vec<f64> = told.iter().map(|h| h.re).collect();
            let others: Vec<f64> = told.iter().map(|h| h.im).collect();
            pairs(means(&parts, points), means(&others, points))
                .map(|(re, im)| Complex::new(re, im))
                .collect()
        }
        Mean::Sizes => {
            let sizes: Vec<f64> = told.iter().map(|h| h.norm()).collect();
            let mut last = 0.0;
            let turns: Vec<f64> = told
                .iter()
                .map(|h| {
                    let turn = h.arg();
                    last = turn + TAU * ((last - turn + PI) / TAU).floor();
                    last
                })
                .collect();
            pairs(means(&sizes, points), means(&turns, points))
                .map(|(size, turn)| Complex::from_polar(size, turn))
                .collect()
        }
    }
}

/// By how much the logarithms of what is searched, and the delay, would be others if points were averaged, by how likely that is. Where what is
/// left goes with its neighbours a mean, which makes it so, is as likely beforehand as none: a choice.
pub(super) fn open(record: &Record, coded: &[f64], values: &[f64]) -> Vec<f64> {
    let none = vec![0.0; coded.len()];
    let (own, n) = (record.residuals(coded), record.frequency.len());
    let noise = |left: &[f64]| {
        let seconds = left.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2));
        seconds.sum::<f64>() / 6.0
    };
    let white = noise(&own[..n]) + noise(&own[n..]);
    if record.lean.is_some() || squares(&own) < MORE * white {
        return none;
    }
    let bare = Record {
        weight: vec![1.0; n],
        ..record.clone()
    };
    let sizes: Vec<f64> = values.iter().map(|v| v.abs().max(1e-12)).collect();
    let left = |mean: Mean, points: usize, p: &[f64]| -> Vec<f64> {
        let (coded, linear) = p.split_at(coded.len());
        if p.iter().any(|p| p.is_nan() || p.abs() >= 60.0) {
            return vec![f64::NAN; 2 * n];
        }
        let linear = DVector::from_fn(linear.len(), |j, _| linear[j] * sizes[j]);
        let told = bare.columns(coded) * linear;
        let told: Vec<Complex<f64>> = (0..n).map(|k| Complex::new(told[k], told[n + k])).collect();
        let off: Vec<Complex<f64>> = after(mean, points, &told)
            .iter()
            .zip(&record.response)
            .zip(&record.weight)
            .map(|((told, is), weight)| (is - told) * *weight)
            .collect();
        let parts = off.iter().map(|o| o.re);
        parts.chain(off.iter().map(|o| o.im)).collect()
    };
    let mut start = coded.to_vec();
    for damping in start[..2 * record.modes(coded)]
        .iter_mut()
        .skip(1)
        .step_by(2)
    {
        *damping += NARROWER.ln();
    }
    start.extend(values.iter().zip(&sizes).map(|(v, size)| v / size));
    let told: Vec<(f64, Vec<f64>)> = [Mean::Parts, Mean::Sizes]
        .into_iter()
        .flat_map(|mean| POINTS.map(|points| (mean, points)))
        .filter(|(_, points)| 4 * points < n)
        .filter_map(|(mean, points)| {
            let (found, _) = minimise(|p| left(mean, points, p), &start)?;
            let left = left(mean, points, &found);
            let gain = (squares(&own) / squares(&left)).ln();
            // What a worse model leaves goes with its neighbours, whatever the noise does.
            let gain = gain * independent(if gain > 0.0 { &left } else { &own });
            // As much more likely as it can be told apart.
            gain.is_finite()
                .then(|| ((0.5 * gain).min(SURELY).exp(), found))
        })
        .collect();
    let others = told
        .iter()
        .map(|(likely, found)| (*likely, &found[..coded.len()]));
    off_by(coded, others)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damping_before_a_mean_over_more_than_its_peak_is_looked_for() {
        let noise = |k: usize| 1e-3 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0);
        let frequency: Vec<f64> = (0..500).map(|k| 50.0 + 0.5 * f64::from(k)).collect();
        let truth: Vec<Complex<f64>> = frequency
            .iter()
            .enumerate()
            .map(|(k, f)| {
                let below = Complex::new(150.0_f64.powi(2) - f * f, 2.0 * 0.01 * 150.0 * f);
                150.0_f64.powi(2) / below * (1.0 + noise(k))
            })
            .collect();
        let opens = |response: &[Complex<f64>]| {
            let record = Record::new(&frequency, response, None).unwrap();
            let start = [(TAU * 150.0).ln(), 0.02_f64.ln(), 0.0];
            let (coded, _) = record.settle(&start).unwrap();
            let (values, _) = record.linear(&coded).unwrap();
            (coded[1].exp(), open(&record, &coded, &values)[1])
        };
        assert!(opens(&truth).1 < 1e-6);
        let (told, open) = opens(&after(Mean::Sizes, 25, &truth));
        assert!(
            told > 0.015 && (told.ln() - open - 0.01_f64.ln()).abs() < 0.1,
            "{told} {open}"
        );
    }
}
