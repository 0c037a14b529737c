//! The records of a run: a file for each machine that it worked on.

use crate::job::Order;
use crate::rig::Source;
#[cfg(feature = "twin")]
use crate::setup::Setup;
use pigtail_machines::record::{Closing, RecordError, Written};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The stem and the ending of a record's name.
const NAME: (&str, &str) = ("exchanges", "pigtail");

/// The record of the one machine of a run that has one.
pub const RECORD: &str = "exchanges.pigtail";

/// The records in a folder, by name; none where there is no such folder.
pub fn records_in(folder: &Path) -> Vec<PathBuf> {
    let (stem, ending) = NAME;
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut records: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().and_then(|name| name.to_str());
            name.is_some_and(|name| name.starts_with(stem))
                && path
                    .extension()
                    .is_some_and(|extension| extension == ending)
        })
        .collect();
    records.sort();
    records
}

/// What a record says of its run: all that it takes to run the same control again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The program's version.
    pub version: String,
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// The procedure of an alignment; empty for other jobs.
    pub procedure: String,
    /// How the truth was changed.
    pub scenario: String,
    /// What was broken on purpose.
    pub faults: String,
    /// The seed.
    pub seed: u64,
    /// Every file that was read.
    pub sources: Vec<Source>,
    /// The job; `None` in records of before there were others than alignments.
    #[serde(default)]
    pub order: Option<Order>,
}

#[cfg(feature = "twin")]
impl About {
    pub(crate) fn of(setup: &Setup, order: Order, seed: u64) -> Self {
        let procedure = match &order {
            Order::Align(align) => align.procedure.name(),
            _ => "",
        };
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            rig: setup.rig.name.clone(),
            recipe: setup.rig.recipe_name.clone(),
            procedure: procedure.to_owned(),
            scenario: setup.scenario.name().to_owned(),
            faults: setup.faults.to_string(),
            seed,
            sources: setup.rig.sources.clone(),
            order: Some(order),
        }
    }

    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("texts and numbers are JSON")
    }
}

/// Where the records of a run go, and those that are on their way to the disk.
#[derive(Debug)]
pub struct Records {
    folder: PathBuf,
    /// How many there are of each label.
    taken: Mutex<BTreeMap<String, u32>>,
    closing: Mutex<Vec<Closing>>,
}

impl Records {
    /// In this folder.
    pub fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            taken: Mutex::default(),
            closing: Mutex::default(),
        }
    }

    /// The path of the next record with a label.
    pub fn take(&self, label: &str) -> PathBuf {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let number = taken.entry(label.to_owned()).or_default();
        *number += 1;
        let (stem, ending) = NAME;
        let label = match label {
            "" => String::new(),
            label => format!("-{label}"),
        };
        let number = match *number {
            1 => String::new(),
            number => format!("-{number}"),
        };
        self.folder.join(format!("{stem}{label}{number}.{ending}"))
    }

    /// Keeps a record that is on its way to the disk until somebody waits for it.
    pub fn keep(&self, closing: Closing) {
        let mut all = self.closing.lock().unwrap_or_else(PoisonError::into_inner);
        all.push(closing);
    }

    /// Waits until all of them are on the disk: their files' names and what became of each.
    ///
    /// # Errors
    ///
    /// When one could not be written to its end.
    pub fn wait(&self) -> Result<Vec<(String, Written)>, RecordError> {
        let all = std::mem::take(&mut *self.closing.lock().unwrap_or_else(PoisonError::into_inner));
        all.into_iter()
            .map(|closing| {
                let name = closing.path().file_name().unwrap_or_default();
                let name = name.to_string_lossy().into_owned();
                Ok((name, closing.wait()?))
            })
            .collect()
    }
}
