//! The last turns at the chip, on any bench, until the light says that a fiber may be attached.

use crate::beam::{Beam, Peak};
use crate::belief::Across;
use crate::conical_scan::ConicalScan;
use crate::job::Job;
use crate::last_tries::LastTries;
use crate::outcome::{Halt, Outcome};
use crate::reactor::Reactor;
use crate::rise::{Ripple, Rise};
use crate::station::Level;
use crate::still_there::{Foreseen, LightCheck};
use crate::tuning::TUNING;

/// A fiber at the chip, as its last turns ask for it: how its gap is known, and what else is, differs from bench to bench.
pub(crate) trait AtChip {
    /// The light between fiber and guide, as believed.
    fn beam(&self) -> Beam;
    /// How the light of the fiber at rest is looked at.
    fn check(&self, scan: &ConicalScan<'_>) -> LightCheck;
    /// To circles on which peaks are found.
    async fn begin(&self, scan: &mut ConicalScan<'_>) -> Result<(), Halt>;
    /// The peak by turns until it is known to an `accuracy` (metres, and how many times as many turns as usual) and the gap is right, and the gap
    /// for which it was found, metres.
    async fn settle(
        &self,
        scan: &mut ConicalScan<'_>,
        accuracy: (f64, f64),
    ) -> Result<(Peak, f64), Halt>;
    /// Whether the gap has turned out to be another one since.
    fn is_elsewhere(&self) -> bool {
        false
    }
    /// Whether the gap has come to be doubted since.
    fn doubts_gap(&self) -> bool {
        false
    }
    /// How light ripples with the gap; `None` where that is not seen.
    async fn ripple(&self, _scan: &mut ConicalScan<'_>) -> Result<Option<Ripple>, Halt> {
        Ok(None)
    }
    /// How steeply light rises along the chip's z where the fiber is, by that.
    fn rise(&self, _ripple: &Ripple) -> Option<Rise> {
        None
    }
    /// The fiber has come to rest at its peak.
    fn rests(&self, _scan: &ConicalScan<'_>) {}
}

/// The light that a peak at the chip should have by what there was `before`, volts at no gap, at a gap `far` from it, metres.
pub(crate) struct Expected {
    pub(crate) before: f64,
    pub(crate) far: f64,
    /// The least of it before it is known how wide the spot is, volts.
    pub(crate) least: f64,
}

impl Expected {
    /// Which share of that light there has to be, by how wide the spot turned out to be: so much of it crosses that gap.
    fn share(&self, scan: &ConicalScan<'_>, beam: &Beam) -> f64 {
        let crosses = |spot| beam.as_measured(&spot).share(self.far);
        // A spot that turned out narrow asks for no more light than a designed one: a micro that goes farther than it is told makes it look so.
        let share = |spot| (beam.share(self.far) / crosses(spot)).min(1.0);
        scan.spot().map_or(1.0, share)
    }
}

/// A fiber at rest at its peak.
pub(crate) struct Rest {
    /// Its light.
    pub(crate) look: Level,
    /// What circles have foreseen it to be.
    pub(crate) foreseen: Foreseen,
    /// How well it is expected to be known where the fiber will be across.
    pub(crate) across: Across,
}

/// The last turns of a fiber at the chip, until it is at rest where it may be attached.
///
/// # Errors
///
/// A fault; why it may not be: light that is not as `expected`, or no place that is sure after as many tries as the recipe has.
pub(crate) async fn last_turns(
    job: &mut Job<'_>,
    bench: &Reactor<'_>,
    chip: &impl AtChip,
    scan: &mut ConicalScan<'_>,
    expected: &Expected,
) -> Result<Rest, Halt> {
    let recipe = job.recipe;
    let beam = chip.beam();
    let mut tries = LastTries::new(&recipe.fast);
    let rate = bench.caps().channels[scan.meter().0].rate;
    let wanted = (recipe.fast.watch * rate).round() as usize;
    let (mut ripple, mut ripples) = (None, 0);
    loop {
        tries.begin();
        chip.begin(scan).await?;
        let (peak, gap) = match chip.settle(scan, tries.accuracy()).await {
            Err(Halt::Outcome(Outcome::Unsure { .. } | Outcome::Misshapen { .. }))
                if !tries.is_last() =>
            {
                // What the turns of a circle make a micro do they do again and again.
                scan.slow_down();
                continue;
            }
            peak => peak?,
        };
        Outcome::of_growth(expected.before, peak.full, expected.least)?;
        scan.believe_rise(ripple.as_ref().and_then(|ripple| chip.rise(ripple)));
        let confirmed = scan.confirm(bench, gap, &peak, "final").await;
        if confirmed.is_ok() {
            let share = expected.share(scan, &beam);
            let least = recipe.fast.accept * share * expected.before;
            Outcome::of_growth(share * expected.before, peak.full, least)?;
        }
        let elsewhere = chip.is_elsewhere();
        let light = peak.full * beam.share(gap);
        let why = match confirmed {
            Ok((foreseen, known))
                if foreseen.level > TUNING.last.bright * light
                    && (tries.is_last() || !elsewhere && !scan.misjudges_width()) =>
            {
                let aside = recipe.accept.aside;
                let tip = scan.shaking().believed();
                match tip.is_sure(aside, known.at_most) {
                    Err(_)
                        if ripples < TUNING.rise.often
                            && tip.is_for_askew(aside, known.at_most) =>
                    {
                        ripple = chip.ripple(scan).await?;
                        ripples += 1;
                        tries.does_not_count();
                        continue;
                    }
                    Err(unsure) => {
                        tries
                            .learn(bench, scan, gap, (aside, known.at_most))
                            .await?;
                        unsure
                    }
                    Ok(()) if tries.watched < wanted => {
                        scan.watch_shaking(bench, gap, wanted - tries.watched)
                            .await?;
                        tries.watched = wanted;
                        // Piezos have crept meanwhile.
                        tries.does_not_count();
                        continue;
                    }
                    Ok(()) => {
                        chip.rests(scan);
                        job.flicker = scan.flicker().deviation();
                        let across = tip.bonded(known.expected);
                        let check = chip.check(scan);
                        let fallen = match rests(job, bench, check, (foreseen, across)).await? {
                            // The gap may have come to be known better meanwhile.
                            Ok(_) if !tries.is_last() && chip.doubts_gap() => continue,
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
                    expected: light,
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

/// The fiber at rest, if its light is what circles have `foreseen`, at a peak that is known so well `across`. A laser wanders meanwhile, or
/// something has moved: that is found out where it can be mended yet.
async fn rests(
    job: &Job<'_>,
    bench: &Reactor<'_>,
    check: LightCheck,
    (foreseen, across): (Foreseen, Across),
) -> Result<Result<Rest, Outcome>, Halt> {
    let wanders = job.flicker * foreseen.level;
    let foreseen = Foreseen {
        deviation: foreseen.deviation.hypot(wanders),
        ..foreseen
    };
    let (level, fallen) = check.look(bench, &[foreseen]).await?;
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
        across,
    }))
}
