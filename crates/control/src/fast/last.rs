//! The last turns at the chip, until the light says that a fiber may be attached.

use super::Shared;
use super::approach_moves::Aim;
use crate::beam::{Beam, Peak};
use crate::belief::Across;
use crate::cell::AlignmentCell;
use crate::conical_scan::{ConicalScan, Ready};
use crate::job::Job;
use crate::last_tries::LastTries;
use crate::outcome::{Halt, Outcome};
use crate::procedure::light_check;
use crate::rise::Ripple;
use crate::station::Level;
use crate::still_there::Foreseen;
use crate::tuning::TUNING;

impl Shared<'_> {
    /// The last turns at the chip, and whether the light is what it should be, where `before`, at a gap `far` from it (metres), it seemed to be so
    /// much (volts, at no gap).
    pub(super) async fn finish(
        &self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        (before, far): (f64, f64),
    ) -> Result<Rest, Halt> {
        let beam = cell.beam(aim.side, self.recipe);
        let mut tries = LastTries::new(self.fast);
        let wanted = (self.fast.watch * cell.spec().photodiode.rate).round() as usize;
        let (mut ripple, mut ripples) = (None, 0);
        loop {
            tries.begin();
            scan.set_radius(self.fast.conical_scan.radius);
            let (peak, gap) = match self.settle(cell, aim, scan, tries.accuracy()).await {
                Err(Halt::Outcome(Outcome::Unsure { .. } | Outcome::Misshapen { .. }))
                    if !tries.is_last() =>
                {
                    // What the turns of a circle make a micro do they do again and again.
                    scan.slow_down();
                    continue;
                }
                peak => peak?,
            };
            if peak.full < self.least_light(cell, aim, before) {
                return Err(false_light(before, &peak));
            }
            let here = aim.gap_by_encoders(cell);
            let rise = ripple.and_then(|ripple: Ripple| ripple.rise(here));
            scan.believe_rise(rise.map(|rise| rise.along_z(aim.side)));
            let confirmed = scan.confirm(cell, gap, &peak, "final").await;
            if confirmed.is_ok() {
                self.comes_out_of_guide(scan, (before, far), &beam, &peak)?;
            }
            // Meanwhile vision may have come to know better.
            let way = aim.gap(cell) - self.recipe.approach.gap;
            let off = way.abs() > TUNING.last.late * self.fast.gap_tolerance
                || self.doubts_gap(cell, aim);
            let expected = peak.full * beam.share(gap);
            let why = match confirmed {
                Ok((foreseen, known))
                    if foreseen.level > TUNING.last.bright * expected
                        && (tries.is_last() || !off && !scan.misjudges_width()) =>
                {
                    let aside = self.recipe.accept.aside;
                    match scan.shaking().is_sure(aside, known) {
                        Err(_)
                            if ripples < TUNING.rise.often
                                && scan.shaking().is_for_askew(aside, known) =>
                        {
                            ripple = self.ripple(cell, aim, scan).await?;
                            ripples += 1;
                            tries.does_not_count();
                            continue;
                        }
                        Err(unsure) => {
                            tries.learn(cell, scan, gap, (aside, known)).await?;
                            unsure
                        }
                        Ok(()) if tries.watched < wanted => {
                            scan.watch_shaking(cell, gap, wanted - tries.watched)
                                .await?;
                            tries.watched = wanted;
                            // Piezos have crept meanwhile.
                            tries.does_not_count();
                            continue;
                        }
                        Ok(()) => {
                            let fallen = match rests(job, cell, scan, (foreseen, known)).await? {
                                // Vision may have come to know better meanwhile.
                                Ok(_) if !tries.is_last() && self.doubts_gap(cell, aim) => {
                                    continue;
                                }
                                Ok(rest) => return Ok(rest),
                                Err(fallen) => fallen,
                            };
                            tries.has_not_rested();
                            fallen
                        }
                    }
                }
                Ok((Foreseen { level, .. }, _)) => {
                    // Or the spot is not as wide as believed: then the wide circle has told of other light than there is.
                    scan.believe_width();
                    Outcome::LightLost {
                        phase: "final",
                        level,
                        expected,
                    }
                }
                // Other turns bring no peak nearer that the micro does not reach.
                Err(halt @ (Halt::Fault(_) | Halt::Outcome(Outcome::MicroRange { .. }))) => {
                    return Err(halt);
                }
                Err(Halt::Outcome(doubt)) => {
                    scan.slow_down();
                    doubt
                }
            };
            if tries.is_last() {
                return Err(why.into());
            }
        }
    }
}

impl Shared<'_> {
    /// That there is as much light at a peak as there seemed to be `before`, at a gap `far` from it (volts; metres), by how wide the spot turned out to
    /// be: so much of it crosses that gap.
    fn comes_out_of_guide(
        &self,
        scan: &ConicalScan<'_>,
        (before, far): (f64, f64),
        beam: &Beam,
        peak: &Peak,
    ) -> Result<(), Halt> {
        let crosses = |spot| beam.as_measured(&spot).share(far);
        // A spot that turned out narrow asks for no more light than a designed one: a micro that goes farther than it is told makes it look so.
        let times = scan
            .spot()
            .map_or(1.0, |spot| (beam.share(far) / crosses(spot)).min(1.0));
        if peak.full < self.fast.accept * times * before {
            return Err(false_light(times * before, peak));
        }
        Ok(())
    }

    /// The peak by turns at the chip, until it is known to an `accuracy` (metres, and how many times as many turns as usual) and vision knows the gap, which is corrected. Returns the gap
    /// too for which the peak was found: what vision says of it later moves neither.
    async fn settle(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        accuracy: (f64, f64),
    ) -> Result<(Peak, f64), Halt> {
        let begin = cell.now();
        let mut corrected = 0;
        loop {
            let ready = || match self.learns_gap(cell, aim, begin) {
                true => Ready::NotYet,
                false if corrected < self.fast.retry.gap && self.is_off(cell, aim) => {
                    Ready::Elsewhere
                }
                false => Ready::Yes,
            };
            let gap = aim.gap(cell);
            let peak = match ready() {
                Ready::Elsewhere => None,
                _ => Some(scan.settle(cell, gap, accuracy, "final", &ready).await?),
            };
            match peak.filter(|_| ready() != Ready::Elsewhere) {
                Some(peak) => return Ok((peak, gap)),
                None => self.correct_gap(cell, aim, scan).await?,
            }
            corrected += 1;
        }
    }
}

/// A peak that is not as bright as there was light `before`, volts.
fn false_light(before: f64, peak: &Peak) -> Halt {
    let after = peak.full;
    Outcome::FalseLight { before, after }.into()
}

/// A fiber at rest at its peak.
pub(super) struct Rest {
    /// Its light.
    pub(super) look: Level,
    /// What circles have foreseen it to be.
    pub(super) foreseen: Foreseen,
    /// How well it is known where the fiber will be across.
    pub(super) across: Across,
}

/// The fiber at rest, if its light is what circles have `foreseen`, at a peak that is `known` so well. A laser wanders meanwhile, or something
/// has moved: that is found out where it can be mended yet.
async fn rests(
    job: &mut Job<'_>,
    cell: &AlignmentCell<'_>,
    scan: &ConicalScan<'_>,
    (foreseen, known): (Foreseen, Across),
) -> Result<Result<Rest, Outcome>, Halt> {
    cell.has_flickered(scan.flicker());
    job.flicker = scan.flicker().deviation();
    let wanders = job.flicker * foreseen.level;
    let foreseen = Foreseen {
        deviation: foreseen.deviation.hypot(wanders),
        ..foreseen
    };
    let check = light_check(cell, job.channel, scan.background(), scan.noise());
    let (level, fallen) = check.look(cell, &[foreseen]).await?;
    if fallen {
        return Ok(Err(Outcome::LightLost {
            phase: "final",
            level,
            expected: foreseen.level,
        }));
    }
    let look = Level {
        mean: level + check.background,
        sigma: check.noise,
    };
    Ok(Ok(Rest {
        look,
        foreseen,
        across: scan.shaking().bonded(known),
    }))
}
