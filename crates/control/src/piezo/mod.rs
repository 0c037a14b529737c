//! Identification of the micro manipulators' piezos by light (thesis 4.2).
//!
//! Light falls off beside a beam as a Gaussian, (4.1), and so says where a tip is, 500 times a
//! second; the camera sees the tip too, 25 times a second and worse, and sets the scale of (4.1).
//! The flexure's coupling shows in how steep light is along the piezos beside how steep it is
//! straight up, which the macro's encoders measure.
//!
//! - `sensing`, the right: the sensing fiber before a lit guide, so far back that the beam is
//!   wider than its core (Fig. 4.3).
//! - `coupling`, the left: the input fiber so far back from its guide that the beam in which the
//!   guide stands is some micrometres wide, at one place of the piezo's range after the other.
//!
//! [`camera`] does without light: quicker and less well, as a new machine needs it.

mod blocks;
pub mod camera;
mod coupling;
mod ratio;
mod sensing;

use crate::compensation::hysteresis::{Model, Record, predict};
use crate::compensation::micro::MicroModel;
use crate::identify::Path;
use crate::outcome::{Halt, Outcome};
use crate::recipe::Recipe;
use crate::station::Station;
use nalgebra::Vector3;
use pigtail_hal::measurement::VisionFrame;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::Point;
use pigtail_numerics::normal::Normal;
use pigtail_numerics::signal::rms;

/// Speed of the voltage, volts a second: slow beside the resonance, fast beside most of the creep.
const SPEED: f64 = 2.5;

/// How long the dark is looked at, seconds: where a beam ends, an error of a third of a millivolt makes
/// one of a tenth of a micrometre.
const DARK: f64 = 10.0;

/// Light samples averaged to one of a record.
const BLOCK: usize = 5;

/// Light and tip while a piezo follows a path of its voltage.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// When each light sample was taken, seconds.
    pub time: Vec<f64>,
    /// The piezos' voltages at it.
    pub volts: Vec<[f64; MICRO_AXES]>,
    /// The light, volts, less what the photodiode gives in the dark.
    pub light: Vec<f64>,
    /// When each frame was exposed, and the tip's x in the manipulator's frame, metres.
    pub frames: Vec<(f64, f64)>,
}

impl Series {
    fn append(&mut self, next: Self) {
        self.time.extend(next.time);
        self.volts.extend(next.volts);
        self.light.extend(next.light);
        self.frames.extend(next.frames);
    }

    /// The samples of a range, and the frames exposed meanwhile.
    fn part(&self, over: std::ops::Range<usize>) -> Self {
        let (from, to) = (self.time[over.start], self.time[over.end - 1]);
        let frames = self.frames.iter().filter(|f| f.0 >= from && f.0 <= to);
        Self {
            time: self.time[over.clone()].to_vec(),
            volts: self.volts[over.clone()].to_vec(),
            light: self.light[over].to_vec(),
            frames: frames.copied().collect(),
        }
    }

    /// Mean light within 10 ms of `time`; `None` where there is none, or too little.
    fn light_at(&self, time: f64, least: f64) -> Option<f64> {
        let from = self.time.partition_point(|t| *t < time - 0.01);
        let to = self.time.partition_point(|t| *t <= time + 0.01);
        if from >= to {
            return None;
        }
        let mean = self.light[from..to].iter().sum::<f64>() / (to - from) as f64;
        (mean > least).then_some(mean)
    }
}

/// (4.1) along one piezo: `I = I_max exp(-((s - s_0)/sigma)^2)`, dark apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flank {
    /// `ln I_max`.
    pub top: f64,
    /// `s_0`, metres of the piezo's displacement.
    pub centre: f64,
    /// `sigma`, metres; positive where light falls as the piezo rises.
    pub width: f64,
}

impl Flank {
    /// The displacement at which the light is `light`, metres.
    pub fn displacement(&self, light: f64) -> f64 {
        self.centre + self.width * (self.top - light.ln()).max(0.0).sqrt()
    }
}

/// What was found of one piezo.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// What was measured.
    pub series: Series,
    /// How light became displacement.
    pub flank: Flank,
    /// Voltage and displacement (metres).
    pub record: Record,
    /// What the thesis's model was trained with: slow ways forward from the bottom and back from
    /// turning voltages across the range.
    pub ways: Record,
    /// The thesis's model of it.
    pub rbf: Model,
    /// The one that remembers.
    pub memory: Model,
}

/// What was found of a micro manipulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Micro {
    /// Its piezos.
    pub piezos: [Identified; MICRO_AXES],
    /// Displacement in y for one in x.
    pub ratio: f64,
}

impl Identified {
    /// Root mean square of what a model of the piezo leaves of what was measured, metres.
    pub fn residual(&self, model: &Model) -> f64 {
        let (prediction, record) = (predict(model, &self.record), &self.record);
        let over = record.known_from()..record.len();
        let measured = over.filter(|k| record.weight[*k] > 0.0);
        rms(measured.map(|k| prediction[k] - record.output[k]))
    }
}

impl Micro {
    /// The thesis's model of both piezos.
    pub fn rbf(&self) -> MicroModel {
        MicroModel {
            piezos: std::array::from_fn(|i| self.piezos[i].rbf.clone()),
            ratio: self.ratio,
        }
    }

    /// The model of both that remembers.
    pub fn memory(&self) -> MicroModel {
        MicroModel {
            piezos: std::array::from_fn(|i| self.piezos[i].memory.clone()),
            ratio: self.ratio,
        }
    }
}

/// A parabola `c_0 + c_1 x + c_2 x^2` by weighted least squares.
fn parabola(points: &[(f64, f64, f64)]) -> Option<[f64; 3]> {
    // In units in which the numbers are about one.
    let scale = points.iter().fold(0.0_f64, |s, p| s.max(p.0.abs()));
    let mut normal = Normal::default();
    for (x, y, weight) in points {
        let row = Vector3::new(1.0, x / scale, (x / scale).powi(2));
        normal.add_weighted(&row, *y, *weight);
    }
    let c = normal.solve()?;
    Some([c[0], c[1] / scale, c[2] / (scale * scale)])
}

/// A Gaussian through points of place and light: its top's logarithm, centre and width.
fn gaussian(points: &[(f64, f64)], place: &'static str) -> Result<Flank, Outcome> {
    // Errors of a logarithm are those of the light over the light.
    let logs: Vec<_> = points.iter().map(|(x, i)| (*x, i.ln(), i * i)).collect();
    match parabola(&logs) {
        Some([c0, c1, c2]) if c2 < 0.0 => Ok(Flank {
            top: c0 - 0.25 * c1 * c1 / c2,
            centre: -0.5 * c1 / c2,
            width: (-1.0 / c2).sqrt(),
        }),
        _ => Err(no_beam(place)),
    }
}

/// The same through points far from zero: about their mean place.
fn gaussian_far(points: &[(f64, f64)], place: &'static str) -> Result<Flank, Outcome> {
    let mean = points.iter().map(|p| p.0).sum::<f64>() / points.len().max(1) as f64;
    let around: Vec<(f64, f64)> = points.iter().map(|p| (p.0 - mean, p.1)).collect();
    let beam = gaussian(&around, place)?;
    Ok(Flank {
        centre: beam.centre + mean,
        ..beam
    })
}

/// Means of [`BLOCK`] neighbours of points of place and light, and the brightest of them.
fn smoothed(points: &[(f64, f64)]) -> (Vec<(f64, f64)>, (f64, f64)) {
    let mean = |w: &[(f64, f64)]| {
        let sum = w.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        (sum.0 / BLOCK as f64, sum.1 / BLOCK as f64)
    };
    let smooth: Vec<(f64, f64)> = points.windows(BLOCK).map(mean).collect();
    let brighter = |b: (f64, f64), p: &(f64, f64)| if p.1 > b.1 { *p } else { b };
    let top = smooth.iter().fold((0.0, 0.0), brighter);
    (smooth, top)
}

/// Share in x of a displacement along a piezo.
fn share_in_x(station: &Station, piezo: usize) -> f64 {
    let (sin, cos) = station.spec().micro.angle.sin_cos();
    [cos, -sin][piezo]
}

fn no_beam(place: &'static str) -> Outcome {
    Outcome::NoBeam { place }
}

/// Identifies both piezos of a side's micro.
///
/// # Errors
///
/// A fault; an outcome where the guides cannot be lit or the light is not that of a beam.
pub fn identify(station: &mut Station, recipe: &Recipe, side: Side) -> Result<Micro, Halt> {
    match side {
        Side::Left => coupling::identify(station, recipe),
        Side::Right => sensing::identify(station, recipe),
    }
}

/// What is watched while the piezos of a micro move.
#[derive(Debug, Clone, Copy)]
struct Watch {
    /// The micro.
    side: Side,
    /// The photodiode.
    channel: Channel,
    /// What it gives of no such light, volts.
    dark: f64,
}

impl Watch {
    /// A tip's x in the manipulator's frame, from what the camera says of it.
    fn tip_x(&self, station: &Station, x: f64, z: f64) -> f64 {
        let seen = Point::new(x, 0.0, z);
        station.kinematics(self.side).macro_from_chip(seen).x
    }

    /// The same of the tip that is watched; `None` where the camera sees none.
    fn seen_x(&self, station: &Station, frame: &VisionFrame) -> Option<f64> {
        let fix = match self.side {
            Side::Left => frame.fiber[self.side.index()]?,
            Side::Right => frame.sensing,
        };
        Some(self.tip_x(station, fix.x, fix.z))
    }

    /// Light and tip while the piezos' voltages follow a path.
    fn drive(
        &self,
        station: &mut Station,
        path: &Path,
        volts: impl Fn(f64) -> [Volts; MICRO_AXES],
    ) -> Result<Series, Halt> {
        let mut series = Series::default();
        let begin = station.time();
        while station.time() - begin < path.duration() {
            let at = path.at(station.time() - begin);
            let volts = volts(at);
            station.micro_volts(self.side, volts);
            station.cycle()?;
            if let Some(light) = station.light(self.channel) {
                series.time.push(station.time());
                series.volts.push(volts.map(|Volts(volts)| volts));
                series.light.push(light - self.dark);
            }
            if let Some(frame) = station.frame().filter(|frame| frame.time >= begin)
                && let Some(x) = self.seen_x(station, &frame)
            {
                series.frames.push((frame.time, x));
            }
        }
        Ok(series)
    }
}

/// So many parts the ways of the identification have.
const WAYS: usize = 3;

/// The ways of the identification, volts, one after the other from the middle.
///
/// First slowly, as in the thesis: full ways, then from the bottom to each turning voltage and back
/// (Fig. 4.4). Then turns that come closer and closer, faster, and last slower than both: at one
/// speed alone creep looks like hysteresis.
fn ways(voltage: f64) -> [Path; WAYS] {
    let path = |turns: &[f64], speed: f64| Path {
        turns: turns.iter().map(|t| t * voltage).collect(),
        speed,
    };
    let mut slow = vec![0.5, 1.0, 0.0, 1.0, 0.0];
    for k in (1..=10).rev() {
        slow.extend([0.1 * f64::from(k), 0.0]);
    }
    let mut fast = vec![0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0];
    for k in 0..12 {
        let share = 0.04 * f64::from(k);
        fast.extend([1.0 - share, share]);
    }
    fast.extend([0.9, 0.4, 0.6, 0.2, 0.7, 0.1, 0.3, 0.0, 1.0, 0.0]);
    [
        path(&slow, SPEED),
        path(&fast, 4.0 * SPEED),
        path(&[0.0, 0.8, 0.2, 0.6, 0.0], 0.4 * SPEED),
    ]
}

/// Less than the amplifiers resolve, volts: a way of it is a rest.
const STILL: f64 = 1e-4;

/// From the bottom to a voltage, and a rest there: all that moves then is creep.
fn resting(volts: f64) -> [Path; 2] {
    /// Seconds.
    const REST: f64 = 60.0;
    [
        Path {
            turns: vec![0.0, volts],
            speed: 4.0 * SPEED,
        },
        Path {
            turns: vec![volts, volts + STILL],
            speed: STILL / REST,
        },
    ]
}
