//! Fig. 3.4, the sensing fiber on its way, and the times of 3.4.

use super::super::picture::{Content, Picture, Points, thin};
use super::super::{BUDGET, Bench, Figure};
use super::THESIS_STEP;
use super::tradeoffs::{self, Core};
use pigtail_control::methods::{Method, Space};
use pigtail_control::station::{Observer, Sample, Unobserved};
use pigtail_evaluate::align::{AlignmentDocument, Offset, align};
use pigtail_evaluate::plan::search_row;
use pigtail_hal::{Channel, Command, Fault, Machine, Measurement, Spec};
use pigtail_session::align::Align;
use pigtail_session::job::Ended;
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::Setup;
use pigtail_twin::Twin;
use rayon::prelude::*;
use std::cell::Cell;

/// A twin that tells in every cycle how high its sensing fiber really stands over the outputs.
struct Watched<'a> {
    twin: Twin,
    height: &'a Cell<f64>,
}

impl Machine for Watched<'_> {
    fn spec(&self) -> &Spec {
        self.twin.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let measurement = self.twin.exchange(command)?;
        self.height.set(self.twin.sensing_height());
        Ok(measurement)
    }

    fn stop(&mut self) {
        self.twin.stop();
    }
}

/// Light of the sensing fiber over its true height, while it looks for the top.
struct Heights<'a> {
    height: &'a Cell<f64>,
    looking: bool,
    rise: Points,
}

impl Observer for Heights<'_> {
    fn phase(&mut self, _: &str, phase: &'static str, _: f64) {
        self.looking = phase == "sensing";
    }

    fn sample(&mut self, sample: &Sample) {
        if self.looking {
            let light = sample.light[Channel::Sensing.index()];
            self.rise.push((1e6 * self.height.get(), light));
        }
    }
}

/// A device by the thesis's procedure: the way of its sensing fiber, and how long it took.
fn sensing(bench: &Bench, seed: u64) -> Result<(Points, f64), Ended> {
    let setup = &bench.machine;
    let height = Cell::new(0.0);
    let twin = setup.twin(seed)?;
    let mut watched = Watched {
        twin,
        height: &height,
    };
    let mut heights = Heights {
        height: &height,
        looking: false,
        rise: Vec::new(),
    };
    let job = Align {
        procedure: Procedure::Thesis,
    };
    let aligned = setup.perform(&mut watched, &job, seed, &mut heights)?;
    let reports = aligned.fibers;
    let seconds = reports
        .iter()
        .flat_map(|r| &r.phases)
        .filter(|(name, _)| *name == "sensing")
        .map(|(_, seconds)| *seconds)
        .sum();
    Ok((heights.rise, seconds))
}

/// The recipe with a speed in z that is three quarters of what the climb's tracking rate allows: a step
/// a pattern is followed aside while light leaves at the exit angle.
fn brisk(bench: &Bench) -> Setup {
    let mut setup = bench.machine.clone();
    let rate = THESIS_STEP / (9.0 * setup.rig.recipe.climb.dwell + setup.rig.recipe.climb.pause);
    setup.rig.recipe.approach.speed = 0.75 * rate / setup.rig.recipe.ports.exit_angle.tan();
    setup
}

/// A device aligned on a machine that did not stop.
pub(super) fn aligned(
    setup: &Setup,
    procedure: Procedure,
    seed: u64,
) -> Result<AlignmentDocument, Ended> {
    let document = align(setup, procedure, seed, &mut Unobserved)?;
    match document.fault {
        Some(fault) => Err(Ended::Fault(fault)),
        None => Ok(document),
    }
}

pub(super) fn devices(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.machine;
    let devices: u64 = bench.count(24, 6);
    let seed = |k: u64| bench.seed.wrapping_add(k);
    let brisk = brisk(bench);
    let many = |setup: &Setup, procedure: Procedure| {
        (0..devices)
            .into_par_iter()
            .map(|k| aligned(setup, procedure, seed(k)))
            .collect::<Result<Vec<_>, Ended>>()
    };
    let thesis = many(setup, Procedure::Thesis)?;
    let fast = many(setup, Procedure::Fast)?;
    let brisk_done = many(&brisk, Procedure::Thesis)?;
    let ways = (0..devices)
        .into_par_iter()
        .map(|k| sensing(bench, seed(k)))
        .collect::<Result<Vec<_>, Ended>>()?;
    let half = half_area(bench)?;
    let times = Times {
        thesis: thesis.iter().collect(),
        fast: fast.iter().collect(),
        brisk: brisk_done.iter().collect(),
        brisk_speed: brisk.rig.recipe.approach.speed,
        half,
    };
    let cores = tradeoffs::cores(bench)?;
    let faster = tradeoffs::faster(bench)?;
    Ok(vec![
        figure_3_4(&ways, &cores),
        budget(bench, &times, faster),
    ])
}

/// Time of method 3 on the twin over that of half the area.
fn half_area(bench: &Bench) -> Result<f64, Ended> {
    let setup = &bench.machine;
    let whole = Space::new(Method::Multimode, &setup.rig.recipe);
    let half = Space {
        y: 0.5 * whole.y,
        ..whole
    };
    let seconds = |space: &Space| -> Result<f64, Ended> {
        let row = search_row(setup, space, bench.seed)?;
        Ok(row.measured_seconds.unwrap_or(f64::NAN))
    };
    Ok(seconds(&whole)? / seconds(&half)?)
}

/// What was measured of whole alignments.
struct Times<'a> {
    thesis: Vec<&'a AlignmentDocument>,
    fast: Vec<&'a AlignmentDocument>,
    /// With a higher speed in z, m/s.
    brisk: Vec<&'a AlignmentDocument>,
    brisk_speed: f64,
    half: f64,
}

/// Mean seconds a fiber in some phases.
pub(super) fn mean(documents: &[&AlignmentDocument], phases: &[&str]) -> f64 {
    let fibers = || documents.iter().flat_map(|d| &d.fibers);
    let seconds: f64 = fibers()
        .flat_map(|f| phases.iter().filter_map(|phase| f.seconds_in(phase)))
        .sum();
    seconds / fibers().count().max(1) as f64
}

fn figure_3_4(ways: &[(Points, f64)], cores: &[Core]) -> Figure {
    // The most fibers, and of those that align as many the fastest.
    let best = cores.iter().max_by(|a, b| {
        let faster = b.seconds.total_cmp(&a.seconds);
        a.good.cmp(&b.good).then(faster)
    });
    let told: Vec<String> = cores
        .iter()
        .map(|c| {
            let um = 1e6 * c.diameter;
            if c.good == 0 {
                format!("{um:.0} um: none of {}", c.of)
            } else {
                format!("{um:.0} um: {} of {} in {:.1} s", c.good, c.of, c.seconds)
            }
        })
        .collect();
    let share = cores
        .iter()
        .map(|c| (1e6 * c.diameter, 100.0 * c.good as f64 / c.of as f64));
    let longest = ways.iter().map(|(_, seconds)| *seconds).fold(0.0, f64::max);
    let ends: Vec<f64> = ways
        .iter()
        .filter_map(|(rise, _)| Some(rise.last()?.0.abs()))
        .collect();
    let farthest = ends.iter().copied().fold(0.0, f64::max);
    let named = ways.iter().take(3).enumerate().map(|(k, (rise, _))| {
        // The way up, without what brought it to its foot.
        let foot = rise
            .iter()
            .enumerate()
            .rev()
            .min_by(|a, b| a.1.0.total_cmp(&b.1.0))
            .map_or(0, |(at, _)| at);
        (
            format!("device {}", k + 1),
            thin(rise[foot..].iter().copied()),
        )
    });
    Figure::new("3.4", "Multimode fiber placement")
        .picture(
            Picture::curves("height over the output, um", "light, V", named)
                .x(-350.0, 100.0)
                .caption(
                    "Light in the sensing fiber on its way up past the chip's top, until it falls below a \
                     tenth of the brightest.",
                ),
        )
        .noted(
            "3.4-height",
            farthest,
            format!("Over {} devices, in truth.", ends.len()),
        )
        .picture(
            Picture::curves("core, um", "fibers aligned, %", [("", share.collect::<Points>())])
                .x(0.0, 420.0)
                .y(0.0, 105.0)
                .caption("Fibers aligned with each core of the sensing fiber; scattered light grows with its area."),
        )
        .noted(
            "3.4-core",
            best.map_or(f64::NAN, |c| 1e6 * c.diameter),
            format!("{}.", told.join(", ")),
        )
        .result("3.4-time", longest)
}

fn budget(bench: &Bench, times: &Times, [photodiodes, micro, varying]: [f64; 3]) -> Figure {
    let (thesis, fast) = (&times.thesis[..], &times.fast[..]);
    let fibers = || thesis.iter().flat_map(|d| &d.fibers);
    let worst = |of: fn(&Offset) -> f64| {
        fibers()
            .filter_map(|f| f.offset_um.as_ref().map(of))
            .fold(0.0, f64::max)
    };
    let parts: [(&str, &[&str]); 5] = [
        ("sensing", &["sensing"]),
        ("raster", &["raster"]),
        ("climb", &["climb"]),
        ("approach", &["approach"]),
        ("final", &["final"]),
    ];
    let all: f64 = parts.iter().map(|(_, phases)| mean(thesis, phases)).sum();
    let better = mean(fast, &["sensing", "search", "centre", "approach", "final"]);
    let once_placed: Vec<f64> = fibers()
        .map(|f| {
            parts
                .iter()
                .flat_map(|(_, phases)| phases.iter())
                .filter_map(|phase| f.seconds_in(phase))
                .sum()
        })
        .collect();
    let listed: Vec<String> = parts
        .iter()
        .map(|(name, phases)| format!("{name} {:.2} s", mean(thesis, phases)))
        .collect();
    let rate = bench.machine.rig.spec.photodiode.rate;
    let three = Space::new(Method::Multimode, &bench.machine.rig.recipe);
    let faster = Space {
        frequency: three.fastest(5.0 * rate),
        ..three
    };
    let within = |documents: &[&AlignmentDocument]| {
        let all = documents.iter().flat_map(|d| &d.fibers);
        all.filter(|f| f.within_tolerance == Some(true)).count()
    };
    Figure::new(BUDGET, "Alignment performance (3.4)")
        .picture(
            Picture::of("seconds a fiber, once placed", "fibers", Content::Bars(once_placed, 30))
                .x(0.0, 45.0)
                .caption(format!(
                    "{} devices by the thesis's procedure, {} of {} fibers aligned.",
                    thesis.len(),
                    within(thesis),
                    fibers().count()
                )),
        )
        .result("budget-coupling", mean(thesis, &["sensing", "raster"]))
        .noted(
            "budget-z",
            mean(&times.brisk, &["approach", "final"]),
            format!(
                "At {:.1} um/s, three quarters of what the climb can follow; at the recipe's {:.1} um/s it \
                 takes {:.1} s. {} of {} fibers aligned.",
                1e6 * times.brisk_speed,
                1e6 * bench.machine.rig.recipe.approach.speed,
                mean(thesis, &["approach", "final"]),
                within(&times.brisk),
                3 * times.brisk.len(),
            ),
        )
        .noted("budget-all", all, format!("{}.", listed.join(", ")))
        .result(
            "budget-required",
            fibers().map(|f| f.seconds).fold(0.0, f64::max),
        )
        .result(
            "budget-lateral",
            worst(|o| o.x.abs()).max(worst(|o| o.y.abs())),
        )
        .result("budget-gap", worst(|o| o.z.abs()))
        .result(
            "budget-scan",
            three.photodiode_limited(rate) / faster.closed_form(),
        )
        .result("budget-photodiodes", photodiodes)
        .result("budget-micro", micro)
        .noted("budget-vary", varying, "From 0.1 um to 0.8 um and back.")
        .result("budget-half", times.half)
        .result("budget-better", better)
        .remark(
            "The time in z is the recipe's: a speed that the climb can follow while light leaves the \
             inclined facet aside.",
        )
}
