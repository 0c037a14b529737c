//! Identification of an axis's windup on a twin, and what compensating it is worth.

use crate::characterize::no_probe;
use crate::job::{Ended, Job, Order, Work};
use crate::rig::Rig;
use pigtail_control::identify::{
    Fit, Path, Scale, WindupRecord, backlash, error_span, fit_memory, fit_reversal, scan,
};
use pigtail_control::outcome::Outcome;
use pigtail_control::station::Station;
use pigtail_hal::{Axis, AxisName, Error};
use pigtail_model::windup::{Memory, Reversal, Windup};
use pigtail_numerics::rounded;
use serde::{Deserialize, Serialize};

/// Which model of windup.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
    Serialize,
    serde::Deserialize,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// Maxwell-slip elements with a hardening: right after any history
    Memory,
    /// The thesis's function of the way since the last reversal, (2.20)-(2.26)
    Reversal,
}

/// What `identify windup` prints as JSON and keeps as `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WindupDocument {
    /// The axis.
    pub axis: String,
    /// The model that was fitted and tried.
    pub model: Model,
    /// `W_max` of (2.20), micrometres at the output.
    pub w_max_um: f64,
    /// `Q` of (2.20), micrometres at the output.
    pub q_um: f64,
    /// Root mean square of the windup that the model leaves over the identification scan.
    pub residual_um: f64,
    /// Gap between the forward and the backward path over the full range without compensation.
    pub uncompensated_um: f64,
    /// The same with compensation.
    pub compensated_um: f64,
    /// How many times narrower.
    pub factor: f64,
    /// How many times less the output errs peak to peak, over the scan where it is least.
    pub worst_factor: f64,
    /// Scans on which the compensation was tried, after the identification.
    pub scans: Vec<ScanRow>,
    /// Range of the first scan, micrometres at the output.
    pub range_um: f64,
    /// The seed of the machine.
    pub seed: u64,
    /// The calibration that was written; empty when none was.
    pub calibration: String,
    /// Path of the report.
    pub report: String,
}

/// One scan, without compensation and with either model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScanRow {
    /// What was scanned.
    pub name: &'static str,
    /// Gap between the paths over the same wanted output without compensation, micrometres.
    pub uncompensated_um: f64,
    /// With (2.20)-(2.26).
    pub reversal_um: f64,
    /// With the model that remembers.
    pub memory_um: f64,
    /// Peak-to-peak error of the output, micrometres: without compensation, with (2.20)-(2.26),
    /// with the model that remembers.
    pub peak_to_peak_um: [f64; 3],
}

/// An identified axis.
#[derive(Debug, Clone)]
pub struct Identified {
    /// What to print.
    pub document: WindupDocument,
    /// The scan from which it was identified.
    pub record: WindupRecord,
    /// The first scan without and with compensation.
    pub before_and_after: [WindupRecord; 2],
    /// The thesis's model.
    pub reversal: Reversal,
    /// The model that remembers.
    pub memory: Memory,
    /// Micrometres at the output for a radian.
    pub um_per_radian: f64,
}

impl Identified {
    /// The model as a table of a calibration; found on a `date`, by an `origin`.
    pub fn values(&self, date: &str, origin: &str) -> Vec<(&'static str, toml_edit::Item)> {
        let residual = self.document.residual_um / self.um_per_radian;
        let models = (&self.reversal, &self.memory);
        values(self.document.model, models, residual, (date, origin))
    }

    /// Way (radians) and share of the torque of each element that has one.
    pub fn elements(&self) -> Vec<[f64; 2]> {
        elements(&self.memory)
    }
}

fn elements(memory: &Memory) -> Vec<[f64; 2]> {
    let pairs = memory.ways.iter().zip(&memory.stiffness);
    pairs
        .filter(|(_, k)| **k != 0.0)
        .map(|(way, k)| [*way, way * k])
        .collect()
}

/// Models of windup as a table of a calibration, of which one is to be used; what it leaves is in radians. Found on a date, by an origin.
fn values(
    model: Model,
    (reversal, memory): (&Reversal, &Memory),
    residual: f64,
    (date, origin): (&str, &str),
) -> Vec<(&'static str, toml_edit::Item)> {
    let radians = |value: f64| format!("{value:.6e} rad");
    let model: &str = model.into();
    let hardening = memory.hardening.iter().map(|part| radians(*part));
    let elements = elements(memory).into_iter();
    let elements = elements.map(|pair| pair.into_iter().collect::<toml_edit::Array>());
    vec![
        ("model", toml_edit::value(model)),
        ("w_max", toml_edit::value(radians(reversal.maximum))),
        ("q", toml_edit::value(radians(reversal.way))),
        (
            "hardening",
            toml_edit::value(hardening.collect::<toml_edit::Array>()),
        ),
        (
            "elements",
            toml_edit::value(elements.collect::<toml_edit::Array>()),
        ),
        ("residual", toml_edit::value(radians(residual))),
        ("date", toml_edit::value(date)),
        ("origin", toml_edit::value(origin)),
    ]
}

/// What counts and radians of an axis are at its output.
///
/// # Errors
///
/// When the rig has no probes.
pub fn scale(rig: &Rig, axis: Axis) -> Result<Scale, Error> {
    let drive = rig.spec.drive(axis);
    let probe = rig.spec.probe.as_ref().ok_or_else(|| no_probe(rig))?;
    Ok(Scale {
        radians_per_count: drive.count() / drive.gear_ratio,
        metres_per_radian: match axis {
            Axis::A | Axis::B => probe.arm,
            Axis::Z => rig.calibration.geometry.z.lead / std::f64::consts::TAU,
        },
    })
}

/// The range over which an axis is identified, metres at the output: 700 um of a five-bar joint
/// (thesis, Fig. 2.8), 20 um of z.
pub fn range(axis: Axis) -> f64 {
    match axis {
        Axis::A | Axis::B => 700e-6,
        Axis::Z => 20e-6,
    }
}

/// The same in radians of the output, and how fast it is gone over, radians a second.
fn range_and_speed(axis: Axis, scale: &Scale) -> (f64, f64) {
    let range = range(axis) / scale.metres_per_radian;
    (range, 0.25 * range)
}

/// Both models of an axis's windup, and the scan to which they were fitted.
#[derive(Debug, Clone)]
pub struct Models {
    /// The scan.
    pub record: WindupRecord,
    /// (2.20) fitted to it.
    pub reversal: Fit<Reversal>,
    /// The elements fitted to it.
    pub memory: Fit<Memory>,
}

impl Models {
    /// Whether there is windup that a model could tell: more of it than what is left of the best one.
    fn winds(&self) -> bool {
        /// Of what is left, rms.
        const SEEN: f64 = 1.0;
        self.reversal.model.maximum > SEEN * self.memory.residual
    }

    /// The same, if there is; so many micrometres at the output are a radian.
    fn if_it_winds(self, at: AxisName, um: f64) -> Result<Self, Outcome> {
        if self.winds() {
            return Ok(self);
        }
        let [w_max, left] =
            [self.reversal.model.maximum, self.memory.residual].map(|angle| um * angle);
        let why = format!(
            "{at} shows no windup to compensate: {w_max:.2} um (`W_max`), and a model leaves {left:.2} um, rms"
        );
        Err(Outcome::BenchFailed { why })
    }

    /// Scans an axis, and fits both models.
    fn of(
        station: &mut Station,
        at: AxisName,
        scale: &Scale,
        (range, speed): (f64, f64),
    ) -> Result<Self, Ended> {
        let path = Path::identification(range, speed);
        let record = scan(station, at, scale, &path, &Windup::None)?;
        Ok(Self::fit(record, range, speed))
    }

    /// Fits both models to a scan along [`Path::identification`] over `range` at `speed` (radians of the
    /// output, and a second).
    pub fn fit(record: WindupRecord, range: f64, speed: f64) -> Self {
        // The first way there starts from an unwound transmission, which no model speaks of; then
        // come four that wind it up fully.
        let lead = (range / speed / record.period) as usize;
        let reversal = fit_reversal(&record, lead..5 * lead);
        let memory = fit_memory(&record, lead, &reversal);
        Self {
            record,
            reversal,
            memory,
        }
    }
}

/// Drive an axis along a path of its output, and note input and output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScanWindup {
    /// The axis.
    pub at: AxisName,
    /// The path, radians of the output.
    pub path: Path,
}

impl Job for ScanWindup {
    type Output = WindupRecord;

    fn run(&self, work: &mut Work<'_>) -> Result<WindupRecord, Ended> {
        let scale = scale(work.rig(), self.at.axis)?;
        let mut station = work.station()?;
        Ok(scan(
            &mut station,
            self.at,
            &scale,
            &self.path,
            &Windup::None,
        )?)
    }

    fn order(&self) -> Order {
        Order::ScanWindup(self.clone())
    }
}

/// Identifies the windup of an axis and tries the compensation, all on the same machine.
///
/// # Errors
///
/// A fault; bad input where the rig has no probes.
pub fn windup(
    station: &mut Station,
    rig: &Rig,
    at: AxisName,
    model: Model,
    seed: u64,
) -> Result<Identified, Ended> {
    let scale = scale(rig, at.axis)?;
    let um = 1e6 * scale.metres_per_radian;
    let (range, speed) = range_and_speed(at.axis, &scale);
    let Models {
        record,
        reversal,
        memory,
    } = Models::of(station, at, &scale, (range, speed))?.if_it_winds(at, um)?;
    let tried_models = [
        Windup::None,
        Windup::Reversal(reversal.model),
        Windup::Memory(memory.model),
    ];

    // Every scan starts with two full ways, so that machine and model are in the same state.
    let scans = [
        ("full range", vec![0.0, 1.0, 0.0, 1.0, 0.0]),
        (
            "a quarter of the range",
            vec![0.0, 1.0, 0.375, 0.625, 0.375],
        ),
        (
            "a quarter, repeated",
            vec![0.0, 1.0, 0.375, 0.625, 0.375, 0.625, 0.375, 0.625, 0.375],
        ),
        ("random reversals", random_turns(seed)),
    ];
    let mut rows = Vec::with_capacity(scans.len());
    let mut before_and_after = [WindupRecord::default(), WindupRecord::default()];
    for (i, (name, turns)) in scans.into_iter().enumerate() {
        let path = Path {
            turns: turns.iter().map(|t| t * range).collect(),
            speed,
        };
        let skip = (path.turns[..3]
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .sum::<f64>()
            / speed
            / record.period) as usize;
        let (mut gaps, mut spans) = ([0.0; 3], [0.0; 3]);
        for (k, model) in tried_models.iter().enumerate() {
            let tried = scan(station, at, &scale, &path, model)?;
            gaps[k] = rounded(um * backlash(&tried, skip), 1e-4);
            spans[k] = rounded(um * error_span(&tried, skip), 1e-4);
            if i == 0 && k != 1 {
                before_and_after[k / 2] = tried;
            }
        }
        rows.push(ScanRow {
            name,
            uncompensated_um: gaps[0],
            reversal_um: gaps[1],
            memory_um: gaps[2],
            peak_to_peak_um: spans,
        });
    }
    let first = &rows[0];
    let (residual, compensated) = match model {
        Model::Reversal => (reversal.residual, first.reversal_um),
        Model::Memory => (memory.residual, first.memory_um),
    };
    let column = match model {
        Model::Reversal => 1,
        Model::Memory => 2,
    };
    let worst = rows
        .iter()
        .map(|row| row.peak_to_peak_um[0] / row.peak_to_peak_um[column])
        .fold(f64::INFINITY, f64::min);
    let document = WindupDocument {
        axis: at.to_string(),
        model,
        w_max_um: rounded(um * reversal.model.maximum, 1e-4),
        q_um: rounded(um * reversal.model.way, 1e-4),
        residual_um: rounded(um * residual, 1e-4),
        uncompensated_um: first.uncompensated_um,
        compensated_um: compensated,
        factor: rounded(first.uncompensated_um / compensated, 1e-3),
        worst_factor: rounded(worst, 1e-3),
        range_um: rounded(um * range, 1e-4),
        scans: rows,
        seed,
        calibration: String::new(),
        report: String::new(),
    };
    Ok(Identified {
        document,
        record,
        before_and_after,
        reversal: reversal.model,
        memory: memory.model,
        um_per_radian: um,
    })
}

/// Turns anywhere in the range after two full ways.
fn random_turns(seed: u64) -> Vec<f64> {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let mut turns = vec![0.0, 1.0, 0.0];
    turns.extend((0..12).map(|_| rng.random::<f64>()));
    turns
}

/// Windup of an axis as it was measured, and one scan that tried the model that remembers.
#[derive(Debug, Clone)]
pub struct MeasuredWindup {
    models: Models,
    um_per_radian: f64,
    /// Gap between the forward and the backward path over the full range without compensation, micrometres.
    pub gap_without: f64,
    /// The same with compensation.
    pub gap_with: f64,
}

impl MeasuredWindup {
    /// The model as a table of a calibration; found on a `date`, by an `origin`.
    pub fn values(&self, date: &str, origin: &str) -> Vec<(&'static str, toml_edit::Item)> {
        let Models {
            reversal, memory, ..
        } = &self.models;
        let models = (&reversal.model, &memory.model);
        values(Model::Memory, models, memory.residual, (date, origin))
    }

    /// Whether there is windup that the model could tell.
    pub fn winds(&self) -> bool {
        self.models.winds()
    }

    /// `W_max` and `Q` of (2.20), and the root mean square that the model that remembers leaves, micrometres.
    pub fn in_um(&self) -> [f64; 3] {
        let Models {
            reversal, memory, ..
        } = &self.models;
        let radians = [reversal.model.maximum, reversal.model.way, memory.residual];
        radians.map(|value| self.um_per_radian * value)
    }
}

/// So many times as fast as it is identified by itself windup is measured with that of all others: by how fast an axis goes it hardly changes.
const FASTER: f64 = 2.0;

/// Measure the windup of an axis, and try the model that remembers on it once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasureWindup {
    /// The axis.
    pub at: AxisName,
}

impl Job for MeasureWindup {
    type Output = MeasuredWindup;

    fn run(&self, work: &mut Work<'_>) -> Result<MeasuredWindup, Ended> {
        let (at, scale) = (self.at, scale(work.rig(), self.at.axis)?);
        let mut station = work.station()?;
        let (range, usual) = range_and_speed(at.axis, &scale);
        let speed = FASTER * usual;
        let models = Models::of(&mut station, at, &scale, (range, speed))?;
        let turns = [0.0, 1.0, 0.0, 1.0, 0.0].map(|turn| turn * range).to_vec();
        let path = Path { turns, speed };
        let model = Windup::Memory(models.memory.model);
        let tried = scan(&mut station, at, &scale, &path, &model)?;
        // Two ways over the range come first, after which every transmission is wound up as all others are.
        let skip = (2.0 * range / speed / tried.period) as usize;
        let ways = 5 * (range / speed / models.record.period) as usize;
        let full = |record: &WindupRecord| WindupRecord {
            output: record.output.iter().take(ways).copied().collect(),
            wanted: record.wanted.iter().take(ways).copied().collect(),
            ..WindupRecord::default()
        };
        let um = 1e6 * scale.metres_per_radian;
        Ok(MeasuredWindup {
            gap_without: um * backlash(&full(&models.record), skip),
            gap_with: um * backlash(&tried, skip),
            um_per_radian: um,
            models,
        })
    }

    fn order(&self) -> Order {
        Order::MeasureWindup(*self)
    }
}

/// Identify the windup of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct IdentifyWindup {
    /// The axis.
    pub at: AxisName,
    /// The model that is asked for.
    pub model: Model,
    /// What random reversals are drawn by.
    pub seed: u64,
}

impl Job for IdentifyWindup {
    type Output = Identified;

    fn run(&self, work: &mut Work<'_>) -> Result<Identified, Ended> {
        let rig = work.rig();
        windup(&mut work.station()?, rig, self.at, self.model, self.seed)
    }

    fn order(&self) -> Order {
        Order::IdentifyWindup(*self)
    }
}
