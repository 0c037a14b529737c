//! The PID controller of a motor axis, (2.14) and (2.15).

use crate::calibration::AxisGains;
use crate::tuning::TUNING;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_model::each::held;

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
    /// Whether an axis that swings at rest is held by gentler gains.
    gentle: bool,
}

/// What a [`Pid`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PidState {
    /// Integral of the error, count s.
    integral: f64,
    /// Error of the cycle before, counts.
    last: Option<f64>,
    /// The reference of the cycle before, and for how many cycles it has stood there.
    stands: (Counts, u32),
    /// On which side of its reference the axis was last that stood there, when that was, and how often it has gone to the other at once.
    swings: (i64, u32, u32),
    /// How many times as large as they were found all gains are.
    share: f64,
}

impl Default for PidState {
    fn default() -> Self {
        Self {
            integral: 0.0,
            last: None,
            stands: (Counts(0), 0),
            swings: (0, 0, 0),
            share: 1.0,
        }
    }
}

impl PidState {
    /// What is left where the loop was open meanwhile: the gains that the axis has been seen to bear.
    #[must_use]
    pub fn afresh(&self) -> Self {
        Self {
            share: self.share,
            ..Self::default()
        }
    }

    /// How many times as large as they were found all gains are, since the axis swung at rest under them.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// An axis that has come to rest lies within friction of its reference. One that goes to and fro about it, and goes on with that, has
    /// a loop that is not stable: under another load, with less friction or with more delay than that for which its gains were found. All of them
    /// are made less then, here and at once, for whoever comes near to a chip with such an axis touches it. `counts` is its error, for
    /// `still` cycles since its reference has moved.
    #[inline]
    fn watch_rest(&mut self, counts: i64, still: u32, period: f64) {
        if still == 0 {
            self.swings = (0, 0, 0);
        } else if counts.abs() >= i64::from(TUNING.swing.beyond) {
            self.add_swing(counts.signum(), still, period);
        }
    }

    /// It is on this side of its reference now. What pushes it to and fro now and then is no swing.
    fn add_swing(&mut self, side: i64, now: u32, period: f64) {
        let (before, since, times) = self.swings;
        let at_once = f64::from(now - since) * period <= TUNING.swing.within;
        let times = match side == -before {
            true if at_once => times + 1,
            true => 0,
            false => times,
        };
        self.swings = (side, now, times);
        if times >= TUNING.swing.often && self.share > TUNING.swing.least {
            self.share *= TUNING.swing.gentler;
            self.swings = (side, now, 0);
        }
    }
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
            gentle: false,
        }
    }

    /// The same controller, which makes all its gains less where the axis swings at rest under them: for work, and not where it is to be seen how
    /// an axis answers to gains.
    #[must_use]
    pub fn gentle(self) -> Self {
        Self {
            gentle: true,
            ..self
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
    /// u = clamp(s (kp e + ki I + kd (e - e_last)/T))
    /// ```
    ///
    /// `s` is one, and less where the axis has been seen to swing at rest.
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
        if self.gentle {
            state.watch_rest(counts, still, self.period);
        }
        if still < self.hold || counts.abs() > HELD {
            let integral = state.integral + error * self.period;
            state.integral = held(integral, -self.integral_bound, self.integral_bound);
        }
        let rate = state.last.map_or(0.0, |last| (error - last) / self.period);
        state.last = Some(error);
        let voltage = self.kp * error + self.ki * state.integral + self.kd * rate;
        let voltage = state.share * voltage;
        Volts(held(voltage, -self.voltage, self.voltage))
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
    fn an_axis_that_swings_at_rest_is_held_by_gentler_gains() {
        // A mass without friction whose encoder is late, which gathers so many counts a second squared from a volt.
        let rest = |gain: f64, gentle: bool| {
            let pid = Pid::new(&gains(0.4, 0.0, 2.5e-3), 12.0, 4e-4);
            let pid = if gentle { pid.gentle() } else { pid };
            let mut state = PidState::default();
            let (mut at, mut speed, mut late) = (40.0_f64, 0.0, [40; 4]);
            let mut farthest = 0;
            for cycle in 0..6000 {
                let Volts(volts) = pid.voltage(&mut state, Counts(0), Counts(late[0]));
                speed += 4e-4 * gain * volts;
                at += 4e-4 * speed;
                late.rotate_left(1);
                late[3] = at.round() as i64;
                if cycle > 5000 {
                    farthest = farthest.max(late[3].abs());
                }
            }
            (state.share(), farthest)
        };
        assert_eq!(rest(2e5, true), (1.0, 0));
        let (_, farthest) = rest(5e5, false);
        assert!(farthest > 4, "{farthest}");
        let (share, farthest) = rest(5e5, true);
        assert!(
            (0.3..1.0).contains(&share) && farthest <= 2,
            "{share} {farthest}"
        );
    }

    #[test]
    fn an_axis_that_is_pushed_to_and_fro_now_and_then_keeps_its_gains() {
        let pid = Pid::new(&gains(0.4, 0.0, 2.5e-3), 12.0, 4e-4).gentle();
        let mut state = PidState::default();
        for push in 0..100 {
            let side = if push % 2 == 0 { 6 } else { -6 };
            for cycle in 0..250 {
                let at = if cycle < 5 { side } else { 0 };
                pid.voltage(&mut state, Counts(0), Counts(at));
            }
        }
        assert_eq!(state.share(), 1.0);
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
