//! The guard: what it stops at, how it stops, and that nothing gets past it.

mod common;

use common::{centred, guarded, twin};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::{Axis, Command, Fault, FiberHandling, Machine, Measurement, Rule};
use pigtail_machines::Guard;
use pigtail_twin::faults::Injection;
use pigtail_twin::{Plant, Twin};
use proptest::prelude::*;

fn until_fault(
    machine: &mut impl Machine,
    cycles: usize,
    mut command: impl FnMut(usize, Option<&Measurement>) -> Command,
) -> Option<Fault> {
    let mut last = None;
    for k in 0..cycles {
        match machine.exchange(&command(k, last.as_ref())) {
            Ok(measured) => last = Some(measured),
            Err(fault) => return Some(fault),
        }
    }
    None
}

fn broken(seed: u64, fault: &str) -> Guard<Twin> {
    let mut twin = twin(seed);
    let injection: Injection = fault.parse().expect("a fault");
    twin.inject(&[injection]);
    Guard::new(twin, common::geometry())
}

#[test]
fn a_machine_at_rest_is_left_alone() {
    for seed in 0..20 {
        let mut machine = guarded(seed);
        let command = centred(&machine);
        assert_eq!(until_fault(&mut machine, 5000, |_, _| command), None);
    }
}

#[test]
fn a_machine_that_warms_for_minutes_is_left_alone() {
    // The sensing fiber is seen all the time. After two minutes it is 24 um from where it was, and 12 from the mean of all its frames.
    let warming = "[thermal]\nright = [\"0 um/s\", \"0 um/s\", \"0.2 um/s\"]\n";
    let plant = format!("{}\n{warming}", common::read("plant.toml"));
    let plant = Plant::parse("plant.toml", &plant).expect("a good plant");
    let twin = Twin::new(common::spec(), &plant, 3).expect("a good plant");
    let mut machine = Guard::new(twin, common::geometry());
    let command = centred(&machine);
    let cycles = (120.0 * machine.spec().servo.rate) as usize;
    assert_eq!(until_fault(&mut machine, cycles, |_, _| command), None);
}

#[test]
fn commands_that_no_machine_should_get_stop_it() {
    type Spoil = fn(&mut Command);
    let cases: [(Rule, &str, Spoil); 6] = [
        (Rule::CommandNumber, "left.a", |c| {
            c.motors[0][0] = Volts(f64::NAN);
        }),
        (Rule::CommandNumber, "right.micro2", |c| {
            c.micro[1][1] = Volts(f64::INFINITY);
        }),
        (Rule::VoltageLimit, "right.z", |c| {
            c.motors[1][2] = Volts(24.1);
        }),
        (Rule::VoltageLimit, "left.b", |c| {
            c.motors[0][1] = Volts(-12.1);
        }),
        (Rule::VoltageLimit, "left.micro1", |c| {
            c.micro[0][0] = Volts(10.5);
        }),
        (Rule::VoltageLimit, "left.micro1", |c| {
            c.micro[0][0] = Volts(-0.5);
        }),
    ];
    for (rule, axis, change) in cases {
        let mut machine = guarded(1);
        let good = centred(&machine);
        let fault = until_fault(&mut machine, 20, |k, _| {
            let mut command = good;
            if k == 10 {
                change(&mut command);
            }
            command
        })
        .expect("a fault");
        assert_eq!((fault.rule.clone(), fault.axis.as_str()), (rule, axis));
        assert_eq!(
            machine.exchange(&good),
            Err(fault.clone()),
            "until a person clears it"
        );
        assert_eq!(machine.clear(), Some(fault));
        assert!(
            machine.exchange(&good).is_ok(),
            "{:?}",
            machine.exchange(&good)
        );
    }
}

#[test]
fn each_broken_thing_is_told_by_its_name() {
    for (fault, rule, axis) in [
        ("stop-pressed@0.2s", Rule::StopRequest, "machine"),
        ("servo-overrun:20ms@0.2s", Rule::ServoTiming, "machine"),
        (
            "photodiode-saturated:sensing@0.2s",
            Rule::PhotodiodeRange,
            "sensing",
        ),
        (
            "vision-wrong:z:200um@0.2s",
            Rule::VisionAgreement,
            "sensing fiber, z",
        ),
        (
            "vision-wrong:x:-200um@0.2s",
            Rule::VisionAgreement,
            "sensing fiber, x",
        ),
    ] {
        let mut machine = broken(3, fault);
        let command = centred(&machine);
        let tripped = until_fault(&mut machine, 2500, |_, _| command).expect(fault);
        assert_eq!(
            (tripped.rule.clone(), tripped.axis.as_str()),
            (rule, axis),
            "{fault}"
        );
        assert!(
            (0.2..0.35).contains(&tripped.time),
            "{fault}: {}",
            tripped.time
        );
    }
}

/// A servo of the test's own: proportional, on one z-stage.
fn towards(counts: i64, command: &Command, seen: Option<&Measurement>) -> Command {
    let at = seen.map_or(0, |m| m.encoders[0][2].0);
    let mut command = *command;
    command.references[0][2] = Some(Counts(at + (counts - at).clamp(-20, 20)));
    command.motors[0][2] = Volts((0.1 * (counts - at) as f64).clamp(-6.0, 6.0));
    command
}

#[test]
fn an_axis_whose_encoder_stands_still_is_stopped_at_once() {
    for (fault, rule) in [
        ("encoder-stuck:left.z@0.1s", Rule::MotorStall),
        ("amplifier-dead:left.z@0.1s", Rule::MotorStall),
        ("encoder-dropout:left.z@0.1s", Rule::EncoderSpeed),
        ("belt-slip:left.z:100um@0.1s", Rule::OutputFollowing),
    ] {
        let mut machine = broken(5, fault);
        let command = centred(&machine);
        let tripped = until_fault(&mut machine, 2500, |_, seen| {
            towards(50_000, &command, seen)
        })
        .expect(fault);
        assert_eq!(
            (tripped.rule.clone(), tripped.axis.as_str()),
            (rule, "left.z"),
            "{fault}"
        );
        assert!(tripped.time < 0.16, "{fault}: {}", tripped.time);
    }
}

#[test]
fn a_tip_aside_is_stopped_the_farther_off_the_less_is_known_of_its_facet() {
    // At home a fiber is 1.5 mm beside its port.
    let stopped_at = |degrees: f64| {
        let mut spec = common::spec();
        spec.guard.facet = degrees.to_radians();
        let plant = Plant::parse("plant.toml", &common::read("plant.toml")).expect("a good plant");
        let mut machine = Guard::new(
            Twin::new(spec, &plant, 1).expect("a good plant"),
            common::geometry(),
        );
        let command = centred(&machine);
        let mut at = 0;
        let fault = until_fault(&mut machine, 20_000, |k, seen| {
            let mut next = command;
            next.fiber[0] = (k == 0).then_some(FiberHandling::Load(0));
            at = seen.map_or(0, |m| m.encoders[0][2].0);
            next.motors[0][2] = Volts(15.0);
            next
        });
        assert_eq!(fault.map(|fault| fault.rule), Some(Rule::ChipDistance));
        at as f64
    };
    let [by_design, one, two] = [0.0, 1.0, 2.0].map(stopped_at);
    let (farther, twice) = (by_design - one, by_design - two);
    assert!(farther > 0.0, "{by_design} {one}");
    assert!((twice / farther - 2.0).abs() < 0.1, "{farther} {twice}");
}

#[test]
fn a_fiber_on_its_way_into_the_chip_is_stopped_before_it_and_drawn_back() {
    for seed in 0..20 {
        let mut machine = guarded(seed);
        let command = centred(&machine);
        let mut loaded = false;
        let fault = until_fault(&mut machine, 10_000, |_, seen| {
            // As fast as the datasheet allows, and a chip's length too far.
            let mut next = command;
            if !loaded {
                next.fiber[0] = Some(FiberHandling::Load(0));
                loaded = true;
            }
            let at = seen.map_or(0, |m| m.encoders[0][2].0);
            next.motors[0][2] = Volts(if at < 200_000 { 20.0 } else { 0.0 });
            next
        })
        .expect("a fault");
        assert!(
            [Rule::ChipDistance, Rule::EndpointSpeed].contains(&fault.rule),
            "{fault}"
        );
        let gap = machine.inner().truth().smallest_gap;
        assert!(gap > 0.0, "seed {seed}: {gap}");
    }
}

#[test]
fn it_draws_z_back_when_it_stops() {
    let mut machine = guarded(2);
    let mut command = centred(&machine);
    command.fiber[0] = Some(FiberHandling::Load(0));
    machine.exchange(&command).expect("well");
    let command = centred(&machine);
    // One millimetre forward.
    for _ in 0..1500 {
        let seen = machine.exchange(&command).expect("well");
        let next = towards(16_000, &command, Some(&seen));
        machine.exchange(&next).expect("well");
    }
    let z = |machine: &Guard<Twin>| machine.inner().angles("left.z".parse().expect("an axis")).1;
    let before = z(&machine);
    let mut bad = command;
    bad.motors[1][Axis::Z.index()] = Volts(f64::NAN);
    machine.exchange(&bad).expect_err("a fault");
    let back = (before - z(&machine)) * 0.635e-3 / std::f64::consts::TAU;
    assert!((450e-6..550e-6).contains(&back), "{} um", back * 1e6);
}

/// Anything that control could say.
type Mad = (u16, [f64; 6], [f64; 4], u8);

fn mad() -> impl Strategy<Value = Vec<Mad>> {
    let volts = prop_oneof![
        8 => -24.0..24.0_f64,
        2 => Just(24.0),
        2 => Just(-24.0),
        2 => Just(12.0),
        1 => Just(0.0),
        1 => any::<f64>(),
    ];
    let micro = prop_oneof![8 => 0.0..10.0_f64, 1 => any::<f64>()];
    proptest::collection::vec(
        (
            1..400_u16,
            proptest::array::uniform6(volts),
            proptest::array::uniform4(micro),
            any::<u8>(),
        ),
        1..40,
    )
}

proptest! {
    /// No sequence of commands, however mad, drives anything into the chip.
    #[test]
    fn nothing_gets_past_it(commands in mad(), seed in 0..1000_u64, tame in any::<bool>()) {
        let mut machine = guarded(seed);
        let mut good = centred(&machine);
        good.fiber = [Some(FiberHandling::Load(0)), Some(FiberHandling::Load(1))];
        machine.exchange(&good).expect("well");
        for (cycles, motors, micro, what) in commands {
            let mut command = Command { laser: what & 1 != 0, ..Command::IDLE };
            for (i, volts) in motors.into_iter().enumerate() {
                let limit = if i % 3 == 2 { 24.0 } else { 12.0 };
                // Half of the runs stay within the limits, to come farther.
                let volts = if tame && volts.is_finite() { volts.clamp(-limit, limit) } else { volts };
                command.motors[i / 3][i % 3] = Volts(if tame && !volts.is_finite() { 0.0 } else { volts });
            }
            for (i, volts) in micro.into_iter().enumerate() {
                let volts = if tame && !(0.0..=10.0).contains(&volts) { 5.0 } else { volts };
                command.micro[i / 2][i % 2] = Volts(volts);
            }
            if what & 0xf0 == 0xf0 {
                command.fiber[usize::from(what & 1)] = Some(FiberHandling::Unload);
            }
            for k in 0..cycles {
                if machine.exchange(&command).is_err() {
                    break;
                }
                if k == 0 {
                    command.fiber = [None; 2];
                }
            }
            // Whoever clears a fault and goes on does so at the same risk as anyone.
            if what & 2 != 0 {
                machine.clear();
            }
        }
        let gap = machine.inner().truth().smallest_gap;
        prop_assert!(gap > 0.0, "{gap}");
    }
}
