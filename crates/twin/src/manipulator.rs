//! A manipulator: from the outputs of its joints to where its holder is.

use super::TwinError;
use super::linkage::Linkage;
use super::micro::Micro;
use super::plant::{Plant, factor, uniform};
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::{AXES, MICRO_AXES};
use pigtail_hal::{Axis, Side, Spec};
use pigtail_model::fivebar::{FiveBar, JointAngle};
use pigtail_model::frames::{Chip, Macro, Placement, Point};
use pigtail_model::joint::JointParameters;
use pigtail_model::leadscrew::LeadScrew;
use rand::Rng;

/// A manipulator's mechanics.
#[derive(Debug, Clone)]
pub(super) struct Manipulator {
    linkage: Option<Linkage>,
    pub(super) five_bar: FiveBar,
    home: [f64; 2],
    home_angles: [JointAngle; 2],
    pub(super) screw: LeadScrew,
    pub(super) placement: Placement,
    pub(super) micro: Micro,
    /// The endpoint without the micro's motion, for the outputs it was computed for.
    pub(super) endpoint: ([f64; AXES], Point<Macro>),
}

impl Manipulator {
    /// A specimen, and the joints that move it.
    pub(super) fn new(
        plant: &Plant,
        spec: &Spec,
        side: Side,
        chip: [f64; 2],
        rng: &mut impl rand::RngExt,
    ) -> Result<(Self, [JointParameters; AXES]), TwinError> {
        let fb = &plant.five_bar;
        let mut vary = |length: f64| length * factor(rng, plant.variation.links);
        let five_bar = FiveBar::new(vary(fb.base), vary(fb.proximal), vary(fb.distal))?;
        let screw = LeadScrew::from_lead(vary(plant.z_stage.lead));
        let home_angles = five_bar.inverse(fb.home[0], fb.home[1])?;
        let mut joint = |axis: Axis| {
            let nominal = if axis == Axis::Z {
                &plant.z_stage.joint
            } else {
                &fb.joint
            };
            let ratio = 1.0 / spec.drive(axis).gear_ratio;
            nominal.draw(ratio, &plant.variation, rng)
        };
        let joints = [joint(Axis::A)?, joint(Axis::B)?, joint(Axis::Z)?];
        let linkage = if fb.bearings.friction > 0.0 {
            let b = fb.bearings;
            Some(Linkage::new(
                &five_bar,
                home_angles,
                b.friction,
                b.presliding,
            )?)
        } else {
            None
        };
        let stands = match side {
            Side::Left => &plant.placement.left,
            Side::Right => &plant.placement.right,
        };
        let [x, y, z] = stands.home;
        // A chip that is turned about its middle is a machine that is turned the other way.
        let turn = plant.device.turn;
        let middle = 0.5 * (plant.device.input[2] + plant.device.outputs[0][2]);
        let (sin, cos) = turn.sin_cos();
        let (x, z) = (
            cos * x + sin * (z - middle),
            cos * (z - middle) - sin * x + middle,
        );
        // Up and down, a wrong home is part of what nothing can see (`misplacement.y`).
        let (dx, dz) = (
            uniform(rng, plant.misplacement.home),
            uniform(rng, plant.misplacement.home),
        );
        let manipulator = Self {
            linkage,
            five_bar,
            home: fb.home,
            home_angles,
            screw,
            placement: Placement::new(Point::new(x, y, z), stands.yaw + turn).shifted(
                dx - chip[0],
                0.0,
                dz - chip[1],
            ),
            micro: Micro::new(plant, spec, rng)?,
            endpoint: ([0.0; AXES], Point::ORIGIN),
        };
        Ok((manipulator, joints))
    }

    /// Torques of the links' friction on the joints, N m; `None` where the links cannot meet.
    ///
    /// It changes far more slowly than a cycle: what it was at the end of the one before.
    pub(super) fn torques(&mut self) -> Option<[f64; AXES]> {
        let Some(linkage) = &mut self.linkage else {
            return Some([0.0; AXES]);
        };
        let [home_a, home_b] = self.home_angles;
        let [a, b, _] = self.endpoint.0;
        let angles = [JointAngle(home_a.0 + a), JointAngle(home_b.0 + b)];
        let [a, b] = linkage.torques(&self.five_bar, angles)?;
        Some([a, b, 0.0])
    }

    /// The holder's position in the chip's frame after a cycle that ended with these outputs
    /// (radians), the micro's part in it included; `None` where the links cannot meet.
    pub(super) fn advance(
        &mut self,
        outputs: [f64; AXES],
        micro: [Volts; MICRO_AXES],
        rng: &mut impl Rng,
    ) -> Option<Point<Chip>> {
        if outputs != self.endpoint.0 {
            self.endpoint = (outputs, self.endpoint_at(outputs)?);
        }
        let by = self.micro.advance(micro, rng);
        Some(self.placement.chip_from_macro(self.endpoint.1.moved(by)))
    }

    fn endpoint_at(&self, [a, b, z]: [f64; AXES]) -> Option<Point<Macro>> {
        let [home_a, home_b] = self.home_angles;
        let (x, y) = self
            .five_bar
            .forward([JointAngle(home_a.0 + a), JointAngle(home_b.0 + b)])
            .ok()?;
        Some(Point::new(
            x - self.home[0],
            y - self.home[1],
            self.screw.position(z),
        ))
    }
}
