//! What samples that agree with each other say otherwise than all of them.
//!
//! Readings that were lost, turned or of another channel for a while pull a law all one way, and no batch of the record scatters by that: a
//! fit that counts less what stands apart (Huber's weights) says another level. It is one step from the law that was found, along its own
//! derivatives.

use super::fit::{counted, settled};
use super::{Fitted, Record};
use pigtail_numerics::regression::{least_squares_alone, matrix, robust_alone};

/// Deviations beyond which what such a fit says is not chance: of 100 that are chance one is.
const ASIDE: f64 = 2.576;

/// Step of a coded parameter, which is of order one, by which derivatives are told.
const STEP: f64 = 1e-4;

/// Makes laws less sure by what samples that agree say otherwise.
pub(super) fn allow(laws: &mut [Fitted], record: &Record) {
    for fitted in laws {
        let Some(off) = off(fitted, record) else {
            continue;
        };
        for (known, off) in fitted.known.iter_mut().zip(off) {
            if off > ASIDE * known.std_correlated {
                known.std_correlated = off;
            }
        }
    }
}

fn off(fitted: &Fitted, record: &Record) -> Option<Vec<f64>> {
    let law = fitted.law;
    let force = record.largest_force();
    let coded = law.coded(&fitted.values, force);
    let counts = settled(law, &fitted.values, &record.samples);
    let left = |coded: &[f64]| counted(law, &law.decoded(coded, force), &record.samples, &counts);
    let moved = |j: usize, by: f64| {
        let mut moved = coded.clone();
        moved[j] += by;
        moved
    };
    let columns: Vec<Vec<f64>> = (0..coded.len())
        .map(|j| {
            let (behind, ahead) = (left(&moved(j, -STEP)), left(&moved(j, STEP)));
            let pairs = behind.iter().zip(&ahead);
            pairs.map(|(b, a)| (b - a) / (2.0 * STEP)).collect()
        })
        .collect();
    let slices: Vec<&[f64]> = columns.iter().map(|c| &c[..]).collect();
    let x = matrix(&slices);
    let y = left(&coded);
    let (all, agreeing) = (least_squares_alone(&x, &y)?, robust_alone(&x, &y)?);
    let step = |values: &[f64]| {
        let there: Vec<f64> = coded.iter().zip(values).map(|(c, v)| c + v).collect();
        law.decoded(&there, force)
    };
    let pairs = step(&all.values).into_iter().zip(step(&agreeing.values));
    Some(pairs.map(|(a, b)| (a - b).abs()).collect())
}
