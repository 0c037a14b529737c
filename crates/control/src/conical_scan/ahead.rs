//! Where the peaks of turns lead: a peak as it will be, how well that is known, and whether what is seen then is it.

use super::answer::{Answer, Turn};
use super::wander::{Track, Wander};
use crate::beam::Peak;
use crate::tuning::TUNING;
use nalgebra::{SMatrix, Vector2};
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::Normal;

/// What leads to a peak, of turns of which so many were the most.
pub(super) fn recent(turns: &[Turn], most: usize) -> &[Turn] {
    let old = if turns.len() > most {
        turns.len() / TUNING.ahead.old
    } else {
        0
    };
    &turns[old..]
}

/// By how many of so many turns what was foreseen has got old, where the middle was led after what was seen, or was not.
pub(super) fn aged(led: bool, turns: u32) -> f64 {
    f64::from(if led {
        turns
    } else {
        turns.min(TUNING.ahead.fresh)
    })
}

/// What was foreseen for one turn, so many turns later: piezos creep.
pub(super) fn late(foreseen: &Peak, turns: f64) -> Peak {
    Peak {
        deviations: foreseen
            .deviations
            .map(|d| d.hypot(TUNING.ahead.creep * turns)),
        ..*foreseen
    }
}

/// The place of a peak by where it was foreseen and where it was seen, each as far as it is sure by its noise, and how well it is known then in
/// x and in y, metres, where the turn on which it was seen has an unrest of its own (square metres). That does not count against the small
/// turn: what makes a micro swing along with wide turns moves all of them alike. What is farther from where it was foreseen than chance makes it has
/// been moved, and may go on.
pub(super) fn together(foreseen: &Peak, seen: &Peak, unrest: [f64; 2]) -> Together {
    let by = seen.at - foreseen.at;
    let (before, after) = (foreseen.deviations, seen.deviations);
    let apart = [0, 1].map(|i| before[i].hypot(after[i]).max(f64::MIN_POSITIVE));
    let share = [0, 1].map(|i| (before[i] / apart[i]).powi(2));
    let moved = [0, 1].map(|i| {
        let by = [by.x, by.y][i];
        (by * by - (TUNING.ahead.moved_deviations * apart[i]).powi(2))
            .max(0.0)
            .sqrt()
    });
    Together {
        at: foreseen.at + Displacement::new(share[0] * by.x, share[1] * by.y),
        share,
        moved,
        known: [0, 1].map(|i| {
            let known = before[i] * after[i] / apart[i];
            known.hypot(share[i] * unrest[i].sqrt()).hypot(moved[i])
        }),
    }
}

/// A peak by where it was foreseen and where it was seen.
pub(super) struct Together {
    pub(super) at: Displacement,
    /// How much of the way from the one to the other that is, in x and in y.
    share: [f64; 2],
    /// How far it has been moved, metres.
    moved: [f64; 2],
    /// How well it is known at most, in x and in y, metres.
    pub(super) known: [f64; 2],
}

impl Together {
    /// How well it is known where both are known as they are expected to be.
    pub(super) fn expected(&self, foreseen: &Peak, seen: &Peak, unrest: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| {
            let (before, after) = (foreseen.deviations[i], seen.deviations[i]);
            let share = self.share[i];
            let seen = share * after.hypot(unrest[i].sqrt());
            seen.hypot((1.0 - share) * before).hypot(self.moved[i])
        })
    }
}

/// A peak that is not where it was foreseen: how far it is, and how far it might be, metres.
pub(super) struct Moved {
    pub(super) way: f64,
    pub(super) near: f64,
}

impl Moved {
    /// Of what was foreseen so many turns ago; `None` where it is there.
    pub(super) fn of(foreseen: &Peak, seen: &Peak, turns: f64) -> Option<Self> {
        let deviation = late(foreseen, turns).deviation().hypot(seen.deviation());
        let way = (seen.at - foreseen.at).norm();
        let near = TUNING.ahead.moved + TUNING.ahead.moved_deviations * deviation;
        (way > near).then_some(Self { way, near })
    }
}

/// A coordinate of the peak as it will be.
pub(super) struct Ahead {
    /// So many turns ahead of the last one as it was asked for, metres.
    pub(super) at: f64,
    /// Its standard deviation, metres.
    pub(super) deviation: f64,
    /// How it moves, metres a turn...
    pub(super) slope: f64,
    /// ...and how well that is known.
    pub(super) slope_deviation: f64,
    /// Variance of a turn's peak about that as it was seen, square metres...
    pub(super) scatter: f64,
    /// ...and as it is believed.
    pub(super) each: f64,
}

impl Ahead {
    /// The same in x and in y by how the turns' peaks answer to where their middles were.
    pub(super) fn answered(of: &Answer) -> [Self; 2] {
        let [x, y] = [(of.at.x, of.slope.x), (of.at.y, of.slope.y)];
        [x, y].map(|(at, slope)| Self {
            at,
            deviation: of.deviation,
            slope,
            slope_deviation: of.slope_deviation,
            scatter: of.scatter,
            each: of.scatter,
        })
    }

    /// By a coordinate of peaks that are a turn apart, so many turns `ahead`. It goes on in a straight line and strays from that a little every
    /// turn, by so much more variance (square metres): piezos creep ever more slowly, axes that rest on friction give way now and
    /// then, and of a hundred turns the first say nothing of where the last leads. A few peaks may happen to lie well: their
    /// variance is `least` (square metres) or more.
    pub(super) fn of(
        turns: &[Turn],
        coordinate: impl Fn(&Peak) -> f64,
        (least, strays): (f64, f64),
        ahead: f64,
    ) -> Self {
        let origin = coordinate(&turns[0].peak);
        // Where it is at first, and its way: what is new in each turn tells of both.
        let mut track = Track::<1, 3>::new(Wander::away(strays), 0.0);
        let (mut normal, mut squares) = (Normal::<2>::default(), 0.0);
        for (k, turn) in turns.iter().enumerate() {
            let time = k as f64;
            track.until(time);
            let seen = SMatrix::from([[1.0], [time], [coordinate(&turn.peak) - origin]]);
            let (new, variance) = track.see(&seen, least);
            normal.add_weighted(&Vector2::new(new[0], new[1]), new[2], variance.recip());
            squares += new[2] * new[2] / variance;
        }
        let last = turns.len() as f64 - 1.0;
        track.until(last + ahead);
        let covariance = normal.matrix.try_inverse();
        let covariance = covariance.unwrap_or_else(|| SMatrix::repeat(f64::INFINITY));
        let line = covariance * normal.right;
        let left = squares - line.dot(&normal.right);
        let more = (left / (last - 1.0)).max(0.0);
        // What has strayed is none of the line.
        let row = Vector2::new(1.0 - track.at[0], last + ahead - track.at[1]);
        let variance = (covariance * row).dot(&row) + track.variance;
        let times = more.max(1.0);
        Self {
            at: origin + row.dot(&line) + track.at[2],
            deviation: (times * variance).sqrt(),
            slope: line[1],
            slope_deviation: (times * covariance[(1, 1)]).sqrt(),
            scatter: more * least,
            each: times * least,
        }
    }

    /// How much of its way is one for sure: of one that chance may have made nothing, of one far beyond that all but all.
    pub(super) fn surely(&self) -> f64 {
        let chance =
            TUNING.ahead.chance * self.slope_deviation / self.slope.abs().max(f64::MIN_POSITIVE);
        self.slope * (1.0 - chance * chance).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(x: f64) -> Turn {
        let at = Displacement::new(x, 0.0);
        let peak = Peak {
            at,
            full: 1.0,
            full_deviation: 0.0,
            deviations: [0.0; 2],
        };
        Turn {
            peak,
            middle: at,
            time: 0.0,
        }
    }

    #[test]
    fn a_steady_creep_is_foreseen() {
        let turns = [0.0, 10e-9, 20e-9, 30e-9].map(turn);
        let ahead = Ahead::of(&turns, |peak| peak.at.x, (1e-36, 0.0), TUNING.ahead.ahead);
        let expected = 30e-9 + TUNING.ahead.ahead * 10e-9;
        assert!((ahead.at - expected).abs() < 1e-15, "{}", ahead.at);
        assert!(ahead.deviation < 1e-15, "{}", ahead.deviation);
        assert!((ahead.slope - 10e-9).abs() < 1e-15, "{}", ahead.slope);
    }

    #[test]
    fn a_creep_that_slows_down_is_not_foreseen_by_how_it_began() {
        // By a straight line it would be four deviations away.
        let creep = |k: u32| 40e-9 * (1.0 + f64::from(k)).ln();
        let turns: Vec<_> = (0..60).map(|k| turn(creep(k))).collect();
        let strays = TUNING.ahead.strays.powi(2);
        let Ahead { at, deviation, .. } =
            Ahead::of(&turns, |peak| peak.at.x, (400e-18, strays), 1.0);
        let error = at - creep(60);
        assert!(error.abs() < 2.5 * deviation, "{error} {deviation}");
        assert!(deviation < 10e-9, "{deviation}");
    }

    #[test]
    fn a_peak_that_is_not_where_it_was_foreseen_is_not_believed_to_be_known() {
        let foreseen = Peak {
            deviations: [10e-9; 2],
            ..turn(0.0).peak
        };
        let seen = |x: f64| Peak {
            at: Displacement::new(x, 0.0),
            ..foreseen
        };
        let Together { at, known, .. } = together(&foreseen, &seen(30e-9), [0.0; 2]);
        assert!((at.x - 15e-9).abs() < 1e-12 && known[0] < 8e-9, "{known:?}");
        let Together { known, .. } = together(&foreseen, &seen(90e-9), [0.0; 2]);
        assert!(known[0] > 70e-9 && known[1] < 8e-9, "{known:?}");
    }

    #[test]
    fn three_peaks_that_happen_to_lie_well_are_not_believed_more_than_their_noise() {
        let Ahead { deviation, .. } = Ahead::of(
            &[0.0; 3].map(turn),
            |peak| peak.at.x,
            (1e-16, 0.0),
            TUNING.ahead.ahead,
        );
        assert!(deviation > 10e-9, "{deviation}");
    }
}
