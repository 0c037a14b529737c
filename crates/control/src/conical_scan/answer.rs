//! How peaks that turns have seen answer to where the circles' middles were, on a bench that nobody has measured: a spot wider than
//! believed answers by less than it should, a meter that is late answers aside. Both are the same from turn to turn, so that what was
//! seen from aside is no drift of the peak. How the peak wanders beside is not known either, and told by the same turns.

use super::wander::{Track, Wander};
use crate::beam::Peak;
use crate::tuning::TUNING;
use nalgebra::{Matrix2, Matrix6, SMatrix, Vector2, Vector6};
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::Normal;

/// Steps to the fit, which is nearly linear...
const STEPS: usize = 6;

/// ...and from there to that of another wander.
const MORE_STEPS: usize = 2;

/// A turn that has found the peak.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    pub(super) peak: Peak,
    /// The circle's middle.
    pub(super) middle: Displacement,
    /// When it was over, seconds.
    pub(super) time: f64,
}

/// Where the peak is in time, by turns, and how the bench answers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    /// Where it will be...
    pub(super) at: Displacement,
    /// ...and the standard deviation of that in the worse direction, metres.
    pub(super) deviation: f64,
    /// Its way, metres a turn...
    pub(super) slope: Displacement,
    /// ...and how well that is known.
    pub(super) slope_deviation: f64,
    /// Variance of a turn's peak about all that, along an axis, square metres.
    pub(super) scatter: f64,
    /// How much of an offset is seen along it, and aside...
    answers: [f64; 2],
    /// ...and how well that is known.
    answers_deviation: f64,
}

impl Answer {
    /// Of turns that take `period` seconds, each known to `noise` (metres) along an axis, or worse where it says so itself. The peak is
    /// foreseen so many turns after the last of them as far as it goes on steadily, and so many as it wanders.
    pub(super) fn of(turns: &[Turn], period: f64, noise: f64, after: (f64, f64)) -> Self {
        let origin = turns[0].peak.at;
        let scale = noise.max(f64::EPSILON * origin.norm()).max(1e-15);
        let vector = |at: Displacement| Vector2::new(at.x - origin.x, at.y - origin.y) / scale;
        let row = |turn: &Turn| Row {
            time: (turn.time - turns[0].time) / period,
            seen: vector(turn.peak.at),
            middle: vector(turn.middle),
            noise: (turn.peak.deviation() / scale).powi(2).max(1.0),
        };
        let rows: Vec<Row> = turns.iter().map(row).collect();
        let last = rows.last().map_or(0.0, |row| row.time);
        let first = Fit::of(&rows, Wander::NONE, Fit::start(&rows), STEPS);
        let scatter = first.scatter(rows.len());
        let wanders = Wander::all(last, scatter.sqrt());
        let fits = wanders.into_iter();
        let fits: Vec<Fit> = fits
            .map(|wander| Fit::of(&rows, wander, first.at, MORE_STEPS))
            .collect();
        let all = Together::of(&fits, last + after.0, last + after.1);
        let metres = |at: Vector2<f64>| Displacement::new(scale * at.x, scale * at.y);
        let deviation =
            |i: usize, j: usize| all.covariance[(i, i)].max(all.covariance[(j, j)]).sqrt();
        Self {
            at: origin + metres(all.place),
            deviation: scale * all.spread[(0, 0)].max(all.spread[(1, 1)]).sqrt(),
            slope: metres(Vector2::new(all.at[2], all.at[3])),
            slope_deviation: scale * deviation(2, 3),
            scatter: scatter * scale * scale,
            answers: [all.at[4], all.at[5]],
            answers_deviation: deviation(4, 5),
        }
    }

    /// Why what answers so is no group and no spot as they are believed; `None` where they may be.
    pub(super) fn is_foreign(&self) -> Option<String> {
        let (along, aside) = (self.answers[0], self.answers[1]);
        let gain = along.hypot(aside);
        let off = gain.ln().hypot(aside.atan2(along));
        let known = self.answers_deviation / gain;
        (off - TUNING.answer.surely * known > TUNING.answer.most).then(|| {
            let degrees = aside.atan2(along).to_degrees();
            format!(
                "beside the peak its light answers {gain:.2} times as much as it should and {degrees:.0} degrees aside: \
                 the spot is not as wide as the recipe says, or the light is not as late as the group's lag says"
            )
        })
    }
}

/// A turn, in units of its noise.
struct Row {
    /// Turns since the first.
    time: f64,
    seen: Vector2<f64>,
    middle: Vector2<f64>,
    /// Variance.
    noise: f64,
}

/// The start in x and y, the way in x and y, and what of an offset is seen: along, and aside; where the peak wanders in one way. By
/// generalised least squares, in units of a turn's noise.
struct Fit {
    at: Vector6<f64>,
    covariance: Matrix6<f64>,
    /// What it leaves of all turns, by their deviations, squared.
    squares: f64,
    /// Logarithm of how likely the turns are, whatever start, way and answers, times how probable the wander is without them.
    likelihood: f64,
    wander: Wander,
    /// The wander at the last turn, as it is seen: by what the fit leaves, and what each of its numbers would be taken for one.
    track: Track<2, 7>,
    /// The last step to the fit, from where the track was followed.
    step: Vector6<f64>,
}

impl Fit {
    fn start(rows: &[Row]) -> Vector6<f64> {
        let mean = rows.iter().map(|row| row.seen).sum::<Vector2<f64>>() / rows.len() as f64;
        Vector6::new(mean.x, mean.y, 0.0, 0.0, 1.0, 0.0)
    }

    fn of(rows: &[Row], wander: Wander, mut at: Vector6<f64>, steps: usize) -> Self {
        let prior = TUNING.answer.unknown.powi(-2);
        let mut fit = None;
        for _ in 0..steps {
            let mut track = Track::new(wander, 0.0);
            let mut normal = Normal::<6>::default();
            let (mut squares, mut volume) = (0.0, 0.0);
            for row in rows {
                track.until(row.time);
                let (new, variance) = track.see(&row.against(&at), row.noise);
                volume += 2.0 * variance.ln();
                for new in new.row_iter() {
                    let of = new.fixed_columns::<6>(0).transpose();
                    normal.add_weighted(&of, new[6], variance.recip());
                    squares += new[6] * new[6] / variance;
                }
            }
            for (i, expected) in [(4, 1.0), (5, 0.0)] {
                let off = expected - at[i];
                normal.matrix[(i, i)] += prior;
                normal.right[i] += prior * off;
                squares += prior * off * off;
            }
            let Some(cholesky) = normal.matrix.cholesky() else {
                break;
            };
            let step = cholesky.solve(&normal.right);
            let squares = squares - step.dot(&normal.right);
            let volume = volume + 2.0 * cholesky.l_dirty().diagonal().map(f64::ln).sum();
            at += step;
            fit = Some(Self {
                at,
                covariance: cholesky.inverse(),
                squares,
                likelihood: wander.prior().ln() - 0.5 * (squares + volume),
                wander,
                track,
                step,
            });
        }
        fit.unwrap_or_else(|| Self {
            at,
            covariance: Matrix6::identity() * f64::INFINITY,
            squares: f64::INFINITY,
            likelihood: f64::NEG_INFINITY,
            wander,
            track: Track::new(wander, 0.0),
            step: Vector6::zeros(),
        })
    }

    /// Variance of a turn about it.
    fn scatter(&self, turns: usize) -> f64 {
        let told = 2.0
            - TUNING.answer.unknown.powi(-2) * (self.covariance[(4, 4)] + self.covariance[(5, 5)]);
        self.squares / (2.0 * turns as f64 - 4.0 - told).max(1.0)
    }

    /// Where the peak is when it has gone on steadily until one time and wandered until another, and the covariance of that.
    fn place(&self, line: f64, until: f64) -> (Vector2<f64>, Matrix2<f64>) {
        let at = &self.at;
        let mut place = Vector2::new(at[0] + line * at[2], at[1] + line * at[3]);
        let mut rows = SMatrix::<f64, 2, 6>::zeros();
        for i in 0..2 {
            rows[(i, i)] = 1.0;
            rows[(i, i + 2)] = line;
        }
        let mut covariance = Matrix2::zeros();
        if self.wander.takes_the_peak() {
            let mut track = self.track;
            track.until(until);
            // What is seen of it is what is seen of every offset.
            let (g, h) = (at[4], at[5]);
            let gain = (g * g + h * h).max(f64::MIN_POSITIVE);
            let back = Matrix2::new(g, h, -h, g) / gain;
            let taken = back * track.at.fixed_columns::<6>(0);
            place += back * track.at.column(6) - taken * self.step;
            rows -= taken;
            covariance += Matrix2::identity() * (track.variance / gain);
        }
        (
            place,
            covariance + rows * self.covariance * rows.transpose(),
        )
    }
}

impl Row {
    /// How the turn's peak goes with all numbers of a fit, and what they leave of it.
    fn against(&self, at: &Vector6<f64>) -> SMatrix<f64, 2, 7> {
        let k = self.time;
        let off = Vector2::new(at[0] + k * at[2], at[1] + k * at[3]) - self.middle;
        let (g, h) = (at[4], at[5]);
        let expected = Vector2::new(g * off.x - h * off.y, h * off.x + g * off.y);
        let left = self.seen - self.middle - expected;
        SMatrix::<f64, 2, 7>::from_row_slice(&[
            g,
            -h,
            k * g,
            -k * h,
            off.x,
            -off.y,
            left.x,
            h,
            g,
            k * h,
            k * g,
            off.y,
            off.x,
            left.y,
        ])
    }
}

/// What the fits of all ways to wander say, each by how likely it is.
struct Together {
    /// The start, the way, and the answers...
    at: Vector6<f64>,
    covariance: Matrix6<f64>,
    /// ...and where the peak will be.
    place: Vector2<f64>,
    spread: Matrix2<f64>,
}

impl Together {
    fn of(fits: &[Fit], line: f64, until: f64) -> Self {
        let likely = fits.iter().map(|fit| fit.likelihood);
        let most = likely.fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = fits
            .iter()
            .map(|fit| (fit.likelihood - most).exp())
            .collect();
        let sum: f64 = weights.iter().sum();
        let mut all = Self {
            at: Vector6::zeros(),
            covariance: Matrix6::zeros(),
            place: Vector2::zeros(),
            spread: Matrix2::zeros(),
        };
        let said: Vec<_> = fits
            .iter()
            .zip(weights)
            .filter(|(_, weight)| *weight > 0.0)
            .map(|(fit, weight)| (fit, fit.place(line, until), weight / sum))
            .collect();
        for (fit, (place, _), weight) in &said {
            all.at += fit.at * *weight;
            all.place += place * *weight;
        }
        for (fit, (place, spread), weight) in &said {
            let (at, place) = (fit.at - all.at, place - all.place);
            all.covariance += (fit.covariance + at * at.transpose()) * *weight;
            all.spread += (spread + place * place.transpose()) * *weight;
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turns of a bench that answers by `gain` and `aside` of an offset, whose circles go where they saw the peak.
    fn turns(gain: f64, aside: f64, way: f64) -> Vec<Turn> {
        let mut turns = Vec::new();
        let mut middle = Displacement::new(400e-9, -150e-9);
        for k in 0..8 {
            let off = Displacement::new(way * f64::from(k), 0.0) - middle;
            let by = Displacement::new(gain * off.x - aside * off.y, aside * off.x + gain * off.y);
            let peak = Peak {
                at: middle + by,
                full: 1.0,
                full_deviation: 0.0,
                deviations: [2e-9; 2],
            };
            turns.push(Turn {
                peak,
                middle,
                time: f64::from(k),
            });
            middle += by;
        }
        turns
    }

    #[test]
    fn what_is_seen_from_aside_is_no_drift() {
        for (gain, aside) in [(1.0, 0.0), (0.7, 0.0), (1.3, 0.0), (0.8, 0.4), (0.6, -0.3)] {
            for way in [0.0, 10e-9] {
                let turns = turns(gain, aside, way);
                let Answer { at, deviation, .. } = Answer::of(&turns, 1.0, 2e-9, (2.0, 2.0));
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
            let answer = Answer::of(&turns(gain, aside, 0.0), 1.0, 2e-9, (2.0, 2.0));
            assert_eq!(answer.is_foreign().is_some(), foreign, "{gain} {aside}");
        }
    }

    #[test]
    fn a_middle_that_stays_tells_nothing_of_the_answer_and_that_is_said() {
        let mut turns = turns(1.0, 0.0, 0.0);
        for turn in &mut turns {
            turn.middle = Displacement::new(-300e-9, 0.0);
        }
        let Answer { deviation, .. } = Answer::of(&turns[1..], 1.0, 2e-9, (2.0, 2.0));
        assert!(deviation > 60e-9, "{deviation}");
    }
}
