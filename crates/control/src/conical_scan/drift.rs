//! A peak that drifts while a micro comes to rest for longer than a turn: as chip and holders warm, for as long as anybody waits.

use super::{ConicalScan, Gap};
use crate::belief::{Across, Known};
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use pigtail_hal::bench::Law;
use pigtail_model::frames::Displacement;

/// How a peak goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drift {
    /// Metres a turn...
    pub(super) way: Displacement,
    /// ...and how well that is known in x and in y, one standard deviation.
    deviations: [f64; 2],
    /// What else of the way that turns have seen may go on, or not: metres a turn in x and in y.
    creeps: [f64; 2],
}

impl Drift {
    /// Of a way that turns have `seen`, metres a turn, to such deviations, of which so much is one for `surely` and one of so many is `usual`: what turns
    /// hardly tell is no drift, and what is much faster than that slows down.
    fn told(
        (seen, surely): (Displacement, Displacement),
        deviations: [f64; 2],
        usual: f64,
    ) -> Self {
        let axis = |seen: f64, surely: f64, deviation: f64| {
            let share = usual / usual.hypot(deviation);
            let way = share * share * seen;
            (way, share * deviation, (surely.abs() - way.abs()).max(0.0))
        };
        let x = axis(seen.x, surely.x, deviations[0]);
        let y = axis(seen.y, surely.y, deviations[1]);
        Self {
            way: Displacement::new(x.0, y.0),
            deviations: [x.1, y.1],
            creeps: [x.2, y.2],
        }
    }

    /// How well its way is known, at worst, metres a turn.
    pub(super) fn deviation(&self) -> f64 {
        self.deviations[0].max(self.deviations[1])
    }

    /// A place as well as it is known that was led along for so many turns: what is not known of the drift grows with them, and a part of it may not go
    /// on.
    pub(super) fn for_turns(&self, turns: f64, known: Known) -> Known {
        if turns == 0.0 {
            return known;
        }
        let way = [self.way.x, self.way.y];
        let led = |across: Across, likely: f64| Across {
            sigma: [0, 1].map(|i| {
                let off = self.deviations[i].hypot(TUNING.last.unforeseen * way[i]);
                across.sigma[i].hypot(turns * off)
            }),
            bound: [0, 1].map(|i| across.bound[i] + likely * turns * self.creeps[i]),
            ..across
        };
        Known {
            at_most: led(known.at_most, 1.0),
            expected: led(known.expected, TUNING.last.likely),
        }
    }
}

impl ConicalScan<'_> {
    /// How the peak goes on as the last turns have seen it, where that is no more than what warms goes: of chip and holders it is known how far they come
    /// apart within a second, and within one they do so steadily. What piezos creep ever more slowly is not followed.
    pub(super) fn steadily(&self) -> Drift {
        let usual = TUNING.vision.warms * self.period;
        Drift::told((self.drift, self.surely), self.drifts, usual)
    }

    /// So many seconds on the circle, the middle of which moves on as the peak does, metres a turn.
    pub(super) async fn follow_drift(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        (drift, seconds): (Displacement, f64),
    ) -> Result<(), Halt> {
        self.centre += drift * (seconds / self.period);
        let gap = Gap::Steady(gap);
        let law = self.law(gap, (seconds, 0.0));
        if let Some((ticket, played)) = &mut self.played
            && bench.bend(*ticket, Law::Dither(law)).is_ok()
        {
            *played = law;
        }
        Ok(self.last_for(bench, gap, seconds).await?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_turns_hardly_tell_is_not_followed_and_grows_while_it_is_waited() {
        let seen = Displacement::new(-2.5e-9, 2.5e-9);
        let none = Displacement::ZERO;
        let drift = Drift::told((seen, none), [0.2e-9, 20e-9], 2e-9);
        assert!((drift.way.x + 2.5e-9).abs() < 0.03e-9, "{:?}", drift.way);
        assert!(drift.way.y.abs() < 0.03e-9, "{:?}", drift.way);
        let known = Known {
            at_most: Across::of(5e-9),
            expected: Across::of(5e-9),
        };
        assert_eq!(drift.for_turns(0.0, known), known);
        // Turns that say nothing leave as much as what warms goes.
        let [x, y] = drift.for_turns(8.0, known).expected.sigma;
        assert!((5e-9..9e-9).contains(&x), "{x}");
        assert!((16e-9..18e-9).contains(&y), "{y}");
    }

    #[test]
    fn what_is_seen_for_sure_and_not_followed_may_go_on() {
        let seen = Displacement::new(10e-9, 0.0);
        let drift = Drift::told((seen, seen), [2e-9; 2], 2e-9);
        assert!((drift.way.x - 5e-9).abs() < 1e-12, "{:?}", drift.way);
        let known = Known {
            at_most: Across::of(5e-9),
            expected: Across::of(5e-9),
        };
        let Known { at_most, expected } = drift.for_turns(2.0, known);
        assert!((at_most.bound[0] - 10e-9).abs() < 1e-12);
        assert!(expected.bound[0] < at_most.bound[0] && at_most.bound[1] == 0.0);
    }
}
