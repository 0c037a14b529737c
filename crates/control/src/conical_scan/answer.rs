//! How peaks that turns have seen answer to where the circles' middles were, on a bench that nobody has measured: a spot wider than
//! believed answers by less than it should, a meter that is late answers aside. Both are the same from turn to turn, so that what was
//! seen from aside is no drift of the peak.

use crate::beam::Peak;
use nalgebra::{Matrix6, SMatrix, Vector2, Vector6};
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::Normal;

/// How much more or less than it should, and how far aside, a peak may be seen of what its circle's middle was off; one standard deviation. A
/// spot that is wider or narrower by 15 % makes so much, and so does light that is later than believed by a twentieth of
/// a turn. A choice.
const UNKNOWN: f64 = 0.3;

/// Steps to the fit, which is nearly linear.
const STEPS: usize = 6;

/// Most that is believed of how alike what turns in succession leave is.
const MOST_ALIKE: f64 = 0.8;

/// Where the peak is in time, by turns, and how the bench answers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    /// Where it was in the first turn, from the origin.
    start: Displacement,
    /// Its way, metres a turn...
    pub(super) slope: Displacement,
    /// ...and how well that is known.
    pub(super) slope_deviation: f64,
    /// Variance of a turn's peak about all that, along an axis, square metres.
    pub(super) scatter: f64,
    /// How much of an offset is seen along it, and aside.
    answers: [f64; 2],
    /// Covariance: of the start in x and in y and of the way, square metres; of what is seen of an offset.
    covariance: Matrix6<f64>,
}

impl Answer {
    /// Of peaks a turn apart and the middles of their circles; each is known to `noise` (metres) along an axis, or worse.
    pub(super) fn of(seen: &[Peak], middles: &[Displacement], noise: f64) -> Self {
        let scale = noise.max(f64::EPSILON * seen[0].at.norm()).max(1e-15);
        let origin = seen[0].at;
        let vector = |at: Displacement| Vector2::new(at.x - origin.x, at.y - origin.y) / scale;
        let turns = seen.iter().zip(middles).enumerate();
        let turns: Vec<_> = turns
            .map(|(k, (peak, middle))| (k as f64, vector(peak.at), vector(*middle)))
            .collect();
        let first = Fit::of(&turns, 1.0);
        let excess = first.scatter.max(1.0);
        let fit = if excess > 1.0 {
            Fit::of(&turns, excess)
        } else {
            first
        };
        // What is alike in turns that follow each other is less often new.
        let together = scale * scale * fit.alike;
        let mut covariance = fit.covariance * together;
        for i in 4..6 {
            covariance[(i, i)] = fit.covariance[(i, i)];
        }
        let [x, y] = [0, 1].map(|i| scale * fit.at[i]);
        Self {
            start: origin + Displacement::new(x, y),
            slope: Displacement::new(scale * fit.at[2], scale * fit.at[3]),
            slope_deviation: covariance[(2, 2)].max(covariance[(3, 3)]).sqrt(),
            scatter: fit.scatter * scale * scale,
            answers: [fit.at[4], fit.at[5]],
            covariance,
        }
    }

    /// Why what answers so is no group and no spot as they are believed; `None` where they may be.
    pub(super) fn is_foreign(&self) -> Option<String> {
        /// Farthest from what it should be, by the complex logarithm: a spot that is 35 % wider or narrower, or light a tenth of a turn later,
        /// with nothing else. A choice.
        const MOST: f64 = 0.6;
        /// Standard deviations that it is beyond that.
        const SURELY: f64 = 3.0;
        let (along, aside) = (self.answers[0], self.answers[1]);
        let gain = along.hypot(aside);
        let off = gain.ln().hypot(aside.atan2(along));
        let known = self.covariance[(4, 4)].max(self.covariance[(5, 5)]).sqrt() / gain;
        (off - SURELY * known > MOST).then(|| {
            let degrees = aside.atan2(along).to_degrees();
            format!(
                "beside the peak its light answers {gain:.2} times as much as it should and {degrees:.0} degrees aside: \
                 the spot is not as wide as the recipe says, or the light is not as late as the group's lag says"
            )
        })
    }

    /// Where the peak is at a turn, and the standard deviation of that in the worse direction, metres.
    pub(super) fn at(&self, turn: f64) -> (Displacement, f64) {
        let variance = [0, 1].map(|i| {
            let c = |a: usize, b: usize| self.covariance[(a, b)];
            c(i, i) + 2.0 * turn * c(i, i + 2) + turn * turn * c(i + 2, i + 2)
        });
        let deviation = variance[0].max(variance[1]).sqrt();
        (self.start + self.slope * turn, deviation)
    }
}

/// The start in x and y, the way in x and y, and what of an offset is seen: along, and aside. In units of a turn's noise.
struct Fit {
    at: Vector6<f64>,
    covariance: Matrix6<f64>,
    scatter: f64,
    /// By how much more variance a mean has, as what turns in succession leave is alike.
    alike: f64,
}

impl Fit {
    fn of(turns: &[(f64, Vector2<f64>, Vector2<f64>)], variance: f64) -> Self {
        let n = turns.len() as f64;
        let mean = turns.iter().map(|(_, seen, _)| seen).sum::<Vector2<f64>>() / n;
        let mut at = Vector6::new(mean.x, mean.y, 0.0, 0.0, 1.0, 0.0);
        let prior = UNKNOWN.powi(-2);
        let mut covariance = Matrix6::identity();
        for _ in 0..STEPS {
            let mut normal = Normal::<6>::default();
            for (k, seen, middle) in turns {
                let (rows, left) = Self::turn(&at, *k, seen, middle);
                for i in 0..2 {
                    let row = rows.row(i).transpose() / variance.sqrt();
                    normal.add(&row, left[i] / variance.sqrt());
                }
            }
            for (i, expected) in [(4, 1.0), (5, 0.0)] {
                normal.matrix[(i, i)] += prior;
                normal.right[i] += prior * (expected - at[i]);
            }
            let Some(inverse) = normal.matrix.try_inverse() else {
                break;
            };
            at += inverse * normal.right;
            covariance = inverse;
        }
        let left: Vec<_> = turns
            .iter()
            .map(|(k, seen, middle)| Self::turn(&at, *k, seen, middle).1)
            .collect();
        let squares: f64 = left.iter().map(Vector2::norm_squared).sum();
        let told = 2.0 - prior * (covariance[(4, 4)] + covariance[(5, 5)]);
        let free = (2.0 * n - 4.0 - told).max(1.0);
        let after: f64 = left.windows(2).map(|two| two[0].dot(&two[1])).sum();
        // A line through turns makes what is left of them less alike, by so much.
        let alike = (after / squares.max(f64::MIN_POSITIVE) + 2.0 / n).clamp(0.0, MOST_ALIKE);
        Self {
            at,
            covariance,
            scatter: squares / free,
            alike: (1.0 + alike) / (1.0 - alike),
        }
    }

    /// How a turn's peak goes with all that, and what that leaves of it.
    fn turn(
        at: &Vector6<f64>,
        k: f64,
        seen: &Vector2<f64>,
        middle: &Vector2<f64>,
    ) -> (SMatrix<f64, 2, 6>, Vector2<f64>) {
        let off = Vector2::new(at[0] + k * at[2], at[1] + k * at[3]) - middle;
        let (g, h) = (at[4], at[5]);
        let expected = Vector2::new(g * off.x - h * off.y, h * off.x + g * off.y);
        let rows = SMatrix::<f64, 2, 6>::new(
            g,
            -h,
            k * g,
            -k * h,
            off.x,
            -off.y,
            h,
            g,
            k * h,
            k * g,
            off.y,
            off.x,
        );
        (rows, seen - middle - expected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Peaks of a bench that answers by `gain` and `aside` of an offset, whose circles go where they saw the peak.
    fn turns(gain: f64, aside: f64, way: f64) -> (Vec<Peak>, Vec<Displacement>) {
        let (mut seen, mut middles) = (Vec::new(), Vec::new());
        let mut middle = Displacement::new(400e-9, -150e-9);
        for k in 0..8 {
            let off = Displacement::new(way * f64::from(k), 0.0) - middle;
            let by = Displacement::new(gain * off.x - aside * off.y, aside * off.x + gain * off.y);
            middles.push(middle);
            middle += by;
            seen.push(Peak {
                at: middle,
                full: 1.0,
                full_deviation: 0.0,
                deviations: [2e-9; 2],
            });
        }
        (seen, middles)
    }

    #[test]
    fn what_is_seen_from_aside_is_no_drift() {
        for (gain, aside) in [(1.0, 0.0), (0.7, 0.0), (1.3, 0.0), (0.8, 0.4), (0.6, -0.3)] {
            for way in [0.0, 10e-9] {
                let (seen, middles) = turns(gain, aside, way);
                let answer = Answer::of(&seen, &middles, 2e-9);
                let (at, deviation) = answer.at(9.0);
                let error = (at - Displacement::new(9.0 * way, 0.0)).norm();
                assert!(
                    error < 3.0 * deviation,
                    "{gain} {aside} {way}: {error} {deviation}"
                );
                assert!(deviation < 10e-9, "{gain} {aside} {way}: {deviation}");
            }
        }
    }

    #[test]
    fn what_answers_far_aside_is_not_believed() {
        for (gain, aside, foreign) in [
            (1.0, 0.0, false),
            (0.7, 0.0, false),
            (0.9, 0.35, false),
            (0.6, 0.8, true),
            (0.3, 0.0, true),
        ] {
            let (seen, middles) = turns(gain, aside, 0.0);
            let answer = Answer::of(&seen, &middles, 2e-9);
            assert_eq!(answer.is_foreign().is_some(), foreign, "{gain} {aside}");
        }
    }

    #[test]
    fn a_middle_that_stays_tells_nothing_of_the_answer_and_that_is_said() {
        let (seen, _) = turns(1.0, 0.0, 0.0);
        let aside = [Displacement::new(-300e-9, 0.0); 8];
        let answer = Answer::of(&seen[1..], &aside[1..], 2e-9);
        let (_, deviation) = answer.at(9.0);
        assert!(deviation > 60e-9, "{deviation}");
    }
}
