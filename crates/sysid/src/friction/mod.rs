//! A law of friction from force against displacement, presliding and sliding.

mod beside;
mod bristle;
mod changes;
mod check;
mod elements;
mod law;
mod misfit;
mod skew;
mod speeds;
mod sure;

pub use law::Law;

use check::{doubts, swapped};
use skew::Skew;
use sure::{sure, widen, with_skew};

use super::{Account, Known, Parameter, Unknown};
use pigtail_numerics::nonlinear::minimise;
use pigtail_numerics::regression::{least_squares, matrix, relative};
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
    samples: Vec<Sample>,
    has_time: bool,
    /// By how much later than its row's displacement the force was, seconds, where that was taken out.
    skew: f64,
    /// The samples before that, where it was.
    raw: Option<Vec<Sample>>,
    remarks: Vec<String>,
}

/// Fewest samples.
const LEAST: usize = 100;

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
            remarks.push(format!("{} rows without a value left out", n - kept.len()));
        }
        if kept.len() < LEAST {
            let why = format!("it has {} rows; wanted are at least {LEAST}", kept.len());
            return Err(Unknown::all(why));
        }
        let pick = |column: &[f64]| kept.iter().map(|k| column[*k]).collect::<Vec<f64>>();
        let (mut displacement, mut force) = (pick(displacement), pick(force));
        for (column, name) in [(&mut displacement, "displacement"), (&mut force, "force")] {
            let spikes = despiked(column);
            if spikes > 0 {
                remarks.push(format!(
                    "{spikes} samples of the {name} stand apart from their neighbours; set aside, and bridged"
                ));
            }
        }
        let steps: Vec<f64> = kept.windows(2).map(|w| at(w[1]) - at(w[0])).collect();
        let period = quantile(&steps, 0.5);
        let mut samples: Vec<Sample> = kept
            .iter()
            .zip(displacement.into_iter().zip(force))
            .map(|(k, (displacement, force))| Sample {
                time: at(*k),
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
            remarks,
        };
        record.check()?;
        record.thin();
        record.align()?;
        Ok(record)
    }

    /// Remarks on what was done to it.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    fn range(&self, of: impl Fn(&Sample) -> f64) -> (f64, f64) {
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
    fn period(&self) -> f64 {
        let n = self.samples.len();
        (self.samples[n - 1].time - self.samples[0].time) / n as f64
    }

    fn largest_force(&self) -> f64 {
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
fn turned(samples: &[Sample], stroke: f64) -> Vec<usize> {
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

/// A law fitted to a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// Which law.
    pub law: Law,
    /// Its parameters by [`Law::parameters`], whether or not they may be told.
    pub values: Vec<f64>,
    /// Their standard deviations, from the whole record.
    pub known: Vec<Known>,
    /// Relative error on the whole record it was fitted to, per cent.
    pub relative_error_percent: f64,
    /// Relative error on the part held back of the same law fitted to the rest; or on a second record.
    pub validation_error_percent: f64,
    /// Condition number of the linear problem at the parameters, which are scaled to order one.
    pub condition: f64,
    /// What of the error another law, or elements of every length, would tell: by so much the contact is of another law, per
    /// cent of the force. Zero where none tells more than chance would in one record of a thousand.
    pub misfit_percent: f64,
    /// Of a law without a speed, levels at the slowest and the fastest twentieth of the sliding, N, where they differ.
    pub by_speed: Option<[f64; 2]>,
    /// Of LuGre with one level, where a static friction of its own is not told: what it leaves with one, per cent.
    two_levels: Option<f64>,
}

/// What a record says of friction.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// The laws, all that were tried.
    pub laws: Vec<Fitted>,
    /// Which one tells best what it was not fitted to.
    pub best: usize,
    /// The best one's parameters.
    pub parameters: Vec<Parameter>,
    /// What cannot be known.
    pub unknown: Vec<Unknown>,
    /// First sample that was held back.
    pub held_back_from: usize,
    /// Remarks on what the record is of.
    pub remarks: Vec<String>,
}

/// Share of a record that laws are fitted to; the rest is held back.
const FITTED: f64 = 0.6;

/// By how much a law's error may lie above the least, for one with fewer parameters is preferred.
const AS_GOOD: f64 = 1.02;

/// Relative error beyond which a law explains nothing, per cent.
const UNEXPLAINED: f64 = 100.0 / 3.0;

/// Fits the laws of at most `most` parameters, and chooses by the error on what was held back, or on a
/// second record.
///
/// # Errors
///
/// When no law has anything to say of the record.
pub fn identify(
    record: &Record,
    second: Option<&Record>,
    most: usize,
) -> Result<Identified, Unknown> {
    let n = record.samples.len();
    let to = (FITTED * n as f64) as usize;
    let mut laws = Vec::new();
    for law in Law::ALL {
        if law.parameters().len() > most || (law.needs_time() && !record.has_time) {
            continue;
        }
        let Some(part) = fit(law, record, &record.samples[..to], None) else {
            continue;
        };
        let Some(whole) = fit(law, record, &record.samples, Some(&part)) else {
            continue;
        };
        // The held-back part goes on from where the fitted one ends.
        let validation = match second {
            Some(second) => error(law, &whole, &second.samples, 0),
            None => error(law, &part, &record.samples, to),
        };
        let Some((mut known, condition)) = sure(law, record, &whole) else {
            continue;
        };
        if let Some(joint) = with_skew(law, record, &record.samples, &whole) {
            for (known, value) in known.iter_mut().zip(joint) {
                known.value = value;
            }
        }
        widen(law, record, &mut known);
        if law.needs_time() && check::one_level(&whole, &known) {
            let found = bristle::one_level(law, record, second, (&whole, to));
            laws.extend(found.map(|found| Fitted {
                two_levels: Some(error(law, &whole, &record.samples, 0)),
                ..found
            }));
            continue;
        }
        laws.push(Fitted {
            law,
            relative_error_percent: error(law, &whole, &record.samples, 0),
            validation_error_percent: validation,
            values: whole,
            known,
            condition,
            misfit_percent: 0.0,
            by_speed: None,
            two_levels: None,
        });
    }
    let least = laws
        .iter()
        .map(|l| l.validation_error_percent)
        .fold(f64::INFINITY, f64::min);
    let Some(best) = laws
        .iter()
        .position(|l| l.validation_error_percent <= AS_GOOD * least)
    else {
        return Err(Unknown::all("no law could be fitted to it"));
    };
    misfit::allow(&mut laws, record);
    speeds::allow(&mut laws, record);
    let chosen = &laws[best];
    if chosen.relative_error_percent > UNEXPLAINED {
        let mut because = format!(
            "the best law of friction leaves {:.0} % of the force unexplained: are displacement and force \
             swapped, or is it no friction?",
            chosen.relative_error_percent
        );
        if let Some(doubt) = doubts(record, chosen).first() {
            because = format!("{because} And {}", doubt.because);
        }
        return Err(Unknown::all(because));
    }
    if swapped(record, chosen.relative_error_percent) {
        return Err(Unknown::all(
            "the displacement depends on the force as friction does on displacement: the columns look swapped",
        ));
    }
    if let Some(why) = beside::beside(record, chosen.relative_error_percent) {
        return Err(Unknown::all(why));
    }
    let remarks = changes::same(record, chosen)?.into_iter().collect();
    let unknown = doubts(record, chosen);
    let parameters = told(chosen, &unknown);
    Ok(Identified {
        remarks,
        best,
        parameters,
        unknown,
        held_back_from: to,
        laws,
    })
}

impl Identified {
    /// The same with another law in the place of the best one; `None` where it was not fitted.
    #[must_use]
    pub fn with(mut self, law: Law, record: &Record) -> Option<Self> {
        self.best = self.laws.iter().position(|l| l.law == law)?;
        let chosen = &self.laws[self.best];
        self.unknown = doubts(record, chosen);
        self.parameters = told(chosen, &self.unknown);
        Some(self)
    }

    /// Force measured beside the one that the best law tells.
    pub fn account(&self, record: &Record) -> Account {
        let best = &self.laws[self.best];
        let s = &record.samples;
        let speed = |k: usize| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(s.len() - 1));
            (s[b].displacement - s[a].displacement) / (s[b].time - s[a].time).max(1e-12)
        };
        Account {
            time: s.iter().map(|s| s.time).collect(),
            measured: s.iter().map(|s| s.force).collect(),
            modelled: best.law.predict(&best.values, s),
            position: s.iter().map(|s| s.displacement).collect(),
            velocity: (0..s.len()).map(speed).collect(),
        }
    }
}

fn told(chosen: &Fitted, unknown: &[Unknown]) -> Vec<Parameter> {
    let names = chosen.law.parameters().iter();
    names
        .zip(&chosen.known)
        .map(|(name, known)| Parameter {
            name,
            known: (!unknown.iter().any(|u| u.covers(name))).then_some(*known),
        })
        .collect()
}

fn residuals(law: Law, parameters: &[f64], samples: &[Sample], from: usize) -> Vec<f64> {
    law.predict(parameters, samples)
        .iter()
        .zip(samples)
        .skip(from)
        .map(|(told, s)| s.force - told)
        .collect()
}

fn error(law: Law, parameters: &[f64], samples: &[Sample], from: usize) -> f64 {
    let measured: Vec<f64> = samples[from..].iter().map(|s| s.force).collect();
    relative(&residuals(law, parameters, samples, from), &measured)
}

/// The parameters that fit best, from several ways over which the level may be reached, or from `near`.
fn fit(law: Law, record: &Record, samples: &[Sample], near: Option<&[f64]>) -> Option<Vec<f64>> {
    let force = record.largest_force();
    let (low, high) = record.range(|s| s.displacement);
    let speeds: Vec<f64> = record
        .samples
        .windows(2)
        .filter(|w| !w[1].begins && w[1].displacement != w[0].displacement)
        .map(|w| ((w[1].displacement - w[0].displacement) / (w[1].time - w[0].time)).abs())
        .collect();
    let scaled = |coded: &[f64]| -> Vec<f64> {
        // Nothing physical lies e^60 away.
        if coded.iter().any(|c| c.abs() > 60.0) {
            return vec![f64::NAN; samples.len()];
        }
        let parameters = law.decoded(coded, force);
        let residuals = residuals(law, &parameters, samples, 0);
        residuals.into_iter().map(|l| l / force).collect()
    };
    let squares = |coded: &[f64]| -> f64 { scaled(coded).iter().map(|l| l * l).sum() };
    let mut starts: Vec<(f64, Vec<f64>)> = if let Some(near) = near {
        vec![(0.0, law.coded(near, force))]
    } else {
        let shares = [0.003, 0.01, 0.03, 0.08, 0.15, 0.25, 0.4];
        let speeds: &[f64] = if law.needs_time() {
            &[quantile(&speeds, 0.2), quantile(&speeds, 0.7)]
        } else {
            &[1.0]
        };
        shares
            .iter()
            .flat_map(|share| speeds.iter().map(move |speed| (share, speed)))
            .flat_map(|(share, speed)| {
                let start = law.start(force, share * (high - low), *speed);
                // A static level far above, next to, or below the sliding one: LuGre has a minimum near each.
                let ratios: &[f64] = if law.needs_time() {
                    &[0.8, 1.02, 1.1, 1.6]
                } else {
                    &[1.0]
                };
                let with = |ratio: &f64| {
                    let mut start = start.clone();
                    if law.needs_time() {
                        start[2] = ratio * start[0];
                    }
                    let coded = law.coded(&start, force);
                    (squares(&coded), coded)
                };
                ratios.iter().map(with).collect::<Vec<_>>()
            })
            .collect()
    };
    if law.needs_time() && near.is_none() {
        for share in [0.01, 0.03, 0.1, 0.3] {
            if let Some((coulomb, still, speed)) = stribeck(samples, share * (high - low)) {
                let mut start = law.start(coulomb, share * (high - low), speed);
                start[2] = still;
                let coded = law.coded(&start, force);
                starts.push((squares(&coded), coded));
            }
        }
    }
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let tried = if law.needs_time() { 8 } else { 3 };
    let (coded, _) = starts
        .iter()
        .take(tried)
        .filter_map(|(_, start)| minimise(scaled, start))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(law.decoded(&coded, force))
}

/// Coulomb and static friction and the speed between them, by the force where it has slid for `way` since it turned:
/// `g = f_c + (f_s - f_c) exp(-(v / v_s)^2)`, linear but for the speed.
fn stribeck(samples: &[Sample], way: f64) -> Option<(f64, f64, f64)> {
    const SPEEDS: usize = 12;
    let (mut speeds, mut forces) = (Vec::new(), Vec::new());
    let mut turned = samples.first()?.displacement;
    let mut sign = 0.0;
    for w in samples.windows(2) {
        let step = w[1].displacement - w[0].displacement;
        if w[1].begins || step * sign < 0.0 {
            turned = w[0].displacement;
        }
        if step != 0.0 {
            sign = step.signum();
        }
        if !w[1].begins && step != 0.0 && (w[1].displacement - turned).abs() > way {
            speeds.push((step / (w[1].time - w[0].time)).abs());
            forces.push(sign * w[1].force);
        }
    }
    let (slow, fast) = (quantile(&speeds, 0.05), quantile(&speeds, 0.95));
    if speeds.len() < LEAST || slow.is_nan() || slow <= 0.0 || fast <= slow {
        return None;
    }
    let one = vec![1.0; speeds.len()];
    (0..=SPEEDS)
        .filter_map(|k| {
            let speed = slow * (fast / slow).powf(k as f64 / SPEEDS as f64);
            let falls: Vec<f64> = speeds
                .iter()
                .map(|v| (-(v / speed).powi(2)).exp())
                .collect();
            let found = least_squares(&matrix(&[&one, &falls]), &forces)?;
            let (coulomb, still) = (found.values[0], found.values[0] + found.values[1]);
            (coulomb > 0.0 && still > 0.0)
                .then_some((found.relative_error_percent, (coulomb, still, speed)))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, found)| found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Back and forth over shrinking strokes, at changing speed.
    fn path(n: usize) -> (Vec<f64>, Vec<f64>) {
        let time: Vec<f64> = (0..n).map(|k| 0.005 * k as f64).collect();
        let x = time
            .iter()
            .map(|t| 1e-4 * (1.0 - 0.02 * t).max(0.3) * (1.3 * t + 0.4 * (0.5 * t).sin()).sin())
            .collect();
        (time, x)
    }

    fn made(law: Law, parameters: &[f64]) -> Record {
        let (time, x) = path(6000);
        let mut record = Record {
            samples: time
                .iter()
                .zip(&x)
                .map(|(t, x)| Sample {
                    time: *t,
                    displacement: *x,
                    ..Sample::default()
                })
                .collect(),
            has_time: true,
            skew: 0.0,
            raw: None,
            remarks: Vec::new(),
        };
        let told = law.predict(parameters, &record.samples);
        for (k, (s, f)) in record.samples.iter_mut().zip(told).enumerate() {
            s.force = f + 0.01 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0);
        }
        record.samples[0].begins = true;
        record
    }

    #[test]
    fn each_law_is_found_in_its_own_record() {
        let truths: [(Law, &[f64]); 6] = [
            (Law::Presliding, &[2.0, 1.5e-5, 0.1]),
            (Law::PreslidingTwoSided, &[2.0, 2e-5, 1.5, 1e-5]),
            (Law::Dahl, &[2.0, 3e5, 0.6, 0.1]),
            (Law::MaxwellSlip, &[2.0, 5e-6, 3e-5, 0.1]),
            (Law::LuGre, &[1.5, 2e5, 2.2, 5e-5]),
            (Law::LuGreViscous, &[1.5, 2e5, 2.2, 5e-5, 3000.0, 0.1]),
        ];
        for (law, truth) in truths {
            let record = made(law, truth);
            let found = identify(&record, None, 6).unwrap();
            let best = &found.laws[found.best];
            assert_eq!(best.law, law, "{:?}", found.laws);
            for ((value, is), known) in best.values.iter().zip(truth).zip(&best.known) {
                let off = (value - is).abs();
                let allowed = 6.0 * known.std_correlated + 0.02 * is.abs();
                assert!(off < allowed, "{law:?}: {value} for {is}");
            }
        }
    }

    /// LuGre with an offset has more parameters than are allowed, and Dahl's law tells it with a level that lies between.
    #[test]
    fn a_level_that_goes_with_the_speed_is_said_to() {
        let of_speed = made(Law::LuGreViscous, &[1.5, 2e5, 2.2, 1e-4, 0.0, 0.4]);
        let found = identify(&of_speed, None, 4).unwrap();
        let [slow, fast] = found.laws[found.best].by_speed.unwrap();
        assert!(
            slow > 2.0 && slow < 2.3 && fast > 1.4 && fast < 1.9,
            "{slow} {fast}"
        );
        let level = found.parameters[0].known.unwrap();
        assert!(level.std_correlated > 0.05, "{level:?}");
        for (law, truth) in [
            (Law::Presliding, &[2.0, 1.5e-5, 0.1][..]),
            (Law::MaxwellSlip, &[2.0, 5e-6, 3e-5, 0.1]),
        ] {
            let found = identify(&made(law, truth), None, 4).unwrap();
            assert_eq!(found.laws[found.best].by_speed, None, "{law:?}");
        }
    }

    #[test]
    fn a_stroke_too_short_to_slide_has_no_level() {
        let (time, x) = path(6000);
        let x: Vec<f64> = x.iter().map(|x| 0.02 * x).collect();
        let force: Vec<f64> = x
            .iter()
            .enumerate()
            .map(|(k, x)| 2e5 * x + 1e-3 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0))
            .collect();
        let told = Record::new(Some(&time), &x, &force).and_then(|r| identify(&r, None, 4));
        match told {
            Err(_) => {}
            Ok(found) => {
                let level = &found.parameters[0];
                assert!(level.known.is_none(), "{found:?}");
            }
        }
    }

    #[test]
    fn records_of_no_use_are_refused_with_their_reason() {
        let (time, x) = path(3000);
        let law = Law::Presliding;
        let samples: Vec<Sample> = x
            .iter()
            .map(|x| Sample {
                displacement: *x,
                ..Sample::default()
            })
            .collect();
        let force = law.predict(&[2.0, 1.5e-5, 0.0], &samples);
        let refused = |time: &[f64], x: &[f64], f: &[f64]| {
            Record::new(Some(time), x, f)
                .and_then(|r| identify(&r, None, 4))
                .expect_err("no use")
                .because
        };
        assert!(refused(&time, &vec![1.0; 3000], &force).contains("never changes"));
        assert!(refused(&time, &time, &force).contains("reversals"));
        let clipped: Vec<f64> = force.iter().map(|f| f.clamp(-1.0, 1.0)).collect();
        assert!(refused(&time, &x, &clipped).contains("saturated"));
        let coarse = |v: &[f64]| {
            v.iter()
                .copied()
                .step_by(250)
                .cycle()
                .take(300)
                .collect::<Vec<_>>()
        };
        let when: Vec<f64> = (0..300).map(f64::from).collect();
        assert!(refused(&when, &coarse(&x), &coarse(&force)).contains("slowly"));
        let noisy: Vec<f64> = force
            .iter()
            .enumerate()
            .map(|(k, f)| f + 1e-4 * (k % 7) as f64)
            .collect();
        assert!(refused(&time, &noisy, &x).contains("swapped"));
    }
}
