//! Runs a tray on a station.

pub(crate) mod bond;
mod reach;
mod told;
pub(crate) mod witness;

pub use told::{Cured, Event, Pigtail, Produced, Run};

use crate::cell::{Cell, Step};
use crate::check::side_of;
use crate::losses::Ripples;
use crate::recipe::{Action, Production};
use crate::steadiness::Steadiness;
use crate::teach::Teacher;
use crate::tray::{Device, Tray};
use pigtail_control::fast::Aligner;
use pigtail_control::job::{AtPeak, PORTS};
use pigtail_control::outcome::{Halt, Outcome};
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Station;
use pigtail_hal::bench::{Event as Happened, Meter, Request};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Bench, Fault, FiberHandling, Side};
use pigtail_model::frames::Point;
use std::collections::BTreeMap;
use witness::Shares;

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

/// How far a holder stays clear of a facet while it goes across, metres.
const CLEAR: f64 = 2e-3;

/// Standard deviations of what a fiber has lost that it must be below what is accepted.
const SURE: f64 = 2.0;

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

impl End {
    /// The same once more.
    fn again(&self) -> Self {
        match self {
            Self::Failed(cause, detail, action) => {
                Self::Failed(cause.clone(), detail.clone(), *action)
            }
            Self::Fault(fault) => Self::Fault(fault.clone()),
        }
    }
}

/// A fiber that was begun.
struct Begun {
    pigtail: Pigtail,
    /// When, and since when it is at its peak, seconds.
    start: f64,
    peak: f64,
}

struct Line<'l, 's, 'm> {
    order: Order<'l>,
    cell: Cell<'s, 'm>,
    teachers: [Teacher; SIDES],
    ahead: Ahead,
    /// When the adhesive on a tip has been in the air since, seconds.
    wet: [Option<f64>; SIDES],
    steadiness: Steadiness,
    ripples: Ripples,
    shares: [Shares; SIDES],
    /// An output of this device that is fixed: its meter, and the level without light, volts.
    reference: Option<(Meter, f64)>,
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
        steadiness: Steadiness::default(),
        ripples: Ripples::default(),
        shares: Default::default(),
        reference: None,
        told: 0,
        tell,
    };
    for pigtail in order.taught {
        line.steadiness.learn(pigtail.cured.and_then(|c| c.look));
        line.ripples.learn(pigtail.cured.and_then(|c| c.rippled));
        let side = side_of(&pigtail.port).index();
        line.shares[side].learn(pigtail.cured.and_then(|c| c.share));
        if let Some(lesson) = pigtail.cured.and_then(|cured| cured.lesson()) {
            line.teachers[side].learn(lesson);
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
        self.reference = None;
        let mut aligner = Aligner::new(self.order.recipe, production.align.procedure.way());
        let mut waiting: Option<(Begun, AtPeak)> = None;
        for (n, port) in production.ports.iter().enumerate() {
            if end.is_some() {
                break;
            }
            let mut begun = self.begun(device, port);
            let reached = self.reach(k, &production, &mut aligner, &mut begun.pigtail);
            begun.peak = self.cell.now();
            let reached = match reached {
                Ok(held) if production.cure.together && n == 0 => {
                    waiting = Some((begun, held));
                    continue;
                }
                reached => reached,
            };
            if n + 1 == production.ports.len() && waiting.is_none() {
                self.look_ahead(k, true);
            }
            let result = match reached {
                Err(why) => Err(why),
                Ok(held) => match waiting.take() {
                    None => self.bond(&production, [(&mut begun, &held)]),
                    Some((mut first, input)) => {
                        let both = [(&mut first, &input), (&mut begun, &held)];
                        let result = self.bond(&production, both);
                        let how = result.as_ref().map_err(End::again).copied();
                        self.ended(&mut produced, first, how, &mut end);
                        // What is wrong with both is how the second ends; but a machine that has stopped, has.
                        end = end.filter(|end| matches!(end, End::Fault(_)));
                        result
                    }
                },
            };
            if port == PORTS[0] || production.cure.together && n == 1 {
                self.left_is_free(
                    k,
                    (&device.serial, PORTS[0]),
                    n + 1 == production.ports.len(),
                );
            }
            self.ended(&mut produced, begun, result, &mut end);
            // An input that was waiting for this one has no light any more.
            if let Some((first, _)) = waiting.take() {
                let detail = format!(
                    "{port} was not brought to its peak, and both were to be cured together"
                );
                let why = End::Failed("not_cured".to_owned(), detail, Action::RejectDevice);
                let before = end.take();
                self.ended(&mut produced, first, Err(why), &mut end);
                end = before.or(end);
            }
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

    /// A fiber of a device begins.
    fn begun(&self, device: &Device, port: &str) -> Begun {
        let place = device.fibers[port].clone();
        Begun {
            start: self.cell.now(),
            peak: self.cell.now(),
            pigtail: Pigtail {
                device: device.serial.clone(),
                port: port.to_owned(),
                fiber: self
                    .order
                    .tray
                    .fiber_at(&place)
                    .unwrap_or_default()
                    .to_owned(),
                place,
                passed: false,
                cause: String::new(),
                detail: String::new(),
                seconds: 0.0,
                align_seconds: 0.0,
                cured: None,
            },
        }
    }

    /// A fiber of a device is over; `end` is how the device ends by that.
    fn ended(
        &mut self,
        produced: &mut Produced,
        begun: Begun,
        result: Result<(), End>,
        end: &mut Option<End>,
    ) {
        let Begun {
            mut pigtail, start, ..
        } = begun;
        pigtail.seconds = self.cell.now() - start;
        match result {
            Ok(()) => pigtail.passed = true,
            Err(End::Fault(fault)) => {
                "fault".clone_into(&mut pigtail.cause);
                pigtail.detail = fault.to_string();
                "fault".clone_into(&mut produced.rejected);
                *end = Some(End::Fault(fault));
            }
            Err(End::Failed(cause, detail, action)) => {
                if let Err(why) = self.put_back(side_of(&pigtail.port)) {
                    *end = Some(why);
                }
                (pigtail.cause, pigtail.detail) = (cause.clone(), detail.clone());
                if produced.rejected.is_empty() || cause != "not_cured" {
                    produced.rejected.clone_from(&cause);
                }
                // Without the input's light there is nothing to align the others by.
                if end.is_none() && (action != Action::NextFiber || pigtail.port == PORTS[0]) {
                    *end = Some(End::Failed(cause, detail, action));
                }
            }
        }
        self.flush();
        (self.tell)(&Event::Fiber(&pigtail));
        produced.fibers.push(pigtail);
    }

    /// The left manipulator has let its fiber go: it makes way, and goes on with the next device's.
    fn left_is_free(&mut self, k: usize, on: (&str, &str), last: bool) {
        let left = Side::Left;
        if self.cell.station().carries(left) || self.cell.is_busy(left) {
            return;
        }
        let away = [
            Step::Named("retreat"),
            Step::Back(self.clear(left)),
            Step::Centre,
        ];
        self.cell.begin(left, on, away);
        self.look_ahead(k, last);
    }

    /// A fiber that has failed and is still in its holder goes back to the tray. Where it does not, a person is called: the next one
    /// could not be picked.
    fn put_back(&mut self, side: Side) -> Result<(), End> {
        if self.cell.is_busy(side) || !self.cell.station().carries(side) {
            return Ok(());
        }
        let away = [Step::Named("retreat"), Step::Back(self.clear(side))];
        let gone = self.ask(side, FiberHandling::Lamp(false)).and_then(|()| {
            self.cell.go(side, ("", ""), away)?;
            let arm = side.index();
            self.ask_for(Request::Unload { arm })
        });
        gone.map_err(|halt| match halt {
            Halt::Fault(fault) => End::Fault(fault),
            Halt::Outcome(outcome) => {
                let detail = format!(
                    "the {} manipulator has not put its fiber back: {outcome}",
                    side.name()
                );
                End::Failed("not_put_back".to_owned(), detail, Action::Call)
            }
        })
    }

    /// The next device, with both manipulators clear.
    fn index(&mut self, device: &Device) -> Result<(), End> {
        let on = (device.serial.as_str(), "");
        let (left, z) = (Side::Left, self.clear(Side::Left));
        if !self.cell.is_clear(left, z) {
            // Whatever it is at: it may still stand before the chip.
            match self.cell.finish(left) {
                Err(Halt::Fault(fault)) => return Err(fault.into()),
                // It is told when its turn comes.
                Err(Halt::Outcome(_)) => self.ahead = Ahead::Nothing,
                Ok(()) => {}
            }
            let away = vec![Step::Named("retreat"), Step::Back(z)];
            self.steps(left, on, away, "retreat", Action::Call)?;
        }
        let z = self.clear(Side::Right);
        self.steps(
            Side::Right,
            on,
            vec![Step::Named("retreat"), Step::Back(z)],
            "retreat",
            Action::Call,
        )?;
        let index = Step::Handle(FiberHandling::Index, 1, f64::INFINITY);
        // Frames that come next still show the chip before: who went by them would be as far off as the two lie differently.
        let seen = Step::Wait(self.cell.station().spec().vision.oldest());
        let steps = vec![Step::Named("index"), index, seen];
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

    /// Where the facets are along the chip's z on a side, the one that stands out farthest.
    fn facet(&self, side: Side) -> f64 {
        let ports = &self.order.recipe.ports;
        let outputs = ports.outputs.iter().map(|at| at[2]);
        match side {
            Side::Left => ports.input[2],
            Side::Right => outputs.fold(f64::INFINITY, f64::min),
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

    /// Something that an arm is asked for, until it is done.
    fn ask(&mut self, side: Side, what: FiberHandling) -> Result<(), Halt> {
        self.ask_for(Request::Handle {
            arm: side.index(),
            what,
        })
    }

    /// The same of some arms at once.
    fn ask_all(&mut self, sides: &[Side], what: FiberHandling) -> Result<(), Halt> {
        let handle = |side: &Side| Request::Handle {
            arm: side.index(),
            what,
        };
        let requests: Vec<Request> = sides.iter().map(handle).collect();
        self.ask_for_all(&requests)
    }

    fn ask_for(&mut self, request: Request) -> Result<(), Halt> {
        self.ask_for_all(&[request])
    }

    fn ask_for_all(&mut self, requests: &[Request]) -> Result<(), Halt> {
        let failed = |why: String| Halt::from(Outcome::BenchFailed { why });
        let mut tickets = Vec::with_capacity(requests.len());
        for request in requests {
            let ticket = self.cell.request(*request);
            tickets.push(ticket.map_err(|why| failed(why.to_string()))?);
        }
        let until = self.cell.now() + 60.0;
        while !tickets.is_empty() {
            match self.cell.next(until)? {
                Happened::Done(done) => tickets.retain(|ticket| *ticket != done),
                Happened::Failed(of, why) if tickets.contains(&of) => return Err(failed(why)),
                Happened::Time => return Err(failed("it was not done in a minute".to_owned())),
                _ => {}
            }
        }
        Ok(())
    }
}
