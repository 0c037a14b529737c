//! What control believes of a fiber that it attaches.

use pigtail_numerics::bisection::onset;
use pigtail_numerics::statistics::outside;

/// Probability of being outside a tolerance from which on a fiber is not believed.
pub(crate) const UNSURE: f64 = 1e-4;

/// Where an attached fiber is believed to be, from its peak and from the gap that was wanted.
///
/// Across, it is a normal deviate around the peak; along z an error anywhere within a bound, and a normal one beside it.
///
/// ```
/// # use pigtail_control::belief::Place;
/// let place = Place { across: 10e-9, off: 0.1e-6, bound: 0.5e-6, sigma: 0.0 };
/// let [x, _, z] = place.half_widths(0.95);
/// assert!((x - 19.6e-9).abs() < 0.1e-9);
/// // A bound that dominates is no normal deviate.
/// assert!((z - 0.475e-6).abs() < 1e-9);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Standard deviation in x, and in y, metres.
    pub across: f64,
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
            (0.0, self.across),
            (0.0, self.across),
            (self.bound, self.sigma),
        ];
        [x, y, z].map(|(bound, sigma)| half_width(share, bound, sigma))
    }

    /// The least shares whose intervals hold the truth, x, y and gap beyond the wanted one (metres): even between 0 and
    /// 1 where the belief is right.
    pub fn levels(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        [
            1.0 - outside(x.abs(), 0.0, 0.0, self.across),
            1.0 - outside(y.abs(), 0.0, 0.0, self.across),
            1.0 - outside((z - self.off).abs(), 0.0, self.bound, self.sigma),
        ]
    }

    /// Probability that the fiber is farther off than `aside` in x or in y, or than `along` in its gap, metres.
    pub fn outside(&self, aside: f64, along: f64) -> f64 {
        let across = 2.0 * outside(aside, 0.0, 0.0, self.across);
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
