//! What a campaign comes to, from its rows.

use super::commissioned::REFUSED;
use super::rows::{ARMS, ROWS_PER_DEVICE};
use super::store::Store;
use super::sureness::Sureness;
use crate::arms::{Arms, Time};
use anyhow::Result;
use pigtail_control::outcome::OutcomeCode;
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Rule, Side};
use pigtail_numerics::rounded;
use pigtail_numerics::statistics::{CONFIDENCE, Percentiles, Sum, wilson};
use pigtail_session::fleet::NOMINAL;
use pigtail_session::piezos::PiezoModel;
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::scenario::Scenario;
use pigtail_store::rows::Rows;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Most seeds that are told of a cause; the rows have them all.
const SEEDS: usize = 20;

/// What a campaign prints as JSON and keeps as `summary.json`. Keys are a contract: more may come,
/// none changes its name or meaning.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CampaignDocument {
    /// Devices that are done.
    pub devices: u64,
    /// Their fibers.
    pub fibers: u64,
    /// Fibers that are aligned, by control's word and in truth, on devices that nothing touched.
    pub aligned: u64,
    /// All other fibers, by cause.
    pub failed: BTreeMap<String, u64>,
    /// Machine time of every fiber that was attempted, seconds.
    pub seconds_per_fiber: Percentiles,
    /// How far the attached fibers really are from where they should be, without sign.
    pub offset_um: Offsets,
    /// Loss at the interfaces of the attached fibers.
    pub coupling_loss_db: Percentiles,
    /// How long this command took on the wall's clock; after `--resume`, for what was left.
    pub wall_seconds: f64,
    /// Path of the rows.
    pub rows: String,
    /// Whether all devices that were asked for are done.
    pub complete: bool,
    /// Devices that were asked for.
    pub devices_planned: u64,
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// The procedure.
    pub procedure: String,
    /// How the truth was changed.
    pub scenario: String,
    /// The first device's seed.
    pub seed: u64,
    /// What machines and devices may be.
    pub fleet: String,
    /// Machines that had a device.
    pub machines: u64,
    /// How many devices each machine aligns.
    pub devices_each: u64,
    /// How right control was about how sure it is; `null` where it says nothing of it.
    pub sureness: Option<Sureness>,
    /// Whether each machine was commissioned first.
    pub commissioned: bool,
    /// By which model of its piezos' hysteresis; `null` where none was commissioned.
    pub piezo_model: Option<PiezoModel>,
    /// Machines that were accepted then; `null` where none was commissioned.
    pub accepted: Option<u64>,
    /// Fibers that control believes aligned and that are not.
    pub wrong: Cause,
    /// Devices that a fiber or the sensing fiber touched.
    pub collided: Cause,
    /// Devices that anything touched the chip of: [`Self::collided`] in a number.
    pub collisions: u64,
    /// Devices at which the program itself failed.
    pub panics: u64,
    /// Devices that did not come to an end.
    pub hangs: u64,
    /// Fibers that control believes aligned and that are not: [`Self::wrong`] in a number.
    pub false_aligned: u64,
    /// Devices on which the machine stopped by itself, by the rule that was broken.
    pub tripped: BTreeMap<String, u64>,
    /// What was broken on purpose.
    pub faults: String,
    /// How devices ended, by what was broken on them.
    pub by_fault: BTreeMap<String, ByFault>,
    /// Devices of which every fiber is aligned.
    pub devices_aligned: u64,
    /// How sure the shares are.
    pub confidence: Confidence,
    /// Seeds to replay by `pigtail align --seed`, by cause; the first few.
    pub replay: BTreeMap<String, Vec<u64>>,
    /// The phases, in the procedure's order.
    pub phases: Vec<Phase>,
    /// What the manipulators did of the time of all devices; `null` where rows are older than what tells it.
    pub arms: Option<Arms>,
    /// For how long each stood still on a device, seconds.
    pub idle_seconds_per_device: Idle,
    /// The least distance between the chip and anything, of all devices.
    pub smallest_gap_um: Option<f64>,
    /// SHA-256 of the file of rows: the same for the same campaign.
    pub rows_sha256: String,
    /// The program's version.
    pub version: &'static str,
    /// Path of the report.
    pub report: String,
}

/// For how long manipulators stand still, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Idle {
    /// The left one.
    pub left: Percentiles,
    /// The right one.
    pub right: Percentiles,
}

/// A phase of an alignment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Phase {
    /// Its name; `other` for all that have no column of their own.
    pub name: &'static str,
    /// Machine time of the fibers that entered it.
    pub seconds: Percentiles,
}

/// Something that should not happen.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Cause {
    /// How often it did.
    pub count: u64,
    /// The first few devices to which it did.
    pub seeds: Vec<u64>,
}

impl Cause {
    fn add(&mut self, seed: u64) {
        self.count += 1;
        if self.seeds.len() < SEEDS && self.seeds.last() != Some(&seed) {
            self.seeds.push(seed);
        }
    }
}

/// How the devices ended on which the same thing broke.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ByFault {
    /// How many there are.
    pub devices: u64,
    /// Of which every fiber is aligned all the same.
    pub aligned: u64,
    /// On which the machine stopped by itself.
    pub tripped: u64,
    /// On which control gave up a fiber and the machine went on.
    pub given_up: u64,
    /// On which control believes a fiber aligned that is not.
    pub false_aligned: u64,
    /// That were touched.
    pub collisions: u64,
    /// At which the program failed or did not come to an end.
    pub broken: u64,
}

/// Distances without sign, micrometres. In JSON one object with keys such as `x_p99`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Offsets {
    /// Across the chip.
    pub x: Percentiles,
    /// Up from the chip.
    pub y: Percentiles,
    /// Of the gap.
    pub z: Percentiles,
}

impl Serialize for Offsets {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_map(
            [("x", self.x), ("y", self.y), ("z", self.z)]
                .into_iter()
                .flat_map(|(axis, of)| {
                    [
                        ("p50", of.p50),
                        ("p90", of.p90),
                        ("p99", of.p99),
                        ("p999", of.p999),
                        ("max", of.max),
                    ]
                    .map(|(name, value)| (format!("{axis}_{name}"), value))
                }),
        )
    }
}

/// Wilson's intervals of shares between 0 and 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Confidence {
    /// How probably each interval holds the truth.
    pub level: f64,
    /// How they were computed.
    pub method: &'static str,
    /// Share of aligned fibers, as if those of a device did not depend on each other.
    pub fibers_aligned: [f64; 2],
    /// Share of devices of which every fiber is aligned: these are independent.
    pub devices_aligned: [f64; 2],
    /// Share of fibers that control wrongly believes aligned.
    pub fibers_wrong: [f64; 2],
}

impl CampaignDocument {
    /// The command that does one device of this campaign again, but for its seed.
    pub fn replay_command(&self) -> String {
        let options = [
            ("procedure", Procedure::default().name(), &*self.procedure),
            ("rig", DEFAULT_RIG_NAME, &self.rig),
            ("recipe", DEFAULT_RECIPE_NAME, &self.recipe),
            ("scenario", Scenario::default().name(), &self.scenario),
            ("faults", "none", &self.faults),
            ("fleet", NOMINAL, &self.fleet),
        ];
        let mut command = "pigtail align".to_owned();
        for (option, usual, value) in options {
            if value != usual {
                let _ = write!(command, " --{option} {value}");
            }
        }
        command + " --seed"
    }

    /// Whether all that was asked for is done and every fiber aligned.
    pub fn is_success(&self) -> bool {
        if self.faults == "none" {
            return self.complete && self.aligned == self.fibers;
        }
        // Where things are broken on purpose, nobody expects fibers to be aligned.
        let worst = self.collisions + self.panics + self.hangs + self.false_aligned;
        self.complete && worst == 0
    }
}

/// Why a fiber counts as failed; `None` where it is aligned.
fn cause(outcome: &str, within_tolerance: Option<bool>, collision: Option<bool>) -> Option<&str> {
    match OutcomeCode::from_name(outcome) {
        Some(OutcomeCode::Aligned) if within_tolerance != Some(true) => Some("wrong_aligned"),
        _ if collision == Some(true) => Some("collision"),
        Some(OutcomeCode::Aligned) => None,
        _ => Some(outcome),
    }
}

/// How devices end, while their rows are read.
#[derive(Default)]
struct Ends {
    panics: u64,
    tripped: BTreeMap<String, u64>,
    by_fault: BTreeMap<String, ByFault>,
    device: Option<One>,
}

/// The device that is being read.
struct One {
    fault: Option<String>,
    tripped: bool,
    hung: bool,
    collided: bool,
    panicked: bool,
    wrong: bool,
    failed: bool,
}

impl Ends {
    fn begin(&mut self, injected: Option<&str>, rule: Option<&str>, collided: Option<bool>) {
        self.end();
        if let Some(rule) = rule {
            *self.tripped.entry(rule.to_owned()).or_default() += 1;
        }
        self.device = Some(One {
            // By name: places, sizes and times differ.
            fault: injected.map(|text| {
                let end = text.find([':', '@']).unwrap_or(text.len());
                text[..end].to_owned()
            }),
            tripped: rule.is_some(),
            hung: rule == Some(Rule::Deadline.text()),
            collided: collided == Some(true),
            panicked: false,
            wrong: false,
            failed: false,
        });
    }

    fn fiber(&mut self, outcome: &str, cause: Option<&str>) {
        if let Some(device) = &mut self.device {
            device.panicked |= outcome == OutcomeCode::Panic.name();
            device.wrong |= cause == Some("wrong_aligned");
            device.failed |= cause.is_some();
        }
    }

    fn end(&mut self) {
        let Some(one) = self.device.take() else {
            return;
        };
        self.panics += u64::from(one.panicked);
        let Some(fault) = one.fault else { return };
        let of = self.by_fault.entry(fault).or_default();
        of.devices += 1;
        of.aligned += u64::from(!one.failed);
        of.tripped += u64::from(one.tripped && !one.hung);
        of.given_up += u64::from(one.failed && !one.tripped && !one.panicked && !one.wrong);
        of.false_aligned += u64::from(one.wrong);
        of.collisions += u64::from(one.collided);
        of.broken += u64::from(one.panicked || one.hung);
    }
}

/// What the rows come to in numbers.
#[derive(Default)]
struct Counts {
    failed: BTreeMap<String, Cause>,
    wrong: Cause,
    collided: Cause,
    fibers: u64,
    aligned: u64,
    devices_aligned: u64,
    ends: Ends,
}

impl Counts {
    fn of(rows: &Rows) -> Result<Self> {
        let mut of = Self::default();
        let mut of_device = 0;
        for table in rows.groups(&[
            "seed",
            "outcome",
            "within_tolerance",
            "collision",
            "injected",
            "rule",
        ]) {
            let table = table?;
            let (within, collision) = (table.flags("within_tolerance"), table.flags("collision"));
            let outcomes = table.texts("outcome");
            let (injected, rules) = (table.texts("injected"), table.texts("rule"));
            for (i, seed) in table.wholes("seed").into_iter().enumerate() {
                let outcome = outcomes[i].as_deref().unwrap_or_default();
                // A device's rows follow each other.
                if of.fibers % ROWS_PER_DEVICE == 0 {
                    of_device = 0;
                    if collision[i] == Some(true) {
                        of.collided.add(seed);
                    }
                    of.ends
                        .begin(injected[i].as_deref(), rules[i].as_deref(), collision[i]);
                }
                of.fibers += 1;
                let cause = cause(outcome, within[i], collision[i]);
                of.ends.fiber(outcome, cause);
                if let Some(cause) = cause {
                    of.failed.entry(cause.to_owned()).or_default().add(seed);
                    if cause == "wrong_aligned" {
                        of.wrong.add(seed);
                    }
                } else {
                    of.aligned += 1;
                    of_device += 1;
                    of.devices_aligned += u64::from(of_device == ROWS_PER_DEVICE);
                }
            }
        }
        of.ends.end();
        Ok(of)
    }
}

/// Sums up the rows of a campaign. A group of them is in memory at a time, however many there are.
///
/// # Errors
///
/// When the rows cannot be read.
pub fn summarize(store: &Store, wall_seconds: f64) -> Result<CampaignDocument> {
    let rows = store.rows()?;
    let plan = store.plan();
    let Counts {
        failed,
        wrong,
        collided,
        fibers,
        aligned,
        devices_aligned,
        ends,
    } = Counts::of(&rows)?;
    let percentiles = |name: &str| percentiles(&rows, name);
    let offset =
        |name: &str| Percentiles::of(|each| rows.each_number(name, |value| each(value.abs())));
    let mut smallest_gap = None;
    rows.each_number("smallest_gap_um", |gap| {
        smallest_gap = Some(smallest_gap.map_or(gap, |least: f64| least.min(gap)));
    })?;
    let devices = fibers / ROWS_PER_DEVICE;
    let unsure = failed.get(OutcomeCode::Unsure.name());
    let sureness = Sureness::of(&rows, plan.devices_each, unsure.map_or(0, |of| of.count))?;
    Ok(CampaignDocument {
        sureness,
        devices,
        fibers,
        aligned,
        failed: failed
            .iter()
            .map(|(cause, of)| (cause.clone(), of.count))
            .collect(),
        seconds_per_fiber: percentiles("seconds")?,
        offset_um: Offsets {
            x: offset("offset_x_um")?,
            y: offset("offset_y_um")?,
            z: offset("offset_z_um")?,
        },
        coupling_loss_db: percentiles("coupling_loss_db")?,
        wall_seconds: rounded(wall_seconds, 1e-3),
        rows: store.rows_path().display().to_string(),
        complete: devices == plan.devices,
        devices_planned: plan.devices,
        rig: plan.rig.clone(),
        recipe: plan.recipe.clone(),
        procedure: plan.procedure.clone(),
        scenario: plan.scenario.clone(),
        seed: plan.seed,
        fleet: plan.fleet.clone(),
        machines: devices.div_ceil(plan.devices_each),
        devices_each: plan.devices_each,
        commissioned: plan.commissioned,
        piezo_model: plan.commissioned.then_some(plan.piezo_model),
        accepted: if plan.commissioned {
            Some(accepted(&rows, plan.devices_each)?)
        } else {
            None
        },
        confidence: Confidence {
            level: CONFIDENCE,
            method: "wilson",
            fibers_aligned: wilson(aligned, fibers),
            devices_aligned: wilson(devices_aligned, devices),
            fibers_wrong: wilson(wrong.count, fibers),
        },
        collisions: collided.count,
        panics: ends.panics,
        hangs: ends
            .tripped
            .get(Rule::Deadline.text())
            .copied()
            .unwrap_or(0),
        false_aligned: wrong.count,
        tripped: ends.tripped,
        faults: plan.faults.clone(),
        by_fault: ends.by_fault,
        wrong,
        collided,
        devices_aligned,
        replay: failed
            .into_iter()
            .map(|(cause, of)| (cause, of.seeds))
            .collect(),
        phases: phases(store.procedure(), &rows)?,
        arms: arms(&rows)?,
        idle_seconds_per_device: Idle {
            left: per_device(&rows, "left_idle_s")?,
            right: per_device(&rows, "right_idle_s")?,
        },
        smallest_gap_um: smallest_gap,
        rows_sha256: store.rows_hash()?,
        version: env!("CARGO_PKG_VERSION"),
        report: store.folder().join("report.html").display().to_string(),
    })
}

/// Machines that were not refused when they were commissioned.
fn accepted(rows: &Rows, devices_each: u64) -> Result<u64> {
    let rows_each = devices_each * ROWS_PER_DEVICE;
    let (mut row, mut accepted) = (0_u64, 0_u64);
    for table in rows.groups(&["detail"]) {
        for detail in table?.texts("detail") {
            // A machine is refused with all its devices.
            if row.is_multiple_of(rows_each) {
                let refused = detail.is_some_and(|why| why.starts_with(REFUSED));
                accepted += u64::from(!refused);
            }
            row += 1;
        }
    }
    Ok(accepted)
}

/// The phases that some fiber entered.
fn phases(procedure: Procedure, rows: &Rows) -> Result<Vec<Phase>> {
    let mut phases = Vec::new();
    for name in procedure.phases().iter().copied().chain(["other"]) {
        let seconds = percentiles(rows, &format!("{name}_s"))?;
        if seconds.max.is_some() {
            phases.push(Phase { name, seconds });
        }
    }
    Ok(phases)
}

/// What the manipulators did on all devices.
fn arms(rows: &Rows) -> Result<Option<Arms>> {
    let sum = |name: &str| -> Result<f64> {
        let mut sum = Sum::default();
        each_device(rows, name, |seconds| sum.add(seconds))?;
        Ok(sum.value())
    };
    let [all, left, right, both] = ARMS.map(|(name, _)| sum(name));
    let mut idle = [0.0; SIDES];
    idle[Side::Left.index()] = left?;
    idle[Side::Right.index()] = right?;
    Ok(Time::told(all?, idle, both?).arms())
}

/// Hands on each number of a column in which the fibers of a device have the same.
fn each_device(rows: &Rows, name: &str, mut each: impl FnMut(f64)) -> Result<()> {
    let mut row = 0_u64;
    for table in rows.groups(&[name]) {
        for value in table?.numbers(name) {
            // A device's rows follow each other.
            if let Some(value) = value.filter(|_| row.is_multiple_of(ROWS_PER_DEVICE)) {
                each(value);
            }
            row += 1;
        }
    }
    Ok(())
}

/// The percentiles of such a column.
fn per_device(rows: &Rows, name: &str) -> Result<Percentiles> {
    Percentiles::of(|each| each_device(rows, name, each))
}

/// The percentiles of a column of numbers.
fn percentiles(rows: &Rows, name: &str) -> Result<Percentiles> {
    Percentiles::of(|each| rows.each_number(name, each))
}

#[cfg(test)]
mod tests {
    use super::cause;

    #[test]
    fn a_wrong_aligned_is_never_taken_for_anything_milder() {
        assert_eq!(cause("aligned", Some(true), Some(false)), None);
        assert_eq!(
            cause("aligned", Some(false), Some(false)),
            Some("wrong_aligned")
        );
        assert_eq!(
            cause("aligned", Some(false), Some(true)),
            Some("wrong_aligned")
        );
        assert_eq!(cause("aligned", None, Some(false)), Some("wrong_aligned"));
        assert_eq!(cause("aligned", Some(true), Some(true)), Some("collision"));
        assert_eq!(cause("no_light", None, Some(false)), Some("no_light"));
        assert_eq!(cause("fault", None, None), Some("fault"));
    }
}
