//! The piezos of a micro, identified by light (thesis 4.2).

use crate::align::LONGEST;
use crate::job::{Ended, Job, Order, Work};
use pigtail_control::calibration::{Calibration, Hystereses};
use pigtail_control::compensation::micro::MicroModel;
use pigtail_control::fast::{Ratio, measure_ratios, swing_tips, watch_tips};
use pigtail_control::job::FiberReport;
use pigtail_control::outcome::Outcome;
use pigtail_control::piezo::camera::{SeenMicro, by_camera};
use pigtail_control::piezo::{self, Micro};
use pigtail_control::station::Station;
use pigtail_hal::Side;
use pigtail_hal::spec::SIDES;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// By which model of its piezos' hysteresis a machine is commissioned.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    strum::Display,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
    Serialize,
    Deserialize,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "kebab-case")]
pub enum PiezoModel {
    /// Play operators behind a static curve, with creep: right after any history
    #[default]
    Memory,
    /// The thesis's radial basis networks, (4.3)-(4.6)
    Rbf,
    /// None: a piezo goes as far as its gain says
    None,
}

impl PiezoModel {
    /// What the camera saw of a micro by this model, with a displacement in y for one in x; `None` where that is to be none.
    ///
    /// # Errors
    ///
    /// An outcome where what was seen makes no such model.
    pub fn of(self, micro: &SeenMicro, ratio: f64) -> Result<Option<MicroModel>, Outcome> {
        Ok(match self {
            Self::Memory => Some(micro.memory(ratio)),
            Self::Rbf => Some(micro.rbf(ratio)?),
            Self::None => None,
        })
    }
}

/// Identify the piezos of a side's micro.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct IdentifyPiezos {
    /// The side.
    pub side: Side,
}

impl Job for IdentifyPiezos {
    type Output = Micro;

    fn run(&self, work: &mut Work<'_>) -> Result<Micro, Ended> {
        let rig = work.rig();
        // The models that are believed are about to be replaced. With a poor one, as an `rbf` is to small
        // moves, a peak's place would not be found, and so no better one could ever be identified.
        let calibration = Calibration {
            hysteresis: Hystereses::default(),
            ..rig.calibration.clone()
        };
        let mut station = Station::new(work.machine, &calibration, work.observer)?;
        Ok(piezo::identify(&mut station, &rig.recipe, self.side)?)
    }

    fn order(&self) -> Order {
        Order::IdentifyPiezos(*self)
    }

    fn label(&self) -> Cow<'static, str> {
        Cow::Borrowed(self.side.name())
    }
}

/// Identify the piezos of both micros by the camera alone.
pub struct SeePiezos;

impl Job for SeePiezos {
    type Output = [SeenMicro; SIDES];

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        Ok(by_camera(&mut work.station()?)?)
    }

    fn order(&self) -> Order {
        Order::Other
    }
}

/// Align a device, and measure on the way how far both micros go in y for a displacement in x.
pub struct MeasureRatios;

impl Job for MeasureRatios {
    /// Of each side, and how the fibers ended.
    type Output = ([Option<Ratio>; SIDES], Vec<FiberReport>);

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let recipe = &work.rig.recipe;
        Ok(measure_ratios(&mut work.station()?, recipe))
    }

    fn order(&self) -> Order {
        Order::Other
    }

    fn longest(&self) -> f64 {
        LONGEST
    }
}

/// Step the tips of both micros beside their peaks, by the light that goes through a guide whose fibers both hold there: how they swing.
pub struct SwingTips;

impl Job for SwingTips {
    type Output = Vec<FiberReport>;

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let recipe = &work.rig.recipe;
        Ok(swing_tips(&mut work.station()?, recipe))
    }

    fn order(&self) -> Order {
        Order::Other
    }

    fn longest(&self) -> f64 {
        LONGEST
    }
}

/// Watch how the tips of both micros shake, each for so many seconds in x and in y, by the light that goes through a guide whose fibers
/// both hold at their peaks.
pub struct WatchTips {
    /// For how long.
    pub seconds: f64,
}

impl Job for WatchTips {
    type Output = Vec<FiberReport>;

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let recipe = &work.rig.recipe;
        Ok(watch_tips(&mut work.station()?, recipe, self.seconds))
    }

    fn order(&self) -> Order {
        Order::Other
    }

    fn longest(&self) -> f64 {
        LONGEST
    }
}
