//! The lead screw of the z-stage, (2.11).

/// A lead screw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeadScrew {
    metres_per_radian: f64,
}

impl LeadScrew {
    /// A screw from its lead, metres a turn: 0.635 mm for 40 threads an inch.
    pub fn from_lead(lead: f64) -> Self {
        Self {
            metres_per_radian: lead / std::f64::consts::TAU,
        }
    }

    /// Position `z = P q_l` (2.11) in metres at a screw angle in radians.
    pub fn position(&self, angle: f64) -> f64 {
        self.metres_per_radian * angle
    }

    /// Screw angle in radians for a position in metres.
    pub fn angle(&self, position: f64) -> f64 {
        position / self.metres_per_radian
    }
}
