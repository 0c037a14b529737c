//! What a peak does from turn to turn that no straight line foresees: a tip sways about its place, a stage comes to rest, a clamp slips now
//! and then. How much, and how slowly, only the turns themselves tell, and a dozen of them tell it badly. So no one way to wander is
//! believed: each has its likelihood, and what is said of the peak is what all of them together say.

use crate::tuning::TUNING;
use nalgebra::SMatrix;

/// A way to wander, along each axis alike: a first-order process, in a unit of one's own and turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wander {
    /// About where the peak is: its variance. Away: what is added to its variance in a turn.
    variance: f64,
    kind: Kind,
}

/// What wanders.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// What is measured, about the peak: after so many turns 1/e of it is left.
    About(f64),
    /// The peak itself: it comes back no more.
    Away,
}

/// By how much deviations that are looked at differ from one to the next: by less than a dozen turns tell them apart.
const STEP: f64 = std::f64::consts::SQRT_2;

/// How many at most.
const DEVIATIONS: i32 = 24;

impl Wander {
    /// None.
    pub(super) const NONE: Self = Self {
        variance: 0.0,
        kind: Kind::About(0.0),
    };

    /// The ways to wander that turns over a length of time may show: deviations up to some times of what turns leave (`scatter`, of a turn's
    /// noise), a step apart; times from less than a turn up to as long as was watched. What is slower has taken the peak along.
    pub(super) fn all(length: f64, scatter: f64) -> Vec<Self> {
        let mut kinds = vec![Kind::About(0.0), Kind::Away];
        let mut time = 1.0;
        while time <= length {
            kinds.push(Kind::About(time));
            time *= 2.0;
        }
        let deviations = (0..DEVIATIONS)
            .map(|k| TUNING.answer.most_wander * scatter.max(1.0) * STEP.powi(-k))
            .take_while(|deviation| *deviation >= TUNING.answer.least_wander);
        deviations
            .flat_map(|deviation| {
                kinds.iter().map(move |kind| Self {
                    variance: deviation * deviation,
                    kind: *kind,
                })
            })
            .collect()
    }

    /// The peak itself goes away, by so much more variance a turn.
    pub(super) const fn away(variance: f64) -> Self {
        Self {
            variance,
            kind: Kind::Away,
        }
    }

    /// How probable it is before anything is seen, beside the others of [`Self::all`]: a deviation is as probable as any other, which a few
    /// turns do not contradict (Gelman, Bayesian Analysis 1 (2006) 515: what is uniform in the logarithm believes too readily in none).
    pub(super) fn prior(&self) -> f64 {
        self.variance.sqrt()
    }

    /// Whether the peak goes along with it.
    pub(super) fn takes_the_peak(&self) -> bool {
        self.kind == Kind::Away
    }

    /// What is left of it after so many turns, and the variance that has come meanwhile.
    fn after(&self, turns: f64) -> (f64, f64) {
        match self.kind {
            Kind::Away => (1.0, self.variance * turns),
            Kind::About(time) => {
                let keeps = if turns > 0.0 {
                    (-turns / time).exp()
                } else {
                    1.0
                };
                (keeps, self.variance * (1.0 - keeps * keeps))
            }
        }
    }
}

/// A wander that is followed through what is seen along so many axes, one behind the other: a Kalman filter. It follows several columns side
/// by side, of which each is what would have to be a wander where nothing else was there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Track<const AXES: usize, const N: usize> {
    wander: Wander,
    /// Where it has come to.
    pub(super) at: SMatrix<f64, AXES, N>,
    /// Along each axis.
    pub(super) variance: f64,
    time: f64,
}

impl<const AXES: usize, const N: usize> Track<AXES, N> {
    /// One that nothing is known of; one that takes the peak along begins where that is.
    pub(super) fn new(wander: Wander, time: f64) -> Self {
        Self {
            wander,
            at: SMatrix::zeros(),
            variance: if wander.takes_the_peak() {
                0.0
            } else {
                wander.variance
            },
            time,
        }
    }

    /// Lets time pass, turns.
    pub(super) fn until(&mut self, time: f64) {
        let (keeps, more) = self.wander.after(time - self.time);
        self.at *= keeps;
        self.variance = keeps * keeps * self.variance + more;
        self.time = time;
    }

    /// Takes in what is seen with a noise of some variance. Returns what is new in it, and the variance of that.
    pub(super) fn see(
        &mut self,
        seen: &SMatrix<f64, AXES, N>,
        noise: f64,
    ) -> (SMatrix<f64, AXES, N>, f64) {
        let new = seen - self.at;
        let variance = self.variance + noise;
        let gain = self.variance / variance;
        self.at += new * gain;
        self.variance *= 1.0 - gain;
        (new, variance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    /// What is new in turn after turn has the likelihood that all of them have together, by their covariance.
    #[test]
    fn a_track_knows_what_its_covariance_says() {
        let times = [0.0_f64, 1.0, 2.0, 4.3, 5.3];
        let seen = [0.3, -1.2, 0.4, 2.0, 1.1];
        let noises = [1.0, 1.0, 1.5, 1.0, 4.0];
        for (kind, covariance) in [
            (
                Kind::About(3.0),
                Box::new(|a: f64, b: f64| 2.0 * (-(a - b).abs() / 3.0).exp())
                    as Box<dyn Fn(f64, f64) -> f64>,
            ),
            (
                Kind::About(0.0),
                Box::new(|a, b| if a == b { 2.0 } else { 0.0 }),
            ),
            (Kind::Away, Box::new(|a, b| 2.0 * a.min(b))),
        ] {
            let wander = Wander {
                variance: 2.0,
                kind,
            };
            let all = DMatrix::from_fn(5, 5, |i, j| {
                covariance(times[i], times[j]) + if i == j { noises[i] } else { 0.0 }
            });
            let values = DMatrix::from_column_slice(5, 1, &seen);
            let expected = (values.transpose() * all.clone().try_inverse().unwrap() * &values)[0];
            let mut track = Track::<2, 1>::new(wander, 0.0);
            let (mut squares, mut volume) = (0.0, 1.0);
            for ((time, value), noise) in times.iter().zip(seen).zip(noises) {
                track.until(*time);
                let (new, variance) = track.see(&SMatrix::repeat(value), noise);
                squares += new[0] * new[0] / variance;
                volume *= variance;
            }
            assert!(
                (squares - expected).abs() < 1e-9,
                "{kind:?} {squares} {expected}"
            );
            assert!((volume / all.determinant() - 1.0).abs() < 1e-9, "{kind:?}");
        }
    }
}
