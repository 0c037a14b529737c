//! Where the tips are, by encoders and by what vision saw of them, and how near that is to the chip.
//!
//! The guard has an estimate of its own: it must not believe what it is there to check.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

mod crossed;
mod seen;
mod stand;

use crossed::Crossed;
pub(super) use seen::Surprise;
use stand::hidden_by_piezos;
pub(super) use stand::{Stand, Way};

use super::Geometry;
use super::across::Across;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{GuardSpec, HolderSpec, MICRO_AXES, SIDES};
use pigtail_hal::{Axis, Measurement, Side, Spec};
use pigtail_model::frames::{Chip, Displacement, Point};

/// So many times longer than it takes to settle a piezo may be seen to swing.
const LATE: usize = 4;
/// So many times as far as it was from where it is told to be one that is hardly damped may be beyond it: as far again, and lines
/// that repeat near its resonance make it swing farther. A choice.
const SWINGS: f64 = 2.0;
/// Cycles from one look at where piezos were told to be to the next.
const EVERY: usize = 4;
/// What the transmissions hide in x of a way in y, as a share of it: their windups differ.
const CROSS: f64 = 0.15;
/// How far beside its port the light may be, and vision's noise, metres.
const BESIDE: f64 = 8e-6;
/// An output that is so much farther ahead of its motor than it was when vision saw its tip runs away from it, metres. A choice.
const RUNS: f64 = 1e-6;
/// How far beside its port a tip on a circle may be then, where the facet stands out more, metres: half as far as its light may be. A choice.
const RIM: f64 = 0.5 * BESIDE;
/// A tip is near to the chip within this, metres: within less than a millimetre across, which a joint whose encoder is stuck goes before it is
/// stopped, the facet stands out by as much. A choice.
const NEAR: f64 = 100e-6;
/// A micro that has been told to stay this near to a place has not gone farther than twice as far, metres: less than what light
/// that goes out asks for, and that shows without a look at each moment.
const CALM: f64 = 0.45e-6;
/// Cycles over which the speed of this moment is seen.
const AT_ONCE: usize = 4;
/// Cycles over which speeds are seen.
pub(super) const WHILE: usize = 8;

/// Something that can touch the chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tip {
    Fiber(Side),
    Sensing,
}

/// What is believed of a tip.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Belief {
    /// From where its holder should have it, along the chip's z, metres.
    z: f64,
    /// How little that is known, square metres.
    z_variance: f64,
    /// How far ahead of its motor the output of its z-stage was in the same frames, metres.
    ahead: f64,
    /// Where it would stand by encoders alone when it was last seen, metres.
    stood: Point<Chip>,
    /// Where its holder stood then.
    holder: Stand,
    /// How far beside that it was seen, metres.
    x: f64,
    /// How much of it may be a piezo that was on its way, metres.
    arriving: f64,
    /// How far beside where the probes have it, metres; `None` on a rig without probes.
    x_probed: Option<f64>,
}

/// A tip and how near it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Near {
    /// What is near.
    pub(super) what: &'static str,
    /// Distance from the chip, what is not known of it taken off, metres.
    pub(super) clearance: f64,
}

/// How far a tip is from the chip.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Distance {
    /// From where the chip stands out most where the tip may be, what is not known of both taken off, metres.
    clearance: f64,
    /// By how much the output is farther ahead of its motor than it was when vision saw the tip, metres.
    ahead: f64,
    /// Whether that is the port in whose light it may stand.
    in_light: bool,
}

/// Where a fiber was led near to the chip.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Led {
    /// Where it stood in x, metres.
    x: f64,
    /// Whether that was in the light of a port by all that is known.
    in_light: bool,
}

/// Where the endpoints are across, in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Found {
    /// Angles of the five-bars' outputs by their probes, radians; nothing on a rig without probes.
    angles: Option<[[f64; 2]; SIDES]>,
    /// By encoders, metres from home; no numbers where no mechanism has these angles...
    by_encoders: [(f64, f64); SIDES],
    /// ...and by probes.
    by_probes: [(f64, f64); SIDES],
}

/// All tips, and where the holders were of late.
#[derive(Debug, Clone)]
pub(super) struct Keepout {
    geometry: Geometry,
    metres_per_count_z: f64,
    radians_per_count: f64,
    /// Displacement of the tip in x and y for a volt on each piezo, metres, and the middle, volts.
    micro: [[Displacement; MICRO_AXES]; SIDES],
    middle: f64,
    rate: f64,
    /// From a probe to its joint, metres; one without probes.
    arm: f64,
    sensing_offset: [f64; 3],
    accuracy: [f64; 2],
    /// How far aside of a port, and how far from its facet, vision is to be believed so, metres.
    field: [f64; 2],
    placement: f64,
    windup: f64,
    /// By what angle a manipulator may stand askew, and by what share a way may be wrong, standard deviations.
    askew: f64,
    scale: f64,
    /// By how much more than by design each facet may stand out, metres for a metre aside of its port.
    steeper: [f64; SIDES],
    holder: HolderSpec,
    /// By what deceleration a z-stage can be stopped, metres a second squared.
    brake: f64,
    /// The same of an endpoint across, which brakes by itself.
    brake_across: f64,
    /// Where the holders' fibers were in x of late by the outputs, without their micros. Nothing on a rig without probes.
    crossed: [Option<Crossed>; SIDES],
    /// Cycles that a piezo takes to come to where it was told to be.
    settle: usize,
    /// The square of the share of a way that a piezo may still be off, from now on every [`EVERY`] cycles.
    late: Vec<f64>,
    recent: Vec<[Stand; SIDES]>,
    /// For how many cycles each endpoint has been where it is, to the last bit.
    stood: [usize; SIDES],
    /// For how many each micro has been told to be where it is.
    micro_stood: [usize; SIDES],
    /// Around which place each was told to be within [`CALM`], and for how many cycles.
    calm: [(Displacement, usize); SIDES],
    ways: [Way; SIDES],
    /// How far the tips of each were from the chip when last looked at, what is not known taken off, metres.
    clearances: [f64; SIDES],
    /// Whether what was before says nothing of what comes.
    anew: bool,
    at: usize,
    /// What says where the endpoints are across.
    across: Across,
    found: Found,
    held: [bool; SIDES],
    fibers: [Option<Belief>; SIDES],
    sensing: Option<Belief>,
    /// Where each fiber was led near to the chip, if it is there.
    led: [Option<Led>; SIDES],
    /// Since when each fiber has been in its holder, seconds.
    since: [f64; SIDES],
    /// Since when all of it has been watched, seconds.
    begun: f64,
}

impl Keepout {
    pub(super) fn new(spec: &Spec, geometry: Geometry) -> Self {
        let settle = (spec.micro.settling * spec.servo.rate).ceil() as usize;
        // All of it until it must have settled; one that is damped less than believed swings on.
        let late: Vec<f64> = (0..LATE * settle)
            .step_by(EVERY)
            .map(|k| (-2.0 * (k as f64 / settle as f64 - 1.0).max(0.0)).exp())
            .collect();
        let cycles =
            (spec.vision.oldest() * spec.servo.rate).ceil() as usize + WHILE.max(LATE * settle) + 1;
        let home = Point::new(0.0, 0.0, 0.0);
        let stands = std::array::from_fn(|side| Stand {
            time: 0.0,
            endpoint: home,
            probed: None,
            ahead: 0.0,
            gone: [0.0; 2],
            micro: Displacement::ZERO,
            tip: geometry.arms[side].placement.chip_from_macro(home),
        });
        let (sin, cos) = spec.micro.angle.sin_cos();
        let [ox, oy, oz] = spec.sensing_fiber.offset;
        let right = &geometry.arms[Side::Right.index()];
        let z = spec.drive(Axis::Z);
        let joint = spec.drive(Axis::A);
        Self {
            metres_per_count_z: geometry.arms[0].screw.position(z.count() / z.gear_ratio),
            radians_per_count: joint.count() / joint.gear_ratio,
            micro: std::array::from_fn(|side| {
                let gain = geometry.arms[side].micro_gain;
                [
                    Displacement::new(cos * gain, sin * gain),
                    Displacement::new(-sin * gain, cos * gain),
                ]
            }),
            middle: 0.5 * spec.micro.voltage,
            rate: spec.servo.rate,
            arm: spec.probe.as_ref().map_or(1.0, |probe| probe.arm),
            sensing_offset: right.placement.chip_direction(ox, oy, oz),
            accuracy: spec.vision.believed(),
            field: [spec.vision.field_aside, spec.vision.field_away]
                .map(|far| far.unwrap_or(f64::INFINITY)),
            placement: spec.guard.placement,
            windup: spec.guard.windup,
            askew: spec.guard.askew,
            scale: spec.guard.scale,
            steeper: std::array::from_fn(|side| {
                spec.guard.steeper(geometry.facets[side].stands_out)
            }),
            holder: spec.holder,
            brake: GuardSpec::BRAKES * spec.z_stage.acceleration,
            brake_across: spec.five_bar.acceleration,
            crossed: [None; SIDES],
            settle,
            late,
            recent: vec![stands; cycles],
            stood: [0; SIDES],
            micro_stood: [0; SIDES],
            calm: [(Displacement::ZERO, 0); SIDES],
            ways: Default::default(),
            clearances: [f64::INFINITY; SIDES],
            anew: false,
            at: 0,
            across: Across::new(&geometry.arms),
            found: Found::default(),
            held: [false; SIDES],
            fibers: [None; SIDES],
            sensing: None,
            led: [None; SIDES],
            since: [0.0; SIDES],
            begun: 0.0,
            geometry,
        }
    }

    /// Nothing that was before says anything of what comes: the machine has gone on unwatched.
    pub(super) fn forget(&mut self) {
        (self.sensing, self.fibers, self.led) = (None, [None; SIDES], [None; SIDES]);
        self.crossed = [None; SIDES];
        self.anew = true;
    }

    /// Watching begins: frames from before say nothing.
    pub(super) fn begin(&mut self, time: f64) {
        (self.since, self.begun) = ([time; SIDES], time);
    }

    /// A holder has another fiber from `time` on, or none.
    pub(super) fn change_fiber(&mut self, side: Side, held: bool, time: f64) {
        let i = side.index();
        (self.held[i], self.fibers[i], self.since[i]) = (held, None, time);
        (self.led[i], self.crossed[i]) = (None, None);
    }

    /// Another chip is there from `time` on.
    pub(super) fn change_chip(&mut self, time: f64) {
        for side in Side::ALL {
            self.change_fiber(side, self.held[side.index()], time);
        }
        (self.sensing, self.begun) = (None, time);
    }

    /// Where a manipulator stood so many cycles ago.
    #[inline(always)]
    pub(super) fn stand(&self, side: usize, back: usize) -> &Stand {
        // `back` is less than all that is remembered: no division.
        let i = if back <= self.at {
            self.at - back
        } else {
            self.at + self.recent.len() - back
        };
        &self.recent[i][side]
    }

    /// How far a micro may have been from where it was told to be so many cycles ago, metres: on its way from
    /// anywhere that it was told of late, or swinging about it.
    fn arriving(&self, side: usize, back: usize) -> f64 {
        SWINGS * self.squares(side, back).fold(0.0, f64::max).sqrt()
    }

    /// Whether a tip has been within so many metres of where it is for as long as piezos may swing.
    #[inline(always)]
    pub(super) fn is_still(&self, side: usize, metres: f64) -> bool {
        let now = self.stand(side, 0).endpoint;
        // What moves mostly shows by the first of them. What has stood where it is, or hardly moved, needs no look at each cycle.
        let (_, calm) = self.calm[side];
        if calm < LATE * self.settle || metres < 2.0 * CALM {
            for square in self.squares(side, 0) {
                // What is no number has moved, too.
                let near = square <= metres * metres;
                if !near {
                    return false;
                }
            }
        }
        for back in self.stood[side] + 1..=self.settle {
            let near = self.stand(side, back).endpoint.distance(now) <= metres;
            if !near {
                return false;
            }
        }
        true
    }

    /// Squares of how far a micro may still have been from where it was told to be so many cycles ago, by where
    /// it was told to be at each moment before.
    #[inline(always)]
    fn squares(&self, side: usize, back: usize) -> impl Iterator<Item = f64> {
        let told = self.stand(side, back).micro;
        // Where it was told to be all the while, it is off by nothing.
        let stood = if back == 0 { self.micro_stood[side] } else { 0 };
        let first = (stood / EVERY).min(self.late.len());
        let looks = (first * EVERY..).step_by(EVERY);
        (self.late[first..].iter().zip(looks)).map(move |(share, k)| {
            let off = told - self.stand(side, back + k).micro;
            share * (off.x * off.x + off.y * off.y)
        })
    }

    /// Whether a tip is so near to the chip that a manipulator whose motor is not known could bring it there.
    #[inline(always)]
    pub(super) fn is_near(&self, side: usize) -> bool {
        self.clearances[side] < NEAR
    }

    /// How far an endpoint has gone of late.
    pub(super) fn way(&self, side: usize) -> &Way {
        &self.ways[side]
    }

    #[inline(always)]
    fn way_now(&self, side: usize) -> Way {
        if self.stood[side] >= WHILE {
            return Way::default();
        }
        let [now, then] = [0, WHILE].map(|back| self.stand(side, back).endpoint);
        Way {
            across: (now.across() - then.across()).norm(),
            along: now.z - then.z,
            at_once: self.moved_along(side, AT_ONCE),
        }
    }

    /// How far an endpoint has moved along within so many cycles, metres.
    pub(super) fn moved_along(&self, side: usize, back: usize) -> f64 {
        self.stand(side, 0).endpoint.z - self.stand(side, back).endpoint.z
    }

    /// Finds where the endpoints are across in this cycle.
    #[inline(always)]
    pub(super) fn find(&mut self, measured: &Measurement) {
        let counted = measured.encoders.map(|[Counts(a), Counts(b), _]| {
            [a, b].map(|counts| counts as f64 * self.radians_per_count)
        });
        let angles =
            (measured.probes).map(|probes| probes.map(|[a, b, _]| [a / self.arm, b / self.arm]));
        let [by_encoders, by_probes] = self.across.of(counted, angles.unwrap_or_default());
        self.found = Found {
            angles,
            by_encoders,
            by_probes,
        };
    }

    /// Notes where everything is in this cycle, of which the endpoints have been [found](Self::find). `false` for a side whose joints no mechanism
    /// has.
    #[inline(always)]
    pub(super) fn note(
        &mut self,
        measured: &Measurement,
        micro: &[[Volts; MICRO_AXES]; SIDES],
    ) -> [bool; SIDES] {
        let (encoders, probes) = (&measured.encoders, measured.probes.as_ref());
        let last = self.at;
        self.at += 1;
        if self.at == self.recent.len() {
            self.at = 0;
        }
        let mut wholes = [true; SIDES];
        let Found {
            angles,
            by_encoders,
            ..
        } = self.found;
        for (i, whole) in wholes.iter_mut().enumerate() {
            let arm = &self.geometry.arms[i];
            let [.., Counts(z)] = encoders[i];
            let before = &self.recent[last][i];
            let (was, was_told) = (before.endpoint, before.micro);
            let (mut endpoint, mut gone) = (was, before.gone);
            let (x, y) = by_encoders[i];
            *whole = !(x + y).is_nan();
            if *whole {
                gone[0] += (x - endpoint.x).abs();
                gone[1] += (y - endpoint.y).abs();
                (endpoint.x, endpoint.y) = (x, y);
            }
            endpoint.z = z as f64 * self.metres_per_count_z;
            let mut added = Displacement::ZERO;
            for (gain, Volts(volts)) in self.micro[i].iter().zip(micro[i]) {
                added += *gain * (volts - self.middle);
            }
            let tip = arm.placement.chip_from_macro(endpoint.moved(added));
            self.stood[i] = if endpoint == was {
                self.stood[i].saturating_add(1)
            } else {
                0
            };
            self.micro_stood[i] = if added == was_told {
                self.micro_stood[i].saturating_add(1)
            } else {
                0
            };
            let (around, cycles) = self.calm[i];
            let off = added - around;
            self.calm[i] = if off.x * off.x + off.y * off.y <= CALM * CALM {
                (around, cycles.saturating_add(1))
            } else {
                (added, 0)
            };
            self.recent[self.at][i] = Stand {
                time: measured.time,
                endpoint,
                probed: angles.map(|angles| angles[i]),
                ahead: probes.map_or(0.0, |probes| probes[i][Axis::Z.index()] - endpoint.z),
                gone,
                micro: added,
                tip,
            };
        }
        if std::mem::take(&mut self.anew) {
            let now = self.recent[self.at];
            self.recent.fill(now);
            self.stood = [0; SIDES];
            self.micro_stood = [0; SIDES];
            self.calm = [(Displacement::ZERO, 0); SIDES];
        }
        self.ways = [self.way_now(0), self.way_now(1)];
        wholes
    }

    /// Where the probes have a tip across the chip, metres.
    fn probed_x(&self, tip: Tip, stand: &Stand) -> Option<f64> {
        let arm = &self.geometry.arms[tip.side().index()];
        let (x, y) = arm.across(stand.probed?).ok()?;
        let at = Point::new(x, y, stand.endpoint.z).moved(stand.micro);
        Some(arm.placement.chip_from_macro(at).x)
    }

    /// The same of where a manipulator stands now, if it matters: where a tip of it has been seen. And of its holder, the micro apart.
    #[inline(always)]
    fn probed_x_now(&self, side: Side) -> Option<(f64, f64)> {
        let i = side.index();
        let sensing = side == Side::Right && self.sensing.is_some();
        if !self.held[i] && !sensing {
            return None;
        }
        let stand = &self.recent[self.at][i];
        let arm = &self.geometry.arms[i];
        self.found.angles?;
        let (x, y) = self.found.by_probes[i];
        if (x + y).is_nan() {
            return None;
        }
        let holder = Point::new(x, y, stand.endpoint.z);
        let x_of = |at| arm.placement.chip_from_macro(at).x;
        Some((x_of(holder.moved(stand.micro)), x_of(holder)))
    }

    /// By how much less far an inclined facet would be from a tip that goes across, were it stopped now, metres. The holder is in `x` now, metres, the
    /// micro apart: that goes nowhere when all stops.
    #[inline(always)]
    fn comes_nearer_across(&mut self, side: usize, x: f64) -> f64 {
        let crossed = self.crossed[side].get_or_insert_with(|| Crossed::at(x));
        crossed.note(x);
        let on_average = (x - crossed.before(WHILE)) / WHILE as f64;
        let now = (x - crossed.before(AT_ONCE)) / AT_ONCE as f64;
        // The one by which the facet comes nearer faster: one that gathers speed is faster than it was on average.
        let nearer = self.geometry.facets[side].stands_out;
        let nearer = nearer + self.steeper[side].copysign(nearer);
        let speed = self.rate
            * if on_average * nearer > now * nearer {
                on_average
            } else {
                now
            };
        let way = GuardSpec::REACTION / self.rate + 0.5 * speed.abs() / self.brake_across;
        (speed * way * nearer).max(0.0)
    }

    /// What transmissions and piezos may have kept to themselves of the way between two stands, in x,
    /// metres.
    #[inline(always)]
    fn hidden(&self, now: &Stand, then: &Stand) -> f64 {
        let way = (now.gone[0] - then.gone[0]) + CROSS * (now.gone[1] - then.gone[1]);
        self.windup.min(way) + hidden_by_piezos(now, then)
    }

    /// Where a tip would be so many cycles ago were its fiber as it should be.
    #[inline(always)]
    fn nominal(&self, tip: Tip, back: usize) -> Point<Chip> {
        let at = self.stand(tip.side().index(), back).tip;
        match tip {
            Tip::Fiber(_) => at,
            Tip::Sensing => {
                let [x, y, z] = self.sensing_offset;
                at.shifted(x, y, z)
            }
        }
    }

    /// What is nearest to the chip, and how near it would come if it were stopped now.
    #[inline(always)]
    pub(super) fn nearest(&mut self) -> Near {
        let mut nearest = Near {
            what: "",
            clearance: f64::INFINITY,
        };
        // One by one: a closure may be left a call, which gets none of its caller's instructions.
        let outputs = [
            self.probed_x_now(Side::Left),
            self.probed_x_now(Side::Right),
        ];
        let probed = outputs.map(|xs| xs.map(|(tip, _)| tip));
        for side in Side::ALL {
            let i = side.index();
            // Towards the chip is forward in either manipulator's frame. A loop that swings is as fast as it is at this
            // moment, not on average.
            let Way { along, at_once, .. } = self.ways[i];
            let (on_average, now) = (
                along * self.rate / WHILE as f64,
                at_once * self.rate / AT_ONCE as f64,
            );
            // And one whose encoder is stuck as fast as its output.
            let ahead = self.stand(i, 0).ahead - self.stand(i, AT_ONCE).ahead;
            let output = now + ahead * self.rate / AT_ONCE as f64;
            // Of one that goes away nothing is left: without a branch, for noise has one that stands go either way.
            let [stop, stop_output] = [on_average.max(now), output].map(|speed| {
                let speed = if speed > 0.0 { speed } else { 0.0 };
                speed * GuardSpec::REACTION / self.rate + 0.5 * speed * speed / self.brake
            });
            let across = match outputs[i] {
                Some((_, holder)) => self.comes_nearer_across(i, holder),
                None => 0.0,
            };
            let facet = &self.geometry.facets[i];
            let sensing = if side == Side::Right {
                let distance =
                    self.clearance(Tip::Sensing, self.sensing.as_ref(), probed[i], BESIDE);
                Some((Tip::Sensing.name(), distance.clearance, distance.ahead))
            } else {
                None
            };
            let carried = if self.held[i] {
                let tip = Tip::Fiber(side);
                let x = probed[i].unwrap_or(self.stand(i, 0).tip.x);
                // One that was led there in the light of a port is in it until it has gone as far as that may lie beside.
                let there =
                    self.led[i].is_some_and(|led| led.in_light && (x - led.x).abs() <= BESIDE);
                let beside = if there { 2.0 * BESIDE } else { BESIDE };
                let Distance {
                    clearance,
                    ahead,
                    in_light,
                } = self.clearance(tip, self.fibers[i].as_ref(), probed[i], beside);
                let near = clearance - ahead.max(0.0) < GuardSpec::LED;
                self.led[i] = near.then_some(match self.led[i] {
                    Some(led) => Led {
                        in_light: led.in_light || in_light,
                        ..led
                    },
                    None => Led { x, in_light },
                });
                // From where its light led it near it may not go where the facet stands out.
                let out = match self.led[i] {
                    Some(led) if in_light => ((x - led.x) * facet.stands_out).max(0.0),
                    _ => 0.0,
                };
                // One that runs away may be at the near rim of its circle: where it was led there it was somewhere on it.
                let rim = if in_light && ahead > RUNS {
                    RIM * facet.stands_out.abs()
                } else {
                    0.0
                };
                (tip.name(), clearance - out - rim, ahead)
            } else {
                // An empty holder is as broad as it is.
                let at = self.stand(i, 0).tip;
                let aside = (at.x - facet.ports[0].x).abs() + 0.5 * self.holder.width;
                let front = facet.clearance(facet.ports[0].x, at.z, aside, self.steeper[i]);
                let clearance = front + self.holder.tip - self.placement;
                (["left holder", "right holder"][i], clearance, 0.0)
            };
            self.clearances[i] = f64::INFINITY;
            for tip in [Some(carried), sensing] {
                let Some((what, clearance, ahead)) = tip else {
                    continue;
                };
                let forward = if ahead > 0.0 { ahead } else { 0.0 };
                self.clearances[i] = self.clearances[i].min(clearance - forward);
                // An output that is behind its motor may be the faster of both, and that from farther away.
                let (stop, stop_output) = (forward + stop, ahead + stop_output);
                // What a probe does not tell is no number, and does not hide what the encoders do.
                let stop = if stop_output > stop {
                    stop_output
                } else {
                    stop
                };
                let clearance = clearance - stop - across;
                if clearance < nearest.clearance {
                    nearest = Near { what, clearance };
                }
            }
        }
        nearest
    }

    /// How far the holders are from each other where they could meet, metres.
    #[inline(always)]
    pub(super) fn between_holders(&self) -> f64 {
        let [left, right] = [self.stand(0, 0).tip, self.stand(1, 0).tip];
        let beside = (left.x - right.x).abs() > self.holder.width + self.placement
            || (left.y - right.y).abs() > self.holder.height + self.placement;
        if beside {
            return f64::INFINITY;
        }
        let tips = if self.held == [true; SIDES] {
            0.0
        } else {
            self.holder.tip
        };
        right.z - left.z + tips - self.placement
    }

    /// Of a tip from the chip with what is believed of it, where the probes have its holder's fiber in x (metres), and how far
    /// `beside` all that is known the light may be, metres.
    #[inline(always)]
    fn clearance(
        &self,
        tip: Tip,
        belief: Option<&Belief>,
        probed: Option<f64>,
        beside: f64,
    ) -> Distance {
        let i = tip.side().index();
        let (facet, steeper) = (&self.geometry.facets[i], self.steeper[i]);
        let at = self.nominal(tip, 0);
        let Some(belief) = belief else {
            let aside = self.placement + self.windup;
            return Distance {
                clearance: facet.clearance(at.x, at.z, aside, steeper) - self.placement,
                ahead: 0.0,
                in_light: false,
            };
        };
        let drift = self.scale * (at.z - belief.stood.z);
        let unsure = GuardSpec::SIGMAS * (belief.z_variance + drift * drift).sqrt();
        let now = self.stand(i, 0);
        let (x, hidden) = match probed.zip(belief.x_probed) {
            Some((probed, beside)) => (probed + beside, hidden_by_piezos(now, &belief.holder)),
            None => (at.x + belief.x, self.hidden(now, &belief.holder)),
        };
        let aside = self.accuracy[0] + hidden + belief.arriving;
        let z = at.z + belief.z;
        // Before a port: a tip that comes near to the chip is led there by its light, which says
        // better where it stands than vision can.
        let in_light = match tip {
            Tip::Fiber(_) => facet.gap_in_light(x, z, aside + beside),
            Tip::Sensing => None,
        };
        Distance {
            clearance: in_light.unwrap_or_else(|| facet.clearance(x, z, aside, steeper)) - unsure,
            // What vision saw was the output's: where that is farther ahead than it was then, the motor does not tell how near it is.
            ahead: now.ahead - belief.ahead,
            in_light: in_light.is_some(),
        }
    }
}

impl Tip {
    fn side(self) -> Side {
        match self {
            Self::Fiber(side) => side,
            Self::Sensing => Side::Right,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Fiber(Side::Left) => "left fiber",
            Self::Fiber(Side::Right) => "right fiber",
            Self::Sensing => "sensing fiber",
        }
    }
}
