//! What is seen while a piezo is driven, and the record that is made of it.

use super::{BLOCK, Flank, Identified, Series};
use crate::compensation::hysteresis::{Creep, Invalid, Memory, Model, Rbf, Record, fit_memory};
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
            for over in pieces(series, from..place.start, piezo) {
                add(&mut blocks, over);
            }
            let begin = blocks.time.len();
            for over in pieces(series, place.clone(), piezo) {
                add(&mut blocks, over);
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
            .map_err(|why| Outcome::NoModel { piezo: None, why })
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

/// The samples that are averaged to one. A sample at which the voltage turns stands alone: plays
/// remember how far the voltage went, and in a mean with its neighbours it went less far.
fn pieces(series: &Series, over: Range<usize>, piezo: usize) -> Vec<Range<usize>> {
    let volts = |k: usize| series.volts[k][piezo];
    let turns = |k: usize| {
        over.contains(&(k + 1))
            && k > over.start
            && (volts(k) - volts(k - 1)) * (volts(k + 1) - volts(k)) < 0.0
    };
    let mut pieces = Vec::with_capacity(over.len().div_ceil(BLOCK));
    let mut start = over.start;
    for k in over.clone() {
        if turns(k) && k > start {
            pieces.push(start..k);
            start = k;
        }
        if turns(k) || k + 1 - start == BLOCK || k + 1 == over.end {
            pieces.push(start..k + 1);
            start = k + 1;
        }
    }
    pieces
}

/// The model that remembers, from such a record, and the lag if it is known.
pub(super) fn fitted(record: &Record, piezo: usize, lag: Option<f64>) -> Result<Memory, Outcome> {
    fit_memory(record, record.len(), lag, Creep::Logarithmic).map_err(|why| Outcome::NoModel {
        piezo: Some(piezo),
        why,
    })
}

/// What the light tells of a piezo.
pub(super) struct Observed {
    /// The light while it was driven.
    pub(super) series: Series,
    pub(super) flank: Flank,
    /// From before it was driven on, for creep remembers that; weightless there.
    pub(super) record: Record,
    /// The parts of the record in which the ways of the thesis's model were gone.
    pub(super) slow: Vec<Range<usize>>,
}

impl Observed {
    /// Both models, of which one is learned already. The thesis's networks know neither speed nor inner
    /// loops: they get the curves they are for.
    pub(super) fn learned(self, piezo: usize, memory: &Memory) -> Result<Identified, Outcome> {
        let of = |why: Invalid| Outcome::NoModel {
            piezo: Some(piezo),
            why,
        };
        let ways = together(&self.record, &self.slow).map_err(of)?;
        let rbf = Rbf::train(&ways).map_err(of)?;
        Ok(Identified {
            series: self.series,
            flank: self.flank,
            record: self.record,
            ways,
            rbf: Model::Rbf(rbf),
            memory: Model::Memory(*memory),
        })
    }
}

/// The same ways, gone through several times, of which another part was measured each time.
fn together(record: &Record, times: &[Range<usize>]) -> Result<Record, Invalid> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_is_not_lost_in_a_mean() {
        // Up to the 23rd sample and down again.
        let driven = (0..60).map(|k: i32| f64::from((23 - (k - 23).abs()).max(2)));
        let volts: Vec<[f64; 2]> = driven.map(|v| [v, 0.0]).collect();
        let series = Series {
            time: (0..60).map(f64::from).collect(),
            light: vec![1.0; 60],
            volts,
            frames: vec![],
        };
        let blocks = Blocks::new(&series, &[0..10, 10..50], 0);
        let most = blocks.driven().fold(0.0, f64::max);
        assert_eq!(most, 23.0, "{:?}", blocks.volts);
        // Every sample is in one block.
        let pieces = pieces(&series, 10..50, 0);
        let apart = |w: &[Range<usize>]| w[0].end == w[1].start && w[0].len() <= BLOCK;
        assert!(pieces.windows(2).all(apart));
        assert_eq!((pieces[0].start, pieces[pieces.len() - 1].end), (10, 50));
        assert_eq!(blocks.places[1], 2..2 + pieces.len());
    }
}
