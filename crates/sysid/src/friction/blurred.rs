//! A displacement, or a force, that was averaged or filtered before it was written.
//!
//! What smooths a motion `x` makes `x + c x''` of it, beside a delay, with `c` a twenty-fourth of the square of a mean's length, or the
//! square of a lag: turns are cut off, alike at each of them, and a contact seems to give way over another way. A force that was smoothed
//! looks as a displacement does that was made sharper, with a `c` below zero. No batch of the record tells it; the law does, fitted with `c`.

use super::smooth::parabola;
use super::sure::{Other, by_other};
use super::tremble::reach;
use super::{Fitted, Record};

/// Makes laws less sure by what such a `c` makes of their parameters, where chance would make it tell so much more of the force once in ten
/// thousand times.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    let (samples, reach) = (&record.samples, reach(record));
    if !record.has_time || reach < 2 {
        return;
    }
    let span = 2.0 * reach as f64 * record.period();
    let bend: Vec<f64> = (0..samples.len())
        .map(|k| parabola(samples, k, reach).map_or(0.0, |p| p[2] * span * span))
        .collect();
    for fitted in laws {
        by_other(fitted, record, &[Other::Way(&bend)]);
    }
}
