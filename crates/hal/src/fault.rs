//! How a machine says that it has stopped.

use serde::ser::{Serialize, SerializeStruct, Serializer};
use std::fmt;
use thiserror::Error;

/// The machine stopped by itself, and is safe.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{rule} on {axis} at {time:.4} s: {value}, where {limit} is accepted")]
pub struct Fault {
    /// The rule that was broken.
    pub rule: Rule,
    /// The axis or instrument, such as `left.z`.
    pub axis: String,
    /// The offending value with its unit.
    pub value: String,
    /// What would have been accepted, with its unit.
    pub limit: String,
    /// Machine time, seconds since power-on.
    pub time: f64,
}

impl Serialize for Fault {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fault = serializer.serialize_struct("Fault", 6)?;
        fault.serialize_field("code", self.rule.code())?;
        fault.serialize_field("rule", self.rule.text())?;
        fault.serialize_field("axis", &self.axis)?;
        fault.serialize_field("value", &self.value)?;
        fault.serialize_field("limit", &self.limit)?;
        fault.serialize_field("time", &self.time)?;
        fault.end()
    }
}

/// Lists the rules once, each with its code and its text.
macro_rules! rules {
    ($($(#[$doc:meta])+ $rule:ident => $code:literal, $text:literal;)+) => {
        /// What a machine holds to: whoever breaks it stops the machine.
        ///
        /// A rule has a code, which programs may rely on, and a text, which people read.
        #[derive(Debug, Clone, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum Rule {
            $($(#[$doc])+ $rule,)+
            /// A rule that a record names and this program does not know, by its text.
            Other(String),
        }

        impl Rule {
            /// Every rule that this program knows.
            pub const ALL: &[Self] = &[$(Self::$rule),+];

            /// The word for it in programs, the same in every version.
            pub const fn code(&self) -> &'static str {
                match self {
                    $(Self::$rule => $code,)+
                    Self::Other(_) => "other",
                }
            }

            /// What it says, such as `command is a number`.
            pub const fn text(&self) -> &str {
                match self {
                    $(Self::$rule => $text,)+
                    Self::Other(text) => text.as_str(),
                }
            }

            /// The rule with this text.
            pub fn from_text(text: &str) -> Self {
                match text {
                    $($text => Self::$rule,)+
                    other => Self::Other(other.to_owned()),
                }
            }
        }
    };
}

rules! {
    /// A command holds numbers only, neither NaN nor infinity.
    CommandNumber => "command-number", "command is a number";
    /// A voltage is within what the datasheet says of its motor or piezo.
    VoltageLimit => "voltage-limit", "voltage within the limit";
    /// A pulse is for an amplifier that plays pulses.
    PulseSupport => "pulse-support", "amplifier plays pulses";
    /// A pulse is no faster than its amplifier.
    PulseBandwidth => "pulse-bandwidth", "pulse is within the amplifier's bandwidth";
    /// A pulse is no higher than its amplifier's voltage.
    PulseVoltage => "pulse-voltage", "pulse is within the amplifier's voltage";
    /// A piezo is not driven to and fro as an unstable loop drives it.
    PiezoRunaway => "piezo-runaway", "piezo does not run away";
    /// The stop button is not pressed.
    StopRequest => "stop-request", "nobody asks to stop";
    /// Cycles come at the servo's rate.
    ServoTiming => "servo-timing", "servo keeps its time";
    /// Photodiodes and vision speak often enough.
    SensorSilence => "sensor-silence", "sensors are heard of";
    /// Frames of vision differ by their noise.
    VisionFrozen => "vision-frozen", "vision is alive";
    /// A photodiode is not at the end of its range.
    PhotodiodeRange => "photodiode-range", "photodiode within its range";
    /// An encoder does not count faster than its motor can turn.
    EncoderSpeed => "encoder-speed", "encoder counts no faster than the motor turns";
    /// A motor with enough voltage to move does move.
    MotorStall => "motor-stall", "motor turns under voltage";
    /// The probe at an axis's output is where the motor's encoder has it.
    OutputFollowing => "output-following", "output follows its motor";
    /// An encoder is near the servo's reference.
    ServoFollowing => "servo-following", "axis follows its servo";
    /// An endpoint is within its workspace.
    Workspace => "workspace", "endpoint within its workspace";
    /// An endpoint is no faster than the datasheet says.
    EndpointSpeed => "endpoint-speed", "endpoint within its speed";
    /// The two holders keep away from each other.
    HolderDistance => "holder-distance", "holders stay apart";
    /// Vision sees a tip where the encoders have it.
    VisionAgreement => "vision-agreement", "vision agrees with the encoders";
    /// Tips and holders keep away from the chip.
    ChipDistance => "chip-distance", "distance from the chip";
    /// Light does not go out while nothing moves.
    LightLoss => "light-loss", "light does not go out by itself";
    /// A five-bar's links reach its endpoint.
    FiveBarAssembly => "five-bar-assembly", "five-bar stays assembled";
    /// A fiber is taken into an empty holder.
    HolderEmpty => "holder-empty", "holder is empty";
    /// A fiber that is to be taken is in the tray.
    TrayFiber => "tray-fiber", "fiber is in the tray";
    /// A fiber that is to be attached is in the holder.
    HolderFiber => "holder-fiber", "holder carries a fiber";
    /// The record of a run can be written.
    RecordWritable => "record-writable", "record can be written";
    /// A replay is asked what was asked when it was recorded.
    ReplayDiffers => "replay-differs", "commands are as recorded";
    /// A replay is asked no more than what was recorded.
    ReplayEnds => "replay-ends", "the record goes on";
    /// What a bench says has happened comes in order, in time, and was asked for.
    EventOrder => "event-order", "events come in order and in time";
    /// Work ends within the time that it was given.
    Deadline => "deadline", "work ends in time";
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text())
    }
}

#[cfg(test)]
mod tests {
    use super::Rule;
    use std::collections::BTreeSet;

    #[test]
    fn rules_are_told_apart_by_code_and_by_text() {
        let kebab = |c: char| c.is_ascii_lowercase() || c == '-';
        let codes: BTreeSet<_> = Rule::ALL.iter().map(Rule::code).collect();
        let texts: BTreeSet<_> = Rule::ALL.iter().map(Rule::text).collect();
        assert_eq!(
            (codes.len(), texts.len()),
            (Rule::ALL.len(), Rule::ALL.len())
        );
        assert!(codes.iter().all(|code| code.chars().all(kebab)));
        for rule in Rule::ALL {
            assert_eq!(&Rule::from_text(rule.text()), rule);
        }
        let other = Rule::from_text("a rule");
        assert_eq!((other.code(), other.text()), ("other", "a rule"));
    }
}
