//! A station as a bench: it plays laws where its loops are closed, in every cycle.

use super::arm::Known;
use super::past::Stand;
use super::{Observer, Station, VoltageMachine};
use crate::kinematics::Kinematics;
use crate::outcome::Outcome;
use crate::reactor::Watched;
use pigtail_hal::bench::{
    AxisCaps, Caps, ChannelCaps, Estimate, Event, Group, GroupCaps, Law, Pose, Refused, Request,
    Stage, Ticket,
};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Bench, Channel, Fault, FiberHandling, Side, Spec};
use pigtail_model::frames::{Displacement, Macro, Point};

/// A micro follows circles up to half of its lowest resonance, of which it takes two and a half periods to settle.
const FOLLOWS: f64 = 0.5 * 2.5;

/// The macro of a side, and its micro.
pub const fn coarse(side: Side) -> Group {
    Group(2 * side.index())
}

/// The micro of a side.
pub const fn fine(side: Side) -> Group {
    Group(2 * side.index() + 1)
}

/// The side and the stage of a group.
pub(super) fn of(group: Group) -> Result<(Side, Stage), Refused> {
    let stage = [Stage::Coarse, Stage::Fine][group.0 % 2];
    let side = Side::ALL.get(group.0 / 2).copied();
    side.map(|side| (side, stage)).ok_or(Refused::Unknown {
        what: "group",
        index: group.0,
        count: 2 * SIDES,
    })
}

pub(super) fn side_of(arm: usize) -> Result<Side, Refused> {
    Side::ALL.get(arm).copied().ok_or(Refused::Unknown {
        what: "arm",
        index: arm,
        count: SIDES,
    })
}

/// How a micro follows what it is told.
#[derive(Debug, Clone, Copy)]
pub(super) struct Follows {
    /// By when it has come to rest, seconds.
    pub(super) settling: f64,
    /// How many turns a second it follows, hertz, where that was measured.
    pub(super) bandwidth: Option<f64>,
    /// From when it is told to be somewhere until a photodiode's sample of it, and how well that is known, seconds.
    pub(super) lag: (f64, f64),
}

/// What a datasheet says of a station over it, and its calibration of how far its micros reach.
pub(super) fn caps(
    spec: &Spec,
    follows: [Follows; SIDES],
    kinematics: [&Kinematics; SIDES],
) -> Caps {
    let axis = |range: (f64, f64), resolution: f64, speed: f64| {
        Some(AxisCaps {
            range,
            resolution,
            repeatability: resolution,
            backlash: 0.0,
            speed,
        })
    };
    let group = |side: Side, stage| {
        let Follows {
            settling,
            bandwidth: followed,
            lag,
        } = follows[side.index()];
        let kinematics = kinematics[side.index()];
        let (name, axes, bandwidth) = match stage {
            Stage::Coarse => {
                let [x, y, z] = kinematics.workspace().map(|reach| (-reach, reach));
                let across = |range| axis(range, 1e-6, spec.five_bar.speed);
                let along = axis(z, 1e-6, spec.z_stage.speed);
                (
                    "coarse",
                    [across(x), across(y), along, None, None, None],
                    0.0,
                )
            }
            Stage::Fine => {
                let [x, y] = kinematics
                    .micro_box()
                    .map(|range| axis(range, spec.micro.resolution, f64::INFINITY));
                (
                    "fine",
                    [x, y, None, None, None, None],
                    followed.unwrap_or(FOLLOWS / spec.micro.settling),
                )
            }
        };
        GroupCaps {
            name: format!("{}.{name}", side.name()),
            arm: side.index(),
            stage,
            axes,
            settling,
            bandwidth,
            lag,
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
        least_power: spec.laser.least_percent,
        bond: spec.bond.time,
        cycle: spec.period(),
    }
}

pub(super) fn pose_of(p: Point<Macro>) -> Pose {
    Pose::at(p.x, p.y, p.z)
}

impl Station<'_> {
    /// Begins a law, or goes on with it, as a ticket.
    fn begin(&mut self, group: Group, law: Law, ticket: Ticket) -> Result<(), Refused> {
        self.playing.caps.accepts(group, &law)?;
        let name = law.name();
        let refuse = |station: &Self, why: String| Refused::Law {
            group: station.playing.caps.groups[group.0].name.clone(),
            law: name,
            why,
        };
        match (of(group)?, law) {
            ((side, Stage::Coarse), Law::Line { to, limits }) => {
                let to = Point::new(to.x(), to.y(), to.z());
                self.begin_line(side, (to, limits.speed), ticket)
                    .map_err(|why| match why {
                        Outcome::Refused { why, .. } => refuse(self, why.to_string()),
                        why => refuse(self, why.to_string()),
                    })
            }
            ((side, Stage::Coarse), Law::Brake) => {
                self.begin_brake(side, ticket);
                Ok(())
            }
            ((_, Stage::Coarse), Law::Scan(_) | Law::Dither(_)) => {
                Err(refuse(self, "it plays lines only".to_owned()))
            }
            ((side, Stage::Fine), law) => {
                let beyond = |at: &Pose| !self.reaches(group, at);
                let beyond = match &law {
                    Law::Line { to, .. } => Some(*to).filter(beyond),
                    Law::Scan(knots) => knots.iter().map(|knot| knot.at).find(beyond),
                    Law::Dither(law) => {
                        let [x, y] = law.centre.to;
                        let lead = law.lead.map(|lead| lead.by(&self.leader(law)));
                        let [by_x, by_y] = lead.unwrap_or_default();
                        Some(Pose::at(x + by_x, y + by_y, 0.0)).filter(beyond)
                    }
                    Law::Brake => None,
                };
                if let Some(at) = beyond {
                    let [x, y] = [at.x(), at.y()].map(|v| 1e6 * v);
                    let why = format!("its piezos do not reach {x:.3}, {y:.3} um together");
                    return Err(refuse(self, why));
                }
                self.begin_fine(side, law, ticket);
                Ok(())
            }
        }
    }

    /// The side of an arm that carries a fiber, or none.
    fn holds(&self, arm: usize, one: bool) -> Result<Side, Refused> {
        let side = side_of(arm)?;
        if self.carries(side) == one {
            return Ok(side);
        }
        let what = if one { "no fiber" } else { "a fiber already" };
        let name = side.name();
        Err(Refused::State(format!("the holder of {name} has {what}")))
    }
}

impl Watched for Station<'_> {
    fn observer(&mut self) -> &mut dyn Observer {
        self.observer
    }

    fn note_reading(&mut self, time: f64) {
        self.count_reading(time);
    }

    fn voltage(&mut self) -> Option<&mut dyn VoltageMachine> {
        Some(self)
    }
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
        let played = |side: &Side| {
            let (i, playing) = (side.index(), &self.playing);
            if playing.fine[i]
                .as_ref()
                .is_some_and(|of| of.ticket == ticket)
            {
                return Some(fine(*side));
            }
            let goes = playing.coarse[i].as_ref();
            goes.is_some_and(|of| of.ticket == ticket)
                .then(|| coarse(*side))
        };
        let group = Side::ALL.iter().find_map(played);
        self.begin(group.ok_or(Refused::Ticket(ticket.0))?, law, ticket)?;
        Ok(self.time())
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        self.playing.caps.answers(&what)?;
        let period = self.spec().period();
        let mut by = self.time() + period;
        match what {
            Request::Laser(on) => self.laser(on),
            Request::LaserPower { percent } => self.laser_power(percent),
            Request::Load { arm, port } => {
                let port = u8::try_from(port).map_err(|_| Refused::Unknown {
                    what: "port",
                    index: port,
                    count: usize::from(u8::MAX),
                })?;
                let side = self.holds(arm, false)?;
                self.take_up(side, FiberHandling::Load(port));
            }
            Request::Attach { arm } => {
                let side = self.holds(arm, true)?;
                self.take_up(side, FiberHandling::Attach);
                by += self.spec().bond.time;
            }
            Request::Unload { arm } => {
                let side = self.holds(arm, true)?;
                self.take_up(side, FiberHandling::Unload);
            }
            Request::Handle { arm, what } => return self.begin_handling(arm, what),
        }
        let ticket = self.playing.ticket();
        self.playing.requests.push((ticket, by - 0.5 * period));
        Ok(ticket)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        let half = 0.5 * self.period;
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
        let ago = ago.max(0.0) as usize;
        if ago == 0 && stage == Stage::Coarse {
            // Carried on from the last time that it was worked out.
            return Some(Estimate {
                pose: pose_of(self.endpoint(side)),
                measured: true,
            });
        }
        let Stand {
            encoders,
            windup,
            micro,
        } = self.past.stand(side, ago)?;
        Some(match stage {
            Stage::Fine => Estimate {
                pose: Pose::at(micro.x, micro.y, 0.0),
                measured: false,
            },
            Stage::Coarse => {
                let arm = &self.arms[side.index()];
                let kinematics = &arm.kinematics;
                let stood = (encoders, windup);
                let endpoint = Known::or(&arm.earlier, kinematics, stood, |outputs| {
                    kinematics.endpoint_at(outputs)
                });
                Estimate {
                    pose: pose_of(endpoint?),
                    measured: true,
                }
            }
        })
    }

    fn reference(&self, group: Group) -> Option<Pose> {
        let (side, stage) = of(group).ok()?;
        Some(match stage {
            Stage::Fine => {
                let Displacement { x, y } = self.micro(side);
                Pose::at(x, y, 0.0)
            }
            Stage::Coarse => pose_of(self.wanted(side)),
        })
    }

    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        match of(group) {
            Ok((side, Stage::Fine)) => {
                self.arms[side.index()].micro_reaches(Displacement::new(pose.x(), pose.y()))
            }
            Ok((side, Stage::Coarse)) => {
                let at = Point::new(pose.x(), pose.y(), pose.z());
                self.kinematics(side).contains(at)
            }
            Err(_) => false,
        }
    }

    fn stop(&mut self) {
        for side in Side::ALL {
            self.halt(side);
        }
        self.playing.end();
        Station::stop(self);
    }
}
