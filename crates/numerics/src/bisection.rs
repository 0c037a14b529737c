//! Bisection, and what takes fewer steps where a function is smooth.

use std::convert::Infallible;

/// Where between `low` and `high` a condition begins to hold: the bracket that is left of them after so many
/// halvings, at whose lower end it does not hold and at whose upper end it does. Neither end is asked.
pub fn onset(bracket: (f64, f64), halvings: u32, mut holds: impl FnMut(f64) -> bool) -> (f64, f64) {
    let Ok(found) = try_onset(bracket, halvings, |x| Ok::<_, Infallible>(holds(x)));
    found
}

/// The same of a condition that may fail to be asked.
///
/// # Errors
///
/// Those of `holds`.
pub fn try_onset<E>(
    (mut low, mut high): (f64, f64),
    halvings: u32,
    mut holds: impl FnMut(f64) -> Result<bool, E>,
) -> Result<(f64, f64), E> {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        if holds(middle)? {
            high = middle;
        } else {
            low = middle;
        }
    }
    Ok((low, high))
}

/// Where a continuous function is zero between two places, each given with its value there, of which one is above zero and one
/// below: to `accurate`, by parabolas through the last three places where these lie well, else by halvings.
///
/// # Source
///
/// T. R. Chandrupatla, "A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function without
/// using derivatives", Advances in Engineering Software 28, 145 (1997).
pub fn zero(
    (mut b, mut at_b): (f64, f64),
    (mut a, mut at_a): (f64, f64),
    accurate: f64,
    mut f: impl FnMut(f64) -> f64,
) -> f64 {
    let mut share = 0.5_f64;
    loop {
        // No nearer to an end than it is to be known: it is on either side of it then.
        let least = 0.5 * accurate / (b - a).abs();
        // What is no number is no bracket that could be made less.
        let wide = least < 0.5;
        if !wide || at_a == 0.0 {
            return if at_a.abs() < at_b.abs() { a } else { b };
        }
        let next = a + share.clamp(least, 1.0 - least) * (b - a);
        let at_next = f(next);
        let (c, at_c);
        if (at_next > 0.0) == (at_a > 0.0) {
            (c, at_c) = (a, at_a);
        } else {
            (c, at_c) = (b, at_b);
            (b, at_b) = (a, at_a);
        }
        (a, at_a) = (next, at_next);
        let (xi, phi) = ((a - b) / (c - b), (at_a - at_b) / (at_c - at_b));
        let lies_well = phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi;
        share = if lies_well {
            at_a / (at_b - at_a) * at_c / (at_b - at_c)
                + (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
        } else {
            0.5
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_is_found_in_few_steps() {
        for (end, f) in [
            (2.0, (|x| x * x * x - 2.0) as fn(f64) -> f64),
            (9.0, |x| (-x).exp() - 0.01),
            (1.0, |x| x - 0.25),
            (3.0, |x| if x < 1.3 { 1.0 } else { -1.0 }),
        ] {
            let mut asked = 0;
            let at = zero((0.0, f(0.0)), (end, f(end)), 1e-12, |x| {
                asked += 1;
                f(x)
            });
            let (before, after) = (f(at - 1e-12), f(at + 1e-12));
            assert!(before * after <= 0.0, "{at}: {before} {after}");
            assert!(asked <= 45, "{asked}");
            if (f(0.0) - f(1e-3)).abs() > 0.0 {
                assert!(asked <= 12, "{asked}");
            }
        }
        // Nothing lies between a place and itself.
        assert_eq!(zero((0.0, 1.0), (0.0, -1.0), 0.0, |_| 0.0), 0.0);
    }

    #[test]
    fn where_a_condition_begins_is_left_between_the_ends() {
        let (low, high) = onset((0.0, 5.0), 8, |x| x > 3.3);
        assert!(low <= 3.3 && 3.3 < high && high - low == 5.0 / 256.0);
        assert_eq!(try_onset((0.0, 1.0), 4, |_| Err("no")), Err("no"));
    }
}
