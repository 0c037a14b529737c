//! Trays produced on twins.

use crate::failure::Failure;
use crate::input::refused;
use crate::rig::Rig;
use crate::work::{Watch, work};
use pigtail_control::station::{Observer, Sample};
use pigtail_evaluate::campaign::Commissioned;
use pigtail_evaluate::produce::{Heard, produce as produced};
use pigtail_evaluate::trays::{summarize, trays};
use pigtail_session::calibrations::On;
use pigtail_session::produce::Loaded;
use pigtail_session::setup::Setup;
use pigtail_twin::Specimen;
use pyo3::prelude::*;
use serde_json::json;
use std::cell::Cell;
use std::path::PathBuf;

/// Tells of phases beside the devices that are done.
struct Phases<'w> {
    watch: &'w Watch,
    devices: u64,
    done: &'w Cell<u64>,
}

impl Observer for Phases<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, _: f64) {
        let text = format!("{port} {phase}");
        self.watch.tell(self.done.get(), self.devices, text);
    }

    fn sample(&mut self, _: &Sample) {}
}

/// A tray with its recipes, and what it is to be produced with: refused with all that is wrong at once.
fn read(
    rig: &Rig,
    tray: &str,
    track: Option<bool>,
    precompensate: Option<bool>,
) -> Result<(Setup, Loaded), Failure> {
    let mut loaded = Loaded::read(tray)?;
    let setup = rig.making(loaded.device_recipe())?.setup()?;
    let wrong = loaded.check(&setup.rig.spec, &setup.rig.calibration);
    if !wrong.is_empty() {
        let all: Vec<String> = wrong.iter().map(ToString::to_string).collect();
        return Err(refused("tray", tray, all.join("; ")).into());
    }
    for production in loaded.productions.values_mut() {
        let cure = &mut production.cure;
        cure.track = track.unwrap_or(cure.track);
        cure.precompensate = precompensate.unwrap_or(cure.precompensate) && cure.track;
    }
    Ok((setup, loaded))
}

/// Produces a tray: its document as JSON, and what happened, a JSON of an event each.
#[pyfunction]
#[pyo3(signature = (rig, tray, seed, commission_in, track, precompensate, progress))]
pub(crate) fn produce(
    py: Python<'_>,
    rig: &Rig,
    tray: &str,
    seed: u64,
    commission_in: Option<PathBuf>,
    track: Option<bool>,
    precompensate: Option<bool>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    work(py, progress, |watch| {
        let (mut setup, loaded) = read(rig, tray, track, precompensate)?;
        if let Some(runs) = commission_in {
            let machine = Specimen::from(seed).machine();
            watch.tell(0, 0, "commissioning");
            let all = Commissioned::of(&setup, &[machine], &runs, 1, &watch.stop, |_, _| ())?;
            let Some(found) = all.setup_of(machine)? else {
                let message = "its machine was refused when it was commissioned";
                return Err(refused("seed", seed, message).into());
            };
            setup = (*found).clone();
        }
        setup.options.stop = watch.stop.clone();
        setup.rig.hashes.extend(loaded.hashes.iter().cloned());
        let (devices, done) = (loaded.tray.devices.len() as u64, Cell::new(0));
        watch.tell(0, devices, "devices");
        let mut events = Vec::new();
        let mut hear = |heard: Heard| match heard {
            Heard::Event(event) => events.push(json!(event).to_string()),
            Heard::Device(device) => {
                done.set(done.get() + 1);
                let serial = &device.produced.serial;
                watch.tell(done.get(), devices, format!("{serial} done"));
            }
        };
        let mut phases = Phases {
            watch,
            devices,
            done: &done,
        };
        let outcome = produced(&setup, &loaded, seed, &[], &mut phases, &mut hear)?;
        let json = serde_json::to_string(&On::new(&setup.rig, &outcome.document));
        Ok((json.map_err(anyhow::Error::from)?, events))
    })
}

/// Produces a tray on each of many machines: the sums as JSON, and every tray, a JSON each.
#[pyfunction]
#[pyo3(signature = (rig, tray, seed, asked, threads, commission_in, track, precompensate, progress))]
pub(crate) fn produce_trays(
    py: Python<'_>,
    rig: &Rig,
    tray: &str,
    seed: u64,
    asked: u64,
    threads: usize,
    commission_in: Option<PathBuf>,
    track: Option<bool>,
    precompensate: Option<bool>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    work(py, progress, |watch| {
        let (mut setup, loaded) = read(rig, tray, track, precompensate)?;
        setup.options.stop = watch.stop.clone();
        let seeds: Vec<u64> = (0..asked).map(|k| seed.wrapping_add(k)).collect();
        let machines = match commission_in {
            None => None,
            Some(runs) => {
                let of: Vec<u64> = seeds
                    .iter()
                    .map(|seed| Specimen::from(*seed).machine())
                    .collect();
                watch.tell(0, asked, "commissioning");
                Some(Commissioned::of(
                    &setup,
                    &of,
                    &runs,
                    threads,
                    &watch.stop,
                    |_, _| watch.one_more(),
                )?)
            }
        };
        setup.rig.hashes.extend(loaded.hashes.iter().cloned());
        watch.tell(0, asked, "trays");
        let each = trays(
            &setup,
            &loaded,
            machines.as_ref(),
            &seeds,
            threads,
            &watch.stop,
            |_| watch.one_more(),
        )?;
        let document = summarize(
            &setup,
            &loaded,
            &each,
            seed,
            seeds.len(),
            machines.is_some(),
        )?;
        let json = serde_json::to_string(&On::new(&setup.rig, &document));
        let each: serde_json::Result<Vec<String>> =
            each.iter().map(serde_json::to_string).collect();
        Ok((
            json.map_err(anyhow::Error::from)?,
            each.map_err(anyhow::Error::from)?,
        ))
    })
}
