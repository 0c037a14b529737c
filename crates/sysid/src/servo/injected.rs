//! What was added to a controller's voltage, by another scale than it is written: as of another unit, a gain between, or a generator that
//! was cut off.
//!
//! A part of the force that is written too large or too small pulls all parameters, and leaves as little as they take of it. Beside them as
//! a column of its own it says how much of itself drove the axis: all of it where it is what was added, none where it already stands in
//! the voltage.

use super::bent::NAMES;
use super::other::{OTHER, SURELY, beside};
use super::slides::{ASIDE, Slides};
use super::{Equations, Moved, Record, Settings, Unknown, Variant};
use pigtail_numerics::regression::{Solution, least_squares, tolerance};
use std::borrow::Cow;

/// Least tolerance of a column beside the others: what was added tells its own share only where the controller does not make up for it.
const OWN: f64 = 1e-3;

/// A scale that is off by less than this nobody states better, and it pulls no parameter by more: what seems to be a share of so little is
/// another one's doing.
const WORTH: f64 = 0.01;

/// What equations say beside a share of what was injected.
#[derive(Debug)]
pub(super) struct Shared {
    solution: Solution,
    /// How many times as much of it drove the axis as is written, beyond what is taken; and the deviation of that.
    more: [f64; 2],
}

/// What equations say where what was injected has a share of its own, and that is surely not what it was taken for.
pub(super) fn shared(
    record: &Record,
    moved: &Moved,
    set: &Settings,
    columns: &Equations,
) -> Option<Shared> {
    let column = record.injected_column()?;
    let volts = |k: usize| Cow::Borrowed(&record.even.stretches[k].columns[column][..]);
    let added = moved.equations_of(volts, set).force;
    let slides = Slides::of(columns, 0)?;
    if added.len() != columns.force.len() {
        return None;
    }
    // It stands among what tells the force: what drove beyond it is missing there.
    let own = slides.rows.iter().map(|i| -added[*i]).collect();
    let x = beside(&slides.x, &[own]);
    if tolerance(&x, slides.x.ncols()) < OWN {
        return None;
    }
    let solution = least_squares(&x, &slides.force)?;
    let more = [*solution.values.last()?, *solution.std_correlated.last()?];
    let surely = more[0].abs() > WORTH.max(SURELY * more[1]);
    surely.then_some(Shared { solution, more })
}

impl Shared {
    /// Makes parameters less sure by what that changes; those that it makes others are not known.
    pub(super) fn widen(
        &self,
        variants: &mut [Variant],
        unknown: &mut Vec<Unknown>,
        remarks: &mut Vec<String>,
    ) {
        let said = format!(
            "{:.3} +- {:.3} times what was injected moved the axis beside what was taken for it: is its unit or its scale another one, \
             or was it cut off?",
            self.more[0], self.more[1]
        );
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
                        because: said.clone(),
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
                "{said} Parameters are less sure by what that changes"
            ));
        }
    }
}
