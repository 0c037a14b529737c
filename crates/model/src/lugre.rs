//! LuGre friction: a bristle that gives way, and a level that falls with speed.
//!
//! ```text
//! dz/dt = v - s_0 |v| z / g(v),   F = s_0 z + b v,   g(v) = f_c + (f_s - f_c) exp(-(v / v_s)^2)
//! ```
//!
//! C. Canudas de Wit, H. Olsson, K. Astrom and P. Lischinsky, *A New Model for Control of Systems with
//! Friction*, IEEE Transactions on Automatic Control 40(3), 1995, without the bristle's own damping.
//!
//! Taken here in the share `y = s_0 z / g` of the level that the bristle carries, with the stiffness
//! `s_0` at rest, `f_s / q_0`: `dy/dq = (1 - y sgn(v)) / q_0`, so that along one direction `y` is known
//! exactly and no step can be too long for it. What that leaves out is how the bristle settles while the
//! level changes, over a way of `q_0`.

use crate::Invalid;
use crate::friction::Friction;
use crate::presliding::Presliding;

/// LuGre friction without its viscous part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LuGre {
    fixed: f64,
    coulomb: f64,
    way: f64,
    stribeck: f64,
}

/// What a [`LuGre`] remembers: the share of the level that the bristle carried where the load turned
/// last.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BristleState {
    share: f64,
    turned_at: f64,
}

impl LuGre {
    /// Friction that rises to its static level along an exponential of `way` = `q_0` = `f_s / s_0` (rad),
    /// and falls to its Coulomb level above `stribeck` = `v_s` (rad/s).
    ///
    /// # Errors
    ///
    /// When the Coulomb level, the way or the velocity is not positive.
    pub fn new(friction: &Friction, way: f64, stribeck: f64) -> Result<Self, Invalid> {
        Ok(Self {
            fixed: friction.static_level(),
            coulomb: Invalid::positive("coulomb_friction", friction.coulomb())?,
            way: Invalid::positive("presliding", way)?,
            stribeck: Invalid::positive("stribeck", stribeck)?,
        })
    }

    /// Stiffness of the bristle at rest, `s_0`, N m/rad.
    pub fn initial_stiffness(&self) -> f64 {
        self.fixed / self.way
    }

    /// The level at a velocity, `g(v)`, N m.
    pub fn level(&self, velocity: f64) -> f64 {
        let ratio = velocity / self.stribeck;
        self.coulomb + (self.fixed - self.coulomb) * libm::exp(-ratio * ratio)
    }

    fn share(&self, state: &BristleState, angle: f64) -> f64 {
        let way = angle - state.turned_at;
        let end = if way < 0.0 { -1.0 } else { 1.0 };
        end + (state.share - end) * libm::exp(-way.abs() / self.way)
    }
}

impl Presliding for LuGre {
    type State = BristleState;

    #[inline]
    fn torque(&self, state: &BristleState, angle: f64, velocity: f64) -> f64 {
        self.level(velocity) * self.share(state, angle)
    }

    fn stiffness(&self, state: &BristleState, angle: f64) -> f64 {
        let end = if angle < state.turned_at { -1.0 } else { 1.0 };
        self.fixed * (1.0 - end * self.share(state, angle)) / self.way
    }

    fn turn(&self, state: &mut BristleState, angle: f64) {
        *state = BristleState {
            share: self.share(state, angle),
            turned_at: angle,
        };
    }

    fn output(&self, angle: f64, _: f64) -> f64 {
        angle
    }

    fn energy(&self, state: &BristleState, angle: f64) -> f64 {
        0.5 * self.fixed * self.way * self.share(state, angle).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bristle() -> LuGre {
        LuGre::new(&Friction::new(0.12, 0.1, 0.0).unwrap(), 5e-4, 1e-2).unwrap()
    }

    /// Against the differential equation in small steps, at a speed far below and far above `v_s`.
    #[test]
    fn it_is_the_solution_of_its_equation() {
        let law = bristle();
        for (speed, level) in [(1e-5, 0.12), (1.0, 0.1)] {
            let mut state = BristleState::default();
            law.turn(&mut state, 0.0);
            let stiffness = level / 5e-4;
            let (mut z, mut q) = (0.0_f64, 0.0);
            for turn in [1e-3, -2e-3, 5e-4] {
                let steps = 20_000;
                let step = (turn - q) / f64::from(steps);
                for _ in 0..steps {
                    // Heun's scheme in the way.
                    let rate = |z: f64| 1.0 - stiffness * step.signum() * z / level;
                    let first = rate(z);
                    z += step * 0.5 * (first + rate(z + step * first));
                    q += step;
                }
                let told = law.torque(&state, turn, speed * step.signum());
                assert!(
                    (told - stiffness * z).abs() < 1e-7,
                    "{told} {}",
                    stiffness * z
                );
                law.turn(&mut state, turn);
            }
        }
    }

    /// (2.20) with `Q = 4 q_0`: after a full load the reversal is one exponential.
    #[test]
    fn a_reversal_is_the_curve_of_the_windup_function() {
        let law = bristle();
        let mut state = BristleState::default();
        law.turn(&mut state, 1.0);
        for k in 0..100 {
            let way = 3e-5 * f64::from(k);
            let exact = -0.12 * (1.0 - 2.0 * (-4.0 * way / (4.0 * 5e-4)).exp());
            assert!((law.torque(&state, 1.0 - way, 0.0) - exact).abs() < 1e-12);
        }
    }

    proptest! {
        /// Around a closed loop work goes in, never out.
        #[test]
        fn stored_energy_is_never_more_than_the_work_done(turns in prop::collection::vec(-3e-3..3e-3_f64, 1..8)) {
            let law = bristle();
            let mut state = BristleState::default();
            let (mut q, mut work) = (0.0, 0.0);
            for to in turns {
                let steps = 400;
                let (from, step) = (q, (to - q) / f64::from(steps));
                for i in 0..steps {
                    work += law.torque(&state, from + (f64::from(i) + 0.5) * step, 0.0) * step;
                }
                law.turn(&mut state, to);
                q = to;
                prop_assert!(work - law.energy(&state, q) > -1e-9);
            }
        }
    }
}
