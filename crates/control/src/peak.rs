//! Climbing to the maximum of the light with the micro (thesis 3.3).

mod patterns;

pub use patterns::{Spot, Vertex};

use patterns::Patterns;

use crate::cell::AlignmentCell;
use crate::outcome::{Halt, Outcome};
use crate::recipe::{Climb, Last};
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

/// Of fewer patterns, half of them on either way, nobody could say how they scatter.
const FEWEST: u32 = 4;

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

    /// Visits the nine points around the centre, or the same way `mirrored` at the centre; the light at each after
    /// `dwell` seconds, volts.
    async fn pattern(
        &self,
        cell: &AlignmentCell<'_>,
        dwell: f64,
        mirrored: bool,
    ) -> Result<[f64; 9], Halt> {
        let centre = self.centre;
        let mut light = [0.0; 9];
        for k in 0..PATTERN.len() {
            let k = if mirrored { across(k) } else { k };
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
        let light = self.pattern(cell, self.climb.dwell, false).await?;
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
    /// their means is known to `last.accuracy` metres (one standard deviation, in either direction),
    /// and moves there; then looks once more, and again until what is known of the peak is `enough` or the climb's timeout is over. Returns how well
    /// it is known: patterns tell of what drifts, of what has not come to rest, and of what the last look has moved by.
    ///
    /// Every other pattern is mirrored at its centre. How far a micro is from a point where it has not come to rest follows from the points
    /// before, so that mirrored ones leave it as far on the other side, and no peak is seen aside. But what is seen nearer than it was told to be, or
    /// farther out, or turned, makes a vertex too near or too far: a look tells how far the one before was off. A micro is given time at each
    /// point where it was measured by when it comes to rest, and twice as much on each further look, as long as four patterns take no longer than
    /// the recipe's.
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
        last: &Last,
        spot: &Spot,
        enough: impl Fn(&Vertex) -> bool,
    ) -> Result<Vertex, Halt> {
        let end = cell.now() + self.climb.timeout;
        self.step = self.climb.step;
        // What the climb's last step has left is no part of it.
        let rest = cell.settling(self.side);
        cell.wait(rest).await?;
        let rests = if cell.settles(self.side) {
            TUNING.climb.rests * rest
        } else {
            0.0
        };
        let mut dwell = self.climb.dwell.max(rests);
        // Two looks take as long as the recipe's patterns. Where the tip has longer at each point there are as many fewer, for piezos creep meanwhile:
        // so few that they can be told from noise, in the end.
        let time = f64::from(last.patterns) * self.climb.dwell;
        let longest = dwell.max(time / f64::from(FEWEST));
        let mut seen = Patterns::default();
        let mut looked = false;
        let found = loop {
            for mirrored in [false, true] {
                seen.add(self.pattern(cell, dwell, mirrored).await?);
            }
            let late = cell.now() > end;
            let patterns = ((0.5 * time / dwell).ceil() as u32).max(FEWEST);
            let least = if late { FEWEST } else { patterns };
            if seen.count() < least {
                continue;
            }
            let of = seen.vertex(spot, self.step);
            let known = of.deviation < last.accuracy;
            let slower = (2.0 * dwell).min(longest);
            let seen_too_early =
                slower > dwell && of.by_light.is_some_and(|told| told < last.accuracy);
            if !known && late {
                return Err(Outcome::Unsure {
                    deviation: of.deviation,
                    accuracy: last.accuracy,
                }
                .into());
            }
            // Averaged for too long the place has moved on, for piezos creep: what is left of the averages is a better centre to begin again from.
            let too_long = f64::from(seen.count()) * dwell >= TUNING.climb.restart * time;
            if !known && !seen_too_early && !too_long {
                continue;
            }
            self.shift(cell, of.at)?;
            if known {
                let there = of.moved_to(self.step);
                if looked && (late || enough(&there)) {
                    break there;
                }
                looked = true;
            }
            dwell = slower;
            seen = Patterns::default();
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
