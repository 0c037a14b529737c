//! A device aligned on a machine: what control says of it.

use crate::job::{Ended, Job, Order, Work};
use crate::procedure::Procedure;
use pigtail_control::job::{FiberReport, not_begun};
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Station;
use serde::{Deserialize, Serialize};

/// An alignment that takes longer than this hangs, seconds of machine time: a device without light
/// takes two minutes.
pub const LONGEST: f64 = 1800.0;

/// Align a device. A fault of the machine is how the fiber ended to which it happened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Align {
    /// How.
    pub procedure: Procedure,
}

/// What control says of a device.
#[derive(Debug, Clone, PartialEq)]
pub struct Aligned {
    /// Each fiber, in the order of alignment.
    pub fibers: Vec<FiberReport>,
    /// Machine time by the machine, from power-on until the last fiber was done, seconds.
    pub machine_seconds: f64,
    /// Light samples that control looked at.
    pub readings: u64,
}

impl Job for Align {
    type Output = Aligned;

    fn run(&self, work: &mut Work<'_>) -> Result<Aligned, Ended> {
        Ok(align_by(work, |station, recipe| {
            self.procedure.run(station, recipe)
        }))
    }

    fn order(&self) -> Order {
        Order::Align(*self)
    }

    fn longest(&self) -> f64 {
        LONGEST
    }
}

/// Aligns a device in one's own way.
pub fn align_by(
    work: &mut Work<'_>,
    control: impl FnOnce(&mut Station, &Recipe) -> Vec<FiberReport>,
) -> Aligned {
    let recipe = &work.rig.recipe;
    match Station::new(work.machine, &work.rig.calibration, work.observer) {
        Ok(mut station) => Aligned {
            fibers: control(&mut station, recipe),
            machine_seconds: station.time(),
            readings: station.readings(),
        },
        Err(fault) => Aligned {
            fibers: not_begun(recipe, fault),
            machine_seconds: 0.0,
            readings: 0,
        },
    }
}
