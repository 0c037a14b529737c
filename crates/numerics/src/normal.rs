//! Normal equations of a few unknowns, and Levenberg and Marquardt's method upon them: for small problems
//! that are solved many times. Where columns may be of any size or nearly dependent, use
//! [`regression`](crate::regression); without derivatives, [`nonlinear`](crate::nonlinear).

use nalgebra::{SMatrix, SVector};

/// Normal equations of `N` unknowns, `X' W X p = X' W y`, summed up row by row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normal<const N: usize> {
    /// `X' W X`: the information on the unknowns.
    pub matrix: SMatrix<f64, N, N>,
    /// `X' W y`.
    pub right: SVector<f64, N>,
}

impl<const N: usize> Default for Normal<N> {
    fn default() -> Self {
        Self {
            matrix: SMatrix::zeros(),
            right: SVector::zeros(),
        }
    }
}

impl<const N: usize> Normal<N> {
    /// Adds an equation `row p = value`.
    pub fn add(&mut self, row: &SVector<f64, N>, value: f64) {
        self.matrix += row * row.transpose();
        self.right += row * value;
    }

    /// Adds an equation that counts `weight` times.
    pub fn add_weighted(&mut self, row: &SVector<f64, N>, value: f64, weight: f64) {
        self.matrix += weight * row * row.transpose();
        self.right += weight * value * row;
    }

    /// The unknowns, by Cholesky's decomposition; `None` where the equations do not tell them.
    ///
    /// ```
    /// use nalgebra::Vector2;
    /// use pigtail_numerics::normal::Normal;
    /// let mut line = Normal::default();
    /// for (x, y) in [(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)] {
    ///     line.add(&Vector2::new(1.0, x), y);
    /// }
    /// let p = line.solve().unwrap();
    /// assert!((p - Vector2::new(1.0, 2.0)).norm() < 1e-12);
    /// assert!(Normal::<2>::default().solve().is_none());
    /// ```
    pub fn solve(&self) -> Option<SVector<f64, N>> {
        Some(self.matrix.cholesky()?.solve(&self.right))
    }

    /// The same with so much added to the matrix's diagonal.
    pub fn solve_with_ridge(&self, ridge: f64) -> Option<SVector<f64, N>> {
        let mut matrix = self.matrix;
        for i in 0..N {
            matrix[(i, i)] += ridge;
        }
        Some(matrix.cholesky()?.solve(&self.right))
    }
}

/// When a nonlinear fit ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// Steps at the most.
    pub steps: usize,
    /// Added to the diagonal, so that an unknown on which nothing depends stays where it is.
    pub ridge: f64,
    /// It is done when the cost falls by less than this...
    pub gain: f64,
    /// ...and this share of it.
    pub share: f64,
}

/// Where a nonlinear fit ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum<S, const N: usize> {
    /// There.
    pub at: S,
    /// The cost there.
    pub cost: f64,
    /// The information on the unknowns, where the last step began.
    pub information: SMatrix<f64, N, N>,
}

/// What is to be fitted: a state of any type, changed by steps of `N` numbers of about one.
pub trait Problem<const N: usize> {
    /// The unknowns.
    type State: Copy;

    /// What is to be least; infinite where the state is none.
    fn cost(&self, at: &Self::State) -> f64;

    /// The equations of the next step: what a model leaves, and how it changes with each number.
    fn equations(&self, at: &Self::State) -> Normal<N>;

    /// The state after a step.
    fn step(&self, at: &Self::State, by: &SVector<f64, N>) -> Self::State;
}

/// Least squares by Levenberg and Marquardt's method. `None` where the equations of a step cannot be
/// solved.
pub fn minimise<const N: usize, P: Problem<N>>(
    problem: &P,
    start: P::State,
    rules: &Rules,
) -> Option<Minimum<P::State, N>> {
    let (mut at, mut cost) = (start, problem.cost(&start));
    let mut damping = 1e-3;
    let mut information = SMatrix::identity();
    for _ in 0..rules.steps {
        let normal = problem.equations(&at);
        information = normal.matrix;
        let mut damped = normal;
        for i in 0..N {
            damped.matrix[(i, i)] *= 1.0 + damping;
        }
        let next = problem.step(&at, &damped.solve_with_ridge(rules.ridge)?);
        let new = problem.cost(&next);
        if new < cost {
            let done = cost - new < rules.gain + rules.share * cost;
            (at, cost) = (next, new);
            damping = f64::max(damping * 0.1, 1e-9);
            if done {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    Some(Minimum {
        at,
        cost,
        information,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    /// `y = p0 exp(-p1 t)` through points that are exactly that.
    struct Decay(Vec<(f64, f64)>);

    impl Problem<2> for Decay {
        type State = Vector2<f64>;

        fn cost(&self, p: &Vector2<f64>) -> f64 {
            let residuals = |(t, y): &(f64, f64)| (y - p[0] * (-p[1] * t).exp()).powi(2);
            self.0.iter().map(residuals).sum()
        }

        fn equations(&self, p: &Vector2<f64>) -> Normal<2> {
            let mut normal = Normal::default();
            for (t, y) in &self.0 {
                let e = (-p[1] * t).exp();
                normal.add(&Vector2::new(e, -p[0] * t * e), y - p[0] * e);
            }
            normal
        }

        fn step(&self, at: &Vector2<f64>, by: &Vector2<f64>) -> Vector2<f64> {
            at + by
        }
    }

    #[test]
    fn a_decay_is_found_from_afar() {
        let points = (0..50).map(|k| 0.1 * f64::from(k));
        let decay = Decay(points.map(|t| (t, 2.0 * (-0.7 * t).exp())).collect());
        let rules = Rules {
            steps: 60,
            ridge: 0.0,
            gain: 0.0,
            share: 1e-9,
        };
        let found = minimise(&decay, Vector2::new(0.5, 3.0), &rules).unwrap();
        assert!(
            (found.at - Vector2::new(2.0, 0.7)).norm() < 1e-6,
            "{}",
            found.at
        );
    }

    #[test]
    fn an_equation_counts_as_often_as_its_weight_says() {
        let rows = [
            (Vector2::new(1.0, 0.3), 2.0),
            (Vector2::new(1.0, -1.0), 0.5),
        ];
        let (mut once, mut twice) = (Normal::default(), Normal::default());
        for (row, value) in rows {
            once.add_weighted(&row, value, 2.0);
            twice.add(&row, value);
            twice.add(&row, value);
        }
        assert!((once.matrix - twice.matrix).norm() < 1e-12);
        assert!((once.right - twice.right).norm() < 1e-12);
    }
}
