//! Search and peak on a power map that a person brings, and the document that tells what came of
//! it.

mod file;

pub use file::read;

use crate::columns::unit_of;
use pigtail_hal::quantity::{LENGTH, VOLTAGE};
use pigtail_model::frames::Displacement;
use pigtail_numerics::rounded;
use pigtail_sysid::map::{Examined, Look, Looked, Refusal, Scan, Shape, examine, look as take};
use serde::Serialize;
use std::ops;

/// The columns of a map and their units.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// Names of the columns of x, y and power; the usual ones where none were given.
    pub names: Option<[String; 3]>,
    /// Of x and y; what their names or headers say, else micrometres, if none.
    pub place: Option<PlaceUnit>,
    /// Of power; what its name or header says, else volts, if none.
    pub power: Option<PowerUnit>,
    /// Whether less power in the file is more light.
    pub inverted: bool,
    /// Distance of columns and rows, in `place` units, of a map that is a matrix without its places.
    pub step: Option<[f64; 2]>,
    /// Whether each power is known to be of its row's place: light that trails along the way is then its own shape.
    pub settled: bool,
}

/// A unit of places: a length, or the voltage of a piezo.
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
pub enum PlaceUnit {
    /// Nanometres
    Nm,
    /// Micrometres
    Um,
    /// Millimetres
    Mm,
    /// Metres
    M,
    /// Volts of a piezo: nothing is then known in micrometres, and places, widths and deviations are in volts
    #[strum(serialize = "V")]
    V,
}

impl PlaceUnit {
    /// What one is within: metres, where a volt is taken for a micrometre.
    fn size(self) -> f64 {
        match self {
            Self::V => 1e-6,
            length => LENGTH.unit(length.into()).map_or(1.0, |(_, metres)| metres),
        }
    }

    /// The unit in which places are told: micrometres, or volts.
    fn told(self) -> &'static str {
        match self {
            Self::V => "V",
            _ => "um",
        }
    }
}

/// A map that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Its readings; a volt of a piezo is a micrometre here.
    pub scan: Scan,
    /// `um` or `V`: what a micrometre of the scan is.
    pub place_unit: &'static str,
    /// Whether an option said what its places are in.
    pub said: bool,
    /// Of power, in the file.
    pub power: PowerUnit,
    /// How the file was read, in words.
    pub understood: String,
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
    /// Milliamperes of a photodiode
    #[strum(serialize = "mA")]
    MilliA,
    /// Microamperes of one
    #[strum(serialize = "uA")]
    MicroA,
    /// Nanoamperes of one
    #[strum(serialize = "nA")]
    NanoA,
    /// Decibels above a milliwatt; taken as milliwatts
    #[strum(serialize = "dBm")]
    DBm,
    /// Decibels above any other power, such as a loss below zero; taken as shares of that power
    #[strum(serialize = "dB")]
    DB,
}

impl PowerUnit {
    /// The unit of that name, as files write it.
    fn named(name: &str) -> Option<Self> {
        let name = name.replace(['\u{b5}', '\u{3bc}'], "u");
        if let Some((VOLTAGE, unit)) = unit_of(&[VOLTAGE], &name) {
            return unit.parse().ok();
        }
        let level = [("dbm", Self::DBm), ("db", Self::DB)];
        let level = level.iter().find(|(l, _)| name.eq_ignore_ascii_case(l));
        name.parse().ok().or(level.map(|(_, unit)| *unit))
    }

    /// Whether it is a level: a logarithm of the light.
    fn is_level(self) -> bool {
        matches!(self, Self::DBm | Self::DB)
    }

    /// A reading on a linear scale.
    fn linear(self, value: f64) -> f64 {
        if self.is_level() {
            10.0_f64.powf(0.1 * value)
        } else {
            value
        }
    }

    /// The unit of that scale.
    pub fn linear_name(self) -> &'static str {
        match self {
            Self::DBm => Self::MilliW.into(),
            Self::DB => "1",
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
    /// How well the place by all readings would be known if nothing had changed while they were taken, micrometres. What is said of a peak
    /// allows for light that changes by a quarter over the scan, unseen, and for what is seen:
    pub deviation_by_readings_um: Option<f64>,
    /// By how much the light of rows differs beside that of columns or the other way round, rms, percent of the peak; `null`
    /// without a peak...
    pub unsteady_light_percent: Option<f64>,
    /// ...and how far aside of each other they are, rms, micrometres.
    pub unsteady_aside_um: Option<f64>,
    /// How far a part of the scan, in the order in which it was taken, puts the peak from all of it, micrometres, where that part is told far
    /// better by a background, a height and a place of its own, as of a stage that slipped or a level that stepped; zero where none is.
    pub unsteady_parts_um: Option<f64>,
    /// By how much the peak would be elsewhere for powers that are a reading late, where all lines go one way and none would show,
    /// micrometres: nothing that is said allows for it. Zero where the way turns; `null` without a peak.
    pub a_reading_late_um: Option<f64>,
    /// Standard deviation of a reading from that peak, in `power_unit`.
    pub noise: Option<f64>,
    /// Distance of neighbours, micrometres.
    pub spacing_um: f64,
    /// Unit of powers here: linear.
    pub power_unit: &'static str,
    /// Unit of places: `um`, or `V` of a piezo. Where it is `V` the keys that end in `_um` end in `_V`.
    pub place_unit: &'static str,
    /// How the file was read, in words.
    pub read: String,
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
    /// Standard deviation of the place in the worse direction, micrometres, with what may have changed while it was scanned; of the peak by the readings used no less
    /// than its distance from the one by all readings.
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

impl MapDocument {
    /// As JSON; keys by the unit of places.
    pub fn json(&self) -> serde_json::Value {
        let mut value = serde_json::to_value(self).unwrap_or_default();
        if self.place_unit != "um" {
            rename(&mut value, self.place_unit);
        }
        value
    }
}

/// Keys that say micrometres say another unit.
fn rename(value: &mut serde_json::Value, unit: &str) {
    if let serde_json::Value::Object(map) = value {
        let old = std::mem::take(map);
        for (key, mut value) in old {
            rename(&mut value, unit);
            let key = match key.strip_suffix("_um") {
                Some(bare) => format!("{bare}_{unit}"),
                None => key,
            };
            map.insert(key, value);
        }
    }
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
pub fn try_on(map: &str, read: &Map, start: Option<Displacement>, accuracy: Option<f64>) -> Trial {
    let scan = &read.scan;
    let examined = examine(scan);
    let how = Look {
        start: start.unwrap_or_else(|| scan.middle()),
        accuracy,
    };
    let looked = examined.as_ref().ok().map(|all| take(scan, all, &how));
    let (outcome, detail) = match (&examined, &looked) {
        (Ok(all), Some(looked)) => {
            if let Some(detail) = other_unit(read, &all.peak) {
                ("unsure", detail)
            } else {
                let (outcome, detail) = verdict(all, looked, accuracy);
                (outcome, in_unit(detail, read.place_unit))
            }
        }
        (Err(refusal), _) => (
            refusal.name(),
            in_unit(refusal.to_string(), read.place_unit),
        ),
        (Ok(_), None) => ("not_found", String::new()),
    };
    let all = examined.as_ref().ok();
    // The search's readings alone may be surer than they are right, and all readings tell by how much: its deviation is
    // no less than the distance to where they say the peak is.
    let peak = |looked: &Looked| {
        looked.peak.map(|shape| {
            let off = all.map_or(0.0, |all| (shape.at - all.peak.at).norm());
            let own = looked.deviation.max(all.map_or(0.0, Examined::known));
            Peak::of(&shape, own.max(off))
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
        whole_map: all.map(|all| Peak::of(&all.peak, all.known())),
        fold: all.map(|all| all.fold.name()),
        fold_level: all.and_then(|all| all.fold.level()).map(digits),
        folded_readings: all.map_or(0, |all| all.folded),
        readings_apart: all.map_or(0, |all| all.apart),
        explained_percent: all.map(|all| rounded(100.0 * all.explained, 0.01)),
        only_noise_left: all.map(|all| all.only_noise_left),
        deviation_by_readings_um: all.map(|all| digits(all.deviation * 1e6)),
        unsteady_light_percent: all.map(|all| rounded(100.0 * all.unsteady.light, 0.01)),
        unsteady_aside_um: all.map(|all| digits(all.unsteady.aside * 1e6)),
        unsteady_parts_um: all.map(|all| digits(all.unsteady.parts * 1e6)),
        a_reading_late_um: all.map(|all| digits(all.late * 1e6)),
        noise: all.map(|all| digits(all.noise)),
        spacing_um: rounded(scan.spacing() * 1e6, 1e-4),
        power_unit: read.power.linear_name(),
        place_unit: read.place_unit,
        read: read.understood.clone(),
        report: String::new(),
    };
    Trial {
        document,
        examined,
        looked,
    }
}

/// A sentence about places, in the map's unit of them.
fn in_unit(text: String, unit: &str) -> String {
    if unit == "um" {
        text
    } else {
        text.replace(" um", &format!(" {unit}"))
    }
}

/// A search's peak is known to this share of its short radius at least.
const KNOWN: f64 = 0.3;

/// Radii of a peak of light, metres: no wave that a fiber guides can be focused to less than the first, and wider than the second
/// are free beams alone.
const RADII: ops::Range<f64> = 1e-7..1e-3;

/// Why places are in another unit than they were read in, where nobody said that one on purpose.
fn other_unit(read: &Map, peak: &Shape) -> Option<String> {
    let (long, short, _) = peak.ellipse();
    let lengths = read.place_unit == PlaceUnit::Um.told();
    if !lengths || read.said || (RADII.contains(&short) && RADII.contains(&long)) {
        return None;
    }
    Some(format!(
        "the peak would be {:.3e} by {:.3e} um in radius, which is light of no fiber: are places in another unit than they were \
         read in? --map-length-unit says in which they are, that one too",
        long * 1e6,
        short * 1e6
    ))
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
    if looked.deviation.is_nan() || looked.deviation > KNOWN * short {
        return (
            "unsure",
            format!(
                "the search's readings tell the peak's place to {:.3} um only, of a peak of {:.3} um in radius",
                looked.deviation * 1e6,
                short * 1e6
            ),
        );
    }
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
