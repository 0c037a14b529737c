//! Looking for first light as fast as the photodiode allows.
//!
//! The micro sweeps across at constant speed and flies back, again and again, while the macro
//! creeps upward: lines side by side, all in one direction, so that hysteresis shifts them alike.
//! The macro never turns, so that its transmissions stay wound up.

use crate::cell::{AlignmentCell, Reach};
use crate::conical_scan::Watch;
use crate::outcome::{Halt, SearchEvidence};
use crate::recipe::Sweep;
use crate::station::fine;
use pigtail_hal::bench::{Knot, Law, Pose};
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::{Displacement, Point};
use std::collections::VecDeque;
use std::f64::consts::PI;

/// The light that a sweep ended at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// In the manipulator's frame: where macro and micro were together.
    pub at: Displacement,
    /// At which end of the micro's way along x it was, -1 or 1, or at none: there what is brightest may be brighter beyond.
    pub end: f64,
    /// Light above the background, volts.
    pub level: f64,
    /// The background by then, volts.
    pub background: f64,
}

/// How long a line stays at either end, in samples.
const HELD: f64 = 0.5;

/// Places on a way back that the micro goes straight between.
const BACK: u32 = 10;

/// So many lines more than there is height for are told to the micro: the macro sets out slowly.
const MORE_LINES: f64 = 8.0;

/// Where the micro is sent across, by the time from the sweep's start: at constant speed from one end
/// to the other, a stop until it is there, and back.
///
/// At either end it stays for `hold`: light beyond them shines there, if anywhere.
fn knots(sweep: &Sweep, reach: Reach, hold: f64, lines: u32) -> Vec<Knot> {
    let (line, period) = (reach.width() / sweep.speed, period(sweep, reach, hold));
    let one = |k: u32| {
        let begin = f64::from(k) * period;
        let knot = move |since: f64, x: f64| Knot {
            time: begin + since,
            at: Pose::at(x, 0.0, 0.0),
        };
        let ends = [
            knot(hold, reach.low),
            knot(hold + line, reach.high),
            knot(2.0 * hold + line + sweep.lag, reach.high),
        ];
        let back = (1..=BACK).map(move |k| {
            let share = f64::from(k) / f64::from(BACK);
            let since = 2.0 * hold + line + sweep.lag + share * sweep.flyback;
            knot(since, reach.at((PI * share).cos()))
        });
        ends.into_iter().chain(back)
    };
    (0..lines).flat_map(one).collect()
}

/// At which end of a reach a place is, to half of the way from a sample to the next.
fn end_of(reach: Reach, x: f64, way: f64) -> f64 {
    if x <= reach.low + 0.5 * way {
        -1.0
    } else if x >= reach.high - 0.5 * way {
        1.0
    } else {
        0.0
    }
}

/// Whether the micro is slow enough to know where it is, so long after the sweep's start.
fn slow(sweep: &Sweep, reach: Reach, hold: f64, since: f64) -> bool {
    let line = reach.width() / sweep.speed;
    let since = since.max(0.0) % period(sweep, reach, hold);
    let back = (since - 2.0 * hold - line - sweep.lag) / sweep.flyback;
    back < 0.0 || (PI * back).cos().abs() > 0.7
}

/// From the start of a line to the start of the next, seconds.
fn period(sweep: &Sweep, reach: Reach, hold: f64) -> f64 {
    2.0 * hold + reach.width() / sweep.speed + sweep.lag + sweep.flyback
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

/// From where to where the micro sweeps over a width, metres.
pub fn reach(cell: &AlignmentCell<'_>, side: Side, width: f64) -> Reach {
    /// Share of what it gets to.
    const SURE: f64 = 0.99;
    cell.micro_reach_x(side).within(width, SURE)
}

/// Sweeps up to the height `top` over `width` with lines `spacing` apart (metres) until something
/// is brighter by `threshold` volts than the background, and brakes soon after.
///
/// # Errors
///
/// A fault, or [`Outcome::Refused`](crate::outcome::Outcome::Refused).
pub async fn first_light(
    cell: &AlignmentCell<'_>,
    (side, channel): (Side, Channel),
    watch: &Watch,
    sweep: &Sweep,
    (width, spacing): (f64, f64),
    top: f64,
    threshold: f64,
) -> Result<(Option<Spot>, SearchEvidence), Halt> {
    let reach = reach(cell, side, width);
    let start = cell.wanted(side);
    let rate = cell.caps().channels[channel.index()].rate;
    let hold = HELD / rate;
    let line = period(sweep, reach, hold);
    let way = sweep.speed / rate;
    let widest = (WIDE / way).round() as usize;
    let widest = widest.clamp(2, 16);
    let end = Point::new(start.x, top, start.z);
    cell.start_line(side, end, Some(spacing / line))?;
    let begin = cell.now();
    let lines = ((top - start.y) / spacing).max(0.0) + MORE_LINES;
    cell.play_micro(side, Law::Scan(knots(sweep, reach, hold, lines as u32)))?;
    let mut spot: Option<Spot> = None;
    let (mut samples, mut brightest, mut after) = (0, f64::NEG_INFINITY, 0);
    let (mut wander, mut best) = (0.0, threshold);
    let mut recent: VecDeque<(f64, f64)> = VecDeque::with_capacity(widest + 1);
    while cell.is_moving(side) {
        let Some((time, volts)) = cell.sample(channel.index(), f64::INFINITY).await? else {
            continue;
        };
        let Some(then) = cell.pose(fine(side), time - sweep.lag) else {
            continue;
        };
        let commanded_x = then.pose.x();
        let slow = slow(sweep, reach, hold, time - sweep.lag - begin);
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
            let mut at = cell.endpoint(side).across();
            at.x += x;
            spot = Some(Spot {
                at,
                end: end_of(reach, x, way),
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
    let height = cell.wanted(side).y - start.y;
    cell.brake(side)?;
    cell.stands(side).await?;
    let evidence = SearchEvidence {
        phase: "search",
        samples,
        width: reach.width(),
        height,
        brightest,
        dismissed: 0,
        threshold: watch.background + threshold,
    };
    Ok((spot, evidence))
}
