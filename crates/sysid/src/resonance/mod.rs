//! Modes, damping and delay from a frequency response:
//!
//! ```text
//! H(w) = e^(-j w tau) ( sum_k (r_k + j w s_k) / (w_k^2 - w^2 + 2 j zeta_k w_k w)
//!                       + sum_m c_m / (1 + j w / p_m) + e_0 + e_1 / (j w) - e_2 / w^2 )
//! ```
//!
//! The real poles `p_m` are creep, a sensor's filter, and whatever else falls off without a peak. For given
//! frequencies, dampings, delay and real poles the rest is linear and follows by least squares, so that
//! only those are searched (variable projection, G. Golub and V. Pereyra 1973). Modes are added one at a
//! time where they help most, as long as the points that were held back are told better. The parts `s_k`,
//! by which a mode is not of proportional damping, are there only where they tell those better too: they
//! pass for a delay.
//!
//! Where there is no phase, the least one that goes with the magnitude is taken (`magnitude.rs`).

mod alike;
mod averaged;
mod delay;
mod linear;
mod magnitude;
mod models;
mod record;
mod renumbered;
mod rows;
mod search;
mod wander;

pub use record::Record;

use self::alike::Sides;
use self::delay::{delay_spread, vague};
use self::models::{Model, models};
use self::record::ASIDE;
use self::search::Found;
use super::{Known, Parameter, Unknown};
use nalgebra::Complex;
use pigtail_numerics::regression::{Solution, least_squares};
use pigtail_numerics::signal::quantile;
use std::f64::consts::{PI, TAU};

/// Most modes.
pub const MODES: usize = 6;

/// Names of the parameters of each mode.
pub const NAMES: [[&str; 2]; MODES] = [
    ["frequency_1", "damping_1"],
    ["frequency_2", "damping_2"],
    ["frequency_3", "damping_3"],
    ["frequency_4", "damping_4"],
    ["frequency_5", "damping_5"],
    ["frequency_6", "damping_6"],
];

/// Points that are enough to see where modes are; they settle over all of them in the end.
const ENOUGH: usize = 400;

/// Most real poles.
const POLES: usize = 3;

/// A mode must make the error on the points held back less by this share.
const WORTH: f64 = 0.05;

/// What a frequency response says.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// Frequency (Hz) and damping ratio of each mode, then the delay (s).
    pub parameters: Vec<Parameter>,
    /// What cannot be known.
    pub unknown: Vec<Unknown>,
    /// Relative error over all points, per cent of the weighted response.
    pub relative_error_percent: f64,
    /// The same at every second point, of a model fitted to the others.
    pub validation_error_percent: f64,
    /// Condition number of the linear problem at the parameters.
    pub condition: f64,
    /// The response that the model tells.
    pub prediction: Vec<Complex<f64>>,
    /// The response it was fitted to: thinned, if there were very many points.
    pub record: Record,
    /// Number of modes.
    pub modes: usize,
    /// Where the magnitude is highest near each mode, Hz; `None` for a mode whose peak others cover.
    pub peaks: Vec<Option<f64>>,
    /// Real poles, Hz.
    pub real_poles: Vec<f64>,
    /// Frequencies of points that stand apart from their neighbours and were set aside, Hz.
    pub set_aside: Vec<f64>,
}

/// Frequency and damping of each mode in rising order, and what is not known of them: by what magnitude and phase say, by what is left of
/// each part of the response, by how much each number that is searched is open, and by the response that a model's searched numbers and linear
/// parts tell.
fn stated_modes(
    record: &Record,
    coded: &[f64],
    solution: &Solution,
    (sides, left, opened): (Option<&[Sides]>, &[&[f64]], &[f64]),
    model: (&[f64], &[f64]),
) -> (Vec<(&'static str, Known)>, Vec<Unknown>) {
    let mut order: Vec<usize> = (0..record.modes(model.0)).collect();
    let misfit = alike::misfit(record, left, &coded[..2 * order.len()]);
    order.sort_by(|a, b| coded[2 * a].total_cmp(&coded[2 * b]));
    let mut parameters = Vec::new();
    let mut unknown = Vec::new();
    for (names, k) in NAMES.iter().zip(&order) {
        let off = |j: usize| sides.map_or(0.0, |s| s[j].off()).hypot(opened[j]);
        let scaled = |j: usize, size: f64, open: f64| Known {
            value: coded[j].exp() * size,
            std: coded[j].exp() * size * solution.std[j],
            // Neighbours that go together make nothing surer: where a narrow peak rests on few batches, their scatter
            // may be small by chance.
            std_correlated: coded[j].exp()
                * size
                * solution.std_correlated[j]
                    .max(solution.std[j])
                    .hypot(off(j))
                    .hypot(open),
        };
        let (open, width) = (misfit[*k], coded[2 * k + 1].exp());
        let frequency = scaled(2 * k, 1.0 / TAU, width * open);
        let damping = scaled(2 * k + 1, 1.0, open);
        doubt(record, names, &frequency, &damping, &mut unknown);
        let of_damping = sides.map(|s| s[2 * k + 1]);
        if let Some(sides) = of_damping.filter(|s| s.differ()) {
            let [one, other] = sides.words();
            unknown.push(Unknown {
                parameters: names.to_vec(),
                because: format!(
                    "of the mode at {:.3} Hz {one}, {other}: were points smoothed, or cut off?",
                    frequency.value
                ),
            });
        }
        parameters.push((names[0], frequency));
        parameters.push((names[1], damping));
    }
    let bent: Vec<bool> = order.iter().map(|k| misfit[*k] > 0.0).collect();
    merged(record, model, &bent, &parameters, &mut unknown);
    (parameters, unknown)
}

/// Modes that lie within each other's width, or that overlap and have one peak, are one peak of another shape: two that nearly cancel make
/// any, and so do two beside each other. So are two of which the magnitude is highest at one place where more is left on
/// either than elsewhere, `bent`.
fn merged(
    record: &Record,
    model: (&[f64], &[f64]),
    bent: &[bool],
    parameters: &[(&'static str, Known)],
    unknown: &mut Vec<Unknown>,
) {
    /// Of the narrower one's half width.
    const WITHIN: f64 = 0.5;
    let tops = peaks(record, model.0, model.1);
    let pairs = parameters.windows(4).step_by(2);
    let mut overlap = false;
    for ((pair, tops), bent) in pairs.zip(tops.windows(2)).zip(bent.windows(2)) {
        let [(f1, one), (z1, a), (f2, two), (z2, b)] = pair else {
            continue;
        };
        let widths = [one.value * a.value, two.value * b.value];
        let apart = two.value - one.value;
        let places = [(one.value, widths[0]), (two.value, widths[1])];
        let overlapped = std::mem::replace(&mut overlap, apart < widths[0] + widths[1]);
        // Of three in a row the middle one has no peak of its own.
        let one_peak = || overlap && (overlapped || alike::one_peak(record, model, places));
        let narrower = widths[0].min(widths[1]);
        let one_top = match tops {
            [Some(a), Some(b)] => (bent[0] || bent[1]) && (a - b).abs() < WITHIN * narrower,
            _ => false,
        };
        if apart < WITHIN * narrower || one_top || one_peak() {
            unknown.push(Unknown {
                parameters: vec![f1, z1, f2, z2],
                because: format!(
                    "modes at {:.3} Hz and {:.3} Hz lie within each other's width: one peak that has not the shape of a mode",
                    one.value, two.value
                ),
            });
        }
    }
}

/// That no magnitude was cut off: points in a row that stand at the highest one, where no others stand still.
fn whole(record: &Record) -> Result<(), Unknown> {
    /// Points that make a plateau.
    const FLAT: usize = 4;
    let sizes: Vec<f64> = record.response.iter().map(|h| h.norm()).collect();
    let same = |a: &f64, b: &f64| (a - b).abs() <= 1e-9 * a.abs();
    let top = sizes.iter().copied().fold(0.0, f64::max);
    let runs = || sizes.chunk_by(same).filter(|run| run.len() >= FLAT);
    let Some(plateau) = runs().find(|run| same(&run[0], &top)) else {
        return Ok(());
    };
    // Magnitudes in coarse steps stand still everywhere.
    if runs().any(|run| !same(&run[0], &top)) {
        return Ok(());
    }
    Err(Unknown::all(format!(
        "its magnitude stands at {top:.4e}, the highest, for {} points in a row: it was cut off there, and the damping with it",
        plateau.len()
    )))
}

/// That magnitude and phase are of one response: a power, or the root of one, has the phase of another.
fn of_one_kind(record: &Record, found: &Identified) -> Result<(), Unknown> {
    /// Relative error from which it is asked, per cent, and the share of it that the other kind leaves.
    const MUCH: f64 = 5.0;
    const LESS: f64 = 0.5;
    if !record.phased || found.relative_error_percent < MUCH {
        return Ok(());
    }
    for (power, is) in [(2.0, "the root of one"), (0.5, "its square, a power")] {
        let floor = 0.1
            * quantile(
                &record
                    .response
                    .iter()
                    .map(|h| h.norm().powf(power))
                    .collect::<Vec<_>>(),
                0.5,
            );
        let response: Vec<Complex<f64>> = record
            .response
            .iter()
            .map(|h| Complex::from_polar(h.norm().powf(power), h.arg()))
            .collect();
        let other = Record {
            weight: response.iter().map(|h| 1.0 / (h.norm() + floor)).collect(),
            response,
            ..record.clone()
        };
        let Ok(other) = of_all_points(&other) else {
            continue;
        };
        if other.relative_error_percent < LESS * power * found.relative_error_percent {
            return Err(Unknown::all(format!(
                "its magnitude goes with its phase as if it were {is}, by {:.1} % instead of {:.1} %: are decibels 20 log10 of a \
                 ratio, and is it no power?",
                other.relative_error_percent / power,
                found.relative_error_percent
            )));
        }
    }
    Ok(())
}

/// That there are modes, and that they tell something.
fn modes_of(record: &Record, found: &Found) -> Result<usize, Unknown> {
    let modes = record.with_poles(found.poles).modes(&found.coded);
    if modes == 0 {
        return Err(Unknown::all(format!(
            "no mode tells it better than a response without one, which is {:.1} % off",
            found.none
        )));
    }
    // More than a third is no answer.
    if found.error > 100.0 / 3.0 {
        return Err(Unknown::all(format!(
            "{modes} modes leave {:.0} % of it unexplained: are magnitude and phase what they are said to be?",
            found.error
        )));
    }
    Ok(modes)
}

/// Identifies modes and delay; of magnitudes alone modes.
///
/// Points whose magnitude stands apart from that of their neighbours are set aside where all that remains is then told
/// twice as well: a narrow peak stands apart too, and a mode tells it.
///
/// # Errors
///
/// When there is no resonance in it.
pub fn identify(record: &Record) -> Result<Identified, Unknown> {
    whole(record)?;
    let found = with_points_apart(record)?;
    of_one_kind(record, &found)?;
    Ok(found)
}

/// Why a response is refused, and the relative error that it is told with by what it is refused for, per cent.
struct Refused {
    why: Unknown,
    error: f64,
}

impl From<Unknown> for Refused {
    fn from(why: Unknown) -> Self {
        Self {
            why,
            error: f64::INFINITY,
        }
    }
}

/// Relative error of a model, per cent.
fn error_of(record: &Record, coded: &[f64]) -> f64 {
    let linear = record.linear(coded);
    linear.map_or(f64::INFINITY, |(values, _)| record.error(coded, &values))
}

fn with_points_apart(record: &Record) -> Result<Identified, Unknown> {
    let all = of_all_points(record);
    let apart = record.apart();
    if apart.is_empty() {
        return all.map_err(|refused| refused.why);
    }
    let Ok(without) = of_all_points(&record.without(&apart)) else {
        return all.map_err(|refused| refused.why);
    };
    let better = match &all {
        Ok(all) => without.relative_error_percent < ASIDE * all.relative_error_percent,
        Err(refused) => without.relative_error_percent < refused.error,
    };
    if !better {
        return all.map_err(|refused| refused.why);
    }
    Ok(Identified {
        set_aside: apart.iter().map(|k| record.frequency[*k]).collect(),
        ..without
    })
}

fn of_all_points(record: &Record) -> Result<Identified, Refused> {
    if !record.phased {
        return Ok(magnitude::identify(record)?);
    }
    let models = models(record)?;
    let Model {
        record,
        coded,
        error,
        ..
    } = models[0].clone();
    let record = &record;
    let modes = record.modes(&coded);
    let of_rows = rows::open(record, &coded)?;
    let renumbered = renumbered::open(record, &coded).map_err(|(why, share)| Refused {
        why,
        error: error_of(record, &coded) * share.sqrt(),
    })?;
    if modes == MODES {
        alike::few_enough(record, &coded, WORTH)?;
    }
    let solution = record
        .known(&coded)
        .ok_or_else(|| Unknown::all("its modes depend on each other"))?;
    let (values, _) = record
        .linear(&coded)
        .ok_or_else(|| Unknown::all("its modes depend on each other"))?;
    let x = record.columns(&coded);
    let product = &x * nalgebra::DVector::from_column_slice(&values);
    let n = record.frequency.len();
    let prediction = (0..n)
        .map(|i| Complex::new(product[i], product[n + i]) / record.weight[i].max(1e-300))
        .collect();
    let sides = alike::sides(record, &coded);
    let left = record.residuals(&coded);
    let opened: Vec<f64> = averaged::open(record, &coded, &values)
        .iter()
        .zip(of_rows.iter().zip(&renumbered))
        .map(|(averaged, (rows, renumbered))| averaged.hypot(*rows).hypot(*renumbered))
        .collect();
    let (mut parameters, mut unknown) = stated_modes(
        record,
        &coded,
        &solution,
        (sides.as_deref(), &[&left[..n], &left[n..]], &opened),
        (&coded, &values),
    );
    let top = TAU * record.highest();
    let delay = Known {
        value: coded[2 * modes] / top,
        std: solution.std[2 * modes] / top,
        std_correlated: delay::between(
            &models,
            solution.std_correlated[2 * modes].max(solution.std[2 * modes]),
        )
        .max(delay_spread(record, &coded))
        .hypot(opened[2 * modes])
            / top,
    };
    let steps: Vec<f64> = record.frequency.windows(2).map(|w| w[1] - w[0]).collect();
    let longest = 0.5 / quantile(&steps, 0.5);
    if delay.value.abs() > 0.8 * longest {
        unknown.push(Unknown {
            parameters: vec!["delay"],
            because: format!(
                "points {:.3} Hz apart tell no delay beyond {longest:.3e} s",
                0.5 / longest
            ),
        });
    }
    unknown.extend(vague(&delay, top));
    parameters.push(("delay", delay));
    let parameters = parameters
        .into_iter()
        .map(|(name, known)| Parameter {
            name,
            known: (!unknown.iter().any(|u: &Unknown| u.covers(name))).then_some(known),
        })
        .collect();
    let condition = least_squares(&x, &record.target()).map_or(f64::INFINITY, |s| s.condition);
    Ok(Identified {
        parameters,
        unknown,
        relative_error_percent: record.error(&coded, &values),
        validation_error_percent: error,
        condition,
        prediction,
        record: record.clone(),
        modes,
        peaks: peaks(record, &coded, &values),
        real_poles: record.real_poles(&coded),
        set_aside: Vec::new(),
    })
}

/// Where the model's magnitude is highest near each mode, in the order of their frequencies.
fn peaks(record: &Record, coded: &[f64], values: &[f64]) -> Vec<Option<f64>> {
    const AROUND: usize = 400;
    let top = TAU * record.highest();
    let mut modes: Vec<(f64, f64)> = coded[..2 * record.modes(coded)]
        .chunks_exact(2)
        .map(|pair| (pair[0].exp() / TAU, pair[1].exp()))
        .collect();
    modes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let peak = |(own, zeta): (f64, f64)| {
        let reach = (4.0 * zeta).clamp(0.01, 0.5);
        let frequency: Vec<f64> = (0..=AROUND)
            .map(|k| own * (1.0 + reach * (2.0 * k as f64 / AROUND as f64 - 1.0)))
            .chain(std::iter::once(top / TAU))
            .collect();
        let n = frequency.len();
        let grid = Record {
            response: vec![Complex::new(0.0, 0.0); n],
            weight: vec![1.0; n],
            frequency,
            ..record.clone()
        };
        let told = grid.columns(coded) * nalgebra::DVector::from_column_slice(values);
        let size = |k: usize| told[k].hypot(told[n + k]);
        let highest = |k: &usize| size(*k) > size(k - 1) && size(*k) >= size(k + 1);
        let best = (1..AROUND)
            .filter(highest)
            .max_by(|a, b| size(*a).total_cmp(&size(*b)))?;
        Some(grid.frequency[best])
    };
    modes.into_iter().map(peak).collect()
}

/// What the points near a mode do not tell of it.
fn doubt(
    record: &Record,
    names: &[&'static str; 2],
    frequency: &Known,
    damping: &Known,
    unknown: &mut Vec<Unknown>,
) {
    // Width of the peak between its half-power points.
    let width = 2.0 * damping.value * frequency.value;
    let within = record
        .frequency
        .iter()
        .filter(|f| (*f - frequency.value).abs() < width)
        .count();
    if within < 2 {
        unknown.push(Unknown {
            parameters: vec![names[1]],
            because: format!(
                "{within} points lie on the peak at {:.3} Hz, which would be {width:.2e} Hz wide",
                frequency.value
            ),
        });
    } else if damping.std_correlated > damping.value / 3.0 {
        unknown.push(Unknown {
            parameters: vec![names[1]],
            because: format!(
                "what it says of {} is {:.2e} with a standard deviation of {:.2e}",
                names[1], damping.value, damping.std_correlated
            ),
        });
    }
    let outside = frequency.value < record.frequency[0] || frequency.value > record.highest();
    if frequency.std_correlated > 0.1 * frequency.value || outside {
        unknown.push(Unknown {
            parameters: names.to_vec(),
            because: format!(
                "the mode at {:.3} Hz lies at the end of its points or is too vague",
                frequency.value
            ),
        });
    }
}

/// Magnitude in decibels and phase in degrees, unwrapped.
pub fn bode(frequency: &[f64], response: &[Complex<f64>]) -> [Vec<(f64, f64)>; 2] {
    let mut turn = 0.0;
    let mut last: Option<f64> = None;
    let mut magnitude = Vec::new();
    let mut phase = Vec::new();
    for (f, h) in frequency.iter().zip(response) {
        let mut angle = h.arg() + turn;
        if let Some(last) = last {
            while angle - last > PI {
                turn -= TAU;
                angle -= TAU;
            }
            while angle - last < -PI {
                turn += TAU;
                angle += TAU;
            }
        }
        last = Some(angle);
        magnitude.push((*f, 20.0 * h.norm().max(1e-300).log10()));
        phase.push((*f, angle.to_degrees()));
    }
    [magnitude, phase]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn made(modes: &[(f64, f64, f64)], delay: f64, noise: f64, step: f64) -> Record {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(31);
        let frequency: Vec<f64> = (1..=(500.0 / step) as usize)
            .map(|k| step * k as f64)
            .collect();
        let response: Vec<Complex<f64>> = frequency
            .iter()
            .map(|f| {
                let w = TAU * f;
                let mut h = Complex::new(0.05, 0.0);
                for (own, zeta, size) in modes {
                    let o = TAU * own;
                    h += size * o * o / Complex::new(o * o - w * w, 2.0 * zeta * o * w);
                }
                let mut wobble = || noise * (2.0 * rng.random::<f64>() - 1.0);
                h * Complex::from_polar(1.0, -w * delay)
                    + h.norm() * Complex::new(wobble(), wobble())
            })
            .collect();
        Record::new(&frequency, &response, None).unwrap()
    }

    #[test]
    fn modes_damping_and_delay_are_found() {
        let truth = [(60.0, 0.02, 1.0), (180.0, 0.05, -0.4), (310.0, 0.01, 0.1)];
        let found = identify(&made(&truth, 1.3e-3, 0.02, 0.5)).unwrap();
        assert_eq!(found.modes, 3, "{found:?}");
        let of = |name: &str| {
            let parameter = found.parameters.iter().find(|p| p.name == name).unwrap();
            parameter.known.unwrap().value
        };
        for (k, (frequency, zeta, _)) in truth.iter().enumerate() {
            let [f, z] = NAMES[k];
            assert!((of(f) / frequency - 1.0).abs() < 2e-3, "{f}: {}", of(f));
            assert!((of(z) / zeta - 1.0).abs() < 0.05, "{z}: {}", of(z));
        }
        assert!((of("delay") - 1.3e-3).abs() < 2e-5, "{}", of("delay"));
    }

    #[test]
    fn a_filter_behind_all_is_no_delay_and_no_mode() {
        let truth = [(60.0, 0.02, 1.0), (180.0, 0.03, -0.4)];
        let (delay, pole) = (4e-4, 250.0);
        let mut record = made(&truth, delay, 0.02, 1.0);
        for (f, h) in record.frequency.iter().zip(&mut record.response) {
            *h /= Complex::new(1.0, f / pole);
        }
        let record = Record::new(&record.frequency, &record.response, None).unwrap();
        let found = identify(&record).unwrap();
        assert_eq!(found.modes, 2, "{found:?}");
        let of = |name: &str| found.parameters.iter().find(|p| p.name == name);
        let told = of("delay").and_then(|p| p.known).unwrap();
        let off = (told.value - delay).abs();
        assert!(off < 3.0 * told.std_correlated && off < 2e-5, "{told:?}");
        let [filter] = found.real_poles[..] else {
            panic!("{:?}", found.real_poles);
        };
        assert!((filter / pole - 1.0).abs() < 0.1, "{filter}");
    }

    #[test]
    fn wild_points_are_set_aside_and_a_narrow_peak_is_not() {
        let truth = [(60.0, 0.02, 1.0), (180.0, 0.05, -0.4)];
        let mut record = made(&truth, 1e-3, 0.01, 1.0);
        let wild = [40, 111, 300, 301];
        for k in wild {
            record.response[k] *= 30.0;
        }
        let found = identify(&record).unwrap();
        let wanted: Vec<f64> = wild.iter().map(|k| record.frequency[*k]).collect();
        assert_eq!(found.set_aside, wanted);
        assert_eq!(found.modes, 2, "{found:?}");
        // Three points on the peak.
        let narrow = made(&[(60.0, 0.01, 1.0), (180.3, 0.004, 1.0)], 0.0, 0.005, 0.5);
        let found = identify(&narrow).unwrap();
        assert!(found.set_aside.is_empty() && found.modes == 2, "{found:?}");
    }

    #[test]
    fn what_the_points_do_not_resolve_is_not_told() {
        // A peak 0.03 Hz wide between points 5 Hz apart.
        let found = identify(&made(
            &[(62.3, 0.0003, 1.0), (200.0, 0.03, 1.0)],
            0.0,
            0.001,
            5.0,
        ));
        if let Ok(found) = found {
            let narrow = found
                .parameters
                .iter()
                .find(|p| p.name == "damping_1")
                .unwrap();
            assert!(found.modes < 2 || narrow.known.is_none(), "{found:?}");
        }
        let flat = made(&[], 1e-3, 0.02, 1.0);
        assert!(identify(&flat).is_err_and(|u| u.because.contains("no mode")));
    }
}
