//! Who may know whom, and who is pure: what ARCHITECTURE.md says, checked by a program.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The table of ARCHITECTURE.md: each room, and the rooms that it may know.
fn allowed() -> BTreeMap<String, Vec<String>> {
    let page = fs::read_to_string(format!("{ROOT}/ARCHITECTURE.md")).expect("the page");
    let rows = page
        .lines()
        .skip_while(|line| !line.starts_with("| room | may know |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'));
    rows.map(|row| {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let names = |cell: &str| -> Vec<String> {
            let parts = cell.split(',').map(|name| name.trim().trim_matches('`'));
            parts
                .filter(|name| !name.is_empty() && *name != "none")
                .map(str::to_owned)
                .collect()
        };
        (names(cells[0]).remove(0), names(cells[1]))
    })
    .collect()
}

/// A dependency of ours, and whether only tests and benches have it.
type Dependency = (String, bool);

fn dependencies() -> BTreeMap<String, Vec<Dependency>> {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--no-deps",
            "--offline",
        ])
        .current_dir(ROOT)
        .output()
        .expect("cargo runs");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    // A room is called by its last name; the program is `pigtail`.
    let text = |value: &Value| {
        let name = value.as_str().expect("a name");
        name.strip_prefix("pigtail-").unwrap_or(name).to_owned()
    };
    let packages = metadata["packages"].as_array().expect("packages");
    packages
        .iter()
        .map(|package| {
            let all = package["dependencies"].as_array().expect("dependencies");
            let ours = all
                .iter()
                .filter(|d| d["name"].as_str().is_some_and(|n| n.starts_with("pigtail")))
                .map(|d| (text(&d["name"]), d["kind"] == "dev"))
                .collect();
            (text(&package["name"]), ours)
        })
        .collect()
}

#[test]
fn every_room_knows_only_the_rooms_that_it_may() {
    let (allowed, found) = (allowed(), dependencies());
    let rooms: Vec<_> = found.keys().collect();
    assert_eq!(
        allowed.keys().collect::<Vec<_>>(),
        rooms,
        "the table of ARCHITECTURE.md lists other rooms"
    );
    for (room, known) in &found {
        for (other, in_tests) in known {
            // What goes around a machine is tested on one.
            let tested = *in_tests && room == "machines" && other == "twin";
            assert!(
                tested || allowed[room].contains(other),
                "{room} must not know {other}; it may know {:?}",
                allowed[room]
            );
        }
    }
}

/// Rooms that do nothing but compute: time and data come to them.
const PURE: [&str; 4] = ["model", "numerics", "control", "sysid"];

/// What they have no business with.
const FORBIDDEN: [&str; 7] = [
    "std::fs",
    "std::time",
    "std::thread",
    "std::env",
    "std::net",
    "std::process",
    "std::io",
];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Where sources below a folder do what they must not: file and what it is.
fn offences(folder: &Path) -> Vec<String> {
    let mut files = Vec::new();
    sources(folder, &mut files);
    assert!(!files.is_empty(), "{}: no sources", folder.display());
    let mut offences = Vec::new();
    for path in files {
        let text = fs::read_to_string(&path).expect("a source");
        // `use std::{fs, io}` names the same by another way.
        let grouped: String = text
            .split("use std::{")
            .skip(1)
            .fold(String::new(), |all, rest| {
                let group = rest.split(';').next().unwrap_or_default();
                let inner = group.split(|c: char| !(c.is_alphanumeric() || c == '_'));
                inner.fold(all, |all, name| all + "std::" + name + " ")
            });
        for forbidden in FORBIDDEN {
            let whole = format!("{forbidden} ");
            if text.contains(forbidden) || grouped.contains(&whole) {
                offences.push(format!("{}: {forbidden}", path.display()));
            }
        }
    }
    offences
}

#[test]
fn pure_rooms_have_no_files_clocks_threads_or_environment() {
    for room in PURE {
        let found = offences(&Path::new(ROOT).join("crates").join(room).join("src"));
        assert!(found.is_empty(), "{found:#?}");
    }
}

/// The check above sees what is hidden in a folder of a folder, and behind a group of imports.
#[test]
fn a_planted_offence_is_found() {
    let root = tempfile::TempDir::new().expect("a folder");
    let deep = root.path().join("align").join("peak");
    fs::create_dir_all(&deep).expect("folders");
    fs::write(root.path().join("lib.rs"), "//! Fine.\nuse std::fmt;\n").expect("a file");
    fs::write(deep.join("mod.rs"), "use std::{fmt, thread};\n").expect("a file");
    assert_eq!(offences(root.path()).len(), 1);
    fs::write(
        deep.join("more.rs"),
        "fn f() { std::time::Instant::now(); }\n",
    )
    .expect("a file");
    assert_eq!(offences(root.path()).len(), 2);
}

/// Only the apps know how a program is called, and how a page is drawn is `report`'s business.
#[test]
fn below_the_apps_nobody_knows_of_options() {
    let mut files = Vec::new();
    sources(&Path::new(ROOT).join("crates"), &mut files);
    let guilty: Vec<_> = files
        .iter()
        .filter(|path| fs::read_to_string(path).is_ok_and(|text| text.contains("clap::")))
        .collect();
    assert!(guilty.is_empty(), "{guilty:#?}");
}
