//! The formula for a pulse's displacement against the joint itself.

use crate::parameters::{five_bar, z_stage};
use pigtail_model::friction::Friction;
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_model::pulse::{Outside, Pulse};

/// Amplitudes in voltages at which the motor breaks away, milliseconds.
fn pulse(p: &JointParameters, a1: f64, a2: f64, ms: f64) -> Pulse {
    let unit = p.motor_friction.static_level() / p.motor.gain();
    Pulse::impulse(a1 * unit, a2 * unit, 1e-3 * ms)
}

/// How far the joint goes, radians.
fn goes(p: JointParameters, pulse: Pulse) -> f64 {
    // A pulse changes within a servo cycle.
    let joint = Joint::new(p, 1e-5).expect("valid parameters");
    let mut state = JointState::default();
    joint.advance(&mut state, pulse, pulse.period);
    joint.advance(&mut state, 0.0, 0.1);
    state.load_angle
}

/// The z-stage, and others whose motor, transmission and friction are half as much or twice.
fn joints() -> Vec<JointParameters> {
    let friction = |f: &Friction, by| f.scaled(by).expect("valid parameters");
    let mut all = vec![z_stage()];
    for by in [0.5, 0.8, 1.25, 2.0] {
        let mut p = z_stage();
        p.motor_friction = friction(&p.motor_friction, by);
        all.push(p);
        let mut p = z_stage();
        p.load_friction = friction(&p.load_friction, by);
        all.push(p);
        let mut p = z_stage();
        p.motor_inertia *= by;
        all.push(p);
        let mut p = z_stage();
        p.load_inertia *= by;
        all.push(p);
    }
    all
}

/// Wherever it says anything: to 6 % and 3 nm of z, which is 3e-5 radians.
#[test]
fn a_formula_tells_how_far_a_pulse_moves_a_load() {
    const NANOMETRE: f64 = std::f64::consts::TAU / 0.635e6;
    let (mut told, mut all, mut worst) = (0, 0, (0.0_f64, 0.0_f64));
    for p in joints() {
        for ms in [0.5, 0.8, 1.0, 1.2] {
            for a2 in [0.0, 4.0, 8.0, 12.8, 20.0] {
                for a1 in [1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0] {
                    all += 1;
                    let pulse = pulse(&p, a1, a2, ms);
                    let Ok(formula) = pulse.displacement(&p) else {
                        continue;
                    };
                    let real = goes(p, pulse);
                    let off = (formula - real).abs();
                    told += 1;
                    worst.0 = worst.0.max(off / NANOMETRE);
                    if real > 30.0 * NANOMETRE {
                        worst.1 = worst.1.max(off / real);
                    }
                    assert!(
                        off < 0.06 * real + 3.0 * NANOMETRE,
                        "{a1} {a2} {ms}: {} nm, {} nm by the formula; {p:?}",
                        real / NANOMETRE,
                        formula / NANOMETRE
                    );
                }
            }
        }
    }
    println!("{told} of {all}; worst {worst:?}");
    assert!(2 * told > all, "{told} of {all}");
}

#[test]
fn a_second_harmonic_takes_the_dead_zone_away_in_the_formula_too() {
    let p = z_stage();
    let least = |a2: f64| {
        let moves = |a1: &f64| {
            pulse(&p, *a1, a2, 1.0)
                .displacement(&p)
                .is_ok_and(|q| q > 0.0)
        };
        (0..100)
            .map(|k| 0.1 * f64::from(k))
            .find(moves)
            .expect("some do")
    };
    assert!(least(0.0) > 3.0, "{}", least(0.0));
    assert!(least(12.8) < 2.0, "{}", least(12.8));
}

#[test]
fn where_it_does_not_hold_it_says_so() {
    let p = z_stage();
    let of = |a1, a2, ms| pulse(&p, a1, a2, ms).displacement(&p);
    assert_eq!(of(3.0, 12.8, 4.0), Err(Outside::Pulse));
    assert_eq!(of(1.0, 12.8, 1.0), Err(Outside::StopsEarly));
    assert_eq!(of(14.0, 0.0, 1.0), Err(Outside::DrawnBack));
    let other = five_bar();
    assert_eq!(
        pulse(&other, 3.0, 12.8, 1.0).displacement(&other),
        Err(Outside::Joint)
    );
}
