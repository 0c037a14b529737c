//! Machines that were commissioned before they align devices: each once, kept for the next campaign of the same kind.
//!
//! A machine's calibration depends on nothing but its seed, the configuration and the program, which the folder's name
//! holds. It is written beside its place and moved there whole.

use super::{Device, device};
use crate::align;
use anyhow::{Context, Result};
use pigtail_control::outcome::OutcomeCode;
use pigtail_control::station::Unobserved;
use pigtail_hal::digest::hex;
use pigtail_session::calibrations::{Belief, FILE};
use pigtail_session::commission::{Plan, StepName, Verdict, commission};
use pigtail_session::job::Ended;
use pigtail_session::piezos::PiezoModel;
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::Setup;
use pigtail_twin::Specimen;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Devices of the acceptance test, as many as the command's own.
const DEVICES: u64 = 5;
/// What commissioning came to, beside the calibration.
const VERDICT: &str = "verdict.json";
/// Machines that are held ready: threads work on neighbours.
const READY: usize = 8;

/// What commissioning a machine came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Commissioning {
    /// Whether the machine was accepted.
    pub accepted: bool,
    /// Machine time, seconds.
    pub seconds: f64,
    /// Why it was not accepted; empty where it was.
    pub why: String,
}

/// How the evidence of a fiber begins whose machine was refused.
pub(super) const REFUSED: &str = "the machine was refused";

/// The machines of a campaign, commissioned.
#[derive(Debug)]
pub struct Commissioned {
    setup: Setup,
    folder: PathBuf,
    machines: BTreeMap<u64, Commissioning>,
    ready: Mutex<VecDeque<(u64, Arc<Setup>)>>,
}

/// Whatever a machine's calibration depends on, beside its seed.
#[derive(Serialize)]
struct Key<'k> {
    version: &'k str,
    /// SHA-256 of the program: another build may find something else.
    program: &'k str,
    configuration: &'k [(String, String)],
    fleet: &'k str,
    scenario: &'k str,
    piezo_model: PiezoModel,
    devices: u64,
}

impl Commissioned {
    /// Commissions the machines of these seeds that are not in the folder `runs` yet, on so many threads. `watch` is told
    /// of each when it is known. Stops early, with those that are done, when `stop` is set.
    ///
    /// # Errors
    ///
    /// When a plant makes no machine, or the folder cannot be read or written.
    pub fn of(
        setup: &Setup,
        seeds: &[u64],
        runs: &Path,
        threads: usize,
        stop: &AtomicBool,
        watch: impl Fn(u64, &Commissioning) + Sync,
    ) -> Result<Self> {
        let program = std::env::current_exe().and_then(fs::read);
        let program = program.map_or_else(|_| String::new(), |exe| hex(&Sha256::digest(exe)));
        let key = Key {
            program: &program,
            version: env!("CARGO_PKG_VERSION"),
            configuration: &setup.rig.hashes,
            fleet: setup.fleet_name(),
            scenario: setup.scenario.name(),
            piezo_model: setup.piezo_model,
            devices: DEVICES,
        };
        let hash = hex(&Sha256::digest(serde_json::to_vec(&key)?));
        let name = format!("{}-{}-{}", setup.rig.name, setup.fleet_name(), &hash[..12]);
        let name = name.replace(|c: char| !(c.is_ascii_alphanumeric() || c == '-'), "_");
        let folder = runs.join("commissioned").join(name);
        let mut of_machines = setup.clone();
        of_machines.faults = pigtail_session::faults::Faults::None;
        of_machines.records = None;
        let next = AtomicUsize::new(0);
        let done = Mutex::new(BTreeMap::new());
        let work = || -> Result<()> {
            while !stop.load(Ordering::Relaxed) {
                let Some(seed) = seeds.get(next.fetch_add(1, Ordering::Relaxed)) else {
                    break;
                };
                let place = folder.join(seed.to_string());
                let known = match read(&place) {
                    Some(known) => known,
                    None => commissioned(&of_machines, *seed, &place)
                        .with_context(|| format!("machine of seed {seed}"))?,
                };
                watch(*seed, &known);
                lock(&done).insert(*seed, known);
            }
            Ok(())
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(work)).collect();
            workers.into_iter().try_for_each(|worker| {
                let ended = worker.join();
                ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
        })?;
        Ok(Self {
            setup: setup.clone(),
            folder,
            machines: done.into_inner().unwrap_or_else(PoisonError::into_inner),
            ready: Mutex::default(),
        })
    }

    /// How many machines were accepted.
    pub fn accepted(&self) -> u64 {
        self.machines.values().filter(|m| m.accepted).count() as u64
    }

    /// Where the calibrations are kept.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A device on its machine; not attempted where that was refused.
    pub(super) fn device(&self, procedure: Procedure, seed: u64) -> Result<Device, Ended> {
        let machine = Specimen::from(seed).machine();
        let accepted = self.machines.get(&machine).is_some_and(|m| m.accepted);
        if accepted {
            return device(&*self.of_machine(machine)?, procedure, seed);
        }
        let why = format!("{REFUSED}: {}", self.why(machine));
        let document = align::empty(
            &self.setup,
            procedure,
            seed,
            OutcomeCode::NotAttempted,
            &why,
        );
        Ok(Device { seed, document })
    }

    /// Why a machine was not accepted; empty where it was.
    pub fn why(&self, machine: u64) -> &str {
        let known = self.machines.get(&machine);
        known.map_or("it is not known", |m| m.why.as_str())
    }

    /// The setup with what is believed of a machine; nothing where that was refused.
    ///
    /// # Errors
    ///
    /// When what was kept of it cannot be read.
    pub fn setup_of(&self, machine: u64) -> Result<Option<Arc<Setup>>, Ended> {
        let accepted = self.machines.get(&machine).is_some_and(|m| m.accepted);
        accepted.then(|| self.of_machine(machine)).transpose()
    }

    /// The setup with what is believed of a machine.
    fn of_machine(&self, machine: u64) -> Result<Arc<Setup>, Ended> {
        let mut ready = lock(&self.ready);
        if let Some((_, setup)) = ready.iter().find(|(seed, _)| *seed == machine) {
            return Ok(setup.clone());
        }
        let place = self.folder.join(machine.to_string());
        let belief = Belief::read(&place.join(FILE))?;
        let setup = Arc::new(Setup {
            rig: self.setup.rig.with_belief(&belief)?,
            ..self.setup.clone()
        });
        ready.push_back((machine, setup.clone()));
        if ready.len() > READY {
            ready.pop_front();
        }
        Ok(setup)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A machine that was commissioned before.
fn read(place: &Path) -> Option<Commissioning> {
    let text = fs::read_to_string(place.join(VERDICT)).ok()?;
    serde_json::from_str(&text).ok()
}

/// Commissions a machine, and keeps what is found.
fn commissioned(setup: &Setup, seed: u64, place: &Path) -> Result<Commissioning> {
    let plan = Plan {
        steps: StepName::of_machines(),
        devices: DEVICES,
        // No date: the same seed gives the same bytes.
        date: String::new(),
        run: format!("campaign, machine {seed}"),
        before: Vec::new(),
    };
    let done = catch_unwind(AssertUnwindSafe(|| {
        commission(setup, seed, &plan, &mut Unobserved, |_| ())
    }));
    let beside = place.with_extension(format!("part-{}", std::process::id()));
    fs::create_dir_all(&beside).with_context(|| beside.display().to_string())?;
    let known = match done {
        Err(_) => Commissioning {
            accepted: false,
            seconds: 0.0,
            why: "the program failed while it was commissioned".to_owned(),
        },
        Ok(done) => {
            let done = done?;
            for (file, text) in done.belief.files() {
                fs::write(beside.join(file), text).with_context(|| beside.display().to_string())?;
            }
            let failed = |step: &&_| -> bool {
                let step: &pigtail_session::commission::StepDocument = step;
                step.verdict == Verdict::Failed
            };
            let why = done.document.steps.iter().find(failed);
            Commissioning {
                accepted: done.document.accepted,
                seconds: done.document.seconds_machine,
                why: why.map_or_else(String::new, |step| format!("{}: {}", step.name, step.why)),
            }
        }
    };
    let text = serde_json::to_vec(&known)?;
    fs::write(beside.join(VERDICT), text).with_context(|| beside.display().to_string())?;
    if fs::rename(&beside, place).is_err() {
        // Another campaign was faster, or what stands there is damaged.
        fs::remove_dir_all(place).ok();
        fs::rename(&beside, place).with_context(|| place.display().to_string())?;
    }
    Ok(known)
}
