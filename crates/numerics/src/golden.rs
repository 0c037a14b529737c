//! Golden section.

/// Where a function with a single minimum between `low` and `high` is least, to `accurate`. One
/// evaluation a step: each reuses the inner point of the one before.
pub fn least((mut low, mut high): (f64, f64), accurate: f64, f: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (mut a, mut b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    while high - low > accurate {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - GOLDEN * (high - low);
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + GOLDEN * (high - low);
            at_b = f(b);
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_is_found_wherever_it_is() {
        for at in [-1.0, -0.3, 0.0, 0.7, 2.0] {
            let found = least((-1.0, 2.0), 1e-6, |x| (x - at) * (x - at));
            assert!((found - at).abs() < 1e-6, "{found} for {at}");
        }
    }
}
