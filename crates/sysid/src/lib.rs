//! Afterwards: models of an axis and of light from what somebody has measured. No machine is in reach.
//!
//! In go columns of numbers in SI units (what reads them from files is the room `records`), out come
//! parameters, each with how sure it is; where a record cannot tell, it says so instead of giving a number
//! that looks like one.
//!
//! - [`timeline`]: an even grid, gaps, jitter, missing samples;
//! - [`outliers`]: samples that no motion makes;
//! - [`servo`]: inertia and friction by the inverse dynamic model, and the closed loop replayed;
//! - [`friction`]: laws of friction against displacement;
//! - [`windup`]: a transmission from encoders on both of its sides;
//! - [`resonance`]: modes from a frequency response;
//! - [`map`]: search and peak on a power map that was measured elsewhere.
//!
//! Start with [`servo`], or with [`map`]:
//!
//! ```
//! use pigtail_model::frames::Displacement;
//! use pigtail_sysid::map::{Reading, Scan, examine};
//!
//! // A spot of 4 um at (3, -2) um on a grid of 1 um.
//! let peak = Displacement::new(3e-6, -2e-6);
//! let spot = |at: Displacement| (-(at - peak).norm().powi(2) / 8e-12).exp();
//! let grid = (-12..=12).flat_map(|i| (-12..=12).map(move |j| (f64::from(i), f64::from(j))));
//! let places = grid.map(|(x, y)| Displacement::new(x, y) * 1e-6);
//! let readings = places.map(|at| Reading { at, power: spot(at) }).collect();
//! let scan = Scan::new(readings).expect("readings over an area");
//! assert!(examine(&scan).is_ok());
//! ```

pub mod friction;
pub mod map;
pub mod outliers;
pub mod resonance;
pub mod servo;
mod steady;
pub mod timeline;
pub mod windup;

/// A parameter that was looked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: &'static str,
    /// Value and standard deviation; `None` where the record does not tell it.
    pub known: Option<Known>,
}

/// A value and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// The value.
    pub value: f64,
    /// Its standard deviation if what the model leaves is white.
    pub std: f64,
    /// The same with the correlation of what is left taken into account: what one may expect from one
    /// record to the next.
    pub std_correlated: f64,
}

/// Parameters that a record does not tell, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unknown {
    /// Their names; empty where it is all of them.
    pub parameters: Vec<&'static str>,
    /// Why: follows "not identifiable from this record, because".
    pub because: String,
}

impl Unknown {
    /// Nothing can be known, because...
    pub fn all(because: impl Into<String>) -> Self {
        Self {
            parameters: Vec::new(),
            because: because.into(),
        }
    }

    /// Whether it says so of a parameter.
    pub fn covers(&self, name: &str) -> bool {
        self.parameters.is_empty() || self.parameters.contains(&name)
    }
}

/// What was measured beside what a model tells, sample by sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Account {
    /// Seconds.
    pub time: Vec<f64>,
    /// What was measured.
    pub measured: Vec<f64>,
    /// What the model tells.
    pub modelled: Vec<f64>,
    /// Where the axis was.
    pub position: Vec<f64>,
    /// How fast it moved.
    pub velocity: Vec<f64>,
}

impl Account {
    /// Measured less modelled.
    pub fn residuals(&self) -> Vec<f64> {
        let pairs = self.measured.iter().zip(&self.modelled);
        pairs.map(|(a, b)| a - b).collect()
    }

    /// Norm of what is left over the norm of what was measured, per cent.
    pub fn relative_error_percent(&self) -> f64 {
        pigtail_numerics::regression::relative(&self.residuals(), &self.measured)
    }
}
