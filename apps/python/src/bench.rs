//! Benches: a rig of one, its twin for Python to drive, and our alignment on benches of both languages.

use crate::failure::Failure;
use crate::input::refused;
use crate::own_bench::OwnBench;
use crate::wire::{self, CapsWire, EventWire, PoseWire};
use crate::work::work;
use pigtail_control::align::{Found, find_peak};
use pigtail_control::beam::Beam;
use pigtail_control::outcome::Halt;
use pigtail_control::station::{Observer, Sample};
use pigtail_evaluate::bench::align_on;
use pigtail_hal::Side;
use pigtail_hal::bench::{Bench, Group, Meter, Pose, Ticket};
use pigtail_machines::bench::Guard;
use pigtail_session::bench::{BenchSetup, guarded};
use pigtail_session::calibrations::RunsOn;
use pigtail_session::rig::Named;
use pigtail_session::samples::Record;
use pigtail_session::session::Options;
use pigtail_twin::Truth;
use pigtail_twin::bench::BenchTwin as Simulated;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A rig that is controlled by position, and a recipe.
#[pyclass(frozen, module = "pigtail._pigtail")]
#[derive(Debug, Clone)]
pub(crate) struct BenchRig {
    pub(crate) known: pigtail_session::bench::BenchRig,
    /// Gone where the rig has no twin.
    setup: Option<BenchSetup>,
}

impl BenchRig {
    /// The rig with its truth, to draw twins around.
    pub(crate) fn setup(&self) -> Result<&BenchSetup, pigtail_hal::Error> {
        let none = || pigtail_session::rig::no_twin(&self.known.name);
        self.setup.as_ref().ok_or_else(none)
    }
}

#[pymethods]
impl BenchRig {
    #[new]
    #[pyo3(signature = (rig, recipe, calibration))]
    fn new(
        py: Python<'_>,
        rig: &str,
        recipe: &str,
        calibration: Option<PathBuf>,
    ) -> PyResult<Self> {
        let named = Named {
            rig,
            recipe,
            calibration: calibration.as_deref(),
            ..Named::default()
        };
        let open = || -> Result<Self, pigtail_hal::Error> {
            let known = pigtail_session::bench::BenchRig::load_named(&named)?;
            let twin = known.has_twin().then(|| BenchSetup::of(known.clone()));
            let setup = twin.transpose()?;
            Ok(Self { known, setup })
        };
        open().map_err(|error| Failure::from(error).raise(py))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.known.name
    }

    #[getter]
    fn recipe(&self) -> &str {
        &self.known.recipe_name
    }

    #[getter]
    fn has_twin(&self) -> bool {
        self.setup.is_some()
    }

    #[getter]
    fn hashes(&self) -> Vec<(String, String)> {
        self.known.hashes.clone()
    }

    fn runs_on(&self) -> String {
        RunsOn::of_bench(&self.known).to_string()
    }

    fn caps(&self) -> CapsWire {
        CapsWire::of(&self.known.spec.caps())
    }

    /// Poses that were taught: arm, port, pose, deviation across, deviation and bound along z.
    fn taught(&self) -> Vec<(usize, usize, PoseWire, f64, f64, f64)> {
        let taught = self.known.belief.taught.iter();
        taught
            .map(|of| {
                (
                    of.arm, of.port, of.pose.0, of.across, of.sigma_z, of.bound_z,
                )
            })
            .collect()
    }

    fn meters(&self) -> Vec<usize> {
        let meters = self.known.belief.meters.iter();
        meters.map(|meter| meter.0).collect()
    }

    /// The gap at which light is searched for, and the one at which fibers are attached, metres.
    fn gaps(&self) -> (f64, f64) {
        let recipe = &self.known.recipe;
        let taught = self.known.belief.taught.iter();
        let widest = taught.map(|of| of.search_gap(recipe)).fold(0.0, f64::max);
        (widest, recipe.approach.gap)
    }

    /// Distance from the peak, metres, at which the light at a gap has fallen to 1/e.
    fn width(&self, gap: f64) -> f64 {
        let recipe = &self.known.recipe;
        Beam::new(&recipe.mode, recipe.ports.exit_angle).width(gap)
    }

    fn pose_at(&self, py: Python<'_>, arm: usize, port: usize, gap: f64) -> PyResult<PoseWire> {
        let taught = self.known.belief.taught(arm, port);
        let taught = taught.ok_or_else(|| {
            let message = "no pose was taught for it; accepted are those of `taught`";
            let value = format!("arm {arm}, port {port}");
            Failure::from(refused("port", value, message)).raise(py)
        })?;
        Ok(taught.at_gap(&self.known.recipe, gap, [0.0; 2]).0)
    }
}

/// The bench that a seed draws, guarded.
#[pyclass(frozen, module = "pigtail._pigtail")]
pub(crate) struct BenchTwin {
    // On Rust's heap, as its numbers want another alignment than Python gives what it holds.
    bench: Mutex<Box<Guard<Simulated>>>,
}

impl BenchTwin {
    pub(crate) fn bench(&self) -> MutexGuard<'_, Box<Guard<Simulated>>> {
        self.bench.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl BenchTwin {
    #[new]
    fn new(py: Python<'_>, rig: &BenchRig, seed: u64) -> PyResult<Self> {
        let draw = || -> Result<Simulated, pigtail_hal::Error> { rig.setup()?.twin(seed) };
        let twin = draw().map_err(|error| Failure::from(error).raise(py))?;
        let guard = Guard::new(twin).with_planes(rig.known.planes());
        Ok(Self {
            bench: Mutex::new(Box::new(guard)),
        })
    }

    fn caps(&self) -> CapsWire {
        CapsWire::of(self.bench().caps())
    }

    fn now(&self) -> f64 {
        self.bench().now()
    }

    fn play(&self, py: Python<'_>, group: usize, law: &Bound<'_, PyAny>) -> PyResult<u64> {
        let law = wire::law(law)?;
        let played = self.bench().play(Group(group), law);
        played
            .map(|ticket| ticket.0)
            .map_err(|why| wire::raised(py, &why))
    }

    fn bend(&self, py: Python<'_>, ticket: u64, law: &Bound<'_, PyAny>) -> PyResult<f64> {
        let law = wire::law(law)?;
        let bent = self.bench().bend(Ticket(ticket), law);
        bent.map_err(|why| wire::raised(py, &why))
    }

    fn request(&self, py: Python<'_>, what: (String, usize, usize)) -> PyResult<u64> {
        let requested = self.bench().request(wire::request(&what)?);
        requested
            .map(|ticket| ticket.0)
            .map_err(|why| wire::raised(py, &why))
    }

    fn next(&self, py: Python<'_>, by: f64) -> PyResult<EventWire> {
        // Short of a minute nobody else waits for long.
        let event = py.detach(|| self.bench().next(by));
        match event {
            Ok(event) => Ok(EventWire::of(event)),
            Err(fault) => Err(Failure::Fault(fault).raise(py)),
        }
    }

    fn pose(&self, group: usize, at: f64) -> Option<(PoseWire, bool)> {
        let known = self.bench().pose(Group(group), at)?;
        Some((known.pose.0, known.measured))
    }

    fn reaches(&self, group: usize, pose: PoseWire) -> bool {
        self.bench().reaches(Group(group), &Pose(pose))
    }

    fn stop(&self) {
        self.bench().stop();
    }

    /// The truth, for those who ask through `pigtail.sim`.
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let bench = self.bench();
        let Truth {
            input,
            outputs,
            smallest_gap,
        } = bench.inner().truth();
        let um = |f: pigtail_twin::FiberTruth| (1e6 * f.x, 1e6 * f.y, 1e6 * f.gap, f.coupling);
        let fibers = std::iter::once(input).chain(outputs);
        let carried = Side::ALL.map(|side| bench.inner().carried(side).map(um));
        let dict = PyDict::new(py);
        dict.set_item("fibers", fibers.map(|f| f.map(um)).collect::<Vec<_>>())?;
        dict.set_item("smallest_gap_um", 1e6 * smallest_gap)?;
        dict.set_item("carried", carried)?;
        Ok(dict)
    }
}

/// A bench of either language.
#[derive(FromPyObject)]
pub(crate) enum AnyBench<'py> {
    /// The twin.
    Twin(PyRef<'py, BenchTwin>),
    /// What Python makes of its own: the class that checks what it says.
    Own(Bound<'py, PyAny>),
}

/// Keeps everything, and tells how far it is.
struct Watcher<'w> {
    record: Record,
    phases: u64,
    tell: &'w mut (dyn FnMut(u64, &str) + Send),
}

impl Observer for Watcher<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.record.phase(port, phase, time);
        (self.tell)(self.phases, &format!("{port} {phase}"));
        self.phases += 1;
    }

    fn sample(&mut self, sample: &Sample) {
        self.record.sample(sample);
    }
}

/// A job on a bench of either language. One of Rust works on a thread of its own, as all our work does; one of Python
/// stays on the thread that called, for it may drive what no other thread may.
fn on<T: Send>(
    py: Python<'_>,
    bench: AnyBench<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(&mut dyn Bench, &Options, &mut (dyn FnMut(u64, &str) + Send)) -> Result<T, Failure>
    + Send,
) -> PyResult<T> {
    match bench {
        AnyBench::Twin(twin) => {
            let twin: &BenchTwin = &twin;
            work(py, progress, |watch| {
                let options = Options {
                    stop: watch.stop.clone(),
                    ..Options::default()
                };
                let mut tell = |done, text: &str| watch.tell(done, 0, text);
                job(&mut **twin.bench(), &options, &mut tell)
            })
        }
        AnyBench::Own(own) => {
            let progress = progress.map(|progress| progress.clone().unbind());
            let mut bench = OwnBench::new(own)?;
            let options = Options::default();
            let stop = options.stop.clone();
            let mut mistake = None;
            let result = py.detach(|| {
                let mut tell = |done: u64, text: &str| {
                    let Some(progress) = &progress else { return };
                    let told = Python::attach(|py| progress.call1(py, (done, 0_u64, text)));
                    if let Err(error) = told {
                        mistake.get_or_insert(error);
                        stop.store(true, Ordering::Relaxed);
                    }
                };
                let result = job(&mut bench, &options, &mut tell);
                bench.stop();
                result
            });
            // What Python raised is why all that came after it came.
            if let Some(error) = bench.raised().or(mistake) {
                return Err(error);
            }
            result.map_err(|failure| failure.raise(py))
        }
    }
}

/// Aligns a device on a bench: its document as JSON and as text, and the light samples.
#[pyfunction]
#[pyo3(signature = (bench, rig, progress))]
pub(crate) fn align_bench<'py>(
    py: Python<'py>,
    bench: AnyBench<'py>,
    rig: &BenchRig,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(String, Bound<'py, PyDict>)> {
    let known = &rig.known;
    let (document, record) = on(py, bench, progress, |bench, options, tell| {
        let mut watcher = Watcher {
            record: Record::default(),
            phases: 0,
            tell,
        };
        let document = align_on(known, bench, options, &mut watcher);
        let json = serde_json::to_string(&document).map_err(anyhow::Error::from)?;
        Ok((json, watcher.record))
    })?;
    Ok((document, crate::align::samples(py, &record)?))
}

/// Where a peak was found, x and y, how well it is known, and its light; metres and volts.
type Peak = (f64, f64, f64, f64);

/// Brings a group of a bench to the light's peak.
#[pyfunction]
#[pyo3(signature = (bench, rig, group, meter, gap, dark, progress))]
pub(crate) fn peak_on(
    py: Python<'_>,
    bench: AnyBench<'_>,
    rig: &BenchRig,
    group: usize,
    meter: usize,
    gap: f64,
    dark: Option<f64>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Peak> {
    let known = &rig.known;
    on(py, bench, progress, |bench, options, _| {
        let caps = bench.caps();
        for (key, index, count) in [
            ("group", group, caps.groups.len()),
            ("meter", meter, caps.channels.len()),
        ] {
            if index >= count {
                let message = format!("is {index}; accepted is 0 to {}", count.max(1) - 1);
                return Err(refused(key, index, message).into());
            }
        }
        let recipe = &known.recipe;
        let mut guard = guarded(known, bench, options);
        let found = find_peak(&mut guard, Group(group), Meter(meter), recipe, gap, dark);
        match found {
            Ok(Found {
                at: [x, y],
                deviation,
                light,
            }) => Ok((x, y, deviation, light)),
            Err(Halt::Fault(fault)) => Err(Failure::Fault(fault)),
            Err(Halt::Outcome(outcome)) => Err(Failure::Outcome(outcome)),
        }
    })
}

/// Wilson's interval of a share.
#[pyfunction]
pub(crate) fn wilson(hits: u64, trials: u64) -> [f64; 2] {
    pigtail_numerics::statistics::wilson(hits, trials)
}
