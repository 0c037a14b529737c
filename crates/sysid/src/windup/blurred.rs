//! Positions that went through one pole, or a mean, before they were written, told exactly.
//!
//! [`smoothed`](super::smoothed) has what smoothing adds to the first order. Where a turn is cut off by more, a model of the way that was
//! written winds up over another one, and what is left looks like anything. Here a pole's motion is told back, `q + T q'`, the windup is told of that,
//! and the same pole makes of it what was written; a mean over `T` seconds cuts off `T^2 / 24` of the acceleration. Both positions may have
//! gone through it, the motor's alone, or the load's alone.

use super::signals::Signals;
use super::{Fitted, Parts};
use crate::Unknown;
use nalgebra::DMatrix;
use pigtail_numerics::golden::least;
use pigtail_numerics::regression::{Rest, Solution, least_squares_of_time};
use pigtail_numerics::signal::independent;

/// Seconds of a pole or a mean, as shares of the mean time from one turn to the next: below nothing of a turn is cut off that counts, beyond
/// hardly any of a motion is left.
const LONG: [f64; 9] = [0.01, 0.014, 0.02, 0.028, 0.04, 0.057, 0.08, 0.113, 0.16];

/// What is left has to be less by so many of its own points' squares that chance has it once in a hundred records.
const TELLS: f64 = 6.63;

/// A way or a maximum that such a model has elsewhere by more than this share is not known.
const MOST: f64 = 1.0 / 3.0;

/// Share of the squares that is left where a record went through what is taken out of it.
const LEFT: f64 = 0.5;

#[derive(Clone, Copy, PartialEq)]
enum Of {
    Nothing,
    Both,
    Motor,
    Load,
}

#[derive(Clone, Copy)]
struct Blur {
    of: Of,
    pole: bool,
    seconds: f64,
}

/// A model of a record that was blurred: what is left of it, its values by name, its way the last.
struct Told {
    squares: f64,
    left: Vec<f64>,
    values: Vec<(&'static str, f64, f64)>,
}

/// By how much each parameter is another one where positions were blurred, if that tells the record better; and that they are not known where that
/// is much.
pub(super) fn others(
    chosen: &Fitted,
    signals: &Signals,
) -> (Vec<(&'static str, f64)>, Option<Unknown>) {
    let none = (Vec::new(), None);
    if chosen.parts == Parts::NONE {
        return none;
    }
    let nothing = Blur {
        of: Of::Nothing,
        pole: true,
        seconds: 0.0,
    };
    let Some(plain) = told(chosen, signals, nothing) else {
        return none;
    };
    let between = signals.between_turns();
    let kinds = [Of::Both, Of::Motor, Of::Load]
        .into_iter()
        .flat_map(|of| [(of, true), (of, false)]);
    let all: Vec<Told> = kinds
        .flat_map(|(of, pole)| {
            LONG.map(|share| Blur {
                of,
                pole,
                // A mean that cuts off as much as a pole is as much longer.
                seconds: share * between * if pole { 1.0 } else { 5.0 },
            })
        })
        .filter_map(|blur| told(chosen, signals, blur))
        .collect();
    let Some(best) = all.iter().min_by(|a, b| a.squares.total_cmp(&b.squares)) else {
        return none;
    };
    let points = independent(&best.left);
    let gained = |other: &Told| points * (plain.squares / other.squares).ln();
    let most = gained(best);
    if most < TELLS {
        return none;
    }
    let known = |name: &str| {
        let known = chosen.parameters.iter().find(|(of, _)| *of == name);
        known.map(|(_, known)| known.value)
    };
    let mut less: Vec<(&'static str, f64)> = Vec::new();
    // Those that tell it as well as the best of them.
    for other in all.iter().filter(|t| gained(t) > most - TELLS) {
        for (name, value, std) in &other.values {
            // By how late a column is, is what a pole does.
            let asked = ["w_max", "q", "compliance"].contains(name);
            let Some(own) = known(name).filter(|_| asked) else {
                continue;
            };
            let by = (value - own).hypot(*std);
            match less.iter_mut().find(|(of, _)| of == name) {
                Some((_, most)) => *most = most.max(by),
                None => less.push((name, by)),
            }
        }
    }
    // Where no law is the transmission's own, whatever is added tells it a little better; a pole that was there mends it.
    let mends = best.squares < LEFT * plain.squares;
    // A compliance may be nearly none, and is as unsure as it says.
    let much = less.iter().find(|(name, by)| {
        mends && *name != "compliance" && known(name).is_some_and(|own| *by > MOST * own.abs())
    });
    let open = much.map(|(name, by)| Unknown {
        parameters: vec!["w_max", "q"],
        because: format!(
            "positions that were averaged or filtered before they were written tell it better, and then {name} is another one by {by:.1e}"
        ),
    });
    (less, open)
}

fn told(chosen: &Fitted, signals: &Signals, blur: Blur) -> Option<Told> {
    /// How far about the way that was found another one is looked for, and the share by which it is changed to see what that makes.
    const ABOUT: f64 = 2.5;
    const STEP: f64 = 0.02;
    let path = match (blur.of, blur.pole) {
        (Of::Nothing | Of::Load, _) => signals.clone(),
        (_, true) => signals.ahead(blur.seconds),
        (_, false) => signals.bent(blur.seconds.powi(2) / 24.0),
    };
    let winds = |column: Vec<f64>| match (blur.of, blur.pole) {
        (Of::Nothing | Of::Motor, _) => column,
        (of, true) => {
            let late = signals.through_pole(&column, blur.seconds);
            // What the load is late by was taken out with the skew.
            if of == Of::Load {
                signals.sooner(&late, blur.seconds)
            } else {
                late
            }
        }
        (_, false) => signals.through_mean(&column, blur.seconds),
    };
    let rows = &signals.settled;
    let jerk = signals.slope(&signals.acceleration);
    let snap = signals.slope(&jerk);
    let rest = Parts {
        reversal: false,
        ..chosen.parts
    };
    let mut others = path.columns(rest, 0.0);
    for (name, column) in &mut others {
        if ["compliance", "cubic_compliance", "element"].contains(name) {
            *column = winds(std::mem::take(column));
        } else if let Some((_, own)) = signals
            .columns(rest, 0.0)
            .into_iter()
            .find(|c| c.0 == *name)
        {
            *column = own;
        }
    }
    others.extend([("jerk", jerk), ("snap", snap)]);
    // A load that was blurred alone leaves what that takes of the motion in the windup.
    let taken: Vec<f64> = if blur.of == Of::Load {
        let left = winds(signals.path.clone());
        signals.path.iter().zip(left).map(|(q, l)| q - l).collect()
    } else {
        vec![0.0; signals.path.len()]
    };
    let target: Vec<f64> = rows
        .iter()
        .map(|k| signals.windup[*k] - taken[*k])
        .collect();
    let over = |columns: &[(&'static str, Vec<f64>)]| {
        DMatrix::from_fn(rows.len(), columns.len(), |i, j| columns[j].1[rows[i]])
    };
    if !chosen.parts.reversal {
        let fit: Solution = least_squares_of_time(&over(&others), &target, 1)?;
        return Some(Told::of(&others, fit));
    }
    let left = Rest::new(&over(&others), &target)?;
    let reversal = |way: f64| winds(path.reversal(way));
    let squares = |way: f64| {
        let reversal = reversal(way);
        left.squares(&rows.iter().map(|k| reversal[*k]).collect::<Vec<_>>())
    };
    let about = (
        (chosen.way / ABOUT).ln(),
        (chosen.way * ABOUT).min(signals.range).ln(),
    );
    let way = least(about, 1e-2, |x| squares(x.exp())).exp();
    // Beside what a change of the way makes.
    let slope: Vec<f64> = reversal(way * (1.0 + STEP))
        .iter()
        .zip(reversal(way * (1.0 - STEP)))
        .map(|(a, b)| (a - b) / (2.0 * STEP * way))
        .collect();
    others.push(("w_max", reversal(way)));
    let fit: Solution = least_squares_of_time(&over(&others), &target, 1)?;
    let maximum = *fit.values.last()?;
    let mut with_way = others.clone();
    with_way.push(("q", slope.iter().map(|s| maximum * s).collect()));
    let sure = least_squares_of_time(&over(&with_way), &fit.residuals, 1)?;
    let mut told = Told::of(&others, fit);
    told.values.push(("q", way, *sure.std_correlated.last()?));
    Some(told)
}

impl Told {
    fn of(columns: &[(&'static str, Vec<f64>)], fit: Solution) -> Self {
        let known = fit.values.iter().zip(&fit.std_correlated);
        let names = columns.iter().map(|(name, _)| *name);
        Self {
            squares: fit.residuals.iter().map(|l| l * l).sum(),
            values: names
                .zip(known)
                .map(|(name, (v, s))| (name, *v, *s))
                .collect(),
            left: fit.residuals,
        }
    }
}
