//! How a group moves: what its controller tells its axes from step to step, and where they then are.

use super::plant::{CoarsePlant, FinePlant};
use crate::sensors::normal;
use pigtail_hal::bench::{Dither, Glide, GroupCaps, Knot, Law, Pose, Ticket};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Length of a step, seconds.
pub(super) const STEP: f64 = 1e-3;

type Vector = [f64; 3];

fn length(v: Vector) -> f64 {
    v[0].hypot(v[1]).hypot(v[2])
}

/// A circle that is played.
#[derive(Debug, Clone)]
struct Turning {
    law: Dither,
    since: f64,
    /// Its middle and radius when it began, beside what they follow.
    middle: [f64; 2],
    radius: f64,
}

#[derive(Debug, Clone)]
enum Playing {
    Rest,
    Line { to: Vector, speed: f64 },
    Scan { knots: Vec<Knot>, since: f64 },
    Turning(Turning),
    Brake,
}

/// What a group's controller tells its axes.
#[derive(Debug, Clone)]
pub(super) struct Controller {
    range: [(f64, f64); 3],
    speed: Vector,
    acceleration: f64,
    settling: f64,
    /// Where the axes are told to be, and how fast that moves.
    pub(super) told: Vector,
    velocity: Vector,
    playing: Playing,
    ticket: Option<Ticket>,
    /// From when on it is at rest where it was told to be.
    at_rest: Option<f64>,
    /// Of circles: their middle, radius and angle as they are now.
    middle: [f64; 2],
    radius: f64,
    angle: f64,
}

impl Controller {
    pub(super) fn new(caps: &GroupCaps, acceleration: f64) -> Self {
        let axis = |i: usize| caps.axes[i];
        let of = |i| axis(i).map_or((0.0, 0.0), |axis| axis.range);
        Self {
            range: std::array::from_fn(of),
            speed: std::array::from_fn(|i| axis(i).map_or(0.0, |axis| axis.speed)),
            acceleration,
            settling: caps.settling,
            told: [0.0; 3],
            velocity: [0.0; 3],
            playing: Playing::Rest,
            ticket: None,
            at_rest: None,
            middle: [0.0; 2],
            radius: 0.0,
            angle: 0.0,
        }
    }

    /// The ticket of the law that is played.
    pub(super) fn ticket(&self) -> Option<Ticket> {
        self.ticket
    }

    /// Begins a law, `now`; of circles that follow, when the group that leads is measured at `lead`.
    pub(super) fn play(&mut self, ticket: Option<Ticket>, law: Law, now: f64, lead: Option<Pose>) {
        self.ticket = ticket;
        self.at_rest = None;
        let turns = matches!(self.playing, Playing::Turning(_));
        self.playing = match law {
            Law::Line { to, limits } => Playing::Line {
                to: [to.x(), to.y(), to.z()],
                speed: limits.speed.unwrap_or(f64::INFINITY),
            },
            Law::Scan(knots) => Playing::Scan { knots, since: now },
            Law::Brake => Playing::Brake,
            Law::Dither(law) => {
                if !turns {
                    self.middle = [self.told[0], self.told[1]];
                    (self.radius, self.angle) = (0.0, 0.0);
                }
                let (by, times) = followed(&law, lead);
                Playing::Turning(Turning {
                    law,
                    since: now,
                    middle: [self.middle[0] - by[0], self.middle[1] - by[1]],
                    radius: self.radius / times,
                })
            }
        };
    }

    /// The group whose pose it follows.
    pub(super) fn follows(&self) -> Option<usize> {
        match &self.playing {
            Playing::Turning(turning) => turning.law.lead.map(|lead| lead.group.0),
            _ => None,
        }
    }

    /// A step, that ends `now`. A ticket that is over with it.
    pub(super) fn step(&mut self, now: f64, lead: Option<Pose>) -> Option<Ticket> {
        let before = self.told;
        let mut over = false;
        match &self.playing {
            Playing::Rest => self.velocity = [0.0; 3],
            Playing::Brake => over = self.steer(None, f64::INFINITY),
            Playing::Line { to, speed } => {
                let (to, speed) = (*to, *speed);
                over = self.steer(Some(to), speed);
            }
            Playing::Scan { knots, since } => {
                let (at, ended) = along(knots, now - since, before);
                (self.told, over) = (at, ended);
            }
            Playing::Turning(turning) => {
                let (by, times) = followed(&turning.law, lead);
                let since = now - turning.since;
                let glide = |from: f64, to: f64, share: f64| from + (to - from) * share;
                let Dither {
                    centre,
                    radius,
                    rate,
                    ..
                } = turning.law;
                let share = centre.share(since);
                self.middle =
                    std::array::from_fn(|i| by[i] + glide(turning.middle[i], centre.to[i], share));
                self.radius = times * glide(turning.radius, radius.to, radius.share(since));
                over = radius.to == 0.0 && ended(&radius, since) && ended(&centre, since);
                self.angle = (self.angle + TAU * rate * STEP) % TAU;
                let (sin, cos) = self.angle.sin_cos();
                self.told[0] = self.middle[0] + self.radius * cos;
                self.told[1] = self.middle[1] + self.radius * sin;
            }
        }
        for (told, (low, high)) in self.told.iter_mut().zip(self.range) {
            *told = told.clamp(low, high);
        }
        if !matches!(self.playing, Playing::Line { .. } | Playing::Brake) {
            self.velocity = std::array::from_fn(|i| (self.told[i] - before[i]) / STEP);
        }
        if over {
            self.playing = Playing::Rest;
            self.at_rest = Some(now + self.settling);
        }
        match self.at_rest {
            Some(at) if now >= at - 0.5 * STEP => {
                self.at_rest = None;
                self.ticket.take()
            }
            _ => None,
        }
    }

    /// Towards a place, or to rest, within speed and acceleration. Whether it is there.
    fn steer(&mut self, to: Option<Vector>, limit: f64) -> bool {
        /// Share of its acceleration that a stage plans to brake with: the rest is for rounding to steps.
        const PLANNED: f64 = 0.8;
        let way: Vector = to.map_or([0.0; 3], |to| std::array::from_fn(|i| to[i] - self.told[i]));
        let left = length(way);
        let mut wanted = [0.0; 3];
        if left > 0.0 {
            // The slowest axis on this way says how fast.
            let fastest = self
                .speed
                .iter()
                .zip(way)
                .filter(|(_, way)| *way != 0.0)
                .map(|(speed, way)| speed * left / way.abs())
                .fold(limit, f64::min);
            let braking = (2.0 * PLANNED * self.acceleration * left).sqrt();
            let speed = fastest.min(braking).min(left / STEP);
            wanted = way.map(|way| way / left * speed);
        }
        let change: Vector = std::array::from_fn(|i| wanted[i] - self.velocity[i]);
        let most = self.acceleration * STEP;
        let share = (most / length(change).max(1e-300)).min(1.0);
        self.velocity = std::array::from_fn(|i| self.velocity[i] + share * change[i]);
        let stepped = self.velocity.map(|velocity| velocity * STEP);
        let gone: f64 = stepped.iter().zip(way).map(|(step, way)| step * way).sum();
        let slow = length(self.velocity) <= 3.0 * most;
        let Some(to) = to else {
            self.told = std::array::from_fn(|i| self.told[i] + stepped[i]);
            return length(self.velocity) == 0.0;
        };
        if left == 0.0 && slow || left > 0.0 && slow && gone >= left * left * (1.0 - 1e-9) {
            (self.told, self.velocity) = (to, [0.0; 3]);
            return true;
        }
        self.told = std::array::from_fn(|i| self.told[i] + stepped[i]);
        false
    }
}

fn ended<T>(glide: &Glide<T>, since: f64) -> bool {
    since >= glide.within
}

/// By how much its middle follows, and its radius is wider.
fn followed(law: &Dither, lead: Option<Pose>) -> ([f64; 2], f64) {
    let Some((at, lead)) = lead.zip(law.lead) else {
        return ([0.0; 2], 1.0);
    };
    let times = law.widens.map_or(1.0, |widens| widens.times(&at));
    (lead.by(&at), times)
}

/// Where a scan is after so many seconds, and whether it is over.
fn along(knots: &[Knot], since: f64, now: Vector) -> (Vector, bool) {
    let place = |knot: &Knot| [knot.at.x(), knot.at.y(), knot.at.z()];
    let next = knots.partition_point(|knot| knot.time <= since);
    let Some(to) = knots.get(next) else {
        return (knots.last().map_or(now, place), true);
    };
    let Some(from) = next.checked_sub(1).map(|i| &knots[i]) else {
        // Before the first knot it goes there evenly from where it is.
        let left = (to.time - since).max(0.0);
        let share = STEP / (left + STEP);
        let to = place(to);
        return (
            std::array::from_fn(|i| now[i] + (to[i] - now[i]) * share),
            false,
        );
    };
    let share = (since - from.time) / (to.time - from.time);
    let (a, b) = (place(from), place(to));
    (std::array::from_fn(|i| a[i] + (b[i] - a[i]) * share), false)
}

/// An axis with a screw: what it makes of where it is told to be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Screw {
    /// Where backlash lets it stand, metres.
    carried: f64,
    wander: f64,
    phase: f64,
}

impl Screw {
    pub(super) fn new(plant: &CoarsePlant, phase: f64, rng: &mut Pcg64Mcg) -> Self {
        Self {
            carried: 0.0,
            wander: plant.repeatability * normal(rng),
            phase,
        }
    }

    /// Where it brings its stage when it is told so; `zero` is where its error counts from.
    pub(super) fn step(
        &mut self,
        plant: &CoarsePlant,
        told: f64,
        zero: f64,
        rng: &mut Pcg64Mcg,
    ) -> f64 {
        // From below it stands where it is told to; turned back it stays until the play is used up.
        let carried = self.carried.clamp(told, told + plant.backlash);
        let moved = (carried - self.carried).abs();
        if moved > 0.0 {
            self.carried = carried;
            let decay = (-moved / plant.correlation).exp();
            let kick = plant.repeatability * (1.0 - decay * decay).sqrt();
            self.wander = decay * self.wander + kick * normal(rng);
        }
        let error = |at: f64| plant.screw_error * (TAU * at / plant.screw + self.phase).sin();
        self.carried + self.wander + error(self.carried) - error(zero)
    }
}

/// An axis in a closed loop of the second order.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClosedLoop {
    /// How what is wrong and its speed go over into those of the next step.
    advance: [[f64; 2]; 2],
    /// Of what is told before each step, so that the loop shakes as much as it does.
    shake: f64,
    before: f64,
    at: f64,
    velocity: f64,
    creep: f64,
    seen: f64,
}

impl ClosedLoop {
    pub(super) fn new(plant: &FinePlant, factors: [f64; 2]) -> Self {
        let w = TAU * plant.bandwidth * factors[0];
        let damping = (plant.damping * factors[1]).min(0.99);
        let rest = w * (1.0 - damping * damping).sqrt();
        let (sin, cos) = (rest * STEP).sin_cos();
        let (decay, a) = ((-damping * w * STEP).exp(), damping * w);
        let s = sin / rest;
        Self {
            advance: [
                [decay * (cos + a * s), decay * s],
                [-decay * w * w * s, decay * (cos - a * s)],
            ],
            // White noise of one through the loop leaves a variance of w h / (4 damping).
            shake: plant.jitter * (4.0 * damping / (w * STEP)).sqrt(),
            before: 0.0,
            at: 0.0,
            velocity: 0.0,
            creep: 0.0,
            seen: 0.0,
        }
    }

    /// Where it brings its stage when it is told so, and what its sensor says.
    pub(super) fn step(
        &mut self,
        plant: &FinePlant,
        told: f64,
        end: f64,
        rng: &mut Pcg64Mcg,
    ) -> (f64, f64) {
        // What is told moves evenly within a step: its middle stands for it.
        let reference = 0.5 * (told + self.before) + self.shake * normal(rng);
        self.before = told;
        let (wrong, velocity) = (self.at - reference, self.velocity);
        let [[a, b], [c, d]] = self.advance;
        self.at = reference + a * wrong + b * velocity;
        self.velocity = c * wrong + d * velocity;
        // A piezo has an end.
        if self.at.abs() > end {
            self.at = self.at.clamp(-end, end);
            self.velocity = 0.0;
        }
        self.creep += (plant.creep * self.at - self.creep) * STEP / plant.creep_time;
        self.seen += (self.at - self.seen) * STEP / (plant.sensor_lag + STEP);
        (self.at + self.creep, self.seen + plant.sensor * normal(rng))
    }
}
