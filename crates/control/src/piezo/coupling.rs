//! The micro that carries the input fiber.
//!
//! The input fiber stands back from its guide, whose light goes through the chip into an output
//! fiber that rests at its peak. As the fiber goes aside the light falls off as a Gaussian again,
//! (4.1), but over some micrometres only: farther back, where the beam is as wide as a piezo's
//! range, the guide takes in too little of it. So the macro brings one part of the range after the
//! other to where the light changes, and the piezo goes through the whole program at each.
//!
//! Which side of the beam a sample lies on, and where the beam stands beside the other parts', says
//! the camera: a model that is first learned from its frames. Light then tells the displacement, the
//! model is learned from that, and tells better where each beam stands; and so on.

use super::blocks::{Blocks, Observed, fitted};
use super::{
    BLOCK, DARK, Flank, Identified, Micro, STILL, Series, Watch, gaussian_far, no_beam, ratio,
    resting, share_in_x, ways,
};
use crate::cell::AlignmentCell;
use crate::compensation::hysteresis::{Model, predict};
use crate::identify::Path;
use crate::job::Job;
use crate::outcome::{Halt, Outcome};
use crate::procedure::outward;
use crate::recipe::Recipe;
use crate::station::Station;
use nalgebra::SVector;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_hal::{Channel, Side};
use pigtail_model::frames::{Macro, Point};
use pigtail_numerics::normal::Normal;
use std::ops::Range;

pub(super) const SIDE: Side = Side::Left;

/// How well the input is brought to its peak first, metres.
const ACCURACY: f64 = 100e-9;

/// Gap between guide and input fiber, metres: the light then falls to 1/e some 9 um aside, and at
/// the peak it is a twelfth of what it is at the chip.
const GAP: f64 = 100e-6;

/// Where along the piezo the macro puts the tip beside the beam, metres. The light of each place
/// tells of some 30 um, and no piezo goes farther than 40 um from its middle. In the last the
/// program's long rest lies on the beam's flank.
const PLACES: [f64; 4] = [27e-6, 9e-6, -27e-6, -9e-6];

/// How far aside the light is none of the beam's, metres.
const ASIDE: f64 = 80e-6;

/// How long a piezo is seen at rest before it is driven, seconds.
const AWHILE: f64 = 0.1;

/// Way of the macro from below on every arrival, metres.
const RUN_UP: f64 = 0.4e-3;

/// Light that counts, as a share of the brightest of its place: less is lost in noise.
pub(super) const LEAST: f64 = 0.1;

/// How far from the beam's middle light tells of displacement, in widths: at the peak it does not.
const CLEAR: f64 = 0.3;

/// How often light and model improve each other.
const ROUNDS: usize = 8;

/// All that was seen while one piezo was driven.
#[derive(Debug, Default)]
struct Log {
    series: Series,
    /// Of each place: its samples, and when the ways of the thesis's model were over.
    places: Vec<(Range<usize>, f64)>,
}

/// Identifies both piezos of [`SIDE`].
///
/// # Errors
///
/// A fault; an outcome where no light can be brought through the chip or it is not that of a beam.
pub(super) fn identify(station: &mut Station, recipe: &Recipe) -> Result<Micro, Halt> {
    let mut recipe = recipe.clone();
    recipe.last.accuracy = ACCURACY;
    let cell = AlignmentCell::over(station);
    cell.run(async {
        cell.laser(true)?;
        Job::of(&recipe, None).reach(&cell).await?;
        Job::of(&recipe, Some(0)).reach(&cell).await
    })?;

    // Back from the guide, and to the side as its light goes; the micro in its middle.
    let middle = Volts(0.5 * station.spec().micro.voltage);
    let micro = station.micro(SIDE);
    let back = GAP - recipe.approach.gap;
    let here = station
        .kinematics(SIDE)
        .chip_from_macro(station.wanted(SIDE));
    let there = here.shifted(
        back * recipe.ports.exit_angle.tan(),
        0.0,
        outward(SIDE) * back,
    );
    let base = station.kinematics(SIDE).macro_from_chip(there).moved(micro);
    let far = station.wanted(SIDE);
    station.line(SIDE, Point::new(far.x, far.y, base.z), None)?;
    station.micro_volts(SIDE, [middle; MICRO_AXES]);

    // What is left of the light with the fiber aside goes other ways than through the guide.
    arrive(station, base.shifted(ASIDE, 0.0, 0.0))?;
    let mut watch = Watch {
        side: SIDE,
        channel: Channel::Output1,
        dark: 0.0,
    };
    watch.dark = station.level(watch.channel, DARK)?.mean;

    let piezos = [
        identify_piezo(station, &watch, 0, base)?,
        identify_piezo(station, &watch, 1, base)?,
    ];
    let ratio = ratio::straight_up(station, &watch, &piezos, base)?;
    Ok(Micro { piezos, ratio })
}

/// Arrives from below, so that the transmissions are wound up as on every arrival.
pub(super) fn arrive(station: &mut Station, to: Point<Macro>) -> Result<(), Halt> {
    station.line(SIDE, to.shifted(0.0, -RUN_UP, 0.0), None)?;
    station.line(SIDE, to, None)
}

fn identify_piezo(
    station: &mut Station,
    watch: &Watch,
    piezo: usize,
    base: Point<Macro>,
) -> Result<Identified, Halt> {
    let voltage = station.spec().micro.voltage;
    let (sin, cos) = station.spec().micro.angle.sin_cos();
    let (in_x, in_y) = [(cos, sin), (-sin, cos)][piezo];
    let mut log = Log::default();
    // Where the piezo has rested so far: creep goes on from there.
    let rest = Path {
        turns: vec![0.5 * voltage, 0.5 * voltage + STILL],
        speed: STILL / AWHILE,
    };
    let part = watch.drive(station, &rest, |volts| both(piezo, volts, 0.5 * voltage))?;
    log.series.append(part);
    for (k, place) in PLACES.into_iter().enumerate() {
        arrive(station, base.shifted(in_x * place, in_y * place, 0.0))?;
        let (driven, beside) = centre(station, watch, piezo, -place, &mut log.series)?;
        // To where the program begins, not by a jump.
        let start = Path {
            turns: vec![driven, 0.5 * voltage],
            speed: 0.5 * voltage,
        };
        let part = watch.drive(station, &start, |volts| both(piezo, volts, beside))?;
        log.series.append(part);
        let start = log.series.time.len();
        let mut slow = None;
        let mut rest = 0.7 * voltage;
        for path in ways(voltage) {
            let part = watch.drive(station, &path, |volts| both(piezo, volts, beside))?;
            if slow.is_none() {
                slow = Some(station.time());
                rest = on_flank(&part, piezo).unwrap_or(rest);
            }
            log.series.append(part);
        }
        // A rest is for creep, and once is enough.
        if k + 1 == PLACES.len() {
            for path in resting(rest) {
                let part = watch.drive(station, &path, |volts| both(piezo, volts, beside))?;
                log.series.append(part);
            }
        }
        log.places.push((
            start..log.series.time.len(),
            slow.unwrap_or_else(|| station.time()),
        ));
    }
    station.micro_volts(SIDE, [Volts(0.5 * voltage); MICRO_AXES]);
    station.run(0.1)?;
    learn(station, piezo, &log)
}

/// The voltage on the longest way up at which the light has passed the beam's middle and fallen to where
/// it changes most; `None` where it does not do so.
///
/// Shorter ways may turn on the beam, and be as bright by chance.
fn on_flank(series: &Series, piezo: usize) -> Option<f64> {
    let smooth = |k: &usize| series.light[*k..k + BLOCK].iter().sum::<f64>() / BLOCK as f64;
    let volts = |k: &usize| series.volts[k + BLOCK / 2][piezo];
    let rising = |k: &usize| series.volts[k + BLOCK][piezo] > series.volts[*k][piezo];
    let up: Vec<usize> = (0..series.time.len().checked_sub(BLOCK)?)
        .filter(rising)
        .collect();
    let length = |way: &[usize]| volts(&way[way.len() - 1]) - volts(&way[0]);
    let way = up
        .chunk_by(|a, b| a + 1 == *b)
        .max_by(|a, b| length(a).total_cmp(&length(b)))?;
    let top = (0..way.len()).max_by(|a, b| smooth(&way[*a]).total_cmp(&smooth(&way[*b])))?;
    let steepest = (-0.5_f64).exp() * smooth(&way[top]);
    way[top..].iter().find(|k| smooth(k) < steepest).map(volts)
}

/// The voltages of both piezos: of the driven one, and of the one beside it.
fn both(piezo: usize, driven: f64, beside: f64) -> [Volts; MICRO_AXES] {
    let mut volts = [Volts(beside); MICRO_AXES];
    volts[piezo] = Volts(driven);
    volts
}

/// Brings the beam's middle onto the way of a piezo, by the other one: looks for the light around
/// the displacement `around` (metres), and leaves both piezos at the voltages that are returned.
/// The other comes to its voltage from below, as it did when the light was brightest there.
fn centre(
    station: &mut Station,
    watch: &Watch,
    piezo: usize,
    around: f64,
    series: &mut Series,
) -> Result<(f64, f64), Halt> {
    /// Lines of the search to either side of where the light is expected, and their distance.
    const LINES: i32 = 3;
    const APART: f64 = 7e-6;
    let spec = &station.spec().micro;
    let (voltage, volts_of) = (spec.voltage, spec.voltage / spec.range);
    let mut brightest = (0.0_f64, 0.5 * voltage, 0.5 * voltage);
    let line = |station: &mut Station, driven: f64, speed: f64| -> Result<_, Halt> {
        let path = Path {
            turns: vec![0.0, voltage],
            speed,
        };
        let back = Path {
            turns: vec![voltage, 0.0],
            speed: 2.0 * voltage,
        };
        let mut seen = watch.drive(station, &path, |beside| both(piezo, driven, beside))?;
        let light: Vec<(f64, f64)> = seen
            .light
            .windows(BLOCK)
            .zip(seen.volts.windows(BLOCK))
            .map(|(light, volts)| {
                (
                    volts[BLOCK / 2][1 - piezo],
                    light.iter().sum::<f64>() / BLOCK as f64,
                )
            })
            .collect();
        let returned = watch.drive(station, &back, |beside| both(piezo, driven, beside))?;
        seen.append(returned);
        Ok((light, seen))
    };
    let mut last = 0.5 * voltage;
    for k in -LINES..=LINES {
        let at = 0.5 * voltage + volts_of * (around + APART * f64::from(k));
        let driven = at.clamp(0.0, voltage);
        last = driven;
        let (lights, seen) = line(station, driven, voltage)?;
        series.append(seen);
        for (beside, light) in lights {
            if light > brightest.0 {
                brightest = (light, driven, beside);
            }
        }
    }
    let (top, driven, _) = brightest;
    // To that line from below, as when it was brightest: from above the piezo stands elsewhere, by up
    // to a beam's width.
    let again = Path {
        turns: vec![last, 0.0, driven],
        speed: voltage,
    };
    let seen = watch.drive(station, &again, |driven| both(piezo, driven, 0.0))?;
    series.append(seen);
    let (slow, seen) = line(station, driven, 0.25 * voltage)?;
    series.append(seen);
    let bright: Vec<(f64, f64)> = slow.into_iter().filter(|p| p.1 > 0.2 * top).collect();
    let beside = gaussian_far(&bright, "beside a piezo's way")?.centre;
    if !(0.0..=voltage).contains(&beside) {
        return Err(no_beam("beside a piezo's way").into());
    }
    let path = Path {
        turns: vec![0.0, beside],
        speed: 0.25 * voltage,
    };
    let seen = watch.drive(station, &path, |beside| both(piezo, driven, beside))?;
    series.append(seen);
    Ok((driven, beside))
}

/// The displacement by the camera alone, from block to block by a model that was learned from it.
fn by_camera(blocks: &Blocks, piezo: usize, share: f64) -> Result<Vec<f64>, Outcome> {
    const ROUNDS: usize = 3;
    let frames = |place: &Range<usize>| -> Vec<(usize, f64)> {
        place
            .clone()
            .filter_map(|k| Some((k, blocks.frame[k]? / share)))
            .collect()
    };
    let seen: Vec<Vec<(usize, f64)>> = blocks.places.iter().map(frames).collect();
    let volts: Vec<f64> = blocks.driven().collect();
    // The straight line through it is where to begin; at each place the tip is seen elsewhere.
    let (mut up, mut down) = (0.0, 0.0);
    for place in &seen {
        let n = place.len().max(1) as f64;
        let middle = place.iter().map(|(k, _)| volts[*k]).sum::<f64>() / n;
        let mean = place.iter().map(|(_, x)| x).sum::<f64>() / n;
        for (k, x) in place {
            let v = volts[*k] - middle;
            up += v * (x - mean);
            down += v * v;
        }
    }
    let slope = up / down;
    let mut prediction: Vec<f64> = volts.iter().map(|v| slope * v).collect();
    for _ in 0..ROUNDS {
        let mut at = vec![None; prediction.len()];
        for place in &seen {
            let n = place.len().max(1) as f64;
            let offset = place.iter().map(|(k, x)| x - prediction[*k]).sum::<f64>() / n;
            for (k, x) in place {
                at[*k] = Some((x - offset, 1.0));
            }
        }
        let record = blocks.record(|k| at[k], &prediction)?;
        prediction = predict(&Model::Memory(fitted(&record, piezo, Some(0.0))?), &record);
    }
    Ok(prediction)
}

/// The beams at all places, all of one width, from light and what a model tells of displacement.
fn flanks(blocks: &Blocks, prediction: &[f64]) -> Result<Vec<Flank>, Outcome> {
    /// So many metres are about one.
    const UNIT: f64 = 1e-5;
    const N: usize = PLACES.len();
    let mut normal = Normal::default();
    for (i, place) in blocks.places.iter().enumerate() {
        let least = LEAST * brightest(blocks, place);
        for k in place.clone().filter(|k| blocks.light[*k] > least) {
            let light = blocks.light[k];
            let x = prediction[k] / UNIT;
            // ln I = a_i + b_i x + c x^2; errors of a logarithm are those of the light over it.
            let mut row = SVector::<f64, { 2 * N + 1 }>::zeros();
            (row[2 * i], row[2 * i + 1], row[2 * N]) = (1.0, x, x * x);
            normal.add_weighted(&row, light.ln(), light * light);
        }
    }
    let along = || no_beam("along a piezo");
    let c = normal.solve().ok_or_else(along)?;
    let bend = c[2 * N];
    if bend >= 0.0 {
        return Err(along());
    }
    Ok((0..blocks.places.len())
        .map(|i| {
            let centre = -0.5 * c[2 * i + 1] / bend;
            Flank {
                top: c[2 * i] - bend * centre * centre,
                centre: UNIT * centre,
                width: UNIT * (-1.0 / bend).sqrt(),
            }
        })
        .collect())
}

fn brightest(blocks: &Blocks, place: &Range<usize>) -> f64 {
    blocks.light[place.clone()]
        .iter()
        .fold(0.0, |b: f64, i| b.max(*i))
}

/// The displacement by light, and how much it counts; `None` where light does not tell.
fn by_light(flank: &Flank, light: f64, least: f64, prediction: f64) -> Option<(f64, f64)> {
    if light < least {
        return None;
    }
    let widths = (flank.top - light.ln()).max(0.0).sqrt();
    let side = (prediction - flank.centre).signum();
    // An error of the light makes one of the displacement that grows as the slope falls.
    (widths > CLEAR).then(|| {
        let slope = 2.0 * light * widths;
        (flank.centre + side * widths * flank.width, slope * slope)
    })
}

/// What the light and the camera say of a piezo.
fn learn(station: &Station, piezo: usize, log: &Log) -> Result<Identified, Halt> {
    let share = share_in_x(station, piezo);
    let places: Vec<Range<usize>> = log.places.iter().map(|(place, _)| place.clone()).collect();
    let blocks = Blocks::new(&log.series, &places, piezo);
    let mut prediction = by_camera(&blocks, piezo, share)?;
    // Looked for once: the light's way to the record stays what it is.
    let mut lag = None;
    let mut found = None;
    for _ in 0..ROUNDS {
        let beams = flanks(&blocks, &prediction)?;
        let least: Vec<f64> = blocks
            .places
            .iter()
            .map(|place| LEAST * brightest(&blocks, place))
            .collect();
        let known = |k: usize| {
            let i = blocks.place(k)?;
            by_light(&beams[i], blocks.light[k], least[i], prediction[k])
        };
        let record = blocks.record(known, &prediction)?;
        let memory = fitted(&record, piezo, lag)?;
        lag = Some(memory.lag);
        prediction = predict(&Model::Memory(memory), &record);
        found = Some((beams, record, memory));
    }
    let (beams, record, memory) = found.ok_or_else(|| no_beam("along a piezo"))?;
    let slow: Vec<Range<usize>> = blocks
        .places
        .iter()
        .zip(&log.places)
        .map(|(place, (_, slow))| place.start..blocks.time.partition_point(|t| t < slow))
        .collect();
    // The light of the place before the last, where nothing but the program happens, is shown.
    let shown = 1;
    let observed = Observed {
        series: log.series.part(log.places[shown].0.clone()),
        flank: beams[shown],
        record,
        slow,
    };
    Ok(observed.learned(piezo, &memory)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light of a beam whose middle is at 5 V and which falls to 1/e 1 V aside, on ways up that end at
    /// some voltages, each as bright beside the others as it is told.
    fn ways_up(ways: &[(f64, f64)]) -> Series {
        const STEP: f64 = 0.01;
        let mut series = Series::default();
        for (end, bright) in ways {
            let up = (0..=(end / STEP) as usize).map(|k| k as f64 * STEP);
            let down = (0..20).map(|k| end * (1.0 - f64::from(k) / 20.0));
            for volts in up.chain(down) {
                series.time.push(0.002 * series.time.len() as f64);
                series.volts.push([volts, 5.0]);
                series.light.push(bright * (-(volts - 5.0).powi(2)).exp());
            }
        }
        series
    }

    #[test]
    fn a_rest_is_on_the_flank_where_a_shorter_way_is_brightest() {
        let flank = 5.0 + 0.5_f64.sqrt();
        for ways in [[(10.0, 1.0), (4.0, 0.9)], [(10.0, 1.0), (5.1, 1.02)]] {
            let found = on_flank(&ways_up(&ways), 0).expect("a flank");
            assert!((found - flank).abs() < 0.03, "{found}");
        }
        assert_eq!(on_flank(&ways_up(&[(5.1, 1.0), (4.0, 1.0)]), 0), None);
        assert_eq!(on_flank(&Series::default(), 0), None);
    }
}
