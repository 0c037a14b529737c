//! Production recipes: phases with parameters, tolerances, time limits, and what to do when one fails.

use pigtail_control::fast;
use pigtail_control::outcome::OutcomeCode;
use pigtail_hal::{Error, config, quantity};
use pigtail_model::cure::{Cure as Kinetics, Cured, Heat};
use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The content of a production recipe.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Production {
    /// The recipe's name.
    pub name: String,
    /// The recipe of the device and of its alignment, by name or file.
    pub device: String,
    /// The device's ports, in the order in which their fibers are attached.
    pub ports: Vec<String>,
    /// What becomes of a device that was half done when the work was interrupted.
    pub interrupted: Action,
    /// Gripping a fiber.
    pub pick: Pick,
    /// Adhesive on its tip.
    pub adhesive: Adhesive,
    /// Vision, coarse placement, search and peak.
    pub align: Align,
    /// Holding it under the lamp.
    pub cure: Cure,
    /// Letting it go, and whether its light is still there.
    pub verify: Verify,
}

/// What to do when a phase has failed as often as it may be tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// The device goes on without this fiber, and counts as rejected.
    NextFiber,
    /// The device is rejected, and the next one comes.
    RejectDevice,
    /// The machine stops and calls a person.
    Call,
}

/// What to do when an alignment has ended in some way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Reaction {
    /// It is tried again, as often as it may be; then what `failed` says.
    Retry,
    /// At once: the device goes on without this fiber, and counts as rejected.
    NextFiber,
    /// At once: the device is rejected, and the next one comes.
    RejectDevice,
    /// At once: the machine stops and calls a person.
    Call,
}

impl Reaction {
    /// What is done at once, if it is not tried again.
    pub fn at_once(self) -> Option<Action> {
        match self {
            Self::Retry => None,
            Self::NextFiber => Some(Action::NextFiber),
            Self::RejectDevice => Some(Action::RejectDevice),
            Self::Call => Some(Action::Call),
        }
    }
}

/// How an alignment may end that has not come to its peak.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    JsonSchema,
    strum::IntoStaticStr,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Ending {
    /// No light was found.
    NoLight,
    /// Light was found, and was gone afterwards.
    LightLost,
    /// What was found is not coupled light.
    FalseLight,
    /// The light around the peak is not that of a peak.
    Misshapen,
    /// The peak, or the gap, is not known well enough.
    Unsure,
    /// An axis did not come to where it was sent.
    NotArrived,
    /// It would have taken what the machine does not reach, or does not have.
    OutOfReach,
}

impl Ending {
    /// Of an outcome; nothing of those that are no such end.
    pub fn of(outcome: OutcomeCode) -> Option<Self> {
        Some(match outcome {
            OutcomeCode::NoLight => Self::NoLight,
            OutcomeCode::LightLost => Self::LightLost,
            OutcomeCode::FalseLight => Self::FalseLight,
            OutcomeCode::Misshapen => Self::Misshapen,
            OutcomeCode::Unsure => Self::Unsure,
            OutcomeCode::NotArrived => Self::NotArrived,
            OutcomeCode::OutOfReach => Self::OutOfReach,
            OutcomeCode::Aligned
            | OutcomeCode::Slipped
            | OutcomeCode::NotAttempted
            | OutcomeCode::Fault
            | OutcomeCode::Panic => return None,
        })
    }
}

/// Gripping a fiber.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pick {
    /// How often it is tried, at most.
    #[serde(deserialize_with = "attempts")]
    pub attempts: u32,
    /// Longest that it may take, seconds: it is not tried again when it has taken longer.
    #[serde(with = "quantity::PositiveTime")]
    pub limit: f64,
    /// What to do when it fails.
    pub failed: Action,
}

/// Adhesive on a tip.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Adhesive {
    /// How much, nanolitres, 1 to 255.
    #[serde(deserialize_with = "nanolitres")]
    pub volume: u8,
    /// How long the tip stays at the needle afterwards, seconds.
    #[serde(with = "quantity::NonNegativeTime")]
    pub dwell: f64,
    /// Longest from the needle to the lamp, seconds: then it is no longer what it was.
    #[serde(with = "quantity::PositiveTime")]
    pub open: f64,
    /// How often a fiber may get adhesive, at most. One whose adhesive was in the air for too long when it came to its peak goes back,
    /// gets fresh adhesive, and is aligned again.
    #[serde(default = "once")]
    #[serde(deserialize_with = "attempts")]
    pub attempts: u32,
    /// What to do when it fails.
    pub failed: Action,
}

fn once() -> u32 {
    1
}

/// The ways to align.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Procedure {
    /// The thesis's procedure.
    Thesis,
    /// The fast procedure.
    Fast,
}

impl Procedure {
    /// The same for control.
    pub fn way(self) -> fast::Way {
        match self {
            Self::Thesis => fast::Way::Thesis,
            Self::Fast => fast::Way::Fast,
        }
    }
}

/// Vision, coarse placement, search and peak.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Align {
    /// How.
    pub procedure: Procedure,
    /// How often it is tried, at most, each time from the tray on.
    #[serde(deserialize_with = "attempts")]
    pub attempts: u32,
    /// What it takes for the plan, the input and an output, seconds: as measured on such machines.
    #[serde(with = "quantity::Times::<2>")]
    pub expected: [f64; 2],
    /// Longest that it may take, seconds, all attempts together: it is not tried again when it has taken longer.
    #[serde(with = "quantity::PositiveTime")]
    pub limit: f64,
    /// What to do when it fails.
    pub failed: Action,
    /// What to do when it ends in a certain way; `retry` where that is left out.
    #[serde(default)]
    pub on: BTreeMap<Ending, Reaction>,
}

/// Holding a fiber under the lamp.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Cure {
    /// How long the lamp is on, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub time: f64,
    /// When the adhesive gels, seconds from when the lamp is on.
    #[serde(with = "quantity::PositiveTime")]
    pub gel: f64,
    /// How much earlier the fiber comes to rest, as a share of that: lamps and adhesives differ.
    #[serde(with = "quantity::Fraction")]
    pub margin: f64,
    /// Share of the shift that comes after the gel point, as the adhesive's maker says.
    #[serde(with = "quantity::Fraction")]
    pub after_gel: f64,
    /// Share of the shift after the gel point that comes when the holder lets go; a tenth where that is left out.
    #[serde(with = "quantity::Fraction", default = "tenth")]
    pub released: f64,
    /// How far a fiber goes another way than that when the holder lets go, along an axis, standard deviation, metres: how much that share differs,
    /// half of what a tenth of a micrometre's shift is, and what goes with the lamp's warmth, 3 K at 5 to 10 nm/K; 0.04 um where that is left out.
    #[serde(with = "quantity::NonNegativeLength", default = "forty_nanometres")]
    pub let_go: f64,
    /// How far the holder goes aside once the adhesive has cured, metres, so that it bends the fiber a little and the light tells where
    /// that is from its peak; 5 um where that is left out, and zero for not at all.
    #[serde(with = "quantity::NonNegativeLength", default = "five_micrometres")]
    pub bend: f64,
    /// How much the shift after the gel point differs from one fiber to the next, standard deviation, metres.
    #[serde(with = "quantity::PositiveLength")]
    pub scatter: f64,
    /// Whether the micro follows the light's peak until the gel point.
    pub track: bool,
    /// Whether it then goes beyond the peak by what the adhesive is expected to pull it back.
    pub precompensate: bool,
    /// Whether the input and the first output are held under the lamp together: one cure less a device. The light then tells
    /// only what both have lost, and both pass by that.
    #[serde(default)]
    pub together: bool,
}

/// Letting a fiber go, and whether its light is still there.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Verify {
    /// For how long its light is looked at, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub look: f64,
    /// Most loss that cure and release may add, decibels.
    #[serde(with = "quantity::Positive")]
    pub added_loss_db: f64,
    /// What to do with one that lost more.
    pub failed: Action,
}

fn tenth() -> f64 {
    0.1
}

fn forty_nanometres() -> f64 {
    40e-9
}

fn five_micrometres() -> f64 {
    5e-6
}

fn nanolitres<'de, D: Deserializer<'de>>(number: D) -> Result<u8, D::Error> {
    whole(number, "a whole number from 1 to 255")
}

fn attempts<'de, D: Deserializer<'de>>(number: D) -> Result<u32, D::Error> {
    whole(number, "a whole number from 1 to 100")
}

fn whole<'de, D: Deserializer<'de>, N: TryFrom<i64>>(
    number: D,
    accepted: &str,
) -> Result<N, D::Error> {
    let number = i64::deserialize(number)?;
    N::try_from(number)
        .map_err(|_| D::Error::custom(format!("is {number}; accepted is {accepted}")))
}

/// More than these are slips of the keyboard: times of UV adhesive and of a tip that stands still, seconds; attempts; how much earlier than
/// the gel point a fiber comes to rest; a share that comes when it is let go; how far a holder bends a fiber; and a scatter at which nothing is precompensated, metres.
const LONGEST_CURE: f64 = 600.0;
const LONGEST_STAND: f64 = 60.0;
const MOST_ATTEMPTS: u32 = 100;
const MOST_MARGIN: f64 = 0.5;
const MOST_RELEASED: f64 = 0.5;
const MOST_BEND: f64 = 20e-6;
const MOST_SCATTER: f64 = 10e-6;

impl Production {
    /// Reads a production recipe, `text` of `file`, and checks it.
    ///
    /// # Errors
    ///
    /// When it is no TOML, or a key is unknown, missing or out of its range.
    pub fn parse(file: &str, text: &str) -> Result<Self, Error> {
        let recipe: Self = config::parse(file, text)?;
        match recipe.mistakes(file).into_iter().next() {
            Some(mistake) => Err(mistake),
            None => Ok(recipe),
        }
    }

    /// All that does not fit together in it.
    pub fn mistakes(&self, file: &str) -> Vec<Error> {
        let mut all = Vec::new();
        let mut add = |key: &str, message: String| all.push(Error::new(file, key, message));
        let cure = &self.cure;
        if cure.gel >= cure.time {
            let message = format!(
                "{} s is not before the lamp goes off, {} s; accepted is less",
                cure.gel, cure.time
            );
            add("cure.gel", message);
        }
        if cure.precompensate && !cure.track {
            add(
                "cure.precompensate",
                "needs `cure.track = true`: what following the peak tells is what it is known by"
                    .to_owned(),
            );
        }
        if !(0.05..=0.95).contains(&cure.after_gel) {
            let message = format!("is {}; accepted is 0.05 to 0.95", cure.after_gel);
            add("cure.after_gel", message);
        }
        if cure.released > MOST_RELEASED {
            let message = format!("is {}; accepted is 0 to {MOST_RELEASED}", cure.released);
            add("cure.released", message);
        }
        if cure.let_go > MOST_SCATTER {
            let (is, most) = (1e6 * cure.let_go, 1e6 * MOST_SCATTER);
            let message = format!("is {is} um; accepted is at most {most} um");
            add("cure.let_go", message);
        }
        if cure.bend > MOST_BEND {
            let most = 1e6 * MOST_BEND;
            let message = format!("is {} um; accepted is at most {most} um", 1e6 * cure.bend);
            add("cure.bend", message);
        }
        if self.adhesive.volume == 0 {
            add("adhesive.volume", "is 0; accepted is 1 to 255".to_owned());
        }
        for (key, seconds, most) in [
            ("adhesive.dwell", self.adhesive.dwell, LONGEST_STAND),
            ("cure.time", cure.time, LONGEST_CURE),
            ("verify.look", self.verify.look, LONGEST_STAND),
        ] {
            if seconds > most {
                add(key, format!("is {seconds} s; accepted is at most {most} s"));
            }
        }
        if self.adhesive.dwell >= self.adhesive.open {
            let message = format!(
                "is {} s, and adhesive must be under the lamp within {} s; accepted is less than that",
                self.adhesive.dwell, self.adhesive.open
            );
            add("adhesive.dwell", message);
        }
        if cure.margin > MOST_MARGIN {
            let message = format!("is {}; accepted is 0 to {MOST_MARGIN}", cure.margin);
            add("cure.margin", message);
        }
        if cure.scatter > MOST_SCATTER {
            let message = format!(
                "is {} um; accepted is at most {} um",
                1e6 * cure.scatter,
                1e6 * MOST_SCATTER
            );
            add("cure.scatter", message);
        }
        for (key, attempts) in [
            ("pick.attempts", self.pick.attempts),
            ("adhesive.attempts", self.adhesive.attempts),
            ("align.attempts", self.align.attempts),
        ] {
            if !(1..=MOST_ATTEMPTS).contains(&attempts) {
                let message = format!("is {attempts}; accepted is 1 to {MOST_ATTEMPTS}");
                add(key, message);
            }
        }
        if self.ports.is_empty() {
            add("ports", "names no port".to_owned());
        }
        for (i, port) in self.ports.iter().enumerate() {
            if self.ports[..i].contains(port) {
                add("ports", format!("names \"{port}\" twice"));
            }
        }
        if let Some(late) = self.ports.iter().position(|port| port == "input")
            && late > 0
        {
            let message =
                "has \"input\" after an output, which without its light cannot be aligned";
            add("ports", message.to_owned());
        }
        if cure.together && (self.ports.len() < 2 || self.ports[0] != "input") {
            let message = "needs an input and an output after it in `ports`".to_owned();
            add("cure.together", message);
        }
        if self.interrupted == Action::NextFiber {
            let message = "is \"next-fiber\"; accepted is reject-device or call".to_owned();
            add("interrupted", message);
        }
        all
    }

    /// When the fiber comes to rest under the lamp, seconds.
    pub fn rest(&self) -> f64 {
        self.cure.gel * (1.0 - self.cure.margin)
    }

    /// Shift that comes once the fiber is at rest, over what came before: by the adhesive's kinetics, which everyone knows, and
    /// what the recipe says of it.
    pub fn ratio(&self) -> f64 {
        /// Steps up to then.
        const STEPS: u32 = 1000;
        let cure = &self.cure;
        let gel = 1.0 - cure.after_gel;
        let law = Kinetics::gelling(
            cure.gel,
            gel,
            Kinetics::ORDERS,
            Kinetics::SEED,
            Heat::default(),
        );
        let step = self.rest() / f64::from(STEPS);
        let at_rest = (0..STEPS).fold(Cured::default(), |cured, _| law.step(cured, 1.0, step));
        let before = gel * (at_rest.conversion / gel).clamp(1e-3, 1.0);
        (1.0 - before) / before
    }

    /// What it does, in words.
    pub fn explain(&self) -> String {
        let mut text = String::new();
        let Self {
            pick,
            adhesive,
            align,
            cure,
            verify,
            ..
        } = self;
        let procedure = match align.procedure {
            Procedure::Thesis => "thesis's",
            Procedure::Fast => "fast",
        };
        let _ = writeln!(
            text,
            "{}: fibers to {} of {}\n",
            self.name,
            self.ports.join(", "),
            self.device
        );
        let mut line = |phase: &str, what: String| {
            let _ = writeln!(text, "{phase:10}{what}");
        };
        line(
            "pick",
            format!(
                "at most {} times, no more after {} s; then {}",
                pick.attempts,
                pick.limit,
                pick.failed.words()
            ),
        );
        line(
            "adhesive",
            format!(
                "{} nl, {} s at the needle, under the lamp within {} s, at most {} times; else {}",
                adhesive.volume,
                adhesive.dwell,
                adhesive.open,
                adhesive.attempts,
                adhesive.failed.words()
            ),
        );
        line(
            "align",
            format!(
                "by the {procedure} procedure, at most {} times, no more after {} s; then {}",
                align.attempts,
                align.limit,
                align.failed.words()
            ),
        );
        for (ending, reaction) in &align.on {
            let what = reaction.at_once().map_or("try again", Action::words);
            line("", format!("on {}: {what}", <&str>::from(ending)));
        }
        let follows = match (cure.track, cure.precompensate) {
            (false, _) => "held where it is".to_owned(),
            (true, false) => format!("at the light's peak until {:.1} s", self.rest()),
            (true, true) => format!(
                "at the light's peak until {:.1} s, then beyond it by the shift that is expected",
                self.rest()
            ),
        };
        let together = if cure.together {
            "; input and first output at once"
        } else {
            ""
        };
        line(
            "cure",
            format!("{} s under the lamp, {follows}{together}", cure.time),
        );
        if cure.track && cure.bend > 0.0 {
            line(
                "",
                format!(
                    "at last bent: its holder goes {:.0} um aside and back, for where it is from its peak",
                    1e6 * cure.bend
                ),
            );
        }
        line(
            "verify",
            format!(
                "released, light looked at for {} s; lost more than {} dB: {}",
                verify.look,
                verify.added_loss_db,
                verify.failed.words()
            ),
        );
        line(
            "resume",
            format!("a half-done device: {}", self.interrupted.words()),
        );
        text
    }
}

impl Action {
    /// The same in words.
    const fn words(self) -> &'static str {
        match self {
            Self::NextFiber => "go on with the next fiber",
            Self::RejectDevice => "reject the device",
            Self::Call => "stop and call a person",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_beyond_their_types_are_told_what_is_accepted() {
        let shipped = include_str!("../../../recipes/produce-fast.toml");
        for (is, put, key, accepted) in [
            ("volume = 20", "volume = -3", "adhesive.volume", "1 to 255"),
            ("volume = 20", "volume = 256", "adhesive.volume", "1 to 255"),
            ("attempts = 3", "attempts = -1", "pick.attempts", "1 to 100"),
        ] {
            let text = shipped.replacen(is, put, 1);
            let why = Production::parse("a.toml", &text).expect_err("it is refused");
            let said = format!("{why:?}");
            assert!(said.contains(key) && said.contains(accepted), "{said}");
        }
    }
}
