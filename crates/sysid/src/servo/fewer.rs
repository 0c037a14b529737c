//! What fewer equations say: those in which the axis slides, and half as many, from positions and voltages filtered at half the cutoff.
//!
//! Filters smear the step of friction where an axis turns or stops, and differences reach over it. What that changes grows with their length, and
//! a residual need not show it: where an axis makes short moves, its acceleration is nearly what its other columns tell together, and a smear
//! of two thousandths of the force had made Coulomb friction a tenth too small. What equations twice as far apart say otherwise is more than
//! what smears these.

use super::bent::NAMES;
use super::other::{moves, symmetric};
use super::slides::Slides;
use super::{Equations, Method, Moved, Record, Settings, Variant, check, supported};
use pigtail_numerics::regression::{least_squares, over, tolerance, without_attenuation};
use pigtail_numerics::signal::quantile;

/// Deviations by which two fits to one record differ by chance once in twenty times.
const CHANCE: f64 = 1.96;

/// Least tolerance of a column beside the others.
const OWN: f64 = 1e-4;

/// Makes parameters less sure by what fewer equations say otherwise, and tells so.
pub(super) fn fewer(
    (record, moved): (&Record, &Moved),
    set: &Settings,
    columns: &Equations,
    variants: &mut [Variant],
) -> Vec<String> {
    // A delay is told where the axis slides alone.
    let standing = match supported(variants) {
        Method::Delayed => None,
        _ => standing(columns, variants),
    };
    let coarser = coarser((record, moved), set, columns, variants);
    standing.into_iter().chain(coarser).collect()
}

/// By what equations half as many say otherwise.
fn coarser(
    (record, moved): (&Record, &Moved),
    set: &Settings,
    columns: &Equations,
    variants: &mut [Variant],
) -> Option<String> {
    let period = record.even.period;
    let half = Settings {
        cutoff: Some(0.5 * set.cutoff(period)),
        decimate: Some(2 * set.factor(period)),
        ..*set
    };
    let half_moved = Moved::of(record, &half);
    let mut others = half_moved.equations(record, &half);
    others.retain(&there(&columns.time, &others.time)?);
    let noise = [(moved, set), (&half_moved, &half)].map(|(m, s)| check::acceleration_noise(m, s));
    let [all, fewer] = [said(columns, noise[0])?, said(&others, noise[1])?];
    let any = less_sure(&all, &fewer, variants, |_| true);
    any.then(|| {
        "equations twice as far apart say otherwise than all of them: filters smear what friction does where it turns or stops, and \
         parameters are less sure by that"
            .to_owned()
    })
}

/// Parameters that were found from all equations, by what those say otherwise in which the axis slides: where it stands, friction is whatever
/// holds it. Where that is told surely and by far, they were left out before.
fn standing(columns: &Equations, variants: &mut [Variant]) -> Option<String> {
    if columns.one_way {
        return None;
    }
    let x = symmetric(columns);
    let slides = moves(columns);
    let whole = least_squares(&x, &columns.force)?;
    let moving = over(&x, &columns.force, |i| slides[i])?;
    let [whole, moving] = [whole, moving].map(|s| (s.values, s.std_correlated));
    let any = less_sure(&whole, &moving, variants, |v| v.method != Method::Delayed);
    any.then(|| {
        "equations far from where it stands or turns say otherwise than all of them: parameters are less sure by that".to_owned()
    })
}

/// Makes parameters less sure by what a fit to fewer equations says otherwise by more than chance; whether that is more than what they said.
fn less_sure(
    (all, all_std): &(Vec<f64>, Vec<f64>),
    (fewer, fewer_std): &(Vec<f64>, Vec<f64>),
    variants: &mut [Variant],
    of: impl Fn(&Variant) -> bool,
) -> bool {
    let mut any = false;
    for (j, names) in NAMES.iter().enumerate() {
        // Fewer know less of the same record: what they differ by is what they know less, squared (J. A. Hausman, 1978).
        let chance = (fewer_std[j].powi(2) - all_std[j].powi(2)).max(0.0).sqrt();
        let off = (fewer[j] - all[j]).abs();
        if off <= CHANCE * chance {
            continue;
        }
        // The error is anywhere up to that.
        let beyond = ((off.powi(2) - chance.powi(2)) / 3.0).sqrt();
        let parameters = variants.iter_mut().filter(|v| of(v));
        let parameters = parameters.flat_map(|v| &mut v.parameters);
        let known = parameters
            .filter(|p| names.contains(&p.name))
            .filter_map(|p| p.known.as_mut());
        for known in known {
            any |= beyond > known.std_correlated;
            known.std_correlated = known.std_correlated.hypot(beyond);
        }
    }
    any
}

/// Which of the coarser equations are of moments of which an equation was kept.
fn there(kept: &[f64], coarser: &[f64]) -> Option<Vec<bool>> {
    let steps: Vec<f64> = kept.windows(2).map(|w| w[1] - w[0]).collect();
    let near = 0.75 * quantile(&steps, 0.5);
    let is_near = |t: &f64| {
        let behind = kept.partition_point(|k| k < t);
        let around = [behind.checked_sub(1), Some(behind)];
        let mut around = around.into_iter().flatten().filter_map(|k| kept.get(k));
        around.any(|k| (k - t).abs() < near)
    };
    (steps.len() > 1).then(|| coarser.iter().map(is_near).collect())
}

/// Values and deviations by equations that have no turn near them, what the position's noise takes of an inertia given back.
fn said(columns: &Equations, noise: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    let Slides { x, force, .. } = Slides::of(columns, 0)?;
    let told = (0..x.ncols()).all(|j| tolerance(&x, j) > OWN);
    let mut found = told.then(|| least_squares(&x, &force))??;
    without_attenuation(&x, |_| true, 0, noise, &mut found);
    Some((found.values, found.std_correlated))
}
