//! Tests on what this repository does not hold: records of real machines, and trajectories of an independent
//! code. They lie in `../shared`. Where something is not there, its tests are counted as ignored, with the
//! reason in front of their names, and the last line says so: what was not compared must not look as if it
//! had been.

#[path = "../made/mod.rs"]
mod made;
mod oracle;
#[path = "../../../../crates/model/tests/joint/parameters.rs"]
#[allow(
    dead_code,
    reason = "the joint's own tests take what is not needed here"
)]
mod parameters;
mod records;

use libtest_mimic::{Arguments, Trial};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Where a file or a folder of `../shared` is.
fn shared(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared")
        .join(path)
}

/// What a test needs, its name, and the test.
type Test = (&'static str, &'static str, fn());

macro_rules! tests {
    ($($needs:literal: $($test:path),+;)+) => {
        [$($(($needs, stringify!($test), $test as fn())),+),+]
    };
}

const TESTS: [Test; 7] = tests! {
    "oracle":
        oracle::an_impulse_on_the_z_stage_to_a_thousandth_of_a_nanometre,
        oracle::a_step_of_the_five_bar_to_a_tenth_of_a_nanometre,
        oracle::the_equations_make_the_step_too;
    "data/emps": records::the_published_servo_is_found_and_replayed;
    "data/kuka_kr300_dual_encoder": records::a_measured_transmission_is_told;
    "data/piezo_picma_p885": records::fitted_on_the_full_loop_the_model_tells_the_nested_ones;
    "data/presliding_tribometer": records::a_measured_presliding_is_told;
};

fn main() -> ExitCode {
    let mut missing: Vec<&str> = TESTS
        .into_iter()
        .map(|(needs, ..)| needs)
        .filter(|needs| !shared(needs).exists())
        .collect();
    let trials = TESTS.map(|(needs, name, test)| {
        let absent = missing.contains(&needs);
        let trial = Trial::test(format!("measured::{name}"), move || {
            test();
            Ok(())
        });
        let kind = format!("no ../shared/{needs}");
        let trial = trial.with_ignored_flag(absent);
        if absent { trial.with_kind(kind) } else { trial }
    });
    let conclusion = libtest_mimic::run(&Arguments::from_args(), trials.into());
    if !missing.is_empty() {
        let count = missing.len();
        missing.dedup();
        let folders = missing.join(", ");
        eprintln!("NOT COMPARED: {count} tests, for ../shared has no {folders}");
    }
    conclusion.exit_code()
}
