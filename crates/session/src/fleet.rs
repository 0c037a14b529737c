//! A fleet: what the machines of a rig, and the devices on them, may be. A distribution for every key of a
//! `plant.toml` that is not the same everywhere.
//!
//! A fleet's file mirrors the plant's. Where the plant has a value, it has the value's distribution:
//!
//! ```toml
//! [machine.micro]                 # drawn once for a machine
//! resonance = { lognormal = 0.2 } # 20 % around the plant's
//! [device.light]                  # drawn anew for each device on it
//! noise = { about = "5 mV", uniform = "1 mV" }
//! ```
//!
//! Every key is drawn from a stream of its own, named by its path: another key in a file leaves what is drawn
//! of the others as it is.

use crate::rig::{DEFAULT_RIG_NAME, Rig, Source, read_file, rig_folder};
use pigtail_hal::digest::hash;
use pigtail_hal::quantity::{DIMENSIONS, Dimension, Sign};
use pigtail_hal::{Error, config};
use pigtail_twin::{Plant, Specimen};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use schemars::JsonSchema;
use serde::Deserialize;
use statrs::distribution::{ContinuousCDF, Normal};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The fleets of the rig that is compiled in.
const BUILT_IN: [(&str, &str); 5] = [
    (
        "nominal",
        include_str!("../../../rigs/afpm/fleets/nominal.toml"),
    ),
    (
        "thesis",
        include_str!("../../../rigs/afpm/fleets/thesis.toml"),
    ),
    (
        "workshop",
        include_str!("../../../rigs/afpm/fleets/workshop.toml"),
    ),
    (
        "harsh",
        include_str!("../../../rigs/afpm/fleets/harsh.toml"),
    ),
    (
        "shift",
        include_str!("../../../rigs/afpm/fleets/shift.toml"),
    ),
];

/// The fleet that is used where none is named: machines as the plant itself says that they vary.
pub const NOMINAL: &str = "nominal";

/// The content of a file of a fleet.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FleetKeys {
    /// What these machines are, in a sentence.
    pub about: String,
    /// Keys of the `machine.toml` that are drawn once for a machine: control is told what came of it.
    #[serde(default)]
    #[schemars(with = "Keys")]
    pub datasheet: Table,
    /// Keys of the `plant.toml` that are drawn once for a machine.
    #[serde(default)]
    #[schemars(with = "Keys")]
    pub machine: Table,
    /// Keys of the `plant.toml` that are drawn for each device.
    #[serde(default)]
    #[schemars(with = "Keys")]
    pub device: Table,
}

/// Keys of another file, each with its value or with its distribution.
type Keys = serde_json::Map<String, serde_json::Value>;

/// What machines, and the devices on them, may be.
#[derive(Debug, Clone, PartialEq)]
pub struct Fleet {
    /// Its name, as the user gave it.
    pub name: String,
    /// What it is, in a sentence.
    pub about: String,
    file: String,
    /// The datasheet and the plant that are drawn around.
    spec: Table,
    plant: Table,
    datasheet: Vec<Drawn>,
    machine: Vec<Drawn>,
    device: Vec<Drawn>,
}

/// A key of a plant, and how it is drawn.
#[derive(Debug, Clone, PartialEq)]
struct Drawn {
    path: Vec<String>,
    law: Law,
}

#[derive(Debug, Clone, PartialEq)]
enum Law {
    /// The same for all.
    Set(Value),
    Spread(Box<Spread>),
}

/// A distribution, as a file states it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Spread {
    /// What to draw around, in place of the plant's own value.
    about: Option<Value>,
    /// Half range of a uniform distribution: a share of the value, of one about zero, or a quantity of its kind.
    uniform: Option<Value>,
    /// Standard deviation of a normal distribution, likewise.
    normal: Option<Value>,
    /// Standard deviation of the logarithm of what the value is multiplied with.
    lognormal: Option<f64>,
    /// Nothing is drawn below...
    low: Option<Value>,
    /// ...nor above.
    high: Option<Value>,
    /// The name of something that moves this key and others together...
    with: Option<String>,
    /// ...and how closely: their correlation with it. 1 if not given.
    correlation: Option<f64>,
}

/// The keys of which a distribution has one.
const LAWS: [&str; 3] = ["uniform", "normal", "lognormal"];

/// A logarithm that varies by more is of nothing that anyone builds.
const WIDEST: f64 = 3.0;

impl Fleet {
    /// The fleet that the user named: one of the rig's, or a file.
    ///
    /// # Errors
    ///
    /// When there is none, or it draws no machine from the rig's plant.
    pub fn load(rig: &Rig, fleet: &str) -> Result<(Self, Rig), Error> {
        let source = source(&rig.name, fleet)?;
        let keys: FleetKeys = config::parse(&source.name, &source.text)?;
        let truth = rig.truth().ok_or_else(|| crate::rig::no_twin(&rig.name))?;
        let plant: Table = config::parse(&truth.name, &truth.text)?;
        let sheet = rig.datasheet();
        let spec: Table = config::parse(&sheet.name, &sheet.text)?;
        let error = |(path, message): (String, String)| Error::new(&source.name, path, message);
        let fleet = Self {
            name: fleet.to_owned(),
            about: keys.about,
            datasheet: drawn("datasheet", &keys.datasheet, &spec).map_err(error)?,
            machine: drawn("machine", &keys.machine, &plant).map_err(error)?,
            device: drawn("device", &keys.device, &plant).map_err(error)?,
            spec,
            plant,
            file: source.name.clone(),
        };
        // What it draws is a machine, at its middle at least.
        fleet.plant(&|_| 0.0)?;
        fleet.told(rig, &|_| 0.0)?;
        let mut rig = rig.clone();
        if fleet.name != NOMINAL {
            rig.hashes.push((source.name, hash(&source.text)));
        }
        Ok((fleet, rig))
    }

    /// What control is told of the machine of a seed: the rig with its own datasheet; `None` where all
    /// machines have the rig's.
    ///
    /// # Errors
    ///
    /// When what was drawn is no datasheet.
    pub fn datasheet(&self, rig: &Rig, seed: u64) -> Result<Option<Rig>, Error> {
        if self.datasheet.is_empty() {
            return Ok(None);
        }
        self.told(rig, &|name| {
            StandardNormal.sample(&mut stream(name, Specimen::from(seed).machine()))
        })
        .map(Some)
    }

    fn told(&self, rig: &Rig, deviate: &dyn Fn(&str) -> f64) -> Result<Rig, Error> {
        let mut spec = self.spec.clone();
        self.put(&mut spec, (Level::Datasheet, &self.datasheet), &|(
            _,
            name,
        )| {
            deviate(name)
        })?;
        rig.with_datasheet(&spec, &self.file)
    }

    /// Whether it draws nothing of its own.
    pub fn is_nominal(&self) -> bool {
        self.datasheet.is_empty() && self.machine.is_empty() && self.device.is_empty()
    }

    /// The plant that the specimen of a seed is drawn around.
    ///
    /// # Errors
    ///
    /// When what was drawn is no plant.
    pub fn draw(&self, seed: u64) -> Result<Plant, Error> {
        self.plant(&|(level, name)| {
            let seed = match level {
                Level::Datasheet | Level::Machine => Specimen::from(seed).machine(),
                Level::Device => seed,
            };
            StandardNormal.sample(&mut stream(name, seed))
        })
    }

    /// The plant of these standard normal deviates, each of them of a name.
    fn plant(&self, deviate: &dyn Fn((Level, &str)) -> f64) -> Result<Plant, Error> {
        let mut plant = self.plant.clone();
        self.put(&mut plant, (Level::Machine, &self.machine), deviate)?;
        self.put(&mut plant, (Level::Device, &self.device), deviate)?;
        Plant::of(&self.file, plant)
    }

    /// Draws keys of a file.
    fn put(
        &self,
        file: &mut Table,
        (level, keys): (Level, &[Drawn]),
        deviate: &dyn Fn((Level, &str)) -> f64,
    ) -> Result<(), Error> {
        for Drawn { path, law } in keys {
            let place = place(file, path);
            let value = match law {
                Law::Set(value) => value.clone(),
                Law::Spread(spread) => {
                    let nominal = spread.about.as_ref().unwrap_or(place);
                    let name = path.join(".");
                    spread
                        .draw(nominal, &name, &|name| deviate((level, name)))
                        .map_err(|why| self.wrong(level, path, &why))?
                }
            };
            *place = value;
        }
        Ok(())
    }

    fn wrong(&self, level: Level, path: &[String], why: &str) -> Error {
        let level = match level {
            Level::Datasheet => "datasheet",
            Level::Machine => "machine",
            Level::Device => "device",
        };
        Error::new(&self.file, format!("{level}.{}", path.join(".")), why)
    }
}

/// When something is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    Datasheet,
    Machine,
    Device,
}

/// The stream of random numbers of a name: FNV-1a of it and of the seed.
fn stream(name: &str, seed: u64) -> Pcg64Mcg {
    let bytes = name.bytes().chain(seed.to_le_bytes());
    let mixed = bytes.fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
    });
    Pcg64Mcg::seed_from_u64(mixed)
}

/// Where a value stands in a plant; tables on the way are made where they are not there.
fn place<'a>(plant: &'a mut Table, path: &[String]) -> &'a mut Value {
    let (last, tables) = path.split_last().expect("a key has a name");
    let mut table = plant;
    for name in tables {
        let inner = table
            .entry(name.clone())
            .or_insert_with(|| Value::Table(Table::new()));
        if !inner.is_table() {
            *inner = Value::Table(Table::new());
        }
        table = inner.as_table_mut().expect("it was just made one");
    }
    // A key that is not there and is set is made; one that is drawn was checked to have something to start from.
    table.entry(last.clone()).or_insert(Value::Boolean(false))
}

/// All keys below a table of a fleet.
fn drawn(level: &str, table: &Table, plant: &Table) -> Result<Vec<Drawn>, (String, String)> {
    let mut keys = Vec::new();
    walk(&[], table, plant, &mut keys)
        .map_err(|(path, why)| (format!("{level}.{}", path.join(".")), why))?;
    Ok(keys)
}

fn walk(
    path: &[String],
    table: &Table,
    plant: &Table,
    keys: &mut Vec<Drawn>,
) -> Result<(), (Vec<String>, String)> {
    for (key, value) in table {
        let mut path = path.to_vec();
        path.push(key.clone());
        let law = match value {
            Value::Table(inner) if LAWS.iter().any(|law| inner.contains_key(*law)) => {
                let spread: Spread = inner
                    .clone()
                    .try_into()
                    .map_err(|error: toml::de::Error| (path.clone(), error.message().to_owned()))?;
                spread.check().map_err(|why| (path.clone(), why))?;
                let nominal = path.iter().try_fold(None, |at: Option<&Value>, key| {
                    let table = at.map_or(Some(plant), Value::as_table)?;
                    table.get(key).map(Some)
                });
                if spread.about.is_none() && nominal.is_none() {
                    let why = "the plant has no such key to draw around; accepted is one that it has, or a \
                               distribution with `about`";
                    return Err((path, why.to_owned()));
                }
                Law::Spread(Box::new(spread))
            }
            Value::Table(inner) => {
                walk(&path, inner, plant, keys)?;
                continue;
            }
            value => Law::Set(value.clone()),
        };
        keys.push(Drawn { path, law });
    }
    Ok(())
}

impl Spread {
    fn check(&self) -> Result<(), String> {
        let laws = [
            self.uniform.is_some(),
            self.normal.is_some(),
            self.lognormal.is_some(),
        ];
        if laws.iter().filter(|law| **law).count() != 1 {
            return Err(format!("has several laws; accepted is one of {LAWS:?}"));
        }
        let good = |width: f64| width.is_finite() && width >= 0.0;
        let widths = [&self.uniform, &self.normal].into_iter().flatten();
        for width in widths {
            let (width, _) = quantity(width)?;
            if !good(width) {
                return Err(format!("{width} is no width; accepted is zero or more"));
            }
        }
        if self
            .lognormal
            .is_some_and(|width| !(good(width) && width <= WIDEST))
        {
            return Err(format!("accepted is a lognormal width of 0 to {WIDEST}"));
        }
        if self
            .correlation
            .is_some_and(|by| !(-1.0..=1.0).contains(&by))
        {
            return Err("accepted is a correlation of -1 to 1".to_owned());
        }
        if self.correlation.is_some() && self.with.is_none() {
            return Err("has a correlation; accepted is one beside `with`".to_owned());
        }
        Ok(())
    }

    /// A value around `nominal`; each element of an array by itself.
    fn draw(
        &self,
        nominal: &Value,
        name: &str,
        deviate: &dyn Fn(&str) -> f64,
    ) -> Result<Value, String> {
        if let Value::Array(values) = nominal {
            let each = values.iter().enumerate();
            return each
                .map(|(i, nominal)| self.draw(nominal, &format!("{name}.{i}"), deviate))
                .collect::<Result<_, _>>()
                .map(Value::Array);
        }
        let mut z = deviate(name);
        if let Some(with) = &self.with {
            let by = self.correlation.unwrap_or(1.0);
            z = by * deviate(with) + (1.0 - by * by).sqrt() * z;
        }
        let (middle, unit) = quantity(nominal)?;
        let law = self.law(middle, unit)?;
        let normal = Normal::standard();
        let bound = |bound: &Option<Value>, endless: f64| match bound {
            Some(value) => in_unit(value, unit).map(|at| normal.cdf(law.deviate_of(at))),
            None => Ok(endless),
        };
        let (low, high) = (bound(&self.low, 0.0)?, bound(&self.high, 1.0)?);
        if low > 0.0 || high < 1.0 {
            if high - low < 1e-6 {
                return Err("leaves nothing between `low` and `high`; accepted are bounds that hold more than a \
                            millionth of what is drawn"
                    .to_owned());
            }
            z = normal.inverse_cdf(low + (high - low) * normal.cdf(z));
        }
        let value = law.value_of(z);
        Ok(match unit {
            "" => Value::Float(value),
            unit => Value::String(format!("{value} {unit}")),
        })
    }

    /// The law around a middle, both in a unit.
    fn law(&self, middle: f64, unit: &str) -> Result<At, String> {
        let width = |width: &Value| match width {
            Value::String(_) => in_unit(width, unit),
            // A share of nothing would draw nothing.
            _ if middle == 0.0 && !unit.is_empty() => Err(format!(
                "is drawn about 0 {unit}, of which a share is nothing; accepted is a width in {unit}, such as \"1 {unit}\""
            )),
            share => {
                let of = if middle == 0.0 { 1.0 } else { middle.abs() };
                quantity(share).map(|(share, _)| share * of)
            }
        };
        Ok(match (&self.uniform, &self.normal, self.lognormal) {
            (Some(half), ..) => At::Uniform(middle, width(half)?),
            (_, Some(sigma), _) => At::Normal(middle, width(sigma)?),
            (.., sigma) => At::Lognormal(middle, sigma.unwrap_or(0.0)),
        })
    }
}

/// A law about a middle, as a function of a standard normal deviate.
enum At {
    Uniform(f64, f64),
    Normal(f64, f64),
    Lognormal(f64, f64),
}

impl At {
    fn value_of(&self, z: f64) -> f64 {
        match *self {
            Self::Uniform(middle, half) => middle + half * (2.0 * Normal::standard().cdf(z) - 1.0),
            Self::Normal(middle, sigma) => middle + sigma * z,
            Self::Lognormal(middle, sigma) => middle * (sigma * z).exp(),
        }
    }

    /// The deviate that gives a value.
    fn deviate_of(&self, value: f64) -> f64 {
        match *self {
            Self::Uniform(middle, half) => {
                let share = (0.5 + 0.5 * (value - middle) / half).clamp(0.0, 1.0);
                Normal::standard().inverse_cdf(share)
            }
            Self::Normal(middle, sigma) => (value - middle) / sigma,
            // The logarithm of what is not above zero: nothing is below it.
            Self::Lognormal(middle, sigma) => ((value / middle).max(0.0)).ln() / sigma,
        }
    }
}

/// A number and its unit, empty where it has none.
fn quantity(value: &Value) -> Result<(f64, &str), String> {
    let wrong = || format!("{value} is no number; accepted is one, with its unit where it has one");
    match value {
        Value::Float(number) => Ok((*number, "")),
        Value::Integer(number) => Ok((*number as f64, "")),
        Value::String(text) => {
            let (number, unit) = text.trim().split_once(' ').ok_or_else(wrong)?;
            Ok((number.parse().map_err(|_| wrong())?, unit.trim()))
        }
        _ => Err(wrong()),
    }
}

/// A quantity as a number of a unit.
fn in_unit(value: &Value, unit: &str) -> Result<f64, String> {
    let (number, own) = quantity(value)?;
    if own == unit {
        return Ok(number);
    }
    let both = |dimension: &&Dimension| [own, unit].iter().all(|u| dimension.unit(u).is_some());
    let dimension = DIMENSIONS
        .iter()
        .find(both)
        .ok_or_else(|| format!("{value} is of another kind; accepted is a quantity in {unit}"))?;
    let si = dimension.parse(&format!("{number} {own}"), Sign::Any)?;
    let (_, factor) = dimension.unit(unit).unwrap_or(("", 1.0));
    Ok(si / factor)
}

/// The text of a fleet: of the rig's folder, of the rig that is compiled in, or of a file.
fn source(rig: &str, fleet: &str) -> Result<Source, Error> {
    let of_rig = |folder: PathBuf| folder.join("fleets").join(format!("{fleet}.toml"));
    let folder = rig_folder(rig);
    let candidates = [folder.clone().map(of_rig), Some(PathBuf::from(fleet))];
    if let Some(path) = candidates.into_iter().flatten().find(|path| path.is_file()) {
        return read_file(&path);
    }
    let built_in = BUILT_IN.iter().find(|(name, _)| *name == fleet);
    // A rig of a person's own has the nominal fleet without a file.
    match built_in {
        Some((name, text)) if folder.is_none() || *name == NOMINAL => Ok(Source {
            name: format!("rigs/{DEFAULT_RIG_NAME}/fleets/{name}.toml (built in)"),
            text: (*text).to_owned(),
            role: None,
        }),
        _ => Err(Error::new(
            fleet,
            "",
            format!(
                "no such fleet; accepted is a TOML file, or one of {}",
                names(folder.as_deref())
            ),
        )),
    }
}

/// The fleets of a rig's folder, or of the rig that is compiled in.
fn names(folder: Option<&Path>) -> String {
    let Some(folder) = folder else {
        return BUILT_IN.map(|(name, _)| name).join(", ");
    };
    let mut names: Vec<String> = std::fs::read_dir(folder.join("fleets"))
        .into_iter()
        .flatten()
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let toml = path.extension().is_some_and(|end| end == "toml");
            Some(
                path.file_stem()
                    .filter(|_| toml)?
                    .to_string_lossy()
                    .into_owned(),
            )
        })
        .chain([NOMINAL.to_owned()])
        .collect();
    names.sort();
    names.dedup();
    names.join(", ")
}
