//! Inertia and friction of a servo axis by its inverse dynamic model, linear in the parameters:
//!
//! ```text
//! K u = M a + F_v v + F_c sgn(v) + c          symmetric
//! K u = M a + F_v+ v+ + F_c+ s+ + F_v- v- + F_c- s-     asymmetric
//! ```
//!
//! with the force (or torque) `K u` of a voltage `u`, the inertia `M`, viscous and Coulomb friction and
//! an offset `c`; `v+` is the velocity where it is positive and zero elsewhere, `s+` one there. Velocity
//! and acceleration come from the position filtered both ways, by central differences; every column is
//! decimated in the same way, which filters what they have in common alike.
//!
//! M. Gautier and A. Janot; the settings are those of A. Janot, M. Gautier and M. Brunot, *Data Set and
//! Reference Models of EMPS*, Workshop on Nonlinear System Identification Benchmarks, 2019.

mod agree;
mod believed;
mod bent;
mod check;
mod clipped;
mod controller;
mod doubtful;
mod equations;
mod fewer;
mod injected;
mod motion;
mod other;
mod record;
mod replay;
mod settings;
mod skew;
mod slides;
mod sliding;
mod smeared;
mod smoothed;
mod variant;
mod variants;

pub use controller::Controller;
pub use motion::Motion;
pub use other::Place;
pub use record::{Injected, Record};
pub use replay::{Axis, Replay};
pub use settings::Settings;
pub use sliding::Sliding;
pub use variant::{Friction, Method, Variant};

use believed::{believed, enough};
use equations::{Equations, Moved, rate};
use injected::Shared;
use record::{POSITION, REFERENCE, VOLTAGE, cleaned};
use settings::quiet;
use smeared::Smeared;
use variants::variants;

use super::{Account, Known, Parameter, Unknown};
use pigtail_numerics::regression::tolerance;

/// Fewest samples of a stretch, beside those that are left out.
pub const LEAST: usize = 100;

/// Share of the highest speed below which an axis may stick.
const SLOW: f64 = 0.1;

/// Fewest equations.
const LEAST_EQUATIONS: usize = 60;

/// Delay of the voltage beyond which it is no delay, but columns of other moments, samples.
const LATEST: f64 = 5.5;

/// Relative error beyond which a model explains nothing, per cent.
const UNEXPLAINED: f64 = 100.0 / 3.0;

/// By how much a variant's error may lie above the least, for a simpler one is preferred.
const AS_GOOD: f64 = 1.01;

/// A delay of the voltage is believed, and makes every parameter less sure that was found without one, where it
/// leaves less than this share of the error.
const LATE: f64 = 0.93;

/// What a record says of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// All variants; those whose equations had no solution are not there.
    pub variants: Vec<Variant>,
    /// What cannot be known.
    pub unknown: Vec<Unknown>,
    /// The controller, where one of the known kinds tells the voltage from reference and position.
    pub controller: Option<Controller>,
    /// Which variant generalises, by its place.
    pub best: usize,
    /// Number of equations.
    pub equations: usize,
    /// Remarks on what was done to the record.
    pub remarks: Vec<String>,
    /// How far its motion went.
    pub motion: Motion,
    /// The method whose answer the record supports: with a delay of the voltage where it shows one, else without.
    pub supported: Method,
    /// By how much later than its stamp the voltage acts, seconds, where that was taken out; zero where it was not.
    pub skew: f64,
    columns: Equations,
}

impl Identified {
    /// A variant by what it is.
    pub fn variant(&self, friction: Friction, method: Method) -> Option<&Variant> {
        self.variants
            .iter()
            .find(|v| v.friction == friction && v.method == method)
    }

    /// Force measured beside the one that a variant tells.
    pub fn account(&self, variant: &Variant) -> Account {
        let x = self.columns.matrix(variant.friction, variant.method);
        let prediction = x * nalgebra::DVector::from_column_slice(&variant.values);
        Account {
            time: self.columns.time.clone(),
            measured: self.columns.force.clone(),
            modelled: prediction.iter().copied().collect(),
            position: self.columns.position.clone(),
            velocity: self.columns.velocity.clone(),
        }
    }
}

/// That a model has anything to say of the force.
fn explains(first: &Variant) -> Result<(), Unknown> {
    if first.relative_error_percent <= UNEXPLAINED {
        return Ok(());
    }
    Err(Unknown::all(format!(
        "inertia and friction leave {:.0} % of its force unexplained: are columns, units and signs right?",
        first.relative_error_percent
    )))
}

/// That the inertia is, or why it is not known.
fn positive(first: &Variant, unknown: &mut Vec<Unknown>) -> Result<(), Unknown> {
    if first.values[0] > 0.0 || unknown.iter().any(|u| u.covers("inertia")) {
        return Ok(());
    }
    if unknown.is_empty() {
        return Err(Unknown::all(
            "the inertia that fits it best is negative: voltage or position has the wrong sign, or columns \
             are swapped",
        ));
    }
    unknown.push(Unknown {
        parameters: vec!["inertia"],
        because: "it moves at constant speed, nearly: the inertia that fits it best is negative"
            .to_owned(),
    });
    Ok(())
}

/// What is not known where position and reference are of two scales.
fn of_another_scale(record: &Record, controller: Option<&Controller>) -> Option<Unknown> {
    let scale = controller::scale(record, controller)?;
    Some(Unknown {
        parameters: [
            &Friction::Symmetric.names()[..2],
            &Friction::Asymmetric.names()[1..2],
            &Friction::Asymmetric.names()[3..4],
        ]
        .concat(),
        because: format!(
            "the position says {scale:.4} times as much as its controller sees, going by the reference: is the scale of one of the \
             two another?"
        ),
    })
}

/// That the voltage was filtered, where a variant shows it.
fn filtered(variants: &[Variant]) -> Option<String> {
    variants.iter().any(|v| v.filtered).then(|| {
        "the voltage is weaker where it changes fast than what moved the axis, as one that was filtered before it was written; told \
         with that taken out"
            .to_owned()
    })
}

/// Identifies an axis; `second` is another record of the same axis that says which variant
/// generalises.
///
/// # Errors
///
/// What makes the whole record useless.
pub fn identify(
    record: &Record,
    second: Option<&Record>,
    set: &Settings,
) -> Result<Identified, Unknown> {
    let mut remarks = record.even.remarks();
    let (record, second) = (
        &cleaned(record, &mut remarks)?,
        second.map(|r| cleaned(r, &mut Vec::new())).transpose()?,
    );
    let (record, within) = record.driven(set);
    let record = &*record;
    let second = second.as_ref().map(|r| r.driven(set).0);
    remarks.extend(record.told_injected(within));
    let (set, moved) = &quiet(record, set, &mut remarks);
    let (record, lost) = doubtful::told(record, Some(moved), set, &mut remarks)?;
    let record = &*record;
    let second = second
        .map(|r| doubtful::told(&r, None, set, &mut Vec::new()).map(|(r, _)| r.into_owned()))
        .transpose()?;
    let set = &Settings {
        settle: equations::unsettled(&moved.equations(record, set)),
        ..*set
    };
    check::whole(record, set, &mut remarks)?;
    let of_place = other::of_place(record, moved, set, &mut remarks);
    let raw = set;
    let set = &of_place.settings(set);
    let controller = set
        .controller
        .or_else(|| controller::fit(record).filter(|c| c.error_percent < 10.0));
    // Voltage and position of the same moments first; everything else rests on that.
    let skew = skew::skew(record, moved, set)?;
    remarks.extend(skew.remark(record.even.period));
    let set = &skew.settings(set);
    let (stamped, record) = (record, &skew.taken_out(record));
    let second = second.as_ref().map(|r| skew.taken_out(r));
    let mut columns = moved.equations(record, set);
    enough(&columns, record)?;
    let with_place = set.place.map(|_| moved.equations(record, raw));
    check::bandwidth(record, with_place.as_ref().unwrap_or(&columns), set)?;
    let mut unknown = check::excitation(&mut columns, moved, set)?;
    unknown.extend(of_another_scale(stamped, controller.as_ref()));
    let smeared = smeared::smeared(&columns);
    let shared = injected::shared(record, moved, set, &columns);
    let (keep, cut) = believed((&mut columns, &lost), record, set, &mut remarks)?;
    let second = second.map(|r| Equations {
        one_way: columns.one_way,
        ..Equations::of(&r, set)
    });
    let mut variants = variants(
        (record, moved),
        second.as_ref(),
        set,
        &columns,
        controller.as_ref(),
        &unknown,
        (stamped, keep.as_deref()),
    );
    let Some(first) = variants.first() else {
        return Err(Unknown::all(
            "its equations depend on each other: nothing in it changes by itself",
        ));
    };
    positive(first, &mut unknown)?;
    other::changing(&columns, &unknown, &mut remarks)?;
    check::driving(first, &columns)?;
    explains(first)?;
    for variant in &mut variants {
        skew.widen(variant);
    }
    of_place.widen(&mut variants);
    bent::bent(&columns, cut, &mut variants, &mut unknown, &mut remarks);
    remarks.extend(slides::unsteady(&columns, &mut variants, &mut unknown));
    remarks.extend(agree::agree(&columns, &mut variants));
    remarks.extend(fewer::fewer((record, moved), set, &columns, &mut variants));
    let supported = supported(&variants);
    let noise = check::acceleration_noise(moved, set);
    let (all, unknowns) = (&mut variants, &mut unknown);
    less_sure((shared, smeared), supported, all, unknowns, &mut remarks);
    smoothed::smoothed((&columns, noise), supported, all, unknowns, &mut remarks);
    let first = &variants[0];
    check::uncertain(first, &columns, &mut unknown);
    check::robustly(&mut variants, &mut unknown);
    check::together(&variants, record.even.period, &mut remarks)?;
    without_unknown(&mut variants, &unknown);
    remarks.extend(filtered(&variants).filter(|_| supported == Method::Delayed));
    let error = |v: &Variant| v.validation_error_percent.unwrap_or(f64::INFINITY);
    let least = variants.iter().map(error).fold(f64::INFINITY, f64::min);
    let best = variants
        .iter()
        .position(|v| error(v) <= AS_GOOD * least)
        .unwrap_or(0);
    throughout(least)?;
    Ok(Identified {
        variants,
        unknown,
        controller: controller.filter(|_| record.has_reference),
        best,
        equations: columns.force.len(),
        remarks,
        motion: Motion::of(record, &columns, moved, set),
        supported,
        skew: skew.at_start * record.even.period,
        columns,
    })
}

/// Makes parameters less sure by what an injected column's own share and a smeared step of friction change.
fn less_sure(
    (shared, smeared): (Option<Shared>, Option<Smeared>),
    supported: Method,
    variants: &mut [Variant],
    unknown: &mut Vec<Unknown>,
    remarks: &mut Vec<String>,
) {
    if let Some(shared) = shared {
        shared.widen(variants, unknown, remarks);
    }
    if let Some(smeared) = smeared {
        smeared.widen(supported, variants, unknown, remarks);
    }
}

/// What is not known has no value.
fn without_unknown(variants: &mut [Variant], unknown: &[Unknown]) {
    for parameter in variants.iter_mut().flat_map(|v| &mut v.parameters) {
        if unknown.iter().any(|u| u.covers(parameter.name)) {
            parameter.known = None;
        }
    }
}

/// That even the model that generalises best tells a part of the record by what the rest says: else the axis, a gain or a unit was another
/// there. `least` is what it leaves of that part, per cent of the force.
fn throughout(least: f64) -> Result<(), Unknown> {
    if !least.is_finite() || least <= UNEXPLAINED {
        return Ok(());
    }
    Err(Unknown::all(format!(
        "what one part of it says leaves {least:.0} % of the force of another unexplained: did a gain, a unit, a load or the axis \
         change within it?"
    )))
}

/// A delay that the record shows is a part of the answer: one without it is off by as much.
fn supported(variants: &[Variant]) -> Method {
    let told = |v: &Variant| v.friction == Friction::Symmetric && v.tells_delay;
    if variants.iter().any(told) {
        Method::Delayed
    } else {
        Method::LeastSquares
    }
}

/// Replays a record's reference in closed loop, under a law of friction, and keeps at most so many of its rows, evenly.
///
/// `None` for a record without reference, or where the replay runs away.
pub fn replay(
    record: &Record,
    axis: &Axis,
    law: &Sliding,
    controller: &Controller,
    (set, rows): (&Settings, usize),
) -> Option<Replay> {
    record
        .has_reference
        .then(|| replay::whole(&record.driven(set).0, axis, law, controller, (set, rows)))
        .flatten()
}
