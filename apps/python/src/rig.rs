//! A rig and a recipe, as every call takes them.

use crate::failure::Failure;
use crate::input::{choice, refused};
use pigtail_control::station::{Observer, Sample};
use pigtail_hal::Error;
use pigtail_session::calibrations::{self, Change, RunsOn, find};
use pigtail_session::own::Own;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, Named, Role};
use pigtail_session::scenario::Scenario;
use pigtail_session::setup::Setup;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// A rig, a recipe, and what is believed and drawn of them.
#[pyclass(frozen, module = "pigtail._pigtail")]
#[derive(Debug, Clone)]
pub(crate) struct Rig {
    named: Names,
    known: pigtail_session::Rig,
    /// Gone where the rig has no twin.
    setup: Option<Setup>,
}

#[derive(Debug, Clone)]
struct Names {
    rig: String,
    recipe: String,
    fleet: String,
    calibration: Option<PathBuf>,
    scenario: Scenario,
    axes: Own,
    /// What is believed in place of the rig's files.
    belief: Option<calibrations::Belief>,
}

impl Names {
    fn load(&self, bench: bool, without: &[&str]) -> Result<pigtail_session::Rig, Error> {
        let named = Named {
            rig: &self.rig,
            recipe: &self.recipe,
            calibration: self.calibration.as_deref(),
            without,
        };
        let rig = pigtail_session::Rig::load_with(&named, &self.axes, bench)?;
        match &self.belief {
            Some(belief) => {
                // Read again, so that its hashes are those of what is believed.
                let believing = rig.with_belief(belief)?;
                pigtail_session::Rig::from_sources(&rig.name, &rig.recipe_name, believing.sources)
            }
            None => Ok(rig),
        }
    }

    fn setup(&self, rig: pigtail_session::Rig) -> Result<Setup, Error> {
        let mut setup = Setup::of(rig)?.of_fleet(&self.fleet)?;
        self.scenario.apply(&mut setup);
        Ok(setup)
    }

    fn open(self) -> Result<Rig, Error> {
        let rig = self.load(false, &[])?;
        let setup = match rig.truth() {
            Some(_) => Some(self.setup(rig.clone())?),
            None => None,
        };
        Ok(Rig {
            known: rig,
            setup,
            named: self,
        })
    }
}

impl Rig {
    /// The rig with its truth, to draw twins around.
    pub(crate) fn setup(&self) -> Result<Setup, Error> {
        match &self.setup {
            Some(setup) => Ok(setup.clone()),
            None => Err(pigtail_session::rig::no_twin(&self.named.rig)),
        }
    }

    /// The same for an experiment on one axis, on a bench if that is one's own, and without tables of the
    /// calibration that are to be found anew.
    pub(crate) fn bench(&self, without: &[&str]) -> Result<Setup, Error> {
        if self.named.axes.is_empty() && without.is_empty() {
            return self.setup();
        }
        self.named.setup(self.named.load(true, without)?)
    }

    /// The same rig with the recipe that a tray's devices have. One's own of another device is refused.
    pub(crate) fn making(&self, recipe: &str) -> Result<Self, Failure> {
        let named = &self.named.recipe;
        if named == recipe {
            return Ok(self.clone());
        }
        if named != DEFAULT_RECIPE_NAME {
            let message = format!("is \"{named}\"; accepted is what the tray is for, \"{recipe}\"");
            return Err(refused("recipe", named, message).into());
        }
        let mut names = self.named.clone();
        recipe.clone_into(&mut names.recipe);
        Ok(names.open()?)
    }

    /// What is believed of it.
    pub(crate) fn believed(&self) -> calibrations::Belief {
        self.known.belief()
    }

    /// Axes of a person's own in it.
    pub(crate) fn axes(&self) -> &Own {
        &self.named.axes
    }

    /// What is believed with what was found.
    pub(crate) fn found(&self, changes: &[Change]) -> Result<Belief, Failure> {
        let mut belief = self.believed();
        for change in changes {
            belief.change(change)?;
        }
        "what was found".clone_into(&mut belief.name);
        belief.check(&self.known.spec)?;
        Ok(Belief(belief))
    }
}

#[pymethods]
impl Rig {
    #[new]
    #[pyo3(signature = (rig, recipe, fleet, calibration, scenario, axes, runs))]
    fn new(
        py: Python<'_>,
        rig: String,
        recipe: String,
        fleet: String,
        calibration: Option<&str>,
        scenario: &str,
        axes: Vec<PathBuf>,
        runs: PathBuf,
    ) -> PyResult<Self> {
        let open = || -> Result<Self, Failure> {
            let scenario = choice("scenario", scenario)?;
            let found = calibration
                .map(|named| find(&rig, named, &runs))
                .transpose()?;
            let names = Names {
                calibration: found.map(|found| found.file),
                axes: Own::read(&axes)?,
                rig,
                recipe,
                fleet,
                scenario,
                belief: None,
            };
            Ok(names.open()?)
        };
        open().map_err(|failure| failure.raise(py))
    }

    /// The same rig, believing something else.
    fn with_belief(&self, py: Python<'_>, belief: &Belief) -> PyResult<Self> {
        let mut names = self.named.clone();
        names.belief = Some(belief.0.clone());
        names.open().map_err(|error| Failure::from(error).raise(py))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.named.rig
    }

    #[getter]
    fn recipe(&self) -> &str {
        &self.named.recipe
    }

    #[getter]
    fn fleet(&self) -> &str {
        &self.named.fleet
    }

    #[getter]
    fn scenario(&self) -> &'static str {
        self.named.scenario.name()
    }

    #[getter]
    fn has_twin(&self) -> bool {
        self.setup.is_some()
    }

    #[getter]
    fn rate_hz(&self) -> f64 {
        self.known.spec.servo.rate
    }

    /// Name and SHA-256 of what was read.
    #[getter]
    fn hashes(&self) -> Vec<(String, String)> {
        self.known.hashes.clone()
    }

    /// Name, role and text of what was read, without the truth.
    fn sources(&self) -> Vec<(String, String)> {
        let told = |role: Option<Role>| role != Some(Role::Plant);
        let sources = self.known.sources.iter().filter(|source| told(source.role));
        sources
            .map(|source| (source.name.clone(), source.text.clone()))
            .collect()
    }

    /// The truth, for those who ask through `pigtail.sim`.
    fn truth(&self) -> Option<(String, String)> {
        let truth = self.known.truth()?;
        Some((truth.name.clone(), truth.text.clone()))
    }

    fn runs_on(&self) -> String {
        RunsOn::of(&self.known).to_string()
    }

    fn belief(&self) -> Belief {
        Belief(self.believed())
    }
}

/// What is believed of a rig: a calibration as it stands in its files.
#[pyclass(frozen, module = "pigtail._pigtail")]
#[derive(Debug, Clone)]
pub(crate) struct Belief(pub(crate) calibrations::Belief);

#[pymethods]
impl Belief {
    /// Of its parts.
    #[new]
    fn new(name: String, text: String, weights: Vec<(String, String)>) -> Self {
        Self(calibrations::Belief {
            name,
            text,
            weights,
        })
    }

    /// What it is called, its text, and name and content of its weights: from these it is made again.
    fn parts(&self) -> (&str, &str, Vec<(String, String)>) {
        (&self.0.name, &self.0.text, self.0.weights.clone())
    }

    /// File names and texts.
    fn files(&self) -> Vec<(String, String)> {
        let files = self.0.files();
        files
            .map(|(file, text)| (file.to_owned(), text.to_owned()))
            .collect()
    }

    /// Writes the files into a folder, each whole or not at all.
    fn write(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let write = |folder: &Path| -> std::io::Result<()> {
            std::fs::create_dir_all(folder)?;
            for (file, text) in self.0.files() {
                let partial = folder.join(format!(".{file}.partial"));
                std::fs::write(&partial, text)?;
                std::fs::rename(&partial, folder.join(file))?;
            }
            Ok(())
        };
        write(&folder).map_err(|error| {
            let message = format!("cannot be written: {error}");
            Failure::from(Error::new(folder.display().to_string(), "", message)).raise(py)
        })
    }
}

/// Tells of phases and trials.
pub(crate) struct Told<'w> {
    pub(crate) watch: &'w crate::work::Watch,
    phases: u64,
    pub(crate) trials: u64,
}

impl<'w> Told<'w> {
    pub(crate) fn new(watch: &'w crate::work::Watch) -> Self {
        Self {
            watch,
            phases: 0,
            trials: 0,
        }
    }
}

impl Observer for Told<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, _: f64) {
        self.watch.tell(self.phases, 0, format!("{port} {phase}"));
        self.phases += 1;
    }

    fn sample(&mut self, _: &Sample) {}

    fn trial(&mut self, start: usize, trial: u32, best: f64) {
        self.trials += 1;
        let text = format!("start {}, trial {trial}, cost {best:.2} ms2", start + 1);
        self.watch.tell(self.trials, 0, text);
    }
}
