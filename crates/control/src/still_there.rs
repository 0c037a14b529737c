//! Whether light is still what it was foreseen to be, and the bond.

use crate::job::Job;
use crate::outcome::{Halt, Outcome};
use crate::reactor::{LONGEST, Reactor, refused};
use crate::station::Level;
use crate::tuning::TUNING;
use pigtail_hal::bench::{Event, Request};

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

/// For how many seconds to wait, `since` seconds after light was sampled that comes once a `period`, until a bond that begins sets
/// a `cycle` after light is sampled again.
fn until_seen(since: f64, bond: f64, period: f64, cycle: f64) -> f64 {
    let late = cycle - since - bond;
    // A half of a cycle more or less is no reason to wait for the next.
    ((late + 0.5 * cycle).rem_euclid(period) - 0.5 * cycle).max(0.0)
}

/// Attaches the fiber of an arm, and holds it until its bond has set. Returns the least light of a meter meanwhile, volts; infinity where that has
/// taken no sample.
pub(crate) async fn attached(bench: &Reactor<'_>, arm: usize, meter: usize) -> Result<f64, Halt> {
    let caps = bench.caps();
    // What gives way in a bond's last moments is still seen then; once it has set, the fiber's light tells of it no more.
    let period = caps.channels[meter].rate.recip();
    let since = bench.now() - bench.looked();
    bench
        .wait(until_seen(since, caps.bond, period, caps.cycle))
        .await?;
    let ticket = bench.request(Request::Attach { arm });
    let ticket = ticket.map_err(|why| refused(&why))?;
    let (mut least, end) = (f64::INFINITY, bench.now() + LONGEST);
    loop {
        match bench.next(end).await? {
            Event::Done(done) if done == ticket => return Ok(least),
            Event::Failed(failed, why) if failed == ticket => {
                return Err(Outcome::BenchFailed { why }.into());
            }
            Event::Light(light) => {
                bench.note_reading(light.time);
                let volts = light.volts[meter];
                least = if volts < least { volts } else { least };
            }
            Event::Time => {
                let why = format!("a bond has not set within {LONGEST} s");
                return Err(Outcome::BenchFailed { why }.into());
            }
            _ => {}
        }
    }
}

impl Job<'_> {
    /// Attaches the fiber where it stands, and looks whether its light is still what it was in the `last` look, and what it was `foreseen` to be
    /// before that: what has moved since then would be believed to be good. The spread of that look is that of light which stays; a look in
    /// which something falls has a greater one.
    pub(crate) async fn bond(
        &self,
        bench: &Reactor<'_>,
        check: LightCheck,
        last: Level,
        foreseen: Option<Foreseen>,
    ) -> Result<(), Halt> {
        let check = LightCheck {
            noise: last.sigma,
            less: check.less.hypot(TUNING.bond.flicker * self.flicker),
            ..check
        };
        let least = attached(bench, self.side.index(), check.meter).await? - check.background;
        let before = last.mean - check.background;
        let looked = Foreseen {
            level: before,
            deviation: last.sigma / (check.samples as f64).sqrt(),
        };
        // What moves while the bond sets is fixed somewhere on its way: its light at the end may be what it should be, all but.
        if least < (1.0 - check.less) * before - TUNING.bond.bonded_noise * last.sigma {
            return Err(Outcome::Slipped {
                before,
                after: least,
            }
            .into());
        }
        check
            .stays(bench, &[looked, foreseen.unwrap_or(looked)])
            .await
    }
}

#[cfg(test)]
mod tests {
    use super::until_seen;

    #[test]
    fn a_bond_sets_a_cycle_after_light_is_sampled() {
        let (period, cycle) = (2e-3, 0.4e-3);
        for since in [0.0, 0.3e-3, 0.4e-3, 1.1e-3, 1.9e-3, 7.7e-3] {
            for bond in [0.4e-3, 1e-3, 10e-3, 11.3e-3] {
                let wait = until_seen(since, bond, period, cycle);
                assert!((0.0..period).contains(&wait), "{since} {bond}: {wait}");
                let sets = since + wait + bond - cycle;
                let off = sets - period * (sets / period).round();
                assert!(off.abs() <= 0.5 * cycle + 1e-12, "{since} {bond}: {off}");
            }
        }
        // Light has just been sampled, and a bond takes five samples: a cycle later.
        assert!((until_seen(0.0, 10e-3, period, cycle) - cycle).abs() < 1e-12);
    }
}
