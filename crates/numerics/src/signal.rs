//! Filters without delay, derivatives and decimation of sampled signals.
//!
//! A record is there whole before anything is computed of it, so a filter may run over it forwards
//! and then backwards: its delay cancels, its attenuation doubles.

use std::f64::consts::PI;

/// A second-order section in transposed direct form II, one at zero frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

impl Section {
    /// State in which a constant input of one has been there for ever.
    fn settled(&self) -> [f64; 2] {
        let gain = (self.b[0] + self.b[1] + self.b[2]) / (1.0 + self.a[0] + self.a[1]);
        let second = self.b[2] - self.a[1] * gain;
        [self.b[1] - self.a[0] * gain + second, second]
    }

    fn gain(&self) -> f64 {
        (self.b[0] + self.b[1] + self.b[2]) / (1.0 + self.a[0] + self.a[1])
    }
}

/// A digital low-pass filter by the bilinear transformation.
#[derive(Debug, Clone, PartialEq)]
pub struct Lowpass {
    sections: Vec<Section>,
    order: usize,
}

impl Lowpass {
    /// Butterworth's, with its cutoff (3 dB) at a share of the Nyquist frequency between 0 and 1.
    pub fn butterworth(order: usize, cutoff: f64) -> Self {
        Self::from_poles(order, cutoff, 1.0, |angle| (-angle.sin(), angle.cos()))
    }

    /// Chebyshev's of the first kind, with `ripple` decibels below one in the passband.
    pub fn chebyshev(order: usize, ripple: f64, cutoff: f64) -> Self {
        let epsilon = (10.0_f64.powf(0.1 * ripple) - 1.0).sqrt();
        let mu = (1.0 / epsilon).asinh() / order as f64;
        // At zero frequency an even order is at the bottom of its ripple.
        let gain = if order.is_multiple_of(2) {
            1.0 / (1.0 + epsilon * epsilon).sqrt()
        } else {
            1.0
        };
        Self::from_poles(order, cutoff, gain, |angle| {
            (-mu.sinh() * angle.sin(), mu.cosh() * angle.cos())
        })
    }

    fn from_poles(order: usize, cutoff: f64, gain: f64, pole: impl Fn(f64) -> (f64, f64)) -> Self {
        let warped = 2.0 * (0.5 * PI * cutoff).tan();
        let mut sections = Vec::with_capacity(order.div_ceil(2));
        for k in 0..order.div_ceil(2) {
            let (re, im) = pole(PI * (2 * k + 1) as f64 / (2 * order) as f64);
            let (re, im) = (warped * re, warped * im);
            // z = (2 + s) / (2 - s)
            let below = (2.0 - re).powi(2) + im * im;
            let (x, y) = ((4.0 - re * re - im * im) / below, 4.0 * im / below);
            sections.push(if 2 * k + 1 == order {
                let a = -x;
                let scale = 0.5 * (1.0 + a);
                Section {
                    b: [scale, scale, 0.0],
                    a: [a, 0.0],
                }
            } else {
                let a = [-2.0 * x, x * x + y * y];
                let scale = 0.25 * (1.0 + a[0] + a[1]);
                Section {
                    b: [scale, 2.0 * scale, scale],
                    a,
                }
            });
        }
        if let Some(first) = sections.first_mut() {
            first.b = first.b.map(|b| b * gain);
        }
        Self { sections, order }
    }

    /// Forwards and backwards over a signal, whose ends are continued by turning it about them.
    pub fn both_ways(&self, signal: &[f64]) -> Vec<f64> {
        let pad = self.pad(signal.len());
        let mut filtered = self.beside(signal.len(), |k| [signal[k]]).into_flattened();
        filtered.truncate(pad + signal.len());
        filtered.drain(..pad);
        filtered
    }

    /// How far a signal is continued at either end.
    fn pad(&self, samples: usize) -> usize {
        (3 * self.order).min(samples.saturating_sub(1))
    }

    /// Signals side by side, forwards and backwards, with what they are continued by: a step of a filter waits for the one before it, and
    /// other signals' steps fill the time.
    fn beside<const N: usize>(
        &self,
        samples: usize,
        of: impl Fn(usize) -> [f64; N],
    ) -> Vec<[f64; N]> {
        let Some(end) = samples.checked_sub(1) else {
            return Vec::new();
        };
        let pad = self.pad(samples);
        let (first, last) = (of(0), of(end));
        let turned = |about: &[f64; N], k: usize| {
            let signal = of(k);
            std::array::from_fn(|j| 2.0 * about[j] - signal[j])
        };
        let mut all: Vec<[f64; N]> = Vec::with_capacity(samples + 2 * pad);
        all.extend((1..=pad).rev().map(|k| turned(&first, k)));
        all.extend((0..samples).map(&of));
        all.extend((1..=pad).map(|k| turned(&last, end - k)));
        for backward in [false, true] {
            self.run(&mut all, backward);
        }
        all
    }

    /// One way over signals, from the state in which their first values have been there for ever.
    fn run<const N: usize>(&self, signal: &mut [[f64; N]], backward: bool) {
        let first = if backward {
            signal.last()
        } else {
            signal.first()
        };
        let Some(mut start) = first.copied() else {
            return;
        };
        // Sections that follow each other go over the signal together.
        let (four, rest) = self.sections.as_chunks::<4>();
        for sections in four {
            start = together(sections, signal, backward, start);
        }
        let (two, one) = rest.as_chunks::<2>();
        for sections in two {
            start = together(sections, signal, backward, start);
        }
        for section in one {
            start = together(&[*section], signal, backward, start);
        }
    }
}

/// Some sections over signals; what a constant of `start` is after them.
fn together<const S: usize, const N: usize>(
    sections: &[Section; S],
    signal: &mut [[f64; N]],
    backward: bool,
    mut start: [f64; N],
) -> [f64; N] {
    let mut states = sections.map(|section| {
        let state = section.settled().map(|s| start.map(|v| s * v));
        start = start.map(|v| v * section.gain());
        state
    });
    let step = |values: &mut [f64; N]| {
        for (Section { b, a }, [one, two]) in sections.iter().zip(&mut states) {
            for j in 0..N {
                let out = b[0] * values[j] + one[j];
                one[j] = b[1] * values[j] - a[0] * out + two[j];
                two[j] = b[2] * values[j] - a[1] * out;
                values[j] = out;
            }
        }
    };
    if backward {
        signal.iter_mut().rev().for_each(step);
    } else {
        signal.iter_mut().for_each(step);
    }
    start
}

/// Central differences of a signal sampled every `period` seconds; the ends repeat their neighbours.
pub fn derivative(signal: &[f64], period: f64) -> Vec<f64> {
    let n = signal.len();
    if n < 3 {
        return vec![0.0; n];
    }
    let inside = |k: usize| (signal[k + 1] - signal[k - 1]) / (2.0 * period);
    (0..n).map(|k| inside(k.clamp(1, n - 2))).collect()
}

/// Every `factor`th sample, after a Chebyshev filter of order 8 at 0.8 of the new Nyquist frequency
/// has been over the signal both ways. The last sample is among them.
pub fn decimate(signal: &[f64], factor: usize) -> Vec<f64> {
    let [thin] = decimate_beside(signal.len(), factor, |k| [signal[k]]);
    thin
}

/// The same of signals side by side, of whose samples there are so many: two cost hardly more than one.
pub fn decimate_beside<const N: usize>(
    samples: usize,
    factor: usize,
    of: impl Fn(usize) -> [f64; N],
) -> [Vec<f64>; N] {
    if factor <= 1 {
        return std::array::from_fn(|j| (0..samples).map(|k| of(k)[j]).collect());
    }
    let filter = Lowpass::chebyshev(8, 0.05, 0.8 / factor as f64);
    let pad = filter.pad(samples);
    let filtered = filter.beside(samples, of);
    let first = (samples + factor - 1) % factor;
    std::array::from_fn(|j| {
        let own = (first..samples).step_by(factor);
        own.map(|k| filtered[pad + k][j]).collect()
    })
}

/// Autocorrelation of a signal less its mean at lags of 0 to `lags` samples; one at lag zero.
pub fn autocorrelation(signal: &[f64], lags: usize) -> Vec<f64> {
    autocorrelations(signal, lags).collect()
}

/// The same, one lag after the other.
pub(crate) fn autocorrelations(signal: &[f64], lags: usize) -> impl Iterator<Item = f64> {
    let n = signal.len();
    let mean = signal.iter().sum::<f64>() / n.max(1) as f64;
    let power: f64 = signal.iter().map(|v| (v - mean).powi(2)).sum();
    (0..=lags.min(n.saturating_sub(1))).map(move |lag| {
        let together: f64 = signal
            .iter()
            .zip(&signal[lag..])
            .map(|(a, b)| (a - mean) * (b - mean))
            .sum();
        if power > 0.0 { together / power } else { 0.0 }
    })
}

/// How many values of their own tell as much as these, whose neighbours go together.
pub fn independent(values: &[f64]) -> f64 {
    let together = autocorrelation(values, 1);
    let next = together.last().copied().unwrap_or(0.0).clamp(0.0, 0.999);
    values.len() as f64 * (1.0 - next) / (1.0 + next)
}

/// Root mean square.
pub fn rms(signal: impl IntoIterator<Item = f64>) -> f64 {
    let (mut squares, mut n) = (0.0, 0.0);
    for value in signal {
        squares += value * value;
        n += 1.0;
    }
    if n > 0.0 { f64::sqrt(squares / n) } else { 0.0 }
}

/// The value below which `share` of the values lie.
pub fn quantile(values: &[f64], share: f64) -> f64 {
    let [value] = quantiles(values.to_vec(), [share]);
    value
}

/// The values below which these shares of values lie that nobody needs any more: there may be many of them.
pub fn quantiles<const N: usize>(mut values: Vec<f64>, shares: [f64; N]) -> [f64; N] {
    values.retain(|v| v.is_finite());
    shares.map(|share| {
        if values.is_empty() {
            return 0.0;
        }
        let k = ((values.len() - 1) as f64 * share) as usize;
        *values.select_nth_unstable_by(k, f64::total_cmp).1
    })
}

/// A column between its samples, by the cubic through two of them with the slopes there.
pub fn between(column: &[f64], place: f64) -> f64 {
    let n = column.len().cast_signed();
    let k = (place.floor() as isize).clamp(0, n - 1);
    let f = place - k as f64;
    let v = |i: isize| column[(k + i).clamp(0, n - 1).cast_unsigned()];
    let (b, c) = (v(0), v(1));
    // To the sixth order: a difference of two neighbours makes a fifteenth too little of a slope that has ten samples a cycle. At the ends
    // a column is too short for that.
    let slope = |i: isize| {
        let pair = |by: isize| v(i + by) - v(i - by);
        if (3..n - 3).contains(&(k + i)) {
            (45.0 * pair(1) - 9.0 * pair(2) + pair(3)) / 60.0
        } else {
            0.5 * pair(1)
        }
    };
    let (slope0, slope1) = (slope(0), slope(1));
    let (p, q) = (c - b - slope0, slope1 - slope0);
    let f = f.clamp(0.0, 1.0);
    b + f * (slope0 + f * (3.0 * p - q + f * (q - 2.0 * p)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Magnitude of one way at a share of the Nyquist frequency, from what both ways leave of a sine.
    fn passes(filter: &Lowpass, frequency: f64) -> f64 {
        let wave: Vec<f64> = (0..4000)
            .map(|k| (PI * frequency * f64::from(k)).sin())
            .collect();
        let passed = filter.both_ways(&wave);
        (rms(passed[1000..3000].iter().copied()) / rms(wave[1000..3000].iter().copied())).sqrt()
    }

    #[test]
    fn a_butterworth_is_flat_and_halves_the_power_at_its_cutoff() {
        for order in 1..=6_u8 {
            let filter = Lowpass::butterworth(usize::from(order), 0.2);
            let half = 0.5_f64.sqrt();
            assert!((passes(&filter, 0.2) - half).abs() < 1e-3, "order {order}");
            // |H|^2 = 1 / (1 + (tan / tan_c)^2n)
            let at = 0.35;
            let ratio = (0.5 * PI * at).tan() / (0.5 * PI * 0.2).tan();
            let exact = 1.0 / (1.0 + ratio.powi(2 * i32::from(order))).sqrt();
            assert!((passes(&filter, at) - exact).abs() < 2e-3, "order {order}");
        }
    }

    #[test]
    fn a_chebyshev_stays_within_its_ripple() {
        let filter = Lowpass::chebyshev(8, 0.05, 0.08);
        for k in 1..=38 {
            let decibels = 20.0 * passes(&filter, 0.002 * f64::from(k)).log10();
            assert!((-0.06..0.01).contains(&decibels), "{k}: {decibels}");
        }
        assert!(passes(&filter, 0.16) < 1e-2);
    }

    #[test]
    fn both_ways_delay_nothing_and_keep_straight_lines() {
        let filter = Lowpass::butterworth(4, 0.1);
        let line: Vec<f64> = (0..500).map(|k| 3.0 + 0.1 * f64::from(k)).collect();
        // Near the ends the filter still settles.
        for (a, b) in filter.both_ways(&line)[200..300].iter().zip(&line[200..]) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
        let slope = derivative(&line, 0.1);
        assert!(slope.iter().all(|s| (s - 1.0).abs() < 1e-9));
        assert_eq!(decimate(&line, 10).len(), 50);
    }
}
