//! Both micros by the camera alone: without light, wherever their tips stand, in minutes.
//!
//! One piezo of each micro after the other follows a program of turns, on both sides at once: every frame shows
//! both tips. The camera sees x; what a displacement in x makes of y, light must tell, and the macro be the measure
//! ([`measure_ratios`](crate::fast::measure_ratios)). A frame is ten times noisier than light, but there are thousands, and
//! nothing has to stand where it stood: a minute's warmth is no more than a straight line, which is taken out.

use super::blocks::{Blocks, fitted};
use super::{Series, WAYS, no_beam, share_in_x, ways};
use crate::compensation::hysteresis::{Model, Rbf, Record, predict};
use crate::compensation::micro::MicroModel;
use crate::outcome::{Halt, Outcome};
use crate::station::Station;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::{MICRO_AXES, SIDES};
use pigtail_hal::{FiberHandling, Side};
use pigtail_model::frames::Point;
use pigtail_numerics::line::Line;
use pigtail_numerics::signal::rms;
use std::ops::Range;

/// How often the model and what drifts beside it improve each other.
const ROUNDS: usize = 4;

/// How long the micros come to rest in their middle, seconds: the start creeps least.
const REST: f64 = 1.0;

/// Samples in which a piezo was driven: its slow ways, and all others.
type Driven = [Range<usize>; 2];

/// A piezo as the camera saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// The model of it that remembers.
    pub model: Model,
    /// What the thesis's model is trained with: the slow ways forward from the bottom and back, as the model that remembers has them. A
    /// frame is known to a hundredth of the range; networks, which have ten times as many weights, would learn its noise.
    pub ways: Record,
    /// Root mean square of what that leaves of the frames, metres along the piezo: noise of the camera, above all.
    pub residual: f64,
    /// How well the model is known by that many frames, if their noise is independent: one standard deviation, metres.
    pub known: f64,
    /// How fast the tip drifted meanwhile, m/s along the piezo.
    pub drift: f64,
}

/// A micro as the camera saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenMicro {
    /// Its piezos.
    pub piezos: [Seen; MICRO_AXES],
}

impl SeenMicro {
    /// The model of both that remembers, with a displacement in y for one in x.
    pub fn memory(&self, ratio: f64) -> MicroModel {
        MicroModel {
            piezos: self.piezos.each_ref().map(|seen| seen.model.clone()),
            ratio,
        }
    }

    /// The thesis's networks of the same frames.
    ///
    /// # Errors
    ///
    /// [`Outcome::NoModel`] where what was seen has no way forward and back.
    pub fn rbf(&self, ratio: f64) -> Result<MicroModel, Outcome> {
        let trained = |piezo: usize| {
            let networks = Rbf::train(&self.piezos[piezo].ways);
            networks.map(Model::Rbf).map_err(|why| Outcome::NoModel {
                piezo: Some(piezo),
                why,
            })
        };
        Ok(MicroModel {
            piezos: [trained(0)?, trained(1)?],
            ratio,
        })
    }
}

/// Identifies the piezos of both micros, indexed by side. Believes no model of them, and leaves none at work.
///
/// # Errors
///
/// A fault; [`Outcome::NoModel`] where what was seen is no piezo's.
pub fn by_camera(station: &mut Station) -> Result<[SeenMicro; SIDES], Halt> {
    station.laser(false);
    // On the left there is no tip to be seen without a fiber.
    station.handle_fiber(Side::Left, FiberHandling::Load(0))?;
    let voltage = station.spec().micro.voltage;
    let middle = 0.5 * voltage;
    let mut series = [Series::default(), Series::default()];
    let mut driven: Vec<Driven> = Vec::with_capacity(MICRO_AXES);
    for piezo in 0..MICRO_AXES {
        hold(station, &mut series, REST, |_| [middle; MICRO_AXES])?;
        let mut ends = [series[0].time.len(); 1 + WAYS];
        for (path, end) in ways(voltage).iter().zip(1..) {
            hold(station, &mut series, path.duration(), |time| {
                let mut volts = [middle; MICRO_AXES];
                volts[piezo] = path.at(time);
                volts
            })?;
            ends[end] = series[0].time.len();
        }
        // The slow ways come first.
        driven.push([ends[0]..ends[1], ends[1]..ends[WAYS]]);
    }
    hold(station, &mut series, REST, |_| [middle; MICRO_AXES])?;
    station.handle_fiber(Side::Left, FiberHandling::Unload)?;
    let of = |side: Side| -> Result<SeenMicro, Outcome> {
        let series = &series[side.index()];
        let first = learn(station, series, &driven[0], 0, None)?;
        // The first one goes on to creep while the second is driven.
        let second = learn(station, series, &driven[1], 1, Some(&first.model))?;
        Ok(SeenMicro {
            piezos: [first, second],
        })
    };
    Ok([of(Side::Left)?, of(Side::Right)?])
}

/// Gives the piezos of both sides the voltages that `volts` tells for so many seconds, and notes them and the frames.
fn hold(
    station: &mut Station,
    series: &mut [Series; SIDES],
    seconds: f64,
    volts: impl Fn(f64) -> [f64; MICRO_AXES],
) -> Result<(), Halt> {
    let begin = station.time();
    while station.time() - begin < seconds {
        let volts = volts(station.time() - begin);
        for side in Side::ALL {
            station.micro_volts(side, volts.map(Volts));
        }
        station.cycle()?;
        // As often as there is light: often enough.
        if station.light(pigtail_hal::Channel::Sensing).is_some() {
            for series in series.iter_mut() {
                series.time.push(station.time());
                series.volts.push(volts);
                series.light.push(0.0);
            }
        }
        let Some(frame) = station.frame() else {
            continue;
        };
        for side in Side::ALL {
            let tip = match side {
                Side::Left => frame.fiber[side.index()],
                Side::Right => Some(frame.sensing),
            };
            if let Some(tip) = tip {
                let seen = Point::new(tip.x, 0.0, tip.z);
                let x = station.kinematics(side).macro_from_chip(seen).x;
                series[side.index()].frames.push((frame.time, x));
            }
        }
    }
    Ok(())
}

/// The model of one piezo; `other` is that of the one that was driven before.
fn learn(
    station: &Station,
    series: &Series,
    driven: &Driven,
    piezo: usize,
    other: Option<&Model>,
) -> Result<Seen, Outcome> {
    let share = share_in_x(station, piezo);
    let blocks = Blocks::new(series, driven, piezo);
    let slow = blocks.places[0].clone();
    let place = slow.start..blocks.places[1].end;
    let beside = match other {
        Some(model) => blocks.displacement(model, 1 - piezo),
        None => vec![0.0; blocks.time.len()],
    };
    let beside_share = share_in_x(station, 1 - piezo) / share;
    // Frame by frame the way along the piezo, from anywhere.
    let seen: Vec<(usize, f64)> = place
        .filter_map(|k| Some((k, blocks.frame[k]? / share - beside_share * beside[k])))
        .collect();
    let volts: Vec<f64> = blocks.driven().collect();
    let line = Line::through(seen.iter().map(|(k, way)| (volts[*k], *way)));
    let mut prediction: Vec<f64> = volts.iter().map(|v| line.slope * v).collect();
    let (mut found, mut lag) = (None, None);
    for _ in 0..ROUNDS {
        let drift = Line::through(
            seen.iter()
                .map(|(k, way)| (blocks.time[*k], way - prediction[*k])),
        );
        let mut way = vec![None; prediction.len()];
        for (k, at) in &seen {
            way[*k] = Some((at - drift.at(blocks.time[*k]), 1.0));
        }
        let record = blocks.record(|k| way[k], &prediction)?;
        // What the camera is late, beside what it says that it is, is found with it.
        let memory = fitted(&record, piezo, lag)?;
        lag = Some(memory.lag);
        let model = Model::Memory(memory);
        prediction = predict(&model, &record);
        let left = rms(seen
            .iter()
            .map(|(k, at)| at - drift.at(blocks.time[*k]) - prediction[*k]));
        found = Some((model, left, drift.slope));
    }
    let (model, residual, drift) = found.ok_or_else(|| no_beam("along a piezo"))?;
    let column = |all: &[f64]| all[slow.clone()].to_vec();
    let ways = Record::new(column(&blocks.time), column(&volts), column(&prediction));
    let ways = ways.map_err(|why| Outcome::NoModel {
        piezo: Some(piezo),
        why,
    })?;
    let known = residual * (model.functions() as f64 / seen.len().max(1) as f64).sqrt();
    Ok(Seen {
        model,
        ways,
        residual,
        known,
        drift,
    })
}
