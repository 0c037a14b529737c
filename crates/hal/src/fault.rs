//! How a machine says that it has stopped.

use serde::Serialize;
use std::borrow::Cow;
use thiserror::Error;

/// The machine stopped by itself, and is safe.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[error("{rule} on {axis} at {time:.4} s: {value}, where {limit} is accepted")]
pub struct Fault {
    /// The rule that was broken, such as `command is a number`.
    pub rule: Cow<'static, str>,
    /// The axis or instrument, such as `left.z`.
    pub axis: String,
    /// The offending value with its unit.
    pub value: String,
    /// What would have been accepted, with its unit.
    pub limit: String,
    /// Machine time, seconds since power-on.
    pub time: f64,
}
