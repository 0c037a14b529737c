//! The program as a user meets it: what it prints, what it leaves behind, how it refuses.

use assert_cmd::Command;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm");
const RECIPE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../recipes/y-branch.toml");

fn pigtail(folder: &Path, arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("the program starts")
}

fn runs(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder.join("runs")) else {
        return Vec::new();
    };
    entries
        .map(|entry| entry.expect("an entry").path())
        // Beside them is their store.
        .filter(|path| path.is_dir())
        .collect()
}

#[test]
fn align_prints_one_document_and_leaves_one_whole_run() {
    let folder = TempDir::new().expect("a folder");
    let output = pigtail(folder.path(), &["align", "--seed", "12", "--json"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stderr.is_empty(), "quiet when not a terminal");
    let document: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    for key in [
        "rig",
        "recipe",
        "procedure",
        "seed",
        "fibers",
        "seconds_per_fiber",
        "report",
    ] {
        assert!(!document[key].is_null(), "{key}");
    }
    let fibers = document["fibers"].as_array().expect("rows");
    assert_eq!(fibers.len(), 3);
    for fiber in fibers {
        assert_eq!(fiber["outcome"], "aligned");
        for axis in ["x", "y", "z"] {
            assert!(fiber["offset_um"][axis].is_f64());
        }
        assert!(fiber["coupling_loss_db"].as_f64().expect("a loss") > 0.0);
        assert!(fiber["phases"][0]["name"].is_string() && fiber["phases"][0]["seconds"].is_f64());
        assert!(fiber["port"].is_string() && fiber["seconds"].is_f64());
    }
    let runs = runs(folder.path());
    assert_eq!(runs.len(), 1, "{runs:?}");
    let report = folder
        .path()
        .join(document["report"].as_str().expect("a path"));
    let html = fs::read_to_string(report).expect("the report is where the document says");
    assert_eq!(
        html.matches("class=\"chart ").count(),
        12,
        "four pictures a fiber"
    );
    assert!(
        !html.contains("http://") || !html.contains("src="),
        "self-contained"
    );
    let summary = fs::read_to_string(runs[0].join("summary.json")).expect("a summary");
    assert_eq!(
        serde_json::from_str::<Value>(&summary).expect("JSON"),
        document
    );
    let origin = fs::read_to_string(runs[0].join("run.json")).expect("an origin");
    let origin: Value = serde_json::from_str(&origin).expect("JSON");
    assert_eq!(origin["configuration"].as_array().expect("files").len(), 4);
    let samples = fs::read_to_string(runs[0].join("samples.csv")).expect("samples");
    let fields = samples.lines().next().expect("a header").split(',').count();
    assert!(
        samples
            .lines()
            .all(|line| line.split(',').count() == fields)
    );
}

#[test]
fn the_same_seed_prints_the_same_bytes_apart_from_the_report() {
    let folder = TempDir::new().expect("a folder");
    let print = || {
        let output = pigtail(folder.path(), &["align", "--seed", "3", "--json"]);
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        let at = text.find("\"report\"").expect("a report");
        text[..at].to_owned()
    };
    assert_eq!(print(), print());
    assert_eq!(
        runs(folder.path()).len(),
        2,
        "a second run does not replace the first"
    );
}

/// A copy of the default rig or recipe with one text replaced.
struct Spoilt {
    folder: TempDir,
}

impl Spoilt {
    fn new(file: &str, from: &str, to: &str) -> Self {
        let folder = TempDir::new().expect("a folder");
        let rig = folder.path().join("rig");
        fs::create_dir(&rig).expect("a rig");
        for name in ["machine.toml", "plant.toml", "calibration.toml"] {
            fs::copy(Path::new(RIG).join(name), rig.join(name)).expect("a copy");
        }
        fs::copy(RECIPE, rig.join("recipe.toml")).expect("a copy");
        let path = rig.join(file);
        let text = fs::read_to_string(&path).expect("a file");
        assert!(text.contains(from), "{file} has no {from}");
        fs::write(&path, text.replacen(from, to, 1)).expect("a file");
        Self { folder }
    }

    fn run(&self) -> (Option<i32>, String) {
        let output = pigtail(
            self.folder.path(),
            &["align", "--rig", "rig", "--recipe", "rig/recipe.toml"],
        );
        (
            output.status.code(),
            String::from_utf8(output.stderr).expect("UTF-8"),
        )
    }

    /// Exit code 2, one line that contains all of `parts`, and no run left behind.
    fn is_refused_with(&self, parts: &[&str]) {
        let (code, error) = self.run();
        assert_eq!(code, Some(2), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
        assert!(runs(self.folder.path()).is_empty());
    }
}

#[test]
fn limits_of_motion_that_make_no_machine_are_refused() {
    for (file, from, to, parts) in [
        (
            "machine.toml",
            "jerk = \"50 m/s3\"",
            "jerk = \"50 m/s2\"",
            &["rig/machine.toml", "five_bar.jerk", "50 m/s2", "a jerk"][..],
        ),
        (
            "machine.toml",
            "jerk = \"20 m/s3\"",
            "jerk = \"1e7 m/s3\"",
            &[
                "z_stage.jerk",
                "10000000 m/s3",
                "out of range",
                "1000000 m/s3",
            ][..],
        ),
        (
            "machine.toml",
            "speed = \"5000 rpm\"",
            "speed = \"5 rpm\"",
            &["five_bar.drive.speed", "5 rpm", "accepted is 10 to"][..],
        ),
    ] {
        Spoilt::new(file, from, to).is_refused_with(parts);
    }
}

#[test]
fn what_no_machine_and_no_device_could_be_is_refused() {
    for (file, from, to, parts) in [
        (
            "recipe.toml",
            "period = \"24 ms\"",
            "period = \"1 us\"",
            &[
                "rig/recipe.toml",
                "fast.conical_scan.period",
                "1e-6",
                "1.2e-2",
            ][..],
        ),
        (
            "recipe.toml",
            "input_gap = \"60 um\"",
            "input_gap = \"20 um\"",
            &["fast.input_gap", "20.0 um", "fast.doubtful_gap", "25.0 um"][..],
        ),
        (
            "recipe.toml",
            "[fast.conical_scan]",
            "[fast.conical_scan]\nlag = \"1.2 ms\"",
            &[
                "rig/recipe.toml",
                "fast.conical_scan.lag",
                "geometry.micro.lag",
                "calibration.toml",
            ][..],
        ),
        (
            "recipe.toml",
            "[fast.conical_scan]",
            "[fast.retry]\nlast_turns = 0\n\n[fast.conical_scan]",
            &["rig/recipe.toml", "fast.retry.last_turns", "0", "1 to 100"][..],
        ),
        (
            "recipe.toml",
            "[fast.conical_scan]",
            "[[fast.retry.passes]]\nslow = 0.01\n\n[fast.conical_scan]",
            &["fast.retry.passes", "pass 1", "slow", "0.01", "0.1 to 100"][..],
        ),
        (
            "plant.toml",
            "transmission = [1.0, 1.0]",
            "transmission = [1.0, 1.5]",
            &["rig/plant.toml", "device.transmission", "1.5", "0 to 1"][..],
        ),
    ] {
        Spoilt::new(file, from, to).is_refused_with(parts);
    }
}

#[test]
fn bad_input_is_named_with_file_key_value_and_what_is_accepted() {
    for (file, from, to, parts) in [
        (
            "machine.toml",
            "gear_ratio = 80.0",
            "gear_ration = 80.0",
            &["rig/machine.toml, line 15", "gear_ration", "gear_ratio"][..],
        ),
        (
            "plant.toml",
            "resonance = \"200 Hz\"",
            "resonance = \"200 kg\"",
            &[
                "rig/plant.toml",
                "micro.resonance",
                "\"200 kg\"",
                "a frequency",
                "Hz",
            ][..],
        ),
        (
            "plant.toml",
            "full = \"4 V\"",
            "full = \"NaN V\"",
            &["light.full", "NaN", "finite number"][..],
        ),
        (
            "plant.toml",
            "level = 0.5",
            "level = nan",
            &["scatter.level", "NaN", "finite number"][..],
        ),
        (
            "plant.toml",
            "noise = \"5 mV\"",
            "noise = \"-5 mV\"",
            &["light.noise", "-5 mV", "zero or more"][..],
        ),
        (
            "plant.toml",
            "static = \"0.12 N m\"",
            "static = \"0.11 N m\"",
            &["five_bar.joint.load_friction", "0.11", "0.119", "at least"][..],
        ),
        (
            "recipe.toml",
            "input = [\"0 um\"",
            "input = [\"20 mm\"",
            &[
                "rig/recipe.toml",
                "ports.input",
                "20 mm",
                "workspace",
                "12.5 mm",
            ][..],
        ),
        (
            "recipe.toml",
            "frequency = \"8 Hz\"",
            "frequency = \"40 Hz\"",
            &["raster.frequency", "40 Hz", "at most", "7.96 Hz", "500 Hz"][..],
        ),
        (
            "recipe.toml",
            "gap = \"5 um\"",
            "gap = \"60 um\"",
            &["approach.gap", "60 um", "raster.gap", "smaller"][..],
        ),
        (
            "recipe.toml",
            "mesh = \"5 um\"",
            "mesh = 5",
            &["raster.mesh", "\"5\" is not a length", "um"][..],
        ),
        (
            "recipe.toml",
            "[raster]",
            "[raster",
            &["rig/recipe.toml, line"][..],
        ),
        (
            "calibration.toml",
            "kp = \"0.64 V/count\"",
            "",
            &["calibration.toml", "gains.five_bar", "kp"][..],
        ),
        (
            "calibration.toml",
            "proximal = \"45 mm\"",
            "proximal = \"20 mm\"",
            &["geometry.five_bar", "out of reach", "25 mm"][..],
        ),
    ] {
        Spoilt::new(file, from, to).is_refused_with(parts);
    }
}

#[test]
fn a_missing_file_and_an_unknown_name_are_told() {
    let folder = TempDir::new().expect("a folder");
    for (arguments, parts) in [
        (
            ["--rig", "nowhere"],
            &["nowhere", "no such rig", "afpm"][..],
        ),
        (
            ["--recipe", "nothing"],
            &["nothing", "no such recipe", "y-branch"][..],
        ),
        (["--rig", "."], &["./machine.toml", "cannot be read"][..]),
        (
            ["--runs", "/proc/nowhere"],
            &["/proc/nowhere", "writable"][..],
        ),
        (["--seed", "-1"], &["--seed", "-1"][..]),
    ] {
        let output = pigtail(folder.path(), &["align", arguments[0], arguments[1]]);
        let error = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    }
    assert!(runs(folder.path()).is_empty());
}

#[test]
fn no_light_is_a_negative_with_its_evidence() {
    let spoilt = Spoilt::new("plant.toml", "full = \"4 V\"", "full = \"1 uV\"");
    let output = pigtail(
        spoilt.folder.path(),
        &[
            "align",
            "--rig",
            "rig",
            "--recipe",
            "rig/recipe.toml",
            "--json",
        ],
    );
    assert_eq!(output.status.code(), Some(1));
    let document: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(document["fibers"][0]["outcome"], "no_light");
    assert!(
        document["fibers"][0]["detail"]
            .as_str()
            .expect("a text")
            .contains("samples")
    );
    assert_eq!(
        runs(spoilt.folder.path()).len(),
        1,
        "a negative is worth its record"
    );
}

#[test]
fn help_teaches() {
    let folder = TempDir::new().expect("a folder");
    for arguments in [
        &["--help"][..],
        &["align", "--help"],
        &["campaign", "--help"],
        &["runs", "--help"],
        &["runs", "verify", "--help"],
    ] {
        let output = pigtail(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(0));
        insta::assert_snapshot!(arguments.join(" "), String::from_utf8_lossy(&output.stdout));
    }
    assert_eq!(pigtail(folder.path(), &[]).status.code(), Some(2));
    assert_eq!(pigtail(folder.path(), &["algin"]).status.code(), Some(2));
}

/// Pulses: what cannot be done is bad input, and what was done is one document.
#[test]
fn impulse_explains_itself_and_refuses() {
    let folder = TempDir::new().expect("a folder");
    let output = pigtail(
        folder.path(),
        &[
            "impulse",
            "z",
            "--target-nm",
            "100",
            "--seed",
            "5",
            "--json",
        ],
    );
    assert_eq!(output.status.code(), Some(0));
    let document: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    for key in [
        "axis",
        "target_nm",
        "pulses",
        "error_nm",
        "settled_s",
        "estimator",
    ] {
        assert!(!document[key].is_null(), "{key}");
    }
    let before = runs(folder.path()).len();
    for (arguments, part) in [
        (&["--target-nm", "100", "--gain", "2"][..], "below 2"),
        (&["--target-nm", "-1e7"], "--target-nm"),
        (&["--target-nm", "inf"], "finite"),
        (&["--target-nm", "100", "--rest-ms", "0.01"], "--rest-ms"),
        (&["--target-nm", "100", "--rig", "nowhere"], "nowhere"),
        (&["--target-nm", "100", "--runs", "20"], "--machines 20"),
    ] {
        let output = pigtail(folder.path(), &[&["impulse", "z"], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(message.contains(part), "{message}");
    }
    assert_eq!(runs(folder.path()).len(), before, "nothing half-written");
    let output = pigtail(
        folder.path(),
        &[
            "impulse",
            "z",
            "--target-nm",
            "100",
            "--machines",
            "20",
            "--json",
        ],
    );
    let campaign: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    for part in [
        &campaign["below_10nm_percent"],
        &campaign["error_nm"]["p50"],
        &campaign["error_nm"]["p90"],
    ] {
        assert!(part.is_f64(), "{campaign}");
    }
}

/// What a shell and `man` ask for, and a question that is no mistake.
#[test]
fn shells_and_manuals_are_answered() {
    let folder = TempDir::new().expect("a folder");
    for (arguments, part) in [
        (&["completions", "bash"][..], "_pigtail"),
        (&["completions", "zsh"], "#compdef pigtail"),
        (&["completions", "fish"], "complete -c pigtail"),
        (&["man"], ".TH pigtail"),
        (&["align", "--fault", "help"], "encoder-stuck"),
    ] {
        let output = pigtail(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(text.contains(part), "{text}");
        assert!(output.stderr.is_empty(), "{arguments:?}");
    }
    let there = folder.path().display().to_string();
    let output = pigtail(folder.path(), &["man", "--into", &there]);
    assert_eq!(output.status.code(), Some(0));
    assert!(folder.path().join("pigtail-align.1").is_file());
    let output = pigtail(folder.path(), &["man", "--into", "nowhere"]);
    assert_eq!(output.status.code(), Some(2));
}
