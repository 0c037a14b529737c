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
use crate::tuning::TUNING;
use crate::upward::{Facet, Upward};
use pigtail_hal::bench::{Knot, Law, Pose};
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::Displacement;
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

/// Lines of a sweep: at constant speed from one end to the other, a stop until the micro is there, and back.
#[derive(Debug, Clone, Copy)]
struct Lines {
    reach: Reach,
    /// Metres a second.
    speed: f64,
    /// How long it stays at either end, seconds: light beyond them shines there, if anywhere.
    hold: f64,
    /// Of light behind the micro, seconds.
    lag: f64,
    /// Of the way back, seconds.
    flyback: f64,
}

impl Lines {
    /// Those of a sweep over a width, metres.
    fn of(
        cell: &AlignmentCell<'_>,
        (side, channel): (Side, Channel),
        sweep: &Sweep,
        width: f64,
    ) -> Self {
        Self {
            reach: reach(cell, side, width),
            speed: sweep.speed,
            hold: TUNING.search.held / cell.caps().channels[channel.index()].rate,
            lag: cell.caps().groups[fine(side).0].lag.0,
            flyback: sweep.flyback,
        }
    }

    /// From one end to the other, seconds.
    fn line(&self) -> f64 {
        self.reach.width() / self.speed
    }

    /// From a line's start until its way back, seconds.
    fn forth(&self) -> f64 {
        2.0 * self.hold + self.line() + self.lag
    }

    /// From the start of a line to the start of the next, seconds.
    fn period(&self) -> f64 {
        self.forth() + self.flyback
    }

    /// Where the micro is sent across, by the time from the sweep's start.
    fn knots(self, lines: u32) -> Vec<Knot> {
        let one = |k: u32| {
            let begin = f64::from(k) * self.period();
            let knot = move |since: f64, x: f64| Knot {
                time: begin + since,
                at: Pose::at(x, 0.0, 0.0),
            };
            let ends = [
                knot(self.hold, self.reach.low),
                knot(self.hold + self.line(), self.reach.high),
                knot(self.forth(), self.reach.high),
            ];
            let back = (1..=TUNING.search.back).map(move |k| {
                let share = f64::from(k) / f64::from(TUNING.search.back);
                let since = self.forth() + share * self.flyback;
                knot(since, self.reach.at((PI * share).cos()))
            });
            ends.into_iter().chain(back)
        };
        (0..lines).flat_map(one).collect()
    }

    /// Whether the micro is slow enough to know where it is, so long after the sweep's start.
    fn slow(&self, since: f64) -> bool {
        let since = since.max(0.0) % self.period();
        let back = (since - self.forth()) / self.flyback;
        back < 0.0 || (PI * back).cos().abs() > 0.7
    }
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

/// What a sweep saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swept {
    /// Its light.
    pub spot: Option<Spot>,
    /// All that was seen.
    pub evidence: SearchEvidence,
    /// Where there was no light: height of the holder (metres) where what was brightest stood out by more than noise makes of that
    /// many samples, usually.
    pub perhaps: Option<f64>,
}

/// From where to where the micro sweeps over a width, metres.
pub fn reach(cell: &AlignmentCell<'_>, side: Side, width: f64) -> Reach {
    cell.micro_reach_x(side).within(width, TUNING.search.sure)
}

/// The same, as much more slowly as a micro that takes long to come to rest needs it over a width, metres, if it may swing so far, metres.
///
/// Lines that are repeated as often as a micro swings have it swing farther and farther: they are no more than a sinusoid as wide, by which a resonance
/// swings by its quality, pi times the time constant by which it comes to rest in periods, of half of that. What swings faster, as far as that is known, is
/// moved by an overtone of theirs alone: of the n-th by the n-th part.
pub fn calm(cell: &AlignmentCell<'_>, side: Side, sweep: &Sweep, width: f64, swing: f64) -> Sweep {
    let width = reach(cell, side, width).width();
    let usual = width / sweep.speed + sweep.flyback;
    let overtone = usual * cell.least_resonance(side).unwrap_or(0.0);
    let constant = cell.settling(side) / TUNING.dynamics.constants;
    let period = 0.5 * PI * width * constant / (swing * overtone.max(1.0));
    let slower = (period / usual).max(1.0);
    Sweep {
        speed: sweep.speed / slower,
        flyback: sweep.flyback * slower,
    }
}

/// Sweeps up to the height `top` over `width` with lines `spacing` apart (metres) until something
/// is brighter by `threshold` volts than the background, or it is not to go on, and brakes soon after.
///
/// # Errors
///
/// A fault, or [`Outcome::Refused`](crate::outcome::Outcome::Refused).
pub async fn first_light(
    cell: &AlignmentCell<'_>,
    (side, channel): (Side, Channel),
    watch: &Watch,
    sweep: &Sweep,
    (facet, width, spacing): (Facet, f64, f64),
    (top, threshold): (f64, f64),
    goes_on: impl Fn() -> bool,
) -> Result<Swept, Halt> {
    let lines = Lines::of(cell, (side, channel), sweep, width);
    let (reach, start) = (lines.reach, cell.wanted(side));
    let rate = cell.caps().channels[channel.index()].rate;
    let apart = sweep.speed / rate;
    let widest = (TUNING.search.wide / apart).round() as usize;
    let widest = widest.clamp(2, 16);
    let speed = spacing / lines.period();
    let mut way = Upward::start(cell, (side, facet, reach), top, speed).await?;
    let begin = cell.now();
    let count = ((top - start.y) / spacing).max(0.0) + TUNING.search.more_lines;
    cell.play_micro(side, Law::Scan(lines.knots(count as u32)))?;
    let mut spot: Option<Spot> = None;
    let (mut samples, mut brightest, mut after) = (0, watch.background, 0);
    let (mut wander, mut best) = (0.0, threshold);
    let (mut perhaps, mut likely) = (None, TUNING.search.perhaps * threshold);
    let mut recent: VecDeque<(f64, f64)> = VecDeque::with_capacity(widest + 1);
    while way.goes_on()? && goes_on() {
        let Some((time, volts)) = cell.sample(channel.index(), f64::INFINITY).await? else {
            continue;
        };
        let Some(then) = cell.pose(fine(side), time - lines.lag) else {
            continue;
        };
        let commanded_x = then.pose.x();
        let slow = lines.slow(time - lines.lag - begin);
        samples += 1;
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
            wander += level / TUNING.search.followed;
        }
        let (stands_out, x, level) = (seen.stands_out, seen.x, seen.level);
        if slow {
            // As it is judged: some samples together, above what wanders.
            brightest = f64::max(brightest, watch.background + stands_out);
        }
        if stands_out > likely && slow {
            (perhaps, likely) = (Some(cell.endpoint(side).y), stands_out);
        }
        if stands_out > best && slow {
            let mut at = cell.endpoint(side).across();
            at.x += x;
            spot = Some(Spot {
                at,
                end: end_of(reach, x, apart),
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
    Ok(Swept {
        spot,
        evidence,
        perhaps: perhaps.filter(|_| spot.is_none()),
    })
}
