//! Where fiber and chip touch, by how wide the spot was at some gaps and by all that was known before.

use super::Width;
use crate::tuning::TUNING;
use nalgebra::{Cholesky, Const, Matrix2, SMatrix, SVector};
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
    /// By how much both err alike, the correlation of their logarithms: where nobody knew where the chip was, both follow from the same guess of it.
    pub correlation: f64,
}

impl Spread {
    /// No two lengths err more alike: what is left is for their widths' own noise.
    const ALIKE: f64 = 0.99;

    /// Of light of a wavelength (metres) that leaves at an angle to the z axis, before any of it was seen: makers state 5 to 10 %
    /// for how far a piezo goes, and twice as much of that is in it.
    pub fn by_design(wavelength: f64, exit: f64) -> Self {
        Self {
            length: [wavelength / (TAU * exit.cos()); 2],
            deviation: [TUNING.width.vague; 2],
            correlation: 0.0,
        }
    }

    /// Variances of both logarithms, and what they have in common.
    fn covariance(&self) -> Matrix2<f64> {
        let [x, y] = self.deviation;
        let both = self.correlation.clamp(-Self::ALIKE, Self::ALIKE) * x * y;
        Matrix2::new(x * x, both, both, y * y)
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
        let deviation = all
            .deviation
            .map(|deviation| deviation.hypot(TUNING.width.another));
        let [x, y] = [0, 1].map(|i| all.deviation[i] / deviation[i]);
        Some(Self {
            deviation,
            // What another fiber differs by it does along x and along y by itself.
            correlation: all.correlation * x * y,
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
        let alike = told.iter().map(|one| one.correlation).sum::<f64>();
        (!told.is_empty()).then_some(Self {
            length: [x.0, y.0],
            deviation: [x.1, y.1],
            correlation: alike / told.len() as f64,
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
    /// What a transmission keeps to itself of the way between two looks, standard deviation, metres.
    pub hidden: f64,
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
const STEP: f64 = 50e-9;

/// A contact that was tried.
#[derive(Debug, Clone, Copy)]
struct Tried {
    at: f64,
    /// The spot that fits best.
    spot: Spot,
    /// How well it is known.
    covariance: SMatrix<f64, SPOT, SPOT>,
    /// Minus twice the logarithm of how much of the spots around it fits too.
    narrow: f64,
}

/// Where both parabolas have their vertex. `None` where the widths are too few, say no place near where vision does, or are not those of
/// such a spot.
pub fn contact(widths: &[Width], known: &Known) -> Option<Contact> {
    if widths.len() < TUNING.width.gaps {
        return None;
    }
    let reach = 2.0 * known.bound + TUNING.width.beyond * known.sigma.max(4.0 * STEP);
    let n = (reach / STEP).ceil() as i32;
    let mut spot = Spot::first(known);
    let tried: Option<Vec<Tried>> = (-n..=n)
        .map(|k| {
            let at = known.at + f64::from(k) * STEP;
            let factor = spot.fit(widths, at, known)?;
            Some(Tried {
                at,
                spot,
                covariance: factor.inverse(),
                narrow: 2.0 * factor.l().diagonal().map(f64::ln).sum(),
            })
        })
        .collect();
    let tried = tried?;
    let misfit = |one: &Tried| one.spot.misfit + one.spot.surprise;
    let (best, one) =
        (tried.iter().enumerate()).min_by(|a, b| misfit(a.1).total_cmp(&misfit(b.1)))?;
    let worse = one.worse(widths.len(), known);
    let at_end = best == 0 || best + 1 == tried.len();
    if at_end || !misfit(one).is_finite() || worse > TUNING.width.misshapen * TUNING.width.misshapen
    {
        return None;
    }
    let likely = |other: &Tried| {
        let less = (misfit(other) - misfit(one)) / worse;
        (-0.5 * (less + other.narrow - one.narrow)).exp()
    };
    let vision = |one: &Tried| {
        let off = one.at - known.at;
        within(off, known.bound, known.sigma)
    };
    let by_light = moments(&tried, likely)?;
    let both = |one: &Tried| likely(one) * vision(one);
    let (at, deviation) = moments(&tried, both)?;
    let spread = spread_of(&tried, both, worse)?;
    Some(Contact {
        at,
        deviation: deviation.hypot(known.hidden),
        by_light: (by_light.0, by_light.1.hypot(known.hidden)),
        spread,
    })
}

/// How light spreads by all contacts, so weighted: their own errors, so many times `worse`, and by how much they differ.
fn spread_of(tried: &[Tried], weight: impl Fn(&Tried) -> f64 + Copy, worse: f64) -> Option<Spread> {
    let mean = |value: &dyn Fn(&Tried) -> f64| moments_of(tried, weight, value);
    let length = |one: &Tried, i: usize| one.spot.at[LENGTH + i];
    let (x, of_x) = mean(&|one| length(one, 0))?;
    let (y, of_y) = mean(&|one| length(one, 1))?;
    let own = |i: usize, j: usize| {
        let of = |one: &Tried| worse * one.covariance[(LENGTH + i, LENGTH + j)];
        mean(&of).map(|(own, _)| own)
    };
    let variances = [own(0, 0)? + of_x * of_x, own(1, 1)? + of_y * of_y];
    let (both, _) = mean(&|one| (length(one, 0) - x) * (length(one, 1) - y))?;
    Some(Spread {
        length: [x.exp(), y.exp()],
        deviation: variances.map(f64::sqrt),
        correlation: (own(0, 1)? + both) / (variances[0] * variances[1]).sqrt(),
    })
}

impl Tried {
    /// How many times the squares of what is left of so many widths are what their deviations make of them, but not less than one. What was known
    /// beforehand counts neither among what is left nor as what it fits: where it is vague it always fits.
    fn worse(&self, widths: usize, known: &Known) -> f64 {
        let by_widths = SPOT as f64 - (Spot::before(known).1 * self.covariance).trace();
        // Two widths and how askew they are, less what they tell, and less where the vertex is.
        let free = (3 * widths) as f64 - by_widths - 1.0;
        (self.spot.misfit / free.max(1.0)).max(1.0)
    }
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

/// Unknowns of a spot: logarithms of its squared radii where they touch, of how light spreads along both ways that the micro is told to go, and
/// the angles by which it goes otherwise.
const SPOT: usize = 6;
/// Where among them those stand that are of how light spreads.
const LENGTH: usize = 2;

/// The spot that fits best for a vertex.
///
/// Guides lie in a chip so that light falls off by `exp(-r' D r)` with a diagonal `D`. A micro that is told to go along x goes by some scale in
/// a direction that is a little turned, along y by another in another: it lags, its axes are coupled, it swings along. Told to go by `d` it
/// sees `d' A' D A d`, of which both ways are the columns of `A`. An oblong spot is seen the rounder for it, by more where it is the more oblong, which it
/// is not at all gaps alike; and it is seen to lie askew, which tells the angles where they count.
#[derive(Debug, Clone, Copy)]
struct Spot {
    at: SVector<f64, SPOT>,
    /// How light spreads on average, to which scales are relative, metres.
    middle: f64,
    /// Weighted squares of what is left of the widths.
    misfit: f64,
    /// And of what was known beforehand.
    surprise: f64,
}

/// What is seen at a gap beside what the spot would show: what is left, its weight, and by how much it changes with the unknowns.
type Seen = (f64, f64, SVector<f64, SPOT>);

impl Spot {
    /// What is known beforehand, and its weights.
    fn before(known: &Known) -> (SVector<f64, SPOT>, SMatrix<f64, SPOT, SPOT>) {
        let middle = known.spread.middle();
        let [a, b] = known.spread.length.map(f64::ln);
        let [x, y] = known.squared.map(|squared| (squared * middle).ln());
        let [rough, turned] = [TUNING.width.roughly, TUNING.width.turned].map(|d| d.powi(-2));
        let mut weights =
            SMatrix::from_diagonal(&SVector::from([rough, rough, 0.0, 0.0, turned, turned]));
        let lengths = known.spread.covariance().try_inverse();
        let lengths = lengths.unwrap_or_else(Matrix2::zeros);
        weights
            .fixed_view_mut::<2, 2>(LENGTH, LENGTH)
            .copy_from(&lengths);
        (SVector::from([x - a, y - b, a, b, 0.0, 0.0]), weights)
    }

    fn first(known: &Known) -> Self {
        Self {
            at: Self::before(known).0,
            middle: known.spread.middle(),
            misfit: f64::INFINITY,
            surprise: 0.0,
        }
    }

    /// Goes from the spot for a vertex beside this one to that for a vertex, by Gauss and Newton: how well it is known. `None` where nothing fits.
    fn fit(
        &mut self,
        widths: &[Width],
        vertex: f64,
        known: &Known,
    ) -> Option<Cholesky<f64, Const<SPOT>>> {
        /// The first one is farther than the others.
        const STEPS: (u32, u32) = (12, 3);
        /// No logarithm and no angle goes farther in a step.
        const MOST: f64 = 0.5;
        let (before, weights) = Self::before(known);
        let steps = if self.misfit.is_finite() {
            STEPS.1
        } else {
            STEPS.0
        };
        for step in 0.. {
            let off = before - self.at;
            let mut matrix = weights;
            let mut pull = weights * off;
            let (surprise, mut misfit) = (off.dot(&pull), 0.0);
            for (left, weight, row) in widths.iter().flat_map(|width| self.seen(width, vertex)) {
                matrix += row * row.transpose() * weight;
                pull += row * (left * weight);
                misfit += left * left * weight;
            }
            (self.misfit, self.surprise) = (misfit, surprise);
            let factor = Cholesky::new(matrix)?;
            if step == steps {
                return Some(factor);
            }
            self.at += factor.solve(&pull).map(|by| by.clamp(-MOST, MOST));
        }
        None
    }

    /// Both squared widths at a gap, and how askew the spot is.
    fn seen(&self, width: &Width, vertex: f64) -> [Seen; 3] {
        let spreads = (self.middle * (width.at - vertex)).powi(2);
        let radii = [self.at[0].exp(), self.at[1].exp()];
        let [d, e] = radii.map(|radius| (radius + spreads / radius).recip());
        let more = |radius: f64, d: f64| (spreads / radius - radius) * d * d;
        let (of_d, of_e) = (more(radii[0], d), more(radii[1], e));
        let [x, y] =
            [self.at[LENGTH], self.at[LENGTH + 1]].map(|length| self.middle / length.exp());
        let both = (x * y).sqrt();
        let [(sin_x, cos_x), (sin_y, cos_y)] = [self.at[4].sin_cos(), self.at[5].sin_cos()];
        let along_x = x * (cos_x * cos_x * d + sin_x * sin_x * e);
        let along_y = y * (sin_y * sin_y * d + cos_y * cos_y * e);
        let askew = both * (sin_x * cos_y * e - cos_x * sin_y * d);
        let rows = [
            [
                x * cos_x * cos_x * of_d,
                x * sin_x * sin_x * of_e,
                -along_x,
                0.0,
                2.0 * x * sin_x * cos_x * (e - d),
                0.0,
            ],
            [
                y * sin_y * sin_y * of_d,
                y * cos_y * cos_y * of_e,
                0.0,
                -along_y,
                0.0,
                2.0 * y * sin_y * cos_y * (d - e),
            ],
            [
                -both * cos_x * sin_y * of_d,
                both * sin_x * cos_y * of_e,
                -0.5 * askew,
                -0.5 * askew,
                both * (sin_x * sin_y * d + cos_x * cos_y * e),
                -both * (cos_x * cos_y * d + sin_x * sin_y * e),
            ],
        ]
        .map(SVector::from);
        let of_width = |i: usize, curvature: f64| {
            let left = width.squared[i] - curvature.recip();
            let row = rows[i] * -curvature.powi(-2);
            (left, width.deviation[i].powi(-2), row)
        };
        [
            of_width(0, along_x),
            of_width(1, along_y),
            (width.askew.0 - askew, width.askew.1.powi(-2), rows[2]),
        ]
    }
}
