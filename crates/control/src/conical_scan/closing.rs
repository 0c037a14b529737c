//! The approach: circles follow the peak while the gap closes, for as long as its light is there and does not stray.

use super::{ConicalScan, Gap};
use crate::outcome::{Halt, Outcome};
use crate::reactor::{LONGEST, Reactor};
use crate::tuning::TUNING;
use pigtail_hal::bench::{Event, Group, Law, Ticket};

/// A group on its way to the chip, and what the light has to be meanwhile.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Closing {
    /// The group.
    pub(crate) group: Group,
    /// Its way, where that is over only once the group has come to rest; else it is when it was brought there.
    pub(crate) rests: Option<Ticket>,
    /// Turns that are made where it ends.
    pub(crate) turns: u64,
    /// Light at the peak at no gap before, volts.
    pub(crate) before: f64,
    /// The least that it may be: light that does not come out of the guide does not grow as the gap closes. Volts.
    pub(crate) least: f64,
    /// How far the peak may walk otherwise than expected, metres: what strays farther is none.
    pub(crate) stray: f64,
}

impl ConicalScan<'_> {
    /// Follows the peak while a group closes the gap. How the gap `leads` the circles may come to be known better on the way, and so may the `gap`,
    /// metres. Whatever happens, the group is stopped before anyone tries again.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::LightLost`], [`Outcome::Strayed`] or [`Outcome::MicroRange`]; [`Outcome::BenchFailed`] where the way fails.
    pub(crate) async fn close(
        &mut self,
        bench: &Reactor<'_>,
        way: &Closing,
        leads: impl Fn() -> Gap,
        gap: impl Fn() -> f64,
    ) -> Result<(), Halt> {
        let start = self.place(0.0);
        let latest = bench.now() + LONGEST;
        let (mut next, mut end) = (bench.now() + self.period, f64::INFINITY);
        loop {
            let by = next.min(end);
            let event = self.follow(bench, leads(), by).await?;
            let over = match way.rests {
                None => !bench.moving(way.group),
                Some(ticket) => match &event {
                    Event::Failed(failed, why) if *failed == ticket => {
                        return Err(Outcome::BenchFailed { why: why.clone() }.into());
                    }
                    event => *event == Event::Done(ticket),
                },
            };
            if over && end.is_infinite() {
                end = bench.now() + way.turns as f64 * self.period;
            }
            if event != Event::Time {
                continue;
            }
            if by >= end {
                return self.arrive(bench, way, gap()).await;
            }
            next += self.period;
            // A peak that the group does not reach is lost too. What is as dim as noise leads nowhere.
            let light = match self.clear_peak() {
                Some(peak) => self.go_to(bench, &peak, gap()).map(|_| peak.full),
                None => Ok(self.peak().map_or(0.0, |peak| peak.full)),
            };
            let strayed = (self.place(0.0) - start).norm();
            let why = match light {
                _ if bench.is_past(latest) => Outcome::BenchFailed {
                    why: format!("a way to the chip was not over within {LONGEST} s"),
                },
                Ok(light) if light >= way.least && strayed <= way.stray => continue,
                Ok(light) if light >= way.least => Outcome::Strayed {
                    by: strayed,
                    accepted: way.stray,
                },
                Ok(level) => Outcome::LightLost {
                    phase: "approach",
                    level,
                    expected: way.before,
                },
                Err(beyond) => beyond,
            };
            bench.send(way.group, Law::Brake)?;
            bench.played(way.group).await?;
            return Err(why.into());
        }
    }
    /// Whether the peak has come along to where the way ends. What a turn saw of it on the way may be no more than its rim, left behind by now:
    /// where it does not stand out, turns have to find it here.
    async fn arrive(
        &mut self,
        bench: &Reactor<'_>,
        way: &Closing,
        gap: f64,
    ) -> Result<(), Halt> {
        let accuracy = TUNING.circle.near * self.beam.width(gap);
        let peak = match self.clear_peak() {
            Some(peak) => self.go_to(bench, &peak, gap).map(|_| peak)?,
            None => match self.centre(bench, gap, accuracy, "approach", 1).await {
                // Too dim to be found so well, but there.
                Err(Halt::Outcome(Outcome::Unsure { .. })) => return Ok(()),
                peak => peak?,
            },
        };
        if peak.full < way.least {
            return Err(Outcome::LightLost {
                phase: "approach",
                level: peak.full,
                expected: way.before,
            }
            .into());
        }
        Ok(())
    }
}
