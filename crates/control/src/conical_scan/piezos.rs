//! What circles tell of the piezos that play them: by how much more one goes than the other. The spot is oblong along them then.

use super::{ConicalScan, Gap};
use crate::beam::{Peak, Reading};
use crate::compensation::online::Told;
use crate::outcome::Halt;
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use pigtail_model::frames::Displacement;

impl ConicalScan<'_> {
    /// Takes in what the last turn around a `peak` tells of the piezos' strokes. Whether they are taken for others from now on:
    /// then the next turn is the first that counts.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub(super) async fn learn_piezos(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        peak: &Peak,
    ) -> Result<bool, Halt> {
        if !self.shape.learn {
            return Ok(false);
        }
        let side = self.arm(bench);
        let axes = bench.voltage(|machine| {
            let along = |x, y| {
                machine
                    .kinematics(side)
                    .along_piezos(Displacement::new(x, y))
            };
            let [of_x, of_y] = [along(1.0, 0.0), along(0.0, 1.0)];
            [0, 1].map(|i| Displacement::new(of_x[i], of_y[i]))
        });
        let noise = self.watch.noise;
        let readings: &[Reading] = self.readings.make_contiguous();
        let Some((share, variance)) =
            axes.and_then(|axes| self.beam.oblong_along(readings, peak, noise, axes))
        else {
            return Ok(false);
        };
        let share = share.clamp(-TUNING.circle.most_oblong, TUNING.circle.most_oblong);
        // Of strokes that are as p to q it is (p^2 - q^2) / (p^2 + q^2).
        let slope = (1.0 - share * share).recip();
        let told = Told {
            row: [1.0, -1.0],
            sum: share.atanh(),
            variance: slope * slope * variance + TUNING.circle.oblong * TUNING.circle.oblong,
        };
        let (at, within) = (self.place(gap), TUNING.circle.glide * self.period);
        let used = bench.voltage(|machine| machine.learn_micro(side, &told, at, within));
        if used != Some(true) {
            return Ok(false);
        }
        self.last_for(bench, Gap::Steady(gap), within).await?;
        self.readings.clear();
        Ok(true)
    }
}
