//! What a parameter is known to where what a model leaves of a record goes with its neighbours: sums over batches of them.

use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// A batch of neighbours: where it lies, and by how much each of them counts.
struct Batch {
    rows: std::ops::Range<usize>,
    weights: Vec<f64>,
}

/// Batches of neighbours: long enough that what is left of one knows little of the next one's, and enough of them.
///
/// Each overlaps its neighbours by half and counts by a sine, so that the squares of what a row counts by come to one. A
/// batch that begins at once counts what enters there, which in the sum over all leaves again: of a noise that has next
/// to nothing slow in it, as a position's that was differentiated, that would be nearly all that it counts.
fn batches(residuals: &[f64], shortest: usize) -> Vec<Batch> {
    let n = residuals.len();
    // Where what is left has forgotten what it was.
    let reach = (n / (FEWEST * FORGOTTEN)).clamp(1, 400);
    let mut together = crate::signal::autocorrelations(residuals, reach);
    let lag = together.position(|r| r < 0.1).unwrap_or(reach);
    let longest = (n / FEWEST).max(1);
    let length = shortest.max(FORGOTTEN * lag).min(longest);
    let half = length.div_ceil(2);
    let sine: Vec<f64> = (0..2 * half)
        .map(|i| (PI * (i as f64 + 0.5) / (2.0 * half as f64)).sin())
        .collect();
    (0..=n.div_ceil(half))
        .map(|k| {
            // The first and the last one reach over the ends.
            let (from, to) = ((k * half).saturating_sub(half), ((k + 1) * half).min(n));
            Batch {
                rows: from..to,
                weights: sine[from + half - k * half..to + half - k * half].to_vec(),
            }
        })
        .filter(|b| !b.rows.is_empty())
        .collect()
}

/// Fewest batches without their overlap, and by how many times what is left has to have forgotten itself within one.
const FEWEST: usize = 8;
const FORGOTTEN: usize = 10;

/// What is left, as white noise and a share of one that forgets itself by a factor from row to row.
struct Memory {
    share: f64,
    factor: f64,
}

impl Memory {
    /// That of `residuals`, where batches of `longest` are too short to have forgotten it; by how it falls to a half of what it has at
    /// the next row.
    fn longer_than(residuals: &[f64], longest: usize) -> Option<Self> {
        let power: f64 = residuals.iter().map(|r| r * r).sum();
        let at = |lag: usize| -> f64 {
            let pairs = residuals.iter().zip(&residuals[lag..]);
            pairs.map(|(a, b)| a * b).sum::<f64>() / power
        };
        let first = at(1);
        if residuals.len() < 16 || first.is_nan() || first < 0.1 {
            return None;
        }
        // Between lags that are twice as long each time, as it falls between them.
        let (mut lag, mut before) = (1, first);
        let half = loop {
            let (next, here) = (2 * lag, at((2 * lag).min(residuals.len() - 1)));
            if next > longest {
                break longest as f64;
            }
            if here < 0.5 * first {
                let part = (before / (0.5 * first)).ln() / (before / here.max(1e-3 * first)).ln();
                break lag as f64 * (1.0 + part);
            }
            (lag, before) = (next, here);
        };
        let factor = 0.5_f64.powf(1.0 / half);
        let forgotten = 0.1_f64.ln() / factor.ln();
        (FORGOTTEN as f64 * forgotten > longest as f64).then(|| Self {
            share: (first / factor).min(1.0),
            factor,
        })
    }

    /// The variance of a sum of this noise by these weights, where that of each row is one.
    fn variance(&self, weights: impl Iterator<Item = f64>) -> f64 {
        let (mut carried, mut slow, mut white) = (0.0, 0.0, 0.0);
        for w in weights {
            slow += w * (w + 2.0 * self.factor * carried);
            carried = self.factor * carried + w;
            white += w * w;
        }
        self.share * slow + (1.0 - self.share) * white
    }

    /// What rows have to do with each other times these weights, where the variance of each row is one.
    fn spread(&self, weights: impl Iterator<Item = f64>) -> Vec<f64> {
        let weights: Vec<f64> = weights.collect();
        let mut spread: Vec<f64> = weights
            .iter()
            .map(|w| (1.0 - 2.0 * self.share) * w)
            .collect();
        let mut carry = |k: usize, carried: &mut f64| {
            *carried = self.factor * *carried + weights[k];
            spread[k] += self.share * *carried;
        };
        let (mut before, mut after) = (0.0, 0.0);
        (0..weights.len()).for_each(|k| carry(k, &mut before));
        (0..weights.len()).rev().for_each(|k| carry(k, &mut after));
        spread
    }
}

/// What a fit does to sums over batches of a noise that remembers.
struct Slow<'a> {
    memory: Memory,
    x: &'a DMatrix<f64>,
    z: &'a DMatrix<f64>,
    bread: &'a DMatrix<f64>,
    /// What each instrument has to do with the rows, and with the other instruments.
    spread: DMatrix<f64>,
    moment: DMatrix<f64>,
}

/// A sum over a batch: by what it counts its own rows, by what the fit takes of it the instruments, and what either has to do with
/// those.
struct Sum {
    rows: std::ops::Range<usize>,
    counted: DVector<f64>,
    taken: DVector<f64>,
    of_taken: DVector<f64>,
    beside: DVector<f64>,
}

impl<'a> Slow<'a> {
    fn new(
        memory: Memory,
        (x, z): (&'a DMatrix<f64>, &'a DMatrix<f64>),
        bread: &'a DMatrix<f64>,
    ) -> Self {
        let columns: Vec<DVector<f64>> = z
            .column_iter()
            .map(|c| DVector::from_vec(memory.spread(c.iter().copied())))
            .collect();
        let spread = DMatrix::from_columns(&columns);
        Self {
            moment: z.tr_mul(&spread),
            memory,
            x,
            z,
            bread,
            spread,
        }
    }

    /// By how much the deviation of a parameter from batches is to be wider, and its degrees of freedom: what the noise makes of the
    /// parameter, over what it makes of the batches' sums once the fit has taken its own. `counts` is what each batch's sum counts the
    /// instruments by.
    fn lost(&self, parameter: usize, batches: &[Batch], counts: &[DVector<f64>]) -> (f64, f64) {
        let (n, _) = self.z.shape();
        let own = |m: &'a DMatrix<f64>, b: &Batch| m.rows(b.rows.start, b.rows.len());
        let sums: Vec<Sum> = batches
            .iter()
            .zip(counts)
            .map(|(batch, by)| {
                let mut counted = own(self.z, batch) * by;
                for (c, weight) in counted.iter_mut().zip(&batch.weights) {
                    *c *= weight;
                }
                let taken = self.bread.tr_mul(&own(self.x, batch).tr_mul(&counted));
                Sum {
                    rows: batch.rows.clone(),
                    of_taken: &self.moment * &taken,
                    beside: self
                        .spread
                        .rows(batch.rows.start, batch.rows.len())
                        .tr_mul(&counted),
                    taken,
                    counted,
                }
            })
            .collect();
        let (mut trace, mut squares) = (0.0, 0.0);
        for (k, one) in sums.iter().enumerate() {
            let mut all = vec![0.0; n];
            all[one.rows.clone()].copy_from_slice(one.counted.as_slice());
            let spread = self.memory.spread(all.into_iter());
            for (l, other) in sums.iter().enumerate().skip(k) {
                let together = other.rows.clone().zip(other.counted.iter());
                let common = together.map(|(i, c)| c * spread[i]).sum::<f64>()
                    - one.taken.dot(&other.beside)
                    - other.taken.dot(&one.beside)
                    + one.of_taken.dot(&other.taken);
                trace += if l == k { common } else { 0.0 };
                squares += common * common * if l == k { 1.0 } else { 2.0 };
            }
        }
        let reach = self.z * self.bread.row(parameter).transpose();
        let whole = self.memory.variance(reach.iter().copied());
        ((whole / trace).sqrt().max(1.0), trace * trace / squares)
    }
}

/// What a batch tells of the parameters.
struct Part {
    /// Its sum of `z e`, what the fit has taken given back.
    score: DVector<f64>,
    /// Its moments by its weights, by their squares, and by the products of them and those of the next one.
    taken: DMatrix<f64>,
    squared: DMatrix<f64>,
    beside: DMatrix<f64>,
    given: DMatrix<f64>,
}

/// A deviation by the squares of sums over batches.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Scatter {
    std: f64,
    /// How many degrees of freedom the squares have.
    freedom: f64,
}

impl Scatter {
    /// Of columns that depend on each other: what they say of each is open.
    const OPEN: Self = Self {
        std: f64::INFINITY,
        freedom: 1.0,
    };

    /// Wider by Student's quantile over the normal one, so that 1.96 of it hold what 95 % are.
    pub(crate) fn widened(&self) -> f64 {
        student(self.freedom) * self.std
    }
}

/// Standard deviations of the parameters from the sums of `z e` over batches of neighbours: correlation within a batch is
/// in them, whatever its shape.
///
/// What the fit has taken of a batch's own is given back: of white noise the corrected sum has on average the square
/// that it would have without a fit (the estimator known as CR2). How many degrees of freedom the sum of squares has is
/// Satterthwaite's number, again of white noise: fewer where a parameter rests on few of the batches. Of noise that batches are too
/// short for, both are those of a noise that forgets itself as what is left does: of what is slow a fit takes far more. R. Bell and D. `McCaffrey`,
/// *Bias Reduction in Standard Errors for Linear Regression with Multi-Stage Samples*, Survey Methodology 28, 2002.
pub(crate) fn clustered(
    x: &DMatrix<f64>,
    z: &DMatrix<f64>,
    residuals: &[f64],
    bread: &DMatrix<f64>,
    (shortest, corrected): (usize, bool),
) -> Vec<Scatter> {
    let p = x.ncols();
    // Instruments of unit moment among themselves, so that all matrices are of numbers of order one.
    let own = z.tr_mul(z);
    let scale = DMatrix::from_diagonal(&own.diagonal().map(|v| 1.0 / v.max(1e-300).sqrt()));
    let Some(root) = (&scale * own * &scale).cholesky().map(|c| c.l()) else {
        return vec![Scatter::OPEN; p];
    };
    let back = bread * DMatrix::from_diagonal(&scale.diagonal().map(|s| 1.0 / s)) * &root;
    let Some(turn) = root.try_inverse().map(|inverse| inverse * &scale) else {
        return vec![Scatter::OPEN; p];
    };
    let batches = batches(residuals, shortest);
    let longest = (residuals.len() / FEWEST).max(1);
    let slow = Memory::longer_than(residuals, longest)
        .filter(|_| corrected)
        .map(|memory| Slow::new(memory, (x, z), bread));
    let parts: Vec<Part> = batches
        .iter()
        .enumerate()
        .map(|(k, batch)| {
            let part = z.rows(batch.rows.start, batch.rows.len());
            let pairs = batch.weights.iter().zip(&residuals[batch.rows.clone()]);
            let counted = DVector::from_iterator(batch.rows.len(), pairs.map(|(w, r)| w * r));
            let [taken, squared, beside] =
                moments(z, batch, batches.get(k + 1)).map(|m| &turn * m * turn.transpose());
            let given = given_back(&taken, &squared);
            Part {
                score: &given * (&turn * part.tr_mul(&counted)),
                taken,
                squared,
                beside,
                given,
            }
        })
        .collect();
    (0..p)
        .map(|j| {
            let of = back.row(j).transpose();
            let square: f64 = parts.iter().map(|b| of.dot(&b.score).powi(2)).sum();
            let reach: Vec<DVector<f64>> = parts.iter().map(|b| b.given.tr_mul(&of)).collect();
            // What the fit makes all pairs of batches have in common, squared, is the square of one matrix; only neighbours have more.
            let taken: Vec<DVector<f64>> = parts
                .iter()
                .zip(&reach)
                .map(|(b, r)| &b.taken * r)
                .collect();
            let mut moment = DMatrix::zeros(p, p);
            for taken in &taken {
                moment.ger(1.0, taken, taken, 1.0);
            }
            let (mut trace, mut squares) = (0.0, moment.norm_squared());
            for (k, part) in parts.iter().enumerate() {
                let fit = taken[k].norm_squared();
                let own = reach[k].dot(&(&part.squared * &reach[k])) - fit;
                trace += own;
                squares += own * own - fit * fit;
                if let Some(next) = reach.get(k + 1) {
                    let fit = taken[k].dot(&taken[k + 1]);
                    let own = reach[k].dot(&(&part.beside * next)) - fit;
                    squares += 2.0 * (own * own - fit * fit);
                }
            }
            let freedom = if squares > 0.0 {
                trace * trace / squares
            } else {
                1.0
            };
            let (lost, freedom) = slow.as_ref().map_or((1.0, freedom), |slow| {
                let counts: Vec<DVector<f64>> = reach.iter().map(|r| turn.tr_mul(r)).collect();
                slow.lost(j, &batches, &counts)
            });
            Scatter {
                std: lost * square.max(0.0).sqrt(),
                freedom,
            }
        })
        .collect()
}

/// A batch's moments by its weights, by their squares, and by the products of them and those of the next one: in one pass over its rows,
/// for of a long record this is most of what deviations cost.
fn moments(z: &DMatrix<f64>, batch: &Batch, next: Option<&Batch>) -> [DMatrix<f64>; 3] {
    let (n, p) = z.shape();
    let columns: Vec<&[f64]> = z.as_slice().chunks_exact(n).collect();
    let mut sums = vec![[0.0; 3]; p * p];
    for (i, weight) in batch.rows.clone().zip(&batch.weights) {
        let other = next
            .and_then(|next| next.weights.get(i.checked_sub(next.rows.start)?))
            .unwrap_or(&0.0);
        let by = [*weight, weight * weight, weight * other];
        for j in 0..p {
            let own = by.map(|w| w * columns[j][i]);
            for k in 0..=j {
                let value = columns[k][i];
                for (sum, own) in sums[j * p + k].iter_mut().zip(own) {
                    *sum += own * value;
                }
            }
        }
    }
    std::array::from_fn(|of| DMatrix::from_fn(p, p, |j, k| sums[j.max(k) * p + j.min(k)][of]))
}

/// What turns a batch's sum with a fit's residuals into one that has on average the square of one without a fit:
/// `A (S - T T) A' = S` of the batch's moments `T` and `S`, by its weights and by their squares.
fn given_back(taken: &DMatrix<f64>, squared: &DMatrix<f64>) -> DMatrix<f64> {
    let p = taken.nrows();
    let eigen = squared.clone().symmetric_eigen();
    let most = eigen.eigenvalues.max().max(0.0);
    let root = |power: f64| {
        let powers = eigen
            .eigenvalues
            .map(|l| l.max(1e-12 * most).max(1e-300).powf(power));
        &eigen.eigenvectors * DMatrix::from_diagonal(&powers) * eigen.eigenvectors.transpose()
    };
    // In units of what the batch has: columns that it does not move are left as they are.
    let (half, inverse) = (root(0.5), root(-0.5));
    let share = &inverse * taken * taken * &inverse;
    let left = DMatrix::identity(p, p) - share;
    let eigen = left.symmetric_eigen();
    let given = eigen.eigenvalues.map(|l| 1.0 / l.clamp(0.05, 1.0).sqrt());
    let middle =
        &eigen.eigenvectors * DMatrix::from_diagonal(&given) * eigen.eigenvectors.transpose();
    half * middle * inverse
}

/// By how much a standard deviation from so few degrees of freedom is to be wider, so that 1.96 of it hold what 95 % are:
/// Student's quantile over the normal one (Cornish and Fisher).
fn student(freedom: f64) -> f64 {
    const Z: f64 = 1.96;
    let freedom = freedom.max(2.0);
    let quantile = Z
        + (Z.powi(3) + Z) / (4.0 * freedom)
        + (5.0 * Z.powi(5) + 16.0 * Z.powi(3) + 3.0 * Z) / (96.0 * freedom * freedom);
    quantile / Z
}
