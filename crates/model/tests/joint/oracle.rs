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
    // At the full voltage from rest and back, which is the hardest there is. One step a servo cycle is
    // within half a nanometre, a third of a thousandth of an encoder count (0.2 nm was seen first).
    for (step, bound) in [(50e-6, 1e-12), (200e-6, 1e-10), (400e-6, 5e-10)] {
        let joint = Joint::new(five_bar(), step).unwrap();
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
        eprintln!("{step} s: worst deviation {:.2e} nm", worst * 1e9);
        assert!(worst < bound, "{worst} m from the reference");
    }
}
