//! First light by one of the thesis's three methods (3.2.1).

use crate::job::{Ended, Job, Order, Work};
use pigtail_control::methods::{Coverage, Space, cover};
use pigtail_hal::Rule;
use serde::{Deserialize, Serialize};

/// Cover a whole space in search of first light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FirstLight {
    /// The method, its area and its mesh.
    pub space: Space,
}

impl Job for FirstLight {
    type Output = Coverage;

    fn run(&self, work: &mut Work<'_>) -> Result<Coverage, Ended> {
        let recipe = &work.rig().recipe;
        let mut station = work.station()?;
        Ok(cover(&mut station, recipe, &self.space)?)
    }

    fn order(&self) -> Order {
        Order::FirstLight(*self)
    }

    /// The sweep of a micro's raster is as fast as a piezo that runs away, and goes far while vision looks.
    fn breaks(&self) -> &'static [Rule] {
        &[Rule::PiezoRunaway, Rule::VisionAgreement]
    }
}
