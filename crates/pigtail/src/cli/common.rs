//! What the commands that run a machine have in common.

use crate::rig::DEFAULT_RIG_NAME;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct Common {
    /// What to draw: machine, device, fixture and noise
    #[arg(long, default_value_t = 0, allow_negative_numbers = true)]
    pub(super) seed: u64,
    /// A folder with the three files of a rig, or the name of one below `rigs`
    #[arg(long, default_value = DEFAULT_RIG_NAME)]
    pub(super) rig: String,
    /// Print JSON instead of text
    #[arg(long)]
    pub(super) json: bool,
    /// Where to write the run's folder
    #[arg(long, value_name = "FOLDER", default_value = "runs")]
    pub(super) runs: PathBuf,
}
