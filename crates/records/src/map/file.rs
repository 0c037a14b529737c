//! A map as it stands in a file: places and powers in rows, or a matrix.

use super::{Columns, Map, PlaceUnit, PowerUnit};
use crate::columns::{Gaps, OTHER_UNITS, Table, foreign, without_unit};
use pigtail_hal::Error;
use pigtail_hal::quantity::LENGTH;
use pigtail_model::frames::Displacement;
use pigtail_sysid::map::{Reading, Scan};
use std::fmt::Write as _;
use std::path::Path;

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
        let cut = without_unit(&names[*k]).to_lowercase();
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
                let name = &table.names()[place];
                let other = foreign(name, &[LENGTH]).or_else(|| {
                    let unit = table.unit_text(place)?;
                    OTHER_UNITS.contains(&unit).then_some(unit)
                });
                let Some(other) = other else {
                    return Ok(None);
                };
                let message = format!(
                    "its name says {other}; accepted are places in nm, um, mm, m, or V of a piezo"
                );
                return Err(table.error(name.as_str(), message));
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
    if !raw.unit.is_level()
        && !columns.inverted
        && !raw.power.is_empty()
        && raw.power.iter().all(|p| *p < 0.0)
    {
        let message = format!(
            "is below zero throughout; accepted is power in {}: levels in decibels want \
             --map-power-unit dBm or dB, a photodiode of negative voltage --map-inverted",
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
            // A loss is less light, and its logarithm has the sign.
            power: if raw.unit.is_level() {
                raw.unit.linear(sign * p)
            } else {
                sign * p
            },
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
        scan: scan.settled(columns.settled),
        place_unit: raw.place.told(),
        said: columns.place.is_some(),
        power: raw.unit,
        understood: raw.understood,
    })
}
