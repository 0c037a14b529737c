//! LuGre where a record does not tell all of it.

use super::{Fitted, Law, Record, Sample, error, residuals, sure};
use pigtail_numerics::nonlinear::minimise;

/// LuGre whose static friction is its Coulomb friction: what is left of it where the record does not tell them apart.
pub(super) fn one_level(
    law: Law,
    record: &Record,
    second: Option<&Record>,
    (near, to): (&[f64], usize),
) -> Option<Fitted> {
    let force = record.largest_force();
    let (low, high) = record.range(|s| s.displacement);
    let speed = near[3];
    let fit = |samples: &[Sample]| -> Option<Vec<f64>> {
        let whole = |free: &[f64]| {
            let mut coded = vec![free[0], free[1], 0.0, speed.ln()];
            coded.extend(&free[2..]);
            coded
        };
        let scaled = |free: &[f64]| -> Vec<f64> {
            if free.iter().any(|c| c.abs() > 60.0) {
                return vec![f64::NAN; samples.len()];
            }
            let left = residuals(law, &law.decoded(&whole(free), force), samples, 0);
            left.into_iter().map(|l| l / force).collect()
        };
        let squares = |free: &[f64]| scaled(free).iter().map(|l| l * l).sum::<f64>();
        let mut starts: Vec<(f64, Vec<f64>)> = [0.01, 0.03, 0.08, 0.15, 0.25, 0.4]
            .iter()
            .map(|share| {
                let mut coded = law.coded(&law.start(force, share * (high - low), speed), force);
                coded.drain(2..4);
                (squares(&coded), coded)
            })
            .collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let found = starts
            .iter()
            .take(2)
            .filter_map(|(_, start)| minimise(scaled, start));
        let (free, _) = found.min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(law.decoded(&whole(&free), force))
    };
    let part = fit(&record.samples[..to])?;
    let values = fit(&record.samples)?;
    let (mut known, condition) = sure(law, record, &values)?;
    for known in &mut known[2..4] {
        known.std = f64::INFINITY;
        known.std_correlated = f64::INFINITY;
    }
    Some(Fitted {
        law,
        relative_error_percent: error(law, &values, &record.samples, 0),
        validation_error_percent: match second {
            Some(second) => error(law, &values, &second.samples, 0),
            None => error(law, &part, &record.samples, to),
        },
        values,
        known,
        condition,
        misfit_percent: 0.0,
        by_speed: None,
        two_levels: None,
    })
}
