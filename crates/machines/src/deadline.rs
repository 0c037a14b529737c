//! A machine that stops when its time is over: for work that must not go on for ever.

use pigtail_hal::{Command, Fault, Machine, Measurement, Rule, Spec};

/// A machine that works until a time.
#[derive(Debug, Clone)]
pub struct Deadline<M> {
    machine: M,
    seconds: f64,
    time: f64,
    fault: Option<Fault>,
}

impl<M> Deadline<M> {
    /// A machine that works until `seconds` of machine time.
    pub fn new(machine: M, seconds: f64) -> Self {
        Self {
            machine,
            seconds,
            time: 0.0,
            fault: None,
        }
    }
}

impl<M: Machine> Deadline<M> {
    #[cold]
    fn late(&mut self) -> Fault {
        self.machine.stop();
        let fault = Fault {
            rule: Rule::Deadline,
            axis: "machine".to_owned(),
            value: format!("{:.0} s", self.time),
            limit: format!("{:.0} s", self.seconds),
            time: self.time,
        };
        self.fault = Some(fault.clone());
        fault
    }
}

impl<M: Machine> Machine for Deadline<M> {
    fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    #[inline]
    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        if let Some(fault) = &self.fault {
            return Err(fault.clone());
        }
        if self.time > self.seconds {
            return Err(self.late());
        }
        let answer = self.machine.exchange(command);
        if let Ok(measured) = &answer {
            self.time = measured.time;
        }
        answer
    }

    fn stop(&mut self) {
        self.machine.stop();
    }

    fn clear(&mut self) -> Option<Fault> {
        self.machine.clear()
    }
}
