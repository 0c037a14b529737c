//! Figs. 2.24 to 2.26: resolution under PID control.

use super::super::picture::{Content, Picture, Points};
use super::super::{Bench, Figure};
use super::{FIVE_BAR, Z};
use pigtail_control::characterize::{Increments, increments, record};
use pigtail_hal::{Axis, AxisName};
use pigtail_model::fivebar::FiveBar;
use pigtail_session::characterize::{ResolutionRow, metres_per_count, resolution};
use pigtail_session::job::Ended;

use pigtail_session::setup::Setup;

/// The step sizes of a resolution test, as `pigtail characterize AXIS resolution` takes them.
fn test(bench: &Bench, at: AxisName) -> Result<Vec<(ResolutionRow, Increments)>, Ended> {
    let setup = &bench.machine;
    let steps = bench.count(1000, 300);
    setup.experiment(bench.seed, |station| {
        resolution(station, &setup.rig, at, steps)
    })
}

/// The resolution of an axis under PID control, micrometres; `None` where no step size is consistent.
pub(crate) fn pid(bench: &Bench, at: AxisName) -> Result<Option<f64>, Ended> {
    let tests = test(bench, at)?;
    Ok(tests.last().and_then(|(row, _)| row.resolution_um))
}

/// The histogram, and the position over some steps.
fn pictures(figure: Figure, test: &Increments, most: f64) -> Figure {
    const SHOWN: usize = 12;
    let um: Vec<f64> = test.increments.iter().map(|m| 1e6 * m).collect();
    let mut position = 0.0;
    let mut stairs: Points = Vec::new();
    for (k, d) in um.iter().take(SHOWN).enumerate() {
        stairs.push((k as f64, position));
        position += d;
        stairs.push((k as f64, position));
    }
    stairs.push((SHOWN as f64, position));
    figure
        .picture(
            Picture::of("increment, um", "steps", Content::Bars(um, 60))
                .x(-0.1 * most, most)
                .caption(format!(
                    "How far the output moved in each of {} steps.",
                    test.increments.len()
                )),
        )
        .picture(
            Picture::curves("step", "position, um", [("output", stairs)])
                .x(0.0, SHOWN as f64)
                .caption("The output over some of them."),
        )
}

pub(super) fn z_stage(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let tests = test(bench, Z)?;
    let mut one = Figure::new(
        "2.24",
        "Resolution of z-stage for one encoder count (0.062 um) steps",
    );
    if let Some((row, increments)) = tests.first() {
        let half = 0.5 * increments.mean();
        let moved: Vec<f64> = increments
            .increments
            .iter()
            .copied()
            .filter(|d| *d >= half)
            .collect();
        let mean = 1e6 * moved.iter().sum::<f64>() / moved.len().max(1) as f64;
        one = pictures(one, increments, 0.2)
            .result("2.24-stuck", row.stuck_share)
            .result("2.24-moves", mean);
    }
    let mut two = Figure::new(
        "2.25",
        "Resolution of z-stage for two encoder counts (0.125 um) steps",
    );
    if let Some((row, increments)) = tests.get(1) {
        let n = increments.increments.len() as f64;
        let small = increments.increments.iter().filter(|d| **d < 0.14e-6);
        two = pictures(two, increments, 0.2)
            .result("2.25-consistent", row.stuck_share)
            .result("2.25-most", small.count() as f64 / n);
        if let Some(um) = row.resolution_um {
            two = two
                .result("2.25-resolution", um)
                .result("2.25-required", 0.5 / um);
        }
        two = two.remark(told_over_the_range(&over_the_range(bench)?));
    }
    Ok(vec![one, two])
}

/// What is left of steps of two counts at a place.
struct AtPlace {
    /// Where it is from where the axis began, millimetres.
    millimetres: f64,
    /// When it was begun, seconds.
    begun: f64,
    /// The largest increment, and how much increments spread, micrometres.
    largest: f64,
    deviation: f64,
    /// Whether steps are consistent there.
    consistent: bool,
}

/// Steps of two counts of z at places of its range, the first of which it comes back to at last: what limits resolution can vary over
/// time and range (2.5).
fn over_the_range(bench: &Bench) -> Result<Vec<AtPlace>, Ended> {
    /// Away from the chip, millimetres.
    const PLACES: [f64; 5] = [0.0, -1.0, -2.0, -3.0, 0.0];
    /// On the way from one to the next, m/s.
    const SPEED: f64 = 2e-3;
    const LEAD: u32 = 150;
    const DWELL: f64 = 0.05;
    let setup = &bench.machine;
    let count = metres_per_count(&setup.rig, Z.axis)?;
    let steps = bench.count(300, 60);
    setup.experiment(bench.seed, |station| {
        let start = station.encoder(Z).0;
        let mut seen = Vec::with_capacity(PLACES.len());
        for millimetres in PLACES {
            let goal = start as f64 + 1e-3 * millimetres / count;
            let way = goal - station.encoder(Z).0 as f64;
            let seconds = way.abs() * count / SPEED;
            if seconds > 0.0 {
                let along = |t: f64| way * (t / seconds).min(1.0);
                record(station, Z, seconds + 0.2, along, |_| true)?;
            }
            let begun = station.time();
            let test = increments(station, Z, 2, steps, LEAD, DWELL)?;
            seen.push(AtPlace {
                millimetres,
                begun,
                largest: 1e6 * test.largest(),
                deviation: 1e6 * test.deviation(),
                consistent: test.is_consistent(),
            });
        }
        Ok(seen)
    })
}

/// The same in words.
fn told_over_the_range(seen: &[AtPlace]) -> String {
    let range = |of: fn(&AtPlace) -> f64| {
        let least = seen.iter().map(of).fold(f64::INFINITY, f64::min);
        let most = seen.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        (least, most)
    };
    let (least, most) = range(|at| at.largest);
    let (narrow, wide) = range(|at| at.deviation);
    let (from, to) = range(|at| at.millimetres);
    let (first, last) = range(|at| at.begun);
    let consistent = seen.iter().filter(|at| at.consistent).count();
    format!(
        "At {} places over {:.0} mm, the first of them once more {:.0} s after it began, steps of two counts are consistent at {consistent}; \
         the largest increments are {least:.3} to {most:.3} um, and increments spread by {narrow:.4} to {wide:.4} um rms. The \
         friction of this machine is the same everywhere and always, as the thesis found it to be all but.",
        seen.len() - 1,
        to - from,
        last - first
    )
}

/// What a count is that the thesis holds to be more than that of most of the workspace, micrometres.
const MOST: f64 = 1.75;

/// Least and greatest displacement of the endpoint for a count of either joint in the workspace,
/// micrometres, and the share of such counts that is less than [`MOST`].
fn count_at_endpoint(setup: &Setup) -> Option<(f64, f64, f64)> {
    const CELLS: i32 = 50;
    let geometry = &setup.rig.calibration.geometry.five_bar;
    let links = FiveBar::new(geometry.base, geometry.proximal, geometry.distal).ok()?;
    let drive = setup.rig.spec.drive(Axis::A);
    let count = drive.count() / drive.gear_ratio;
    let cell = setup.rig.spec.five_bar.workspace / f64::from(CELLS);
    let [home_x, home_y] = geometry.home;
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    let (mut all, mut below) = (0.0, 0.0);
    for i in -CELLS / 2..=CELLS / 2 {
        for k in -CELLS / 2..=CELLS / 2 {
            let (x, y) = (home_x + cell * f64::from(i), home_y + cell * f64::from(k));
            let angles = links.inverse(x, y).ok()?;
            for joint in 0..2 {
                let mut next = angles;
                next[joint].0 += count;
                let (moved_x, moved_y) = links.forward(next).ok()?;
                let um = 1e6 * (moved_x - x).hypot(moved_y - y);
                (least, most) = (least.min(um), most.max(um));
                all += 1.0;
                if um < MOST {
                    below += 1.0;
                }
            }
        }
    }
    Some((least, most, below / all))
}

pub(super) fn five_bar(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let tests = test(bench, FIVE_BAR)?;
    let (least, most, share) =
        count_at_endpoint(&bench.machine).unwrap_or((f64::NAN, f64::NAN, f64::NAN));
    let mut figure = Figure::new(
        "2.26",
        "Resolution of five-bar for one encoder count (1.75 um) steps",
    )
    .result("2.26-least", least)
    .noted(
        "2.26-greatest",
        most,
        format!(
            "Less than {MOST} um at {:.0} % of the workspace; \"most\" in the thesis.",
            100.0 * share
        ),
    );
    if let Some((row, increments)) = tests.first() {
        figure = pictures(figure, increments, 4.0).result("2.26-consistent", row.stuck_share);
    }
    // As in the thesis: where steps of one count are not consistent, those of the next size that are.
    if let Some((row, increments)) = tests.last()
        && let Some(um) = row.resolution_um
    {
        figure = figure
            .noted(
                "2.26-resolution",
                um,
                format!(
                    "By steps of {} at the encoder; increments spread by {:.2} um rms.",
                    row.counts_per_step,
                    1e6 * increments.deviation()
                ),
            )
            .result("2.26-required", 5.0 / um);
    }
    Ok(vec![figure])
}
