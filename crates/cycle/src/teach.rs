//! What earlier fibers have taught of how adhesive shifts a fiber after its gel point.
//!
//! Until the gel point the micro follows the light's peak: where it went tells how far the fiber was pulled, and in which
//! direction. After it the fiber is fixed. Bent a little by its holder, its light tells where it is from its peak. Where that was not to be
//! seen, what was lost tells how far off the peak it is, and no more: a loss of `r` nepers at a
//! place `p` beside the peak, where the light falls as `exp(-d^2/w^2)`, says `|p + a|^2 = w^2 r` of the shift `a`. Fibers
//! that were fixed at different places `p` tell where `a` is, as distances from known points do.
//!
//! The estimate is near the mean of what `a` may be: beforehand it is as many times the mean pull before the gel point as the
//! adhesive's maker says, to a third of its length. Not the most probable one: one distance leaves a ring, on which the shift may
//! lie on this side or on that, and who takes one of them for true is off by the whole of it if it is the other. The loss goes with the
//! square of what is left, and its mean is least at the mean.

use pigtail_control::hold;
use pigtail_model::frames::Displacement;

/// What a fiber has told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lesson {
    /// How far it was pulled until the micro came to rest, metres in the manipulator's x and y.
    pub before: Displacement,
    /// Where it was fixed, from the peak, metres.
    pub beyond: Displacement,
    /// Where it is in the end.
    pub told: Told,
}

/// What is known of where a fiber is in the end, from its peak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Told {
    /// The place, metres, and its standard deviation along both axes.
    Place(Displacement, [f64; 2]),
    /// The square of the distance, by the light that it has lost, square metres, and the standard deviation of that.
    Squared(f64, f64),
}

/// What is known of the shift on one side.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Teacher {
    lessons: Vec<Lesson>,
}

/// Relative standard deviation of the shift that is expected beforehand.
const BEFOREHAND: f64 = 0.33;

/// How far the micro goes after other things than the pull until the gel point, standard deviation, metres: what drifts, for 10 s. How
/// piezos creep is told apart before that, and of a side's first fiber the drift is, mostly.
const DRIFTS: f64 = 10.0 * hold::DRIFTS;

/// How far from what was found before the mean is looked for, standard deviations; in how many steps to either side; and how
/// often.
const FAR: f64 = 4.0;
const GRID: i32 = 20;
const LOOKS: usize = 4;

/// Share of the way from the mean to the most probable shift that is gone: fibers that were all fixed at the same place would never
/// tell which of two sides it is. Where there are two as probable, that costs a sixth more loss once.
const TRIES: f64 = 0.4;

impl Teacher {
    /// Another fiber is done.
    pub fn learn(&mut self, lesson: Lesson) {
        self.lessons.push(lesson);
    }

    /// How many there were.
    pub fn fibers(&self) -> usize {
        self.lessons.len()
    }

    /// The shift to expect of a fiber after it has come to rest, which until then was pulled so far: metres. `ratio` is
    /// shift after the gel point over that before, as the maker says; `scatter` its standard deviation along an axis.
    pub fn expect(&self, before: Displacement, ratio: f64, scatter: f64) -> Displacement {
        let n = (self.lessons.len() + 1) as f64;
        let sum = self.lessons.iter().fold(before, |sum, l| sum + l.before);
        let prior = sum * (ratio / n);
        // Machines warm up: what the micro went after is not all pull.
        let wide = (BEFOREHAND * prior.norm())
            .hypot(DRIFTS * ratio / n.sqrt())
            .hypot(scatter);
        let ln = |a: Displacement| {
            let away = (a - prior).norm() / wide;
            let told = self.lessons.iter().map(|lesson| {
                let there = lesson.beyond + a;
                match lesson.told {
                    Told::Place(at, sigma) => {
                        let by = at - there;
                        let along =
                            |by: f64, sigma: f64| by * by / (scatter * scatter + sigma * sigma);
                        along(by.x, sigma[0]) + along(by.y, sigma[1])
                    }
                    Told::Squared(squared, noise) => {
                        let off = there.norm();
                        // A distance squared of which both parts scatter.
                        let spread =
                            4.0 * scatter.powi(4) + (2.0 * scatter * off).powi(2) + noise * noise;
                        let by = squared - off * off - 2.0 * scatter * scatter;
                        by * by / spread + spread.ln()
                    }
                }
            });
            -0.5 * (away * away + told.sum::<f64>())
        };
        let mut found = (prior, [wide; 2], prior);
        if !self.lessons.is_empty() {
            for _ in 0..LOOKS {
                found = mean((found.0, found.1), &ln);
            }
        }
        let (mean, _, most) = found;
        mean + (most - mean) * TRIES
    }
}

/// Mean of a density in the plane, of which the logarithm is given, and its standard deviations across and up: on a grid around
/// what was found before. And where on that grid it is greatest.
fn mean(
    (at, [wide, high]): (Displacement, [f64; 2]),
    ln: &dyn Fn(Displacement) -> f64,
) -> (Displacement, [f64; 2], Displacement) {
    let steps = -GRID..=GRID;
    let along = |wide: f64, k: i32| FAR * wide * f64::from(k) / f64::from(GRID);
    let grid: Vec<(Displacement, f64)> = steps
        .clone()
        .flat_map(|i| steps.clone().map(move |k| (i, k)))
        .map(|(i, k)| {
            let a = at + Displacement::new(along(wide, i), along(high, k));
            (a, ln(a))
        })
        .collect();
    let first = (at, f64::NEG_INFINITY);
    let (greatest, most) = grid
        .iter()
        .fold(first, |most, of| if of.1 > most.1 { *of } else { most });
    let (mut all, mut sum, mut squares) = (0.0, Displacement::ZERO, [0.0; 2]);
    for (a, ln) in grid {
        let weight = (ln - most).exp();
        let from = a - at;
        all += weight;
        sum += from * weight;
        squares[0] += weight * from.x * from.x;
        squares[1] += weight * from.y * from.y;
    }
    let by = sum * (1.0 / all);
    // No narrower than the grid can tell.
    let deviation = |square: f64, by: f64, before: f64| {
        (square / all - by * by)
            .max(0.0)
            .sqrt()
            .max(along(before, 1))
    };
    let deviations = [
        deviation(squares[0], by.x, wide),
        deviation(squares[1], by.y, high),
    ];
    (at + by, deviations, greatest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(truth: Displacement, fibers: usize, scatter: f64) -> Displacement {
        let mut teacher = Teacher::default();
        let before = Displacement::new(0.1e-6, -0.7e-6);
        for k in 0..fibers {
            let beyond = teacher.expect(before, 1.0, 0.1e-6) * -1.0;
            // As a generator of no randomness would: around a circle.
            let by = Displacement::polar(scatter, 2.4 * k as f64);
            let off = (beyond + truth + by).norm();
            teacher.learn(Lesson {
                before,
                beyond,
                told: Told::Squared(off * off, 1e-15),
            });
        }
        teacher.expect(before, 1.0, 0.1e-6)
    }

    #[test]
    fn the_first_fiber_is_expected_to_go_on_as_it_has_begun() {
        let before = Displacement::new(0.2e-6, -0.8e-6);
        let expected = Teacher::default().expect(before, 0.5, 0.1e-6);
        assert!((expected - before * 0.5).norm() < 1e-12);
    }

    #[test]
    fn a_distance_that_may_be_on_either_side_moves_nothing_to_one() {
        let before = Displacement::new(0.0, -0.5e-6);
        let mut teacher = Teacher::default();
        let first = teacher.expect(before, 1.0, 0.1e-6);
        // It ended as far off as its shift differs, up or down.
        teacher.learn(Lesson {
            before,
            beyond: first * -1.0,
            told: Told::Squared(0.3e-6_f64.powi(2), 1e-15),
        });
        let then = teacher.expect(before, 1.0, 0.1e-6);
        assert!(
            (then - first).norm() < 0.5 * 0.3e-6,
            "{first:?}, then {then:?}"
        );
    }

    #[test]
    fn later_ones_tell_where_it_really_goes() {
        let truth = Displacement::new(-0.1e-6, -0.9e-6);
        let first = (after(truth, 0, 0.05e-6) - truth).norm();
        let later = (after(truth, 24, 0.05e-6) - truth).norm();
        assert!(later < 0.5 * first, "{first} m, then {later} m");
    }

    #[test]
    fn one_place_tells_most_of_the_shift_and_no_more_than_scatter_allows() {
        let (before, scatter) = (Displacement::new(0.0, -0.7e-6), 0.1e-6);
        let truth = Displacement::new(0.2e-6, -0.9e-6);
        let mut teacher = Teacher::default();
        let beyond = teacher.expect(before, 1.0, scatter) * -1.0;
        teacher.learn(Lesson {
            before,
            beyond,
            told: Told::Place(beyond + truth, [0.02e-6; 2]),
        });
        let then = teacher.expect(before, 1.0, scatter);
        // Of the way from what was expected, the share of two normal laws.
        let wide = (BEFOREHAND * 0.7e-6)
            .hypot(DRIFTS / 2.0_f64.sqrt())
            .hypot(scatter)
            .powi(2);
        let share = wide / (wide + scatter * scatter + 0.02e-6_f64.powi(2));
        let expected = before + (truth - before) * share;
        assert!((then - expected).norm() < 0.01e-6, "{then:?}, {expected:?}");
    }
}
