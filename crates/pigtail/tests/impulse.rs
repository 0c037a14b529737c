//! Impulse control (thesis 4.3), on machines and seeds that nothing was tuned with.

use pigtail::impulse::response::{Document, response};
use pigtail::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, Setup};
use pigtail_control::impulse::Shape;
use pigtail_hal::AxisName;

fn rig() -> Setup {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig is there")
}

/// The rig with the plant as it is written, no specimen drawn around it.
fn nominal() -> Setup {
    let mut setup = rig();
    let v = &mut setup.plant.variation;
    (v.inertia, v.friction, v.stiffness, v.motor, v.links) = (0.0, 0.0, 0.0, 0.0, 0.0);
    setup
}

fn axis(name: &str) -> AxisName {
    name.parse().expect("an axis")
}

fn of(setup: &Setup, name: &str, seed: u64) -> Document {
    response(setup, axis(name), seed).expect("a response").0
}

/// Thesis 4.3.1: without the second harmonic a wide dead zone, none with 12.5 times the motor's static
/// friction, 35 nm at 1.5 times of it, a parabola; and one count of windup in between is too much.
#[test]
fn pulses_move_a_z_stage_as_the_thesis_says() {
    let d = of(&nominal(), "z", 31);
    assert!((d.fsm_v / 0.71337 - 1.0).abs() < 0.03, "{}", d.fsm_v);
    assert!((d.a2_fsm / 12.5 - 1.0).abs() < 0.08, "{}", d.a2_fsm);
    assert!(d.dead_zone_fsm < 0.3, "{}", d.dead_zone_fsm);
    let without = d.dead_zones[0].dead_zone_fsm.expect("less than 5");
    assert!((without / 3.45 - 1.0).abs() < 0.05, "{without}");
    assert!((30.0..45.0).contains(&d.displacement_nm.value));
    assert!(d.r2 > 0.95, "{}", d.r2);
    assert!(d.spread.p10 < d.displacement_nm.value && d.displacement_nm.value < d.spread.p90);
    assert_eq!(d.relax, "dither");
    let row = |name: &str| d.rows.iter().find(|row| row.relax == name).expect("a row");
    // 35, 113, 91 nm where the transmission is not brought back.
    let left = &row("none").nm;
    assert!(
        left[1] > 2.5 * left[0] && left[2] < 0.9 * left[1],
        "{left:?}"
    );
    assert!(row("dither").unevenness.expect("it moves") < 0.05);
}

/// Thesis 4.3.3: 2.3 times on a five-bar.
#[test]
fn pulses_move_a_five_bar_as_the_thesis_says() {
    let d = of(&nominal(), "fivebar", 32);
    assert!((d.a2_fsm / 2.3 - 1.0).abs() < 0.08, "{}", d.a2_fsm);
    assert!(d.r2 > 0.98, "{}", d.r2);
    // Its amplifier plays no higher than 12 V: what is beyond is left empty.
    let last = d.map.nm.last().expect("rows");
    assert!(last.iter().all(Option::is_none));
    assert!(d.map.nm[0].iter().all(Option::is_some));
}

#[test]
fn the_same_seed_is_the_same_response_and_another_joint_is_another() {
    let setup = rig();
    let one = of(&setup, "fivebar", 33);
    assert_eq!(one, of(&setup, "fivebar", 33));
    assert_ne!(one.fsm_v, of(&setup, "right.a", 33).fsm_v);
}

#[test]
fn a_rig_that_cannot_is_told_what_it_lacks() {
    let mut setup = rig();
    setup.spec.z_stage.drive.pulse = None;
    let message = |setup: &Setup, name: &str| {
        response(setup, axis(name), 1)
            .expect_err("refused")
            .to_string()
    };
    assert!(message(&setup, "z").contains("z_stage.drive.pulse"));
    setup.spec.probe = None;
    assert!(message(&setup, "fivebar").contains("probe"));
    let mut slow = rig();
    if let Some(pulse) = &mut slow.spec.z_stage.drive.pulse {
        pulse.bandwidth = 500.0;
    }
    assert!(message(&slow, "z").contains("at least 2.0000 ms"));
    let mut weak = rig();
    if let Some(pulse) = &mut weak.spec.z_stage.drive.pulse {
        pulse.voltage = 5.0;
    }
    assert!(message(&weak, "z").contains("drive.pulse.voltage"));
}

#[test]
fn a_calibration_says_what_was_measured() {
    let setup = rig();
    for belief in [
        &setup.calibration.impulse.z,
        &setup.calibration.impulse.five_bar,
    ] {
        let belief = belief.as_ref().expect("the rig is calibrated");
        assert_eq!(belief.check(), Ok(()));
        let shape: Shape = belief.shape();
        assert!(shape.fixed[0] > belief.unit && shape.period == 1e-3);
    }
}
