//! What control believes of a fiber that it attaches.

use pigtail_numerics::bisection::onset;
use pigtail_numerics::statistics::outside;

/// Probability of being outside a tolerance from which on a fiber is not believed.
pub(crate) const UNSURE: f64 = 1e-4;

/// How well it is known where a fiber is beside its peak, along x and along y.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Across {
    /// Standard deviation of a normal error, metres...
    pub sigma: f64,
    /// ...and how far it may be off beside that: a drift that goes on or does not, metres.
    pub bound: f64,
}

impl Across {
    /// What is known to a standard deviation, metres.
    pub const fn of(sigma: f64) -> Self {
        Self { sigma, bound: 0.0 }
    }

    /// The same with all errors so many times as large.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self {
            sigma: factor * self.sigma,
            bound: factor * self.bound,
        }
    }

    /// Probability of an error beyond a tolerance (metres) along one of both axes.
    pub fn outside_along_an_axis(&self, tolerance: f64) -> f64 {
        outside(tolerance, 0.0, self.bound, self.sigma)
    }
}

/// Where an attached fiber is believed to be, from its peak and from the gap that was wanted.
///
/// In every direction there is a normal error, and one anywhere within a bound beside it: across, from the peak.
///
/// ```
/// # use pigtail_control::belief::{Across, Place};
/// let across = Across { sigma: 10e-9, bound: 0.0 };
/// let place = Place { across, off: 0.1e-6, bound: 0.5e-6, sigma: 0.0 };
/// let [x, _, z] = place.half_widths(0.95);
/// assert!((x - 19.6e-9).abs() < 0.1e-9);
/// // A bound that dominates is no normal deviate.
/// assert!((z - 0.475e-6).abs() < 1e-9);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// How well it is known in x, and in y.
    pub across: Across,
    /// Gap beyond the wanted one, metres...
    pub off: f64,
    /// ...with an error anywhere within this bound, metres...
    pub bound: f64,
    /// ...and a normal one of this standard deviation, metres.
    pub sigma: f64,
}

impl Place {
    /// Half widths of the intervals in x, y and z that hold the truth with a probability of `share`, metres; those in x
    /// and y lie around the peak, that in z around the gap that is believed.
    pub fn half_widths(&self, share: f64) -> [f64; 3] {
        let [x, y, z] = [
            (self.across.bound, self.across.sigma),
            (self.across.bound, self.across.sigma),
            (self.bound, self.sigma),
        ];
        [x, y, z].map(|(bound, sigma)| half_width(share, bound, sigma))
    }

    /// The least shares whose intervals hold the truth, x, y and gap beyond the wanted one (metres): even between 0 and
    /// 1 where the belief is right.
    pub fn levels(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        [
            1.0 - self.across.outside_along_an_axis(x.abs()),
            1.0 - self.across.outside_along_an_axis(y.abs()),
            1.0 - outside((z - self.off).abs(), 0.0, self.bound, self.sigma),
        ]
    }

    /// Probability that the fiber is farther off than `aside` in x or in y, or than `along` in its gap, metres.
    pub fn outside(&self, aside: f64, along: f64) -> f64 {
        let across = 2.0 * self.across.outside_along_an_axis(aside);
        (across + self.outside_along(along)).min(1.0)
    }

    /// Probability that its gap is farther off than a tolerance, metres.
    pub fn outside_along(&self, tolerance: f64) -> f64 {
        outside(tolerance, self.off, self.bound, self.sigma)
    }
}

fn half_width(share: f64, bound: f64, sigma: f64) -> f64 {
    /// Standard deviations beyond the bound that hold all shares that anyone asks for.
    const FAR: f64 = 9.0;
    /// Halvings: to a billionth.
    const HALVINGS: u32 = 40;
    let (_, holds) = onset((0.0, bound + FAR * sigma), HALVINGS, |half| {
        1.0 - outside(half, 0.0, bound, sigma) >= share
    });
    holds
}
