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
//! the light brighter or darker and the spot no wider. Encoders say how far it is from one gap to the next.
//!
//! What is known already need not be sought. How light spreads, `lambda / 2 pi` in the micro's own scale, is the same for all
//! fibers of a manipulator: once earlier fibers have told it, widths at two gaps tell where the vertex is, and the farther gap
//! need be no farther than that at which the squared width is a third more, where there is yet light enough. And what vision
//! says beforehand counts as what it is: a gap that is anywhere within a bound.

mod contact;

use crate::tuning::TUNING;
pub use contact::{Contact, Known, Spread, contact};
use nalgebra::{SMatrix, SVector, Vector2};
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::Normal;

/// Squared widths of the spot at one gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Width {
    /// The gap by encoders, of which only what is the same at all gaps is wrong, metres.
    pub at: f64,
    /// Squares of the distances at which the light has fallen to 1/e, in x and in y, square metres of the
    /// micro's own scale.
    pub squared: [f64; 2],
    /// Standard deviations of both.
    pub deviation: [f64; 2],
    /// Half of the curvature between x and y of the light's logarithm, less than zero, and its standard deviation; per
    /// square metre.
    pub askew: (f64, f64),
    /// By how much its rounds differed.
    pub rounds: Rounds,
}

/// By how much the squares of widths differ from one round to the next beside noise: a laser wanders, scattered light flickers. As
/// seen at all gaps so far, for a look of a few rounds tells little of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rounds {
    /// Sum of squares, of the squares of widths.
    squares: f64,
    /// By so many degrees of freedom.
    degrees: f64,
}

impl Rounds {
    /// Takes in what others were seen to differ by.
    pub fn add(&mut self, other: Self) {
        self.squares += other.squares;
        self.degrees += other.degrees;
    }

    /// Variance of a round, as a share of the square of a width; `None` before enough rounds were seen.
    pub fn variance(&self) -> Option<f64> {
        let known = self.degrees >= TUNING.width.told;
        known.then(|| (self.squares / self.degrees).max(0.0))
    }
}

/// Light on circles around a peak.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Circles {
    /// Of every round, places from the middle of the circles (metres), and light above the background (volts).
    rounds: Vec<Vec<(Displacement, f64)>>,
}

/// A sample of a round as an equation of the spot's shape, beside what all samples of its round have in common.
type Equation = (SVector<f64, SHAPE>, f64, f64);

/// Unknowns of a spot's shape: two curvatures, and the one between them, for a lag turns the circle.
const SHAPE: usize = 3;

/// Unknowns of each round: brightness and two slopes.
const OWN: usize = 3;

impl Width {
    /// Whether both squares are known to a share of them.
    pub fn is_known_to(&self, share: f64) -> bool {
        let both = self.squared.iter().zip(&self.deviation);
        both.into_iter()
            .all(|(squared, deviation)| *deviation < share * squared)
    }
}

impl Circles {
    /// Begins a round on circles of several radii. Between rounds the light may become brighter or darker.
    pub fn begin_round(&mut self) {
        self.rounds.push(Vec::new());
    }

    /// Adds a sample to the round.
    pub fn add(&mut self, at: Displacement, volts: f64) {
        if self.rounds.is_empty() {
            self.begin_round();
        }
        if let Some(round) = self.rounds.last_mut() {
            round.push((at, volts));
        }
    }

    /// The width at a gap, by least squares, beginning with the squares of widths as they are `believed`; `noise` is the standard
    /// deviation of a sample (volts). Rounds too few to tell by how much they differ are believed to differ as others did `before`. `None` where there
    /// is too little light.
    pub fn width(&self, gap: f64, noise: f64, believed: [f64; 2], before: Rounds) -> Option<Width> {
        /// From the width that is believed to the one that is seen.
        const STEPS: usize = 6;
        let all = self.rounds.iter().flatten();
        let scale = all.map(|(at, _)| at.norm()).fold(0.0, f64::max);
        let [x, y] = believed.map(|squared| -scale * scale / squared);
        let mut found = SVector::from([x, y, 0.0]);
        let mut rounds: Vec<_> = (self.rounds.iter())
            .filter_map(|samples| Round::of(samples, scale, &found, Vector2::zeros(), noise))
            .collect();
        let samples = |rounds: &[Round<'_>]| rounds.iter().map(|round| round.samples.len()).sum();
        let n: usize = samples(&rounds);
        if n < TUNING.width.least {
            return None;
        }
        let mut normal = Normal::<SHAPE>::default();
        for step in 0..=STEPS {
            if step > 0 {
                rounds = (rounds.iter())
                    .filter_map(|round| {
                        let slopes = round.slopes(&found);
                        Round::of(round.samples, scale, &found, slopes, noise)
                    })
                    .collect();
                if samples(&rounds) < n {
                    return None;
                }
            }
            normal = Normal::default();
            for (row, value, weight) in rounds.iter().flat_map(|round| &round.equations) {
                normal.add_weighted(row, *value, *weight);
            }
            found = normal.solve()?;
        }
        let covariance = normal.matrix.try_inverse()?;
        let left = |(row, value, _): &Equation| value - row.dot(&found);
        let rounds: Vec<_> = rounds.into_iter().map(|round| round.equations).collect();
        let squares = rounds.iter().flatten().map(|e| e.2 * left(e).powi(2));
        // So many samples say better than anybody how noisy they are...
        let each = squares.sum::<f64>() / (n - SHAPE - OWN * rounds.len()) as f64;
        let mut variances = covariance.diagonal() * each;
        let n = rounds.len() as f64;
        let share = |variances: &SVector<f64, SHAPE>, i: usize| variances[i] / found[i].powi(2);
        let mut apart = Rounds::default();
        if rounds.len() >= TUNING.width.rounds {
            // ...and rounds, how much of that does not average out within them: a laser wanders, scattered light flickers.
            let mut between = SMatrix::<f64, SHAPE, SHAPE>::zeros();
            for round in &rounds {
                let pulls = |sum: SVector<f64, SHAPE>, e: &Equation| sum + e.0 * (e.2 * left(e));
                let pulls = round.iter().fold(SVector::zeros(), pulls);
                between += pulls * pulls.transpose();
            }
            let between = (covariance * between * covariance * (n / (n - 1.0))).diagonal();
            let more = [0, 1].map(|i| n * (share(&between, i) - share(&variances, i)));
            apart = Rounds {
                squares: 0.5 * (n - 1.0) * (more[0] + more[1]),
                degrees: n - 1.0,
            };
            variances = variances.sup(&between);
        } else if let Some(variance) = before.variance() {
            for i in [0, 1] {
                variances[i] += found[i].powi(2) * variance / n;
            }
        }
        let of = |i: usize| {
            let curvature = -found[i];
            let squared = scale * scale / curvature;
            let deviation = variances[i].sqrt() / curvature;
            let deviation = deviation.hypot(TUNING.width.best) * squared;
            (curvature > 0.0).then_some((squared, deviation))
        };
        let (x, y) = (of(0)?, of(1)?);
        let halved = 0.5 / (scale * scale);
        Some(Width {
            at: gap,
            squared: [x.0, y.0],
            deviation: [x.1, y.1],
            askew: (
                -found[2] * halved,
                (variances[2].sqrt() * halved).hypot(TUNING.width.best / (x.0 * y.0).sqrt()),
            ),
            rounds: apart,
        })
    }
}

/// A round as equations of the light's logarithm.
struct Round<'a> {
    samples: &'a [(Displacement, f64)],
    /// Less what all of them have in common, and less both slopes: from one round to the next the spot may move.
    equations: Vec<Equation>,
    /// Brightness and slopes by the values, and by how much less for each term of the shape.
    own: SVector<f64, OWN>,
    by_shape: SMatrix<f64, OWN, SHAPE>,
}

impl<'a> Round<'a> {
    /// Around what the light is by a shape and the round's own slopes, and as bright as its samples have it: a sample then says how much more or
    /// less there is, and counts as much as there should be, whatever its noise. `None` where there is no light in it.
    fn of(
        samples: &'a [(Displacement, f64)],
        scale: f64,
        shape: &SVector<f64, SHAPE>,
        slopes: Vector2<f64>,
        noise: f64,
    ) -> Option<Self> {
        let shares = samples.iter().map(|(at, volts)| {
            let (slope, row) = rows(*at, scale);
            let share = slope.dot(&slopes) + row.dot(shape);
            (slope, row, share, share.exp(), *volts)
        });
        let (seen, squares) =
            shares
                .clone()
                .fold((0.0, 0.0), |(seen, squares), (_, _, _, share, volts)| {
                    (seen + share * volts, squares + share * share)
                });
        let full = seen / squares;
        // By noise the brightness is known to this.
        let is_light = full > TUNING.width.clear * noise / squares.sqrt();
        let mut normal = SMatrix::<f64, OWN, OWN>::zeros();
        let mut by_value = SVector::<f64, OWN>::zeros();
        let mut by_shape = SMatrix::<f64, OWN, SHAPE>::zeros();
        let mut equations = Vec::with_capacity(samples.len());
        for (slope, row, logarithm, share, volts) in shares {
            let light = full * share;
            let value = logarithm + (volts - light) / light;
            let weight = (light / noise).powi(2);
            let own = slope.insert_row(0, 1.0);
            normal += own * own.transpose() * weight;
            by_value += own * (value * weight);
            by_shape += own * row.transpose() * weight;
            equations.push((row, value, weight));
        }
        let fits = |e: &Equation| e.1.is_finite() && e.2 > 0.0;
        if !is_light || !equations.iter().all(fits) {
            return None;
        }
        let inverse = normal.try_inverse()?;
        let (own, by_shape) = (inverse * by_value, inverse * by_shape);
        for (equation, (at, _)) in equations.iter_mut().zip(samples) {
            let each = rows(*at, scale).0.insert_row(0, 1.0);
            equation.0 -= by_shape.tr_mul(&each);
            equation.1 -= own.dot(&each);
        }
        Some(Self {
            samples,
            equations,
            own,
            by_shape,
        })
    }

    /// Both slopes beside a shape.
    fn slopes(&self, shape: &SVector<f64, SHAPE>) -> Vector2<f64> {
        let own = self.own - self.by_shape * shape;
        Vector2::new(own[1], own[2])
    }
}

/// The terms of a spot at a place: those of its slopes, and of its shape.
fn rows(at: Displacement, scale: f64) -> (Vector2<f64>, SVector<f64, SHAPE>) {
    let Displacement { x, y } = at / scale;
    (Vector2::new(x, y), SVector::from([x * x, y * y, x * y]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    /// Modes (guide in x and y, fiber), micro's scale, a vertex, noise, and by how much a lag turns the circles.
    #[derive(Clone, Copy)]
    struct Truth {
        modes: [f64; 3],
        scale: f64,
        vertex: f64,
        noise: f64,
        turned: f64,
    }

    const ROUND: Truth = Truth {
        modes: [2.5e-6; 3],
        scale: 1.0,
        vertex: 0.0,
        noise: 0.0,
        turned: 0.0,
    };

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
                        let angle = TAU * f64::from(k % 12) / 12.0;
                        let at = Displacement::polar(radius, angle);
                        let there = Displacement::polar(radius * self.scale, angle - self.turned);
                        let there = there + Displacement::new(0.1e-6, -0.05e-6);
                        if k % 48 == 0 {
                            spot.begin_round();
                        }
                        let off = there.x * there.x / w[0] + there.y * there.y / w[1];
                        spot.add(at, peak * (-off).exp() + self.noise * normal());
                    }
                    spot.width(*gap, self.noise.max(1e-6), [7e-12; 2], Rounds::default())
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

    /// What is known beforehand where next to nothing is.
    const VAGUELY: Known = Known {
        squared: [6e-12; 2],
        spread: Spread {
            length: [1.3e-6 / TAU; 2],
            deviation: [0.5; 2],
            correlation: 0.0,
        },
        at: 0.0,
        bound: 6e-6,
        sigma: 0.3e-6,
        hidden: 0.07e-6,
    };

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
                    ..ROUND
                };
                let widths = truth.widths(&GAPS_SEEN, || 0.0);
                let found = contact(&widths, &VAGUELY).expect("a vertex");
                assert!((found.at - vertex).abs() < 30e-9, "{found:?} for {vertex}");
                let length = 1.3e-6 / TAU / (scale * scale);
                for (length, found) in [length; 2].iter().zip(found.spread.length) {
                    assert!((found / length - 1.0).abs() < 2e-3, "{found} for {length}");
                }
            }
        }
    }

    /// A resting fiber or a chip that warms takes the spot along: a micrometre while a width is looked for in much noise.
    #[test]
    fn a_spot_that_moves_from_round_to_round_is_as_wide() {
        let seen = |moves: f64| {
            let mut spot = Circles::default();
            for k in 0..100 {
                spot.begin_round();
                for j in 0..24 {
                    let radius = if j < 12 { 0.8e-6 } else { 2.8e-6 };
                    let at = Displacement::polar(radius, TAU * f64::from(j % 12) / 12.0);
                    let off = at + Displacement::new(0.8, -0.6) * (moves * f64::from(k) / 99.0);
                    let light = (-off.x * off.x / 4e-12 - off.y * off.y / 9e-12).exp();
                    spot.add(at, 3.0 * light);
                }
            }
            spot.width(0.0, 1e-3, [6e-12; 2], Rounds::default())
                .expect("there is light")
        };
        let (still, moved) = (seen(0.0), seen(1e-6));
        for (seen, wide) in still.squared.iter().zip([4e-12, 9e-12]) {
            assert!((seen / wide - 1.0).abs() < 1e-6, "{still:?}");
        }
        for i in 0..2 {
            assert!((moved.squared[i] / still.squared[i] - 1.0).abs() < 1e-6);
            assert!(moved.deviation[i] < 1.01 * still.deviation[i], "{moved:?}");
        }
    }

    /// Half a micrometre off where the spot is oblong, were the circle believed to be where it was told to go.
    #[test]
    fn a_circle_that_is_turned_by_a_lag_does_not_move_the_vertex() {
        for (modes, turned) in [
            ([2.5e-6; 3], 0.2),
            ([4.2e-6, 2.6e-6, 2.4e-6], 0.3),
            ([2.4e-6, 3.6e-6, 2.7e-6], -0.2),
        ] {
            let truth = Truth {
                modes,
                turned,
                vertex: 0.7e-6,
                ..ROUND
            };
            let widths = truth.widths(&GAPS_SEEN, || 0.0);
            let found = contact(&widths, &VAGUELY).expect("a vertex");
            assert!((found.at - 0.7e-6).abs() < 50e-9, "{found:?} for {modes:?}");
        }
    }

    /// Light that is dim on the wide circle.
    #[test]
    fn noise_makes_no_spot_wider() {
        let truth = Truth {
            noise: 60e-3,
            ..ROUND
        };
        let expected = ROUND.widths(&[6e-6], || 0.0)[0];
        let (mut sum, n) = (0.0, 400);
        for seed in 0..n {
            let widths = truth.widths(&[6e-6], normal(seed * 7919 + 3));
            sum += widths[0].squared[0] / expected.squared[0] - 1.0;
        }
        let mean = sum / n as f64;
        assert!(mean.abs() < 3e-3, "{mean}");
    }

    /// A spot narrow in y whose light is as dim on the wide circle as twice its noise.
    #[test]
    fn a_narrow_spot_of_dim_light_has_a_width() {
        let modes = [2.6e-6, 1.5e-6, 2.2e-6];
        let dim = Truth {
            modes,
            noise: 0.13,
            ..ROUND
        };
        let expected = Truth { modes, ..ROUND }.widths(&[6e-6], || 0.0)[0];
        let mut within = 0;
        for seed in 0..100 {
            let width = dim.widths(&[6e-6], normal(seed * 7919 + 3))[0];
            assert!(width.is_known_to(0.12), "{seed}: {width:?}");
            for i in 0..2 {
                let off = (width.squared[i] - expected.squared[i]).abs() / width.deviation[i];
                assert!(off < 6.0, "{seed}: {width:?} for {expected:?}");
                within += u32::from(off < 2.0);
            }
        }
        // Four rounds say roughly how much they differ.
        assert!(within > 160, "{within} of 200");
    }

    /// How far off it is, how far it is said to be, and how well the first one of these is known: root mean squares of many, metres.
    fn off_and_stated(gaps: &[f64], known: &Known, noise: f64) -> (f64, f64) {
        let (mut squares, mut stated, n) = (0.0, 0.0, 300);
        for seed in 0..n {
            let truth = Truth {
                modes: [2.6e-6, 2.4e-6, 2.5e-6],
                vertex: 0.7e-6,
                noise,
                ..ROUND
            };
            let widths = truth.widths(gaps, normal(seed * 7919 + 3));
            let found = contact(&widths, known).expect("a vertex");
            squares += (found.at - truth.vertex).powi(2);
            stated += found.deviation * found.deviation;
        }
        let root = |sum: f64| (sum / n as f64).sqrt();
        (root(squares), root(stated))
    }

    #[test]
    fn it_is_as_far_off_as_its_deviation_says() {
        // By noise beside which it is little what a piezo may do. Misfits that happen to be small are not believed, so that it is
        // stated a little too large.
        let (off, stated) = off_and_stated(&GAPS_SEEN, &VAGUELY, 30e-3);
        assert!((0.75..1.1).contains(&(off / stated)), "{off} {stated}");
        // By little noise, beside which that counts.
        let (off, stated) = off_and_stated(&GAPS_SEEN, &VAGUELY, 5e-3);
        assert!(off < stated && stated < 0.3e-6, "{off} {stated}");
    }

    /// A third of the light, a fifth of the way: what it takes five gaps to tell without it.
    #[test]
    fn two_gaps_tell_it_where_the_spread_is_known() {
        let gaps = [1e-6, 18e-6];
        let spread = |deviation: f64| Known {
            spread: Spread {
                deviation: [deviation; 2],
                ..VAGUELY.spread
            },
            ..VAGUELY
        };
        let (off, stated) = off_and_stated(&gaps, &spread(0.01), 20e-3);
        assert!(off < 1.1 * stated && stated < 0.35e-6, "{off} {stated}");
        // A spread that is not known is no help, and is said to be none.
        let (off, stated) = off_and_stated(&gaps, &spread(0.3), 20e-3);
        assert!(off < stated && stated > 1e-6, "{off} {stated}");
    }

    /// Vision says within 1.5 um where it is; light that says it to 0.8 um leaves less than either.
    #[test]
    fn what_vision_says_counts_as_what_it_is() {
        let vision = Known {
            at: 0.2e-6,
            bound: 1.5e-6,
            sigma: 0.2e-6,
            ..VAGUELY
        };
        let gaps = [1e-6, 10e-6, 25e-6];
        let (alone, _) = off_and_stated(&gaps, &VAGUELY, 40e-3);
        let (off, stated) = off_and_stated(&gaps, &vision, 40e-3);
        assert!(off < 0.8 * alone, "{off} {alone}");
        assert!(off < 1.1 * stated && stated < 0.9e-6, "{off} {stated}");
    }

    /// Fibers that say it to a hundredth and differ by more are believed to differ.
    #[test]
    fn what_several_fibers_tell_is_as_sure_as_they_agree() {
        let told = |length: f64| Spread {
            length: [length; 2],
            deviation: [0.01; 2],
            correlation: 0.9,
        };
        let alike = Spread::of_all(&[told(0.2e-6), told(0.201e-6), told(0.2e-6)]).expect("three");
        assert!((0.2e-6..0.201e-6).contains(&alike.length[0]));
        assert!((0.005..0.01).contains(&alike.deviation[0]), "{alike:?}");
        // Less than each of them: another fiber differs along x and along y by itself.
        assert!((0.5..0.8).contains(&alike.correlation), "{alike:?}");
        let apart = Spread::of_all(&[told(0.19e-6), told(0.21e-6)]).expect("two");
        assert!(apart.deviation[0] > 0.04, "{apart:?}");
        assert_eq!(Spread::of_all(&[]), None);
    }

    #[test]
    fn what_is_no_spot_is_refused() {
        let widths = ROUND.widths(&GAPS_SEEN, || 0.0);
        assert_eq!(contact(&widths[..1], &VAGUELY), None);
        // Vision would be wrong by four micrometres.
        let sure = Known {
            at: 4e-6,
            bound: 1e-6,
            sigma: 0.1e-6,
            ..VAGUELY
        };
        assert_eq!(contact(&widths, &sure), None);
        let mut odd = widths.clone();
        for (k, width) in odd.iter_mut().enumerate() {
            width.deviation = width.squared.map(|squared| 1e-3 * squared);
            width.squared[0] *= 1.0 + 0.2 * (PI * k as f64).cos();
        }
        assert_eq!(contact(&odd, &VAGUELY), None);
        let nothing = Circles::default().width(5e-6, 5e-3, [7e-12; 2], Rounds::default());
        assert_eq!(nothing, None);
    }
}
