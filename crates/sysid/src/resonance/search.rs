//! The search for a response's modes, real poles and delay, and what of it is kept.

use super::record::Filter;
use super::{ENOUGH, MODES, Record, WORTH};
use pigtail_numerics::signal::independent;
use std::f64::consts::TAU;

pub(super) fn squares(residuals: &[f64]) -> f64 {
    residuals.iter().map(|l| l * l).sum()
}

/// Adds a mode where it helps most, and lets all of them settle.
pub(super) fn extend(record: &Record, coded: &[f64]) -> Option<Vec<f64>> {
    const PLACES: usize = 50;
    let (low, high) = (record.frequency[0], record.highest());
    let n = record.frequency.len();
    let places = (0..PLACES).map(|k| {
        // Half of them spread over the points, half over the logarithm of frequency.
        let share = (k / 2) as f64 / (PLACES / 2 - 1) as f64;
        if k % 2 == 0 {
            record.frequency[((n - 1) as f64 * share) as usize]
        } else {
            low * (high / low).powf(share)
        }
    });
    let left = record.with_a_mode(coded);
    let mut tries = Vec::new();
    for place in places {
        for zeta in [0.005_f64, 0.02, 0.08, 0.3] {
            let mut with = coded.to_vec();
            let (at, mode) = (2 * record.modes(coded), [(TAU * place).ln(), zeta.ln()]);
            with.splice(at..at, mode);
            tries.push((left(mode), with));
        }
    }
    tries.retain(|t| t.0.is_finite());
    tries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let best = tries
        .into_iter()
        .take(2)
        .filter_map(|(_, start)| record.settle(&start))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(best.0)
}

/// Adds a real pole to a record of one less, where it helps most.
pub(super) fn extend_pole(record: &Record, coded: &[f64]) -> Option<Vec<f64>> {
    const PLACES: usize = 16;
    let (low, high) = (0.3 * record.frequency[0], record.highest());
    // What comes before and behind all stands last.
    let last = coded.len() - record.factors();
    let mut tries: Vec<(f64, Vec<f64>)> = (0..PLACES)
        .map(|k| {
            let place = low * (high / low).powf(k as f64 / (PLACES - 1) as f64);
            let mut with = coded.to_vec();
            with.insert(last, (TAU * place).ln());
            (squares(&record.residuals(&with)), with)
        })
        .filter(|t| t.0.is_finite())
        .collect();
    tries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let settle = |(_, start): (f64, Vec<f64>)| record.settle(&start);
    let best = tries
        .into_iter()
        .take(2)
        .filter_map(settle)
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let within = |c: &f64| (0.05 * record.frequency[0]..FARTHEST * high).contains(&(c.exp() / TAU));
    let poles = &best.0[..=last][last + 1 - record.poles..];
    poles.iter().all(within).then_some(best.0)
}

/// How many times the highest frequency a real pole may lie at.
pub(super) const FARTHEST: f64 = 3.0;

/// The Bayesian information criterion of a model (G. Schwarz, 1978) by how many points there are; the least is asked for.
pub(super) fn criterion(record: &Record, coded: &[f64], points: f64) -> f64 {
    let numbers = (coded.len() + record.linear_parts(coded)) as f64;
    points * squares(&record.residuals(coded)).ln() + numbers * points.ln()
}

/// How many points what is left has of its own: the correlation of neighbours taken off, and those that carry nothing.
pub(super) fn own_points(left: &[f64]) -> f64 {
    independent(left) * carrying(left)
}

/// Whether a mode is one: within the points, and not so damped that it is no resonance.
pub(super) fn is_mode(record: &Record, pair: &[f64]) -> bool {
    let (frequency, zeta) = (pair[0].exp() / TAU, pair[1].exp());
    (0.9 * record.frequency[0]..1.1 * record.highest()).contains(&frequency) && zeta < 0.7
}

/// Modes and delay from every second point.
pub(super) struct Found {
    pub(super) coded: Vec<f64>,
    /// Real poles among them.
    pub(super) poles: usize,
    /// Relative error at the points held back, and without a mode.
    pub(super) error: f64,
    pub(super) none: f64,
}

/// The error has many minima over the delay, and the slope of the phase is that of the modes too: from
/// several shares of what it says.
pub(super) fn search(record: &Record) -> Found {
    /// Radians at the highest frequency by which delays differ that are of one minimum.
    const ONE: f64 = 1e-4;
    /// A filter is begun about the highest frequency.
    const BEGUN: f64 = 1.0;
    let slope = record.delay();
    let every = record.frequency.len().div_ceil(2 * ENOUGH);
    let even = record.points(0, 2 * every);
    let filter: &[f64] = match record.filter {
        Filter::None => &[],
        _ => &[BEGUN],
    };
    let mut delays: Vec<Vec<f64>> = Vec::new();
    for share in [0.0, 0.15, 0.3, 0.5, 0.75, 1.0] {
        let start = share * slope;
        let start = [&[start][..], filter].concat();
        let settled = even.settle(&start).map_or(start, |(c, _)| c);
        if delays.iter().all(|d| (d[0] - settled[0]).abs() > ONE) {
            delays.push(settled);
        }
    }
    let mut seen = Vec::new();
    delays
        .iter()
        .filter_map(|delay| search_from(record, delay, &mut seen))
        .min_by(|a, b| a.error.total_cmp(&b.error))
        .unwrap_or(Found {
            coded: [&[0.0][..], filter].concat(),
            poles: 0,
            error: f64::INFINITY,
            none: f64::INFINITY,
        })
}

/// What a search has come to: numbers of a model and how many real poles are among them.
type Met = (usize, Vec<f64>);

/// Whether a search has come to where one has been, be it with its modes in another order: from there on they are one.
fn been(seen: &mut Vec<Met>, record: &Record, poles: usize, coded: &[f64]) -> bool {
    /// By which logarithms differ that are of one minimum.
    const ONE: f64 = 1e-4;
    let modes = 2 * record.with_poles(poles).modes(coded);
    let mut pairs: Vec<&[f64]> = coded[..modes].chunks_exact(2).collect();
    pairs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let met = (poles, [&pairs.concat(), &coded[modes..]].concat());
    let alike = |other: &Met| {
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < ONE;
        other.0 == met.0 && other.1.len() == met.1.len() && other.1.iter().zip(&met.1).all(near)
    };
    let been = seen.iter().any(alike);
    seen.push(met);
    been
}

/// A search from a delay, and a filter where there is one, that a response without modes has settled at.
/// `None` where it comes to where another one has been.
fn search_from(record: &Record, delay: &[f64], seen: &mut Vec<Met>) -> Option<Found> {
    let every = record.frequency.len().div_ceil(2 * ENOUGH);
    let (even, odd) = (record.points(0, 2 * every), record.points(every, 2 * every));
    let judged = |coded: &[f64], poles: usize| {
        let odd = odd.with_poles(poles);
        even.with_poles(poles)
            .linear(coded)
            .map_or(f64::INFINITY, |(values, _)| odd.error(coded, &values))
    };
    let mut coded = delay.to_vec();
    let mut poles = 0;
    let mut error = judged(&coded, poles);
    let none = error;
    loop {
        let own = even.with_poles(poles);
        let modes = own.modes(&coded);
        let mut next: Vec<(f64, usize, Vec<f64>)> = Vec::new();
        if modes < MODES
            && let Some(more) = extend(&own, &coded)
            && more[..2 * modes + 2]
                .chunks_exact(2)
                .all(|p| is_mode(record, p))
        {
            next.push((judged(&more, poles), poles, more));
        }
        if poles < record.most_poles
            && let Some(more) = extend_pole(&even.with_poles(poles + 1), &coded)
            && more[..2 * modes]
                .chunks_exact(2)
                .all(|p| is_mode(record, p))
        {
            next.push((judged(&more, poles + 1), poles + 1, more));
        }
        let best = next.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((found, count, more)) if found <= (1.0 - WORTH) * error => {
                (error, poles, coded) = (found, count, more);
                if been(seen, record, poles, &coded) {
                    return None;
                }
            }
            _ => break,
        }
    }
    Some(Found {
        coded,
        poles,
        error,
        none,
    })
}

/// Without the real poles that all of the points do not need, one by one.
///
/// A search adds a pole on its way wherever it helps, be it in the place of a mode that is found later, or of a part of the
/// delay. In the end one is kept only where the Bayesian information criterion asks for it (G. Schwarz, 1978), with as many
/// points as what is left has of its own: the correlation of neighbours taken off, and those that carry nothing. It is the stricter side of what a residue is known to: one
/// within its own deviation gains a hundredth of what is asked for.
pub(super) fn without_idle_poles(record: &Record, found: &Found) -> Option<(Record, Found)> {
    let mut own = record.with_poles(found.poles);
    let mut coded = own.settle(&found.coded)?.0;
    while own.poles > 0 {
        let fewer = own.with_poles(own.poles - 1);
        let Some((best, left)) = (0..own.poles)
            .filter_map(|pole| settled_without(&fewer, &coded, pole))
            .min_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        let with = own.residuals(&coded);
        let points = own_points(&with);
        // Its frequency and its residue.
        if points * (left / squares(&with)).ln() > 2.0 * points.ln() {
            break;
        }
        (own, coded) = (fewer, best);
    }
    let poles = own.poles;
    Some((
        own,
        Found {
            coded,
            poles,
            error: found.error,
            none: found.none,
        },
    ))
}

/// Without the modes that all of the points do not need, as [`without_idle_poles`]: a small one may be no more than how what is
/// left goes with its neighbours.
pub(super) fn without_idle_modes(record: &Record, mut coded: Vec<f64>) -> Vec<f64> {
    let each = if record.skewed { 4.0 } else { 3.0 };
    while record.modes(&coded) > 1 {
        let without = |k: usize| {
            let mut fewer = coded.clone();
            fewer.drain(2 * k..2 * k + 2);
            record.settle(&fewer)
        };
        let fewer = (0..record.modes(&coded))
            .filter_map(without)
            .map(|(fewer, _)| (squares(&record.residuals(&fewer)), fewer))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let with = record.residuals(&coded);
        let points = own_points(&with);
        match fewer {
            Some((left, fewer)) if points * (left / squares(&with)).ln() <= each * points.ln() => {
                coded = fewer;
            }
            _ => break,
        }
    }
    coded
}

/// The search's numbers without one of its poles, settled anew, and what they leave. A pole beyond the band is a delay by its time
/// constant: from delays with and without that.
fn settled_without(fewer: &Record, coded: &[f64], pole: usize) -> Option<(Vec<f64>, f64)> {
    let at = 2 * ((coded.len() - 2 - fewer.poles - fewer.factors()) / 2);
    let mut without = coded.to_vec();
    let corner = without.remove(at + 1 + pole).exp();
    let late = TAU * fewer.highest() / corner;
    [0.0, late, -late]
        .into_iter()
        .filter_map(|more| {
            let mut start = without.clone();
            start[at] += more;
            fewer.settle(&start)
        })
        .map(|(coded, _)| {
            let left = squares(&fewer.residuals(&coded));
            (coded, left)
        })
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Share of residuals that carry their power, by the fourth moment: all of them where they are as noise is, half where every
/// other one is nothing, as of a response whose magnitude alone is noisy.
fn carrying(residuals: &[f64]) -> f64 {
    let power = squares(residuals);
    let fourth: f64 = residuals.iter().map(|r| r.powi(4)).sum();
    (3.0 * power * power / (residuals.len() as f64 * fourth)).min(1.0)
}

/// Without the modes that a search added on its way and the points held back do not miss; `held_back` is the
/// error there, `others` how many numbers are not of modes or the delay. And that error.
pub(super) fn pruned(
    mut coded: Vec<f64>,
    others: usize,
    held_back: impl Fn(&[f64]) -> Option<f64>,
) -> Option<(Vec<f64>, f64)> {
    let mut error = held_back(&coded).unwrap_or(f64::INFINITY);
    let modes = |coded: &[f64]| (coded.len() - 1 - others) / 2;
    while modes(&coded) > 1 {
        let without = |k: usize| {
            let mut fewer = coded.clone();
            fewer.drain(2 * k..2 * k + 2);
            fewer
        };
        let best = (0..modes(&coded))
            .filter_map(|k| Some((held_back(&without(k))?, k)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((found, k)) if found <= (1.0 + WORTH) * error => {
                coded = without(k);
                error = error.min(found);
            }
            _ => break,
        }
    }
    error.is_finite().then_some((coded, error))
}
