//! Each equation of the joint against what can be worked out on paper, and the integrator against
//! itself at a much finer step.

mod batch;
mod group;
mod maxwell;
mod parameters;
mod pulse;

use parameters::{Pid, five_bar, joint, round_up, z_stage};
use pigtail_model::friction::{Friction, Mode};
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_model::motor::Motor;
use pigtail_model::transmission::Transmission;
use proptest::prelude::*;
use std::f64::consts::TAU;

const CYCLE: f64 = 400e-6;

fn frictionless() -> Friction {
    Friction::new(0.0, 0.0, 0.0).expect("valid parameters")
}

#[test]
fn free_inertias_swing_with_the_undamped_period() {
    let mut p = z_stage();
    p.motor_friction = frictionless();
    p.load_friction = frictionless();
    // A motor that gives no torque and no damping.
    p.motor = Motor::new(1e-12, 1e-12, 1.0).unwrap();
    let joint = joint(p);
    // With twist w = r q_m - q_l: w'' = -k_s (r^2 / J_m + 1 / J_l) w.
    let stiffness: f64 = 3.95;
    let period = TAU / (stiffness * (0.04 / 1e-6 + 1.0 / 1.75e-5)).sqrt();
    let mut state = JointState {
        motor_angle: 0.01,
        ..JointState::default()
    };
    let (mut time, step, mut crossings) = (0.0, 1e-6, Vec::new());
    let mut before = joint.twist(&state);
    while crossings.len() < 21 {
        joint.advance(&mut state, 0.0, step);
        time += step;
        let after = joint.twist(&state);
        if before > 0.0 && after <= 0.0 {
            crossings.push(time - step * after / (after - before));
        }
        before = after;
    }
    let measured = (crossings[20] - crossings[0]) / 20.0;
    assert!(
        (measured / period - 1.0).abs() < 1e-6,
        "{measured} for {period}"
    );
}

/// However coarse its steps, what nothing dampens does not ring up; and down by what the eigenvalues of
/// a step of so many radians say, 16, 2.8 and 0.22 % in a thousand steps.
#[test]
fn a_swing_without_friction_keeps_its_energy() {
    let mut p = z_stage();
    p.motor_friction = frictionless();
    p.load_friction = frictionless();
    p.motor = Motor::new(1e-12, 1e-12, 1.0).unwrap();
    for (share, lost) in [(1.0, 0.17), (0.5, 0.03), (0.25, 2.4e-3)] {
        let step = share * p.coarsest_step(0.0);
        let joint = Joint::new(p, step).unwrap();
        let mut state = JointState {
            motor_angle: 0.1,
            ..JointState::default()
        };
        let start = joint.energy(&state);
        let mut before = start;
        for _ in 0..1000 {
            joint.advance(&mut state, 0.0, step);
            let after = joint.energy(&state);
            // A method that is no symplectic one swings a little about its own energy.
            assert!(after <= before * 1.01, "{share}: {after} of {before}");
            before = after;
        }
        assert!(before <= start, "{share}: {before} of {start}");
        assert!(
            before >= (1.0 - lost) * start,
            "{share}: {before} of {start}"
        );
    }
}

#[test]
fn static_friction_holds_to_its_level_and_not_beyond() {
    for p in [z_stage(), five_bar()] {
        let joint = joint(p);
        let level = p.motor_friction.static_level() / p.motor.gain();
        let mut state = JointState::default();
        joint.advance(&mut state, 0.999_999 * level, 1.0);
        assert_eq!(state, JointState::default());
        joint.advance(&mut state, 1.000_001 * level, 1e-3);
        assert_eq!(state.motor_mode, Mode::Forward);
        assert!(state.motor_angle > 0.0);
    }
}

#[test]
fn the_load_breaks_away_when_the_spring_reaches_its_static_friction() {
    let p = z_stage();
    let joint = joint(p);
    let mut state = JointState::default();
    let mut last_held = 0.0;
    while state.load_mode == Mode::Stuck {
        last_held = joint.load_psi(&state);
        joint.advance(&mut state, 1.2, 1e-6);
    }
    let level = p.load_friction.static_level();
    assert!(
        last_held <= level && last_held > 0.99 * level,
        "{last_held} for {level}"
    );
}

#[test]
fn steady_speed_balances_the_torques() {
    for (p, voltage) in [(z_stage(), 6.0), (five_bar(), 8.0)] {
        let joint = joint(p);
        let mut state = JointState::default();
        for _ in 0..5000 {
            joint.advance(&mut state, voltage, CYCLE);
        }
        // gain u - f_cm - r f_cl = (damping + b_m + r^2 b_l) v_m
        let torque = p.motor.gain() * voltage
            - p.motor_friction.coulomb()
            - p.ratio * p.load_friction.coulomb();
        let damping = p.motor.damping()
            + p.motor_friction.viscous()
            + p.ratio * p.ratio * p.load_friction.viscous();
        let speed = torque / damping;
        assert!((state.motor_velocity / speed - 1.0).abs() < 1e-9);
        assert!((state.load_velocity / (p.ratio * speed) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn presliding_gives_way_in_proportion_to_the_force_and_stops_at_its_limit() {
    let p = five_bar();
    let joint = joint(p);
    let mut state = JointState::default();
    // Twist the transmission by hand to half of the static friction.
    let half = 0.5 * p.load_friction.static_level();
    let mut twist = 1e-4;
    for _ in 0..50 {
        twist -= (p.transmission.torque(twist) - half) / p.transmission.stiffness(twist);
    }
    state.motor_angle = twist / p.ratio;
    assert!((joint.output(&state) - 0.5 * p.presliding).abs() < 1e-12);
    assert_eq!(joint.output(&JointState::default()), 0.0);
}

#[test]
fn the_harmonic_drive_hardens_as_its_maker_says() {
    let spring = Transmission::new(53.3, 8.94e6).unwrap();
    assert!((spring.torque(1e-3) - (0.0533 + 0.00894)).abs() < 1e-15);
    assert_eq!(spring.torque(-1e-3), -spring.torque(1e-3));
    let h = 1e-8;
    let slope = (spring.energy(1e-3 + h) - spring.energy(1e-3 - h)) / (2.0 * h);
    assert!((slope / spring.torque(1e-3) - 1.0).abs() < 1e-7);
}

#[test]
fn a_bounded_stiffness_rises_to_its_bound_and_no_further() {
    let endless = Transmission::new(34.0, 1.8e7).unwrap();
    let spring = endless.bounded(3.5).unwrap();
    // k_s + 3 k_h w^2 = 3.5 k_s.
    let bend = (2.5_f64 * 34.0 / (3.0 * 1.8e7)).sqrt();
    assert!((spring.bend() - bend).abs() < 1e-15);
    assert_eq!(spring.torque(0.9 * bend), endless.torque(0.9 * bend));
    let beyond = endless.torque(bend) + 3.5 * 34.0 * bend;
    assert!((spring.torque(-2.0 * bend) + beyond).abs() < 1e-15);
    for part in [0.5, 0.99, 1.01, 3.0] {
        let (twist, h) = (part * bend, 1e-9);
        let slope = |of: &dyn Fn(f64) -> f64| (of(twist + h) - of(twist - h)) / (2.0 * h);
        let (stiffness, torque) = (slope(&|w| spring.torque(w)), slope(&|w| spring.energy(w)));
        assert!(
            (stiffness / spring.stiffness(twist) - 1.0).abs() < 1e-5,
            "{part}"
        );
        assert!((torque / spring.torque(twist) - 1.0).abs() < 1e-5, "{part}");
        assert!((spring.twist(spring.torque(twist)) / twist - 1.0).abs() < 1e-12);
    }
    assert_eq!(endless.bounded(0.9).unwrap_err().parameter, "bound");
    // What does not harden has no bend.
    let linear = Transmission::new(34.0, 0.0).unwrap();
    let bounded = linear.bounded(2.0).unwrap();
    assert_eq!(bounded.torque(1.0), linear.torque(1.0));
}

#[test]
fn static_below_coulomb_cannot_be_built() {
    let error = Friction::new(1e-3, 2e-3, 0.0).unwrap_err();
    assert_eq!(error.parameter, "static_friction");
    assert!(Friction::new(f64::NAN, 0.0, 0.0).is_err());
    assert!(Transmission::new(0.0, 1.0).is_err());
    let weightless = JointParameters {
        load_inertia: 0.0,
        ..z_stage()
    };
    assert_eq!(
        Joint::new(weightless, CYCLE).unwrap_err().parameter,
        "load_inertia"
    );
}

/// A voltage that makes the joint stick and slip in both directions.
fn triangle(k: i32, amplitude: f64, period: i32) -> f64 {
    let phase = f64::from(k.rem_euclid(period)) / f64::from(period);
    amplitude * (1.0 - 4.0 * (phase - 0.5).abs())
}

/// Scans under PID, where stick-slip decides the position: slow triangles, and a sine of 8 Hz in which
/// everything slides. One step a cycle against a hundred, at every cycle's end: 1e-4 um.
#[test]
fn one_step_a_cycle_agrees_with_a_hundred() {
    type Reference = fn(i32) -> f64;
    let sine: Reference = |k| 200.0 * (TAU * 8.0 * f64::from(k) * CYCLE).sin();
    for (p, pid, metres, reference) in [
        (
            z_stage(),
            Pid::z_stage as fn() -> Pid,
            1.0106e-4,
            (|k| triangle(k + 1250, 650.0, 5000)) as Reference,
        ),
        (z_stage(), Pid::z_stage, 1.0106e-4, sine),
        (five_bar(), Pid::five_bar, 0.044_56, |k| {
            triangle(k + 1250, 200.0, 5000)
        }),
        (five_bar(), Pid::five_bar, 0.044_56, sine),
    ] {
        let coarse = Joint::new(p, CYCLE).unwrap();
        let fine = Joint::new(p, 4e-6).unwrap();
        let mut pid = pid();
        let (mut a, mut b) = (JointState::default(), JointState::default());
        let mut worst = 0.0_f64;
        for k in 0..10_000 {
            let voltage = pid.voltage(round_up(reference(k)), b.motor_angle);
            coarse.advance(&mut a, voltage, CYCLE);
            fine.advance(&mut b, voltage, CYCLE);
            worst = worst.max((coarse.output(&a) - fine.output(&b)).abs() * metres);
        }
        eprintln!("worst deviation {:.2e} um", worst * 1e6);
        assert!(worst < 1e-10, "{worst} m");
    }
}

#[test]
fn without_static_friction_there_is_no_endless_change_of_mode() {
    let mut p = five_bar();
    p.load_friction = Friction::new(0.0, 0.0, 0.211).unwrap();
    p.motor_friction = frictionless();
    let joint = joint(p);
    let mut state = JointState::default();
    for k in 0..2000 {
        joint.advance(&mut state, triangle(k, 2.0, 300), CYCLE);
    }
    assert!(state.load_angle.is_finite() && state.load_angle != 0.0);
    assert!(
        (joint.output(&state) - state.load_angle).abs() < 1e-15,
        "nothing gives way"
    );
}

proptest! {
    /// Without a voltage the energy only falls, from whatever state.
    #[test]
    fn energy_is_never_created(
        qm in -1.0..1.0_f64, ql in -0.02..0.02_f64, vm in -300.0..300.0_f64, vl in -3.0..3.0_f64,
        z in any::<bool>(),
    ) {
        // This is about physics, not about step size.
        let joint = Joint::new(if z { z_stage() } else { five_bar() }, 1e-5).unwrap();
        let scale = if z { 1.0 } else { 0.1 };
        let mut state = JointState {
            motor_angle: qm * scale, load_angle: ql * scale, motor_velocity: vm, load_velocity: vl,
            motor_mode: Mode::towards(vm), load_mode: Mode::towards(vl), ..JointState::default()
        };
        let mut before = joint.energy(&state);
        for _ in 0..200 {
            joint.advance(&mut state, 0.0, CYCLE);
            let after = joint.energy(&state);
            prop_assert!(after <= before * (1.0 + 1e-9) + 1e-18, "{before} -> {after}");
            before = after;
        }
    }

    /// Whatever the voltage does, a stuck body does not move and every number is finite.
    #[test]
    fn modes_and_velocities_agree(voltages in prop::collection::vec(-12.0..12.0_f64, 200), z in any::<bool>()) {
        let joint = joint(if z { z_stage() } else { five_bar() });
        let mut state = JointState::default();
        for u in voltages {
            joint.advance(&mut state, u, CYCLE);
            for (mode, v) in [(state.motor_mode, state.motor_velocity), (state.load_mode, state.load_velocity)] {
                prop_assert!(v.is_finite());
                prop_assert!(v * mode.sign() >= 0.0, "{mode:?} at {v}");
                if mode == Mode::Stuck { prop_assert_eq!(v, 0.0); }
            }
        }
    }
}
