//! A frequency response, made ready for modes.

use super::{POLES, Unknown};
use crate::timeline::counted;
use nalgebra::Complex;
use pigtail_numerics::signal::quantile;
use std::f64::consts::TAU;

/// Fewest points.
const LEAST: usize = 20;

/// More points are thinned.
const MOST: usize = 1500;

/// A point stands apart by so many of the usual deviations from the middle of its neighbours, and by so much of the
/// logarithm of magnitude; largest share of points that may.
const FAR: f64 = 8.0;
const LEAST_APART: f64 = 0.35;
const MOST_APART: f64 = 0.05;

/// Points are set aside where this share of the error is left at most.
pub(super) const ASIDE: f64 = 0.5;

/// A filter behind all of a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Filter {
    #[default]
    None,
    /// One real pole: a sensor, an amplifier.
    Pole,
    /// Butterworth's of two: what keeps a converter from folding.
    Two,
}

/// A frequency response.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Record {
    /// Hertz, rising.
    pub frequency: Vec<f64>,
    /// The response.
    pub response: Vec<Complex<f64>>,
    /// How much each point counts.
    pub weight: Vec<f64>,
    /// Whether modes have a part that goes with frequency, `s_k`.
    pub(super) skewed: bool,
    /// Whether its phase was measured; else the response is a magnitude, without a sign.
    pub(super) phased: bool,
    /// Real poles that stand behind the delay in what is searched, and most of them.
    pub(super) poles: usize,
    pub(super) most_poles: usize,
    /// Whether creep comes before the modes instead of beside them. Its share and the logarithm of its pole stand behind the real poles in
    /// what is searched.
    pub(super) creeping: bool,
    /// Whether it is a velocity's response, that of a place times its frequency.
    pub(super) rate: bool,
    /// The filter that all of it went through, whose number stands last in what is searched: how many times the highest frequency lies
    /// above its corner.
    pub(super) filter: Filter,
    /// How much counts what is left along each point's response and across it; real and imaginary parts, alike, if none.
    pub(super) lean: Option<[f64; 2]>,
}

/// Some of many points: half of those that are kept lie evenly, the others where the response changes most, for a narrow peak
/// is seen by few.
fn thinned(kept: Vec<usize>, response: &[Complex<f64>]) -> Vec<usize> {
    if kept.len() <= MOST {
        return kept;
    }
    let every = kept.len().div_ceil(MOST / 2);
    let usual = quantile(
        &kept.iter().map(|k| response[*k].norm()).collect::<Vec<_>>(),
        0.5,
    );
    let blocks: Vec<&[usize]> = kept.chunks(every).collect();
    // Of means, so that noise counts little, and by how much of the response is there.
    let change = |block: &[usize]| {
        let part = block.len().div_ceil(3).max(1);
        let means: Vec<f64> = block
            .chunks(part)
            .map(|p| p.iter().map(|k| response[*k].norm()).sum::<f64>() / p.len() as f64)
            .collect();
        let (low, high) = means
            .iter()
            .fold((f64::INFINITY, 0.0_f64), |(l, h), m| (l.min(*m), h.max(*m)));
        (high - low) / (low + usual)
    };
    let mut ranked: Vec<(f64, usize)> = blocks
        .iter()
        .enumerate()
        .map(|(i, block)| (change(block), i))
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut whole: Vec<usize> = ranked
        .iter()
        .take(MOST / 2 / every)
        .map(|(_, i)| *i)
        .collect();
    whole.sort_unstable();
    let of = |(i, block): (usize, &&[usize])| {
        if whole.binary_search(&i).is_ok() {
            block.to_vec()
        } else {
            vec![block[0]]
        }
    };
    blocks.iter().enumerate().flat_map(of).collect()
}

impl Record {
    /// Points of frequency (Hz), response and weight; those without a value are left out.
    ///
    /// # Errors
    ///
    /// When they are too few, or frequencies are not above zero and rising.
    pub fn new(
        frequency: &[f64],
        response: &[Complex<f64>],
        weight: Option<&[f64]>,
    ) -> Result<Self, Unknown> {
        let whole = |k: &usize| {
            frequency[*k].is_finite() && response[*k].re.is_finite() && response[*k].im.is_finite()
        };
        // What is there twice is one point.
        let again =
            |k: usize| k > 0 && frequency[k] == frequency[k - 1] && response[k] == response[k - 1];
        let mut kept: Vec<usize> = (0..frequency.len())
            .filter(|k| whole(k) && !again(*k))
            .collect();
        // A response at no frequency at all has no phase to speak of.
        kept.retain(|k| frequency[*k] != 0.0);
        if kept.len() < LEAST {
            return Err(Unknown::all(format!(
                "it has {}; wanted are at least {LEAST}",
                counted(kept.len(), "point")
            )));
        }
        if let Some(w) = kept.windows(2).find(|w| frequency[w[1]] <= frequency[w[0]]) {
            return Err(Unknown::all(format!(
                "frequency {} Hz comes after {} Hz: it must rise throughout",
                frequency[w[1]], frequency[w[0]]
            )));
        }
        if frequency[kept[0]] < 0.0 {
            return Err(Unknown::all("it has frequencies below zero"));
        }
        let kept = thinned(kept, response);
        let sizes: Vec<f64> = kept.iter().map(|k| response[*k].norm()).collect();
        let floor = 0.1 * quantile(&sizes, 0.5);
        if sizes.iter().all(|s| *s <= 0.0) {
            return Err(Unknown::all("the response is zero throughout"));
        }
        let given =
            |k: usize| weight.map_or(1.0, |w| if w[k].is_finite() { w[k].max(0.0) } else { 0.0 });
        Ok(Self {
            frequency: kept.iter().map(|k| frequency[*k]).collect(),
            response: kept.iter().map(|k| response[*k]).collect(),
            weight: kept
                .iter()
                .zip(&sizes)
                .map(|(k, size)| given(*k) / (size + floor))
                .collect(),
            skewed: false,
            phased: true,
            poles: 0,
            most_poles: POLES,
            creeping: false,
            rate: false,
            filter: Filter::None,
            lean: None,
        })
    }

    /// The same of magnitudes alone: modes can be told from them, a delay cannot.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn of_magnitude(
        frequency: &[f64],
        magnitude: &[f64],
        weight: Option<&[f64]>,
    ) -> Result<Self, Unknown> {
        // Nothing has no logarithm.
        let response: Vec<Complex<f64>> = magnitude
            .iter()
            .map(|m| Complex::new(if *m > 0.0 { *m } else { f64::NAN }, 0.0))
            .collect();
        let record = Self::new(frequency, &response, weight)?;
        Ok(Self {
            phased: false,
            ..record
        })
    }

    /// Whether its phase was measured.
    pub fn is_phased(&self) -> bool {
        self.phased
    }

    pub(super) fn points(&self, from: usize, every: usize) -> Self {
        Self {
            frequency: self
                .frequency
                .iter()
                .copied()
                .skip(from)
                .step_by(every)
                .collect(),
            response: self
                .response
                .iter()
                .copied()
                .skip(from)
                .step_by(every)
                .collect(),
            weight: self
                .weight
                .iter()
                .copied()
                .skip(from)
                .step_by(every)
                .collect(),
            skewed: self.skewed,
            phased: self.phased,
            poles: self.poles,
            most_poles: self.most_poles,
            creeping: self.creeping,
            rate: self.rate,
            filter: self.filter,
            lean: self.lean,
        }
    }

    /// Points whose magnitude stands apart from that of their neighbours on either side, if they are few.
    pub(super) fn apart(&self) -> Vec<usize> {
        let sizes: Vec<f64> = self
            .response
            .iter()
            .map(|h| h.norm().max(f64::MIN_POSITIVE).ln())
            .collect();
        let middle = |w: &[f64]| quantile(w, 0.5);
        let off: Vec<f64> = sizes.windows(5).map(|w| (w[2] - middle(w)).abs()).collect();
        let far = FAR * 1.4826 * quantile(&off, 0.5) + LEAST_APART;
        let apart: Vec<usize> = (0..off.len())
            .filter(|k| off[*k] > far)
            .map(|k| k + 2)
            .collect();
        if apart.len() as f64 > MOST_APART * sizes.len() as f64 {
            return Vec::new();
        }
        apart
    }

    /// The same without some points.
    pub(super) fn without(&self, points: &[usize]) -> Self {
        let kept = |k: &usize| points.binary_search(k).is_err();
        let pick: Vec<usize> = (0..self.frequency.len()).filter(kept).collect();
        Self {
            frequency: pick.iter().map(|k| self.frequency[*k]).collect(),
            response: pick.iter().map(|k| self.response[*k]).collect(),
            weight: pick.iter().map(|k| self.weight[*k]).collect(),
            ..self.clone()
        }
    }

    /// Number of modes in what is searched.
    pub(super) fn modes(&self, coded: &[f64]) -> usize {
        (coded.len() - 1 - self.poles - self.factors()) / 2
    }

    /// How many numbers of what is searched, its last ones, are of what comes before or behind all else.
    pub(super) fn factors(&self) -> usize {
        2 * usize::from(self.creeping) + usize::from(self.filter != Filter::None)
    }

    /// Real poles, Hz: those beside the modes, creep before them, a filter behind.
    pub(super) fn real_poles(&self, coded: &[f64]) -> Vec<f64> {
        let beside = &coded[2 * self.modes(coded) + 1..][..self.poles];
        let creep = self.creep(coded).map(|(_, pole)| pole / TAU);
        beside
            .iter()
            .map(|c| c.exp() / TAU)
            .chain(creep)
            .chain(self.corner(coded).filter(|_| self.filter == Filter::Pole))
            .collect()
    }

    /// The share of creep that comes before the modes, and its pole, rad/s.
    pub(super) fn creep(&self, coded: &[f64]) -> Option<(f64, f64)> {
        let at = coded.len() - self.factors();
        self.creeping.then(|| (coded[at], coded[at + 1].exp()))
    }

    /// Number of what is linear.
    pub(super) fn linear_parts(&self, coded: &[f64]) -> usize {
        let each = if self.skewed { 2 } else { 1 };
        each * self.modes(coded) + 3 + self.poles
    }

    /// Where the filter's corner lies by what is searched, Hz.
    pub(super) fn corner(&self, coded: &[f64]) -> Option<f64> {
        let above = coded.last().filter(|_| self.filter != Filter::None)?;
        Some(self.highest() / above)
    }

    pub(super) fn with_poles(&self, poles: usize) -> Self {
        Self {
            poles,
            ..self.clone()
        }
    }

    pub(super) fn highest(&self) -> f64 {
        self.frequency.last().copied().unwrap_or(1.0)
    }

    /// Delay by the median slope of the phase, in units of the inverse of the highest angular frequency.
    pub(super) fn delay(&self) -> f64 {
        let slopes: Vec<f64> = self
            .frequency
            .windows(2)
            .zip(self.response.windows(2))
            .map(|(f, h)| -(h[1] * h[0].conj()).arg() / (TAU * (f[1] - f[0])))
            .collect();
        quantile(&slopes, 0.5) * TAU * self.highest()
    }
}
