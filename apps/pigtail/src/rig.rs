//! `pigtail rig`.

use crate::common::OwnAxes;
use crate::{DONE, Failure};
use clap::{Args, Subcommand};
use pigtail_hal::Error;
use pigtail_session::bench::{BenchRig, BenchSetup, is_bench};
use pigtail_session::own::Own;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, FILES, Named, Rig, rig_files};
use pigtail_session::setup::Setup;
use serde::Serialize;
use std::fs;
use std::path::PathBuf;

/// Make a rig of your own, or check one
///
/// Without a further word it makes one: a folder with its three files.
///
/// The files are those of another rig, the shipped one if none is named, with the axes that --from brings: the
/// identified plant for the twin, its drive for the datasheet, gains to begin with for control. What had been
/// learnt of the axis that was there before (windup, pulses) is left out. Every command takes the folder as
/// its --rig; tune, identify and characterize write what they find into it where --write says so, as a new version
/// of its calibration (`pigtail calibration`). Of the rig that it begins with the current calibration is taken, and no
/// older version.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "\
Examples:
  pigtail rig my-rig --from runs/20260101T120000-servo-0
  pigtail rig check my-rig                 whether its files are well, and what it can do
  pigtail tune z --rig my-rig --write
  pigtail align --rig my-rig")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// The folder to make; one that is there already is left as it is
    #[arg(required = true)]
    folder: Option<PathBuf>,
    #[command(flatten)]
    own: OwnAxes,
    /// The rig to begin with
    #[arg(long, default_value = DEFAULT_RIG_NAME)]
    rig: String,
}

#[derive(Debug, Subcommand)]
enum Command {
    Check(CheckArguments),
}

/// Check the files of a rig, and say what it can do
///
/// Reads datasheet, calibration and recipe, and the truth where there is one: a rig without a `plant.toml` is a
/// rig of a real machine, whole but for a twin to try it on. The first mistake is named with its file, key and
/// value.
#[derive(Debug, Args)]
struct CheckArguments {
    /// A folder with the files of a rig, or the name of one below `rigs`
    #[arg(default_value = DEFAULT_RIG_NAME)]
    rig: String,
    /// A recipe file, or the name of one below `recipes`
    #[arg(long, default_value = DEFAULT_RECIPE_NAME)]
    recipe: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// What `rig check` prints as JSON. Keys are a contract.
#[derive(Debug, Serialize)]
struct Checked<'a> {
    /// The rig as it was named.
    rig: &'a str,
    /// The recipe as it was named.
    recipe: &'a str,
    /// Whether a twin can be drawn.
    twin: bool,
    /// Name and SHA-256 of each file that was read.
    files: &'a [(String, String)],
}

fn check(arguments: &CheckArguments) -> Result<u8, Failure> {
    let (rig, recipe) = (&arguments.rig, &arguments.recipe);
    let bench = is_bench(rig)?;
    // The truth is checked with the first machine that it makes.
    let (twin, files) = if bench {
        let named = Named {
            rig,
            recipe,
            ..Named::default()
        };
        let rig = BenchRig::load_named(&named)?;
        if rig.has_twin() {
            BenchSetup::of(rig.clone())?.twin(0)?;
        }
        (rig.has_twin(), rig.hashes)
    } else {
        let rig = Rig::load(rig, recipe)?;
        let twin = rig.truth().is_some();
        if twin {
            Setup::of(rig.clone())?.twin(0)?;
        }
        (twin, rig.hashes)
    };
    let checked = Checked {
        rig,
        recipe,
        twin,
        files: &files,
    };
    let text = if arguments.json {
        serde_json::to_string(&checked).map_err(anyhow::Error::from)? + "\n"
    } else {
        let files = checked
            .files
            .iter()
            .map(|(file, _)| format!("{file}: well\n"));
        let can = if bench && twin {
            "It is a bench that is controlled by position, and has a twin: align, campaign and commission run on it.\n"
        } else if twin {
            "It has a twin: every command runs on it.\n"
        } else {
            "It has no plant.toml, and so no twin: commands that need a machine need a real one.\n"
        };
        files.chain([can.to_owned()]).collect()
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let folder = match (&arguments.command, &arguments.folder) {
        (Some(Command::Check(arguments)), _) => return check(arguments),
        (None, Some(folder)) => folder,
        (None, None) => {
            let message = "no folder is named; accepted is that of the rig to make";
            return Err(Error::new("FOLDER", "", message).into());
        }
    };
    let own = Own::read(&arguments.own.from)?;
    let name = folder.display().to_string();
    if folder.exists() {
        let message = "is there already; accepted is the name of a new folder";
        return Err(Error::new(name, "", message).into());
    }
    let named = Named {
        rig: &arguments.rig,
        recipe: DEFAULT_RECIPE_NAME,
        ..Named::default()
    };
    let bench = is_bench(&arguments.rig)?;
    if bench && !own.is_empty() {
        let message = "is controlled by position, and has no axes to be replaced; accepted is a machine of volts";
        return Err(Error::new(&arguments.rig, "", message).into());
    }
    let files = rig_files(&named, &own, false)?;
    // That it is a rig, before anything is written.
    let weights: Vec<(String, String)> = if bench {
        BenchSetup::load_named(&named)?;
        Vec::new()
    } else {
        let setup = Setup::load_with(&named, &own, false)?;
        let weights = setup.rig.weights();
        weights
            .map(|(file, text)| (file.to_owned(), text.to_owned()))
            .collect()
    };
    let partial = folder.with_extension(format!("partial-{}", std::process::id()));
    let write = || -> std::io::Result<()> {
        fs::create_dir(&partial)?;
        for (file, source) in FILES.iter().zip(&files) {
            fs::write(partial.join(file), &source.text)?;
        }
        for (file, text) in &weights {
            fs::write(partial.join(file), text)?;
        }
        fs::rename(&partial, folder)
    };
    if let Err(error) = write() {
        let _ = fs::remove_dir_all(&partial);
        return Err(Error::new(name, "", format!("cannot be written: {error}")).into());
    }
    crate::print(format!("Written: {name}\n").as_bytes())?;
    Ok(DONE)
}
