//! Many trays, each on the machine that its own seed draws: what one tray cannot tell.

use crate::campaign::Commissioned;
use crate::produce::{Percentiles, ProduceDocument, Shift, Sides, Sums, Told, produce};
use anyhow::Result;
use pigtail_control::station::Unobserved;
use pigtail_hal::Error;
use pigtail_numerics::rounded;
use pigtail_numerics::statistics::exact;
use pigtail_session::produce::Loaded;
use pigtail_session::setup::Setup;
use pigtail_twin::Specimen;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, mpsc};

/// A tray of many.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrayDone {
    /// The seed of its machine, and of all that lies on it.
    pub seed: u64,
    /// Why its machine was refused when it was commissioned; `null` where it was not.
    pub refused: Option<String>,
    /// What came of it; `null` where its machine was refused.
    pub document: Option<ProduceDocument>,
}

/// What `produce --trays` prints as JSON. Keys are a contract: more may come, none changes its name or meaning. Those of one
/// tray are over all trays.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TraysDocument {
    /// Devices that were begun.
    pub devices: usize,
    /// Fibers that were begun.
    pub fibers: usize,
    /// Share of these devices that passed, 0 to 1.
    #[serde(rename = "yield")]
    pub passed: f64,
    /// Machine time a fiber, from pick to verified.
    pub seconds_per_fiber: Percentiles,
    /// Of that, its alignment.
    pub align_seconds: Percentiles,
    /// Devices that were done an hour of machine time, be they good or not.
    pub devices_per_hour: f64,
    /// Share of the time in which a manipulator neither did anything nor held anything, percent.
    pub idle_percent: Sides,
    /// Loss of the pigtails at their interface, decibels: the truth.
    pub loss_db_after_cure: Percentiles,
    /// As of one tray.
    pub shift_um: Shift,
    /// Devices that were rejected, by cause.
    pub rejected: BTreeMap<String, usize>,
    /// Loss that the cure has added, decibels: the truth.
    pub added_loss_db: Percentiles,
    /// Trays that were run.
    pub trays: usize,
    /// Trays whose machines were refused when they were commissioned: nothing was run on them.
    pub trays_refused: usize,
    /// Fibers that passed.
    pub fibers_passed: usize,
    /// Fibers that passed and have in truth lost more than their recipe accepts.
    pub wrongly_passed: usize,
    /// Trays on which anything touched a chip: the truth.
    pub touched: usize,
    /// Trays on which the holders met: the truth.
    pub met: usize,
    /// Trays on which the machine stopped by itself.
    pub stopped: usize,
    /// Exact intervals (Clopper and Pearson, 95 %) of the shares that these counts tell of.
    pub exact_95: Intervals,
    /// The least distance of anything from a chip, micrometres: the truth.
    pub smallest_gap_um: Option<f64>,
    /// The least distance between both holders, millimetres: the truth.
    pub smallest_apart_mm: Option<f64>,
    /// Share of the time in which a manipulator held a fiber under the lamp or still for one that was, percent.
    pub held_percent: Sides,
    /// How far the loss that control says was added is from the truth, in the standard deviations that control states:
    /// the root of the mean square. 1 where they are right.
    pub stated_sigma: Option<f64>,
    /// Machine time of it all, seconds.
    pub seconds: f64,
    /// The tray's file.
    pub tray: String,
    /// The seed of the first tray.
    pub seed: u64,
    /// The fleet.
    pub fleet: String,
    /// Whether each machine was commissioned first.
    pub commissioned: bool,
    /// Whether it was stopped before all trays were done.
    pub interrupted: bool,
}

/// Exact 95 % intervals of shares.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Intervals {
    /// Of devices that pass.
    #[serde(rename = "yield")]
    pub passed: [f64; 2],
    /// Of fibers that passed: those that should not have.
    pub wrongly_passed: [f64; 2],
    /// Of trays: those on which a chip is touched.
    pub touched: [f64; 2],
    /// Of trays: those on which holders meet.
    pub met: [f64; 2],
}

/// Runs a tray on each of these machines, with the first devices of each, on so many threads. `watch` is told of each
/// tray in the order of the seeds. When `stop` is set those that were begun are ended, and no other is begun.
///
/// # Errors
///
/// When a plant makes no machine, or what was kept of one cannot be read.
pub fn trays(
    setup: &Setup,
    loaded: &Loaded,
    machines: Option<&Commissioned>,
    seeds: &[u64],
    threads: usize,
    stop: &AtomicBool,
    mut watch: impl FnMut(&TrayDone),
) -> Result<Vec<TrayDone>> {
    let next = AtomicUsize::new(0);
    let failed = Mutex::new(None);
    let (send, receive) = mpsc::channel::<(usize, TrayDone)>();
    let work = |send: mpsc::Sender<(usize, TrayDone)>| {
        while !stop.load(Ordering::Relaxed) {
            let k = next.fetch_add(1, Ordering::Relaxed);
            let Some(seed) = seeds.get(k) else { break };
            match tray(setup, loaded, machines, *seed) {
                Ok(done) => {
                    if send.send((k, done)).is_err() {
                        break;
                    }
                }
                Err(why) => {
                    let mut failed = failed.lock().unwrap_or_else(PoisonError::into_inner);
                    failed.get_or_insert(why);
                    break;
                }
            }
        }
    };
    let mut all = Vec::with_capacity(seeds.len());
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            let send = send.clone();
            scope.spawn(|| work(send));
        }
        drop(send);
        let mut early = BTreeMap::new();
        for (k, done) in receive {
            early.insert(k, done);
            while let Some(done) = early.remove(&all.len()) {
                watch(&done);
                all.push(done);
            }
        }
    });
    match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(why) => Err(why),
        None => Ok(all),
    }
}

fn tray(
    setup: &Setup,
    loaded: &Loaded,
    machines: Option<&Commissioned>,
    seed: u64,
) -> Result<TrayDone> {
    let named = |why: anyhow::Error| why.context(format!("seed {seed}"));
    let known = match machines {
        None => None,
        Some(machines) => {
            let machine = Specimen::from(seed).machine();
            match machines
                .setup_of(machine)
                .map_err(|why| named(why.into()))?
            {
                Some(of_machine) => Some(of_machine),
                None => {
                    return Ok(TrayDone {
                        seed,
                        refused: Some(machines.why(machine).to_owned()),
                        document: None,
                    });
                }
            }
        }
    };
    let setup = known.as_deref().unwrap_or(setup);
    let mut observer = Unobserved;
    let outcome = produce(setup, loaded, seed, &[], &mut observer, &mut |_| ())
        .map_err(|why| named(why.into()))?;
    Ok(TrayDone {
        seed,
        refused: None,
        document: Some(outcome.document),
    })
}

/// Sums up trays, of which `asked` were to be run from `seed` on.
///
/// # Errors
///
/// When no tray was run.
pub fn summarize(
    setup: &Setup,
    loaded: &Loaded,
    all: &[TrayDone],
    seed: u64,
    asked: usize,
    commissioned: bool,
) -> Result<TraysDocument, Error> {
    let run: Vec<&ProduceDocument> = all.iter().filter_map(|t| t.document.as_ref()).collect();
    if run.is_empty() {
        let message = "no tray was run: every machine was refused when it was commissioned, or it was stopped before";
        return Err(Error::new(loaded.file.clone(), "", message));
    }
    let sums = Sums::of(run.iter().flat_map(|d| &d.produced), loaded);
    let seconds: f64 = run.iter().map(|d| d.seconds).sum();
    let mean = |of: fn(&ProduceDocument) -> Sides| {
        let over = |side: fn(&Sides) -> f64| {
            let sum: f64 = run.iter().map(|d| side(&of(d)) * d.seconds).sum();
            rounded(sum / seconds.max(1e-9), 1e-2)
        };
        Sides {
            left: over(|s| s.left),
            right: over(|s| s.right),
        }
    };
    let hours: f64 = run
        .iter()
        .map(|d| d.devices_per_hour * d.seconds / 3600.0)
        .sum();
    let count = |what: &dyn Fn(&ProduceDocument) -> bool| run.iter().filter(|d| what(d)).count();
    let least = |of: fn(&ProduceDocument) -> f64| {
        let least = run.iter().map(|d| of(d)).fold(f64::INFINITY, f64::min);
        least.is_finite().then_some(least)
    };
    let (touched, met) = (
        count(&|d| d.collision),
        count(&|d| d.smallest_apart_mm <= 0.0),
    );
    let share =
        |hits: usize, of: usize| exact(hits as u64, of as u64).map(|share| rounded(share, 1e-6));
    Ok(TraysDocument {
        devices: sums.devices,
        fibers: sums.fibers,
        passed: sums.share(),
        seconds_per_fiber: sums.seconds_per_fiber,
        align_seconds: sums.align_seconds,
        devices_per_hour: rounded(3600.0 * hours / seconds.max(1e-9), 1e-2),
        idle_percent: mean(|d| d.idle_percent),
        loss_db_after_cure: sums.loss_db_after_cure,
        shift_um: sums.shift_um,
        rejected: sums.rejected,
        added_loss_db: sums.added_loss_db,
        trays: run.len(),
        trays_refused: all.len() - run.len(),
        fibers_passed: sums.fibers_passed,
        wrongly_passed: sums.wrongly_passed,
        touched,
        met,
        stopped: count(&|d| d.fault.is_some()),
        exact_95: Intervals {
            passed: share(sums.passed, sums.devices),
            wrongly_passed: share(sums.wrongly_passed, sums.fibers_passed),
            touched: share(touched, run.len()),
            met: share(met, run.len()),
        },
        smallest_gap_um: least(|d| d.smallest_gap_um),
        smallest_apart_mm: least(|d| d.smallest_apart_mm),
        held_percent: mean(|d| d.held_percent),
        stated_sigma: stated(run.iter().flat_map(|d| &d.produced)),
        seconds: rounded(seconds, 1e-3),
        tray: loaded.file.clone(),
        seed,
        fleet: setup.fleet_name().to_owned(),
        commissioned,
        interrupted: all.len() < asked,
    })
}

/// See [`TraysDocument::stated_sigma`].
fn stated<'t>(told: impl Iterator<Item = &'t Told>) -> Option<f64> {
    let errors = told.flat_map(|device| {
        let fibers = device.produced.fibers.iter().zip(&device.truth);
        fibers.filter_map(|(fiber, truth)| {
            let (cured, truth) = (fiber.cured?, (*truth)?);
            Some((cured.after_release_db - truth.added_db) / cured.sigma_db)
        })
    });
    let (n, squares) = errors.fold((0.0, 0.0), |(n, sum), error| (n + 1.0, sum + error * error));
    (n > 0.0).then(|| rounded((squares / n).sqrt(), 1e-3))
}
