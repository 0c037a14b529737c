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

mod check;
mod clipped;
mod controller;
mod motion;
mod replay;
mod skew;
mod sliding;

pub use controller::Controller;
pub use motion::Motion;
pub use replay::{Axis, Replay};
pub use sliding::Sliding;

use super::outliers;
use super::timeline::Even;
use super::{Account, Known, Parameter, Unknown};
use nalgebra::DMatrix;
use pigtail_numerics::regression::{
    Solution, instrumental, least_squares, matrix, over, relative, robust, tolerance,
    without_attenuation,
};
use pigtail_numerics::signal::{Lowpass, decimate, derivative, quantile, rms};

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
    fn driven(&self, set: &Settings) -> (Self, bool) {
        let Some(column) = self.injected_column() else {
            return (self.clone(), true);
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
        let left = |record: &Self| {
            let columns = Equations::of(record, set);
            let x = columns.matrix(Friction::Asymmetric, Method::LeastSquares);
            robust(&x, &columns.force).map_or(f64::INFINITY, |s| rms(s.residuals))
        };
        if left(&beside) < left(&within) {
            (beside, false)
        } else {
            (within, true)
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
    /// Samples left out at each stretch's start, beside a few equations at either end; none leaves out nothing.
    pub skip: usize,
    /// One equation in so many samples; the sample rate over the cutoff if none.
    pub decimate: Option<usize>,
    /// The controller, where it is known.
    pub controller: Option<Controller>,
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

/// The equations' columns.
#[derive(Debug, Clone, PartialEq, Default)]
struct Equations {
    time: Vec<f64>,
    force: Vec<f64>,
    /// By how much the force would be less if it came a sample later.
    lag: Vec<f64>,
    /// Its second difference: what a delay changes to the second order.
    curve: Vec<f64>,
    position: Vec<f64>,
    acceleration: Vec<f64>,
    /// The acceleration by differences over five samples.
    exact: Vec<f64>,
    velocity: Vec<f64>,
    sign: Vec<f64>,
    /// Ones, decimated like the rest: the filter's gain is in them too.
    one: Vec<f64>,
    forward: [Vec<f64>; 2],
    backward: [Vec<f64>; 2],
    /// Whether it moves one way only: the sign is then no column of its own.
    one_way: bool,
}

impl Equations {
    /// The columns of a position, an acceleration's and a velocity's own signs.
    fn extend(&mut self, start: f64, period: f64, position: &[f64], force: &[f64], set: &Settings) {
        let n = position.len();
        let filter = Lowpass::butterworth(set.order, 2.0 * period * set.cutoff(period));
        let smooth = filter.both_ways(position);
        let velocity = derivative(&smooth, period);
        let acceleration = derivative(&velocity, period);
        let exact = rate(&rate(&smooth, period), period);
        let factor = set.factor(period);
        let skip = set.skip.min(n);
        let rows = (n - skip).div_ceil(factor);
        // The filters of position and decimation settle at the ends: what is there is theirs.
        let ends = if skip > 0 { SETTLE.min(rows / 2) } else { 0 };
        let thin = |column: &[f64]| decimate(&column[skip..], factor)[ends..rows - ends].to_vec();
        let of = |f: fn(f64) -> f64| thin(&velocity.iter().map(|v| f(*v)).collect::<Vec<_>>());
        self.force.extend(thin(force));
        let lag: Vec<f64> = (0..n)
            .map(|k| force[k] - force[k.saturating_sub(1)])
            .collect();
        self.lag.extend(thin(&lag));
        let curve: Vec<f64> = (0..n).map(|k| lag[(k + 1).min(n - 1)] - lag[k]).collect();
        self.curve.extend(thin(&curve));
        self.position.extend(thin(&smooth));
        self.velocity.extend(thin(&velocity));
        self.acceleration.extend(thin(&acceleration));
        self.exact.extend(thin(&exact));
        self.sign.extend(of(sign));
        self.one.extend(of(|_| 1.0));
        self.forward[0].extend(of(|v| v.max(0.0)));
        self.forward[1].extend(of(|v| sign(v).max(0.0)));
        self.backward[0].extend(of(|v| v.min(0.0)));
        self.backward[1].extend(of(|v| sign(v).min(0.0)));
        let first = skip + (n - skip + factor - 1) % factor;
        self.time
            .extend((ends..rows - ends).map(|k| start + period * (first + k * factor) as f64));
    }

    fn of(record: &Record, set: &Settings) -> Self {
        let mut equations = Self::default();
        for stretch in &record.even.stretches {
            let position = &stretch.columns[POSITION];
            if position.len() < LEAST + set.skip {
                continue;
            }
            let force: Vec<f64> = stretch.columns[VOLTAGE]
                .iter()
                .map(|u| set.force_per_volt * u)
                .collect();
            equations.extend(stretch.start, record.even.period, position, &force, set);
        }
        equations
    }

    /// Equations that are so far from all others that they would decide alone, if they are few.
    fn apart(&self) -> Option<Vec<bool>> {
        let x = self.matrix(Friction::Asymmetric, Method::LeastSquares);
        let found = robust(&x, &self.force)?;
        let sizes: Vec<f64> = found.residuals.iter().map(|r| r.abs()).collect();
        let far = APART * 1.4826 * quantile(&sizes, 0.5);
        let count = sizes.iter().filter(|s| **s > far).count();
        let few = count > 0 && count as f64 <= FEW * sizes.len() as f64;
        few.then(|| sizes.iter().map(|s| *s <= far).collect())
    }

    /// Leaves out what is not to be believed.
    fn retain(&mut self, keep: &[bool]) {
        let Self {
            time,
            force,
            lag,
            curve,
            position,
            acceleration,
            exact,
            velocity,
            sign,
            one,
            forward,
            backward,
            one_way: _,
        } = self;
        let [f0, f1] = forward;
        let [b0, b1] = backward;
        for column in [
            time,
            force,
            lag,
            curve,
            position,
            acceleration,
            exact,
            velocity,
            sign,
            one,
            f0,
            f1,
            b0,
            b1,
        ] {
            let mut flags = keep.iter();
            column.retain(|_| flags.next().copied().unwrap_or(true));
        }
    }

    fn columns(&self, friction: Friction) -> Vec<&[f64]> {
        match friction {
            // Coulomb friction and offset in one column, which stands where Coulomb friction does.
            Friction::Symmetric if self.one_way => {
                vec![&self.acceleration, &self.velocity, &self.one]
            }
            Friction::Symmetric => {
                vec![&self.acceleration, &self.velocity, &self.sign, &self.one]
            }
            Friction::Asymmetric => vec![
                &self.acceleration,
                &self.forward[0],
                &self.forward[1],
                &self.backward[0],
                &self.backward[1],
            ],
        }
    }

    fn matrix(&self, friction: Friction, method: Method) -> DMatrix<f64> {
        let mut columns = self.columns(friction);
        if method == Method::Delayed {
            columns[0] = &self.exact;
            columns.push(&self.lag);
        }
        matrix(&columns)
    }
}

/// Central differences over five samples: those over three make an acceleration too small by a third of the square of
/// the way that its sine turns between samples.
fn rate(signal: &[f64], period: f64) -> Vec<f64> {
    let n = signal.len();
    let mut rate = derivative(signal, period);
    for k in 2..n.saturating_sub(2) {
        let (near, far) = (signal[k + 1] - signal[k - 1], signal[k + 2] - signal[k - 2]);
        rate[k] = (8.0 * near - far) / (12.0 * period);
    }
    rate
}

fn sign(v: f64) -> f64 {
    if v > 0.0 {
        1.0
    } else if v < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// Fewest samples of a stretch, beside those that are left out.
pub const LEAST: usize = 100;

/// Share of the highest speed below which an axis may stick.
const SLOW: f64 = 0.1;

/// An equation misses by so many of the usual standard deviations where it stands apart, and so large a share of
/// them may.
const APART: f64 = 15.0;
const FEW: f64 = 0.01;

/// Most places where a position may jump, and the record be cut.
const MOST_STEPS: usize = 8;

/// Equations left out at either end of a stretch, unless all samples were asked for: a filter settles within ten
/// periods of its cutoff, and so far they are apart.
const SETTLE: usize = 10;

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

/// Standard deviation of a moment within a sample of which nothing is known, samples: one over the root of twelve.
const WITHIN_A_SAMPLE: f64 = 0.288_675;

/// What is fitted where the axis slides tells the whole record as well, if it leaves less than this of what a fit to all
/// of it leaves. It has one unknown more, and never seen the rest.
const TELLS_ALL: f64 = 1.01;

/// Share of a record's beginning to which variants are fitted where there is no second record; the
/// rest says which of them generalises.
const FITTED: f64 = 0.7;

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
    let (record, within) = &record.driven(set);
    let second = second.map(|r| r.driven(set).0);
    if record.injected.is_some() {
        remarks.push(format!(
            "what was injected is {} the voltage that was recorded, by how the axis moved",
            if *within { "in" } else { "not in" }
        ));
    }
    let set = &quiet(record, set, &mut remarks);
    check::whole(record, set, &mut remarks)?;
    let controller = set
        .controller
        .or_else(|| controller::fit(record).filter(|c| c.error_percent < 10.0));
    // Voltage and position of the same moments first; everything else rests on that.
    let skew = skew::skew(record, set)?;
    remarks.extend(skew.remark(record.even.period));
    let stamped = record;
    let record = &skew.taken_out(record);
    let second = second.map(|r| skew.taken_out(&r));
    let mut columns = Equations::of(record, set);
    enough(&columns, record)?;
    check::bandwidth(record, &columns, set)?;
    let mut unknown = check::excitation(record, &mut columns, set)?;
    let keep = believed(&mut columns, record, set, &mut remarks)?;
    let second = second.map(|r| Equations {
        one_way: columns.one_way,
        ..Equations::of(&r, set)
    });
    let mut variants = variants(
        record,
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
    if first.values[0] <= 0.0 && !unknown.iter().any(|u| u.covers("inertia")) {
        if unknown.is_empty() {
            return Err(Unknown::all(
                "the inertia that fits it best is negative: voltage or position has the wrong sign, or columns \
                 are swapped",
            ));
        }
        unknown.push(Unknown {
            parameters: vec!["inertia"],
            because:
                "it moves at constant speed, nearly: the inertia that fits it best is negative"
                    .to_owned(),
        });
    }
    check::driving(first, &columns)?;
    if first.relative_error_percent > UNEXPLAINED {
        return Err(Unknown::all(format!(
            "inertia and friction leave {:.0} % of its force unexplained: are columns, units and signs right?",
            first.relative_error_percent
        )));
    }
    for variant in &mut variants {
        skew.widen(&mut variant.parameters);
    }
    let first = &variants[0];
    check::uncertain(first, &columns, &mut unknown);
    check::robustly(&mut variants, &mut unknown);
    check::together(&variants, record.even.period, &mut remarks)?;
    for parameter in variants.iter_mut().flat_map(|v| &mut v.parameters) {
        if unknown.iter().any(|u| u.covers(parameter.name)) {
            parameter.known = None;
        }
    }
    let supported = supported(&variants);
    let error = |v: &Variant| v.validation_error_percent.unwrap_or(f64::INFINITY);
    let least = variants.iter().map(error).fold(f64::INFINITY, f64::min);
    let best = variants
        .iter()
        .position(|v| error(v) <= AS_GOOD * least)
        .unwrap_or(0);
    // Where even the model that generalises best tells a part of the record by nothing that the rest says, the axis, a
    // gain or a unit was another there.
    if least.is_finite() && least > UNEXPLAINED {
        return Err(Unknown::all(format!(
            "what one part of it says leaves {least:.0} % of the force of another unexplained: did a gain, a unit, a load \
             or the axis change within it?"
        )));
    }
    Ok(Identified {
        variants,
        unknown,
        controller: controller.filter(|_| record.has_reference),
        best,
        equations: columns.force.len(),
        remarks,
        motion: Motion::of(record, &columns, set),
        supported,
        skew: skew.at_start * record.even.period,
        columns,
    })
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

/// Leaves out the equations that are not to be believed: which were kept, where some were not.
fn believed(
    columns: &mut Equations,
    record: &Record,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> Result<Option<Vec<bool>>, Unknown> {
    if columns.one_way {
        return Ok(None);
    }
    let out = |keep: &[bool]| keep.iter().filter(|k| !**k).count();
    let mut keep = None;
    if let Some((whole, level)) = clipped::clipped(record, set, columns)? {
        remarks.push(format!(
            "the voltage is cut off in the record: where it is high the motion asks for more than is written; the \
             equations above {level:.3} V were left out, {:.0} % of them",
            100.0 * out(&whole) as f64 / whole.len() as f64
        ));
        columns.retain(&whole);
        enough(columns, record)?;
        keep = Some(whole);
    }
    if let Some(near) = columns.apart() {
        remarks.push(format!(
            "{} of {} equations stand apart from all others, by more than {APART} standard deviations; set aside",
            out(&near),
            near.len()
        ));
        columns.retain(&near);
        let all = keep.unwrap_or_else(|| vec![true; near.len()]);
        let mut near = near.into_iter();
        let both = all.into_iter().map(|k| k && near.next().unwrap_or(true));
        keep = Some(both.collect());
    }
    Ok(keep)
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
            "{volts} single samples of the voltage stand apart from both their neighbours; set aside, and bridged"
        ));
    }
    if position.steps > MOST_STEPS {
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
fn quiet(record: &Record, set: &Settings, remarks: &mut Vec<String>) -> Settings {
    let period = record.even.period;
    let usual = set.cutoff(period);
    let mut quiet = *set;
    if set.cutoff.is_some() || set.decimate.is_some() {
        return quiet;
    }
    for halvings in 0..4 {
        if halvings > 0 {
            quiet.cutoff = Some(usual * 0.5_f64.powi(halvings));
        }
        if check::noise_share(record, &quiet) < check::QUIET {
            break;
        }
    }
    if let Some(cutoff) = quiet.cutoff {
        remarks.push(format!(
            "the position is noisy: filtered at {cutoff:.3} Hz instead of {usual:.3} Hz, so that its noise does not \
             count as acceleration"
        ));
    }
    quiet
}

/// Every law of friction by every method, and how each tells what it was not fitted to.
fn variants(
    record: &Record,
    second: Option<&Equations>,
    set: &Settings,
    columns: &Equations,
    controller: Option<&Controller>,
    unknown: &[Unknown],
    (stamped, keep): (&Record, Option<&[bool]>),
) -> Vec<Variant> {
    let mut variants = Vec::new();
    for friction in [Friction::Symmetric, Friction::Asymmetric] {
        if columns.one_way && friction == Friction::Asymmetric {
            continue;
        }
        let x = columns.matrix(friction, Method::LeastSquares);
        let delayed = columns.matrix(friction, Method::Delayed);
        let Some(ordinary) = least_squares(&x, &columns.force) else {
            continue;
        };
        let axis = |values: &[f64]| {
            let mut variant = variant(friction, Method::LeastSquares, &ordinary, 0.0, unknown);
            variant.values = values.to_vec();
            variant.axis(set.force_per_volt)
        };
        let instruments = controller
            .filter(|_| record.has_reference && !columns.one_way && ordinary.values[0] > 0.0)
            .and_then(|c| instruments(stamped, &axis(&ordinary.values), c, set, keep))
            .filter(|z| z.force.len() == columns.force.len());
        // What another sample of delay would change: nobody knows when within it a voltage acts.
        let pairs = columns.force.iter().zip(&columns.lag);
        let later: Vec<f64> = pairs.map(|(f, l)| f - l).collect();
        let speeds: Vec<f64> = columns.velocity.iter().map(|v| v.abs()).collect();
        let moving = SLOW * quantile(&speeds, 0.99);
        let noise = check::acceleration_noise(record, set);
        // The same columns without the delay: what it is to be compared with.
        let without = delayed.clone().remove_column(delayed.ncols() - 1);
        let Some(without) = least_squares(&without, &columns.force) else {
            continue;
        };
        let timing = least_squares(&x, &later).map(|s| s.values);
        let solve = |method: Method, rows: std::ops::Range<usize>| -> Option<Solution> {
            let x = if method == Method::Delayed {
                &delayed
            } else {
                &x
            };
            let part = x.rows(rows.start, rows.len()).into_owned();
            let force = &columns.force[rows.clone()];
            match method {
                Method::LeastSquares => least_squares(&part, force),
                // Where the axis sticks, force leads motion for another reason than a delay.
                Method::Delayed => {
                    let slides = |i: usize| columns.velocity[rows.start + i].abs() > moving;
                    let first = over(&part, force, slides)?;
                    let curve = &columns.curve[rows.clone()];
                    let held = held(first.values[first.values.len() - 1]);
                    let force: Vec<f64> =
                        force.iter().zip(curve).map(|(f, c)| f + held * c).collect();
                    let mut solution = over(&part, &force, slides)?;
                    without_attenuation(&part, slides, 0, noise, &mut solution);
                    Some(solution)
                }
                Method::Weighted => robust(&part, force),
                Method::Instrumental => {
                    let z = instruments.as_ref()?.matrix(friction, method);
                    let z = z.rows(rows.start, rows.len()).into_owned();
                    instrumental(&part, &z, force)
                }
            }
        };
        let late = solve(Method::Delayed, 0..columns.force.len()).and_then(|s| {
            let (samples, std) = s
                .values
                .last()
                .copied()
                .zip(s.std_correlated.last().copied())?;
            tells_delay(std, &s, &without).then_some(Late {
                samples,
                std,
                matters: samples.abs() > 5.0 * std
                    && s.relative_error_percent < LATE * ordinary.relative_error_percent,
            })
        });
        for method in Method::ALL {
            let n = columns.force.len();
            let Some(mut solution) = solve(method, 0..n) else {
                continue;
            };
            if let Some(timing) = timing.as_ref().filter(|_| method != Method::Delayed) {
                widen(&mut solution, timing, &ordinary.values, late);
            }
            let period = record.even.period;
            let mut found = variant(friction, method, &solution, period, unknown);
            found.tells_delay = method == Method::Delayed && late.is_some();
            found.validation_error_percent = if let Some(second) = second {
                (second.force.len() > 10).then(|| {
                    judged(
                        &second.matrix(friction, method),
                        &second.force,
                        &solution.values,
                    )
                })
            } else {
                let to = (FITTED * n as f64) as usize;
                solve(method, 0..to).map(|part| {
                    let x = [&x, &delayed][usize::from(method == Method::Delayed)];
                    let rest = x.rows(to, n - to).into_owned();
                    judged(&rest, &columns.force[to..], &part.values)
                })
            };
            variants.push(found);
        }
    }
    variants
}

/// By how much of its second difference a held force differs from `F - d (F - F before)`, its delay being `d` samples:
/// `d^2 / 2` of it is what a delay is to the second order, `d / 2` what the difference has of it already, and `1/24` what
/// a step that is held for a sample takes from what is fast.
fn held(delay: f64) -> f64 {
    0.5 * delay * (delay - 1.0) + 1.0 / 24.0
}

/// What values leave of a force, per cent.
fn judged(x: &DMatrix<f64>, force: &[f64], values: &[f64]) -> f64 {
    let prediction = x * nalgebra::DVector::from_column_slice(values);
    let pairs = force.iter().zip(prediction.iter());
    let residuals: Vec<f64> = pairs.map(|(a, b)| a - b).collect();
    relative(&residuals, force)
}

/// When a record shows its voltage to act, samples after it was taken.
#[derive(Debug, Clone, Copy)]
struct Late {
    samples: f64,
    std: f64,
    /// Whether what was found without it is off by more than chance.
    matters: bool,
}

/// Whether a record says when its voltage acts better than that it does so within a sample. What is found where the
/// axis slides has to tell all of it.
fn tells_delay(std: f64, delayed: &Solution, plain: &Solution) -> bool {
    std < WITHIN_A_SAMPLE
        && delayed.relative_error_percent < TELLS_ALL * plain.relative_error_percent
}

/// A voltage acts anywhere within a sample after the moment that was taken: by how much parameters are less sure
/// for it, those of a sample later being `later`. Where the record shows when it does, that is by how far they may be
/// off.
fn widen(solution: &mut Solution, later: &[f64], values: &[f64], late: Option<Late>) {
    // The root mean square of what is anywhere from none to one.
    let samples = late.map_or(1.0 / 3f64.sqrt(), |l| l.samples.hypot(l.std));
    for (j, (later, value)) in later.iter().zip(values).enumerate() {
        let by = samples * (later - value);
        let correlated = &mut solution.std_correlated[j];
        *correlated = correlated.hypot(by);
        if late.is_some_and(|l| l.matters) {
            solution.std[j] = solution.std[j].hypot(by);
        }
    }
}

fn variant(
    friction: Friction,
    method: Method,
    solution: &Solution,
    period: f64,
    unknown: &[Unknown],
) -> Variant {
    let mut values = solution.values.clone();
    let last = values.len() - 1;
    let delay = (method == Method::Delayed).then(|| {
        values.pop();
        Parameter {
            name: "voltage_delay",
            known: Some(Known {
                value: period * solution.values[last],
                std: period * solution.std[last],
                std_correlated: period * solution.std_correlated[last],
            }),
        }
    });
    let parameters = friction
        .names()
        .iter()
        .enumerate()
        .map(|(j, name)| Parameter {
            name,
            // Of an axis that moves one way there are fewer values than names.
            known: (j < values.len() && !unknown.iter().any(|u| u.covers(name))).then(|| Known {
                value: solution.values[j],
                std: solution.std[j],
                std_correlated: solution.std_correlated[j],
            }),
        })
        .chain(delay)
        .collect();
    Variant {
        friction,
        method,
        parameters,
        tells_delay: false,
        values: solution.values.clone(),
        condition: solution.condition,
        relative_error_percent: solution.relative_error_percent,
        validation_error_percent: None,
    }
}

/// The columns of the closed loop replayed: correlated with what is measured, not with its noise.
fn instruments(
    record: &Record,
    axis: &Axis,
    controller: &Controller,
    set: &Settings,
    keep: Option<&[bool]>,
) -> Option<Equations> {
    let mut equations = Equations::default();
    for stretch in &record.even.stretches {
        if stretch.columns[POSITION].len() < LEAST + set.skip {
            continue;
        }
        let prediction = replay::stretch(
            stretch,
            record.injected_column(),
            record.even.period,
            axis,
            &Sliding::Coulomb,
            controller,
        )?;
        equations.extend(
            stretch.start,
            record.even.period,
            &prediction.position,
            &prediction.voltage,
            set,
        );
    }
    if let Some(keep) = keep.filter(|k| k.len() == equations.force.len()) {
        equations.retain(keep);
    }
    Some(equations)
}

/// Replays a record's reference in closed loop, under a law of friction.
///
/// `None` for a record without reference, or where the replay runs away.
pub fn replay(
    record: &Record,
    axis: &Axis,
    law: &Sliding,
    controller: &Controller,
    set: &Settings,
) -> Option<Replay> {
    record
        .has_reference
        .then(|| replay::whole(&record.driven(set).0, axis, law, controller, set))
        .flatten()
}
