//! Finding and loading a rig and a recipe, with the hash of everything that was read.

use crate::calibrations::{self, Belief, newest_date};
#[cfg(feature = "twin")]
use crate::own::Own;
use pigtail_control::calibration::Calibration;
use pigtail_control::recipe::Recipe;
use pigtail_hal::bench::spec::BenchSpec;
use pigtail_hal::digest::hash;
use pigtail_hal::{Axis, Error, Spec};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use toml_edit::{Item, TableLike};

/// The rig that is used where none is named, compiled in, so that the program works wherever it
/// is started.
const DEFAULT_RIG: [(&str, &str); 3] = [
    (
        "machine.toml",
        include_str!("../../../rigs/afpm/machine.toml"),
    ),
    ("plant.toml", include_str!("../../../rigs/afpm/plant.toml")),
    (
        "calibration.toml",
        include_str!("../../../rigs/afpm/calibration.toml"),
    ),
];

/// The bench that is controlled by position, compiled in as well.
const BENCH_RIG: [(&str, &str); 3] = [
    (
        "machine.toml",
        include_str!("../../../rigs/bench-piezo/machine.toml"),
    ),
    (
        "plant.toml",
        include_str!("../../../rigs/bench-piezo/plant.toml"),
    ),
    (
        "calibration.toml",
        include_str!("../../../rigs/bench-piezo/calibration.toml"),
    ),
];

/// The name of the bench that is compiled in.
pub const BENCH_RIG_NAME: &str = "bench-piezo";

/// The files of the rig of a name that is compiled in.
fn built_in(rig: &str) -> Option<&'static [(&'static str, &'static str); 3]> {
    match rig {
        DEFAULT_RIG_NAME => Some(&DEFAULT_RIG),
        BENCH_RIG_NAME => Some(&BENCH_RIG),
        _ => None,
    }
}

/// Whether a rig's files are taken from the program: it is compiled in, and there is no folder of its name.
pub fn is_built_in(rig: &str) -> bool {
    built_in(rig).is_some() && rig_folder(rig).is_none()
}

/// The files of a rig.
pub const FILES: [&str; 3] = [DEFAULT_RIG[0].0, DEFAULT_RIG[1].0, DEFAULT_RIG[2].0];

/// Where the machine that a rig's experiments are compared with departs from the rig's files; a rig may go
/// without.
const MEASURED: (&str, &str) = (
    "measured.toml",
    include_str!("../../../rigs/afpm/measured.toml"),
);

/// A file of this name in a rig's folder says that it is the rig as it ships, to which nothing is ever written.
const SHIPPED: &str = "shipped";

/// The name of the default rig.
pub const DEFAULT_RIG_NAME: &str = "afpm";

/// The recipe that is used where none is named.
const DEFAULT_RECIPE: &str = include_str!("../../../recipes/y-branch.toml");

/// The name of the default recipe.
pub const DEFAULT_RECIPE_NAME: &str = "y-branch";

/// What is known of a machine beforehand, datasheet and belief, and what is to be done on it: read and
/// checked. It knows of no truth; see [`Setup`](crate::setup::Setup) for a rig with a twin.
#[derive(Debug, Clone)]
pub struct Rig {
    /// The rig as the user named it.
    pub name: String,
    /// The recipe as the user named it.
    pub recipe_name: String,
    /// The datasheet.
    pub spec: Spec,
    /// The belief, for control.
    pub calibration: Calibration,
    /// What is to be done.
    pub recipe: Recipe,
    /// The newest date in the calibration's file.
    pub calibration_date: Option<String>,
    /// The calibration that was named in place of the rig's own.
    pub believing: Option<PathBuf>,
    /// Name and SHA-256 of each file that was read, in the order of reading.
    pub hashes: Vec<(String, String)>,
    /// What was read, in that order: all that it takes to set up the same again.
    pub sources: Vec<Source>,
}

/// A text and the name by which to call it in errors.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// The name.
    pub name: String,
    /// The text.
    pub text: String,
    /// What it is of a rig. What was kept before this was said has it from its place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub role: Option<Role>,
}

/// What a file is of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// `machine.toml`, the datasheet.
    Machine,
    /// `plant.toml`, the truth; only a rig with a twin has it.
    Plant,
    /// `calibration.toml`, the belief.
    Calibration,
    /// Weights of a model, beside the calibration.
    Weights,
    /// The recipe.
    Recipe,
}

/// What to load: a rig and a recipe, and what is to be other than in the rig's folder.
#[derive(Debug, Clone, Copy, Default)]
pub struct Named<'n> {
    /// A folder, or the name of the rig that is compiled in.
    pub rig: &'n str,
    /// A file, or the name of the recipe that is compiled in.
    pub recipe: &'n str,
    /// A calibration in place of the rig's.
    pub calibration: Option<&'n Path>,
    /// Tables of the calibration that are not believed, as they are about to be replaced: nothing of them is
    /// read, not even whether it is well.
    pub without: &'n [&'n str],
}

/// A file that a rig is made of.
enum Wanted<'a> {
    /// One of the rig's three.
    Rig(usize),
    /// Weights of a model, beside the calibration.
    Weights(&'a str),
    /// The recipe.
    Recipe,
}

impl Wanted<'_> {
    fn role(&self) -> Role {
        match self {
            Self::Rig(0) => Role::Machine,
            Self::Rig(1) => Role::Plant,
            Self::Rig(_) => Role::Calibration,
            Self::Weights(_) => Role::Weights,
            Self::Recipe => Role::Recipe,
        }
    }
}

impl Rig {
    /// Loads the rig and the recipe that the user named: a folder and a file, or the bare names
    /// of those that are compiled in.
    ///
    /// # Errors
    ///
    /// The first mistake found, with file, key, value and what would be accepted.
    pub fn load(rig: &str, recipe: &str) -> Result<Self, Error> {
        Self::load_named(&Named {
            rig,
            recipe,
            ..Named::default()
        })
    }

    /// The same, believing another calibration, or less of it.
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn load_named(named: &Named) -> Result<Self, Error> {
        let setup = Self::read(named, |wanted| match wanted {
            Wanted::Rig(index) => rig_file(named, index),
            Wanted::Weights(file) => weights(named, file),
            Wanted::Recipe => recipe_file(named.recipe).map(Some),
        })?;
        Ok(Self {
            believing: named.calibration.map(Path::to_owned),
            ..setup
        })
    }

    /// Sets up again what was read before, from its [`Self::sources`].
    ///
    /// # Errors
    ///
    /// When they are not those of a rig.
    pub fn from_sources(rig: &str, recipe: &str, sources: Vec<Source>) -> Result<Self, Error> {
        let all = sources.len();
        let last = all.saturating_sub(1);
        let placed = |(place, source): (usize, Source)| {
            let role = source.role.unwrap_or(match place {
                0 => Role::Machine,
                1 => Role::Plant,
                2 => Role::Calibration,
                _ if place == last => Role::Recipe,
                _ => Role::Weights,
            });
            Source {
                role: Some(role),
                ..source
            }
        };
        let mut sources: Vec<Source> = sources.into_iter().enumerate().map(placed).collect();
        let named = Named {
            rig,
            recipe,
            ..Named::default()
        };
        Self::read(&named, |wanted| {
            let role = wanted.role();
            let place = sources.iter().position(|source| source.role == Some(role));
            match (place, role) {
                (Some(place), _) => Ok(Some(sources.remove(place))),
                // A calibration without weights that were read has none to be read here.
                (None, Role::Weights | Role::Plant) => Ok(None),
                (None, _) => Err(Error::new(
                    rig,
                    "",
                    format!("{all} files were kept; accepted is all that was read"),
                )),
            }
        })
    }

    /// Loads a rig with axes of a person's own in place of the rig's. Its calibration is then nobody's file.
    /// On a `bench` the axes are measured by the rig's probes; at work they have none.
    ///
    /// # Errors
    ///
    /// As [`Self::load`]; and where the axes and the rig make no machine together.
    #[cfg(feature = "twin")]
    pub fn load_with(named: &Named, own: &Own, bench: bool) -> Result<Self, Error> {
        if own.is_empty() {
            return Self::load_named(named);
        }
        let files = rig_files(named, own, bench)?;
        let mut loaded = Self::read(named, |wanted| match wanted {
            Wanted::Rig(index) => Ok(Some(files[index].clone())),
            Wanted::Weights(file) => weights(named, file),
            Wanted::Recipe => recipe_file(named.recipe).map(Some),
        })
        .map_err(|mut error| {
            if error.key.ends_with("speed") {
                error.message += "; an axis of your own goes no faster than its record shows it";
            }
            error
        })?;
        loaded.name = format!("{} with {}", named.rig, own.names());
        Ok(loaded)
    }

    fn read(
        named: &Named,
        mut file: impl FnMut(Wanted) -> Result<Option<Source>, Error>,
    ) -> Result<Self, Error> {
        let (rig, recipe) = (named.rig, named.recipe);
        let (mut sources, mut hashes, mut date) = (Vec::new(), Vec::new(), None);
        let mut read = |wanted: Wanted| {
            let role = wanted.role();
            let mut source = file(wanted)?;
            if let Some(source) = &mut source {
                source.role = Some(role);
                hashes.push((source.name.clone(), hash(&source.text)));
                if role == Role::Calibration {
                    date = newest_date(&source.text);
                    source.text = Belief::without(&source.text, named.without);
                }
            }
            sources.extend(source.clone());
            Ok::<_, Error>(source)
        };
        let missing = || Error::new(rig, "", "is not whole".to_owned());
        let machine = read(Wanted::Rig(0))?.ok_or_else(missing)?;
        if BenchSpec::is_of(&machine.name, &machine.text)? {
            return Err(Error::new(
                &machine.name,
                "kind",
                "is \"bench\", which is controlled by position; accepted here is a machine of volts, which has no kind \
                 (`align`, `campaign` and `rig check` take benches too)",
            ));
        }
        let spec = Spec::parse(&machine.name, &machine.text)?;
        // The truth is nobody's business here: it is kept for whoever draws a twin.
        read(Wanted::Rig(1))?;
        let calibration = read(Wanted::Rig(2))?.ok_or_else(missing)?;
        let mut calibration = Calibration::parse(&calibration.name, &calibration.text, &spec)?;
        for belief in calibration.hysteresis.beliefs() {
            let Some(file) = &belief.weights else {
                continue;
            };
            let Some(weights) = read(Wanted::Weights(file))? else {
                continue;
            };
            let model = serde_json::from_str(&weights.text).map_err(|error| {
                let message = format!("{error}; accepted is what `identify hysteresis` writes");
                Error {
                    line: Some(error.line()).filter(|line| *line > 0),
                    ..Error::new(&weights.name, "", message)
                }
            })?;
            belief.load(&weights.name, model)?;
        }
        let source = read(Wanted::Recipe)?
            .ok_or_else(|| Error::new(recipe, "", "is not there".to_owned()))?;
        let parsed = Recipe::parse(&source.name, &source.text, &spec, &calibration)?;
        Ok(Self {
            name: rig.to_owned(),
            recipe_name: recipe.to_owned(),
            spec,
            calibration_date: date,
            believing: None,
            calibration,
            recipe: parsed,
            hashes,
            sources,
        })
    }

    /// The same rig with what its `measured.toml` changes of plant and calibration; the rig itself where there
    /// is no such file.
    ///
    /// # Errors
    ///
    /// When it is not TOML, has other tables than `plant` and `calibration`, or makes no rig of them.
    pub fn measured(&self) -> Result<Self, Error> {
        let (file, built_in) = MEASURED;
        let source = match rig_folder(&self.name).map(|folder| folder.join(file)) {
            Some(path) if path.is_file() => read_file(&path)?,
            None if self.name == DEFAULT_RIG_NAME => Source {
                name: format!("rigs/{}/{file} (built in)", self.name),
                text: built_in.to_owned(),
                role: None,
            },
            _ => return Ok(self.clone()),
        };
        let mut rig = self.clone();
        for (table, changes) in document(&source)?.iter() {
            let of = [("plant", Role::Plant), ("calibration", Role::Calibration)];
            let role = of.iter().find(|(name, _)| *name == table);
            let Some(((_, role), changes)) = role.zip(changes.as_table_like()) else {
                let message = "is no table of this file; accepted is plant or calibration";
                return Err(Error::new(&source.name, table, message));
            };
            rig = rig.changed(*role, changes, &source.name)?;
        }
        rig.hashes.clone_from(&self.hashes);
        rig.believing.clone_from(&self.believing);
        rig.hashes.push((source.name, hash(&source.text)));
        Ok(rig)
    }

    /// The same rig with another datasheet, of its own kind; `from` is where that comes from. Hashes are those
    /// of before.
    ///
    /// # Errors
    ///
    /// When that makes no rig.
    #[cfg(feature = "twin")]
    pub(crate) fn with_datasheet(
        &self,
        datasheet: &toml::Table,
        from: &str,
    ) -> Result<Self, Error> {
        let text =
            toml::to_string(datasheet).map_err(|error| Error::new(from, "", error.to_string()))?;
        let mut sources = self.sources.clone();
        if let Some(file) = sources
            .iter_mut()
            .find(|source| source.role == Some(Role::Machine))
        {
            file.name = format!("{} with {from}", file.name);
            file.text = text;
        }
        let rig = Self::from_sources(&self.name, &self.recipe_name, sources)?;
        Ok(Self {
            hashes: self.hashes.clone(),
            believing: self.believing.clone(),
            ..rig
        })
    }

    /// The same rig, believing something else. Hashes are those of before.
    ///
    /// # Errors
    ///
    /// When that is no belief about it.
    pub fn with_belief(&self, belief: &Belief) -> Result<Self, Error> {
        let others =
            |source: &&Source| !matches!(source.role, Some(Role::Calibration | Role::Weights));
        let mut sources: Vec<Source> = self.sources.iter().filter(others).cloned().collect();
        sources.extend(belief.files().map(|(file, text)| Source {
            name: file.to_owned(),
            text: text.to_owned(),
            role: Some(if file == calibrations::FILE {
                Role::Calibration
            } else {
                Role::Weights
            }),
        }));
        let rig = Self::from_sources(&self.name, &self.recipe_name, sources)?;
        Ok(Self {
            hashes: self.hashes.clone(),
            ..rig
        })
    }

    /// What it believes.
    pub fn belief(&self) -> Belief {
        let believed = |source: &&Source| source.role == Some(Role::Calibration);
        let found = self.sources.iter().find(believed);
        let text = found.map_or_else(String::new, |source| source.text.clone());
        let mut belief = Belief::of(calibrations::FILE, text, |_| None);
        belief.weights = self
            .weights()
            .map(|(file, text)| (file.to_owned(), text.to_owned()))
            .collect();
        belief
    }

    /// The datasheet as it was read.
    #[cfg(feature = "twin")]
    pub(crate) fn datasheet(&self) -> &Source {
        let datasheet = |source: &&Source| source.role == Some(Role::Machine);
        let found = self.sources.iter().find(datasheet);
        found.expect("a rig has a datasheet")
    }

    fn changed(&self, role: Role, changes: &dyn TableLike, from: &str) -> Result<Self, Error> {
        let mut sources = self.sources.clone();
        if let Some(file) = sources.iter_mut().find(|source| source.role == Some(role)) {
            let mut whole = document(file)?;
            put(whole.as_table_mut(), changes);
            file.name = format!("{} with {from}", file.name);
            file.text = whole.to_string();
        }
        Self::from_sources(&self.name, &self.recipe_name, sources)
    }

    /// The weights of models beside the calibration: names of files, and their texts.
    pub fn weights(&self) -> impl Iterator<Item = (&str, &str)> {
        self.sources
            .iter()
            .filter(|source| source.role == Some(Role::Weights))
            .map(|source| {
                let name = Path::new(&source.name).file_name().and_then(|n| n.to_str());
                (name.unwrap_or(&source.name), source.text.as_str())
            })
    }

    /// The truth that a twin of this rig is drawn around; `None` on a rig without one.
    pub fn truth(&self) -> Option<&Source> {
        let truth = |source: &&Source| source.role == Some(Role::Plant);
        self.sources.iter().find(truth)
    }

    /// Range of an axis in encoder counts.
    pub fn range_counts(&self, axis: Axis) -> f64 {
        let drive = self.spec.drive(axis);
        let geometry = &self.calibration.geometry;
        let turns = match axis {
            // The endpoint moves by about the length of a proximal link for a radian.
            Axis::A | Axis::B => {
                self.spec.five_bar.workspace / geometry.five_bar.proximal / std::f64::consts::TAU
            }
            Axis::Z => self.spec.z_stage.travel / geometry.z.lead,
        };
        turns * drive.gear_ratio * f64::from(drive.counts_per_turn)
    }
}

fn document(source: &Source) -> Result<toml_edit::DocumentMut, Error> {
    source
        .text
        .parse()
        .map_err(|e| Error::new(&source.name, "", format!("is not TOML: {e}")))
}

/// Sets keys of a table, and of the tables in it.
fn put(into: &mut dyn TableLike, changes: &dyn TableLike) {
    for (key, change) in changes.iter() {
        if let Some(changes) = change.as_table_like()
            && let Some(into) = into.get_mut(key).and_then(Item::as_table_like_mut)
        {
            put(into, changes);
        } else {
            into.insert(key, change.clone());
        }
    }
}

/// The folder of a rig; `None` where there is none of that name.
pub(crate) fn rig_folder(rig: &str) -> Option<PathBuf> {
    [PathBuf::from(rig), PathBuf::from("rigs").join(rig)]
        .into_iter()
        .find(|path| path.is_dir())
}

/// The file that marks a folder as the rig that ships, if there is one.
pub(crate) fn shipped(folder: &Path) -> Option<PathBuf> {
    Some(folder.join(SHIPPED)).filter(|marker| marker.exists())
}

/// The calibration that is named, as it stands in its files.
///
/// # Errors
///
/// When it cannot be read.
pub fn belief(named: &Named) -> Result<Belief, Error> {
    let missing = || Error::new(named.rig, "", "is not whole".to_owned());
    let source = rig_file(named, 2)?.ok_or_else(missing)?;
    Ok(Belief::of(&source.name, source.text, |file| {
        let source = weights(named, file).ok()?;
        source.map(|source| source.text)
    }))
}

/// A file of weights beside the calibration that is named; `None` for the rig that is compiled in.
fn weights(named: &Named, file: &str) -> Result<Option<Source>, Error> {
    let path = match named.calibration {
        Some(calibration) => Some(calibration.with_file_name(file)),
        None => rig_folder(named.rig).map(|folder| folder.join(file)),
    };
    path.map(|path| read_file(&path)).transpose()
}

/// The three files of a rig, with axes of a person's own.
///
/// # Errors
///
/// As [`Rig::load_with`]; when the rig has no truth.
#[cfg(feature = "twin")]
pub fn rig_files(named: &Named, own: &Own, bench: bool) -> Result<[Source; 3], Error> {
    let file = |index| rig_file(named, index)?.ok_or_else(|| no_twin(named.rig));
    let mut files = [file(0)?, file(1)?, file(2)?];
    own.put(&mut files, bench)?;
    Ok(files)
}

/// One of the rig's three files; `None` for the truth of a rig that has no twin.
pub(crate) fn rig_file(named: &Named, index: usize) -> Result<Option<Source>, Error> {
    let rig = named.rig;
    let file = FILES[index];
    if index == 2
        && let Some(calibration) = named.calibration
    {
        return read_file(calibration).map(Some);
    }
    let Some(folder) = rig_folder(rig) else {
        if let Some(files) = built_in(rig) {
            return Ok(Some(Source {
                name: format!("rigs/{rig}/{file} (built in)"),
                text: files[index].1.to_owned(),
                role: None,
            }));
        }
        return Err(Error::new(
            rig,
            "",
            format!(
                "no such rig; accepted is a folder with machine.toml and calibration.toml (and \
                 plant.toml, if it has a twin), the name of one below `rigs`, or `{DEFAULT_RIG_NAME}` or \
                 `{BENCH_RIG_NAME}`"
            ),
        ));
    };
    let path = folder.join(file);
    if index == 1 && !path.exists() {
        return Ok(None);
    }
    read_file(&path).map(Some)
}

/// The error of asking for a twin of a rig that has none.
pub fn no_twin(rig: &str) -> Error {
    Error::new(
        format!("{rig}/{}", FILES[1]),
        "",
        "is not there: this rig has no twin to run on; accepted is a rig with a plant.toml, or a machine",
    )
}

pub(crate) fn recipe_file(recipe: &str) -> Result<Source, Error> {
    let bare = Path::new("recipes").join(format!("{recipe}.toml"));
    if Path::new(recipe).is_file() {
        read_file(Path::new(recipe))
    } else if bare.is_file() {
        read_file(&bare)
    } else if recipe == DEFAULT_RECIPE_NAME {
        Ok(Source {
            name: format!("recipes/{recipe}.toml (built in)"),
            text: DEFAULT_RECIPE.to_owned(),
            role: None,
        })
    } else if Path::new(recipe).is_dir() {
        Err(Error::new(
            recipe,
            "",
            "is a folder; accepted is a TOML file",
        ))
    } else {
        Err(Error::new(
            recipe,
            "",
            format!(
                "no such recipe; accepted is a TOML file, the name of one below `recipes`, or \
                 `{DEFAULT_RECIPE_NAME}`"
            ),
        ))
    }
}

pub(crate) fn read_file(path: &Path) -> Result<Source, Error> {
    let name = path.display().to_string();
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(Source {
            name,
            text,
            role: None,
        }),
        Err(error) => Err(Error::new(name, "", format!("cannot be read: {error}"))),
    }
}
