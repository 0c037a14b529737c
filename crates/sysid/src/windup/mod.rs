//! A transmission from encoders on both of its sides.
//!
//! Both in angles (or places) of the output, the windup is what the motor's encoder reads beyond the
//! load's:
//!
//! ```text
//! W = m - l = c + tau v + W_max s (1 - 2 exp(-4 d / Q)) + C T + C_3 T^3 + ...
//! ```
//!
//! Two encoders are rarely read at the same moment. A load's reading that is older than the motor's by a
//! time skew `tau` shows as a windup that goes with the velocity. It is estimated first: a thousandth of
//! a second at a rad/s is a thousandth of a radian, more than most transmissions wind up.

mod alike;
mod blurred;
mod check;
mod role;
mod signals;
mod smoothed;
mod ways;

use alike::{agreed, changing, of_one_moment, unsure};
use check::{check, excitation, written_throughout};
use role::{ahead, commanded, either, idle, lags, passive, turned_unseen};
use signals::Signals;
use smoothed::smoothed;

use super::outliers;
use super::timeline::{Even, counted};
use super::{Account, Known, Parameter, Unknown};
use pigtail_numerics::signal::{quantile, rms};

/// Columns of a record: motor, load and, where there is one, torque.
const MOTOR: usize = 0;
const LOAD: usize = 1;
const TORQUE: usize = 2;

/// Fewest samples.
pub const LEAST: usize = 200;

/// A record of both sides of a transmission on an even grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    even: Even,
    has_torque: bool,
}

impl Record {
    /// A record whose columns are the motor's and the load's position in angles (or places) of the
    /// output, and the motor's torque if `has_torque`.
    pub fn new(even: Even, has_torque: bool) -> Self {
        Self { even, has_torque }
    }

    /// Remarks on what was done to it.
    pub fn remarks(&self) -> Vec<String> {
        self.even.remarks()
    }
}

/// What a model of a transmission is made of, beside the skew and an offset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Parts {
    /// The thesis's windup function (2.20).
    pub reversal: bool,
    /// Maxwell-slip elements: hysteresis with memory of every reversal that matters.
    pub memory: bool,
    /// Windup that goes with the torque, and with its cube; where no torque was measured, with the
    /// acceleration, which the load's inertia turns into torque.
    pub compliance: bool,
    /// A ratio that is not quite the nominal one, and its change over the range.
    pub ratio: bool,
}

/// The models that are tried, simpler ones first.
pub const MODELS: [(&str, Parts); 8] = [
    ("skew", Parts::NONE),
    (
        "reversal",
        Parts {
            reversal: true,
            ..Parts::NONE
        },
    ),
    ("compliance", COMPLIANCE),
    (
        "compliance, reversal",
        Parts {
            reversal: true,
            ..COMPLIANCE
        },
    ),
    (
        "compliance, ratio",
        Parts {
            ratio: true,
            ..COMPLIANCE
        },
    ),
    (
        "compliance, memory",
        Parts {
            memory: true,
            ..COMPLIANCE
        },
    ),
    (
        "compliance, reversal, ratio",
        Parts {
            reversal: true,
            ratio: true,
            ..COMPLIANCE
        },
    ),
    (
        "compliance, memory, ratio",
        Parts {
            memory: true,
            ratio: true,
            ..COMPLIANCE
        },
    ),
];

const COMPLIANCE: Parts = Parts {
    compliance: true,
    ..Parts::NONE
};

impl Parts {
    const NONE: Self = Self {
        reversal: false,
        memory: false,
        compliance: false,
        ratio: false,
    };
}

/// Ways of the elements, as shares of the range.
const WAYS: [f64; 4] = [0.002, 0.01, 0.05, 0.2];

/// A model fitted to a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// Its name, and what it is made of.
    pub name: &'static str,
    /// What it is made of.
    pub parts: Parts,
    /// Parameters by name.
    pub parameters: Vec<(&'static str, Known)>,
    /// Way and windup of each element, radians (or metres), where it has some.
    pub elements: Vec<[f64; 2]>,
    /// Root mean square of what it leaves of the windup.
    pub residual: f64,
    /// The same on stretches that it was not fitted to: each fifth of the record told by the rest; or on
    /// a second record, about its mean.
    pub held_back: f64,
    /// Condition number of its equations.
    pub condition: f64,
    /// Values by column.
    values: Vec<f64>,
    way: f64,
}

/// What a record says of a transmission.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// All models.
    pub models: Vec<Fitted>,
    /// The one that tells best what it was not fitted to.
    pub best: usize,
    /// Parameters of the best one.
    pub parameters: Vec<Parameter>,
    /// What cannot be known.
    pub unknown: Vec<Unknown>,
    /// Root mean square of the windup about its mean, before anything was done.
    pub raw: f64,
    /// By how much the load's readings are older than the motor's, seconds.
    pub skew: f64,
    /// Remarks.
    pub remarks: Vec<String>,
    account: Account,
}

/// By how much a model's error may lie above the least, for a simpler one is preferred.
const AS_GOOD: f64 = 1.02;

/// Half of a record lies within such a ratio of speeds where it moves at one.
const ONE_SPEED: f64 = 1.5;

/// Most often that all models are fitted, each time with a better skew.
const ROUNDS: usize = 3;

/// What is said where smoothing shows.
const SMOOTHED: &str = "it is told better by channels that were averaged or filtered before they were written, or that are late to each \
                        other: parameters are less sure by what that changes";

/// Identifies a transmission; `second` is another record of it that says which model generalises.
///
/// # Errors
///
/// What makes the whole record useless.
pub fn identify(record: &Record, second: Option<&Record>) -> Result<Identified, Unknown> {
    let mut remarks = record.even.remarks();
    // A motion at one speed turns round as sharply as a slip looks; it tells nothing anyway.
    let told = Signals::new(record, 0.0);
    let dull = told.time.len() < LEAST || !excitation(&told).is_empty();
    let record = &if dull {
        record.clone()
    } else {
        cleaned(record, &mut remarks)?
    };
    let second = second.map(|r| cleaned(r, &mut Vec::new())).transpose()?;
    let second = second.as_ref();
    let plain = Signals::new(record, 0.0);
    check(&plain, &record.even)?;
    check::cut_off(record)?;
    commanded(record, &mut remarks)?;
    let n = plain.time.len();
    let mean = plain.windup.iter().sum::<f64>() / n as f64;
    let raw = rms(plain.windup.iter().map(|w| w - mean));
    written_throughout(record, raw)?;
    let mut unknown = excitation(&plain);
    let blind = unknown.iter().any(|u| u.covers("time_skew"));

    let mut skew = if blind { 0.0 } else { first_skew(record) };
    let most = 50.0 * record.even.period;
    if skew.is_nan() || skew.abs() >= most {
        return Err(Unknown::all(format!(
            "its channels would be {skew:.3} s apart: they are not of one motion"
        )));
    }
    let bound = if blind { 0.0 } else { most };
    let (signals, models, best) = all_models(record, second, &mut skew, bound)?;
    let chosen = &models[best];
    // A second record has a windup of its own.
    let left = if second.is_none() {
        chosen.residual.max(chosen.held_back)
    } else {
        chosen.residual
    };
    if unknown.is_empty() && left > raw / 3.0 {
        return Err(unexplained(&plain, chosen, left / raw));
    }
    if unknown.is_empty() {
        changing(chosen, &signals)?;
        of_one_moment(record, chosen, &signals, (skew, raw))?;
    }
    remarks.push(
        "a windup that goes with the speed, as by viscous friction, cannot be told from the time skew".to_owned(),
    );
    unknown.extend(passive(record, &models, chosen, &signals, raw)?);
    let open = if record.has_torque {
        turned_unseen(chosen, &signals, raw)
    } else {
        !lags(&models, &signals, raw)
    };
    remarks.extend(ahead(chosen).filter(|_| unknown.is_empty()));
    remarks.extend(idle(chosen).filter(|_| record.has_torque && unknown.is_empty()));
    if unknown.is_empty() && open {
        either(record.has_torque, chosen, &mut unknown, &mut remarks);
    }
    let mut less = unsure(chosen, &signals);
    if let Some(smoothed) = smoothed(chosen, &signals) {
        less.extend(smoothed.less);
        remarks.extend(smoothed.matters.then(|| SMOOTHED.to_owned()));
        unknown.extend(smoothed.open.filter(|_| unknown.is_empty()));
    }
    less.extend(ways::others(chosen, &signals));
    let (by_blur, no_blur) = blurred::others(chosen, &signals);
    less.extend(by_blur);
    unknown.extend(no_blur.filter(|_| unknown.is_empty()));
    let parameters = chosen
        .parameters
        .iter()
        .map(|(name, known)| Parameter {
            name,
            known: (!unknown.iter().any(|u| u.covers(name)))
                .then(|| agreed(&models, chosen, &less, name, *known)),
        })
        .collect();
    let residuals = signals.residuals(&signals.columns(chosen.parts, chosen.way), &chosen.values);
    let account = Account {
        modelled: signals
            .windup
            .iter()
            .zip(&residuals)
            .map(|(w, l)| w - l)
            .collect(),
        measured: signals.windup,
        time: signals.time,
        position: signals.position,
        velocity: signals.velocity,
    };
    Ok(Identified {
        models,
        best,
        parameters,
        unknown,
        raw,
        skew,
        remarks,
        account,
    })
}

/// The skew by the richest model that has one way about it, and by shifting the channel, for at high accelerations a skew is more than
/// a share of the velocity.
fn first_skew(record: &Record) -> f64 {
    let mut skew = 0.0;
    for _ in 0..4 {
        let shifted = Signals::new(record, skew);
        let Some(solution) = shifted.fit(MODELS[2].1, 0.0) else {
            break;
        };
        skew += solution.values[1];
        if solution.values[1].abs() < 1e-3 * solution.std[1] {
            break;
        }
    }
    skew
}

/// Why a model that leaves such a share of the windup is none.
fn unexplained(plain: &Signals, chosen: &Fitted, share: f64) -> Unknown {
    let speeds: Vec<f64> = plain.velocity.iter().map(|v| v.abs()).collect();
    let (slow, fast) = (quantile(&speeds, 0.25), quantile(&speeds, 0.75));
    if fast < ONE_SPEED * slow {
        return Unknown::all(format!(
            "it moves at one speed, nearly (half of the time between {slow:.3e} and {fast:.3e}), where a time skew \
             looks as a windup does: move at changing speed, to and fro, or record the torque too"
        ));
    }
    Unknown::all(format!(
        "its best model, {}, leaves {:.0} % of the windup: an encoder stands still or slips, or the columns are of \
         other axes",
        chosen.name,
        100.0 * share
    ))
}

/// A record without what no motion makes.
fn cleaned(record: &Record, remarks: &mut Vec<String>) -> Result<Record, Unknown> {
    let mut record = record.clone();
    for (column, name) in [(MOTOR, "motor's position"), (LOAD, "load's position")] {
        let long = |r: &Record| {
            r.even
                .stretches
                .iter()
                .filter(|s| s.columns[column].len() > 20)
                .count()
        };
        let before = long(&record);
        let aside = outliers::smooth(&mut record.even, column);
        remarks.extend(aside.remarks(name));
        // A few samples at an end are no loss.
        if long(&record) > before {
            // Behind a step the windup has another zero.
            return Err(Unknown::all(format!(
                "the {name} jumps as no motion does at {} places: rows are missing that no stamp shows, or an encoder \
                 slipped",
                aside.steps
            )));
        }
    }
    if record.has_torque {
        let apart = outliers::alone(&mut record.even, TORQUE);
        if apart > 0 {
            remarks.push(format!(
                "{} of the torque, apart from both neighbours, set aside and bridged",
                counted(apart, "single sample")
            ));
        }
    }
    Ok(record)
}

/// All models, the best of them, and the signals with its skew taken out, which is refined below `bound`.
///
/// What winds up goes with the velocity too, and what a shift leaves is a share of the load's velocity, not
/// of the motor's: so the skew comes again from the model that tells best, until nothing is left of it.
fn all_models(
    record: &Record,
    second: Option<&Record>,
    skew: &mut f64,
    bound: f64,
) -> Result<(Signals, Vec<Fitted>, usize), Unknown> {
    let mut round = 0;
    loop {
        let signals = Signals::new(record, *skew);
        let other = second.map(|r| Signals::new(r, *skew));
        let models: Vec<Fitted> = MODELS
            .into_iter()
            .filter_map(|(name, parts)| fit(name, parts, &signals, other.as_ref(), *skew))
            .collect();
        let least = models
            .iter()
            .map(|m| m.held_back)
            .fold(f64::INFINITY, f64::min);
        let Some(best) = models.iter().position(|m| m.held_back <= AS_GOOD * least) else {
            return Err(Unknown::all("no model could be fitted to it"));
        };
        let prediction = models[best].parameters.iter().find(|p| p.0 == "time_skew");
        round += 1;
        match prediction.filter(|_| round < ROUNDS) {
            Some((_, known))
                if (known.value - *skew).abs() > 0.5 * known.std && known.value.abs() < bound =>
            {
                *skew = known.value;
            }
            _ => return Ok((signals, models, best)),
        }
    }
}

impl Identified {
    /// The windup with the skew taken out, beside the one that the best model tells.
    pub fn account(&self) -> &Account {
        &self.account
    }
}

/// Parts of a record that are left out, each in turn.
const FOLDS: usize = 5;

/// A deviation by parts is more than chance makes of that by the residual's correlation from so many times it on: with five parts less than once in
/// a hundred parameters (Fisher's distribution of 4 and 20 degrees of freedom).
const MORE: f64 = 2.2;

/// Standard deviation of a parameter by what it becomes where a part of the record is left out, each in
/// turn: what differs from part to part is no noise, and residuals that are correlated over all of it do
/// not tell.
fn jackknife(parts: &[Vec<f64>], parameter: usize) -> f64 {
    let n = parts.len() as f64;
    let mean = parts.iter().map(|p| p[parameter]).sum::<f64>() / n;
    let squares: f64 = parts.iter().map(|p| (p[parameter] - mean).powi(2)).sum();
    (squares * (n - 1.0) / n).sqrt()
}

fn fit(
    name: &'static str,
    parts: Parts,
    signals: &Signals,
    second: Option<&Signals>,
    skew: f64,
) -> Option<Fitted> {
    let n = signals.time.len();
    let way = signals.way(parts);
    // Where a windup still goes by the state that it began in no model says anything.
    let settled = &signals.settled;
    let whole = signals.fit(parts, way)?;
    let columns = signals.columns(parts, way);
    let (mut squares, mut others) = (0.0, Vec::with_capacity(FOLDS));
    for fold in 0..FOLDS {
        let (from, to) = (fold * n / FOLDS, (fold + 1) * n / FOLDS);
        let (held, rows): (Vec<usize>, Vec<usize>) =
            settled.iter().partition(|k| (from..to).contains(*k));
        let part = signals.values(&columns, &rows)?;
        let residuals = signals.residuals(&columns, &part);
        squares += held.iter().map(|k| residuals[*k].powi(2)).sum::<f64>();
        others.push(part);
    }
    let held_back = match second {
        // Where an encoder's zero is says nothing of a transmission.
        Some(second) => {
            let residuals = second.residuals(&second.columns(parts, way), &whole.values);
            let residuals: Vec<f64> = second.settled.iter().map(|k| residuals[*k]).collect();
            let mean = residuals.iter().sum::<f64>() / residuals.len().max(1) as f64;
            rms(residuals.iter().map(|r| r - mean))
        }
        None => (squares / settled.len() as f64).sqrt(),
    };
    // With the way unknown too the rest is less sure.
    let sure = parts
        .reversal
        .then(|| signals.uncertainty(parts, way, &whole))
        .flatten();
    let stds = |j: usize| {
        let s = sure.as_ref().unwrap_or(&whole);
        let (correlated, by_parts) = (s.std_correlated[j], jackknife(&others, j));
        let told = if by_parts > MORE * correlated {
            by_parts
        } else {
            correlated
        };
        (s.std[j], told)
    };
    let mut parameters = Vec::new();
    let mut elements = Vec::new();
    for (j, (name, _)) in columns.iter().enumerate() {
        let (std, std_correlated) = stds(j);
        let known = Known {
            value: whole.values[j] + if *name == "time_skew" { skew } else { 0.0 },
            std,
            std_correlated,
        };
        if *name == "element" {
            let way = WAYS[elements.len()] * signals.range;
            elements.push([way, known.value]);
        } else {
            parameters.push((*name, known));
        }
    }
    if parts.reversal {
        let (std, std_correlated) = if let Some(sure) = &sure {
            (sure.std[columns.len()], sure.std_correlated[columns.len()])
        } else {
            (f64::INFINITY, f64::INFINITY)
        };
        let known = Known {
            value: way,
            std,
            std_correlated,
        };
        parameters.push(("q", known));
    }
    Some(Fitted {
        name,
        parts,
        parameters,
        elements,
        residual: rms(whole.residuals.iter().copied()),
        held_back,
        condition: whole.condition,
        values: whole.values,
        way,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timeline::even;
    use pigtail_model::windup::{Reversal, ReversalState};
    use pigtail_numerics::signal::between;

    /// A transmission of known compliance, (2.20) and skew.
    fn made(skew: f64, maximum: f64, compliance: f64) -> Record {
        let n = 5000;
        let period = 0.004;
        let time: Vec<f64> = (0..n).map(|k| period * k as f64).collect();
        let place = |t: f64| 0.4 * (1.3 * t).sin() + 0.1 * (3.1 * t).sin();
        let pull = |t: f64| 20.0 * (1.3 * t + 0.4).sin() + 8.0 * (4.4 * t).cos();
        let model = Reversal { maximum, way: 0.03 };
        // Finely, so that the load can be read at another moment.
        let fine = 8;
        let mut state = ReversalState::default();
        let dense: Vec<f64> = (0..n * fine)
            .map(|k| {
                let t = period * k as f64 / fine as f64;
                place(t) - model.next(&mut state, place(t)) - compliance * pull(t)
            })
            .collect();
        let noise = |k: usize| 2e-6 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0);
        let motor: Vec<f64> = time
            .iter()
            .enumerate()
            .map(|(k, t)| place(*t) + noise(k))
            .collect();
        let load: Vec<f64> = (0..n)
            .map(|k| {
                between(&dense, (k * fine) as f64 - skew / period * fine as f64)
                    + 1e-3
                    + noise(3 * k)
            })
            .collect();
        let torque: Vec<f64> = time.iter().map(|t| pull(*t)).collect();
        Record::new(even(&time, &[&motor, &load, &torque]).unwrap(), true)
    }

    #[test]
    fn skew_windup_and_compliance_are_found() {
        let record = made(2.8e-3, 1e-4, 1e-5);
        let found = identify(&record, None).unwrap();
        let best = &found.models[found.best];
        assert!(
            best.parts.reversal && best.parts.compliance,
            "{}",
            best.name
        );
        let of = |name: &str| {
            let known = best.parameters.iter().find(|(n, _)| *n == name).unwrap().1;
            known.value
        };
        assert!(
            (of("time_skew") - 2.8e-3).abs() < 3e-5,
            "{}",
            of("time_skew")
        );
        assert!((of("w_max") / 1e-4 - 1.0).abs() < 0.1, "{}", of("w_max"));
        assert!((of("q") / 0.03 - 1.0).abs() < 0.3, "{}", of("q"));
        assert!(
            (of("compliance") / 1e-5 - 1.0).abs() < 0.1,
            "{}",
            of("compliance")
        );
        assert!(
            best.residual < 0.02 * found.raw,
            "{} {}",
            best.residual,
            found.raw
        );
    }

    #[test]
    fn where_it_turned_between_coarse_samples_it_is_told() {
        // Every twentieth row of a motion at 250 Hz.
        let record = made(2.8e-3, 1e-4, 1e-5);
        let coarse = |column: usize| -> Vec<f64> {
            let all = &record.even.stretches[0].columns[column];
            all.iter().copied().step_by(20).collect()
        };
        let columns = [MOTOR, LOAD, TORQUE].map(coarse);
        let time: Vec<f64> = (0..columns[0].len()).map(|k| 0.08 * k as f64).collect();
        let columns = columns.each_ref().map(|c| &c[..]);
        let found = identify(&Record::new(even(&time, &columns).unwrap(), true), None).unwrap();
        let known = found.parameters.iter().find(|p| p.name == "w_max");
        let known = known.and_then(|p| p.known).unwrap();
        let off = (known.value - 1e-4).abs();
        assert!(off < 3.0 * known.std_correlated && off < 4e-6, "{known:?}");
    }
}
