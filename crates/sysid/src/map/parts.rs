//! A part of a scan, in the order in which it was taken, that is of other light or of other places than the rest: a stage that was pushed or slipped, a
//! level that stepped, a detector that saw other light for a while.
//!
//! One peak through both parts stands between them, and what it leaves looks as if the light had another shape: rows above are steeper, rows below
//! are flatter. Beside a background, a height and a place that one part has for itself, the peak is told far better. Where light has another
//! shape indeed, parts in any other order, by columns where rows were scanned, would be told as much better: they are what is compared.

use super::Scan;
use super::shape::{Datum, Fit, NUMBERS, Shape, scaled};
use crate::steady::chi_squared;
use nalgebra::SVector;
use pigtail_model::frames::Displacement;
use pigtail_numerics::normal::{Normal, Problem, Rules, minimise};
use std::collections::HashMap;

/// Readings count from this share of the peak on: beside it only a background shows, which says nothing of a place.
const SEES: f64 = 0.03;

/// Blocks of readings, in order, from any of which on a part may begin or end.
const BLOCKS: usize = 48;

/// Numbers that a part may have for itself: background, height, place; where they stand in a shape.
const OWN: usize = 4;
const ALL: usize = NUMBERS + OWN;
/// Those of a place.
const PLACE: usize = 2;

/// What parts are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// From any block to any other, with all numbers of their own.
    Any,
    /// All from one block on, at another place alone: after a stage has slipped.
    Slipped,
}

impl Kind {
    /// Whether a part has one of all numbers for itself, or there is none.
    fn has(self, number: usize) -> bool {
        self == Self::Any || !(NUMBERS..ALL - PLACE).contains(&number)
    }
}

/// Squares that a part tells better: beyond what chance makes of four numbers once in ten thousand times, and so many times what parts in
/// another order tell better. A thousand parts that overlap are tried, and of 160 steady peaks of other shapes than a Gaussian five have both, which are 0.02 to
/// 0.5 um less sure for it. Forty times the noise's variance and twice the others were asked first, and steps of half a radius across noisy peaks were answered wrongly.
const OTHERS: f64 = 1.5;

/// From so many readings on a slip is asked about.
const FEWEST: usize = 20;

/// The peak may be where a part has it that saw this share of its light.
const MUCH: f64 = 0.2;

/// How often a stage slips while it scans. A choice, as of benches that nobody has watched.
const PRIOR: f64 = 0.1;

type Numbers = SVector<f64, NUMBERS>;

/// How far a part of a scan may put the peak from where all of it does, metres.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Apart {
    /// One that is told far better by itself; zero where none is.
    pub(super) told: f64,
    /// One that a stage would make which slipped without showing it: a standard deviation.
    pub(super) open: f64,
}

/// How far one of the parts of a scan puts the peak from where all of it does.
pub(super) fn apart(scan: &Scan, found: &Fit, all: &[(usize, Datum)]) -> Apart {
    let shape = &found.shape;
    let plain = |d: &Datum| d.sign == 1.0 && d.share == 0.0 && !d.at_least;
    let seen: Vec<(usize, Datum)> = all
        .iter()
        .filter(|(_, d)| plain(d) && shape.share(d.at) > SEES)
        .copied()
        .collect();
    if seen.len() < FEWEST {
        return Apart::default();
    }
    let order = across(scan, &seen);
    let slipped = slipped(scan, &seen, found, &order);
    let data: Vec<Datum> = seen.iter().map(|(_, d)| *d).collect();
    Apart {
        told: slipped.told.max(any(&data, found, &order)),
        ..slipped
    }
}

/// How far a part with all numbers for itself puts the peak from where all readings do, metres; zero where none is told far better.
fn any(data: &[Datum], found: &Fit, order: &[Datum]) -> f64 {
    let n = data.len();
    let Some((gain, part)) = best(data, found, Kind::Any).filter(|_| n >= 3 * ALL) else {
        return 0.0;
    };
    let left = data.iter().map(|d| d.residual(&found.shape, 0.0));
    let squares: f64 = left.map(|l| l.powi(2)).sum();
    let noise = (squares - gain).max(0.0) / (n - ALL) as f64;
    let other = best(order, found, Kind::Any).map_or(0.0, |(gain, _)| gain);
    if gain < chi_squared(OWN as f64) * noise || gain < OTHERS * other {
        return 0.0;
    }
    told(data, found, part, Kind::Any)
}

/// How far a stage that slipped puts the peak from where all readings do: by how far it is off before or after, and how likely it is that it did;
/// and by a slip that these readings would not show.
fn slipped(scan: &Scan, seen: &[(usize, Datum)], found: &Fit, order: &[Datum]) -> Apart {
    let n = seen.len() as f64;
    let other = best(order, found, Kind::Slipped).map_or(0.0, |best| best.0);
    let in_time: Vec<Datum> = seen.iter().map(|(_, d)| *d).collect();
    let mut most = Apart::default();
    for data in std::iter::once(in_time).chain(again(scan, seen)) {
        let Some((gain, part)) = best(&data, found, Kind::Slipped) else {
            continue;
        };
        let left = data.iter().map(|d| d.residual(&found.shape, found.level));
        let squares: f64 = left.map(|l| l.powi(2)).sum();
        let noise = (squares - gain).max(0.0) / (n - (NUMBERS + PLACE) as f64);
        // By the Bayesian information criterion, with as many places where it may have been as were tried.
        let tried = n.ln() + (BLOCKS as f64).ln();
        let odds = PRIOR * (0.5 * (gain - other) / noise - tried).exp();
        let likely = (1.0 + odds.recip()).recip().max(0.0);
        // Slips of any size up to where it would be as likely as not, which put a peak half as far off.
        let shows = (2.0 * (tried - PRIOR.ln())).sqrt();
        let hidden = 0.5 * shows / 3.0_f64.sqrt() * unsure(&data, found, noise.sqrt());
        let off = likely.sqrt() * told(&data, found, part, Kind::Slipped);
        if likely > 0.5 {
            most.told = most.told.max(off);
        } else {
            most.open = most.open.max(off.hypot(PRIOR.sqrt() * hidden));
        }
    }
    most
}

/// How well a slip in the midst of the light would be told, one standard deviation, metres, in the direction and at the place where that is worst.
fn unsure(data: &[Datum], found: &Fit, noise: f64) -> f64 {
    let sums = sums(data, found);
    let whole = sums[BLOCKS];
    let light = |block: usize| sums[block].matrix[(1, 1)];
    let within = MUCH * light(BLOCKS)..(1.0 - MUCH) * light(BLOCKS);
    let deviation = |block: usize| -> Option<f64> {
        let mut normal = both(&whole, &sums[block], Kind::Slipped);
        for i in 0..ALL {
            normal.matrix[(i, i)] *= 1.0 + 1e-9;
        }
        let own = normal.matrix.try_inverse()?;
        let [a, b] = [ALL - PLACE, ALL - 1];
        let (xx, xy, yy) = (own[(a, a)], own[(a, b)], own[(b, b)]);
        let worst = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        Some(found.unit * worst.sqrt() * noise / found.height)
    };
    (1..BLOCKS)
        .filter(|block| within.contains(&light(*block)))
        .filter_map(deviation)
        .fold(0.0, f64::max)
}

/// Where most places were read twice: the readings by how many times their place had been read before, such as of two scans in one file.
fn again(scan: &Scan, seen: &[(usize, Datum)]) -> Option<Vec<Datum>> {
    /// Places so near, in distances of neighbours, are one.
    const ONE: f64 = 0.05;
    let cell = ONE * scan.spacing();
    let mut visits: HashMap<[i64; 2], usize> = HashMap::new();
    let mut by_visit: Vec<(usize, Datum)> = seen
        .iter()
        .map(|(_, d)| {
            let key = [d.at.x, d.at.y].map(|v| (v / cell).round() as i64);
            let visit = visits.entry(key).or_default();
            *visit += 1;
            (*visit, *d)
        })
        .collect();
    by_visit.sort_by_key(|(visit, _)| *visit);
    let twice = by_visit.iter().filter(|(visit, _)| *visit > 1).count();
    (3 * twice > seen.len()).then(|| by_visit.into_iter().map(|(_, d)| d).collect())
}

/// The readings in the order in which they would have been taken had the scan gone by columns instead of rows, or the other way round.
fn across(scan: &Scan, seen: &[(usize, Datum)]) -> Vec<Datum> {
    let readings = &scan.readings;
    // The coordinate along which the scan goes on from line to line changes less often.
    let way = |of: fn(Displacement) -> f64| {
        let steps = readings.windows(2).map(|w| of(w[1].at - w[0].at).abs());
        steps.sum::<f64>()
    };
    let by_rows = way(|d| d.y) < way(|d| d.x);
    let mut data: Vec<Datum> = seen.iter().map(|(_, d)| *d).collect();
    let key = |d: &Datum| {
        if by_rows {
            (d.at.x, d.at.y)
        } else {
            (d.at.y, d.at.x)
        }
    };
    data.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    data
}

/// Where a block of so many readings begins.
fn edge(n: usize, block: usize) -> usize {
    block * n / BLOCKS
}

/// Normal equations of a fit of all readings before each block, and of all.
fn sums(data: &[Datum], found: &Fit) -> Vec<Normal<NUMBERS>> {
    let (shape, unit, height) = (&found.shape, found.unit, found.height);
    let mut sum = Normal::<NUMBERS>::default();
    let mut sums = vec![sum];
    for block in 0..BLOCKS {
        for d in &data[edge(data.len(), block)..edge(data.len(), block + 1)] {
            let row = scaled(&shape.slopes(d.at), unit, height);
            let row = Numbers::from_fn(|i, _| row[i]);
            sum.add(&row, d.residual(shape, found.level) / height);
        }
        sums.push(sum);
    }
    sums
}

/// The part that is told best by itself, to first order: by how much less it leaves, squared, and which readings it is of.
fn best(data: &[Datum], found: &Fit, kind: Kind) -> Option<(f64, std::ops::Range<usize>)> {
    let (height, n) = (found.height, data.len());
    let sums = sums(data, found);
    let whole = sums[BLOCKS];
    let mut most: Option<(f64, std::ops::Range<usize>)> = None;
    let begins = if kind == Kind::Any { BLOCKS } else { 1 };
    for from in 0..begins {
        // A part up to the end is one from the beginning, seen from the other side.
        for to in from + 1..BLOCKS {
            let mut part = sums[to];
            part.matrix -= sums[from].matrix;
            part.right -= sums[from].right;
            if let Some(gain) = gain(&whole, &part, kind)
                && most.as_ref().is_none_or(|(m, _)| gain > *m)
            {
                most = Some((gain, edge(n, from)..edge(n, to)));
            }
        }
    }
    // What a fit to all readings, the dark ones too, leaves on the peak is no least of it.
    let already = whole
        .solve_with_ridge(1e-12)
        .map_or(0.0, |p| p.dot(&whole.right));
    most.map(|(gain, part)| ((gain - already) * height * height, part))
}

/// By how much less is left, squared, where a part has numbers for itself.
fn gain(whole: &Normal<NUMBERS>, part: &Normal<NUMBERS>, kind: Kind) -> Option<f64> {
    let normal = both(whole, part, kind);
    let solved = normal.solve_with_ridge(1e-9)?;
    Some(solved.dot(&normal.right))
}

/// Normal equations of all numbers and of those that a part has for itself.
fn both(whole: &Normal<NUMBERS>, part: &Normal<NUMBERS>, kind: Kind) -> Normal<ALL> {
    let mut normal = Normal::<ALL>::default();
    for i in 0..ALL {
        let (own_i, a) = (i >= NUMBERS, if i >= NUMBERS { i - NUMBERS } else { i });
        normal.right[i] = if own_i { part.right[a] } else { whole.right[a] };
        for j in 0..ALL {
            let (own_j, b) = (j >= NUMBERS, if j >= NUMBERS { j - NUMBERS } else { j });
            let of = if own_i || own_j { part } else { whole };
            normal.matrix[(i, j)] = of.matrix[(a, b)];
        }
    }
    without(&mut normal, kind);
    normal
}

/// Leaves out numbers that no part has for itself: they stay.
fn without(normal: &mut Normal<ALL>, kind: Kind) {
    for i in (NUMBERS..ALL).filter(|i| !kind.has(*i)) {
        normal.matrix.row_mut(i).fill(0.0);
        normal.matrix.column_mut(i).fill(0.0);
        normal.matrix[(i, i)] = 1.0;
        normal.right[i] = 0.0;
    }
}

/// How far the peak of either part is from the one of all readings, metres, of the parts that saw much of its light.
fn told(data: &[Datum], found: &Fit, part: std::ops::Range<usize>, kind: Kind) -> f64 {
    const RULES: Rules = Rules {
        steps: 40,
        ridge: 1e-9,
        gain: 0.0,
        share: 1e-6,
    };
    let light = |range: std::ops::Range<usize>| -> f64 {
        let shares = data[range].iter().map(|d| found.shape.share(d.at));
        shares.map(|s| s * s).sum()
    };
    let inside = light(part.clone()) / light(0..data.len());
    let parted = Parted {
        data,
        found,
        part,
        kind,
    };
    let Some(least) = minimise(&parted, (found.shape, [0.0; OWN]), &RULES) else {
        return 0.0;
    };
    let (shape, [.., x, y]) = least.at;
    let off = shape.at - found.shape.at;
    let within = off + Displacement::new(x, y);
    // What a part with little light has for itself may be anything; a place alone is one.
    let much = if kind == Kind::Any { MUCH } else { 0.0 };
    let one = if inside < 1.0 - much { off.norm() } else { 0.0 };
    let other = if inside > much { within.norm() } else { 0.0 };
    one.max(other)
}

/// A shape through readings of which a part has background, height and place for itself.
struct Parted<'a> {
    data: &'a [Datum],
    found: &'a Fit,
    part: std::ops::Range<usize>,
    kind: Kind,
}

impl Parted<'_> {
    fn of(&self, k: usize, (shape, own): &(Shape, [f64; OWN])) -> Shape {
        if !self.part.contains(&k) {
            return *shape;
        }
        Shape {
            background: shape.background + own[0],
            height: shape.height + own[1],
            at: shape.at + Displacement::new(own[2], own[3]),
            ..*shape
        }
    }
}

impl Problem<ALL> for Parted<'_> {
    type State = (Shape, [f64; OWN]);

    fn cost(&self, at: &Self::State) -> f64 {
        if !at.0.is_sound() {
            return f64::INFINITY;
        }
        let left = self.data.iter().enumerate();
        left.map(|(k, d)| d.residual(&self.of(k, at), 0.0).powi(2))
            .sum()
    }

    fn equations(&self, at: &Self::State) -> Normal<ALL> {
        let mut normal = Normal::default();
        for (k, d) in self.data.iter().enumerate() {
            let shape = self.of(k, at);
            let row = scaled(&shape.slopes(d.at), self.found.unit, self.found.height);
            let inside = self.part.contains(&k);
            let row = SVector::<f64, ALL>::from_fn(|i, _| match i.checked_sub(NUMBERS) {
                None => row[i],
                Some(own) if inside => row[own],
                Some(_) => 0.0,
            });
            normal.add(&row, d.residual(&shape, 0.0) / self.found.height);
        }
        without(&mut normal, self.kind);
        normal
    }

    fn step(&self, (shape, own): &Self::State, by: &SVector<f64, ALL>) -> Self::State {
        let (unit, height) = (self.found.unit, self.found.height);
        let back = [height, height, unit, unit];
        let next = shape.stepped(&Numbers::from_fn(|i, _| by[i]), unit, height);
        let own = std::array::from_fn(|i| own[i] + back[i] * by[NUMBERS + i]);
        (next, own)
    }
}

#[cfg(test)]
mod tests {
    use super::super::shape::fit;
    use super::super::{Reading, Scan};
    use super::*;

    /// A peak of 4 and 3 um on a grid, with some noise; how far a reading's place is from where it says, and what is added to its power.
    fn tried(
        order: f64,
        off: impl Fn(Displacement) -> Displacement,
        added: impl Fn(Displacement) -> f64,
    ) -> f64 {
        let readings: Vec<Reading> = (0..400)
            .map(|k| {
                let at = Displacement::new(f64::from(k % 20) * 1e-6, f64::from(k / 20) * 1e-6);
                let from = at + off(at) - Displacement::new(9.3e-6, 9.1e-6);
                let r = (from.x / 4e-6).hypot(from.y / 3e-6);
                let noise = 0.01 * f64::from(k * 7919 % 17 - 8) / 5.0;
                let power = (-r.powf(order)).exp() + 0.1 + noise + added(at);
                Reading { at, power }
            })
            .collect();
        let scan = Scan::new(readings).unwrap();
        let data: Vec<(usize, Datum)> =
            scan.readings.iter().map(Datum::plain).enumerate().collect();
        let plain: Vec<Datum> = data.iter().map(|(_, d)| *d).collect();
        let start = Shape::round(0.1, 1.0, Displacement::new(9e-6, 9e-6), 3.5e-6);
        apart(&scan, &fit(&plain, &start, 0.0, false).unwrap(), &data).told
    }

    #[test]
    fn a_stage_that_slipped_and_a_level_that_stepped_are_told_and_other_shapes_are_none() {
        let none = |_: Displacement| Displacement::default();
        let nothing = |_: Displacement| 0.0;
        let away = |d: Displacement| {
            move |at: Displacement| {
                if at.y > 8.6e-6 {
                    d
                } else {
                    Displacement::default()
                }
            }
        };
        for order in [1.7, 2.0, 2.5] {
            // Its noise is no noise quite: by so little a steady peak may be less sure.
            assert!(tried(order, none, nothing) < 0.05e-6, "{order}");
        }
        for d in [(0.0, 1.5e-6), (0.0, -1.5e-6), (1.5e-6, 0.0), (1e-6, 1e-6)] {
            let d = Displacement::new(d.0, d.1);
            let told = tried(2.0, away(d), nothing);
            assert!(
                (0.4 * d.norm()..1.1 * d.norm()).contains(&told),
                "{told} of {d:?}"
            );
        }
        let level = |at: Displacement| if at.y > 8.6e-6 { 0.2 } else { 0.0 };
        assert!(tried(2.0, none, level) > 0.1e-6);
    }
}
