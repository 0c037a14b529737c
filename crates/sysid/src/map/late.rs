//! Powers that were written some readings late: each belongs to the place of an earlier reading.
//!
//! Along rows that are all scanned the same way such a map is one of a peak elsewhere, and nothing in it shows that: it
//! can only be said. Where the way turns, as in
//! a spiral or to and fro, places come apart that are neighbours, and with the powers put back the peak is told far better.
//! A detector that is slower than the readings leaves its mark on any way: light trails behind the peak, and never runs ahead of it.

use super::shape::{Datum, Fit, NUMBERS, Shape, fit};
use super::{Refusal, Scan};
use pigtail_model::frames::Displacement;
use pigtail_numerics::signal::quantile;

/// Readings by which powers are put back and forth.
const MOST: usize = 4;

/// Time constants of a detector that are tried, readings.
const CONSTANTS: [f64; 5] = [0.6, 1.2, 2.0, 3.5, 6.0];
/// What a detector adds to a shape is taken off, and the shape fitted anew, so many times: each leaves less than the one before.
const ROUNDS: usize = 6;

/// The way turns where it comes to this share of the readings on the peak, those above a third of it, otherwise than to most, by this share
/// of a step.
const TURNS: f64 = 0.1;
const OTHERWISE: f64 = 0.3;
const BRIGHT: f64 = 1.0 / 3.0;

/// What is left then, squared, is less than this share of what it was, and by so many times the noise's variance. Four fifths and forty were asked first,
/// and a third of the maps along a spiral that were a reading late were answered; then 0.95, 25 and a turn of a fifth of the readings, and one of 100 was that are two late, half a
/// radius off. Of 60 spirals whose powers are not late none is told better by other places at all; of 95 that are, and more than 0.15 of a radius off for it, all are, by 22 times the
/// variance and more.
const BETTER: f64 = 0.98;
const SIGNIFICANT: f64 = 16.0;

/// More readings than about so many tell nothing new.
const ENOUGH: usize = 3000;

/// Refuses a peak that is told far better by the places of other readings, or by a detector that was too slow. Where none of the first would show: by
/// how much the peak would be elsewhere for powers that are a reading late; metres.
pub(super) fn check(scan: &Scan, found: &Fit, all: &[(usize, Datum)]) -> Result<f64, Refusal> {
    let a_reading = places(scan, found, all)?;
    if !scan.settled {
        trails(scan, found, all)?;
    }
    Ok(a_reading)
}

/// The rows that are looked at: those whose power is nothing but a shape's, and which have others before and behind them.
fn plain_rows(scan: &Scan, all: &[(usize, Datum)]) -> Vec<usize> {
    let within = MOST..scan.readings.len().saturating_sub(MOST);
    let stride = all.len().div_ceil(ENOUGH) | 1;
    // What was cut off or folded is left out: a peak that is late may look so.
    let plain = |d: &Datum| d.sign == 1.0 && d.share == 0.0 && !d.at_least;
    let rows = all.iter().filter(|(_, d)| plain(d)).map(|(k, _)| *k);
    let rows: Vec<usize> = rows.step_by(stride).collect();
    rows.into_iter().filter(|k| within.contains(k)).collect()
}

/// By how much the peak would be elsewhere for powers that are a reading late, metres; zero where that would show, and does not.
fn places(scan: &Scan, found: &Fit, all: &[(usize, Datum)]) -> Result<f64, Refusal> {
    let readings = &scan.readings;
    let rows = plain_rows(scan, all);
    let Some((goes_on, turns)) = way(scan, found, &rows) else {
        return Ok(scan.spacing());
    };
    if !turns || rows.len() <= 2 * NUMBERS {
        return Ok(goes_on);
    }
    let squares = |late: isize| -> Option<f64> {
        let place = |k: usize| readings[k.checked_add_signed(-late).unwrap_or(k)].at;
        let data: Vec<Datum> = rows
            .iter()
            .map(|k| Datum {
                at: place(*k),
                ..Datum::plain(&readings[*k])
            })
            .collect();
        let (mut moved, mut bright) = (Displacement::default(), f64::MIN_POSITIVE);
        for k in &rows {
            let share = found.shape.share(readings[*k].at);
            moved += (place(*k) - readings[*k].at) * share;
            bright += share;
        }
        let start = Shape {
            at: found.shape.at + moved * (1.0 / bright),
            ..found.shape
        };
        Some(fit(&data, &start, 0.0, false)?.squares)
    };
    let most = MOST.cast_signed();
    let others = (-most..=most).filter(|late| *late != 0);
    let best = others
        .filter_map(|late| Some((squares(late)?, late)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (Some(plain), Some((left, late))) = (squares(0), best) else {
        return Ok(goes_on);
    };
    if left < BETTER * plain && plain - left > SIGNIFICANT * left / rows.len() as f64 {
        return Err(Refusal::Late { readings: late });
    }
    // Places of the readings beside would have to be worse, else these readings do not tell it.
    let beside = [-1, 1].into_iter().filter_map(squares);
    let beside = beside.fold(f64::INFINITY, f64::min);
    let would_show = beside - plain > SIGNIFICANT * plain / rows.len() as f64;
    Ok(if would_show { 0.0 } else { goes_on })
}

/// Refuses a peak that is told far better by a detector of first order that was too slow, and not as well by one that knew powers before they
/// came: a shape that is the same forward and back, or leans forward, is the light's own.
fn trails(scan: &Scan, found: &Fit, all: &[(usize, Datum)]) -> Result<(), Refusal> {
    let rows = plain_rows(scan, all);
    if rows.len() <= 2 * NUMBERS {
        return Ok(());
    }
    let data: Vec<Datum> = rows
        .iter()
        .map(|k| Datum::plain(&scan.readings[*k]))
        .collect();
    let Some(plain) = fit(&data, &found.shape, 0.0, false) else {
        return Ok(());
    };
    let slow = |constant: f64, ahead: bool| {
        let (mut shape, mut left) = (plain.shape, None);
        for _ in 0..ROUNDS {
            let added = added(scan, &shape, constant, ahead);
            let less = rows.iter().zip(&data).map(|(k, d)| Datum {
                power: d.power - added[*k],
                ..*d
            });
            let less: Vec<Datum> = less.collect();
            shape = fit(&less, &shape, 0.0, false)?.shape;
            left = Some(squares_left(&less, &shape));
        }
        left
    };
    let best = CONSTANTS
        .into_iter()
        .filter_map(|constant| Some((slow(constant, false)?, constant)))
        .min_by(|a, b| sum(&a.0).total_cmp(&sum(&b.0)));
    let asis = squares_left(&data, &plain.shape);
    if let Some((left, constant)) = best
        && tells(&left, &asis)
        && slow(constant, true).is_none_or(|ahead| tells(&left, &ahead))
    {
        return Err(Refusal::Trails { readings: constant });
    }
    Ok(())
}

fn sum(of: &[f64]) -> f64 {
    of.iter().sum()
}

/// What a shape leaves of each reading, squared.
fn squares_left(data: &[Datum], shape: &Shape) -> Vec<f64> {
    data.iter()
        .map(|d| d.residual(shape, 0.0).powi(2))
        .collect()
}

/// Whether one explanation leaves less than another one, by how much that differs from reading to reading (Q. H. Vuong, 1989): bright readings have more
/// noise than dark ones, and are the ones that tell.
fn tells(left: &[f64], other: &[f64]) -> bool {
    let less: Vec<f64> = left.iter().zip(other).map(|(l, o)| o - l).collect();
    let squares: f64 = less.iter().map(|l| l * l).sum();
    let all = sum(&less);
    all > 0.0 && all * all > SIGNIFICANT * squares
}

/// What a detector of so many readings' time constant adds to a shape's power at each reading, in the order in which they were taken or against it.
fn added(scan: &Scan, shape: &Shape, constant: f64, ahead: bool) -> Vec<f64> {
    let goes_on = 1.0 - (-1.0 / constant).exp();
    let mut powers: Vec<f64> = scan.readings.iter().map(|r| shape.power(r.at)).collect();
    if ahead {
        powers.reverse();
    }
    let mut seen = powers[0];
    for power in &mut powers {
        seen += goes_on * (*power - seen);
        *power = seen - *power;
    }
    if ahead {
        powers.reverse();
    }
    powers
}

/// How far the readings go on, one with the next, on the peak, metres, and whether the way turns there; `None` where none is on it.
fn way(scan: &Scan, found: &Fit, rows: &[usize]) -> Option<(f64, bool)> {
    let steps: Vec<Displacement> = rows
        .iter()
        .filter(|k| found.shape.share(scan.readings[**k].at) > BRIGHT)
        .map(|k| scan.readings[*k].at - scan.readings[k - 1].at)
        .collect();
    if steps.is_empty() {
        return None;
    }
    let middle = |of: fn(&Displacement) -> f64| {
        let all: Vec<f64> = steps.iter().map(of).collect();
        quantile(&all, 0.5)
    };
    let usual = Displacement::new(middle(|s| s.x), middle(|s| s.y));
    let length = quantile(&steps.iter().map(|s| s.norm()).collect::<Vec<_>>(), 0.5);
    let others = steps
        .iter()
        .filter(|s| (**s - usual).norm() > OTHERWISE * length);
    let turns = others.count() as f64 > TURNS * steps.len() as f64;
    // Lines to and fro take each other's lag away.
    let all = steps.iter().fold(Displacement::default(), |a, s| a + *s);
    let goes_on = if turns {
        all.norm() / steps.len() as f64
    } else {
        length
    };
    Some((goes_on, turns))
}
