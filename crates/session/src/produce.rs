//! A tray of devices produced on a machine.

use crate::job::{Ended, Job, Order, Work};
use crate::rig::{Rig, Source};
use pigtail_control::calibration::Calibration;
use pigtail_control::kinematics::Kinematics;
use pigtail_cycle::check::mistakes;
use pigtail_cycle::recipe::Production;
use pigtail_cycle::run::{self, Event, Pigtail, Run};
use pigtail_cycle::tray::Tray;
use pigtail_hal::digest::hash;
use pigtail_hal::{Error, Side, Spec};
use pigtail_model::frames::{Chip, Point};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The tray that is compiled in.
pub const DEFAULT_TRAY: &str = "four";

const BUILT_IN: [(&str, &str, &str); 6] = [
    (
        "trays",
        DEFAULT_TRAY,
        include_str!("../../../trays/four.toml"),
    ),
    ("trays", "pairs", include_str!("../../../trays/pairs.toml")),
    (
        "recipes",
        "produce-fast",
        include_str!("../../../recipes/produce-fast.toml"),
    ),
    (
        "recipes",
        "produce-thesis",
        include_str!("../../../recipes/produce-thesis.toml"),
    ),
    (
        "recipes",
        "produce-together",
        include_str!("../../../recipes/produce-together.toml"),
    ),
    (
        "recipes",
        "produce-pair",
        include_str!("../../../recipes/produce-pair.toml"),
    ),
];

/// The text of a file, or of the one of a bare name below a folder, or of one that is compiled in; and how to call it.
fn find(folder: &str, named: &str) -> Result<(String, String), Error> {
    let bare = Path::new(folder).join(format!("{named}.toml"));
    let on_disk = [Path::new(named), &bare]
        .into_iter()
        .find(|path| path.is_file());
    if let Some(path) = on_disk {
        let name = path.display().to_string();
        let text = fs::read_to_string(path)
            .map_err(|why| Error::new(&name, "", format!("cannot be read: {why}")))?;
        return Ok((name, text));
    }
    let of = |(of, name, _): &&(&str, &str, &str)| (*of, *name) == (folder, named);
    let known = BUILT_IN.iter().find(of);
    known.map_or_else(
        || {
            let names = BUILT_IN.iter().filter(|(of, ..)| *of == folder);
            let names: Vec<&str> = names.map(|(_, name, _)| *name).collect();
            let message = format!(
                "no such file; accepted is a TOML file, the name of one below `{folder}`, or one of {names:?}"
            );
            Err(Error::new(named, "", message))
        },
        |(of, name, text)| Ok((format!("{of}/{name}.toml (built in)"), (*text).to_owned())),
    )
}

/// Reads a production recipe by name or file. Returns it with what its file is called and its SHA-256.
///
/// # Errors
///
/// Everything that is wrong with it.
pub fn production(named: &str) -> Result<(Production, (String, String)), Vec<Error>> {
    let (file, text) = find("recipes", named).map_err(|why| vec![why])?;
    let production = parsed(&file, &text)?;
    Ok((production, (file, hash(text))))
}

fn parsed(file: &str, text: &str) -> Result<Production, Vec<Error>> {
    let read = pigtail_hal::config::parse::<Production>(file, text);
    let production = read.map_err(|why| vec![why])?;
    let wrong = production.mistakes(file);
    if wrong.is_empty() {
        Ok(production)
    } else {
        Err(wrong)
    }
}

/// What is said in place of what recipes say of the cure, and of the tray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct InPlace {
    /// Whether the micro follows the light's peak.
    pub track: Option<bool>,
    /// Whether it goes beyond it.
    pub precompensate: Option<bool>,
    /// How often the tray comes, filled anew each time, one right after the other on a machine that goes on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<u32>,
}

/// A tray and its recipes as texts: all that it takes to read them again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Texts {
    /// The tray.
    pub tray: Source,
    /// Its production recipes, by the names that it uses.
    pub recipes: BTreeMap<String, Source>,
    /// What is said in their place.
    pub in_place: InPlace,
}

/// Finds a recipe by its name: how its file is called, and its text.
type Find<'f> = dyn Fn(&str) -> Result<(String, String), Vec<Error>> + 'f;

/// A tray with its recipes, read and checked.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// How the tray's file is called.
    pub file: String,
    /// The tray.
    pub tray: Tray,
    /// Its production recipes, by the names that it uses.
    pub productions: BTreeMap<String, Production>,
    /// Name and SHA-256 of each file that was read.
    pub hashes: Vec<(String, String)>,
    /// The texts of these files.
    pub texts: Texts,
    /// Recipes that could not be read.
    wrong: Vec<Error>,
}

impl Loaded {
    /// Reads a tray by name or file, and its recipes.
    ///
    /// # Errors
    ///
    /// When the tray itself cannot be read. What is wrong with its recipes, [`Self::check`] tells.
    pub fn read(named: &str) -> Result<Self, Error> {
        let (file, text) = find("trays", named)?;
        Self::of(file, &text, InPlace::default(), &|name| {
            find("recipes", name).map_err(|why| vec![why])
        })
    }

    /// Reads again what was read before.
    ///
    /// # Errors
    ///
    /// As [`Self::read`].
    pub fn again(texts: &Texts) -> Result<Self, Error> {
        let Source { name, text, .. } = &texts.tray;
        Self::of(name.clone(), text, texts.in_place, &|name| {
            let missing = || Error::new(name, "", "was not kept");
            let kept = texts.recipes.get(name).ok_or_else(|| vec![missing()])?;
            Ok((kept.name.clone(), kept.text.clone()))
        })
    }

    fn of(file: String, text: &str, in_place: InPlace, find: &Find) -> Result<Self, Error> {
        let source = |name: &str, text: &str| Source {
            name: name.to_owned(),
            text: text.to_owned(),
            role: None,
        };
        let tray = Tray::parse(&file, text)?;
        let mut loaded = Self {
            hashes: vec![(file.clone(), hash(text))],
            texts: Texts {
                tray: source(&file, text),
                recipes: BTreeMap::new(),
                in_place: InPlace::default(),
            },
            file,
            productions: BTreeMap::new(),
            wrong: Vec::new(),
            tray,
        };
        let names: Vec<String> = loaded
            .tray
            .recipes()
            .iter()
            .map(ToString::to_string)
            .collect();
        for name in names {
            let read = find(&name).and_then(|(file, text)| {
                let production = parsed(&file, &text)?;
                Ok((production, source(&file, &text)))
            });
            match read {
                Ok((production, source)) => {
                    loaded
                        .hashes
                        .push((source.name.clone(), hash(&source.text)));
                    loaded.texts.recipes.insert(name.clone(), source);
                    loaded.productions.insert(name, production);
                }
                Err(wrong) => loaded.wrong.extend(wrong),
            }
        }
        loaded.put(in_place);
        Ok(loaded)
    }

    /// Says something of the cure in place of what the recipes say, and how often the tray comes. Without following there is nothing to
    /// go beyond by.
    pub fn put(&mut self, in_place: InPlace) {
        if self.texts.in_place.times.is_none() {
            self.tray.refill(in_place.times.unwrap_or(1));
        }
        self.texts.in_place = in_place;
        for production in self.productions.values_mut() {
            let cure = &mut production.cure;
            cure.track = in_place.track.unwrap_or(cure.track);
            cure.precompensate = in_place.precompensate.unwrap_or(cure.precompensate) && cure.track;
        }
    }

    /// The recipe of the devices and their alignment.
    pub fn device_recipe(&self) -> &str {
        let first = self.productions.values().next();
        first.map_or(crate::rig::DEFAULT_RECIPE_NAME, |p| &p.device)
    }

    /// All that is wrong with tray and recipes on a machine.
    pub fn check(&self, spec: &Spec, calibration: &Calibration) -> Vec<Error> {
        let kinematics = Side::ALL.map(|side| Kinematics::new(spec, calibration, side));
        let reaches = |side: Side, [x, y, z]: [f64; 3]| {
            let k = &kinematics[side.index()];
            k.contains(k.macro_from_chip(Point::<Chip>::new(x, y, z)))
        };
        let mut all = self.wrong.clone();
        all.extend(mistakes(
            &self.file,
            &self.tray,
            &self.productions,
            &reaches,
        ));
        let device = self.device_recipe();
        for (name, production) in &self.productions {
            if production.device != device {
                let message = format!(
                    "is for {}, others of this tray for {device}; accepted is one kind of device on a tray",
                    production.device
                );
                all.push(Error::new(name, "device", message));
            }
        }
        all
    }
}

/// Produce a tray. A fault of the machine is how the device ended to which it happened.
pub struct Produce<'p> {
    /// The tray and its recipes, which were checked.
    pub loaded: &'p Loaded,
    /// The first device that is still to be done.
    pub from: usize,
    /// Fibers that were done before, which have taught what the adhesive does.
    pub taught: &'p [Pigtail],
    /// Who is told what happens.
    pub tell: RefCell<&'p mut dyn FnMut(&Event)>,
}

/// A tray as a record keeps it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// The tray and its recipes.
    pub texts: Texts,
    /// The first device that was still to be done.
    pub from: usize,
    /// Fibers that were done before.
    pub taught: Vec<Pigtail>,
}

/// A tray takes no longer than this for each device, seconds of machine time.
const LONGEST: f64 = 3600.0;

impl Job for Produce<'_> {
    type Output = Run;

    fn run(&self, work: &mut Work<'_>) -> Result<Run, Ended> {
        let rig: &Rig = work.rig();
        let order = run::Order {
            tray: &self.loaded.tray,
            productions: &self.loaded.productions,
            recipe: &rig.recipe,
            from: self.from,
            taught: self.taught,
        };
        let mut tell = self.tell.borrow_mut();
        let mut told = |event: &Event| (**tell)(event);
        let mut station = work.station()?;
        Ok(run::run(&mut station, order, &mut told))
    }

    fn order(&self) -> Order {
        Order::Produce(Box::new(Kept {
            texts: self.loaded.texts.clone(),
            from: self.from,
            taught: self.taught.to_vec(),
        }))
    }

    fn longest(&self) -> f64 {
        LONGEST * self.loaded.tray.devices.len() as f64
    }
}
