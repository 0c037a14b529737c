//! What a campaign comes to, from its rows.

use super::rows::ROWS_PER_DEVICE;
use super::statistics::{CONFIDENCE, Percentiles, Sorted, wilson};
use super::store::Store;
use crate::align::rounded;
use anyhow::Result;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;

/// Most seeds that are told of a cause; the rows have them all.
const SEEDS: usize = 20;

/// What a campaign prints as JSON and keeps as `summary.json`. Keys are a contract: more may come,
/// none changes its name or meaning.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Document {
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
    /// Fibers that control believes aligned and that are not.
    pub wrong: Cause,
    /// Devices that a fiber or the sensing fiber touched.
    pub collided: Cause,
    /// Devices of which every fiber is aligned.
    pub devices_aligned: u64,
    /// How sure the shares are.
    pub confidence: Confidence,
    /// Seeds to replay by `pigtail align --seed`, by cause; the first few.
    pub replay: BTreeMap<String, Vec<u64>>,
    /// The phases, in the procedure's order.
    pub phases: Vec<Phase>,
    /// The least distance between the chip and anything, of all devices.
    pub smallest_gap_um: Option<f64>,
    /// SHA-256 of the file of rows: the same for the same campaign.
    pub rows_sha256: String,
    /// The program's version.
    pub version: &'static str,
    /// Path of the report.
    pub report: String,
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

impl Document {
    /// Whether all that was asked for is done and every fiber aligned.
    pub fn is_success(&self) -> bool {
        self.complete && self.aligned == self.fibers
    }
}

/// Why a fiber counts as failed; `None` where it is aligned.
fn cause(outcome: &str, within_tolerance: Option<bool>, collision: Option<bool>) -> Option<&str> {
    match outcome {
        "aligned" if within_tolerance != Some(true) => Some("wrong_aligned"),
        _ if collision == Some(true) => Some("collision"),
        "aligned" => None,
        other => Some(other),
    }
}

/// Sums up the rows of a campaign. One column of them is in memory at a time.
///
/// # Errors
///
/// When the rows cannot be read.
pub fn summarize(store: &Store, wall_seconds: f64) -> Result<Document> {
    let rows = store.rows()?;
    let plan = store.plan();
    let mut failed = BTreeMap::<String, Cause>::new();
    let (mut wrong, mut collided) = (Cause::default(), Cause::default());
    let (mut fibers, mut aligned, mut devices_aligned) = (0, 0, 0);
    let mut of_device = 0;
    for table in rows.groups(&["seed", "outcome", "within_tolerance", "collision"]) {
        let table = table?;
        let (within, collision) = (table.flags("within_tolerance"), table.flags("collision"));
        let outcomes = table.texts("outcome");
        for (i, seed) in table.wholes("seed").into_iter().enumerate() {
            let outcome = outcomes[i].as_deref().unwrap_or_default();
            // A device's rows follow each other.
            if fibers % ROWS_PER_DEVICE == 0 {
                of_device = 0;
                if collision[i] == Some(true) {
                    collided.add(seed);
                }
            }
            fibers += 1;
            if let Some(cause) = cause(outcome, within[i], collision[i]) {
                failed.entry(cause.to_owned()).or_default().add(seed);
                if cause == "wrong_aligned" {
                    wrong.add(seed);
                }
            } else {
                aligned += 1;
                of_device += 1;
                devices_aligned += u64::from(of_device == ROWS_PER_DEVICE);
            }
        }
    }
    let percentiles = |name: &str| Ok::<_, anyhow::Error>(sorted(store, name)?.percentiles());
    let offset = |name: &str| {
        let values = rows.numbers(name)?;
        Ok::<_, anyhow::Error>(
            Sorted::new(values.into_iter().map(f64::abs).collect()).percentiles(),
        )
    };
    let mut phases = Vec::new();
    for phase in store.procedure().phases().iter().copied().chain(["other"]) {
        let of = percentiles(&format!("{phase}_s"))?;
        if of.max.is_some() {
            phases.push(Phase {
                name: phase,
                seconds: of,
            });
        }
    }
    let devices = fibers / ROWS_PER_DEVICE;
    Ok(Document {
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
        confidence: Confidence {
            level: CONFIDENCE,
            method: "wilson",
            fibers_aligned: wilson(aligned, fibers),
            devices_aligned: wilson(devices_aligned, devices),
            fibers_wrong: wilson(wrong.count, fibers),
        },
        wrong,
        collided,
        devices_aligned,
        replay: failed
            .into_iter()
            .map(|(cause, of)| (cause, of.seeds))
            .collect(),
        phases,
        smallest_gap_um: sorted(store, "smallest_gap_um")?.values().first().copied(),
        rows_sha256: store.rows_hash()?,
        version: env!("CARGO_PKG_VERSION"),
        report: store.folder().join("report.html").display().to_string(),
    })
}

/// A column of numbers in order.
pub(crate) fn sorted(store: &Store, name: &str) -> Result<Sorted> {
    Ok(Sorted::new(store.rows()?.numbers(name)?))
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
