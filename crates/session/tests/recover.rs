//! The way back after gains that the guard stopped.

use pigtail_control::servo::Pid;
use pigtail_hal::quantity::Counts;
use pigtail_hal::{Axis, AxisName, Fault, Rule, Side};
use pigtail_session::{Setup, job::Ended};

const AT: AxisName = AxisName {
    side: Side::Right,
    axis: Axis::A,
};

/// Gains of the wrong sign drive the axis away until the guard stops the machine; then it is brought back by
/// gains of this sign. The fault, and how many counts off it is then.
fn run_away(setup: &Setup, seed: u64, sign: f64) -> (Option<Fault>, Result<i64, Ended>) {
    let mut stopped = None;
    let way_back = setup.experiment(seed, |station| {
        let voltage = setup.rig.spec.drive(AT.axis).voltage;
        let period = station.spec().period();
        let pid = |sign: f64| {
            let mut gains = setup.rig.calibration.gains.five_bar.clone();
            gains.kp *= sign;
            gains.kd *= sign;
            Pid::new(&gains, voltage, period)
        };
        station.run(0.1)?;
        let to = Counts(station.encoder(AT).0 + 200);
        station.set_pid(AT, pid(-1.0));
        station.reference(AT, to);
        let Err(fault) = station.run(1.0) else {
            return Ok(0);
        };
        stopped = Some(fault.clone());
        station.set_pid(AT, pid(sign));
        station.recover(fault)?;
        Ok(station.encoder(AT).0 - to.0)
    });
    (stopped, way_back)
}

#[test]
fn a_machine_comes_back_after_gains_that_run_away() {
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    for seed in 40..46 {
        let (stopped, back) = run_away(&setup, seed, 1.0);
        let rule = stopped.expect("the guard stopped it").rule;
        assert_eq!(rule, Rule::Workspace, "seed {seed}");
        let counts = back.unwrap_or_else(|why| panic!("seed {seed}: {why:?}"));
        // The servo holds it where friction lets it; it was 2 mm out of its workspace.
        assert!(counts.abs() <= 10, "seed {seed}: {counts} counts off");
    }
}

#[test]
fn what_was_left_outside_may_not_go_farther_out() {
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    let (_, back) = run_away(&setup, 47, -1.0);
    let Err(Ended::Fault(fault)) = back else {
        panic!("{back:?}");
    };
    assert_eq!(fault.rule, Rule::Workspace);
}
