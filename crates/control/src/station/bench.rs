//! A station as a bench: it plays laws where its loops are closed, in every cycle.

use super::Station;
use crate::outcome::Outcome;
use pigtail_hal::bench::{
    AxisCaps, Caps, ChannelCaps, Dither, Estimate, Event, Group, GroupCaps, Law, Light, Limits,
    Pose, Refused, Request, Stage, Ticket,
};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Bench, Channel, Fault, FiberHandling, Side, Spec};
use pigtail_model::frames::{Displacement, Macro, Point};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// From when a micro is told to be somewhere until the photodiode's sample of it, seconds, and how well that is known: the
/// printed machine's, with a micro of 200 Hz and a photodiode of 1 kHz.
const LAG: (f64, f64) = (1.2e-3, 0.4e-3);

/// What a station plays as a bench.
#[derive(Debug, Clone)]
pub(super) struct Playing {
    caps: Caps,
    /// The last ticket that was given.
    last: u64,
    /// Circles of the micros.
    pub(super) circles: [Option<Circle>; SIDES],
    /// Lines of the macros.
    lines: [Option<Ticket>; SIDES],
    /// What is asked for, and when it will be done, seconds.
    requests: Vec<(Ticket, f64)>,
    /// What has happened and nobody was told.
    events: VecDeque<Event>,
}

impl Playing {
    pub(super) fn new(spec: &Spec, settling: f64) -> Self {
        Self {
            caps: caps(spec, settling),
            last: 0,
            circles: [None; SIDES],
            lines: [None; SIDES],
            requests: Vec::new(),
            events: VecDeque::new(),
        }
    }

    fn ticket(&mut self) -> Ticket {
        self.last += 1;
        Ticket(self.last)
    }
}

/// The macro of a side, and its micro.
pub(crate) const fn coarse(side: Side) -> Group {
    Group(2 * side.index())
}

/// The micro of a side.
pub(crate) const fn fine(side: Side) -> Group {
    Group(2 * side.index() + 1)
}

/// The side and the stage of a group.
fn of(group: Group) -> Result<(Side, Stage), Refused> {
    let stage = [Stage::Coarse, Stage::Fine][group.0 % 2];
    let side = Side::ALL.get(group.0 / 2).copied();
    side.map(|side| (side, stage)).ok_or(Refused::Unknown {
        what: "group",
        index: group.0,
        count: 2 * SIDES,
    })
}

fn side_of(arm: usize) -> Result<Side, Refused> {
    Side::ALL.get(arm).copied().ok_or(Refused::Unknown {
        what: "arm",
        index: arm,
        count: SIDES,
    })
}

/// What a datasheet says of a station over it.
fn caps(spec: &Spec, settling: f64) -> Caps {
    let axis = |reach: f64, resolution: f64, speed: f64| {
        Some(AxisCaps {
            range: (-reach, reach),
            resolution,
            repeatability: resolution,
            backlash: 0.0,
            speed,
        })
    };
    let across = axis(0.5 * spec.five_bar.workspace, 1e-6, spec.five_bar.speed);
    let along = axis(0.5 * spec.z_stage.travel, 1e-6, spec.z_stage.speed);
    let micro = axis(0.5 * spec.micro.range, spec.micro.resolution, f64::INFINITY);
    let group = |side: Side, stage| {
        let (name, axes, bandwidth) = match stage {
            Stage::Coarse => ("coarse", [across, across, along, None, None, None], 0.0),
            // How fast it may be shaken no datasheet says: that is the recipe's.
            Stage::Fine => (
                "fine",
                [micro, micro, None, None, None, None],
                f64::INFINITY,
            ),
        };
        GroupCaps {
            name: format!("{}.{name}", side.name()),
            arm: side.index(),
            stage,
            axes,
            settling,
            bandwidth,
            lag: LAG,
            bends: true,
        }
    };
    Caps {
        name: spec.name.clone(),
        arms: Side::ALL.map(|side| side.name().to_owned()).to_vec(),
        groups: Side::ALL
            .iter()
            .flat_map(|side| [group(*side, Stage::Coarse), group(*side, Stage::Fine)])
            .collect(),
        channels: Channel::ALL
            .iter()
            .map(|channel| ChannelCaps {
                name: channel.name().to_owned(),
                rate: spec.photodiode.rate,
                resolution: spec.photodiode.step(),
                full_scale: spec.photodiode.range,
            })
            .collect(),
        bond: spec.bond.time,
    }
}

/// A micro that plays a [`Dither`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Circle {
    law: Dither,
    ticket: Ticket,
    /// Its middle beside what leads it, and its radius beside what widens it, when the law began; metres.
    from: (Displacement, f64),
    /// When that was, seconds.
    since: f64,
    /// Angle, radians.
    angle: f64,
}

impl Circle {
    /// Its middle and its radius at a time, where the group that leads it is at a pose.
    fn middle(&self, time: f64, leader: &Pose) -> (Displacement, f64) {
        let (law, since) = (&self.law, time - self.since);
        let [x, y] = law.centre.to;
        let (at, radius) = self.from;
        let at = at + (Displacement::new(x, y) - at) * law.centre.share(since);
        let radius = radius + (law.radius.to - radius) * law.radius.share(since);
        let [x, y] = law.lead.map_or([0.0; 2], |lead| lead.by(leader));
        let times = law.widens.map_or(1.0, |widens| widens.times(leader));
        (at + Displacement::new(x, y), radius * times)
    }
}

impl Station<'_> {
    /// Where the group that leads a dither is.
    fn leader(&self, law: &Dither) -> Pose {
        let side = law
            .lead
            .and_then(|lead| of(lead.group).ok())
            .map(|(side, _)| side);
        side.map_or(Pose::ZERO, |side| pose_of(self.endpoint(side)))
    }

    /// Sends micros that play circles to where these are at a time, the end of the cycle.
    pub(super) fn play_circles(&mut self, time: f64) {
        let period = self.spec().period();
        for side in Side::ALL {
            let Some(mut circle) = self.playing.circles[side.index()] else {
                continue;
            };
            let (middle, radius) = circle.middle(time, &self.leader(&circle.law));
            circle.angle = (circle.angle + TAU * circle.law.rate * period) % TAU;
            let arm = &mut self.arms[side.index()];
            arm.micro = middle + Displacement::polar(radius, circle.angle);
            arm.micro_volts = None;
            self.playing.circles[side.index()] = Some(circle);
        }
    }

    fn circle(&mut self, side: Side, law: Dither, ticket: Ticket) {
        let now = self.time();
        let before = self.playing.circles[side.index()];
        let (at, radius, angle) = match &before {
            None => (self.micro(side), 0.0, 0.0),
            Some(circle) => {
                let (at, radius) = circle.middle(now, &self.leader(&circle.law));
                (at, radius, circle.angle)
            }
        };
        let leader = self.leader(&law);
        let [x, y] = law.lead.map_or([0.0; 2], |lead| lead.by(&leader));
        let times = law.widens.map_or(1.0, |widens| widens.times(&leader));
        self.playing.circles[side.index()] = Some(Circle {
            law,
            ticket,
            from: (at - Displacement::new(x, y), radius / times),
            since: now,
            angle,
        });
    }

    /// Begins a law, or goes on with it, as a ticket.
    fn begin(&mut self, group: Group, law: Law, ticket: Ticket) -> Result<(), Refused> {
        let (side, stage) = of(group)?;
        let refuse = |station: &Self, law: &Law, why: String| Refused::Law {
            group: station.playing.caps.groups[group.0].name.clone(),
            law: law.name(),
            why,
        };
        match (stage, law) {
            (Stage::Coarse, Law::Line { to, limits }) => {
                let [x, y, z, turned @ ..] = to.0;
                if !to.is_finite() || turned != [0.0; 3] {
                    let law = Law::Line { to, limits };
                    let why = "it moves along x, y and z, by numbers".to_owned();
                    return Err(refuse(self, &law, why));
                }
                self.start_line(side, Point::new(x, y, z), limits.speed)
                    .map_err(|why| {
                        let law = Law::Line { to, limits };
                        match why {
                            Outcome::Refused { why, .. } => refuse(self, &law, why.to_string()),
                            why => refuse(self, &law, why.to_string()),
                        }
                    })?;
                self.playing.lines[side.index()] = Some(ticket);
                Ok(())
            }
            (Stage::Coarse, Law::Brake) => {
                self.brake(side);
                Ok(())
            }
            (Stage::Fine, Law::Dither(law)) => {
                let numbers = [
                    law.radius.to,
                    law.radius.within,
                    law.rate,
                    law.centre.within,
                ];
                let sound = numbers.iter().all(|v| v.is_finite() && *v >= 0.0)
                    && law.lead.is_none_or(|lead| of(lead.group).is_ok());
                let [x, y] = law.centre.to;
                let lead = law
                    .lead
                    .map_or([0.0; 2], |lead| lead.by(&self.leader(&law)));
                if !sound || !self.reaches(group, &Pose::at(x + lead[0], y + lead[1], 0.0)) {
                    let why = "its middle is out of reach, or it is not made of numbers".to_owned();
                    return Err(refuse(self, &Law::Dither(law), why));
                }
                self.circle(side, law, ticket);
                Ok(())
            }
            (Stage::Fine, Law::Line { to, .. }) => {
                if !self.reaches(group, &to) {
                    let limits = Limits::default();
                    let why = "it does not reach that far".to_owned();
                    return Err(refuse(self, &Law::Line { to, limits }, why));
                }
                self.move_micro(side, Displacement::new(to.x(), to.y()));
                let done = self.time() + self.micro_settling();
                self.playing.requests.push((ticket, done));
                Ok(())
            }
            (Stage::Fine, Law::Brake) => {
                self.move_micro(side, self.micro(side));
                Ok(())
            }
            (_, law) => Err(refuse(self, &law, "this group has no such law".to_owned())),
        }
    }

    /// What has happened in this cycle.
    fn gather(&mut self) {
        let now = self.time();
        for side in Side::ALL {
            if !self.moving(side)
                && let Some(ticket) = self.playing.lines[side.index()].take()
            {
                self.playing.events.push_back(Event::Done(ticket));
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
        if let Some(light) = self.measurement.light {
            let volts = Channel::ALL
                .iter()
                .map(|c| self.light(*c).unwrap_or(f64::NAN));
            let light = Light {
                time: light.time,
                volts: volts.collect(),
            };
            self.playing.events.push_back(Event::Light(light));
        }
    }
}

fn pose_of(p: Point<Macro>) -> Pose {
    Pose::at(p.x, p.y, p.z)
}

impl Bench for Station<'_> {
    fn caps(&self) -> &Caps {
        &self.playing.caps
    }

    fn now(&self) -> f64 {
        self.time()
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        let ticket = self.playing.ticket();
        self.begin(group, law, ticket)?;
        Ok(ticket)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        let circles = self.playing.circles.iter();
        let circling = circles
            .enumerate()
            .find(|(_, circle)| circle.is_some_and(|circle| circle.ticket == ticket))
            .map(|(i, _)| fine(Side::ALL[i]));
        let lines = self.playing.lines.iter();
        let moving = lines
            .enumerate()
            .find(|(_, line)| **line == Some(ticket))
            .map(|(i, _)| coarse(Side::ALL[i]));
        let group = circling.or(moving).ok_or(Refused::Ticket(ticket.0))?;
        self.begin(group, law, ticket)?;
        Ok(self.time())
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        let handling = match what {
            Request::Laser(on) => {
                self.laser(on);
                None
            }
            Request::Load { arm, port } => {
                let port = u8::try_from(port).map_err(|_| Refused::Unknown {
                    what: "port",
                    index: port,
                    count: usize::from(u8::MAX),
                })?;
                Some((side_of(arm)?, FiberHandling::Load(port)))
            }
            Request::Attach { arm } => Some((side_of(arm)?, FiberHandling::Attach)),
            Request::Unload { arm } => Some((side_of(arm)?, FiberHandling::Unload)),
        };
        let mut by = self.time() + self.spec().period();
        if let Some((side, handling)) = handling {
            self.take_up(side, handling);
            if handling == FiberHandling::Attach {
                by += self.spec().bond.time;
            }
        }
        let ticket = self.playing.ticket();
        self.playing
            .requests
            .push((ticket, by - 0.5 * self.spec().period()));
        Ok(ticket)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        let half = 0.5 * self.spec().period();
        loop {
            if let Some(event) = self.playing.events.pop_front() {
                return Ok(event);
            }
            if self.time() + half > by {
                return Ok(Event::Time);
            }
            self.cycle()?;
            self.gather();
        }
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        let (side, stage) = of(group).ok()?;
        let ago = ((self.time() - at) * self.spec().servo.rate).round();
        let (outputs, micro) = self.tips.stand(side, ago.max(0.0) as usize)?;
        Some(match stage {
            Stage::Fine => Estimate {
                pose: Pose::at(micro.x, micro.y, 0.0),
                measured: false,
            },
            Stage::Coarse => Estimate {
                pose: pose_of(self.kinematics(side).endpoint_at(outputs).ok()?),
                measured: true,
            },
        })
    }

    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        match of(group) {
            Ok((side, Stage::Fine)) => self
                .kinematics(side)
                .micro_reaches(Displacement::new(pose.x(), pose.y())),
            Ok((side, Stage::Coarse)) => {
                let at = Point::new(pose.x(), pose.y(), pose.z());
                self.kinematics(side).contains(at)
            }
            Err(_) => false,
        }
    }

    fn stop(&mut self) {
        Station::stop(self);
    }
}
