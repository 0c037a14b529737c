//! A contact without a law: Maxwell-slip elements of every length side by side, of whatever force each.
//!
//! Any contact that gives way by displacement alone is a sum of such (F. Al-Bender, V. Lampaert, J. Swevers, *The generalized
//! Maxwell-slip model*, IEEE Trans. Automatic Control 50, 2005). What each one's deflection does is known from the record, so
//! that their forces are linear, and none is negative.

use super::{Record, Sample};
use nalgebra::{DMatrix, DVector};

/// Number of ways after which elements slip, evenly on a logarithmic scale; the longest is half of the stroke.
const WAYS: usize = 24;

/// What keeps elements of nearly the same way apart, of columns of length one.
const RIDGE: f64 = 1e-11;

/// A gain below this share of the force is none.
const NOTHING: f64 = 1e-9;

/// Elements that were fitted to a record.
#[derive(Debug, Clone)]
pub(super) struct Elements {
    /// Forces at which all slip, forward and backward, N; an offset of the force apart.
    pub(super) sides: [f64; 2],
    /// Mean ways after which they slip, by their forces, forward and backward, m.
    pub(super) ways: [f64; 2],
    /// Ways between which as much spread would be even, m.
    pub(super) slips: [f64; 2],
    /// Stiffness while none slips, N/m, that of both directions together.
    pub(super) stiffness: f64,
    /// What they leave of the force, N.
    pub(super) left: Vec<f64>,
    /// How many have a force, and the offset.
    pub(super) used: usize,
}

/// Deflection of an element over its way. Where a stretch begins it is what the force of all is there.
fn deflections(samples: &[Sample], way: f64, largest: f64) -> Vec<f64> {
    let (mut deflection, mut last) = (0.0_f64, 0.0);
    samples
        .iter()
        .map(|s| {
            deflection = if s.begins {
                (s.force / largest).clamp(-1.0, 1.0)
            } else {
                (deflection + (s.displacement - last) / way).clamp(-1.0, 1.0)
            };
            last = s.displacement;
            deflection
        })
        .collect()
}

/// Values that leave least, none of them negative but for the last `free` ones (C. Lawson and R. Hanson, *Solving Least
/// Squares Problems*, 1974, chapter 23), of columns of length one.
fn not_negative(columns: &DMatrix<f64>, force: &DVector<f64>, free: usize) -> Option<DVector<f64>> {
    let n = columns.ncols();
    let (normal, right) = (columns.tr_mul(columns), columns.tr_mul(force));
    let bound = |j: &usize| *j < n - free;
    let mut values = DVector::zeros(n);
    let mut used: Vec<usize> = (n - free..n).collect();
    for _ in 0..10 * n {
        while !used.is_empty() {
            let among = normal.select_rows(&used).select_columns(&used)
                + DMatrix::identity(used.len(), used.len()) * RIDGE;
            let wanted = among.cholesky()?.solve(&right.select_rows(&used));
            // As far as none gets negative.
            let share = |(j, to): (&usize, &f64)| {
                (bound(j) && *to <= 0.0).then(|| values[*j] / (values[*j] - to))
            };
            let most = used.iter().zip(wanted.iter()).filter_map(share);
            let most = most.fold(1.0, f64::min);
            for (j, to) in used.iter().zip(wanted.iter()) {
                values[*j] += most * (to - values[*j]);
            }
            if most >= 1.0 {
                break;
            }
            let length = force.norm();
            let out: Vec<usize> = used
                .iter()
                .copied()
                .filter(|j| bound(j) && values[*j] <= 1e-12 * length)
                .collect();
            for j in out {
                values[j] = 0.0;
                used.retain(|other| *other != j);
            }
        }
        let slopes = &right - &normal * &values;
        let next = (0..n)
            .filter(|j| !used.contains(j))
            .max_by(|a, b| slopes[*a].total_cmp(&slopes[*b]));
        match next.filter(|j| slopes[*j] > NOTHING * force.norm()) {
            Some(j) => used.push(j),
            None => return Some(values),
        }
    }
    None
}

/// Elements that tell a record's force best, the shortest of which slips after `shortest` of the stroke: the same both ways and
/// beside an offset, or each direction for itself.
pub(super) fn elements(record: &Record, shortest: f64, two_sided: bool) -> Option<Elements> {
    let samples = &record.samples;
    let (low, high) = record.range(|s| s.displacement);
    let longest = 0.5 * (high - low);
    let largest = record.largest_force();
    let ways: Vec<f64> = (0..WAYS)
        .map(|i| longest * (2.0 * shortest).powf(i as f64 / (WAYS - 1) as f64))
        .collect();
    let each = ways.iter().map(|w| deflections(samples, *w, largest));
    let mut columns: Vec<Vec<f64>> = if two_sided {
        each.flat_map(|d| {
            [
                d.iter().map(|d| d.max(0.0)).collect(),
                d.iter().map(|d| d.min(0.0)).collect(),
            ]
        })
        .collect()
    } else {
        each.collect()
    };
    let free = usize::from(!two_sided);
    columns.extend((!two_sided).then(|| vec![1.0; samples.len()]));
    let lengths: Vec<f64> = columns
        .iter()
        .map(|c| c.iter().map(|v| v * v).sum::<f64>().sqrt())
        .collect();
    if lengths.iter().any(|l| *l <= 0.0) {
        return None;
    }
    let x = DMatrix::from_fn(samples.len(), columns.len(), |i, j| {
        columns[j][i] / lengths[j]
    });
    let force = DVector::from_iterator(samples.len(), samples.iter().map(|s| s.force));
    let values = not_negative(&x, &force, free)?;
    let forces: Vec<f64> = values.iter().zip(&lengths).map(|(v, l)| v / l).collect();
    let offset = if two_sided { 0.0 } else { forces[WAYS] };
    // Of each direction the sum over elements of their force times what `of` makes of their way.
    let sums = |of: &dyn Fn(f64) -> f64| -> [f64; 2] {
        std::array::from_fn(|side| {
            let own = |i: usize| forces[if two_sided { 2 * i + side } else { i }];
            (0..WAYS).map(|i| own(i) * of(ways[i])).sum()
        })
    };
    let levels = sums(&|_| 1.0);
    if levels.iter().any(|l| *l <= 0.0) {
        return None;
    }
    let mean = |of: [f64; 2]| 0.5 * (of[0] / levels[0] + of[1] / levels[1]);
    let middle = mean(sums(&|w| w));
    let spread = 3f64.sqrt() * (mean(sums(&|w| w * w)) - middle * middle).max(0.0).sqrt();
    let by_way = sums(&|w| w);
    let stiffness = sums(&|w| 1.0 / w);
    Some(Elements {
        sides: [levels[0] + offset, levels[1] - offset],
        ways: [by_way[0] / levels[0], by_way[1] / levels[1]],
        slips: [middle - spread, middle + spread],
        stiffness: 0.5 * (stiffness[0] + stiffness[1]),
        left: (force - x * &values).as_slice().to_vec(),
        used: values.iter().filter(|v| **v != 0.0).count(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_elements_are_found_by_their_level_way_and_stiffness() {
        let of = [(1.2, 4e-6), (0.8, 2e-5)];
        let (mut deflections, mut last) = ([0.0_f64; 2], 0.0);
        let samples: Vec<Sample> = (0..4000)
            .map(|k| {
                let t = 0.01 * f64::from(k);
                let x = 8e-5 * (1.3 * t + 0.4 * (0.5 * t).sin()).sin();
                for (d, (_, way)) in deflections.iter_mut().zip(of) {
                    *d = (*d + (x - last) / way).clamp(-1.0, 1.0);
                }
                last = x;
                Sample {
                    time: t,
                    displacement: x,
                    force: 0.1 + of[0].0 * deflections[0] + of[1].0 * deflections[1],
                    begins: k == 0,
                }
            })
            .collect();
        let record = Record {
            samples,
            has_time: true,
            ..Record::default()
        };
        let near = |is: f64, wanted: f64, share: f64| (is / wanted - 1.0).abs() < share;
        for (two_sided, forward) in [(false, 2.1), (true, 2.1)] {
            let found = elements(&record, 1.0 / 300.0, two_sided).expect("elements");
            assert!(near(found.sides[0], forward, 0.01), "{found:?}");
            assert!(near(found.sides[1], 1.9, 0.01), "{:?}", found.sides);
            assert!(near(0.5 * (found.ways[0] + found.ways[1]), 1.04e-5, 0.05));
            assert!(near(found.stiffness, 3.4e5, 0.1), "{}", found.stiffness);
        }
    }
}
