//! Friction between the links of a five-bar, which couples its joints.

use super::TwinError;
use pigtail_model::Invalid;
use pigtail_model::fivebar::{FiveBar, JointAngle};
use pigtail_model::presliding::{ElementState, MaxwellSlip, Presliding};

/// Friction in the bearings between the links of a five-bar: elbow A, elbow B, tip.
#[derive(Debug, Clone)]
pub(super) struct Linkage {
    bearings: [Bearing; 3],
    /// Angle of each bearing at home, radians.
    home: [f64; 3],
}

impl Linkage {
    /// Bearings at rest with the joints at these angles, that slide at `friction` (N m) after giving
    /// way over some `presliding` (rad).
    pub(super) fn new(
        five_bar: &FiveBar,
        home: [JointAngle; 2],
        friction: f64,
        presliding: f64,
    ) -> Result<Self, TwinError> {
        let bearing = || Bearing::new(friction, presliding);
        Ok(Self {
            bearings: [bearing()?, bearing()?, bearing()?],
            home: five_bar.bearings(home)?.0,
        })
    }

    /// Torques on the joints A and B (N m) at these angles: of each bearing by the principle of
    /// virtual work.
    pub(super) fn torques(
        &mut self,
        five_bar: &FiveBar,
        angles: [JointAngle; 2],
    ) -> Option<[f64; 2]> {
        let (now, rates) = five_bar.bearings(angles).ok()?;
        let mut torques = [0.0; 2];
        for (i, bearing) in self.bearings.iter_mut().enumerate() {
            let friction = bearing.torque_at(now[i] - self.home[i]);
            for (torque, rate) in torques.iter_mut().zip(rates[i]) {
                *torque -= friction * rate;
            }
        }
        Some(torques)
    }
}

/// A bearing between links.
#[derive(Debug, Clone)]
struct Bearing {
    law: MaxwellSlip,
    state: ElementState,
    angle: f64,
    direction: f64,
}

impl Bearing {
    /// A bearing that slides at `level` (N m) after giving way over some `way` (rad).
    fn new(level: f64, way: f64) -> Result<Self, Invalid> {
        Ok(Self {
            law: MaxwellSlip::new(level, way)?,
            state: ElementState::default(),
            angle: 0.0,
            direction: 0.0,
        })
    }

    /// Its torque against the motion that brought it to `angle`, N m.
    fn torque_at(&mut self, angle: f64) -> f64 {
        let step = angle - self.angle;
        if step * self.direction < 0.0 {
            self.law.turn(&mut self.state, self.angle);
        }
        if step != 0.0 {
            self.direction = step;
            self.angle = angle;
        }
        self.law.torque(&self.state, angle, 0.0)
    }
}
