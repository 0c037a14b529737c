//! Whether light is still what it was foreseen to be.

use crate::outcome::{Halt, Outcome};
use crate::reactor::Reactor;
use crate::tuning::TUNING;

/// Light that is foreseen where a fiber stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foreseen {
    /// Above the background, volts.
    pub level: f64,
    /// Its standard deviation, volts.
    pub deviation: f64,
}

/// A meter of light without its `background`, volts, and how its light is looked at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LightCheck {
    pub(crate) meter: usize,
    pub(crate) background: f64,
    /// Standard deviation of a sample, volts.
    pub(crate) noise: f64,
    /// Samples of a look, at first.
    pub(crate) samples: usize,
    /// Share of its light that may be missing, beside noise.
    pub(crate) less: f64,
}

impl LightCheck {
    /// Looks at light until it is all but certainly there, or has fallen by more than noise may make of it: what is missing is told from
    /// noise the better the longer it is looked at. Returns what was seen, volts above the background, and whether it has fallen below
    /// any that was foreseen.
    ///
    /// # Errors
    ///
    /// As [`Reactor::look`].
    pub(crate) async fn look(
        &self,
        bench: &Reactor<'_>,
        foreseen: &[Foreseen],
    ) -> Result<(f64, bool), Halt> {
        let (mut sum, mut n) = (0.0, 0);
        loop {
            let samples = n.max(self.samples);
            let (mean, _) = bench.look(self.meter, samples).await?;
            sum += (mean - self.background) * samples as f64;
            n += samples;
            let light = sum / n as f64;
            let noise = self.noise / (n as f64).sqrt();
            let is_missing = |less: f64, deviations: f64| {
                foreseen.iter().any(|before| {
                    let missing = (1.0 - less) * before.level - light;
                    missing > deviations * before.deviation.hypot(noise)
                })
            };
            let fallen = is_missing(self.less, TUNING.bond.noise);
            if fallen
                || !is_missing(0.0, TUNING.bond.doubted)
                || n >= TUNING.bond.longer * self.samples
            {
                return Ok((light, fallen));
            }
        }
    }

    /// Looks at the light of a fiber that was attached, likewise.
    ///
    /// # Errors
    ///
    /// As [`Reactor::look`]; [`Outcome::Slipped`] where it has fallen.
    pub(crate) async fn stays(
        &self,
        bench: &Reactor<'_>,
        foreseen: &[Foreseen],
    ) -> Result<(), Halt> {
        let (after, fallen) = self.look(bench, foreseen).await?;
        if fallen {
            let before = foreseen[0].level;
            return Err(Outcome::Slipped { before, after }.into());
        }
        Ok(())
    }
}
