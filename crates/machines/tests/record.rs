//! A record, and a machine that answers as it did.

mod common;

use common::{centred, guarded, spec, twin};
use pigtail_hal::quantity::Volts;
use pigtail_hal::{Command, FiberHandling, Machine, Measurement, Rule};
use pigtail_machines::record::Reader;
use pigtail_machines::{Recorder, Replay};
use std::path::Path;

/// Some commands with everything in them that a command can say.
fn commands() -> Vec<Command> {
    let good = centred(&twin(1));
    (0..2000)
        .map(|k| {
            let mut command = good;
            command.laser = k > 100;
            command.motors[k % 2][k / 2 % 3] = Volts(0.5 * (k as f64 * 0.01).sin());
            command.micro[1][0] = Volts(5.0 + 0.1 * (k as f64 * 0.1).cos());
            if k == 7 {
                command.fiber[1] = Some(FiberHandling::Load(0));
            }
            command
        })
        .collect()
}

/// What came back while all of it was recorded.
fn recorded(path: &Path) -> Vec<Measurement> {
    let mut recorder = Recorder::new(twin(1), path, b"about").expect("a new file");
    let seen = commands()
        .iter()
        .map(|command| recorder.exchange(command).expect("well"))
        .collect();
    recorder
        .finish()
        .expect("a record")
        .wait()
        .expect("a disk with room");
    seen
}

fn replay(path: &Path) -> Replay {
    let reader = Reader::open(path).expect("a record");
    assert_eq!(reader.about(), b"about");
    Replay::new(spec(), reader)
}

#[test]
fn it_answers_as_it_did_and_ends_where_it_did() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("record");
    let seen = recorded(&path);
    let mut machine = replay(&path);
    for (command, seen) in commands().iter().zip(&seen) {
        assert_eq!(machine.exchange(command).as_ref(), Ok(seen));
    }
    assert_eq!(machine.cycles(), 2000);
    let fault = machine.exchange(&commands()[0]).expect_err("the end");
    assert_eq!(fault.rule, Rule::ReplayEnds);
    assert!(!machine.is_cut());
    assert_eq!(machine.left().expect("a whole record"), 0);
}

#[test]
fn the_first_command_that_differs_in_a_bit_is_named() {
    type Change = fn(&mut Command);
    let cases: [(&str, Change); 6] = [
        ("right.z motor", |c| {
            let Volts(volts) = c.motors[1][2];
            c.motors[1][2] = Volts(f64::from_bits(volts.to_bits() ^ 1));
        }),
        ("left.a reference", |c| {
            c.references[0][0] = Some(pigtail_hal::Counts(1));
        }),
        ("right.micro1", |c| c.micro[1][0].0 += 1e-12),
        ("left holder", |c| c.fiber[0] = Some(FiberHandling::Unload)),
        ("laser", |c| c.laser = !c.laser),
        ("laser", |c| c.laser_percent = 40),
    ];
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("record");
    recorded(&path);
    for (axis, change) in cases {
        let mut machine = replay(&path);
        let mut commands = commands();
        change(&mut commands[1233]);
        let fault = commands
            .iter()
            .find_map(|command| machine.exchange(command).err())
            .expect("a difference");
        assert_eq!(
            (&fault.rule, fault.axis.as_str()),
            (&Rule::ReplayDiffers, axis)
        );
        assert!(fault.value.contains("in command 1234"), "{fault}");
        assert_eq!(machine.cycles(), 1233);
    }
}

#[test]
fn a_record_that_is_cut_anywhere_is_read_up_to_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("record");
    let seen = recorded(&path);
    let bytes = std::fs::read(&path).expect("a record");
    let cut = folder.path().join("cut");
    for part in 1..20 {
        let length = bytes.len() * part / 20;
        std::fs::write(&cut, &bytes[..length]).expect("written");
        let mut reader = Reader::open(&cut).expect("its beginning is there");
        let mut read = 0;
        while let Some(exchange) = reader.next_exchange().expect("no damage") {
            assert_eq!(exchange.answer.as_ref(), Ok(&seen[read]));
            read += 1;
        }
        assert!(reader.is_cut() && read < seen.len(), "{part}: {read}");
    }
}

#[test]
fn a_guard_around_a_replay_stops_where_it_did() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("record");
    let geometry = common::geometry;
    let mut recorder = Recorder::new(twin(3), &path, b"about").expect("a new file");
    let (mut last, mut first) = (centred(&twin(3)), None);
    last.motors[0][0] = Volts(12.0);
    let mut machine = pigtail_machines::Guard::new(&mut recorder, geometry());
    for _ in 0..2000 {
        if let Err(fault) = machine.exchange(&last) {
            first = Some(fault);
            break;
        }
    }
    drop(machine);
    recorder
        .finish()
        .expect("a record")
        .wait()
        .expect("a disk with room");
    let mut again = pigtail_machines::Guard::new(replay(&path), geometry());
    let fault = (0..2000).find_map(|_| again.exchange(&last).err());
    assert_eq!(fault, first);
    assert!(fault.is_some());
    assert!(guarded(3).clear().is_none(), "one that has not stopped");
}

#[test]
fn a_probe_that_says_nothing_sensible_is_told() {
    /// A twin whose probes are no numbers.
    struct Blind(pigtail_twin::Twin);
    impl Machine for Blind {
        fn spec(&self) -> &pigtail_hal::Spec {
            self.0.spec()
        }
        fn exchange(&mut self, command: &Command) -> Result<Measurement, pigtail_hal::Fault> {
            let mut measured = self.0.exchange(command)?;
            measured.probes = Some([[f64::NAN; 3]; 2]);
            Ok(measured)
        }
        fn stop(&mut self) {}
    }
    let mut machine = pigtail_machines::Guard::new(Blind(twin(1)), common::geometry());
    let fault = machine.exchange(&centred(&twin(1))).expect_err("a fault");
    assert_eq!(fault.rule, Rule::OutputFollowing);
}
