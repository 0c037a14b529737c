//! How much of an alignment's time each manipulator moves, and how much both do.

use super::produce::Sides;
use pigtail_control::station::{Observer, Sample};
use pigtail_hal::Side;
use pigtail_hal::spec::SIDES;
use pigtail_numerics::rounded;
use serde::Serialize;

/// What manipulators do of the time of an alignment, percent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Arms {
    /// Share in which a manipulator moves: from one light sample to the next an encoder of its macro tells of another count, or its micro is told
    /// to go elsewhere.
    pub moving_percent: Sides,
    /// The rest, in which it stands still: it has nothing to do, waits for the other one, or holds what the other one needs.
    pub idle_percent: Sides,
    /// Share in which both move.
    pub both_moving_percent: f64,
}

/// Counts samples on the way to another observer.
pub(crate) struct Counted<'o> {
    observer: &'o mut dyn Observer,
    last: Option<Sample>,
    moving: [u64; SIDES],
    both: u64,
    all: u64,
}

impl<'o> Counted<'o> {
    pub(crate) fn new(observer: &'o mut dyn Observer) -> Self {
        Self {
            observer,
            last: None,
            moving: [0; SIDES],
            both: 0,
            all: 0,
        }
    }

    /// What was counted; `None` before there were two samples.
    pub(crate) fn arms(&self) -> Option<Arms> {
        let percent = |n: u64| rounded(100.0 * n as f64 / self.all as f64, 1e-2);
        let of = |n: &dyn Fn(usize) -> u64| Sides {
            left: percent(n(Side::Left.index())),
            right: percent(n(Side::Right.index())),
        };
        (self.all > 0).then(|| Arms {
            moving_percent: of(&|side| self.moving[side]),
            idle_percent: of(&|side| self.all - self.moving[side]),
            both_moving_percent: percent(self.both),
        })
    }
}

impl Observer for Counted<'_> {
    fn phase(&mut self, port: &str, phase: &'static str, time: f64) {
        self.observer.phase(port, phase, time);
    }

    fn phase_over(&mut self, port: &str, phase: &'static str, time: f64) {
        self.observer.phase_over(port, phase, time);
    }

    fn sample(&mut self, sample: &Sample) {
        if let Some(last) = self.last.replace(*sample) {
            let moves: [bool; SIDES] = std::array::from_fn(|side| {
                sample.endpoints[side] != last.endpoints[side]
                    || sample.micro[side] != last.micro[side]
            });
            for (n, moves) in self.moving.iter_mut().zip(moves) {
                *n += u64::from(moves);
            }
            self.both += u64::from(moves == [true; SIDES]);
            self.all += 1;
        }
        self.observer.sample(sample);
    }

    fn trial(&mut self, start: usize, trial: u32, best: f64) {
        self.observer.trial(start, trial, best);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pigtail_control::station::Unobserved;
    use pigtail_hal::spec::CHANNELS;
    use pigtail_model::frames::{Displacement, Point};

    #[test]
    fn a_manipulator_moves_with_its_macro_or_with_its_micro() {
        let sample = |z_left: f64, x_right: f64| Sample {
            time: 0.0,
            light: [0.0; CHANNELS],
            endpoints: [Point::new(0.0, 0.0, z_left), Point::new(0.0, 0.0, 0.0)],
            micro: [Displacement::ZERO, Displacement::new(x_right, 0.0)],
        };
        let mut nobody = Unobserved;
        let mut counted = Counted::new(&mut nobody);
        assert_eq!(counted.arms(), None);
        // At rest, the left one's macro, both, the right one's micro.
        for (left, right) in [
            (0.0, 0.0),
            (0.0, 0.0),
            (1e-6, 0.0),
            (2e-6, 1e-7),
            (2e-6, 0.0),
        ] {
            counted.sample(&sample(left, right));
        }
        let arms = counted.arms().expect("four intervals");
        assert_eq!(
            (arms.moving_percent.left, arms.moving_percent.right),
            (50.0, 50.0)
        );
        assert_eq!(
            (arms.idle_percent.left, arms.idle_percent.right),
            (50.0, 50.0)
        );
        assert!((arms.both_moving_percent - 25.0).abs() < 1e-9);
    }
}
