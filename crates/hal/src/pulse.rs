//! A short waveform that an amplifier plays out by itself, inside servo cycles.

use crate::fault::Rule;
use crate::quantity::Volts;
use crate::spec::DriveSpec;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Harmonics that an amplifier knows.
pub const HARMONICS: usize = 4;

/// A waveform of the generalised impulse's kind, (4.7) of the thesis with two harmonics more:
///
/// ```text
/// u(t) = a_1 sin(pi t/T) + a_2 sin(2 pi t/T) + a_3 sin(3 pi t/T) + a_4 sin(4 pi t/T),  0 <= t <= T
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pulse {
    /// Amplitudes `a_1` to `a_4`; positive ones of odd harmonics push forward.
    pub amplitudes: [Volts; HARMONICS],
    /// Its length `T`, seconds. It need not be a whole number of servo cycles.
    pub period: f64,
}

/// Why an amplifier cannot play a pulse: the parts of a [`Fault`](crate::Fault), or of an error.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unplayable {
    /// The rule that it breaks.
    pub rule: Rule,
    /// The offending value with its unit.
    pub value: String,
    /// What would have been accepted, with its unit.
    pub limit: String,
}

impl std::fmt::Display for Unplayable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; accepted is {}", self.value, self.limit)
    }
}

impl Pulse {
    /// The generalised impulse (4.7): amplitudes `a1` and `a2` in volts, length in seconds.
    pub fn impulse(a1: f64, a2: f64, period: f64) -> Self {
        Self {
            amplitudes: [Volts(a1), Volts(a2), Volts(0.0), Volts(0.0)],
            period,
        }
    }

    /// The same in the other direction.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self {
            amplitudes: self.amplitudes.map(|Volts(a)| Volts(-a)),
            ..self
        }
    }

    /// The voltage `time` seconds after its start, volts.
    pub fn at(&self, time: f64) -> f64 {
        let (sin, cos) = (PI * time / self.period).sin_cos();
        // sin(n x) from the two before it.
        let (mut before, mut now) = (0.0, sin);
        self.amplitudes.iter().fold(0.0, |sum, Volts(a)| {
            let value = sum + a * now;
            (before, now) = (now, 2.0 * cos * now - before);
            value
        })
    }

    /// Greatest magnitude of the voltage on its way, volts.
    pub fn peak(&self) -> f64 {
        /// The highest harmonic has so many points in each of its half waves.
        const POINTS: usize = 32;
        let step = self.period / (HARMONICS * POINTS) as f64;
        let size = |k: usize| self.at(k as f64 * step).abs();
        let (mut best, mut high) = (0, 0.0);
        for k in 1..HARMONICS * POINTS {
            if size(k) > high {
                (best, high) = (k, size(k));
            }
        }
        if best == 0 {
            return high;
        }
        // The top of the parabola through the points around it: to a millionth.
        let (left, right) = (size(best - 1), size(best + 1));
        let bend = left - 2.0 * high + right;
        if bend < 0.0 {
            high - (right - left).powi(2) / (8.0 * bend)
        } else {
            high
        }
    }

    /// The highest frequency in it, hertz: that of its last harmonic.
    pub fn highest_frequency(&self) -> f64 {
        let last = self.amplitudes.iter().rposition(|Volts(a)| *a != 0.0);
        last.map_or(0.0, |n| (n + 1) as f64 / (2.0 * self.period))
    }

    /// Whether the amplifier of `drive` can play it as it is.
    ///
    /// # Errors
    ///
    /// What hinders it: the amplifier plays no pulses at all, the pulse is no number, or it is
    /// beyond the amplifier's voltage or bandwidth.
    pub fn check(&self, drive: &DriveSpec) -> Result<(), Unplayable> {
        /// What was computed to lie on a bound does.
        const ROUNDING: f64 = 1.0 + 1e-9;
        let refuse = |rule, value: String, limit: String| Err(Unplayable { rule, value, limit });
        let Some(spec) = &drive.pulse else {
            return refuse(
                Rule::PulseSupport,
                "a pulse".to_owned(),
                "an axis whose datasheet has `drive.pulse`".to_owned(),
            );
        };
        let finite = self.amplitudes.iter().all(|Volts(a)| a.is_finite());
        if !finite || !self.period.is_finite() || self.period <= 0.0 {
            return refuse(
                Rule::CommandNumber,
                format!(
                    "a pulse of {:?} V in {} s",
                    self.amplitudes.map(|v| v.0),
                    self.period
                ),
                "finite amplitudes and a period above zero".to_owned(),
            );
        }
        let frequency = self.highest_frequency();
        if frequency > spec.bandwidth * ROUNDING {
            let shortest = 1e3 * self.period * frequency / spec.bandwidth;
            return refuse(
                Rule::PulseBandwidth,
                format!("a period of {:.4} ms", 1e3 * self.period),
                format!(
                    "at least {shortest:.4} ms, for {} Hz of bandwidth",
                    spec.bandwidth
                ),
            );
        }
        // No higher than all harmonics at their tops, which is quick to say of most pulses.
        let bound: f64 = self.amplitudes.iter().map(|Volts(a)| a.abs()).sum();
        if bound <= spec.voltage {
            return Ok(());
        }
        let peak = self.peak();
        if peak > spec.voltage * ROUNDING {
            return refuse(
                Rule::PulseVoltage,
                format!("a peak of {peak:.3} V"),
                format!("at most {} V", spec.voltage),
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::PulseSpec;

    fn drive() -> DriveSpec {
        DriveSpec {
            gear_ratio: 5.0,
            counts_per_turn: 2048,
            voltage: 24.0,
            speed: 600.0,
            start: None,
            step: None,
            pulse: Some(PulseSpec {
                voltage: 10.0,
                bandwidth: 2000.0,
            }),
        }
    }

    #[test]
    fn harmonics_are_sines() {
        let pulse = Pulse {
            amplitudes: [Volts(1.5), Volts(-2.0), Volts(0.7), Volts(0.3)],
            period: 1.3e-3,
        };
        for k in 0..=50 {
            let x = PI * f64::from(k) / 50.0;
            let t = f64::from(k) / 50.0 * pulse.period;
            let exact = 1.5 * x.sin() - 2.0 * (2.0 * x).sin()
                + 0.7 * (3.0 * x).sin()
                + 0.3 * (4.0 * x).sin();
            assert!((pulse.at(t) - exact).abs() < 1e-12);
            assert_eq!(pulse.reversed().at(t), -pulse.at(t));
        }
    }

    #[test]
    fn the_peak_is_found_between_the_points() {
        let of = |a1, a2| Pulse::impulse(a1, a2, 1e-3);
        assert!((of(3.0, 0.0).peak() - 3.0).abs() < 1e-9);
        assert!((of(0.0, -3.0).peak() - 3.0).abs() < 1e-9);
        let fine = (0..100_000)
            .map(|k| of(1.5, 12.5).at(f64::from(k) * 1e-8).abs())
            .fold(0.0, f64::max);
        assert!((of(1.5, 12.5).peak() - fine).abs() < 1e-5 * fine);
        assert_eq!(of(0.0, 0.0).peak(), 0.0);
    }

    #[test]
    fn what_cannot_be_played_is_told_why() {
        let refused = |pulse: Pulse, drive: &DriveSpec| pulse.check(drive).expect_err("refused");
        let good = Pulse::impulse(1.0, 5.0, 1e-3);
        assert_eq!(good.check(&drive()), Ok(()));
        // Two harmonics within 2 kHz: half a millisecond is just long enough.
        assert_eq!(Pulse::impulse(1.0, 5.0, 0.5e-3).check(&drive()), Ok(()));
        let short = refused(Pulse::impulse(1.0, 5.0, 0.4e-3), &drive());
        assert!(short.limit.contains("0.5000 ms"), "{short}");
        // One harmonic alone may be shorter.
        assert_eq!(Pulse::impulse(1.0, 0.0, 0.3e-3).check(&drive()), Ok(()));
        let high = refused(Pulse::impulse(2.0, 9.5, 1e-3), &drive());
        assert!(high.limit.contains("10 V"), "{high}");
        for bad in [f64::NAN, f64::INFINITY] {
            let rule = refused(Pulse::impulse(bad, 0.0, 1e-3), &drive()).rule;
            assert_eq!(rule, Rule::CommandNumber);
            assert!(Pulse::impulse(1.0, 0.0, bad).check(&drive()).is_err());
        }
        assert!(Pulse::impulse(1.0, 0.0, 0.0).check(&drive()).is_err());
        let without = DriveSpec {
            pulse: None,
            ..drive()
        };
        assert!(refused(good, &without).limit.contains("drive.pulse"));
    }
}
