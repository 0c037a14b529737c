//! What stands between the truth and a measurement: bandwidth, noise, quantisation, delay.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::light::FiberInHolder;
use super::plant::{CameraPlant, Light, uniform};
use pigtail_hal::measurement::{LightSample, TipFix, VisionFrame};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{CHANNELS, PhotodiodeSpec, SIDES, Spec, VisionSpec};
use pigtail_model::each::held;
use pigtail_model::frames::{Chip, Point};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use std::collections::VecDeque;

/// A draw from the standard normal distribution.
pub(super) fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// An encoder: `floor(angle / count + 1/2)`.
pub(super) fn encode(angle: f64, counts_per_radian: f64) -> Counts {
    // The method `floor` is a call into the C library on most targets.
    let counts = angle * counts_per_radian + 0.5;
    let truncated = counts as i64;
    Counts(truncated - i64::from(truncated as f64 > counts))
}

/// The whole number nearest to one that is not negative, and the greater one of two.
pub(super) fn nearest(number: f64) -> f64 {
    // The method `round` is a call into the C library on most targets.
    (number + 0.5) as i64 as f64
}

/// The photodiodes, their amplifiers and their A/D converter.
#[derive(Debug, Clone)]
pub(super) struct Photodiodes {
    /// Share of the old signal that is left after one servo cycle.
    decay: f64,
    noise: f64,
    offset: f64,
    step: f64,
    codes: f64,
    every: u64,
    filtered: [f64; CHANNELS],
    /// What the offset wanders by from one sample to the next.
    drift: Wander,
    /// Room light, volts.
    stray: f64,
    /// What has happened to each.
    broken: [BrokenDiode; CHANNELS],
    is_broken: bool,
}

/// What can have happened to a photodiode.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct BrokenDiode {
    /// It sees nothing.
    pub(super) dead: bool,
    /// It reads the end of its range.
    pub(super) saturated: bool,
    /// Amplitude of the mains on it, volts.
    pub(super) hum: f64,
}

/// Frequency of the mains, hertz.
const MAINS: f64 = 50.0;

/// A slow wander around zero: an Ornstein-Uhlenbeck process.
#[derive(Debug, Clone)]
struct Wander {
    decay: f64,
    kick: f64,
    at: [f64; CHANNELS],
}

/// Time in which an offset has wandered, seconds.
const DRIFT: f64 = 5.0;

/// Depth and frequency (hertz) of the flicker of room light: lamps on 50 Hz mains.
const FLICKER: (f64, f64) = (0.3, 100.0);

impl Photodiodes {
    pub(super) fn new(spec: &Spec, light: &Light) -> Self {
        let PhotodiodeSpec {
            bandwidth, bits, ..
        } = spec.photodiode;
        Self {
            decay: (-std::f64::consts::TAU * bandwidth * spec.period()).exp(),
            noise: light.noise,
            offset: light.offset,
            drift: Wander::new(light.drift, 1.0 / (DRIFT * spec.photodiode.rate)),
            stray: light.stray,
            step: spec.photodiode.step(),
            codes: f64::from((1_u32 << bits) - 1),
            every: (spec.servo.rate / spec.photodiode.rate).round() as u64,
            filtered: [0.0; CHANNELS],
            broken: [BrokenDiode::default(); CHANNELS],
            is_broken: false,
        }
    }

    /// A photodiode to break.
    pub(super) fn diode(&mut self, channel: usize) -> &mut BrokenDiode {
        self.is_broken = true;
        &mut self.broken[channel]
    }

    /// Lets the signals act for one servo cycle, and samples if it is time to.
    #[inline(always)]
    pub(super) fn cycle(
        &mut self,
        signals: &[f64; CHANNELS],
        cycle: u64,
        time: f64,
        rng: &mut impl Rng,
    ) -> Option<LightSample> {
        let (depth, frequency) = FLICKER;
        let stray = if self.stray > 0.0 {
            self.stray * (1.0 + depth * (std::f64::consts::TAU * frequency * time).cos())
        } else {
            0.0
        };
        for ((filtered, signal), broken) in self.filtered.iter_mut().zip(signals).zip(&self.broken)
        {
            let mut signal = signal + stray;
            if self.is_broken && *broken != BrokenDiode::default() {
                signal = broken.signal(signal, time);
            }
            *filtered = signal + self.decay * (*filtered - signal);
        }
        if !cycle.is_multiple_of(self.every) {
            return None;
        }
        self.drift.step(rng);
        let mut volts = [Volts(0.0); CHANNELS];
        for (i, volts) in volts.iter_mut().enumerate() {
            let offset = self.offset + self.drift.at[i];
            if self.broken[i].saturated {
                *volts = Volts(self.codes * self.step);
                continue;
            }
            let code = (self.filtered[i] + offset + self.noise * normal(rng)) / self.step;
            *volts = Volts(nearest(held(code, 0.0, self.codes)) * self.step);
        }
        Some(LightSample { time, volts })
    }
}

impl BrokenDiode {
    // Were it inlined, its sine would be worked out in every cycle, broken or not.
    #[cold]
    #[inline(never)]
    fn signal(&self, signal: f64, time: f64) -> f64 {
        let light = if self.dead { 0.0 } else { signal };
        light + self.hum * (std::f64::consts::TAU * MAINS * time).sin()
    }
}

impl Wander {
    /// Of a standard deviation, by a share of its memory a step.
    fn new(rms: f64, share: f64) -> Self {
        let decay = (-share).exp();
        Self {
            decay,
            kick: rms * (1.0 - decay * decay).sqrt(),
            at: [0.0; CHANNELS],
        }
    }

    /// Random numbers are drawn only where there is a drift.
    fn step(&mut self, rng: &mut impl Rng) {
        if self.kick > 0.0 {
            for at in &mut self.at {
                *at = self.decay * *at + self.kick * normal(rng);
            }
        }
    }
}

/// The camera: independent noise a frame, a fixed error a fiber, and a delay.
#[derive(Debug, Clone)]
pub(super) struct Camera {
    every: u64,
    delay: u64,
    sigma: f64,
    /// What the camera itself says of its noise.
    stated: f64,
    bounds: [f64; 2],
    /// What a metre from a port is seen too long, x and z.
    scale: [f64; 2],
    /// How far all tips are seen from where they are, beside all that, x and z, metres.
    pub(super) shift: [f64; 2],
    /// Frames on their way, the next one first.
    pending: VecDeque<(u64, VisionFrame)>,
}

/// The fixed error of the camera for one fiber, x and z, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bias([f64; 2]);

/// A tip before the camera, and the port that it is seen against.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub(super) tip: Point<Chip>,
    pub(super) port: Point<Chip>,
    pub(super) bias: Bias,
}

impl Camera {
    pub(super) fn new(spec: &Spec, plant: &CameraPlant) -> Self {
        let VisionSpec {
            rate,
            latency,
            sigma,
            accuracy_x,
            accuracy_z,
            ..
        } = spec.vision;
        let every = (spec.servo.rate / rate).round() as u64;
        Self {
            every,
            delay: (latency * plant.latency * spec.servo.rate).round() as u64,
            sigma: sigma * plant.noise,
            stated: sigma,
            bounds: [plant.error[0] * accuracy_x, plant.error[1] * accuracy_z],
            scale: plant.scale,
            shift: plant.bias,
            pending: VecDeque::new(),
        }
    }

    pub(super) fn draw_bias(&self, rng: &mut impl RngExt) -> Bias {
        Bias(self.bounds.map(|bound| uniform(rng, bound)))
    }

    fn fix(&self, seen: Seen, rng: &mut impl Rng) -> TipFix {
        let Seen {
            tip,
            port,
            bias: Bias([x, z]),
        } = seen;
        let [sx, sz] = self.scale;
        TipFix {
            x: tip.x + sx * (tip.x - port.x) + x + self.shift[0] + self.sigma * normal(rng),
            z: tip.z + sz * (tip.z - port.z) + z + self.shift[1] + self.sigma * normal(rng),
            sigma: self.stated,
        }
    }

    /// Whether it is time to expose a frame.
    pub(super) fn exposes(&self, cycle: u64) -> bool {
        cycle.is_multiple_of(self.every)
    }

    /// Exposes a frame of what is seen, where it is time to, and returns the one whose delay has passed.
    #[inline(always)]
    pub(super) fn cycle(
        &mut self,
        seen: Option<([Option<Seen>; SIDES], Seen)>,
        cycle: u64,
        time: f64,
        rng: &mut impl Rng,
    ) -> Option<VisionFrame> {
        let due = self.pending.front().is_some_and(|(due, _)| *due <= cycle);
        // Of a hundred cycles two.
        if !due && seen.is_none() {
            return None;
        }
        self.look(seen, cycle, time, rng)
    }

    #[inline(never)]
    fn look(
        &mut self,
        seen: Option<([Option<Seen>; SIDES], Seen)>,
        cycle: u64,
        time: f64,
        rng: &mut impl Rng,
    ) -> Option<VisionFrame> {
        let due = self.pending.front().is_some_and(|(due, _)| *due <= cycle);
        let ready = if due { self.pending.pop_front() } else { None };
        if let Some((fibers, sensing)) = seen {
            let frame = VisionFrame {
                time,
                fiber: fibers.map(|seen| seen.map(|seen| self.fix(seen, rng))),
                sensing: self.fix(sensing, rng),
            };
            self.pending.push_back((cycle + self.delay, frame));
        }
        ready.map(|(_, frame)| frame)
    }
}

/// A fiber that the holder carries, and how the camera errs about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Held {
    pub(super) port: usize,
    pub(super) fiber: FiberInHolder,
    pub(super) bias: Bias,
}
