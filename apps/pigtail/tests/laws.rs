//! `pigtail identify friction`, `windup --data` and `resonance`: made records whose truth is known, and ones from
//! which nothing can be known. Measured ones are in `measured`.

mod made;

use made::{Spoil, answer, csv, near, normal, value};
use rand::SeedableRng;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

fn identify_friction(record: &str, extra: &[&str]) -> (Value, i32) {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("r.csv"), record).expect("a file");
    let mut arguments = vec![
        "identify",
        "friction",
        "--data",
        "r.csv",
        "--displacement",
        "x_um",
        "--force",
        "f_N",
    ];
    arguments.extend(extra);
    answer(folder.path(), &arguments)
}

/// Elastic up to 2 N over 12 um, then sliding, with noise; columns time, displacement, force.
fn rubbing(seed: u64, path: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let (mut contact, mut last) = (0.0_f64, path(0.0));
    (0..6000)
        .map(|k| {
            let t = 0.005 * f64::from(k);
            let x = path(t);
            contact = (contact + x - last).clamp(-12.0, 12.0);
            last = x;
            vec![t, x, contact / 6.0 + 0.1 + 0.02 * normal(&mut rng)]
        })
        .collect()
}

const RUBBING: &str = "t_s,x_um,f_N";

fn back_and_forth(t: f64) -> f64 {
    90.0 * (1.1 * t).sin() * (1.0 - 0.015 * t)
}

#[test]
fn a_known_friction_is_found_whatever_its_sign() {
    for turned in [1.0, -1.0] {
        let mut rows = rubbing(20, back_and_forth);
        for row in &mut rows {
            row[2] *= turned;
        }
        rows[77][2] = f64::NAN;
        let (json, code) = identify_friction(&csv(RUBBING, rows), &[]);
        assert_eq!(code, 0, "{json}");
        assert_eq!(json["law"], "presliding");
        near(value(&json, "static_friction").expect("known"), 2.0, 1.0);
        near(value(&json, "presliding").expect("known"), 12e-6, 1.0);
        near(value(&json, "offset").expect("known"), 0.1, 10.0);
    }
}

#[test]
#[ignore = "long: a fit of friction and one of modes, seconds each"]
fn records_that_are_written_to_try_on_tell_what_is_said_to_be_true_of_them() {
    let folder = TempDir::new().expect("a folder");
    let (code, _, error) = made::pigtail(folder.path(), &["sample-data", "data"]);
    assert_eq!(code, Some(0), "{error}");
    let rubbed = [
        "identify",
        "friction",
        "--data",
        "data/friction.csv",
        "--displacement",
        "x_um",
        "--force",
        "force_N",
    ];
    let (friction, code) = answer(folder.path(), &rubbed);
    assert_eq!(code, 0, "{friction}");
    near(
        value(&friction, "static_friction").expect("known"),
        2.0,
        1.0,
    );
    near(value(&friction, "presliding").expect("known"), 12e-6, 1.0);
    let swept = ["identify", "resonance", "--data", "data/response.csv"];
    let (modes, code) = answer(folder.path(), &swept);
    assert_eq!(code, 0, "{modes}");
    for (name, truth) in [
        ("frequency_1", 180.0),
        ("frequency_2", 540.0),
        ("damping_1", 0.03),
        ("damping_2", 0.015),
    ] {
        near(value(&modes, name).expect("known"), truth, 1.0);
    }
}

#[test]
fn a_friction_record_that_does_not_tell_is_not_believed() {
    let none: Spoil = |_| {};
    let cases: [(&str, Vec<Vec<f64>>, Spoil, &str); 6] = [
        ("one way", rubbing(21, |t| 10.0 * t), none, "reversals"),
        ("still", rubbing(22, |_| 5.0), none, "never changes"),
        (
            "too short",
            rubbing(23, |t| 4.0 * (1.1 * t).sin()),
            none,
            "too short to slide",
        ),
        (
            "saturated",
            rubbing(24, back_and_forth),
            |rows| rows.iter_mut().for_each(|r| r[2] = r[2].clamp(-1.0, 1.0)),
            "saturated",
        ),
        (
            "swapped",
            rubbing(25, back_and_forth),
            |rows| rows.iter_mut().for_each(|r| r.swap(1, 2)),
            "swapped",
        ),
        (
            "slow",
            rubbing(26, back_and_forth),
            |rows| {
                let mut k = 0;
                rows.retain(|_| {
                    k += 1;
                    k % 60 == 0
                });
            },
            "not resolved",
        ),
    ];
    for (what, mut rows, spoil, why) in cases {
        spoil(&mut rows);
        let (json, code) = identify_friction(&csv(RUBBING, rows), &[]);
        assert_eq!(code, 1, "{what}: {json}");
        let verdict = json["verdict"].as_str().expect("a verdict");
        assert!(
            verdict.starts_with("not identifiable from this record") && verdict.contains(why),
            "{what}: {verdict}"
        );
    }
}

/// A transmission that winds up by an exponential of 0.5 mrad over 20 mrad behind reversals, and gives way by
/// 10 urad a newton metre, its load read 2 ms late; columns time, motor, load, torque.
fn winding(seed: u64, place: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let (period, fine) = (0.004, 8);
    let (mut wound, mut last) = (0.0_f64, place(0.0));
    let load: Vec<f64> = (0..6000 * fine)
        .map(|k| {
            let t = period * f64::from(k) / f64::from(fine);
            let q = place(t);
            let way = q - last;
            last = q;
            let end = 0.5e-3 * way.signum();
            if way != 0.0 {
                wound = end + (wound - end) * (-way.abs() / 5e-3).exp();
            }
            q - wound - 1e-5 * pull(t)
        })
        .collect();
    (0..6000_usize)
        .map(|k| {
            let t = period * k as f64;
            let late = (k * fine as usize).saturating_sub(4);
            let motor = place(t) + 2e-6 * normal(&mut rng);
            let seen = load[late] + 2e-6 * normal(&mut rng) + 0.01;
            vec![t, motor, seen, pull(t)]
        })
        .collect()
}

fn pull(t: f64) -> f64 {
    15.0 * (1.7 * t).sin() + 8.0 * (0.6 * t + 1.0).cos()
}

fn identify_windup(rows: Vec<Vec<f64>>, extra: &[&str]) -> (Value, i32, String) {
    let folder = TempDir::new().expect("a folder");
    let record = csv("t_s,m_rad,l_rad,tau_Nm", rows);
    fs::write(folder.path().join("r.csv"), record).expect("a file");
    let mut arguments = vec![
        "identify", "windup", "--data", "r.csv", "--motor", "m_rad", "--load", "l_rad",
    ];
    arguments.extend(extra);
    let (json, code) = answer(folder.path(), &arguments);
    let fragment = json["fragment"].as_str().map(|path| {
        let path = folder.path().join(path);
        fs::read_to_string(path).expect("a fragment")
    });
    (json, code, fragment.unwrap_or_default())
}

fn wandering(t: f64) -> f64 {
    0.3 * (0.9 * t).sin() + 0.12 * (2.3 * t).sin()
}

/// What comes out is taken by a calibration as it is.
#[test]
fn a_known_transmission_is_found_and_calibrates() {
    let (json, code, fragment) = identify_windup(winding(30, wandering), &["--torque", "tau_Nm"]);
    assert_eq!(code, 0, "{json}");
    near(value(&json, "time_skew").expect("known"), 2e-3, 3.0);
    near(value(&json, "compliance").expect("known"), 1e-5, 10.0);
    near(value(&json, "w_max").expect("known"), 0.5e-3, 5.0);
    near(value(&json, "q").expect("known"), 20e-3, 30.0);
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/afpm");
    let read = |file: &str| fs::read_to_string(rig.join(file)).expect("a rig");
    let own = read("calibration.toml");
    let (before, after) = own.split_once("[windup.five_bar]").expect("a table");
    let after = after.find("\n[hysteresis").map_or("", |k| &after[k..]);
    let calibration = format!("{before}{fragment}{after}");
    let spec = pigtail_hal::Spec::parse("machine.toml", &read("machine.toml")).expect("a spec");
    let parsed = pigtail_control::calibration::Calibration::parse("c.toml", &calibration, &spec)
        .expect("a calibration");
    let belief = parsed.windup.five_bar.expect("a windup");
    near(belief.w_max, 0.5e-3, 10.0);
}

#[test]
fn a_transmission_record_that_does_not_tell_is_not_believed() {
    let steady = |t: f64| {
        let phase = (0.25 * t).fract();
        0.4 * (1.0 - (2.0 * phase - 1.0).abs())
    };
    let none: Spoil = |_| {};
    let cases: [(&str, Vec<Vec<f64>>, Spoil, &str); 5] = [
        (
            "one way",
            winding(31, |t| 0.1 * t + 0.02 * (3.0 * t).sin()),
            none,
            "one way",
        ),
        (
            "constant speed",
            winding(32, steady),
            none,
            "speed hardly changes",
        ),
        (
            "swapped",
            winding(33, wandering),
            |rows| rows.iter_mut().for_each(|r| r.swap(1, 2)),
            "swapped",
        ),
        (
            "no ratio",
            winding(34, wandering),
            |rows| rows.iter_mut().for_each(|r| r[1] *= 80.0),
            "ratio",
        ),
        (
            "still",
            winding(35, |_| 0.1),
            |rows| rows.iter_mut().for_each(|r| (r[1], r[2]) = (0.1, 0.1)),
            "never moves",
        ),
    ];
    for (what, mut rows, spoil, why) in cases {
        spoil(&mut rows);
        let (json, code, fragment) = identify_windup(rows, &[]);
        assert_eq!(code, 1, "{what}: {json}");
        let verdict = json["verdict"].as_str().expect("a verdict");
        assert!(
            verdict.starts_with("not identifiable from this record") && verdict.contains(why),
            "{what}: {verdict}"
        );
        assert!(fragment.is_empty(), "{what}");
    }
}

/// Two modes and a delay of 0.6 ms, magnitude in decibels, phase in degrees.
fn answering(noise: f64) -> Vec<Vec<f64>> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(40);
    (1..=600)
        .map(|k| {
            let w = std::f64::consts::TAU * 0.5 * f64::from(k);
            let mode = |hertz: f64, zeta: f64, size: f64| {
                let o = std::f64::consts::TAU * hertz;
                let (re, im) = (o * o - w * w, 2.0 * zeta * o * w);
                let below = (re * re + im * im) / (size * o * o);
                (re / below, -im / below)
            };
            let (a, b) = (mode(41.0, 0.03, 1.0), mode(150.0, 0.01, 0.3));
            let (re, im) = (a.0 + b.0, a.1 + b.1);
            let size = re.hypot(im) * (1.0 + noise * normal(&mut rng));
            let phase = im.atan2(re) - 6e-4 * w + noise * normal(&mut rng);
            vec![0.5 * f64::from(k), 20.0 * size.log10(), phase.to_degrees()]
        })
        .collect()
}

#[test]
fn modes_and_delay_of_a_known_response_are_found() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("frf.csv");
    fs::write(&path, csv("f_Hz,mag_dB,phase_deg", answering(0.01))).expect("a file");
    let arguments = ["identify", "resonance", "--data", "frf.csv"];
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 0, "{json}");
    for (name, is, percent) in [
        ("frequency_1", 41.0, 0.2),
        ("damping_1", 0.03, 3.0),
        ("frequency_2", 150.0, 0.2),
        ("damping_2", 0.01, 3.0),
        ("delay", 6e-4, 2.0),
    ] {
        near(value(&json, name).expect("known"), is, percent);
    }
    // Magnitude alone: the modes all the same, and no delay.
    fs::write(&path, csv("f_Hz,mag_dB,other", answering(0.01))).expect("a file");
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 0, "{json}");
    for (name, is, percent) in [
        ("frequency_1", 41.0, 0.2),
        ("damping_1", 0.03, 4.0),
        ("frequency_2", 150.0, 0.2),
        ("damping_2", 0.01, 4.0),
    ] {
        near(value(&json, name).expect("known"), is, percent);
    }
    assert!(json["parameters"]["delay"]["value"].is_null());
    let verdict = json["verdict"].as_str().expect("a verdict");
    assert!(
        verdict.contains("delay is not identifiable from this record, because it has no phase"),
        "{verdict}"
    );
    assert!(!json["fragment"].is_null());
    let flat = answering(0.01)
        .into_iter()
        .map(|r| vec![r[0], 3.0, -20.0 - r[0]]);
    fs::write(&path, csv("f_Hz,mag_dB,phase_deg", flat)).expect("a file");
    let (json, code) = answer(folder.path(), &arguments);
    assert_eq!(code, 1, "{json}");
}
