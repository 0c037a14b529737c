//! Climbing to the maximum of the light with the micro (thesis 3.3).

mod patterns;

pub use patterns::{Spot, Vertex};

use patterns::Patterns;

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

/// How the nine points are visited.
#[derive(Debug, Clone, Copy)]
enum Way {
    Forth,
    Back,
    /// Each opposite to where it is.
    Mirrored,
}

/// Which point lies opposite to one of the nine.
const fn across(k: usize) -> usize {
    if k == 0 { 0 } else { (k + 3) % 8 + 1 }
}

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

    /// Visits the nine points around the centre one way or another; the light at each after
    /// `dwell` seconds, volts.
    async fn pattern(
        &self,
        cell: &AlignmentCell<'_>,
        dwell: f64,
        way: Way,
    ) -> Result<[f64; 9], Halt> {
        let centre = self.centre;
        let mut light = [0.0; 9];
        for k in 0..PATTERN.len() {
            let k = match way {
                Way::Forth => k,
                Way::Back => PATTERN.len() - 1 - k,
                Way::Mirrored => across(k),
            };
            cell.move_micro(self.side, centre + PATTERN[k] * self.step)?;
            // A dwell shorter than the photodiode's period waits for it.
            light[k] = cell.last_light(self.channel, dwell).await?;
        }
        Ok(light)
    }

    /// One pattern, and the move to its brightest point.
    ///
    /// # Errors
    ///
    /// A fault, or [`Outcome::MicroRange`] when the micro has come to the end of its range.
    pub async fn step(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let light = self.pattern(cell, self.climb.dwell, Way::Forth).await?;
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
    /// and moves there. At least `patterns` of them, unless the climb's timeout comes first. Returns how well the peak is known:
    /// patterns tell of what drifts, and of what has not come to rest.
    ///
    /// They go around two ways, as often either. How far a micro is from a point that it has not come to rest at follows from the points before. Of
    /// one that nobody has measured they go to and fro: what lags is as far before a point on one way as beyond it on the other. One that
    /// rings is left up to 66 nm aside by that (200 Hz, damped by 0.07); where it was measured by when it comes to rest it is given time at each
    /// point, and the second way is the first one mirrored at the centre, whose points leave it as far on the other side.
    ///
    /// The thesis rests on the brightest of nine noisy points. Close to the peak those differ by
    /// less than the photodiode's noise, so that the last centre is a draw from a cloud as wide
    /// as a step; the vertex is not. Noise bends a paraboloid too, and of many tries in dim light one looks as steep as a peak that is known
    /// well: no peak is held for steeper than its light allows, in a spot as wide as it should be (`spot`).
    ///
    /// # Errors
    ///
    /// As [`Self::step`], and [`Outcome::Unsure`] when the time was over first.
    pub async fn settle(
        &mut self,
        cell: &AlignmentCell<'_>,
        patterns: u32,
        accuracy: f64,
        spot: &Spot,
    ) -> Result<Vertex, Halt> {
        let end = cell.now() + self.climb.timeout;
        self.step = self.climb.step;
        // What the climb's last step has left is no part of it.
        let rest = cell.settling(self.side);
        cell.wait(rest).await?;
        // Where a micro takes longer to come to rest at each point there are as many fewer, for piezos creep meanwhile.
        let (dwell, second) = if cell.settles(self.side) {
            let rests = TUNING.climb.rests * rest;
            (self.climb.dwell.max(rests), Way::Mirrored)
        } else {
            (self.climb.dwell, Way::Back)
        };
        let patterns = (f64::from(patterns) * self.climb.dwell / dwell).ceil() as u32;
        let patterns = patterns.max(4);
        let mut seen = Patterns::default();
        let found = loop {
            for way in [Way::Forth, second] {
                seen.add(self.pattern(cell, dwell, way).await?);
            }
            let late = cell.now() > end;
            if seen.count() < patterns && !late {
                continue;
            }
            let of = seen.vertex(spot, self.step);
            if of.deviation < accuracy {
                self.shift(cell, of.at)?;
                if of.at.norm() < TUNING.climb.near || late {
                    break of;
                }
                // A piezo without a model makes two thirds of so long a way: look once more.
                seen = Patterns::default();
                continue;
            }
            if seen.count() >= TUNING.climb.restart * patterns {
                // Averaged for so long the place has moved on, for piezos creep: what is left of
                // the averages is a better centre to begin again from.
                self.shift(cell, of.at)?;
                seen = Patterns::default();
            }
            if late {
                return Err(Outcome::Unsure {
                    deviation: of.deviation,
                    accuracy,
                }
                .into());
            }
        };
        cell.wait(rest.max(5.0 * self.climb.dwell)).await?;
        Ok(found)
    }
}

fn brightest(light: &[f64; 9]) -> usize {
    // The first of equals: with nothing to tell them apart, stay at the centre.
    (1..9).fold(0, |best, i| if light[i] > light[best] { i } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_across_are_mirrored() {
        for k in 0..PATTERN.len() {
            assert_eq!(PATTERN[across(k)], PATTERN[k] * -1.0);
        }
    }
}
