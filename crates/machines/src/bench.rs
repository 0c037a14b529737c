//! What goes around any bench: its guard, and its [record].
//!
//! In goes a [`Bench`], out comes another that control cannot tell from it, and that refuses what would hurt, and
//! stops a bench that does not keep to its word. What is true of every bench [conformance] checks.

pub mod conformance;
pub mod record;

use pigtail_hal::bench::{
    Bench, Caps, Estimate, Event, Group, Law, Light, Pose, Refused, Request, Ticket,
};
use pigtail_hal::{Fault, Rule};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Where a fiber that was taken for a port would touch the facet, if it were as near as it may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// The arm.
    pub arm: usize,
    /// The port on its side.
    pub port: usize,
    /// Its pose in z, all groups together, metres: it is never passed.
    pub z: f64,
}

impl Plane {
    /// Of a pose at which the tip touches the facet, which may be nearer by a bound, metres.
    pub fn of(arm: usize, port: usize, touching: &Pose, bound: f64) -> Self {
        Self {
            arm,
            port,
            z: touching.z() - bound,
        }
    }
}

/// Samples in a row that may be missing before a bench counts as lost, and how old one may be: a choice. A meter that
/// changes its range is silent for some tens of samples at the most.
const SILENT: f64 = 50.0;
/// No bench is lost before so long, seconds.
const PATIENCE: f64 = 0.2;
/// What time may err by, seconds.
const ROUNDING: f64 = 1e-6;

/// A bench behind a guard.
///
/// It refuses what the datasheet forbids ([`Caps::accepts`]) and a way past a facet's plane that was taught. It stops
/// a bench whose events come late, out of order or unasked, or not at all; and when somebody asks to stop.
pub struct Guard<B> {
    bench: B,
    caps: Caps,
    planes: Vec<Plane>,
    /// Which port the fiber of an arm is for, as far as that is known.
    carried: Vec<Option<usize>>,
    /// How far up in z each group may be until it has come to rest, metres.
    highest: Vec<f64>,
    /// What is not over: motions of groups with where in z they end, and requests.
    moving: BTreeMap<Ticket, (Group, f64)>,
    busy: BTreeMap<Ticket, Request>,
    heard: Option<f64>,
    fault: Option<Fault>,
    stop: Arc<AtomicBool>,
    longest: f64,
    began: f64,
}

impl<B: Bench> Guard<B> {
    /// A guard that knows of no planes.
    pub fn new(bench: B) -> Self {
        let (groups, arms) = (bench.caps().groups.len(), bench.caps().arms.len());
        let began = bench.now();
        let at = |group| {
            bench
                .pose(Group(group), began)
                .map_or(0.0, |at| at.pose.z())
        };
        Self {
            highest: (0..groups).map(at).collect(),
            planes: Vec::new(),
            carried: vec![None; arms],
            moving: BTreeMap::new(),
            busy: BTreeMap::new(),
            heard: None,
            fault: None,
            stop: Arc::default(),
            longest: f64::INFINITY,
            began,
            caps: bench.caps().clone(),
            bench,
        }
    }

    /// The same, of which more is known than the bench itself says: what was measured of its groups.
    #[must_use]
    pub fn with_caps(self, caps: Caps) -> Self {
        Self { caps, ..self }
    }

    /// The same, with planes that no tip passes.
    #[must_use]
    pub fn with_planes(self, planes: Vec<Plane>) -> Self {
        Self { planes, ..self }
    }

    /// The same, with a button that stops it.
    #[must_use]
    pub fn with_stop(self, stop: Arc<AtomicBool>) -> Self {
        Self { stop, ..self }
    }

    /// The same, for work that hangs if it takes longer, seconds.
    #[must_use]
    pub fn with_longest(self, longest: f64) -> Self {
        Self { longest, ..self }
    }

    /// The bench itself, for whoever may ask it more.
    pub fn inner(&self) -> &B {
        &self.bench
    }

    /// The plane before an arm: that of its fiber's port, or the nearest where that is not known.
    fn plane(&self, arm: usize) -> Option<f64> {
        let port = self.carried[arm];
        let of = |plane: &&Plane| plane.arm == arm && port.is_none_or(|port| port == plane.port);
        self.planes
            .iter()
            .filter(of)
            .map(|plane| plane.z)
            .min_by(f64::total_cmp)
    }

    fn measured(&self, group: usize) -> f64 {
        let now = self.bench.now();
        let known = self.bench.pose(Group(group), now);
        known.map_or(self.highest[group], |at| at.pose.z())
    }

    /// How far up in z a group will have been with a law, and where that ends.
    fn way(&self, group: Group, law: &Law) -> (f64, f64) {
        let now = self.measured(group.0);
        match law {
            Law::Line { to, .. } => (now.max(to.z()), to.z()),
            Law::Scan(knots) => {
                let highest = knots.iter().map(|knot| knot.at.z()).fold(now, f64::max);
                (highest, knots.last().map_or(now, |knot| knot.at.z()))
            }
            Law::Dither(_) | Law::Brake => (self.highest[group.0], self.highest[group.0]),
        }
    }

    fn check(&self, group: Group, law: &Law) -> Result<(f64, f64), Refused> {
        if let Some(fault) = &self.fault {
            return Err(Refused::State(format!("the bench has stopped: {fault}")));
        }
        let caps = self.bench.caps();
        caps.accepts(group, law)?;
        let way = self.way(group, law);
        let arm = caps.groups[group.0].arm;
        if let Some(plane) = self.plane(arm) {
            let others = caps.groups.iter().enumerate();
            let others = others.filter(|(other, of)| of.arm == arm && *other != group.0);
            let tip = way.0 + others.map(|(other, _)| self.highest[other]).sum::<f64>();
            if tip > plane {
                return Err(Refused::State(format!(
                    "{} would bring the tip of {} to {:.3} um in z; accepted is at most {:.3} um, where it may touch the \
                     facet",
                    caps.groups[group.0].name,
                    caps.arms[arm],
                    1e6 * tip,
                    1e6 * plane
                )));
            }
        }
        Ok(way)
    }

    fn halt(&mut self, rule: Rule, axis: &str, value: String, limit: String) -> Fault {
        let fault = Fault {
            rule,
            axis: axis.to_owned(),
            value,
            limit,
            time: self.bench.now(),
        };
        self.bench.stop();
        self.fault.get_or_insert(fault).clone()
    }

    fn name(&self) -> String {
        self.bench.caps().name.clone()
    }

    /// Whether light was measured when it may have been.
    fn light(&mut self, light: &Light) -> Result<(), Fault> {
        let channels = self.bench.caps().channels.len();
        let (now, name) = (self.bench.now(), self.name());
        if light.volts.len() != channels || light.volts.iter().any(|volts| volts.is_infinite()) {
            return Err(self.halt(
                Rule::SensorSilence,
                &name,
                format!("a sample of {:?} V", light.volts),
                format!("{channels} voltages"),
            ));
        }
        let oldest = now - self.patience();
        let earliest = self.heard.unwrap_or(f64::NEG_INFINITY);
        let in_time = light.time > earliest && light.time >= oldest && light.time <= now + ROUNDING;
        if !in_time {
            return Err(self.halt(
                Rule::EventOrder,
                &name,
                format!("light of {:.6} s at {now:.6} s", light.time),
                format!("one behind {:.6} s and up to now", earliest.max(oldest)),
            ));
        }
        self.heard = Some(light.time);
        Ok(())
    }

    /// How old light may be, seconds.
    fn patience(&self) -> f64 {
        let rates = self.bench.caps().channels.iter().map(|of| of.rate);
        let fastest = rates.fold(f64::NAN, f64::max);
        (SILENT / fastest).max(PATIENCE)
    }

    fn over(&mut self, ticket: Ticket, done: bool) -> Result<(), Fault> {
        if let Some((group, z)) = self.moving.remove(&ticket) {
            self.highest[group.0] = if done { z } else { self.measured(group.0) };
            return Ok(());
        }
        if let Some(request) = self.busy.remove(&ticket) {
            match request {
                Request::Load { arm, port } if done => self.carried[arm] = Some(port),
                Request::Attach { arm } | Request::Unload { arm } if done => {
                    self.carried[arm] = None;
                }
                _ => {}
            }
            return Ok(());
        }
        let name = self.name();
        Err(self.halt(
            Rule::EventOrder,
            &name,
            format!("the end of ticket {ticket}"),
            "that of one that is being played".to_owned(),
        ))
    }

    fn heed(&mut self, event: &Event, before: f64, by: f64) -> Result<(), Fault> {
        let (now, name) = (self.bench.now(), self.name());
        if now.is_nan() || now < before - ROUNDING {
            return Err(self.halt(
                Rule::EventOrder,
                &name,
                format!("a time of {now:.6} s"),
                format!("{before:.6} s or later"),
            ));
        }
        match event {
            Event::Light(light) => self.light(light)?,
            // Else a bench whose clock stands could go on with it for ever.
            Event::Batch(batch) if batch.is_empty() => {
                return Err(self.halt(
                    Rule::EventOrder,
                    &name,
                    "a batch without light".to_owned(),
                    "one with some".to_owned(),
                ));
            }
            Event::Batch(batch) => {
                for light in batch {
                    self.light(light)?;
                }
            }
            Event::Played(ticket) if !self.moving.contains_key(ticket) => {
                return Err(self.halt(
                    Rule::EventOrder,
                    &name,
                    format!("that ticket {ticket} is played"),
                    "that of one that is being played".to_owned(),
                ));
            }
            Event::Done(ticket) => self.over(*ticket, true)?,
            Event::Failed(ticket, _) => self.over(*ticket, false)?,
            Event::Time if now < by - ROUNDING - 0.5 * self.bench.caps().cycle => {
                return Err(self.halt(
                    Rule::EventOrder,
                    &name,
                    format!("nothing until {now:.6} s"),
                    format!("nothing until {by:.6} s"),
                ));
            }
            Event::Time | Event::Frame(_) | Event::Played(_) => {}
        }
        let since = now - self.heard.unwrap_or(self.began);
        if since > self.patience() {
            return Err(self.halt(
                Rule::SensorSilence,
                &name,
                format!("no light for {since:.3} s"),
                format!("some within {:.3} s", self.patience()),
            ));
        }
        Ok(())
    }
}

impl<B: Bench> Bench for Guard<B> {
    fn caps(&self) -> &Caps {
        &self.caps
    }

    fn now(&self) -> f64 {
        self.bench.now()
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        let (highest, end) = self.check(group, &law)?;
        let ticket = self.bench.play(group, law)?;
        // What the group played before never ends.
        self.moving.retain(|_, (of, _)| *of != group);
        self.moving.insert(ticket, (group, end));
        self.highest[group.0] = highest;
        Ok(ticket)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        let known = self.moving.get(&ticket);
        let (group, _) = *known.ok_or(Refused::Ticket(ticket.0))?;
        if !self.caps().group_caps(group)?.bends {
            return Err(Refused::Law {
                group: self.caps().groups[group.0].name.clone(),
                law: law.name(),
                why: "what it plays cannot be replaced".to_owned(),
            });
        }
        let (highest, end) = self.check(group, &law)?;
        let from = self.bench.bend(ticket, law)?;
        self.moving.insert(ticket, (group, end));
        self.highest[group.0] = highest;
        Ok(from)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        if let Some(fault) = &self.fault {
            return Err(Refused::State(format!("the bench has stopped: {fault}")));
        }
        self.caps().answers(&what)?;
        let ticket = self.bench.request(what)?;
        self.busy.insert(ticket, what);
        Ok(ticket)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        if let Some(fault) = &self.fault {
            return Err(fault.clone());
        }
        let before = self.bench.now();
        let name = self.name();
        if self.stop.load(Ordering::Relaxed) {
            return Err(self.halt(
                Rule::StopRequest,
                &name,
                "somebody asks to stop".to_owned(),
                "nobody".to_owned(),
            ));
        }
        if before - self.began > self.longest {
            let value = format!("{:.1} s of work", before - self.began);
            return Err(self.halt(
                Rule::Deadline,
                &name,
                value,
                format!("at most {} s", self.longest),
            ));
        }
        // A bench that is silent is found to be, however long its silence was asked for.
        let heard = self.heard.unwrap_or(self.began);
        let until = by.min(heard + self.patience() + 2.0 * ROUNDING);
        let event = match self.bench.next(until.max(before)) {
            Ok(event) => event,
            Err(fault) => {
                self.bench.stop();
                self.fault = Some(fault.clone());
                return Err(fault);
            }
        };
        self.heed(&event, before, until)?;
        Ok(event)
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        self.bench.pose(group, at)
    }

    fn reference(&self, group: Group) -> Option<Pose> {
        self.bench.reference(group)
    }

    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        self.bench.reaches(group, pose)
    }

    fn stop(&mut self) {
        self.bench.stop();
        self.moving.clear();
        self.busy.clear();
    }
}
