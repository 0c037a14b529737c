//! The generalised impulse, (4.7), with more harmonics.

mod approximation;

pub use approximation::Outside;

use crate::joint::Voltage;
use std::f64::consts::PI;

/// Harmonics of a [`Pulse`].
pub const HARMONICS: usize = 4;

/// `u(t) = sum of a_n sin(n pi t/T)` for `0 <= t <= T`, volts; (4.7) has the first two terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// Amplitudes `a_1`, `a_2` and so on, volts.
    pub amplitudes: [f64; HARMONICS],
    /// Its length `T`, seconds.
    pub period: f64,
}

impl Pulse {
    /// The impulse (4.7).
    pub fn impulse(a1: f64, a2: f64, period: f64) -> Self {
        Self {
            amplitudes: [a1, a2, 0.0, 0.0],
            period,
        }
    }
}

impl Voltage for Pulse {
    fn at(&self, time: f64) -> f64 {
        let (sin, cos) = (PI * time / self.period).sin_cos();
        let (mut before, mut now) = (0.0, sin);
        let mut sum = 0.0;
        for a in self.amplitudes {
            sum += a * now;
            // sin(n x) from the two before it; cos(n x) below likewise.
            (before, now) = (now, 2.0 * cos * now - before);
        }
        sum
    }

    fn rate(&self, time: f64) -> f64 {
        let cos = (PI * time / self.period).cos();
        let (mut before, mut now) = (1.0, cos);
        let mut sum = 0.0;
        for (n, a) in self.amplitudes.iter().enumerate() {
            sum += (n + 1) as f64 * a * now;
            (before, now) = (now, 2.0 * cos * now - before);
        }
        PI / self.period * sum
    }
}

/// A voltage that starts later: its time is counted from `since` seconds on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct From<V> {
    /// The voltage.
    pub voltage: V,
    /// Seconds that have passed of it.
    pub since: f64,
}

impl<V: Voltage> Voltage for From<V> {
    fn at(&self, time: f64) -> f64 {
        self.voltage.at(self.since + time)
    }

    fn rate(&self, time: f64) -> f64 {
        self.voltage.rate(self.since + time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_and_rate_are_those_of_the_sines() {
        let pulse = Pulse {
            amplitudes: [1.5, 12.5, -0.4, 0.9],
            period: 1e-3,
        };
        for k in 0..=40 {
            let t = f64::from(k) * 2.5e-5;
            let term = |n: usize| {
                let rate = (n + 1) as f64 * PI / pulse.period;
                let (sin, cos) = (rate * t).sin_cos();
                (pulse.amplitudes[n] * sin, pulse.amplitudes[n] * rate * cos)
            };
            let (value, rate) = (0..HARMONICS)
                .map(term)
                .fold((0.0, 0.0), |s, v| (s.0 + v.0, s.1 + v.1));
            assert!((pulse.at(t) - value).abs() < 1e-11, "{t}");
            assert!((pulse.rate(t) / rate - 1.0).abs() < 1e-9, "{t}");
        }
    }
}
