//! Laws of friction under which an identified axis can be replayed.

use super::replay::Axis;
use pigtail_model::Invalid;
use pigtail_model::friction::Friction;
use pigtail_model::lugre::{BristleState, LuGre};
use pigtail_model::presliding::{ElementState, MaxwellSlip, Presliding};

/// How an identified axis gives way before it slides. Each law slides at the axis's Coulomb levels.
#[expect(clippy::large_enum_variant, reason = "one is made for a whole replay")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sliding {
    /// Not at all.
    Coulomb,
    /// The thesis's: held rigidly, the output in front of it yields by at most this way (2.12), (2.13).
    CoulombPresliding(f64),
    /// Maxwell-slip elements of a level of one.
    MaxwellSlip(MaxwellSlip),
    /// LuGre of a Coulomb level of one.
    LuGre(LuGre),
}

impl Sliding {
    /// Maxwell-slip elements that rise along an exponential of `way` (m or rad).
    ///
    /// # Errors
    ///
    /// When the way is not positive.
    pub fn maxwell_slip(way: f64) -> Result<Self, Invalid> {
        MaxwellSlip::new(1.0, way).map(Self::MaxwellSlip)
    }

    /// LuGre that rises along an exponential of `way` to `ratio` times the Coulomb level, and falls to it
    /// above `stribeck` (m/s or rad/s).
    ///
    /// # Errors
    ///
    /// When the way or the velocity is not positive, or the ratio below one.
    pub fn lugre(way: f64, ratio: f64, stribeck: f64) -> Result<Self, Invalid> {
        let friction = Friction::new(ratio, 1.0, 0.0)?;
        LuGre::new(&friction, way, stribeck).map(Self::LuGre)
    }
}

/// An axis that moves under a law.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moving<'a> {
    axis: &'a Axis,
    law: &'a Sliding,
    place: f64,
    velocity: f64,
    elements: ElementState,
    bristle: BristleState,
    /// The last friction, for the contact's yield.
    friction: f64,
}

impl<'a> Moving<'a> {
    pub(super) fn new(axis: &'a Axis, law: &'a Sliding, place: f64, velocity: f64) -> Self {
        let mut moving = Self {
            axis,
            law,
            place,
            velocity,
            elements: ElementState::default(),
            bristle: BristleState::default(),
            friction: 0.0,
        };
        moving.turn();
        moving
    }

    /// What a sensor at the output sees.
    pub(super) fn output(&self) -> f64 {
        match self.law {
            Sliding::CoulombPresliding(way) => {
                let level = if self.friction > 0.0 {
                    self.axis.coulomb[0]
                } else {
                    self.axis.coulomb[1]
                };
                // Friction holds against what pushes, and the output gives way with the push.
                if level > 0.0 {
                    self.place + way * (self.friction / level).clamp(-1.0, 1.0)
                } else {
                    self.place
                }
            }
            _ => self.place,
        }
    }

    fn turn(&mut self) {
        match self.law {
            Sliding::MaxwellSlip(law) => law.turn(&mut self.elements, self.place),
            Sliding::LuGre(law) => law.turn(&mut self.bristle, self.place),
            Sliding::Coulomb | Sliding::CoulombPresliding(_) => {}
        }
    }

    /// Friction beside the viscous part, positive against forward motion.
    fn held(&self, place: f64, velocity: f64) -> f64 {
        let share = match self.law {
            Sliding::MaxwellSlip(law) => law.torque(&self.elements, place, velocity),
            Sliding::LuGre(law) => law.torque(&self.bristle, place, velocity),
            Sliding::Coulomb | Sliding::CoulombPresliding(_) => 0.0,
        };
        share * self.axis.coulomb[usize::from(share < 0.0)]
    }

    /// A period under a held voltage.
    pub(super) fn advance(&mut self, voltage: f64, period: f64) {
        let stiffness = match self.law {
            Sliding::Coulomb | Sliding::CoulombPresliding(_) => {
                let force = self.axis.force_per_volt * voltage - self.axis.offset;
                (self.place, self.velocity) =
                    self.axis
                        .advance((self.place, self.velocity), voltage, period);
                self.friction = if self.velocity > 0.0 {
                    self.axis.coulomb[0]
                } else if self.velocity < 0.0 {
                    -self.axis.coulomb[1]
                } else {
                    force
                };
                return;
            }
            Sliding::MaxwellSlip(law) => law.initial_stiffness(),
            Sliding::LuGre(law) => law.initial_stiffness(),
        };
        let axis = self.axis;
        let level = axis.coulomb[0].max(axis.coulomb[1]);
        let fast = (stiffness * level / axis.inertia).sqrt()
            + axis.viscous[0].max(axis.viscous[1]) / axis.inertia;
        // A tenth of a radian of the contact's own oscillation is a short enough step.
        let steps = (10.0 * fast * period).ceil().clamp(4.0, 1000.0);
        let h = period / steps;
        let force = axis.force_per_volt * voltage - axis.offset;
        for _ in 0..steps as usize {
            let pull = |x: f64, v: f64| {
                let viscous = axis.viscous[usize::from(v < 0.0)];
                (force - viscous * v - self.held(x, v)) / axis.inertia
            };
            let (x, v) = (self.place, self.velocity);
            let a1 = pull(x, v);
            let (v2, x2) = (v + 0.5 * h * a1, x + 0.5 * h * v);
            let a2 = pull(x2, v2);
            let (v3, x3) = (v + 0.5 * h * a2, x + 0.5 * h * v2);
            let a3 = pull(x3, v3);
            let (v4, x4) = (v + h * a3, x + h * v3);
            let a4 = pull(x4, v4);
            let end = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4);
            self.place = x + h / 6.0 * (v + 2.0 * (v2 + v3) + v4);
            if v * end < 0.0 {
                self.turn();
            }
            self.velocity = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: Axis = Axis {
        force_per_volt: 2.0,
        inertia: 0.5,
        viscous: [3.0, 4.0],
        coulomb: [0.2, 0.3],
        offset: 0.0,
    };

    /// With next to no way to give way over, every law is Coulomb's.
    #[test]
    fn a_stiff_contact_slides_as_coulomb_says() {
        for law in [
            Sliding::maxwell_slip(1e-7).unwrap(),
            Sliding::lugre(1e-7, 1.0, 1e-3).unwrap(),
        ] {
            let mut moving = Moving::new(&AXIS, &law, 0.0, 0.0);
            let mut exact = (0.0, 0.0);
            for k in 0..500 {
                let u = (0.03 * f64::from(k)).sin();
                moving.advance(u, 0.002);
                exact = AXIS.advance(exact, u, 0.002);
                assert!((moving.place - exact.0).abs() < 2e-5, "{law:?} {k}");
            }
        }
    }

    #[test]
    fn below_its_level_a_contact_gives_way_and_comes_back() {
        let law = Sliding::maxwell_slip(1e-4).unwrap();
        let mut moving = Moving::new(&AXIS, &law, 0.0, 0.0);
        for _ in 0..5000 {
            moving.advance(0.05, 0.002);
        }
        let out = moving.place;
        assert!(out > 4e-5 && out < 2e-4, "{out}");
        let contact = Sliding::CoulombPresliding(1e-4);
        let mut moving = Moving::new(&AXIS, &contact, 0.0, 0.0);
        moving.advance(0.05, 0.002);
        assert!((moving.output() - 0.5e-4).abs() < 1e-12);
    }
}
