//! Finding a [`Memory`] in a record, by least squares with weights that must not be negative.

use super::memory::{DEGREE, PLAYS, RELAXATIONS};
use super::{Invalid, Memory, Record, Zero};
use pigtail_numerics::golden::least;

/// Samples used for a fit: more lie so close that they say nothing new.
const SAMPLES: usize = 20_000;

/// Unknowns: plays, offset, powers of the curve, relaxations.
const COLUMNS: usize = PLAYS + 1 + (DEGREE - 1) + RELAXATIONS;
const OFFSET: usize = PLAYS;
const CURVE: usize = OFFSET + 1;
const CREEP: usize = CURVE + DEGREE - 1;

/// Time constants of creep, seconds: half a decade apart.
const CONSTANTS: [f64; RELAXATIONS] = [
    0.02, 0.063, 0.2, 0.63, 2.0, 6.3, 20.0, 63.0, 200.0, 630.0, 2000.0, 6300.0,
];

/// A higher power of the curve must make the error on the part held back less by this share, or it
/// is left out: a record of full loops alone does not tell it from slacks.
const WORTH: f64 = 0.02;

/// What is known beforehand of the shares of a model's relaxations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Creep {
    /// Nothing: each has its own, and those that the record is too short or too coarse to show have
    /// none.
    Any,
    /// Creep is logarithmic in time: relaxations slower than a tenth of a second have one share among
    /// them, also those that go on after the record's end.
    Logarithmic,
}

/// The slowest relaxation that [`Creep::Logarithmic`] leaves a share of its own, seconds. What is
/// as fast as the light's samples and the amplifiers is not creep alone.
const STEADY: f64 = 0.1;

/// Finds the model in the samples before `to`; the rest is held back. `lag` is the lag between the
/// columns in seconds, if it is known; else it is looked for.
///
/// The power of the static curve is the lowest that tells the part held back about as well as any.
///
/// # Errors
///
/// When the record says too little, or what fits it is no piezo.
pub fn fit_memory(
    record: &Record,
    to: usize,
    lag: Option<f64>,
    creep: Creep,
) -> Result<Memory, Invalid> {
    let lag = lag.unwrap_or_else(|| best_lag(record, to, creep));
    let mut best: Option<(f64, Memory)> = None;
    for degree in 1..=DEGREE {
        let Ok((_, model)) = solve(record, to, degree, lag, creep, ROUNDS) else {
            continue;
        };
        let prediction = super::predict(&super::Model::Memory(model), record);
        let known = record.known_from();
        let rest = to.max(known)..record.len();
        let over = if rest.len() > 10 {
            rest
        } else {
            known.min(to - 1)..to
        };
        // What counts for nothing may not have been measured at all.
        let counts = |column: &[f64]| -> Vec<f64> {
            over.clone()
                .filter(|k| record.weight[*k] > 0.0)
                .map(|k| column[k])
                .collect()
        };
        let (prediction, measured) = (counts(&prediction), counts(&record.output));
        let error = super::judge(&prediction, &measured, 0..measured.len(), Zero::Known).rms;
        if best.is_none_or(|(least, _)| error < (1.0 - WORTH) * least) {
            best = Some((error, model));
        }
    }
    best.map(|(_, model)| model).ok_or_else(|| {
        Invalid::new(
            "record",
            "nothing in which displacement grows with voltage",
            "a record of a piezo",
        )
    })
}

/// The lag up to ten samples that fits best, by golden section. A curve that leans is enough to
/// find it, and creep changes nothing about it.
///
/// Beyond half a way a motion to and fro comes back to where it was: what a lag leaves has more than one least, and none where displacement
/// falls with the voltage that much later. Lags up to a way are tried there before.
fn best_lag(record: &Record, to: usize, creep: Creep) -> f64 {
    /// Sample periods.
    const PERIODS: f64 = 10.0;
    /// Of the longest lag: a hundredth of a sample.
    const ACCURATE: f64 = 1e-3;
    const TRIED: usize = 8;
    let samples = PERIODS * record.period();
    let left =
        |lag: f64| solve(record, to, 2, lag, creep, 1).map_or(f64::INFINITY, |(error, _)| error);
    let way = record.way().unwrap_or(f64::INFINITY);
    if samples <= 0.5 * way {
        return least((0.0, samples), ACCURATE * samples, left);
    }
    let longest = samples.min(way);
    let step = longest / TRIED as f64;
    let near = (0..=TRIED)
        .map(|k| step * k as f64)
        .min_by(|a, b| left(*a).total_cmp(&left(*b)))
        .unwrap_or(0.0);
    least(
        ((near - step).max(0.0), near + step),
        ACCURATE * longest,
        left,
    )
}

/// Rounds in which creep follows what the round before found.
const ROUNDS: usize = 3;

/// By how much the densities of two plays next to each other differ, of the mean density: one standard deviation of what is known beforehand. A
/// piezoceramic's domains switch at fields that are spread smoothly, evenly where fields are small (Rayleigh's law). A noisy record
/// tells neighbours badly apart: by it alone some would weigh nothing and others all, and of small loops the model would be wrong.
const ROUGH: f64 = 0.3;

fn solve(
    record: &Record,
    to: usize,
    degree: usize,
    lag: f64,
    creep: Creep,
    rounds: usize,
) -> Result<(f64, Memory), Invalid> {
    let (input, output) = (record.input_range(), record.output_range());
    let from = record.known_from().min(to.saturating_sub(super::LEAST / 2));
    let mut model = Memory {
        input,
        output,
        slack: Memory::usual_slack(),
        weights: [0.0; PLAYS],
        offset: 0.0,
        curve: [0.0; DEGREE - 1],
        constants: CONSTANTS,
        shares: [0.0; RELAXATIONS],
        lag,
    };
    // Relaxations that the record is too short or too coarse to show stay out of the fit.
    let span = record.time[to - 1] - record.time[0];
    let period = record.period();
    let shown = CONSTANTS.map(|c| c > 10.0 * period && c < 0.5 * span);
    let steady = match creep {
        Creep::Any => None,
        Creep::Logarithmic => CONSTANTS.iter().position(|c| *c > STEADY),
    };
    let inputs: Vec<f64> = (0..to)
        .map(|k| input.to_share(record.input_before(k, lag)))
        .collect();
    let measured = record.weight[from..to].iter().filter(|w| **w > 0.0).count();
    let every = measured.div_ceil(SAMPLES).max(1);
    // Curve and creep are of what comes at once, not known before the fit; the displacement is near.
    let mut at_once: Vec<f64> = record.output[..to]
        .iter()
        .map(|x| output.to_share(*x))
        .collect();
    let mut square = f64::INFINITY;
    for round in 0..rounds {
        let mut normal = Normal::new(steady.map_or(COLUMNS, |first| CREEP + first + 1));
        let mut state = model.at_rest(record.input_before(0, lag));
        let mut relaxations = [at_once[0]; RELAXATIONS];
        let mut met = 0;
        for k in 0..to {
            model.at_once(&mut state, inputs[k]);
            let step = if k == 0 {
                period
            } else {
                record.time[k] - record.time[k - 1]
            };
            for (z, constant) in relaxations.iter_mut().zip(&CONSTANTS) {
                *z += -(-step / constant).exp_m1() * (at_once[k] - *z);
            }
            if k < from || record.weight[k] == 0.0 {
                continue;
            }
            met += 1;
            if !(met - 1_usize).is_multiple_of(every) {
                continue;
            }
            let x = output.to_share(record.output[k]);
            let mut row = [0.0; COLUMNS];
            row[..PLAYS].copy_from_slice(&state.plays(&model));
            row[OFFSET] = 1.0;
            let mut power = at_once[k];
            for cell in &mut row[CURVE..CURVE + degree - 1] {
                power *= at_once[k];
                *cell = power;
            }
            for i in 0..RELAXATIONS {
                if steady == Some(i) {
                    row[CREEP + i] = relaxations[i..].iter().sum();
                    break;
                }
                row[CREEP + i] = if shown[i] { relaxations[i] } else { 0.0 };
            }
            normal.add(&row, x, record.weight[k]);
        }
        if round > 0 {
            normal.smooth(&model, square);
        }
        let solution;
        (solution, square) = normal.solve();
        model.weights.copy_from_slice(&solution[..PLAYS]);
        model.offset = solution[OFFSET];
        model.curve.copy_from_slice(&solution[CURVE..CREEP]);
        model.shares.copy_from_slice(&solution[CREEP..]);
        if let Some(first) = steady {
            let share = model.shares[first];
            model.shares[first..].fill(share);
        }
        // What comes at once as this model has it.
        let mut state = model.at_rest(record.input_before(0, lag));
        for (u, v) in at_once.iter_mut().zip(&inputs) {
            *u = model.at_once(&mut state, *v);
        }
    }
    model.weights[0] = model.weights[0].max(1e-6);
    model.check()?;
    Ok((square.sqrt(), model))
}

/// Normal equations of a weighted least squares problem whose first unknowns and last ones, plays
/// and relaxations, must not be negative.
struct Normal {
    /// Unknowns from here on stay out of it.
    used: usize,
    matrix: [[f64; COLUMNS]; COLUMNS],
    right: [f64; COLUMNS],
    square: f64,
    weight: f64,
}

impl Normal {
    fn new(used: usize) -> Self {
        Self {
            used,
            matrix: [[0.0; COLUMNS]; COLUMNS],
            right: [0.0; COLUMNS],
            square: 0.0,
            weight: 0.0,
        }
    }

    fn add(&mut self, row: &[f64; COLUMNS], value: f64, weight: f64) {
        let row = &row[..self.used];
        for (i, a) in row.iter().enumerate() {
            let a = weight * a;
            if a == 0.0 {
                continue;
            }
            for (sum, b) in self.matrix[i].iter_mut().zip(row) {
                *sum += a * b;
            }
            self.right[i] += a * value;
        }
        self.square += weight * value * value;
        self.weight += weight;
    }

    /// Adds what is known beforehand of the plays' weights, by the model of the round before and the mean square that it left of a
    /// sample: their density is as smooth as [`ROUGH`] says.
    fn smooth(&mut self, before: &Memory, square: f64) {
        let slack = &before.slack;
        let density = before.weights[1..].iter().sum::<f64>() / slack[PLAYS - 1];
        let counts = square / (ROUGH * density).powi(2);
        // Where nothing has slack, nothing of it is rough.
        if !counts.is_finite() {
            return;
        }
        // The part of the slacks that a play stands for.
        let part = |i: usize| match slack.get(i + 1) {
            Some(next) => 0.5 * (next - slack[i - 1]),
            None => slack[i] - slack[i - 1],
        };
        for i in 1..PLAYS - 1 {
            let row = [(i, part(i).recip()), (i + 1, -part(i + 1).recip())];
            for (i, a) in row {
                for (j, b) in row {
                    self.matrix[i][j] += counts * a * b;
                }
            }
        }
    }

    /// The unknowns and the mean square that they leave, by coordinate descent: the problem is
    /// convex.
    fn solve(&self) -> ([f64; COLUMNS], f64) {
        // A trace of cost for each weight decides between plays that the data do not tell apart.
        let ridge = 1e-9 * self.weight;
        let mut x = [0.0; COLUMNS];
        for _ in 0..4000 {
            let mut moved = 0.0_f64;
            for i in 0..self.used {
                let diagonal = self.matrix[i][i] + ridge;
                let sum = self.row_times(i, &x);
                let step = (self.right[i] - sum - ridge * x[i]) / diagonal;
                let free = (OFFSET..CREEP).contains(&i);
                let next = if free {
                    x[i] + step
                } else {
                    (x[i] + step).max(0.0)
                };
                moved = moved.max((next - x[i]).abs());
                x[i] = next;
            }
            if moved < 1e-10 {
                break;
            }
        }
        let mut squares = self.square;
        for i in 0..self.used {
            squares += x[i] * (self.row_times(i, &x) - 2.0 * self.right[i]);
        }
        (x, (squares / self.weight).max(0.0))
    }

    fn row_times(&self, i: usize, x: &[f64; COLUMNS]) -> f64 {
        let row = self.matrix[i][..self.used].iter();
        row.zip(x).map(|(a, b)| a * b).sum()
    }
}
