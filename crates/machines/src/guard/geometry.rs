//! What is believed of the geometry around the chip: where manipulators stand and where facets are.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use pigtail_hal::spec::SIDES;
use pigtail_model::fivebar::{FiveBar, JointAngle, Unreachable};
use pigtail_model::frames::{Chip, Placement, Point};
use pigtail_model::leadscrew::LeadScrew;

/// What is believed of the geometry around the chip.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// The manipulators, indexed by side.
    pub arms: [Arm; SIDES],
    /// The facet that each of them brings fibers to.
    pub facets: [Facet; SIDES],
}

/// What is believed of a manipulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    pub(super) five_bar: FiveBar,
    pub(super) home: [f64; 2],
    pub(super) home_angles: [JointAngle; 2],
    pub(super) screw: LeadScrew,
    pub(super) placement: Placement,
    pub(super) micro_gain: f64,
}

impl Arm {
    /// A manipulator whose endpoint is at `home` of its five-bar (metres) when encoders are zero, that
    /// stands at `placement`, and whose piezos go `micro_gain` metres a volt.
    ///
    /// # Errors
    ///
    /// When home cannot be reached.
    pub fn new(
        five_bar: FiveBar,
        home: [f64; 2],
        screw: LeadScrew,
        placement: Placement,
        micro_gain: f64,
    ) -> Result<Self, Unreachable> {
        Ok(Self {
            home_angles: five_bar.inverse(home[0], home[1])?,
            five_bar,
            home,
            screw,
            placement,
            micro_gain,
        })
    }

    /// Where the endpoint is across with its joints turned so far from home (radians), metres from
    /// home.
    pub(super) fn across(&self, [a, b]: [f64; 2]) -> Result<(f64, f64), Unreachable> {
        let [home_a, home_b] = self.home_angles;
        let (x, y) = self
            .five_bar
            .forward([JointAngle(home_a.0 + a), JointAngle(home_b.0 + b)])?;
        Ok((x - self.home[0], y - self.home[1]))
    }
}

/// A facet of the chip by design: a plane through its ports that goes up and down straight.
#[derive(Debug, Clone, PartialEq)]
pub struct Facet {
    /// Its ports.
    pub ports: Vec<Point<Chip>>,
    /// -1 where it faces -z, 1 where it faces +z.
    pub outward: f64,
    /// How far it stands out for a metre in x.
    pub stands_out: f64,
    /// Tangent of the angle of the light before it, from z towards x.
    pub exit: f64,
}

impl Facet {
    /// Gap between the first port and a tip along z, metres.
    pub(super) fn gap(&self, z: f64) -> f64 {
        self.outward * (z - self.ports[0].z)
    }

    /// Distance along z from the facet where it stands out most within `aside` of `x`, metres, if it may be so much `steeper` than by
    /// design, metres for a metre.
    #[inline(always)]
    pub(super) fn clearance(&self, x: f64, z: f64, aside: f64, steeper: f64) -> f64 {
        let out = (x - self.ports[0].x) * self.stands_out + aside * self.stands_out.abs();
        // All ports lie in it: it is where it is believed to be at each.
        let beside = (self.ports.iter()).map(|port| (x - port.x).abs());
        self.gap(z) - out - (beside.fold(f64::INFINITY, f64::min) + aside) * steeper
    }

    /// Distance along z from the port in whose light a tip may stand that is within `aside` of `x`,
    /// metres; `None` where there is none.
    #[inline(always)]
    pub(super) fn gap_in_light(&self, x: f64, z: f64, aside: f64) -> Option<f64> {
        let mut least = f64::INFINITY;
        for port in &self.ports {
            let gap = self.outward * (z - port.z);
            let is_near = (x - port.x - gap * self.exit).abs() <= aside;
            least = if is_near && gap < least { gap } else { least };
        }
        (least < f64::INFINITY).then_some(least)
    }
}
