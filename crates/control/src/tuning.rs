//! The numbers that alignment goes by and that are neither the recipe's, nor the datasheet's, nor belief about one machine.
//!
//! Each was found by looking at machines, nearly always at twins: a threshold, a margin, a count. So each says in what unit it is, where it comes
//! from, and on what machines alignment was shown to do well with it. On others it may do worse. What is mathematics, such as how many steps a
//! fit takes, stands where it is used.
//!
//! ```
//! use pigtail_control::tuning::{Shown, TUNING, topics};
//!
//! assert!(TUNING.last.misfit < 0.05);
//! let last = topics().into_iter().find(|topic| topic.key == "last").unwrap();
//! assert!(last.shown.contains(&Shown::Fast));
//! assert!(last.numbers.iter().any(|number| number.key == "misfit"));
//! ```

mod axes;
mod bonds;
mod circles;
mod gaps;
mod search;
mod taught;

pub use axes::AxisSwing;
pub use bonds::{Bond, Hold};
pub use circles::{
    Ahead, Answer, Circle, LastTurns, MicroDynamics, MicroRingDown, TipShaking, WatchedLight,
};
pub use gaps::{Gap, LightBeam, LightRise, Piezos, SpotWidth, Vision};
pub use search::{Care, DarkLook, NinePointClimb, Nudge, Pair, Reach, Search};
pub use taught::{Lines, TaughtBench};

/// Where a number comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// It follows from an equation, or from what is meant.
    Equation,
    /// Somebody has looked how it does with others, and this did best.
    Measured,
    /// Makers, or the thesis, state it.
    Stated,
    /// It was chosen, and did well.
    Choice,
}

impl Origin {
    /// In a word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Equation => "equation",
            Self::Measured => "measured",
            Self::Stated => "stated",
            Self::Choice => "choice",
        }
    }
}

/// Machines on which alignment was shown to do well with a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    /// The fast procedure's.
    Fast,
    /// The thesis's procedure's.
    Thesis,
    /// Those without a micro.
    MacroOnly,
    /// Benches that are controlled by position.
    Bench,
    /// Those that were commissioned.
    Commissioned,
    /// Production cycles.
    Trays,
}

impl Shown {
    /// Fleet and calibration, and where the figures are.
    pub const fn machines(self) -> &'static str {
        match self {
            Self::Fast => {
                "`afpm`, fleet `nominal` with the shipped calibration, and `workshop` and `thesis` with those that commissioning has written, by \
                 the fast procedure"
            }
            Self::Thesis => {
                "`afpm`, fleet `nominal` with the shipped calibration, by the thesis's procedure"
            }
            Self::MacroOnly => {
                "`afpm`, fleet `nominal` with the shipped calibration, by `macro-only`"
            }
            Self::Bench => "`bench-piezo` with the shipped calibration",
            Self::Commissioned => "`afpm`, fleet `workshop`, while it is commissioned",
            Self::Trays => "`afpm`, fleet `workshop`, commissioned, by trays of `produce`",
        }
    }
}

/// A number, as it is shown to people.
#[derive(Debug, Clone, PartialEq)]
pub struct Number {
    /// Its name within its topic.
    pub key: &'static str,
    /// Its value, in its unit.
    pub value: String,
    /// Its unit; `1` for none.
    pub unit: &'static str,
    /// Where it comes from.
    pub origin: Origin,
    /// What it is.
    pub meaning: String,
}

/// Numbers that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Its name within [`Tuning`].
    pub key: &'static str,
    /// What it is about.
    pub about: String,
    /// On what machines its numbers were shown to do well.
    pub shown: &'static [Shown],
    /// The numbers.
    pub numbers: Vec<Number>,
}

/// Defines the numbers of a topic: each with its meaning, its value, its unit, and where it comes from. They are what control reads and what people
/// are shown.
macro_rules! topic {
    (
        $(#[doc = $about:literal])+
        pub struct $name:ident in $key:literal, shown [$($shown:ident),+] {
            $($(#[doc = $meaning:literal])+ $field:ident: $type:ty = $value:expr, $unit:literal, $origin:ident;)+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name {
            $($(#[doc = $meaning])+ #[doc = concat!("\n\nUnit: ", $unit, ". Origin: ", stringify!($origin), ".")] pub $field: $type,)+
        }

        impl $name {
            /// What is used.
            pub(super) const USED: Self = Self { $($field: $value,)+ };

            /// The same as people are shown it.
            pub(super) fn topic() -> crate::tuning::Topic {
                let text = |lines: &[&str]| lines.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ");
                crate::tuning::Topic {
                    key: $key,
                    about: text(&[$($about),+]),
                    shown: &[$(crate::tuning::Shown::$shown),+],
                    numbers: vec![$(crate::tuning::Number {
                        key: stringify!($field),
                        value: format!("{:?}", Self::USED.$field),
                        unit: $unit,
                        origin: crate::tuning::Origin::$origin,
                        meaning: text(&[$($meaning),+]),
                    }),+],
                }
            }
        }
    };
}
use topic;

/// All of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tuning {
    /// Axes that swing at rest.
    pub swing: AxisSwing,
    /// Circles.
    pub circle: Circle,
    /// Where the peaks of turns lead.
    pub ahead: Ahead,
    /// The last turns at the chip.
    pub last: LastTurns,
    /// How peaks answer to circles.
    pub answer: Answer,
    /// What light tells beside its peak.
    pub watch: WatchedLight,
    /// How micros swing.
    pub dynamics: MicroDynamics,
    /// How long micros swing, as a camera sees it.
    pub ring_down: MicroRingDown,
    /// How tips shake.
    pub shaking: TipShaking,
    /// How steeply light rises with the gap.
    pub rise: LightRise,
    /// The gap.
    pub gap: Gap,
    /// The gap by how wide the spot is.
    pub width: SpotWidth,
    /// The light between fiber and guide.
    pub beam: LightBeam,
    /// What light teaches of piezos.
    pub piezos: Piezos,
    /// Where vision sees tips.
    pub vision: Vision,
    /// Searches.
    pub search: Search,
    /// The dark, and the chip's top.
    pub dark: DarkLook,
    /// Peaks that a micro does not reach.
    pub reach: Reach,
    /// Both fibers of a guide, held.
    pub pair: Pair,
    /// The nine-point climb.
    pub climb: NinePointClimb,
    /// Alignment without a micro.
    pub nudge: Nudge,
    /// The bond.
    pub bond: Bond,
    /// Fibers that are held.
    pub hold: Hold,
    /// Alignment without a camera.
    pub taught: TaughtBench,
    /// Lines over a peak, which measure a bench.
    pub lines: Lines,
}

/// What is used.
pub const TUNING: Tuning = Tuning {
    swing: AxisSwing::USED,
    circle: Circle::USED,
    ahead: Ahead::USED,
    last: LastTurns::USED,
    answer: Answer::USED,
    watch: WatchedLight::USED,
    dynamics: MicroDynamics::USED,
    ring_down: MicroRingDown::USED,
    shaking: TipShaking::USED,
    rise: LightRise::USED,
    gap: Gap::USED,
    width: SpotWidth::USED,
    beam: LightBeam::USED,
    piezos: Piezos::USED,
    vision: Vision::USED,
    search: Search::USED,
    dark: DarkLook::USED,
    reach: Reach::USED,
    pair: Pair::USED,
    climb: NinePointClimb::USED,
    nudge: Nudge::USED,
    bond: Bond::USED,
    hold: Hold::USED,
    taught: TaughtBench::USED,
    lines: Lines::USED,
};

/// All of them as people are shown them, in the order of [`Tuning`].
pub fn topics() -> Vec<Topic> {
    vec![
        AxisSwing::topic(),
        Circle::topic(),
        Ahead::topic(),
        LastTurns::topic(),
        Answer::topic(),
        WatchedLight::topic(),
        MicroDynamics::topic(),
        MicroRingDown::topic(),
        TipShaking::topic(),
        LightRise::topic(),
        Gap::topic(),
        SpotWidth::topic(),
        LightBeam::topic(),
        Piezos::topic(),
        Vision::topic(),
        Search::topic(),
        DarkLook::topic(),
        Reach::topic(),
        Pair::topic(),
        NinePointClimb::topic(),
        Nudge::topic(),
        Bond::topic(),
        Hold::topic(),
        TaughtBench::topic(),
        Lines::topic(),
    ]
}
