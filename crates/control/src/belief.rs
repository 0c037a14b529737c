//! What control believes of a fiber that it attaches.

use crate::outcome::Outcome;
use crate::tuning::TUNING;
use pigtail_numerics::bisection::zero;
use pigtail_numerics::statistics::outside;

/// How well it is known where a fiber is beside its peak, along x and along y: a guide's mode is wider in x than in y, so that
/// light tells less of where a fiber is in x.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Across {
    /// Standard deviations of normal errors, metres...
    pub sigma: [f64; 2],
    /// ...and how far it may be off beside that: a drift that goes on or does not, metres.
    pub bound: [f64; 2],
    /// What of both no look at the light makes less, deviation and bound in x and in y, metres: how askew stages stand.
    pub askew: [(f64, f64); 2],
}

impl Across {
    /// What is known to one standard deviation along both, metres.
    pub const fn of(sigma: f64) -> Self {
        Self {
            sigma: [sigma; 2],
            bound: [0.0; 2],
            askew: [(0.0, 0.0); 2],
        }
    }

    /// What light tells along an axis, 0 or 1: variance of the normal error, square metres, and bound, metres.
    fn by_light(&self, axis: usize) -> (f64, f64) {
        let (sigma, bound) = self.askew[axis];
        let variance = self.sigma[axis].powi(2) - sigma * sigma;
        (variance.max(0.0), (self.bound[axis] - bound).max(0.0))
    }

    /// The same with what light tells known so many times as badly.
    #[must_use]
    pub fn seen(self, times: f64) -> Self {
        let of = |i: usize| {
            let ((variance, bound), askew) = (self.by_light(i), self.askew[i]);
            let sigma = (times * times * variance).sqrt().hypot(askew.0);
            (sigma, askew.1 + times * bound)
        };
        let of = [of(0), of(1)];
        Self {
            sigma: of.map(|(sigma, _)| sigma),
            bound: of.map(|(_, bound)| bound),
            ..self
        }
    }

    /// The same on stages that are known to stand square.
    #[must_use]
    pub fn on_square_stages(self) -> Self {
        let of = [self.by_light(0), self.by_light(1)];
        Self {
            sigma: of.map(|(variance, _)| variance.sqrt()),
            bound: of.map(|(_, bound)| bound),
            askew: [(0.0, 0.0); 2],
        }
    }

    /// The greater standard deviation, metres.
    pub fn worse(&self) -> f64 {
        self.sigma[0].max(self.sigma[1])
    }

    /// The greater standard deviation of the whole error, metres.
    pub fn deviation(&self) -> f64 {
        let of = |i: usize| self.sigma[i].hypot(self.bound[i] / 3.0_f64.sqrt());
        of(0).max(of(1))
    }

    /// The same with all errors so many times as large.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self {
            sigma: self.sigma.map(|sigma| factor * sigma),
            bound: self.bound.map(|bound| factor * bound),
            askew: self
                .askew
                .map(|(sigma, bound)| (factor * sigma, factor * bound)),
        }
    }

    /// Probability of an error beyond a tolerance (metres) along an axis, 0 or 1.
    pub fn outside_along(&self, axis: usize, tolerance: f64) -> f64 {
        outside(tolerance, 0.0, self.bound[axis], self.sigma[axis])
    }

    /// Probability of an error beyond a tolerance (metres) along x or along y, at most.
    pub fn outside(&self, tolerance: f64) -> f64 {
        (self.outside_along(0, tolerance) + self.outside_along(1, tolerance)).min(1.0)
    }

    /// That an error beyond a tolerance is all but impossible; of what is known the tip's `shaking` is a part (metres).
    ///
    /// # Errors
    ///
    /// [`Outcome::UnsurePlace`].
    pub fn is_sure(&self, tolerance: f64, shaking: f64) -> Result<(), Outcome> {
        self.is_within((tolerance, self.outside(tolerance)), shaking)
    }

    /// The same with that probability as somebody else has told it.
    pub(crate) fn is_within(
        &self,
        (tolerance, probability): (f64, f64),
        shaking: f64,
    ) -> Result<(), Outcome> {
        if probability <= TUNING.bond.unsure {
            return Ok(());
        }
        Err(Outcome::UnsurePlace {
            deviation: self.worse(),
            askew: self.askew[0].0.max(self.askew[1].0),
            bound: self.bound[0].max(self.bound[1]),
            rises: self.askew[0].1.max(self.askew[1].1),
            shaking,
            tolerance,
            probability,
            accepted: TUNING.bond.unsure,
        })
    }
}

/// How well the place of a peak is known, twice: a fiber is attached by what its errors may be, and what is said of it is what they are
/// expected to be. Where few samples tell how large an error is, the former takes the larger ones that they admit and a bound as it
/// stands: of a sum of such parts a probability of 1e-4 is none that is too small, and an interval of one half holds more than a half.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// At most so badly: by it is decided.
    pub at_most: Across,
    /// As badly as it is expected: by it is told.
    pub expected: Across,
}

/// Where an attached fiber is believed to be, from its peak and from the gap that was wanted.
///
/// In every direction there is a normal error, and one anywhere within a bound beside it: across, from the peak.
///
/// ```
/// # use pigtail_control::belief::{Across, Place};
/// let across = Across { sigma: [10e-9, 5e-9], ..Across::default() };
/// let place = Place { across, off: 0.1e-6, bound: 0.5e-6, sigma: 0.0 };
/// let [x, y, z] = place.half_widths(0.95);
/// assert!((x - 19.6e-9).abs() < 0.1e-9);
/// assert!((y - 9.8e-9).abs() < 0.1e-9);
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
        let Across { sigma, bound, .. } = self.across;
        [
            (bound[0], sigma[0]),
            (bound[1], sigma[1]),
            (self.bound, self.sigma),
        ]
        .map(|(bound, sigma)| half_width(share, bound, sigma))
    }

    /// The least shares whose intervals hold the truth, x, y and gap beyond the wanted one (metres): even between 0 and
    /// 1 where the belief is right.
    pub fn levels(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        [
            1.0 - self.across.outside_along(0, x.abs()),
            1.0 - self.across.outside_along(1, y.abs()),
            1.0 - outside((z - self.off).abs(), 0.0, self.bound, self.sigma),
        ]
    }

    /// Probability that the fiber is farther off than `aside` in x or in y, or than `along` in its gap, metres.
    pub fn outside(&self, aside: f64, along: f64) -> f64 {
        (self.across.outside(aside) + self.outside_along(along)).min(1.0)
    }

    /// Probability that its gap is farther off than a tolerance, metres.
    pub fn outside_along(&self, tolerance: f64) -> f64 {
        outside(tolerance, self.off, self.bound, self.sigma)
    }

    /// That its gap is all but certainly no farther off than a tolerance, metres.
    pub(crate) fn sure_along(&self, tolerance: f64) -> Result<(), Outcome> {
        let probability = self.outside_along(tolerance);
        if probability <= TUNING.bond.unsure {
            return Ok(());
        }
        Err(Outcome::UnsureGap {
            off: self.off,
            bound: self.bound,
            sigma: self.sigma,
            tolerance,
            probability,
            accepted: TUNING.bond.unsure,
        })
    }
}

fn half_width(share: f64, bound: f64, sigma: f64) -> f64 {
    /// Standard deviations beyond the bound that hold all shares that anyone asks for.
    const FAR: f64 = 9.0;
    /// How well it is known, as a share of that.
    const ACCURATE: f64 = 1e-12;
    let far = bound + FAR * sigma;
    let missing = |half: f64| outside(half, 0.0, bound, sigma) - (1.0 - share);
    zero((0.0, share), (far, share - 1.0), ACCURATE * far, missing)
}
