//! Modes from magnitude alone.
//!
//! A magnitude tells poles, not which side of the axis zeros lie on, and of a delay nothing. Of all responses
//! with that magnitude one has the least phase, by Bode's relation
//!
//! ```text
//! phase(w) = 1/pi  integral  d ln|H| / du  ln coth |u/2|  du,    u = ln(x / w)
//! ```
//!
//! whose poles are the same (H. W. Bode, *Network Analysis and Feedback Amplifier Design*, 1945). Modes are
//! looked for in it, and settle on the logarithm of the magnitude, in which that phase has no part.

use super::record::Filter;
use super::search::{pruned, search};
use super::{Identified, Record, modes_of, peaks, stated_modes};
use crate::{Parameter, Unknown};
use nalgebra::{Complex, DVector};
use pigtail_numerics::line::Line;
use pigtail_numerics::nonlinear::{minimise, uncertainty_of_points};
use pigtail_numerics::regression::least_squares;
use std::f64::consts::PI;

/// Share of the points at either end by which the magnitude is continued beyond it.
const END: f64 = 0.04;

/// The integral of `ln coth (v/2)` from zero to `u`.
fn bode(u: f64) -> f64 {
    const FAR: f64 = PI * PI / 4.0;
    let v = u.abs();
    let value = if v < 0.3 {
        if v == 0.0 {
            0.0
        } else {
            v * (1.0 - (0.5 * v).ln()) + v.powi(3) / 36.0 - v.powi(5) * 7.0 / 7200.0
        }
    } else {
        // ln coth (v/2) = 2 sum over odd n of exp(-n v) / n.
        let decay = (-v).exp();
        let mut power = decay;
        let mut sum = 0.0;
        let mut n = 1.0;
        while power > 1e-12 && n < 200.0 {
            sum += power / (n * n);
            power *= decay * decay;
            n += 2.0;
        }
        FAR - 2.0 * sum
    };
    value.copysign(u)
}

/// Slope of the logarithm of magnitude over that of frequency through some points.
fn slope(x: &[f64], y: &[f64]) -> f64 {
    Line::through(x.iter().copied().zip(y.iter().copied())).slope
}

/// The response of least phase that has a record's magnitude.
fn least_phase(record: &Record) -> Record {
    let x: Vec<f64> = record.frequency.iter().map(|f| f.ln()).collect();
    let y: Vec<f64> = record.response.iter().map(|h| h.norm().ln()).collect();
    let n = x.len();
    let few = ((END * n as f64) as usize).max(3);
    // Whole powers of frequency: what a response has far from its modes.
    let whole = |s: f64| s.round().clamp(-4.0, 2.0);
    let ends = [
        whole(slope(&x[..few], &y[..few])),
        whole(slope(&x[n - few..], &y[n - few..])),
    ];
    let slopes: Vec<f64> = (1..n)
        .map(|i| (y[i] - y[i - 1]) / (x[i] - x[i - 1]))
        .collect();
    let far = PI * PI / 4.0;
    let response = (0..n)
        .map(|k| {
            let at: Vec<f64> = x.iter().map(|v| bode(v - x[k])).collect();
            let within: f64 = (1..n).map(|i| slopes[i - 1] * (at[i] - at[i - 1])).sum();
            let beyond = ends[0] * (at[0] + far) + ends[1] * (far - at[n - 1]);
            Complex::from_polar(record.response[k].norm(), (within + beyond) / PI)
        })
        .collect();
    Record {
        frequency: record.frequency.clone(),
        response,
        weight: record.weight.clone(),
        skewed: true,
        phased: true,
        poles: 0,
        most_poles: 0,
        creeping: false,
        rate: false,
        filter: Filter::None,
        lean: None,
    }
}

/// Modes and linear parts of a record by the logarithm of its magnitude: what is left is the weighted
/// difference of logarithms.
struct Logarithms<'a> {
    record: &'a Record,
    modes: usize,
    /// What the linear parts are counted in, so that they are of order one.
    scale: Vec<f64>,
}

impl Logarithms<'_> {
    fn of<'a>(record: &'a Record, coded: &[f64]) -> Option<(Logarithms<'a>, Vec<f64>)> {
        let modes = (coded.len() - 1) / 2;
        let (values, _) = record.linear(coded)?;
        let scale: Vec<f64> = record
            .columns(coded)
            .column_iter()
            .map(|c| (record.frequency.len() as f64).sqrt() / c.norm().max(1e-300))
            .collect();
        let mut start = coded[..2 * modes].to_vec();
        start.extend(values.iter().zip(&scale).map(|(v, s)| v / s));
        let own = Logarithms {
            record,
            modes,
            scale,
        };
        Some((own, start))
    }

    fn magnitude(&self, all: &[f64]) -> Vec<f64> {
        let mut coded = all[..2 * self.modes].to_vec();
        coded.push(0.0);
        let linear = all[2 * self.modes..].iter().zip(&self.scale);
        let values: Vec<f64> = linear.map(|(v, s)| v * s).collect();
        let prediction = self.record.columns(&coded) * DVector::from_vec(values);
        let n = self.record.frequency.len();
        (0..n)
            .map(|i| prediction[i].hypot(prediction[n + i]) / self.record.weight[i].max(1e-300))
            .collect()
    }

    fn residuals(&self, all: &[f64]) -> Vec<f64> {
        let bad = all.iter().any(|c| c.is_nan() || c.abs() > 1e6)
            || all[..2 * self.modes].iter().any(|c| c.abs() >= 60.0);
        if bad {
            return vec![f64::NAN; self.record.frequency.len()];
        }
        self.magnitude(all)
            .iter()
            .zip(&self.record.response)
            .zip(&self.record.weight)
            .map(|((prediction, h), w)| {
                let size = h.norm();
                // A zero of the model is as wrong as it gets.
                (w * size) * (size / prediction.max(1e-9 * size)).ln()
            })
            .collect()
    }

    /// Relative error of magnitude, per cent.
    fn error(&self, all: &[f64]) -> f64 {
        let weighted = |values: &[f64]| -> Vec<f64> {
            values
                .iter()
                .zip(&self.record.weight)
                .map(|(v, w)| v * w)
                .collect()
        };
        let sizes: Vec<f64> = self.record.response.iter().map(|h| h.norm()).collect();
        let (prediction, measured) = (weighted(&self.magnitude(all)), weighted(&sizes));
        let residuals: Vec<f64> = measured
            .iter()
            .zip(&prediction)
            .map(|(a, b)| a - b)
            .collect();
        pigtail_numerics::regression::relative(&residuals, &measured)
    }
}

/// Modes settled on a record's logarithms, from those of `coded`.
fn fit<'a>(record: &'a Record, coded: &[f64]) -> Option<(Logarithms<'a>, Vec<f64>)> {
    let (own, start) = Logarithms::of(record, coded)?;
    let (all, _) = minimise(|c| own.residuals(c), &start)?;
    Some((own, all))
}

/// Relative error at every second point of modes settled on the others, per cent.
fn held_back(record: &Record, coded: &[f64]) -> Option<f64> {
    let (even, odd) = (record.points(0, 2), record.points(1, 2));
    let (fitted, all) = fit(&even, coded)?;
    let judge = Logarithms {
        record: &odd,
        ..fitted
    };
    Some(judge.error(&all)).filter(|e| e.is_finite())
}

/// Identifies modes; the delay is not known.
///
/// # Errors
///
/// When there is no resonance in it.
pub(super) fn identify(record: &Record) -> Result<Identified, Unknown> {
    let phased = least_phase(record);
    let found = search(&phased);
    modes_of(record, &found)?;
    let failed = || Unknown::all("the fit to all of its points failed");
    let (coded, held_back) =
        pruned(found.coded, 0, |coded| held_back(&phased, coded)).ok_or_else(failed)?;
    let modes = (coded.len() - 1) / 2;
    let (own, all) = fit(&phased, &coded).ok_or_else(failed)?;
    let depend = || Unknown::all("its modes depend on each other");
    let solution = uncertainty_of_points(|c| own.residuals(c), &all).ok_or_else(depend)?;
    let mut at = all[..2 * modes].to_vec();
    at.push(0.0);
    let values = phased.linear(&at).map_or_else(Vec::new, |(v, _)| v);
    let left = own.residuals(&all);
    let (parameters, mut unknown) =
        // Of a phase that was made from magnitudes nothing is told.
        stated_modes(&phased, &all, &solution, (None, &[&left], &vec![0.0; all.len()]), (&at, &values));
    unknown.push(Unknown {
        parameters: vec!["delay"],
        because: "it has no phase: a delay leaves no trace in magnitude".to_owned(),
    });
    let hidden = |name: &str| unknown.iter().any(|u| u.covers(name));
    let mut parameters: Vec<Parameter> = parameters
        .into_iter()
        .map(|(name, known)| Parameter {
            name,
            known: (!hidden(name)).then_some(known),
        })
        .collect();
    parameters.push(Parameter {
        name: "delay",
        known: None,
    });
    let target: Vec<f64> = phased.target();
    let x = phased.columns(&at);
    Ok(Identified {
        parameters,
        unknown,
        relative_error_percent: own.error(&all),
        validation_error_percent: held_back,
        condition: least_squares(&x, &target).map_or(f64::INFINITY, |s| s.condition),
        prediction: own
            .magnitude(&all)
            .into_iter()
            .map(|m| Complex::new(m, 0.0))
            .collect(),
        record: record.clone(),
        modes,
        peaks: peaks(&phased, &at, &values),
        real_poles: Vec::new(),
        set_aside: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// One mode: its phase is the least there is.
    #[test]
    fn the_phase_of_a_mode_comes_from_its_magnitude() {
        let frequency: Vec<f64> = (1..2000).map(|k| 0.1 * f64::from(k)).collect();
        let response: Vec<Complex<f64>> = frequency
            .iter()
            .map(|f| {
                let (w, o) = (TAU * f, TAU * 20.0);
                o * o / Complex::new(o * o - w * w, 2.0 * 0.05 * o * w)
            })
            .collect();
        let sizes: Vec<f64> = response.iter().map(|h| h.norm()).collect();
        let record = Record::of_magnitude(&frequency, &sizes, None).unwrap();
        let prediction = least_phase(&record);
        for (f, h) in prediction.frequency.iter().zip(&prediction.response) {
            let k = (f / 0.1).round() as usize - 1;
            let off = (h / response[k]).arg();
            assert!(off.abs() < 0.05, "{f} Hz: {off} rad");
        }
    }

    /// By Simpson's rule, through both of its formulas; its logarithm near zero by itself.
    #[test]
    fn the_integral_of_bodes_weight() {
        for u in [0.05, 0.29, 0.31, 1.0, 4.0] {
            let (n, low) = (20_000, 1e-2_f64);
            let h = (u - low) / f64::from(n);
            let weight = |v: f64| (1.0 / (0.5 * v).tanh()).ln();
            let near = low * (1.0 - (0.5 * low).ln());
            let simpson: f64 = (0..n)
                .map(|k| {
                    let a = low + h * f64::from(k);
                    h / 6.0 * (weight(a) + 4.0 * weight(a + 0.5 * h) + weight(a + h))
                })
                .sum();
            assert!((bode(u) - near - simpson).abs() < 1e-6, "{u}");
            assert_eq!(bode(-u), -bode(u));
        }
    }
}
