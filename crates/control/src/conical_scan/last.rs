//! The last turns at the chip: the peak as it will be, a look at it from near, and the way to rest.

use super::ahead::{Ahead, Moved, aged, late, recent};
use super::answer::{Answer, Turn};
use super::follows::Follows;
use crate::tuning::TUNING;

use super::{ConicalScan, Gap};
use crate::beam::{Peak, Reading, SpotSize};
use crate::belief::Known;
use crate::flicker::Flicker;
use crate::gap_by_light::Width;
use crate::outcome::{Halt, Outcome};
use crate::reactor::Reactor;
use crate::still_there::Foreseen;
use pigtail_model::frames::Displacement;

/// From the middle of the small turn to its end, turns.
const HALF_TURN: f64 = 0.5;

/// Whether turns at a steady gap may end, for all but the peak.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ready {
    /// As soon as the peak is known.
    Yes,
    /// Something else is to be known yet.
    NotYet,
    /// They are to be made at another gap.
    Elsewhere,
}

impl From<bool> for Ready {
    fn from(ready: bool) -> Self {
        if ready { Self::Yes } else { Self::NotYet }
    }
}

impl ConicalScan<'_> {
    /// Turns at a steady gap, `more` times as many as usual at most, until it is known to `accuracy` metres (one standard deviation, by
    /// how the turns' peaks scatter about a straight line in time) where the peak will be in
    /// [`Self::confirm`], and until all else is `ready`; and goes there. For piezos creep. The first turns only lead there. Light so dim that it is not known so
    /// well after many turns tells as well as it does: it is the probability of being outside that decides.
    /// Where they are to be made at another gap ([`Ready::Elsewhere`]) the peak is that of the last turn.
    ///
    /// # Errors
    ///
    /// As [`Self::centre`]; [`Outcome::Misshapen`] where the light is not that of a peak.
    pub async fn settle(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        (accuracy, more): (f64, f64),
        phase: &'static str,
        ready: &impl Fn() -> Ready,
    ) -> Result<Peak, Halt> {
        let most = TUNING.last.most_turns * self.shape.turns;
        let start = self.centre;
        (self.wanted, self.more) = (accuracy, more);
        let (mut dark, mut deviation, mut misfit, mut best) = (0, f64::INFINITY, 0.0, None);
        let mut follows = Follows::default();
        let mut seen: Vec<Turn> = Vec::with_capacity(self.shape.turns as usize);
        if self.wary && self.played.is_some_and(|(_, law)| law.radius.to == 0.0) {
            // The way from rest to the circle is no part of it.
            self.turn(bench, gap).await?;
        }
        for _ in 0..(f64::from(most) * more) as u32 {
            let Some(mut peak) = self.seek(bench, gap, phase, &mut dark).await? else {
                continue;
            };
            let off = peak.at - self.centre;
            if off.norm() > TUNING.circle.near * self.beam.width(gap) {
                // Not there yet: what was seen from there does not count.
                seen.clear();
                best = None;
                self.go_by(bench, &peak, gap, &mut follows)?;
                let far = (self.centre - start).norm();
                if far > TUNING.circle.nearby * self.beam.width(gap) {
                    return Err(self.astray(phase, TUNING.circle.nearby, start, gap));
                }
                continue;
            }
            follows = Follows::default();
            if let Some(before) = seen.last() {
                self.flicker.add(&before.peak, &peak);
            }
            seen.push(self.turned(bench, peak));
            // What a micro does that does not go where it is told is oblong askew: piezos do not move in x and y.
            let readings: &[Reading] = self.readings.make_contiguous();
            self.beam
                .tell(&mut self.oblong, readings, &peak, self.watch.noise);
            self.beam.set_oblong(&self.oblong);
            if let Some(seen) = self.shakes(&peak, gap)
                && !self.shaking.is_watched()
            {
                self.shaking.add_wide(&seen);
            }
            if self.learn_piezos(bench, gap, &peak).await? {
                // What was seen of other strokes does not count.
                seen.clear();
                best = None;
                continue;
            }
            if ready() == Ready::Elsewhere {
                self.go_to(bench, &peak, gap)?;
                return Ok(peak);
            }
            if seen.len() < TUNING.last.fewest {
                self.go_to(bench, &peak, gap)?;
                continue;
            }
            // A peak is that of the middle of its turn; the circle is left a turn later.
            let noise = peak.deviation();
            let last = peak;
            let (ahead, unsettled) = self.foresee(bench, &seen, &last)?;
            let [x, y] = &ahead;
            peak.at = Displacement::new(x.at, y.at);
            peak.deviations = [x.deviation, y.deviation];
            self.note_motion(&ahead, &last, seen.len());
            let slope = self.drift.norm();
            self.go_to(bench, &peak, gap)?;
            deviation = peak.deviation();
            // A peak that a circle's middle runs after, or that is no peak's shape, is that of a micro
            // which does not go where it is told.
            misfit = self.misfit(&last, gap, 1.0);
            if slope > self.slower * TUNING.last.fastest + TUNING.circle.significant * noise
                || misfit > TUNING.last.misfit
            {
                seen.clear();
                best = None;
                continue;
            }
            // The small turn to come knows the less the smaller it is.
            let small = last.deviation() * self.shape.radius / self.small(&last, gap);
            let together = deviation * small / deviation.hypot(small);
            self.around.clear();
            self.around
                .extend(self.readings.iter().map(|r| (r.at - self.centre, r.volts)));
            let long = seen.len() >= 2 * self.shape.turns as usize;
            let ready = || !unsettled && ready() == Ready::Yes;
            if deviation < TUNING.last.wide * accuracy
                && (together < TUNING.last.together * accuracy || long)
                && ready()
            {
                self.turns = seen;
                return Ok(peak);
            }
            best = Some(peak).filter(|_| long);
        }
        if let Some(best) = best.filter(|_| deviation < TUNING.last.roughly) {
            self.turns = seen;
            return Ok(best);
        }
        Err(undecided(misfit, (deviation, accuracy)).into())
    }

    /// Where peaks lead, in x and in y, and whether they scatter by more than the noise of the `last` of them, and not for long enough yet:
    /// what makes them may be slow.
    fn foresee(
        &self,
        bench: &Reactor<'_>,
        seen: &[Turn],
        last: &Peak,
    ) -> Result<([Ahead; 2], bool), Outcome> {
        let ahead = TUNING.ahead.ahead + self.waits(bench) / self.period;
        if !self.wary {
            let of = [|peak: &Peak| peak.at.x, |peak: &Peak| peak.at.y];
            let means = self.shaking.measured_means();
            let strays = TUNING.ahead.strays.powi(2) * self.slower;
            let foreseen = [0, 1].map(|i| {
                let least = last.deviations[i].powi(2) + means;
                Ahead::of(seen, of[i], (least, strays), ahead)
            });
            return Ok((foreseen, false));
        }
        let noise = last.deviation();
        let most = TUNING.last.most_turns * self.shape.turns;
        let seen = recent(seen, most as usize);
        let answer = Answer::of(seen, self.period, noise, (ahead, ahead));
        if let Some(why) = answer.is_foreign() {
            return Err(Outcome::BenchFailed { why });
        }
        let free = 2.0 * seen.len() as f64 - 4.0;
        let most = noise * noise * (1.0 + TUNING.ahead.chance * (2.0 / free).sqrt());
        let unsettled = answer.scatter > most && seen.len() < TUNING.last.watched;
        Ok((Ahead::answered(&answer), unsettled))
    }

    /// Notes how the peak drifts and how turns scatter about that, of so many that lead there.
    fn note_motion(&mut self, ahead: &[Ahead; 2], last: &Peak, turns: usize) {
        let [x, y] = ahead;
        self.drift = Displacement::new(x.slope, y.slope);
        self.drifts = [x.slope_deviation, y.slope_deviation];
        self.surely = Displacement::new(x.surely(), y.surely());
        let noises = last.deviations.map(|noise| noise * noise);
        // Whoever knows nothing of a bench follows what wanders by all turns together.
        if !self.wary {
            self.unrest = [0, 1].map(|i| (ahead[i].each - noises[i]).max(0.0));
            let seen = [0, 1].map(|i| ahead[i].scatter - noises[i]);
            self.scatter = (seen, turns as f64 - 2.0);
        }
        if !self.shaking.is_watched() {
            let free = turns as f64 - 2.0;
            self.shaking.set_slow([x.scatter, y.scatter], noises, free);
        }
    }

    /// How long the micro is left to itself on the small circle before light on it counts, seconds: on its first turn a tip is elsewhere than on
    /// those that follow.
    fn waits(&self, bench: &Reactor<'_>) -> f64 {
        if self.wary {
            self.period
        } else {
            bench.settling(self.watch.group)
        }
    }

    /// A turn that is over now, and the peak that it has found.
    fn turned(&self, bench: &Reactor<'_>, peak: Peak) -> Turn {
        Turn {
            peak,
            middle: self.centre,
            time: bench.now(),
        }
    }

    /// By how much the light itself differs from one turn to the next. By the turns of [`Self::settle`], and by those from before.
    pub fn flicker(&self) -> Flicker {
        self.flicker
    }

    /// By how much less piezos creep in a turn by now than after the fewest turns that foresee a peak: they do by the logarithm of time.
    pub(super) fn creeps(&self) -> f64 {
        TUNING.last.fewest as f64 / self.turns.len().max(TUNING.last.fewest) as f64
    }

    /// Radius of the small turn around a peak, in its widths.
    fn small(&self, peak: &Peak, gap: f64) -> f64 {
        let noise = self.watch.noise / (peak.full * self.beam.share(gap));
        (TUNING.last.noisy * noise.hypot(self.flicker.deviation()))
            .sqrt()
            .clamp(TUNING.last.smallest, TUNING.last.largest)
    }

    /// Turns on a circle of so many widths until the micro no longer rings from the way there.
    async fn look_near(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        foreseen: &Peak,
        radius: f64,
        phase: &'static str,
    ) -> Result<Near, Halt> {
        self.shrink(bench, gap, radius, TUNING.circle.shrink)
            .await?;
        self.last_for(bench, Gap::Steady(gap), self.waits(bench))
            .await?;
        let shorter = self.shorter(radius);
        let (mut turns, mut before, mut rings, mut led) = (0, f64::INFINITY, false, false);
        let mut earlier = None;
        let creeps = self.slower * self.creeps();
        let seen = loop {
            self.turn(bench, gap).await?;
            let Some(seen) = self.peak() else {
                return Err(Outcome::LightLost {
                    phase,
                    level: 0.0,
                    expected: foreseen.full * self.beam.share(gap),
                }
                .into());
            };
            let seen = self.by_its_light(&seen, gap);
            let swing = self.swing(&seen, gap);
            rings |= swing * shorter > TUNING.last.quiet;
            let quiet = swing < TUNING.last.quiet || !rings;
            // What swings near twice the circle's rate looks like a peak elsewhere, until it has died away.
            let old = aged(led, turns) * creeps;
            let moved = || Moved::of(foreseen, &self.unsteady(&seen, 1), old);
            let believed = self.agrees(gap, foreseen, &seen, earlier.as_ref());
            if quiet && (turns == TUNING.last.ringing || believed && moved().is_none()) {
                break seen;
            }
            earlier = Some(seen);
            if !quiet && (swing > TUNING.last.lasting * before || turns == TUNING.last.ringing) {
                let shakes = TUNING.last.shakes * self.shaking.measured_before();
                let most = TUNING
                    .last
                    .swings
                    .max(shakes)
                    .max(self.no_swing_as_before(&seen, gap));
                if swing > most {
                    return Err(Outcome::Unsure {
                        deviation: swing,
                        accuracy: most,
                    }
                    .into());
                }
                break seen;
            }
            (before, turns) = (swing, turns + 1);
            if !quiet {
                self.go_to(bench, &seen, gap)?;
                led = true;
            }
        };
        // On the way to this circle and on it nothing has moved.
        self.moved = if led { self.moved } else { 0.0 };
        let (seen, times) = self.look_on(bench, gap, seen, phase).await?;
        let old = aged(led, turns + times - 1) * creeps;
        Ok(Near {
            seen,
            times,
            old,
            rings,
        })
    }

    /// The way to rest from a circle of so many widths makes the micro ring as the way to that circle did, and is this much shorter.
    fn shorter(&self, radius: f64) -> f64 {
        radius / (self.shape.radius - radius)
    }

    /// Whether a micro may ring though it is not seen to on a circle of so many widths: nobody has measured when it comes to rest, in this noise a
    /// swing would not show, and the spot looks so narrow that the micro goes farther on a circle than it is told to, as it does near its
    /// resonance. How a bench answers that nobody has measured, its turns tell.
    fn may_ring(&self, seen: &Peak, gap: f64, radius: f64) -> bool {
        let as_told = |spot: SpotSize| self.beam.times_design(&spot) > TUNING.last.as_told;
        !self.wary
            && self.forgets > 1.0
            && self.no_swing(seen, gap) * self.shorter(radius) > TUNING.last.quiet
            && !self.spot.is_some_and(as_told)
    }

    /// Whether a small turn sees the peak where it was foreseen, or where the turn `earlier` than it saw it. What swings at twice the circle's rate looks like a
    /// peak elsewhere, and dies away from turn to turn.
    fn agrees(&self, gap: f64, foreseen: &Peak, seen: &Peak, earlier: Option<&Peak>) -> bool {
        let near = |a: &Peak, b: &Peak| {
            let off = a.at - b.at;
            let most =
                [0, 1].map(|i| TUNING.last.doubtful * a.deviations[i].hypot(b.deviations[i]));
            off.x.abs() <= most[0] && off.y.abs() <= most[1]
        };
        let unsteady = |peak: &Peak| self.unsteady(peak, 1);
        let left = |peak: &Peak, radius| self.left_from(peak, radius, gap);
        let here = left(&unsteady(seen), self.radius);
        self.wary
            || near(&left(foreseen, self.shape.radius), &here)
            || earlier.is_some_and(|earlier| near(&unsteady(earlier), &unsteady(seen)))
    }

    /// More turns on the small circle where one of them tells less than is wanted, of a tip that shakes or by dim light: the mean of all, and how
    /// many they were.
    async fn look_on(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        first: Peak,
        phase: &'static str,
    ) -> Result<(Peak, u32), Halt> {
        let times = self.looks_on(&first);
        // Where turns tell as they do on a bench that nobody has measured, all of them are put together elsewhere.
        let times = if self.wary { 1 } else { times };
        let (mut at, mut full) = (first.at, first.full);
        let mut beside = self.light_beside(&first, gap);
        let by_first = self.noisier(beside);
        for _ in 1..times {
            self.turn(bench, gap).await?;
            let Some(seen) = self.peak() else {
                return Err(self.lost(phase, None, gap));
            };
            (at, full) = (at + seen.at, full + seen.full);
            let one = self.light_beside(&seen, gap);
            beside = beside.zip(one).map(|(all, one)| all.and(one));
        }
        let n = f64::from(times);
        let noisier = self.noisier(beside) / by_first;
        let mean = Peak {
            at: at / n,
            full: full / n,
            full_deviation: noisier * first.full_deviation / n.sqrt(),
            deviations: first
                .deviations
                .map(|deviation| noisier * deviation / n.sqrt()),
        };
        Ok((mean, times))
    }

    /// Turns until the peak is known well enough and all else is `ready`, then a look from near: [`Self::settle`] and
    /// [`Self::confirm`] where nothing is asked between them.
    ///
    /// # Errors
    ///
    /// As theirs.
    pub async fn last_turns(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        accuracy: (f64, f64),
        phase: &'static str,
        ready: &impl Fn() -> Ready,
    ) -> Result<(Foreseen, Known), Halt> {
        let peak = self.settle(bench, gap, accuracy, phase, ready).await?;
        self.confirm(bench, gap, &peak, phase).await
    }

    /// How wide the spot is by the last turns on both circles, and what follows from that for all else that they tell.
    fn learn_width(&mut self, gap: f64) -> Option<Width> {
        let width = self.width_here(gap);
        let wider = width.map(|width| self.wider_by(gap, &width));
        let at_contact = |w: Width| self.beam.at_contact(gap, w.squared, w.deviation);
        self.spot = width.and_then(at_contact).or(self.spot);
        self.shaking
            .set_wider(wider.map_or(1.0, |(of_steps, _)| of_steps));
        self.misjudged = wider.is_some_and(|(of_steps, _)| of_steps > TUNING.last.misjudged);
        self.wider = wider.map(|(_, squared)| squared);
        width
    }

    /// Goes around a small circle, from which the light at its middle can be told: whether the peak is
    /// where it was `foreseen`, which a piezo that has given way meanwhile would not be at. Then
    /// goes to the peak by both, each as far as it is sure, and comes to rest there. Returns the light
    /// that must be there, volts, at `gap`, and how well the place is known.
    ///
    /// # Errors
    ///
    /// The machine's fault; [`Outcome::MicroRange`] where the micro does not reach the peak;
    /// [`Outcome::LightLost`], [`Outcome::Unsure`] or [`Outcome::Misshapen`] where the peak is not
    /// believed to be there.
    pub async fn confirm(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        foreseen: &Peak,
        phase: &'static str,
    ) -> Result<(Foreseen, Known), Halt> {
        let radius = self.small(foreseen, gap);
        let small = radius * radius;
        let near = self.look_near(bench, gap, foreseen, radius, phase);
        let Near {
            mut seen,
            times,
            old,
            rings,
        } = near.await?;
        // What warms has gone on meanwhile: half as far since the middle of these turns as since what was foreseen.
        let (drift, looked) = (self.steadily(), f64::from(times - 1));
        seen.at += drift.way * (0.5 * looked);
        if let Some(shakes) = self.shakes(&seen, gap)
            && !self.shaking.is_watched()
        {
            self.shaking.add_small(&shakes);
        }
        let width = self.learn_width(gap);
        let may_ring = self.may_ring(&seen, gap, radius);
        let behind = width.map_or([0.0; 2], |width| self.behind(gap, &width, &seen));
        let (beside, aside) = self.aside(gap, width.as_ref());
        let mut foreseen = late(foreseen, old);
        foreseen.at += drift.way * looked;
        let foreseen = &foreseen;
        if let Some(Moved { way, near }) = Moved::of(foreseen, &self.unsteady(&seen, times), 0.0) {
            return Err(Outcome::Unsure {
                deviation: way,
                accuracy: near,
            }
            .into());
        }
        let accepted = TUNING.last.small_misfit * small;
        let misfit = self.misfit(&seen, gap, 1.0);
        if misfit > accepted {
            return Err(Outcome::Misshapen { misfit, accepted }.into());
        }
        let last = if rings || may_ring {
            TUNING.last.gentle
        } else {
            TUNING.last.come_to_rest
        };
        // It comes to rest, and not a moment longer than it may swing: piezos creep.
        let settling = bench.settling(self.watch.group);
        // In a turn a creep that was seen slows down; what goes on for longer is what warms, and that does so steadily.
        let soon = if self.wary {
            settling
        } else {
            settling.min(self.period)
        };
        let followed = (settling - soon) / self.period;
        let rest = HALF_TURN + last + soon / self.period;
        let longer = if self.shaking.rings() || may_ring {
            (self.forgets - 1.0) * settling
        } else {
            0.0
        };
        let (at, by_light) = if self.wary {
            let until = rest + longer / self.period;
            let noise = self.turns.last().map_or(0.0, |turn| turn.peak.deviation());
            let small = self.turned(bench, seen);
            self.turns.push(small);
            let answer = Answer::of(&self.turns, self.period, noise, (0.0, until));
            let known = [answer.deviation; 2];
            (answer.at, [known, known])
        } else {
            self.by_both(bench, gap, (foreseen, &seen), (radius, times))
        };
        let at = at - beside;
        self.go_to(bench, &Peak { at, ..seen }, gap)?;
        self.shrink(bench, gap, 0.0, last).await?;
        self.last_for(bench, Gap::Steady(gap), soon).await?;
        // The peak moves on meanwhile as it did from turn to turn.
        self.follow_drift(bench, gap, (drift.way, settling - soon))
            .await?;
        self.follow_drift(bench, gap, (self.drift, longer)).await?;
        let later = longer / self.period;
        // Fiber and guide are not quite as designed: by how much the peak is wider than believed, two
        // circles tell.
        let wide = self.shape.radius * self.shape.radius;
        let power = small / (wide - small);
        let wider = (seen.full / foreseen.full).powf(power);
        let full = seen.full * wider;
        let misfit = self.misfit(&Peak { full, ..seen }, gap, TUNING.circle.shrink);
        if misfit > accepted {
            return Err(Outcome::Misshapen { misfit, accepted }.into());
        }
        let known = self.until_fixed(by_light, (behind, aside), times, (rest, later));
        let known = drift.for_turns(followed + looked, known);
        let deviation = full
            * f64::hypot(
                (1.0 + power) * seen.full_deviation / seen.full,
                power * foreseen.full_deviation / foreseen.full,
            );
        let share = self.beam.share(gap);
        let foreseen = Foreseen {
            level: full * share,
            deviation: deviation * share,
        };
        Ok((foreseen, known))
    }
}

/// Of turns that have come to no peak: their last light was so far `off` a peak's, or the peak is known no better than to a deviation where
/// an accuracy was wanted (metres).
fn undecided(off: f64, (deviation, accuracy): (f64, f64)) -> Outcome {
    if off > TUNING.last.misfit {
        return Outcome::Misshapen {
            misfit: off,
            accepted: TUNING.last.misfit,
        };
    }
    Outcome::Unsure {
        deviation,
        accuracy,
    }
}

/// What a small circle has told.
struct Near {
    /// The peak by its last turns.
    seen: Peak,
    /// How many these were.
    times: u32,
    /// For how many turns what was foreseen has got old meanwhile, of turns in which piezos creep as after the fewest.
    old: f64,
    /// Whether the micro rang on the way there.
    rings: bool,
}
