//! The end of every procedure: whether the gap is sure, the bond, and whether the light is still there.

use super::{AtPeak, Job, outward};
use crate::belief::{Across, Place, UNSURE};
use crate::cell::AlignmentCell;
use crate::outcome::{Halt, Outcome};
use crate::station::Level;
use crate::tip_estimator::Tip;
use pigtail_hal::Side;
use pigtail_model::frames::{Chip, Point};

/// For how long light is looked at once a fiber is attached, seconds.
pub(crate) const ATTACHED_LOOK: f64 = 0.008;

/// Share of its light that may be missing then, beside noise.
const ATTACHED_LESS: f64 = 0.003;

/// So many times as much as it differs by from turn to turn the light may differ from one look to the other, over a bond's time: 4.5
/// standard deviations of a wandering laser.
const ATTACHED_FLICKER: f64 = 7.0;

/// Standard deviations of a sample while a bond sets that are noise.
const BONDED_NOISE: f64 = 6.0;

/// Standard deviations of the difference of two looks that are noise.
const ATTACHED_NOISE: f64 = 4.5;

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

/// Whether light has fallen between two looks, by more than it may, by a noise (volts) of its samples, and by how much it differs from one turn
/// of a circle to the next by itself, of its own.
pub(crate) fn has_fallen(
    cell: &AlignmentCell<'_>,
    before: f64,
    after: f64,
    noise: f64,
    flicker: f64,
) -> bool {
    let samples = (ATTACHED_LOOK * cell.spec().photodiode.rate).max(2.0);
    let noise = noise * (2.0 / samples).sqrt();
    let less = ATTACHED_LESS.hypot(ATTACHED_FLICKER * flicker);
    after < (1.0 - less) * before - ATTACHED_NOISE * noise
}

impl Job<'_> {
    /// Attaches the fiber where it stands, and looks whether its light is still what it was in the
    /// `last` look above the `background` (volts): what has moved since then would be believed to
    /// be good. The spread of that look is that of light which stays; a look in which something
    /// falls has a greater one.
    ///
    /// Where its place `across` is known, that is noted with the gap.
    pub(crate) async fn attach(
        &mut self,
        cell: &AlignmentCell<'_>,
        last: Level,
        background: f64,
        across: Option<Across>,
    ) -> Result<(), Halt> {
        let wanted = self.recipe.approach.gap;
        let place = |across| place_at(cell, self.side, self.port, wanted, across);
        self.sure_of_gap(place(Across::default()))?;
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
            });
            return Ok(());
        }
        let less = ATTACHED_LESS.hypot(ATTACHED_FLICKER * self.flicker);
        let least = cell.attach(self.side, self.channel).await? - background;
        let before = last.mean - background;
        // What moves while the bond sets is fixed somewhere on its way: its light at the end may be what it should be, all but.
        if least < (1.0 - less) * before - BONDED_NOISE * last.sigma {
            return Err(Outcome::Slipped {
                before,
                after: least,
            }
            .into());
        }
        let now = cell.level(self.channel, ATTACHED_LOOK).await?;
        let after = now.mean - background;
        if has_fallen(cell, before, after, last.sigma, self.flicker) {
            return Err(Outcome::Slipped { before, after }.into());
        }
        Ok(())
    }

    /// That the gap is all but certainly what it should be.
    fn sure_of_gap(&self, place: Option<Place>) -> Result<(), Outcome> {
        let Some(place) = place else {
            return Ok(());
        };
        let tolerance = self.recipe.accept.gap;
        let probability = place.outside_along(tolerance);
        if probability <= UNSURE {
            return Ok(());
        }
        Err(Outcome::UnsureGap {
            off: place.off,
            bound: place.bound,
            sigma: place.sigma,
            tolerance,
            probability,
            accepted: UNSURE,
        })
    }
}
