//! A servo axis from its record.

use super::columns::{self, By, CURRENT, Named, Source, TIME, Table, Wanted};
use super::fragment::{AxisTable, ControllerTable, Fragment, Kind, MotionTable, RecordTable};
use super::part::{Drive, Part};
use super::{
    Answer, Figure, NOT_IDENTIFIABLE, Rows, Shown, parameters_json, short, told, with_units,
};
use pigtail_hal::Error;
use pigtail_hal::quantity::{ANGLE, Dimension, FORCE, LENGTH, TORQUE, VOLTAGE};
use pigtail_sysid::servo::{
    Friction, Identified, Injected, LEAST, Method, Motion, Record, Replay, Settings, Sliding,
    Variant, identify, replay,
};
use pigtail_sysid::{Account, Unknown};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::Path;

/// Which columns of a file.
#[derive(Debug, Clone)]
pub struct Roles {
    /// Time; one with a usual name if none.
    pub time: Option<Named>,
    /// Rows a second, hertz, where no column says when they were taken, or the column of time counts them.
    pub rate: Option<f64>,
    /// The position's reference, where there is one.
    pub reference: Option<Named>,
    /// The position.
    pub position: Named,
    /// The voltage.
    pub voltage: Named,
    /// What was added to the controller's voltage, where something was: volts, or a force.
    pub injected: Option<Named>,
}

/// A record that was read.
#[derive(Debug, Clone)]
pub struct Read {
    /// The record.
    pub record: Record,
    /// Whether it moves along a line or turns.
    pub kind: Kind,
    /// Where it came from.
    pub source: Source,
    /// What had to be assumed.
    pub remarks: Vec<String>,
    /// How the file was read, in words.
    pub understood: String,
    /// What the record itself cannot show to be wrong, and by which factor an inertia would be another if it were.
    pub assumed: Vec<(String, f64)>,
}

/// Rows of a replay that are kept to be shown, evenly: more are no more to see.
const SHOWN: usize = 200_000;

/// What a position may be.
const MOVES: &[Dimension] = &[LENGTH, ANGLE];

impl Roles {
    /// Reads a record.
    ///
    /// # Errors
    ///
    /// Bad input.
    pub fn read(&self, path: &Path) -> Result<Read, Error> {
        let file = path.display().to_string();
        let mut table = Table::open(path)?;
        let time = columns::time_named(&table, self.time.as_ref(), self.rate)?;
        let wanted = |option, named, of| Wanted { option, named, of };
        let mut list = vec![
            wanted("--time", &time, &[TIME][..]),
            wanted("--position", &self.position, MOVES),
            wanted("--voltage", &self.voltage, &[VOLTAGE, CURRENT]),
        ];
        if let Some(reference) = &self.reference {
            list.push(wanted("--reference", reference, MOVES));
        }
        if let Some(injected) = &self.injected {
            list.push(wanted("--injected", injected, &[VOLTAGE, FORCE, TORQUE]));
        }
        let read = columns::read(&table, &list)?;
        table.forget();
        if let Some(reference) = read
            .get(3)
            .filter(|r| self.reference.is_some() && r.dimension != read[1].dimension)
        {
            let message = format!(
                "is in {}, the position {} in {}; accepted are two lengths or two angles",
                reference.unit, read[1].name, read[1].unit
            );
            return Err(Error::new(&file, &reference.name, message));
        }
        let grid = columns::on_even_grid(path, &read, LEAST)?;
        let kind = if read[1].dimension == ANGLE {
            Kind::Rotary
        } else {
            Kind::Linear
        };
        let understood = columns::understood(&table, &list, &read, Some(&grid));
        let record = Record::new(grid, self.reference.is_some());
        let injected = read.last().filter(|_| self.injected.is_some());
        let record = match injected.map(|column| column.dimension) {
            Some(VOLTAGE) => record.with_injected(Injected::Volts),
            Some(_) => record.with_injected(Injected::Force),
            None => record,
        };
        let mut assumed = Vec::new();
        if read[1].by == By::Nothing && kind == Kind::Linear {
            assumed.push((format!("were {} in mm", read[1].name), 1e3));
        } else if read[1].by == By::Nothing {
            assumed.push((format!("were {} in deg", read[1].name), 180.0 / PI));
        }
        if let Some(rate) = self.rate {
            assumed.push((format!("were the rows taken at {} Hz", 2.0 * rate), 0.25));
        }
        let mut remarks = columns::remarks(&read);
        if read[2].dimension == CURRENT {
            remarks.push(format!(
                "{} is a current: --force-per-volt is taken as the force of an ampere, and volts are amperes in all that follows",
                read[2].name
            ));
        }
        Ok(Read {
            assumed,
            understood,
            record,
            kind,
            source: Source::new(path, &list, &read),
            remarks,
        })
    }
}

/// Name of a law of friction.
pub fn friction_name(friction: Friction) -> &'static str {
    match friction {
        Friction::Symmetric => "symmetric",
        Friction::Asymmetric => "asymmetric",
    }
}

/// Name of a method.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::LeastSquares => "least-squares",
        Method::Weighted => "weighted",
        Method::Instrumental => "instrumental",
        Method::Delayed => "delayed",
    }
}

fn name(variant: &Variant) -> String {
    format!(
        "{} friction by {}",
        friction_name(variant.friction),
        match variant.method {
            Method::LeastSquares => "least squares",
            Method::Weighted => "weighted least squares",
            Method::Instrumental => "instrumental variables",
            Method::Delayed => "least squares with the voltage's delay",
        }
    )
}

/// Unit of a parameter.
fn unit(name: &str, kind: Kind) -> String {
    let (inertia, viscous, force) = match kind {
        Kind::Linear => ("kg", "N s/m", "N"),
        Kind::Rotary => ("kg m^2", "N m s/rad", "N m"),
    };
    if name == "inertia" {
        inertia
    } else if name == "voltage_delay" {
        "s"
    } else if name.starts_with("viscous") {
        viscous
    } else {
        force
    }
    .to_owned()
}

/// What came of it.
#[derive(Debug, Clone)]
pub struct Servo {
    /// The answer.
    pub answer: Answer,
    /// What to show; `None` where nothing is known.
    pub shown: Option<Shown>,
    /// The variant that goes into a fragment, and the whole identification.
    pub best: Option<(Variant, Identified)>,
}

impl Servo {
    /// The axis as a fragment of a rig, behind its drive; `None` where the record does not tell all of it. `origin` and
    /// `date` go with what control believes.
    ///
    /// # Errors
    ///
    /// Where it cannot be written as TOML.
    pub fn fragment(
        &self,
        read: &Read,
        force_per_volt: f64,
        drive: &Drive,
        (date, origin): (&str, &str),
    ) -> Option<anyhow::Result<String>> {
        let (best, whole) = self.best.as_ref().filter(|_| self.answer.is_whole())?;
        let axis = AxisTable::new(read.kind, &best.axis(force_per_volt));
        let controller = whole.controller.as_ref().map(ControllerTable::new);
        let motion = MotionTable::new(&whole.motion);
        let part = Part::new(&axis, controller.as_ref(), &motion, drive, (date, origin));
        let plain = Fragment {
            origin: origin.to_owned(),
            axis,
            controller,
            record: RecordTable::new(&read.source),
            motion: Some(motion),
            z_stage: None,
            five_bar: None,
            machine: None,
            calibration: None,
        };
        Some(plain.with(part).text())
    }
}

/// That a drive can be that of an axis which moves as its record says.
///
/// # Errors
///
/// A screw's lead for an axis that turns; the key is `key`.
pub fn check_lead(read: &Read, lead: Option<f64>, key: &str) -> Result<(), Error> {
    if lead.is_some() && read.kind == Kind::Rotary {
        let message = "is of a screw, and this axis turns; accepted is an axis along a line";
        return Err(Error::new("identify servo", key, message));
    }
    Ok(())
}

/// That a filter's cutoff is below what a record can hold.
///
/// # Errors
///
/// Where it is not; the key is `key`.
pub fn check_cutoff(path: &Path, read: &Read, cutoff: Option<f64>, key: &str) -> Result<(), Error> {
    let nyquist = 0.5 / read.record.even().period;
    if let Some(cutoff) = cutoff.filter(|c| *c >= nyquist) {
        let message = format!(
            "{cutoff} Hz is not below the record's Nyquist frequency; accepted is less than {nyquist} Hz"
        );
        return Err(Error::new(path.display().to_string(), key, message));
    }
    Ok(())
}

/// Identifies a servo axis; `friction` and `method` say which variant's parameters are reported: by the method that the
/// record supports, if none.
pub fn servo(
    first: &Read,
    second: Option<&Read>,
    set: &Settings,
    (friction, method): (Friction, Option<Method>),
) -> Servo {
    let unit = |name: &str| unit(name, first.kind);
    let names = friction.names().iter().map(|n| (*n, unit(n)));
    let refused = |unknown: Unknown| Servo {
        answer: Answer::nothing(names.clone(), unknown, &first.remarks),
        shown: None,
        best: None,
    };
    let found = match identify(&first.record, second.map(|s| &s.record), set) {
        Ok(found) => found,
        Err(unknown) => return refused(unknown),
    };
    let method = method.unwrap_or(found.supported);
    let Some(asked) = found.variant(friction, method).cloned() else {
        return refused(Unknown::all(format!(
            "{} friction by {} needs a reference, and a controller that tells the voltage",
            friction_name(friction),
            method_name(method)
        )));
    };
    // An inertia that is not known has been said to be so.
    if !found.unknown.iter().any(|u| u.covers("inertia"))
        && let Some(unknown) = unlikely(first.kind, asked.values[0], &found.motion)
    {
        return refused(unknown);
    }
    let best = found.variants[found.best].clone();
    let mut answer = Answer {
        parameters: with_units(&asked.parameters, unit),
        relative_error_percent: Some(asked.relative_error_percent),
        validation_error_percent: asked.validation_error_percent,
        condition: Some(asked.condition),
        unknown: found.unknown.clone(),
        remarks: first
            .remarks
            .iter()
            .chain(&found.remarks)
            .cloned()
            .collect(),
        ..Answer::default()
    };
    let on = if second.is_some() {
        "the second record"
    } else {
        "the record's last part"
    };
    let generalises = format!(
        "{} generalises best: {} % of force on {on}, {} % by {}",
        name(&best),
        short(best.validation_error_percent.unwrap_or(f64::NAN)),
        short(asked.validation_error_percent.unwrap_or(f64::NAN)),
        name(&asked)
    );
    answer.verdict = answer.doubts().unwrap_or(generalises);
    if let Some(inertia) = asked.parameters[0].known {
        for (were, factor) in &first.assumed {
            answer.remarks.push(format!(
                "no record shows a unit or a rate that is wrong for all of it: {were}, the inertia would be {} {}",
                short(factor * inertia.value),
                unit("inertia")
            ));
        }
    }
    let again = |read: &Read| {
        let controller = found.controller?;
        let usable = found.unknown.is_empty();
        usable
            .then(|| {
                let axis = best.axis(set.force_per_volt);
                replay(
                    &read.record,
                    &axis,
                    &Sliding::Coulomb,
                    &controller,
                    (set, SHOWN),
                )
            })
            .flatten()
    };
    let replayed = again(first);
    tell_more(&mut answer, &found, (friction, method), first.kind);
    if let Some(r) = &replayed {
        answer.more.insert("replay".to_owned(), tell(r));
    }
    if let Some(r) = second.and_then(again) {
        answer.more.insert("validation_replay".to_owned(), tell(&r));
    }
    if best.friction != asked.friction && found.unknown.is_empty() {
        answer.remarks.push(fragment_of(&name(&best), &best, unit));
    }
    let shown = shown(&found, &best, replayed.as_ref(), first.kind);
    Servo {
        answer,
        shown: Some(shown),
        best: Some((best, found)),
    }
}

/// What fragment and replay hold, where that is not what is printed.
fn fragment_of(name: &str, best: &Variant, unit: impl Fn(&str) -> String) -> String {
    let told: Vec<String> = best
        .parameters
        .iter()
        .filter_map(|p| {
            Some(format!(
                "{} {} {}",
                p.name,
                short(p.known?.value),
                unit(p.name)
            ))
        })
        .collect();
    format!("fragment and replay are of {name}: {}", told.join(", "))
}

/// What no servo axis is or does: one unit that is wrong for all of a record's columns shows nowhere else.
fn unlikely(kind: Kind, inertia: f64, motion: &Motion) -> Option<Unknown> {
    // Of inertia, kg or kg m^2; of stroke, m or rad; of speed, m/s or rad/s; of acceleration, m/s^2 or rad/s^2.
    let (inertias, most, units) = match kind {
        Kind::Linear => (1e-6..1e4, [50.0, 20.0, 2e3], ["kg", "m", "m/s", "m/s^2"]),
        Kind::Rotary => (
            1e-10..1e4,
            [1e6, 2e4, 1e7],
            ["kg m^2", "rad", "rad/s", "rad/s^2"],
        ),
    };
    let found = [motion.stroke, motion.speed, motion.acceleration];
    let what = if !inertias.contains(&inertia) {
        format!("an inertia of {inertia:.3e} {}", units[0])
    } else if found.iter().zip(most).any(|(is, most)| *is > most) {
        format!(
            "a motion over {:.3e} {} at up to {:.3e} {} and {:.3e} {}",
            found[0], units[1], found[1], units[2], found[2], units[3]
        )
    } else {
        return None;
    };
    Some(Unknown::all(format!(
        "{what} is none of a servo axis: are the units of position and voltage right (as NAME:UNIT), and --force-per-volt?"
    )))
}

/// How far a replay is from its record.
fn tell(r: &Replay) -> Value {
    json!({
        "velocity_error_percent": r.velocity_error_percent,
        "force_error_percent": r.force_error_percent,
        "position_error_percent": r.position_error_percent,
    })
}

/// What else there is to say: all variants, the one that generalises, the controller.
fn tell_more(
    answer: &mut Answer,
    found: &Identified,
    (friction, method): (Friction, Method),
    kind: Kind,
) {
    let best = &found.variants[found.best];
    let more = &mut answer.more;
    more.insert("friction".to_owned(), friction_name(friction).into());
    more.insert("method".to_owned(), method_name(method).into());
    more.insert("equations".to_owned(), found.equations.into());
    more.insert(
        "best".to_owned(),
        json!({
            "friction": friction_name(best.friction), "method": method_name(best.method),
            "validation_error_percent": best.validation_error_percent,
        }),
    );
    more.insert("time_skew_s".to_owned(), found.skew.into());
    more.insert("variants".to_owned(), variants(found, kind));
    if let Some(c) = &found.controller {
        more.insert(
            "controller".to_owned(),
            json!({
                "kp": c.kp, "ki": c.ki, "kd": c.kd, "kf": c.kf, "bias": c.bias, "span": c.span,
                "delay": c.delay, "limit": c.limit.is_finite().then_some(c.limit),
                "position_gain_per_s": c.position_gain(), "error_percent": c.error_percent,
            }),
        );
    }
}

fn variants(found: &Identified, kind: Kind) -> Value {
    found
        .variants
        .iter()
        .map(|v| {
            let parameters = with_units(&v.parameters, |name| unit(name, kind));
            json!({
                "friction": friction_name(v.friction),
                "method": method_name(v.method),
                "parameters": parameters_json(&parameters, &found.unknown),
                "relative_error_percent": v.relative_error_percent,
                "validation_error_percent": v.validation_error_percent,
                "condition": v.condition,
            })
        })
        .collect()
}

fn shown(found: &Identified, best: &Variant, replay: Option<&Replay>, kind: Kind) -> Shown {
    let row = |v: &Variant| -> Vec<String> {
        let mut row = vec![
            friction_name(v.friction).to_owned(),
            method_name(v.method).to_owned(),
            short(v.relative_error_percent),
            v.validation_error_percent.map_or("-".to_owned(), short),
            short(v.condition),
        ];
        let text = |p: &pigtail_sysid::Parameter| {
            p.known.map_or_else(
                || format!("{} not known", p.name.replace('_', " ")),
                |k| told(p.name, k.value, k.std, &unit(p.name, kind)),
            )
        };
        row.push(v.parameters.iter().map(text).collect::<Vec<_>>().join("\n"));
        row
    };
    let tables = [Friction::Symmetric, Friction::Asymmetric]
        .into_iter()
        .map(|friction| {
            let mut header: Vec<String> = [
                "friction",
                "method",
                "error, %",
                "validation, %",
                "condition",
            ]
            .map(str::to_owned)
            .to_vec();
            header.push(String::new());
            Rows {
                title: format!("{} friction", friction_name(friction)),
                header,
                rows: found
                    .variants
                    .iter()
                    .filter(|v| v.friction == friction)
                    .map(row)
                    .collect(),
            }
        })
        .collect();
    let (quantity, position) = match kind {
        Kind::Linear => (("force", "N"), "m"),
        Kind::Rotary => (("torque", "N m"), "rad"),
    };
    let mut figures = Vec::new();
    if let Some(r) = replay {
        let over = |values: &[f64]| r.time.iter().copied().zip(values.iter().copied()).collect();
        figures.push(Figure {
            x: "time, s".to_owned(),
            log_x: false,
            y: format!("velocity, {position}/s"),
            curves: vec![
                ("measured".to_owned(), over(&r.velocity[0])),
                ("replayed".to_owned(), over(&r.velocity[1])),
            ],
            caption: format!(
                "The same reference in closed loop: velocity in the record and of the model. They are \
                 {} % apart, the voltages {} %.",
                short(r.velocity_error_percent),
                short(r.force_error_percent)
            ),
        });
    }
    let account: Account = found.account(best);
    Shown {
        account,
        quantity,
        position,
        tables,
        figures,
    }
}

/// Whether a verdict says that something cannot be known.
pub fn is_negative(answer: &Answer) -> bool {
    answer.verdict.starts_with(NOT_IDENTIFIABLE)
}
