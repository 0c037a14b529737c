//! Claims counted by what they rest on.

use crate::claims::changes::{Change, WITHDRAWN, Withdrawn};
use crate::claims::{Claim, Group};
use serde::Serialize;

/// How many of some claims hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Count {
    /// Those that hold.
    pub hold: usize,
    /// All of them.
    pub of: usize,
}

impl Count {
    fn of<'a>(claims: impl Iterator<Item = &'a Claim>) -> Self {
        let mut count = Self { hold: 0, of: 0 };
        for claim in claims {
            count.hold += usize::from(claim.holds);
            count.of += 1;
        }
        count
    }
}

/// The claims of a run, each counted once by what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Accounts {
    /// Those to which nothing was fitted.
    pub predictions: Count,
    /// Of these, those of which nothing was changed after a result was seen.
    pub predictions_unchanged: Count,
    /// Those for which a number was set, or may have been.
    pub calibrated: Count,
    /// Of these, those of which it is in doubt.
    pub calibrated_in_doubt: Count,
    /// Those that cannot fail by construction.
    pub definitions: Count,
    /// Those of which something was changed after a result was seen, whatever they rest on.
    pub changed: Count,
    /// Every such change, by claims in the order of the thesis.
    pub changed_after_result: Vec<Change>,
    /// Claims that are in the list no more.
    pub withdrawn: Vec<Withdrawn>,
}

impl Accounts {
    /// Those of some figures' claims.
    pub(crate) fn new(claims: &[Claim], figures: &[&str]) -> Self {
        let count = |keep: &dyn Fn(&Claim) -> bool| Count::of(claims.iter().filter(|c| keep(c)));
        Self {
            predictions: count(&|c| c.basis == Group::Prediction),
            predictions_unchanged: count(&|c| c.basis == Group::Prediction && c.changes.is_empty()),
            calibrated: count(&|c| c.basis == Group::Calibrated),
            calibrated_in_doubt: count(&|c| c.in_doubt),
            definitions: count(&|c| c.basis == Group::Definition),
            changed: count(&|c| !c.changes.is_empty()),
            changed_after_result: claims.iter().flat_map(|c| &c.changes).copied().collect(),
            withdrawn: WITHDRAWN
                .iter()
                .filter(|w| figures.contains(&w.figure()))
                .copied()
                .collect(),
        }
    }

    /// The count of a group.
    pub fn group(&self, group: Group) -> Count {
        match group {
            Group::Prediction => self.predictions,
            Group::Calibrated => self.calibrated,
            Group::Definition => self.definitions,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::changes::{CHANGES, What};
    use crate::claims::{Basis, all};
    use std::collections::BTreeSet;

    /// All claims, as if each gave what is printed.
    fn printed() -> Vec<Claim> {
        all()
            .map(|s| Claim::new(s, Some(s.thesis), "", false))
            .collect()
    }

    #[test]
    fn every_claim_is_counted_once() {
        let claims = printed();
        let a = Accounts::new(&claims, &["3.4"]);
        let groups = Group::ALL.map(|group| a.group(group));
        assert_eq!(groups.map(|c| c.of).iter().sum::<usize>(), claims.len());
        let held = claims.iter().filter(|c| c.holds).count();
        assert_eq!(groups.map(|c| c.hold).iter().sum::<usize>(), held);
        assert!(a.predictions_unchanged.of < a.predictions.of);
        assert!(a.calibrated_in_doubt.of < a.calibrated.of);
        assert_eq!(a.changed_after_result.len(), CHANGES.len());
        assert_eq!(a.withdrawn.len(), 1);
        assert!(Accounts::new(&claims, &["2.8"]).withdrawn.is_empty());
    }

    #[test]
    fn what_was_fitted_or_why_it_cannot_fail_is_said() {
        for claim in printed() {
            let said = claim.fitted.or(claim.by_construction);
            assert_eq!(said.is_none(), claim.basis == Group::Prediction);
            assert!(said.is_none_or(|why| why.len() > 10), "{}", claim.id);
            assert_eq!(claim.calibrated, claim.fitted.is_some(), "{}", claim.id);
        }
        // What was not to be had although its experiment was fitted is no calibrated claim.
        let failing = all().filter(|s| s.cause.is_some() && s.id != "4.10-factor");
        for statement in failing {
            assert_eq!(statement.basis, Basis::Prediction, "{}", statement.id);
        }
    }

    #[test]
    fn changes_are_of_claims_with_the_verdicts_of_their_results() {
        let ids: BTreeSet<&str> = all().map(|s| s.id).collect();
        let listed: usize = all().map(|s| s.changes().count()).sum();
        assert_eq!(listed, CHANGES.len());
        for change in CHANGES {
            assert!(ids.contains(change.claim), "{}", change.claim);
            assert!(change.commit.len() == 7 && change.date.len() == 10);
            assert_eq!(change.before.is_none(), change.what == What::Added);
            assert!(!change.to.is_empty() && !change.why.is_empty());
            let Some(statement) = all().find(|s| s.id == change.claim) else {
                continue;
            };
            let later = change.before.filter(|_| change.what != What::Tolerance);
            for verdict in later.into_iter().chain([change.after]) {
                let holds = statement.kind.holds(statement.thesis, verdict.ours);
                assert_eq!(verdict.holds, holds, "{}", change.claim);
            }
        }
        for withdrawn in WITHDRAWN {
            assert!(!ids.contains(withdrawn.claim), "{}", withdrawn.claim);
        }
    }
}
