//! Whether all that a record holds says the same of its transmission: its parts, the moments of its channels, the models that tell it.

use super::{FOLDS, Fitted, Known, Record, Signals, TORQUE, Unknown};
use crate::steady::{SURE, between};

/// By how much a model's parameters are less sure than its own deviations, by name: by what parts of the record differ by, and by what small
/// torques say otherwise.
///
/// Batches of a record all have the same of a torque that was cut off, and their scatter says nothing of it.
pub(super) fn unsure(chosen: &Fitted, signals: &Signals) -> Vec<(&'static str, f64)> {
    let n = signals.time.len();
    let changes = |of: &dyn Fn(usize) -> bool| {
        signals.changes(chosen.parts, (chosen.way, &chosen.values), of)
    };
    let mut unsure: Vec<(&'static str, f64)> = Vec::new();
    let folds: Vec<_> = (0..FOLDS)
        .filter_map(|fold| changes(&|k| (fold * n / FOLDS..(fold + 1) * n / FOLDS).contains(&k)))
        .collect();
    if let [first, .., _] = &folds[..] {
        for (j, (name, ..)) in first.iter().enumerate() {
            let own: Vec<(f64, f64)> = folds.iter().map(|f| (f[j].1, f[j].2)).collect();
            unsure.push((name, between(&own)));
        }
    }
    if let Some(torque) = signals.torque.as_ref().filter(|_| chosen.parts.compliance) {
        /// Share of the largest torque up to which it is small: what is cut off, or bent, is so at its peaks.
        const SMALL: f64 = 0.7;
        let (low, high) = torque
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| {
                (l.min(*t), h.max(*t))
            });
        let small = |k: usize| (torque[k] - 0.5 * (low + high)).abs() < 0.5 * SMALL * (high - low);
        let other = changes(&small).into_iter().flatten();
        unsure.extend(
            other
                .filter(|(_, by, std)| by.abs() > SURE * std)
                .map(|(name, by, _)| (name, by)),
        );
    }
    unsure
}

/// That the transmission is the same throughout the record: parts that are told far better each by itself, and by another
/// compliance, are of other transmissions or of a torque of another gain.
pub(super) fn changing(chosen: &Fitted, signals: &Signals) -> Result<(), Unknown> {
    /// Parts, the share of the squares that they leave together where something changes, and by which share their compliances
    /// differ then.
    const PARTS: usize = 4;
    const LEFT: f64 = 0.5;
    const OTHER: f64 = 0.3;
    let columns = signals.columns(chosen.parts, chosen.way);
    let Some(at) = columns.iter().position(|(name, _)| *name == "compliance") else {
        return Ok(());
    };
    let n = signals.time.len();
    let squares = |values: &[f64], rows: &[usize]| -> f64 {
        let residuals = signals.residuals(&columns, values);
        rows.iter().map(|k| residuals[*k].powi(2)).sum()
    };
    let (mut own, mut whole, mut found) = (0.0, 0.0, Vec::new());
    for part in 0..PARTS {
        let within = part * n / PARTS..(part + 1) * n / PARTS;
        let rows: Vec<usize> = signals
            .settled
            .iter()
            .copied()
            .filter(|k| within.contains(k))
            .collect();
        let Some(values) = signals.values(&columns, &rows) else {
            continue;
        };
        own += squares(&values, &rows);
        whole += squares(&chosen.values, &rows);
        found.push(values[at]);
    }
    let (low, high) = (
        found.iter().copied().fold(f64::INFINITY, f64::min),
        found.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    );
    if own < LEFT * whole && high - low > OTHER * high.abs().max(low.abs()) {
        return Err(Unknown::all(format!(
            "one part of it says a compliance of {low:.3e} and another one {high:.3e}: did a gain of the torque or the \
             transmission change within it?"
        )));
    }
    Ok(())
}

/// That the torque is of the moments of the motor's position: one that tells the windup far better when it is taken to have been
/// written some samples earlier or later is of others.
pub(super) fn of_one_moment(
    record: &Record,
    chosen: &Fitted,
    signals: &Signals,
    (skew, raw): (f64, f64),
) -> Result<(), Unknown> {
    /// Samples that it is moved by, how often each way, the share of the squares that is left then, and the share of the windup
    /// that a model has to leave for anything to be asked.
    const STEP: usize = 4;
    const STEPS: usize = 6;
    const LEFT: f64 = 0.5;
    const MUCH: f64 = 0.02;
    if !record.has_torque || !chosen.parts.compliance || chosen.residual < MUCH * raw {
        return Ok(());
    }
    let squares = |signals: &Signals| -> Option<f64> {
        let columns = signals.columns(chosen.parts, chosen.way);
        let values = signals.values(&columns, &signals.settled)?;
        let residuals = signals.residuals(&columns, &values);
        Some(signals.settled.iter().map(|k| residuals[*k].powi(2)).sum())
    };
    let moved = |by: usize, later: bool| {
        let mut other = record.clone();
        for stretch in &mut other.even.stretches {
            let old = stretch.columns[TORQUE].clone();
            let last = old.len() - 1;
            for (k, torque) in stretch.columns[TORQUE].iter_mut().enumerate() {
                *torque = old[if later {
                    k.saturating_sub(by)
                } else {
                    (k + by).min(last)
                }];
            }
        }
        squares(&Signals::new(&other, skew))
    };
    let Some(plain) = squares(signals) else {
        return Ok(());
    };
    let best = (1..=STEPS)
        .flat_map(|k| [(k * STEP, false), (k * STEP, true)])
        .filter_map(|(by, later)| Some((moved(by, later)?, by, later)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((left, by, later)) if left < LEFT * plain => Err(Unknown::all(format!(
            "its torque is not of the moments of its positions: with it about {:.3} s {} it tells the windup far better",
            by as f64 * record.even.period,
            if later { "later" } else { "earlier" }
        ))),
        _ => Ok(()),
    }
}

/// A parameter as sure as the models agree on it that leave at most a quarter more than the chosen one, for none of them need be of the
/// transmission's own law; and less by what is [`unsure`] of it.
pub(super) fn agreed(
    models: &[Fitted],
    chosen: &Fitted,
    unsure: &[(&'static str, f64)],
    name: &str,
    known: Known,
) -> Known {
    const MORE: f64 = 1.25;
    let apart = models
        .iter()
        .filter(|m| m.held_back <= MORE * chosen.held_back)
        .filter_map(|m| m.parameters.iter().find(|p| p.0 == name))
        .map(|(_, other)| {
            let off = (other.value - known.value).powi(2);
            off - known.std_correlated.powi(2) - other.std_correlated.powi(2)
        })
        .filter(|squares| squares.is_finite())
        .fold(0.0, f64::max);
    let own = unsure.iter().filter(|(of, _)| *of == name);
    let std = known.std_correlated.hypot(apart.sqrt());
    Known {
        std_correlated: own.fold(std, |std, (_, by)| std.hypot(*by)),
        ..known
    }
}
