//! The table of what the thesis states, draws or proposes (`book/thesis.toml`): whatever it names exists, and the
//! book's page is made from it. `UPDATE_PAGES=1 cargo test -p pigtail --test thesis` writes the page anew.

use pigtail_reproduce::{claims, experiments};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// Chapters, as the page calls them.
const CHAPTERS: [(&str, &str); 5] = [
    ("1", "Introduction"),
    ("2", "Control of the macro manipulator"),
    ("3", "Path planning"),
    ("4", "Nonlinear control methods"),
    ("5", "Conclusions"),
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    item: Vec<Item>,
}

/// What the thesis states, draws or proposes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Item {
    section: String,
    what: String,
    #[serde(rename = "where")]
    places: Vec<String>,
    verdict: Verdict,
    #[serde(default)]
    why: String,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[serde(rename_all = "kebab-case")]
enum Verdict {
    Done,
    Differently,
    Partly,
    Missing,
}

impl Verdict {
    fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Differently => "done differently",
            Self::Partly => "partly",
            Self::Missing => "missing",
        }
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> Option<String> {
    fs::read_to_string(root().join(path)).ok()
}

fn table() -> Vec<Item> {
    let text = read("book/thesis.toml").expect("the table");
    toml::from_str::<Table>(&text).expect("a table").item
}

fn command(words: &str) -> Option<clap::Command> {
    words
        .split(' ')
        .try_fold(pigtail::command(), |command, word| {
            command.find_subcommand(word).cloned()
        })
}

/// Whether a file of the shipped rig or recipe has a key.
fn has_key(key: &str) -> bool {
    let files = [
        "rigs/afpm/machine.toml",
        "rigs/afpm/plant.toml",
        "rigs/afpm/calibration.toml",
        "recipes/y-branch.toml",
    ];
    files.iter().any(|file| {
        let text = read(file).expect("a shipped file");
        let shipped: toml::Value = toml::from_str(&text).expect("a shipped file");
        key.split('.')
            .try_fold(&shipped, |at, part| at.get(part))
            .is_some()
    })
}

/// Whether a file declares something of this name.
fn declares(file: &str, name: &str) -> bool {
    let Some(text) = read(file) else { return false };
    ["fn", "struct", "enum", "const"].iter().any(|word| {
        text.match_indices(&format!("{word} {name}"))
            .any(|(at, found)| {
                let after = text[at + found.len()..].chars().next();
                after.is_none_or(|c| !c.is_alphanumeric() && c != '_')
            })
    })
}

/// What a place is in the page; `None` where there is no such thing.
fn shown(place: &str) -> Option<String> {
    let (kind, name) = place.split_once(' ')?;
    match kind {
        "claim" => claims::all()
            .any(|claim| claim.id == name)
            .then(|| format!("claim `{name}`")),
        "figure" => {
            let made = experiments().any(|e| e.figures.contains(&name));
            let drawn = format!("book/src/pictures/thesis-{name}.svg");
            if root().join(drawn).exists() {
                return Some(format!("[drawing](../pictures/thesis-{name}.svg)"));
            }
            made.then(|| format!("`pigtail reproduce {name}`"))
        }
        "command" => command(name).map(|_| {
            let link = name.replace(' ', "-");
            format!("[`pigtail {name}`](commands.md#pigtail-{link})")
        }),
        "option" => {
            let (words, option) = name.split_once(" --")?;
            command(words)?
                .get_arguments()
                .any(|a| a.get_long() == Some(option))
                .then(|| format!("`pigtail {name}`"))
        }
        "function" => {
            let (file, function) = name.split_once(' ')?;
            let short = file.replace("crates/", "").replace("/src/", "/");
            declares(file, function).then(|| format!("`{function}` in `{short}`"))
        }
        "file" => root().join(name).exists().then(|| format!("`{name}`")),
        "page" => {
            let file = format!("book/src/{name}.md");
            let title = read(&file)?
                .lines()
                .next()?
                .trim_start_matches("# ")
                .to_owned();
            Some(format!("[{title}](../{name}.md)"))
        }
        "key" => has_key(name).then(|| format!("key `{name}`")),
        _ => None,
    }
}

#[test]
fn what_the_table_names_exists() {
    let mut wrong = Vec::new();
    for item in table() {
        for place in &item.places {
            if shown(place).is_none() {
                wrong.push(format!("{}: {}: no {place}", item.section, item.what));
            }
        }
        if item.verdict != Verdict::Missing && item.places.is_empty() {
            wrong.push(format!("{}: {}: nowhere", item.section, item.what));
        }
        if (item.verdict == Verdict::Done) != item.why.is_empty() {
            wrong.push(format!(
                "{}: {}: a reason for what is done, or none for what is not",
                item.section, item.what
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_figure_and_claim_of_reproduce_has_a_place_in_the_table() {
    let places: Vec<String> = table().into_iter().flat_map(|item| item.places).collect();
    let named = |kind: &str, name: &str| places.contains(&format!("{kind} {name}"));
    let figures = experiments().flat_map(|e| e.figures.iter().copied());
    let lost: Vec<&str> = figures
        .filter(|id| {
            let of_it = claims::all().filter(|claim| claim.figure() == *id);
            !named("figure", id) && !of_it.into_iter().any(|claim| named("claim", claim.id))
        })
        .collect();
    assert!(lost.is_empty(), "{lost:?}");
}

#[test]
fn the_page_of_the_thesis_is_what_the_table_says() {
    let table = table();
    let mut counts: BTreeMap<Verdict, usize> = BTreeMap::new();
    for item in &table {
        *counts.entry(item.verdict).or_default() += 1;
    }
    let counted: Vec<String> = counts
        .iter()
        .map(|(verdict, n)| format!("{n} {}", verdict.name()))
        .collect();
    let mut text = format!(
        "# The thesis, item by item\n\nWhat the thesis states, draws or proposes, in its order, and where it is \
         here: {} items, {}. *Done differently* has a reason, which stands below the item; *partly* and *missing* \
         say what is not there. A claim is a row of [`pigtail reproduce`](../howto/reproduce.md), which says how near \
         it comes. The page is made from `book/thesis.toml`; a test holds that all that it names exists.\n",
        table.len(),
        counted.join(", ")
    );
    for (chapter, title) in CHAPTERS {
        let _ = write!(
            text,
            "\n## {chapter} {title}\n\n| | the thesis | here | |\n|---|---|---|---|\n"
        );
        for item in table.iter().filter(|i| i.section.starts_with(chapter)) {
            let places: Vec<String> = item
                .places
                .iter()
                .map(|place| shown(place).unwrap_or_else(|| place.clone()))
                .collect();
            let why = if item.why.is_empty() {
                String::new()
            } else {
                format!("<br>*{}*", item.why)
            };
            let _ = writeln!(
                text,
                "| {} | {}{why} | {} | {} |",
                item.section,
                item.what,
                places.join("; "),
                item.verdict.name()
            );
        }
    }
    let path = root().join("book/src/reference/thesis.md");
    if std::env::var_os("UPDATE_PAGES").is_some() {
        fs::write(&path, &text).expect("the page can be written");
    }
    let there = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        there == text,
        "{} is out of date; `UPDATE_PAGES=1 cargo test -p pigtail --test thesis` writes it",
        path.display()
    );
}
