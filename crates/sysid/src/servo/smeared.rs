//! A friction that does not step where the axis turns: position and voltage went through one filter before they were written, or friction
//! follows the motion on its way.
//!
//! What is linear a filter leaves as it is where both channels went through it: inertia and viscous friction are those of the axis. A step
//! it smears, and it takes the force of the motion's sign for one of its speed. A sign that is averaged over some equations to either side
//! stands for it, as wide as tells the record best.

use super::bent::NAMES;
use super::other::{OTHER, SURELY};
use super::slides::ASIDE;
use super::{Equations, Friction, LATE, LEAST_EQUATIONS, Method, SLOW, Unknown, Variant};
use pigtail_numerics::regression::{Solution, least_squares, least_squares_alone};
use pigtail_numerics::signal::{quantile, rms};

/// Lengths, equations: halves of a triangle over which a sign is averaged, and the time over which a single pole forgets it.
const TRIANGLES: [usize; 7] = [2, 3, 4, 6, 8, 12, 16];
const POLES: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// Lengths of a pole after which nothing of a step is left.
const FORGOTTEN: usize = 6;

/// Column of the sign.
const SIGN: usize = 2;

/// What a smeared step of friction says, and how long it takes.
#[derive(Debug)]
pub(super) struct Smeared {
    solution: Solution,
    /// Seconds.
    over: f64,
}

/// What it says where it tells the record better than a step. Equations at rest, where friction is whatever holds it, count on neither
/// side.
pub(super) fn smeared(columns: &Equations) -> Option<Smeared> {
    let n = columns.force.len();
    if columns.one_way || n < LEAST_EQUATIONS {
        return None;
    }
    let slow = |column: &[f64]| {
        let sizes: Vec<f64> = column.iter().map(|v| v.abs()).collect();
        let most = SLOW * quantile(&sizes, 0.99);
        sizes.into_iter().map(move |s| s < most)
    };
    let moves: Vec<usize> = slow(&columns.velocity)
        .zip(slow(&columns.acceleration))
        .enumerate()
        .filter_map(|(i, (v, a))| (!(v && a)).then_some(i))
        .collect();
    if moves.len() < LEAST_EQUATIONS {
        return None;
    }
    let force: Vec<f64> = moves.iter().map(|i| columns.force[*i]).collect();
    let x = columns.matrix(Friction::Symmetric, Method::Delayed);
    let with = |shape: &Shape| {
        let mut x = x.clone();
        x.column_mut(SIGN)
            .copy_from_slice(&averaged(columns, shape));
        x.select_rows(&moves)
    };
    let left = |shape: &Shape| {
        let found = least_squares_alone(&with(shape), &force)?;
        Some(rms(found.residuals))
    };
    let step = left(&Shape::triangle(1))?;
    let shapes = TRIANGLES.map(Shape::triangle).into_iter();
    let (least, shape) = shapes
        .chain(POLES.map(Shape::pole))
        .filter_map(|shape| Some((left(&shape)?, shape)))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    if least >= LATE * step {
        return None;
    }
    let steps: Vec<f64> = columns.time.windows(2).map(|w| w[1] - w[0]).collect();
    Some(Smeared {
        solution: least_squares(&with(&shape), &force)?,
        over: 2.0 * shape.length as f64 * quantile(&steps, 0.5),
    })
}

/// What a step is smeared by: weights of what was so many equations before, the first one being as many ahead.
struct Shape {
    length: usize,
    ahead: usize,
    weights: Vec<f64>,
}

impl Shape {
    fn new(length: usize, ahead: usize, weights: impl Iterator<Item = f64> + Clone) -> Self {
        let sum: f64 = weights.clone().sum();
        Self {
            length,
            ahead,
            weights: weights.map(|w| w / sum).collect(),
        }
    }

    fn triangle(half: usize) -> Self {
        let weight = |k: usize| (half - (k + 1).abs_diff(half)) as f64;
        Self::new(half, half - 1, (0..2 * half - 1).map(weight))
    }

    /// A filter of one pole delays a motion as long as it takes to forget: before that what it lets through turns, its step begins.
    fn pole(length: usize) -> Self {
        let weight = |k: usize| (-(k as f64) / length as f64).exp();
        Self::new(length, length, (0..=FORGOTTEN * length).map(weight))
    }

    fn of(&self, values: &[f64]) -> Vec<f64> {
        let last = values.len() - 1;
        let at = |k: usize, j: usize| values[(k + self.ahead).saturating_sub(j).min(last)];
        (0..=last)
            .map(|k| (0..).zip(&self.weights).map(|(j, w)| w * at(k, j)).sum())
            .collect()
    }
}

/// The sign smeared, within what has no gap.
fn averaged(columns: &Equations, shape: &Shape) -> Vec<f64> {
    let told = columns.told.as_deref().unwrap_or(columns);
    let steps: Vec<f64> = columns.time.windows(2).map(|w| w[1] - w[0]).collect();
    let longest = 1.5 * quantile(&steps, 0.5);
    let n = steps.len() + 1;
    let mut from = 0;
    let mut all = Vec::with_capacity(n);
    for to in (1..=n).filter(|k| *k == n || steps[k - 1] > longest) {
        all.extend(shape.of(&told.sign[from..to]));
        from = to;
    }
    all
}

impl Smeared {
    /// Makes parameters less sure by what it changes; those of the answer that it makes others are not known.
    pub(super) fn widen(
        &self,
        supported: Method,
        variants: &mut [Variant],
        unknown: &mut Vec<Unknown>,
        remarks: &mut Vec<String>,
    ) {
        let mut any = false;
        for (j, names) in NAMES.iter().enumerate() {
            let (value, std) = (self.solution.values[j], self.solution.std_correlated[j]);
            for variant in variants.iter_mut() {
                let answer = variant.friction == Friction::Symmetric && variant.method == supported;
                let own = variant.parameters.iter_mut();
                let own = own.filter(|p| names.contains(&p.name));
                for known in own.filter_map(|p| p.known.as_mut()) {
                    let off = (known.value - value).abs();
                    let sure = known.std_correlated.max(std);
                    let another = off > OTHER * value.abs() && off > SURELY * sure;
                    if answer && another && !unknown.iter().any(|u| u.covers(names[0])) {
                        unknown.push(self.another(names, known.value, value));
                    }
                    if off > ASIDE * sure {
                        known.std_correlated = off;
                        any = true;
                    }
                }
            }
        }
        if any {
            remarks.push(format!(
                "friction does not step where it turns but over {:.2} s, as where position and voltage were filtered before they were \
                 written: parameters are less sure by what that changes",
                self.over
            ));
        }
    }

    fn another(&self, names: &[&'static str], first: f64, value: f64) -> Unknown {
        Unknown {
            parameters: names.to_vec(),
            because: format!(
                "friction does not step where it turns but over {:.2} s, as where position and voltage were filtered before they \
                 were written: told so it is {value:.4e} instead of {first:.4e}",
                self.over
            ),
        }
    }
}
