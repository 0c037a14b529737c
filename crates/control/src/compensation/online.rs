//! What a micro's piezos are found to do while it works: how much farther each goes than is believed of it (thesis 4.2.1, weights that
//! are learned in real time), by recursive least squares, for every model of hysteresis and for none.
//!
//! A piezo's stroke changes with age, heat and its amplifier; the shape of its loops hardly does. So what is learned is the
//! scale of what a model tells. Circles around a peak tell one thing of it, and surely: by how much more one piezo goes than the
//! other, for then the spot is oblong along the piezos, which modes are not. Whether both go farther or the spot is narrower they
//! do not tell apart, and whoever follows the peak need not know.

use crate::tuning::TUNING;
use pigtail_hal::spec::MICRO_AXES;

/// Something that was seen of both piezos: a sum of their logarithms, each so many times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Told {
    /// How many times each.
    pub row: [f64; MICRO_AXES],
    /// Their sum, beside what is made use of already.
    pub sum: f64,
    /// Its variance.
    pub variance: f64,
}

/// By how much farther the piezos of a micro go than is believed, as it is learned, and as it is made use of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnLine {
    /// Natural logarithms of how many times as far each goes.
    logarithms: [f64; MICRO_AXES],
    covariance: [[f64; MICRO_AXES]; MICRO_AXES],
    /// Those that are made use of...
    used: [f64; MICRO_AXES],
    /// ...what they are times, and were before...
    scales: [f64; MICRO_AXES],
    before: [f64; MICRO_AXES],
    /// ...and cycles that are left until they are, of those that it takes in all.
    left: (u32, u32),
    /// A place that this does not alter, metres along each piezo, and what a model is asked for there.
    pivot: [f64; MICRO_AXES],
    stands: [f64; MICRO_AXES],
}

impl Default for OnLine {
    fn default() -> Self {
        let usual = TUNING.piezos.usual * TUNING.piezos.usual;
        Self {
            logarithms: [0.0; MICRO_AXES],
            covariance: [[usual, 0.0], [0.0, usual]],
            used: [0.0; MICRO_AXES],
            scales: [1.0; MICRO_AXES],
            before: [1.0; MICRO_AXES],
            left: (0, 1),
            pivot: [0.0; MICRO_AXES],
            stands: [0.0; MICRO_AXES],
        }
    }
}

impl OnLine {
    /// How many times as far as is believed each piezo is taken to go; `None` as long as nothing that was learned is made use of.
    pub fn used(&self) -> Option<[f64; MICRO_AXES]> {
        (self.scales != [1.0; MICRO_AXES]).then_some(self.scales)
    }

    /// Takes in what was seen. What is not told anew is not forgotten.
    pub fn learn(&mut self, told: &Told) {
        let [a, b] = told.row;
        let along = |p: &[[f64; 2]; 2]| [p[0][0] * a + p[0][1] * b, p[1][0] * a + p[1][1] * b];
        let gain = along(&self.covariance);
        let known = a * gain[0] + b * gain[1];
        // It is never known less well than at first.
        let least = TUNING.piezos.usual * TUNING.piezos.usual * (a * a + b * b);
        let fades = (known / TUNING.piezos.forgetting).min(least.max(known)) - known;
        self.rank(gain, fades / (known * known));
        let known = known + fades;
        let gain = gain.map(|g| g * (known / (known - fades)));
        let seen = told.sum + a * self.used[0] + b * self.used[1];
        let error = seen - (a * self.logarithms[0] + b * self.logarithms[1]);
        let scale = (known + told.variance).recip();
        for (logarithm, g) in self.logarithms.iter_mut().zip(gain) {
            let [low, high] = TUNING.piezos.bounds.map(f64::ln);
            *logarithm = (*logarithm + scale * g * error).clamp(low, high);
        }
        self.rank(gain, -scale);
    }

    fn rank(&mut self, along: [f64; MICRO_AXES], times: f64) {
        for (row, a) in self.covariance.iter_mut().zip(along) {
            for (p, b) in row.iter_mut().zip(along) {
                *p += times * a * b;
            }
        }
    }

    /// Makes use of what was learned, where that is worth it, within so many cycles: about a place, metres along each piezo, which
    /// the tip does not leave. Whether it does.
    pub fn make_use(&mut self, place: [f64; MICRO_AXES], cycles: u32) -> bool {
        let [[p, q], [r, s]] = self.covariance;
        let surely = TUNING.piezos.surely * (p + s - q - r).max(0.0).sqrt();
        let by: [f64; MICRO_AXES] = std::array::from_fn(|i| self.logarithms[i] - self.used[i]);
        if (by[0] - by[1]).abs() < TUNING.piezos.worth.max(surely) {
            return false;
        }
        self.before = self.scales_now();
        self.stands = self.asked(place);
        self.pivot = place;
        self.used = self.logarithms;
        self.scales = self.used.map(f64::exp);
        self.left = (cycles.max(1), cycles.max(1));
        true
    }

    /// A cycle has passed.
    pub fn pass(&mut self) {
        self.left.0 = self.left.0.saturating_sub(1);
    }

    /// How many times as far as is believed each is taken to go at this moment.
    fn scales_now(&self) -> [f64; MICRO_AXES] {
        let (left, all) = self.left;
        if left == 0 {
            return self.scales;
        }
        let before = f64::from(left) / f64::from(all);
        std::array::from_fn(|i| self.scales[i] + before * (self.before[i] - self.scales[i]))
    }

    /// What a model is to be asked for, for displacements that are wanted along the piezos, metres.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    pub fn asked(&self, wanted: [f64; MICRO_AXES]) -> [f64; MICRO_AXES] {
        let scales = self.scales_now();
        std::array::from_fn(|i| self.stands[i] + (wanted[i] - self.pivot[i]) / scales[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The place of a tip whose piezos go so many times as far as believed, along each, metres.
    fn stands(online: &OnLine, strokes: [f64; MICRO_AXES], wanted: [f64; MICRO_AXES]) -> [f64; 2] {
        let asked = online.asked(wanted);
        [strokes[0] * asked[0], strokes[1] * asked[1]]
    }

    /// What a circle tells of them, known to 3 %.
    fn told(online: &OnLine, strokes: [f64; MICRO_AXES]) -> Told {
        let [p, q] = online.used.map(f64::exp);
        Told {
            row: [1.0, -1.0],
            sum: (strokes[0] / p).ln() - (strokes[1] / q).ln(),
            variance: 0.03 * 0.03,
        }
    }

    #[test]
    fn piezos_of_unlike_strokes_are_learned_and_the_tip_stays_where_it_is() {
        let (strokes, at) = ([1.2, 0.85], [11e-6, -7e-6]);
        let mut online = OnLine::default();
        let before = stands(&online, strokes, at);
        for _ in 0..3 {
            online.learn(&told(&online, strokes));
            if online.make_use(at, 10) {
                for _ in 0..10 {
                    let now = stands(&online, strokes, at);
                    assert!((now[0] - before[0]).abs() < 1e-15, "{now:?} {before:?}");
                    assert!((now[1] - before[1]).abs() < 1e-15, "{now:?} {before:?}");
                    online.pass();
                }
            }
        }
        // From there on both go equally far; how far, a circle does not tell.
        let way = |i: usize| {
            let mut to = at;
            to[i] += 1e-6;
            (stands(&online, strokes, to)[i] - before[i]) / 1e-6
        };
        let (p, q) = (way(0), way(1));
        assert!((p / q - 1.0).abs() < 0.02, "{p} {q}");
        assert!((p - (1.2_f64 * 0.85).sqrt()).abs() < 0.02, "{p}");
    }

    #[test]
    fn piezos_that_differ_little_are_left_as_they_are_bit_by_bit() {
        let mut online = OnLine::default();
        for _ in 0..20 {
            online.learn(&told(&online, [1.04, 0.98]));
            assert!(!online.make_use([1e-6, 2e-6], 10));
        }
        let wanted = [0.123_456e-6, -9.87e-6];
        assert_eq!(online.asked(wanted), wanted);
        assert_eq!(online.used(), None);
    }

    #[test]
    fn what_is_broken_is_learned_no_farther_than_a_bound() {
        let mut online = OnLine::default();
        for _ in 0..50 {
            online.learn(&told(&online, [1.0, 0.1]));
            online.make_use([0.0; MICRO_AXES], 1);
        }
        let [p, q] = online.used().expect("they differ");
        let [low, high] = TUNING.piezos.bounds;
        assert!(low * 0.999 < q && p < high * 1.001, "{p} {q}");
    }

    #[test]
    fn what_changes_is_followed() {
        let mut online = OnLine::default();
        for strokes in [[1.0, 1.0], [1.25, 0.9]] {
            for _ in 0..60 {
                online.learn(&told(&online, strokes));
                online.make_use([0.0; MICRO_AXES], 1);
            }
            let [p, q] = online.used.map(f64::exp);
            let [a, b] = strokes;
            assert!((p / q / (a / b) - 1.0).abs() < 0.05, "{p} {q} {strokes:?}");
        }
    }
}
