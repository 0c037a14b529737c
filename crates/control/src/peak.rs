//! Climbing to the maximum of the light with the micro (thesis 3.3).

use crate::cell::AlignmentCell;
use crate::outcome::{Halt, Outcome};
use crate::recipe::Climb;
use crate::tuning::TUNING;
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::Displacement;

/// The nine points in steps from the centre, each a neighbour of the one before (Fig. 3.5).
const PATTERN: [Displacement; 9] = [
    Displacement::new(0.0, 0.0),
    Displacement::new(1.0, 0.0),
    Displacement::new(1.0, 1.0),
    Displacement::new(0.0, 1.0),
    Displacement::new(-1.0, 1.0),
    Displacement::new(-1.0, 0.0),
    Displacement::new(-1.0, -1.0),
    Displacement::new(0.0, -1.0),
    Displacement::new(1.0, -1.0),
];

/// The corners of a square around its middle, `half` metres from it in x and in y.
pub(crate) fn corners(half: f64) -> [Displacement; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
        .map(|(x, y)| Displacement::new(x, y) * half)
}

/// A nine-point climb of one micro on one photodiode.
#[derive(Debug, Clone, Copy)]
pub struct NinePoint<'r> {
    climb: &'r Climb,
    side: Side,
    channel: Channel,
    /// The micro's displacement at the brightest point so far, metres.
    centre: Displacement,
    /// Distance of the points at present, metres.
    step: f64,
}

impl<'r> NinePoint<'r> {
    /// A climb that starts where the micro of `side` stands.
    pub fn new(climb: &'r Climb, cell: &AlignmentCell<'_>, side: Side, channel: Channel) -> Self {
        Self {
            climb,
            side,
            channel,
            centre: cell.micro(side),
            step: climb.step,
        }
    }

    /// Visits the nine points around the centre, or the same way `back`; the light at each, volts.
    async fn pattern(&self, cell: &AlignmentCell<'_>, back: bool) -> Result<[f64; 9], Halt> {
        let centre = self.centre;
        let mut light = [0.0; 9];
        for k in 0..PATTERN.len() {
            let k = if back { PATTERN.len() - 1 - k } else { k };
            cell.move_micro(self.side, centre + PATTERN[k] * self.step)?;
            // A dwell shorter than the photodiode's period waits for it.
            light[k] = cell.last_light(self.channel, self.climb.dwell).await?;
        }
        Ok(light)
    }

    /// One pattern, and the move to its brightest point.
    ///
    /// # Errors
    ///
    /// A fault, or [`Outcome::MicroRange`] when the micro has come to the end of its range.
    pub async fn step(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let light = self.pattern(cell, false).await?;
        let to = PATTERN[brightest(&light)];
        self.shift(cell, to)?;
        if let Some(widest) = self.climb.widest {
            let next = if to == Displacement::ZERO {
                0.5 * self.step
            } else {
                2.0 * self.step
            };
            self.step = next.min(widest).max(self.climb.step);
        }
        cell.wait(self.climb.pause).await?;
        Ok(())
    }

    /// Moves the centre by so many steps.
    fn shift(&mut self, cell: &AlignmentCell<'_>, steps: Displacement) -> Result<(), Outcome> {
        let to = self.centre + steps * self.step;
        let reach = 1.5 * self.step.max(self.climb.widest.unwrap_or(0.0));
        if corners(reach)
            .iter()
            .any(|corner| !cell.micro_reaches(self.side, to + *corner))
        {
            return Err(Outcome::MicroRange {
                side: self.side,
                x: to.x,
                y: to.y,
            });
        }
        cell.move_micro(self.side, to)?;
        self.centre = to;
        Ok(())
    }

    /// Climbs until the centre, averaged over some patterns, stays within a step, or the recipe's
    /// time is over.
    ///
    /// # Errors
    ///
    /// As [`Self::step`].
    pub async fn climb(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let end = cell.now() + self.climb.timeout;
        self.step = self.climb.widest.unwrap_or(self.climb.step);
        let mut centres: Vec<Displacement> = Vec::with_capacity(256);
        let mean = |points: &[Displacement]| {
            let sum = points.iter().fold(Displacement::ZERO, |sum, p| sum + *p);
            sum / points.len() as f64
        };
        while cell.now() < end {
            self.step(cell).await?;
            centres.push(self.centre);
            if centres.len() >= 2 * TUNING.climb.window {
                let (older, newer) = centres[centres.len() - 2 * TUNING.climb.window..]
                    .split_at(TUNING.climb.window);
                if (mean(older) - mean(newer)).norm() < self.climb.step {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Averages patterns around the present centre until the vertex of the paraboloid through
    /// their means is known to `accuracy` metres (one standard deviation, in either direction),
    /// and moves there. At least `patterns` of them, unless the climb's timeout comes first.
    ///
    /// Patterns go to and fro, as often either way: a micro that has not come to rest at a point is as far before it on one way as
    /// beyond it on the other.
    ///
    /// The thesis rests on the brightest of nine noisy points. Close to the peak those differ by
    /// less than the photodiode's noise, so that the last centre is a draw from a cloud as wide
    /// as a step; the vertex is not.
    ///
    /// # Errors
    ///
    /// As [`Self::step`], and [`Outcome::Unsure`] when the time was over first.
    pub async fn settle(
        &mut self,
        cell: &AlignmentCell<'_>,
        patterns: u32,
        accuracy: f64,
    ) -> Result<(), Halt> {
        let end = cell.now() + self.climb.timeout;
        self.step = self.climb.step;
        let mut mean = [0.0; 9];
        // Sum of squared deviations from the means, all points together.
        let (mut count, mut squares) = (0_u32, 0.0);
        loop {
            let light = self.pattern(cell, !count.is_multiple_of(2)).await?;
            count += 1;
            for (mean, volts) in mean.iter_mut().zip(light) {
                let deviation = volts - *mean;
                *mean += deviation / f64::from(count);
                squares += deviation * (volts - *mean);
            }
            let late = cell.now() > end;
            let both_ways = count.is_multiple_of(2);
            if (count < patterns.max(2) || !both_ways) && !late {
                continue;
            }
            let variance = squares / (9.0 * f64::from(count.max(2) - 1));
            let fit = Paraboloid::fit(&mean);
            let deviation = self.climb.step * fit.deviation(variance / f64::from(count));
            // In steps. Without a vertex the deviation would be infinite.
            let vertex = fit.vertex().unwrap_or_default();
            if deviation < accuracy {
                self.shift(cell, vertex)?;
                if vertex.norm() < TUNING.climb.near || late {
                    break;
                }
                // A piezo without a model makes two thirds of so long a way: look once more.
                (mean, count, squares) = ([0.0; 9], 0, 0.0);
                continue;
            }
            if count >= TUNING.climb.restart * patterns {
                // Averaged for so long the place has moved on, for piezos creep: what is left of
                // the averages is a better centre to begin again from.
                self.shift(cell, vertex)?;
                (mean, count, squares) = ([0.0; 9], 0, 0.0);
            }
            if late {
                return Err(Outcome::Unsure {
                    deviation,
                    accuracy,
                }
                .into());
            }
        }
        cell.wait(5.0 * self.climb.dwell).await?;
        Ok(())
    }
}

fn brightest(light: &[f64; 9]) -> usize {
    // The first of equals: with nothing to tell them apart, stay at the centre.
    (1..9).fold(0, |best, i| if light[i] > light[best] { i } else { best })
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

    /// Standard deviation of the vertex in the worse direction, steps, for a `variance` of each
    /// value; infinite where there is no vertex.
    fn deviation(&self, variance: f64) -> f64 {
        let Some(Displacement { x, y }) = self.vertex() else {
            return f64::INFINITY;
        };
        // The slopes have a variance of 1/6 of a value's, the curvatures of 2: the vertex is
        // minus their quotient.
        let along = |vertex: f64, curvature: f64| {
            (variance * (1.0 / 6.0 + 2.0 * vertex * vertex)).sqrt() / curvature.abs()
        };
        along(x, self.hx).max(along(y, self.hy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            predicted += fit.deviation(sigma * sigma);
        }
        let measured = (squares / f64::from(n)).sqrt();
        let predicted = predicted / f64::from(n);
        assert!(
            (measured / predicted - 1.0).abs() < 0.1,
            "{measured} for {predicted}"
        );
    }
}
