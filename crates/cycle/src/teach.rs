//! What earlier fibers have taught of how adhesive shifts a fiber after its gel point.
//!
//! Until the gel point the micro follows the light's peak: where it went tells how far the fiber was pulled, and in which
//! direction. After it only the light is left to tell, and that only how far off the peak a fiber is: a loss of `r` nepers at a
//! place `p` beside the peak, where the light falls as `exp(-d^2/w^2)`, says `|p + a|^2 = w^2 r` of the shift `a`. Fibers
//! that were fixed at different places `p` tell where `a` is, as distances from known points do.
//!
//! The estimate is the most probable mean of `a`: beforehand it is as many times the mean pull before the gel point as the
//! adhesive's maker says, to a third of its length.

use pigtail_model::frames::Displacement;

/// What a fiber has told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lesson {
    /// How far it was pulled until the micro came to rest, metres in the manipulator's x and y.
    pub before: Displacement,
    /// Where it was fixed, from the peak, metres.
    pub beyond: Displacement,
    /// Square of its distance from the peak in the end, by the light, square metres; and the standard deviation of that.
    pub squared: (f64, f64),
}

/// What is known of the shift on one side.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Teacher {
    lessons: Vec<Lesson>,
}

/// Relative standard deviation of the shift that is expected beforehand.
const BEFOREHAND: f64 = 0.33;

/// How far the micro goes after other things than the pull until the gel point, standard deviation, metres: piezos that creep
/// by 2 % of 10 um in a decade of time, and a machine that warms up.
const CREEPS: f64 = 0.2e-6;

/// Where the search for the most probable shift ends, metres.
const FINE: f64 = 2e-9;

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
        // Piezos creep, machines warm up: what the micro went after is not all pull.
        let wide = (BEFOREHAND * prior.norm())
            .hypot(CREEPS * ratio / n.sqrt())
            .hypot(scatter);
        let cost = |a: Displacement| {
            let away = (a - prior).norm() / wide;
            let told = self.lessons.iter().map(|lesson| {
                let (squared, noise) = lesson.squared;
                let off = (lesson.beyond + a).norm();
                // A distance squared of which both parts scatter.
                let spread = 4.0 * scatter.powi(4) + (2.0 * scatter * off).powi(2) + noise * noise;
                let by = squared - off * off - 2.0 * scatter * scatter;
                by * by / spread + spread.ln()
            });
            away * away + told.sum::<f64>()
        };
        let (mut at, mut step) = (prior, 0.5 * wide);
        let mut least = cost(at);
        while step > FINE {
            let around = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
            let better = around
                .map(|(x, y)| at + Displacement::new(x, y) * step)
                .into_iter()
                .find(|a| cost(*a) < least);
            match better {
                Some(a) => (at, least) = (a, cost(a)),
                None => step *= 0.5,
            }
        }
        at
    }
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
                squared: (off * off, 1e-15),
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
    fn later_ones_tell_where_it_really_goes() {
        let truth = Displacement::new(-0.1e-6, -0.9e-6);
        let first = (after(truth, 0, 0.05e-6) - truth).norm();
        let later = (after(truth, 24, 0.05e-6) - truth).norm();
        assert!(later < 0.5 * first, "{first} m, then {later} m");
    }
}
