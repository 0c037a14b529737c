//! `pigtail rig`.

use crate::common::OwnAxes;
use crate::{DONE, Failure};
use clap::Args;
use pigtail_hal::Error;
use pigtail_session::own::Own;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME, FILES, Setup, rig_files};
use std::fs;
use std::path::PathBuf;

/// Make a rig of your own: a folder with its three files
///
/// The files are those of another rig, the shipped one if none is named, with the axes that --from brings: the
/// identified plant for the twin, its drive for the datasheet, gains to begin with for control. What had been
/// learnt of the axis that was there before (windup, pulses) is left out. Every command takes the folder as
/// its --rig; tune and identify write what they find into it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail rig my-rig --from runs/20260101T120000-servo-0
  pigtail tune z --rig my-rig
  pigtail align --rig my-rig")]
pub(crate) struct Arguments {
    /// The folder to make; one that is there already is left as it is
    folder: PathBuf,
    #[command(flatten)]
    own: OwnAxes,
    /// The rig to begin with
    #[arg(long, default_value = DEFAULT_RIG_NAME)]
    rig: String,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let own = Own::read(&arguments.own.from)?;
    let folder = &arguments.folder;
    let name = folder.display().to_string();
    if folder.exists() {
        let message = "is there already; accepted is the name of a new folder";
        return Err(Error::new(name, "", message).into());
    }
    let files = rig_files(&arguments.rig, &own, false)?;
    // That it is a rig, before anything is written.
    let setup = Setup::load_with(&arguments.rig, DEFAULT_RECIPE_NAME, &own, false)?;
    let partial = folder.with_extension(format!("partial-{}", std::process::id()));
    let write = || -> std::io::Result<()> {
        fs::create_dir(&partial)?;
        for (file, source) in FILES.iter().zip(&files) {
            fs::write(partial.join(file), &source.text)?;
        }
        for (file, text) in setup.weights() {
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
