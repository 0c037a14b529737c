//! Units that columns of a file may have, and what people call them.

use pigtail_hal::quantity::{
    ANGLE, Dimension, FORCE, FREQUENCY, LENGTH, LEVEL, RATIO, TORQUE, VOLTAGE,
};
use serde::{Deserialize, Serialize};

/// What a column may be of, each in any of its units.
pub(crate) const DIMENSIONS: [Dimension; 10] = [
    TIME, LENGTH, ANGLE, VOLTAGE, CURRENT, FORCE, TORQUE, FREQUENCY, RATIO, LEVEL,
];

/// Moments of rows, which loggers count in finer ticks than a file of a rig does.
pub(crate) const TIME: Dimension = Dimension {
    name: "a time",
    units: &[
        ("s", 1.0),
        ("min", 60.0),
        ("ms", 1e-3),
        ("us", 1e-6),
        ("ns", 1e-9),
    ],
};

/// What drives a motor in place of a voltage; no file of a rig has one.
pub(crate) const CURRENT: Dimension = Dimension {
    name: "a current",
    units: &[("A", 1.0), ("mA", 1e-3)],
};

/// A unit of places in a file.
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
    Serialize,
    Deserialize,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum LengthUnit {
    /// Nanometres
    Nm,
    /// Micrometres
    Um,
    /// Millimetres
    Mm,
    /// Metres
    M,
}

impl LengthUnit {
    /// The unit of that name, `um` or `nm`, where it is one of places.
    pub fn named(name: &str) -> Option<Self> {
        name.parse().ok()
    }

    /// Metres in one.
    pub fn metres(self) -> f64 {
        LENGTH.unit(self.into()).map_or(1.0, |(_, metres)| metres)
    }

    /// Micrometres in one.
    pub fn micrometres(self) -> f64 {
        1e6 * self.metres()
    }
}

/// Units of columns that no command asks for.
pub(crate) const OTHER_UNITS: [&str; 14] = [
    "A", "mA", "W", "mW", "uW", "rpm", "1/min", "m/s", "mm/s", "deg/s", "rad/s", "%", "C", "bar",
];

/// What else units are called.
const CALLED: [(&str, &[&str]); 15] = [
    (
        "um",
        &[
            "\u{b5}m",
            "\u{3bc}m",
            "micron",
            "microns",
            "micrometer",
            "micrometre",
        ],
    ),
    ("us", &["\u{b5}s", "\u{3bc}s", "usec", "microseconds"]),
    ("ns", &["nsec", "nanosecond", "nanoseconds"]),
    ("uV", &["\u{b5}V", "\u{3bc}V"]),
    ("deg", &["\u{b0}", "degree", "degrees", "Grad"]),
    ("rad", &["radian", "radians"]),
    ("s", &["sec", "secs", "second", "seconds", "S"]),
    ("ms", &["msec", "milliseconds", "millisecond"]),
    ("m", &["meter", "meters", "metre", "metres"]),
    (
        "mm",
        &[
            "millimeter",
            "millimetre",
            "millimeters",
            "millimetres",
            "MM",
        ],
    ),
    ("V", &["v", "volt", "volts", "Volt", "Volts"]),
    ("N", &["newton", "newtons", "Newton"]),
    ("N m", &["N*m", "N.m", "N\u{b7}m", "N-m", "nm_torque"]),
    ("Hz", &["hz", "HZ", "hertz"]),
    ("dB", &["DB"]),
];

/// A unit by its name, of one of these dimensions.
pub(crate) fn unit_of(dimensions: &[Dimension], name: &str) -> Option<(Dimension, &'static str)> {
    let called = CALLED.iter().find(|(_, others)| others.contains(&name));
    let name = called.map_or(name, |(unit, _)| *unit);
    dimensions
        .iter()
        .find_map(|dimension| Some((*dimension, dimension.unit(name)?.0)))
}

/// What a column's name ends with, in brackets, behind a stroke, a word or an underscore.
pub(crate) fn ending(name: &str) -> Option<&str> {
    parts(name).map(|(_, unit)| unit.trim())
}

/// A column's name without the unit that it ends with, if that is one.
pub(crate) fn bare(name: &str) -> Option<&str> {
    let (name, unit) = parts(name)?;
    let is_unit = unit_of(&DIMENSIONS, unit.trim()).is_some() || OTHER_UNITS.contains(&unit.trim());
    is_unit.then(|| name.trim())
}

/// A column's name before and in what may be its unit.
fn parts(name: &str) -> Option<(&str, &str)> {
    let bracketed = name
        .strip_suffix([']', ')'])
        .and_then(|rest| rest.rsplit_once(['[', '(']));
    bracketed
        .or_else(|| over_unit(name))
        .or_else(|| name.rsplit_once(" in "))
        .or_else(|| behind_a_space(name))
        .or_else(|| name.rsplit_once('_'))
}

/// A name and a unit of more letters than one, which may be a symbol or number a channel: `Position mm`.
fn behind_a_space(name: &str) -> Option<(&str, &str)> {
    name.rsplit_once(' ')
        .filter(|(_, unit)| unit.chars().count() > 1 && unit_of(&DIMENSIONS, unit).is_some())
}

/// A quantity over its unit, as tables and axes are headed by ISO 80000: `U / V`, `x/um`. What stands above the stroke is a symbol:
/// `v_mm/s` and `um/V` are units by themselves.
fn over_unit(name: &str) -> Option<(&str, &str)> {
    let of_a_symbol = |(symbol, _): &(&str, &str)| {
        let is_unit = unit_of(&DIMENSIONS, symbol).is_some() || OTHER_UNITS.contains(symbol);
        !symbol.is_empty() && !symbol.contains(['_', ' ', '/']) && !is_unit
    };
    name.split_once(" / ")
        .or_else(|| name.split_once('/').filter(of_a_symbol))
}

/// A column's name without a unit in brackets or behind a stroke.
pub(crate) fn without_unit(name: &str) -> &str {
    let cut = name.split(['[', '(']).next().unwrap_or_default().trim();
    over_unit(cut).map_or(cut, |(symbol, _)| symbol.trim())
}

/// A per cent, or a share in words, that the name of a column ends with. Drives write torque, current and voltage so, of what they are rated
/// for, which no record says.
pub(crate) fn share(name: &str) -> Option<&str> {
    const SHARES: [&str; 9] = [
        "pct",
        "percent",
        "perc",
        "prozent",
        "permille",
        "promille",
        "pu",
        "normalized",
        "normalised",
    ];
    ending(name).filter(|unit| unit.starts_with('%') || SHARES.contains(&&*unit.to_lowercase()))
}

/// A unit that the name of a column ends with, but none of ours: what is in it is not SI.
pub(crate) fn foreign<'a>(name: &'a str, of: &[Dimension]) -> Option<&'a str> {
    const COUNTS: [&str; 3] = ["counts", "cts", "ticks"];
    let own = |si: &str| -> &[&str] {
        match si {
            "m" => &[
                "in", "inch", "inches", "ft", "mil", "mils", "thou", "cm", "dm",
            ],
            "N" => &["lbf", "ozf", "kgf", "lb", "gf", "g", "kg"],
            _ => &[],
        }
    };
    // What may be counted may be in counts.
    let counted = of.contains(&RATIO);
    ending(name).filter(|unit| {
        let unit = unit.to_lowercase();
        let counts = COUNTS.contains(&&*unit) && !counted && ["m", "N", "V"].contains(&of[0].si());
        let share = share(name).is_some() && !counted;
        counts || share || of.iter().any(|d| own(d.si()).contains(&&*unit))
    })
}

/// The unit that a column's name ends with.
pub(crate) fn of_name(name: &str) -> Option<(Dimension, &'static str)> {
    unit_of(&DIMENSIONS, ending(name)?)
}
