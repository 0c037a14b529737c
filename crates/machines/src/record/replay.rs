//! A record as a machine: answers as it answered, as long as it is asked what it was asked.

use super::format::Exchange;
use super::{Reader, RecordError};
use pigtail_hal::spec::{AXES, MICRO_AXES};
use pigtail_hal::{Axis, AxisName, Command, Fault, Machine, Measurement, Rule, Side, Spec};

/// A record that is replayed. The first command that differs from the recorded one in any bit is a
/// [`Fault`] that names it.
#[derive(Debug)]
pub struct Replay {
    spec: Spec,
    reader: Reader,
    cycles: u64,
    time: f64,
    fault: Option<Fault>,
    error: Option<RecordError>,
}

impl Replay {
    /// Replays what is left of a record of a machine with this datasheet.
    pub fn new(spec: Spec, reader: Reader) -> Self {
        Self {
            spec,
            reader,
            cycles: 0,
            time: 0.0,
            fault: None,
            error: None,
        }
    }

    /// Exchanges that were as recorded.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// Machine time of the last one, seconds.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Why it answers no more, if it does not.
    pub fn fault(&self) -> Option<&Fault> {
        self.fault.as_ref()
    }

    /// Whether the record ended in the middle of a block.
    pub fn is_cut(&self) -> bool {
        self.reader.is_cut()
    }

    /// How many exchanges are left that nobody has asked for.
    ///
    /// # Errors
    ///
    /// When the record cannot be read to its end, or could not be before.
    pub fn left(&mut self) -> Result<u64, RecordError> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        let mut left = 0;
        while self.reader.next_exchange()?.is_some() {
            left += 1;
        }
        Ok(left)
    }

    fn refuse(&mut self, rule: Rule, axis: &str, value: String, limit: String) -> Fault {
        let fault = Fault {
            rule,
            axis: axis.to_owned(),
            value,
            limit,
            time: self.time,
        };
        self.fault = Some(fault.clone());
        fault
    }
}

impl Machine for Replay {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        if let Some(fault) = &self.fault {
            return Err(fault.clone());
        }
        let next = self.reader.next_exchange();
        let Exchange {
            command: recorded,
            answer,
        } = match next {
            Ok(Some(exchange)) => exchange,
            Ok(None) => {
                let cycles = self.cycles;
                return Err(self.refuse(
                    Rule::ReplayEnds,
                    "record",
                    format!("command {} is asked for", cycles + 1),
                    format!("{cycles} that were recorded"),
                ));
            }
            Err(error) => {
                let fault = self.refuse(
                    Rule::ReplayEnds,
                    "record",
                    error.to_string(),
                    "a whole record".to_owned(),
                );
                self.error = Some(error);
                return Err(fault);
            }
        };
        if let Some((what, is, was)) = difference(command, &recorded) {
            let cycle = self.cycles + 1;
            return Err(self.refuse(
                Rule::ReplayDiffers,
                &what,
                format!("{is} in command {cycle}"),
                format!("{was} as recorded"),
            ));
        }
        self.cycles += 1;
        match answer {
            Ok(measured) => {
                self.time = measured.time;
                Ok(measured)
            }
            Err(fault) => {
                self.fault = Some(fault.clone());
                Err(fault)
            }
        }
    }

    fn stop(&mut self) {}
}

/// The first thing in which two commands differ, and what each says.
fn difference(is: &Command, was: &Command) -> Option<(String, String, String)> {
    for side in Side::ALL {
        let i = side.index();
        for axis in Axis::ALL {
            let k = axis.index();
            let name = AxisName { side, axis };
            let (a, b) = (is.motors[i][k].0, was.motors[i][k].0);
            if a.to_bits() != b.to_bits() {
                return Some((
                    format!("{name} motor"),
                    format!("{a:?} V"),
                    format!("{b:?} V"),
                ));
            }
            let (a, b) = (is.references[i][k], was.references[i][k]);
            if a != b {
                return Some((
                    format!("{name} reference"),
                    format!("{a:?}"),
                    format!("{b:?}"),
                ));
            }
            let (a, b) = (is.pulses[i][k], was.pulses[i][k]);
            if a != b {
                return Some((format!("{name} pulse"), format!("{a:?}"), format!("{b:?}")));
            }
        }
        for k in 0..MICRO_AXES {
            let (a, b) = (is.micro[i][k].0, was.micro[i][k].0);
            if a.to_bits() != b.to_bits() {
                let name = format!("{}.micro{}", side.name(), k + 1);
                return Some((name, format!("{a:?} V"), format!("{b:?} V")));
            }
        }
        let (a, b) = (is.fiber[i], was.fiber[i]);
        if a != b {
            let name = format!("{} holder", side.name());
            return Some((name, format!("{a:?}"), format!("{b:?}")));
        }
    }
    let of = |command: &Command| (command.laser, command.laser_percent);
    (of(is) != of(was)).then(|| {
        let said = |(on, percent): (bool, u8)| {
            let on = if on { "on" } else { "off" };
            format!("{on}, at {percent} %")
        };
        ("laser".to_owned(), said(of(is)), said(of(was)))
    })
}

const _: () = assert!(AXES == 3, "differences name every axis");
