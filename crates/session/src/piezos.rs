//! The piezos of a micro, identified by light (thesis 4.2).

use crate::job::{Ended, Job, Order, Work};
use pigtail_control::piezo::{self, Micro};
use pigtail_hal::Side;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Identify the piezos of a side's micro.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct IdentifyPiezos {
    /// The side.
    pub side: Side,
}

impl Job for IdentifyPiezos {
    type Output = Micro;

    fn run(&self, work: &mut Work<'_>) -> Result<Micro, Ended> {
        let recipe = &work.rig().recipe;
        let mut station = work.station()?;
        Ok(piezo::identify(&mut station, recipe, self.side)?)
    }

    fn order(&self) -> Order {
        Order::IdentifyPiezos(*self)
    }

    fn label(&self) -> Cow<'static, str> {
        Cow::Borrowed(self.side.name())
    }
}
