//! The end of every procedure: whether the gap is sure, the bond, and whether the light is still there.

use super::outward;
use crate::belief::{Across, Place};
use crate::cell::AlignmentCell;
use crate::job::{AtPeak, Job};
use crate::outcome::Halt;
use crate::station::Level;
use crate::still_there::{Foreseen, LightCheck};
use crate::tip_estimator::Tip;
use crate::tuning::TUNING;
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::{Chip, Point};

/// Where the fiber of a side is believed to be before a port, beyond a gap that is wanted (metres), where its place across is
/// known so well; `None` before it was seen.
pub(crate) fn place_at(
    cell: &AlignmentCell<'_>,
    side: Side,
    port: Point<Chip>,
    wanted: f64,
    across: Across,
) -> Option<Place> {
    let seen = cell.seen(side, Tip::Fiber)?;
    let holder = cell.holder(side);
    Some(Place {
        across,
        off: outward(side) * (holder.z + seen.z - port.z) - wanted,
        bound: seen.bound_z,
        sigma: seen.sigma_z(),
    })
}

/// How the light at rest of a photodiode with such a background and noise (volts) is looked at.
pub(crate) fn light_check(
    cell: &AlignmentCell<'_>,
    channel: Channel,
    background: f64,
    noise: f64,
) -> LightCheck {
    let meter = channel.index();
    let rate = cell.caps().channels[meter].rate;
    LightCheck {
        meter,
        background,
        noise,
        samples: ((TUNING.bond.look * rate).round() as usize).max(2),
        less: TUNING.bond.less,
    }
}

impl Job<'_> {
    /// Attaches the fiber where it stands, if its gap is sure, and looks whether its light stays what it was in the `last` look above the
    /// `background` (volts), and what it was `foreseen` to be ([`Job::bond`]).
    ///
    /// Where its place `across` is known, that is noted with the gap.
    pub(crate) async fn attach(
        &mut self,
        cell: &AlignmentCell<'_>,
        last: Level,
        background: f64,
        (foreseen, across): (Option<Foreseen>, Option<Across>),
    ) -> Result<(), Halt> {
        let wanted = self.recipe.approach.gap;
        let place = |across| place_at(cell, self.side, self.port, wanted, across);
        if let Some(place) = place(Across::default()) {
            place.sure_along(self.recipe.accept.gap)?;
        }
        self.place = across.and_then(place);
        if self.holds {
            let exit = self.recipe.ports.exit_angle.tan();
            let frame = cell.frame(self.side);
            let a = frame.macro_from_chip(self.port);
            let b = frame.macro_from_chip(self.port.shifted(exit, 0.0, 0.0));
            let off = place(Across::default()).map_or(0.0, |place| place.off);
            self.at_peak = Some(AtPeak {
                side: self.side,
                channel: self.channel,
                level: last,
                background,
                across,
                beam: cell.beam(self.side, self.recipe),
                gap: wanted + off,
                walk: b.across() - a.across(),
                room: cell.room_before(self.side, self.port.z, 0.0).unwrap_or(0.0),
            });
            return Ok(());
        }
        cell.gives_away(self.side);
        let check = light_check(cell, self.channel, background, last.sigma);
        self.bond(cell, check, last, foreseen).await
    }
}
