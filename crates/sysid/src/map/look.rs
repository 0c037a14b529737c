//! Search and peak, one reading after the other.

use super::examine::unfolded;
use super::shape::{Datum, Fit, NUMBERS, Shape, fit, flat_squares};
use super::{Examined, Reading, Scan};
use pigtail_model::frames::Displacement;
use std::collections::HashMap;

/// How a look is to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Where the light is likeliest: the search goes outward from there.
    pub start: Displacement,
    /// Standard deviation of the peak's place at which it is known well enough, metres; a fiftieth
    /// of the peak's short radius where `None`.
    pub accuracy: Option<f64>,
}

/// What a look came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Looked {
    /// The readings that were taken, in order, by their number in the scan.
    pub taken: Vec<usize>,
    /// How many of them until something was light; `None` where nothing was.
    pub first_light: Option<usize>,
    /// The peak; `None` where the readings did not come to tell one.
    pub peak: Option<Shape>,
    /// Standard deviation of its place in the worse direction, metres.
    pub deviation: f64,
    /// Whether that is as good as it was wanted. Where it is not, there were no more readings that
    /// could have told more.
    pub reached: bool,
}

/// The first readings are this share of the smaller side apart, later ones always half of it.
const FIRST_STRIDE: f64 = 0.25;
/// Light stands so many times the usual spread above the median.
const STANDS_OUT: f64 = 8.0;
/// Before so many readings nothing can be said to stand out.
const SOME: usize = 9;
/// Most candidates for the next reading that are weighed.
const WEIGHED: usize = 3000;
/// Of so many readings one more is taken without a new fit.
const AT_A_TIME: usize = 30;
/// A peak is believed when its place is known to this share of its short radius.
const KNOWN: f64 = 0.3;
/// A peak's place is to be known to this share of its short radius, where nothing else is asked.
const PLACE: f64 = 0.02;
/// And its radii to this share of them.
const WIDTH: f64 = 0.03;
/// Readings that a fit is to rest on before its own noise means anything.
const RESTS_ON: usize = NUMBERS + 5;

/// Looks for the peak of a scan that was examined.
pub fn look(scan: &Scan, examined: &Examined, how: &Look) -> Looked {
    let mut looker = Looker::new(scan, unfolded(scan, examined), how.start);
    let mut looked = Looked {
        taken: Vec::new(),
        first_light: None,
        peak: None,
        deviation: f64::INFINITY,
        reached: false,
    };
    while let Some(light) = looker.search() {
        let first_light = looker.taken.len();
        // What stood out may have been noise: then the search goes on.
        if let Some(found) = looker.climb(light).filter(|_| looker.has_shape()) {
            let (found, noise) = looker.refine(found, how.accuracy);
            looked.first_light = Some(first_light);
            looked.deviation = found.deviation(noise);
            looked.reached = looked.deviation <= goal(&found.shape, how.accuracy);
            looked.peak = Some(found.shape);
            break;
        }
    }
    looked.taken = looker.taken.iter().map(|&k| looker.readings[k].0).collect();
    looked
}

fn goal(shape: &Shape, accuracy: Option<f64>) -> f64 {
    accuracy.unwrap_or_else(|| PLACE * shape.ellipse().1)
}

/// What has been read, and what could be.
struct Looker<'s> {
    scan: &'s Scan,
    readings: Vec<(usize, Reading)>,
    taken: Vec<usize>,
    is_taken: Vec<bool>,
    /// All readings from the start outward, and which of them comes next.
    outward: Vec<usize>,
    next: usize,
    /// How far apart the readings of the search are by now, metres.
    stride: f64,
    cells: Cells,
}

impl<'s> Looker<'s> {
    fn new(scan: &'s Scan, readings: Vec<(usize, Reading)>, start: Displacement) -> Self {
        let n = readings.len();
        let away = |k: &usize| (readings[*k].1.at - start).norm();
        let mut outward: Vec<usize> = (0..n).collect();
        outward.sort_by(|a, b| away(a).total_cmp(&away(b)));
        let stride = FIRST_STRIDE * 2.0 * scan.half.x.min(scan.half.y);
        Self {
            scan,
            readings,
            taken: Vec::new(),
            is_taken: vec![false; n],
            outward,
            next: 0,
            stride,
            cells: Cells::new(stride),
        }
    }

    fn take(&mut self, k: usize) {
        self.is_taken[k] = true;
        self.taken.push(k);
    }

    fn at(&self, k: usize) -> &Reading {
        &self.readings[k].1
    }

    fn data(&self) -> Vec<Datum> {
        self.taken
            .iter()
            .map(|&k| Datum::plain(self.at(k)))
            .collect()
    }

    fn brightest(&self) -> Option<usize> {
        let by = |a: &&usize, b: &&usize| self.at(**a).power.total_cmp(&self.at(**b).power);
        self.taken.iter().max_by(by).copied()
    }

    /// From the start outward, ever finer, until something stands out or all that was read has the
    /// shape of a peak: where it is brightest. `None` when all is read. May be gone on with.
    fn search(&mut self) -> Option<usize> {
        let finest = 0.7 * self.scan.spacing();
        loop {
            while self.next < self.outward.len() {
                let k = self.outward[self.next];
                self.next += 1;
                let reading = *self.at(k);
                if self.is_taken[k] || self.cells.is_near(&reading) {
                    continue;
                }
                self.cells.add(&reading);
                self.take(k);
                if self.taken.len() >= SOME && self.stands_out(reading.power) {
                    return Some(k);
                }
            }
            if self.stride <= finest {
                return None;
            }
            self.stride *= 0.5;
            self.next = 0;
            let taken = self.taken.iter().map(|&k| self.readings[k].1);
            self.cells = taken.fold(Cells::new(self.stride), |mut cells, reading| {
                cells.add(&reading);
                cells
            });
            if self.has_shape() {
                return self.brightest();
            }
        }
    }

    /// Whether a power is far above what has been read until now.
    fn stands_out(&self, power: f64) -> bool {
        let (median, spread) = self.usual();
        power > median + STANDS_OUT * spread
    }

    /// Median and spread of the readings, the latter as the standard deviation of normal ones.
    fn usual(&self) -> (f64, f64) {
        let middle = |values: &mut Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let mut powers: Vec<f64> = self.taken.iter().map(|&k| self.at(k).power).collect();
        let median = middle(&mut powers);
        let mut off: Vec<f64> = powers.iter().map(|p| (p - median).abs()).collect();
        // Powers that are read in steps may all be the same one.
        let step = powers
            .windows(2)
            .map(|w| w[1] - w[0])
            .filter(|step| *step > 0.0)
            .fold(f64::INFINITY, f64::min);
        let step = if step.is_finite() { step } else { 0.0 };
        (median, (1.4826 * middle(&mut off)).max(0.3 * step))
    }

    /// Whether the readings have the shape of a peak rather than none.
    fn has_shape(&self) -> bool {
        let data = self.data();
        if data.len() < RESTS_ON {
            return false;
        }
        let flat = flat_squares(&data);
        self.fit_taken().is_some_and(|found| {
            let variance = found.squares / (data.len() - NUMBERS) as f64;
            let shape = found.shape;
            shape.height > 0.0
                && self.scan.contains(shape.at)
                && flat - found.squares > 40.0 * variance
        })
    }

    /// A fit of a round or any peak to what was taken, begun at the brightest.
    fn fit_taken(&self) -> Option<Fit> {
        let data = self.data();
        let top = self.at(self.brightest()?);
        let (median, _) = self.usual();
        let bottom = data.iter().fold(f64::INFINITY, |b, d| b.min(d.power));
        let mut best: Option<Fit> = None;
        for size in [0.5, 1.0, 2.0, 4.0] {
            for background in [median, bottom] {
                let height = top.power - background;
                let start = Shape::round(background, height, top.at, size * self.stride);
                if let Some(found) = fit(&data, &start, 0.0, false)
                    && found.shape.height > 0.0
                    && best.is_none_or(|best| found.squares < best.squares)
                {
                    best = Some(found);
                }
            }
        }
        best
    }

    /// From a bright reading uphill, by what lies around the brightest in eight directions, ever
    /// closer, until a fit knows the peak's place.
    fn climb(&mut self, light: usize) -> Option<Fit> {
        let finest = 0.7 * self.scan.spacing();
        let mut step = self.stride;
        let mut centre = light;
        loop {
            let middle = self.at(centre).at;
            for (dx, dy) in [
                (1, 0),
                (-1, 0),
                (0, 1),
                (0, -1),
                (1, 1),
                (-1, -1),
                (1, -1),
                (-1, 1),
            ] {
                let place = middle + Displacement::new(f64::from(dx), f64::from(dy)) * step;
                if let Some(k) = self.nearest(place, 0.6 * step) {
                    self.take(k);
                }
            }
            if self.taken.len() >= RESTS_ON
                && let Some(found) = self.fit_taken()
                && self.is_known(&found)
            {
                return Some(found);
            }
            match self.brightest().filter(|&k| k != centre) {
                Some(brighter) if self.at(brighter).power > self.at(centre).power => {
                    centre = brighter;
                }
                _ if step > finest => step *= 0.5,
                _ => return self.fit_taken().filter(|found| self.is_inside(found)),
            }
        }
    }

    fn is_inside(&self, found: &Fit) -> bool {
        self.scan.contains(found.shape.at)
    }

    fn is_known(&self, found: &Fit) -> bool {
        let noise = self.noise(found);
        self.is_inside(found) && found.deviation(noise) < KNOWN * found.shape.ellipse().1
    }

    /// The noise of a reading: what a fit leaves, and no less than the dark readings' spread while
    /// the fit rests on little.
    fn noise(&self, found: &Fit) -> f64 {
        const BEFOREHAND: f64 = 3.0;
        let dark: Vec<f64> = self
            .taken
            .iter()
            .map(|&k| self.at(k))
            .filter(|r| found.shape.share(r.at) < 0.02)
            .map(|r| (r.power - found.shape.background(r.at)).powi(2))
            .collect();
        let free = self.taken.len().saturating_sub(NUMBERS) as f64;
        let (before, weight) = if dark.is_empty() {
            (0.0, 0.0)
        } else {
            (dark.iter().sum::<f64>() / dark.len() as f64, BEFOREHAND)
        };
        ((found.squares + weight * before) / (free + weight).max(1.0)).sqrt()
    }

    /// Reads where a reading tells most about the peak's place until that is known well enough, or
    /// none is left that tells anything.
    fn refine(&mut self, mut found: Fit, accuracy: Option<f64>) -> (Fit, f64) {
        loop {
            let noise = self.noise(&found);
            let enough = self.taken.len() >= RESTS_ON
                && found.deviation(noise) <= goal(&found.shape, accuracy)
                && found.width_deviation(noise) <= WIDTH;
            if enough {
                return (found, noise);
            }
            let left: Vec<usize> = (0..self.readings.len())
                .filter(|&k| !self.is_taken[k])
                .filter(|&k| found.shape.share(self.at(k).at) > 0.01)
                .collect();
            let widths = (PLACE / WIDTH).powi(2);
            let every = left.len().div_ceil(WEIGHED).max(1);
            let gain = |k: &usize| found.gain(self.at(*k).at, widths);
            let weighed = left.iter().step_by(every).map(|k| (*k, gain(k)));
            let mut next: Vec<(usize, f64)> = weighed.collect();
            if next.is_empty() {
                return (found, noise);
            }
            next.sort_by(|a, b| b.1.total_cmp(&a.1));
            // One after the other at first; where many are needed, some at a time.
            for (k, _) in next.iter().take(1 + self.taken.len() / AT_A_TIME) {
                self.take(*k);
            }
            let again = fit(&self.data(), &found.shape, 0.0, false);
            match again.filter(|f| self.is_inside(f) && f.shape.height > 0.0) {
                Some(better) => found = better,
                None => {
                    if let Some(better) = self.fit_taken().filter(|f| self.is_inside(f)) {
                        found = better;
                    }
                }
            }
        }
    }

    /// The untaken reading nearest to a place, if within a distance of it.
    fn nearest(&self, place: Displacement, within: f64) -> Option<usize> {
        (0..self.readings.len())
            .filter(|&k| !self.is_taken[k])
            .map(|k| (k, (self.at(k).at - place).norm()))
            .filter(|(_, away)| *away <= within)
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(k, _)| k)
    }
}

/// Readings in squares, so that those nearby are soon found.
struct Cells {
    size: f64,
    cells: HashMap<(i64, i64), Vec<Displacement>>,
}

impl Cells {
    fn new(size: f64) -> Self {
        Self {
            size,
            cells: HashMap::new(),
        }
    }

    fn cell(&self, r: &Reading) -> (i64, i64) {
        (
            (r.at.x / self.size).floor() as i64,
            (r.at.y / self.size).floor() as i64,
        )
    }

    fn add(&mut self, r: &Reading) {
        self.cells.entry(self.cell(r)).or_default().push(r.at);
    }

    /// Whether one is nearer than a square's side.
    fn is_near(&self, r: &Reading) -> bool {
        let (i, j) = self.cell(r);
        // A hair less: readings of a grid are not to miss each other by rounding.
        let near = 0.999 * self.size;
        (-1..=1)
            .flat_map(|di| (-1..=1).map(move |dj| (i + di, j + dj)))
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .any(|at| (*at - r.at).norm() < near)
    }
}
