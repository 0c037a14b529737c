//! What readings around a peak say of it by themselves, whatever its shape.
//!
//! A fit of one shape says where the middle of the light is. That the light is brightest there, falls to all sides,
//! and rises nowhere else as high, the readings have to say.

use super::fold::leaves_noise;
use super::shape::{Datum, Fit, NUMBERS, Shape, fit};
use super::unsteady::Unsteady;
use super::{Refusal, Scan};
use pigtail_model::frames::Displacement;
use pigtail_numerics::regression::{least_squares, matrix};
use std::collections::HashMap;
use std::f64::consts::TAU;

/// Sectors around a peak in which readings have to stand.
const SECTORS: usize = 8;

/// Radii, in the peak's own, between which they count.
const AROUND: (f64, f64) = (0.25, 1.7);

/// The border of a scan is at least so many radii from a peak inside it.
const INSIDE: f64 = 0.35;

/// The brightest place is at most so many short radii from the middle of the light.
const CENTRED: f64 = 0.4;

/// By so large a share of the height it is brighter there, where that is said.
const BRIGHTER: f64 = 0.06;

/// And by so many standard deviations.
const SURE: f64 = 4.0;

/// A second peak that stands so high is one.
const ANOTHER: f64 = 0.5;

/// Largest share of the readings on a peak, above a third of its height, that may stand at a bound; where the rest
/// has not the shape of a peak for certain, and where it has.
const BOUND: [f64; 2] = [0.25, 0.8];

/// A peak's place is known to this share of its short radius at least.
const PLACE: f64 = 0.3;

/// Between two peaks it is darker than the lesser one by this share of the brighter.
const VALLEY: f64 = 0.12;

/// Neighbours that differ by this share of the range more than the shape has them differ are a cliff; so many are one.
const CLIFF: f64 = 0.4;
const CLIFFS: usize = 4;

/// Light is dark below the first share of its range, and bright above the second.
const DARK: f64 = 0.12;
const HALF: f64 = 0.5;

/// So many steps from bright to dark from one reading to the next are a cut, where the peak's long radius is so many steps.
const CUTS: usize = 3;
const RESOLVED: f64 = 1.6;

/// A ring that leaves less than so many times the squares that mirrored light leaves is as good.
const RING: f64 = 1.0;

/// Neighbours that a smoothed reading is the mean of, itself among them.
const NEIGHBOURS: usize = 5;

pub(super) fn check(
    scan: &Scan,
    found: &Fit,
    all: &[(usize, Datum)],
    (noise, own_noise): (f64, f64),
) -> Result<(), Refusal> {
    let shape = &found.shape;
    told(found, found.deviation(noise))?;
    let from = shape.at - scan.middle;
    let (rx, ry) = shape.radii();
    let room = Displacement::new(scan.half.x - from.x.abs(), scan.half.y - from.y.abs());
    let bound = all.iter().filter(|(_, d)| d.at_least).count();
    // Light that is cut off has only its flanks to tell: they have to be there.
    let inside = if bound > 0 { 1.0 } else { INSIDE };
    if room.x < inside * rx || room.y < inside * ry || !is_surrounded(scan, found, all) {
        return Err(Refusal::AtEdge { at: shape.at });
    }
    let on = all.iter().filter(|(_, d)| shape.share(d.at) > 0.33).count();
    let data: Vec<Datum> = all.iter().map(|(_, d)| *d).collect();
    let sure = usize::from(leaves_noise(&data, found, own_noise));
    if bound as f64 > BOUND[sure] * on.max(1) as f64 {
        let share = bound as f64 / on.max(1) as f64;
        return Err(Refusal::Saturated { share });
    }
    brightest(scan, found, all, noise)
}

/// Refuses a peak whose place is not told.
pub(super) fn told(found: &Fit, deviation: f64) -> Result<(), Refusal> {
    let (_, radius, _) = found.shape.ellipse();
    if deviation.is_nan() || deviation > PLACE * radius {
        return Err(Refusal::Vague { deviation, radius });
    }
    Ok(())
}

/// Refuses a peak whose place what changed while it was scanned leaves open.
pub(super) fn sure(found: &Fit, unsteady: &Unsteady) -> Result<(), Refusal> {
    let (_, short, _) = found.shape.ellipse();
    let deviation = unsteady.deviation;
    if deviation > PLACE * short {
        let Unsteady {
            light,
            aside,
            parts,
            ..
        } = *unsteady;
        return Err(Refusal::Unsteady {
            light,
            aside: aside.max(parts),
            deviation,
        });
    }
    Ok(())
}

/// Whether there are readings to all sides of a peak; of one that few see, in all quarters.
fn is_surrounded(scan: &Scan, found: &Fit, all: &[(usize, Datum)]) -> bool {
    let shape = &found.shape;
    let (_, short, _) = shape.ellipse();
    let mut sectors = [false; SECTORS];
    for (_, d) in all {
        // exp(-r^2), r in radii.
        let radii = (-shape.share(d.at).max(1e-300).ln()).sqrt();
        if radii < AROUND.0 || radii > AROUND.1.max(1.5 * scan.spacing() / short) {
            continue;
        }
        let off = d.at - shape.at;
        let turn = off.y.atan2(off.x) / TAU;
        let sector = ((turn - turn.floor()) * SECTORS as f64) as usize;
        sectors[sector.min(SECTORS - 1)] = true;
    }
    let empty = sectors.iter().filter(|s| !**s).count();
    // Two neighbours without a reading are a side that nobody looked at.
    let gap = (0..SECTORS).any(|k| !sectors[k] && !sectors[(k + 1) % SECTORS]);
    empty <= 1 || (!gap && empty <= 4)
}

/// Readings with the mean of each and its nearest neighbours.
struct Smooth {
    at: Vec<Displacement>,
    value: Vec<f64>,
    cells: HashMap<(i64, i64), Vec<usize>>,
    size: f64,
}

impl Smooth {
    fn new(readings: &[(Displacement, f64)], spacing: f64) -> Self {
        let size = 1.6 * spacing;
        let mut cells: HashMap<(i64, i64), Vec<usize>> = HashMap::new();
        for (k, (at, _)) in readings.iter().enumerate() {
            cells.entry(Self::cell(*at, size)).or_default().push(k);
        }
        let mut smooth = Self {
            at: readings.iter().map(|r| r.0).collect(),
            value: Vec::new(),
            cells,
            size,
        };
        smooth.value = (0..readings.len())
            .map(|k| {
                let mut near: Vec<(f64, usize)> = smooth
                    .near(smooth.at[k])
                    .map(|i| ((smooth.at[i] - smooth.at[k]).norm(), i))
                    .collect();
                near.sort_by(|a, b| a.0.total_cmp(&b.0));
                near.truncate(NEIGHBOURS);
                near.iter().map(|(_, i)| readings[*i].1).sum::<f64>() / near.len() as f64
            })
            .collect();
        smooth
    }

    fn cell(at: Displacement, size: f64) -> (i64, i64) {
        ((at.x / size).floor() as i64, (at.y / size).floor() as i64)
    }

    /// Readings in the cells about a place.
    fn near(&self, at: Displacement) -> impl Iterator<Item = usize> {
        let (i, j) = Self::cell(at, self.size);
        (-1..=1)
            .flat_map(move |di| (-1..=1).map(move |dj| (i + di, j + dj)))
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .copied()
    }

    fn nearest(&self, place: Displacement) -> Option<usize> {
        let away = |k: &usize| (self.at[*k] - place).norm();
        self.near(place).min_by(|a, b| away(a).total_cmp(&away(b)))
    }
}

/// The light is brightest in its middle, and nowhere else nearly as bright with a valley between.
fn brightest(scan: &Scan, found: &Fit, all: &[(usize, Datum)], noise: f64) -> Result<(), Refusal> {
    let shape = &found.shape;
    let (_, short, _) = shape.ellipse();
    let light = |d: &Datum| d.sign * (d.power - d.share * found.level) - shape.background(d.at);
    let readings: Vec<(Displacement, f64)> = all.iter().map(|(_, d)| (d.at, light(d))).collect();
    if readings.len() < 3 * NEIGHBOURS {
        return Ok(());
    }
    cliffs(scan, &readings, shape)?;
    if all.iter().any(|(_, d)| d.at_least) {
        return Ok(());
    }
    let smooth = Smooth::new(&readings, scan.spacing());
    cut(scan, &readings, &smooth, shape)?;
    let by = |a: &usize, b: &usize| smooth.value[*a].total_cmp(&smooth.value[*b]);
    let all = 0..smooth.at.len();
    let (Some(top), Some(centre)) = (all.clone().max_by(by), smooth.nearest(shape.at)) else {
        return Ok(());
    };
    let (at, most, middle) = (smooth.at[top], smooth.value[top], smooth.value[centre]);
    let away = (at - shape.at).norm();
    let more = most - middle;
    // The noise of a difference of means.
    let sigma = noise * (2.0 / NEIGHBOURS as f64).sqrt();
    if away > CENTRED * short + scan.spacing()
        && more > SURE * sigma
        && more > BRIGHTER * shape.height
    {
        return Err(Refusal::OffCentre {
            middle: shape.at,
            brightest: at,
            share: middle / most,
        });
    }
    // Another top, and how deep it is between.
    let valley = (VALLEY * most).max(1.5 * SURE * sigma);
    let tops = all.filter(|k| {
        let value = smooth.value[*k];
        value > ANOTHER * most
            && (smooth.at[*k] - at).norm() > 2.0 * scan.spacing()
            && smooth.near(smooth.at[*k]).all(|i| smooth.value[i] <= value)
    });
    for k in tops {
        let way = smooth.at[k] - at;
        let steps = (2.0 * way.norm() / scan.spacing()).ceil().clamp(3.0, 400.0) as usize;
        let between = (1..steps).filter_map(|i| {
            let place = at + way * (i as f64 / steps as f64);
            smooth.nearest(place).map(|i| smooth.value[i])
        });
        let lowest = between.fold(f64::INFINITY, f64::min);
        if smooth.value[k] - lowest > valley {
            return Err(Refusal::Several {
                other: smooth.at[k],
                share: smooth.value[k] / most,
            });
        }
    }
    Ok(())
}

/// Light that jumps between neighbours was folded in a way that was not found.
fn cliffs(scan: &Scan, readings: &[(Displacement, f64)], shape: &Shape) -> Result<(), Refusal> {
    let left = |k: usize| {
        let (at, value) = readings[k];
        value - shape.height * shape.share(at)
    };
    let range = readings.iter().fold(f64::NEG_INFINITY, |m, r| m.max(r.1))
        - readings.iter().fold(f64::INFINITY, |m, r| m.min(r.1));
    let mut jumps = 0;
    for k in 1..readings.len() {
        // Neighbours in the order of the scan stand for all.
        let near = (readings[k].0 - readings[k - 1].0).norm() < 1.5 * scan.spacing();
        jumps += usize::from(near && (left(k) - left(k - 1)).abs() > CLIFF * range);
    }
    if jumps >= CLIFFS {
        let squares: f64 = (0..readings.len()).map(|k| left(k).powi(2)).sum();
        let all: f64 = readings.iter().map(|r| r.1 * r.1).sum();
        return Err(Refusal::Shapeless {
            unexplained: (squares / all).min(1.0),
        });
    }
    Ok(())
}

/// Light that is bright at one reading and gone at the next, again and again, was off for a part of the scan: what is left of
/// the peak has its middle elsewhere. A peak that is as wide as some steps falls off over as many.
fn cut(
    scan: &Scan,
    readings: &[(Displacement, f64)],
    smooth: &Smooth,
    shape: &Shape,
) -> Result<(), Refusal> {
    let (long, _, _) = shape.ellipse();
    if long < RESOLVED * scan.spacing() {
        return Ok(());
    }
    let mut values: Vec<f64> = readings.iter().map(|r| r.1).collect();
    values.sort_by(f64::total_cmp);
    let (low, high) = (values[values.len() / 10], values[values.len() - 1]);
    let share = |k: usize| (readings[k].1 - low) / (high - low);
    let next = |a: usize, b: usize| {
        let away = (readings[a].0 - readings[b].0).norm();
        away > 0.0 && away < 1.25 * scan.spacing()
    };
    let steps: Vec<usize> = (0..readings.len())
        .filter(|k| share(*k) > HALF)
        .flat_map(|k| {
            let dark = smooth
                .near(readings[k].0)
                .filter(move |i| next(k, *i) && share(*i) < DARK);
            dark.map(move |_| k)
        })
        .collect();
    if steps.len() < CUTS {
        return Ok(());
    }
    let middle = steps
        .iter()
        .fold(Displacement::default(), |sum, k| sum + readings[*k].0);
    Err(Refusal::Cut {
        at: middle * (1.0 / steps.len() as f64),
        steps: steps.len(),
    })
}

/// How far apart fits to parts of the readings put the peak, metres: every second row, every second column, and its
/// core alone. Where light is not quite of the shape, or the scan's rows do not fit each other, that says how sure a
/// place is, and the readings' noise does not.
pub(super) fn apart(found: &Fit, all: &[(usize, Datum)], free: bool, noise: f64) -> f64 {
    let rank = |of: fn(&Datum) -> f64| -> Vec<usize> {
        let mut values: Vec<f64> = all.iter().map(|(_, d)| of(d)).collect();
        values.sort_by(f64::total_cmp);
        let step = (values[values.len() - 1] - values[0]) / (values.len() as f64).sqrt();
        values.dedup_by(|b, a| *b - *a < 0.2 * step);
        let place = |d: &Datum| values.partition_point(|v| *v < of(d) - 0.1 * step);
        all.iter().map(|(_, d)| place(d)).collect()
    };
    let fitted = |keep: &dyn Fn(usize, &Datum) -> bool| {
        let part: Vec<Datum> = all
            .iter()
            .enumerate()
            .filter(|(k, (_, d))| keep(*k, d))
            .map(|(_, (_, d))| *d)
            .collect();
        let seen = part
            .iter()
            .filter(|d| found.shape.share(d.at) > 0.1)
            .count();
        let found = (seen > 8)
            .then(|| fit(&part, &found.shape, found.level, free))
            .flatten()?;
        Some((found.shape.at, found.deviation(noise)))
    };
    // What noise explains is in the deviation already.
    let beyond = |a: (Displacement, f64), b: (Displacement, f64)| {
        let (off, own) = ((a.0 - b.0).norm(), a.1.hypot(b.1));
        0.5 * (off * off - 9.0 * own * own).max(0.0).sqrt()
    };
    let mut most = 0.0_f64;
    for ranks in [rank(|d| d.at.x), rank(|d| d.at.y)] {
        let half = |parity: usize| fitted(&|k, _| ranks[k] % 2 == parity);
        if let (Some(a), Some(b)) = (half(0), half(1)) {
            most = most.max(beyond(a, b));
        }
    }
    if let Some(core) = fitted(&|_, d| found.shape.share(d.at) > 0.25) {
        most = most.max(beyond(core, (found.shape.at, 0.0)));
    }
    most
}

/// How far from a peak the readings next to the brightest place, alone, put one, metres, beyond what their noise explains: two peaks
/// that merge have their middle where neither is.
pub(super) fn crest(scan: &Scan, found: &Fit, all: &[(usize, Datum)]) -> f64 {
    /// Short radii about the brightest place.
    const NEAR: f64 = 0.8;
    let plain = |d: &Datum| d.sign > 0.0 && d.share == 0.0 && !d.at_least;
    if !all.iter().all(|(_, d)| plain(d)) {
        return 0.0;
    }
    let (_, short, _) = found.shape.ellipse();
    let readings: Vec<(Displacement, f64)> = all.iter().map(|(_, d)| (d.at, d.power)).collect();
    let smooth = Smooth::new(&readings, scan.spacing());
    let by = |a: &usize, b: &usize| smooth.value[*a].total_cmp(&smooth.value[*b]);
    let Some(top) = (0..readings.len()).max_by(by).map(|k| smooth.at[k]) else {
        return 0.0;
    };
    let near = all.iter().map(|(_, d)| *d);
    let near: Vec<Datum> = near
        .filter(|d| (d.at - top).norm() < NEAR * short)
        .collect();
    let free = near.len().saturating_sub(NUMBERS);
    let start = Shape {
        at: top,
        ..found.shape
    };
    let Some(own) = fit(&near, &start, found.level, false).filter(|_| free > 2) else {
        return 0.0;
    };
    let off = (own.shape.at - found.shape.at).norm();
    let known = own.deviation((own.squares / free as f64).sqrt());
    // Farther than its readings it has found nothing.
    let inside = own.shape.height > 0.0 && (own.shape.at - top).norm() < NEAR * short;
    if inside && off > 3.0 * known {
        off
    } else {
        0.0
    }
}

/// Whether light that comes down again in its middle is a ring as well as it is light that was mirrored: a ring is
/// smooth where it is brightest, mirrored light has an edge there.
pub(super) fn is_ring(found: &Fit, plain: &[Datum]) -> bool {
    let shape = &found.shape;
    let squares = |scale: f64| {
        let column = |of: &dyn Fn(&Datum, f64) -> f64| -> Vec<f64> {
            plain
                .iter()
                .map(|d| of(d, -shape.share(d.at).max(1e-300).ln() * scale))
                .collect()
        };
        let x = matrix(&[
            &column(&|_, _| 1.0),
            &column(&|d, _| (d.at.x - shape.at.x) * 1e6),
            &column(&|d, _| (d.at.y - shape.at.y) * 1e6),
            &column(&|_, r| (-r).exp()),
            &column(&|_, r| r * (-r).exp()),
            &column(&|_, r| r * r * (-r).exp()),
        ]);
        let powers: Vec<f64> = plain.iter().map(|d| d.power).collect();
        least_squares(&x, &powers)
            .map_or(f64::INFINITY, |s| s.residuals.iter().map(|r| r * r).sum())
    };
    let best = (0..16)
        .map(|k| squares(0.4 * 1.12_f64.powi(k)))
        .fold(f64::INFINITY, f64::min);
    best < RING * found.squares
}
