//! A force that is not proportional to what is written for it, or that grows otherwise with speed than friction does: a straight
//! line through it says another inertia, or another friction, than the axis has.
//!
//! What inertia and friction leave is held against functions of the force that they tell, not of the measured one, whose noise is
//! in what is left as well (J. B. Ramsey's test of a regression's form, 1969).

use super::other::{OTHER, SURELY, TWICE, beside, differs, held_back, symmetric};
use super::{Equations, Friction, LEAST_EQUATIONS, Unknown, Variant};
use nalgebra::{DMatrix, DVector};
use pigtail_numerics::regression::least_squares;
use pigtail_numerics::signal::{quantile, rms};

/// A bend of the force, by the one that is told (over its rms) and the speed.
type Bend = fn(f64, f64) -> f64;

/// What it may be, in words that follow "as of": of the voltage's gain, or of the friction.
const BENDS: [(&str, Bend, Of); 4] = [
    ("a dead band of the amplifier", |f, _| f.signum(), Of::Gain),
    (
        "a gain that is another one at high voltage",
        |f, _| f * f * f,
        Of::Gain,
    ),
    (
        "a gain that is another one for each sign",
        |f, _| f.abs(),
        Of::Gain,
    ),
    (
        "a drag that grows with the square of the speed",
        |_, v| v * v.abs(),
        Of::Friction,
    ),
];

/// What is bent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Of {
    Gain,
    Friction,
}

impl Of {
    /// It shows where less than this share of what was held back is left, and a parameter is another one where it changes by this
    /// share. A drag of a few hundredths every axis has.
    fn limits(self) -> (f64, f64) {
        match self {
            Self::Gain => (0.97, 0.02),
            Self::Friction => (TWICE, OTHER),
        }
    }
}

/// Whether a record supports that its gain is bent: whatever friction does at any speed and on its way from a turn, a delay, and what a
/// filter or a compliance takes of what is fast tell it no better. Asked for are as many deviations, by the residual's own correlation, as of any
/// parameter that is another one.
///
/// Chosen by the measured axis, the axis and the sled of the samples, and these with their voltages compressed: 1.3 to 4.7 deviations as
/// they are, 7.5 to 9.8 where voltages are compressed to 0.95 at their peaks, 8 and more where they are to 0.9.
fn supported(x: &DMatrix<f64>, columns: &Equations, told: &[f64], bend: &[f64]) -> bool {
    let mut more = beside_a_bend(columns, told);
    more.push(bend.to_vec());
    let Some(all) = least_squares(&beside(x, &more), &columns.force) else {
        return false;
    };
    let last = all.values.last().zip(all.std_correlated.last());
    last.is_some_and(|(value, std)| value.abs() > SURELY * std)
}

/// Columns by which friction, a delay and a filter or a compliance tell what a bend seems to.
fn beside_a_bend(columns: &Equations, told: &[f64]) -> Vec<Vec<f64>> {
    /// Speeds over which friction falls, as shares of the highest one, and ways from a turn, as shares of the stroke.
    const SPEEDS: [f64; 3] = [0.02, 0.05, 0.15];
    const WAYS: [f64; 3] = [0.001, 0.01, 0.05];
    let velocity = &columns.velocity;
    let speeds: Vec<f64> = velocity.iter().map(|v| v.abs()).collect();
    let most = quantile(&speeds, 1.0);
    let falls = |size: f64, over: &[f64]| -> Vec<f64> {
        let pairs = velocity.iter().zip(over);
        pairs.map(|(v, o)| v.signum() * (-o / size).exp()).collect()
    };
    let mut more: Vec<Vec<f64>> = SPEEDS.iter().map(|s| falls(s * most, &speeds)).collect();
    let place = &columns.position;
    let mut ways = vec![0.0; place.len()];
    for k in 1..ways.len() {
        if velocity[k].signum() == velocity[k - 1].signum() {
            ways[k] = ways[k - 1] + (place[k] - place[k - 1]).abs();
        }
    }
    let stroke = quantile(place, 1.0) - quantile(place, 0.0);
    more.extend(WAYS.iter().map(|s| falls(s * stroke, &ways)));
    more.push(velocity.iter().map(|v| v * v.abs()).collect());
    // One direction's friction is not the other's.
    more.push(speeds);
    more.push(columns.sign.iter().map(|s| s.abs()).collect());
    for column in [told, &columns.acceleration] {
        let rate = differences(column);
        more.push(differences(&rate));
        more.push(rate);
    }
    more
}

/// Differences about each value; at the ends to one side.
fn differences(values: &[f64]) -> Vec<f64> {
    let last = values.len() - 1;
    (0..=last)
        .map(|k| {
            let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
            (values[to] - values[from]) / (to - from).max(1) as f64
        })
        .collect()
}

/// Names of the symmetric law's parameters, each with those of the asymmetric one.
pub(super) const NAMES: [&[&str]; 3] = [
    &["inertia"],
    &[
        "viscous_friction",
        "viscous_friction_forward",
        "viscous_friction_backward",
    ],
    &[
        "coulomb_friction",
        "coulomb_friction_forward",
        "coulomb_friction_backward",
    ],
];

/// Where such a function tells what was held back better, a parameter that it makes another one is not known, and the
/// others are less sure by what it changes. `cut` is whether equations of a voltage that was cut off were left out.
pub(super) fn bent(
    columns: &Equations,
    cut: bool,
    variants: &mut [Variant],
    unknown: &mut Vec<Unknown>,
    remarks: &mut Vec<String>,
) {
    if columns.one_way || columns.force.len() < LEAST_EQUATIONS {
        return;
    }
    let x = symmetric(columns);
    let Some((plain, before)) =
        least_squares(&x, &columns.force).zip(held_back(&x, &columns.force))
    else {
        return;
    };
    let told = &x * DVector::from_column_slice(&plain.values);
    let size = rms(told.iter().copied());
    // A voltage that was cut off is not what was given, and where it is highest it is no longer seen.
    let best = BENDS
        .iter()
        .filter_map(|(what, bend, of)| {
            let pairs = told.iter().zip(&columns.velocity);
            let column: Vec<f64> = pairs.map(|(f, v)| bend(f / size, *v)).collect();
            let all = beside(&x, std::slice::from_ref(&column));
            let after = held_back(&all, &columns.force)?;
            let (shows, other) = of.limits();
            let shown = after < shows * before
                && (*of == Of::Friction || cut || supported(&x, columns, told.as_slice(), &column));
            let joint = shown.then(|| least_squares(&all, &columns.force))??;
            Some((after, (*what, *of), other, joint))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((after, (what, of), other, joint)) = best else {
        return;
    };
    remarks.push(format!(
        "what inertia and friction leave, {before:.2} % of the force, is {after:.2} % beside a force that is bent, as of {what}: \
         parameters are less sure by what that changes"
    ));
    for (j, names) in NAMES.iter().enumerate() {
        let off = (plain.values[j] - joint.values[j]).abs();
        // What is bent below the level where it was cut off is bent everywhere.
        let bent = cut && of == Of::Gain;
        let another = bent || differs(&plain, &joint, &[j], other);
        if another && !unknown.iter().any(|u| u.covers(names[0])) {
            unknown.push(Unknown {
                parameters: names.to_vec(),
                because: format!(
                    "the force is not proportional to the voltage or the friction, as of {what}: with that it would be {:.4e} \
                     instead of {:.4e}",
                    joint.values[j], plain.values[j]
                ),
            });
        }
        less_sure(variants, names, off);
    }
}

/// Parameters of these names, of which the first is that of symmetric friction, may be so far off.
pub(super) fn less_sure(variants: &mut [Variant], names: &[&str], off: f64) {
    for variant in variants {
        let own = match variant.friction {
            Friction::Symmetric => &names[..1],
            Friction::Asymmetric => names,
        };
        let all = variant.parameters.iter_mut();
        for parameter in all.filter(|p| own.contains(&p.name)) {
            if let Some(known) = &mut parameter.known {
                known.std_correlated = known.std_correlated.hypot(off);
            }
        }
    }
}
