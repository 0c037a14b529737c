//! Any number of joints side by side, each with parameters of its own, against the same joints one by one.

use crate::parameters::{Pid, five_bar, round_up, z_stage};
use crate::{CYCLE, triangle};
use pigtail_model::batch::{Batch, LANES};
use pigtail_model::friction::Friction;
use pigtail_model::instructions::Instructions;
use pigtail_model::joint::{Joint, JointParameters, JointState};

/// Not a whole number of vectors.
const JOINTS: usize = 21;

/// From an output's angle to a tip, metres: a proximal link with what is beside it, and the screw.
const ARMS: [f64; 3] = [0.044_56, 1.0106e-4, 1.0106e-4];

/// A z-stage whose load nothing holds: it has no modes, and its motor has.
fn free_load() -> JointParameters {
    JointParameters {
        load_friction: Friction::new(0.0, 0.0, 5.7e-3).expect("valid parameters"),
        ..z_stage()
    }
}

/// No two alike.
fn joints(kind: usize) -> Vec<Joint> {
    let scaled = |p: JointParameters, k: usize| {
        let by = 1.0 + 0.02 * (k as f64 - 10.0);
        JointParameters {
            motor_inertia: p.motor_inertia * by,
            load_inertia: p.load_inertia / by,
            motor_friction: p.motor_friction.scaled(by).expect("valid parameters"),
            load_friction: p.load_friction.scaled(1.0 / by).expect("valid parameters"),
            ..p
        }
    };
    let parameters = [five_bar, z_stage, free_load][kind]();
    let joint = |k| Joint::new(scaled(parameters, k), 0.5 * CYCLE).expect("valid parameters");
    (0..JOINTS).map(joint).collect()
}

/// A triangle in which each joint is so many cycles before the one that is given before it.
fn wave(k: i32, before: i32, joint: usize, amplitude: f64, period: i32) -> f64 {
    let joint = i32::try_from(joint).expect("a few joints");
    triangle(k + before * joint, amplitude, period)
}

fn pid(kind: usize) -> Pid {
    [Pid::five_bar, Pid::z_stage, Pid::z_stage][kind]()
}

/// A slow triangle, in which they stick and slip all the time, each at its own point of the path: the farthest that a
/// tip is apart from that of the same joint alone, metres, and how often a joint stood still and went on.
fn apart(kind: usize) -> (f64, usize) {
    let joints = joints(kind);
    let mut batch = Batch::new(&joints, CYCLE);
    let mut alone = vec![JointState::default(); JOINTS];
    let mut pids: Vec<_> = (0..JOINTS).map(|_| pid(kind)).collect();
    let (mut worst, mut starts) = (0.0_f64, 0);
    for k in 0..6000 {
        let voltages: Vec<_> = (0..JOINTS)
            .map(|i| {
                let reference = round_up(wave(k, 311, i, 200.0, 5000));
                pids[i].voltage(reference, batch.motor_angle(i))
            })
            .collect();
        batch.advance(&voltages);
        for (i, output) in batch.outputs().enumerate() {
            let before = alone[i].motor_velocity;
            // Step by step as the batch does it: after an event in a longer time it would go on in steps of its own,
            // and differ by what steps err.
            for _ in 0..2 {
                joints[i].advance(&mut alone[i], voltages[i], 0.5 * CYCLE);
            }
            starts += usize::from(before == 0.0 && alone[i].motor_velocity != 0.0);
            let by = output - joints[i].output(&alone[i]);
            worst = worst.max(ARMS[kind] * by.abs());
        }
    }
    (worst, starts)
}

/// 1e-3 nm at a tip, whenever each of them breaks away and comes to rest.
#[test]
fn each_goes_the_way_that_it_goes_alone() {
    for kind in 0..ARMS.len() {
        let (worst, starts) = apart(kind);
        assert!(worst < 1e-12, "{worst}");
        assert!(
            starts > 100 * JOINTS,
            "{starts} starts are no slow triangle"
        );
    }
}

/// All that fuse products and sums make the same bits; SSE2, which has nothing that does, the same way to 1e-3 nm at a tip.
#[test]
fn instructions_change_no_more_than_rounding() {
    let all = Instructions::all();
    for (kind, arm) in ARMS.into_iter().enumerate() {
        let joints = joints(kind);
        let mut batches = vec![Batch::new(&joints, CYCLE); all.len()];
        for k in 0..4000 {
            let voltage = |i: usize| 4.0 * wave(k, 97, i, 1.0, 500);
            let voltages: Vec<_> = (0..JOINTS).map(voltage).collect();
            for (batch, instructions) in batches.iter_mut().zip(&all) {
                batch.advance_by(*instructions, &voltages);
            }
        }
        let last = &batches[all.len() - 1];
        for (batch, name) in batches.iter().zip(all.iter().map(|by| by.name())) {
            assert!(batch == last || name == "SSE2", "{name}");
            for (output, same) in batch.outputs().zip(last.outputs()) {
                let apart = arm * (output - same).abs();
                assert!(apart < 1e-12, "{apart} by {name}");
            }
        }
        assert!((0..JOINTS).any(|i| last.motor_angle(i) != 0.0));
    }
}

/// Eight by themselves are finished in other ways than among many, by wide vectors and by narrow ones.
#[test]
fn few_go_the_way_that_they_go_among_many() {
    for kind in 0..2 {
        let joints = joints(kind);
        for by in Instructions::all() {
            let mut many = Batch::new(&joints, CYCLE);
            let mut few = Batch::new(&joints[..LANES], CYCLE);
            let mut started = 0;
            for k in 0..4000 {
                let voltage = |i: usize| 4.0 * wave(k, 97, i, 1.0, 500);
                let voltages: Vec<_> = (0..JOINTS).map(voltage).collect();
                let rests = few.state(0).motor_velocity == 0.0;
                many.advance_by(by, &voltages);
                few.advance_by(by, &voltages[..LANES]);
                started += usize::from(rests && few.state(0).motor_velocity != 0.0);
            }
            for i in 0..LANES {
                assert_eq!(few.state(i), many.state(i), "{i} by {}", by.name());
            }
            assert!(started > 10, "{started} starts");
        }
    }
}

/// A joint does not know where in a batch it lies, nor who lies beside it.
#[test]
fn who_lies_beside_it_changes_nothing() {
    let joints = joints(0);
    let shuffled: Vec<_> = (0..JOINTS).map(|i| joints[(8 * i) % JOINTS]).collect();
    let (mut a, mut b) = (Batch::new(&joints, CYCLE), Batch::new(&shuffled, CYCLE));
    for k in 0..2000 {
        let voltage = |i: usize| 5.0 * wave(k, 31, i, 1.0, 400);
        a.advance(&(0..JOINTS).map(voltage).collect::<Vec<_>>());
        b.advance(
            &(0..JOINTS)
                .map(|i| voltage((8 * i) % JOINTS))
                .collect::<Vec<_>>(),
        );
    }
    for i in 0..JOINTS {
        assert_eq!(a.state((8 * i) % JOINTS), b.state(i), "{i}");
    }
}

#[test]
fn a_state_that_is_set_is_kept_with_its_torque() {
    let mut batch = Batch::new(&joints(1)[..3], CYCLE);
    assert!(batch.len() == 3 && !batch.is_empty());
    let state = JointState {
        motor_angle: 1.0,
        load_angle: 0.2,
        load_torque: 1e-3,
        ..JointState::default()
    };
    batch.set_state(2, &state);
    assert_eq!(batch.state(2), state);
    batch.advance(&[0.0; 3]);
    assert_eq!(batch.state(2).load_torque, 1e-3);
    assert_eq!(batch.state(0), JointState::default());
}
