//! By how much force and displacement of one row are of different moments.
//!
//! A contact turns where its motion turns. A force that turns before or after it, and by the same time whatever the
//! speed, was taken at another moment.

use super::elements::elements;
use super::sure::joint;
use super::{Law, Record, Sample, error, fit, turned};
use pigtail_numerics::golden::least;
use pigtail_numerics::regression::relative;
use pigtail_numerics::signal::{quantile, rms};

/// Samples that are enough to see a skew by.
const ENOUGH: usize = 4000;

/// A skew is believed where it leaves less than this share of the error.
const LATE: f64 = 0.93;

/// Share of the stroke after which the shortest of the elements slips by which it is seen: any contact that gives way by displacement
/// alone, so that a law's own misfit is taken for no skew.
const SHORTEST: f64 = 1.0 / 300.0;

/// Longest skew that is looked for, as a share of the usual time from one reversal to the next.
const LONGEST: f64 = 0.25;

/// A skew that a record shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Skew {
    /// By how much later than its row's displacement the force is, seconds.
    Of(f64),
    /// More than can be told from a motion of another kind: at least so long.
    Beyond(f64),
}

/// Samples whose displacement is read `by` seconds before their force, so far as the record has one.
pub(super) fn shifted(samples: &[Sample], by: f64) -> Vec<Sample> {
    let mut moved = Vec::with_capacity(samples.len());
    for stretch in samples.chunk_by(|_, next| !next.begins) {
        let mut at = 0;
        let mut begins = true;
        for s in stretch {
            let time = s.time - by;
            while at + 2 < stretch.len() && stretch[at + 1].time < time {
                at += 1;
            }
            let Some([a, b, ..]) = stretch.get(at..) else {
                continue;
            };
            if time < a.time || time > b.time || b.time <= a.time {
                continue;
            }
            let f = (time - a.time) / (b.time - a.time);
            moved.push(Sample {
                displacement: a.displacement + f * (b.displacement - a.displacement),
                begins,
                ..*s
            });
            begins = false;
        }
    }
    moved
}

/// The skew that a record shows; none where it shows none.
pub(super) fn skew(record: &Record) -> Option<Skew> {
    let samples = &record.samples[..record.samples.len().min(ENOUGH)];
    let steps: Vec<f64> = samples
        .windows(2)
        .filter(|w| !w[1].begins)
        .map(|w| w[1].time - w[0].time)
        .collect();
    let period = quantile(&steps, 0.5);
    let (low, high) = record.range(|s| s.displacement);
    let turns = turned(samples, high - low);
    let between: Vec<f64> = turns
        .windows(2)
        .map(|w| samples[w[1]].time - samples[w[0]].time)
        .collect();
    if between.is_empty() || period.is_nan() || period <= 0.0 {
        return None;
    }
    let longest = LONGEST * quantile(&between, 0.5);
    let left = |by: f64| {
        let part = Record {
            samples: shifted(samples, by),
            ..record.clone()
        };
        elements(&part, SHORTEST, false).map_or(f64::INFINITY, |e| rms(e.left))
    };
    // Twice as far each time, both ways.
    let mut places = vec![0.0];
    let mut by = 0.5 * period;
    while by < longest {
        places.extend([by, -by]);
        by *= 2.0;
    }
    places.extend([longest, -longest]);
    places.sort_by(f64::total_cmp);
    let errors: Vec<f64> = places.iter().map(|by| left(*by)).collect();
    let best = (0..places.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b]))?;
    if errors[best] > LATE * left(0.0) {
        return None;
    }
    if best == 0 || best + 1 == places.len() {
        return Some(Skew::Beyond(longest));
    }
    let around = (places[best - 1], places[best + 1]);
    let found = least(around, 0.02 * period, left);
    // What a sample is a mean over may be anywhere within it.
    let within = 0.5 * period;
    if found.abs() < 0.5 * within {
        return None;
    }
    settled(record, samples, found)
        .filter(|by| by.abs() > within)
        .map(Skew::Of)
}

/// What elements leave of a force, what the best law leaves of it, with its values, and the samples.
type Told = (f64, Option<(f64, Law, Vec<f64>)>, Record);

fn least_of((own, best, _): &Told) -> f64 {
    best.as_ref().map_or(*own, |(error, ..)| own.min(*error))
}

/// The skew as what tells the force best has it, near one that elements show. None where nothing tells the force better for it: a law
/// that is no sum of elements, as Dahl's, would take its own misfit for one.
fn settled(record: &Record, samples: &[Sample], by: f64) -> Option<f64> {
    const TIMES: usize = 4;
    let of = |by: f64, near: Option<(Law, &[f64])>| -> Told {
        let samples = shifted(samples, by);
        let part = Record {
            samples,
            ..record.clone()
        };
        let own = elements(&part, SHORTEST, false);
        let force: Vec<f64> = part.samples.iter().map(|s| s.force).collect();
        let own = own.map_or(f64::INFINITY, |e| relative(&e.left, &force));
        let laws = Law::ALL.into_iter().filter(|law| match near {
            Some((own, _)) => *law == own,
            None => !law.needs_time(),
        });
        let best = laws
            .filter_map(|law| {
                let values = fit(law, &part, &part.samples, near.map(|n| n.1))?;
                Some((error(law, &values, &part.samples, 0), law, values))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        (own, best, part)
    };
    let plain = least_of(&of(0.0, None));
    let (mut by, mut told) = (by, of(by, None));
    for _ in 0..TIMES {
        let (own, best, part) = &told;
        let Some((error, law, values)) = best else {
            break;
        };
        // Of no law that is known, elements say it.
        if *error > 1.5 * own {
            break;
        }
        let Some((_, more)) = joint(*law, part, &part.samples, values) else {
            break;
        };
        let more = more.clamp(-2.0, 2.0) * part.period();
        let enough = more.abs() < 0.05 * part.period();
        by += more;
        told = of(by, Some((*law, values)));
        if enough {
            break;
        }
    }
    (least_of(&told) < LATE * plain).then_some(by)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_reads_the_displacement_at_another_moment_and_drops_what_is_not_there() {
        let samples: Vec<Sample> = (0..10)
            .map(|k| Sample {
                time: f64::from(k),
                displacement: 2.0 * f64::from(k),
                force: f64::from(k),
                begins: k == 0 || k == 5,
            })
            .collect();
        let moved = shifted(&samples, 1.5);
        let told: Vec<(f64, f64, bool)> = moved
            .iter()
            .map(|s| (s.force, s.displacement, s.begins))
            .collect();
        let wanted = [
            (2.0, 1.0, true),
            (3.0, 3.0, false),
            (4.0, 5.0, false),
            (7.0, 11.0, true),
            (8.0, 13.0, false),
            (9.0, 15.0, false),
        ];
        assert_eq!(told, wanted);
    }
}
