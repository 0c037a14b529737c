//! Why a call ends without its result, as the exceptions of the package.

use crate::input::Refused;
use pigtail_control::outcome::Outcome;
use pigtail_hal::{Error, Fault};
use pigtail_session::job::Ended;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::any::Any;

/// Why a call ends without its result.
pub(crate) enum Failure {
    Input(Error),
    Argument(Refused),
    Fault(Fault),
    Outcome(Outcome),
    Other(anyhow::Error),
    /// A mistake of this program.
    Panic(String),
    /// Whatever Python has to say.
    Python(PyErr),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Input(error)
    }
}

impl From<Refused> for Failure {
    fn from(refused: Refused) -> Self {
        Self::Argument(refused)
    }
}

impl From<Ended> for Failure {
    fn from(ended: Ended) -> Self {
        match ended {
            Ended::Input(error) => Self::Input(error),
            Ended::Fault(fault) => Self::Fault(fault),
            Ended::Outcome(outcome) => Self::Outcome(outcome),
            Ended::Unrecorded(error) => Self::Other(error.into()),
        }
    }
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        let input = error.chain().find_map(|cause| {
            let ended = cause.downcast_ref::<Ended>();
            let within = ended.and_then(|ended| match ended {
                Ended::Input(error) => Some(error),
                _ => None,
            });
            within.or_else(|| cause.downcast_ref::<Error>())
        });
        match input {
            Some(input) => Self::Input(input.clone()),
            None => Self::Other(error),
        }
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl Failure {
    /// What a panic said.
    pub(crate) fn panic(panic: &(dyn Any + Send)) -> Self {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
        Self::Panic(text.unwrap_or_else(|| "the program failed".to_owned()))
    }
}

/// The value of a key of a file, as it stands there, where that can be told.
fn value_of(error: &Error) -> Option<String> {
    let text = std::fs::read_to_string(&error.file).ok()?;
    let table: toml::Table = text.parse().ok()?;
    let mut value = &toml::Value::Table(table);
    for key in error.key.split('.').filter(|key| !key.is_empty()) {
        value = value.get(key)?;
    }
    (!value.is_table()).then(|| match value {
        toml::Value::String(text) => text.clone(),
        other => other.to_string(),
    })
}

/// An exception of the package, by its name and what it is made of.
fn exception(py: Python<'_>, name: &str, fields: &Bound<'_, PyDict>) -> PyResult<PyErr> {
    let class = py.import("pigtail._errors")?.getattr(name)?;
    Ok(PyErr::from_value(class.call((), Some(fields))?))
}

impl Failure {
    /// The exception for it.
    pub(crate) fn raise(self, py: Python<'_>) -> PyErr {
        let raised = (|| {
            let fields = PyDict::new(py);
            let name = match self {
                Self::Python(error) => return Ok(error),
                Self::Input(error) => {
                    let message = match error.file.as_str() {
                        "" => format!("{}: {}", error.key, error.message),
                        _ => error.to_string(),
                    };
                    fields.set_item("message", message)?;
                    fields.set_item("file", &error.file)?;
                    fields.set_item("key", &error.key)?;
                    fields.set_item("value", value_of(&error))?;
                    fields.set_item("line", error.line)?;
                    "InputError"
                }
                Self::Argument(refused) => {
                    let Refused {
                        argument,
                        value,
                        message,
                    } = refused;
                    fields.set_item("message", format!("{argument}: {message}"))?;
                    fields.set_item("key", argument)?;
                    fields.set_item("value", value)?;
                    "InputError"
                }
                Self::Fault(fault) => {
                    fields.set_item("message", fault.to_string())?;
                    fields.set_item("code", fault.rule.code())?;
                    fields.set_item("rule", fault.rule.text())?;
                    fields.set_item("axis", &fault.axis)?;
                    fields.set_item("value", &fault.value)?;
                    fields.set_item("limit", &fault.limit)?;
                    fields.set_item("time_s", fault.time)?;
                    "FaultError"
                }
                Self::Outcome(outcome) => {
                    fields.set_item("message", outcome.to_string())?;
                    fields.set_item("outcome", outcome.name())?;
                    "OutcomeError"
                }
                Self::Other(error) => {
                    fields.set_item("message", format!("{error:#}"))?;
                    "Error"
                }
                Self::Panic(what) => {
                    let text = format!("a mistake of pigtail's own, please report it: {what}");
                    fields.set_item("message", text)?;
                    "Error"
                }
            };
            exception(py, name, &fields)
        })();
        raised.unwrap_or_else(|error| error)
    }
}
