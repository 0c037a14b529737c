//! Finding light where none is known to be (thesis 3.2).

use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::recipe::{Raster, Sensing};
use crate::station::{Level, Station};
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::{Displacement, Macro, Point};
use std::f64::consts::TAU;

/// Where a search saw its brightest light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The macro's endpoint by its encoders.
    pub endpoint: Point<Macro>,
    /// The micro's displacement, metres.
    pub micro: Displacement,
    /// The light above the background, volts.
    pub level: f64,
}

/// What a search saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sweep {
    /// The brightest light, if any.
    pub hit: Option<Hit>,
    /// All that was seen.
    pub evidence: SearchEvidence,
}

/// Where light is searched, and with what.
#[derive(Debug, Clone, Copy)]
pub struct Searcher {
    /// The manipulator that moves.
    pub side: Side,
    /// The photodiode that watches.
    pub channel: Channel,
    /// The background before the search.
    pub background: Level,
    /// What counts as light, volts.
    pub threshold: f64,
}

impl Searcher {
    /// Measures the background where the manipulator stands for `seconds`; light is what exceeds
    /// it by `significance` standard deviations.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn measure(
        station: &mut Station,
        side: Side,
        channel: Channel,
        significance: f64,
        seconds: f64,
    ) -> Result<Self, Halt> {
        let background = station.level(channel, seconds)?;
        // A background that happens to look quiet is still read in steps of the converter.
        let sigma = background.sigma.max(station.spec().photodiode.step());
        let threshold = background.mean + significance * sigma;
        Ok(Self {
            side,
            channel,
            background,
            threshold,
        })
    }

    /// The Cartesian scan: the micro sweeps across in a sinusoid while the macro creeps upward
    /// to the height `top` by one mesh a period. Ends soon after first light, or at the top.
    ///
    /// The macro moves in one direction only, so that its transmissions stay wound up alike and
    /// what its encoders say of the hit can be found again.
    ///
    /// # Errors
    ///
    /// A fault, or [`Outcome::Refused`].
    pub fn raster(&self, station: &mut Station, raster: &Raster, top: f64) -> Result<Sweep, Halt> {
        let amplitude = (0.5 * raster.x).min(station.kinematics(self.side).micro_range_x());
        let start = station.wanted(self.side);
        let end = Point::new(start.x, top, start.z);
        station.start_line(self.side, end, Some(raster.mesh * raster.frequency))?;
        let begin = station.time();
        let sweep = |time: f64| {
            let phase = TAU * raster.frequency * (time - begin);
            Displacement::new(amplitude * phase.sin(), 0.0)
        };
        // Light is followed for two more periods, so that the spot's brightest line is seen.
        let follow = 2.0 / raster.frequency;
        let mut seen = self.watch(station, sweep, follow, |station| station.moving(self.side))?;
        seen.evidence.height = station.wanted(self.side).y - start.y;
        station.halt(self.side);
        seen.evidence.phase = "raster";
        seen.evidence.width = 2.0 * amplitude;
        Ok(seen)
    }

    /// How much brighter it is here than beside the spot, volts: light that comes through the
    /// guides is gone a few meshes further, a fluctuation of the background is not. Looks twice
    /// at either place, for the background wanders.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn contrast(&self, station: &mut Station, mesh: f64) -> Result<f64, Halt> {
        const SECONDS: f64 = 0.1;
        const LOOKS: u32 = 2;
        let here = station.micro(self.side);
        let way = if here.x > 0.0 { -4.0 } else { 4.0 };
        let aside = here + Displacement::new(way * mesh, 0.0);
        let mut contrast = 0.0;
        for _ in 0..LOOKS {
            for (at, sign) in [(here, 1.0), (aside, -1.0)] {
                station.move_micro(self.side, at);
                station.run(0.01)?;
                let level = station.level(self.channel, SECONDS)?.mean;
                contrast += sign * level / f64::from(LOOKS);
            }
        }
        station.move_micro(self.side, here);
        station.run(0.01)?;
        Ok(contrast)
    }

    /// A small scan with the micro alone, `reach` metres to each side of its centre: for light
    /// that was there a moment ago.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn micro_raster(
        &self,
        station: &mut Station,
        reach: f64,
        spacing: f64,
    ) -> Result<Sweep, Halt> {
        const FREQUENCY: f64 = 20.0;
        let begin = station.time();
        let duration = 2.0 * reach / (spacing * FREQUENCY);
        let path = |time: f64| {
            let elapsed = time - begin;
            Displacement::new(
                reach * (TAU * FREQUENCY * elapsed).sin(),
                reach * (2.0 * elapsed / duration - 1.0),
            )
        };
        let mut seen = self.watch(station, path, duration, |station| {
            station.time() < begin + duration
        })?;
        seen.evidence.width = 2.0 * reach;
        seen.evidence.height = 2.0 * reach;
        Ok(seen)
    }

    /// Moves the micro along `path` while `going`, and for `follow` seconds after first light.
    fn watch(
        &self,
        station: &mut Station,
        path: impl Fn(f64) -> Displacement,
        follow: f64,
        going: impl Fn(&Station) -> bool,
    ) -> Result<Sweep, Halt> {
        let mut hit: Option<Hit> = None;
        let mut end = f64::INFINITY;
        let (mut samples, mut brightest) = (0, f64::NEG_INFINITY);
        while going(station) && station.time() < end {
            let micro = path(station.time());
            station.move_micro(self.side, micro);
            station.cycle()?;
            let Some(volts) = station.light(self.channel) else {
                continue;
            };
            samples += 1;
            brightest = f64::max(brightest, volts);
            let level = volts - self.background.mean;
            if volts > self.threshold && hit.is_none_or(|hit| level > hit.level) {
                if hit.is_none() {
                    end = station.time() + follow;
                }
                hit = Some(Hit {
                    endpoint: station.endpoint(self.side),
                    micro,
                    level,
                });
            }
        }
        let evidence = SearchEvidence {
            phase: "local search",
            samples,
            width: 0.0,
            height: 0.0,
            brightest,
            dismissed: 0,
            threshold: self.threshold,
        };
        Ok(Sweep { hit, evidence })
    }
}

/// Moves the sensing fiber upward until it has passed the chip's top: until its light falls below
/// a share of the brightest level seen (thesis 3.2.2). The level is the mean of a few samples,
/// for the scattered light fluctuates.
///
/// # Errors
///
/// A fault; [`Outcome::Refused`]; [`Outcome::NoLight`] where there is no edge on the way.
pub fn edge_from_below(
    station: &mut Station,
    sensing: &Sensing,
    dark: &Level,
    significance: f64,
    height: f64,
) -> Result<(), Halt> {
    const SAMPLES: usize = 5;
    let (side, channel) = (Side::Right, Channel::Sensing);
    let start = station.wanted(side);
    station.start_line(side, start.shifted(0.0, height, 0.0), Some(sensing.speed))?;
    let threshold = dark.mean + significance * dark.sigma;
    let mut recent = [0.0; SAMPLES];
    let (mut samples, mut brightest) = (0, dark.mean);
    while station.moving(side) {
        let volts = station.next_light(channel)?;
        recent[samples % SAMPLES] = volts;
        samples += 1;
        if samples < SAMPLES {
            continue;
        }
        let level = recent.iter().sum::<f64>() / SAMPLES as f64;
        brightest = f64::max(brightest, level);
        let share = (level - dark.mean) / (brightest - dark.mean);
        if brightest > threshold && share < sensing.threshold {
            station.halt(side);
            return Ok(());
        }
    }
    Err(Outcome::NoLight(SearchEvidence {
        phase: "search for the chip's top",
        samples,
        width: 0.0,
        height,
        brightest,
        dismissed: 0,
        threshold,
    })
    .into())
}

/// Moves the sensing fiber, with the micro that carries it, across to the middle of the light
/// that comes out of the chip. Light was found, so some of it falls into the core already; where
/// that is only the rim, everything that follows would have to make do with little light.
///
/// # Errors
///
/// The machine's fault.
pub fn centre_sensing(station: &mut Station) -> Result<(), Halt> {
    const SECONDS: f64 = 0.8;
    const WINDOW: usize = 15;
    let (side, channel) = (Side::Right, Channel::Sensing);
    let reach = 0.95 * station.kinematics(side).micro_range_x();
    let across = |x: f64| Displacement::new(x, 0.0);
    station.move_micro(side, across(-reach));
    station.run(0.02)?;
    let begin = station.time();
    let mut seen: Vec<(f64, f64)> = Vec::with_capacity(1024);
    while station.time() < begin + SECONDS {
        let x = reach * (2.0 * (station.time() - begin) / SECONDS - 1.0);
        station.move_micro(side, across(x));
        station.cycle()?;
        if let Some(volts) = station.light(channel) {
            seen.push((x, volts));
        }
    }
    let smooth: Vec<(f64, f64)> = seen
        .windows(WINDOW)
        .map(|w| {
            (
                w[WINDOW / 2].0,
                w.iter().map(|s| s.1).sum::<f64>() / WINDOW as f64,
            )
        })
        .collect();
    let (low, high) = smooth
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| {
            (l.min(s.1), h.max(s.1))
        });
    let bright = smooth.iter().filter(|s| s.1 > 0.5 * (low + high));
    let (sum, n) = bright.fold((0.0, 0.0), |(sum, n), s| (sum + s.0, n + 1.0));
    station.move_micro(side, across(if n > 0.0 { sum / n } else { 0.0 }));
    station.run(0.02)?;
    Ok(())
}

/// Share of the light that was found which must still be there after a climb.
pub(crate) const STILL_THERE: f64 = 0.5;
