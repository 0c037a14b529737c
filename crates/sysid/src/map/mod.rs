//! Search and peak on a scan that somebody has measured: power at places in a plane.
//!
//! No machine and no belief about the optics stands behind such a scan, so neither the width of
//! the light nor its noise is known beforehand; what the sweep and the conical scan of a station take
//! from a recipe has to come from the readings themselves.
//!
//! 1. [`Scan::new`]: readings that something can be made of;
//! 2. [`examine`]: the whole scan. Is there light, did the photodiode or its converter fold it, is
//!    the grid fine enough to say anything? What was folded is unfolded;
//! 3. [`look`]: one reading after the other, as a machine would take them: from the middle outward
//!    until there is light, then where a reading tells most about the peak's place.

mod examine;
mod fold;
mod gone;
mod late;
mod look;
mod parts;
mod shape;
mod surround;
mod unsteady;

pub use examine::{Examined, examine};
pub use fold::Fold;
pub use look::{Look, Looked, look};
pub use shape::Shape;
pub use unsteady::Unsteady;

use pigtail_model::frames::Displacement;

/// Power at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// The place: across and up.
    pub at: Displacement,
    /// Power, in whatever linear unit.
    pub power: f64,
}

/// Fewest readings that a peak (seven numbers) could be told from.
const FEWEST: usize = 16;

/// Readings over an area, in the order in which they were taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    readings: Vec<Reading>,
    middle: Displacement,
    half: Displacement,
    /// Whether each power is known to be of its own place.
    settled: bool,
}

/// Why nothing can be made of some readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Invalid {
    /// Which of `x`, `y` and `power`; empty where it is all of them.
    pub what: &'static str,
    /// What is the matter, and what would be accepted.
    pub why: &'static str,
}

impl Scan {
    /// Checks readings.
    ///
    /// # Errors
    ///
    /// Fewer than 16 readings; numbers that are not finite; readings along a line; the same power
    /// everywhere.
    pub fn new(readings: Vec<Reading>) -> Result<Self, Invalid> {
        let refuse = |what, why| Err(Invalid { what, why });
        if readings.len() < FEWEST {
            return refuse("", "has too few readings; accepted are 16 or more");
        }
        let finite = |r: &Reading| r.at.x.is_finite() && r.at.y.is_finite() && r.power.is_finite();
        if !readings.iter().all(finite) {
            return refuse("", "holds what is not finite; accepted are finite numbers");
        }
        let range = |of: fn(&Reading) -> f64| {
            let values = || readings.iter().map(of);
            (
                values().fold(f64::INFINITY, f64::min),
                values().fold(f64::NEG_INFINITY, f64::max),
            )
        };
        let (x, y, power) = (range(|r| r.at.x), range(|r| r.at.y), range(|r| r.power));
        if power.1 <= power.0 {
            let why = "is the same everywhere; accepted is a scan with light in it";
            return refuse("power", why);
        }
        let (low, high) = (Displacement::new(x.0, y.0), Displacement::new(x.1, y.1));
        let scan = Self {
            middle: (low + high) * 0.5,
            half: (high - low) * 0.5,
            readings,
            settled: false,
        };
        if scan.half.x <= 0.0 {
            return refuse("x", "never changes; accepted is a scan of an area");
        }
        if scan.half.y <= 0.0 {
            return refuse("y", "never changes; accepted is a scan of an area");
        }
        if scan.is_line() {
            let why = "lies along a line; accepted is a scan of an area";
            return refuse("", why);
        }
        Ok(scan)
    }

    /// The same where somebody says that each power is of its own place, or not: that the stage stood still for it, and its detector had settled.
    /// Light that trails along the way is not taken for a slow detector's then.
    #[must_use]
    pub fn settled(self, settled: bool) -> Self {
        Self { settled, ..self }
    }

    /// Whether all places lie along one line, to a thousandth of its length.
    fn is_line(&self) -> bool {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for r in &self.readings {
            let Displacement { x, y } = r.at - self.middle;
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
        let mean = 0.5 * (xx + yy);
        let apart = (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        (mean - apart) < 1e-6 * (mean + apart)
    }

    /// The readings.
    pub fn readings(&self) -> &[Reading] {
        &self.readings
    }

    /// The middle of the area.
    pub fn middle(&self) -> Displacement {
        self.middle
    }

    /// Half of the area's width and height.
    pub fn half(&self) -> Displacement {
        self.half
    }

    /// The distance of neighbours, were the readings spread evenly, metres.
    pub fn spacing(&self) -> f64 {
        let (w, h) = (2.0 * self.half.x, 2.0 * self.half.y);
        // Readings stand at the area's edges too: n by m of them divide it into (n-1) (m-1).
        let n = self.readings.len() as f64;
        let sides = 0.5 * (w + h);
        let (b, a) = (sides, n - 1.0);
        // (w/s + 1) (h/s + 1) = n, solved for s.
        (b + (b * b + a * w * h).sqrt()) / a
    }

    /// Whether a place lies within the scan's area.
    pub fn contains(&self, at: Displacement) -> bool {
        let from = at - self.middle;
        from.x.abs() <= self.half.x && from.y.abs() <= self.half.y
    }
}

/// Why no peak can be told from a scan: honest negatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Refusal {
    /// Nothing stands out of the noise.
    NoLight {
        /// The brightest reading above the background, in noises.
        brightest: f64,
    },
    /// The light has a minimum.
    Dark {
        /// Where it is.
        at: Displacement,
    },
    /// No one peak has such a shape, folded or not.
    Shapeless {
        /// The share of the readings' variance that the best explanation leaves.
        unexplained: f64,
    },
    /// Too few readings see the peak.
    TooCoarse {
        /// How many stand on it above a tenth of its height.
        seen: usize,
        /// The distance of neighbours, metres.
        spacing: f64,
        /// The radius at 1/e that the peak seems to have, metres.
        radius: f64,
    },
    /// The light still rises where the scan ends.
    AtEdge {
        /// Where the peak seems to be.
        at: Displacement,
    },
    /// It is brightest elsewhere than in the middle of the light: a ring, or a peak beside another.
    OffCentre {
        /// Where the middle of the light is.
        middle: Displacement,
        /// Where it is brightest.
        brightest: Displacement,
        /// The power in the middle, as a share of the brightest above the background.
        share: f64,
    },
    /// There is another peak.
    Several {
        /// Where the other one is.
        other: Displacement,
        /// Its height as a share of the highest one's.
        share: f64,
    },
    /// So much of the light is at the instrument's bound that its middle is not told.
    Saturated {
        /// The share of the readings on the light that are.
        share: f64,
    },
    /// The light or the places changed so much while it was scanned that the peak's place is not told.
    Unsteady {
        /// By how much the light of rows differs, rms, as a share of the peak.
        light: f64,
        /// How far aside of each other they are, rms, metres.
        aside: f64,
        /// How far off the peak may be, metres.
        deviation: f64,
    },
    /// It is bright at one reading and dark at the next: a part of the peak was not seen.
    Cut {
        /// About where.
        at: Displacement,
        /// At how many pairs of neighbours.
        steps: usize,
    },
    /// It is dark where the rest of the peak says that it would be bright: a part of it was not seen.
    Unseen {
        /// About where.
        at: Displacement,
        /// At how many readings.
        readings: usize,
    },
    /// Powers and places are not of the same readings.
    Late {
        /// By how many readings powers were written late; below zero early.
        readings: isize,
    },
    /// Light trails behind the peak along the way, as of a detector that is slower than the readings.
    Trails {
        /// About its time constant, readings.
        readings: f64,
    },
    /// There may be a peak, but its place is not told.
    Vague {
        /// Standard deviation of its place, metres.
        deviation: f64,
        /// The short radius that it seems to have, metres.
        radius: f64,
    },
}

impl Refusal {
    /// The word for it in tables and files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::NoLight { .. } => "no_light",
            Self::Dark { .. } => "dark",
            Self::Shapeless { .. } | Self::OffCentre { .. } | Self::Several { .. } => {
                "no_single_peak"
            }
            Self::Saturated { .. } => "saturated",
            Self::Vague { .. }
            | Self::Unsteady { .. }
            | Self::Cut { .. }
            | Self::Late { .. }
            | Self::Trails { .. }
            | Self::Unseen { .. } => "unsure",
            Self::TooCoarse { .. } => "too_coarse",
            Self::AtEdge { .. } => "at_edge",
        }
    }

    /// Why there may be a peak, and is not told.
    fn unsure(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unsteady {
                light,
                aside,
                deviation,
            } => write!(
                f,
                "rows or columns do not fit each other: their light differs by {:.0} %, and they are {:.3} um aside of each other; so the \
                 light or the stage changed while they were scanned, and the peak may be {:.3} um elsewhere",
                light * 100.0,
                aside * 1e6,
                deviation * 1e6
            ),
            Self::Cut {
                at: Displacement { x, y },
                steps,
            } => write!(
                f,
                "about {:.3}, {:.3} um the light is gone from one reading to the next, at {steps} pairs of neighbours, where it is \
                 bright on one side: the light or its detector was off for a part of the scan, or the scan is too coarse for so \
                 narrow a peak",
                x * 1e6,
                y * 1e6
            ),
            Self::Unseen {
                at: Displacement { x, y },
                readings,
            } => write!(
                f,
                "about {:.3}, {:.3} um it is dark at {readings} readings where the rest of the peak says that it would be bright: the \
                 light or its detector was off for a part of the scan",
                x * 1e6,
                y * 1e6
            ),
            Self::Late { readings } => write!(
                f,
                "powers and places are not of the same moments: with each power about {} readings {} the peak is told far better",
                readings.unsigned_abs(),
                if *readings > 0 { "earlier" } else { "later" }
            ),
            Self::Trails { readings } => write!(
                f,
                "in the order of the readings light trails behind the peak, as of a detector whose time constant is about {readings} of them, and the \
                 peak is that much late: scan slower, or to and fro and compare; --map-settled says that it is the light's own shape"
            ),
            Self::Vague { deviation, radius } => write!(
                f,
                "a peak may be there, of {:.3} um in radius, but its place is known to {:.3} um only",
                radius * 1e6,
                deviation * 1e6
            ),
            _ => Ok(()),
        }
    }
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoLight { brightest } => write!(
                f,
                "nothing has the shape of a peak; the brightest reading is {brightest:.1} \
                 times the noise above the background"
            ),
            Self::Dark {
                at: Displacement { x, y },
            } => write!(
                f,
                "the light has a minimum at {:.3}, {:.3} um and no peak",
                x * 1e6,
                y * 1e6
            ),
            Self::Shapeless { unexplained } => write!(
                f,
                "one peak leaves {:.0} % of the readings' variance, far more than noise: there are \
                 several, or the signal was folded in a way that nothing here explains",
                unexplained * 100.0
            ),
            Self::OffCentre {
                middle,
                brightest,
                share,
            } => write!(
                f,
                "it is brightest at {:.3}, {:.3} um, not in the middle of the light at {:.3}, {:.3} um, which has {:.0} \
                 % of that: a ring, several peaks, or light that was folded",
                brightest.x * 1e6,
                brightest.y * 1e6,
                middle.x * 1e6,
                middle.y * 1e6,
                share * 100.0
            ),
            Self::Several { other, share } => write!(
                f,
                "there are several peaks: beside the highest one there is another of {:.0} % of its height at {:.3}, \
                 {:.3} um",
                share * 100.0,
                other.x * 1e6,
                other.y * 1e6
            ),
            Self::Saturated { share } => write!(
                f,
                "the light is saturated: {:.0} % of the readings on the peak stand at one level, and its middle is \
                 not told by what is left of it; less light or less gain shows it",
                share * 100.0
            ),
            Self::Unsteady { .. }
            | Self::Cut { .. }
            | Self::Unseen { .. }
            | Self::Late { .. }
            | Self::Trails { .. }
            | Self::Vague { .. } => self.unsure(f),
            Self::TooCoarse {
                seen,
                spacing,
                radius,
            } => write!(
                f,
                "{seen} readings see the peak, six are needed; they are \
                 {:.3} um apart and it seems to be {:.3} um in radius: scan at {:.3} um or closer",
                spacing * 1e6,
                radius * 1e6,
                radius * 0.8e6
            ),
            Self::AtEdge {
                at: Displacement { x, y },
            } => write!(
                f,
                "the light still rises where the scan ends: the peak seems to be at {:.3}, {:.3} um",
                x * 1e6,
                y * 1e6
            ),
        }
    }
}

#[cfg(test)]
mod tests;
