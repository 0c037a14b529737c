//! What the photodiodes say before there is any light to follow.

use crate::station::{Level, Station};
use pigtail_hal::spec::{CHANNELS, Channel};

/// Sums of the photodiodes in the dark.
#[derive(Debug, Default)]
pub(super) struct Dark {
    /// How many.
    pub(super) samples: f64,
    sum: [f64; CHANNELS],
    squares: [f64; CHANNELS],
}

impl Dark {
    pub(super) fn note(&mut self, station: &Station) {
        for channel in Channel::ALL {
            let Some(volts) = station.light(channel) else {
                return;
            };
            let i = channel.index();
            self.sum[i] += volts;
            self.squares[i] += volts * volts;
        }
        self.samples += 1.0;
    }

    /// Mean and spread of each. A background that happens to look quiet is still read in steps of the converter.
    pub(super) fn levels(&self, step: f64) -> [Level; CHANNELS] {
        let n = self.samples;
        std::array::from_fn(|i| {
            let mean = self.sum[i] / n;
            let variance = (self.squares[i] - n * mean * mean) / (n - 1.0);
            Level {
                mean,
                sigma: variance.max(0.0).sqrt().max(step),
            }
        })
    }
}

/// Whether a core of radius `core` has passed half of the chip's top by what it has `seen` on its
/// way up, heights and light: where that was, and the relative standard deviation of the light
/// before. What it sees now is beside the mean of what it saw when it was all below.
pub(super) fn top_below(seen: &[(f64, f64)], core: f64) -> Option<(f64, f64)> {
    const SAMPLES: usize = 3;
    /// A short look sees about two thirds of a slow fluctuation.
    const SHORT: f64 = 0.67;
    let recent = seen.get(seen.len().checked_sub(SAMPLES)?..)?;
    let mean = |part: &[(f64, f64)], of: fn(&(f64, f64)) -> f64| {
        part.iter().map(of).sum::<f64>() / part.len() as f64
    };
    let (y, level) = (mean(recent, |s| s.0), mean(recent, |s| s.1));
    let from = seen.partition_point(|s| s.0 < y - 2.5 * core);
    let to = seen.partition_point(|s| s.0 < y - core);
    if to < from + 2 * SAMPLES {
        return None;
    }
    let before = &seen[from..to];
    let full = mean(before, |s| s.1);
    if level > 0.5 * full {
        return None;
    }
    let squares = before.iter().map(|s| (s.1 - full).powi(2)).sum::<f64>();
    let spread = (squares / before.len() as f64).sqrt();
    Some((y, spread / (SHORT * full)))
}
