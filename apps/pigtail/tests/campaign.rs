//! Campaigns: the same rows whatever happens on the way, and a summary that hides nothing.

use pigtail_control::outcome::OutcomeCode;
use pigtail_control::station::Unobserved;
use pigtail_evaluate::align::align;
use pigtail_evaluate::campaign::shard::{self, Shard};
use pigtail_evaluate::campaign::{self, CampaignDocument, Device, Plan, Store, summarize};
use pigtail_hal::{Fault, Rule};
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use pigtail_store::rows::{Rows, Table};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use tempfile::TempDir;

fn setup() -> Setup {
    Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the default rig is well")
}

fn begin(folder: &TempDir, setup: &Setup, seed: u64, devices: u64) -> Store {
    begin_by(Procedure::Thesis, folder, setup, seed, devices)
}

fn begin_by(by: Procedure, folder: &TempDir, setup: &Setup, seed: u64, devices: u64) -> Store {
    let plan = Plan::new(setup, by, seed, devices);
    Store::begin(folder.path(), plan).expect("a folder")
}

fn run(store: &mut Store, setup: &Setup, threads: usize) {
    campaign::run(store, setup, threads, &AtomicBool::new(false), |_| ()).expect("no error");
}

/// Ends a campaign and returns the bytes of its rows.
fn end(store: &Store) -> Vec<u8> {
    store.collect().expect("whole parts");
    fs::read(store.rows_path()).expect("rows")
}

#[test]
fn one_thread_and_two_give_the_same_bytes() {
    let (setup, folder) = (setup(), TempDir::new().expect("a folder"));
    let bytes = |threads| {
        let mut store = begin_by(Procedure::Fast, &folder, &setup, 90, 7);
        run(&mut store, &setup, threads);
        end(&store)
    };
    let one = bytes(1);
    assert_eq!(one, bytes(2));
    assert_eq!(one, bytes(5));
}

#[test]
fn an_interrupted_campaign_goes_on_to_the_same_bytes() {
    let (setup, folder) = (setup(), TempDir::new().expect("a folder"));
    let mut whole = begin_by(Procedure::Fast, &folder, &setup, 40, 16);
    run(&mut whole, &setup, 2);

    let mut store = begin_by(Procedure::Fast, &folder, &setup, 40, 16);
    let plan = store.plan().clone();
    let run_folder = store.folder().to_owned();
    for threads in [1, 2] {
        let (stop, before) = (AtomicBool::new(false), store.done());
        campaign::run(&mut store, &setup, threads, &stop, |_| {
            stop.store(true, Ordering::Relaxed);
        })
        .expect("no error");
        assert!(
            store.done() > before && store.done() < 16,
            "{}",
            store.done()
        );
        let document = summary_of(&store);
        assert_eq!(document.devices, store.done());
        assert!(!document.complete && !document.is_success());
        let running = Store::resume(&run_folder, &plan).expect_err("it is still held");
        assert!(
            format!("{running:#}").contains("another process"),
            "{running:#}"
        );
        drop(store);
        // What a process that was killed may leave behind.
        fs::write(
            run_folder.join("parts/0000000001-aa.parquet.partial"),
            "PAR1",
        )
        .expect("a file");
        store = Store::resume(&run_folder, &plan).expect("it can go on");
    }
    run(&mut store, &setup, 2);
    assert_eq!(end(&store), end(&whole));
    let document = summary_of(&store);
    assert!(document.complete);
    assert_eq!(summary_of(&whole).rows_sha256, document.rows_sha256);

    // A whole one has one file of rows, and nothing left to be done.
    drop(store);
    assert!(!run_folder.join("parts").exists());
    let again = Store::resume(&run_folder, &plan).expect("it can be summed up again");
    assert_eq!(again.done(), 16);
    assert_eq!(summary_of(&again), document);
    drop(again);
    let rows = run_folder.join("rows.parquet");
    let mut bytes = fs::read(&rows).expect("rows");
    bytes[2000] ^= 1;
    fs::write(&rows, bytes).expect("rows");
    let error = Store::resume(&run_folder, &plan).expect_err("the rows are damaged");
    assert!(
        format!("{error:#}").contains("rows are damaged"),
        "{error:#}"
    );
}

fn summary_of(store: &Store) -> CampaignDocument {
    store.collect().expect("whole parts");
    let document = summarize(store, 0.0).expect("rows");
    store.finish(&document, &document, "").expect("a summary");
    document
}

#[test]
fn damaged_rows_and_another_campaign_are_refused() {
    let (setup, folder) = (setup(), TempDir::new().expect("a folder"));
    let mut store = begin(&folder, &setup, 0, 4);
    let aligned = known(&setup);
    for seed in 0..3 {
        let mut table = store.table();
        push(&mut table, seed, aligned.clone());
        store.append(&table).expect("a part");
    }
    let (plan, run_folder) = (store.plan().clone(), store.folder().to_owned());
    drop(store);
    let refused = |plan: &Plan, parts: &[&str]| {
        let error = Store::resume(&run_folder, plan).expect_err("it is refused");
        let error = format!("{error:#}");
        assert_eq!(error.lines().count(), 1, "{error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    };
    let other = |change: fn(&mut Plan)| {
        let mut plan = plan.clone();
        change(&mut plan);
        plan
    };
    refused(
        &other(|p| p.seed = 1),
        &["seed", "begun with 0", "not with 1"],
    );
    refused(&other(|p| p.devices = 5), &["devices", "accepted is 4"]);
    refused(
        &other(|p| p.procedure = "x".to_owned()),
        &["procedure", "begun with thesis"],
    );
    refused(
        &other(|p| p.configuration[1].1 = "0".repeat(64)),
        &["plant.toml", "SHA-256"],
    );

    let mut parts: Vec<PathBuf> = fs::read_dir(run_folder.join("parts"))
        .expect("parts")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    parts.sort();
    assert_eq!(parts.len(), 3);
    let bytes = fs::read(&parts[1]).expect("a part");
    let mut flipped = bytes.clone();
    flipped[400] ^= 1;
    for spoilt in [&flipped[..], &bytes[..bytes.len() / 2], b""] {
        fs::write(&parts[1], spoilt).expect("a part");
        refused(&plan, &["0000000001-", "damaged", "remove this one"]);
    }
    fs::remove_file(&parts[1]).expect("a part");
    refused(&plan, &["0000000002-", "device 1 should follow"]);
    fs::remove_file(&parts[2]).expect("a part");
    assert_eq!(
        Store::resume(&run_folder, &plan)
            .expect("one is left")
            .done(),
        1
    );
}

/// Some device's alignment, to be put into tables.
fn known(setup: &Setup) -> pigtail_evaluate::align::AlignmentDocument {
    align(setup, Procedure::Thesis, 3, &mut Unobserved).expect("no fault")
}

fn push(table: &mut Table, seed: u64, document: pigtail_evaluate::align::AlignmentDocument) {
    campaign::push(table, Procedure::Thesis, &Device { seed, document });
}

/// The same as far as the machine came before it stopped.
fn stopped(
    mut document: pigtail_evaluate::align::AlignmentDocument,
) -> pigtail_evaluate::align::AlignmentDocument {
    document.fault = Some(Fault {
        rule: Rule::CommandNumber,
        axis: "left.z".to_owned(),
        value: "NaN V".to_owned(),
        limit: "-24 V to 24 V".to_owned(),
        time: 1.0,
    });
    for (fiber, outcome) in document.fibers.iter_mut().zip([
        OutcomeCode::Fault,
        OutcomeCode::NotAttempted,
        OutcomeCode::NotAttempted,
    ]) {
        fiber.outcome = outcome;
        fiber.offset_um = None;
        fiber.within_tolerance = None;
    }
    document
}

#[test]
fn a_wrong_aligned_is_counted_apart_and_every_failure_has_a_seed() {
    let (setup, folder) = (setup(), TempDir::new().expect("a folder"));
    let mut store = begin(&folder, &setup, 100, 5);
    let mut table = store.table();
    let good = known(&setup);
    assert!(good.is_success());
    let mut wrong = good.clone();
    wrong.fibers[1].within_tolerance = Some(false);
    wrong.fibers[1].offset_um.as_mut().expect("attached").x = -3.0;
    let mut touched = good.clone();
    touched.collision = true;
    touched.smallest_gap_um = Some(-0.5);
    let mut dark = setup.clone();
    dark.plant.light.full = 1e-9;
    let dark = known(&dark);
    let fault = stopped(good.clone());
    for (i, document) in [good, wrong, touched, dark, fault].into_iter().enumerate() {
        push(&mut table, 100 + i as u64, document);
    }
    store.append(&table).expect("a part");
    let document = summary_of(&store);
    assert_eq!((document.devices, document.fibers), (5, 15));
    assert_eq!((document.aligned, document.devices_aligned), (5, 1));
    let failed: Vec<_> = document
        .failed
        .iter()
        .map(|(c, n)| (c.as_str(), *n))
        .collect();
    assert_eq!(
        failed,
        [
            ("collision", 3),
            ("fault", 1),
            ("no_light", 1),
            ("not_attempted", 4),
            ("wrong_aligned", 1)
        ]
    );
    assert_eq!(
        (document.wrong.count, &document.wrong.seeds[..]),
        (1, &[101][..])
    );
    assert_eq!(
        (document.collided.count, &document.collided.seeds[..]),
        (1, &[102][..])
    );
    assert_eq!(document.replay["fault"], [104]);
    assert_eq!(document.replay["not_attempted"], [103, 104]);
    assert_eq!(document.tripped["command is a number"], 1);
    assert_eq!((document.collisions, document.false_aligned), (1, 1));
    assert_eq!(document.offset_um.x.max, Some(3.0));
    assert_eq!(document.smallest_gap_um, Some(-0.5));
    assert!(document.complete && !document.is_success());
    let report = pigtail_report::campaign(&store, &document).expect("a report");
    assert!(
        report.contains("1 wrongly believed aligned") && report.contains("1 devices were touched")
    );
    assert_eq!(report.matches("class=\"chart ").count(), 5);
}

fn pigtail(folder: &Path, arguments: &[&str]) -> std::process::Output {
    std::process::Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("the program starts")
}

#[test]
fn the_document_has_its_keys_and_its_rows_replay() {
    let folder = TempDir::new().expect("a folder");
    let arguments = [
        "campaign",
        "--devices",
        "3",
        "--procedure",
        "thesis",
        "--seed",
        "11",
        "--json",
    ];
    let output = pigtail(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stderr.is_empty(), "quiet when not a terminal");
    let document: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    assert_eq!(
        (&document["devices"], &document["fibers"]),
        (&3.into(), &9.into())
    );
    assert_eq!(
        (&document["aligned"], &document["wrong"]["count"]),
        (&9.into(), &0.into())
    );
    assert!(
        document["failed"]
            .as_object()
            .expect("an object")
            .is_empty()
    );
    for (key, names) in [
        ("seconds_per_fiber", &["p50", "p99", "p999", "max"][..]),
        ("offset_um", &["x_p99", "y_p99", "z_p99"]),
        ("coupling_loss_db", &["p50", "p99"]),
    ] {
        for name in names {
            assert!(document[key][name].is_f64(), "{key}.{name}");
        }
    }
    assert!(document["wall_seconds"].is_f64());
    let arms = &document["arms"];
    for side in ["left", "right"] {
        let [moving, idle] = ["moving_percent", "idle_percent"]
            .map(|key| arms[key][side].as_f64().expect("a share"));
        assert!(moving > 1.0 && idle > 1.0 && (moving + idle - 100.0).abs() < 0.02);
        assert!(document["idle_seconds_per_device"][side]["p50"].is_f64());
    }
    let path = folder
        .path()
        .join(document["rows"].as_str().expect("a path"));
    let columns = campaign::columns(Procedure::Thesis).into();
    let rows = Rows::open(&path, &columns).expect("rows");
    assert_eq!(rows.rows(), 9);
    let table = rows.groups(&[]).next().expect("a group").expect("rows");
    assert_eq!(table.wholes("seed"), [11, 11, 11, 12, 12, 12, 13, 13, 13]);
    let [seconds, x, z, loss, gap] = [
        "seconds",
        "offset_x_um",
        "offset_z_um",
        "coupling_loss_db",
        "smallest_gap_um",
    ]
    .map(|name| rows.numbers(name).expect("a column"));
    let phases = ["coarse_s", "raster_s", "climb_s", "approach_s", "final_s"]
        .map(|name| rows.numbers(name).expect("a column"));
    let sensing = rows.numbers("sensing_s").expect("a column");
    assert_eq!(sensing.len(), 3, "of the inputs alone");
    assert!(
        rows.numbers("other_s").expect("a column").is_empty(),
        "every phase has its column"
    );

    let replay = pigtail(
        folder.path(),
        &["align", "--procedure", "thesis", "--seed", "12", "--json"],
    );
    let replay: Value = serde_json::from_slice(&replay.stdout).expect("JSON");
    for (i, fiber) in replay["fibers"]
        .as_array()
        .expect("fibers")
        .iter()
        .enumerate()
    {
        let k = 3 + i;
        assert_eq!(fiber["seconds"], seconds[k]);
        assert_eq!(fiber["offset_um"]["x"], x[k]);
        assert_eq!(fiber["offset_um"]["z"], z[k]);
        assert_eq!(fiber["coupling_loss_db"], loss[k]);
        assert_eq!(replay["smallest_gap_um"], gap[k]);
        let rest = if i == 0 { sensing[1] } else { 0.0 };
        let sum: f64 = phases.iter().map(|phase| phase[k]).sum::<f64>() + rest;
        assert!((sum - seconds[k]).abs() < 1e-3);
    }

    // The same seed, the same document, apart from the wall's clock and paths.
    let mut again = arguments.to_vec();
    again.extend(["--threads", "1"]);
    let mut second: Value =
        serde_json::from_slice(&pigtail(folder.path(), &again).stdout).expect("JSON");
    for key in ["wall_seconds", "rows", "report"] {
        second[key] = document[key].clone();
    }
    assert_eq!(second, document);
}

#[test]
fn bad_input_is_refused_and_nothing_is_written() {
    let folder = TempDir::new().expect("a folder");
    for (arguments, parts) in [
        (
            "--devices 0",
            &["--devices", "0", "whole number above zero"][..],
        ),
        ("--devices -3", &["-3"]),
        ("--devices many", &["many", "whole number above zero"]),
        ("--devices 5 --threads 0", &["--threads", "from 1 to 1024"]),
        (
            "--devices 5 --procedure guess",
            &["--procedure", "guess", "thesis"],
        ),
        (
            "--devices 5 --piezo-model rbf",
            &["--piezo-model", "accepted is it beside --commissioned"],
        ),
        (
            "--devices 5 --rig nowhere",
            &["nowhere", "no such rig", "afpm"],
        ),
        (
            "--devices 5 --recipe nothing",
            &["nothing", "no such recipe", "y-branch"],
        ),
        (
            "--devices 1000000000000",
            &["not enough disk", "accepted are up to", "--runs"],
        ),
        (
            "--devices 5 --seed 18446744073709551614",
            &["--seed", "accepted is at most"],
        ),
        (
            "--resume nowhere",
            &["nowhere", "campaign.json", "accepted is the folder"],
        ),
        ("--resume . --runs there", &["--resume", "--runs"]),
        (
            "--devices 5 --runs /proc/nowhere",
            &["/proc/nowhere", "writable"],
        ),
    ] {
        let mut words = vec!["campaign"];
        words.extend(arguments.split_whitespace());
        let output = pigtail(folder.path(), &words);
        let error = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{arguments}: {error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
        assert!(
            fs::read_dir(folder.path())
                .expect("a folder")
                .next()
                .is_none(),
            "{arguments}"
        );
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_cleanly_and_the_campaign_goes_on() {
    let folder = TempDir::new().expect("a folder");
    let child = std::process::Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder.path())
        .args([
            "campaign",
            "--devices",
            "16",
            "--seed",
            "40",
            "--threads",
            "1",
            "--json",
        ])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the program starts");
    let begun = || {
        let runs = fs::read_dir(folder.path().join("runs")).ok()?;
        let run = runs
            .flatten()
            .map(|entry| entry.path())
            .find(|path| path.join("parts").exists())?;
        Some(run)
    };
    let run = loop {
        match begun() {
            Some(run) => break run,
            None => std::thread::sleep(std::time::Duration::from_millis(5)),
        }
    };
    let killed = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .expect("kill");
    assert!(killed.success());
    let output = child.wait_with_output().expect("it ends");
    let error = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(
        error.contains("of 16 devices are done") && error.contains("--resume runs/"),
        "{error}"
    );
    let document: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(document["complete"], false);
    let done = document["devices"].as_u64().expect("a number");
    assert!(done < 16, "{done}");

    let folder_name = run.display().to_string();
    let output = pigtail(
        folder.path(),
        &["campaign", "--resume", &folder_name, "--json"],
    );
    assert_eq!(output.status.code(), Some(0));
    let resumed: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let output = pigtail(
        folder.path(),
        &["campaign", "--devices", "16", "--seed", "40", "--json"],
    );
    let whole: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(resumed["rows_sha256"], whole["rows_sha256"]);
    assert_eq!(resumed["seconds_per_fiber"], whole["seconds_per_fiber"]);
}

/// Runs these shards of a plan, and returns the folder of them.
fn run_shards(
    runs: &Path,
    setup: &Setup,
    plan: &Plan,
    shards: impl Iterator<Item = Shard>,
) -> PathBuf {
    let folder = shard::folder(runs, plan, setup).expect("a folder");
    for shard in shards {
        // As elsewhere: from the folder alone.
        let (_, setup) = shard::setup(&folder).expect("what was read");
        let never = AtomicBool::new(false);
        let ran = shard::run(&folder, shard, &setup, None, 1, &never, |_| ()).expect("no error");
        assert_eq!(ran.done, ran.devices);
    }
    folder
}

#[test]
fn shards_in_any_order_and_number_give_the_same_bytes() {
    let (setup, folder) = (setup(), TempDir::new().expect("a folder"));
    let mut whole = begin_by(Procedure::Fast, &folder, &setup, 300, 12);
    run(&mut whole, &setup, 2);
    let bytes = end(&whole);
    let sha256 = summary_of(&whole).rows_sha256;
    for of in [1, 3, 5, 20] {
        let runs = TempDir::new().expect("a folder");
        let plan = Plan::new(&setup, Procedure::Fast, 300, 12);
        let mut shards: Vec<_> = Shard::all(of).collect();
        shards.reverse();
        let of_shards = run_shards(runs.path(), &setup, &plan, shards.into_iter());
        let (store, _) = shard::merge(&of_shards, runs.path()).expect("all are there");
        assert!(end(&store) == bytes, "{of} shards");
        assert_eq!(summary_of(&store).rows_sha256, sha256);
    }
}

#[test]
fn a_shard_that_is_there_is_not_run_again_and_one_that_was_stopped_leaves_nothing() {
    let (setup, runs) = (setup(), TempDir::new().expect("a folder"));
    let plan = Plan::new(&setup, Procedure::Fast, 0, 6);
    let (first, second) = (
        Shard::new(1, 2).expect("one"),
        Shard::new(2, 2).expect("one"),
    );
    let folder = run_shards(runs.path(), &setup, &plan, [first].into_iter());
    let never = AtomicBool::new(false);
    let again = shard::run(&folder, first, &setup, None, 1, &never, |_| ()).expect("no error");
    assert_eq!((again.done, again.devices), (0, 3));
    let stop = AtomicBool::new(false);
    let stopped = shard::run(&folder, second, &setup, None, 1, &stop, |_| {
        stop.store(true, Ordering::Relaxed);
    });
    let stopped = stopped.expect("no error");
    assert!(stopped.file.is_none() && stopped.done < 3, "{stopped:?}");
    let left = |folder: &Path| fs::read_dir(folder).expect("there").count();
    // The plan, what was read, and the first shard.
    assert_eq!(left(&folder), 3);
    let missing = shard::merge(&folder, runs.path()).expect_err("one is missing");
    assert!(
        format!("{missing:#}").contains("begins with device 3 of 6"),
        "{missing:#}"
    );
    // Nothing was begun for what cannot be merged.
    assert_eq!(left(runs.path()), 1);
}

#[test]
fn a_damaged_shard_is_told() {
    let (setup, runs) = (setup(), TempDir::new().expect("a folder"));
    let plan = Plan::new(&setup, Procedure::Fast, 0, 4);
    let folder = run_shards(runs.path(), &setup, &plan, Shard::all(2));
    let files = fs::read_dir(&folder).expect("there");
    let shard = files
        .map(|file| file.expect("a file").path())
        .find(|path| path.extension().is_some_and(|e| e == "parquet"))
        .expect("a shard");
    let mut bytes = fs::read(&shard).expect("its rows");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&shard, bytes).expect("written");
    let damaged = format!(
        "{:#}",
        shard::merge(&folder, runs.path()).expect_err("it is damaged")
    );
    assert!(damaged.contains("the shard is damaged"), "{damaged}");
    assert!(damaged.contains(&shard.display().to_string()), "{damaged}");
}
