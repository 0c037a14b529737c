//! The journal of a tray: every device on the disk before the next begins, and how `--resume` goes on from there.

use crate::Failure;
use anyhow::Context;
use pigtail_cycle::recipe::Action;
use pigtail_cycle::run::{Event, Pigtail, Produced};
use pigtail_evaluate::produce::{Heard, Told};
use pigtail_hal::Error;
use pigtail_session::produce::Loaded;
use pigtail_store::database::partial_folder;
use pigtail_store::runs::Run;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

const JOURNAL: &str = "journal.jsonl";

/// The first line of a journal: what has to be the same to go on.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Head {
    pub(crate) tray: String,
    pub(crate) seed: u64,
    pub(crate) rig: String,
    pub(crate) fleet: String,
    pub(crate) configuration: Vec<(String, String)>,
}

/// Its second: who was there.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Who {
    pub(crate) operator: String,
    pub(crate) calibration: String,
}

/// What a run that was interrupted has left.
#[derive(Default)]
pub(crate) struct Left {
    /// The run's name.
    pub(crate) run: String,
    pub(crate) who: Who,
    /// Its fibers, one by one.
    pub(crate) fibers: Vec<Pigtail>,
    /// All devices up to its end, those of runs before it too.
    pub(crate) told: Vec<Told>,
}

/// A line of a journal.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Line {
    Head(Head),
    Who(Who),
    Begin(String),
    Fiber(Pigtail),
    Device(Told),
}

/// What there was in a journal; `cleared` says that a person has taken a half-done device off the machine.
pub(crate) fn resumed(
    named: &str,
    runs: &Path,
    head: &Head,
    loaded: &Loaded,
    cleared: bool,
) -> Result<Left, Failure> {
    let folders = [
        PathBuf::from(named),
        partial_folder(runs, named),
        runs.join(named),
    ];
    let file = folders
        .iter()
        .map(|folder| folder.join(JOURNAL))
        .find(|file| file.is_file())
        .ok_or_else(|| {
            let message = format!(
                "no run of `produce` is called so in {}; accepted is the name or the folder of one",
                runs.display()
            );
            Error::new(format!("--resume {named}"), "", message)
        })?;
    let text = fs::read_to_string(&file).with_context(|| file.display().to_string())?;
    let name = file.display().to_string();
    let folder = file.parent().and_then(Path::file_name);
    let folder = folder.map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let mut left = Left {
        run: folder
            .strip_prefix('.')
            .and_then(|name| name.strip_suffix(".partial"))
            .unwrap_or(&folder)
            .to_owned(),
        ..Left::default()
    };
    let (mut begun, mut fibers) = (None, Vec::new());
    for (i, line) in text.split_inclusive('\n').enumerate() {
        // A line that was being written when all ended says nothing.
        if !line.ends_with('\n') {
            break;
        }
        let line: Line = serde_json::from_str(line)
            .map_err(|why| Error::new(&name, "", format!("line {}: {why}", i + 1)))?;
        match line {
            Line::Head(of) if of == *head => {}
            Line::Head(_) => {
                let message = "is of another tray, rig, fleet, recipe, calibration or seed; accepted is the same";
                return Err(Error::new(&name, "", message).into());
            }
            Line::Who(who) => left.who = who,
            Line::Begin(serial) => (begun, fibers) = (Some(serial), Vec::new()),
            Line::Fiber(fiber) => {
                left.fibers.push(fiber.clone());
                fibers.push(fiber);
            }
            Line::Device(device) => {
                begun = None;
                left.told.push(device);
            }
        }
    }
    let Some(serial) = begun else { return Ok(left) };
    let Some(device) = loaded.tray.devices.get(left.told.len()) else {
        return Ok(left);
    };
    let production = &loaded.productions[loaded.tray.recipe_of(device)];
    if production.interrupted == Action::Call && !cleared {
        let detail = format!(
            "{serial} was half done when the work was interrupted, and {} calls a person for that; once it is taken off the machine, --cleared goes on behind it",
            production.name
        );
        return Err(anyhow::anyhow!(detail).into());
    }
    let truth = vec![None; fibers.len()];
    left.told.push(Told {
        produced: Produced {
            serial,
            place: device.place.clone(),
            recipe: production.name.clone(),
            rejected: "interrupted".to_owned(),
            start: 0.0,
            end: 0.0,
            fibers,
        },
        truth,
    });
    Ok(left)
}

/// What is done, line by line, on the disk before anything goes on.
pub(crate) struct Journal(std::cell::RefCell<File>);

impl Journal {
    /// What it begins with is there whole or not at all: whoever goes on from it finds all that was done before.
    pub(crate) fn begin(
        run: &Run,
        head: &Head,
        who: &Who,
        before: &[Told],
    ) -> anyhow::Result<Self> {
        const BEING_WRITTEN: &str = "journal.jsonl.partial";
        let mut lines = vec![
            serde_json::json!({ "head": head }),
            serde_json::json!({ "who": who }),
        ];
        lines.extend(
            before
                .iter()
                .map(|told| serde_json::json!({ "device": told })),
        );
        let text: Vec<String> = lines.iter().map(|line| format!("{line}\n")).collect();
        let text = text.concat();
        run.write(BEING_WRITTEN, text)?;
        let (from, to) = (run.partial_path(BEING_WRITTEN), run.partial_path(JOURNAL));
        File::open(&from)?.sync_all()?;
        fs::rename(from, &to)?;
        Ok(Self(File::options().append(true).open(to)?.into()))
    }

    fn line(&self, line: &serde_json::Value) -> anyhow::Result<()> {
        let mut file = self.0.borrow_mut();
        file.write_all(format!("{line}\n").as_bytes())?;
        Ok(file.sync_data()?)
    }

    pub(crate) fn keep(&self, heard: &Heard) -> anyhow::Result<()> {
        match heard {
            Heard::Event(Event::Begin { device, .. }) => {
                self.line(&serde_json::json!({ "begin": device }))
            }
            Heard::Event(Event::Fiber(fiber)) => self.line(&serde_json::json!({ "fiber": fiber })),
            Heard::Device(told) => self.line(&serde_json::json!({ "device": told })),
            Heard::Event(_) => Ok(()),
        }
    }
}
