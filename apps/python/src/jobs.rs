//! Experiments on one machine: what they find as JSON, and what they measured as arrays.

use crate::failure::Failure;
use crate::input::{Refused, axis, choice, refused};
use crate::rig::{Belief, Rig, Told};
use crate::work::{Watch, work};
use numpy::PyArray1;
use pigtail_control::calibration::Windups;
use pigtail_control::characterize::Trace;
use pigtail_control::identify::WindupRecord;
use pigtail_control::station::Unobserved;
use pigtail_evaluate::impulse::response::{Form, MACHINES, response};
use pigtail_evaluate::loops::windup;
use pigtail_evaluate::simulate::{Grid, Input, Parameters, joint};
use pigtail_hal::Axis;
use pigtail_session::calibrations::{Change, On};
use pigtail_session::characterize::{Frequency, Resolution, Sine, Step};
use pigtail_session::commission::{Plan, StepDone, StepName, commission as commissioned};
use pigtail_session::identify::{IdentifyWindup, Model};
use pigtail_session::impulse::kind_of;
use pigtail_session::setup::Setup;
use pigtail_session::tune::{Method, Tune, step_of};
use pigtail_store::runs::now;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use std::path::PathBuf;

/// A document, arrays by their names, and what is believed with what was found.
type Found<'py> = (String, Bound<'py, PyDict>, Option<Belief>);

/// Columns of numbers by their names.
type Columns = Vec<(String, Vec<f64>)>;

fn arrays(py: Python<'_>, columns: Columns) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for (name, values) in columns {
        dict.set_item(name, PyArray1::from_vec(py, values))?;
    }
    Ok(dict)
}

fn json(setup: &Setup, document: &impl Serialize) -> Result<String, Failure> {
    let json = serde_json::to_string(&On::new(&setup.rig, document));
    Ok(json.map_err(anyhow::Error::from)?)
}

/// The times of `n` samples, seconds.
fn times(period: f64, n: usize) -> Vec<f64> {
    (0..n).map(|k| k as f64 * period).collect()
}

fn trace(prefix: &str, trace: Trace) -> Columns {
    let column = |name: &str, values| (format!("{prefix}{name}"), values);
    let micrometres = trace.output.iter().map(|metres| 1e6 * metres).collect();
    vec![
        column("time_s", times(trace.period, trace.reference.len())),
        column("reference_counts", trace.reference),
        column("encoder_counts", trace.encoder),
        column("output_um", micrometres),
        column("voltage_v", trace.voltage),
    ]
}

fn scan(prefix: &str, record: &WindupRecord) -> Columns {
    let column = |name: &str, values| (format!("{prefix}{name}"), values);
    vec![
        column("time_s", times(record.period, record.input.len())),
        column("input_rad", record.input.clone()),
        column("output_rad", record.output.clone()),
        column("wanted_rad", record.wanted.clone()),
    ]
}

/// Today, as calibrations date what they hold.
fn today() -> String {
    let now = now();
    now.split('T').next().unwrap_or_default().to_owned()
}

fn stoppable(mut setup: Setup, watch: &Watch) -> Setup {
    setup.options.stop = watch.stop.clone();
    setup
}

/// Tunes the servo of an axis.
#[pyfunction]
#[pyo3(signature = (rig, axis_name, seed, search, trials, step, progress))]
pub(crate) fn tune<'py>(
    py: Python<'py>,
    rig: &Rig,
    axis_name: &str,
    seed: u64,
    search: &str,
    trials: Option<u32>,
    step: Option<i64>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Found<'py>> {
    let (document, columns, belief) = work(py, progress, |watch| {
        let at = axis(axis_name)?;
        rig.axes().concerns(at.axis)?;
        let setup = stoppable(rig.bench(&[])?, watch);
        let method: Method = choice("search", search)?;
        let trials = trials.unwrap_or(method.usual_trials());
        if !(5..=100).contains(&trials) {
            return Err(refused(
                "trials",
                trials,
                format!("is {trials}; accepted is 5 to 100"),
            )
            .into());
        }
        let step = step.unwrap_or_else(|| step_of(&setup.rig, at.axis));
        check_size(&setup, "step", at.axis, step, 20)?;
        let plan = Tune {
            at,
            method,
            trials,
            step,
            seed,
            one_size: false,
        };
        let tuned = setup.run(&plan, seed, &mut Told::new(watch))?;
        let kind = kind_of(at);
        let change = Change {
            table: format!("gains.{kind}"),
            values: tuned.document.gains.values(&today(), &format!("tune {at}")),
            weights: None,
        };
        let belief = rig
            .axes()
            .is_empty()
            .then(|| rig.found(&[change]))
            .transpose()?;
        let document = json(&setup, &tuned.document)?;
        let mut columns = trace("before.", tuned.before);
        columns.extend(trace("after.", tuned.after));
        Ok((document, columns, belief))
    })?;
    Ok((document, arrays(py, columns)?, belief))
}

/// That so many counts are within an axis's range.
fn check_size(
    setup: &Setup,
    key: &str,
    axis: Axis,
    counts: i64,
    least: i64,
) -> Result<(), Refused> {
    let most = 0.4 * setup.rig.range_counts(axis);
    if counts < least || counts as f64 > most {
        let message = format!("is {counts} counts; accepted is {least} to {most:.0}");
        return Err(refused(key, counts, message));
    }
    Ok(())
}

/// Identifies the windup of an axis.
#[pyfunction]
#[pyo3(signature = (rig, axis_name, seed, model, progress))]
pub(crate) fn identify<'py>(
    py: Python<'py>,
    rig: &Rig,
    axis_name: &str,
    seed: u64,
    model: &str,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Found<'py>> {
    let (document, columns, belief) = work(py, progress, |watch| {
        let at = axis(axis_name)?;
        let model: Model = choice("model", model)?;
        let kind = Windups::default().table(at);
        let setup = stoppable(rig.bench(&[&kind])?, watch);
        let table = setup.rig.calibration.windup.table(at);
        let job = IdentifyWindup { at, model, seed };
        let found = setup.run(&job, seed, &mut Told::new(watch))?;
        let change = Change {
            table,
            values: found.values(&today(), &format!("identify windup {at}")),
            weights: None,
        };
        let belief = rig.found(&[change])?;
        let mut columns = scan("", &found.record);
        let [before, after] = &found.before_and_after;
        columns.extend(scan("before.", before));
        columns.extend(scan("after.", after));
        Ok((json(&setup, &found.document)?, columns, Some(belief)))
    })?;
    Ok((document, arrays(py, columns)?, belief))
}

/// What to measure of an axis.
struct Measure<'a> {
    what: &'a str,
    size: Option<i64>,
    frequency: Option<f64>,
    steps: u32,
    seed: u64,
}

/// Measures what an axis can do.
#[pyfunction]
#[pyo3(signature = (rig, axis_name, what, seed, size, frequency_hz, steps, progress))]
pub(crate) fn characterize<'py>(
    py: Python<'py>,
    rig: &Rig,
    axis_name: &str,
    what: &str,
    seed: u64,
    size: Option<i64>,
    frequency_hz: Option<f64>,
    steps: u32,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Found<'py>> {
    let (document, columns, belief) = work(py, progress, |watch| {
        let measure = Measure {
            what,
            size,
            frequency: frequency_hz,
            steps,
            seed,
        };
        measured(rig, axis_name, &measure, watch)
    })?;
    Ok((document, arrays(py, columns)?, belief))
}

/// What may be measured.
const MEASURES: [&str; 6] = [
    "step",
    "sine",
    "resolution",
    "frequency",
    "windup",
    "impulse",
];

fn measured(
    rig: &Rig,
    axis_name: &str,
    measure: &Measure<'_>,
    watch: &Watch,
) -> Result<(String, Columns, Option<Belief>), Failure> {
    let at = axis(axis_name)?;
    rig.axes().concerns(at.axis)?;
    let replaced = format!("impulse.{}", kind_of(at));
    let without: &[&str] = match measure.what {
        "impulse" => &[&replaced],
        _ => &[],
    };
    let setup = stoppable(rig.bench(without)?, watch);
    if let Some(size) = measure.size {
        check_size(&setup, "size", at.axis, size, 1)?;
    }
    let fastest = 0.2 * setup.rig.spec.servo.rate;
    if let Some(hertz) = measure.frequency
        && !(hertz > 0.0 && hertz <= fastest)
    {
        let message = format!("is {hertz}; accepted is above 0 and at most {fastest} Hz");
        return Err(refused("frequency_hz", hertz, message).into());
    }
    if !(10..=10_000).contains(&measure.steps) {
        let message = format!("is {}; accepted is 10 to 10000", measure.steps);
        return Err(refused("steps", measure.steps, message).into());
    }
    let usual = step_of(&setup.rig, at.axis);
    let seed = measure.seed;
    let mut nobody = Unobserved;
    Ok(match measure.what {
        "step" => {
            let size = measure.size.unwrap_or(usual);
            let (d, seen) = setup.run(&Step { at, size }, seed, &mut nobody)?;
            (json(&setup, &d)?, trace("", seen), None)
        }
        "sine" => {
            let usual_hertz = if at.axis == Axis::Z { 8.0 } else { 10.0 };
            let job = Sine {
                at,
                frequency: measure.frequency.unwrap_or(usual_hertz),
                amplitude: measure.size.unwrap_or(usual / 4) as f64,
            };
            let (d, seen) = setup.run(&job, seed, &mut nobody)?;
            (json(&setup, &d)?, trace("", seen), None)
        }
        "resolution" => {
            let steps = measure.steps;
            let rows = setup.run(&Resolution { at, steps }, seed, &mut nobody)?;
            let documents: Vec<_> = rows.iter().map(|(row, _)| row).collect();
            let columns = rows.iter().map(|(row, seen)| {
                let um = seen.increments.iter().map(|metres| 1e6 * metres).collect();
                (format!("increments_um.{}", row.counts_per_step), um)
            });
            let document = serde_json::to_string(&documents).map_err(anyhow::Error::from)?;
            (document, columns.collect(), None)
        }
        "frequency" => {
            let amplitude = measure.size.unwrap_or(usual / 20) as f64;
            let job = Frequency {
                at,
                amplitude,
                seed,
            };
            let (d, responses, seen) = setup.run(&job, seed, &mut nobody)?;
            let mut columns = trace("", seen);
            for (of, response) in ["encoder.", "output."].into_iter().zip(responses) {
                columns.push((format!("{of}frequency_hz"), response.frequency));
                columns.push((format!("{of}gain"), response.gain));
                columns.push((format!("{of}phase_rad"), response.phase));
                columns.push((format!("{of}coherence"), response.coherence));
            }
            (json(&setup, &d)?, columns, None)
        }
        "windup" => {
            let (d, loops) = windup(&setup, at, seed)?;
            let mut columns = Columns::new();
            for (k, of) in loops.iter().enumerate() {
                columns.extend(scan(&format!("{k}."), &of.record));
            }
            (json(&setup, &d)?, columns, None)
        }
        "impulse" => {
            let (d, _, found) = response(&setup, at, &Form::THESIS, MACHINES, seed)?;
            let change = Change {
                table: replaced.clone(),
                values: found.table(&today(), &format!("characterize {at} impulse")),
                weights: None,
            };
            (
                json(&setup, &d)?,
                Columns::new(),
                Some(rig.found(&[change])?),
            )
        }
        other => {
            let message = format!("is \"{other}\"; accepted is one of {MEASURES:?}");
            return Err(refused("what", other, message).into());
        }
    })
}

/// Commissions a machine.
#[pyfunction]
#[pyo3(signature = (rig, seed, steps, devices, progress))]
pub(crate) fn commission(
    py: Python<'_>,
    rig: &Rig,
    seed: u64,
    steps: Vec<String>,
    devices: u64,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Option<Belief>)> {
    work(py, progress, |watch| {
        let setup = stoppable(rig.setup()?, watch);
        let chosen = steps.iter().map(|step| choice::<StepName>("steps", step));
        let chosen = match chosen.collect::<Result<Vec<_>, _>>()? {
            none if none.is_empty() => StepName::of_machines(),
            some => some,
        };
        if !(1..=1000).contains(&devices) {
            return Err(refused(
                "devices",
                devices,
                format!("is {devices}; accepted is 1 to 1000"),
            )
            .into());
        }
        let total = chosen.len() as u64;
        let plan = Plan {
            devices,
            date: today(),
            run: String::new(),
            steps: chosen,
            before: Vec::new(),
        };
        let mut done = 0;
        let told = |done_now: &StepDone| {
            done += 1;
            watch.tell(done, total, format!("{} done", done_now.step.name));
        };
        let found = commissioned(&setup, seed, &plan, &mut Unobserved, told)?;
        let belief = (!found.tables.is_empty()).then_some(Belief(found.belief));
        Ok((json(&setup, &found.document)?, belief))
    })
}

/// What drives a joint.
fn driven(
    voltages: Option<(Vec<f64>, Vec<f64>)>,
    impulse: Option<[f64; 3]>,
    step: Option<f64>,
    triangle: Option<[f64; 2]>,
) -> Result<Input, Refused> {
    let finite = |key: &str, values: &[f64]| match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(refused(
            key,
            value,
            format!("holds {value}; accepted are finite numbers"),
        )),
        None => Ok(()),
    };
    let positive = |key: &str, period: f64| {
        let message = format!("has a period of {period} s; accepted is one above zero");
        if period > 0.0 {
            Ok(())
        } else {
            Err(refused(key, period, message))
        }
    };
    match (voltages, impulse, step, triangle) {
        (Some((times, volts)), None, None, None) => {
            finite("voltages", &times)?;
            finite("voltages", &volts)?;
            if times.is_empty() || times.len() != volts.len() {
                let message = format!(
                    "has {} times and {} voltages; accepted are as many of both, one at least",
                    times.len(),
                    volts.len()
                );
                return Err(refused("voltages", times.len(), message));
            }
            if times[0] < 0.0 || times.windows(2).any(|pair| pair[1] <= pair[0]) {
                let message = "has times that do not increase; accepted are times of zero or more, each above the \
                               one before";
                return Err(refused("voltages", format!("{times:?}"), message));
            }
            Ok(Input::Voltages(times.into_iter().zip(volts).collect()))
        }
        (None, Some([a1, a2, period]), None, None) => {
            finite("impulse", &[a1, a2, period])?;
            positive("impulse", period)?;
            Ok(Input::Impulse { a1, a2, period })
        }
        (None, None, Some(counts), None) => {
            finite("step", &[counts])?;
            Ok(Input::Step(counts))
        }
        (None, None, None, Some([counts, period])) => {
            finite("triangle", &[counts, period])?;
            positive("triangle", period)?;
            Ok(Input::Triangle { counts, period })
        }
        _ => {
            let message = "accepted is exactly one of voltages, impulse, step and triangle";
            Err(refused("input", "", message))
        }
    }
}

/// A file of parameters, or the parameters of a joint as JSON.
#[derive(FromPyObject)]
pub(crate) enum Params {
    Json((String,)),
    File(PathBuf),
}

/// Simulates a joint: its columns by the names of the book.
#[pyfunction]
#[pyo3(signature = (params, axis_name, voltages, impulse, step, triangle, duration_s, row_period_s, max_step_s, progress))]
pub(crate) fn simulate_joint<'py>(
    py: Python<'py>,
    params: Params,
    axis_name: &str,
    voltages: Option<(Vec<f64>, Vec<f64>)>,
    impulse: Option<[f64; 3]>,
    step: Option<f64>,
    triangle: Option<[f64; 2]>,
    duration_s: Option<f64>,
    row_period_s: Option<f64>,
    max_step_s: f64,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let columns = work(py, progress, |_| {
        let parameters = match params {
            Params::File(path) => Parameters::read(&path, axis_name)?,
            Params::Json((json,)) => Parameters::of("", &json)?,
        };
        let input = driven(voltages, impulse, step, triangle)?;
        let grid = Grid {
            duration: duration_s.unwrap_or_else(|| input.duration()),
            row_period: row_period_s.unwrap_or_else(|| input.row_period()),
            max_step: max_step_s,
        };
        for (key, value) in [
            ("duration_s", grid.duration),
            ("row_period_s", grid.row_period),
            ("max_step_s", grid.max_step),
        ] {
            if !(value.is_finite() && value > 0.0) {
                let message = format!("is {value}; accepted is a finite number above zero");
                return Err(refused(key, value, message).into());
            }
        }
        let mut csv = Vec::new();
        joint(&parameters, &input, &grid, &mut csv)?;
        Ok(columns_of(&csv))
    })?;
    arrays(py, columns)
}

/// The columns of a table of numbers that was written just now.
fn columns_of(csv: &[u8]) -> Columns {
    let text = String::from_utf8_lossy(csv);
    let mut lines = text.lines();
    let header = lines.next().unwrap_or_default();
    let mut columns: Columns = header
        .split(',')
        .map(|name| (name.to_owned(), Vec::new()))
        .collect();
    for line in lines {
        for ((_, column), field) in columns.iter_mut().zip(line.split(',')) {
            column.push(field.parse().unwrap_or(f64::NAN));
        }
    }
    columns
}
