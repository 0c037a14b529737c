//! How far a pulse moves the output, as far as is known: fixed, or estimated while pulses are played.

use super::belief::ImpulseBelief;
use nalgebra::{DMatrix, DVector};

/// Knots at which a response is estimated.
const KNOTS: usize = 13;

/// What is known of a response before the first pulse of a run, as shares of it: its gain, and its
/// displacement as a whole, of what it is at twice the voltage at which the motor breaks away. Load
/// friction that is 10 % off moves a z-stage's response by a quarter of that and scales a five-bar's
/// by 12 %.
const PRIOR_GAIN: f64 = 0.15;
const PRIOR_SHIFT: f64 = 0.25;
/// A bend besides, of the same scale, that goes over so many break-away voltages.
const PRIOR_BEND: f64 = 0.05;
const BEND_LENGTH: f64 = 1.0;
/// How much the two directions have in common of all that.
const COMMON: f64 = 0.8;
/// Share of what was not known at first that comes to be unknown again with each pulse: friction
/// drifts.
const FORGET: f64 = 0.03;
/// As many pulses as what is believed of the scatter counts for.
const SCATTER_WEIGHT: f64 = 4.0;

/// A response to pulses.
#[derive(Debug, Clone, PartialEq)]
pub enum Response {
    /// The thesis's parabola (4.8).
    Parabola(Parabola),
    /// The curve as it was measured.
    Curve(Curve),
    /// The curve, corrected by every pulse.
    Recursive(Box<Recursive>),
}

/// `delta = b a_1^2` (4.8), up to the highest amplitude that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parabola {
    /// `b`, metres for a square volt.
    pub b: f64,
    /// The highest `a_1`, volts.
    pub most: f64,
}

/// A rising curve through points, straight between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Volts and metres.
    points: Vec<[f64; 2]>,
}

/// An amplitude for a wanted displacement, and what it is expected to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// `a_1`, volts.
    pub a1: f64,
    /// Displacement in the direction of the pulse, metres.
    pub expected: f64,
}

impl Response {
    /// The names by which a user calls them.
    pub const NAMES: [&'static str; 3] = ["parabola", "curve", "recursive"];

    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Parabola(_) => Self::NAMES[0],
            Self::Curve(_) => Self::NAMES[1],
            Self::Recursive(_) => Self::NAMES[2],
        }
    }

    /// The parabola through what is believed.
    pub fn parabola(belief: &ImpulseBelief) -> Self {
        let (a1, d): (Vec<f64>, Vec<f64>) = belief.curve.iter().map(|[a, d]| (*a, *d)).unzip();
        let (b, _) = super::experiment::parabola(&a1, &d);
        let most = a1.last().copied().unwrap_or(0.0);
        Self::Parabola(Parabola { b, most })
    }

    /// The curve as it is believed.
    pub fn curve(belief: &ImpulseBelief) -> Self {
        Self::Curve(Curve {
            points: belief.curve.clone(),
        })
    }

    /// The curve as it is believed at first; `noise` is the error of a measured displacement, metres
    /// rms.
    pub fn recursive(belief: &ImpulseBelief, noise: f64) -> Self {
        Self::Recursive(Box::new(Recursive::new(belief, noise)))
    }

    /// The amplitude for an `error` (metres, zero or more) with a gain `k_c` (4.10). The recursive
    /// estimate takes as much of it as its uncertainty bears.
    pub fn choose(&self, error: f64, gain: f64, forward: bool) -> Choice {
        match self {
            Self::Parabola(p) => {
                let a1 = (gain * error / p.b).sqrt().min(p.most);
                let expected = p.b * a1 * a1;
                Choice { a1, expected }
            }
            Self::Curve(curve) => curve.inverse(gain * error),
            Self::Recursive(estimate) => estimate.choose(gain * error, forward),
        }
    }

    /// Takes note of what a pulse did: displacement in its direction, metres.
    pub fn learn(&mut self, a1: f64, forward: bool, moved: f64) {
        if let Self::Recursive(estimate) = self {
            estimate.learn(a1, forward, moved);
        }
    }
}

impl Curve {
    /// The amplitude at which the curve reaches a displacement, or its end.
    fn inverse(&self, wanted: f64) -> Choice {
        for pair in self.points.windows(2) {
            let ([a, d], [b, e]) = (pair[0], pair[1]);
            if wanted < e {
                let share = if e > d {
                    ((wanted - d) / (e - d)).max(0.0)
                } else {
                    0.0
                };
                return Choice {
                    a1: a + share * (b - a),
                    expected: d + share * (e - d),
                };
            }
        }
        let [a1, expected] = self.points.last().copied().unwrap_or([0.0; 2]);
        Choice { a1, expected }
    }

    fn at(&self, a1: f64) -> f64 {
        for pair in self.points.windows(2) {
            let ([a, d], [b, e]) = (pair[0], pair[1]);
            if a1 <= b {
                return d + (e - d) * ((a1 - a) / (b - a)).max(0.0);
            }
        }
        self.points.last().map_or(0.0, |last| last[1])
    }
}

/// A Kalman filter of the response at some amplitudes, in both directions.
///
/// What it estimates is the displacement where that is above zero, and goes on below zero in the dead
/// zone, as straight as the response comes out of it: friction that is higher than believed then moves
/// the whole of it down, which the first pulses show. At first it knows the believed curve but for a
/// gain, a shift and a bend, most of which both directions have in common; with each pulse some of
/// that comes to be unknown again. How much displacements scatter is learnt from what they surprise by.
#[derive(Debug, Clone, PartialEq)]
pub struct Recursive {
    knots: Vec<f64>,
    /// Forward, then backward, metres.
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    forget: DMatrix<f64>,
    /// Variance of a displacement beside what is not known of the response, square metres.
    scatter: f64,
    weight: f64,
    /// Least variance: that of the measurement.
    noise: f64,
}

impl Recursive {
    fn new(belief: &ImpulseBelief, noise: f64) -> Self {
        let curve = Curve {
            points: belief.curve.clone(),
        };
        let most = belief.curve.last().map_or(0.0, |last| last[0]);
        // Denser where pulses are small, as the last ones are.
        let knots: Vec<f64> = (0..KNOTS)
            .map(|k| most * (k as f64 / (KNOTS - 1) as f64).powf(1.5))
            .collect();
        let latent = straightened(&curve, &knots, 1.5 * belief.unit);
        let scale = curve.at(2.0 * belief.unit);
        let one = |i: usize, j: usize| {
            let apart = (knots[i] - knots[j]) / (BEND_LENGTH * belief.unit);
            PRIOR_GAIN.powi(2) * latent[i] * latent[j]
                + (PRIOR_SHIFT * scale).powi(2)
                + (PRIOR_BEND * scale).powi(2) * (-0.5 * apart * apart).exp()
        };
        let covariance = DMatrix::from_fn(2 * KNOTS, 2 * KNOTS, |i, j| {
            let same = i / KNOTS == j / KNOTS;
            one(i % KNOTS, j % KNOTS) * if same { 1.0 } else { COMMON }
        });
        let noise = noise * noise;
        Self {
            mean: DVector::from_fn(2 * KNOTS, |i, _| latent[i % KNOTS]),
            forget: FORGET * &covariance,
            covariance,
            knots,
            scatter: belief.scatter.powi(2) + noise,
            weight: SCATTER_WEIGHT,
            noise,
        }
    }

    /// The two knots beside an amplitude and their shares.
    fn shares(&self, a1: f64, forward: bool) -> [(usize, f64); 2] {
        let last = self.knots.len() - 1;
        let right = self
            .knots
            .iter()
            .position(|knot| *knot > a1)
            .unwrap_or(last)
            .max(1);
        let (low, high) = (self.knots[right - 1], self.knots[right]);
        let share = ((a1 - low) / (high - low)).clamp(0.0, 1.0);
        let offset = if forward { 0 } else { self.knots.len() };
        [(offset + right - 1, 1.0 - share), (offset + right, share)]
    }

    /// Mean and variance of the estimate at an amplitude, below zero in the dead zone.
    fn predict(&self, a1: f64, forward: bool) -> (f64, f64) {
        let shares = self.shares(a1, forward);
        let mean = shares.iter().map(|(i, w)| w * self.mean[*i]).sum();
        let mut variance = 0.0;
        for (i, v) in shares {
            for (j, w) in shares {
                variance += v * w * self.covariance[(i, j)];
            }
        }
        (mean, variance)
    }

    /// The amplitude that is expected to leave the least square of the error: a displacement that is
    /// not well known is asked for less.
    fn choose(&self, error: f64, forward: bool) -> Choice {
        const STEPS: usize = 240;
        let most = self.knots.last().copied().unwrap_or(0.0);
        let mut best = (
            f64::INFINITY,
            Choice {
                a1: 0.0,
                expected: 0.0,
            },
        );
        for k in 0..=STEPS {
            let a1 = most * k as f64 / STEPS as f64;
            let (mean, variance) = self.predict(a1, forward);
            // In the dead zone nothing moves, and nothing is uncertain about that.
            let (expected, variance) = if mean > 0.0 {
                (mean, variance)
            } else {
                (0.0, 0.0)
            };
            let left = (error - expected).powi(2) + variance;
            if left < best.0 {
                best = (left, Choice { a1, expected });
            }
        }
        best.1
    }

    fn learn(&mut self, a1: f64, forward: bool, moved: f64) {
        self.covariance += &self.forget;
        let (mean, variance) = self.predict(a1, forward);
        // An output that stayed where it is says only that the response is not above zero.
        let least = 2.0 * self.noise.sqrt();
        if mean <= 0.0 && moved < least {
            return;
        }
        let surprise = moved - mean;
        let shares = self.shares(a1, forward);
        let mut column = DVector::zeros(self.mean.len());
        for (i, w) in shares {
            column.axpy(w, &self.covariance.column(i).clone_owned(), 1.0);
        }
        let total = variance + self.scatter;
        let gain = &column / total;
        self.mean.axpy(surprise, &gain, 1.0);
        self.covariance -= &gain * column.transpose();
        let seen = (surprise * surprise - variance).max(0.0);
        self.weight += 1.0;
        self.scatter += (seen.min(9.0 * self.scatter) - self.scatter) / self.weight;
        self.scatter = self.scatter.max(self.noise);
    }
}

/// A curve at some knots, without its toe: below its steepest place at amplitudes up to `until` it
/// goes on straight.
fn straightened(curve: &Curve, knots: &[f64], until: f64) -> Vec<f64> {
    let mut steepest: Option<([f64; 2], f64)> = None;
    for pair in curve.points.windows(2) {
        let ([a, d], [b, e]) = (pair[0], pair[1]);
        let slope = (e - d) / (b - a);
        if b <= until && steepest.is_none_or(|(_, most)| slope > most) {
            steepest = Some((pair[1], slope));
        }
    }
    knots
        .iter()
        .map(|a1| {
            let value = curve.at(*a1);
            match steepest {
                Some(([a, d], slope)) if *a1 < a => value.min(d - slope * (a - a1)),
                _ => value,
            }
        })
        .collect()
}
