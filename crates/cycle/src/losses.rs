//! What fibers have lost as they cured: by their light, and by where they are.
//!
//! Light that is looked at before and after tells all that fibers which were cured together have lost, as well as laser and witness leave
//! it alone. Where a fiber that was bent is beside its peak, `p`, tells what that costs, `p^2/w^2` nepers; slope over curvature of the
//! light does not know of the laser, nor of its witness. What is in the light alone is what the gap has done: light that goes to and fro in it makes
//! ripples. How large those are is learned as fibers go by (`Ripples`), and with that either tells of the other: each fiber has lost what its place
//! costs, give or take a ripple; what all have lost is seen. The best estimate by both is that of least squares. Where
//! both differ by more than they say, they are known as much worse (as R. T. Birge put it, Physical Review 40 (1932) 207).

use crate::spread::{Seen, Spread};

/// Median of what is believed beforehand of how much the gap changes the light from one length to another, nepers, standard deviation; and how far it
/// differs, standard deviation of its natural logarithm. Faces that reflect shares `r` and `s` make light swing by `4 sqrt(r s)`
/// of itself, and half of that is how far two lengths differ: 0.3 dB for glass against air, 0.01 dB where the adhesive's
/// index is within 0.1 of both. Two deviations are from 0.02 to 0.3 dB.
const BELIEVED: (f64, f64) = (0.018, 0.7);

/// How much ripples of the gap do to the light.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ripples(Spread);

impl Default for Ripples {
    fn default() -> Self {
        let (about, differs) = BELIEVED;
        Self(Spread::about(about, differs))
    }
}

impl Ripples {
    /// Some were seen.
    pub(crate) fn learn(&mut self, seen: Option<Seen>) {
        if let Some(seen) = seen {
            self.0.learn(seen);
        }
    }

    /// Their standard deviation, nepers.
    pub(crate) fn sigma(&self) -> f64 {
        self.0.square().sqrt()
    }
}

/// Something that was lost, nepers, and its standard deviation.
pub(crate) type Loss = (f64, f64);

/// What fibers that were cured together have lost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Losses<const N: usize> {
    /// All of them together.
    pub(crate) all: Loss,
    /// Each.
    pub(crate) each: [Loss; N],
    /// What the places of all cost, where all were seen.
    pub(crate) places: Option<Loss>,
}

impl<const N: usize> Losses<N> {
    /// By what light tells of all together, by what the place of each costs, as far as that was seen, and by how large ripples are, nepers.
    pub(crate) fn told(light: Loss, places: [Option<Loss>; N], ripple: f64) -> Self {
        let (lost, noise) = light;
        if places.iter().any(Option::is_none) {
            // Each has lost any share of it; or one has won what the other has lost.
            let share = 1.0 / N as f64;
            let unknown = if N > 1 {
                (lost / 12.0_f64.sqrt()).hypot(ripple)
            } else {
                0.0
            };
            return Self {
                all: light,
                each: [(share * lost, (share * noise).hypot(unknown)); N],
                places: None,
            };
        }
        let places = places.map(Option::unwrap_or_default);
        let by_place: f64 = places.iter().map(|(cost, _)| cost).sum();
        let unsure: f64 = places.iter().map(|(_, sigma)| sigma * sigma).sum();
        let ours = unsure + N as f64 * ripple * ripple;
        let seen = ours + noise * noise;
        let more = lost - by_place;
        // As far as both differ by more than they say.
        let worse = (more * more / seen).max(1.0);
        let each = places.map(|(cost, sigma)| {
            let own = sigma * sigma + ripple * ripple;
            let left = own - own * own / seen;
            (cost + own / seen * more, (worse * left).sqrt())
        });
        Self {
            all: (
                by_place + ours / seen * more,
                (worse * ours * noise * noise / seen).sqrt(),
            ),
            each,
            places: Some((by_place, unsure.sqrt())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ripples_are_as_large_as_they_have_shown() {
        let mut ripples = Ripples::default();
        let before = ripples.sigma();
        for k in 0..100 {
            ripples.learn(Some(Seen {
                by: [0.005, -0.005][k % 2],
                sigma: 1e-4,
                times: 1.0,
            }));
            ripples.learn(None);
        }
        assert!((ripples.sigma() / 0.005 - 1.0).abs() < 0.1 && before > 0.015);
    }

    #[test]
    fn a_laser_that_wanders_leaves_the_place_to_tell() {
        let Losses { all, each, .. } = Losses::told((0.10, 0.05), [Some((0.02, 0.002))], 0.01);
        assert!((all.0 - each[0].0).hypot(all.1 - each[0].1) < 1e-12);
        let wide = 0.01_f64.hypot(0.002);
        let share = wide * wide / (wide * wide + 0.05 * 0.05);
        assert!((all.0 - (0.02 + 0.08 * share)).abs() < 1e-9, "{all:?}");
        // It is a surprise by 1.6 deviations.
        let surprise = 0.08 / wide.hypot(0.05);
        assert!((all.1 - surprise * wide * (1.0 - share).sqrt()).abs() < 1e-9);
        // Light that is known well is believed, whatever the place says.
        let told = Losses::told((0.10, 0.001), [Some((0.05, 0.005))], 0.03);
        assert!((told.all.0 - 0.10).abs() < 1e-3, "{told:?}");
    }

    #[test]
    fn what_differs_by_more_than_it_says_is_known_worse() {
        let sure = Losses::told((0.05, 0.01), [Some((0.03, 0.002))], 0.02);
        let odd = Losses::told((0.95, 0.01), [Some((0.03, 0.002))], 0.02);
        assert!(odd.all.1 > 10.0 * sure.all.1, "{sure:?}, {odd:?}");
        // A fiber that has lost its light does not pass for being at its peak.
        assert!(odd.all.0 > 0.7, "{odd:?}");
    }

    #[test]
    fn of_two_each_is_told_by_its_place() {
        let places = [Some((0.08, 0.004)), Some((0.01, 0.004))];
        let Losses { all, each, .. } = Losses::told((0.09, 0.002), places, 0.02);
        assert!((each[0].0 - 0.08).abs() < 1e-3 && (each[1].0 - 0.01).abs() < 1e-3);
        // The ripple of one may be the other's, the wrong way round.
        let half = 0.02 / 2.0_f64.sqrt();
        assert!((each[0].1 / half - 1.0).abs() < 0.1, "{each:?}");
        assert!((all.0 - 0.09).abs() < 1e-4 && all.1 < 0.0021, "{all:?}");
    }

    #[test]
    fn where_no_place_was_seen_light_alone_tells() {
        let told = Losses::told((0.10, 0.01), [None], 0.02);
        assert_eq!((told.all, told.each[0]), ((0.10, 0.01), (0.10, 0.01)));
        let two = Losses::told((0.10, 0.01), [Some((0.1, 0.01)), None], 0.02);
        assert_eq!(two.all, (0.10, 0.01));
        assert!(two.each[0].1 > 0.1 / 12.0_f64.sqrt());
        assert_eq!(two.places, None);
    }
}
