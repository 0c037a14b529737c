//! Joints stepped together, against the same joints one by one and at a much finer step.

use crate::parameters::{Pid, five_bar, round_up, z_stage};
use crate::{CYCLE, triangle};
use pigtail_model::friction::Friction;
use pigtail_model::group::{Group, States};
use pigtail_model::instructions::Instructions;
use pigtail_model::joint::{Joint, JointState};
use pigtail_model::transmission::Transmission;
use proptest::prelude::*;

/// Four joints that stick, slip, hold and slide freely at different times. The stiffness of the third is
/// bounded.
fn joints(step: f64) -> [Joint; 4] {
    let mut bounded = five_bar();
    bounded.transmission = Transmission::new(34.0, 1.8e7)
        .and_then(|spring| spring.bounded(3.5))
        .expect("valid parameters");
    let mut free = five_bar();
    free.load_friction = Friction::new(0.0, 0.0, 0.01).expect("valid parameters");
    [five_bar(), z_stage(), bounded, free].map(|p| Joint::new(p, step).expect("valid parameters"))
}

/// A triangle scan under PID: the group in steps of `step`, and beside it under the same voltages
/// each joint alone in steps of `fine`. Largest difference of an output, radians.
fn difference(step: f64, fine: f64) -> [f64; 4] {
    let group = Group::new(joints(step), CYCLE);
    let alone = joints(fine);
    let mut a = States::new([JointState::default(); 4]);
    let mut b = [JointState::default(); 4];
    let mut pids = [
        Pid::five_bar(),
        Pid::z_stage(),
        Pid::five_bar(),
        Pid::five_bar(),
    ];
    let mut worst = [0.0_f64; 4];
    for k in 0..6000 {
        let voltages = std::array::from_fn(|i| {
            let reference = triangle(k + [0, 700, 1400, 2100][i], 200.0, 5000);
            pids[i].voltage(round_up(reference), b[i].motor_angle)
        });
        group.advance(&mut a, voltages);
        for i in 0..4 {
            alone[i].advance(&mut b[i], voltages[i], CYCLE);
            let apart = group.joints()[i].output(&a.get(i)) - alone[i].output(&b[i]);
            worst[i] = worst[i].max(apart.abs());
        }
    }
    worst
}

#[test]
fn together_they_move_as_they_do_alone() {
    for apart in difference(CYCLE, CYCLE) {
        assert!(apart < 1e-11, "{apart}");
    }
}

/// 1e-4 um at the output in a scan, by one step a cycle. The first starts with a jolt of the full
/// voltage: five times that.
#[test]
fn one_step_a_cycle_is_within_a_tenth_of_a_nanometre() {
    let [jolted, z, scanning, _] = difference(CYCLE, CYCLE / 100.0);
    assert!(0.044_56 * scanning < 1e-10, "{scanning}");
    assert!(1.0106e-4 * z < 1e-10, "{z}");
    assert!(0.044_56 * jolted < 5e-10, "{jolted}");
}

proptest! {
    #[test]
    fn whatever_the_voltages_they_agree(voltages in prop::collection::vec(-12.0..12.0_f64, 400)) {
        let (group, alone) = (Group::new(joints(CYCLE), CYCLE), joints(CYCLE));
        let mut a = States::new([JointState::default(); 4]);
    let mut b = [JointState::default(); 4];
        for u in voltages.chunks_exact(4) {
            let u = [u[0], u[1], u[2], u[3]];
            let outputs = group.advance_outputs(Instructions::widest(), &mut a, u);
            prop_assert_eq!(outputs, group.outputs(&a));
            for i in 0..4 {
                alone[i].advance(&mut b[i], u[i], CYCLE);
                prop_assert_eq!((a.get(i).motor_mode, a.get(i).load_mode), (b[i].motor_mode, b[i].load_mode));
                prop_assert!((a.get(i).load_angle - b[i].load_angle).abs() < 1e-11);
            }
        }
    }
}
