//! Micros that swing for longer than anybody knows, as a camera sees it from frame to frame.
//!
//! A camera's frames are too far apart to tell at what frequency a micro swings, and tell well that it does: they show its tip where it was not told
//! to be, now on this side, now on that. Once it is left alone all that they differ by, beside the camera's noise, is what is left of that; so how much is
//! left some time later tells how fast it comes to rest. No light is needed for it, and no time: it is seen on the way, far from all that a tip could come
//! near to.

use crate::tip_estimator::Noise;
use crate::tuning::TUNING;
use pigtail_hal::bench::Tip;
use pigtail_model::frames::{Chip, Point};

/// What a frame shows of a tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shown {
    /// Which.
    pub(crate) tip: Tip,
    /// When it was exposed, seconds.
    pub(crate) time: f64,
    /// Where the tip was across, beside where holder and micro were told to be, metres.
    pub(crate) beside: f64,
    /// The camera's noise, square metres.
    pub(crate) noise: f64,
    /// How far the micro was told to go about then, metres, as much as the frame may be earlier or later than it says.
    pub(crate) span: f64,
    /// Where the holder was.
    pub(crate) holder: Point<Chip>,
}

/// How a tip swings, as far as frames have shown.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Swing {
    /// The last two frames, the last first.
    last: [Option<Shown>; 2],
    /// For how many its holder has been at rest or on a steady way.
    steady: u32,
    /// Whether anything was told to the micro by now.
    told: bool,
    /// By how much frames differed before that, in what the camera states of its noise.
    noise: Noise,
    /// The farthest that it was seen to swing, metres, and when, seconds.
    seen: Option<(f64, f64)>,
    /// What was shown since, with its holder at rest or on a steady way: time since then (seconds), place (metres), and variance.
    since: Vec<(f64, f64, f64)>,
}

impl Swing {
    /// Takes in a frame.
    pub(crate) fn note(&mut self, shown: Shown) {
        let tuned = &TUNING.ring_down;
        self.told |= shown.span > 0.5 * tuned.radius;
        // Transmissions wind up and let go where a holder sets out or stops, and go on at a steady pace where it does.
        let steady = |[one, two]: &[Shown; 2]| {
            let [a, b] = [two.holder, shown.holder];
            let middle = Point::new(0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.5 * (a.z + b.z));
            let alike = one.tip == shown.tip && two.tip == shown.tip;
            alike && middle.distance(one.holder) < tuned.steady
        };
        let [last, but_one] = self.last;
        let before = last
            .zip(but_one)
            .map(|(one, two)| [one, two])
            .filter(steady);
        self.steady = before.map_or(0, |_| self.steady + 1);
        if let Some([one, two]) = before {
            let way = shown.beside - 2.0 * one.beside + two.beside;
            let told = shown.span + 2.0 * one.span + two.span;
            let by = 0.25 * (way.abs() - told);
            // Before anything was told to the micro it is six times a camera's variance, which may be more than it states.
            if !self.told {
                self.noise.add(way / (6.0 * shown.noise).sqrt());
            }
            let noise = shown.noise * self.noise.times_beside(tuned.stated);
            let astray = tuned.astray.max(tuned.deviations * noise.sqrt());
            if self.steady >= tuned.settled
                && by > astray
                && self.seen.is_none_or(|(before, _)| by > before)
            {
                self.seen = Some((by, shown.time));
                self.since.clear();
            }
        }
        if let Some((_, time)) = self.seen
            && shown.span < tuned.astray
        {
            if self.steady < tuned.settled {
                self.since.clear();
            }
            self.since
                .push((shown.time - time, shown.beside, shown.noise));
        }
        self.last = [Some(shown), self.last[0]];
    }

    /// What is seen from now on stands elsewhere in the holder.
    pub(crate) fn is_another(&mut self) {
        self.last = [None; 2];
        self.steady = 0;
        self.since.clear();
    }

    /// How far it was seen to swing beyond what it was told, metres, if it was.
    pub(crate) fn by(&self) -> Option<f64> {
        self.seen.map(|(by, _)| by)
    }

    /// The longest time constant by which it comes to rest, seconds, that what was shown since it was seen to swing bears; `None` where that is too little.
    pub(crate) fn time_constant(&self) -> Option<f64> {
        let tuned = &TUNING.ring_down;
        let (height, _) = self.seen.filter(|_| self.since.len() >= tuned.frames)?;
        // Each time constant by how likely it makes what was seen, where frames fall anywhere in a period, and the camera is as noisy as suits it best.
        let unlike = |constant: f64| {
            let swings = |since: f64| 0.5 * (height * (-since / constant).exp()).powi(2);
            let noises = tuned.noises.into_iter();
            noises
                .map(|times| self.unlike(times * times, swings))
                .fold(f64::INFINITY, f64::min)
        };
        let [shortest, longest] = tuned.constants;
        let constants = || {
            let shares = (0..=tuned.steps).map(|k| f64::from(k) / f64::from(tuned.steps));
            shares.map(|share| shortest * (longest / shortest).powf(share))
        };
        let best = constants().map(unlike).fold(f64::INFINITY, f64::min);
        constants().rfind(|constant| unlike(*constant) < best + tuned.bears)
    }

    /// Minus twice the logarithm of how likely frames are that differ by so great a variance, by the time since it was seen to swing, beside so many times the
    /// noise that the camera states, squared.
    fn unlike(&self, times: f64, swings: impl Fn(f64) -> f64) -> f64 {
        let each = || {
            let shown = self.since.iter();
            shown.map(|(since, place, noise)| (*place, times * noise + swings(*since)))
        };
        let weights: f64 = each().map(|(_, variance)| variance.recip()).sum();
        let places = each().map(|(place, variance)| place / variance);
        let mean = places.sum::<f64>() / weights;
        let one = |(place, variance): (f64, f64)| (place - mean).powi(2) / variance + variance.ln();
        each().map(one).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const HEIGHT: f64 = 25e-6;
    const SIGMA: f64 = 0.7e-6;

    /// A frame that shows a tip so far beside where it was told to be, with its holder at a height, metres.
    fn shown(beside: f64, y: f64, span: f64) -> Shown {
        Shown {
            tip: Tip::Fiber,
            time: 0.0,
            beside,
            noise: SIGMA * SIGMA,
            span,
            holder: Point::new(0.0, y, 0.0),
        }
    }

    /// A micro of so many hertz and so much damping that begins to swing after eight frames and is left alone, by frames 40 ms apart, the first so late, each off by its noise one
    /// way or the other.
    fn seen(resonance: f64, damping: f64, first: f64) -> Swing {
        let mut swing = Swing::default();
        for k in 0..28_u32 {
            let time = first + 0.04 * (f64::from(k) - 8.0);
            let height = if time < 0.0 { 0.0 } else { HEIGHT };
            let left =
                height * (-TAU * resonance * damping * time).exp() * (TAU * resonance * time).cos();
            let noise = if k % 3 == 0 { SIGMA } else { -SIGMA };
            let beside = 3e-6 - left + noise;
            let span = if k == 7 { 2e-6 } else { 0.0 };
            swing.note(Shown {
                time,
                ..shown(beside, 4e-6 * f64::from(k), span)
            });
        }
        swing
    }

    #[test]
    fn a_micro_that_swings_long_is_seen_to() {
        for resonance in [37.0, 43.0, 61.0, 118.0, 333.0] {
            for constant in [0.15, 0.3, 0.9] {
                for first in [0.001, 0.015, 0.03] {
                    let swing = seen(resonance, (TAU * resonance * constant).recip(), first);
                    let told = swing.time_constant();
                    let told =
                        told.unwrap_or_else(|| panic!("{resonance} Hz, {constant} s: {swing:?}"));
                    assert!(
                        (0.7 * constant..=1.0).contains(&told) && told < 7.0 * constant,
                        "{resonance} Hz, {constant} s: {told}"
                    );
                }
            }
        }
    }

    #[test]
    fn one_that_rests_is_not() {
        for resonance in [125.0, 200.0, 700.0] {
            assert_eq!(seen(resonance, 0.1, 0.03).by(), None);
        }
    }

    #[test]
    fn a_tip_that_goes_where_it_is_told_or_winds_up_does_not_swing() {
        let mut told = Swing::default();
        for k in 0..20 {
            let beside = if k % 2 == 0 { 45e-6 } else { -45e-6 };
            told.note(shown(beside, 4e-6 * f64::from(k), 49e-6));
        }
        assert_eq!(told.by(), None);
        // Its transmissions wind up, at a steady pace, and by a jerk where its holder sets out and stops.
        let mut winds_up = Swing::default();
        let frames = [
            (0.0, 0.0),
            (20e-6, 9e-6),
            (41e-6, 18e-6),
            (141e-6, 300e-6),
            (141e-6, 310e-6),
        ];
        for (beside, y) in frames {
            winds_up.note(shown(beside, y, 1e-6));
        }
        assert_eq!(winds_up.by(), None);
    }
}
