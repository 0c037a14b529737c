//! One device aligned on a twin, and the document that holds what control says against the truth.

use super::arms::{Arms, Counted};
use pigtail_control::belief::Place;
use pigtail_control::job::{FiberReport, PORTS};
use pigtail_control::outcome::{Outcome, OutcomeCode};
use pigtail_control::recipe::Recipe;
use pigtail_control::station::{Observer, Station};
use pigtail_hal::Fault;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_numerics::rounded;
use pigtail_session::align::{Align, Aligned, align_by};
use pigtail_session::job::{Ended, Job, Order, Work};
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::Setup;
use pigtail_twin::faults::Injection;
use pigtail_twin::{FiberTruth, Specimen, Truth, Twin};
use serde::Serialize;
use std::cell::Cell;
use std::collections::BTreeMap;

/// Tolerance of an aligned fiber in z (thesis 3.1), micrometres.
pub const TOLERANCE_Z_UM: f64 = 2.0;

/// What a run prints as JSON and keeps as `summary.json`. Keys are a contract: more may come,
/// none changes its name or meaning.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AlignmentDocument {
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// The procedure.
    pub procedure: &'static str,
    /// How the truth was changed.
    pub scenario: String,
    /// The seed of machine, device, fixture and noise.
    pub seed: u64,
    /// What machine and device may be.
    pub fleet: String,
    /// The seed of the machine.
    pub machine: u64,
    /// Which device on it, from zero.
    pub device: u64,
    /// A row a fiber, input first.
    pub fibers: Vec<FiberRow>,
    /// Machine time over the number of fibers that were attempted, seconds.
    pub seconds_per_fiber: f64,
    /// Whether a fiber, the sensing fiber or an empty holder ever touched the chip: the truth.
    pub collision: bool,
    /// The least distance between the chip and any of these: the truth.
    pub smallest_gap_um: Option<f64>,
    /// What the manipulators did of the time; `null` where no time passed.
    pub arms: Option<Arms>,
    /// What was broken on purpose, and when.
    pub injected: Vec<String>,
    /// Why the machine stopped by itself; `null` where it did not.
    pub fault: Option<Fault>,
    /// The program's version.
    pub version: &'static str,
    /// Path of the report; empty when none was written.
    pub report: String,
}

/// How one fiber's alignment went.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FiberRow {
    /// The port.
    pub port: &'static str,
    /// What control says of it.
    pub outcome: OutcomeCode,
    /// The same in a sentence, with the evidence.
    pub detail: String,
    /// Its phases in order.
    pub phases: Vec<PhaseRow>,
    /// Machine time of all of them, seconds.
    pub seconds: f64,
    /// Where it really is; `null` unless attached.
    pub offset_um: Option<Offset>,
    /// Loss at this interface, decibels; `null` unless attached.
    pub coupling_loss_db: Option<f64>,
    /// Extinction of the light here, by the fiber's roll about its axis alone, decibels; absent where fibers have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extinction_db: Option<f64>,
    /// How many times as far as its calibration says each piezo of its micro goes, where light has taught that and it was made use of;
    /// absent elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub micro_strokes: Option<[f64; MICRO_AXES]>,
    /// Axes that have swung at rest under the gains of its calibration until then, and how many times as large these are since; absent where
    /// none has.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub gentler_gains: BTreeMap<String, f64>,
    /// By when its micro has come to rest, seconds, where the camera has seen that it swings for longer than was believed, so that all was done as slowly;
    /// absent elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub micro_settling_s: Option<f64>,
    /// Whether it really is where it should be; `null` unless attached.
    pub within_tolerance: Option<bool>,
    /// What control believes of where it is; `null` unless attached by a procedure that can say so.
    pub believed: Option<Believed>,
}

/// What control believes of an attached fiber.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Believed {
    /// Gap beyond the wanted one, micrometres: the middle of the intervals in z; those in x and y lie around nought.
    pub z_um: f64,
    /// Half widths of the intervals that hold the truth with so great a probability, micrometres.
    pub within_50_percent_um: Offset,
    /// The same.
    pub within_80_percent_um: Offset,
    /// The same.
    pub within_95_percent_um: Offset,
    /// The same.
    pub within_99_percent_um: Offset,
    /// Control's own probability that the fiber is outside its tolerance.
    pub outside: f64,
    /// The belief itself, for whoever holds it against the truth.
    #[serde(skip)]
    pub place: Place,
}

impl Believed {
    fn of(place: Place, tolerance_xy_um: f64) -> Self {
        let within = |share| {
            let [x, y, z] = place
                .half_widths(share)
                .map(|half| rounded(1e6 * half, 1e-6));
            Offset { x, y, z }
        };
        Self {
            z_um: rounded(1e6 * place.off, 1e-6),
            within_50_percent_um: within(0.5),
            within_80_percent_um: within(0.8),
            within_95_percent_um: within(0.95),
            within_99_percent_um: within(0.99),
            outside: place.outside(1e-6 * tolerance_xy_um, 1e-6 * TOLERANCE_Z_UM),
            place,
        }
    }
}

/// One phase of a fiber's alignment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PhaseRow {
    /// Its name.
    pub name: &'static str,
    /// Machine time, seconds.
    pub seconds: f64,
}

/// The truth about an attached fiber: from the lateral peak of the coupling at its gap, and from
/// the gap that was wanted, micrometres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Offset {
    /// Across the chip.
    pub x: f64,
    /// Up from the chip.
    pub y: f64,
    /// Gap beyond the wanted one.
    pub z: f64,
}

/// Aligns one device on the twin that `seed` draws, by a procedure; recorded if anything of the setup is.
///
/// # Errors
///
/// When the plant cannot be built, or the record cannot be written. A fiber that cannot be aligned is not
/// an error, nor is a fault of the machine: the document says so.
pub fn align(
    setup: &Setup,
    procedure: Procedure,
    seed: u64,
    observer: &mut dyn Observer,
) -> Result<AlignmentDocument, Ended> {
    let setup = setup.at(seed)?;
    let (mut twin, injected) = setup.broken_twin(seed, procedure.seconds())?;
    let job = Align { procedure };
    let mut counted = Counted::new(observer);
    let aligned = setup.perform(&mut twin, &job, seed, &mut counted)?;
    let arms = counted.arms();
    let way = of(procedure);
    let document = document(&setup, &way, seed, &injected, &twin, &aligned.fibers);
    Ok(AlignmentDocument { arms, ..document })
}

/// A way to align a device, as documents call and judge it.
pub struct Way {
    /// Its name.
    pub name: &'static str,
    /// How near to the peak in x and y a fiber must be in truth to count as aligned, micrometres.
    pub tolerance_xy_um: f64,
}

pub(crate) fn of(procedure: Procedure) -> Way {
    Way {
        name: procedure.name(),
        tolerance_xy_um: procedure.tolerance_xy_um(),
    }
}

/// What came of a device that was aligned by any way.
pub(crate) struct Judged {
    /// The document.
    pub(crate) document: AlignmentDocument,
    /// Machine time by the machine, from power-on until the last fiber was done, seconds.
    pub(crate) machine_seconds: f64,
    /// Light samples that control looked at.
    pub(crate) readings: u64,
}

/// A way to align that is nobody's procedure.
struct Own<F>(Cell<Option<F>>);

impl<F: FnOnce(&mut Station, &Recipe) -> Vec<FiberReport>> Job for Own<F> {
    type Output = Aligned;

    fn run(&self, work: &mut Work<'_>) -> Result<Aligned, Ended> {
        let control = self.0.take().expect("it is run once");
        Ok(align_by(work, control))
    }

    fn order(&self) -> Order {
        Order::Other
    }
}

/// As [`align`], by any way, on a machine that nothing is injected into.
///
/// # Errors
///
/// As [`align`].
pub(crate) fn align_in(
    setup: &Setup,
    way: &Way,
    control: impl FnOnce(&mut Station, &Recipe) -> Vec<FiberReport>,
    seed: u64,
    observer: &mut dyn Observer,
) -> Result<Judged, Ended> {
    let job = Own(Cell::new(Some(control)));
    let setup = setup.at(seed)?;
    let mut twin = setup.twin(seed)?;
    let mut counted = Counted::new(observer);
    let aligned = setup.perform(&mut twin, &job, seed, &mut counted)?;
    let arms = counted.arms();
    let document = document(&setup, way, seed, &[], &twin, &aligned.fibers);
    Ok(Judged {
        document: AlignmentDocument { arms, ..document },
        machine_seconds: aligned.machine_seconds,
        readings: aligned.readings,
    })
}

/// What a document is of.
pub(crate) struct Of<'a> {
    /// The rig as it was named.
    pub(crate) rig: &'a str,
    /// The recipe as it was named.
    pub(crate) recipe: &'a str,
    /// How the truth was changed.
    pub(crate) scenario: &'a str,
    /// What machine and device may be.
    pub(crate) fleet: &'a str,
    /// The gap that is wanted, metres.
    pub(crate) gap: f64,
}

fn document(
    setup: &Setup,
    way: &Way,
    seed: u64,
    injected: &[Injection],
    twin: &Twin,
    reports: &[FiberReport],
) -> AlignmentDocument {
    let of = Of {
        rig: &setup.rig.name,
        recipe: &setup.rig.recipe_name,
        scenario: setup.scenario.name(),
        fleet: setup.fleet_name(),
        gap: setup.rig.recipe.approach.gap,
    };
    judged(&of, way, seed, injected, &twin.truth(), reports)
}

/// What control says of each fiber, beside the truth.
pub(crate) fn judged(
    of: &Of,
    way: &Way,
    seed: u64,
    injected: &[Injection],
    truth: &Truth,
    reports: &[FiberReport],
) -> AlignmentDocument {
    let truths = std::iter::once(truth.input).chain(truth.outputs);
    let fibers: Vec<FiberRow> = reports
        .iter()
        .zip(truths)
        .map(|(report, truth)| row(report, truth, of.gap, way.tolerance_xy_um))
        .collect();
    let attempted = reports
        .iter()
        .filter(|r| r.outcome != Outcome::NotAttempted)
        .count();
    let seconds: f64 = reports.iter().map(FiberReport::seconds).sum();
    AlignmentDocument {
        rig: of.rig.to_owned(),
        recipe: of.recipe.to_owned(),
        procedure: way.name,
        scenario: of.scenario.to_owned(),
        seed,
        fleet: of.fleet.to_owned(),
        machine: Specimen::from(seed).machine(),
        device: Specimen::from(seed).device(),
        fibers,
        seconds_per_fiber: rounded(seconds / attempted.max(1) as f64, 1e-4),
        collision: truth.smallest_gap <= 0.0,
        smallest_gap_um: Some(truth.smallest_gap)
            .filter(|gap| gap.is_finite())
            .map(|gap| rounded(gap * 1e6, 1e-6)),
        arms: None,
        injected: injected.iter().map(ToString::to_string).collect(),
        fault: reports
            .iter()
            .find_map(|report| report.outcome.fault())
            .cloned(),
        version: env!("CARGO_PKG_VERSION"),
        report: String::new(),
    }
}

/// The document of a device at which the program itself failed.
pub fn panicked(
    setup: &Setup,
    procedure: Procedure,
    seed: u64,
    panic: &(dyn std::any::Any + Send),
) -> AlignmentDocument {
    empty(setup, procedure, seed, OutcomeCode::Panic, &said(panic))
}

/// What a panic said.
pub(crate) fn said(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    text.unwrap_or_else(|| "the program failed".to_owned())
}

/// The document of a device on which nothing was done, all of whose fibers ended alike.
pub fn empty(
    setup: &Setup,
    procedure: Procedure,
    seed: u64,
    outcome: OutcomeCode,
    detail: &str,
) -> AlignmentDocument {
    let fiber = |port| nothing(port, outcome, detail);
    AlignmentDocument {
        rig: setup.rig.name.clone(),
        recipe: setup.rig.recipe_name.clone(),
        procedure: procedure.name(),
        scenario: setup.scenario.name().to_owned(),
        seed,
        fleet: setup.fleet_name().to_owned(),
        machine: Specimen::from(seed).machine(),
        device: Specimen::from(seed).device(),
        fibers: PORTS.into_iter().map(fiber).collect(),
        seconds_per_fiber: 0.0,
        collision: false,
        smallest_gap_um: None,
        arms: None,
        injected: setup
            .faults
            .of(seed, procedure.seconds())
            .iter()
            .map(ToString::to_string)
            .collect(),
        fault: None,
        version: env!("CARGO_PKG_VERSION"),
        report: String::new(),
    }
}

/// The row of a fiber on which nothing was done.
pub(crate) fn nothing(port: &'static str, outcome: OutcomeCode, detail: &str) -> FiberRow {
    FiberRow {
        port,
        outcome,
        detail: detail.to_owned(),
        phases: Vec::new(),
        seconds: 0.0,
        offset_um: None,
        coupling_loss_db: None,
        extinction_db: None,
        within_tolerance: None,
        micro_strokes: None,
        gentler_gains: BTreeMap::new(),
        micro_settling_s: None,
        believed: None,
    }
}

impl AlignmentDocument {
    /// Whether every fiber is aligned, by control's word and in truth, and nothing was touched.
    pub fn is_success(&self) -> bool {
        !self.collision && self.fibers.iter().all(FiberRow::is_good)
    }
}

impl AlignmentDocument {
    /// How it ended, in a few words.
    pub fn outcome(&self) -> String {
        let lost = self
            .fibers
            .iter()
            .find(|fiber| fiber.verdict() != Verdict::Ended(OutcomeCode::Aligned));
        match lost {
            _ if self.collision => "touched the chip".to_owned(),
            Some(fiber) => format!("{}: {}", fiber.port, fiber.verdict()),
            None => "aligned".to_owned(),
        }
    }

    /// The names of all phases, in the order in which they first come.
    pub fn phase_names(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        for phase in self.fibers.iter().flat_map(|fiber| &fiber.phases) {
            if !names.contains(&phase.name) {
                names.push(phase.name);
            }
        }
        names
    }
}

/// How a fiber ended, beside the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// As control says.
    Ended(OutcomeCode),
    /// Control believes it aligned, and it is not.
    BelievedAligned,
}

impl Verdict {
    /// The words for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ended(outcome) => outcome.name(),
            Self::BelievedAligned => "believed aligned",
        }
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl FiberRow {
    /// The outcome, beside the truth.
    pub fn verdict(&self) -> Verdict {
        match self.within_tolerance {
            Some(false) => Verdict::BelievedAligned,
            _ => Verdict::Ended(self.outcome),
        }
    }

    /// Whether it is aligned, by control's word and in truth.
    pub fn is_good(&self) -> bool {
        self.outcome == OutcomeCode::Aligned && self.within_tolerance == Some(true)
    }

    /// Machine time of a phase, seconds, if it was entered: of all its parts, for it may have been begun anew.
    pub fn seconds_in(&self, phase: &str) -> Option<f64> {
        let parts = self.phases.iter().filter(|row| row.name == phase);
        parts
            .map(|row| row.seconds)
            .reduce(|sum, seconds| sum + seconds)
    }
}

fn row(
    report: &FiberReport,
    truth: Option<FiberTruth>,
    wanted_gap: f64,
    tolerance_xy: f64,
) -> FiberRow {
    let offset = truth.map(|t| (t.x, t.y, t.gap - wanted_gap));
    FiberRow {
        port: report.port,
        outcome: report.outcome.code(),
        detail: report.outcome.to_string(),
        phases: report
            .phases
            .iter()
            .map(|&(name, seconds)| PhaseRow {
                name,
                seconds: rounded(seconds, 1e-4),
            })
            .collect(),
        seconds: rounded(report.seconds(), 1e-4),
        offset_um: offset.map(|(x, y, z)| Offset {
            x: rounded(x * 1e6, 1e-6),
            y: rounded(y * 1e6, 1e-6),
            z: rounded(z * 1e6, 1e-6),
        }),
        extinction_db: truth
            .and_then(|t| t.extinction_db())
            .map(|db| rounded(db, 1e-3)),
        coupling_loss_db: truth.map(|t| rounded(-10.0 * t.coupling.log10(), 1e-6)),
        within_tolerance: offset.map(|(x, y, z)| {
            let [x, y, z] = [x, y, z].map(|metres| 1e6 * metres.abs());
            x <= tolerance_xy && y <= tolerance_xy && z <= TOLERANCE_Z_UM
        }),
        micro_strokes: report
            .strokes
            .map(|strokes| strokes.map(|times| rounded(times, 1e-4))),
        gentler_gains: report
            .gains
            .iter()
            .map(|(at, share)| (at.to_string(), rounded(*share, 1e-4)))
            .collect(),
        micro_settling_s: report.rests.map(|seconds| rounded(seconds, 1e-4)),
        believed: report.place.map(|place| Believed::of(place, tolerance_xy)),
    }
}
