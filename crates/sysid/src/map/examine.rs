//! What a whole scan says: is there a peak, and is it one that can be told?

use super::fold::{Fold, Folding, SEES, Spread, explain, leaves_noise, left_over, noise_of};
use super::shape::{Datum, Fit, NUMBERS, Shape, fit};
use super::unsteady::Unsteady;
use super::{Reading, Refusal, Scan, gone, late, surround};
use std::f64::consts::PI;

/// A scan with its peak.
#[derive(Debug, Clone, PartialEq)]
pub struct Examined {
    /// The peak by all readings.
    pub peak: Shape,
    /// Standard deviation of its place in the worse direction by the readings, metres.
    pub deviation: f64,
    /// What changed while it was scanned.
    pub unsteady: Unsteady,
    /// By how much it would be elsewhere for powers that are a reading late, where all lines go one way and none would show; metres. Nothing that
    /// is said of it allows for that.
    pub late: f64,
    /// Standard deviation of a reading from the shape.
    pub noise: f64,
    /// The share of the readings' variance that the shape explains.
    pub explained: f64,
    /// Whether it leaves nothing but noise, as neighbours tell it.
    pub only_noise_left: bool,
    /// What the instrument did.
    pub fold: Fold,
    /// How many readings that changed.
    pub folded: usize,
    /// How many stand apart from all their neighbours, and are left out.
    pub apart: usize,
    /// The readings unfolded; `None` where nothing but that it was bright is known, or that it
    /// stands apart.
    pub(super) unfolded: Vec<Option<f64>>,
}

/// About so many readings tell explanations apart, near the peak and far from it; more tell nothing
/// new.
const ENOUGH: usize = 1500;
/// A peak leaves a fit without it worse by so many times the noise's variance. A single reading that
/// is four noises off, as one of some ten thousand is, brings sixteen.
const SIGNIFICANT: f64 = 40.0;
/// A peak that leaves more than noise is still one where it explains this share of the variance.
const MOSTLY: f64 = 0.6;
/// And where it leaves no more than this share of its height on the peak itself, beside the readings' own noise.
const LIKE: f64 = 0.12;
/// Light that was folded, by an explanation of its own for each reading, is one that leaves no more than this share.
const FOLDED: f64 = 0.05;
/// Fewest readings that must: a peak without its background is six numbers.
const SEEN: usize = 6;
/// So many readings may be a peak of their own by accident, they that stand above a third of it.
const ALONE: usize = 2;
const BRIGHT: f64 = 1.0 / 3.0;
/// And so many such peaks, one after the other.
const ALONE_TRIES: usize = 3;

impl Examined {
    /// Standard deviation of the peak's place in the worse direction, metres: by the readings, and by what may have changed while they
    /// were taken.
    pub fn known(&self) -> f64 {
        self.deviation.hypot(self.unsteady.deviation)
    }
}

/// Examines a scan.
///
/// # Errors
///
/// Why no peak can be told from it.
pub fn examine(scan: &Scan) -> Result<Examined, Refusal> {
    let data: Vec<(usize, Datum)> = scan.readings.iter().map(Datum::plain).enumerate().collect();
    let found = among(scan, data.clone())?;
    two_alone(scan, &found, data)?;
    Ok(found)
}

/// Examines some of a scan's readings, without those that stand alone where they hide a peak.
fn among(scan: &Scan, mut data: Vec<(usize, Datum)>) -> Result<Examined, Refusal> {
    let first = attempt(scan, &data);
    let mut last = first.clone();
    // One reading alone is no peak, but may hide one.
    let mut tries = 0..ALONE_TRIES;
    while tries.next().is_some()
        && let Err(refused) = &last
        && let (Refusal::TooCoarse { seen, .. }, Some(shape)) = &**refused
        && *seen <= ALONE
    {
        data.retain(|(_, d)| shape.share(d.at) <= SEES);
        last = attempt(scan, &data);
    }
    if last.is_err() {
        let before = data.len();
        let alone = alone(scan, &data);
        data.retain(|(k, _)| alone.binary_search(k).is_err());
        if data.len() < before {
            last = attempt(scan, &data);
        }
    }
    last.or(first).map_err(|refused| refused.0)
}

/// That a peak which two readings make stands beside no other: wild neighbours look as a narrow peak does, and nobody knows which of
/// the two is meant.
fn two_alone(scan: &Scan, found: &Examined, mut data: Vec<(usize, Datum)>) -> Result<(), Refusal> {
    let stands = |d: &Datum| found.peak.share(d.at) > BRIGHT;
    if data.iter().filter(|(_, d)| stands(d)).count() > ALONE {
        return Ok(());
    }
    data.retain(|(_, d)| found.peak.share(d.at) <= SEES);
    match among(scan, data) {
        Ok(other) => Err(Refusal::Several {
            other: other.peak.at,
            share: other.peak.height / found.peak.height,
        }),
        Err(_) => Ok(()),
    }
}

/// Readings that are far brighter or darker than all around them, if they are few: by their numbers, in order.
fn alone(scan: &Scan, data: &[(usize, Datum)]) -> Vec<usize> {
    const NEIGHBOURS: usize = 9;
    const MANY: usize = 20_000;
    let mut powers: Vec<f64> = data.iter().map(|(_, d)| d.power).collect();
    powers.sort_by(f64::total_cmp);
    let n = powers.len();
    if !(NEIGHBOURS..=MANY).contains(&n) {
        return Vec::new();
    }
    let (median, usual) = (powers[n / 2], powers[n * 9 / 10] - powers[n / 10]);
    let far = |d: &Datum| (d.power - median).abs() > 2.0 * usual;
    let is_alone = |(_, d): &&(usize, Datum)| {
        let mut near: Vec<(f64, f64)> = data
            .iter()
            .map(|(_, o)| ((o.at - d.at).norm(), o.power))
            .collect();
        near.select_nth_unstable_by(NEIGHBOURS - 1, |a, b| a.0.total_cmp(&b.0));
        let own = d.power - median;
        let others = near[..NEIGHBOURS]
            .iter()
            .filter(|(away, _)| *away > 1e-3 * scan.spacing());
        others.map(|(_, p)| (p - median) / own).fold(0.0, f64::max) < 0.5
    };
    let mut found: Vec<usize> = data
        .iter()
        .filter(|(_, d)| far(d))
        .filter(is_alone)
        .map(|(k, _)| *k)
        .collect();
    found.sort_unstable();
    if found.len() > few(n) {
        found.clear();
    }
    found
}

/// Most readings of so many that may stand apart from the others by accident.
fn few(readings: usize) -> usize {
    2.max(readings / 50)
}

/// Why a peak is refused, and which one.
type Refused = Box<(Refusal, Option<Shape>)>;

/// Examines some of a scan's readings. The shape that was refused, where there was one.
fn attempt(scan: &Scan, numbered: &[(usize, Datum)]) -> Result<Examined, Refused> {
    let nothing = || Box::new((Refusal::NoLight { brightest: 0.0 }, None));
    let data: Vec<Datum> = numbered.iter().map(|(_, d)| *d).collect();
    let whole = Spread::of(&data);
    let own_noise = noise_of(&data, scan.spacing());
    let sample = sample(scan, &data, &whole);
    let (best, fold) =
        explain(scan, &sample, &Spread::of(&sample), own_noise).ok_or_else(nothing)?;
    let mut all: Vec<(usize, Datum)> = numbered
        .iter()
        .zip(fold.data(&data, &best.shape))
        .map(|((k, _), d)| (*k, d))
        .collect();
    let refit = |all: &[(usize, Datum)], from: &Fit| {
        let data: Vec<Datum> = all.iter().map(|(_, d)| *d).collect();
        fit(&data, &from.shape, from.level, fold.is_free()).ok_or_else(nothing)
    };
    let mut found = refit(&all, &best)?;
    let read = all.clone();
    if leave_out(&mut all, &found) {
        found = refit(&all, &found)?;
    }
    let used = all.iter().filter(|(_, d)| !d.at_least).count();
    let noise = (found.squares / used.saturating_sub(NUMBERS).max(1) as f64).sqrt();
    let unexplained = found.squares / whole.squares;
    if fold.is_free() && unexplained > FOLDED {
        return Err(Box::new((
            Refusal::Shapeless { unexplained },
            Some(found.shape),
        )));
    }
    let late = check(scan, &found, &all, (noise, own_noise), &whole)
        .and_then(|()| surround::check(scan, &found, &all, (noise, own_noise)))
        .and_then(|()| gone::check(&found, &read, !matches!(fold, Folding::Plain)))
        .and_then(|()| late::check(scan, &found, &all))
        .map_err(|why| Box::new((why, Some(found.shape))))?;
    let plain: Vec<Datum> = all
        .iter()
        .map(|(_, d)| Datum {
            sign: 1.0,
            share: 0.0,
            ..*d
        })
        .collect();
    if matches!(fold, Folding::MirroredDown(_)) && surround::is_ring(&found, &plain) {
        let light = plain.iter().max_by(|a, b| a.power.total_cmp(&b.power));
        let refusal = Refusal::OffCentre {
            middle: found.shape.at,
            brightest: light.map_or(found.shape.at, |d| d.at),
            share: (found.level - found.shape.height).abs() / found.level.abs(),
        };
        return Err(Box::new((refusal, Some(found.shape))));
    }
    let mut unfolded: Vec<Option<f64>> = vec![None; scan.readings.len()];
    for (k, d) in all.iter().filter(|(_, d)| !d.at_least) {
        unfolded[*k] = Some(d.sign * (d.power - d.share * found.level));
    }
    let kept: Vec<Datum> = all.iter().map(|(_, d)| *d).collect();
    let is_folded = |d: &Datum| d.at_least || d.share != 0.0;
    let unsteady = Unsteady::of(scan, &found, &all, own_noise);
    surround::sure(&found, &unsteady).map_err(|why| Box::new((why, Some(found.shape))))?;
    let only_noise_left = leaves_noise(&kept, &found, own_noise);
    let crest = if only_noise_left {
        0.0
    } else {
        surround::crest(scan, &found, &all)
    };
    let deviation = found
        .deviation(noise)
        .max(surround::apart(&found, &all, fold.is_free(), noise))
        .max(crest);
    surround::told(&found, found.deviation(noise).max(crest))
        .map_err(|why| Box::new((why, Some(found.shape))))?;
    Ok(Examined {
        peak: found.shape,
        unsteady,
        late,
        deviation,
        noise,
        explained: 1.0 - (found.squares / whole.squares).min(1.0),
        only_noise_left,
        fold: fold.with_level(found.level),
        folded: all.iter().filter(|(_, d)| is_folded(d)).count(),
        apart: scan.readings.len() - all.len(),
        unfolded,
    })
}

/// Some of many readings: all over the scan, and more densely around the brightest.
fn sample(scan: &Scan, data: &[Datum], whole: &Spread) -> Vec<Datum> {
    if data.len() <= ENOUGH {
        return data.to_vec();
    }
    let half = 0.5 * (whole.median + whole.top);
    let bright = data.iter().filter(|d| d.power > half).count();
    let reach = 3.0 * (bright as f64 / PI).sqrt() * scan.spacing();
    let by = |a: &&Datum, b: &&Datum| a.power.total_cmp(&b.power);
    let Some(top) = data.iter().max_by(by) else {
        return Vec::new();
    };
    let (near, far): (Vec<Datum>, Vec<Datum>) =
        data.iter().partition(|d| (d.at - top.at).norm() < reach);
    let mut some = Vec::new();
    for part in [near, far] {
        // An odd stride comes to all columns of most grids.
        let stride = part.len().div_ceil(ENOUGH).max(1) | 1;
        some.extend(part.into_iter().step_by(stride));
    }
    some
}

/// Whether a peak may be believed.
fn check(
    scan: &Scan,
    found: &Fit,
    all: &[(usize, Datum)],
    (noise, own_noise): (f64, f64),
    whole: &Spread,
) -> Result<(), Refusal> {
    let shape = &found.shape;
    let at = shape.at;
    let gained = (whole.squares - found.squares) / (noise * noise).max(f64::MIN_POSITIVE);
    if gained < SIGNIFICANT || found.squares >= whole.squares {
        let brightest = (whole.top - whole.median) / noise;
        return Err(Refusal::NoLight { brightest });
    }
    let unexplained = found.squares / whole.squares;
    let data: Vec<Datum> = all.iter().map(|(_, d)| *d).collect();
    let own = own_noise * own_noise;
    let unlike = left_over(&data, found, SEES) - own > (LIKE * shape.height).powi(2);
    if !leaves_noise(&data, found, own_noise) && (unexplained > 1.0 - MOSTLY || unlike) {
        return Err(Refusal::Shapeless { unexplained });
    }
    if shape.height < 0.0 {
        return Err(Refusal::Dark { at });
    }
    let seen = all
        .iter()
        .filter(|(_, d)| !d.at_least && shape.share(d.at) > SEES)
        .count();
    let (long, short, _) = shape.ellipse();
    let radius = (long * short).sqrt();
    if !scan.contains(shape.at) {
        return Err(Refusal::AtEdge { at });
    }
    if seen < SEEN {
        let spacing = scan.spacing();
        return Err(Refusal::TooCoarse {
            seen,
            spacing,
            radius,
        });
    }
    Ok(())
}

/// Takes out readings that stand apart from a fit as no light does, if they are few. Whether there
/// were any.
fn leave_out(all: &mut Vec<(usize, Datum)>, found: &Fit) -> bool {
    const FAR: f64 = 10.0;
    let off = |d: &Datum| {
        if d.at_least {
            return 0.0;
        }
        let model = d.sign * found.shape.power(d.at) + d.share * found.level;
        (d.power - model).abs()
    };
    let mut sizes: Vec<f64> = all.iter().map(|(_, d)| off(d)).collect();
    sizes.sort_by(f64::total_cmp);
    let usual = 1.4826 * sizes[sizes.len() / 2];
    let limit = FAR * usual + 0.05 * found.shape.height.abs();
    let apart = sizes.iter().filter(|size| **size > limit).count();
    // Many are no accident: the light has another shape.
    if apart == 0 || apart > few(all.len()) {
        return false;
    }
    all.retain(|(_, d)| off(d) <= limit);
    true
}

/// The readings with their light unfolded; those of which that is not known are left out.
pub(super) fn unfolded(scan: &Scan, examined: &Examined) -> Vec<(usize, Reading)> {
    scan.readings
        .iter()
        .zip(&examined.unfolded)
        .enumerate()
        .filter_map(|(k, (r, power))| power.map(|power| (k, Reading { power, ..*r })))
        .collect()
}
