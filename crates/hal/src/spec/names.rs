//! What a machine's parts are called: manipulators, axes, photodiodes.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Number of manipulators.
pub const SIDES: usize = 2;
/// Number of macro axes of a manipulator.
pub const AXES: usize = 3;
/// Number of micro axes of a manipulator.
pub const MICRO_AXES: usize = 2;
/// Number of photodiodes.
pub const CHANNELS: usize = 3;
/// Number of output fibers of a device.
pub const OUTPUTS: usize = 2;

/// A manipulator, seen along the waveguide with the input on the left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Carries the input fiber.
    Left,
    /// Carries the output fibers, one after the other, and the sensing fiber.
    Right,
}

impl Side {
    /// Both manipulators, in index order.
    pub const ALL: [Self; SIDES] = [Self::Left, Self::Right];

    /// Index into arrays over the sides.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The name that files and messages use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// A macro axis of a manipulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axis {
    /// The five-bar joint whose base lies at negative x.
    A,
    /// The five-bar joint whose base lies at positive x.
    B,
    /// The linear stage that carries the five-bar.
    Z,
}

impl Axis {
    /// All macro axes, in index order.
    pub const ALL: [Self; AXES] = [Self::A, Self::B, Self::Z];

    /// Index into arrays over the axes.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The name that files and messages use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::A => "a",
            Self::B => "b",
            Self::Z => "z",
        }
    }
}

/// One axis of one manipulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct AxisName {
    /// The manipulator.
    pub side: Side,
    /// Its axis.
    pub axis: Axis,
}

/// `left.a` and the like; `fivebar` and `z` stand for those of the left manipulator.
impl AxisName {
    /// Those of a machine: left.a, left.b, left.z, right.a, right.b, right.z.
    pub const ALL: [Self; SIDES * AXES] = [
        Self::new(Side::Left, Axis::A),
        Self::new(Side::Left, Axis::B),
        Self::new(Side::Left, Axis::Z),
        Self::new(Side::Right, Axis::A),
        Self::new(Side::Right, Axis::B),
        Self::new(Side::Right, Axis::Z),
    ];

    /// Those of them that are joints of a five-bar.
    pub fn joints() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|at| at.axis != Axis::Z)
    }

    /// An axis of a manipulator.
    pub const fn new(side: Side, axis: Axis) -> Self {
        Self { side, axis }
    }
}

impl From<AxisName> for String {
    fn from(name: AxisName) -> Self {
        name.to_string()
    }
}

impl TryFrom<String> for AxisName {
    type Error = <Self as FromStr>::Err;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl FromStr for AxisName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = |axis| {
            Ok(Self {
                side: Side::Left,
                axis,
            })
        };
        match text {
            "fivebar" => return named(Axis::A),
            "z" => return named(Axis::Z),
            _ => {}
        }
        let all = Self::ALL.into_iter();
        all.clone()
            .find(|name| name.to_string() == text)
            .ok_or_else(|| {
                let names: Vec<String> = all.map(|name| name.to_string()).collect();
                format!(
                    "there is no axis \"{text}\"; accepted is fivebar, z, {}",
                    names.join(", ")
                )
            })
    }
}

impl fmt::Display for AxisName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.side.name(), self.axis.name())
    }
}

/// A photodiode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// At the far end of the first output fiber.
    Output1,
    /// At the far end of the second output fiber.
    Output2,
    /// At the far end of the sensing fiber.
    Sensing,
}

impl Channel {
    /// All photodiodes, in index order.
    pub const ALL: [Self; CHANNELS] = [Self::Output1, Self::Output2, Self::Sensing];

    /// The photodiode of the output fiber `port`, counted from zero.
    pub const fn of_output(port: usize) -> Self {
        if port == 0 {
            Self::Output1
        } else {
            Self::Output2
        }
    }

    /// The name that files and messages use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Output1 => "output1",
            Self::Output2 => "output2",
            Self::Sensing => "sensing",
        }
    }

    /// Index into arrays over the photodiodes.
    pub const fn index(self) -> usize {
        self as usize
    }
}
