//! What two rooms would otherwise write twice: least squares, filters, statistics, one-dimensional search.
//!
//! - [`regression`]: linear least squares, weighted and with instruments, with what is known of its uncertainty;
//! - [`normal`]: the same for a few unknowns, many times, and Levenberg and Marquardt's method upon it;
//! - [`nonlinear`]: that method with a Jacobian by differences;
//! - [`signal`]: filters without delay, derivatives, decimation, quantiles;
//! - [`golden`]: golden section; [`statistics`]: percentiles, Wilson's interval.

pub mod golden;
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
