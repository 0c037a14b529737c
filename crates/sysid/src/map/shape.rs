//! A peak of unknown width on an inclined background, and its fit to readings.

use nalgebra::{SMatrix, SVector, Vector2};
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::{Normal, Problem, Rules, minimise};

/// Numbers of a shape: background, height, place (2), precision (3), slope (2).
pub(super) const NUMBERS: usize = 9;
/// A fit has one more, the level of a fold.
const N: usize = NUMBERS + 1;
const LEVEL: usize = NUMBERS;

type Vector = SVector<f64, N>;
type Matrix = SMatrix<f64, N, N>;

/// `b + s u + t v + A exp(-(a u^2 + 2 h u v + d v^2))`, with `u` and `v` from the peak's place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Power beside the light, b: at the peak's place, were there no peak.
    pub background: f64,
    /// How it rises, s and t, a metre.
    pub slope: [f64; 2],
    /// Power of the peak above it, A.
    pub height: f64,
    /// The peak's place.
    pub at: Displacement,
    /// a, h, d; 1/m^2.
    pub precision: [f64; 3],
}

impl Shape {
    /// A round peak.
    pub(super) fn round(background: f64, height: f64, at: Displacement, radius: f64) -> Self {
        let a = 1.0 / (radius * radius);
        Self {
            background,
            slope: [0.0; 2],
            height,
            at,
            precision: [a, 0.0, a],
        }
    }

    /// The share of its height that a peak has at a place.
    pub fn share(&self, place: Displacement) -> f64 {
        let Displacement { x: u, y: v } = place - self.at;
        let [a, h, d] = self.precision;
        (-(a * u * u + 2.0 * h * u * v + d * v * v)).exp()
    }

    /// The power beside the light at a place.
    pub fn background(&self, place: Displacement) -> f64 {
        let [s, t] = self.slope;
        let Displacement { x: u, y: v } = place - self.at;
        self.background + s * u + t * v
    }

    /// The power at a place.
    pub fn power(&self, place: Displacement) -> f64 {
        self.background(place) + self.height * self.share(place)
    }

    /// Radii at 1/e of the height along x and y through the peak, metres.
    pub fn radii(&self) -> (f64, f64) {
        let [a, _, d] = self.precision;
        (a.sqrt().recip(), d.sqrt().recip())
    }

    /// The ellipse at 1/e of the height: long and short radius, metres, and the angle of the long
    /// one from the x axis, radians from -pi/2 to pi/2.
    pub fn ellipse(&self) -> (f64, f64, f64) {
        let [a, h, d] = self.precision;
        let (mean, apart) = (0.5 * (a + d), (0.25 * (a - d) * (a - d) + h * h).sqrt());
        // The precision is least along the long axis.
        let angle = 0.5 * (-2.0 * h).atan2(d - a);
        let long = (mean - apart).max(f64::MIN_POSITIVE).sqrt().recip();
        (long, (mean + apart).sqrt().recip(), angle)
    }

    pub(super) fn is_sound(&self) -> bool {
        let [a, h, d] = self.precision;
        a > 0.0 && d > 0.0 && a * d > h * h && self.height.is_finite()
    }

    fn vector(&self, level: f64) -> Vector {
        let ([a, h, d], [s, t]) = (self.precision, self.slope);
        let (b, height) = (self.background, self.height);
        let Displacement { x, y } = self.at;
        Vector::from([b, height, x, y, a, h, d, s, t, level])
    }

    /// The shape after a step in units of `unit` of length and `height` of power.
    pub(super) fn stepped(&self, by: &SVector<f64, NUMBERS>, unit: f64, height: f64) -> Self {
        let square = 1.0 / (unit * unit);
        let slope = height / unit;
        let back = [
            height, height, unit, unit, square, square, square, slope, slope,
        ];
        let mut next = self.vector(0.0);
        for (i, (by, back)) in by.iter().zip(back).enumerate() {
            next[i] += by * back;
        }
        Self::of(&next)
    }

    fn of(v: &Vector) -> Self {
        Self {
            background: v[0],
            height: v[1],
            at: Displacement::new(v[2], v[3]),
            precision: [v[4], v[5], v[6]],
            slope: [v[7], v[8]],
        }
    }

    /// How the power at a place changes with each number of the shape.
    pub(super) fn slopes(&self, place: Displacement) -> Vector {
        let Displacement { x: u, y: v } = place - self.at;
        let [a, h, d] = self.precision;
        let share = self.share(place);
        let light = self.height * share;
        Vector::from([
            1.0,
            share,
            2.0 * light * (a * u + h * v) - self.slope[0],
            2.0 * light * (h * u + d * v) - self.slope[1],
            -light * u * u,
            -2.0 * light * u * v,
            -light * v * v,
            u,
            v,
            0.0,
        ])
    }
}

/// A reading as a fit takes it: `power = sign * (power of the shape) + share * level`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Datum {
    pub(super) at: Displacement,
    pub(super) power: f64,
    pub(super) sign: f64,
    pub(super) share: f64,
    /// The light was that bright or brighter.
    pub(super) at_least: bool,
}

impl Datum {
    pub(super) fn plain(reading: &super::Reading) -> Self {
        Self {
            at: reading.at,
            power: reading.power,
            sign: 1.0,
            share: 0.0,
            at_least: false,
        }
    }

    /// What a shape leaves of it.
    pub(super) fn residual(&self, shape: &Shape, level: f64) -> f64 {
        let model = self.sign * shape.power(self.at) + self.share * level;
        if self.at_least && model >= self.power {
            0.0
        } else {
            self.power - model
        }
    }
}

/// A shape that was fitted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub(super) shape: Shape,
    /// The level at which the signal folds.
    pub(super) level: f64,
    /// Sum of the residuals' squares.
    pub(super) squares: f64,
    /// Inverse of the information for readings of unit noise, in the fit's own units of length.
    covariance: Matrix,
    pub(super) unit: f64,
    pub(super) height: f64,
}

impl Fit {
    /// Standard deviation of the peak's place in the worse direction for readings of so much
    /// noise, metres.
    pub(super) fn deviation(&self, noise: f64) -> f64 {
        let c = &self.covariance;
        let (xx, xy, yy) = (c[(2, 2)], c[(2, 3)], c[(3, 3)]);
        let worst = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        self.unit * worst.sqrt() * noise / self.height
    }

    /// Standard deviation of the radius that is known worse, as a share of it, for readings of so
    /// much noise.
    pub(super) fn width_deviation(&self, noise: f64) -> f64 {
        let [a, _, d] = self.shape.precision.map(|p| p * self.unit * self.unit);
        let c = &self.covariance;
        // A radius is the precision's inverse root: half as uncertain.
        let worst = (c[(4, 4)] / (a * a)).max(c[(6, 6)] / (d * d));
        0.5 * worst.sqrt() * noise / self.height
    }

    /// By how much the variances of the place, in radii, and of the radii, as shares of them, would
    /// fall together with one more reading (Fisher information, Sherman and Morrison); those of the
    /// radii count `widths` times.
    pub(super) fn gain(&self, place: Displacement, widths: f64) -> f64 {
        let row = scaled(&self.shape.slopes(place), self.unit, self.height);
        let [a, _, d] = self.shape.precision.map(|p| p * self.unit * self.unit);
        let c = self.covariance * row;
        let place = a * c[2] * c[2] + d * c[3] * c[3];
        let radii = 0.25 * ((c[4] / a).powi(2) + (c[6] / d).powi(2));
        (place + widths * radii) / (1.0 + row.dot(&c))
    }
}

/// Slopes in units of `unit` of length and `height` of power.
pub(super) fn scaled(slopes: &Vector, unit: f64, height: f64) -> Vector {
    let (inverse, square) = (unit / height, 1.0 / (unit * unit * height));
    let length = 1.0 / unit;
    slopes.component_mul(&Vector::from([
        1.0, 1.0, inverse, inverse, square, square, square, length, length, 1.0,
    ]))
}

/// Fits a shape by least squares (Levenberg and Marquardt) from `start`; the level of a fold too
/// where it is `free`. `None` where nothing comes of it.
pub(super) fn fit(data: &[Datum], start: &Shape, level: f64, free: bool) -> Option<Fit> {
    const RULES: Rules = Rules {
        steps: 60,
        ridge: 1e-9,
        gain: 0.0,
        share: 1e-9,
    };
    let (long, short, _) = start.ellipse();
    let unit = (long * short).sqrt();
    let height = start.height.abs();
    if !(unit.is_finite() && unit > 0.0 && height > 0.0) {
        return None;
    }
    let through = Through {
        data,
        unit,
        height,
        free,
    };
    let found = minimise(&through, (*start, level), &RULES)?;
    let (shape, level) = found.at;
    let mut information = found.information;
    for i in 0..N {
        information[(i, i)] += 1e-12;
    }
    Some(Fit {
        shape,
        level,
        squares: found.cost,
        covariance: information.try_inverse()?,
        unit,
        height,
    })
}

/// A shape and the level of a fold through readings. Numbers of about one: lengths in radii of the
/// start, powers in its height.
struct Through<'a> {
    data: &'a [Datum],
    unit: f64,
    height: f64,
    /// Whether the level may change.
    free: bool,
}

impl Problem<N> for Through<'_> {
    type State = (Shape, f64);

    fn cost(&self, (shape, level): &(Shape, f64)) -> f64 {
        if !shape.is_sound() {
            return f64::INFINITY;
        }
        let left = self.data.iter().map(|d| d.residual(shape, *level));
        left.map(|l| l.powi(2)).sum()
    }

    fn equations(&self, (shape, level): &(Shape, f64)) -> Normal<N> {
        let mut normal = Normal::default();
        for d in self.data {
            let residual = d.residual(shape, *level);
            if residual == 0.0 && d.at_least {
                continue;
            }
            let slopes = d.sign * shape.slopes(d.at);
            let mut row = scaled(&slopes, self.unit, self.height);
            row[LEVEL] = if self.free { d.share } else { 0.0 };
            normal.add(&row, residual / self.height);
        }
        normal
    }

    fn step(&self, (shape, level): &(Shape, f64), by: &Vector) -> (Shape, f64) {
        let numbers = by.fixed_rows::<NUMBERS>(0).into_owned();
        let next = shape.stepped(&numbers, self.unit, self.height);
        (next, level + by[LEVEL] * self.height)
    }
}

/// Sum of squares that a plane through some readings leaves: what they would be without a peak.
pub(super) fn flat_squares(data: &[Datum]) -> f64 {
    let n = data.len() as f64;
    let mean = |of: fn(&Datum) -> f64| data.iter().map(of).sum::<f64>() / n;
    let (x, y, power) = (mean(|d| d.at.x), mean(|d| d.at.y), mean(|d| d.power));
    let mut normal = Normal::default();
    for d in data {
        normal.add(&Vector2::new(d.at.x - x, d.at.y - y), d.power - power);
    }
    let inverse = normal.matrix.try_inverse();
    let slope = inverse.map_or(Vector2::zeros(), |m| m * normal.right);
    let rest = |d: &Datum| d.power - power - slope.x * (d.at.x - x) - slope.y * (d.at.y - y);
    data.iter().map(|d| rest(d).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(shape: &Shape) -> Vec<Datum> {
        (0..225)
            .map(|k| {
                let at = Displacement::new(f64::from(k % 15) * 1e-6, f64::from(k / 15) * 1e-6);
                Datum {
                    at,
                    power: shape.power(at),
                    sign: 1.0,
                    share: 0.0,
                    at_least: false,
                }
            })
            .collect()
    }

    fn tilted() -> Shape {
        // Radii of 4 and 2 um, the long one 30 degrees up.
        let (sin, cos) = (0.5_f64, 0.75_f64.sqrt());
        let (p, q) = (1.0 / 16e-12, 1.0 / 4e-12);
        Shape {
            background: 0.3,
            slope: [2e4, -1e4],
            height: 2.0,
            at: Displacement::new(6.3e-6, 8.1e-6),
            precision: [
                p * cos * cos + q * sin * sin,
                (p - q) * sin * cos,
                p * sin * sin + q * cos * cos,
            ],
        }
    }

    #[test]
    fn a_tilted_peak_without_noise_is_found_exactly() {
        let truth = tilted();
        let start = Shape::round(0.0, 1.0, Displacement::new(7e-6, 7e-6), 3e-6);
        let found = fit(&grid(&truth), &start, 0.0, false).unwrap().shape;
        assert!((found.at - truth.at).norm() < 1e-11);
        assert!((found.height - 2.0).abs() < 1e-5 && (found.background - 0.3).abs() < 1e-5);
        let (long, short, angle) = found.ellipse();
        assert!((long - 4e-6).abs() < 1e-10 && (short - 2e-6).abs() < 1e-10);
        assert!((angle.to_degrees() - 30.0).abs() < 1e-3, "{angle}");
    }

    #[test]
    fn slopes_are_those_of_small_differences() {
        let shape = tilted();
        let place = Displacement::new(8e-6, 5e-6);
        let at = shape.vector(0.0);
        let slopes = shape.slopes(place);
        for i in 0..NUMBERS {
            let step = 1e-5 * at[i].abs().max(1e-7);
            let moved = |sign: f64| {
                let mut v = at;
                v[i] += sign * step;
                Shape::of(&v).power(place)
            };
            let slope = (moved(1.0) - moved(-1.0)) / (2.0 * step);
            assert!((slope / slopes[i] - 1.0).abs() < 1e-5, "{i}");
        }
    }

    #[test]
    fn a_reading_more_gains_what_is_foretold() {
        let shape = tilted();
        let data = grid(&shape);
        let start = Shape::round(0.0, 1.0, Displacement::new(7e-6, 7e-6), 3e-6);
        let of = |data: &[Datum]| fit(data, &start, 0.0, false).unwrap();
        let before = of(&data);
        let at = Displacement::new(7.4e-6, 9.3e-6);
        let mut more = data.clone();
        more.push(Datum {
            at,
            power: shape.power(at),
            ..data[0]
        });
        let after = of(&more);
        let [a, _, d] = before
            .shape
            .precision
            .map(|p| p * before.unit * before.unit);
        let sum = |f: &Fit| {
            let c = &f.covariance;
            let place = a * c[(2, 2)] + d * c[(3, 3)];
            place + 0.25 * 0.5 * (c[(4, 4)] / (a * a) + c[(6, 6)] / (d * d))
        };
        let gain = sum(&before) - sum(&after);
        assert!((gain / before.gain(at, 0.5) - 1.0).abs() < 1e-3, "{gain}");
    }
}
