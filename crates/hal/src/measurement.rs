//! What a machine measures in one servo cycle.

use crate::command::Handled;
use crate::quantity::{Counts, Volts};
use crate::spec::{AXES, CHANNELS, SIDES};

/// The inputs of control after one servo cycle.
///
/// Sensors slower than the servo are `Some` only in the cycle in which a new value arrives, and
/// carry the time at which it was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Machine time at the end of the cycle, seconds since power-on.
    pub time: f64,
    /// Motor encoder of each macro axis, indexed by `[side][axis]`; zero at the home position.
    pub encoders: [[Counts; AXES]; SIDES],
    /// A new sample of the photodiodes.
    pub light: Option<LightSample>,
    /// A new frame of the vision system.
    pub vision: Option<VisionFrame>,
    /// Displacement of each axis's output from home by its probe, metres, indexed by
    /// `[side][axis]`; `None` on a rig without probes.
    pub probes: Option<[[f64; AXES]; SIDES]>,
    /// The step of the fiber handling that has ended in this cycle, indexed by side.
    pub handled: [Option<Handled>; SIDES],
    /// Whether a person asks the machine to stop: the red button, or Ctrl-C at a simulated one.
    pub stop: bool,
}

/// One sample of all photodiodes, taken at the same moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightSample {
    /// When it was taken, seconds since power-on.
    pub time: f64,
    /// Photodiode amplifier output after the A/D converter, indexed by
    /// [`Channel`](crate::spec::Channel).
    pub volts: [Volts; CHANNELS],
}

/// What the vision system above the chip saw in one frame.
///
/// It looks down the y axis, so it sees x and z and nothing of y. Positions are those of fiber
/// tips in the chip's frame: x across the chip, z along the waveguide from the input facet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VisionFrame {
    /// When the frame was exposed, seconds since power-on. It arrives later.
    pub time: f64,
    /// The tip of each held fiber, indexed by side; `None` where the holder is empty.
    pub fiber: [Option<TipFix>; SIDES],
    /// The tip of the sensing fiber.
    pub sensing: TipFix,
}

/// One fiber tip as the vision system sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipFix {
    /// Across the chip, metres.
    pub x: f64,
    /// Along the waveguide, metres.
    pub z: f64,
    /// Standard deviation of the independent noise of one frame, metres.
    pub sigma: f64,
}
