//! A force that was written behind a high pass: by a charge amplifier, as that of a piezoelectric sensor, or an input that is coupled
//! through a capacitor.
//!
//! What such an input holds goes back to zero with a time constant `T`: `f' + f / T = F'`, so that the force is `F = f + 1/T` times the
//! integral of what was written, but for a constant. Of the offset nothing is left, and a level that sags from one turn to the next
//! is none. A contact whose force sags while it slides does so with the way that it slides, or with its speed; that it goes with the integral of
//! what was written shows it.

use super::{Fitted, Record, Sample, turned};
use crate::steady::chi_squared;
use pigtail_numerics::regression::{least_squares, matrix};
use pigtail_numerics::signal::independent;

/// Share of the level by which a force sags from one turn to the next from which on that is said: what a law does not tell of a contact may
/// look as less. Chosen before any record was looked at.
const LEAST_SAG: f64 = 0.005;

/// The time constant of the high pass that a force was written behind, seconds, where it was.
fn constant(record: &Record, fitted: &Fitted) -> Option<f64> {
    let samples = &record.samples;
    if !record.has_time {
        return None;
    }
    // What a law does not tell of the level goes into it: of three records behind 50 s 52, 73 and 92 s were told. It is not what is asked.
    let told = fitted.law.predict(&fitted.values, samples);
    let force: Vec<f64> = samples.iter().map(|s| s.force).collect();
    let mut integral = vec![0.0; samples.len()];
    for k in 1..samples.len() {
        if !samples[k].begins {
            let step = samples[k].time - samples[k - 1].time;
            integral[k] = integral[k - 1] + 0.5 * step * (force[k] + force[k - 1]);
        }
    }
    // A stretch begins with a constant of its own, for what an input held before it nobody knows.
    let [told, integral, force] =
        [told, integral, force].map(|column| about_means(samples, column));
    let without = least_squares(&matrix(&[&told]), &force)?;
    let with = least_squares(&matrix(&[&told, &integral]), &force)?;
    let squares = |residuals: &[f64]| residuals.iter().map(|r| r * r).sum::<f64>();
    let gained = independent(&with.residuals)
        * (squares(&without.residuals) / squares(&with.residuals)).ln();
    let rate = -with.values.last()?;
    (gained > chi_squared(1.0) && rate > 0.0).then(|| 1.0 / rate)
}

/// A column about its mean in each stretch.
fn about_means(samples: &[Sample], mut column: Vec<f64>) -> Vec<f64> {
    let mut from = 0;
    for stretch in samples.chunk_by(|_, next| !next.begins) {
        let own = &mut column[from..from + stretch.len()];
        let mean = own.iter().sum::<f64>() / own.len() as f64;
        for v in own {
            *v -= mean;
        }
        from += stretch.len();
    }
    column
}

/// Why a record is refused whose force was written behind a high pass.
pub(super) fn coupled(record: &Record, fitted: &Fitted) -> Option<String> {
    let constant = constant(record, fitted)?;
    let (low, high) = record.range(|s| s.displacement);
    let turns = turned(&record.samples, high - low).len().max(1);
    let between = record.period() * record.samples.len() as f64 / turns as f64;
    (between > LEAST_SAG * constant).then(|| {
        format!(
            "its force goes back to zero while the contact slides, by {:.1} % from one turn to the next, within some {constant:.0} s, as a charge \
             amplifier or an input coupled through a capacitor has it: nothing of its offset is left, and its level sags. Couple it directly (DC), \
             or take a longer time constant",
            100.0 * (1.0 - (-between / constant).exp())
        )
    })
}
