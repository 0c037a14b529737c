//! A servo's record: what its columns are, what drives its axis, and what no motion makes.

use super::equations::Moved;
use super::{Friction, Method, Settings, Unknown};
use crate::outliers;
use crate::timeline::{Even, counted};
use pigtail_numerics::regression::robust_alone;
use pigtail_numerics::signal::rms;
use std::borrow::Cow;

/// Columns.
pub(super) const POSITION: usize = 0;
pub(super) const VOLTAGE: usize = 1;
pub(super) const REFERENCE: usize = 2;

/// A servo's record on an even grid: position, voltage and, where there is one, the reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub(super) even: Even,
    pub(super) has_reference: bool,
    injected: Option<Injected>,
}

/// What a column holds that was added to the controller's voltage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Injected {
    /// Volts.
    Volts,
    /// Newtons or newton metres.
    Force,
}

impl Record {
    /// A record whose columns are the position (m or rad), the voltage (V) and, if `has_reference`,
    /// the reference (as the position).
    pub fn new(even: Even, has_reference: bool) -> Self {
        Self {
            even,
            has_reference,
            injected: None,
        }
    }

    /// The same, whose last column is what was added to the controller's voltage.
    #[must_use]
    pub fn with_injected(mut self, of: Injected) -> Self {
        self.injected = Some(of);
        self
    }

    /// Where what was injected stands.
    pub(super) fn injected_column(&self) -> Option<usize> {
        self.injected
            .map(|_| REFERENCE + usize::from(self.has_reference))
    }

    /// The same in volts, its voltage the whole one that drives the axis; and whether the voltage that was recorded
    /// had that in it already.
    pub(super) fn driven(&self, set: &Settings) -> (Cow<'_, Self>, bool) {
        let Some(column) = self.injected_column() else {
            return (Cow::Borrowed(self), true);
        };
        let mut within = self.clone();
        if self.injected == Some(Injected::Force) {
            for stretch in &mut within.even.stretches {
                for v in &mut stretch.columns[column] {
                    *v /= set.force_per_volt;
                }
            }
        }
        within.injected = Some(Injected::Volts);
        let mut beside = within.clone();
        for stretch in &mut beside.even.stretches {
            let added = stretch.columns[column].clone();
            for (u, v) in stretch.columns[VOLTAGE].iter_mut().zip(added) {
                *u += v;
            }
        }
        // What drives it is what its motion answers to.
        let moved = Moved::of(&within, set);
        let left = |record: &Self| {
            let columns = moved.equations(record, set);
            let x = columns.matrix(Friction::Asymmetric, Method::LeastSquares);
            robust_alone(&x, &columns.force).map_or(f64::INFINITY, |s| rms(s.residuals))
        };
        if left(&beside) < left(&within) {
            (Cow::Owned(beside), false)
        } else {
            (Cow::Owned(within), true)
        }
    }

    /// Where what was injected was found to be.
    pub(super) fn told_injected(&self, within: bool) -> Option<String> {
        self.injected.map(|_| {
            format!(
                "what was injected is {} the voltage that was recorded, by how the axis moved",
                if within { "in" } else { "not in" }
            )
        })
    }

    /// All samples of a column.
    pub(super) fn column(&self, column: usize) -> Cow<'_, [f64]> {
        match &self.even.stretches[..] {
            [one] => Cow::Borrowed(&one.columns[column]),
            all => Cow::Owned(
                all.iter()
                    .flat_map(|s| s.columns[column].iter().copied())
                    .collect(),
            ),
        }
    }

    /// Its grid.
    pub fn even(&self) -> &Even {
        &self.even
    }
}

/// A record without what no motion makes.
pub(super) fn cleaned(record: &Record, remarks: &mut Vec<String>) -> Result<Record, Unknown> {
    let mut record = record.clone();
    let position = outliers::smooth(&mut record.even, POSITION);
    let volts = outliers::jumping(&mut record.even, VOLTAGE);
    remarks.extend(position.remarks("position"));
    if volts > 0 {
        remarks.push(format!(
            "{} of the voltage, apart from both neighbours, set aside and bridged",
            counted(volts, "single sample")
        ));
    }
    if position.steps > outliers::MOST_STEPS {
        return Err(Unknown::all(format!(
            "its position jumps as no motion does at {} places: rows are missing that no stamp shows, or the encoder \
             loses counts",
            position.steps
        )));
    }
    Ok(record)
}
