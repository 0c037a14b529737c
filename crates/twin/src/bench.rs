//! The simulated bench that is controlled by position: steppers below piezos on two arms, and a power meter.
//!
//! Its truth is a [`BenchPlant`] and a seed. The arms' frames are turned against the chip's: the left one is
//! only shifted, the right one is turned by half a turn about y besides, as z of both goes towards the chip. What
//! really is, is answered by [`BenchTwin::truth`], which is not part of [`Bench`](pigtail_hal::bench::Bench).
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

mod interface;
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
use pigtail_hal::bench::{Caps, Event, Group, Law, Light, Pose, Request, Stage, Ticket};
use pigtail_hal::spec::{OUTPUTS, SIDES, Side};
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

    /// What really is. Not part of [`Bench`](pigtail_hal::bench::Bench).
    pub fn truth(&self) -> Truth {
        Truth::of(&self.light, &self.attached, self.smallest_gap)
    }

    /// Where the fiber of an arm really is, from the peak of its port at its gap; `None` while it carries none. Not
    /// part of [`Bench`](pigtail_hal::bench::Bench).
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
}
