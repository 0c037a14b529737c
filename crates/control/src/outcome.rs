//! How an alignment ends: well, with an honest negative, or with a fault.

use crate::compensation::hysteresis::Invalid;
use crate::trajectory::Refused;
use pigtail_hal::{AxisName, Fault, Side, Unplayable};
use pigtail_model::fivebar::Unreachable;
use serde::{Serialize, Serializer};
use std::fmt;
use thiserror::Error;

/// The end of one fiber's alignment, with its evidence.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Outcome {
    /// Aligned and attached.
    #[error("aligned")]
    Aligned,
    /// The search covered its whole area and saw nothing that stood out.
    #[error("no light: {0}")]
    NoLight(SearchEvidence),
    /// Light was found, and was gone afterwards.
    #[error(
        "light lost during {phase}: {level:.4} V above the background, where {expected:.4} V was \
         expected"
    )]
    LightLost {
        /// The phase in which it was lost.
        phase: &'static str,
        /// Level last seen, volts above the background.
        level: f64,
        /// Level that was expected, volts above the background.
        expected: f64,
    },
    /// A circle's middle ran after a peak farther than one may have moved.
    #[error(
        "light lost during {phase}: the circle has gone {:.1} um after the peak, where {:.1} um are accepted",
        by * 1e6, accepted * 1e6
    )]
    RanAfter {
        /// The phase in which it did.
        phase: &'static str,
        /// How far, metres.
        by: f64,
        /// The farthest that is accepted, metres.
        accepted: f64,
    },
    /// What was found did not grow on approach as coupled light does.
    #[error("false light: {before:.4} V above the background became {after:.4} V on approach")]
    FalseLight {
        /// Level before the approach, volts above the background.
        before: f64,
        /// Level after it, volts above the background.
        after: f64,
    },
    /// It was attached, and there is less light than there was before: it is not where it was
    /// aligned.
    #[error("slipped: {before:.4} V above the background became {after:.4} V as it was attached")]
    Slipped {
        /// Level before, volts above the background.
        before: f64,
        /// Level since, volts above the background.
        after: f64,
    },
    /// The light around the peak was not that of a peak: a micro may not go where it is told.
    #[error(
        "misshapen: the light around the peak differs from that of a peak by {:.1} %, where {:.1} % \
         is accepted",
        misfit * 1e2, accepted * 1e2
    )]
    Misshapen {
        /// By how much it differs, rms, as a share of the light.
        misfit: f64,
        /// By how much it may.
        accepted: f64,
    },
    /// The peak was not known as well as the recipe asks when its time was over.
    #[error(
        "unsure: the peak's place is known to {:.1} nm, where {:.1} nm were asked for",
        deviation * 1e9, accuracy * 1e9
    )]
    Unsure {
        /// Standard deviation of the peak's place, metres.
        deviation: f64,
        /// What was asked for, metres.
        accuracy: f64,
    },
    /// The gap is not known well enough for a fiber to be attached.
    #[error(
        "unsure: by vision and encoders the gap is {:.2} um from the one that is wanted, with a bound of {:.2} um \
         and a deviation of {:.2} um; it is farther off than {:.2} um with a probability of {probability:.1e}, \
         accepted is {accepted:.0e}",
        off * 1e6, bound * 1e6, sigma * 1e6, tolerance * 1e6
    )]
    UnsureGap {
        /// How far it is believed to be off, metres.
        off: f64,
        /// Bound of vision's fixed error, metres.
        bound: f64,
        /// Deviation beside that, metres.
        sigma: f64,
        /// How far it may be off, metres.
        tolerance: f64,
        /// Probability that it is farther.
        probability: f64,
        /// The greatest that is accepted.
        accepted: f64,
    },
    /// The tip shakes, or its peak is known, so badly that it may be attached elsewhere.
    #[error(
        "unsure: the peak's place is known to {:.1} nm{} and the tip shakes by {:.1} nm, rms, and is up to {:.1} nm aside{}; \
         it is attached farther off than {:.0} nm with a probability of {probability:.1e}, accepted is {accepted:.0e}",
        deviation * 1e9, for_askew(*deviation, *askew), shaking * 1e9, bound * 1e9, why_aside(*bound, *rises), tolerance * 1e9
    )]
    UnsurePlace {
        /// Standard deviation of the peak's place, metres.
        deviation: f64,
        /// What of it is for stages that may stand askew, metres.
        askew: f64,
        /// How far beside that it may be attached, at most, metres: the peak drifts, or was seen from aside, or its light rises to one side.
        bound: f64,
        /// What of that is for light that rises to one side on stages that stand askew, metres.
        rises: f64,
        /// Standard deviation of the tip about where it is held, along an axis, metres.
        shaking: f64,
        /// How far it may be off, metres.
        tolerance: f64,
        /// Probability that it is farther, in x or y.
        probability: f64,
        /// The greatest that is accepted.
        accepted: f64,
    },
    /// A bench did not do what it was asked for.
    #[error("not done: {why}")]
    BenchFailed {
        /// Why not.
        why: String,
    },
    /// Nobody has taught where a port is, and what measures its light.
    #[error("not taught: a port's pose or its meter is missing in the bench's calibration")]
    NotTaught,
    /// An axis did not come to where it was sent.
    #[error("not arrived: {axis} stayed {counts} counts away from where it was sent")]
    NotArrived {
        /// The axis.
        axis: AxisName,
        /// How far it stayed away, encoder counts.
        counts: i64,
    },
    /// A path was refused, for it would have broken a limit.
    #[error("out of reach: the {} endpoint {why}", side.name())]
    Refused {
        /// Whose endpoint was to follow it.
        side: Side,
        /// The limit.
        why: Refused,
    },
    /// The peak is beyond what a micro reaches.
    #[error(
        "out of reach: the {} micro was to go to {:.1}, {:.1} um from its centre",
        side.name(), x * 1e6, y * 1e6
    )]
    MicroRange {
        /// Whose micro.
        side: Side,
        /// Where it was to go across, metres from its centre.
        x: f64,
        /// Where it was to go up, metres from its centre.
        y: f64,
    },
    /// The surroundings of the peak are beyond what the micro reaches.
    #[error("out of reach: the light around the peak: the micro does not reach {x}, {y} m")]
    ProfileRange {
        /// The corner beyond its reach, across, metres from its centre.
        x: f64,
        /// The same up.
        y: f64,
    },
    /// The five-bar cannot move to all sides where it stands.
    #[error("out of reach: the five-bar has no reach here")]
    Immobile(Unreachable),
    /// An amplifier cannot play a pulse.
    #[error("out of reach: {at} cannot play {why}")]
    Unplayable {
        /// Whose amplifier.
        at: AxisName,
        /// Why not.
        why: Unplayable,
    },
    /// The rig, or what is believed of it, lacks something that is needed.
    #[error("out of reach: {0}")]
    Lacking(Lack),
    /// Vision sees no fiber in a holder.
    #[error("out of reach: vision sees no fiber in the {} holder", side.name())]
    FiberUnseen {
        /// Whose holder.
        side: Side,
    },
    /// The peak walked otherwise than expected as the gap closed.
    #[error(
        "light lost: the peak strayed by {:.1} um on the approach, where {:.1} um are accepted (`fast.stray`)",
        by * 1e6, accepted * 1e6
    )]
    Strayed {
        /// How far, metres.
        by: f64,
        /// The farthest that is accepted, metres.
        accepted: f64,
    },
    /// Vision does not see a tip arrive where it was sent.
    #[error(
        "out of reach: vision does not see the {} tip arrive within {} um",
        side.name(), tolerance * 1e6
    )]
    TipAstray {
        /// Whose tip.
        side: Side,
        /// How near it was to come, metres.
        tolerance: f64,
    },
    /// There was nothing to search.
    #[error("out of reach: there was nothing to search")]
    NothingSearched,
    /// Light around a place is not that of a beam.
    #[error("out of reach: the light {place} is not that of a beam")]
    NoBeam {
        /// Where, such as `along a piezo`.
        place: &'static str,
    },
    /// No model of a piezo can be made of what was measured.
    #[error("out of reach: {}: {why}", record_of(*piezo))]
    NoModel {
        /// Which piezo of the micro, from zero; `None` where the record itself is no good.
        piezo: Option<usize>,
        /// Why not.
        why: Invalid,
    },
    /// A motor stands still under all the voltage that it may have.
    #[error("out of reach: {at} does not break away at {limit} V")]
    NoBreakAway {
        /// Whose motor.
        at: AxisName,
        /// The voltage, volts.
        limit: f64,
    },
    /// A gain of the law of pulses (4.12) with which the loop is not stable.
    #[error(
        "out of reach: a gain of {0} makes no stable loop (4.12); accepted is one above 0 and below \
         2"
    )]
    UnstableGain(f64),
    /// The fiber was at its peak too late for a trial.
    #[error(
        "out of reach: the fiber was at its peak only after {time:.1} s, too late for a trial from \
         {begin:.1} s on"
    )]
    TooLate {
        /// When it was there, seconds of machine time.
        time: f64,
        /// When the trial was to begin, seconds of machine time.
        begin: f64,
    },
    /// An earlier fiber failed without which this one cannot be aligned, or the machine stopped.
    #[error("not attempted after what came before it")]
    NotAttempted,
    /// The machine stopped while this fiber was being aligned.
    #[error("the machine stopped: {0}")]
    Stopped(Fault),
}

fn record_of(piezo: Option<usize>) -> String {
    piezo.map_or_else(
        || "the record of a piezo".to_owned(),
        |piezo| format!("piezo {}", piezo + 1),
    )
}

/// Whether a deviation is mostly for stages askew: no light makes that less.
pub(crate) fn is_for_askew(deviation: f64, askew: f64) -> bool {
    askew * askew >= 0.5 * deviation * deviation
}

/// What is said of that.
fn for_askew(deviation: f64, askew: f64) -> String {
    if !is_for_askew(deviation, askew) {
        return String::new();
    }
    format!(
        ", of which {:.1} nm are for how askew its stage may stand (`commission` measures that),",
        askew * 1e9
    )
}

/// Where most of a bound comes from, metres.
fn why_aside(bound: f64, rises: f64) -> &'static str {
    if 2.0 * rises > bound {
        " (its light rises to one side: stages stand askew)"
    } else {
        ""
    }
}

impl Outcome {
    /// That light of so much `before` an approach is at least so much `after` it: what does not grow as it should does not come out of the guide.
    /// All in volts above the background.
    pub(crate) fn of_growth(before: f64, after: f64, least: f64) -> Result<(), Self> {
        if after < least {
            return Err(Self::FalseLight { before, after });
        }
        Ok(())
    }

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

    /// Its kind, without the evidence.
    pub fn code(&self) -> OutcomeCode {
        match self {
            Self::Aligned => OutcomeCode::Aligned,
            Self::NoLight(_) => OutcomeCode::NoLight,
            Self::LightLost { .. } | Self::RanAfter { .. } | Self::Strayed { .. } => {
                OutcomeCode::LightLost
            }
            Self::FalseLight { .. } => OutcomeCode::FalseLight,
            Self::Slipped { .. } => OutcomeCode::Slipped,
            Self::Misshapen { .. } => OutcomeCode::Misshapen,
            Self::Unsure { .. } | Self::UnsureGap { .. } | Self::UnsurePlace { .. } => {
                OutcomeCode::Unsure
            }
            Self::NotArrived { .. } | Self::BenchFailed { .. } => OutcomeCode::NotArrived,
            Self::NotTaught
            | Self::Refused { .. }
            | Self::MicroRange { .. }
            | Self::ProfileRange { .. }
            | Self::Immobile(_)
            | Self::Unplayable { .. }
            | Self::Lacking(_)
            | Self::FiberUnseen { .. }
            | Self::TipAstray { .. }
            | Self::NothingSearched
            | Self::NoBeam { .. }
            | Self::NoModel { .. }
            | Self::NoBreakAway { .. }
            | Self::UnstableGain(_)
            | Self::TooLate { .. } => OutcomeCode::OutOfReach,
            Self::NotAttempted => OutcomeCode::NotAttempted,
            Self::Stopped(_) => OutcomeCode::Fault,
        }
    }

    /// The word for it in tables and files.
    pub fn name(&self) -> &'static str {
        self.code().name()
    }
}

/// What a rig, or what is believed of it, does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Lack {
    /// A probe at the output of an axis.
    #[error("{0} has no probe at its output on this rig")]
    Probe(AxisName),
    /// Probes at the outputs.
    #[error("the rig has no probes at its outputs")]
    Probes,
    /// What impulse control sees an axis move by.
    #[error("{0} has no sensor at its output on this rig, which impulse control needs")]
    Sensor(AxisName),
    /// What pulses do to a five-bar.
    #[error(
        "the calibration does not say what pulses do to a five-bar, which `pigtail characterize \
         fivebar impulse` measures"
    )]
    Pulses,
    /// Where along a five-bar's links the effect of pulses was measured.
    #[error(
        "neither calibration (`impulse.five_bar.arm`) nor datasheet (`probe.arm`) says where pulses \
         were measured"
    )]
    PulseArm,
}

/// How a fiber ended, without the evidence: what tables count and files hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum OutcomeCode {
    /// Aligned and attached.
    Aligned,
    /// No light was found.
    NoLight,
    /// Light was found, and was gone afterwards.
    LightLost,
    /// What was found is not coupled light.
    FalseLight,
    /// It moved when it was attached.
    Slipped,
    /// The light around the peak is not that of a peak.
    Misshapen,
    /// The peak is not known well enough.
    Unsure,
    /// An axis did not come to where it was sent.
    NotArrived,
    /// It would have taken what the rig does not reach, or does not have.
    OutOfReach,
    /// It was not begun.
    NotAttempted,
    /// The machine stopped.
    Fault,
    /// The program itself failed.
    Panic,
}

impl OutcomeCode {
    /// All there are.
    pub const ALL: [Self; 12] = [
        Self::Aligned,
        Self::NoLight,
        Self::LightLost,
        Self::FalseLight,
        Self::Slipped,
        Self::Misshapen,
        Self::Unsure,
        Self::NotArrived,
        Self::OutOfReach,
        Self::NotAttempted,
        Self::Fault,
        Self::Panic,
    ];

    /// The word for it in tables and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Aligned => "aligned",
            Self::NoLight => "no_light",
            Self::LightLost => "light_lost",
            Self::FalseLight => "false_light",
            Self::Slipped => "slipped",
            Self::Misshapen => "misshapen",
            Self::Unsure => "unsure",
            Self::NotArrived => "not_arrived",
            Self::OutOfReach => "out_of_reach",
            Self::NotAttempted => "not_attempted",
            Self::Fault => "fault",
            Self::Panic => "panic",
        }
    }

    /// The code of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|code| code.name() == name)
    }
}

impl fmt::Display for OutcomeCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl Serialize for OutcomeCode {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
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
    /// What was brightest, as it is judged, and was not taken for light, or not for long, volts.
    pub brightest: f64,
    /// Places that seemed bright and did not bear a second look.
    pub dismissed: usize,
    /// What would have counted as light, volts.
    pub threshold: f64,
}

impl fmt::Display for SearchEvidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the {} took {} samples over {:.0} um x {:.0} um; {:.4} V would have counted as light, \
             the brightest was {:.4} V",
            self.phase,
            self.samples,
            self.width * 1e6,
            self.height * 1e6,
            self.threshold,
            self.brightest
        )?;
        match self.dismissed {
            0 => Ok(()),
            n => write!(f, "; {n} bright places did not bear a second look"),
        }
    }
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
        before.map_or(self, |before| {
            // What came nearest to light, beside what would have been light then: backgrounds differ.
            let above = |seen: &Self| seen.brightest - seen.threshold;
            let nearest = if above(&before) > above(&self) {
                before
            } else {
                self
            };
            Self {
                samples: before.samples + self.samples,
                dismissed: before.dismissed + self.dismissed,
                width: before.width.max(self.width),
                height: before.height.max(self.height),
                brightest: nearest.brightest,
                threshold: nearest.threshold,
                ..self
            }
        })
    }
}

/// Why a procedure or an experiment ends early.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Halt {
    /// The machine has stopped.
    #[error("{0}")]
    Fault(Fault),
    /// What was asked for cannot be done; the machine is well.
    #[error("{0}")]
    Outcome(Outcome),
}

impl Halt {
    /// What a search saw that found no light, for who goes on to search elsewhere.
    ///
    /// # Errors
    ///
    /// Itself, where it is anything else.
    pub fn no_light(self) -> Result<SearchEvidence, Self> {
        match self {
            Self::Outcome(Outcome::NoLight(evidence)) => Ok(evidence),
            other => Err(other),
        }
    }
}

impl From<Halt> for Outcome {
    fn from(halt: Halt) -> Self {
        match halt {
            Halt::Fault(fault) => Self::Stopped(fault),
            Halt::Outcome(outcome) => outcome,
        }
    }
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

#[cfg(test)]
mod tests {
    use super::{Outcome, OutcomeCode, SearchEvidence};
    use pigtail_hal::Side;

    #[test]
    fn searches_put_together_tell_what_came_nearest_to_light_beside_what_would_have_been() {
        let pass = |threshold, brightest| SearchEvidence {
            phase: "raster",
            samples: 10,
            width: 1e-6,
            height: 1e-6,
            brightest,
            dismissed: 0,
            threshold,
        };
        // In a background that was brighter at first.
        let both = pass(0.15, 0.14).after(Some(pass(0.25, 0.19)));
        assert_eq!((both.threshold, both.brightest), (0.15, 0.14));
        assert_eq!(both.samples, 20);
    }

    #[test]
    fn a_code_is_found_by_its_name() {
        for code in OutcomeCode::ALL {
            assert_eq!(OutcomeCode::from_name(code.name()), Some(code));
        }
        assert_eq!(OutcomeCode::from_name("believed aligned"), None);
    }

    #[test]
    fn what_is_beyond_the_rig_says_what_it_is() {
        let outcome = Outcome::MicroRange {
            side: Side::Left,
            x: 21e-6,
            y: -3.04e-6,
        };
        assert_eq!(
            outcome.to_string(),
            "out of reach: the left micro was to go to 21.0, -3.0 um from its centre"
        );
        assert_eq!(outcome.name(), "out_of_reach");
    }
}
