//! Identification from records that were measured on real machines.

use crate::made::{answer, near, number, value};
use crate::shared;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// The JSON of a command that ends well.
fn whole(folder: &Path, arguments: &[&str]) -> Value {
    let (json, code) = answer(folder, arguments);
    assert_eq!(code, 0, "{json}");
    json
}

fn published(key: &str) -> [f64; 2] {
    match key {
        "inertia" => [95.1089, 0.1085],
        "viscous_friction" => [203.5034, 1.1460],
        "coulomb_friction" => [20.3935, 0.1012],
        _ => [-3.1648, 0.0444],
    }
}

const EMPS: [&str; 10] = [
    "--time",
    "t_s",
    "--reference",
    "q_ref_m",
    "--position",
    "q_meas_m",
    "--voltage",
    "u_V",
    "--force-per-volt",
    "35.15065188",
];

/// Four parameters and 5.2 % on the part held back is what is wanted.
pub(crate) fn a_measured_presliding_is_told() {
    let data = shared("data/presliding_tribometer/reciprocating_5N.csv");
    let folder = TempDir::new().expect("a folder");
    let arguments = [
        "identify",
        "friction",
        "--data",
        &data.display().to_string(),
        "--displacement",
        "position_mm",
        "--force",
        "friction_uN",
    ];
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 0, "{json}");
    assert!(number(&json, "validation_error_percent") <= 5.2, "{json}");
    let parameters = json["parameters"].as_object().expect("parameters");
    assert!(parameters.len() <= 4);
    for (name, parameter) in parameters {
        assert!(parameter["std"].as_f64().expect("known") > 0.0, "{name}");
    }
}

/// 0.03 to 0.043 degrees raw are to become 0.0045 or less, on each of the three axes.
pub(crate) fn a_measured_transmission_is_told() {
    let data = shared("data/kuka_kr300_dual_encoder/trajectory_A.csv");
    let folder = TempDir::new().expect("a folder");
    let data = data.display().to_string();
    for axis in 1..=3 {
        let name = |what: &str, unit: &str| format!("{what}{axis}_{unit}");
        let (json, code) = answer(
            folder.path(),
            &[
                "identify",
                "windup",
                "--data",
                &data,
                "--motor",
                &name("mot", "deg"),
                "--load",
                &name("se", "deg"),
                "--torque",
                &name("torque", "Nm"),
            ],
        );
        assert_eq!(code, 0, "{json}");
        assert!(number(&json, "raw_deg") > 0.03);
        let left = number(&json, "residual_deg");
        assert!(left <= 0.0045, "axis {axis}: {left}");
        let skew = value(&json, "time_skew").expect("known");
        assert!((2.5e-3..3.2e-3).contains(&skew), "axis {axis}: {skew}");
    }
}

/// The published solution within one per cent, standard deviations too; then better than the published
/// replay.
pub(crate) fn the_published_servo_is_found_and_replayed() {
    let data = shared("data/emps/emps_estimation.csv");
    let folder = TempDir::new().expect("a folder");
    let data = data.display().to_string();
    let arguments = [&["identify", "servo", "--data", &data][..], &EMPS].concat();
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 0);
    for name in ["inertia", "viscous_friction", "coulomb_friction", "offset"] {
        let [is, std] = published(name);
        near(value(&json, name).expect("known"), is, 1.0);
        let found = json["parameters"][name]["std"].as_f64().expect("known");
        near(found, std, 1.0);
    }
    near(number(&json, "relative_error_percent"), 4.0834, 1.0);
    near(number(&json, "condition"), 25.9883, 1.0);
    let replay = number(&json["replay"], "velocity_error_percent");
    assert!(replay <= 0.23, "{replay}");
    let asymmetric = [&arguments[..], &["--friction", "asymmetric"]].concat();
    let (json, _) = answer(folder.path(), &asymmetric);
    for (name, is) in [
        ("inertia", 95.1540),
        ("viscous_friction_forward", 166.7061),
        ("coulomb_friction_forward", 20.1440),
        ("viscous_friction_backward", 240.4236),
        ("coulomb_friction_backward", 20.6277),
    ] {
        near(value(&json, name).expect("known"), is, 1.0);
    }
    let report = json["report"].as_str().expect("a path");
    let html = fs::read_to_string(folder.path().join(report)).expect("a report");
    assert_eq!(html.matches("class=\"chart ").count(), 7);
}

/// The published operator's error after inversion is 0.58 um; 1 % of the range is wanted.
pub(crate) fn fitted_on_the_full_loop_the_model_tells_the_nested_ones() {
    let data = shared("data/piezo_picma_p885");
    let folder = TempDir::new().expect("a folder");
    let path = |name: &str| data.join(name).display().to_string();
    let fitted = whole(
        folder.path(),
        &[
            "identify",
            "hysteresis",
            "--data",
            &path("model_1hz_fullscale.csv"),
            "--input",
            "u_V",
            "--output",
            "disp_um",
            "--time",
            "t_s",
        ],
    );
    for key in [
        "model",
        "rms_um",
        "max_um",
        "range_um",
        "percent_of_range",
        "uncompensated_percent",
        "improvement",
        "functions",
    ] {
        assert!(!fitted[key].is_null(), "{key}");
    }
    let model = fitted["model_file"].as_str().expect("a path");
    let told = whole(
        folder.path(),
        &[
            "predict",
            "--model",
            model,
            "--data",
            &path("nested_loops.csv"),
        ],
    );
    let rms = told["rms_um"].as_f64().expect("a number");
    assert!(rms <= 0.41, "{rms} um");
    let inverse = whole(
        folder.path(),
        &[
            "predict",
            "--model",
            model,
            "--data",
            &path("nested_loops.csv"),
            "--inverse",
        ],
    );
    let rms = inverse["rms_um"].as_f64().expect("a number");
    assert!(rms <= 0.41, "{rms} um");
    let report = fitted["report"].as_str().expect("a path");
    let html = fs::read_to_string(folder.path().join(report)).expect("a report");
    assert_eq!(html.matches("class=\"chart ").count(), 3);
}
