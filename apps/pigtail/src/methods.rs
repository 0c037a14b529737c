//! `pigtail align --method`: a search for first light alone.

use crate::choice::choice;
use crate::common::{Common, quantity, write_table};
use crate::progress::Searching;
use crate::running;
use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use pigtail_control::methods::Space;
use pigtail_evaluate::methods::{Method, SearchDocument, check, run as search};
use pigtail_hal::quantity::{FREQUENCY, LENGTH};
use pigtail_session::calibrations::Part;
use pigtail_session::setup::Setup;
use std::io::{self, Write};

/// Options of a search for first light.
#[derive(Debug, Args)]
pub(crate) struct MethodArguments {
    /// Only search first light, by one of the thesis's three methods, over the whole area: its
    /// closed form beside the machine time it really takes. Writes no run
    #[arg(long, value_parser = choice::<Method>(), conflicts_with = "procedure")]
    method: Option<Method>,
    /// Grid spacing of the method, such as "10 um"; the recipe's where not given
    #[arg(long, requires = "method", value_parser = quantity(LENGTH))]
    mesh: Option<f64>,
    /// Sweeps a second of the method, such as "16 Hz"; the recipe's, or 100 Hz in method 2
    #[arg(long, requires = "method", value_parser = quantity(FREQUENCY))]
    scan_rate: Option<f64>,
}

impl MethodArguments {
    /// The method that was asked for, if one was.
    pub(crate) fn method(&self) -> Option<Method> {
        self.method
    }
}

/// Runs a method on the twin of the seed.
pub(crate) fn run(
    method: Method,
    arguments: &MethodArguments,
    common: &Common,
    setup: &Setup,
) -> Result<u8, Failure> {
    let mut space = Space::new(method.into(), &setup.rig.recipe);
    space.mesh = arguments.mesh.unwrap_or(space.mesh);
    space.frequency = arguments.scan_rate.unwrap_or(space.frequency);
    check(setup, &space)?;
    running::warn(setup, Part::ALIGNMENT);
    let document =
        search(setup, &space, common.seed, &mut Searching::new()).map_err(Failure::from)?;
    let mut text = Vec::new();
    if common.json {
        let on = running::on(setup, &document, None);
        serde_json::to_writer(&mut text, &on).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        print_table(&mut text, &document).map_err(anyhow::Error::from)?;
        text.extend(running::line(setup).bytes());
    }
    crate::print(&text)?;
    Ok(if document.found { DONE } else { NEGATIVE })
}

/// Seconds as a person reads them: `4.2 min` from two minutes on.
pub(crate) fn duration(seconds: f64) -> String {
    if seconds >= 120.0 {
        format!("{:.1} min", seconds / 60.0)
    } else {
        format!("{seconds:.1} s")
    }
}

/// The same, or a dash.
pub(crate) fn duration_or_dash(seconds: Option<f64>) -> String {
    seconds.map_or_else(|| "-".to_owned(), duration)
}

fn print_table(out: &mut impl Write, document: &SearchDocument) -> io::Result<()> {
    let header = [
        "method",
        "mesh\num",
        "scan\nHz",
        "by scan\nrate",
        "by photo-\ndiode",
        "measured",
        "found\nafter",
        "samples",
    ];
    let row = [
        document.method.to_owned(),
        document.mesh_um.to_string(),
        document.scan_hz.to_string(),
        duration(document.closed_form_seconds),
        duration(document.photodiode_limited_seconds),
        duration_or_dash(document.measured_seconds),
        duration_or_dash(document.found_seconds),
        document.samples.to_string(),
    ];
    write_table(out, &[header.map(str::to_owned).to_vec(), row.to_vec()])?;
    writeln!(out)?;
    match (&document.found_at, document.brightest_v) {
        (Some(at), _) => {
            let [x, y] = at.input_um;
            write!(
                out,
                "{:.3} V of light, the input fiber {x:.1} um across and {y:.1} um up from where \
                 it was looked for",
                at.level_v
            )?;
            if let Some([x, y]) = at.output_um {
                write!(out, ", the output fiber {x:.1} um and {y:.1} um")?;
            }
            writeln!(out, ".")?;
        }
        (None, Some(brightest)) => writeln!(
            out,
            "No light: the brightest was {brightest:.4} V; {} bright places did not bear a second \
             look.",
            document.dismissed
        )?,
        (None, None) => writeln!(out, "No search: {}.", document.detail)?,
    }
    writeln!(
        out,
        "The whole area is covered, {:.0} um x {:.0} um a fiber, on the twin of seed {}; simulated \
         in {:.1} s.",
        document.area_um[0], document.area_um[1], document.seed, document.wall_seconds
    )
}
