//! The trait that every machine implements.

use crate::{Command, Fault, Measurement, Spec};

/// A pigtailing machine: real, simulated or replayed.
///
/// Time exists only in the [`Measurement`]s that come back, so the same control code runs a
/// twin much faster than the clock and real hardware at the clock's pace.
///
/// Whatever decorates a machine (limits, a recorder) implements this trait again around
/// another machine, and control cannot tell the difference.
pub trait Machine {
    /// The datasheet.
    fn spec(&self) -> &Spec;

    /// One servo cycle: apply `command` for one period, then measure.
    ///
    /// # Errors
    ///
    /// A [`Fault`] when the machine has stopped. It is then safe, and answers every further
    /// command with the same fault until a person has cleared it.
    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault>;

    /// Stop at once and hold: motors without voltage, laser off, piezos as they are. Never fails:
    /// there is nothing left to try.
    fn stop(&mut self);

    /// Takes commands again after a fault, which a person has looked at or which somebody provoked on
    /// purpose, and says which it was; `None` where there was none, or where nothing here can clear it.
    fn clear(&mut self) -> Option<Fault> {
        None
    }
}

macro_rules! behind {
    ($pointer:ty) => {
        impl<M: Machine + ?Sized> Machine for $pointer {
            fn spec(&self) -> &Spec {
                (**self).spec()
            }

            fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
                (**self).exchange(command)
            }

            fn stop(&mut self) {
                (**self).stop();
            }

            fn clear(&mut self) -> Option<Fault> {
                (**self).clear()
            }
        }
    };
}

behind!(&mut M);
behind!(Box<M>);
