//! An observer that keeps a run's phases in the store.

use crate::progress::Progress;
use pigtail_control::station::{Observer, Sample};
use pigtail_hal::Error;
use pigtail_session::samples::Record;
use pigtail_store::runs::Run;

/// Enters each phase of a run's fibers when it ends.
#[derive(Debug)]
pub(crate) struct Phases<'a> {
    run: &'a Run,
    /// When the last one began, seconds of machine time.
    begun: f64,
    failed: Option<Error>,
}

impl<'a> Phases<'a> {
    /// Of this run.
    pub(crate) fn of(run: &'a Run) -> Self {
        Self {
            run,
            begun: 0.0,
            failed: None,
        }
    }

    /// Whether all could be entered. The machine was not stopped in the middle of a motion for one
    /// that could not; those after it were not tried.
    ///
    /// # Errors
    ///
    /// What hindered the first that could not.
    pub(crate) fn all_entered(self) -> Result<(), Error> {
        self.failed.map_or(Ok(()), Err)
    }
}

impl Observer for Phases<'_> {
    fn phase(&mut self, _: &str, _: &'static str, time: f64) {
        self.begun = time;
    }

    fn phase_over(&mut self, port: &str, phase: &'static str, time: f64) {
        if self.failed.is_none() {
            let seconds = time - self.begun;
            let entered = self.run.phase(port, phase, self.begun, seconds);
            self.failed = entered.err();
        }
    }

    fn sample(&mut self, _: &Sample) {}
}

/// What watches an alignment: the record, a progress bar beside it, and the store.
pub(crate) struct Watcher<'a> {
    pub(crate) record: Record,
    pub(crate) progress: Progress,
    pub(crate) phases: Phases<'a>,
}

impl<'a> Watcher<'a> {
    /// Of this run; `full` is the most that a photodiode or a power meter can read.
    pub(crate) fn of(run: &'a Run, full: f64) -> Self {
        Self {
            record: Record::default(),
            progress: Progress::new(full),
            phases: Phases::of(run),
        }
    }
}

impl Observer for Watcher<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.record.phase(port, phase, time);
        self.progress.phase(port, phase, time);
        self.phases.phase(port, phase, time);
    }

    fn phase_over(&mut self, port: &str, phase: &'static str, time: f64) {
        self.phases.phase_over(port, phase, time);
    }

    fn sample(&mut self, sample: &Sample) {
        self.record.sample(sample);
        self.progress.sample(sample);
    }
}
