//! A manipulator: from the outputs of its joints to where its holder is.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::TwinError;
use super::linkage::{Carried, Linkage};
use super::micro::Micro;
use super::plant::{PlacementPlant, Plant};
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::{AXES, MICRO_AXES};
use pigtail_hal::{Axis, Side, Spec};
use pigtail_model::fivebar::{FiveBar, JointAngle, Turning};
use pigtail_model::frames::{Chip, Macro, Placement, Point};
use pigtail_model::joint::JointParameters;
use pigtail_model::leadscrew::LeadScrew;
use rand::Rng;

/// A manipulator's mechanics.
#[derive(Debug, Clone)]
pub(super) struct Manipulator {
    linkage: Option<Linkage>,
    carried: Option<Carried>,
    pub(super) five_bar: FiveBar,
    home: [f64; 2],
    home_angles: [JointAngle; 2],
    turning: [Turning; 2],
    pub(super) screw: LeadScrew,
    pub(super) placement: Placement,
    /// How it stands beside its yaw; `None` where it stands square.
    stance: Option<Stance>,
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
        let mut vary = |length: f64| length * plant.variation.factor(rng, plant.variation.links);
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
        let carried = (fb.carried > 0.0)
            .then(|| {
                let inertia = fb.carried * fb.joint.load_inertia;
                Carried::new(&five_bar, home_angles, inertia, spec.period())
            })
            .transpose()?;
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
            plant.misplacement.offset(rng, plant.misplacement.home),
            plant.misplacement.offset(rng, plant.misplacement.home),
        );
        let manipulator = Self {
            linkage,
            carried,
            five_bar,
            home: fb.home,
            home_angles,
            turning: Default::default(),
            screw,
            placement: Placement::new(Point::new(x, y, z), stands.yaw + turn).shifted(
                dx - chip[0],
                0.0,
                dz - chip[1],
            ),
            stance: Stance::new(stands),
            micro: Micro::new(plant, spec, rng)?,
            endpoint: ([0.0; AXES], Point::ORIGIN),
        };
        Ok((manipulator, joints))
    }

    /// Torques of the links' friction and of what the endpoint carries on the joints, N m; `None` where the links
    /// cannot meet.
    ///
    /// They change far more slowly than a cycle: what they were at the end of the one before.
    #[inline(always)]
    pub(super) fn torques(&mut self) -> Option<[f64; AXES]> {
        let mut torques = [0.0; AXES];
        if self.linkage.is_none() && self.carried.is_none() {
            return Some(torques);
        }
        let [home_a, home_b] = self.home_angles;
        let [a, b, _] = self.endpoint.0;
        let angles = [JointAngle(home_a.0 + a), JointAngle(home_b.0 + b)];
        let mut add = |[a, b]: [f64; 2]| {
            torques[0] += a;
            torques[1] += b;
        };
        if let Some(linkage) = &mut self.linkage {
            add(linkage.torques(&self.five_bar, angles)?);
        }
        if let Some(carried) = &mut self.carried {
            let at = self.endpoint.1;
            add(carried.torques(&self.five_bar, angles, [at.x, at.y])?);
        }
        Some(torques)
    }

    /// The holder's position in the chip's frame after a cycle that ended with these outputs
    /// (radians), the micro's part in it included; `None` where the links cannot meet.
    #[inline(always)]
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
        let mut at = self.endpoint.1.moved(by);
        if let Some(stance) = &self.stance {
            at = stance.stands(at);
        }
        Some(self.placement.chip_from_macro(at))
    }

    #[inline(always)]
    fn endpoint_at(&mut self, [a, b, z]: [f64; AXES]) -> Option<Point<Macro>> {
        let [home_a, home_b] = self.home_angles;
        let angles = [JointAngle(home_a.0 + a), JointAngle(home_b.0 + b)];
        let (x, y) = self.five_bar.forward_from(&mut self.turning, angles).ok()?;
        Some(Point::new(
            x - self.home[0],
            y - self.home[1],
            self.screw.position(z),
        ))
    }
}

/// A manipulator that leans: how its own frame, made of what its axes believe to be square, lies in one that
/// is turned about y alone.
#[derive(Debug, Clone, Copy)]
struct Stance([[f64; 3]; 3]);

impl Stance {
    fn new(stands: &PlacementPlant) -> Option<Self> {
        let PlacementPlant {
            roll,
            pitch,
            squareness: [to_x, to_y],
            ..
        } = *stands;
        if [roll, pitch, to_x, to_y] == [0.0; 4] {
            return None;
        }
        let (sr, cr) = roll.sin_cos();
        let (sp, cp) = pitch.sin_cos();
        // First the z-stage leans, then all of it rolls about z, then pitches about x.
        let (zx, zy) = (to_x.tan(), to_y.tan());
        Some(Self([
            [cr, -sr, cr * zx - sr * zy],
            [cp * sr, cp * cr, cp * (sr * zx + cr * zy) - sp],
            [sp * sr, sp * cr, sp * (sr * zx + cr * zy) + cp],
        ]))
    }

    fn stands(&self, p: Point<Macro>) -> Point<Macro> {
        let [x, y, z] = self.0.map(|[a, b, c]| a * p.x + b * p.y + c * p.z);
        Point::new(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manipulator_that_leans_moves_aside_as_it_approaches() {
        let stands = |roll: f64, pitch: f64, squareness: [f64; 2]| PlacementPlant {
            home: [0.0; 3],
            yaw: 0.0,
            roll,
            pitch,
            squareness,
        };
        assert!(Stance::new(&stands(0.0, 0.0, [0.0; 2])).is_none());
        let ahead = |stands: &PlacementPlant| {
            let stance = Stance::new(stands).expect("it leans");
            stance.stands(Point::new(0.0, 0.0, 1.0))
        };
        let leans = ahead(&stands(0.0, 0.0, [0.01, -0.02]));
        assert!(leans.distance(Point::new(0.01_f64.tan(), -0.02_f64.tan(), 1.0)) < 1e-12);
        let pitches = ahead(&stands(0.0, 0.01, [0.0; 2]));
        assert!(pitches.distance(Point::new(0.0, -0.01_f64.sin(), 0.01_f64.cos())) < 1e-12);
        // One that rolls goes straight ahead, and sideways where it means to go up.
        let rolls = Stance::new(&stands(0.01, 0.0, [0.0; 2])).expect("it leans");
        assert_eq!(rolls.stands(Point::new(0.0, 0.0, 1.0)).z, 1.0);
        assert!((rolls.stands(Point::new(0.0, 1.0, 0.0)).x + 0.01_f64.sin()).abs() < 1e-12);
    }
}
