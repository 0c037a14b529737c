//! What the store of runs is told of devices.

use crate::align::AlignmentDocument;
use crate::bench::PROCEDURE;
use pigtail_session::bench::BenchSetup;
use pigtail_session::procedure::Procedure;
use pigtail_session::scenario::Scenario;
use pigtail_session::setup::Setup;
use pigtail_store::database::{Aligned, AlignedFiber, Devices};

/// So many devices from a seed on, of a rig and a recipe.
pub fn devices(setup: &Setup, procedure: Procedure, seed: u64, count: u64) -> Devices<'_> {
    Devices {
        seed,
        count,
        rig: &setup.rig.name,
        recipe: &setup.rig.recipe_name,
        procedure: procedure.name(),
        scenario: setup.scenario.name(),
    }
}

/// A device of a bench.
pub fn bench(setup: &BenchSetup, seed: u64) -> Devices<'_> {
    Devices {
        seed,
        count: 1,
        rig: &setup.rig.name,
        recipe: &setup.rig.recipe_name,
        procedure: PROCEDURE.name(),
        scenario: Scenario::Nominal.name(),
    }
}

/// How the fibers of a device ended.
pub fn aligned(document: &AlignmentDocument) -> Aligned {
    Aligned {
        fibers: document
            .fibers
            .iter()
            .map(|fiber| AlignedFiber {
                port: fiber.port.to_owned(),
                outcome: fiber.outcome.to_string(),
                detail: fiber.detail.clone(),
                seconds: fiber.seconds,
                offset_um: fiber.offset_um.map(|o| [o.x, o.y, o.z]),
                coupling_loss_db: fiber.coupling_loss_db,
                within_tolerance: fiber.within_tolerance,
            })
            .collect(),
        collision: Some(document.collision),
        smallest_gap_um: document.smallest_gap_um,
    }
}
