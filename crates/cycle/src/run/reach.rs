//! A fiber from its place on the tray to its peak: picked up, with adhesive on its tip, aligned.

use super::{Ahead, End, Line, Pigtail, point};
use crate::cell::Step;
use crate::check::side_of;
use crate::recipe::{Ending, Production};
use pigtail_control::fast::Aligner;
use pigtail_control::job::{AtPeak, PORTS};
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_hal::{Bench, FiberHandling, Side};

impl Line<'_, '_, '_> {
    fn pick(&self, side: Side, k: usize, port: &str, production: &Production) -> Vec<Step> {
        let tray = self.order.tray;
        let at = point(tray.places[&tray.devices[k].fibers[port]].at);
        let of_side = PORTS.iter().position(|p| *p == port).unwrap_or(0);
        let number = of_side.saturating_sub(1) as u8;
        vec![
            Step::Named("retreat"),
            Step::Back(self.clear(side)),
            Step::Named("pick"),
            Step::Centre,
            Step::Go(at),
            Step::Handle(
                FiberHandling::Pick(number),
                production.pick.attempts,
                production.pick.limit,
            ),
        ]
    }

    fn adhesive(&self, side: Side, production: &Production) -> Vec<Step> {
        let dispenser = &self.order.tray.dispenser;
        let at = point(match side {
            Side::Left => dispenser.left,
            Side::Right => dispenser.right,
        });
        vec![
            Step::Named("adhesive"),
            Step::Needle(true),
            Step::Go(at),
            Step::Handle(
                FiberHandling::Wet(production.adhesive.volume),
                1,
                f64::INFINITY,
            ),
            Step::Wait(production.adhesive.dwell),
            Step::Needle(false),
        ]
    }

    /// A fiber from its place to its peak.
    pub(super) fn reach(
        &mut self,
        k: usize,
        production: &Production,
        aligner: &mut Aligner,
        pigtail: &mut Pigtail,
    ) -> Result<AtPeak, End> {
        let serial = self.order.tray.devices[k].serial.clone();
        let port = pigtail.port.clone();
        let on = (serial.as_str(), port.as_str());
        let side = side_of(&port);
        let number = PORTS.iter().position(|p| *p == port).unwrap_or(0);
        let (mut attempt, mut wetted) = (0, 1);
        let held = loop {
            attempt += 1;
            let (picks, wets) = match (side, self.ahead) {
                (Side::Left, Ahead::Picks) => (false, true),
                (Side::Left, Ahead::Wets) => (false, false),
                _ => (true, true),
            };
            if side == Side::Left && self.ahead != Ahead::Nothing {
                self.ahead = Ahead::Nothing;
                self.settle(side, "pick", production.pick.failed)?;
            }
            if picks {
                let steps = self.pick(side, k, &port, production);
                self.steps(side, on, steps, "pick", production.pick.failed)?;
            }
            if wets {
                let steps = self.adhesive(side, production);
                self.steps(side, on, steps, "adhesive", production.adhesive.failed)?;
                self.wet[side.index()] = Some(self.cell.now());
            }
            let other = [Side::Right, Side::Left][side.index()];
            // The input is aligned by both; an output beside whatever the left one is at, where there is room for that.
            let alone = side == Side::Right && self.cell.reserve(side, self.facet(side));
            if !alone && self.cell.is_busy(other) {
                match self.cell.finish(other) {
                    Err(Halt::Fault(fault)) => return Err(fault.into()),
                    // It is told when its turn comes.
                    Err(Halt::Outcome(_)) => self.ahead = Ahead::Nothing,
                    Ok(()) => {}
                }
            }
            let start = self.cell.now();
            let station = self.cell.station();
            let known = (
                station.layout(),
                Side::ALL.map(|side| station.carries(side)),
            );
            let (report, held) = aligner.reach(&mut self.cell, known, number.checked_sub(1));
            if alone {
                self.cell.give_back(side);
            }
            self.cell.note(side, on, "align", false, start);
            if side == Side::Left {
                self.cell.note(other, on, "align", false, start);
            }
            pigtail.align_seconds += self.cell.now() - start;
            let align = &production.align;
            match (held, report.outcome) {
                (Some(held), _) => {
                    let since = self.wet[side.index()].unwrap_or(start);
                    let stale = self.cell.now() - since > production.adhesive.open;
                    if !stale || wetted >= production.adhesive.attempts {
                        break held;
                    }
                    // That took too long for what is on the tip.
                    self.put_back(side)?;
                    wetted += 1;
                    attempt -= 1;
                }
                (None, Outcome::Stopped(fault)) => return Err(fault.into()),
                (None, outcome) => {
                    let on = Ending::of(outcome.code()).and_then(|ending| align.on.get(&ending));
                    let at_once = on.and_then(|reaction| reaction.at_once());
                    let late = pigtail.align_seconds > align.limit;
                    if at_once.is_some() || attempt >= align.attempts || late {
                        let action = at_once.unwrap_or(align.failed);
                        let cause = outcome.name().to_owned();
                        return Err(End::Failed(cause, outcome.to_string(), action));
                    }
                }
            }
        };
        Ok(held)
    }

    /// The left manipulator, which is free, goes on with the fiber of the next device: it picks it up, and gets adhesive only
    /// when that will soon be needed.
    pub(super) fn look_ahead(&mut self, k: usize, soon: bool) {
        let tray = self.order.tray;
        let Some(next) = tray.devices.get(k + 1) else {
            return;
        };
        let production = self.production(next).clone();
        if production.ports[0] != PORTS[0] {
            return;
        }
        let on = (next.serial.as_str(), PORTS[0]);
        if self.ahead == Ahead::Nothing && !self.cell.station().carries(Side::Left) {
            let steps = self.pick(Side::Left, k + 1, PORTS[0], &production);
            self.cell.begin(Side::Left, on, steps);
            self.ahead = Ahead::Picks;
        }
        if soon && self.ahead == Ahead::Picks {
            let steps = self.adhesive(Side::Left, &production);
            self.cell.begin(Side::Left, on, steps);
            self.wet[Side::Left.index()] = Some(self.cell.now());
            self.ahead = Ahead::Wets;
        }
    }
}
