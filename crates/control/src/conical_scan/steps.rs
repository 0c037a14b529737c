//! Steps of a piezo on the slope of a peak, which tell how its axis swings.

use super::{ConicalScan, Gap};
use crate::dynamics::StepSeen;
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use pigtail_hal::bench::Pose;
use pigtail_model::frames::Displacement;

impl ConicalScan<'_> {
    /// Steps to and fro beside the peak along a direction (of length one), each begun a cycle later between two samples of the light than the last, so that
    /// all together show the tip as often as there are cycles; and where the tip was seen. Then back to the peak.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub async fn step_beside(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        direction: Displacement,
    ) -> Result<Vec<StepSeen>, Halt> {
        let tuned = &TUNING.dynamics;
        let (width, peak) = (self.beam.width(gap), self.place(gap));
        let meter = self.watch.meter.0;
        let cycle = bench.caps().cycle;
        let apart = (bench.caps().channels[meter].rate * cycle).recip().round() as u32;
        // It goes as far aside as where light is steepest; what goes on from there is bright enough.
        let (near, far) = (
            peak + direction * (width * (tuned.beside - 0.5 * tuned.height)),
            peak + direction * (width * (tuned.beside + 0.5 * tuned.height)),
        );
        self.glide_to(bench, gap, peak).await?;
        self.last_for(bench, Gap::Steady(gap), tuned.each).await?;
        let (top, _) = bench.look(meter, tuned.top).await?;
        let top = top - self.watch.background;
        self.glide_to(bench, gap, near).await?;
        self.last_for(bench, Gap::Steady(gap), tuned.each).await?;
        let mut steps = Vec::with_capacity(tuned.steps as usize);
        for k in 0..tuned.steps {
            bench.next_light(meter).await?;
            bench.wait(f64::from(k % apart) * cycle).await?;
            let out = k % 2 == 0;
            let to = if out { far } else { near };
            bench.send_to(self.watch.group, Pose::at(to.x, to.y, 0.0), None)?;
            let mut step = StepSeen {
                time: bench.now(),
                way: if out { 1.0 } else { -1.0 },
                seen: Vec::new(),
            };
            while !bench.is_past(step.time + tuned.each) {
                let Some((time, volts)) = bench.sample(meter, step.time + tuned.each).await? else {
                    continue;
                };
                let fallen = top / (volts - self.watch.background).max(self.watch.noise);
                // Light falls as a Gaussian: its logarithm as the square of the way from the peak.
                step.seen.push((time, fallen.ln().max(0.0).sqrt()));
            }
            steps.push(step);
        }
        self.played = None;
        self.glide_to(bench, gap, peak).await?;
        Ok(steps)
    }
}
