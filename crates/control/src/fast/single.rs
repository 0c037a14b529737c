//! One fiber after the other, each left at its peak for whoever fixes it there.

use super::Shared;
use crate::cell::{AlignmentCell, Layout};
use crate::job::{AtPeak, FiberReport, Job};
use crate::outcome::Outcome;
use crate::reactor::Watched;
use crate::recipe::Recipe;
use pigtail_hal::spec::SIDES;

/// How fibers are brought to their peaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// The fast procedure.
    Fast,
    /// The thesis's.
    Thesis,
}

/// Brings the fibers of a device to their peaks, the input first.
pub struct Aligner<'r> {
    shared: Shared<'r>,
    way: Way,
}

impl<'r> Aligner<'r> {
    /// For a device of a recipe.
    pub fn new(recipe: &'r Recipe, way: Way) -> Self {
        Self {
            shared: Shared::new(recipe),
            way,
        }
    }

    /// Brings the fiber that its holder carries to its port, the input (`None`) or an output, and leaves it at the peak,
    /// not attached. One that cannot be aligned goes back to the tray. Of the bench so much is known, and these arms carry
    /// a fiber; what one that the alignment does not move is at meanwhile is the bench's own affair.
    pub fn reach(
        &mut self,
        bench: &mut dyn Watched,
        (layout, loaded): (Layout, [bool; SIDES]),
        port: Option<usize>,
    ) -> (FiberReport, Option<AtPeak>) {
        let recipe = self.shared.recipe;
        let mut job = Job::of(recipe, port);
        job.holds = true;
        let (shared, way) = (&mut self.shared, self.way);
        let cell = AlignmentCell::carrying(bench, layout, loaded);
        let cell = &cell;
        let align = async |job: &mut Job<'r>| {
            cell.laser(true)?;
            match way {
                Way::Fast => shared.fiber(job, cell).await,
                Way::Thesis => job.align(cell).await,
            }
        };
        let put_back = async |job: &mut Job<'_>| job.put_back(cell).await;
        let report = cell.run(job.run(align, put_back));
        let held = job
            .at_peak
            .take()
            .filter(|_| report.outcome == Outcome::Aligned);
        (report, held)
    }
}
