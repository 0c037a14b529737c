//! How a record is made into equations.

use super::equations::Moved;
use super::{Controller, Place, Record, check};

/// Highest cutoff that is taken by itself, hertz.
const MOST: f64 = 100.0;

/// How a record is made into equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Force or torque of a volt, N/V or N m/V.
    pub force_per_volt: f64,
    /// Cutoff of the position's filter, hertz; if none a tenth of the sample rate and at most 100 Hz, lower where the position is noisy and
    /// higher where it is quiet and rows stand far apart.
    pub cutoff: Option<f64>,
    /// Order of the filter.
    pub order: usize,
    /// Samples left out at each stretch's start.
    pub skip: usize,
    /// One equation in so many samples; the sample rate over the cutoff if none.
    pub decimate: Option<usize>,
    /// The controller, where it is known.
    pub controller: Option<Controller>,
    /// Whether equations are left out at either end of a stretch, where filters still settle: [`identify`](super::identify) tells from the
    /// record.
    pub settle: bool,
    /// What goes with the place and is taken out of the force: [`identify`](super::identify) tells from the record.
    pub place: Option<Place>,
    /// Whether voltage and position are of the moments of their rows, no skew having been taken out: [`identify`](super::identify) tells from the
    /// record.
    pub as_stamped: bool,
}

impl Settings {
    /// The usual settings for a force per volt.
    pub fn new(force_per_volt: f64) -> Self {
        Self {
            force_per_volt,
            cutoff: None,
            order: 4,
            skip: 49,
            decimate: None,
            controller: None,
            settle: false,
            place: None,
            as_stamped: true,
        }
    }

    pub(super) fn cutoff(&self, period: f64) -> f64 {
        self.cutoff.unwrap_or_else(|| usual(period))
    }

    /// Whether the filter lets through more than the usual one.
    pub(super) fn is_fine(&self, period: f64) -> bool {
        self.cutoff(period) > usual(period)
    }

    pub(super) fn factor(&self, period: f64) -> usize {
        let usual = (1.0 / (period * self.cutoff(period))).round();
        self.decimate.unwrap_or(usual as usize).max(1)
    }
}

/// The cutoff of rows that stand close, hertz.
fn usual(period: f64) -> f64 {
    (0.1 / period).min(MOST)
}

/// Times the usual cutoff, from the finest on, that are tried: the first lets through nearly all that rows resolve.
const TRIED: [f64; 7] = [4.5, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125];

/// Share by which a period that stamps tell may be another one.
const ROUNDED: f64 = 1e-3;

/// Settings under which the noise of the position is next to nothing beside the acceleration: noise in what a force
/// is told by makes an inertia too small. Where rows are so far apart that the usual filter reaches over a good part of a way from turn to turn,
/// it smears the step of friction over it: the finest that leaves noise that small is taken, below what is usual for rows
/// that stand close. Only where no cutoff was given.
pub(super) fn quiet(
    record: &Record,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> (Settings, Moved) {
    let period = record.even.period;
    let usual = set.cutoff(period);
    if set.cutoff.is_some() || set.decimate.is_some() {
        return (*set, Moved::of(record, set));
    }
    let mut quiet = *set;
    let mut found = None;
    for (k, times) in TRIED.iter().enumerate() {
        let cutoff = times * usual;
        // Periods that stamps tell differ in their last digits.
        if *times > 1.0 && cutoff > (1.0 - ROUNDED) * MOST {
            continue;
        }
        quiet.cutoff = Some(cutoff);
        quiet.decimate = (k == 0).then_some(1);
        let moved = Moved::of(record, &quiet);
        let share = check::noise_share(record, &moved, &quiet);
        found = Some(moved);
        if share < check::QUIET {
            break;
        }
    }
    let moved = found.unwrap_or_else(|| Moved::of(record, &quiet));
    if let Some(cutoff) = quiet.cutoff.filter(|c| *c < usual) {
        remarks.push(format!(
            "the position is noisy: filtered at {cutoff:.3} Hz instead of {usual:.3} Hz, so that its noise does not \
             count as acceleration"
        ));
    }
    (quiet, moved)
}

#[cfg(test)]
mod tests {
    use super::{Record, Settings, quiet};
    use crate::timeline;

    /// Stamps are rounded, and a period is never 2 ms to the last digit.
    #[test]
    fn rows_of_two_milliseconds_are_filtered_as_finely_whatever_their_last_digit() {
        for period in [2e-3, 2e-3 * (1.0 + 1e-7), 2e-3 * (1.0 - 1e-7)] {
            let time: Vec<f64> = (0..4000).map(|k| period * f64::from(k)).collect();
            let position: Vec<f64> = time.iter().map(|t| 0.1 * (7.0 * t).sin()).collect();
            let even = timeline::even(&time, &[&position, &position]).expect("an even grid");
            let record = Record::new(even, false);
            let (set, _) = quiet(&record, &Settings::new(1.0), &mut Vec::new());
            assert!(!set.is_fine(record.even.period), "{period}: {set:?}");
        }
    }
}
