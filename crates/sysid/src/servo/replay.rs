//! The closed loop replayed: a record's reference, an identified axis and its controller.

use super::controller::Controller;
use super::sliding::{Moving, Sliding};
use super::{POSITION, REFERENCE, Record, Settings, VOLTAGE};
use crate::timeline::Stretch;
use pigtail_numerics::signal::{Lowpass, derivative};

/// An axis that moves: `M v' = K u - c - F_v v - F_c sgn(v)`, each direction with its own friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Force or torque of a volt, N/V or N m/V.
    pub force_per_volt: f64,
    /// Inertia, kg or kg m^2.
    pub inertia: f64,
    /// Viscous friction forward and backward, N s/m or N m s/rad.
    pub viscous: [f64; 2],
    /// Coulomb friction forward and backward, N or N m.
    pub coulomb: [f64; 2],
    /// Offset, N or N m.
    pub offset: f64,
}

impl Axis {
    /// Position and velocity after `duration` seconds under a held voltage, exactly: between standing
    /// still and standing still again the equation of motion is linear.
    pub fn advance(&self, (mut x, mut v): (f64, f64), voltage: f64, duration: f64) -> (f64, f64) {
        let force = self.force_per_volt * voltage - self.offset;
        let mut left = duration;
        // It stands still at most once and turns round at most once under one voltage.
        for _ in 0..4 {
            let forward = if v == 0.0 {
                if force > self.coulomb[0] {
                    true
                } else if force < -self.coulomb[1] {
                    false
                } else {
                    return (x, 0.0);
                }
            } else {
                v > 0.0
            };
            let side = usize::from(!forward);
            let sign = if forward { 1.0 } else { -1.0 };
            let pull = (force - sign * self.coulomb[side]) / self.inertia;
            let decay = self.viscous[side] / self.inertia;
            let stop = stop_after(v, pull, decay).filter(|t| *t < left && v != 0.0);
            let time = stop.unwrap_or(left);
            let (dx, end) = glide(v, pull, decay, time);
            x += dx;
            v = if stop.is_some() { 0.0 } else { end };
            left -= time;
            if left <= 0.0 {
                break;
            }
        }
        (x, v)
    }
}

/// Way and final velocity of `v' = pull - decay v`.
fn glide(v: f64, pull: f64, decay: f64, time: f64) -> (f64, f64) {
    let z = decay * time;
    if z.abs() < 1e-6 {
        let end = v + (pull - decay * v) * time;
        return (0.5 * (v + end) * time, end);
    }
    let settled = pull / decay;
    let left = (-z).exp();
    (
        settled * time + (v - settled) * (1.0 - left) / decay,
        settled + (v - settled) * left,
    )
}

/// When `v' = pull - decay v` reaches zero.
fn stop_after(v: f64, pull: f64, decay: f64) -> Option<f64> {
    if v * pull >= 0.0 {
        return None;
    }
    let z = -decay * v / pull;
    Some(if z.abs() < 1e-9 {
        -v / pull
    } else if z > -1.0 {
        z.ln_1p() / decay
    } else {
        return None;
    })
}

/// A stretch replayed.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Prediction {
    pub(super) position: Vec<f64>,
    pub(super) voltage: Vec<f64>,
}

/// Velocity at a stretch's first sample: with it the recorded voltage takes the axis through the next ones. An axis that
/// a controller has just been switched on for leaps from there, and a mean over these samples would be half of that leap.
fn at_first(stretch: &Stretch, period: f64, axis: &Axis) -> f64 {
    const SAMPLES: usize = 20;
    const ROUNDS: usize = 6;
    let measured = &stretch.columns[POSITION];
    let n = SAMPLES.min(measured.len() - 1);
    let way = |velocity: f64| -> Vec<f64> {
        let mut state = (measured[0], velocity);
        let steps = stretch.columns[VOLTAGE][..n].iter();
        steps
            .map(|u| {
                state = axis.advance(state, *u, period);
                state.0
            })
            .collect()
    };
    // Less their means: the first position has its own noise.
    let centred = |mut v: Vec<f64>| {
        let mean = v.iter().sum::<f64>() / v.len().max(1) as f64;
        for v in &mut v {
            *v -= mean;
        }
        v
    };
    let mean = (measured[n] - measured[0]) / (n.max(1) as f64 * period);
    let fastest = measured
        .windows(2)
        .map(|w| (w[1] - w[0]).abs() / period)
        .fold(0.0, f64::max);
    let step = 1e-4 * fastest;
    let mut velocity = mean;
    for _ in 0..ROUNDS {
        let (base, moved) = (way(velocity), way(velocity + step));
        let left = centred(
            measured[1..=n]
                .iter()
                .zip(&base)
                .map(|(q, b)| q - b)
                .collect(),
        );
        let slope = centred(
            moved
                .iter()
                .zip(&base)
                .map(|(m, b)| (m - b) / step)
                .collect(),
        );
        let power: f64 = slope.iter().map(|s| s * s).sum();
        let by = slope.iter().zip(&left).map(|(s, l)| s * l).sum::<f64>() / power;
        if !by.is_finite() {
            break;
        }
        velocity = (velocity + by).clamp(-fastest, fastest);
    }
    velocity
}

/// `None` where it runs away.
pub(super) fn stretch(
    stretch: &Stretch,
    injected: Option<usize>,
    period: f64,
    axis: &Axis,
    law: &Sliding,
    controller: &Controller,
) -> Option<Prediction> {
    let (measured, reference) = (&stretch.columns[POSITION], &stretch.columns[REFERENCE]);
    let n = measured.len();
    let velocity = at_first(stretch, period, axis);
    let mut moving = Moving::new(axis, law, measured[0], velocity);
    let mut state = controller.at(measured[0], velocity, period);
    let mut prediction = Prediction {
        position: Vec::with_capacity(n),
        voltage: Vec::with_capacity(n),
    };
    let reach = 100.0 * measured.iter().fold(1e-9_f64, |m, q| m.max(q.abs()));
    for (k, r) in reference.iter().enumerate() {
        let seen = moving.output();
        let added = injected.map_or(0.0, |column| stretch.columns[column][k]);
        let voltage = controller.voltage(&mut state, *r, seen, period) + added;
        prediction.position.push(seen);
        prediction.voltage.push(voltage);
        moving.advance(voltage, period);
        if seen.is_nan() || seen.abs() > reach {
            return None;
        }
    }
    Some(prediction)
}

/// A record's reference in closed loop, beside the record.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Replay {
    /// Seconds.
    pub time: Vec<f64>,
    /// Reference, measured and replayed position, m or rad.
    pub position: [Vec<f64>; 3],
    /// Measured and replayed velocity, from positions filtered alike.
    pub velocity: [Vec<f64>; 2],
    /// Measured and replayed voltage, V.
    pub voltage: [Vec<f64>; 2],
    /// Norm of the velocity's error over the norm of the velocity, per cent.
    pub velocity_error_percent: f64,
    /// The same of the force.
    pub force_error_percent: f64,
    /// The same of the position.
    pub position_error_percent: f64,
}

/// How far one column is from another: squares of the difference and of the first one, and of how many.
#[derive(Debug, Clone, Copy, Default)]
struct Error {
    left: f64,
    own: f64,
    count: f64,
}

impl Error {
    fn see(&mut self, own: f64, other: f64) {
        self.left += (own - other).powi(2);
        self.own += own * own;
        self.count += 1.0;
    }

    /// Norm of the difference over the norm of the first, per cent.
    fn percent(&self) -> f64 {
        let count = self.count.max(1.0);
        100.0 * (self.left / count).sqrt() / (self.own / count).sqrt().max(f64::MIN_POSITIVE)
    }
}

pub(super) fn whole(
    record: &Record,
    axis: &Axis,
    law: &Sliding,
    controller: &Controller,
    (set, rows): (&Settings, usize),
) -> Option<Replay> {
    let period = record.even().period;
    let every = record.even().samples().div_ceil(rows).max(1);
    let [mut velocities, mut forces, mut positions] = [Error::default(); 3];
    let filter = Lowpass::butterworth(set.order, 2.0 * period * set.cutoff(period));
    let mut replay = Replay::default();
    for part in &record.even().stretches {
        let n = part.columns[POSITION].len();
        if n < super::LEAST + set.skip {
            continue;
        }
        let prediction = stretch(
            part,
            record.injected_column(),
            period,
            axis,
            law,
            controller,
        )?;
        let velocity = |q: &[f64]| derivative(&filter.both_ways(q), period);
        let (position, voltage) = (&part.columns[POSITION], &part.columns[VOLTAGE]);
        let speed = [velocity(position), velocity(&prediction.position)];
        for k in set.skip..n {
            velocities.see(speed[0][k], speed[1][k]);
            forces.see(voltage[k], prediction.voltage[k]);
            positions.see(position[k], prediction.position[k]);
        }
        let kept = (set.skip..n).step_by(every);
        let of = |all: &mut Vec<f64>, own: &[f64]| all.extend(kept.clone().map(|k| own[k]));
        let time = kept.clone().map(|k| part.start + k as f64 * period);
        replay.time.extend(time);
        let [reference, measured, replayed] = &mut replay.position;
        of(reference, &part.columns[REFERENCE]);
        of(measured, position);
        of(replayed, &prediction.position);
        for (all, own) in replay.velocity.iter_mut().zip(&speed) {
            of(all, own);
        }
        for (all, own) in replay
            .voltage
            .iter_mut()
            .zip([voltage, &prediction.voltage])
        {
            of(all, own);
        }
    }
    replay.velocity_error_percent = velocities.percent();
    replay.force_error_percent = forces.percent();
    replay.position_error_percent = positions.percent();
    (!replay.time.is_empty()).then_some(replay)
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: Axis = Axis {
        force_per_volt: 2.0,
        inertia: 0.5,
        viscous: [3.0, 4.0],
        coulomb: [0.2, 0.3],
        offset: 0.1,
    };

    /// Against small steps of Heun's scheme, through standstill and back.
    #[test]
    fn exact_steps_are_the_limit_of_small_ones() {
        let mut exact = (0.0, 0.0);
        let (mut x, mut v) = (0.0, 0.0_f64);
        for k in 0..400 {
            let u = (0.1 * f64::from(k)).sin() * 0.8;
            exact = AXIS.advance(exact, u, 0.01);
            for _ in 0..2000 {
                (x, v) = AXIS.advance((x, v), u, 0.01 / 2000.0);
            }
            assert!(
                (exact.0 - x).abs() < 1e-9 && (exact.1 - v).abs() < 1e-9,
                "{k}"
            );
        }
        // And what they are the limit of: the equation of motion.
        let (h, v0) = (1e-6, 0.07);
        let (_, v1) = AXIS.advance((0.0, v0), 0.5, h);
        let exact = (2.0 * 0.5 - 0.1 - 0.2 - 3.0 * v0) / 0.5;
        assert!(((v1 - v0) / h - exact).abs() < 1e-4);
    }

    #[test]
    fn friction_holds_what_is_not_pushed_hard_enough() {
        assert_eq!(AXIS.advance((1.0, 0.0), 0.14, 1.0), (1.0, 0.0));
        assert_eq!(AXIS.advance((1.0, 0.0), -0.09, 1.0), (1.0, 0.0));
        assert!(AXIS.advance((1.0, 0.0), 0.16, 1.0).1 > 0.0);
        assert!(AXIS.advance((1.0, 0.0), -0.11, 1.0).1 < 0.0);
        let (x, v) = AXIS.advance((0.0, 0.1), 0.05, 10.0);
        assert!(v == 0.0 && x > 0.0);
    }
}
