//! What was added to a controller's voltage, otherwise than it is written: by another scale, as of another unit, a gain between, or a
//! generator that was cut off; earlier or later; or by way of a filter.
//!
//! A part of the force that is written too large or too small pulls all parameters, and leaves as little as they take of it. Beside them as
//! a column of its own it says how much of itself drove the axis: all of it where it is what was added, none where it already stands in
//! the voltage.

use super::bent::NAMES;
use super::other::{OTHER, SURELY, beside};
use super::slides::{ASIDE, Slides};
use super::{Equations, Moved, Record, Settings, Unknown, Variant};
use pigtail_numerics::regression::{Solution, least_squares, tolerance};
use pigtail_numerics::signal::rms;
use std::borrow::Cow;

/// Least tolerance of a column beside the others: what was added tells its own share only where the controller does not make up for it.
const OWN: f64 = 1e-3;

/// A scale that is off by less than this nobody states better, and it pulls no parameter by more: what seems to be a share of so little is
/// another one's doing.
const WORTH: f64 = 0.01;

/// What equations say beside what was injected.
#[derive(Debug)]
pub(super) struct Shared {
    solution: Solution,
    /// What it shows, in words.
    said: String,
}

/// What equations say where what was injected surely did not move the axis as it was taken to: by a share of its own, by one of its first
/// difference where it came earlier or later, and by one of its second where it went through a filter or overshot.
pub(super) fn shared(
    record: &Record,
    moved: &Moved,
    set: &Settings,
    columns: &Equations,
) -> Option<Shared> {
    let column = record.injected_column()?;
    let volts = |k: usize| Cow::Borrowed(&record.even.stretches[k].columns[column][..]);
    let added = moved.equations_of(volts, set);
    let slides = Slides::of(columns, 0)?;
    if added.force.len() != columns.force.len() {
        return None;
    }
    let mut shown = None;
    let mut x = slides.x;
    let own = |column: &[f64]| -> Vec<f64> { slides.rows.iter().map(|i| -column[*i]).collect() };
    let whole = rms(own(&added.force));
    for (order, column) in [&added.force, &added.lag, &added.curve]
        .into_iter()
        .enumerate()
    {
        // It stands among what tells the force: what drove beyond it is missing there.
        let column = own(column);
        let size = rms(column.iter().copied());
        x = beside(&x, &[column]);
        if tolerance(&x, x.ncols() - 1) < OWN {
            break;
        }
        let solution = least_squares(&x, &slides.force)?;
        let (value, std) = (*solution.values.last()?, *solution.std_correlated.last()?);
        if value.abs() * size > WORTH * whole && value.abs() > SURELY * std {
            shown = Some((order, value, std, solution));
        }
    }
    let (order, value, std, solution) = shown?;
    let said = match order {
        0 => format!(
            "{value:.3} +- {std:.3} times what was injected moved the axis beside what was taken for it: is its unit or its scale \
             another one, or was it cut off?"
        ),
        1 => "what was injected moved the axis earlier or later than it is written".to_owned(),
        _ => "what was injected moved the axis otherwise than it is written: was it filtered, or does it overshoot?".to_owned(),
    };
    Some(Shared { solution, said })
}

impl Shared {
    /// Makes parameters less sure by what that changes; those that it makes others are not known.
    pub(super) fn widen(
        &self,
        variants: &mut [Variant],
        unknown: &mut Vec<Unknown>,
        remarks: &mut Vec<String>,
    ) {
        let mut any = false;
        for (j, names) in NAMES.iter().enumerate() {
            let (value, std) = (self.solution.values[j], self.solution.std_correlated[j]);
            let parameters = variants.iter_mut().flat_map(|v| &mut v.parameters);
            let own = parameters.filter(|p| names.contains(&p.name));
            for known in own.filter_map(|p| p.known.as_mut()) {
                let off = (known.value - value).abs();
                let sure = known.std_correlated.max(std);
                let another = off > OTHER * value.abs() && off > SURELY * sure;
                if another && !unknown.iter().any(|u| u.covers(names[0])) {
                    unknown.push(Unknown {
                        parameters: names.to_vec(),
                        because: self.said.clone(),
                    });
                }
                if off > ASIDE * sure {
                    known.std_correlated = off;
                    any = true;
                }
            }
        }
        if any {
            remarks.push(format!(
                "{}; parameters are less sure by what that changes",
                self.said
            ));
        }
    }
}
