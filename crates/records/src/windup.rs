//! A transmission from a record of the encoders on both of its sides.

use super::columns::{self, Named, TIME, Table, Wanted};
use super::part::Winds;
use super::{Answer, Figure, Rows, Shown, short, shown_of, told, with_units};
use pigtail_hal::Error;
use pigtail_hal::quantity::{ANGLE, Dimension, FORCE, LENGTH, TORQUE};
use pigtail_sysid::Unknown;
use pigtail_sysid::windup::{Fitted, Identified, LEAST, Record, identify};
use serde_json::json;
use std::fmt::Write as _;
use std::path::Path;

/// Which columns of a file.
#[derive(Debug, Clone)]
pub struct Roles {
    /// Time; one with a usual name if none.
    pub time: Option<Named>,
    /// Rows a second, hertz, where no column says when they were taken, or the column of time counts them.
    pub rate: Option<f64>,
    /// The motor's position.
    pub motor: Named,
    /// The load's position.
    pub load: Named,
    /// The motor's torque or force, where it is known.
    pub torque: Option<Named>,
    /// What the motor's position is to be multiplied by.
    pub ratio: f64,
}

/// A record that was read.
#[derive(Debug, Clone)]
pub struct Read {
    record: Record,
    turns: bool,
    torque: &'static str,
    remarks: Vec<String>,
    understood: String,
}

impl Roles {
    /// Reads a record.
    ///
    /// # Errors
    ///
    /// Bad input.
    pub fn read(&self, path: &Path) -> Result<Read, Error> {
        const MOVES: &[Dimension] = &[ANGLE, LENGTH];
        let file = path.display().to_string();
        let mut table = Table::open(path)?;
        let time = columns::time_named(&table, self.time.as_ref(), self.rate)?;
        let wanted = |option, named, of| Wanted { option, named, of };
        let mut list = vec![
            wanted("--time", &time, &[TIME][..]),
            wanted("--motor", &self.motor, MOVES),
            wanted("--load", &self.load, MOVES),
        ];
        if let Some(torque) = &self.torque {
            list.push(wanted("--torque", torque, &[TORQUE, FORCE]));
        }
        let mut read = columns::read(&table, &list)?;
        table.forget();
        if read[1].dimension != read[2].dimension {
            let message = format!(
                "is in {}, {} in {}; accepted are two angles or two lengths",
                read[1].unit, read[2].name, read[2].unit
            );
            return Err(Error::new(&file, &read[1].name, message));
        }
        for value in &mut read[1].values {
            *value *= self.ratio;
        }
        // A motor that turns against its output pushes against it too.
        for value in read
            .get_mut(3)
            .filter(|_| self.ratio < 0.0)
            .into_iter()
            .flat_map(|t| &mut t.values)
        {
            *value = -*value;
        }
        let grid = columns::on_even_grid(path, &read, LEAST)?;
        let understood = columns::understood(&table, &list, &read, Some(&grid));
        Ok(Read {
            understood,
            record: Record::new(grid, self.torque.is_some()),
            turns: read[1].dimension == ANGLE,
            torque: match read.get(3).map(|t| t.dimension) {
                Some(FORCE) => "N",
                _ => "N m",
            },
            remarks: columns::remarks(&read),
        })
    }
}

impl Read {
    /// How the file was read, in words.
    pub fn understood(&self) -> &str {
        &self.understood
    }

    fn unit(&self, name: &str) -> String {
        let (way, torque) = (self.way(), self.torque);
        match name {
            "time_skew" => "s".to_owned(),
            "compliance" => format!("{way}/({torque})"),
            "cubic_compliance" => format!("{way}/({torque})^3"),
            "inertial_compliance" => format!("{way}/({way}/s^2)"),
            "ratio_error" => "1".to_owned(),
            "ratio_change" => format!("1/{way}"),
            _ => way.to_owned(),
        }
    }

    fn way(&self) -> &'static str {
        if self.turns { "rad" } else { "m" }
    }
}

/// What came of it.
#[derive(Debug, Clone)]
pub struct Found {
    /// The answer.
    pub answer: Answer,
    /// What to show; `None` where nothing is known.
    pub shown: Option<Shown>,
    /// The model that a calibration takes: the best one that has a windup.
    pub model: Option<Fitted>,
}

/// Identifies a transmission.
pub fn windup(first: &Read, second: Option<&Read>) -> Found {
    let found = match identify(&first.record, second.map(|s| &s.record)) {
        Ok(found) => found,
        Err(unknown) => return refused(first, unknown),
    };
    // Radians, metres: what a soft belt gives way by, with room.
    let most = if first.turns { 0.2 } else { 5e-3 };
    if found.raw > most {
        let because = format!(
            "its two sides are {:.3e} {} rms apart, more than any transmission winds up: are they in another unit (as NAME:UNIT)?",
            found.raw,
            first.way()
        );
        return refused(first, Unknown::all(because));
    }
    let best = &found.models[found.best];
    // Degrees are what people read of angles.
    let (scale, unit) = if first.turns {
        (1f64.to_degrees(), "deg")
    } else {
        (1e6, "um")
    };
    let mut answer = Answer {
        parameters: with_units(&found.parameters, |name| first.unit(name)),
        relative_error_percent: Some(100.0 * best.residual / found.raw),
        validation_error_percent: Some(100.0 * best.held_back / found.raw),
        condition: Some(best.condition),
        unknown: found.unknown.clone(),
        remarks: first
            .remarks
            .iter()
            .chain(&found.remarks)
            .cloned()
            .collect(),
        ..Answer::default()
    };
    let judged = if second.is_some() {
        "on the second record"
    } else {
        "where it was not fitted"
    };
    let told = format!(
        "skew and {} tell best: of {} {unit} rms they leave {}, {} {judged}",
        best.name,
        short(scale * found.raw),
        short(scale * best.residual),
        short(scale * best.held_back)
    );
    answer.verdict = answer.doubts().unwrap_or(told);
    let more = &mut answer.more;
    more.insert("model".to_owned(), best.name.into());
    more.insert(format!("raw_{unit}"), (scale * found.raw).into());
    more.insert(format!("residual_{unit}"), (scale * best.residual).into());
    more.insert(format!("held_back_{unit}"), (scale * best.held_back).into());
    more.insert("time_skew_s".to_owned(), found.skew.into());
    let models = found.models.iter().map(|m| {
        let parameters: serde_json::Map<_, _> = m
            .parameters
            .iter()
            .filter(|(name, _)| !found.unknown.iter().any(|u| u.covers(name)))
            .map(|(name, k)| {
                let unit = first.unit(name);
                let value = json!({ "value": k.value, "std": k.std, "unit": unit });
                ((*name).to_owned(), value)
            })
            .collect();
        json!({
            "model": m.name,
            "parameters": parameters,
            "elements": m.elements,
            (format!("residual_{unit}")): scale * m.residual,
            (format!("held_back_{unit}")): scale * m.held_back,
            "condition": m.condition,
        })
    });
    more.insert("models".to_owned(), models.collect());
    let model = answer.is_whole().then(|| calibrates(&found)).flatten();
    if answer.is_whole() && model.is_none() {
        let why = if value(best, "w_max").is_some_and(|w| w < 0.0) {
            "leads with the direction instead of lagging (w_max below zero), as where the torque has the motor's own friction \
             in it"
        } else {
            "has no windup of friction in it"
        };
        answer.remarks.push(format!(
            "no fragment: {} {why}; a calibration takes out what lags",
            best.name
        ));
    }
    Found {
        shown: Some(shown(first, &found, (scale, unit))),
        answer,
        model,
    }
}

fn refused(first: &Read, unknown: Unknown) -> Found {
    let names = ["time_skew", "w_max", "q", "compliance"];
    Found {
        answer: Answer::nothing(names.map(|n| (n, first.unit(n))), unknown, &first.remarks),
        shown: None,
        model: None,
    }
}

/// The model of the verdict, where it has a windup that a calibration could take out.
fn calibrates(found: &Identified) -> Option<Fitted> {
    let best = &found.models[found.best];
    let winds = value(best, "w_max").is_some_and(|w| w > 0.0) || total(best) > 0.0;
    winds.then(|| best.clone())
}

/// Radians of the output for a unit of the record's positions: one, or by the screw's lead (m) of an axis
/// along a line; `None` where no lead is known.
pub fn radians(first: &Read, lead: Option<f64>) -> Option<f64> {
    if first.turns {
        Some(1.0)
    } else {
        lead.map(|lead| std::f64::consts::TAU / lead)
    }
}

/// A table of a `calibration.toml`; `scale` is what [`radians`] gives.
pub fn fragment(model: &Fitted, table: &str, scale: f64, date: &str, origin: &str) -> String {
    let mut text =
        format!("# The windup of a transmission, for a calibration.toml.\n\n[windup.{table}]\n");
    let total = scale * total(model);
    if let (Some(maximum), Some(way)) = (value(model, "w_max"), value(model, "q")) {
        let (maximum, way) = (scale * maximum, scale * way);
        let _ = writeln!(
            text,
            "model = \"reversal\"\nw_max = \"{maximum:.6e} rad\"\nq = \"{way:.6e} rad\"\nelements = []\n\
             hardening = [\"{maximum:.6e} rad\", \"0 rad\", \"0 rad\", \"0 rad\", \"0 rad\"]"
        );
    } else {
        let longest = scale * model.elements.iter().map(|e| e[0]).fold(0.0, f64::max);
        let elements: Vec<String> = model
            .elements
            .iter()
            .map(|[way, windup]| format!("[{:.6e}, {:.6}]", scale * way, scale * windup / total))
            .collect();
        let _ = writeln!(
            text,
            "model = \"memory\"\nw_max = \"{total:.6e} rad\"\nq = \"{longest:.6e} rad\"\n\
             elements = [{}]\n\
             hardening = [\"{total:.6e} rad\", \"0 rad\", \"0 rad\", \"0 rad\", \"0 rad\"]",
            elements.join(", ")
        );
    }
    let _ = writeln!(
        text,
        "residual = \"{:.6e} rad\"\ndate = \"{date}\"\norigin = \"{origin}\"",
        scale * model.residual
    );
    text
}

/// The same windup as a plant has it: a load whose friction twists the transmission. `None` where nothing
/// winds up over a way.
pub fn plant(first: &Read, model: &Fitted, table: &str, scale: f64) -> Option<Winds> {
    let (maximum, presliding) =
        if let (Some(maximum), Some(way)) = (value(model, "w_max"), value(model, "q")) {
            // Elements that rise along an exponential give (2.20) with Q = 8 q_0.
            (maximum, way / 8.0)
        } else {
            let total = total(model);
            let rise = |e: &[f64; 2]| 0.5 * e[0] * e[1] / total;
            (total, model.elements.iter().map(rise).sum())
        };
    let compliance = value(model, "compliance").filter(|c| *c > 0.0 && first.torque == "N m");
    let good = |v: f64| v.is_finite() && v > 0.0;
    (good(maximum) && good(presliding)).then(|| Winds {
        table: table.to_owned(),
        w_max: scale * maximum,
        presliding: scale * presliding,
        compliance: compliance.map(|c| scale * c),
    })
}

fn value(model: &Fitted, name: &str) -> Option<f64> {
    let known = model.parameters.iter().find(|(n, _)| *n == name);
    known.map(|(_, k)| k.value)
}

/// Full windup of a model's elements.
fn total(model: &Fitted) -> f64 {
    model.elements.iter().map(|e| e[1]).sum()
}

fn shown(first: &Read, found: &Identified, (scale, unit): (f64, &str)) -> Shown {
    let account = found.account();
    let rows = found
        .models
        .iter()
        .map(|m| {
            let parameters: Vec<String> = m
                .parameters
                .iter()
                .map(|(name, k)| told(name, k.value, k.std_correlated, &first.unit(name)))
                .collect();
            vec![
                m.name.to_owned(),
                String::new(),
                short(scale * m.residual),
                short(scale * m.held_back),
                parameters.join("\n"),
            ]
        })
        .collect();
    let header = [
        "model".to_owned(),
        String::new(),
        format!("left, {unit}"),
        format!("held back, {unit}"),
        String::new(),
    ];
    let loops = |values: &[f64]| -> Vec<(f64, f64)> {
        shown_of(0..account.time.len())
            .map(|k| (scale * account.position[k], scale * values[k]))
            .collect()
    };
    Shown {
        account: account.clone(),
        quantity: ("windup", first.way()),
        position: first.way(),
        tables: vec![Rows {
            title: "All models".to_owned(),
            header: header.to_vec(),
            rows,
        }],
        figures: vec![Figure {
            x: format!("motor, {unit}"),
            log_x: false,
            y: format!("windup, {unit}"),
            curves: vec![
                ("measured".to_owned(), loops(&account.measured)),
                ("modelled".to_owned(), loops(&account.modelled)),
            ],
            caption: "Windup against position, the time skew taken out.".to_owned(),
        }],
    }
}
