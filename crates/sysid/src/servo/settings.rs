//! How a record is made into equations.

use super::equations::Moved;
use super::{Controller, Place, Record, check};

/// How a record is made into equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Force or torque of a volt, N/V or N m/V.
    pub force_per_volt: f64,
    /// Cutoff of the position's filter, hertz; a tenth of the sample rate and at most 100 Hz if none.
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
        self.cutoff.unwrap_or((0.1 / period).min(100.0))
    }

    pub(super) fn factor(&self, period: f64) -> usize {
        let usual = (1.0 / (period * self.cutoff(period))).round();
        self.decimate.unwrap_or(usual as usize).max(1)
    }
}

/// Settings under which the noise of the position is next to nothing beside the acceleration: noise in what a force
/// is told by makes an inertia too small. Only where no cutoff was given.
pub(super) fn quiet(
    record: &Record,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> (Settings, Moved) {
    let period = record.even.period;
    let usual = set.cutoff(period);
    let mut quiet = *set;
    let mut moved = Moved::of(record, set);
    if set.cutoff.is_some() || set.decimate.is_some() {
        return (quiet, moved);
    }
    for halvings in 0..4 {
        if halvings > 0 {
            quiet.cutoff = Some(usual * 0.5_f64.powi(halvings));
            moved = Moved::of(record, &quiet);
        }
        if check::noise_share(record, &moved, &quiet) < check::QUIET {
            break;
        }
    }
    if let Some(cutoff) = quiet.cutoff {
        remarks.push(format!(
            "the position is noisy: filtered at {cutoff:.3} Hz instead of {usual:.3} Hz, so that its noise does not \
             count as acceleration"
        ));
    }
    (quiet, moved)
}
