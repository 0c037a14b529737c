//! A twin, driven cycle by cycle.

use crate::align::broken;
use crate::failure::Failure;
use crate::input::{Refused, refused};
use crate::rig::Rig;
use numpy::{PyArray1, PyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pigtail_hal::spec::{AXES, CHANNELS, MICRO_AXES, SIDES};
use pigtail_hal::{Command as Said, Counts, FiberHandling, Machine, Measurement as Seen, Volts};
use pigtail_twin::Truth;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A table of numbers of a known shape, `NaN` where it has none and may have none.
fn table<const N: usize, const M: usize>(
    argument: &str,
    array: &PyReadonlyArrayDyn<'_, f64>,
    may_lack: bool,
) -> Result<[[f64; M]; N], Refused> {
    if array.shape() != [N, M] {
        let message = format!("has the shape {:?}; accepted is [{N}, {M}]", array.shape());
        return Err(refused(argument, format!("{:?}", array.shape()), message));
    }
    let mut table = [[0.0; M]; N];
    for ((i, j), value) in array
        .as_array()
        .indexed_iter()
        .map(|(at, value)| ((at[0], at[1]), *value))
    {
        if !(value.is_finite() || may_lack && value.is_nan()) {
            let message = format!("is {value} at [{i}, {j}]; accepted are finite numbers");
            return Err(refused(argument, value, message));
        }
        table[i][j] = value;
    }
    Ok(table)
}

/// What is said in one servo cycle.
#[pyclass(frozen, module = "pigtail._pigtail")]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Command(Said);

#[pymethods]
impl Command {
    #[new]
    #[pyo3(signature = (motors_v, micro_v, laser, fiber, references_counts))]
    fn new(
        py: Python<'_>,
        motors_v: Option<PyReadonlyArrayDyn<'_, f64>>,
        micro_v: Option<PyReadonlyArrayDyn<'_, f64>>,
        laser: bool,
        fiber: [Option<(String, u8)>; SIDES],
        references_counts: Option<PyReadonlyArrayDyn<'_, f64>>,
    ) -> PyResult<Self> {
        let read = || -> Result<Said, Refused> {
            let mut said = Said::IDLE;
            if let Some(array) = &motors_v {
                let volts: [[f64; AXES]; SIDES] = table("motors_v", array, false)?;
                said.motors = volts.map(|side| side.map(Volts));
            }
            if let Some(array) = &micro_v {
                let volts: [[f64; MICRO_AXES]; SIDES] = table("micro_v", array, false)?;
                said.micro = volts.map(|side| side.map(Volts));
            }
            if let Some(array) = &references_counts {
                let counts: [[f64; AXES]; SIDES] = table("references_counts", array, true)?;
                let count = |value: f64| (!value.is_nan()).then(|| Counts(value.round() as i64));
                said.references = counts.map(|side| side.map(count));
            }
            for (of, wanted) in said.fiber.iter_mut().zip(&fiber) {
                *of = match wanted {
                    None => None,
                    Some((what, port)) => Some(match what.as_str() {
                        "load" => FiberHandling::Load(*port),
                        "attach" => FiberHandling::Attach,
                        "unload" => FiberHandling::Unload,
                        other => {
                            let message = format!(
                                "is \"{other}\"; accepted is \"load\", \"attach\" or \"unload\""
                            );
                            return Err(refused("fiber", other, message));
                        }
                    }),
                };
            }
            said.laser = laser;
            Ok(said)
        };
        read()
            .map(Self)
            .map_err(|error| Failure::from(error).raise(py))
    }
}

/// What was measured in one servo cycle.
#[pyclass(frozen, module = "pigtail._pigtail")]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measurement(Seen);

/// A tip as vision sees it: x, z and the deviation of one frame's noise, micrometres.
type Tip = (f64, f64, f64);

#[pymethods]
impl Measurement {
    #[getter]
    fn time_s(&self) -> f64 {
        self.0.time
    }

    #[getter]
    fn encoders_counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let rows: Vec<Vec<i64>> = self
            .0
            .encoders
            .iter()
            .map(|side| side.iter().map(|count| count.0).collect())
            .collect();
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// When the light was sampled, and the photodiodes.
    #[getter]
    fn light<'py>(&self, py: Python<'py>) -> Option<(f64, Bound<'py, PyArray1<f64>>)> {
        let light = self.0.light?;
        let volts: [f64; CHANNELS] = light.volts.map(|volts| volts.0);
        Some((light.time, PyArray1::from_slice(py, &volts)))
    }

    /// When a frame was exposed, the fibers' tips and the sensing fiber's.
    #[getter]
    fn vision(&self) -> Option<(f64, Vec<Option<Tip>>, Tip)> {
        let um = |tip: pigtail_hal::TipFix| (1e6 * tip.x, 1e6 * tip.z, 1e6 * tip.sigma);
        let frame = self.0.vision?;
        let fibers = frame.fiber.iter().map(|tip| tip.map(um)).collect();
        Some((frame.time, fibers, um(frame.sensing)))
    }

    #[getter]
    fn probes_um<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let rows = self.0.probes.map(|probes| {
            let um = |side: &[f64; AXES]| side.iter().map(|metres| 1e6 * metres).collect();
            probes.iter().map(um).collect::<Vec<Vec<f64>>>()
        });
        Ok(match rows {
            Some(rows) => Some(PyArray2::from_vec2(py, &rows)?),
            None => None,
        })
    }

    #[getter]
    fn stop(&self) -> bool {
        self.0.stop
    }
}

/// A simulated machine that a seed draws.
#[pyclass(frozen, module = "pigtail._pigtail")]
pub(crate) struct Twin {
    // On the heap of Rust, for its numbers that a processor works on several at once want another alignment than
    // Python gives what it holds.
    twin: Mutex<Box<pigtail_twin::Twin>>,
}

impl Twin {
    fn twin(&self) -> MutexGuard<'_, Box<pigtail_twin::Twin>> {
        self.twin.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Twin {
    #[new]
    #[pyo3(signature = (rig, seed, fault))]
    fn new(py: Python<'_>, rig: &Rig, seed: u64, fault: Vec<String>) -> PyResult<Self> {
        let draw = || -> Result<pigtail_twin::Twin, Failure> {
            let mut setup = rig.setup()?;
            setup.faults = broken(None, &fault)?;
            let setup = setup.at(seed)?;
            // A fault that is said has its time.
            Ok(setup.broken_twin(seed, 0.0)?.0)
        };
        draw()
            .map(|twin| Self {
                twin: Mutex::new(Box::new(twin)),
            })
            .map_err(|failure| failure.raise(py))
    }

    /// One servo cycle.
    fn exchange(&self, py: Python<'_>, command: &Command) -> PyResult<Measurement> {
        self.twin()
            .exchange(&command.0)
            .map(Measurement)
            .map_err(|fault| Failure::Fault(fault).raise(py))
    }

    fn stop(&self) {
        self.twin().stop();
    }

    #[getter]
    fn period_s(&self) -> f64 {
        self.twin().spec().period()
    }

    /// The truth, for those who ask through `pigtail.sim`.
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Truth {
            input,
            outputs,
            smallest_gap,
        } = self.twin().truth();
        let fibers = std::iter::once(input)
            .chain(outputs)
            .map(|fiber| fiber.map(|f| (1e6 * f.x, 1e6 * f.y, 1e6 * f.gap, f.coupling)));
        let dict = PyDict::new(py);
        dict.set_item("fibers", fibers.collect::<Vec<_>>())?;
        dict.set_item("smallest_gap_um", 1e6 * smallest_gap)?;
        Ok(dict)
    }
}
