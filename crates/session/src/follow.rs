//! A fiber at its peak, and what takes it off (thesis 3.3).

use crate::job::{Ended, Job, Order, Work};
use pigtail_control::maximization::{self, Disturbance, Followed, Means, Trial};
use pigtail_control::outcome::Halt;
use pigtail_control::recipe::Climb;
use pigtail_hal::Rule;
use serde::{Deserialize, Serialize};

/// Bring a fiber to its peak, disturb it, and follow the light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "Kept", into = "Kept")]
pub struct Follow {
    /// What happens, and what is done about it.
    pub trial: Trial,
}

/// A trial as a record keeps it: plain numbers in SI units, no texts with units as in a recipe.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Kept {
    begin: f64,
    seconds: f64,
    /// Speed of the macro, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    macro_speed: Option<f64>,
    /// How far away the micro was, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    piezos_away: Option<f64>,
    circles: bool,
    /// Step, dwell, pause and longest time of nine-point patterns.
    #[serde(skip_serializing_if = "Option::is_none")]
    nine_point: Option<[f64; 4]>,
}

impl From<Follow> for Kept {
    fn from(Follow { trial }: Follow) -> Self {
        let mut kept = Self {
            begin: trial.begin,
            seconds: trial.seconds,
            ..Self::default()
        };
        match trial.disturbance {
            Disturbance::Device => {}
            Disturbance::Macro(speed) => kept.macro_speed = Some(speed),
            Disturbance::Piezos(away) => kept.piezos_away = Some(away),
        }
        match trial.means {
            Means::Rest => {}
            Means::Circles => kept.circles = true,
            Means::NinePoint(c) => kept.nine_point = Some([c.step, c.dwell, c.pause, c.timeout]),
        }
        kept
    }
}

impl From<Kept> for Follow {
    fn from(kept: Kept) -> Self {
        let means = match (kept.nine_point, kept.circles) {
            (Some([step, dwell, pause, timeout]), _) => Means::NinePoint(Climb {
                step,
                dwell,
                pause,
                timeout,
                widest: None,
            }),
            (None, true) => Means::Circles,
            (None, false) => Means::Rest,
        };
        let disturbance = match (kept.macro_speed, kept.piezos_away) {
            (Some(speed), _) => Disturbance::Macro(speed),
            (None, Some(away)) => Disturbance::Piezos(away),
            (None, None) => Disturbance::Device,
        };
        Self {
            trial: Trial {
                means,
                disturbance,
                begin: kept.begin,
                seconds: kept.seconds,
            },
        }
    }
}

impl Job for Follow {
    /// What control saw; `None` where the micro's reach ended once the trial had begun.
    type Output = Option<Followed>;

    fn run(&self, work: &mut Work<'_>) -> Result<Option<Followed>, Ended> {
        let recipe = &work.rig().recipe;
        let mut station = work.station()?;
        match maximization::follow(&mut station, recipe, &self.trial) {
            Ok(followed) => Ok(Some(followed)),
            Err(Halt::Outcome(_)) if station.time() > self.trial.begin => Ok(None),
            Err(halt) => Err(halt.into()),
        }
    }

    fn order(&self) -> Order {
        Order::Follow(*self)
    }

    /// A micro that is sent away to let its piezos creep takes its fiber aside at the facet, where the guard lets
    /// it go nowhere but where its light led it.
    fn breaks(&self) -> &'static [Rule] {
        match self.trial.disturbance {
            Disturbance::Piezos(_) => &[Rule::ChipDistance],
            Disturbance::Device | Disturbance::Macro(_) => &[],
        }
    }
}
