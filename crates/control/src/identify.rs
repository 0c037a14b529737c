//! Identification of windup on the machine (thesis 2.4.1, 2.4.3).

use crate::characterize::{Trace, record};
use crate::outcome::{Halt, Lack, Outcome};
use crate::station::Station;
use nalgebra::{SMatrix, SVector};
use pigtail_hal::AxisName;
use pigtail_model::windup::{
    ELEMENTS, Memory, MemoryState, POWERS, Reversal, Windup, WindupState, polynomial,
};
use pigtail_numerics::golden::least;
use pigtail_numerics::line::Line;
use pigtail_numerics::normal::Normal;
use serde::{Deserialize, Serialize};

/// Input and output of a transmission over a scan, as output angles from where it began.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WindupRecord {
    /// Time between samples, seconds.
    pub period: f64,
    /// `r q_m` by the encoder, radians.
    pub input: Vec<f64>,
    /// The output by the probe, radians.
    pub output: Vec<f64>,
    /// The output that was wanted, radians.
    pub wanted: Vec<f64>,
}

impl WindupRecord {
    /// When each sample was taken, seconds from the record's begin.
    pub fn time(&self) -> Vec<f64> {
        (1..=self.input.len())
            .map(|k| k as f64 * self.period)
            .collect()
    }
}

/// How near a way is found, in its logarithm.
const ACCURATE: f64 = 1e-5;

/// How counts and probe readings become output angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Output angle of one count of the encoder, radians.
    pub radians_per_count: f64,
    /// What the probe reads for a radian of the output, metres.
    pub metres_per_radian: f64,
}

/// A path through turning points at constant speed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Path {
    /// Turning points, in the unit of the path, from zero.
    pub turns: Vec<f64>,
    /// Speed, units a second.
    pub speed: f64,
}

impl Path {
    /// Seconds from the first turning point to the last.
    pub fn duration(&self) -> f64 {
        self.turns
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .sum::<f64>()
            / self.speed
    }

    /// Where it is `time` seconds after its start.
    pub fn at(&self, time: f64) -> f64 {
        let mut left = time * self.speed;
        for w in self.turns.windows(2) {
            let length = (w[1] - w[0]).abs();
            if left < length {
                return w[0] + left * (w[1] - w[0]).signum();
            }
            left -= length;
        }
        self.turns.last().copied().unwrap_or(0.0)
    }

    /// Forward and back over `range` twice, then turns within it that come closer and closer:
    /// every state of the transmission between fully wound either way.
    pub fn identification(range: f64, speed: f64) -> Self {
        let mut turns = vec![0.0, range, 0.0, range, 0.0, range];
        let (mut low, mut high) = (0.0, range);
        for share in [0.55, 0.5, 0.45, 0.4, 0.35, 0.3, 0.25] {
            low = range * (0.5 - share);
            turns.push(low.max(0.0));
            high = range * (0.5 + share - 0.03);
            turns.push(high);
        }
        let middle = 0.5 * (low + high);
        for share in [0.22, 0.19, 0.16, 0.13, 0.1, 0.075, 0.05, 0.03] {
            turns.push(middle - share * range);
            turns.push(middle + share * range);
        }
        turns.extend([0.0, range]);
        Self { turns, speed }
    }
}

/// Drives an axis along a path of its output (radians), through a model of its windup, and notes
/// input and output.
///
/// # Errors
///
/// A fault; [`Outcome::Lacking`] on a rig without probes.
pub fn scan(
    station: &mut Station,
    at: AxisName,
    scale: &Scale,
    path: &Path,
    model: &Windup,
) -> Result<WindupRecord, Halt> {
    let state = std::cell::RefCell::new(WindupState::default());
    let reference = |time: f64| {
        let output = path.at(time);
        let windup = model.next(&mut state.borrow_mut(), output);
        (output + windup) / scale.radians_per_count
    };
    let trace: Trace = record(station, at, path.duration(), reference, |_| true)?;
    if trace.output.is_empty() {
        return Err(Outcome::Lacking(Lack::Probe(at)).into());
    }
    Ok(WindupRecord {
        period: trace.period,
        input: trace
            .encoder
            .iter()
            .map(|c| c * scale.radians_per_count)
            .collect(),
        output: trace
            .output
            .iter()
            .map(|m| m / scale.metres_per_radian)
            .collect(),
        wanted: (0..trace.encoder.len())
            .map(|k| path.at((k + 1) as f64 * trace.period))
            .collect(),
    })
}

/// A fitted model and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit<M> {
    /// The model.
    pub model: M,
    /// Windup by which encoder and probe were out of step when the scan began, radians.
    pub offset: f64,
    /// Root mean square of what is left of the windup, radians.
    pub residual: f64,
    /// Largest of it, radians.
    pub largest: f64,
}

/// Of how many samples one is fitted: they lie far closer than anything changes.
const EVERY: usize = 50;

/// Windup at every [`EVERY`]th sample beside the output.
fn samples(record: &WindupRecord) -> Vec<(f64, f64)> {
    record
        .input
        .iter()
        .zip(&record.output)
        .step_by(EVERY)
        .map(|(input, output)| (*output, input - output))
        .collect()
}

/// What a model leaves of samples from `skip` on, of which those before lead it to where they begin.
fn judged<M>(
    data: &[(f64, f64)],
    skip: usize,
    offset: f64,
    model: M,
    mut next: impl FnMut(f64) -> f64,
) -> Fit<M> {
    for (output, _) in &data[..skip] {
        next(*output);
    }
    let (mut squares, mut largest) = (0.0, 0.0_f64);
    for (output, windup) in &data[skip..] {
        let left = windup - offset - next(*output);
        squares += left * left;
        largest = largest.max(left.abs());
    }
    Fit {
        model,
        offset,
        residual: (squares / (data.len() - skip) as f64).sqrt(),
        largest,
    }
}

/// Fits (2.20) to those samples of a record over which the transmission winds up fully either way,
/// as the thesis does: elsewhere (2.20) is not what it claims to be.
///
/// For each `Q` the maximum and the offset follow by linear least squares.
pub fn fit_reversal(record: &WindupRecord, full: std::ops::Range<usize>) -> Fit<Reversal> {
    let mut data = samples(record);
    data.truncate(full.end / EVERY);
    let skip = full.start / EVERY;
    let shape_of = |way: f64| -> Vec<f64> {
        let unit = Reversal { maximum: 1.0, way };
        let mut state = pigtail_model::windup::ReversalState::default();
        data.iter()
            .map(|(output, _)| unit.next(&mut state, *output))
            .collect()
    };
    let solve = |way: f64| {
        let shape = shape_of(way);
        let points = shape.into_iter().zip(&data).skip(skip);
        let points = points.map(|(shape, (_, windup))| (shape, *windup));
        let line = Line::through(points.clone());
        let squares: f64 = points.map(|(s, w)| line.left(s, w).powi(2)).sum();
        (line.slope, line.at(0.0), squares)
    };
    let range = data
        .iter()
        .fold(0.0, |r: f64, (output, _)| r.max(output.abs()));
    let ways = ((0.005 * range).ln(), range.ln());
    let way = least(ways, ACCURATE, |log| solve(log.exp()).2).exp();
    let (maximum, offset, _) = solve(way);
    let mut state = pigtail_model::windup::ReversalState::default();
    let model = Reversal { maximum, way };
    judged(&data, skip, offset, model, |output| {
        model.next(&mut state, output)
    })
}

/// Fits a [`Memory`] to a record from sample `skip` on: element ways on a grid whose longest is
/// searched, hardening and stiffnesses by least squares.
pub fn fit_memory(record: &WindupRecord, skip: usize, first: &Fit<Reversal>) -> Fit<Memory> {
    let data = samples(record);
    let skip = skip / EVERY;
    let (low, high) = (0.1 * first.model.way, 1.5 * first.model.way);
    let longest = least((low.ln(), high.ln()), ACCURATE, |log| {
        Grid::new(&data, skip, first, log.exp()).best().2
    })
    .exp();
    let (model, shift, _) = Grid::new(&data, skip, first, longest).best();
    let offset = first.offset + shift;
    let mut state = MemoryState::default();
    judged(&data, skip, offset, model, |output| {
        model.next(&mut state, output)
    })
}

/// The answers of elements of given ways to a record.
struct Grid {
    ways: [f64; ELEMENTS],
    /// Windup over its maximum at each sample.
    windups: Vec<f64>,
    /// Deflection over its way of each element at each sample.
    rows: Vec<SVector<f64, ELEMENTS>>,
    /// Sums of products of the rows' columns.
    normal: SMatrix<f64, ELEMENTS, ELEMENTS>,
    maximum: f64,
}

impl Grid {
    fn new(data: &[(f64, f64)], skip: usize, first: &Fit<Reversal>, longest: f64) -> Self {
        let ways: [f64; ELEMENTS] =
            std::array::from_fn(|i| longest * (i + 1) as f64 / ELEMENTS as f64);
        let elements = Memory {
            ways,
            stiffness: [0.0; ELEMENTS],
            hardening: [0.0; POWERS],
        };
        let mut state = MemoryState::default();
        let mut rows: Vec<SVector<f64, ELEMENTS>> = Vec::with_capacity(data.len());
        for (output, _) in data {
            elements.next(&mut state, *output);
            rows.push(SVector::from_fn(|i, _| state.deflections()[i] / ways[i]));
        }
        rows.drain(..skip);
        let normal = rows.iter().map(|row| row * row.transpose()).sum();
        let maximum = first.model.maximum;
        let windups = data[skip..]
            .iter()
            .map(|(_, w)| (w - first.offset) / maximum)
            .collect();
        Self {
            ways,
            windups,
            rows,
            normal,
            maximum,
        }
    }

    /// The best model on this grid, its offset beside the grid's, and the squares of what it leaves.
    ///
    /// The elements' stiffnesses and the hardening are each linear while the other stays, so they
    /// take turns; what they reach from no hardening is where they settle.
    fn best(&self) -> (Memory, f64, f64) {
        const ROUNDS: usize = 12;
        let mut shape = Shape::LINEAR;
        let mut weights = SVector::zeros();
        for _ in 0..ROUNDS {
            weights = self.weights(&shape);
            shape = self.shape(&weights);
        }
        let squares: f64 = self
            .rows
            .iter()
            .zip(&self.windups)
            .map(|(row, windup)| (windup - shape.windup(row.dot(&weights))).powi(2))
            .sum();
        let total = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mut power = self.maximum;
        let model = Memory {
            ways: self.ways,
            stiffness: std::array::from_fn(|i| weights[i] / total / self.ways[i]),
            hardening: shape.hardening.map(|h| {
                power *= total;
                h * power
            }),
        };
        (model, self.maximum * shape.offset, squares)
    }

    /// The elements' torques that wind a transmission of this shape up as was measured, with so much
    /// regularisation that neighbouring elements do not fight. Shares may be negative: the torque then rises
    /// above what sliding needs, as it does before a load breaks away.
    fn weights(&self, shape: &Shape) -> SVector<f64, ELEMENTS> {
        const REGULARISATION: f64 = 1e-5;
        let torques = self.windups.iter().map(|windup| shape.torque(*windup));
        let normal = Normal {
            matrix: self.normal,
            right: self.rows.iter().zip(torques).map(|(row, t)| row * t).sum(),
        };
        let ridge = REGULARISATION * normal.matrix.trace() / ELEMENTS as f64;
        normal.solve_with_ridge(ridge).unwrap_or_default()
    }

    /// The shape that makes the measured windup of these elements' torques.
    fn shape(&self, weights: &SVector<f64, ELEMENTS>) -> Shape {
        const COLUMNS: usize = 1 + POWERS;
        let mut normal = Normal::default();
        for (row, windup) in self.rows.iter().zip(&self.windups) {
            let torque = row.dot(weights);
            let mut power = 1.0;
            let powers = SVector::<f64, COLUMNS>::from_fn(|_, _| {
                let now = power;
                power *= torque;
                now
            });
            normal.add(&powers, *windup);
        }
        normal.solve().map_or(Shape::LINEAR, |solved| Shape {
            offset: solved[0],
            hardening: std::array::from_fn(|i| solved[1 + i]),
        })
    }
}

/// Windup as a function of the torque, both relative.
struct Shape {
    offset: f64,
    hardening: [f64; POWERS],
}

impl Shape {
    const LINEAR: Self = Self {
        offset: 0.0,
        hardening: [1.0, 0.0, 0.0, 0.0, 0.0],
    };

    fn windup(&self, torque: f64) -> f64 {
        self.offset + polynomial(&self.hardening, torque)
    }

    /// The torque at which it is wound up by `w`, by Newton's method.
    fn torque(&self, w: f64) -> f64 {
        let mut torque = (w - self.offset).clamp(-1.2, 1.2);
        for _ in 0..6 {
            let slopes = self.hardening.iter().enumerate().rev();
            let slope = slopes.fold(0.0, |sum, (i, h)| sum * torque + (i + 1) as f64 * h);
            let newton = (self.windup(torque) - w) / slope.max(0.05);
            torque = (torque - newton).clamp(-1.5, 1.5);
        }
        torque
    }
}

/// Peak-to-peak of output less wanted output over a record from sample `skip` on, radians.
pub fn error_span(record: &WindupRecord, skip: usize) -> f64 {
    let (low, high) = record
        .output
        .iter()
        .zip(&record.wanted)
        .skip(skip)
        .map(|(output, wanted)| output - wanted)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), e| {
            (l.min(e), h.max(e))
        });
    high - low
}

/// Greatest spread of the output's error at the same wanted output over all passes from sample
/// `skip` on, radians: the gap between the forward and the backward path, as the thesis reads it
/// off its figures 2.8 and 2.17.
pub fn backlash(record: &WindupRecord, skip: usize) -> f64 {
    /// Far more than a transition has, with many samples in each.
    const BINS: usize = 200;
    let wanted = &record.wanted[skip.min(record.wanted.len())..];
    let (low, high) = wanted
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), w| {
            (l.min(*w), h.max(*w))
        });
    let mut spans = [(f64::INFINITY, f64::NEG_INFINITY); BINS];
    for (output, wanted) in record.output.iter().zip(&record.wanted).skip(skip) {
        let share = (wanted - low) / (high - low).max(f64::MIN_POSITIVE);
        let bin = &mut spans[((share * BINS as f64) as usize).min(BINS - 1)];
        *bin = (bin.0.min(output - wanted), bin.1.max(output - wanted));
    }
    spans.iter().map(|(l, h)| h - l).fold(0.0, f64::max)
}
