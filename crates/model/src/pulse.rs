//! The generalised impulse, (4.7).

use crate::joint::Voltage;
use std::f64::consts::PI;

/// `u(t) = a1 sin(pi t/T) + a2 sin(2 pi t/T)` for `0 <= t <= T`, volts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// Amplitude of the half wave, volts.
    pub a1: f64,
    /// Amplitude of the whole wave, volts.
    pub a2: f64,
    /// Its length `T`, seconds.
    pub period: f64,
}

impl Voltage for Pulse {
    fn at(&self, time: f64) -> f64 {
        let phase = PI * time / self.period;
        self.a1 * phase.sin() + self.a2 * (2.0 * phase).sin()
    }

    fn rate(&self, time: f64) -> f64 {
        let (phase, turn) = (PI * time / self.period, PI / self.period);
        turn * (self.a1 * phase.cos() + 2.0 * self.a2 * (2.0 * phase).cos())
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
