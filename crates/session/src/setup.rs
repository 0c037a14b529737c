//! A rig with the truth that a twin of it is drawn around, and what is kept of what runs on it.

use crate::faults::Faults;
use crate::fleet::{Fleet, NOMINAL};
use crate::job::{Ended, Job};
use crate::own::Own;
use crate::piezos::PiezoModel;
use crate::records::{About, Records};
use crate::rig::{Named, Rig, Source, no_twin};
use crate::scenario::Scenario;
use crate::session::{Options, Session};
use pigtail_control::station::{Observer, Station};
use pigtail_hal::{Error, Machine};
use pigtail_twin::faults::Injection;
use pigtail_twin::{Plant, Twin, TwinError};
use std::borrow::Cow;
use std::sync::Arc;

/// A rig and its truth: all that it takes to draw twins, and to run jobs on them.
#[derive(Debug, Clone)]
pub struct Setup {
    /// What control may know.
    pub rig: Rig,
    /// The truth, for twins alone.
    pub plant: Plant,
    /// What machines and devices may be, beside how the truth itself says that they vary.
    pub fleet: Option<Arc<Fleet>>,
    /// How the truth was changed.
    pub scenario: Scenario,
    /// What breaks while a twin of this setup runs.
    pub faults: Faults,
    /// By which model of its piezos' hysteresis a machine is commissioned.
    pub piezo_model: PiezoModel,
    /// How machines are treated.
    pub options: Options,
    /// Where exchanges are recorded, if anywhere.
    pub records: Option<Arc<Records>>,
}

/// The error of a change to the truth that makes no machine.
pub fn unfit(error: impl Into<TwinError>) -> Ended {
    Error::new("plant.toml", "", error.into().to_string()).into()
}

impl Setup {
    /// Loads a rig that has a twin, and a recipe; see [`Rig::load`].
    ///
    /// # Errors
    ///
    /// The first mistake found, with file, key, value and what would be accepted; a rig without a twin.
    pub fn load(rig: &str, recipe: &str) -> Result<Self, Error> {
        Self::of(Rig::load(rig, recipe)?)
    }

    /// The same, believing another calibration, or less of it; see [`Rig::load_named`].
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn load_named(named: &Named) -> Result<Self, Error> {
        Self::of(Rig::load_named(named)?)
    }

    /// The same with axes of a person's own; see [`Rig::load_with`].
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn load_with(named: &Named, own: &Own, bench: bool) -> Result<Self, Error> {
        Self::of(Rig::load_with(named, own, bench)?)
    }

    /// Sets up again what was read before; see [`Rig::from_sources`].
    ///
    /// # Errors
    ///
    /// As [`Self::load`].
    pub fn from_sources(rig: &str, recipe: &str, sources: Vec<Source>) -> Result<Self, Error> {
        Self::of(Rig::from_sources(rig, recipe, sources)?)
    }

    /// A rig with the truth that was read with it.
    ///
    /// # Errors
    ///
    /// When it has none, or it is no plant.
    pub fn of(rig: Rig) -> Result<Self, Error> {
        let truth = rig.truth().ok_or_else(|| no_twin(&rig.name))?;
        Ok(Self {
            plant: Plant::parse(&truth.name, &truth.text)?,
            rig,
            fleet: None,
            scenario: Scenario::Nominal,
            faults: Faults::None,
            piezo_model: PiezoModel::default(),
            options: Options::default(),
            records: None,
        })
    }

    /// The same rig with what its `measured.toml` changes; see [`Rig::measured`].
    ///
    /// # Errors
    ///
    /// As [`Rig::measured`].
    pub fn measured(&self) -> Result<Self, Error> {
        Ok(Self {
            options: self.options.clone(),
            ..Self::of(self.rig.measured()?)?
        })
    }

    /// The same rig with machines and devices of a fleet, by its name or file; see [`Fleet::load`].
    ///
    /// # Errors
    ///
    /// As [`Fleet::load`].
    pub fn of_fleet(self, name: &str) -> Result<Self, Error> {
        let (fleet, rig) = Fleet::load(&self.rig, name)?;
        Ok(Self {
            fleet: (!fleet.is_nominal()).then(|| Arc::new(fleet)),
            rig,
            ..self
        })
    }

    /// The name of the fleet.
    pub fn fleet_name(&self) -> &str {
        self.fleet.as_ref().map_or(NOMINAL, |fleet| &fleet.name)
    }

    /// The same setup with what control is told of the machine of a seed: some fleets have datasheets of their
    /// own.
    ///
    /// # Errors
    ///
    /// When what was drawn is no datasheet.
    pub fn at(&self, seed: u64) -> Result<Cow<'_, Self>, Error> {
        let told = match &self.fleet {
            Some(fleet) => fleet.datasheet(&self.rig, seed)?,
            None => None,
        };
        Ok(match told {
            None => Cow::Borrowed(self),
            Some(mut rig) => {
                if self.scenario == Scenario::Uncertain {
                    rig.spec.vision.accuracy_x *= 2.0;
                }
                Cow::Owned(Self {
                    rig,
                    ..self.clone()
                })
            }
        })
    }

    /// The twin that a seed draws, of the fleet if there is one. Where that has datasheets of its own, of the
    /// setup that [`Self::at`] gives.
    ///
    /// # Errors
    ///
    /// When the plant makes no machine.
    pub fn twin(&self, seed: u64) -> Result<Twin, Error> {
        let drawn = match &self.fleet {
            None => None,
            Some(fleet) => {
                let mut plant = fleet.draw(seed)?;
                self.scenario.change(&mut plant);
                Some(plant)
            }
        };
        let plant = drawn.as_ref().unwrap_or(&self.plant);
        Twin::new(self.rig.spec.clone(), plant, seed).map_err(|error| self.no_machine(&error))
    }

    /// The twin that a seed draws and what will break on it, were its work to take about so many seconds.
    ///
    /// # Errors
    ///
    /// As [`Self::twin`].
    pub fn broken_twin(&self, seed: u64, seconds: f64) -> Result<(Twin, Vec<Injection>), Error> {
        let mut twin = self.twin(seed)?;
        let injected = self.faults.of(seed, seconds);
        twin.inject(&injected);
        Ok((twin, injected))
    }

    /// The error of a plant that makes no machine.
    pub fn no_machine(&self, error: &TwinError) -> Error {
        let file = self.rig.truth().map_or(&self.rig.name, |truth| &truth.name);
        Error::new(file, "", error.to_string())
    }

    /// Runs a job on the twin that a seed draws, recorded if anything is.
    ///
    /// # Errors
    ///
    /// The way in which it ended without its result.
    pub fn run<J: Job>(
        &self,
        job: &J,
        seed: u64,
        observer: &mut dyn Observer,
    ) -> Result<J::Output, Ended> {
        let setup = self.at(seed)?;
        setup.perform(&mut setup.twin(seed)?, job, seed, observer)
    }

    /// Runs a job on a machine of this rig that is at hand, recorded if anything is.
    ///
    /// # Errors
    ///
    /// The way in which it ended without its result.
    pub fn perform<J: Job>(
        &self,
        machine: &mut dyn Machine,
        job: &J,
        seed: u64,
        observer: &mut dyn Observer,
    ) -> Result<J::Output, Ended> {
        let options = Options {
            longest: job.longest().min(self.options.longest),
            ..self.options.clone()
        };
        let mut session = Session::open_with(&self.rig, machine, &options);
        if let Some(records) = &self.records {
            let about = About::of(self, job.order(), seed).to_bytes();
            session.record(&records.take(&job.label()), &about)?;
        }
        let result = session.run(job, observer);
        if let Some((records, closing)) = self.records.as_ref().zip(session.close_record()) {
            records.keep(closing);
        }
        result
    }

    /// Runs an experiment that is nobody's job on the twin that a seed draws.
    ///
    /// # Errors
    ///
    /// The way in which it ended without its result.
    pub fn experiment<T>(
        &self,
        seed: u64,
        experiment: impl FnOnce(&mut Station) -> Result<T, Ended>,
    ) -> Result<T, Ended> {
        let setup = self.at(seed)?;
        let mut twin = setup.twin(seed)?;
        Session::open_with(&setup.rig, &mut twin, &setup.options).experiment(experiment)
    }
}
