//! One manipulator as the station drives it: its motion, its servo, its models.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use crate::calibration::{Calibration, WindupBelief};
use crate::compensation::micro::MicroCompensation;
use crate::compensation::online::{OnLine, Told};
use crate::kinematics::Kinematics;
use crate::servo::{Pid, PidState};
use crate::trajectory::{Motion, Rates};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, MICRO_AXES};
use pigtail_hal::{Axis, AxisName, Side, Spec};
use pigtail_model::each::held;
use pigtail_model::fivebar::{Turning, Unreachable};
use pigtail_model::frames::{Displacement, Macro, Point};
use pigtail_model::windup::{Windup, WindupState};
use std::cell::Cell;
use std::f64::consts::TAU;

/// An axis so many counts behind its reference cannot follow it: amplifiers saturate far earlier.
const BEHIND_COUNTS: i64 = 100;

/// How much faster than its output a motor may run to make up for windup, of the output's speed: what the guard
/// takes for a speed of the axis is the motor's, and half as much again is too much for it...
const MOST_WINDUP: f64 = 0.45;

/// ...and always by this share of the axis's own speed...
const SLOW: f64 = 0.1;

/// ...or, once its output is where it is wanted, by this one, until no more is missing than its axis goes within so many cycles, which it is given at
/// once: of soft transmissions after a reversal up to 0.2 mm would else be asked for within a cycle, and motors run faster than their axes may.
const LAST: f64 = 0.5;
const AT_ONCE: f64 = 10.0;

/// A reference that stands for so many times as long as a step settles is that of an axis at rest...
const AT_REST: f64 = 2.0;

/// ...which takes so long where the datasheet does not say it, seconds.
const SETTLING: f64 = 0.1;

/// One manipulator as the station drives it.
#[derive(Debug, Clone)]
pub(super) struct Arm {
    pub(super) kinematics: Kinematics,
    /// Sines and cosines of its joints by the encoders.
    pub(super) turning: Cell<[Turning; 2]>,
    /// Where the endpoint was when it was last asked for, by these encoders and this windup.
    pub(super) endpoint: Cell<Option<Known>>,
    /// The same of one that was asked for of an earlier moment.
    pub(super) earlier: Cell<Option<Known>>,
    /// The same where they are wanted.
    wanted_turning: [Turning; 2],
    pub(super) windups: [Windup; AXES],
    pub(super) windup_states: [WindupState; AXES],
    /// What the transmissions hold back by these at this moment, radians of the outputs.
    pub(super) windup: [f64; AXES],
    /// Where the outputs are wanted, radians, as far as they have been wanted anywhere.
    outputs: [f64; AXES],
    /// By how much a motor may at any time run before or after its output to make up for windup, radians of the
    /// output a cycle.
    slow: [f64; AXES],
    /// Voltages that an experiment holds on the motors, past the servo.
    pub(super) held: [Option<Volts>; AXES],
    pub(super) pids: [Pid; AXES],
    pub(super) states: [PidState; AXES],
    pub(super) references: [Counts; AXES],
    /// Where the endpoint is wanted at this moment.
    pub(super) wanted: Point<Macro>,
    pub(super) motion: Option<Started>,
    aim: Option<Aim>,
    pub(super) micro: Displacement,
    pub(super) piezos: Option<MicroCompensation>,
    /// What was learned of them since.
    pub(super) online: OnLine,
    /// Voltages that an experiment gives the piezos, past every model.
    pub(super) micro_volts: Option<[Volts; MICRO_AXES]>,
    /// Whether the holder carries a fiber.
    pub(super) loaded: bool,
}

/// Where an endpoint is by its encoders and by what its transmissions hold back: asked for again and again of a manipulator that stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    encoders: [Counts; AXES],
    /// Radians of the outputs.
    windup: [f64; AXES],
    endpoint: Point<Macro>,
}

impl Known {
    /// What `last` was, if it still is so, or what is worked out of angles of the outputs (radians); `None` where no mechanism has these.
    #[inline(always)]
    pub(super) fn or(
        last: &Cell<Option<Self>>,
        kinematics: &Kinematics,
        (encoders, windup): ([Counts; AXES], [f64; AXES]),
        work: impl FnOnce([f64; AXES]) -> Result<Point<Macro>, Unreachable>,
    ) -> Option<Point<Macro>> {
        if let Some(last) = last.get()
            && last.encoders == encoders
            && last.windup == windup
        {
            return Some(last.endpoint);
        }
        let endpoint = work(kinematics.outputs_of(&encoders, &windup)).ok()?;
        last.set(Some(Self {
            encoders,
            windup,
            endpoint,
        }));
        Some(endpoint)
    }
}

/// Where a motion has come to at this moment.
#[derive(Debug, Clone, Copy)]
struct Aim {
    /// Where the outputs are wanted, radians; `None` where no mechanism has the endpoint there.
    outputs: Option<[f64; AXES]>,
    /// Whether that is its end.
    arrived: bool,
}

/// A motion that is being followed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Started {
    pub(super) motion: Motion,
    /// Machine time at its start, seconds; later by all that it has waited.
    pub(super) at: f64,
    /// By what share it passes more slowly than planned, since z does not follow.
    pub(super) slower: f64,
}

impl Arm {
    /// A manipulator at home, as the calibration believes it to be.
    pub(super) fn new(spec: &Spec, calibration: &Calibration, side: Side) -> Self {
        let period = spec.period();
        Self {
            kinematics: Kinematics::new(spec, calibration, side),
            turning: Cell::default(),
            endpoint: Cell::new(None),
            earlier: Cell::new(None),
            wanted_turning: Default::default(),
            windups: Axis::ALL.map(|axis| {
                let belief = calibration.windup.of(AxisName::new(side, axis));
                belief.map_or(Windup::None, WindupBelief::windup)
            }),
            windup_states: [WindupState::default(); AXES],
            windup: [0.0; AXES],
            outputs: [0.0; AXES],
            slow: Axis::ALL.map(|axis| {
                let fast = match axis {
                    Axis::A | Axis::B => {
                        spec.five_bar.speed / calibration.geometry.five_bar.proximal
                    }
                    Axis::Z => TAU * spec.z_stage.speed / calibration.geometry.z.lead,
                };
                SLOW * fast * period
            }),
            held: [None; AXES],
            pids: Axis::ALL.map(|axis| {
                let gains = match axis {
                    Axis::A | Axis::B => &calibration.gains.five_bar,
                    Axis::Z => &calibration.gains.z,
                };
                let drive = spec.drive(axis);
                let settling = drive.step.map_or(SETTLING, |step| step.settling);
                let pid = Pid::new(gains, drive.voltage, period).gentle();
                pid.holding_after(AT_REST * settling)
            }),
            states: [PidState::default(); AXES],
            references: [Counts(0); AXES],
            wanted: Point::ORIGIN,
            motion: None,
            aim: None,
            micro: Displacement::ZERO,
            piezos: calibration
                .hysteresis
                .of(side)
                .map(|model| MicroCompensation::new(model, spec)),
            online: OnLine::default(),
            micro_volts: None,
            loaded: false,
        }
    }

    /// The motors' voltages for this cycle.
    #[inline(always)]
    pub(super) fn servo(&mut self, measured: &[Counts; AXES]) -> [Volts; AXES] {
        let mut voltages = [Volts(0.0); AXES];
        for (i, voltage) in voltages.iter_mut().enumerate() {
            *voltage = match self.held[i] {
                Some(volts) => volts,
                None => self.pids[i].voltage(&mut self.states[i], self.references[i], measured[i]),
            };
        }
        voltages
    }

    /// What the servo holds the axes to in this cycle.
    #[inline(always)]
    pub(super) fn servo_references(&self) -> [Option<Counts>; AXES] {
        let mut references = [None; AXES];
        for (i, reference) in references.iter_mut().enumerate() {
            *reference = self.held[i].is_none().then_some(self.references[i]);
        }
        references
    }

    /// The piezos' voltages for this cycle.
    #[inline(always)]
    pub(super) fn piezos(&mut self) -> [Volts; MICRO_AXES] {
        self.online.pass();
        let asked = self.asked(self.micro);
        match (&mut self.piezos, self.micro_volts) {
            (None, None) => self.kinematics.piezo_volts(asked),
            (None, Some(volts)) => volts,
            (Some(model), None) => model.next_along(asked),
            (Some(model), Some(volts)) => {
                model.follow(volts);
                volts
            }
        }
    }

    /// How far each piezo has to go, metres, to displace the tip so far.
    #[inline(always)]
    fn along(&self, by: Displacement) -> [f64; MICRO_AXES] {
        match &self.piezos {
            Some(model) => model.along(by),
            None => self.kinematics.along_piezos(by),
        }
    }

    /// What its models are to be asked for then, by what was learned of the piezos.
    #[inline(always)]
    fn asked(&self, by: Displacement) -> [f64; MICRO_AXES] {
        self.online.asked(self.along(by))
    }

    /// Whether the micro can displace the tip so far, as far as is known of its piezos.
    pub(super) fn micro_reaches(&self, by: Displacement) -> bool {
        let along = self.kinematics.along_piezos(by);
        self.kinematics.piezos_reach(self.online.asked(along))
    }

    /// Learns what was seen of the piezos, and makes use of it within so many cycles where that is worth it; the tip does not leave
    /// its place `at` by that. Whether it does.
    pub(super) fn learn(&mut self, told: &Told, at: Displacement, cycles: u32) -> bool {
        self.online.learn(told);
        let place = self.along(at);
        self.online.make_use(place, cycles)
    }

    /// Lets a motion pass more slowly while z stays far behind it: its motor gives all it can, and what
    /// the datasheet promises is more. The joints' motors have more in hand than their endpoint needs.
    #[inline(always)]
    pub(super) fn wait(&mut self, measured: &[Counts; AXES], z: Rates, period: f64) {
        let Some(started) = &mut self.motion else {
            return;
        };
        let axis = Axis::Z.index();
        let behind = (self.references[axis].0 - measured[axis].0).abs() - BEHIND_COUNTS;
        let wanted = (behind as f64 / (2 * BEHIND_COUNTS) as f64).clamp(0.0, 1.0);
        // No faster than z could slow down from its full speed by itself.
        let step = z.acceleration * period / z.speed;
        started.slower += held(wanted - started.slower, -step, step);
        started.at += started.slower * period;
    }

    /// Where a motion wants the endpoint at this moment, and the outputs for it.
    #[inline(always)]
    pub(super) fn aim(&mut self, time: f64) {
        let Some(Started { motion, at, .. }) = &self.motion else {
            return;
        };
        let elapsed = time - at;
        self.wanted = motion.at(elapsed);
        let turning = &mut self.wanted_turning;
        self.aim = Some(Aim {
            outputs: self.kinematics.outputs_from(turning, self.wanted).ok(),
            arrived: elapsed >= motion.duration(),
        });
    }

    /// Sets the references for what was [aimed](Self::aim) at.
    #[inline(always)]
    pub(super) fn follow(&mut self) {
        let Some(Aim { outputs, arrived }) = self.aim.take() else {
            return;
        };
        let mut over = arrived;
        // The motion lies inside the workspace, which was checked to be reachable; were it not,
        // holding is the answer.
        if let Some(outputs) = outputs {
            for (i, output) in outputs.into_iter().enumerate() {
                // (2.22): the input that is needed for this output.
                let windup = self.windups[i].next(&mut self.windup_states[i], output);
                // Right after a reversal at speed a motor would have to run much faster than its output: no
                // faster than its axis may.
                let way = (output - self.outputs[i]).abs();
                let by = windup - self.windup[i];
                // What its axis goes within a cycle.
                let cycle = self.slow[i] / SLOW;
                let most = if !arrived {
                    (MOST_WINDUP * way).max(self.slow[i])
                } else if by.abs() > AT_ONCE * cycle {
                    LAST * cycle
                } else {
                    by.abs()
                };
                self.windup[i] += held(by, -most, most);
                over &= by.abs() <= most;
                self.outputs[i] = output;
                self.references[i] = self.kinematics.counts(i, output + self.windup[i]);
            }
        }
        if over {
            self.motion = None;
        }
    }
}
