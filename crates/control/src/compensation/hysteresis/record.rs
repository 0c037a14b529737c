//! What was measured of a piezo: voltage and displacement over time.

use super::{Invalid, Range};
use pigtail_numerics::line::Line;

/// Voltage and displacement of a piezo over time. Whoever makes one is told what is wrong with the
/// data.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Seconds, rising; whole numbers where a record came without time.
    pub time: Vec<f64>,
    /// Voltage, or whatever drives the piezo.
    pub input: Vec<f64>,
    /// Displacement, in any unit.
    pub output: Vec<f64>,
    /// How much each sample counts, 0 to 1.
    pub weight: Vec<f64>,
    /// Turns of the input, first and last sample included.
    turns: Vec<usize>,
}

/// A way from one turn to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Swing {
    /// Its first sample.
    pub start: usize,
    /// The sample after its last.
    pub end: usize,
    /// Whether the input rises.
    pub rising: bool,
}

/// Fewest samples that a record needs.
pub const LEAST: usize = 100;

/// What counts as a turn: going back by this share of the input's range. Less is noise.
const TURN: f64 = 0.005;

impl Record {
    /// A record of samples in the order in which they were taken.
    ///
    /// # Errors
    ///
    /// When columns differ in length, are too short, not finite or constant, time does not rise,
    /// the input never turns, or the output falls where it rises.
    pub fn new(time: Vec<f64>, input: Vec<f64>, output: Vec<f64>) -> Result<Self, Invalid> {
        let weight = vec![1.0; time.len()];
        Self::weighted(time, input, output, weight)
    }

    /// A record some of whose samples count less than others.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn weighted(
        time: Vec<f64>,
        input: Vec<f64>,
        output: Vec<f64>,
        weight: Vec<f64>,
    ) -> Result<Self, Invalid> {
        let n = time.len();
        if input.len() != n || output.len() != n || weight.len() != n {
            let value = format!("{n}, {} and {} samples", input.len(), output.len());
            return Err(Invalid::new("record", value, "columns of one length"));
        }
        if n < LEAST {
            let accepted = format!("at least {LEAST}");
            return Err(Invalid::new("record", format!("{n} samples"), accepted));
        }
        for (name, column) in [("time", &time), ("input", &input), ("output", &output)] {
            if let Some(k) = column.iter().position(|v| !v.is_finite()) {
                let value = format!("{} in sample {}", column[k], k + 1);
                return Err(Invalid::new(name, value, "finite numbers"));
            }
        }
        if let Some(k) = time.windows(2).position(|w| w[1] <= w[0]) {
            let value = format!("{} after {} in sample {}", time[k + 1], time[k], k + 2);
            return Err(Invalid::new("time", value, "time that rises throughout"));
        }
        for (name, column) in [("input", &input), ("output", &output)] {
            let range = Range::of(column);
            if range.high <= range.low {
                let value = format!("{} in every sample", column[0]);
                return Err(Invalid::new(name, value, "a column that changes"));
            }
        }
        let turns = turns(&input, TURN * Range::of(&input).width());
        if turns.len() < 3 {
            let value = "an input that never turns";
            let accepted = "a way forward and back at least: there is no hysteresis in one way";
            return Err(Invalid::new("input", value, accepted));
        }
        let points = input.iter().copied().zip(output.iter().copied());
        if Line::through(points).slope <= 0.0 {
            let value = "falls where the input rises";
            return Err(Invalid::new(
                "output",
                value,
                "displacement that grows with voltage",
            ));
        }
        Ok(Self {
            time,
            input,
            output,
            weight,
            turns,
        })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Never, for a record has at least [`LEAST`] samples.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The input's range.
    pub fn input_range(&self) -> Range {
        Range::of(&self.input)
    }

    /// The output's range.
    pub fn output_range(&self) -> Range {
        Range::of(&self.output)
    }

    /// The ways between turns.
    pub fn swings(&self) -> impl Iterator<Item = Swing> + '_ {
        self.turns.windows(2).map(|w| Swing {
            start: w[0],
            end: w[1],
            rising: self.input[w[1]] > self.input[w[0]],
        })
    }

    /// Whether the swing that ends at `turn` rose from within `share` of the bottom of the range.
    pub(super) fn rises_from_bottom(&self, turn: usize, share: f64) -> bool {
        let range = self.input_range();
        self.turns
            .iter()
            .position(|t| *t == turn)
            .and_then(|i| i.checked_sub(1))
            .is_some_and(|i| self.input[self.turns[i]] < range.low + share * range.width())
    }

    /// The sample from which on a model knows where it is, whatever happened before the record:
    /// the input has been at both ends of its range, and so has wiped out all that came before.
    pub fn known_from(&self) -> usize {
        let range = self.input_range();
        let margin = 0.02 * range.width();
        let first = |found: &dyn Fn(f64) -> bool| self.input.iter().position(|v| found(*v));
        let low = first(&|v| v <= range.low + margin);
        let high = first(&|v| v >= range.high - margin);
        low.unwrap_or(0).max(high.unwrap_or(0))
    }

    /// The samples before `to`, as a record of its own.
    ///
    /// # Errors
    ///
    /// As [`Self::new`]: a part may be too short, or not turn.
    pub fn before(&self, to: usize) -> Result<Self, Invalid> {
        Self::weighted(
            self.time[..to].to_vec(),
            self.input[..to].to_vec(),
            self.output[..to].to_vec(),
            self.weight[..to].to_vec(),
        )
    }

    /// How long the input goes one way, seconds, by the median of ways that are no noise: there and back it goes by a tenth of its range at
    /// least. None where it hardly turns.
    pub(super) fn way(&self) -> Option<f64> {
        const WAY: f64 = 0.1;
        let turns = turns(&self.input, WAY * self.input_range().width());
        // Before the first turn and after the last one a way is not whole.
        let whole = turns.get(1..turns.len().saturating_sub(1))?;
        let mut ways: Vec<f64> = whole
            .windows(2)
            .map(|w| self.time[w[1]] - self.time[w[0]])
            .collect();
        ways.sort_by(f64::total_cmp);
        ways.get(ways.len() / 2).copied()
    }

    /// Sampling period by the median, seconds.
    pub fn period(&self) -> f64 {
        let mut steps: Vec<f64> = self.time.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps[steps.len() / 2]
    }

    /// The input `lag` seconds before sample `k`.
    pub fn input_before(&self, k: usize, lag: f64) -> f64 {
        interpolated(&self.time, &self.input, k, lag)
    }
}

/// A column `lag` seconds before sample `k`, between its samples; the ends hold beyond them.
pub fn interpolated(time: &[f64], column: &[f64], k: usize, lag: f64) -> f64 {
    let at = time[k] - lag;
    let mut i = k;
    while i > 0 && time[i] > at {
        i -= 1;
    }
    while i + 1 < time.len() && time[i + 1] < at {
        i += 1;
    }
    if i + 1 >= time.len() {
        return column[i];
    }
    let share = ((at - time[i]) / (time[i + 1] - time[i])).clamp(0.0, 1.0);
    column[i] + share * (column[i + 1] - column[i])
}

/// Where a column turns, its ends included; ways shorter than `least` are none.
fn turns(column: &[f64], least: f64) -> Vec<usize> {
    let mut turns = vec![0];
    // The furthest sample of the present way; its direction is not known at first.
    let (mut low, mut high, mut rising) = (0, 0, None);
    for (k, value) in column.iter().enumerate() {
        if *value > column[high] {
            high = k;
        }
        if *value < column[low] {
            low = k;
        }
        match rising {
            None if column[high] - column[low] > least => {
                rising = Some(high > low);
                // From rest at the first sample to the first way's beginning nothing happened.
                let start = high.min(low);
                if (column[start] - column[0]).abs() > 0.0 {
                    turns.push(start);
                }
                (low, high) = (k, k);
            }
            Some(true) if column[high] - value > least => {
                turns.push(high);
                rising = Some(false);
                low = k;
            }
            Some(false) if value - column[low] > least => {
                turns.push(low);
                rising = Some(true);
                high = k;
            }
            _ => {}
        }
        // While rising only the highest counts, and the other way round.
        match rising {
            Some(true) => low = high,
            Some(false) => high = low,
            None => {}
        }
    }
    turns.push(column.len() - 1);
    turns.dedup();
    turns
}
