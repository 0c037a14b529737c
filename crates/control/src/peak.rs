//! Climbing to the maximum of the light with the micro (thesis 3.3).

use crate::outcome::{Halt, Outcome};
use crate::recipe::Climb;
use crate::station::Station;
use pigtail_hal::{Channel, Fault, Side};

/// The nine points in steps from the centre, each a neighbour of the one before (Fig. 3.5).
const PATTERN: [(f64, f64); 9] = [
    (0.0, 0.0),
    (1.0, 0.0),
    (1.0, 1.0),
    (0.0, 1.0),
    (-1.0, 1.0),
    (-1.0, 0.0),
    (-1.0, -1.0),
    (0.0, -1.0),
    (1.0, -1.0),
];

/// Patterns whose centres are averaged to judge whether a climb still gets anywhere.
const WINDOW: usize = 10;

/// A nine-point climb of one micro on one photodiode.
#[derive(Debug, Clone, Copy)]
pub struct NinePoint<'r> {
    climb: &'r Climb,
    side: Side,
    channel: Channel,
    /// The micro's displacement at the brightest point so far, metres.
    centre: (f64, f64),
}

impl<'r> NinePoint<'r> {
    /// A climb that starts where the micro of `side` stands.
    pub fn new(climb: &'r Climb, station: &Station, side: Side, channel: Channel) -> Self {
        Self {
            climb,
            side,
            channel,
            centre: station.micro(side),
        }
    }

    /// Visits the nine points around the centre; the light at each, volts.
    fn pattern(&self, station: &mut Station) -> Result<[f64; 9], Fault> {
        let centre = self.centre;
        let cycles = (self.climb.dwell * station.spec().servo.rate)
            .round()
            .max(1.0) as u64;
        let mut light = [0.0; 9];
        for ((dx, dy), light) in PATTERN.iter().zip(&mut light) {
            let step = self.climb.step;
            station.move_micro(self.side, centre.0 + dx * step, centre.1 + dy * step);
            let mut last = None;
            for _ in 0..cycles {
                station.cycle()?;
                last = station.light(self.channel).or(last);
            }
            // A dwell shorter than the photodiode's period waits for it.
            *light = match last {
                Some(volts) => volts,
                None => station.next_light(self.channel)?,
            };
        }
        Ok(light)
    }

    /// One pattern, and the move to its brightest point.
    ///
    /// # Errors
    ///
    /// A fault, or [`Outcome::OutOfReach`] when the micro has come to the end of its range.
    pub fn step(&mut self, station: &mut Station) -> Result<(), Halt> {
        let light = self.pattern(station)?;
        let mut best = 0;
        for (i, volts) in light.iter().enumerate() {
            if *volts > light[best] {
                best = i;
            }
        }
        self.shift(station, PATTERN[best])?;
        station.run(self.climb.pause)?;
        Ok(())
    }

    /// Moves the centre by so many steps.
    fn shift(&mut self, station: &mut Station, (dx, dy): (f64, f64)) -> Result<(), Outcome> {
        let (x, y) = (
            self.centre.0 + dx * self.climb.step,
            self.centre.1 + dy * self.climb.step,
        );
        let reach = 1.5 * self.climb.step;
        let corners = [
            (reach, reach),
            (reach, -reach),
            (-reach, reach),
            (-reach, -reach),
        ];
        let kinematics = station.kinematics(self.side);
        if corners
            .iter()
            .any(|(dx, dy)| !kinematics.micro_reaches(x + dx, y + dy))
        {
            return Err(Outcome::OutOfReach(format!(
                "the {} micro was to go to {:.1}, {:.1} um from its centre",
                self.side.name(),
                x * 1e6,
                y * 1e6
            )));
        }
        station.move_micro(self.side, x, y);
        self.centre = (x, y);
        Ok(())
    }

    /// Climbs until the centre, averaged over some patterns, stays within a step, or the recipe's
    /// time is over.
    ///
    /// # Errors
    ///
    /// As [`Self::step`].
    pub fn climb(&mut self, station: &mut Station) -> Result<(), Halt> {
        let end = station.time() + self.climb.timeout;
        let mut centres: Vec<(f64, f64)> = Vec::with_capacity(256);
        let mean = |points: &[(f64, f64)]| {
            let n = points.len() as f64;
            let sum = points
                .iter()
                .fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
            (sum.0 / n, sum.1 / n)
        };
        while station.time() < end {
            self.step(station)?;
            centres.push(self.centre);
            if centres.len() >= 2 * WINDOW {
                let (older, newer) = centres[centres.len() - 2 * WINDOW..].split_at(WINDOW);
                let (a, b) = (mean(older), mean(newer));
                if (a.0 - b.0).hypot(a.1 - b.1) < self.climb.step {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Averages `patterns` patterns around the present centre and moves to the vertex of the
    /// paraboloid through their means.
    ///
    /// The thesis rests on the brightest of nine noisy points. Close to the peak those differ by
    /// less than the photodiode's noise, so that the last centre is a draw from a cloud as wide
    /// as a step; the vertex is not.
    ///
    /// # Errors
    ///
    /// As [`Self::step`].
    pub fn settle(&mut self, station: &mut Station, patterns: u32) -> Result<(), Halt> {
        let mut sums = [0.0; 9];
        for _ in 0..patterns {
            let light = self.pattern(station)?;
            for (sum, volts) in sums.iter_mut().zip(light) {
                *sum += volts;
            }
        }
        self.shift(station, vertex(&sums))?;
        station.run(5.0 * self.climb.dwell)?;
        Ok(())
    }
}

/// The vertex of the paraboloid fitted to the nine values by least squares, in steps from the
/// centre, at most one step away. Where the values have no maximum, the brightest point.
fn vertex(values: &[f64; 9]) -> (f64, f64) {
    // Normal equations of f = c + gx x + gy y + hx x^2/2 + hy y^2/2 + m x y on a 3 x 3 grid.
    let (mut gx, mut gy, mut hx, mut hy, mut m) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for ((x, y), f) in PATTERN.iter().zip(values) {
        gx += x * f / 6.0;
        gy += y * f / 6.0;
        hx += (x * x - 2.0 / 3.0) * f;
        hy += (y * y - 2.0 / 3.0) * f;
        m += x * y * f / 4.0;
    }
    let determinant = hx * hy - m * m;
    if hx >= 0.0 || hy >= 0.0 || determinant <= 0.0 {
        let brightest = (0..9)
            .max_by(|&a, &b| values[a].total_cmp(&values[b]))
            .unwrap_or(0);
        return PATTERN[brightest];
    }
    let x = -(hy * gx - m * gy) / determinant;
    let y = -(hx * gy - m * gx) / determinant;
    (x.clamp(-1.0, 1.0), y.clamp(-1.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vertex_of_a_paraboloid_is_found_exactly() {
        let (x0, y0) = (0.31, -0.74);
        let values = PATTERN.map(|(x, y)| {
            5.0 - 1.3 * (x - x0).powi(2) - 0.7 * (y - y0).powi(2) + 0.4 * (x - x0) * (y - y0)
        });
        let (x, y) = vertex(&values);
        assert!((x - x0).abs() < 1e-12 && (y - y0).abs() < 1e-12, "{x} {y}");
    }

    #[test]
    fn a_slope_without_a_maximum_gives_its_brightest_point() {
        assert_eq!(vertex(&PATTERN.map(|(x, y)| x + 2.0 * y)), (1.0, 1.0));
        let far = PATTERN.map(|(x, y)| -(x - 5.0).powi(2) - y * y);
        assert_eq!(vertex(&far), (1.0, 0.0));
    }
}
