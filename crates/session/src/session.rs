//! A machine under guard, recorded and to be stopped, and the jobs that run on it.

use crate::guarded::guarded;
use crate::job::{Ended, Job, STEP, Work};
use crate::rig::Rig;
use pigtail_control::station::{Observer, Station, Unobserved};
use pigtail_hal::Machine;
use pigtail_machines::record::{Closing, RecordError};
use pigtail_machines::{Deadline, Guard, Pace, Panel, Recorder};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What stands around a machine: control > guard > recorder > stop button > pace > deadline > machine. The
/// record holds what the guard let through and what it did to stop.
type Watched<'m> = Guard<Recorder<Panel<Pace<Deadline<&'m mut dyn Machine>>>>>;

/// How a session treats its machine, beside guarding it.
#[derive(Debug, Clone)]
pub struct Options {
    /// A person's wish to stop: it comes to control as a measurement, so that a replay stops where the run
    /// did.
    pub stop: Arc<AtomicBool>,
    /// Whether the machine's time keeps to the clock.
    pub real_time: bool,
    /// Work that takes longer hangs, seconds of machine time.
    pub longest: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            stop: Arc::default(),
            real_time: false,
            longest: f64::INFINITY,
        }
    }
}

/// A machine that jobs run on. It is always guarded, and can be recorded and stopped. Whoever lent it has it
/// back when the session is gone, and may ask it what else it knows.
pub struct Session<'m> {
    rig: &'m Rig,
    machine: Watched<'m>,
}

impl<'m> Session<'m> {
    /// Opens a machine that stands at home: a twin, a replay, or one's own.
    pub fn open(rig: &'m Rig, machine: &'m mut dyn Machine) -> Self {
        Self::open_with(rig, machine, &Options::default())
    }

    /// The same, treated as the options say.
    pub fn open_with(rig: &'m Rig, machine: &'m mut dyn Machine, options: &Options) -> Self {
        let timed = Deadline::new(machine, options.longest);
        let paced = if options.real_time {
            Pace::new(timed)
        } else {
            Pace::free(timed)
        };
        let panel = Panel::new(paced, Arc::clone(&options.stop));
        Self {
            rig,
            machine: guarded(Recorder::idle(panel), rig),
        }
    }

    /// Records every exchange from now on to a new file; `about` is kept with it.
    ///
    /// # Errors
    ///
    /// When the file cannot be written.
    pub fn record(&mut self, path: &Path, about: &[u8]) -> Result<(), RecordError> {
        self.machine.inner_mut().begin(path, about)
    }

    /// Runs a job to its end and stops the machine.
    ///
    /// # Errors
    ///
    /// The way in which it ended without its result.
    pub fn run<J: Job>(
        &mut self,
        job: &J,
        observer: &mut dyn Observer,
    ) -> Result<J::Output, Ended> {
        self.machine.leave_out(job.breaks());
        let mut work = Work {
            machine: &mut self.machine,
            rig: self.rig,
            observer,
        };
        let result = job.run(&mut work);
        self.machine.stop();
        result
    }

    /// Runs an experiment that is nobody's job, unobserved, and stops the machine. It may set references as no
    /// motion would: the guard leaves out what that breaks.
    ///
    /// # Errors
    ///
    /// The way in which it ended without its result.
    pub fn experiment<T>(
        &mut self,
        experiment: impl FnOnce(&mut Station) -> Result<T, Ended>,
    ) -> Result<T, Ended> {
        self.machine.leave_out(STEP);
        let mut unobserved = Unobserved;
        let calibration = &self.rig.calibration;
        let mut station = Station::new(&mut self.machine, calibration, &mut unobserved)?;
        let result = experiment(&mut station);
        station.stop();
        result
    }

    /// Ends the record, if there is one; it goes on to the disk meanwhile.
    pub fn close_record(&mut self) -> Option<Closing> {
        self.machine.inner_mut().finish()
    }
}
