//! The thesis's model of hysteresis: radial basis networks of one turning point (4.3-4.6), and what follows from
//! them for any number of turning points (4.2).

use super::spectrum::Spectrum;
use super::turns::{Everett, Turns};
use super::{Invalid, Range, Record, Swing};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, OnceLock};

/// Voltage and displacement are stretched to so many units over their range; the thesis's unit is
/// a volt, and its range ten of them.
pub const UNITS: f64 = 10.0;

/// The turning point that stands for the way forward, units. No turn can be there.
pub const FORWARD: f64 = -5.0;

/// Distance of neighbouring centres in the thesis, units: half the period of the highest frequency
/// that mattered there. [`Spectrum`] says which it is here.
pub const SPACING: f64 = 1.0;

/// A sum of Gaussians of one width over a plane, (4.3).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Network {
    /// `C_i`.
    centres: Vec<[f64; 2]>,
    /// `w_i`.
    weights: Vec<f64>,
    /// `sigma`.
    width: f64,
}

/// A point of the plane and the value there.
pub type Sample = ([f64; 2], f64);

/// What a network's weights cost beside its errors, as a share of what the data say of a weight:
/// enough to tame those about which they say nothing. Much more (1e-9) keeps wide functions, which work by what is left of great weights,
/// from telling a smooth way: it goes by waves then, which are small in displacement and not beside how far a small loop is open.
pub const RIDGE: f64 = 1e-13;

/// By how much a network may err more than with the best width, of samples that were kept back, for the sake of wider functions: they are smoother, and what
/// a small loop does is the curvature of them, of which an error in displacement says little.
const AS_GOOD: f64 = 1.05;

impl Network {
    /// A network of zero weights.
    ///
    /// # Errors
    ///
    /// When there are no centres or the width is not positive.
    pub fn new(centres: Vec<[f64; 2]>, width: f64) -> Result<Self, Invalid> {
        if centres.is_empty() {
            return Err(Invalid::new("centres", "none", "at least one"));
        }
        if !(width > 0.0 && width.is_finite()) {
            return Err(Invalid::new("width", width, "a finite number above zero"));
        }
        let weights = vec![0.0; centres.len()];
        Ok(Self {
            centres,
            weights,
            width,
        })
    }

    /// Checks what was read from a file.
    pub(super) fn check(&self) -> Result<(), Invalid> {
        if self.weights.len() != self.centres.len() {
            let value = format!("{} weights", self.weights.len());
            let accepted = format!("{}, one for each centre", self.centres.len());
            return Err(Invalid::new("weights", value, accepted));
        }
        let numbers = self.centres.iter().flatten().chain(&self.weights);
        if !numbers.copied().all(f64::is_finite) {
            return Err(Invalid::new(
                "weights",
                "not finite",
                "finite centres and weights",
            ));
        }
        Self::new(self.centres.clone(), self.width).map(|_| ())
    }

    /// The centres of Fig. 4.7: a column along the way forward, and a lattice in the triangle in
    /// which a way back lies below its turning point. `spacing` is the distance of neighbours,
    /// units; one unit makes the thesis's 75 functions.
    pub fn lattice(spacing: f64) -> Vec<[f64; 2]> {
        let along = (UNITS / spacing).round().max(2.0) as u32;
        let share = |k: u32, of: u32| UNITS * f64::from(k) / f64::from(of);
        let forward = (0..along).map(|k| [FORWARD, share(k, along - 1)]);
        let back = (1..=along)
            .flat_map(|turn| (0..=turn).map(move |k| [share(turn, along), share(k, along)]));
        forward.chain(back).collect()
    }

    /// The width by the rule (4.6), from which tuning starts.
    pub fn rule(spacing: f64) -> f64 {
        std::f64::consts::PI.sqrt() * spacing
    }

    /// Distance of neighbouring centres of a [`Self::lattice`], units.
    pub fn spacing(&self) -> f64 {
        self.centres
            .windows(2)
            .next_back()
            .map_or(UNITS, |pair| pair[1][1] - pair[0][1])
    }

    /// Number of functions.
    pub fn functions(&self) -> usize {
        self.centres.len()
    }

    /// Centres and weights.
    pub fn parts(&self) -> (&[[f64; 2]], &[f64]) {
        (&self.centres, &self.weights)
    }

    /// The width `sigma` of its Gaussians, units.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// Sets the weights, one for each centre.
    ///
    /// # Errors
    ///
    /// When there are more or fewer.
    pub fn set_weights(&mut self, weights: &[f64]) -> Result<(), Invalid> {
        self.weights = weights.to_vec();
        self.check()
    }

    /// `F(X)` of (4.3).
    pub fn value(&self, at: [f64; 2]) -> f64 {
        let inverse = -1.0 / (self.width * self.width);
        self.centres
            .iter()
            .zip(&self.weights)
            .map(|(centre, weight)| {
                let (a, b) = (at[0] - centre[0], at[1] - centre[1]);
                let distance = a * a + b * b;
                // So far away that it adds nothing.
                if distance * inverse < -36.0 {
                    0.0
                } else {
                    weight * (distance * inverse).exp()
                }
            })
            .sum()
    }

    /// Every Gaussian's value at a point.
    fn fill_basis(&self, at: [f64; 2], basis: &mut [f64]) {
        let inverse = -1.0 / (self.width * self.width);
        for (value, centre) in basis.iter_mut().zip(&self.centres) {
            let (a, b) = (at[0] - centre[0], at[1] - centre[1]);
            *value = ((a * a + b * b) * inverse).exp();
        }
    }

    /// Sets the weights by regularised least squares, all samples at once. `ridge` is the cost of
    /// a weight beside that of the mean sample.
    pub fn train(&mut self, samples: &[Sample], ridge: f64) {
        let n = self.centres.len();
        let mut basis = vec![0.0; n];
        let mut design = DMatrix::zeros(samples.len() + n, n);
        for (row, (at, _)) in samples.iter().enumerate() {
            self.fill_basis(*at, &mut basis);
            for (to, value) in design.row_mut(row).iter_mut().zip(&basis) {
                *to = *value;
            }
        }
        let cost = (ridge * samples.len() as f64).sqrt();
        for weight in 0..n {
            design[(samples.len() + weight, weight)] = cost;
        }
        let mut wanted = DVector::zeros(samples.len() + n);
        for (to, sample) in wanted.iter_mut().zip(samples) {
            *to = sample.1;
        }
        // By QR, for normal equations square what is nearly singular.
        let qr = design.qr();
        qr.q_tr_mul(&mut wanted);
        // With a ridge above zero no column is one of the others.
        if let Some(solved) = qr.r().solve_upper_triangular(&wanted.rows(0, n)) {
            self.weights.copy_from_slice(solved.as_slice());
        }
    }

    /// Root mean square of the errors at these samples.
    pub fn error(&self, samples: &[Sample]) -> f64 {
        let squares: f64 = samples
            .iter()
            .map(|(at, value)| (self.value(*at) - value).powi(2))
            .sum();
        (squares / samples.len() as f64).sqrt()
    }

    /// A network on [`Self::lattice`], trained with `samples`, of the greatest width with which the error is hardly more than the least.
    fn tuned(spacing: f64, samples: &[Sample]) -> Self {
        let trained = |width: f64, samples: &[Sample]| {
            let centres = Self::lattice(spacing);
            let mut network = Self {
                weights: vec![0.0; centres.len()],
                centres,
                width,
            };
            network.train(samples, RIDGE);
            network
        };
        // Every other sample is kept back, so that the width is not one that fits noise.
        let part = |odd: usize| -> Vec<Sample> {
            let chosen = samples.iter().skip(odd).step_by(2);
            chosen.copied().collect()
        };
        let (fitted, kept) = (part(0), part(1));
        let rule = Self::rule(spacing);
        // Ways are smooth: the best width may be more than twice that of the rule.
        let tried: Vec<(f64, f64)> = (0..14)
            .map(|k| {
                let width = rule * (0.7 + 0.2 * f64::from(k));
                (trained(width, &fitted).error(&kept), width)
            })
            .collect();
        let least = tried
            .iter()
            .fold(f64::INFINITY, |l, (error, _)| l.min(*error));
        let as_good = |(error, _): &&(f64, f64)| *error <= AS_GOOD * least;
        let widest = tried.iter().rev().find(as_good);
        trained(widest.map_or(rule, |(_, width)| *width), samples)
    }
}

/// Recursive least squares for a [`Network`], one sample at a time, with forgetting. Learning
/// allocates nothing.
#[derive(Debug, Clone)]
pub struct Recursive {
    /// Symmetric, row by row.
    covariance: Vec<f64>,
    basis: Vec<f64>,
    gain: Vec<f64>,
    forgetting: f64,
    ridge: f64,
    /// The weight whose turn it is to be remembered.
    turn: usize,
}

impl Recursive {
    /// Starts from the weights that a network has, each of which counts as much as `ridge`
    /// samples. Every sample then counts `forgetting` times as much as the one after it.
    ///
    /// # Errors
    ///
    /// When the ridge is not positive or the forgetting not in (0, 1].
    pub fn new(network: &Network, ridge: f64, forgetting: f64) -> Result<Self, Invalid> {
        if !(ridge > 0.0 && ridge.is_finite()) {
            return Err(Invalid::new("ridge", ridge, "a finite number above zero"));
        }
        if !(forgetting > 0.0 && forgetting <= 1.0) {
            let accepted = "above 0 and at most 1";
            return Err(Invalid::new("forgetting", forgetting, accepted));
        }
        let n = network.functions();
        let mut covariance = vec![0.0; n * n];
        for i in 0..n {
            covariance[i * n + i] = 1.0 / ridge;
        }
        Ok(Self {
            covariance,
            basis: vec![0.0; n],
            gain: vec![0.0; n],
            forgetting,
            ridge,
            turn: 0,
        })
    }

    /// Takes in one sample; returns its value less what the network said before.
    pub fn learn(&mut self, network: &mut Network, (at, value): Sample) -> f64 {
        let n = network.functions();
        network.fill_basis(at, &mut self.basis);
        for (gain, row) in self.gain.iter_mut().zip(self.covariance.chunks_exact(n)) {
            *gain = dot(row, &self.basis);
        }
        let scale = 1.0 / (self.forgetting + dot(&self.basis, &self.gain));
        let error = value - dot(&self.basis, &network.weights);
        for (weight, gain) in network.weights.iter_mut().zip(&self.gain) {
            *weight += scale * error * gain;
        }
        self.take_off(scale);
        if self.forgetting < 1.0 {
            for p in &mut self.covariance {
                *p /= self.forgetting;
            }
            // What is forgotten where nothing is learned is put back, one weight after the other:
            // a pretended sample says that it is what it is. Else the next sample there would
            // throw the weights anywhere.
            let i = self.turn;
            self.turn = (i + 1) % n;
            self.gain
                .copy_from_slice(&self.covariance[i * n..(i + 1) * n]);
            let strength = n as f64 * (1.0 - self.forgetting) * self.ridge;
            self.take_off(strength / (1.0 + strength * self.gain[i]));
        }
        error
    }

    /// Takes `scale` times the square of the gain off the covariance.
    fn take_off(&mut self, scale: f64) {
        let n = self.gain.len();
        for (row, gain) in self.covariance.chunks_exact_mut(n).zip(&self.gain) {
            let by = scale * gain;
            for (p, other) in row.iter_mut().zip(&self.gain) {
                *p -= by * other;
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Forward and inverse network, and the displacement after any number of turns that follows from the forward one.
///
/// The thesis's own rule knows one turning point, so a way up is the way forward from the bottom wherever it begins, and
/// at every turn of a small loop the voltage leaps by the opening of the great one. As 4.2.1 proposes it goes on to
/// more of them here: by Everett's function of the forward network, which is told in `turns.rs`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rbf {
    /// What voltages are stretched to units.
    pub input: Range,
    /// What displacements are.
    pub output: Range,
    /// Turning points of the ways back it was trained with, units. A turn beyond them is taken for
    /// the nearest: where a network was not trained it says nothing.
    pub turns: Range,
    /// `x = f(v1, vx)`, (4.4).
    pub forward: Network,
    /// `vx = g(v1, x)`, (4.5): of ways forward from the bottom and the ways back from them.
    pub inverse: Network,
    /// Made of the forward network when it is needed first.
    #[serde(skip)]
    everett: OnceLock<Arc<Everett>>,
}

impl PartialEq for Rbf {
    /// Whatever the tables: they follow from the rest.
    fn eq(&self, other: &Self) -> bool {
        (self.input, self.output, self.turns) == (other.input, other.output, other.turns)
            && self.forward == other.forward
            && self.inverse == other.inverse
    }
}

/// What an [`Rbf`] remembers: the turns that still matter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RbfState(Turns);

impl Rbf {
    /// Trains both networks off line with the ways forward from the bottom of a record's range and
    /// the ways back that follow them: what they were made for. Samples without weight are left out.
    /// How far apart the functions are says the spectrum of such a way.
    ///
    /// # Errors
    ///
    /// When the record has no such ways.
    pub fn train(record: &Record) -> Result<Self, Invalid> {
        let (input, output) = (record.input_range(), record.output_range());
        let samples = Self::samples(record, &input, &output);
        let directions = |back: bool| samples.iter().filter(|s| (s[0] > FORWARD) == back).count();
        if directions(false) < 20 || directions(true) < 20 {
            return Err(Invalid::new(
                "record",
                "no way forward from the bottom of its range with a way back",
                "such ways, for a network of one turning point is trained with them",
            ));
        }
        let turns: Vec<f64> = samples
            .iter()
            .map(|s| s[0])
            .filter(|turn| *turn > FORWARD)
            .collect();
        let spacing = Spectrum::of(record, &input, &output).map_or(SPACING, |s| s.spacing());
        let every = samples.len().div_ceil(2000);
        let thin: Vec<[f64; 3]> = samples.into_iter().step_by(every).collect();
        let forward: Vec<Sample> = thin.iter().map(|[v1, v, x]| ([*v1, *v], *x)).collect();
        let inverse: Vec<Sample> = thin.iter().map(|[v1, v, x]| ([*v1, *x], *v)).collect();
        let (forward, inverse) = (
            Network::tuned(spacing, &forward),
            Network::tuned(spacing, &inverse),
        );
        Self::new(input, output, Range::of(&turns), forward, inverse)
    }

    /// Of networks that are trained already: over these voltages and displacements, by ways back from turns in this
    /// range, units.
    ///
    /// # Errors
    ///
    /// When a range is empty or a network none.
    pub fn new(
        input: Range,
        output: Range,
        turns: Range,
        forward: Network,
        inverse: Network,
    ) -> Result<Self, Invalid> {
        let model = Self {
            input,
            output,
            turns,
            forward,
            inverse,
            everett: OnceLock::new(),
        };
        model.check()?;
        Ok(model)
    }

    /// Checks what was read from a file.
    pub(super) fn check(&self) -> Result<(), Invalid> {
        self.input.check("input")?;
        self.output.check("output")?;
        if self.turns.check("turns").is_err() && self.turns.low != self.turns.high {
            let value = format!("{} to {}", self.turns.low, self.turns.high);
            return Err(Invalid::new("turns", value, "a range of finite numbers"));
        }
        self.forward.check()?;
        self.inverse.check()?;
        // Now, and not in the first cycle of whoever aligns with it; copies share it.
        self.everett();
        Ok(())
    }

    fn everett(&self) -> &Everett {
        let of = || Arc::new(Everett::of(&self.forward, &self.turns));
        self.everett.get_or_init(of)
    }

    /// `(v1, vx, x)` in units of every sample of some weight that one turning point describes.
    pub fn samples(record: &Record, input: &Range, output: &Range) -> Vec<[f64; 3]> {
        let mut samples = Vec::with_capacity(record.len());
        for Swing { start, end, rising } in record.swings() {
            let at = |k: usize| input.to_units(record.input[k], UNITS);
            let from_bottom = at(start) < 0.05 * UNITS;
            let v1 = if rising { FORWARD } else { at(start) };
            // A way back counts if the way forward before it came from the bottom.
            let known = if rising {
                from_bottom
            } else {
                record.rises_from_bottom(start, 0.05)
            };
            if known {
                samples.extend((start..end).filter(|k| record.weight[*k] > 0.0).map(|k| {
                    let x = output.to_units(record.output[k], UNITS);
                    [v1, at(k), x]
                }));
            }
        }
        samples
    }

    /// The state of a piezo that has been cycled with falling amplitude around a voltage, and rests there.
    pub fn cycled(&self, volts: f64) -> RbfState {
        RbfState(Turns::cycled(
            self.everett(),
            self.input.to_units(volts, UNITS),
        ))
    }

    /// The displacement at the next voltage.
    pub fn displacement(&self, state: &mut RbfState, volts: f64) -> f64 {
        let RbfState(turns) = state;
        turns.follow(self.everett(), self.input.to_units(volts, UNITS));
        self.output.of_units(turns.displacement(), UNITS)
    }

    /// The voltage for the next wanted displacement, within `limits`.
    pub fn voltage(&self, state: &mut RbfState, wanted: f64, limits: &Range) -> f64 {
        let RbfState(turns) = state;
        let x = self.output.to_units(wanted, UNITS);
        let limits = Range {
            low: self.input.to_units(limits.low, UNITS),
            high: self.input.to_units(limits.high, UNITS),
        };
        let volts = turns.reach(self.everett(), x, &limits);
        self.input.of_units(volts, UNITS)
    }
}
