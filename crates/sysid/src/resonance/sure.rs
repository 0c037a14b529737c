//! How sure a response is of its modes and its delay.

use super::Record;
use super::search::{extend_pole, improbable};
use nalgebra::DMatrix;
use pigtail_numerics::nonlinear::{minimise, uncertainty_of_points};
use pigtail_numerics::signal::rms;

/// The deviation of what is left of each row of points: one part that all have, and one that goes with how much of the response is
/// there (`share`, of magnitude and weight). A gamma law's two numbers, by squares; `fitted` numbers were fitted to the rows.
pub(super) fn spread(residuals: &[f64], share: &[f64], fitted: usize) -> Vec<f64> {
    const ROUNDS: usize = 5;
    let n = residuals.len();
    let squares: Vec<f64> = residuals.iter().map(|r| r * r).collect();
    let of_share = |i: usize| share[i % share.len()].powi(2);
    let mean = squares.iter().sum::<f64>() / n as f64;
    let mut variance = vec![mean; n];
    for _ in 0..ROUNDS {
        let mut sums = [0.0; 5];
        for i in 0..n {
            let (w, g, s) = (variance[i].powi(-2), of_share(i), squares[i]);
            for (sum, part) in sums.iter_mut().zip([1.0, g, g * g, s, g * s]) {
                *sum += w * part;
            }
        }
        let [one, g, gg, s, gs] = sums;
        let determinant = one * gg - g * g;
        let both = [
            (gg * s - g * gs) / determinant,
            (one * gs - g * s) / determinant,
        ];
        let [all, with] = if determinant <= 1e-9 * one * gg || both[1] < 0.0 {
            [s / one, 0.0]
        } else if both[0] < 0.0 {
            [0.0, gs / gg]
        } else {
            both
        };
        // No row is so much surer than the others that it decides alone.
        let least = 0.01 * mean.max(f64::MIN_POSITIVE);
        variance = (0..n)
            .map(|i| (all + with * of_share(i)).max(least))
            .collect();
    }
    let freedom = n.saturating_sub(fitted).max(1) as f64;
    let even: f64 = squares.iter().zip(&variance).map(|(s, v)| s / v).sum();
    variance
        .iter()
        .map(|v| (v * even / freedom).sqrt())
        .collect()
}

/// How far the delay moves with what nobody knows of the model, as it is searched: whether modes are of proportional
/// damping, a real pole more, the lower or the upper half of the points alone.
///
/// An interval of 95 % leaves out what is less probable than a twentieth: another model counts where the points leave it more than that, by
/// the Bayesian information criterion. Any other delay that it has is chance, or a part of the model that the points deny.
pub(super) fn delay_spread(record: &Record, coded: &[f64]) -> f64 {
    let at = 2 * record.modes(coded);
    let own = coded[at];
    let mut others = Vec::new();
    let mut counts = |other: &Record, found: Option<Vec<f64>>| {
        if let Some(found) = found
            && improbable((other, &found), (record, coded)).is_some_and(|ratio| ratio < 19.0)
        {
            others.push(found[at]);
        }
    };
    let turned = Record {
        skewed: !record.skewed,
        ..record.clone()
    };
    counts(
        &turned,
        minimise(|c| turned.residuals(c), coded).map(|(c, _)| c),
    );
    let more = record.with_poles(record.poles + 1);
    counts(&more, extend_pole(&more, coded));
    // With modes and poles as they are, by a part of the points.
    let n = record.frequency.len();
    for rows in [0..n / 2, n / 2..n, n / 4..3 * n / 4] {
        let part = Record {
            frequency: record.frequency[rows.clone()].to_vec(),
            response: record.response[rows.clone()].to_vec(),
            weight: record.weight[rows].to_vec(),
            ..record.clone()
        };
        // The delay is counted by the highest frequency.
        let scale = part.highest() / record.highest();
        let residuals = |d: &[f64]| {
            let mut moved = coded.to_vec();
            moved[at] = d[0] * scale;
            part.residuals(&moved)
        };
        let even = vec![rms(residuals(&[own])); 2 * part.frequency.len()];
        let none = DMatrix::zeros(even.len(), 0);
        let known =
            uncertainty_of_points(residuals, &[own], (&even, &none)).map(|s| s.std_correlated[0]);
        let found = minimise(residuals, &[own]).map(|(d, _)| d[0]);
        // A part that hardly tells a delay says nothing against another.
        if let (Some(found), Some(known)) = (found, known)
            && (found - own).abs() > 3.0 * known
        {
            others.push(found);
        }
    }
    others.iter().map(|o| (o - own).abs()).fold(0.0, f64::max)
}
