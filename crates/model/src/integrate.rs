//! Numerics for locating an event inside an integration step.
//!
//! A stick-slip body changes its equations of motion at instants that fall inside a step. Wrong
//! by a fraction of the step, those instants cost micrometres; found as roots on what
//! the step has interpolated, they cost nothing but a few evaluations in the rare steps that contain one.

/// How closely [`descent`] finds a root, seconds.
const ROOT_TOLERANCE: f64 = 1e-12;

/// Newton's method squares its error: after a step this small, seconds, what is left is below the
/// tolerance.
pub(crate) const LAST_STEP: f64 = 1e-7;

/// When a quantity that starts at `start >= 0` with slope `rate` and is negative at
/// `end = (time, value, slope)` reached zero.
///
/// `at` gives its value and slope at a time. Newton's method from the root of the cubic through
/// what is known, kept inside a shrinking bracket. Where the quantity starts at zero and rises
/// first, the root found is the later one.
pub fn descent(
    mut at: impl FnMut(f64) -> (f64, f64),
    start: (f64, f64),
    end: (f64, f64, f64),
) -> f64 {
    let (mut low, mut high) = (0.0, end.0);
    let mut time = first_guess(start, end);
    for _ in 0..60 {
        if !(time > low && time < high) {
            time = 0.5 * (low + high);
        }
        let (value, slope) = at(time);
        let newton = value / slope;
        // No branch: which side it is on nobody can foresee.
        low = if value >= 0.0 { time } else { low };
        high = if value >= 0.0 { high } else { time };
        time -= newton;
        let found = newton.abs() < LAST_STEP && time >= low && time <= high;
        if found || high - low < ROOT_TOLERANCE {
            return time.clamp(low, high);
        }
    }
    time
}

/// Steps of Newton's method towards the root of a cubic.
const GUESSES: usize = 1;

/// The root at which the cubic with these values and slopes at the ends falls, nearly.
fn first_guess((start, rate): (f64, f64), (length, value, slope): (f64, f64, f64)) -> f64 {
    // The root of the parabola without the slope at the end.
    let (rate, slope, rise) = (rate * length, slope * length, value - start);
    let bend = rise - rate;
    let root = (rate * rate - 4.0 * bend * start).max(0.0).sqrt();
    let mut s = if rate > 0.0 {
        (rate + root) / (-2.0 * bend)
    } else {
        2.0 * start / (root - rate)
    };
    let a = rate + slope - 2.0 * rise;
    let b = 3.0 * rise - 2.0 * rate - slope;
    for _ in 0..GUESSES {
        let falls = rate + s * (2.0 * b + 3.0 * s * a);
        s -= (start + s * (rate + s * (b + s * a))) / falls;
    }
    s * length
}

/// Where the cubic with values `g0`, `g1` and slopes `d0`, `d1` at the ends of a step of length
/// `h` has its minimum, if that lies strictly inside. Returns `(time, value)`.
///
/// Serves to notice a quantity that dips below zero and comes back within one step.
pub fn interior_minimum(g0: f64, d0: f64, g1: f64, d1: f64, h: f64) -> Option<(f64, f64)> {
    if !(d0 < 0.0 && d1 > 0.0) {
        return None;
    }
    // g(s) on s in [0, 1]: g0 + d0 h s + b s^2 + a s^3.
    let (d0h, d1h) = (d0 * h, d1 * h);
    let rise = g1 - g0;
    let a = d0h + d1h - 2.0 * rise;
    let b = 3.0 * rise - 2.0 * d0h - d1h;
    // Root of the slope d0h + 2 b s + 3 a s^2 at which the curvature is positive.
    let discriminant = (b * b - 3.0 * a * d0h).max(0.0).sqrt();
    let s = if b + discriminant > 0.0 {
        -d0h / (b + discriminant)
    } else {
        return None;
    };
    if !(s > 0.0 && s < 1.0) {
        return None;
    }
    Some((s * h, g0 + s * (d0h + s * (b + s * a))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_descent_of_smooth_and_flat_functions() {
        let cubic = |t: f64| (1.0 - t * t * t, -3.0 * t * t);
        let root = descent(cubic, (1.0, 0.0), (3.0, cubic(3.0).0, cubic(3.0).1));
        assert!((root - 1.0).abs() < 1e-13);
        let flat = |t: f64| ((1.0 - t).powi(5), -5.0 * (1.0 - t).powi(4));
        let root = descent(flat, (1.0, -5.0), (1.7, flat(1.7).0, flat(1.7).1));
        assert!((root - 1.0).abs() < 1e-3, "{root}");
        // Rises from zero before it falls: not the root at the start.
        let arch = |t: f64| (t * (1.0 - t), 1.0 - 2.0 * t);
        let root = descent(arch, (0.0, 1.0), (1.5, arch(1.5).0, arch(1.5).1));
        assert!((root - 1.0).abs() < 1e-13);
    }

    #[test]
    fn sees_a_dip_inside_a_step() {
        // g(t) = (t - 1)^2 - 0.1 over [0, 2]
        let (t, g) = interior_minimum(0.9, -2.0, 0.9, 2.0, 2.0).unwrap();
        assert!((t - 1.0).abs() < 1e-12 && (g + 0.1).abs() < 1e-12);
        assert!(interior_minimum(0.9, 1.0, 0.9, 2.0, 2.0).is_none());
    }
}
