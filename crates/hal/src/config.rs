//! Reading a TOML text so that a mistake in it is explained.

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path, Segment, Track};
use std::fmt::Write as _;
use toml::Spanned;
use toml::de::DeTable;

/// Bad input, found while loading: which file, which key, what is wrong and what is accepted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.sentence())]
pub struct Error {
    /// The file, as the user named it.
    pub file: String,
    /// The line in it, from one, where it is known.
    pub line: Option<usize>,
    /// The key, dotted: `five_bar.motor.inertia`. Empty when the whole file is meant.
    pub key: String,
    /// What is wrong, and what would be accepted.
    pub message: String,
}

impl Error {
    /// An error about `key` of `file` whose line is not known.
    pub fn new(
        file: impl Into<String>,
        key: impl Into<String>,
        message: impl Into<String>,
    ) -> Self {
        Self {
            file: file.into(),
            line: None,
            key: key.into(),
            message: message.into(),
        }
    }

    fn sentence(&self) -> String {
        let mut text = self.file.clone();
        if let Some(line) = self.line {
            let _ = write!(text, ", line {line}");
        }
        if !self.key.is_empty() {
            let _ = write!(text, ", key `{}`", self.key);
        }
        let _ = write!(text, ": {}", self.message);
        text
    }
}

/// Parses `text`, the content of `file`. Unknown keys are errors where `T` says so.
///
/// # Errors
///
/// When the text is not TOML, or a key is unknown, missing or out of its range.
pub fn parse<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, Error> {
    let not_toml = |error: &toml::de::Error| Error {
        file: file.to_owned(),
        line: error.span().map(|span| line_of(text, span.start)),
        key: String::new(),
        message: error.message().to_owned(),
    };
    let table = DeTable::parse(text).map_err(|error| not_toml(&error))?;
    let mut track = Track::new();
    let tracked =
        serde_path_to_error::Deserializer::new(toml::Deserializer::from(table), &mut track);
    // Erased, so that what a type accepts is compiled once for it, and what TOML is once for all types:
    // otherwise each type brings its own copy of both.
    let mut erased = <dyn erased_serde::Deserializer>::erase(tracked);
    let read = erased_serde::deserialize(&mut erased);
    drop(erased);
    read.map_err(|error| explain(file, text, &track.path(), &error.to_string()))
}

/// The same of a table that has been parsed; `file` is where it comes from.
///
/// # Errors
///
/// When a key is unknown, missing or out of its range.
pub fn read<T: DeserializeOwned>(file: &str, table: toml::Table) -> Result<T, Error> {
    let mut track = Track::new();
    let tracked = serde_path_to_error::Deserializer::new(table, &mut track);
    let mut erased = <dyn erased_serde::Deserializer>::erase(tracked);
    let read = erased_serde::deserialize(&mut erased);
    drop(erased);
    read.map_err(|error| Error::new(file, key_of(&track.path()), first_line(&error.to_string())))
}

/// What is wrong at `path` of a text that is TOML.
fn explain(file: &str, text: &str, path: &Path, message: &str) -> Error {
    Error {
        file: file.to_owned(),
        line: DeTable::parse(text)
            .ok()
            .map(|table| line_of(text, start_of(&table, path))),
        key: key_of(path),
        message: first_line(message),
    }
}

fn key_of(path: &Path) -> String {
    match path.to_string() {
        whole if whole == "." => String::new(),
        path => path,
    }
}

/// Below its message an error of TOML lists the tables around it, which the key says already; and what is accepted it calls by its type.
fn first_line(message: &str) -> String {
    /// Types of numbers, and what a person would call them.
    const NUMBERS: [(&[&str], &str); 3] = [
        (
            &["u8", "u16", "u32", "u64", "usize"],
            "a whole number, zero or more",
        ),
        (&["i8", "i16", "i32", "i64", "isize"], "a whole number"),
        (&["f32", "f64"], "a number"),
    ];
    let message = message
        .split("\nin `")
        .next()
        .unwrap_or_default()
        .trim_end();
    let called = message
        .rsplit_once(", expected ")
        .and_then(|(wrong, name)| {
            let (_, called) = NUMBERS.iter().find(|(names, _)| names.contains(&name))?;
            Some(format!("{wrong}; accepted is {called}"))
        });
    called.unwrap_or_else(|| message.to_owned())
}

/// Where in a text the value at `path` starts; what lacks there starts where its table does.
fn start_of(table: &Spanned<DeTable>, path: &Path) -> usize {
    let mut start = table.span().start;
    let mut keys = path.iter();
    let Some(Segment::Map { key }) = keys.next() else {
        return start;
    };
    let Some(mut value) = table.get_ref().get(key.as_str()) else {
        return start;
    };
    loop {
        start = value.span().start;
        let inner = match keys.next() {
            Some(Segment::Map { key }) => value.get_ref().get(key.as_str()),
            Some(Segment::Seq { index }) => value.get_ref().get(*index),
            _ => None,
        };
        match inner {
            Some(inner) => value = inner,
            None => return start,
        }
    }
}

fn line_of(text: &str, byte: usize) -> usize {
    text.bytes().take(byte).filter(|&b| b == b'\n').count() + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        noise: Noise,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Noise {
        #[serde(with = "quantity::NonNegativeVoltage")]
        volts: f64,
    }

    #[test]
    fn an_error_names_file_line_key_value_and_what_is_accepted() {
        let error = parse::<File>("plant.toml", "\n[noise]\nvolts = \"-3 mV\"\n").unwrap_err();
        let text = error.to_string();
        assert_eq!(error.line, Some(3));
        assert_eq!(error.key, "noise.volts");
        for part in ["plant.toml", "-3 mV", "zero or more"] {
            assert!(text.contains(part), "{text}");
        }
        assert_eq!(text.lines().count(), 1, "{text}");
    }

    #[test]
    fn a_number_of_another_kind_is_told_in_words() {
        #[derive(Debug, serde::Deserialize)]
        struct Turns {
            #[expect(dead_code, reason = "only its error is asked for")]
            turns: u32,
        }
        let text = parse::<Turns>("a.toml", "turns = -10\n").unwrap_err();
        let text = text.to_string();
        assert!(
            text.ends_with("integer `-10`; accepted is a whole number, zero or more"),
            "{text}"
        );
    }

    #[test]
    fn a_number_without_its_unit_is_told_what_it_lacks() {
        let text = parse::<File>("plant.toml", "[noise]\nvolts = 3\n")
            .unwrap_err()
            .to_string();
        assert!(
            text.contains("\"3\" is not a voltage") && text.contains("mV"),
            "{text}"
        );
    }

    #[test]
    fn unknown_keys_and_other_texts_are_errors() {
        let error = parse::<File>("a", "[noise]\nvolts = \"1 V\"\nwatts = 1\n").unwrap_err();
        assert!(error.to_string().contains("watts"), "{error}");
        let error = parse::<File>("a", "volts : 1").unwrap_err();
        assert_eq!(error.line, Some(1));
        assert_eq!(
            parse::<File>("a", "[noise]\nvolts = \"1 V\"\n")
                .unwrap()
                .noise
                .volts,
            1.0
        );
    }
}
