//! A response of which rows were lost, or written twice, before its frequencies were numbered anew.
//!
//! Frequencies that go evenly, or by one ratio, may be an instrument's, or have been made from the number of rows. Behind rows that were lost all
//! are of another place then, and where they were spread over the range that is known those before are, too. What a response tells there is a
//! break: a level, a slope or a phase that go on elsewhere. The same modes with such a break tell it better than without.

use super::Record;
use super::rows::off_by;
use super::search::{own_points, squares};
use super::wander;
use crate::Unknown;
use crate::steady::chi_squared;
use crate::timeline::counted;
use pigtail_numerics::signal::quantile;
use std::f64::consts::TAU;

/// Rows that may have been lost; below zero, written once more.
const LOST: [f64; 16] = [
    1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 13.0, 19.0, -1.0, -2.0, -3.0, -4.0, -6.0, -9.0, -13.0, -19.0,
];

/// Places of a break that are tried, how many of the breaks that tell a response best have its modes settle, and how many breaks there
/// may be.
const PLACES: usize = 40;
const SETTLED: usize = 4;
const MOST: usize = 4;

/// Frequencies go evenly where all but this share of their steps are one, to a fiftieth.
const UNEVEN: f64 = 0.1;
const STEP: f64 = 0.02;

/// How likely it is that rows were lost so, of one response whose frequencies go evenly that says nothing of it. A choice.
pub(super) const BEFOREHAND: f64 = 0.01;

/// Another break is looked for where the last one leaves less than this, squared.
const MORE: f64 = 0.8;

/// What is less likely than this widens no interval that holds nineteen of twenty.
pub(super) const UNLIKELY: f64 = 0.05;

/// Frequencies by their number.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers {
    first: f64,
    step: f64,
    last: f64,
    /// Whether they go by a ratio.
    by_ratio: bool,
}

impl Numbers {
    pub(super) fn of(frequency: &[f64]) -> Option<Self> {
        let own = |by_ratio: bool| {
            let places: Vec<f64> = frequency
                .iter()
                .map(|f| if by_ratio { f.ln() } else { *f })
                .collect();
            let steps: Vec<f64> = places.windows(2).map(|w| w[1] - w[0]).collect();
            let step = quantile(&steps, 0.5);
            let uneven = steps
                .iter()
                .filter(|s| (*s - step).abs() > STEP * step)
                .count();
            let (first, end) = (places.first()?, places.last()?);
            let even = step > 0.0 && (uneven as f64) < UNEVEN * steps.len() as f64;
            even.then(|| Self {
                first: *first,
                step,
                last: (end - first) / step,
                by_ratio,
            })
        };
        own(false).or_else(|| own(true))
    }

    pub(super) fn number(&self, frequency: f64) -> f64 {
        let place = if self.by_ratio {
            frequency.ln()
        } else {
            frequency
        };
        (place - self.first) / self.step
    }

    pub(super) fn frequency(&self, number: f64) -> f64 {
        let place = self.first + self.step * number;
        if self.by_ratio { place.exp() } else { place }
    }
}

/// Rows that were lost behind some numbers.
#[derive(Debug, Clone)]
struct Breaks {
    /// Each a number, and how many rows.
    all: Vec<(f64, f64)>,
    /// Whether frequencies were spread over the range again.
    spread: bool,
}

/// What a response says with breaks: what is left, squared, and what is searched.
struct Told {
    breaks: Breaks,
    left: f64,
    coded: Vec<f64>,
    /// Twice the logarithm of how much more likely it is.
    gain: f64,
}

impl Breaks {
    fn with(&self, at: f64, rows: f64, spread: bool) -> Self {
        let mut all = self.all.clone();
        all.push((at, rows));
        Self { all, spread }
    }

    fn frequency(&self, numbers: &Numbers, said: f64) -> f64 {
        let number = numbers.number(said);
        let mut own = number;
        let mut behind = numbers.last;
        for (at, rows) in &self.all {
            behind += rows;
            if number >= *at {
                // What was written twice stands still meanwhile.
                own += rows.max(at - number);
            }
        }
        let share = if self.spread {
            numbers.last / behind
        } else {
            1.0
        };
        numbers.frequency(own * share)
    }

    fn record(&self, numbers: &Numbers, record: &Record) -> Record {
        let own = record.frequency.iter();
        Record {
            frequency: own.map(|f| self.frequency(numbers, *f)).collect(),
            ..record.clone()
        }
    }

    /// What is searched, where the modes are there.
    fn coded(&self, numbers: &Numbers, record: &Record, coded: &[f64]) -> Vec<f64> {
        let mut coded = coded.to_vec();
        let modes = record.modes(&coded);
        for frequency in coded[..2 * modes].iter_mut().step_by(2) {
            let own = self.frequency(numbers, frequency.exp() / TAU);
            *frequency = (TAU * own).ln();
        }
        // A delay goes by the highest frequency.
        coded[2 * modes] *= self.frequency(numbers, record.highest()) / record.highest();
        coded
    }

    /// What is left, squared, where nothing settles.
    fn left(&self, numbers: &Numbers, record: &Record, coded: &[f64]) -> f64 {
        let moved = self.record(numbers, record);
        let left = squares(&moved.residuals(&self.coded(numbers, record, coded)));
        if left.is_nan() { f64::INFINITY } else { left }
    }

    /// The same with the last break's place and rows looked for nearby.
    fn nearby(mut self, numbers: &Numbers, record: &Record, coded: &[f64]) -> Self {
        let mut least = self.left(numbers, record, coded);
        for by in [4.0, 2.0, 1.0, 1.0] {
            for (place, rows) in [(by, 0.0), (-by, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                let mut other = self.clone();
                if let Some(last) = other.all.last_mut() {
                    *last = (last.0 + place, last.1 + rows);
                }
                let left = other.left(numbers, record, coded);
                if left < least {
                    (self, least) = (other, left);
                }
            }
        }
        self
    }

    fn told(self, numbers: &Numbers, record: &Record, coded: &[f64], own: &[f64]) -> Option<Told> {
        let moved = self.record(numbers, record);
        let (mut other, _) = moved.settle(&self.coded(numbers, record, coded))?;
        let left = moved.residuals(&other);
        let share = squares(&left) / squares(own);
        // What a worse model leaves goes with its neighbours, whatever the noise does.
        let points = own_points(if share < 1.0 { &left } else { own });
        let gain = -points * share.ln();
        other[2 * record.modes(coded)] *= record.highest() / moved.highest();
        gain.is_finite().then_some(Told {
            breaks: self,
            left: squares(&left),
            coded: other,
            gain,
        })
    }
}

/// By how much what is searched, `coded`, would be another one, for all that a response says of rows that were lost.
///
/// # Errors
///
/// Where they were: chance makes breaks tell so much more once in ten thousand times. With it the share of what is left, squared, that is left
/// then.
pub(super) fn open(record: &Record, coded: &[f64]) -> Result<Vec<f64>, (Unknown, f64)> {
    let none = vec![0.0; coded.len()];
    let Some(numbers) = Numbers::of(&record.frequency) else {
        return Ok(none);
    };
    let own = record.residuals(coded);
    let tries = (PLACES * LOST.len() * 2) as f64;
    let mut all: Vec<Told> = Vec::new();
    let mut so_far = Breaks {
        all: Vec::new(),
        spread: false,
    };
    let mut left = squares(&own);
    for count in 1..=MOST {
        // Whether frequencies were spread is the same for all breaks.
        let spreads = if count == 1 {
            vec![false, true]
        } else {
            vec![so_far.spread]
        };
        let mut told = round(&so_far, &spreads, (&numbers, record, coded), &own);
        told.sort_by(|a, b| a.left.total_cmp(&b.left));
        let Some(best) = told.first() else {
            break;
        };
        let needed = count as f64 * (chi_squared(1.0) + 2.0 * tries.ln());
        if best.gain > needed {
            return Err((lost(&best.breaks, &numbers), best.left / squares(&own)));
        }
        let less = best.left < MORE * left;
        (so_far, left) = (best.breaks.clone(), best.left);
        if count == 1 {
            all = told;
        }
        if !less {
            break;
        }
    }
    let wanders = wander::open(record, coded, &numbers)?;
    let others = || {
        all.iter().map(|told| {
            let likely = BEFOREHAND / tries * (0.5 * told.gain).exp();
            (likely, told.coded.as_slice())
        })
    };
    let likely: f64 = others().map(|(likely, _)| likely).sum();
    if likely / (1.0 + likely) < UNLIKELY {
        return Ok(wanders);
    }
    let broken = off_by(coded, others());
    Ok(broken
        .iter()
        .zip(wanders)
        .map(|(a, b)| a.hypot(b))
        .collect())
}

/// What the best breaks say beside those that there are.
fn round(
    so_far: &Breaks,
    spreads: &[bool],
    (numbers, record, coded): (&Numbers, &Record, &[f64]),
    own: &[f64],
) -> Vec<Told> {
    let places = (1..PLACES).map(|k| (numbers.last * k as f64 / PLACES as f64).round());
    let mut tried: Vec<(f64, Breaks)> = places
        .flat_map(|at| LOST.map(|rows| (at, rows)))
        .flat_map(|(at, rows)| spreads.iter().map(move |s| so_far.with(at, rows, *s)))
        .map(|breaks| (breaks.left(numbers, record, coded), breaks))
        .collect();
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    tried
        .into_iter()
        .take(SETTLED)
        .filter_map(|(_, breaks)| {
            let breaks = breaks.nearby(numbers, record, coded);
            breaks.told(numbers, record, coded, own)
        })
        .collect()
}

fn lost(breaks: &Breaks, numbers: &Numbers) -> Unknown {
    let mut places = breaks.all.clone();
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let said: Vec<String> = places
        .iter()
        .map(|(at, rows)| {
            let count = counted(rows.abs() as usize, "row");
            let what = if *rows > 0.0 { "lost" } else { "written twice" };
            format!("{count} {what} at {:.4} Hz", numbers.frequency(*at))
        })
        .collect();
    Unknown::all(format!(
        "it is told far better with {}: were its frequencies numbered anew?",
        said.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Complex;

    /// Two modes and their noise at even frequencies, of which so many rows were lost behind one before they were numbered.
    fn made(noise: f64, lost: usize) -> (Record, Vec<f64>) {
        let at = |k: usize| 50.0 + 0.8 * k as f64;
        let drawn = |k: usize| {
            let bits = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            noise * ((bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
        };
        let told = |k: usize| {
            let f = at(if k < 170 { k } else { k + lost });
            let mode = |own: f64, size: f64| {
                size / Complex::new(1.0 - (f / own).powi(2), 2.0 * 0.02 * f / own)
            };
            let noise = Complex::new(drawn(k), drawn(k + 517));
            (mode(150.0, 1.0) + mode(260.0, 0.4)) * (1.0 + noise)
        };
        let frequency: Vec<f64> = (0..400).map(at).collect();
        let response: Vec<Complex<f64>> = (0..400).map(told).collect();
        let record = Record::new(&frequency, &response, None).unwrap();
        let start = [150.0_f64, 0.02, 260.0 - 0.8 * lost as f64, 0.02];
        let start = [
            (TAU * start[0]).ln(),
            start[1].ln(),
            (TAU * start[2]).ln(),
            start[3].ln(),
            0.0,
        ];
        let (coded, _) = record.settle(&start).unwrap();
        (record, coded)
    }

    #[test]
    fn rows_that_were_lost_between_two_modes_show_and_none_do_where_none_were() {
        for noise in [0.003, 0.03] {
            let (record, coded) = made(noise, 0);
            let open = open(&record, &coded).unwrap();
            let known = record.known(&coded).unwrap();
            assert!(open[2] < known.std[2], "{noise}: {open:?}");
        }
        for lost in [2, 7] {
            let (record, coded) = made(0.003, lost);
            let (why, _) = open(&record, &coded).unwrap_err();
            assert!(why.because.contains("numbered anew"), "{}", why.because);
        }
    }
}
