//! What really is, and no machine could say: for comparisons with what control believes, never for control.

use super::light::LightPath;
use super::{Fixed, Twin};
use pigtail_hal::spec::{OUTPUTS, SIDES};
use pigtail_hal::{Axis, AxisName, Side};
use pigtail_model::frames::Displacement;

/// What really is, as far as anyone may want to compare it with what control believes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// The input fiber, once attached.
    pub input: Option<FiberTruth>,
    /// The output fibers, once attached.
    pub outputs: [Option<FiberTruth>; OUTPUTS],
    /// Smallest clearance between the chip and any tip or empty holder so far, metres. At zero or
    /// below, something has hit it.
    pub smallest_gap: f64,
}

impl Truth {
    /// Of fibers that are attached so.
    pub(super) fn of(
        light: &LightPath,
        attached: &[[Option<Fixed>; OUTPUTS]; SIDES],
        smallest_gap: f64,
    ) -> Self {
        let fiber = |side: Side, port: usize| {
            let fixed = attached[side.index()][port].as_ref()?;
            Some(light.truth(side, port, fixed))
        };
        Self {
            input: fiber(Side::Left, 0),
            outputs: std::array::from_fn(|port| fiber(Side::Right, port)),
            smallest_gap,
        }
    }
}

/// Where an attached fiber really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiberTruth {
    /// From the lateral peak of the coupling at the fiber's gap, across the chip, metres.
    pub x: f64,
    /// The same up from the chip, metres.
    pub y: f64,
    /// Gap between facet and tip, metres.
    pub gap: f64,
    /// Power coupled at this interface, 0 to 1.
    pub coupling: f64,
    /// What of it there would be at the lateral peak, at the same gap.
    pub best: f64,
    /// Roll of its slow axis from the polarization of the guides, radians.
    pub roll: f64,
}

impl FiberTruth {
    /// Loss by where it is across: what there would be at the lateral peak of its gap over what there is, decibels.
    pub fn across_db(&self) -> f64 {
        10.0 * (self.best / self.coupling).log10()
    }

    /// Extinction of the light that passes here, by this roll alone, decibels: what is in the axis that it should
    /// be in over what is in the other. `None` where the fiber has no roll.
    pub fn extinction_db(&self) -> Option<f64> {
        (self.roll != 0.0).then(|| -20.0 * self.roll.tan().abs().log10())
    }
}

impl Twin {
    /// How far the micro really displaces the tip of a manipulator, in its x and y, metres; noise
    /// apart. Not part of [`Machine`](pigtail_hal::Machine).
    pub fn micro_displacement(&self, side: Side) -> Displacement {
        self.manipulators[side.index()].micro.displacement()
    }

    /// Displacement of an axis's output from home without a probe's noise: metres along its arm, or
    /// of the z-stage; `None` on a rig without probes. Not part of [`Machine`](pigtail_hal::Machine).
    pub fn output(&self, at: AxisName) -> Option<f64> {
        let (arm, _) = self.probe?;
        let manipulator = &self.manipulators[at.side.index()];
        let angle = self.drives.outputs()[at.side.index()][at.axis.index()];
        Some(match at.axis {
            Axis::A | Axis::B => arm * angle,
            Axis::Z => manipulator.screw.position(angle),
        })
    }

    /// Angles of an axis's motor and output, radians. Not part of [`Machine`](pigtail_hal::Machine).
    pub fn angles(&self, at: AxisName) -> (f64, f64) {
        let (side, axis) = (at.side.index(), at.axis.index());
        (
            self.drives.motors(side)[axis],
            self.drives.outputs()[side][axis],
        )
    }

    /// How high the middle of the sensing fiber's core stands over the outputs in the chip's frame,
    /// metres. Not part of [`Machine`](pigtail_hal::Machine).
    pub fn sensing_height(&self) -> f64 {
        self.sensing_height
    }

    /// What really is. Not part of [`Machine`](pigtail_hal::Machine).
    pub fn truth(&self) -> Truth {
        Truth::of(&self.light, &self.attached, self.smallest_gap)
    }
}
