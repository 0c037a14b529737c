//! Runs a tray on a station.

use crate::cell::{Bar, Cell, Step};
use crate::check::side_of;
use crate::recipe::{Action, Production};
use crate::teach::{Lesson, Teacher};
use crate::tray::{Device, Tray};
use pigtail_control::beam::Beam;
use pigtail_control::fast::Aligner;
use pigtail_control::hold::{self, Followed};
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::procedure::{AtPeak, PORTS};
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Station;
use pigtail_hal::bench::{Event as Happened, Meter, Request};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Bench, Fault, FiberHandling, Side};
use pigtail_model::frames::{Displacement, Point};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A tray and all that is needed to run it.
#[derive(Debug, Clone, Copy)]
pub struct Order<'o> {
    /// The tray.
    pub tray: &'o Tray,
    /// Its production recipes, by the names that the tray uses.
    pub productions: &'o BTreeMap<String, Production>,
    /// The recipe of the device and its alignment.
    pub recipe: &'o Recipe,
    /// The first device that is still to be done.
    pub from: usize,
    /// Fibers that were done before, which have taught what the adhesive does.
    pub taught: &'o [Pigtail],
}

/// How a fiber's production went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pigtail {
    /// The device's serial number.
    pub device: String,
    /// The port.
    pub port: String,
    /// The fiber's serial number.
    pub fiber: String,
    /// Where it lay.
    pub place: String,
    /// Whether it passed.
    pub passed: bool,
    /// What was wrong with it; empty where it passed.
    pub cause: String,
    /// The same in a sentence.
    pub detail: String,
    /// From when it was begun until it was verified, seconds.
    pub seconds: f64,
    /// Time of its alignment, seconds.
    pub align_seconds: f64,
    /// What the cure has done to it; nothing where it did not come to that.
    pub cured: Option<Cured>,
}

/// What the cure of a fiber has done to it, as far as its light tells.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cured {
    /// Loss that the cure has added when the lamp went off, decibels.
    pub after_cure_db: f64,
    /// And once the fiber was let go, decibels.
    pub after_release_db: f64,
    /// Standard deviation of both, decibels.
    pub sigma_db: f64,
    /// How far the adhesive pulled it until it came to rest, x and y of the manipulator, micrometres; nothing where nobody
    /// followed.
    pub before_um: Option<[f64; 2]>,
    /// Where it came to rest, from its peak, micrometres.
    pub beyond_um: [f64; 2],
    /// Where it is expected to be in the end, from its peak, micrometres.
    pub expected_um: [f64; 2],
    /// How far it is from its peak in the end, by the light, micrometres...
    pub off_um: f64,
    /// ...and how well that is known, one standard deviation.
    pub off_sigma_um: f64,
    /// How far the adhesive has shifted it in all, micrometres.
    pub shift_um: f64,
}

impl Cured {
    /// What it has taught.
    fn lesson(&self) -> Option<Lesson> {
        let metres = |[x, y]: [f64; 2]| Displacement::new(1e-6 * x, 1e-6 * y);
        let (off, sigma) = (1e-6 * self.off_um, 1e-6 * self.off_sigma_um);
        Some(Lesson {
            before: metres(self.before_um?),
            beyond: metres(self.beyond_um),
            squared: (off * off, 2.0 * off.max(sigma) * sigma),
        })
    }
}

/// How a device's production went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Produced {
    /// Its serial number.
    pub serial: String,
    /// Its place.
    pub place: String,
    /// Its production recipe.
    pub recipe: String,
    /// Why it is rejected; empty where it is not.
    pub rejected: String,
    /// From when it was begun until it was over, seconds of machine time.
    pub start: f64,
    /// When it was over.
    pub end: f64,
    /// Its fibers, in order.
    pub fibers: Vec<Pigtail>,
}

/// What happens on a tray.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event<'e> {
    /// A device begins.
    Begin {
        /// Its serial number.
        device: &'e str,
        /// Machine time, seconds.
        time: f64,
    },
    /// A manipulator is done with something.
    Did(&'e Bar),
    /// A fiber is done with.
    Fiber(&'e Pigtail),
    /// A device is done with.
    Device(&'e Produced),
}

/// What came of a tray.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Run {
    /// The devices that were begun.
    pub devices: Vec<Produced>,
    /// What each manipulator did.
    pub bars: Vec<Bar>,
    /// Machine time of it all, seconds.
    pub seconds: f64,
    /// Why the machine stopped by itself.
    pub fault: Option<Fault>,
    /// Whether a person is called.
    pub called: Option<String>,
}

/// How far a holder stays clear of a facet while it goes across, metres.
const CLEAR: f64 = 2e-3;

/// How well a laser's light is known from one look to another a minute later, relative: those without a control loop wander by
/// 0.1 to 2 %, makers say.
const STEADY: f64 = 0.01;

/// Standard deviations of what a fiber has lost that it must be below what is accepted.
const SURE: f64 = 2.0;

/// Looks at the light before and after, seconds.
const LOOK: f64 = 0.2;

/// Why a fiber or a device ends.
enum End {
    /// A phase has failed for good: its cause and what to do.
    Failed(String, String, Action),
    Fault(Fault),
}

impl From<Fault> for End {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

/// How far the left manipulator is with the fiber of a device that is not here yet.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ahead {
    Nothing,
    Picks,
    Wets,
}

struct Line<'l, 's, 'm> {
    order: Order<'l>,
    cell: Cell<'s, 'm>,
    teachers: [Teacher; SIDES],
    ahead: Ahead,
    /// When the adhesive on a tip has been in the air since, seconds.
    wet: [Option<f64>; SIDES],
    /// Bars that somebody was told of.
    told: usize,
    tell: &'l mut dyn FnMut(&Event),
}

/// Runs a tray from a device on. `tell` is told what happens.
pub fn run<'l>(station: &mut Station, order: Order<'l>, tell: &'l mut dyn FnMut(&Event)) -> Run {
    let begin = station.time();
    let mut line = Line {
        order,
        cell: Cell::new(station),
        teachers: Default::default(),
        ahead: Ahead::Nothing,
        wet: [None; SIDES],
        told: 0,
        tell,
    };
    for pigtail in order.taught {
        if let Some(lesson) = pigtail.cured.and_then(|cured| cured.lesson()) {
            line.teachers[side_of(&pigtail.port).index()].learn(lesson);
        }
    }
    let mut run = Run::default();
    for k in order.from..order.tray.devices.len() {
        let (produced, end) = line.device(k, k > order.from);
        line.flush();
        (line.tell)(&Event::Device(&produced));
        run.devices.push(produced);
        match end {
            Some(End::Fault(fault)) => run.fault = Some(fault),
            Some(End::Failed(_, detail, Action::Call)) => run.called = Some(detail),
            _ => continue,
        }
        break;
    }
    run.seconds = line.cell.now() - begin;
    run.bars = std::mem::take(&mut line.cell.bars);
    run
}

fn point([x, y, z]: [f64; 3]) -> Point<pigtail_model::frames::Chip> {
    Point::new(x, y, z)
}

impl Line<'_, '_, '_> {
    /// Tells of what was done since.
    fn flush(&mut self) {
        for bar in &self.cell.bars[self.told..] {
            (self.tell)(&Event::Did(bar));
        }
        self.told = self.cell.bars.len();
    }

    fn production(&self, device: &Device) -> &Production {
        &self.order.productions[self.order.tray.recipe_of(device)]
    }

    /// A device from the conveyor to the last of its fibers.
    fn device(&mut self, k: usize, another: bool) -> (Produced, Option<End>) {
        let tray = self.order.tray;
        let device = &tray.devices[k];
        let production = self.production(device).clone();
        let mut produced = Produced {
            serial: device.serial.clone(),
            place: device.place.clone(),
            recipe: production.name.clone(),
            rejected: String::new(),
            start: self.cell.now(),
            end: 0.0,
            fibers: Vec::new(),
        };
        (self.tell)(&Event::Begin {
            device: &device.serial,
            time: produced.start,
        });
        let mut end = if another {
            self.index(device).err()
        } else {
            None
        };
        let mut aligner = Aligner::new(self.order.recipe, production.align.procedure.way());
        for (n, port) in production.ports.iter().enumerate() {
            if end.is_some() {
                break;
            }
            let start = self.cell.now();
            let place = device.fibers[port].clone();
            let mut pigtail = Pigtail {
                device: device.serial.clone(),
                port: port.clone(),
                fiber: tray.fiber_at(&place).unwrap_or_default().to_owned(),
                place,
                passed: false,
                cause: String::new(),
                detail: String::new(),
                seconds: 0.0,
                align_seconds: 0.0,
                cured: None,
            };
            let last = n + 1 == production.ports.len();
            let result = self.fiber(k, &production, &mut aligner, last, &mut pigtail);
            pigtail.seconds = self.cell.now() - start;
            match result {
                Ok(()) => pigtail.passed = true,
                Err(End::Fault(fault)) => {
                    "fault".clone_into(&mut pigtail.cause);
                    pigtail.detail = fault.to_string();
                    "fault".clone_into(&mut produced.rejected);
                    end = Some(End::Fault(fault));
                }
                Err(End::Failed(cause, detail, action)) => {
                    if let Err(fault) = self.put_back(side_of(port)) {
                        end = Some(End::Fault(fault));
                    }
                    (pigtail.cause, pigtail.detail) = (cause.clone(), detail.clone());
                    produced.rejected.clone_from(&cause);
                    // Without the input's light there is nothing to align the others by.
                    if end.is_none() && (action != Action::NextFiber || port == PORTS[0]) {
                        end = Some(End::Failed(cause, detail, action));
                    }
                }
            }
            self.flush();
            (self.tell)(&Event::Fiber(&pigtail));
            produced.fibers.push(pigtail);
        }
        if let Some(End::Fault(_)) = &end
            && produced.rejected.is_empty()
        {
            "fault".clone_into(&mut produced.rejected);
        }
        if let Some(End::Failed(cause, ..)) = &end
            && produced.rejected.is_empty()
        {
            produced.rejected.clone_from(cause);
        }
        produced.end = self.cell.now();
        (produced, end)
    }

    /// A fiber that has failed and is still in its holder goes back to the tray.
    fn put_back(&mut self, side: Side) -> Result<(), Fault> {
        if self.cell.is_busy(side) || !self.cell.station().carries(side) {
            return Ok(());
        }
        let away = [Step::Named("retreat"), Step::Back(self.clear(side))];
        let gone = self.ask(side, FiberHandling::Lamp(false)).and_then(|()| {
            self.cell.go(side, ("", ""), away)?;
            let arm = side.index();
            self.ask_for(Request::Unload { arm })
        });
        match gone {
            Err(Halt::Fault(fault)) => Err(fault),
            Ok(()) | Err(Halt::Outcome(_)) => Ok(()),
        }
    }

    /// The next device, with both manipulators clear.
    fn index(&mut self, device: &Device) -> Result<(), End> {
        let on = (device.serial.as_str(), "");
        // Whatever the left one is at: it may still stand before the chip.
        match self.cell.finish(Side::Left) {
            Err(Halt::Fault(fault)) => return Err(fault.into()),
            // It is told when its turn comes.
            Err(Halt::Outcome(_)) => self.ahead = Ahead::Nothing,
            Ok(()) => {}
        }
        let z = self.clear(Side::Left);
        self.steps(
            Side::Left,
            on,
            vec![Step::Named("retreat"), Step::Back(z)],
            "retreat",
            Action::Call,
        )?;
        let z = self.clear(Side::Right);
        self.steps(
            Side::Right,
            on,
            vec![Step::Named("retreat"), Step::Back(z)],
            "retreat",
            Action::Call,
        )?;
        let index = Step::Handle(FiberHandling::Index, 1);
        let steps = vec![Step::Named("index"), index];
        self.steps(Side::Right, on, steps, "index", Action::Call)
    }

    /// How far back along the chip's z a holder is clear of everything.
    fn clear(&self, side: Side) -> f64 {
        let ports = &self.order.recipe.ports;
        match side {
            Side::Left => ports.input[2] - CLEAR,
            Side::Right => ports.outputs.iter().map(|at| at[2]).fold(0.0, f64::max) + CLEAR,
        }
    }

    fn steps(
        &mut self,
        side: Side,
        on: (&str, &str),
        steps: Vec<Step>,
        cause: &str,
        action: Action,
    ) -> Result<(), End> {
        self.cell.begin(side, on, steps);
        self.settle(side, cause, action)
    }

    fn settle(&mut self, side: Side, cause: &str, action: Action) -> Result<(), End> {
        self.cell.finish(side).map_err(|halt| match halt {
            Halt::Fault(fault) => End::Fault(fault),
            Halt::Outcome(outcome) => End::Failed(cause.to_owned(), outcome.to_string(), action),
        })
    }

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
            Step::Handle(FiberHandling::Pick(number), production.pick.attempts),
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
            Step::Handle(FiberHandling::Wet(production.adhesive.volume), 1),
            Step::Wait(production.adhesive.dwell),
            Step::Needle(false),
        ]
    }

    /// A fiber from its place to its bond.
    fn fiber(
        &mut self,
        k: usize,
        production: &Production,
        aligner: &mut Aligner,
        last: bool,
        pigtail: &mut Pigtail,
    ) -> Result<(), End> {
        let serial = self.order.tray.devices[k].serial.clone();
        let port = pigtail.port.clone();
        let on = (serial.as_str(), port.as_str());
        let side = side_of(&port);
        let number = PORTS.iter().position(|p| *p == port).unwrap_or(0);
        let mut attempt = 0;
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
            // What is driven by cycles sees no events of anybody else.
            let other = [Side::Right, Side::Left][side.index()];
            if self.cell.is_busy(other) {
                match self.cell.finish(other) {
                    Err(Halt::Fault(fault)) => return Err(fault.into()),
                    // It is told when its turn comes.
                    Err(Halt::Outcome(_)) => self.ahead = Ahead::Nothing,
                    Ok(()) => {}
                }
            }
            let start = self.cell.now();
            let (report, held) = aligner.reach(self.cell.station(), number.checked_sub(1));
            self.cell.note(side, on, "align", false, start);
            if side == Side::Left {
                self.cell.note(other, on, "align", false, start);
            }
            pigtail.align_seconds += self.cell.now() - start;
            match (held, report.outcome) {
                (Some(held), _) => break held,
                (None, Outcome::Stopped(fault)) => return Err(fault.into()),
                (None, outcome) => {
                    let late = pigtail.align_seconds > production.align.limit;
                    if attempt >= production.align.attempts || late {
                        let cause = outcome.name().to_owned();
                        return Err(End::Failed(
                            cause,
                            outcome.to_string(),
                            production.align.failed,
                        ));
                    }
                }
            }
        };
        let waited = self.wet[side.index()].map_or(0.0, |since| self.cell.now() - since);
        if waited > production.adhesive.open {
            let detail = format!(
                "adhesive was {waited:.0} s in the air; accepted are {} s",
                production.adhesive.open
            );
            return Err(End::Failed(
                "adhesive".to_owned(),
                detail,
                production.adhesive.failed,
            ));
        }
        if last {
            self.look_ahead(k, true);
        }
        let cured = self
            .cure(&held, production, on)
            .map_err(|halt| match halt {
                Halt::Fault(fault) => End::Fault(fault),
                Halt::Outcome(outcome) => {
                    let detail = outcome.to_string();
                    End::Failed("cure".to_owned(), detail, production.verify.failed)
                }
            })?;
        pigtail.cured = Some(cured);
        if side == Side::Left {
            let z = self.clear(side);
            let away = [Step::Named("retreat"), Step::Back(z), Step::Centre];
            self.cell.begin(side, on, away);
            self.look_ahead(k, false);
        }
        let verify = &production.verify;
        let (lost, sigma) = (cured.after_release_db, cured.sigma_db);
        if lost + SURE * sigma > verify.added_loss_db || !lost.is_finite() {
            let detail = format!(
                "cure and release have added {lost:.3} dB, known to {sigma:.3} dB; accepted are {} dB",
                verify.added_loss_db
            );
            return Err(End::Failed("added_loss".to_owned(), detail, verify.failed));
        }
        Ok(())
    }

    /// The left manipulator, which is free, goes on with the fiber of the next device: it picks it up, and gets adhesive only
    /// when that will soon be needed.
    fn look_ahead(&mut self, k: usize, soon: bool) {
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

    /// Something that an arm is asked for, until it is done.
    fn ask(&mut self, side: Side, what: FiberHandling) -> Result<(), Halt> {
        self.ask_for(Request::Handle {
            arm: side.index(),
            what,
        })
    }

    fn ask_for(&mut self, request: Request) -> Result<(), Halt> {
        let failed = |why: String| Halt::from(Outcome::BenchFailed { why });
        let ticket = self
            .cell
            .request(request)
            .map_err(|why| failed(why.to_string()))?;
        let until = self.cell.now() + 60.0;
        loop {
            match self.cell.next(until)? {
                Happened::Done(done) if done == ticket => return Ok(()),
                Happened::Failed(of, why) if of == ticket => return Err(failed(why)),
                Happened::Time => return Err(failed("it was not done in a minute".to_owned())),
                _ => {}
            }
        }
    }

    /// Holds a fiber under the lamp, lets it go and looks at its light.
    fn cure(
        &mut self,
        held: &AtPeak,
        production: &Production,
        on: (&str, &str),
    ) -> Result<Cured, Halt> {
        let (side, meter) = (held.side, Meter(held.channel.index()));
        let cure = production.cure;
        let start = self.cell.now();
        let looked = hold::level(&mut self.cell, meter, LOOK)?;
        self.ask(side, FiberHandling::Lamp(true))?;
        let lit = self.cell.now();
        let ratio = production.ratio();
        let teacher = self.teachers[side.index()].clone();
        let mut expected = Displacement::ZERO;
        let followed: Option<Followed> = if cure.track {
            let beyond = |before| {
                expected = teacher.expect(before, ratio, cure.scatter);
                if cure.precompensate {
                    expected * -1.0
                } else {
                    Displacement::ZERO
                }
            };
            let rest = lit + production.rest();
            Some(hold::follow(
                &mut self.cell,
                self.order.recipe,
                held,
                rest,
                beyond,
            )?)
        } else {
            None
        };
        self.cell.wait_until(lit + cure.time - LOOK)?;
        let cured = hold::level(&mut self.cell, meter, LOOK)?;
        self.ask(side, FiberHandling::Lamp(false))?;
        self.cell.note(side, on, "cure", true, start);
        if side == Side::Left {
            self.cell.note(Side::Right, on, "witness", true, start);
        }
        let release = self.cell.now();
        self.ask(side, FiberHandling::Release)?;
        self.wet[side.index()] = None;
        self.cell.note(side, on, "release", false, release);
        let verify = self.cell.now();
        let after = hold::level(&mut self.cell, meter, production.verify.look)?;
        self.cell.note(side, on, "verify", false, verify);
        if side == Side::Left {
            self.cell.note(Side::Right, on, "witness", true, release);
        }
        let above = |(volts, sigma): (f64, f64)| (volts - held.background, sigma);
        let ((before, noise), (cured, _), (after, rest)) =
            (above(looked), above(cured), above(after));
        let lost = |light: f64| 10.0 * (before / light.max(1e-6 * before)).log10();
        let relative = (noise / before).hypot(rest / after).hypot(STEADY);
        let recipe = self.order.recipe;
        let width = followed.map_or_else(
            || Beam::new(&recipe.mode, recipe.ports.exit_angle).width(held.gap),
            |followed| followed.width,
        );
        let squared = width * width * (before / after.max(1e-6 * before)).ln();
        let noise = width * width * relative;
        let pulled = followed.map(|followed| followed.by * -1.0);
        let beyond = followed.map_or(Displacement::ZERO, |followed| followed.beyond);
        if let Some(pulled) = pulled {
            self.teachers[side.index()].learn(Lesson {
                before: pulled,
                beyond,
                squared: (squared, noise),
            });
        }
        let off = squared.max(0.0).sqrt();
        let um = |d: Displacement| [1e6 * d.x, 1e6 * d.y];
        let all = pulled.map_or(off, |pulled| (pulled + expected).norm());
        Ok(Cured {
            after_cure_db: lost(cured),
            after_release_db: lost(after),
            sigma_db: 10.0 / std::f64::consts::LN_10 * relative,
            before_um: pulled.map(um),
            beyond_um: um(beyond),
            expected_um: um(beyond + expected),
            off_um: 1e6 * off,
            off_sigma_um: 1e6 * noise / (2.0 * off.max(noise.sqrt())),
            shift_um: 1e6 * all,
        })
    }
}
