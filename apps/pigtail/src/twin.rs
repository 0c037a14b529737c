//! `pigtail twin`.

use crate::Failure;
use crate::progress::Busy;
use crate::records::{Files, Output, finish, hash_of};
use clap::{Args, ValueEnum};
use pigtail_hal::Error;
use pigtail_records::fragment::Fragment;
use pigtail_records::twin::twin;
use pigtail_store::runs::Run;
use pigtail_sysid::servo::Sliding;
use std::path::PathBuf;

/// Simulate a twin of an identified axis beside its record
///
/// Takes the fragment that `pigtail identify servo` wrote: inertia and friction, the controller, and where
/// the record is. The record's reference is run through the closed loop again, and position, velocity
/// and voltage are set beside the record's; `--data` names another record of the same columns.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail twin --from runs/20260101T120000-servo-0/plant.toml
  pigtail twin --from plant.toml --data other.csv --friction lugre --presliding 5e-6")]
pub(crate) struct Arguments {
    /// The plant.toml of `pigtail identify servo`, or the folder of its run
    #[arg(long, value_name = "FRAGMENT")]
    from: PathBuf,
    /// Another record of the same columns
    #[arg(long, value_name = "FILE")]
    data: Option<PathBuf>,
    /// How friction gives way before it slides
    #[arg(long, value_enum, default_value = "coulomb")]
    friction: Law,
    /// Way over which it gives way, m or rad
    #[arg(long, value_name = "WAY", value_parser = crate::positive, required_if_eq_any = [
        ("friction", "coulomb-presliding"), ("friction", "maxwell-slip"), ("friction", "lugre")])]
    presliding: Option<f64>,
    /// Static over Coulomb friction, for lugre
    #[arg(long, value_name = "RATIO", default_value_t = 1.0, value_parser = crate::positive)]
    static_ratio: f64,
    /// Velocity above which static friction falls to Coulomb friction, m/s or rad/s, for lugre
    #[arg(long, value_name = "VELOCITY", default_value_t = 1e-3, value_parser = crate::positive)]
    stribeck: f64,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Law {
    /// Not at all
    Coulomb,
    /// The output yields in front of it, (2.12) and (2.13)
    CoulombPresliding,
    /// Maxwell-slip elements
    MaxwellSlip,
    /// LuGre
    Lugre,
}

pub(crate) fn run(a: &Arguments) -> Result<u8, Failure> {
    let from = Fragment::file(&a.from);
    let fragment = Fragment::read(&from)?;
    let way = a.presliding.unwrap_or_default();
    let law = match a.friction {
        Law::Coulomb => Ok(("coulomb", Sliding::Coulomb)),
        Law::CoulombPresliding => Ok(("coulomb-presliding", Sliding::CoulombPresliding(way))),
        Law::MaxwellSlip => Sliding::maxwell_slip(way).map(|law| ("maxwell-slip", law)),
        Law::Lugre => Sliding::lugre(way, a.static_ratio, a.stribeck).map(|law| ("lugre", law)),
    }
    .map_err(|invalid| Error::new("--friction", "", invalid.to_string()))?;
    let busy = Busy::new("twin", "running the record again");
    let answered = twin(&from, &fragment, a.data.as_deref(), law);
    drop(busy);
    let (answer, shown) = answered?;
    let data = a.data.as_deref().unwrap_or(&fragment.record.file);
    finish(
        "twin",
        &format!("A twin of {}", data.display()),
        answer,
        shown.as_ref(),
        &[hash_of(&from), hash_of(data)],
        None::<fn(&Run) -> anyhow::Result<Files>>,
        &a.output,
    )
}
