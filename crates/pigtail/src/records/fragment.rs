//! A fragment of a plant: the model of one axis from a record, for `pigtail twin --from`.

use super::columns::Source;
use pigtail_control::record::servo::{Axis, Controller};
use pigtail_hal::{Error, config};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a fragment holds. SI units throughout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fragment {
    /// The day, and the run by which it was found.
    pub origin: String,
    /// The axis.
    pub axis: AxisTable,
    /// Its controller, where the record told one.
    pub controller: Option<ControllerTable>,
    /// The record.
    pub record: RecordTable,
    /// The axis as a z-stage of a `plant.toml`, where its drive was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub z_stage: Option<toml::Table>,
    /// The axis as a joint of a five-bar of a `plant.toml`, where its drive was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub five_bar: Option<toml::Table>,
}

/// How a motor drives an axis: what a record of the axis alone does not tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Turns of the output for one turn of the motor.
    pub ratio: f64,
    /// Travel for one turn of the screw, metres, of an axis that moves along a line.
    pub lead: f64,
}

/// Resonance of motor against load that is taken for a transmission which the record does not tell,
/// hertz: far above what a servo excites.
const STIFF: f64 = 500.0;

/// Share of the viscous friction that is taken as the motor's back emf.
const BACK_EMF: f64 = 0.1;

impl AxisTable {
    /// The axis as a joint of a `plant.toml` behind a drive: half of the inertia on the motor's side, all
    /// friction there, the transmission as good as rigid, for the record does not tell them apart.
    fn joint(&self, drive: &Drive) -> toml::Table {
        // Way of the axis for a radian of the motor.
        let way = match self.kind {
            Kind::Linear => drive.ratio * drive.lead / std::f64::consts::TAU,
            Kind::Rotary => drive.ratio,
        };
        let inertia = self.inertia * way * way;
        let viscous = 0.5 * (self.viscous[0] + self.viscous[1]) * way * way;
        let coulomb = 0.5 * (self.coulomb[0] + self.coulomb[1]) * way;
        let gain = self.force_per_volt * way;
        let ratio = drive.ratio;
        let resonance = std::f64::consts::TAU * STIFF;
        let stiffness = resonance * resonance * inertia / (4.0 * ratio * ratio);
        let text = |value: f64, unit: &str| toml::Value::from(format!("{value:e} {unit}"));
        let table = |pairs: &[(&str, toml::Value)]| -> toml::Value {
            let pairs = pairs.iter().map(|(k, v)| ((*k).to_owned(), v.clone()));
            toml::Value::Table(pairs.collect())
        };
        let friction = |level: f64, viscous: f64| {
            table(&[
                ("static", text(level, "N m")),
                ("coulomb", text(level, "N m")),
                ("viscous", text(viscous, "N m s/rad")),
            ])
        };
        [
            ("motor_inertia", text(0.5 * inertia, "kg m2")),
            (
                "load_inertia",
                text(0.5 * inertia / (ratio * ratio), "kg m2"),
            ),
            ("friction", "coulomb-presliding".into()),
            ("presliding", "0 rad".into()),
            ("preload", "0 N m".into()),
            (
                "motor",
                table(&[
                    ("torque_constant", text(gain, "N m/A")),
                    (
                        "back_emf",
                        text((BACK_EMF * viscous / gain).max(1e-12), "V s/rad"),
                    ),
                    ("resistance", "1 ohm".into()),
                ]),
            ),
            (
                "transmission",
                table(&[
                    ("linear", text(stiffness, "N m/rad")),
                    ("cubic", "0 N m/rad3".into()),
                ]),
            ),
            (
                "motor_friction",
                friction(coulomb, (1.0 - BACK_EMF) * viscous),
            ),
            ("load_friction", friction(0.0, 0.0)),
        ]
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value))
        .collect()
    }
}

impl Fragment {
    /// With the axis as a part of a `plant.toml`.
    #[must_use]
    pub fn driven(mut self, drive: &Drive) -> Self {
        let mut part = toml::Table::new();
        part.insert("joint".to_owned(), self.axis.joint(drive).into());
        match self.axis.kind {
            Kind::Linear => {
                let lead = format!("{:e} m", drive.lead);
                part.insert("lead".to_owned(), lead.into());
                self.z_stage = Some(part);
            }
            Kind::Rotary => self.five_bar = Some(part),
        }
        self
    }
}

/// Inertia and friction of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisTable {
    /// Whether it moves along a line or turns.
    pub kind: Kind,
    /// N/V or N m/V.
    pub force_per_volt: f64,
    /// kg or kg m^2.
    pub inertia: f64,
    /// Viscous friction forward and backward, N s/m or N m s/rad.
    pub viscous: [f64; 2],
    /// Coulomb friction forward and backward, N or N m.
    pub coulomb: [f64; 2],
    /// N or N m.
    pub offset: f64,
}

/// Whether an axis moves along a line or turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Metres and newtons.
    Linear,
    /// Radians and newton metres.
    Rotary,
}

/// A controller, [`Controller`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControllerTable {
    /// V for a unit of position.
    pub kp: f64,
    /// V for a unit of position and a second.
    pub ki: f64,
    /// V for a unit of velocity.
    pub kd: f64,
    /// V for a unit of the reference's velocity.
    pub kf: f64,
    /// V.
    pub bias: f64,
    /// Bound of the voltage, V; none if absent.
    pub limit: Option<f64>,
    /// Samples over which velocity is taken.
    pub span: usize,
    /// Samples by which the voltage comes late.
    pub delay: usize,
}

/// Where the record is, and its columns by role, each as `NAME:UNIT`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordTable {
    /// The CSV file.
    pub file: PathBuf,
    /// Role (`time`, `position`, `voltage`, `reference`) to `NAME:UNIT`.
    pub columns: BTreeMap<String, String>,
}

impl AxisTable {
    /// Of an identified axis.
    pub fn new(kind: Kind, axis: &Axis) -> Self {
        Self {
            kind,
            force_per_volt: axis.force_per_volt,
            inertia: axis.inertia,
            viscous: axis.viscous,
            coulomb: axis.coulomb,
            offset: axis.offset,
        }
    }

    /// What moves.
    pub fn axis(&self) -> Axis {
        Axis {
            force_per_volt: self.force_per_volt,
            inertia: self.inertia,
            viscous: self.viscous,
            coulomb: self.coulomb,
            offset: self.offset,
        }
    }
}

impl ControllerTable {
    /// Of an identified controller.
    pub fn new(c: &Controller) -> Self {
        Self {
            kp: c.kp,
            ki: c.ki,
            kd: c.kd,
            kf: c.kf,
            bias: c.bias,
            limit: c.limit.is_finite().then_some(c.limit),
            span: c.span,
            delay: c.delay,
        }
    }

    /// The controller.
    pub fn controller(&self) -> Controller {
        Controller {
            kp: self.kp,
            ki: self.ki,
            kd: self.kd,
            kf: self.kf,
            bias: self.bias,
            limit: self.limit.unwrap_or(f64::INFINITY),
            span: self.span,
            delay: self.delay,
            error_percent: 0.0,
        }
    }
}

impl RecordTable {
    /// Of a record that was read.
    pub fn new(source: &Source) -> Self {
        Self {
            file: source.file.clone(),
            columns: source
                .columns
                .iter()
                .map(|(role, column)| ((*role).to_owned(), column.clone()))
                .collect(),
        }
    }
}

impl Fragment {
    /// As a TOML text.
    ///
    /// # Errors
    ///
    /// When a number is not finite.
    pub fn text(&self) -> anyhow::Result<String> {
        Ok(format!(
            "# The model of an axis from a record, SI units. `pigtail twin --from` takes it.\n\n{}",
            toml::to_string_pretty(self)?
        ))
    }

    /// Reads a fragment.
    ///
    /// # Errors
    ///
    /// When the file cannot be read, or a key is missing, unknown or out of range.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|error| Error::new(&file, "", format!("cannot be read: {error}")))?;
        let fragment: Self = config::parse(&file, &text)?;
        fragment.check(&file)?;
        Ok(fragment)
    }

    fn check(&self, file: &str) -> Result<(), Error> {
        let axis = &self.axis;
        let above = [
            ("axis.force_per_volt", axis.force_per_volt),
            ("axis.inertia", axis.inertia),
        ];
        for (key, value) in above {
            if !(value.is_finite() && value > 0.0) {
                let message = format!("is {value}; accepted is a finite number above zero");
                return Err(Error::new(file, key, message));
            }
        }
        let positive = [
            ("axis.viscous", axis.viscous[0]),
            ("axis.viscous", axis.viscous[1]),
            ("axis.coulomb", axis.coulomb[0]),
            ("axis.coulomb", axis.coulomb[1]),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value >= 0.0) {
                let message = format!("is {value}; accepted is a finite number of zero or more");
                return Err(Error::new(file, key, message));
            }
        }
        if let Some(c) = &self.controller {
            if !(1..=64).contains(&c.span) {
                let message = format!("is {}; accepted is 1 to 64 samples", c.span);
                return Err(Error::new(file, "controller.span", message));
            }
            if c.delay > 64 {
                let message = format!("is {}; accepted is 0 to 64 samples", c.delay);
                return Err(Error::new(file, "controller.delay", message));
            }
        }
        Ok(())
    }
}
