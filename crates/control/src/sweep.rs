//! Looking for first light as fast as the photodiode allows.
//!
//! The micro sweeps across at constant speed and flies back, again and again, while the macro
//! creeps upward: lines side by side, all in one direction, so that hysteresis shifts them alike.
//! The macro never turns, so that its transmissions stay wound up.

use crate::conical_scan::Watch;
use crate::outcome::{Halt, SearchEvidence};
use crate::recipe::Sweep;
use crate::station::Station;
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::{Displacement, Point};
use std::collections::VecDeque;
use std::f64::consts::PI;

/// The light that a sweep ended at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// In the manipulator's frame: where macro and micro were together.
    pub at: Displacement,
    /// Light above the background, volts.
    pub level: f64,
    /// The background by then, volts.
    pub background: f64,
}

/// Where the micro is sent across, a while after the sweep's start: at constant speed from one end
/// to the other, a stop until it is there, and back. And whether it is slow enough to know where
/// it is.
fn across(sweep: &Sweep, reach: f64, since: f64) -> (f64, bool) {
    let line = 2.0 * reach / sweep.speed;
    let since = since % period(sweep, reach);
    if since < line + sweep.lag {
        ((sweep.speed * since - reach).min(reach), true)
    } else {
        let share = (since - line - sweep.lag) / sweep.flyback;
        let x = reach * (PI * share).cos();
        (x, x.abs() > 0.7 * reach)
    }
}

/// From the start of a line to the start of the next, seconds.
fn period(sweep: &Sweep, reach: f64) -> f64 {
    2.0 * reach / sweep.speed + sweep.lag + sweep.flyback
}

/// A way over which a spot is seen, metres; at the usual speed that is two samples at most.
const WIDE: f64 = 12e-6;

/// Samples over which the background is followed.
const FOLLOWED: f64 = 50.0;

/// The last samples of a line that stand out most together.
struct Part {
    /// Their sum over the square root of their number: as noisy as one sample.
    stands_out: f64,
    /// Their middle, metres.
    x: f64,
    /// The brightest of them.
    level: f64,
}

/// A spot is seen in one sample, or half in each of two; a dim one on a slow line in more.
fn brightest_part(recent: &VecDeque<(f64, f64)>) -> Part {
    let mut best = Part {
        stands_out: f64::NEG_INFINITY,
        x: 0.0,
        level: 0.0,
    };
    let (mut sum, mut x, mut n, mut level) = (0.0, 0.0, 0.0_f64, f64::NEG_INFINITY);
    for (volts, at) in recent.iter().rev() {
        sum += volts;
        x += at;
        n += 1.0;
        level = level.max(*volts);
        let stands_out = sum / n.sqrt();
        if stands_out > best.stands_out {
            best = Part {
                stands_out,
                x: x / n,
                level,
            };
        }
    }
    best
}

/// How far the micro sweeps to either side, metres.
pub fn reach(station: &Station, side: Side, width: f64) -> f64 {
    (0.5 * width).min(0.99 * station.kinematics(side).micro_range_x())
}

/// Sweeps up to the height `top` over `width` with lines `spacing` apart (metres) until something
/// is brighter by `threshold` volts than the background, and brakes soon after.
///
/// # Errors
///
/// A fault, or [`Outcome::Refused`](crate::outcome::Outcome::Refused).
pub fn first_light(
    station: &mut Station,
    (side, channel): (Side, Channel),
    watch: &Watch,
    sweep: &Sweep,
    (width, spacing): (f64, f64),
    top: f64,
    threshold: f64,
) -> Result<(Option<Spot>, SearchEvidence), Halt> {
    let reach = reach(station, side, width);
    let lag = (sweep.lag * station.spec().servo.rate).round() as usize;
    let start = station.wanted(side);
    let line = period(sweep, reach);
    let widest = (WIDE * station.spec().photodiode.rate / sweep.speed).round() as usize;
    let widest = widest.clamp(2, 16);
    let end = Point::new(start.x, top, start.z);
    station.start_line(side, end, Some(spacing / line))?;
    let begin = station.time();
    let mut commanded: VecDeque<(f64, bool)> = VecDeque::with_capacity(lag + 2);
    let mut spot: Option<Spot> = None;
    let (mut samples, mut brightest, mut after) = (0, f64::NEG_INFINITY, 0);
    let (mut wander, mut best) = (0.0, threshold);
    let mut recent: VecDeque<(f64, f64)> = VecDeque::with_capacity(widest + 1);
    while station.moving(side) {
        let at = across(sweep, reach, station.time() - begin);
        station.move_micro(side, Displacement::new(at.0, 0.0));
        station.cycle()?;
        commanded.push_back(at);
        if commanded.len() > lag + 1 {
            commanded.pop_front();
        }
        let (Some(volts), Some(&(commanded_x, slow))) = (station.light(channel), commanded.front())
        else {
            continue;
        };
        samples += 1;
        brightest = f64::max(brightest, volts);
        let level = volts - watch.background - wander;
        if !slow {
            recent.clear();
        }
        recent.push_back((level, commanded_x));
        if recent.len() > widest {
            recent.pop_front();
        }
        let seen = brightest_part(&recent);
        if seen.stands_out < 0.5 * threshold {
            // The background wanders slowly: follow it while there is no light.
            wander += level / FOLLOWED;
        }
        let (stands_out, x, level) = (seen.stands_out, seen.x, seen.level);
        if stands_out > best && slow {
            let mut at = station.endpoint(side).across();
            at.x += x;
            spot = Some(Spot {
                at,
                level,
                background: watch.background + wander,
            });
            best = stands_out;
            after = 0;
        } else if spot.is_some() {
            after += 1;
            // Twice dimmer in a row: the brightest has passed.
            if after >= 2 {
                break;
            }
        }
    }
    let height = station.wanted(side).y - start.y;
    station.brake(side);
    while station.moving(side) {
        station.cycle()?;
    }
    let evidence = SearchEvidence {
        phase: "search",
        samples,
        width: 2.0 * reach,
        height,
        brightest,
        dismissed: 0,
        threshold: watch.background + threshold,
    };
    Ok((spot, evidence))
}
