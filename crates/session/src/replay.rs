//! A recorded run, through the same control again.

use crate::align::{self, About};
use crate::procedure::Procedure;
use crate::rig::Setup;
use anyhow::Result;
use pigtail_control::outcome::OutcomeCode;
use pigtail_control::station::Unobserved;
use pigtail_hal::{Error, Rule};
use pigtail_machines::Replay;
use pigtail_machines::record::Reader;
use serde::Serialize;
use std::path::Path;
use strum::VariantArray;

/// The file of a run's record.
pub const RECORD: &str = "exchanges.pigtail";

/// What a replay prints as JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Document {
    /// The record.
    pub record: String,
    /// Whether control gave every command again, to the last bit.
    pub same: bool,
    /// Exchanges that were as recorded.
    pub exchanges: u64,
    /// Machine time of the last of them, seconds.
    pub seconds: f64,
    /// The first difference.
    pub difference: Option<String>,
    /// Exchanges that were recorded and that control no longer asked for.
    pub left: u64,
    /// Whether the record ends before its run did, as that of a killed one.
    pub cut: bool,
    /// What control says of the fibers, in the replay.
    pub outcomes: Vec<(&'static str, OutcomeCode)>,
    /// The version that recorded it.
    pub recorded_by: String,
    /// The version that replayed it.
    pub version: &'static str,
}

/// Replays a record through the control of this program.
///
/// # Errors
///
/// When the record cannot be read, or what was kept with it is not what an alignment keeps.
pub fn replay(path: &Path) -> Result<Document> {
    let name = path.display().to_string();
    let reader = Reader::open(path)?;
    let about: About = serde_json::from_slice(reader.about()).map_err(|error| {
        Error::new(
            &name,
            "",
            format!(
                "does not say what was run ({error}); accepted is what `pigtail align` recorded"
            ),
        )
    })?;
    let procedure = about.procedure.parse::<Procedure>().map_err(|_| {
        let known: Vec<_> = Procedure::VARIANTS.iter().map(|p| p.name()).collect();
        Error::new(
            &name,
            "procedure",
            format!("is \"{}\"; accepted is one of {known:?}", about.procedure),
        )
    })?;
    let setup = Setup::from_sources(&about.rig, &about.recipe, about.sources)?;
    let mut machine = Replay::new(setup.spec.clone(), reader);
    let reports = align::run(&mut machine, &setup, procedure, &mut Unobserved);
    let (exchanges, seconds) = (machine.cycles(), machine.time());
    // A replay that came to the record's end has said all that there is to say of a cut one.
    let ended = machine
        .fault()
        .is_some_and(|fault| fault.rule == Rule::ReplayEnds);
    let left = machine.left()?;
    let cut = machine.is_cut() || ended;
    let difference = machine
        .fault()
        .filter(|fault| fault.rule == Rule::ReplayDiffers)
        .map(ToString::to_string);
    Ok(Document {
        record: name,
        same: difference.is_none() && left == 0,
        exchanges,
        seconds: pigtail_numerics::rounded(seconds, 1e-6),
        difference,
        left,
        cut,
        outcomes: reports
            .iter()
            .map(|report| (report.port, report.outcome.code()))
            .collect(),
        recorded_by: about.version,
        version: env!("CARGO_PKG_VERSION"),
    })
}
