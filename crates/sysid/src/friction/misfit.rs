//! Whether a contact is of another law than the one that is fitted, and what that makes of the parameters.
//!
//! Noise differs from one stroke to the next, and what a law cannot tell comes again wherever the contact is in the same state.
//! Batches of a record all have the same of it, so that their scatter says nothing of it. What tells the force better is asked
//! instead: the other laws, elements of every length, which are any contact that gives way by displacement alone, and all laws behind a
//! filter that both channels went through. What both
//! know, how high friction is, over which way it is reached, how stiff the contact is at rest, the law knows no better than the
//! two agree.

use super::elements::elements;
use super::filtered::filtered;
use super::{Fitted, Record, residuals};
use crate::steady::chi_squared;
use pigtail_numerics::signal::independent;

/// Shares of the stroke after which the shortest elements slip: how stiff a contact is at rest goes with what is not resolved, and
/// is known no better than these agree.
const SHORTEST: [f64; 3] = [1.0 / 100.0, 1.0 / 300.0, 1.0 / 1000.0];

/// What a law, or elements, say of a contact.
struct Told {
    /// Forces at which it slides, forward and backward, N, and the ways over which they are reached, m.
    sides: [f64; 2],
    ways: [f64; 2],
    /// What it breaks away at, that of both directions together, N.
    fixed: f64,
    /// Ways after which the first and the last element slip, m.
    slips: Option<[f64; 2]>,
    /// Stiffness at rest, N/m.
    stiffness: f64,
    /// What is left of the force, N, and the number of parameters.
    left: Vec<f64>,
    used: usize,
}

impl Told {
    fn squares(&self) -> f64 {
        self.left.iter().map(|l| l * l).sum()
    }

    /// What it says of a parameter, by its name.
    fn of(&self, name: &str) -> Option<f64> {
        let both = |of: [f64; 2]| 0.5 * (of[0] + of[1]);
        match name {
            "static_friction" => Some(self.fixed),
            "coulomb_friction" => Some(both(self.sides)),
            "static_friction_forward" => Some(self.sides[0]),
            "static_friction_backward" => Some(self.sides[1]),
            "presliding" => Some(both(self.ways)),
            "presliding_forward" => Some(self.ways[0]),
            "presliding_backward" => Some(self.ways[1]),
            "first_slip" => self.slips.map(|s| s[0]),
            "last_slip" => self.slips.map(|s| s[1]),
            "stiffness" => Some(self.stiffness),
            _ => None,
        }
        .filter(|v| v.is_finite())
    }

    /// Whether it would tell another record of the same contact better than `other` (H. Akaike, *A new look at the statistical
    /// model identification*, 1974), with as many points as what it leaves has of its own. The criterion is a lenient one: to
    /// be less sure than need be misleads nobody.
    fn beats(&self, other: &Self) -> bool {
        self.gain(other) > 2.0 * self.more(other)
    }

    /// Whether chance would make it tell so much more than `other` in one record of ten thousand at most: a record has a
    /// dozen of rivals, so that all together may be wrong in one of a thousand.
    fn surely_beats(&self, other: &Self) -> bool {
        self.gain(other) > chi_squared(self.more(other))
    }

    /// Twice the logarithm of the ratio of likelihoods: of a law that is right, a chi-squared of the parameters that are more.
    fn gain(&self, other: &Self) -> f64 {
        independent(&self.left) * (other.squares() / self.squares()).ln()
    }

    /// How many parameters it has more.
    fn more(&self, other: &Self) -> f64 {
        self.used.saturating_sub(other.used).max(1) as f64
    }
}

fn of_law(fitted: &Fitted, record: &Record) -> Told {
    let values = &fitted.values;
    let left = residuals(fitted.law, values, &record.samples, 0);
    told(fitted, values, left, 0)
}

/// What a law says with other values, and `more` parameters.
fn told(fitted: &Fitted, values: &[f64], left: Vec<f64>, more: usize) -> Told {
    let law = fitted.law;
    Told {
        sides: law.sides(values),
        ways: law.ways(values),
        fixed: if law.needs_time() {
            values[2]
        } else {
            0.5 * (law.sides(values)[0] + law.sides(values)[1])
        },
        slips: None,
        stiffness: law.stiffness(values),
        left,
        used: fitted.known.iter().filter(|k| k.std.is_finite()).count() + more,
    }
}

/// Finds how much of what each law leaves another one tells, and makes its parameters as unsure as that asks for.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    let told: Vec<Told> = laws.iter().map(|l| of_law(l, record)).collect();
    let every: Vec<Told> = SHORTEST
        .iter()
        .flat_map(|shortest| [(*shortest, false), (*shortest, true)])
        .filter_map(|(shortest, two_sided)| elements(record, shortest, two_sided))
        .map(|e| Told {
            sides: e.sides,
            ways: e.ways,
            fixed: 0.5 * (e.sides[0] + e.sides[1]),
            slips: Some(e.slips),
            stiffness: e.stiffness,
            left: e.left,
            used: e.used,
        })
        .collect();
    // A filter is there where no contact without one tells the force as well: a law that is wrong anyway is wrong behind a filter, too.
    let without = |behind: &Told| told.iter().chain(&every).all(|t| behind.beats(t));
    let filtered: Vec<Told> = laws
        .iter()
        .zip(filtered(laws, record))
        .filter_map(|(law, found)| found.map(|f| self::told(law, &f.values, f.left, 1)))
        .filter(without)
        .collect();
    for (fitted, own) in laws.iter_mut().zip(&told) {
        let rivals: Vec<&Told> = told
            .iter()
            .chain(&every)
            .chain(&filtered)
            .filter(|t| t.beats(own))
            .collect();
        let least = rivals
            .iter()
            .filter(|rival| rival.surely_beats(own))
            .map(|rival| rival.squares())
            .fold(own.squares(), f64::min);
        fitted.misfit_percent =
            (1.0 - least / own.squares()).sqrt() * fitted.relative_error_percent;
        for (j, name) in fitted.law.parameters().iter().enumerate() {
            let is = own.of(name).unwrap_or(fitted.values[j]);
            let by = rivals
                .iter()
                .filter_map(|r| r.of(name))
                .map(|other| (other - is).abs());
            let known = &mut fitted.known[j];
            known.std_correlated = known.std_correlated.hypot(by.fold(0.0, f64::max));
        }
    }
}
