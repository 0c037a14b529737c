//! A fiber that rests at its peak while another one is looked at by the light that goes through both.
//!
//! Chips and holders warm, and piezos creep: within some tens of seconds a tip that rests is a good part of its spot from its peak, and the light that
//! the other one is looked at by has gone. So it comes back from time to time.

use super::approach_moves::Aim;
use crate::cell::AlignmentCell;
use crate::conical_scan::ConicalScan;
use crate::outcome::Halt;
use crate::tuning::TUNING;

/// A fiber that rests at its peak.
pub(super) struct Resting<'h, 's> {
    scan: &'h mut ConicalScan<'s>,
    aim: Aim,
    /// Of the circles by which it comes back, in widths of its peak.
    radius: f64,
    /// When it came to rest, seconds.
    since: f64,
}

impl<'h, 's> Resting<'h, 's> {
    /// One that has just come to rest before its port, after circles of a scan.
    pub(super) fn new(
        cell: &AlignmentCell<'_>,
        scan: &'h mut ConicalScan<'s>,
        (aim, radius): (Aim, f64),
    ) -> Self {
        let since = cell.now();
        Self {
            scan,
            aim,
            radius,
            since,
        }
    }

    /// Back to where its peak is by now, if it has rested for long. The `other` one, on circles at a gap (metres), rests meanwhile: the light of both
    /// tells of one at a time.
    ///
    /// # Errors
    ///
    /// As [`ConicalScan::centre`].
    pub(super) async fn come_back(
        &mut self,
        cell: &AlignmentCell<'_>,
        other: &mut ConicalScan<'_>,
        gap: f64,
    ) -> Result<(), Halt> {
        if !cell.is_past(self.since + TUNING.pair.rests) {
            return Ok(());
        }
        let radius = other.radius();
        other.rest(cell, gap).await?;
        to_its_peak(cell, self.scan, self.radius, self.aim.gap(cell)).await?;
        self.since = cell.now();
        other.set_radius(radius);
        Ok(())
    }
}

/// To where a peak is by now at a gap (metres), on circles of a radius in its widths, and to rest there.
pub(super) async fn to_its_peak(
    cell: &AlignmentCell<'_>,
    scan: &mut ConicalScan<'_>,
    radius: f64,
    gap: f64,
) -> Result<(), Halt> {
    scan.set_radius(radius);
    let near = TUNING.circle.centred * scan.beam_width(gap);
    scan.centre(cell, gap, near, "pair", 2).await?;
    scan.rest(cell, gap).await
}
