//! An identified axis as a part of a rig: what each of the rig's three files says of it.
//!
//! The plant is the identified model, for the twin. The datasheet is what a maker would print: drive, encoder
//! and amplifier, given by the person or else no better than the record shows them. The belief is gains to
//! begin with.

use super::fragment::{AxisTable, ControllerTable, Kind, MotionTable};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Friction of a load in the terms of a joint, SI units: `[part]` of the fragment of `identify friction`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slides {
    /// Whether it slides along a line or turns.
    pub kind: Kind,
    /// The law, as a joint of a `plant.toml` names it.
    pub friction: String,
    /// Way before it slides, m or rad.
    pub presliding: f64,
    /// Static level, N or N m.
    pub fixed: f64,
    /// Coulomb level, N or N m.
    pub coulomb: f64,
    /// N s/m or N m s/rad, where the law has it.
    pub viscous: Option<f64>,
    /// Velocity above which friction falls to its Coulomb level, m/s or rad/s, where the law has it.
    pub stribeck: Option<f64>,
}

/// What winds a transmission up: `[transmission]` beside the calibration that `identify windup` writes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Winds {
    /// `five_bar` or `z`.
    pub table: String,
    /// Full windup to one side, radians of the output.
    pub w_max: f64,
    /// `q_0` of its exponential rise, radians of the output.
    pub presliding: f64,
    /// Radians of the output for a N m of the motor's torque, where it was measured.
    pub compliance: Option<f64>,
}

/// What a record of the axis alone does not tell of its drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Turns of the output for one turn of the motor.
    pub ratio: f64,
    /// Travel for one turn of the screw, metres, of an axis that moves along a line.
    pub lead: f64,
    /// Encoder counts in one turn of the motor; as coarse as the position's noise if none.
    pub counts: Option<u32>,
    /// The amplifier's bound, volts; what the record reaches if none.
    pub limit: Option<f64>,
}

impl Drive {
    /// A drive of which nothing was said: a screw of 10 mm without a gear. In metres the axis moves alike
    /// whatever these are.
    pub const PLAIN: Self = Self {
        ratio: 1.0,
        lead: 0.01,
        counts: None,
        limit: None,
    };

    /// Way of the axis for a radian of the motor, m or rad.
    fn way(&self, kind: Kind) -> f64 {
        match kind {
            Kind::Linear => self.ratio * self.lead / TAU,
            Kind::Rotary => self.ratio,
        }
    }
}

/// Share of the inertia that stands behind the transmission, whose compliance the record does not tell.
pub(super) const LOAD: f64 = 0.1;

/// Resonance of motor against load that is taken for that transmission, hertz: beyond what a servo
/// excites, and slow enough for the twin's steps.
pub(super) const STIFF: f64 = 200.0;

/// Share of the viscous friction that is taken as the motor's back emf.
const BACK_EMF: f64 = 0.1;

/// Slowest motor that a datasheet may have, rad/s.
const SLOWEST: f64 = 1.1;

/// Finest encoder that is believed in, shares of the stroke.
const FINEST: f64 = 1e-7;

/// Rate of the servo for which gains are chosen, hertz: the thesis's card.
const SERVO: f64 = 2500.0;

/// Crossover of a velocity loop that a sampling servo stands, radians a cycle.
const SAMPLED: f64 = 0.3;

/// Share of the amplifier's bound by which a count may flicker through the derivative.
const FLICKER: f64 = 0.2;

/// The tables of an axis: below `z_stage` or `five_bar` of a `plant.toml`, its drive in a `machine.toml`,
/// and `gains` and `geometry` of a `calibration.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Of `plant.toml`.
    pub plant: toml::Table,
    /// Of `machine.toml`.
    pub machine: toml::Table,
    /// Of `calibration.toml`.
    pub calibration: toml::Table,
}

fn text(value: f64, unit: &str) -> toml::Value {
    toml::Value::from(format!("{} {unit}", digits(value)))
}

/// Seven digits: more than any record tells, and a text that a person can read.
fn digits(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

fn table<const N: usize>(pairs: [(&str, toml::Value); N]) -> toml::Value {
    toml::Value::Table(
        pairs
            .into_iter()
            .map(|(k, v)| (k.to_owned(), v))
            .collect::<toml::Table>(),
    )
}

fn below(name: &str, value: toml::Value) -> toml::Table {
    std::iter::once((name.to_owned(), value)).collect()
}

impl Part {
    /// Of an axis behind a drive, as its record saw it move. `origin` and `date` go with what control
    /// believes.
    pub fn new(
        axis: &AxisTable,
        controller: Option<&ControllerTable>,
        motion: &MotionTable,
        drive: &Drive,
        (date, origin): (&str, &str),
    ) -> Self {
        let way = drive.way(axis.kind);
        let fine = (12f64.sqrt() * motion.noise).max(FINEST * motion.stroke);
        let counts = drive
            .counts
            .unwrap_or((TAU * way / fine).round().clamp(4.0, f64::from(u32::MAX)) as u32);
        let count = TAU * way / f64::from(counts);
        let level = axis.coulomb[0].max(axis.coulomb[1]) + axis.offset.abs();
        let limit = drive
            .limit
            .or(controller.and_then(|c| c.limit))
            .unwrap_or(motion.voltage)
            .max(motion.voltage);
        let hold = (level / axis.force_per_volt).max(0.01 * limit);
        let amplifier = table([
            ("gear_ratio", toml::Value::from(1.0 / drive.ratio)),
            ("counts_per_turn", toml::Value::from(i64::from(counts))),
            ("voltage", text(limit, "V")),
            // The record's motion may be slow: what bounds the axis is its own speed, not the motor's.
            ("speed", text((motion.speed / way).max(SLOWEST), "rad/s")),
            ("start", text((1.5 * hold).min(limit), "V")),
        ]);
        let [kp, ki, kd] = gains(axis, motion, count, limit);
        let gains = table([
            ("kp", text(kp * count, "V/count")),
            ("ki", text(ki * count, "V/(count s)")),
            ("kd", text(kd * count, "V s/count")),
            ("integral_limit", text((2.0 * hold).min(limit), "V")),
            ("date", date.into()),
            ("origin", origin.into()),
        ]);
        let joint = ("joint", joint(axis, drive));
        let machine = table([("drive", amplifier)]);
        match axis.kind {
            Kind::Linear => {
                let lead = text(drive.lead, "m");
                let screw = table([
                    ("lead", lead.clone()),
                    ("date", date.into()),
                    ("origin", origin.into()),
                ]);
                let calibration = [
                    ("gains", below("z", gains)),
                    ("geometry", below("z", screw)),
                ];
                Self {
                    plant: below("z_stage", table([("lead", lead), joint])),
                    machine: below("z_stage", machine),
                    calibration: calibration
                        .into_iter()
                        .map(|(k, v)| (k.to_owned(), toml::Value::Table(v)))
                        .collect(),
                }
            }
            Kind::Rotary => Self {
                plant: below("five_bar", table([joint])),
                machine: below("five_bar", machine),
                calibration: below("gains", toml::Value::Table(below("five_bar", gains))),
            },
        }
    }
}

/// Gains to begin with, in volts of a unit of position, by the identified inertia: a velocity loop that crosses
/// over where the record was still looked at, but no faster than a servo samples, nor so fast that the
/// flicker of a `count` moves the amplifier by more than a share of its bound; inside a position loop half as
/// fast, with an integral of a fifth of that.
fn gains(axis: &AxisTable, motion: &MotionTable, count: f64, limit: f64) -> [f64; 3] {
    let (force, inertia) = (axis.force_per_volt, axis.inertia);
    let viscous = 0.5 * (axis.viscous[0] + axis.viscous[1]);
    let quiet = FLICKER * limit * force / (inertia * count * SERVO);
    let crossover = (TAU * motion.bandwidth).min(SAMPLED * SERVO).min(quiet);
    let whole = inertia * crossover / force;
    let kd = (whole - viscous / force).max(0.5 * whole);
    let kp = 0.5 * whole * crossover;
    [kp, 0.2 * kp * crossover, kd]
}

/// The axis as a joint of a `plant.toml`: nearly all inertia on the motor's side, Coulomb friction there
/// too, the transmission as good as rigid, for the record does not tell them apart. Viscous friction is the
/// load's: on the motor's side a load without any would ring for a quarter of a second after every motion,
/// which none of metal does.
fn joint(axis: &AxisTable, drive: &Drive) -> toml::Value {
    let way = drive.way(axis.kind);
    let ratio = drive.ratio;
    // Way of the axis for a radian of the output.
    let output = way / ratio;
    let inertia = axis.inertia * way * way;
    let viscous = 0.5 * (axis.viscous[0] + axis.viscous[1]) * way * way;
    let coulomb = 0.5 * (axis.coulomb[0] + axis.coulomb[1]) * way;
    let gain = axis.force_per_volt * way;
    let resonance = TAU * STIFF;
    let stiffness = resonance * resonance * LOAD * (1.0 - LOAD) * inertia / (ratio * ratio);
    let friction = |level: f64, viscous: f64| {
        table([
            ("static", text(level, "N m")),
            ("coulomb", text(level, "N m")),
            ("viscous", text(viscous, "N m s/rad")),
        ])
    };
    let back_emf = (BACK_EMF * viscous / gain).max(1e-12);
    table([
        ("motor_inertia", text((1.0 - LOAD) * inertia, "kg m2")),
        (
            "load_inertia",
            text(LOAD * inertia / (ratio * ratio), "kg m2"),
        ),
        ("friction", "coulomb-presliding".into()),
        ("presliding", "0 rad".into()),
        ("preload", text(0.0 - axis.offset * output, "N m")),
        (
            "motor",
            table([
                ("torque_constant", text(gain, "N m/A")),
                ("back_emf", text(back_emf, "V s/rad")),
                ("resistance", "1 ohm".into()),
            ]),
        ),
        (
            "transmission",
            table([
                ("linear", text(stiffness, "N m/rad")),
                ("cubic", "0 N m/rad3".into()),
            ]),
        ),
        ("motor_friction", friction(coulomb, 0.0)),
        (
            "load_friction",
            friction(0.0, (1.0 - BACK_EMF) * viscous / (ratio * ratio)),
        ),
    ])
}
