//! The controller of a record, found in it: what made the voltage of reference and position.

use super::other::SURELY;
use super::{POSITION, REFERENCE, Record, VOLTAGE};
use crate::timeline::Stretch;
use nalgebra::DMatrix;
use pigtail_numerics::regression::{least_squares, least_squares_alone};
use pigtail_numerics::signal::rms;
use std::borrow::Cow;

/// A linear controller with a bound:
///
/// ```text
/// u = clamp(kp e + ki I + kd (d e_r - v) ...)
/// ```
///
/// where `e` is reference less position, `I` its integral, `v` the measured velocity as the controller
/// takes it and `r'` the reference's rate: `u = kp e + ki I + kf r' - kd v + bias`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Controller {
    /// V for a unit of position.
    pub kp: f64,
    /// V for a unit of position and a second.
    pub ki: f64,
    /// V for a unit of velocity.
    pub kd: f64,
    /// V for a unit of the reference's velocity.
    pub kf: f64,
    /// V.
    pub bias: f64,
    /// Bound of the voltage, V.
    pub limit: f64,
    /// Samples over which the velocity is taken.
    pub span: usize,
    /// Samples by which the voltage comes later than the position it was made of.
    pub delay: usize,
    /// How far it is from the record's voltage, per cent; zero for one that was given.
    pub error_percent: f64,
}

/// What a [`Controller`] remembers.
#[derive(Debug, Clone, Default)]
pub(super) struct State {
    positions: Vec<f64>,
    reference: Option<f64>,
    integral: f64,
    delayed: Vec<f64>,
}

impl Controller {
    /// A cascade of a position loop `kp` (1/s) and a velocity loop `kv` (V for a unit of velocity).
    pub fn cascade(kp: f64, kv: f64, limit: f64) -> Self {
        Self {
            kp: kp * kv,
            ki: 0.0,
            kd: kv,
            kf: 0.0,
            bias: 0.0,
            limit,
            span: 2,
            delay: 0,
            error_percent: 0.0,
        }
    }

    /// Velocity gain over which the others are gains of a cascade: position gain in 1/s.
    pub fn position_gain(&self) -> f64 {
        self.kp / self.kd
    }

    /// A controller that has always been where it is.
    pub(super) fn at(&self, position: f64, velocity: f64, period: f64) -> State {
        State {
            positions: (1..=self.span)
                .map(|k| position - velocity * period * k as f64)
                .collect(),
            ..State::default()
        }
    }

    /// The voltage of a cycle.
    pub(super) fn voltage(
        &self,
        state: &mut State,
        reference: f64,
        position: f64,
        period: f64,
    ) -> f64 {
        let error = reference - position;
        let before = state.positions[self.span - 1];
        let velocity = (position - before) / (self.span as f64 * period);
        state.positions.rotate_right(1);
        state.positions[0] = position;
        let rate = (reference - state.reference.unwrap_or(reference)) / period;
        state.reference = Some(reference);
        let bare = |integral: f64| {
            self.kp * error + self.ki * integral + self.kf * rate - self.kd * velocity + self.bias
        };
        let integral = state.integral + error * period;
        // The integral waits while the voltage is at its bound.
        if bare(integral).abs() <= self.limit {
            state.integral = integral;
        }
        let now = bare(state.integral).clamp(-self.limit, self.limit);
        state.delayed.push(now);
        if state.delayed.len() > self.delay {
            state.delayed.remove(0)
        } else {
            state.delayed[0]
        }
    }
}

/// Samples over which a velocity is taken, and by which a voltage comes later.
const KINDS: [(usize, usize); 4] = [(1, 0), (2, 0), (1, 1), (2, 1)];

/// Fits the kinds of controllers, the simplest first: a richer one must leave a tenth less.
pub(super) fn fit(record: &Record) -> Option<Controller> {
    if !record.has_reference {
        return None;
    }
    let limit = limit(record);
    // They are the same whatever of their columns is used, and to go over a long record is most of the work.
    let samples = KINDS.map(|(span, delay)| samples(record, limit, span, delay));
    let mut best: Option<Controller> = None;
    for (integral, feed, bias) in [
        (false, false, false),
        (false, true, false),
        (true, false, false),
        (true, true, false),
        (true, true, true),
    ] {
        for ((span, delay), samples) in KINDS.iter().zip(&samples) {
            let of = (limit, *span, *delay);
            let Some(found) = solve(samples, of, (integral, feed, bias)) else {
                continue;
            };
            if best.is_none_or(|b| found.error_percent < 0.9 * b.error_percent) {
                best = Some(found);
            }
        }
    }
    best
}

/// By how many times as much the position says as its controller sees, going by the reference, where a controller tells it: one acts on the
/// difference of the two, and of a position of another scale the voltage goes with the position itself as well. Asked for are a
/// hundredth, five deviations and half of the error that the `found` one leaves.
///
/// A controller with an integral does not tell it, and nothing else does: a position that its controller saw by the same scale, times
/// `s`, moves as one of an axis of `1/s` of inertia and viscous friction.
pub(super) fn scale(record: &Record, found: Option<&Controller>) -> Option<f64> {
    /// Per cent.
    const WELL: f64 = 1.0;
    let before = found.map_or(f64::INFINITY, |c| c.error_percent);
    if !record.has_reference || before < WELL {
        return None;
    }
    let limit = limit(record);
    let mut best: Option<(f64, f64)> = None;
    for (span, delay) in KINDS {
        let (rows, volts) = samples(record, limit, span, delay);
        for columns in [&[0, 5, 1, 4][..], &[0, 5, 1, 4, 2]] {
            let x = DMatrix::from_fn(rows.len(), columns.len(), |i, j| rows[i][columns[j]]);
            let Some(solution) = least_squares(&x, &volts) else {
                continue;
            };
            let (gain, more) = (solution.values[0], solution.values[1]);
            let error = solution.relative_error_percent;
            let scale = gain / (gain - more);
            let sure = more.abs() > SURELY * solution.std_correlated[1];
            let told = gain > 0.0 && scale > 0.0 && (scale - 1.0).abs() > 0.01 && sure;
            if told && error < best.map_or((0.5 * before).min(10.0), |b| 0.9 * b.0) {
                best = Some((error, scale));
            }
        }
    }
    best.map(|(_, scale)| scale)
}

/// The voltage beyond which none is: a bound if it is met again and again, else none.
fn limit(record: &Record) -> f64 {
    let stretches = record.even().stretches.iter();
    let own: Vec<Cow<[f64]>> = stretches.map(|s| by_itself(record, s)).collect();
    let volts = || own.iter().flat_map(|s| s.iter());
    let most = volts().fold(0.0_f64, |m, u| m.max(u.abs()));
    let at = volts().filter(|u| u.abs() > (1.0 - 1e-6) * most).count();
    if at > 3 { most } else { f64::INFINITY }
}

/// The controller's own voltage: without what was injected.
fn by_itself<'s>(record: &Record, stretch: &'s Stretch) -> Cow<'s, [f64]> {
    let own = &stretch.columns[VOLTAGE];
    let Some(column) = record.injected_column() else {
        return Cow::Borrowed(own);
    };
    let pairs = own.iter().zip(&stretch.columns[column]);
    pairs.map(|(u, added)| u - added).collect()
}

/// So many neighbours are taken together, their mean: noise of a record that its controller did not see, as another
/// sensor's, makes a velocity over more samples look truer than the controller's own.
const TOGETHER: usize = 8;

/// What a controller sees, and the voltages that it gives.
type Samples = (Vec<[f64; 6]>, Vec<f64>);

fn samples(record: &Record, limit: f64, span: usize, delay: usize) -> Samples {
    // More rows would say nothing new of five gains.
    const ROWS: usize = 50_000;
    let period = record.even().period;
    let every = record.even().samples().div_ceil(ROWS * TOGETHER).max(1);
    let mut rows: Vec<[f64; 6]> = Vec::new();
    let mut volts = Vec::new();
    for stretch in &record.even().stretches {
        let u = by_itself(record, stretch);
        let (q, r) = (&stretch.columns[POSITION], &stretch.columns[REFERENCE]);
        let mut integral = 0.0;
        let (mut sum, mut sum_volts, mut count) = ([0.0; 6], 0.0, 0);
        for k in span.max(1)..q.len() {
            integral += (r[k] - q[k]) * period;
            let Some(voltage) = u.get(k + delay) else {
                break;
            };
            if voltage.abs() > (1.0 - 1e-6) * limit {
                (sum, sum_volts, count) = ([0.0; 6], 0.0, 0);
                continue;
            }
            let row = [
                r[k] - q[k],
                -(q[k] - q[k - span]) / (span as f64 * period),
                (r[k] - r[k - 1]) / period,
                integral,
                1.0,
                q[k] - q[0],
            ];
            for (sum, value) in sum.iter_mut().zip(row) {
                *sum += value / TOGETHER as f64;
            }
            sum_volts += voltage / TOGETHER as f64;
            count += 1;
            if count == TOGETHER {
                if (k / TOGETHER).is_multiple_of(every) {
                    rows.push(sum);
                    volts.push(sum_volts);
                }
                (sum, sum_volts, count) = ([0.0; 6], 0.0, 0);
            }
        }
    }
    (rows, volts)
}

fn solve(
    (rows, volts): &Samples,
    (limit, span, delay): (f64, usize, usize),
    (with_integral, feed, with_bias): (bool, bool, bool),
) -> Option<Controller> {
    let mut used = vec![0, 1];
    if feed {
        used.push(2);
    }
    if with_integral {
        used.push(3);
    }
    if with_bias {
        used.push(4);
    }
    let x = DMatrix::from_fn(rows.len(), used.len(), |i, j| rows[i][used[j]]);
    let solution = least_squares_alone(&x, volts)?;
    let gain = |column: usize| {
        used.iter()
            .position(|u| *u == column)
            .map_or(0.0, |j| solution.values[j])
    };
    let (kp, kd) = (gain(0), gain(1));
    if !(kp > 0.0 && kd >= 0.0 && rms(volts.iter().copied()) > 0.0) {
        return None;
    }
    Some(Controller {
        kp,
        ki: gain(3),
        kd,
        kf: gain(2),
        bias: gain(4),
        limit,
        span,
        delay,
        error_percent: solution.relative_error_percent,
    })
}
