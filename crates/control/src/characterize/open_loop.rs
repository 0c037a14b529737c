//! The open loop of a servo, from what its closed loop was seen to do.

use super::spectra::Spectra;
use pigtail_numerics::fourier::Complex64;
use std::f64::consts::{PI, TAU};

/// Parts of the record of which one after the other is left out, to see how far the figures change.
const PARTS: usize = 8;
/// Frequencies a decade.
const PER_DECADE: f64 = 60.0;
/// What is known worse than to this share of itself is not drawn, and no margin is read off there.
const UNSURE: f64 = 0.3;

/// A figure and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figure {
    /// The figure.
    pub value: f64,
    /// Its standard deviation, by the jackknife over parts of the record.
    pub sigma: f64,
}

/// A margin, and the frequency at which it is read off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margin {
    /// The margin: radians of phase, a factor of gain, or a sensitivity.
    pub margin: Figure,
    /// Where, hertz.
    pub hertz: Figure,
}

/// The open loop at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopPoint {
    /// Hertz.
    pub hertz: f64,
    /// `L`, gain and phase of the open loop.
    pub open: Complex64,
    /// Phase of `L`, radians, unwrapped; near -pi at the lowest frequencies of a motor with an integral.
    pub phase: f64,
    /// Standard deviation of `L` over its magnitude.
    pub unsure: f64,
}

impl LoopPoint {
    /// The sensitivity `|1 / (1 + L)|`: what is left of a disturbance at the output.
    pub fn sensitivity(&self) -> f64 {
        1.0 / (Complex64::new(1.0, 0.0) + self.open).norm()
    }
}

/// The open loop of a servo that acts on the error alone, such as the PID (2.14), from the response of the encoder to a
/// reference that nothing of the loop has an effect on:
///
/// ```text
/// S = S_re / S_rr = 1 / (1 + L)        L = 1 / S - 1        e[k] = r[k] - y[k - 1]
/// ```
///
/// `S` is the sensitivity, `e` the error that the servo acts on: the encoder was read at the end of the cycle before. Both
/// spectra are correlations with the reference, so noise of the encoder biases neither. Sampling and the hold of the
/// amplifier are part of `L`, as they are of the loop. With friction `L` is that of the linear axis that answers this
/// reference most alike; smaller motions see more friction, and another `L`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenLoop {
    /// From the lowest frequency on, evenly over its logarithm, those where `L` is known.
    pub points: Vec<LoopPoint>,
    /// Where `|L|` falls through one: the least phase above -pi, radians.
    pub phase_margin: Option<Margin>,
    /// Where the phase falls through -pi: the factor by which the gain may still grow. `None` where the phase does not
    /// come there as far as it is known.
    pub gain_margin: Option<Margin>,
    /// The greatest sensitivity.
    pub sensitivity_peak: Option<Margin>,
}

impl OpenLoop {
    /// From a record of reference and encoder in servo cycles, with windows of `window` samples, up to `highest` hertz.
    pub fn of(
        reference: &[f64],
        encoder: &[f64],
        period: f64,
        window: usize,
        highest: f64,
    ) -> Self {
        let before = std::iter::once(&0.0).chain(encoder);
        let error: Vec<f64> = reference.iter().zip(before).map(|(r, y)| r - y).collect();
        let spectra = Spectra::of(reference, &error, period, window, highest);
        let lowest = 2.0 / (window as f64 * period);
        let count = (PER_DECADE * (highest / lowest).log10()).floor() as usize;
        let hertz: Vec<f64> = (0..count)
            .map(|k| lowest * 10_f64.powf(k as f64 / PER_DECADE))
            .collect();
        let whole = sensitivities(&spectra, &hertz, None);
        let without: Vec<Vec<Complex64>> = (0..PARTS)
            .map(|part| sensitivities(&spectra, &hertz, Some((part, PARTS))))
            .collect();
        let unsure: Vec<f64> = (0..hertz.len())
            .map(|k| {
                let all = without.iter().map(|s| opened(s[k]) - opened(whole[k]));
                let squares: f64 = all.map(|d| d.norm_sqr()).sum();
                jackknife(squares) / opened(whole[k]).norm().max(f64::MIN_POSITIVE)
            })
            .collect();
        let known = |s: &[Complex64]| points(&hertz, s, &unsure);
        let points = known(&whole);
        let others: Vec<Vec<LoopPoint>> = without.iter().map(|s| known(s)).collect();
        let margin = |find: fn(&[LoopPoint]) -> Option<(f64, f64)>| {
            let (value, hertz) = find(&points)?;
            let others: Vec<(f64, f64)> = others.iter().filter_map(|p| find(p)).collect();
            // A margin that is there in some parts of the record alone is known to no number.
            let sigma = |of: fn(&(f64, f64)) -> f64, whole: f64| {
                let squares = others.iter().map(|o| (of(o) - whole).powi(2)).sum();
                if others.len() == PARTS {
                    jackknife(squares)
                } else {
                    f64::INFINITY
                }
            };
            Some(Margin {
                margin: Figure {
                    value,
                    sigma: sigma(|o| o.0, value),
                },
                hertz: Figure {
                    value: hertz,
                    sigma: sigma(|o| o.1, hertz),
                },
            })
        };
        Self {
            phase_margin: margin(phase_margin),
            gain_margin: margin(gain_margin),
            sensitivity_peak: margin(sensitivity_peak),
            points,
        }
    }
}

/// Standard deviation from the squared deviations of estimates without one of [`PARTS`] each.
fn jackknife(squares: f64) -> f64 {
    let parts = PARTS as f64;
    ((parts - 1.0) / parts * squares).sqrt()
}

/// The sensitivity at some frequencies: spectra are added up over the band up to the next one.
fn sensitivities(
    spectra: &Spectra,
    hertz: &[f64],
    without: Option<(usize, usize)>,
) -> Vec<Complex64> {
    let sums = spectra.sums(without);
    let half = 10_f64.powf(0.5 / PER_DECADE);
    hertz
        .iter()
        .map(|f| {
            let nearest = spectra.bin(*f).clamp(1, sums.len() - 1);
            let low = spectra.bin(f / half).clamp(1, nearest);
            let high = spectra.bin(f * half).clamp(nearest, sums.len() - 1);
            let (mut input, mut cross) = (0.0, Complex64::new(0.0, 0.0));
            for (xx, _, xy) in &sums[low..=high] {
                input += xx;
                cross += xy;
            }
            cross / input.max(f64::MIN_POSITIVE)
        })
        .collect()
}

fn opened(sensitivity: Complex64) -> Complex64 {
    (Complex64::new(1.0, 0.0) - sensitivity) / sensitivity
}

/// The points that are known, with a phase that does not jump.
fn points(hertz: &[f64], sensitivities: &[Complex64], unsure: &[f64]) -> Vec<LoopPoint> {
    let mut points: Vec<LoopPoint> = Vec::new();
    for ((hertz, sensitivity), unsure) in hertz.iter().zip(sensitivities).zip(unsure) {
        if !unsure.is_finite() || *unsure > UNSURE {
            continue;
        }
        let open = opened(*sensitivity);
        let mut phase = open.arg();
        match points.last() {
            Some(last) => phase -= ((phase - last.phase) / TAU).round() * TAU,
            // Between -3/2 pi and pi/2: an integral before a motor begins near -pi.
            None if phase > 0.5 * PI => phase -= TAU,
            None => {}
        }
        points.push(LoopPoint {
            hertz: *hertz,
            open,
            phase,
            unsure: *unsure,
        });
    }
    points
}

/// Where a value falls through zero between two points that are next to each other: the share of the way.
fn crossings<'p>(
    points: &'p [LoopPoint],
    value: impl Fn(&LoopPoint) -> f64 + 'p,
) -> impl Iterator<Item = (f64, &'p LoopPoint, &'p LoopPoint)> {
    points.windows(2).filter_map(move |pair| {
        let (before, after) = (value(&pair[0]), value(&pair[1]));
        let falls = before > 0.0 && after <= 0.0;
        falls.then(|| (before / (before - after), &pair[0], &pair[1]))
    })
}

fn between(share: f64, a: f64, b: f64) -> f64 {
    a + share * (b - a)
}

/// The least phase margin and its frequency.
fn phase_margin(points: &[LoopPoint]) -> Option<(f64, f64)> {
    crossings(points, |p| p.open.norm().ln())
        .map(|(s, a, b)| {
            (
                between(s, a.phase, b.phase) + PI,
                between(s, a.hertz, b.hertz),
            )
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The least gain margin above one and its frequency.
fn gain_margin(points: &[LoopPoint]) -> Option<(f64, f64)> {
    crossings(points, |p| p.phase + PI)
        .map(|(s, a, b)| {
            let gain = between(s, a.open.norm().ln(), b.open.norm().ln()).exp();
            (1.0 / gain, between(s, a.hertz, b.hertz))
        })
        .filter(|(margin, _)| *margin > 1.0)
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

fn sensitivity_peak(points: &[LoopPoint]) -> Option<(f64, f64)> {
    points
        .iter()
        .map(|p| (p.sensitivity(), p.hertz))
        .max_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 4e-4;

    /// A loop of an integral controller of the encoder's velocity: `gain / s` before a low pass and a delay, sampled.
    struct Known {
        gain: f64,
        decay: f64,
    }

    impl Known {
        /// `L` as the servo sees it: its error of this cycle acts in the next one.
        fn open(&self, hertz: f64) -> Complex64 {
            let one = Complex64::new(1.0, 0.0);
            let back = Complex64::from_polar(1.0, -TAU * hertz * PERIOD);
            let low_pass = (1.0 - self.decay) / (one - self.decay * back);
            self.gain * PERIOD * back * back / (one - back) * low_pass
        }

        /// Reference and position of the closed loop, with noise of the encoder, for so many cycles.
        fn play(&self, cycles: usize, seed: u64, noise: f64) -> [Vec<f64>; 2] {
            let mut state = seed;
            let mut random = || {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                (state >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
            };
            let (mut reference, mut position) = (Vec::new(), Vec::new());
            let (mut filtered, mut at, mut seen) = (0.0, 0.0, 0.0);
            for _ in 0..cycles {
                let wanted = random();
                at += self.gain * PERIOD * filtered;
                filtered = self.decay * filtered + (1.0 - self.decay) * (wanted - seen);
                seen = at + noise * random();
                reference.push(wanted);
                position.push(seen);
            }
            [reference, position]
        }
    }

    /// The margins of the known loop, by its formula on a fine grid.
    fn exact(known: &Known) -> [f64; 3] {
        let all: Vec<LoopPoint> = {
            let hertz: Vec<f64> = (0..40_000).map(|k| 1.0 + 0.01 * f64::from(k)).collect();
            let one = Complex64::new(1.0, 0.0);
            let sensitivities = hertz.iter().map(|f| one / (one + known.open(*f)));
            let sensitivities: Vec<Complex64> = sensitivities.collect();
            points(&hertz, &sensitivities, &vec![0.0; hertz.len()])
        };
        [phase_margin, gain_margin, sensitivity_peak].map(|find| find(&all).expect("has one").0)
    }

    #[test]
    fn margins_of_a_known_loop_are_found_as_surely_as_they_say() {
        const SEEDS: u64 = 12;
        let known = Known {
            gain: 300.0,
            decay: 0.8,
        };
        let exact = exact(&known);
        let mut squares = [0.0; 3];
        for seed in 1..=SEEDS {
            let [reference, encoder] = known.play(100_000, seed, 0.05);
            let found = OpenLoop::of(&reference, &encoder, PERIOD, 4096, 400.0);
            let all = [
                found.phase_margin,
                found.gain_margin,
                found.sensitivity_peak,
            ];
            for (k, margin) in all.into_iter().enumerate() {
                let margin = margin.expect("has one").margin;
                assert!(
                    (margin.value / exact[k] - 1.0).abs() < 0.05,
                    "seed {seed}, {k}: {margin:?} for {}",
                    exact[k]
                );
                squares[k] += ((margin.value - exact[k]) / margin.sigma).powi(2);
            }
        }
        // With eight parts a deviation is known to a quarter; the peak is the greatest of many, and a little high.
        for (k, sum) in squares.iter().enumerate() {
            let rms = (sum / SEEDS as f64).sqrt();
            assert!(
                (0.3..2.5).contains(&rms),
                "{k}: {rms} of the deviations that are stated"
            );
        }
    }

    #[test]
    fn a_loop_whose_phase_does_not_turn_has_no_gain_margin() {
        let known = Known {
            gain: 30.0,
            decay: 0.0,
        };
        let [reference, encoder] = known.play(100_000, 3, 0.0);
        let found = OpenLoop::of(&reference, &encoder, PERIOD, 4096, 300.0);
        assert_eq!(found.gain_margin, None);
        let margin = found.phase_margin.expect("has one").margin.value;
        assert!((margin.to_degrees() - 90.0).abs() < 3.0, "{margin}");
    }

    #[test]
    fn of_a_reference_that_nothing_answers_nothing_is_known() {
        let noise = Known {
            gain: 0.0,
            decay: 0.0,
        };
        let [reference, encoder] = noise.play(100_000, 4, 1.0);
        let found = OpenLoop::of(&reference, &encoder, PERIOD, 4096, 300.0);
        assert_eq!(found.phase_margin, None);
    }
}
