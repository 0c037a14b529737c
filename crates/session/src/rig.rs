//! Finding and loading a rig and a recipe, with the hash of everything that was read.

#[cfg(feature = "twin")]
use crate::own::Own;
use pigtail_control::calibration::Calibration;
use pigtail_control::recipe::Recipe;
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

/// The files of a rig.
pub const FILES: [&str; 3] = [DEFAULT_RIG[0].0, DEFAULT_RIG[1].0, DEFAULT_RIG[2].0];

/// Where the machine that a rig's experiments are compared with departs from the rig's files; a rig may go
/// without.
const MEASURED: (&str, &str) = (
    "measured.toml",
    include_str!("../../../rigs/afpm/measured.toml"),
);

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
    /// The calibration's file; `None` for the one that is compiled in.
    pub calibration_file: Option<PathBuf>,
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
        let setup = Self::read(rig, recipe, |wanted| match wanted {
            Wanted::Rig(index) => rig_file(rig, index),
            Wanted::Weights(file) => rig_folder(rig)
                .map(|folder| read_file(&folder.join(file)))
                .transpose(),
            Wanted::Recipe => recipe_file(recipe).map(Some),
        })?;
        Ok(Self {
            calibration_file: rig_folder(rig).map(|folder| folder.join(DEFAULT_RIG[2].0)),
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
        Self::read(rig, recipe, |wanted| {
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
    pub fn load_with(rig: &str, recipe: &str, own: &Own, bench: bool) -> Result<Self, Error> {
        if own.is_empty() {
            return Self::load(rig, recipe);
        }
        let files = rig_files(rig, own, bench)?;
        let mut loaded = Self::read(rig, recipe, |wanted| match wanted {
            Wanted::Rig(index) => Ok(Some(files[index].clone())),
            Wanted::Weights(file) => rig_folder(rig)
                .map(|folder| read_file(&folder.join(file)))
                .transpose(),
            Wanted::Recipe => recipe_file(recipe).map(Some),
        })
        .map_err(|mut error| {
            if error.key.ends_with("speed") {
                error.message += "; an axis of your own goes no faster than its record shows it";
            }
            error
        })?;
        loaded.name = format!("{rig} with {}", own.names());
        Ok(loaded)
    }

    fn read(
        rig: &str,
        recipe: &str,
        mut file: impl FnMut(Wanted) -> Result<Option<Source>, Error>,
    ) -> Result<Self, Error> {
        let mut sources = Vec::new();
        let mut read = |wanted: Wanted| {
            let role = wanted.role();
            let mut source = file(wanted)?;
            if let Some(source) = &mut source {
                source.role = Some(role);
            }
            sources.extend(source.clone());
            Ok::<_, Error>(source)
        };
        let missing = || Error::new(rig, "", "is not whole".to_owned());
        let machine = read(Wanted::Rig(0))?.ok_or_else(missing)?;
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
            calibration_file: None,
            calibration,
            recipe: parsed,
            hashes: sources
                .iter()
                .map(|source| (source.name.clone(), hash(&source.text)))
                .collect(),
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
        let document = |source: &Source| -> Result<toml_edit::DocumentMut, Error> {
            source
                .text
                .parse()
                .map_err(|e| Error::new(&source.name, "", format!("is not TOML: {e}")))
        };
        let mut sources = self.sources.clone();
        for (table, changes) in document(&source)?.iter() {
            let of = [("plant", Role::Plant), ("calibration", Role::Calibration)];
            let changed = of.iter().find(|(name, _)| *name == table);
            let changed = changed.and_then(|(_, role)| {
                let place = sources.iter().position(|s| s.role == Some(*role));
                place.zip(changes.as_table_like())
            });
            let Some((index, changes)) = changed else {
                let message = "is no table of this file; accepted is plant or calibration";
                return Err(Error::new(&source.name, table, message));
            };
            let mut whole = document(&sources[index])?;
            put(whole.as_table_mut(), changes);
            let name = &sources[index].name;
            sources[index].name = format!("{name} with {}", source.name);
            sources[index].text = whole.to_string();
        }
        let mut rig = Self::from_sources(&self.name, &self.recipe_name, sources)?;
        rig.hashes.clone_from(&self.hashes);
        rig.hashes.push((source.name, hash(&source.text)));
        Ok(rig)
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

    /// Writes a file beside the rig's calibration, whole or not at all. Returns its name, or `None`
    /// for the rig that is compiled in.
    ///
    /// # Errors
    ///
    /// When it cannot be written.
    pub fn write_beside_calibration(
        &self,
        file: &str,
        content: &str,
    ) -> Result<Option<String>, Error> {
        let Some(calibration) = &self.calibration_file else {
            return Ok(None);
        };
        let path = calibration.with_file_name(file);
        let partial = path.with_extension(format!("json.partial-{}", std::process::id()));
        let name = path.display().to_string();
        std::fs::write(&partial, content)
            .and_then(|()| std::fs::rename(&partial, &path))
            .map_err(|error| Error::new(&name, "", format!("cannot be written: {error}")))?;
        Ok(Some(name))
    }

    /// Sets keys of a table of the rig's calibration, and leaves the rest of the file as a person
    /// wrote it. Returns the file's name, or `None` for the rig that is compiled in.
    ///
    /// # Errors
    ///
    /// When the file cannot be read or written. It is replaced whole or not at all.
    pub fn write_calibration(
        &self,
        table: &str,
        values: &[(&str, toml_edit::Item)],
    ) -> Result<Option<String>, Error> {
        let Some(path) = &self.calibration_file else {
            return Ok(None);
        };
        let name = path.display().to_string();
        let failed = |what: &str, error: &dyn std::fmt::Display| {
            Error::new(&name, table, format!("{what}: {error}"))
        };
        let text = std::fs::read_to_string(path).map_err(|e| failed("cannot be read", &e))?;
        let mut document: toml_edit::DocumentMut =
            text.parse().map_err(|e| failed("is not TOML", &e))?;
        let mut item = document.as_item_mut();
        for key in table.split('.') {
            item = &mut item[key];
            if item.is_none() {
                // A table that only holds tables needs no header of its own.
                let mut new = toml_edit::Table::new();
                new.set_implicit(true);
                *item = toml_edit::Item::Table(new);
            }
        }
        for (key, value) in values {
            item[key] = value.clone();
        }
        let partial = path.with_extension(format!("toml.partial-{}", std::process::id()));
        std::fs::write(&partial, document.to_string())
            .and_then(|()| std::fs::rename(&partial, path))
            .map_err(|e| failed("cannot be written", &e))?;
        Ok(Some(name))
    }
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
fn rig_folder(rig: &str) -> Option<PathBuf> {
    [PathBuf::from(rig), PathBuf::from("rigs").join(rig)]
        .into_iter()
        .find(|path| path.is_dir())
}

/// The three files of a rig, with axes of a person's own.
///
/// # Errors
///
/// As [`Rig::load_with`]; when the rig has no truth.
#[cfg(feature = "twin")]
pub fn rig_files(rig: &str, own: &Own, bench: bool) -> Result<[Source; 3], Error> {
    let file = |index| rig_file(rig, index)?.ok_or_else(|| no_twin(rig));
    let mut files = [file(0)?, file(1)?, file(2)?];
    own.put(&mut files, bench)?;
    Ok(files)
}

/// One of the rig's three files; `None` for the truth of a rig that has no twin.
fn rig_file(rig: &str, index: usize) -> Result<Option<Source>, Error> {
    let (file, built_in) = DEFAULT_RIG[index];
    let Some(folder) = rig_folder(rig) else {
        if rig == DEFAULT_RIG_NAME {
            return Ok(Some(Source {
                name: format!("rigs/{rig}/{file} (built in)"),
                text: built_in.to_owned(),
                role: None,
            }));
        }
        return Err(Error::new(
            rig,
            "",
            format!(
                "no such rig; accepted is a folder with machine.toml and calibration.toml (and \
                 plant.toml, if it has a twin), the name of one below `rigs`, or `{DEFAULT_RIG_NAME}`"
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

fn recipe_file(recipe: &str) -> Result<Source, Error> {
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

fn read_file(path: &Path) -> Result<Source, Error> {
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
