//! How what a turn sees follows the circle's middle, on the way to the peak. (What the last turns on a bench that nobody has measured answer is told
//! by all of them together, `answer.rs`.)
//!
//! A micro that swings along goes around farther than it is told, and later. Its circle is then another one by a factor and an angle, and the
//! peak is seen from its middle as many times farther away, and as far askew. Turned by more than a sixth of a turn it would be run after for ever.

use super::ConicalScan;
use crate::beam::Peak;
use crate::outcome::Outcome;
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use pigtail_model::frames::Displacement;

/// What is seen of a peak's place, and the way that answered it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// How far from the circle's middle it was seen, metres.
    by: Displacement,
    /// How far the middle went then, metres.
    way: Displacement,
}

/// A peak as seen is so many times as far away as it is, and so far askew.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distortion {
    farther: f64,
    /// Radians from x to y.
    askew: f64,
}

impl Default for Distortion {
    fn default() -> Self {
        Self {
            farther: 1.0,
            askew: 0.0,
        }
    }
}

impl Distortion {
    /// By what was seen before the middle went its way and what is seen since; `None` where the way tells too little beside the peak's `deviation`
    /// (metres). Of an angle only one tells that is longer than `least` (metres): near the peak something else may have moved it.
    fn told(before: Seen, by: Displacement, (deviation, least): (f64, f64)) -> Option<Self> {
        let way = before.way;
        if way.norm() <= TUNING.circle.tells * deviation {
            return None;
        }
        let went = before.by - by;
        let askew = way.cross(went).atan2(way.x * went.x + way.y * went.y);
        let is_askew = askew.abs() > TUNING.circle.askew && way.norm() > least;
        Some(Self {
            farther: (went.norm() / way.norm()).clamp(1.0, TUNING.circle.farther),
            askew: if is_askew { askew } else { 0.0 },
        })
    }

    /// Where a peak is that is seen so far away, metres.
    fn of(self, by: Displacement) -> Displacement {
        let (sin, cos) = self.askew.sin_cos();
        by.turned(-sin, cos) / self.farther
    }
}

/// What the turns of a circle have told so far of how they see the peak.
#[derive(Debug, Default)]
pub(super) struct Follows {
    distortion: Distortion,
    before: Option<Seen>,
}

impl Follows {
    /// Where a peak is that is seen so far from the middle, metres, with such a deviation, and where only a way of so many metres tells of an angle.
    fn of(&mut self, by: Displacement, deviation: (f64, f64)) -> Displacement {
        let told = self.before;
        let told = told.and_then(|before| Distortion::told(before, by, deviation));
        self.distortion = told.unwrap_or(self.distortion);
        self.distortion.of(by)
    }

    /// The middle went that way after a peak that was seen so far from it, metres.
    fn went(&mut self, by: Displacement, way: Displacement) {
        self.before = Some(Seen { by, way });
    }

    /// Whether the peak is seen askew.
    fn is_askew(&self) -> bool {
        self.distortion.askew != 0.0
    }
}

impl ConicalScan<'_> {
    /// Goes to a peak as [`Self::go_to`] does, by what the turns have told of that. Those of a micro that nobody has
    /// measured are slower from now on where they answer askew.
    /// Returns how far away it was seen, metres.
    pub(super) fn go_by(
        &mut self,
        bench: &Reactor<'_>,
        peak: &Peak,
        gap: f64,
        follows: &mut Follows,
    ) -> Result<f64, Outcome> {
        let from = self.centre;
        let by = peak.at - from;
        // What was measured of how the micro swings says how late it goes around.
        let least = if self.forgets > 1.0 {
            TUNING.circle.near * self.beam.width(gap)
        } else {
            f64::INFINITY
        };
        let at = from + follows.of(by, (peak.deviation(), least));
        self.go_to(bench, &Peak { at, ..*peak }, gap)?;
        follows.went(by, self.centre - from);
        if follows.is_askew() && self.slow_down() {
            *follows = Follows::default();
        }
        Ok(by.norm())
    }
}

#[cfg(test)]
mod tests {
    use super::Follows;
    use pigtail_model::frames::Displacement;

    /// How far from the peak a middle is after so many turns that see it so many times as far away, and so far askew, both taken for true or not.
    fn left(farther: f64, askew: f64, turns: usize, told: bool) -> f64 {
        let (sin, cos) = f64::sin_cos(askew);
        let mut follows = Follows::default();
        let mut off = Displacement::new(3.0, -1.0);
        for _ in 0..turns {
            let seen = off.turned(sin, cos) * farther;
            let way = if told {
                follows.of(seen, (1e-3, 0.1))
            } else {
                seen
            };
            follows.went(seen, way);
            off -= way;
        }
        off.norm()
    }

    /// A circle near its micro's resonance is a sixth of a turn late and more.
    #[test]
    fn a_peak_that_is_seen_askew_is_found() {
        for (farther, askew) in [(1.0, 1.1), (1.3, -1.5), (2.0, 2.5)] {
            assert!(left(farther, askew, 3, true) < 1e-9, "{farther} {askew}");
        }
        // Run after as it is seen, it is circled for ever.
        assert!(left(1.0, 1.1, 40, false) > 3.0);
    }

    /// What turns tell by chance of an angle is no angle.
    #[test]
    fn what_is_nearly_straight_is_straight() {
        let mut follows = Follows::default();
        let way = follows.of(Displacement::new(3.0, -1.0), (1e-3, 0.1));
        follows.went(way, way);
        follows.of(Displacement::new(0.2, 0.9), (1e-3, 0.1));
        assert!(!follows.is_askew());
    }
}
