//! Bisection.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_a_condition_begins_is_left_between_the_ends() {
        let (low, high) = onset((0.0, 5.0), 8, |x| x > 3.3);
        assert!(low <= 3.3 && 3.3 < high && high - low == 5.0 / 256.0);
        assert_eq!(try_onset((0.0, 1.0), 4, |_| Err("no")), Err("no"));
    }
}
