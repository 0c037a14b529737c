//! What breaks, what stops, what is recorded, by the program as a user runs it.

use assert_cmd::Command;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;
use tempfile::TempDir;

fn pigtail(runs: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::cargo_bin("pigtail")
        .expect("the program")
        .args(arguments)
        .arg("--runs")
        .arg(runs)
        .output()
        .expect("it runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code().unwrap_or(-1),
        text(&output.stdout),
        text(&output.stderr),
    )
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("one JSON document")
}

/// Folders of runs, those that were cut short too.
fn folders(runs: &Path) -> Vec<PathBuf> {
    let mut folders: Vec<_> = std::fs::read_dir(runs)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.is_dir())
        .collect();
    folders.sort();
    folders
}

#[test]
fn a_fault_stops_the_machine_with_its_name_and_exit_code() {
    let runs = TempDir::new().expect("a folder");
    let arguments = ["align", "--json", "--fault", "encoder-stuck:left.z@0.5s"];
    let (code, out, _) = pigtail(runs.path(), &arguments);
    assert_eq!(code, 3);
    let document = json(&out);
    assert_eq!(document["injected"][0], "encoder-stuck:left.z@0.5s");
    assert_eq!(document["fault"]["axis"], "left.z");
    assert_eq!(document["fibers"][0]["outcome"], "fault");
    assert_eq!(document["collision"], false);
    let time = document["fault"]["time"].as_f64().expect("a time");
    assert!((0.5..0.6).contains(&time), "{time}");
    let (code, out, _) = pigtail(runs.path(), &["runs", "list", "--json", "--state", "fault"]);
    assert_eq!(code, 0);
    assert!(out.contains("fault"), "{out}");
}

#[test]
fn a_fault_that_there_is_not_is_bad_input() {
    let runs = TempDir::new().expect("a folder");
    for (arguments, told) in [
        (["align", "--fault", "melt@1s"], "belt-slip"),
        (["align", "--fault", "laser-off"], "@TIME"),
        (["align", "--faults", "everything"], "or all"),
    ] {
        let (code, _, err) = pigtail(runs.path(), &arguments);
        assert_eq!(code, 2, "{arguments:?}");
        assert!(err.contains(told), "{arguments:?}: {err}");
    }
    // A question is no mistake.
    let (code, out, _) = pigtail(runs.path(), &["align", "--fault", "help"]);
    assert_eq!(code, 0);
    assert!(out.contains("servo-overrun"), "{out}");
    assert!(folders(runs.path()).is_empty());
}

/// Devices into each of which one fault is put; the rules that stopped some of them.
fn whatever_breaks(devices: &str) -> usize {
    let runs = TempDir::new().expect("a folder");
    let arguments = [
        "campaign",
        "--devices",
        devices,
        "--seed",
        "900000",
        "--faults",
        "all",
        "--json",
    ];
    let (code, out, err) = pigtail(runs.path(), &arguments);
    assert_eq!(code, 0, "{err}");
    let document = json(&out);
    for key in ["collisions", "panics", "hangs", "false_aligned"] {
        assert_eq!(document[key], 0, "{key}");
    }
    assert_eq!(document["faults"], "all");
    document["tripped"].as_object().expect("rules").len()
}

#[test]
fn ten_faults_touch_nothing_and_are_not_wrongly_believed() {
    assert!(whatever_breaks("10") >= 2);
}

#[test]
#[ignore = "long: 150 devices"]
fn whatever_breaks_nothing_is_touched_and_nothing_wrongly_believed() {
    assert!(whatever_breaks("150") >= 5);
}

/// Start and end of a phase of a fiber (0 is the input) when nothing breaks, seconds.
fn phase(runs: &Path, seed: &str, fiber: usize, name: &str) -> (f64, f64) {
    let (_, out, _) = pigtail(runs, &["align", "--json", "--no-record", "--seed", seed]);
    let mut from = 0.0;
    for (i, aligned) in json(&out)["fibers"]
        .as_array()
        .expect("some")
        .iter()
        .enumerate()
    {
        for phase in aligned["phases"].as_array().expect("some") {
            let to = from + phase["seconds"].as_f64().expect("a time");
            if i == fiber && phase["name"] == name {
                return (from, to);
            }
            from = to;
        }
    }
    panic!("no phase {name}");
}

/// What becomes of a machine in which this breaks at `time` seconds.
fn broken(runs: &Path, seed: &str, fault: &str, time: f64) -> Value {
    let fault = format!("{fault}@{time:.4}s");
    let arguments = [
        "align",
        "--json",
        "--no-record",
        "--seed",
        seed,
        "--fault",
        &fault,
    ];
    json(&pigtail(runs, &arguments).1)
}

#[test]
#[ignore = "long: a device for every 3 ms of the approach"]
fn a_servo_that_is_late_on_the_approach_touches_nothing() {
    let runs = TempDir::new().expect("a folder");
    let (from, to) = phase(runs.path(), "71", 0, "approach");
    let mut time = from + 0.01;
    while time < to {
        let document = broken(runs.path(), "71", "servo-overrun", time);
        assert_eq!(document["fault"]["rule"], "servo keeps its time");
        assert_eq!(document["collision"], false, "late at {time} s");
        time += 3e-3;
    }
}

#[test]
#[ignore = "long: 48 devices"]
fn a_piezo_that_breaks_as_the_fiber_is_attached_is_not_believed() {
    let runs = TempDir::new().expect("a folder");
    let mut slipped = 0;
    // The first shows in the light once the fiber stands; the others are small, and only the last,
    // small circle finds the peak elsewhere.
    for (seed, fiber, lost) in [
        ("72", 0, "left.micro1:0.2"),
        ("76", 2, "right.micro2:0.92"),
        ("79", 1, "right.micro1:0.92"),
    ] {
        let (_, end) = phase(runs.path(), seed, fiber, "final");
        for k in 0..16 {
            let time = end - 2e-3 * f64::from(k);
            let fault = format!("piezo-depolarised:{lost}");
            let document = broken(runs.path(), seed, &fault, time);
            let fiber = &document["fibers"][fiber];
            let aligned = fiber["outcome"] == "aligned";
            slipped += u32::from(fiber["outcome"] == "slipped");
            // A piezo that gives way in the last moments by some tenths of a micrometre, which costs half a percent of the light, is seen
            // by that only beyond the noise: a fiber may be fixed as far off as this, um. How many of these faults come to it is by where
            // the micro happened to stand: a share of that is what is lost. (Before micros glided aside, which changes where that is, none of
            // these 48 but one was to be outside at all, by 0.15 along each axis at most; of 272 on eight seeds eight were, by up to 0.34,
            // and since then 14, by up to 0.25.)
            let off = |axis: &str| fiber["offset_um"][axis].as_f64().unwrap_or(0.0);
            let nearly = off("x").hypot(off("y")) < 0.3;
            let within = fiber["within_tolerance"] == true;
            assert!(!aligned || within || nearly, "{fiber}");
        }
    }
    assert!(slipped > 0);
}

/// A bond that sets long after light was last sampled would fix a fiber that gives way unseen: once it is fixed its light stays.
#[test]
#[ignore = "long: 36 devices"]
fn a_piezo_that_breaks_in_the_last_moments_of_a_bond_is_not_believed() {
    let runs = TempDir::new().expect("a folder");
    let (mut slipped, mut aligned) = (0, 0);
    for (seed, fiber, lost) in [
        ("9101", 0, "left.micro2"),
        ("9102", 0, "left.micro2"),
        ("3600905", 1, "right.micro2"),
    ] {
        let fault = format!("piezo-depolarised:{lost}");
        let (_, end) = phase(runs.path(), seed, fiber, "final");
        for k in 0..12 {
            // From the cycles after a bond, in which nothing is lost any more, back into it.
            let time = end - 6.4e-3 - 0.4e-3 * f64::from(k);
            let document = broken(runs.path(), seed, &fault, time);
            let fiber = &document["fibers"][fiber];
            if fiber["outcome"] == "aligned" {
                aligned += 1;
                assert_eq!(fiber["within_tolerance"], true, "{seed} {time}: {fiber}");
            } else {
                slipped += u32::from(fiber["outcome"] == "slipped");
            }
        }
    }
    assert!(aligned > 0 && slipped > 0, "{aligned} {slipped}");
}

/// A photodiode that hums sees a peak somewhere in each turn. While circles corrected what they saw before they asked whether it was in their
/// middle, one was followed to 95 um beside its port, where the facet stands out, and into the chip.
#[test]
fn a_hum_is_not_followed_into_the_chip() {
    let runs = TempDir::new().expect("a folder");
    let drawn = ["--fleet", "workshop", "--seed", "53000226"];
    let fault = ["--fault", "photodiode-hum:output1:100mV@1.598s"];
    let arguments = [&["align", "--json", "--no-record"][..], &drawn, &fault].concat();
    let (_, out, _) = pigtail(runs.path(), &arguments);
    let document = json(&out);
    assert_eq!(document["collision"], false, "{document}");
    for fiber in document["fibers"].as_array().expect("fibers") {
        assert_ne!(fiber["within_tolerance"], false, "{fiber}");
    }
}

/// An encoder that stops counting while its axis is on its way has the servo push on: a joint went hundreds of micrometres across before a
/// fiber near the chip, to where the facet stands out, and a z-stage a micrometre into it, before outputs were as far from their motors as
/// transmissions may hide. The distance from the chip is that of outputs.
#[test]
fn an_encoder_that_sticks_on_the_way_drives_nothing_into_the_chip() {
    let runs = TempDir::new().expect("a folder");
    for (seed, fault) in [
        ("76002462", "encoder-stuck:left.a@2.768s"),
        ("76005864", "encoder-stuck:left.a@1.459s"),
        ("78001490", "encoder-stuck:left.z@2.909s"),
        ("78003298", "encoder-stuck:left.z@1.81s"),
        // Within 77 um of a port's light, where the guard takes a fiber to be in it: the output went on while its motor stood.
        ("79002786", "encoder-stuck:right.a@2.11s"),
    ] {
        let drawn = ["--fleet", "workshop", "--seed", seed, "--fault", fault];
        let arguments = [&["align", "--json", "--no-record"][..], &drawn].concat();
        let (_, out, _) = pigtail(runs.path(), &arguments);
        let document = json(&out);
        let fiber = &document["fibers"][0];
        assert_eq!(fiber["outcome"], "fault", "{seed}: {document}");
        assert_eq!(document["collision"], false, "{seed}: {document}");
    }
}

/// At the end of its voltage a piezo no longer moves its fiber, and light that does not change looks
/// like a peak: where the model says it ends it is out of reach, and not where the datasheet does.
#[test]
fn a_piezo_at_the_end_of_its_range_is_not_believed() {
    let runs = TempDir::new().expect("a folder");
    for seed in ["17700544", "17703782"] {
        let arguments = ["align", "--json", "--no-record", "--seed", seed];
        let faults = ["--faults", "piezo-depolarised"];
        let (code, out, _) = pigtail(runs.path(), &[&arguments[..], &faults].concat());
        let input = &json(&out)["fibers"][0];
        // Its stroke may have been learned in time: then it is where it is believed to be.
        if input["outcome"] == "aligned" {
            assert_eq!(
                (code, &input["within_tolerance"]),
                (0, &true.into()),
                "{input}"
            );
            assert!(input["micro_strokes"].is_array(), "{input}");
            continue;
        }
        assert_eq!(code, 1);
        // What the last of its tries found, each of which is right: also that light around a piezo that stands is not that
        // around a peak.
        let outcome = input["outcome"].as_str().expect("a name");
        assert!(
            ["out_of_reach", "light_lost", "misshapen"].contains(&outcome),
            "{seed}: {input}"
        );
    }
}

#[test]
fn a_run_is_replayed_to_the_last_bit_and_a_damaged_record_is_named() {
    let runs = TempDir::new().expect("a folder");
    for more in [&["--seed", "3"][..], &["--faults", "all", "--seed", "5"]] {
        let arguments: Vec<_> = ["align"].iter().chain(more).copied().collect();
        pigtail(runs.path(), &arguments);
    }
    for folder in folders(runs.path()) {
        let name = folder
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let (code, out, err) = pigtail(runs.path(), &["runs", "replay", &name, "--json"]);
        assert_eq!(code, 0, "{out}{err}");
        let document = json(&out);
        assert_eq!(document["same"], true);
        assert!(document["exchanges"].as_u64().expect("a number") > 100);
    }
    let folder = &folders(runs.path())[0];
    let record = folder.join("exchanges.pigtail");
    let changed = runs.path().join("changed.pigtail");
    let mut bytes = std::fs::read(&record).expect("a record");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&changed, &bytes).expect("a file");
    let path = changed.display().to_string();
    let (code, _, err) = pigtail(runs.path(), &["runs", "replay", &path]);
    assert_eq!(code, 2);
    assert!(err.contains("is damaged"), "{err}");
    std::fs::write(&changed, b"no record").expect("a file");
    let (code, _, err) = pigtail(runs.path(), &["runs", "replay", &path]);
    assert_eq!((code, err.contains("is no record")), (2, true), "{err}");
    let (code, ..) = pigtail(runs.path(), &["runs", "replay", "nothing"]);
    assert_eq!(code, 2);
}

/// The program at the clock's pace, killed or asked to stop after so long.
#[cfg(unix)]
fn interrupted(runs: &Path, signal: &str, milliseconds: u64) -> Option<i32> {
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("pigtail"))
        .args(["align", "--real-time", "--runs"])
        .arg(runs)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("it runs");
    std::thread::sleep(Duration::from_millis(milliseconds));
    std::process::Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status()
        .expect("kill");
    child.wait().expect("it ends").code()
}

#[cfg(unix)]
#[test]
#[ignore = "long: processes at the clock's pace"]
fn ctrl_c_stops_the_machine_and_leaves_a_record() {
    let runs = TempDir::new().expect("a folder");
    assert_eq!(interrupted(runs.path(), "-INT", 900), Some(3));
    assert_eq!(interrupted(runs.path(), "-TERM", 600), Some(3));
    for folder in folders(runs.path()) {
        let summary = std::fs::read_to_string(folder.join("summary.json")).expect("a summary");
        assert_eq!(json(&summary)["fault"]["rule"], "nobody asks to stop");
        let name = folder
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let (code, out, err) = pigtail(runs.path(), &["runs", "replay", &name, "--json"]);
        assert_eq!(code, 0, "{out}{err}");
        assert_eq!(json(&out)["cut"], false);
    }
}

/// What is left of a run that was killed after so long, at the clock's pace, seconds.
#[cfg(unix)]
fn left_of_killed(milliseconds: u64) -> f64 {
    let runs = TempDir::new().expect("a folder");
    assert_eq!(interrupted(runs.path(), "-KILL", milliseconds), None);
    let folder = folders(runs.path()).pop().expect("what is left");
    let record = folder.join("exchanges.pigtail").display().to_string();
    let (code, out, err) = pigtail(runs.path(), &["runs", "replay", &record, "--json"]);
    assert_eq!(code, 0, "{out}{err}");
    let document = json(&out);
    assert_eq!(document["same"], true);
    document["seconds"].as_f64().expect("a number")
}

#[cfg(unix)]
#[test]
#[ignore = "long: a process at the clock's pace"]
fn a_killed_run_loses_at_most_its_last_second() {
    let seconds = left_of_killed(1500);
    // The program itself takes a moment to begin.
    assert!(seconds > 0.4, "{seconds}");
}

/// What CI has no time for.
#[cfg(unix)]
mod acceptance {
    use super::*;

    /// A hundred kills at all kinds of moments: two minutes.
    #[test]
    #[ignore = "takes minutes: .ci/acceptance kills"]
    fn a_hundred_killed_runs_lose_at_most_their_last_second() {
        for k in 0..100_u64 {
            let milliseconds = 1100 + k * 37 % 1500;
            let late = milliseconds as f64 * 1e-3 - left_of_killed(milliseconds);
            assert!(
                late < 1.1,
                "killed after {milliseconds} ms: {late} s are lost"
            );
        }
    }
}
