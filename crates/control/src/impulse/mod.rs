//! Impulse control (thesis 4.3): pulses of the amplifier move an output by far less than an encoder
//! count, and an external sensor at the output closes the loop.
//!
//! A pulse (4.7) pushes the motor against the transmission; what of that reaches the load depends on
//! what the transmission holds already. So each pulse begins with the transmission brought back to
//! zero torque, as well as the machine allows ([`Relax`]), and is judged when all has come to rest.
//!
//! - here: pulses, one at a time;
//! - [`experiment`]: what pulses do on a machine, found by playing them;
//! - [`belief`]: what of that is believed from then on; [`response`]: the same as a function, fixed
//!   or estimated while pulses are played;
//! - [`law`]: the loop.

pub mod belief;
pub mod experiment;
pub mod law;
pub mod response;

use crate::outcome::{Halt, Lack, Outcome};
use crate::station::{Station, VoltageMachine};
use pigtail_hal::pulse::HARMONICS;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::{Axis, AxisName, Pulse};
use serde::{Deserialize, Serialize};

/// A family of pulses: the amplitude `a_1` is chosen anew for each, the rest stays.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// The amplitudes `a_2`, `a_3`, `a_4` for a pulse forward, volts.
    pub fixed: [f64; HARMONICS - 1],
    /// Length `T`, seconds.
    pub period: f64,
}

impl Shape {
    /// The thesis's: `a_2` volts and nothing above.
    pub fn second_harmonic(a2: f64, period: f64) -> Self {
        Self {
            fixed: [a2, 0.0, 0.0],
            period,
        }
    }

    /// The same proportions with another second harmonic, volts.
    #[must_use]
    pub fn scaled(&self, a2: f64) -> Self {
        Self {
            fixed: self.fixed.map(|a| a / self.fixed[0] * a2),
            period: self.period,
        }
    }

    /// The pulse with `a_1` volts, forward where `forward`.
    pub fn pulse(&self, a1: f64, forward: bool) -> Pulse {
        let [a2, a3, a4] = self.fixed;
        let pulse = Pulse {
            amplitudes: [a1, a2, a3, a4].map(Volts),
            period: self.period,
        };
        if forward { pulse } else { pulse.reversed() }
    }
}

/// How a transmission is brought back to zero torque between pulses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Relax {
    /// Once, at the start, as by [`Self::Servo`]; after that it is left as the pulses leave it. For
    /// transmissions that wind up over so many counts that what pulses add does not matter.
    Start,
    /// The servo brings the motor to the count at which, by the sensor at the output, it and the
    /// output agree; then its voltage is cut. Knows the motor to a count.
    Servo,
    /// Pulses of the second harmonic alone, back and forth, that die away from `amplitude` volts:
    /// the motor slides all the time, so that its friction no longer keeps the transmission wound up,
    /// and comes to rest where that pulls nowhere. Needs no encoder, and a transmission that is stiff
    /// enough beside the motor's friction.
    Dither {
        /// Amplitude of the first, volts.
        amplitude: f64,
    },
}

impl Relax {
    /// The word for it in documents and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Servo => "servo",
            Self::Dither { .. } => "dither",
        }
    }
}

/// Pulses of a [`Relax::Dither`].
pub const DITHERS: u32 = 40;
/// Servo cycles that each of them lasts.
const DITHER_CYCLES: u32 = 2;

/// Longest time that a servo is given to come to a count, seconds.
const SERVO_SECONDS: f64 = 0.1;
/// Cycles for which a motor must be at a count to have come to rest there.
const STILL: u32 = 4;

/// An axis under impulse control.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Impulses {
    /// The axis.
    pub at: AxisName,
    /// Between pulses.
    pub relax: Relax,
    /// Time after a pulse in which everything comes to rest, seconds.
    pub rest: f64,
    /// Readings of the sensor at the output that make a measurement, one a servo cycle.
    pub readings: u32,
}

/// What a pulse did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// Displacement of the output once at rest, metres.
    pub displacement: f64,
    /// The same once the transmission has been brought back too.
    pub net: f64,
}

impl Impulses {
    /// Takes the axis from its servo: from now on nothing but pulses moves it.
    ///
    /// # Errors
    ///
    /// A fault, or [`Outcome::Lacking`] on a rig without a sensor at the output.
    pub fn begin(&self, station: &mut Station) -> Result<(), Halt> {
        station.hold_voltage(self.at, Volts(0.0));
        station.run(self.rest)?;
        match self.relax {
            Relax::Start => self.unwind(station),
            _ => self.relax(station),
        }
    }

    /// Where the output is by its sensor, metres from home: a mean of readings.
    ///
    /// # Errors
    ///
    /// As [`Self::begin`].
    pub fn measure(&self, station: &mut Station) -> Result<f64, Halt> {
        let mut sum = 0.0;
        for _ in 0..self.readings.max(1) {
            station.cycle()?;
            sum += station
                .probe(self.at)
                .ok_or(Outcome::Lacking(Lack::Sensor(self.at)))?;
        }
        Ok(sum / f64::from(self.readings.max(1)))
    }

    /// Plays a pulse and waits for its end and for rest.
    ///
    /// # Errors
    ///
    /// A fault, or [`Outcome::Unplayable`] for a pulse that the amplifier cannot play.
    pub fn play(&self, station: &mut Station, pulse: Pulse) -> Result<(), Halt> {
        station.pulse(self.at, pulse)?;
        station.run(pulse.period + self.rest)?;
        Ok(())
    }

    /// Plays a pulse between two measurements, and brings the transmission back.
    ///
    /// # Errors
    ///
    /// As [`Self::begin`] and [`Self::play`].
    pub fn respond(&self, station: &mut Station, pulse: Pulse) -> Result<Moved, Halt> {
        let before = self.measure(station)?;
        self.play(station, pulse)?;
        let displacement = self.measure(station)? - before;
        if self.relax == Relax::Start {
            let net = displacement;
            return Ok(Moved { displacement, net });
        }
        self.relax(station)?;
        let net = self.measure(station)? - before;
        Ok(Moved { displacement, net })
    }

    /// Brings the transmission back to zero torque.
    ///
    /// # Errors
    ///
    /// As [`Self::begin`] and [`Self::play`].
    pub fn relax(&self, station: &mut Station) -> Result<(), Halt> {
        match self.relax {
            Relax::Start => Ok(()),
            Relax::Dither { amplitude } => self.dither(station, amplitude),
            Relax::Servo => self.unwind(station),
        }
    }

    fn dither(&self, station: &mut Station, amplitude: f64) -> Result<(), Halt> {
        let period = f64::from(DITHER_CYCLES) * station.spec().period();
        for k in 0..DITHERS {
            let left = f64::from(DITHERS - k) / f64::from(DITHERS);
            let pulse = Pulse::impulse(0.0, amplitude * left, period);
            let back = if k % 2 == 0 { pulse } else { pulse.reversed() };
            station.pulse(self.at, back)?;
            for _ in 0..DITHER_CYCLES {
                station.cycle()?;
            }
        }
        station.run(0.25 * self.rest)?;
        Ok(())
    }

    fn unwind(&self, station: &mut Station) -> Result<(), Halt> {
        let output = self.measure(station)?;
        let wanted = counts_from_output(station, self.at, output)?;
        station.close_loop(self.at);
        station.reference(self.at, wanted);
        let end = station.time() + SERVO_SECONDS;
        let mut there = 0;
        while there < STILL && station.time() < end {
            station.cycle()?;
            there = if station.encoder(self.at) == wanted {
                there + 1
            } else {
                0
            };
        }
        station.hold_voltage(self.at, Volts(0.0));
        station.run(0.25 * self.rest)?;
        Ok(())
    }
}

/// The motor's count at which the transmission of an axis carries nothing while its output is at a
/// place, metres from home along its sensor.
fn counts_from_output(station: &Station, at: AxisName, output: f64) -> Result<Counts, Outcome> {
    let spec = station.spec();
    let angle = match at.axis {
        Axis::A | Axis::B => {
            let probe = spec.probe.as_ref();
            let arm = probe.map(|probe| probe.arm);
            let arm = arm.ok_or(Outcome::Lacking(Lack::Sensor(at)))?;
            output / arm
        }
        Axis::Z => station.kinematics(at.side).screw_angle(output),
    };
    let drive = spec.drive(at.axis);
    Ok(Counts(
        (angle * drive.gear_ratio / drive.count()).round() as i64
    ))
}
