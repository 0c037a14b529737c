//! A displacement without its noise, where its motion is smooth.
//!
//! A contact turns where its displacement is farthest, and of samples with noise the farthest is the one that noise has moved out:
//! by more than the noise's deviation, where many samples lie near a turn.

use super::{Record, Sample, turned};
use pigtail_numerics::signal::rms;

/// Samples on either side that parabolas are tried through, each twice as many as the one before.
const REACHES: [usize; 5] = [2, 4, 8, 16, 32];

/// Fewest turns by which a parabola's bias is told, and deviations of their mean by which it is seen.
const TURNS: usize = 6;
const SEEN: f64 = 2.0;

/// Displacement, velocity and acceleration by a parabola through so many samples on either side; none where a stretch ends.
pub(super) fn parabola(samples: &[Sample], k: usize, reach: usize) -> Option<[f64; 3]> {
    let near = samples.get(k.checked_sub(reach)?..=k + reach)?;
    if near[1..].iter().any(|s| s.begins) {
        return None;
    }
    let (own, span) = (samples[k], near[near.len() - 1].time - near[0].time);
    // Sums of powers of the time, and of what the displacement has beyond this sample's.
    let (mut powers, mut sums) = ([0.0; 5], [0.0; 3]);
    for s in near {
        let (t, x) = (
            (s.time - own.time) / span,
            s.displacement - own.displacement,
        );
        let mut power = 1.0;
        for (j, sum) in powers.iter_mut().enumerate() {
            *sum += power;
            if let Some(sum) = sums.get_mut(j) {
                *sum += power * x;
            }
            power *= t;
        }
    }
    let normal = nalgebra::Matrix3::from_fn(|i, j| powers[i + j]);
    let found = normal.cholesky()?.solve(&nalgebra::Vector3::from(sums));
    Some([
        own.displacement + found[0],
        found[1] / span,
        2.0 * found[2] / (span * span),
    ])
}

/// The widest of [`REACHES`] whose parabolas are not seen to cut the turns off, in deviations of the mean over all turns of what
/// the samples there lie farther out.
fn widest(record: &Record) -> Option<usize> {
    let samples = &record.samples;
    let (low, high) = record.range(|s| s.displacement);
    let seen = turned(samples, high - low);
    if seen.len() < TURNS {
        return None;
    }
    let fits = |reach: &usize| {
        let reach = *reach;
        let beyond: Vec<f64> = seen
            .windows(2)
            .filter(|w| w[1] - w[0] > 4 * reach)
            .filter_map(|w| {
                // Which way it went before it was seen to have turned, and where it was farthest.
                let way = (samples[w[1] - 1].displacement - samples[w[1]].displacement).signum();
                let smooth = |k: usize| parabola(samples, k, reach).map(|p| way * p[0]);
                let farthest = (w[0]..w[1])
                    .filter_map(|k| Some((k, smooth(k)?)))
                    .max_by(|a, b| a.1.total_cmp(&b.1))?
                    .0;
                let near = reach / 4;
                let off = (farthest.checked_sub(near)?..=farthest + near)
                    .map(|k| Some(way * samples.get(k)?.displacement - smooth(k)?));
                let off: Option<Vec<f64>> = off.collect();
                off.map(|off| off.iter().sum::<f64>() / off.len() as f64)
            })
            .collect();
        let n = beyond.len();
        let mean = beyond.iter().sum::<f64>() / n.max(1) as f64;
        let scatter = rms(beyond.iter().map(|b| b - mean));
        n >= TURNS && mean.abs() < SEEN * scatter / ((n - 1) as f64).sqrt()
    };
    REACHES.into_iter().take_while(fits).last()
}

/// Takes each displacement from a parabola through its neighbours, where turns are as smooth as that; through how many on either side.
pub(super) fn smoothed(record: &mut Record) -> Option<usize> {
    let reach = widest(record)?;
    let samples = &record.samples;
    let displacement: Vec<f64> = (0..samples.len())
        .map(|k| {
            // Fewer where a stretch begins or ends.
            let fitted = (2..=reach)
                .rev()
                .find_map(|reach| parabola(samples, k, reach));
            fitted.map_or(samples[k].displacement, |p| p[0])
        })
        .collect();
    for (s, displacement) in record.samples.iter_mut().zip(displacement) {
        s.displacement = displacement;
    }
    Some(reach)
}
