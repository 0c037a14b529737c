//! Dynamics of a micro axis: a piezo bimorph on a flexure.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use crate::Invalid;
use crate::each::Each;

/// A damped resonance `x'' + 2 zeta w x' + w^2 x = w^2 u`, exact for inputs held over one period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resonance {
    /// State transition over one period; the state is deviation from the input, and velocity.
    transition: [[f64; 2]; 2],
}

/// Position and velocity of a [`Resonance`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ResonanceState {
    /// Position, in the unit of the input.
    pub position: f64,
    /// Velocity, input units a second.
    pub velocity: f64,
}

impl Resonance {
    /// A resonance at `frequency` (Hz, undamped) with `damping` ratio, sampled every `period`
    /// seconds.
    ///
    /// # Errors
    ///
    /// When frequency or period is not positive, or the damping is not between 0 and 1.
    pub fn new(frequency: f64, damping: f64, period: f64) -> Result<Self, Invalid> {
        Invalid::positive("frequency", frequency)?;
        Invalid::positive("period", period)?;
        if !(0.0..1.0).contains(&damping) {
            return Err(Invalid::new("damping", damping, "from 0 to below 1"));
        }
        let natural = std::f64::consts::TAU * frequency;
        let decay = damping * natural;
        let damped = natural * (1.0 - damping * damping).sqrt();
        let (sin, cos) = (damped * period).sin_cos();
        let shrink = (-decay * period).exp();
        Ok(Self {
            transition: [
                [shrink * (cos + decay / damped * sin), shrink * sin / damped],
                [
                    -shrink * natural * natural / damped * sin,
                    shrink * (cos - decay / damped * sin),
                ],
            ],
        })
    }

    /// Advances `state` by one period under a constant `input`.
    pub fn advance(&self, state: &mut ResonanceState, input: f64) {
        let mut states = ResonanceStates {
            position: Each([state.position]),
            velocity: Each([state.velocity]),
        };
        Resonances::new([*self]).advance(&mut states, Each([input]));
        (state.position, state.velocity) = (states.position[0], states.velocity[0]);
    }
}

/// Some [`Resonance`]s side by side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resonances<const N: usize> {
    transition: [[Each<N>; 2]; 2],
}

/// The [`ResonanceState`] of each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResonanceStates<const N: usize> {
    /// Positions, in the unit of the input.
    pub position: Each<N>,
    /// Velocities, input units a second.
    pub velocity: Each<N>,
}

impl<const N: usize> Default for ResonanceStates<N> {
    fn default() -> Self {
        Self {
            position: Each([0.0; N]),
            velocity: Each([0.0; N]),
        }
    }
}

impl<const N: usize> Resonances<N> {
    /// These, sampled with the same period.
    pub fn new(of: [Resonance; N]) -> Self {
        let part = |i: usize, k: usize| Each::of(|lane| of[lane].transition[i][k]);
        Self {
            transition: [[part(0, 0), part(0, 1)], [part(1, 0), part(1, 1)]],
        }
    }

    /// Advances all of them by one period, each under a constant `input`.
    #[inline(always)]
    pub fn advance(&self, states: &mut ResonanceStates<N>, input: Each<N>) {
        let [[a, b], [c, d]] = self.transition;
        let deviation = states.position - input;
        let velocity = states.velocity;
        states.position = input + a * deviation + b * velocity;
        states.velocity = c * deviation + d * velocity;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_closed_step_response() {
        let (f, zeta, period) = (200.0, 0.5, 4e-4);
        let resonance = Resonance::new(f, zeta, period).unwrap();
        let mut state = ResonanceState::default();
        let w = std::f64::consts::TAU * f;
        let wd = w * (1.0_f64 - zeta * zeta).sqrt();
        for k in 1..100 {
            resonance.advance(&mut state, 1.0);
            let t = f64::from(k) * period;
            let exact =
                1.0 - (-zeta * w * t).exp() * ((wd * t).cos() + zeta * w / wd * (wd * t).sin());
            assert!((state.position - exact).abs() < 1e-12);
        }
    }
}
