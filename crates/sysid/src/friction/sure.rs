//! How surely the parameters of a law are known.

use super::fit::{counted, settled};
use super::skew::shifted;
use super::tremble::noise;
use super::{Fitted, Known, Law, Record, Sample, fit, turned};
use crate::steady::chi_squared;
use pigtail_numerics::nonlinear::{minimise, uncertainty};
use pigtail_numerics::signal::independent;

/// Samples whose displacement is read `by` seconds before, by its rate.
fn displaced(samples: &[Sample], by: f64) -> Vec<Sample> {
    let n = samples.len();
    let rate = |k: usize| {
        let from = if samples[k].begins || k == 0 {
            k
        } else {
            k - 1
        };
        let to = if k + 1 == n || samples[k + 1].begins {
            k
        } else {
            k + 1
        };
        let time = samples[to].time - samples[from].time;
        let way = samples[to].displacement - samples[from].displacement;
        if time > 0.0 { way / time } else { 0.0 }
    };
    (0..n)
        .map(|k| Sample {
            displacement: samples[k].displacement - by * rate(k),
            ..samples[k]
        })
        .collect()
}

/// Parameters beside a skew between force and displacement, which is told with them: what nobody knows of the moments moves where a
/// contact seems to turn. None where there is no time, or none is found.
pub(super) fn with_skew(
    law: Law,
    record: &Record,
    samples: &[Sample],
    near: &[f64],
) -> Option<Vec<f64>> {
    /// A skew that is left is one that reading at neighbouring samples tells, samples; and most times that it is taken out first.
    const NEAR: f64 = 0.5;
    const TIMES: usize = 4;
    if !record.has_time {
        return None;
    }
    let period = record.period();
    let (mut samples, mut values) = (samples.to_vec(), near.to_vec());
    for _ in 0..TIMES {
        let (found, by) = joint(law, record, &samples, &values)?;
        values = found;
        if by.abs() < NEAR {
            return Some(values);
        }
        samples = shifted(&samples, by.clamp(-4.0, 4.0) * period);
    }
    None
}

/// Parameters with a small skew, by how many samples the force is later than its row's displacement.
pub(super) fn joint(
    law: Law,
    record: &Record,
    samples: &[Sample],
    near: &[f64],
) -> Option<(Vec<f64>, f64)> {
    let found = beside(law, record, samples, near, Other::Nothing)?;
    Some((found.values, found.skew))
}

/// What a record may have in it beside a law and a skew, of a size that is told with them.
#[derive(Clone, Copy)]
pub(super) enum Other<'a> {
    Nothing,
    /// In the displacement, m or rad.
    Way(&'a [f64]),
    /// In the force, over the largest one.
    Force(&'a [f64]),
}

/// Parameters that were told together with what nobody knows of the record.
pub(super) struct Beside {
    pub(super) values: Vec<f64>,
    /// By how many samples the force is later than its row's displacement.
    pub(super) skew: f64,
    /// What is left of the force, over the largest one.
    pub(super) left: Vec<f64>,
}

/// Parameters with a small skew and with as much of `other` as tells the force best.
pub(super) fn beside(
    law: Law,
    record: &Record,
    samples: &[Sample],
    near: &[f64],
    other: Other<'_>,
) -> Option<Beside> {
    let force = record.largest_force();
    let period = record.period();
    let counts = settled(law, near, samples);
    let own = near.len();
    let scaled = |c: &[f64]| -> Vec<f64> {
        let (coded, more) = c.split_at(own);
        if coded.iter().any(|c| c.abs() > 60.0) {
            return vec![f64::NAN; samples.len()];
        }
        let mut moved = displaced(samples, more[0] * period);
        let share = more.get(1).copied().unwrap_or(0.0);
        match other {
            Other::Nothing => {}
            Other::Way(way) => {
                for (s, way) in moved.iter_mut().zip(way) {
                    s.displacement += share * way;
                }
            }
            Other::Force(part) => {
                for (s, part) in moved.iter_mut().zip(part) {
                    s.force -= share * force * part;
                }
            }
        }
        let left = counted(law, &law.decoded(coded, force), &moved, &counts);
        left.into_iter().map(|l| l / force).collect()
    };
    let mut start = law.coded(near, force);
    let more = if matches!(other, Other::Nothing) {
        1
    } else {
        2
    };
    start.resize(own + more, 0.0);
    let (found, _) = minimise(scaled, &start)?;
    Some(Beside {
        values: law.decoded(&found[..own], force),
        skew: found[own],
        left: scaled(&found),
    })
}

/// Makes a law less sure by what the one of some others that tells most of the force makes of its parameters, where chance would make it tell so
/// much once in ten thousand times.
pub(super) fn by_other(fitted: &mut Fitted, record: &Record, others: &[Other<'_>]) {
    let with = |other| beside(fitted.law, record, &record.samples, &fitted.values, other);
    let Some(plain) = with(Other::Nothing) else {
        return;
    };
    let squares = |left: &[f64]| left.iter().map(|l| l * l).sum::<f64>();
    let gained = |found: &Beside| {
        let gain = (squares(&plain.left) / squares(&found.left)).ln();
        independent(&found.left) * gain
    };
    let best = others
        .iter()
        .filter_map(|other| with(*other))
        .map(|found| (gained(&found), found))
        .filter(|(gain, _)| *gain > chi_squared(1.0))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((_, found)) = best {
        for ((known, a), b) in fitted
            .known
            .iter_mut()
            .zip(&plain.values)
            .zip(&found.values)
        {
            known.std_correlated = known.std_correlated.hypot(b - a);
        }
    }
}

/// Middle and deviation of what is anywhere from none to one.
const OUTWARD: f64 = 0.5;
const SPREAD: f64 = 0.288_675;

/// Noise of the displacement moves the places where a contact turns. By how much parameters move where there is as much of it again
/// in amplitude tells how far they were moved already (simulation and extrapolation, Cook and Stefanski 1994): by all of it where
/// that goes with the amplitude, as where many samples lie near a turn, by a third where it goes with the power, by hardly any of it
/// where noise matters only once it is as large as a step, as in Dahl's law. By the middle they are corrected, and by the spread
/// they are less sure.
pub(super) fn widen(law: Law, record: &Record, known: &mut [Known]) {
    let noise = noise(&record.samples);
    let values: Vec<f64> = known.iter().map(|k| k.value).collect();
    if noise.is_nan() || noise <= 0.0 {
        return;
    }
    let moved = |sign: f64| {
        let mut noisier = record.samples.clone();
        for (k, s) in noisier.iter_mut().enumerate() {
            s.displacement += sign * 3f64.sqrt() * noise * scattered(k);
        }
        if record.has_time {
            with_skew(law, record, &noisier, &values)
        } else {
            fit(law, record, &noisier, Some(&values))
        }
    };
    // What one noise moves by chance its opposite moves back.
    let (Some(one), Some(other)) = (moved(1.0), moved(-1.0)) else {
        return;
    };
    let moved = one.iter().zip(&other).map(|(a, b)| 0.5 * (a + b));
    for ((known, moved), name) in known.iter_mut().zip(moved).zip(law.parameters()) {
        // What turns outward does so on both sides alike: of an offset this would only be chance.
        if *name == "offset" {
            continue;
        }
        let more = moved - known.value;
        known.value -= OUTWARD * more;
        known.std_correlated = known.std_correlated.hypot(SPREAD * more);
    }
}

/// A number of mean zero and deviation one, the same at every run: the sum of twelve even ones.
fn scattered(k: usize) -> f64 {
    (0..12)
        .map(|part| {
            let mut bits = (12 * k as u64 + part).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        })
        .sum::<f64>()
        - 6.0
}

/// Values with their standard deviations, and the condition of the linear problem.
pub(super) fn sure(law: Law, record: &Record, parameters: &[f64]) -> Option<(Vec<Known>, f64)> {
    let force = record.largest_force();
    let coded = law.coded(parameters, force);
    // A skew is known no better than the record tells it.
    let period = record.period();
    let counts = settled(law, parameters, &record.samples);
    let left = |c: &[f64]| {
        let decoded = law.decoded(&c[..parameters.len()], force);
        match c.get(parameters.len()) {
            Some(by) => counted(
                law,
                &decoded,
                &displaced(&record.samples, by * period),
                &counts,
            ),
            None => counted(law, &decoded, &record.samples, &counts),
        }
    };
    let coded = if record.has_time {
        [coded, vec![0.0]].concat()
    } else {
        coded
    };
    // What changes nothing, such as the speed of a Stribeck effect that is none, is not known, and the rest may be.
    let base = left(&coded);
    let matters: Vec<usize> = (0..coded.len())
        .filter(|j| {
            let mut moved = coded.clone();
            moved[*j] += 1e-3;
            let change = left(&moved)
                .iter()
                .zip(&base)
                .map(|(a, b)| (a - b).powi(2))
                .sum::<f64>();
            change > 1e-18 * force * force
        })
        .collect();
    if matters.is_empty() {
        return None;
    }
    let own: Vec<f64> = matters.iter().map(|j| coded[*j]).collect();
    let among = |c: &[f64]| {
        let mut all = coded.clone();
        for (j, value) in matters.iter().zip(c) {
            all[*j] = *value;
        }
        left(&all)
    };
    // What noise makes of a turn lies in all of the way to the next one.
    let (low, high) = record.range(|s| s.displacement);
    let turns = turned(&record.samples, high - low).len();
    let coherent = record.samples.len() / turns.max(1);
    let mut solution = uncertainty(among, &own, coherent)?;
    for stds in [&mut solution.std, &mut solution.std_correlated] {
        let mut wide = vec![f64::INFINITY; coded.len()];
        for (j, std) in matters.iter().zip(stds.iter()) {
            wide[*j] = *std;
        }
        *stds = wide;
    }
    let known = (0..parameters.len())
        .map(|j| {
            // What a step of the coded number is worth.
            let mut moved = coded.clone();
            moved[j] += 1e-6;
            let slope = (law.decoded(&moved, force)[j] - parameters[j]).abs() / 1e-6;
            Known {
                value: parameters[j],
                std: slope * solution.std[j],
                std_correlated: slope * solution.std_correlated[j],
            }
        })
        .collect();
    // A skew counts in another unit than the coded parameters, which are of order one.
    let bare = |c: &[f64]| {
        let mut all = own.clone();
        all[..c.len()].copy_from_slice(c);
        among(&all)
    };
    let count = matters.iter().filter(|j| **j < parameters.len()).count();
    let condition = uncertainty(bare, &own[..count], coherent)?.condition;
    Some((known, condition))
}
