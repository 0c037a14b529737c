//! The laser's power, where what a photodiode reads has an end.

use super::Shared;
use super::approach_moves::Aim;
use crate::cell::AlignmentCell;
use crate::conical_scan::ConicalScan;
use crate::job::Job;
use crate::outcome::Halt;
use crate::tuning::TUNING;
use pigtail_hal::Channel;

impl Shared<'_> {
    /// Lowers the laser's power where the photodiode would come near the end of its range at the chip, if it can be lowered: what is beyond it
    /// looks like a peak without a top. For the rest of the device, for what is attached already is as bright. Returns what `before` (volts at no
    /// gap) has become.
    pub(super) async fn dim(
        &mut self,
        job: &Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        before: f64,
    ) -> Result<f64, Halt> {
        let bright = scan.background() + before;
        let Some(share) = self.dimmed(cell, job.channel, bright)? else {
            return Ok(before);
        };
        scan.dim(share, self.dark[job.channel.index()].level.mean);
        let gap = aim.gap(cell);
        for _ in 0..TUNING.dark.forgets_power {
            scan.turn(cell, gap).await?;
        }
        Ok(share * before)
    }

    /// Lowers the laser's power where a photodiode reads as many volts as are near the end of its range, if it can be lowered. Returns to which share.
    pub(super) fn dimmed(
        &mut self,
        cell: &AlignmentCell<'_>,
        channel: Channel,
        bright: f64,
    ) -> Result<Option<f64>, Halt> {
        let caps = cell.caps();
        let (range, least) = (caps.channels[channel.index()].full_scale, caps.least_power);
        if bright < TUNING.dark.bright * range || self.power <= least || self.remembers(cell) {
            return Ok(None);
        }
        let was = f64::from(self.power);
        let percent = (was * TUNING.dark.dimmed * range / bright).max(f64::from(least));
        self.power = percent.round() as u8;
        cell.laser_power(self.power)?;
        self.dimmed_at = cell.now();
        Ok(Some(f64::from(self.power) / was))
    }

    /// Whether what photodiodes read may still be of the power before the laser was lowered.
    pub(super) fn remembers(&self, cell: &AlignmentCell<'_>) -> bool {
        cell.now() < self.dimmed_at + cell.forgets_laser(Channel::Sensing.index())
    }
}
