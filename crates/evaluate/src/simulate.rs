//! One joint alone: parameters and an input in, a trajectory out.

use anyhow::{Context, Result, bail};
use pigtail_control::calibration::AxisGains;
use pigtail_control::servo::{Pid, PidState};
use pigtail_hal::quantity::{ANGLE, Counts, LENGTH};
use pigtail_hal::{Error, config};
use pigtail_model::friction::{Friction, Mode};
use pigtail_model::joint::{Joint, JointParameters, JointState, Voltage};
use pigtail_model::motor::Motor;
use pigtail_model::pulse::{From, Pulse};
use pigtail_model::transmission::Transmission;
use pigtail_records::input;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// Parameters of one joint and its servo, named as in the equations. SI units; counts are those
/// of the motor's encoder.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(
    non_snake_case,
    reason = "the letters of the equations, as files give them"
)]
pub struct Parameters {
    /// Load inertia, kg m^2.
    pub Jl: f64,
    /// Motor inertia, kg m^2.
    pub Jm: f64,
    /// Encoder counts in one turn of the motor.
    pub Nenc: f64,
    /// Metres of output for one radian of the load.
    pub P: f64,
    /// Winding resistance, ohm.
    pub R: f64,
    /// Constant torque on the load (a preload), N m.
    #[serde(default)]
    pub Tp: f64,
    /// Servo period, seconds.
    pub Ts: f64,
    /// Bound of the integral's part of the voltage, volts.
    pub Vint: f64,
    /// Bound of the voltage, volts.
    pub Vmax: f64,
    /// Viscous friction of the load, N m s/rad.
    pub bl: f64,
    /// Viscous friction of the motor, N m s/rad.
    pub bm: f64,
    /// Coulomb friction of the load, N m.
    pub fcl: f64,
    /// Coulomb friction of the motor, N m.
    pub fcm: f64,
    /// Static friction of the load, N m.
    pub fsl: f64,
    /// Static friction of the motor, N m.
    pub fsm: f64,
    /// Back-emf constant, V s/rad.
    pub kb: f64,
    /// Cubic stiffness, N m/rad^3.
    #[serde(default)]
    pub kh: f64,
    /// Torque constant, N m/A.
    pub km: f64,
    /// Linear stiffness, N m/rad.
    pub ks: f64,
    /// Presliding displacement, radians.
    #[serde(default)]
    pub qp: f64,
    /// Turns of the output for one turn of the motor.
    pub r: f64,
    /// Proportional gain, V/count.
    pub kp: f64,
    /// Integral gain, V/(count s).
    pub ki: f64,
    /// Derivative gain, V s/count.
    pub kd: f64,
}

impl Parameters {
    /// Reads the table `axis` of a TOML or JSON file.
    ///
    /// # Errors
    ///
    /// When the file cannot be read or has no such axis (it says which it has), or a parameter
    /// is missing, unknown or out of range.
    pub fn read(path: &Path, axis: &str) -> Result<Self, Error> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|error| Error::new(&file, "", format!("cannot be read: {error}")))?;
        let parameters: Self = if path.extension().is_some_and(|e| e == "json") {
            let tables: BTreeMap<String, serde_json::Value> = serde_json::from_str(&text)
                .map_err(|error| Error::new(&file, "", format!("is not JSON: {error}")))?;
            let table = pick(&file, axis, tables, |value| value.get("Jm").is_some())?;
            serde_json::from_value(table)
                .map_err(|error| Error::new(&file, axis, error.to_string()))?
        } else {
            let tables: BTreeMap<String, Self> = config::parse(&file, &text)?;
            pick(&file, axis, tables, |_| true)?
        };
        parameters.check(&file, axis)?;
        Ok(parameters)
    }

    /// The parameters of a JSON object; `from` is where it comes from.
    ///
    /// # Errors
    ///
    /// When a parameter is missing, unknown or out of range.
    pub fn of(from: &str, json: &str) -> Result<Self, Error> {
        let parameters: Self = serde_json::from_str(json)
            .map_err(|error| Error::new(from, "params", error.to_string()))?;
        parameters.check(from, "params")?;
        Ok(parameters)
    }

    fn check(&self, file: &str, axis: &str) -> Result<(), Error> {
        for (key, value) in [
            ("Nenc", self.Nenc),
            ("P", self.P),
            ("Ts", self.Ts),
            ("Vint", self.Vint),
            ("Vmax", self.Vmax),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::new(
                    file,
                    format!("{axis}.{key}"),
                    format!("is {value}; accepted is a finite number above zero"),
                ));
            }
        }
        for (key, value) in [("kp", self.kp), ("ki", self.ki), ("kd", self.kd)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::new(
                    file,
                    format!("{axis}.{key}"),
                    format!("is {value}; accepted is a finite number of zero or more"),
                ));
            }
        }
        self.joint(self.Ts).map(|_| ()).map_err(|invalid| {
            let (value, accepted) = (invalid.value, &invalid.accepted);
            match self.letter(&invalid) {
                Some(key) => Error::new(
                    file,
                    format!("{axis}.{key}"),
                    format!("is {value}; accepted is {accepted}"),
                ),
                None => Error::new(file, axis, invalid.to_string()),
            }
        })
    }

    /// The letter of a parameter that is none, as the file has it; of motor and load the one that has the value.
    fn letter(&self, invalid: &pigtail_model::Invalid) -> Option<&'static str> {
        let of_either = |motor: (&'static str, f64), load| {
            let is_motor = motor.1.to_bits() == invalid.value.to_bits();
            if is_motor { motor.0 } else { load }
        };
        Some(match invalid.parameter {
            "motor_inertia" => "Jm",
            "load_inertia" => "Jl",
            "ratio" => "r",
            "torque_constant" => "km",
            "back_emf" => "kb",
            "resistance" => "R",
            "linear" => "ks",
            "cubic" => "kh",
            "static_friction" => of_either(("fsm", self.fsm), "fsl"),
            "coulomb_friction" => of_either(("fcm", self.fcm), "fcl"),
            "viscous_friction" => of_either(("bm", self.bm), "bl"),
            "presliding" => "qp",
            "load_torque" => "Tp",
            _ => return None,
        })
    }

    /// The joint, integrated in steps of at most `max_step` seconds.
    ///
    /// # Errors
    ///
    /// When a parameter is out of range.
    pub fn joint(&self, max_step: f64) -> Result<Joint, pigtail_model::Invalid> {
        Joint::new(
            JointParameters {
                motor_inertia: self.Jm,
                load_inertia: self.Jl,
                ratio: self.r,
                motor: Motor::new(self.km, self.kb, self.R)?,
                transmission: Transmission::new(self.ks, self.kh)?,
                motor_friction: Friction::new(self.fsm, self.fcm, self.bm)?,
                load_friction: Friction::new(self.fsl, self.fcl, self.bl)?,
                presliding: self.qp,
                load_torque: self.Tp,
            },
            max_step,
        )
    }

    fn pid(&self) -> Pid {
        let gains = AxisGains {
            kp: self.kp,
            ki: self.ki,
            kd: self.kd,
            integral_limit: self.Vint,
            speed: None,
            date: String::new(),
            origin: String::new(),
        };
        Pid::new(&gains, self.Vmax, self.Ts)
    }
}

fn pick<T>(
    file: &str,
    axis: &str,
    mut tables: BTreeMap<String, T>,
    is_axis: impl Fn(&T) -> bool,
) -> Result<T, Error> {
    tables.retain(|_, table| is_axis(table));
    tables.remove(axis).ok_or_else(|| {
        let there: Vec<&String> = tables.keys().collect();
        Error::new(
            file,
            axis,
            format!("there is no such axis; accepted is one of {there:?}"),
        )
    })
}

/// What drives the joint.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// Voltages, each held from its time (seconds) on: the amplifier is driven directly.
    Voltages(Vec<(f64, f64)>),
    /// The impulse (4.7) with amplitudes in units of the motor's static friction, and its length
    /// in seconds. Not bounded by the amplifier.
    Impulse {
        /// Half-wave amplitude over the static friction.
        a1: f64,
        /// Whole-wave amplitude over the static friction.
        a2: f64,
        /// Length, seconds.
        period: f64,
    },
    /// A step of the PID's reference at time zero, counts.
    Step(f64),
    /// References of the PID, counts, each held from its time (seconds) on; zero before.
    Reference(Vec<(f64, f64)>),
    /// A reference that rises from zero to `counts` and falls back within each `period` seconds.
    Triangle {
        /// Height, counts.
        counts: f64,
        /// Period, seconds.
        period: f64,
    },
}

impl Input {
    /// Reads voltages from a file of columns, and how it was read, in words.
    ///
    /// # Errors
    ///
    /// When the file cannot be read, a field is no finite number, or time does not increase.
    pub fn voltages(path: &Path, chosen: &input::Chosen) -> Result<(Self, String), Error> {
        let read = input::read(path, input::Kind::Voltage, chosen)?;
        Ok((Self::Voltages(read.rows), read.understood))
    }

    /// Reads a reference from a file of columns, and how it was read: in counts of the motor's encoder where no unit is
    /// known, else lengths of the output or angles of the load.
    ///
    /// # Errors
    ///
    /// As [`Self::voltages`].
    pub fn reference(
        path: &Path,
        chosen: &input::Chosen,
        p: &Parameters,
    ) -> Result<(Self, String), Error> {
        let read = input::read(path, input::Kind::Reference, chosen)?;
        // Radians of the load are `1 / r` times as many of the motor.
        let per_load = p.Nenc / std::f64::consts::TAU / p.r;
        let counts = if read.of == LENGTH {
            per_load / p.P
        } else if read.of == ANGLE {
            per_load
        } else {
            1.0
        };
        let rows = read
            .rows
            .into_iter()
            .map(|(t, v)| (t, counts * v))
            .collect();
        Ok((Self::Reference(rows), read.understood))
    }

    /// How long it is worth looking at, seconds.
    pub fn duration(&self) -> f64 {
        match self {
            Self::Voltages(rows) | Self::Reference(rows) => {
                rows.last().map_or(0.0, |last| last.0) + 0.02
            }
            Self::Impulse { .. } => 0.02,
            Self::Step(_) => 0.12,
            Self::Triangle { period, .. } => 2.0 * period,
        }
    }

    /// How finely it is worth looking at, seconds.
    pub fn row_period(&self) -> f64 {
        match self {
            Self::Impulse { .. } => 1e-5,
            _ => 1e-4,
        }
    }
}

/// How long, how finely written, how finely integrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Length of the trajectory, seconds.
    pub duration: f64,
    /// Time between rows, seconds. Divides the servo period.
    pub row_period: f64,
    /// Longest integration step, seconds.
    pub max_step: f64,
}

/// The columns of a trajectory.
pub const HEADER: &str = "time_s,u_V,q_m_rad,q_l_rad,v_m_rad_s,v_l_rad_s,output_m,mode_m,mode_l,\
                          count,ref_count";

/// Simulates a joint from rest and writes a row for each moment: the state, the voltage that is
/// applied from then on, the modes after resolving them under that voltage.
///
/// # Errors
///
/// When the grid does not fit the servo period, or `out` cannot be written.
pub fn joint(p: &Parameters, input: &Input, grid: &Grid, out: &mut impl Write) -> Result<()> {
    let per_cycle = (p.Ts / grid.row_period).round();
    if per_cycle < 1.0 || (per_cycle * grid.row_period / p.Ts - 1.0).abs() > 1e-9 {
        bail!(
            "--row-period {} s does not divide the servo period; accepted is {} s divided by a \
             whole number",
            grid.row_period,
            p.Ts
        );
    }
    let joint = p.joint(grid.max_step).context("parameters")?;
    let pid = p.pid();
    let per_radian = p.Nenc / std::f64::consts::TAU;
    let count = |state: &JointState| (state.motor_angle * per_radian + 0.5).floor();
    let mut state = JointState::default();
    let mut servo = PidState::default();
    let (mut volts, mut reference) = (0.0, 0.0);
    let rows = (grid.duration / grid.row_period).round() as u64;
    writeln!(out, "{HEADER}")?;
    for k in 0..=rows {
        let time = k as f64 * grid.row_period;
        let next = (k + 1) as f64 * grid.row_period;
        let wanted = match input {
            Input::Step(counts) => Some(*counts),
            Input::Reference(changes) => Some(held(changes, time)),
            Input::Triangle { counts, period } => {
                let phase = (time / period).fract();
                Some(counts * (1.0 - (2.0 * phase - 1.0).abs()))
            }
            _ => None,
        };
        if let Some(wanted) = wanted
            && k % per_cycle as u64 == 0
        {
            reference = (wanted + 0.5).floor();
            let voltage = pid.voltage(
                &mut servo,
                Counts(reference as i64),
                Counts(count(&state) as i64),
            );
            volts = voltage.0;
        }
        if let Some(driven) = driven_at(input, p, time) {
            volts = driven;
        }
        joint.resolve(&mut state, volts);
        let mut end = state;
        advance(&joint, &mut end, input, p, (volts, time, next));
        let mode = |mode: Mode| mode.sign() as i8;
        writeln!(
            out,
            "{:?},{:?},{:?},{:?},{:?},{:?},{:?},{},{},{},{}",
            time,
            volts,
            state.motor_angle,
            state.load_angle,
            state.motor_velocity,
            state.load_velocity,
            p.P * joint.output(&state),
            mode(state.motor_mode),
            mode(state.load_mode),
            count(&state),
            reference
        )?;
        state = end;
    }
    Ok(())
}

/// The voltage of an input that drives the amplifier directly; `None` for one that goes through
/// the PID.
fn driven_at(input: &Input, p: &Parameters, time: f64) -> Option<f64> {
    match input {
        Input::Impulse { period, .. } if time < *period => pulse(input, p).map(|u| u.at(time)),
        Input::Impulse { .. } => Some(0.0),
        Input::Voltages(changes) => Some(held(changes, time)),
        Input::Step(_) | Input::Reference(_) | Input::Triangle { .. } => None,
    }
}

fn held(changes: &[(f64, f64)], time: f64) -> f64 {
    let before = changes.partition_point(|change| change.0 <= time);
    before.checked_sub(1).map_or(0.0, |k| changes[k].1)
}

fn pulse(input: &Input, p: &Parameters) -> Option<Pulse> {
    let Input::Impulse { a1, a2, period } = *input else {
        return None;
    };
    let unit = p.R / p.km * p.fsm;
    Some(Pulse::impulse(a1 * unit, a2 * unit, period))
}

/// Advances a joint from one row to the next, never across a corner of its voltage.
fn advance(
    joint: &Joint,
    state: &mut JointState,
    input: &Input,
    p: &Parameters,
    (volts, time, next): (f64, f64, f64),
) {
    if let Some(pulse) = pulse(input, p) {
        let on = (pulse.period - time).clamp(0.0, next - time);
        if on > 0.0 {
            joint.advance(
                state,
                From {
                    voltage: pulse,
                    since: time,
                },
                on,
            );
        }
        joint.advance(state, 0.0, next - time - on);
    } else if let Input::Voltages(changes) = input {
        let mut at = time;
        let from = changes.partition_point(|change| change.0 <= time);
        for change in changes[from..].iter().take_while(|change| change.0 < next) {
            joint.advance(state, held(changes, at), change.0 - at);
            at = change.0;
        }
        joint.advance(state, held(changes, at), next - at);
    } else {
        joint.advance(state, volts, next - time);
    }
}
