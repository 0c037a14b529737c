//! A belief as files: a `calibration.toml`, and the weights that it names, which stand beside it.

use pigtail_control::calibration::Calibration;
use pigtail_hal::digest::hash;
use pigtail_hal::{Error, Spec};
use serde::{Deserialize, Serialize};
use std::path::Path;
use toml_edit::{DocumentMut, Item, Table, value};

/// So many digits of a hash tell one file from another to a person.
pub const SHORT: usize = 8;

/// A calibration as its text, and the weights that it names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Belief {
    /// What to call it in errors.
    pub name: String,
    /// The content of the `calibration.toml`.
    pub text: String,
    /// Name and content of each file of weights that it names and that is there.
    pub weights: Vec<(String, String)>,
}

/// What an experiment found: keys of a table, and perhaps weights.
#[derive(Debug, Clone)]
pub struct Change {
    /// The table, dotted.
    pub table: String,
    /// Its keys; none removes the key.
    pub values: Vec<(&'static str, Item)>,
    /// Name and content of a file of weights that it names.
    pub weights: Option<(String, String)>,
}

impl Belief {
    /// Reads a `calibration.toml` and the weights beside it.
    ///
    /// # Errors
    ///
    /// When it cannot be read. What is not TOML, and weights that are not there, are missed by [`Self::check`].
    pub fn read(file: &Path) -> Result<Self, Error> {
        let name = file.display().to_string();
        let text = std::fs::read_to_string(file)
            .map_err(|error| Error::new(&name, "", format!("cannot be read: {error}")))?;
        Ok(Self::of(&name, text, |weights| {
            std::fs::read_to_string(file.with_file_name(weights)).ok()
        }))
    }

    /// Of a text, and where its weights are.
    pub fn of(name: &str, text: String, read: impl Fn(&str) -> Option<String>) -> Self {
        let mut belief = Self {
            name: name.to_owned(),
            text,
            weights: Vec::new(),
        };
        if let Ok(document) = belief.document() {
            let there = |(_, file): (String, String)| read(&file).map(|content| (file, content));
            let named = named_weights(&document).into_iter();
            belief.weights = named.filter_map(there).collect();
        }
        belief
    }

    /// The text, parsed.
    ///
    /// # Errors
    ///
    /// When it is not TOML.
    pub fn document(&self) -> Result<DocumentMut, Error> {
        self.text
            .parse()
            .map_err(|error| Error::new(&self.name, "", format!("is not TOML: {error}")))
    }

    /// Whether control can read it.
    ///
    /// # Errors
    ///
    /// The first mistake found.
    pub fn check(&self, spec: &Spec) -> Result<(), Error> {
        let mut calibration = Calibration::parse(&self.name, &self.text, spec)?;
        for belief in calibration.hysteresis.beliefs() {
            let Some(file) = &belief.weights else {
                continue;
            };
            let found = self.weights.iter().find(|(name, _)| name == file);
            let Some((_, content)) = found else {
                let message =
                    "names weights that are not there; accepted is a file beside the calibration";
                return Err(Error::new(&self.name, file, message));
            };
            let model = serde_json::from_str(content).map_err(|error| {
                let message = format!("{error}; accepted is what `identify hysteresis` writes");
                Error::new(file, "", message)
            })?;
            let file = file.clone();
            belief.load(&file, model)?;
        }
        Ok(())
    }

    /// Sets what was found, and leaves the rest of the text as a person wrote it.
    ///
    /// # Errors
    ///
    /// When the text is not TOML.
    pub fn change(&mut self, change: &Change) -> Result<(), Error> {
        let mut document = self.document()?;
        let table = table_at(&mut document, &change.table);
        for (key, value) in &change.values {
            table[key] = value.clone();
        }
        self.weights.extend(change.weights.clone());
        self.put(&document);
        Ok(())
    }

    /// Believes nothing more of what a table says, if there is one.
    ///
    /// # Errors
    ///
    /// When the text is not TOML.
    pub fn remove(&mut self, table: &str) -> Result<(), Error> {
        let mut document = self.document()?;
        *table_at(&mut document, table) = Item::None;
        self.put(&document);
        Ok(())
    }

    /// Takes a table of another belief, with its weights, in place of its own; where the other has none, it has none either.
    ///
    /// # Errors
    ///
    /// When either is not TOML.
    pub fn take(&mut self, other: &Self, table: &str) -> Result<(), Error> {
        let from = other.document()?;
        let mut document = self.document()?;
        let taken = table
            .split('.')
            .try_fold(from.as_item(), |item, key| item.get(key));
        *table_at(&mut document, table) = taken.cloned().unwrap_or_default();
        self.weights.extend(other.weights.iter().cloned());
        self.put(&document);
        Ok(())
    }

    fn put(&mut self, document: &DocumentMut) {
        let named = named_weights(document);
        self.text = document.to_string();
        // The last of a name is what came last.
        let last =
            |(_, file): &(String, String)| self.weights.iter().rev().find(|(name, _)| name == file);
        self.weights = named.iter().filter_map(last).cloned().collect();
    }

    /// Names each file of weights by its table and its content: two models never have the same file.
    ///
    /// # Errors
    ///
    /// When the text is not TOML.
    pub fn name_by_content(&mut self) -> Result<(), Error> {
        let mut document = self.document()?;
        let mut weights = Vec::new();
        for (table, file) in named_weights(&document) {
            let Some((_, content)) = self.weights.iter().find(|(name, _)| *name == file) else {
                continue;
            };
            let short = &hash(content)[..SHORT];
            let name = format!("{}-{short}.json", table.replace('.', "-"));
            table_at(&mut document, &table)["weights"] = value(&name);
            weights.push((name, content.clone()));
        }
        self.text = document.to_string();
        self.weights = weights;
        Ok(())
    }

    /// All of its files, name and content, the calibration first.
    pub fn files(&self) -> impl Iterator<Item = (&str, &str)> {
        let calibration = std::iter::once((super::FILE, self.text.as_str()));
        let weights = self.weights.iter();
        calibration.chain(weights.map(|(name, text)| (name.as_str(), text.as_str())))
    }

    /// The text without some tables, for whoever is about to replace them.
    pub(crate) fn without(text: &str, tables: &[&str]) -> String {
        if tables.is_empty() {
            return text.to_owned();
        }
        // What is not TOML is explained by whoever parses it.
        let Ok(mut document) = text.parse::<DocumentMut>() else {
            return text.to_owned();
        };
        for table in tables {
            let mut keys = table.split('.');
            let last = keys.next_back().unwrap_or_default();
            let inside = keys.try_fold(document.as_item_mut(), |item, key| item.get_mut(key));
            if let Some(inside) = inside.and_then(Item::as_table_like_mut) {
                inside.remove(last);
            }
        }
        document.to_string()
    }
}

/// A table by its dotted name, made where it is not there.
fn table_at<'d>(document: &'d mut DocumentMut, table: &str) -> &'d mut Item {
    let mut item = document.as_item_mut();
    for key in table.split('.') {
        item = &mut item[key];
        if item.is_none() {
            // A table that only holds tables needs no header of its own.
            let mut new = Table::new();
            new.set_implicit(true);
            *item = Item::Table(new);
        }
    }
    item
}

/// The files of weights that a calibration names, each behind its table.
fn named_weights(document: &DocumentMut) -> Vec<(String, String)> {
    let tables = document.get("hysteresis").and_then(Item::as_table_like);
    let all = tables.into_iter().flat_map(|tables| tables.iter());
    all.filter_map(|(side, belief)| {
        let file = belief.get("weights")?.as_str()?;
        Some((format!("hysteresis.{side}"), file.to_owned()))
    })
    .collect()
}
