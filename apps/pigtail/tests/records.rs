//! `pigtail identify servo` from records: made ones whose truth is known, and ones from which nothing can be
//! known. A measured one is in `measured`.

mod made;

use made::{
    Case, TURNING, csv, identify_turning, near, normal, number, pigtail, swinging, turning, value,
};
use rand::{RngExt, SeedableRng};
use std::fs;
use tempfile::TempDir;

/// What made records that turn are made by, in the joint's units.
const MADE_BY: [(&str, f64); 5] = [
    ("inertia", 0.02),
    ("viscous_friction_forward", 0.15),
    ("viscous_friction_backward", 0.25),
    ("coulomb_friction_forward", 0.4),
    ("coulomb_friction_backward", 0.5),
];

#[test]
fn a_known_axis_is_found_by_every_method() {
    for (seed, method) in [
        (1, "least-squares"),
        (2, "weighted"),
        (3, "instrumental"),
        (4, "delayed"),
    ] {
        let record = csv(TURNING, turning(seed, swinging));
        let (json, code) =
            identify_turning(&record, &["--friction", "asymmetric", "--method", method]);
        assert_eq!(code, 0, "{json}");
        for (name, is) in MADE_BY {
            near(value(&json, name).expect("known"), is, 5.0);
        }
        assert_eq!(json["best"]["friction"], "asymmetric");
        if method == "delayed" {
            // Held from sample to sample, half a millisecond apart.
            near(value(&json, "voltage_delay").expect("known"), 2.5e-4, 20.0);
            near(value(&json, "inertia").expect("known"), 0.02, 0.5);
        }
        assert!(number(&json["replay"], "velocity_error_percent") < 1.0);
    }
}

/// Of a record of which every eightieth row was kept, 25 a second, no parameter is farther off than it states.
#[test]
fn a_servo_record_with_few_rows_is_as_right_as_it_says() {
    let rows = turning(14, swinging).into_iter();
    let kept: Vec<_> = rows.skip(79).step_by(80).collect();
    let (json, code) = identify_turning(
        &csv(TURNING, kept),
        &["--friction", "asymmetric", "--method", "delayed"],
    );
    assert_eq!(code, 0, "{json}");
    for (name, is) in MADE_BY {
        let deviation = number(&json["parameters"][name], "std_correlated");
        let off = value(&json, name).expect("known") - is;
        assert!(off.abs() < 3.0 * deviation, "{name}: {off} by {deviation}");
    }
}

/// What a record does not excite has no value, and the reason is said.
#[test]
fn a_servo_record_that_does_not_tell_is_not_believed() {
    let ramp = |t: f64| 0.4 * t;
    let rising = |t: f64| 0.5 * t + 0.1 * (3.0 * t).sin();
    let cases: [Case; 10] = [
        (
            "aliased",
            turning(14, swinging),
            |rows| {
                let mut k = 0;
                rows.retain(|_| {
                    k += 1;
                    k % 200 == 0
                });
            },
            &["inertia", "viscous_friction"],
            "because",
        ),
        (
            "constant speed",
            turning(5, ramp),
            |rows| drop(rows.drain(..2000)),
            &["inertia", "coulomb_friction", "viscous_friction"],
            "constant speed",
        ),
        (
            "one way",
            turning(6, rising),
            |rows| drop(rows.drain(..2000)),
            &["coulomb_friction", "offset"],
            "only",
        ),
        (
            "still",
            turning(7, |_| 0.3),
            |rows| drop(rows.drain(..8000)),
            &["inertia", "coulomb_friction"],
            "never changes",
        ),
        (
            "saturated",
            turning(8, swinging),
            |rows| rows.iter_mut().for_each(|r| r[3] = r[3].clamp(-0.9, 0.9)),
            &["inertia"],
            "saturated",
        ),
        (
            "swapped",
            turning(9, swinging),
            |rows| rows.iter_mut().for_each(|r| r.swap(1, 2)),
            &["inertia"],
            "swapped",
        ),
        (
            "voltage for position",
            turning(9, swinging),
            |rows| rows.iter_mut().for_each(|r| r.swap(3, 2)),
            &["inertia"],
            "reference",
        ),
        (
            "units",
            turning(10, swinging),
            |rows| rows.iter_mut().for_each(|r| r[2] = r[2].to_radians()),
            &["inertia"],
            "unit",
        ),
        (
            "milliseconds",
            turning(11, swinging),
            |rows| rows.iter_mut().for_each(|r| r[0] *= 1e3),
            &["inertia"],
            "unit of time",
        ),
        (
            "sign",
            turning(12, swinging),
            |rows| rows.iter_mut().for_each(|r| r[3] = -r[3]),
            &["inertia"],
            "negative",
        ),
    ];
    for (what, mut rows, spoil, hidden, why) in cases {
        spoil(&mut rows);
        let (json, code) = identify_turning(&csv(TURNING, rows), &[]);
        assert_eq!(code, 1, "{what}: {json}");
        let verdict = json["verdict"].as_str().expect("a verdict");
        assert!(
            verdict.starts_with("not identifiable from this record") && verdict.contains(why),
            "{what}: {verdict}"
        );
        for name in hidden {
            assert!(
                json["parameters"][name]["value"].is_null(),
                "{what}: {name}"
            );
        }
        assert!(json["fragment"].is_null(), "{what}");
    }
}

/// One unit that is wrong for all columns makes an axis that nobody builds.
#[test]
fn an_axis_that_nobody_builds_is_refused() {
    for scale in [1e6, 1e-6] {
        let mut rows = turning(15, swinging);
        for row in &mut rows {
            row[1] *= scale;
            row[2] *= scale;
        }
        let (json, code) = identify_turning(&csv(TURNING, rows), &[]);
        assert_eq!(code, 1, "{json}");
        let verdict = json["verdict"].to_string();
        assert!(verdict.contains("are the units"), "{scale}: {verdict}");
    }
    let (json, code) = identify_turning(&csv(TURNING, turning(15, swinging)), &[]);
    assert_eq!(code, 0, "{json}");
}

/// Holes, gaps and stamps that jitter change next to nothing.
#[test]
fn a_servo_record_with_holes_is_used() {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(13);
    let mut rows = turning(13, swinging);
    rows.drain(9000..9500);
    for row in &mut rows {
        row[0] += 5e-5 * normal(&mut rng);
    }
    for _ in 0..200 {
        let k = rng.random_range(0..rows.len());
        rows[k][2] = f64::NAN;
    }
    let (json, code) = identify_turning(&csv(TURNING, rows), &["--friction", "asymmetric"]);
    assert_eq!(code, 0, "{json}");
    near(value(&json, "inertia").expect("known"), 0.02, 5.0);
    near(
        value(&json, "coulomb_friction_forward").expect("known"),
        0.4,
        5.0,
    );
    assert!(json["remarks"].as_array().expect("remarks").len() >= 3);
}

#[test]
fn bad_columns_are_explained() {
    let folder = TempDir::new().expect("a folder");
    let rows = csv(TURNING, turning(1, swinging).into_iter().take(300));
    fs::write(folder.path().join("r.csv"), &rows).expect("a file");
    fs::write(
        folder.path().join("word.csv"),
        rows.replacen("0.000500000", "soon", 1),
    )
    .expect("a file");
    let back = rows.replacen("0.001000000", "0.000100000", 1);
    fs::write(folder.path().join("back.csv"), back).expect("a file");
    for (file, position, voltage, says) in [
        ("none.csv", "q_deg", "u_V", "cannot be read"),
        ("r.csv", "x", "u_V", "no such column"),
        ("r.csv", "q_deg:V", "u_V", "cannot be in"),
        ("r.csv", "q_deg:rad", "u_V", "its name says deg"),
        ("r.csv", "u_V", "q_deg", "no unit for --position"),
        ("r.csv", "q_deg", "q_deg:V", "named twice"),
        ("word.csv", "q_deg", "u_V", "soon"),
        ("back.csv", "q_deg", "u_V", "comes after"),
    ] {
        let (code, out, error) = pigtail(
            folder.path(),
            &[
                "identify",
                "servo",
                "--data",
                file,
                "--position",
                position,
                "--voltage",
                voltage,
                "--force-per-volt",
                "1",
            ],
        );
        assert_eq!(code, Some(2), "{out}{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(!folder.path().join("runs").exists());
        assert!(error.contains(says), "{error}");
    }
}
