//! What of a response is linear, and how what is left changes with what is searched.
//!
//! For frequencies, dampings, delay and real poles `c` the columns `X(c)` have best factors `v`, and `r = y - X v` is left. With `N = X'X`
//! and `D` the columns' slopes by one of `c` those of what is left are (G. Golub and V. Pereyra, 1973)
//!
//! ```text
//! dr/dc = -(D v - X N^-1 (X' D v - D' r))
//! ```
//!
//! A mode changes its own columns alone, so that all slopes together cost about as much as what is left itself does; differences would take it
//! twice for each number that is searched.

use super::record::{Filter, Record};
use nalgebra::{Cholesky, Complex, DMatrix, DVector, Dyn};
use pigtail_numerics::nonlinear::minimise_by;
use pigtail_numerics::regression::{Solution, least_squares_of_points, relative};
use std::cell::RefCell;
use std::f64::consts::{SQRT_2, TAU};

/// What is searched, ready for one frequency after the other: exponentials once for all of them.
struct Terms<'a> {
    record: &'a Record,
    /// Frequency, rad/s, and damping of each mode.
    own: Vec<(f64, f64)>,
    /// Real poles, rad/s.
    poles: Vec<f64>,
    /// Delay, s.
    tau: f64,
    /// Share of creep before the modes, and its pole, rad/s.
    creep: Option<(f64, f64)>,
    /// How many times the highest frequency lies above the filter's corner.
    above: f64,
    /// The highest frequency, rad/s.
    top: f64,
}

/// A column's place, and how it changes with one of what is searched.
type Slope = (usize, Complex<f64>);

impl<'a> Terms<'a> {
    fn of(record: &'a Record, coded: &[f64]) -> Self {
        let modes = record.modes(coded);
        let top = TAU * record.highest();
        let pair = |k: usize| (coded[2 * k].exp(), coded[2 * k + 1].exp());
        let poles = &coded[2 * modes + 1..][..record.poles];
        Self {
            record,
            own: (0..modes).map(pair).collect(),
            poles: poles.iter().map(|p| p.exp()).collect(),
            tau: coded[2 * modes] / top,
            creep: record.creep(coded),
            above: coded[coded.len() - 1],
            top,
        }
    }

    /// Columns of each mode.
    fn each(&self) -> usize {
        if self.record.skewed { 2 } else { 1 }
    }

    /// What all columns have alike at a point: its weight, the delay, creep before the modes, the filter, a velocity's frequency.
    fn turn(&self, i: usize) -> Complex<f64> {
        let w = TAU * self.record.frequency[i];
        let mut turn = Complex::from_polar(self.record.weight[i], -w * self.tau);
        if let Some((share, pole)) = self.creep {
            turn *= 1.0 + share / Complex::new(1.0, w / pole);
        }
        let over = self.above * w / self.top;
        match self.record.filter {
            Filter::None => {}
            Filter::Pole => turn /= Complex::new(1.0, over),
            Filter::Two => turn /= Complex::new(1.0 - over * over, SQRT_2 * over),
        }
        if self.record.rate {
            turn *= Complex::new(0.0, w / self.top);
        }
        turn
    }

    /// The slopes of its logarithm by the delay, creep and the filter, as far as there are such.
    fn turning(&self, i: usize) -> impl Iterator<Item = Complex<f64>> {
        let w = TAU * self.record.frequency[i];
        let share = w / self.top;
        let creep = self.creep.map(|(share, pole)| {
            let below = Complex::new(1.0, w / pole);
            let all = 1.0 + share / below;
            let by_pole = share * Complex::new(0.0, w / pole) / (below * below);
            [below.inv() / all, by_pole / all]
        });
        let over = self.above * share;
        let filter = match self.record.filter {
            Filter::None => None,
            Filter::Pole => Some(Complex::new(0.0, -share) / Complex::new(1.0, over)),
            Filter::Two => {
                let below = Complex::new(1.0 - over * over, SQRT_2 * over);
                Some(-share * Complex::new(-2.0 * over, SQRT_2) / below)
            }
        };
        let delay = Complex::new(0.0, -share);
        std::iter::once(delay)
            .chain(creep.into_iter().flatten())
            .chain(filter)
    }

    /// A mode's columns at a frequency, rad/s, but for what all have alike.
    fn mode(&self, (own, zeta): (f64, f64), w: f64) -> impl Iterator<Item = Complex<f64>> {
        let below = Complex::new(own * own - w * w, 2.0 * zeta * own * w);
        let skewed = || Complex::new(0.0, own * w) / below;
        std::iter::once(own * own / below).chain(self.record.skewed.then(skewed))
    }

    /// All columns at a point, one after the other.
    fn columns(&self, i: usize, mut set: impl FnMut(usize, Complex<f64>)) {
        let w = TAU * self.record.frequency[i];
        let turn = self.turn(i);
        let modes = self.own.iter().flat_map(|own| self.mode(*own, w));
        let s = w / self.top;
        let beside = [
            Complex::new(1.0, 0.0),
            Complex::new(0.0, -1.0 / s),
            Complex::new(-1.0 / (s * s), 0.0),
        ];
        let poles = self.poles.iter().map(|p| Complex::new(1.0, w / p).inv());
        for (j, value) in modes.chain(beside).chain(poles).enumerate() {
            set(j, turn * value);
        }
    }

    /// What changes with modes and poles at a point: for each of them its columns' slopes, in the order in which they are searched, the delay
    /// left out.
    fn slopes(&self, i: usize, mut set: impl FnMut(usize, &[Slope])) {
        let w = TAU * self.record.frequency[i];
        let turn = self.turn(i);
        let (each, modes) = (self.each(), self.own.len());
        for (k, own) in self.own.iter().enumerate() {
            for (which, slopes) in mode_slopes(*own, w).iter().enumerate() {
                let [plain, skewed] = slopes.map(|s| turn * s);
                let both = [(each * k, plain), (each * k + 1, skewed)];
                set(2 * k + which, &both[..each]);
            }
        }
        for (m, pole) in self.poles.iter().enumerate() {
            let over = Complex::new(0.0, w / pole);
            let slope = over / ((1.0 + over) * (1.0 + over));
            let column = each * modes + 3 + m;
            set(2 * modes + 1 + m, &[(column, turn * slope)]);
        }
    }
}

/// The slopes of a mode's columns, but for what all have alike, by the logarithms of its frequency and of its damping.
fn mode_slopes((own, zeta): (f64, f64), w: f64) -> [[Complex<f64>; 2]; 2] {
    let below = Complex::new(own * own - w * w, 2.0 * zeta * own * w);
    let (damped, square) = (Complex::new(0.0, 2.0 * zeta * own * w), below * below);
    let risen = damped + 2.0 * own * own;
    let (plain, skewed) = (own * own, Complex::new(0.0, own * w));
    [
        [
            2.0 * plain / below - plain * risen / square,
            skewed / below - skewed * risen / square,
        ],
        [-plain * damped / square, -skewed * damped / square],
    ]
}

/// The best factors of some columns, and what they leave.
struct Solved {
    x: DMatrix<f64>,
    /// Normal equations of columns of length one.
    normal: Cholesky<f64, Dyn>,
    /// The columns' lengths.
    scale: DVector<f64>,
    values: DVector<f64>,
    left: DVector<f64>,
}

impl Solved {
    fn of(x: DMatrix<f64>, target: Vec<f64>) -> Option<Self> {
        let y = DVector::from_vec(target);
        let p = x.ncols();
        let mut normal = DMatrix::zeros(p, p);
        for i in 0..p {
            for j in 0..=i {
                normal[(i, j)] = x.column(i).dot(&x.column(j));
            }
        }
        let scale = DVector::from_fn(p, |j, _| normal[(j, j)].sqrt().max(1e-300));
        for i in 0..p {
            for j in 0..=i {
                normal[(i, j)] /= scale[i] * scale[j];
                normal[(j, i)] = normal[(i, j)];
            }
            normal[(i, i)] += 1e-12;
        }
        let normal = normal.cholesky()?;
        let values = best(&normal, &scale, &x.tr_mul(&y));
        let left = &y - &x * &values;
        Some(Self {
            x,
            normal,
            scale,
            values,
            left,
        })
    }
}

/// Factors of columns by what goes with each of them.
fn best(normal: &Cholesky<f64, Dyn>, scale: &DVector<f64>, right: &DVector<f64>) -> DVector<f64> {
    let right = right.component_div(scale);
    normal.solve(&right).component_div(scale)
}

impl Record {
    /// The columns of what is linear: real parts of all points, then imaginary ones.
    pub(super) fn columns(&self, coded: &[f64]) -> DMatrix<f64> {
        let n = self.frequency.len();
        let mut x = DMatrix::zeros(2 * n, self.linear_parts(coded));
        let terms = Terms::of(self, coded);
        let all = x.as_mut_slice();
        for i in 0..n {
            terms.columns(i, |j, value| {
                let value = self.leaning(i, value);
                all[2 * n * j + i] = value.re;
                all[2 * n * j + n + i] = value.im;
            });
        }
        x
    }

    /// What belongs to a point, turned to its response and weighed by what is along it and across.
    fn leaning(&self, i: usize, value: Complex<f64>) -> Complex<f64> {
        let Some([along, across]) = self.lean else {
            return value;
        };
        let turned = value * Complex::from_polar(1.0, -self.response[i].arg());
        Complex::new(along * turned.re, across * turned.im)
    }

    /// What goes with a value before it leans as some residual does with it after that.
    fn leant_back(&self, i: usize, left: Complex<f64>) -> Complex<f64> {
        let Some([along, across]) = self.lean else {
            return left;
        };
        Complex::new(along * left.re, across * left.im)
            * Complex::from_polar(1.0, self.response[i].arg())
    }

    pub(super) fn target(&self) -> Vec<f64> {
        let weighted = || {
            let all = self.response.iter().zip(&self.weight).enumerate();
            all.map(|(i, (h, w))| self.leaning(i, h * *w))
        };
        weighted()
            .map(|h| h.re)
            .chain(weighted().map(|h| h.im))
            .collect()
    }

    /// `None` where what is searched is not within numbers any more, or columns depend on each other.
    fn solved(&self, coded: &[f64]) -> Option<Solved> {
        let sound = coded.iter().all(|c| c.abs() < 60.0);
        sound.then(|| Solved::of(self.columns(coded), self.target()))?
    }

    /// What is left with the best linear part; NaN where there is none.
    pub(super) fn residuals(&self, coded: &[f64]) -> Vec<f64> {
        self.linear(coded)
            .map_or_else(|| self.nothing(), |(_, left)| left)
    }

    /// What is left where nothing is told.
    fn nothing(&self) -> Vec<f64> {
        vec![f64::NAN; 2 * self.frequency.len()]
    }

    /// The best linear part, and what is left with it.
    pub(super) fn linear(&self, coded: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
        let solved = self.solved(coded)?;
        Some((
            solved.values.as_slice().to_vec(),
            solved.left.as_slice().to_vec(),
        ))
    }

    /// How what is left with the best linear part, solved there, changes with what is searched.
    fn slopes(&self, coded: &[f64], solved: &Solved) -> DMatrix<f64> {
        let n = self.frequency.len();
        let terms = Terms::of(self, coded);
        let (v, p) = (&solved.values, solved.values.len());
        // D v of each number that is searched, and D' r.
        let mut moved = DMatrix::zeros(2 * n, coded.len());
        let mut against = DMatrix::zeros(p, coded.len());
        let all = moved.as_mut_slice();
        let mut put = |i: usize, k: usize, value: Complex<f64>| {
            let value = self.leaning(i, value);
            all[2 * n * k + i] = value.re;
            all[2 * n * k + n + i] = value.im;
        };
        // The delay stands behind the modes, what else all columns have alike at the end.
        let delay = 2 * terms.own.len();
        let last = coded.len() - self.factors();
        let mut row = vec![Complex::default(); p];
        for i in 0..n {
            let left = Complex::new(solved.left[i], solved.left[n + i]);
            let back = self.leant_back(i, left).conj();
            terms.columns(i, |j, value| row[j] = value);
            let told: Complex<f64> = row.iter().zip(v.iter()).map(|(x, v)| x * *v).sum();
            let places = std::iter::once(delay).chain(last..);
            for (k, turning) in places.zip(terms.turning(i)) {
                put(i, k, turning * told);
                let goes = turning * back;
                for (j, x) in row.iter().enumerate() {
                    against[(j, k)] += (x * goes).re;
                }
            }
            terms.slopes(i, |k, slopes| {
                put(i, k, slopes.iter().map(|(j, d)| d * v[*j]).sum());
                for (j, d) in slopes {
                    against[(*j, k)] += (d * back).re;
                }
            });
        }
        let mut back = solved.x.tr_mul(&moved) - against;
        for mut column in back.column_iter_mut() {
            let solved = best(&solved.normal, &solved.scale, &column.clone_owned());
            column.copy_from(&solved);
        }
        &solved.x * back - moved
    }

    /// The same where it is not solved yet.
    pub(super) fn slopes_at(&self, coded: &[f64]) -> Option<DMatrix<f64>> {
        Some(self.slopes(coded, &self.solved(coded)?))
    }

    /// What is searched where least is left, from `start`, and that, squared.
    pub(super) fn settle(&self, start: &[f64]) -> Option<(Vec<f64>, f64)> {
        // Slopes are asked for where what is left was.
        let last: RefCell<Option<(Vec<f64>, Solved)>> = RefCell::new(None);
        let residuals = |coded: &[f64]| {
            let Some(solved) = self.solved(coded) else {
                return self.nothing();
            };
            let left = solved.left.as_slice().to_vec();
            last.replace(Some((coded.to_vec(), solved)));
            left
        };
        let slopes = |coded: &[f64]| match &*last.borrow() {
            Some((at, solved)) if at == coded => Some(self.slopes(coded, solved)),
            _ => self.slopes_at(coded),
        };
        minimise_by(residuals, slopes, start)
    }

    /// How sure is what is searched, where least is left ([`least_squares_of_points`]).
    pub(super) fn known(&self, coded: &[f64]) -> Option<Solution> {
        let solved = self.solved(coded)?;
        least_squares_of_points(&self.slopes(coded, &solved), solved.left.as_slice())
    }

    /// What is left, squared, with one more mode of a frequency and a damping, whose logarithms are asked with; the others stay.
    ///
    /// Of its columns only what no other has makes less of what the others leave.
    pub(super) fn with_a_mode(&self, coded: &[f64]) -> impl Fn([f64; 2]) -> f64 {
        /// Squared, what a column has of its own is no more than rounding.
        const NOTHING: f64 = 1e-13;
        let n = self.frequency.len();
        let others = self.columns(coded).qr().q();
        let beside = move |z: DVector<f64>| &z - &others * others.tr_mul(&z);
        let left = beside(DVector::from_vec(self.target()));
        let terms = Terms::of(self, coded);
        let turns: Vec<Complex<f64>> = (0..n).map(|i| terms.turn(i)).collect();
        move |pair| {
            let mut columns = vec![DVector::zeros(2 * n); terms.each()];
            for (i, turn) in turns.iter().enumerate() {
                let w = TAU * self.frequency[i];
                let values = terms.mode((pair[0].exp(), pair[1].exp()), w);
                for (column, value) in columns.iter_mut().zip(values) {
                    let value = self.leaning(i, turn * value);
                    column[i] = value.re;
                    column[n + i] = value.im;
                }
            }
            let mut squares = left.norm_squared();
            let mut first: Option<DVector<f64>> = None;
            for column in columns {
                let all = column.norm_squared();
                let mut own = beside(column);
                if let Some(first) = &first {
                    own -= first * first.dot(&own);
                }
                let length = own.norm_squared();
                if length > NOTHING * all {
                    squares -= left.dot(&own).powi(2) / length;
                    first = Some(own / length.sqrt());
                }
            }
            squares
        }
    }

    /// Relative error of a linear part found elsewhere.
    pub(super) fn error(&self, coded: &[f64], values: &[f64]) -> f64 {
        let prediction = self.columns(coded) * DVector::from_column_slice(values);
        let target = self.target();
        let residuals: Vec<f64> = target
            .iter()
            .zip(prediction.iter())
            .map(|(a, b)| a - b)
            .collect();
        relative(&residuals, &target)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_another_mode_leaves_is_told_without_solving_for_all() {
        let frequency: Vec<f64> = (0..60).map(|k| 20.0 + 3.0 * f64::from(k)).collect();
        let response: Vec<Complex<f64>> = frequency
            .iter()
            .map(|f| Complex::from_polar(1.0 + f / 100.0, (f / 7.0).sin()))
            .collect();
        for skewed in [false, true] {
            let record = Record {
                skewed,
                ..Record::new(&frequency, &response, None).unwrap()
            };
            let coded = [(TAU * 75.0).ln(), -2.5, 0.4];
            let with = record.with_a_mode(&coded);
            for pair in [[(TAU * 110.0).ln(), -4.0], [(TAU * 74.0).ln(), -1.0]] {
                let all = [&coded[..2], &pair, &coded[2..]].concat();
                let left: f64 = record.residuals(&all).iter().map(|l| l * l).sum();
                assert!((with(pair) / left - 1.0).abs() < 1e-6, "{pair:?}");
            }
        }
    }

    #[test]
    fn slopes_are_those_of_small_differences() {
        let frequency: Vec<f64> = (0..60).map(|k| 20.0 + 3.0 * f64::from(k)).collect();
        let response: Vec<Complex<f64>> = frequency
            .iter()
            .map(|f| {
                let below = Complex::new(80.0_f64.powi(2) - f * f, 0.1 * 80.0 * f);
                Complex::from_polar(1.0, -f / 300.0) * (0.3 + 80.0_f64.powi(2) / below)
            })
            .collect();
        let plain = Record::new(&frequency, &response, None).unwrap();
        let modes = [(TAU * 75.0).ln(), -2.5, (TAU * 130.0).ln(), -3.0, 0.4];
        let (pole, creep) = ((TAU * 33.0).ln(), [0.2, (TAU * 9.0).ln()]);
        for skewed in [false, true] {
            for filter in [Filter::None, Filter::Pole, Filter::Two] {
                for (lean, creeping, rate) in [
                    (None, false, true),
                    (Some([1.0, 0.02]), true, false),
                    (Some([0.3, 1.0]), false, false),
                ] {
                    let record = Record {
                        skewed,
                        filter,
                        lean,
                        creeping,
                        rate,
                        poles: 1,
                        ..plain.clone()
                    };
                    let mut coded = [&modes[..], &[pole]].concat();
                    coded.extend(creep.iter().filter(|_| creeping));
                    coded.extend([0.6].iter().filter(|_| filter != Filter::None));
                    let slopes = record.slopes_at(&coded).unwrap();
                    for k in 0..coded.len() {
                        let at = |by: f64| {
                            let mut moved = coded.clone();
                            moved[k] += by;
                            DVector::from_vec(record.residuals(&moved))
                        };
                        let differences = (at(1e-5) - at(-1e-5)) / 2e-5;
                        let off = (differences - slopes.column(k)).norm();
                        assert!(
                            off < 1e-5 * slopes.column(k).norm().max(1e-3),
                            "{k} of {record:?}: {off}"
                        );
                    }
                }
            }
        }
    }
}
