//! The simulated bench that is controlled by position: steppers below piezos on two arms, and a power meter.
//!
//! Its truth is a [`BenchPlant`] and a seed. The arms' frames are turned against the chip's: the left one is
//! only shifted, the right one is turned by half a turn about y besides, as z of both goes towards the chip. What
//! really is, is answered by [`BenchTwin::truth`], which is not part of [`Bench`].
//!
//! It is evaluated in steps of a millisecond; the same seed and the same calls give the same bytes.
//!
//! ```
//! use pigtail_hal::bench::{Bench, Event, Law, Limits, Pose, Stage, spec::BenchSpec};
//! use pigtail_twin::bench::{BenchPlant, BenchTwin};
//!
//! # let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/bench-piezo/");
//! # let read = |file: &str| std::fs::read_to_string(format!("{rig}{file}")).expect("the shipped rig");
//! let spec = BenchSpec::parse("machine.toml", &read("machine.toml"))?;
//! let plant = BenchPlant::parse("plant.toml", &read("plant.toml"))?;
//! let mut bench = BenchTwin::new(spec, &plant, 7)?;
//! let fine = bench.caps().group(0, Stage::Fine).expect("piezos");
//! let to = Pose::at(2e-6, 0.0, 0.0);
//! let ticket = bench.play(fine, Law::Line { to, limits: Limits::default() })?;
//! while bench.next(1.0)? != Event::Done(ticket) {}
//! let at = bench.pose(fine, bench.now()).expect("measured").pose;
//! assert!((at - to).distance() < 20e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod motion;
mod plant;

pub use plant::{
    BenchMisplacement, BenchPlant, BenchThermal, BenchVariation, CoarsePlant, FinePlant,
    MeterPlant, Origins,
};

use crate::light::{FiberInHolder, LightPath, Optics, Tips};
use crate::plant::Spread;
use crate::sensors::normal;
use crate::setting::Floor;
use crate::{FiberTruth, Fixed, Fluctuation, Specimen, Truth, tip_of};
use motion::{ClosedLoop, Controller, STEP, Screw};
use pigtail_hal::bench::spec::BenchSpec;
use pigtail_hal::bench::{
    Bench, Caps, Estimate, Event, Group, Law, Light, Pose, Refused, Request, Stage, Ticket,
};
use pigtail_hal::spec::{OUTPUTS, SIDES, Side};
use pigtail_hal::{Fault, Rule};
use pigtail_model::Invalid;
use pigtail_model::frames::{Chip, Point};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// How long it is remembered where groups were, steps.
const REMEMBERED: usize = 1000;
/// Core of the fiber by which the level of scattered light is stated: that of the thesis, metres.
const SCATTER_CORE: f64 = 100e-6;

/// A simulated bench.
#[derive(Debug, Clone)]
pub struct BenchTwin {
    caps: Caps,
    spec: BenchSpec,
    plant: BenchPlant,
    arms: [Arm; SIDES],
    light: LightPath,
    scatter: Fluctuation,
    wander: Option<Fluctuation>,
    floor: Option<Floor>,
    /// Where the chip is out of its place, metres.
    chip: [f64; 3],
    tray: [Vec<Carried>; SIDES],
    attached: [[Option<Fixed>; OUTPUTS]; SIDES],
    laser: bool,
    rng: Pcg64Mcg,
    step: u64,
    now: f64,
    tickets: u64,
    busy: Vec<Busy>,
    events: VecDeque<Event>,
    /// Samples that are on their way, by the time at which they are heard of.
    heard: VecDeque<(f64, Light)>,
    /// The output whose fiber was attached last: the meter stays at its end until another is carried.
    attached_last: Option<usize>,
    meter: Meter,
    smallest_gap: f64,
}

/// What a meter has summed up of a sample.
#[derive(Debug, Clone, Copy, Default)]
struct Meter {
    sum: f64,
    steps: u32,
}

/// A request on its way.
#[derive(Debug, Clone, Copy)]
struct Busy {
    ticket: Ticket,
    request: Request,
    until: f64,
    /// Of a bond: the sum of the places of the tip.
    sum: [f64; 3],
    steps: u32,
}

#[derive(Debug, Clone, Copy)]
struct Carried {
    port: usize,
    fiber: FiberInHolder,
}

#[derive(Debug, Clone)]
struct Arm {
    coarse: Controller,
    fine: Controller,
    screws: [Screw; 3],
    loops: [ClosedLoop; 3],
    /// Where its frame is in the chip's, metres.
    origin: [f64; 3],
    /// How far its z leans, towards x and y.
    lean: [f64; 2],
    /// Speed at which it creeps, its frame.
    creeps: [f64; 3],
    /// Where the screws' errors count from.
    zero: [f64; 3],
    carried: Option<Carried>,
    /// Where its groups are measured to be, step by step: coarse, then fine.
    measured: [VecDeque<Pose>; 2],
    /// Its true place, its frame.
    at: [f64; 3],
}

impl Arm {
    fn of(&mut self, stage: Stage) -> &mut Controller {
        match stage {
            Stage::Coarse => &mut self.coarse,
            Stage::Fine => &mut self.fine,
        }
    }

    /// Where its holder has a tip that sits well, chip's frame without the chip's own place.
    fn holder(&self, side: Side, shaken: [f64; 3], seconds: f64) -> Point<Chip> {
        let [x, y, z] = std::array::from_fn(|i| self.at[i] + self.creeps[i] * seconds);
        let [ox, oy, oz] = self.origin;
        let [sx, sy, sz] = shaken;
        match side {
            Side::Left => Point::new(ox + x + sx, oy + y + sy, oz + z + sz),
            // Half a turn about y.
            Side::Right => Point::new(ox - x + sx, oy + y + sy, oz - z + sz),
        }
    }
}

fn places(group: usize) -> (usize, Stage) {
    let stage = if group.is_multiple_of(2) {
        Stage::Coarse
    } else {
        Stage::Fine
    };
    (group / 2, stage)
}

impl BenchTwin {
    /// A specimen drawn around `plant`. The same seed gives the same bench, device, fixture and noise; see
    /// [`Specimen`] for many devices on one bench.
    ///
    /// # Errors
    ///
    /// When the optics of the plant are none.
    pub fn new(spec: BenchSpec, plant: &BenchPlant, seed: u64) -> Result<Self, Invalid> {
        let specimen = Specimen::from(seed);
        // A stream of random numbers for each thing that is drawn, as of the other twin.
        let numbered = |seed: u64, number: u64| seed.wrapping_mul(16).wrapping_add(number);
        let stream = |number| Pcg64Mcg::seed_from_u64(numbered(seed, number));
        let of_machine = |number| Pcg64Mcg::seed_from_u64(numbered(specimen.machine(), number));
        let m = plant.misplacement;
        let offset = |rng: &mut Pcg64Mcg, width| Spread::Normal.offset(rng, width);
        let caps = spec.caps();
        let mut of_arms = of_machine(0);
        let origins = [plant.origin.left, plant.origin.right];
        // Where ports are in the arms' frames, about: screws err from there on.
        let ports = {
            let [a, b] = plant.device.outputs;
            let middle = std::array::from_fn(|i| 0.5 * (a[i] + b[i]));
            [plant.device.input, middle]
        };
        let arms = std::array::from_fn(|side| {
            let rng = &mut of_arms;
            let across = [offset(rng, m.taught), offset(rng, m.taught)];
            let mut origin = origins[side];
            let turned = if side == 0 { 1.0 } else { -1.0 };
            let way = |i: usize| ports[side][i] - origin[i];
            let zero = [turned * way(0), way(1), turned * way(2)];
            origin[0] += across[0];
            origin[1] += across[1];
            let factors = std::array::from_fn(|_| {
                (plant.variation.closed_loop * normal(rng).clamp(-3.0, 3.0)).exp()
            });
            let group = |stage: Stage| &caps.groups[2 * side + stage as usize];
            Arm {
                coarse: Controller::new(group(Stage::Coarse), spec.coarse.acceleration),
                fine: Controller::new(group(Stage::Fine), spec.fine.acceleration),
                screws: std::array::from_fn(|_| {
                    let phase = TAU * rng.random::<f64>();
                    Screw::new(&plant.coarse, phase, rng)
                }),
                loops: [ClosedLoop::new(&plant.fine, factors); 3],
                lean: [offset(rng, m.squareness), offset(rng, m.squareness)],
                creeps: std::array::from_fn(|_| offset(rng, plant.thermal.rms)),
                origin,
                zero,
                carried: None,
                measured: Default::default(),
                at: [0.0; 3],
            }
        });
        let mut device = stream(1);
        let chip = [m.chip_x, m.chip_y, m.chip_z].map(|width| offset(&mut device, width));
        let mut fibers = stream(2);
        let mut draw = |port| Carried {
            port,
            fiber: FiberInHolder {
                offset: [m.fiber_x, m.fiber_y, m.fiber_z].map(|width| offset(&mut fibers, width)),
                tilt: [
                    offset(&mut fibers, m.tilt) - plant.device.turn,
                    offset(&mut fibers, m.tilt),
                ],
                roll: 0.0,
            },
        };
        let tray = [vec![draw(0)], (0..OUTPUTS).map(&mut draw).collect()];
        let mut noise = stream(3);
        let scatter = &plant.scatter;
        let optics = Optics {
            device: &plant.device,
            fiber: &plant.fiber,
            light: &plant.light,
            scatter,
            loss: plant.variation.loss,
            core: SCATTER_CORE,
        };
        let mut twin = Self {
            light: LightPath::new(&optics, &mut device)?,
            scatter: Fluctuation::new(scatter.fluctuation, scatter.bandwidth, STEP, &mut noise),
            wander: (plant.light.wander > 0.0).then(|| {
                let bandwidth = 1.0 / (TAU * plant.light.wander_time);
                Fluctuation::new(plant.light.wander, bandwidth, STEP, &mut stream(9))
            }),
            floor: Floor::new(&plant.floor, STEP, numbered(seed, 8)),
            rng: noise,
            plant: plant.clone(),
            caps,
            spec,
            arms,
            chip,
            tray,
            attached: Default::default(),
            laser: false,
            step: 0,
            now: 0.0,
            tickets: 0,
            busy: Vec::new(),
            events: VecDeque::new(),
            heard: VecDeque::new(),
            attached_last: None,
            meter: Meter::default(),
            smallest_gap: f64::INFINITY,
        };
        twin.advance();
        Ok(twin)
    }

    fn ticket(&mut self) -> Ticket {
        self.tickets += 1;
        Ticket(self.tickets)
    }

    /// Where a group is measured to be.
    fn latest(&self, group: usize) -> Option<Pose> {
        let (arm, stage) = places(group);
        self.arms.get(arm)?.measured[stage as usize].back().copied()
    }

    fn begin(&mut self, group: Group, ticket: Option<Ticket>, law: Law) {
        let lead = match &law {
            Law::Dither(dither) => dither.lead.and_then(|lead| self.latest(lead.group.0)),
            _ => None,
        };
        let (arm, stage) = places(group.0);
        let now = self.now;
        self.arms[arm].of(stage).play(ticket, law, now, lead);
    }

    /// A step of time.
    fn advance(&mut self) {
        self.step += 1;
        self.now = self.step as f64 * STEP;
        let now = self.now;
        // What is told to groups that others follow goes first: they are followed as they were measured.
        let leads: [[Option<Pose>; 2]; SIDES] = std::array::from_fn(|arm| {
            [&self.arms[arm].coarse, &self.arms[arm].fine]
                .map(|group| group.follows().and_then(|group| self.latest(group)))
        });
        let end = 0.5 * self.spec.fine.travel;
        for (arm, leads) in self.arms.iter_mut().zip(leads) {
            let done = [arm.coarse.step(now, leads[0]), arm.fine.step(now, leads[1])];
            self.events
                .extend(done.into_iter().flatten().map(Event::Done));
            let (mut coarse, mut fine) = ([0.0; 3], [0.0; 3]);
            let mut seen = [Pose::ZERO; 2];
            for axis in 0..3 {
                let told = arm.coarse.told[axis];
                let rng = &mut self.rng;
                coarse[axis] = arm.screws[axis].step(&self.plant.coarse, told, arm.zero[axis], rng);
                seen[0].0[axis] = told + self.plant.coarse.encoder * normal(rng);
                let told = arm.fine.told[axis];
                (fine[axis], seen[1].0[axis]) =
                    arm.loops[axis].step(&self.plant.fine, told, end, rng);
            }
            let along = coarse[2] - arm.zero[2];
            arm.at = std::array::from_fn(|axis| {
                let lean = arm.lean.get(axis).copied().unwrap_or(0.0);
                coarse[axis] + lean * along + fine[axis]
            });
            for (measured, seen) in arm.measured.iter_mut().zip(seen) {
                if measured.len() == REMEMBERED {
                    measured.pop_front();
                }
                measured.push_back(seen);
            }
        }
        let tips = self.tips();
        for (side, tip) in Side::ALL.into_iter().zip(tips) {
            if let Some(tip) = tip {
                let gap = self.light.port(side, 0).clearance(tip);
                self.smallest_gap = self.smallest_gap.min(gap);
            }
        }
        self.handle(tips);
        self.measure(tips);
    }

    /// Tips of the fibers that are carried, in the frame of the chip as it lies.
    fn tips(&mut self) -> [Option<Point<Chip>>; SIDES] {
        let shaken = self.floor.as_mut().map_or([[0.0; 3]; SIDES], Floor::next);
        let [x, y, z] = self.chip;
        Side::ALL.map(|side| {
            let arm = &self.arms[side.index()];
            let holder = arm.holder(side, shaken[side.index()], self.now);
            let carried = arm.carried?;
            Some(tip_of(holder, &carried.fiber).shifted(-x, -y, -z))
        })
    }

    /// A step of what was requested.
    fn handle(&mut self, tips: [Option<Point<Chip>>; SIDES]) {
        let now = self.now;
        for mut busy in std::mem::take(&mut self.busy) {
            if let Request::Attach { arm } = busy.request
                && let Some(tip) = tips[arm]
            {
                for (sum, at) in busy.sum.iter_mut().zip([tip.x, tip.y, tip.z]) {
                    *sum += at;
                }
                busy.steps += 1;
            }
            if now < busy.until - 0.5 * STEP {
                self.busy.push(busy);
                continue;
            }
            match busy.request {
                Request::Laser(on) => self.laser = on,
                Request::Load { arm, port } => {
                    let tray = &mut self.tray[arm];
                    let place = tray.iter().position(|fiber| fiber.port == port);
                    self.arms[arm].carried = place.map(|place| tray.remove(place));
                }
                Request::Unload { arm } => self.tray[arm].extend(self.arms[arm].carried.take()),
                Request::Attach { arm } => self.fix(arm, &busy),
                // A power that was found to be its full one.
                Request::LaserPower { .. } | Request::Handle { .. } => {}
            }
            self.events.push_back(Event::Done(busy.ticket));
        }
    }

    /// A bond has set: the fiber is fixed where its tip was on average, and let go of.
    fn fix(&mut self, arm: usize, busy: &Busy) {
        let Some(Carried { port, fiber }) = self.arms[arm].carried.take() else {
            return;
        };
        let [x, y, z] = busy.sum.map(|sum| sum / f64::from(busy.steps.max(1)));
        let tip = Point::new(x, y, z);
        let at = self.light.port(Side::ALL[arm], port);
        let coupling = self.light.coupling(at, tip, &fiber);
        if arm == 1 {
            self.attached_last = Some(port);
        }
        self.attached[arm][port] = Some(Fixed {
            tip,
            fiber,
            coupling,
        });
    }

    /// A step of the meter.
    fn measure(&mut self, tips: [Option<Point<Chip>>; SIDES]) {
        let level = self.scatter.next(&mut self.rng);
        let wander = self
            .wander
            .as_mut()
            .map_or(1.0, |wander| wander.next(&mut self.rng));
        let period = 1.0 / self.spec.meter.rate;
        let samples = (self.now / period + 1e-6).floor();
        let since = self.now - (samples * period);
        let due = since < STEP * (1.0 - 1e-6);
        let until_next = if due { 0.0 } else { period - since };
        // Half a step less: what rounding makes of the time is not to decide on a step.
        if until_next < self.plant.meter.averaging.max(STEP) - 0.5 * STEP {
            let signal = if self.laser {
                wander * self.signal(tips, level)
            } else {
                0.0
            };
            self.meter.sum += signal;
            self.meter.steps += 1;
        }
        if due {
            let Meter { sum, steps } = std::mem::take(&mut self.meter);
            let signal = sum / f64::from(steps.max(1));
            let (light, meter) = (&self.plant.light, &self.plant.meter);
            let noise = meter.relative * signal * normal(&mut self.rng)
                + light.noise * normal(&mut self.rng);
            let step = self.spec.meter.resolution;
            let volts = light.offset + light.stray + signal + noise;
            let volts = ((volts / step).round() * step).clamp(0.0, self.spec.meter.range);
            let sample = Light {
                time: self.now,
                volts: vec![volts],
            };
            self.heard.push_back((self.now + meter.latency, sample));
        }
        while let Some((at, _)) = self.heard.front()
            && *at <= self.now + 0.5 * STEP
        {
            let sample = self.heard.pop_front().map(|(_, sample)| sample);
            self.events.extend(sample.map(Event::Light));
        }
    }

    /// What leaves the output fiber that is carried, or was attached last, volts.
    fn signal(&self, tips: [Option<Point<Chip>>; SIDES], level: f64) -> f64 {
        let (port, coupling, tip) = match (self.arms[1].carried.zip(tips[1]), self.attached_last) {
            (Some((Carried { port, fiber }, tip)), _) => {
                let at = self.light.port(Side::Right, port);
                (port, self.light.coupling(at, tip, &fiber), tip)
            }
            (None, Some(port)) => match &self.attached[1][port] {
                Some(fixed) => (port, fixed.coupling, fixed.tip),
                None => return 0.0,
            },
            (None, None) => return 0.0,
        };
        let input = match (&self.attached[0][0], self.arms[0].carried, tips[0]) {
            (Some(fixed), _, _) => fixed.coupling,
            (None, Some(fiber), Some(tip)) => {
                let port = self.light.port(Side::Left, 0);
                self.light.coupling(port, tip, &fiber.fiber)
            }
            _ => 0.0,
        };
        let mut outputs = [None; OUTPUTS];
        outputs[port] = Some((coupling, tip));
        let nowhere = Point::new(0.0, 1.0, 0.0);
        let signals = self.light.signals(
            &Tips {
                input,
                outputs,
                sensing: nowhere,
            },
            level,
        );
        signals[pigtail_hal::Channel::of_output(port).index()]
    }

    /// What really is. Not part of [`Bench`].
    pub fn truth(&self) -> Truth {
        let fiber = |side: Side, port: usize| {
            let fixed = self.attached[side.index()][port].as_ref()?;
            Some(self.light.truth(side, port, fixed))
        };
        Truth {
            input: fiber(Side::Left, 0),
            outputs: std::array::from_fn(|port| fiber(Side::Right, port)),
            smallest_gap: self.smallest_gap,
        }
    }

    /// Where the fiber of an arm really is, from the peak of its port at its gap; `None` while it carries none. Not
    /// part of [`Bench`].
    pub fn carried(&self, side: Side) -> Option<FiberTruth> {
        let arm = &self.arms[side.index()];
        let Carried { port, fiber } = arm.carried?;
        let [x, y, z] = self.chip;
        let tip = tip_of(arm.holder(side, [0.0; 3], self.now), &fiber).shifted(-x, -y, -z);
        let at = self.light.port(side, port);
        let coupling = self.light.coupling(at, tip, &fiber);
        let fixed = Fixed {
            tip,
            fiber,
            coupling,
        };
        Some(self.light.truth(side, port, &fixed))
    }

    /// Whether an arm may do what it is asked for.
    fn may(&self, request: &Request) -> Result<(), Refused> {
        self.caps.answers(request)?;
        let state = |text: String| Err(Refused::State(text));
        if matches!(request, Request::Handle { .. }) {
            return state("this bench has neither gripper, dispenser nor lamp".to_owned());
        }
        let (Request::Load { arm, .. } | Request::Attach { arm } | Request::Unload { arm }) =
            *request
        else {
            return Ok(());
        };
        let name = &self.caps.arms[arm];
        let at_it = |busy: &Busy| match busy.request {
            Request::Load { arm: at, .. }
            | Request::Attach { arm: at }
            | Request::Unload { arm: at } => at == arm,
            Request::Laser(_) | Request::LaserPower { .. } | Request::Handle { .. } => false,
        };
        if self.busy.iter().any(at_it) {
            return state(format!("{name} is busy with a fiber"));
        }
        let carries = self.arms[arm].carried.is_some();
        match *request {
            Request::Load { .. } if carries => state(format!("{name} carries a fiber already")),
            Request::Load { port, .. } => {
                if self.tray[arm].iter().any(|fiber| fiber.port == port) {
                    return Ok(());
                }
                state(format!("the tray of {name} has no fiber {port}"))
            }
            _ if !carries => state(format!("{name} carries no fiber")),
            _ => Ok(()),
        }
    }
}

impl Bench for BenchTwin {
    fn caps(&self) -> &Caps {
        &self.caps
    }

    fn now(&self) -> f64 {
        self.now
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        self.caps.accepts(group, &law)?;
        let ticket = self.ticket();
        self.begin(group, Some(ticket), law);
        Ok(ticket)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        let plays = |group: &usize| {
            let (arm, stage) = places(*group);
            let arm = &self.arms[arm];
            let of = match stage {
                Stage::Coarse => &arm.coarse,
                Stage::Fine => &arm.fine,
            };
            of.ticket() == Some(ticket)
        };
        let group = (0..self.caps.groups.len()).find(plays);
        let group = group.map(Group).ok_or(Refused::Ticket(ticket.0))?;
        self.caps.accepts(group, &law)?;
        self.begin(group, Some(ticket), law);
        Ok(self.now)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        self.may(&what)?;
        let seconds = match what {
            Request::Laser(_) | Request::LaserPower { .. } | Request::Handle { .. } => STEP,
            Request::Load { .. } | Request::Unload { .. } => self.spec.handling.load,
            Request::Attach { .. } => self.spec.handling.bond,
        };
        let ticket = self.ticket();
        self.busy.push(Busy {
            ticket,
            request: what,
            until: self.now + seconds,
            sum: [0.0; 3],
            steps: 0,
        });
        Ok(ticket)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        if by.is_nan() {
            return Err(Fault {
                rule: Rule::CommandNumber,
                axis: self.caps.name.clone(),
                value: "a time that is not a number".to_owned(),
                limit: "a time".to_owned(),
                time: self.now,
            });
        }
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(event);
            }
            let next = (self.step + 1) as f64 * STEP;
            if next > by + 1e-9 {
                self.now = self.now.max(by);
                return Ok(Event::Time);
            }
            self.advance();
        }
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        let (arm, stage) = places(group.0);
        let measured = &self.arms.get(arm)?.measured[stage as usize];
        let back = (self.step as f64 * STEP - at) / STEP;
        // Between steps nothing is newer than the last one.
        let back = if at <= self.now { back.max(0.0) } else { back };
        if !(0.0..=(measured.len() - 1) as f64).contains(&back) {
            return None;
        }
        let last = measured.len() - 1;
        let (low, share) = (back.floor() as usize, back.fract());
        let newer = measured[last - low];
        let older = measured[last - (low + 1).min(last)];
        Some(Estimate {
            pose: newer + (older - newer) * share,
            measured: true,
        })
    }

    fn stop(&mut self) {
        for group in 0..self.caps.groups.len() {
            self.begin(Group(group), None, Law::Brake);
        }
        // What was asked for is not done any more.
        self.busy.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_hal::bench::{Dither, Glide, Knot, Lead, Limits};

    fn twin(seed: u64) -> BenchTwin {
        let spec = include_str!("../../../rigs/bench-piezo/machine.toml");
        let plant = include_str!("../../../rigs/bench-piezo/plant.toml");
        let spec = BenchSpec::parse("machine.toml", spec).expect("it ships");
        let plant = BenchPlant::parse("plant.toml", plant).expect("it ships");
        BenchTwin::new(spec, &plant, seed).expect("it ships")
    }

    fn line(to: Pose) -> Law {
        let limits = Limits::default();
        Law::Line { to, limits }
    }

    fn until(bench: &mut BenchTwin, ticket: Ticket) -> Vec<f64> {
        let mut volts = Vec::new();
        loop {
            match bench.next(bench.now() + 30.0).expect("it is well") {
                Event::Done(done) if done == ticket => return volts,
                Event::Light(light) => volts.push(light.volts[0]),
                Event::Time => panic!("{ticket} does not end"),
                _ => {}
            }
        }
    }

    fn go(bench: &mut BenchTwin, group: usize, to: Pose) {
        let ticket = bench.play(Group(group), line(to)).expect("in reach");
        until(bench, ticket);
    }

    fn ask(bench: &mut BenchTwin, request: Request) {
        let ticket = bench.request(request).expect("it may");
        until(bench, ticket);
    }

    /// The poses that the shipped calibration has of input and first output.
    const TAUGHT: [Pose; 2] = [
        Pose::at(0.3e-3, -0.2e-3, 1.2e-3),
        Pose::at(-0.1e-3, 0.1e-3, 1e-3),
    ];

    #[test]
    fn taught_poses_are_where_fibers_touch_as_well_as_is_said() {
        let (mut across, mut along) = (Vec::new(), Vec::new());
        for seed in 0..60 {
            let mut bench = twin(seed);
            let back = Pose::at(0.0, 0.0, -50e-6);
            for arm in [0, 1] {
                ask(&mut bench, Request::Load { arm, port: 0 });
                go(&mut bench, 2 * arm, TAUGHT[arm] + back);
                let side = Side::ALL[arm];
                let at = bench.carried(side).expect("it was loaded");
                // By design the peak has walked towards x with the gap.
                let walked = 12.46_f64.to_radians().tan() * 50e-6;
                across.extend([at.x + walked, at.y]);
                along.push(at.gap - 50e-6);
            }
            assert!(bench.truth().smallest_gap > 40e-6);
        }
        let rms = |of: &[f64]| (of.iter().map(|v| v * v).sum::<f64>() / of.len() as f64).sqrt();
        let (across, deviation) = (rms(&across), rms(&along));
        assert!((2e-6..5e-6).contains(&across), "{across}");
        // Half of what repeats itself lies within the coarse group's own repeatability.
        assert!(deviation < 0.25e-6, "{deviation}");
        assert!(along.iter().all(|off| off.abs() < 0.8e-6), "{along:?}");
    }

    #[test]
    fn light_comes_at_its_rate_and_goes_with_the_laser() {
        let mut bench = twin(3);
        for arm in [0, 1] {
            ask(&mut bench, Request::Load { arm, port: 0 });
            go(
                &mut bench,
                2 * arm,
                TAUGHT[arm] + Pose::at(0.0, 0.0, -20e-6),
            );
        }
        let mean = |bench: &mut BenchTwin| {
            let mut times = Vec::new();
            let mut sum = 0.0;
            while times.len() < 50 {
                if let Event::Light(light) = bench.next(f64::INFINITY).expect("it is well") {
                    assert!(light.time <= bench.now());
                    times.push(light.time);
                    sum += light.volts[0];
                }
            }
            assert!(
                times
                    .windows(2)
                    .all(|two| (two[1] - two[0] - 0.01).abs() < 1e-9)
            );
            sum / 50.0
        };
        let dark = mean(&mut bench);
        assert!((dark - 2e-3).abs() < 1e-4, "{dark}");
        ask(&mut bench, Request::Laser(true));
        let lit = mean(&mut bench);
        assert!(lit > 2.0 * dark, "{lit}");
    }

    #[test]
    fn a_line_takes_its_time_and_backlash_is_felt() {
        let mut bench = twin(5);
        let began = bench.now();
        go(&mut bench, 0, Pose::at(1e-3, 0.0, 0.0));
        // A trapezoid: 1 mm at 1 mm/s, and a tenth of a second of 10 mm/s2; then it settles.
        let took = bench.now() - began;
        assert!((1.14..1.25).contains(&took), "{took}");
        let before = bench.arms[0].at[0];
        go(&mut bench, 0, Pose::at(1e-3 - 0.6e-6, 0.0, 0.0));
        assert!((bench.arms[0].at[0] - before).abs() < 30e-9);
        go(&mut bench, 0, Pose::at(1e-3 - 2.6e-6, 0.0, 0.0));
        let gone = before - bench.arms[0].at[0];
        assert!((gone - 1.8e-6).abs() < 0.2e-6, "{gone}");
    }

    #[test]
    fn a_circle_glides_follows_and_comes_to_rest() {
        let mut bench = twin(8);
        let turn = |to: f64, lead| {
            Law::Dither(Dither {
                centre: Glide {
                    to: [1e-6, 0.0],
                    within: 0.1,
                },
                radius: Glide { to, within: 0.1 },
                rate: 5.0,
                lead,
                widens: None,
            })
        };
        let lead = Lead {
            group: Group(0),
            from: Pose::ZERO,
            gain: [[0.0, 0.0, 0.01], [0.0; 3]],
        };
        let ticket = bench
            .play(Group(1), turn(1e-6, Some(lead)))
            .expect("it plays");
        let line = bench
            .play(Group(0), line(Pose::at(0.0, 0.0, 200e-6)))
            .expect("it plays");
        until(&mut bench, line);
        let mut middle = [0.0; 2];
        for _ in 0..200 {
            bench.next(bench.now() + STEP).expect("it is well");
            while bench.events.pop_front().is_some() {}
            for (sum, at) in middle.iter_mut().zip(bench.arms[0].loops_at()) {
                *sum += at / 200.0;
            }
        }
        // One for its own way, two for what it follows.
        assert!((middle[0] - 3e-6).abs() < 20e-9, "{middle:?}");
        assert!(middle[1].abs() < 20e-9, "{middle:?}");
        bench.bend(ticket, turn(0.0, None)).expect("it is played");
        until(&mut bench, ticket);
        let at = bench.pose(Group(1), bench.now()).expect("measured").pose;
        assert!((at - Pose::at(1e-6, 0.0, 0.0)).distance() < 20e-9, "{at:?}");
        assert_eq!(
            bench.bend(ticket, Law::Brake),
            Err(Refused::Ticket(ticket.0))
        );
    }

    impl Arm {
        fn loops_at(&self) -> [f64; 2] {
            [self.fine.told[0], self.fine.told[1]]
        }
    }

    #[test]
    fn a_scan_is_where_it_should_be_and_the_past_is_known() {
        let mut bench = twin(2);
        let knot = |time, x| Knot {
            time,
            at: Pose::at(x, 0.0, 0.0),
        };
        let start = bench.now();
        let scan = vec![knot(0.0, 0.0), knot(0.1, 5e-6), knot(0.3, 5e-6)];
        let ticket = bench.play(Group(1), Law::Scan(scan)).expect("it plays");
        until(&mut bench, ticket);
        let at = |bench: &BenchTwin, time| bench.pose(Group(1), time).expect("remembered").pose.x();
        // Half way, but for the loop's lag of 3.7 ms and the sensor's.
        let half = at(&bench, start + 0.05);
        assert!((half - (2.5e-6 - 4.2e-3 * 50e-6)).abs() < 30e-9, "{half}");
        assert!((at(&bench, start + 0.25) - 5e-6).abs() < 20e-9);
        assert!(bench.pose(Group(1), bench.now() + 1.0).is_none());
        assert!(bench.pose(Group(9), bench.now()).is_none());
    }

    #[test]
    fn a_fiber_is_fixed_where_it_stood_and_the_same_seed_gives_the_same() {
        let run = |seed| {
            let mut bench = twin(seed);
            ask(&mut bench, Request::Load { arm: 0, port: 0 });
            assert!(matches!(
                bench.request(Request::Load { arm: 0, port: 0 }),
                Err(Refused::State(_))
            ));
            go(&mut bench, 0, TAUGHT[0] + Pose::at(0.0, 0.0, -10e-6));
            let stood = bench.carried(Side::Left).expect("carried");
            ask(&mut bench, Request::Attach { arm: 0 });
            assert!(bench.carried(Side::Left).is_none());
            let fixed = bench.truth().input.expect("attached");
            assert!((fixed.x - stood.x).abs() < 30e-9, "{fixed:?} {stood:?}");
            assert!((fixed.gap - stood.gap).abs() < 30e-9);
            (fixed, bench.now())
        };
        assert_eq!(run(4), run(4));
        assert_ne!(run(4).0, run(5).0);
        // Devices on one bench differ, and the bench stays as it is.
        let of = |seed| twin(seed).arms[0].origin;
        assert_eq!(of(4), of(Specimen::of(4, 2).seed()));
        assert_ne!(twin(4).chip, twin(Specimen::of(4, 2).seed()).chip);
    }
}
