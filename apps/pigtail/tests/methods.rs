//! The thesis's three searches for first light: closed forms, and runs on the twin.

use pigtail_control::methods::{Method, Space};
use pigtail_control::station::Unobserved;
use pigtail_evaluate::methods::{SearchDocument, check, run};
use pigtail_evaluate::plan::plan;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use serde_json::Value;
use std::process::Output;

fn setup() -> Setup {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig is well")
}

fn space(method: Method, mesh: f64) -> Space {
    Space {
        mesh,
        ..Space::new(method, &setup().rig.recipe)
    }
}

fn cover(setup: &Setup, space: &Space, seed: u64) -> SearchDocument {
    check(setup, space).expect("the machine can");
    run(setup, space, seed, &mut Unobserved).expect("no fault")
}

fn pigtail(arguments: &[&str]) -> Output {
    let folder = tempfile::TempDir::new().expect("a folder");
    let output = assert_cmd::Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder.path())
        .args(arguments)
        .output()
        .expect("the program starts");
    let left = std::fs::read_dir(folder.path()).expect("the folder");
    assert_eq!(left.count(), 0, "it leaves no files");
    output
}

fn near(value: f64, expected: f64, share: f64) -> bool {
    (value / expected - 1.0).abs() < share
}

/// 67 and 8.3 minutes (3.3), 5.3 minutes (3.4), 5 seconds (3.5); where the photodiode sets the
/// scan rate, the same at 5 um and half of it at 10 um.
#[test]
fn closed_forms_are_those_of_the_thesis() {
    let macro_raster = |mesh| space(Method::MacroRaster, mesh);
    assert!(near(macro_raster(5e-6).closed_form(), 4000.0, 1e-9));
    assert!(near(macro_raster(10e-6).closed_form(), 500.0, 1e-9));
    assert!(near(
        macro_raster(5e-6).photodiode_limited(500.0),
        4021.24,
        1e-5
    ));
    assert!(near(
        macro_raster(10e-6).photodiode_limited(500.0),
        251.327,
        1e-5
    ));
    assert!(near(macro_raster(5e-6).fastest(500.0), 7.9577, 1e-4));
    assert!(near(
        space(Method::MicroRaster, 5e-6).closed_form(),
        320.0,
        1e-9
    ));
    assert!(near(
        space(Method::Multimode, 5e-6).closed_form(),
        5.0,
        1e-9
    ));
    assert!(near(
        space(Method::Multimode, 5e-6).photodiode_limited(500.0),
        5.02655,
        1e-5
    ));
}

#[test]
fn method_2_is_refused_where_the_photodiode_is_too_slow() {
    let output = pigtail(&["align", "--method", "micro-raster"]);
    let error = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert_eq!(error.lines().count(), 1, "{error}");
    for part in [
        "rigs/afpm/machine.toml",
        "`photodiode.rate`",
        "500 Hz",
        "accepted is at least 6160 Hz",
    ] {
        assert!(error.contains(part), "no \"{part}\" in: {error}");
    }
}

#[test]
fn what_no_method_can_do_is_refused() {
    for (arguments, parts) in [
        (
            &["--method", "macro-raster", "--mesh", "1 um"][..],
            &["--mesh", "1 um", "hours", "accepted"][..],
        ),
        (
            &["--method", "multimode", "--mesh", "150 um"],
            &["--mesh", "150 um", "at most 100 um"],
        ),
        (
            &["--method", "multimode", "--mesh", "5 kg"],
            &["--mesh", "5 kg", "um"],
        ),
        (
            &["--method", "multimode", "--scan-rate", "200 Hz"],
            &["--scan-rate", "200 Hz", "at most 100 Hz"],
        ),
        (
            &["--method", "multimode", "--scan-rate", "16 Hz"],
            &["photodiode.rate", "500 Hz", "at least 986 Hz"],
        ),
        (&["--mesh", "5 um"], &["--method"]),
        (
            &["--method", "multimode", "--procedure", "fast"],
            &["--procedure"],
        ),
        (
            &["--method", "guess"],
            &["macro-raster", "micro-raster", "multimode"],
        ),
    ] {
        let output = pigtail(&[&["align"], arguments].concat());
        let error = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    }
}

/// On how many of these machines the third method finds light, in its time.
fn method_3_finds(seeds: std::ops::Range<u64>) -> u32 {
    let (setup, space) = (setup(), space(Method::Multimode, 5e-6));
    let mut found = 0;
    for seed in seeds {
        let document = cover(&setup, &space, seed);
        let seconds = document.measured_seconds.expect("a search");
        assert!(near(seconds, 5.0, 0.05), "seed {seed}: {seconds} s");
        found += u32::from(document.found);
    }
    found
}

#[test]
#[ignore = "long: twenty machines"]
fn method_3_finds_light_on_most_machines() {
    // The areas are the formula's, without the margins of a procedure.
    let found = method_3_finds(0..20);
    assert!(found >= 15, "{found} of 20");
}

#[test]
fn method_3_finds_light_and_covers_in_its_time() {
    assert!(method_3_finds(0..2) > 0);
    let output = pigtail(&["align", "--method", "multimode", "--json"]);
    assert_eq!(output.status.code(), Some(0));
    let document: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    assert_eq!(document["method"], "multimode");
    assert_eq!(document["found"], true);
    assert_eq!(document["closed_form_seconds"], 5.0);
    assert!(document["found_at"]["input_um"][1].is_f64());
    assert!(document["sensing_seconds"].as_f64().expect("seconds") > 0.0);
}

/// A device whose fibers are held well, so that a small area has them.
fn small() -> Setup {
    let mut setup = setup();
    setup.rig.recipe.raster.x = 60e-6;
    setup.rig.recipe.raster.y = 60e-6;
    setup.rig.spec.vision.accuracy_x = 15e-6;
    setup.plant.misplacement.y = 5e-6;
    setup.plant.misplacement.home = 5e-6;
    setup
}

#[test]
fn method_1_covers_a_small_area_in_its_time_and_finds_light_there() {
    let setup = small();
    let space = Space::new(Method::MacroRaster, &setup.rig.recipe);
    let document = cover(&setup, &space, 3);
    let seconds = document.measured_seconds.expect("a search");
    // 60 um x 60 um squared at 5 um and 8 Hz.
    assert!(near(document.closed_form_seconds, 216.0, 1e-9));
    assert!(near(seconds, 216.0, 0.15), "{seconds} s");
    assert!(document.found, "{document:?}");
    let found = document.found_seconds.expect("found");
    assert!(found > 0.0 && found < seconds + 5.0, "{found} s");
}

#[test]
fn the_same_seed_finds_the_same_and_a_dark_device_nothing() {
    let mut setup = setup();
    let space = space(Method::Multimode, 10e-6);
    let bare = |setup: &Setup| SearchDocument {
        wall_seconds: 0.0,
        ..cover(setup, &space, 4)
    };
    assert_eq!(bare(&setup), bare(&setup));
    setup.rig.recipe.raster.x = 40e-6;
    setup.rig.recipe.raster.y = 40e-6;
    setup.plant.light.full = 1e-6;
    let space = Space {
        mesh: 10e-6,
        ..Space::new(Method::MacroRaster, &setup.rig.recipe)
    };
    let document = cover(&setup, &space, 4);
    assert!(!document.found && document.measured_seconds.is_some());
}

/// Every method and mesh has its row; method 2 runs on a rig whose photodiodes are fast enough.
#[test]
#[ignore = "long: seven searches in full"]
fn a_plan_has_all_methods_measured() {
    let setup = small();
    let document = plan(&setup, 0, 1, &mut |_| ()).expect("no fault");
    assert_eq!(document.searches.len(), 7);
    assert_eq!(document.procedures.len(), 3);
    for row in &document.searches {
        let measured = row.measured_seconds.expect("measured");
        // In an area this small the ways between passes tell: the input's return to the bottom
        // after each, the output's to its next row, and method 2's period to bring a micro back.
        let points = 60.0 / row.mesh_um;
        let (passes, rows, periods) = match row.method {
            "macro-raster" => (points * points, points, 1.0),
            "micro-raster" => (points, points, (points + 1.0) / points),
            _ => (1.0, 1.0, 1.0),
        };
        let closed = row.closed_form_seconds;
        let most = 1.02 * periods * closed + 0.15 * passes + 0.35 * rows;
        assert!(measured > 0.98 * closed && measured < most, "{row:?}");
    }
    let method_2 = &document.searches[3];
    assert_eq!(method_2.method, "micro-raster");
    assert!(method_2.photodiode_hz > 3000.0, "{method_2:?}");
    assert!(method_2.note.contains("servo"), "{method_2:?}");
    assert!(
        document.searches[1].note.contains("part"),
        "at twice the mesh"
    );
    assert!(document.procedures.iter().all(|row| row.devices == 1));
}
