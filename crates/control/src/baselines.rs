//! Alignment as one would first write it: what an algorithm has to beat.
//!
//! Placement, the sensing fiber and what counts as aligned are those of the thesis's procedure. Light
//! is found by a spiral around where vision believes it to be, and the peak by whatever climb one has:
//! Nelder and Mead's simplex on averaged light ([`spiral_nelder_mead`]), the thesis's nine points
//! without an average at the end ([`spiral_nine_point`]), or one's own ([`with_climb`]). The way to
//! the chip is stepwise, with a climb after each step.

use crate::cell::AlignmentCell;
use crate::job::{FiberReport, Job};
use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::peak::NinePoint;
use crate::procedure::{Found, each_fiber, look, lost, no_light, outward};
use crate::recipe::Recipe;
use crate::search::{Hit, Searcher, centre_sensing};
use crate::station::Station;
use crate::tip_estimator::Tip;
use crate::tuning::TUNING;
use pigtail_hal::{Channel, Side};
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
/// Time between two places of a spiral that the micro goes straight between, seconds.
const KNOT: f64 = 0.8e-3;
/// How far one spiral is from the next, in the radius of one: they overlap.
const NEXT_SPIRAL: f64 = 1.2;
/// How much farther the spiral is followed after first light, in turns.
const FOLLOW: f64 = 1.5;

/// Aligns a device by spirals and Nelder and Mead's simplex (The Computer Journal 7, 1965).
pub fn spiral_nelder_mead(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    with_climb(station, recipe, async |cell, _, spot| {
        nelder_mead(cell, spot).await
    })
}

/// Aligns a device by spirals and the nine-point climb (thesis 3.3), which rests on the brightest.
pub fn spiral_nine_point(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    with_climb(station, recipe, async |cell, recipe, spot| {
        let mut climb = NinePoint::new(&recipe.climb, cell, spot.side, spot.channel);
        climb.climb(cell).await
    })
}

/// Aligns a device by spirals and a climb of one's own, which begins where the micro stands and is to
/// leave it at the peak.
pub fn with_climb(
    station: &mut Station,
    recipe: &Recipe,
    mut climb: impl AsyncFnMut(&AlignmentCell<'_>, &Recipe, &Spot) -> Result<(), Halt>,
) -> Vec<FiberReport> {
    let cell = AlignmentCell::over(station);
    let cell = &cell;
    cell.run(each_fiber(cell, recipe, async |job| {
        let found = match job.output {
            None => {
                cell.laser(true)?;
                first_light_of_input(job, cell).await?
            }
            Some(index) => first_light_of_output(job, cell, index).await?,
        };
        maximize(job, cell, &found, &mut climb).await
    }))
}

async fn first_light_of_input(job: &mut Job<'_>, cell: &AlignmentCell<'_>) -> Result<Found, Halt> {
    let recipe = job.recipe;
    if !cell.carries(Side::Left) {
        cell.load(Side::Left, 0).await?;
    }
    coarse(job, cell).await?;
    let top = job
        .phase(cell, "sensing", async |job| {
            job.find_top(cell, recipe.ports.outputs[0]).await
        })
        .await?;
    job.phase(cell, "search", async |job| {
        // The light may pass beside the sensing fiber's core, to either side.
        let step = recipe.sensing.sidestep;
        let mut evidence = None;
        for aside in [0.0, step, -step] {
            if evidence.is_some() {
                job.beside_top(cell, &top, aside).await?;
            }
            match spirals(job, cell).await {
                Ok(found) => return Ok(found),
                Err(halt) => evidence = Some(halt.no_light()?.after(evidence)),
            }
        }
        Err(no_light(evidence))
    })
    .await
}

async fn first_light_of_output(
    job: &mut Job<'_>,
    cell: &AlignmentCell<'_>,
    index: usize,
) -> Result<Found, Halt> {
    // An output fiber stands out beyond the sensing fiber.
    job.withdraw(cell, Side::Right).await?;
    if !cell.carries(Side::Right) {
        cell.load(Side::Right, index).await?;
    }
    coarse(job, cell).await?;
    job.phase(cell, "search", async |job| spirals(job, cell).await)
        .await
}

/// To where the light should be, by vision and design.
async fn coarse(job: &mut Job<'_>, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
    let wanted = job.port.shifted(job.walk(), 0.0, 0.0);
    let gap = job.recipe.raster.gap;
    job.phase(cell, "coarse", async |job| {
        job.place(cell, job.side, Tip::Fiber, wanted, gap).await
    })
    .await
}

/// Spirals of the micro, the first where the macro stands, the next above and below it in turns until
/// the recipe's height is covered; then the same to either side.
async fn spirals(job: &Job<'_>, cell: &AlignmentCell<'_>) -> Result<Found, Halt> {
    let raster = &job.recipe.raster;
    let side = job.side;
    let searcher = Searcher::measure(cell, side, job.channel, raster.significance, 0.5).await?;
    let reach = cell.micro_reach_x(side).within(raster.x, 0.98);
    let radius = reach.high.min(-reach.low);
    let next = NEXT_SPIRAL * radius;
    // Transmissions hold back some of the way down, so it goes as much farther.
    let farthest = (0.5 * raster.y + raster.overscan) / next;
    let heights: Vec<f64> = std::iter::once(0.0)
        .chain(
            (1..=farthest.ceil() as u32).flat_map(|k| [f64::from(k) * next, -f64::from(k) * next]),
        )
        .collect();
    let middle = cell.wanted(side);
    let mut all: Option<SearchEvidence> = None;
    for aside in [0.0, 0.5 * next, -0.5 * next] {
        for height in &heights {
            if all.is_some() {
                cell.move_micro(side, Displacement::ZERO)?;
                job.arrive(cell, side, middle.shifted(aside, *height, 0.0))
                    .await?;
            }
            let (hit, mut seen) = spiral(&searcher, cell, radius, raster.mesh).await?;
            if let Some(hit) = hit {
                if let Some(found) = job.confirm(cell, &searcher, &hit).await? {
                    return Ok(found);
                }
                seen.dismissed = 1;
            }
            let seen = seen.after(all);
            if seen.dismissed >= raster.retry.dismissed as usize {
                return Err(no_light(Some(seen)));
            }
            all = Some(seen);
        }
    }
    Err(no_light(all))
}

/// One spiral of Archimedes from the micro's middle outward, at a light sample every `mesh`. Ends soon
/// after first light.
async fn spiral(
    searcher: &Searcher,
    cell: &AlignmentCell<'_>,
    radius: f64,
    mesh: f64,
) -> Result<(Option<Hit>, SearchEvidence), Halt> {
    let (side, channel) = (searcher.side, searcher.channel);
    let speed = mesh * cell.spec().photodiode.rate;
    let mut path = vec![(0.0, 0.0)];
    let whole = TAU * radius / mesh;
    while let Some((time, angle)) = path.last().copied()
        && angle < whole
    {
        let r: f64 = mesh * angle / TAU;
        let turning = (speed / r.max(f64::MIN_POSITIVE)).min(TAU * FASTEST_TURN);
        path.push((time + KNOT, angle + turning * KNOT));
    }
    // Its angle at a time of it.
    let angle = |time: f64| {
        let k = ((time / KNOT) as usize).min(path.len() - 2);
        let [(from, a), (_, b)] = [path[k], path[k + 1]];
        a + (b - a) * (time - from) / KNOT
    };
    let seconds = path.last().map_or(KNOT, |(time, _)| *time);
    cell.micro_path(side, (seconds, KNOT), |time| {
        let angle = angle(time);
        Displacement::polar(mesh * angle / TAU, angle)
    })?;
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
    let begin = cell.now();
    let mut end = begin + seconds;
    while !cell.is_past(end) {
        let Some(volts) = cell.light(channel, end).await? else {
            continue;
        };
        evidence.samples += 1;
        evidence.brightest = evidence.brightest.max(volts);
        let level = volts - searcher.background.mean;
        if volts > searcher.threshold && hit.is_none_or(|hit| level > hit.level) {
            if hit.is_none() {
                // Outside it turns the more slowly.
                let to = angle(cell.now() - begin) + FOLLOW * TAU;
                let until = path.partition_point(|(_, angle)| *angle < to);
                end = end.min(begin + KNOT * until as f64);
            }
            hit = Some(Hit {
                endpoint: cell.endpoint(side),
                micro: cell.micro_at(side, cell.now()),
                level,
            });
        }
    }
    Ok((hit, evidence))
}

/// From first light to an attached fiber: a climb, steps to the chip with a climb after each, one more.
async fn maximize(
    job: &mut Job<'_>,
    cell: &AlignmentCell<'_>,
    found: &Found,
    climb: &mut impl AsyncFnMut(&AlignmentCell<'_>, &Recipe, &Spot) -> Result<(), Halt>,
) -> Result<(), Halt> {
    let recipe = job.recipe;
    let (side, channel) = (job.side, job.channel);
    let spot = |(reach, average)| Spot {
        side,
        channel,
        reach,
        average,
    };
    let before = job
        .phase(cell, "centre", async |_| {
            climb(cell, recipe, &spot(FAR)).await?;
            if channel == Channel::Sensing {
                centre_sensing(cell).await?;
            }
            let level = cell.level(channel, 0.04).await?.mean - found.background;
            if level < TUNING.search.still_there * found.level {
                return Err(lost("centre", level, found.level));
            }
            Ok(level)
        })
        .await?;
    job.phase(cell, "approach", async |job| {
        let (_, z) = look(cell, side, Tip::Fiber, recipe.approach.frames).await?;
        let mut way = outward(side) * (z - job.port.z) - recipe.approach.gap;
        while way > 0.0 {
            let step = way.min(APPROACH_STEP);
            let to = cell.wanted(side).shifted(0.0, 0.0, step);
            cell.line(side, to, Some(APPROACH_SPEED)).await?;
            way -= step;
            climb(cell, recipe, &spot(ON_THE_WAY)).await?;
        }
        Ok(())
    })
    .await?;
    job.phase(cell, "final", async |job| {
        climb(cell, recipe, &spot(NEAR)).await?;
        let last = cell.level(channel, 0.04).await?;
        let after = last.mean - found.background;
        Outcome::of_growth(before, after, recipe.accept.growth * before)?;
        job.attach(cell, last, found.background, (None, None)).await
    })
    .await
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
pub async fn nelder_mead(cell: &AlignmentCell<'_>, spot: &Spot) -> Result<(), Halt> {
    let light = async |at: Displacement| -> Result<(Displacement, f64), Halt> {
        if !cell.micro_reaches(spot.side, at) {
            return Ok((at, f64::NEG_INFINITY));
        }
        cell.move_micro(spot.side, at)?;
        cell.wait(SETTLE).await?;
        Ok((at, cell.level(spot.channel, spot.average).await?.mean))
    };
    let here = cell.micro(spot.side);
    let mut taken = 3;
    let mut simplex = [
        light(here).await?,
        light(here + Displacement::new(spot.reach, 0.0)).await?,
        light(here + Displacement::new(0.0, spot.reach)).await?,
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
        let reflected = light(between(centre, worst.0, -1.0)).await?;
        taken += 1;
        if reflected.1 > best.1 {
            let expanded = light(between(centre, worst.0, -2.0)).await?;
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
        let contracted = light(between(centre, outer.0, 0.5)).await?;
        taken += 1;
        if contracted.1 > outer.1 {
            simplex[2] = contracted;
        } else {
            simplex[1] = light(between(best.0, middle.0, 0.5)).await?;
            simplex[2] = light(between(best.0, worst.0, 0.5)).await?;
            taken += 2;
        }
    }
    let best = simplex
        .iter()
        .fold(simplex[0], |best, p| if p.1 > best.1 { *p } else { best });
    cell.move_micro(spot.side, best.0)?;
    cell.wait(5.0 * SETTLE).await?;
    Ok(())
}

/// `a`, moved by `share` of the way to `b`.
fn between(a: Displacement, b: Displacement, share: f64) -> Displacement {
    a + (b - a) * share
}
