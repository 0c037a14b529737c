//! Finding and loading a rig and a recipe, with the hash of everything that was read.

use crate::faults::Faults;
use pigtail_control::calibration::Calibration;
use pigtail_control::recipe::Recipe;
use pigtail_hal::{Axis, Error, Spec};
use pigtail_machines::twin::Plant;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

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

/// The name of the default rig.
pub const DEFAULT_RIG_NAME: &str = "afpm";

/// The recipe that is used where none is named.
const DEFAULT_RECIPE: &str = include_str!("../../../recipes/y-branch.toml");

/// The name of the default recipe.
pub const DEFAULT_RECIPE_NAME: &str = "y-branch";

/// A rig and a recipe, read and checked.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The rig as the user named it.
    pub rig: String,
    /// The recipe as the user named it.
    pub recipe_name: String,
    /// The datasheet.
    pub spec: Spec,
    /// The truth, for the twin.
    pub plant: Plant,
    /// The belief, for control.
    pub calibration: Calibration,
    /// What is to be done.
    pub recipe: Recipe,
    /// The scenario by which the truth was changed.
    pub scenario: String,
    /// What breaks while a twin of this setup runs.
    pub faults: Faults,
    /// The calibration's file; `None` for the one that is compiled in.
    pub calibration_file: Option<PathBuf>,
    /// Name and SHA-256 of each file that was read, in the order of reading.
    pub hashes: Vec<(String, String)>,
}

/// A text and the name by which to call it in errors.
struct Source {
    name: String,
    text: String,
}

impl Setup {
    /// Loads the rig and the recipe that the user named: a folder and a file, or the bare names
    /// of those that are compiled in.
    ///
    /// # Errors
    ///
    /// The first mistake found, with file, key, value and what would be accepted.
    pub fn load(rig: &str, recipe: &str) -> Result<Self, Error> {
        let mut hashes = Vec::new();
        let mut read = |source: Result<Source, Error>| {
            let source = source?;
            hashes.push((source.name.clone(), hash(&source.text)));
            Ok::<_, Error>(source)
        };
        let machine = read(rig_file(rig, 0))?;
        let spec = Spec::parse(&machine.name, &machine.text)?;
        let plant = read(rig_file(rig, 1))?;
        let plant = Plant::parse(&plant.name, &plant.text)?;
        let calibration = read(rig_file(rig, 2))?;
        let mut calibration = Calibration::parse(&calibration.name, &calibration.text, &spec)?;
        if let Some(folder) = rig_folder(rig) {
            for belief in calibration.hysteresis.beliefs() {
                let Some(file) = &belief.weights else {
                    continue;
                };
                let weights = read(read_file(&folder.join(file)))?;
                let model = serde_json::from_str(&weights.text).map_err(|error| {
                    let message = format!("{error}; accepted is what `identify hysteresis` writes");
                    Error {
                        line: Some(error.line()).filter(|line| *line > 0),
                        ..Error::new(&weights.name, "", message)
                    }
                })?;
                belief.load(&weights.name, model)?;
            }
        }
        let source = read(recipe_file(recipe))?;
        let recipe_parsed = Recipe::parse(&source.name, &source.text, &spec, &calibration)?;
        Ok(Self {
            rig: rig.to_owned(),
            recipe_name: recipe.to_owned(),
            spec,
            plant,
            calibration_file: rig_folder(rig).map(|folder| folder.join(DEFAULT_RIG[2].0)),
            calibration,
            recipe: recipe_parsed,
            scenario: "nominal".to_owned(),
            faults: Faults::None,
            hashes,
        })
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

/// The folder of a rig; `None` where there is none of that name.
fn rig_folder(rig: &str) -> Option<PathBuf> {
    [PathBuf::from(rig), PathBuf::from("rigs").join(rig)]
        .into_iter()
        .find(|path| path.is_dir())
}

fn rig_file(rig: &str, index: usize) -> Result<Source, Error> {
    let (file, built_in) = DEFAULT_RIG[index];
    let Some(folder) = rig_folder(rig) else {
        if rig == DEFAULT_RIG_NAME {
            return Ok(Source {
                name: format!("rigs/{rig}/{file} (built in)"),
                text: built_in.to_owned(),
            });
        }
        return Err(Error::new(
            rig,
            "",
            format!(
                "no such rig; accepted is a folder with machine.toml, plant.toml and \
                 calibration.toml, the name of one below `rigs`, or `{DEFAULT_RIG_NAME}`"
            ),
        ));
    };
    read_file(&folder.join(file))
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
        Ok(text) => Ok(Source { name, text }),
        Err(error) => Err(Error::new(name, "", format!("cannot be read: {error}"))),
    }
}

/// SHA-256 of a file's content.
pub(crate) fn hash(content: impl AsRef<[u8]>) -> String {
    use std::fmt::Write as _;
    Sha256::digest(content.as_ref())
        .iter()
        .fold(String::with_capacity(64), |mut hex, byte| {
            let _ = write!(hex, "{byte:02x}");
            hex
        })
}
