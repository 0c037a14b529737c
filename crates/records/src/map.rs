//! Search and peak on a power map that a person brings, and the document that tells what came of
//! it.

use crate::columns::{Gaps, Table, unit_of};
use pigtail_hal::Error;
use pigtail_hal::quantity::{LENGTH, VOLTAGE};
use pigtail_model::frames::Displacement;
use pigtail_numerics::rounded;
use pigtail_sysid::map::{
    Examined, Look, Looked, Reading, Refusal, Scan, Shape, examine, look as take,
};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;

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
    /// Decibels above a milliwatt; taken as milliwatts
    #[strum(serialize = "dBm")]
    DBm,
}

impl PowerUnit {
    /// The unit of that name, as files write it.
    fn named(name: &str) -> Option<Self> {
        let name = name.replace(['\u{b5}', '\u{3bc}'], "u");
        if let Some((VOLTAGE, unit)) = unit_of(&[VOLTAGE], &name) {
            return unit.parse().ok();
        }
        name.parse()
            .ok()
            .or_else(|| name.eq_ignore_ascii_case("dbm").then_some(Self::DBm))
    }

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
    /// How well the place by all readings would be known if nothing had changed while they were taken, micrometres. What is said of a peak
    /// allows for light that changes by a quarter over the scan, unseen, and for what is seen:
    pub deviation_by_readings_um: Option<f64>,
    /// By how much the light of rows differs beside that of columns or the other way round, rms, percent of the peak; `null`
    /// without a peak...
    pub unsteady_light_percent: Option<f64>,
    /// ...and how far aside of each other they are, rms, micrometres.
    pub unsteady_aside_um: Option<f64>,
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

/// Names of x, y and power where none were given: whole ones, or without their units.
const NAMES: [&[&str]; 3] = [
    &[
        "x", "dx", "px", "x pos", "posx", "pos_x", "xpos", "vx", "ux",
    ],
    &[
        "y", "dy", "py", "y pos", "posy", "pos_y", "ypos", "vy", "uy",
    ],
    &[
        "power",
        "p",
        "signal",
        "light",
        "intensity",
        "photodiode",
        "pd",
        "coupling",
        "reading",
    ],
];

/// Which column serves as x (0), y (1) or power (2).
fn usual(table: &Table, role: usize) -> Option<usize> {
    let names = table.names();
    let bare = |k: &usize| {
        let low = names[*k].to_lowercase();
        let cut = low
            .split(['[', '('])
            .next()
            .unwrap_or_default()
            .trim()
            .to_owned();
        let unit = table.unit_text(*k).map(str::to_lowercase);
        let without = unit.and_then(|u| cut.strip_suffix(&format!("_{u}")).map(str::to_owned));
        NAMES[role].contains(&&*cut) || without.is_some_and(|w| NAMES[role].contains(&&*w))
    };
    let exact = ["x", "y", "power"][role];
    names
        .iter()
        .position(|n| n == exact)
        .or_else(|| (0..names.len()).find(bare))
}

impl Columns {
    /// The places of x, y and power in a file; `None` where it has no such columns, and none were asked for.
    fn places(&self, table: &Table) -> Result<Option<[usize; 3]>, Error> {
        let Some([x, y, power]) = &self.names else {
            let found: Vec<usize> = (0..3).filter_map(|role| usual(table, role)).collect();
            return Ok(<[usize; 3]>::try_from(found)
                .ok()
                .filter(|[x, y, p]| x != y && y != p && x != p));
        };
        for (a, b) in [(x, y), (x, power), (y, power)] {
            if a == b {
                let message = "is named twice; accepted are three columns: x, y and power";
                return Err(table.error(a.as_str(), message));
            }
        }
        Ok(Some([
            table.place(x)?,
            table.place(y)?,
            table.place(power)?,
        ]))
    }

    /// The unit of places by option, else by the columns' own words.
    fn place_unit(&self, table: &Table, places: [usize; 2]) -> Result<PlaceUnit, Error> {
        let own = |place: usize| -> Result<Option<PlaceUnit>, Error> {
            let Some(unit) = table.unit(place) else {
                return Ok(None);
            };
            unit.parse().map(Some).map_err(|_| {
                let message = format!(
                    "its name says {unit}; accepted are places in nm, um, mm, m, or V of a piezo"
                );
                table.error(&*table.names()[place], message)
            })
        };
        let (x, y) = (own(places[0])?, own(places[1])?);
        let name = |k: usize| table.names()[places[k]].clone();
        if let (Some(a), Some(b)) = (x, y)
            && a != b
        {
            let message = format!(
                "is in {}, {} in {}; accepted are both in one unit",
                <&str>::from(b),
                name(0),
                <&str>::from(a)
            );
            return Err(table.error(name(1), message));
        }
        let own = x.or(y);
        if let (Some(given), Some(own)) = (self.place, own)
            && given != own
        {
            let message = format!(
                "is said to be in {} by --map-length-unit, but its name or header says {}; accepted is one of both",
                <&str>::from(given),
                <&str>::from(own)
            );
            return Err(table.error(name(usize::from(x.is_none())), message));
        }
        Ok(self.place.or(own).unwrap_or(PlaceUnit::Um))
    }

    /// The unit of power by option, else by the column's own words.
    fn power_unit(&self, table: &Table, place: usize) -> Result<PowerUnit, Error> {
        let own = table.unit_text(place).and_then(PowerUnit::named);
        if let (Some(given), Some(own)) = (self.power, own)
            && given != own
        {
            let message = format!(
                "is said to be in {} by --map-power-unit, but its name or header says {}; accepted is one of both",
                <&str>::from(given),
                <&str>::from(own)
            );
            return Err(table.error(&*table.names()[place], message));
        }
        Ok(self.power.or(own).unwrap_or(PowerUnit::V))
    }
}

/// A map's readings as a file has them.
struct Raw {
    x: Vec<f64>,
    y: Vec<f64>,
    power: Vec<f64>,
    place: PlaceUnit,
    unit: PowerUnit,
    /// What errors call the three.
    names: [String; 3],
    understood: String,
}

/// Evenly spaced, rising or falling.
fn is_axis(values: &[f64]) -> bool {
    let steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
    let Some(first) = steps.first() else {
        return false;
    };
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    mean != 0.0 && first.is_finite() && steps.iter().all(|s| (s / mean - 1.0).abs() < 0.05)
}

/// A map that is a matrix: columns along x, rows along y, with its places in the first line and column or without.
fn matrix(table: &Table, columns: &Columns) -> Result<Option<Raw>, Error> {
    if columns.names.is_some() {
        return Ok(None);
    }
    let Some(mut rows) = table.grid()? else {
        return Ok(None);
    };
    let width = rows.first().map_or(0, Vec::len);
    if rows.len() < 3 || width < 4 {
        return Ok(None);
    }
    let first_column: Vec<f64> = rows.iter().skip(1).map(|r| r[0]).collect();
    let placed = is_axis(&rows[0][1..]) && is_axis(&first_column);
    let place = columns.place.unwrap_or(PlaceUnit::Um);
    let (xs, ys): (Vec<f64>, Vec<f64>) = if placed {
        if columns.step.is_some() {
            let message =
                "has places in its first line and column; accepted is no --map-step beside them";
            return Err(table.error("", message));
        }
        let xs = rows[0][1..].to_vec();
        rows.remove(0);
        for row in &mut rows {
            row.remove(0);
        }
        (xs, first_column)
    } else if let Some([dx, dy]) = columns.step {
        let along = |n: usize, step: f64| (0..n).map(|k| k as f64 * step).collect();
        (along(width, dx), along(rows.len(), dy))
    } else {
        let message = format!(
            "is a matrix of {} by {width} numbers without places; accepted is --map-step, the distance of its columns \
             and rows, or places in its first line and first column; of another file --map-columns",
            rows.len()
        );
        return Err(table.error("", message));
    };
    let mut raw = Raw {
        x: Vec::new(),
        y: Vec::new(),
        power: Vec::new(),
        place,
        unit: columns.power.unwrap_or(PowerUnit::V),
        names: ["columns".to_owned(), "rows".to_owned(), "matrix".to_owned()],
        understood: format!(
            "{}; a matrix of {} rows along y and {} columns along x, {}, in {}; power in {}",
            table.understood(),
            ys.len(),
            xs.len(),
            if placed {
                "with its places"
            } else {
                "places by --map-step"
            },
            <&str>::from(place),
            <&str>::from(columns.power.unwrap_or(PowerUnit::V)),
        ),
    };
    for (row, y) in rows.iter().zip(&ys) {
        for (power, x) in row.iter().zip(&xs) {
            raw.x.push(*x);
            raw.y.push(*y);
            raw.power.push(*power);
        }
    }
    Ok(Some(raw))
}

fn listed(table: &Table, columns: &Columns, places: [usize; 3]) -> Result<Raw, Error> {
    if columns.step.is_some() {
        let message = "has columns of places; accepted is --map-step for a matrix alone";
        return Err(table.error("", message));
    }
    let place = columns.place_unit(table, [places[0], places[1]])?;
    let unit = columns.power_unit(table, places[2])?;
    let mut read = table.numbers(&places, Gaps::Allowed)?.columns;
    let names = places.map(|p| table.names()[p].clone());
    let understood = format!(
        "{}; x is {} and y is {} in {}; power is {} in {}",
        table.understood(),
        names[0],
        names[1],
        <&str>::from(place),
        names[2],
        <&str>::from(unit)
    );
    let power = read.pop().unwrap_or_default();
    let y = read.pop().unwrap_or_default();
    let x = read.pop().unwrap_or_default();
    Ok(Raw {
        x,
        y,
        power,
        place,
        unit,
        names,
        understood,
    })
}

/// Reads a map: a reading a row, or a matrix.
///
/// # Errors
///
/// When the file cannot be read, a column is missing or has a field that is no number, or nothing
/// could be made of the readings.
pub fn read(path: &Path, columns: &Columns) -> Result<Map, Error> {
    let table = Table::open(path)?;
    let mut raw = match columns.places(&table)? {
        Some(places) => listed(&table, columns, places)?,
        None => {
            if let Some(raw) = matrix(&table, columns)? {
                raw
            } else {
                // Which one is missing, in the table's own words.
                let missing = (0..3)
                    .find(|role| usual(&table, *role).is_none())
                    .unwrap_or(2);
                let name = ["x", "y", "power"][missing];
                table.place(name)?;
                return Err(table.error(name, "is no column of its own; accepted is --map-columns"));
            }
        }
    };
    // A reading that is not there is none.
    let whole: Vec<bool> = (0..raw.x.len())
        .map(|k| raw.x[k].is_finite() && raw.y[k].is_finite() && raw.power[k].is_finite())
        .collect();
    let missing = whole.iter().filter(|w| !**w).count();
    for column in [&mut raw.x, &mut raw.y, &mut raw.power] {
        let mut whole = whole.iter();
        column.retain(|_| whole.next().copied().unwrap_or(true));
    }
    if missing > 0 {
        let _ = write!(
            raw.understood,
            "; {missing} readings without a value left out"
        );
    }
    let [x, y, power] = &raw.names;
    if raw.unit != PowerUnit::DBm
        && !columns.inverted
        && !raw.power.is_empty()
        && raw.power.iter().all(|p| *p < 0.0)
    {
        let message = format!(
            "is below zero throughout; accepted is power in {}: levels in decibels want \
             --map-power-unit dBm, a photodiode of negative voltage --map-inverted",
            raw.unit.linear_name()
        );
        return Err(table.error(power.as_str(), message));
    }
    let metres = raw.place.size();
    let sign = if columns.inverted { -1.0 } else { 1.0 };
    let readings = raw
        .x
        .iter()
        .zip(&raw.y)
        .zip(&raw.power)
        .map(|((x, y), p)| Reading {
            at: Displacement::new(metres * x, metres * y),
            power: sign * raw.unit.linear(*p),
        });
    let scan = Scan::new(readings.collect()).map_err(|invalid| {
        let key = match invalid.what {
            "x" => x.as_str(),
            "y" => y.as_str(),
            "power" => power.as_str(),
            _ => "",
        };
        table.error(key, invalid.why)
    })?;
    Ok(Map {
        scan,
        place_unit: raw.place.told(),
        power: raw.unit,
        understood: raw.understood,
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
            let (outcome, detail) = verdict(all, looked, accuracy);
            (outcome, in_unit(detail, read.place_unit))
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
