//! One device aligned, with all that was seen on the way.

use crate::failure::Failure;
use crate::input::{choice, refused};
use crate::rig::{Rig, Told};
use crate::work::work;
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1};
use pigtail_control::station::{Observer, Sample};
use pigtail_evaluate::align::align as aligned;
use pigtail_hal::{Channel, Side};
use pigtail_report::text;
use pigtail_session::calibrations::{On, RunsOn};
use pigtail_session::faults::Faults;
use pigtail_session::procedure::Procedure;
use pigtail_session::samples::Record;
use pigtail_twin::Specimen;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Keeps everything, and tells how far it is.
struct Watcher<'w> {
    record: Record,
    told: Told<'w>,
}

impl Observer for Watcher<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.record.phase(port, phase, time);
        self.told.phase(port, phase, time);
    }

    fn sample(&mut self, sample: &Sample) {
        self.record.sample(sample);
    }
}

/// Aligns a device: its document as JSON and as text, and the light samples.
#[pyfunction]
#[pyo3(signature = (rig, procedure, seed, device, faults, fault, progress))]
pub(crate) fn align<'py>(
    py: Python<'py>,
    rig: &Rig,
    procedure: &str,
    seed: u64,
    device: u64,
    faults: Option<&str>,
    fault: Vec<String>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(String, String, Bound<'py, PyDict>)> {
    let (document, words, record) = work(py, progress, |watch| {
        let procedure: Procedure = choice("procedure", procedure)?;
        let mut setup = rig.setup()?;
        setup.faults = broken(faults, &fault)?;
        setup.options.stop = watch.stop.clone();
        // A seed may name a device as well: that of a row of a campaign does.
        let named = Specimen::from(seed);
        let device = named.device().wrapping_add(device);
        let seed = Specimen::of(named.machine(), device).seed();
        let mut watcher = Watcher {
            record: Record::default(),
            told: Told::new(watch),
        };
        let document = aligned(&setup, procedure, seed, &mut watcher)?;
        let json = serde_json::to_string(&On::new(&setup.rig, &document));
        let words =
            text::alignment(&document, None) + &format!("Ran on {}\n", RunsOn::of(&setup.rig));
        Ok((json.map_err(anyhow::Error::from)?, words, watcher.record))
    })?;
    Ok((document, words, samples(py, &record)?))
}

/// What is broken on purpose.
pub(crate) fn broken(faults: Option<&str>, fault: &[String]) -> Result<Faults, Failure> {
    match (faults, fault) {
        (None, []) => Ok(Faults::None),
        (Some(names), []) => Ok(names
            .parse()
            .map_err(|why: String| refused("faults", names, why))?),
        (None, said) => {
            let read = |text: &String| {
                text.parse()
                    .map_err(|why: String| refused("fault", text, why))
            };
            Ok(Faults::Said(
                said.iter().map(read).collect::<Result<_, _>>()?,
            ))
        }
        (Some(_), fault) => Err(refused(
            "fault",
            fault.join(", "),
            "goes without `faults`; accepted is one of both",
        )
        .into()),
    }
}

/// The samples as arrays.
pub(crate) fn samples<'py>(py: Python<'py>, record: &Record) -> PyResult<Bound<'py, PyDict>> {
    let all = &record.samples;
    let n = all.len();
    let time: Vec<f64> = all.iter().map(|sample| sample.time).collect();
    let mut light = Array2::zeros((n, Channel::ALL.len()));
    let mut endpoint = Array3::zeros((n, Side::ALL.len(), 3));
    let mut micro = Array3::zeros((n, Side::ALL.len(), 2));
    for (k, sample) in all.iter().enumerate() {
        for (channel, volts) in sample.light.iter().enumerate() {
            light[[k, channel]] = *volts;
        }
        for (side, (point, displacement)) in sample.endpoints.iter().zip(sample.micro).enumerate() {
            for (way, metres) in [point.x, point.y, point.z].into_iter().enumerate() {
                endpoint[[k, side, way]] = 1e6 * metres;
            }
            for (way, metres) in [displacement.x, displacement.y].into_iter().enumerate() {
                micro[[k, side, way]] = 1e6 * metres;
            }
        }
    }
    let mut phase = vec![-1_i32; n];
    let mut phases = Vec::new();
    for (index, (of, samples)) in record.phases().enumerate() {
        phase[of.first..of.first + samples.len()].fill(i32::try_from(index).unwrap_or(-1));
        phases.push((of.port.clone(), of.name, of.start));
    }
    let dict = PyDict::new(py);
    dict.set_item("time_s", PyArray1::from_vec(py, time))?;
    dict.set_item("light_v", light.into_pyarray(py))?;
    dict.set_item("endpoint_um", endpoint.into_pyarray(py))?;
    dict.set_item("micro_um", micro.into_pyarray(py))?;
    dict.set_item("phase", PyArray1::from_vec(py, phase))?;
    dict.set_item("phases", phases)?;
    Ok(dict)
}
