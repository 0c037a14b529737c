//! Every command as the program's own parser knows it: its help, its width, the names of its flags, and what it says of
//! input that is wrong.

use clap::{Arg, ArgAction, Command};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Output;
use tempfile::TempDir;

/// A command that does something: the words that call it, and itself.
type Called = (Vec<String>, Command);

fn all() -> Vec<Called> {
    fn add(before: &[String], command: &Command, to: &mut Vec<Called>) {
        to.push((before.to_vec(), command.clone()));
        for sub in command.get_subcommands() {
            if sub.get_name() != "help" {
                let words = [before, &[sub.get_name().to_owned()]].concat();
                add(&words, sub, to);
            }
        }
    }
    let mut command = pigtail::command();
    command.build();
    let mut all = Vec::new();
    add(&[], &command, &mut all);
    assert!(all.len() > 40, "{}", all.len());
    all
}

fn run(folder: &Path, words: &[String]) -> Output {
    assert_cmd::Command::new(env!("CARGO_BIN_EXE_pigtail"))
        .current_dir(folder)
        .args(words)
        .timeout(std::time::Duration::from_secs(60))
        .output()
        .expect("the program starts")
}

/// Whether input was refused in words, and nothing but words came of it.
fn refused(folder: &TempDir, words: &[String]) -> String {
    let before = left(folder.path());
    let output = run(folder.path(), words);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let called = words.join(" ");
    assert_eq!(output.status.code(), Some(2), "{called}: {said}");
    assert!(output.stdout.is_empty(), "{called} prints something");
    assert!(said.starts_with("error: "), "{called}: {said}");
    assert!(!said.contains("panicked"), "{called}: {said}");
    assert_eq!(left(folder.path()), before, "{called} leaves something");
    said
}

fn left(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).expect("a folder");
    let name = |entry: std::io::Result<fs::DirEntry>| {
        let name = entry.expect("an entry").file_name();
        name.to_string_lossy().into_owned()
    };
    entries.map(name).collect()
}

#[test]
fn help_is_there_in_eighty_columns() {
    for (words, command) in all() {
        assert!(
            command.get_about().is_some(),
            "{words:?} says what it is for"
        );
        let mut folded = command.clone().term_width(80);
        for help in [folded.render_help(), folded.render_long_help()] {
            for line in help.to_string().lines() {
                let width = line.trim_end().chars().count();
                assert!(width <= 80, "{words:?}: {width} columns: {line}");
            }
        }
        for argument in command.get_arguments() {
            let name = argument.get_id();
            assert!(argument.get_help().is_some(), "{words:?}: {name} is said");
        }
    }
}

/// Values that are free text or a place to write to: nothing that is typed there is wrong.
const FREE: [&str; 9] = [
    "runs", "operator", "csv", "parquet", "to", "report", "into", "out", "toml",
];

/// Arguments that a command cannot do without, so that it comes to those that are tried.
fn needed(words: &[String]) -> Vec<&'static str> {
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["recipe", "check" | "explain"] => vec!["produce-fast"],
        ["tune"] | ["identify", "windup"] => vec!["z"],
        ["calibration", "diff" | "apply" | "rollback"] => vec!["1"],
        ["identify", "servo"] => vec![
            "--data=no.csv",
            "--position=a",
            "--voltage=b",
            "--force-per-volt=1",
        ],
        ["identify", "friction"] => vec!["--data=no.csv", "--displacement=a", "--force=b"],
        ["identify", "resonance"] => vec!["--data=no.csv"],
        ["predict"] => vec!["--data=no.csv", "--model=no.json"],
        ["characterize"] => vec!["z", "step"],
        ["impulse"] => vec!["z", "--target-nm=100"],
        ["trace"] => vec!["square"],
        ["simulate", "joint"] => vec!["--params=no.toml", "--axis=z", "--step=1"],
        ["sample-data"] => vec!["sample"],
        ["twin"] => vec!["--from=no.toml"],
        ["rig"] => vec!["mine"],
        ["runs", "show" | "replay"] => vec!["no-run"],
        ["runs", "compare"] => vec!["no-run", "no-other"],
        ["runs", "export"] => vec!["--csv=no.csv"],
        ["campaign"] => vec!["--devices=1"],
        ["completions"] => vec!["bash"],
        _ => Vec::new(),
    }
}

/// A value that no argument takes: no number, no name, and no file.
const WRONG: &str = "no\u{fc}such-thing";

fn takes_value(argument: &Arg) -> bool {
    matches!(argument.get_action(), ArgAction::Set | ArgAction::Append)
}

#[test]
fn a_flag_that_no_command_has_is_refused_by_all() {
    let folder = TempDir::new().expect("a folder");
    for (words, _) in all() {
        let tried = [words, vec!["--no-such-flag".to_owned()]].concat();
        let said = refused(&folder, &tried);
        assert!(said.contains("--no-such-flag"), "{said}");
    }
}

#[test]
fn a_wrong_value_of_any_flag_is_refused_in_words() {
    let folder = TempDir::new().expect("a folder");
    let mut tried = 0;
    for (words, command) in all() {
        for argument in command.get_arguments() {
            let Some(long) = argument.get_long() else {
                continue;
            };
            if !takes_value(argument) || FREE.contains(&long) {
                continue;
            }
            // What is needed beside it and is the one that is tried is not said twice.
            let flag = format!("--{long}=");
            let others = needed(&words).into_iter();
            let others = others.filter(|other| !other.starts_with(&flag));
            let mut tried_words = words.clone();
            tried_words.extend(others.map(str::to_owned));
            tried_words.push(format!("{flag}{WRONG}"));
            let said = refused(&folder, &tried_words);
            assert!(said.len() > 20, "{tried_words:?}: {said}");
            tried += 1;
        }
    }
    assert!(tried > 200, "{tried}");
}

#[test]
fn a_wrong_word_is_refused_in_words() {
    let folder = TempDir::new().expect("a folder");
    for (words, command) in all() {
        let positional = command.get_positionals().count();
        // A folder to write is as it is named.
        let free = ["sample-data", "rig"];
        if free.contains(&command.get_name()) {
            continue;
        }
        let wrong = std::iter::repeat_n(WRONG.to_owned(), positional.max(1));
        let flags = needed(&words).into_iter();
        let flags = flags.filter(|word| word.starts_with("--"));
        let tried: Vec<String> = words
            .iter()
            .cloned()
            .chain(wrong)
            .chain(flags.map(str::to_owned))
            .collect();
        refused(&folder, &tried);
    }
}

#[test]
fn a_name_means_one_thing_in_all_commands() {
    // Where one word has two meanings, each is said by the value's name.
    const TWO: [&str; 0] = [];
    let mut names: BTreeMap<String, BTreeMap<bool, Vec<String>>> = BTreeMap::new();
    for (words, command) in all() {
        for argument in command.get_arguments() {
            let Some(long) = argument.get_long() else {
                continue;
            };
            let kinds = names.entry(long.to_owned()).or_default();
            let of = kinds.entry(takes_value(argument)).or_default();
            of.push(words.join(" "));
        }
    }
    for (name, kinds) in &names {
        assert!(
            kinds.len() == 1 || TWO.contains(&name.as_str()),
            "--{name}: {kinds:?}"
        );
        assert!(!name.contains('_'), "--{name}");
    }
    // Whatever makes a run takes these by these names.
    let with = |name: &str| -> BTreeSet<&str> {
        let kinds = names[name].values().flatten();
        kinds.map(String::as_str).collect()
    };
    let seeded = with("seed");
    for name in ["json", "runs", "rig"] {
        let missing: Vec<_> = seeded.difference(&with(name)).copied().collect();
        let known: &[&str] = match name {
            // A store has runs of all rigs.
            "rig" => &["runs export", "runs list"],
            "runs" => &["sample-data"],
            _ => &["runs export"],
        };
        assert_eq!(missing, known, "--{name}");
    }
}

/// What an argument is, without what goes for one command alone.
fn said(argument: &Arg) -> String {
    let help = argument.get_help().map(ToString::to_string);
    let help = help.unwrap_or_default();
    let end = help.find([',', ';', '.', ':', '(', '[']);
    help[..end.unwrap_or(help.len())].trim().to_owned()
}

#[test]
fn a_thing_has_one_name_in_all_commands() {
    // Words that are too few to tell a thing: files to write are told by what is in them, ways to align by whose they are.
    const FEW: [&str; 3] = ["A file to write", "Which model", "With impulse"];
    // Words that are two things to the trade. Each of these says which by the name of its value: a record's column, a file, a
    // name, a length or counts, names or a number.
    const TWO: [&str; 5] = ["frequency", "model", "reference", "step", "steps"];
    let mut things: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (_, command) in all() {
        for argument in command.get_arguments() {
            if let Some(long) = argument.get_long() {
                things
                    .entry(said(argument))
                    .or_default()
                    .insert(long.to_owned());
            }
        }
    }
    things.retain(|thing, names| names.len() > 1 && !FEW.contains(&thing.as_str()));
    assert!(things.is_empty(), "{things:?}");
    // The other way round: what a flag takes is called alike.
    let mut taken: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (_, command) in all() {
        for argument in command.get_arguments().filter(|a| takes_value(a)) {
            let (Some(long), Some(names)) = (argument.get_long(), argument.get_value_names())
            else {
                continue;
            };
            let names: Vec<&str> = names.iter().map(clap::builder::Str::as_str).collect();
            let of = taken.entry(long.to_owned()).or_default();
            of.insert(names.join(" "));
        }
    }
    taken.retain(|name, values| values.len() > 1 && !TWO.contains(&name.as_str()));
    assert!(taken.is_empty(), "{taken:?}");
}

#[test]
fn a_value_below_zero_is_refused_by_the_flag_that_it_was_meant_for() {
    let folder = TempDir::new().expect("a folder");
    for called in [
        "align --mesh -10um",
        "align --seed -1",
        "align --device -1",
        "campaign --devices -3",
        "campaign --threads -1",
        "maximize --dwell -4ms",
        "trace square --size -1mm",
        "characterize z sine --frequency -1",
        "runs list --last -1",
        "simulate joint --params no.toml --axis z --step 1 --duration -1s",
    ] {
        let words: Vec<String> = called.split(' ').map(str::to_owned).collect();
        let said = refused(&folder, &words);
        let (flag, value) = (&words[words.len() - 2], &words[words.len() - 1]);
        assert!(said.contains(flag) && said.contains(value), "{said}");
        assert!(
            said.contains("accepted") || said.contains("not in"),
            "{said}"
        );
    }
}

#[test]
fn experiments_keep_their_samples() {
    let folder = TempDir::new().expect("a folder");
    let words = |text: &str| -> Vec<String> { text.split(' ').map(str::to_owned).collect() };
    run(folder.path(), &words("sample-data data"));
    for (k, called) in [
        "align",
        "align --rig bench-piezo",
        "align --map data/map.csv --map-columns x_um,y_um,power_V",
        "commission --steps axes,dark",
        "characterize z step",
        "characterize z sine",
        "impulse z --target-nm 100",
        "impulse z --target-nm 0.1um --machines 2",
        "identify hysteresis --data data/piezo.csv --voltage u_V --displacement x_um",
        "identify friction --data data/friction.csv --displacement x_um --force force_N",
        "identify resonance --data data/response.csv",
    ]
    .iter()
    .enumerate()
    {
        let runs = folder.path().join(format!("runs-{k}"));
        let mut words = words(called);
        words.push(format!("--runs={}", runs.display()));
        let output = run(folder.path(), &words);
        assert!(output.status.code() < Some(2), "{called}: {output:?}");
        let made = left(&runs).into_iter().map(|name| runs.join(name));
        let of: Vec<_> = made.filter(|path| path.is_dir()).collect();
        assert_eq!(of.len(), 1, "{called}");
        let csv = fs::read_to_string(of[0].join("samples.csv")).expect("samples as CSV");
        let fields = csv.lines().next().map_or(0, |line| line.split(',').count());
        assert!(fields > 1 && csv.lines().count() > 2, "{called}");
        let parquet = pigtail_store::rows::Rows::open_any(&of[0].join("samples.parquet"))
            .unwrap_or_else(|why| panic!("{called}: {why}"));
        assert_eq!(parquet.columns().len(), fields, "{called}");
        assert_eq!(parquet.rows() as usize, csv.lines().count() - 1, "{called}");
    }
}
