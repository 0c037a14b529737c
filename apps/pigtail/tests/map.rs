//! `pigtail align --map`: search and peak on a person's own scan.

use assert_cmd::Command;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// 15 by 15 readings, 2 um apart, of a peak at 17.2, 10.6 um.
fn scan(unit: f64, fold: impl Fn(f64) -> f64) -> String {
    let mut csv = "x,y,power\n".to_owned();
    for k in 0..225 {
        let (x, y) = (2.0 * f64::from(k % 15), 2.0 * f64::from(k / 15));
        // Readings are never quite those of a shape.
        let ripple = 0.004 * f64::from(k * 7919 % 13 - 6);
        let power = 0.1 + (-((x - 17.2) / 5.0).powi(2) - ((y - 10.6) / 4.0).powi(2)).exp() + ripple;
        writeln!(csv, "{},{},{}", x * unit, y * unit, fold(power)).expect("it is there");
    }
    csv
}

fn align(folder: &Path, csv: &str, arguments: &[&str]) -> (i32, String, String) {
    let file = folder.join("scan.csv");
    fs::write(&file, csv).expect("it is there");
    let output = Command::cargo_bin("pigtail")
        .expect("it is there")
        .current_dir(folder)
        .args(["align", "--json", "--map", "scan.csv"])
        .args(arguments)
        .output()
        .expect("it is there");
    (
        output.status.code().expect("it is there"),
        String::from_utf8(output.stdout).expect("it is there"),
        String::from_utf8(output.stderr).expect("it is there"),
    )
}

fn document(folder: &Path, csv: &str, arguments: &[&str]) -> (i32, Value) {
    let (code, out, error) = align(folder, csv, arguments);
    (
        code,
        serde_json::from_str(&out).unwrap_or_else(|_| panic!("{error}")),
    )
}

#[test]
fn a_map_is_answered_with_peak_widths_and_readings() {
    let folder = tempfile::tempdir().expect("it is there");
    let (code, found) = document(folder.path(), &scan(1.0, |p| p), &[]);
    assert_eq!((code, &found["outcome"]), (0, &"aligned".into()));
    for peak in [&found["peak"], &found["whole_map"]] {
        assert!(
            (peak["x_um"].as_f64().expect("it is there") - 17.2).abs() < 0.2,
            "{peak}"
        );
        assert!(
            (peak["y_um"].as_f64().expect("it is there") - 10.6).abs() < 0.2,
            "{peak}"
        );
        // Full width at half of the height: 2 sqrt(ln 2) radii.
        assert!(
            (peak["widths_um"]["x"].as_f64().expect("it is there") - 8.33).abs() < 0.4,
            "{peak}"
        );
        assert!(
            (peak["widths_um"]["y"].as_f64().expect("it is there") - 6.66).abs() < 0.4,
            "{peak}"
        );
    }
    assert_eq!(found["readings"], 225);
    assert!(found["readings_used"].as_u64().expect("it is there") < 60);
    let report = found["report"].as_str().expect("it is there");
    assert!(
        fs::read_to_string(folder.path().join(report))
            .expect("it is there")
            .contains("<svg")
    );
    let (_, again) = document(folder.path(), &scan(1.0, |p| p), &[]);
    assert_eq!(found["peak"], again["peak"]);
}

#[test]
fn units_and_folds_are_seen_through() {
    let folder = tempfile::tempdir().expect("it is there");
    let at = |found: &Value| found["peak"]["x_um"].as_f64().expect("it is there");
    let decibels = scan(1e-3, |p| 10.0 * p.log10());
    let units = ["--map-length-unit", "mm", "--map-power-unit", "dBm"];
    let (code, found) = document(folder.path(), &decibels, &units);
    assert!(code == 0 && (at(&found) - 17.2).abs() < 0.2, "{found}");
    assert_eq!(found["power_unit"], "mW");
    let (code, found) = document(folder.path(), &scan(1.0, |p| p.rem_euclid(0.7)), &[]);
    assert!(code == 0 && (at(&found) - 17.2).abs() < 0.2, "{found}");
    assert_eq!(found["fold"], "wrapped");
    let (code, found) = document(folder.path(), &scan(1.0, |p| -p), &["--map-inverted"]);
    assert!(code == 0 && (at(&found) - 17.2).abs() < 0.2, "{found}");
}

#[test]
fn a_map_without_a_peak_is_an_honest_negative() {
    let folder = tempfile::tempdir().expect("it is there");
    let (code, found) = document(folder.path(), &scan(1.0, |p| 2.0 - p), &[]);
    assert_eq!((code, &found["outcome"]), (1, &"dark".into()));
    assert!(found["peak"].is_null() && !found["detail"].as_str().expect("it is there").is_empty());
    let accuracy = ["--map-accuracy", "0.1 nm"];
    let (code, found) = document(folder.path(), &scan(1.0, |p| p), &accuracy);
    assert_eq!((code, &found["outcome"]), (1, &"unsure".into()));
}

#[test]
fn what_is_no_map_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("it is there");
    let good = scan(1.0, |p| p);
    let cases: [(&str, &[&str], &[&str]); 9] = [
        (
            &good,
            &["--map-columns", "x,y"],
            &["--map-columns", "three"],
        ),
        (
            &good,
            &["--map-columns", "x,y,volts"],
            &["volts", "x, y, power"],
        ),
        (&good, &["--map-columns", "x,y,x"], &["x", "twice"]),
        (
            &good,
            &["--map-start", "90 um,0 um"],
            &["--map-start", "28.000"],
        ),
        (
            &good,
            &["--map-start", "90"],
            &["--map-start", "two lengths"],
        ),
        (&good, &["--method", "multimode"], &["--map", "--method"]),
        (
            "x,y,power\n0,0,1\n1,1,oops\n",
            &[],
            &["scan.csv", "line 3", "oops"],
        ),
        ("x,y,power\n0,0,1\n1,1,2\n", &[], &["scan.csv", "16"]),
        (&scan(1.0, |_| 1.0), &[], &["power", "same everywhere"]),
    ];
    for (csv, arguments, told) in cases {
        let (code, out, error) = align(folder.path(), csv, arguments);
        assert_eq!((code, out.as_str()), (2, ""), "{arguments:?}");
        for word in told {
            assert!(error.contains(word), "{arguments:?}: {error}");
        }
    }
    assert!(!folder.path().join("runs").exists());
}
