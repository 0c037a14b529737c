//! What of a bench's twin crosses the wires: laws, requests, events and poses.

use super::motion::STEP;
use super::{BenchTwin, Busy, places};
use pigtail_hal::bench::{
    Bench, Caps, Estimate, Event, Group, Law, Refused, Request, Stage, Ticket,
};
use pigtail_hal::{Fault, Rule};

impl BenchTwin {
    /// Whether an arm may do what it is asked for.
    fn may(&self, request: &Request) -> Result<(), Refused> {
        self.caps.answers(request)?;
        let state = |text: String| Err(Refused::State(text));
        if matches!(request, Request::Handle { .. }) {
            return state("this bench has neither gripper, dispenser nor lamp".to_owned());
        }
        let (Request::Load { arm, .. } | Request::Attach { arm } | Request::Unload { arm }) =
            *request
        else {
            return Ok(());
        };
        let name = &self.caps.arms[arm];
        let at_it = |busy: &Busy| match busy.request {
            Request::Load { arm: at, .. }
            | Request::Attach { arm: at }
            | Request::Unload { arm: at } => at == arm,
            Request::Laser(_) | Request::LaserPower { .. } | Request::Handle { .. } => false,
        };
        if self.busy.iter().any(at_it) {
            return state(format!("{name} is busy with a fiber"));
        }
        let carries = self.arms[arm].carried.is_some();
        match *request {
            Request::Load { .. } if carries => state(format!("{name} carries a fiber already")),
            Request::Load { port, .. } => {
                if self.tray[arm].iter().any(|fiber| fiber.port == port) {
                    return Ok(());
                }
                state(format!("the tray of {name} has no fiber {port}"))
            }
            _ if !carries => state(format!("{name} carries no fiber")),
            _ => Ok(()),
        }
    }
}

impl Bench for BenchTwin {
    fn caps(&self) -> &Caps {
        &self.caps
    }

    fn now(&self) -> f64 {
        self.now
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        self.caps.accepts(group, &law)?;
        let ticket = self.ticket();
        self.begin(group, Some(ticket), law);
        Ok(ticket)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        let plays = |group: &usize| {
            let (arm, stage) = places(*group);
            let arm = &self.arms[arm];
            let of = match stage {
                Stage::Coarse => &arm.coarse,
                Stage::Fine => &arm.fine,
            };
            of.ticket() == Some(ticket)
        };
        let group = (0..self.caps.groups.len()).find(plays);
        let group = group.map(Group).ok_or(Refused::Ticket(ticket.0))?;
        self.caps.accepts(group, &law)?;
        self.begin(group, Some(ticket), law);
        Ok(self.now)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        self.may(&what)?;
        let seconds = match what {
            Request::Laser(_) | Request::LaserPower { .. } | Request::Handle { .. } => STEP,
            Request::Load { .. } | Request::Unload { .. } => self.spec.handling.load,
            Request::Attach { .. } => self.spec.handling.bond,
        };
        let ticket = self.ticket();
        self.busy.push(Busy {
            ticket,
            request: what,
            until: self.now + seconds,
            sum: [0.0; 3],
            steps: 0,
        });
        Ok(ticket)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        if by.is_nan() {
            return Err(Fault {
                rule: Rule::CommandNumber,
                axis: self.caps.name.clone(),
                value: "a time that is not a number".to_owned(),
                limit: "a time".to_owned(),
                time: self.now,
            });
        }
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(event);
            }
            let next = (self.step + 1) as f64 * STEP;
            if next > by + 1e-9 {
                self.now = self.now.max(by);
                return Ok(Event::Time);
            }
            self.advance();
        }
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        let (arm, stage) = places(group.0);
        let measured = &self.arms.get(arm)?.measured[stage as usize];
        let back = (self.step as f64 * STEP - at) / STEP;
        // Between steps nothing is newer than the last one.
        let back = if at <= self.now { back.max(0.0) } else { back };
        if !(0.0..=(measured.len() - 1) as f64).contains(&back) {
            return None;
        }
        let last = measured.len() - 1;
        let (low, share) = (back.floor() as usize, back.fract());
        let newer = measured[last - low];
        let older = measured[last - (low + 1).min(last)];
        Some(Estimate {
            pose: newer + (older - newer) * share,
            measured: true,
        })
    }

    fn stop(&mut self) {
        for group in 0..self.caps.groups.len() {
            self.begin(Group(group), None, Law::Brake);
        }
        // What was asked for is not done any more.
        self.busy.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Specimen;
    use crate::bench::{Arm, BenchPlant};
    use pigtail_hal::bench::spec::BenchSpec;
    use pigtail_hal::bench::{Dither, Glide, Knot, Lead, Limits, Pose};
    use pigtail_hal::spec::Side;

    fn twin(seed: u64) -> BenchTwin {
        let spec = include_str!("../../../../rigs/bench-piezo/machine.toml");
        let plant = include_str!("../../../../rigs/bench-piezo/plant.toml");
        let spec = BenchSpec::parse("machine.toml", spec).expect("it ships");
        let plant = BenchPlant::parse("plant.toml", plant).expect("it ships");
        BenchTwin::new(spec, &plant, seed).expect("it ships")
    }

    fn line(to: Pose) -> Law {
        let limits = Limits::default();
        Law::Line { to, limits }
    }

    fn until(bench: &mut BenchTwin, ticket: Ticket) -> Vec<f64> {
        let mut volts = Vec::new();
        loop {
            match bench.next(bench.now() + 30.0).expect("it is well") {
                Event::Done(done) if done == ticket => return volts,
                Event::Light(light) => volts.push(light.volts[0]),
                Event::Time => panic!("{ticket} does not end"),
                _ => {}
            }
        }
    }

    fn go(bench: &mut BenchTwin, group: usize, to: Pose) {
        let ticket = bench.play(Group(group), line(to)).expect("in reach");
        until(bench, ticket);
    }

    fn ask(bench: &mut BenchTwin, request: Request) {
        let ticket = bench.request(request).expect("it may");
        until(bench, ticket);
    }

    /// The poses that the shipped calibration has of input and first output.
    const TAUGHT: [Pose; 2] = [
        Pose::at(0.3e-3, -0.2e-3, 1.2e-3),
        Pose::at(-0.1e-3, 0.1e-3, 1e-3),
    ];

    #[test]
    fn taught_poses_are_where_fibers_touch_as_well_as_is_said() {
        let (mut across, mut along) = (Vec::new(), Vec::new());
        for seed in 0..60 {
            let mut bench = twin(seed);
            let back = Pose::at(0.0, 0.0, -50e-6);
            for arm in [0, 1] {
                ask(&mut bench, Request::Load { arm, port: 0 });
                go(&mut bench, 2 * arm, TAUGHT[arm] + back);
                let side = Side::ALL[arm];
                let at = bench.carried(side).expect("it was loaded");
                // By design the peak has walked towards x with the gap.
                let walked = 12.46_f64.to_radians().tan() * 50e-6;
                across.extend([at.x + walked, at.y]);
                along.push(at.gap - 50e-6);
            }
            assert!(bench.truth().smallest_gap > 40e-6);
        }
        let rms = |of: &[f64]| (of.iter().map(|v| v * v).sum::<f64>() / of.len() as f64).sqrt();
        let (across, deviation) = (rms(&across), rms(&along));
        assert!((2e-6..5e-6).contains(&across), "{across}");
        // Half of what repeats itself lies within the coarse group's own repeatability.
        assert!(deviation < 0.25e-6, "{deviation}");
        assert!(along.iter().all(|off| off.abs() < 0.8e-6), "{along:?}");
    }

    #[test]
    fn light_comes_at_its_rate_and_goes_with_the_laser() {
        let mut bench = twin(3);
        for arm in [0, 1] {
            ask(&mut bench, Request::Load { arm, port: 0 });
            go(
                &mut bench,
                2 * arm,
                TAUGHT[arm] + Pose::at(0.0, 0.0, -20e-6),
            );
        }
        let mean = |bench: &mut BenchTwin| {
            let mut times = Vec::new();
            let mut sum = 0.0;
            while times.len() < 50 {
                if let Event::Light(light) = bench.next(f64::INFINITY).expect("it is well") {
                    assert!(light.time <= bench.now());
                    times.push(light.time);
                    sum += light.volts[0];
                }
            }
            assert!(
                times
                    .windows(2)
                    .all(|two| (two[1] - two[0] - 0.01).abs() < 1e-9)
            );
            sum / 50.0
        };
        let dark = mean(&mut bench);
        assert!((dark - 2e-3).abs() < 1e-4, "{dark}");
        ask(&mut bench, Request::Laser(true));
        let lit = mean(&mut bench);
        assert!(lit > 2.0 * dark, "{lit}");
    }

    #[test]
    fn a_line_takes_its_time_and_backlash_is_felt() {
        let mut bench = twin(5);
        let began = bench.now();
        go(&mut bench, 0, Pose::at(1e-3, 0.0, 0.0));
        // A trapezoid: 1 mm at 1 mm/s, and a tenth of a second of 10 mm/s2; then it settles.
        let took = bench.now() - began;
        assert!((1.14..1.25).contains(&took), "{took}");
        let before = bench.arms[0].at[0];
        go(&mut bench, 0, Pose::at(1e-3 - 0.6e-6, 0.0, 0.0));
        assert!((bench.arms[0].at[0] - before).abs() < 30e-9);
        go(&mut bench, 0, Pose::at(1e-3 - 2.6e-6, 0.0, 0.0));
        let gone = before - bench.arms[0].at[0];
        assert!((gone - 1.8e-6).abs() < 0.2e-6, "{gone}");
    }

    #[test]
    fn a_circle_glides_follows_and_comes_to_rest() {
        let mut bench = twin(8);
        let turn = |to: f64, lead| {
            Law::Dither(Dither {
                centre: Glide {
                    to: [1e-6, 0.0],
                    within: 0.1,
                },
                radius: Glide { to, within: 0.1 },
                rate: 5.0,
                lead,
                widens: None,
            })
        };
        let lead = Lead {
            group: Group(0),
            from: Pose::ZERO,
            gain: [[0.0, 0.0, 0.01], [0.0; 3]],
        };
        let ticket = bench
            .play(Group(1), turn(1e-6, Some(lead)))
            .expect("it plays");
        let line = bench
            .play(Group(0), line(Pose::at(0.0, 0.0, 200e-6)))
            .expect("it plays");
        until(&mut bench, line);
        let mut middle = [0.0; 2];
        for _ in 0..200 {
            bench.next(bench.now() + STEP).expect("it is well");
            while bench.events.pop_front().is_some() {}
            for (sum, at) in middle.iter_mut().zip(bench.arms[0].loops_at()) {
                *sum += at / 200.0;
            }
        }
        // One for its own way, two for what it follows.
        assert!((middle[0] - 3e-6).abs() < 20e-9, "{middle:?}");
        assert!(middle[1].abs() < 20e-9, "{middle:?}");
        bench.bend(ticket, turn(0.0, None)).expect("it is played");
        until(&mut bench, ticket);
        let at = bench.pose(Group(1), bench.now()).expect("measured").pose;
        assert!((at - Pose::at(1e-6, 0.0, 0.0)).distance() < 20e-9, "{at:?}");
        assert_eq!(
            bench.bend(ticket, Law::Brake),
            Err(Refused::Ticket(ticket.0))
        );
    }

    impl Arm {
        fn loops_at(&self) -> [f64; 2] {
            [self.fine.told[0], self.fine.told[1]]
        }
    }

    #[test]
    fn a_scan_is_where_it_should_be_and_the_past_is_known() {
        let mut bench = twin(2);
        let knot = |time, x| Knot {
            time,
            at: Pose::at(x, 0.0, 0.0),
        };
        let start = bench.now();
        let scan = vec![knot(0.0, 0.0), knot(0.1, 5e-6), knot(0.3, 5e-6)];
        let ticket = bench.play(Group(1), Law::Scan(scan)).expect("it plays");
        until(&mut bench, ticket);
        let at = |bench: &BenchTwin, time| bench.pose(Group(1), time).expect("remembered").pose.x();
        // Half way, but for the loop's lag of 3.7 ms and the sensor's.
        let half = at(&bench, start + 0.05);
        assert!((half - (2.5e-6 - 4.2e-3 * 50e-6)).abs() < 30e-9, "{half}");
        assert!((at(&bench, start + 0.25) - 5e-6).abs() < 20e-9);
        assert!(bench.pose(Group(1), bench.now() + 1.0).is_none());
        assert!(bench.pose(Group(9), bench.now()).is_none());
    }

    #[test]
    fn a_fiber_is_fixed_where_it_stood_and_the_same_seed_gives_the_same() {
        let run = |seed| {
            let mut bench = twin(seed);
            ask(&mut bench, Request::Load { arm: 0, port: 0 });
            assert!(matches!(
                bench.request(Request::Load { arm: 0, port: 0 }),
                Err(Refused::State(_))
            ));
            go(&mut bench, 0, TAUGHT[0] + Pose::at(0.0, 0.0, -10e-6));
            let stood = bench.carried(Side::Left).expect("carried");
            ask(&mut bench, Request::Attach { arm: 0 });
            assert!(bench.carried(Side::Left).is_none());
            let fixed = bench.truth().input.expect("attached");
            assert!((fixed.x - stood.x).abs() < 30e-9, "{fixed:?} {stood:?}");
            assert!((fixed.gap - stood.gap).abs() < 30e-9);
            (fixed, bench.now())
        };
        assert_eq!(run(4), run(4));
        assert_ne!(run(4).0, run(5).0);
        // Devices on one bench differ, and the bench stays as it is.
        let of = |seed| twin(seed).arms[0].origin;
        assert_eq!(of(4), of(Specimen::of(4, 2).seed()));
        assert_ne!(twin(4).chip, twin(Specimen::of(4, 2).seed()).chip);
    }
}
