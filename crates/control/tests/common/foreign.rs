//! A bench with a Gaussian beam, by nobody who knows the twin: one fine group, one meter.

use pigtail_hal::Fault;
use pigtail_hal::bench::{
    AxisCaps, Bench, Caps, ChannelCaps, Dither, Estimate, Event, Group, GroupCaps, Law, Light,
    Pose, Refused, Request, Stage, Ticket,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// What a bench is like.
#[derive(Debug, Clone)]
pub(crate) struct Make {
    /// Distance at which the light has fallen to 1/e, in x and in y, metres.
    pub(crate) width: [f64; 2],
    /// Samples a second.
    pub(crate) rate: f64,
    /// Fastest circle, hertz.
    pub(crate) bandwidth: f64,
    /// White noise of a sample, of the full light.
    pub(crate) white: f64,
    /// Noise that is a first-order process, of the full light; and its time constant, seconds.
    pub(crate) coloured: (f64, f64),
    /// Slow noise that multiplies the light, and its time constant.
    pub(crate) flicker: (f64, f64),
    /// Hum: amplitude of the full light, hertz.
    pub(crate) hum: (f64, f64),
    /// Least step of a sample, volts.
    pub(crate) step: f64,
    /// The lag that it says, and the one that it has, seconds.
    pub(crate) lag: (f64, f64),
    /// Time constant of the group, seconds: its pose is measured.
    pub(crate) follows: f64,
    /// Noise of its measured pose, metres; and its least step.
    pub(crate) sensor: f64,
    pub(crate) sensor_step: f64,
    /// How far the tip shakes, metres; as fast as a first-order process of a time constant.
    pub(crate) shakes: (f64, f64),
    /// The meter's own filter, seconds; part of what it says of its lag.
    pub(crate) filter: f64,
    /// The peak moves, metres a second.
    pub(crate) drift: f64,
    /// It walks at random, metres in the root of a second.
    pub(crate) walk: f64,
    /// It wanders by so much in each of [`OCTAVES`], metres: its spectrum is one over frequency.
    pub(crate) pink: f64,
    /// It sways by so much, metres, as a first-order process of a time constant, seconds.
    pub(crate) sways: (f64, f64),
    /// It comes to rest from so far, metres, within a time constant, seconds.
    pub(crate) settles: (f64, f64),
    /// It jumps by so much, metres, every so many seconds on average.
    pub(crate) jumps: (f64, f64),
}

/// Time constants of what makes one over frequency, seconds.
const OCTAVES: [f64; 6] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0];

impl Default for Make {
    fn default() -> Self {
        Self {
            width: [4.2e-6; 2],
            rate: 200.0,
            bandwidth: 20.0,
            white: 2e-3,
            coloured: (0.0, 1.0),
            flicker: (0.0, 1.0),
            hum: (0.0, 50.0),
            step: 1e-5,
            lag: (0.0, 0.0),
            follows: 0.0,
            sensor: 0.0,
            sensor_step: 0.0,
            shakes: (0.0, 1.0),
            filter: 0.0,
            drift: 0.0,
            walk: 0.0,
            pink: 0.0,
            sways: (0.0, 1.0),
            settles: (0.0, 1.0),
            jumps: (0.0, 1.0),
        }
    }
}

/// The usual make, changed.
fn with(change: impl Fn(&mut Make)) -> Make {
    let mut make = Make::default();
    change(&mut make);
    make
}

/// The makes that are tried.
pub(crate) fn makes() -> Vec<(&'static str, Make)> {
    vec![
        ("usual", Make::default()),
        ("no noise", with(|m| m.white = 0.0)),
        ("little noise", with(|m| m.white = 2e-4)),
        ("noisy", with(|m| m.white = 1e-2)),
        ("very noisy", with(|m| m.white = 4e-2)),
        ("1000 samples a second", with(|m| m.rate = 1000.0)),
        ("50 samples a second", with(|m| m.rate = 50.0)),
        ("circles of 2 Hz", with(|m| m.bandwidth = 2.0)),
        ("wider by a fifth", with(|m| m.width = [5.04e-6; 2])),
        ("narrower by a fifth", with(|m| m.width = [3.36e-6; 2])),
        ("oblong", with(|m| m.width = [4.6e-6, 3.8e-6])),
        ("coloured, 10 ms", with(|m| m.coloured = (2e-3, 0.01))),
        ("coloured, 50 ms", with(|m| m.coloured = (2e-3, 0.05))),
        ("coloured, 300 ms", with(|m| m.coloured = (5e-3, 0.3))),
        ("flicker, 100 ms", with(|m| m.flicker = (5e-3, 0.1))),
        ("flicker, 1 s", with(|m| m.flicker = (2e-2, 1.0))),
        ("hum", with(|m| m.hum = (5e-3, 47.3))),
        ("hum near the circle's rate", with(|m| m.hum = (5e-3, 19.0))),
        ("coarse steps", with(|m| m.step = 5e-3)),
        ("lag, told", with(|m| m.lag = (8e-3, 8e-3))),
        ("lag, told wrongly by 3 ms", with(|m| m.lag = (5e-3, 8e-3))),
        ("lag, not told, 6 ms", with(|m| m.lag = (0.0, 6e-3))),
        ("follows in 10 ms", with(|m| m.follows = 0.01)),
        ("sensor 20 nm", with(|m| m.sensor = 20e-9)),
        ("sensor's step 50 nm", with(|m| m.sensor_step = 50e-9)),
        ("shakes 20 nm, 5 ms", with(|m| m.shakes = (20e-9, 0.005))),
        ("shakes 20 nm, 200 ms", with(|m| m.shakes = (20e-9, 0.2))),
        (
            "filter of 10 ms",
            with(|m| {
                m.filter = 0.01;
                m.lag = (0.01, 0.0);
            }),
        ),
        ("drift 50 nm/s", with(|m| m.drift = 50e-9)),
    ]
}

/// More of them, whose tips and peaks wander otherwise.
pub(crate) fn wanderers() -> Vec<(&'static str, Make)> {
    vec![
        ("shakes 20 nm, 50 ms", with(|m| m.shakes = (20e-9, 0.05))),
        ("shakes 60 nm, 200 ms", with(|m| m.shakes = (60e-9, 0.2))),
        (
            "shakes 20 nm, 200 ms, noisy",
            with(|m| {
                m.shakes = (20e-9, 0.2);
                m.white = 1e-2;
            }),
        ),
        ("sways 20 nm, 1 s", with(|m| m.sways = (20e-9, 1.0))),
        ("walks 20 nm in 1 s", with(|m| m.walk = 20e-9)),
        ("walks 60 nm in 1 s", with(|m| m.walk = 60e-9)),
        (
            "walks 60 nm in 1 s, noisy",
            with(|m| {
                m.walk = 60e-9;
                m.white = 1e-2;
            }),
        ),
        ("walks 200 nm in 1 s", with(|m| m.walk = 200e-9)),
        ("1/f, 10 nm an octave", with(|m| m.pink = 10e-9)),
        ("1/f, 30 nm an octave", with(|m| m.pink = 30e-9)),
        ("rests, 300 nm, 300 ms", with(|m| m.settles = (300e-9, 0.3))),
        ("rests, 300 nm, 1 s", with(|m| m.settles = (300e-9, 1.0))),
        ("rests, 1 um, 1 s", with(|m| m.settles = (1e-6, 1.0))),
        ("rests, 1 um, 3 s", with(|m| m.settles = (1e-6, 3.0))),
        ("jumps 30 nm every 500 ms", with(|m| m.jumps = (30e-9, 0.5))),
        ("jumps 100 nm every 2 s", with(|m| m.jumps = (100e-9, 2.0))),
    ]
}

/// A first-order process.
#[derive(Debug, Default)]
struct Process(f64);

impl Process {
    fn step(&mut self, (deviation, constant): (f64, f64), dt: f64, rng: &mut Pcg64) -> f64 {
        let keeps = (-dt / constant).exp();
        self.0 = keeps * self.0 + (1.0 - keeps * keeps).sqrt() * normal(rng);
        deviation * self.0
    }
}

fn normal(rng: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (rng.random::<f64>().max(1e-300), rng.random());
    (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
}

/// A circle that is played: since when, what, its middle, radius and angle then.
#[derive(Debug, Clone)]
struct Playing {
    since: f64,
    ticket: Ticket,
    law: Dither,
    middle: [f64; 2],
    radius: f64,
    angle: f64,
}

impl Playing {
    fn at(&self, now: f64) -> ([f64; 2], f64, f64) {
        let after = now - self.since;
        let share = self.law.centre.share(after);
        let middle =
            [0, 1].map(|i| self.middle[i] + (self.law.centre.to[i] - self.middle[i]) * share);
        let radius =
            self.radius + (self.law.radius.to - self.radius) * self.law.radius.share(after);
        (middle, radius, self.angle + TAU * self.law.rate * after)
    }
}

/// Seconds of its own clock.
const TICK: f64 = 5e-4;

pub(crate) struct Foreign {
    make: Make,
    caps: Caps,
    peak: [f64; 2],
    rng: Pcg64,
    tick: u64,
    now: f64,
    laser: bool,
    playing: Option<Playing>,
    told: [f64; 2],
    at: [f64; 2],
    tip: Vec<[f64; 2]>,
    measured: Vec<[f64; 2]>,
    tickets: u64,
    done: Vec<Ticket>,
    filtered: f64,
    colour: Process,
    flicker: Process,
    shake: [Process; 2],
    pink: [[Process; 2]; OCTAVES.len()],
    sway: [Process; 2],
    /// How far the peak has gone, metres.
    gone: [f64; 2],
    swayed: [f64; 2],
    hum: f64,
    pub(crate) trace: Option<Vec<Dither>>,
}

impl Foreign {
    pub(crate) fn new(make: Make, seed: u64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed ^ 0x5eed_f0e1);
        let peak = [0; 2].map(|_| (10.0 * rng.random::<f64>() - 5.0) * 1e-6);
        let axis = |i: usize| {
            (i < 2).then_some(AxisCaps {
                range: (-15e-6, 15e-6),
                resolution: make.sensor_step.max(1e-9),
                repeatability: 5e-9,
                backlash: 0.0,
                speed: 1e-3,
            })
        };
        let caps = Caps {
            name: "foreign".to_owned(),
            arms: vec!["one".to_owned()],
            groups: vec![GroupCaps {
                name: "one.fine".to_owned(),
                arm: 0,
                stage: Stage::Fine,
                axes: std::array::from_fn(axis),
                settling: 0.01,
                bandwidth: make.bandwidth,
                lag: (make.lag.0, 1e-4),
                bends: true,
            }],
            channels: vec![ChannelCaps {
                name: "meter".to_owned(),
                rate: make.rate,
                resolution: make.step,
                full_scale: 10.0,
            }],
            least_power: 100,
            bond: 1.0,
            cycle: 0.0,
        };
        let hum = rng.random();
        let mut others = Pcg64::seed_from_u64(seed ^ 0x00c7_a7e5);
        let pink = OCTAVES.map(|_| [0; 2].map(|_| Process(normal(&mut others))));
        let sway = [0; 2].map(|_| Process(normal(&mut others)));
        Self {
            make,
            caps,
            peak,
            rng,
            tick: 0,
            now: 0.0,
            laser: true,
            playing: None,
            told: [0.0; 2],
            at: [0.0; 2],
            tip: vec![[0.0; 2]],
            measured: vec![[0.0; 2]],
            tickets: 0,
            done: Vec::new(),
            filtered: 0.0,
            colour: Process::default(),
            flicker: Process::default(),
            shake: [Process::default(), Process::default()],
            pink,
            sway,
            gone: [0.0; 2],
            swayed: [0.0; 2],
            hum,
            trace: None,
        }
    }

    /// The truth, now.
    pub(crate) fn peak(&self) -> [f64; 2] {
        let (from, within) = self.make.settles;
        let rests = from * (-self.now / within).exp();
        let still = [
            self.peak[0] + self.make.drift * self.now + rests,
            self.peak[1] - rests,
        ];
        [0, 1].map(|i| still[i] + self.gone[i] + self.swayed[i])
    }

    /// The peak goes on.
    fn wander(&mut self) {
        let Make {
            walk,
            pink,
            jumps,
            sways,
            ..
        } = self.make;
        for i in 0..2 {
            self.swayed[i] = 0.0;
            if sways.0 > 0.0 {
                self.swayed[i] += self.sway[i].step(sways, TICK, &mut self.rng);
            }
            if walk > 0.0 {
                self.gone[i] += walk * TICK.sqrt() * normal(&mut self.rng);
            }
            if jumps.0 > 0.0 && self.rng.random::<f64>() < TICK / jumps.1 {
                self.gone[i] += jumps.0 * normal(&mut self.rng);
            }
            if pink > 0.0 {
                for (constant, of) in OCTAVES.iter().zip(&mut self.pink) {
                    self.swayed[i] += of[i].step((pink, *constant), TICK, &mut self.rng);
                }
            }
        }
    }

    fn ticket(&mut self) -> Ticket {
        self.tickets += 1;
        Ticket(self.tickets)
    }

    fn dither(&mut self, law: &Law, ticket: Ticket) -> Result<(), Refused> {
        let Law::Dither(law) = law else {
            return Err(Refused::State("circles only".to_owned()));
        };
        if let Some(trace) = &mut self.trace {
            trace.push(*law);
        }
        let (middle, radius, angle) = match &self.playing {
            Some(playing) => playing.at(self.now),
            None => (self.told, 0.0, 0.0),
        };
        self.playing = Some(Playing {
            since: self.now,
            ticket,
            law: *law,
            middle,
            radius,
            angle,
        });
        Ok(())
    }

    fn go_on(&mut self) -> Option<Light> {
        self.tick += 1;
        self.now = self.tick as f64 * TICK;
        self.wander();
        if let Some(playing) = &self.playing {
            let (middle, radius, angle) = playing.at(self.now);
            self.told = [
                middle[0] + radius * angle.cos(),
                middle[1] + radius * angle.sin(),
            ];
            let within = playing.law.centre.within.max(playing.law.radius.within);
            if playing.law.radius.to == 0.0 && self.now - playing.since > within {
                self.done.push(playing.ticket);
                self.playing = None;
            }
        }
        let keeps = if self.make.follows > 0.0 {
            (-TICK / self.make.follows).exp()
        } else {
            0.0
        };
        for i in 0..2 {
            self.at[i] = self.told[i] + (self.at[i] - self.told[i]) * keeps;
        }
        let shaken =
            [0, 1].map(|i| self.at[i] + self.shake[i].step(self.make.shakes, TICK, &mut self.rng));
        self.tip.push(shaken);
        let step = self.make.sensor_step;
        let noise = self.make.sensor;
        let seen = self.at.map(|at| {
            let at = at + noise * normal(&mut self.rng);
            if step > 0.0 {
                (at / step).round() * step
            } else {
                at
            }
        });
        self.measured.push(seen);
        let lag = (self.make.lag.1 / TICK).round() as usize;
        let tip = self.tip[(self.tip.len() - 1).saturating_sub(lag)];
        let peak = self.peak();
        let off: f64 = (0..2)
            .map(|i| ((tip[i] - peak[i]) / self.make.width[i]).powi(2))
            .sum();
        let flicker = self.flicker.step(self.make.flicker, TICK, &mut self.rng);
        let light = if self.laser {
            (-off).exp() * (1.0 + flicker)
        } else {
            0.0
        };
        let keeps = if self.make.filter > 0.0 {
            (-TICK / self.make.filter).exp()
        } else {
            0.0
        };
        self.filtered = light + (self.filtered - light) * keeps;
        let colour = self.colour.step(self.make.coloured, TICK, &mut self.rng);
        let every = (1.0 / self.make.rate / TICK).round() as u64;
        if !self.tick.is_multiple_of(every) {
            return None;
        }
        let hum = self.make.hum.0 * (TAU * (self.make.hum.1 * self.now + self.hum)).sin();
        let volts = 0.01 + self.filtered + colour + hum + self.make.white * normal(&mut self.rng);
        let volts = (volts / self.make.step).round() * self.make.step;
        Some(Light {
            time: self.now,
            volts: vec![volts],
        })
    }
}

impl Bench for Foreign {
    fn caps(&self) -> &Caps {
        &self.caps
    }
    fn now(&self) -> f64 {
        self.now
    }
    fn play(&mut self, _: Group, law: Law) -> Result<Ticket, Refused> {
        let ticket = self.ticket();
        self.dither(&law, ticket).map(|()| ticket)
    }
    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        if self
            .playing
            .as_ref()
            .is_none_or(|playing| playing.ticket != ticket)
        {
            return Err(Refused::Ticket(ticket.0));
        }
        self.dither(&law, ticket).map(|()| self.now)
    }
    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        let Request::Laser(on) = what else {
            return Err(Refused::State("nobody is here to do that".to_owned()));
        };
        self.laser = on;
        let ticket = self.ticket();
        self.done.push(ticket);
        Ok(ticket)
    }
    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        loop {
            if !self.done.is_empty() {
                return Ok(Event::Done(self.done.remove(0)));
            }
            if by < (self.tick + 1) as f64 * TICK {
                self.now = self.now.max(by);
                return Ok(Event::Time);
            }
            if let Some(light) = self.go_on() {
                return Ok(Event::Light(light));
            }
        }
    }
    fn pose(&self, _: Group, at: f64) -> Option<Estimate> {
        let ticks = (at / TICK).max(0.0);
        let last = self.measured.len() - 1;
        let before = self.measured[(ticks as usize).min(last)];
        let after = self.measured[(ticks as usize + 1).min(last)];
        let share = ticks.fract();
        let at = [0, 1].map(|i| before[i] + (after[i] - before[i]) * share);
        Some(Estimate {
            pose: Pose::at(at[0], at[1], 0.0),
            measured: true,
        })
    }
    fn stop(&mut self) {}
}
