//! `pigtail twin`.

use crate::Failure;
use crate::common::spaced;
use crate::progress::Busy;
use crate::records::{Files, Output, finish, hash_of};
use clap::{Args, ValueEnum};
use pigtail_hal::Error;
use pigtail_hal::quantity::{ANGLE, Dimension, LENGTH, ROTATION, SPEED, Sign};
use pigtail_records::fragment::{Fragment, Kind};
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
  pigtail twin --from plant.toml --data other.csv --law lugre --presliding 5e-6")]
pub(crate) struct Arguments {
    /// The plant.toml of `pigtail identify servo`, or the folder of its run
    #[arg(long, value_name = "FRAGMENT")]
    from: PathBuf,
    /// Another record of the same columns
    #[arg(long, value_name = "FILE")]
    data: Option<PathBuf>,
    /// How friction gives way before it slides
    #[arg(long, alias = "friction", value_enum, default_value = "coulomb")]
    law: Law,
    /// Way over which it gives way, m or rad, or with a unit, such as "5 um"
    #[arg(long, value_name = "WAY", value_parser = of_axis(LENGTH, ANGLE), required_if_eq_any = [
        ("law", "coulomb-presliding"), ("law", "maxwell-slip"), ("law", "lugre")])]
    presliding: Option<OfAxis>,
    /// Static over Coulomb friction, for lugre
    #[arg(long, value_name = "RATIO", default_value_t = 1.0, value_parser = crate::positive)]
    static_ratio: f64,
    /// Velocity above which static friction falls to Coulomb friction, m/s or rad/s, or with a unit, for lugre
    #[arg(long, value_name = "VELOCITY", default_value = "0.001", value_parser = of_axis(SPEED, ROTATION))]
    stribeck: OfAxis,
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

/// A value in the unit of the axis, metres or radians; with its own unit it says which of both the axis must be.
#[derive(Debug, Clone, Copy)]
struct OfAxis {
    value: f64,
    kind: Option<Kind>,
}

/// A parser of such values above zero.
fn of_axis(
    linear: Dimension,
    rotary: Dimension,
) -> impl Fn(&str) -> Result<OfAxis, String> + Clone + Send + Sync + 'static {
    move |text| {
        let named = spaced(text);
        let plain = named.parse::<f64>().is_ok();
        let turns = rotary.units.iter();
        let turns = turns.map(|(unit, _)| format!(" {unit}"));
        let (kind, dimension) = if turns.into_iter().any(|unit| named.ends_with(&unit)) {
            (Kind::Rotary, rotary)
        } else {
            (Kind::Linear, linear)
        };
        let value = if plain {
            crate::positive(&named)
        } else {
            dimension.parse(&named, Sign::Positive)
        };
        value.map(|value| OfAxis {
            value,
            kind: (!plain).then_some(kind),
        })
    }
}

impl OfAxis {
    /// The value, where the axis is of its kind.
    fn on(self, kind: Kind, flag: &str) -> Result<f64, Error> {
        let message = match (self.kind, kind) {
            (Some(Kind::Linear), Kind::Rotary) => {
                "this axis turns; accepted is an angle (or a speed of rotation)"
            }
            (Some(Kind::Rotary), Kind::Linear) => {
                "this axis moves along a line; accepted is a length (or a speed)"
            }
            _ => return Ok(self.value),
        };
        Err(Error::new(flag, "", message))
    }
}

pub(crate) fn run(a: &Arguments) -> Result<u8, Failure> {
    let from = Fragment::file(&a.from);
    let fragment = Fragment::read(&from)?;
    let kind = fragment.axis.kind;
    let way = a
        .presliding
        .map_or(Ok(0.0), |way| way.on(kind, "--presliding"))?;
    let stribeck = a.stribeck.on(kind, "--stribeck")?;
    let law = match a.law {
        Law::Coulomb => Ok(("coulomb", Sliding::Coulomb)),
        Law::CoulombPresliding => Ok(("coulomb-presliding", Sliding::CoulombPresliding(way))),
        Law::MaxwellSlip => Sliding::maxwell_slip(way).map(|law| ("maxwell-slip", law)),
        Law::Lugre => Sliding::lugre(way, a.static_ratio, stribeck).map(|law| ("lugre", law)),
    }
    .map_err(|invalid| Error::new("--law", "", invalid.to_string()))?;
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
