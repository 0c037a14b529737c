//! Impulse control (thesis 4.3), on machines and seeds that nothing was tuned with.

use pigtail_control::impulse::Shape;
use pigtail_evaluate::impulse::condition::Condition;
use pigtail_evaluate::impulse::contest::contest;
use pigtail_evaluate::impulse::response::{Form, MACHINES, ResponseDocument, response};
use pigtail_evaluate::impulse::run::{
    GAINS, Task, check, resolution, run, runs, stability, summary,
};
use pigtail_evaluate::impulse::shapes::{Effort, study};
use pigtail_hal::AxisName;
use pigtail_session::impulse::Estimator;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use pigtail_twin::plant::LoadLaw;

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

fn of(setup: &Setup, name: &str, seed: u64) -> ResponseDocument {
    /// Enough for a tenth of them to lie below and above.
    const FEW: usize = 20;
    response(setup, axis(name), &Form::THESIS, FEW, seed)
        .expect("a response")
        .0
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
    let left = &row("start").nm;
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
    setup.rig.spec.z_stage.drive.pulse = None;
    let message = |setup: &Setup, name: &str| {
        response(setup, axis(name), &Form::THESIS, MACHINES, 1)
            .expect_err("refused")
            .to_string()
    };
    assert!(message(&setup, "z").contains("z_stage.drive.pulse"));
    setup.rig.spec.probe = None;
    assert!(message(&setup, "fivebar").contains("probe"));
    let mut slow = rig();
    if let Some(pulse) = &mut slow.rig.spec.z_stage.drive.pulse {
        pulse.bandwidth = 500.0;
    }
    assert!(message(&slow, "z").contains("at least 2.0000 ms"));
    let mut weak = rig();
    if let Some(pulse) = &mut weak.rig.spec.z_stage.drive.pulse {
        pulse.voltage = 5.0;
    }
    assert!(message(&weak, "z").contains("drive.pulse.voltage"));
}

#[test]
fn a_calibration_says_what_was_measured() {
    let setup = rig();
    for belief in [
        &setup.rig.calibration.impulse.z,
        &setup.rig.calibration.impulse.five_bar,
    ] {
        let belief = belief.as_ref().expect("the rig is calibrated");
        assert_eq!(belief.check(), Ok(()));
        let shape: Shape = belief.shape();
        assert!(shape.fixed[0] > belief.unit && shape.period == 1e-3);
    }
}

fn task(name: &str, nm: f64) -> Task {
    Task::usual(axis(name), 1e-9 * nm)
}

/// Thesis Fig. 4.20 asks for 10 nm: most machines get there in eight pulses, each differing by 10 % of
/// friction, a tenth of a count and 4 nm, and more of them than by the thesis's own law.
fn a_hundred_nanometres_are_made(machines: u64) {
    let setup = rig();
    let of = |estimator| {
        let task = Task {
            estimator,
            ..task("z", 100.0)
        };
        summary(
            &task,
            &runs(&setup, &task, 91_000, machines).expect("no fault"),
        )
    };
    let (recursive, parabola) = (of(Estimator::Recursive), of(Estimator::Parabola));
    assert!(recursive.below_10nm_percent >= 95.0, "{recursive:?}");
    assert!(recursive.pulses.p99 <= 8.0);
    assert!(
        parabola.below_10nm_percent < recursive.below_10nm_percent,
        "{parabola:?}"
    );
}

#[test]
fn a_hundred_nanometres_are_made_to_ten() {
    a_hundred_nanometres_are_made(40);
}

#[test]
#[ignore = "long: 300 machines"]
fn a_hundred_nanometres_are_made_to_ten_by_most_machines() {
    a_hundred_nanometres_are_made(300);
}

/// A machine whose friction is 30 % off, drifts, or differs in the two directions: what was measured on
/// another is soon corrected.
#[test]
#[ignore = "long: 800 machines"]
fn a_machine_that_is_not_as_believed_is_learnt() {
    let setup = rig();
    for (name, nm) in [("z", 100.0), ("fivebar", -1500.0)] {
        for condition in [
            Condition::High,
            Condition::Low,
            Condition::Drift,
            Condition::Directions,
        ] {
            let task = Task {
                condition,
                ..task(name, nm)
            };
            let row = summary(&task, &runs(&setup, &task, 92_000, 100).expect("no fault"));
            assert!(row.within_tolerance_percent >= 93.0, "{row:?}");
        }
    }
}

/// Thesis Fig. 4.22: below 0.15 um from four sides within 3 s by its law at its rate; within 1 s by
/// ours.
#[test]
fn a_five_bar_settles_from_four_sides() {
    let setup = rig();
    for nm in [-1500.0, -700.0, 700.0, 1500.0] {
        let ours = run(&setup, &task("fivebar", nm), 93).expect("no fault");
        assert!(ours.settled_s.is_some_and(|s| s < 1.0), "{ours:?}");
        let thesis = Task {
            estimator: Estimator::Parabola,
            rest: Some(0.25),
            ..task("fivebar", nm)
        };
        let theirs = run(&setup, &thesis, 93).expect("no fault");
        assert!(theirs.settled_s.is_some_and(|s| s < 3.0), "{theirs:?}");
    }
}

/// (4.12): errors die away for gains below two, and do not at 2.1.
#[test]
fn the_loop_is_stable_for_gains_between_zero_and_two() {
    let setup = rig();
    let documents = stability(&setup, axis("z"), 94).expect("no fault");
    for (gain, d) in GAINS.into_iter().zip(&documents) {
        assert_eq!(d.gain, gain);
        let first = d.steps[0].error_nm.abs();
        let late = d.steps[d.steps.len() - 10..].iter();
        let left = late.fold(0.0, |high: f64, step| high.max(step.error_nm.abs()));
        if gain < 2.0 {
            assert!(left < 0.3 * first, "{gain}: {left} of {first}");
        } else {
            assert!(left > 0.7 * first, "{gain}: {left} of {first}");
        }
    }
}

/// Figs. 4.23 and 4.24: 0.2 um and 20 nm in one direction.
#[test]
fn pulses_in_one_direction_resolve_far_below_a_count() {
    let mut quiet = task("fivebar", 0.0);
    quiet.condition = Condition::Quiet;
    let steps = resolution(&rig(), &quiet, 2e-7, 95).expect("no fault");
    assert!((steps.mean_nm / 200.0 - 1.0).abs() < 0.15, "{steps:?}");
    assert!(steps.least_nm > 100.0 && steps.greatest_nm < 300.0);
    quiet.at = axis("z");
    let steps = resolution(&rig(), &quiet, 2e-8, 95).expect("no fault");
    assert!((steps.mean_nm / 20.0 - 1.0).abs() < 0.3, "{steps:?}");
    assert!(steps.least_nm > 0.0);
}

#[test]
fn the_same_seeds_are_the_same_runs_whatever_works_on_them() {
    let setup = rig();
    let task = task("z", 60.0);
    let together = runs(&setup, &task, 96, 4).expect("no fault");
    for (k, document) in together.iter().enumerate() {
        assert_eq!(
            *document,
            run(&setup, &task, 96 + k as u64).expect("no fault")
        );
    }
}

#[test]
fn a_task_that_cannot_be_done_is_refused() {
    let message = |setup: &Setup, task: &Task| check(setup, task).expect_err("refused").to_string();
    let setup = rig();
    assert!(check(&setup, &task("z", 100.0)).is_ok());
    for gain in [-0.5, 0.0, 2.0, 2.1, f64::NAN] {
        let mut bad = task("z", 100.0);
        bad.settings.gain = gain;
        assert!(message(&setup, &bad).contains("above 0 and below 2"));
    }
    assert!(message(&setup, &task("z", 1e5)).contains("--target-nm"));
    let mut unknown = rig();
    unknown.rig.calibration.impulse.z = None;
    assert!(message(&unknown, &task("z", 100.0)).contains("characterize left.z impulse"));
    let mut blind = rig();
    blind.rig.spec.probe = None;
    assert!(message(&blind, &task("z", 100.0)).contains("probe"));
    // A calibration that asks for more than the amplifier of this rig plays.
    let mut weak = rig();
    if let Some(pulse) = &mut weak.rig.spec.z_stage.drive.pulse {
        pulse.voltage = 6.0;
    }
    assert!(message(&weak, &task("z", 100.0)).contains("at most 6 V"));
    let mut slow = rig();
    if let Some(belief) = &mut slow.rig.calibration.impulse.z {
        belief.period = 0.3e-3;
    }
    assert!(message(&slow, &task("z", 100.0)).contains("at least 0.4000 ms"));
}

/// So little that a test has time for it.
const LITTLE: Effort = Effort {
    machines: 6,
    judges: 40,
    generations: 5,
    members: 4,
};

/// Thesis 4.3.4 asks for more harmonics: at equal peak voltage a third one leaves less spread and less of
/// a dead zone on machines that it was not chosen by.
#[test]
fn a_third_harmonic_is_worth_more_than_two() {
    let setup = rig();
    let study = study(&setup, axis("z"), 97, &LITTLE).expect("a study");
    let of = |name: &str| {
        let found = study.shapes.iter().find(|judged| judged.name == name);
        found.expect("a shape")
    };
    let thesis = of("thesis");
    assert!((thesis.wave.amplitudes[1] / study.unit / 12.5 - 1.0).abs() < 0.08);
    assert_eq!(thesis.wave.period, 1e-3);
    for judged in &study.shapes {
        let most = judged.wave.most(study.peak).expect("within the voltage");
        let peak = judged.wave.with(most).peak();
        assert!((peak / study.peak - 1.0).abs() < 2e-3, "{}", judged.name);
    }
    let more = of("three sines");
    assert!(more.merit.cost < 0.9 * thesis.merit.cost, "{study:?}");
    assert!(more.merit.dead_zone < thesis.merit.dead_zone);
}

#[test]
fn a_study_is_the_same_whatever_the_number_of_threads() {
    let setup = rig();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let effort = Effort {
            generations: 2,
            judges: 10,
            ..LITTLE
        };
        pool.expect("threads")
            .install(|| contest(&setup, axis("fivebar"), 98, &effort, 3).expect("a study"))
    };
    assert_eq!(with(1), with(3));
}

/// The loop gains by it where it learns nothing, on machines that nothing was chosen by.
#[test]
#[ignore = "long: 800 machines"]
fn a_loop_gains_by_a_third_harmonic() {
    let setup = rig();
    let found = |form: &Form| {
        // What is found of an axis is not the spread over machines.
        response(&setup, axis("z"), form, 1, 1001)
            .expect("a response")
            .2
    };
    let form = Form {
        fixed: Some([11.09, -4.0, 0.0]),
        period: 1.36e-3,
    };
    let mut shaped = setup.clone();
    let belief = shaped
        .rig
        .calibration
        .impulse
        .z
        .as_mut()
        .expect("calibrated");
    let new = found(&form);
    (belief.fixed, belief.period) = (new.shape.fixed, new.shape.period);
    belief.curve = new.curve.iter().step_by(2).copied().collect();
    belief.scatter = new.scatter;
    assert_eq!(belief.check(), Ok(()));
    let of = |setup: &Setup, estimator| {
        let task = Task {
            estimator,
            ..task("z", 100.0)
        };
        summary(&task, &runs(setup, &task, 99_000, 200).expect("no fault"))
    };
    let (before, after) = (
        of(&setup, Estimator::Parabola),
        of(&shaped, Estimator::Parabola),
    );
    assert!(
        after.below_10nm_percent > before.below_10nm_percent + 4.0,
        "{before:?} {after:?}"
    );
    let (before, after) = (
        of(&setup, Estimator::Recursive),
        of(&shaped, Estimator::Recursive),
    );
    assert!(after.below_10nm_percent >= 95.0, "{after:?}");
    assert!(
        after.pulses.p90 <= before.pulses.p90,
        "{before:?} {after:?}"
    );
}

#[test]
fn a_pulse_that_cannot_be_played_is_refused_before_anything_moves() {
    let setup = rig();
    let message = |fixed: [f64; 3], period: f64| {
        let form = Form {
            fixed: Some(fixed),
            period,
        };
        let error = response(&setup, axis("z"), &form, MACHINES, 1).expect_err("refused");
        error.to_string()
    };
    assert!(message([40.0, 0.0, 0.0], 1e-3).contains("at most 24 V"));
    assert!(message([10.0, -3.0, 2.0], 0.7e-3).contains("at least 0.8000 ms"));
    let mut other = rig();
    other.plant.z_stage.joint.friction = LoadLaw::LuGre;
    let error = study(&other, axis("z"), 1, &LITTLE).expect_err("refused");
    assert!(error.to_string().contains("coulomb-presliding"), "{error}");
}
