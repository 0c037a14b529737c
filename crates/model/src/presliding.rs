//! How a load gives way before it slides: laws of load friction.
//!
//! - [`Contact`], the thesis's: friction holds the load rigidly up to its static level, and the
//!   output in front of it yields through a contact stiffness, (2.12) and (2.13). The transition
//!   of a reversal is then as straight as the transmission.
//! - [`MaxwellSlip`]: friction is a bundle of springs that slip one after the other, so that it
//!   rises along a curve, remembers every reversal that still matters, and holds the load nowhere
//!   rigidly. With an exponential curve a linear transmission winds up exactly as (2.20) says,
//!   with `Q = 8 q_0`.
//! - [`LuGre`](crate::lugre::LuGre): one bristle that rises to its level along an exponential, and a level
//!   that falls with speed. A linear transmission winds up as (2.20) says, with `Q = 4 q_0`.

use crate::Invalid;
use std::fmt::Debug;

/// A law of how the load gives way.
pub trait Presliding: Copy + Debug + PartialEq {
    /// What it remembers.
    type State: Copy + Debug + Default + PartialEq;

    /// Whether [`Self::torque`] is always zero.
    const RIGID: bool = false;

    /// Torque against the load beside static, Coulomb and viscous friction, N m, at a load angle
    /// (rad) that has been approached in one direction since the last [`Self::turn`], and at a velocity
    /// (rad/s).
    fn torque(&self, state: &Self::State, angle: f64, velocity: f64) -> f64;

    /// Rate of change of [`Self::torque`] with the angle, N m/rad.
    fn stiffness(&self, state: &Self::State, angle: f64) -> f64;

    /// Notes that the load's velocity changes its sign at `angle`.
    fn turn(&self, state: &mut Self::State, angle: f64);

    /// Position of the output, radians, for a load at `angle` under a `friction` torque (N m).
    fn output(&self, angle: f64, friction: f64) -> f64;

    /// Energy that is stored, joules.
    fn energy(&self, state: &Self::State, angle: f64) -> f64;
}

/// A rigid hold, in front of it a contact stiffness `k_c` (2.13), N m/rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    stiffness: f64,
}

impl Contact {
    /// `k_c`, N m/rad.
    pub(crate) fn stiffness(self) -> f64 {
        self.stiffness
    }

    /// The contact of a body that gives way by `presliding` (rad) before it breaks away at
    /// `static_level` (N m). Infinitely stiff, so that (2.12) adds nothing, where there is no
    /// presliding or no friction.
    pub fn new(static_level: f64, presliding: f64) -> Self {
        Self {
            stiffness: if presliding > 0.0 && static_level > 0.0 {
                static_level / presliding
            } else {
                f64::INFINITY
            },
        }
    }
}

impl Presliding for Contact {
    type State = ();

    const RIGID: bool = true;

    #[inline]
    fn torque(&self, (): &(), _: f64, _: f64) -> f64 {
        0.0
    }

    #[inline]
    fn stiffness(&self, (): &(), _: f64) -> f64 {
        0.0
    }

    #[inline]
    fn turn(&self, (): &mut (), _: f64) {}

    /// (2.12): `q_o = q_l - F_l / k_c`.
    #[inline]
    fn output(&self, angle: f64, friction: f64) -> f64 {
        angle - friction / self.stiffness
    }

    fn energy(&self, (): &(), _: f64) -> f64 {
        0.0
    }
}

/// Number of elements of a [`MaxwellSlip`].
pub const ELEMENTS: usize = 24;

/// Maxwell-slip elements in parallel: springs `k_i`, each of which slips beyond a deflection
/// `r_i`. Loaded for the first time they follow `f (1 - exp(-q / q_0))` in straight pieces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaxwellSlip {
    stiffness: [f64; ELEMENTS],
    ways: [f64; ELEMENTS],
}

/// What a [`MaxwellSlip`] remembers: each element's deflection where the load turned last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementState {
    deflections: [f64; ELEMENTS],
    turned_at: f64,
}

impl Default for ElementState {
    fn default() -> Self {
        Self {
            deflections: [0.0; ELEMENTS],
            turned_at: 0.0,
        }
    }
}

impl MaxwellSlip {
    /// Elements that slide at `level` (N m) and rise to it over `way` = `q_0` (rad).
    ///
    /// # Errors
    ///
    /// When the level or the way is not positive.
    pub fn new(level: f64, way: f64) -> Result<Self, Invalid> {
        let level = Invalid::positive("coulomb_friction", level)?;
        let way = Invalid::positive("presliding", way)?;
        // Where the elements slip: as dense as the curve bends, exp(-q / 2 q_0) in equal steps.
        let at = |i: usize| {
            let left = 1.0 - i as f64 / (ELEMENTS + 1) as f64;
            (-2.0 * way * libm::log(left), 1.0 - left * left)
        };
        let full = at(ELEMENTS).1;
        let slope = |i: usize| {
            let ((q0, f0), (q1, f1)) = (at(i), at(i + 1));
            level * (f1 - f0) / (full * (q1 - q0))
        };
        Ok(Self {
            stiffness: std::array::from_fn(|i| {
                let after = if i + 1 < ELEMENTS { slope(i + 1) } else { 0.0 };
                slope(i) - after
            }),
            ways: std::array::from_fn(|i| at(i + 1).0),
        })
    }

    /// Stiffness while no element slips, N m/rad.
    pub fn initial_stiffness(&self) -> f64 {
        self.stiffness.iter().sum()
    }

    fn deflection(&self, state: &ElementState, i: usize, angle: f64) -> f64 {
        (state.deflections[i] + (angle - state.turned_at)).clamp(-self.ways[i], self.ways[i])
    }
}

impl Presliding for MaxwellSlip {
    type State = ElementState;

    #[inline]
    fn torque(&self, state: &ElementState, angle: f64, _: f64) -> f64 {
        (0..ELEMENTS)
            .map(|i| self.stiffness[i] * self.deflection(state, i, angle))
            .sum()
    }

    fn stiffness(&self, state: &ElementState, angle: f64) -> f64 {
        (0..ELEMENTS)
            .filter(|i| self.deflection(state, *i, angle).abs() < self.ways[*i])
            .map(|i| self.stiffness[i])
            .sum()
    }

    fn turn(&self, state: &mut ElementState, angle: f64) {
        *state = ElementState {
            deflections: std::array::from_fn(|i| self.deflection(state, i, angle)),
            turned_at: angle,
        };
    }

    fn output(&self, angle: f64, _: f64) -> f64 {
        angle
    }

    fn energy(&self, state: &ElementState, angle: f64) -> f64 {
        (0..ELEMENTS)
            .map(|i| 0.5 * self.stiffness[i] * self.deflection(state, i, angle).powi(2))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LEVEL: f64 = 0.12;
    const WAY: f64 = 5e-4;

    fn elements() -> MaxwellSlip {
        MaxwellSlip::new(LEVEL, WAY).unwrap()
    }

    fn virgin(q: f64) -> f64 {
        elements().torque(&ElementState::default(), q, 0.0)
    }

    #[test]
    fn a_first_loading_follows_the_exponential_and_ends_at_the_level() {
        for i in 0..=600 {
            let q = f64::from(i) * 0.01 * WAY;
            let exact = LEVEL * (1.0 - (-q / WAY).exp());
            assert!(
                (virgin(q) - exact).abs() < 2e-3 * LEVEL,
                "at {q}: {}",
                virgin(q)
            );
        }
        assert!((virgin(1.0) - LEVEL).abs() < 1e-12);
        assert!((virgin(-1.0) + LEVEL).abs() < 1e-12);
    }

    proptest! {
        /// Masing: after a full load a reversal is the first loading, twice as large.
        #[test]
        fn a_reversal_is_the_first_loading_doubled(way in 0.0..1e-2_f64) {
            let e = elements();
            let mut state = ElementState::default();
            e.turn(&mut state, 1.0);
            let fallen = e.torque(&state, 1.0, 0.0) - e.torque(&state, 1.0 - way, 0.0);
            prop_assert!((fallen - 2.0 * virgin(0.5 * way)).abs() < 1e-12);
        }

        /// A closed loop inside leaves no trace once it is passed.
        #[test]
        fn a_closed_loop_inside_is_forgotten(dip in 0.0..2e-3_f64, on in 0.0..2e-3_f64) {
            let e = elements();
            let (mut straight, mut dipped) = (ElementState::default(), ElementState::default());
            for state in [&mut straight, &mut dipped] {
                e.turn(state, 1.0);
            }
            let low = 1.0 - 3e-3;
            e.turn(&mut dipped, low);
            e.turn(&mut dipped, low + dip);
            let (a, b) = (e.torque(&straight, low - on, 0.0), e.torque(&dipped, low - on, 0.0));
            prop_assert!((a - b).abs() < 1e-12, "{} {}", a, b);
        }

        /// Around a closed loop work goes in, never out.
        #[test]
        fn stored_energy_is_never_more_than_the_work_done(turns in prop::collection::vec(-3e-3..3e-3_f64, 1..8)) {
            let e = elements();
            let mut state = ElementState::default();
            let (mut q, mut work) = (0.0, 0.0);
            for to in turns {
                let steps = 400;
                let (from, step) = (q, (to - q) / f64::from(steps));
                for i in 0..steps {
                    let middle = from + (f64::from(i) + 0.5) * step;
                    work += e.torque(&state, middle, 0.0) * step;
                }
                e.turn(&mut state, to);
                q = to;
                prop_assert!(work - e.energy(&state, q) > -1e-9 * LEVEL);
            }
        }
    }
}
