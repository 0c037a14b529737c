//! The last turns at the chip, where a camera may come to know the gap meanwhile.

use super::Shared;
use super::approach_moves::Aim;
use crate::beam::{Beam, Peak};
use crate::cell::AlignmentCell;
use crate::conical_scan::{ConicalScan, Ready};
use crate::job::Job;
use crate::last_turns::{AtChip, Expected, Rest, last_turns};
use crate::outcome::Halt;
use crate::procedure::light_check;
use crate::rise::{Ripple, Rise};
use crate::still_there::LightCheck;
use crate::tuning::TUNING;
use pigtail_hal::Channel;

impl Shared<'_> {
    /// The last turns at the chip, and whether the light is what it should be, where `before`, at a gap `far` from it (metres), it seemed to be so
    /// much (volts, at no gap).
    pub(super) async fn finish(
        &self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        (before, far): (f64, f64),
    ) -> Result<Rest, Halt> {
        let least = self.least_light(cell, aim, before);
        let expected = Expected { before, far, least };
        let chip = Sighted {
            shared: self,
            cell,
            aim,
            channel: job.channel,
        };
        last_turns(job, cell, &chip, scan, &expected).await
    }
}

/// A fiber at the chip that a camera sees.
struct Sighted<'s, 'r, 'b> {
    shared: &'s Shared<'r>,
    cell: &'s AlignmentCell<'b>,
    aim: &'s Aim,
    channel: Channel,
}

impl AtChip for Sighted<'_, '_, '_> {
    fn beam(&self) -> Beam {
        self.cell.beam(self.aim.side, self.shared.recipe)
    }

    fn check(&self, scan: &ConicalScan<'_>) -> LightCheck {
        light_check(self.cell, self.channel, scan.background(), scan.noise())
    }

    async fn begin(&self, scan: &mut ConicalScan<'_>) -> Result<(), Halt> {
        scan.set_radius(self.shared.fast.conical_scan.radius);
        Ok(())
    }

    /// Until vision knows the gap, too, which is corrected. What it says of it later moves neither peak nor gap.
    async fn settle(
        &self,
        scan: &mut ConicalScan<'_>,
        accuracy: (f64, f64),
    ) -> Result<(Peak, f64), Halt> {
        let Self {
            shared, cell, aim, ..
        } = self;
        let begin = cell.now();
        let mut corrected = 0;
        loop {
            let ready = || match shared.learns_gap(cell, aim, begin) {
                true => Ready::NotYet,
                false if corrected < shared.fast.retry.gap && shared.is_off(cell, aim) => {
                    Ready::Elsewhere
                }
                false => Ready::Yes,
            };
            let gap = aim.gap(cell);
            let peak = match ready() {
                Ready::Elsewhere => None,
                _ => Some(scan.settle(cell, gap, accuracy, "final", &ready).await?),
            };
            match peak.filter(|_| ready() != Ready::Elsewhere) {
                Some(peak) => return Ok((peak, gap)),
                None => shared.correct_gap(cell, aim, scan).await?,
            }
            corrected += 1;
        }
    }

    fn is_elsewhere(&self) -> bool {
        let way = self.aim.gap(self.cell) - self.shared.recipe.approach.gap;
        way.abs() > TUNING.last.late * self.shared.fast.gap_tolerance || self.doubts_gap()
    }

    fn doubts_gap(&self) -> bool {
        self.shared.doubts_gap(self.cell, self.aim)
    }

    async fn ripple(&self, scan: &mut ConicalScan<'_>) -> Result<Option<Ripple>, Halt> {
        self.shared.ripple(self.cell, self.aim, scan).await
    }

    fn rise(&self, ripple: &Ripple) -> Option<Rise> {
        let rise = ripple.rise(self.aim.gap_by_encoders(self.cell));
        rise.map(|rise| rise.along_z(self.aim.side))
    }

    fn rests(&self, scan: &ConicalScan<'_>) {
        self.cell.has_flickered(scan.flicker());
    }
}
