//! The one rule, checked by a program: `control` cannot reach `machines`, and every room depends
//! only on the rooms that the design gives it, in tests and build scripts too.

use serde_json::Value;
use std::collections::BTreeMap;
use std::process::Command;

/// Each of our crates and those of ours that it may depend on.
const ALLOWED: [(&str, &[&str]); 5] = [
    ("pigtail-hal", &[]),
    ("pigtail-model", &[]),
    ("pigtail-control", &["pigtail-hal", "pigtail-model"]),
    ("pigtail-machines", &["pigtail-hal", "pigtail-model"]),
    (
        "pigtail",
        &[
            "pigtail-hal",
            "pigtail-model",
            "pigtail-control",
            "pigtail-machines",
        ],
    ),
];

fn dependencies() -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--no-deps",
            "--offline",
        ])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    let text = |value: &Value| value.as_str().expect("a name").to_owned();
    metadata["packages"]
        .as_array()
        .expect("packages")
        .iter()
        .map(|package| {
            // Normal, development and build dependencies alike.
            let names = package["dependencies"].as_array().expect("dependencies");
            let ours = names
                .iter()
                .map(|dependency| text(&dependency["name"]))
                .filter(|name| name.starts_with("pigtail"))
                .collect();
            (text(&package["name"]), ours)
        })
        .collect()
}

#[test]
fn every_room_depends_only_on_the_rooms_it_may() {
    let found = dependencies();
    let known: Vec<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
    for name in found.keys() {
        assert!(
            known.contains(&name.as_str()),
            "{name} is not in the list of rooms: add it"
        );
    }
    for (name, allowed) in ALLOWED {
        for dependency in &found[name] {
            assert!(
                allowed.contains(&dependency.as_str()),
                "{name} must not depend on {dependency}; it may on {allowed:?}"
            );
        }
    }
}

/// The sources of `control` neither read files nor ask the clock: time comes from the machine.
#[test]
fn control_has_no_files_clocks_or_threads() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../control/src");
    for entry in std::fs::read_dir(folder).expect("control has sources") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|extension| extension != "rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("a source");
        for forbidden in [
            "std::fs",
            "std::time",
            "std::thread",
            "std::env",
            "std::net",
        ] {
            assert!(!text.contains(forbidden), "{}: {forbidden}", path.display());
        }
    }
}
