//! A force that is not proportional to what is written for it, or that grows otherwise with speed than friction does: a straight
//! line through it says another inertia, or another friction, than the axis has.
//!
//! What inertia and friction leave is held against functions of the force that they tell, not of the measured one, whose noise is
//! in what is left as well (J. B. Ramsey's test of a regression's form, 1969).

use super::other::{TWICE, beside, differs, held_back, symmetric};
use super::{Equations, Friction, LEAST_EQUATIONS, Unknown, Variant};
use nalgebra::DVector;
use pigtail_numerics::regression::least_squares;
use pigtail_numerics::signal::rms;

/// A bend of the force, by the one that is told (over its rms) and the speed.
type Bend = fn(f64, f64) -> f64;

/// What it may be, in words that follow "as of".
const BENDS: [(&str, Bend); 4] = [
    ("a dead band of the amplifier", |f, _| f.signum()),
    ("a gain that is another one at high voltage", |f, _| {
        f * f * f
    }),
    ("a gain that is another one for each sign", |f, _| f.abs()),
    ("a drag that grows with the square of the speed", |_, v| {
        v * v.abs()
    }),
];

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

/// Where such a function tells what was held back twice as well, a parameter that it makes another one is not known, and the
/// others are less sure by what it changes.
pub(super) fn bent(
    columns: &Equations,
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
        .filter_map(|(what, of)| {
            let pairs = told.iter().zip(&columns.velocity);
            let column = pairs.map(|(f, v)| of(f / size, *v)).collect();
            let all = beside(&x, &[column]);
            let after = held_back(&all, &columns.force)?;
            Some((after, *what, least_squares(&all, &columns.force)?))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((after, what, joint)) = best.filter(|b| b.0 < TWICE * before) else {
        return;
    };
    remarks.push(format!(
        "what inertia and friction leave, {before:.2} % of the force, is {after:.2} % beside a force that is bent, as of {what}"
    ));
    for (j, names) in NAMES.iter().enumerate() {
        let off = (plain.values[j] - joint.values[j]).abs();
        if differs(&plain, &joint, &[j]) && !unknown.iter().any(|u| u.covers(names[0])) {
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
