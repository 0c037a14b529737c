//! Finding light where none is known to be (thesis 3.2).

use crate::outcome::{Halt, SearchEvidence};
use crate::recipe::{Raster, Sensing};
use crate::station::{Level, Station};
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::{Macro, Point};
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Where a search saw its brightest light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The macro's endpoint by its encoders.
    pub endpoint: Point<Macro>,
    /// The micro's displacement, metres.
    pub micro: (f64, f64),
    /// The light above the background, volts.
    pub level: f64,
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
    /// by one mesh a period. Ends soon after first light, or with the whole area seen.
    ///
    /// The macro moves in one direction only, so that its transmissions stay wound up alike and
    /// what its encoders say of the hit can be found again.
    ///
    /// # Errors
    ///
    /// A fault, or [`Outcome::OutOfReach`](crate::outcome::Outcome::OutOfReach).
    pub fn raster(
        &self,
        station: &mut Station,
        raster: &Raster,
    ) -> Result<Result<Hit, SearchEvidence>, Halt> {
        let amplitude = (0.5 * raster.x).min(station.kinematics(self.side).micro_reach_x());
        let height = raster.y + raster.overscan;
        let start = station.wanted(self.side);
        station.start_line(
            self.side,
            start.shifted(0.0, height, 0.0),
            Some(raster.mesh * raster.frequency),
        )?;
        let begin = station.time();
        let sweep = |time: f64| {
            (
                amplitude * (TAU * raster.frequency * (time - begin)).sin(),
                0.0,
            )
        };
        // Light is followed for two more periods, so that the spot's brightest line is seen.
        let follow = 2.0 / raster.frequency;
        self.watch(station, sweep, follow, |station| station.moving(self.side))
            .map(|watched| {
                station.halt(self.side);
                watched.map_err(|(samples, brightest)| SearchEvidence {
                    phase: "raster",
                    samples,
                    width: 2.0 * amplitude,
                    height,
                    brightest,
                    threshold: self.threshold,
                })
            })
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
    ) -> Result<Result<Hit, SearchEvidence>, Halt> {
        const FREQUENCY: f64 = 20.0;
        let begin = station.time();
        let duration = 2.0 * reach / (spacing * FREQUENCY);
        let path = |time: f64| {
            let elapsed = time - begin;
            (
                reach * (TAU * FREQUENCY * elapsed).sin(),
                reach * (2.0 * elapsed / duration - 1.0),
            )
        };
        self.watch(station, path, duration, |station| {
            station.time() < begin + duration
        })
        .map(|watched| {
            watched.map_err(|(samples, brightest)| SearchEvidence {
                phase: "local search",
                samples,
                width: 2.0 * reach,
                height: 2.0 * reach,
                brightest,
                threshold: self.threshold,
            })
        })
    }

    /// Moves the micro along `path` while `going`, and for `follow` seconds after first light.
    /// The brightest sample, or how many were seen and how bright the brightest of them was.
    fn watch(
        &self,
        station: &mut Station,
        path: impl Fn(f64) -> (f64, f64),
        follow: f64,
        going: impl Fn(&Station) -> bool,
    ) -> Result<Result<Hit, (usize, f64)>, Halt> {
        let mut best: Option<Hit> = None;
        let mut end = f64::INFINITY;
        let (mut samples, mut brightest) = (0, f64::NEG_INFINITY);
        while going(station) && station.time() < end {
            let (x, y) = path(station.time());
            station.move_micro(self.side, x, y);
            station.cycle()?;
            let Some(volts) = station.light(self.channel) else {
                continue;
            };
            samples += 1;
            brightest = f64::max(brightest, volts);
            let level = volts - self.background.mean;
            if volts > self.threshold && best.is_none_or(|best| level > best.level) {
                if best.is_none() {
                    end = station.time() + follow;
                }
                best = Some(Hit {
                    endpoint: station.endpoint(self.side),
                    micro: (x, y),
                    level,
                });
            }
        }
        Ok(best.ok_or((samples, brightest)))
    }
}

/// Moves the sensing fiber upward until it has passed the chip's top: until its light falls below
/// a share of the brightest level seen (thesis 3.2.2). The level is the mean of a few samples,
/// for the scattered light fluctuates.
///
/// # Errors
///
/// A fault, or [`Outcome::OutOfReach`](crate::outcome::Outcome::OutOfReach).
pub fn edge_from_below(
    station: &mut Station,
    sensing: &Sensing,
    dark: &Level,
    significance: f64,
    height: f64,
) -> Result<Result<(), SearchEvidence>, Halt> {
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
            return Ok(Ok(()));
        }
    }
    Ok(Err(SearchEvidence {
        phase: "search for the chip's top",
        samples,
        width: 0.0,
        height,
        brightest,
        threshold,
    }))
}

/// The level of a peak of relative radius one, seen one radius off in each of two directions and
/// one more: what a hit may fall to before it counts as lost.
pub(crate) const STILL_THERE: f64 = 0.25 * FRAC_1_SQRT_2;
