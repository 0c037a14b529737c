//! What a run runs on, and what is missing or out of date of what it believes.

use super::{SHORT, Versions};
use crate::bench::BenchRig;
use crate::rig::{Rig, Role, Source, is_built_in, rig_folder, shipped};
use pigtail_control::calibration::Calibration;
use pigtail_hal::AxisName;
use serde::Serialize;
use std::fmt::{self, Display, Formatter};

/// The rig and the calibration of a run. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RunsOn {
    /// The rig as it was named.
    pub rig: String,
    /// Whether its files are compiled in.
    pub built_in: bool,
    /// The calibration that was named in place of the rig's; `null` where none was.
    pub calibration: Option<String>,
    /// The newest version of the rig that the calibration is; `null` where it is none.
    pub calibration_version: Option<u32>,
    /// The newest date in it.
    pub calibration_date: Option<String>,
    /// SHA-256 of its file.
    pub calibration_sha256: String,
    /// The rig's newest version, where its calibration was changed by hand since.
    pub changed_since: Option<u32>,
}

impl RunsOn {
    /// What runs on this rig.
    pub fn of(rig: &Rig) -> Self {
        let place = |source: &Source| source.role == Some(Role::Calibration);
        let place = rig.sources.iter().position(place);
        let sha256 = place.and_then(|place| rig.hashes.get(place));
        let versions = Versions::of(&rig.name).ok();
        // What was read: it may have been replaced meanwhile, by the run itself.
        let version = versions.as_ref().zip(sha256);
        let version = version.and_then(|(versions, (_, sha256))| versions.number_by(sha256, rig));
        Self {
            rig: rig.name.clone(),
            built_in: is_built_in(&rig.name),
            calibration: rig
                .believing
                .as_ref()
                .map(|file| file.display().to_string()),
            calibration_version: version,
            calibration_date: rig.calibration_date.clone(),
            calibration_sha256: sha256.map_or_else(String::new, |(_, sha256)| sha256.clone()),
            changed_since: versions
                .filter(|_| version.is_none() && rig.believing.is_none())
                .and_then(|versions| versions.newest()),
        }
    }
}

impl RunsOn {
    /// What runs on this bench: its calibration has no versions.
    pub fn of_bench(rig: &BenchRig) -> Self {
        let (_, sha256) = &rig.hashes[rig.calibration];
        Self {
            rig: rig.name.clone(),
            built_in: is_built_in(&rig.name),
            calibration: rig
                .believing
                .as_ref()
                .map(|file| file.display().to_string()),
            calibration_version: None,
            calibration_date: rig.calibration_date.clone(),
            calibration_sha256: sha256.clone(),
            changed_since: None,
        }
    }
}

/// A document with the rig that it ran on, and what became of what was found, if anything was. Keys are a contract.
#[derive(Debug, Serialize)]
pub struct On<'d, D: Serialize, F: Serialize = ()> {
    #[serde(flatten)]
    document: &'d D,
    #[serde(rename = "runs_on")]
    rig: RunsOn,
    #[serde(skip_serializing_if = "Option::is_none")]
    found: Option<&'d F>,
}

impl<'d, D: Serialize> On<'d, D> {
    /// A document of what ran on this rig.
    pub fn new(rig: &Rig, document: &'d D) -> Self {
        Self {
            document,
            rig: RunsOn::of(rig),
            found: None,
        }
    }
}

impl<'d, D: Serialize, F: Serialize> On<'d, D, F> {
    /// A document of what ran on a rig, and has found something, or nothing.
    pub fn with(rig: RunsOn, document: &'d D, found: Option<&'d F>) -> Self {
        Self {
            document,
            rig,
            found,
        }
    }
}

impl Display for RunsOn {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        write!(f, "rig {}", self.rig)?;
        if self.built_in {
            write!(f, " (built in)")?;
        } else if rig_folder(&self.rig).is_some_and(|folder| shipped(&folder).is_some()) {
            write!(f, " (as it ships)")?;
        }
        write!(f, ", calibration")?;
        if let Some(version) = self.calibration_version {
            write!(f, " version {version}")?;
        } else if let Some(file) = &self.calibration {
            write!(f, " {file}")?;
        }
        if let Some(date) = &self.calibration_date {
            write!(f, " of {date}")?;
        }
        if let Some(version) = self.changed_since {
            write!(f, ", changed by hand since version {version}")?;
        }
        let sha = &self.calibration_sha256;
        write!(f, " (sha {})", sha.get(..SHORT).unwrap_or(sha))
    }
}

/// What a command makes use of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Windup of the five-bars: of a z-stage it is too small to matter.
    Windup,
    /// Hysteresis of the piezos, and how long a micro takes to come to rest.
    Micro,
    /// Pulses.
    Impulse,
}

impl Part {
    /// What an alignment makes use of that goes without pulses.
    pub const ALIGNMENT: &'static [Self] = &[Self::Windup, Self::Micro];
}

/// What is missing or stale in a calibration, and what that costs: a line each.
///
/// The costs are those of the fast procedure on twins of the shipped rig (100 devices from seed 61000; of `rbf` 300 from
/// seed 62000), where a fiber takes 0.8 s in the median and 1.1 s on average.
///
/// Stale is what was measured before what it rests on was written anew, by the days that the tables name: windup and
/// pulses on the gains of their axis, which moved it while they were measured, and on its geometry, by which a
/// turn became a length; the piezos' hysteresis on the micro's geometry.
pub fn notes(rig: &Rig, parts: &[Part]) -> Vec<String> {
    let c = &rig.calibration;
    let (gains, geometry) = (&c.gains, &c.geometry);
    let five_bar = [
        ("gains.five_bar", gains.five_bar.date.as_str()),
        ("geometry.five_bar", geometry.five_bar.date.as_str()),
    ];
    let z = [
        ("gains.z", gains.z.date.as_str()),
        ("geometry.z", geometry.z.date.as_str()),
    ];
    let micro = [("geometry.micro", geometry.micro.date.as_str())];
    let mut notes = Vec::new();
    for part in parts {
        match part {
            Part::Windup => {
                for at in AxisName::joints() {
                    let note = match c.windup.of(at) {
                        None => Some(
                            "no windup.five_bar: the five-bars search as without it, by the fast procedure 6.6 s a fiber on \
                             average where 1.1 s is usual with it; `pigtail identify windup fivebar` measures it"
                                .to_owned(),
                        ),
                        Some(w) => {
                            let axis = c.windup.own(at).map_or("fivebar".to_owned(), |_| at.to_string());
                            stale(&c.windup.table(at), &w.date, &five_bar, &format!("identify windup {axis}"))
                        }
                    };
                    // What joints have in common is said once.
                    notes.extend(note.filter(|note| !notes.contains(note)));
                }
            }
            Part::Micro => {
                notes.extend(hysteresis(c));
                for (side, belief) in [("left", &c.hysteresis.left), ("right", &c.hysteresis.right)]
                {
                    let Some(belief) = belief else { continue };
                    let again = format!("identify hysteresis --side {side}");
                    notes.extend(stale(
                        &format!("hysteresis.{side}"),
                        &belief.date,
                        &micro,
                        &again,
                    ));
                }
                if geometry.micro.settling.is_none() {
                    notes.push(format!(
                        "no settling in geometry.micro: the datasheet's {} ms are waited for, on the shipped rig's twins 0.01 s \
                         a fiber",
                        1e3 * rig.spec.micro.settling
                    ));
                }
            }
            Part::Impulse => {
                for (name, belief, on, axis) in [
                    (
                        "impulse.five_bar",
                        &c.impulse.five_bar,
                        &five_bar,
                        "fivebar",
                    ),
                    ("impulse.z", &c.impulse.z, &z, "z"),
                ] {
                    // What is missing is said by whoever would play pulses.
                    let Some(belief) = belief else { continue };
                    let again = format!("characterize {axis} impulse");
                    notes.extend(stale(name, &belief.date, on, &again));
                }
            }
        }
    }
    notes
}

/// What is missing of the piezos' hysteresis, or not good enough to align with.
fn hysteresis(c: &Calibration) -> Vec<String> {
    let sides = [("left", &c.hysteresis.left), ("right", &c.hysteresis.right)];
    let without =
        |(side, belief): &(&str, &Option<_>)| belief.is_none().then(|| (*side).to_owned());
    let missing: Vec<String> = sides.iter().filter_map(without).collect();
    let mut notes = Vec::new();
    if let Some(side) = missing.first() {
        let (what, seconds, option) = match missing.len() {
            1 if side == "left" => ("no hysteresis.left".to_owned(), 1.5, " --side left"),
            1 => ("no hysteresis.right".to_owned(), 1.7, " --side right"),
            _ => (
                "no hysteresis.left, no hysteresis.right".to_owned(),
                2.1,
                "",
            ),
        };
        notes.push(format!(
            "{what}: a micro goes astray by its piezos' hysteresis, by the fast procedure {seconds} s a fiber on average \
             where 1.1 s is usual with it; `pigtail identify hysteresis{option}` measures it"
        ));
    }
    notes
}

/// That something was measured before what it rests on was written, if so. What has no date, as what a campaign's
/// machines were commissioned with, tells nothing of that.
fn stale(name: &str, date: &str, on: &[(&str, &str)], again: &str) -> Option<String> {
    if date.is_empty() {
        return None;
    }
    // Days are written year first: their order is that of their letters.
    let (newer, when) = on.iter().find(|(_, written)| *written > date)?;
    Some(format!(
        "{name} of {date} is older than {newer} of {when}, on which it rests; `pigtail {again}` measures it anew"
    ))
}
