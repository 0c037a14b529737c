//! How steady light is from one look to another half a minute later.
//!
//! What a fiber has lost is told by two looks at its light with a cure between them; a laser that wanders meanwhile is taken
//! for a loss, or hides one. Where an output of the same device is fixed already its light tells how the laser has wandered: it
//! is taken out, and remembered for the fibers that have nothing to be held against.
//!
//! Power is taken to wander as a random walk: its variance grows with time. The standard deviation over `OVER` is learned from what was seen,
//! as a [`spread`](crate::spread). (An own light that is followed at its peak cannot tell: the adhesive draws the fiber along z too, and
//! light that goes to and fro in the gap makes ripples of that.)

use crate::spread::{Seen, Spread};
use serde::{Deserialize, Serialize};

/// By how much light has changed that nothing has touched.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Wander {
    /// Natural logarithm of what it was later over what it was before.
    pub by: f64,
    /// Standard deviation of that by the noise of its samples.
    pub sigma: f64,
    /// Time between, seconds.
    pub seconds: f64,
}

/// Time to which standard deviations refer, seconds.
const OVER: f64 = 30.0;

/// Median of what is believed beforehand of a laser's standard deviation over that time, relative, and how far it differs from that,
/// standard deviation of its natural logarithm: those without a control loop wander by 0.1 to 2 %, makers say, those with one by a tenth
/// of that and less. The root of the mean square is 0.8 %.
const LASER: (f64, f64) = (2e-3, 1.2);

/// What is left where light through a fixed output is held against, relative: two photodiodes whose gains go with temperature
/// by some 0.1 % a kelvin, and a bond that is young.
const HELD_AGAINST: f64 = 0.002;

/// What light is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// What is held against nothing: the laser's wander is in it.
    Alone,
    /// An output, against another one that is fixed.
    HeldAgainst,
}

/// What looks have told of a laser.
#[derive(Debug, Clone, PartialEq)]
pub struct Steadiness {
    laser: Spread,
}

impl Default for Steadiness {
    fn default() -> Self {
        let (about, differs) = LASER;
        Self {
            laser: Spread::about(about, differs),
        }
    }
}

impl Steadiness {
    /// Light that nothing has touched has changed by so much; nothing where that was not seen.
    pub fn learn(&mut self, wander: Option<Wander>) {
        if let Some(Wander { by, sigma, seconds }) = wander {
            let times = seconds / OVER;
            self.laser.learn(Seen { by, sigma, times });
        }
    }

    /// Relative standard deviation of light from one look to another so many seconds later.
    pub fn of(&self, way: Way, seconds: f64) -> f64 {
        let times = seconds / OVER;
        match way {
            Way::HeldAgainst => HELD_AGAINST,
            Way::Alone => (self.laser.square() * times).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn over_a_cure(by: f64, sigma: f64) -> Wander {
        Wander {
            by,
            sigma,
            seconds: OVER,
        }
    }

    #[test]
    fn beforehand_it_is_what_makers_say() {
        // The mean square of a lognormal.
        let mean = LASER.0 * (LASER.1 * LASER.1).exp();
        let seen = Steadiness::default();
        assert!((seen.of(Way::Alone, OVER) / mean - 1.0).abs() < 0.02);
        assert!(seen.of(Way::HeldAgainst, OVER) < mean);
    }

    #[test]
    fn light_is_as_steady_as_it_has_shown() {
        for by in [2e-4, 4e-3, 2e-2] {
            let mut seen = Steadiness::default();
            for k in 0..200 {
                let by = if k % 2 == 0 { by } else { -by };
                seen.learn(Some(over_a_cure(by, 1e-5)));
                seen.learn(None);
            }
            let told = seen.of(Way::Alone, OVER);
            assert!((told / by - 1.0).abs() < 0.1, "{told} of {by}");
            // A quarter of the time, half of the way.
            let quarter = seen.of(Way::Alone, 0.25 * OVER);
            assert!((quarter / told - 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn a_laser_that_is_steady_is_believed_to_be_after_some_devices() {
        let mut seen = Steadiness::default();
        let mut last = seen.of(Way::Alone, OVER);
        for _ in 0..4 {
            seen.learn(Some(over_a_cure(2e-4, 1e-5)));
            let now = seen.of(Way::Alone, OVER);
            assert!(now < last);
            last = now;
        }
        assert!(last < 1e-3, "{last}");
    }

    #[test]
    fn noise_is_no_wander() {
        let mut seen = Steadiness::default();
        for k in 0..50 {
            let by = if k % 2 == 0 { 5e-3 } else { -5e-3 };
            seen.learn(Some(over_a_cure(by, 5e-3)));
        }
        assert!(seen.of(Way::Alone, OVER) < 3e-3);
    }
}
