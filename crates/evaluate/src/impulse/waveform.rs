//! Families of pulses: what an amplifier might play instead of the thesis's two sines.

use pigtail_hal::Pulse;
use pigtail_hal::pulse::HARMONICS;
use pigtail_hal::quantity::Volts;
use pigtail_model::joint::{Joint, JointState, Voltage};
use pigtail_numerics::bisection::onset;
use std::f64::consts::{PI, TAU};

/// How a pulse goes over its length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Sines of half a period and its multiples, (4.7) and more: what amplifiers of this rig play.
    Sines,
    /// A rectangle forward and one back, `a_2` high, and `a_1` all the time.
    Rectangles,
    /// The same rounded: `(1 - cos)/2` bumps.
    Bumps,
    /// Radial basis functions (thesis 4.3.4): Gaussians an eighth of the length apart and as wide, under a half sine that
    /// holds both ends at nothing. `a_1` is that in the middle; each other amplitude is one before the middle, from the
    /// beginning on, and one against it as far behind.
    Gaussians,
}

/// Distance of neighbouring Gaussians, and their width, share of the length.
const SPACING: f64 = 0.125;

/// Of Gaussians: value and derivative by `x`, the share of the length that is over.
fn gaussians(amplitudes: &[f64; HARMONICS], x: f64) -> (f64, f64) {
    let (mut sum, mut slope) = (0.0, 0.0);
    let mut add = |amplitude: f64, centre: f64| {
        let u = (x - centre) / SPACING;
        let value = amplitude * (-u * u).exp();
        sum += value;
        slope -= 2.0 * u / SPACING * value;
    };
    add(amplitudes[0], 0.5);
    for (k, amplitude) in amplitudes.iter().enumerate().skip(1) {
        let centre = SPACING * k as f64;
        add(*amplitude, centre);
        add(-amplitude, 1.0 - centre);
    }
    let (sin, cos) = (PI * x).sin_cos();
    (sin * sum, sin * slope + PI * cos * sum)
}

/// One pulse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waveform {
    /// How it goes.
    pub family: Family,
    /// `a_1`, which decides how far it moves an output, and what is fixed beside it, volts.
    pub amplitudes: [f64; HARMONICS],
    /// Its length, seconds.
    pub period: f64,
}

impl Waveform {
    /// The same with another `a_1`, volts.
    #[must_use]
    pub fn with(mut self, a1: f64) -> Self {
        self.amplitudes[0] = a1;
        self
    }

    /// Greatest magnitude of its voltage, volts.
    pub fn peak(&self) -> f64 {
        let [a1, a2, ..] = self.amplitudes;
        match self.family {
            Family::Sines => self.sines().peak(),
            Family::Rectangles => a1.abs() + a2.abs(),
            Family::Bumps | Family::Gaussians => {
                /// To a thousandth.
                const POINTS: u32 = 128;
                (0..POINTS)
                    .map(|k| {
                        self.at(self.period * f64::from(k) / f64::from(POINTS))
                            .abs()
                    })
                    .fold(0.0, f64::max)
            }
        }
    }

    /// The highest `a_1` with which it does not go beyond `volts`; `None` where it does without any.
    pub fn most(&self, volts: f64) -> Option<f64> {
        const HALVINGS: u32 = 24;
        if self.with(0.0).peak() > volts {
            return None;
        }
        // Each family's first part alone peaks at a_1, and the second takes from it at most its own.
        let beyond = |a1: f64| self.with(a1).peak() > volts;
        Some(onset((0.0, 4.0 * volts), HALVINGS, beyond).0)
    }

    /// The voltage `time` seconds after its start, volts.
    pub fn voltage(&self, time: f64) -> f64 {
        let [a1, a2, ..] = self.amplitudes;
        match self.family {
            Family::Sines => self.sines().at(time),
            Family::Rectangles if 2.0 * time < self.period => a1 + a2,
            Family::Rectangles => a1 - a2,
            Family::Bumps | Family::Gaussians => self.at(time),
        }
    }

    /// The same in the other direction.
    #[must_use]
    pub fn reversed(mut self) -> Self {
        self.amplitudes = self.amplitudes.map(|a| -a);
        self
    }

    fn sines(&self) -> Pulse {
        Pulse {
            amplitudes: self.amplitudes.map(Volts),
            period: self.period,
        }
    }

    /// Lets a joint feel all of it.
    pub fn play(&self, joint: &Joint, state: &mut JointState) {
        let [a1, a2, ..] = self.amplitudes;
        match self.family {
            Family::Sines => {
                let pulse = pigtail_model::pulse::Pulse {
                    amplitudes: self.amplitudes,
                    period: self.period,
                };
                joint.advance(state, pulse, self.period);
            }
            // No step across a jump.
            Family::Rectangles => {
                joint.advance(state, a1 + a2, 0.5 * self.period);
                joint.advance(state, a1 - a2, 0.5 * self.period);
            }
            Family::Bumps | Family::Gaussians => joint.advance(state, *self, self.period),
        }
    }
}

/// Of bumps and Gaussians; the other families have voltages of their own.
impl Voltage for Waveform {
    fn at(&self, time: f64) -> f64 {
        let [a1, a2, ..] = self.amplitudes;
        let x = (time / self.period).clamp(0.0, 1.0);
        if self.family == Family::Gaussians {
            return gaussians(&self.amplitudes, x).0;
        }
        let sign = if x < 0.5 { 1.0 } else { -1.0 };
        0.5 * a1 * (1.0 - (TAU * x).cos()) + 0.5 * a2 * sign * (1.0 - (2.0 * TAU * x).cos())
    }

    fn rate(&self, time: f64) -> f64 {
        let [a1, a2, ..] = self.amplitudes;
        let x = (time / self.period).clamp(0.0, 1.0);
        if self.family == Family::Gaussians {
            return gaussians(&self.amplitudes, x).1 / self.period;
        }
        let sign = if x < 0.5 { 1.0 } else { -1.0 };
        let rate = TAU / self.period;
        0.5 * a1 * rate * (TAU * x).sin() + a2 * sign * rate * (2.0 * TAU * x).sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(family: Family) -> Waveform {
        Waveform {
            family,
            amplitudes: [1.5, 8.0, 0.0, 0.0],
            period: 1e-3,
        }
    }

    #[test]
    fn the_highest_first_amplitude_uses_up_the_voltage() {
        for family in [
            Family::Sines,
            Family::Rectangles,
            Family::Bumps,
            Family::Gaussians,
        ] {
            let wave = of(family);
            let most = wave.most(12.0).expect("eight are below twelve");
            assert!(
                (wave.with(most).peak() / 12.0 - 1.0).abs() < 2e-3,
                "{family:?}"
            );
            // Where the second amplitude alone is more than there is.
            let least = wave.with(0.0).peak();
            assert_eq!(wave.most(0.9 * least), None, "{family:?}");
        }
    }

    #[test]
    fn the_rate_of_bumps_and_gaussians_is_that_of_their_voltage() {
        for (wave, k) in [Family::Bumps, Family::Gaussians]
            .into_iter()
            .flat_map(|family| (1..40).map(move |k| (of(family), k)))
        {
            let (time, small) = (2.5e-5 * f64::from(k) + 1e-6, 1e-8);
            let rate = (wave.at(time + small) - wave.at(time - small)) / (2.0 * small);
            assert!((wave.rate(time) - rate).abs() < 1e-3 * 5e4, "{time}");
        }
    }
}
