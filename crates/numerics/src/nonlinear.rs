//! Nonlinear least squares with a Jacobian by differences, by Levenberg and Marquardt's method.

use crate::regression::{self, Solution};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use std::cell::RefCell;

/// Step of the differences.
const STEP: f64 = 1e-5;

struct Problem<'a, F, S> {
    residuals: &'a F,
    slopes: S,
    parameters: DVector<f64>,
    /// The least square met, and where: a search that ends where the model leaves nothing finite stands there.
    best: RefCell<Option<(f64, Vec<f64>)>>,
}

impl<F, S> LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_, F, S>
where
    F: Fn(&[f64]) -> Vec<f64>,
    S: Fn(&[f64]) -> Option<DMatrix<f64>>,
{
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, parameters: &DVector<f64>) {
        self.parameters.copy_from(parameters);
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let residuals = (self.residuals)(self.parameters.as_slice());
        if !residuals.iter().all(|l| l.is_finite()) {
            return None;
        }
        let squares: f64 = residuals.iter().map(|l| l * l).sum();
        let mut best = self.best.borrow_mut();
        if best.as_ref().is_none_or(|(least, _)| squares < *least) {
            *best = Some((squares, self.parameters.as_slice().to_vec()));
        }
        Some(DVector::from_vec(residuals))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let slopes = (self.slopes)(self.parameters.as_slice())?;
        slopes.iter().all(|s| s.is_finite()).then_some(slopes)
    }
}

fn jacobian(residuals: &impl Fn(&[f64]) -> Vec<f64>, at: &[f64]) -> DMatrix<f64> {
    let mut columns = Vec::with_capacity(at.len());
    for j in 0..at.len() {
        let shifted = |by: f64| {
            let mut moved = at.to_vec();
            moved[j] += by;
            residuals(&moved)
        };
        let (a, b) = (shifted(STEP), shifted(-STEP));
        let slopes: Vec<f64> = a
            .iter()
            .zip(&b)
            .map(|(a, b)| (a - b) / (2.0 * STEP))
            .collect();
        columns.push(DVector::from_vec(slopes));
    }
    DMatrix::from_columns(&columns)
}

/// Parameters of order one that make `residuals` (what a model leaves) least, and that least square.
///
/// `None` where the model leaves nothing finite from `start` on.
pub fn minimise(residuals: impl Fn(&[f64]) -> Vec<f64>, start: &[f64]) -> Option<(Vec<f64>, f64)> {
    minimise_by(&residuals, |at| Some(jacobian(&residuals, at)), start)
}

/// The same where the residuals' slopes are known, a column for each parameter.
pub fn minimise_by(
    residuals: impl Fn(&[f64]) -> Vec<f64>,
    slopes: impl Fn(&[f64]) -> Option<DMatrix<f64>>,
    start: &[f64],
) -> Option<(Vec<f64>, f64)> {
    let problem = Problem {
        residuals: &residuals,
        slopes,
        parameters: DVector::from_column_slice(start),
        best: RefCell::new(None),
    };
    let (problem, _) = LevenbergMarquardt::new()
        .with_ftol(1e-8)
        .with_xtol(1e-8)
        .with_patience(30)
        .minimize(problem);
    let (least, parameters) = problem.best.into_inner()?;
    least.is_finite().then_some((parameters, least))
}

/// How sure parameters at a minimum are: the linear problem there, of a record of time whose residual may be alike over `coherent` rows
/// ([`regression::least_squares_of_time`]). Its values are the step that is left, which is nearly nothing.
pub fn uncertainty(
    residuals: impl Fn(&[f64]) -> Vec<f64>,
    at: &[f64],
    coherent: usize,
) -> Option<Solution> {
    regression::least_squares_of_time(&jacobian(&residuals, at), &residuals(at), coherent)
}

/// The same of points that are measured one by one ([`regression::least_squares_of_points`]).
pub fn uncertainty_of_points(
    residuals: impl Fn(&[f64]) -> Vec<f64>,
    at: &[f64],
) -> Option<Solution> {
    regression::least_squares_of_points(&jacobian(&residuals, at), &residuals(at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exponential_is_found_with_its_uncertainty() {
        let data: Vec<(f64, f64)> = (0..200)
            .map(|k| {
                let t = 0.05 * f64::from(k);
                (
                    t,
                    2.0 * (-0.7 * t).exp() + 1e-3 * f64::from(k * 37 % 11 - 5),
                )
            })
            .collect();
        let residuals = |p: &[f64]| -> Vec<f64> {
            data.iter()
                .map(|(t, y)| y - p[0] * (-p[1].exp() * t).exp())
                .collect()
        };
        let (p, _) = minimise(residuals, &[1.0, 0.0]).unwrap();
        assert!(
            (p[0] - 2.0).abs() < 5e-3 && (p[1].exp() - 0.7).abs() < 5e-3,
            "{p:?}"
        );
        let sure = uncertainty(residuals, &p, 1).unwrap();
        assert!(sure.std[0] > 1e-4 && sure.std[0] < 5e-3, "{:?}", sure.std);
        assert!(sure.values.iter().all(|step| step.abs() < 1e-5));
    }
}
