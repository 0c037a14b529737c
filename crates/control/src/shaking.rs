//! How far a tip that is held still is from where it is held, at any moment: noise of its piezos, vibration of
//! the table. A fiber is fixed where its tip was on average while its bond has set, which takes some milliseconds: what is
//! faster averages out, what is slower does not. Light tells of both: on a circle around the peak it scatters by more than
//! a photodiode does in the dark, sample by sample; and where the tip is held beside the peak, so do its means.

mod believed;
mod looks;

pub use believed::Believed;

use crate::belief::Across;
use crate::tuning::TUNING;
use looks::{Looks, noises};
use pigtail_model::instructions::Instructions;

/// What is known of a tip before it is seen and where nobody has measured it.
const USUAL: Measured = Measured {
    deviation: TUNING.shaking.usual,
    spread: TUNING.shaking.usual_spread,
    left: 1.0,
    left_spread: 0.0,
};

/// How far a tip that is held is from where it is held, along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Standard deviation, metres.
    pub deviation: f64,
    /// Standard deviation of its natural logarithm: how well it is known.
    pub spread: f64,
    /// Which share of its variance is left of the mean over as long as a bond takes: the middle of what it may be.
    pub left: f64,
    /// Standard deviation of its natural logarithm; none where `left` is the most that it may be.
    pub left_spread: f64,
}

impl Measured {
    /// Variance of the mean over as long as a bond takes, square metres.
    fn left_of_means(&self) -> f64 {
        self.left_on_average() * self.deviation.powi(2)
    }

    /// Standard deviation of that, metres.
    pub fn of_means(&self) -> f64 {
        self.left_of_means().sqrt()
    }

    /// The mean of what may be left: what is lognormal has its mean above its middle.
    fn left_on_average(&self) -> f64 {
        self.left * (0.5 * self.left_spread.powi(2)).exp()
    }

    /// What may be left, and how probable each is: by the nodes of Gauss and Hermite, by which means of whatever grows as fast as tails do
    /// are right to some percent.
    fn lefts(&self) -> impl Iterator<Item = (f64, f64)> + use<> {
        const NODES: [(f64, f64); 5] = [
            (0.0, 8.0 / 15.0),
            (-1.355_626, 0.222_075_9),
            (1.355_626, 0.222_075_9),
            (-2.856_970, 0.011_257_41),
            (2.856_970, 0.011_257_41),
        ];
        let Self {
            left, left_spread, ..
        } = *self;
        let alone = left_spread == 0.0;
        let nodes = if alone { &NODES[..1] } else { &NODES[..] };
        nodes.iter().map(move |(z, share)| {
            let share = if alone { 1.0 } else { *share };
            (left * (left_spread * z).exp(), share)
        })
    }
}

/// Turns on a circle: how often, and by how much, the tip's place has scattered with the photodiode's noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Turns {
    /// Degrees of freedom.
    degrees: f64,
    /// Sum of squares, square metres.
    squares: f64,
    /// What the photodiode's noise alone makes of it, square metres.
    still: f64,
}

impl Turns {
    fn add(&mut self, seen: &Scatter) {
        self.degrees += seen.degrees;
        self.squares += seen.degrees * seen.variance;
        self.still += seen.degrees * seen.still;
    }

    /// Variance of the tip alone, square metres; it may come out a little below zero.
    fn beyond(&self) -> f64 {
        (self.squares - self.still) / self.degrees
    }
}

/// What one turn says of a tip's place along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Its variance with the photodiode's noise, square metres.
    pub variance: f64,
    /// What that noise alone would make of it, square metres...
    pub still: f64,
    /// ...and by how many degrees of freedom that is known.
    pub still_degrees: f64,
    /// Degrees of freedom of the turn.
    pub degrees: f64,
}

/// What is slower than a turn, in x and in y.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Slow {
    /// Variance from turn to turn beyond what the photodiode's noise makes of it, square metres; by chance it may be less than none.
    beyond: [f64; 2],
    /// What of that chance has not made.
    surely: [f64; 2],
    /// Degrees of freedom.
    degrees: f64,
}

/// Variance of a tip's place along an axis, as it has been seen so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shaking {
    /// What was measured of it before, if it was.
    measured: Option<Measured>,
    /// Of what is faster than a turn, on the circle that finds the peak.
    wide: Turns,
    /// The same on the small circle from which the tip comes to rest.
    small: Turns,
    /// Of what is slower: variance from turn to turn beyond what the photodiode makes of it, and its degrees of
    /// freedom; of the last turns, in x and in y.
    slow: Slow,
    /// By how many degrees of freedom the photodiode's noise is known.
    still_degrees: f64,
    /// Whether it was looked at on its own, with the circle's middle held: the turns are means then, each over as long as a
    /// bond takes.
    watched: bool,
    /// The samples of these means.
    samples: Turns,
    /// By how much more than believed a tip has to move for its light to say so: modes may be wider than designed.
    wider: f64,
}

impl Shaking {
    /// Nothing seen yet, of a tip that was `measured` before or was not.
    pub fn new(measured: Option<Measured>) -> Self {
        Self {
            measured,
            wide: Turns::default(),
            small: Turns::default(),
            slow: Slow::default(),
            still_degrees: f64::INFINITY,
            watched: false,
            samples: Turns::default(),
            wider: 1.0,
        }
    }

    /// The same tip, with nothing seen yet, to be watched on its own.
    #[must_use]
    pub fn to_watch(&self) -> Self {
        // Of means there is less.
        let means = self.measured.map(|measured| Measured {
            deviation: measured.deviation * measured.left.sqrt(),
            spread: measured.spread.hypot(0.5 * measured.left_spread),
            left: 1.0,
            left_spread: 0.0,
        });
        Self {
            watched: true,
            wider: self.wider,
            ..Self::new(means)
        }
    }

    /// Modes are wider than believed by so much, squared: whatever was told by light scatters the more in truth. What
    /// is watched is told in true measure.
    pub fn set_wider(&mut self, wider: f64) {
        self.wider = wider;
    }

    /// By how much that is.
    pub fn wider(&self) -> f64 {
        self.wider
    }

    /// Standard deviation that was measured of the tip before, metres; none where it was not.
    pub fn measured_before(&self) -> f64 {
        self.measured.map_or(0.0, |measured| measured.deviation)
    }

    /// Whether the tip was watched on its own: what is seen in passing says no more.
    pub fn is_watched(&self) -> bool {
        self.watched
    }

    /// A turn on the circle that finds the peak.
    pub fn add_wide(&mut self, seen: &Scatter) {
        self.wide.add(seen);
        self.still_degrees = seen.still_degrees;
    }

    /// By how much the tip seems to scatter on the circle that finds the peak, rms, metres: light that is unsteady by itself looks like that, too.
    pub fn on_wide(&self) -> f64 {
        if self.wide.degrees > 0.0 {
            self.wide.beyond().max(0.0).sqrt()
        } else {
            0.0
        }
    }

    /// Samples of a tip that is watched, the means of which are added as turns.
    pub fn add_sample(&mut self, seen: &Scatter) {
        self.samples.add(seen);
    }

    /// A turn on the small circle, after which the tip comes to rest.
    pub fn add_small(&mut self, seen: &Scatter) {
        self.small.add(seen);
        self.still_degrees = seen.still_degrees;
    }

    /// From turn to turn the peak's variance in x and in y is so much where a photodiode's noise alone would make it `noise`
    /// (square metres), by so many degrees of freedom. What chance may have made of the noise is none of it: a few
    /// turns say little.
    pub fn set_slow(&mut self, variance: [f64; 2], noise: [f64; 2], degrees: f64) {
        let chance = TUNING.shaking.noise_chance * (2.0 / degrees).sqrt();
        let beyond = [0, 1].map(|i| variance[i] - noise[i]);
        let surely = [0, 1].map(|i| {
            if beyond[i] > chance * noise[i] {
                beyond[i]
            } else {
                0.0
            }
        });
        self.slow = Slow {
            beyond,
            surely,
            degrees,
        };
    }

    /// Both, put together with what was seen by another circle: what was watched says more than what was not.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let sum = |a: Turns, b: Turns| Turns {
            degrees: a.degrees + b.degrees,
            squares: a.squares + b.squares,
            still: a.still + b.still,
        };
        match (self.watched, other.watched) {
            (_, true) => other,
            (true, false) => self,
            (false, false) => Self {
                wide: sum(self.wide, other.wide),
                small: sum(self.small, other.small),
                slow: if other.slow.degrees > 0.0 {
                    other.slow
                } else {
                    self.slow
                },
                still_degrees: self.still_degrees.min(other.still_degrees),
                wider: self.wider.max(other.wider),
                ..self
            },
        }
    }

    /// Whether anything has been seen at all.
    pub fn is_known(&self) -> bool {
        self.wide.degrees + self.small.degrees > 0.0
    }

    /// Variance from turn to turn in x and in y, square metres, beside what is left of means over as long as a bond takes. These hold what is slower than a
    /// turn, for a bond takes less: of a tip that was measured only what is more than that counts.
    fn slow(&self) -> [f64; 2] {
        self.slow.surely.map(|seen| self.slower(seen).max(0.0))
    }

    /// The same as it is expected: beside means that were measured it may be less than none, for these are no better known than that.
    fn expected_slow(&self) -> [f64; 2] {
        if self.watched {
            return [0.0; 2];
        }
        self.slow.beyond.map(|seen| self.slower(seen))
    }

    /// Variance from turn to turn that was `seen`, put together with what was foreseen, beside what is left of means that were measured.
    fn slower(&self, seen: f64) -> f64 {
        let foreseen = self.foreseen();
        let believed = shrunk(seen, self.slow.degrees, foreseen);
        if self.measured.is_some() {
            believed - foreseen
        } else {
            believed
        }
    }

    /// Variance of a mean over as long as a bond takes, as it was measured or is usual, square metres.
    fn foreseen(&self) -> f64 {
        self.measured.unwrap_or(USUAL).left_of_means()
    }

    /// Variance of a turn's peak beyond what the photodiode's noise makes of it, as it is expected in x and in y, square metres: `seen` by so
    /// many degrees of freedom, and foreseen as `bonds` means over as long as a bond takes, which scatter without order.
    pub fn of_turns(&self, (seen, degrees): ([f64; 2], f64), bonds: f64) -> [f64; 2] {
        let foreseen = self.foreseen() / bonds.max(1.0);
        seen.map(|seen| shrunk(seen, degrees, foreseen).max(0.0))
    }

    /// Variance of a mean over as long as a bond takes that was measured of the tip before, square metres; none where it was not.
    pub fn measured_means(&self) -> f64 {
        self.measured
            .map_or(0.0, |measured| measured.left_of_means())
    }

    /// Whether the micro swings on the circle that finds the peak by much more than on the small one: by its own
    /// resonance.
    pub fn rings(&self) -> bool {
        let (wide, small) = (self.wide, self.small);
        let chance =
            TUNING.shaking.rings_chance * (2.0 / wide.degrees).sqrt() * wide.squares / wide.degrees;
        small.degrees > 0.0
            && wide.degrees > 0.0
            && wide.beyond() - chance
                > TUNING.shaking.rings
                    * small
                        .beyond()
                        .max(TUNING.shaking.least * TUNING.shaking.least)
    }

    /// What is believed of the tip after what was seen.
    pub fn believed(&self) -> Believed {
        // Whoever has seen nothing of a tip cannot say that it still is as it was.
        let measured = self.measured.filter(|_| self.is_known());
        let mut probable = Instructions::run_work(Looks {
            small: self.small,
            // One that rang on the wide circle no longer does.
            wide: (!self.rings()).then_some(self.wide),
            noises: noises(self.still_degrees),
            measured,
        });
        let sum: f64 = probable.iter().map(|(_, share)| share).sum();
        for (_, share) in &mut probable {
            *share /= sum;
        }
        Believed {
            shaking: *self,
            probable,
        }
    }

    /// Whether it was watched for so long that more would say little: how far it shakes is known, or that it is nothing beside a `tolerance`
    /// (metres).
    pub fn is_told(&self, tolerance: f64) -> bool {
        let means = self.believed().known();
        let most = means.deviation * (TUNING.shaking.told_surely * means.spread).exp();
        let nothing = most <= TUNING.shaking.nothing * tolerance;
        self.watched && (self.measured().spread <= TUNING.shaking.known || nothing)
    }

    /// What to believe of the tip from now on, of what it did while it was watched: slower and faster alike.
    pub fn measured(&self) -> Measured {
        let means = self.believed().known();
        let samples = Self {
            wide: self.samples,
            ..*self
        };
        let known = samples.believed().known();
        let left = (means.deviation / known.deviation).powi(2);
        Measured {
            left: left.min(1.0),
            left_spread: 2.0 * means.spread.hypot(known.spread),
            ..known
        }
    }

    /// Which share of the variance may be left of means over as long as a bond takes, and how probable each is: all of it where nobody has measured
    /// that.
    fn lefts(&self) -> Vec<(f64, f64)> {
        self.measured
            .map_or_else(|| vec![(1.0, 1.0)], |measured| measured.lefts().collect())
    }

    /// The same on average.
    fn left(&self) -> f64 {
        self.measured
            .map_or(1.0, |measured| measured.left_on_average())
    }

    /// By how much larger all deviations are than they seem, and a place that is `known` so well without that. What stages askew do is told in true
    /// measure.
    fn widened(&self, known: Across) -> (f64, Across) {
        let place = known.seen(self.wider);
        if self.watched {
            (1.0, place)
        } else {
            (self.wider, place.times(self.wider.recip()))
        }
    }
}

/// A variance that was `seen` by so many degrees of freedom, and one that was foreseen, which is worth some.
fn shrunk(seen: f64, degrees: f64, foreseen: f64) -> f64 {
    let worth = TUNING.shaking.worth_slow;
    (seen * degrees + foreseen * worth) / (degrees + worth)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seven degrees of freedom of a tip, seen by a photodiode that makes 8 nm of its noise.
    fn seen(deviation: f64) -> Scatter {
        let still = 64e-18;
        Scatter {
            variance: still + deviation * deviation,
            still,
            still_degrees: 200.0,
            degrees: 7.0,
        }
    }

    #[test]
    fn a_tip_that_shakes_is_not_sure_however_well_its_peak_is_known() {
        let mut still = Shaking::new(None);
        assert!(!still.is_known());
        still.add_small(&seen(2e-9));
        still.add_wide(&seen(2e-9));
        assert!(still.believed().outside(0.1e-6, Across::of(15e-9)) < 1e-4);
        let mut shakes = Shaking::new(None);
        for _ in 0..10 {
            shakes.add_wide(&seen(30e-9));
        }
        assert!(
            (shakes.believed().deviation() - 31e-9).abs() < 2e-9,
            "{}",
            shakes.believed().deviation()
        );
        assert!(shakes.believed().outside(0.1e-6, Across::of(1e-9)) > 1e-3);
        // One that happened to look quieter than it is.
        let mut chance = Shaking::new(None);
        chance.add_small(&seen(17e-9));
        assert!(chance.believed().outside(0.1e-6, Across::of(5e-9)) > 1e-4);
        // One that rang on the wide circle, and no longer does.
        let mut rang = still;
        for _ in 0..4 {
            rang.add_wide(&seen(100e-9));
        }
        assert!(rang.believed().outside(0.1e-6, Across::of(15e-9)) < 1e-3);
        // One that was seen to wander from turn to turn.
        still.set_slow([16e-16; 2], [1e-16; 2], 10.0);
        assert!(still.believed().outside(0.1e-6, Across::of(15e-9)) > 1e-4);
    }

    #[test]
    fn a_tip_is_worth_watching_where_that_may_make_it_sure() {
        let (tolerance, near, far) = (0.1e-6, Across::of(15e-9), Across::of(28e-9));
        let mut shakes = Shaking::new(None);
        for _ in 0..3 {
            shakes.add_wide(&seen(30e-9));
        }
        assert!(shakes.believed().is_sure(tolerance, near).is_err());
        // Nobody knows what is left of its means, but however still, it is not sure at a place that is known so badly.
        assert!(
            shakes.believed().may_be_sure(tolerance, near)
                && !shakes.believed().may_be_sure(tolerance, far)
        );
        // Means that were watched for long are known.
        let mut watched = shakes.to_watch();
        for _ in 0..100 {
            watched.add_wide(&seen(30e-9));
        }
        assert!(!watched.believed().may_be_sure(tolerance, near));
    }

    #[test]
    fn what_is_slower_than_a_turn_counts_once_of_a_tip_that_was_measured() {
        let measured = Measured {
            deviation: 36e-9,
            spread: 0.1,
            left: 0.25,
            left_spread: 0.0,
        };
        let mut shaking = Shaking::new(Some(measured));
        for _ in 0..6 {
            shaking.add_wide(&seen(36e-9));
        }
        // From turn to turn the peak scatters as much as is left of means: no more of it than was measured.
        shaking.set_slow([18e-9_f64.powi(2) + 1e-16; 2], [1e-16; 2], 10.0);
        let bonded = shaking.believed().bonded(Across::default()).worse();
        assert!((bonded - 18e-9).abs() < 2e-9, "{bonded}");
        // And by more where it scatters by more.
        shaking.set_slow([40e-9_f64.powi(2); 2], [1e-16; 2], 10.0);
        let bonded = shaking.believed().bonded(Across::default()).worse();
        assert!(bonded > 28e-9, "{bonded}");
    }

    #[test]
    fn what_is_said_of_tips_is_as_often_so() {
        // Tips of the usual kind, each seen by 21 degrees of freedom: what is called outside with a probability
        // adds up to those that are.
        let mut state = 5_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut normal = move || (0..12).fold(-6.0, |sum, _| sum + uniform());
        let (tolerance, still, trials) = (25e-9, 8e-9, 4000);
        let (mut said, mut are) = (0.0, 0.0);
        for _ in 0..trials {
            let deviation: f64 = USUAL.deviation * (USUAL.spread * normal()).exp();
            let mut shaking = Shaking::new(None);
            let spread = deviation.hypot(still);
            let squares: f64 = (0..21).map(|_| (spread * normal()).powi(2)).sum();
            shaking.add_small(&Scatter {
                variance: squares / 21.0,
                still: still * still,
                still_degrees: f64::INFINITY,
                degrees: 21.0,
            });
            said += shaking.believed().outside(tolerance, Across::default());
            // Of what wanders from turn to turn there is as much as is usual.
            let whole = deviation.hypot(USUAL.deviation);
            for _ in 0..2 {
                are += f64::from(u8::from((whole * normal()).abs() > tolerance));
            }
        }
        assert!((said / are - 1.0).abs() < 0.1, "{said} {are}");
    }
}
