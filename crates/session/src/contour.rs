//! A contour followed by both joints of a five-bar (thesis 2.4.5).

use crate::job::{Ended, Job, Order, Work};
use pigtail_control::contour::{self, Contour, ContourSample};
use pigtail_control::trajectory::Shape;
use pigtail_hal::{Axis, AxisName, Rule, Side};
use pigtail_model::windup::Windup;
use serde::{Deserialize, Serialize};

/// The joints of a five-bar.
pub const JOINTS: [Axis; 2] = [Axis::A, Axis::B];

/// Follow a contour around home, and note its last lap.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FollowContour {
    /// Whose endpoint.
    pub side: Side,
    /// The contour.
    pub contour: Contour,
    /// Its side or diameter, metres.
    pub size: f64,
    /// Speed along it, m/s.
    pub speed: f64,
    /// The profile of each motion.
    pub shape: Shape,
    /// How often; all but the last bring the transmissions into the state in which they stay.
    pub laps: u32,
    /// What compensates the windup of the [`JOINTS`].
    pub windup: [Windup; JOINTS.len()],
}

impl Job for FollowContour {
    type Output = Vec<ContourSample>;

    fn run(&self, work: &mut Work<'_>) -> Result<Vec<ContourSample>, Ended> {
        let mut station = work.station()?;
        let side = self.side;
        for (axis, windup) in JOINTS.into_iter().zip(self.windup) {
            station.set_windup(AxisName { side, axis }, windup);
        }
        station.set_shape(self.shape);
        let (size, speed) = (self.size, self.speed);
        Ok(contour::follow(
            &mut station,
            side,
            self.contour,
            size,
            speed,
            self.laps,
        )?)
    }

    fn order(&self) -> Order {
        Order::FollowContour(Box::new(*self))
    }

    /// At a reversal a motor is asked for the whole windup at once, and pushes before it moves.
    fn breaks(&self) -> &'static [Rule] {
        &[Rule::MotorStall]
    }
}
