//! What every machine owes to control, whatever stands behind the boundary.

mod common;

use common::{centred, geometry, read, spec, twin};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::{
    Axis, AxisName, Channel, Command, FiberHandling, Machine, Measurement, Pulse, Rule, Side, Spec,
};
use pigtail_machines::record::Reader;
use pigtail_machines::{Deadline, Guard, Panel, Recorder, Replay};
use pigtail_twin::Plant;
use pigtail_twin::Twin;
use std::sync::Arc;

fn boxed(machine: impl Machine + 'static) -> Box<dyn Machine> {
    Box::new(machine)
}

/// Asks every machine there is, those first that answer to whatever they are asked.
fn every(ask: impl Fn(&mut dyn Machine)) {
    let machines = [
        boxed(twin(1)),
        boxed(twin(2)),
        boxed(Deadline::new(twin(1), 1e3)),
        boxed(Panel::new(twin(1), Arc::default())),
        boxed(Guard::new(boxed(twin(2)), geometry())),
    ];
    for mut machine in machines {
        ask(&mut *machine);
    }
    // A replay answers what was asked before: it is asked the same again.
    let folder = tempfile::tempdir().expect("a folder");
    let [first, second, third] = ["first", "second", "third"].map(|name| folder.path().join(name));
    let record = |machine, path| Recorder::new(machine, path, b"a record").expect("a new file");
    let replay = |path| Replay::new(spec(), Reader::open(path).expect("a record"));

    let mut recorder = record(boxed(twin(2)), &first);
    ask(&mut recorder);
    recorder
        .finish()
        .expect("a record")
        .wait()
        .expect("a disk with room");
    ask(&mut replay(&first));
    let mut again = record(boxed(replay(&first)), &second);
    ask(&mut again);
    again
        .finish()
        .expect("a record")
        .wait()
        .expect("a disk with room");
    ask(&mut replay(&second));

    let mut watched = Guard::new(record(boxed(twin(3)), &third), geometry());
    ask(&mut watched);
    // All that a record holds is on the disk by the time that its recorder is gone.
    drop(watched);
    ask(&mut Guard::new(replay(&third), geometry()));
}

fn run(machine: &mut dyn Machine, command: &Command, cycles: usize) -> Vec<Measurement> {
    (0..cycles)
        .map(|_| machine.exchange(command).expect("no fault"))
        .collect()
}

#[test]
fn time_advances_by_one_period_a_cycle() {
    every(|machine| {
        let period = machine.spec().period();
        let command = centred(&*machine);
        for (i, m) in run(&mut *machine, &command, 1000).iter().enumerate() {
            assert!((m.time - (i + 1) as f64 * period).abs() < 1e-9);
        }
    });
}

#[test]
fn slow_sensors_come_at_their_own_rate_with_their_own_time() {
    every(|machine| {
        let spec = machine.spec().clone();
        let command = centred(&*machine);
        let seconds = 2.0;
        let seen = run(
            &mut *machine,
            &command,
            (seconds * spec.servo.rate) as usize,
        );
        let light = seen.iter().filter(|m| m.light.is_some()).count() as f64;
        let frames = seen.iter().filter(|m| m.vision.is_some()).count() as f64;
        assert!(
            (light - seconds * spec.photodiode.rate).abs() <= 1.0,
            "{light}"
        );
        assert!(
            (frames - seconds * spec.vision.rate).abs() <= 2.0,
            "{frames}"
        );
        for m in &seen {
            assert!(m.light.is_none_or(|light| light.time <= m.time));
            assert!(m.vision.is_none_or(|frame| frame.time <= m.time));
            assert!(
                m.vision
                    .is_none_or(|frame| m.time - frame.time <= spec.vision.latency + 1e-9)
            );
        }
    });
}

#[test]
fn without_voltage_nothing_moves() {
    every(|machine| {
        let command = centred(&*machine);
        for m in run(&mut *machine, &command, 2500) {
            assert_eq!(m.encoders, [[Counts(0); 3]; 2]);
        }
    });
}

#[test]
fn each_axis_follows_its_own_voltage_in_its_direction() {
    for side in Side::ALL {
        for axis in Axis::ALL {
            for sign in [-1.0, 1.0] {
                every(|machine| {
                    let mut command = centred(&*machine);
                    command.motors[side.index()][axis.index()] = Volts(sign * 3.5);
                    let last = run(&mut *machine, &command, 250).pop().expect("cycles");
                    for s in Side::ALL {
                        for a in Axis::ALL {
                            let Counts(count) = last.encoders[s.index()][a.index()];
                            if (s, a) == (side, axis) {
                                assert!(count as f64 * sign > 100.0, "{side:?} {axis:?} {count}");
                            } else {
                                assert_eq!(count, 0, "{s:?} {a:?} moved with {side:?} {axis:?}");
                            }
                        }
                    }
                });
            }
        }
    }
}

#[test]
fn amplifiers_saturate_at_the_datasheet_s_voltage() {
    let counts = |volts: f64| {
        let mut machine = twin(1);
        let mut command = centred(&machine);
        command.motors[0][Axis::Z.index()] = Volts(volts);
        run(&mut machine, &command, 100)
            .pop()
            .expect("cycles")
            .encoders
    };
    assert_eq!(counts(24.0), counts(1000.0));
    assert_ne!(counts(24.0), counts(20.0));
}

#[test]
fn a_command_that_is_no_number_stops_the_machine_for_good() {
    for bad in [f64::NAN, f64::INFINITY] {
        every(|machine| {
            let good = centred(&*machine);
            run(&mut *machine, &good, 10);
            let mut command = good;
            command.motors[1][Axis::Z.index()] = Volts(bad);
            let fault = machine.exchange(&command).expect_err("a fault");
            assert_eq!(fault.axis, "right.z");
            assert_eq!(machine.exchange(&good).expect_err("still stopped"), fault);
        });
        every(|machine| {
            let mut command = centred(&*machine);
            command.micro[0][1] = Volts(bad);
            assert_eq!(
                machine.exchange(&command).expect_err("a fault").axis,
                "left.micro2"
            );
        });
    }
}

#[test]
fn a_fiber_that_is_not_there_is_a_fault() {
    every(|machine| {
        let mut command = centred(&*machine);
        command.fiber[0] = Some(FiberHandling::Attach);
        assert!(machine.exchange(&command).is_err());
    });
    every(|machine| {
        let mut command = centred(&*machine);
        command.fiber[1] = Some(FiberHandling::Load(7));
        assert!(machine.exchange(&command).is_err());
    });
}

#[test]
fn stop_brings_a_moving_machine_to_rest() {
    every(|machine| {
        let mut command = centred(&*machine);
        command.motors[0] = [Volts(3.0); 3];
        run(&mut *machine, &command, 500);
        machine.stop();
        let command = centred(&*machine);
        let after = run(&mut *machine, &command, 500);
        assert_eq!(after[0].encoders, after[499].encoders);
    });
}

#[test]
fn the_dark_is_the_same_on_every_photodiode_and_light_is_more() {
    every(|machine| {
        let dark = centred(&*machine);
        let mean = |seen: &[Measurement], channel: Channel| {
            let volts: Vec<f64> = seen
                .iter()
                .filter_map(|m| Some(m.light?.volts[channel.index()].0))
                .collect();
            volts.iter().sum::<f64>() / volts.len() as f64
        };
        let seen = run(&mut *machine, &dark, 2500);
        let offset = mean(&seen, Channel::Output1);
        for channel in Channel::ALL {
            assert!((mean(&seen, channel) - offset).abs() < 2e-3);
        }
    });
}

#[test]
fn vision_sees_a_fiber_only_while_it_is_held() {
    every(|machine| {
        let mut command = centred(&*machine);
        let frame = |seen: &[Measurement]| {
            seen.iter()
                .filter_map(|m| m.vision)
                .next_back()
                .expect("a frame")
        };
        let seen = run(&mut *machine, &command, 500);
        assert_eq!(frame(&seen).fiber, [None, None]);
        command.fiber[0] = Some(FiberHandling::Load(0));
        run(&mut *machine, &command, 1);
        command.fiber[0] = None;
        let seen = run(&mut *machine, &command, 500);
        assert!(frame(&seen).fiber[0].is_some() && frame(&seen).fiber[1].is_none());
    });
}

/// The twin alone: the same seed is the same machine, to the last bit.
#[test]
fn a_twin_is_its_seed() {
    let play = |seed: u64| {
        let mut machine = twin(seed);
        let mut command = centred(&machine);
        command.laser = true;
        (0..3000)
            .map(|k| {
                let volts = 5.0 * (f64::from(k) * 0.01).sin();
                command.motors = [[Volts(volts), Volts(-volts), Volts(2.0 * volts)]; 2];
                command.micro[0][0] = Volts(5.0 + 0.5 * volts);
                machine.exchange(&command).expect("no fault")
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(play(9), play(9));
    assert_ne!(play(9), play(10));
}

/// The twin alone: encoder counts are what the thesis says at the endpoint (2.5), and a piezo
/// moves along its own axis at 45 degrees (3.2.1).
#[test]
fn scales_are_those_of_the_thesis() {
    let spec = Spec::parse("machine.toml", &read("machine.toml")).expect("a good datasheet");
    let z =
        0.635e-3 / spec.z_stage.drive.gear_ratio / f64::from(spec.z_stage.drive.counts_per_turn);
    assert!((z - 0.062e-6).abs() < 0.001e-6, "{z}");
    let seen_x = |micro: [f64; 2]| {
        let mut machine = twin(4);
        let mut command = centred(&machine);
        command.fiber[0] = Some(FiberHandling::Load(0));
        command.micro[0] = micro.map(Volts);
        run(&mut machine, &command, 1);
        command.fiber[0] = None;
        let seen = run(&mut machine, &command, 20_000);
        let x: Vec<f64> = seen
            .iter()
            .filter_map(|m| Some(m.vision?.fiber[0]?.x))
            .collect();
        x.iter().sum::<f64>() / x.len() as f64
    };
    // Both axes over their whole range: 70 um times the square root of two across.
    let across = seen_x([10.0, 0.0]) - seen_x([0.0, 10.0]);
    assert!((across - 99e-6).abs() < 5e-6, "{across}");
    // Both together: up and down, nothing across but what the coupling leaves.
    let up = seen_x([10.0, 10.0]) - seen_x([0.0, 0.0]);
    assert!(up.abs() < 5e-6, "{up}");
}

/// The twin alone: a pulse moves an axis exactly as the model says, on the very trajectory of the
/// continuous voltage, though it ends in the middle of a cycle.
#[test]
fn a_pulse_is_played_inside_of_cycles() {
    let text = read("plant.toml");
    let (before, after) = text.split_once("[variation]").expect("a table");
    let exact: String = after
        .lines()
        .map(|line| {
            line.split_once('=')
                .map_or(String::new(), |(key, _)| format!("{key}= 0.0\n"))
        })
        .collect();
    let plant =
        Plant::parse("plant.toml", &format!("{before}[variation]\n{exact}")).expect("a plant");
    let spec = Spec::parse("machine.toml", &read("machine.toml")).expect("a good datasheet");
    let at = AxisName {
        side: Side::Left,
        axis: Axis::Z,
    };
    let mut machine = Twin::new(spec, &plant, 1).expect("a good plant");
    let mut command = centred(&machine);
    // 1.5 and 12.5 times the motor's static friction (thesis 4.3.1).
    let unit = 5.53 / 0.02 * 2.58e-3;
    command.pulses[0][Axis::Z.index()] = Some(Pulse::impulse(1.5 * unit, 12.5 * unit, 1e-3));
    run(&mut machine, &command, 1);
    command.pulses = Command::NO_PULSES;
    run(&mut machine, &command, 500);
    let moved = 1e9 * machine.output(at).expect("a probe");
    // Where an independent integration of (2.9) and (2.10) with these parameters ends.
    assert!((moved - 34.717_576).abs() < 1e-3, "{moved} nm");
    for other in [Axis::A, Axis::B] {
        let at = AxisName {
            side: Side::Left,
            axis: other,
        };
        assert_eq!(machine.output(at), Some(0.0));
    }
}

#[test]
fn a_pulse_that_the_amplifier_cannot_play_stops_the_machine() {
    let spec = |pulse: &str| {
        let text = read("machine.toml").replace(
            ", pulse = { voltage = \"24 V\", bandwidth = \"2.5 kHz\" }",
            pulse,
        );
        Spec::parse("machine.toml", &text).expect("a good datasheet")
    };
    let plant = Plant::parse("plant.toml", &read("plant.toml")).expect("a good plant");
    let with = ", pulse = { voltage = \"24 V\", bandwidth = \"2.5 kHz\" }";
    for (datasheet, pulse, rule) in [
        ("", Pulse::impulse(1.0, 8.0, 1e-3), Rule::PulseSupport),
        (with, Pulse::impulse(20.0, 20.0, 1e-3), Rule::PulseVoltage),
        (with, Pulse::impulse(1.0, 8.0, 0.2e-3), Rule::PulseBandwidth),
        (
            with,
            Pulse::impulse(1.0, f64::NAN, 1e-3),
            Rule::CommandNumber,
        ),
    ] {
        let mut machine = Twin::new(spec(datasheet), &plant, 1).expect("a good plant");
        let mut command = centred(&machine);
        command.pulses[1][Axis::Z.index()] = Some(pulse);
        let fault = machine.exchange(&command).expect_err("a fault");
        assert_eq!((fault.rule.clone(), fault.axis.as_str()), (rule, "right.z"));
        assert_eq!(
            machine
                .exchange(&centred(&machine))
                .expect_err("still stopped"),
            fault
        );
    }
}
