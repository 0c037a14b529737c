//! The discrete Fourier transform.

pub use rustfft::num_complex::Complex64;
use std::sync::Arc;

/// The forward transform of signals of one length, planned once.
///
/// ```
/// use pigtail_numerics::fourier::{Complex64, Forward};
///
/// // One period of a cosine: half of it at the first frequency, half at minus the first.
/// let mut values = [1.0, 0.0, -1.0, 0.0].map(|v| Complex64::new(v, 0.0));
/// Forward::new(4).process(&mut values);
/// assert!((values[1].re - 2.0).abs() < 1e-15 && (values[3].re - 2.0).abs() < 1e-15);
/// ```
#[derive(Clone)]
pub struct Forward(Arc<dyn rustfft::Fft<f64>>);

impl Forward {
    /// For signals of `length` samples.
    pub fn new(length: usize) -> Self {
        Self(rustfft::FftPlanner::new().plan_fft_forward(length))
    }

    /// `values[k]` becomes the sum over `n` of `values[n] exp(-2 pi i k n / length)`.
    ///
    /// # Panics
    ///
    /// When the length of `values` is not a multiple of the planned one.
    pub fn process(&self, values: &mut [Complex64]) {
        self.0.process(values);
    }
}
