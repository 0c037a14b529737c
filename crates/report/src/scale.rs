//! How a value becomes a place on a picture, and which values stand at an axis.

use std::ops::Range;

/// An axis: its ends in the data's unit, where it lies in the picture, and whether it is logarithmic.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scale {
    pub(super) ends: Range<f64>,
    pub(super) place: Range<f64>,
    pub(super) log: bool,
}

impl Scale {
    /// Where a value lies; what a logarithmic axis cannot show is at its start.
    pub(super) fn at(&self, value: f64) -> f64 {
        let (from, to) = (self.of(self.ends.start), self.of(self.ends.end));
        let share = (self.of(value) - from) / (to - from);
        self.place.start + share * (self.place.end - self.place.start)
    }

    fn of(&self, value: f64) -> f64 {
        if self.log {
            value.max(f64::MIN_POSITIVE).log10()
        } else {
            value
        }
    }

    /// Values to be marked, about `room` units of the picture apart, with their texts; those without a text are
    /// lines only. `whole` leaves out what is no whole number.
    pub(super) fn ticks(&self, room: f64, whole: bool) -> Vec<(f64, String)> {
        let (low, high) = (
            self.ends.start.min(self.ends.end),
            self.ends.start.max(self.ends.end),
        );
        let count = ((self.place.end - self.place.start).abs() / room).max(2.0);
        if self.log {
            return decades(low, high, count);
        }
        let least = if whole { 1.0 } else { 0.0 };
        let mut step = nice((high - low) / count).max(least);
        if !step.is_normal() {
            return Vec::new();
        }
        // An axis with a number or two tells little: the next finer step, if there is room for it.
        let finer = nice(0.35 * step).max(least);
        if steps(low, high, step).count() < FEW && finer * count > CLOSE * (high - low) {
            step = finer;
        }
        let digits = (-(step * 1.0001).log10().floor()).clamp(0.0, 9.0) as usize;
        let ticks = steps(low, high, step);
        ticks.map(|v| (v, written(v, digits))).collect()
    }
}

/// Fewer numbers at an axis than this are too few, if more have room: as near as this share of the usual distance.
const FEW: usize = 4;
const CLOSE: f64 = 0.6;

/// The whole multiples of a step from a value to another one.
fn steps(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    let (first, last) = ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
    let count = (last - first + 1.0).max(0.0) as usize;
    (0..count).map(move |k| (first + k as f64) * step)
}

/// The next of 1, 2 and 5 times a power of ten.
fn nice(step: f64) -> f64 {
    let power = 10_f64.powf(step.log10().floor());
    let times = [1.0, 2.0, 5.0]
        .into_iter()
        .find(|m| step <= m * power * 1.0001);
    times.unwrap_or(10.0) * power
}

/// Decades with their numbers. Between them 2 and 5 have numbers too where a decade is wide, and the rest lines
/// alone.
fn decades(low: f64, high: f64, count: f64) -> Vec<(f64, String)> {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let wide = f64::from(last - first) * 3.0 <= 1.5 * count;
    let every = (f64::from(last - first) / count).ceil().max(1.0) as i32;
    let mut ticks = Vec::new();
    for decade in first..=last {
        for m in 1..10 {
            let value = f64::from(m) * 10_f64.powi(decade);
            if value < low * (1.0 - 1e-9) || value > high * (1.0 + 1e-9) {
                continue;
            }
            let named = (m == 1 && (decade - first) % every == 0) || (wide && (m == 2 || m == 5));
            let text = if !named {
                String::new()
            } else if (-4..6).contains(&decade) {
                written(value, (-decade).max(0) as usize)
            } else {
                format!("{value:e}")
            };
            ticks.push((value, text));
        }
    }
    ticks
}

fn written(value: f64, digits: usize) -> String {
    let text = if value.abs() >= 1e7 {
        format!("{value:e}")
    } else {
        format!("{value:.digits$}")
    };
    if text.chars().all(|c| "-0.".contains(c)) {
        "0".to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(ends: Range<f64>, log: bool, whole: bool) -> Vec<String> {
        let scale = Scale {
            ends,
            place: 0.0..800.0,
            log,
        };
        let ticks = scale.ticks(100.0, whole);
        ticks
            .into_iter()
            .map(|t| t.1)
            .filter(|t| !t.is_empty())
            .collect()
    }

    #[test]
    fn numbers_have_the_digits_of_their_distance() {
        assert_eq!(
            texts(0.0..0.4, false, false).join(" "),
            "0 0.05 0.10 0.15 0.20 0.25 0.30 0.35 0.40"
        );
        assert_eq!(texts(-0.9..4.2, false, true).join(" "), "0 1 2 3 4");
        // An axis may run backward.
        assert_eq!(
            texts(30.0..0.0, false, false).join(" "),
            "0 5 10 15 20 25 30"
        );
    }

    #[test]
    fn an_axis_has_more_than_two_numbers_where_there_is_room() {
        let narrow = |ends| Scale {
            ends,
            place: 0.0..280.0,
            log: false,
        };
        let of = |ends| -> Vec<String> {
            let ticks = narrow(ends).ticks(82.0, false);
            ticks.into_iter().map(|t| t.1).collect()
        };
        assert_eq!(of(-159.0..-52.0).join(" "), "-140 -120 -100 -80 -60");
        assert_eq!(of(0.0..1.0).join(" "), "0 0.2 0.4 0.6 0.8 1.0");
    }

    #[test]
    fn a_logarithmic_axis_has_decades() {
        assert_eq!(
            texts(0.8..300.0, true, false).join(" "),
            "1 2 5 10 20 50 100 200"
        );
        assert_eq!(
            texts(1e-3..1e5, true, false).join(" "),
            "0.001 0.01 0.1 1 10 100 1000 10000 100000"
        );
    }
}
