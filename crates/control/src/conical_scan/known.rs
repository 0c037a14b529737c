//! How well the place of a peak is known that turns have foreseen and a small one has seen: at most so badly, by which is decided, and as badly as
//! is expected, which is told.

use super::ConicalScan;
use super::ahead::together;
use crate::beam::Peak;
use crate::belief::{Across, Known};
use crate::gap_by_light::Width;
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use pigtail_model::frames::Displacement;

/// Over as little as shaking may average out while a fiber's bond sets, seconds.
pub(super) fn shortest_bond(bench: &Reactor<'_>) -> f64 {
    TUNING.bond.sooner * bench.caps().bond
}

impl ConicalScan<'_> {
    /// A peak of so many turns as well as they know it beside what moves it from turn to turn.
    pub(super) fn unsteady(&self, seen: &Peak, turns: u32) -> Peak {
        let unrest = self.unrest_of(turns);
        let deviations = [0, 1].map(|i| seen.deviations[i].hypot(unrest[i].sqrt()));
        Peak {
            deviations,
            ..*seen
        }
    }

    /// Variance in x and in y of the mean of the peaks of so many turns, beside noise, square metres.
    pub(super) fn unrest_of(&self, turns: u32) -> [f64; 2] {
        self.unrest.map(|unrest| unrest / f64::from(turns))
    }

    /// The same as it is expected.
    pub(super) fn expected_unrest_of(&self, bench: &Reactor<'_>, turns: u32) -> [f64; 2] {
        let bonds = self.period / shortest_bond(bench);
        let each = self.shaking.of_turns(self.scatter, bonds);
        each.map(|unrest| unrest / f64::from(turns))
    }

    /// How far a peak that was `seen` from a circle may be from there in x and in y, metres: where its spot is wider than believed, it
    /// was seen nearer to the circle's middle than it is.
    pub(super) fn behind(&self, gap: f64, width: &Width, seen: &Peak) -> [f64; 2] {
        let off = seen.at - self.centre;
        let believed = self.beam.squared_widths(gap);
        let wider = [0, 1].map(|i| (width.squared[i] / believed[i] - 1.0).max(0.0));
        [off.x.abs() * wider[0], off.y.abs() * wider[1]]
    }

    /// Squares of how wide the spot is in x and in y, square metres: as is believed, or as two circles have told, if that is more.
    pub(super) fn widest(&self, gap: f64, width: Option<&Width>) -> [f64; 2] {
        let believed = self.beam.squared_widths(gap);
        width.map_or(believed, |width| {
            [0, 1].map(|i| believed[i].max(width.squared[i]))
        })
    }

    /// How far beside its peak light is brightest, metres, and how well that is known: on stages that stand askew light that rises with the gap rises
    /// to one side.
    pub(super) fn aside(&self, gap: f64, width: Option<&Width>) -> (Displacement, [(f64, f64); 2]) {
        let widest = self.widest(gap, width);
        match &self.rise {
            Some(rise) => self.beam.aside_by(rise, widest),
            None => (Displacement::ZERO, self.beam.aside(widest)),
        }
    }

    /// A peak that was seen from a circle of so many widths, as well as it is known where the micro has left that for its middle.
    pub(super) fn left_from(&self, peak: &Peak, radius: f64, gap: f64) -> Peak {
        self.left_by(self.hides, peak, radius, gap)
    }

    /// The same where it comes to rest so far beside that, of the circle's radius.
    pub(super) fn left_by(&self, hides: f64, peak: &Peak, radius: f64, gap: f64) -> Peak {
        // That is told in true measure.
        let hidden = hides * radius * self.beam.width(gap) / self.shaking.wider();
        Peak {
            deviations: peak.deviations.map(|d| d.hypot(hidden)),
            ..*peak
        }
    }

    /// The place of a peak that was `foreseen` from a wide circle and `seen` on a small one of so many widths, by so many turns: by both, and how well it is
    /// known in x and in y where the group has left either circle for its middle, metres, at most and as expected.
    pub(super) fn by_both(
        &self,
        bench: &Reactor<'_>,
        gap: f64,
        (foreseen, seen): (&Peak, &Peak),
        (radius, times): (f64, u32),
    ) -> (Displacement, [[f64; 2]; 2]) {
        let left = |hides| {
            let foreseen = self.left_by(hides, foreseen, self.shape.radius, gap);
            (foreseen, self.left_by(hides, seen, radius, gap))
        };
        let (wide, small) = left(self.hides);
        let both = together(&wide, &small, self.unrest_of(times));
        let shaken = TUNING.last.shaken;
        let (wide, small) = left((self.hides * self.hides - shaken * shaken).max(0.0).sqrt());
        let expected = both.expected(&wide, &small, self.expected_unrest_of(bench, times));
        (both.at, [both.known, expected])
    }

    /// How many turns on the small circle are made where the `first` of them tells so little: until they tell what is wanted, or as many as usual. Where
    /// other tries have come to no sure place as many more are, as long as they tell more than the peak strays meanwhile.
    pub(super) fn looks_on(&self, first: &Peak) -> u32 {
        let each = self.unsteady(first, 1).deviation();
        let drift = self.steadily().deviation();
        let strays = |times| {
            let moves = TUNING.last.unforeseen * self.creep_in(times);
            moves.hypot(drift * f64::from(times - 1))
        };
        looks(each, self.wanted, self.more, strays)
    }

    /// How far piezos creep from the middle of so many small turns until the fiber is fixed, metres.
    pub(super) fn creep_in(&self, times: u32) -> f64 {
        let older = 1.0 + 0.5 * f64::from(times - 1) * self.creeps();
        TUNING.ahead.creep * self.slower * older
    }

    /// How well a place is known until the fiber is fixed there, so many turns on the small circle after it was foreseen, of which light tells so much, at
    /// most and as expected. Its spot may be wider than believed and stages askew, by which it is so far `behind` or `aside`; to `rest` it takes so
    /// many turns, and stays there for some `later`.
    pub(super) fn until_fixed(
        &self,
        [known, expected]: [[f64; 2]; 2],
        (behind, aside): ([f64; 2], [(f64, f64); 2]),
        times: u32,
        (rest, later): (f64, f64),
    ) -> Known {
        // How far piezos creep until the fiber is fixed was foreseen, but for a part; and as much of
        // what moves on while a micro that rings comes to rest, such as a macro that creeps.
        let creep = TUNING.ahead.creep * self.slower;
        let crept = self.creep_in(times);
        let moves = crept + creep.max(self.drift.norm()) * later;
        let at_most = Across {
            sigma: [0, 1].map(|i| {
                let moves = TUNING.last.unforeseen * moves;
                known[i].hypot(moves).hypot(aside[i].0)
            }),
            // A drift that was seen for sure goes on as it did, or less, or not at all: what comes to rest does so soon, and
            // piezos creep by the logarithm of time, by much where their model knows no creep. To go where it
            // would lead makes offsets worse where it does not go on, so it is believed and not followed.
            bound: [
                self.surely.x.abs() * rest + behind[0] + aside[0].1,
                self.surely.y.abs() * rest + behind[1] + aside[1].1,
            ],
            askew: aside,
        };
        let likely = TUNING.last.likely;
        let askew = aside.map(|(sigma, bound)| (likely * sigma, likely * bound));
        // As fast as the turns have shown it to creep, or as piezos do if that is less.
        let drift = [self.drift.x, self.drift.y].map(f64::abs);
        let expected = Across {
            sigma: [0, 1].map(|i| {
                let moves = crept * (drift[i] / creep).min(1.0) + drift[i] * later;
                let moves = TUNING.last.unforeseen * moves;
                expected[i].hypot(moves).hypot(askew[i].0)
            }),
            bound: at_most.bound.map(|bound| likely * bound),
            askew,
        };
        Known { at_most, expected }
    }
}

/// How many turns are made of which each tells a peak to a deviation of `each` where one of `wanted` is asked for (metres): `more` times as many as usual at
/// most, and beyond the usual ones no more than leave least in doubt where in so many a peak `strays` so far (metres).
fn looks(each: f64, wanted: f64, more: f64, strays: impl Fn(u32) -> f64) -> u32 {
    let asked = (each / wanted).powi(2).ceil();
    let usual = asked.clamp(1.0, TUNING.last.looks) as u32;
    let most = asked.min(TUNING.last.looks * more) as u32;
    let doubt = |times: u32| (each / f64::from(times).sqrt()).hypot(strays(times));
    (usual..=most)
        .min_by(|a, b| doubt(*a).total_cmp(&doubt(*b)))
        .unwrap_or(usual)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dim_peak_is_looked_at_for_longer_where_it_was_not_sure_and_no_longer_than_that_tells() {
        let stays = |_| 0.0;
        assert_eq!(looks(10e-9, 20e-9, 1.0, stays), 1);
        assert_eq!(looks(80e-9, 20e-9, 1.0, stays), 6);
        assert_eq!(looks(80e-9, 20e-9, 3.0, stays), 16);
        assert_eq!(looks(80e-9, 5e-9, 16.0, stays), 96);
        // 80 nm / sqrt(n) and 1 nm n together are least at n^3 = 80^2 / 2.
        let drifts = |times: u32| 1e-9 * f64::from(times);
        assert_eq!(looks(80e-9, 5e-9, 16.0, drifts), 15);
        // No fewer than usual.
        let runs = |times: u32| 50e-9 * f64::from(times);
        assert_eq!(looks(80e-9, 5e-9, 16.0, runs), 6);
    }
}
