//! Finding light where none is known to be (thesis 3.2).

use crate::cell::AlignmentCell;
use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::recipe::{Raster, Sensing};
use crate::station::Level;
use crate::tuning::TUNING;
use crate::upward::{Facet, Upward};
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
    pub async fn measure(
        cell: &AlignmentCell<'_>,
        side: Side,
        channel: Channel,
        significance: f64,
        seconds: f64,
    ) -> Result<Self, Halt> {
        let background = cell.level(channel, seconds).await?;
        // A background that happens to look quiet is still read in steps of the converter.
        let sigma = background.sigma.max(cell.spec().photodiode.step());
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
    pub async fn raster(
        &self,
        cell: &AlignmentCell<'_>,
        raster: &Raster,
        facet: Facet,
        top: f64,
    ) -> Result<Sweep, Halt> {
        let reach = cell.micro_reach_x(self.side).within(raster.x, 1.0);
        let start = cell.wanted(self.side);
        let watched = (self.side, facet, reach);
        let speed = raster.mesh * raster.frequency;
        let mut way = Upward::start(cell, watched, top, speed).await?;
        let period = raster.frequency.recip();
        let sweep = |since: f64| {
            let phase = TAU * raster.frequency * since;
            Displacement::new(reach.at(phase.sin()), 0.0)
        };
        // Somewhat longer than the macro takes, which sets out slowly.
        let lines = ((top - start.y) / raster.mesh).max(0.0) + TUNING.search.more_lines;
        let knots = (lines * period, period / TUNING.search.knots);
        cell.micro_path(self.side, knots, sweep)?;
        // Light is followed for two more periods, so that the spot's brightest line is seen.
        let follow = 2.0 * period;
        let going = || way.goes_on();
        let mut seen = self.watch(cell, follow, f64::INFINITY, going).await?;
        seen.evidence.height = cell.wanted(self.side).y - start.y;
        cell.brake(self.side)?;
        seen.evidence.phase = "raster";
        seen.evidence.width = reach.width();
        Ok(seen)
    }

    /// How much brighter it is here than beside the spot, volts: light that comes through the
    /// guides is gone a few meshes further, a fluctuation of the background is not. Looks twice
    /// at either place, for the background wanders.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub async fn contrast(&self, cell: &AlignmentCell<'_>, mesh: f64) -> Result<f64, Halt> {
        let here = cell.micro(self.side);
        let way = if here.x > 0.0 { -4.0 } else { 4.0 };
        let aside = here + Displacement::new(way * mesh, 0.0);
        let mut contrast = 0.0;
        for _ in 0..TUNING.search.contrast_looks {
            for (at, sign) in [(here, 1.0), (aside, -1.0)] {
                cell.move_micro(self.side, at)?;
                cell.wait(0.01).await?;
                let level = cell.level(self.channel, TUNING.search.contrast).await?.mean;
                contrast += sign * level / f64::from(TUNING.search.contrast_looks);
            }
        }
        cell.move_micro(self.side, here)?;
        cell.wait(0.01).await?;
        Ok(contrast)
    }

    /// A small scan with the micro alone, `reach` metres to each side of its centre: for light
    /// that was there a moment ago.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub async fn micro_raster(
        &self,
        cell: &AlignmentCell<'_>,
        reach: f64,
        spacing: f64,
    ) -> Result<Sweep, Halt> {
        let frequency = TUNING.search.frequency;
        let duration = 2.0 * reach / (spacing * frequency);
        let path = |elapsed: f64| {
            Displacement::new(
                reach * (TAU * frequency * elapsed).sin(),
                reach * (2.0 * elapsed / duration - 1.0),
            )
        };
        let end = cell.now() + duration;
        let knots = (duration, (TUNING.search.knots * frequency).recip());
        cell.micro_path(self.side, knots, path)?;
        let mut seen = self.watch(cell, duration, end, || Ok(true)).await?;
        seen.evidence.width = 2.0 * reach;
        seen.evidence.height = 2.0 * reach;
        Ok(seen)
    }

    /// Watches the light while `going`, until a time, and for `follow` seconds after first light.
    async fn watch(
        &self,
        cell: &AlignmentCell<'_>,
        follow: f64,
        mut end: f64,
        mut going: impl FnMut() -> Result<bool, Outcome>,
    ) -> Result<Sweep, Halt> {
        let mut hit: Option<Hit> = None;
        let (mut samples, mut brightest) = (0, f64::NEG_INFINITY);
        while going()? && !cell.is_past(end) {
            let Some(volts) = cell.light(self.channel, end).await? else {
                continue;
            };
            samples += 1;
            brightest = f64::max(brightest, volts);
            let level = volts - self.background.mean;
            if volts > self.threshold && hit.is_none_or(|hit| level > hit.level) {
                if hit.is_none() {
                    end = end.min(cell.now() + follow);
                }
                hit = Some(Hit {
                    endpoint: cell.endpoint(self.side),
                    micro: cell.micro_at(self.side, cell.now()),
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
pub async fn edge_from_below(
    cell: &AlignmentCell<'_>,
    sensing: &Sensing,
    dark: &Level,
    significance: f64,
    height: f64,
) -> Result<(), Halt> {
    const SAMPLES: usize = TUNING.search.edge;
    let (side, channel) = (Side::Right, Channel::Sensing);
    let start = cell.wanted(side);
    cell.start_line(side, start.shifted(0.0, height, 0.0), Some(sensing.speed))?;
    let threshold = dark.mean + significance * dark.sigma;
    let mut recent = [0.0; SAMPLES];
    let (mut samples, mut brightest) = (0, dark.mean);
    while cell.is_moving(side) {
        let volts = cell.next_light(channel.index()).await?;
        recent[samples % SAMPLES] = volts;
        samples += 1;
        if samples < SAMPLES {
            continue;
        }
        let level = recent.iter().sum::<f64>() / SAMPLES as f64;
        brightest = f64::max(brightest, level);
        let share = (level - dark.mean) / (brightest - dark.mean);
        if brightest > threshold && share < sensing.threshold {
            cell.brake(side)?;
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
pub async fn centre_sensing(cell: &AlignmentCell<'_>) -> Result<(), Halt> {
    let seconds = TUNING.search.centring;
    let window = TUNING.search.centring_window;
    let (side, channel) = (Side::Right, Channel::Sensing);
    let reach = cell.micro_reach_x(side).within(f64::INFINITY, 0.95);
    let across = |x: f64| Displacement::new(x, 0.0);
    cell.move_micro(side, across(reach.low))?;
    cell.wait(0.02).await?;
    let mut seen: Vec<(f64, f64)> = Vec::with_capacity(1024);
    let end = cell.now() + seconds;
    cell.micro_path(side, (seconds, seconds), |_| across(reach.high))?;
    while !cell.is_past(end) {
        if let Some(volts) = cell.light(channel, end).await? {
            seen.push((cell.micro_at(side, cell.now()).x, volts));
        }
    }
    let smooth: Vec<(f64, f64)> = seen
        .windows(window)
        .map(|w| {
            (
                w[window / 2].0,
                w.iter().map(|s| s.1).sum::<f64>() / window as f64,
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
    cell.move_micro(side, across(if n > 0.0 { sum / n } else { 0.0 }))?;
    cell.wait(0.02).await?;
    Ok(())
}
