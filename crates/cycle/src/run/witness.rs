//! Looks around: what light at four places around a fiber tells, which its micro goes to.
//!
//! Of the sensing fiber, the witness of the input's cure, where it has drifted to meanwhile, and what that did to its light. It stands set
//! back in a spot about as wide as its core, and mostly beside its middle: what drifts by tenths of a micrometre makes percents of its
//! light. The looks tell slope and curvature, and how the slope has changed how far it has drifted.
//!
//! Of a fiber that has cured and is still held, where it is beside its peak, as the holder bends it a little.

use super::Line;
use pigtail_control::hold::{self, DRIFTS};
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::station::fine;
use pigtail_hal::bench::{Event, Law, Limits, Meter, Pose};
use pigtail_hal::{Bench, Channel, Side};
use pigtail_model::frames::Displacement;

/// How far aside light is looked at, metres: a fifth of the core, or less where the micro has no more room.
const ASIDE: [f64; 4] = [20e-6, 15e-6, 10e-6, 5e-6];

/// For how long, seconds, and how long the micro rests before that.
const LOOK: f64 = 0.08;
const SETTLED: f64 = 0.03;

/// How often it slips meanwhile, and how far along an axis then, standard deviation, metres: joints with friction give way by micrometres, and one
/// that is held by its servo hardly ever.
const SLIPS: (f64, f64) = (1e-3, 5e-6);

/// How fast the micro goes on a round, metres a second.
const SPEED: f64 = 2e-3;

/// The same of one that bends a fiber. Frames show that the tip stays, by 0.08 s late; until then it seems to have gone along, and a guard
/// that sees it beside its port by more than it should be stops the machine: by 1.6 um at most.
const SLOWLY: f64 = 20e-6;

/// How long looks take on a round.
const LOOKS: f64 = 5.0 * LOOK;

/// How long rounds take: those before the lamp is on, of which the first goes without looks, and the one after the release, seconds.
pub(crate) const ROUNDS: [f64; 2] = {
    let goes = goes(ASIDE[0], SPEED);
    [2.0 * goes + LOOKS, goes + LOOKS]
};

/// How long it takes to go round so far aside, metres, with such a speed, seconds: there and back, across, there and back again, as it is in
/// [`round`].
const fn goes(aside: f64, speed: f64) -> f64 {
    7.0 * aside / speed + 5.0 * SETTLED
}

/// How long a fiber that has cured is bent, seconds, by a holder that goes so far aside, metres.
pub(super) const fn bending(aside: f64) -> f64 {
    goes(aside, SLOWLY) + LOOKS
}

/// Standard deviations that a curvature, or light, has to be above none.
const SEEN: f64 = 3.0;

/// What light is looked at with: a photodiode, and its level without that light, volts.
type Eye = (Channel, f64);

/// Logarithms of the light around a fiber, with their variances: in the middle, and to both sides along x and y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Around {
    /// When, seconds, and how far to the sides, metres.
    time: f64,
    pub(super) aside: f64,
    /// How steep light that has missed the guide may make the logarithm along an axis, standard deviation, for each metre: from
    /// none to twice what there is in the middle over the diameter of the core.
    stray: f64,
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

    /// Where a fiber that has cured is, from its peak, metres, and the standard deviation along both axes: by its light as its holder
    /// was moved. `width` is the radius at which light falls to 1/e, `flickers` by what share light changes meanwhile by itself.
    ///
    /// The bond holds the tip; of what the holder moves, a share `g` bends it along, which nobody knows. At a place `p` from the peak light
    /// that falls as `exp(-d^2/w^2)` has a slope of `-2 g p/w^2` and a curvature of `-g^2/w^2` for each metre of the holder: the second
    /// tells the share, and both tell the place. What makes all light more or less, as gap and laser do, is in neither.
    pub(super) fn beside_peak(&self, width: f64, flickers: f64) -> Option<Beside> {
        /// How well the width of a spot is known, relative: as the fast procedure finds it.
        const WIDTH: f64 = 0.05;
        let [[x, of_x], [y, of_y]] = [self.shape(0), self.shape(1)];
        let flicker = flickers / (2.0 * self.aside);
        let curvature = 0.5 * (of_x.0 + of_y.0);
        // The middle is in both.
        let unsure = (0.5 * (of_x.1.sqrt() + of_y.1.sqrt())).hypot(2.0 * flicker / self.aside);
        if curvature > -SEEN * unsure {
            return None;
        }
        let per_slope = -0.5 * width / (-curvature).sqrt();
        let at = Displacement::new(per_slope * x.0, per_slope * y.0);
        let scale = WIDTH.hypot(0.5 * unsure / curvature);
        let sigma = [(x, at.x), (y, at.y)]
            .map(|(slope, at)| (per_slope * slope.1.sqrt().hypot(flicker)).hypot(scale * at));
        Some(Beside { at, sigma })
    }

    /// By what natural logarithm the light has changed as the sensing fiber has drifted until later, and its standard deviation.
    ///
    /// Where the light's logarithm has slope `s` and curvature `c` a drift `d` makes `s d + c d^2`, and changes the slope by `2 c d`.
    /// But a slope changes also without a drift as the input loses light: beside the guide there is light that has missed it, which
    /// does not become less. Of a slope `u` that it makes, before a spot that has become `f` times dimmer it makes `f u`. It may be as
    /// large as [`Self::stray`] says, and nobody sees which part of a slope it is. A drift is a slow one or, now and then, a slip: each
    /// counts as much as the change of the slope speaks for it. Where rounds do not have one shape, neither is seen.
    pub(super) fn drifted(&self, later: &Self) -> (f64, f64) {
        let dimmer = (self.middle.0 - later.middle.0).exp() - 1.0;
        let stray = (self.stray * dimmer).powi(2);
        let slow = (DRIFTS * (later.time - self.time)).powi(2);
        let (mut by, mut variance) = (0.0, 0.0);
        for axis in 0..2 {
            let [[s0, c0], [s1, c1]] = [self.shape(axis), later.shape(axis)];
            let of = Change {
                slope: (s0.0, s0.1 + stray),
                by: (s1.0 - s0.0, s0.1 + s1.1 + stray),
                curvature: both(c0, c1),
            };
            let drifts = [(1.0 - SLIPS.0, slow), (SLIPS.0, SLIPS.1 * SLIPS.1)];
            let told = drifts.map(|(share, square)| (share.ln(), of.by_drift(square)));
            let most = told.iter().fold(f64::NEG_INFINITY, |most, (share, told)| {
                most.max(share + told.likely)
            });
            let weights = told.map(|(share, told)| (share + told.likely - most).exp());
            let all: f64 = weights.iter().sum();
            let mean = weights
                .iter()
                .zip(&told)
                .map(|(w, (_, t))| w * t.mean / all);
            let mean: f64 = mean.sum();
            by += mean;
            let squares = weights.iter().zip(&told);
            let squares = squares.map(|(w, (_, t))| w * (t.variance + (t.mean - mean).powi(2)));
            variance += squares.sum::<f64>() / all;
        }
        (by, variance.sqrt())
    }
}

/// Where a fiber is from its peak, metres, with its standard deviation along both axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Beside {
    pub(super) at: Displacement,
    pub(super) sigma: [f64; 2],
}

/// Of two values with their variances the mean, and its variance: the noisier counts less, and as far as they differ nobody knows.
fn both(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    let share = a.1 / (a.1 + b.1).max(f64::MIN_POSITIVE);
    let by = b.0 - a.0;
    let left = (1.0 - share) * (a.1 + share * by * by);
    (a.0 + share * by, left)
}

/// How light around a place has changed along an axis: each with its variance.
#[derive(Debug, Clone, Copy)]
struct Change {
    slope: (f64, f64),
    by: (f64, f64),
    curvature: (f64, f64),
}

/// What a drift has done to the light's logarithm, and the logarithm of how likely the change is that was seen, were there such drifts.
#[derive(Debug, Clone, Copy)]
struct ByDrift {
    mean: f64,
    variance: f64,
    likely: f64,
}

impl Change {
    /// What drifts whose variance is `square` (square metres) have done, before anything was seen.
    fn by_drift(&self, square: f64) -> ByDrift {
        let ((slope, of_slope), (change, noise)) = (self.slope, self.by);
        let (curvature, unsure) = self.curvature;
        if curvature > -SEEN * unsure.sqrt() {
            // Light without a shape does not tell where it is looked at.
            return ByDrift {
                mean: 0.0,
                variance: (slope * slope + of_slope) * square,
                likely: 0.0,
            };
        }
        let bends = 2.0 * curvature;
        let expected = bends * bends * square + noise;
        let drift = bends * square / expected * change;
        let left = square * noise / expected;
        let mean = slope * drift + curvature * (drift * drift + left);
        let variance = (slope + bends * drift).powi(2) * left
            + 2.0 * (curvature * left).powi(2)
            + of_slope * (drift * drift + left)
            + mean * mean * unsure / (curvature * curvature);
        ByDrift {
            mean,
            variance,
            likely: -0.5 * (change * change / expected + expected.ln()),
        }
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
    pub(super) fn look_around(&mut self, eye: Eye) -> Result<Option<Around>, Halt> {
        let side = Side::Right;
        for aside in ASIDE {
            let here = self.micro(side);
            if !self.has_room(side, here, aside) {
                continue;
            }
            // What piezos keep of where they were is the same after each round, but not before the first.
            for (x, y) in round(aside) {
                self.micro_to(side, Pose::at(here.x() + x, here.y() + y, here.z()), SPEED)?;
            }
            let seen = self.look_again(eye, aside)?;
            if seen.is_some() {
                return Ok(seen);
            }
        }
        Ok(None)
    }

    /// Looks around a fiber that has cured, as its holder bends it; nothing where there is no room or no light.
    pub(super) fn look_bent(
        &mut self,
        side: Side,
        eye: Eye,
        aside: f64,
    ) -> Result<Option<Around>, Halt> {
        if self.has_room(side, self.micro(side), aside) {
            self.look_round(side, eye, (aside, SLOWLY))
        } else {
            Ok(None)
        }
    }

    /// One round with the sensing fiber; nothing where there is no light on it.
    pub(super) fn look_again(&mut self, eye: Eye, aside: f64) -> Result<Option<Around>, Halt> {
        self.look_round(Side::Right, eye, (aside, SPEED))
    }

    /// One round; nothing where there is no light on it.
    fn look_round(
        &mut self,
        side: Side,
        (channel, background): Eye,
        (aside, speed): (f64, f64),
    ) -> Result<Option<Around>, Halt> {
        let (time, here) = (self.cell.now(), self.micro(side));
        let mut seen = [(0.0, 0.0); 5];
        let mut dark = false;
        for ((x, y), seen) in round(aside).into_iter().zip(&mut seen) {
            self.micro_to(side, Pose::at(here.x() + x, here.y() + y, here.z()), speed)?;
            let [(volts, sigma)] = hold::levels(&mut self.cell, [Meter(channel.index())], LOOK)?;
            let light = volts - background;
            dark |= light < SEEN * sigma || light <= 0.0;
            *seen = (light.ln(), (sigma / light).powi(2));
        }
        let [left, right, down, up, middle] = seen;
        let core = 0.5 * self.cell.station().spec().sensing_fiber.core;
        let around = Around {
            time,
            aside,
            stray: background.max(0.0) / (middle.0.exp() * core),
            middle,
            sides: [[left, right], [down, up]],
        };
        Ok((!dark).then_some(around))
    }

    /// Whether a micro reaches all of a round about a place.
    fn has_room(&self, side: Side, about: Pose, aside: f64) -> bool {
        let there = |(x, y): &(f64, f64)| {
            let to = Pose::at(about.x() + x, about.y() + y, about.z());
            self.cell.reaches(fine(side), &to)
        };
        round(aside).iter().all(there)
    }

    /// Where a micro is.
    fn micro(&self, side: Side) -> Pose {
        Bench::reference(&self.cell, fine(side)).unwrap_or(Pose::ZERO)
    }

    /// Brings a micro to a place, and lets it come to rest.
    fn micro_to(&mut self, side: Side, to: Pose, speed: f64) -> Result<(), Halt> {
        let failed = |why: String| Halt::from(Outcome::BenchFailed { why });
        let limits = Limits { speed: Some(speed) };
        let law = Law::Line { to, limits };
        let ticket = self.cell.play(fine(side), law);
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
        beside_stray(time, (x, y), noise, (1.0, 0.0))
    }

    /// The same where the spot has become `bright`, and light that has missed the guide makes `steep` of its light for each metre up.
    fn beside_stray(
        time: f64,
        (x, y): (f64, f64),
        noise: f64,
        (bright, steep): (f64, f64),
    ) -> Around {
        const WIDE: f64 = 60e-6;
        let of = |dx: f64, dy: f64| {
            let (x, y) = (1e-6 * x + dx, 1e-6 * y + dy);
            let spot = (-(x * x + y * y) / (WIDE * WIDE)).exp();
            ((bright * spot + steep * dy).ln(), noise * noise)
        };
        Around {
            time,
            aside: ASIDE[0],
            stray: 8e3,
            middle: of(0.0, 0.0),
            sides: [
                [of(-ASIDE[0], 0.0), of(ASIDE[0], 0.0)],
                [of(0.0, -ASIDE[0]), of(0.0, ASIDE[0])],
            ],
        }
    }

    #[test]
    fn what_an_input_loses_is_not_taken_for_a_slip() {
        // Slopes change by up to 80 times as much as by the drifts that are expected.
        for (bright, steep) in [(0.9, 8e3), (0.4, 8e3), (0.4, -8e3), (0.25, 7e3)] {
            let before = beside_stray(0.0, (25.0, -10.0), 1e-4, (1.0, steep));
            let after = beside_stray(33.0, (25.0, -10.0), 1e-4, (bright, steep));
            let (by, sigma) = before.drifted(&after);
            assert!(by.abs() < 2.0 * sigma, "{bright}: {by}, known to {sigma}");
            assert!(sigma < 0.05, "{bright}: {sigma}");
        }
    }

    #[test]
    fn a_bent_fiber_tells_where_it_is_whatever_share_it_goes_along() {
        let (width, aside) = (2.7e-6, 5e-6);
        let bent = |share: f64, (x, y): (f64, f64), noise: f64| {
            let of = |dx: f64, dy: f64| {
                let (x, y) = (x + share * dx, y + share * dy);
                (-(x * x + y * y) / (width * width), noise * noise)
            };
            Around {
                time: 0.0,
                aside,
                stray: 0.0,
                middle: of(0.0, 0.0),
                sides: [
                    [of(-aside, 0.0), of(aside, 0.0)],
                    [of(0.0, -aside), of(0.0, aside)],
                ],
            }
        };
        let place = Displacement::new(0.3e-6, -0.5e-6);
        for share in [0.03, 0.05, 0.2] {
            let told = bent(share, (place.x, place.y), 5e-4).beside_peak(width, 0.0);
            let told = told.unwrap_or_else(|| panic!("nothing was seen of {share}"));
            assert!((told.at - place).norm() < 1e-9, "{share}: {told:?}");
            // No better than the width of the spot is known.
            assert!(
                told.sigma[1] > 0.02e-6 && told.sigma[1] < 0.2e-6,
                "{share}: {told:?}"
            );
        }
        // A tip that does not go along at all, or noise, tells nothing.
        assert_eq!(
            bent(0.0, (place.x, place.y), 5e-4).beside_peak(width, 0.0),
            None
        );
        assert_eq!(
            bent(0.02, (place.x, place.y), 0.02).beside_peak(width, 0.0),
            None
        );
    }

    #[test]
    fn rounds_of_different_shapes_tell_of_no_drift() {
        let before = around(0.0, 25.0, -10.0, 1e-4);
        let mut after = around(33.0, 25.0, -10.0, 1e-4);
        // A place that has become dark makes both slope and curvature.
        after.sides[0][0].0 -= 1.0;
        let (by, sigma) = before.drifted(&after);
        assert!(by.abs() < sigma, "{by}, known to {sigma}");
        assert!(sigma > 5e-3, "{sigma}");
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
        assert!((by - really).abs() < sigma, "{by}, {really}");
        assert!(sigma < 0.25 * really.abs(), "{sigma}");
        // Where noise would be taken for a drift hardly any is believed, and what it may be is said.
        let ((by, sigma), _) = of(0.02);
        assert!(by.abs() < 0.3 * really.abs(), "{by}");
        assert!((2e-3..2e-2).contains(&sigma), "{sigma}");
    }

    #[test]
    fn one_that_slips_by_more_than_it_may_drift_is_seen() {
        let slips = |stray: f64| {
            let of = |x: f64, time: f64| Around {
                stray,
                ..around(time, x, -10.0, 1e-4)
            };
            let (before, after) = (of(25.0, 0.0), of(29.0, 33.0));
            (before.drifted(&after), after.middle.0 - before.middle.0)
        };
        let ((by, sigma), really) = slips(0.0);
        assert!((by - really).abs() < 0.01 * really.abs(), "{by}, {really}");
        assert!(sigma < 1e-3, "{sigma}");
        // Where light that has missed the guide may have done it, that is said.
        let ((by, sigma), _) = slips(8e3);
        assert!((by - really).abs() < 2.0 * sigma, "{by}, {really}");
        assert!(sigma > 0.01, "{sigma}");
    }

    #[test]
    fn light_without_a_shape_tells_nothing_but_by_its_slope() {
        let flat = |time| Around {
            time,
            aside: ASIDE[0],
            stray: 0.0,
            middle: (0.0, 1e-6),
            sides: [[(-0.1, 1e-6), (0.1, 1e-6)]; 2],
        };
        let (by, sigma) = flat(0.0).drifted(&flat(30.0));
        assert_eq!(by, 0.0);
        // 0.42 um along two axes on a slope of 0.5 % a micrometre, and 5 um once in a thousand times.
        let drifts = (0.42 * 0.42_f64 + 1e-3 * 5.0 * 5.0).sqrt();
        assert!(
            (sigma - drifts * 0.005 * 2.0_f64.sqrt()).abs() < 1e-5,
            "{sigma}"
        );
    }
}
