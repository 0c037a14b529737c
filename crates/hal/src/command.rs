//! What control says in one servo cycle.

use crate::pulse::Pulse;
use crate::quantity::{Counts, Volts};
use crate::spec::{AXES, MICRO_AXES, SIDES};
use serde::{Deserialize, Serialize};

/// The outputs of control for one servo cycle. All are held constant until the next one, but for
/// pulses, which an amplifier plays out by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Motor voltage of each macro axis, indexed by `[side][axis]`.
    pub motors: [[Volts; AXES]; SIDES],
    /// A pulse that the amplifier of a macro axis begins to play at the start of this cycle, indexed
    /// by `[side][axis]`; `None` in nearly every cycle. While it lasts, into later cycles if need
    /// be, it stands in place of [`Self::motors`]; from the moment of its end, be that inside of a
    /// cycle, the held voltage acts again. One that begins takes the place of one that still plays.
    pub pulses: [[Option<Pulse>; AXES]; SIDES],
    /// Where the servo wants each macro axis to be in this cycle, encoder counts from home, indexed
    /// by `[side][axis]`; `None` where no servo holds it. Nothing follows it: a guard compares it
    /// with the encoder, which tells a following error where a voltage alone cannot.
    pub references: [[Option<Counts>; AXES]; SIDES],
    /// Amplifier input of each micro axis, indexed by `[side][micro axis]`.
    pub micro: [[Volts; MICRO_AXES]; SIDES],
    /// Whether the laser at the input fiber's far end is on.
    pub laser: bool,
    /// Its power where it is on, percent of its full power, one to a hundred; a machine whose laser cannot be set, or not so low
    /// ([`LaserSpec`](crate::spec::LaserSpec)), gives the nearest that it can.
    pub laser_percent: u8,
    /// What each holder does with its fiber, indexed by side; `None` in nearly every cycle.
    pub fiber: [Option<FiberHandling>; SIDES],
}

impl Command {
    /// No axis begins a pulse.
    pub const NO_PULSES: [[Option<Pulse>; AXES]; SIDES] = [[None; AXES]; SIDES];

    /// No axis is held by a servo.
    pub const NO_REFERENCES: [[Option<Counts>; AXES]; SIDES] = [[None; AXES]; SIDES];

    /// Motors without voltage, piezos at zero volts, laser off, holders as they are.
    pub const IDLE: Self = Self {
        motors: [[Volts(0.0); AXES]; SIDES],
        pulses: Self::NO_PULSES,
        references: Self::NO_REFERENCES,
        micro: [[Volts(0.0); MICRO_AXES]; SIDES],
        laser: false,
        laser_percent: 100,
        fiber: [None; SIDES],
    };
}

/// A step of the fiber handling that surrounds alignment.
///
/// The first three are over within the cycle: they leave out how a fiber gets into its holder and how adhesive cures. The
/// others take their time, and the machine says in [`Measurement::handled`](crate::Measurement::handled) when one is over; one
/// at a time for each holder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum FiberHandling {
    /// Take the fiber for this port from the tray into the empty holder. Ports count from zero on
    /// each side.
    Load(u8),
    /// Fix the held fiber to the chip where it stands, and let go of it.
    Attach,
    /// Put the held fiber back into the tray.
    Unload,
    /// Grip the fiber for this port at its place on the tray: of this device, or of the next once this one's is taken. May
    /// miss it.
    Pick(u8),
    /// Put so many nanolitres of adhesive on the tip of the held fiber.
    Wet(u8),
    /// The lamp on the bond of the held fiber, on or off.
    Lamp(bool),
    /// Open the holder: the fiber stays where its adhesive holds it.
    Release,
    /// Bring the next device of the tray before both manipulators. Both holders stand clear of it.
    Index,
}

/// How a step of the fiber handling ended that takes its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Handled {
    /// As it should.
    Done,
    /// There is nothing in the grip, or no next device.
    Missed,
}
