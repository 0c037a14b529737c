//! The loop of pulses (4.9)-(4.12): measured at rest, corrected by a pulse, measured again.

use super::Impulses;
use super::response::Response;
use crate::outcome::{Halt, Outcome};
use crate::station::Station;

/// What the loop is to do.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Settings {
    /// `k_c` of (4.10): share of the error that a pulse is to take away. The loop is stable between 0
    /// and 2 (4.12).
    pub gain: f64,
    /// Pulses at most.
    pub pulses: u32,
    /// Error that is small enough, metres.
    pub tolerance: f64,
    /// Whether to stop once the error is small enough, by what the sensor can tell.
    pub stop: bool,
}

/// The loop at one moment of rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Machine time, seconds.
    pub time: f64,
    /// The measured error `x_d - x`, metres.
    pub error: f64,
    /// The pulse that follows: `a_1` in volts, forward where positive; `None` after the last.
    pub pulse: Option<f64>,
    /// The displacement that is expected of it, metres.
    pub expected: f64,
}

/// How a loop went.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Its moments of rest; a pulse lies between each and the next.
    pub steps: Vec<Step>,
    /// Whether the last error was small enough, by the sensor.
    pub settled: bool,
}

impl Run {
    /// Pulses that were played.
    pub fn pulses(&self) -> usize {
        self.steps.len().saturating_sub(1)
    }
}

/// Share of the tolerance that the standard deviation of a measurement may be.
const CERTAIN: f64 = 0.1;

/// Standard deviations of a measurement by which an error must lie within the tolerance to be small
/// enough.
const SURE: f64 = 2.0;

/// Readings from which the sensor's noise is told.
const NOISE_READINGS: u32 = 50;

/// Most readings of a measurement.
const MOST_READINGS: u32 = 1000;

/// Standard deviation of one reading of the sensor at the output of an axis at rest, metres.
///
/// # Errors
///
/// A fault, or [`Outcome::Lacking`] without a sensor.
pub fn sensor_noise(station: &mut Station, impulses: &Impulses) -> Result<f64, Halt> {
    let single = Impulses {
        readings: 1,
        ..*impulses
    };
    let mut seen = Vec::with_capacity(NOISE_READINGS as usize);
    for _ in 0..NOISE_READINGS {
        seen.push(single.measure(station)?);
    }
    let n = f64::from(NOISE_READINGS);
    let mean = seen.iter().sum::<f64>() / n;
    let squares: f64 = seen.iter().map(|x| (x - mean).powi(2)).sum();
    Ok((squares / (n - 1.0)).sqrt())
}

/// Readings that make a measurement sure enough for a tolerance, by the noise of one.
pub fn readings_for(noise: f64, tolerance: f64) -> u32 {
    let n = (noise / (CERTAIN * tolerance)).powi(2).ceil();
    (n as u32).clamp(1, MOST_READINGS)
}

/// Brings the output of an axis to `target`, metres from home by its sensor. The axis is under
/// impulse control already ([`Impulses::begin`]); `noise` is that of one reading, metres.
///
/// # Errors
///
/// A fault, or [`Outcome::Unplayable`] for a pulse that the amplifier cannot play.
pub fn drive(
    station: &mut Station,
    impulses: &Impulses,
    shape: &super::Shape,
    response: &mut Response,
    (target, noise): (f64, f64),
    settings: &Settings,
) -> Result<Run, Halt> {
    let deviation = noise / f64::from(impulses.readings.max(1)).sqrt();
    let enough = (settings.tolerance - SURE * deviation).max(0.5 * settings.tolerance);
    let mut steps = Vec::with_capacity(settings.pulses as usize + 1);
    let mut at = impulses.measure(station)?;
    loop {
        let error = target - at;
        let time = station.time();
        let small = error.abs() <= enough;
        if steps.len() as u32 == settings.pulses || (small && settings.stop) {
            steps.push(Step {
                time,
                error,
                pulse: None,
                expected: 0.0,
            });
            return Ok(Run {
                steps,
                settled: small,
            });
        }
        let forward = error > 0.0;
        let sign = if forward { 1.0 } else { -1.0 };
        let choice = response.choose(error.abs(), settings.gain, forward);
        steps.push(Step {
            time,
            error,
            pulse: Some(sign * choice.a1),
            expected: sign * choice.expected,
        });
        impulses.play(station, shape.pulse(choice.a1, forward))?;
        impulses.relax(station)?;
        let now = impulses.measure(station)?;
        response.learn(choice.a1, forward, sign * (now - at));
        at = now;
    }
}

/// Checks the gain of (4.12).
///
/// # Errors
///
/// [`Outcome::UnstableGain`] where it is not between 0 and 2: the loop would not be stable.
pub fn check_gain(gain: f64) -> Result<(), Outcome> {
    if gain > 0.0 && gain < 2.0 {
        return Ok(());
    }
    Err(Outcome::UnstableGain(gain))
}
