//! Experiments on one axis, against the figures of the thesis's chapter 2, on machines that nothing
//! was tuned with; and how they are refused.

use assert_cmd::Command;
use pigtail_hal::AxisName;
use pigtail_session::characterize::{follow_sine, frequency, resolution, step};

use pigtail_control::station::Unobserved;
use pigtail_session::identify::{Model, windup};
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use pigtail_session::tune::{Method, Tune, Tuned, usual_step};
use rayon::prelude::*;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm");

fn setup() -> Setup {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig is well")
}

fn axis(name: &str) -> AxisName {
    name.parse().expect("an axis")
}

fn tuned(setup: &Setup, name: &str, method: Method, seed: u64) -> Tuned {
    let at = axis(name);
    let plan = Tune {
        at,
        method,
        trials: method.usual_trials(),
        step: usual_step(at.axis),
        seed,
        one_size: false,
    };
    setup.run(&plan, seed, &mut Unobserved).expect("no fault")
}

/// Thesis 2.3.2: rise 11 and 14 ms, settling 42 and 37 ms. The datasheet asks for 12 and 42, 15 and 38.
fn is_tuned(name: &str, seed: u64, tuned: &pigtail_session::tune::TuningDocument) {
    let (rise, settling) = match name {
        "fivebar" => (12.0, 42.0),
        _ => (15.0, 38.0),
    };
    assert!(tuned.specified.expect("a datasheet that asks").met);
    assert!(tuned.rise_ms <= rise, "{name} {seed}: {} ms", tuned.rise_ms);
    assert!(
        tuned.settling_ms <= settling,
        "{name} {seed}: {} ms",
        tuned.settling_ms
    );
    assert!(tuned.trials <= 50);
}

#[test]
fn a_machine_is_tuned_to_the_thesis_s_figures() {
    for name in ["fivebar", "z"] {
        is_tuned(
            name,
            600,
            &tuned(&setup(), name, Method::Simplex, 600).document,
        );
    }
}

/// In half of the trials that the thesis allows.
///
/// The rise is nearly the amplifier's: at full voltage from start to end the nominal five-bar joint
/// needs 10.6 ms from 10 to 90 %. By the ITAE alone one of these machines, seed 619, rises in 12.15 ms.
#[test]
#[ignore = "long: twenty machines"]
fn twenty_machines_are_tuned_to_the_thesis_s_figures() {
    let setup = setup();
    let least = |d: &pigtail_session::tune::TuningDocument| {
        d.starts
            .iter()
            .map(|s| s.cost)
            .fold(f64::INFINITY, f64::min)
    };
    for name in ["fivebar", "z"] {
        let costs = (600..620).into_par_iter().map(|seed| {
            let fast = tuned(&setup, name, Method::Simplex, seed).document;
            is_tuned(name, seed, &fast);
            let slow = tuned(&setup, name, Method::Random, seed).document;
            [least(&fast), least(&slow)]
        });
        let costs: Vec<[f64; 2]> = costs.collect();
        let [simplex, random] =
            [0, 1].map(|k| costs.iter().map(|c| c[k]).sum::<f64>() / costs.len() as f64);
        // The simplex gets as far in half the trials, to within half a percent of the cost.
        eprintln!("{name}: cost {simplex:.2} in 50 trials, {random:.2} in 100");
        assert!(simplex <= 1.005 * random, "{name}: {simplex} for {random}");
    }
}

#[test]
fn tuning_is_the_same_for_the_same_seed() {
    let setup = setup();
    let a = tuned(&setup, "z", Method::Random, 5).document;
    assert_eq!(a, tuned(&setup, "z", Method::Random, 5).document);
    assert_ne!(a, tuned(&setup, "z", Method::Random, 6).document);
}

/// Thesis 2.5: z moves by 0 or 2 counts at one count a step, evenly at two, 0.14 um; the five-bar
/// evenly at one, never more than two counts, 3.5 um.
#[test]
fn resolutions_are_those_of_the_thesis() {
    let setup = setup();
    for seed in [700, 701] {
        let rows = |name: &str| -> Vec<_> {
            setup
                .experiment(seed, |station| {
                    resolution(station, &setup.rig, axis(name), 500)
                })
                .expect("no fault")
                .into_iter()
                .map(|(row, _)| row)
                .collect()
        };
        let z = rows("z");
        assert_eq!(z.len(), 2, "{z:?}");
        assert!(
            z[0].resolution_um.is_none() && z[0].stuck_share > 0.3,
            "{:?}",
            z[0]
        );
        assert!(
            z[1].resolution_um.expect("consistent") <= 0.145,
            "{:?}",
            z[1]
        );
        let five_bar = rows("fivebar");
        assert_eq!(five_bar.len(), 1, "{five_bar:?}");
        assert!(five_bar[0].max_um <= 3.6, "{:?}", five_bar[0]);
    }
}

/// Thesis 2.3.2: 10 Hz and 8 Hz without attenuation, less than 9.9 and 9.5 degrees behind.
#[test]
fn sines_are_followed() {
    let setup = setup();
    for (name, hertz) in [("fivebar", 10.0), ("z", 8.0)] {
        let amplitude = usual_step(axis(name).axis) as f64 / 4.0;
        let (d, _) = setup
            .experiment(710, |station| {
                follow_sine(station, &setup.rig, axis(name), hertz, amplitude)
            })
            .expect("no fault");
        assert!((d.encoder_gain - 1.0).abs() < 0.05, "{d:?}");
        assert!(d.encoder_phase_deg.abs() < 9.5, "{d:?}");
        let (d, _) = setup
            .experiment(710, |station| step(station, &setup.rig, axis(name), 100))
            .expect("no fault");
        assert!(d.settled, "{d:?}");
    }
}

#[test]
fn a_frequency_response_starts_at_one_and_falls() {
    let setup = setup();
    let (d, ..) = setup
        .experiment(720, |station| {
            frequency(station, &setup.rig, axis("z"), 65.0, 1)
        })
        .expect("no fault");
    assert!((d.encoder[0].gain - 1.0).abs() < 0.1, "{:?}", d.encoder[0]);
    assert!(
        d.bandwidth_hz.is_none_or(|hertz| hertz > 50.0),
        "{:?}",
        d.bandwidth_hz
    );
    assert!(d.lowest_coherence > 0.5, "{}", d.lowest_coherence);
    assert!(
        d.encoder
            .iter()
            .all(|row| (0.0..=1.0 + 1e-9).contains(&row.coherence))
    );
    // At the crossover |L| = 1, so |1 + L| = 2 sin(margin / 2), and the peak is no lower than one over that.
    let (margin, peak) = (d.open_loop.phase_margin, d.open_loop.sensitivity_peak);
    let (margin, peak) = (margin.expect("it crosses"), peak.expect("it is known"));
    assert!((0.0..120.0).contains(&margin.deg), "{margin:?}");
    assert!(
        margin.sigma_deg.is_some_and(|sigma| sigma < 5.0),
        "{margin:?}"
    );
    let least = 0.5 / (0.5 * margin.deg.to_radians()).sin();
    assert!(peak.ratio > 0.97 * least, "{peak:?} {margin:?}");
}

#[test]
fn a_load_comes_to_rest_short_of_its_step_by_windup() {
    let setup = setup();
    let (d, _) = setup
        .experiment(721, |station| {
            step(station, &setup.rig, axis("fivebar"), 400)
        })
        .expect("no fault");
    let load = d.load.expect("the rig has probes");
    assert!(load.rest_um < load.wanted_um, "{load:?}");
    let settled: Vec<f64> = load
        .settling
        .iter()
        .filter_map(|row| row.settling_ms)
        .collect();
    assert!(!settled.is_empty() && settled.is_sorted(), "{load:?}");
}

/// Windup on machines drawn around the plant, each identified by itself, over the full range, a
/// quarter of it, repeatedly and with random reversals.
fn windup_is_compensated_twentyfold(seeds: std::ops::Range<u64>) {
    let setup = setup();
    let all = seeds.into_par_iter().map(|seed| {
        let identified = setup
            .experiment(seed, |station| {
                windup(station, &setup.rig, axis("fivebar"), Model::Memory, seed)
            })
            .expect("no fault");
        let d = identified.document;
        assert!((85.0..130.0).contains(&d.uncompensated_um), "{d:?}");
        let gains = d.scans.iter().map(|row| {
            let [none, _, memory] = row.peak_to_peak_um;
            none / memory
        });
        // The thesis's own tests: the gap between the paths over the full range, and that it is
        // no wider over a quarter of it.
        let gaps = d.scans[..3].iter().map(|row| row.reversal_um);
        (
            gains.fold(f64::INFINITY, f64::min),
            d.scans[0].uncompensated_um / d.scans[0].reversal_um,
            gaps.fold(0.0, f64::max),
        )
    });
    let (worst, thesis, left) = all.reduce(
        || (f64::INFINITY, f64::INFINITY, 0.0),
        |a, b| (a.0.min(b.0), a.1.min(b.1), a.2.max(b.2)),
    );
    eprintln!("worst {worst:.1}; with (2.20) {thesis:.1}, at most {left:.1} um are left");
    assert!(worst > 20.0, "{worst}");
    assert!(thesis > 7.0 && left < 15.0, "{thesis} {left}");
}

#[test]
fn windup_is_compensated_twentyfold_on_a_machine() {
    windup_is_compensated_twentyfold(730..731);
}

#[test]
#[ignore = "long: twenty machines"]
fn windup_is_compensated_twentyfold_on_every_machine() {
    windup_is_compensated_twentyfold(730..750);
}

struct Folder(TempDir);

impl Folder {
    /// A folder with a copy of the default rig, changed.
    fn new(file: &str, change: impl Fn(String) -> String) -> Self {
        let folder = TempDir::new().expect("a folder");
        let rig = folder.path().join("rig");
        fs::create_dir(&rig).expect("a rig");
        for name in ["machine.toml", "plant.toml", "calibration.toml"] {
            let text = fs::read_to_string(Path::new(RIG).join(name)).expect("a file");
            let text = if name == file { change(text) } else { text };
            fs::write(rig.join(name), text).expect("a file");
        }
        Self(folder)
    }

    fn run(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_pigtail"))
            .current_dir(self.0.path())
            .args(arguments)
            .output()
            .expect("the program starts");
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        (
            output.status.code(),
            text(output.stdout),
            text(output.stderr),
        )
    }

    fn calibration(&self) -> String {
        fs::read_to_string(self.0.path().join("rig/calibration.toml")).expect("a calibration")
    }
}

#[test]
fn gains_and_windup_go_into_the_calibration_and_are_used() {
    let folder = Folder::new("", |text| text);
    let before = folder.calibration();
    let (code, out, _) = folder.run(&["tune", "z", "--rig", "rig", "--json", "--dry-run"]);
    assert_eq!(code, Some(0));
    assert_eq!(folder.calibration(), before, "a dry run leaves it alone");
    let document: Value = serde_json::from_str(&out).expect("JSON");
    for key in [
        "axis",
        "trials",
        "cost",
        "gains",
        "rise_ms",
        "settling_ms",
        "overshoot_percent",
        "seconds_machine",
    ] {
        assert!(!document[key].is_null(), "{key}");
    }
    assert_eq!(
        folder.run(&["tune", "z", "--rig", "rig", "--write"]).0,
        Some(0)
    );
    assert_eq!(
        folder
            .run(&["tune", "fivebar", "--rig", "rig", "--write"])
            .0,
        Some(0)
    );
    let (code, out, _) = folder.run(&[
        "identify", "windup", "fivebar", "--rig", "rig", "--json", "--write",
    ]);
    assert_eq!(code, Some(0));
    let document: Value = serde_json::from_str(&out).expect("JSON");
    for key in [
        "axis",
        "w_max_um",
        "q_um",
        "residual_um",
        "uncompensated_um",
        "compensated_um",
        "factor",
        "model",
    ] {
        assert!(!document[key].is_null(), "{key}");
    }
    let after = folder.calibration();
    assert!(after.contains("[windup.five_bar]") && after.contains("tune left.z, run"));
    assert!(
        after.starts_with("# The belief about this machine"),
        "comments stay"
    );
    // Another machine than the one that was measured.
    let (code, _, error) = folder.run(&["align", "--rig", "rig", "--seed", "801"]);
    assert_eq!(code, Some(0), "{error}");
}

#[test]
fn bad_input_is_refused() {
    let folder = Folder::new("machine.toml", |text| {
        let from = text.find("[probe]").expect("a probe");
        let to = text.find("[sensing_fiber]").expect("a sensing fiber");
        format!("{}{}", &text[..from], &text[to..])
    });
    for (arguments, parts) in [
        (
            &["tune", "elbow"][..],
            &["elbow", "left.a", "right.z", "fivebar"][..],
        ),
        (
            &["tune", "z", "--step", "99999999"],
            &["--step", "range", "at most"],
        ),
        (&["tune", "z", "--trials", "1000"], &["--trials", "5..=100"]),
        (&["characterize", "z", "dance"], &["dance", "resolution"]),
        (
            &["tune", "z", "--step", "0.9 deg"],
            &["--step", "accepted is a length"],
        ),
        (
            &["characterize", "fivebar", "step", "--size", "81 um"],
            &["--size", "accepted is an angle"],
        ),
        (
            &["characterize", "z", "step", "--size", "3 nm"],
            &["--size", "0 counts", "accepted is at least 1"],
        ),
        (
            &["characterize", "z", "step", "--size", "99999999"],
            &["--size", "at most"],
        ),
        (
            &["characterize", "z", "sine", "--frequency", "NaN"],
            &["--frequency", "finite"],
        ),
        (
            &["characterize", "z", "sine", "--frequency", "5000"],
            &["--frequency", "at most"],
        ),
        (
            &["characterize", "fivebar", "resolution", "--rig", "rig"],
            &["rig/machine.toml", "probe", "no probes"],
        ),
        (&["trace", "square", "--rig", "rig"], &["no probes"]),
        (
            &["trace", "square", "--size", "26 mm"],
            &["--size", "at most 0.025 m"],
        ),
        (
            &["trace", "square", "--speed", "1 nm/s"],
            &["--speed", "accepted"],
        ),
        (
            &["trace", "square", "--coupling", "1 N m"],
            &["--coupling", "at most 0.12"],
        ),
        (
            &["trace", "square", "--preload", "9"],
            &["--preload", "at most 5"],
        ),
        (
            &["characterize", "fivebar", "windup", "--rig", "rig"],
            &["no probes"],
        ),
        (
            &["identify", "windup", "fivebar", "--rig", "rig"],
            &["rig/machine.toml", "no probes"],
        ),
    ] {
        let (code, _, error) = folder.run(arguments);
        assert_eq!(code, Some(2), "{arguments:?}: {error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    }
    let left: Vec<_> = fs::read_dir(folder.0.path().join("runs"))
        .map(|entries| entries.map(|e| e.expect("an entry").file_name()).collect())
        .unwrap_or_default();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn gains_that_are_not_finite_are_refused() {
    for bad in ["NaN V/count", "inf V/count", "-1 V/count", "0.8"] {
        let folder = Folder::new("calibration.toml", |text| {
            text.replace("kp = \"0.834 V/count\"", &format!("kp = \"{bad}\""))
        });
        let (code, _, error) = folder.run(&["tune", "z", "--rig", "rig"]);
        assert_eq!(code, Some(2), "{error}");
        assert!(
            error.contains("gains.z.kp") && error.contains(bad),
            "{error}"
        );
    }
}

/// A stage as `simulate joint` takes it.
const JOINT: &str = "[z]\nJl = 1.75e-5\nJm = 1e-6\nNenc = 2048\nP = 1.01e-4\nR = 5.53\nTs = 4e-4\n\
    Vint = 3.55\nVmax = 24\nbl = 5.7e-3\nbm = 1.71e-6\nfcl = 2.94e-3\n\
    fcm = 2.09e-3\nfsl = 3.06e-3\nfsm = 2.58e-3\nkb = 0.02\nkm = 0.02\nks = 3.95\n\
    r = 0.2\nkp = 0.834\nki = 72.8\nkd = 3.97e-4\n";

/// Milliseconds that pass for seconds, a quarter of an hour of them: their rows would fill the memory.
#[test]
fn a_simulation_that_nobody_could_read_is_refused() {
    let folder = Folder::new("", |text| text);
    let rows: Vec<_> = (0..1800)
        .map(|k| format!("{},{}", 500 * k, k % 3))
        .collect();
    let rows = rows.join("\n");
    let write = |name: &str, text: &str| fs::write(folder.0.path().join(name), text);
    write("long.csv", &format!("time_s,u_V\n{rows}")).expect("a file");
    write("joint.toml", JOINT).expect("a file");
    let joint = ["simulate", "joint", "--params", "joint.toml", "--axis", "z"];
    let (code, _, error) = folder.run(&[&joint[..], &["--input", "long.csv"]].concat());
    assert_eq!(code, Some(2), "{error}");
    assert!(
        error.contains("--duration") && error.contains("another unit"),
        "{error}"
    );
}

#[test]
fn simulations_refuse_what_they_cannot_do() {
    let folder = Folder::new("", |text| text);
    let parameters = JOINT;
    let write = |name: &str, text: &str| {
        fs::write(folder.0.path().join(name), text).expect("a file");
    };
    write("good.toml", parameters);
    write(
        "static.toml",
        &parameters.replace("fsm = 2.58e-3", "fsm = 2.0e-3"),
    );
    write("load.toml", &parameters.replace("bl = 5.7e-3", "bl = -1"));
    write("unknown.toml", &format!("{parameters}colour = 1\n"));
    write("back.csv", "time_s,u_V\n0,1\n0.2,2\n0.1,3\n");
    write("empty.csv", "time_s,u_V\n");
    write("letters.csv", "time_s,u_V\n0,one\n");
    let joint = |file: &str, rest: &[&str]| {
        let mut arguments = vec!["simulate", "joint", "--params", file];
        arguments.extend(rest);
        folder.run(&arguments)
    };
    let (code, out, _) = joint("good.toml", &["--axis", "z", "--step", "100"]);
    assert_eq!((code, out.lines().count()), (Some(0), 1202));
    for (file, rest, parts) in [
        (
            "good.toml",
            &["--axis", "y", "--step", "1"][..],
            &["`y`", "no such axis", "z"][..],
        ),
        (
            "none.toml",
            &["--axis", "z", "--step", "1"],
            &["none.toml", "cannot be read"],
        ),
        (
            "static.toml",
            &["--axis", "z", "--step", "1"],
            &["`z.fsm`", "is 0.002", "at least"],
        ),
        (
            "load.toml",
            &["--axis", "z", "--step", "1"],
            &["`z.bl`", "is -1", "zero or more"],
        ),
        (
            "unknown.toml",
            &["--axis", "z", "--step", "1"],
            &["z.colour", "unknown"],
        ),
        (
            "good.toml",
            &["--axis", "z", "--step", "nan"],
            &["--step", "finite"],
        ),
        (
            "good.toml",
            &["--axis", "z", "--impulse", "1,2"],
            &["--impulse", "3 finite"],
        ),
        (
            "good.toml",
            &["--axis", "z", "--impulse", "1,2,0"],
            &["impulse", "above zero"],
        ),
        (
            "good.toml",
            &["--axis", "z", "--input", "back.csv"],
            &["data row 3", "rises"],
        ),
        (
            "good.toml",
            &["--axis", "z", "--input", "empty.csv"],
            &["empty.csv", "no rows"],
        ),
        (
            "good.toml",
            &["--axis", "z", "--input", "letters.csv"],
            &["line 2", "finite number"],
        ),
        ("good.toml", &["--axis", "z"], &["--input", "--step"]),
        (
            "good.toml",
            &["--axis", "z", "--step", "1", "--row-period", "3e-4"],
            &["--row-period", "0.0004"],
        ),
    ] {
        let (code, _, error) = joint(file, rest);
        assert_eq!(code, Some(2), "{rest:?}: {error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    }
}
