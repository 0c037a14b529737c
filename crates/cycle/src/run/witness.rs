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

/// How far aside light is looked at, metres: a fifth of the core, or less where the micro has no more room.
const ASIDE: [f64; 4] = [20e-6, 15e-6, 10e-6, 5e-6];

/// For how long, seconds, and how long the micro rests before that.
const LOOK: f64 = 0.08;
const SETTLED: f64 = 0.03;

/// How fast it drifts against the chip along an axis, standard deviation, metres a second: each of both by 0.01 um/s, as a bracket does
/// of 10 um/K at 0.1 K a minute.
const DRIFTS: f64 = 0.014e-6;

/// Standard deviations that a curvature, or light, has to be above none.
const SEEN: f64 = 3.0;

/// Logarithms of the light around the sensing fiber, with their variances: in the middle, and to both sides along x and y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Around {
    /// When, seconds, and how far to the sides, metres.
    time: f64,
    pub(super) aside: f64,
    middle: (f64, f64),
    sides: [[(f64, f64); 2]; 2],
}

impl Around {
    /// Slope along an axis, and curvature (half of the second derivative), each with its variance.
    fn shape(&self, axis: usize) -> [(f64, f64); 2] {
        let ([less, more], aside) = (self.sides[axis], self.aside);
        let noise = less.1 + more.1;
        let slope = (more.0 - less.0) / (2.0 * aside);
        let curvature = (more.0 + less.0 - 2.0 * self.middle.0) / (2.0 * aside * aside);
        [
            (slope, noise / (2.0 * aside).powi(2)),
            (
                curvature,
                (noise + 4.0 * self.middle.1) / (2.0 * aside * aside).powi(2),
            ),
        ]
    }

    /// By what natural logarithm the light has changed as the sensing fiber has drifted until later, and its standard deviation.
    pub(super) fn drifted(&self, later: &Self) -> (f64, f64) {
        let drift = DRIFTS * (later.time - self.time);
        let (mut by, mut variance) = (0.0, 0.0);
        for axis in 0..2 {
            let [[s0, c0], [s1, c1]] = [self.shape(axis), later.shape(axis)];
            // What such a drift may do, before anything is seen of it.
            let may = (0.5 * (s0.0.abs() + s1.0.abs()) * drift).powi(2);
            let curvature = 0.5 * (c0.0 + c1.0);
            let unsure = 0.25 * (c0.1 + c1.1);
            if curvature > -SEEN * unsure.sqrt() {
                variance += may;
                continue;
            }
            // A parabola: the slope has changed by twice the curvature a metre.
            let change = (s1.0 * s1.0 - s0.0 * s0.0) / (4.0 * curvature);
            let noise = (s1.0 * s1.0 * s1.1 + s0.0 * s0.0 * s0.1) / (2.0 * curvature).powi(2)
                + change * change * unsure / (curvature * curvature);
            // One that has slipped further than that is seen to.
            let may = may.max(change * change - noise);
            let share = may / (may + noise).max(f64::MIN_POSITIVE);
            by += share * change;
            variance += share * noise;
        }
        (by, variance.sqrt())
    }
}

/// By what natural logarithm light may have changed, standard deviation, as the sensing fiber has drifted for so many seconds and nobody
/// saw where to.
pub(super) fn unseen(seconds: f64) -> f64 {
    /// Slope on which it mostly stands, for each metre.
    const SLOPE: f64 = 0.03e6;
    SLOPE * DRIFTS * seconds
}

/// A round, from the middle: to both sides along x and y, and back.
fn round(aside: f64) -> [(f64, f64); 5] {
    [
        (-aside, 0.0),
        (aside, 0.0),
        (0.0, -aside),
        (0.0, aside),
        (0.0, 0.0),
    ]
}

impl Line<'_, '_, '_> {
    /// Looks around the sensing fiber, as far as its micro has room and there is light; nothing where there is neither.
    pub(super) fn look_around(
        &mut self,
        (channel, background): (Channel, f64),
    ) -> Result<Option<Around>, Halt> {
        for aside in ASIDE {
            let here = self.sensing();
            let there = |(x, y): &(f64, f64)| {
                let to = Pose::at(here.x() + x, here.y() + y, here.z());
                self.cell.reaches(fine(Side::Right), &to)
            };
            if !round(aside).iter().all(there) {
                continue;
            }
            // What piezos keep of where they were is the same after each round, but not before the first.
            for (x, y) in round(aside) {
                self.micro_to(Pose::at(here.x() + x, here.y() + y, here.z()))?;
            }
            let seen = self.look_again((channel, background), aside)?;
            if seen.is_some() {
                return Ok(seen);
            }
        }
        Ok(None)
    }

    /// The same round once more; nothing where there is no light on it.
    pub(super) fn look_again(
        &mut self,
        (channel, background): (Channel, f64),
        aside: f64,
    ) -> Result<Option<Around>, Halt> {
        let (time, here) = (self.cell.now(), self.sensing());
        let mut seen = [(0.0, 0.0); 5];
        let mut dark = false;
        for ((x, y), seen) in round(aside).into_iter().zip(&mut seen) {
            self.micro_to(Pose::at(here.x() + x, here.y() + y, here.z()))?;
            let [(volts, sigma)] = hold::levels(&mut self.cell, [Meter(channel.index())], LOOK)?;
            let light = volts - background;
            dark |= light < SEEN * sigma || light <= 0.0;
            *seen = (light.ln(), (sigma / light).powi(2));
        }
        let [left, right, down, up, middle] = seen;
        let around = Around {
            time,
            aside,
            middle,
            sides: [[left, right], [down, up]],
        };
        Ok((!dark).then_some(around))
    }

    /// Where the right micro is.
    fn sensing(&self) -> Pose {
        Bench::reference(&self.cell, fine(Side::Right)).unwrap_or(Pose::ZERO)
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

    /// Of a spot around a place, micrometres, with so much noise.
    fn around(time: f64, x: f64, y: f64, noise: f64) -> Around {
        const WIDE: f64 = 60e-6;
        let of = |dx: f64, dy: f64| {
            let (x, y) = (1e-6 * x + dx, 1e-6 * y + dy);
            (-(x * x + y * y) / (WIDE * WIDE), noise * noise)
        };
        Around {
            time,
            aside: ASIDE[0],
            middle: of(0.0, 0.0),
            sides: [
                [of(-ASIDE[0], 0.0), of(ASIDE[0], 0.0)],
                [of(0.0, -ASIDE[0]), of(0.0, ASIDE[0])],
            ],
        }
    }

    #[test]
    fn what_has_drifted_is_taken_for_that() {
        let of = |noise| {
            let (before, after) = (
                around(0.0, 25.0, -10.0, noise),
                around(33.0, 25.6, -10.2, noise),
            );
            (before.drifted(&after), after.middle.0 - before.middle.0)
        };
        let ((by, sigma), really) = of(1e-5);
        assert!(really < -0.009, "{really}");
        assert!((by - really).abs() < 1e-5, "{by}, {really}");
        assert!(sigma < 1e-4, "{sigma}");
        // Where noise would be taken for a drift hardly any is believed, and what it may be is said.
        let ((by, sigma), _) = of(0.02);
        assert!(by.abs() < 0.3 * really.abs(), "{by}");
        assert!((2e-3..2e-2).contains(&sigma), "{sigma}");
        // One that slips by more than it may drift is seen.
        let slipped = around(33.0, 29.0, -10.0, 1e-4);
        let before = around(0.0, 25.0, -10.0, 1e-4);
        let really = slipped.middle.0 - before.middle.0;
        assert!((before.drifted(&slipped).0 - really).abs() < 0.05 * really.abs());
    }

    #[test]
    fn light_without_a_shape_tells_nothing_but_by_its_slope() {
        let flat = |time| Around {
            time,
            aside: ASIDE[0],
            middle: (0.0, 1e-6),
            sides: [[(-0.1, 1e-6), (0.1, 1e-6)]; 2],
        };
        let (by, sigma) = flat(0.0).drifted(&flat(30.0));
        assert_eq!(by, 0.0);
        // 0.42 um along two axes on a slope of 0.5 % a micrometre.
        assert!(
            (sigma - 0.42 * 0.005 * 2.0_f64.sqrt()).abs() < 1e-5,
            "{sigma}"
        );
    }
}
