//! Spectra of two series, window by window.

use pigtail_numerics::fourier::{Complex64, Forward};
use std::f64::consts::TAU;

/// Spectra of input and output and between them, one frequency.
type Bin = (f64, f64, Complex64);

/// The spectra of each window: Hann windows that overlap by half, less their means.
#[derive(Debug)]
pub(super) struct Spectra {
    windows: Vec<Vec<Bin>>,
    bins: usize,
    window: usize,
    period: f64,
}

impl Spectra {
    /// Of `input` and `output` up to `highest` hertz.
    pub(super) fn of(
        input: &[f64],
        output: &[f64],
        period: f64,
        window: usize,
        highest: f64,
    ) -> Self {
        let fft = Forward::new(window);
        let hann: Vec<f64> = (0..window)
            .map(|k| 0.5 - 0.5 * (TAU * k as f64 / window as f64).cos())
            .collect();
        let bins = ((highest * window as f64 * period) as usize).min(window / 2);
        let transform = |part: &[f64]| {
            let mean = part.iter().sum::<f64>() / window as f64;
            let mut buffer: Vec<Complex64> = part
                .iter()
                .zip(&hann)
                .map(|(v, w)| Complex64::new((v - mean) * w, 0.0))
                .collect();
            fft.process(&mut buffer);
            buffer
        };
        let length = input.len().min(output.len());
        let mut windows = Vec::new();
        let mut start = 0;
        while start + window <= length {
            let x = transform(&input[start..start + window]);
            let y = transform(&output[start..start + window]);
            let of = |(x, y): (&Complex64, &Complex64)| (x.norm_sqr(), y.norm_sqr(), x.conj() * y);
            windows.push(x.iter().zip(&y).take(bins + 1).map(of).collect());
            start += window / 2;
        }
        Self {
            windows,
            bins,
            window,
            period,
        }
    }

    /// Their sums, from frequency zero on; `without` one of so many parts of the record, if said.
    pub(super) fn sums(&self, without: Option<(usize, usize)>) -> Vec<Bin> {
        let mut sums = vec![(0.0, 0.0, Complex64::new(0.0, 0.0)); self.bins + 1];
        let count = self.windows.len().max(1);
        for (k, window) in self.windows.iter().enumerate() {
            if without.is_some_and(|(part, parts)| k * parts / count == part) {
                continue;
            }
            for ((xx, yy, xy), (x, y, cross)) in sums.iter_mut().zip(window) {
                *xx += x;
                *yy += y;
                *xy += cross;
            }
        }
        sums
    }

    /// The frequency of a bin, hertz.
    pub(super) fn hertz(&self, bin: usize) -> f64 {
        bin as f64 / (self.window as f64 * self.period)
    }

    /// The bin next to a frequency.
    pub(super) fn bin(&self, hertz: f64) -> usize {
        (hertz * self.window as f64 * self.period).round() as usize
    }

    /// By how much a cycle turns the phase at a bin, radians.
    pub(super) fn turn(&self, bin: usize) -> f64 {
        TAU * bin as f64 / self.window as f64
    }
}
