//! Windup of a transmission under the friction of its load (thesis 2.4.3, 2.4.4).
//!
//! Windup `W` is input less output, both as output angles: `W = r q_m - q_o` (2.18). Knowing it
//! from the history of the wanted output, the input that is needed is `q_o + W` (2.22), and what
//! the encoder says of the output is `r q_m - W` ((2.23), whose printed subscripts are exchanged).
//!
//! Two models of it:
//!
//! - [`Reversal`], the thesis's: a function of the way since the last reversal, (2.20), with an
//!   equivalent reversal position where the transmission was not fully wound, (2.24)-(2.26).
//! - [`Memory`]: Maxwell-slip elements, which remember every reversal that still matters, and a
//!   static hardening. It stays right after partial windup, where the thesis's jump to the
//!   opposite main curve errs by up to half of the maximum windup.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use serde::{Deserialize, Serialize};

/// The thesis's windup function (2.20).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reversal {
    /// Maximum windup `W_max`, radians of the output.
    pub maximum: f64,
    /// Way that winds the transmission up the other way, `Q`, radians of the output.
    pub way: f64,
}

/// What a [`Reversal`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReversalState {
    /// The output before, radians.
    last: f64,
    /// The (equivalent) reversal position, radians.
    reversal: f64,
    /// Direction of motion, -1 or +1; 0 before the first.
    direction: f64,
}

impl Reversal {
    /// `W = W_max s (1 - 2 exp(-4 d / Q))` (2.20) for a way `d >= 0` since the reversal in
    /// direction `s`.
    pub fn curve(&self, direction: f64, way: f64) -> f64 {
        self.maximum * direction * (1.0 - 2.0 * (-4.0 * way / self.way).exp())
    }

    /// The way into the curve of `direction` at which it has the windup `w`: (2.26), solved for
    /// the curve that is jumped to.
    fn way_at(&self, direction: f64, w: f64) -> f64 {
        let left = 0.5 * (1.0 - direction * w / self.maximum);
        // Fully wound in the new direction the curve is never reached; nearly is far enough.
        -0.25 * self.way * left.max(1e-9).ln()
    }

    /// The windup at the next output, radians.
    #[inline]
    pub fn next(&self, state: &mut ReversalState, output: f64) -> f64 {
        let step = output - state.last;
        if step != 0.0 {
            let direction = step.signum();
            if direction != state.direction {
                let w = self.now(state);
                // Equivalent reversal position (2.24): the new curve goes through the present
                // windup.
                state.reversal = state.last - direction * self.way_at(direction, w);
                state.direction = direction;
            }
            state.last = output;
        }
        self.now(state)
    }

    /// The windup now, radians; zero before the first motion.
    pub fn now(&self, state: &ReversalState) -> f64 {
        if state.direction == 0.0 {
            return 0.0;
        }
        self.curve(
            state.direction,
            (state.last - state.reversal) * state.direction,
        )
    }
}

/// Number of elements of a [`Memory`].
pub const ELEMENTS: usize = 16;

/// Number of powers of the torque in the hardening of a [`Memory`].
pub const POWERS: usize = 5;

/// Maxwell-slip elements in parallel and a static hardening:
///
/// ```text
/// s_i <- clamp(s_i + dq, +-r_i)        each element gives way, then slips
/// T   =  sum k_i s_i                   the torque that winds the transmission up
/// W   =  h_1 T + h_2 T^2 + ... + h_5 T^5     the transmission hardens
/// ```
///
/// The even powers are those of a preload: with one, winding up further and unwinding are not alike.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Way after which each element slips, `r_i`, radians of the output, rising.
    pub ways: [f64; ELEMENTS],
    /// Stiffness of each element, `k_i`; the sum of `k_i r_i` is one.
    pub stiffness: [f64; ELEMENTS],
    /// `h_1` to `h_5`, radians.
    pub hardening: [f64; POWERS],
}

/// What a [`Memory`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MemoryState {
    last: f64,
    /// The windup there.
    windup: f64,
    deflections: [f64; ELEMENTS],
}

impl MemoryState {
    /// How far each element has given way, radians.
    pub fn deflections(&self) -> &[f64; ELEMENTS] {
        &self.deflections
    }
}

impl Memory {
    /// The windup at the next output, radians. The state must be one of this memory.
    #[inline(always)]
    pub fn next(&self, state: &mut MemoryState, output: f64) -> f64 {
        let step = output - state.last;
        state.last = output;
        if step != 0.0 {
            let deflections = state.deflections.as_chunks_mut::<4>().0.iter_mut();
            for (deflections, ways) in deflections.zip(self.ways.as_chunks::<4>().0) {
                // Four are worked out before one is written, so that they are at once. Comparisons, for `f64::min` asks what is no
                // number, too.
                *deflections = std::array::from_fn(|k| {
                    let (moved, way) = (deflections[k] + step, ways[k]);
                    let low = if moved > -way { moved } else { -way };
                    if low < way { low } else { way }
                });
            }
            // Most axes stand still while others move.
            state.windup = self.now(state);
        }
        state.windup
    }

    /// The windup now, radians.
    #[inline(always)]
    pub fn now(&self, state: &MemoryState) -> f64 {
        // Four sums that do not wait for one another.
        let mut sums = [0.0; 4];
        let deflections = state.deflections.as_chunks::<4>().0;
        for (s, k) in deflections.iter().zip(self.stiffness.as_chunks::<4>().0) {
            sums = std::array::from_fn(|i| sums[i] + s[i] * k[i]);
        }
        polynomial(&self.hardening, (sums[0] + sums[1]) + (sums[2] + sums[3]))
    }
}

/// `h_1 x + h_2 x^2 + ... + h_5 x^5`.
#[inline(always)]
pub fn polynomial(hardening: &[f64; POWERS], x: f64) -> f64 {
    x * hardening.iter().rev().fold(0.0, |sum, h| sum * x + h)
}

/// A model of windup, or none.
#[expect(
    clippy::large_enum_variant,
    reason = "there are six of them, and the servo loop must not follow a pointer for each"
)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Windup {
    /// No compensation.
    #[default]
    None,
    /// The thesis's.
    Reversal(Reversal),
    /// With full memory.
    Memory(Memory),
}

/// What a [`Windup`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WindupState {
    reversal: ReversalState,
    memory: MemoryState,
}

impl Windup {
    /// The windup at the next wanted output, radians: what (2.22) adds to it.
    #[inline(always)]
    pub fn next(&self, state: &mut WindupState, output: f64) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Reversal(model) => model.next(&mut state.reversal, output),
            Self::Memory(model) => model.next(&mut state.memory, output),
        }
    }

    /// The windup now, radians: what (2.23) takes off an encoder's reading.
    pub fn now(&self, state: &WindupState) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Reversal(model) => model.now(&state.reversal),
            Self::Memory(model) => model.now(&state.memory),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const THESIS: Reversal = Reversal {
        maximum: 50e-6,
        way: 200e-6,
    };

    fn play(model: &Reversal, path: &[f64]) -> Vec<f64> {
        let mut state = ReversalState::default();
        path.iter().map(|q| model.next(&mut state, *q)).collect()
    }

    /// From one end to another in small steps.
    fn ramp(from: f64, to: f64) -> impl Iterator<Item = f64> {
        (1..=500).map(move |k| from + (to - from) * f64::from(k) / 500.0)
    }

    #[test]
    fn fully_wound_it_follows_the_curve_from_the_reversal() {
        let path: Vec<f64> = ramp(0.0, 1e-3).chain(ramp(1e-3, 0.0)).collect();
        let w = play(&THESIS, &path);
        assert!((w[499] - 50e-6).abs() < 1e-9);
        for (q, w) in path[500..].iter().zip(&w[500..]) {
            let exact = THESIS.curve(-1.0, 1e-3 - q);
            assert!((w - exact).abs() < 1e-9, "{w} for {exact}");
        }
    }

    #[test]
    fn a_partial_reversal_is_continuous() {
        let path: Vec<f64> = ramp(0.0, 1e-3)
            .chain(ramp(1e-3, 0.96e-3))
            .chain(ramp(0.96e-3, 1.1e-3))
            .collect();
        let w = play(&THESIS, &path);
        for (a, b) in w.iter().zip(&w[1..]).skip(2) {
            assert!((a - b).abs() < 2e-6, "{a} then {b}");
        }
    }

    fn memory() -> Memory {
        let ways = std::array::from_fn(|i| 10e-6 * (i + 1) as f64);
        let weight = ways.iter().sum::<f64>();
        Memory {
            ways,
            stiffness: [1.0 / weight; ELEMENTS],
            hardening: [50e-6, 0.0, -8e-6, 0.0, 1e-6],
        }
    }

    proptest! {
        /// Wiping out: a closed loop inside leaves no trace once it is passed.
        #[test]
        fn a_closed_loop_inside_is_forgotten(dip in 0.0..300e-6_f64, on in 1e-6..200e-6_f64) {
            let model = memory();
            let (mut straight, mut dipped) = (MemoryState::default(), MemoryState::default());
            for q in [1e-3, 0.6e-3] {
                model.next(&mut straight, q);
                model.next(&mut dipped, q);
            }
            // Up and back down to where it was, then further down.
            model.next(&mut dipped, 0.6e-3 + dip);
            model.next(&mut dipped, 0.6e-3);
            let a = model.next(&mut straight, 0.6e-3 - on);
            let b = model.next(&mut dipped, 0.6e-3 - on);
            prop_assert!((a - b).abs() < 1e-15, "{} {}", a, b);
        }

        /// Masing: a reversal curve is the virgin curve twice as large, before the hardening.
        #[test]
        fn a_reversal_is_the_virgin_curve_doubled(way in 0.0..300e-6_f64) {
            let model = Memory { hardening: [50e-6, 0.0, 0.0, 0.0, 0.0], ..memory() };
            let (mut virgin, mut back) = (MemoryState::default(), MemoryState::default());
            let top = model.next(&mut back, 5e-3);
            let fallen = top - model.next(&mut back, 5e-3 - way);
            let risen = model.next(&mut virgin, 0.5 * way);
            prop_assert!((fallen - 2.0 * risen).abs() < 1e-15);
        }
    }
}
