//! How much of an alignment's time each manipulator moves, and how much both do.

use super::produce::Sides;
use pigtail_control::station::{Observer, Sample};
use pigtail_hal::bench::{
    Bench, Caps, Estimate, Event, Group, Law, Pose, Refused, Request, Ticket,
};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Fault, Side};
use pigtail_numerics::rounded;
use serde::Serialize;

/// What manipulators do of the time of an alignment, percent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Arms {
    /// Share in which a manipulator moves: from one light sample to the next an encoder of its macro tells of another count, or its micro is told
    /// to go elsewhere. On a bench that is controlled by position: a law of one of its stages is played.
    pub moving_percent: Sides,
    /// The rest, in which it stands still: it has nothing to do, waits for the other one, or holds what the other one needs.
    pub idle_percent: Sides,
    /// Share in which both move.
    pub both_moving_percent: f64,
    /// The time that these are shares of, seconds.
    pub seconds: f64,
}

/// Adds up how long manipulators move.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Time {
    all: f64,
    moving: [f64; SIDES],
    both: f64,
}

impl Time {
    /// What was added up in so many seconds, of which the manipulators stood still for so many, and both moved for so many.
    pub(crate) fn told(all: f64, idle: [f64; SIDES], both: f64) -> Self {
        Self {
            all,
            moving: idle.map(|idle| all - idle),
            both,
        }
    }

    /// Of several alignments together.
    pub(crate) fn sum(alignments: impl Iterator<Item = Arms>) -> Self {
        alignments.fold(Self::default(), |mut sum, one| {
            let one = Self::told(one.seconds, one.idle_seconds(), one.both_moving_seconds());
            sum.all += one.all;
            for (moving, of) in sum.moving.iter_mut().zip(one.moving) {
                *moving += of;
            }
            sum.both += one.both;
            sum
        })
    }

    fn add(&mut self, seconds: f64, moves: [bool; SIDES]) {
        self.all += seconds;
        for (sum, moves) in self.moving.iter_mut().zip(moves) {
            *sum += if moves { seconds } else { 0.0 };
        }
        self.both += if moves == [true; SIDES] { seconds } else { 0.0 };
    }

    /// As shares; `None` of no time.
    pub(crate) fn arms(&self) -> Option<Arms> {
        let percent = |seconds: f64| rounded(100.0 * seconds / self.all, 1e-2);
        let of = |seconds: &dyn Fn(usize) -> f64| Sides {
            left: percent(seconds(Side::Left.index())),
            right: percent(seconds(Side::Right.index())),
        };
        (self.all > 0.0).then(|| Arms {
            moving_percent: of(&|side| self.moving[side]),
            idle_percent: of(&|side| self.all - self.moving[side]),
            both_moving_percent: percent(self.both),
            seconds: rounded(self.all, 1e-4),
        })
    }
}

impl Arms {
    /// For how long each stood still, seconds.
    pub(crate) fn idle_seconds(&self) -> [f64; SIDES] {
        let mut idle = [0.0; SIDES];
        idle[Side::Left.index()] = self.idle_percent.left;
        idle[Side::Right.index()] = self.idle_percent.right;
        idle.map(|percent| rounded(1e-2 * percent * self.seconds, 1e-4))
    }

    /// For how long both moved, seconds.
    pub(crate) fn both_moving_seconds(&self) -> f64 {
        rounded(1e-2 * self.both_moving_percent * self.seconds, 1e-4)
    }
}

/// Watches samples on the way to another observer.
pub(crate) struct Counted<'o> {
    observer: &'o mut dyn Observer,
    last: Option<Sample>,
    time: Time,
}

impl<'o> Counted<'o> {
    pub(crate) fn new(observer: &'o mut dyn Observer) -> Self {
        Self {
            observer,
            last: None,
            time: Time::default(),
        }
    }

    /// What was seen; `None` before there were two samples.
    pub(crate) fn arms(&self) -> Option<Arms> {
        self.time.arms()
    }
}

impl Observer for Counted<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.observer.phase(port, phase, time);
    }

    fn phase_over(&mut self, port: &str, phase: &'static str, time: f64) {
        self.observer.phase_over(port, phase, time);
    }

    fn sample(&mut self, sample: &Sample) {
        if let Some(last) = self.last.replace(*sample) {
            let moves = std::array::from_fn(|side| {
                sample.endpoints[side] != last.endpoints[side]
                    || sample.micro[side] != last.micro[side]
            });
            self.time.add(sample.time - last.time, moves);
        }
        self.observer.sample(sample);
    }

    fn trial(&mut self, start: usize, trial: u32, best: f64) {
        self.observer.trial(start, trial, best);
    }
}

/// A bench, and for how long laws are played on it.
pub(crate) struct Played<B> {
    bench: B,
    /// What each group plays.
    plays: Vec<Option<Ticket>>,
    time: Time,
}

impl<B: Bench> Played<B> {
    pub(crate) fn new(bench: B) -> Self {
        let plays = vec![None; bench.caps().groups.len()];
        Self {
            bench,
            plays,
            time: Time::default(),
        }
    }

    /// What was seen; `None` where no time passed.
    pub(crate) fn arms(&self) -> Option<Arms> {
        self.time.arms()
    }
}

impl<B: Bench> Bench for Played<B> {
    fn caps(&self) -> &Caps {
        self.bench.caps()
    }

    fn now(&self) -> f64 {
        self.bench.now()
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        let ticket = self.bench.play(group, law)?;
        if let Some(plays) = self.plays.get_mut(group.0) {
            *plays = Some(ticket);
        }
        Ok(ticket)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        self.bench.bend(ticket, law)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        self.bench.request(what)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        let before = self.now();
        let event = self.bench.next(by);
        let groups = &self.bench.caps().groups;
        let moves = std::array::from_fn(|side| {
            let mut of = groups.iter().zip(&self.plays);
            of.any(|(group, plays)| group.arm == side && plays.is_some())
        });
        self.time.add(self.bench.now() - before, moves);
        if let Ok(Event::Done(ended) | Event::Failed(ended, _)) = &event {
            for plays in &mut self.plays {
                plays.take_if(|plays| plays == ended);
            }
        }
        event
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
        self.plays.fill(None);
        self.bench.stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_control::station::Unobserved;
    use pigtail_hal::spec::CHANNELS;
    use pigtail_model::frames::{Displacement, Point};

    #[test]
    fn a_manipulator_moves_with_its_macro_or_with_its_micro() {
        let sample = |time: f64, z_left: f64, x_right: f64| Sample {
            time,
            light: [0.0; CHANNELS],
            endpoints: [Point::new(0.0, 0.0, z_left), Point::new(0.0, 0.0, 0.0)],
            micro: [Displacement::ZERO, Displacement::new(x_right, 0.0)],
        };
        let mut nobody = Unobserved;
        let mut counted = Counted::new(&mut nobody);
        assert_eq!(counted.arms(), None);
        // At rest, the left one's macro, both, the right one's micro.
        for (time, left, right) in [
            (0.0, 0.0, 0.0),
            (0.5, 0.0, 0.0),
            (1.0, 1e-6, 0.0),
            (1.5, 2e-6, 1e-7),
            (2.0, 2e-6, 0.0),
        ] {
            counted.sample(&sample(time, left, right));
        }
        let arms = counted.arms().expect("four intervals");
        assert_eq!(
            (arms.moving_percent.left, arms.moving_percent.right),
            (50.0, 50.0)
        );
        assert_eq!(
            (arms.idle_percent.left, arms.idle_percent.right),
            (50.0, 50.0)
        );
        assert!((arms.both_moving_percent - 25.0).abs() < 1e-9);
        assert!((arms.seconds - 2.0).abs() < 1e-9);
        assert_eq!(arms.idle_seconds(), [1.0, 1.0]);
        let again = Time::told(
            arms.seconds,
            arms.idle_seconds(),
            arms.both_moving_seconds(),
        );
        assert_eq!(again.arms(), Some(arms));
    }
}
