//! A station whose manipulators work side by side: each goes through steps of its own while anybody lets time pass.
//!
//! Space and the needle are reserved: a line begins only where the box that the holder sweeps is clear of what the other one
//! has reserved, and one tip at a time is at the needle.

use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::reactor::Watched;
use pigtail_control::station::{Observer, Station, VoltageMachine, coarse, fine};
use pigtail_hal::bench::{
    Caps, Estimate, Event, Group, Law, Limits, Pose, Refused, Request, Ticket,
};
use pigtail_hal::spec::{HolderSpec, SIDES};
use pigtail_hal::{Bench, Fault, FiberHandling, Side};
use pigtail_model::frames::{Chip, Point};
use serde::Serialize;
use std::collections::VecDeque;

/// What a manipulator did, for how long.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bar {
    /// Which.
    pub side: &'static str,
    /// Serial number of the device.
    pub device: String,
    /// The port whose fiber it was about.
    pub port: String,
    /// What.
    pub what: &'static str,
    /// Whether it held a fiber under the lamp, or still for one that was.
    pub held: bool,
    /// When it began, seconds of machine time.
    pub start: f64,
    /// When it was over.
    pub end: f64,
}

/// Something that a manipulator is to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Its tip goes straight to a place, chip's frame by design.
    Go(Point<Chip>),
    /// It goes straight back along z until it is this far along the chip's z.
    Back(f64),
    /// Its micro goes to the middle.
    Centre,
    /// A step of the handling, tried so many times, but not once more when all of it has taken longer, seconds.
    Handle(FiberHandling, u32, f64),
    /// Seconds.
    Wait(f64),
    /// It takes the needle for itself, or gives it back.
    Needle(bool),
    /// What follows is this, in the plan.
    Named(&'static str),
}

#[derive(Debug, Clone, Copy)]
enum Doing {
    Ticket(Ticket, Step),
    Until(f64),
    /// For the needle, or for space.
    Room(Step),
}

#[derive(Debug, Default)]
struct Runner {
    steps: VecDeque<Step>,
    doing: Option<Doing>,
    failed: Option<String>,
    bar: Option<(&'static str, f64)>,
    /// When a step of the handling has begun, seconds.
    since: f64,
    /// Serial number and port of what it works on.
    on: (String, String),
}

/// A box in the chip's frame: lowest and highest corner.
pub type Box3 = [[f64; 3]; 2];

/// How far holders keep from each other, metres.
pub const APART: f64 = 1e-3;

/// Whether boxes come nearer to each other than [`APART`].
pub fn meet(a: &Box3, b: &Box3) -> bool {
    (0..3).all(|i| a[0][i] - APART < b[1][i] && b[0][i] - APART < a[1][i])
}

/// What a holder sweeps on a line of its tip.
pub fn swept(side: Side, holder: &HolderSpec, from: Point<Chip>, to: Point<Chip>) -> Box3 {
    let ends = [[from.x, from.y, from.z], [to.x, to.y, to.z]];
    let least = |i: usize| ends[0][i].min(ends[1][i]);
    let most = |i: usize| ends[0][i].max(ends[1][i]);
    let (w, h) = (0.5 * holder.width, 0.5 * holder.height);
    // A holder is behind its tip, however long.
    let (near, far) = match side {
        Side::Left => (f64::NEG_INFINITY, most(2)),
        Side::Right => (least(2), f64::INFINITY),
    };
    [
        [least(0) - w, least(1) - h, near],
        [most(0) + w, most(1) + h, far],
    ]
}

/// A station with two manipulators at work.
pub struct Cell<'s, 'm> {
    station: &'s mut Station<'m>,
    runners: [Runner; SIDES],
    needle: Option<Side>,
    reserved: [Option<Box3>; SIDES],
    /// What was done so far.
    pub bars: Vec<Bar>,
}

/// No step takes longer, seconds.
const LONGEST: f64 = 120.0;

impl<'s, 'm> Cell<'s, 'm> {
    /// Around a station.
    pub fn new(station: &'s mut Station<'m>) -> Self {
        Self {
            station,
            runners: Default::default(),
            needle: None,
            reserved: [None; SIDES],
            bars: Vec::new(),
        }
    }

    /// The station below.
    pub fn station(&self) -> &Station<'m> {
        self.station
    }

    /// Reserves all that is beyond a plane across the chip's z for a manipulator that others move, until it is given back:
    /// that of the facet on its side. Whether it could: not where the other one goes through it, or stands in it.
    pub fn reserve(&mut self, side: Side, facet: f64) -> bool {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        let [low, high] = match side {
            Side::Left => [f64::NEG_INFINITY, facet],
            Side::Right => [facet, f64::INFINITY],
        };
        let beyond = [[all[0], all[0], low], [all[1], all[1], high]];
        let other = [Side::Right, Side::Left][side.index()];
        let spec = self.station.spec().holder;
        let stands = swept(other, &spec, self.tip(other), self.tip(other));
        if meet(&beyond, &self.reserved[other.index()].unwrap_or(stands)) {
            return false;
        }
        self.reserved[side.index()] = Some(beyond);
        true
    }

    /// Gives back what was reserved.
    pub fn give_back(&mut self, side: Side) {
        self.reserved[side.index()] = None;
    }

    /// Whether a manipulator has steps before it.
    pub fn is_busy(&self, side: Side) -> bool {
        let runner = &self.runners[side.index()];
        runner.doing.is_some() || !runner.steps.is_empty()
    }

    /// Whether a manipulator is back along the chip's z as far as this, and stays there whatever it has before it.
    pub fn is_clear(&self, side: Side, z: f64) -> bool {
        /// What is no way, metres.
        const NEAR: f64 = 1e-6;
        let beyond = |at: f64| match side {
            Side::Left => at <= z + NEAR,
            Side::Right => at >= z - NEAR,
        };
        let runner = &self.runners[side.index()];
        let now = match runner.doing {
            Some(Doing::Ticket(_, step) | Doing::Room(step)) => Some(step),
            Some(Doing::Until(_)) | None => None,
        };
        let stays = |step: &Step| match step {
            Step::Go(to) => beyond(to.z),
            _ => true,
        };
        beyond(self.tip(side).z) && runner.steps.iter().chain(&now).all(stays)
    }

    /// Gives a manipulator steps to go through, about a port of a device. They begin at once.
    pub fn begin(&mut self, side: Side, on: (&str, &str), steps: impl IntoIterator<Item = Step>) {
        let runner = &mut self.runners[side.index()];
        runner.on = (on.0.to_owned(), on.1.to_owned());
        runner.failed = None;
        runner.steps.extend(steps);
        self.advance(side);
    }

    /// Lets time pass until a manipulator has gone through its steps.
    ///
    /// # Errors
    ///
    /// The machine's fault; [`Outcome::BenchFailed`] where a step has failed, or takes too long.
    pub fn finish(&mut self, side: Side) -> Result<(), Halt> {
        let mut until = self.now() + LONGEST;
        let mut left = usize::MAX;
        while self.is_busy(side) {
            let now = self.runners[side.index()].steps.len();
            if now != left {
                (left, until) = (now, self.now() + LONGEST);
            }
            if self.now() >= until {
                let why = format!("{} has not come on for {LONGEST} s", side.name());
                self.give_up(side, why);
                break;
            }
            self.next(self.station.time() + 0.25)?;
        }
        match self.runners[side.index()].failed.take() {
            Some(why) => Err(Outcome::BenchFailed { why }.into()),
            None => Ok(()),
        }
    }

    /// Goes through steps to their end.
    ///
    /// # Errors
    ///
    /// As [`Self::finish`].
    pub fn go(
        &mut self,
        side: Side,
        on: (&str, &str),
        steps: impl IntoIterator<Item = Step>,
    ) -> Result<(), Halt> {
        self.begin(side, on, steps);
        self.finish(side)
    }

    /// Lets so much time pass.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn wait_until(&mut self, time: f64) -> Result<(), Halt> {
        while self.now() + 1e-9 < time {
            if self.next(time)? == Event::Time {
                break;
            }
        }
        Ok(())
    }

    /// Notes what a manipulator has done since a time.
    pub fn note(
        &mut self,
        side: Side,
        on: (&str, &str),
        what: &'static str,
        held: bool,
        start: f64,
    ) {
        let bar = Bar {
            side: side.name(),
            device: on.0.to_owned(),
            port: on.1.to_owned(),
            what,
            held,
            start,
            end: self.now(),
        };
        if bar.end > bar.start {
            self.bars.push(bar);
        }
    }

    fn end_bar(&mut self, side: Side) {
        let runner = &mut self.runners[side.index()];
        if let Some((what, start)) = runner.bar.take() {
            let (device, port) = runner.on.clone();
            self.note(side, (&device, &port), what, false, start);
        }
    }

    /// Where a tip is by design of its holder, chip's frame.
    fn tip(&self, side: Side) -> Point<Chip> {
        let k = self.station.kinematics(side);
        k.chip_from_macro(self.station.wanted(side))
    }

    fn line(&mut self, side: Side, to: Point<Chip>) -> Result<Doing, String> {
        let spec = self.station.spec().holder;
        let sweeps = swept(side, &spec, self.tip(side), to);
        let other = match side {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        };
        let stands = swept(other, &spec, self.tip(other), self.tip(other));
        let reserved = self.reserved[other.index()].unwrap_or(stands);
        if meet(&sweeps, &reserved) {
            return Ok(Doing::Room(Step::Go(to)));
        }
        let at = self.station.kinematics(side).macro_from_chip(to);
        let law = Law::Line {
            to: Pose::at(at.x, at.y, at.z),
            limits: Limits::default(),
        };
        let ticket = self
            .station
            .play(coarse(side), law)
            .map_err(|why| why.to_string())?;
        self.reserved[side.index()] = Some(sweeps);
        Ok(Doing::Ticket(ticket, Step::Go(to)))
    }

    /// Begins the next step of a manipulator.
    fn advance(&mut self, side: Side) {
        let i = side.index();
        while self.runners[i].doing.is_none() {
            let Some(step) = self.runners[i].steps.pop_front() else {
                self.end_bar(side);
                return;
            };
            match self.start(side, step) {
                Ok(doing) => self.runners[i].doing = doing,
                Err(why) => self.give_up(side, why),
            }
        }
    }

    fn give_up(&mut self, side: Side, why: String) {
        let runner = &mut self.runners[side.index()];
        runner.steps.clear();
        runner.doing = None;
        runner.failed = Some(why);
        if self.needle == Some(side) {
            self.needle = None;
        }
        self.end_bar(side);
    }

    fn start(&mut self, side: Side, step: Step) -> Result<Option<Doing>, String> {
        let now = self.station.time();
        Ok(match step {
            Step::Named(what) => {
                self.end_bar(side);
                self.runners[side.index()].bar = Some((what, now));
                None
            }
            Step::Wait(seconds) => Some(Doing::Until(now + seconds)),
            Step::Needle(true) => match self.needle {
                Some(other) if other != side => Some(Doing::Room(step)),
                _ => {
                    self.needle = Some(side);
                    None
                }
            },
            Step::Needle(false) => {
                self.needle = None;
                None
            }
            Step::Go(to) => Some(self.line(side, to)?),
            Step::Back(z) => {
                let here = self.tip(side);
                let back = match side {
                    Side::Left => here.z.min(z),
                    Side::Right => here.z.max(z),
                };
                Some(self.line(side, Point::new(here.x, here.y, back))?)
            }
            Step::Centre => {
                let law = Law::Line {
                    to: Pose::ZERO,
                    limits: Limits { speed: Some(1e-3) },
                };
                let ticket = self.station.play(fine(side), law);
                Some(Doing::Ticket(ticket.map_err(|why| why.to_string())?, step))
            }
            Step::Handle(what, ..) => {
                let request = Request::Handle {
                    arm: side.index(),
                    what,
                };
                let ticket = self.station.request(request);
                self.runners[side.index()].since = now;
                Some(Doing::Ticket(ticket.map_err(|why| why.to_string())?, step))
            }
        })
    }

    /// Takes an event of a manipulator's own steps.
    fn takes(&mut self, event: &Event) -> bool {
        let (of, failed) = match event {
            Event::Done(ticket) => (*ticket, None),
            Event::Failed(ticket, why) => (*ticket, Some(why.clone())),
            _ => return false,
        };
        for side in Side::ALL {
            let i = side.index();
            let Some(Doing::Ticket(ticket, step)) = self.runners[i].doing else {
                continue;
            };
            if ticket != of {
                continue;
            }
            self.runners[i].doing = None;
            if let Step::Go(_) = step {
                self.reserved[i] = None;
            }
            match (step, failed) {
                (_, None) => {}
                (Step::Handle(what, attempts, limit), Some(why)) if attempts > 1 => {
                    let left = limit - (self.station.time() - self.runners[i].since);
                    if left > 0.0 {
                        let again = Step::Handle(what, attempts - 1, left);
                        self.runners[i].steps.push_front(again);
                    } else {
                        let late = format!("{why}, and there is no time left to try it again");
                        self.give_up(side, late);
                    }
                }
                (_, Some(why)) => self.give_up(side, why),
            }
            self.advance(side);
            return true;
        }
        false
    }

    /// Steps that wait for time, the needle or space.
    fn look(&mut self) {
        let now = self.station.time();
        for side in Side::ALL {
            let i = side.index();
            match self.runners[i].doing {
                Some(Doing::Until(end)) if end <= now + 1e-9 => {
                    self.runners[i].doing = None;
                    self.advance(side);
                }
                Some(Doing::Room(step)) => {
                    self.runners[i].doing = None;
                    self.runners[i].steps.push_front(step);
                    self.advance(side);
                }
                _ => {}
            }
        }
    }

    /// When a step that waits has to be looked at.
    fn soonest(&self) -> f64 {
        let now = self.station.time();
        self.runners
            .iter()
            .map(|runner| match runner.doing {
                Some(Doing::Until(end)) => end,
                Some(Doing::Room(_)) => now + 0.01,
                _ => f64::INFINITY,
            })
            .fold(f64::INFINITY, f64::min)
    }
}

impl Bench for Cell<'_, '_> {
    fn caps(&self) -> &Caps {
        self.station.caps()
    }

    fn now(&self) -> f64 {
        self.station.time()
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        self.station.play(group, law)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        self.station.bend(ticket, law)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        self.station.request(what)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        loop {
            let soonest = self.soonest();
            let event = self.station.next(by.min(soonest))?;
            if self.takes(&event) {
                continue;
            }
            if event == Event::Time {
                self.look();
                if soonest < by {
                    continue;
                }
            }
            return Ok(event);
        }
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        self.station.pose(group, at)
    }

    fn reference(&self, group: Group) -> Option<Pose> {
        Bench::reference(self.station, group)
    }

    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        self.station.reaches(group, pose)
    }

    fn stop(&mut self) {
        Bench::stop(self.station);
    }
}

impl Watched for Cell<'_, '_> {
    fn observer(&mut self) -> &mut dyn Observer {
        Watched::observer(self.station)
    }

    fn note_reading(&mut self, time: f64) {
        Watched::note_reading(self.station, time);
    }

    fn voltage(&mut self) -> Option<&mut dyn VoltageMachine> {
        Watched::voltage(self.station)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_that_cross_meet_and_those_apart_do_not() {
        let holder = HolderSpec::default();
        let at = |x: f64, z: f64| Point::new(x, 0.0, z);
        let left = swept(Side::Left, &holder, at(0.0, -4e-3), at(0.0, 0.0));
        let far = swept(Side::Right, &holder, at(0.0, 24e-3), at(0.0, 20e-3));
        assert!(!meet(&left, &far));
        let through = swept(Side::Right, &holder, at(0.0, 24e-3), at(0.0, -1e-3));
        assert!(meet(&left, &through));
        let aside = swept(Side::Right, &holder, at(8e-3, 24e-3), at(8e-3, -1e-3));
        assert!(!meet(&left, &aside));
    }
}
