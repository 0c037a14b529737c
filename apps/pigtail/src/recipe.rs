//! `pigtail recipe`: production recipes.

use crate::{DONE, Failure};
use clap::{Args, Subcommand};
use pigtail_session::produce::production;
use pigtail_session::rig::DEFAULT_RIG_NAME;
use pigtail_session::setup::Setup;

/// Check and explain a production recipe
///
/// A production recipe says how the fibers of a tray are picked, get adhesive, are aligned, cured and verified: phases with
/// parameters, tolerances and time limits, and what to do when one fails.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail recipe check my-recipe.toml
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
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let (Command::Check(named) | Command::Explain(named)) = &arguments.command;
    let (production, (file, _)) = match production(&named.recipe) {
        Ok(read) => read,
        Err(wrong) => {
            let all: Vec<String> = wrong.iter().map(ToString::to_string).collect();
            return Err(anyhow::anyhow!("{}", all.join("\n       ")).into());
        }
    };
    // The recipe of its device has to be there too.
    Setup::load(DEFAULT_RIG_NAME, &production.device)?;
    let text = match arguments.command {
        Command::Check(_) => format!("{file} is well\n"),
        Command::Explain(_) => production.explain(),
    };
    crate::print(text.as_bytes())?;
    Ok(DONE)
}
