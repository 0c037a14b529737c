//! Many environments at once: the twin of `python/pigtail/gym.py`, whose one environment drives a bench by hand. Both do
//! the same in the same order, and a test holds them together to the last bit.

use crate::bench::BenchRig;
use crate::failure::Failure;
use crate::input::refused;
use crate::work::on_all_cores;
use numpy::ndarray::{Array1, Array2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pigtail_control::align::Taught;
use pigtail_control::recipe::Recipe;
use pigtail_hal::Fault;
use pigtail_hal::bench::{
    Bench, Degree, Event, Group, GroupCaps, Law, Light, Limits, Meter, Pose, Refused, Request,
    Stage, Ticket,
};
use pigtail_machines::bench::Guard;
use pigtail_session::bench::BenchSetup;
use pigtail_twin::bench::BenchTwin;
use pyo3::prelude::*;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// How far below and behind its place an arm is before it comes there, metres and gaps: what gives way does so in one
/// direction.
const RUN_UP: (f64, f64) = (40e-6, 2.0);
/// Samples of the dark that are left out, for the meter may remember the laser.
const REMEMBERED: usize = 5;
const ARMS: usize = 2;

/// What an environment asks for.
#[derive(Debug, Clone)]
struct Task {
    /// Gap at which it begins, metres.
    gap: f64,
    /// What is moved, from its place at the start.
    axes: Vec<Axis>,
    /// Farthest way of an axis in a step, micrometres.
    most: f64,
    /// Machine time, seconds.
    limit: f64,
    /// Light above the dark that ends it, volts: then it is not the light that is rewarded, but to have it soon.
    found: Option<f64>,
}

/// An axis of an action.
#[derive(Debug, Clone, Copy)]
struct Axis {
    group: usize,
    degree: usize,
    low: f64,
    high: f64,
}

/// Why an environment cannot go on.
enum Stuck {
    Fault(Fault),
    Refused(Refused),
}

impl From<Fault> for Stuck {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<Refused> for Stuck {
    fn from(refused: Refused) -> Self {
        Self::Refused(refused)
    }
}

/// One environment.
struct One {
    bench: Guard<BenchTwin>,
    meter: usize,
    /// Where its groups stood at the start.
    origin: Vec<Pose>,
    /// The beams that they go along.
    beams: Vec<Option<Taught>>,
    told: Vec<f64>,
    light: f64,
    dark: f64,
    began: f64,
    /// To be begun anew with the next step.
    over: bool,
}

/// What a step gives.
#[derive(Debug, Clone, Default)]
struct Seen {
    observation: Vec<f32>,
    reward: f64,
    terminated: bool,
    truncated: bool,
}

fn until(bench: &mut dyn Bench, mut left: Vec<Ticket>) -> Result<Vec<Light>, Stuck> {
    let mut lights = Vec::new();
    let end = bench.now() + 120.0;
    while !left.is_empty() {
        match bench.next(end)? {
            Event::Done(ticket) => left.retain(|of| *of != ticket),
            Event::Light(light) => lights.push(light),
            Event::Batch(batch) => lights.extend(batch),
            Event::Failed(ticket, why) if left.contains(&ticket) => {
                return Err(Refused::State(why).into());
            }
            Event::Time => return Err(Refused::State("it is not done".to_owned()).into()),
            Event::Failed(..) | Event::Played(_) | Event::Frame(_) => {}
        }
    }
    Ok(lights)
}

fn next_light(bench: &mut dyn Bench, meter: usize) -> Result<f64, Fault> {
    let end = bench.now() + 10.0;
    loop {
        let lights = match bench.next(end)? {
            Event::Light(light) => vec![light],
            Event::Batch(batch) => batch,
            _ => continue,
        };
        let volts = lights.iter().map(|light| light.volts[meter]);
        if let Some(volts) = volts.into_iter().find(|volts| !volts.is_nan()) {
            return Ok(volts);
        }
    }
}

fn line(to: Pose) -> Law {
    let limits = Limits::default();
    Law::Line { to, limits }
}

impl One {
    fn begin(setup: &BenchSetup, task: &Task, seed: u64) -> Result<Self, Failure> {
        let rig = &setup.rig;
        let mut bench = Guard::new(setup.twin(seed)?).with_planes(rig.planes());
        let Meter(meter) = rig.belief.meters[0];
        let mut prepare = || -> Result<(f64, f64), Stuck> {
            let mut tickets = Vec::new();
            for arm in 0..ARMS {
                tickets.push(bench.request(Request::Load { arm, port: 0 })?);
            }
            tickets.push(bench.request(Request::Laser(false))?);
            let lights = until(&mut bench, tickets)?;
            let dark = lights.iter().skip(REMEMBERED).map(|of| of.volts[meter]);
            let dark: Vec<f64> = dark.filter(|volts| !volts.is_nan()).collect();
            let dark = dark.iter().sum::<f64>() / dark.len() as f64;
            let on = bench.request(Request::Laser(true))?;
            until(&mut bench, vec![on])?;
            for (below, times) in [RUN_UP, (0.0, 1.0)] {
                let mut tickets = Vec::new();
                for arm in 0..ARMS {
                    let none = || Refused::State(format!("no pose was taught for arm {arm}"));
                    let taught = rig.belief.taught(arm, 0).ok_or_else(none)?;
                    let coarse = bench.caps().group(arm, Stage::Coarse).ok_or_else(none)?;
                    let at = taught.at_gap(&rig.recipe, times * task.gap, [0.0; 2]);
                    tickets.push(bench.play(coarse, line(at + Pose::at(0.0, -below, 0.0)))?);
                }
                until(&mut bench, tickets)?;
            }
            let light = next_light(&mut bench, meter)?;
            Ok((dark, light))
        };
        let (dark, light) = prepare().map_err(|stuck| match stuck {
            Stuck::Fault(fault) => Failure::Fault(fault),
            Stuck::Refused(refused) => Failure::Other(anyhow::Error::new(refused)),
        })?;
        let beam = |of: &GroupCaps| match of.stage {
            Stage::Coarse => rig.belief.taught(of.arm, 0).copied(),
            Stage::Fine => None,
        };
        let beams: Vec<Option<Taught>> = bench.caps().groups.iter().map(beam).collect();
        let at = |of: &Taught| of.at_gap(&rig.recipe, task.gap, [0.0; 2]);
        let at = |of: &Option<Taught>| of.as_ref().map_or(Pose::ZERO, at);
        let origin = beams.iter().map(at).collect();
        Ok(Self {
            began: bench.now(),
            told: vec![0.0; task.axes.len()],
            over: false,
            bench,
            meter,
            origin,
            beams,
            light,
            dark,
        })
    }

    fn observation(&self, task: &Task) -> Vec<f32> {
        let now = self.bench.now();
        let mut seen = Vec::with_capacity(2 + 2 * task.axes.len());
        seen.push(self.light as f32);
        seen.extend(self.told.iter().map(|told| *told as f32));
        seen.extend(task.axes.iter().map(|axis| {
            let at = self.bench.pose(Group(axis.group), now);
            let at = at.map_or(f64::NAN, |at| at.pose.0[axis.degree]);
            (1e6 * (at - self.origin[axis.group].0[axis.degree])) as f32
        }));
        seen.push((task.limit - (now - self.began)) as f32);
        seen
    }

    fn first(&self, task: &Task) -> Seen {
        Seen {
            observation: self.observation(task),
            ..Seen::default()
        }
    }

    fn step(&mut self, task: &Task, recipe: &Recipe, action: &[f32]) -> Seen {
        let before = self.bench.now();
        let mut wanted = self.told.clone();
        for ((wanted, by), axis) in wanted.iter_mut().zip(action).zip(&task.axes) {
            let by = f64::from(*by).clamp(-task.most, task.most);
            *wanted = (*wanted + by).clamp(axis.low, axis.high);
        }
        for group in 0..self.origin.len() {
            let of = |axis: &Axis| axis.group == group;
            if !task.axes.iter().any(of) {
                continue;
            }
            let mut to = self.origin[group];
            let moved = task.axes.iter().zip(&wanted);
            let (along, across): (Vec<_>, Vec<_>) = moved
                .filter(|(axis, _)| of(axis))
                .partition(|(axis, _)| axis.degree == Degree::Z.index());
            for (_, wanted) in along {
                // Along the beam, and not straight on: the facet is inclined.
                to = self.beams[group].map_or(to, |taught| {
                    taught.at_gap(recipe, task.gap - 1e-6 * wanted, [0.0; 2])
                });
            }
            for (axis, wanted) in across {
                to.0[axis.degree] += 1e-6 * wanted;
            }
            // What is refused does not move.
            if self.bench.play(Group(group), line(to)).is_ok() {
                for (k, axis) in task.axes.iter().enumerate() {
                    if of(axis) {
                        self.told[k] = wanted[k];
                    }
                }
            }
        }
        let heard = next_light(&mut self.bench, self.meter);
        let stopped = heard.is_err();
        let found = match heard {
            Ok(light) => {
                self.light = light;
                task.found.is_some_and(|least| light - self.dark >= least)
            }
            Err(_) => false,
        };
        let now = self.bench.now();
        let took = (now - before) / task.limit;
        let reward = match task.found {
            None if stopped => 0.0,
            None => (self.light - self.dark) * took,
            Some(_) => f64::from(u8::from(found)) - took,
        };
        let terminated = stopped || found;
        let truncated = now - self.began >= task.limit;
        self.over = terminated || truncated;
        Seen {
            observation: self.observation(task),
            reward,
            terminated,
            truncated,
        }
    }
}

/// Many environments.
#[pyclass(frozen, module = "pigtail._pigtail")]
pub(crate) struct Environments {
    setup: Box<BenchSetup>,
    task: Task,
    count: usize,
    // Each on Rust's heap: see the twin.
    all: Mutex<Vec<Box<One>>>,
}

/// Observations, rewards, whether they have ended, and whether their time is up.
type Step<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
);

impl Environments {
    fn arrays<'py>(&self, py: Python<'py>, seen: &[Seen]) -> Step<'py> {
        let wide = 2 + 2 * self.task.axes.len();
        let observations =
            Array2::from_shape_fn((seen.len(), wide), |(i, j)| seen[i].observation[j]);
        let of = |get: fn(&Seen) -> bool| Array1::from_iter(seen.iter().map(get)).into_pyarray(py);
        (
            observations.into_pyarray(py),
            Array1::from_iter(seen.iter().map(|seen| seen.reward)).into_pyarray(py),
            of(|seen| seen.terminated),
            of(|seen| seen.truncated),
        )
    }
}

#[pymethods]
impl Environments {
    /// Axes are group, degree, and their range from the start, micrometres.
    #[new]
    fn new(
        py: Python<'_>,
        rig: &BenchRig,
        count: usize,
        gap: f64,
        axes: Vec<(usize, usize, f64, f64)>,
        most: f64,
        limit: f64,
        found: Option<f64>,
    ) -> PyResult<Self> {
        let setup = rig
            .setup()
            .map_err(|error| Failure::from(error).raise(py))?;
        let axis = |(group, degree, low, high)| Axis {
            group,
            degree,
            low,
            high,
        };
        Ok(Self {
            setup: Box::new(setup.clone()),
            task: Task {
                gap,
                axes: axes.into_iter().map(axis).collect(),
                most,
                limit,
                found,
            },
            count,
            all: Mutex::default(),
        })
    }

    fn reset<'py>(&self, py: Python<'py>, seeds: Vec<u64>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let began = py.detach(|| {
            let begin = |seed| One::begin(&self.setup, &self.task, seed).map(Box::new);
            let all: Vec<_> = on_all_cores(|| seeds.into_par_iter().map(begin).collect());
            all.into_iter().collect::<Result<Vec<_>, Failure>>()
        });
        let began = began.map_err(|failure| failure.raise(py))?;
        let seen: Vec<Seen> = began.iter().map(|one| one.first(&self.task)).collect();
        *self.all.lock().unwrap_or_else(PoisonError::into_inner) = began;
        Ok(self.arrays(py, &seen).0)
    }

    /// A step of all; those that are over begin anew with their seed, whatever their action.
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: PyReadonlyArray2<'py, f32>,
        seeds: Vec<u64>,
    ) -> PyResult<Step<'py>> {
        let wanted = [self.count, self.task.axes.len()];
        if actions.shape() != wanted || seeds.len() != self.count {
            let message = format!(
                "has the shape {:?}; accepted is {wanted:?}",
                actions.shape()
            );
            let shape = format!("{:?}", actions.shape());
            return Err(Failure::from(refused("actions", shape, message)).raise(py));
        }
        let actions = actions.as_array().to_owned();
        if let Some(wrong) = actions.iter().find(|by| !by.is_finite()) {
            let message = format!("holds {wrong}; accepted are finite numbers");
            return Err(Failure::from(refused("actions", wrong, message)).raise(py));
        }
        let seen = py.detach(|| {
            let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
            if all.len() != self.count {
                let message = "is called before `reset`; accepted is after it";
                return Err(Failure::from(refused("step", "", message)));
            }
            let one = |(k, one): (usize, &mut Box<One>)| -> Result<Seen, Failure> {
                if one.over {
                    **one = One::begin(&self.setup, &self.task, seeds[k])?;
                    return Ok(one.first(&self.task));
                }
                let action: Vec<f32> = actions.row(k).to_vec();
                Ok(one.step(&self.task, &self.setup.rig.recipe, &action))
            };
            let all = &mut *all;
            let seen: Vec<_> = on_all_cores(|| all.par_iter_mut().enumerate().map(one).collect());
            seen.into_iter().collect::<Result<Vec<_>, Failure>>()
        });
        let seen = seen.map_err(|failure| failure.raise(py))?;
        Ok(self.arrays(py, &seen))
    }
}
