//! The last turns at the chip, made anew until a place is sure: how often, and what is done about it meanwhile.

use crate::belief::Across;
use crate::conical_scan::ConicalScan;
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::recipe::{Fast, Retry};
use crate::shaking::{Believed, Shaking};
use crate::tuning::TUNING;

/// What a recipe allows of last turns, and what became of it so far.
pub(crate) struct LastTries<'r> {
    retry: &'r Retry,
    /// How well the peak is to be known, metres: at first, and now.
    first: f64,
    accuracy: f64,
    /// For how many light samples the tip was watched.
    pub(crate) watched: usize,
    /// How well the peak was known at best, metres.
    best: f64,
    attempt: u32,
    /// How often more where what is missing can be known better...
    patience: u32,
    /// ...and where only the light at rest is not what was foreseen.
    resting: u32,
}

impl<'r> LastTries<'r> {
    pub(crate) fn new(fast: &'r Fast) -> Self {
        Self {
            retry: &fast.retry,
            first: fast.accuracy,
            accuracy: fast.accuracy,
            watched: 0,
            best: f64::INFINITY,
            attempt: 0,
            patience: fast.retry.patience,
            resting: fast.retry.resting,
        }
    }

    /// Begins another.
    pub(crate) fn begin(&mut self) {
        self.attempt += 1;
    }

    /// Whether there are no more after this one.
    pub(crate) fn is_last(&self) -> bool {
        self.attempt >= self.retry.last_turns
    }

    /// The one that was begun does not count.
    pub(crate) fn does_not_count(&mut self) {
        self.attempt -= 1;
    }

    /// The light at rest was not what was foreseen.
    pub(crate) fn has_not_rested(&mut self) {
        if self.resting > 0 {
            self.resting -= 1;
            self.does_not_count();
        }
    }

    /// How well the peak is to be known, metres; and so many times as many turns may be made for it as usual, for light that is noise beside its
    /// peak takes as many more.
    pub(crate) fn accuracy(&self) -> (f64, f64) {
        (self.accuracy, (self.first / self.accuracy).powi(2))
    }

    /// Asks for a peak that is known better, or watches how the tip shakes, after a place that is `known` so well was not surely within a
    /// tolerance (metres). What shakes cannot be made less; the peak can be known better, but for one too dim to
    /// be. Watching does not help where that is all that is missing; where neither is enough by itself both are done. As long as it can come to be sure
    /// the last try is not the last, where there is patience.
    ///
    /// # Errors
    ///
    /// As [`ConicalScan::watch_while`].
    pub(crate) async fn learn(
        &mut self,
        bench: &Reactor<'_>,
        scan: &mut ConicalScan<'_>,
        gap: f64,
        (tolerance, known): (f64, Across),
    ) -> Result<(), Halt> {
        let sure = |tip: &Believed, known| tip.is_sure(tolerance, known).is_ok();
        let share = self.retry.better;
        let dim = known.worse() > share.sqrt() * self.best;
        self.best = self.best.min(known.worse());
        let better = known.seen(share * share);
        // A drift may have been seen by chance.
        let finest = known.seen((TUNING.last.finest / known.worse()).min(1.0));
        // No peak is known so well that it would be sure of a tip of which so little is known.
        let both = |tip: &Believed| !sure(tip, finest) && tip.may_be_sure(tolerance, finest);
        let watching_helps = |shaking: &Shaking| {
            let tip = shaking.believed();
            let by_turns = !dim && sure(&tip, better);
            let helps = tip.may_be_sure(tolerance, known) || both(&tip);
            !by_turns && !sure(&tip, known) && helps
        };
        let tip = scan.shaking().believed();
        if self.watched > 0 || both(&tip) || !watching_helps(&scan.shaking()) {
            self.accuracy = (share * self.accuracy).max(TUNING.last.finest);
        }
        scan.watch_while(bench, gap, &mut self.watched, watching_helps)
            .await?;
        if sure(&scan.shaking().believed(), finest) && self.is_last() && self.patience > 0 {
            self.patience -= 1;
            self.does_not_count();
        }
        Ok(())
    }
}
