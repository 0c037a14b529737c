//! A place that swings to and fro, without that.

use crate::tuning::TUNING;

/// What follows a place, but not where that goes to and fro: a motor that sticks and slips jerks by several counts, its load does not go along, and
/// what follows each jerk shakes. It has as much play as the place has swung, there and back and once more; none before that.
///
/// ```text
/// place     /\/\/\/\/----      what follows     ------------
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Steady {
    /// What follows, metres.
    at: f64,
    /// Where the place's present swing began, and how far it has gone, metres.
    from: f64,
    to: f64,
    /// When that was, seconds.
    since: f64,
    /// How long the swings before that were, metres.
    before: [f64; 4],
    /// By how much the place may differ from what follows, to either side, metres.
    play: f64,
}

impl Steady {
    /// Of a place from now on, metres.
    pub(super) fn new(place: f64) -> Self {
        Self {
            at: place,
            from: place,
            to: place,
            ..Self::default()
        }
    }

    /// What follows a place where that is now, metres.
    pub(super) fn at(&self, place: f64) -> f64 {
        if self.play == 0.0 {
            place
        } else {
            self.at.clamp(place - self.play, place + self.play)
        }
    }

    /// The place has come to where it is at a time, metres and seconds.
    pub(super) fn follow(&mut self, place: f64, time: f64) {
        let forward = self.to >= self.from;
        if (place >= self.to) == forward {
            self.to = place;
        } else if (place - self.to).abs() > TUNING.swing.jerks {
            let swung = if time - self.since < TUNING.swing.jerk {
                (self.to - self.from).abs()
            } else {
                0.0
            };
            self.before.rotate_left(1);
            self.before[3] = swung;
            (self.from, self.to, self.since) = (self.to, place, time);
        }
        if self.before.iter().all(|swung| *swung > 0.0) {
            let most = self
                .before
                .iter()
                .fold(0.0, |most, swung| f64::max(most, *swung));
            self.play = self.play.max(0.5 * most);
        }
        self.at = self.at(place);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What follows some places, metres.
    fn follows(places: impl IntoIterator<Item = f64>) -> Vec<f64> {
        let mut steady = None;
        let each = places.into_iter().enumerate().map(|(k, place)| {
            let steady = steady.get_or_insert_with(|| Steady::new(place));
            steady.follow(place, 0.4e-3 * k as f64);
            steady.at
        });
        each.collect()
    }

    #[test]
    fn a_place_that_goes_on_or_comes_back_once_is_followed() {
        let brakes = |k: u32| 80e-6 * (1.0 - (-0.1 * f64::from(k)).exp());
        let beyond = |k: u32| -30e-6 * (0.1 * f64::from(k)).sin() * (-0.1 * f64::from(k)).exp();
        let places: Vec<f64> = (0..100).map(|k| brakes(k) + beyond(k)).collect();
        assert_eq!(follows(places.clone()), places);
        // Nor does it mind what an encoder's counts make of one.
        let counts: Vec<f64> = places
            .iter()
            .map(|p| (p / 1.25e-6).round() * 1.25e-6)
            .collect();
        assert_eq!(follows(counts.clone()), counts);
    }

    #[test]
    fn a_place_that_is_led_to_and_fro_is_followed() {
        let places: Vec<f64> = (0..1000)
            .map(|k| 20e-6 * (0.02 * f64::from(k)).sin())
            .collect();
        assert_eq!(follows(places.clone()), places);
    }

    #[test]
    fn what_swings_to_and_fro_is_followed_by_its_mean() {
        let swings = |k: u32| 10e-6 * (0.5 * f64::from(k)).sin();
        let places = (0..400).map(|k| 0.1e-6 * f64::from(k) + swings(k));
        let follows = follows(places);
        let last = &follows[100..];
        let back = last.windows(2).map(|w| (w[0] - w[1]).max(0.0)).sum::<f64>();
        assert!(back < 1e-9, "{back}");
        for (k, at) in last.iter().enumerate() {
            let mean = 0.1e-6 * (k + 100) as f64;
            assert!((at - mean).abs() < 10.1e-6, "{k}: {at}");
        }
    }
}
