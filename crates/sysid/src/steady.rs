//! Whether the parts of a record say the same, beyond what each of them knows.
//!
//! What no model has, a gain that drifts with the temperature, a friction that wears in, a load that changes, shows there, whatever it is:
//! parts differ by more than they say of themselves. A parameter that was another one in each part of a record is known from it no better
//! than these differ.

/// Standard deviations by which something differs that chance makes differ once in ten thousand times, to one side.
pub(crate) const SURE: f64 = 3.72;

/// What a chi-squared of so many degrees of freedom exceeds once in ten thousand times (E. Wilson and M. Hilferty, *The
/// distribution of chi-square*, 1931).
pub(crate) fn chi_squared(freedom: f64) -> f64 {
    const NORMAL: f64 = 3.719;
    let part = 2.0 / (9.0 * freedom);
    freedom * (1.0 - part + NORMAL * part.sqrt()).powi(3)
}

/// The deviation between parts, each a value and its own deviation, beyond the latter (R. `DerSimonian` and N. Laird, *Meta-analysis
/// in clinical trials*, 1986). Zero where chance makes them differ so much more than once in ten thousand times.
pub(crate) fn between(parts: &[(f64, f64)]) -> f64 {
    let weights = || parts.iter().map(|(_, std)| 1.0 / (std * std));
    let all: f64 = weights().sum();
    let freedom = parts.len() as f64 - 1.0;
    if freedom < 1.0 || !all.is_finite() {
        return 0.0;
    }
    let mean = weights().zip(parts).map(|(w, p)| w * p.0).sum::<f64>() / all;
    let squares: f64 = weights()
        .zip(parts)
        .map(|(w, p)| w * (p.0 - mean).powi(2))
        .sum();
    if squares <= chi_squared(freedom) {
        return 0.0;
    }
    let own = all - weights().map(|w| w * w).sum::<f64>() / all;
    ((squares - freedom) / own).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_differ_by_what_they_say_are_alike_and_others_differ_by_the_rest() {
        let of = |apart: f64| -> Vec<(f64, f64)> {
            [-1.0, -0.6, 0.1, 0.7, 1.2, -0.4]
                .map(|k| (5.0 + apart * k, 0.1))
                .to_vec()
        };
        assert_eq!(between(&of(0.1)), 0.0);
        // Their squares' sum is 3.46 over five degrees of freedom, of which 0.01 is each one's own.
        assert!((between(&of(1.0)) - 0.682_f64.sqrt()).abs() < 1e-9);
        assert_eq!(between(&of(1.0)[..1]), 0.0);
    }
}
