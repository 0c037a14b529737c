//! A bar a phase with the light level, on a terminal; nothing elsewhere.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pigtail_control::job::PORTS;
use pigtail_control::station::{Observer, Sample};
use pigtail_hal::Channel;
use std::time::Duration;

/// Shows each phase as it runs. indicatif draws on standard error, and only on a terminal.
pub(crate) struct Progress {
    bar: ProgressBar,
    /// Light that fills the bar, volts.
    full: f64,
    start: f64,
    last: f64,
    brightest: f64,
    channel: Channel,
}

/// Light, in a unit that shows it: what couples first is a thousandth of what couples in the end.
pub(crate) fn light(volts: f64) -> String {
    let size = volts.abs();
    if size >= 0.1 {
        format!("{volts:5.3} V ")
    } else if size >= 1e-4 {
        format!("{:5.2} mV", 1e3 * volts)
    } else {
        format!("{:5.1} uV", 1e6 * volts)
    }
}

/// Resolution of the bar.
const PARTS: u64 = 1000;

impl Progress {
    pub(crate) fn new(full: f64) -> Self {
        Self {
            bar: ProgressBar::hidden(),
            full,
            start: 0.0,
            last: 0.0,
            brightest: 0.0,
            channel: Channel::Sensing,
        }
    }

    pub(crate) fn finish(&mut self) {
        self.message();
        // A phase leaves its line behind.
        self.bar.abandon();
        self.bar = ProgressBar::hidden();
    }

    fn message(&self) {
        self.bar.set_message(format!(
            "{:5.1} s  {}",
            self.last - self.start,
            light(self.brightest)
        ));
    }
}

impl Observer for Progress {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.last = time;
        if self.start < time {
            self.finish();
        }
        self.bar =
            ProgressBar::with_draw_target(Some(PARTS), ProgressDrawTarget::stderr_with_hz(20));
        if let Ok(style) = ProgressStyle::with_template("{prefix:17} [{bar:20}] {msg}") {
            self.bar.set_style(style.progress_chars("=> "));
        }
        self.bar.set_prefix(format!("{port:8} {phase}"));
        self.bar.enable_steady_tick(Duration::from_millis(100));
        self.start = time;
        self.brightest = 0.0;
        // The input is watched through the sensing fiber, an output through itself.
        self.channel = PORTS[1..]
            .iter()
            .position(|output| *output == port)
            .map_or(Channel::Sensing, Channel::of_output);
    }

    fn sample(&mut self, sample: &Sample) {
        self.last = sample.time;
        self.brightest = self.brightest.max(sample.light[self.channel.index()]);
        let share = (self.brightest / self.full).clamp(0.0, 1.0);
        self.bar.set_position((share * PARTS as f64) as u64);
    }
}

/// Shows that something is done whose end is not known, and for how long, until it is dropped; on a terminal only.
pub(crate) struct Busy(ProgressBar);

impl Busy {
    pub(crate) fn new(command: &'static str, what: &'static str) -> Self {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{prefix} {spinner} {elapsed} {msg}") {
            bar.set_style(style);
        }
        bar.set_prefix(command);
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(100));
        Self(bar)
    }
}

/// A search for first light whose end is not known: its machine time and the brightest light so far.
pub(crate) struct Searching {
    busy: Busy,
    brightest: f64,
    /// Machine time that was told last, seconds.
    told: f64,
}

impl Searching {
    pub(crate) fn new() -> Self {
        Self {
            busy: Busy::new("align", "searching"),
            brightest: 0.0,
            told: 0.0,
        }
    }
}

impl Observer for Searching {
    fn phase(&mut self, _: &str, _: &'static str, _: f64) {}

    fn sample(&mut self, sample: &Sample) {
        self.brightest = sample.light.iter().copied().fold(self.brightest, f64::max);
        // Millions of readings come: a text for each would take longer than they do.
        if sample.time - self.told >= 1.0 {
            self.told = sample.time;
            self.busy.0.set_message(format!(
                "searched {:.0} s of machine time, brightest {}",
                sample.time,
                light(self.brightest)
            ));
        }
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
