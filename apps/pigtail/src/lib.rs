//! The `pigtail` program: its commands, their options and what they print.
//!
//! Exit codes: 0 done, 1 an honest negative, 2 bad input, 3 a fault.

mod align;
mod bench;
mod benchmark;
mod calibration;
mod campaign;
mod characterize;
mod choice;
mod commission;
mod common;
mod exchanges;
mod found;
mod hysteresis;
mod identify;
mod impulse;
mod journal;
mod kinds;
mod maximize;
mod methods;
mod phases;
mod plan;
mod produce;
mod progress;
mod recipe;
mod records;
mod reproduce;
mod rig;
mod running;
mod runs;
mod sample_data;
mod scan;
mod schema;
mod shell;
mod simulate;
mod stop;
mod trace;
mod tray_plan;
mod trays;
mod tune;
mod twin;
mod way;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use pigtail_control::outcome::Outcome;
use pigtail_hal::{Error, Fault};
use pigtail_session::job::Ended;
pub use schema::FileKind;
use std::any::TypeId;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

const DONE: u8 = 0;
const NEGATIVE: u8 = 1;
const BAD_INPUT: u8 = 2;
const FAULT: u8 = 3;

#[derive(Debug, Parser)]
#[command(version, max_term_width = 100, about = ABOUT, long_about = LONG_ABOUT, after_help = AFTER)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const ABOUT: &str = "Aligns optical fibers to photonic chips, on a machine or on its digital twin";

const LONG_ABOUT: &str = "\
Aligns optical fibers to photonic chips, on a machine or on its digital twin.

A rig describes a machine in three files: its datasheet (`machine.toml`), the truth that only the \
twin reads (`plant.toml`) and the belief that control acts on (`calibration.toml`). A recipe \
describes a device and how to align it. Without further ado,

    pigtail align

draws a machine and a device, aligns three fibers from measurements alone, and says how far off \
they really are.";

const AFTER: &str = "\
Exit codes:
  0  done
  1  an honest negative, such as no light found
  2  bad input, explained on standard error
  3  the machine has a fault";

#[derive(Debug, Subcommand)]
enum Command {
    Align(align::Arguments),
    Campaign(campaign::Arguments),
    Benchmark(benchmark::Arguments),
    Plan(plan::Arguments),
    Produce(produce::Arguments),
    Recipe(recipe::Arguments),
    Maximize(maximize::Arguments),
    Commission(commission::Arguments),
    Tune(tune::Arguments),
    Calibration(calibration::Arguments),
    Identify(identify::Arguments),
    Predict(hysteresis::PredictArguments),
    Characterize(characterize::Arguments),
    Impulse(impulse::Arguments),
    Trace(trace::Arguments),
    Simulate(simulate::Arguments),
    SampleData(sample_data::Arguments),
    Twin(twin::Arguments),
    Rig(rig::Arguments),
    Schema(schema::Arguments),
    Reproduce(reproduce::Arguments),
    Runs(runs::Arguments),
    Completions(shell::CompletionsArguments),
    Man(shell::ManArguments),
}

/// Why a command ends without its result.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("{0}")]
    Input(#[from] Error),
    #[error("the machine has stopped, and is safe: {0}")]
    Fault(#[from] Fault),
    #[error("{0}")]
    Negative(Outcome),
    #[error("{0:#}")]
    Other(#[from] anyhow::Error),
}

impl From<Ended> for Failure {
    fn from(ended: Ended) -> Self {
        match ended {
            Ended::Input(error) => Self::Input(error),
            Ended::Fault(fault) => Self::Fault(fault),
            Ended::Outcome(outcome) => Self::Negative(outcome),
            Ended::Unrecorded(error) => Self::Other(error.into()),
        }
    }
}

/// Parses a whole number, zero among them.
fn from_zero<T: FromStr>(text: &str) -> Result<T, String> {
    text.parse()
        .map_err(|_| "accepted is a whole number from 0 on".to_owned())
}

/// Parses a finite number above zero.
fn positive(text: &str) -> Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|value| value.is_finite() && *value > 0.0)
        .ok_or_else(|| format!("\"{text}\" is not a finite number above zero"))
}

/// A number that is not zero.
fn not_zero(text: &str) -> Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|value| value.is_finite() && *value != 0.0)
        .ok_or_else(|| format!("\"{text}\" is not a finite number other than zero"))
}

/// Prints a text, on a terminal with its sentences wrapped.
fn print(text: &[u8]) -> anyhow::Result<()> {
    match std::str::from_utf8(text) {
        // A document is one line for another program, wherever it goes.
        Ok(words) if !words.starts_with(['{', '[']) => {
            let room = pigtail_report::text::room();
            print_as_it_is(pigtail_report::text::wrapped(words, room).as_bytes())
        }
        _ => print_as_it_is(text),
    }
}

/// Says something beside the results: a note, an error. On a terminal it is wrapped.
fn say(text: &str) {
    let room = console::Term::stderr()
        .size_checked()
        .map(|(_, columns)| usize::from(columns));
    let said = pigtail_report::text::wrapped(&format!("{text}\n"), room);
    // Nobody may be there to read it.
    let _ = io::stderr().lock().write_all(said.as_bytes());
}

/// What is wrong with the arguments, or what was asked of them.
fn answered(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        // `--help` and `--version` come this way too. Nobody may be there to read them.
        let _ = error.print();
        return ExitCode::from(DONE);
    }
    let rendered = error.render();
    let text = if console::colors_enabled_stderr() {
        rendered.ansi().to_string()
    } else {
        rendered.to_string()
    };
    say(text.trim_end());
    ExitCode::from(BAD_INPUT)
}

/// Prints a text. That whoever was reading has read enough is no failure.
fn print_as_it_is(text: &[u8]) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => Ok(other?),
    }
}

/// The program's commands and options, for whoever describes them.
pub fn command() -> clap::Command {
    values_below_zero(Arguments::command().name("pigtail"))
}

/// What begins with a minus behind an option that takes a number or a quantity is its value: where nothing below zero is
/// accepted the option says so, and no option "-1" is missed.
fn values_below_zero(command: clap::Command) -> clap::Command {
    command
        .mut_args(|argument| {
            let parsed = argument.get_value_parser().type_id();
            let free = parsed == TypeId::of::<String>() || parsed == TypeId::of::<PathBuf>();
            let takes = argument.get_action().takes_values() && argument.get_long().is_some();
            if takes && !free {
                argument.allow_hyphen_values(true)
            } else {
                argument
            }
        })
        .mut_subcommands(values_below_zero)
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    if let Some(answer) = align::asked_for_faults(std::env::args_os()) {
        // Nobody may be there to read it.
        let _ = print(answer.as_bytes());
        return ExitCode::from(DONE);
    }
    let matches = command().try_get_matches();
    let arguments = match matches.and_then(|matches| Arguments::from_arg_matches(&matches)) {
        Ok(arguments) => arguments,
        Err(error) => return answered(&error),
    };
    let result = match arguments.command {
        Command::Align(arguments) => align::run(&arguments),
        Command::Campaign(arguments) => campaign::run(&arguments),
        Command::Benchmark(arguments) => benchmark::run(&arguments),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Produce(arguments) => produce::run(&arguments),
        Command::Recipe(arguments) => recipe::run(&arguments),
        Command::Maximize(arguments) => maximize::run(&arguments),
        Command::Commission(arguments) => commission::run(&arguments),
        Command::Tune(arguments) => tune::run(&arguments),
        Command::Calibration(arguments) => calibration::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        Command::Predict(arguments) => hysteresis::predict(&arguments),
        Command::Characterize(arguments) => characterize::run(&arguments),
        Command::Impulse(arguments) => impulse::run(&arguments),
        Command::Trace(arguments) => trace::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::SampleData(arguments) => sample_data::run(&arguments),
        Command::Twin(arguments) => twin::run(&arguments),
        Command::Rig(arguments) => rig::run(&arguments),
        Command::Schema(arguments) => schema::run(&arguments),
        Command::Reproduce(arguments) => reproduce::run(&arguments),
        Command::Runs(arguments) => runs::run(&arguments),
        Command::Completions(arguments) => shell::completions(&arguments),
        Command::Man(arguments) => shell::man(&arguments),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(failure) => {
            if let Failure::Negative(outcome) = &failure {
                say(&outcome.to_string());
            } else {
                say(&format!("error: {failure}"));
            }
            ExitCode::from(match failure {
                Failure::Input(_) | Failure::Other(_) => BAD_INPUT,
                Failure::Fault(_) => FAULT,
                Failure::Negative(_) => NEGATIVE,
            })
        }
    }
}
