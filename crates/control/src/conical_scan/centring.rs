//! Circles to their peak: turns that look for it, go there, and are in its middle at last.

use super::follows::Follows;
use super::{ConicalScan, is_clear, stands_out};
use crate::beam::Peak;
use crate::outcome::{Halt, Outcome};
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use pigtail_hal::bench::Pose;
use pigtail_model::frames::Displacement;

impl ConicalScan<'_> {
    /// A turn at a steady gap, and the peak that stands out of its noise; none where one turn is `dark`, which it counts.
    ///
    /// # Errors
    ///
    /// As [`Self::step`]; [`Outcome::LightLost`] where it was not the first.
    pub(super) async fn seek(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        phase: &'static str,
        dark: &mut u32,
    ) -> Result<Option<Peak>, Halt> {
        self.turn(bench, gap).await?;
        let peak = self.peak();
        if !peak.is_some_and(is_clear) {
            *dark += 1;
            return if *dark > 1 {
                Err(self.lost(phase, peak.as_ref(), gap))
            } else {
                Ok(None)
            };
        }
        Ok(peak)
    }

    /// That there is no peak but at most this one, which does not stand out or is too far.
    pub(super) fn lost(&self, phase: &'static str, peak: Option<&Peak>, gap: f64) -> Halt {
        let level = peak.map_or(0.0, |peak| peak.full * self.beam.share(gap));
        // Of one far beside the circle any light may be made.
        let seen = self.readings.iter().map(|reading| reading.volts);
        Outcome::LightLost {
            phase,
            level: level.min(seen.fold(0.0, f64::max)),
            expected: TUNING.circle.significant * self.watch.noise,
        }
        .into()
    }

    /// That the circle's middle ran so far after the peak from where it was at the `start`, of which so many widths are accepted.
    pub(super) fn astray(
        &self,
        phase: &'static str,
        widths: f64,
        start: Displacement,
        gap: f64,
    ) -> Halt {
        Outcome::RanAfter {
            phase,
            by: (self.centre - start).norm(),
            accepted: widths * self.beam.width(gap),
        }
        .into()
    }

    /// Goes to a peak, at most its width at `gap` away. Returns how far it was away, metres.
    ///
    /// # Errors
    ///
    /// [`Outcome::MicroRange`] where the micro does not reach it.
    pub fn go_to(&mut self, bench: &Reactor<'_>, peak: &Peak, gap: f64) -> Result<f64, Outcome> {
        let by = peak.at - self.centre;
        let way = by.norm();
        let by = by * (TUNING.circle.stride * self.beam.width(gap) / way).min(1.0);
        let to = self.place(gap) + by;
        if !bench.reaches(self.watch.group, &Pose::at(to.x, to.y, 0.0)) {
            return Err(Outcome::MicroRange {
                side: self.arm(bench),
                x: to.x,
                y: to.y,
            });
        }
        self.shift(by);
        Ok(way)
    }

    /// Turns until the peak is where the circle's middle is, to `accuracy` metres, at a steady gap;
    /// at least `least` times.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::LightLost`] where there is no peak near where it was believed to be,
    /// [`Outcome::Unsure`] after too many turns.
    pub async fn centre(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        accuracy: f64,
        phase: &'static str,
        least: u32,
    ) -> Result<Peak, Halt> {
        let start = self.centre;
        let (mut dark, mut dim) = (false, Vec::new());
        let mut last = f64::INFINITY;
        let mut follows = Follows::default();
        for turn in 1..=self.shape.turns {
            self.turn(bench, gap).await?;
            let mut peak = self.clear_peak();
            if peak.is_none() {
                // Turns that are too dim by themselves tell together; what may be a peak is looked at for longer.
                dim.extend(&self.readings);
                let seen = self.beam.fit(&dim, self.watch.noise);
                let perhaps = seen.is_some_and(|peak| stands_out(peak, TUNING.circle.perhaps));
                if dark && !perhaps {
                    return Err(self.lost(phase, seen.as_ref(), gap));
                }
                peak = seen.filter(|peak| is_clear(*peak));
            }
            let Some(peak) = peak else {
                dark = true;
                continue;
            };
            dim.clear();
            // By what was seen, and not by what is made of it: what is no peak is seen anywhere.
            last = self.go_by(bench, &peak, gap, &mut follows)?;
            if turn >= least && last < accuracy && peak.deviation() < accuracy {
                return Ok(peak);
            }
            let far = (self.centre - start).norm();
            if far > TUNING.circle.far * self.beam.width(gap) {
                return Err(self.astray(phase, TUNING.circle.far, start, gap));
            }
        }
        Err(Outcome::Unsure {
            deviation: last,
            accuracy,
        }
        .into())
    }
}
