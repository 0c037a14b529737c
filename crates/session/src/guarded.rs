//! A machine with its guard around it, which is told what is believed of the geometry.

use crate::rig::Rig;
use pigtail_control::calibration::{Calibration, PlacementBelief};
use pigtail_control::recipe::Recipe;
use pigtail_hal::{Machine, Side};
use pigtail_machines::Guard;
use pigtail_machines::guard::{Arm, Facet, Geometry};
use pigtail_model::fivebar::FiveBar;
use pigtail_model::frames::{Placement, Point};
use pigtail_model::leadscrew::LeadScrew;

/// A machine, watched by what the rig's datasheet, calibration and recipe say.
pub fn guarded<M: Machine>(machine: M, rig: &Rig) -> Guard<M> {
    Guard::new(machine, geometry(&rig.calibration, &rig.recipe))
}

/// What calibration and recipe believe of the geometry around the chip.
///
/// # Panics
///
/// When the links make no five-bar that reaches its home, which `Calibration::parse` excludes.
pub fn geometry(calibration: &Calibration, recipe: &Recipe) -> Geometry {
    let geometry = &calibration.geometry;
    let links = &geometry.five_bar;
    let arm = |belief: &PlacementBelief| {
        let five_bar = FiveBar::new(links.base, links.proximal, links.distal)
            .expect("links were checked by Calibration::parse");
        let [x, y, z] = belief.home;
        Arm::new(
            five_bar,
            links.home,
            LeadScrew::from_lead(geometry.z.lead),
            Placement::new(Point::new(x, y, z), belief.yaw),
            geometry.micro.gain,
        )
        .expect("home was checked by Calibration::parse")
    };
    let ports = &recipe.ports;
    let point = |[x, y, z]: [f64; 3]| Point::new(x, y, z);
    let facet = |side: Side| Facet {
        ports: match side {
            Side::Left => vec![point(ports.input)],
            Side::Right => ports.outputs.map(point).to_vec(),
        },
        outward: match side {
            Side::Left => -1.0,
            Side::Right => 1.0,
        },
        // The facets are each other's mirror images.
        stands_out: ports.slope(),
        exit: ports.exit_angle.tan(),
    };
    Geometry {
        arms: [arm(&geometry.left), arm(&geometry.right)],
        facets: Side::ALL.map(facet),
    }
}
