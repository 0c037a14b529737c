//! How often the truth lies within control's own intervals.

use super::rows::ROWS_PER_DEVICE;
use anyhow::Result;
use pigtail_numerics::rounded;
use pigtail_numerics::statistics::{Percentiles, Sum};
use pigtail_store::rows::Rows;
use serde::Serialize;
use std::array::from_fn;

/// Shares whose intervals control states.
pub const SHARES: [f64; 4] = [0.5, 0.8, 0.95, 0.99];

/// Standard deviations within which a normal error is with a probability of 99 %.
const WITHIN_99: f64 = 2.575_829_303_548_901;

/// What an interval of 99 % leaves out at an end.
const OUTSIDE_ONE_END: f64 = 0.005;

/// Columns of the least shares whose intervals hold the truth.
const LEVELS: [&str; 3] = ["level_x", "level_y", "level_z"];

/// How often the truth lies within control's own intervals, over attached fibers of which it has some.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sureness {
    /// Fibers with a belief.
    pub fibers: u64,
    /// Share of them whose truth lies within the intervals of 50 %...
    pub within_50_percent: Shares,
    /// ...of 80 %...
    pub within_80_percent: Shares,
    /// ...of 95 %...
    pub within_95_percent: Shares,
    /// ...and of 99 %.
    pub within_99_percent: Shares,
    /// How well these shares are known.
    pub known: [Known; SHARES.len()],
    /// Half widths of the intervals of 95 %, in the median, micrometres: x and y, z.
    pub median_95_percent_um: [Option<f64>; 2],
    /// Sum of control's own probabilities that a fiber is out of tolerance: so many wrong ones it expects itself.
    pub stated_wrong: f64,
    /// Fibers that it was not sure of, and did not attach.
    pub unsure: u64,
}

/// Shares of fibers, by axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Shares {
    /// Across the chip.
    pub x: f64,
    /// Up from the chip.
    pub y: f64,
    /// Of the gap.
    pub z: f64,
}

/// Intervals of 99 % for the shares within control's intervals of so many percent. Machines differ, and the fibers of one machine are alike:
/// they are what drawing machines anew, with their fibers, would give (the variance of a ratio of sums over machines), where there are
/// enough machines for that to be normal; where all are within, or none, exact bounds of as many machines.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Known {
    /// Of control's intervals.
    pub percent: f64,
    /// Across the chip: from, to.
    pub x: Option<[f64; 2]>,
    /// Up from the chip.
    pub y: Option<[f64; 2]>,
    /// Of the gap.
    pub z: Option<[f64; 2]>,
}

/// Sums over machines of how many of their fibers are within an interval.
#[derive(Debug, Clone, Copy, Default)]
struct Within {
    all: f64,
    squares: f64,
    with_fibers: f64,
}

/// Over machines.
#[derive(Debug, Clone, Default)]
struct Machines {
    count: f64,
    fibers: f64,
    squares: f64,
    within: [[Within; 3]; SHARES.len()],
}

impl Machines {
    /// A machine with so many fibers, of which so many are within.
    fn add(&mut self, fibers: u64, within: &[[u64; 3]; SHARES.len()]) {
        if fibers == 0 {
            return;
        }
        let n = fibers as f64;
        self.count += 1.0;
        self.fibers += n;
        self.squares += n * n;
        let all = self.within.iter_mut().flatten();
        for (sums, count) in all.zip(within.iter().flatten()) {
            let k = *count as f64;
            sums.all += k;
            sums.squares += k * k;
            sums.with_fibers += k * n;
        }
    }

    fn share(&self, of: usize, axis: usize) -> f64 {
        self.within[of][axis].all / self.fibers
    }

    /// Where it is with a probability of 99 %; `None` of a single machine.
    fn interval(&self, of: usize, axis: usize) -> Option<[f64; 2]> {
        let (p, sums) = (self.share(of, axis), self.within[of][axis]);
        if self.count < 2.0 {
            return None;
        }
        let squares = sums.squares - 2.0 * p * sums.with_fibers + p * p * self.squares;
        let free = self.count / (self.count - 1.0);
        let off = WITHIN_99 * (free * squares.max(0.0)).sqrt() / self.fibers;
        let mut ends = [(p - off).max(0.0), (p + off).min(1.0)];
        // Machines that do not differ tell no variance. That all of so many have all of their fibers within (or outside) bounds
        // the share of machines of which that is true, and with it the fibers'.
        let alike = OUTSIDE_ONE_END.powf(1.0 / self.count);
        if sums.all >= self.fibers {
            ends[0] = alike;
        } else if sums.all <= 0.0 {
            ends[1] = 1.0 - alike;
        }
        Some(ends.map(|share| rounded(share, 1e-6)))
    }
}

impl Sureness {
    /// Of a campaign's rows, `devices_each` on a machine.
    pub(super) fn of(rows: &Rows, devices_each: u64, unsure: u64) -> Result<Option<Self>> {
        let machines = machines(rows, devices_each * ROWS_PER_DEVICE)?;
        if machines.fibers == 0.0 {
            return Ok(None);
        }
        let shares = |of: usize| {
            let [x, y, z] = from_fn(|axis| rounded(machines.share(of, axis), 1e-6));
            Shares { x, y, z }
        };
        let known = from_fn(|of| {
            let [x, y, z] = from_fn(|axis| machines.interval(of, axis));
            let percent = rounded(100.0 * SHARES[of], 1e-6);
            Known { percent, x, y, z }
        });
        let median = |name: &str| -> Result<Option<f64>> {
            Ok(Percentiles::of(|each| rows.each_number(name, each))?.p50)
        };
        let mut stated = Sum::default();
        rows.each_number("stated_outside", |share| stated.add(share))?;
        Ok(Some(Self {
            fibers: machines.fibers as u64,
            within_50_percent: shares(0),
            within_80_percent: shares(1),
            within_95_percent: shares(2),
            within_99_percent: shares(3),
            known,
            median_95_percent_um: [median("believed_x_um")?, median("believed_z_um")?],
            stated_wrong: rounded(stated.value(), 1e-9),
            unsure,
        }))
    }
}

/// Counts of every machine, one after the other: rows come in the order of machines.
fn machines(rows: &Rows, rows_each: u64) -> Result<Machines> {
    let mut machines = Machines::default();
    let (mut row, mut fibers, mut within) = (0_u64, 0_u64, Default::default());
    for group in rows.groups(&LEVELS) {
        let group = group?;
        let [x, y, z] = LEVELS.map(|name| group.numbers(name));
        for levels in x.into_iter().zip(y).zip(z) {
            if row.is_multiple_of(rows_each) {
                machines.add(fibers, &within);
                (fibers, within) = (0, Default::default());
            }
            row += 1;
            let ((Some(x), Some(y)), Some(z)) = levels else {
                continue;
            };
            fibers += 1;
            for (within, share) in within.iter_mut().zip(SHARES) {
                for (within, level) in within.iter_mut().zip([x, y, z]) {
                    *within += u64::from(level <= share);
                }
            }
        }
    }
    machines.add(fibers, &within);
    Ok(machines)
}

/// Which share of fibers is within control's intervals of each of so many shares, x, y and z: the points of a reliability diagram.
///
/// # Errors
///
/// When the rows cannot be read.
pub fn reliability(rows: &Rows, of: &[f64]) -> Result<[Vec<(f64, f64)>; 3]> {
    let mut curves = [const { Vec::new() }; 3];
    for (curve, name) in curves.iter_mut().zip(LEVELS) {
        let (mut fibers, mut within) = (0_u64, vec![0_u64; of.len()]);
        rows.each_number(name, |level| {
            fibers += 1;
            for (within, share) in within.iter_mut().zip(of) {
                *within += u64::from(level <= *share);
            }
        })?;
        let share = |within: &u64| *within as f64 / fibers.max(1) as f64;
        *curve = of.iter().copied().zip(within.iter().map(share)).collect();
    }
    Ok(curves)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(within: u64) -> [[u64; 3]; SHARES.len()] {
        [[within; 3]; SHARES.len()]
    }

    #[test]
    fn machines_that_are_alike_tell_as_much_as_their_fibers() {
        let mut machines = Machines::default();
        // Of 400 machines with one fiber each 380 are within.
        for k in 0..400_u64 {
            machines.add(1, &counts(u64::from(!k.is_multiple_of(20))));
        }
        let [low, high] = machines.interval(2, 0).unwrap();
        let off = WITHIN_99 * (0.95_f64 * 0.05 / 400.0).sqrt();
        assert!((high - low - 2.0 * off).abs() < 1e-3, "{low} {high} {off}");
    }

    #[test]
    fn that_all_are_within_is_known_no_better_than_so_many_machines_tell() {
        for (count, low) in [(5, 0.3466), (1000, 0.9947)] {
            let (mut all, mut none) = (Machines::default(), Machines::default());
            for _ in 0..count {
                all.add(3, &counts(3));
                none.add(3, &counts(0));
            }
            let [from, to] = all.interval(1, 2).unwrap();
            assert!((from - low).abs() < 1e-4, "{from}");
            assert_eq!(to, 1.0);
            let [from, to] = none.interval(1, 2).unwrap();
            assert_eq!(from, 0.0);
            assert!((1.0 - to - low).abs() < 1e-4, "{to}");
        }
    }

    #[test]
    fn machines_that_differ_tell_less_than_their_fibers() {
        let mut machines = Machines::default();
        // All fibers of one machine of twenty are outside.
        for k in 0..40_u64 {
            machines.add(30, &counts(if k % 20 == 0 { 0 } else { 30 }));
        }
        machines.add(0, &counts(0));
        let [low, high] = machines.interval(2, 1).unwrap();
        let off = WITHIN_99 * (0.95_f64 * 0.05 / 40.0).sqrt();
        assert!((0.95 - low - off).abs() < 2e-3, "{low} {high} {off}");
        assert_eq!(high, 1.0);
        assert_eq!(Machines::default().interval(0, 0), None);
    }
}
