//! What is true of every bench, and what a guard makes of one that does not keep to its word.

use pigtail_hal::bench::spec::BenchSpec;
use pigtail_hal::bench::{
    Bench, Caps, Dither, Estimate, Event, Glide, Group, Knot, Law, Light, Limits, Pose, Refused,
    Request, Ticket,
};
use pigtail_hal::{Fault, Rule};
use pigtail_machines::bench::conformance::CHECKS;
use pigtail_machines::bench::record::{Recorder, Replay};
use pigtail_machines::bench::{Guard, Plane};
use pigtail_twin::bench::{BenchPlant, BenchTwin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

fn twin(seed: u64) -> BenchTwin {
    let spec = include_str!("../../../rigs/bench-piezo/machine.toml");
    let plant = include_str!("../../../rigs/bench-piezo/plant.toml");
    let spec = BenchSpec::parse("machine.toml", spec).expect("it ships");
    let plant = BenchPlant::parse("plant.toml", plant).expect("it ships");
    BenchTwin::new(spec, &plant, seed).expect("it ships")
}

/// Every bench there is: what is true of a bench is true of each of them.
fn benches() -> Vec<(&'static str, Box<dyn Bench>)> {
    vec![
        ("twin", Box::new(twin(1))),
        ("guarded twin", Box::new(Guard::new(twin(2)))),
        (
            "recorded twin",
            Box::new(Recorder::new(Guard::new(twin(4)), std::io::sink())),
        ),
        (
            "twin guarded twice",
            Box::new(Guard::new(Guard::new(twin(3)))),
        ),
    ]
}

fn line(to: Pose) -> Law {
    let limits = Limits::default();
    Law::Line { to, limits }
}

fn circle(radius: f64, rate: f64) -> Dither {
    Dither {
        centre: Glide::at_once([0.0; 2]),
        radius: Glide::at_once(radius),
        rate,
        lead: None,
        widens: None,
    }
}

/// Lets time pass until a ticket is done; the events before.
fn until(bench: &mut dyn Bench, ticket: Ticket) -> Vec<Event> {
    let mut events = Vec::new();
    let by = bench.now() + 60.0;
    loop {
        match bench.next(by).expect("it is well") {
            Event::Done(done) if done == ticket => return events,
            Event::Time => panic!("ticket {ticket} is not done within a minute"),
            event => events.push(event),
        }
    }
}

#[test]
fn what_is_true_of_every_bench_is_true_of_each() {
    for (what, check) in CHECKS {
        for (name, mut bench) in benches() {
            println!("{name}: {what}");
            check(&mut *bench);
        }
    }
}

/// In what way a bench does not keep to its word.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Bad {
    Late,
    Twice,
    FromTheFuture,
    Unasked,
    Backwards,
    Early,
    Silent,
    Lost,
    Infinite,
    Short,
    Empty,
}

/// A twin that does not, from a time on.
struct Broken {
    twin: BenchTwin,
    bad: Bad,
    back: bool,
}

const FROM: f64 = 0.5;

impl Bench for Broken {
    fn caps(&self) -> &Caps {
        self.twin.caps()
    }
    fn now(&self) -> f64 {
        if self.back { 0.0 } else { self.twin.now() }
    }
    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        self.twin.play(group, law)
    }
    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        self.twin.bend(ticket, law)
    }
    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        self.twin.request(what)
    }
    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        loop {
            let mut event = self.twin.next(by)?;
            if self.twin.now() < FROM {
                return Ok(event);
            }
            let Event::Light(light) = &mut event else {
                return Ok(event);
            };
            match self.bad {
                Bad::Late => light.time -= 0.6,
                Bad::Twice => light.time = FROM - 0.02,
                Bad::FromTheFuture => light.time += 1.0,
                Bad::Unasked => event = Event::Done(Ticket(4711)),
                Bad::Backwards => self.back = true,
                Bad::Early => event = Event::Time,
                Bad::Silent => continue,
                Bad::Lost => {
                    return Err(Fault {
                        rule: Rule::SensorSilence,
                        axis: "bench".to_owned(),
                        value: "the connection is lost".to_owned(),
                        limit: "one".to_owned(),
                        time: self.twin.now(),
                    });
                }
                Bad::Infinite => light.volts[0] = f64::INFINITY,
                Bad::Short => light.volts.clear(),
                Bad::Empty => event = Event::Batch(Vec::new()),
            }
            return Ok(event);
        }
    }
    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        self.twin.pose(group, at)
    }
    fn stop(&mut self) {
        self.twin.stop();
    }
}

#[test]
fn a_bench_that_does_not_keep_to_its_word_is_stopped_in_words() {
    for (bad, rule, part) in [
        (Bad::Late, Rule::EventOrder, "light of"),
        (Bad::Twice, Rule::EventOrder, "light of"),
        (Bad::FromTheFuture, Rule::EventOrder, "light of"),
        (Bad::Unasked, Rule::EventOrder, "ticket 4711"),
        (Bad::Backwards, Rule::EventOrder, "a time of 0.000000 s"),
        (Bad::Early, Rule::EventOrder, "nothing until"),
        (Bad::Silent, Rule::SensorSilence, "no light for"),
        (Bad::Lost, Rule::SensorSilence, "connection"),
        (Bad::Infinite, Rule::SensorSilence, "inf"),
        (Bad::Short, Rule::SensorSilence, "[]"),
        (Bad::Empty, Rule::EventOrder, "without light"),
    ] {
        let broken = Broken {
            twin: twin(5),
            bad,
            back: false,
        };
        let mut bench = Guard::new(broken);
        let fault = loop {
            match bench.next(30.0) {
                Ok(event) => assert!(event != Event::Time, "{bad:?} is not noticed"),
                Err(fault) => break fault,
            }
        };
        assert_eq!(fault.rule, rule, "{bad:?}");
        assert!(fault.to_string().contains(part), "{bad:?}: {fault}");
        assert!(
            bad == Bad::Backwards || (FROM..FROM + 1.0).contains(&fault.time),
            "{fault}"
        );
        // It stays stopped.
        assert_eq!(bench.next(60.0), Err(fault), "{bad:?}");
        let refused = bench
            .play(Group(1), Law::Brake)
            .expect_err("it has stopped");
        assert!(refused.to_string().contains("has stopped"), "{refused}");
        assert!(bench.request(Request::Laser(true)).is_err(), "{bad:?}");
    }
}

#[test]
fn a_bench_that_keeps_to_its_word_is_not_stopped() {
    // Half a minute without anything to do, and with both arms at work.
    let mut bench = Guard::new(twin(6));
    while bench.next(15.0).expect("it is well") != Event::Time {}
    let law = |group: usize| match group % 2 {
        0 => line(Pose::at(0.5e-3, 0.5e-3, 0.5e-3)),
        _ => Law::Dither(circle(5e-6, 15.0)),
    };
    for group in 0..4 {
        bench.play(Group(group), law(group)).expect("it plays");
    }
    while bench.next(30.0).expect("it is well") != Event::Time {}
}

#[test]
fn a_facet_that_was_taught_is_never_passed() {
    let plane = |port, z| Plane { arm: 0, port, z };
    let mut bench = Guard::new(twin(7)).with_planes(vec![plane(0, 1e-3)]);
    let z = |z| line(Pose::at(0.0, 0.0, z));
    let refused = bench
        .play(Group(0), z(1.001e-3))
        .expect_err("behind the facet");
    assert!(refused.to_string().contains("facet"), "{refused}");
    // Together they would.
    let near = bench.play(Group(0), z(0.995e-3)).expect("before the facet");
    let refused = bench
        .play(Group(1), z(6e-6))
        .expect_err("behind the facet with both");
    assert!(refused.to_string().contains("facet"), "{refused}");
    let knot = |time, z| Knot {
        time,
        at: Pose::at(0.0, 0.0, z),
    };
    // On the way there, if not at its end.
    let scan = Law::Scan(vec![knot(0.0, 0.0), knot(0.1, 6e-6), knot(0.2, 0.0)]);
    assert!(bench.play(Group(1), scan).is_err());
    bench.play(Group(1), z(4e-6)).expect("before the facet");
    until(&mut bench, near);
    // The other arm has no plane.
    bench.play(Group(2), z(1.9e-3)).expect("it is free");
    let back = bench.play(Group(0), z(0.9e-3)).expect("away from it");
    until(&mut bench, back);
    bench.play(Group(1), z(9e-6)).expect("far from the facet");
    // A motion that is bent is looked at as well.
    let bent = bench.play(Group(0), z(0.95e-3)).expect("before the facet");
    assert!(bench.bend(bent, z(0.995e-3)).is_err());
    bench.bend(bent, z(0.98e-3)).expect("before the facet");
}

#[test]
fn a_button_and_a_deadline_stop_it() {
    let stop = Arc::new(AtomicBool::new(false));
    let mut bench = Guard::new(twin(8)).with_stop(stop.clone());
    assert!(bench.next(1.0).is_ok());
    stop.store(true, Ordering::Relaxed);
    let fault = bench.next(2.0).expect_err("it was asked to stop");
    assert_eq!(fault.rule, Rule::StopRequest);
    let mut bench = Guard::new(twin(8)).with_longest(2.0);
    let fault = loop {
        if let Err(fault) = bench.next(10.0) {
            break fault;
        }
    };
    assert_eq!(fault.rule, Rule::Deadline);
    assert!((2.0..2.1).contains(&fault.time), "{fault}");
}

#[test]
fn the_same_calls_give_the_same_events() {
    let run = |seed| {
        let mut bench = Guard::new(twin(seed));
        bench
            .request(Request::Load { arm: 1, port: 0 })
            .expect("it may");
        bench
            .play(Group(3), Law::Dither(circle(3e-6, 5.0)))
            .expect("it plays");
        let mut events: Vec<Event> = Vec::new();
        while bench.now() < 3.0 {
            events.push(bench.next(3.0).expect("it is well"));
        }
        (events, bench.pose(Group(3), 3.0))
    };
    assert_eq!(run(9), run(9));
    assert_ne!(run(9), run(10));
    let light = |event: &Event| matches!(event, Event::Light(Light { .. }));
    assert!(run(9).0.iter().filter(|event| light(event)).count() > 290);
}

/// What a recorded run is repeated with, and all that it sees.
fn work(bench: &mut dyn Bench) -> (Vec<Event>, Vec<Option<Estimate>>, Vec<String>) {
    let (mut events, mut poses, mut refused) = (Vec::new(), Vec::new(), Vec::new());
    let load = bench
        .request(Request::Load { arm: 1, port: 0 })
        .expect("it may");
    events.extend(until(bench, load));
    let far = bench.play(Group(3), line(Pose::at(1.0, 0.0, 0.0)));
    refused.push(far.expect_err("it is far").to_string());
    let ticket = bench
        .play(Group(3), Law::Dither(circle(3e-6, 5.0)))
        .expect("it plays");
    for k in 1..40 {
        events.push(bench.next(bench.now() + 0.02).expect("it is well"));
        poses.push(bench.pose(Group(3), bench.now() - 0.01));
        if k == 20 {
            bench
                .bend(ticket, Law::Dither(circle(1e-6, 5.0)))
                .expect("it bends");
        }
    }
    bench.stop();
    (events, poses, refused)
}

#[test]
fn a_record_is_repeated_to_the_last_bit_and_nothing_else_is() {
    let mut recorder = Recorder::new(twin(11), Vec::new());
    let caps = recorder.caps().clone();
    let before = work(&mut recorder);
    let record = recorder.finish().expect("memory");
    let replay = || Replay::read(caps.clone(), &record[..]).expect("it was recorded");
    let (events, poses, refused) = work(&mut replay());
    assert_eq!((&events, &poses), (&before.0, &before.1));
    // Why it was refused is kept in words.
    assert_eq!(refused, before.2);
    // Asked otherwise, or for more.
    let mut other = replay();
    assert!(other.play(Group(0), Law::Brake).is_err());
    assert_eq!(
        other.next(1.0).expect_err("it differs").rule,
        Rule::ReplayDiffers
    );
    let mut more = replay();
    work(&mut more);
    assert_eq!(more.next(99.0).expect_err("it ends").rule, Rule::ReplayEnds);
    // A record that was cut ends earlier; one that is none is said to be none.
    let cut = &record[..record.len() / 2];
    assert!(Replay::read(caps.clone(), cut).is_ok());
    assert!(Replay::read(caps.clone(), &b"{\"begin\":0.0}\nnot\n{}\n"[..]).is_err());
    assert!(Replay::read(caps, &b""[..]).is_err());
}
