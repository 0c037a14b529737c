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
mod bent;
mod check;
mod clipped;
mod controller;
mod doubtful;
mod equations;
mod motion;
mod other;
mod replay;
mod skew;
mod slides;
mod sliding;
mod smeared;
mod smoothed;
mod variants;

pub use controller::Controller;
pub use motion::Motion;
pub use other::Place;
pub use replay::{Axis, Replay};
pub use sliding::Sliding;

use equations::{APART, Equations, Moved, rate};
use variants::variants;

use super::outliers;
use super::timeline::{Even, counted};
use super::{Account, Known, Parameter, Unknown};
use pigtail_numerics::regression::{robust_alone, tolerance};
use pigtail_numerics::signal::rms;
use std::borrow::Cow;

/// A servo's record on an even grid: position, voltage and, where there is one, the reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    even: Even,
    has_reference: bool,
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

const POSITION: usize = 0;
const VOLTAGE: usize = 1;
const REFERENCE: usize = 2;

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
    fn injected_column(&self) -> Option<usize> {
        self.injected
            .map(|_| REFERENCE + usize::from(self.has_reference))
    }

    /// The same in volts, its voltage the whole one that drives the axis; and whether the voltage that was recorded
    /// had that in it already.
    fn driven(&self, set: &Settings) -> (Cow<'_, Self>, bool) {
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
    fn told_injected(&self, within: bool) -> Option<String> {
        self.injected.map(|_| {
            format!(
                "what was injected is {} the voltage that was recorded, by how the axis moved",
                if within { "in" } else { "not in" }
            )
        })
    }

    /// All samples of a column.
    fn column(&self, column: usize) -> Cow<'_, [f64]> {
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

/// How a record is made into equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Force or torque of a volt, N/V or N m/V.
    pub force_per_volt: f64,
    /// Cutoff of the position's filter, hertz; a tenth of the sample rate and at most 100 Hz if none.
    pub cutoff: Option<f64>,
    /// Order of the filter.
    pub order: usize,
    /// Samples left out at each stretch's start.
    pub skip: usize,
    /// One equation in so many samples; the sample rate over the cutoff if none.
    pub decimate: Option<usize>,
    /// The controller, where it is known.
    pub controller: Option<Controller>,
    /// Whether equations are left out at either end of a stretch, where filters still settle: [`identify`] tells from the
    /// record.
    pub settle: bool,
    /// What goes with the place and is taken out of the force: [`identify`] tells from the record.
    pub place: Option<Place>,
    /// Whether voltage and position are of the moments of their rows, no skew having been taken out: [`identify`] tells from the
    /// record.
    pub as_stamped: bool,
}

impl Settings {
    /// The usual settings for a force per volt.
    pub fn new(force_per_volt: f64) -> Self {
        Self {
            force_per_volt,
            cutoff: None,
            order: 4,
            skip: 49,
            decimate: None,
            controller: None,
            settle: false,
            place: None,
            as_stamped: true,
        }
    }

    fn cutoff(&self, period: f64) -> f64 {
        self.cutoff.unwrap_or((0.1 / period).min(100.0))
    }

    fn factor(&self, period: f64) -> usize {
        let usual = (1.0 / (period * self.cutoff(period))).round();
        self.decimate.unwrap_or(usual as usize).max(1)
    }
}

/// A law of friction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Friction {
    /// Both directions alike, beside an offset.
    Symmetric,
    /// Each direction has its own.
    Asymmetric,
}

/// How the equations are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Ordinary least squares.
    LeastSquares,
    /// Least squares by Huber's weights.
    Weighted,
    /// Instrumental variables, from the closed loop replayed with what least squares found.
    Instrumental,
    /// Least squares where the axis moves, with one unknown more: how long after its sample a voltage
    /// acts. One that is held until the next sample acts half a period later on average.
    Delayed,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::LeastSquares,
        Self::Weighted,
        Self::Instrumental,
        Self::Delayed,
    ];
}

impl Friction {
    /// Its parameters' names, the inertia's first.
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::Symmetric => &["inertia", "viscous_friction", "coulomb_friction", "offset"],
            Self::Asymmetric => &[
                "inertia",
                "viscous_friction_forward",
                "coulomb_friction_forward",
                "viscous_friction_backward",
                "coulomb_friction_backward",
            ],
        }
    }
}

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

/// One way to the parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Its law of friction.
    pub friction: Friction,
    /// How it was solved.
    pub method: Method,
    /// What it found; the delay of the voltage last, where it was looked for.
    pub parameters: Vec<Parameter>,
    /// Whether the record says when its voltage acts, and the delay tells all of it: of [`Method::Delayed`] only.
    tells_delay: bool,
    /// Whether the voltage shows to have been filtered, and what that makes of the answer was taken out: of [`Method::Delayed`] only.
    filtered: bool,
    /// Values of the equations' columns: by the order of [`Friction::names`], whether or not they may be
    /// told, then the delay in samples, where it was looked for.
    pub values: Vec<f64>,
    /// Condition number of the equations.
    pub condition: f64,
    /// Relative error of force on the record it was fitted to, per cent.
    pub relative_error_percent: f64,
    /// The same on a second record; without one on the record's last part, fitted to the rest.
    pub validation_error_percent: Option<f64>,
}

impl Variant {
    /// What moves in a replay.
    pub fn axis(&self, force_per_volt: f64) -> Axis {
        let mut v = self.values.clone();
        v.resize(self.friction.names().len(), 0.0);
        match self.friction {
            Friction::Symmetric => Axis {
                force_per_volt,
                inertia: v[0],
                viscous: [v[1], v[1]],
                coulomb: [v[2], v[2]],
                offset: v[3],
            },
            Friction::Asymmetric => Axis {
                force_per_volt,
                inertia: v[0],
                viscous: [v[1], v[3]],
                coulomb: [v[2], v[4]],
                offset: 0.0,
            },
        }
    }
}

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
    let supported = supported(&variants);
    let noise = check::acceleration_noise(moved, set);
    let (all, unknowns) = (&mut variants, &mut unknown);
    if let Some(smeared) = smeared {
        smeared.widen(supported, all, unknowns, &mut remarks);
    }
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

/// Leaves out the equations that are not to be believed: which were kept, where some were not, and whether a voltage that was cut off is
/// the reason.
fn believed(
    (columns, lost): (&mut Equations, &doubtful::Lost),
    record: &Record,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> Result<(Option<Vec<bool>>, bool), Unknown> {
    let out = |keep: &[bool]| keep.iter().filter(|k| !**k).count();
    let mut keep = doubtful::untouched(columns, lost, set, record.even.period);
    if let Some(keep) = &keep {
        columns.retain(keep);
        enough(columns, record)?;
    }
    if columns.one_way {
        return Ok((keep, false));
    }
    let mut cut = false;
    if let Some((whole, level)) = clipped::clipped(record, set, columns)? {
        remarks.push(format!(
            "the voltage is cut off in the record: where it is high the motion asks for more than is written; the \
             equations above {level:.3} V were left out, {:.0} % of them",
            100.0 * out(&whole) as f64 / whole.len() as f64
        ));
        columns.retain(&whole);
        enough(columns, record)?;
        keep = Some(both(keep, whole));
        cut = true;
    }
    if let Some(near) = columns.apart() {
        remarks.push(format!(
            "{} of {} equations stand apart from all others, by more than {APART} standard deviations; set aside",
            out(&near),
            near.len()
        ));
        columns.retain(&near);
        keep = Some(both(keep, near));
    }
    if let Some(slides) = other::sliding(columns) {
        remarks.push(format!(
            "where it stands, friction is not that of its motion: equations below a tenth of its highest speed were left \
             out, {:.0} % of them",
            100.0 * out(&slides) as f64 / slides.len() as f64
        ));
        columns.retain(&slides);
        keep = Some(both(keep, slides));
    }
    Ok((keep, cut))
}

/// Which of all are kept, of those that were before, where some were not.
fn both(before: Option<Vec<bool>>, of_these: Vec<bool>) -> Vec<bool> {
    let all = before.unwrap_or_else(|| vec![true; of_these.len()]);
    let mut of_these = of_these.into_iter();
    let both = all
        .into_iter()
        .map(|kept| kept && of_these.next().unwrap_or(true));
    both.collect()
}

fn enough(columns: &Equations, record: &Record) -> Result<(), Unknown> {
    if columns.force.len() >= LEAST_EQUATIONS {
        return Ok(());
    }
    Err(Unknown::all(format!(
        "it makes {} equations of {} samples in {} stretches; wanted are at least {LEAST_EQUATIONS}",
        columns.force.len(),
        record.even.samples(),
        record.even.stretches.len()
    )))
}

/// A record without what no motion makes.
fn cleaned(record: &Record, remarks: &mut Vec<String>) -> Result<Record, Unknown> {
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

/// Settings under which the noise of the position is next to nothing beside the acceleration: noise in what a force
/// is told by makes an inertia too small. Only where no cutoff was given.
fn quiet(record: &Record, set: &Settings, remarks: &mut Vec<String>) -> (Settings, Moved) {
    let period = record.even.period;
    let usual = set.cutoff(period);
    let mut quiet = *set;
    let mut moved = Moved::of(record, set);
    if set.cutoff.is_some() || set.decimate.is_some() {
        return (quiet, moved);
    }
    for halvings in 0..4 {
        if halvings > 0 {
            quiet.cutoff = Some(usual * 0.5_f64.powi(halvings));
            moved = Moved::of(record, &quiet);
        }
        if check::noise_share(record, &moved, &quiet) < check::QUIET {
            break;
        }
    }
    if let Some(cutoff) = quiet.cutoff {
        remarks.push(format!(
            "the position is noisy: filtered at {cutoff:.3} Hz instead of {usual:.3} Hz, so that its noise does not \
             count as acceleration"
        ));
    }
    (quiet, moved)
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
