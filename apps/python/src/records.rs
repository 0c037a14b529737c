//! What people bring: records of their own axes.

use crate::failure::Failure;
use crate::input::refused;
use crate::work::work;
use numpy::PyArray1;
use pigtail_records::capital;
use pigtail_records::columns::Named;
use pigtail_records::part::Drive;
use pigtail_records::servo::{self, Roles, friction_name, method_name};
use pigtail_sysid::servo::{Friction, Method, Settings};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A document as JSON and as text, arrays by their names, and the axis as a fragment of a rig.
type Found<'py> = (String, String, Bound<'py, PyDict>, Option<String>);

fn column(key: &str, name: &str) -> Result<Named, Failure> {
    let named = name.parse::<Named>();
    named.map_err(|why| refused(key, format!("{name:?}"), why).into())
}

fn named<T: Copy>(
    key: &str,
    name: &str,
    all: &[T],
    name_of: fn(T) -> &'static str,
) -> Result<T, Failure> {
    let found = all.iter().find(|of| name_of(**of) == name);
    found.copied().ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|of| name_of(*of)).collect();
        refused(
            key,
            name,
            format!("is \"{name}\"; accepted is one of {names:?}"),
        )
        .into()
    })
}

fn above_zero(key: &str, value: Option<f64>) -> Result<(), Failure> {
    if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
        return Err(refused(key, value, format!("is {value}; accepted is above zero")).into());
    }
    Ok(())
}

/// Identifies a servo axis from a record. `time`, `reference`, `position`, `voltage` name columns.
#[pyfunction]
#[pyo3(signature = (
    data, position, voltage, force_per_volt, time, reference, rate, validate, friction, injected, method, cutoff, gear_ratio,
    lead, counts_per_turn, voltage_limit, date, progress
))]
pub(crate) fn identify_servo<'py>(
    py: Python<'py>,
    data: PathBuf,
    position: &str,
    voltage: &str,
    force_per_volt: f64,
    time: Option<&str>,
    reference: Option<&str>,
    rate: Option<f64>,
    validate: Option<PathBuf>,
    friction: &str,
    injected: Option<&str>,
    method: Option<&str>,
    cutoff: Option<f64>,
    gear_ratio: Option<f64>,
    lead: Option<f64>,
    counts_per_turn: Option<u32>,
    voltage_limit: Option<f64>,
    date: &str,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Found<'py>> {
    let (document, words, account, fragment) = work(py, progress, |_| {
        for (key, value) in [
            ("force_per_volt", Some(force_per_volt)),
            ("rate_hz", rate),
            ("cutoff_hz", cutoff),
            ("gear_ratio", gear_ratio),
            ("lead_m", lead),
            ("voltage_limit_v", voltage_limit),
        ] {
            above_zero(key, value)?;
        }
        let all = [Friction::Symmetric, Friction::Asymmetric];
        let friction = named("friction", friction, &all, friction_name)?;
        let all = [
            Method::LeastSquares,
            Method::Weighted,
            Method::Instrumental,
            Method::Delayed,
        ];
        let method = method
            .map(|method| named("method", method, &all, method_name))
            .transpose()?;
        let roles = Roles {
            time: time.map(|name| column("time", name)).transpose()?,
            rate,
            reference: reference
                .map(|name| column("reference", name))
                .transpose()?,
            position: column("position", position)?,
            voltage: column("voltage", voltage)?,
            injected: injected.map(|name| column("injected", name)).transpose()?,
        };
        let first = roles.read(&data)?;
        let second = validate.as_ref().map(|path| roles.read(path)).transpose()?;
        servo::check_cutoff(&data, &first, cutoff, "cutoff_hz")?;
        servo::check_lead(&first, lead, "lead_m")?;
        let settings = Settings {
            cutoff,
            ..Settings::new(force_per_volt)
        };
        let mut found = servo::servo(&first, second.as_ref(), &settings, (friction, method));
        let read = first.understood.clone();
        found.answer.more.insert("read".to_owned(), read.into());
        let drive = Drive {
            ratio: gear_ratio.unwrap_or(Drive::PLAIN.ratio),
            lead: lead.unwrap_or(Drive::PLAIN.lead),
            counts: counts_per_turn,
            limit: voltage_limit,
        };
        let origin = format!("identify_servo, {date}");
        let fragment = found.fragment(&first, force_per_volt, &drive, (date, &origin));
        let answer = &found.answer;
        let words = format!("{}{}\n", answer.lines(), capital(&answer.verdict));
        let account = found.shown.map(|shown| shown.account);
        let document = answer.json().to_string();
        Ok((document, words, account, fragment.transpose()?))
    })?;
    let arrays = PyDict::new(py);
    if let Some(account) = account {
        for (name, values) in [
            ("time_s", account.time),
            ("measured_force", account.measured),
            ("modelled_force", account.modelled),
            ("position", account.position),
            ("velocity", account.velocity),
        ] {
            arrays.set_item(name, PyArray1::from_vec(py, values))?;
        }
    }
    Ok((document, words, arrays, fragment))
}
