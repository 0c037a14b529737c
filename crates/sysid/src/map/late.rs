//! Powers that were written some readings late: each belongs to the place of an earlier reading.
//!
//! Along rows that are all scanned the same way such a map is one of a peak elsewhere, and nothing in it shows that: it
//! can only be said. Where the way turns, as in
//! a spiral or to and fro, places come apart that are neighbours, and with the powers put back the peak is told far better.

use super::shape::{Datum, Fit, NUMBERS, Shape, fit};
use super::{Refusal, Scan};
use pigtail_model::frames::Displacement;
use pigtail_numerics::signal::quantile;

/// Readings by which powers are put back and forth.
const MOST: usize = 4;

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

/// Refuses a peak that is told far better by the places of other readings. Where none of them would show: by how much the peak
/// would be elsewhere for powers that are a reading late; metres.
pub(super) fn check(scan: &Scan, found: &Fit, all: &[(usize, Datum)]) -> Result<f64, Refusal> {
    let readings = &scan.readings;
    let within = MOST..readings.len().saturating_sub(MOST);
    let stride = all.len().div_ceil(ENOUGH) | 1;
    // What was cut off or folded is left out: a peak that is late may look so.
    let plain = |d: &Datum| d.sign == 1.0 && d.share == 0.0 && !d.at_least;
    let rows = all.iter().filter(|(_, d)| plain(d)).map(|(k, _)| *k);
    let rows: Vec<usize> = rows.step_by(stride).collect();
    let rows: Vec<usize> = rows.into_iter().filter(|k| within.contains(k)).collect();
    if rows.len() <= 2 * NUMBERS {
        return Ok(0.0);
    }
    let (length, turns) = way(scan, found, &rows);
    if !turns {
        return Ok(length);
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
        return Ok(0.0);
    };
    if left < BETTER * plain && plain - left > SIGNIFICANT * left / rows.len() as f64 {
        return Err(Refusal::Late { readings: late });
    }
    Ok(0.0)
}

/// How far it is from reading to reading on the peak, metres, and whether the way turns there.
fn way(scan: &Scan, found: &Fit, rows: &[usize]) -> (f64, bool) {
    let steps: Vec<Displacement> = rows
        .iter()
        .filter(|k| found.shape.share(scan.readings[**k].at) > BRIGHT)
        .map(|k| scan.readings[*k].at - scan.readings[k - 1].at)
        .collect();
    let middle = |of: fn(&Displacement) -> f64| {
        let all: Vec<f64> = steps.iter().map(of).collect();
        quantile(&all, 0.5)
    };
    let usual = Displacement::new(middle(|s| s.x), middle(|s| s.y));
    let length = quantile(&steps.iter().map(|s| s.norm()).collect::<Vec<_>>(), 0.5);
    let others = steps
        .iter()
        .filter(|s| (**s - usual).norm() > OTHERWISE * length);
    (length, others.count() as f64 > TURNS * steps.len() as f64)
}
