//! The PID controller of a motor axis, (2.14) and (2.15).

use crate::calibration::AxisGains;
use pigtail_hal::quantity::{Counts, Volts};

/// A discrete PID with a clamped integral and a saturated output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pid {
    kp: f64,
    ki: f64,
    kd: f64,
    period: f64,
    integral_bound: f64,
    voltage: f64,
    /// Cycles for which the reference stands still before the integral does, within [`HELD`].
    hold: u32,
}

/// What a [`Pid`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PidState {
    /// Integral of the error, count s.
    integral: f64,
    /// Error of the cycle before, counts.
    last: Option<f64>,
    /// The reference of the cycle before, and for how many cycles it has stood there.
    stands: (Counts, u32),
}

/// An axis at rest is held no nearer than this, counts. Nearer it could only be brought by an integral that breaks friction,
/// and that goes as far beyond: an axis that sticks would hunt to and fro around its count.
const HELD: i64 = 1;

impl Pid {
    /// A controller with these gains for an amplifier that saturates at `voltage` volts, run
    /// every `period` seconds.
    pub fn new(gains: &AxisGains, voltage: f64, period: f64) -> Self {
        let integral_bound = if gains.ki > 0.0 {
            gains.integral_limit / gains.ki
        } else {
            f64::INFINITY
        };
        Self {
            kp: gains.kp,
            ki: gains.ki,
            kd: gains.kd,
            period,
            integral_bound,
            voltage,
            hold: u32::MAX,
        }
    }

    /// The same controller, which keeps its integral as it is where the reference has stood for so many seconds and the axis
    /// is within a count of it.
    #[must_use]
    pub fn holding_after(self, seconds: f64) -> Self {
        Self {
            hold: (seconds / self.period).ceil() as u32,
            ..self
        }
    }

    /// The voltage for this cycle, (2.14), from the error (2.15) in counts:
    ///
    /// ```text
    /// e = reference - measured
    /// I = clamp(I + e T)                          unless the axis is held
    /// u = clamp(kp e + ki I + kd (e - e_last)/T)
    /// ```
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    pub fn voltage(&self, state: &mut PidState, reference: Counts, measured: Counts) -> Volts {
        let counts = reference.0 - measured.0;
        let error = counts as f64;
        let (stood, since) = state.stands;
        let still = if stood == reference {
            since.saturating_add(1)
        } else {
            0
        };
        state.stands = (reference, still);
        if still < self.hold || counts.abs() > HELD {
            state.integral = (state.integral + error * self.period)
                .clamp(-self.integral_bound, self.integral_bound);
        }
        let rate = state.last.map_or(0.0, |last| (error - last) / self.period);
        state.last = Some(error);
        let voltage = self.kp * error + self.ki * state.integral + self.kd * rate;
        Volts(voltage.clamp(-self.voltage, self.voltage))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gains(kp: f64, ki: f64, kd: f64) -> AxisGains {
        AxisGains {
            kp,
            ki,
            kd,
            integral_limit: 2.0,
            speed: None,
            date: String::new(),
            origin: String::new(),
        }
    }

    #[test]
    fn each_term_acts_alone_as_written() {
        let step = |gains: &AxisGains| {
            let pid = Pid::new(gains, 12.0, 4e-4);
            let mut state = PidState::default();
            (0..5).fold(0.0, |_, _| pid.voltage(&mut state, Counts(3), Counts(0)).0)
        };
        assert!((step(&gains(0.5, 0.0, 0.0)) - 1.5).abs() < 1e-12);
        assert!((step(&gains(0.0, 10.0, 0.0)) - 10.0 * 5.0 * 3.0 * 4e-4).abs() < 1e-12);
        assert!(
            step(&gains(0.0, 0.0, 1.0)).abs() < 1e-12,
            "no rate while the error stays"
        );
    }

    #[test]
    fn an_axis_at_rest_is_not_driven_over_its_count() {
        let pid = Pid::new(&gains(0.5, 10.0, 0.0), 12.0, 4e-4).holding_after(0.02);
        let mut state = PidState::default();
        let mut at = |measured: i64, reference: i64| {
            pid.voltage(&mut state, Counts(reference), Counts(measured))
                .0
        };
        let begun = at(0, 1);
        let rested: Vec<_> = (0..200).map(|_| at(0, 1)).collect();
        assert!(begun < rested[20] && rested[20] < rested[45]);
        assert_eq!(rested[60], rested[199]);
        // What is farther off is brought back, and a motion is followed as ever.
        let farther = (at(-1, 1), at(-1, 1));
        assert!(farther.0 < farther.1);
        let moving: Vec<_> = (2..6)
            .map(|reference| at(reference - 1, reference))
            .collect();
        assert!(moving.is_sorted() && moving[0] < moving[3]);
    }

    #[test]
    fn integral_and_output_are_clamped_and_symmetric() {
        let pid = Pid::new(&gains(0.0, 100.0, 0.0), 12.0, 4e-4);
        let mut state = PidState::default();
        for _ in 0..10_000 {
            pid.voltage(&mut state, Counts(100), Counts(0));
        }
        let Volts(held) = pid.voltage(&mut state, Counts(0), Counts(0));
        assert!((held - 2.0).abs() < 1e-12);
        let pid = Pid::new(&gains(1.0, 0.0, 0.0), 12.0, 4e-4);
        let mut state = PidState::default();
        assert_eq!(pid.voltage(&mut state, Counts(100), Counts(0)), Volts(12.0));
        assert_eq!(
            pid.voltage(&mut state, Counts(-100), Counts(0)),
            Volts(-12.0)
        );
    }
}
