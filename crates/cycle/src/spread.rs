//! How far something differs each time, by what is believed beforehand and by what was seen of it.
//!
//! The standard deviation is believed beforehand to lie about a median on a logarithmic scale, as what makers state does; what is stated
//! afterwards is the root of its mean square by what was seen.

use serde::{Deserialize, Serialize};

/// What was seen once.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    /// How far it differed.
    pub by: f64,
    /// Standard deviation of that, as it was measured.
    pub sigma: f64,
    /// How many times the variance of one is in it.
    pub times: f64,
}

/// A standard deviation that is learned.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    median: f64,
    /// Standard deviation of its natural logarithm.
    differs: f64,
    seen: Vec<Seen>,
}

impl Spread {
    /// One that is believed to lie about a median, give or take so much of its natural logarithm.
    pub fn about(median: f64, differs: f64) -> Self {
        Self {
            median,
            differs,
            seen: Vec::new(),
        }
    }

    /// It was seen once more.
    pub fn learn(&mut self, seen: Seen) {
        self.seen.push(seen);
    }

    /// Mean of its square, by what was seen.
    pub fn square(&self) -> f64 {
        /// Standard deviations that are tried, from as many spreads below the median to as many above.
        const TRIED: i32 = 200;
        const SPREADS: f64 = 5.0;
        let tried = (-TRIED..=TRIED).map(|k| {
            let away = SPREADS * f64::from(k) / f64::from(TRIED);
            let square = (self.median * (self.differs * away).exp()).powi(2);
            let told = self.seen.iter().map(|seen| {
                let variance = square * seen.times + seen.sigma * seen.sigma;
                variance.ln() + seen.by * seen.by / variance
            });
            (square, -0.5 * (away * away + told.sum::<f64>()))
        });
        let tried: Vec<(f64, f64)> = tried.collect();
        let most = tried.iter().fold(f64::NEG_INFINITY, |m, t| m.max(t.1));
        let (sum, all) = tried.iter().fold((0.0, 0.0), |(sum, all), (square, ln)| {
            let weight = (ln - most).exp();
            (sum + weight * square, all + weight)
        });
        sum / all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_comes_to_what_was_seen_and_noise_is_no_part_of_it() {
        let seen = |by: f64, sigma: f64, times: f64| {
            let mut spread = Spread::about(0.02, 0.7);
            for k in 0..200 {
                let by = if k % 2 == 0 { by } else { -by };
                spread.learn(Seen { by, sigma, times });
            }
            spread.square().sqrt()
        };
        for by in [4e-3, 2e-2, 8e-2] {
            assert!((seen(by, 1e-5, 1.0) / by - 1.0).abs() < 0.1);
            // Of four together each is half of it.
            assert!((seen(by, 1e-5, 4.0) / by - 0.5).abs() < 0.1);
        }
        assert!(seen(0.02, 0.02, 1.0) < 0.01);
    }

    #[test]
    fn beforehand_it_is_the_mean_square_of_what_is_believed() {
        let (median, differs) = (0.02, 0.7);
        let believed = Spread::about(median, differs).square().sqrt();
        let mean = median * f64::exp(differs * differs);
        assert!((believed / mean - 1.0).abs() < 0.02);
    }
}
