//! Displacement and force that went through one filter before they were written.
//!
//! Both are late alike, so that no skew shows; but a force that steps where a contact turns comes to its level only after a while, as it does
//! where a contact gives way over a longer way, and over a short stroke it never comes there: the level seems lower. What went through a
//! pole of `T` seconds is told back, `x + T x'`, a law tells the force there, and the same pole makes of it what was written.

use super::smooth::parabola;
use super::tremble::reach;
use super::{Fitted, Record, Sample};
use pigtail_numerics::nonlinear::minimise;

/// Time constants from which a pole is looked for, as shares of the mean time from one turn to the next: beyond these hardly any of a motion
/// is left, below nothing of a step is smeared that a way over which it gives way does not smear more.
const POLES: [f64; 3] = [0.01, 0.03, 0.1];

/// Parabolas from one turn to the next, as [`reach`] has them on either side.
const EACH: f64 = 16.0;

/// Parameters of the same law behind a pole, and what is left of the force then, N.
pub(super) struct Filtered {
    pub(super) values: Vec<f64>,
    pub(super) left: Vec<f64>,
}

/// A motion as samples tell it: displacement and velocity.
fn motion(record: &Record, reach: usize) -> Vec<[f64; 2]> {
    let samples = &record.samples;
    let fitted = |k: usize| {
        let widest = (1..=reach)
            .rev()
            .find_map(|reach| parabola(samples, k, reach));
        widest.map_or([samples[k].displacement, 0.0], |p| [p[0], p[1]])
    };
    (0..samples.len()).map(fitted).collect()
}

/// What a pole of so many seconds makes of a force, which each stretch begins with as it was written.
fn through(samples: &[Sample], force: Vec<f64>, pole: f64) -> Vec<f64> {
    let mut state = 0.0;
    let mut last = (0.0, 0.0);
    samples
        .iter()
        .zip(force)
        .map(|(s, force)| {
            if s.begins {
                state = s.force;
            } else {
                // Of a force that goes straight from one sample to the next.
                let step = s.time - last.0;
                let kept = (-step / pole).exp();
                let slope = (force - last.1) / step;
                state = force - slope * pole + (state - last.1 + slope * pole) * kept;
            }
            last = (s.time, force);
            state
        })
        .collect()
}

/// What each law says behind a pole.
pub(super) fn filtered(laws: &[Fitted], record: &Record) -> Vec<Option<Filtered>> {
    let reach = reach(record);
    if !record.has_time || reach < 2 {
        return laws.iter().map(|_| None).collect();
    }
    // A law asks where a contact turned: its motion is looked at as finely as that asks for, and no finer than its noise allows.
    let motion = motion(record, reach.div_ceil(4).max(2));
    let between = EACH * reach as f64 * record.period();
    laws.iter()
        .map(|fitted| {
            let from = |share: &f64| behind(fitted, record, &motion, share * between);
            let squares = |f: &Filtered| f.left.iter().map(|l| l * l).sum::<f64>();
            POLES
                .iter()
                .filter_map(from)
                .min_by(|a, b| squares(a).total_cmp(&squares(b)))
        })
        .collect()
}

fn behind(fitted: &Fitted, record: &Record, motion: &[[f64; 2]], pole: f64) -> Option<Filtered> {
    let (law, force) = (fitted.law, record.largest_force());
    let left = |coded: &[f64]| -> Vec<f64> {
        let (own, pole) = coded.split_at(coded.len() - 1);
        if coded.iter().any(|c| c.abs() > 60.0) {
            return vec![f64::NAN; record.samples.len()];
        }
        let pole = pole[0].exp();
        let moved: Vec<Sample> = record
            .samples
            .iter()
            .zip(motion)
            .map(|(s, [x, v])| Sample {
                displacement: x + pole * v,
                ..*s
            })
            .collect();
        let told = law.predict(&law.decoded(own, force), &moved);
        through(&record.samples, told, pole)
            .iter()
            .zip(&record.samples)
            .map(|(told, s)| (s.force - told) / force)
            .collect()
    };
    let mut start = law.coded(&fitted.values, force);
    start.push(pole.ln());
    let (found, _) = minimise(left, &start)?;
    let left: Vec<f64> = left(&found).into_iter().map(|l| l * force).collect();
    Some(Filtered {
        values: law.decoded(&found[..found.len() - 1], force),
        left,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pole_forgets_a_step_as_it_should() {
        let samples: Vec<Sample> = (0..100)
            .map(|k| Sample {
                time: 0.01 * f64::from(k),
                begins: k == 0,
                ..Sample::default()
            })
            .collect();
        let mut force = vec![1.0; 100];
        force[0] = 0.0;
        let told = through(&samples, force, 0.1);
        // The step takes a sample, and is in its middle half a sample late.
        for (s, told) in samples.iter().zip(told).skip(2) {
            let is = 1.0 - (-(s.time - 0.005) / 0.1).exp();
            assert!((told - is).abs() < 1e-3, "{told} {is}");
        }
    }
}
