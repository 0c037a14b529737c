//! Numbers with units: the wire types, the one table of units, and the quantities of configuration files.
//!
//! A quantity in a file is a string of a number and a unit, `"5 um"`. It is parsed once, while
//! loading, and is SI in `f64` from then on. What a key accepts is named by a type of this module in serde's
//! `with`: it reads the key, with an error that names the text and what would be accepted; it writes a default
//! as a file would have it; and it is the key's part of the file's JSON Schema.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Deserializer, Error};
use serde::ser::Serializer;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};
use std::marker::PhantomData;

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

    /// What a key of this dimension accepts, in words: `a length above zero (m, mm, um, nm)`.
    fn accepted(&self, sign: Sign) -> String {
        let range = match sign {
            Sign::Any => "",
            Sign::NonNegative => " of zero or more",
            Sign::Positive => " above zero",
        };
        format!("{}{range} ({})", self.name, self.names())
    }

    /// Its units, one after the other.
    fn names(&self) -> String {
        let units: Vec<_> = self.units.iter().map(|(unit, _)| *unit).collect();
        units.join(", ")
    }

    /// An SI value as a file would have it, in the unit that makes the shortest number of it.
    ///
    /// ```
    /// use pigtail_hal::quantity::{LENGTH, TIME};
    /// assert_eq!(LENGTH.text(300e-6), "300 um");
    /// assert_eq!(TIME.text(0.1), "100 ms");
    /// assert_eq!(TIME.text(0.0), "0 s");
    /// ```
    pub fn text(&self, value: f64) -> String {
        let own = || format!("{value} {}", self.si());
        if value == 0.0 {
            return own();
        }
        let texts = self.units.iter().map(|(unit, factor)| {
            // Twelve digits are more than anybody writes, and hide what dividing leaves in the last one.
            let number = format!("{:.11e}", value / factor);
            let number = number.parse::<f64>().unwrap_or(f64::NAN);
            (number, format!("{number} {unit}"))
        });
        let same = texts.filter(|(_, text)| self.parse(text, Sign::Any) == Ok(value));
        same.min_by_key(|(number, text)| (!(1.0..1000.0).contains(&number.abs()), text.len()))
            .map_or_else(own, |(_, text)| text)
    }

    /// The JSON Schema of a key of this dimension.
    fn schema(&self, sign: Sign) -> Schema {
        let number = match sign {
            Sign::Any => r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)",
            Sign::NonNegative => r"\+?([0-9]+\.?[0-9]*|\.[0-9]+)",
            // A digit that is not zero, before the point or behind it.
            Sign::Positive => r"\+?([0-9]*[1-9][0-9]*\.?[0-9]*|[0-9]*\.[0-9]*[1-9][0-9]*)",
        };
        let units: Vec<_> = self
            .units
            .iter()
            .map(|(unit, _)| unit.replace('(', r"\(").replace(')', r"\)"))
            .collect();
        json_schema!({
            "type": "string",
            "title": self.accepted(sign),
            "pattern": format!(r"^\s*{number}([eE][+-]?[0-9]+)? \s*({})\s*$", units.join("|")),
        })
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
            format!(
                "accepted is {} with its unit ({}), such as \"1 {}\"",
                self.name,
                self.names(),
                self.units[0].0
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

/// A quantity that a key of a file may state: a dimension, and a range of values.
pub trait Quantity {
    /// Its dimension.
    const DIMENSION: Dimension;
    /// What range of values is accepted.
    const SIGN: Sign;
}

/// A quantity for a key that may be missing.
#[derive(Debug)]
pub struct Optional<Q>(PhantomData<Q>);

macro_rules! dimensions {
    ($($constant:ident $any:ident $non_negative:ident $positive:ident $name:literal
       [$($unit:literal = $factor:expr),+];)+) => {
        /// Every dimension that a file may state.
        pub const DIMENSIONS: &[Dimension] = &[$($constant),+];
        $(
        #[doc = concat!("The dimension of ", $name, ".")]
        pub const $constant: Dimension =
            Dimension { name: $name, units: &[$(($unit, $factor)),+] };

        quantity! { $any $constant Any concat!("Reads ", $name, " of any sign to SI.") }
        quantity! { $non_negative $constant NonNegative concat!("Reads ", $name, " of zero or more to SI.") }
        quantity! { $positive $constant Positive concat!("Reads ", $name, " of more than zero to SI.") }
        )+
    };
}

macro_rules! quantity {
    ($quantity:ident $dimension:ident $sign:ident $doc:expr) => {
        #[doc = $doc]
        #[derive(Debug)]
        pub struct $quantity;

        impl Quantity for $quantity {
            const DIMENSION: Dimension = $dimension;
            const SIGN: Sign = Sign::$sign;
        }

        impl $quantity {
            /// Reads the text of a number and a unit to SI.
            ///
            /// # Errors
            ///
            /// When the text is no such quantity.
            pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
                read(&$dimension, Sign::$sign, d)
            }

            /// Writes an SI value as such a text.
            ///
            /// # Errors
            ///
            /// None of its own.
            pub fn serialize<S: Serializer>(value: &f64, s: S) -> Result<S::Ok, S::Error> {
                s.serialize_str(&$dimension.text(*value))
            }
        }

        described! { [] $quantity, |_| $dimension.schema(Sign::$sign) }
    };
}

/// What a key of one of these types accepts stands where the key does, not among a schema's definitions.
macro_rules! described {
    ([$($parameters:tt)*] $type:ty, |$generator:pat_param| $schema:expr) => {
        impl<$($parameters)*> JsonSchema for $type {
            fn inline_schema() -> bool {
                true
            }

            fn schema_name() -> Cow<'static, str> {
                stringify!($type).into()
            }

            fn json_schema($generator: &mut SchemaGenerator) -> Schema {
                $schema
            }
        }
    };
}

dimensions! {
    LENGTH Length NonNegativeLength PositiveLength "a length"
        ["m" = 1.0, "mm" = 1e-3, "um" = 1e-6, "nm" = 1e-9];
    ANGLE Angle NonNegativeAngle PositiveAngle "an angle"
        ["deg" = PI / 180.0, "rad" = 1.0, "mrad" = 1e-3, "urad" = 1e-6, "arcsec" = PI / 648_000.0,
         "turn" = TAU];
    TIME Time NonNegativeTime PositiveTime "a time"
        ["s" = 1.0, "min" = 60.0, "ms" = 1e-3, "us" = 1e-6];
    FREQUENCY Frequency NonNegativeFrequency PositiveFrequency "a frequency"
        ["Hz" = 1.0, "kHz" = 1e3, "rad/s" = 0.5 / PI];
    SPEED Speed NonNegativeSpeed PositiveSpeed "a speed"
        ["m/s" = 1.0, "mm/s" = 1e-3, "um/s" = 1e-6];
    ACCELERATION Acceleration NonNegativeAcceleration PositiveAcceleration "an acceleration"
        ["m/s2" = 1.0, "mm/s2" = 1e-3];
    JERK Jerk NonNegativeJerk PositiveJerk "a jerk"
        ["m/s3" = 1.0, "mm/s3" = 1e-3];
    ROTATION Rotation NonNegativeRotation PositiveRotation "a speed of rotation"
        ["rpm" = PI / 30.0, "rad/s" = 1.0];
    VOLTAGE Voltage NonNegativeVoltage PositiveVoltage "a voltage"
        ["V" = 1.0, "mV" = 1e-3, "uV" = 1e-6];
    INERTIA Inertia NonNegativeInertia PositiveInertia "a moment of inertia"
        ["kg m2" = 1.0];
    FORCE Force NonNegativeForce PositiveForce "a force"
        ["N" = 1.0, "kN" = 1e3, "mN" = 1e-3, "uN" = 1e-6];
    TORQUE Torque NonNegativeTorque PositiveTorque "a torque"
        ["N m" = 1.0, "Nm" = 1.0, "mN m" = 1e-3, "mNm" = 1e-3, "uNm" = 1e-6];
    STIFFNESS Stiffness NonNegativeStiffness PositiveStiffness "a torsional stiffness"
        ["N m/rad" = 1.0];
    HARDENING Hardening NonNegativeHardening PositiveHardening "a cubic stiffness"
        ["N m/rad3" = 1.0];
    DAMPING Damping NonNegativeDamping PositiveDamping "a viscous friction"
        ["N m s/rad" = 1.0];
    TORQUE_CONSTANT TorqueConstant NonNegativeTorqueConstant PositiveTorqueConstant
        "a torque constant" ["N m/A" = 1.0];
    BACK_EMF BackEmf NonNegativeBackEmf PositiveBackEmf "a back-emf constant"
        ["V s/rad" = 1.0];
    CURRENT Current NonNegativeCurrent PositiveCurrent "a current"
        ["A" = 1.0, "mA" = 1e-3];
    RESISTANCE Resistance NonNegativeResistance PositiveResistance "a resistance"
        ["ohm" = 1.0];
    PIEZO_GAIN PiezoGain NonNegativePiezoGain PositivePiezoGain "a displacement per volt"
        ["um/V" = 1e-6, "nm/V" = 1e-9];
    PROPORTIONAL Proportional NonNegativeProportional PositiveProportional
        "a proportional gain" ["V/count" = 1.0];
    INTEGRAL Integral NonNegativeIntegral PositiveIntegral
        "an integral gain" ["V/(count s)" = 1.0];
    DERIVATIVE Derivative NonNegativeDerivative PositiveDerivative
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

/// `N` points, each an array of `M` lengths, read to metres.
#[derive(Debug)]
pub struct Points<const N: usize, const M: usize>;

macro_rules! arrays {
    ($($array:ident $dimension:ident $names:literal $doc:literal;)+) => { $(
        #[doc = $doc]
        #[derive(Debug)]
        pub struct $array<const N: usize>;

        impl<const N: usize> $array<N> {
            /// Reads as many texts of a number and a unit.
            ///
            /// # Errors
            ///
            /// When an element is no such quantity, or their number is not `N`.
            pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<[f64; N], D::Error> {
                several(d, &$dimension, $names)
            }

            /// Writes SI values as such texts.
            ///
            /// # Errors
            ///
            /// None of its own.
            pub fn serialize<S: Serializer>(values: &[f64; N], s: S) -> Result<S::Ok, S::Error> {
                s.collect_seq(values.iter().map(|value| $dimension.text(*value)))
            }
        }

        described! { [const N: usize] $array<N>, |_| array(N, &$dimension, $names) }
    )+ };
}

arrays! {
    Lengths LENGTH "lengths" "An array of `N` lengths, such as the coordinates of a point, read to metres.";
    Frequencies FREQUENCY "frequencies" "An array of `N` frequencies, such as the resonances of axes, read to hertz.";
    Angles ANGLE "angles" "An array of `N` angles, read to radians.";
    Times TIME "times" "An array of `N` times, read to seconds.";
    Speeds SPEED "speeds" "An array of `N` speeds, such as those along the axes, read to metres a second.";
}

impl<const N: usize, const M: usize> Points<N, M> {
    /// Reads as many arrays of texts of a number and a unit.
    ///
    /// # Errors
    ///
    /// When an element is no such point, or their number is not `N`.
    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<[[f64; M]; N], D::Error> {
        let points = Vec::<Point<M>>::deserialize(d)?;
        let count = points.len();
        let values: Vec<[f64; M]> = points.into_iter().map(|Point(values)| values).collect();
        values.try_into().map_err(|_| {
            D::Error::custom(format!(
                "has {count} elements; accepted is an array of {N} points"
            ))
        })
    }
}

described! { [const N: usize, const M: usize] Points<N, M>, |_| {
    let each = format!("each of {M} lengths ({})", LENGTH.names());
    elements(N, &format!("an array of {N} points, {each}"), &array(M, &LENGTH, "lengths"))
} }

fn array(count: usize, dimension: &Dimension, name: &str) -> Schema {
    let title = format!("an array of {count} {name} ({})", dimension.names());
    elements(count, &title, &dimension.schema(Sign::Any))
}

fn elements(count: usize, title: &str, each: &Schema) -> Schema {
    json_schema!({
        "type": "array",
        "title": title,
        "items": each,
        "minItems": count,
        "maxItems": count,
    })
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

struct Point<const N: usize>([f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Point<N> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        Lengths::<N>::deserialize(d).map(Self)
    }
}

impl<Q: Quantity> Optional<Q> {
    /// Reads the text of a number and a unit to SI.
    ///
    /// # Errors
    ///
    /// When the text is no such quantity.
    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
        read(&Q::DIMENSION, Q::SIGN, d).map(Some)
    }

    /// Writes an SI value as such a text.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn serialize<S: Serializer>(value: &Option<f64>, s: S) -> Result<S::Ok, S::Error> {
        value.map(|value| Q::DIMENSION.text(value)).serialize(s)
    }
}

described! { [Q: Quantity] Optional<Q>, |_| Q::DIMENSION.schema(Q::SIGN) }

macro_rules! numbers {
    ($($(#[$doc:meta])+ $number:ident $read:ident { $($key:literal: $bound:literal),+ })+) => { $(
        $(#[$doc])+
        #[derive(Debug)]
        pub struct $number;

        impl $number {
            /// Reads a plain number.
            ///
            /// # Errors
            ///
            /// When it is out of range or not finite.
            pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
                $read(d)
            }

            /// Writes it as it is.
            ///
            /// # Errors
            ///
            /// None of its own.
            pub fn serialize<S: Serializer>(value: &f64, s: S) -> Result<S::Ok, S::Error> {
                s.serialize_f64(*value)
            }
        }

        described! { [] $number, |_| json_schema!({"type": "number", $($key: $bound),+}) }
    )+ };
}

numbers! {
    /// A plain number of more than zero.
    Positive positive { "exclusiveMinimum": 0 }
    /// A plain number of zero or more.
    NonNegative non_negative { "minimum": 0 }
    /// A plain number of one or more.
    OneOrMore one_or_more { "minimum": 1 }
    /// A plain number from zero to one.
    Fraction fraction { "minimum": 0, "maximum": 1 }
}

fn number<'de, D: Deserializer<'de>>(deserializer: D, sign: Sign) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    check_sign(value, sign).map_err(|why| D::Error::custom(format!("{value} {why}")))?;
    Ok(value)
}

fn positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    number(deserializer, Sign::Positive)
}

fn non_negative<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    number(deserializer, Sign::NonNegative)
}

fn one_or_more<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = number(deserializer, Sign::Positive)?;
    if value < 1.0 {
        return Err(D::Error::custom(format!(
            "{value} is below one; accepted is a number of 1 or more"
        )));
    }
    Ok(value)
}

fn fraction<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
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
