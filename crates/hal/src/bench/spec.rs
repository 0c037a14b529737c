//! The datasheet of a bench that is controlled by position: `machine.toml` of the kind `bench`.

use super::{AxisCaps, Caps, ChannelCaps, DEGREES, GroupCaps, Stage};
use crate::{Error, config, quantity};
use schemars::JsonSchema;
use serde::Deserialize;

/// Names of its arms: the input's, then the outputs'.
pub const ARMS: [&str; 2] = ["left", "right"];

/// What a datasheet is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A bench that is controlled by position.
    Bench,
}

/// The content of a bench's `machine.toml`. Both arms are alike.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchSpec {
    /// What tells it from the datasheet of a machine of volts.
    pub kind: Kind,
    /// The bench's name.
    pub name: String,
    /// The stages that go far, along x, y and z.
    pub coarse: CoarseSpec,
    /// The stages that go exactly.
    pub fine: FineSpec,
    /// The power meter at the other end of the output fiber that is carried.
    pub meter: MeterSpec,
    /// How fibers are handled.
    pub handling: HandlingSpec,
}

/// A group of stages that go far: steppers, which count their steps.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoarseSpec {
    /// Travel of each axis, centred on zero, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub travel: f64,
    /// Least step, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub resolution: f64,
    /// Standard deviation of where an axis comes to stand, from below, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub repeatability: f64,
    /// How far it falls short when it turns back, metres. Poses hold where an axis came from below.
    #[serde(with = "quantity::NonNegativeLength")]
    pub backlash: f64,
    /// Highest speed of an axis, metres a second.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
    /// Acceleration, metres a second squared.
    #[serde(with = "quantity::PositiveAcceleration")]
    pub acceleration: f64,
    /// By when it has come to rest, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub settling: f64,
    /// By how much a sample of light is later than the pose that it is of, by what is measured of that, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub lag: f64,
    /// Standard deviation of that, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub lag_deviation: f64,
}

/// A group of stages that go exactly: piezos that close their own loops.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FineSpec {
    /// Travel of each axis, centred on zero, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub travel: f64,
    /// Least step, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub resolution: f64,
    /// Standard deviation of where an axis comes to stand, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub repeatability: f64,
    /// Highest speed of an axis, metres a second.
    #[serde(with = "quantity::PositiveSpeed")]
    pub speed: f64,
    /// Acceleration, metres a second squared.
    #[serde(with = "quantity::PositiveAcceleration")]
    pub acceleration: f64,
    /// By when it has come to rest, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub settling: f64,
    /// Fastest circle that it follows, turns a second.
    #[serde(with = "quantity::PositiveFrequency")]
    pub bandwidth: f64,
    /// By how much a sample of light is later than the pose that it is of, by what is measured of that, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub lag: f64,
    /// Standard deviation of that, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub lag_deviation: f64,
}

/// The power meter.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeterSpec {
    /// Samples a second, hertz.
    #[serde(with = "quantity::PositiveFrequency")]
    pub rate: f64,
    /// Least step of a sample at its analogue output, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub resolution: f64,
    /// Largest sample, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub range: f64,
}

/// How fibers are handled.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HandlingSpec {
    /// How long an arm takes to take a fiber, or to give it back, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub load: f64,
    /// How long a fiber is held until it is fixed, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub bond: f64,
}

impl BenchSpec {
    /// Whether a `machine.toml` is one of a bench, by its `kind`.
    ///
    /// # Errors
    ///
    /// When it names a kind that is none.
    pub fn is_of(file: &str, text: &str) -> Result<bool, Error> {
        let table: toml::Table = toml::from_str(text).unwrap_or_default();
        match table.get("kind") {
            None => Ok(false),
            Some(kind) if kind.as_str() == Some("bench") => Ok(true),
            Some(kind) => Err(Error::new(
                file,
                "kind",
                format!("is {kind}; accepted is \"bench\", or no kind for a machine of volts"),
            )),
        }
    }

    /// Parses and checks the content of a `machine.toml`; `file` is its name in errors.
    ///
    /// # Errors
    ///
    /// When a key is missing, unknown or out of range.
    pub fn parse(file: &str, text: &str) -> Result<Self, Error> {
        let spec: Self = config::parse(file, text)?;
        let (c, f, m, h) = (&spec.coarse, &spec.fine, &spec.meter, &spec.handling);
        for (key, value, low, high, unit, scale) in [
            ("coarse.travel", c.travel, 1e-4, 1.0, "mm", 1e3),
            (
                "coarse.resolution",
                c.resolution,
                1e-12,
                0.1 * c.travel,
                "um",
                1e6,
            ),
            (
                "coarse.repeatability",
                c.repeatability,
                1e-12,
                1e-5,
                "um",
                1e6,
            ),
            ("coarse.backlash", c.backlash, 0.0, 1e-4, "um", 1e6),
            ("coarse.speed", c.speed, c.travel / 600.0, 10.0, "mm/s", 1e3),
            (
                "coarse.acceleration",
                c.acceleration,
                c.travel / 900.0,
                1e3,
                "m/s2",
                1.0,
            ),
            ("coarse.settling", c.settling, 0.0, 10.0, "ms", 1e3),
            ("coarse.lag", c.lag, 0.0, 1.0, "ms", 1e3),
            ("coarse.lag_deviation", c.lag_deviation, 0.0, 1.0, "ms", 1e3),
            ("fine.travel", f.travel, 1e-6, c.travel, "um", 1e6),
            (
                "fine.resolution",
                f.resolution,
                1e-12,
                0.1 * f.travel,
                "nm",
                1e9,
            ),
            (
                "fine.repeatability",
                f.repeatability,
                1e-12,
                0.1 * f.travel,
                "nm",
                1e9,
            ),
            ("fine.speed", f.speed, f.travel / 60.0, 10.0, "mm/s", 1e3),
            (
                "fine.acceleration",
                f.acceleration,
                f.travel / 900.0,
                1e3,
                "m/s2",
                1.0,
            ),
            ("fine.settling", f.settling, 0.0, 10.0, "ms", 1e3),
            ("fine.bandwidth", f.bandwidth, 0.01, 1e4, "Hz", 1.0),
            ("fine.lag", f.lag, 0.0, 1.0, "ms", 1e3),
            ("fine.lag_deviation", f.lag_deviation, 0.0, 1.0, "ms", 1e3),
            ("meter.rate", m.rate, 1.0, 500.0, "Hz", 1.0),
            ("meter.range", m.range, 1e-3, 1e3, "V", 1.0),
            (
                "meter.resolution",
                m.resolution,
                1e-9,
                0.1 * m.range,
                "mV",
                1e3,
            ),
            ("handling.load", h.load, 1e-3, 600.0, "s", 1.0),
            ("handling.bond", h.bond, 1e-3, 600.0, "s", 1.0),
        ] {
            if !(low..=high).contains(&value) {
                let message = format!(
                    "{} {unit} is out of range; accepted is {} to {} {unit}",
                    value * scale,
                    low * scale,
                    high * scale
                );
                return Err(Error::new(file, key, message));
            }
        }
        Ok(spec)
    }

    /// What the bench is able to do: an arm each for input and outputs, on each the coarse group, then the fine one.
    pub fn caps(&self) -> Caps {
        let three = |axis: AxisCaps| {
            let mut axes = [None; DEGREES];
            axes[..3].fill(Some(axis));
            axes
        };
        let half = |travel: f64| (-0.5 * travel, 0.5 * travel);
        let (coarse, fine) = (&self.coarse, &self.fine);
        let groups = ARMS.iter().enumerate().flat_map(|(arm, name)| {
            [
                GroupCaps {
                    name: format!("{name}.coarse"),
                    arm,
                    stage: Stage::Coarse,
                    axes: three(AxisCaps {
                        range: half(coarse.travel),
                        resolution: coarse.resolution,
                        repeatability: coarse.repeatability,
                        backlash: coarse.backlash,
                        speed: coarse.speed,
                    }),
                    settling: coarse.settling,
                    bandwidth: 0.0,
                    lag: (coarse.lag, coarse.lag_deviation),
                    bends: true,
                },
                GroupCaps {
                    name: format!("{name}.fine"),
                    arm,
                    stage: Stage::Fine,
                    axes: three(AxisCaps {
                        range: half(fine.travel),
                        resolution: fine.resolution,
                        repeatability: fine.repeatability,
                        backlash: 0.0,
                        speed: fine.speed,
                    }),
                    settling: fine.settling,
                    bandwidth: fine.bandwidth,
                    lag: (fine.lag, fine.lag_deviation),
                    bends: true,
                },
            ]
        });
        Caps {
            name: self.name.clone(),
            arms: ARMS.map(str::to_owned).to_vec(),
            groups: groups.collect(),
            channels: vec![ChannelCaps {
                name: "power".to_owned(),
                rate: self.meter.rate,
                resolution: self.meter.resolution,
                full_scale: self.meter.range,
            }],
            least_power: 100,
            bond: self.handling.bond,
            cycle: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = include_str!("../../../../rigs/bench-piezo/machine.toml");

    #[test]
    fn the_shipped_datasheet_is_read_and_a_wrong_one_explained() {
        let caps = BenchSpec::parse("machine.toml", SHIPPED)
            .expect("it ships")
            .caps();
        assert_eq!(caps.groups.len(), 4);
        assert_eq!(caps.group(1, Stage::Fine).map(|group| group.0), Some(3));
        assert_eq!(BenchSpec::is_of("machine.toml", SHIPPED), Ok(true));
        assert_eq!(BenchSpec::is_of("machine.toml", "name = \"a\""), Ok(false));
        for (from, to, parts) in [
            ("\"100 Hz\"", "\"0.1 Hz\"", ["meter.rate", "1 to 500 Hz"]),
            ("\"4 mm\"", "\"4 kg\"", ["coarse.travel", "4 kg"]),
        ] {
            let error = BenchSpec::parse("machine.toml", &SHIPPED.replace(from, to)).unwrap_err();
            for part in parts {
                assert!(error.to_string().contains(part), "{error}");
            }
        }
        let error = BenchSpec::is_of("machine.toml", "kind = \"boat\"").unwrap_err();
        assert!(error.to_string().contains("boat"), "{error}");
    }
}
