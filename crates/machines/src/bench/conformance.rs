//! What is true of every bench. Whoever implements one runs these checks on it.
//!
//! Each check wants a bench that has just begun, without fibers, and moves its groups: a tenth of their range to
//! either side of the middle, and a circle of a fifth of it. On hardware, see that nothing stands in the way. What a pose or
//! a sample may err by is the datasheet's ([`Caps`]).
//!
//! ```
//! use pigtail_machines::bench::conformance::CHECKS;
//! # use pigtail_hal::bench::spec::BenchSpec;
//! # use pigtail_twin::bench::{BenchPlant, BenchTwin};
//! # let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/bench-piezo/");
//! # let read = |file: &str| std::fs::read_to_string(format!("{rig}{file}")).expect("the shipped rig");
//! # let spec = BenchSpec::parse("machine.toml", &read("machine.toml"))?;
//! # let plant = BenchPlant::parse("plant.toml", &read("plant.toml"))?;
//! # let my_bench = || BenchTwin::new(spec.clone(), &plant, 7);
//! for (what, check) in CHECKS {
//!     println!("{what}");
//!     check(&mut my_bench()?);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use pigtail_hal::bench::{
    AxisCaps, Bench, Caps, Degree, Dither, Estimate, Event, Glide, Group, GroupCaps, Knot, Law,
    Lead, Limits, Pose, Refused, Request, Stage, Ticket,
};

/// A check panics, in words, where it does not hold.
pub type Check = fn(&mut dyn Bench);

/// All of them, with what each is of.
pub const CHECKS: [(&str, Check); 8] = [
    ("what it says of itself is whole", is_whole),
    (
        "what cannot be played is refused in words, and nothing moves",
        refuses,
    ),
    (
        "no fiber is loaded for a port that is not there",
        knows_its_ports,
    ),
    (
        "a line ends where it was told to, as well as the datasheet says",
        lines_end,
    ),
    ("light comes in order and at its rate", light_comes),
    (
        "groups move side by side, and what is replaced is never done",
        side_by_side,
    ),
    ("what comes to rest is done", rests),
    ("a stop holds", stop_holds),
];

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

fn middle_of(caps: &Caps, group: usize) -> Pose {
    let at = |i: usize| {
        caps.groups[group].axes[i].map_or(0.0, |axis| 0.5 * (axis.range.0 + axis.range.1))
    };
    Pose(std::array::from_fn(at))
}

fn is_whole(bench: &mut dyn Bench) {
    let caps = bench.caps();
    assert!(!caps.channels.is_empty() && caps.bond > 0.0);
    for (index, group) in caps.groups.iter().enumerate() {
        assert!(group.arm < caps.arms.len());
        assert_eq!(caps.group(group.arm, group.stage), Some(Group(index)));
        for axis in group.axes.iter().flatten() {
            assert!(axis.range.0 < axis.range.1);
            assert!(axis.resolution > 0.0 && axis.speed > 0.0);
        }
        let now = bench.now();
        assert!(bench.pose(Group(index), now).is_some(), "{}", group.name);
    }
}

/// Laws that nothing plays: the group, and what the refusal says.
fn unplayable(caps: &Caps) -> Vec<(Group, Law, &'static str)> {
    let (Some(fine), Some(coarse)) = (caps.group(0, Stage::Fine), caps.group(0, Stage::Coarse))
    else {
        return Vec::new();
    };
    let Some(across) = caps.groups[fine.0].axes[0] else {
        return Vec::new();
    };
    let far = across.range.1;
    let bandwidth = caps.groups[fine.0].bandwidth;
    // What plays lines only, or knows no speed, has fewer laws to refuse.
    let applies = |law: &Law, part: &str| match law {
        _ if part == "m/s" => across.speed.is_finite() && bandwidth > 0.0,
        Law::Scan(_) | Law::Dither(_) => bandwidth > 0.0 || part == "lines only",
        _ => true,
    };
    let knot = |time, x| Knot {
        time,
        at: Pose::at(x, 0.0, 0.0),
    };
    let led = |group| {
        let lead = Lead {
            group,
            from: Pose::ZERO,
            gain: [[0.0; 3]; 2],
        };
        Law::Dither(Dither {
            lead: Some(lead),
            ..circle(0.1 * far, bandwidth)
        })
    };
    let unknown = Group(caps.groups.len());
    let laws = vec![
        (unknown, Law::Brake, "there is no group"),
        (fine, line(Pose::at(f64::NAN, 0.0, 0.0)), "not a number"),
        (
            fine,
            line(Pose::at(0.0, f64::INFINITY, 0.0)),
            "not a number",
        ),
        (fine, line(Pose::at(0.0, 0.0, 1.01 * far)), "z at"),
        (fine, line(Pose::ZERO.with(Degree::Rx, 0.1)), "rx at"),
        (
            fine,
            Law::Line {
                to: Pose::ZERO,
                limits: Limits { speed: Some(0.0) },
            },
            "speed",
        ),
        (fine, Law::Scan(Vec::new()), "no knots"),
        (
            fine,
            Law::Scan(vec![knot(0.1, 0.0), knot(0.1, far)]),
            "increase",
        ),
        (
            fine,
            Law::Scan(vec![knot(0.0, 0.0), knot(1e-6, far)]),
            "m/s",
        ),
        (fine, Law::Scan(vec![knot(f64::NAN, 0.0)]), "increase"),
        (fine, Law::Dither(circle(2.0 * far, bandwidth)), "x at"),
        (fine, Law::Dither(circle(-0.1 * far, bandwidth)), "radius"),
        (
            fine,
            Law::Dither(circle(f64::NAN, bandwidth)),
            "not a number",
        ),
        (
            fine,
            Law::Dither(circle(0.1 * far, 2.0 * bandwidth)),
            "turns a second",
        ),
        (fine, led(unknown), "there is no group"),
        (fine, led(fine), "lead itself"),
        (
            coarse,
            Law::Dither(circle(0.1 * far, bandwidth)),
            "lines only",
        ),
    ];
    laws.into_iter()
        .filter(|(_, law, part)| applies(law, part))
        .collect()
}

/// Where all groups are, and when.
fn poses(bench: &dyn Bench) -> (f64, Vec<Option<Estimate>>) {
    let now = bench.now();
    let groups = 0..bench.caps().groups.len();
    (
        now,
        groups.map(|group| bench.pose(Group(group), now)).collect(),
    )
}

fn refuses(bench: &mut dyn Bench) {
    let before = poses(bench);
    for (group, law, part) in unplayable(&bench.caps().clone()) {
        let said = format!("{law:?}");
        let refused = bench.play(group, law).expect_err(&said).to_string();
        assert!(refused.contains(part), "{said}: {refused}");
    }
    let never = bench.bend(Ticket(u64::MAX), Law::Brake);
    assert!(matches!(never, Err(Refused::Ticket(_))), "{never:?}");
    let arm = bench.caps().arms.len();
    for request in [Request::Load { arm, port: 0 }, Request::Attach { arm }] {
        let refused = bench.request(request).expect_err("there is no such arm");
        let refused = refused.to_string();
        assert!(refused.contains("there is no arm"), "{refused}");
    }
    for request in [Request::Attach { arm: 0 }, Request::Unload { arm: 0 }] {
        assert!(bench.request(request).is_err(), "{request:?}");
    }
    assert_eq!(before, poses(bench));
}

fn knows_its_ports(bench: &mut dyn Bench) {
    // The bench may know them, or the machine behind it.
    let Ok(ticket) = bench.request(Request::Load { arm: 0, port: 99 }) else {
        return;
    };
    let by = bench.now() + 60.0;
    loop {
        match bench.next(by) {
            Err(_) => return,
            Ok(Event::Failed(failed, _)) if failed == ticket => return,
            Ok(Event::Time) => panic!("it has loaded a fiber for port 99"),
            Ok(event) => assert_ne!(event, Event::Done(ticket)),
        }
    }
}

fn lines_end(bench: &mut dyn Bench) {
    let caps = bench.caps().clone();
    for (index, group) in caps.groups.iter().enumerate() {
        let reach = group
            .axes
            .iter()
            .flatten()
            .map(|axis| axis.range.1 - axis.range.0);
        let some = 0.1 * reach.fold(f64::INFINITY, f64::min);
        let by = |axis: Option<_>| axis.map_or(0.0, |_: AxisCaps| some);
        let to = middle_of(&caps, index) + Pose(group.axes.map(by));
        let ticket = bench.play(Group(index), line(to)).expect("it is in reach");
        until(bench, ticket);
        let at = bench.pose(Group(index), bench.now()).expect("it is known");
        for (axis, off) in group.axes.iter().zip((at.pose - to).0) {
            let Some(axis) = axis else { continue };
            let most = 6.0 * axis.repeatability + axis.resolution;
            assert!(off.abs() <= most, "{} is {off:e} off", group.name);
        }
    }
}

fn light_comes(bench: &mut dyn Bench) {
    let rate = bench.caps().channels[0].rate;
    let channels = bench.caps().channels.len();
    let end = bench.now() + 100.0 / rate;
    let slack = 0.5 * bench.caps().cycle + 1e-9;
    let (mut heard, mut before) = (Vec::new(), bench.now());
    loop {
        let event = bench.next(end).expect("it is well");
        assert!(bench.now() >= before && bench.now() <= end + slack);
        before = bench.now();
        match event {
            Event::Light(light) => {
                assert_eq!(light.volts.len(), channels);
                assert!(light.time <= before);
                heard.push(light.time);
            }
            Event::Frame(frame) => assert!(frame.time <= before),
            Event::Time => break,
            event => panic!("{event:?}"),
        }
    }
    assert!((before - end).abs() < slack);
    assert!(heard.windows(2).all(|two| two[0] < two[1]));
    assert!((98..=101).contains(&heard.len()), "{} samples", heard.len());
    // What is past is over at once.
    assert!(bench.next(0.0).is_ok());
    assert_eq!(bench.now(), before);
}

fn side_by_side(bench: &mut dyn Bench) {
    let caps = bench.caps().clone();
    let coarse: Vec<Group> = (0..caps.arms.len())
        .filter_map(|arm| caps.group(arm, Stage::Coarse))
        .collect();
    let [one, other, ..] = *coarse else { return };
    let Some(across) = caps.groups[one.0].axes[0] else {
        return;
    };
    let to = |x: f64| line(Pose::at(x, 0.0, 0.0));
    let way = 0.2 * across.range.1;
    let alone = {
        let since = bench.now();
        let ticket = bench.play(one, to(way)).expect("it plays");
        until(bench, ticket);
        bench.now() - since
    };
    let since = bench.now();
    let replaced = bench.play(one, to(-way)).expect("it plays");
    let soon = since + 0.3 * alone;
    assert!(!events(bench, soon).contains(&Event::Done(replaced)));
    // It is on its way now.
    let tickets = [
        bench.play(one, to(0.0)).expect("it plays"),
        bench.play(other, to(way)).expect("it plays"),
    ];
    assert!(replaced != tickets[0] && tickets[0] != tickets[1]);
    assert!(bench.bend(replaced, Law::Brake).is_err());
    let mut left = tickets.to_vec();
    while !left.is_empty() {
        match bench.next(since + 60.0).expect("it is well") {
            Event::Done(ticket) => {
                assert!(ticket != replaced);
                left.retain(|of| *of != ticket);
            }
            Event::Time => panic!("{left:?} are not done"),
            _ => {}
        }
    }
    // One after the other would be 2.3 times that.
    assert!(bench.now() - since < 1.8 * alone);
}

/// A group that plays circles, and its axis across.
fn dithers(caps: &Caps) -> Option<(Group, GroupCaps, AxisCaps)> {
    let mut groups = caps.groups.iter().enumerate();
    groups.find_map(|(index, group)| {
        let axis = group.axes[0].filter(|_| group.bandwidth > 0.0)?;
        Some((Group(index), group.clone(), axis))
    })
}

/// A rate of circles within which a group comes to rest, turns a second.
fn slowly(of: &GroupCaps) -> f64 {
    of.bandwidth.min(of.settling.recip())
}

/// Events until a time.
fn events(bench: &mut dyn Bench, by: f64) -> Vec<Event> {
    let mut events = Vec::new();
    loop {
        match bench.next(by).expect("it is well") {
            Event::Time => return events,
            event => events.push(event),
        }
    }
}

fn rests(bench: &mut dyn Bench) {
    let caps = bench.caps().clone();
    for (index, of) in caps.groups.iter().enumerate() {
        let group = Group(index);
        let Some(axis) = of.axes[0] else { continue };
        let way = 0.2 * axis.range.1;
        let to = line(Pose::at(way, 0.0, 0.0));
        // A line is left for a brake, and a brake for a line.
        let left = bench.play(group, to.clone()).expect("it plays");
        let soon = bench.now() + of.settling;
        let mut before = events(bench, soon);
        let brake = bench.play(group, Law::Brake).expect("it brakes");
        if !before.contains(&Event::Done(left)) {
            before = until(bench, brake);
            assert!(!before.contains(&Event::Done(left)));
            let held = bench.pose(group, bench.now()).expect("known").pose;
            let later = bench.now() + of.settling;
            events(bench, later);
            let moved = (bench.pose(group, bench.now()).expect("known").pose - held).distance();
            let most = 12.0 * axis.repeatability + axis.resolution;
            assert!(moved < most, "{} moved by {moved:e} at rest", of.name);
        }
        let back = bench.play(group, line(Pose::ZERO)).expect("it plays");
        until(bench, back);
        if of.bandwidth == 0.0 {
            continue;
        }
        // A circle goes on, and with no radius left it is over.
        let law = |radius| {
            let mut law = circle(radius, slowly(of));
            law.radius.within = of.settling;
            Law::Dither(law)
        };
        let ticket = bench.play(group, law(way)).expect("it plays");
        let later = bench.now() + 5.0 * of.settling;
        assert!(!events(bench, later).contains(&Event::Done(ticket)));
        if of.bends {
            bench.bend(ticket, law(0.0)).expect("it bends");
            until(bench, ticket);
            assert!(bench.bend(ticket, law(0.0)).is_err());
        }
        // A scan ends at its last knot.
        let at = Pose::at(0.5 * way, 0.0, 0.0);
        let time = of.settling.max(way / axis.speed * 2.0);
        let knots = [(time, at), (3.0 * time, Pose::ZERO), (5.0 * time, at)];
        let scan = knots.map(|(time, at)| Knot { time, at });
        let since = bench.now();
        let ticket = bench
            .play(group, Law::Scan(scan.to_vec()))
            .expect("it plays");
        until(bench, ticket);
        assert!(bench.now() - since >= 5.0 * time - caps.cycle);
        let off = (bench.pose(group, bench.now()).expect("known").pose - at).distance();
        assert!(off < 12.0 * axis.repeatability + axis.resolution, "{off:e}");
    }
}

fn stop_holds(bench: &mut dyn Bench) {
    let Some((fine, of, axis)) = dithers(bench.caps()) else {
        return;
    };
    let law = Law::Dither(circle(0.2 * axis.range.1, slowly(&of)));
    let ticket = bench.play(fine, law).expect("it plays");
    let by = bench.now() + 0.1;
    while bench.next(by).expect("it is well") != Event::Time {}
    bench.stop();
    let by = bench.now() + 3.0 * of.settling;
    while bench.next(by).is_ok_and(|event| event != Event::Time) {}
    let at = |bench: &dyn Bench, time| bench.pose(fine, time).expect("known").pose;
    let held = at(bench, bench.now());
    let by = bench.now() + 0.2;
    while let Ok(event) = bench.next(by) {
        assert!(event != Event::Done(ticket));
        if event == Event::Time {
            break;
        }
    }
    let moved = (at(bench, bench.now()) - held).distance();
    assert!(moved < 12.0 * axis.repeatability, "it moved by {moved:e}");
}
