//! What was seen on the way: every phase and every light sample.

use pigtail_control::station::{Observer, Sample};
use pigtail_hal::{Channel, Side};
use std::fmt::Write as _;

/// A phase of a fiber's alignment, and the samples that fall into it.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseRecord {
    /// The port.
    pub port: String,
    /// The phase's name.
    pub name: &'static str,
    /// When it began, seconds of machine time.
    pub start: f64,
    /// Index of its first sample.
    pub first: usize,
}

/// An observer that keeps everything.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// The phases in order.
    pub phases: Vec<PhaseRecord>,
    /// The light samples in order.
    pub samples: Vec<Sample>,
}

impl Observer for Record {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.phases.push(PhaseRecord {
            port: port.to_owned(),
            name: phase,
            start: time,
            first: self.samples.len(),
        });
    }

    fn sample(&mut self, sample: &Sample) {
        self.samples.push(*sample);
    }
}

impl Record {
    /// The phases with the samples of each.
    pub fn phases(&self) -> impl Iterator<Item = (&PhaseRecord, &[Sample])> {
        self.phases.iter().enumerate().map(|(i, phase)| {
            let end = self
                .phases
                .get(i + 1)
                .map_or(self.samples.len(), |next| next.first);
            (phase, &self.samples[phase.first..end])
        })
    }

    /// The samples as CSV, a row each: time, fiber, phase, photodiodes, then for each manipulator
    /// the endpoint by its encoders and the displacement commanded to its micro.
    pub fn csv(&self) -> String {
        let mut out = String::with_capacity(150 * (self.samples.len() + 1));
        out.push_str("time_s,fiber,phase");
        for channel in Channel::ALL {
            let _ = write!(out, ",{}_V", channel.name());
        }
        for side in Side::ALL {
            for way in ["x", "y", "z", "micro_x", "micro_y"] {
                let _ = write!(out, ",{}_{way}_um", side.name());
            }
        }
        out.push('\n');
        for (phase, samples) in self.phases() {
            for sample in samples {
                let _ = write!(out, "{:.4},{},{}", sample.time, phase.port, phase.name);
                for volts in sample.light {
                    let _ = write!(out, ",{volts:.5}");
                }
                for (p, micro) in sample.endpoints.iter().zip(sample.micro) {
                    for metres in [p.x, p.y, p.z, micro.x, micro.y] {
                        let _ = write!(out, ",{:.4}", metres * 1e6);
                    }
                }
                out.push('\n');
            }
        }
        out
    }
}
