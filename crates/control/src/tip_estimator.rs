//! What vision says of the tips, put together over many frames.
//!
//! A frame is late and noisy, but it says when it was exposed: beside where the holder was at that
//! moment, by the encoders, it tells where the tip stands in the holder, whether anything moves or
//! not. Nobody has to stand still for a look.
//!
//! Frames say, too, whether they are what is believed of them: they differ from one to the next by their noise, and where all of late lie
//! beside the mean of those before, on one side, something has moved that no encoder has seen (a belt that slipped, a load that a
//! screw let go): a cumulative sum of what was not foreseen tells (E. S. Page 1954), and what was seen before is forgotten.

use crate::ring_down::{Shown, Swing};
use crate::tuning::TUNING;
use pigtail_hal::Side;
pub use pigtail_hal::bench::Tip;
use pigtail_hal::bench::{Fix, Frame};
use pigtail_hal::spec::{GuardSpec, SIDES, VisionSpec};
use pigtail_model::frames::{Chip, Point};

/// Where a tip stands from its holder, as far as vision has seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Across the chip, metres.
    pub x: f64,
    /// Along the chip's z, metres.
    pub z: f64,
    /// Standard deviations of both without vision's fixed error, metres.
    pub sigma: [f64; 2],
    /// Bound of the fixed error in z, metres: vision's, or none where the light has told.
    pub bound_z: f64,
    /// Standard deviation in z of where the facet itself lies, metres: none where the light has told.
    pub facet_z: f64,
}

impl Seen {
    /// Standard deviation in z beside the bound, metres.
    pub fn sigma_z(&self) -> f64 {
        self.sigma[1].hypot(self.facet_z)
    }
}

/// An estimate that remembers where the holder stood when it was made.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    x: Offset,
    z: Offset,
    holder: Point<Chip>,
    /// When, seconds.
    time: f64,
}

/// Of the tip from its holder along one axis.
#[derive(Debug, Clone, Copy)]
struct Offset {
    /// Metres.
    value: f64,
    /// Square metres.
    variance: f64,
    noise: Noise,
    /// Frames that lie above it, and below.
    beside: [Beside; 2],
}

/// What who guards the machine makes of the same frames of a fiber, along the chip's z: it lets a tip come no nearer than by its own belief,
/// which knows of no calibration how ways and stages are.
#[derive(Debug, Clone, Copy)]
struct Guarded {
    /// Of the tip from its holder, metres, and its variance.
    value: f64,
    variance: f64,
    /// Where the tip would stand by its holder alone, in the last frame.
    stood: Point<Chip>,
}

/// By what share a way may be wrong, and by what angle a manipulator may stand askew.
#[derive(Debug, Clone, Copy)]
struct Strays {
    scale: f64,
    askew: f64,
}

/// By how much frames at rest differ from what was foreseen of them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Noise {
    /// The sum of squares, in variances by what the camera states, and of how many frames.
    squares: f64,
    frames: f64,
}

/// Frames at rest that lie on one side of what is believed.
#[derive(Debug, Clone, Copy, Default)]
struct Beside {
    /// Their cumulative sum, in deviations.
    sum: f64,
    /// The sum of what was seen since that began, metres, and of how many frames.
    seen: f64,
    frames: f64,
}

/// Where a holder is told to be, and a tip in it that its micro moves and that stands where it should.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Held {
    pub(crate) holder: Point<Chip>,
    pub(crate) tip: Point<Chip>,
}

/// The estimates of all tips.
#[derive(Debug, Clone)]
pub(crate) struct TipEstimator {
    fibers: [Option<Estimate>; SIDES],
    sensing: [Option<Estimate>; SIDES],
    guarded: [Option<Guarded>; SIDES],
    /// How ways may be wrong, as the guard has it.
    strays: Strays,
    /// What the light has told of each fiber's z: by how much it is more than vision has it, metres, its standard
    /// deviation, and where the holder stood then. What warms is seen by vision meanwhile.
    told: [Option<(f64, f64, Point<Chip>)>; SIDES],
    /// Bound of vision's fixed error in z, metres, and the standard deviation of where a facet lies.
    bound: f64,
    facet: f64,
    /// Since when each fiber has been where it is, seconds: older frames say nothing of it.
    since: [f64; SIDES],
    /// How the tips of each side swing.
    swings: [Swing; SIDES],
}

impl TipEstimator {
    pub(crate) fn new(vision: &VisionSpec, guard: &GuardSpec) -> Self {
        Self {
            fibers: [None; SIDES],
            sensing: [None; SIDES],
            guarded: [None; SIDES],
            strays: Strays {
                scale: guard.scale,
                askew: guard.askew,
            },
            told: [None; SIDES],
            bound: vision.believed()[1],
            facet: vision.facet_z,
            since: [0.0; SIDES],
            swings: Default::default(),
        }
    }

    /// How the tips of a side swing.
    pub(crate) fn swing(&self, side: Side) -> &Swing {
        &self.swings[side.index()]
    }

    /// How they swing is to be seen anew.
    pub(crate) fn forget_swing(&mut self, side: Side) {
        self.swings[side.index()] = Swing::default();
    }

    /// The light says by how much farther along the chip's z a fiber stands than vision has it, metres, known to a
    /// standard deviation, with the holder at a place. It is believed before vision.
    pub(crate) fn tell(&mut self, side: Side, farther: f64, deviation: f64, holder: Point<Chip>) {
        self.told[side.index()] = Some((farther, deviation, holder));
    }

    /// What the light has told of the fiber of a side is believed no more.
    pub(crate) fn forget_told(&mut self, side: Side) {
        self.told[side.index()] = None;
    }

    /// The fiber of a side is another one from `time` on.
    pub(crate) fn forget(&mut self, side: Side, time: f64) {
        self.fibers[side.index()] = None;
        self.guarded[side.index()] = None;
        self.told[side.index()] = None;
        self.swings[side.index()].is_another();
        self.since[side.index()] = time;
    }

    /// Takes in a frame; `held` says where the holder of a side was told to be at a time, and where its tip, which its micro moves;
    /// `aside`, how far along the chip's x that was told to move it, metres.
    pub(crate) fn see(
        &mut self,
        frame: &Frame,
        held: impl Fn(Side, f64) -> Option<Held>,
        aside: impl Fn(Side, f64) -> Option<f64>,
    ) {
        for side in Side::ALL {
            let i = side.index();
            let (Some(now), Some(before)) = (
                held(side, frame.time),
                held(side, frame.time - TUNING.vision.speed),
            ) else {
                continue;
            };
            let (at, before) = (now.tip, before.tip);
            let lag = |way: f64| (TUNING.vision.late * way / TUNING.vision.speed).powi(2);
            let lag = [lag(at.x - before.x), lag(at.z - before.z)];
            let shown = |fix: &Fix| Shown {
                tip: fix.tip,
                time: frame.time,
                beside: fix.x - at.x,
                noise: fix.sigma.powi(2),
                span: span(|since| aside(side, frame.time + since)),
                holder: now.holder,
            };
            for fix in frame.fixes.iter().filter(|fix| fix.arm == i) {
                match fix.tip {
                    Tip::Fiber if frame.time > self.since[i] => {
                        self.swings[i].note(shown(fix));
                        update(&mut self.fibers[i], frame.time, at, fix, lag);
                        self.guarded[i] =
                            Some(guarded(self.guarded[i], at, fix, lag[1], self.strays));
                    }
                    Tip::Fiber => {}
                    Tip::Sensing => {
                        // As long as there is no fiber beside it.
                        if self.fibers[i].is_none() {
                            self.swings[i].note(shown(fix));
                        }
                        update(&mut self.sensing[i], frame.time, at, fix, lag);
                    }
                }
            }
        }
    }

    /// Where the fiber of a side stands along z from its holder as who guards the machine believes it, and how well it would know that were its
    /// holder at a place, one standard deviation; metres. `None` before the first frame.
    pub(crate) fn by_guard(&self, side: Side, z: f64) -> Option<(f64, f64)> {
        let guarded = self.guarded[side.index()]?;
        let strayed = self.strays.scale * (z - guarded.stood.z);
        Some((guarded.value, guarded.variance.sqrt().hypot(strayed)))
    }

    /// Where a tip stands from its holder by vision alone.
    fn by_vision(&self, side: Side, tip: Tip) -> Option<Seen> {
        let estimate = match tip {
            Tip::Fiber => self.fibers[side.index()],
            Tip::Sensing => self.sensing[side.index()],
        }?;
        Some(Seen {
            x: estimate.x.value,
            z: estimate.z.value,
            sigma: [estimate.x, estimate.z].map(|offset| offset.variance.sqrt()),
            bound_z: self.bound,
            facet_z: self.facet,
        })
    }

    pub(crate) fn seen(&self, side: Side, tip: Tip) -> Option<Seen> {
        let vision = self.by_vision(side, tip)?;
        let told = match tip {
            Tip::Fiber => self.told[side.index()].zip(self.fibers[side.index()]),
            Tip::Sensing => None,
        };
        Some(match told {
            None => vision,
            Some(((farther, deviation, holder), Estimate { holder: stood, .. })) => Seen {
                z: vision.z + farther,
                sigma: [
                    vision.sigma[0],
                    vision.sigma[1]
                        .hypot(deviation)
                        .hypot(TUNING.vision.scale * (stood.z - holder.z)),
                ],
                bound_z: 0.0,
                facet_z: 0.0,
                ..vision
            },
        })
    }
}

/// How far a micro is told to go about the time of a frame, metres, as much as the camera may be earlier or later than it says.
fn span(aside: impl Fn(f64) -> Option<f64>) -> f64 {
    /// Looks to either side.
    const LOOKS: i32 = 6;
    let now = aside(0.0).unwrap_or_default();
    let looks = (-LOOKS..=LOOKS).filter_map(|k| {
        let share = f64::from(k) / f64::from(LOOKS);
        aside(share * TUNING.ring_down.exposed)
    });
    looks.map(|then| (then - now).abs()).fold(0.0, f64::max)
}

/// What who guards the machine makes of a fix more of a tip that would stand `at` a place by its holder alone; `lag` is the variance in z that comes of
/// moving.
fn guarded(
    before: Option<Guarded>,
    at: Point<Chip>,
    fix: &Fix,
    lag: f64,
    strays: Strays,
) -> Guarded {
    let (seen, noise) = (fix.z - at.z, fix.sigma.powi(2));
    let Some(before) = before else {
        return Guarded {
            value: seen,
            variance: noise + lag,
            stood: at,
        };
    };
    let aside = (at.x - before.stood.x).hypot(at.y - before.stood.y);
    let strayed = (strays.scale * (at.z - before.stood.z)).hypot(strays.askew * aside);
    let variance = before.variance + strayed * strayed;
    let share = variance / (variance + noise + lag);
    Guarded {
        value: before.value + share * (seen - before.value),
        variance: ((1.0 - share) * variance).max(GuardSpec::FORGETS * noise),
        stood: at,
    }
}

/// Takes a fix of a `time` into an estimate; `lag` is the variance in x and z that comes of moving.
fn update(
    estimate: &mut Option<Estimate>,
    time: f64,
    holder: Point<Chip>,
    fix: &Fix,
    lag: [f64; 2],
) {
    let seen = [fix.x - holder.x, fix.z - holder.z];
    let noise = fix.sigma * fix.sigma;
    *estimate = Some(match estimate {
        None => {
            let offset = |i: usize| Offset::new(seen[i], noise + lag[i]);
            Estimate {
                x: offset(0),
                z: offset(1),
                holder,
                time,
            }
        }
        Some(before) => {
            let way = holder.distance(before.holder);
            let drift = (TUNING.vision.scale * way).powi(2)
                + TUNING.vision.warms * TUNING.vision.warms * (time - before.time).max(0.0);
            Estimate {
                x: before.x.update(seen[0], drift, noise, lag[0]),
                z: before.z.update(seen[1], drift, noise, lag[1]),
                holder,
                time,
            }
        }
    });
}

impl Offset {
    fn new(value: f64, variance: f64) -> Self {
        Self {
            value,
            variance,
            noise: Noise::default(),
            beside: Default::default(),
        }
    }

    /// A step of a Kalman filter. What comes of moving does not average out.
    fn update(mut self, seen: f64, drift: f64, noise: f64, lag: f64) -> Self {
        let before = self.variance + drift;
        let unforeseen = seen - self.value;
        // What moves lies beside for reasons of its own.
        let at_rest = lag < noise;
        if at_rest {
            self.noise.add(unforeseen / (before + noise).sqrt());
        }
        let noise = noise * self.noise.times();
        if at_rest {
            let by = unforeseen / (before + noise).sqrt();
            for (beside, by) in self.beside.iter_mut().zip([by, -by]) {
                if let Some((value, frames)) = beside.add(by, seen) {
                    return Self {
                        noise: self.noise,
                        ..Self::new(value, noise / frames)
                    };
                }
            }
        }
        let share = before / (before + noise + lag);
        self.value += share * unforeseen;
        self.variance = ((1.0 - share) * before).max(lag.min(before));
        self
    }
}

impl Noise {
    /// How many times as large a variance as the camera states frames have been seen to have; no less than that.
    pub(crate) fn times(&self) -> f64 {
        self.times_beside(TUNING.vision.stated)
    }

    /// The same where what it states counts as much as so many frames.
    pub(crate) fn times_beside(&self, known: f64) -> f64 {
        ((known + self.squares) / (known + self.frames)).max(1.0)
    }

    /// Adds a frame that was so many deviations, by what the camera states, from where it was foreseen.
    pub(crate) fn add(&mut self, by: f64) {
        self.squares += by * by;
        self.frames += 1.0;
    }
}

impl Beside {
    /// Adds a frame that lies so many deviations on this side. What is seen by now, and by how many frames, where what was seen before is not there
    /// any more.
    fn add(&mut self, by: f64, seen: f64) -> Option<(f64, f64)> {
        self.sum += by - TUNING.vision.beside;
        if self.sum <= 0.0 {
            *self = Self::default();
            return None;
        }
        self.seen += seen;
        self.frames += 1.0;
        (self.sum > TUNING.vision.moved).then_some((self.seen / self.frames, self.frames))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA: f64 = 0.7e-6;

    fn fix(x: f64, z: f64) -> Fix {
        Fix {
            arm: 0,
            tip: Tip::Fiber,
            x,
            z,
            sigma: SIGMA,
        }
    }

    #[test]
    fn frames_at_rest_average() {
        let here = Point::new(1e-3, 0.0, 2e-3);
        let mut estimate = None;
        for k in 0..16 {
            let error = if k % 2 == 0 { SIGMA } else { -SIGMA };
            update(
                &mut estimate,
                0.0,
                here,
                &fix(here.x + 30e-6, here.z + error),
                [0.0; 2],
            );
        }
        let estimate = estimate.expect("sixteen frames");
        assert!((estimate.x.value - 30e-6).abs() < 1e-12);
        assert!(estimate.z.value.abs() < 0.1 * SIGMA);
        let deviation = estimate.z.variance.sqrt();
        // A little more, for by the first of them the second is far away.
        assert!((deviation / SIGMA - 0.25).abs() < 0.01, "{deviation}");
    }

    /// What stands averages, down to what warms; what has gone a way is known no better than ways are.
    #[test]
    fn the_guard_believes_no_way() {
        let strays = Strays {
            scale: 2e-3,
            askew: 2e-3,
        };
        let here = Point::new(1e-3, 0.0, 2e-3);
        let mut before = None;
        let mut look = |at: Point<Chip>, lag: f64| {
            let now = guarded(before, at, &fix(at.x, at.z + 4e-6), lag, strays);
            before = Some(now);
            assert!((now.value - 4e-6).abs() < 1e-12);
            now.variance.sqrt() / SIGMA
        };
        let stood = (0..16).map(|_| look(here, 0.0)).last().expect("frames");
        assert!((stood - 0.25).abs() < 1e-6, "{stood}");
        let long = (0..1000).map(|_| look(here, 0.0)).last().expect("frames");
        assert!((long * long - GuardSpec::FORGETS).abs() < 1e-9, "{long}");
        // Two micrometres of a millimetre, by a frame that lags behind by a micrometre or so.
        let gone = look(here.shifted(0.0, 0.0, 1e-3), 1e-12);
        let expected = (2e-6_f64.powi(-2) + (SIGMA * SIGMA + 1e-12).recip()).powf(-0.5) / SIGMA;
        assert!((gone - expected).abs() < 1e-2, "{gone} {expected}");
    }

    /// A belt slips by a micrometre: of thirty frames before and twenty since, all alike, the mean would be half of it off.
    #[test]
    fn what_has_moved_unseen_is_followed() {
        let here = Point::new(1e-3, 0.0, 2e-3);
        let mut estimate = None;
        let mut look = |k: u32, z: f64| {
            let error = if k.is_multiple_of(2) { SIGMA } else { -SIGMA };
            let fix = fix(here.x, here.z + z + error);
            update(&mut estimate, 0.0, here, &fix, [0.0; 2]);
            estimate.expect("a frame").z
        };
        for k in 0..30 {
            look(k, 0.0);
        }
        let moved = (0..20).map(|k| look(k, 1.2e-6)).last().expect("frames");
        assert!((moved.value - 1.2e-6).abs() < 0.3e-6, "{}", moved.value);
        assert!(moved.variance.sqrt() > SIGMA / 20_f64.sqrt());
    }

    /// Frames twice as noisy as the camera says say half as much, and nothing has moved.
    #[test]
    fn frames_noisier_than_stated_say_less() {
        let here = Point::new(1e-3, 0.0, 2e-3);
        let mut estimate = None;
        for k in 0..64 {
            let error = if k % 2 == 0 { SIGMA } else { -SIGMA };
            let fix = fix(here.x, here.z + 2.0 * error);
            update(&mut estimate, 0.0, here, &fix, [0.0; 2]);
        }
        let z = estimate.expect("frames").z;
        assert!(z.value.abs() < 0.3 * SIGMA, "{}", z.value);
        assert!(z.variance.sqrt() > 1.5 * SIGMA / 8.0);
    }

    /// A tip that lags by 7 um on the way is known when it has stood still for a few frames.
    #[test]
    fn what_lags_on_the_way_counts_little() {
        let (mut estimate, lag) = (None, (TUNING.vision.late * 5e-3).powi(2));
        for k in 0..20 {
            let at = Point::new(0.0, 0.0, 200e-6 * f64::from(k));
            update(&mut estimate, 0.0, at, &fix(0.0, at.z - 7e-6), [0.0, lag]);
        }
        let here = Point::new(0.0, 0.0, 4e-3);
        for _ in 0..6 {
            update(&mut estimate, 0.0, here, &fix(0.0, here.z), [0.0; 2]);
        }
        let estimate = estimate.expect("frames");
        assert!(estimate.z.value.abs() < 0.1e-6, "{}", estimate.z.value);
    }
}
