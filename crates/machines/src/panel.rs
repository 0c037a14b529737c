//! The panel: a stop button beside any machine.

use pigtail_hal::{Command, Fault, Machine, Measurement, Spec};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A machine with a button. Pressed, it shows in the next measurement, where a guard sees it: so it
/// is recorded with all else, and a replay stops where the run did.
#[derive(Debug)]
pub struct Panel<M> {
    machine: M,
    pressed: Arc<AtomicBool>,
}

impl<M> Panel<M> {
    /// A machine that `pressed` asks to stop.
    pub fn new(machine: M, pressed: Arc<AtomicBool>) -> Self {
        Self { machine, pressed }
    }
}

impl<M: Machine> Machine for Panel<M> {
    fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    #[inline]
    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        // Where it is not pressed, what is measured is handed on where it lies: it is large.
        if !self.pressed.load(Ordering::Relaxed) {
            return self.machine.exchange(command);
        }
        let mut measured = self.machine.exchange(command)?;
        measured.stop = true;
        Ok(measured)
    }

    fn stop(&mut self) {
        self.machine.stop();
    }

    fn clear(&mut self) -> Option<Fault> {
        self.machine.clear()
    }
}
