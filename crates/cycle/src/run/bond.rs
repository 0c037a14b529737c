//! Fibers at their peaks become pigtails: held under the lamp, let go, and looked at.

use super::witness::{Beside, SEEN, bending, unseen};
use super::{Begun, Cured, End, Line, SURE};
use crate::losses::{Loss, Losses};
use crate::recipe::{Cure, Production};
use crate::spread::Seen;
use crate::steadiness::{Wander, Way};
use pigtail_control::hold::{self, Followed};
use pigtail_control::job::AtPeak;
use pigtail_control::outcome::Halt;
use pigtail_hal::bench::Meter;
use pigtail_hal::{Bench, Channel, FiberHandling, Side};
use pigtail_model::frames::Displacement;
use std::cell::RefCell;

/// Looks at the light before and after, seconds.
const LOOK: f64 = 0.2;

/// For how long a fiber is followed before the lamp is on, seconds. How piezos creep is to be told apart from the pull: that is no
/// pull. Two of which one has waited for the other come to their peaks again.
pub(crate) const BEFORE: f64 = 1.0;
pub(crate) const BEFORE_TWO: f64 = 1.5;

/// For how long the first fiber of a side is, seconds: no other has told where it ended, and a machine that warms up takes it along by
/// 0.014 um/s, which is told from creep in some seconds. What is left of that after 10 s under the lamp is 0.13 um by a second,
/// and 0.02 to 0.065 um by six, where a turn knows its peak to 0.02 to 0.08 um.
pub(crate) const BEFORE_FIRST: f64 = 6.0;

/// How long before a fiber is at its peak its micro still moved, seconds: a circle comes to rest within two turns.
const CIRCLED: f64 = 0.05;

/// What a fiber has lost without whose light nobody knows, nepers: all of it, or anything.
const GONE: Loss = (14.0, 14.0);

/// A look at the light: above the background, volts, with its relative standard deviation by its samples; and the same of
/// the light through an output that is fixed.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// Its middle, seconds.
    time: f64,
    light: (f64, f64),
    fixed: Option<(f64, f64)>,
}

impl Look {
    /// Natural logarithm of the light of one look over that of another, with what both have in common taken out where a fixed
    /// output tells it; and its standard deviation by the samples. Nothing where there is no light to be seen before or after.
    fn over(&self, later: &Self) -> Option<Loss> {
        let [a, b] = [self.light, later.light];
        if [a, b]
            .iter()
            .any(|(v, sigma)| *v <= 0.0 || SEEN * sigma > 1.0)
        {
            return None;
        }
        let (mut ln, mut sigma) = ((a.0 / b.0).ln(), a.1.hypot(b.1));
        if let (Some(a), Some(b)) = (self.fixed, later.fixed) {
            ln -= (a.0 / b.0).ln();
            sigma = sigma.hypot(a.1).hypot(b.1);
        }
        Some((ln, sigma))
    }

    /// By how much the light through a fixed output was another at a later look.
    fn fixed_until(&self, later: &Self) -> Option<Wander> {
        let (before, after) = self.fixed.zip(later.fixed)?;
        Some(Wander {
            by: (after.0 / before.0).ln(),
            sigma: before.1.hypot(after.1),
            seconds: later.time - self.time,
        })
    }
}

/// What bending a fiber has told: the square of the share of its holder's way that it goes along, with its standard deviation, and where it is.
#[derive(Debug, Clone, Copy)]
struct Bent {
    share: [f64; 2],
    beside: Option<Beside>,
}

impl Beside {
    /// The same of a fiber once it is let go, which was fixed `beyond` its peak, metres: the adhesive then pulls by the share of its shift since
    /// that the holder has kept from it.
    fn once_let_go(self, beyond: Displacement, cure: &Cure) -> Self {
        let times = 1.0 / (1.0 - cure.released);
        Self {
            at: beyond + (self.at - beyond) * times,
            sigma: self.sigma.map(|sigma| (times * sigma).hypot(cure.let_go)),
        }
    }

    /// What that costs in a light that falls to 1/e at `width`, nepers.
    fn cost(self, width: f64) -> Loss {
        let Self { at, sigma: [x, y] } = self;
        let widths = [(at.x, x), (at.y, y)].map(|(at, sigma)| (at / width, sigma / width));
        let cost = widths.map(|(at, sigma)| at * at + sigma * sigma);
        let square = widths.map(|(at, sigma)| (2.0 * at * sigma).powi(2) + 2.0 * sigma.powi(4));
        (cost.iter().sum(), square.iter().sum::<f64>().sqrt())
    }

    /// How far that is from the peak, metres, and its standard deviation.
    fn distance(self) -> (f64, f64) {
        let far = self.at.norm();
        let share = |x: f64| if far > 0.0 { x / far } else { 0.5_f64.sqrt() };
        let [x, y] = self.sigma;
        (far, (share(self.at.x) * x).hypot(share(self.at.y) * y))
    }
}

/// Why a loss is not accepted, decibels with its standard deviation, where at most so much is; `of` says of what.
fn not_accepted((lost, sigma): Loss, accepted: f64, of: &str) -> Option<String> {
    let at_most = lost + SURE * sigma;
    if at_most > accepted || !at_most.is_finite() {
        return Some(format!(
            "cure and release{of} have added {lost:.3} dB, known to {sigma:.3} dB; accepted are {accepted} dB"
        ));
    }
    // What was at its peak has no more light afterwards: the laser was off before, or something stood in the light.
    (at_most < -accepted).then(|| {
        format!(
            "after cure and release{of} there is more light than before, by {:.3} dB, known to {sigma:.3} dB; more than {accepted} dB are not believed",
            -lost
        )
    })
}

impl Line<'_, '_, '_> {
    /// One fiber, or the input and an output together, from the peak to the bond.
    pub(super) fn bond<const N: usize>(
        &mut self,
        production: &Production,
        mut fibers: [(&mut Begun, &AtPeak); N],
    ) -> Result<(), End> {
        let adhesive = &production.adhesive;
        for (begun, held) in &fibers {
            let now = self.cell.now();
            let waited = self.wet[held.side.index()].map_or(0.0, |since| now - since);
            if waited > adhesive.open {
                let detail = format!(
                    "adhesive of {} was {waited:.0} s in the air; accepted are {} s",
                    begun.pigtail.port, adhesive.open
                );
                return Err(End::Failed("adhesive".to_owned(), detail, adhesive.failed));
            }
        }
        let cured = self.cure(production, &fibers).map_err(|halt| match halt {
            Halt::Fault(fault) => End::Fault(fault),
            Halt::Outcome(outcome) => {
                let detail = outcome.to_string();
                End::Failed("cure".to_owned(), detail, production.verify.failed)
            }
        })?;
        for ((begun, _), cured) in fibers.iter_mut().zip(cured) {
            begun.pigtail.cured = Some(cured);
        }
        let verify = &production.verify;
        let of = if N > 1 { " of both fibers" } else { "" };
        if let Some(detail) = not_accepted(cured[0].lost(), verify.added_loss_db, of) {
            return Err(End::Failed("added_loss".to_owned(), detail, verify.failed));
        }
        let last = fibers[N - 1].1;
        if last.side == Side::Right {
            self.reference = Some((Meter(last.channel.index()), last.background));
        }
        Ok(())
    }

    /// Holds fibers under the lamp, lets them go and looks at their light.
    #[expect(
        clippy::too_many_lines,
        reason = "from the lamp to what the light tells, in order"
    )]
    fn cure<const N: usize>(
        &mut self,
        production: &Production,
        fibers: &[(&mut Begun, &AtPeak); N],
    ) -> Result<[Cured; N], Halt> {
        let cure = production.cure;
        let (start, last) = (self.cell.now(), fibers[N - 1].1);
        // What goes through both fibers is seen behind the last.
        let held: [AtPeak; N] = std::array::from_fn(|i| AtPeak {
            channel: last.channel,
            level: last.level,
            background: last.background,
            ..*fibers[i].1
        });
        let on = |i: usize| {
            let pigtail = &fibers[i].0.pigtail;
            (pigtail.device.as_str(), pigtail.port.as_str())
        };
        let sides = held.map(|held| held.side);
        for (i, (begun, _)) in fibers.iter().enumerate().take(N - 1) {
            self.cell.note(sides[i], on(i), "witness", true, begun.peak);
        }
        let since: [f64; N] = std::array::from_fn(|i| fibers[i].0.peak - CIRCLED);
        let creep = if cure.track {
            let taught = |side: &Side| self.teachers[side.index()].fibers() > 0;
            let until = start
                + match N {
                    _ if !sides.iter().all(taught) => BEFORE_FIRST,
                    1 => BEFORE,
                    _ => BEFORE_TWO,
                };
            let rest = |_: usize, _: Displacement| Displacement::ZERO;
            self.follow(&held, (since, until), rest)?
        } else {
            None
        };
        let creep = creep.map(|followed| followed.map(|followed| followed.creep));
        let known = self.cell.now();
        let alone = N == 1 && sides[0] == Side::Left;
        let eye = (last.channel, last.background);
        let around = if alone { self.look_around(eye)? } else { None };
        let before = self.look_at(last.channel, last.background, LOOK)?;
        self.ask_all(&sides, FiberHandling::Lamp(true))?;
        let lit = self.cell.now();
        let mut expected = [Displacement::ZERO; N];
        let mut pulled = [Displacement::ZERO; N];
        let followed = if let Some(creep) = creep {
            let (rest, ratio) = (lit + production.rest(), production.ratio());
            let teachers = self.teachers.clone();
            let beyond = |i: usize, gone: Displacement| {
                // What the micro has crept by itself was no pull.
                pulled[i] = gone + creep[i].between(known, rest);
                expected[i] = teachers[sides[i].index()].expect(pulled[i], ratio, cure.scatter);
                if cure.precompensate {
                    expected[i] * -1.0
                } else {
                    Displacement::ZERO
                }
            };
            self.follow(&held, (since, rest), beyond)?
        } else {
            None
        };
        let bent = match &followed {
            Some(followed) => self.bend(production, lit, eye, (&held, followed))?,
            None => [None; N],
        };
        let shares = bent.map(|bent| bent.map(|bent| bent.share));
        let bent = bent.map(|bent| bent.and_then(|bent| bent.beside));
        self.cell.wait_until(lit + cure.time - LOOK)?;
        let cured = self.look_at(last.channel, last.background, LOOK)?;
        self.ask_all(&sides, FiberHandling::Lamp(false))?;
        for (i, side) in sides.into_iter().enumerate() {
            self.cell.note(side, on(i), "cure", true, start);
        }
        let release = self.cell.now();
        self.ask_all(&sides, FiberHandling::Release)?;
        for (i, side) in sides.into_iter().enumerate() {
            self.wet[side.index()] = None;
            self.cell.note(side, on(i), "release", false, release);
        }
        let verify = self.cell.now();
        let after = self.look_at(last.channel, last.background, production.verify.look)?;
        for (i, side) in sides.into_iter().enumerate() {
            self.cell.note(side, on(i), "verify", false, verify);
        }
        if alone {
            self.cell.note(Side::Right, on(0), "witness", true, start);
        }
        let (lost_cured, told) = (before.over(&cured), before.over(&after));
        let ((lost_cured, _), (lost, noise)) = (lost_cured.unwrap_or(GONE), told.unwrap_or(GONE));
        let seen = told.is_some();
        let passed = after.time - before.time;
        // Light that the sensing fiber has lost or won by itself.
        let drifts = match around {
            _ if !alone => 0.0,
            Some(around) => around.drifts_in(passed),
            None => unseen(passed),
        };
        let noise = noise.hypot(drifts);
        let wander = before.fixed_until(&after);
        let way = match wander {
            Some(_) => Way::HeldAgainst,
            None => Way::Alone,
        };
        let wanders = self.steadiness.of(way, passed);
        let light_sigma = noise.hypot(wanders);
        let width: [f64; N] = std::array::from_fn(|i| {
            let beam = || held[i].beam.width(held[i].gap);
            followed
                .as_ref()
                .map_or_else(beam, |followed| followed[i].width)
        });
        // A place tells nothing of a fiber whose light is not there.
        let places: [Option<Loss>; N] =
            std::array::from_fn(|i| bent[i].filter(|_| seen).map(|beside| beside.cost(width[i])));
        let ripple = self.ripples.sigma();
        let losses = Losses::told((lost, light_sigma), places, ripple);
        // What light does beyond places and ripples the laser does.
        let shown = wander.or_else(|| {
            let unsure = losses.places?.1;
            Some(Wander {
                by: lost - losses.places?.0,
                sigma: unsure.hypot(noise).hypot(ripple * (N as f64).sqrt()),
                seconds: passed,
            })
        });
        let rippled = losses.places.map(|(cost, unsure)| Seen {
            by: lost - cost,
            sigma: unsure.hypot(light_sigma),
            times: N as f64,
        });
        let shown = shown.filter(|_| seen);
        self.steadiness.learn(shown);
        self.ripples.learn(rippled);
        let share = 1.0 / N as f64;
        let decibels = 10.0 / std::f64::consts::LN_10;
        let in_db = |(lost, sigma): Loss| [decibels * lost, decibels * sigma];
        let um = |d: Displacement| [1e6 * d.x, 1e6 * d.y];
        Ok(std::array::from_fn(|i| {
            let followed = followed.as_ref().map(|followed| followed[i]);
            let (own, sigma) = losses.each[i];
            let squared = width[i] * width[i] * share * lost;
            // What of it the gap has done, nobody sees.
            let noise = width[i] * width[i] * if N > 1 { sigma } else { sigma.hypot(ripple) };
            let pulled = followed.filter(|_| seen).map(|_| pulled[i]);
            let beyond = followed.map_or(Displacement::ZERO, |followed| followed.beyond);
            let by_loss = || {
                let off = squared.max(0.0).sqrt();
                (off, noise / (2.0 * off.max(noise.sqrt())))
            };
            let (off, off_sigma) = bent[i].map_or_else(by_loss, Beside::distance);
            let came = bent[i].map_or(expected[i], |beside| beside.at - beyond);
            let all = pulled.map_or(off, |pulled| (pulled + came).norm());
            let cured = Cured {
                after_cure_db: decibels * share * lost_cured,
                after_release_db: decibels * own,
                sigma_db: decibels * sigma,
                by_light_db: Some(in_db((lost, light_sigma))),
                by_place_db: places[i].map(in_db),
                before_um: pulled.map(um),
                beyond_um: um(beyond),
                expected_um: um(beyond + expected[i]),
                beside_um: bent[i].map(|beside| [um(beside.at), beside.sigma.map(|s| 1e6 * s)]),
                share: shares[i],
                off_um: 1e6 * off,
                squared_um2: [1e12 * squared, 1e12 * noise],
                off_sigma_um: 1e6 * off_sigma,
                shift_um: 1e6 * all,
                together_db: (N > 1).then_some(decibels * losses.all.0),
                light_sigma_db: decibels * losses.all.1,
                wander: wander.map(|wander| wander.by),
                // Of two that were cured together one carries what both have shown.
                look: shown.filter(|_| i + 1 == N),
                rippled: rippled.filter(|_| i + 1 == N),
            };
            if let Some(lesson) = cured.lesson() {
                self.teachers[sides[i].index()].learn(lesson);
            }
            cured
        }))
    }

    /// Bends fibers that have cured a little by their holders, one after the other, just before the lamp goes off: where each will be from
    /// its peak once it is let go. Nothing where the cure is too short for that: at twice the time of the gel point it is a solid.
    fn bend<const N: usize>(
        &mut self,
        production: &Production,
        lit: f64,
        eye: (Channel, f64),
        (held, followed): (&[AtPeak; N], &[Followed; N]),
    ) -> Result<[Option<Bent>; N], Halt> {
        let cure = &production.cure;
        let each = bending(cure.bend);
        let begins = cure.time - LOOK - each * N as f64;
        let mut bent = [None; N];
        if cure.bend == 0.0 || begins < 2.0 * cure.gel {
            return Ok(bent);
        }
        self.cell.wait_until(lit + begins)?;
        // From one look to the next.
        let flickers = self.steadiness.of(Way::Alone, 0.2 * each);
        for i in 0..N {
            let aside = cure.bend.min(self.room_aside(held[i].room));
            let Some(around) = self.look_bent(held[i].side, eye, aside)? else {
                continue;
            };
            let Followed { width, beyond, .. } = followed[i];
            let share = around.share(width, flickers);
            let shares = &mut self.shares[held[i].side.index()];
            let beside = around.beside_peak(width, flickers, shares.of(share));
            shares.learn(Some(share));
            let beside = beside.map(|beside| beside.once_let_go(beyond, cure));
            bent[i] = Some(Bent { share, beside });
        }
        Ok(bent)
    }

    /// How far aside, metres, a fiber may seem to go before its inclined facet, for who guards the machine: it has it come nearer by that, and
    /// one whose gap light has told may stand near by vision. `room` is how much nearer it may come, metres.
    fn room_aside(&self, room: f64) -> f64 {
        /// How much less room there may be by now, for what warms and for what the adhesive has drawn along since, metres (1.5 um was seen in
        /// 30 s); and how much farther aside the fiber is than when it came near, for the circles that it was on: choices.
        const DRAWN: f64 = 2e-6;
        const CIRCLES: f64 = 3e-6;
        let slope = self.order.recipe.ports.slope().abs();
        if slope == 0.0 {
            return f64::INFINITY;
        }
        ((room - DRAWN) / slope - CIRCLES).max(0.0)
    }

    /// Follows the peaks of one fiber or two, whose micros have rested since some times, until another, and goes beyond each as far as
    /// `beyond` says of its number and of how far it was pulled until then, were all of it a pull.
    fn follow<const N: usize>(
        &mut self,
        held: &[AtPeak; N],
        (since, until): ([f64; N], f64),
        beyond: impl FnMut(usize, Displacement) -> Displacement,
    ) -> Result<Option<[Followed; N]>, Halt> {
        let recipe = self.order.recipe;
        let beyond = RefCell::new(beyond);
        let go = |i: usize| {
            let beyond = &beyond;
            move |gone| (beyond.borrow_mut())(i, gone)
        };
        let mut all: Vec<Followed> = Vec::with_capacity(N);
        match (&held[..], &since[..]) {
            ([one], [since]) => {
                let times = (*since, until);
                all.push(hold::follow(&mut self.cell, recipe, one, times, go(0))?);
            }
            ([a, b], [of_a, of_b]) => {
                let times = ([*of_a, *of_b], until);
                let go: [&mut dyn FnMut(Displacement) -> Displacement; 2] =
                    [&mut go(0), &mut go(1)];
                all.extend(hold::follow_two(&mut self.cell, recipe, [a, b], times, go)?);
            }
            _ => return Ok(None),
        }
        Ok(all.try_into().ok())
    }

    /// Looks at the light of a meter, and at that of an output which is fixed.
    fn look_at(&mut self, channel: Channel, background: f64, seconds: f64) -> Result<Look, Halt> {
        let above = |(volts, sigma): (f64, f64), background: f64| {
            let light = volts - background;
            (light, sigma / light.abs().max(f64::MIN_POSITIVE))
        };
        let meter = Meter(channel.index());
        let time = self.cell.now() + 0.5 * seconds;
        Ok(match self.reference {
            Some((fixed, dark)) if fixed != meter => {
                let [light, other] = hold::levels(&mut self.cell, [meter, fixed], seconds)?;
                Look {
                    time,
                    light: above(light, background),
                    fixed: Some(above(other, dark)).filter(|(light, _)| *light > 0.0),
                }
            }
            _ => {
                let [light] = hold::levels(&mut self.cell, [meter], seconds)?;
                Look {
                    time,
                    light: above(light, background),
                    fixed: None,
                }
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A look at a light, volts, with what else is read.
    fn look(light: f64, noise: f64) -> Look {
        Look {
            time: 0.0,
            light: (light, noise / light.abs()),
            fixed: None,
        }
    }

    /// Why a fiber of which light alone tells is not accepted.
    fn told(before: Look, after: Look) -> Option<String> {
        let light = before.over(&after).unwrap_or(GONE);
        let all = Losses::told(light, [None], 0.02).all;
        let decibels = 10.0 / std::f64::consts::LN_10;
        not_accepted((decibels * all.0, decibels * all.1), 0.5, "")
    }

    #[test]
    fn a_fiber_whose_light_fails_is_never_accepted() {
        let (full, dark) = (1.0, 1e-3);
        assert_eq!(told(look(full, dark), look(0.98 * full, dark)), None);
        // The laser off afterwards, before, and both times: what is left is noise, above zero or below.
        for left in [2.0 * dark, 0.1 * dark, -0.5 * dark] {
            for (before, after) in [(full, left), (left, full), (left, left), (left, -left)] {
                let why = told(look(before, dark), look(after, dark));
                assert!(why.is_some(), "{before} V, then {after} V");
            }
        }
    }

    #[test]
    fn what_a_place_costs_saves_no_fiber_whose_light_fails() {
        let (full, dark) = (1.0, 1e-3);
        for (before, after) in [(full, dark), (dark, full), (full, 0.5 * full)] {
            let light = look(before, dark).over(&look(after, dark));
            let place = light.map(|_| (0.01, 0.005));
            let told = Losses::told(light.unwrap_or(GONE), [place], 0.02).all;
            let decibels = 10.0 / std::f64::consts::LN_10;
            let why = not_accepted((decibels * told.0, decibels * told.1), 0.5, "");
            assert!(why.is_some(), "{before} V, then {after} V: {told:?}");
        }
    }
}
