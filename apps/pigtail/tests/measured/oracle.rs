//! Joints against trajectories of an independent code, good to 1e-6 nm.

use crate::parameters::{Pid, five_bar};
use crate::shared;
use assert_cmd::Command;
use pigtail_model::joint::{Joint, JointState};

fn rows(text: &str) -> Vec<Vec<String>> {
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect()
}

/// Compares outputs of `pigtail simulate joint` within `bound` metres, and voltages, modes and counts.
fn agrees(reference: &str, arguments: &[&str], bound: f64) {
    let parameters = shared("oracle/oracle.json");
    let output = Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .args(["simulate", "joint", "--params"])
        .arg(&parameters)
        .args(arguments)
        .output()
        .expect("the program starts");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let ours = rows(&String::from_utf8(output.stdout).expect("UTF-8"));
    let text = std::fs::read_to_string(shared(reference)).expect("a trajectory");
    let theirs = rows(&text);
    assert_eq!(ours.len(), theirs.len());
    for (a, b) in ours.iter().zip(&theirs) {
        let number = |row: &[String], i: usize| row[i].parse::<f64>().expect("a number");
        assert!((number(a, 0) - number(b, 0)).abs() < 1e-12, "{a:?}");
        assert!(
            (number(a, 1) - number(b, 1)).abs() < 1e-9,
            "{a:?} for {b:?}"
        );
        assert!(
            (number(a, 6) - number(b, 6)).abs() < bound,
            "{a:?} for {b:?}"
        );
        assert_eq!(a[7..], b[7..], "modes and counts at {}", a[0]);
    }
}

pub(crate) fn an_impulse_on_the_z_stage_to_a_thousandth_of_a_nanometre() {
    let arguments = ["--axis", "z", "--impulse", "1.5,12.5,1e-3"];
    agrees("oracle/z_impulse_a1_1.5_a2_12.5.csv", &arguments, 1e-12);
}

pub(crate) fn a_step_of_the_five_bar_to_a_tenth_of_a_nanometre() {
    agrees(
        "oracle/fb_step_400.csv",
        &["--axis", "fivebar", "--step", "400"],
        1e-10,
    );
}

const METRES_PER_RADIAN: f64 = 0.044_563_384_065_730_696;

/// A five-bar step under PID by the equations alone.
pub(crate) fn the_equations_make_the_step_too() {
    let text = std::fs::read_to_string(shared("oracle/fb_step_400.csv")).expect("a trajectory");
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .map(|field| field.parse().expect("a number"))
                .collect()
        })
        .collect();
    // At the full voltage from rest and back, which is the hardest there is. One step a servo cycle is
    // within half a nanometre, a third of a thousandth of an encoder count (0.2 nm was seen first).
    for (step, bound) in [(50e-6, 1e-12), (200e-6, 1e-10), (400e-6, 5e-10)] {
        let joint = Joint::new(five_bar(), step).expect("valid parameters");
        let mut state = JointState::default();
        let mut pid = Pid::five_bar();
        let mut worst = 0.0_f64;
        for (k, row) in rows.iter().step_by(4).enumerate() {
            let voltage = pid.voltage(400, state.motor_angle);
            assert!(
                (voltage - row[1]).abs() < 1e-9,
                "cycle {k}: {voltage} V for {} V",
                row[1]
            );
            worst = worst.max((joint.output(&state) * METRES_PER_RADIAN - row[6]).abs());
            joint.advance(&mut state, voltage, 4e-4);
        }
        assert!(worst < bound, "{worst} m from the reference");
    }
}
