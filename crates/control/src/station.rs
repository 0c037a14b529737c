//! The station owns the machine's time: every cycle it turns wanted motion into one command,
//! exchanges it for a measurement, and lets the procedure look at what came back.

mod arm;
mod bench;
mod handling;
mod past;
mod playing;

use self::arm::{Arm, Started};
pub use self::bench::{coarse, fine};
use self::past::Past;
use self::playing::Playing;
use crate::beam::SpotSize;
use crate::calibration::Calibration;
use crate::cell::Layout;
use crate::compensation::online::Told;
use crate::gap_by_light::Spread;
use crate::impulse::belief::ImpulseBelief;
use crate::kinematics::Kinematics;
use crate::outcome::{Halt, Outcome};
use crate::servo::{Pid, PidState};
use crate::shaking::Measured;
use crate::trajectory::{Arc, Limits, Line, Motion, Path, Rates, Refused, Shape};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{CHANNELS, MICRO_AXES, SIDES};
use pigtail_hal::{
    Axis, AxisName, Channel, Command, Fault, FiberHandling, Machine, Measurement, Pulse, Side,
    Spec, VisionFrame,
};
use pigtail_model::frames::{Displacement, Macro, Point};
use pigtail_model::windup::{Windup, WindupState};
use std::cell::Cell;
use std::f64::consts::TAU;

/// What an observer is told with every light sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// When the light was sampled, seconds of machine time.
    pub time: f64,
    /// The photodiodes, volts, indexed by [`Channel`].
    pub light: [f64; CHANNELS],
    /// Endpoint of each macro by its encoders.
    pub endpoints: [Point<Macro>; SIDES],
    /// Displacement commanded to each micro in its manipulator's x and y, metres.
    pub micro: [Displacement; SIDES],
}

/// Someone who watches a run: a progress bar, a record, or nobody.
pub trait Observer {
    /// A phase of a fiber's alignment begins at `time` seconds.
    fn phase(&mut self, port: &str, phase: &'static str, time: f64);
    /// The phase is over at `time` seconds, done or given up.
    fn phase_over(&mut self, _port: &str, _phase: &'static str, _time: f64) {}
    /// A light sample was taken.
    fn sample(&mut self, sample: &Sample);
    /// A search has made a trial: which start it belongs to, its number, and the least cost so far.
    fn trial(&mut self, _start: usize, _trial: u32, _best: f64) {}
}

/// Watches nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {
    fn phase(&mut self, _: &str, _: &'static str, _: f64) {}
    fn sample(&mut self, _: &Sample) {}
}

/// A machine under control.
pub struct Station<'a> {
    machine: &'a mut dyn Machine,
    observer: &'a mut dyn Observer,
    arms: [Arm; SIDES],
    limits: Limits,
    shape: Shape,
    command: Command,
    measurement: Measurement,
    past: Past,
    /// By when a micro has come to rest, seconds.
    settling: f64,
    /// What was measured of how tips shake.
    shaking: [Option<Measured>; SIDES],
    /// How light spreads over a gap in the scale of the micros, where it was measured.
    spread: [Option<Spread>; SIDES],
    /// How wide the spot of light at the chip is in the scale of the micros, where it was measured.
    spot: [Option<SpotSize>; SIDES],
    /// What is believed of pulses on a five-bar.
    five_bar_pulses: Option<ImpulseBelief>,
    /// Light samples that somebody has looked at, and the time of the last of them.
    readings: Cell<(u64, f64)>,
    /// What it plays as a bench.
    playing: Playing,
}

/// Mean and spread of repeated light samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Level {
    /// Mean, volts.
    pub mean: f64,
    /// Standard deviation of one sample, volts.
    pub sigma: f64,
}

impl Level {
    /// Of so many samples (two or more), by their sum and that of their squares.
    pub(crate) fn of_sums(n: f64, sum: f64, squares: f64) -> Self {
        let mean = sum / n;
        let variance = ((squares - n * mean * mean) / (n - 1.0)).max(0.0);
        Self {
            mean,
            sigma: variance.sqrt(),
        }
    }
}

/// How near, in encoder counts, an axis must come to count as arrived, and for how long.
const ARRIVED_COUNTS: i64 = 1;
const ARRIVED_SECONDS: f64 = 0.02;
/// An axis that has not arrived by then stays where friction holds it...
const SETTLE_SECONDS: f64 = 0.3;
/// ...unless it is so many counts away that something else must hold it.
const LOST_COUNTS: i64 = 10;
/// How long the machine is left to come to rest when it is taken up again.
const RECOVERY_SECONDS: f64 = 0.3;
/// How fast it is brought back then, as a share of the motors' highest speed.
const RECOVERY_PACE: f64 = 0.02;

/// The axes of a side come to rest at the end of a motion.
#[derive(Debug, Clone, Copy, Default)]
struct Arrival {
    /// Since the motion's end, seconds, and since all of them are where they should be.
    waited: f64,
    near: f64,
}

impl Arrival {
    /// After a cycle more; whether they have arrived, or will not.
    fn step(&mut self, station: &Station, side: Side) -> bool {
        let period = station.spec().period();
        self.waited += period;
        let error = |axis: &Axis| station.following_error(AxisName { side, axis: *axis });
        let near = Axis::ALL
            .iter()
            .all(|axis| error(axis).abs() <= ARRIVED_COUNTS);
        self.near = if near { self.near + period } else { 0.0 };
        self.waited >= SETTLE_SECONDS || self.near >= ARRIVED_SECONDS
    }
}

impl<'a> Station<'a> {
    /// Takes control of a machine that stands at home.
    ///
    /// # Errors
    ///
    /// When the machine has a fault.
    pub fn new(
        machine: &'a mut dyn Machine,
        calibration: &Calibration,
        observer: &'a mut dyn Observer,
    ) -> Result<Self, Fault> {
        let spec = machine.spec().clone();
        let arms = Side::ALL.map(|side| Arm::new(&spec, calibration, side));
        let mut command = Command::IDLE;
        for (micro, arm) in command.micro.iter_mut().zip(&arms) {
            *micro = arm.kinematics.micro_volts(Displacement::ZERO);
        }
        let measurement = machine.exchange(&command)?;
        let micro = &calibration.geometry.micro;
        let settling = micro.settling.unwrap_or(spec.micro.settling);
        let lag = (micro.lag, micro.lag_deviation);
        let kinematics = [&arms[0].kinematics, &arms[1].kinematics];
        Ok(Self {
            playing: Playing::new(bench::caps(&spec, (settling, lag), kinematics)),
            past: Past::new(&spec),
            settling,
            shaking: Side::ALL.map(|side| calibration.shaking.of(side)),
            spread: Side::ALL.map(|side| calibration.spread.of(side)),
            spot: Side::ALL.map(|side| calibration.spot.of(side)),
            five_bar_pulses: calibration.impulse.five_bar.clone(),
            readings: Cell::new((0, f64::NEG_INFINITY)),
            limits: Limits {
                xy: Rates {
                    speed: spec.five_bar.speed,
                    acceleration: spec.five_bar.acceleration,
                    jerk: spec.five_bar.jerk,
                },
                z: Rates {
                    speed: spec.z_stage.speed,
                    acceleration: spec.z_stage.acceleration,
                    jerk: spec.z_stage.jerk,
                },
            },
            shape: Shape::default(),
            machine,
            observer,
            arms,
            command,
            measurement,
        })
    }

    /// The datasheet.
    pub fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    /// Machine time, seconds.
    pub fn time(&self) -> f64 {
        self.measurement.time
    }

    /// By when a micro has come to rest where it was told to be, as believed, seconds.
    pub fn micro_settling(&self) -> f64 {
        self.settling
    }

    /// The believed kinematics of a manipulator.
    pub fn kinematics(&self, side: Side) -> &Kinematics {
        &self.arms[side.index()].kinematics
    }

    /// What is known of it for an alignment: its datasheet, and what its calibration believes.
    pub fn layout(&self) -> Layout {
        Layout {
            spec: self.spec().clone(),
            frames: Side::ALL.map(|side| self.kinematics(side).placement()),
            shaking: self.shaking,
            spread: self.spread,
            spot: self.spot,
            follows: Side::ALL.map(|side| self.has_piezo_model(side)),
        }
    }

    /// Tells the observer of a trial of a search.
    pub fn tell_trial(&mut self, start: usize, trial: u32, best: f64) {
        self.observer.trial(start, trial, best);
    }

    /// Takes the machine into its hands again after a fault that an experiment provoked: clears it, lets every
    /// axis come to rest where it stands, and brings all back to their references, slowly and each by itself:
    /// a path need not be possible from where they were left.
    ///
    /// # Errors
    ///
    /// The same fault where nothing can clear it, or whatever hinders the way back.
    pub fn recover(&mut self, fault: Fault) -> Result<(), Halt> {
        if self.machine.clear().is_none() {
            return Err(fault.into());
        }
        let to = Side::ALL.map(|side| self.arms[side.index()].references);
        // What was measured last is of before it stopped: the first command drives nothing.
        self.command.motors = Command::IDLE.motors;
        self.command.references = Command::IDLE.references;
        self.command.pulses = Command::NO_PULSES;
        self.measurement = self.machine.exchange(&self.command)?;
        for side in Side::ALL {
            for axis in Axis::ALL {
                self.close_loop(AxisName { side, axis });
            }
        }
        self.run(RECOVERY_SECONDS)?;
        let from = self.measurement.encoders;
        let period = self.spec().period();
        // Of the axis that takes the most cycles: by the encoders alone, which are right even where no
        // endpoint belongs to them.
        let mut cycles = 1.0_f64;
        for axis in Axis::ALL {
            let (i, drive) = (axis.index(), self.spec().drive(axis));
            let counts_per_radian = f64::from(drive.counts_per_turn) / TAU;
            let pace = RECOVERY_PACE * drive.speed * counts_per_radian * period;
            for (from, to) in from.iter().zip(&to) {
                cycles = cycles.max(((to[i].0 - from[i].0).abs() as f64 / pace).ceil());
            }
        }
        for k in 1..=cycles as u64 {
            let share = k as f64 / cycles;
            for (arm, (from, to)) in self.arms.iter_mut().zip(from.iter().zip(&to)) {
                arm.references = std::array::from_fn(|i| {
                    let way = (to[i].0 - from[i].0) as f64;
                    Counts(from[i].0 + (share * way).round() as i64)
                });
            }
            self.cycle()?;
        }
        for side in Side::ALL {
            self.settle(side)?;
        }
        Ok(())
    }

    /// One servo cycle.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn cycle(&mut self) -> Result<(), Fault> {
        let (time, period) = (self.measurement.time, self.spec().period());
        self.play_fine(time + period);
        for (i, arm) in self.arms.iter_mut().enumerate() {
            arm.wait(&self.measurement.encoders[i], self.limits.z, period);
            arm.follow(time);
            self.command.motors[i] = arm.servo(&self.measurement.encoders[i]);
            self.command.references[i] = arm.servo_references();
            self.command.micro[i] = arm.piezos();
        }
        self.measurement = self.machine.exchange(&self.command)?;
        self.command.fiber = [None; SIDES];
        self.command.pulses = Command::NO_PULSES;
        if self.measurement.handled.iter().any(Option::is_some) {
            self.end_handling();
        }
        self.look();
        if let Some(light) = self.measurement.light {
            let sample = Sample {
                time: light.time,
                light: light.volts.map(|Volts(volts)| volts),
                endpoints: Side::ALL.map(|side| self.endpoint(side)),
                micro: [self.arms[0].micro, self.arms[1].micro],
            };
            self.observer.sample(&sample);
        }
        Ok(())
    }

    /// Cycles for `seconds`.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn run(&mut self, seconds: f64) -> Result<(), Fault> {
        for _ in 0..(seconds * self.spec().servo.rate).round() as u64 {
            self.cycle()?;
        }
        Ok(())
    }

    /// Switches the laser.
    pub fn laser(&mut self, on: bool) {
        self.command.laser = on;
    }

    /// Its power where it is on, percent of its full power.
    pub fn laser_power(&mut self, percent: u8) {
        self.command.laser_percent = percent;
    }

    /// Handles a fiber in the next cycle, and waits for it.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn handle_fiber(&mut self, side: Side, handling: FiberHandling) -> Result<(), Fault> {
        self.take_up(side, handling);
        self.cycle()
    }

    /// Handles a fiber in the next cycle.
    fn take_up(&mut self, side: Side, handling: FiberHandling) {
        self.command.fiber[side.index()] = Some(handling);
        self.arms[side.index()].loaded = matches!(handling, FiberHandling::Load(_));
    }

    /// Whether a holder carries a fiber.
    pub fn carries(&self, side: Side) -> bool {
        self.arms[side.index()].loaded
    }

    /// Whether the piezos of a side have a model that is believed.
    pub fn has_piezo_model(&self, side: Side) -> bool {
        self.arms[side.index()].piezos.is_some()
    }

    /// Notes where the holders are.
    fn look(&mut self) {
        let stands = std::array::from_fn(|side| {
            let arm = &self.arms[side];
            let encoders = &self.measurement.encoders[side];
            let input = |i: usize| arm.kinematics.input(i, encoders[i]) - arm.windup[i];
            (std::array::from_fn(input), arm.micro)
        });
        self.past.note(stands);
    }

    /// Where an endpoint is by its encoders, less what the transmissions have wound up (2.23);
    /// where it is wanted if they make no sense.
    pub fn endpoint(&self, side: Side) -> Point<Macro> {
        let arm = &self.arms[side.index()];
        let encoders = &self.measurement.encoders[side.index()];
        let outputs = std::array::from_fn(|i| arm.kinematics.input(i, encoders[i]) - arm.windup[i]);
        let mut turning = arm.turning.get();
        let endpoint = arm.kinematics.endpoint_from(&mut turning, outputs);
        arm.turning.set(turning);
        endpoint.unwrap_or(arm.wanted)
    }

    /// Where an endpoint is wanted at this moment.
    pub fn wanted(&self, side: Side) -> Point<Macro> {
        self.arms[side.index()].wanted
    }

    /// Gives the motions that start from now on another profile. It begins with the thesis's
    /// trapezoid.
    pub fn set_shape(&mut self, shape: Shape) {
        self.shape = shape;
    }

    /// Starts a straight line from where the endpoint is wanted now, no faster than `speed` m/s.
    ///
    /// # Errors
    ///
    /// [`Outcome::Refused`] when it would break a limit; the endpoint then stays as it is.
    pub fn start_line(
        &mut self,
        side: Side,
        to: Point<Macro>,
        speed: Option<f64>,
    ) -> Result<(), Outcome> {
        self.start(side, Line::new(self.wanted(side), to), speed)
    }

    /// Starts an arc, which must begin where the endpoint is wanted now, no faster than `speed`
    /// m/s along it.
    ///
    /// # Errors
    ///
    /// As [`Self::start_line`].
    pub fn start_arc(&mut self, side: Side, arc: Arc, speed: Option<f64>) -> Result<(), Outcome> {
        self.start(side, arc, speed)
    }

    /// Starts a motion, unless it would break a limit somewhere on its way.
    fn start(
        &mut self,
        side: Side,
        path: impl Into<Path>,
        speed: Option<f64>,
    ) -> Result<(), Outcome> {
        let path = path.into();
        let (start, here) = (path.start(), self.wanted(side));
        if start != here {
            let why = Refused::Start { start, here };
            return Err(Outcome::Refused { side, why });
        }
        let motion = self.motion(side, path, speed)?;
        self.arms[side.index()].motion = Some(Started {
            motion,
            at: self.measurement.time,
            slower: 0.0,
        });
        Ok(())
    }

    /// A motion along a path, which breaks no limit.
    fn motion(&self, side: Side, path: Path, speed: Option<f64>) -> Result<Motion, Outcome> {
        let checked = || {
            let motion = Motion::new(path, self.shape, &self.limits, speed)?;
            motion.check(self.kinematics(side), self.spec().period())?;
            Ok(motion)
        };
        checked().map_err(|why| Outcome::Refused { side, why })
    }

    /// Whether a motion is still being followed.
    pub fn moving(&self, side: Side) -> bool {
        self.arms[side.index()].motion.is_some()
    }

    /// Calls a motion off: the endpoint slows down as fast as the limits allow.
    pub fn brake(&mut self, side: Side) {
        if let Some(motion) = self.braked(side) {
            self.arms[side.index()].motion = Some(Started {
                motion,
                at: self.measurement.time,
                slower: 0.0,
            });
        }
    }

    /// What is left of a motion that is called off now.
    fn braked(&self, side: Side) -> Option<Motion> {
        let started = self.arms[side.index()].motion.as_ref()?;
        let since = self.measurement.time - started.at;
        Some(started.motion.braked(since, &self.limits))
    }

    /// Ends a motion where it is. For those slow enough to stop at once.
    pub fn halt(&mut self, side: Side) {
        self.arms[side.index()].motion = None;
    }

    /// Follows a straight line to its end and waits until the axes have arrived.
    ///
    /// # Errors
    ///
    /// A fault, [`Outcome::Refused`], or [`Outcome::NotArrived`].
    pub fn line(&mut self, side: Side, to: Point<Macro>, speed: Option<f64>) -> Result<(), Halt> {
        self.start_line(side, to, speed)?;
        while self.moving(side) {
            self.cycle()?;
        }
        self.settle(side)?;
        Ok(())
    }

    fn settle(&mut self, side: Side) -> Result<(), Halt> {
        let mut arrival = Arrival::default();
        loop {
            self.cycle()?;
            if arrival.step(self, side) {
                return Ok(self.arrived(side)?);
            }
        }
    }

    /// Whether the axes of a side are where friction may hold them from their references, or at them.
    fn arrived(&self, side: Side) -> Result<(), Outcome> {
        for axis in Axis::ALL {
            let at = AxisName { side, axis };
            let counts = self.following_error(at).abs();
            if counts > LOST_COUNTS {
                return Err(Outcome::NotArrived { axis: at, counts });
            }
        }
        Ok(())
    }

    /// How far an axis is from its reference, encoder counts.
    fn following_error(&self, at: AxisName) -> i64 {
        let reference = self.arms[at.side.index()].references[at.axis.index()];
        reference.0 - self.encoder(at).0
    }

    /// Stops the machine: motors without voltage, laser off.
    pub fn stop(&mut self) {
        self.machine.stop();
    }

    /// Sets the reference of one axis alone, encoder counts from home. Ends any motion of that
    /// manipulator.
    pub fn reference(&mut self, at: AxisName, counts: Counts) {
        let arm = &mut self.arms[at.side.index()];
        arm.motion = None;
        arm.references[at.axis.index()] = counts;
    }

    /// Gives one axis another controller. Its state starts afresh.
    pub fn set_pid(&mut self, at: AxisName, pid: Pid) {
        let arm = &mut self.arms[at.side.index()];
        arm.pids[at.axis.index()] = pid;
        arm.states[at.axis.index()] = PidState::default();
    }

    /// Compensates the windup of one axis by this model from now on. Its state starts afresh.
    pub fn set_windup(&mut self, at: AxisName, windup: Windup) {
        let arm = &mut self.arms[at.side.index()];
        arm.windups[at.axis.index()] = windup;
        arm.windup_states[at.axis.index()] = WindupState::default();
        arm.windup[at.axis.index()] = 0.0;
    }

    /// Takes an axis from its servo and holds this voltage on its motor, from the next cycle on until
    /// it is given back.
    pub fn hold_voltage(&mut self, at: AxisName, volts: Volts) {
        self.arms[at.side.index()].held[at.axis.index()] = Some(volts);
    }

    /// Gives an axis back to its servo, whose state starts afresh, to hold it where its encoder is.
    pub fn close_loop(&mut self, at: AxisName) {
        let here = self.encoder(at);
        self.reference(at, here);
        let arm = &mut self.arms[at.side.index()];
        arm.held[at.axis.index()] = None;
        arm.states[at.axis.index()] = PidState::default();
    }

    /// Has the amplifier of an axis play a pulse from the start of the next cycle on.
    ///
    /// # Errors
    ///
    /// Why the amplifier cannot, by the datasheet; nothing is played then.
    pub fn pulse(&mut self, at: AxisName, pulse: Pulse) -> Result<(), Outcome> {
        pulse
            .check(self.spec().drive(at.axis))
            .map_err(|why| Outcome::Unplayable { at, why })?;
        self.command.pulses[at.side.index()][at.axis.index()] = Some(pulse);
        Ok(())
    }

    /// What is believed of pulses on a five-bar; `None` where no one has measured it.
    pub fn five_bar_pulses(&self) -> Option<ImpulseBelief> {
        self.five_bar_pulses.clone()
    }

    /// What the transmission of an axis holds back at this moment, by what is believed of it, radians
    /// of the output.
    pub fn windup(&self, at: AxisName) -> f64 {
        self.arms[at.side.index()].windup[at.axis.index()]
    }

    /// The encoder of an axis.
    pub fn encoder(&self, at: AxisName) -> Counts {
        self.measurement.encoders[at.side.index()][at.axis.index()]
    }

    /// The voltage that an axis was given in this cycle, volts.
    pub fn voltage(&self, at: AxisName) -> f64 {
        self.command.motors[at.side.index()][at.axis.index()].0
    }

    /// The probe at the output of an axis, metres from home; `None` on a rig without probes.
    pub fn probe(&self, at: AxisName) -> Option<f64> {
        self.measurement
            .probes
            .map(|probes| probes[at.side.index()][at.axis.index()])
    }

    /// Where the probes at the outputs see an endpoint; `None` on a rig without probes.
    pub fn probed_endpoint(&self, side: Side) -> Option<Point<Macro>> {
        let arm = self.spec().probe.as_ref()?.arm;
        let [a, b, z] = self.measurement.probes?[side.index()];
        self.arms[side.index()]
            .kinematics
            .endpoint_from_probes([a / arm, b / arm], z)
            .ok()
    }

    /// Displaces a tip so far in its manipulator's frame with the micro, held within its range.
    pub fn move_micro(&mut self, side: Side, to: Displacement) {
        self.playing.fine[side.index()] = None;
        let arm = &mut self.arms[side.index()];
        arm.micro = to;
        arm.micro_volts = None;
    }

    /// Gives the piezos of a micro these voltages, past every model, until it is moved again.
    pub fn micro_volts(&mut self, side: Side, volts: [Volts; MICRO_AXES]) {
        self.arms[side.index()].micro_volts = Some(volts);
    }

    /// Believes from now on that the piezos of a side make so much displacement in y for one in x.
    pub fn set_micro_ratio(&mut self, side: Side, ratio: f64) {
        if let Some(piezos) = &mut self.arms[side.index()].piezos {
            piezos.set_ratio(ratio);
        }
    }

    /// The displacement in y for one in x of a side's micro, as believed; `None` without a model.
    pub fn micro_ratio(&self, side: Side) -> Option<f64> {
        let piezos = self.arms[side.index()].piezos.as_ref()?;
        Some(piezos.ratio())
    }

    /// Learns what was seen of the piezos of a side, and makes use of it within so many seconds where that is worth it. The tip does
    /// not leave its place `at` by that (metres from its centre). Whether it does.
    pub fn learn_micro(&mut self, side: Side, told: &Told, at: Displacement, within: f64) -> bool {
        let cycles = (within * self.spec().servo.rate).round() as u32;
        self.arms[side.index()].learn(told, at, cycles)
    }

    /// How many times as far as is believed each piezo of a side goes, where that was learned and is made use of.
    pub fn learned_strokes(&self, side: Side) -> Option<[f64; MICRO_AXES]> {
        self.arms[side.index()].online.used()
    }

    /// The displacement commanded to a micro, metres.
    pub fn micro(&self, side: Side) -> Displacement {
        self.arms[side.index()].micro
    }

    /// The latest vision frame, if it came in this cycle.
    pub fn frame(&self) -> Option<VisionFrame> {
        self.measurement.vision
    }

    /// The light sample of this cycle, volts, if there is one.
    pub fn light(&self, channel: Channel) -> Option<f64> {
        let light = self.measurement.light?;
        self.count_reading(light.time);
        Some(light.volts[channel.index()].0)
    }

    fn count_reading(&self, time: f64) {
        let (count, last) = self.readings.get();
        if time > last {
            self.readings.set((count + 1, time));
        }
    }

    /// How many light samples have been asked for: of those that came, the ones that control looked
    /// at.
    pub fn readings(&self) -> u64 {
        self.readings.get().0
    }

    /// Cycles until the next light sample, volts.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn next_light(&mut self, channel: Channel) -> Result<f64, Fault> {
        loop {
            self.cycle()?;
            if let Some(volts) = self.light(channel) {
                return Ok(volts);
            }
        }
    }

    /// Mean and spread of the light over `seconds`.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn level(&mut self, channel: Channel, seconds: f64) -> Result<Level, Fault> {
        let n = (seconds * self.spec().photodiode.rate).round().max(2.0);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n as u64 {
            let volts = self.next_light(channel)?;
            sum += volts;
            squares += volts * volts;
        }
        Ok(Level::of_sums(n, sum, squares))
    }

    /// Cycles until a vision frame arrives that was exposed after this call.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn next_frame(&mut self) -> Result<VisionFrame, Fault> {
        let since = self.measurement.time;
        loop {
            self.cycle()?;
            if let Some(frame) = self.measurement.vision.filter(|frame| frame.time > since) {
                return Ok(frame);
            }
        }
    }
}
