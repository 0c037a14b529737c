//! A simulated machine at the pace of a real one.

use pigtail_hal::{Command, Fault, Machine, Measurement, Spec};
use std::time::{Duration, Instant};

/// It catches up with the clock when it is so far ahead: shorter naps cost more than they rest.
const NAP: f64 = 2e-3;

/// A machine whose time does not run ahead of the clock.
#[derive(Debug)]
pub struct Pace<M> {
    machine: M,
    /// `None` where it goes as fast as it can.
    since: Option<Instant>,
}

impl<M> Pace<M> {
    /// A machine that begins now.
    pub fn new(machine: M) -> Self {
        Self {
            machine,
            since: Some(Instant::now()),
        }
    }

    /// A machine at its own pace.
    pub fn free(machine: M) -> Self {
        Self {
            machine,
            since: None,
        }
    }
}

impl<M: Machine> Machine for Pace<M> {
    fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    #[inline]
    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        // At no pace, what is measured is handed on where it lies: it is large.
        let Some(since) = self.since else {
            return self.machine.exchange(command);
        };
        let answer = self.machine.exchange(command);
        if let Ok(measured) = &answer {
            let ahead = measured.time - since.elapsed().as_secs_f64();
            if ahead > NAP {
                std::thread::sleep(Duration::from_secs_f64(ahead));
            }
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
