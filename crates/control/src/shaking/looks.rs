//! How probable each deviation of a tip is by what was seen of it, of all that are looked at.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::{Measured, Turns, USUAL};
use crate::tuning::TUNING;
use pigtail_model::exponential::{exp, ln};
use pigtail_model::instructions::Work;

/// Deviations that are looked at, metres, and how many of them beside the first.
const LEAST_LOOKED: f64 = 0.3e-9;
const MOST_LOOKED: f64 = 150e-9;
const LOOKED: usize = 128;

/// Steps for each standard deviation of the noise that are looked at, of three on either side.
const STEPS: f64 = 2.0;
const NOISES: usize = 13;

/// So many of them are worked out, as four at once are: the last ones weigh nothing.
const FILLED: usize = 16;

/// How many times the noise's variance that it was seen to be it may be, and how likely each is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noises {
    times: [f64; FILLED],
    weights: [f64; FILLED],
}

/// Of a noise that is known by so many degrees of freedom.
pub(super) fn noises(degrees: f64) -> Noises {
    let spread = (2.0 / degrees).sqrt();
    let (mut times, mut weights) = ([1.0; FILLED], [0.0; FILLED]);
    for (step, (times, weight)) in times.iter_mut().zip(&mut weights).enumerate().take(NOISES) {
        let z = (step as f64 - 0.5 * (NOISES - 1) as f64) / STEPS;
        (*times, *weight) = ((spread * z).exp(), (-0.5 * z * z).exp());
    }
    Noises { times, weights }
}

impl Noises {
    /// Logarithm of the mean of likelihoods that are given as logarithms, over what the noise may be.
    #[inline(always)]
    fn logarithm_of_mean(&self, each: &[f64; FILLED]) -> f64 {
        let mut most = f64::NEG_INFINITY;
        for l in &each[..NOISES] {
            most = if *l > most { *l } else { most };
        }
        let mut parts = [0.0; FILLED];
        for ((part, l), weight) in parts.iter_mut().zip(each).zip(&self.weights) {
            *part = weight * exp(l - most);
        }
        most + ln(parts.iter().sum::<f64>() / self.weights.iter().sum::<f64>())
    }
}

impl Turns {
    /// Adds the logarithms of how likely they are for a tip of a variance, and a photodiode of which the noise's variance is so
    /// many times what it was seen to be.
    #[inline(always)]
    fn add_likelihoods(&self, to: &mut [f64; FILLED], variance: f64, noises: &Noises) {
        if self.degrees == 0.0 {
            return;
        }
        let (degrees, squares) = (self.degrees, self.squares);
        let still = self.still / degrees;
        for (sum, times) in to.iter_mut().zip(&noises.times) {
            let expected = variance + times * still;
            *sum -= 0.5 * (degrees * ln(expected) + squares / expected);
        }
    }
}

impl Measured {
    /// Density over the logarithm of a deviation, of which that is the `logarithm`.
    #[inline(always)]
    fn density(&self, logarithm: f64) -> f64 {
        let z = (logarithm - ln(self.deviation)) / self.spread;
        exp(-0.5 * z * z) / self.spread
    }
}

/// What was seen of a tip, and what is known of it beside that.
pub(super) struct Looks {
    /// Turns on the small circle...
    pub(super) small: Turns,
    /// ...and on the wide one, where they say something of the tip at rest.
    pub(super) wide: Option<Turns>,
    pub(super) noises: Noises,
    pub(super) measured: Option<Measured>,
}

impl Looks {
    /// Density over the logarithm of a deviation, of which that is the `logarithm`, before anything was seen.
    #[inline(always)]
    fn before(&self, logarithm: f64) -> f64 {
        let usual = USUAL.density(logarithm);
        match &self.measured {
            None => usual,
            Some(measured) => {
                let changed = TUNING.shaking.changed;
                (1.0 - changed) * measured.density(logarithm) + changed * usual
            }
        }
    }
}

impl Work for Looks {
    /// Variances, square metres, and how probable each is beside the most probable one.
    type Output = Vec<(f64, f64)>;

    #[inline(always)]
    fn work(self) -> Self::Output {
        let (least, most) = (ln(LEAST_LOOKED), ln(MOST_LOOKED));
        let step = (most - least) / LOOKED as f64;
        let mut each = Vec::with_capacity(LOOKED + 1);
        let mut best = f64::NEG_INFINITY;
        for k in 0..=LOOKED {
            let logarithm = least + step * k as f64;
            let variance = exp(2.0 * logarithm);
            // A photodiode that happened to look noisier than it is makes a tip look the stiller.
            let mut seen = [0.0; FILLED];
            self.small
                .add_likelihoods(&mut seen, variance, &self.noises);
            if let Some(wide) = &self.wide {
                wide.add_likelihoods(&mut seen, variance, &self.noises);
            }
            let turns = self.noises.logarithm_of_mean(&seen);
            let likely = turns + ln(self.before(logarithm));
            best = if likely > best { likely } else { best };
            each.push((variance, likely));
        }
        for (_, likely) in &mut each {
            *likely = exp(*likely - best);
        }
        each
    }
}
