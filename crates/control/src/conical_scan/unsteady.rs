//! Light that is unsteady within a turn by itself: a laser that wanders, a gap that shakes where light ripples with it. On a small circle it moves the peak
//! the more the smaller that is, and the more the wider the spot, while what a tip shakes moves it on all alike.

use super::ConicalScan;
use crate::beam::{Peak, Reading};
use crate::tuning::TUNING;

/// What circles leave of their light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rest {
    /// Variance beside the harmonics that a circle makes and what a tip makes that shakes, square volts; by chance it may be less than none.
    variance: f64,
    /// Degrees of freedom.
    degrees: f64,
}

impl Rest {
    /// Both together.
    pub(super) fn and(self, other: Self) -> Self {
        let degrees = self.degrees + other.degrees;
        let sum = self.variance * self.degrees + other.variance * other.degrees;
        Self {
            variance: sum / degrees,
            degrees,
        }
    }

    /// So many times as much as readings of such noise make of it (a standard deviation, volts), where it is more than chance makes it.
    fn times(self, noise: f64) -> f64 {
        let times = self.variance / (noise * noise);
        let chance = TUNING.watch.surely * (2.0 / self.degrees).sqrt();
        if times > 1.0 + chance {
            times.sqrt()
        } else {
            1.0
        }
    }
}

/// Of light that was left on a small circle of so many times the radius of the wide one, square volts, beside its photodiode's `noise`, what a tip that
/// shakes did not make, where so much was unsteady on the wide one (a standard deviation, volts). What a tip makes of it is as much less as the circle is
/// smaller; light that is unsteady by itself is so on both.
fn by_itself(left: f64, noise: f64, (wide, times): (f64, f64)) -> f64 {
    let tip = times * times;
    let beyond = left - noise * noise;
    noise * noise + (beyond - tip * wide * wide) / (1.0 - tip)
}

impl ConicalScan<'_> {
    /// What the last turn leaves of its light on a small circle at a gap; `None` where it has too few readings, and on a bench of which all turns together tell
    /// how well peaks are known.
    pub(super) fn light_beside(&self, peak: &Peak, gap: f64) -> Option<Rest> {
        let times = self.radius / self.shape.radius;
        if self.wary || times >= 1.0 {
            return None;
        }
        let (left, degrees) = self.left(|reading: &Reading| reading.volts)?;
        let light = peak.full * self.beam.share(gap) * (-self.radius * self.radius).exp();
        let wide = light * self.unsteady_before(gap);
        Some(Rest {
            variance: by_itself(left, self.watch.noise, (wide, times)),
            degrees,
        })
    }

    /// A peak that the last turn, on a small circle, has `seen`, as well as its own light tells it.
    pub(super) fn by_its_light(&self, seen: &Peak, gap: f64) -> Peak {
        let rest = self.light_beside(seen, gap);
        let times = rest.map_or(1.0, |rest| rest.times(self.watch.noise));
        Peak {
            full_deviation: times * seen.full_deviation,
            deviations: seen.deviations.map(|deviation| times * deviation),
            ..*seen
        }
    }

    /// How many times as badly as by the photodiode's noise alone peaks are known by turns that have left so much.
    pub(super) fn noisier(&self, rest: Option<Rest>) -> f64 {
        rest.map_or(1.0, |rest| rest.times(self.watch.noise))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_that_is_unsteady_by_itself_is_told_from_a_tip_that_shakes() {
        let (noise, times) = (2e-3, 0.4);
        // A tip makes of it as much less as the circle is smaller.
        let tip = 9e-3_f64;
        let left = noise * noise + (times * tip).powi(2);
        let none = by_itself(left, noise, (tip, times));
        assert!((none / (noise * noise) - 1.0).abs() < 1e-9, "{none}");
        // A gap that shakes makes as much of it on both.
        let light = 8e-3_f64;
        let all = by_itself(noise * noise + light * light, noise, (light, times));
        let rest = Rest {
            variance: all,
            degrees: 28.0,
        };
        let expected = 8.0_f64.hypot(2.0) / 2.0;
        assert!((rest.times(noise) / expected - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_noise_makes_is_no_more_than_that() {
        let rest = |times: f64| Rest {
            variance: times,
            degrees: 7.0,
        };
        assert_eq!(rest(1.9).times(1.0), 1.0);
        assert_eq!(rest(0.2).times(1.0), 1.0);
        assert!(rest(9.0).times(1.0) > 2.9);
        // More turns tell what one does not.
        assert!(
            rest(3.0)
                .and(rest(3.0))
                .and(rest(3.0))
                .and(rest(3.0))
                .times(1.0)
                > 1.7
        );
    }
}
