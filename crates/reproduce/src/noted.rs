//! What control has a machine do in a run, beside what an axis of it then really does.

use pigtail_control::station::Station;
use pigtail_hal::{AxisName, Command, Fault, Machine, Measurement, Pulse, Spec, Volts};
use pigtail_session::Session;
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use pigtail_twin::Twin;

/// A servo cycle of an axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cycle {
    /// When it began, seconds.
    pub begun: f64,
    /// Voltage that is held in it where no pulse plays, volts.
    pub held: f64,
    /// A pulse that begins with it.
    pub pulse: Option<Pulse>,
    /// Angle of the motor at its end, radians.
    pub motor: f64,
    /// Displacement of the output at its end, metres; no number on a rig without probes.
    pub output: f64,
}

/// A twin that notes every cycle of an axis.
struct Noted {
    twin: Twin,
    at: AxisName,
    cycles: Vec<Cycle>,
}

impl Machine for Noted {
    fn spec(&self) -> &Spec {
        self.twin.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let measurement = self.twin.exchange(command)?;
        let (side, axis) = (self.at.side.index(), self.at.axis.index());
        let Volts(held) = command.motors[side][axis];
        self.cycles.push(Cycle {
            begun: measurement.time - self.twin.spec().period(),
            held,
            pulse: command.pulses[side][axis],
            motor: self.twin.angles(self.at).0,
            output: self.twin.output(self.at).unwrap_or(f64::NAN),
        });
        Ok(measurement)
    }

    fn stop(&mut self) {
        self.twin.stop();
    }
}

/// Runs an experiment on the twin that a seed draws, and returns with its result all cycles of an axis.
///
/// # Errors
///
/// The way in which it ended without its result.
pub(crate) fn noted<T>(
    setup: &Setup,
    seed: u64,
    at: AxisName,
    experiment: impl FnOnce(&mut Station) -> Result<T, Ended>,
) -> Result<(T, Vec<Cycle>), Ended> {
    let setup = setup.at(seed)?;
    let mut machine = Noted {
        twin: setup.twin(seed)?,
        at,
        cycles: Vec::new(),
    };
    let result =
        Session::open_with(&setup.rig, &mut machine, &setup.options).experiment(experiment)?;
    Ok((result, machine.cycles))
}

/// The cycles of a run that begin at a time, seconds, or later.
pub(crate) fn since(cycles: &[Cycle], time: f64) -> &[Cycle] {
    let period = cycles
        .windows(2)
        .next()
        .map_or(0.0, |pair| pair[1].begun - pair[0].begun);
    // Times are sums of periods.
    &cycles[cycles.partition_point(|cycle| cycle.begun < time - 0.5 * period)..]
}

/// The cycles of a run from the one on in which its first pulse begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FromPulse<'c> {
    /// Of them.
    pub cycles: &'c [Cycle],
    /// Where the output stood before, metres.
    pub from: f64,
    /// How long a cycle is, seconds.
    pub period: f64,
    /// When the pulse began, seconds.
    pub begun: f64,
}

impl<'c> FromPulse<'c> {
    /// `None` where there was no pulse, or nothing before it.
    pub(crate) fn of(cycles: &'c [Cycle]) -> Option<Self> {
        let first = cycles.iter().position(|cycle| cycle.pulse.is_some())?;
        let before = cycles.get(first.checked_sub(1)?)?;
        let begun = cycles[first].begun;
        Some(Self {
            cycles: &cycles[first..],
            from: before.output,
            period: begun - before.begun,
            begun,
        })
    }
}
