//! What a run is a run of, told from the command that made it.

use clap::ArgMatches;
use clap::parser::ValueSource;
use pigtail_hal::Error;
use std::fs;
use std::path::Path;

/// Arguments with which a command does something else, with other results.
const CHOICES: [&str; 6] = ["what", "trays", "map", "data", "machines", "shapes"];

/// The command of a run in words, such as `characterize step` or `produce --trays`; `None` where its folder does not say,
/// or where it was no command of this program.
fn of(folder: &Path) -> Option<String> {
    let text = fs::read_to_string(folder.join("run.json")).ok()?;
    let run: serde_json::Value = serde_json::from_str(&text).ok()?;
    let words = run["command"].as_array()?.iter();
    let words: Vec<&str> = words.filter_map(serde_json::Value::as_str).collect();
    let matches = crate::command().try_get_matches_from(words).ok()?;
    let mut kind = Vec::new();
    let mut at = &matches;
    while let Some((name, below)) = at.subcommand() {
        kind.push(name.to_owned());
        at = below;
    }
    kind.extend(CHOICES.iter().filter_map(|id| chosen(at, id)));
    (!kind.is_empty()).then(|| kind.join(" "))
}

/// How a choice stands in a kind, where it was made.
fn chosen(at: &ArgMatches, id: &str) -> Option<String> {
    at.try_contains_id(id).ok()?;
    if at.value_source(id) != Some(ValueSource::CommandLine) {
        return None;
    }
    if id == "what" {
        let what = at.get_raw(id)?.next()?;
        return Some(what.to_string_lossy().into_owned());
    }
    Some(format!("--{id}"))
}

/// Refuses two runs that measured different things: their results have no values in common that mean the same.
pub(crate) fn alike(a: &Path, b: &Path) -> Result<(), Error> {
    let kinds = (of(a), of(b));
    let (Some(of_a), Some(of_b)) = kinds else {
        return Ok(());
    };
    if of_a == of_b {
        return Ok(());
    }
    let message = format!(
        "is a run of `{of_b}`, and {} one of `{of_a}`; accepted are two runs of one kind",
        a.display()
    );
    Err(Error::new(b.display().to_string(), "", message))
}
