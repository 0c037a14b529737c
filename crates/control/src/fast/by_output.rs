//! The input fiber by the light that comes out of an output's fiber, where the sensing fiber sees too little of it.
//!
//! A core that catches a spread beam in its rim sees a tenth of the light, or less: what takes three turns by all of it takes
//! three hundred by a tenth, where the noise is a photodiode's. But the fiber of the first output is to be brought to its peak
//! anyway. So the input fiber is brought near the chip, as well as dim light tells, and waits there for it. By the light through
//! both it then goes the rest of its way and is attached; and the other goes on from where it stands.

use super::Shared;
use super::approach_moves::{Aim, kept_off};
use super::resting::Resting;
use crate::cell::AlignmentCell;
use crate::conical_scan::{ConicalScan, Watch};
use crate::job::Job;
use crate::outcome::{Halt, Outcome};
use crate::tuning::TUNING;
use pigtail_hal::Channel;

/// A fiber that waits near its port, at its peak, not attached.
pub(super) struct Waiting<'r> {
    job: Job<'r>,
    scan: ConicalScan<'r>,
    /// The laser's power at which its light was seen, percent.
    power: u8,
}

impl<'r> Shared<'r> {
    /// Whether the input's light at its peak, at the gap of a search, is so dim that its last turns would take longer than it takes to bring another
    /// fiber.
    pub(super) fn is_dim(
        &self,
        job: &Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
    ) -> bool {
        let may_wait = self.may_wait && job.output.is_none() && !job.holds;
        let Some(peak) = scan.peak().filter(|_| may_wait) else {
            return false;
        };
        let most = if self.vision_tells(cell) {
            TUNING.pair.dim
        } else {
            TUNING.pair.dim_for_gap
        };
        // At the chip a spot is the brighter and the narrower.
        let share = cell.beam(aim.side, self.recipe).share(aim.gap(cell));
        peak.deviation() * share.powf(1.5) > most * self.fast.accuracy
    }

    /// The input fiber, from its peak at the gap of a search where there is light of `before` volts at no gap, to where it is attached, by the
    /// light of the first output's fiber, which then waits at its peak. Where that does not come to a good end, the sensing fiber comes
    /// back, and the input fiber to where its search starts.
    pub(super) async fn by_output(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        (scan, before): (ConicalScan<'r>, f64),
    ) -> Result<(), Halt> {
        let mut other = Job::of(self.recipe, Some(0));
        match self
            .through_both(job, &mut other, cell, aim, (scan, before))
            .await
        {
            Ok((scan, power)) => {
                self.waiting = Some(Waiting {
                    job: other,
                    scan,
                    power,
                });
                Ok(())
            }
            Err(Halt::Outcome(outcome)) => {
                self.may_wait = false;
                job.channel = Channel::Sensing;
                other.put_back(cell).await?;
                cell.brake(aim.side)?;
                job.withdraw(cell, aim.side).await?;
                // One that slipped as it was attached is not to be aligned any more.
                if cell.carries(aim.side) {
                    self.bring(job, cell, aim).await?;
                }
                Err(outcome.into())
            }
            fault => fault.map(|_| ()),
        }
    }

    async fn through_both(
        &mut self,
        job: &mut Job<'_>,
        other: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        (mut scan, before): (ConicalScan<'r>, f64),
    ) -> Result<(ConicalScan<'r>, u8), Halt> {
        self.wait_near(job, cell, aim, &mut scan, before).await?;
        let mut waiting = kept_off(cell, aim, Box::pin(self.bring_other(other, cell))).await?;
        let power = self.power;
        job.channel = other.channel;
        let mut attempt = 0;
        let waits = Aim::at_fiber(other);
        loop {
            let resting = (&mut waiting, waits);
            let attaching = self.attach_by(job, cell, aim, resting, attempt > 0);
            let result = kept_off(cell, &waits, Box::pin(attaching)).await;
            let again = attempt < self.fast.retry.unsure as usize
                && (self.again(&result, attempt) || self.learns_to_ask(cell, &result));
            if !again {
                return result.map(|()| (waiting, power));
            }
            attempt += 1;
        }
    }

    /// The input fiber to where it is attached, by the light of another that waits; once more from near the chip, if `again`.
    async fn attach_by(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        (waiting, waits): (&mut ConicalScan<'_>, Aim),
        again: bool,
    ) -> Result<(), Halt> {
        let watch = Watch {
            background: waiting.background(),
            noise: waiting.noise(),
            ..self.watch(aim.side, job.channel)
        };
        let mut scan = self.circles(cell, aim, watch, cell.micro(aim.side));
        let mut before = self.centre_again(job, cell, aim, &mut scan).await?;
        if again {
            self.come_to_wait(cell, aim, &mut scan, before).await?;
            before = self.centre_again(job, cell, aim, &mut scan).await?;
        }
        let radius = self.fast.conical_scan.radius;
        let mut resting = Resting::new(cell, waiting, (waits, radius));
        self.close(job, cell, aim, (scan, before), Some(&mut resting))
            .await
    }

    /// The first output's fiber to its peak near the chip, by the light that the input fiber gives where it waits.
    async fn bring_other(
        &mut self,
        other: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
    ) -> Result<ConicalScan<'r>, Halt> {
        let aim = Aim::at_fiber(other);
        let fast = self.fast;
        let change = async |_: &mut Job<'_>| self.change_fiber(cell, &aim, 0).await;
        other.phase(cell, "coarse", change).await?;
        let passes = fast.retry.passes.iter().filter(|pass| pass.sensing == 0.0);
        let (mut why, mut again) = (Outcome::NothingSearched, false);
        for pass in passes {
            let look = self.look(pass, fast.output_gap, fast.output_spacing, again);
            match self.find(other, cell, &aim, &look).await {
                Ok((mut scan, before)) => {
                    self.wait_near(other, cell, &aim, &mut scan, before).await?;
                    return Ok(scan);
                }
                Err(Halt::Outcome(outcome)) => (why, again) = (outcome, true),
                Err(fault) => return Err(fault),
            }
        }
        Err(why.into())
    }

    /// From the peak at the gap of a search, where there is light of `before` volts at no gap, to one at which nobody need doubt where the chip is,
    /// and to rest there.
    async fn wait_near(
        &self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        before: f64,
    ) -> Result<(), Halt> {
        job.phase(cell, "approach", async |job| {
            self.doubt(job, cell, aim, scan, before).await?;
            self.come_to_wait(cell, aim, scan, before).await?;
            scan.rest(cell, aim.gap(cell)).await
        })
        .await
    }

    /// To the gap at which fibers wait.
    async fn come_to_wait(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        before: f64,
    ) -> Result<(), Halt> {
        let beam = cell.beam(aim.side, self.recipe);
        let gap = beam.gap_of(TUNING.gap.quick_at);
        self.approach(cell, aim, scan, before, (gap, 1)).await
    }

    /// The peak of a fiber that has waited, from which it has crept meanwhile: its light at no gap, volts.
    async fn centre_again(
        &self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
    ) -> Result<f64, Halt> {
        job.phase(cell, "centre", async |_| {
            let gap = aim.gap(cell);
            let near = TUNING.circle.centred * scan.beam_width(gap);
            let peak = scan.centre(cell, gap, near, "centre", 2).await?;
            Ok(peak.full)
        })
        .await
    }

    /// From where a fiber has waited to where it is attached.
    pub(super) async fn go_on(
        &mut self,
        job: &mut Job<'r>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        waiting: Waiting<'r>,
    ) -> Result<(), Halt> {
        let Waiting {
            job: begun,
            mut scan,
            power,
        } = waiting;
        *job = begun;
        if self.power != power {
            let dark = self.dark[job.channel.index()].level.mean;
            scan.dim(f64::from(self.power) / f64::from(power), dark);
        }
        scan.set_radius(self.fast.conical_scan.radius);
        let before = self.centre_again(job, cell, aim, &mut scan).await?;
        self.close(job, cell, aim, (scan, before), None).await
    }
}
