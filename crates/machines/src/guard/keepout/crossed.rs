//! Where something was of late, a place for each cycle, over and over.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::WHILE;

/// Where something was in x of late, metres: in each of so many cycles, over and over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossed {
    x: [f64; 2 * WHILE],
    at: usize,
}

impl Crossed {
    /// It has stood there.
    pub(super) fn at(x: f64) -> Self {
        Self {
            x: [x; 2 * WHILE],
            at: 0,
        }
    }

    #[inline(always)]
    pub(super) fn note(&mut self, x: f64) {
        self.at = (self.at + 1) % self.x.len();
        self.x[self.at] = x;
    }

    /// Where it was so many cycles ago, [`WHILE`] at most.
    #[inline(always)]
    pub(super) fn before(&self, cycles: usize) -> f64 {
        self.x[(self.at + self.x.len() - cycles) % self.x.len()]
    }
}
