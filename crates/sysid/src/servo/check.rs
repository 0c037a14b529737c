//! What a servo's record cannot tell, found before anybody believes a number.

use super::{
    Equations, Friction, Method, Moved, POSITION, REFERENCE, Record, Settings, VOLTAGE, tolerance,
};
use crate::Unknown;
use crate::timeline::Clock;
use pigtail_numerics::regression::least_squares;
use pigtail_numerics::signal::{Lowpass, decimate, quantile, quantiles, rms};

/// A servo's record is sampled faster than this, seconds, and more slowly than [`FASTEST`].
const SLOWEST: f64 = 0.05;
const FASTEST: f64 = 5e-6;

/// Share of samples at the voltage's bound beyond which nobody knows what drove the axis.
const SATURATED: f64 = 0.2;

/// Share of the samples at an end of the position's range, the reference being beyond it.
const PEGGED: f64 = 0.02;

/// Share of a sample's way by which it may miss the curve through its neighbours.
const ROUGH: f64 = 0.1;

/// Least share of equations that move in a direction.
const ONE_WAY: f64 = 0.02;

/// Least tolerance of a column beside the others: how much of it is its own.
pub(super) const OWN: f64 = 0.01;

/// Least power of the acceleration over that of the noise in it.
const ABOVE_NOISE: f64 = 10.0;

/// Largest share of the acceleration's power that may be noise: it makes the inertia too small by as much.
pub(super) const QUIET: f64 = 0.005;

/// Share of the force's power that may be filtered off.
const LOST: f64 = 0.5;

/// By so large a share ordinary and robust fits may differ in the inertia.
const DISAGREE: f64 = 0.1;

/// Largest share of the force that a parameter's standard deviation may be worth.
const UNSURE: f64 = 0.25;

/// Refuses records as a whole.
pub(super) fn whole(
    record: &Record,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> Result<(), Unknown> {
    let period = record.even.period;
    if !(FASTEST..=SLOWEST).contains(&period) {
        return Err(Unknown::all(format!(
            "its samples are {period} s apart, too far or too close for a servo, which is sampled every \
             {FASTEST} to {SLOWEST} s: is the unit of time right?"
        )));
    }
    // Samples that were taken evenly are even, however they were stamped.
    let odd = matches!(record.even.clock, Clock::Stamps | Clock::Untold);
    if odd && record.even.jitter > 0.35 {
        return Err(Unknown::all(format!(
            "its moments deviate by {:.0} % of a sample period from even ones: velocity would be noise",
            100.0 * record.even.jitter
        )));
    }
    let (position, volts) = (record.column(POSITION), record.column(VOLTAGE));
    let range = span(&position);
    if range <= 0.0 {
        return Err(Unknown::all("the position never changes"));
    }
    if span(&volts) <= 0.0 {
        return Err(Unknown::all(
            "the voltage never changes: nothing is excited",
        ));
    }
    if record.has_reference {
        against_reference(record, &position, &record.column(REFERENCE))?;
    }
    held(record)?;
    saturation(&volts, remarks)?;
    if !record.has_reference {
        remarks.push(format!(
            "no reference: a motion faster than {:.6} Hz that sampling folded onto a slow one cannot be told from \
             the slow one",
            0.5 / period
        ));
    }
    aliasing(record, set)
}

fn span(values: &[f64]) -> f64 {
    let (low, high) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(*v), h.max(*v))
        });
    high - low
}

/// Units and columns: a servo's position follows its reference, a little later.
fn against_reference(record: &Record, position: &[f64], reference: &[f64]) -> Result<(), Unknown> {
    if span(reference) <= 0.0 {
        return Err(Unknown::all("the reference never changes"));
    }
    let equal = position
        .iter()
        .zip(reference)
        .filter(|(q, r)| q == r)
        .count();
    if equal as f64 > 0.5 * position.len() as f64 {
        return Err(Unknown::all(
            "position and reference are the same: one of the columns is the other",
        ));
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (q0, r0) = (mean(position), mean(reference));
    let (mut rr, mut rq, mut qq) = (0.0, 0.0, 0.0);
    for (q, r) in position.iter().zip(reference) {
        rr += (r - r0) * (r - r0);
        rq += (r - r0) * (q - q0);
        qq += (q - q0) * (q - q0);
    }
    let together = rq / (rr * qq).sqrt();
    let slope = rq / rr;
    if together < 0.8 {
        return Err(Unknown::all(format!(
            "position and reference have little in common (correlation {together:.2}): a servo's follows \
             its reference; are columns swapped?"
        )));
    }
    if !(0.5..=2.0).contains(&slope) {
        return Err(Unknown::all(format!(
            "the position moves {slope:.4} times as far as its reference: are they of one unit?"
        )));
    }
    let (low, high) = (
        position.iter().copied().fold(f64::INFINITY, f64::min),
        position.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    );
    let room = 0.05 * (high - low);
    let pegged = position
        .iter()
        .zip(reference)
        .filter(|(q, r)| (**q == high && **r > high + room) || (**q == low && **r < low - room))
        .count();
    if pegged as f64 > PEGGED * position.len() as f64 {
        return Err(Unknown::all(format!(
            "the position is saturated: for {:.0} % of the samples it stands at an end of its range, the \
             reference being beyond",
            100.0 * pegged as f64 / position.len() as f64
        )));
    }
    let lead = lead_of(record);
    if lead > 1.0 {
        return Err(Unknown::all(format!(
            "the position comes {lead:.1} samples before its reference: are the two columns swapped?"
        )));
    }
    Ok(())
}

/// By how many samples the position comes before the reference: where a shifted reference fits best,
/// with a parabola between samples.
fn lead_of(record: &Record) -> f64 {
    const MOST: isize = 30;
    let Some(stretch) = record
        .even
        .stretches
        .iter()
        .max_by_key(|s| s.columns[POSITION].len())
    else {
        return 0.0;
    };
    let n = stretch.columns[POSITION].len().cast_signed();
    if n < 4 * MOST {
        return 0.0;
    }
    let (q, r) = (&stretch.columns[POSITION], &stretch.columns[REFERENCE]);
    let every = (n / 50_000).max(1).cast_unsigned();
    let miss = |lead: isize| {
        let samples = (MOST..n - MOST).step_by(every);
        rms(samples.map(|k| q[k.cast_unsigned()] - r[(k + lead).cast_unsigned()]))
    };
    let misses: Vec<f64> = (-MOST..=MOST).map(miss).collect();
    let best = (0..misses.len())
        .min_by(|a, b| misses[*a].total_cmp(&misses[*b]))
        .unwrap_or(0);
    if best == 0 || best + 1 == misses.len() {
        return best as f64 - MOST as f64;
    }
    let (a, b, c) = (misses[best - 1], misses[best], misses[best + 1]);
    let bend = a - 2.0 * b + c;
    let aside = if bend > 0.0 {
        0.5 * (a - c) / bend
    } else {
        0.0
    };
    best as f64 - MOST as f64 + aside
}

/// A position that is read by a slower clock than its rows stands for some rows at a time, and its acceleration is that of steps.
fn held(record: &Record) -> Result<(), Unknown> {
    /// Share of the steps that come after as many rows.
    const EVENLY: f64 = 0.95;
    let (mut ways, mut rows) = (Vec::new(), Vec::new());
    for stretch in &record.even.stretches {
        let q = &stretch.columns[POSITION];
        let mut last = None;
        for k in (1..q.len()).filter(|k| q[*k] != q[k - 1]) {
            if let Some(last) = last.replace(k) {
                ways.push((q[k] - q[last]).abs());
                rows.push(k - last);
            }
        }
    }
    // Where it is fast an encoder counts in every row.
    let fast = quantile(&ways, 0.75);
    let of_fast = || rows.iter().zip(&ways).filter(|(_, way)| **way >= fast);
    let mut most = of_fast().map(|(rows, _)| *rows).collect::<Vec<_>>();
    most.sort_unstable();
    let Some(usual) = most.get(most.len() / 2).copied().filter(|n| *n > 1) else {
        return Ok(());
    };
    let evenly = most.iter().filter(|n| **n == usual).count();
    if evenly as f64 > EVENLY * most.len() as f64 {
        return Err(Unknown::all(format!(
            "its position stands for {usual} rows at a time, and its acceleration is that of steps: take every {usual}th row"
        )));
    }
    Ok(())
}

fn saturation(volts: &[f64], remarks: &mut Vec<String>) -> Result<(), Unknown> {
    let most = volts.iter().fold(0.0_f64, |m, u| m.max(u.abs()));
    let edge = (1.0 - 1e-6) * most;
    let at = volts.iter().filter(|u| u.abs() >= edge).count();
    let share = at as f64 / volts.len() as f64;
    if share > SATURATED {
        return Err(Unknown::all(format!(
            "the voltage is saturated: for {:.0} % of the samples it stands at its bound of {most:.3} V",
            100.0 * share
        )));
    }
    if at > 10 {
        remarks.push(format!(
            "the voltage stands at its bound of {most:.3} V for {:.1} % of the samples; taken as what the \
             amplifier gave",
            100.0 * share
        ));
        // A scale shows nowhere else: inertia and friction go with it alike.
        if [1.0, 100.0]
            .iter()
            .any(|full| (most / full - 1.0).abs() < 1e-5)
        {
            remarks.push(format!(
                "a bound of {most:.0} is that of a drive that writes a share or per cent of its rated voltage: if this one does, what it tells of \
                 inertia and friction is in other units"
            ));
        }
    }
    Ok(())
}

/// A sampled motion is smooth: each sample lies near the cubic through its four neighbours. One that is
/// sampled too slowly is not, however it is looked at; one with noise is, once the noise is averaged.
fn aliasing(record: &Record, set: &Settings) -> Result<(), Unknown> {
    let mut least = f64::INFINITY;
    for level in 0..6 {
        let factor = 1_usize << level;
        let (mut misses, mut steps, mut count) = (0.0_f64, 0.0_f64, 0.0);
        for stretch in &record.even.stretches {
            let averaged = stretch.columns[POSITION]
                .chunks_exact(factor)
                .map(|c| c.iter().sum::<f64>() / factor as f64);
            let mut w = [0.0; 5];
            for (k, next) in averaged.enumerate() {
                w.rotate_left(1);
                w[4] = next;
                if k >= 4 {
                    let prediction = (4.0 * (w[1] + w[3]) - (w[0] + w[4])) / 6.0;
                    misses += (w[2] - prediction).powi(2);
                    steps += (0.5 * (w[3] - w[1])).powi(2);
                    count += 1.0;
                }
            }
        }
        if count < 50.0 {
            break;
        }
        let ratio = (misses / count).sqrt() / (steps / count).sqrt().max(f64::MIN_POSITIVE);
        least = least.min(ratio);
    }
    if least > ROUGH {
        return Err(Unknown::all(format!(
            "its position jumps from sample to sample (it misses the curve through its neighbours by {:.0} % \
             of a sample's way): aliased, or noise",
            100.0 * least
        )));
    }
    voltage_aliasing(record, set)
}

/// Most of the voltage's rate lies well below the Nyquist frequency of a record that was sampled fast
/// enough: what lies above the half of it cannot have been resolved.
fn voltage_aliasing(record: &Record, set: &Settings) -> Result<(), Unknown> {
    const TOO_HIGH: f64 = 0.3;
    let filter = Lowpass::butterworth(4, 0.5);
    let (mut high, mut all) = (0.0, 0.0);
    for stretch in &record.even.stretches {
        let u = &stretch.columns[VOLTAGE];
        if u.len() < super::LEAST + set.skip {
            continue;
        }
        for (raw, low) in u.iter().zip(filter.both_ways(u)) {
            high += (raw - low).powi(2);
            all += raw * raw;
        }
    }
    let share = high / f64::max(all, f64::MIN_POSITIVE);
    if share > TOO_HIGH {
        return Err(Unknown::all(format!(
            "{:.0} % of the voltage's power lies above half of the Nyquist frequency: aliased, or noise",
            100.0 * share
        )));
    }
    Ok(())
}

/// What was filtered off with the noise must not be what drove the axis.
pub(super) fn bandwidth(
    record: &Record,
    columns: &Equations,
    set: &Settings,
) -> Result<(), Unknown> {
    let whole = record.even.stretches.iter();
    let whole = whole.flat_map(|s| s.columns[VOLTAGE].iter().map(|u| set.force_per_volt * u));
    // Decimation's own gain is in the column of ones.
    let (left, all) = (
        rms(columns.force.iter().copied()) / rms(columns.one.iter().copied()),
        rms(whole),
    );
    let lost = 1.0 - (left / all).powi(2);
    if lost > LOST {
        let period = record.even.period;
        return Err(Unknown::all(format!(
            "{:.0} % of the force's power lies above {:.3} Hz, which is all that its filter leaves: sampled too \
             slowly (aliased), or --cutoff is too low",
            100.0 * lost,
            0.4 / (period * set.factor(period) as f64)
        )));
    }
    Ok(())
}

/// Friction holds: one that drives is none.
pub(super) fn driving(first: &super::Variant, columns: &Equations) -> Result<(), Unknown> {
    let force = rms(columns.force.iter().copied());
    let x = columns.matrix(Friction::Symmetric, Method::LeastSquares);
    for (j, parameter) in first.parameters.iter().enumerate().take(x.ncols()) {
        let Some(known) = parameter.known.filter(|_| parameter.name != "offset") else {
            continue;
        };
        let worth = known.value * rms(x.column(j).iter().copied()) / force;
        if worth < -0.01 && known.value < -4.0 * known.std_correlated {
            return Err(Unknown::all(format!(
                "the {} that fits it best is negative, {:.3e}: it would drive the axis; aliased, or columns or \
                 signs are wrong",
                parameter.name.replace('_', " "),
                known.value
            )));
        }
    }
    Ok(())
}

/// What the motion does not excite; notes in the columns if it goes one way only.
pub(super) fn excitation(
    columns: &mut Equations,
    moved: &Moved,
    set: &Settings,
) -> Result<Vec<Unknown>, Unknown> {
    let speeds: Vec<f64> = columns.velocity.iter().map(|v| v.abs()).collect();
    let noise = noise(moved, set);
    let moving = (0.05 * quantile(&speeds, 0.99)).max(3.0 * noise.velocity);
    if quantile(&speeds, 0.99) <= 5.0 * noise.velocity {
        return Err(Unknown::all("the axis does not move beyond its noise"));
    }
    let n = speeds.len() as f64;
    let share =
        |f: &dyn Fn(f64) -> bool| columns.velocity.iter().filter(|v| f(**v)).count() as f64 / n;
    let mut unknown = Vec::new();
    let (forward, backward) = (share(&|v| v > moving), share(&|v| v < -moving));
    let one_way = forward < ONE_WAY || backward < ONE_WAY;
    columns.one_way = one_way;
    if one_way {
        let way = if forward < ONE_WAY {
            "backward"
        } else {
            "forward"
        };
        unknown.push(Unknown {
            parameters: [
                &Friction::Symmetric.names()[2..],
                &Friction::Asymmetric.names()[1..],
            ]
            .concat(),
            because: format!(
                "it moves {way} only: without a reversal Coulomb friction and an offset are one force"
            ),
        });
    }
    let power = rms(columns.acceleration.iter().copied());
    if power * power < ABOVE_NOISE * noise.acceleration * noise.acceleration {
        unknown.push(Unknown {
            parameters: vec!["inertia"],
            because: format!(
                "its acceleration, {power:.3e} rms, does not rise well above the noise of the position, \
                 worth {:.3e}: it moves at constant speed, or the cutoff is too high",
                noise.acceleration
            ),
        });
    }
    steady_speed(columns, moving, one_way, &mut unknown);
    Ok(unknown)
}

/// Viscous friction is told from Coulomb friction by how force changes with speed.
fn steady_speed(columns: &Equations, moving: f64, one_way: bool, unknown: &mut Vec<Unknown>) {
    let slides: Vec<usize> = (0..columns.velocity.len())
        .filter(|k| columns.velocity[*k].abs() > moving)
        .collect();
    let of = |f: &dyn Fn(usize) -> f64| slides.iter().map(|k| f(*k)).collect::<Vec<_>>();
    let v = of(&|k| columns.velocity[k]);
    let s = of(&|k| columns.velocity[k].signum());
    let one = of(&|_| 1.0);
    let acceleration = of(&|k| columns.acceleration[k]);
    let x = if one_way {
        pigtail_numerics::regression::matrix(&[&v, &one, &acceleration])
    } else {
        pigtail_numerics::regression::matrix(&[&v, &s, &one, &acceleration])
    };
    let own = tolerance(&x, 0);
    if own < OWN {
        unknown.push(Unknown {
            parameters: vec![
                "viscous_friction",
                "coulomb_friction",
                "viscous_friction_forward",
                "coulomb_friction_forward",
                "viscous_friction_backward",
                "coulomb_friction_backward",
            ],
            because: format!(
                "its speed hardly changes while it moves ({:.1} % of it is not of the direction alone): at one \
                 speed viscous and Coulomb friction are one force",
                100.0 * own.sqrt()
            ),
        });
    }
}

/// Noise of velocity and acceleration after filter and decimation, from what the filter takes off the
/// position, taken as white.
struct Noise {
    velocity: f64,
    acceleration: f64,
}

/// Standard deviation of the position's noise, taken as white.
pub(super) fn white(record: &Record, set: &Settings) -> f64 {
    let cutoff = 2.0 * record.even.period * set.cutoff(record.even.period);
    // What lies in the upper half of the band is noise and nothing else.
    let high = Lowpass::butterworth(4, cutoff.max(0.5));
    let mut taken = Vec::new();
    for stretch in &record.even.stretches {
        let q = &stretch.columns[POSITION];
        if q.len() > super::LEAST + set.skip {
            let smooth = high.both_ways(q);
            let own = q.iter().zip(smooth).map(|(a, b)| (a - b).abs());
            taken.extend(own.skip(set.skip));
        }
    }
    let mut impulse = vec![0.0; 1024];
    impulse[512] = 1.0;
    let left = high.both_ways(&impulse);
    let share: f64 = impulse.iter().zip(left).map(|(a, b)| (a - b).powi(2)).sum();
    // The median, for a reversal is no noise.
    let [usual] = quantiles(taken, [0.5]);
    1.4826 * usual / share.max(0.05).sqrt()
}

/// Share of the acceleration's power that is the position's noise.
pub(super) fn noise_share(record: &Record, moved: &Moved, set: &Settings) -> f64 {
    let columns = moved.equations(record, set);
    let power = rms(columns.acceleration.iter().copied());
    (noise(moved, set).acceleration / power.max(f64::MIN_POSITIVE)).powi(2)
}

/// Standard deviation of the acceleration that is the position's noise.
pub(super) fn acceleration_noise(moved: &Moved, set: &Settings) -> f64 {
    noise(moved, set).acceleration
}

fn noise(moved: &Moved, set: &Settings) -> Noise {
    const LENGTH: usize = 1024;
    let Moved { white, period, .. } = *moved;
    let filter = Lowpass::butterworth(set.order, 2.0 * period * set.cutoff(period));
    let mut impulse = vec![0.0; LENGTH];
    impulse[LENGTH / 2] = 1.0;
    let velocity = super::rate(&filter.both_ways(&impulse), period);
    let acceleration = super::rate(&velocity, period);
    let factor = set.factor(period);
    let gain = |answer: &[f64]| {
        // Decimation filters once more; by how much, an answer filtered at the full rate tells.
        let low = if factor > 1 {
            Lowpass::chebyshev(8, 0.05, 0.8 / factor as f64).both_ways(answer)
        } else {
            answer.to_vec()
        };
        low.iter().map(|v| v * v).sum::<f64>().sqrt()
    };
    debug_assert!(decimate(&impulse, factor).len() <= LENGTH);
    Noise {
        velocity: white * gain(&velocity),
        acceleration: white * gain(&acceleration),
    }
}

/// Voltage and position are of one moment, nearly; a remark where the record shows how far apart they are.
pub(super) fn together(
    variants: &[super::Variant],
    period: f64,
    remarks: &mut Vec<String>,
) -> Result<(), Unknown> {
    let of = |method: Method| {
        let mine = |v: &&super::Variant| v.method == method && v.friction == Friction::Symmetric;
        variants.iter().find(mine)
    };
    let (Some(ordinary), Some(delayed)) = (of(Method::LeastSquares), of(Method::Delayed)) else {
        return Ok(());
    };
    let found = delayed.parameters.last().and_then(|p| p.known);
    let better = super::LATE * ordinary.relative_error_percent;
    let Some(found) =
        found.filter(|k| k.value.abs() > 5.0 * k.std && delayed.relative_error_percent < better)
    else {
        return Ok(());
    };
    let samples = found.value / period;
    if samples.abs() > super::LATEST {
        return Err(Unknown::all(format!(
            "its voltage and its position are not of the same moments: with the voltage {:.0} samples {} it is told \
             better",
            samples.abs(),
            if samples > 0.0 { "later" } else { "earlier" }
        )));
    }
    if samples.abs() > 1.5 {
        remarks.push(format!(
            "the voltage acts {:.2e} s ({samples:.1} samples) after its sample: what is found without a delay is \
             less sure by it, --method delayed takes it into account",
            found.value
        ));
    }
    Ok(())
}

/// Where few samples decide, ordinary and robust fits come apart: an inertia is then not known, and the rest is less
/// sure by it.
pub(super) fn robustly(variants: &mut [super::Variant], unknown: &mut Vec<Unknown>) {
    for friction in [Friction::Symmetric, Friction::Asymmetric] {
        let values = |method: Method| {
            let found = variants
                .iter()
                .find(|v| v.friction == friction && v.method == method);
            found.map(|v| v.values.clone())
        };
        let (Some(ordinary), Some(weighted)) =
            (values(Method::LeastSquares), values(Method::Weighted))
        else {
            continue;
        };
        // Where an axis slides no sample decides alone, and a delay moves both fits that know none.
        let mine = |v: &&mut super::Variant| v.friction == friction && v.method != Method::Delayed;
        for variant in variants.iter_mut().filter(mine) {
            let off = ordinary.iter().zip(&weighted);
            for (parameter, (a, b)) in variant.parameters.iter_mut().zip(off) {
                if let Some(known) = &mut parameter.known {
                    known.std_correlated = known.std_correlated.max(0.5 * (a - b).abs());
                }
            }
        }
        let (a, b) = (ordinary[0], weighted[0]);
        if (a - b).abs() > DISAGREE * a.abs() && !unknown.iter().any(|u| u.covers("inertia")) {
            unknown.push(Unknown {
                parameters: vec!["inertia"],
                because: format!(
                    "few samples decide on it: all of them give {a:.4e}, those that agree with each other {b:.4e}"
                ),
            });
        }
    }
}

/// Parameters whose uncertainty is worth as much as a good part of the force.
pub(super) fn uncertain(first: &super::Variant, columns: &Equations, unknown: &mut Vec<Unknown>) {
    let force = rms(columns.force.iter().copied());
    let x = columns.matrix(Friction::Symmetric, Method::LeastSquares);
    let Some(solution) = least_squares(&x, &columns.force) else {
        return;
    };
    for (j, parameter) in first.parameters.iter().enumerate().take(x.ncols()) {
        let size = rms(x.column(j).iter().copied());
        let worth = solution.std_correlated[j] * size / force;
        // An inertia is never zero: one that might be is not known.
        let nothing = j == 0 && solution.std_correlated[j] > 0.3 * solution.values[j].abs();
        if (worth > UNSURE || nothing) && !unknown.iter().any(|u| u.covers(parameter.name)) {
            unknown.push(Unknown {
                parameters: vec![parameter.name],
                because: format!(
                    "what it says of {} is {:.3e} with a standard deviation of {:.3e}",
                    parameter.name, solution.values[j], solution.std_correlated[j]
                ),
            });
        }
    }
}
