//! A joint whose load friction is Maxwell-slip elements.

use crate::parameters::{Pid, five_bar};
use crate::{CYCLE, triangle};
use pigtail_model::friction::{Friction, Mode};
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_model::transmission::Transmission;

/// A five-bar joint with a linear transmission and an exponential of `way` radians.
fn linear(way: f64) -> JointParameters {
    JointParameters {
        transmission: Transmission::new(100.0, 0.0).expect("valid parameters"),
        presliding: way,
        motor_friction: Friction::new(0.0, 0.0, 0.0).expect("valid parameters"),
        load_friction: Friction::new(0.119, 0.119, 0.01).expect("valid parameters"),
        ..five_bar()
    }
}

/// (2.20) is the windup of a linear transmission under such friction, with `Q = 8 q_0` and
/// `W_max` the twist at the Coulomb level.
#[test]
fn a_full_reversal_winds_up_as_the_thesis_measured() {
    let way = 5e-4;
    let joint = Joint::maxwell_slip(linear(way), CYCLE).unwrap();
    let mut state = JointState::default();
    // A smooth controller: encoder counts would jerk the transmission by more than is looked for.
    let (mut top, mut worst) = (0.0_f64, 0.0_f64);
    let maximum = 0.119 / 100.0;
    for k in 0..30_000 {
        let reference = triangle(k, 2.0, 40_000);
        let u = 200.0 * (reference - state.motor_angle) - 0.5 * state.motor_velocity;
        joint.advance(&mut state, u, CYCLE);
        // Down from the first top, once inertia has nothing more to say.
        top = top.max(state.load_angle);
        if k > 20_200 {
            let gone = top - state.load_angle;
            let exact = -maximum * (1.0 - 2.0 * (-4.0 * gone / (8.0 * way)).exp());
            worst = worst.max((joint.twist(&state) - exact).abs());
        }
    }
    // 24 straight pieces for a curve, and the last tenth of a percent of the exponential.
    assert!(worst < 0.01 * maximum, "{worst} of {maximum}");
}

#[test]
fn one_step_a_cycle_agrees_with_a_hundred() {
    // Of the output, um: a kink of the elements inside a step costs more than a smooth curve would.
    for (steps, bound) in [(1.0, 0.03), (2.0, 3e-3), (4.0, 5e-4)] {
        let build = |h| Joint::maxwell_slip(five_bar(), h).unwrap();
        let (coarse, fine) = (build(CYCLE / steps), build(CYCLE / 100.0));
        let (mut a, mut b) = (JointState::default(), JointState::default());
        let mut pid = Pid::five_bar();
        let mut worst = 0.0_f64;
        for k in 0..10_000 {
            // One voltage for both: the comparison is of integrators.
            let reference = triangle(k, 200.0, 2500).round() as i64;
            let u = pid.voltage(reference, b.motor_angle);
            coarse.advance(&mut a, u, CYCLE);
            fine.advance(&mut b, u, CYCLE);
            worst = worst.max((coarse.output(&a) - fine.output(&b)).abs());
        }
        let um = 44_563.38 * worst;
        assert!(um < bound, "{um} um with {steps} steps a cycle");
    }
}

#[test]
fn energy_is_never_created() {
    let joint = Joint::maxwell_slip(five_bar(), 1e-5).unwrap();
    for i in 0..40 {
        let at = f64::from(i);
        let mut state = JointState {
            motor_angle: 0.05 * (at * 1.3).sin(),
            load_velocity: (at * 0.7).cos(),
            load_mode: Mode::towards((at * 0.7).cos()),
            ..JointState::default()
        };
        let mut before = joint.energy(&state);
        for _ in 0..200 {
            joint.advance(&mut state, 0.0, CYCLE);
            let after = joint.energy(&state);
            assert!(
                after <= before * (1.0 + 1e-9) + 1e-18,
                "{before} -> {after}"
            );
            before = after;
        }
    }
}

#[test]
fn left_alone_it_comes_to_rest() {
    let joint = Joint::maxwell_slip(five_bar(), CYCLE).unwrap();
    let mut state = JointState {
        motor_angle: 0.05,
        ..JointState::default()
    };
    for _ in 0..2500 {
        joint.advance(&mut state, 0.0, CYCLE);
    }
    assert_eq!((state.motor_velocity, state.load_velocity), (0.0, 0.0));
}
