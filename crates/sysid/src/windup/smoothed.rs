//! Channels that were averaged or filtered before they were written.
//!
//! What smooths a signal makes `x - a x' + b x''` of it, to the second order. A windup goes by the way since the motor turned round, and a
//! way that was smoothed turns before it should: each turn is cut off by `b` times the acceleration, alike at all turns, so that
//! nothing in the scatter of what is left shows it. A torque that was smoothed is late by `a` and cut off at its peaks, and a load
//! that was smoothed alone leaves its own third and fourth differences in the windup. Beside all of these a record that was not
//! smoothed says the same as without them.

use super::Fitted;
use super::signals::{Change, Signals};
use crate::Unknown;
use crate::steady::SURE;
use pigtail_numerics::signal::rms;

/// Deviations beyond which a parameter is not where it was, or something that smoothing adds may be there: of 100 that are one is. (What may be
/// there was asked for once in ten thousand first, and of records of which little is told anyway means over 0.1 s were missed.)
const ASIDE: f64 = 2.576;

/// A part of the way that winds up, or of the range: by so much a path is bent to see what that does.
const PART: f64 = 0.01;

/// What smoothing adds is told to the first order. Where a turn is cut off by this share of the way over which a transmission winds up, its square is
/// no longer small. (Means over 0.1 s of made records cut off 0.05 to 0.11 and changed what this says they
/// change; over 0.2 s 0.2 to 0.4 and up to twice that.)
const OPEN: f64 = 0.2;

/// The columns of what a turn that is cut off does, and of the motion's fourth difference.
const TURNS: &str = "turns";
const SNAP: &str = "snap";

/// What smoothing leaves open.
pub(super) struct Smoothed {
    /// By how much parameters are less sure, by name.
    pub(super) less: Vec<(&'static str, f64)>,
    /// What it changes too much to be known.
    pub(super) open: Option<Unknown>,
    /// Whether it shows, and changes a parameter by more than its deviation.
    pub(super) matters: bool,
}

/// By how much each parameter is another one beside what smoothing adds, where that shows or the parameter is not where it was.
pub(super) fn smoothed(chosen: &Fitted, signals: &Signals) -> Option<Smoothed> {
    let added = added(chosen, signals)?;
    let found = signals.changes_beside(chosen.parts, (chosen.way, &chosen.values), &added)?;
    let (own, others) = found.split_at(found.len() - added.len());
    // Noise of the motor's position is in the windup as well as in its fourth difference, which is nearly nothing else: that says nothing.
    let told = others.iter().filter(|(name, ..)| *name != SNAP);
    let there = |sure: f64| told.clone().any(|(_, by, std)| by.abs() > sure * std);
    let (may, shows) = (there(ASIDE), there(SURE));
    let known = |name: &str| {
        let known = chosen.parameters.iter().find(|(of, _)| *of == name);
        known.map(|(_, k)| *k)
    };
    let moved = |(name, by, _): &Change| {
        let asked = ["w_max", "q", "compliance", "time_skew"].contains(name);
        asked && known(name).is_some_and(|k| by.abs() > k.std_correlated)
    };
    // Beside what may be there a parameter is known no better than it is there.
    let less = own.iter().filter_map(|(name, by, std)| {
        let sure = known(name).map_or(*std, |k| k.std_correlated.max(*std));
        if may {
            Some((*name, by.hypot(*std)))
        } else {
            (by.abs() > ASIDE * sure).then(|| (*name, by.abs()))
        }
    });
    let most = rms(signals.acceleration.iter().copied());
    let cut = others.iter().find(|(name, ..)| *name == TURNS);
    let cut = cut.filter(|(_, by, std)| chosen.parts.reversal && *by > ASIDE * std);
    // It winds up over a fourth of the way Q.
    let cut = cut.map_or(0.0, |(_, by, _)| 4.0 * by * most / chosen.way);
    Some(Smoothed {
        less: less.collect(),
        open: (cut > OPEN).then(|| Unknown {
            parameters: vec!["w_max", "q"],
            because: format!(
                "positions were averaged or filtered so much before they were written that each turn is cut off by {:.0} % of the way over \
                 which it winds up",
                100.0 * cut
            ),
        }),
        matters: shows && own.iter().any(moved),
    })
}

/// What smoothing adds to the windup, to the second order of each of its parts.
fn added(chosen: &Fitted, signals: &Signals) -> Option<Vec<(&'static str, Vec<f64>)>> {
    let jerk = signals.slope(&signals.acceleration);
    let snap = signals.slope(&jerk);
    let mut added = vec![("jerk", jerk), (SNAP, snap)];
    if let Some(torque) = signals.torque.as_ref().filter(|_| chosen.parts.compliance) {
        let late = signals.slope(torque);
        let peaks = signals.slope(&late);
        added.extend([("late", late), ("peaks", peaks)]);
    }
    if chosen.parts.reversal || chosen.parts.memory {
        let way = if chosen.parts.reversal {
            chosen.way
        } else {
            signals.range
        };
        let most = rms(signals.acceleration.iter().copied());
        if most <= 0.0 {
            return None;
        }
        let by = PART * way / most;
        let winds = |signals: &Signals| signals.winds(chosen.parts, chosen.way, &chosen.values);
        let (before, bent) = (winds(signals), winds(&signals.bent(by)));
        let turns: Vec<f64> = bent
            .iter()
            .zip(&before)
            .map(|(a, b)| (a - b) / by)
            .collect();
        let round = signals.slope(&signals.slope(&before));
        added.extend([(TURNS, turns), ("round", round)]);
    }
    Some(added)
}
