//! What couples the joints of a five-bar: friction between its links, and the mass at its endpoint.

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

/// Mass at the endpoint of a five-bar. Each joint's own inertia is part of the joint; this is what the mass adds
/// to it: `tau = -m J^T a + c J_l q''`, where the endpoint's acceleration `a` holds what the other joint does
/// to it, and centripetal and Coriolis forces.
#[derive(Debug, Clone)]
pub(super) struct Carried {
    /// kg.
    mass: f64,
    /// What of it each joint has in itself, kg m2.
    inertia: f64,
    period: f64,
    /// Angles (radians) and endpoint (metres) of the last two cycles, the later first.
    before: Option<[([f64; 2], [f64; 2]); 2]>,
    /// The torques of the last cycle, N m.
    torques: [f64; 2],
}

/// Time over which the torques of a carried mass are smoothed, seconds: in the model's presliding (2.12) an output
/// jumps within a cycle when its friction turns, which no mass does. Far below what a servo follows.
const SMOOTHED: f64 = 2e-3;

impl Carried {
    /// A mass that a joint at home feels as `inertia` (kg m2), in cycles of `period` seconds.
    pub(super) fn new(
        five_bar: &FiveBar,
        home: [JointAngle; 2],
        inertia: f64,
        period: f64,
    ) -> Result<Self, TwinError> {
        let [[xa, _], [ya, _]] = five_bar.jacobian(home)?;
        Ok(Self {
            mass: inertia / (xa * xa + ya * ya),
            inertia,
            period,
            before: None,
            torques: [0.0; 2],
        })
    }

    /// Torques on the joints A and B (N m) at these angles and this endpoint (metres), by the accelerations of the
    /// cycles before.
    pub(super) fn torques(
        &mut self,
        five_bar: &FiveBar,
        angles: [JointAngle; 2],
        at: [f64; 2],
    ) -> Option<[f64; 2]> {
        let now = (angles.map(|angle| angle.0), at);
        let [last, first] = self.before.get_or_insert([now; 2]);
        let square = self.period * self.period;
        let second = |now: [f64; 2], last: [f64; 2], first: [f64; 2]| -> [f64; 2] {
            std::array::from_fn(|k| (now[k] - 2.0 * last[k] + first[k]) / square)
        };
        let turning = second(now.0, last.0, first.0);
        let moving = second(now.1, last.1, first.1);
        (*first, *last) = (*last, now);
        let jacobian = five_bar.jacobian(angles).ok()?;
        let share = -(-self.period / SMOOTHED).exp_m1();
        for joint in 0..2 {
            let felt = jacobian[0][joint] * moving[0] + jacobian[1][joint] * moving[1];
            let torque = self.inertia * turning[joint] - self.mass * felt;
            self.torques[joint] += share * (torque - self.torques[joint]);
        }
        Some(self.torques)
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
