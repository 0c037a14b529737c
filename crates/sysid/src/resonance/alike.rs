//! Whether all sides of a response say the same of a mode, and whether a peak has the shape of one.
//!
//! A mode is told by its peak and by how fast the phase turns there, on the peak and beside it. What smooths one of them, or cuts it off,
//! leaves the others, and a fit to all lies between: where a model is right it does not matter how much each counts. Where all was
//! smoothed no few modes tell it.

use super::Record;
use super::search::{extend, squares};
use crate::Unknown;
use crate::steady::chi_squared;
use nalgebra::DVector;
use pigtail_numerics::signal::{independent, rms};
use std::f64::consts::TAU;

/// How much counts what is left along a point's response, its magnitude, and across it, its phase. None of the two alone tells a size.
const LEANS: [[f64; 2]; 2] = [[1.0, 0.02], [0.02, 1.0]];

/// How much more points count that lie within a mode's half width, and less.
const NEARER: f64 = 5.0;

/// Half widths beyond which a point tells nothing of a mode.
const ELSEWHERE: f64 = 3.0;

/// A damping is another one where two sides differ by this share, and by so many deviations.
const OTHER: f64 = 0.1;
const SURELY: f64 = 4.0;

/// What two sides of a response say of a number whose logarithm is searched, and how surely they differ.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sides {
    said: [f64; 2],
    sure: f64,
    names: [&'static str; 2],
}

impl Sides {
    fn apart(self) -> f64 {
        (self.said[0] - self.said[1]).abs()
    }

    /// Whether they are two.
    pub(super) fn differ(self) -> bool {
        self.apart() > OTHER && self.apart() > SURELY * self.sure
    }

    /// By how much either is off where that is more than chance.
    pub(super) fn off(self) -> f64 {
        if self.apart() > 0.5 * SURELY * self.sure {
            0.5 * self.apart()
        } else {
            0.0
        }
    }

    /// What they say, in words that go on with what is said of the mode.
    pub(super) fn words(self) -> [String; 2] {
        let [(one, a), (other, b)] = [0, 1].map(|k| (self.names[k], self.said[k].exp()));
        [
            format!("by {one} the damping is {a:.3e}"),
            format!("by {other} {b:.3e}"),
        ]
    }
}

/// What the two sides that differ most surely say of every number that is searched; `None` where none tells them all.
pub(super) fn sides(record: &Record, coded: &[f64]) -> Option<Vec<Sides>> {
    let leaning = |lean: [f64; 2]| Record {
        lean: Some(lean),
        ..record.clone()
    };
    let near = |k: usize| {
        let at = TAU * record.frequency[k];
        coded[..2 * record.modes(coded)].chunks_exact(2).any(|m| {
            let (own, zeta) = (m[0].exp(), m[1].exp());
            (at - own).abs() < zeta * own
        })
    };
    let counting = |more: f64| Record {
        weight: (0..)
            .zip(&record.weight)
            .map(|(k, w)| if near(k) { more * w } else { *w })
            .collect(),
        ..record.clone()
    };
    let pairs = [
        (LEANS.map(leaning), ["the magnitude", "the phase"]),
        (
            [NEARER, 1.0 / NEARER].map(counting),
            ["points on the peak", "those beside it"],
        ),
    ];
    let surely = |s: &Sides| s.apart() / s.sure;
    pairs
        .into_iter()
        .filter_map(|(records, names)| two(&records, names, coded))
        .reduce(|a, b| {
            let worse = |(a, b): (Sides, Sides)| if surely(&a) < surely(&b) { b } else { a };
            a.into_iter().zip(b).map(worse).collect()
        })
}

fn two(records: &[Record; 2], names: [&'static str; 2], coded: &[f64]) -> Option<Vec<Sides>> {
    let told = |record: &Record| {
        let (values, _) = record.settle(coded)?;
        let known = record.known(&values)?;
        let std = known.std.into_iter().zip(known.std_correlated);
        Some((values, std.map(|(a, b)| a.max(b)).collect::<Vec<f64>>()))
    };
    let ((a, of_a), (b, of_b)) = (told(&records[0])?, told(&records[1])?);
    let all = a.iter().zip(&b).zip(of_a.iter().zip(&of_b));
    let sides = all.map(|((a, b), (s, t))| Sides {
        said: [*a, *b],
        sure: s.hypot(*t),
        names,
    });
    Some(sides.collect())
}

/// What is left on each mode's peak, as a share of the response there, beyond what is left elsewhere; zero where it is not more than chance
/// would leave once in ten thousand times.
///
/// A peak's height goes as one over its damping, and its place is known to a half width: what a model leaves there of the response is a share of
/// either by which it is open. Points that were smoothed, two responses in one, a peak that moved meanwhile leave it, for these change a
/// response where it bends. `left` is of each point, once for each part of the response.
pub(super) fn misfit(record: &Record, left: &[&[f64]], modes: &[f64]) -> Vec<f64> {
    let from = |k: usize, i: usize| {
        let own = modes[2 * k].exp();
        (TAU * record.frequency[i] - own).abs() / (modes[2 * k + 1].exp() * own)
    };
    let count = modes.len() / 2;
    let points = || 0..record.frequency.len();
    let elsewhere: Vec<usize> = points()
        .filter(|i| (0..count).all(|k| from(k, *i) > ELSEWHERE))
        .collect();
    let power = |of: &[usize]| {
        let all = left.iter().flat_map(|part| of.iter().map(|i| part[*i]));
        rms(all).powi(2)
    };
    let usual = power(&elsewhere);
    let part: Vec<f64> = elsewhere.iter().map(|i| left[0][*i]).collect();
    let own = independent(&part) / part.len() as f64;
    let open = |k: usize| {
        let near: Vec<usize> = points().filter(|i| from(k, *i) < 1.0).collect();
        let freedom = (own * (left.len() * near.len()) as f64).max(1.0);
        let there = power(&near);
        // Of none there is nothing, and nothing is not more.
        if there > usual * chi_squared(freedom) / freedom {
            let size = rms(near
                .iter()
                .map(|i| record.weight[*i] * record.response[*i].norm()));
            ((there - usual) * left.len() as f64).sqrt() / size
        } else {
            0.0
        }
    };
    (0..count).map(open).collect()
}

/// Whether the magnitude that is told has one peak alone from a half width below the first of two modes to one above the second. Each is
/// its frequency, Hz, and its half width.
pub(super) fn one_peak(
    record: &Record,
    (coded, values): (&[f64], &[f64]),
    [(first, below), (second, above)]: [(f64, f64); 2],
) -> bool {
    const POINTS: usize = 400;
    let (low, high) = (first - below, second + above);
    let grid = Record {
        frequency: (0..=POINTS)
            .map(|k| low + (high - low) * k as f64 / POINTS as f64)
            // The delay is counted by the highest frequency.
            .chain(std::iter::once(record.highest().max(high)))
            .collect(),
        response: vec![nalgebra::Complex::new(0.0, 0.0); POINTS + 2],
        weight: vec![1.0; POINTS + 2],
        ..record.clone()
    };
    let x = grid.columns(coded);
    if x.ncols() != values.len() {
        return false;
    }
    let told = x * DVector::from_column_slice(values);
    let size = |k: usize| told[k].hypot(told[POINTS + 2 + k]);
    let highest = |k: &usize| size(*k) > size(k - 1) && size(*k) >= size(k + 1);
    (1..POINTS).filter(highest).count() < 2
}

/// That as many modes as are looked for at most are all that there are. `worth` is the share by which one has to make the error less.
pub(super) fn few_enough(record: &Record, coded: &[f64], worth: f64) -> Result<(), Unknown> {
    let left = |coded: &[f64]| squares(&record.residuals(coded)).sqrt();
    let Some(more) = extend(record, coded) else {
        return Ok(());
    };
    let (with, without) = (left(&more), left(coded));
    if with > (1.0 - worth) * without {
        return Ok(());
    }
    Err(Unknown::all(format!(
        "{} modes do not tell it, and one more at {:.3} Hz leaves {:.0} % of what they do: it is no response of few modes; were its \
         points smoothed?",
        record.modes(coded),
        more[2 * record.modes(coded)].exp() / TAU,
        100.0 * with / without
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Complex;

    #[test]
    fn what_is_left_on_a_peak_is_a_misfit_and_what_is_left_everywhere_is_none() {
        let frequency: Vec<f64> = (0..400).map(|k| 50.0 + 0.25 * f64::from(k)).collect();
        let response = vec![Complex::new(2.0, 0.0); 400];
        let record = Record {
            weight: vec![0.5; 400],
            frequency,
            response,
            ..Record::default()
        };
        let modes = [(TAU * 100.0).ln(), 0.02_f64.ln()];
        let noise: Vec<f64> = (0..400)
            .map(|k| 0.01 * (f64::from(k * 7919 % 1000) / 500.0 - 1.0))
            .collect();
        assert_eq!(misfit(&record, &[&noise, &noise], &modes), [0.0]);
        let bent: Vec<f64> = noise
            .iter()
            .zip(&record.frequency)
            .map(|(n, f)| n + if (f - 100.0).abs() < 2.0 { 0.1 } else { 0.0 })
            .collect();
        let open = misfit(&record, &[&bent, &noise], &modes)[0];
        assert!((open - 0.1).abs() < 0.005, "{open}");
        let open = misfit(&record, &[&bent], &modes)[0];
        assert!((open - 0.1).abs() < 0.005, "{open}");
    }
}
