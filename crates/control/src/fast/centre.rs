//! From first light to the peak in the middle of circles, with the macro standing so that the micro reaches it to the end.

use super::Shared;
use super::approach_moves::Aim;
use crate::beam::Peak;
use crate::cell::AlignmentCell;
use crate::conical_scan::{ConicalScan, Gap, Watch};
use crate::outcome::{Halt, Outcome};
use crate::station::coarse;
use crate::sweep::Spot;
use crate::tuning::TUNING;
use pigtail_hal::Side;
use pigtail_model::frames::Displacement;

/// A peak in the middle of circles.
struct Centred {
    peak: Peak,
    /// Whether its light had to be looked for.
    looked: bool,
}

impl<'r> Shared<'r> {
    /// From first light to the peak at the gap of the search. A spot that is none is passed by.
    pub(super) async fn centre(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        watch: Watch,
        spot: Spot,
    ) -> Result<(ConicalScan<'r>, f64), Halt> {
        let gap = aim.gap(cell);
        let at = spot.at - cell.wanted(aim.side).across();
        let mut scan = self.circles(cell, aim, watch, at);
        // What the micro will not reach, here or at the chip, the macro must.
        let room = scan.beam_width(gap);
        let handed_over = self
            .make_room(cell, aim, &mut scan, (room, f64::INFINITY), gap)
            .await?;
        let around = &self.fast.retry.around;
        let farther = if handed_over {
            &around[..]
        } else {
            &around[..1]
        };
        let peak = self
            .bring_within_reach(cell, aim, &mut scan, gap, (handed_over, farther))
            .await?;
        // A peak is brighter than what was seen of it in passing; a fluctuation is gone by now.
        let level = peak.full * cell.beam(aim.side, self.recipe).share(gap);
        let expected = TUNING.reach.seen * spot.level;
        if level < expected {
            return Err(Outcome::LightLost {
                phase: "centre",
                level,
                expected,
            }
            .into());
        }
        Ok((scan, peak.full))
    }

    /// Circles around a place of the micro, at the gap at which the tip is.
    pub(super) fn circles(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        watch: Watch,
        at: Displacement,
    ) -> ConicalScan<'r> {
        let (side, shape) = (aim.side, &self.fast.conical_scan);
        let (beam, walk) = (cell.beam(side, self.recipe), aim.walk(cell, self.exit()));
        let shaken = cell.measured_shaking(side);
        ConicalScan::new(watch, beam, shape, cell, (at, aim.gap(cell)), walk, shaken)
            .hiding(cell.hides(side))
            .settling(cell.settles(side))
            .flickering(cell.flicker())
    }

    /// Circles until the peak is in the middle, to `accuracy` metres, or not as near where a micro that swings does not come so near: nearer to
    /// the chip it is found anew.
    async fn circle_to(
        &self,
        cell: &AlignmentCell<'_>,
        scan: &mut ConicalScan<'_>,
        gap: f64,
        accuracy: f64,
    ) -> Result<Peak, Halt> {
        let mut accuracy = accuracy;
        for _ in 0..self.fast.retry.centre {
            match scan.centre(cell, gap, accuracy, "centre", 1).await {
                Err(Halt::Outcome(Outcome::Unsure { .. })) => accuracy *= self.fast.retry.wider,
                peak => return peak,
            }
        }
        scan.centre(cell, gap, accuracy, "centre", 1).await
    }

    /// Circles until the peak is in the middle, and the macro has taken over what the micro would not reach at the chip. It has `handed_over`
    /// something before, or has not; light that is not there is looked for on circles of so many widths of the peak.
    async fn bring_within_reach(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        gap: f64,
        (mut handed_over, mut farther): (bool, &[f64]),
    ) -> Result<Peak, Halt> {
        let width = scan.beam_width(gap);
        let (mut strays, mut step) = (false, 0);
        loop {
            step += 1;
            let peak = match self.find_peak(cell, aim, scan, gap, farther).await {
                Ok(Centred { peak, looked }) => {
                    strays |= handed_over && looked;
                    Some(peak)
                }
                // Circles have followed the light to where the micro does not go.
                Err(Halt::Outcome(Outcome::MicroRange { x, y, .. }))
                    if step < TUNING.reach.steps =>
                {
                    scan.expect_at(Displacement::new(x, y), gap);
                    strays = true;
                    None
                }
                Err(halt) => return Err(halt),
            };
            // A macro that has not gone where it was told to goes on in steps that do not lose the light.
            let most = if strays {
                TUNING.reach.step * width
            } else {
                f64::INFINITY
            };
            let room = (0.5 * width, most);
            handed_over =
                step < TUNING.reach.steps && self.make_room(cell, aim, scan, room, gap).await?;
            farther = &self.fast.retry.around;
            if let (Some(peak), false) = (peak, handed_over) {
                return Ok(peak);
            }
        }
    }

    /// Circles until the peak is in the middle. Where there is no light it is looked for farther and farther out around where it was to be, on
    /// circles of so many widths of the peak.
    async fn find_peak(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        gap: f64,
        farther: &[f64],
    ) -> Result<Centred, Halt> {
        let coarse = TUNING.circle.near * scan.beam_width(gap);
        let expected = scan.place(gap);
        let mut lost = match self.circle_to(cell, scan, gap, coarse).await {
            Err(halt @ Halt::Outcome(Outcome::LightLost { .. })) => halt,
            peak => {
                return Ok(Centred {
                    peak: peak?,
                    looked: false,
                });
            }
        };
        for radius in farther {
            scan.expect_at(expected, gap);
            let out = radius * scan.beam_width(gap);
            if !reaches_around(cell, aim.side, expected, out, 1.0) {
                break;
            }
            if !scan.look_around(cell, gap, *radius).await? {
                continue;
            }
            // It may have been noise.
            lost = match self.circle_to(cell, scan, gap, coarse).await {
                Err(halt @ Halt::Outcome(Outcome::LightLost { .. })) => halt,
                peak => {
                    return Ok(Centred {
                        peak: peak?,
                        looked: true,
                    });
                }
            };
        }
        Err(lost)
    }

    /// Hands over to the macro what the micro would not reach, here or at the chip, with a circle
    /// of `room` metres around it; `most` metres of the way. Returns whether it was so.
    async fn make_room(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        (room, most): (f64, f64),
        gap: f64,
    ) -> Result<bool, Halt> {
        let (at, end) = (scan.place(gap), scan.place(self.recipe.approach.gap));
        let reached = [at, end]
            .into_iter()
            .all(|at| reaches_around(cell, aim.side, at, room, TUNING.reach.sure));
        if !reached {
            let middle = (at + end) * 0.5;
            let share = (most / middle.norm()).min(1.0);
            hand_over(cell, scan, aim.side, middle * share, gap).await?;
        }
        Ok(!reached)
    }
}

/// Whether a micro reaches all of a circle of `radius` metres around a displacement within so much of its range.
fn reaches_around(
    cell: &AlignmentCell<'_>,
    side: Side,
    at: Displacement,
    radius: f64,
    share: f64,
) -> bool {
    [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
        .into_iter()
        .all(|(x, y)| {
            let by = Displacement::new(x, y) * radius;
            cell.micro_reaches(side, (at + by) / share)
        })
}

/// The macro goes aside and comes to rest there, while the micro stays in its
/// scan.
pub(super) async fn hand_over(
    cell: &AlignmentCell<'_>,
    scan: &mut ConicalScan<'_>,
    side: Side,
    by: Displacement,
    gap: f64,
) -> Result<(), Halt> {
    let goal = cell.wanted(side).moved(by);
    let before = cell.endpoint(side);
    cell.start_line(side, goal, None)?;
    let place = scan.place(gap);
    if !cell.micro_reaches(side, place) {
        // Where the micro does not get to yet it need not wait.
        cell.stands(side).await?;
        cell.wait(TUNING.reach.rest).await?;
        scan.hand_over(cell.endpoint(side).across() - before.across());
        return Ok(());
    }
    scan.begin_aside(cell, coarse(side));
    let aside = Gap::Aside(gap, coarse(side));
    while cell.is_moving(side) {
        scan.step(cell, aside, f64::INFINITY).await?;
    }
    scan.run(cell, aside, TUNING.reach.rest).await?;
    scan.hand_over(cell.endpoint(side).across() - before.across());
    scan.end_aside();
    Ok(())
}
