//! `pigtail align --map`: search and peak on a measured power map.

use crate::choice::choice;
use crate::common::{Common, quantity, spaced, write_table};
use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use pigtail_hal::Error;
use pigtail_hal::digest::hash;
use pigtail_hal::quantity::{LENGTH, Sign};
use pigtail_model::frames::Displacement;
use pigtail_records::map::{Columns, MapDocument, Peak, PlaceUnit, PowerUnit, Trial, read, try_on};
use pigtail_report as report;
use pigtail_store::runs::Run;
use pigtail_store::samples::Samples;
use pigtail_sysid::map::{Reading, Scan};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Options of a measured map.
#[derive(Debug, Args)]
pub(crate) struct MapArguments {
    /// Try search and peak on a power map that you measured, in place of a machine: a file with a reading a row, in any
    /// order, or a matrix with columns along x and rows along y; how it is written is told from it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["procedure", "method", "scenario"])]
    map: Option<PathBuf>,
    /// Columns of the map: across, up, power; those called x, y and power or nearly so if not given
    #[arg(
        long,
        value_name = "X,Y,POWER",
        requires = "map",
        value_delimiter = ',',
        num_args = 1
    )]
    map_columns: Option<Vec<String>>,
    /// Unit of its places: what their names or header say, else um, if not given
    #[arg(long, value_name = "UNIT", requires = "map", value_parser = choice::<PlaceUnit>())]
    map_length_unit: Option<PlaceUnit>,
    /// Unit of its power: what its name or header says, else V, if not given
    #[arg(long, value_name = "UNIT", requires = "map", value_parser = choice::<PowerUnit>())]
    map_power_unit: Option<PowerUnit>,
    /// Distance of a matrix's columns and rows in the unit of its places, such as 0.5 or 0.5,1; where its first line and
    /// column are not its places
    #[arg(long, value_name = "STEP", requires = "map", value_parser = steps)]
    map_step: Option<[f64; 2]>,
    /// Less power in it is more light: a photodiode of negative voltage
    #[arg(long, requires = "map")]
    map_inverted: bool,
    /// Each power is of its row's place: the stage stood still for it, and the detector had settled. Light that trails along
    /// the way is then its own shape; without this such a map is refused
    #[arg(long, requires = "map")]
    map_settled: bool,
    /// Where the search begins, such as "5 um,-3 um"; the map's middle where not given
    #[arg(long, value_name = "X,Y", requires = "map", value_parser = place)]
    map_start: Option<Displacement>,
    /// How well the peak's place is to be known (a standard deviation), such as "0.1 um"; a fiftieth
    /// of its radius where not given
    #[arg(long, value_name = "LENGTH", requires = "map", value_parser = quantity(LENGTH))]
    map_accuracy: Option<f64>,
}

fn steps(text: &str) -> Result<[f64; 2], String> {
    let step = |text: &str| {
        text.trim()
            .parse::<f64>()
            .ok()
            .filter(|v| *v > 0.0 && v.is_finite())
    };
    let (x, y) = text.split_once(',').unwrap_or((text, text));
    step(x).zip(step(y)).map(|(x, y)| [x, y]).ok_or_else(|| {
        format!("\"{text}\" is no distance; accepted are one or two numbers above zero, such as 0.5 or 0.5,1")
    })
}

fn place(text: &str) -> Result<Displacement, String> {
    let Some((x, y)) = text.split_once(',') else {
        return Err(format!(
            "\"{text}\" is no place; accepted are two lengths, such as \"5 um,-3 um\""
        ));
    };
    let parse = |text| LENGTH.parse(&spaced(text), Sign::Any);
    Ok(Displacement::new(parse(x)?, parse(y)?))
}

impl MapArguments {
    /// The map, if there is one.
    pub(crate) fn map(&self) -> Option<&Path> {
        self.map.as_deref()
    }
}

/// Tries search and peak on a map.
pub(crate) fn run(map: &Path, arguments: &MapArguments, common: &Common) -> Result<u8, Failure> {
    let names = arguments
        .map_columns
        .clone()
        .map(|names| {
            <[String; 3]>::try_from(names).map_err(|names| {
                let message = format!(
                    "{} names {} columns; accepted are three: across, up and power, such as x,y,power",
                    names.join(","),
                    names.len()
                );
                Error::new("--map-columns", "", message)
            })
        })
        .transpose()?;
    let columns = Columns {
        names,
        place: arguments.map_length_unit,
        power: arguments.map_power_unit,
        inverted: arguments.map_inverted,
        step: arguments.map_step,
        settled: arguments.map_settled,
    };
    let measured = read(map, &columns)?;
    let scan = &measured.scan;
    if measured.place_unit != "um"
        && (arguments.map_start.is_some() || arguments.map_accuracy.is_some())
    {
        let message = "the map's places are in volts of a piezo; accepted are lengths for a map of lengths alone";
        return Err(Error::new("--map-start, --map-accuracy", "", message).into());
    }
    let file = map.display().to_string();
    if arguments.map_start.is_some_and(|at| !scan.contains(at)) {
        let (low, high) = (scan.middle() - scan.half(), scan.middle() + scan.half());
        let message = format!(
            "lies outside of the map; accepted is x from {:.3} to {:.3} um, y from {:.3} to {:.3} um",
            low.x * 1e6,
            high.x * 1e6,
            low.y * 1e6,
            high.y * 1e6
        );
        return Err(Error::new("--map-start", "", message).into());
    }
    let mut trial = try_on(
        &file,
        &measured,
        arguments.map_start,
        arguments.map_accuracy,
    );
    let content = fs::read(map).map_err(anyhow::Error::from)?;
    let run = Run::begin(
        &common.runs,
        "align map",
        common.seed,
        &[(file, hash(content))],
    )?;
    trial.document.report = run.path("report.html").display().to_string();
    run.write_json("summary.json", &trial.document.json())?;
    run.write("report.html", report::scan(scan, &trial)?)?;
    samples(scan, &trial, measured.place_unit, trial.document.power_unit).keep(&run)?;
    run.finish(trial.document.outcome)?;
    let document = &trial.document;
    let mut text = Vec::new();
    if common.json {
        serde_json::to_writer(&mut text, &document.json()).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        print_table(&mut text, document).map_err(anyhow::Error::from)?;
    }
    crate::print(&text)?;
    Ok(if document.outcome == "aligned" {
        DONE
    } else {
        NEGATIVE
    })
}

/// The map as it was read, and the readings that the search took of it, in order.
fn samples(scan: &Scan, trial: &Trial, place: &str, power: &str) -> Samples {
    let taken = trial.looked.iter().flat_map(|looked| &looked.taken);
    let taken: Vec<Reading> = taken.map(|k| scan.readings()[*k]).collect();
    let columns = |all: Samples, of: &str, about: &str, readings: &[Reading]| {
        let column = |value: fn(&Reading) -> f64| readings.iter().map(value).collect();
        all.with(&format!("{of}_x_{place}"), about, column(|r| 1e6 * r.at.x))
            .with(&format!("{of}_y_{place}"), about, column(|r| 1e6 * r.at.y))
            .with(&format!("{of}_power_{power}"), about, column(|r| r.power))
    };
    let all = columns(Samples::default(), "map", "as it was read", scan.readings());
    columns(all, "taken", "by the search, in order", &taken)
}

/// A text that begins as a sentence does.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

fn print_table(out: &mut impl Write, document: &MapDocument) -> io::Result<()> {
    let unit = document.power_unit;
    let place = document.place_unit;
    writeln!(out, "Read: {}", document.read)?;
    let header = [
        "by".to_owned(),
        "readings".to_owned(),
        format!("x\n{place}"),
        format!("y\n{place}"),
        format!("known to\n{place}"),
        format!("width x\n{place}"),
        format!("width y\n{place}"),
        format!("power\n{unit}"),
        format!("dark\n{unit}"),
    ];
    let row = |name: &str, readings: usize, peak: &Peak| {
        vec![
            name.to_owned(),
            readings.to_string(),
            format!("{:.3}", peak.x_um),
            format!("{:.3}", peak.y_um),
            format!("{:.3}", peak.deviation_um),
            format!("{:.3}", peak.widths_um.x),
            format!("{:.3}", peak.widths_um.y),
            peak.power.to_string(),
            peak.background.to_string(),
        ]
    };
    let mut rows = vec![header.to_vec()];
    if let Some(peak) = &document.peak {
        rows.push(row("search", document.readings_used, peak));
    }
    if let Some(peak) = &document.whole_map {
        rows.push(row("whole map", document.readings, peak));
    }
    if rows.len() > 1 {
        write_table(out, &rows)?;
        writeln!(out)?;
    }
    if !document.detail.is_empty() {
        writeln!(out, "{}.", sentence(&document.detail))?;
    }
    if let (Some(light), Some(_)) = (document.readings_to_first_light, &document.peak) {
        writeln!(
            out,
            "Light after {light} readings, the peak after {}, of the map's {}. Widths are full ones \
             at half height.",
            document.readings_used, document.readings
        )?;
    }
    for note in pigtail_report::scan_notes(document) {
        writeln!(out, "{note}")?;
    }
    writeln!(out, "Report: {}", document.report)
}
