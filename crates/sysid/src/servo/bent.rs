//! A force that is not proportional to what is written for it, or that grows otherwise with speed than friction does: a straight
//! line through it says another inertia, or another friction, than the axis has.
//!
//! What inertia and friction leave is held against functions of the force that they tell, not of the measured one, whose noise is
//! in what is left as well (J. B. Ramsey's test of a regression's form, 1969).

use super::other::{OTHER, TWICE, beside, differs, held_back, symmetric};
use super::{Equations, Friction, LEAST_EQUATIONS, Unknown, Variant};
use nalgebra::DVector;
use pigtail_numerics::regression::least_squares;
use pigtail_numerics::signal::rms;

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
    /// share. Of the axis that was measured no gain comes below 0.99 as it was recorded, and one that is compressed by 5 % at its
    /// peaks to 0.95: chosen when that was seen. A drag of a few hundredths every axis has. Of an axis of which more is left than that (per cent of
    /// the force), another law of friction is a part of it, to which any bend comes near: chosen when such an axis was refused for it.
    fn limits(self, left: f64) -> (f64, f64) {
        /// Of the measured axis 4 % are left.
        const WELL_TOLD: f64 = 6.0;
        match self {
            Self::Gain if left < WELL_TOLD => (0.97, 0.02),
            _ => (TWICE, OTHER),
        }
    }
}

/// Names of the symmetric law's parameters, each with those of the asymmetric one.
const NAMES: [&[&str]; 3] = [
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
    let best = BENDS
        .iter()
        .filter_map(|(what, bend, of)| {
            let pairs = told.iter().zip(&columns.velocity);
            let column = pairs.map(|(f, v)| bend(f / size, *v)).collect();
            let all = beside(&x, &[column]);
            let after = held_back(&all, &columns.force)?;
            let (shows, other) = of.limits(before);
            let joint = least_squares(&all, &columns.force)?;
            (after < shows * before).then_some((after, (*what, *of), other, joint))
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
        for variant in variants.iter_mut() {
            let own = match variant.friction {
                Friction::Symmetric => &names[..1],
                Friction::Asymmetric => *names,
            };
            for parameter in &mut variant.parameters {
                if let Some(known) = parameter
                    .known
                    .as_mut()
                    .filter(|_| own.contains(&parameter.name))
                {
                    known.std_correlated = known.std_correlated.hypot(off);
                }
            }
        }
    }
}
