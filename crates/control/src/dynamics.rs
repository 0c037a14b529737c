//! How a micro swings when it is told to go elsewhere at once: its resonance, by light on the slope of a peak.
//!
//! Whoever waits less than a tip swings attaches it while it does, and light that was seen from a circle says nothing of that. No
//! datasheet knows it well: what a stage carries, and its fiber, make it slower.

use crate::tuning::TUNING;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_numerics::nonlinear::{minimise, uncertainty};
use std::f64::consts::TAU;

/// A step of a piezo, and where its tip was seen from then on until the next one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepSeen {
    /// When it was told, seconds.
    pub time: f64,
    /// How far: one or minus one.
    pub way: f64,
    /// When the tip was seen, seconds, and where, in any unit.
    pub seen: Vec<(f64, f64)>,
}

/// How a piezo's axis answers: a resonance of the second order, behind a delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dynamics {
    /// Undamped natural frequency, hertz.
    pub resonance: f64,
    /// Damping ratio, zero to one.
    pub damping: f64,
    /// From when it is told to go until light tells that it has begun to, seconds.
    pub delay: f64,
    /// Standard deviation of the natural logarithm of [`Self::decay`].
    pub deviation: f64,
    /// What no such axis makes of what was seen, of a step's height, rms; noise is in it.
    pub misfit: f64,
}

/// So many steps are still felt.
const FELT: usize = 3;

impl Dynamics {
    /// By what was seen of steps; `None` where that is no resonance's.
    ///
    /// ```
    /// # use pigtail_control::dynamics::{Dynamics, StepSeen};
    /// // 120 Hz damped by 0.1, 0.4 ms late, seen every 2 ms, each step a little later between two samples than the last.
    /// let truth = Dynamics { resonance: 120.0, damping: 0.1, delay: 0.4e-3, deviation: 0.0, misfit: 0.0 };
    /// let times: Vec<f64> = (0..20).map(|k| 0.0802 * f64::from(k)).collect();
    /// let way = |k: usize| if k % 2 == 0 { 1.0 } else { -1.0 };
    /// let place = |t: f64| (0..20).map(|k| way(k) * truth.answer(t - times[k])).sum::<f64>();
    /// let steps: Vec<_> = (0..20)
    ///     .map(|k| {
    ///         let first = (times[k] / 2e-3).ceil() as u32;
    ///         let seen = (first..first + 40).map(|i| 2e-3 * f64::from(i)).map(|t| (t, 3.0 + 0.2 * place(t)));
    ///         StepSeen { time: times[k], way: way(k), seen: seen.collect() }
    ///     })
    ///     .collect();
    /// let found = Dynamics::of(&steps).unwrap();
    /// assert!((found.resonance - 120.0).abs() < 0.1 && (found.damping - 0.1).abs() < 1e-3);
    /// assert!((found.delay - 0.4e-3).abs() < 1e-5);
    /// ```
    pub fn of(steps: &[StepSeen]) -> Option<Self> {
        let residuals = |p: &[f64]| left(steps, &Self::from_parameters(p)).0;
        let squares = |p: &[f64]| residuals(p).iter().map(|r| r * r).sum::<f64>();
        let tuned = &TUNING.dynamics;
        let starts = tuned.resonances.into_iter().flat_map(|resonance| {
            let of = move |damping: f64| Self::parameters(resonance, damping, tuned.delay);
            tuned.dampings.map(of)
        });
        let start = starts.min_by(|a, b| squares(a).total_cmp(&squares(b)))?;
        let (best, _) = minimise(residuals, &start)?;
        let sure = uncertainty(residuals, &best, 1)?;
        let found = Self::from_parameters(&best);
        let (rest, height) = left(steps, &found);
        let n = rest.len() as f64;
        let misfit = (rest.iter().map(|r| r * r).sum::<f64>() / n).sqrt() / height.abs();
        // The damping's parameter is the logarithm of its odds.
        let [of_resonance, of_damping] = [0, 1].map(|i| sure.std_correlated[i]);
        let deviation = of_resonance.hypot((1.0 - found.damping) * of_damping);
        let found = Self {
            deviation,
            misfit,
            ..found
        };
        // What leaves as much as a step is high is no answer to it, however surely it was fitted.
        let is_one = misfit < 1.0 && (tuned.least..tuned.most).contains(&found.resonance);
        (is_one && found.deviation.is_finite()).then_some(found)
    }

    fn parameters(resonance: f64, damping: f64, delay: f64) -> [f64; 3] {
        let [soonest, latest] = TUNING.dynamics.delays;
        [
            resonance.ln(),
            (damping / (1.0 - damping)).ln(),
            ((delay - soonest) / (latest - delay)).ln(),
        ]
    }

    fn from_parameters(p: &[f64]) -> Self {
        let [soonest, latest] = TUNING.dynamics.delays;
        let share = |odds: f64| (1.0 + (-odds).exp()).recip();
        Self {
            resonance: p[0].exp(),
            damping: share(p[1]),
            delay: soonest + (latest - soonest) * share(p[2]),
            deviation: 0.0,
            misfit: 0.0,
        }
    }

    /// How fast it comes to rest, 1/s.
    pub fn decay(&self) -> f64 {
        TAU * self.resonance * self.damping
    }

    /// Where it is so long (seconds) after it was told to go on by one.
    pub fn answer(&self, since: f64) -> f64 {
        let t = since - self.delay;
        if t <= 0.0 {
            return 0.0;
        }
        let natural = TAU * self.resonance;
        let damped = natural * (1.0 - self.damping * self.damping).sqrt();
        let (sin, cos) = (damped * t).sin_cos();
        1.0 - (-self.decay() * t).exp() * (cos + self.decay() / damped * sin)
    }

    /// Whether it is known well enough by when it comes to rest.
    pub fn is_told(&self) -> bool {
        self.deviation < TUNING.dynamics.told
    }

    /// By when it has come to rest, seconds: after some time constants, as long as they may be; an axis that is damped so much that it hardly swings
    /// keeps some of its way for longer than these say, by half at most.
    pub fn settling(&self) -> f64 {
        let tuned = &TUNING.dynamics;
        let lasts = -0.5 * (1.0 - self.damping * self.damping).ln();
        let constants = (tuned.constants + lasts).min(1.5 * tuned.constants);
        constants / self.decay() * (tuned.surely * self.deviation).exp()
    }

    /// How late light is on a circle of so many turns a second, seconds.
    pub fn lag(&self, rate: f64) -> f64 {
        let u = rate / self.resonance;
        (2.0 * self.damping * u).atan2(1.0 - u * u) / (TAU * rate) + self.delay.max(0.0)
    }
}

/// How a micro follows what it is told, by both of its axes: as the slower one does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swings {
    /// By when it has come to rest, seconds.
    pub settling: f64,
    /// How many turns of a circle it follows at most, hertz.
    pub bandwidth: f64,
    /// How late light is, and one standard deviation of that, seconds.
    pub lag: f64,
    /// See [`Self::lag`].
    pub lag_deviation: f64,
}

impl Swings {
    /// Of a micro that is to go around at a rate, hertz, or more slowly where it does not follow.
    pub fn of(axes: &[Dynamics; MICRO_AXES], rate: f64) -> Self {
        let tuned = &TUNING.dynamics;
        let most = |of: &dyn Fn(&Dynamics) -> f64| axes.iter().map(of).fold(0.0, f64::max);
        let bandwidth = tuned.turns / most(&|axis| axis.resonance.recip());
        let lags = axes.map(|axis| axis.lag(rate.min(bandwidth)));
        let lag = 0.5 * (lags[0] + lags[1]);
        Self {
            settling: most(&Dynamics::settling),
            bandwidth,
            lag,
            lag_deviation: (tuned.lag * lag).hypot(0.5 * (lags[0] - lags[1])),
        }
    }
}

/// What an axis leaves of steps, beside a place and a drift of each; and how high a step is, in the unit of the places.
fn left(steps: &[StepSeen], axis: &Dynamics) -> (Vec<f64>, f64) {
    let (mut seen, mut model) = (Vec::new(), Vec::new());
    for (k, step) in steps.iter().enumerate() {
        let felt = &steps[k.saturating_sub(FELT)..=k];
        let times: Vec<f64> = step.seen.iter().map(|(time, _)| time - step.time).collect();
        let at = |(time, _): &(f64, f64)| {
            let of = |step: &StepSeen| step.way * axis.answer(time - step.time);
            felt.iter().map(of).sum::<f64>()
        };
        model.extend(straightened(&times, step.seen.iter().map(at).collect()));
        seen.extend(straightened(
            &times,
            step.seen.iter().map(|(_, place)| *place).collect(),
        ));
    }
    let squares: f64 = model.iter().map(|m| m * m).sum();
    let together: f64 = model.iter().zip(&seen).map(|(m, s)| m * s).sum();
    let height = together / squares.max(f64::MIN_POSITIVE);
    let rest = seen.iter().zip(&model).map(|(s, m)| s - height * m);
    (rest.collect(), height)
}

/// Values beside a straight line in time.
fn straightened(times: &[f64], mut values: Vec<f64>) -> Vec<f64> {
    let n = times.len().max(1) as f64;
    let middle = times.iter().sum::<f64>() / n;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = times.iter().map(|t| (t - middle).powi(2)).sum();
    let product: f64 = times
        .iter()
        .zip(&values)
        .map(|(t, v)| (t - middle) * v)
        .sum();
    let slope = product / squares.max(f64::MIN_POSITIVE);
    for (value, time) in values.iter_mut().zip(times) {
        *value -= mean + slope * (time - middle);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_has_come_to_rest_when_it_is_said_to() {
        for resonance in [60.0, 200.0, 700.0] {
            for damping in [0.02, 0.2, 0.6, 0.9, 0.99] {
                let axis = Dynamics {
                    resonance,
                    damping,
                    delay: 0.0,
                    deviation: 0.0,
                    misfit: 0.0,
                };
                let rest = axis.settling();
                let left = |t: f64| (1.0 - axis.answer(t)).abs();
                let late = (0..200).map(|k| left(rest * (1.0 + 0.01 * f64::from(k))));
                let late = late.fold(0.0, f64::max);
                assert!(late < 0.02, "{resonance} Hz, {damping}: {late}");
                // And it is not waited for much longer.
                let early = (0..50).map(|k| left(rest * (0.5 + 0.005 * f64::from(k))));
                assert!(
                    early.fold(0.0, f64::max) > 0.02,
                    "{resonance} Hz, {damping}"
                );
            }
        }
    }

    #[test]
    fn light_is_as_late_on_a_circle_as_its_place_is() {
        let axis = Dynamics {
            resonance: 100.0,
            damping: 0.3,
            delay: 0.5e-3,
            deviation: 0.0,
            misfit: 0.0,
        };
        // At its resonance an axis is a quarter of a turn behind, slowly it is by its damping.
        assert!((axis.lag(100.0) - (2.5e-3 + 0.5e-3)).abs() < 1e-9);
        let slow = 2.0 * 0.3 / (TAU * 100.0) + 0.5e-3;
        assert!((axis.lag(0.1) - slow).abs() < 1e-8);
        // The slower axis of a micro tells how fast it goes around.
        let other = Dynamics {
            resonance: 50.0,
            ..axis
        };
        let both = Swings::of(&[axis, other], 50.0);
        assert!((both.bandwidth - 50.0 * TUNING.dynamics.turns).abs() < 1e-9);
        assert!((both.settling - other.settling()).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_swing_tells_none() {
        let still = |k: u32| StepSeen {
            time: 0.08 * f64::from(k),
            way: if k.is_multiple_of(2) { 1.0 } else { -1.0 },
            seen: (0..40)
                .map(|i| {
                    (
                        0.08 * f64::from(k) + 2e-3 * f64::from(i),
                        f64::from((k * 7 + i * 13) % 11),
                    )
                })
                .collect(),
        };
        let steps: Vec<_> = (0..40).map(still).collect();
        let found = Dynamics::of(&steps);
        assert!(found.is_none_or(|found| !found.is_told()), "{found:?}");
    }
}
