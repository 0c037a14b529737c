//! Looks around: what light at four places around a fiber tells, which its micro goes to.
//!
//! Of the sensing fiber, the witness of the input's cure, how steep its light is: it stands set back in a spot about as wide as its core, and
//! mostly beside its middle, where what drifts by tenths of a micrometre makes percents of its light. It goes towards the middle first, as far as its
//! micro has room; what is left is allowed for.
//!
//! Of a fiber that has cured and is still held, where it is beside its peak, as the holder bends it a little.

use super::Line;
use pigtail_control::hold::{self, DRIFTS};
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::station::fine;
use pigtail_hal::bench::{Event, Law, Limits, Meter, Pose};
use pigtail_hal::{Bench, Channel, Side};
use pigtail_model::frames::Displacement;

/// How far aside of the sensing fiber light is looked at, metres: a few times as far as it drifts, and no farther, as the spot may have an edge.
const ASIDE: f64 = 5e-6;

/// How often it goes on towards the middle at most, and how far at a time, metres: no farther than the light around it tells.
const CLIMBS: u32 = 3;
const CLIMB: f64 = 15e-6;

/// Slopes that make less of what it drifts in half a minute than this, standard deviation, are none: 0.5 % or 0.02 dB, a small part of what a fiber
/// may lose.
const FLAT: f64 = 0.005 / (DRIFTS * 30.0);

/// For how long, seconds, and how long the micro rests before that.
const LOOK: f64 = 0.08;
const SETTLED: f64 = 0.03;

/// For how long light is looked at on each place of a fiber that is bent, seconds: it tells by fractions of a percent, and what is scattered fluctuates
/// for some tenths of a second.
const BENT: f64 = 0.3;

/// Less far aside nothing is told, metres.
const LEAST: f64 = 1e-6;

/// How fast the micro goes on a round, metres a second.
const SPEED: f64 = 2e-3;

/// The same of one that bends a fiber. Frames show that the tip stays, by 0.08 s late; until then it seems to have gone along, and a guard
/// that sees it beside its port by more than it should be stops the machine: by 1.6 um at most.
const SLOWLY: f64 = 20e-6;

/// How long it takes to bring the sensing fiber towards the middle and to look around it, seconds, at most.
pub(crate) const ROUND: f64 = (CLIMBS as f64 + 1.0) * (goes(ASIDE, SPEED) + 5.0 * LOOK)
    + CLIMBS as f64 * (CLIMB / SPEED + SETTLED);

/// How long it takes to go round so far aside, metres, with such a speed, seconds: there and back, across, there and back again, as it is in
/// [`round`].
const fn goes(aside: f64, speed: f64) -> f64 {
    7.0 * aside / speed + 5.0 * SETTLED
}

/// How long a fiber that has cured is bent, seconds, by a holder that goes so far aside, metres.
pub(super) const fn bending(aside: f64) -> f64 {
    goes(aside, SLOWLY) + 5.0 * BENT
}

/// Standard deviations that a curvature, or light, has to be above none.
pub(super) const SEEN: f64 = 3.0;

/// What light is looked at with: a photodiode, and its level without that light, volts.
type Eye = (Channel, f64);

/// Logarithms of the light around a fiber, with their variances: in the middle, and to both sides along x and y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Around {
    /// How far to the sides, metres.
    aside: f64,
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

    /// How far it is towards the middle of the light, where slopes are clear, metres: to the top of a parabola, and no farther than light tells.
    fn uphill(&self) -> Displacement {
        let [x, y] = [0, 1].map(|axis| {
            let [(slope, noise), (curvature, unsure)] = self.shape(axis);
            if slope.abs() < FLAT.max(SEEN * noise.sqrt()) {
                return 0.0;
            }
            let top = if curvature < -SEEN * unsure.sqrt() {
                -0.5 * slope / curvature
            } else {
                CLIMB.copysign(slope)
            };
            top.clamp(-CLIMB, CLIMB)
        });
        Displacement::new(x, y)
    }

    /// The square of the share of its holder's way that the tip of a fiber has gone along in its bond, and its standard deviation. `width` is the
    /// radius at which light falls to 1/e, `flickers` by what share light changes meanwhile by itself.
    pub(super) fn share(&self, width: f64, flickers: f64) -> [f64; 2] {
        let [[_, x], [_, y]] = [self.shape(0), self.shape(1)];
        let curvature = 0.5 * (x.0 + y.0);
        // The middle is in both.
        let noise = 0.5 * (x.1.sqrt() + y.1.sqrt());
        let unsure = noise.hypot(flickers / (self.aside * self.aside));
        [-curvature, unsure].map(|by| width * width * by)
    }

    /// Where a fiber that has cured is, from its peak, metres, and the standard deviation along both axes: by its light as its holder
    /// was moved, and by the square of the share that the tip has gone along. Nothing where that is not known.
    ///
    /// The bond holds the tip; of what the holder moves, a share `g` bends it along. At a place `p` from the peak light
    /// that falls as `exp(-d^2/w^2)` has a slope of `-2 g p/w^2` and a curvature of `-g^2/w^2` for each metre of the holder: the second
    /// tells the share, and both tell the place. What makes all light more or less, as gap and laser do, is in neither.
    pub(super) fn beside_peak(
        &self,
        width: f64,
        flickers: f64,
        [share, unsure]: [f64; 2],
    ) -> Option<Beside> {
        /// How well the width of a spot is known, relative: as the fast procedure finds it.
        const WIDTH: f64 = 0.05;
        if share < SEEN * unsure {
            return None;
        }
        let [[x, _], [y, _]] = [self.shape(0), self.shape(1)];
        let flicker = flickers / (2.0 * self.aside);
        let per_slope = -0.5 * width * width / share.sqrt();
        let at = Displacement::new(per_slope * x.0, per_slope * y.0);
        let scale = WIDTH.hypot(0.5 * unsure / share);
        let sigma = [(x, at.x), (y, at.y)]
            .map(|(slope, at)| (per_slope * slope.1.sqrt().hypot(flicker)).hypot(scale * at));
        Some(Beside { at, sigma })
    }

    /// By what natural logarithm the light may change as the fiber drifts for so many seconds, standard deviation.
    ///
    /// How the light around it has changed afterwards would tell where to it has drifted, were it all light of one spot. Light that has missed the guide
    /// is steeper below, and the more of what is seen the more the input has lost; a place near the edge of the spot has another curvature than the
    /// next. What was taken for a drift by that was wrong by up to 1 dB, and sure of it to 0.1.
    pub(super) fn drifts_in(&self, seconds: f64) -> f64 {
        let square = (DRIFTS * seconds).powi(2);
        let along = |axis| {
            let [(slope, _), (curvature, _)] = self.shape(axis);
            slope * slope * square + 2.0 * (curvature * square).powi(2)
        };
        (along(0) + along(1)).sqrt()
    }
}

/// Where a fiber is from its peak, metres, with its standard deviation along both axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Beside {
    pub(super) at: Displacement,
    pub(super) sigma: [f64; 2],
}

/// Shares of their holder's way that fibers of a side have gone along in their bonds, squared, with standard deviations.
#[derive(Debug, Clone, Default)]
pub(super) struct Shares(Vec<[f64; 2]>);

impl Shares {
    /// Another fiber was bent.
    pub(super) fn learn(&mut self, share: Option<[f64; 2]>) {
        self.0.extend(share);
    }

    /// That of a fiber that has shown `own`: where noise hides it, it is as with the others.
    pub(super) fn of(&self, own: [f64; 2]) -> [f64; 2] {
        /// How far bonds of one recipe differ in that, relative.
        const DIFFER: f64 = 0.5;
        let weigh = |all: &[[f64; 2]]| {
            let weights = all.iter().map(|[_, sigma]| 1.0 / (sigma * sigma));
            let sum: f64 = weights.clone().sum();
            let mean = weights.zip(all).map(|(w, [share, _])| w * share);
            [mean.sum::<f64>() / sum, sum.sqrt().recip()]
        };
        let [others, sigma] = weigh(&self.0);
        if others > SEEN * sigma {
            weigh(&[own, [others, sigma.hypot(DIFFER * others)]])
        } else {
            own
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
    /// Brings the sensing fiber towards the middle of the light, and looks around it there; nothing where its micro has no room or there is no light.
    pub(super) fn look_around(&mut self, eye: Eye) -> Result<Option<Around>, Halt> {
        let side = Side::Right;
        for _ in 0..CLIMBS {
            let Some(around) = self.look_round(side, eye, (ASIDE, SPEED), LOOK)? else {
                return Ok(None);
            };
            let (by, here) = (around.uphill(), self.micro(side));
            let to = Pose::at(here.x() + by.x, here.y() + by.y, here.z());
            if by == Displacement::ZERO || !self.has_room(side, to, ASIDE) {
                return Ok(Some(around));
            }
            self.micro_to(side, to, SPEED)?;
        }
        self.look_round(side, eye, (ASIDE, SPEED), LOOK)
    }

    /// Looks around a fiber that has cured, as its holder bends it; nothing where there is no room or no light.
    pub(super) fn look_bent(
        &mut self,
        side: Side,
        eye: Eye,
        aside: f64,
    ) -> Result<Option<Around>, Halt> {
        if aside < LEAST {
            return Ok(None);
        }
        self.look_round(side, eye, (aside, SLOWLY), BENT)
    }

    /// One round; nothing where the micro has no room for it or there is no light on it.
    fn look_round(
        &mut self,
        side: Side,
        (channel, background): Eye,
        (aside, speed): (f64, f64),
        seconds: f64,
    ) -> Result<Option<Around>, Halt> {
        let here = self.micro(side);
        if !self.has_room(side, here, aside) {
            return Ok(None);
        }
        let mut seen = [(0.0, 0.0); 5];
        let mut dark = false;
        for ((x, y), seen) in round(aside).into_iter().zip(&mut seen) {
            self.micro_to(side, Pose::at(here.x() + x, here.y() + y, here.z()), speed)?;
            let meters = [Meter(channel.index())];
            let [(volts, sigma)] = hold::levels(&mut self.cell, meters, seconds)?;
            let light = volts - background;
            dark |= light < SEEN * sigma || light <= 0.0;
            *seen = (light.ln(), (sigma / light).powi(2));
        }
        let [left, right, down, up, middle] = seen;
        let around = Around {
            aside,
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

    /// Light around a place, by what its logarithm is so far beside it, metres.
    fn around(aside: f64, noise: f64, ln: impl Fn(f64, f64) -> f64) -> Around {
        let of = |dx: f64, dy: f64| (ln(dx, dy), noise * noise);
        Around {
            aside,
            middle: of(0.0, 0.0),
            sides: [
                [of(-aside, 0.0), of(aside, 0.0)],
                [of(0.0, -aside), of(0.0, aside)],
            ],
        }
    }

    #[test]
    fn a_bent_fiber_tells_where_it_is_whatever_share_it_goes_along() {
        let (width, aside) = (2.7e-6, 5e-6);
        let bent = |share: f64, (x, y): (f64, f64), noise: f64| {
            around(aside, noise, |dx, dy| {
                let (x, y) = (x + share * dx, y + share * dy);
                -(x * x + y * y) / (width * width)
            })
        };
        let place = Displacement::new(0.3e-6, -0.5e-6);
        for share in [0.03, 0.05, 0.2] {
            let around = bent(share, (place.x, place.y), 5e-4);
            let [seen, unsure] = around.share(width, 0.0);
            assert!((seen / share.powi(2) - 1.0).abs() < 1e-6, "{share}: {seen}");
            let told = around.beside_peak(width, 0.0, [seen, unsure]);
            let told = told.unwrap_or_else(|| panic!("nothing was seen of {share}"));
            assert!((told.at - place).norm() < 1e-9, "{share}: {told:?}");
            // No better than the width of the spot is known.
            assert!(
                told.sigma[1] > 0.02e-6 && told.sigma[1] < 0.2e-6,
                "{share}: {told:?}"
            );
        }
        // A tip that does not go along at all, or noise, tells nothing...
        let alone = |share: f64, noise: f64| {
            let around = bent(share, (place.x, place.y), noise);
            around.beside_peak(width, 0.0, around.share(width, 0.0))
        };
        assert_eq!(alone(0.0, 5e-4), None);
        assert_eq!(alone(0.02, 0.02), None);
        // ...unless others have shown how far it goes along.
        let mut shares = Shares::default();
        for _ in 0..3 {
            shares.learn(Some([0.05 * 0.05, 0.1 * 0.05 * 0.05]));
        }
        let around = bent(0.05, (place.x, place.y), 3e-3);
        let own = around.share(width, 0.0);
        assert_eq!(Shares::default().of(own), own);
        assert_eq!(around.beside_peak(width, 0.0, own), None);
        let told = around.beside_peak(width, 0.0, shares.of(own));
        let told = told.expect("others have shown it");
        assert!((told.at - place).norm() < 0.05e-6, "{told:?}");
        assert!((0.05e-6..0.3e-6).contains(&told.sigma[1]), "{told:?}");
    }

    #[test]
    fn a_sensing_fiber_goes_to_the_middle_of_its_light_and_stays_there() {
        const WIDE: f64 = 30e-6;
        let at = |x: f64, y: f64, noise: f64| {
            around(ASIDE, noise, |dx, dy| {
                -((x + dx).powi(2) + (y + dy).powi(2)) / (WIDE * WIDE)
            })
        };
        let by = at(10e-6, -8e-6, 1e-5).uphill();
        assert!(
            (by.x + 10e-6).abs() < 1e-8 && (by.y - 8e-6).abs() < 1e-8,
            "{by:?}"
        );
        // From far aside no farther than light tells, and not at all by noise or where it is flat.
        assert_eq!(
            at(50e-6, 0.0, 1e-5).uphill(),
            Displacement::new(-CLIMB, 0.0)
        );
        assert_eq!(at(10e-6, -8e-6, 0.1).uphill(), Displacement::ZERO);
        assert_eq!(at(0.5e-6, 0.0, 1e-5).uphill(), Displacement::ZERO);
    }

    #[test]
    fn what_a_sensing_fiber_may_drift_makes_of_its_light_what_it_would() {
        const WIDE: f64 = 60e-6;
        let spot = |x: f64, y: f64| -(x * x + y * y) / (WIDE * WIDE);
        let seconds = 30.0;
        let far = DRIFTS * seconds;
        // On its slope, and on its top.
        for (x, y) in [(25e-6, -40e-6), (0.0, 0.0)] {
            let told = around(ASIDE, 0.0, |dx, dy| spot(x + dx, y + dy)).drifts_in(seconds);
            // Drifts at the corners of a grid of quantiles, of as many deviations.
            let quantiles = [-1.38, -0.67, -0.21, 0.21, 0.67, 1.38].map(|q| far * q);
            let all = quantiles
                .iter()
                .flat_map(|a| quantiles.map(|b| spot(x + a, y + b) - spot(x, y)));
            let all: Vec<f64> = all.collect();
            let n = all.len() as f64;
            let mean = all.iter().sum::<f64>() / n;
            let square = all.iter().map(|by| (by - mean).powi(2)).sum::<f64>() / n;
            assert!((0.8..1.8).contains(&(told / square.sqrt())), "{told}");
        }
    }
}
