//! `pigtail reproduce`: the list of claims, cheap figures, and that it notices what is wrong.

use assert_cmd::Command;
use pigtail_reproduce::claims::{Claim, Kind, all};
use pigtail_reproduce::{experiments, select};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm");

fn reproduce(folder: &Path, threads: &str, arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder)
        .env("RAYON_NUM_THREADS", threads)
        .arg("reproduce")
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// The folders of runs: the store of runs lies beside them.
fn runs(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder.join("runs")) else {
        return Vec::new();
    };
    let paths = entries.map(|entry| entry.expect("an entry").path());
    paths.filter(|path| path.is_dir()).collect()
}

fn document(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("one JSON document")
}

#[test]
fn every_claim_is_one_of_a_kind_and_belongs_to_a_figure_that_is_made() {
    let figures: BTreeSet<&str> = experiments().flat_map(|e| e.figures).copied().collect();
    let ids: BTreeSet<&str> = all().map(|c| c.id).collect();
    assert_eq!(ids.len(), all().count(), "ids are unique");
    assert!(ids.len() >= 120, "{}", ids.len());
    for claim in all() {
        assert!(figures.contains(claim.figure()), "{}", claim.id);
        assert!(!claim.quote.is_empty() && !claim.section.is_empty());
        assert!(!claim.kind.tolerance().is_empty() && !claim.kind.reason().is_empty());
        // What is printed is itself near enough, but for a bound, which is no result.
        let bound = matches!(claim.kind, Kind::Below | Kind::Above);
        assert_eq!(claim.kind.holds(claim.thesis, claim.thesis), !bound);
        for (instead, _) in [claim.cause, claim.on_others].into_iter().flatten() {
            assert!(
                !claim.kind.holds(claim.thesis, instead),
                "{} holds: it needs no cause",
                claim.id
            );
        }
    }
}

#[test]
fn a_claim_without_a_result_or_with_another_than_the_known_one_is_not_explained() {
    let claim = all()
        .find(|c| c.cause.is_some())
        .expect("one that does not hold");
    let (instead, _) = claim.cause.expect("a cause");
    let with = |ours| Claim::new(claim, ours, "", false);
    assert!(with(Some(instead)).explained);
    assert!(!with(Some(3.0 * instead)).explained);
    assert!(!with(None).holds && !with(None).explained);
    assert!(!with(Some(f64::NAN)).holds && !with(Some(f64::NAN)).explained);
    // What is known of specimens explains nothing of the thesis's machine.
    let claim = all()
        .find(|c| c.on_others.is_some())
        .expect("one that holds on some specimens");
    let (instead, _) = claim.on_others.expect("a cause");
    assert!(Claim::new(claim, Some(instead), "", true).explained);
    assert!(!Claim::new(claim, Some(instead), "", false).explained);
}

#[test]
fn figures_chapters_and_everything_can_be_named() {
    let names = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
        select(&names)
    };
    assert_eq!(names(&["4.20"]).expect("a figure"), ["4.20"]);
    let three = names(&["3"]).expect("a chapter");
    assert_eq!(three, ["3.2", "3.3", "3.4", "3.5", "budget"]);
    // Figs. 2.2 to 2.26, 3.2 to 3.5 with the times of 3.4, 4.3 to 4.24.
    assert_eq!(names(&[]).expect("everything").len(), 25 + 5 + 22);
    assert!(names(&["2.27"]).is_err());
}

#[test]
fn cheap_figures_leave_one_document_and_one_report_whatever_the_threads() {
    let folder = TempDir::new().expect("a folder");
    let names = ["2.16", "2.26", "2.8", "4.15", "--quick", "--json"];
    let one = reproduce(folder.path(), "1", &names);
    let two = reproduce(folder.path(), "2", &names);
    assert_eq!(one.status.code(), Some(0), "{one:?}");
    assert!(one.stderr.is_empty(), "quiet when not a terminal");
    let (mut one, mut two) = (document(&one), document(&two));
    assert!(one["seconds"].as_f64().expect("seconds") > 0.0);
    for d in [&mut one, &mut two] {
        d["seconds"] = Value::Null;
    }
    assert_eq!(one, two);
    let claims = one["claims"].as_array().expect("claims");
    let held = claims.iter().filter(|c| c["holds"] == true).count();
    assert_eq!(one["held"], held);
    assert_eq!(one["of"], claims.len());
    for claim in claims {
        for key in ["id", "quantity", "unit", "tolerance", "note"] {
            assert!(claim[key].is_string(), "{key}");
        }
        assert!(
            claim["thesis"].is_f64() && claim["ours"].is_f64(),
            "{claim}"
        );
        assert!(claim["calibrated"].is_boolean());
    }
    // In the order of the thesis, not of the command line.
    assert_eq!(claims[0]["id"], "2.8-windup");
    let runs = runs(folder.path());
    assert_eq!(runs.len(), 2);
    let html = fs::read_to_string(runs[0].join("report.html")).expect("a report");
    assert_eq!(html.matches("class=\"chart ").count(), 5);
    assert!(
        !html.contains("src=") && !html.contains("href=\"http"),
        "self-contained"
    );
    assert!(html.contains("(2.23): the subscripts are exchanged"));
}

#[test]
fn claims_are_counted_by_what_they_rest_on_and_on_drawn_machines_whatever_the_threads() {
    let folder = TempDir::new().expect("a folder");
    let names = ["2.8", "2.16", "2.26", "4.15", "--quick", "--specimens", "2"];
    let run = |threads: &str| {
        let arguments = [&names[..], &["--seed", "3", "--json"]].concat();
        let output = reproduce(folder.path(), threads, &arguments);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let mut d = document(&output);
        d["seconds"] = Value::Null;
        d
    };
    let d = run("1");
    assert_eq!(d, run("2"));
    let a = &d["accounts"];
    let number = |value: &Value| value.as_u64().expect("a number");
    let groups = ["predictions", "calibrated", "definitions"];
    for (key, all) in [("hold", "held"), ("of", "of")] {
        let sum: u64 = groups.iter().map(|group| number(&a[group][key])).sum();
        assert_eq!(sum, number(&d[all]));
        let sum = number(&a["predictions"][key]) + number(&a["definitions"][key]);
        let before = if key == "of" {
            "of_predicted"
        } else {
            "predicted"
        };
        assert_eq!(
            sum,
            number(&d[before]),
            "the keys of old mean what they meant"
        );
        for part in ["predictions_unchanged", "calibrated_in_doubt", "changed"] {
            assert!(a[part][key].is_u64(), "{part}");
        }
    }
    assert!(a["withdrawn"].is_array());
    let claims = d["claims"].as_array().expect("claims");
    for claim in claims {
        let basis = claim["basis"].as_str().expect("a basis");
        assert_eq!(claim["fitted"].is_string(), basis == "calibrated");
        assert_eq!(claim["by_construction"].is_string(), basis == "definition");
        assert!(claim["in_doubt"].is_boolean() && claim["changes"].is_array());
    }
    let changes = a["changed_after_result"].as_array().expect("changes");
    assert!(!changes.is_empty());
    for change in changes {
        for key in ["claim", "date", "commit", "what", "from", "to", "why"] {
            assert!(change[key].is_string(), "{key}");
        }
        for when in ["before", "after"] {
            let result = &change[when];
            assert!(result["ours"].is_f64() && result["holds"].is_boolean());
        }
    }
    let specimens = &d["specimens"];
    assert_eq!(specimens["seeds"], serde_json::json!([3, 1003]));
    assert!(specimens["ended"].as_array().expect("a list").is_empty());
    let drawn = specimens["claims"].as_array().expect("claims");
    assert_eq!(drawn.len(), claims.len());
    for claim in drawn {
        let stays = ["2.26-least", "2.26-greatest", "4.15"];
        let id = claim["id"].as_str().expect("an id");
        let stays = stays.iter().any(|of| id.starts_with(of));
        assert_eq!(claim["not_drawn"].is_string(), stays, "{id}");
        assert_eq!(claim["held"].is_null(), stays, "{id}");
        assert_eq!(number(&claim["of"]), if stays { 0 } else { 2 }, "{id}");
    }
    let tally = &specimens["accounts"];
    let judged: u64 = groups.iter().map(|group| number(&tally[group]["of"])).sum();
    assert_eq!(judged, drawn.iter().map(|c| number(&c["of"])).sum::<u64>());
    // The first is the one that the same seed draws by itself.
    let one = document(&reproduce(
        folder.path(),
        "1",
        &["2.8", "--quick", "--specimen", "--seed", "3", "--json"],
    ));
    let windup = &one["claims"][0]["ours"];
    assert!(windup == &drawn[0]["least"] || windup == &drawn[0]["most"]);
}

#[test]
fn the_account_fits_a_terminal() {
    let folder = TempDir::new().expect("a folder");
    let names = ["2.26", "2.8", "--quick", "--specimens", "1"];
    let output = reproduce(folder.path(), "2", &names);
    let text = String::from_utf8(output.stdout).expect("text");
    for line in text.lines().filter(|line| !line.starts_with("Report: ")) {
        assert!(line.chars().count() <= 80, "{line}");
    }
    for part in [
        "predictions hold",
        "Changed after a result",
        "one drawn machine",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let output = reproduce(folder.path(), "1", &["2.8", "--specimens", "0"]);
    assert_eq!(output.status.code(), Some(2));
}

/// A copy of the rig with something else in its plant.
fn changed(folder: &Path, from: &str, to: &str) {
    let rig = folder.join("rig");
    fs::create_dir(&rig).expect("a folder");
    let mut found = 0;
    for file in ["machine.toml", "plant.toml", "calibration.toml"] {
        let text = fs::read_to_string(Path::new(RIG).join(file)).expect("the rig");
        found += text.matches(from).count();
        fs::write(rig.join(file), text.replacen(from, to, 1)).expect("written");
    }
    assert!(found > 0, "{from}");
}

#[test]
fn a_machine_with_other_physics_is_noticed() {
    let folder = TempDir::new().expect("a folder");
    changed(
        folder.path(),
        "cubic = \"8.94e6 N m/rad3\"",
        "cubic = \"0 N m/rad3\"",
    );
    let output = reproduce(folder.path(), "2", &["2.8", "--rig", "rig", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let d = document(&output);
    let windup = &d["claims"][0];
    assert_eq!(windup["id"], "2.8-windup");
    assert_eq!(windup["holds"], false);
    assert_eq!(windup["explained"], false);
}

#[test]
#[ignore = "long: figures in full"]
fn what_the_thesis_measured_is_measured_on_the_machine_that_measured_toml_makes_of_the_rig() {
    let folder = TempDir::new().expect("a folder");
    changed(folder.path(), "25 mm", "25 mm");
    let measured = folder.path().join("rig/measured.toml");
    let write = |text: &str| fs::write(&measured, text).expect("written");
    write("[plant.five_bar.joint]\ntransmission.cubic = \"0 N m/rad3\"\n");
    let names = ["2.8", "2.9", "--rig", "rig", "--json"];
    let d = document(&reproduce(folder.path(), "2", &names));
    let holds = |id: &str| {
        let claims = d["claims"].as_array().expect("claims");
        claims.iter().find(|c| c["id"] == id).expect("the claim")["holds"].clone()
    };
    assert_eq!(
        holds("2.8-windup"),
        false,
        "a softer machine winds up further"
    );
    assert_eq!(holds("2.9-linear"), true, "the model is as it was");
    // Stiffness with a bound makes preloads level off, as the thesis holds of its machine.
    write(
        "[plant.five_bar.joint.transmission]\nlinear = \"34 N m/rad\"\ncubic = \"1.8e7 N m/rad3\"\nbound = 3.5\n",
    );
    let levelled = document(&reproduce(
        folder.path(),
        "2",
        &["2.13", "--rig", "rig", "--json"],
    ));
    assert_eq!(levelled["held"], levelled["of"], "{levelled}");
    for (text, named) in [
        ("[plant", "measured.toml"),
        ("[plants]\nx = 1", "accepted is plant or calibration"),
        ("[plant.five_bar.joint.transmission]\nbound = 0.5", "bound"),
        (
            "[calibration.geometry.five_bar]\ndistal = \"3 kg\"",
            "distal",
        ),
    ] {
        write(text);
        let output = reproduce(folder.path(), "1", &names);
        assert_eq!(output.status.code(), Some(2), "{text}");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(
            error.contains("measured.toml") && error.contains(named),
            "{error}"
        );
    }
}

#[test]
fn a_rig_under_another_law_of_friction_has_a_machine_without_any() {
    let folder = TempDir::new().expect("a folder");
    // The first is that of the five-bar.
    changed(
        folder.path(),
        "friction = \"coulomb-presliding\"",
        "friction = \"maxwell-slip\"",
    );
    let output = reproduce(folder.path(), "2", &["2.10", "--rig", "rig", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert_eq!(document(&output)["claims"][0]["id"], "2.10-factor");
}

#[test]
fn what_is_no_figure_is_refused_with_what_is_accepted() {
    let folder = TempDir::new().expect("a folder");
    for name in ["2.27", "5", "fig2.8", "2."] {
        let output = reproduce(folder.path(), "1", &[name]);
        assert_eq!(output.status.code(), Some(2), "{name}");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(
            text.contains(name) && text.contains("2.2 to 2.26") && text.contains("`budget`"),
            "{text}"
        );
        assert!(output.stdout.is_empty());
    }
    assert!(runs(folder.path()).is_empty(), "nothing is written");
}
