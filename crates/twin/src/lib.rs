//! The digital twin: a machine, a device and its fixture, simulated behind the boundary.
//!
//! Its parameters come from a [`Plant`] and a seed; control never sees either. What really is, as
//! opposed to what is measured, is answered by [`Twin::truth`], which is not part of
//! [`Machine`], so that no code that holds a `&mut dyn Machine` can ask.
//!
//! In go a datasheet, a [`Plant`] and a seed; out comes a machine whose truth can be asked for. Start with
//! [`plant`], what a specimen is drawn around; then `joints` and `light`, what moves and what is seen of it.
//!
//! ```
//! use pigtail_hal::{Command, Machine, Spec};
//! use pigtail_twin::{Plant, Twin};
//!
//! # let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm/");
//! # let read = |file: &str| std::fs::read_to_string(format!("{rig}{file}")).expect("the shipped rig");
//! let spec = Spec::parse("machine.toml", &read("machine.toml"))?;
//! let plant = Plant::parse("plant.toml", &read("plant.toml"))?;
//! let mut twin = Twin::new(spec, &plant, 7)?;
//! let measured = twin.exchange(&Command::IDLE)?;
//! assert!(measured.time > 0.0 && twin.truth().input.is_none());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod bench;
mod broken;
mod drive;
pub mod faults;
mod fluctuation;
mod joints;
mod light;
mod linkage;
mod manipulator;
mod micro;
pub mod plant;
pub mod production;
mod sensors;
mod setting;
mod specimen;
mod truth;
pub mod unrest;

use broken::Broken;
use drive::Drives;
use fluctuation::Fluctuation;
use light::{FiberInHolder, LightPath, Optics, Tips};
use manipulator::Manipulator;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::{AXES, CHANNELS, HolderSpec, MICRO_AXES, OUTPUTS, SIDES};
use pigtail_hal::{
    Axis, Command, Fault, FiberHandling, Handled, Machine, Measurement, Rule, Side, Spec,
};
use pigtail_model::Invalid;
use pigtail_model::frames::{Chip, Point};
use pigtail_model::instructions::{Instructions, Work};
pub use plant::Plant;
use plant::{AdhesivePlant, HandlingPlant, TemperaturePlant, ThermalPlant};
use production::Production;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use sensors::{Bias, Camera, Held, Photodiodes, Seen, normal};
use setting::{Floor, Late};
pub use specimen::Specimen;
pub use truth::{FiberTruth, Truth};

/// A simulated machine.
#[derive(Debug, Clone)]
pub struct Twin {
    spec: Spec,
    drives: Drives,
    manipulators: [Manipulator; SIDES],
    light: LightPath,
    /// The fibers in the tray: the input's, then the outputs'.
    tray: [Vec<Held>; SIDES],
    held: [Option<Held>; SIDES],
    attached: [[Option<Fixed>; OUTPUTS]; SIDES],
    /// Fibers that are held until their bond has set.
    setting: [Option<Setting>; SIDES],
    /// Cycles that a bond takes to set.
    bond: u32,
    sensing: (FiberInHolder, Bias),
    scatter: Fluctuation,
    photodiodes: Photodiodes,
    camera: Camera,
    /// Arm and noise of the probes, metres.
    probe: Option<(f64, f64)>,
    rng: Pcg64Mcg,
    cycle: u64,
    /// What the piezos were last told.
    micro_volts: [[Volts; MICRO_AXES]; SIDES],
    fault: Option<Fault>,
    smallest_gap: f64,
    /// Of the sensing fiber over the outputs, metres.
    sensing_height: f64,
    /// Speed of the device in x, and since when.
    drift: (f64, f64),
    thermal: ThermalPlant,
    temperature: TemperaturePlant,
    floor: Option<Floor>,
    /// Whether the chip moves beside the machine by any of these.
    chip_moves: bool,
    /// Of the laser's power.
    wander: Option<Fluctuation>,
    late: Option<Late>,
    broken: Broken,
    adhesive: AdhesivePlant,
    handling: HandlingPlant,
    /// Of the machine's adhesive, and of what happens to each fiber.
    seeds: (u64, u64),
    /// How steps of the handling have ended in this cycle.
    handled: [Option<Handled>; SIDES],
    production: Option<Box<Production>>,
    /// Where the holders were in the last cycle with a tray.
    holders: [Point<Chip>; SIDES],
}

/// What warmth does to piezos is worked out anew every so many cycles: it takes minutes.
const WARM_EVERY: u64 = 2500;

/// A fiber fixed to the chip.
#[derive(Debug, Clone, Copy)]
struct Fixed {
    tip: Point<Chip>,
    fiber: FiberInHolder,
    coupling: f64,
}

/// A bond that sets.
#[derive(Debug, Clone, Copy)]
struct Setting {
    /// Sum of the places of the tip so far, metres.
    sum: [f64; 3],
    /// Cycles so far.
    cycles: u32,
}

/// Why a twin cannot be built from a plant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TwinError {
    /// A parameter is out of range.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A joint moves too fast for the servo.
    #[error(
        "joint {axis} would need {steps:.0} integration steps a servo cycle; accepted are inertias, \
         friction and stiffness that need at most 100"
    )]
    Stiff {
        /// The axis.
        axis: &'static str,
        /// Steps a cycle.
        steps: f64,
    },
    /// The five-bar cannot stand at its home.
    #[error("`five_bar.home`: {0}")]
    Home(#[from] pigtail_model::fivebar::Unreachable),
}

impl Twin {
    /// A specimen drawn around `plant`. The same seed gives the same machine, device, fixture and
    /// noise; see [`Specimen`] for many devices on one machine.
    ///
    /// # Errors
    ///
    /// When the plant's mechanism cannot stand at its home.
    pub fn new(spec: Spec, plant: &Plant, seed: u64) -> Result<Self, TwinError> {
        let specimen = Specimen::from(seed);
        // One stream of random numbers for each thing that is drawn, so that a change to one
        // leaves the others as they are.
        let numbered = |seed: u64, number: u64| seed.wrapping_mul(16).wrapping_add(number);
        let stream = |number| Pcg64Mcg::seed_from_u64(numbered(seed, number));
        let of_machine = |number| Pcg64Mcg::seed_from_u64(numbered(specimen.machine(), number));
        // The chip's frame moves with the chip: a chip out of place is a machine out of place.
        let mut device = stream(1);
        let m = &plant.misplacement;
        let chip = [m.chip_x, m.chip_z].map(|width| m.offset(&mut device, width));
        let camera = Camera::new(&spec, &plant.camera);
        let draw = |port, rng: &mut Pcg64Mcg| Held {
            port,
            fiber: FiberInHolder::draw(plant, rng),
            bias: camera.draw_bias(rng),
        };
        let fibers_of = |mut rng: Pcg64Mcg| {
            let input = vec![draw(0, &mut rng)];
            let outputs = (0..OUTPUTS).map(|port| draw(port, &mut rng)).collect();
            ([input, outputs], draw(0, &mut rng))
        };
        let (tray, _) = fibers_of(stream(2));
        let (_, mut sensing) = fibers_of(of_machine(2));
        let (mut left, left_joints) =
            Manipulator::new(plant, &spec, Side::Left, chip, &mut of_machine(0))?;
        let (mut right, right_joints) =
            Manipulator::new(plant, &spec, Side::Right, chip, &mut of_machine(4))?;
        if plant.micro.history > 0.0 {
            let mut history = stream(7);
            for manipulator in [&mut left, &mut right] {
                manipulator.micro.wear_in(plant.micro.history, &mut history);
            }
        }
        let [ox, oy, oz] = spec.sensing_fiber.offset;
        let [dx, dy, dz] = right.placement.chip_direction(ox, oy, oz);
        let [x, y, z] = sensing.fiber.offset;
        sensing.fiber.offset = [x + dx, y + dy, z + dz];
        let mut noise = stream(3);
        let period = spec.period();
        let scatter = &plant.scatter;
        let optics = Optics {
            device: &plant.device,
            fiber: &plant.fiber,
            light: &plant.light,
            scatter,
            loss: plant.variation.loss,
            core: spec.sensing_fiber.core,
        };
        Ok(Self {
            drives: Drives::new(
                plant,
                &spec,
                &[left_joints, right_joints],
                numbered(seed, 5),
            )?,
            manipulators: [left, right],
            light: LightPath::new(&optics, &mut device)?,
            tray,
            held: [None; SIDES],
            attached: [[None; OUTPUTS]; SIDES],
            setting: [None; SIDES],
            bond: ((plant.bond.time / period).round() as u32).max(1),
            sensing: (sensing.fiber, sensing.bias),
            scatter: Fluctuation::new(scatter.fluctuation, scatter.bandwidth, period, &mut noise),
            photodiodes: Photodiodes::new(&spec, &plant.light),
            camera,
            probe: spec
                .probe
                .as_ref()
                .map(|probe| (probe.arm, plant.probe.noise)),
            rng: noise,
            cycle: 0,
            micro_volts: Command::IDLE.micro,
            fault: None,
            smallest_gap: f64::INFINITY,
            sensing_height: 0.0,
            drift: (plant.device.drift, plant.device.drift_from),
            thermal: plant.thermal,
            temperature: plant.temperature,
            floor: Floor::new(&plant.floor, period, numbered(seed, 8)),
            chip_moves: plant.device.drift != 0.0
                || plant.thermal != ThermalPlant::default()
                || plant.temperature.swing > 0.0
                || plant.floor.rms != [0.0; 3],
            wander: (plant.light.wander > 0.0).then(|| {
                let bandwidth = 1.0 / (std::f64::consts::TAU * plant.light.wander_time);
                Fluctuation::new(plant.light.wander, bandwidth, period, &mut stream(9))
            }),
            late: Late::new((plant.electronics.delay / period).round() as usize),
            broken: Broken::default(),
            adhesive: plant.adhesive,
            handling: plant.handling,
            seeds: (numbered(specimen.machine(), 10), numbered(seed, 11)),
            handled: [None; SIDES],
            production: None,
            holders: [Point::ORIGIN; SIDES],
            spec,
        })
    }

    fn time(&self) -> f64 {
        self.cycle as f64 / self.spec.servo.rate
    }

    fn refuse(&mut self, rule: Rule, axis: String, value: String, limit: String) -> Fault {
        let fault = Fault {
            rule,
            axis,
            value,
            limit,
            time: self.time(),
        };
        self.fault = Some(fault.clone());
        fault
    }

    fn taken_apart(&mut self, side: Side) -> Fault {
        self.refuse(
            Rule::FiveBarAssembly,
            format!("{}.a", side.name()),
            "a position beyond the mechanism's reach".to_owned(),
            format!("a workspace of {} m", self.spec.five_bar.workspace),
        )
    }

    /// Whether there is nothing in a command that has to be looked at: no pulse, and no voltage that is no number.
    fn is_plain(command: &Command) -> bool {
        let motors = command.motors.as_flattened().iter();
        // What is no number times zero is none, and so is what is infinite.
        let volts = motors.chain(command.micro.as_flattened());
        let none = volts.fold(0.0, |sum, Volts(volts)| sum + 0.0 * volts);
        none == 0.0 && command.pulses.as_flattened().iter().all(Option::is_none)
    }

    #[cold]
    fn check(&mut self, command: &Command) -> Result<(), Fault> {
        for side in Side::ALL {
            for axis in Axis::ALL {
                let Volts(volts) = command.motors[side.index()][axis.index()];
                if !volts.is_finite() {
                    let axis = format!("{}.{}", side.name(), axis.name());
                    return Err(self.refuse(
                        Rule::CommandNumber,
                        axis,
                        format!("{volts} V"),
                        "a finite voltage".to_owned(),
                    ));
                }
                if let Some(pulse) = &command.pulses[side.index()][axis.index()]
                    && let Err(why) = pulse.check(self.spec.drive(axis))
                {
                    let axis = format!("{}.{}", side.name(), axis.name());
                    return Err(self.refuse(why.rule, axis, why.value, why.limit));
                }
            }
            for (i, Volts(volts)) in command.micro[side.index()].into_iter().enumerate() {
                if !volts.is_finite() {
                    return Err(self.refuse(
                        Rule::CommandNumber,
                        format!("{}.micro{}", side.name(), i + 1),
                        format!("{volts} V"),
                        "a finite voltage".to_owned(),
                    ));
                }
            }
        }
        Ok(())
    }

    fn handle_fiber(&mut self, side: Side, handling: FiberHandling) -> Result<(), Fault> {
        let i = side.index();
        match handling {
            FiberHandling::Load(port) => {
                if self.held[i].is_some() {
                    return Err(self.refuse(
                        Rule::HolderEmpty,
                        side.name().to_owned(),
                        "a holder that carries a fiber".to_owned(),
                        "an empty one".to_owned(),
                    ));
                }
                let place = self.tray[i]
                    .iter()
                    .position(|f| f.port == usize::from(port));
                let Some(place) = place else {
                    return Err(self.refuse(
                        Rule::TrayFiber,
                        side.name().to_owned(),
                        format!("fiber {port}"),
                        format!(
                            "one of {:?}",
                            self.tray[i].iter().map(|f| f.port).collect::<Vec<_>>()
                        ),
                    ));
                };
                self.held[i] = Some(self.tray[i].remove(place));
            }
            FiberHandling::Unload => {
                self.setting[i] = None;
                self.tray[i].extend(self.held[i].take());
            }
            FiberHandling::Attach => {
                if self.held[i].is_none() {
                    return Err(self.refuse(
                        Rule::HolderFiber,
                        side.name().to_owned(),
                        "an empty holder".to_owned(),
                        "a fiber".to_owned(),
                    ));
                }
                self.setting[i].get_or_insert(Setting {
                    sum: [0.0; 3],
                    cycles: 0,
                });
            }
            what => self.begin_handling(side, what),
        }
        Ok(())
    }

    /// A cycle of a bond that sets: when it has set, the fiber is fixed where its tip was on average.
    fn set_bond(&mut self, side: Side, holder: Point<Chip>) {
        let i = side.index();
        let (Some(setting), Some(held)) = (&mut self.setting[i], &self.held[i]) else {
            return;
        };
        let tip = tip_of(holder, &held.fiber);
        for (sum, at) in setting.sum.iter_mut().zip([tip.x, tip.y, tip.z]) {
            *sum += at;
        }
        setting.cycles += 1;
        if setting.cycles < self.bond {
            return;
        }
        let [x, y, z] = setting.sum.map(|sum| sum / f64::from(setting.cycles));
        let tip = Point::new(x, y, z);
        let port = self.light.port(side, held.port);
        let coupling = self.light.coupling(port, tip, &held.fiber);
        self.attached[i][held.port] = Some(Fixed {
            tip,
            fiber: held.fiber,
            coupling,
        });
        (self.setting[i], self.held[i]) = (None, None);
    }

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn probes(&mut self) -> Option<[[f64; AXES]; SIDES]> {
        let (arm, noise) = self.probe?;
        let mut probes = [[0.0; AXES]; SIDES];
        for (probes, manipulator) in probes.iter_mut().zip(&self.manipulators) {
            let [a, b, z] = manipulator.endpoint.0;
            *probes = [arm * a, arm * b, manipulator.screw.position(z)];
            for probe in probes {
                *probe += noise * normal(&mut self.rng);
            }
        }
        Some(probes)
    }

    /// Coupling and tip of a fiber, be it attached or held with its tip at such a place.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn fiber_at(
        &self,
        side: Side,
        port: usize,
        held_tip: Option<Point<Chip>>,
    ) -> Option<(f64, Point<Chip>)> {
        if let Some(fixed) = &self.attached[side.index()][port] {
            return Some((fixed.coupling, fixed.tip));
        }
        let held = self.held[side.index()]
            .as_ref()
            .filter(|held| held.port == port)?;
        let (tip, port) = (held_tip?, self.light.port(side, port));
        Some((self.light.coupling(port, tip, &held.fiber), tip))
    }

    /// Light at the photodiodes, volts, without what they add to it.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn signals(
        &mut self,
        [left, right]: &[Option<Point<Chip>>; SIDES],
        sensing: Point<Chip>,
        lit: Option<u8>,
    ) -> [f64; CHANNELS] {
        let level = self.scatter.next(&mut self.rng);
        let Some(percent) = lit else {
            return [0.0; CHANNELS];
        };
        let tips = Tips {
            input: self
                .fiber_at(Side::Left, 0, *left)
                .map_or(0.0, |(coupling, _)| coupling),
            outputs: [
                self.fiber_at(Side::Right, 0, *right),
                self.fiber_at(Side::Right, 1, *right),
            ],
            sensing,
        };
        let power = match &mut self.wander {
            Some(wander) => wander.next(&mut self.rng),
            None => 1.0,
        };
        let power = power * (f64::from(self.spec.laser.nearest(percent)) / 100.0);
        let signals = self.light.signals(&tips, level);
        signals.map(|signal| power * signal)
    }

    /// How far each holder has gone beside the chip, whose frame goes with the device, by drift, warmth and the floor, metres.
    fn beside_the_chip(&mut self) -> [[f64; 3]; SIDES] {
        let time = self.time();
        let drifted = self.drift.0 * (time - self.drift.1).max(0.0);
        let ThermalPlant { chip, left, right } = &self.thermal;
        let warmer = self.temperature.warmer(time);
        let by = &self.temperature;
        let warm = [(left, by.left), (right, by.right)].map(|(holder, goes)| {
            std::array::from_fn(|i| time * (holder[i] - chip[i]) + warmer * (goes[i] - by.chip[i]))
        });
        let shaken = self.floor.as_mut().map(Floor::next).unwrap_or_default();
        std::array::from_fn(|i| {
            let ([x, y, z], [sx, sy, sz]): ([f64; 3], _) = (warm[i], shaken[i]);
            [x + sx - drifted, y + sy, z + sz]
        })
    }

    /// One cycle under a command that was found good.
    fn cycle(&mut self, command: &Command) -> Result<Measurement, Fault> {
        Instructions::run_work(Cycle {
            twin: self,
            command,
        })
    }

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn pass(&mut self, command: &Command) -> Result<Measurement, Fault> {
        self.micro_volts = command.micro;
        let arriving = self.late.as_mut().map(|late| late.arriving(command));
        let command = arriving.as_ref().unwrap_or(command);
        let mut torques = [[0.0; AXES]; SIDES];
        for side in Side::ALL {
            let i = side.index();
            torques[i] = match self.manipulators[i].torques() {
                Some(torques) => torques,
                None => return Err(self.taken_apart(side)),
            };
        }
        let outputs = self
            .drives
            .advance(&command.motors, &command.pulses, &torques);
        if self.temperature.swing > 0.0 && self.cycle.is_multiple_of(WARM_EVERY) {
            let warmer = self.temperature.warmer(self.time());
            for manipulator in &mut self.manipulators {
                manipulator.micro.warm(&self.temperature, warmer);
            }
        }
        let mut holders = [Point::ORIGIN; SIDES];
        let beside = self.chip_moves.then(|| self.beside_the_chip());
        for side in Side::ALL {
            let i = side.index();
            let holder = self.manipulators[i].advance(outputs[i], command.micro[i], &mut self.rng);
            let Some(holder) = holder else {
                return Err(self.taken_apart(side));
            };
            let holder = match beside {
                Some(beside) => {
                    let [x, y, z] = beside[i];
                    holder.shifted(x, y, z)
                }
                None => holder,
            };
            holders[i] = holder;
            if let Some(handling) = command.fiber[i] {
                self.handle_fiber(side, handling)?;
            }
            if self.setting[i].is_some() {
                self.set_bond(side, holder);
            }
        }
        if self.production.is_some() {
            self.produce(&holders);
        }
        self.cycle += 1;
        let time = self.time();

        let right = holders[Side::Right.index()];
        let sensing = tip_of(right, &self.sensing.0);
        self.sensing_height = sensing.y - self.light.port(Side::Right, 0).position.y;
        let lit = command.laser && !self.broken.laser_off;
        let lit = lit.then_some(command.laser_percent);
        let tips = Side::ALL.map(|side| {
            let held = self.held[side.index()].as_ref()?;
            Some(self.held_tip(side, holders[side.index()], &held.fiber))
        });
        let signals = self.signals(&tips, sensing, lit);
        let light = self
            .photodiodes
            .cycle(&signals, self.cycle, time, &mut self.rng);
        let seen = self.camera.exposes(self.cycle).then(|| {
            let seen = |side: Side, tip: Point<Chip>, bias: Bias| Seen {
                tip,
                port: self.light.port(side, 0).position,
                bias,
            };
            let fibers = Side::ALL.map(|side| {
                let held = self.held[side.index()].as_ref()?;
                Some(seen(side, tips[side.index()]?, held.bias))
            });
            (fibers, seen(Side::Right, sensing, self.sensing.1))
        });
        let vision = self.camera.cycle(seen, self.cycle, time, &mut self.rng);
        for side in Side::ALL {
            let i = side.index();
            let gap = if let (Some(held), Some(tip)) = (&self.held[i], tips[i]) {
                self.light.port(side, held.port).clearance(tip)
            } else {
                // An empty holder is as broad as it is.
                let HolderSpec { tip, width, .. } = self.spec.holder;
                let port = self.light.port(side, 0);
                let corner = |aside: f64| port.clearance(holders[i].shifted(aside, 0.0, 0.0));
                tip + corner(0.5 * width).min(corner(-0.5 * width))
            };
            self.smallest_gap = self.smallest_gap.min(gap);
        }
        let sensing_gap = self.light.port(Side::Right, 0).clearance(sensing);
        self.smallest_gap = self.smallest_gap.min(sensing_gap);
        Ok(Measurement {
            time,
            encoders: self.drives.encoders(),
            light,
            vision,
            probes: self.probes(),
            handled: std::mem::take(&mut self.handled),
            stop: self.broken.stop_pressed,
        })
    }
}

/// A cycle of a twin under a command.
struct Cycle<'a> {
    twin: &'a mut Twin,
    command: &'a Command,
}

impl Work for Cycle<'_> {
    type Output = Result<Measurement, Fault>;

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn work(self) -> Self::Output {
        self.twin.pass(self.command)
    }
}

/// The tip of a fiber in a holder.
fn tip_of(holder: Point<Chip>, fiber: &FiberInHolder) -> Point<Chip> {
    let [x, y, z] = fiber.offset;
    holder.shifted(x, y, z)
}

impl Machine for Twin {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        if let Some(fault) = &self.fault {
            return Err(fault.clone());
        }
        if !Self::is_plain(command) {
            self.check(command)?;
        }
        if self.broken.is_well() {
            self.cycle(command)
        } else {
            self.cycle_broken(command)
        }
    }

    fn stop(&mut self) {
        // Without voltage the motors' friction and back emf bring everything to rest. The piezos
        // stay: letting them go would throw the fibers sideways.
        let idle = Command {
            micro: self.micro_volts,
            ..Command::IDLE
        };
        for _ in 0..(0.1 * self.spec.servo.rate) as u64 {
            if self.exchange(&idle).is_err() {
                return;
            }
        }
    }
}
