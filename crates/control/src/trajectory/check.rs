//! What a motion must keep before it may start.

use super::Motion;
use crate::kinematics::Kinematics;
use pigtail_hal::Axis;
use pigtail_model::fivebar::Unreachable;
use pigtail_model::frames::{Macro, Point};

/// Why a motion may not start.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refused {
    /// At this speed, m/s, it would never end.
    #[error("was asked to move at {0} m/s; accepted is a speed above zero")]
    Speed(f64),
    /// It starts elsewhere than where the endpoint is wanted.
    #[error(
        "was to start at {}, but is at {}; accepted is a path that starts there",
        place(*.start), place(*.here)
    )]
    Start {
        /// Where it starts.
        start: Point<Macro>,
        /// Where the endpoint is wanted.
        here: Point<Macro>,
    },
    /// It leaves the workspace.
    #[error(
        "was to go to {name} = {:.3} mm from home; accepted is {:.3} to {:.3} mm",
        at * 1e3, -reach * 1e3, reach * 1e3
    )]
    Workspace {
        /// The coordinate that does.
        name: char,
        /// How far it goes, metres.
        at: f64,
        /// How far the workspace goes to either side, metres.
        reach: f64,
    },
    /// The mechanism cannot follow it.
    #[error("was to go to {}: {why}", place(*.at))]
    Unreachable {
        /// Where it cannot.
        at: Point<Macro>,
        /// Why.
        why: Unreachable,
    },
    /// A motor would turn faster than its datasheet allows.
    #[error(
        "was to pass {} so fast that motor {} turns at {:.0} rpm; accepted is at most {:.0} rpm",
        place(*.at), axis.name(), rpm(*.speed), rpm(*.limit)
    )]
    MotorSpeed {
        /// Whose motor.
        axis: Axis,
        /// How fast, rad/s.
        speed: f64,
        /// How fast it may turn, rad/s.
        limit: f64,
        /// Where it would.
        at: Point<Macro>,
    },
}

fn place(p: Point<Macro>) -> String {
    format!(
        "{:.3}, {:.3}, {:.3} mm from home",
        p.x * 1e3,
        p.y * 1e3,
        p.z * 1e3
    )
}

/// Each coordinate with its name and how far it may go.
fn coordinates(p: Point<Macro>, [x, y, z]: [f64; 3]) -> [(char, f64, f64); 3] {
    [('x', p.x, x), ('y', p.y, y), ('z', p.z, z)]
}

fn rpm(speed: f64) -> f64 {
    speed * 60.0 / std::f64::consts::TAU
}

impl Motion {
    /// Checks the motion at every point: that it stays in the workspace, and that no motor turns
    /// faster than it may. The endpoint's own limits hold since it was built within them.
    ///
    /// The workspace is a box, so a path is inside when the box around it is. For the motors a
    /// bound over that box decides, with the highest speed of the motion; only a motion for which
    /// the bound is too high is looked at in every servo cycle of `period` seconds, between which
    /// the references do not change.
    ///
    /// What compensation adds to a motor's speed is not looked at: it is most just after a joint
    /// has turned back, when that joint is slow.
    ///
    /// # Errors
    ///
    /// The first limit that is broken, with where and by how much.
    pub fn check(&self, kinematics: &Kinematics, period: f64) -> Result<(), Refused> {
        let [low, high] = self.path().bounds();
        // The end beside the box, since a minimum with what is not a number hides it.
        for corner in [self.path().end(), low, high] {
            for (name, at, reach) in coordinates(corner, kinematics.workspace()) {
                if at.is_nan() || at.abs() > reach {
                    return Err(Refused::Workspace { name, at, reach });
                }
            }
        }
        let (across, along) = self.top_speeds();
        let limits = kinematics.motor_speeds();
        let fastest = kinematics.most_motor_speeds([low, high], across, along);
        if fastest
            .iter()
            .zip(&limits)
            .all(|(speed, limit)| speed <= limit)
        {
            return Ok(());
        }
        let mut before = None;
        let mut cycle = 0_u32;
        loop {
            let time = f64::from(cycle) * period;
            let at = self.at(time);
            let angles = kinematics
                .motor_angles_at(at)
                .map_err(|why| Refused::Unreachable { at, why })?;
            for (i, axis) in Axis::ALL.into_iter().enumerate() {
                let speed = before.map_or(0.0, |before: [f64; 3]| {
                    (angles[i] - before[i]).abs() / period
                });
                let limit = limits[i];
                if speed.is_nan() || speed > limit {
                    return Err(Refused::MotorSpeed {
                        axis,
                        speed,
                        limit,
                        at,
                    });
                }
            }
            if time >= self.duration() {
                return Ok(());
            }
            before = Some(angles);
            cycle += 1;
        }
    }
}
