//! Every law of friction by every method.

use super::{
    Axis, Controller, Equations, Friction, Known, LATE, LEAST, Method, Moved, POSITION, Parameter,
    Record, SLOW, Settings, Sliding, Unknown, Variant, check, other, replay,
};
use nalgebra::{DMatrix, DVector};
use pigtail_numerics::regression::{
    Solution, instrumental, instrumental_alone, instrumental_over, least_squares,
    least_squares_alone, over, over_alone, relative, robust, robust_alone, tolerance,
    without_attenuation,
};
use pigtail_numerics::signal::quantile;

/// Standard deviation of a moment within a sample of which nothing is known, samples: one over the root of twelve.
const WITHIN_A_SAMPLE: f64 = 0.288_675;

/// What is fitted where the axis slides tells the whole record as well, if it leaves less than this of what a fit to all
/// of it leaves. It has one unknown more, and never seen the rest.
const TELLS_ALL: f64 = 1.01;

/// Share of a record's beginning to which variants are fitted where there is no second record; the
/// rest says which of them generalises.
const FITTED: f64 = 0.7;

/// A speed below which the axis may stick.
fn slowest_motion(columns: &Equations) -> f64 {
    let speeds: Vec<f64> = columns.velocity.iter().map(|v| v.abs()).collect();
    SLOW * quantile(&speeds, 0.99)
}

/// Every law of friction by every method, and how each tells what it was not fitted to.
pub(super) fn variants(
    (record, moved): (&Record, &Moved),
    second: Option<&Equations>,
    set: &Settings,
    columns: &Equations,
    controller: Option<&Controller>,
    unknown: &[Unknown],
    (stamped, keep): (&Record, Option<&[bool]>),
) -> Vec<Variant> {
    let mut variants = Vec::new();
    for friction in [Friction::Symmetric, Friction::Asymmetric] {
        if columns.one_way && friction == Friction::Asymmetric {
            continue;
        }
        let x = columns.matrix(friction, Method::LeastSquares);
        let delayed = columns.matrix(friction, Method::Delayed);
        let Some(ordinary) = least_squares(&x, &columns.force) else {
            continue;
        };
        let axis = |values: &[f64]| {
            let mut variant = variant(friction, Method::LeastSquares, &ordinary, 0.0, unknown);
            variant.values = values.to_vec();
            variant.axis(set.force_per_volt)
        };
        let instruments = controller
            .filter(|_| record.has_reference && !columns.one_way && ordinary.values[0] > 0.0)
            .and_then(|c| instruments(stamped, &axis(&ordinary.values), c, set, keep))
            .filter(|z| z.force.len() == columns.force.len());
        // What another sample of delay would change: nobody knows when within it a voltage acts.
        let pairs = columns.force.iter().zip(&columns.lag);
        let later: Vec<f64> = pairs.map(|(f, l)| f - l).collect();
        let moving = slowest_motion(columns);
        let noise = check::acceleration_noise(moved, set);
        // Where rows are far apart differences reach over a turn.
        let speeds = columns.velocity.iter().map(|v| v.abs() > moving);
        let slides: Vec<bool> = if set.is_fine(record.even.period) {
            other::moves(columns)
        } else {
            speeds.collect()
        };
        // The same columns without the delay: what it is to be compared with.
        let without = delayed.clone().remove_column(delayed.ncols() - 1);
        let Some(without) = least_squares_alone(&without, &columns.force) else {
            continue;
        };
        let timing = least_squares_alone(&x, &later).map(|s| s.values);
        let told = told_curve(&delayed, columns, moving);
        let filtered = was_filtered(&delayed, (columns, &told), moving, set.as_stamped);
        // How sure a part of the record is of its parameters nobody asks: that is most of the work.
        let solve = |method: Method, rows: std::ops::Range<usize>| -> Option<Solution> {
            let x = [&x, &delayed][usize::from(method == Method::Delayed)];
            let whole = rows.len() == x.nrows();
            let part = x.rows(rows.start, rows.len()).into_owned();
            let force = &columns.force[rows.clone()];
            if method != Method::Delayed {
                let z = instruments.as_ref().map(|z| z.matrix(friction, method));
                let z = z.map(|z| z.rows(rows.start, rows.len()).into_owned());
                return solved(method, &part, z.as_ref(), force, whole);
            }
            // Where the axis sticks, force leads motion for another reason than a delay.
            let slides = |i: usize| slides[rows.start + i];
            let curve = &columns.curve[rows.clone()];
            let told = filtered.then_some(&told[rows.clone()]);
            let by = (told, set.as_stamped);
            let mut solution = delayed_by(&part, (force, curve), slides, by, whole)?;
            without_attenuation(&part, slides, 0, noise, &mut solution);
            Some(solution)
        };
        let late = solve(Method::Delayed, 0..columns.force.len()).and_then(|s| {
            let (samples, std) = s
                .values
                .last()
                .copied()
                .zip(s.std_correlated.last().copied())?;
            let own = tolerance(&delayed, delayed.ncols() - 1) > check::OWN;
            (own && tells_delay(std, &s, &without)).then_some(Late {
                samples,
                std,
                matters: samples.abs() > 5.0 * std
                    && s.relative_error_percent < LATE * ordinary.relative_error_percent,
            })
        });
        for method in Method::ALL {
            let n = columns.force.len();
            let Some(mut solution) = solve(method, 0..n) else {
                continue;
            };
            if let Some(timing) = timing.as_ref().filter(|_| method != Method::Delayed) {
                widen(&mut solution, timing, &ordinary.values, late);
            }
            let period = record.even.period;
            let mut found = variant(friction, method, &solution, period, unknown);
            found.tells_delay = method == Method::Delayed && late.is_some();
            found.filtered = method == Method::Delayed && filtered;
            found.validation_error_percent = if let Some(second) = second {
                (second.force.len() > 10).then(|| {
                    judged(
                        &second.matrix(friction, method),
                        &second.force,
                        &solution.values,
                    )
                })
            } else {
                let to = (FITTED * n as f64) as usize;
                solve(method, 0..to).map(|part| {
                    let x = [&x, &delayed][usize::from(method == Method::Delayed)];
                    let rest = x.rows(to, n - to).into_owned();
                    judged(&rest, &columns.force[to..], &part.values)
                })
            };
            variants.push(found);
        }
    }
    variants
}

/// By a method without a delay; with deviations where it is asked how `sure` the parameters are.
fn solved(
    method: Method,
    x: &DMatrix<f64>,
    z: Option<&DMatrix<f64>>,
    force: &[f64],
    sure: bool,
) -> Option<Solution> {
    match (method, sure) {
        (Method::Weighted, true) => robust(x, force),
        (Method::Weighted, false) => robust_alone(x, force),
        (Method::Instrumental, true) => instrumental(x, z?, force),
        (Method::Instrumental, false) => instrumental_alone(x, z?, force),
        (_, true) => least_squares(x, force),
        (_, false) => least_squares_alone(x, force),
    }
}

/// What a step that is held for a sample takes from what is fast, of the force's second difference.
const STEP: f64 = 1.0 / 24.0;

/// By how much of its second difference a force differs from `F - d F'`, its delay being `d` samples.
fn second_order(delay: f64) -> f64 {
    0.5 * delay * delay
}

/// For which share of a sample a voltage is held that acts `delay` samples after its row: it acts half of that later on average, and
/// no earlier. Where stamps were put right nobody knows, and one that is held throughout is usual.
fn held(delay: f64, as_stamped: bool) -> f64 {
    if as_stamped {
        (2.0 * delay).clamp(0.0, 1.0)
    } else {
        1.0
    }
}

/// The columns with a delay, told to the second order, of a force and its second difference; what a filter takes of it beside. What a
/// held voltage loses by being held is given back, and parameters are less sure by it where it may not have been: a record that was
/// taken anew at a lower rate looks as one of a slow controller. How sure they are is told where it is asked.
fn delayed_by(
    x: &DMatrix<f64>,
    (force, curve): (&[f64], &[f64]),
    slides: impl Fn(usize) -> bool,
    (filtered, as_stamped): (Option<&[f64]>, bool),
    sure: bool,
) -> Option<Solution> {
    let first = over_alone(x, force, &slides)?;
    let delay = first.values[first.values.len() - 1];
    let held = held(delay, as_stamped);
    let share = second_order(delay) + STEP * held * held;
    let force: Vec<f64> = force
        .iter()
        .zip(curve)
        .map(|(f, c)| f + share * c)
        .collect();
    if let Some(told) = filtered {
        return Some(beside(x, (curve, told), &force, slides)?.0);
    }
    if !sure {
        return over_alone(x, &force, &slides);
    }
    let mut solution = over(x, &force, &slides)?;
    let unsure = if as_stamped {
        STEP * (1.0 - held * held)
    } else {
        STEP * WITHIN_A_SAMPLE
    };
    let more = over_alone(x, curve, slides)?;
    for (std, more) in solution.std_correlated.iter_mut().zip(more.values) {
        *std = std.hypot(unsure * more);
    }
    Some(solution)
}

/// From equation to equation the second difference of the force that inertia and friction tell: it goes with that of the voltage, and not
/// with the noise of one that was measured, of which a force and its second difference have the same.
fn told_curve(delayed: &DMatrix<f64>, columns: &Equations, moving: f64) -> Vec<f64> {
    let n = columns.force.len();
    let slides = |i: usize| columns.velocity[i].abs() > moving;
    let Some(found) = over_alone(delayed, &columns.force, slides) else {
        return vec![0.0; n];
    };
    let own = delayed.ncols() - 1;
    let told = delayed.columns(0, own) * DVector::from_column_slice(&found.values[..own]);
    let steps: Vec<f64> = columns.time.windows(2).map(|w| w[1] - w[0]).collect();
    let longest = 1.5 * quantile(&steps, 0.5);
    (0..n)
        .map(|i| {
            let inside = i > 0 && i + 1 < n && steps[i - 1] < longest && steps[i] < longest;
            if inside {
                told[i - 1] - 2.0 * told[i] + told[i + 1]
            } else {
                0.0
            }
        })
        .collect()
}

/// A solution with one column more and its instrument, without that column's value, and the value with its standard deviation.
fn beside(
    x: &DMatrix<f64>,
    (column, instrument): (&[f64], &[f64]),
    force: &[f64],
    keep: impl Fn(usize) -> bool,
) -> Option<(Solution, Known)> {
    let last = x.ncols();
    let with = |column: &[f64]| {
        let mut wider = x.clone().insert_column(last, 0.0);
        wider.column_mut(last).copy_from_slice(column);
        wider
    };
    let mut solution = instrumental_over(&with(column), &with(instrument), force, keep)?;
    let known = Known {
        value: solution.values.pop()?,
        std: solution.std.pop()?,
        std_correlated: solution.std_correlated.pop()?,
    };
    Some((solution, known))
}

/// Whether the force shows that its voltage was filtered before it was written: where it changes fast it is weaker, and a delay alone
/// does not make it so. Of a filter a delay tells the phase, and the force's second difference what it takes of the size.
fn was_filtered(
    delayed: &DMatrix<f64>,
    (columns, told): (&Equations, &[f64]),
    moving: f64,
    as_stamped: bool,
) -> bool {
    /// Deviations by which it shows.
    const SURE: f64 = 5.0;
    let slides = |i: usize| columns.velocity[i].abs() > moving;
    let shows = |by: &[f64]| {
        let found = beside(delayed, (&columns.curve, by), &columns.force, slides);
        let found = found.and_then(|(s, known)| Some((*s.values.last()?, known)));
        found.is_some_and(|(delay, known)| {
            // What a delay and a held voltage have of it is known.
            let own = second_order(delay) + STEP * held(delay, as_stamped).powi(2);
            (known.value + own).abs() > SURE * known.std_correlated
        })
    };
    // Noise of the voltage shows in its own second difference, and a friction that is smeared in the one that is told.
    shows(&columns.curve) && shows(told)
}

/// What values leave of a force, per cent.
fn judged(x: &DMatrix<f64>, force: &[f64], values: &[f64]) -> f64 {
    let prediction = x * nalgebra::DVector::from_column_slice(values);
    let pairs = force.iter().zip(prediction.iter());
    let residuals: Vec<f64> = pairs.map(|(a, b)| a - b).collect();
    relative(&residuals, force)
}

/// When a record shows its voltage to act, samples after it was taken.
#[derive(Debug, Clone, Copy)]
struct Late {
    samples: f64,
    std: f64,
    /// Whether what was found without it is off by more than chance.
    matters: bool,
}

/// Whether a record says when its voltage acts better than that it does so within a sample. What is found where the
/// axis slides has to tell all of it.
fn tells_delay(std: f64, delayed: &Solution, plain: &Solution) -> bool {
    std < WITHIN_A_SAMPLE
        && delayed.relative_error_percent < TELLS_ALL * plain.relative_error_percent
}

/// A voltage acts anywhere within a sample after the moment that was taken: by how much parameters are less sure
/// for it, those of a sample later being `later`. Where the record shows when it does, that is by how far they may be
/// off.
fn widen(solution: &mut Solution, later: &[f64], values: &[f64], late: Option<Late>) {
    // The root mean square of what is anywhere from none to one.
    let samples = late.map_or(1.0 / 3f64.sqrt(), |l| l.samples.hypot(l.std));
    for (j, (later, value)) in later.iter().zip(values).enumerate() {
        let by = samples * (later - value);
        let correlated = &mut solution.std_correlated[j];
        *correlated = correlated.hypot(by);
        if late.is_some_and(|l| l.matters) {
            solution.std[j] = solution.std[j].hypot(by);
        }
    }
}

fn variant(
    friction: Friction,
    method: Method,
    solution: &Solution,
    period: f64,
    unknown: &[Unknown],
) -> Variant {
    let mut values = solution.values.clone();
    let last = values.len() - 1;
    let delay = (method == Method::Delayed).then(|| {
        values.pop();
        Parameter {
            name: "voltage_delay",
            known: Some(Known {
                value: period * solution.values[last],
                std: period * solution.std[last],
                std_correlated: period * solution.std_correlated[last],
            }),
        }
    });
    let parameters = friction
        .names()
        .iter()
        .enumerate()
        .map(|(j, name)| Parameter {
            name,
            // Of an axis that moves one way there are fewer values than names.
            known: (j < values.len() && !unknown.iter().any(|u| u.covers(name))).then(|| Known {
                value: solution.values[j],
                std: solution.std[j],
                std_correlated: solution.std_correlated[j],
            }),
        })
        .chain(delay)
        .collect();
    Variant {
        friction,
        method,
        parameters,
        tells_delay: false,
        filtered: false,
        values: solution.values.clone(),
        condition: solution.condition,
        relative_error_percent: solution.relative_error_percent,
        validation_error_percent: None,
    }
}

/// The columns of the closed loop replayed: correlated with what is measured, not with its noise.
fn instruments(
    record: &Record,
    axis: &Axis,
    controller: &Controller,
    set: &Settings,
    keep: Option<&[bool]>,
) -> Option<Equations> {
    let mut equations = Equations::default();
    for stretch in &record.even.stretches {
        if stretch.columns[POSITION].len() < LEAST + set.skip {
            continue;
        }
        let prediction = replay::stretch(
            stretch,
            record.injected_column(),
            record.even.period,
            axis,
            &Sliding::Coulomb,
            controller,
        )?;
        let period = record.even.period;
        let moving = Equations::moving(stretch.start, period, &prediction.position, set);
        equations.extend(&moving, &prediction.voltage, period, set);
    }
    if let Some(keep) = keep.filter(|k| k.len() == equations.force.len()) {
        equations.retain(keep);
    }
    Some(equations)
}
