//! A rig that is controlled by position, as a user meets it.

use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;

fn pigtail(folder: &Path, arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("the program starts")
}

#[test]
fn align_prints_the_same_keys_and_the_same_seed_the_same_bytes() {
    let folder = TempDir::new().expect("a folder");
    let document = |rig: &str| -> Value {
        let output = pigtail(
            folder.path(),
            &["align", "--rig", rig, "--seed", "3", "--json"],
        );
        serde_json::from_slice(&output.stdout).expect("one JSON document")
    };
    let keys = |document: &Value| -> Vec<String> {
        let keys = document.as_object().expect("an object").keys();
        keys.cloned().collect()
    };
    let (bench, again) = (document("bench-piezo"), document("bench-piezo"));
    let machine = document("afpm");
    assert_eq!(keys(&bench), keys(&machine));
    assert_eq!(keys(&bench["fibers"][0]), keys(&machine["fibers"][0]));
    assert_eq!(keys(&bench["runs_on"]), keys(&machine["runs_on"]));
    assert_eq!(bench["fibers"], again["fibers"]);
    assert_eq!(bench["runs_on"]["built_in"], true);
    assert_eq!(bench["collision"], false);
}

#[test]
fn a_campaign_gives_the_same_rows_whatever_the_threads() {
    let folder = TempDir::new().expect("a folder");
    let rows = |threads: &str| -> Value {
        let arguments = [
            "campaign",
            "--rig",
            "bench-piezo",
            "--devices",
            "4",
            "--json",
            "--threads",
        ];
        let output = pigtail(folder.path(), &[&arguments[..], &[threads]].concat());
        let mut document: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        for key in ["wall_seconds", "rows", "report"] {
            document[key] = Value::Null;
        }
        document
    };
    let one = rows("1");
    assert_eq!(one["fibers"], 12);
    assert_eq!(one, rows("3"));
}

#[test]
fn what_drives_volts_and_what_a_bench_has_not_is_refused_in_a_line() {
    let folder = TempDir::new().expect("a folder");
    for (arguments, part) in [
        (&["tune", "z"][..], "`kind`"),
        (&["benchmark"], "`kind`"),
        (&["maximize"], "`kind`"),
        (&["commission", "--steps", "windup"], "--steps"),
        (&["align", "--procedure", "thesis"], "--procedure"),
        (&["align", "--fleet", "workshop"], "--fleet"),
        (&["align", "--scenario", "drift"], "--scenario"),
        (
            &["campaign", "--devices", "2", "--commissioned"],
            "--commissioned",
        ),
        (
            &["campaign", "--devices", "2", "--machines", "2"],
            "--machines",
        ),
    ] {
        let output = pigtail(
            folder.path(),
            &[arguments, &["--rig", "bench-piezo"]].concat(),
        );
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(part), "{arguments:?}: {said}");
        assert_eq!(said.lines().count(), 1, "{arguments:?}: {said}");
    }
    assert_eq!(
        std::fs::read_dir(folder.path()).expect("a folder").count(),
        0,
        "nothing is written"
    );
    let output = pigtail(folder.path(), &["rig", "check", "bench-piezo"]);
    assert_eq!(output.status.code(), Some(0));
}
