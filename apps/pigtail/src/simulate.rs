//! `pigtail simulate`.

use crate::common::in_unit;
use crate::{DONE, Failure};
use anyhow::Context;
use clap::{Args, Subcommand};
use pigtail_evaluate::simulate::{Grid, Input, Parameters, joint};
use pigtail_hal::quantity::{FREQUENCY, Sign, TIME};
use pigtail_records::columns::Named;
use pigtail_records::input::Chosen;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::str::FromStr;

/// Simulate a part of the machine alone
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    part: Part,
}

#[derive(Debug, Subcommand)]
enum Part {
    Joint(JointArguments),
}

/// Simulate one joint, (2.1)-(2.13), from rest
///
/// The parameters are a TOML table an axis (or a JSON object), named as in the equations, SI units:
/// Jm, Jl, r, P (metres of output a radian of the load), km, kb, R, ks, kh, bm, bl, fsm, fcm, fsl,
/// fcl, qp, Tp (preload); the servo's Nenc (counts a turn), Ts, Vmax, Vint (bound of the integral's
/// voltage), kp (V/count), ki (V/(count s)), kd (V s/count). `pigtail sample-data data` writes those of the shipped
/// rig's axes to data/axes.toml.
///
/// Writes a row for each moment: time, voltage from then on, positions and velocities of motor and
/// load, output, modes (-1, 0 stuck, +1), encoder count, reference.
#[derive(Debug, Args)]
#[command(
    override_usage = "\
pigtail simulate joint [OPTIONS] --params <FILE> --axis <NAME>
       <--input <FILE>|--reference <FILE>|--impulse <A1,A2,T>|
        --step <N>|--triangle <N,PERIOD>>",
    after_help = "\
Examples:
  pigtail simulate joint --params axes.toml --axis z --impulse 1.5,12.5,1e-3
  pigtail simulate joint --params axes.toml --axis fivebar --step 400 --to step.csv
  pigtail simulate joint --params axes.toml --axis z --reference wanted_um.csv --to followed.csv"
)]
struct JointArguments {
    /// A TOML or JSON file with a table for each axis
    #[arg(long, value_name = "FILE")]
    params: PathBuf,
    /// Which table of it
    #[arg(long, value_name = "NAME")]
    axis: String,
    #[command(flatten)]
    input: InputArguments,
    /// Column of times in the file of --input or --reference; `t_s`, `time_s`, `t` or `time` if not given, else the
    /// first
    #[arg(long, value_name = "COLUMN", conflicts_with_all = ["impulse", "step", "triangle"])]
    time: Option<Named>,
    /// Its column of values; if not given, the only other one, or one with a usual name
    #[arg(long, value_name = "COLUMN", conflicts_with_all = ["impulse", "step", "triangle"])]
    column: Option<Named>,
    /// Rows a second in it, hertz: where no column says when they begin, or the column of time counts them
    #[arg(long, value_name = "HERTZ", value_parser = in_unit(FREQUENCY, "Hz", Sign::Positive), conflicts_with_all = ["impulse", "step", "triangle"])]
    rate: Option<f64>,
    /// Where to write the trajectory; standard output if not given
    #[arg(long, alias = "out", value_name = "FILE")]
    to: Option<PathBuf>,
    /// How long, seconds; what the input needs if not given
    #[arg(long, value_name = "SECONDS", value_parser = in_unit(TIME, "s", Sign::Positive))]
    duration: Option<f64>,
    /// Time between rows, seconds; divides the servo period
    #[arg(long, value_name = "SECONDS", value_parser = in_unit(TIME, "s", Sign::Positive))]
    row_period: Option<f64>,
    /// Longest integration step, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 25e-6, value_parser = in_unit(TIME, "s", Sign::Positive))]
    max_step: f64,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct InputArguments {
    /// Voltages from a file with a column of times and one of voltages, each held until the next; how it is written is
    /// told from it
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// A reference of the PID from such a file, each value held until the next: counts of the motor's encoder, or
    /// lengths of the output or angles of the load where the column has a unit
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// The impulse (4.7): amplitudes over the motor's static friction, and its length in seconds
    #[arg(long, value_name = "A1,A2,T")]
    impulse: Option<Numbers<3>>,
    /// A step of the PID's reference, counts
    #[arg(long, value_name = "N")]
    step: Option<Numbers<1>>,
    /// A reference that rises to N counts and falls back in PERIOD seconds, twice
    #[arg(long, value_name = "N,PERIOD")]
    triangle: Option<Numbers<2>>,
}

/// Finite numbers separated by commas.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Numbers<const N: usize>([f64; N]);

impl<const N: usize> FromStr for Numbers<N> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("\"{text}\" is not {N} finite numbers separated by commas");
        let values = text
            .split(',')
            .map(|field| field.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect::<Option<Vec<f64>>>()
            .ok_or_else(wrong)?;
        values.try_into().map(Self).map_err(|_| wrong())
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let Part::Joint(arguments) = &arguments.part;
    let parameters = Parameters::read(&arguments.params, &arguments.axis)?;
    let chosen = Chosen {
        time: arguments.time.clone(),
        value: arguments.column.clone(),
        rate: arguments.rate,
    };
    let input = input(&arguments.input, &chosen, &parameters)?;
    let grid = Grid {
        duration: arguments.duration.unwrap_or_else(|| input.duration()),
        row_period: arguments.row_period.unwrap_or_else(|| input.row_period()),
        max_step: arguments.max_step,
    };
    bounded(&grid)?;
    let mut trajectory = Vec::new();
    joint(&parameters, &input, &grid, &mut trajectory)?;
    match &arguments.to {
        Some(path) => File::create(path)
            .and_then(|file| {
                let mut file = BufWriter::new(file);
                file.write_all(&trajectory).and_then(|()| file.flush())
            })
            .with_context(|| format!("{}: the trajectory could not be written", path.display()))?,
        None => crate::print(&trajectory)?,
    }
    Ok(DONE)
}

/// Refuses a trajectory that nobody reads: of times in another unit it would fill the memory.
fn bounded(grid: &Grid) -> Result<(), Failure> {
    const MOST: f64 = 1e7;
    let rows = grid.duration / grid.row_period;
    if rows <= MOST {
        return Ok(());
    }
    let message = format!(
        "{} s of rows {} s apart are {rows:.1e} rows; accepted are at most {MOST:.0e}: is a column of time in another unit \
         (as \"t:ms\"), or is a longer --row-period meant?",
        grid.duration, grid.row_period
    );
    Err(bad("--duration", &message))
}

/// From when to when an input goes and between what, as of a wrong unit it shows.
fn ranges(input: &Input) -> String {
    let (Input::Voltages(rows) | Input::Reference(rows)) = input else {
        return String::new();
    };
    let Some(((first, _), (last, _))) = rows.first().zip(rows.last()) else {
        return String::new();
    };
    let (low, high) = bounds(rows);
    let unit = if matches!(input, Input::Voltages(_)) {
        "V"
    } else {
        "counts"
    };
    if rows.len() == 1 {
        return format!("; one row alone: {low:.6} {unit} from {first} s on");
    }
    format!(
        "; {} rows from {first} s to {last} s, {low:.6} to {high:.6} {unit}",
        rows.len()
    )
}

fn bounds(rows: &[(f64, f64)]) -> (f64, f64) {
    rows.iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (_, v)| {
            (low.min(*v), high.max(*v))
        })
}

/// That voltages lie beyond the servo's: an amplifier would not give them, or they are in another unit.
fn beyond(input: &Input, parameters: &Parameters) -> Option<String> {
    let Input::Voltages(rows) = input else {
        return None;
    };
    let (low, high) = bounds(rows);
    let count = rows
        .iter()
        .filter(|(_, v)| v.abs() > parameters.Vmax)
        .count();
    (count > 0).then(|| {
        format!(
            "Note: {count} of {} voltages lie beyond the servo's {} V, up to {:.6} V; they are played as they are: is the column in \
             another unit?",
            rows.len(),
            parameters.Vmax,
            high.max(-low)
        )
    })
}

/// An option that says what cannot be done.
fn bad(option: &str, message: &str) -> Failure {
    Failure::Input(pigtail_hal::Error::new("simulate joint", option, message))
}

fn input(
    arguments: &InputArguments,
    chosen: &Chosen,
    parameters: &Parameters,
) -> Result<Input, Failure> {
    let InputArguments {
        input,
        reference,
        impulse,
        step,
        triangle,
    } = arguments;
    let file = match (input, reference) {
        (Some(path), _) => Some(Input::voltages(path, chosen)?),
        (None, Some(path)) => Some(Input::reference(path, chosen, parameters)?),
        (None, None) => None,
    };
    // The trajectory itself may go to standard output.
    if let Some((input, understood)) = file {
        crate::say(&format!("Read: {understood}{}", ranges(&input)));
        if let Some(note) = beyond(&input, parameters) {
            crate::say(&note);
        }
        return Ok(input);
    }
    if let Some(Numbers([a1, a2, period])) = *impulse {
        if period <= 0.0 {
            return Err(bad(
                "--impulse",
                "T is not positive; accepted is a length above zero",
            ));
        }
        return Ok(Input::Impulse { a1, a2, period });
    }
    if let Some(Numbers([counts, period])) = *triangle {
        if period <= 0.0 {
            return Err(bad(
                "--triangle",
                "PERIOD is not positive; accepted is one above zero",
            ));
        }
        return Ok(Input::Triangle { counts, period });
    }
    let Some(Numbers([counts])) = *step else {
        return Err(bad(
            "--input",
            "is missing; accepted is one of input, reference, impulse, step, triangle",
        ));
    };
    Ok(Input::Step(counts))
}
