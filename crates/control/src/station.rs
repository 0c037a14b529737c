//! The station owns the machine's time: every cycle it turns wanted motion into one command,
//! exchanges it for a measurement, and lets the procedure look at what came back.

mod arm;
mod axes;
mod bench;
mod handling;
mod motion;
mod past;
mod playing;
mod steady;
mod volts;

use self::arm::{Arm, Known, Started};
use self::bench::Follows;
pub use self::bench::{coarse, fine};
use self::past::{Past, Stand};
use self::playing::Playing;
pub use self::volts::VoltageMachine;
use crate::beam::{Askew, SpotSize};
use crate::calibration::Calibration;
use crate::cell::Layout;
use crate::gap_by_light::Spread;
use crate::impulse::belief::ImpulseBelief;
use crate::kinematics::Kinematics;
use crate::shaking::Measured;
use crate::trajectory::{Limits, Rates, Shape};
use crate::tuning::TUNING;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::{CHANNELS, SIDES};
use pigtail_hal::{
    Channel, Command, Fault, FiberHandling, Machine, Measurement, Side, Spec, VisionFrame,
};
use pigtail_model::frames::{Displacement, Macro, Point};
use pigtail_model::instructions::{Instructions, Work};
use std::cell::Cell;

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

/// What a station commands in a cycle.
struct Answer<'a, 'b>(&'a mut Station<'b>);

impl Work for Answer<'_, '_> {
    type Output = ();

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn work(self) {
        self.0.answer();
    }
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
    /// Of its cycle, seconds: the datasheet lies behind whatever stands around the machine.
    period: f64,
    limits: Limits,
    shape: Shape,
    command: Command,
    measurement: Measurement,
    past: Past,
    /// By when a micro has come to rest, seconds.
    settling: [f64; SIDES],
    /// Whether that was measured.
    settles: [bool; SIDES],
    /// What was measured of how tips shake.
    shaking: [Option<Measured>; SIDES],
    /// How light spreads over a gap in the scale of the micros, where it was measured.
    spread: [Option<Spread>; SIDES],
    /// How wide the spot of light at the chip is in the scale of the micros, where it was measured.
    spot: [Option<SpotSize>; SIDES],
    /// By what angles ways across go along the light, too.
    askew: [Askew; SIDES],
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
        let mut spec = machine.spec().clone();
        // As fast as it says, or as it was found to go.
        let gains = &calibration.gains;
        let as_found =
            |speed: f64, found: Option<f64>| found.map_or(speed, |found| speed.min(found));
        spec.five_bar.speed = as_found(spec.five_bar.speed, gains.five_bar.speed);
        spec.z_stage.speed = as_found(spec.z_stage.speed, gains.z.speed);
        let arms = Side::ALL.map(|side| Arm::new(&spec, calibration, side));
        let mut command = Command::IDLE;
        for (micro, arm) in command.micro.iter_mut().zip(&arms) {
            *micro = arm.kinematics.micro_volts(Displacement::ZERO);
        }
        let measurement = machine.exchange(&command)?;
        let micro = &calibration.geometry.micro;
        let usual = Follows {
            settling: micro.settling.unwrap_or(spec.micro.settling),
            bandwidth: None,
            lag: (micro.lag, micro.lag_deviation),
        };
        let follows = Side::ALL.map(|side| {
            let measured = calibration.dynamics.of(side);
            measured.map_or(usual, |measured| Follows {
                settling: measured.settling,
                bandwidth: Some(measured.bandwidth),
                lag: (measured.lag, measured.lag_deviation),
            })
        });
        let kinematics = [&arms[0].kinematics, &arms[1].kinematics];
        Ok(Self {
            period: spec.period(),
            playing: Playing::new(bench::caps(&spec, follows, kinematics)),
            past: Past::new(&spec),
            settling: follows.map(|micro| micro.settling),
            settles: Side::ALL.map(|side| calibration.dynamics.of(side).is_some()),
            shaking: Side::ALL.map(|side| calibration.shaking.of(side)),
            spread: Side::ALL.map(|side| calibration.spread.of(side)),
            spot: Side::ALL.map(|side| calibration.spot.of(side)),
            askew: Side::ALL.map(|side| calibration.geometry.of(side).askew(&spec)),
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
    pub fn micro_settling(&self, side: Side) -> f64 {
        self.settling[side.index()]
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
            askew: self.askew,
            hides: Side::ALL.map(|side| {
                let arm = &self.arms[side.index()];
                match &arm.piezos {
                    Some(piezos) if piezos.is_network() => TUNING.last.hidden_by_networks,
                    _ => TUNING.last.hidden,
                }
            }),
            settles: self.settles,
            follows: Side::ALL.map(|side| self.has_piezo_model(side)),
        }
    }

    /// Tells the observer of a trial of a search.
    pub fn tell_trial(&mut self, start: usize, trial: u32, best: f64) {
        self.observer.trial(start, trial, best);
    }

    /// One servo cycle.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn cycle(&mut self) -> Result<(), Fault> {
        Instructions::run_work(Answer(self));
        match self.machine.exchange(&self.command) {
            Ok(measurement) => self.measurement = measurement,
            Err(fault) => return Err(fault),
        }
        self.command.fiber = [None; SIDES];
        for pulse in self.command.pulses.as_flattened_mut() {
            *pulse = None;
        }
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

    /// What is commanded in a cycle, after what was measured in the one before.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn answer(&mut self) {
        let (time, period) = (self.measurement.time, self.period);
        self.play_fine(time + period);
        // One after the other, of both arms: what follows a motion waits for divisions and roots, and piezos do not.
        for (arm, encoders) in self.arms.iter_mut().zip(&self.measurement.encoders) {
            arm.wait(encoders, self.limits.z, period);
            arm.aim(time);
        }
        for (volts, arm) in self.command.micro.iter_mut().zip(&mut self.arms) {
            *volts = arm.piezos();
        }
        for (i, arm) in self.arms.iter_mut().enumerate() {
            arm.follow();
            self.command.motors[i] = arm.servo(&self.measurement.encoders[i]);
            self.command.references[i] = arm.servo_references();
        }
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
            Stand {
                encoders: self.measurement.encoders[side],
                windup: arm.windup,
                micro: arm.micro,
            }
        });
        self.past.note(stands);
    }

    /// Where an endpoint is by its encoders, less what the transmissions have wound up (2.23);
    /// where it is wanted if they make no sense.
    pub fn endpoint(&self, side: Side) -> Point<Macro> {
        let arm = &self.arms[side.index()];
        let now = (self.measurement.encoders[side.index()], arm.windup);
        let endpoint = Known::or(&arm.endpoint, &arm.kinematics, now, |outputs| {
            let mut turning = arm.turning.get();
            let endpoint = arm.kinematics.endpoint_from(&mut turning, outputs);
            arm.turning.set(turning);
            endpoint
        });
        endpoint.unwrap_or(arm.wanted)
    }

    /// Where an endpoint is wanted at this moment.
    pub fn wanted(&self, side: Side) -> Point<Macro> {
        self.arms[side.index()].wanted
    }

    /// Stops the machine: motors without voltage, laser off.
    pub fn stop(&mut self) {
        self.machine.stop();
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
