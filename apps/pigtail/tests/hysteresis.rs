//! `pigtail identify hysteresis` and `pigtail predict`: on the machine, and on records that are none. A measured
//! record is in `measured`.

use assert_cmd::Command;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

fn pigtail(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder)
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

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let (code, out, error) = pigtail(folder, arguments);
    assert_eq!(code, Some(0), "{error}");
    serde_json::from_str(&out).expect("one JSON document")
}

/// A loop with some hysteresis, one row changed.
fn record(rows: usize, change: impl Fn(usize, &mut [String; 3])) -> String {
    let mut csv = "t_s,u_V,disp_um\n".to_owned();
    for k in 0..rows {
        let phase = 0.05 * k as f64;
        let mut row = [
            format!("{}", 0.01 * k as f64),
            format!("{}", 5.0 - 5.0 * phase.cos()),
            format!("{}", 30.0 - 30.0 * (phase - 0.1).cos()),
        ];
        change(k, &mut row);
        let _ = writeln!(csv, "{}", row.join(","));
    }
    csv
}

fn refused(csv: &str, extra: &[&str]) -> String {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("r.csv"), csv).expect("a file");
    let mut arguments = vec!["identify", "hysteresis", "--data", "r.csv"];
    if !extra.contains(&"--input") {
        arguments.extend(["--input", "u_V", "--output", "disp_um"]);
    }
    arguments.extend(extra);
    let (code, out, error) = pigtail(folder.path(), &arguments);
    assert_eq!(code, Some(2), "{out}{error}");
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(
        !folder.path().join("runs").exists(),
        "nothing is half-written"
    );
    error
}

#[test]
fn a_record_that_says_nothing_is_refused_by_file_column_and_reason() {
    let good = |rows| record(rows, |_, _| {});
    for (csv, extra, parts) in [
        (
            good(500),
            &["--input", "volts", "--output", "disp_um"][..],
            &["r.csv", "volts", "there are t_s, u_V, disp_um"][..],
        ),
        (
            record(500, |_, row| row[1] = "3".to_owned()),
            &[],
            &["u_V", "3 in every sample"][..],
        ),
        (
            record(500, |_, row| row[2] = "3".to_owned()),
            &[],
            &["disp_um", "3 in every sample"][..],
        ),
        (
            record(500, |k, row| {
                if k == 7 {
                    row[1] = "high".to_owned();
                }
            }),
            &[],
            &["line 9", "u_V", "\"high\"", "finite number"][..],
        ),
        (
            record(500, |k, row| {
                if k == 7 {
                    row[0] = "0".to_owned();
                }
            }),
            &[],
            &["t_s", "0 s comes after 0.06 s in data row 8", "rises"][..],
        ),
        (good(40), &[], &["40 samples", "at least 100"][..]),
        (
            record(500, |k, row| row[1] = format!("{k}")),
            &[],
            &["u_V", "never turns", "forward and back"][..],
        ),
        (
            good(500),
            &["--time", "clock"],
            &["clock", "there are t_s"][..],
        ),
        (
            "t_s,u_V,disp_um\n1,2\n".to_owned(),
            &[],
            &["line 2", "2 fields", "3"][..],
        ),
        (
            record(500, |_, row| row[2] = format!("-{}", row[1])),
            &[],
            &["disp_um", "falls where", "grows with voltage"][..],
        ),
    ] {
        let error = refused(&csv, extra);
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    }
}

#[test]
fn a_file_that_is_no_model_is_refused() {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("r.csv"), record(500, |_, _| {})).expect("a file");
    for (text, part) in [
        ("{\"model\": 3}", "accepted is a model.json"),
        ("", "accepted is a model.json"),
    ] {
        fs::write(folder.path().join("m.json"), text).expect("a file");
        let arguments = ["predict", "--model", "m.json", "--data", "r.csv"];
        let (code, _, error) = pigtail(folder.path(), &arguments);
        assert_eq!(code, Some(2));
        assert!(error.contains("m.json") && error.contains(part), "{error}");
    }
    let arguments = ["predict", "--model", "none.json", "--data", "r.csv"];
    let (code, _, error) = pigtail(folder.path(), &arguments);
    assert_eq!(code, Some(2));
    assert!(error.contains("none.json"), "{error}");
}

const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm");

/// The model goes into the calibration and beside it, is read back, and spoilt it is refused.
#[test]
fn what_is_identified_on_the_machine_is_believed_from_then_on() {
    let folder = TempDir::new().expect("a folder");
    let rig = folder.path().join("rig");
    fs::create_dir(&rig).expect("a rig");
    for name in ["machine.toml", "plant.toml", "calibration.toml"] {
        fs::copy(Path::new(RIG).join(name), rig.join(name)).expect("a copy");
    }
    let command = [
        "identify",
        "hysteresis",
        "--rig",
        "rig",
        "--seed",
        "21",
        "--json",
        "--write",
    ];
    let found = json(folder.path(), &command);
    for key in [
        "model",
        "rms_um",
        "max_um",
        "range_um",
        "percent_of_range",
        "uncompensated_percent",
        "improvement",
        "functions",
    ] {
        assert!(!found[key].is_null(), "{key}");
    }
    // Above are the keys of the micro that gained least.
    let sides = found["sides"].as_array().expect("sides");
    let gain = |document: &serde_json::Value| document["improvement"].as_f64().expect("a number");
    assert_eq!(sides.len(), 2);
    assert_eq!(gain(&found), gain(&sides[0]).min(gain(&sides[1])));
    let text = fs::read_to_string(rig.join("calibration.toml")).expect("a calibration");
    let run = format!(
        "identify hysteresis, run {}",
        found["report"]
            .as_str()
            .expect("a path")
            .split('/')
            .nth(1)
            .expect("a run")
    );
    for (side, document) in ["left", "right"].into_iter().zip(sides) {
        assert_eq!(document["side"], side);
        assert!(text.contains(&format!("[hysteresis.{side}]")));
        assert!(text.contains(&format!("hysteresis-{side}-")));
    }
    assert_eq!(text.matches(&run).count(), 2, "{text}");
    assert!(!text.contains("piezos"), "what stood there before: {text}");
    let report = found["report"].as_str().expect("a path");
    let html = fs::read_to_string(folder.path().join(report)).expect("a report");
    assert_eq!(
        html.matches("class=\"chart ").count(),
        2 * 8,
        "Figs. 4.3, 4.4 and 4.6 to 4.10 of each side"
    );
    let align = ["align", "--rig", "rig", "--seed", "21", "--json"];
    let aligned = json(folder.path(), &align);
    for fiber in aligned["fibers"].as_array().expect("fibers") {
        assert_eq!(fiber["outcome"], "aligned");
    }
    let from = text.find("hysteresis-right-").expect("weights");
    let name = text[from..].split('"').next().expect("a name").to_owned();
    let weights = rig.join(&name);
    let text = fs::read_to_string(&weights).expect("weights");
    for (from, to, part) in [
        ("\"ratio\": 1.", "\"ratio\": 7.", "0.5 to 2"),
        ("\"memory\"", "\"memories\"", "hysteresis-right-"),
    ] {
        assert!(text.contains(from));
        fs::write(&weights, text.replacen(from, to, 1)).expect("a file");
        let (code, _, error) = pigtail(folder.path(), &align);
        assert_eq!(code, Some(2));
        assert!(
            error.contains("hysteresis-right-") && error.contains(part),
            "{error}"
        );
    }
    fs::remove_file(&weights).expect("a file");
    let (code, _, error) = pigtail(folder.path(), &align);
    assert_eq!(code, Some(2));
    assert!(error.contains("hysteresis-right-"), "{error}");
}
