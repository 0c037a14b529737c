//! Search and peak on a power map that a person brings, and the document that tells what came of
//! it.

use crate::columns::{Gaps, LengthUnit, Table};
use pigtail_hal::Error;
use pigtail_model::frames::Displacement;
use pigtail_numerics::rounded;
use pigtail_sysid::map::{
    Examined, Look, Looked, Reading, Refusal, Scan, Shape, examine, look as take,
};
use serde::Serialize;
use std::path::Path;

/// The columns of a map and their units.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Columns {
    /// Names of the columns of x, y and power.
    pub names: [String; 3],
    /// Of x and y.
    pub length: LengthUnit,
    /// Of power.
    pub power: PowerUnit,
    /// Whether less power in the file is more light.
    pub inverted: bool,
}

/// A unit of light: one that is linear, or a level.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
pub enum PowerUnit {
    /// Volts of a photodiode
    #[strum(serialize = "V")]
    V,
    /// Millivolts of one
    #[strum(serialize = "mV")]
    MilliV,
    /// Watts
    #[strum(serialize = "W")]
    W,
    /// Milliwatts
    #[strum(serialize = "mW")]
    MilliW,
    /// Microwatts
    #[strum(serialize = "uW")]
    MicroW,
    /// Nanowatts
    #[strum(serialize = "nW")]
    NanoW,
    /// Numbers of a converter
    #[strum(serialize = "counts")]
    Counts,
    /// Decibels above a milliwatt; taken as milliwatts
    #[strum(serialize = "dBm")]
    DBm,
}

impl PowerUnit {
    /// A reading on a linear scale.
    fn linear(self, value: f64) -> f64 {
        if self == Self::DBm {
            10.0_f64.powf(0.1 * value)
        } else {
            value
        }
    }

    /// The unit of that scale.
    pub fn linear_name(self) -> &'static str {
        match self {
            Self::DBm => Self::MilliW.into(),
            linear => linear.into(),
        }
    }
}

/// What `align --map` prints as JSON. Keys are a contract: more may come, none changes its name or
/// meaning.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapDocument {
    /// The file of the map.
    pub map: String,
    /// `aligned`; `side_peak` where the search ended on a lesser peak than the highest; `unsure`
    /// where the accuracy asked for was not reached, or a peak's place is not told; `not_found` where the search found none
    /// though there is one; `no_light`, `dark`, `no_single_peak`, `too_coarse`, `saturated` or `at_edge` where the map has
    /// no peak that could be told.
    pub outcome: &'static str,
    /// What that means here; empty where aligned.
    pub detail: String,
    /// Readings in the map: what a raster takes.
    pub readings: usize,
    /// Readings that the search and the peak took.
    pub readings_used: usize,
    /// Those of them until there was light; `null` where none was found.
    pub readings_to_first_light: Option<usize>,
    /// The peak by the readings used; `null` where none was found.
    pub peak: Option<Peak>,
    /// The peak by all readings; `null` where none could be told.
    pub whole_map: Option<Peak>,
    /// What the instrument did to the light: `plain`, `clipped`, `wrapped`, `mirrored_down` (what
    /// exceeds a level comes down again) or `mirrored_up` (a magnitude); `null` without a peak.
    pub fold: Option<&'static str>,
    /// The level or span of that, in `power_unit`.
    pub fold_level: Option<f64>,
    /// Readings that it changed.
    pub folded_readings: usize,
    /// Readings that stand apart from their neighbours as no light does; they are left out.
    pub readings_apart: usize,
    /// The share of the readings' variance that one peak explains, percent.
    pub explained_percent: Option<f64>,
    /// Whether that peak leaves nothing but noise. Where not, the light has another shape, or was
    /// folded in a way that was not recognised; `null` without a peak.
    pub only_noise_left: Option<bool>,
    /// Standard deviation of a reading from that peak, in `power_unit`.
    pub noise: Option<f64>,
    /// Distance of neighbours, micrometres.
    pub spacing_um: f64,
    /// Unit of powers here: linear.
    pub power_unit: &'static str,
    /// The report, relative to where the program ran.
    pub report: String,
}

/// A peak of a map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Peak {
    /// Across, micrometres in the map's own frame.
    pub x_um: f64,
    /// Up.
    pub y_um: f64,
    /// Standard deviation of the place in the worse direction, micrometres; of the peak by the readings used no less
    /// than its distance from the one by all readings, where that is more than the readings explain.
    pub deviation_um: f64,
    /// Power at the peak, the background included.
    pub power: f64,
    /// Power beside the light: there, were there no peak.
    pub background: f64,
    /// Full widths at half of the height along x and y through the peak.
    pub widths_um: Widths,
    /// Radii at 1/e of the height along x and y: the sigma of (4.1), and the mode's radius where
    /// like modes couple.
    pub radii_um: Widths,
    /// The ellipse at 1/e of the height.
    pub ellipse: Ellipse,
}

/// A width along each axis, micrometres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Widths {
    /// Across.
    pub x: f64,
    /// Up.
    pub y: f64,
}

/// An ellipse about a peak.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ellipse {
    /// The long radius, micrometres.
    pub long_um: f64,
    /// The short one.
    pub short_um: f64,
    /// The long one's angle from the x axis, -90 to 90 degrees.
    pub angle_deg: f64,
}

/// Six digits: no scan is known better, and files of other units keep theirs.
fn digits(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let unit = 10.0_f64.powi(value.abs().log10().floor() as i32 - 5);
    if unit < 1.0 {
        rounded(value, unit)
    } else {
        (value / unit).round() * unit
    }
}

impl Peak {
    fn of(shape: &Shape, deviation: f64) -> Self {
        let um = |metres: f64| rounded(metres * 1e6, 1e-4);
        let (rx, ry) = shape.radii();
        let (long, short, angle) = shape.ellipse();
        // exp(-(w/2r)^2) = 1/2.
        let full = 2.0 * std::f64::consts::LN_2.sqrt();
        Self {
            x_um: um(shape.at.x),
            y_um: um(shape.at.y),
            deviation_um: um(deviation),
            power: digits(shape.background + shape.height),
            background: digits(shape.background),
            widths_um: Widths {
                x: um(full * rx),
                y: um(full * ry),
            },
            radii_um: Widths {
                x: um(rx),
                y: um(ry),
            },
            ellipse: Ellipse {
                long_um: um(long),
                short_um: um(short),
                angle_deg: rounded(angle.to_degrees(), 0.1),
            },
        }
    }
}

/// Reads a map.
///
/// # Errors
///
/// When the file cannot be read, a column is missing or has a field that is no number, or nothing
/// could be made of the readings.
pub fn read(path: &Path, columns: &Columns) -> Result<Scan, Error> {
    let table = Table::open(path)?;
    let [x, y, power] = &columns.names;
    for (a, b) in [(x, y), (x, power), (y, power)] {
        if a == b {
            let message = "is named twice; accepted are three columns: x, y and power";
            return Err(table.error(a.as_str(), message));
        }
    }
    let places = [table.place(x)?, table.place(y)?, table.place(power)?];
    let mut read = table.numbers(&places, Gaps::Allowed)?.columns;
    // A reading that is not there is none.
    let whole: Vec<bool> = (0..read[0].len())
        .map(|k| read.iter().all(|column| column[k].is_finite()))
        .collect();
    for column in &mut read {
        let mut whole = whole.iter();
        column.retain(|_| whole.next().copied().unwrap_or(true));
    }
    let [xs, ys, powers] = [&read[0], &read[1], &read[2]];
    if columns.power != PowerUnit::DBm
        && !columns.inverted
        && !powers.is_empty()
        && powers.iter().all(|p| *p < 0.0)
    {
        let message = format!(
            "is below zero throughout; accepted is power in {}: levels in decibels want \
             --map-power-unit dBm, a photodiode of negative voltage --map-inverted",
            columns.power.linear_name()
        );
        return Err(table.error(power.as_str(), message));
    }
    let metres = columns.length.metres();
    let sign = if columns.inverted { -1.0 } else { 1.0 };
    let readings = xs.iter().zip(ys).zip(powers).map(|((x, y), p)| Reading {
        at: Displacement::new(metres * x, metres * y),
        power: sign * columns.power.linear(*p),
    });
    Scan::new(readings.collect()).map_err(|invalid| {
        let key = match invalid.what {
            "x" => x.as_str(),
            "y" => y.as_str(),
            "power" => power.as_str(),
            _ => "",
        };
        table.error(key, invalid.why)
    })
}

/// What was made of a map.
#[derive(Debug, Clone)]
pub struct Trial {
    /// What is printed.
    pub document: MapDocument,
    /// The whole map, where it has a peak.
    pub examined: Result<Examined, Refusal>,
    /// The search, where there was something to search for.
    pub looked: Option<Looked>,
}

/// Tries search and peak on a map. `start` is where the search begins, the middle where `None`.
pub fn try_on(
    map: &str,
    scan: &Scan,
    columns: &Columns,
    start: Option<Displacement>,
    accuracy: Option<f64>,
) -> Trial {
    let examined = examine(scan);
    let how = Look {
        start: start.unwrap_or_else(|| scan.middle()),
        accuracy,
    };
    let looked = examined.as_ref().ok().map(|all| take(scan, all, &how));
    let (outcome, detail) = match (&examined, &looked) {
        (Ok(all), Some(looked)) => verdict(all, looked, accuracy),
        (Err(refusal), _) => (refusal.name(), refusal.to_string()),
        (Ok(_), None) => ("not_found", String::new()),
    };
    let all = examined.as_ref().ok();
    // The search's readings alone may be surer than they are right: where all readings tell another place, its
    // deviation is no less than the distance.
    let peak = |looked: &Looked| {
        looked.peak.map(|shape| {
            let off = all.map_or(0.0, |all| (shape.at - all.peak.at).norm());
            let own = looked.deviation.max(all.map_or(0.0, |all| all.deviation));
            Peak::of(&shape, if off > 2.0 * own { off } else { own })
        })
    };
    let document = MapDocument {
        map: map.to_owned(),
        outcome,
        detail,
        readings: scan.readings().len(),
        readings_used: looked.as_ref().map_or(0, |l| l.taken.len()),
        readings_to_first_light: looked.as_ref().and_then(|l| l.first_light),
        peak: looked.as_ref().and_then(peak),
        whole_map: all.map(|all| Peak::of(&all.peak, all.deviation)),
        fold: all.map(|all| all.fold.name()),
        fold_level: all.and_then(|all| all.fold.level()).map(digits),
        folded_readings: all.map_or(0, |all| all.folded),
        readings_apart: all.map_or(0, |all| all.apart),
        explained_percent: all.map(|all| rounded(100.0 * all.explained, 0.01)),
        only_noise_left: all.map(|all| all.only_noise_left),
        noise: all.map(|all| digits(all.noise)),
        spacing_um: rounded(scan.spacing() * 1e6, 1e-4),
        power_unit: columns.power.linear_name(),
        report: String::new(),
    };
    Trial {
        document,
        examined,
        looked,
    }
}

/// How the search went, beside what the whole map says.
fn verdict(all: &Examined, looked: &Looked, accuracy: Option<f64>) -> (&'static str, String) {
    let Some(found) = looked.peak else {
        let n = looked.taken.len();
        return (
            "not_found",
            format!("{n} readings, one by one from the start outward, did not come to tell a peak"),
        );
    };
    let off = (found.at - all.peak.at).norm();
    let (_, short, _) = all.peak.ellipse();
    if off > 0.25 * short && off > 4.0 * looked.deviation.hypot(all.deviation) {
        return (
            "side_peak",
            format!(
                "the search ended {:.3} um from the highest peak, at {:.0} % of its height",
                off * 1e6,
                100.0 * found.height / all.peak.height
            ),
        );
    }
    match accuracy {
        Some(asked) if !looked.reached => (
            "unsure",
            format!(
                "the peak's place is known to {:.4} um, where {:.4} um were asked for; no reading \
                 is left that tells more",
                looked.deviation * 1e6,
                asked * 1e6
            ),
        ),
        _ => ("aligned", String::new()),
    }
}
