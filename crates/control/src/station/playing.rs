//! What the groups of a station play, from cycle to cycle.

use super::Station;
use super::bench::{of, pose_of};
use super::motion::Arrival;
use super::steady::Steady;
use crate::outcome::Outcome;
use crate::trajectory::Line;
use pigtail_hal::bench::{Caps, Dither, Event, Fix, Frame, Knot, Law, Light, Pose, Ticket, Tip};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Channel, FiberHandling, Side};
use pigtail_model::frames::{Displacement, Macro, Point};
use std::cell::Cell;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// What a station plays as a bench.
#[derive(Debug, Clone)]
pub(super) struct Playing {
    pub(super) caps: Caps,
    /// The last ticket that was given.
    last: u64,
    /// Of the micros.
    pub(super) fine: [Option<Fine>; SIDES],
    /// Of the macros.
    pub(super) coarse: [Option<Coarse>; SIDES],
    /// What is asked for, and when it will be done, seconds.
    pub(super) requests: Vec<(Ticket, f64)>,
    /// Steps of the fiber handling that take their time.
    pub(super) handling: [Option<(Ticket, FiberHandling)>; SIDES],
    /// What has happened and nobody was told.
    pub(super) events: VecDeque<Event>,
}

impl Playing {
    pub(super) fn new(caps: Caps) -> Self {
        Self {
            caps,
            last: 0,
            fine: Default::default(),
            coarse: Default::default(),
            requests: Vec::new(),
            handling: [None; SIDES],
            events: VecDeque::new(),
        }
    }

    pub(super) fn ticket(&mut self) -> Ticket {
        self.last += 1;
        Ticket(self.last)
    }

    /// Nothing more of it.
    pub(super) fn end(&mut self) {
        self.fine = Default::default();
        self.coarse = Default::default();
        self.requests.clear();
        self.handling = [None; SIDES];
    }
}

/// A micro that plays a law.
#[derive(Debug, Clone)]
pub(super) struct Fine {
    pub(super) ticket: Ticket,
    way: Way,
}

#[derive(Debug, Clone)]
enum Way {
    Circle(Box<Circle>),
    Scan(Scan),
    /// To rest where it is, until a time, seconds.
    Rest(f64),
}

/// Straight from knot to knot.
#[derive(Debug, Clone)]
struct Scan {
    knots: Vec<Knot>,
    /// When it began, seconds, and where.
    since: f64,
    from: Displacement,
    /// Knots that lie behind it: from one cycle to the next there is hardly one more.
    behind: Cell<usize>,
}

impl Scan {
    fn new(knots: Vec<Knot>, since: f64, from: Displacement) -> Self {
        Self {
            knots,
            since,
            from,
            behind: Cell::new(0),
        }
    }

    /// Where it is at a time, none before one that was asked for, and whether that is its end.
    fn at(&self, time: f64) -> (Displacement, bool) {
        let place = |knot: &Knot| Displacement::new(knot.at.x(), knot.at.y());
        let since = time - self.since;
        let mut next = self.behind.get();
        while self.knots.get(next).is_some_and(|knot| knot.time <= since) {
            next += 1;
        }
        self.behind.set(next);
        let (before, from) = match next.checked_sub(1).map(|before| &self.knots[before]) {
            Some(knot) => (knot.time, place(knot)),
            None => (0.0, self.from),
        };
        match self.knots.get(next) {
            None => (from, true),
            Some(to) => {
                let share = (since - before) / (to.time - before);
                (from + (place(to) - from) * share, false)
            }
        }
    }
}

/// A micro that plays a [`Dither`].
#[derive(Debug, Clone, Copy)]
struct Circle {
    law: Dither,
    /// Its middle beside what leads it, and its radius beside what widens it, when the law began; metres.
    from: (Displacement, f64),
    /// When that was, seconds.
    since: f64,
    /// Angle, radians.
    angle: f64,
    /// What its middle follows of the group that leads it, in x, y and z.
    leader: [Steady; 3],
}

impl Circle {
    /// What its middle follows where the group that leads it is at a pose.
    fn steadied(&self, leader: &Pose) -> Pose {
        let [x, y, z] = [0, 1, 2].map(|i| self.leader[i].at(leader.0[i]));
        Pose::at(x, y, z)
    }

    /// Its middle and its radius at a time, where the group that leads it is at a pose.
    fn middle(&self, time: f64, leader: &Pose) -> (Displacement, f64) {
        let (law, since) = (&self.law, time - self.since);
        let [x, y] = law.centre.to;
        let (at, radius) = self.from;
        let at = at + (Displacement::new(x, y) - at) * law.centre.share(since);
        let radius = radius + (law.radius.to - radius) * law.radius.share(since);
        let leader = self.steadied(leader);
        let [x, y] = law.lead.map_or([0.0; 2], |lead| lead.by(&leader));
        let times = law.widens.map_or(1.0, |widens| widens.times(&leader));
        (at + Displacement::new(x, y), radius * times)
    }

    /// Whether nothing of it is left at a time.
    fn is_over(&self, time: f64) -> bool {
        let (law, since) = (&self.law, time - self.since);
        law.radius.to == 0.0 && since >= law.radius.within && since >= law.centre.within
    }
}

/// A macro that plays a law.
#[derive(Debug, Clone)]
pub(super) struct Coarse {
    pub(super) ticket: Ticket,
    /// Where it goes once it has slowed down, and how fast, m/s.
    then: Option<(Point<Macro>, Option<f64>)>,
    /// Whether it was said that it has been played to its end.
    played: bool,
    arrival: Arrival,
}

impl Station<'_> {
    /// Where the group that leads a dither is.
    pub(super) fn leader(&self, law: &Dither) -> Pose {
        let side = law
            .lead
            .and_then(|lead| of(lead.group).ok())
            .map(|(side, _)| side);
        side.map_or(Pose::ZERO, |side| pose_of(self.endpoint(side)))
    }

    /// Sends the micros that play laws to where these are at a time, the end of the cycle.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    pub(super) fn play_fine(&mut self, time: f64) {
        for side in Side::ALL {
            let leader = match &self.playing.fine[side.index()] {
                Some(Fine {
                    way: Way::Circle(circle),
                    ..
                }) => self.leader(&circle.law),
                _ => Pose::ZERO,
            };
            let (to, angle, over) = match &mut self.playing.fine[side.index()] {
                Some(Fine {
                    way: Way::Circle(circle),
                    ..
                }) => {
                    for (steady, place) in circle.leader.iter_mut().zip(leader.0) {
                        steady.follow(place, time);
                    }
                    let (middle, radius) = circle.middle(time, &leader);
                    let angle = circle.angle + TAU * circle.law.rate * self.period;
                    // A remainder is a call into the C library.
                    let angle = if (0.0..TAU).contains(&angle) {
                        angle
                    } else {
                        angle % TAU
                    };
                    let to = middle + Displacement::polar(radius, angle);
                    (to, Some(angle), circle.is_over(time))
                }
                Some(Fine {
                    way: Way::Scan(scan),
                    ..
                }) => {
                    let (to, over) = scan.at(time);
                    (to, None, over)
                }
                _ => continue,
            };
            let arm = &mut self.arms[side.index()];
            arm.micro = to;
            arm.micro_volts = None;
            let rest = time + self.micro_settling(side);
            if let Some(fine) = &mut self.playing.fine[side.index()] {
                if let (Way::Circle(circle), Some(angle)) = (&mut fine.way, angle) {
                    circle.angle = angle;
                }
                if over {
                    fine.way = Way::Rest(rest);
                }
            }
        }
    }

    /// A micro begins a law that its datasheet allows, or goes on with it, as a ticket.
    pub(super) fn begin_fine(&mut self, side: Side, law: Law, ticket: Ticket) {
        let now = self.time();
        let here = self.micro(side);
        let way = match law {
            Law::Dither(law) => Way::Circle(Box::new(self.circle(side, law))),
            Law::Scan(knots) => Way::Scan(Scan::new(knots, now, here)),
            Law::Line { to, limits } => {
                let place = Displacement::new(to.x(), to.y());
                // As fast as it can: at once.
                let time = limits.speed.map_or(0.0, |v| (place - here).norm() / v);
                let knots = vec![Knot { time, at: to }];
                Way::Scan(Scan::new(knots, now, here))
            }
            Law::Brake => Way::Rest(now + self.micro_settling(side)),
        };
        self.playing.fine[side.index()] = Some(Fine { ticket, way });
    }

    fn circle(&self, side: Side, law: Dither) -> Circle {
        let now = self.time();
        let here = self.leader(&law);
        let from_here = [0, 1, 2].map(|i| Steady::new(here.0[i]));
        let by = |law: &Dither| law.lead.map(|lead| lead.group);
        let (at, radius, angle, leader) = match &self.playing.fine[side.index()] {
            Some(Fine {
                way: Way::Circle(circle),
                ..
            }) => {
                let (at, radius) = circle.middle(now, &self.leader(&circle.law));
                // What has led it goes on to.
                let same = by(&circle.law) == by(&law);
                let leader = if same { circle.leader } else { from_here };
                (at, radius, circle.angle, leader)
            }
            _ => (self.micro(side), 0.0, 0.0, from_here),
        };
        let circle = Circle {
            law,
            from: (at, radius),
            since: now,
            angle,
            leader,
        };
        let leader = circle.steadied(&here);
        let [x, y] = law.lead.map_or([0.0; 2], |lead| lead.by(&leader));
        let times = law.widens.map_or(1.0, |widens| widens.times(&leader));
        Circle {
            from: (at - Displacement::new(x, y), radius / times),
            ..circle
        }
    }

    /// A macro begins a line, or goes over to it from the one that it is on, as a ticket.
    ///
    /// # Errors
    ///
    /// [`Outcome::Refused`] when it would break a limit; the motion goes on as it was.
    pub(super) fn begin_line(
        &mut self,
        side: Side,
        (to, speed): (Point<Macro>, Option<f64>),
        ticket: Ticket,
    ) -> Result<(), Outcome> {
        let then = if let Some(braked) = self.braked(side) {
            let line = Line::new(braked.at(braked.duration()), to);
            self.motion(side, line.into(), speed)?;
            self.brake(side);
            Some((to, speed))
        } else {
            self.start_line(side, to, speed)?;
            None
        };
        self.going(side, ticket, then);
        Ok(())
    }

    /// A macro slows down, as a ticket.
    pub(super) fn begin_brake(&mut self, side: Side, ticket: Ticket) {
        self.brake(side);
        self.going(side, ticket, None);
    }

    fn going(&mut self, side: Side, ticket: Ticket, then: Option<(Point<Macro>, Option<f64>)>) {
        self.playing.coarse[side.index()] = Some(Coarse {
            ticket,
            then,
            played: false,
            arrival: Arrival::default(),
        });
    }

    /// How a macro's law has come to its end in this cycle, and how its group has come to rest, if they have.
    fn coarse_ended(&mut self, side: Side) {
        if self.moving(side) {
            return;
        }
        let Some(mut coarse) = self.playing.coarse[side.index()].take() else {
            return;
        };
        let ticket = coarse.ticket;
        let failed = |why: &Outcome| Event::Failed(ticket, why.to_string());
        if let Some((to, speed)) = coarse.then.take() {
            if let Err(why) = self.start_line(side, to, speed) {
                self.playing.events.push_back(failed(&why));
                return;
            }
        } else {
            if !coarse.played {
                coarse.played = true;
                self.playing.events.push_back(Event::Played(ticket));
            }
            if coarse.arrival.step(self, side) {
                let ended = match self.arrived(side) {
                    Ok(()) => Event::Done(ticket),
                    Err(why) => failed(&why),
                };
                self.playing.events.push_back(ended);
                return;
            }
        }
        self.playing.coarse[side.index()] = Some(coarse);
    }

    /// What has happened in this cycle.
    pub(super) fn gather(&mut self) {
        let now = self.time();
        for side in Side::ALL {
            self.coarse_ended(side);
            let fine = &mut self.playing.fine[side.index()];
            if let Some(Fine {
                ticket,
                way: Way::Rest(by),
            }) = fine
                && *by <= now
            {
                self.playing.events.push_back(Event::Done(*ticket));
                *fine = None;
            }
        }
        let playing = &mut self.playing;
        playing.requests.retain(|(ticket, by)| {
            if *by > now {
                return true;
            }
            playing.events.push_back(Event::Done(*ticket));
            false
        });
        if let Some(frame) = &self.measurement.vision {
            let of_side = |side: &Side| Some((*side, Tip::Fiber, frame.fiber[side.index()]?));
            let sensing = (Side::Right, Tip::Sensing, frame.sensing);
            let seen = Side::ALL.iter().filter_map(of_side).chain([sensing]);
            let fixes = seen.map(|(side, tip, at)| Fix {
                arm: side.index(),
                tip,
                x: at.x,
                z: at.z,
                sigma: at.sigma,
            });
            let frame = Frame {
                time: frame.time,
                fixes: fixes.collect(),
            };
            self.playing.events.push_back(Event::Frame(frame));
        }
        if let Some(light) = self.measurement.light {
            let light = Light {
                time: light.time,
                volts: Channel::ALL.map(|c| light.volts[c.index()].0).to_vec(),
            };
            self.playing.events.push_back(Event::Light(light));
        }
    }
}
