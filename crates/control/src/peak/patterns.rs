//! Patterns of nine points around a peak: its place by all of them, and how well that is known.

use super::PATTERN;
use crate::tuning::TUNING;
use pigtail_model::frames::Displacement;

/// The light of a fiber before its port.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    /// The photodiode's level without it, volts.
    pub background: f64,
    /// Squares of the distances in x and in y at which it has fallen to 1/e, square metres.
    pub squared_widths: [f64; 2],
}

impl Spot {
    /// How much a peak bends that is as bright as these nine points, so many metres apart, volts over a step squared in x and in y:
    /// `-2 I s^2 / w^2`.
    fn curvatures(&self, light: &[f64; 9], step: f64) -> [f64; 2] {
        let level = light.iter().sum::<f64>() / 9.0 - self.background;
        self.squared_widths
            .map(|squared| -2.0 * level.max(0.0) * step * step / squared)
    }
}

/// The light of patterns, in turns around either of two ways.
#[derive(Debug, Clone, Default)]
pub(super) struct Patterns(Vec<[f64; 9]>);

/// What patterns tell of a peak.
#[derive(Debug, Clone, Copy)]
pub struct Vertex {
    /// Where it is, steps from the centre; there where they tell nothing.
    pub at: Displacement,
    /// Its standard deviation in the worse direction, metres.
    pub deviation: f64,
    /// What that would be of a spot as wide as it should be, metres, where this one bends otherwise; `None` where noise may be all that does it.
    pub by_light: Option<f64>,
    /// How far it may be elsewhere beside that, x and y, metres.
    pub elsewhere: [f64; 2],
}

impl Vertex {
    /// The same after the move there, of patterns with such steps (metres): the next look would find it by no more than that elsewhere, where
    /// looks come nearer at all.
    pub(super) fn moved_to(self, step: f64) -> Self {
        let [x, y] = self.elsewhere;
        Self {
            elsewhere: [x + step * self.at.x.abs(), y + step * self.at.y.abs()],
            ..self
        }
    }
}

impl Patterns {
    pub(super) fn add(&mut self, light: [f64; 9]) {
        self.0.push(light);
    }

    pub(super) fn count(&self) -> u32 {
        self.0.len() as u32
    }

    /// The mean of those whose number is one of these.
    fn mean(&self, of: impl Fn(usize) -> bool) -> [f64; 9] {
        let mut mean = [0.0; 9];
        let mut count = 0.0;
        for (_, light) in self.0.iter().enumerate().filter(|(k, _)| of(*k)) {
            count += 1.0;
            for (mean, volts) in mean.iter_mut().zip(light) {
                *mean += (volts - *mean) / count;
            }
        }
        mean
    }

    /// Either way around by itself.
    fn ways(&self) -> [[f64; 9]; 2] {
        [0, 1].map(|way| self.mean(|k| k % 2 == way))
    }

    /// Variance of one of the nine values of the mean of all, as either way scatters about its own: they differ by what has not come to rest. What a
    /// pattern's nine points have in common is none of it: by how much the laser is brighter meanwhile moves no vertex.
    fn variance(&self) -> f64 {
        let ways = self.ways();
        let mut squares = 0.0;
        for (k, light) in self.0.iter().enumerate() {
            let apart: [f64; 9] = std::array::from_fn(|i| light[i] - ways[k % 2][i]);
            let brighter = apart.iter().sum::<f64>() / 9.0;
            squares += apart.iter().map(|a| (a - brighter).powi(2)).sum::<f64>();
        }
        let count = self.0.len() as f64;
        squares / (8.0 * (count - 2.0).max(1.0)) / count
    }

    /// The peak by all patterns, each `step` metres from point to point.
    pub(super) fn vertex(&self, spot: &Spot, step: f64) -> Vertex {
        let mean = self.mean(|_| true);
        let fit = Paraboloid::fit(&mean);
        let steepest = spot.curvatures(&mean, step);
        let variance = self.variance();
        // Half of what two halves of the patterns differ by in their slopes, steps, beyond what noise makes of it.
        let bends = [fit.hx.max(steepest[0]), fit.hy.max(steepest[1])];
        let differ = |halves: [[f64; 9]; 2]| {
            let [one, other] = halves.map(|half| Paraboloid::fit(&half));
            let slopes = [one.gx - other.gx, one.gy - other.gy];
            [0, 1].map(|i| {
                let squared = 0.25 * slopes[i] * slopes[i] - variance / 6.0;
                squared.max(0.0).sqrt() / bends[i].abs()
            })
        };
        let ways = differ(self.ways());
        // Patterns are those of their middle: until their end what drifts goes on by as much as between the middles of their halves.
        let half = self.0.len() / 2;
        let drifts = differ([self.mean(|k| k < half), self.mean(|k| k >= half)]);
        let at = fit.vertex().unwrap_or_default();
        // Curvatures have twice the variance of a value, and slopes a sixth of it.
        let noise = (2.0 * variance).sqrt();
        let bends_otherwise = (fit.hx - steepest[0])
            .abs()
            .max((fit.hy - steepest[1]).abs())
            > TUNING.climb.otherwise * noise;
        let least = steepest[0].max(steepest[1]).abs();
        let by_light = bends_otherwise.then(|| step * (variance / 6.0).sqrt() / least);
        Vertex {
            at,
            deviation: step * fit.deviation(variance, steepest),
            by_light,
            elsewhere: [0, 1].map(|i| step * (TUNING.climb.mirrored * ways[i] + 2.0 * drifts[i])),
        }
    }
}

/// `c + gx x + gy y + hx x^2/2 + hy y^2/2 + m x y` over the pattern, in steps from the centre.
#[derive(Debug, Clone, Copy)]
struct Paraboloid {
    gx: f64,
    gy: f64,
    hx: f64,
    hy: f64,
    m: f64,
}

impl Paraboloid {
    /// Least squares through the nine values; the points' symmetry makes the terms independent.
    fn fit(values: &[f64; 9]) -> Self {
        let (mut gx, mut gy, mut hx, mut hy, mut m) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (Displacement { x, y }, f) in PATTERN.iter().zip(values) {
            gx += x * f / 6.0;
            gy += y * f / 6.0;
            hx += (x * x - 2.0 / 3.0) * f;
            hy += (y * y - 2.0 / 3.0) * f;
            m += x * y * f / 4.0;
        }
        Self { gx, gy, hx, hy, m }
    }

    /// Its maximum, at most one step away in either direction; `None` where it has none.
    fn vertex(&self) -> Option<Displacement> {
        let Self { gx, gy, hx, hy, m } = *self;
        let determinant = hx * hy - m * m;
        if hx >= 0.0 || hy >= 0.0 || determinant <= 0.0 {
            return None;
        }
        let x = (m * gy - hy * gx) / determinant;
        let y = (m * gx - hx * gy) / determinant;
        Some(Displacement::new(x.clamp(-1.0, 1.0), y.clamp(-1.0, 1.0)))
    }

    /// Standard deviation of the vertex in the worse direction, steps, for a `variance` of each value and a peak that bends by no more than
    /// `steepest`; infinite where there is no vertex.
    fn deviation(&self, variance: f64, steepest: [f64; 2]) -> f64 {
        let Some(Displacement { x, y }) = self.vertex() else {
            return f64::INFINITY;
        };
        // The slopes have a variance of 1/6 of a value's, the curvatures of 2: the vertex is
        // minus their quotient.
        let along = |vertex: f64, curvature: f64| {
            (variance * (1.0 / 6.0 + 2.0 * vertex * vertex)).sqrt() / curvature.abs()
        };
        let [most_x, most_y] = steepest;
        along(x, self.hx.max(most_x)).max(along(y, self.hy.max(most_y)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_move_may_have_gone_too_far() {
        let of = Vertex {
            at: Displacement::new(-0.2, 0.0),
            deviation: 5e-9,
            by_light: None,
            elsewhere: [1e-9, 2e-9],
        };
        let [x, y] = of.moved_to(0.2e-6).elsewhere;
        assert!((x - 41e-9).abs() < 1e-12 && (y - 2e-9).abs() < 1e-12);
    }

    #[test]
    fn the_vertex_of_a_paraboloid_is_found_exactly() {
        let (x0, y0) = (0.31, -0.74);
        let values = PATTERN.map(|Displacement { x, y }| {
            5.0 - 1.3 * (x - x0).powi(2) - 0.7 * (y - y0).powi(2) + 0.4 * (x - x0) * (y - y0)
        });
        let Displacement { x, y } = Paraboloid::fit(&values).vertex().unwrap();
        assert!((x - x0).abs() < 1e-12 && (y - y0).abs() < 1e-12, "{x} {y}");
    }

    #[test]
    fn what_both_ways_differ_by_is_no_noise() {
        let spot = Spot {
            background: 0.35,
            squared_widths: [4e-12; 2],
        };
        let mut seen = Patterns::default();
        for k in 0..8 {
            let noise = if k % 4 < 2 { 1e-5 } else { -1e-5 };
            let brighter = 0.1 * f64::from(k);
            let aside = if k % 2 == 0 { 2e-3 } else { -2e-3 };
            seen.add(PATTERN.map(|p| {
                let bends = 2.5e-3 * (p.x * p.x + p.y * p.y);
                1.0 + brighter + (aside + noise) * p.x - bends
            }));
        }
        // Six points a pattern are off by ten microvolts. Of eight patterns either way has taken a mean, and each its own.
        let each = 8.0 * 6.0 * 1e-10 / (6.0 * 8.0);
        assert!((seen.variance() / (each / 8.0) - 1.0).abs() < 1e-6);
        let Vertex {
            at,
            deviation,
            elsewhere: [x, y],
            ..
        } = seen.vertex(&spot, 0.1e-6);
        assert!(at.norm() < 1e-9 && deviation < 1e-9, "{deviation}");
        // Either way sees the peak two fifths of a step aside.
        let left = TUNING.climb.mirrored * 0.4 * 0.1e-6;
        assert!((x / left - 1.0).abs() < 0.02 && y < 1e-12, "{x} {y}");
    }

    #[test]
    fn what_bends_otherwise_than_by_noise_was_seen_too_early() {
        let spot = Spot {
            background: 0.0,
            squared_widths: [4e-12; 2],
        };
        // A volt in a spot of 2 um bends by 5 mV over steps of 0.1 um; every other pattern is off by a tenth of that at two points.
        let seen = |bend: f64| {
            let mut seen = Patterns::default();
            for k in 0..8 {
                let noise = if k % 4 < 2 { 0.5e-3 } else { -0.5e-3 };
                seen.add(PATTERN.map(|p| {
                    let off = if p.y == 0.0 { noise * p.x } else { 0.0 };
                    1.0 + off - 0.5 * bend * (p.x * p.x + p.y * p.y)
                }));
            }
            seen.vertex(&spot, 0.1e-6)
        };
        assert_eq!(seen(5e-3).by_light, None);
        let told = seen(10e-3).by_light.unwrap();
        assert!(told > 0.0 && told < 5e-9, "{told}");
        assert!(seen(2.5e-3).by_light.is_some());
    }

    #[test]
    fn what_drifts_goes_on() {
        let spot = Spot {
            background: 0.0,
            squared_widths: [4e-12; 2],
        };
        let mut seen = Patterns::default();
        for k in 0..20 {
            let peak = 0.01 * f64::from(k);
            seen.add(PATTERN.map(|p| 1.0 - 2.5e-3 * ((p.x - peak).powi(2) + p.y * p.y)));
        }
        let of = seen.vertex(&spot, 0.1e-6);
        let behind = 0.1e-6 * (0.19 - of.at.x);
        assert!((of.elsewhere[0] / behind - 1.0).abs() < 0.1, "{behind}");
    }

    #[test]
    fn a_slope_has_no_vertex_and_a_far_one_is_bounded() {
        assert_eq!(
            Paraboloid::fit(&PATTERN.map(|Displacement { x, y }| x + 2.0 * y)).vertex(),
            None
        );
        let far = PATTERN.map(|Displacement { x, y }| -(x - 5.0).powi(2) - y * y);
        let Displacement { x, y } = Paraboloid::fit(&far).vertex().unwrap();
        assert!(x >= 1.0 && y.abs() < 1e-12, "{x} {y}");
    }

    #[test]
    fn the_predicted_deviation_is_that_of_repeated_fits() {
        // A small generator will do: only its spread matters here.
        let mut state = 1_u64;
        let mut noise = || {
            // Sum of twelve uniform numbers: normal enough, with unit variance.
            (0..12).fold(-6.0, |sum, _| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                sum + (state >> 33) as f64 / f64::from(1_u32 << 31)
            })
        };
        let sigma = 0.02;
        let (n, mut squares, mut predicted) = (2000, 0.0, 0.0);
        for _ in 0..n {
            let values = PATTERN.map(|Displacement { x, y }| {
                -(x - 0.3_f64).powi(2) - (y + 0.2_f64).powi(2) + sigma * noise()
            });
            let fit = Paraboloid::fit(&values);
            squares += (fit.vertex().unwrap().x - 0.3).powi(2);
            predicted += fit.deviation(sigma * sigma, [f64::NEG_INFINITY; 2]);
        }
        let measured = (squares / f64::from(n)).sqrt();
        let predicted = predicted / f64::from(n);
        assert!(
            (measured / predicted - 1.0).abs() < 0.1,
            "{measured} for {predicted}"
        );
    }

    #[test]
    fn noise_that_looks_like_a_steep_peak_is_none() {
        // A volt of light in a spot of 2 um: over steps of 0.1 um it bends by 5 mV.
        let spot = Spot {
            background: 0.2,
            squared_widths: [4e-12; 2],
        };
        let bend = |by: f64| PATTERN.map(|Displacement { x, y }| 1.2 - 0.5 * by * (x * x + y * y));
        let deviation = |light: [f64; 9]| {
            Paraboloid::fit(&light).deviation(1e-6, spot.curvatures(&light, 0.1e-6))
        };
        let (as_wide, noisy) = (deviation(bend(5e-3)), deviation(bend(50e-3)));
        assert!((noisy / as_wide - 1.0).abs() < 0.05, "{noisy} {as_wide}");
        assert!(deviation(bend(2.5e-3)) > 1.9 * as_wide);
    }
}
