//! Hysteresis and creep of a piezo: why a micro axis is not where its voltage says.
//!
//! Hysteresis with memory, of the Prandtl-Ishlinskii family: play operators in parallel, each of
//! which follows its input only once a slack is taken up,
//!
//! ```text
//! v    = s + a s^2                               domains switch more readily one way
//! p_i <- max(v - r_i, min(v + r_i, p_i))         a play operator of half width r_i
//! y    = (1 - h) v + h sum w_i p_i
//! x    = c (y - b y^3)                           the material saturates
//! ```
//!
//! The plays wipe out: a closed excursion inside a loop leaves no trace once it is passed. With
//! `a` and `b` at zero, loops between the same two inputs are congruent; a measured piezo's are
//! not quite, nor are these.
//!
//! Creep is logarithmic in time: first-order relaxations with time constants a decade apart, each
//! worth the same share of what was applied.

#![expect(
    clippy::inline_always,
    clippy::needless_bitwise_bool,
    reason = "what is not inlined does not get the instructions of its caller, and a short cut is a branch"
)]

use crate::Invalid;
use std::sync::LazyLock;

/// Number of play operators of a [`Hysteresis`]: so many that a loop looks smooth.
pub const PLAYS: usize = 64;

/// So many of them are moved together.
const BLOCK: usize = 4;

/// Longest relaxation's and shortest relaxation's time constants lie five decades apart.
const RELAXATIONS: usize = 6;

/// Time constant of the fastest relaxation, seconds.
const FASTEST: f64 = 0.1;

/// `r_i`. Slacks beyond half the range never move; those near zero matter most just after a turn, so they lie closer there.
static SLACK: LazyLock<[f64; PLAYS]> =
    LazyLock::new(|| std::array::from_fn(|i| ((i as f64 + 0.5) / PLAYS as f64).powf(1.2)));

/// What of the plays' density does not depend on their spread: how far apart slacks lie.
static COMMON: LazyLock<[f64; PLAYS]> = LazyLock::new(|| SLACK.map(|r| r.powf(1.0 / 6.0)));

/// How a piezo's displacement follows its voltage, both as shares of half their range: -1 to +1.
#[derive(Debug, Clone, PartialEq)]
pub struct Hysteresis {
    /// `r_i`.
    slack: [f64; PLAYS],
    /// `h w_i`.
    weights: [f64; PLAYS],
    /// `1 - h`.
    direct: f64,
    /// `a`.
    skew: f64,
    /// `b`.
    saturation: f64,
    /// `c`, which makes the displacement's range that of the voltage.
    scale: f64,
}

/// What a [`Hysteresis`] remembers. Its default is a piezo that has been cycled with falling
/// amplitude around the middle of its range and rests there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HysteresisState {
    plays: [f64; PLAYS],
    /// What each block of plays adds up to.
    sums: [f64; PLAYS / BLOCK],
    input: f64,
    output: f64,
}

impl Default for HysteresisState {
    fn default() -> Self {
        Self {
            plays: [0.0; PLAYS],
            sums: [0.0; PLAYS / BLOCK],
            input: 0.0,
            output: 0.0,
        }
    }
}

/// What makes a [`Hysteresis`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HysteresisParameters {
    /// Largest difference between the way back and the way forward at one voltage, over full
    /// stroke, as a share of the range of displacement.
    pub opening: f64,
    /// Over which share of half the range the weights of the plays fall off: small ones make a
    /// loop that opens at once.
    pub spread: f64,
    /// `a`: how much a loop leans to one side.
    pub skew: f64,
    /// `b`: how much the displacement saturates.
    pub saturation: f64,
}

impl Hysteresis {
    /// The hysteresis with these parameters.
    ///
    /// # Errors
    ///
    /// When a parameter is out of the range in which displacement grows with voltage, or plays of
    /// this spread cannot open a loop so wide.
    pub fn new(parameters: &HysteresisParameters) -> Result<Self, Invalid> {
        let (hysteresis, reached) = Self::nearest(parameters)?;
        let HysteresisParameters {
            opening, spread, ..
        } = *parameters;
        if (reached - opening).abs() > 1e-3 {
            let accepted = format!("at most {reached:.3} with a spread of {spread}");
            return Err(Invalid::new("hysteresis", opening, accepted));
        }
        Ok(hysteresis)
    }

    /// The hysteresis whose loop is as near to these parameters as plays of this spread can open one, and its
    /// opening.
    ///
    /// # Errors
    ///
    /// When a parameter is out of the range in which displacement grows with voltage.
    pub fn nearest(parameters: &HysteresisParameters) -> Result<(Self, f64), Invalid> {
        let &HysteresisParameters {
            opening,
            spread,
            skew,
            saturation,
        } = parameters;
        if !(0.0..=0.3).contains(&opening) {
            return Err(Invalid::new("hysteresis", opening, "0 to 0.3"));
        }
        if !(0.1..=10.0).contains(&spread) {
            return Err(Invalid::new("spread", spread, "0.1 to 10"));
        }
        if skew.is_nan() || skew.abs() > 0.2 {
            return Err(Invalid::new("skew", skew, "-0.2 to 0.2"));
        }
        if !(0.0..=0.1).contains(&saturation) {
            return Err(Invalid::new("saturation", saturation, "0 to 0.1"));
        }
        let slack = *SLACK;
        let density: [f64; PLAYS] =
            std::array::from_fn(|i| (-(slack[i] / spread).powi(2)).exp() * COMMON[i]);
        let total: f64 = density.iter().sum();
        let with = |share: f64| Self {
            slack,
            weights: density.map(|w| share * w / total),
            direct: 1.0 - share,
            skew,
            saturation,
            scale: 1.0,
        };
        // Where the plays are over a cycle at full stroke does not depend on their share, and what they add up to grows with it.
        let alone = with(1.0);
        let strokes = alone.full_stroke();
        // The opening grows with the share of the plays, nearly in proportion.
        let (mut last, mut range) = ((0.0, 0.0), 2.0);
        let mut guess = 2.0 * opening;
        for _ in 0..6 {
            let now;
            (now, range) = alone.opening(&strokes, guess);
            let slope = (now - last.1) / (guess - last.0);
            last = (guess, now);
            if (now - opening).abs() < 1e-6 || slope == 0.0 || !slope.is_finite() {
                break;
            }
            guess = (guess + (opening - now) / slope).clamp(0.0, 0.95);
        }
        let (share, reached) = last;
        let mut hysteresis = with(share);
        hysteresis.scale = 2.0 / range;
        Ok((hysteresis, reached))
    }

    /// Over a cycle at full stroke from rest: `v`, and what the plays add up to, at the top, at each step back from there, and at
    /// each forward again.
    fn full_stroke(&self) -> Vec<[f64; 2]> {
        let mut plays = [0.0; PLAYS];
        let mut strokes = Vec::with_capacity(1 + 2 * (1 + STROKE as usize));
        self.take_along(&mut plays, 1.0, std::iter::once(1.0), &mut strokes);
        self.take_along(&mut plays, -1.0, back(), &mut strokes);
        self.take_along(&mut plays, 1.0, forward(), &mut strokes);
        strokes
    }

    /// One way on (1) or back (-1): behind a play that is not taken along none is, and what is behind the voltage by its slack adds
    /// up in closed form.
    fn take_along(
        &self,
        plays: &mut [f64; PLAYS],
        way: f64,
        inputs: impl Iterator<Item = f64>,
        strokes: &mut Vec<[f64; 2]>,
    ) {
        let (mut taken, mut v) = (0, 0.0);
        // Weights of those that are taken along, what these make of their slacks, and what the others add up to.
        let (mut weight, mut behind) = (0.0, 0.0);
        let mut others: f64 = self.weights.iter().zip(&*plays).map(|(w, p)| w * p).sum();
        for input in inputs {
            v = input + self.skew * input * input;
            while taken < PLAYS && way * (v - plays[taken]) > self.slack[taken] {
                let w = self.weights[taken];
                weight += w;
                behind += w * self.slack[taken];
                others -= w * plays[taken];
                taken += 1;
            }
            strokes.push([v, weight * v - way * behind + others]);
        }
        for (play, slack) in plays.iter_mut().zip(&self.slack).take(taken) {
            *play = v - way * slack;
        }
    }

    /// Largest opening as a share of the range, and the range, over a cycle at full stroke of which these are the steps, of a piezo
    /// whose plays weigh so many times as much as in these.
    fn opening(&self, strokes: &[[f64; 2]], times: f64) -> (f64, f64) {
        let direct = 1.0 - times * (1.0 - self.direct);
        let output = |[v, plays]: &[f64; 2]| self.saturated(direct * v + times * plays);
        let (back_from, forward_from) = (1, 2 + STROKE as usize);
        let (back, forward) = (&strokes[back_from..forward_from], &strokes[forward_from..]);
        let range = output(&strokes[0]) - output(&forward[0]);
        let widest = back
            .iter()
            .zip(forward.iter().rev())
            .fold(0.0_f64, |widest, (b, f)| widest.max(output(b) - output(f)));
        (widest / range, range)
    }

    /// The same piezo whose plays weigh `times` as much, as heat makes them, over the same range of displacement: of `w_i` that are `f`
    /// times as large a loop opens `f (1 - m) / (1 - f m)` times as wide but for saturation, `m = h sum w_i r_i`. `state` is what it
    /// remembers, which stays: where plays are does not depend on what they weigh. All of its displacement is the most they weigh.
    #[must_use]
    pub fn with_plays(&self, times: f64, state: &mut HysteresisState) -> Self {
        let share = 1.0 - self.direct;
        let times = times.clamp(0.0, share.max(f64::MIN_POSITIVE).recip());
        let mut changed = Self {
            weights: self.weights.map(|weight| times * weight),
            direct: 1.0 - times * share,
            scale: 1.0,
            ..self.clone()
        };
        // At the ends of a full stroke every play is its slack behind.
        let end = |input: f64, way: f64| {
            let v = input + changed.skew * input * input;
            let mut behind = HysteresisState {
                plays: changed.slack.map(|slack| v - way * slack),
                ..HysteresisState::default()
            };
            changed.add_up(&mut behind);
            changed.output(v, &behind.sums)
        };
        changed.scale = 2.0 / (end(1.0, 1.0) - end(-1.0, -1.0));
        changed.add_up(state);
        let v = state.input + changed.skew * state.input * state.input;
        state.output = changed.output(v, &state.sums);
        changed
    }

    /// What the blocks of plays add up to.
    fn add_up(&self, state: &mut HysteresisState) {
        let blocks = state.plays.as_chunks::<BLOCK>().0.iter();
        for ((sum, plays), weights) in state.sums.iter_mut().zip(blocks).zip(self.blocks()) {
            *sum = added(weights, plays);
        }
    }

    #[inline(always)]
    fn blocks(&self) -> &[[f64; BLOCK]] {
        self.weights.as_chunks::<BLOCK>().0
    }

    /// The displacement at the next voltage, both -1 to +1 over their range.
    #[inline(always)]
    pub fn advance(&self, state: &mut HysteresisState, input: f64) -> f64 {
        if input == state.input {
            return state.output;
        }
        state.input = input;
        let v = input + self.skew * input * input;
        let blocks = state.plays.as_chunks_mut::<BLOCK>().0.iter_mut();
        let mut moved = 0;
        for (plays, slack) in blocks.zip(self.slack.as_chunks::<BLOCK>().0) {
            let taken: [f64; BLOCK] = std::array::from_fn(|k| {
                let (low, high) = (v - slack[k], v + slack[k]);
                let p = if plays[k] < high { plays[k] } else { high };
                if p > low { p } else { low }
            });
            // Two plays are never farther apart than their slacks: behind one that is not taken along none is. (No short cut: all
            // of a block are compared at once.)
            if !(0..BLOCK).fold(false, |any, k| any | (taken[k] != plays[k])) {
                break;
            }
            *plays = taken;
            moved += 1;
        }
        // Apart from the above, in which a processor does all of a block at once.
        let blocks = state.plays.as_chunks::<BLOCK>().0.iter().zip(self.blocks());
        for (sum, (plays, weights)) in state.sums.iter_mut().zip(blocks).take(moved) {
            *sum = added(weights, plays);
        }
        state.output = self.output(v, &state.sums);
        state.output
    }

    /// The displacement at `v`, where blocks of plays add up to these.
    #[inline(always)]
    fn output(&self, v: f64, blocks: &[f64; PLAYS / BLOCK]) -> f64 {
        let mut sums = [0.0; BLOCK];
        for four in blocks.as_chunks::<BLOCK>().0 {
            for (sum, part) in sums.iter_mut().zip(four) {
                *sum += part;
            }
        }
        self.saturated(self.direct * v + (sums[0] + sums[1]) + (sums[2] + sums[3]))
    }

    /// `x` from `y`.
    #[inline(always)]
    fn saturated(&self, y: f64) -> f64 {
        self.scale * (y - self.saturation * y * y * y)
    }
}

/// What a block of plays adds.
#[inline(always)]
fn added(weights: &[f64; BLOCK], plays: &[f64; BLOCK]) -> f64 {
    let w: [f64; BLOCK] = std::array::from_fn(|k| weights[k] * plays[k]);
    (w[0] + w[1]) + (w[2] + w[3])
}

/// Steps from one end of a full stroke to the other.
const STROKE: u32 = 50;

/// From the top of a full stroke to its bottom.
fn back() -> impl Iterator<Item = f64> {
    stroke(1.0, -1.0)
}

fn forward() -> impl Iterator<Item = f64> {
    stroke(-1.0, 1.0)
}

fn stroke(from: f64, to: f64) -> impl Iterator<Item = f64> {
    (0..=STROKE).map(move |k| from + (to - from) * f64::from(k) / f64::from(STROKE))
}

/// Creep: after a step the displacement goes on by the same share in every decade of time from
/// 0.1 s to some hours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Creep {
    share: f64,
    /// Share of the way that each relaxation goes in one period.
    rates: [f64; RELAXATIONS],
    scale: f64,
}

/// What a [`Creep`] remembers: where each relaxation is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CreepState([f64; RELAXATIONS]);

impl Creep {
    /// Creep by `share` of a step in a decade of time, sampled every `period` seconds. Its gain is
    /// one for what has been applied a second ago.
    ///
    /// # Errors
    ///
    /// When the share is not between 0 and 0.1 or the period is not positive.
    pub fn new(share: f64, period: f64) -> Result<Self, Invalid> {
        if !(0.0..=0.1).contains(&share) {
            return Err(Invalid::new("creep", share, "0 to 0.1"));
        }
        Invalid::positive("period", period)?;
        let mut constant = FASTEST;
        let mut reached = 0.0;
        let rates = [(); RELAXATIONS].map(|()| {
            let rate = -(-period / constant).exp_m1();
            reached -= (-1.0 / constant).exp_m1();
            constant *= 10.0;
            rate
        });
        Ok(Self {
            share,
            rates,
            scale: 1.0 / (1.0 + share * reached),
        })
    }

    /// Advances `state` by one period under what is applied at once; what comes of it.
    #[inline(always)]
    pub fn advance(&self, state: &mut CreepState, applied: f64) -> f64 {
        let mut sum = 0.0;
        for (z, rate) in state.0.iter_mut().zip(&self.rates) {
            *z += rate * (applied - *z);
            sum += *z;
        }
        self.scale * (applied + self.share * sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PARAMETERS: HysteresisParameters = HysteresisParameters {
        opening: 0.15,
        spread: 0.7,
        skew: 0.04,
        saturation: 0.03,
    };

    fn ramp(from: f64, to: f64) -> impl Iterator<Item = f64> {
        (1..=200).map(move |k| from + (to - from) * f64::from(k) / 200.0)
    }

    #[test]
    fn a_full_stroke_opens_by_what_was_asked_for_and_spans_the_range() {
        for opening in [0.0, 0.05, 0.15, 0.2] {
            let model = Hysteresis::new(&HysteresisParameters {
                opening,
                ..PARAMETERS
            })
            .unwrap();
            let (reached, range) = model.opening(&model.full_stroke(), 1.0);
            assert!((reached - opening).abs() < 1e-5, "{reached} for {opening}");
            assert!((range - 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_full_stroke_takes_plays_along_as_step_by_step() {
        let model = Hysteresis::new(&PARAMETERS).unwrap();
        let mut state = HysteresisState::default();
        let inputs = std::iter::once(1.0).chain(back()).chain(forward());
        for (input, [v, plays]) in inputs.zip(model.full_stroke()) {
            model.advance(&mut state, input);
            let sum: f64 = state.sums.iter().sum();
            assert!((plays - sum).abs() < 1e-14, "{plays} {sum} at {v}");
        }
    }

    #[test]
    fn a_piezo_whose_plays_weigh_more_keeps_its_range_and_what_it_remembers() {
        let model = Hysteresis::new(&PARAMETERS).unwrap();
        let both = model.weights.iter().zip(&model.slack);
        let m: f64 = both.map(|(weight, slack)| weight * slack).sum();
        for times in [0.5, 1.0, 1.2] {
            let mut state = HysteresisState::default();
            for s in ramp(0.0, 0.8).chain(ramp(0.8, -0.3)) {
                model.advance(&mut state, s);
            }
            let mut before = state;
            let wider = model.with_plays(times, &mut state);
            assert_eq!(before.plays, state.plays);
            let (reached, range) = wider.opening(&wider.full_stroke(), 1.0);
            let expected = times * (1.0 - m) / (1.0 - times * m) * PARAMETERS.opening;
            assert!(
                (reached / expected - 1.0).abs() < 0.02,
                "{reached}, {expected} expected for {times}"
            );
            assert!((range - 2.0).abs() < 1e-12, "{range}");
            let mut back = state;
            let again = wider.with_plays(times.recip(), &mut back);
            for s in ramp(-0.3, 0.5) {
                let (a, b) = (model.advance(&mut before, s), again.advance(&mut back, s));
                assert!((a - b).abs() < 1e-12, "{a} {b}");
            }
        }
    }

    #[test]
    fn displacement_grows_with_voltage_on_every_branch() {
        let model = Hysteresis::new(&PARAMETERS).unwrap();
        let mut state = HysteresisState::default();
        let mut last = 0.0;
        for s in ramp(0.0, 1.0) {
            let x = model.advance(&mut state, s);
            assert!(x > last);
            last = x;
        }
        for s in ramp(1.0, -1.0) {
            let x = model.advance(&mut state, s);
            assert!(x < last);
            last = x;
        }
    }

    proptest! {
        /// Wiping out: an excursion that is passed again leaves no trace.
        #[test]
        fn a_closed_excursion_is_forgotten(low in -1.0..1.0_f64, back in 0.0..1.0_f64, on in 0.0..0.5_f64) {
            let model = Hysteresis::new(&PARAMETERS).unwrap();
            let (mut straight, mut astray) = (HysteresisState::default(), HysteresisState::default());
            for s in [1.0, low] {
                model.advance(&mut straight, s);
                model.advance(&mut astray, s);
            }
            for s in [low + back * (1.0 - low), low] {
                model.advance(&mut astray, s);
            }
            let next = low - on * (1.0 + low);
            let (a, b) = (model.advance(&mut straight, next), model.advance(&mut astray, next));
            prop_assert!((a - b).abs() < 1e-14, "{} {}", a, b);
        }

        /// Congruency, where the static parts are straight: the same two voltages, whatever came
        /// before, the same loop but for where it lies.
        #[test]
        fn loops_between_the_same_voltages_are_congruent(
            low in -0.9..0.0_f64, width in 0.01..0.9_f64, above in 0.0..1.0_f64, below in 0.0..1.0_f64,
        ) {
            let model = Hysteresis::new(&HysteresisParameters { skew: 0.0, saturation: 0.0, ..PARAMETERS }).unwrap();
            let high = low + width;
            let opening = |history: &[f64]| {
                let mut state = HysteresisState::default();
                for s in history.iter().chain(&[low, high, low]) {
                    model.advance(&mut state, *s);
                }
                let middle = 0.5 * (low + high);
                let up = model.advance(&mut state, middle);
                model.advance(&mut state, high);
                model.advance(&mut state, middle) - up
            };
            let one = opening(&[high + above * (1.0 - high)]);
            let other = opening(&[1.0, low - below * (1.0 + low)]);
            prop_assert!((one - other).abs() < 1e-14, "{} {}", one, other);
        }
    }

    #[test]
    fn creep_adds_the_same_share_in_every_decade() {
        let creep = Creep::new(0.02, 0.01).unwrap();
        let mut state = CreepState::default();
        let mut at = |seconds: f64| {
            let mut x = 0.0;
            for _ in 0..(seconds / 0.01) as u32 {
                x = creep.advance(&mut state, 1.0);
            }
            x
        };
        let (one, ten, hundred) = (at(1.0), at(9.0), at(90.0));
        assert!((one - 1.0).abs() < 1e-3, "{one}");
        for step in [ten - one, hundred - ten] {
            assert!((step - 0.02).abs() < 0.002, "{step}");
        }
    }

    #[test]
    fn what_is_no_piezo_is_refused() {
        for parameters in [
            HysteresisParameters {
                opening: 0.4,
                ..PARAMETERS
            },
            HysteresisParameters {
                skew: f64::NAN,
                ..PARAMETERS
            },
            HysteresisParameters {
                saturation: -0.1,
                ..PARAMETERS
            },
        ] {
            assert!(Hysteresis::new(&parameters).is_err(), "{parameters:?}");
        }
        assert!(Creep::new(0.2, 1e-3).is_err() && Creep::new(0.02, 0.0).is_err());
    }
}
