//! A law of friction from a record of force against displacement.

use super::columns::{self, Column, Named, TIME, Table, Wanted};
use super::fragment::Kind;
use super::part::Slides;
use super::{Answer, Figure, Rows, Shown, parameters_json, short, shown_of, told, with_units};
use pigtail_hal::Error;
use pigtail_hal::quantity::{ANGLE, FORCE, LENGTH, TORQUE};
use pigtail_sysid::friction::{Fitted, Identified, Law, Record, identify};
use pigtail_sysid::{Parameter, Unknown};
use serde_json::json;
use std::fmt::Write as _;
use std::path::Path;

/// Which columns of a file.
#[derive(Debug, Clone)]
pub struct Roles {
    /// Time, where it is named or there.
    pub time: Option<Named>,
    /// Rows a second, hertz, where no column says when they were taken, or the column of time counts them.
    pub rate: Option<f64>,
    /// The displacement.
    pub displacement: Named,
    /// The force or torque.
    pub force: Named,
}

/// A record that was read, or why it is of no use.
#[derive(Debug, Clone)]
pub struct Read {
    record: Result<Record, Unknown>,
    turns: bool,
    torque: bool,
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
        let mut list = vec![
            Wanted {
                option: "--displacement",
                named: &self.displacement,
                of: &[LENGTH, ANGLE],
            },
            Wanted {
                option: "--force",
                named: &self.force,
                of: &[FORCE, TORQUE],
            },
        ];
        let mut table = Table::open(path)?;
        let time = match &self.time {
            Some(named) => Some(columns::time_named(&table, Some(named), self.rate)?),
            None => columns::usual_time(&table, self.rate),
        };
        if let Some(time) = &time {
            list.push(Wanted {
                option: "--time",
                named: time,
                of: &[TIME],
            });
        }
        let mut read = columns::read(&table, &list)?;
        table.forget();
        let mut remarks = columns::remarks(&read);
        let twice = columns::once(&mut read);
        if twice > 0 {
            remarks.push(format!(
                "{twice} rows are there twice; one of each was taken"
            ));
        }
        if let Some(time) = read.get(2) {
            columns::rising(path, time)?;
        }
        farther(path, &read[0])?;
        if time.is_none() {
            remarks.push("no column of time: laws that need one were left out".to_owned());
        }
        Ok(Read {
            understood: columns::understood(&table, &list, &read, None),
            record: Record::new(
                read.get(2).map(|t| &t.values[..]),
                &read[0].values,
                &read[1].values,
            ),
            turns: read[0].dimension == ANGLE,
            torque: read[1].dimension == TORQUE,
            remarks,
        })
    }
}

/// Metres beyond which nothing rubs in one record.
const FARTHEST: f64 = 10.0;

/// That a contact moves no farther than one does: counts and micrometres that are taken as metres do.
fn farther(path: &Path, displacement: &Column) -> Result<(), Error> {
    let there = displacement.values.iter().filter(|v| v.is_finite());
    let (low, high) = there.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
        (l.min(*v), h.max(*v))
    });
    if displacement.dimension == ANGLE || high - low <= FARTHEST {
        return Ok(());
    }
    let message = format!(
        "moves over {:.3e} m; accepted are at most {FARTHEST} m: is its unit another one (as \"{}:um\"), or does it count?",
        high - low,
        displacement.name
    );
    Err(Error::new(
        path.display().to_string(),
        &*displacement.name,
        message,
    ))
}

impl Read {
    /// How the file was read, in words.
    pub fn understood(&self) -> &str {
        &self.understood
    }

    fn unit(&self, name: &str) -> String {
        let way = if self.turns { "rad" } else { "m" };
        let force = if self.torque { "N m" } else { "N" };
        match name {
            "stiffness" => format!("{force}/{way}"),
            "exponent" => "1".to_owned(),
            "stribeck_velocity" => format!("{way}/s"),
            "viscous_friction" => format!("{force} s/{way}"),
            _ if name.starts_with("presliding") || name.ends_with("slip") => way.to_owned(),
            _ => force.to_owned(),
        }
    }
}

/// What came of it.
#[derive(Debug, Clone)]
pub struct Found {
    /// The answer.
    pub answer: Answer,
    /// What to show; `None` where nothing is known.
    pub shown: Option<Shown>,
    /// A fragment of a plant, where every parameter is known.
    pub fragment: Option<String>,
}

/// Identifies friction; `law` is reported if given, else the best one.
pub fn friction(first: &Read, second: Option<&Read>, most: usize, law: Option<Law>) -> Found {
    let unit = |name: &str| first.unit(name);
    let names = law.unwrap_or(Law::Presliding).parameters();
    let refused = |unknown: Unknown| Found {
        answer: Answer::nothing(names.iter().map(|n| (*n, unit(n))), unknown, &first.remarks),
        shown: None,
        fragment: None,
    };
    let record = match &first.record {
        Ok(record) => record,
        Err(unknown) => return refused(unknown.clone()),
    };
    let second = match second.map(|s| &s.record) {
        Some(Err(unknown)) => {
            let because = format!("of the second record: {}", unknown.because);
            return refused(Unknown::all(because));
        }
        Some(Ok(record)) => Some(record),
        None => None,
    };
    let found = identify(record, second, most).and_then(|found| match law {
        None => Ok(found),
        Some(law) => found
            .with(law, record)
            .ok_or_else(|| Unknown::all(format!("{} could not be fitted to it", law.name()))),
    });
    let found = match found {
        Ok(found) => found,
        Err(unknown) => return refused(unknown),
    };
    let best = &found.laws[found.best];
    if let Some(because) = none_of_a_contact(first, best.law.way(&best.values)) {
        return refused(Unknown::all(because));
    }
    let mut answer = Answer {
        parameters: with_units(&found.parameters, unit),
        relative_error_percent: Some(best.relative_error_percent),
        validation_error_percent: Some(best.validation_error_percent),
        condition: Some(best.condition),
        unknown: found.unknown.clone(),
        remarks: first
            .remarks
            .iter()
            .chain(record.remarks())
            .cloned()
            .collect(),
        ..Answer::default()
    };
    let others: Vec<String> = found
        .laws
        .iter()
        .filter(|l| l.law != best.law)
        .map(|l| format!("{} {} %", l.law.name(), short(l.validation_error_percent)))
        .collect();
    let judged = if second.is_some() {
        "on the second record"
    } else {
        "on the part held back"
    };
    let least = found
        .laws
        .iter()
        .map(|l| l.validation_error_percent)
        .fold(f64::INFINITY, f64::min);
    let how = if law.is_some() {
        "as asked for, leaves"
    } else if best.validation_error_percent > least {
        // Of laws that are as good the one with fewer parameters.
        "tells the force as well as any, with the fewest parameters:"
    } else {
        "tells the force best:"
    };
    answer.remarks.extend(found.remarks.clone());
    answer
        .remarks
        .extend(other_laws(best, &unit(best.law.parameters()[0])));
    if !first.turns {
        answer.remarks.extend(unusual(best.law.way(&best.values)));
    }
    let chosen = format!(
        "{} {how} {} % {judged} with {} parameters (others: {})",
        best.law.name(),
        short(best.validation_error_percent),
        best.law.parameters().len(),
        others.join(", ")
    );
    answer.verdict = answer.doubts().unwrap_or(chosen);
    answer.more.insert("law".to_owned(), best.law.name().into());
    answer.more.insert("laws".to_owned(), laws(first, &found));
    let shown = shown(first, record, &found);
    let fragment = answer.is_whole().then(|| fragment(first, best));
    Found {
        answer,
        shown: Some(shown),
        fragment,
    }
}

/// All laws that were fitted.
fn laws(first: &Read, found: &Identified) -> serde_json::Value {
    found
        .laws
        .iter()
        .map(|l| {
            let parameters = l.law.parameters().iter().zip(&l.known);
            let parameters: Vec<_> = parameters
                .map(|(name, known)| {
                    let hidden = found.unknown.iter().any(|u| u.covers(name));
                    let known = (!hidden).then_some(*known);
                    (Parameter { name, known }, first.unit(name))
                })
                .collect();
            json!({
                "law": l.law.name(),
                "parameters": parameters_json(&parameters, &found.unknown),
                "relative_error_percent": l.relative_error_percent,
                "validation_error_percent": l.validation_error_percent,
                "condition": l.condition,
                "misfit_percent": l.misfit_percent,
                "level_by_speed": l.by_speed,
            })
        })
        .collect()
}

/// Why a way is none of a contact's, metres: less than an atom, or more than a hundredth of a metre.
fn none_of_a_contact(first: &Read, way: f64) -> Option<String> {
    const ANY: std::ops::Range<f64> = 1e-10..1e-2;
    (!first.turns && !ANY.contains(&way)).then(|| {
        format!(
            "it would give way over {way:.2e} m before it slides, which no contact does: is the displacement in another unit \
             (as NAME:UNIT)?"
        )
    })
}

/// What is said of a way over which no contact gives way, metres: what its asperities, a seal's lip or a rolling ball do lies
/// between.
fn unusual(way: f64) -> Option<String> {
    const USUAL: std::ops::Range<f64> = 1e-9..3e-3;
    (!USUAL.contains(&way)).then(|| {
        format!(
            "it gives way over {way:.2e} m before it slides, and contacts do over nanometres to millimetres: is the displacement \
             in another unit?"
        )
    })
}

/// What tells the force and is not in a law; `unit` is that of its level.
fn other_laws(best: &Fitted, unit: &str) -> Vec<String> {
    /// Relative error beyond which it is said, per cent.
    const MUCH: f64 = 10.0;
    let mut remarks = Vec::new();
    if best.relative_error_percent > MUCH {
        remarks.push(format!(
            "{} leaves {:.0} % of the force, more than noise or another contact should: look at where that is before it is believed",
            best.law.name(),
            best.relative_error_percent
        ));
    }
    if let Some([slow, fast]) = best.by_speed {
        remarks.push(format!(
            "the level goes with the speed, from {} at the slowest to {} {} at the fastest twentieth of the sliding, and {} knows no \
             speed: deviations in brackets count that in; with --most-parameters 6 LuGre with viscous friction and an offset is \
             among the laws",
            short(slow),
            short(fast),
            unit,
            best.law.name()
        ));
    }
    if best.misfit_percent > 0.0 {
        remarks.push(format!(
            "the contact is of another law: {} % of the force are told by other laws, or by elements of every length, and not by \
             this one. Deviations in brackets count in by how much those differ from it in level, way and stiffness",
            short(best.misfit_percent)
        ));
    }
    remarks
}

/// The keys of a joint in a `plant.toml` that a law sets, in its units where the record is of a turning
/// joint; the law in the terms of a joint, and as it is, in SI units below.
fn fragment(first: &Read, best: &Fitted) -> String {
    let mut text = String::new();
    let slides = (first.turns == first.torque).then(|| slides(first, best));
    if let Some(s) = slides.as_ref().filter(|_| first.turns) {
        let _ = writeln!(
            text,
            "# Into [five_bar.joint] or [z_stage.joint] of a plant.toml:\n\
             friction = \"{}\"\n\
             presliding = \"{:.6e} rad\"\n\
             load_friction = {{ static = \"{:.6e} N m\", coulomb = \"{:.6e} N m\", viscous = \"{:.6e} N m \
             s/rad\" }}",
            s.friction,
            s.presliding,
            s.fixed,
            s.coulomb,
            s.viscous.unwrap_or_default()
        );
        if let Some(stribeck) = s.stribeck {
            let _ = writeln!(text, "stribeck = \"{stribeck:.6e} rad/s\"");
        }
        text.push('\n');
    }
    if let Some(part) = slides.and_then(|s| toml::to_string(&s).ok()) {
        let _ = writeln!(text, "# What --from takes, SI units.\n[part]\n{part}");
    }
    let _ = writeln!(text, "[law]\nname = \"{}\"", best.law.name());
    for (name, value) in best.law.parameters().iter().zip(&best.values) {
        let _ = writeln!(text, "{name} = {value:?} # {}", first.unit(name));
    }
    text
}

/// A law in the terms of a joint.
fn slides(first: &Read, best: &Fitted) -> Slides {
    let p = &best.values;
    let (law, presliding, fixed, coulomb) = match best.law {
        Law::Presliding => ("coulomb-presliding", p[1], p[0], p[0]),
        Law::PreslidingTwoSided => {
            let level = 0.5 * (p[0] + p[2]);
            ("coulomb-presliding", 0.5 * (p[1] + p[3]), level, level)
        }
        // The joint's elements rise along an exponential: one that takes as much of the way.
        Law::MaxwellSlip => ("maxwell-slip", 0.25 * (p[1] + p[2]), p[0], p[0]),
        // A bristle, for an exponent of one exactly; another takes as much of the way back from full load.
        Law::Dahl => {
            let n = p[2].min(1.9);
            let share = 2f64.powf(1.0 - n) / (2.0 - n);
            ("lugre", share * p[0] / p[1], p[0], p[0])
        }
        Law::LuGre | Law::LuGreViscous => {
            let most = p[2].max(p[0]);
            ("lugre", most / p[1], most, p[0])
        }
    };
    Slides {
        kind: if first.turns {
            Kind::Rotary
        } else {
            Kind::Linear
        },
        friction: law.to_owned(),
        presliding,
        fixed,
        coulomb,
        viscous: (best.law == Law::LuGreViscous).then(|| p[4].max(0.0)),
        stribeck: matches!(best.law, Law::LuGre | Law::LuGreViscous).then(|| p[3]),
    }
}

fn shown(first: &Read, record: &Record, found: &Identified) -> Shown {
    let account = found.account(record);
    let way = if first.turns { "rad" } else { "m" };
    let (scale, unit) = if first.turns {
        (1e3, "mrad")
    } else {
        (1e6, "um")
    };
    let force = if first.torque { "N m" } else { "N" };
    let from = found.held_back_from.min(account.time.len());
    let origin = account.position.first().copied().unwrap_or(0.0);
    let points = |values: &[f64]| -> Vec<(f64, f64)> {
        shown_of(from..account.time.len())
            .map(|k| (scale * (account.position[k] - origin), values[k]))
            .collect()
    };
    let figures = vec![Figure {
        x: format!("displacement from the first sample, {unit}"),
        log_x: false,
        y: format!("force, {force}"),
        curves: vec![
            ("measured".to_owned(), points(&account.measured)),
            (
                found.laws[found.best].law.name().to_owned(),
                points(&account.modelled),
            ),
        ],
        caption:
            "Force against displacement over the record's last part: measured, and by the law."
                .to_owned(),
    }];
    let rows = found
        .laws
        .iter()
        .map(|l| {
            let parameters: Vec<String> = l
                .law
                .parameters()
                .iter()
                .zip(&l.known)
                .map(|(name, k)| told(name, k.value, k.std_correlated, &first.unit(name)))
                .collect();
            vec![
                l.law.name().to_owned(),
                l.law.parameters().len().to_string(),
                short(l.relative_error_percent),
                short(l.validation_error_percent),
                parameters.join("\n"),
            ]
        })
        .collect();
    let header = ["law", "parameters", "error, %", "held back, %", ""];
    Shown {
        account,
        quantity: ("force", force),
        position: way,
        tables: vec![Rows {
            title: "All laws".to_owned(),
            header: header.map(str::to_owned).to_vec(),
            rows,
        }],
        figures,
    }
}
