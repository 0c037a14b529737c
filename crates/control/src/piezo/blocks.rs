//! What is seen while a piezo is driven, and the record that is made of it.

use super::{BLOCK, Series};
use crate::compensation::hysteresis::{Creep, Invalid, Memory, Model, Record, fit_memory};
use crate::outcome::Outcome;
use pigtail_hal::spec::MICRO_AXES;
use std::ops::Range;

/// Means of so many light samples, and where and when they were taken.
#[derive(Debug, Default)]
pub(super) struct Blocks {
    /// The piezo that was driven.
    piezo: usize,
    pub(super) time: Vec<f64>,
    /// Of both piezos.
    pub(super) volts: Vec<[f64; MICRO_AXES]>,
    pub(super) light: Vec<f64>,
    /// Mean of the frames exposed within it, the tip's x, metres.
    pub(super) frame: Vec<Option<f64>>,
    /// Of each place.
    pub(super) places: Vec<Range<usize>>,
}

impl Blocks {
    /// Of a series and the places in it at which this piezo was driven. What came between is of the
    /// piezo's history.
    pub(super) fn new(series: &Series, places: &[Range<usize>], piezo: usize) -> Self {
        let mut blocks = Self {
            piezo,
            ..Self::default()
        };
        let mut from = 0;
        let mut frames = series.frames.iter().peekable();
        let mut add = |blocks: &mut Self, over: Range<usize>| {
            let n = over.len() as f64;
            let mean = |column: &[f64]| column[over.clone()].iter().sum::<f64>() / n;
            let begin = series.time[over.start];
            let end = series.time[over.end - 1];
            blocks.time.push(mean(&series.time));
            blocks.volts.push(std::array::from_fn(|i| {
                series.volts[over.clone()].iter().map(|v| v[i]).sum::<f64>() / n
            }));
            blocks.light.push(mean(&series.light));
            while frames.next_if(|(time, _)| *time < begin).is_some() {}
            let exposed = frames.next_if(|(time, _)| *time <= end);
            blocks.frame.push(exposed.map(|(_, x)| *x));
        };
        for place in places {
            for start in (from..place.start).step_by(BLOCK) {
                add(&mut blocks, start..(start + BLOCK).min(place.start));
            }
            let begin = blocks.time.len();
            for start in place.clone().step_by(BLOCK) {
                add(&mut blocks, start..(start + BLOCK).min(place.end));
            }
            blocks.places.push(begin..blocks.time.len());
            from = place.end;
        }
        blocks
    }

    /// A record of displacements where there are some; elsewhere what stands for it, without
    /// weight.
    pub(super) fn record(
        &self,
        known: impl Fn(usize) -> Option<(f64, f64)>,
        elsewhere: &[f64],
    ) -> Result<Record, Outcome> {
        let n = self.time.len();
        let (mut way, mut weight) = (elsewhere.to_vec(), vec![0.0; n]);
        for k in 0..n {
            if let Some((at, counts)) = known(k) {
                (way[k], weight[k]) = (at, counts);
            }
        }
        let most = weight.iter().fold(f64::MIN_POSITIVE, |m, w| m.max(*w));
        for w in &mut weight {
            *w /= most;
        }
        Record::weighted(self.time.clone(), self.driven().collect(), way, weight)
            .map_err(|invalid| Outcome::OutOfReach(format!("the record of a piezo: {invalid}")))
    }

    /// The driven piezo's voltage.
    pub(super) fn driven(&self) -> impl Iterator<Item = f64> + '_ {
        self.volts.iter().map(|both| both[self.piezo])
    }

    /// Where a model says that a piezo was, metres.
    pub(super) fn displacement(&self, model: &Model, piezo: usize) -> Vec<f64> {
        let mut state = model.at_rest(self.volts[0][piezo]);
        let mut last = self.time[0];
        let each = self.time.iter().zip(&self.volts);
        each.map(|(time, volts)| {
            let period = time - std::mem::replace(&mut last, *time);
            model.displacement(&mut state, volts[piezo], period)
        })
        .collect()
    }

    /// The place that a block belongs to.
    pub(super) fn place(&self, k: usize) -> Option<usize> {
        self.places.iter().position(|place| place.contains(&k))
    }
}

/// The model that remembers, from such a record, and the lag if it is known.
pub(super) fn fitted(record: &Record, piezo: usize, lag: Option<f64>) -> Result<Memory, Outcome> {
    fit_memory(record, record.len(), lag, Creep::Logarithmic)
        .map_err(|invalid| Outcome::OutOfReach(format!("piezo {}: {invalid}", piezo + 1)))
}

/// The same ways, gone through several times, of which another part was measured each time.
pub(super) fn together(record: &Record, times: &[Range<usize>]) -> Result<Record, Invalid> {
    let n = times.iter().map(Range::len).min().unwrap_or(0);
    let [mut time, mut volts, mut way, mut weight] = [(); 4].map(|()| Vec::with_capacity(n));
    let begin = times.first().map_or(0, |first| first.start);
    for k in 0..n {
        let same = || times.iter().map(|time| time.start + k);
        let counts: f64 = same().map(|i| record.weight[i]).sum();
        // What nobody measured is what stands for it, and counts for nothing.
        let share = |i: usize| {
            if counts > 0.0 {
                record.weight[i] / counts
            } else {
                1.0 / times.len() as f64
            }
        };
        let mean = |column: &[f64]| same().map(|i| share(i) * column[i]).sum::<f64>();
        time.push(record.time[begin + k]);
        volts.push(mean(&record.input));
        way.push(mean(&record.output));
        weight.push(counts);
    }
    Record::weighted(time, volts, way, weight)
}
