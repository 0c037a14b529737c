//! What the first steps do on the machine: each axis by itself, the photodiodes in the dark; and the clock of all of them.

use crate::job::{Ended, Job, Order, Work};
use pigtail_control::station::Station;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::{
    Axis, AxisName, Channel, Command, Fault, Machine, Measurement, Rule, Side, Spec,
};

/// A machine and its clock.
pub(super) struct Clock {
    pub(super) machine: Box<dyn Machine>,
    pub(super) time: f64,
}

impl Machine for Clock {
    fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let measured = self.machine.exchange(command)?;
        self.time = measured.time;
        Ok(measured)
    }

    fn stop(&mut self) {
        self.machine.stop();
    }
}

/// Whether each axis moves under a voltage, and where to: every axis by itself, no loop closed.
pub(super) struct CheckAxes;

/// How an axis answered a voltage that rose until it moved.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    /// The voltage, without sign; that of the amplifier where it did not move.
    pub(super) volts: f64,
    /// How far it went, counts.
    pub(super) counts: i64,
    /// How far its output went by its probe, metres; `None` without one.
    pub(super) output: Option<f64>,
}

/// An axis that was made to move.
pub(super) struct MovedAxis {
    pub(super) at: AxisName,
    pub(super) forward: Answer,
    pub(super) backward: Answer,
}

impl MovedAxis {
    /// What is wrong with it.
    pub(super) fn wrong(&self) -> Option<&'static str> {
        match (self.forward.counts, self.backward.counts) {
            (0, _) | (_, 0) => Some("does not move under its amplifier's voltage"),
            (forward, backward) if forward < 0 && backward > 0 => Some(
                "moves the wrong way: its motor or its encoder is connected the other way round",
            ),
            (forward, backward) if forward < 0 || backward > 0 => {
                Some("moves the same way whatever the sign of its voltage")
            }
            _ => None,
        }
    }
}

impl Job for CheckAxes {
    type Output = Vec<MovedAxis>;

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        let mut station = work.station()?;
        let all = Side::ALL.into_iter();
        let all: Vec<_> = all
            .flat_map(|side| Axis::ALL.map(|axis| AxisName { side, axis }))
            .collect();
        for at in &all {
            station.hold_voltage(*at, Volts(0.0));
        }
        let mut moved = Vec::with_capacity(all.len());
        for at in all {
            let forward = rise(&mut station, at, 1.0)?;
            let backward = rise(&mut station, at, -1.0)?;
            moved.push(MovedAxis {
                at,
                forward,
                backward,
            });
        }
        Ok(moved)
    }

    fn order(&self) -> Order {
        Order::Other
    }

    fn breaks(&self) -> &'static [Rule] {
        // A voltage under which nothing moves yet is what is looked for.
        &[Rule::MotorStall]
    }
}

/// Raises the voltage of an axis until it has moved a little.
fn rise(station: &mut Station, at: AxisName, sign: f64) -> Result<Answer, Ended> {
    /// Volts a second.
    const RATE: f64 = 5.0;
    /// So far is far enough, counts.
    const FAR: i64 = 8;
    /// In which everything comes to rest, seconds.
    const REST: f64 = 0.05;
    let limit = station.spec().drive(at.axis).voltage;
    let step = RATE * station.spec().period();
    let (Counts(start), from) = (station.encoder(at), station.probe(at));
    let mut volts = 0.0;
    let gone = |station: &Station| station.encoder(at).0 - start;
    while gone(station).abs() < FAR && volts < limit {
        volts = (volts + step).min(limit);
        station.hold_voltage(at, Volts(sign * volts));
        station.cycle()?;
    }
    let counts = if volts < limit { gone(station) } else { 0 };
    station.hold_voltage(at, Volts(0.0));
    station.run(REST)?;
    let output = station.probe(at).zip(from).map(|(now, then)| now - then);
    Ok(Answer {
        volts,
        counts,
        output,
    })
}

/// How often an encoder goes from more than a count on one side of where it is to stand to more than a count on the other.
pub(super) fn swings(encoder: &[f64], goal: f64) -> usize {
    let off = encoder.iter().map(|count| count - goal);
    let beyond = off.filter(|off| off.abs() > 1.0);
    let sides = beyond.map(f64::is_sign_positive);
    let (swings, _) = sides.fold((0, None), |(swings, before), side| {
        let turned = before.is_some_and(|before| before != side);
        (swings + usize::from(turned), Some(side))
    });
    swings
}

/// The photodiodes without the laser.
pub(super) struct Dark;

impl Job for Dark {
    /// Name, mean and standard deviation of each, volts.
    type Output = Vec<(&'static str, (f64, f64))>;

    fn run(&self, work: &mut Work<'_>) -> Result<Self::Output, Ended> {
        /// Seconds.
        const LOOK: f64 = 1.0;
        let mut station = work.station()?;
        station.laser(false);
        station.run(0.02)?;
        let each = Channel::ALL.into_iter().map(|channel| {
            let level = station.level(channel, LOOK)?;
            Ok((channel.name(), (level.mean, level.sigma)))
        });
        each.collect()
    }

    fn order(&self) -> Order {
        Order::Other
    }
}

#[cfg(test)]
mod tests {
    use super::swings;

    #[test]
    fn an_axis_that_hunts_swings_and_one_that_overshoots_does_not() {
        let comes: Vec<f64> = [0.0, 20.0, 43.0, 38.0, 40.0, 41.0, 39.0, 40.0].into();
        assert_eq!(swings(&comes, 40.0), 2);
        let hunts: Vec<f64> = (0..40)
            .map(|k| 40.0 + 3.0 * f64::from(k % 2 * 2 - 1))
            .collect();
        assert_eq!(swings(&hunts, 40.0), 39);
    }
}
