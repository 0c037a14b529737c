//! One device aligned on a bench that is controlled by position, held against the truth.

use crate::align::{AlignmentDocument, Of, judged, nothing, of, said};
use crate::arms::Played;
use crate::campaign::Device;
use pigtail_control::job::PORTS;
use pigtail_control::outcome::OutcomeCode;
use pigtail_control::station::{Observer, Unobserved};
use pigtail_hal::spec::OUTPUTS;
use pigtail_hal::{Bench, Error};
use pigtail_session::bench::{self, BenchRig, BenchSetup};
use pigtail_session::fleet::NOMINAL;
use pigtail_session::procedure::Procedure;
use pigtail_session::scenario::Scenario;
use pigtail_session::session::Options;
use pigtail_twin::Truth;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The procedure under whose name benches are aligned: there is one alignment for all of them.
pub const PROCEDURE: Procedure = Procedure::Fast;

fn names(rig: &BenchRig) -> Of<'_> {
    Of {
        rig: &rig.name,
        recipe: &rig.recipe_name,
        scenario: Scenario::Nominal.name(),
        fleet: NOMINAL,
        gap: rig.recipe.approach.gap,
    }
}

/// Aligns one device on any bench, of which nobody knows the truth: what a document says of that is `null`, and
/// `collision` means nothing.
pub fn align_on(
    rig: &BenchRig,
    bench: &mut dyn Bench,
    options: &Options,
    observer: &mut dyn Observer,
) -> AlignmentDocument {
    let mut played = Played::new(bench);
    let fibers = bench::align(rig, &mut played, options, observer);
    let document = judged(&names(rig), &of(PROCEDURE), 0, &[], &UNKNOWN, &fibers);
    AlignmentDocument {
        arms: played.arms(),
        ..document
    }
}

/// What is known of a bench that is nobody's twin.
const UNKNOWN: Truth = Truth {
    input: None,
    outputs: [None; OUTPUTS],
    smallest_gap: f64::INFINITY,
};

/// Aligns one device on the twin that `seed` draws.
///
/// # Errors
///
/// When the plant cannot be built. A fiber that cannot be aligned is not an error, nor is a fault of the bench: the
/// document says so.
pub fn align(
    setup: &BenchSetup,
    seed: u64,
    observer: &mut dyn Observer,
) -> Result<AlignmentDocument, Error> {
    let mut twin = setup.twin(seed)?;
    let mut played = Played::new(&mut twin);
    let fibers = bench::align(&setup.rig, &mut played, &setup.options, observer);
    let arms = played.arms();
    let document = judged(
        &names(&setup.rig),
        &of(PROCEDURE),
        seed,
        &[],
        &twin.truth(),
        &fibers,
    );
    Ok(AlignmentDocument { arms, ..document })
}

/// A device of a campaign.
///
/// # Errors
///
/// As [`align`].
pub fn device(setup: &BenchSetup, seed: u64) -> Result<Device, Error> {
    let run = AssertUnwindSafe(|| align(setup, seed, &mut Unobserved));
    let document = catch_unwind(run).unwrap_or_else(|panic| {
        let twin = setup.twin(seed)?;
        let mut document = judged(
            &names(&setup.rig),
            &of(PROCEDURE),
            seed,
            &[],
            &twin.truth(),
            &[],
        );
        let lost = |port| nothing(port, OutcomeCode::Panic, &said(&*panic));
        document.fibers = PORTS.into_iter().map(lost).collect();
        Ok(document)
    })?;
    Ok(Device { seed, document })
}
