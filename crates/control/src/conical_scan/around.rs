//! Light that is not where it was to be, looked for on a circle farther out.

use super::{ConicalScan, Gap};
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use std::f64::consts::TAU;

impl ConicalScan<'_> {
    /// Once around where light was to be, on a circle of so many widths of the peak, slowly enough for a sample every width of the way; then to
    /// where it is brightest, if there is light. Returns whether there is.
    ///
    /// # Errors
    ///
    /// The bench's fault; [`Outcome::MicroRange`](crate::outcome::Outcome::MicroRange) where the micro does not reach it.
    pub async fn look_around(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        radius: f64,
    ) -> Result<bool, Halt> {
        let before = (self.radius, self.period, self.most);
        let rate = bench.caps().channels[self.watch.meter.0].rate;
        self.radius = radius;
        self.period = self.period.max(TAU * radius / rate);
        self.most = self.most.max((self.period * rate).round() as usize);
        self.readings.clear();
        let seen = self.see_around(bench, gap).await;
        (self.radius, self.period, self.most) = before;
        let old = self.readings.len().saturating_sub(self.most);
        self.readings.drain(..old);
        seen
    }

    async fn see_around(&mut self, bench: &Reactor<'_>, gap: f64) -> Result<bool, Halt> {
        self.run(bench, Gap::Steady(gap), TUNING.circle.around * self.period)
            .await?;
        let brightest = self
            .readings
            .iter()
            .max_by(|a, b| a.volts.total_cmp(&b.volts));
        let clear = brightest
            .filter(|reading| reading.volts > TUNING.circle.significant * self.watch.noise);
        if let Some(at) = clear.map(|reading| reading.at) {
            self.shift(at - self.centre);
            return Ok(true);
        }
        // Many dim readings together tell what none does alone.
        let Some(peak) = self.clear_peak() else {
            return Ok(false);
        };
        self.go_to(bench, &peak, gap)?;
        Ok(true)
    }
}
