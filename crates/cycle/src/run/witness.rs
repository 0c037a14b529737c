//! The sensing fiber as a witness of the input's cure: where it has drifted to meanwhile, and what that did to its light.
//!
//! It stands set back in a spot about as wide as its core, and mostly beside its middle: what drifts by tenths of a micrometre makes
//! percents of its light. Light at four places around it tells slope and curvature, and how the slope has changed how far it has
//! drifted.

use super::Line;
use pigtail_control::hold;
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::station::fine;
use pigtail_hal::bench::{Event, Law, Limits, Meter, Pose};
use pigtail_hal::{Bench, Channel, Side};

/// How far aside light is looked at, metres: a fifth of the core.
const ASIDE: f64 = 20e-6;

/// For how long, seconds, and how long the micro rests before that.
const LOOK: f64 = 0.08;
const SETTLED: f64 = 0.03;

/// Standard deviations that a curvature has to be above none.
const SEEN: f64 = 3.0;

/// Logarithms of the light around the sensing fiber, with their variances: in the middle, and to both sides along x and y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Around {
    middle: (f64, f64),
    sides: [[(f64, f64); 2]; 2],
}

impl Around {
    /// Slope along an axis, and curvature (half of the second derivative), each with its variance.
    fn shape(&self, axis: usize) -> [(f64, f64); 2] {
        let [less, more] = self.sides[axis];
        let noise = less.1 + more.1;
        let slope = (more.0 - less.0) / (2.0 * ASIDE);
        let curvature = (more.0 + less.0 - 2.0 * self.middle.0) / (2.0 * ASIDE * ASIDE);
        [
            (slope, noise / (2.0 * ASIDE).powi(2)),
            (
                curvature,
                (noise + 4.0 * self.middle.1) / (2.0 * ASIDE * ASIDE).powi(2),
            ),
        ]
    }

    /// By what natural logarithm the light has changed as the sensing fiber has drifted until later, and its standard deviation;
    /// nothing where the light has no shape to tell it by.
    pub(super) fn drifted(&self, later: &Self) -> Option<(f64, f64)> {
        let (mut by, mut variance) = (0.0, 0.0);
        for axis in 0..2 {
            let [[s0, c0], [s1, c1]] = [self.shape(axis), later.shape(axis)];
            let curvature = 0.5 * (c0.0 + c1.0);
            let unsure = 0.25 * (c0.1 + c1.1);
            if curvature > -SEEN * unsure.sqrt() {
                return None;
            }
            // A parabola: the slope has changed by twice the curvature a metre.
            let change = (s1.0 * s1.0 - s0.0 * s0.0) / (4.0 * curvature);
            by += change;
            variance += (s1.0 * s1.0 * s1.1 + s0.0 * s0.0 * s0.1) / (2.0 * curvature).powi(2)
                + change * change * unsure / (curvature * curvature);
        }
        (by.is_finite() && variance.is_finite()).then(|| (by, variance.sqrt()))
    }
}

impl Line<'_, '_, '_> {
    /// Looks at the sensing fiber's light where it stands and around it, by the right micro.
    pub(super) fn look_around(
        &mut self,
        channel: Channel,
        background: f64,
    ) -> Result<Around, Halt> {
        let group = fine(Side::Right);
        let here = Bench::reference(&self.cell, group).unwrap_or(Pose::ZERO);
        let mut look = |x: f64, y: f64| -> Result<(f64, f64), Halt> {
            self.micro_to(Pose::at(here.x() + x, here.y() + y, here.z()))?;
            let [(volts, sigma)] = hold::levels(&mut self.cell, [Meter(channel.index())], LOOK)?;
            let light = (volts - background).max(f64::MIN_POSITIVE);
            Ok((light.ln(), (sigma / light).powi(2)))
        };
        // The same round each time: what piezos keep of where they were is then the same too.
        let sides = [
            [look(-ASIDE, 0.0)?, look(ASIDE, 0.0)?],
            [look(0.0, -ASIDE)?, look(0.0, ASIDE)?],
        ];
        let middle = look(0.0, 0.0)?;
        Ok(Around { middle, sides })
    }

    /// Brings the right micro to a place, and lets it come to rest.
    fn micro_to(&mut self, to: Pose) -> Result<(), Halt> {
        let failed = |why: String| Halt::from(Outcome::BenchFailed { why });
        let limits = Limits { speed: Some(2e-3) };
        let law = Law::Line { to, limits };
        let ticket = self.cell.play(fine(Side::Right), law);
        let ticket = ticket.map_err(|why| failed(why.to_string()))?;
        let until = self.cell.now() + 1.0;
        loop {
            match self.cell.next(until)? {
                Event::Done(done) if done == ticket => break,
                Event::Failed(of, why) if of == ticket => return Err(failed(why)),
                Event::Time => return Err(failed("the micro has not come to rest".to_owned())),
                _ => {}
            }
        }
        self.cell.wait_until(self.cell.now() + SETTLED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a spot around a place, micrometres, with 0.1 % of noise.
    fn around(x: f64, y: f64) -> Around {
        const WIDE: f64 = 60e-6;
        let of = |dx: f64, dy: f64| {
            let (x, y) = (1e-6 * x + dx, 1e-6 * y + dy);
            (-(x * x + y * y) / (WIDE * WIDE), 1e-6)
        };
        Around {
            middle: of(0.0, 0.0),
            sides: [
                [of(-ASIDE, 0.0), of(ASIDE, 0.0)],
                [of(0.0, -ASIDE), of(0.0, ASIDE)],
            ],
        }
    }

    #[test]
    fn what_has_drifted_is_taken_for_that() {
        let (before, after) = (around(25.0, -10.0), around(26.5, -10.5));
        let (by, sigma) = before.drifted(&after).expect("a shape");
        let really = after.middle.0 - before.middle.0;
        assert!(really < -0.02, "{really}");
        assert!((by - really).abs() < 1e-9, "{by}, {really}");
        assert!((1e-4..5e-3).contains(&sigma), "{sigma}");
    }

    #[test]
    fn light_without_a_shape_tells_nothing() {
        let flat = Around {
            middle: (0.0, 1e-6),
            sides: [[(0.0, 1e-6); 2]; 2],
        };
        assert!(flat.drifted(&flat).is_none());
    }
}
