//! The way back after gains that the guard stopped.

use pigtail_control::servo::Pid;
use pigtail_hal::quantity::Counts;
use pigtail_hal::{Axis, AxisName, Fault, Rule, Side};
use pigtail_session::{Setup, job::Ended};

const AT: AxisName = AxisName {
    side: Side::Right,
    axis: Axis::A,
};

/// Gains of the wrong sign drive the axis away until the guard stops the machine.
fn ring(setup: &Setup, seed: u64, factor: f64) -> (Option<Fault>, Result<i64, Ended>) {
    let mut stopped = None;
    let way_back = setup.experiment(seed, |station| {
        let gains = &setup.rig.calibration.gains.five_bar;
        let voltage = setup.rig.spec.drive(AT.axis).voltage;
        let period = station.spec().period();
        let pid = |by: f64| {
            let mut gains = gains.clone();
            gains.kp *= by;
            gains.kd *= by;
            Pid::new(&gains, voltage, period)
        };
        station.run(0.1)?;
        let to = Counts(station.encoder(AT).0 + 200);
        station.set_pid(AT, pid(factor));
        station.reference(AT, to);
        let Err(fault) = station.run(1.0) else {
            return Ok(0);
        };
        stopped = Some(fault.clone());
        station.set_pid(AT, pid(1.0));
        station.recover(fault)?;
        Ok(station.encoder(AT).0 - to.0)
    });
    (stopped, way_back)
}

#[test]
fn a_machine_comes_back_after_gains_that_run_away() {
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    for seed in 40..46 {
        for factor in [-1.0, -0.2] {
            let (stopped, back) = ring(&setup, seed, factor);
            let rule = stopped.expect("the guard stopped it").rule;
            assert!(
                matches!(rule, Rule::Workspace | Rule::EncoderSpeed),
                "{rule:?}"
            );
            let counts = back.unwrap_or_else(|why| panic!("seed {seed}, {factor}: {why:?}"));
            // The servo holds it where friction lets it; it was 2 mm out of its workspace.
            assert!(
                counts.abs() <= 10,
                "seed {seed}, {factor}: {counts} counts off"
            );
        }
    }
}
