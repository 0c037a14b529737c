//! What the photodiodes say before there is any light to follow.

use crate::cell::AlignmentCell;
use crate::outcome::Halt;
use crate::station::Level;
use crate::tuning::TUNING;
use pigtail_hal::bench::Event;
use pigtail_hal::spec::{CHANNELS, Channel};
use pigtail_model::optics::disc_below_edge;
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

/// The photodiodes without the laser for so many seconds; it is on afterwards.
pub(super) async fn dark(cell: &AlignmentCell<'_>, seconds: f64) -> Result<Dark, Halt> {
    cell.laser(false)?;
    if cell.caps().least_power < 100 {
        // It may be lower since the device before.
        cell.laser_power(100)?;
    }
    cell.wait(cell.forgets_laser(Channel::Sensing.index()))
        .await?;
    let mut dark = Dark::default();
    let end = cell.now() + seconds;
    while !cell.is_past(end) || !dark.is_enough() {
        let by = if dark.is_enough() { end } else { f64::INFINITY };
        if let Event::Light(light) = cell.next(by).await? {
            cell.note_reading(light.time);
            dark.note(&light.volts);
        }
    }
    cell.laser(true)?;
    Ok(dark)
}

impl Dark {
    fn note(&mut self, volts: &[f64]) {
        for (seen, volts) in self.seen.iter_mut().zip(volts) {
            seen.push(*volts);
        }
    }

    /// Whether that is enough for a mean and a spread.
    fn is_enough(&self) -> bool {
        self.seen[0].len() >= TUNING.dark.least
    }

    /// Mean and spread of each. A background that happens to look quiet is still read in steps of the converter.
    pub(super) fn levels(&self, step: f64) -> [DarkLevel; CHANNELS] {
        std::array::from_fn(|i| {
            let seen = &self.seen[i];
            let n = seen.len() as f64;
            let mean = seen.iter().sum::<f64>() / n;
            let squares: f64 = seen.iter().map(|volts| (volts - mean).powi(2)).sum();
            let (mut left, mut degrees) = (0.0, 0.0);
            for part in seen
                .chunks(TUNING.dark.straight)
                .filter(|part| part.len() >= TUNING.dark.least)
            {
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

/// The chip's top, as a core that rises over it sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Top {
    /// Height at which half of the light is left, metres.
    pub(super) y: f64,
    /// Light below it, volts.
    full: f64,
    /// Relative standard deviation of that.
    pub(super) fluctuation: f64,
}

fn mean(part: &[(f64, f64)], of: impl Fn(&(f64, f64)) -> f64) -> f64 {
    part.iter().map(of).sum::<f64>() / part.len() as f64
}

/// The last samples of what was seen: their height and light.
fn recent(seen: &[(f64, f64)]) -> Option<(f64, f64)> {
    let recent = seen.get(seen.len().checked_sub(TUNING.dark.together)?..)?;
    Some((mean(recent, |s| s.0), mean(recent, |s| s.1)))
}

impl Top {
    /// Half of its light has not come back since.
    pub(super) fn rise(&mut self, seen: &[(f64, f64)]) {
        if let Some((y, level)) = recent(seen)
            && level > 0.5 * self.full
        {
            self.y = y;
        }
    }

    /// How far above it the middle of a core of a radius stands that sees light of a level, volts, metres. Fluctuations are a share of the light, and where
    /// there is hardly any they shift what is seen of the edge by little.
    pub(super) fn height_of(&self, level: f64, core: f64) -> f64 {
        /// To a thousandth of the radius.
        const STEPS: u32 = 10;
        let (mut low, mut high) = (-core, core);
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if disc_below_edge(middle, core) * self.full > level {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    /// Whether light is as good as none by now, for samples of which the noise has so large a standard deviation, volts.
    pub(super) fn is_below(&self, seen: &[(f64, f64)], sigma: f64) -> bool {
        let noise = TUNING.dark.noise * sigma / (TUNING.dark.together as f64).sqrt();
        recent(seen).is_some_and(|(_, level)| level < TUNING.dark.none * self.full + noise)
    }
}

/// The chip's top, where a core of radius `core` has passed half of it by what it has `seen` on its way up, heights and light.
/// What it sees now is beside the mean of what it saw when it was all below.
pub(super) fn top_below(seen: &[(f64, f64)], core: f64) -> Option<Top> {
    let (y, level) = recent(seen)?;
    let from = seen.partition_point(|s| s.0 < y - 2.5 * core);
    let to = seen.partition_point(|s| s.0 < y - core);
    if to < from + 2 * TUNING.dark.together {
        return None;
    }
    let before = &seen[from..to];
    let full = mean(before, |s| s.1);
    if level > 0.5 * full {
        return None;
    }
    let spread = mean(before, |s| (s.1 - full).powi(2)).sqrt();
    Some(Top {
        y,
        full,
        fluctuation: spread / (TUNING.dark.short * full),
    })
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

    /// After how much of what was seen there is a top, and that.
    fn passed(seen: &[(f64, f64)], core: f64) -> (usize, Top) {
        (1..=seen.len())
            .find_map(|n| Some((n, top_below(&seen[..n], core)?)))
            .expect("an edge")
    }

    #[test]
    fn the_top_is_where_half_of_the_light_is_left() {
        let core = 50e-6;
        let rise = rise(core);
        let (n, mut top) = passed(&rise, core);
        assert!(top.y.abs() < 6e-6, "{}", top.y);
        assert!(top.fluctuation < 0.01, "{}", top.fluctuation);
        assert!(!top.is_below(&rise[..n], 1e-3));
        assert!(top.is_below(&rise, 1e-3));
        let before = top.y;
        top.rise(&rise[..=n]);
        assert_eq!(top.y, before);
    }

    #[test]
    fn little_light_tells_how_high_a_core_stands() {
        let core = 50e-6;
        let rise = rise(core);
        let (_, top) = passed(&rise, core);
        for (y, light) in &rise[32..49] {
            assert!((top.height_of(*light, core) - y).abs() < 0.2e-6, "{y}");
        }
        // A fluctuation by a factor of two is some micrometres there.
        let (y, light) = rise[48];
        assert!((top.height_of(2.0 * light, core) - y).abs() < 8e-6);
        assert!((top.height_of(0.5 * light, core) - y).abs() < 8e-6);
    }

    #[test]
    fn light_that_comes_back_has_passed_no_top() {
        let (core, mut rise) = (50e-6, rise(50e-6));
        // A fluctuation, 60 um below the edge.
        for sample in rise.iter_mut().filter(|s| (-71e-6..-54e-6).contains(&s.0)) {
            sample.1 *= 0.4;
        }
        let (n, mut top) = passed(&rise, core);
        assert!(top.y < -50e-6);
        for k in n..=rise.len() {
            top.rise(&rise[..k]);
        }
        assert!(top.y.abs() < 8e-6, "{}", top.y);
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
