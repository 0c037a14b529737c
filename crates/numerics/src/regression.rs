//! Linear least squares with what is known of its uncertainty.

use crate::batches::{Scatter, clustered};
use crate::signal::rms;
use nalgebra::{DMatrix, DVector};

/// A linear model `y = X p + e` solved for `p`.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The parameters.
    pub values: Vec<f64>,
    /// Their standard deviations if what is left is white: `sigma^2 (X' X)^-1`, with `sigma^2` from
    /// what is left and the degrees of freedom.
    pub std: Vec<f64>,
    /// The same with the correlation of what is left from sample to sample taken into account (sums over
    /// batches of neighbours): what one may expect from one record to the next. 1.96 of it hold the truth in
    /// 95 % of records.
    pub std_correlated: Vec<f64>,
    /// Largest over smallest singular value of `X`.
    pub condition: f64,
    /// Norm of what is left over the norm of `y`, per cent.
    pub relative_error_percent: f64,
    /// `y - X p`.
    pub residuals: Vec<f64>,
}

/// Columns side by side.
pub fn matrix(columns: &[&[f64]]) -> DMatrix<f64> {
    let rows = columns.first().map_or(0, |c| c.len());
    DMatrix::from_fn(rows, columns.len(), |i, j| columns[j][i])
}

/// Ordinary least squares. `None` where the columns are too few rows, or are no independent columns.
pub fn least_squares(x: &DMatrix<f64>, y: &[f64]) -> Option<Solution> {
    solve(x, x, y, Some((usual(y.len()), false)))
}

/// The same without [`Solution::std_correlated`], which is empty: most of the work, where many problems are solved and only the last
/// one is asked how sure it is.
pub fn least_squares_alone(x: &DMatrix<f64>, y: &[f64]) -> Option<Solution> {
    solve(x, x, y, None)
}

/// The same of rows that are measured one by one, as the points of a frequency response are: what is left of one may
/// go with that of its neighbours, but with nothing further off than it shows.
pub fn least_squares_of_points(x: &DMatrix<f64>, y: &[f64]) -> Option<Solution> {
    solve(x, x, y, Some((1, false)))
}

/// The same of a record of time whose residual may be alike over `coherent` rows without showing it, or may remember longer than an
/// eighth of the record: what is told of its parameters.
///
/// Where batches are too short to have forgotten what enters them, sums of neighbours go together, and their squares miss that: what a
/// noise of the same memory makes of all rows and of the batches is asked, and the deviation is as much wider.
pub fn least_squares_of_time(x: &DMatrix<f64>, y: &[f64], coherent: usize) -> Option<Solution> {
    let batch = usual(y.len()).max(coherent);
    solve(x, x, y, Some((batch, true)))
}

/// Length of the batches of a record of time, by which what is left may be slow without showing it.
fn usual(rows: usize) -> usize {
    ((2.0 * (rows as f64).sqrt()) as usize).clamp(1, 400)
}

/// Least squares with a weight for each row: the error and what is left are those without weights.
pub fn weighted(x: &DMatrix<f64>, y: &[f64], weights: &[f64]) -> Option<Solution> {
    by_weights(x, y, weights, Some((usual(y.len()), false)))
}

fn by_weights(
    x: &DMatrix<f64>,
    y: &[f64],
    weights: &[f64],
    batch: Option<(usize, bool)>,
) -> Option<Solution> {
    let root: Vec<f64> = weights.iter().map(|w| w.sqrt()).collect();
    let scaled = DMatrix::from_fn(x.nrows(), x.ncols(), |i, j| root[i] * x[(i, j)]);
    let target: Vec<f64> = y.iter().zip(&root).map(|(y, w)| y * w).collect();
    let mut solution = solve(&scaled, &scaled, &target, batch)?;
    judge(x, y, &mut solution);
    Some(solution)
}

/// Instrumental variables: `p = (Z' X)^-1 Z' y`. What is not correlated with the instruments `z`, such
/// as the noise of a measured position, does not bias it.
pub fn instrumental(x: &DMatrix<f64>, z: &DMatrix<f64>, y: &[f64]) -> Option<Solution> {
    solve(x, z, y, Some((usual(y.len()), false)))
}

/// The same without [`Solution::std_correlated`], which is empty.
pub fn instrumental_alone(x: &DMatrix<f64>, z: &DMatrix<f64>, y: &[f64]) -> Option<Solution> {
    solve(x, z, y, None)
}

/// Least squares by Huber's weights: what lies further out than 1.345 times the spread counts less, so
/// that a few samples that the model says nothing about (such as those at a reversal) do not decide.
pub fn robust(x: &DMatrix<f64>, y: &[f64]) -> Option<Solution> {
    weighted(x, y, &huber(x, y)?)
}

/// The same without [`Solution::std_correlated`], which is empty.
pub fn robust_alone(x: &DMatrix<f64>, y: &[f64]) -> Option<Solution> {
    by_weights(x, y, &huber(x, y)?, None)
}

/// Huber's weights, by what their own solution leaves.
fn huber(x: &DMatrix<f64>, y: &[f64]) -> Option<Vec<f64>> {
    const ROUNDS: usize = 20;
    let mut solution = least_squares_alone(x, y)?;
    let mut last = vec![1.0; y.len()];
    for _ in 0..ROUNDS {
        let sizes: Vec<f64> = solution.residuals.iter().map(|l| l.abs()).collect();
        // 1.4826 times the median is the standard deviation of a normal distribution.
        let edge = 1.345 * 1.4826 * crate::signal::quantile(&sizes, 0.5);
        if edge <= 0.0 {
            break;
        }
        let weights: Vec<f64> = sizes.iter().map(|s| edge / s.max(edge)).collect();
        // A round only has to come near: it is solved by its moments where they tell it.
        let next = by_moments(x, y, &weights).or_else(|| by_weights(x, y, &weights, None))?;
        let moved = next
            .values
            .iter()
            .zip(&solution.values)
            .zip(&next.std)
            .map(|((a, b), s)| (a - b).abs() / s.max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max);
        solution = next;
        last = weights;
        if moved < 1e-3 {
            break;
        }
    }
    Some(last)
}

/// Values, their deviations by white noise, and what is left, from the sums of products of weighted columns: one pass over the rows, which
/// loses twice as many digits to columns that are nearly alike. `None` where those would be many.
fn by_moments(x: &DMatrix<f64>, y: &[f64], weights: &[f64]) -> Option<Solution> {
    /// Least pivot of columns of a length of one.
    const PIVOT: f64 = 1e-5;
    let (n, p) = x.shape();
    if n <= p || p == 0 {
        return None;
    }
    let columns: Vec<&[f64]> = x.as_slice().chunks_exact(n).collect();
    let mut moment = DMatrix::zeros(p, p);
    let mut right = DVector::zeros(p);
    for (i, (weight, y)) in weights.iter().zip(y).enumerate() {
        for j in 0..p {
            let own = weight * columns[j][i];
            right[j] += own * y;
            for k in 0..=j {
                moment[(j, k)] += own * columns[k][i];
            }
        }
    }
    let scale = moment.diagonal().map(f64::sqrt);
    if scale.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return None;
    }
    let unit = DMatrix::from_fn(p, p, |j, k| {
        moment[(j.max(k), j.min(k))] / (scale[j] * scale[k])
    });
    let triangle = unit.cholesky()?;
    if triangle.l_dirty().diagonal().min() < PIVOT {
        return None;
    }
    let values = triangle
        .solve(&right.component_div(&scale))
        .component_div(&scale);
    let mut solution = Solution {
        values: values.iter().copied().collect(),
        std: Vec::new(),
        std_correlated: Vec::new(),
        condition: f64::NAN,
        relative_error_percent: 0.0,
        residuals: Vec::new(),
    };
    judge(x, y, &mut solution);
    let squares = solution.residuals.iter().zip(weights);
    let variance = squares.map(|(l, w)| w * l * l).sum::<f64>() / (n - p) as f64;
    let inverse = triangle.inverse();
    solution.std = (0..p)
        .map(|j| (variance * inverse[(j, j)]).sqrt() / scale[j])
        .collect();
    Some(solution)
}

/// `batch` is the least length of the batches by which correlation is told, and whether batches too short for it are corrected; without
/// one it is not told.
fn solve(
    x: &DMatrix<f64>,
    z: &DMatrix<f64>,
    y: &[f64],
    batch: Option<(usize, bool)>,
) -> Option<Solution> {
    let (n, p) = x.shape();
    if n <= p || p == 0 {
        return None;
    }
    // Columns of a length of one: parameters may be of any size.
    let scale = DVector::from_fn(p, |j, _| x.column(j).norm());
    if scale.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return None;
    }
    let target = DVector::from_column_slice(y);
    let ztx = z.tr_mul(x);
    let zty = z.tr_mul(&target);
    // The same of the instruments.
    let own = DVector::from_fn(p, |j, _| z.column(j).norm());
    let unit = DMatrix::from_fn(p, p, |i, j| ztx[(i, j)] / (own[i] * scale[j]));
    let qr = DMatrix::from_fn(n, p, |i, j| x[(i, j)] / scale[j]).qr();
    let triangle = qr.r();
    let values = if std::ptr::eq(x, z) {
        let mut right = target.clone();
        qr.q_tr_mul(&mut right);
        triangle.solve_upper_triangular(&right.rows(0, p))?
    } else {
        unit.clone().lu().solve(&zty.component_div(&own))?
    };
    let values = values.component_div(&scale);
    let singular = (triangle * DMatrix::from_diagonal(&scale)).singular_values();
    let condition = singular.max() / singular.min();
    if values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let mut solution = Solution {
        values: values.iter().copied().collect(),
        std: Vec::new(),
        std_correlated: Vec::new(),
        condition,
        relative_error_percent: 0.0,
        residuals: Vec::new(),
    };
    judge(x, y, &mut solution);
    let freedom = (n - p) as f64;
    let variance = solution.residuals.iter().map(|l| l * l).sum::<f64>() / freedom;
    let inverse = unit.try_inverse()?;
    let bread = DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] / (scale[i] * own[j]));
    let covariance = &bread * (z.tr_mul(z) * variance) * bread.transpose();
    // Of columns that depend on each other rounding may make it anything: then nothing is known, rather than all.
    let open = |v: f64| v < 0.0 || v == 0.0 && variance > 0.0;
    let deviation = |v: f64| if open(v) { f64::INFINITY } else { v.sqrt() };
    solution.std = (0..p).map(|j| deviation(covariance[(j, j)])).collect();
    if let Some(batch) = batch {
        let scatter = clustered(x, z, &solution.residuals, &bread, batch);
        solution.std_correlated = scatter.iter().map(Scatter::widened).collect();
    }
    Some(solution)
}

/// What columns leave of `y`, for a search over the shape of one column more: to solve the whole problem, with how sure it is,
/// for each shape costs many times as much.
#[derive(Debug, Clone)]
pub struct Rest {
    basis: DMatrix<f64>,
    left: DVector<f64>,
}

impl Rest {
    /// What the columns of `x` leave of `y`. `None` where they are too few rows, or are no independent columns.
    pub fn new(x: &DMatrix<f64>, y: &[f64]) -> Option<Self> {
        let (n, p) = x.shape();
        let scale = DVector::from_fn(p, |j, _| x.column(j).norm());
        if n <= p || scale.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
            return None;
        }
        let qr = DMatrix::from_fn(n, p, |i, j| x[(i, j)] / scale[j]).qr();
        let own = qr.r().diagonal().map(f64::abs);
        if own.min() < 1e-12 {
            return None;
        }
        let basis = qr.q();
        let target = DVector::from_column_slice(y);
        let left = &target - &basis * basis.tr_mul(&target);
        Some(Self { basis, left })
    }

    /// The sum of squares of what is left with this column too.
    pub fn squares(&self, column: &[f64]) -> f64 {
        let column = DVector::from_column_slice(column);
        let own = &column - &self.basis * self.basis.tr_mul(&column);
        if own.norm() <= 1e-12 * column.norm() {
            return self.left.norm_squared();
        }
        let value = own.dot(&self.left) / own.norm_squared();
        (&self.left - own * value).norm_squared()
    }
}

/// Takes out of a solution over the rows that are kept by how much noise of a column, independent of all else, made it
/// too small: `(X' X - n s^2 E)^-1 X' y`, with the noise's standard deviation `s` and a one in `E` where the column is.
///
/// Nothing is done where the noise is as much as all that the column has of its own.
pub fn without_attenuation(
    x: &DMatrix<f64>,
    keep: impl Fn(usize) -> bool,
    column: usize,
    noise: f64,
    solution: &mut Solution,
) {
    let rows: Vec<usize> = (0..x.nrows()).filter(|i| keep(*i)).collect();
    let part = x.select_rows(&rows);
    let Some(bread) = (part.transpose() * &part).try_inverse() else {
        return;
    };
    let power = rows.len() as f64 * noise * noise;
    let share = power * bread[(column, column)];
    if share < 0.5 {
        let by = power * solution.values[column] / (1.0 - share);
        for (j, value) in solution.values.iter_mut().enumerate() {
            *value += by * bread[(j, column)];
        }
    }
}

/// Ordinary least squares over some of the rows; the error and what is left are those of all.
pub fn over(x: &DMatrix<f64>, y: &[f64], keep: impl Fn(usize) -> bool) -> Option<Solution> {
    let rows: Vec<usize> = (0..x.nrows()).filter(|i| keep(*i)).collect();
    let part: Vec<f64> = rows.iter().map(|i| y[*i]).collect();
    let mut solution = least_squares(&x.select_rows(&rows), &part)?;
    judge(x, y, &mut solution);
    Some(solution)
}

/// The same without [`Solution::std_correlated`], which is empty.
pub fn over_alone(x: &DMatrix<f64>, y: &[f64], keep: impl Fn(usize) -> bool) -> Option<Solution> {
    let rows: Vec<usize> = (0..x.nrows()).filter(|i| keep(*i)).collect();
    let part: Vec<f64> = rows.iter().map(|i| y[*i]).collect();
    let mut solution = least_squares_alone(&x.select_rows(&rows), &part)?;
    judge(x, y, &mut solution);
    Some(solution)
}

/// [`over`] with instruments ([`instrumental`]).
pub fn instrumental_over(
    x: &DMatrix<f64>,
    z: &DMatrix<f64>,
    y: &[f64],
    keep: impl Fn(usize) -> bool,
) -> Option<Solution> {
    let rows: Vec<usize> = (0..x.nrows()).filter(|i| keep(*i)).collect();
    let part: Vec<f64> = rows.iter().map(|i| y[*i]).collect();
    let mut solution = instrumental(&x.select_rows(&rows), &z.select_rows(&rows), &part)?;
    judge(x, y, &mut solution);
    Some(solution)
}

fn judge(x: &DMatrix<f64>, y: &[f64], solution: &mut Solution) {
    let prediction = x * DVector::from_column_slice(&solution.values);
    solution.residuals = y
        .iter()
        .zip(prediction.iter())
        .map(|(y, t)| y - t)
        .collect();
    solution.relative_error_percent = relative(&solution.residuals, y);
}

/// Norm of what is left over the norm of what was measured, per cent.
pub fn relative(residuals: &[f64], measured: &[f64]) -> f64 {
    100.0 * rms(residuals.iter().copied()) / rms(measured.iter().copied()).max(f64::MIN_POSITIVE)
}

/// How much of a column no other column tells: `1 - R^2` of its regression on the others, 1 for one
/// that stands alone, 0 for one that they make up.
pub fn tolerance(x: &DMatrix<f64>, column: usize) -> f64 {
    let own: Vec<f64> = x.column(column).iter().copied().collect();
    let others = x.clone().remove_column(column);
    let power = rms(own.iter().copied());
    if power <= 0.0 {
        return 0.0;
    }
    if others.ncols() == 0 {
        return 1.0;
    }
    // A pseudo-inverse: the others may themselves depend on each other.
    let scale = DVector::from_fn(others.ncols(), |j, _| others.column(j).norm().max(1e-300));
    let scaled = DMatrix::from_fn(others.nrows(), others.ncols(), |i, j| {
        others[(i, j)] / scale[j]
    });
    let normal = scaled.transpose() * &scaled;
    let right = scaled.transpose() * DVector::from_column_slice(&own);
    let Ok(solved) = normal.svd(true, true).solve(&right, 1e-12) else {
        return 0.0;
    };
    let prediction = scaled * solved;
    let residuals = rms(own.iter().zip(prediction.iter()).map(|(a, b)| a - b));
    (residuals / power).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_with_one_column_more_is_that_of_the_whole_problem() {
        let of = |by: usize| -> Vec<f64> {
            let number = |k: usize| (k * by % 101) as f64 / 50.0 - 1.0;
            (0..80).map(number).collect()
        };
        let (a, b, more, y) = (of(37), of(53), of(71), of(29));
        let rest = Rest::new(&matrix(&[&a, &b]), &y).unwrap();
        let whole = least_squares(&matrix(&[&a, &b, &more]), &y).unwrap();
        let squares: f64 = whole.residuals.iter().map(|l| l * l).sum();
        assert!((rest.squares(&more) / squares - 1.0).abs() < 1e-12);
        assert!(Rest::new(&matrix(&[&a, &a]), &y).is_none());
    }
    use rand::{RngExt, SeedableRng};

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        (0..n).map(|_| normal()).collect()
    }

    #[test]
    fn deviations_are_what_repeated_records_scatter_by() {
        let n = 400;
        let a = noise(n, 1);
        let one = vec![1.0; n];
        let x = matrix(&[&a, &one]);
        let (mut squares, mut prediction) = (0.0, 0.0);
        for seed in 0..200 {
            let e = noise(n, 100 + seed);
            let y: Vec<f64> = a
                .iter()
                .zip(&e)
                .map(|(a, e)| 2.0 * a - 1.0 + 0.3 * e)
                .collect();
            let solution = least_squares(&x, &y).unwrap();
            squares += (solution.values[0] - 2.0).powi(2) / 200.0;
            prediction += solution.std[0] / 200.0;
        }
        assert!(
            (squares.sqrt() / prediction - 1.0).abs() < 0.15,
            "{} {prediction}",
            squares.sqrt()
        );
    }

    /// Of what remembers for a tenth of a record, batches of an eighth miss nearly half.
    #[test]
    fn deviations_of_what_remembers_long_are_what_repeated_records_scatter_by() {
        let (n, records) = (2000, 120);
        let x = matrix(&[&vec![1.0; n]]);
        let (mut squares, mut told) = (0.0, 0.0);
        for seed in 0..records {
            let mut slow = 0.0;
            let y: Vec<f64> = noise(n + 1000, 300 + seed)
                .into_iter()
                .map(|e| {
                    slow = 0.995 * slow + e;
                    slow
                })
                .skip(1000)
                .collect();
            let solution = least_squares_of_time(&x, &y, 1).unwrap();
            squares += solution.values[0].powi(2) / records as f64;
            told += solution.std_correlated[0].powi(2) / records as f64;
        }
        let ratio = (told / squares).sqrt();
        assert!((0.8..1.4).contains(&ratio), "{ratio}");
    }

    #[test]
    fn of_columns_that_depend_on_each_other_nothing_is_known() {
        let a: Vec<f64> = (0..200).map(|k| (0.3 * f64::from(k)).sin()).collect();
        let b: Vec<f64> = (0..200)
            .map(|k| (0.3 * f64::from(k)).sin() + 1e-11 * f64::from(k % 7))
            .collect();
        let y: Vec<f64> = (0..200)
            .map(|k| a[k as usize] + 0.01 * f64::from(k * 37 % 11 - 5))
            .collect();
        let found = least_squares(&matrix(&[&a, &b]), &y).expect("columns that differ by a little");
        for (std, correlated) in found.std.iter().zip(&found.std_correlated) {
            assert!(*std > 1e3 && *correlated > 1e3, "{found:?}");
        }
    }

    #[test]
    fn deviations_go_with_the_unit_of_a_column() {
        let n = 400;
        let (a, b, e) = (noise(n, 11), noise(n, 12), noise(n, 13));
        let y: Vec<f64> = (0..n).map(|k| 2.0 * a[k] - b[k] + e[k]).collect();
        let of = |size: f64| {
            let scaled: Vec<f64> = b.iter().map(|b| size * b).collect();
            least_squares(&matrix(&[&a, &scaled, &vec![1.0; n]]), &y).unwrap()
        };
        let (usual, large) = (of(1.0), of(1e18));
        for (a, b) in [
            (usual.std[1], 1e18 * large.std[1]),
            (usual.std_correlated[1], 1e18 * large.std_correlated[1]),
            (usual.std_correlated[0], large.std_correlated[0]),
        ] {
            assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        }
    }

    #[test]
    fn instruments_undo_the_bias_of_a_noisy_column() {
        let n = 4000;
        let (true_a, e, d) = (noise(n, 2), noise(n, 3), noise(n, 4));
        let seen: Vec<f64> = true_a.iter().zip(&d).map(|(a, d)| a + 0.5 * d).collect();
        let y: Vec<f64> = true_a
            .iter()
            .zip(&e)
            .map(|(a, e)| 3.0 * a + 0.1 * e)
            .collect();
        let x = matrix(&[&seen]);
        let biased = least_squares(&x, &y).unwrap().values[0];
        let right = instrumental(&x, &matrix(&[&true_a]), &y).unwrap().values[0];
        assert!(
            biased < 2.6 && (right - 3.0).abs() < 0.1,
            "{biased} {right}"
        );
    }

    #[test]
    fn outliers_decide_nothing() {
        let a = noise(500, 5);
        let mut y: Vec<f64> = a
            .iter()
            .zip(noise(500, 6))
            .map(|(a, e)| a + 0.1 * e)
            .collect();
        for k in (0..500).step_by(25) {
            y[k] += 40.0 * a[k].abs();
        }
        let value = robust(&matrix(&[&a]), &y).unwrap().values[0];
        assert!((value - 1.0).abs() < 0.03, "{value}");
    }

    #[test]
    fn a_column_that_others_make_up_has_no_tolerance() {
        let (a, b) = (noise(100, 7), noise(100, 8));
        let sum: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - 2.0 * b).collect();
        let x = matrix(&[&a, &b, &sum]);
        assert!(tolerance(&x, 2) < 1e-20);
        assert!(least_squares(&matrix(&[&a, &a]), &b).is_none_or(|s| s.condition > 1e12));
        assert!(tolerance(&matrix(&[&a, &b]), 0) > 0.9);
    }
}
