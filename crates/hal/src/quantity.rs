//! Numbers with units: the wire types, the one table of units, and the quantities of configuration files.
//!
//! A quantity in a file is a string of a number and a unit, `"5 um"`. It is parsed once, while
//! loading, and is SI in `f64` from then on. Each function of this module is meant for serde's
//! `deserialize_with`; its error names the text and what would be accepted.

use serde::de::{Deserializer, Error};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A position in encoder counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Counts(pub i64);

/// A voltage on a wire, in volts.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
pub struct Volts(pub f64);

/// A physical dimension and the units in which a file may state it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dimension {
    /// The dimension's name with its article, as an error message says it: `a length`.
    pub name: &'static str,
    /// Accepted units and the factor of each to SI.
    pub units: &'static [(&'static str, f64)],
}

/// What range of values a key accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sign {
    /// Any finite number.
    Any,
    /// Zero or more.
    NonNegative,
    /// More than zero.
    Positive,
}

impl Dimension {
    /// A unit by its name, with its factor to SI.
    ///
    /// ```
    /// use pigtail_hal::quantity::LENGTH;
    /// assert_eq!(LENGTH.unit("mm"), Some(("mm", 1e-3)));
    /// assert_eq!(LENGTH.unit("V"), None);
    /// ```
    pub fn unit(&self, name: &str) -> Option<(&'static str, f64)> {
        self.units.iter().find(|(unit, _)| *unit == name).copied()
    }

    /// The unit that is SI's own.
    pub fn si(&self) -> &'static str {
        let own = self
            .units
            .iter()
            .find(|(_, factor)| (factor - 1.0).abs() < f64::EPSILON);
        own.map_or("", |(unit, _)| unit)
    }

    /// Parses `"5 um"` to SI.
    ///
    /// # Errors
    ///
    /// A sentence that names the text and what would be accepted.
    ///
    /// ```
    /// use pigtail_hal::quantity::{LENGTH, Sign};
    /// assert_eq!(LENGTH.parse("5 um", Sign::Any), Ok(5e-6));
    /// assert!(LENGTH.parse("5 kg", Sign::Any).is_err());
    /// assert!(LENGTH.parse("-5 um", Sign::NonNegative).is_err());
    /// ```
    pub fn parse(&self, text: &str, sign: Sign) -> Result<f64, String> {
        let wanted = || {
            let units: Vec<_> = self.units.iter().map(|(unit, _)| *unit).collect();
            format!(
                "accepted is {} with its unit ({}), such as \"1 {}\"",
                self.name,
                units.join(", "),
                units[0]
            )
        };
        let text = text.trim();
        let (number, unit) = text.split_once(' ').unwrap_or((text, ""));
        let unit = unit.trim();
        let Ok(number) = number.parse::<f64>() else {
            let digits = text.trim_end_matches(|c: char| !c.is_ascii_digit() && c != '.');
            let glued = digits.len() < text.len() && digits.parse::<f64>().is_ok();
            let why = if glued {
                "lacks a space before its unit"
            } else {
                "is not a number"
            };
            return Err(format!("\"{text}\" {why}; {}", wanted()));
        };
        let Some((_, factor)) = self.unit(unit) else {
            return Err(format!("\"{text}\" is not {}; {}", self.name, wanted()));
        };
        // Dividing by a power of ten rounds correctly where multiplying by its inverse does not.
        let inverse = (1.0 / factor).round();
        let decimal = (factor * inverse - 1.0).abs() < 1e-12;
        let value = if decimal {
            number / inverse
        } else {
            number * factor
        };
        check_sign(number, sign).map_err(|why| format!("\"{text}\" {why}"))?;
        // What was more than zero may not have become zero on the way.
        check_sign(value, sign).map_err(|why| format!("\"{text}\" {why}"))?;
        Ok(value)
    }
}

/// Nothing in a pigtailing machine is larger than this in SI units; what is was mistyped, and
/// would overflow somewhere where nobody can tell why.
const BEYOND_REASON: f64 = 1e9;

fn check_sign(value: f64, sign: Sign) -> Result<(), &'static str> {
    if !value.is_finite() {
        return Err("is not a finite number; accepted is a finite number");
    }
    if value.abs() > BEYOND_REASON {
        return Err("is beyond reason; accepted is at most 1e9 in SI units");
    }
    match sign {
        Sign::NonNegative if value < 0.0 => Err("is negative; accepted is zero or more"),
        Sign::Positive if value <= 0.0 => Err("is not positive; accepted is more than zero"),
        _ => Ok(()),
    }
}

macro_rules! dimensions {
    ($($constant:ident $any:ident $non_negative:ident $positive:ident $name:literal
       [$($unit:literal = $factor:expr),+];)+) => { $(
        #[doc = concat!("The dimension of ", $name, ".")]
        pub const $constant: Dimension =
            Dimension { name: $name, units: &[$(($unit, $factor)),+] };

        #[doc = concat!("Deserializes ", $name, " of any sign to SI.")]
        ///
        /// # Errors
        ///
        /// When the text is no such quantity.
        pub fn $any<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
            read(&$constant, Sign::Any, d)
        }

        #[doc = concat!("Deserializes ", $name, " of zero or more to SI.")]
        ///
        /// # Errors
        ///
        /// When the text is no such quantity, or negative.
        pub fn $non_negative<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
            read(&$constant, Sign::NonNegative, d)
        }

        #[doc = concat!("Deserializes ", $name, " of more than zero to SI.")]
        ///
        /// # Errors
        ///
        /// When the text is no such quantity, or not positive.
        pub fn $positive<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
            read(&$constant, Sign::Positive, d)
        }
    )+ };
}

dimensions! {
    LENGTH length non_negative_length positive_length "a length"
        ["m" = 1.0, "mm" = 1e-3, "um" = 1e-6, "nm" = 1e-9];
    ANGLE angle non_negative_angle positive_angle "an angle"
        ["deg" = PI / 180.0, "rad" = 1.0, "mrad" = 1e-3, "urad" = 1e-6, "arcsec" = PI / 648_000.0,
         "turn" = TAU];
    TIME time non_negative_time positive_time "a time"
        ["s" = 1.0, "min" = 60.0, "ms" = 1e-3, "us" = 1e-6];
    FREQUENCY frequency non_negative_frequency positive_frequency "a frequency"
        ["Hz" = 1.0, "kHz" = 1e3, "rad/s" = 0.5 / PI];
    SPEED speed non_negative_speed positive_speed "a speed"
        ["m/s" = 1.0, "mm/s" = 1e-3, "um/s" = 1e-6];
    ACCELERATION acceleration non_negative_acceleration positive_acceleration "an acceleration"
        ["m/s2" = 1.0, "mm/s2" = 1e-3];
    JERK jerk non_negative_jerk positive_jerk "a jerk"
        ["m/s3" = 1.0, "mm/s3" = 1e-3];
    ROTATION rotation non_negative_rotation positive_rotation "a speed of rotation"
        ["rpm" = PI / 30.0, "rad/s" = 1.0];
    VOLTAGE voltage non_negative_voltage positive_voltage "a voltage"
        ["V" = 1.0, "mV" = 1e-3, "uV" = 1e-6];
    INERTIA inertia non_negative_inertia positive_inertia "a moment of inertia"
        ["kg m2" = 1.0];
    FORCE force non_negative_force positive_force "a force"
        ["N" = 1.0, "kN" = 1e3, "mN" = 1e-3, "uN" = 1e-6];
    TORQUE torque non_negative_torque positive_torque "a torque"
        ["N m" = 1.0, "Nm" = 1.0, "mN m" = 1e-3, "mNm" = 1e-3, "uNm" = 1e-6];
    STIFFNESS stiffness non_negative_stiffness positive_stiffness "a torsional stiffness"
        ["N m/rad" = 1.0];
    HARDENING hardening non_negative_hardening positive_hardening "a cubic stiffness"
        ["N m/rad3" = 1.0];
    DAMPING damping non_negative_damping positive_damping "a viscous friction"
        ["N m s/rad" = 1.0];
    TORQUE_CONSTANT torque_constant non_negative_torque_constant positive_torque_constant
        "a torque constant" ["N m/A" = 1.0];
    BACK_EMF back_emf non_negative_back_emf positive_back_emf "a back-emf constant"
        ["V s/rad" = 1.0];
    RESISTANCE resistance non_negative_resistance positive_resistance "a resistance"
        ["ohm" = 1.0];
    PIEZO_GAIN piezo_gain non_negative_piezo_gain positive_piezo_gain "a displacement per volt"
        ["um/V" = 1e-6, "nm/V" = 1e-9];
    PROPORTIONAL proportional non_negative_proportional positive_proportional
        "a proportional gain" ["V/count" = 1.0];
    INTEGRAL integral non_negative_integral positive_integral
        "an integral gain" ["V/(count s)" = 1.0];
    DERIVATIVE derivative non_negative_derivative positive_derivative
        "a derivative gain" ["V s/count" = 1.0];
}

/// A magnitude without a unit of its own.
pub const RATIO: Dimension = Dimension {
    name: "a ratio",
    units: &[("1", 1.0), ("ratio", 1.0)],
};

/// A magnitude as a level.
pub const LEVEL: Dimension = Dimension {
    name: "a level",
    units: &[("dB", 1.0), ("db", 1.0)],
};

fn read<'de, D: Deserializer<'de>>(
    dimension: &Dimension,
    sign: Sign,
    deserializer: D,
) -> Result<f64, D::Error> {
    let text = Value::deserialize(deserializer)?.into_text();
    dimension.parse(&text, sign).map_err(D::Error::custom)
}

/// A number without its unit is the commonest mistake in these files. Reading it as text lets
/// the error say so in the words of the key's own dimension.
#[derive(serde::Deserialize)]
#[serde(
    untagged,
    expecting = "accepted is a text of a number and a unit, such as \"1 um\""
)]
enum Value {
    Text(String),
    Integer(i64),
    Float(f64),
    Boolean(bool),
}

impl Value {
    fn into_text(self) -> String {
        match self {
            Self::Text(text) => text,
            Self::Integer(number) => number.to_string(),
            Self::Float(number) => number.to_string(),
            Self::Boolean(value) => value.to_string(),
        }
    }
}

/// Deserializes an array of lengths, such as the coordinates of a point, to metres.
///
/// # Errors
///
/// When an element is no length, or their number is not `N`.
pub fn lengths<'de, D: Deserializer<'de>, const N: usize>(d: D) -> Result<[f64; N], D::Error> {
    several(d, &LENGTH, "lengths")
}

/// Deserializes an array of angles to radians.
///
/// # Errors
///
/// When an element is no angle, or their number is not `N`.
pub fn angles<'de, D: Deserializer<'de>, const N: usize>(d: D) -> Result<[f64; N], D::Error> {
    several(d, &ANGLE, "angles")
}

fn several<'de, D: Deserializer<'de>, const N: usize>(
    d: D,
    dimension: &Dimension,
    name: &str,
) -> Result<[f64; N], D::Error> {
    let texts = Vec::<Value>::deserialize(d)?;
    let count = texts.len();
    let values = texts
        .into_iter()
        .map(|text| {
            dimension
                .parse(&text.into_text(), Sign::Any)
                .map_err(D::Error::custom)
        })
        .collect::<Result<Vec<_>, _>>()?;
    values.try_into().map_err(|_| {
        D::Error::custom(format!(
            "has {count} elements; accepted is an array of {N} {name}"
        ))
    })
}

/// Deserializes an array of points, each an array of lengths, to metres.
///
/// # Errors
///
/// When an element is no such point, or their number is not `N`.
pub fn points<'de, D, const N: usize, const M: usize>(d: D) -> Result<[[f64; M]; N], D::Error>
where
    D: Deserializer<'de>,
{
    let points = Vec::<Lengths<M>>::deserialize(d)?;
    let count = points.len();
    let values: Vec<[f64; M]> = points.into_iter().map(|Lengths(values)| values).collect();
    values.try_into().map_err(|_| {
        D::Error::custom(format!(
            "has {count} elements; accepted is an array of {N} points"
        ))
    })
}

struct Lengths<const N: usize>([f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Lengths<N> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        lengths(d).map(Self)
    }
}

fn number<'de, D: Deserializer<'de>>(deserializer: D, sign: Sign) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    check_sign(value, sign).map_err(|why| D::Error::custom(format!("{value} {why}")))?;
    Ok(value)
}

/// Deserializes a voltage of more than zero for a key that may be missing.
///
/// # Errors
///
/// When the text is no such quantity, or not positive.
pub fn optional_voltage<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<f64>, D::Error> {
    read(&VOLTAGE, Sign::Positive, deserializer).map(Some)
}

/// Deserializes a plain number of more than zero.
///
/// # Errors
///
/// When it is not positive or not finite.
pub fn positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    number(deserializer, Sign::Positive)
}

/// Deserializes a plain number of zero or more.
///
/// # Errors
///
/// When it is negative or not finite.
pub fn non_negative<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    number(deserializer, Sign::NonNegative)
}

/// Deserializes a plain number of one or more.
///
/// # Errors
///
/// When it is below or not finite.
pub fn one_or_more<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = number(deserializer, Sign::Positive)?;
    if value < 1.0 {
        return Err(D::Error::custom(format!(
            "{value} is below one; accepted is a number of 1 or more"
        )));
    }
    Ok(value)
}

/// Deserializes a plain number from zero to one.
///
/// # Errors
///
/// When it lies outside.
pub fn fraction<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = number(deserializer, Sign::NonNegative)?;
    if value > 1.0 {
        return Err(D::Error::custom(format!(
            "{value} is above one; accepted is a number from 0 to 1"
        )));
    }
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_units_round_as_if_written_in_metres() {
        assert_eq!(LENGTH.parse("0.635 mm", Sign::Any), Ok(0.635e-3));
        assert_eq!(LENGTH.parse("2.5 um", Sign::Any), Ok(2.5e-6));
        assert_eq!(FREQUENCY.parse("1 kHz", Sign::Any), Ok(1000.0));
        assert_eq!(ANGLE.parse("180 deg", Sign::Any), Ok(std::f64::consts::PI));
        assert_eq!(
            ROTATION.parse("30 rpm", Sign::Any),
            Ok(std::f64::consts::PI)
        );
    }

    #[test]
    fn the_error_names_the_text_and_what_is_accepted() {
        let error = LENGTH.parse("5 kg", Sign::Any).unwrap_err();
        assert!(error.contains("5 kg") && error.contains("a length") && error.contains("um"));
        let error = VOLTAGE.parse("NaN V", Sign::Any).unwrap_err();
        assert!(error.contains("finite"), "{error}");
        let error = VOLTAGE.parse("-3 mV", Sign::NonNegative).unwrap_err();
        assert!(
            error.contains("-3 mV") && error.contains("zero or more"),
            "{error}"
        );
    }

    #[test]
    fn a_number_without_a_unit_is_refused() {
        assert!(LENGTH.parse("5", Sign::Any).is_err());
        assert!(LENGTH.parse("", Sign::Any).is_err());
        assert!(LENGTH.parse("um", Sign::Any).is_err());
    }
}
