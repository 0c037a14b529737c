//! The store of runs: what was done is found again, whatever happened on the way, and what was
//! changed is told.

use pigtail_hal::{Fault, Rule};
use pigtail_store::runs::Run;
use rusqlite::Connection;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm");

/// What the program said, and its exit code.
struct Said {
    code: Option<i32>,
    out: String,
    error: String,
}

impl Said {
    fn json(&self) -> Value {
        assert!(self.error.is_empty(), "{}", self.error);
        serde_json::from_str(&self.out).expect("one JSON document")
    }
}

fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pigtail"));
    command
        .current_dir(folder)
        .args(arguments.split_whitespace());
    command
}

fn pigtail(folder: &Path, arguments: &str) -> Said {
    let output = command(folder, arguments).output().expect("it starts");
    Said {
        code: output.status.code(),
        out: String::from_utf8(output.stdout).expect("UTF-8"),
        error: String::from_utf8(output.stderr).expect("UTF-8"),
    }
}

fn done(folder: &Path, arguments: &str) -> Said {
    let said = pigtail(folder, arguments);
    assert_eq!(
        said.code,
        Some(0),
        "{arguments}: {}{}",
        said.out,
        said.error
    );
    said
}

fn spawn(folder: &Path, arguments: &str) -> Child {
    command(folder, arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts")
}

fn listed(folder: &Path) -> Vec<Value> {
    let document = done(folder, "runs list --json").json();
    document["runs"].as_array().expect("runs").clone()
}

fn name(run: &Value) -> &str {
    run["run"].as_str().expect("a name")
}

/// A folder in which the device of seed 12 was aligned, and the run's name.
fn aligned() -> (TempDir, String) {
    let folder = TempDir::new().expect("a folder");
    done(folder.path(), "align --seed 12");
    let run = name(&listed(folder.path())[0]).to_owned();
    (folder, run)
}

fn store(folder: &Path) -> PathBuf {
    folder.join("runs/pigtail.db")
}

#[test]
fn a_run_is_listed_shown_exported_and_verified() {
    let (folder, run) = aligned();
    let folder = folder.path();
    done(folder, "align --seed 13");
    done(folder, "campaign --devices 4 --seed 20");

    let runs = listed(folder);
    let kinds: Vec<_> = runs.iter().map(|r| r["kind"].as_str()).collect();
    assert_eq!(kinds, [Some("align"), Some("align"), Some("campaign")]);
    assert!(runs.iter().all(|r| r["state"] == "complete"));
    assert_eq!(runs[0]["outcome"], "aligned");
    assert_eq!(runs[2]["outcome"], "12 of 12 fibers aligned");
    assert!(runs[0]["wall_seconds"].as_f64().expect("a time") > 0.0);
    let of_seed = |seed: u64| {
        let said = done(folder, &format!("runs list --seed {seed} --json")).json();
        said["runs"].as_array().expect("runs").len()
    };
    assert_eq!([12, 19, 20, 23, 24].map(of_seed), [1, 0, 1, 1, 0]);

    // The store says what the run's own document does.
    let summary = fs::read_to_string(folder.join("runs").join(&run).join("summary.json"));
    let summary: Value = serde_json::from_str(&summary.expect("a summary")).expect("JSON");
    let shown = done(folder, &format!("runs --runs runs show runs/{run}/ --json")).json();
    assert_eq!(shown["device"]["procedure"], "fast");
    assert_eq!(shown["configuration"].as_array().map(Vec::len), Some(4));
    let fibers = summary["fibers"].as_array().expect("fibers");
    let sum: f64 = fibers.iter().filter_map(|f| f["seconds"].as_f64()).sum();
    assert!((shown["machine_seconds"].as_f64().expect("a time") - sum).abs() < 1e-9);
    for (fiber, known) in fibers
        .iter()
        .zip(shown["fibers"].as_array().expect("fibers"))
    {
        for key in ["port", "outcome", "seconds", "coupling_loss_db"] {
            assert_eq!(fiber[key], known[key]);
        }
        assert_eq!(fiber["offset_um"]["x"], known["offset_um"][0]);
        let phases = |of: &Value| -> Vec<(String, i64)> {
            let phases = of["phases"].as_array().expect("phases").iter();
            let millis = |p: &Value| (p["seconds"].as_f64().expect("a time") * 1e3).round() as i64;
            phases.map(|p| (p["name"].to_string(), millis(p))).collect()
        };
        assert_eq!(phases(fiber), phases(known));
    }
    let text = done(folder, &format!("runs show {run}")).out;
    for part in ["align --seed 12", "y-branch.toml", "report.html", "output2"] {
        assert!(text.contains(part), "no {part} in {text}");
    }

    done(folder, "runs export --csv fibers.csv");
    let mut fibers = csv::Reader::from_path(folder.join("fibers.csv")).expect("a file");
    let seconds = fibers
        .headers()
        .expect("a header")
        .iter()
        .position(|h| h == "seconds");
    let rows: Vec<_> = fibers.records().collect::<Result<_, _>>().expect("rows");
    assert_eq!(rows.len(), 6);
    let exported: f64 = rows[..3]
        .iter()
        .map(|row| {
            row[seconds.expect("a column")]
                .parse::<f64>()
                .expect("a number")
        })
        .sum();
    assert!((exported - sum).abs() < 1e-9);
    done(
        folder,
        "runs export --to phases.parquet --rows phases --seed 12",
    );
    let parquet = fs::read(folder.join("phases.parquet")).expect("a file");
    assert_eq!(
        (&parquet[..4], &parquet[parquet.len() - 4..]),
        (&b"PAR1"[..], &b"PAR1"[..])
    );
    assert_eq!(pigtail(folder, "runs export --to rows.txt").code, Some(2));
    assert_eq!(
        pigtail(folder, "runs export --csv no/where.csv").code,
        Some(2)
    );

    let verified = done(folder, "runs verify --json").json();
    assert_eq!(verified["runs"], 3);
    assert_eq!(verified["problems"].as_array().map(Vec::len), Some(0));
    assert_eq!(pigtail(folder, "runs show nothing").code, Some(2));
    assert_eq!(pigtail(folder, "runs verify nothing").code, Some(2));
    assert_eq!(pigtail(folder, "runs list --runs nowhere").code, Some(2));
}

#[test]
fn two_runs_are_compared() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    done(folder, "campaign --devices 4 --seed 20");
    done(folder, "campaign --devices 4 --seed 20");
    done(folder, "campaign --devices 4 --seed 20 --procedure thesis");
    let runs = listed(folder);
    let [one, again, thesis] = [0, 1, 2].map(|i| name(&runs[i]));

    // The same devices, the same rows.
    let same = done(folder, &format!("runs compare {one} {again} --json")).json();
    let rows = same["distributions"].as_array().expect("columns");
    assert!(!rows.is_empty());
    assert!(
        rows.iter()
            .all(|row| row["distance"] == 0.0 && row["chance"] == 1.0)
    );

    // The thesis's procedure is slower with every fiber, and the last gap cannot be chance.
    let other = done(
        folder,
        &format!("runs compare {one} {thesis} --json --report page.html"),
    );
    let other = other.json();
    let rows = other["distributions"].as_array().expect("columns");
    let seconds = rows.iter().find(|row| row["column"] == "seconds");
    let seconds = seconds.expect("a time each fiber");
    assert_eq!(seconds["values"], serde_json::json!([12, 12]));
    assert_eq!(seconds["distance"], 1.0);
    assert!(seconds["chance"].as_f64().expect("a share") < 1e-3);
    let differ = other["differences"].as_array().expect("differences");
    assert!(differ.iter().any(|d| d["change"].as_f64() > Some(1.0)));
    let page = fs::read_to_string(folder.join("page.html")).expect("a page");
    assert!(page.contains(one) && page.contains(thesis) && page.contains("seconds"));

    let nothing = pigtail(folder, &format!("runs compare {one} nothing"));
    assert_eq!(nothing.code, Some(2));
    assert!(nothing.error.contains("nothing"), "{}", nothing.error);

    // Runs that measured different things are no pair, whatever keys their results share.
    done(folder, "align --seed 20");
    done(folder, "characterize z step");
    done(folder, "characterize --seed 1 z sine");
    let all = listed(folder);
    let [align, step, sine] = [3, 4, 5].map(|i| name(&all[i]));
    for (a, b, said) in [
        (one, align, ["`align`", "`campaign`"]),
        (step, sine, ["`characterize sine`", "`characterize step`"]),
    ] {
        let unlike = pigtail(folder, &format!("runs compare {a} {b}"));
        assert_eq!(unlike.code, Some(2), "{}", unlike.error);
        for word in said.iter().chain(&["two runs of one kind"]) {
            assert!(unlike.error.contains(word), "{word}: {}", unlike.error);
        }
    }
}

#[test]
fn a_changed_missing_or_foreign_file_is_named() {
    let (folder, run) = aligned();
    let folder = folder.path();
    done(folder, "align --seed 13");
    let path = |file: &str| folder.join("runs").join(&run).join(file);
    for file in ["report.html", "samples.csv", "summary.json", "run.json"] {
        let whole = fs::read(path(file)).expect("a file");
        let mut changed = whole.clone();
        let middle = changed.len() / 2;
        changed[middle] ^= 1;
        for spoilt in [Some(&changed[..]), Some(&whole[1..]), None] {
            match spoilt {
                Some(bytes) => fs::write(path(file), bytes).expect("a file"),
                None => fs::remove_file(path(file)).expect("gone"),
            }
            let said = pigtail(folder, "runs verify");
            assert_eq!(said.code, Some(1), "{}", said.out);
            assert!(
                said.out.contains(&format!("{run}: {file}: ")),
                "{}",
                said.out
            );
            assert!(said.out.contains("2 runs in runs verified"), "{}", said.out);
            assert!(said.out.contains("1 not as"), "{}", said.out);
        }
        fs::write(path(file), &whole).expect("a file");
    }
    fs::create_dir(path("more")).expect("a folder");
    fs::write(path("more/.foreign"), "").expect("a file");
    let said = pigtail(folder, &format!("runs verify {run} --json"));
    assert_eq!(said.code, Some(1));
    assert_eq!(said.json()["problems"][0]["file"], "more/.foreign");
    fs::remove_dir_all(path("more")).expect("gone");
    done(folder, "runs verify");
    fs::remove_dir_all(path("")).expect("gone");
    let said = pigtail(folder, "runs verify");
    assert_eq!(said.code, Some(1));
    assert!(said.out.contains(&run), "{}", said.out);
}

#[test]
fn a_changed_row_is_named() {
    let (folder, run) = aligned();
    let folder = folder.path();
    let whole = fs::read(store(folder)).expect("a store");
    for change in [
        "UPDATE runs SET seed = '13'",
        "UPDATE runs SET state = 'running'",
        "UPDATE runs SET name = 'another'",
        "UPDATE configurations SET sha256 = 'f' || substr(sha256, 2) WHERE ordinal = 2",
        "UPDATE devices SET procedure = 'thesis'",
        "UPDATE devices SET count = -1",
        "UPDATE fibers SET offset_x_um = offset_x_um + 1e-6 WHERE port = 'output2'",
        "UPDATE fibers SET coupling_loss_db = NULL WHERE port = 'input'",
        "DELETE FROM phases WHERE ordinal = 3",
        "UPDATE files SET bytes = bytes + 1 WHERE path = 'run.json'",
        "DELETE FROM files WHERE path = 'run.json'",
        "DELETE FROM seals",
        "DELETE FROM runs",
        "INSERT INTO faults VALUES (1, 0, 'a rule', 'left.z', '1 V', '2 V', 0.1)",
    ] {
        let connection = Connection::open(store(folder)).expect("a store");
        connection
            .pragma_update(None, "foreign_keys", true)
            .expect("a setting");
        assert!(
            connection.execute(change, []).expect(change) > 0,
            "{change}"
        );
        drop(connection);
        let said = pigtail(folder, "runs verify");
        assert_eq!(said.code, Some(1), "{change}: {}{}", said.out, said.error);
        assert!(said.out.contains(&run), "{change}: {}", said.out);
        fs::write(store(folder), &whole).expect("a store");
        done(folder, "runs verify");
    }
}

/// Of the database's own bytes, too, none that matters may change without a word. How many of so many single bits
/// are told of.
fn flipped_bits_told(bits: usize) -> usize {
    let (folder, run) = aligned();
    let folder = folder.path();
    let whole = fs::read(store(folder)).expect("a store");
    let dump = || {
        let shown = pigtail(folder, &format!("runs show {run} --json"));
        (shown.code, shown.out)
    };
    let before = dump();
    let mut told = 0;
    for k in 0..bits {
        let mut changed = whole.clone();
        let at = (k * 7919 + 4096) % whole.len();
        changed[at] ^= 1 << (k % 8);
        fs::write(store(folder), &changed).expect("a store");
        let said = pigtail(folder, "runs verify");
        match said.code {
            Some(0) => assert_eq!(dump(), before, "byte {at}"),
            Some(1) => assert!(said.out.contains(&run), "byte {at}: {}", said.out),
            code => {
                assert_eq!(code, Some(2), "byte {at}: {}", said.error);
                assert_eq!(said.error.lines().count(), 1, "byte {at}: {}", said.error);
            }
        }
        told += usize::from(said.code != Some(0));
    }
    told
}

#[test]
fn a_flipped_bit_of_the_database_is_told_or_changes_nothing() {
    assert!(flipped_bits_told(30) > 2);
}

#[test]
#[ignore = "long: 300 processes"]
fn any_flipped_bit_of_the_database_is_told_or_changes_nothing() {
    assert!(flipped_bits_told(300) > 20);
}

/// Everything in a folder, with its content.
fn content(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            all.extend(content(&path));
        } else {
            all.push((path.clone(), fs::read(&path).expect("a file")));
        }
    }
    all.sort();
    all
}

#[test]
fn a_store_that_cannot_be_understood_is_refused_and_left_as_it_is() {
    let (folder, _) = aligned();
    let folder = folder.path();
    let whole = fs::read(store(folder)).expect("a store");
    let mut garbage = whole.clone();
    garbage[..40].fill(0xa5);
    let mut pages = whole.clone();
    pages[4096..].fill(0x5a);
    let changed = |sql: &str| {
        fs::write(store(folder), &whole).expect("a store");
        let connection = Connection::open(store(folder)).expect("a store");
        connection.execute_batch(sql).expect("it is done");
        drop(connection);
        fs::read(store(folder)).expect("a store")
    };
    let newer = changed("PRAGMA user_version = 1000");
    let foreign = changed("PRAGMA application_id = 7");
    let gone = changed("DROP TABLE phases; DROP TABLE runs;");
    for (bytes, parts) in [
        (&garbage[..], &["damaged", "is no database", "backup"][..]),
        (
            &whole[..whole.len() / 2],
            &["damaged", "nothing was changed"],
        ),
        (&whole[..20], &["damaged"]),
        (&[], &["damaged", "empty"]),
        (&pages, &["damaged", "nothing was changed"]),
        (&gone, &["damaged", "runs"]),
        (&newer, &["user_version", "newer", "1000", "accepted"]),
        (&foreign, &["no store of runs", "accepted"]),
    ] {
        fs::write(store(folder), bytes).expect("a store");
        let before = content(folder);
        for arguments in [
            "runs list",
            "runs verify",
            "align --seed 1",
            "campaign --devices 2",
        ] {
            let said = pigtail(folder, arguments);
            assert_eq!(said.code, Some(2), "{arguments}: {}", said.out);
            assert_eq!(said.error.lines().count(), 1, "{}", said.error);
            for part in ["runs/pigtail.db"].iter().chain(parts) {
                assert!(
                    said.error.contains(part),
                    "no \"{part}\" in: {}",
                    said.error
                );
            }
            let logs =
                |(path, _): &(PathBuf, Vec<u8>)| !path.to_string_lossy().contains("pigtail.db-");
            let after: Vec<_> = content(folder).into_iter().filter(logs).collect();
            assert!(before == after, "{arguments} changed something");
        }
    }
}

#[test]
fn where_nothing_can_be_written_no_run_begins() {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("file"), "").expect("a file");
    fs::create_dir_all(folder.path().join("taken/pigtail.db")).expect("a folder");
    for (arguments, part) in [
        ("align --runs file", "writable folder"),
        ("align --runs file/below", "writable folder"),
        ("align --runs taken", "taken/pigtail.db"),
        ("campaign --devices 2 --runs taken", "taken/pigtail.db"),
    ] {
        let said = pigtail(folder.path(), arguments);
        assert_eq!(said.code, Some(2), "{}", said.out);
        assert!(said.error.contains(part), "{}", said.error);
    }
    assert_eq!(
        fs::read_dir(folder.path().join("taken"))
            .expect("it")
            .count(),
        1
    );
}

#[test]
#[ignore = "long: eight processes at once"]
fn many_processes_at_once_are_all_entered() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    let children: Vec<_> = (0..8)
        .map(|seed| spawn(folder, &format!("align --seed {}", seed % 4)))
        .collect();
    for child in children {
        let output = child.wait_with_output().expect("it ends");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && error.is_empty(), "{error}");
        // Readers are not in the way of writers, nor they in theirs.
        listed(folder);
    }
    let runs = listed(folder);
    assert_eq!(runs.len(), 8);
    assert!(runs.iter().all(|run| run["state"] == "complete"));
    done(folder, "runs verify");
}

#[test]
#[ignore = "long: 16 killed processes"]
fn a_killed_alignment_is_listed_as_interrupted_and_harms_nothing_else() {
    let (folder, first) = aligned();
    let folder = folder.path();
    let mut killed = 0;
    // Some are killed before they begin, and later and later until one is done by then, however slow the machine is.
    for trial in 0..100_u64 {
        // Always the same, of which it is known that none of its fibers is in want of anything: the one that is done is complete.
        let mut child = spawn(folder, "align --procedure macro-only --seed 0");
        std::thread::sleep(Duration::from_micros(500 * (1 + trial * trial)));
        child.kill().expect("a signal");
        let ended = child.wait().expect("it ends");
        if ended.code().is_some() {
            break;
        }
        killed += 1;
    }
    let runs = listed(folder);
    let (mut interrupted, mut phases) = (0, 0);
    for run in &runs {
        let folder_of = folder.join("runs").join(name(run));
        let hidden = folder.join(format!("runs/.{}.partial", name(run)));
        if run["state"] == "interrupted" {
            interrupted += 1;
            assert!(hidden.is_dir() != folder_of.is_dir());
            let shown = done(folder, &format!("runs show {} --json", name(run))).json();
            for fiber in shown["fibers"].as_array().expect("fibers") {
                phases += fiber["phases"].as_array().expect("phases").len();
            }
        } else {
            assert_eq!(run["state"], "complete");
            assert!(folder_of.is_dir() && !hidden.exists());
        }
    }
    assert!(
        interrupted > 0 && interrupted <= killed,
        "{interrupted} of {killed}"
    );
    assert!(phases > 0, "what was entered before stays");
    assert_eq!(name(&runs[0]), first);
    let verified = done(folder, "runs verify --json").json();
    assert_eq!(
        verified["not_sealed"].as_array().map(Vec::len),
        Some(interrupted)
    );
    done(folder, "align --seed 5");
    assert_eq!(listed(folder).last().expect("a run")["state"], "complete");
}

#[test]
#[ignore = "long: a killed process"]
fn a_killed_campaign_is_interrupted_until_it_is_resumed() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    let mut child = spawn(folder, "campaign --devices 40 --seed 40 --threads 1");
    let begun = || {
        let entries = fs::read_dir(folder.join("runs")).ok()?.flatten();
        entries
            .map(|e| e.path())
            .find(|path| path.join("parts").exists())
    };
    let run = loop {
        match begun() {
            Some(run) => break run,
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    };
    assert_eq!(listed(folder)[0]["state"], "running");
    child.kill().expect("a signal");
    child.wait().expect("it ends");
    assert_eq!(listed(folder)[0]["state"], "interrupted");
    done(folder, &format!("campaign --resume {}", run.display()));
    let runs = listed(folder);
    assert_eq!(
        (runs.len(), &runs[0]["state"]),
        (1, &Value::from("complete"))
    );
    assert_eq!(runs[0]["outcome"], "120 of 120 fibers aligned");
    done(folder, "runs verify");
    // Nothing is left to be done, and nothing is entered again.
    done(folder, &format!("campaign --resume {}", run.display()));
    done(folder, "runs verify");
    // One whose store got lost is entered as it goes on.
    fs::remove_file(store(folder)).expect("gone");
    let text = pigtail(folder, "runs list").out;
    assert!(text.contains("Not in the store"), "{text}");
    fs::remove_file(run.join("rows.parquet")).expect("gone");
    fs::remove_file(run.join("summary.json")).expect("gone");
    done(folder, &format!("campaign --resume {}", run.display()));
    assert_eq!(listed(folder)[0]["state"], "complete");
    done(folder, "runs verify");
}

#[test]
fn runs_from_before_the_store_are_told_apart() {
    let (folder, run) = aligned();
    let folder = folder.path();
    fs::remove_file(store(folder)).expect("gone");
    for arguments in ["runs list", "runs verify"] {
        let said = done(folder, arguments);
        assert!(
            said.out.contains(&run) && said.out.contains("ot in the store"),
            "{}",
            said.out
        );
    }
    let said = pigtail(folder, &format!("runs show {run}"));
    assert_eq!(said.code, Some(2));
    assert!(said.error.contains("is not in the store"), "{}", said.error);
    done(folder, "align --seed 1");
    let document = done(folder, "runs list --json").json();
    assert_eq!(document["not_in_store"], serde_json::json!([run]));
    assert_eq!(document["runs"].as_array().map(Vec::len), Some(1));
}

#[test]
fn the_run_that_wrote_a_calibration_is_known_to_those_that_read_it() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    fs::create_dir(folder.join("rig")).expect("a rig");
    for file in ["machine.toml", "plant.toml", "calibration.toml"] {
        fs::copy(Path::new(RIG).join(file), folder.join("rig").join(file)).expect("a copy");
    }
    done(folder, "identify windup z --rig rig --write");
    done(folder, "align --rig rig");
    let runs = listed(folder);
    assert_eq!(runs[0]["kind"], "identify windup");
    let show = |run: &Value| done(folder, &format!("runs show {} --json", name(run))).json();
    let written = show(&runs[0]);
    assert_eq!(written["calibrations"][0]["table"], "windup.z");
    let read = show(&runs[1]);
    let read = &read["configuration"][2];
    assert_eq!(read["sha256"], written["calibrations"][0]["sha256"]);
    assert_eq!(read["written_by"], runs[0]["run"]);
    done(folder, "runs verify");
}

#[test]
fn a_fault_keeps_its_evidence_and_bad_input_leaves_nothing() {
    let folder = TempDir::new().expect("a folder");
    let runs = folder.path().join("runs");
    let left = || fs::read_dir(&runs).expect("the folder").count();
    let begin = || Run::begin(&runs, "align", 7, &[]).expect("a run");
    drop(begin());
    assert_eq!(left(), 0, "bad input found before anything ran");

    let run = begin();
    fs::write(run.partial_path("record.pig"), "seen").expect("a file");
    run.phase("input", "coarse", 0.5, 0.75)
        .expect("it is entered");
    assert_eq!(listed(folder.path())[0]["state"], "running");
    let fault = Fault {
        rule: Rule::EndpointSpeed,
        axis: "left.z".to_owned(),
        value: "7 mm/s".to_owned(),
        limit: "5 mm/s".to_owned(),
        time: 1.25,
    };
    run.fault(&fault).expect("it is kept");
    let name = run.name();
    drop(run);
    let list = listed(folder.path());
    assert_eq!((list.len(), &list[0]["state"]), (1, &Value::from("fault")));
    let shown = done(folder.path(), &format!("runs show {name} --json")).json();
    assert_eq!(shown["faults"][0]["axis"], "left.z");
    assert_eq!(shown["fibers"][0]["phases"][0]["seconds"], 0.75);
    assert_eq!(
        fs::read(runs.join(&name).join("record.pig")).expect("it"),
        b"seen"
    );
    assert_eq!(done(folder.path(), "runs verify --json").json()["runs"], 1);

    // A store in which something is stays, and what ended without a word is interrupted.
    drop(begin());
    assert_eq!(left(), 2);
    let run = begin();
    run.write("summary.json", "{}").expect("a file");
    drop(run);
    let list = listed(folder.path());
    assert_eq!(
        (list.len(), &list[1]["state"]),
        (2, &Value::from("interrupted"))
    );
    done(folder.path(), "runs verify");
}

/// What CI has no right to do.
mod acceptance {
    use super::*;

    /// A small file system of its own, away again when the test is over.
    struct Disk(TempDir);

    impl Disk {
        fn mounted(options: &str) -> Self {
            let disk = Self(TempDir::new().expect("a folder"));
            disk.mount(&format!("{options} -t tmpfs tmpfs"));
            disk
        }

        fn mount(&self, arguments: &str) {
            let mut mount = Command::new("mount");
            mount.args(arguments.split_whitespace()).arg(self.0.path());
            assert!(mount.status().expect("mount").success());
        }
    }

    impl Drop for Disk {
        fn drop(&mut self) {
            // Left mounted it is in nobody's way but the folder's.
            let _ = Command::new("umount").arg(self.0.path()).status();
        }
    }

    #[test]
    #[ignore = "mounts a file system, which needs root: .ci/acceptance full-disk"]
    fn a_full_disk_loses_nothing_that_was_entered() {
        let disk = Disk::mounted("-o size=3000k");
        let folder = disk.0.path();
        let mut complete = 0;
        let said = loop {
            let said = pigtail(folder, &format!("align --seed {complete}"));
            if said.code != Some(0) {
                break said;
            }
            complete += 1;
        };
        assert_eq!(said.code, Some(2));
        // Of a file, or of the store, whichever came to the end first.
        let told = ["No space left", "the disk is full"];
        assert!(
            told.iter().any(|t| said.error.contains(t)),
            "{}",
            said.error
        );
        assert!(complete > 0);
        let states = || {
            let states = listed(folder).into_iter().map(|run| run["state"].clone());
            states.collect::<Vec<_>>()
        };
        assert_eq!(states().len(), complete + 1);
        assert!(states()[..complete].iter().all(|state| state == "complete"));
        assert_eq!(states()[complete], "interrupted");
        done(folder, "runs verify");

        // Not a byte is left: no run begins, and what was done can still be read.
        let _ = fs::write(folder.join("fill"), vec![0; 1 << 22]);
        let said = pigtail(folder, "align");
        assert_eq!(said.code, Some(2));
        assert!(
            said.error.contains("pigtail.db") && said.error.contains("room"),
            "{}",
            said.error
        );
        assert_eq!(states().len(), complete + 1);
        done(folder, "runs verify");
        fs::remove_file(folder.join("fill")).expect("gone");

        disk.mount("-o remount,ro");
        let said = pigtail(folder, "align");
        assert_eq!(said.code, Some(2));
        assert!(said.error.contains("writable folder"), "{}", said.error);
        assert_eq!(states().len(), complete + 1);
        done(folder, "runs verify");
    }
}
