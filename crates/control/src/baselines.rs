//! Alignment as one would first write it: what an algorithm has to beat.
//!
//! Placement, the sensing fiber and what counts as aligned are those of the thesis's procedure. Light
//! is found by a spiral around where vision believes it to be, and the peak by whatever climb one has:
//! Nelder and Mead's simplex on averaged light ([`spiral_nelder_mead`]), the thesis's nine points
//! without an average at the end ([`spiral_nine_point`]), or one's own ([`with_climb`]). The way to
//! the chip is stepwise, with a climb after each step.

use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::peak::NinePoint;
use crate::procedure::{
    FiberReport, Found, Job, MOST_DISMISSED, each_fiber, look, lost, no_light, outward,
};
use crate::recipe::Recipe;
use crate::search::{Hit, STILL_THERE, Searcher, centre_sensing};
use crate::station::Station;
use crate::tip_estimator::Tip;
use pigtail_hal::{Channel, Fault, FiberHandling, Side};
use pigtail_model::frames::Displacement;
use std::f64::consts::TAU;

/// Light of one fiber that is to be brought to its maximum by the micro.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// The manipulator whose micro moves.
    pub side: Side,
    /// The photodiode that sees the light.
    pub channel: Channel,
    /// About how far away the peak is, metres.
    pub reach: f64,
    /// How long light is worth averaging at a point, seconds: the nearer the chip the longer.
    pub average: f64,
}

/// At the search's gap, on the way to the chip and at the chip: how far away the peak may be, metres,
/// and how long light is averaged at a point, seconds.
const FAR: (f64, f64) = (4e-6, 10e-3);
const ON_THE_WAY: (f64, f64) = (2e-6, 10e-3);
const NEAR: (f64, f64) = (0.6e-6, 40e-3);

/// A step on the way to the chip, metres: the peak walks aside by less than the light is wide.
const APPROACH_STEP: f64 = 10e-6;
/// Speed of such a step, m/s.
const APPROACH_SPEED: f64 = 100e-6;

/// Fastest turn of the spiral, hertz: what a micro of 100 Hz follows.
const FASTEST_TURN: f64 = 25.0;
/// How far one spiral is from the next, in the radius of one: they overlap.
const NEXT_SPIRAL: f64 = 1.2;
/// How much farther the spiral is followed after first light, in turns.
const FOLLOW: f64 = 1.5;

/// Aligns a device by spirals and Nelder and Mead's simplex (The Computer Journal 7, 1965).
pub fn spiral_nelder_mead(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    with_climb(station, recipe, |station, _, spot| {
        nelder_mead(station, spot)
    })
}

/// Aligns a device by spirals and the nine-point climb (thesis 3.3), which rests on the brightest.
pub fn spiral_nine_point(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    with_climb(station, recipe, |station, recipe, spot| {
        NinePoint::new(&recipe.climb, station, spot.side, spot.channel).climb(station)
    })
}

/// Aligns a device by spirals and a climb of one's own, which begins where the micro stands and is to
/// leave it at the peak.
pub fn with_climb(
    station: &mut Station,
    recipe: &Recipe,
    mut climb: impl FnMut(&mut Station, &Recipe, &Spot) -> Result<(), Halt>,
) -> Vec<FiberReport> {
    station.laser(true);
    each_fiber(station, recipe, |job, station, port| {
        let found = match port {
            None => first_light_of_input(job, station)?,
            Some(index) => first_light_of_output(job, station, index)?,
        };
        maximize(job, station, &found, &mut climb)
    })
}

fn first_light_of_input(job: &mut Job, station: &mut Station) -> Result<Found, Halt> {
    let recipe = job.recipe;
    if !station.carries(Side::Left) {
        station.handle_fiber(Side::Left, FiberHandling::Load(0))?;
    }
    coarse(job, station)?;
    let top = job.phase(station, "sensing", |job, station| {
        job.find_top(station, recipe.ports.outputs[0])
    })?;
    job.phase(station, "search", |job, station| {
        // The light may pass beside the sensing fiber's core, to either side.
        let step = recipe.sensing.sidestep;
        let mut evidence = None;
        for aside in [0.0, step, -step] {
            if evidence.is_some() {
                job.arrive(station, Side::Right, top.shifted(aside, 0.0, 0.0))?;
            }
            match spirals(job, station) {
                Ok(found) => return Ok(found),
                Err(halt) => evidence = Some(halt.no_light()?.after(evidence)),
            }
        }
        Err(no_light(evidence))
    })
}

fn first_light_of_output(
    job: &mut Job,
    station: &mut Station,
    index: usize,
) -> Result<Found, Halt> {
    // An output fiber stands out beyond the sensing fiber.
    job.withdraw(station, Side::Right)?;
    if !station.carries(Side::Right) {
        station.handle_fiber(Side::Right, FiberHandling::Load(index as u8))?;
    }
    coarse(job, station)?;
    job.phase(station, "search", |job, station| spirals(job, station))
}

/// To where the light should be, by vision and design.
fn coarse(job: &mut Job, station: &mut Station) -> Result<(), Halt> {
    let wanted = job.port.shifted(job.walk(), 0.0, 0.0);
    let gap = job.recipe.raster.gap;
    job.phase(station, "coarse", |job, station| {
        job.place(station, job.side, Tip::Fiber, wanted, gap)
    })
}

/// Spirals of the micro, the first where the macro stands, the next above and below it in turns until
/// the recipe's height is covered; then the same to either side.
fn spirals(job: &Job, station: &mut Station) -> Result<Found, Halt> {
    let raster = &job.recipe.raster;
    let side = job.side;
    let searcher = Searcher::measure(station, side, job.channel, raster.significance, 0.5)?;
    let radius = (0.5 * raster.x).min(0.98 * station.kinematics(side).micro_range_x());
    let next = NEXT_SPIRAL * radius;
    // Transmissions hold back some of the way down, so it goes as much farther.
    let farthest = (0.5 * raster.y + raster.overscan) / next;
    let heights: Vec<f64> = std::iter::once(0.0)
        .chain(
            (1..=farthest.ceil() as u32).flat_map(|k| [f64::from(k) * next, -f64::from(k) * next]),
        )
        .collect();
    let middle = station.wanted(side);
    let mut all: Option<SearchEvidence> = None;
    for aside in [0.0, 0.5 * next, -0.5 * next] {
        for height in &heights {
            if all.is_some() {
                station.move_micro(side, Displacement::ZERO);
                job.arrive(station, side, middle.shifted(aside, *height, 0.0))?;
            }
            let (hit, mut seen) = spiral(&searcher, station, radius, raster.mesh)?;
            if let Some(hit) = hit {
                if let Some(found) = job.confirm(station, &searcher, &hit)? {
                    return Ok(found);
                }
                seen.dismissed = 1;
            }
            let seen = seen.after(all);
            if seen.dismissed >= MOST_DISMISSED {
                return Err(no_light(Some(seen)));
            }
            all = Some(seen);
        }
    }
    Err(no_light(all))
}

/// One spiral of Archimedes from the micro's middle outward, at a light sample every `mesh`. Ends soon
/// after first light.
fn spiral(
    searcher: &Searcher,
    station: &mut Station,
    radius: f64,
    mesh: f64,
) -> Result<(Option<Hit>, SearchEvidence), Fault> {
    let (side, channel) = (searcher.side, searcher.channel);
    let (period, speed) = (
        station.spec().period(),
        mesh * station.spec().photodiode.rate,
    );
    let mut hit: Option<Hit> = None;
    let mut evidence = SearchEvidence {
        phase: "spiral",
        samples: 0,
        width: 2.0 * radius,
        height: 2.0 * radius,
        brightest: f64::NEG_INFINITY,
        dismissed: 0,
        threshold: searcher.threshold,
    };
    let (mut angle, mut end) = (0.0, TAU * radius / mesh);
    while angle < end {
        let r: f64 = mesh * angle / TAU;
        let at = Displacement::polar(r, angle);
        station.move_micro(side, at);
        station.cycle()?;
        angle += (speed / r.max(f64::MIN_POSITIVE)).min(TAU * FASTEST_TURN) * period;
        let Some(volts) = station.light(channel) else {
            continue;
        };
        evidence.samples += 1;
        evidence.brightest = evidence.brightest.max(volts);
        let level = volts - searcher.background.mean;
        if volts > searcher.threshold && hit.is_none_or(|hit| level > hit.level) {
            if hit.is_none() {
                end = end.min(angle + FOLLOW * TAU);
            }
            hit = Some(Hit {
                endpoint: station.endpoint(side),
                micro: at,
                level,
            });
        }
    }
    Ok((hit, evidence))
}

/// From first light to an attached fiber: a climb, steps to the chip with a climb after each, one more.
fn maximize(
    job: &mut Job,
    station: &mut Station,
    found: &Found,
    climb: &mut impl FnMut(&mut Station, &Recipe, &Spot) -> Result<(), Halt>,
) -> Result<(), Halt> {
    let recipe = job.recipe;
    let (side, channel) = (job.side, job.channel);
    let spot = |(reach, average)| Spot {
        side,
        channel,
        reach,
        average,
    };
    let before = job.phase(station, "centre", |_, station| {
        climb(station, recipe, &spot(FAR))?;
        if channel == Channel::Sensing {
            centre_sensing(station)?;
        }
        let level = station.level(channel, 0.04)?.mean - found.background;
        if level < STILL_THERE * found.level {
            return Err(lost("centre", level, found.level));
        }
        Ok(level)
    })?;
    job.phase(station, "approach", |job, station| {
        let (_, z) = look(station, side, Tip::Fiber, recipe.approach.frames)?;
        let mut way = outward(side) * (z - job.port.z) - recipe.approach.gap;
        while way > 0.0 {
            let step = way.min(APPROACH_STEP);
            let to = station.wanted(side).shifted(0.0, 0.0, step);
            station.line(side, to, Some(APPROACH_SPEED))?;
            way -= step;
            climb(station, recipe, &spot(ON_THE_WAY))?;
        }
        Ok(())
    })?;
    job.phase(station, "final", |job, station| {
        climb(station, recipe, &spot(NEAR))?;
        let last = station.level(channel, 0.04)?;
        let after = last.mean - found.background;
        if after < recipe.accept.growth * before {
            return Err(Outcome::FalseLight { before, after }.into());
        }
        job.attach(station, last, found.background, None)
    })
}

/// The simplex is small enough at this share of the first one's size.
const SMALL: f64 = 0.04;
/// Points after which it is left as it is: noise may keep it from ever becoming small.
const MOST_POINTS: usize = 60;
/// Time for the micro to arrive at a point, seconds.
const SETTLE: f64 = 6e-3;

/// Nelder and Mead's simplex in x and y of the micro, with their coefficients: reflection 1, expansion
/// 2, contraction and shrinking 1/2. Rests on its brightest point.
///
/// # Errors
///
/// The machine's fault.
pub fn nelder_mead(station: &mut Station, spot: &Spot) -> Result<(), Halt> {
    let light = |station: &mut Station, at: Displacement| -> Result<(Displacement, f64), Fault> {
        if !station.kinematics(spot.side).micro_reaches(at) {
            return Ok((at, f64::NEG_INFINITY));
        }
        station.move_micro(spot.side, at);
        station.run(SETTLE)?;
        Ok((at, station.level(spot.channel, spot.average)?.mean))
    };
    let here = station.micro(spot.side);
    let mut taken = 3;
    let mut simplex = [
        light(station, here)?,
        light(station, here + Displacement::new(spot.reach, 0.0))?,
        light(station, here + Displacement::new(0.0, spot.reach))?,
    ];
    while taken < MOST_POINTS {
        simplex.sort_by(|a, b| b.1.total_cmp(&a.1));
        let [best, middle, worst] = simplex;
        let size = [middle, worst]
            .iter()
            .map(|(p, _)| (*p - best.0).norm())
            .fold(0.0, f64::max);
        if size < SMALL * spot.reach {
            break;
        }
        let centre = between(best.0, middle.0, 0.5);
        let reflected = light(station, between(centre, worst.0, -1.0))?;
        taken += 1;
        if reflected.1 > best.1 {
            let expanded = light(station, between(centre, worst.0, -2.0))?;
            taken += 1;
            simplex[2] = if expanded.1 > reflected.1 {
                expanded
            } else {
                reflected
            };
            continue;
        }
        if reflected.1 > middle.1 {
            simplex[2] = reflected;
            continue;
        }
        // Contracted towards the better of the worst and its reflection.
        let outer = if reflected.1 > worst.1 {
            reflected
        } else {
            worst
        };
        let contracted = light(station, between(centre, outer.0, 0.5))?;
        taken += 1;
        if contracted.1 > outer.1 {
            simplex[2] = contracted;
        } else {
            simplex[1] = light(station, between(best.0, middle.0, 0.5))?;
            simplex[2] = light(station, between(best.0, worst.0, 0.5))?;
            taken += 2;
        }
    }
    let best = simplex
        .iter()
        .fold(simplex[0], |best, p| if p.1 > best.1 { *p } else { best });
    station.move_micro(spot.side, best.0);
    station.run(5.0 * SETTLE)?;
    Ok(())
}

/// `a`, moved by `share` of the way to `b`.
fn between(a: Displacement, b: Displacement, share: f64) -> Displacement {
    a + (b - a) * share
}
