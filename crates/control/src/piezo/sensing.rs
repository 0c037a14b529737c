//! The micro that carries the sensing fiber.
//!
//! The sensing fiber stands so far back from a lit guide that the beam is wider than its core: the
//! light then falls off as a Gaussian, (4.1). It stands above the beam's middle, on the flank of
//! that Gaussian, and clear of the chip's top, where no scattered light comes. A piezo that moves
//! it moves it up or down the flank.

use super::blocks::{Blocks, Observed, fitted};
use super::{
    DARK, Flank, Identified, Micro, Series, Watch, gaussian, gaussian_far, no_beam, resting,
    share_in_x, smoothed, ways,
};
use crate::compensation::hysteresis::Model;
use crate::identify::Path;
use crate::outcome::{Halt, Outcome};
use crate::procedure::light_guides;
use crate::recipe::Recipe;
use crate::station::Station;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::{Macro, Point};
use pigtail_numerics::golden::least;
use pigtail_numerics::line::Line;
use std::ops::Range;

/// The manipulator that carries the sensing fiber.
const SIDE: Side = Side::Right;

/// Gap between guide and sensing fiber, metres: the beam is then as wide as (4.1) needs.
const GAP: f64 = 700e-6;

/// Height above the beam's middle, metres: there the core stays clear of the chip's top wherever
/// the micro moves it, and the flank is steep.
const HEIGHT: f64 = 85e-6;

/// Clearance of the core's lower rim from the chip's top, metres.
const CLEARANCE: f64 = 5e-6;

/// Speed of the macro over the flank, m/s.
const CLIMB: f64 = 100e-6;

/// Identifies both piezos of [`SIDE`].
///
/// # Errors
///
/// A fault; an outcome where the guides cannot be lit or the light is not that of a beam.
pub(super) fn identify(station: &mut Station, recipe: &Recipe) -> Result<Micro, Halt> {
    // Less light or more is no matter here: what is behind the input only has to be steady.
    light_guides(station, recipe, 100e-9)?;
    let middle = Volts(0.5 * station.spec().micro.voltage);
    station.laser(false);
    station.run(0.02)?;
    let watch = Watch {
        side: SIDE,
        channel: Channel::Sensing,
        dark: station.level(Channel::Sensing, DARK)?.mean,
    };
    station.laser(true);
    station.micro_volts(SIDE, [middle; MICRO_AXES]);

    // Back from the guide, and to the side as its light goes.
    let back = GAP - recipe.raster.gap;
    let here = station
        .kinematics(SIDE)
        .chip_from_macro(station.wanted(SIDE));
    let there = here.shifted(back * recipe.ports.exit_angle.tan(), 0.0, back);
    let start = station.kinematics(SIDE).macro_from_chip(there);
    station.line(SIDE, Point::new(start.x, start.y - 0.4e-3, start.z), None)?;
    let (first, _) = flank_up(station, &watch, start)?;
    let across = arrive(station, start, first.centre + HEIGHT)?;
    let mut series = Series::default();
    let beam = across_beam(station, &watch, &mut series)?;
    let shift = beam.centre - seen_x(station, &watch)?;
    let start = Point::new(start.x + shift, start.y, across.z);
    station.line(SIDE, Point::new(start.x, start.y - 0.4e-3, start.z), None)?;
    let (up, up_x) = flank_up(station, &watch, start)?;
    arrive(station, start, up.centre + HEIGHT)?;

    let mut driven = Vec::with_capacity(MICRO_AXES);
    for piezo in 0..MICRO_AXES {
        driven.push(drive(station, &watch, piezo, &mut series)?);
    }
    // First as if the other piezo stood still, then as its model says.
    let alone = |i: usize| -> Result<Model, Halt> {
        let observed = tell(station, i, (&series, &driven[i]), None)?;
        Ok(Model::Memory(fitted(&observed.record, i, None)?))
    };
    let models = [alone(0)?, alone(1)?];
    let mut ratio = 0.0;
    let mut beside = |piezo: usize| -> Result<Identified, Halt> {
        let other = Some(&models[1 - piezo]);
        let observed = tell(station, piezo, (&series, &driven[piezo]), other)?;
        let memory = fitted(&observed.record, piezo, None)?;
        let found = observed.learned(piezo, &memory)?;
        ratio += ratio_of(station, piezo, &found, &up, up_x, &beam) / MICRO_AXES as f64;
        Ok(found)
    };
    let piezos = [beside(0)?, beside(1)?];
    Ok(Micro { piezos, ratio })
}

/// Arrives from below at a height, at the x and z of `start`, so that the transmissions are wound
/// up as they were on the way up the flank.
fn arrive(station: &mut Station, start: Point<Macro>, y: f64) -> Result<Point<Macro>, Halt> {
    station.line(SIDE, Point::new(start.x, y - 0.4e-3, start.z), None)?;
    let there = Point::new(start.x, y, start.z);
    station.line(SIDE, there, Some(CLIMB))?;
    Ok(there)
}

/// The flank straight up, by the macro's encoders, and the tip's x meanwhile.
fn flank_up(
    station: &mut Station,
    watch: &Watch,
    start: Point<Macro>,
) -> Result<(Flank, f64), Halt> {
    let bottom = Point::new(start.x, start.y - 0.15e-3, start.z);
    station.line(SIDE, bottom, None)?;
    let top = Point::new(start.x, start.y + 0.25e-3, start.z);
    station.start_line(SIDE, top, Some(CLIMB))?;
    let mut seen = Vec::with_capacity(4096);
    let (mut x, mut frames) = (0.0, 0.0);
    while station.moving(SIDE) {
        station.cycle()?;
        if let Some(light) = station.light(Channel::Sensing) {
            seen.push((station.endpoint(SIDE).y, light - watch.dark));
        }
        if let Some(frame) = station.frame() {
            x += watch.tip_x(station, frame.sensing.x, frame.sensing.z);
            frames += 1.0;
        }
    }
    let (smooth, brightest) = smoothed(&seen);
    // With its lower rim below the chip's top the core takes in scattered light too. Where the top
    // is follows from the beam, whose middle lies there.
    let clear = CLEARANCE + 0.5 * station.spec().sensing_fiber.core;
    let mut middle = brightest.0;
    let mut flank = None;
    for _ in 0..4 {
        let above: Vec<(f64, f64)> = smooth
            .iter()
            .filter(|p| p.0 > middle + clear && p.0 < middle + 2.0 * HEIGHT - clear)
            .map(|p| (p.0 - middle, p.1))
            .collect();
        if above.len() < 100 {
            return Err(no_beam("above the guide").into());
        }
        let fit = gaussian(&above, "above the guide")?;
        middle += fit.centre.clamp(-0.5 * clear, 0.5 * clear);
        flank = Some(Flank {
            centre: middle,
            ..fit
        });
    }
    match flank {
        Some(flank) if frames > 0.0 => Ok((flank, x / frames)),
        _ => Err(no_beam("above the guide").into()),
    }
}

/// Where the camera sees the tip, on average.
fn seen_x(station: &mut Station, watch: &Watch) -> Result<f64, Halt> {
    const FRAMES: u32 = 50;
    let mut x = 0.0;
    for _ in 0..FRAMES {
        let frame = station.next_frame()?;
        x += watch.tip_x(station, frame.sensing.x, frame.sensing.z) / f64::from(FRAMES);
    }
    Ok(x)
}

/// The beam across, by both piezos and the camera.
fn across_beam(station: &mut Station, watch: &Watch, log: &mut Series) -> Result<Flank, Halt> {
    let volts = station.spec().micro.voltage;
    let path = Path {
        turns: vec![0.5, 0.95, 0.05, 0.95, 0.05, 0.5],
        speed: 0.1,
    };
    let series = watch.drive(station, &path, |share| {
        [Volts(share * volts), Volts((1.0 - share) * volts)]
    })?;
    let points: Vec<(f64, f64)> = series
        .frames
        .iter()
        .filter_map(|(time, x)| Some((*x, series.light_at(*time, 0.0)?)))
        .collect();
    log.append(series);
    Ok(gaussian_far(&points, "across the guide")?)
}

/// What was seen of one piezo.
struct Driven {
    /// While it was driven.
    over: Range<usize>,
    /// When the ways of the thesis's model were over.
    slow: f64,
}

/// Drives a piezo, beside the other in its middle.
fn drive(
    station: &mut Station,
    watch: &Watch,
    piezo: usize,
    series: &mut Series,
) -> Result<Driven, Halt> {
    let voltage = station.spec().micro.voltage;
    let middle = Volts(0.5 * voltage);
    let start = series.time.len();
    let mut slow = None;
    for path in ways(voltage).into_iter().chain(resting(0.7 * voltage)) {
        let part = watch.drive(station, &path, |volts| {
            let mut both = [middle; MICRO_AXES];
            both[piezo] = Volts(volts);
            both
        })?;
        slow = slow.or(Some(station.time()));
        series.append(part);
    }
    station.micro_volts(SIDE, [middle; MICRO_AXES]);
    station.run(0.1)?;
    Ok(Driven {
        over: start..series.time.len(),
        slow: slow.unwrap_or_else(|| station.time()),
    })
}

/// What the light tells of a piezo. The tip creeps across the piezo's way too, as a model says of the
/// `other` piezo.
fn tell(
    station: &Station,
    piezo: usize,
    (series, driven): (&Series, &Driven),
    other: Option<&Model>,
) -> Result<Observed, Halt> {
    let part = series.part(driven.over.clone());
    let flank = flank_of(&part, share_in_x(station, piezo))?;
    let blocks = Blocks::new(series, std::slice::from_ref(&driven.over), piezo);
    let place = blocks.places[0].clone();
    let across = match other {
        Some(model) => blocks.displacement(model, 1 - piezo),
        None => vec![0.0; blocks.time.len()],
    };
    // How far the beam's middle lies along the other piezo.
    let (sin, cos) = station.spec().micro.angle.sin_cos();
    let middle = HEIGHT * [sin, cos][1 - piezo];
    let known = |k: usize| {
        let crept = across[k] - across[place.start];
        let beside = crept * (2.0 * middle + crept) / (flank.width * flank.width);
        let light = blocks.light[k].max(1e-6);
        let way = flank.displacement(light * beside.exp());
        // An error of the light makes one of the displacement that grows as the slope falls.
        let slope = light * (way - flank.centre) / flank.width;
        place.contains(&k).then_some((way, slope * slope))
    };
    // Before it was driven, a straight line stands for it.
    let spec = &station.spec().micro;
    let gain = spec.range / spec.voltage;
    let n = place.len() as f64;
    let offset = place
        .clone()
        .filter_map(|k| Some(known(k)?.0 - gain * blocks.volts[k][piezo]))
        .sum::<f64>()
        / n;
    let straight: Vec<f64> = blocks.driven().map(|volts| offset + gain * volts).collect();
    let slow = place.start..blocks.time.partition_point(|t| *t < driven.slow);
    Ok(Observed {
        series: part,
        flank,
        record: blocks.record(known, &straight)?,
        slow: std::iter::once(slow).collect(),
    })
}

/// (4.1) along a piezo whose displacement appears in x with a share: light against where the
/// camera sees the tip.
fn flank_of(series: &Series, share: f64) -> Result<Flank, Outcome> {
    let brightest = series.light.iter().fold(0.0_f64, |b, i| b.max(*i));
    let origin = series.frames.first().map_or(0.0, |frame| frame.1);
    // Light is the cleaner of the two: the camera's x is told from it, not the other way round.
    let points: Vec<(f64, f64)> = series
        .frames
        .iter()
        .filter_map(|(time, x)| {
            let light = series.light_at(*time, 0.01 * brightest)?;
            Some((light.ln(), (x - origin) / share))
        })
        .collect();
    if points.len() < 50 {
        return Err(no_beam("along a piezo"));
    }
    let highest = points.iter().fold(f64::NEG_INFINITY, |h, p| h.max(p.0));
    let solve = |top: f64| {
        let root = |log: f64| (top - log).max(0.0).sqrt();
        let roots = points.iter().map(|(log, x)| (root(*log), *x));
        let line = Line::through(roots.clone());
        let left: f64 = roots.map(|(a, x)| line.left(a, x).powi(2)).sum();
        (left, line.slope, line.at(0.0))
    };
    let top = least((highest + 0.001, highest + 4.0), 1e-9, |top| solve(top).0);
    let (_, width, centre) = solve(top);
    if width > 0.0 && width.is_finite() {
        Ok(Flank { top, centre, width })
    } else {
        Err(no_beam("along a piezo"))
    }
}

/// Displacement in y for one in x along a piezo: how steep the flank is along it, less what its
/// share in x makes of the beam's width, beside how steep it is straight up.
fn ratio_of(
    station: &Station,
    piezo: usize,
    found: &Identified,
    up: &Flank,
    up_x: f64,
    beam: &Flank,
) -> f64 {
    let (sin, cos) = station.spec().micro.angle.sin_cos();
    let (in_x, in_y) = [(cos, sin), (-sin, cos)][piezo];
    let series = &found.series;
    let (mut sum, mut n) = (0.0, 0.0);
    for (time, x) in &series.frames {
        let Some(light) = series.light_at(*time, 0.0) else {
            continue;
        };
        let log = light.ln();
        let aside = |x: f64| ((x - beam.centre) / beam.width).powi(2);
        // Height over the beam's middle in widths, by the light and how far aside the tip is.
        let over = up.top + aside(up_x) - aside(*x) - log;
        let own = found.flank.top - log;
        if over <= 0.04 || own <= 0.0 {
            continue;
        }
        let along = own.sqrt() / found.flank.width;
        let across = in_x * (x - beam.centre) / (beam.width * beam.width);
        let height = over.sqrt() / up.width;
        sum += (along - across) * in_y.signum() / (in_y.abs() * height);
        n += 1.0;
    }
    if n > 0.0 { sum / n } else { 1.0 }
}
