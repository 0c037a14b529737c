//! A model of hysteresis for any history: play operators, a static curve, and creep.
//!
//! ```text
//! p_i <- max(v - r_i, min(v + r_i, p_i))            play operators
//! h    = sum w_i p_i                                 w_i >= 0, r_0 = 0
//! u - c_2 u^2 - c_3 u^3 = b + h                      u leans and saturates
//! z_k' = (u - z_k) / tau_k                           creep, a share of the displacement
//! x    = u + sum s_k z_k
//! ```
//!
//! Every step has a direct inverse: from a wanted displacement follows `u`, from that `h`, and from
//! `h` the voltage, for the plays are a piecewise straight line from where they are. That is the
//! known inverse of the operator, an operator of the same kind, without a second state that could
//! part from the first.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::{Invalid, Range};
use pigtail_model::each::{Each, held};
use serde::{Deserialize, Serialize};

/// Number of play operators, the first of which has no slack.
pub(super) const PLAYS: usize = 24;

/// Highest power of the static curve.
pub(super) const DEGREE: usize = 3;

/// Number of relaxations: two a decade, for a sum of them a decade apart goes by waves.
pub(super) const RELAXATIONS: usize = 12;

/// The static curve of a model rises at least so far to either side.
const RISES: f64 = 1.3;

/// A model of hysteresis for any history.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Memory {
    /// The voltages it was identified with: `v` is -1 to +1 over them.
    pub input: Range,
    /// The displacements that `x` is -1 to +1 over.
    pub output: Range,
    /// `r_i`, rising from zero.
    pub slack: [f64; PLAYS],
    /// `w_i`.
    pub weights: [f64; PLAYS],
    /// `b`.
    pub offset: f64,
    /// `c_2` and `c_3`.
    pub curve: [f64; DEGREE - 1],
    /// `tau_k`, seconds.
    pub constants: [f64; RELAXATIONS],
    /// `s_k`.
    pub shares: [f64; RELAXATIONS],
    /// By how much the displacement's record lags behind the voltage's, seconds; below zero where it was read before the voltage of its row.
    pub lag: f64,
}

/// What a [`Memory`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MemoryState {
    /// Where the plays are, but for those that are taken along: where these are follows from the voltage.
    plays: [f64; PLAYS],
    /// Where the voltage is, which is where the play without slack is.
    v: f64,
    /// `h` of these plays.
    sum: f64,
    /// The direction in which the voltage has gone of late, and how many plays it takes along.
    engaged: (f64, usize),
    relaxations: [f64; RELAXATIONS],
    /// Share of the way that each relaxation goes in a step of `period`.
    rates: [f64; RELAXATIONS],
    /// What a unit of each relaxation adds to the displacement after it.
    kept: [f64; RELAXATIONS],
    /// The `u` that a unit of displacement takes, of which the relaxations make a part.
    share: f64,
    period: f64,
    /// What the first plays together add for a way that they are taken along: of one of them, of two...
    slopes: [f64; PLAYS],
}

/// Sum of products, in four sums that do not wait for one another.
#[inline(always)]
fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    let mut sums = Each([0.0; 4]);
    for (a, b) in a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0) {
        sums = sums + Each(*a) * Each(*b);
    }
    let Each([p, q, r, s]) = sums;
    (p + q) + (r + s)
}

impl MemoryState {
    /// How far each play of a model has been taken along, in its unit of voltage.
    pub(super) fn plays(&self, model: &Memory) -> [f64; PLAYS] {
        let mut placed = *self;
        placed.place(model);
        placed.plays
    }

    /// Puts the plays that are taken along where the voltage has brought them.
    fn place(&mut self, model: &Memory) {
        let (direction, taken) = self.engaged;
        for (play, slack) in self.plays[..taken].iter_mut().zip(&model.slack) {
            *play = self.v - direction * slack;
        }
    }

    /// Where each relaxation is.
    pub fn relaxations(&self) -> &[f64; RELAXATIONS] {
        &self.relaxations
    }

    #[inline(always)]
    fn set_period(&mut self, model: &Memory, period: f64) {
        if period != self.period {
            self.period = period;
            self.rates = model
                .constants
                .map(|constant| -(-period / constant).exp_m1());
            self.kept = std::array::from_fn(|k| model.shares[k] * (1.0 - self.rates[k]));
            let mut slope = 0.0;
            self.slopes = model.weights.map(|weight| {
                slope += weight;
                slope
            });
            self.share = 1.0 / (1.0 + dot(&model.shares, &self.rates));
        }
    }

    /// Advances the relaxations by one period under `u`.
    #[inline(always)]
    fn creep(&mut self, u: f64) {
        for (z, rate) in self.relaxations.iter_mut().zip(&self.rates) {
            *z += rate * (u - *z);
        }
    }
}

impl Memory {
    /// The usual slacks: from zero to half the range, closer together where they are small, for what
    /// a piezo does just after a turn, in a climb or against its creep, is done by those.
    pub fn usual_slack() -> [f64; PLAYS] {
        std::array::from_fn(|i| (i as f64 / PLAYS as f64).powf(1.5))
    }

    /// Checks what was read from a file.
    ///
    /// # Errors
    ///
    /// When the plays are not in order, their weights negative, or the displacement would not
    /// grow with the voltage.
    pub fn check(&self) -> Result<(), Invalid> {
        let rising = self.slack[0] == 0.0 && self.slack.windows(2).all(|w| w[1] > w[0]);
        if !rising || !self.slack[PLAYS - 1].is_finite() {
            let accepted = "finite slacks that rise from zero";
            return Err(Invalid::new("slack", format!("{:?}", self.slack), accepted));
        }
        let good = |w: &f64| *w >= 0.0 && w.is_finite();
        if !self.weights.iter().all(good) || self.weights[0] <= 0.0 {
            return Err(Invalid::new(
                "weights",
                format!("{:?}", self.weights),
                "finite weights of zero or more, the first above zero",
            ));
        }
        if !self.shares.iter().all(good)
            || !self.constants.iter().all(|c| *c > 0.0 && c.is_finite())
        {
            return Err(Invalid::new(
                "shares",
                format!("{:?}", self.shares),
                "finite shares of zero or more, time constants above zero",
            ));
        }
        let edges = [-RISES, -0.5 * RISES, 0.0, 0.5 * RISES, RISES];
        if !edges.iter().all(|x| self.bend(*x).1 > 0.05) {
            return Err(Invalid::new(
                "curve",
                format!("{:?}", self.curve),
                "a curve that rises over the whole range",
            ));
        }
        if !(self.offset.is_finite() && self.lag.is_finite()) {
            return Err(Invalid::new("offset", self.offset, "finite numbers"));
        }
        self.input.check("input")?;
        self.output.check("output")
    }

    /// Number of play operators that count.
    pub fn functions(&self) -> usize {
        self.weights.iter().filter(|w| **w > 0.0).count()
    }

    /// `u - c_2 u^2 - c_3 u^3`, and its slope.
    #[inline(always)]
    fn bend(&self, u: f64) -> (f64, f64) {
        let [c2, c3] = self.curve;
        (
            u * (1.0 - u * (c2 + u * c3)),
            1.0 - u * (2.0 * c2 + 3.0 * u * c3),
        )
    }

    /// The `u` whose [`Self::bend`] is `y`.
    fn straighten(&self, y: f64) -> f64 {
        let [c2, c3] = self.curve;
        let y = y.clamp(-1.5, 1.5);
        // The series of the inverse, so that few steps are left.
        let mut u = y * (1.0 + y * (c2 + y * (2.0 * c2 * c2 + c3)));
        for _ in 0..8 {
            let (value, slope) = self.bend(u);
            let step = (value - y) / slope.max(0.05);
            u = (u - step).clamp(-2.0, 2.0);
            // The error that is left is about the square of the step.
            if step.abs() < 1e-8 {
                break;
            }
        }
        u
    }

    /// Lets the plays follow the voltage `v`; `u`, what comes of it at once.
    pub(super) fn at_once(&self, state: &mut MemoryState, v: f64) -> f64 {
        self.straighten(self.offset + self.follow(state, v))
    }

    /// Lets the plays follow the voltage `v`; `h`.
    fn follow(&self, state: &mut MemoryState, v: f64) -> f64 {
        state.place(self);
        let mut moved = false;
        for (play, slack) in state.plays.iter_mut().zip(&self.slack) {
            let (low, high) = (v - slack, v + slack);
            let p = if *play < high { *play } else { high };
            let p = if p > low { p } else { low };
            // Two plays are never farther apart than their slacks: behind one that is not taken along none is.
            if p == *play {
                break;
            }
            *play = p;
            moved = true;
        }
        if moved {
            state.sum = dot(&state.plays, &self.weights);
            (state.v, state.engaged) = (state.plays[0], (0.0, 1));
        }
        state.sum
    }

    /// The voltage at which the plays add up to `h`, from where they are; its direction from there, and how many
    /// plays are taken along.
    #[inline(always)]
    fn invert(&self, state: &mut MemoryState, h: f64) -> (f64, f64, usize) {
        let way = h - state.sum;
        let (direction, mut left) = (1.0_f64.copysign(way), way.abs());
        // Going on, one play after the other is taken along, for slacks rise: each makes the line steeper. Those that were
        // taken along before are so until the voltage turns round.
        let mut v = state.v;
        let (before, mut taken) = state.engaged;
        if before != direction {
            state.place(self);
            taken = 1;
        }
        let mut slope = state.slopes[taken - 1];
        while taken < PLAYS {
            let next = state.plays[taken] + direction * self.slack[taken];
            let way = (direction * (next - v)).max(0.0);
            if way * slope >= left {
                break;
            }
            left -= way * slope;
            v += direction * way;
            slope = state.slopes[taken];
            taken += 1;
        }
        (v + direction * left / slope, direction, taken)
    }

    /// The displacement after `period` seconds at the next voltage.
    pub fn displacement(&self, state: &mut MemoryState, volts: f64, period: f64) -> f64 {
        state.set_period(self, period);
        let u = self.at_once(state, self.input.to_share(volts));
        state.creep(u);
        self.output
            .of_share(u + dot(&self.shares, &state.relaxations))
    }

    /// What has to come of the voltage at once, `u`, for a displacement that is wanted after `period` seconds, and the `h` that makes it.
    #[inline(always)]
    pub fn asked(&self, state: &mut MemoryState, wanted: f64, period: f64) -> (f64, f64) {
        state.set_period(self, period);
        // What the relaxations will have come to depends on u itself, linearly.
        let crept = dot(&state.kept, &state.relaxations);
        let u = (self.output.to_share(wanted) - crept) * state.share;
        // Far beyond the range the static curve would turn back.
        let (y, _) = self.bend(u.clamp(-1.5, 1.5));
        (u, y - self.offset)
    }

    /// The voltage that brings about what was [`Self::asked`], within `limits`.
    #[inline(always)]
    pub fn answer(&self, state: &mut MemoryState, (u, h): (f64, f64), limits: &Range) -> f64 {
        let (v, direction, taken) = self.invert(state, h);
        let asked = self.input.of_share(v);
        let volts = held(asked, limits.low, limits.high);
        let u = if volts == asked && u.abs() <= RISES {
            // What was asked for comes of it.
            (state.v, state.sum, state.engaged) = (v, h, (direction, taken));
            u
        } else {
            self.at_once(state, self.input.to_share(volts))
        };
        state.creep(u);
        volts
    }

    /// The voltage at which the displacement is the wanted one after `period` seconds, within
    /// `limits`.
    #[inline(always)]
    pub fn voltage(
        &self,
        state: &mut MemoryState,
        wanted: f64,
        period: f64,
        limits: &Range,
    ) -> f64 {
        let asked = self.asked(state, wanted, period);
        self.answer(state, asked, limits)
    }

    /// The state of a piezo cycled with falling amplitude around the middle of its range, and at
    /// rest there.
    pub fn switched_on(&self) -> MemoryState {
        self.resting([0.0; PLAYS])
    }

    /// A state as after a long rest at `volts`, with nothing remembered.
    pub fn at_rest(&self, volts: f64) -> MemoryState {
        self.resting([self.input.to_share(volts); PLAYS])
    }

    fn resting(&self, plays: [f64; PLAYS]) -> MemoryState {
        let sum = dot(&plays, &self.weights);
        MemoryState {
            v: plays[0],
            plays,
            sum,
            engaged: (0.0, 1),
            relaxations: [self.straighten(self.offset + sum); RELAXATIONS],
            rates: [0.0; RELAXATIONS],
            kept: [0.0; RELAXATIONS],
            share: 1.0,
            period: 0.0,
            slopes: [0.0; PLAYS],
        }
    }
}
