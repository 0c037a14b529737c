//! Where the holders were of late.

use pigtail_hal::quantity::Counts;
use pigtail_hal::spec::{AXES, SIDES};
use pigtail_hal::{Side, Spec};
use pigtail_model::frames::Displacement;

/// Cycles before a frame's exposure that are remembered, so that it is known how fast a holder went then, and where it was if the camera is later than it
/// says.
const BEFORE: usize = 64;

/// How a manipulator stood in one cycle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stand {
    /// By its encoders.
    pub(super) encoders: [Counts; AXES],
    /// What its transmissions held back, radians of the outputs.
    pub(super) windup: [f64; AXES],
    /// Where its micro was told to be, metres.
    pub(super) micro: Displacement,
}

/// Where both were, for as long as a frame may be late.
#[derive(Debug, Clone)]
pub(super) struct Past {
    recent: Vec<[Stand; SIDES]>,
    cycle: usize,
}

impl Past {
    pub(super) fn new(spec: &Spec) -> Self {
        let cycles = (spec.vision.oldest() * spec.servo.rate).ceil() as usize + BEFORE;
        let home = Stand {
            encoders: [Counts(0); AXES],
            windup: [0.0; AXES],
            micro: Displacement::ZERO,
        };
        Self {
            recent: vec![[home; SIDES]; cycles],
            cycle: 0,
        }
    }

    /// Notes where the holders are in this cycle.
    pub(super) fn note(&mut self, stands: [Stand; SIDES]) {
        self.cycle += 1;
        if self.cycle == self.recent.len() {
            self.cycle = 0;
        }
        self.recent[self.cycle] = stands;
    }

    /// Where the holder of a side was so many cycles ago, if that is remembered.
    pub(super) fn stand(&self, side: Side, ago: usize) -> Option<Stand> {
        let n = self.recent.len();
        (ago < n).then(|| self.recent[(self.cycle + n - ago) % n][side.index()])
    }
}
