//! Hysteresis of the piezos, and the voltage that cancels it (thesis 4.2).
//!
//! Two models of displacement against the history of the voltage:
//!
//! - [`Rbf`], the thesis's: radial basis networks (4.3) of the voltage and one turning point,
//!   forward (4.4) and inverse (4.5), trained with ways forward from the bottom of the range and the
//!   ways back from them; from the forward one follows (4.2) for any number of turns. It knows no
//!   creep.
//! - [`Memory`]: play operators behind a static curve, with creep. It remembers every turn that
//!   still matters.
//!
//! [`fit_memory`] finds a [`Memory`] in a [`Record`]; [`judge`] says how well a model tells a
//! record; [`OnLine`](super::online::OnLine) goes on learning behind either while there is light.

mod fit;
mod memory;
mod rbf;
mod record;
mod spectrum;
mod turns;

pub use fit::{Creep, fit_memory};
pub use memory::{Memory, MemoryState};
pub use rbf::{FORWARD, Network, RIDGE, Rbf, RbfState, Recursive, SPACING, Sample, UNITS};
pub use record::{LEAST, Record, Swing, interpolated};
pub use spectrum::Spectrum;

use serde::{Deserialize, Serialize};

/// Something that no model can be made of.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("`{what}`: {value}; accepted is {accepted}")]
pub struct Invalid {
    /// What is wrong: a parameter, or a column of a record.
    pub what: &'static str,
    /// What was found.
    pub value: String,
    /// What would be accepted.
    pub accepted: String,
}

impl Invalid {
    #[expect(
        clippy::needless_pass_by_value,
        reason = "whoever reports a mistake has no more use for it"
    )]
    fn new(what: &'static str, value: impl ToString, accepted: impl Into<String>) -> Self {
        Self {
            what,
            value: value.to_string(),
            accepted: accepted.into(),
        }
    }
}

/// From the lowest to the highest value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// The lowest.
    pub low: f64,
    /// The highest.
    pub high: f64,
}

impl Range {
    /// The range of a column.
    pub fn of(column: &[f64]) -> Self {
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = column
            .iter()
            .fold(start, |(l, h), v| (l.min(*v), h.max(*v)));
        Self { low, high }
    }

    /// Highest less lowest.
    pub fn width(&self) -> f64 {
        self.high - self.low
    }

    fn check(&self, what: &'static str) -> Result<(), Invalid> {
        if self.width() > 0.0 && self.low.is_finite() && self.high.is_finite() {
            Ok(())
        } else {
            let value = format!("{} to {}", self.low, self.high);
            Err(Invalid::new(what, value, "a range of finite numbers"))
        }
    }

    /// From 0 to `units` over the range.
    fn to_units(self, value: f64, units: f64) -> f64 {
        units * (value - self.low) / self.width()
    }

    fn of_units(self, value: f64, units: f64) -> f64 {
        self.low + value * self.width() / units
    }

    /// From -1 to +1 over the range.
    fn to_share(self, value: f64) -> f64 {
        (2.0 * value - self.low - self.high) / self.width()
    }

    fn of_share(self, share: f64) -> f64 {
        0.5 * (self.low + self.high + share * self.width())
    }
}

/// A model of hysteresis.
#[expect(
    clippy::large_enum_variant,
    reason = "there are four of them, and the servo loop must not follow a pointer for each"
)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "lowercase")]
pub enum Model {
    /// The thesis's.
    Rbf(Rbf),
    /// With full memory.
    Memory(Memory),
}

/// What a [`Model`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum State {
    /// Of the thesis's.
    Rbf(RbfState),
    /// Of the one with full memory.
    Memory(MemoryState),
}

impl Model {
    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Rbf(_) => "rbf",
            Self::Memory(_) => "memory",
        }
    }

    /// Number of basis functions or play operators.
    pub fn functions(&self) -> usize {
        match self {
            Self::Rbf(model) => model.inverse.functions(),
            Self::Memory(model) => model.functions(),
        }
    }

    /// By how much displacement lags behind voltage in the record it was made from, seconds.
    pub fn lag(&self) -> f64 {
        match self {
            Self::Rbf(_) => 0.0,
            Self::Memory(model) => model.lag,
        }
    }

    /// Checks what was read from a file.
    ///
    /// # Errors
    ///
    /// When it is no model of a piezo.
    pub fn check(&self) -> Result<(), Invalid> {
        match self {
            Self::Rbf(model) => model.check(),
            Self::Memory(model) => model.check(),
        }
    }

    /// The state of a piezo that has been cycled with falling amplitude around the middle of its
    /// range, and rests there.
    pub fn switched_on(&self) -> State {
        match self {
            Self::Rbf(model) => {
                let middle = 0.5 * (model.input.low + model.input.high);
                State::Rbf(model.cycled(middle))
            }
            Self::Memory(model) => State::Memory(model.switched_on()),
        }
    }

    /// A state in which nothing is known but the present voltage.
    pub fn at_rest(&self, volts: f64) -> State {
        match self {
            Self::Rbf(model) => State::Rbf(model.cycled(volts)),
            Self::Memory(model) => State::Memory(model.at_rest(volts)),
        }
    }

    /// The displacement `period` seconds later, at the next voltage.
    pub fn displacement(&self, state: &mut State, volts: f64, period: f64) -> f64 {
        match (self, state) {
            (Self::Rbf(model), State::Rbf(state)) => model.displacement(state, volts),
            (Self::Memory(model), State::Memory(state)) => model.displacement(state, volts, period),
            // A state of another model knows nothing of this one.
            (_, state) => {
                *state = self.at_rest(volts);
                self.displacement(state, volts, period)
            }
        }
    }

    /// The voltage for the next wanted displacement, `period` seconds later and within `limits`.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    pub fn voltage(&self, state: &mut State, wanted: f64, period: f64, limits: &Range) -> f64 {
        match (self, state) {
            (Self::Rbf(model), State::Rbf(state)) => model.voltage(state, wanted, limits),
            (Self::Memory(model), State::Memory(state)) => {
                model.voltage(state, wanted, period, limits)
            }
            (_, state) => {
                *state = self.switched_on();
                self.voltage(state, wanted, period, limits)
            }
        }
    }
}

/// What a model says of a record: its displacement at every sample.
pub fn predict(model: &Model, record: &Record) -> Vec<f64> {
    let mut state = model.at_rest(record.input[0]);
    let lag = model.lag();
    let mut last = record.time[0] - record.period();
    (0..record.len())
        .map(|k| {
            let period = record.time[k] - last;
            last = record.time[k];
            model.displacement(&mut state, record.input_before(k, lag), period)
        })
        .collect()
}

/// The voltage that a model would give for a path of wanted displacements, from this state on.
pub fn invert(
    model: &Model,
    state: &State,
    time: &[f64],
    path: &[f64],
    limits: &Range,
) -> Vec<f64> {
    let mut state = *state;
    let lag = model.lag();
    let mut last = None;
    (0..path.len())
        .map(|k| {
            let period = last.map_or_else(
                || time.get(1).map_or(1.0, |next| next - time[0]),
                |last| time[k] - last,
            );
            last = Some(time[k]);
            // The answer comes late, so the question is asked early.
            let wanted = interpolated(time, path, k, -lag);
            model.voltage(&mut state, wanted, period, limits)
        })
        .collect()
}

/// Errors of a model over a part of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Root mean square, in the record's unit.
    pub rms: f64,
    /// Largest.
    pub largest: f64,
    /// Mean error that was taken off first, for a sensor's zero is arbitrary.
    pub offset: f64,
}

/// Whether the zero of a measured displacement is that of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zero {
    /// It is.
    Known,
    /// It is not, and the mean error is taken off first: so where another sensor, or the same on
    /// another day, has measured.
    Arbitrary,
}

/// How far `prediction` is from what was `measured`, over some of the samples.
pub fn judge(
    prediction: &[f64],
    measured: &[f64],
    over: std::ops::Range<usize>,
    zero: Zero,
) -> Errors {
    let pairs = || prediction[over.clone()].iter().zip(&measured[over.clone()]);
    let n = over.len().max(1) as f64;
    let offset = match zero {
        Zero::Known => 0.0,
        Zero::Arbitrary => pairs().map(|(t, m)| t - m).sum::<f64>() / n,
    };
    let (squares, largest) = pairs().fold((0.0, 0.0_f64), |(s, l), (t, m)| {
        let e = t - m - offset;
        (s + e * e, l.max(e.abs()))
    });
    Errors {
        rms: (squares / n).sqrt(),
        largest,
        offset,
    }
}

/// The straight line through a record: what one would use who knows of no hysteresis. At every
/// sample, by least squares over some of them.
pub fn straight(record: &Record, over: std::ops::Range<usize>) -> Vec<f64> {
    let n = over.len().max(1) as f64;
    let mean = |column: &[f64]| column[over.clone()].iter().sum::<f64>() / n;
    let (u, x) = (mean(&record.input), mean(&record.output));
    let (mut uu, mut ux) = (0.0, 0.0);
    for (a, b) in record.input[over.clone()]
        .iter()
        .zip(&record.output[over.clone()])
    {
        uu += (a - u) * (a - u);
        ux += (a - u) * (b - x);
    }
    let slope = if uu > 0.0 { ux / uu } else { 0.0 };
    record.input.iter().map(|a| x + slope * (a - u)).collect()
}

#[cfg(test)]
mod tests;
