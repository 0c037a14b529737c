//! Both fibers of a guide, held at their peaks: the light that goes through both tells how each tip shakes, and how its light spreads. The
//! sensing fiber sees a tenth of it, or less, which may be lost in a photodiode's noise.

use super::Shared;
use super::approach_moves::Aim;
use super::gap::vision_knows;
use crate::cell::AlignmentCell;
use crate::conical_scan::ConicalScan;
use crate::gap_by_light::Spread;
use crate::job::{AtPeak, FiberReport, Job};
use crate::outcome::{Halt, Outcome};
use crate::recipe::Recipe;
use crate::station::{Station, fine};
use crate::tip_estimator::Tip;
use crate::tuning::TUNING;
use pigtail_model::frames::Displacement;

/// Brings the input fiber and that of the first output to their peaks, holds both there, and watches each tip for so many
/// `seconds` in x and in y, or some times that where it is dim, by the light that goes through both; and looks at several gaps how that
/// spreads, where vision does not know the gap. Then both go back to the tray. The reports tell, as far as fibers got.
pub fn watch_tips(station: &mut Station, recipe: &Recipe, seconds: f64) -> Vec<FiberReport> {
    let asks_light = !vision_knows(station.spec(), recipe);
    let watched = (seconds, recipe.accept.aside);
    let mut recipe = recipe.clone();
    recipe.accept.aside *= TUNING.pair.roughly;
    recipe.accept.gap *= TUNING.pair.roughly;
    let cell = AlignmentCell::over(station);
    let mut shared = Shared::new(&recipe);
    cell.run(async {
        let mut input = Job::of(&recipe, None);
        input.holds = true;
        let put_back = async |job: &mut Job<'_>| job.put_back(&cell).await;
        let reached = input.run(async |job| shared.fiber(job, &cell).await, put_back);
        let mut report = reached.await;
        let Some(held) = input.at_peak.filter(|_| report.outcome.is_aligned()) else {
            let dark = Job::of(&recipe, Some(0)).report(Outcome::NotAttempted);
            return vec![report, dark];
        };
        let mut output = Job::of(&recipe, Some(0));
        output.holds = true;
        let watch = async |job: &mut Job<'_>| {
            shared.fiber(job, &cell).await?;
            let Some(other) = job.at_peak else {
                return Ok(());
            };
            shared.asks_light = asks_light;
            job.phase(&cell, "pair", async |job| {
                shared.know_tip(&cell, job, &other, watched).await?;
                // By the output's light.
                input.channel = other.channel;
                let held = AtPeak {
                    side: held.side,
                    beam: held.beam,
                    gap: held.gap,
                    walk: held.walk,
                    ..other
                };
                shared.know_tip(&cell, &mut input, &held, watched).await
            })
            .await?;
            job.put_back(&cell).await?;
            Ok(())
        };
        let output = output.run(watch, put_back).await;
        if output.outcome.fault().is_none()
            && let Err(fault) = input.put_back(&cell).await
        {
            report.outcome = Outcome::Stopped(fault);
        }
        (report.shaking, report.spread) = (input.shakes(), input.spread);
        vec![report, output]
    })
}

impl Shared<'_> {
    /// Watches the tip of a fiber that is held at its peak, where it is, for so long (seconds) until it is told beside a tolerance (metres);
    /// and how its light spreads.
    async fn know_tip(
        &self,
        cell: &AlignmentCell<'_>,
        job: &mut Job<'_>,
        held: &AtPeak,
        (seconds, tolerance): (f64, f64),
    ) -> Result<(), Halt> {
        let mut watch = self.watch(held.side, held.channel);
        watch.background = held.background;
        let group = fine(held.side);
        let here = cell.across(group).unwrap_or(Displacement::ZERO);
        let (shape, beam, gap) = (&self.fast.conical_scan, held.beam, held.gap);
        let mut scan = ConicalScan::new(watch, beam, shape, cell, (here, gap), held.walk, None);
        scan.centre(
            cell,
            gap,
            TUNING.pair.near * scan.beam_width(gap),
            "pair",
            2,
        )
        .await?;
        let rate = cell.caps().channels[watch.meter.0].rate;
        let samples = (seconds * rate).round() as usize;
        for _ in 0..TUNING.pair.times {
            scan.watch_shaking(cell, gap, samples).await?;
            if scan.shaking().is_told(tolerance) {
                break;
            }
        }
        job.has_shaken(scan.shaking());
        if self.vision_tells(cell) {
            return Ok(());
        }
        let aim = Aim {
            side: job.side,
            tip: Tip::Fiber,
            port: job.port,
        };
        scan.set_radius(shape.radius);
        let before = (held.level.mean - held.background) / beam.share(gap);
        let mut told = Vec::with_capacity(TUNING.pair.times);
        for _ in 0..TUNING.pair.times {
            self.come_close(job, cell, &aim, &mut scan, before).await?;
            told.extend(job.spread.take());
            if Spread::of_all(&told).is_some_and(|spread| spread.is_well_known()) {
                break;
            }
        }
        job.spread = Spread::of_one(&told);
        // The other tip is watched by light that no circle stirs.
        let gap = aim.gap(cell);
        scan.rest(cell, gap).await?;
        Ok(())
    }
}
