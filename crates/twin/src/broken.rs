//! Faults that have been injected, and what becomes of the twin under them.

use super::Twin;
use super::faults::{Injection, Kind, Place};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, SIDES};
use pigtail_hal::{Axis, AxisName, Command, Fault, Measurement};

/// What has broken, beyond what its own part of the twin knows.
#[derive(Debug, Clone, Default)]
pub(super) struct Broken {
    /// Those that are yet to come, the next one last.
    pending: Vec<Injection>,
    encoders: Option<[[Reading; AXES]; SIDES]>,
    /// How much longer the servo stays away, cycles.
    late: u64,
    pub(super) laser_off: bool,
    pub(super) stop_pressed: bool,
}

/// What an encoder reads.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum Reading {
    #[default]
    Well,
    /// Zero until this time, seconds.
    Zero(f64),
    /// This for good, once it has been read.
    Stuck(Option<Counts>),
}

impl Broken {
    /// Whether nothing needs to be looked at in a cycle.
    #[inline]
    pub(super) fn is_well(&self) -> bool {
        self.pending.is_empty() && self.encoders.is_none() && self.late == 0
    }

    fn encoder(&mut self, at: AxisName) -> &mut Reading {
        let all = self.encoders.get_or_insert_default();
        &mut all[at.side.index()][at.axis.index()]
    }

    /// What the encoders read where they should read `counts`.
    fn read(&mut self, counts: &mut [[Counts; AXES]; SIDES], time: f64) {
        let Some(readings) = &mut self.encoders else {
            return;
        };
        for (reading, counts) in readings
            .as_flattened_mut()
            .iter_mut()
            .zip(counts.as_flattened_mut())
        {
            match reading {
                Reading::Well => {}
                Reading::Zero(until) if time <= *until => *counts = Counts(0),
                Reading::Zero(_) => *reading = Reading::Well,
                Reading::Stuck(at) => *counts = *at.get_or_insert(*counts),
            }
        }
    }
}

impl Twin {
    /// Will break at the times that these say. Not part of [`pigtail_hal::Machine`].
    pub fn inject(&mut self, injections: &[Injection]) {
        let pending = &mut self.broken.pending;
        pending.extend_from_slice(injections);
        pending.sort_by(|a, b| b.from.total_cmp(&a.from));
    }

    /// A cycle while something is about to break, or needs to be looked at.
    #[cold]
    pub(super) fn cycle_broken(&mut self, command: &Command) -> Result<Measurement, Fault> {
        // What a cycle measures is later than its start: a fault is seen from its own time on.
        let end = self.time() + self.spec.period();
        while let Some(next) = self.broken.pending.pop_if(|next| next.from <= end) {
            self.break_down(&next);
        }
        let mut measured = self.cycle(command)?;
        // Amplifiers hold what they were last told, for a while.
        let mut held = Command {
            fiber: Command::IDLE.fiber,
            pulses: Command::NO_PULSES,
            ..*command
        };
        let patience = (self.spec.servo.watchdog * self.spec.servo.rate) as u64;
        for cycle in 0..std::mem::take(&mut self.broken.late) {
            if cycle >= patience {
                held.motors = [[Volts(0.0); AXES]; SIDES];
            }
            measured = self.cycle(&held)?;
        }
        self.broken.read(&mut measured.encoders, measured.time);
        Ok(measured)
    }

    fn break_down(&mut self, injection: &Injection) {
        let fault = injection.fault;
        match (fault.kind, fault.place) {
            (Kind::EncoderDropout, Place::Axis(at)) => {
                *self.broken.encoder(at) = Reading::Zero(injection.from + fault.size);
            }
            (Kind::EncoderStuck, Place::Axis(at)) => {
                *self.broken.encoder(at) = Reading::Stuck(None);
            }
            (Kind::AmplifierSaturation, Place::Axis(at)) => {
                self.drives
                    .weaken(at.side.index(), at.axis.index(), fault.size);
            }
            (Kind::AmplifierDead, Place::Axis(at)) => {
                self.drives.weaken(at.side.index(), at.axis.index(), 0.0);
            }
            (Kind::BeltSlip, Place::Axis(at)) => {
                let by = fault.size / self.metres_per_radian(at);
                self.drives.slip(at.side.index(), at.axis.index(), by);
            }
            (Kind::Friction, Place::Axis(at)) => {
                self.drives
                    .scale_friction(at.side.index(), at.axis.index(), fault.size);
            }
            (Kind::PhotodiodeDead, Place::Photodiode(channel)) => {
                self.photodiodes.diode(channel.index()).dead = true;
            }
            (Kind::PhotodiodeSaturated, Place::Photodiode(channel)) => {
                self.photodiodes.diode(channel.index()).saturated = true;
            }
            (Kind::PhotodiodeHum, Place::Photodiode(channel)) => {
                self.photodiodes.diode(channel.index()).hum = fault.size;
            }
            (Kind::VisionWrong, Place::Direction(direction)) => {
                self.camera.shift[usize::from(direction != 0)] += fault.size;
            }
            (Kind::PiezoDepolarised, Place::Piezo(side, piezo)) => {
                self.manipulators[side.index()]
                    .micro
                    .weaken(piezo, fault.size);
            }
            (Kind::ServoOverrun, _) => {
                self.broken.late += (fault.size * self.spec.servo.rate).round() as u64;
            }
            (Kind::LaserOff, _) => self.broken.laser_off = true,
            (Kind::StopPressed, _) => self.broken.stop_pressed = true,
            // A kind never comes with another kind's place.
            _ => {}
        }
    }

    /// How far the endpoint goes for a radian of an output, about.
    fn metres_per_radian(&self, at: AxisName) -> f64 {
        let manipulator = &self.manipulators[at.side.index()];
        match at.axis {
            Axis::A | Axis::B => manipulator.five_bar.proximal(),
            Axis::Z => manipulator.screw.position(1.0),
        }
    }
}
