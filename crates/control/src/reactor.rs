//! Straight lines of control that run side by side over one bench.
//!
//! Whatever is done with a bench is written as an `async fn` that reads from top to bottom and waits for events
//! ([`Reactor::next`]). [`Reactor::run`] is the only place in which time passes: it lets every line go on as far as it can,
//! in a fixed order, then asks the bench for its next event, which all lines hear that wait for one. [`both`] runs two
//! lines together. Nothing here knows threads or clocks: the same bench gives the same run, to the last bit.
//!
//! Before an event is handed out, a [`Gate`] may hold it back: that is how a run is paused, or done step by step.

mod asks;

pub(crate) use self::asks::{LONGEST, across, refused};
use crate::station::{Observer, VoltageMachine};
use crate::tuning::TUNING;
use pigtail_hal::bench::{Caps, Estimate, Event, Group, Law, Pose, Refused, Request, Ticket};
use pigtail_hal::{Bench, Fault};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::task::{Context, Poll, Waker};

/// A bench that somebody watches.
pub trait Watched: Bench {
    /// Who is told of phases.
    fn observer(&mut self) -> &mut dyn Observer;
    /// Control has looked at light of this time.
    fn note_reading(&mut self, _time: f64) {}
    /// What it can do beside a bench, where a machine that is driven by volts stands below it.
    fn voltage(&mut self) -> Option<&mut dyn VoltageMachine> {
        None
    }
}

/// What becomes of an event, as whoever watches a run decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Go {
    /// It is handed out.
    On,
    /// Control takes no step: light and frames are passed over, the ends of motions kept. The bench goes on with what it
    /// plays, and time passes.
    Wait,
}

/// Decides upon each event whether control goes on. One that returns later, or upon a key, makes a twin go step by step.
pub type Gate<'g> = dyn FnMut(&Event) -> Go + 'g;

/// What takes in every event before anybody hears it.
pub(crate) trait Listener {
    fn hear(&self, bench: &dyn Bench, event: &Event);
}

/// Hands the events of a bench to the lines that wait for them.
pub struct Reactor<'b> {
    bench: RefCell<&'b mut dyn Watched>,
    caps: Caps,
    /// How many events have been handed out, the last of them, and until when it was waited for.
    count: Cell<u64>,
    last: RefCell<Result<Event, Fault>>,
    asked: Cell<f64>,
    /// Of when the light is that control has looked at last, seconds.
    looked: Cell<f64>,
    /// The earliest time that a line waits for.
    by: Cell<f64>,
    /// Events that came together.
    queue: RefCell<VecDeque<Event>>,
    /// What each group plays that has not been played to its end.
    moving: RefCell<Vec<Option<Ticket>>>,
    /// By when each group has come to rest that was seen to swing for longer than its bench says, seconds.
    rests: RefCell<Vec<Option<f64>>>,
}

impl<'b> Reactor<'b> {
    /// Takes a bench in hand.
    pub fn new(bench: &'b mut dyn Watched) -> Self {
        let caps = bench.caps().clone();
        Self {
            moving: RefCell::new(vec![None; caps.groups.len()]),
            rests: RefCell::new(vec![None; caps.groups.len()]),
            bench: RefCell::new(bench),
            caps,
            count: Cell::new(0),
            last: RefCell::new(Ok(Event::Time)),
            asked: Cell::new(f64::NEG_INFINITY),
            looked: Cell::new(0.0),
            by: Cell::new(f64::INFINITY),
            queue: RefCell::default(),
        }
    }

    /// What the bench is able to do.
    pub fn caps(&self) -> &Caps {
        &self.caps
    }

    /// By when a group has come to rest where it was told to be, seconds: as its bench says, or as it was seen to.
    pub fn settling(&self, group: Group) -> f64 {
        let seen = self.rests.borrow()[group.0].unwrap_or(0.0);
        self.caps.groups[group.0].settling.max(seen)
    }

    /// How many turns of a circle a second a group follows, hertz: as its bench says, or, where it was seen to swing for longer than that, as any group
    /// would that takes so long; at least what every resonance follows that a micro may have.
    pub fn bandwidth(&self, group: Group) -> f64 {
        let caps = &self.caps.groups[group.0];
        let tuned = &TUNING.dynamics;
        let slower =
            |seen: f64| (caps.settling / seen * caps.bandwidth).max(tuned.turns * tuned.least);
        let seen = self.rests.borrow()[group.0].map_or(f64::INFINITY, slower);
        caps.bandwidth.min(seen)
    }

    /// Whether a group was seen to swing for longer than its bench says.
    pub fn swings(&self, group: Group) -> bool {
        self.rests.borrow()[group.0].is_some()
    }

    /// A group was seen to come to rest no sooner than in so many seconds.
    pub fn has_swung(&self, group: Group, seconds: f64) {
        let rests = &mut self.rests.borrow_mut()[group.0];
        *rests = Some(rests.unwrap_or(0.0).max(seconds));
    }

    /// The bench's time, seconds.
    pub fn now(&self) -> f64 {
        self.bench.borrow().now()
    }

    /// Whether a time has come: a bench's time passes in steps, and [`Event::Time`] may come half of one early.
    pub fn is_past(&self, time: f64) -> bool {
        self.now() + 0.5 * self.caps.cycle >= time
    }

    /// [`Bench::play`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn play(&self, group: Group, law: Law) -> Result<Ticket, Refused> {
        let ticket = self.bench.borrow_mut().play(group, law)?;
        self.moving.borrow_mut()[group.0] = Some(ticket);
        Ok(ticket)
    }

    /// [`Bench::bend`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn bend(&self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        self.bench.borrow_mut().bend(ticket, law)
    }

    /// [`Bench::request`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn request(&self, what: Request) -> Result<Ticket, Refused> {
        self.bench.borrow_mut().request(what)
    }

    /// [`Bench::pose`].
    pub fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        self.bench.borrow().pose(group, at)
    }

    /// Where a group is wanted at this moment; where it is, on a bench that does not tell.
    pub fn reference(&self, group: Group) -> Option<Pose> {
        let bench = self.bench.borrow();
        let reference = bench.reference(group);
        reference.or_else(|| bench.pose(group, bench.now()).map(|estimate| estimate.pose))
    }

    /// [`Bench::reaches`].
    pub fn reaches(&self, group: Group, pose: &Pose) -> bool {
        self.bench.borrow().reaches(group, pose)
    }

    /// Whether a group has not yet been brought to the end of what it plays.
    pub fn moving(&self, group: Group) -> bool {
        self.moving.borrow()[group.0].is_some()
    }

    /// Does what only a machine that is driven by volts can; `None` on every other bench.
    pub fn voltage<T>(&self, work: impl FnOnce(&mut dyn VoltageMachine) -> T) -> Option<T> {
        self.bench.borrow_mut().voltage().map(work)
    }

    /// Of when the light is that control has looked at last, seconds.
    pub fn looked(&self) -> f64 {
        self.looked.get()
    }

    /// Control has looked at light of this time.
    pub fn note_reading(&self, time: f64) {
        self.looked.set(time);
        self.bench.borrow_mut().note_reading(time);
    }

    /// Tells the observer that a phase of a port's fiber begins.
    pub fn announce(&self, port: &str, phase: &'static str) {
        let now = self.now();
        self.bench.borrow_mut().observer().phase(port, phase, now);
    }

    /// Tells the observer that it is over.
    pub fn conclude(&self, port: &str, phase: &'static str) {
        let now = self.now();
        self.bench
            .borrow_mut()
            .observer()
            .phase_over(port, phase, now);
    }

    /// The next event, or [`Event::Time`] at a time, seconds. [`Event::Batch`] is handed out light by light.
    pub fn next(&self, by: f64) -> Next<'_, 'b> {
        Next {
            reactor: self,
            since: self.count.get(),
            by,
        }
    }

    /// The same; only what is wanted `of` the event, which is not handed out itself.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn next_as<T>(&self, by: f64, mut of: impl FnMut(&Event) -> T) -> Result<T, Fault> {
        let mut next = self.next(by);
        poll_fn(move |_| {
            if !next.has_come() {
                return Poll::Pending;
            }
            let last = self.last.borrow();
            Poll::Ready(last.as_ref().map(&mut of).map_err(Clone::clone))
        })
        .await
    }

    /// Lets a line run to its end.
    pub fn run<T>(&self, line: impl Future<Output = T>) -> T {
        self.run_heard(line, &(), &mut |_| Go::On)
    }

    /// The same, where every event is first heard by a listener, and let through by a gate.
    pub(crate) fn run_heard<T>(
        &self,
        line: impl Future<Output = T>,
        listener: &impl Listener,
        gate: &mut Gate,
    ) -> T {
        let mut line = pin!(line);
        let mut context = Context::from_waker(Waker::noop());
        loop {
            self.by.set(f64::INFINITY);
            if let Poll::Ready(done) = line.as_mut().poll(&mut context) {
                return done;
            }
            let event = self.hear(listener, gate);
            *self.last.borrow_mut() = event;
            self.count.set(self.count.get() + 1);
        }
    }

    /// What the lines hear next.
    fn hear(&self, listener: &impl Listener, gate: &mut Gate) -> Result<Event, Fault> {
        let by = self.by.get();
        self.asked.set(by);
        let mut kept = VecDeque::new();
        loop {
            let queued = self.queue.borrow_mut().pop_front();
            let event = match queued {
                Some(event) => event,
                None => self.bench.borrow_mut().next(by)?,
            };
            if let Event::Batch(lights) = event {
                self.queue
                    .borrow_mut()
                    .extend(lights.into_iter().map(Event::Light));
                continue;
            }
            if let Event::Played(ticket) | Event::Done(ticket) | Event::Failed(ticket, _) = &event {
                let mut moving = self.moving.borrow_mut();
                for of in moving.iter_mut().filter(|of| **of == Some(*ticket)) {
                    *of = None;
                }
            }
            listener.hear(&**self.bench.borrow(), &event);
            match gate(&event) {
                Go::On if kept.is_empty() => return Ok(event),
                Go::On => {
                    kept.push_back(event);
                    let first = kept.pop_front();
                    self.queue.borrow_mut().append(&mut kept);
                    return Ok(first.unwrap_or(Event::Time));
                }
                Go::Wait => match event {
                    Event::Played(_) | Event::Done(_) | Event::Failed(..) => kept.push_back(event),
                    Event::Time => {
                        // Time passes all the same: by a cycle, or by whatever a sample takes.
                        let rate = self
                            .caps
                            .channels
                            .iter()
                            .map(|c| c.rate)
                            .fold(1.0, f64::max);
                        let step = self.caps.cycle.max(rate.recip());
                        let until = self.now() + step;
                        let event = self.bench.borrow_mut().next(until)?;
                        self.queue.borrow_mut().push_back(event);
                    }
                    Event::Light(_) | Event::Frame(_) | Event::Batch(_) => {}
                },
            }
        }
    }
}

impl Listener for () {
    fn hear(&self, _: &dyn Bench, _: &Event) {}
}

/// An event that a line waits for.
#[must_use = "nothing is waited for until it is awaited"]
pub struct Next<'r, 'b> {
    reactor: &'r Reactor<'b>,
    /// Events that were handed out before.
    since: u64,
    by: f64,
}

impl Next<'_, '_> {
    /// Whether it is there; else it is waited for.
    fn has_come(&mut self) -> bool {
        let reactor = self.reactor;
        if reactor.count.get() > self.since {
            self.since = reactor.count.get();
            // A time that another line has waited for is none of this one's.
            let mine = !matches!(&*reactor.last.borrow(), Ok(Event::Time))
                || self.by <= reactor.asked.get();
            if mine {
                return true;
            }
        }
        reactor.by.set(reactor.by.get().min(self.by));
        false
    }
}

impl Future for Next<'_, '_> {
    type Output = Result<Event, Fault>;

    fn poll(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Self::Output> {
        if self.has_come() {
            Poll::Ready(self.reactor.last.borrow().clone())
        } else {
            Poll::Pending
        }
    }
}

/// Two lines that run together; what comes of both, once both have ended. The first goes on first at each event.
pub async fn both<A, B>(a: impl Future<Output = A>, b: impl Future<Output = B>) -> (A, B) {
    let (mut a, mut b) = (pin!(a), pin!(b));
    let (mut of_a, mut of_b) = (None, None);
    poll_fn(|context| {
        if of_a.is_none()
            && let Poll::Ready(done) = a.as_mut().poll(context)
        {
            of_a = Some(done);
        }
        if of_b.is_none()
            && let Poll::Ready(done) = b.as_mut().poll(context)
        {
            of_b = Some(done);
        }
        match (of_a.take(), of_b.take()) {
            (Some(a), Some(b)) => Poll::Ready((a, b)),
            (a, b) => {
                (of_a, of_b) = (a, b);
                Poll::Pending
            }
        }
    })
    .await
}

/// Two lines that run together, of which either may fail: the other is run to its end all the same, so that no motion is
/// left that nobody waits for.
///
/// # Errors
///
/// The first line's, else the second's.
pub async fn both_well<A, B, E>(
    a: impl Future<Output = Result<A, E>>,
    b: impl Future<Output = Result<B, E>>,
) -> Result<(A, B), E> {
    let (a, b) = both(a, b).await;
    Ok((a?, b?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outcome::{Halt, Outcome};
    use crate::station::Unobserved;
    use pigtail_hal::bench::{ChannelCaps, GroupCaps, Light, Limits, Stage};

    /// Two groups that take a second for a metre, and light every tenth of a second.
    struct Slow {
        caps: Caps,
        now: f64,
        ends: Vec<(Ticket, f64)>,
        light: f64,
        unobserved: Unobserved,
    }

    impl Slow {
        fn new() -> Self {
            let group = |name: &str, arm| GroupCaps {
                name: name.to_owned(),
                arm,
                stage: Stage::Coarse,
                axes: [None; 6],
                settling: 0.0,
                bandwidth: 0.0,
                lag: (0.0, 0.0),
                bends: false,
            };
            Self {
                caps: Caps {
                    name: "slow".to_owned(),
                    arms: vec!["left".to_owned(), "right".to_owned()],
                    groups: vec![group("left", 0), group("right", 1)],
                    channels: vec![ChannelCaps {
                        name: "light".to_owned(),
                        rate: 10.0,
                        resolution: 0.0,
                        full_scale: 1.0,
                    }],
                    least_power: 100,
                    bond: 0.0,
                    cycle: 0.0,
                },
                now: 0.0,
                ends: Vec::new(),
                light: 0.0,
                unobserved: Unobserved,
            }
        }
    }

    impl Watched for Slow {
        fn observer(&mut self) -> &mut dyn Observer {
            &mut self.unobserved
        }
    }

    impl Bench for Slow {
        fn caps(&self) -> &Caps {
            &self.caps
        }
        fn now(&self) -> f64 {
            self.now
        }
        fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
            let ticket = Ticket(10 * group.0 as u64 + self.ends.len() as u64);
            let Law::Line { to, .. } = law else {
                return Err(Refused::State("lines only".to_owned()));
            };
            self.ends.push((ticket, self.now + to.distance()));
            Ok(ticket)
        }
        fn bend(&mut self, ticket: Ticket, _: Law) -> Result<f64, Refused> {
            Err(Refused::Ticket(ticket.0))
        }
        fn request(&mut self, _: Request) -> Result<Ticket, Refused> {
            Err(Refused::State("nothing".to_owned()))
        }
        fn next(&mut self, by: f64) -> Result<Event, Fault> {
            self.ends.sort_by(|a, b| a.1.total_cmp(&b.1));
            let end = self.ends.first().map_or(f64::INFINITY, |(_, end)| *end);
            self.now = by.min(end).min(self.light);
            if self.now == end {
                return Ok(Event::Done(self.ends.remove(0).0));
            }
            if self.now == self.light {
                self.light += 0.1;
                let (time, volts) = (self.now, vec![self.now]);
                return Ok(Event::Light(Light { time, volts }));
            }
            Ok(Event::Time)
        }
        fn pose(&self, _: Group, _: f64) -> Option<Estimate> {
            None
        }
        fn stop(&mut self) {}
    }

    async fn line(bench: &Reactor<'_>, group: usize, way: f64) -> Result<f64, Halt> {
        let to = Pose::at(way, 0.0, 0.0);
        let limits = Limits::default();
        let ticket = bench.play(Group(group), Law::Line { to, limits });
        let ticket = ticket.map_err(|why| refused(&why))?;
        bench.done(vec![ticket], 60.0).await?;
        Ok(bench.now())
    }

    #[test]
    fn two_lines_take_as_long_as_the_longer_one() {
        let mut slow = Slow::new();
        let bench = Reactor::new(&mut slow);
        let left = async {
            line(&bench, 0, 0.55).await?;
            line(&bench, 0, 0.25).await
        };
        let watch = async {
            let mut seen = 0;
            while !bench.is_past(1.0) {
                seen += u32::from(bench.sample(0, 1.0).await?.is_some());
            }
            Ok::<_, Halt>(seen)
        };
        let both = both_well(left, both_well(line(&bench, 1, 2.0), watch));
        let (left, (right, seen)) = bench.run(both).expect("nothing fails");
        assert!(
            (left - 0.8).abs() < 1e-12 && (right - 2.0).abs() < 1e-12,
            "{left} {right}"
        );
        assert!((10..=11).contains(&seen), "{seen}");
    }

    #[test]
    fn one_that_fails_leaves_no_motion_behind() {
        let mut slow = Slow::new();
        let bench = Reactor::new(&mut slow);
        let fails = async {
            bench.wait(0.3).await?;
            Err::<(), Halt>(Outcome::NothingSearched.into())
        };
        let result = bench.run(both_well(fails, line(&bench, 1, 1.5)));
        assert!(matches!(
            result,
            Err(Halt::Outcome(Outcome::NothingSearched))
        ));
        assert!((bench.now() - 1.5).abs() < 1e-12 && !bench.moving(Group(1)));
    }

    #[test]
    fn a_paused_run_hears_what_has_ended_meanwhile() {
        let mut slow = Slow::new();
        let bench = Reactor::new(&mut slow);
        let (mut lights, mut steps) = (0, 0);
        let control = async {
            let at = line(&bench, 0, 0.45).await?;
            Ok::<_, Halt>((at, bench.now()))
        };
        // Paused from the third light to the tenth; the motion ends in between.
        let mut gate = |event: &Event| {
            steps += 1;
            lights += u32::from(matches!(event, Event::Light(_)));
            if (3..10).contains(&lights) {
                Go::Wait
            } else {
                Go::On
            }
        };
        let (at, _) = bench
            .run_heard(control, &(), &mut gate)
            .expect("nothing fails");
        assert!((at - 0.9).abs() < 0.05, "{at}");
        assert!(steps >= 10, "{steps}");
    }
}
