//! What the photodiodes say before there is any light to follow.

use crate::station::{Level, Station};
use pigtail_hal::spec::{CHANNELS, Channel};
use pigtail_numerics::line::Line;

/// The photodiodes in the dark.
#[derive(Debug, Default)]
pub(super) struct Dark {
    seen: [Vec<f64>; CHANNELS],
}

/// What a photodiode reads in the dark.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct DarkLevel {
    /// Mean and spread.
    pub(super) level: Level,
    /// Standard deviation of a sample beside what wanders slowly, volts.
    pub(super) still: f64,
    /// By how many degrees of freedom that is known.
    pub(super) degrees: f64,
}

/// Samples about which what wanders slowly is as good as a straight line.
const STRAIGHT: usize = 50;

/// A mean and a spread are taken from so many, at least.
const LEAST: usize = 4;

impl Dark {
    pub(super) fn note(&mut self, station: &Station) {
        for channel in Channel::ALL {
            let Some(volts) = station.light(channel) else {
                return;
            };
            self.seen[channel.index()].push(volts);
        }
    }

    /// Whether that is enough for a mean and a spread.
    pub(super) fn is_enough(&self) -> bool {
        self.seen[0].len() >= LEAST
    }

    /// Mean and spread of each. A background that happens to look quiet is still read in steps of the converter.
    pub(super) fn levels(&self, step: f64) -> [DarkLevel; CHANNELS] {
        std::array::from_fn(|i| {
            let seen = &self.seen[i];
            let n = seen.len() as f64;
            let mean = seen.iter().sum::<f64>() / n;
            let squares: f64 = seen.iter().map(|volts| (volts - mean).powi(2)).sum();
            let (mut left, mut degrees) = (0.0, 0.0);
            for part in seen.chunks(STRAIGHT).filter(|part| part.len() >= LEAST) {
                let points = part.iter().enumerate().map(|(k, volts)| (k as f64, *volts));
                let line = Line::through(points.clone());
                left += points
                    .map(|(k, volts)| line.left(k, volts).powi(2))
                    .sum::<f64>();
                degrees += part.len() as f64 - 2.0;
            }
            let spread = |squares: f64, degrees: f64| (squares / degrees).sqrt().max(step);
            DarkLevel {
                level: Level {
                    mean,
                    sigma: spread(squares, n - 1.0),
                },
                still: spread(left, degrees),
                degrees,
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Light of a core that rises over an edge at height zero, by steps of 5 um.
    fn rise(core: f64) -> Vec<(f64, f64)> {
        (-40..40)
            .map(|k| {
                let y = 5e-6 * f64::from(k);
                let share = (y / core).clamp(-1.0, 1.0);
                let above =
                    (share.acos() - share * (1.0 - share * share).sqrt()) / std::f64::consts::PI;
                (y, above)
            })
            .collect()
    }

    #[test]
    fn the_top_is_where_half_of_the_light_is_left() {
        let core = 50e-6;
        let rise = rise(core);
        let (y, fluctuation) = (1..=rise.len())
            .find_map(|n| top_below(&rise[..n], core))
            .expect("an edge");
        assert!(y.abs() < 6e-6, "{y}");
        assert!(fluctuation < 0.01, "{fluctuation}");
    }

    #[test]
    fn without_an_edge_or_a_plateau_there_is_no_top() {
        let flat: Vec<_> = (0..80).map(|k| (5e-6 * f64::from(k), 1.0)).collect();
        assert_eq!(top_below(&flat, 50e-6), None);
        let dark: Vec<_> = (0..8).map(|k| (5e-6 * f64::from(k), 0.0)).collect();
        assert_eq!(top_below(&dark, 50e-6), None);
        assert_eq!(top_below(&[], 50e-6), None);
    }
}
