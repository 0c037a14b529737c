//! A law of friction from force against displacement, presliding and sliding.

mod agree;
mod beside;
mod blurred;
mod bristle;
mod changes;
mod check;
mod coupled;
mod elements;
mod filtered;
mod fit;
mod law;
mod misfit;
mod record;
mod skew;
mod smooth;
mod speeds;
mod sure;
mod tremble;

pub use law::Law;
pub use record::{Record, Sample};

use check::{doubts, swapped};
use fit::{error, fit, residuals};
use record::{LEAST, turned};
use sure::{sure, widen, with_skew};

use super::{Account, Known, Parameter, Unknown};

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
    changes::allow(&mut laws, record);
    tremble::allow(&mut laws, record);
    blurred::allow(&mut laws, record);
    beside::allow(&mut laws, record);
    agree::allow(&mut laws, record);
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
    if let Some(why) = coupled::coupled(record, chosen) {
        return Err(Unknown::all(why));
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
            tremble: 0.0,
            noise: 0.0,
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
