//! A five-bar step under PID against a trajectory computed by an independent code to better than
//! 1e-6 nm. Reads `../shared/oracle`; skips, and says so, where that is missing.

use crate::parameters::{Pid, five_bar};
use pigtail_model::joint::{Joint, JointState};

const METRES_PER_RADIAN: f64 = 0.044_563_384_065_730_696;

#[test]
fn five_bar_step_of_400_counts() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../shared/oracle/fb_step_400.csv"
    );
    let Ok(text) = std::fs::read_to_string(path) else {
        eprintln!("skipped: no reference trajectory at {path}");
        return;
    };
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .map(|field| field.parse().unwrap())
                .collect()
        })
        .collect();
    let joint = Joint::new(five_bar(), 50e-6).unwrap();
    let mut state = JointState::default();
    let mut pid = Pid::five_bar();
    let (mut voltage, mut worst) = (0.0, 0.0_f64);
    for (k, row) in rows.iter().enumerate() {
        if k % 4 == 0 {
            voltage = pid.voltage(400, state.motor_angle);
            assert!(
                (voltage - row[1]).abs() < 1e-9,
                "row {k}: {voltage} V for {} V",
                row[1]
            );
        }
        worst = worst.max((joint.output(&state) * METRES_PER_RADIAN - row[6]).abs());
        joint.advance(&mut state, voltage, 1e-4);
    }
    assert!(worst < 1e-10, "{worst} m from the reference");
    eprintln!("worst deviation {:.2e} nm", worst * 1e9);
}
