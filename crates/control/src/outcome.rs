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
        /// Level after it, volts above the background.
        after: f64,
    },
    /// It was attached, and there is less light than there was before: it is not where it was
    /// aligned.
    Slipped {
        /// Level before, volts above the background.
        before: f64,
        /// Level since, volts above the background.
        after: f64,
    },
    /// The light around the peak was not that of a peak: a micro may not go where it is told.
    Misshapen {
        /// By how much it differs, rms, as a share of the light.
        misfit: f64,
        /// By how much it may.
        accepted: f64,
    },
    /// The peak was not known as well as the recipe asks when its time was over.
    Unsure {
        /// Standard deviation of the peak's place, metres.
        deviation: f64,
        /// What was asked for, metres.
        accuracy: f64,
    },
    /// An axis did not come to where it was sent.
    NotArrived {
        /// The axis.
        axis: String,
        /// How far it stayed away, encoder counts.
        counts: i64,
    },
    /// The fiber would have had to go beyond the machine's reach.
    OutOfReach(String),
    /// An earlier fiber failed without which this one cannot be aligned, or the machine stopped.
    NotAttempted,
    /// The machine stopped while this fiber was being aligned.
    Stopped(Fault),
}

impl Outcome {
    /// Whether it is aligned and attached, by control's word.
    pub fn is_aligned(&self) -> bool {
        *self == Self::Aligned
    }

    /// The fault that stopped the machine, if that is how it ended.
    pub fn fault(&self) -> Option<&Fault> {
        match self {
            Self::Stopped(fault) => Some(fault),
            _ => None,
        }
    }

    /// The word for it in tables and files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Aligned => "aligned",
            Self::NoLight(_) => "no_light",
            Self::LightLost { .. } => "light_lost",
            Self::FalseLight { .. } => "false_light",
            Self::Slipped { .. } => "slipped",
            Self::Misshapen { .. } => "misshapen",
            Self::Unsure { .. } => "unsure",
            Self::NotArrived { .. } => "not_arrived",
            Self::OutOfReach(_) => "out_of_reach",
            Self::NotAttempted => "not_attempted",
            Self::Stopped(_) => "fault",
        }
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Aligned => write!(f, "aligned"),
            Self::NoLight(e) => {
                write!(
                    f,
                    "no light: the {} took {} samples over {:.0} um x {:.0} um; {:.4} V would have \
                     counted as light, the brightest was {:.4} V",
                    e.phase,
                    e.samples,
                    e.width * 1e6,
                    e.height * 1e6,
                    e.threshold,
                    e.brightest
                )?;
                match e.dismissed {
                    0 => Ok(()),
                    n => write!(f, "; {n} bright places did not bear a second look"),
                }
            }
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
            Self::Slipped { before, after } => write!(
                f,
                "slipped: {before:.4} V above the background became {after:.4} V as it was attached"
            ),
            Self::Misshapen { misfit, accepted } => write!(
                f,
                "misshapen: the light around the peak differs from that of a peak by {:.1} %, where \
                 {:.1} % is accepted",
                misfit * 1e2,
                accepted * 1e2
            ),
            Self::Unsure {
                deviation,
                accuracy,
            } => write!(
                f,
                "unsure: the peak's place is known to {:.1} nm, where {:.1} nm were asked for",
                deviation * 1e9,
                accuracy * 1e9
            ),
            Self::NotArrived { axis, counts } => {
                write!(
                    f,
                    "not arrived: {axis} stayed {counts} counts away from where it was sent"
                )
            }
            Self::OutOfReach(what) => write!(f, "out of reach: {what}"),
            Self::NotAttempted => write!(f, "not attempted after what came before it"),
            Self::Stopped(fault) => write!(f, "the machine stopped: {fault}"),
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
    /// Brightest sample that was not taken for light, or not for long, volts.
    pub brightest: f64,
    /// Places that seemed bright and did not bear a second look.
    pub dismissed: usize,
    /// What would have counted as light, volts.
    pub threshold: f64,
}

impl SearchEvidence {
    /// The evidence of this part of a search and of the parts before it, one above the other.
    #[must_use]
    pub fn following(self, before: Option<Self>) -> Self {
        let height = self.height + before.map_or(0.0, |before| before.height);
        Self {
            height,
            ..self.after(before)
        }
    }

    /// The evidence of this search and of the one before it over the same area.
    #[must_use]
    pub fn after(self, before: Option<Self>) -> Self {
        before.map_or(self, |before| Self {
            samples: before.samples + self.samples,
            dismissed: before.dismissed + self.dismissed,
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
