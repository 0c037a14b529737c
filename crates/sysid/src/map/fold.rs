//! Did the instrument fold the light?
//!
//! A photodiode's amplifier clips, a converter that overflows wraps around, a rectifier or the
//! magnitude of a lock-in mirrors. Each is tried as an explanation: a shape whose power, folded so,
//! comes nearest to the readings. The plain one stands unless it leaves more than noise on the peak
//! and another does not.

use super::Scan;
use super::shape::{Datum, Fit, Shape, fit, flat_squares};
use pigtail_model::frames::Displacement;

/// What became of the power between the light and the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fold {
    /// Nothing.
    Plain,
    /// All above a level reads as that level.
    Clipped {
        /// The level.
        at: f64,
    },
    /// What does not fit a converter's span begins again at its other end.
    Wrapped {
        /// The span.
        span: f64,
    },
    /// What goes above a level comes down again.
    MirroredDown {
        /// The level.
        at: f64,
    },
    /// What goes below a level comes up again: a magnitude.
    MirroredUp {
        /// The level.
        at: f64,
    },
}

impl Fold {
    /// The word for it in tables and files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Clipped { .. } => "clipped",
            Self::Wrapped { .. } => "wrapped",
            Self::MirroredDown { .. } => "mirrored_down",
            Self::MirroredUp { .. } => "mirrored_up",
        }
    }

    /// The level or span that it has, in the unit of power.
    pub fn level(&self) -> Option<f64> {
        match *self {
            Self::Plain => None,
            Self::Clipped { at }
            | Self::Wrapped { span: at }
            | Self::MirroredDown { at }
            | Self::MirroredUp { at } => Some(at),
        }
    }
}

/// A reading that sees a peak stands this high on it.
pub(super) const SEES: f64 = 0.1;
/// Readings at the very top that may be a clipped peak.
const CLIPPED: usize = 3;
/// With this share of the noise that is allowed, the plain one is surely right: no other is tried.
const SURELY: f64 = 0.75;
/// Another explanation than the plain one leaves at most this share of what that leaves.
const MUCH_BETTER: f64 = 0.5;

/// What the powers of some readings are like.
pub(super) struct Spread {
    pub(super) bottom: f64,
    pub(super) top: f64,
    pub(super) median: f64,
    /// Sum of the squares from a plane.
    pub(super) squares: f64,
}

impl Spread {
    pub(super) fn of(data: &[Datum]) -> Self {
        let mut powers: Vec<f64> = data.iter().map(|d| d.power).collect();
        powers.sort_by(f64::total_cmp);
        let n = powers.len();
        Self {
            bottom: powers[0],
            top: powers[n - 1],
            median: powers[n / 2],
            squares: flat_squares(data),
        }
    }

    fn range(&self) -> f64 {
        self.top - self.bottom
    }
}

/// A way of folding, its level unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Folding {
    Plain,
    /// At this level: the brightest reading, several times.
    Clipped(f64),
    Wrapped(f64),
    MirroredDown(f64),
    MirroredUp(f64),
}

impl Folding {
    pub(super) fn is_free(self) -> bool {
        matches!(
            self,
            Self::Wrapped(_) | Self::MirroredDown(_) | Self::MirroredUp(_)
        )
    }

    fn level(self) -> f64 {
        match self {
            Self::Plain => 0.0,
            Self::Clipped(level)
            | Self::Wrapped(level)
            | Self::MirroredDown(level)
            | Self::MirroredUp(level) => level,
        }
    }

    fn at(self, level: f64) -> Self {
        match self {
            Self::Plain | Self::Clipped(_) => self,
            Self::Wrapped(_) => Self::Wrapped(level),
            Self::MirroredDown(_) => Self::MirroredDown(level),
            Self::MirroredUp(_) => Self::MirroredUp(level),
        }
    }

    pub(super) fn with_level(self, level: f64) -> Fold {
        match self {
            Self::Plain => Fold::Plain,
            Self::Clipped(at) => Fold::Clipped { at },
            Self::Wrapped(_) => Fold::Wrapped { span: level },
            Self::MirroredDown(_) => Fold::MirroredDown { at: level },
            Self::MirroredUp(_) => Fold::MirroredUp { at: level },
        }
    }

    /// What this makes of a power; of one that wraps, the bottom is where the readings' is.
    fn folded(self, power: f64, bottom: f64) -> f64 {
        match self {
            Self::Plain => power,
            Self::Clipped(level) => power.min(level),
            Self::Wrapped(span) => bottom + (power - bottom).rem_euclid(span),
            Self::MirroredDown(level) => level - (power - level).abs(),
            Self::MirroredUp(level) => level + (power - level).abs(),
        }
    }

    /// Readings as this folds the light of a shape.
    pub(super) fn data(self, plain: &[Datum], shape: &Shape) -> Vec<Datum> {
        let folded = |d: &Datum| {
            let power = shape.power(d.at);
            let (sign, share, at_least) = match self {
                Self::Clipped(level) => (1.0, 0.0, d.power >= level),
                Self::Wrapped(span) => (
                    1.0,
                    -((power - d.power) / span).round().clamp(-1.0, 4.0),
                    false,
                ),
                Self::MirroredDown(level) if power > level => (-1.0, 2.0, false),
                Self::MirroredUp(level) if power < level => (-1.0, 2.0, false),
                Self::Plain | Self::MirroredDown(_) | Self::MirroredUp(_) => (1.0, 0.0, false),
            };
            Datum {
                sign,
                share,
                at_least,
                ..*d
            }
        };
        plain.iter().map(folded).collect()
    }
}

/// The best explanation of some readings.
pub(super) fn explain(
    scan: &Scan,
    data: &[Datum],
    spread: &Spread,
    noise: f64,
) -> Option<(Fit, Folding)> {
    let mut plain: Option<Fit> = None;
    for start in starts(scan, data, spread) {
        // A peak that hides between the readings explains nothing.
        let sees = |f: &Fit| data.iter().any(|d| f.shape.share(d.at) > SEES);
        let found = fit(data, &start, 0.0, false).filter(sees);
        better(&mut plain, found.as_ref());
    }
    let plain = plain?;
    let mut best = (plain, Folding::Plain);
    let enough = MUCH_BETTER * plain.squares;
    let (level, top) = bound(data, spread, &plain, scan.spacing());
    if top >= CLIPPED && top < data.len() / 2 {
        let fold = Folding::Clipped(level);
        let clipped = fold.data(data, &plain.shape);
        let mut found = None;
        for height in [1.0, 1.5, 2.5] {
            let start = Shape {
                height: height * plain.shape.height.abs(),
                ..plain.shape
            };
            better(&mut found, fit(&clipped, &start, 0.0, false).as_ref());
        }
        // It leaves out readings, which alone would make it better. Several that are just the same
        // speak for it by themselves, unless there is no noise at all.
        let fair = (data.len() - top) as f64 / data.len() as f64;
        let noisy = plain.squares > 1e-9 * spread.squares;
        if let Some(found) = found.filter(|f| noisy && f.squares < plain.squares * fair) {
            best = (found, fold);
        }
    }
    if best.1 != Folding::Plain || leaves_noise(data, &plain, SURELY * noise) {
        return Some(best);
    }
    for fold in [
        Folding::Wrapped(spread.range()),
        Folding::MirroredDown(spread.top),
        Folding::MirroredUp(spread.bottom),
    ] {
        if let Some((found, fold)) = unfold(scan, data, spread, noise, fold)
            && found.squares < enough
            && found.squares < best.0.squares
        {
            best = (found, fold);
        }
    }
    Some(best)
}

/// The level at which light is cut off, and how many readings stand there: the top one where several have just that,
/// or a plateau that is only nearly flat, of more readings than a peak has at its top.
fn bound(data: &[Datum], spread: &Spread, plain: &Fit, spacing: f64) -> (f64, usize) {
    const NEARLY: f64 = 0.04;
    const TIMES: f64 = 2.5;
    const LEAST: usize = 6;
    let same = data.iter().filter(|d| d.power >= spread.top).count();
    if same >= CLIPPED {
        return (spread.top, same);
    }
    let level = spread.top - NEARLY * spread.range();
    let near = data.iter().filter(|d| d.power >= level).count();
    // What a peak without a bound has so near its top, by its flanks: from half of its height to a fifth of it.
    let within = |low: f64, high: f64| {
        let above = |share: f64| spread.median + share * (spread.top - spread.median);
        let inside = data
            .iter()
            .filter(|d| d.power >= above(low) && d.power < above(high));
        inside.count() as f64
    };
    // A Gaussian's area between two shares of its height goes with the logarithm of their ratio.
    let flanks = within(0.2, 0.6);
    let area = flanks / f64::ln(0.6 / 0.2);
    let own =
        area * -f64::ln(1.0 - NEARLY * spread.range() / (spread.top - spread.median).max(1e-300));
    let (long, short, _) = plain.shape.ellipse();
    let by_fit = std::f64::consts::PI * long * short * NEARLY / (spacing * spacing);
    if near >= LEAST && near as f64 > TIMES * own.max(1.0) && near as f64 > by_fit {
        (level, near)
    } else {
        (spread.top, same)
    }
}

/// Whether a shape leaves no more than `noise`, or than a peak does that is not quite a Gaussian:
/// neither where it is bright nor elsewhere.
pub(super) fn leaves_noise(data: &[Datum], found: &Fit, noise: f64) -> bool {
    const TIMES: f64 = 1.6;
    const NOT_QUITE: f64 = 0.04;
    let limit = (TIMES * noise).powi(2) + (NOT_QUITE * found.shape.height).powi(2);
    left_over(data, found, SEES) <= limit && left_over(data, found, 0.0) <= limit
}

/// The mean square that a shape leaves where its peak stands higher than a share.
pub(super) fn left_over(data: &[Datum], found: &Fit, share: f64) -> f64 {
    let squares = data
        .iter()
        .filter(|d| !d.at_least && found.shape.share(d.at) >= share)
        .map(|d| d.residual(&found.shape, found.level).powi(2));
    let (sum, n) = squares.fold((0.0, 0.0), |(sum, n), square| (sum + square, n + 1.0));
    if n > 0.0 { sum / n } else { 0.0 }
}

/// The noise of a reading, whatever the light: by how far readings are off the middle of their
/// neighbours on opposite sides. Of those the lesser, for light that bends between neighbours is
/// not noise.
pub(super) fn noise_of(data: &[Datum], spacing: f64) -> f64 {
    const LOOKS: usize = 400;
    const LESSER: f64 = 0.3;
    /// A standard normal number is less than this in size as often as that.
    const QUANTILE: f64 = 0.385;
    let nearest = |place: Displacement, not: usize| {
        let away = |d: &Datum| (d.at - place).norm();
        (0..data.len())
            .filter(|k| *k != not)
            .map(|k| (k, away(&data[k])))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let mut off: Vec<f64> = (0..data.len())
        .step_by(data.len().div_ceil(LOOKS) | 1)
        .filter_map(|k| {
            let d = &data[k];
            let (one, _) = nearest(d.at, k)?;
            let a = &data[one];
            let (other, away) = nearest(d.at * 2.0 - a.at, k)?;
            let opposite = other != one && away < 0.3 * spacing;
            opposite.then(|| (a.power - 2.0 * d.power + data[other].power).abs())
        })
        .collect();
    off.sort_by(f64::total_cmp);
    let at = (LESSER * off.len() as f64) as usize;
    off.get(at)
        .map_or(0.0, |size| size / (6.0_f64.sqrt() * QUANTILE))
}

fn better(best: &mut Option<Fit>, new: Option<&Fit>) {
    if let Some(new) = new
        && best.as_ref().is_none_or(|best| new.squares < best.squares)
    {
        *best = Some(*new);
    }
}

/// Where a plain fit may begin: at the brightest reading, at the middle of the bright ones, and in
/// the darkest.
fn starts(scan: &Scan, data: &[Datum], spread: &Spread) -> Vec<Shape> {
    let by = |of: fn(&&Datum, &&Datum) -> std::cmp::Ordering| data.iter().max_by(of);
    let (Some(top), Some(bottom)) = (
        by(|a, b| a.power.total_cmp(&b.power)),
        by(|a, b| b.power.total_cmp(&a.power)),
    ) else {
        return Vec::new();
    };
    let (middle, radius) = moments(data, spread.median);
    let large = scan.half.x.min(scan.half.y);
    let close = 1.5 * scan.spacing();
    let (up, down) = (spread.top - spread.median, spread.bottom - spread.median);
    let mut starts = Vec::new();
    for size in [close, radius, large] {
        for place in [top.at, middle] {
            starts.push(Shape::round(spread.median, up, place, size));
        }
        starts.push(Shape::round(spread.median, down, bottom.at, size));
    }
    starts.push(Shape::round(spread.bottom, spread.range(), top.at, large));
    starts
}

/// The middle of what is off a level, and its root mean square radius, metres.
fn moments(data: &[Datum], level: f64) -> (Displacement, f64) {
    let (mut sum, mut weighted) = (0.0, Displacement::ZERO);
    let weight = |d: &Datum| (d.power - level).powi(2);
    for d in data {
        sum += weight(d);
        weighted += d.at * weight(d);
    }
    let middle = weighted / sum;
    let square: f64 = data
        .iter()
        .map(|d| {
            let off = d.at - middle;
            weight(d) * (off.x.powi(2) + off.y.powi(2))
        })
        .sum();
    (middle, (square / sum).sqrt())
}

/// The best shape behind a way of folding: which readings are folded, and what shape they then
/// have, in turns, from the likeliest of many shapes.
fn unfold(
    scan: &Scan,
    data: &[Datum],
    spread: &Spread,
    noise: f64,
    fold: Folding,
) -> Option<(Fit, Folding)> {
    const TURNS: usize = 12;
    let mut best: Option<(Fit, Folding)> = None;
    for mut shape in likely(scan, data, spread, fold) {
        let mut fold = fold;
        let mut last: Option<(Vec<Datum>, Fit)> = None;
        for _ in 0..TURNS {
            let folded = fold.data(data, &shape);
            if last.as_ref().is_some_and(|(before, _)| *before == folded) {
                break;
            }
            // Its level is told by the readings on both sides of it.
            let sides = folded.iter().filter(|d| d.share != 0.0).count();
            let free = sides > 3 && sides + 3 < folded.len();
            let Some(found) = fit(&folded, &shape, fold.level(), free) else {
                break;
            };
            (shape, fold) = (found.shape, fold.at(found.level));
            last = Some((folded, found));
        }
        let Some((folded, found)) = last else {
            continue;
        };
        let plausible = match fold {
            Folding::Wrapped(span) => {
                span > 0.95 * spread.range() && found.shape.height < 4.0 * span
            }
            Folding::MirroredDown(level) => level > spread.top - 0.2 * spread.range(),
            Folding::MirroredUp(level) => level < spread.bottom + 0.2 * spread.range(),
            Folding::Plain | Folding::Clipped(_) => true,
        };
        if plausible
            && found.shape.height > 0.0
            && scan.contains(found.shape.at)
            && folded.iter().any(|d| d.share != 0.0)
            && leaves_noise(&folded, &found, noise)
            && best.as_ref().is_none_or(|b| found.squares < b.0.squares)
        {
            best = Some((found, fold));
        }
    }
    best
}

/// Round shapes all over the place, width and height that a folded peak may have: those nearest to
/// the readings.
fn likely(scan: &Scan, data: &[Datum], spread: &Spread, fold: Folding) -> Vec<Shape> {
    const SOME: usize = 8;
    const PLACES: i32 = 3;
    let border = border(scan, data);
    let background = match fold {
        Folding::MirroredUp(level) => 2.0 * level - border,
        _ => border,
    };
    let (middle, radius) = moments(data, border);
    let mut tried = Vec::new();
    for (i, j) in (-PLACES..=PLACES).flat_map(|i| (-PLACES..=PLACES).map(move |j| (i, j))) {
        let step = 0.35 * radius;
        let place = middle + Displacement::new(f64::from(i), f64::from(j)) * step;
        for size in [0.3, 0.45, 0.65, 0.9, 1.3] {
            for height in [0.9, 1.1, 1.35, 1.7, 2.2, 3.0] {
                let height = height * spread.range();
                let shape = Shape::round(background, height, place, size * radius);
                let off =
                    |d: &Datum| (d.power - fold.folded(shape.power(d.at), spread.bottom)).abs();
                // Not squares: what is folded otherwise than it should be is far off at once.
                tried.push((data.iter().map(off).sum::<f64>(), shape));
            }
        }
    }
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    tried
        .into_iter()
        .take(SOME)
        .map(|(_, shape)| shape)
        .collect()
}

/// The median power along the border of the area.
fn border(scan: &Scan, data: &[Datum]) -> f64 {
    let out = |d: &&Datum| {
        let from = d.at - scan.middle;
        (from.x.abs() / scan.half.x).max(from.y.abs() / scan.half.y) > 0.85
    };
    let mut powers: Vec<f64> = data.iter().filter(out).map(|d| d.power).collect();
    if powers.is_empty() {
        powers = data.iter().map(|d| d.power).collect();
    }
    powers.sort_by(f64::total_cmp);
    powers[powers.len() / 2]
}
