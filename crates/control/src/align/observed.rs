//! A bench that somebody watches.

use crate::reactor::Watched;
use crate::station::{Observer, Sample};
use pigtail_hal::bench::{
    Caps, Estimate, Event, Group, Law, Light, Pose, Refused, Request, Stage, Ticket,
};
use pigtail_hal::spec::{CHANNELS, SIDES};
use pigtail_hal::{Bench, Fault};
use pigtail_model::frames::{Displacement, Point};

/// A bench that tells an observer of its light.
pub(crate) struct Observed<'b> {
    bench: &'b mut dyn Bench,
    observer: &'b mut dyn Observer,
}

impl<'b> Observed<'b> {
    pub(crate) fn new(bench: &'b mut dyn Bench, observer: &'b mut dyn Observer) -> Self {
        Self { bench, observer }
    }

    /// An observer knows two arms, and as many channels as the printed machine has.
    fn tell(&mut self, light: &Light) {
        let at = |arm: usize, stage| {
            let group = self.bench.caps().group(arm, stage);
            let pose = group.and_then(|group| self.bench.pose(group, light.time));
            pose.map_or(Pose::ZERO, |estimate| estimate.pose)
        };
        let sample = Sample {
            time: light.time,
            light: std::array::from_fn::<_, CHANNELS, _>(|i| {
                light.volts.get(i).copied().unwrap_or(0.0)
            }),
            endpoints: std::array::from_fn::<_, SIDES, _>(|arm| {
                let pose = at(arm, Stage::Coarse);
                Point::new(pose.x(), pose.y(), pose.z())
            }),
            micro: std::array::from_fn::<_, SIDES, _>(|arm| {
                let pose = at(arm, Stage::Fine);
                Displacement::new(pose.x(), pose.y())
            }),
        };
        self.observer.sample(&sample);
    }
}

impl Watched for Observed<'_> {
    fn observer(&mut self) -> &mut dyn Observer {
        self.observer
    }
}

impl Bench for Observed<'_> {
    fn caps(&self) -> &Caps {
        self.bench.caps()
    }

    fn now(&self) -> f64 {
        self.bench.now()
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        self.bench.play(group, law)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        self.bench.bend(ticket, law)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        self.bench.request(what)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        let event = self.bench.next(by)?;
        match &event {
            Event::Light(light) => self.tell(light),
            Event::Batch(lights) => lights.iter().for_each(|light| self.tell(light)),
            _ => {}
        }
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
    }
}
