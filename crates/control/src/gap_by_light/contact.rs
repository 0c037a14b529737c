//! Where fiber and chip touch, by how wide the spot was at some gaps and by all that was known before.

use super::{Width, straightened};
use crate::tuning::TUNING;
use nalgebra::{Matrix2, Vector2};
use pigtail_numerics::statistics::{pooled, within};
use std::f64::consts::TAU;

/// How light spreads over a gap in the micro's own scale, in x and in y: the `lambda / 2 pi` of the parabola, of which a
/// micro that goes farther than it is told makes less.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Metres.
    pub length: [f64; 2],
    /// Standard deviations of their natural logarithms.
    pub deviation: [f64; 2],
}

impl Spread {
    /// Of light of a wavelength (metres) that leaves at an angle to the z axis, before any of it was seen: makers state 5 to 10 %
    /// for how far a piezo goes, and twice as much of that is in it.
    pub fn by_design(wavelength: f64, exit: f64) -> Self {
        Self {
            length: [wavelength / (TAU * exit.cos()); 2],
            deviation: [TUNING.width.vague; 2],
        }
    }

    /// Of a spot that is as wide in x as in y, metres.
    pub fn middle(&self) -> f64 {
        (self.length[0] * self.length[1]).sqrt()
    }

    /// Whether it is known well enough for two gaps to tell where the chip is: the way between them, some 20 um, is wrong by
    /// as great a share.
    pub fn is_known(&self) -> bool {
        self.deviation
            .iter()
            .all(|deviation| *deviation < TUNING.width.well)
    }

    /// Whether it is known as well as it pays to know it: another fiber on another day adds half as much.
    pub fn is_well_known(&self) -> bool {
        let well = |deviation: &f64| *deviation < TUNING.width.very_well;
        self.deviation.iter().all(well)
    }

    /// What several fibers have told of one manipulator, for another fiber; `None` of none. Where they differ by more than
    /// they say, that is believed.
    pub fn of_all(told: &[Self]) -> Option<Self> {
        let all = Self::of_one(told)?;
        Some(Self {
            deviation: all
                .deviation
                .map(|deviation| deviation.hypot(TUNING.width.another)),
            ..all
        })
    }

    /// What looks at the same fiber have told together; `None` of none. Where they differ by more than they say, that is believed.
    pub fn of_one(told: &[Self]) -> Option<Self> {
        let axis = |i: usize| {
            let each = told
                .iter()
                .map(|one| (one.length[i].ln(), one.deviation[i]));
            let (mean, deviation) = pooled(each);
            (mean.exp(), deviation)
        };
        let [x, y] = [axis(0), axis(1)];
        (!told.is_empty()).then_some(Self {
            length: [x.0, y.0],
            deviation: [x.1, y.1],
        })
    }
}

/// What is known before widths are looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// Squares of the spot's widths where they touch, in x and in y, roughly: by design or by circles at the chip; square metres.
    pub squared: [f64; 2],
    /// How light spreads.
    pub spread: Spread,
    /// By vision: the gap by encoders where they touch (metres), ...
    pub at: f64,
    /// ...which is anywhere within this bound of that (metres), ...
    pub bound: f64,
    /// ...but for a normal error of this standard deviation, metres.
    pub sigma: f64,
}

/// Where fiber and chip touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The gap by encoders there, by light and vision, metres.
    pub at: f64,
    /// Its standard deviation, metres.
    pub deviation: f64,
    /// Where the light alone has it, and its standard deviation, metres.
    pub by_light: (f64, f64),
    /// How light spreads, as it is known now.
    pub spread: Spread,
}

/// Contacts that are tried lie so far apart, metres: the light never knows it to that.
const STEP: f64 = 25e-9;

/// A contact that was tried.
#[derive(Debug, Clone, Copy)]
struct Tried {
    at: f64,
    /// Weighted squares of what is left, what was known of the spot among them.
    misfit: f64,
    /// Minus twice the logarithm of how much of the shapes around the best one fits too.
    narrow: f64,
    /// Logarithm of how light spreads, in x and in y, and its variance.
    spread: [(f64, f64); 2],
}

/// Where both parabolas have their vertex. `None` where the widths are too few, say no place near where vision does, or are not those of
/// such a spot.
pub fn contact(widths: &[Width], known: &Known) -> Option<Contact> {
    if widths.len() < TUNING.width.gaps {
        return None;
    }
    let widths = &straightened(widths)[..];
    let reach = 2.0 * known.bound + TUNING.width.beyond * known.sigma.max(4.0 * STEP);
    let n = (reach / STEP).ceil() as i32;
    let mut shapes = [0, 1].map(|i| Shape::first(known, i));
    let tried: Vec<Tried> = (-n..=n)
        .map(|k| {
            let at = known.at + f64::from(k) * STEP;
            for (i, shape) in shapes.iter_mut().enumerate() {
                shape.fit(widths, at, known, i);
            }
            Tried {
                at,
                misfit: shapes.iter().map(|shape| shape.misfit).sum(),
                narrow: shapes
                    .iter()
                    .map(|shape| shape.matrix.determinant().ln())
                    .sum(),
                spread: [0, 1].map(|i| shapes[i].spread()),
            }
        })
        .collect();
    let best = tried
        .iter()
        .enumerate()
        .min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit))?;
    let least = best.1.misfit;
    // Widths and what was known beside the vertex, less what is sought.
    let free = (2 * widths.len() + 4 - 5) as f64;
    let worse = (least / free).max(1.0);
    let at_end = best.0 == 0 || best.0 + 1 == tried.len();
    if at_end || !least.is_finite() || worse > TUNING.width.misshapen * TUNING.width.misshapen {
        return None;
    }
    let likely =
        |one: &Tried| (-0.5 * ((one.misfit - least) / worse + one.narrow - best.1.narrow)).exp();
    let vision = |one: &Tried| {
        let off = one.at - known.at;
        within(off, known.bound, known.sigma)
    };
    let by_light = moments(&tried, likely)?;
    let both = |one: &Tried| likely(one) * vision(one);
    let (at, deviation) = moments(&tried, both)?;
    let axis = |i: usize| {
        let value = |one: &Tried| one.spread[i].0;
        let (mean, apart) = moments_of(&tried, both, value)?;
        let own = moments_of(&tried, both, |one| one.spread[i].1)?.0;
        Some((mean.exp(), (worse * own).sqrt().hypot(apart)))
    };
    let (x, y) = (axis(0)?, axis(1)?);
    Some(Contact {
        at,
        deviation: deviation.hypot(TUNING.width.hidden),
        by_light: (by_light.0, by_light.1.hypot(TUNING.width.hidden)),
        spread: Spread {
            length: [x.0, y.0],
            deviation: [x.1, y.1],
        },
    })
}

fn moments(tried: &[Tried], weight: impl Fn(&Tried) -> f64 + Copy) -> Option<(f64, f64)> {
    moments_of(tried, weight, |one| one.at)
}

/// Mean and standard deviation of something, so weighted.
fn moments_of(
    tried: &[Tried],
    weight: impl Fn(&Tried) -> f64,
    value: impl Fn(&Tried) -> f64,
) -> Option<(f64, f64)> {
    let whole: f64 = tried.iter().map(&weight).sum();
    let mean = tried
        .iter()
        .map(|one| weight(one) * value(one))
        .sum::<f64>()
        / whole;
    let square = |one: &Tried| weight(one) * (value(one) - mean).powi(2);
    let variance = tried.iter().map(square).sum::<f64>() / whole;
    (whole > 0.0 && mean.is_finite()).then(|| (mean, variance.sqrt()))
}

/// The parabola along one axis that fits best for a vertex: logarithms of its square at the vertex, and of how it spreads.
#[derive(Debug, Clone, Copy)]
struct Shape {
    at: Vector2<f64>,
    matrix: Matrix2<f64>,
    misfit: f64,
}

impl Shape {
    fn first(known: &Known, axis: usize) -> Self {
        Self {
            at: Vector2::new(known.squared[axis].ln(), known.spread.length[axis].ln()),
            matrix: Matrix2::identity(),
            misfit: f64::INFINITY,
        }
    }

    /// Goes from the shape for a vertex beside this one to that for a vertex, by Gauss and Newton.
    fn fit(&mut self, widths: &[Width], vertex: f64, known: &Known, axis: usize) {
        /// The first one is farther than the others.
        const STEPS: (u32, u32) = (12, 3);
        /// No logarithm goes farther in a step.
        const MOST: f64 = 0.5;
        let steps = if self.misfit.is_finite() {
            STEPS.1
        } else {
            STEPS.0
        };
        let before = Vector2::new(known.squared[axis].ln(), known.spread.length[axis].ln());
        let weights = Vector2::new(
            TUNING.width.roughly.powi(-2),
            known.spread.deviation[axis].powi(-2),
        );
        for step in 0..=steps {
            let left = before - self.at;
            let mut matrix = Matrix2::from_diagonal(&weights);
            let mut pull = left.component_mul(&weights);
            let mut misfit = left.component_mul(&left).dot(&weights);
            let [squared, length] = [self.at[0].exp(), self.at[1].exp()];
            for width in widths {
                let spread = (length * (width.at - vertex)).powi(2) / squared;
                let row = Vector2::new(squared - spread, 2.0 * spread);
                let weight = width.deviation[axis].powi(-2);
                let left = width.squared[axis] - squared - spread;
                matrix += row * row.transpose() * weight;
                pull += row * (left * weight);
                misfit += left * left * weight;
            }
            (self.matrix, self.misfit) = (matrix, misfit);
            let Some(by) = matrix.try_inverse().map(|inverse| inverse * pull) else {
                self.misfit = f64::INFINITY;
                return;
            };
            if step < steps {
                self.at += by.map(|by| by.clamp(-MOST, MOST));
            }
        }
    }

    /// Logarithm of how light spreads, and its variance.
    fn spread(&self) -> (f64, f64) {
        let variance = self
            .matrix
            .try_inverse()
            .map_or(f64::INFINITY, |inverse| inverse[(1, 1)]);
        (self.at[1], variance)
    }
}
