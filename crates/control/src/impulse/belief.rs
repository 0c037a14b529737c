//! What is believed of an axis's pulses: a part of `calibration.toml`.

use super::{Impulses, Relax, Shape};
use pigtail_hal::pulse::HARMONICS;
use pigtail_hal::{AxisName, quantity};
use schemars::JsonSchema;
use serde::Deserialize;

/// Pulses of each kind of axis where they have been measured.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImpulseBeliefs {
    /// Of a five-bar joint.
    pub five_bar: Option<ImpulseBelief>,
    /// Of a z-stage.
    pub z: Option<ImpulseBelief>,
}

/// Pulses of an axis as they were measured.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImpulseBelief {
    /// The voltage at which the motor breaks away: the unit of the thesis's amplitudes, volts.
    #[serde(with = "quantity::PositiveVoltage")]
    pub unit: f64,
    /// The harmonics beside the first, `a_2` to `a_4`, volts.
    pub fixed: [f64; HARMONICS - 1],
    /// Length of a pulse, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub period: f64,
    /// How the transmission is brought back between pulses.
    pub relax: RelaxName,
    /// Of a dither, its first amplitude, volts.
    #[serde(default, with = "quantity::NonNegativeVoltage")]
    pub dither: f64,
    /// Time in which the axis comes to rest, seconds.
    #[serde(with = "quantity::PositiveTime")]
    pub rest: f64,
    /// Displacement of the output over the first harmonic: pairs of volts and metres, both rising.
    pub curve: Vec<[f64; 2]>,
    /// Of a five-bar joint, how far from it that displacement was measured, metres; where the datasheet's
    /// probe is if not given.
    #[serde(default, with = "quantity::Optional::<quantity::PositiveLength>")]
    pub arm: Option<f64>,
    /// Spread of repeated displacements, rms, metres.
    #[serde(with = "quantity::NonNegativeLength")]
    pub scatter: f64,
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
}

/// A way to relax a transmission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum RelaxName {
    /// Once, at the start, as by `servo` ([`Relax::Start`]).
    Start,
    /// By the servo, to where motor and output agree ([`Relax::Servo`]).
    Servo,
    /// By pulses back and forth that die away ([`Relax::Dither`]).
    Dither,
}

impl ImpulseBelief {
    /// The shape of its pulses.
    pub fn shape(&self) -> Shape {
        Shape {
            fixed: self.fixed,
            period: self.period,
        }
    }

    /// How pulses are played on an axis of this kind, with so many readings a measurement.
    pub fn impulses(&self, at: AxisName, readings: u32) -> Impulses {
        Impulses {
            at,
            relax: match self.relax {
                RelaxName::Start => Relax::Start,
                RelaxName::Servo => Relax::Servo,
                RelaxName::Dither => Relax::Dither {
                    amplitude: self.dither,
                },
            },
            rest: self.rest,
            readings,
        }
    }

    /// That it can be believed: what is wrong otherwise.
    ///
    /// # Errors
    ///
    /// The key and a sentence.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        if !self.fixed.iter().all(|a| a.is_finite()) {
            return Err(("fixed", "accepted are finite voltages".to_owned()));
        }
        if self.relax == RelaxName::Dither && self.dither <= 0.0 {
            let message = "is missing; accepted is the voltage with which dithers begin";
            return Err(("dither", message.to_owned()));
        }
        let rising = self.curve.windows(2).all(|pair| {
            let ([a, d], [b, e]) = (pair[0], pair[1]);
            b > a && e >= d
        });
        let finite = self.curve.iter().flatten().all(|v| v.is_finite());
        let moves = self.curve.last().is_some_and(|last| last[1] > 0.0);
        if !(rising && finite && moves && self.curve.len() >= 3) {
            let message = "accepted are three pairs or more of volts and metres that both rise, and \
                           in the end move the output";
            return Err(("curve", message.to_owned()));
        }
        Ok(())
    }
}
