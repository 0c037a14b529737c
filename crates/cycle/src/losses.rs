//! What fibers have lost as they cured: by their light, and by where they are.
//!
//! Light that is looked at before and after tells all that fibers which were cured together have lost, as well as laser and witness leave
//! it alone. Where a fiber that was bent is beside its peak, `p`, tells what that costs, `p^2/w^2` nepers; slope over curvature of the
//! light does not know of the laser, nor of its witness. What is in the light alone is what the gap has done: light that goes to and fro in it makes
//! ripples. How large those are is learned as fibers go by (`Ripples`), and with that either tells of the other: each fiber has lost what its place
//! costs, give or take a ripple; what all have lost is seen. The best estimate by both is that of least squares. Now and then a bond is none, and
//! has done more to its fiber than ripples do: that counts as much as what is seen speaks for it.

use crate::spread::{Seen, Spread};

/// Median of what is believed beforehand of how much the gap changes the light from one length to another, nepers, standard deviation; and how far it
/// differs, standard deviation of its natural logarithm. Faces that reflect shares `r` and `s` make light swing by `4 sqrt(r s)`
/// of itself, and half of that is how far two lengths differ: 0.3 dB for glass against air, 0.01 dB where the adhesive's
/// index is within 0.1 of both. Two deviations are from 0.02 to 0.3 dB.
const BELIEVED: (f64, f64) = (0.018, 0.7);

/// How often a bond does something else to its fiber than pull it across and ripple its light, and what that is, nepers, standard deviation: 1 dB.
const ODD: (f64, f64) = (1e-3, 0.25);

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
        let more = lost - by_place;
        // All as they mostly are, or one of them odd.
        let cases = (0..=N).map(|odd| {
            let own: [f64; N] = std::array::from_fn(|i| {
                let odd = if odd == i + 1 { ODD.1 * ODD.1 } else { 0.0 };
                places[i].1.powi(2) + ripple * ripple + odd
            });
            let ours: f64 = own.iter().sum();
            let seen = ours + noise * noise;
            let often: f64 = if odd == 0 { 1.0 } else { ODD.0 };
            Case {
                ln: often.ln() - 0.5 * (more * more / seen + seen.ln()),
                all: (by_place + ours / seen * more, ours * noise * noise / seen),
                each: std::array::from_fn(|i| {
                    let (cost, own) = (places[i].0, own[i]);
                    (cost + own / seen * more, own - own * own / seen)
                }),
            }
        });
        let cases: Vec<Case<N>> = cases.collect();
        Self {
            all: mean(&cases, |case| case.all),
            each: std::array::from_fn(|i| mean(&cases, |case| case.each[i])),
            places: Some((by_place, unsure.sqrt())),
        }
    }
}

/// What was lost if it is so, with variances, nepers; and the logarithm of how likely that is.
struct Case<const N: usize> {
    ln: f64,
    all: (f64, f64),
    each: [(f64, f64); N],
}

/// Mean over all cases of something that has a mean and a variance in each, and its standard deviation.
fn mean<const N: usize>(cases: &[Case<N>], of: impl Fn(&Case<N>) -> (f64, f64)) -> Loss {
    let most = cases.iter().fold(f64::NEG_INFINITY, |m, c| m.max(c.ln));
    let weights = || cases.iter().map(|case| ((case.ln - most).exp(), of(case)));
    let all: f64 = weights().map(|(weight, _)| weight).sum();
    let mean = weights().map(|(weight, (at, _))| weight * at).sum::<f64>() / all;
    let square = weights().map(|(weight, (at, square))| weight * (square + (at - mean).powi(2)));
    (mean, (square.sum::<f64>() / all).sqrt())
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
        assert!((all.0 - (0.02 + 0.08 * share)).abs() < 1e-3, "{all:?}");
        // Hardly more, as it may be odd.
        let sigma = wide * (1.0 - share).sqrt();
        assert!((sigma..1.2 * sigma).contains(&all.1), "{all:?}");
        // Light that is known well is believed, whatever the place says.
        let told = Losses::told((0.10, 0.001), [Some((0.05, 0.005))], 0.03);
        assert!((told.all.0 - 0.10).abs() < 1e-3, "{told:?}");
    }

    #[test]
    fn light_that_is_gone_is_not_made_up_for_by_a_place() {
        // However much that is, and however the laser wanders.
        for (lost, noise) in [(0.3, 0.01), (0.95, 0.01), (0.5, 0.05), (7.0, 0.05)] {
            let told = Losses::told((lost, noise), [Some((0.03, 0.002))], 0.02);
            assert!(told.all.0 > 0.85 * lost, "{lost}: {told:?}");
        }
        // What may be either is known as badly as that.
        let either = Losses::told((0.25, 0.06), [Some((0.03, 0.002))], 0.02).all;
        assert!(
            either.1 > 0.04 && either.0 + 2.0 * either.1 > 0.115,
            "{either:?}"
        );
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
