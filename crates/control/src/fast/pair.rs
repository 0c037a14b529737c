//! Both fibers of a guide, held at their peaks: the light that goes through both tells how each tip shakes, and how its light spreads. The
//! sensing fiber sees a tenth of it, or less, which may be lost in a photodiode's noise.

use super::Shared;
use super::approach_moves::{Aim, kept_off};
use super::gap::vision_knows;
use super::resting::{Resting, to_its_peak};
use crate::cell::AlignmentCell;
use crate::conical_scan::ConicalScan;
use crate::dynamics::Dynamics;
use crate::gap_by_light::Spread;
use crate::job::{AtPeak, FiberReport, Job};
use crate::outcome::{Halt, Outcome};
use crate::recipe::Recipe;
use crate::station::Station;
use crate::tuning::TUNING;
use pigtail_hal::spec::{MICRO_AXES, SIDES};
use pigtail_model::frames::Displacement;

/// Brings the input fiber and that of the first output to their peaks, holds both there, and watches each tip for so many
/// `seconds` in x and in y, or some times that where it is dim, by the light that goes through both; and looks at several gaps how that
/// spreads, where vision does not know the gap. Then both go back to the tray. The reports tell, as far as fibers got.
pub fn watch_tips(station: &mut Station, recipe: &Recipe, seconds: f64) -> Vec<FiberReport> {
    let asks_light = !vision_knows(station.spec(), recipe);
    let watched = (seconds, recipe.accept.aside);
    let recipe = roughly(recipe);
    let cell = AlignmentCell::over(station);
    cell.run(hold_both(
        &cell,
        &recipe,
        Asked::Shaking {
            watched,
            asks_light,
        },
    ))
}

/// Brings the same fibers to their peaks, and steps each tip beside its peak: how its micro swings, the reports tell. What circles tell later depends on
/// that.
pub fn swing_tips(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    let recipe = roughly(recipe);
    let cell = AlignmentCell::over(station);
    cell.run(hold_both(&cell, &recipe, Asked::Swings))
}

/// What is to be known of tips that are held.
#[derive(Debug, Clone, Copy)]
enum Asked {
    /// How their micros swing.
    Swings,
    /// How they shake, watched for so long (seconds) until it is told beside a tolerance (metres), and how their light spreads, where light is to tell the
    /// gap.
    Shaking {
        watched: (f64, f64),
        asks_light: bool,
    },
}

async fn hold_both<'r>(
    cell: &AlignmentCell<'_>,
    recipe: &'r Recipe,
    asked: Asked,
) -> Vec<FiberReport> {
    let mut shared = Shared::new(recipe);
    let mut input = Job::of(recipe, None);
    input.holds = true;
    let put_back = async |job: &mut Job<'r>| job.put_back(cell).await;
    let reached = input.run(async |job| shared.fiber(job, cell).await, put_back);
    let mut report = reached.await;
    let Some(held) = input.at_peak.filter(|_| report.outcome.is_aligned()) else {
        let dark = Job::of(recipe, Some(0)).report(Outcome::NotAttempted);
        return vec![report, dark];
    };
    let mut output = Job::of(recipe, Some(0));
    output.holds = true;
    let watch = async |job: &mut Job<'r>| {
        let fiber = Box::pin(shared.fiber(job, cell));
        kept_off(cell, &Aim::at_fiber(&input), fiber).await?;
        let Some(other) = job.at_peak else {
            return Ok(());
        };
        // By the output's light.
        input.channel = other.channel;
        let held = AtPeak {
            side: held.side,
            beam: held.beam,
            gap: held.gap,
            walk: held.walk,
            ..other
        };
        job.phase(cell, "pair", async |job| {
            let mut tips = [
                HeldTip::new(&shared, cell, job, &other),
                HeldTip::new(&shared, cell, &mut input, &held),
            ];
            match asked {
                Asked::Swings => {
                    let others = others(&tips);
                    for (tip, other) in tips.iter_mut().zip(others) {
                        let radius = shared.fast.conical_scan.radius;
                        let looks = async {
                            tip.come_back(cell, radius).await?;
                            tip.job.dynamics = tip.swings(cell).await?;
                            Ok(())
                        };
                        kept_off(cell, &other, Box::pin(looks)).await?;
                    }
                    Ok(())
                }
                Asked::Shaking {
                    watched,
                    asks_light,
                } => {
                    shared.asks_light = asks_light;
                    shared.know(cell, tips, watched).await
                }
            }
        })
        .await?;
        job.put_back(cell).await?;
        Ok(())
    };
    let output = output.run(watch, put_back).await;
    if output.outcome.fault().is_none()
        && let Err(fault) = input.put_back(cell).await
    {
        report.outcome = Outcome::Stopped(fault);
    }
    (report.shaking, report.spread) = (input.shakes(), input.spread);
    report.dynamics = input.dynamics;
    vec![report, output]
}

/// Of each tip where the other one waits meanwhile.
fn others(tips: &[HeldTip<'_, '_, '_>; SIDES]) -> [Aim; SIDES] {
    let [a, b] = tips.each_ref().map(|tip| Aim::at_fiber(tip.job));
    [b, a]
}

/// The same recipe for fibers from which only light is wanted.
pub(super) fn roughly(recipe: &Recipe) -> Recipe {
    let mut recipe = recipe.clone();
    recipe.accept.aside *= TUNING.pair.roughly;
    recipe.accept.gap *= TUNING.pair.roughly;
    recipe.fast.accuracy *= TUNING.pair.roughly;
    recipe
}

/// A fiber that is held at its peak, while its tip is looked at.
struct HeldTip<'j, 'r, 's> {
    job: &'j mut Job<'r>,
    scan: ConicalScan<'s>,
    gap: f64,
    /// Its light at no gap, volts.
    before: f64,
    /// How its light spreads, as looks have told so far.
    told: Vec<Spread>,
}

impl<'j, 'r, 's> HeldTip<'j, 'r, 's> {
    fn new(
        shared: &Shared<'s>,
        cell: &AlignmentCell<'_>,
        job: &'j mut Job<'r>,
        held: &AtPeak,
    ) -> Self {
        let mut watch = shared.watch(held.side, held.channel);
        watch.background = held.background;
        let here = cell.micro(held.side);
        let (shape, beam, gap) = (&shared.fast.conical_scan, held.beam, held.gap);
        let scan = ConicalScan::new(watch, beam, shape, cell, (here, gap), held.walk, None)
            .settling(cell.settles(held.side));
        Self {
            job,
            scan,
            gap,
            before: (held.level.mean - held.background) / beam.share(gap),
            told: Vec::with_capacity(TUNING.pair.times),
        }
    }

    /// To where its peak is by now, and to rest: held tips creep away from it, and the light of both goes with them.
    async fn come_back(&mut self, cell: &AlignmentCell<'_>, radius: f64) -> Result<(), Halt> {
        to_its_peak(cell, &mut self.scan, radius, self.gap).await
    }

    /// How the axes of its micro swing, each by steps of its piezo; `None` where light does not tell that of both.
    async fn swings(
        &mut self,
        cell: &AlignmentCell<'_>,
    ) -> Result<Option<[Dynamics; MICRO_AXES]>, Halt> {
        let (sin, cos) = cell.spec().micro.angle.sin_cos();
        let mut found = [None; MICRO_AXES];
        for (found, (p, q)) in found.iter_mut().zip([(1.0, 0.0), (0.0, 1.0)]) {
            let along = Displacement::new(p, q).turned(sin, cos);
            let steps = self.scan.step_beside(cell, self.gap, along).await?;
            *found = Dynamics::of(&steps);
        }
        Ok(found[0].zip(found[1]).map(|(p, q)| [p, q]))
    }

    /// Whether it is known well enough how its light spreads.
    fn spreads(&self) -> bool {
        Spread::of_all(&self.told).is_some_and(|spread| spread.is_well_known())
    }
}

impl Shared<'_> {
    /// Watches both tips, each for so long (seconds) until it is told beside a tolerance (metres), and then how their light spreads. In turns: no
    /// tip stays long where it was.
    async fn know(
        &self,
        cell: &AlignmentCell<'_>,
        mut tips: [HeldTip<'_, '_, '_>; SIDES],
        (seconds, tolerance): (f64, f64),
    ) -> Result<(), Halt> {
        let radius = self.fast.conical_scan.radius;
        let others = others(&tips);
        for _ in 0..TUNING.pair.times {
            let each = tips.each_ref().map(|tip| tip.scan.shaking());
            if each.iter().all(|shaking| shaking.is_told(tolerance)) {
                break;
            }
            come_back(cell, &mut tips, radius).await?;
            for (tip, other) in tips.iter_mut().zip(others) {
                let rate = cell.caps().channels[tip.scan.meter().0].rate;
                let samples = (seconds * rate).round() as usize;
                if !tip.scan.shaking().is_told(tolerance) {
                    let aim = Aim::at_fiber(tip.job);
                    let watched = Box::pin(tip.scan.watch_shaking(cell, tip.gap, samples));
                    kept_off(cell, &aim, Box::pin(kept_off(cell, &other, watched))).await?;
                    tip.job.has_shaken(tip.scan.shaking());
                }
            }
        }
        let all_known = |tips: &[HeldTip<'_, '_, '_>; SIDES]| tips.iter().all(HeldTip::spreads);
        for _ in 0..TUNING.pair.times {
            if self.vision_tells(cell) || all_known(&tips) {
                break;
            }
            come_back(cell, &mut tips, radius).await?;
            for (side, other) in others.into_iter().enumerate() {
                let [first, second] = &mut tips;
                let (tip, held) = if side == 0 {
                    (first, second)
                } else {
                    (second, first)
                };
                if tip.spreads() {
                    continue;
                }
                let aim = Aim::at_fiber(tip.job);
                tip.scan.set_radius(radius);
                let (job, scan) = (&mut *tip.job, (&mut tip.scan, tip.before));
                let mut resting = Resting::new(cell, &mut held.scan, (other, radius));
                let close = self.come_close(job, cell, &aim, scan, Some(&mut resting));
                kept_off(cell, &other, Box::pin(close)).await?;
                tip.told.extend(tip.job.spread.take());
                tip.job.spread = Spread::of_one(&tip.told);
                // The other tip is looked at by light that no circle stirs.
                tip.gap = aim.gap(cell);
                tip.scan.rest(cell, tip.gap).await?;
            }
        }
        Ok(())
    }
}

/// Both tips to where their peaks are by now, one after the other.
async fn come_back(
    cell: &AlignmentCell<'_>,
    tips: &mut [HeldTip<'_, '_, '_>; SIDES],
    radius: f64,
) -> Result<(), Halt> {
    let others = others(tips);
    for (tip, other) in tips.iter_mut().zip(others) {
        kept_off(cell, &other, Box::pin(tip.come_back(cell, radius))).await?;
    }
    Ok(())
}
