//! A record's equations: its columns filtered, differentiated and decimated alike.

use super::{Friction, LEAST, Method, POSITION, Record, Settings, VOLTAGE, other};
use nalgebra::DMatrix;
use pigtail_numerics::regression::{matrix, robust};
use pigtail_numerics::signal::{Lowpass, decimate, derivative, quantile, rms};

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

impl Equations {
    /// The columns of a position, an acceleration's and a velocity's own signs.
    pub(super) fn extend(
        &mut self,
        start: f64,
        period: f64,
        position: &[f64],
        force: &[f64],
        set: &Settings,
    ) {
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
        let ends = if set.settle { SETTLE.min(rows / 2) } else { 0 };
        let thin = |column: &[f64]| decimate(&column[skip..], factor)[ends..rows - ends].to_vec();
        let of = |f: fn(f64) -> f64| thin(&velocity.iter().map(|v| f(*v)).collect::<Vec<_>>());
        self.force.extend(thin(force));
        // About each sample: a difference to one side goes with the noise of a voltage that was measured, and a delay with it.
        let (before, behind) = (
            |k: usize| force[k] - force[k.saturating_sub(1)],
            |k: usize| force[(k + 1).min(n - 1)] - force[k],
        );
        let lag: Vec<f64> = (0..n).map(|k| 0.5 * (before(k) + behind(k))).collect();
        self.lag.extend(thin(&lag));
        let curve: Vec<f64> = (0..n).map(|k| behind(k) - before(k)).collect();
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

    pub(super) fn of(record: &Record, set: &Settings) -> Self {
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
        if let Some(place) = set.place.filter(|_| !equations.force.is_empty()) {
            other::taken_out(&mut equations, &place);
        }
        equations
    }

    /// Equations that are so far from all others that they would decide alone, if they are few.
    pub(super) fn apart(&self) -> Option<Vec<bool>> {
        let x = self.matrix(Friction::Asymmetric, Method::LeastSquares);
        let found = robust(&x, &self.force)?;
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
    let Some(found) = robust(&x, &equations.force) else {
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

/// Central differences over five samples: those over three make an acceleration too small by a third of the square of
/// the way that its sine turns between samples.
pub(super) fn rate(signal: &[f64], period: f64) -> Vec<f64> {
    let n = signal.len();
    let mut rate = derivative(signal, period);
    for k in 2..n.saturating_sub(2) {
        let (near, far) = (signal[k + 1] - signal[k - 1], signal[k + 2] - signal[k - 2]);
        rate[k] = (8.0 * near - far) / (12.0 * period);
    }
    rate
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
