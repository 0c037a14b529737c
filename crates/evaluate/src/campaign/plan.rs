//! What a campaign is to do: what was asked for, as its folder keeps it, and whether it may go on so.

use crate::bench::PROCEDURE;
use pigtail_hal::Error;
use pigtail_session::bench::BenchSetup;
use pigtail_session::faults::Faults;
use pigtail_session::piezos::PiezoModel;
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::Named;
use pigtail_session::scenario::Scenario;
use pigtail_session::setup::Setup;
use pigtail_twin::Specimen;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;
use strum::VariantArray;

/// What was asked for.
pub(super) const PLAN: &str = "campaign.json";

/// What a campaign is to do, as its folder keeps it. A campaign can go on only as it was begun.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// The program's version.
    pub version: String,
    /// The rig as it was named.
    pub rig: String,
    /// The recipe as it was named.
    pub recipe: String,
    /// The procedure.
    pub procedure: String,
    /// How the truth was changed.
    #[serde(default = "nominal")]
    pub scenario: String,
    /// What was broken on purpose.
    #[serde(default = "none")]
    pub faults: String,
    /// The first device's seed; each next device has the next seed.
    pub seed: u64,
    /// Number of devices.
    pub devices: u64,
    /// What machines and devices may be.
    #[serde(default = "nominal")]
    pub fleet: String,
    /// How many devices each machine aligns; the next machine has the next seed.
    #[serde(default = "one")]
    pub devices_each: u64,
    /// Whether each machine is commissioned first.
    #[serde(default)]
    pub commissioned: bool,
    /// By which model of its piezos' hysteresis.
    #[serde(default)]
    pub piezo_model: PiezoModel,
    /// Name and SHA-256 of every configuration that was read.
    pub configuration: Vec<(String, String)>,
}

impl Plan {
    /// The plan of a campaign with this rig, recipe and fleet, each device on a machine of its own.
    pub fn new(setup: &Setup, procedure: Procedure, seed: u64, devices: u64) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            rig: setup.rig.name.clone(),
            recipe: setup.rig.recipe_name.clone(),
            procedure: procedure.name().to_owned(),
            scenario: setup.scenario.name().to_owned(),
            faults: setup.faults.to_string(),
            seed,
            devices,
            fleet: setup.fleet_name().to_owned(),
            devices_each: 1,
            commissioned: false,
            piezo_model: setup.piezo_model,
            configuration: setup.rig.hashes.clone(),
        }
    }

    /// The plan of a campaign with this bench, each device on a bench of its own.
    pub fn of_benches(setup: &BenchSetup, seed: u64, devices: u64) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            rig: setup.rig.name.clone(),
            recipe: setup.rig.recipe_name.clone(),
            procedure: PROCEDURE.name().to_owned(),
            scenario: nominal(),
            faults: none(),
            seed,
            devices,
            fleet: nominal(),
            devices_each: 1,
            commissioned: false,
            piezo_model: PiezoModel::default(),
            configuration: setup.rig.hashes.clone(),
        }
    }

    /// The same with so many devices on each machine, one after the other.
    #[must_use]
    pub fn with_devices_each(self, devices_each: u64) -> Self {
        Self {
            devices_each: devices_each.max(1),
            ..self
        }
    }

    /// The same on machines each of which is commissioned first, or not.
    #[must_use]
    pub fn with_commissioned(self, commissioned: bool) -> Self {
        Self {
            commissioned,
            ..self
        }
    }

    /// The seeds of the machines.
    pub fn machine_seeds(&self) -> Vec<u64> {
        let machines = 0..self.machines();
        machines
            .map(|machine| Specimen::of(self.seed + machine, 0).machine())
            .collect()
    }

    /// How many machines there are.
    pub fn machines(&self) -> u64 {
        self.devices.div_ceil(self.devices_each)
    }

    /// The seed of a device, counted from zero.
    pub fn seed_of(&self, device: u64) -> u64 {
        let (machine, on_it) = (device / self.devices_each, device % self.devices_each);
        Specimen::of(self.seed + machine, on_it).seed()
    }

    /// Reads the plan of the campaign in `folder`.
    ///
    /// # Errors
    ///
    /// When there is none, or it cannot be understood.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(PLAN);
        let text = fs::read_to_string(&path).map_err(|error| {
            Error::new(
                folder.display().to_string(),
                "",
                format!(
                    "no campaign can be resumed from here ({PLAN} cannot be read: {error}); \
                     accepted is the folder of a campaign, such as \
                     runs/20261121T024402-campaign-0"
                ),
            )
        })?;
        serde_json::from_str(&text).map_err(|error| {
            Error::new(
                path.display().to_string(),
                "",
                format!("is damaged ({error}); accepted is what a campaign wrote"),
            )
        })
    }

    /// The procedure.
    ///
    /// # Errors
    ///
    /// When this program knows none of that name.
    pub fn procedure(&self) -> Result<Procedure, Error> {
        self.procedure.parse::<Procedure>().map_err(|_| {
            let names: Vec<_> = Procedure::VARIANTS.iter().map(|p| p.name()).collect();
            Error::new(
                PLAN,
                "procedure",
                format!("is \"{}\"; accepted is one of {names:?}", self.procedure),
            )
        })
    }

    /// The scenario.
    ///
    /// # Errors
    ///
    /// When this program knows none of that name.
    pub fn scenario(&self) -> Result<Scenario, Error> {
        self.scenario.parse::<Scenario>().map_err(|_| {
            let names: Vec<_> = Scenario::VARIANTS.iter().map(|s| s.name()).collect();
            Error::new(
                PLAN,
                "scenario",
                format!("is \"{}\"; accepted is one of {names:?}", self.scenario),
            )
        })
    }

    /// What is broken on purpose.
    ///
    /// # Errors
    ///
    /// When this program knows no fault of that name.
    pub fn faults(&self) -> Result<Faults, Error> {
        self.faults
            .parse()
            .map_err(|why| Error::new(PLAN, "faults", why))
    }

    /// The rig, recipe and fleet that it names, believing this calibration, or the rig's.
    ///
    /// # Errors
    ///
    /// When they cannot be read, or are others by now.
    pub fn setup(&self, calibration: Option<&Path>) -> Result<Setup, Error> {
        let named = Named {
            rig: &self.rig,
            recipe: &self.recipe,
            calibration,
            ..Named::default()
        };
        self.of(Setup::load_named(&named)?)
    }

    /// What this campaign makes of a rig and a recipe.
    pub(super) fn of(&self, setup: Setup) -> Result<Setup, Error> {
        let mut setup = setup.of_fleet(&self.fleet)?;
        self.scenario()?.apply(&mut setup);
        setup.faults = self.faults()?;
        setup.piezo_model = self.piezo_model;
        self.check(Path::new(PLAN), &self.again(&setup)?)?;
        Ok(setup)
    }

    /// The same, asked for of this setup.
    fn again(&self, setup: &Setup) -> Result<Self, Error> {
        Ok(Self::new(setup, self.procedure()?, self.seed, self.devices)
            .with_devices_each(self.devices_each)
            .with_commissioned(self.commissioned))
    }

    /// Whether a campaign that was begun by `self` may go on by `other`.
    pub(super) fn check(&self, folder: &Path, other: &Self) -> Result<(), Error> {
        let differs = |key: &str, begun: &str, now: &str| {
            Err(Error::new(
                folder.display().to_string(),
                key,
                format!("the campaign was begun with {begun}, not with {now}; accepted is {begun}"),
            ))
        };
        for (key, begun, now) in [
            ("version", &self.version, &other.version),
            ("procedure", &self.procedure, &other.procedure),
            ("scenario", &self.scenario, &other.scenario),
            ("faults", &self.faults, &other.faults),
            ("fleet", &self.fleet, &other.fleet),
            ("seed", &self.seed.to_string(), &other.seed.to_string()),
            (
                "devices",
                &self.devices.to_string(),
                &other.devices.to_string(),
            ),
            (
                "machines",
                &self.machines().to_string(),
                &other.machines().to_string(),
            ),
            (
                "commissioned",
                &self.commissioned.to_string(),
                &other.commissioned.to_string(),
            ),
            (
                "piezo_model",
                &self.piezo_model.to_string(),
                &other.piezo_model.to_string(),
            ),
        ] {
            if begun != now {
                return differs(key, begun, now);
            }
        }
        // A file may lie elsewhere by now; what it says must be the same.
        for ((begun, was), (now, is)) in self.configuration.iter().zip(&other.configuration) {
            if was != is {
                return differs(
                    now,
                    &format!("a {begun} of SHA-256 {}", &was[..was.len().min(12)]),
                    &format!("one of {}", &is[..is.len().min(12)]),
                );
            }
        }
        Ok(())
    }
}

fn none() -> String {
    "none".to_owned()
}

fn one() -> u64 {
    1
}

fn nominal() -> String {
    "nominal".to_owned()
}
