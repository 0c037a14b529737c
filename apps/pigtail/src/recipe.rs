//! `pigtail recipe`: production recipes.

use crate::{DONE, Failure};
use clap::{Args, Subcommand};
use pigtail_control::job::PORTS;
use pigtail_hal::Error;
use pigtail_session::produce::production;
use pigtail_session::rig::{DEFAULT_RIG_NAME, Rig};

/// Check and explain a production recipe
///
/// A production recipe says how the fibers of a tray are picked, get adhesive, are aligned, cured and verified: phases with
/// parameters, tolerances and time limits, and what to do when one fails.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail recipe check my-recipe.toml
  pigtail recipe check my-recipe.toml --rig my-rig
  pigtail recipe explain produce-fast")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Say everything that is wrong with a production recipe
    Check(Named),
    /// Say in words what a production recipe does
    Explain(Named),
}

#[derive(Debug, Args)]
struct Named {
    /// A production recipe: a TOML file, or the name of one below `recipes`
    #[arg(value_name = "RECIPE")]
    recipe: String,
    /// The rig that it is for: a folder, or the name of one below `rigs`
    #[arg(long, default_value = DEFAULT_RIG_NAME)]
    rig: String,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let (Command::Check(named) | Command::Explain(named)) = &arguments.command;
    let listed = |wrong: &[Error]| {
        let all: Vec<String> = wrong.iter().map(ToString::to_string).collect();
        Failure::from(anyhow::anyhow!("{}", all.join("\n       ")))
    };
    let (production, (file, _)) = production(&named.recipe).map_err(|wrong| listed(&wrong))?;
    let mut wrong = Vec::new();
    for (i, port) in production.ports.iter().enumerate() {
        if !PORTS.contains(&port.as_str()) {
            let message =
                format!("is \"{port}\", which the device has not; accepted are {PORTS:?}");
            wrong.push(Error::new(&file, format!("ports[{i}]"), message));
        }
    }
    // The recipe of its device has to be there too, for a machine that can do this.
    wrong.extend(Rig::load(&named.rig, &production.device).err());
    if !wrong.is_empty() {
        return Err(listed(&wrong));
    }
    let text = match arguments.command {
        Command::Check(_) => format!("{file} is well\n"),
        Command::Explain(_) => production.explain(),
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}
