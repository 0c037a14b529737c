//! `pigtail simulate joint` against trajectories of an independent code, good to 1e-6 nm. Reads
//! `../shared/oracle`; skips, and says so, where that is missing.

use assert_cmd::Command;
use std::path::{Path, PathBuf};

fn oracle() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/oracle");
    if folder.join("oracle.json").exists() {
        return Some(folder);
    }
    eprintln!("skipped: no reference trajectories in {}", folder.display());
    None
}

fn rows(text: &str) -> Vec<Vec<String>> {
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect()
}

/// Compares outputs within `bound` metres, and voltages, modes and counts.
fn agrees(reference: &str, arguments: &[&str], bound: f64) {
    let Some(folder) = oracle() else { return };
    let parameters = folder.join("oracle.json");
    let output = Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .args(["simulate", "joint", "--params"])
        .arg(&parameters)
        .args(arguments)
        .output()
        .expect("the program starts");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let ours = rows(&String::from_utf8(output.stdout).expect("UTF-8"));
    let text = std::fs::read_to_string(folder.join(reference)).expect("a trajectory");
    let theirs = rows(&text);
    assert_eq!(ours.len(), theirs.len());
    for (a, b) in ours.iter().zip(&theirs) {
        let number = |row: &[String], i: usize| row[i].parse::<f64>().expect("a number");
        assert!((number(a, 0) - number(b, 0)).abs() < 1e-12, "{a:?}");
        assert!(
            (number(a, 1) - number(b, 1)).abs() < 1e-9,
            "{a:?} for {b:?}"
        );
        assert!(
            (number(a, 6) - number(b, 6)).abs() < bound,
            "{a:?} for {b:?}"
        );
        assert_eq!(a[7..], b[7..], "modes and counts at {}", a[0]);
    }
}

#[test]
fn an_impulse_on_the_z_stage_to_a_thousandth_of_a_nanometre() {
    let arguments = ["--axis", "z", "--impulse", "1.5,12.5,1e-3"];
    agrees("z_impulse_a1_1.5_a2_12.5.csv", &arguments, 1e-12);
}

#[test]
fn a_step_of_the_five_bar_to_a_tenth_of_a_nanometre() {
    agrees(
        "fb_step_400.csv",
        &["--axis", "fivebar", "--step", "400"],
        1e-10,
    );
}
