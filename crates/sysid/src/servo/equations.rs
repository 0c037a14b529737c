//! A record's equations: its columns filtered, differentiated and decimated alike.

use super::{Friction, LEAST, Method, POSITION, Record, Settings, VOLTAGE, check, other};
use nalgebra::DMatrix;
use pigtail_numerics::regression::{matrix, robust_alone};
use pigtail_numerics::signal::{Lowpass, decimate_beside, quantile, rms};
use std::borrow::Cow;

/// Equations left out at either end of a stretch where what they leave stands apart from what the others do: filters settle
/// within some ten periods of their cutoff, and so far they are apart.
const SETTLE: usize = 10;

/// By how many times more the ends leave where they stand apart.
const UNSETTLED: f64 = 1.5;

/// An equation misses by so many of the usual standard deviations where it stands apart, and so large a share of
/// them may.
pub(super) const APART: f64 = 15.0;
const FEW: f64 = 0.01;

/// The equations' columns.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Equations {
    pub(super) time: Vec<f64>,
    pub(super) force: Vec<f64>,
    /// By how much the force would be less if it came a sample later.
    pub(super) lag: Vec<f64>,
    /// Its second difference: what a delay changes to the second order.
    pub(super) curve: Vec<f64>,
    pub(super) position: Vec<f64>,
    pub(super) acceleration: Vec<f64>,
    /// The acceleration by differences over five samples.
    pub(super) exact: Vec<f64>,
    pub(super) velocity: Vec<f64>,
    pub(super) sign: Vec<f64>,
    /// Ones, decimated like the rest: the filter's gain is in them too.
    pub(super) one: Vec<f64>,
    pub(super) forward: [Vec<f64>; 2],
    pub(super) backward: [Vec<f64>; 2],
    /// Whether it moves one way only: the sign is then no column of its own.
    pub(super) one_way: bool,
    /// What the force is told from, where what goes with the place is taken out of it.
    pub(super) told: Option<Box<Self>>,
}

/// What a record's positions say, filtered and decimated: the same whatever a voltage is moved by, and most of the work of its equations.
#[derive(Debug)]
pub(super) struct Moved {
    /// The columns of each stretch that is long enough, by its place among all; those of a force are empty, and their ends are there.
    parts: Vec<(usize, Equations)>,
    /// Time between samples, seconds.
    pub(super) period: f64,
    /// Standard deviation of a position's noise, taken as white, m or rad.
    pub(super) white: f64,
}

impl Moved {
    pub(super) fn of(record: &Record, set: &Settings) -> Self {
        let period = record.even.period;
        let parts = record
            .even
            .stretches
            .iter()
            .enumerate()
            .filter(|(_, s)| s.columns[POSITION].len() >= LEAST + set.skip)
            .map(|(k, s)| {
                (
                    k,
                    Equations::moving(s.start, period, &s.columns[POSITION], set),
                )
            })
            .collect();
        Self {
            parts,
            period,
            white: check::white(record, set),
        }
    }

    /// The equations of these positions with a record's voltages.
    pub(super) fn equations(&self, record: &Record, set: &Settings) -> Equations {
        self.equations_of(
            |k| Cow::Borrowed(&record.even.stretches[k].columns[VOLTAGE]),
            set,
        )
    }

    /// The same with the voltages of each stretch by its place.
    pub(super) fn equations_of<'r>(
        &self,
        volts: impl Fn(usize) -> Cow<'r, [f64]>,
        set: &Settings,
    ) -> Equations {
        let mut equations = Equations::default();
        for (k, moving) in &self.parts {
            equations.extend(moving, &volts(*k), self.period, set);
        }
        if let Some(place) = set.place.filter(|_| !equations.force.is_empty()) {
            other::taken_out(&mut equations, &place);
        }
        equations
    }
}

impl Equations {
    /// The columns of a position, an acceleration's and a velocity's own signs, with their ends and without a force.
    pub(super) fn moving(start: f64, period: f64, position: &[f64], set: &Settings) -> Self {
        let n = position.len();
        let filter = Lowpass::butterworth(set.order, 2.0 * period * set.cutoff(period));
        let smooth = filter.both_ways(position);
        let place = |k: usize| smooth[k];
        let velocity = |k: usize| central(place, n, period, k);
        let acceleration = |k: usize| central(velocity, n, period, k);
        let exact = |k: usize| fine(|k| fine(place, n, period, k), n, period, k);
        let (factor, skip) = (set.factor(period), set.skip.min(n));
        let rows = n - skip;
        let [position, velocities] =
            decimate_beside(rows, factor, |k| [place(skip + k), velocity(skip + k)]);
        let [accelerations, exact] =
            decimate_beside(rows, factor, |k| [acceleration(skip + k), exact(skip + k)]);
        let [signs, one] = decimate_beside(rows, factor, |k| [sign(velocity(skip + k)), 1.0]);
        let forward = decimate_beside(rows, factor, |k| {
            let v = velocity(skip + k);
            [v.max(0.0), sign(v).max(0.0)]
        });
        let backward = decimate_beside(rows, factor, |k| {
            let v = velocity(skip + k);
            [v.min(0.0), sign(v).min(0.0)]
        });
        let first = skip + (rows + factor - 1) % factor;
        Self {
            time: (0..position.len())
                .map(|k| start + period * (first + k * factor) as f64)
                .collect(),
            position,
            velocity: velocities,
            acceleration: accelerations,
            exact,
            sign: signs,
            one,
            forward,
            backward,
            ..Self::default()
        }
    }

    /// Appends a stretch's columns and those of its voltage.
    pub(super) fn extend(&mut self, moving: &Self, volts: &[f64], period: f64, set: &Settings) {
        let n = volts.len();
        let (factor, skip) = (set.factor(period), set.skip.min(n));
        let rows = moving.time.len();
        // The filters of position and decimation settle at the ends: what is there is theirs.
        let ends = if set.settle { SETTLE.min(rows / 2) } else { 0 };
        let force = |k: usize| set.force_per_volt * volts[k];
        // About each sample: a difference to one side goes with the noise of a voltage that was measured, and a delay with it.
        let own = decimate_beside(n - skip, factor, |k| {
            let k = k + skip;
            let now = force(k);
            let before = now - force(k.saturating_sub(1));
            let behind = force((k + 1).min(n - 1)) - now;
            [now, 0.5 * (before + behind), behind - before]
        });
        for (all, own) in [&mut self.force, &mut self.lag, &mut self.curve]
            .into_iter()
            .zip(&own)
        {
            all.extend_from_slice(&own[ends..rows - ends]);
        }
        let [f0, f1] = &mut self.forward;
        let [b0, b1] = &mut self.backward;
        for (all, own) in [
            (&mut self.time, &moving.time),
            (&mut self.position, &moving.position),
            (&mut self.velocity, &moving.velocity),
            (&mut self.acceleration, &moving.acceleration),
            (&mut self.exact, &moving.exact),
            (&mut self.sign, &moving.sign),
            (&mut self.one, &moving.one),
            (f0, &moving.forward[0]),
            (f1, &moving.forward[1]),
            (b0, &moving.backward[0]),
            (b1, &moving.backward[1]),
        ] {
            all.extend_from_slice(&own[ends..rows - ends]);
        }
    }

    pub(super) fn of(record: &Record, set: &Settings) -> Self {
        Moved::of(record, set).equations(record, set)
    }

    /// Equations that are so far from all others that they would decide alone, if they are few.
    pub(super) fn apart(&self) -> Option<Vec<bool>> {
        let x = self.matrix(Friction::Asymmetric, Method::LeastSquares);
        let found = robust_alone(&x, &self.force)?;
        let sizes: Vec<f64> = found.residuals.iter().map(|r| r.abs()).collect();
        let far = APART * 1.4826 * quantile(&sizes, 0.5);
        let count = sizes.iter().filter(|s| **s > far).count();
        let few = count > 0 && count as f64 <= FEW * sizes.len() as f64;
        few.then(|| sizes.iter().map(|s| *s <= far).collect())
    }

    /// Leaves out what is not to be believed.
    pub(super) fn retain(&mut self, keep: &[bool]) {
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
            told,
        } = self;
        if let Some(told) = told {
            told.retain(keep);
        }
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

    /// The columns that parameters multiply.
    pub(super) fn regressors_mut(&mut self) -> [&mut Vec<f64>; 10] {
        let Self {
            acceleration,
            exact,
            velocity,
            sign,
            one,
            forward: [f0, f1],
            backward: [b0, b1],
            lag,
            ..
        } = self;
        [
            acceleration,
            exact,
            velocity,
            sign,
            one,
            f0,
            f1,
            b0,
            b1,
            lag,
        ]
    }

    fn columns(&self, friction: Friction, one_way: bool) -> Vec<&[f64]> {
        match friction {
            // Coulomb friction and offset in one column, which stands where Coulomb friction does.
            Friction::Symmetric if one_way => {
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

    pub(super) fn matrix(&self, friction: Friction, method: Method) -> DMatrix<f64> {
        let told = self.told.as_deref().unwrap_or(self);
        let mut columns = told.columns(friction, self.one_way);
        if method == Method::Delayed {
            columns[0] = &told.exact;
            columns.push(&told.lag);
        }
        matrix(&columns)
    }
}

/// Whether filters still settle at the ends of the stretches: what the equations there leave is more than what the others
/// do. At rest and at one speed there is nothing to settle from, and they are as good as any.
pub(super) fn unsettled(equations: &Equations) -> bool {
    let n = equations.force.len();
    let x = equations.matrix(Friction::Asymmetric, Method::LeastSquares);
    let Some(found) = robust_alone(&x, &equations.force) else {
        return false;
    };
    // A gap is longer than the equations are apart.
    let step = quantile(
        &equations
            .time
            .windows(2)
            .map(|w| w[1] - w[0])
            .collect::<Vec<f64>>(),
        0.5,
    );
    let near = |k: usize| {
        let gap = |a: usize, b: usize| equations.time[b] - equations.time[a] > 1.5 * step;
        (k.saturating_sub(SETTLE)..(k + SETTLE).min(n - 1)).any(|i| gap(i, i + 1))
            || k < SETTLE
            || k + SETTLE >= n
    };
    let part = |ends: bool| {
        rms((0..n)
            .filter(|k| near(*k) == ends)
            .map(|k| found.residuals[k]))
    };
    let (ends, others) = (part(true), part(false));
    ends > UNSETTLED * others
}

/// Central differences of a signal of so many samples, at one of them; the ends repeat their neighbours.
fn central(signal: impl Fn(usize) -> f64, n: usize, period: f64, k: usize) -> f64 {
    let k = k.clamp(1, n - 2);
    (signal(k + 1) - signal(k - 1)) / (2.0 * period)
}

/// Central differences over five samples: those over three make an acceleration too small by a third of the square of
/// the way that its sine turns between samples.
fn fine(signal: impl Fn(usize) -> f64, n: usize, period: f64, k: usize) -> f64 {
    if k < 2 || k + 2 >= n {
        return central(signal, n, period, k);
    }
    let (near, far) = (signal(k + 1) - signal(k - 1), signal(k + 2) - signal(k - 2));
    (8.0 * near - far) / (12.0 * period)
}

/// The same of a whole signal.
pub(super) fn rate(signal: &[f64], period: f64) -> Vec<f64> {
    let n = signal.len();
    (0..n).map(|k| fine(|k| signal[k], n, period, k)).collect()
}

pub(super) fn sign(v: f64) -> f64 {
    if v > 0.0 {
        1.0
    } else if v < 0.0 {
        -1.0
    } else {
        0.0
    }
}
