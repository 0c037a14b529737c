//! What README and book show of the program is what it prints: blocks with `$ pigtail ...` are played in a folder of the
//! page's own, from its first to its last. Times of day, hashes of what depends on them, and seconds of this computer are not
//! compared, nor how wide a column is; a line `...` stands for any lines. A block after a comment
//! `<!-- not played: why -->` is left alone. `UPDATE_PAGES=1 cargo test -p pigtail --test book -- --include-ignored`
//! writes what has changed.

#![cfg(unix)]

use regex::Regex;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    root.canonicalize().expect("the repository is there")
}

/// Pages of README and book, by their paths from the root.
fn pages() -> Vec<PathBuf> {
    let mut pages = [
        "README.md",
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
        "apps/python/README.md",
    ]
    .map(PathBuf::from)
    .to_vec();
    let mut folders = vec![PathBuf::from("book/src")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root().join(&folder)).expect("a folder of the book") {
            let entry = entry.expect("an entry");
            let path = folder.join(entry.file_name());
            if entry.path().is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "md") {
                pages.push(path);
            }
        }
    }
    pages.sort();
    pages
}

fn read(page: &Path) -> String {
    let path = root().join(page);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A command of a page, and the lines that it is said to print.
#[derive(Debug)]
struct Shown {
    /// Line of the page, from 0, with the command.
    line: usize,
    command: String,
    output: std::ops::Range<usize>,
}

/// The commands of a page that are to be played.
fn shown(lines: &[&str]) -> Vec<Shown> {
    let mut all: Vec<Shown> = Vec::new();
    let (mut inside, mut played) = (false, true);
    for (k, line) in lines.iter().enumerate() {
        if line.starts_with("```") {
            inside = !inside;
            played &= inside;
            if !inside {
                played = true;
            }
        } else if line.starts_with("<!-- not played:") {
            played = false;
        }
        // A fence begins no command.
        if !inside || !played || line.starts_with("```") {
            continue;
        }
        if let Some(command) = line.strip_prefix("$ ") {
            all.push(Shown {
                line: k,
                command: command.replacen("cargo run --release --", "pigtail", 1),
                output: k + 1..k + 1,
            });
        } else if let Some(last) = all.last_mut().filter(|last| last.output.end == k) {
            if last.output.is_empty() && last.command.ends_with('\\') {
                last.command = format!("{}\n{line}", last.command);
                last.output.start = k + 1;
            }
            last.output.end = k + 1;
        }
    }
    all.retain(|shown| PLAYED.iter().any(|word| shown.command.starts_with(word)));
    all
}

/// How commands begin that are played.
const PLAYED: [&str; 4] = ["pigtail ", "cp ", "sed ", "printf "];

/// Files that a page has its reader write: the lines where their blocks begin and end.
fn files(lines: &[&str]) -> Vec<(String, std::ops::Range<usize>)> {
    let mut all = Vec::new();
    for (k, line) in lines.iter().enumerate() {
        let name = line
            .strip_prefix("<!-- file: ")
            .and_then(|l| l.strip_suffix(" -->"));
        let begin = lines[k..].iter().position(|line| line.starts_with("```"));
        if let (Some(name), Some(begin)) = (name, begin) {
            let begin = k + begin + 1;
            let length = lines[begin..]
                .iter()
                .take_while(|line| !line.starts_with("```"));
            all.push((name.to_owned(), begin..begin + length.count()));
        }
    }
    all
}

/// What is to be shown of what was printed: as much as before a line `...`, and as much as behind it.
fn cut(said: &[&str], printed: &[String]) -> Option<Vec<String>> {
    let dots: Vec<usize> = (0..said.len())
        .filter(|k| said[*k].trim() == "...")
        .collect();
    match dots[..] {
        [] => Some(printed.to_vec()),
        [at] => {
            let behind = said.len() - at - 1;
            (at + behind <= printed.len()).then(|| {
                let (before, after) = (&printed[..at], &printed[printed.len() - behind..]);
                [before, &[said[at].to_owned()], after].concat()
            })
        }
        _ => None,
    }
}

/// A line without what differs from day to day and from computer to computer.
fn compared(line: &str) -> String {
    static CHANGING: LazyLock<Vec<(Regex, &str)>> = LazyLock::new(|| {
        [
            (r"\d{8}T\d{6}(-\d{3,})?", "RUN"),
            // A second run of its kind within a second.
            (r"(RUN(?:-[a-z]+)*-\d+)-\d+\b", "$1"),
            (r"\d{4}-\d{2}-\d{2}( \d{2}:\d{2}(:\d{2})?)?", "DATE"),
            (r"\b[0-9a-f]{8,64}\b", "HASH"),
            (r"[0-9.]+ s here, [0-9.]+ devices/s", "SPEED"),
            (r"Simulated in [0-9.]+ (s|min)", "SPEED"),
            (r"took +[0-9.]+ s", "SPEED"),
            (r"machine time in [0-9.]+ s", "SPEED"),
            (r"\([0-9.]+ s\)", "SPEED"),
            // The last column of a list of runs is how long they took.
            (
                r"^(RUN.* (complete|fault|interrupted) .*) [0-9.]+$",
                "$1 SPEED",
            ),
            (r"─+", "─"),
        ]
        .map(|(pattern, to)| (Regex::new(pattern).expect("a pattern"), to))
        .into()
    });
    let words: Vec<&str> = line.split_whitespace().collect();
    CHANGING
        .iter()
        .fold(words.join(" "), |text, (pattern, to)| {
            pattern.replace_all(&text, *to).into_owned()
        })
}

/// Whether lines are as shown, where `...` stands for any lines.
fn agree(shown: &[&str], printed: &[String]) -> bool {
    match shown.split_first() {
        None => printed.is_empty(),
        Some((first, rest)) if first.trim() == "..." => {
            (0..=printed.len()).any(|skipped| agree(rest, &printed[skipped..]))
        }
        Some((first, rest)) => printed
            .split_first()
            .is_some_and(|(line, others)| compared(first) == compared(line) && agree(rest, others)),
    }
}

fn copied(from: &Path, to: &Path) {
    fs::create_dir(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder of the repository") {
        let entry = entry.expect("an entry");
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            copied(&entry.path(), &to);
        } else {
            fs::copy(entry.path(), to).expect("a copy");
        }
    }
}

/// Plays a page; what it shows otherwise than printed.
fn played(page: &Path) -> Vec<String> {
    let text = read(page);
    let lines: Vec<&str> = text.lines().collect();
    let folder = tempfile::tempdir().expect("a folder");
    let program = Path::new(env!("CARGO_BIN_EXE_pigtail"));
    let path = std::env::var("PATH").unwrap_or_default();
    let path = format!("{}:{path}", program.parent().expect("has one").display());
    // As in a clone: what is there is found there.
    for there in ["recipes", "rigs", "trays"] {
        copied(&root().join(there), &folder.path().join(there));
    }
    for (name, range) in files(&lines) {
        let content = lines[range].join("\n") + "\n";
        fs::write(folder.path().join(name), content).expect("a file");
    }
    let mut wrong = Vec::new();
    let mut new: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
    // From the last to the first, so that what is written anew does not move what is to come.
    let mut written = Vec::new();
    for shown in shown(&lines) {
        let output = Command::new("sh")
            .args(["-c", &format!("{{ {}\n}} 2>&1", shown.command)])
            .env("PATH", &path)
            .env_remove("COLUMNS")
            .current_dir(folder.path())
            .output()
            .expect("a shell");
        let printed = String::from_utf8_lossy(&output.stdout);
        let mut printed: Vec<String> = printed.lines().map(|l| l.trim_end().to_owned()).collect();
        while printed.last().is_some_and(String::is_empty) {
            printed.pop();
        }
        let mut said = &lines[shown.output.clone()];
        while said.last().is_some_and(|line| line.trim().is_empty()) {
            said = &said[..said.len() - 1];
        }
        // A command alone is shown for what it does; it must do it.
        if said.is_empty() {
            if output.status.code().is_none_or(|code| code > 1) {
                wrong.push(format!(
                    "{}:{}: `{}` ends in {}",
                    page.display(),
                    shown.line + 1,
                    shown.command,
                    output.status
                ));
            }
            continue;
        }
        if !agree(said, &printed) {
            wrong.push(format!(
                "{}:{}: `{}` prints\n{}",
                page.display(),
                shown.line + 1,
                shown.command,
                printed.join("\n")
            ));
            if let Some(printed) = cut(said, &printed) {
                let from = shown.output.start;
                written.push((from..from + said.len(), printed));
            }
        }
    }
    if std::env::var_os("UPDATE_PAGES").is_some() && !written.is_empty() {
        for (range, printed) in written.into_iter().rev() {
            new.splice(range, printed);
        }
        fs::write(root().join(page), new.join("\n") + "\n").expect("the page can be written");
    }
    wrong
}

fn are_played(pages: &[PathBuf]) {
    let wrong: Vec<String> = pages.iter().flat_map(|page| played(page)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

/// The pages that a newcomer reads first.
const FIRST: [&str; 2] = ["README.md", "book/src/tutorial.md"];

#[test]
fn readme_and_tutorial_show_what_the_program_prints() {
    are_played(&FIRST.map(PathBuf::from));
}

#[test]
#[ignore = "long: every command that the book shows"]
fn the_book_shows_what_the_program_prints() {
    let mut pages = pages();
    pages.retain(|page| !FIRST.iter().any(|first| page == Path::new(first)));
    are_played(&pages);
}

#[test]
fn what_differs_is_seen_and_what_may_differ_is_not() {
    let printed = |lines: &[&str]| lines.iter().map(|l| (*l).to_owned()).collect::<Vec<_>>();
    let one = printed(&["a  1.5", "Report: runs/20261123T054956-7/report.html", "z"]);
    assert!(agree(
        &["a 1.5", "Report: runs/20250101T000000-7/report.html", "z"],
        &one
    ));
    assert!(agree(&["a 1.5", "...", "z"], &one));
    assert!(!agree(&["a 1.6", "...", "z"], &one));
    assert!(!agree(&["a 1.5", "z"], &one));
    assert!(!agree(&["a 1.5", "...", "y"], &one));
}

/// What a page names of the program between backticks, as words; what stands for something else (`FOLDER`, `N`, `...`) is none.
fn named(text: &str, commands: &BTreeSet<String>) -> Vec<Vec<String>> {
    let span = Regex::new(r"`([^`]+)`").expect("a pattern");
    let fence = Regex::new(r"(?s)```.*?```").expect("a pattern");
    let prose = fence.replace_all(text, "");
    let stands = |word: &str| {
        word.contains("...")
            || word.contains(['<', '>', '|', '(', ')', '[', ']', '"', '*'])
            || word
                .split(['=', ',', '/', '-'])
                .any(|part| !part.is_empty() && part.chars().all(|c| c.is_ascii_uppercase()))
    };
    let mut all = Vec::new();
    for found in span.captures_iter(&prose) {
        let words = found[1].trim_start_matches("cargo run --release -- ");
        let mut words: Vec<String> = words.split_whitespace().map(str::to_owned).collect();
        let whole = words.first().is_some_and(|word| word == "pigtail");
        if whole {
            words.remove(0);
        }
        let is_one = words.first().is_some_and(|word| commands.contains(word));
        if (whole || words.len() > 1 && is_one) && !words.iter().any(|word| stands(word)) {
            all.push(words);
        }
    }
    all
}

#[test]
fn commands_that_pages_name_are_those_of_the_program() {
    let program = env!("CARGO_BIN_EXE_pigtail");
    let ask = |words: &[String]| {
        let asked = Command::new(program).args(words).arg("--help").output();
        asked.expect("the program starts")
    };
    let help = String::from_utf8(ask(&[]).stdout).expect("text");
    let of_help = Regex::new(r"(?m)^  ([a-z-]+)  ").expect("a pattern");
    let commands = of_help.captures_iter(&help).map(|c| c[1].to_owned());
    let commands: BTreeSet<String> = commands.collect();
    assert!(commands.contains("align"), "{commands:?}");
    let (mut wrong, mut asked) = (Vec::new(), BTreeSet::new());
    for page in pages() {
        for words in named(&read(&page), &commands) {
            if !asked.insert(words.clone()) {
                continue;
            }
            let answer = ask(&words);
            let error = String::from_utf8_lossy(&answer.stderr).into_owned();
            // A flag that is named without what it takes is no mistake: it takes the next word.
            let is_bare = ["a value is required for", "invalid value '--help' for"]
                .iter()
                .any(|why| error.contains(why));
            if !answer.status.success() && !is_bare {
                wrong.push(format!("{}: {}: {error}", page.display(), words.join(" ")));
            }
        }
    }
    assert!(asked.len() > 100, "{}", asked.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_command_that_is_none_is_seen_and_a_placeholder_is_not() {
    let commands = BTreeSet::from(["align".to_owned()]);
    let text = "`pigtail tune w`, `align --seed 7`, `align`, `pigtail tune AXIS`, `run --seed`\n```\n`align x`\n```\n";
    assert_eq!(
        named(text, &commands),
        [vec!["tune", "w"], vec!["align", "--seed", "7"]]
    );
}

/// The name by which a heading is linked to.
fn anchor(heading: &str) -> String {
    let plain = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = plain
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn headings(text: &str) -> BTreeSet<String> {
    text.lines()
        .filter(|line| line.starts_with('#'))
        .map(anchor)
        .collect()
}

#[test]
fn links_lead_to_what_is_there() {
    let link = Regex::new(r"\]\(([^)\s]+)\)").expect("a pattern");
    let mut broken = Vec::new();
    let mut links = 0;
    for page in pages() {
        let text = read(&page);
        let mut inside = false;
        for line in text.lines() {
            if line.starts_with("```") {
                inside = !inside;
            }
            if inside {
                continue;
            }
            for target in link.captures_iter(line).map(|found| found[1].to_owned()) {
                if target.contains("://") || target.starts_with("mailto:") {
                    continue;
                }
                links += 1;
                let (file, part) = target.split_once('#').unwrap_or((&target, ""));
                let of = match file {
                    "" => root().join(&page),
                    file => root().join(&page).with_file_name("").join(file),
                };
                let there = match fs::read_to_string(&of) {
                    Ok(text) => part.is_empty() || headings(&text).contains(part),
                    Err(_) => of.exists() && part.is_empty(),
                };
                if !there {
                    broken.push(format!("{}: {target}", page.display()));
                }
            }
        }
    }
    assert!(links > 100, "{links} links were found");
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn every_page_stands_in_the_summary() {
    let summary = read(Path::new("book/src/SUMMARY.md"));
    for page in pages() {
        let Ok(page) = page.strip_prefix("book/src") else {
            continue;
        };
        let listed = summary.contains(&format!("]({})", page.display()));
        assert!(
            listed || page == Path::new("SUMMARY.md"),
            "{}",
            page.display()
        );
    }
}
