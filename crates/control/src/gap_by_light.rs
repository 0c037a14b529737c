//! Where the chip is along z, by how wide the spot of light is at some gaps.
//!
//! Two Gaussian modes that face each other over a gap `z` couple, so far aside, by a Gaussian whose squared
//! width is a parabola of the gap, whatever the radii of the modes:
//!
//! ```text
//! w^2(z) = S + (lambda z / 2 pi)^2 / S,    S half the sum of their squared radii
//! ```
//!
//! Its vertex is where fiber and guide touch. Neither the micro's scale, nor the modes' radii, nor the power
//! of the laser move it: all of them are unknowns of the fit. Nor does interference in the gap, which makes
//! the light brighter or darker and the spot no wider. Vision, whose fixed error no number of frames makes
//! smaller, is not asked; vision and encoders say how far it is from one gap to the next.

use nalgebra::{SVector, Vector2};
use pigtail_model::frames::Displacement;
use pigtail_numerics::golden::least;
use pigtail_numerics::normal::Normal;

/// Squared widths of the spot at one gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Width {
    /// The gap by vision and encoders, of which only what is the same at all gaps is wrong, metres.
    pub at: f64,
    /// Squares of the distances at which the light has fallen to 1/e, in x and in y, square metres of the
    /// micro's own scale.
    pub squared: [f64; 2],
    /// Standard deviations of both.
    pub deviation: [f64; 2],
}

/// Where fiber and chip touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The gap by vision and encoders there, metres.
    pub at: f64,
    /// Its standard deviation, metres.
    pub deviation: f64,
}

/// Light on circles around a peak.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Circles {
    /// Places from the middle of the circles (metres), and light above the background (volts).
    samples: Vec<(Displacement, f64)>,
}

/// A sample that is not so many times its noise tells nothing of a logarithm.
const CLEAR: f64 = 10.0;

/// Samples that a width is taken from, at least.
const LEAST: usize = 24;

/// Widths that a contact is taken from, at least: the parabolas have five unknowns.
const GAPS: usize = 4;

/// What a transmission may keep to itself of a way along z, standard deviation, metres: 0.2 um peak to peak are
/// what the thesis finds of its z-stage (2.4.3).
const HIDDEN: f64 = 0.07e-6;

/// No width is known better than to this share of its square: so well a piezo repeats its circles.
const BEST: f64 = 1e-4;

/// A misfit of so many times its noise is of a spot that is no Gaussian.
const MISSHAPEN: f64 = 5.0;

impl Width {
    /// Whether both squares are known to a share of them.
    pub fn is_known_to(&self, share: f64) -> bool {
        let both = self.squared.iter().zip(&self.deviation);
        both.into_iter()
            .all(|(squared, deviation)| *deviation < share * squared)
    }
}

impl Circles {
    /// Adds a sample.
    pub fn add(&mut self, at: Displacement, volts: f64) {
        self.samples.push((at, volts));
    }

    /// The width at a gap, by least squares of the light's logarithm; `noise` is the standard deviation of a
    /// sample (volts). `None` where there is too little light.
    pub fn width(&self, gap: f64, noise: f64) -> Option<Width> {
        /// Unknowns: level, two slopes, two curvatures, and the one between them, for a lag turns the circle.
        const N: usize = 6;
        let scale = self
            .samples
            .iter()
            .map(|(at, _)| at.norm())
            .fold(0.0, f64::max);
        let clear: Vec<_> = (self.samples.iter())
            .filter(|(_, volts)| *volts > CLEAR * noise)
            .map(|(at, volts)| {
                let Displacement { x, y } = *at / scale;
                let row = SVector::<f64, N>::from([1.0, x, y, x * x, y * y, x * y]);
                (row, volts.ln(), (volts / noise).powi(2))
            })
            .collect();
        if clear.len() < LEAST {
            return None;
        }
        let mut normal = Normal::<N>::default();
        for (row, value, weight) in &clear {
            normal.add_weighted(row, *value, *weight);
        }
        let found = normal.solve()?;
        let covariance = normal.matrix.try_inverse()?;
        let left: f64 = (clear.iter())
            .map(|(row, value, weight)| weight * (value - row.dot(&found)).powi(2))
            .sum();
        // So many samples say better than anybody how noisy they are.
        let worse = left / (clear.len() - N) as f64;
        let of = |i: usize| {
            let curvature = -found[i];
            let squared = scale * scale / curvature;
            let deviation = (covariance[(i, i)] * worse).sqrt() / curvature;
            let deviation = deviation.max(BEST) * squared;
            (curvature > 0.0).then_some((squared, deviation))
        };
        let (x, y) = (of(3)?, of(4)?);
        Some(Width {
            at: gap,
            squared: [x.0, y.0],
            deviation: [x.1, y.1],
        })
    }
}

/// Where the vertex of both parabolas lies, looked for within `range` (metres of that gap). `None` where
/// the widths are too few, lie at no vertex in the range, or are not those of such a spot.
pub fn contact(widths: &[Width], range: (f64, f64)) -> Option<Contact> {
    /// Far below what it can be known to, metres.
    const ACCURATE: f64 = 1e-10;
    /// A step in which its misfit curves, metres.
    const STEP: f64 = 0.1e-6;
    if widths.len() < GAPS {
        return None;
    }
    let misfit = |vertex: f64| misfit(widths, vertex);
    let at = least(range, ACCURATE, misfit);
    if (at - range.0).min(range.1 - at) < STEP {
        return None;
    }
    let here = misfit(at);
    let curvature = (misfit(at + STEP) - 2.0 * here + misfit(at - STEP)) / (STEP * STEP);
    let worse = (here / (2 * widths.len() - 5) as f64).max(1.0);
    if curvature <= 0.0 || !here.is_finite() || worse > MISSHAPEN * MISSHAPEN {
        return None;
    }
    let deviation = (2.0 / curvature * worse).sqrt().hypot(HIDDEN);
    Some(Contact { at, deviation })
}

/// Weighted squares of what parabolas around a vertex leave of the widths.
fn misfit(widths: &[Width], vertex: f64) -> f64 {
    /// Gaps are of this order: so that both columns are.
    const UNIT: f64 = 30e-6;
    let axis = |i: usize| {
        let rows = widths.iter().map(|width| {
            let away = (width.at - vertex) / UNIT;
            let weight = width.deviation[i].powi(-2);
            (Vector2::new(1.0, away * away), width.squared[i], weight)
        });
        let mut normal = Normal::<2>::default();
        for (row, value, weight) in rows.clone() {
            normal.add_weighted(&row, value, weight);
        }
        let Some(found) = normal.solve() else {
            return f64::INFINITY;
        };
        // A spot that becomes narrower away from the chip is none.
        if found[1] <= 0.0 {
            return f64::INFINITY;
        }
        rows.map(|(row, value, weight)| weight * (value - row.dot(&found)).powi(2))
            .sum::<f64>()
    };
    axis(0) + axis(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    /// Modes (guide in x and y, fiber), micro's scale, a vertex, noise.
    struct Truth {
        modes: [f64; 3],
        scale: f64,
        vertex: f64,
        noise: f64,
    }

    impl Truth {
        fn widths(&self, gaps: &[f64], mut normal: impl FnMut() -> f64) -> Vec<Width> {
            let [x, y, fiber] = self.modes;
            let s = [x, y].map(|guide| 0.5 * (guide * guide + fiber * fiber));
            gaps.iter()
                .map(|gap| {
                    let z = gap - self.vertex;
                    let w = s.map(|s| s + (1.3e-6 * z / TAU).powi(2) / s);
                    let peak = 3.0 * (s[0] * s[1] / (w[0] * w[1])).sqrt();
                    let mut spot = Circles::default();
                    for k in 0..192 {
                        let radius = if k % 24 < 12 { 0.8e-6 } else { 2.8e-6 };
                        let at = Displacement::polar(radius, TAU * f64::from(k % 12) / 12.0);
                        let there = at * self.scale + Displacement::new(0.1e-6, -0.05e-6);
                        let off = there.x * there.x / w[0] + there.y * there.y / w[1];
                        spot.add(at, peak * (-off).exp() + self.noise * normal());
                    }
                    spot.width(*gap, self.noise.max(1e-6))
                        .expect("there is light")
                })
                .collect()
        }
    }

    /// Sums of twelve uniform numbers, from a generator of the test's own.
    fn normal(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            (0..12).fold(-6.0, |sum, _| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                sum + (state >> 33) as f64 / f64::from(1_u32 << 31)
            })
        }
    }

    const GAPS_SEEN: [f64; 5] = [6e-6, 15e-6, 30e-6, 45e-6, 60e-6];

    #[test]
    fn the_vertex_is_where_they_touch_whatever_modes_and_scale() {
        for (modes, scale) in [
            ([2.6e-6, 2.4e-6, 2.5e-6], 1.0),
            ([4.5e-6, 2.5e-6, 2.5e-6], 1.1),
            ([2.0e-6, 3.0e-6, 2.2e-6], 0.9),
        ] {
            for vertex in [-1.8e-6, 0.0, 2.2e-6] {
                let truth = Truth {
                    modes,
                    scale,
                    vertex,
                    noise: 0.0,
                };
                let widths = truth.widths(&GAPS_SEEN, || 0.0);
                let found = contact(&widths, (-6e-6, 5e-6)).expect("a vertex");
                assert!((found.at - vertex).abs() < 1e-9, "{found:?} for {vertex}");
            }
        }
    }

    #[test]
    fn it_is_as_far_off_as_its_deviation_says() {
        let (mut squares, mut stated, n) = (0.0, 0.0, 300);
        for seed in 0..n {
            let truth = Truth {
                modes: [2.6e-6, 2.4e-6, 2.5e-6],
                scale: 1.0,
                vertex: 0.7e-6,
                noise: 5e-3,
            };
            let widths = truth.widths(&GAPS_SEEN, normal(seed * 7919 + 3));
            let found = contact(&widths, (-6e-6, 5e-6)).expect("a vertex");
            squares += (found.at - truth.vertex).powi(2);
            stated += found.deviation * found.deviation - HIDDEN * HIDDEN;
        }
        let ratio = (squares / stated).sqrt();
        // Misfits that happen to be small are not believed, so that it is stated a little too large.
        assert!((0.75..1.1).contains(&ratio), "{ratio}");
        assert!((stated / n as f64).sqrt() < 0.3e-6);
    }

    #[test]
    fn what_is_no_spot_is_refused() {
        let truth = Truth {
            modes: [2.5e-6; 3],
            scale: 1.0,
            vertex: 0.0,
            noise: 0.0,
        };
        let widths = truth.widths(&GAPS_SEEN, || 0.0);
        assert_eq!(contact(&widths[..3], (-6e-6, 5e-6)), None);
        assert_eq!(contact(&widths, (1e-6, 5e-6)), None);
        let mut odd = widths.clone();
        for (k, width) in odd.iter_mut().enumerate() {
            width.deviation = width.squared.map(|squared| 1e-3 * squared);
            width.squared[0] *= 1.0 + 0.2 * (PI * k as f64).cos();
        }
        assert_eq!(contact(&odd, (-6e-6, 5e-6)), None);
        assert_eq!(Circles::default().width(5e-6, 5e-3), None);
    }
}
