//! `pigtail completions` and `pigtail man`: what a shell and `man` know of the program.

use crate::{DONE, Failure};
use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

/// Print what completes commands and options in a shell
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail completions bash > ~/.local/share/bash-completion/completions/pigtail
  pigtail completions zsh > ~/.zfunc/_pigtail
  pigtail completions fish > ~/.config/fish/completions/pigtail.fish")]
pub(crate) struct CompletionsArguments {
    /// The shell
    shell: Shell,
}

pub(crate) fn completions(arguments: &CompletionsArguments) -> Result<u8, Failure> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut crate::command(), "pigtail", &mut text);
    crate::print_as_it_is(&text)?;
    Ok(DONE)
}

/// Print the manual page of the program, or write those of all commands into a folder
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail man | man -l -
  pigtail man --into ~/.local/share/man/man1")]
pub(crate) struct ManArguments {
    /// A folder that is there, for a page a command
    #[arg(long, value_name = "FOLDER")]
    into: Option<PathBuf>,
}

pub(crate) fn man(arguments: &ManArguments) -> Result<u8, Failure> {
    if let Some(folder) = &arguments.into {
        if !folder.is_dir() {
            let message = "is no folder; accepted is one that is there";
            return Err(pigtail_hal::Error::new(folder.display().to_string(), "", message).into());
        }
        clap_mangen::generate_to(crate::command(), folder).map_err(anyhow::Error::from)?;
        return Ok(DONE);
    }
    let mut text = Vec::new();
    clap_mangen::Man::new(crate::command())
        .render(&mut text)
        .map_err(anyhow::Error::from)?;
    crate::print_as_it_is(&text)?;
    Ok(DONE)
}
