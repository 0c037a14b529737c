//! What two rooms would otherwise write twice: least squares, filters, statistics, one-dimensional search.
//!
//! In go columns of numbers, out come numbers and what is known of their uncertainty. Nothing here knows
//! what the numbers mean.
//!
//! - [`regression`]: linear least squares, weighted and with instruments; [`nonlinear`]: Levenberg and
//!   Marquardt's method with a Jacobian by differences; [`normal`]: both for a few unknowns, many times;
//! - [`signal`]: filters without delay, derivatives, decimation, quantiles; [`fourier`]: the transform;
//! - [`mod@line`]: the straight line through points; [`golden`]: golden section; [`bisection`]: where a condition
//!   begins to hold; [`statistics`]: percentiles, Wilson's interval.
//!
//! Start with [`regression`].
//!
//! ```
//! use pigtail_numerics::regression::{least_squares, matrix};
//!
//! // y = 2 x + 1, in three points: both parameters to the last digit.
//! let x = matrix(&[&[0.0, 1.0, 2.0], &[1.0, 1.0, 1.0]]);
//! let solution = least_squares(&x, &[1.0, 3.0, 5.0]).expect("two columns that differ");
//! assert!((solution.values[0] - 2.0).abs() < 1e-12);
//! assert!((solution.values[1] - 1.0).abs() < 1e-12);
//! ```

mod batches;
pub mod bisection;
pub mod fourier;
pub mod golden;
pub mod line;
pub mod nonlinear;
pub mod normal;
pub mod regression;
pub mod signal;
pub mod statistics;

/// `value` to a whole multiple of `unit`, so that a document shows no digits without meaning.
///
/// ```
/// assert_eq!(pigtail_numerics::rounded(0.123_456, 1e-3), 0.123);
/// ```
pub fn rounded(value: f64, unit: f64) -> f64 {
    let per_unit = (1.0 / unit).round();
    // Adding zero turns -0 into 0.
    (value * per_unit).round() / per_unit + 0.0
}
