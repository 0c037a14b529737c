//! A recorded run, through the same control again.

use crate::align::Align;
use crate::job::{Ended, Job, Order};
use crate::procedure::Procedure;
use crate::produce::{Loaded, Produce};
use crate::records::About;
use crate::rig::Rig;
use crate::session::Session;
use anyhow::Result;
use pigtail_control::outcome::OutcomeCode;
use pigtail_control::station::Unobserved;
use pigtail_hal::{Error, Rule};
use pigtail_machines::Replay;
use pigtail_machines::record::Reader;
use pigtail_numerics::rounded;
use serde::Serialize;
use std::cell::RefCell;
use std::path::Path;
use strum::VariantArray;

/// What a replay prints as JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReplayDocument {
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
    /// What was run.
    pub job: serde_json::Value,
    /// What control says of the fibers, in the replay of an alignment.
    pub outcomes: Vec<(&'static str, OutcomeCode)>,
    /// What control says of the pigtails, in the replay of a tray.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pigtails: Vec<Pigtailed>,
    /// How a job ended that came to no result, in the replay.
    pub ended: Option<String>,
    /// The version that recorded it.
    pub recorded_by: String,
    /// The version that replayed it.
    pub version: &'static str,
}

/// What control says of a pigtail.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Pigtailed {
    /// The device's serial number.
    pub device: String,
    /// The port.
    pub port: String,
    /// Whether it passed.
    pub passed: bool,
    /// Why not; empty where it did.
    pub cause: String,
}

/// Replays a record through the control of this program.
///
/// # Errors
///
/// When the record cannot be read, or what was kept with it is not what a run keeps.
pub fn replay(path: &Path) -> Result<ReplayDocument> {
    let name = path.display().to_string();
    let reader = Reader::open(path)?;
    let about: About = serde_json::from_slice(reader.about()).map_err(|error| {
        Error::new(
            &name,
            "",
            format!("does not say what was run ({error}); accepted is what `pigtail` recorded"),
        )
    })?;
    let order = match about.order {
        Some(order) => order,
        None => Order::Align(Align {
            procedure: procedure(&name, &about.procedure)?,
        }),
    };
    let rig = Rig::from_sources(&about.rig, &about.recipe, about.sources)?;
    let mut machine = Replay::new(rig.spec.clone(), reader);
    let (mut outcomes, mut pigtails) = (Vec::new(), Vec::new());
    let ended = again(&rig, &mut machine, &order, &mut outcomes, &mut pigtails).err();
    let (exchanges, seconds) = (machine.cycles(), machine.time());
    // A replay that came to the record's end has said all that there is to say of a cut one.
    let over = machine
        .fault()
        .is_some_and(|fault| fault.rule == Rule::ReplayEnds);
    let left = machine.left()?;
    let cut = machine.is_cut() || over;
    let difference = machine
        .fault()
        .filter(|fault| fault.rule == Rule::ReplayDiffers)
        .map(ToString::to_string);
    Ok(ReplayDocument {
        record: name,
        same: difference.is_none() && left == 0,
        exchanges,
        seconds: rounded(seconds, 1e-6),
        difference,
        left,
        cut,
        job: serde_json::to_value(&order)?,
        outcomes,
        pigtails,
        ended: ended.map(|ended| ended.to_string()),
        recorded_by: about.version,
        version: env!("CARGO_PKG_VERSION"),
    })
}

/// The procedure of a record of before there were other jobs.
fn procedure(record: &str, procedure: &str) -> Result<Procedure, Error> {
    procedure.parse().map_err(|_| {
        let known: Vec<_> = Procedure::VARIANTS.iter().map(|p| p.name()).collect();
        let message = format!("is \"{procedure}\"; accepted is one of {known:?}");
        Error::new(record, "procedure", message)
    })
}

fn again(
    rig: &Rig,
    machine: &mut Replay,
    order: &Order,
    outcomes: &mut Vec<(&'static str, OutcomeCode)>,
    pigtails: &mut Vec<Pigtailed>,
) -> Result<(), Ended> {
    fn run<J: Job>(rig: &Rig, machine: &mut Replay, job: &J) -> Result<J::Output, Ended> {
        Session::open(rig, machine).run(job, &mut Unobserved)
    }
    fn done<J: Job>(rig: &Rig, machine: &mut Replay, job: &J) -> Result<(), Ended> {
        run(rig, machine, job).map(drop)
    }
    match order {
        Order::Align(job) => {
            let aligned = run(rig, machine, job)?;
            let said = aligned.fibers.iter();
            outcomes.extend(said.map(|fiber| (fiber.port, fiber.outcome.code())));
            Ok(())
        }
        Order::Step(job) => done(rig, machine, job),
        Order::Sine(job) => done(rig, machine, job),
        Order::Resolution(job) => done(rig, machine, job),
        Order::Frequency(job) => done(rig, machine, job),
        Order::Tune(job) => done(rig, machine, job),
        Order::IdentifyWindup(job) => done(rig, machine, job),
        Order::MeasureWindup(job) => done(rig, machine, job),
        Order::IdentifyPiezos(job) => done(rig, machine, job),
        Order::Impulse(job) => done(rig, machine, job),
        Order::FirstLight(job) => done(rig, machine, job),
        Order::Follow(job) => done(rig, machine, job),
        Order::FollowContour(job) => done(rig, machine, job.as_ref()),
        Order::ScanWindup(job) => done(rig, machine, job),
        Order::BreakAway(job) => done(rig, machine, job),
        Order::PlayPulses(job) => done(rig, machine, job),
        Order::LeastPulse(job) => done(rig, machine, job),
        Order::Produce(kept) => {
            let loaded = Loaded::again(&kept.texts)?;
            let mut tell = |_: &pigtail_cycle::run::Event| ();
            let job = Produce {
                loaded: &loaded,
                from: kept.from,
                taught: &kept.taught,
                tell: RefCell::new(&mut tell),
            };
            let run = run(rig, machine, &job)?;
            let fibers = run.devices.iter().flat_map(|device| &device.fibers);
            pigtails.extend(fibers.map(|fiber| Pigtailed {
                device: fiber.device.clone(),
                port: fiber.port.clone(),
                passed: fiber.passed,
                cause: fiber.cause.clone(),
            }));
            Ok(())
        }
        Order::Other => {
            let message = "is of something that cannot be run again from a record; accepted is a job of its own";
            Err(Error::new("record", "job", message).into())
        }
    }
}
