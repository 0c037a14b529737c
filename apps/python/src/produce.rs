//! A tray produced on a twin.

use crate::input::refused;
use crate::rig::Rig;
use crate::work::{Watch, work};
use pigtail_control::station::{Observer, Sample};
use pigtail_evaluate::campaign::Commissioned;
use pigtail_evaluate::produce::{Heard, produce as produced};
use pigtail_session::calibrations::On;
use pigtail_session::produce::Loaded;
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
        let mut loaded = Loaded::read(tray)?;
        let mut setup = rig.making(loaded.device_recipe())?.setup()?;
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
