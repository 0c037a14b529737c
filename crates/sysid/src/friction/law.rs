//! Laws of friction against displacement.

use super::Sample;

/// A law of friction against displacement, slow enough that inertia has no part in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// The thesis's: up to its static level the contact gives way by `F / k_c` (2.12), with
    /// `k_c = f_s / q_p` (2.13); beyond it slides. Beside an offset of the force.
    Presliding,
    /// The same with a static level and a presliding of each direction.
    PreslidingTwoSided,
    /// P. Dahl, *A Solid Friction Model*, 1968: `dF/dq = s_0 (1 - F sgn(v) / f_c)^n`, beside an offset.
    Dahl,
    /// Maxwell-slip elements in parallel (generalised Maxwell slip, F. Al-Bender et al. 2005, without a
    /// Stribeck effect), of like force, that begin to slip at ways spread evenly from the first to the
    /// last; beside an offset.
    MaxwellSlip,
    /// C. Canudas de Wit et al., *A New Model for Control of Systems with Friction*, 1995:
    /// `F = s_0 z`, `dz/dt = v - s_0 |v| z / g(v)`, `g = f_c + (f_s - f_c) exp(-(v / v_s)^2)`.
    LuGre,
    /// The same with viscous friction and an offset.
    LuGreViscous,
}

impl Law {
    /// All of them, those with fewer parameters first.
    pub const ALL: [Self; 6] = [
        Self::Presliding,
        Self::PreslidingTwoSided,
        Self::Dahl,
        Self::MaxwellSlip,
        Self::LuGre,
        Self::LuGreViscous,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Presliding => "presliding",
            Self::PreslidingTwoSided => "presliding-two-sided",
            Self::Dahl => "dahl",
            Self::MaxwellSlip => "maxwell-slip",
            Self::LuGre => "lugre",
            Self::LuGreViscous => "lugre-viscous",
        }
    }

    /// Its parameters.
    pub fn parameters(self) -> &'static [&'static str] {
        match self {
            Self::Presliding => &["static_friction", "presliding", "offset"],
            Self::PreslidingTwoSided => &[
                "static_friction_forward",
                "presliding_forward",
                "static_friction_backward",
                "presliding_backward",
            ],
            Self::Dahl => &["coulomb_friction", "stiffness", "exponent", "offset"],
            Self::MaxwellSlip => &["coulomb_friction", "first_slip", "last_slip", "offset"],
            Self::LuGre => &[
                "coulomb_friction",
                "stiffness",
                "static_friction",
                "stribeck_velocity",
            ],
            Self::LuGreViscous => &[
                "coulomb_friction",
                "stiffness",
                "static_friction",
                "stribeck_velocity",
                "viscous_friction",
                "offset",
            ],
        }
    }

    /// Whether it needs to know how fast.
    pub fn needs_time(self) -> bool {
        matches!(self, Self::LuGre | Self::LuGreViscous)
    }

    /// What is fitted, numbers of order one, of the parameters: logarithms of those that are positive,
    /// offsets over `force`.
    pub(super) fn coded(self, p: &[f64], force: f64) -> Vec<f64> {
        match self {
            Self::Presliding => vec![p[0].ln(), p[1].ln(), p[2] / force],
            Self::PreslidingTwoSided => p.iter().map(|v| v.ln()).collect(),
            Self::Dahl => vec![p[0].ln(), p[1].ln(), p[2].ln(), p[3] / force],
            Self::MaxwellSlip => vec![p[0].ln(), p[1].ln(), (p[2] - p[1]).ln(), p[3] / force],
            Self::LuGre => vec![p[0].ln(), p[1].ln(), ratio(p), p[3].ln()],
            Self::LuGreViscous => vec![
                p[0].ln(),
                p[1].ln(),
                ratio(p),
                p[3].ln(),
                p[4] * p[3] / force,
                p[5] / force,
            ],
        }
    }

    /// The parameters of what is fitted.
    pub(super) fn decoded(self, c: &[f64], force: f64) -> Vec<f64> {
        match self {
            Self::Presliding => vec![c[0].exp(), c[1].exp(), c[2] * force],
            Self::PreslidingTwoSided => c.iter().map(|v| v.exp()).collect(),
            Self::Dahl => vec![c[0].exp(), c[1].exp(), c[2].exp(), c[3] * force],
            Self::MaxwellSlip => {
                let first = c[1].exp();
                vec![c[0].exp(), first, first + c[2].exp(), c[3] * force]
            }
            Self::LuGre => {
                let coulomb = c[0].exp();
                vec![
                    coulomb,
                    c[1].exp(),
                    coulomb * (MOST_RATIO * c[2].tanh()).exp(),
                    c[3].exp(),
                ]
            }
            Self::LuGreViscous => {
                let (coulomb, speed) = (c[0].exp(), c[3].exp());
                vec![
                    coulomb,
                    c[1].exp(),
                    coulomb * (MOST_RATIO * c[2].tanh()).exp(),
                    speed,
                    c[4] * force / speed,
                    c[5] * force,
                ]
            }
        }
    }

    /// Where a search may start: a level (N), a way over which it is reached (m or rad), a speed.
    pub(super) fn start(self, level: f64, way: f64, speed: f64) -> Vec<f64> {
        match self {
            Self::Presliding => vec![level, way, 0.0],
            Self::PreslidingTwoSided => vec![level, way, level, way],
            Self::Dahl => vec![level, 1.2 * level / way, 0.7, 0.0],
            Self::MaxwellSlip => vec![level, 0.5 * way, 1.5 * way, 0.0],
            Self::LuGre => vec![level, 1.5 * level / way, 1.1 * level, speed],
            Self::LuGreViscous => vec![level, 1.5 * level / way, 1.1 * level, speed, 0.0, 0.0],
        }
    }

    /// The way over which a level is reached, for parameters of this law.
    pub fn way(self, p: &[f64]) -> f64 {
        match self {
            Self::Presliding => p[1],
            Self::PreslidingTwoSided => p[1].min(p[3]),
            Self::MaxwellSlip => p[2],
            Self::Dahl | Self::LuGre | Self::LuGreViscous => p[0] / p[1],
        }
    }

    /// What it takes to slide forward and backward, N or N m, its offset among it.
    pub(super) fn sides(self, p: &[f64]) -> [f64; 2] {
        match self {
            Self::PreslidingTwoSided => [p[0], p[2]],
            _ => [p[0] + self.offset(p), p[0] - self.offset(p)],
        }
    }

    /// The ways over which the level is reached forward and backward: twice the integral of `1 - F / f` along a first loading,
    /// which is its end where a contact gives way evenly, and the elements' mean way of those in parallel. Infinite where it never ends.
    pub(super) fn ways(self, p: &[f64]) -> [f64; 2] {
        match self {
            Self::Presliding => [p[1]; 2],
            Self::PreslidingTwoSided => [p[1], p[3]],
            Self::MaxwellSlip => [0.5 * (p[1] + p[2]); 2],
            Self::Dahl if p[2] < 2.0 => [2.0 * p[0] / (p[1] * (2.0 - p[2])); 2],
            Self::Dahl => [f64::INFINITY; 2],
            Self::LuGre | Self::LuGreViscous => [2.0 * p[0] / p[1]; 2],
        }
    }

    /// Stiffness of a contact at rest, N/m or N m/rad, that of both directions together.
    pub(super) fn stiffness(self, p: &[f64]) -> f64 {
        match self {
            Self::Presliding => p[0] / p[1],
            Self::PreslidingTwoSided => 0.5 * (p[0] / p[1] + p[2] / p[3]),
            Self::Dahl | Self::LuGre | Self::LuGreViscous => p[1],
            Self::MaxwellSlip => {
                let each = (0..ELEMENTS).map(|e| 1.0 / slips(p, e));
                p[0] * each.sum::<f64>() / ELEMENTS as f64
            }
        }
    }

    /// Its offset.
    fn offset(self, p: &[f64]) -> f64 {
        match self {
            Self::Presliding => p[2],
            Self::Dahl | Self::MaxwellSlip => p[3],
            Self::LuGreViscous => p[5],
            Self::PreslidingTwoSided | Self::LuGre => 0.0,
        }
    }

    /// The force at every sample, newtons or newton metres. Where a stretch begins, the contact is taken
    /// to be in the state that the measured force says.
    pub fn predict(self, p: &[f64], samples: &[Sample]) -> Vec<f64> {
        let offset = self.offset(p);
        // A product where each element of each sample would take a quotient: elements are most of what a search costs.
        let stiff: [f64; ELEMENTS] = match self {
            Self::MaxwellSlip => std::array::from_fn(|e| slips(p, e).recip()),
            _ => [0.0; ELEMENTS],
        };
        let mut state = State::default();
        let mut last: Option<&Sample> = None;
        samples
            .iter()
            .map(|sample| {
                let bare = match last.filter(|_| !sample.begins) {
                    None => {
                        state = State::at(self, p, sample.force - offset);
                        state.force(self, p, 0.0)
                    }
                    Some(before) => {
                        let way = sample.displacement - before.displacement;
                        let time = sample.time - before.time;
                        let speed = if time > 0.0 { way / time } else { 0.0 };
                        state.moves(self, (p, &stiff), way, speed);
                        state.force(self, p, speed)
                    }
                };
                last = Some(sample);
                bare + offset
            })
            .collect()
    }
}

/// Static friction lies within a factor of ten of Coulomb friction: its logarithm is bounded so.
pub(super) const MOST_RATIO: f64 = std::f64::consts::LN_10;

fn ratio(p: &[f64]) -> f64 {
    ((p[2] / p[0]).ln() / MOST_RATIO)
        .clamp(-0.999, 0.999)
        .atanh()
}

/// Number of elements of a [`Law::MaxwellSlip`].
const ELEMENTS: usize = 24;

/// The way after which an element of a [`Law::MaxwellSlip`] slips.
fn slips(p: &[f64], element: usize) -> f64 {
    p[1] + (p[2] - p[1]) * (element as f64 + 0.5) / ELEMENTS as f64
}

/// `l` after a way, from `l' = -l^n`.
fn decayed(l: f64, way: f64, n: f64) -> f64 {
    let m = 1.0 - n;
    if m.abs() < 1e-6 {
        return l * (-way).exp();
    }
    if l <= 0.0 {
        return 0.0;
    }
    (l.powf(m) - m * way).max(0.0).powf(1.0 / m)
}

#[derive(Debug, Clone, Copy, Default)]
struct State {
    /// Deflection of the contact, or the force of a law that has no other state.
    contact: f64,
    /// Share of its way that each element is deflected.
    elements: [f64; ELEMENTS],
}

impl State {
    fn at(law: Law, p: &[f64], force: f64) -> Self {
        let mut state = Self::default();
        let share = |level: f64| (force / level).clamp(-1.0, 1.0);
        match law {
            Law::Presliding => state.contact = share(p[0]) * p[1],
            Law::PreslidingTwoSided => {
                state.contact = if force > 0.0 {
                    share(p[0]) * p[1]
                } else {
                    share(p[2]) * p[3]
                };
            }
            Law::Dahl => state.contact = share(p[0]) * p[0],
            Law::LuGre | Law::LuGreViscous => state.contact = share(p[2]) * p[2],
            Law::MaxwellSlip => state.elements = [share(p[0]); ELEMENTS],
        }
        state
    }

    /// `stiff` is one over the way after which each element slips.
    fn moves(&mut self, law: Law, (p, stiff): (&[f64], &[f64; ELEMENTS]), way: f64, speed: f64) {
        match law {
            Law::Presliding => self.contact = (self.contact + way).clamp(-p[1], p[1]),
            Law::PreslidingTwoSided => self.contact = (self.contact + way).clamp(-p[3], p[1]),
            Law::MaxwellSlip => {
                for (share, stiff) in self.elements.iter_mut().zip(stiff) {
                    *share = (*share + way * stiff).clamp(-1.0, 1.0);
                }
            }
            Law::Dahl => {
                // What is missing to the level falls by l' = -(s_0 / f_c) l^n along one direction.
                let (level, sign) = (p[0], way.signum());
                let missing = (1.0 - sign * self.contact / level).max(0.0);
                let residuals = decayed(missing, p[1] * way.abs() / level, p[2]);
                if way != 0.0 {
                    self.contact = (sign * level * (1.0 - residuals)).clamp(-level, level);
                }
            }
            Law::LuGre | Law::LuGreViscous => {
                let ratio = speed / p[3];
                let level = p[0] + (p[2] - p[0]) * (-ratio * ratio).exp();
                // dF/dq = s_0 (1 - F sgn(v) / g), exactly at one speed.
                let end = way.signum() * level;
                if way != 0.0 {
                    self.contact = end + (self.contact - end) * (-p[1] * way.abs() / level).exp();
                }
            }
        }
    }

    fn force(&self, law: Law, p: &[f64], speed: f64) -> f64 {
        match law {
            Law::Presliding => p[0] * self.contact / p[1],
            Law::PreslidingTwoSided if self.contact > 0.0 => p[0] * self.contact / p[1],
            Law::PreslidingTwoSided => p[2] * self.contact / p[3],
            Law::Dahl | Law::LuGre => self.contact,
            Law::LuGreViscous => self.contact + p[4] * speed,
            Law::MaxwellSlip => {
                // Four sums side by side.
                let mut sums = [0.0; 4];
                for part in self.elements.as_chunks::<4>().0 {
                    for (sum, share) in sums.iter_mut().zip(part) {
                        *sum += share;
                    }
                }
                p[0] * sums.iter().sum::<f64>() / ELEMENTS as f64
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against small steps by the midpoint, through both signs of `1 - n`.
    #[test]
    fn what_is_missing_decays_by_its_law() {
        for n in [0.4, 0.9, 1.0, 1.3, 2.0] {
            for start in [0.3, 2.0] {
                let (way, steps) = (0.35, 20_000);
                let h = way / f64::from(steps);
                let l = (0..steps).fold(start, |l: f64, _| {
                    let half = l - 0.5 * h * l.powf(n);
                    l - h * half.max(0.0).powf(n)
                });
                let exact = decayed(start, way, n);
                assert!((exact - l).abs() < 1e-6, "{n}, {start}: {exact} for {l}");
            }
            assert_eq!(decayed(0.0, 1.0, n), 0.0);
        }
    }
}
