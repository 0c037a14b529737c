//! Where the manipulators stand in a cycle, and how far they have gone.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use pigtail_hal::spec::GuardSpec;
use pigtail_model::frames::{Chip, Displacement, Macro, Point};

/// Where the manipulators stand in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) struct Stand {
    /// When that was, seconds.
    pub(in super::super) time: f64,
    /// Endpoint in its own frame, metres.
    pub(in super::super) endpoint: Point<Macro>,
    /// Angles of its five-bar's outputs by their probes, radians, where the rig has them.
    pub(super) probed: Option<[f64; 2]>,
    /// How far ahead of where its motor has it the z-stage is by its probe, towards the chip, metres; nothing on a rig without.
    pub(in super::super) ahead: f64,
    /// The whole way that it has gone in x and in y, to and fro, metres.
    pub(super) gone: [f64; 2],
    /// What its micro was told to add to that.
    pub(super) micro: Displacement,
    /// Where the tip of a fiber without fault would be, chip's frame, metres.
    pub(in super::super) tip: Point<Chip>,
}

/// How far an endpoint has gone of late, metres, in its own frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in super::super) struct Way {
    /// Across, within [`WHILE`] cycles.
    pub(in super::super) across: f64,
    /// The same along.
    pub(in super::super) along: f64,
    /// Along, within [`AT_ONCE`] cycles.
    pub(super) at_once: f64,
}

/// What piezos may have kept to themselves of the way between two stands, metres: nothing sees where they are.
#[inline(always)]
pub(super) fn hidden_by_piezos(now: &Stand, then: &Stand) -> f64 {
    GuardSpec::HYSTERESIS * (now.micro - then.micro).norm()
}
