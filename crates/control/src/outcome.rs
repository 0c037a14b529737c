//! How an alignment ends: well, with an honest negative, or with a fault.

use pigtail_hal::Fault;

/// The end of one fiber's alignment, with its evidence.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// Aligned and attached.
    Aligned,
    /// The search covered its whole area and saw nothing that stood out.
    NoLight(SearchEvidence),
    /// Light was found, and was gone afterwards.
    LightLost {
        /// The phase in which it was lost.
        phase: &'static str,
        /// Level last seen, volts above the background.
        level: f64,
        /// Level that was expected, volts above the background.
        expected: f64,
    },
    /// What was found did not grow on approach as coupled light does.
    FalseLight {
        /// Level before the approach, volts above the background.
        before: f64,
        /// Level after it.
        after: f64,
    },
    /// The fiber would have had to go beyond the machine's reach.
    OutOfReach(String),
    /// An earlier fiber failed, without which this one cannot be aligned.
    NotAttempted,
}

impl Outcome {
    /// The word for it in tables and files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Aligned => "aligned",
            Self::NoLight(_) => "no_light",
            Self::LightLost { .. } => "light_lost",
            Self::FalseLight { .. } => "false_light",
            Self::OutOfReach(_) => "out_of_reach",
            Self::NotAttempted => "not_attempted",
        }
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Aligned => write!(f, "aligned"),
            Self::NoLight(e) => write!(
                f,
                "no light: the {} saw at most {:.4} V in {} samples over {:.0} um x {:.0} um, and \
                 would have taken {:.4} V for light",
                e.phase,
                e.brightest,
                e.samples,
                e.width * 1e6,
                e.height * 1e6,
                e.threshold
            ),
            Self::LightLost {
                phase,
                level,
                expected,
            } => write!(
                f,
                "light lost during {phase}: {level:.4} V above the background, where {expected:.4} \
                 V was expected"
            ),
            Self::FalseLight { before, after } => write!(
                f,
                "false light: {before:.4} V above the background became {after:.4} V on approach"
            ),
            Self::OutOfReach(what) => write!(f, "out of reach: {what}"),
            Self::NotAttempted => write!(f, "not attempted, since the input was not aligned"),
        }
    }
}

/// What a search that found nothing did see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchEvidence {
    /// The phase that searched.
    pub phase: &'static str,
    /// Light samples taken.
    pub samples: usize,
    /// Width of the area, metres.
    pub width: f64,
    /// Height of the area, metres.
    pub height: f64,
    /// Brightest sample, volts.
    pub brightest: f64,
    /// What would have counted as light, volts.
    pub threshold: f64,
}

impl SearchEvidence {
    /// The evidence of this search and of the one before it over the same area.
    #[must_use]
    pub fn after(self, before: Option<Self>) -> Self {
        before.map_or(self, |before| Self {
            samples: before.samples + self.samples,
            width: before.width.max(self.width),
            height: before.height.max(self.height),
            brightest: before.brightest.max(self.brightest),
            ..self
        })
    }
}

/// Why a procedure ends early.
#[derive(Debug, Clone, PartialEq)]
pub enum Halt {
    /// The machine has stopped.
    Fault(Fault),
    /// The fiber cannot be aligned; the machine is well.
    Outcome(Outcome),
}

impl From<Fault> for Halt {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<Outcome> for Halt {
    fn from(outcome: Outcome) -> Self {
        Self::Outcome(outcome)
    }
}
