//! Voltages that were not applied: readings that were lost, wild or of another channel for a while.
//!
//! A voltage may jump, so that no smoothness tells them. But a model with memory remembers each of them, and is another one from there on.
//! A piezo tells them: its displacement goes with its voltage, and where a voltage jumps away and back without it none was applied.

use pigtail_control::compensation::hysteresis::Range;
use pigtail_sysid::timeline::Even;
use std::ops::Range as Rows;

/// A step is none of the path's by so many of the fast ones of it.
const FAR: f64 = 3.0;

/// The steps of a path are those that most of it has: what is wild may be many.
const MOST: f64 = 0.9;

/// Longest run that is bridged, rows, as for a displacement.
const LONGEST: usize = 12;

/// Of what a voltage that was applied makes of the displacement this share is there at least.
const FOLLOWS: f64 = 0.5;

/// Bridges runs of voltages that were not applied; how many rows that are. Columns are displacement and voltage.
pub(super) fn bridge(even: &mut Even) -> usize {
    let steps = even.stretches.iter().flat_map(|s| {
        let volts = &s.columns[1];
        volts.windows(2).map(|w| (w[1] - w[0]).abs())
    });
    let usual = pigtail_numerics::signal::quantile(&steps.collect::<Vec<f64>>(), MOST);
    if usual.is_nan() || usual <= 0.0 {
        return 0;
    }
    let width = |column: usize| {
        let all = even.stretches.iter().flat_map(|s| &s.columns[column]);
        let found = Range::of(&all.copied().collect::<Vec<f64>>());
        found.width()
    };
    let gain = width(0) / width(1).max(f64::MIN_POSITIVE);
    let mut rows = 0;
    for stretch in &mut even.stretches {
        let [places, volts, ..] = &mut stretch.columns[..] else {
            continue;
        };
        let mut from = 1;
        while let Some(run) = next(volts, from, usual) {
            let told = straight(volts, &run);
            from = if follows(places, &told, volts, &run, gain) {
                run.start + 1
            } else {
                rows += run.len();
                volts[run.clone()].copy_from_slice(&told);
                run.end
            };
        }
    }
    rows
}

/// The next run, from a row on, into which a voltage jumps and from which it comes back.
fn next(volts: &[f64], from: usize, usual: f64) -> Option<Rows<usize>> {
    let step = |k: usize| (volts[k] - volts[k - 1]).abs();
    (from..volts.len().saturating_sub(2))
        .filter(|k| step(*k) > FAR * usual)
        .find_map(|start| {
            let before = volts[start - 1];
            let back = |end: &usize| {
                let way = (end - start + 1) as f64 * usual;
                (volts[*end] - before).abs() <= 1.5 * way
                    && step(*end) > FAR * usual
                    && step(end + 1) <= FAR * usual
            };
            let last = (start + LONGEST).min(volts.len() - 2);
            let end = (start + 1..=last).find(back)?;
            Some(start..end)
        })
}

/// What the voltage was in a run, from the row before it to the one after.
fn straight(volts: &[f64], run: &Rows<usize>) -> Vec<f64> {
    let (a, b) = (volts[run.start - 1], volts[run.end]);
    let whole = (run.len() + 1) as f64;
    (1..=run.len())
        .map(|k| a + (b - a) * k as f64 / whole)
        .collect()
}

/// Whether a displacement goes with what a voltage has in a run beyond what it was told to be.
fn follows(places: &[f64], told: &[f64], volts: &[f64], run: &Rows<usize>, gain: f64) -> bool {
    let most = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
    let jump = most(&mut volts[run.clone()].iter().zip(told).map(|(v, t)| v - t));
    // It may be late by as much as the run is long.
    let to = (run.end + run.len()).min(places.len() - 1);
    let (a, b) = (places[run.start - 1], places[to]);
    let whole = (to + 1 - run.start) as f64;
    let chord = |k: usize| a + (b - a) * (k + 1 - run.start) as f64 / whole;
    let moved = most(&mut (run.start..to).map(|k| places[k] - chord(k)));
    moved > FOLLOWS * gain * jump
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_sysid::timeline::even;

    #[test]
    fn a_voltage_that_was_not_applied_is_bridged_and_a_pulse_is_not() {
        let time: Vec<f64> = (0..4000).map(|k| 0.005 * f64::from(k)).collect();
        let path: Vec<f64> = time.iter().map(|t| 5.0 + 4.0 * (6.0 * t).sin()).collect();
        let mut volts = path.clone();
        let mut places: Vec<f64> = path.iter().map(|v| 1e-5 * v).collect();
        for v in &mut volts[500..507] {
            *v = 0.0;
        }
        volts[900] += 3.0;
        // One that was applied.
        for k in 1500..1505 {
            volts[k] += 2.0;
            places[k] += 2e-5;
        }
        let mut record = even(&time, &[&places, &volts]).unwrap();
        assert_eq!(bridge(&mut record), 8);
        for (k, v) in record.stretches[0].columns[1].iter().enumerate() {
            let pulse = if (1500..1505).contains(&k) { 2.0 } else { 0.0 };
            // A chord over seven rows lies 0.03 V below the path.
            assert!((v - path[k] - pulse).abs() < 0.04, "{k}: {v}");
        }
    }
}
