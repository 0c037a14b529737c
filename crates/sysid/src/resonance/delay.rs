//! How well a response tells a delay: filters and other dampings turn the phase as one does.

use super::record::{Filter, Record};
use super::search::{extend_pole, squares};
use super::{Known, Model, Unknown};
use crate::steady::chi_squared;
use nalgebra::{Complex, DMatrix, DVector};
use pigtail_numerics::nonlinear::{minimise, minimise_by, uncertainty_of_points};
use pigtail_numerics::regression::Solution;
use pigtail_numerics::signal::independent;
use pigtail_numerics::statistics::spread_of_mixture;
use std::f64::consts::SQRT_2;

/// That nothing is known of a delay that is unsure by more than itself, and by more than a third of a radian at the highest frequency
/// (`top`, rad/s): none at all may be known well.
pub(super) fn vague(delay: &Known, top: f64) -> Option<Unknown> {
    const MUCH: f64 = 1.0 / 3.0;
    let std = delay.std_correlated;
    (std > delay.value.abs() && std * top > MUCH).then(|| Unknown {
        parameters: vec!["delay"],
        because: format!(
            "what it says of a delay is {:.2e} s with a standard deviation of {std:.2e} s, as a filter about the highest frequency turns \
             the phase as well",
            delay.value
        ),
    })
}

/// The deviation of the first of some models' delay, `own` by itself, with how likely the others are, how far off their delays are and how unsure.
pub(super) fn between(models: &[Model], own: f64) -> f64 {
    /// Likely by less than this of the first one a model says nothing.
    const NOTHING: f64 = 1e-4;
    let at = |m: &Model| 2 * m.record.modes(&m.coded);
    let told = models.first().map_or(0.0, |m| m.coded[at(m)]);
    let others = models[1..].iter().filter(|m| m.likely > NOTHING);
    let others = others.filter_map(|m| {
        let known = m.record.known(&m.coded)?;
        let known = known.std[at(m)].max(known.std_correlated[at(m)]);
        Some((m.likely, m.coded[at(m)] - told, known))
    });
    spread_of_mixture(&others.chain([(1.0, 0.0, own)]).collect::<Vec<_>>())
}

/// How far the delay moves with what nobody knows of the model, as it is searched: whether modes are of proportional
/// damping, a real pole more or less, the lower or the upper half of the points alone.
pub(super) fn delay_spread(record: &Record, coded: &[f64]) -> f64 {
    /// Deviations of its own by which another delay is another one: what hardly tells a delay says nothing against it.
    const ANOTHER: f64 = 2.0;
    let at = 2 * record.modes(coded);
    let own = coded[at];
    let left = |record: &Record, coded: &[f64]| squares(&record.residuals(coded));
    let least = left(record, coded);
    let points = independent(&record.residuals(coded));
    let mut spread = 0.0_f64;
    // Of those of more parameters that tell it better than chance would, the one that the Bayesian information criterion asks for: where a
    // filter's pole turns each mode's residue, and nobody looked for that, modes of proportional damping tell a delay all the more
    // surely, and another one.
    let mut asked: Option<(f64, f64)> = None;
    let mut by_model = |known: Option<Solution>, left: f64, other: &[f64], more: usize| {
        let Some(known) = known.map(|s| s.std[at].max(s.std_correlated[at])) else {
            return;
        };
        let off = (other[at] - own).abs();
        let gained = points * (least / left).ln();
        // More numbers tell no less: a search that ended elsewhere.
        if more > 0 && gained < 0.0 {
            return;
        }
        if more > 0 && gained > chi_squared(more as f64) {
            let worth = gained - more as f64 * points.ln();
            if asked.is_none_or(|(most, _)| worth > most) {
                asked = Some((worth, off.hypot(known)));
            }
        } else if off > ANOTHER * known {
            spread = spread.max(off);
        }
    };
    let turned = Record {
        skewed: !record.skewed,
        ..record.clone()
    };
    if let Some((other, _)) = turned.settle(coded) {
        // A model that tells much worse says nothing.
        let told = left(&turned, &other);
        if told < 2.0 * least {
            let modes = if turned.skewed { at / 2 } else { 0 };
            by_model(turned.known(&other), told, &other, modes);
        }
    }
    let more = record.with_poles(record.poles + 1);
    if let Some(other) = extend_pole(&more, coded) {
        by_model(more.known(&other), left(&more, &other), &other, 2);
    }
    if let Some((other, told)) = a_filter(record, coded) {
        let known = uncertainty_of_points(|c| behind_a_filter(record, c), &other);
        by_model(known, told, &other, 1);
    }
    // With modes and poles as they are, by a part of the points.
    let n = record.frequency.len();
    for rows in [0..n / 2, n / 2..n, n / 4..3 * n / 4] {
        let part = Record {
            frequency: record.frequency[rows.clone()].to_vec(),
            response: record.response[rows.clone()].to_vec(),
            weight: record.weight[rows].to_vec(),
            ..record.clone()
        };
        // The delay is counted by the highest frequency, and so is a filter.
        let scale = part.highest() / record.highest();
        let residuals = |d: &[f64]| {
            let mut moved = coded.to_vec();
            moved[at] = d[0] * scale;
            if part.filter != Filter::None {
                moved[coded.len() - 1] *= scale;
            }
            part.residuals(&moved)
        };
        let known = uncertainty_of_points(residuals, &[own]).map(|s| s.std_correlated[0]);
        let found = minimise(residuals, &[own]).map(|(d, _)| d[0]);
        if let (Some(found), Some(known)) = (found, known)
            && (found - own).abs() > ANOTHER * known
        {
            spread = spread.max((found - own).abs());
        }
    }
    asked.map_or(spread, |(_, by)| spread.max(by))
}

/// What is left where all of a model went through a filter of one pole: its last number is how many times the highest frequency lies
/// above that.
///
/// A sensor's filter or an amplifier turns the phase as a delay does, and a magnitude tells how much of either there is. Of a model as a
/// sum its pole is one among several, and turns each mode's residue: so many numbers tell hardly what one does.
fn behind_a_filter(record: &Record, coded: &[f64]) -> Vec<f64> {
    let Some((above, model)) = coded.split_last() else {
        return Vec::new();
    };
    unfiltered(record, *above).residuals(model)
}

/// How that changes with the model's numbers and the filter's.
fn behind_a_filter_slopes(record: &Record, coded: &[f64]) -> Option<DMatrix<f64>> {
    /// A step of the filter's.
    const STEP: f64 = 1e-5;
    let (above, model) = coded.split_last()?;
    let slopes = unfiltered(record, *above).slopes_at(model)?;
    let beside = |by: f64| DVector::from_vec(unfiltered(record, above + by).residuals(model));
    let own = (beside(STEP) - beside(-STEP)) / (2.0 * STEP);
    let last = slopes.ncols();
    let mut all = slopes.insert_column(last, 0.0);
    all.set_column(last, &own);
    Some(all)
}

/// A response as it was before a filter of one pole.
fn unfiltered(record: &Record, above: f64) -> Record {
    let before = |k: usize| Complex::new(1.0, above * record.frequency[k] / record.highest());
    let points = 0..record.frequency.len();
    Record {
        response: points
            .clone()
            .map(|k| record.response[k] * before(k))
            .collect(),
        // What is left counts as it was measured.
        weight: points
            .map(|k| record.weight[k] / before(k).norm())
            .collect(),
        ..record.clone()
    }
}

/// Where a model begins of which the slowest real pole comes before the modes, below which it lies.
///
/// Creep beside or before the modes has the same magnitude, but before them it turns each by some thousandths, and so little is a
/// delay already.
pub(super) fn in_series(record: &Record, coded: &[f64]) -> Option<(Record, Vec<f64>)> {
    /// A share of creep to begin with.
    const BEGUN: f64 = 0.1;
    let modes = record.modes(coded);
    let lowest = coded[..2 * modes]
        .iter()
        .step_by(2)
        .copied()
        .fold(f64::INFINITY, f64::min);
    let poles = &coded[2 * modes + 1..][..record.poles];
    let (slowest, pole) = (0..).zip(poles).min_by(|a, b| a.1.total_cmp(b.1))?;
    if *pole > lowest || record.creeping {
        return None;
    }
    let mut start = coded.to_vec();
    start.remove(2 * modes + 1 + slowest);
    let at = start.len() - record.factors();
    start.splice(at..at, [BEGUN, *pole]);
    let record = Record {
        creeping: true,
        ..record.with_poles(record.poles - 1)
    };
    Some((record, start))
}

/// Where a model begins that went through Butterworth's filter of two poles, in the place of one pole where it has one.
pub(super) fn behind_two(record: &Record, coded: &[f64]) -> (Record, Vec<f64>) {
    /// A filter to begin with, its corner a little above the points.
    const BEGUN: f64 = 0.7;
    let mut start = coded.to_vec();
    if record.filter == Filter::None {
        // What a delay had of the filter's phase.
        start[2 * record.modes(coded)] -= SQRT_2 * BEGUN;
        start.push(BEGUN);
    }
    let record = Record {
        filter: Filter::Two,
        ..record.clone()
    };
    (record, start)
}

/// The numbers of a model behind a filter that tell a response best, the filter begun within and above the points; and what they leave, squared.
fn a_filter(record: &Record, coded: &[f64]) -> Option<(Vec<f64>, f64)> {
    const ABOVE: [f64; 2] = [0.3, 1.5];
    let delay = 2 * record.modes(coded);
    let filtered = record.filter != Filter::None;
    let settled = |above: &f64| {
        let mut start = [coded, &[*above][..]].concat();
        start[delay] -= above;
        let residuals = |c: &[f64]| behind_a_filter(record, c);
        minimise_by(residuals, |c| behind_a_filter_slopes(record, c), &start)
    };
    let above = |found: &[f64]| {
        let filters = &found[coded.len() - usize::from(filtered)..];
        filters.iter().all(|above| *above > 0.0)
    };
    ABOVE
        .iter()
        .filter_map(settled)
        .filter(|(found, _)| above(found))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}
