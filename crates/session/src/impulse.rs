//! An axis brought to a target by pulses (thesis 4.3.2, 4.3.3).

use crate::job::{Ended, Job, Order, Work};
use crate::rig::Rig;
use pigtail_control::impulse::Impulses;
use pigtail_control::impulse::belief::ImpulseBelief;
use pigtail_control::impulse::law::{self, Run, Settings, readings_for, sensor_noise};
use pigtail_control::impulse::response::Response;
use pigtail_control::station::Station;
use pigtail_hal::{Axis, AxisName, Counts, Error};
use serde::{Deserialize, Serialize};

/// How a loop knows what pulses do.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// The thesis's parabola (4.8), fixed
    Parabola,
    /// The measured curve, fixed
    Curve,
    /// The measured curve, corrected by every pulse
    #[default]
    Recursive,
}

impl Estimator {
    /// Its name in options and documents.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parabola => Response::NAMES[0],
            Self::Curve => Response::NAMES[1],
            Self::Recursive => Response::NAMES[2],
        }
    }

    fn response(self, belief: &ImpulseBelief, noise: f64) -> Response {
        match self {
            Self::Parabola => Response::parabola(belief),
            Self::Curve => Response::curve(belief),
            Self::Recursive => Response::recursive(belief, noise),
        }
    }
}

/// The key of the table of an axis's pulses in a calibration.
pub fn kind_of(at: AxisName) -> &'static str {
    match at.axis {
        Axis::A | Axis::B => "five_bar",
        Axis::Z => "z",
    }
}

/// What is believed of the pulses of an axis.
///
/// # Errors
///
/// When the rig's calibration has nothing of it.
pub fn believed(rig: &Rig, at: AxisName) -> Result<&ImpulseBelief, Error> {
    let beliefs = &rig.calibration.impulse;
    let belief = match at.axis {
        Axis::A | Axis::B => &beliefs.five_bar,
        Axis::Z => &beliefs.z,
    };
    belief.as_ref().ok_or_else(|| {
        let key = format!("impulse.{}", kind_of(at));
        let message = format!(
            "is not there: no one has measured what pulses do; accepted is what `pigtail characterize \
             {at} impulse --write` writes"
        );
        Error::new(format!("{}/calibration.toml", rig.name), key, message)
    })
}

/// Bring an axis to a target by pulses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Impulse {
    /// The axis.
    pub at: AxisName,
    /// The way to go from where it stands, metres.
    pub target: f64,
    /// How it knows what pulses do.
    pub estimator: Estimator,
    /// Gain, pulses, tolerance, and whether to stop.
    pub settings: Settings,
    /// Time between pulses in which all comes to rest, seconds; `None` for what is believed enough.
    pub rest: Option<f64>,
    /// Another belief than the rig's.
    #[serde(skip)]
    pub belief: Option<ImpulseBelief>,
}

/// What came of it, by the sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Approached {
    /// Where it was to go, by the sensor, metres.
    pub target: f64,
    /// When it began, seconds of machine time.
    pub begun: f64,
    /// Each moment of rest, and whether the loop holds that it has settled.
    pub driven: Run,
    /// How it knew what pulses do.
    pub estimator: &'static str,
}

impl Job for Impulse {
    type Output = Approached;

    fn run(&self, work: &mut Work<'_>) -> Result<Approached, Ended> {
        let belief = match &self.belief {
            Some(belief) => belief,
            None => believed(work.rig(), self.at)?,
        };
        let mut station = work.station()?;
        let tolerance = self.settings.tolerance;
        let (impulses, noise) = taken_over(&mut station, belief, self.at, self.rest, tolerance)?;
        let start = impulses.measure(&mut station)?;
        let begun = station.time();
        let target = start + self.target;
        let deviation = (2.0 / f64::from(impulses.readings)).sqrt() * noise;
        let mut response = self.estimator.response(belief, deviation);
        let driven = law::drive(
            &mut station,
            &impulses,
            &belief.shape(),
            &mut response,
            (target, noise),
            &self.settings,
        )?;
        Ok(Approached {
            target,
            begun,
            driven,
            estimator: response.name(),
        })
    }

    fn order(&self) -> Order {
        match self.belief {
            None => Order::Impulse(self.clone()),
            Some(_) => Order::Other,
        }
    }
}

/// An axis that has been taken from its servo: how to play pulses on it, and the noise of a reading of
/// its sensor, metres.
///
/// # Errors
///
/// A fault.
pub fn taken_over(
    station: &mut Station,
    belief: &ImpulseBelief,
    at: AxisName,
    rest: Option<f64>,
    tolerance: f64,
) -> Result<(Impulses, f64), Ended> {
    /// The servo has moved the axis about before: its transmission is wound up.
    const COUNTS: i64 = 60;
    /// It comes to rest.
    const SECONDS: f64 = 0.15;
    let Counts(home) = station.encoder(at);
    for counts in [home + COUNTS, home] {
        station.reference(at, Counts(counts));
        station.run(SECONDS)?;
    }
    let impulses = Impulses {
        rest: rest.unwrap_or(belief.rest),
        ..belief.impulses(at, 25)
    };
    impulses.begin(station)?;
    let noise = sensor_noise(station, &impulses)?;
    let readings = readings_for(noise, tolerance);
    Ok((
        Impulses {
            readings,
            ..impulses
        },
        noise,
    ))
}
