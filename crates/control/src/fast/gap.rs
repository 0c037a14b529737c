//! The gap between fiber and chip: by vision, and where that cannot know it well enough by light.

use super::approach_moves::Aim;
use super::{Shared, hand_over};
use crate::beam::Beam;
use crate::belief::{Across, UNSURE};
use crate::cell::AlignmentCell;
use crate::conical_scan::ConicalScan;
use crate::gap_by_light::{Width, contact};
use crate::outcome::Halt;
use crate::procedure::{outward, place_at};
use crate::tip_estimator::WARMS;
use pigtail_numerics::statistics::outside;

/// Standard deviation of the gap, in tolerances, at which the last turns begin...
const SURE_OF_GAP: f64 = 0.7;

/// ...or after so many seconds, whatever vision says...
const MOST_LOOKING: f64 = 0.3;

/// ...or that many, where it does not come to rest about a gap that is known as vaguely as that.
const MOST_DOUBTING: f64 = 2.0;

/// What is as good as in doubt, of the probability that is accepted: the gap will not be quite right.
const SPARE: f64 = 0.1;

/// What a gap is corrected by at least where that is in doubt, in tolerances.
const FINELY: f64 = 0.2;

/// Where the spot is looked at on the way, if the light is to say where the chip is: at gaps where its squared
/// width is so many times that at the chip, and one more.
const WIDER: [f64; 4] = [3.0, 1.8, 0.9, 0.3];

/// Turns until the macro stands still where it went aside: it may still come nearer by a count.
const STILL: u32 = 4;

/// How near the peak the middle of the circles is to be, in widths, after so many turns at most: the light leaves at an angle, so
/// that on one side of the peak the gap is longer. Half a width beside it, that makes the spot wider or narrower by 1 to 5 %
/// (squared).
const CENTRED: (f64, u32) = (0.05, 6);

/// How often all of them are looked at, until that tells where the chip is.
const PASSES: u32 = 2;

/// Standard deviations by which light and vision may differ beside vision's bound.
const FAR_OFF: f64 = 4.0;

impl Shared<'_> {
    /// From a gap at which there is no doubt to the chip; where vision could never know the gap, the spot's width is
    /// looked at on the way.
    pub(super) async fn come_close(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        before: f64,
    ) -> Result<(), Halt> {
        let beam = Beam::new(&self.recipe.mode, self.exit());
        let here = (self.recipe.approach.gap, 1);
        if self.vision_knows(cell) {
            return self.approach(cell, aim, scan, before, here).await;
        }
        cell.forget_told(aim.side);
        let mut widths = Vec::new();
        for _ in 0..PASSES {
            for share in WIDER {
                let gap = beam.gap_of(share);
                self.approach(cell, aim, scan, before, (gap, 1)).await?;
                widths.extend(width(cell, aim, scan).await?);
            }
            self.approach(cell, aim, scan, before, here).await?;
            widths.extend(width(cell, aim, scan).await?);
            if self.tell_contact(cell, aim, &widths) {
                break;
            }
        }
        Ok(())
    }

    /// Whether vision could ever know a gap well enough for a fiber to be attached.
    fn vision_knows(&self, cell: &AlignmentCell<'_>) -> bool {
        let tolerance = self.recipe.accept.gap;
        let (off, sigma) = (0.5 * self.fast.gap_tolerance, 0.5 * self.fast.gap_tolerance);
        let vision = &cell.spec().vision;
        outside(
            tolerance,
            off,
            vision.believed()[1],
            sigma.hypot(vision.facet_z),
        ) <= UNSURE
    }

    /// Whether a fiber would not be attached at this gap, for what is known of it.
    pub(super) fn doubts_gap(&self, cell: &AlignmentCell<'_>, aim: &Aim) -> bool {
        let wanted = self.recipe.approach.gap;
        let place = place_at(cell, aim.side, aim.port, wanted, Across::default());
        place.is_some_and(|place| place.outside_along(self.recipe.accept.gap) > UNSURE)
    }

    /// Stays on the circle until vision knows the gap well.
    pub(super) async fn know_gap(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
    ) -> Result<(), Halt> {
        let sure = SURE_OF_GAP * self.fast.gap_tolerance;
        let begin = cell.now();
        let unsure = |cell: &AlignmentCell<'_>| {
            let seen = cell.seen(aim.side, aim.tip);
            seen.is_some_and(|seen| {
                // Were the gap right: what is off can be corrected.
                let doubt = outside(self.recipe.accept.gap, 0.0, seen.bound_z, seen.sigma_z());
                let long = doubt > SPARE * UNSURE && seen.bound_z > 0.0;
                let most = if long { MOST_DOUBTING } else { MOST_LOOKING };
                (long || seen.sigma[1] > sure) && cell.now() < begin + most
            })
        };
        while unsure(cell) {
            let gap = aim.gap(cell);
            scan.turn(cell, gap).await?;
            if let Some(peak) = scan.peak() {
                scan.go_to(cell, &peak, gap)?;
            }
        }
        Ok(())
    }

    /// Goes on the circle to the gap that is wanted, if that is farther than the tolerance.
    pub(super) async fn correct_gap(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
    ) -> Result<(), Halt> {
        let way = aim.gap(cell) - self.recipe.approach.gap;
        let tolerance = if self.doubts_gap(cell, aim) {
            FINELY * self.fast.gap_tolerance
        } else {
            self.fast.gap_tolerance
        };
        if way.abs() > tolerance {
            let end = cell.wanted(aim.side).shifted(0.0, 0.0, way);
            cell.start_line(aim.side, end, None)?;
            while cell.is_moving(aim.side) {
                let led = aim.led(cell);
                scan.step(cell, led, f64::INFINITY).await?;
            }
        }
        Ok(())
    }

    /// Believes what the widths say of where the chip is, if vision does not contradict. Whether they say it well enough for a
    /// fiber to be attached.
    fn tell_contact(&self, cell: &AlignmentCell<'_>, aim: &Aim, widths: &[SeenWidth]) -> bool {
        let Some(seen) = cell.seen(aim.side, aim.tip) else {
            return false;
        };
        let wide = seen.bound_z + FAR_OFF * seen.sigma_z();
        // What vision adds to the gap by encoders.
        let added = aim.gap(cell) - aim.gap_by_encoders(cell);
        let by_now = |width: &SeenWidth| width.by_now(cell.now(), added, seen.sigma[1]);
        let (widths, variances): (Vec<_>, Vec<_>) = widths.iter().map(by_now).unzip();
        let n = variances.len() as f64;
        let moved = variances.iter().map(|v| v / n).sum::<f64>().sqrt();
        let range = (-2.0 * wide - added, 2.0 * wide - added);
        let Some(contact) = contact(&widths, range) else {
            return false;
        };
        let at = contact.at + added;
        let deviation = contact.deviation.hypot(moved);
        let differs = at.abs() > wide + FAR_OFF * deviation;
        // The gap will be a little off, and vision is to follow what warms. What is known worse than a fiber needs it would only
        // lead it astray, and into the chip at last.
        let off = 0.5 * self.fast.gap_tolerance;
        let sigma = deviation.hypot(seen.sigma[1]);
        if differs || outside(self.recipe.accept.gap, off, 0.0, sigma) > UNSURE {
            return false;
        }
        cell.tell_z(aim.side, -outward(aim.side) * at, deviation);
        true
    }
}

/// A width, and what vision said when it was seen.
#[derive(Debug, Clone, Copy)]
struct SeenWidth {
    width: Width,
    /// What vision added to the gap by encoders, metres, and how well it knew it.
    added: f64,
    sigma: f64,
    /// When, seconds.
    time: f64,
}

impl SeenWidth {
    /// The same where its gap is by now, when vision adds so much to the gap by encoders (metres), known to a standard deviation;
    /// and the variance of that. Since it was seen something has warmed, and vision has moved with its noise: the one that is
    /// less is left.
    fn by_now(&self, now: f64, added: f64, sigma: f64) -> (Width, f64) {
        let warmed = WARMS * (now - self.time).sqrt();
        let noise = self.sigma.hypot(sigma);
        let by = if warmed < noise {
            0.0
        } else {
            self.added - added
        };
        let width = Width {
            at: self.width.at + by,
            ..self.width
        };
        (width, warmed.min(noise).powi(2))
    }
}

/// Looks how wide the spot is here. The micro stands in its middle meanwhile: a piezo goes a little farther or
/// less far elsewhere, and a percent of it is a percent of the width.
async fn width(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &mut ConicalScan<'_>,
) -> Result<Option<SeenWidth>, Halt> {
    let gap = aim.gap(cell);
    let aside = scan.place(gap);
    hand_over(cell, scan, aim.side, aside, gap).await?;
    for _ in 0..STILL {
        scan.turn(cell, gap).await?;
    }
    for _ in 0..CENTRED.1 {
        scan.turn(cell, gap).await?;
        let Some(peak) = scan.peak() else {
            break;
        };
        if scan.go_to(cell, &peak, gap)? < CENTRED.0 * scan.beam_width(gap) {
            break;
        }
    }
    let at = aim.gap_by_encoders(cell);
    let width = scan.width(cell, gap, at).await?;
    let seen = cell.seen(aim.side, aim.tip);
    Ok(width.zip(seen).map(|(width, seen)| SeenWidth {
        width,
        added: aim.gap(cell) - aim.gap_by_encoders(cell),
        sigma: seen.sigma[1],
        time: cell.now(),
    }))
}
