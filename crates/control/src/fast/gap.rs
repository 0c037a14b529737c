//! The gap between fiber and chip: by vision, and where that cannot know it well enough by light.

use super::Shared;
use super::approach_moves::Aim;
use super::centre::hand_over;
use super::resting::Resting;
use crate::belief::Across;
use crate::cell::AlignmentCell;
use crate::conical_scan::ConicalScan;
use crate::gap_by_light::{Contact, Known, Spread, Width, contact};
use crate::job::Job;
use crate::outcome::{Halt, Outcome};
use crate::procedure::{outward, place_at};
use crate::recipe::Recipe;
use crate::rise::{Ripple, Seen};
use crate::station::Level;
use crate::tuning::TUNING;

use pigtail_hal::Spec;
use pigtail_hal::spec::GuardSpec;
use pigtail_model::frames::Displacement;
use pigtail_numerics::statistics::outside;
use std::f64::consts::TAU;

/// Where the spot is looked at on the way, if the light is to say where the chip is: at gaps where its squared
/// width is so many times that at the chip, and one more; and at the chip.
#[derive(Debug, Clone, Copy)]
struct Looks {
    wider: &'static [f64],
    /// Until the square of a width is known to this share of it.
    share: f64,
    /// The same at the chip.
    share_here: f64,
}

/// Where it is known how light spreads.
const QUICK: [Looks; 2] = {
    let tuned = &TUNING.gap;
    [
        looks(
            &[TUNING.gap.quick_at],
            tuned.quick_share[0],
            tuned.quick_share_here[0],
        ),
        looks(
            &[TUNING.gap.quick_at],
            tuned.quick_share[1],
            tuned.quick_share_here[1],
        ),
    ]
};

/// And where it is not.
const WHOLE: [Looks; 2] = [looks(
    &TUNING.gap.whole_at,
    TUNING.gap.whole_share,
    TUNING.gap.whole_share,
); 2];

const fn looks(wider: &'static [f64], share: f64, share_here: f64) -> Looks {
    Looks {
        wider,
        share,
        share_here,
    }
}

/// Whether the vision of a datasheet comes to know a gap well enough for a fiber to be attached by a recipe, as soon as light would;
/// otherwise the light has to tell.
pub fn vision_knows(spec: &Spec, recipe: &Recipe) -> bool {
    let vision = &spec.vision;
    let frames = vision.sigma / (TUNING.gap.looks * vision.rate).sqrt();
    !is_doubtful(recipe, vision.believed()[1], frames.hypot(vision.facet_z))
}

/// Whether a fiber would not be attached by a recipe at a gap that was corrected as finely as is, for it is known but for this bound and
/// standard deviation, metres.
fn is_doubtful(recipe: &Recipe, bound: f64, sigma: f64) -> bool {
    let off = TUNING.gap.finely * recipe.fast.gap_tolerance;
    outside(recipe.accept.gap, off, bound, sigma) > TUNING.bond.unsure
}

impl Shared<'_> {
    /// Whether the gap is left to vision.
    pub(super) fn vision_tells(&self, cell: &AlignmentCell<'_>) -> bool {
        !self.asks_light && vision_knows(cell.spec(), self.recipe)
    }

    /// From a gap at which there is no doubt to the chip; where vision could never know the gap, the spot's width is
    /// looked at on the way. Looks at dim light take many seconds each: between them another fiber that its light goes through, `resting` meanwhile, comes
    /// back to its own peak.
    pub(super) async fn come_close(
        &self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        (scan, before): (&mut ConicalScan<'_>, f64),
        mut resting: Option<&mut Resting<'_, '_>>,
    ) -> Result<(), Halt> {
        let beam = cell.beam(aim.side, self.recipe);
        let wanted = self.recipe.approach.gap;
        if self.vision_tells(cell) {
            // The rest is for when it has seen more of the tip.
            let here = wanted.max(least_gap(cell, aim, wanted));
            return self.come_to(cell, aim, scan, before, here).await;
        }
        // Vision may be wrong by its bound: the rest is for when light has told.
        let bound = cell
            .seen(aim.side, aim.tip)
            .map_or(0.0, |seen| seen.bound_z);
        cell.forget_told(aim.side);
        let here = (wanted + bound).max(least_gap(cell, aim, wanted));
        let holder = || cell.holder(aim.side).x;
        let mut from = holder();
        let hides = 2.0 * cell.spec().guard.windup_z;
        let afar = TUNING.gap.aside * GuardSpec::LED;
        let mode = &self.recipe.mode;
        let design = Spread::by_design(mode.wavelength / mode.gap_index, self.exit());
        // A micro that swings along goes farther on circles than on slower ones: in its scale light spreads otherwise.
        let period = scan.period();
        let measured = cell.measured_spread(aim.side);
        let mut spread = measured.filter(|_| !scan.is_slower()).unwrap_or(design);
        let quick = if spread.is_known() { &QUICK[..] } else { &[] };
        let (mut widths, mut latest, mut farther) = (Vec::new(), None, 0.0);
        for looks in quick.iter().chain(&WHOLE) {
            let one = looks.wider.len() == 1;
            let (before_it, mut stays) = (widths.len(), true);
            for share in looks.wider {
                let gap = beam.gap_of(*share);
                if let Some(resting) = resting.as_deref_mut() {
                    resting.come_back(cell, scan, aim.gap(cell)).await?;
                }
                // From one gap to the chip it is not far: the micro's middle lies between both. The macro goes aside far away from the
                // chip, for near to it a holder that goes aside is believed to come nearer to an inclined facet.
                // By the time it is there and the background is looked at, the macro stands still.
                if one && widths.is_empty() {
                    aside_to_middle(cell, aim, scan, 0.5 * (gap + here)).await?;
                    from = holder();
                }
                // Looks are compared by encoders: where the axis turns back its transmission hides a part of the way.
                if aim.gap(cell) < gap {
                    // A micro that has crept to the end of its range cannot walk along to there.
                    if !cell.micro_reaches(aim.side, scan.place(gap)) && gap > afar {
                        self.approach(cell, aim, scan, before, (afar, 1)).await?;
                        to_middle(cell, aim, scan, gap).await?;
                        from = holder();
                    }
                    self.approach(cell, aim, scan, before, (gap + hides, 0))
                        .await?;
                }
                self.approach(cell, aim, scan, before, (gap, 1)).await?;
                if !one {
                    to_middle(cell, aim, scan, gap).await?;
                    if gap > afar {
                        from = holder();
                    }
                }
                if share == &looks.wider[0] {
                    stays = beside(job, cell, aim, scan).await?;
                }
                widths.extend(width(cell, aim, scan, looks.share).await?);
            }
            if let Some(resting) = resting.as_deref_mut() {
                resting.come_back(cell, scan, aim.gap(cell)).await?;
            }
            self.come_to(cell, aim, scan, before, here).await?;
            if !one {
                to_middle(cell, aim, scan, here).await?;
            }
            widths.extend(width(cell, aim, scan, looks.share_here).await?);
            if scan.period() != period {
                widths.clear();
                spread = design;
            }
            let contact = if stays {
                touching(cell, aim, &widths, (scan, spread))
            } else {
                // Nobody knows how much of their light was not the spot's.
                widths.truncate(before_it);
                None
            };
            if looks.wider.len() > 1 && !scan.is_slower() {
                job.spread = contact.map(|contact| contact.spread).or(job.spread);
            }
            let held_off = |aside: f64| self.held_off(cell, aim, contact, aside);
            let mut aside = holder() - from;
            if held_off(aside) > 0.0 && held_off(0.0) == 0.0 {
                // Aside as far as it is, but not so near.
                self.approach(cell, aim, scan, before, (afar + hides, 0))
                    .await?;
                to_middle(cell, aim, scan, here).await?;
                from = holder();
                self.come_to(cell, aim, scan, before, here).await?;
                aside = holder() - from;
            }
            farther = held_off(aside);
            let hopeless = farther > self.recipe.accept.gap;
            if hopeless || self.tell(cell, aim, contact, (farther, TUNING.gap.later)) {
                return Ok(());
            }
            latest = contact;
        }
        self.tell(cell, aim, latest, (farther, 0.0));
        Ok(())
    }

    /// To a gap near the chip, and a turn there. A way at speed ends before it by what a transmission may hide: as far as that an endpoint
    /// may swing beyond the end of its way, which no encoder at a motor sees. The rest is gone slowly.
    async fn come_to(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        before: f64,
        gap: f64,
    ) -> Result<(), Halt> {
        let beyond = cell.spec().guard.windup_z.max(TUNING.gap.beyond);
        self.approach(cell, aim, scan, before, (gap + beyond, 0))
            .await?;
        let way = aim.gap_at_rest(cell) - gap;
        let roomy = gap - nearest(cell, aim, gap) > TUNING.gap.roomy;
        let speed = if roomy {
            TUNING.gap.nearly
        } else {
            TUNING.gap.slowly
        };
        along(cell, aim, scan, way, speed).await?;
        lead(cell, aim, scan).await
    }

    /// How much farther than wanted a tip has to stay, metres, where vision is so wrong that by it the tip would be too near to the chip there: who guards the
    /// machine asks vision alone, and would stop it. Where the macro has gone `aside` near the chip (towards the chip's x, metres), it has the facet
    /// stand out.
    fn held_off(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        contact: Option<Contact>,
        aside: f64,
    ) -> f64 {
        let Some(contact) = contact else {
            return 0.0;
        };
        let stands_out = (aside * self.recipe.ports.slope()).max(0.0);
        let wanted = self.recipe.approach.gap;
        let by_vision = wanted + contact.at.min(0.0) - stands_out;
        (least_gap(cell, aim, wanted) - by_vision).max(0.0)
    }

    /// Whether a fiber would not be attached at this gap, for what is known of it.
    pub(super) fn doubts_gap(&self, cell: &AlignmentCell<'_>, aim: &Aim) -> bool {
        self.outside_along(cell, aim) > TUNING.bond.unsure
    }

    /// The probability that a fiber is too near or too far here.
    fn outside_along(&self, cell: &AlignmentCell<'_>, aim: &Aim) -> f64 {
        let wanted = self.recipe.approach.gap;
        let place = place_at(cell, aim.side, aim.port, wanted, Across::default());
        place.map_or(0.0, |place| place.outside_along(self.recipe.accept.gap))
    }

    /// Whether vision may yet come to know the gap better, as well as it is to be known, after turns that began then (seconds).
    pub(super) fn learns_gap(&self, cell: &AlignmentCell<'_>, aim: &Aim, begin: f64) -> bool {
        let sure = TUNING.gap.sure * self.fast.gap_tolerance;
        cell.seen(aim.side, aim.tip).is_some_and(|seen| {
            let doubtful = is_doubtful(self.recipe, seen.bound_z, seen.sigma_z());
            let long = doubtful && seen.bound_z > 0.0;
            let most = if long {
                TUNING.gap.doubting
            } else {
                TUNING.gap.looking
            };
            // What the light has told vision does not know better.
            let vague = seen.bound_z > 0.0 && seen.sigma[1] > sure;
            (long || vague) && cell.now() < begin + most
        })
    }

    /// Whether the gap is farther from the one that is wanted than the tolerance.
    pub(super) fn is_off(&self, cell: &AlignmentCell<'_>, aim: &Aim) -> bool {
        let finely = if self.outside_along(cell, aim) > TUNING.gap.spare * TUNING.bond.unsure {
            TUNING.gap.finely
        } else {
            1.0
        };
        self.way_off(cell, aim).abs() > finely * self.fast.gap_tolerance
    }

    /// How much nearer the tip is to come, metres.
    fn way_off(&self, cell: &AlignmentCell<'_>, aim: &Aim) -> f64 {
        let wanted = self.recipe.approach.gap;
        aim.gap_at_rest(cell) - wanted.max(least_gap(cell, aim, wanted))
    }

    /// Goes on the circle to the gap that is wanted.
    pub(super) async fn correct_gap(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
    ) -> Result<(), Halt> {
        let way = self.way_off(cell, aim);
        // Vision sees what a transmission hides where the axis turns back; the light has told where the tip was, coming nearer.
        let told = !self.vision_tells(cell);
        let hides = cell.spec().guard.windup_z;
        if told && way < 0.0 {
            along(cell, aim, scan, way - hides, TUNING.gap.slowly).await?;
            along(cell, aim, scan, hides, TUNING.gap.slowly).await?;
        } else {
            along(cell, aim, scan, way, TUNING.gap.slowly).await?;
        }
        Ok(())
    }

    /// Believes where fiber and chip touch, if that is known well enough for a fiber to be attached so much farther away than wanted (metres), so many
    /// seconds later: whether it is.
    fn tell(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        contact: Option<Contact>,
        (farther, later): (f64, f64),
    ) -> bool {
        let Some((seen, contact)) = cell.seen(aim.side, aim.tip).zip(contact) else {
            return false;
        };
        // The gap will be a little off, and vision is to follow what warms. What is known worse than a fiber needs it would only
        // lead it astray, and into the chip at last.
        let off = farther + 0.5 * self.fast.gap_tolerance;
        let warms = TUNING.vision.warms * later.sqrt();
        let sigma = contact.deviation.hypot(seen.sigma[1]).hypot(warms);
        if outside(self.recipe.accept.gap, off, 0.0, sigma) > TUNING.bond.unsure {
            return false;
        }
        cell.tell_z(aim.side, -outward(aim.side) * contact.at, contact.deviation);
        true
    }
}

/// The greatest speed of a way to a `gap` (metres) at which an axis that brakes late is not stopped by who guards the machine, metres a
/// second. The guard asks at every moment how near a tip would come were it stopped now, from the speed of the motor: one that drives
/// a soft transmission is faster on its way to rest than it was told to be.
pub(super) fn unhurried(cell: &AlignmentCell<'_>, aim: &Aim, gap: f64) -> f64 {
    let spec = cell.spec();
    let spare = gap - nearest(cell, aim, gap);
    greatest_speed(spare, spec.z_stage.acceleration, spec.servo.rate)
}

/// The greatest speed, metres a second, of a way at whose end so much is to `spare` (metres), of an axis of so much acceleration (m/s2) and a
/// servo's `rate`.
fn greatest_speed(spare: f64, acceleration: f64, rate: f64) -> f64 {
    // What is left of the way, v^2 / 2a, and what is to spare at its end are to be more than the way in which the guard would stop it.
    let more =
        (TUNING.gap.faster * TUNING.gap.faster / GuardSpec::BRAKES - 1.0) / (2.0 * acceleration);
    let late = TUNING.gap.faster * GuardSpec::REACTION / rate;
    let root = (late * late + 4.0 * more * spare.max(0.0)).sqrt();
    (0.5 * (root - late) / more).max(TUNING.gap.least_speed)
}

/// At which gap who guards the machine would stop a fiber on its way to a `gap` (metres), by vision alone; in gaps as they are believed, of which light may
/// have told that vision is wrong.
fn nearest(cell: &AlignmentCell<'_>, aim: &Aim, gap: f64) -> f64 {
    let here = aim.gap(cell);
    let room = cell.room_before(aim.side, aim.port.z, (here - gap).max(0.0));
    room.map_or(cell.spec().guard.clearance, |room| here - room)
}

/// The same for a tip that moves slowly, metres.
pub(super) fn least_gap(cell: &AlignmentCell<'_>, aim: &Aim, gap: f64) -> f64 {
    nearest(cell, aim, gap) + TUNING.gap.stop
}

impl Shared<'_> {
    /// How light ripples here with the gap, by its peaks on the way from a ripple farther away; `None` where there is too little light.
    pub(super) async fn ripple(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
    ) -> Result<Option<Ripple>, Halt> {
        let mode = &self.recipe.mode;
        let length = mode.wavelength / (2.0 * mode.gap_index);
        let hides = cell.spec().guard.windup_z;
        let speed = TUNING.gap.slowly;
        scan.set_radius(self.fast.conical_scan.radius);
        // All gaps on one way towards the chip: what a transmission hides then is the same. A servo that comes to the end of a way goes back by some counts
        // of it and on again, of which the output goes nothing.
        let on = TUNING.rise.on;
        along(cell, aim, scan, -length - hides - on, speed).await?;
        along(cell, aim, scan, hides, speed).await?;
        for _ in 0..TUNING.rise.waits {
            lead(cell, aim, scan).await?;
        }
        along(cell, aim, scan, on, speed).await?;
        let (mut seen, mut nearest) = (Vec::new(), f64::INFINITY);
        for step in 0..=TUNING.rise.steps {
            if step > 0 {
                let way = length / f64::from(TUNING.rise.steps);
                along(cell, aim, scan, way, speed).await?;
            }
            lead(cell, aim, scan).await?;
            for _ in 0..TUNING.rise.turns {
                lead(cell, aim, scan).await?;
                let Some(peak) = scan.clear_peak() else {
                    return Ok(None);
                };
                let gap = aim.gap_by_encoders(cell);
                nearest = gap.min(nearest);
                if gap > nearest + TUNING.rise.back {
                    return Ok(None);
                }
                seen.push(Seen {
                    gap,
                    light: peak.full.ln(),
                    deviation: (peak.full_deviation / peak.full).hypot(scan.flicker().deviation()),
                });
            }
        }
        let wave = TAU / length;
        let falls = cell.beam(aim.side, self.recipe).falls(aim.gap(cell));
        Ok(Ripple::of(&seen, wave, falls))
    }
}

/// Goes so far along z on the circle, metres, at a speed.
async fn along(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &mut ConicalScan<'_>,
    way: f64,
    speed: f64,
) -> Result<(), Halt> {
    let end = cell.wanted(aim.side).shifted(0.0, 0.0, way);
    cell.start_line(aim.side, end, Some(speed))?;
    while cell.is_moving(aim.side) {
        let led = aim.led(cell);
        scan.step(cell, led, f64::INFINITY).await?;
    }
    Ok(())
}

/// Where widths and vision together have it that fiber and chip touch, if vision does not contradict the light: what the gap by vision and encoders
/// is there.
fn touching(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    widths: &[SeenWidth],
    (scan, spread): (&ConicalScan<'_>, Spread),
) -> Option<Contact> {
    let seen = cell.seen(aim.side, aim.tip)?;
    // What vision adds to the gap by encoders.
    let added = aim.gap(cell) - aim.gap_by_encoders(cell);
    let by_now = |width: &SeenWidth| width.by_now(cell.now(), added, seen.sigma[1]);
    let (widths, variances): (Vec<_>, Vec<_>) = widths.iter().map(by_now).unzip();
    let n = variances.len() as f64;
    let moved = variances.iter().map(|v| v / n).sum::<f64>().sqrt();
    let known = Known {
        squared: [scan.beam_width(0.0).powi(2); 2],
        spread,
        at: -added,
        bound: seen.bound_z,
        sigma: seen.sigma_z(),
        hidden: hidden(cell.spec()),
    };
    let found = contact(&widths, &known)?;
    let (at, deviation) = found.by_light;
    let most = known.bound + TUNING.gap.far_off * known.sigma.hypot(deviation).hypot(moved);
    ((at + added).abs() <= most).then_some(Contact {
        at: found.at + added,
        deviation: found.deviation.hypot(moved),
        ..found
    })
}

/// What a z-stage's transmission keeps to itself of the way between two looks, standard deviation, metres: more where its datasheet says that it winds
/// up by more.
fn hidden(spec: &Spec) -> f64 {
    let wound = TUNING.width.of_windup * spec.guard.windup_z;
    TUNING.width.hidden.max(wound)
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
        let warmed = TUNING.vision.warms * (now - self.time).sqrt();
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

/// Has the micro stand in its middle where the peak is at a gap: a piezo goes a little farther or less far elsewhere, and a percent of
/// it is a percent of the width.
pub(super) async fn to_middle(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &mut ConicalScan<'_>,
    at: f64,
) -> Result<(), Halt> {
    aside_to_middle(cell, aim, scan, at).await?;
    for _ in 0..TUNING.gap.still {
        // What a macro's transmission hides of its way aside, the light tells.
        lead(cell, aim, scan).await?;
    }
    Ok(())
}

/// The same without waiting until the macro stands still.
async fn aside_to_middle(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &mut ConicalScan<'_>,
    at: f64,
) -> Result<(), Halt> {
    let gap = aim.gap(cell);
    let aside = scan.place(at);
    hand_over(cell, scan, aim.side, aside, gap).await
}

/// A turn, and to where it found the peak.
async fn lead(cell: &AlignmentCell<'_>, aim: &Aim, scan: &mut ConicalScan<'_>) -> Result<(), Halt> {
    let gap = aim.gap(cell);
    scan.turn(cell, gap).await?;
    if let Some(peak) = scan.clear_peak() {
        scan.go_to(cell, &peak, gap)?;
    }
    Ok(())
}

/// Looks beside the spot what there is without it: where a search began in its light that was taken for the background, and a hundredth of
/// the light that is missing everywhere makes the spot narrower by as much as half a micrometre of gap does. Whether the spot stayed where it
/// was meanwhile: where it did not at any look, what was seen is no background.
async fn beside(
    job: &Job<'_>,
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &mut ConicalScan<'_>,
) -> Result<bool, Halt> {
    for _ in 0..TUNING.gap.beside_again {
        centred(cell, aim, scan).await?;
        let gap = aim.gap(cell);
        // One that is three times as wide upward as across has a tenth of its light where another has none.
        let (spot, width) = (scan.place(gap), scan.beam_width(gap));
        let [across, up] = scan.beam_widths(gap).map(|wide| TUNING.gap.beside * wide);
        // Below it: what goes across before an inclined facet is believed to come nearer to the chip. Or away from where the micro's way ends.
        let below = spot - Displacement::new(0.0, up);
        let lowest = below - Displacement::new(0.0, width);
        let there = if cell.micro_reaches(aim.side, lowest) {
            below
        } else {
            spot - Displacement::new(across.copysign(spot.x), 0.0)
        };
        // A way of some widths sets a micro swinging that is hardly damped, and one that swings past the spot sees light there.
        let turns = TUNING.gap.beside_turns.max(scan.turns_to_settle(cell));
        scan.expect_at(there, gap);
        turn(cell, scan, gap, turns).await?;
        let level = dimmest(job, cell, aim, scan).await?;
        scan.set_background(level.mean);
        scan.expect_at(spot, gap);
        turn(cell, scan, gap, turns).await?;
        // Where a macro still brings out what its transmission hid, the spot was not where it was believed to be, nor was this beside it.
        centred(cell, aim, scan).await?;
        if (scan.place(gap) - spot).norm() < TUNING.gap.beside_moved * width {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The light where the micro is, once it is at rest there.
async fn dimmest(
    job: &Job<'_>,
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &ConicalScan<'_>,
) -> Result<Level, Halt> {
    let seconds = f64::from(TUNING.gap.beside_turns) * scan.period();
    let mut level = cell.level(job.channel, seconds).await?;
    if cell.settles(aim.side) {
        return Ok(level);
    }
    // Nobody measured how long it swings: until no light goes any more.
    for _ in 0..TUNING.gap.beside_looks {
        let before = level;
        level = cell.level(job.channel, seconds).await?;
        let n = f64::from(TUNING.gap.beside_turns) * scan.samples() as f64;
        let chance = before.sigma.hypot(level.sigma) / n.sqrt();
        if level.mean > before.mean - TUNING.gap.beside_chance * chance {
            break;
        }
    }
    Ok(level)
}

/// Some turns at a gap.
async fn turn(
    cell: &AlignmentCell<'_>,
    scan: &mut ConicalScan<'_>,
    gap: f64,
    turns: u32,
) -> Result<(), Halt> {
    for _ in 0..turns {
        scan.turn(cell, gap).await?;
    }
    Ok(())
}

/// Turns until the peak is in their middle, or as many as there may be.
async fn centred(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &mut ConicalScan<'_>,
) -> Result<(), Halt> {
    let gap = aim.gap(cell);
    let accuracy = TUNING.gap.centred * scan.beam_width(gap);
    match scan.centre(cell, gap, accuracy, "approach", 1).await {
        Err(Halt::Outcome(Outcome::Unsure { .. })) => Ok(()),
        found => found.map(|_| ()),
    }
}

/// Looks how wide the spot is here, until its square is known to a share of it.
async fn width(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    scan: &mut ConicalScan<'_>,
    share: f64,
) -> Result<Option<SeenWidth>, Halt> {
    centred(cell, aim, scan).await?;
    let gap = aim.gap(cell);
    let at = aim.gap_by_encoders(cell);
    let width = scan.width(cell, gap, at, share, cell.rounds()).await?;
    if let Some(width) = &width {
        cell.add_rounds(width.rounds);
    }
    let seen = cell.seen(aim.side, aim.tip);
    Ok(width.zip(seen).map(|(width, seen)| SeenWidth {
        width,
        added: aim.gap(cell) - aim.gap_by_encoders(cell),
        sigma: seen.sigma[1],
        time: cell.now(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_that_brakes_late_is_nowhere_stopped() {
        let (acceleration, rate) = (0.2, 2500.0);
        for spare in [1e-6, 3e-6, 6e-6, 20e-6] {
            let greatest = greatest_speed(spare, acceleration, rate);
            let worst = |times: f64| {
                // From standing still to as fast as it goes, and the way that is left at each speed.
                let left = (0..=100).map(|k| {
                    let told = greatest * f64::from(k) / 100.0;
                    let speed = times * told;
                    let way = 0.5 * told * told / acceleration;
                    let stop = speed * GuardSpec::REACTION / rate
                        + 0.5 * speed * speed / (GuardSpec::BRAKES * acceleration);
                    spare + way - stop
                });
                left.fold(f64::INFINITY, f64::min)
            };
            assert!(
                worst(TUNING.gap.faster) > -1e-12,
                "{spare} {}",
                worst(TUNING.gap.faster)
            );
            // It is no slower than it has to be.
            assert!(worst(1.02 * TUNING.gap.faster) < 0.0, "{spare}");
        }
        assert!(greatest_speed(-1e-6, acceleration, rate) > 0.0);
    }
}
