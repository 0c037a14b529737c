//! A record of force against displacement, made ready for laws.

use super::Unknown;
use super::skew::{self, Skew};
use super::smooth::smoothed;
use super::tremble::{noise, tremble};
use crate::timeline::{counted, taken};
use pigtail_numerics::signal::quantile;

/// Displacement and force at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Seconds.
    pub time: f64,
    /// Metres or radians.
    pub displacement: f64,
    /// Newtons or newton metres, positive where it takes work to move forward.
    pub force: f64,
    /// Whether a stretch begins with it: what was before is not known.
    pub begins: bool,
}

/// A record of force against displacement.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Record {
    pub(super) samples: Vec<Sample>,
    pub(super) has_time: bool,
    /// By how much later than its row's displacement the force was, seconds, where that was taken out.
    pub(super) skew: f64,
    /// The samples before that, where it was.
    pub(super) raw: Option<Vec<Sample>>,
    /// By how much its displacement trembles, m or rad.
    pub(super) tremble: f64,
    /// The noise of each displacement as it was written, m or rad.
    pub(super) noise: f64,
    pub(super) remarks: Vec<String>,
}

/// Fewest samples.
pub(super) const LEAST: usize = 100;

/// More samples than this are taken together for a fit.
const MOST: usize = 20_000;

/// Share of the stroke over which neighbours may be taken together.
const FINE: f64 = 0.0025;

/// Largest share of values that may be set aside as spikes.
const SPIKES: f64 = 0.01;

/// A gap of more sample periods than this begins a stretch.
const GAP: f64 = 5.5;

impl Record {
    /// A record of rows; those in which a column has no value (NaN) are left out. `time` may be missing.
    ///
    /// # Errors
    ///
    /// When the record is of no use to any law.
    pub fn new(time: Option<&[f64]>, displacement: &[f64], force: &[f64]) -> Result<Self, Unknown> {
        let n = displacement.len();
        let at = |k: usize| time.map_or(k as f64, |t| t[k]);
        let kept: Vec<usize> = (0..n)
            .filter(|k| at(*k).is_finite() && displacement[*k].is_finite() && force[*k].is_finite())
            .collect();
        let mut remarks = Vec::new();
        if kept.len() < n {
            remarks.push(format!(
                "{} without a value left out",
                counted(n - kept.len(), "row")
            ));
        }
        if kept.len() < LEAST {
            let why = format!(
                "it has {}; wanted are at least {LEAST}",
                counted(kept.len(), "row")
            );
            return Err(Unknown::all(why));
        }
        let pick = |column: &[f64]| kept.iter().map(|k| column[*k]).collect::<Vec<f64>>();
        let (mut displacement, mut force) = (pick(displacement), pick(force));
        for (column, name) in [(&mut displacement, "displacement"), (&mut force, "force")] {
            let spikes = despiked(column);
            if spikes > 0 {
                remarks.push(format!(
                    "{} of the {name}, apart from their neighbours, set aside and bridged",
                    counted(spikes, "sample")
                ));
            }
        }
        let mut moments: Vec<f64> = kept.iter().map(|k| at(*k)).collect();
        // What is smooth in time, and how late a force is, is told by when samples were taken.
        if let Some((taken, remark)) = time.and_then(|_| taken(&moments, &displacement)) {
            moments = taken;
            remarks.push(remark);
        }
        let steps: Vec<f64> = moments.windows(2).map(|w| w[1] - w[0]).collect();
        let period = quantile(&steps, 0.5);
        let mut samples: Vec<Sample> = moments
            .into_iter()
            .zip(displacement.into_iter().zip(force))
            .map(|(time, (displacement, force))| Sample {
                time,
                displacement,
                force,
                begins: false,
            })
            .collect();
        samples[0].begins = true;
        let mut gaps = 0;
        for (k, step) in steps.iter().enumerate() {
            if time.is_some() && *step > GAP * period {
                samples[k + 1].begins = true;
                gaps += 1;
            }
        }
        if gaps > 0 {
            remarks.push(format!(
                "begun anew after {gaps} gaps longer than five sample periods"
            ));
        }
        let mut record = Self {
            samples,
            has_time: time.is_some(),
            skew: 0.0,
            raw: None,
            tremble: 0.0,
            noise: 0.0,
            remarks,
        };
        record.check()?;
        record.thin();
        record.noise = noise(&record.samples);
        record.tremble = tremble(&record);
        if let Some(reach) = smoothed(&mut record) {
            record.remarks.push(format!(
                "each displacement taken from a parabola through {} samples: turns are as smooth as that, and noise moves none outward",
                2 * reach + 1
            ));
        }
        record.align()?;
        Ok(record)
    }

    /// Remarks on what was done to it.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    pub(super) fn range(&self, of: impl Fn(&Sample) -> f64) -> (f64, f64) {
        self.samples
            .iter()
            .map(of)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            })
    }

    fn check(&mut self) -> Result<(), Unknown> {
        let (low, high) = self.range(|s| s.displacement);
        let stroke = high - low;
        let (weak, strong) = self.range(|s| s.force);
        if stroke <= 0.0 {
            return Err(Unknown::all("the displacement never changes"));
        }
        if strong <= weak {
            return Err(Unknown::all("the force never changes"));
        }
        let steps = || {
            self.samples.windows(2).filter(|w| !w[1].begins).map(|w| {
                (
                    w[1].displacement - w[0].displacement,
                    w[1].force + w[0].force,
                )
            })
        };
        let turns = turned(&self.samples, stroke).len();
        if turns < 2 {
            return Err(Unknown::all(format!(
                "it has {turns} reversals: how friction turns round, and how high it is the other way, takes \
                 two at least"
            )));
        }
        let largest = steps().map(|s| s.0.abs()).fold(0.0, f64::max);
        let moving: Vec<f64> = steps()
            .map(|s| s.0.abs())
            .filter(|w| *w > 1e-3 * largest)
            .collect();
        if quantile(&moving, 0.5) > 0.1 * stroke {
            return Err(Unknown::all(
                "from one sample to the next it moves a tenth of its stroke: sampled too slowly",
            ));
        }
        let pegged = |value: f64| {
            let at = self.samples.iter().filter(|s| s.force == value).count();
            at as f64 / self.samples.len() as f64
        };
        if pegged(strong) > 0.1 || pegged(weak) > 0.1 {
            return Err(Unknown::all(format!(
                "the force is saturated: for {:.0} % of the samples it stands at an end of its range",
                100.0 * pegged(strong).max(pegged(weak))
            )));
        }
        let work: f64 = steps().map(|(way, force)| 0.5 * force * way).sum();
        if work < 0.0 {
            for s in &mut self.samples {
                s.force = -s.force;
            }
            self.remarks.push(
                "the force does negative work, so it is what friction does to the body; its sign was turned"
                    .to_owned(),
            );
        }
        Ok(())
    }

    /// Where there are very many samples, neighbours are taken together, as far as what they move over is next to
    /// nothing beside the stroke; where there are many still, the record's beginning is enough.
    fn thin(&mut self) {
        let all = self.samples.len();
        if all <= MOST {
            return;
        }
        let (low, high) = self.range(|s| s.displacement);
        let fine = FINE * (high - low);
        let mut block = 1;
        let mut samples = self.samples.clone();
        while all / block > MOST {
            let wider = together(&self.samples, 2 * block);
            let steps: Vec<f64> = steps_of(&wider);
            // Noise moves blocks too: it gets less.
            let narrower = quantile(&steps_of(&samples), 0.99);
            let wide = quantile(&steps, 0.99);
            if wide > fine
                && wide > 1.1 * narrower
                && turned(&samples[..MOST.min(samples.len())], high - low).len() >= 6
            {
                break;
            }
            block *= 2;
            samples = wider;
        }
        if block > 1 {
            self.remarks.push(format!(
                "each {block} neighbouring samples taken as one, their mean"
            ));
        }
        if samples.len() > MOST {
            self.remarks.push(format!(
                "the first {:.0} % of the record taken: more would be too coarse for its reversals, or tell nothing new",
                100.0 * MOST as f64 / samples.len() as f64
            ));
            samples.truncate(MOST);
        }
        self.samples = samples;
    }

    /// Takes out a skew between force and displacement.
    fn align(&mut self) -> Result<(), Unknown> {
        match skew::skew(self).filter(|_| self.has_time) {
            None => {}
            Some(Skew::Beyond(longest)) => {
                return Err(Unknown::all(format!(
                    "force and displacement are not of the same moments: it is told better with the force more than \
                     {longest:.3e} s apart. Are columns swapped or of other records, or is it no friction?"
                )));
            }
            Some(Skew::Of(by)) => {
                let shifted = skew::shifted(&self.samples, by);
                self.raw = Some(std::mem::replace(&mut self.samples, shifted));
                self.skew = by;
                self.remarks.push(format!(
                    "force and displacement are not of the same moments: the force is {:.3e} s {} than its row's \
                     displacement; that was taken out",
                    by.abs(),
                    if by > 0.0 { "later" } else { "earlier" }
                ));
            }
        }
        Ok(())
    }

    /// Mean time from one sample to the next, seconds.
    pub(super) fn period(&self) -> f64 {
        let n = self.samples.len();
        (self.samples[n - 1].time - self.samples[0].time) / n as f64
    }

    pub(super) fn largest_force(&self) -> f64 {
        let sizes: Vec<f64> = self.samples.iter().map(|s| s.force.abs()).collect();
        quantile(&sizes, 0.95)
    }
}

/// Samples taken together in blocks, each the mean of its own; none reaches over a beginning.
fn together(samples: &[Sample], block: usize) -> Vec<Sample> {
    let mut means = Vec::with_capacity(samples.len() / block + 1);
    for stretch in samples.chunk_by(|_, next| !next.begins) {
        for (k, part) in stretch.chunks(block).enumerate() {
            let n = part.len() as f64;
            let mean = |of: fn(&Sample) -> f64| part.iter().map(of).sum::<f64>() / n;
            means.push(Sample {
                time: mean(|s| s.time),
                displacement: mean(|s| s.displacement),
                force: mean(|s| s.force),
                begins: k == 0,
            });
        }
    }
    means
}

fn steps_of(samples: &[Sample]) -> Vec<f64> {
    let pairs = samples.windows(2).filter(|w| !w[1].begins);
    pairs
        .map(|w| (w[1].displacement - w[0].displacement).abs())
        .collect()
}

/// Reversals worth the name, back by a fiftieth of the stroke: the samples at which each is seen.
pub(super) fn turned(samples: &[Sample], stroke: f64) -> Vec<usize> {
    let mut turned = Vec::new();
    let (mut lowest, mut highest, mut rises) = (f64::INFINITY, f64::NEG_INFINITY, None);
    for (k, s) in samples.iter().enumerate() {
        lowest = lowest.min(s.displacement);
        highest = highest.max(s.displacement);
        if rises != Some(false) && highest - s.displacement > 0.02 * stroke {
            turned.extend(rises.is_some().then_some(k));
            (rises, lowest) = (Some(false), s.displacement);
        } else if rises != Some(true) && s.displacement - lowest > 0.02 * stroke {
            turned.extend(rises.is_some().then_some(k));
            (rises, highest) = (Some(true), s.displacement);
        }
    }
    turned
}

/// Replaces values that stand apart from their neighbours, if they are few; how many there were.
fn despiked(values: &mut [f64]) -> usize {
    const FAR: f64 = 20.0;
    let middle = |w: &[f64]| {
        let mut w = [w[0], w[1], w[2], w[3], w[4]];
        w.sort_by(f64::total_cmp);
        w[2]
    };
    let off: Vec<f64> = values
        .windows(5)
        .map(|w| (w[2] - middle(w)).abs())
        .collect();
    let steps: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    let far = FAR * quantile(&off, 0.9) + 5.0 * quantile(&steps, 0.99);
    let bad: Vec<usize> = (0..off.len())
        .filter(|k| off[*k] > far)
        .map(|k| k + 2)
        .collect();
    if far <= 0.0 || bad.len() as f64 > SPIKES * values.len() as f64 {
        return 0;
    }
    let old = values.to_vec();
    for k in &bad {
        values[*k] = middle(&old[k - 2..k + 3]);
    }
    bad.len()
}
