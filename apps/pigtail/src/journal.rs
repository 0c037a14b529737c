//! The journals of a tray and of many: what is done on the disk before anything goes on, and how `--resume` goes on from there.

use crate::Failure;
use anyhow::Context;
use pigtail_cycle::recipe::Action;
use pigtail_cycle::run::{Event, Pigtail, Produced};
use pigtail_evaluate::produce::{Heard, Told};
use pigtail_evaluate::trays::TrayDone;
use pigtail_hal::Error;
use pigtail_session::commission::StepDone;
use pigtail_session::piezos::PiezoModel;
use pigtail_session::produce::{InPlace, Loaded};
use pigtail_store::database::partial_folder;
use pigtail_store::runs::Run;
use serde::de::DeserializeOwned;
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
    /// What was said beside the recipes, and whether machines were commissioned.
    #[serde(default)]
    pub(crate) in_place: InPlace,
    #[serde(default)]
    pub(crate) commissioned: bool,
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
    Fiber(Box<Pigtail>),
    Device(Told),
}

impl Head {
    /// Refuses what is of another.
    fn is(&self, head: &Self, file: &Path) -> Result<(), Error> {
        if self == head {
            return Ok(());
        }
        let message = "is of another tray, rig, fleet, recipe, calibration, seed or options; accepted are the same";
        Err(Error::new(file.display().to_string(), "", message))
    }
}

/// The journal of a run that is named so.
fn found(named: &str, runs: &Path, journal: &str, command: &str) -> Result<PathBuf, Error> {
    let folders = [
        PathBuf::from(named),
        partial_folder(runs, named),
        runs.join(named),
    ];
    let mut files = folders.iter().map(|folder| folder.join(journal));
    files.find(|file| file.is_file()).ok_or_else(|| {
        if folders.iter().any(|folder| folder.is_dir()) {
            let message = format!(
                "has no {journal}: it is none of `{command}`, or ended before anything was done; accepted is one that has it, such as that which \
                 it was to go on from. Without --resume all is begun anew"
            );
            return Error::new(format!("--resume {named}"), "", message);
        }
        let message = format!(
            "no run of `{command}` is called so in {}; accepted is the name or the folder of one",
            runs.display()
        );
        Error::new(format!("--resume {named}"), "", message)
    })
}

/// The lines of a journal. One that was being written when all ended says nothing.
fn lines<L: DeserializeOwned>(file: &Path) -> anyhow::Result<Vec<L>> {
    let name = file.display().to_string();
    let text = fs::read_to_string(file).with_context(|| name.clone())?;
    let whole = text
        .split_inclusive('\n')
        .take_while(|line| line.ends_with('\n'));
    let read = whole.enumerate().map(|(i, line)| {
        let line = serde_json::from_str(line);
        line.map_err(|why| Error::new(&name, "", format!("line {}: {why}", i + 1)).into())
    });
    read.collect()
}

/// Begins a journal. What it begins with is there whole or not at all: whoever goes on from it finds all that was done before.
fn begin(run: &Run, journal: &str, lines: &[serde_json::Value]) -> anyhow::Result<File> {
    let being_written = format!("{journal}.partial");
    let mut text = String::new();
    for line in lines {
        text += &line.to_string();
        text.push('\n');
    }
    run.write(&being_written, text)?;
    let (from, to) = (run.partial_path(&being_written), run.partial_path(journal));
    File::open(&from)?.sync_all()?;
    fs::rename(from, &to)?;
    Ok(File::options().append(true).open(to)?)
}

/// Writes a line, on the disk before anything goes on.
fn write(file: &mut File, line: &serde_json::Value) -> anyhow::Result<()> {
    file.write_all(format!("{line}\n").as_bytes())?;
    Ok(file.sync_data()?)
}

/// What there was in a journal; `cleared` says that a person has taken a half-done device off the machine.
pub(crate) fn resumed(
    named: &str,
    runs: &Path,
    head: &Head,
    loaded: &Loaded,
    cleared: bool,
) -> Result<Left, Failure> {
    let file = found(named, runs, JOURNAL, "produce")?;
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
    for line in lines(&file)? {
        match line {
            Line::Head(of) => of.is(head, &file)?,
            Line::Who(who) => left.who = who,
            Line::Begin(serial) => (begun, fibers) = (Some(serial), Vec::new()),
            Line::Fiber(fiber) => {
                left.fibers.push((*fiber).clone());
                fibers.push(*fiber);
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
    pub(crate) fn begin(
        run: &Run,
        head: &Head,
        who: &Who,
        before: &[Told],
    ) -> anyhow::Result<Self> {
        let mut lines = vec![
            serde_json::json!({ "head": head }),
            serde_json::json!({ "who": who }),
        ];
        let devices = before.iter();
        lines.extend(devices.map(|told| serde_json::json!({ "device": told })));
        Ok(Self(begin(run, JOURNAL, &lines)?.into()))
    }

    fn line(&self, line: &serde_json::Value) -> anyhow::Result<()> {
        write(&mut self.0.borrow_mut(), line)
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

/// A line of a journal of many trays.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum TrayLine {
    Head(Head),
    Tray(Box<TrayDone>),
}

/// Many trays, each on the disk once it and all before it are done.
pub(crate) struct TrayJournal {
    file: File,
    /// Those that were run, not refused.
    run: usize,
}

impl TrayJournal {
    const FILE: &'static str = "trays.jsonl";

    pub(crate) fn begin(run: &Run, head: &Head, before: &[TrayDone]) -> anyhow::Result<Self> {
        let mut lines = vec![serde_json::json!({ "head": head })];
        let trays = before.iter();
        lines.extend(trays.map(|tray| serde_json::json!({ "tray": tray })));
        Ok(Self {
            file: begin(run, Self::FILE, &lines)?,
            run: before.iter().filter(|tray| tray.document.is_some()).count(),
        })
    }

    pub(crate) fn keep(&mut self, tray: &TrayDone) -> anyhow::Result<()> {
        self.run += usize::from(tray.document.is_some());
        write(&mut self.file, &serde_json::json!({ "tray": tray }))
    }

    /// Whether no tray was run.
    pub(crate) fn is_empty(&self) -> bool {
        self.run == 0
    }

    /// The trays that a run which was interrupted has done.
    pub(crate) fn resumed(named: &str, runs: &Path, head: &Head) -> Result<Vec<TrayDone>, Failure> {
        let file = found(named, runs, Self::FILE, "produce --trays")?;
        let mut trays = Vec::new();
        for line in lines(&file)? {
            match line {
                TrayLine::Head(of) => of.is(head, &file)?,
                TrayLine::Tray(tray) => trays.push(*tray),
            }
        }
        Ok(trays)
    }
}

/// What has to be the same for commissioning to go on.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CommissionHead {
    pub(crate) rig: String,
    pub(crate) fleet: String,
    pub(crate) seed: u64,
    /// Of the acceptance test.
    pub(crate) devices: u64,
    #[serde(default)]
    pub(crate) piezo_model: PiezoModel,
    pub(crate) configuration: Vec<(String, String)>,
}

/// A line of a journal of commissioning.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StepLine {
    Head(CommissionHead),
    Step(Box<StepDone>),
}

/// Steps of commissioning, each on the disk before the next begins.
pub(crate) struct CommissionJournal(File);

impl CommissionJournal {
    const FILE: &'static str = "steps.jsonl";

    pub(crate) fn begin(
        run: &Run,
        head: &CommissionHead,
        before: &[StepDone],
    ) -> anyhow::Result<Self> {
        let mut lines = vec![serde_json::json!({ "head": head })];
        let steps = before.iter();
        lines.extend(steps.map(|step| serde_json::json!({ "step": step })));
        Ok(Self(begin(run, Self::FILE, &lines)?))
    }

    pub(crate) fn keep(&mut self, step: &StepDone) -> anyhow::Result<()> {
        write(&mut self.0, &serde_json::json!({ "step": step }))
    }

    /// The steps that a run has done.
    pub(crate) fn resumed(
        named: &str,
        runs: &Path,
        head: &CommissionHead,
    ) -> Result<Vec<StepDone>, Failure> {
        let file = found(named, runs, Self::FILE, "commission")?;
        let mut steps = Vec::new();
        for line in lines(&file)? {
            match line {
                StepLine::Head(of) if of != *head => {
                    let message = "is of another rig, fleet, recipe, calibration, seed, model of piezos or number of devices; accepted are the same";
                    return Err(Error::new(file.display().to_string(), "", message).into());
                }
                StepLine::Head(_) => {}
                StepLine::Step(step) => steps.push(*step),
            }
        }
        Ok(steps)
    }
}
