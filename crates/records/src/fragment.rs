//! A fragment of a rig: the model of one axis from a record, for whatever takes `--from`.

use super::columns::Source;
use super::part::{LOAD, Part, STIFF};
use pigtail_hal::{Error, config};
use pigtail_sysid::servo::{Axis, Controller, Motion};
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
    /// How far the record's motion went.
    pub motion: Option<MotionTable>,
    /// The axis as a z-stage of a `plant.toml`, where it moves along a line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub z_stage: Option<toml::Table>,
    /// The axis as a joint of a five-bar of a `plant.toml`, where it turns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub five_bar: Option<toml::Table>,
    /// Its drive, as a part of a `machine.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<toml::Table>,
    /// Gains to begin with, as a part of a `calibration.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<toml::Table>,
}

impl Fragment {
    /// With the axis as a part of a rig.
    #[must_use]
    pub fn with(mut self, part: Part) -> Self {
        let Part {
            mut plant,
            machine,
            calibration,
        } = part;
        let mut table = |name: &str| match plant.remove(name) {
            Some(toml::Value::Table(table)) => Some(table),
            _ => None,
        };
        self.z_stage = table("z_stage");
        self.five_bar = table("five_bar");
        self.machine = Some(machine);
        self.calibration = Some(calibration);
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

/// How far an axis was seen to go, [`Motion`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionTable {
    /// Range of the positions, m or rad.
    pub stroke: f64,
    /// Highest speed, m/s or rad/s.
    pub speed: f64,
    /// Highest acceleration but for a hundredth, m/s^2 or rad/s^2.
    pub acceleration: f64,
    /// Largest voltage, V.
    pub voltage: f64,
    /// Noise of a position, standard deviation, m or rad.
    pub noise: f64,
    /// Up to what frequency the record was looked at, hertz.
    pub bandwidth: f64,
}

impl MotionTable {
    /// Of a record.
    pub fn new(motion: &Motion) -> Self {
        Self {
            stroke: motion.stroke,
            speed: motion.speed,
            acceleration: motion.acceleration,
            voltage: motion.voltage,
            noise: motion.noise,
            bandwidth: motion.bandwidth,
        }
    }
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
            "# The model of an axis from a record, SI units. `pigtail twin`, `tune`, `characterize`, `align` and\n\
             # `rig` take it with --from. What a record of one encoder does not tell, [z_stage.joint] or\n\
             # [five_bar.joint] assume: friction that is the mean of both directions, Coulomb friction on the\n\
             # motor's side and viscous on the load's, {:.0} % of the inertia behind a transmission of {} Hz.\n\n{}",
            100.0 * LOAD,
            STIFF,
            toml::to_string_pretty(self)?
        ))
    }

    /// Where a fragment is: its file, or that in the folder of its run.
    pub fn file(path: &Path) -> PathBuf {
        if path.is_dir() {
            path.join("plant.toml")
        } else {
            path.to_owned()
        }
    }

    /// Reads a fragment, from its file or the folder of its run.
    ///
    /// # Errors
    ///
    /// When the file cannot be read, or a key is missing, unknown or out of range.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let path = &Self::file(path);
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
        if let Some(motion) = &self.motion {
            for (key, value) in [
                ("motion.stroke", motion.stroke),
                ("motion.speed", motion.speed),
                ("motion.acceleration", motion.acceleration),
                ("motion.voltage", motion.voltage),
                ("motion.bandwidth", motion.bandwidth),
            ] {
                if !(value.is_finite() && value > 0.0) {
                    let message = format!("is {value}; accepted is a finite number above zero");
                    return Err(Error::new(file, key, message));
                }
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
