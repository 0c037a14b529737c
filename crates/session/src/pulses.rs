//! What pulses do on an axis: the single experiments by which they are characterized (thesis 4.3.1).

use crate::job::{Ended, Job, Order, Work};
use pigtail_control::impulse::experiment;
use pigtail_control::impulse::{Impulses, Moved, Shape};
use pigtail_hal::{AxisName, Pulse};
use serde::{Deserialize, Serialize};

/// Find the voltage at which the motor of an axis breaks away, `R/k_m f_sm`, the unit of amplitudes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BreakAway {
    /// The axis.
    pub at: AxisName,
    /// Time in which everything comes to rest, seconds.
    pub rest: f64,
}

impl Job for BreakAway {
    /// Volts.
    type Output = f64;

    fn run(&self, work: &mut Work<'_>) -> Result<f64, Ended> {
        Ok(experiment::break_away(
            &mut work.station()?,
            self.at,
            self.rest,
        )?)
    }

    fn order(&self) -> Order {
        Order::BreakAway(*self)
    }
}

/// Play pulses one after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlayPulses {
    /// Where, and what is done between them.
    pub impulses: Impulses,
    /// The pulses.
    pub pulses: Vec<Pulse>,
}

impl Job for PlayPulses {
    /// What each did.
    type Output = Vec<Moved>;

    fn run(&self, work: &mut Work<'_>) -> Result<Vec<Moved>, Ended> {
        let mut station = work.station()?;
        self.impulses.begin(&mut station)?;
        let played = self.pulses.iter();
        let moved = played.map(|pulse| self.impulses.respond(&mut station, *pulse));
        Ok(moved.collect::<Result<_, _>>()?)
    }

    fn order(&self) -> Order {
        Order::PlayPulses(self.clone())
    }
}

/// Find the least of an amplitude with which pulses move an axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LeastPulse {
    /// Where, and what is done between pulses.
    pub impulses: Impulses,
    /// The pulses' other amplitudes, or the proportions of them.
    pub shape: Shape,
    /// Which amplitude.
    pub of: Amplitude,
    /// The greatest that is tried, volts.
    pub most: f64,
}

/// An amplitude of a pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Amplitude {
    /// `a_1`, with the others as they are: the dead zone.
    First,
    /// `a_2`, with those above it in proportion and no `a_1`: what removes the dead zone.
    Second,
}

impl Job for LeastPulse {
    /// Volts; `None` where not even the greatest moves it.
    type Output = Option<f64>;

    fn run(&self, work: &mut Work<'_>) -> Result<Option<f64>, Ended> {
        let Self {
            impulses,
            shape,
            of,
            most,
        } = self;
        let mut station = work.station()?;
        impulses.begin(&mut station)?;
        Ok(match of {
            Amplitude::First => experiment::dead_zone(&mut station, impulses, shape, *most)?,
            Amplitude::Second => {
                experiment::without_dead_zone(&mut station, impulses, shape, *most)?
            }
        })
    }

    fn order(&self) -> Order {
        Order::LeastPulse(*self)
    }
}
