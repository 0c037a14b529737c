//! What a record of a transmission cannot tell.

use super::role::WORTH;
use super::signals::Signals;
use super::{LEAST, LOAD, MOTOR, Record, TORQUE};
use crate::Unknown;
use crate::timeline::{Clock, Even, counted};
use pigtail_numerics::regression::{least_squares, matrix, tolerance};
use pigtail_numerics::signal::{quantile, rms};

/// Encoders of a servo are read faster than this, seconds, and more slowly than [`FASTEST`].
const SLOWEST: f64 = 0.1;
const FASTEST: f64 = 5e-6;

pub(super) fn check(signals: &Signals, even: &Even) -> Result<(), Unknown> {
    if !(FASTEST..=SLOWEST).contains(&even.period) {
        return Err(Unknown::all(format!(
            "its samples are {:.6} s apart, too far or too close for the encoders of a servo, which are read every {FASTEST} to \
             {SLOWEST} s: is the unit of time right?",
            even.period
        )));
    }
    let n = signals.time.len();
    if n < LEAST {
        return Err(Unknown::all(format!(
            "it has {} in stretches; wanted are at least {LEAST}",
            counted(n, "sample")
        )));
    }
    let odd = matches!(even.clock, Clock::Stamps | Clock::Untold);
    if odd && even.jitter > 0.35 {
        return Err(Unknown::all(format!(
            "its moments deviate by {:.0} % of a sample period: a skew would be lost in that",
            100.0 * even.jitter
        )));
    }
    if signals.range <= 0.0 {
        return Err(Unknown::all("the motor never moves"));
    }
    let load: Vec<f64> = signals
        .position
        .iter()
        .zip(&signals.windup)
        .map(|(m, w)| m - w)
        .collect();
    if load.iter().all(|l| *l == load[0]) {
        return Err(Unknown::all("the load never moves"));
    }
    if signals.windup.iter().filter(|w| **w == 0.0).count() > n / 2 {
        return Err(Unknown::all(
            "motor and load read the same: one of the columns is the other",
        ));
    }
    let one = vec![1.0; n];
    let slope = least_squares(&matrix(&[&signals.position, &one]), &load);
    let slope = slope.map_or(0.0, |s| s.values[0]);
    if !(0.8..=1.25).contains(&slope) {
        return Err(Unknown::all(format!(
            "the load moves {slope:.5} times as far as the motor: both must be in angles of the output; is the \
             gear ratio or a unit missing (--gear-ratio), or a column another one?"
        )));
    }
    // Jumps: each sample must lie near the middle of its neighbours, or the motion is not resolved.
    let miss = rms(load.windows(3).map(|w| w[1] - 0.5 * (w[0] + w[2])));
    let step = rms(load.windows(2).map(|w| w[1] - w[0]));
    if miss > 0.5 * step {
        return Err(Unknown::all(
            "the load jumps from sample to sample: aliased, or noise",
        ));
    }
    for (name, column) in [("motor", &signals.position), ("load", &load)] {
        let (low, high) = column
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(*v), h.max(*v))
            });
        let other = if name == "motor" {
            &load
        } else {
            &signals.position
        };
        let room = 0.02 * signals.range;
        let pegged = |edge: f64, beyond: &dyn Fn(f64) -> bool| {
            let both = column.iter().zip(other);
            both.filter(|(a, b)| **a == edge && beyond(**b)).count()
        };
        let at = pegged(high, &|b| b > high + room) + pegged(low, &|b| b < low - room);
        if at as f64 > 0.02 * n as f64 {
            return Err(Unknown::all(format!(
                "the {name}'s encoder is saturated: it stands at an end of its range while the other side goes on"
            )));
        }
    }
    Ok(())
}

/// That the torque is whole: one that stands at an end of its range, sample after sample, was cut off there.
pub(super) fn cut_off(record: &Record) -> Result<(), Unknown> {
    /// Samples in a row at an end, the share of all of them there, and how far the next values are at most, as a share of the
    /// range: a torque that is written coarsely stands at its ends for long, too.
    const RUN: usize = 4;
    const SHARE: f64 = 0.02;
    const NEXT: f64 = 0.005;
    if !record.has_torque {
        return Ok(());
    }
    // As it was written: filtered it has no plateau.
    let stretches = record.even.stretches.iter();
    let torque: Vec<f64> = stretches
        .flat_map(|s| s.columns[TORQUE].iter().copied())
        .collect();
    let (low, high) = (
        torque.iter().copied().fold(f64::INFINITY, f64::min),
        torque.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    );
    for end in [low, high] {
        let there: usize = torque
            .chunk_by(|a, b| a == b)
            .filter(|run| run[0] == end && run.len() >= RUN)
            .map(<[f64]>::len)
            .sum();
        let others = torque.iter().filter(|t| **t != end);
        let next = others
            .map(|t| (t - end).abs())
            .fold(f64::INFINITY, f64::min);
        let share = there as f64 / torque.len() as f64;
        if share > SHARE && next < NEXT * (high - low) {
            return Err(Unknown::all(format!(
                "the torque stands at {end:.4e}, an end of its range, for {:.0} % of the samples: it is cut off there",
                100.0 * share
            )));
        }
    }
    Ok(())
}

/// That positions were written whenever they were read: one that is written only where it has changed by some amount lags its motion by as
/// much, to and fro, as a transmission does that winds up.
pub(super) fn written_throughout(record: &Record, raw: f64) -> Result<(), Unknown> {
    for (column, name) in [(MOTOR, "motor"), (LOAD, "load")] {
        let stretches = record.even.stretches.iter();
        let least = stretches
            .filter_map(|s| least_change(&s.columns[column]))
            .fold(0.0, f64::max);
        if least > WORTH * raw {
            return Err(Unknown::all(format!(
                "the {name}'s position was written only where it had changed by {least:.2e}, {:.0} % of the windup, as by a logger's \
                 deadband: it lags by as much, to and fro, as a windup does",
                100.0 * least / raw
            )));
        }
    }
    Ok(())
}

/// The least change at which a column was written, where it was written at changes only: on its way it stands for now more and now
/// fewer samples, and what it goes on by then is that change at least, and less than twice as much. The steps of a coarse sensor are whole
/// numbers of one, and of a column that was held for a while some are as small as any.
fn least_change(column: &[f64]) -> Option<f64> {
    /// Fewest steps behind a standstill, and lengths of standstills.
    const STEPS: usize = 20;
    const LENGTHS: usize = 3;
    /// Largest such step, as a multiple of the least change, but for one in twenty; and share of steps beyond which they are whole
    /// numbers, so near.
    const MOST: f64 = 2.1;
    const WHOLE: f64 = 0.7;
    const NEAR: f64 = 0.05;
    let (mut behind, mut lengths, mut all) = (Vec::new(), Vec::new(), Vec::new());
    let (mut way, mut stood) = (0.0, 0_usize);
    for step in column.windows(2).map(|w| w[1] - w[0]) {
        if step == 0.0 {
            stood += 1;
            continue;
        }
        if stood > 0 && way == step.signum() {
            behind.push(step.abs());
            lengths.push(stood);
        }
        all.push(step.abs());
        (way, stood) = (step.signum(), 0);
    }
    lengths.sort_unstable();
    lengths.dedup();
    if behind.len() < STEPS || lengths.len() < LENGTHS {
        return None;
    }
    // A sample that was set aside and bridged makes smaller ones.
    let least = quantile(&all, 0.02);
    let whole = |s: &&f64| (*s / least - (*s / least).round()).abs() < NEAR;
    let coarse = behind.iter().filter(whole).count() as f64 > WHOLE * behind.len() as f64;
    (!coarse && quantile(&behind, 0.95) < MOST * least).then_some(least)
}

/// What the motion does not excite.
pub(super) fn excitation(signals: &Signals) -> Vec<Unknown> {
    let mut unknown = Vec::new();
    let speeds: Vec<f64> = signals.velocity.iter().map(|v| v.abs()).collect();
    let moving = 0.05 * quantile(&speeds, 0.99);
    let n = speeds.len() as f64;
    let share = |sign: f64| {
        let along = signals.velocity.iter().filter(|v| sign * **v > moving);
        along.count() as f64 / n
    };
    let frictional = vec!["w_max", "q", "offset", "element"];
    let one_way = share(1.0) < 0.02 || share(-1.0) < 0.02;
    if one_way {
        unknown.push(Unknown {
            parameters: frictional.clone(),
            because: "it moves one way only: without a reversal a windup is an offset".to_owned(),
        });
    }
    let rows: Vec<usize> = (0..speeds.len()).filter(|k| speeds[*k] > moving).collect();
    let v: Vec<f64> = rows.iter().map(|k| signals.velocity[*k]).collect();
    let s: Vec<f64> = v.iter().map(|v| v.signum()).collect();
    let one = vec![1.0; v.len()];
    let x = if one_way {
        matrix(&[&v, &one])
    } else {
        matrix(&[&v, &s, &one])
    };
    if rows.len() < 20 || tolerance(&x, 0) < 0.01 {
        unknown.push(Unknown {
            parameters: [&frictional[..], &["time_skew"]].concat(),
            because:
                "its speed hardly changes while it moves: at one speed a time skew is a windup"
                    .to_owned(),
        });
    }
    if let Some(torque) = &signals.torque {
        let mean = torque.iter().sum::<f64>() / n;
        let change = rms(torque.iter().map(|t| t - mean));
        if change < 0.01 * rms(torque.iter().copied()) || change <= 0.0 {
            unknown.push(Unknown {
                parameters: vec!["compliance", "cubic_compliance"],
                because: "the torque hardly changes".to_owned(),
            });
        }
    }
    unknown
}
