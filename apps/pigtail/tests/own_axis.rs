//! From a record to a twin of its axis, and to a rig that `tune`, `characterize` and `align` run on.

mod made;

use made::{
    SLED, SLIDING, TURNING, answer, csv, fragment_of, near, number, pigtail, sliding, swinging,
    turning,
};
use pigtail_control::calibration::Calibration;
use pigtail_control::characterize::{Trace, step_response};
use pigtail_control::servo::{Pid, PidState};
use pigtail_hal::Spec;
use pigtail_hal::quantity::{Counts, Volts};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// From a record to a twin that moves as the record does, under any of the laws.
#[test]
fn a_twin_moves_as_its_record() {
    let folder = TempDir::new().expect("a folder");
    fs::write(
        folder.path().join("r.csv"),
        csv(TURNING, turning(50, swinging)),
    )
    .expect("a file");
    fs::write(
        folder.path().join("b.csv"),
        csv(TURNING, turning(51, |t| 0.5 * (4.0 * t).sin())),
    )
    .expect("a file");
    let (json, code) = answer(
        folder.path(),
        &[
            "identify",
            "servo",
            "--data",
            "r.csv",
            "--reference",
            "r_deg",
            "--position",
            "q_deg",
            "--voltage",
            "u_V",
            "--force-per-volt",
            "0.5",
            "--validate",
            "b.csv",
        ],
    );
    assert_eq!(code, 0, "{json}");
    let fragment = json["fragment"].as_str().expect("a fragment").to_owned();
    for extra in [
        &[][..],
        &["--data", "b.csv"],
        &["--friction", "coulomb-presliding", "--presliding", "1e-6"],
        &["--friction", "maxwell-slip", "--presliding", "1e-6"],
        &["--friction", "lugre", "--presliding", "1e-6"],
    ] {
        let arguments = [&["twin", "--from", &fragment][..], extra].concat();
        let (json, code) = answer(folder.path(), &arguments);
        assert_eq!(code, 0, "{json}");
        let off = number(&json, "velocity_error_percent");
        assert!(off < 2.0, "{extra:?}: {off}");
    }
    let path = folder.path().join(&fragment);
    let good = fs::read_to_string(&path).expect("a fragment");
    let line = good
        .lines()
        .find(|l| l.starts_with("inertia"))
        .expect("a key");
    fs::write(&path, good.replace(line, "inertia = -1.0")).expect("a file");
    let (code, _, error) = pigtail(folder.path(), &["twin", "--from", &fragment]);
    assert_eq!(code, Some(2));
    assert!(error.contains("axis.inertia"), "{error}");
}

const SLED_OPTIONS: [&str; 2] = ["--force-per-volt", "8"];
const TURNING_OPTIONS: [&str; 4] = ["--force-per-volt", "0.5", "--gear-ratio", "0.0125"];

/// A rig whose specimens do not differ.
fn without_variation(rig: &Path) {
    let path = rig.join("plant.toml");
    let mut plant: toml::Table =
        toml::from_str(&fs::read_to_string(&path).expect("a plant")).expect("TOML");
    let variation = plant["variation"].as_table_mut().expect("a table");
    for (_, value) in variation.iter_mut() {
        *value = toml::Value::Float(0.0);
    }
    fs::write(path, toml::to_string(&plant).expect("TOML")).expect("a file");
}

/// From the log of a carriage along a line to the rig's z: steps of the twin are those that the true carriage
/// takes under the same controller.
#[test]
fn the_twin_of_an_axis_along_a_line_moves_as_the_axis_does() {
    let folder = TempDir::new().expect("a folder");
    let at = folder.path();
    let run = fragment_of(at, SLIDING, sliding(70), &SLED_OPTIONS);
    let (code, out, error) = pigtail(at, &["rig", "rig", "--from", &run]);
    assert_eq!(code, Some(0), "{out}{error}");
    without_variation(&at.join("rig"));
    let read = |file: &str| fs::read_to_string(at.join("rig").join(file)).expect("a file");
    let spec = Spec::parse("machine.toml", &read("machine.toml")).expect("a datasheet");
    let belief = Calibration::parse("calibration.toml", &read("calibration.toml"), &spec)
        .expect("a calibration");
    let drive = spec.z_stage.drive;
    let count = belief.geometry.z.lead / drive.gear_ratio / f64::from(drive.counts_per_turn);
    // As coarse as the record's noise.
    assert!((0.5e-7..2e-7).contains(&count), "{count}");
    let period = spec.period();
    for micrometres in [80.0_f64, 400.0] {
        let size = (1e-6 * micrometres / count).round();
        let pid = Pid::new(&belief.gains.z, drive.voltage, period);
        let (mut sled, mut state) = (SLED, PidState::default());
        let mut trace = Trace {
            period,
            ..Trace::default()
        };
        for _ in 0..500 {
            let seen = (sled.state.0 / count).floor() as i64;
            let wanted = Counts(size as i64);
            let Volts(voltage) = pid.voltage(&mut state, wanted, Counts(seen));
            sled.advance(voltage, period);
            trace.encoder.push((sled.state.0 / count).floor());
        }
        let truth = step_response(&trace, size);
        let (json, code) = answer(
            at,
            &[
                "characterize",
                "z",
                "step",
                "--rig",
                "rig",
                "--size",
                &format!("{size}"),
            ],
        );
        assert_eq!(code, 0, "{json}");
        near(number(&json, "rise_ms"), 1e3 * truth.rise, 5.0);
        let over = number(&json, "overshoot_percent") - 100.0 * truth.overshoot;
        assert!(over.abs() < 3.0, "{json}, {truth:?}");
    }
}

/// `tune`, `characterize` and `align` take what was identified, of an axis of either kind.
#[test]
#[ignore = "long: everything on two axes of one's own"]
fn an_identified_axis_is_tuned_characterized_and_aligned_with() {
    let cases = [
        ("z", SLIDING, sliding(71), &SLED_OPTIONS[..]),
        (
            "fivebar",
            TURNING,
            turning(72, swinging),
            &TURNING_OPTIONS[..],
        ),
    ];
    for (axis, header, rows, options) in cases {
        let folder = TempDir::new().expect("a folder");
        let at = folder.path();
        let run = fragment_of(at, header, rows, options);
        let step = |extra: &[&str]| {
            let all = [&["characterize", axis, "step", "--from", &run][..], extra].concat();
            let (json, code) = answer(at, &all);
            assert_eq!(code, 0, "{axis}: {json}");
            number(&json, "rise_ms")
        };
        assert!(step(&[]) < 50.0, "{axis}");
        let (json, code) = answer(at, &["tune", axis, "--from", &run]);
        assert_eq!(code, 0, "{axis}: {json}");
        let gains = json["calibration"].as_str().expect("a file").to_owned();
        assert!(gains.starts_with("runs"), "{gains}");
        near(step(&["--from", &gains]), number(&json, "rise_ms"), 5.0);
        let cost = number(&json, "cost");
        for start in json["starts"].as_array().expect("starts") {
            let before = start["cost_at_start"].as_f64().unwrap_or(f64::INFINITY);
            assert!(cost < before, "{axis}: {json}");
        }
        let mut aligned = 0;
        for seed in ["80", "81", "82"] {
            let (json, code) = answer(
                at,
                &["align", "--from", &run, "--from", &gains, "--seed", seed],
            );
            aligned += usize::from(code == 0);
            assert!([0, 1].contains(&code), "{axis}, seed {seed}: {json}");
            assert_eq!(
                json["rig"],
                format!("afpm with {run}/plant.toml and {gains}")
            );
        }
        assert!(aligned >= 2, "{axis}: {aligned} of 3");
        // The same as a rig of its own, which goes on from there.
        let (code, _, error) = pigtail(at, &["rig", "rig", "--from", &run, "--from", &gains]);
        assert_eq!(code, Some(0), "{error}");
        let (json, code) = answer(at, &["align", "--rig", "rig", "--seed", "80"]);
        assert!([0, 1].contains(&code), "{axis}: {json}");
        let (json, code) = answer(at, &["tune", axis, "--rig", "rig", "--write"]);
        assert_eq!(code, 0, "{json}");
        assert_eq!(json["calibration"], "rig/calibration.toml");
    }
}

/// Friction, windup and a resonance that were identified are the twin's.
#[test]
fn what_else_was_identified_goes_into_the_twin() {
    let folder = TempDir::new().expect("a folder");
    let at = folder.path();
    let whole = fragment_of(at, SLIDING, sliding(73), &SLED_OPTIONS);
    let rig = |name: &str, from: &[&str]| -> toml::Table {
        let mut arguments = vec!["rig", name];
        for fragment in from {
            arguments.extend(["--from", fragment]);
        }
        let (code, out, error) = pigtail(at, &arguments);
        assert_eq!(code, Some(0), "{out}{error}");
        let plant = fs::read_to_string(at.join(name).join("plant.toml")).expect("a plant");
        toml::from_str(&plant).expect("TOML")
    };
    let quantity = |value: &toml::Value| -> f64 {
        let text = value.as_str().expect("a quantity");
        let (number, _) = text.split_once(' ').expect("a unit");
        number.parse().expect("a number")
    };
    fs::write(
        at.join("friction.toml"),
        "[part]\nkind = \"linear\"\nfriction = \"lugre\"\npresliding = 5e-6\nfixed = 2.5\ncoulomb = 2.0\n\
         stribeck = 1e-3\n[law]\nname = \"lugre\"\n",
    )
    .expect("a file");
    let plant = rig("a", &[&whole, "friction.toml"]);
    let joint = &plant["z_stage"]["joint"];
    let way = 0.01 / std::f64::consts::TAU;
    assert_eq!(joint["friction"].as_str(), Some("lugre"));
    near(quantity(&joint["presliding"]), 5e-6 / way, 0.1);
    near(quantity(&joint["load_friction"]["static"]), 2.5 * way, 0.1);
    near(quantity(&joint["load_friction"]["coulomb"]), 2.0 * way, 0.1);
    near(quantity(&joint["stribeck"]), 1e-3 / way, 0.1);
    // What the motor has to overcome in all is what it was, to 2.5 % of that in all (1.5 % before ends of a record were left out).
    near(
        quantity(&joint["motor_friction"]["coulomb"]),
        2.0 * way,
        5.0,
    );
    fs::write(at.join("r.toml"), "[resonance]\nfrequency_1 = 71.0\n").expect("a file");
    let plant = rig("b", &["r.toml", &whole]);
    let joint = &plant["z_stage"]["joint"];
    let inertia = |key: &str| quantity(&joint[key]);
    let stiffness = quantity(&joint["transmission"]["linear"]);
    let both = 1.0 / inertia("motor_inertia") + 1.0 / inertia("load_inertia");
    near((stiffness * both).sqrt() / std::f64::consts::TAU, 71.0, 0.1);
    // A transmission: windup of its plant as the twin's own experiment measures it.
    fs::write(
        at.join("w.toml"),
        "[transmission]\ntable = \"five_bar\"\nw_max = 0.5e-3\npresliding = 0.5e-3\n",
    )
    .expect("a file");
    let plant = rig("c", &["w.toml"]);
    assert_eq!(
        plant["five_bar"]["joint"]["friction"].as_str(),
        Some("maxwell-slip")
    );
    without_variation(&at.join("c"));
    let (json, code) = answer(at, &["characterize", "fivebar", "windup", "--rig", "c"]);
    assert_eq!(code, 0, "{json}");
    let own = &json["cases"][0];
    near(number(own, "w_max_um"), 0.5e3 * 44.56e-3, 5.0);
    near(number(own, "q_um"), 8.0 * 0.5e3 * 44.56e-3, 15.0);
}

/// What makes no machine is refused with the reason, and nothing is written.
#[test]
fn fragments_that_make_no_machine_are_refused() {
    let folder = TempDir::new().expect("a folder");
    let at = folder.path();
    let whole = fragment_of(at, SLIDING, sliding(74), &SLED_OPTIONS);
    let plant = fs::read_to_string(at.join(&whole).join("plant.toml")).expect("a fragment");
    let alone = plant.split("[z_stage]").next().expect("a part");
    let odd =
        "kind = \"rotary\"\nfriction = \"lugre\"\npresliding = 5e-6\nfixed = 2.5\ncoulomb = -2.0\n";
    for (file, text) in [
        ("alone.toml", alone.to_owned()),
        ("none.toml", "[five]\na = 1\n".to_owned()),
        ("law.toml", "[law]\nname = \"dahl\"\n".to_owned()),
        ("odd.toml", format!("[law]\n[part]\n{odd}")),
        ("r.toml", "[resonance]\nfrequency_1 = 71.0\n".to_owned()),
        ("gains.toml", "[gains.z]\nkp = \"-1 V/count\"\n".to_owned()),
    ] {
        fs::write(at.join(file), text).expect("a file");
    }
    fs::create_dir(at.join("empty")).expect("a folder");
    let twice = format!("{whole}/plant.toml");
    for (axis, from, says) in [
        ("fivebar", &[&*whole][..], "along a line"),
        ("z", &["alone.toml"], "identify servo"),
        ("z", &["none.toml"], "is no fragment"),
        ("z", &["law.toml"], "part"),
        ("fivebar", &["odd.toml"], "part.coulomb"),
        ("z", &["r.toml"], "beside"),
        ("z", &["gains.toml"], "gains.z.kp"),
        ("z", &["empty"], "neither"),
        ("z", &["away.toml"], "cannot be read"),
        ("z", &[&whole, &twice], "one of them"),
    ] {
        for mut arguments in [vec!["tune", axis], vec!["characterize", axis, "step"]] {
            for fragment in from {
                arguments.extend(["--from", fragment]);
            }
            arguments.extend(["--runs", "other"]);
            let (code, out, error) = pigtail(at, &arguments);
            assert_eq!(code, Some(2), "{arguments:?}: {out}{error}");
            assert_eq!(error.lines().count(), 1, "{error}");
            assert!(error.contains(says), "{arguments:?}: {error}");
            assert!(!at.join("other").exists());
        }
    }
    let (code, _, error) = pigtail(at, &["rig", "empty", "--from", &whole]);
    assert_eq!(code, Some(2));
    assert!(error.contains("there already"), "{error}");
}

/// Pulses need an amplifier that plays them, which no record tells of.
#[test]
fn an_axis_of_ones_own_plays_no_pulses() {
    let folder = TempDir::new().expect("a folder");
    let run = fragment_of(folder.path(), SLIDING, sliding(75), &SLED_OPTIONS);
    let (code, _, error) = pigtail(
        folder.path(),
        &["characterize", "z", "impulse", "--from", &run],
    );
    assert_eq!(code, Some(2));
    assert!(error.contains("drive.pulse"), "{error}");
}
