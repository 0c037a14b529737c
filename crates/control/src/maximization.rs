//! Staying at the peak (thesis 3.3): an output fiber at its port while something moves.
//!
//! The climb "allows the micro to reject low frequency disturbances such as movement of the macro
//! manipulator and drifting of the piezoelectric actuators", up to a rate of a step a pattern. Here
//! it is made to, and the circles of the fast procedure too.

use crate::cell::AlignmentCell;
use crate::conical_scan::{ConicalScan, Watch};
use crate::job::Job;
use crate::outcome::{Halt, Outcome};
use crate::peak::{NinePoint, corners};
use crate::procedure::lit;
use crate::recipe::{Climb, Recipe};
use crate::station::{Level, Station, fine};
use pigtail_hal::bench::Meter;
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::Displacement;

/// What keeps the fiber at the peak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Means {
    /// Nothing: the micro rests.
    Rest,
    /// Nine-point patterns, one after the other (Fig. 3.5).
    NinePoint(Climb),
    /// The circles of the fast procedure.
    Circles,
}

/// What takes the fiber off it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Disturbance {
    /// Nothing of the machine's doing: the device may drift by itself.
    Device,
    /// The macro moves in x at a speed, metres a second.
    Macro(f64),
    /// The piezos creep: a while before, the micro was so far away in x, metres.
    Piezos(f64),
}

/// A trial of staying at the peak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// What is done about it.
    pub means: Means,
    /// What happens.
    pub disturbance: Disturbance,
    /// Machine time at which it begins, seconds.
    pub begin: f64,
    /// How long it is watched, seconds.
    pub seconds: f64,
}

/// What control saw of a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed {
    /// The light at the peak before, volts above the dark.
    pub before: f64,
    /// The light at the end, volts above the dark.
    pub after: f64,
    /// The dark, volts.
    pub dark: f64,
    /// Machine time from which on the fiber was followed, seconds.
    pub begin: f64,
}

const SIDE: Side = Side::Right;
const CHANNEL: Channel = Channel::Output1;
/// Time for which a level of light is measured, seconds.
const LOOK: f64 = 0.1;
/// How long the micro stays away before piezos are watched creeping, seconds.
const AWAY: f64 = 5.0;

impl Means {
    /// The fastest peak that it could follow at all, metres a second: a step along an axis a pattern,
    /// `step / (9 dwell + pause)` (thesis 3.3). `None` where no such figure is to be had beforehand.
    pub fn limit(&self) -> Option<f64> {
        match self {
            Self::NinePoint(climb) => Some(climb.step / (9.0 * climb.dwell + climb.pause)),
            Self::Rest | Self::Circles => None,
        }
    }
}

/// Aligns the input and brings the first output's fiber to its peak as the thesis does, waits for the
/// trial's begin, follows the peak, and attaches the fiber where it then is.
///
/// # Errors
///
/// The machine's fault; why a fiber could not be brought to its peak; [`Outcome::MicroRange`] where
/// the peak left the micro's range; [`Outcome::TooLate`] where the trial was to begin before the fiber
/// was there.
pub fn follow(station: &mut Station, recipe: &Recipe, trial: &Trial) -> Result<Followed, Halt> {
    let cell = AlignmentCell::over(station);
    cell.run(followed(&cell, recipe, trial))
}

/// The first output's fiber at its peak, and the dark beside its light.
async fn at_peak(cell: &AlignmentCell<'_>, recipe: &Recipe) -> Result<Level, Halt> {
    lit(cell, recipe, recipe.last.accuracy).await?;
    output_at_peak(cell, recipe).await
}

/// The same where there is light in the guides already.
async fn output_at_peak(cell: &AlignmentCell<'_>, recipe: &Recipe) -> Result<Level, Halt> {
    Job::of(recipe, Some(0)).reach(cell).await?;
    cell.laser(false)?;
    cell.wait(0.02).await?;
    let dark = cell.level(CHANNEL, LOOK).await?;
    cell.laser(true)?;
    cell.wait(0.02).await?;
    Ok(dark)
}

async fn followed(
    cell: &AlignmentCell<'_>,
    recipe: &Recipe,
    trial: &Trial,
) -> Result<Followed, Halt> {
    let dark = at_peak(cell, recipe).await?;
    let here = cell.micro(SIDE);
    let away = match trial.disturbance {
        Disturbance::Piezos(away) => away,
        Disturbance::Device | Disturbance::Macro(_) => 0.0,
    };
    let left = trial.begin - cell.now() - if away == 0.0 { 0.0 } else { AWAY } - LOOK;
    if left < 0.0 {
        return Err(Outcome::TooLate {
            time: cell.now(),
            begin: trial.begin,
        }
        .into());
    }
    cell.wait(left).await?;
    let before = cell.level(CHANNEL, LOOK).await?.mean - dark.mean;
    if away != 0.0 {
        // To the side where there is more room.
        let sign = if here.x > 0.0 { -1.0 } else { 1.0 };
        cell.move_micro(SIDE, here + Displacement::new(sign * away, 0.0))?;
        cell.wait(AWAY).await?;
        cell.move_micro(SIDE, here)?;
        cell.wait(0.02).await?;
    }
    if let Disturbance::Macro(speed) = trial.disturbance {
        let end = cell.wanted(SIDE).shifted(speed * trial.seconds, 0.0, 0.0);
        cell.start_line(SIDE, end, Some(speed.abs()))?;
    }
    let begin = cell.now();
    let end = begin + trial.seconds;
    match trial.means {
        Means::Rest => cell.wait(trial.seconds).await?,
        Means::NinePoint(climb) => {
            let mut peak = NinePoint::new(&climb, cell, SIDE, CHANNEL);
            while cell.now() < end {
                peak.step(cell).await?;
            }
        }
        Means::Circles => {
            let watch = Watch {
                group: fine(SIDE),
                meter: Meter(CHANNEL.index()),
                background: dark.mean,
                noise: dark.sigma.max(cell.spec().photodiode.step()),
                still: dark.sigma,
                still_degrees: f64::INFINITY,
            };
            let gap = recipe.approach.gap;
            let beam = cell.beam(SIDE, recipe);
            let at = cell.micro(SIDE);
            let shape = &recipe.fast.conical_scan;
            let (still, before) = (Displacement::ZERO, cell.measured_shaking(SIDE));
            let mut scan = ConicalScan::new(watch, beam, shape, cell, (at, gap), still, before);
            while cell.now() < end {
                scan.turn(cell, gap).await?;
                if let Some(peak) = scan.peak() {
                    scan.go_to(cell, &peak, gap)?;
                }
            }
            scan.rest(cell, gap).await?;
        }
    }
    // The look is short: the peak goes on moving.
    let after = cell.level(CHANNEL, 0.02).await?.mean - dark.mean;
    cell.attach(SIDE, Channel::Sensing).await?;
    cell.brake(SIDE)?;
    Ok(Followed {
        before,
        after,
        dark: dark.mean,
        begin,
    })
}

/// Light at a place around the peak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Around {
    /// Across, from the peak, metres.
    pub x: f64,
    /// Up, from the peak, metres.
    pub y: f64,
    /// Volts above the dark.
    pub light: f64,
}

/// The light around the peak (Fig. 3.2): brings the input and the first output's fiber to their peaks as [`follow`]
/// does, and moves the one of `side` by its micro over a square that reaches `half` (metres) to all sides,
/// `points` to a line, every line in the same direction. The peak itself comes first.
///
/// # Errors
///
/// The machine's fault; why a fiber could not be brought to its peak; [`Outcome::ProfileRange`] where the
/// square leaves the micro's range.
pub fn profile(
    station: &mut Station,
    recipe: &Recipe,
    side: Side,
    half: f64,
    points: usize,
) -> Result<Vec<Around>, Halt> {
    let cell = AlignmentCell::over(station);
    cell.run(profiled(&cell, recipe, side, half, points))
}

async fn profiled(
    cell: &AlignmentCell<'_>,
    recipe: &Recipe,
    side: Side,
    half: f64,
    points: usize,
) -> Result<Vec<Around>, Halt> {
    /// Time at a point, of which the last part counts, seconds.
    const DWELL: f64 = 0.012;
    if side == Side::Left {
        // The input is to stay in its holder.
        cell.laser(true)?;
        Job::of(recipe, None).reach(cell).await?;
    } else {
        lit(cell, recipe, recipe.last.accuracy).await?;
    }
    let dark = output_at_peak(cell, recipe).await?.mean;
    let here = cell.micro(side);
    if let Some(Displacement { x, y }) = corners(half)
        .map(|corner| here + corner)
        .into_iter()
        .find(|at| !cell.micro_reaches(side, *at))
    {
        return Err(Outcome::ProfileRange { x, y }.into());
    }
    let look = async |x: f64, y: f64, rest: f64| -> Result<Around, Halt> {
        cell.move_micro(side, here + Displacement::new(x, y))?;
        cell.wait(rest).await?;
        let light = cell.level(CHANNEL, DWELL).await?.mean - dark;
        Ok(Around { x, y, light })
    };
    let mut around = vec![look(0.0, 0.0, DWELL).await?];
    let at = |k: usize| half * (2.0 * k as f64 / (points.max(2) - 1) as f64 - 1.0);
    for line in 0..points {
        for k in 0..points {
            // Back from the end of a line takes longer than from point to point.
            let rest = if k == 0 { 5.0 * DWELL } else { DWELL };
            around.push(look(at(k), at(line), rest).await?);
        }
    }
    Ok(around)
}
