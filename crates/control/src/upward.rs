//! Ways upward before an inclined facet, on which light is searched for minutes.
//!
//! A stage that stands askew comes nearer to the chip on its way up, and what warms does as well; what a transmission lets out aside brings
//! a tip to where the facet stands out. Vision sees all of it: the holder goes back before who guards the machine would stop it.

use crate::cell::{AlignmentCell, Reach};
use crate::outcome::{Halt, Outcome};
use crate::tip_estimator::Tip;
use crate::tuning::TUNING;
use pigtail_hal::spec::GuardSpec;
use pigtail_hal::{Side, Spec};
use pigtail_model::frames::{Chip, Macro, Point};

/// The facet that a tip goes upward before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Its port.
    pub port: Point<Chip>,
    /// By how much it stands out for each metre in x.
    pub slope: f64,
}

/// A way upward.
pub(crate) struct Upward<'c, 'b> {
    cell: &'c AlignmentCell<'b>,
    side: Side,
    facet: Facet,
    /// How far the micro goes to either side meanwhile.
    reach: Reach,
    end: Point<Macro>,
    /// Metres a second.
    speed: f64,
    /// Whether it is on its way back from the chip.
    back: bool,
}

impl Facet {
    /// How much nearer a tip may come for who guards the machine, where its micro goes from one end of a reach to the other, metres; `None` before
    /// its first frame.
    fn room(&self, cell: &AlignmentCell<'_>, side: Side, reach: Reach) -> Option<f64> {
        let beside = self.beside(cell, side)?;
        let [bound, _] = cell.spec().vision.believed();
        let unsure = bound + GuardSpec::HYSTERESIS * (reach.high - reach.low);
        let out = |x: f64| self.stands_out(cell.spec(), beside + x, unsure);
        let out = out(reach.low).max(out(reach.high));
        Some(cell.room_before(side, self.port.z, 0.0)? - out)
    }

    /// How far it stands out at most from its port so far `beside` that, or `unsure` farther, both in metres; nothing where it recedes. It may be cut
    /// steeper than by design.
    pub(crate) fn stands_out(&self, spec: &Spec, beside: f64, unsure: f64) -> f64 {
        let steeper = spec.guard.steeper(self.slope);
        let out = self.slope * beside + self.slope.abs() * unsure;
        (out + steeper * (beside.abs() + unsure)).max(0.0)
    }

    /// A place of a holder, or one farther from the chip where the facet stands out before its tip there: in front of the port there is so much `room`
    /// for who guards the machine, metres.
    pub(crate) fn off(
        &self,
        cell: &AlignmentCell<'_>,
        side: Side,
        there: Point<Macro>,
        room: f64,
    ) -> Point<Macro> {
        let Some(beside) = self.beside(cell, side) else {
            return there;
        };
        let way = cell.frame(side).chip_from_macro(there).x - cell.holder(side).x;
        let [bound, _] = cell.spec().vision.believed();
        let out = self.stands_out(cell.spec(), beside + cell.micro(side).x + way, bound);
        there.shifted(0.0, 0.0, -(out + 2.0 * TUNING.gap.upward - room).max(0.0))
    }

    /// How far beside the port a tip stands by vision, its micro in its middle, metres.
    fn beside(&self, cell: &AlignmentCell<'_>, side: Side) -> Option<f64> {
        let seen = cell.seen(side, Tip::Fiber)?;
        Some(cell.holder(side).x + seen.x - self.port.x)
    }

    /// How far a tip is to go back that comes too near, metres; nothing where it does not.
    fn too_near(&self, cell: &AlignmentCell<'_>, side: Side, reach: Reach) -> f64 {
        let room = self.room(cell, side, reach).unwrap_or(f64::INFINITY);
        if room < TUNING.gap.upward {
            2.0 * TUNING.gap.upward - room
        } else {
            0.0
        }
    }

    /// How much nearer a tip may come where its micro is, farther aside than the port's light may be by vision: metres; as near as it likes where it may
    /// stand in that light.
    pub(crate) fn room_aside(&self, cell: &AlignmentCell<'_>, side: Side) -> f64 {
        let x = cell.micro(side).x;
        let reach = Reach { low: x, high: x };
        let [bound, _] = cell.spec().vision.believed();
        let aside = |beside: &f64| (beside + x).abs() > bound;
        let beside = self.beside(cell, side).filter(aside);
        let room = beside.and_then(|_| self.room(cell, side, reach));
        room.map_or(f64::INFINITY, |room| room - TUNING.gap.upward)
    }
}

impl<'c, 'b> Upward<'c, 'b> {
    /// Sets out for a height, metres, at a speed, metres a second, while the micro goes to either side; goes back before where that is too near.
    ///
    /// # Errors
    ///
    /// As [`AlignmentCell::go`].
    pub(crate) async fn start(
        cell: &'c AlignmentCell<'b>,
        (side, facet, reach): (Side, Facet, Reach),
        top: f64,
        speed: f64,
    ) -> Result<Self, Halt> {
        let nearer = facet.too_near(cell, side, reach);
        if nearer > 0.0 {
            let away = cell.wanted(side).shifted(0.0, 0.0, -nearer);
            cell.go(side, away).await?;
        }
        let here = cell.wanted(side);
        let end = Point::new(here.x, top, here.z);
        cell.start_line(side, end, Some(speed))?;
        Ok(Self {
            cell,
            side,
            facet,
            reach,
            end,
            speed,
            back: false,
        })
    }

    /// Whether it has not yet come to its end. It goes back where that is too near, and on from there.
    ///
    /// # Errors
    ///
    /// As [`AlignmentCell::start_line`].
    pub(crate) fn goes_on(&mut self) -> Result<bool, Outcome> {
        let (cell, side) = (self.cell, self.side);
        if !cell.is_moving(side) {
            if self.back {
                self.back = false;
                cell.start_line(side, self.end, Some(self.speed))?;
                return Ok(true);
            }
            return Ok(false);
        }
        if self.back {
            return Ok(true);
        }
        let nearer = self.facet.too_near(cell, side, self.reach);
        if nearer > 0.0 {
            let away = cell.wanted(side).shifted(0.0, 0.0, -nearer);
            self.end.z = away.z;
            cell.start_line(side, away, None)?;
            self.back = true;
        }
        Ok(true)
    }
}
