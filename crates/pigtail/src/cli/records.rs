//! `pigtail identify` from a record that a person brings.

use super::{DONE, Failure, NEGATIVE};
use crate::records::columns::Named;
use crate::records::fragment::{AxisTable, ControllerTable, Fragment, RecordTable};
use crate::records::servo::{self, Roles};
use crate::records::{Answer, Shown, capital, short};
use crate::report;
use crate::rig::hash;
use crate::runs::Run;
use clap::{Args, ValueEnum};
use pigtail_control::record::servo::{Controller, Friction, Method, Settings};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What all of these commands take.
#[derive(Debug, Args)]
pub(super) struct Output {
    /// Print JSON instead of text
    #[arg(long)]
    pub(super) json: bool,
    /// Where to write the run's folder
    #[arg(long, value_name = "FOLDER", default_value = "runs")]
    pub(super) runs: PathBuf,
}

/// Identify inertia and friction of a servo axis from a record of it
///
/// Fits the inverse dynamic model, force = inertia x acceleration + viscous + Coulomb friction + offset,
/// by least squares: the position filtered both ways, differentiated by central differences, everything
/// decimated. Symmetric friction with an offset, and friction that each direction has for itself; by
/// ordinary least squares, weighted, and with instrumental variables from the closed loop replayed. The
/// verdict says which variant generalises: by the second record (--validate), else by the last part of the
/// first one. Where a record does not excite a parameter, it is not given a value, and the exit code is 1.
///
/// A column is NAME or NAME:UNIT; without, its unit is the one its name ends with (`q_mm`, `q [mm]`), else SI.
/// With a reference, the controller is identified too, and the record replayed in closed loop.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail identify servo --data log.csv --time t_s --reference q_ref_m --position q_meas_m --voltage u_V \
--force-per-volt 35.15
  pigtail identify servo --data log.csv --position pos:mm --voltage cmd:V --force-per-volt 12 --validate b.csv")]
pub(super) struct ServoArguments {
    /// A CSV file whose first line names its columns
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// Its column of time; `t_s`, `time_s`, `t` or `time` if not given
    #[arg(long, value_name = "COLUMN")]
    time: Option<Named>,
    /// Its column of the position's reference
    #[arg(long, value_name = "COLUMN")]
    reference: Option<Named>,
    /// Its column of position, a length or an angle
    #[arg(long, value_name = "COLUMN")]
    position: Named,
    /// Its column of motor voltage
    #[arg(long, value_name = "COLUMN")]
    voltage: Named,
    /// Force (N) or torque (N m) of a volt
    #[arg(long, value_name = "K", value_parser = super::positive)]
    force_per_volt: f64,
    /// A second record of the same columns, to judge by
    #[arg(long, value_name = "FILE")]
    validate: Option<PathBuf>,
    /// Friction whose parameters are reported
    #[arg(long, value_enum, default_value = "symmetric")]
    friction: FrictionChoice,
    /// Method whose parameters are reported
    #[arg(long, value_enum, default_value = "least-squares")]
    method: MethodChoice,
    /// Cutoff of the position's filter, hertz; a tenth of the sample rate, at most 100, if not given
    #[arg(long, value_name = "HERTZ", value_parser = super::positive)]
    cutoff: Option<f64>,
    /// Order of the filter
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=8))]
    order: u8,
    /// Samples left out at the start
    #[arg(long, default_value_t = 49)]
    skip: usize,
    /// One equation in so many samples; sample rate over cutoff if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    decimate: Option<u32>,
    /// The controller u = KV (KP (reference - position) - velocity), bounded by LIMIT volts; found in the record if
    /// not given
    #[arg(long, value_name = "KP,KV,LIMIT", value_parser = cascade)]
    controller: Option<Controller>,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FrictionChoice {
    /// Both directions alike, and an offset
    Symmetric,
    /// Each direction for itself
    Asymmetric,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MethodChoice {
    /// Ordinary least squares
    LeastSquares,
    /// Least squares by Huber's weights
    Weighted,
    /// Instrumental variables
    Instrumental,
}

fn cascade(text: &str) -> Result<Controller, String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|t| {
            t.trim()
                .parse()
                .ok()
                .filter(|v: &f64| v.is_finite() && *v > 0.0)
        })
        .collect();
    match numbers.as_deref() {
        Some([kp, kv, limit]) => Ok(Controller::cascade(*kp, *kv, *limit)),
        _ => Err(format!(
            "\"{text}\" is not three finite numbers above zero, separated by commas"
        )),
    }
}

pub(super) fn hash_of(path: &Path) -> (String, String) {
    let content = std::fs::read(path).unwrap_or_default();
    (path.display().to_string(), hash(content))
}

pub(super) fn servo(a: &ServoArguments) -> Result<u8, Failure> {
    let roles = Roles {
        time: a.time.clone(),
        reference: a.reference.clone(),
        position: a.position.clone(),
        voltage: a.voltage.clone(),
    };
    let first = roles.read(&a.data)?;
    let second = a
        .validate
        .as_ref()
        .map(|path| roles.read(path))
        .transpose()?;
    let set = Settings {
        force_per_volt: a.force_per_volt,
        cutoff: a.cutoff,
        order: usize::from(a.order),
        skip: a.skip,
        decimate: a.decimate.map(|d| d as usize),
        controller: a.controller,
    };
    let nyquist = 0.5 / first.record.even().period;
    if let Some(cutoff) = a.cutoff.filter(|c| *c >= nyquist) {
        let message = format!(
            "{cutoff} Hz is not below the record's Nyquist frequency; accepted is less than {nyquist} Hz"
        );
        return Err(
            pigtail_hal::Error::new(a.data.display().to_string(), "--cutoff", message).into(),
        );
    }
    let friction = match a.friction {
        FrictionChoice::Symmetric => Friction::Symmetric,
        FrictionChoice::Asymmetric => Friction::Asymmetric,
    };
    let method = match a.method {
        MethodChoice::LeastSquares => Method::LeastSquares,
        MethodChoice::Weighted => Method::Weighted,
        MethodChoice::Instrumental => Method::Instrumental,
    };
    let found = servo::servo(&first, second.as_ref(), &set, (friction, method));
    let fragment = found
        .best
        .as_ref()
        .filter(|_| found.answer.is_whole())
        .map(|(best, whole)| {
            move |origin: String| Fragment {
                origin,
                axis: AxisTable::new(first.kind, &best.axis(a.force_per_volt)),
                controller: whole.controller.as_ref().map(ControllerTable::new),
                record: RecordTable::new(&first.source),
            }
        });
    let mut hashes = vec![hash_of(&a.data)];
    hashes.extend(a.validate.as_deref().map(hash_of));
    let title = format!("A servo axis from {}", a.data.display());
    finish(
        "servo",
        &title,
        found.answer,
        found.shown.as_ref(),
        &hashes,
        fragment.map(|f| move |run: &Run| Ok(("plant.toml", f(origin("servo", run)).text()?))),
        &a.output,
    )
}

pub(super) fn origin(what: &str, run: &Run) -> String {
    format!("identify {what}, run {}, {}", run.name(), run.date())
}

/// Writes the run and prints the answer.
pub(super) fn finish(
    what: &str,
    title: &str,
    mut answer: Answer,
    shown: Option<&Shown>,
    hashes: &[(String, String)],
    fragment: Option<impl FnOnce(&Run) -> anyhow::Result<(&'static str, String)>>,
    output: &Output,
) -> Result<u8, Failure> {
    let run = Run::begin(&output.runs, &format!("-{what}"), 0)?;
    if let Some(fragment) = fragment {
        let (name, text) = fragment(&run)?;
        run.write(name, text)?;
        let path = run.path(name).display().to_string();
        answer.more.insert("fragment".to_owned(), path.into());
    }
    let path = run.path("report.html").display().to_string();
    answer.more.insert("report".to_owned(), path.into());
    let document = answer.json();
    run.write_json("summary.json", &document)?;
    run.write("report.html", report::record(title, &answer, shown)?)?;
    run.finish_with(hashes, 0)?;
    let text = if output.json {
        format!("{document}\n")
    } else {
        account(&answer)
    };
    super::print(text.as_bytes())?;
    Ok(if servo::is_negative(&answer) {
        NEGATIVE
    } else {
        DONE
    })
}

/// What a person wants to know of it.
fn account(answer: &Answer) -> String {
    let mut text = answer.lines();
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
    for (key, name) in [("fragment", "Fragment"), ("report", "Report")] {
        if let Some(path) = answer.more.get(key).and_then(|p| p.as_str()) {
            let _ = writeln!(text, "{name}: {path}");
        }
    }
    text
}
