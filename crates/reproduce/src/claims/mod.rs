//! What the thesis claims, sentence by sentence, and how near a result must come.
//!
//! The tolerances of [`Kind`] were chosen before any result was looked at, and have not been changed since. What
//! is measured, how, and on which machine was changed for some claims after a result was seen: [`changes`] lists
//! that. To some a number was fitted: every claim says on which [`Basis`] it stands. A claim that does not hold
//! stays in the list; [`Statement::cause`] then says why, from an experiment.

mod basis;
pub mod changes;
mod chapter2;
mod chapter3;
mod chapter4;

pub use basis::{Basis, Group, Subject};

use changes::Change;
use serde::Serialize;

/// How near a result must come to what is printed, by the kind of the claim. The only place where
/// tolerances are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A time, a length or a voltage measured on one machine: within 20 %. The thesis prints two
    /// digits of one specimen; specimens here differ by 10 % in friction and by 5 % each in inertia,
    /// stiffness and motor, which together is about that.
    Measured,
    /// What a correction leaves: within a factor of two. It is the small difference of large numbers,
    /// each of which is measured.
    Remainder,
    /// How many times better one thing is than another: within a factor of 1.5, which is 20 % of either.
    Factor,
    /// "An order of magnitude": within half of one, a factor of the root of ten.
    Order,
    /// A share, a gain or a ratio that is printed as a round number: within 0.1.
    Share,
    /// A closed form: within 2 %, for the thesis rounds to two digits.
    Formula,
    /// "Less than": below, and no more to it.
    Below,
    /// "More than": above, and no more to it.
    Above,
}

impl Kind {
    /// All kinds, in the order in which a legend lists them.
    pub const ALL: [Self; 8] = [
        Self::Measured,
        Self::Remainder,
        Self::Factor,
        Self::Order,
        Self::Share,
        Self::Formula,
        Self::Below,
        Self::Above,
    ];

    /// The results that are accepted for a printed number, the bounds included; `None` where there
    /// is no bound.
    pub fn accepted(self, printed: f64) -> (Option<f64>, Option<f64>) {
        let within = |factor: f64| (Some(printed / factor), Some(printed * factor));
        match self {
            Self::Measured => (Some(0.8 * printed), Some(1.2 * printed)),
            Self::Remainder => within(2.0),
            Self::Factor => within(1.5),
            Self::Order => within(10_f64.sqrt()),
            Self::Share => (Some(printed - 0.1), Some(printed + 0.1)),
            Self::Formula => (Some(0.98 * printed), Some(1.02 * printed)),
            Self::Below => (None, Some(printed)),
            Self::Above => (Some(printed), None),
        }
    }

    /// Whether a result is near enough.
    pub fn holds(self, printed: f64, ours: f64) -> bool {
        match self {
            Self::Below => ours < printed,
            Self::Above => ours > printed,
            _ => {
                let (low, high) = self.accepted(printed);
                low.is_none_or(|low| ours >= low) && high.is_none_or(|high| ours <= high)
            }
        }
    }

    /// In documents and tables.
    pub fn tolerance(self) -> &'static str {
        match self {
            Self::Measured => "within 20 %",
            Self::Remainder => "within a factor of 2",
            Self::Factor => "within a factor of 1.5",
            Self::Order => "within a factor of 3.2",
            Self::Share => "within 0.1",
            Self::Formula => "within 2 %",
            Self::Below => "less than that",
            Self::Above => "more than that",
        }
    }

    /// Its name in documents.
    pub fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Remainder => "remainder",
            Self::Factor => "factor",
            Self::Order => "order",
            Self::Share => "share",
            Self::Formula => "formula",
            Self::Below => "below",
            Self::Above => "above",
        }
    }

    /// Why the tolerance is what it is.
    pub fn reason(self) -> &'static str {
        match self {
            Self::Measured => {
                "a time, length or amplitude that was measured on one machine and is printed with two \
                 digits; specimens of a make differ by as much"
            }
            Self::Remainder => {
                "what a correction leaves: a small difference of large numbers, each measured"
            }
            Self::Factor => "how many times better one thing is than another: 20 % of either",
            Self::Order => "an order of magnitude: within half of one",
            Self::Share => "a share, gain or ratio that is printed as a round number",
            Self::Formula => "a closed form, which the thesis rounds to two digits",
            Self::Below => "\"less than\": the bound itself",
            Self::Above => "\"more than\": the bound itself",
        }
    }
}

/// A claim of the thesis. A new one is made by `claim`, which asks for its [`Basis`], and given its
/// [`Self::cause`] where it has one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statement {
    /// The figure, a dash and a name: unique.
    pub id: &'static str,
    /// Where it stands.
    pub section: &'static str,
    /// The sentence, or the part of it that matters.
    pub quote: &'static str,
    /// What is measured here.
    pub quantity: &'static str,
    /// The number; for a bound, the bound.
    pub thesis: f64,
    /// Its unit; empty for a bare number.
    pub unit: &'static str,
    /// How near a result must come.
    pub kind: Kind,
    /// Whether anything was fitted to it, and what.
    pub basis: Basis,
    /// On what it is judged.
    pub subject: Subject,
    /// What comes out instead, where it does not hold, and why: found by an experiment.
    pub cause: Option<(f64, &'static str)>,
    /// The same on other machines of its make, where it is not the same.
    pub on_others: Option<(f64, &'static str)>,
}

impl Statement {
    /// The figure, or the section, that it belongs to.
    pub fn figure(&self) -> &'static str {
        self.id.split('-').next().unwrap_or(self.id)
    }

    /// What was changed of it after a result was seen, the oldest first.
    pub fn changes(&self) -> impl Iterator<Item = &'static Change> {
        let id = self.id;
        changes::CHANGES
            .iter()
            .filter(move |change| change.claim == id)
    }

    /// The same, of the thesis's model.
    const fn simulated(self) -> Self {
        Self {
            subject: Subject::Model,
            ..self
        }
    }

    /// The same, of numbers that are no part of a machine.
    const fn computed(self) -> Self {
        Self {
            subject: Subject::Numbers,
            ..self
        }
    }

    /// The same, for which something else comes out, for a reason that was found.
    const fn because(self, instead: f64, cause: &'static str) -> Self {
        Self {
            cause: Some((instead, cause)),
            ..self
        }
    }

    /// The same, for which something else comes out on other specimens, for a reason that was found.
    const fn on_others_because(self, instead: f64, cause: &'static str) -> Self {
        Self {
            on_others: Some((instead, cause)),
            ..self
        }
    }

    /// Why a result that does not hold does not; `None` where it is another than the one whose reason
    /// was found. On a specimen, whose numbers differ, that is one within a factor of two.
    fn explains(&self, ours: Option<f64>, specimen: bool) -> Option<&'static str> {
        let ours = ours?;
        let (on_others, near) = if specimen {
            (self.on_others, Kind::Remainder)
        } else {
            (None, Kind::Measured)
        };
        let mut found = [self.cause, on_others].into_iter().flatten();
        found.find_map(|(instead, cause)| near.holds(instead, ours).then_some(cause))
    }
}

/// A claim: its id, where it stands and in which words; what is measured; number, unit and kind; what it rests on.
const fn claim(
    id: &'static str,
    (section, quote): (&'static str, &'static str),
    quantity: &'static str,
    (thesis, unit, kind): (f64, &'static str, Kind),
    basis: Basis,
) -> Statement {
    Statement {
        id,
        section,
        quote,
        quantity,
        thesis,
        unit,
        kind,
        basis,
        subject: Subject::Machine,
        cause: None,
        on_others: None,
    }
}

/// Every claim, in the order of the thesis.
pub fn all() -> impl Iterator<Item = &'static Statement> {
    [chapter2::CLAIMS, chapter3::CLAIMS, chapter4::CLAIMS]
        .into_iter()
        .flatten()
}

/// A claim with what came of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claim {
    /// The figure, a dash and a name.
    pub id: &'static str,
    /// What is measured.
    pub quantity: &'static str,
    /// The printed number, or bound.
    pub thesis: f64,
    /// What came out here; `null` where nothing did.
    pub ours: Option<f64>,
    /// The unit of both.
    pub unit: &'static str,
    /// How near they must be, in words.
    pub tolerance: &'static str,
    /// Whether they are.
    pub holds: bool,
    /// Why not, or what else there is to know.
    pub note: String,
    /// The kind of claim, by which the tolerance was chosen.
    pub kind: &'static str,
    /// The least accepted; `null` where there is no such bound.
    pub least: Option<f64>,
    /// The most accepted; `null` where there is no such bound.
    pub most: Option<f64>,
    /// Whether a number was set so that this comes out, or may have been.
    pub calibrated: bool,
    /// Whether it fails for a reason that was found, which is told in `note`.
    pub explained: bool,
    /// Where it stands in the thesis.
    pub section: &'static str,
    /// The sentence.
    pub quote: &'static str,
    /// Whether it is a prediction, calibrated or a definition.
    pub basis: Group,
    /// The numbers that were set for it; `null` where none was.
    pub fitted: Option<&'static str>,
    /// Whether it is in doubt that they were set for it.
    pub in_doubt: bool,
    /// Why it cannot fail; `null` where it can.
    pub by_construction: Option<&'static str>,
    /// What was changed of it after a result was seen, the oldest first.
    pub changes: Vec<Change>,
}

impl Claim {
    /// A statement beside its result on the thesis's machine, or on a specimen of its make.
    pub fn new(statement: &Statement, ours: Option<f64>, note: &str, specimen: bool) -> Self {
        let ours = ours.filter(|value| value.is_finite()).map(four_digits);
        let holds = ours.is_some_and(|ours| statement.kind.holds(statement.thesis, ours));
        let (least, most) = statement.kind.accepted(statement.thesis);
        let cause = statement.explains(ours, specimen).filter(|_| !holds);
        let mut text = note.to_owned();
        if let Some(cause) = cause {
            if !text.is_empty() {
                text.push(' ');
            }
            text.push_str(cause);
        }
        Self {
            id: statement.id,
            quantity: statement.quantity,
            thesis: statement.thesis,
            ours,
            unit: statement.unit,
            tolerance: statement.kind.tolerance(),
            holds,
            note: text,
            kind: statement.kind.name(),
            least: least.map(four_digits),
            most: most.map(four_digits),
            calibrated: statement.basis.group() == Group::Calibrated,
            explained: cause.is_some(),
            section: statement.section,
            quote: statement.quote,
            basis: statement.basis.group(),
            fitted: statement.basis.fitted(),
            in_doubt: matches!(statement.basis, Basis::Doubtful(_)),
            by_construction: statement.basis.by_construction(),
            changes: statement.changes().copied().collect(),
        }
    }
}

impl Claim {
    /// What stands before the printed number in a table: the sign of a bound.
    pub fn tolerance_sign(&self) -> &'static str {
        match self.kind {
            "below" => "< ",
            "above" => "> ",
            _ => "",
        }
    }
}

/// Four digits: more than any of these numbers means.
pub(crate) fn four_digits(value: f64) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    format!("{value:.3e}").parse().unwrap_or(value)
}
