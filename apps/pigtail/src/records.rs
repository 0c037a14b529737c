//! `pigtail identify` from a record that a person brings.

mod servo;

pub(crate) use servo::{ServoArguments, servo};

use crate::common::in_unit;
use crate::progress::Busy;
use crate::{DONE, Failure, NEGATIVE};
use clap::{Args, ValueEnum};
use pigtail_hal::Error;
use pigtail_hal::digest::hash;
use pigtail_hal::quantity::{FREQUENCY, LENGTH, Sign};
use pigtail_records::columns::Named;
use pigtail_records::friction;
use pigtail_records::resonance;
use pigtail_records::windup;
use pigtail_records::{Answer, Shown, capital, short};
use pigtail_report as report;
use pigtail_store::runs::Run;
use pigtail_store::samples::Samples;
use pigtail_sysid::friction::Law;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What all of these commands take.
#[derive(Debug, Args)]
pub(crate) struct Output {
    /// Print JSON instead of text
    #[arg(long)]
    pub(crate) json: bool,
    /// Where to write the run's folder
    #[arg(long, value_name = "FOLDER", default_value = "runs")]
    pub(crate) runs: PathBuf,
}

pub(crate) fn hash_of(path: &Path) -> (String, String) {
    let content = std::fs::read(path).unwrap_or_default();
    (path.display().to_string(), hash(content))
}

/// Identify a law of friction from a record of force against displacement
///
/// Fits the thesis's presliding (2.12)-(2.13), symmetric and with each direction for itself, Dahl's law,
/// Maxwell-slip elements and, where there is time, LuGre to the record's first six tenths, and chooses by the
/// error on the rest, or on a second record; of laws that are as good the one with fewer parameters. Then
/// it is fitted to the whole record.
///
/// A force that does negative work is what friction does to the body: its sign is turned. What the record
/// does not tell has no value, and the exit code is 1.
#[derive(Debug, Args)]
#[command(
    override_usage = "\
pigtail identify friction [OPTIONS] --data <FILE>
       --displacement <COLUMN> --force <COLUMN>",
    after_help = "\
Examples:
  pigtail identify friction --data d.csv --displacement position_mm --force friction_uN
  pigtail identify friction --data d.csv --displacement x:um --force f:N --law lugre"
)]
pub(crate) struct FrictionArguments {
    /// A file of columns; delimiter, decimal comma, encoding, names and units are told from it
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Its column of displacement, a length or an angle
    #[arg(long, value_name = "COLUMN")]
    displacement: Named,
    /// Its column of force or torque
    #[arg(long, value_name = "COLUMN")]
    force: Named,
    /// Its column of time; `t_s`, `time_s`, `t` or `time` if not given and there
    #[arg(long, value_name = "COLUMN")]
    time: Option<Named>,
    /// Rows a second, hertz: where no column says when they were taken, or the column of time counts them
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive))]
    rate: Option<f64>,
    /// A second record of the same columns, to judge by
    #[arg(long, value_name = "FILE")]
    validate: Option<PathBuf>,
    /// Laws of at most so many parameters
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(3..=6))]
    most_parameters: u8,
    /// The law to report, whichever is best
    #[arg(long, value_enum)]
    law: Option<LawChoice>,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum LawChoice {
    /// (2.12)-(2.13), beside an offset
    Presliding,
    /// The same, each direction for itself
    PreslidingTwoSided,
    /// Dahl's
    Dahl,
    /// Maxwell-slip elements
    MaxwellSlip,
    /// LuGre
    Lugre,
    /// LuGre with viscous friction and an offset
    LugreViscous,
}

impl LawChoice {
    fn law(self) -> Law {
        match self {
            Self::Presliding => Law::Presliding,
            Self::PreslidingTwoSided => Law::PreslidingTwoSided,
            Self::Dahl => Law::Dahl,
            Self::MaxwellSlip => Law::MaxwellSlip,
            Self::Lugre => Law::LuGre,
            Self::LugreViscous => Law::LuGreViscous,
        }
    }
}

pub(crate) fn friction(a: &FrictionArguments) -> Result<u8, Failure> {
    let roles = friction::Roles {
        time: a.time.clone(),
        rate: a.rate,
        displacement: a.displacement.clone(),
        force: a.force.clone(),
    };
    let first = roles.read(&a.data)?;
    let second = a
        .validate
        .as_ref()
        .map(|path| roles.read(path))
        .transpose()?;
    let law = a.law.map(LawChoice::law);
    let most = law.map_or(usize::from(a.most_parameters), |l| {
        l.parameters().len().max(usize::from(a.most_parameters))
    });
    let busy = Busy::new("identify friction", "fitting models to the record");
    let found = friction::friction(&first, second.as_ref(), most, law);
    drop(busy);
    let mut found = found;
    found
        .answer
        .more
        .insert("read".to_owned(), first.understood().into());
    let fragment = found.fragment.clone();
    let mut hashes = vec![hash_of(&a.data)];
    hashes.extend(a.validate.as_deref().map(hash_of));
    let title = format!("Friction in {}", a.data.display());
    finish(
        "friction",
        &title,
        found.answer,
        found.shown.as_ref(),
        &hashes,
        fragment.map(|text| {
            move |run: &Run| {
                Ok(vec![(
                    "plant.toml",
                    format!("# By {}.\n{text}", origin("friction", run)),
                )])
            }
        }),
        &a.output,
    )
}

/// The record of a transmission, for `pigtail identify windup`.
#[derive(Debug, Args)]
pub(crate) struct WindupRecordArguments {
    /// A file of columns, instead of an axis; delimiter, decimal comma, names and units are told from it
    #[arg(long, value_name = "FILE", requires_all = ["motor", "load"])]
    data: Option<PathBuf>,
    /// Its column of the motor's position
    #[arg(long, value_name = "COLUMN", requires = "data")]
    motor: Option<Named>,
    /// Its column of the load's position
    #[arg(long, value_name = "COLUMN", requires = "data")]
    load: Option<Named>,
    /// Its column of the motor's torque
    #[arg(long, value_name = "COLUMN", requires = "data")]
    torque: Option<Named>,
    /// Its column of time; `t_s`, `time_s`, `t` or `time` if not given
    #[arg(long, value_name = "COLUMN", requires = "data")]
    time: Option<Named>,
    /// Rows a second, hertz: where no column says when they were taken, or the column of time counts them
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive), requires = "data")]
    rate: Option<f64>,
    /// Turns of the output for a turn of the motor, where the motor's column is not yet in angles of the output; below
    /// zero where the motor turns against it
    #[arg(long, alias = "ratio", value_name = "R", default_value_t = 1.0, value_parser = crate::not_zero,
        requires = "data")]
    gear_ratio: f64,
    /// Travel for a turn of the screw, metres, where motor and load are lengths
    #[arg(long, value_name = "METRES", value_parser = in_unit(LENGTH, "m", Sign::Positive), requires = "data")]
    lead: Option<f64>,
    /// A second record of the same columns, to judge by
    #[arg(long, value_name = "FILE", requires = "data")]
    validate: Option<PathBuf>,
    /// Table of the calibration that the fragment is for
    #[arg(long, value_enum, default_value = "five-bar", requires = "data")]
    kind: KindChoice,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum KindChoice {
    /// `windup.five_bar`
    FiveBar,
    /// `windup.z`
    Z,
}

pub(crate) fn windup(a: &WindupRecordArguments, json: bool, runs: &Path) -> Result<u8, Failure> {
    let (Some(data), Some(motor), Some(load)) = (&a.data, &a.motor, &a.load) else {
        let message = "no record; accepted is an axis, or --data with --motor and --load";
        return Err(Error::new("identify windup", "", message).into());
    };
    let roles = windup::Roles {
        time: a.time.clone(),
        rate: a.rate,
        motor: motor.clone(),
        load: load.clone(),
        torque: a.torque.clone(),
        ratio: a.gear_ratio,
    };
    let first = roles.read(data)?;
    let second = a
        .validate
        .as_ref()
        .map(|path| roles.read(path))
        .transpose()?;
    let busy = Busy::new("identify windup", "fitting models to the record");
    let found = windup::windup(&first, second.as_ref());
    drop(busy);
    let mut found = found;
    found
        .answer
        .more
        .insert("read".to_owned(), first.understood().into());
    let mut hashes = vec![hash_of(data)];
    hashes.extend(a.validate.as_deref().map(hash_of));
    let title = format!("A transmission from {}", data.display());
    let table = match a.kind {
        KindChoice::FiveBar => "five_bar",
        KindChoice::Z => "z",
    };
    let mut answer = found.answer;
    let scale = windup::radians(&first, a.lead);
    if scale.is_none() && found.model.is_some() {
        let remark =
            "no fragment: a calibration has windup in radians of the screw; accepted is its --lead";
        answer.remarks.push(remark.to_owned());
    }
    let model = found.model.zip(scale);
    finish(
        "windup",
        &title,
        answer,
        found.shown.as_ref(),
        &hashes,
        model.map(|(model, scale)| {
            move |run: &Run| {
                let origin = format!("identify windup --data, run {}", run.name());
                let belief = windup::fragment(&model, table, scale, &run.date(), &origin);
                let mut files = vec![("calibration.toml", belief)];
                if let Some(winds) = windup::plant(&first, &model, table, scale) {
                    let text = toml::to_string(&winds)?;
                    let about = "# What winds up, for the twin: --from takes it. SI units.";
                    let text = format!("{about}\n# By {origin}.\n\n[transmission]\n{text}");
                    files.push(("plant.toml", text));
                }
                Ok(files)
            }
        }),
        &Output {
            json,
            runs: runs.to_owned(),
        },
    )
}

/// Identify modes, damping and delay from a frequency response
///
/// A row for each frequency: magnitude (a ratio or decibels) and phase, or real and imaginary part. Modes are
/// added one at a time, as long as the points that were held back, every second one, are told better by
/// a twentieth. What the points do not resolve has no value, and the exit code is 1. A magnitude alone tells
/// modes and their damping, and no delay.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail identify resonance --data frf.csv
  pigtail identify resonance --data frf.csv --frequency f:Hz --magnitude gain:dB --phase arg:deg")]
pub(crate) struct ResonanceArguments {
    /// A file of columns; delimiter, decimal comma, encoding, names and units are told from it
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Its column of frequency; one with a usual name if not given
    #[arg(long, value_name = "COLUMN")]
    frequency: Option<Named>,
    /// Its column of magnitude, a ratio or in dB; one with a usual name if not given
    #[arg(long, value_name = "COLUMN", conflicts_with_all = ["real", "imaginary"])]
    magnitude: Option<Named>,
    /// Its column of phase; one with a usual name if not given
    #[arg(long, value_name = "COLUMN", conflicts_with_all = ["real", "imaginary"])]
    phase: Option<Named>,
    /// Its column of the real part
    #[arg(long, value_name = "COLUMN", requires = "imaginary")]
    real: Option<Named>,
    /// Its column of the imaginary part
    #[arg(long, value_name = "COLUMN", requires = "real")]
    imaginary: Option<Named>,
    /// Its column of coherence, by which points count
    #[arg(long, value_name = "COLUMN")]
    coherence: Option<Named>,
    #[command(flatten)]
    output: Output,
}

pub(crate) fn resonance(a: &ResonanceArguments) -> Result<u8, Failure> {
    let roles = resonance::Roles {
        frequency: a.frequency.clone(),
        magnitude: a.magnitude.clone(),
        phase: a.phase.clone(),
        parts: a.real.clone().zip(a.imaginary.clone()),
        coherence: a.coherence.clone(),
    };
    let busy = Busy::new("identify resonance", "fitting modes to the record");
    let answered = resonance::resonance(&roles, &a.data);
    drop(busy);
    let (answer, shown) = answered?;
    let modes = resonance::carries(&answer).then(|| resonance::fragment(&answer));
    let title = format!("Resonances in {}", a.data.display());
    finish(
        "resonance",
        &title,
        answer,
        shown.as_ref(),
        &[hash_of(&a.data)],
        modes.map(|text| {
            move |run: &Run| {
                Ok(vec![(
                    "plant.toml",
                    format!("# By {}.\n{text}", origin("resonance", run)),
                )])
            }
        }),
        &a.output,
    )
}

pub(crate) fn origin(what: &str, run: &Run) -> String {
    format!("identify {what}, run {}, {}", run.name(), run.date())
}

/// Fragments by the names of their files.
pub(crate) type Files = Vec<(&'static str, String)>;

/// Writes the run and prints the answer.
pub(crate) fn finish(
    what: &str,
    title: &str,
    mut answer: Answer,
    shown: Option<&Shown>,
    hashes: &[(String, String)],
    fragment: Option<impl FnOnce(&Run) -> anyhow::Result<Files>>,
    output: &Output,
) -> Result<u8, Failure> {
    let kind = match what {
        "twin" => what.to_owned(),
        _ => format!("identify {what}"),
    };
    let run = Run::begin(&output.runs, &kind, 0, hashes)?;
    if let Some(fragment) = fragment {
        for (key, (name, text)) in ["fragment", "plant_fragment"]
            .into_iter()
            .zip(fragment(&run)?)
        {
            run.write(name, text)?;
            let path = run.path(name).display().to_string();
            answer.more.insert(key.to_owned(), path.into());
        }
    }
    let path = run.path("report.html").display().to_string();
    answer.more.insert("report".to_owned(), path.into());
    let document = answer.json();
    run.write_json("summary.json", &document)?;
    run.write("report.html", report::record(title, &answer, shown)?)?;
    shown.map_or_else(Samples::default, samples).keep(&run)?;
    let negative = pigtail_records::servo::is_negative(&answer);
    run.finish(if negative { "negative" } else { "done" })?;
    let text = if output.json {
        format!("{document}\n")
    } else {
        account(&answer)
    };
    crate::print(text.as_bytes())?;
    Ok(if negative { NEGATIVE } else { DONE })
}

/// What was measured beside what the model tells, and what the figures show, in columns.
fn samples(shown: &Shown) -> Samples {
    let (quantity, unit) = shown.quantity;
    let position = shown.position;
    let name = |what: &str, unit: &str| {
        let words = format!("{what}_{unit}").to_lowercase();
        let word = |letter: char| letter.is_alphanumeric() || "._-".contains(letter);
        let parts = words.split(|letter| !word(letter));
        parts
            .filter(|part| !part.is_empty())
            .collect::<Vec<_>>()
            .join("_")
    };
    let of = &shown.account;
    let all = Samples::default()
        .with("time_s", "as in the record", of.time.clone())
        .with(
            &name(quantity, unit),
            "what was measured",
            of.measured.clone(),
        )
        .with(
            &name(&format!("modelled {quantity}"), unit),
            "what the model tells",
            of.modelled.clone(),
        )
        .with(
            &name("position", position),
            "where the axis was",
            of.position.clone(),
        )
        .with(
            &name("velocity", &format!("{position}_s")),
            "how fast it moved",
            of.velocity.clone(),
        );
    let curves = shown.figures.iter().enumerate().flat_map(|(k, figure)| {
        let curves = figure.curves.iter();
        curves.map(move |(curve, points)| (k + 1, figure, curve, points))
    });
    curves.fold(all, |all, (k, figure, curve, points)| {
        let column = |axis: &str| name(&format!("figure {k} {curve}"), axis);
        let (x, y) = points.iter().copied().unzip();
        all.with(&column(&figure.x), &figure.caption, x).with(
            &column(&figure.y),
            &figure.caption,
            y,
        )
    })
}

/// What a person wants to know of it.
fn account(answer: &Answer) -> String {
    let read = answer.more.get("read").and_then(|r| r.as_str());
    let mut text = read.map_or_else(String::new, |read| format!("Read: {read}\n"));
    text += &answer.lines();
    let mut errors = Vec::new();
    if let Some(e) = answer.relative_error_percent {
        errors.push(format!("relative error {} %", short(e)));
    }
    if let Some(e) = answer.validation_error_percent {
        errors.push(format!("{} % on what it was not fitted to", short(e)));
    }
    if let Some(c) = answer.condition {
        errors.push(format!("condition {}", short(c)));
    }
    if !errors.is_empty() {
        let _ = writeln!(text, "{}", errors.join(", "));
    }
    let replay = |key: &str| {
        answer
            .more
            .get(key)
            .and_then(|r| r["velocity_error_percent"].as_f64())
    };
    for (key, name) in [
        ("replay", "The record"),
        ("validation_replay", "The second record"),
    ] {
        if let Some(error) = replay(key) {
            let _ = writeln!(
                text,
                "{name} replayed in closed loop: the velocity is {} % off",
                short(error)
            );
        }
    }
    let _ = writeln!(text, "{}", capital(&answer.verdict));
    for remark in &answer.remarks {
        let _ = writeln!(text, "Note: {remark}");
    }
    for (key, name) in [
        ("fragment", "Fragment"),
        ("plant_fragment", "The same for the twin"),
        ("report", "Report"),
    ] {
        if let Some(path) = answer.more.get(key).and_then(|p| p.as_str()) {
            let _ = writeln!(text, "{name}: {path}");
        }
    }
    text
}
