//! What a claim that holds is worth: whether anything was fitted to it.

use serde::Serialize;

/// What a claim rests on. Where it is in doubt whether something was fitted to a claim that holds, it counts as
/// calibrated: [`Basis::Doubtful`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// Nothing was fitted to it: it could have come out otherwise.
    Prediction,
    /// Numbers of plant, control or experiment were set so that it comes out: these.
    Calibrated(&'static str),
    /// These numbers were set by people who knew what it should be, or what comes out of it. Nothing says that
    /// it was for this.
    Doubtful(&'static str),
    /// It follows from how the twin or the quantity is made, and fails only where the program is wrong: why.
    Definition(&'static str),
}

impl Basis {
    /// Its name in documents, by which claims are counted.
    pub const fn group(self) -> Group {
        match self {
            Self::Prediction => Group::Prediction,
            Self::Calibrated(_) | Self::Doubtful(_) => Group::Calibrated,
            Self::Definition(_) => Group::Definition,
        }
    }

    /// The numbers that were set for it.
    pub const fn fitted(self) -> Option<&'static str> {
        match self {
            Self::Calibrated(fitted) | Self::Doubtful(fitted) => Some(fitted),
            Self::Prediction | Self::Definition(_) => None,
        }
    }

    /// Why it cannot fail.
    pub const fn by_construction(self) -> Option<&'static str> {
        match self {
            Self::Definition(why) => Some(why),
            _ => None,
        }
    }
}

/// What claims are counted by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// Nothing was fitted to it.
    Prediction,
    /// A number was set so that it comes out, or may have been.
    Calibrated,
    /// It cannot fail by construction.
    Definition,
}

impl Group {
    /// All of them, what weighs most first.
    pub const ALL: [Self; 3] = [Self::Prediction, Self::Calibrated, Self::Definition];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Prediction => "prediction",
            Self::Calibrated => "calibrated",
            Self::Definition => "definition",
        }
    }

    /// The same for many, with what it means.
    pub fn meaning(self) -> (&'static str, &'static str) {
        match self {
            Self::Prediction => ("predictions", "nothing was fitted to them"),
            Self::Calibrated => (
                "calibrated claims",
                "a number was set for them, or may have been",
            ),
            Self::Definition => ("definitions", "they cannot fail by construction"),
        }
    }
}

/// On what a claim is judged, which decides whether another specimen can give another result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// The machine that the thesis measured: specimens of it can be drawn.
    Machine,
    /// The thesis's model, as the thesis simulated it: a simulation knows its parameters.
    Model,
    /// Numbers that are no part of a machine: those of a recipe, a datasheet, a belief.
    Numbers,
}

impl Subject {
    /// Why it is not judged on drawn specimens; `None` where it is.
    pub const fn not_drawn(self) -> Option<&'static str> {
        match self {
            Self::Machine => None,
            Self::Model => Some("simulated with the model, whose parameters are known"),
            Self::Numbers => Some("computed from numbers that are no part of a machine"),
        }
    }
}
