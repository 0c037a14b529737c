//! Chapter 3: path planning.

use super::picture::{Content, Picture, Points, thin};
use super::{BUDGET, Bench, Experiment, Figure, ReproduceError};
use crate::align::{AlignError, Document, align};
use crate::characterize::on_twin;
use crate::maximize::{MACRO, PIEZOS, rejection, tracking};
use crate::plan::search_row;
use crate::procedure::Procedure;
use crate::rig::Setup;
use pigtail_control::maximization::{Around, Disturbance, Means, profile};
use pigtail_control::methods::{Method, Space};
use pigtail_control::recipe::Climb;
use pigtail_control::station::{Observer, Sample, Station, Unobserved};
use pigtail_hal::{Channel, Command, Fault, Machine, Measurement, Spec};
use pigtail_machines::Twin;
use pigtail_model::optics::{Coupler, GaussianMode, Misalignment};
use rayon::prelude::*;
use std::cell::Cell;

/// Distance of the climb's points in 3.3, metres.
const THESIS_STEP: f64 = 0.1e-6;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment::new(&["3.2"], 3, light_profile),
    Experiment::new(&["3.3"], 30, methods),
    Experiment::new(&["3.4", BUDGET], 20, alignments),
    Experiment::new(&["3.5"], 18, maximization),
];

/// A Gaussian `c exp(-(a x^2 + b y^2))` through the light around a peak at which it stands: its `R^2`.
fn gaussian(around: &[Around]) -> f64 {
    // Least squares of the light itself over both widths: steps that halve where they fail.
    let peak = around.iter().fold(0.0_f64, |m, p| m.max(p.light));
    let error = |[c, a, b]: [f64; 3]| -> f64 {
        around
            .iter()
            .map(|p| {
                let told = c * (-a * p.x * p.x * 1e12 - b * p.y * p.y * 1e12).exp();
                (p.light - told).powi(2)
            })
            .sum()
    };
    let mut best = [peak, 0.1, 0.1];
    let mut step = 0.5;
    while step > 1e-4 {
        let mut better = false;
        for k in 0..3 {
            for factor in [1.0 + step, 1.0 / (1.0 + step)] {
                let mut tried = best;
                tried[k] *= factor;
                if error(tried) < error(best) {
                    best = tried;
                    better = true;
                }
            }
        }
        if !better {
            step *= 0.5;
        }
    }
    let mean = around.iter().map(|p| p.light).sum::<f64>() / around.len() as f64;
    let all: f64 = around.iter().map(|p| (p.light - mean).powi(2)).sum();
    1.0 - error(best) / all
}

fn light_profile(bench: &Bench) -> Result<Vec<Figure>, ReproduceError> {
    const HALF: f64 = 7.5e-6;
    let lines = bench.count(31, 16);
    let setup = &bench.machine;
    let around = on_twin(setup, bench.seed, |station| {
        Ok(profile(station, &setup.recipe, HALF, lines)?)
    })?;
    let peak = around[0].light;
    let cell = 2.0 * HALF / (lines - 1) as f64;
    // As far aside as the thesis says, to within half a cell.
    let rim: Vec<f64> = around
        .iter()
        .filter(|p| (p.x.hypot(p.y) - 5e-6).abs() < 0.5 * cell)
        .map(|p| p.light / peak)
        .collect();
    let at_rim = rim.iter().sum::<f64>() / rim.len().max(1) as f64;
    let brightest = rim.iter().copied().fold(0.0, f64::max);
    let um = |metres: f64| 1e6 * metres;
    let cells = around[1..]
        .iter()
        .map(|p| {
            (
                um(p.x + 0.5 * cell),
                um(p.y + 0.5 * cell),
                (p.light / peak).clamp(0.0, 1.0),
            )
        })
        .collect();
    let middle = around[1..]
        .iter()
        .map(|p| p.y.abs())
        .fold(f64::INFINITY, f64::min);
    let across: Points = around[1..]
        .iter()
        .filter(|p| p.y >= 0.0 && p.y <= middle + 1e-9)
        .map(|p| (um(p.x), p.light / peak))
        .collect();
    let plant = &bench.nominal.plant;
    let [radius_x, radius_y] = plant.device.mode_radius;
    let fiber = plant.fiber.mode_radius;
    let coupler = Coupler::new(
        GaussianMode { radius_x, radius_y },
        GaussianMode {
            radius_x: fiber,
            radius_y: fiber,
        },
        plant.light.wavelength,
    )
    .map_err(|invalid| AlignError::Twin(invalid.into()))?;
    let tilt = plant.misplacement.tilt;
    let gap = setup.recipe.approach.gap;
    let off = Misalignment {
        x: 0.1e-6,
        y: 0.1e-6,
        z: gap + 2e-6,
        tilt_x: tilt,
        tilt_y: tilt,
    };
    let loss = 1.0 - coupler.efficiency(&off);
    let least = 1.0
        - coupler.efficiency(&Misalignment {
            z: gap,
            ..Misalignment::default()
        });
    Ok(vec![
        Figure::new(
            "3.2",
            "Light intensity distribution around optimal alignment position",
        )
        .picture(
            Picture::of(
                "x, um",
                "y, um",
                Content::Cells(cells, (um(cell), um(cell))),
            )
            .x(-8.0, 8.0)
            .y(-8.0, 8.0)
            .caption(
                "Light at the first output over its fiber's place around the peak, the input \
                         coupled.",
            ),
        )
        .picture(
            Picture::curves("x, um", "light, of the peak", [("across", across)])
                .x(-8.0, 8.0)
                .y(0.0, 1.1)
                .caption("The same through the peak."),
        )
        .result("3.2-gaussian", gaussian(&around))
        .noted(
            "3.2-radius",
            at_rim,
            format!("The mean around; {brightest:.3} where it is brightest."),
        )
        .noted(
            "3.2-loss",
            loss,
            format!(
                "At the recipe's gap of {:.0} um, where the best that can be is {least:.3}.",
                um(gap)
            ),
        ),
    ])
}

fn methods(bench: &Bench) -> Result<Vec<Figure>, ReproduceError> {
    let setup = &bench.machine;
    let rate = setup.spec.photodiode.rate;
    let fine = |method| Space::new(method, &setup.recipe);
    let coarse = |space: Space| Space {
        mesh: 2.0 * space.mesh,
        ..space
    };
    let [one, two, three] = Method::ALL.map(fine);
    let one_coarse = coarse(one);
    let one_fast = Space {
        frequency: one_coarse.fastest(rate),
        ..one_coarse
    };
    // The last takes as long as all of the rest together.
    let spaces = [three, one_coarse, two, one_fast, one];
    let rows = spaces[..bench.count(5, 2)]
        .par_iter()
        .with_max_len(1)
        .map(|space| search_row(setup, space, bench.seed))
        .collect::<Result<Vec<_>, _>>()?;
    let row = |k: usize| rows.get(k);
    let seconds = |k: usize| row(k).and_then(|r| r.measured_seconds).unwrap_or(f64::NAN);
    let note = |k: usize| row(k).map_or_else(String::new, |r| r.note.clone());
    let minutes = |k: usize| seconds(k) / 60.0;
    let meshes = [2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.5, 15.0, 20.0];
    let form = |space: Space| -> Points {
        meshes
            .iter()
            .map(|um| {
                let mesh = 1e-6 * um;
                (*um, Space { mesh, ..space }.closed_form().log10())
            })
            .collect()
    };
    let measured: Points = (0..rows.len())
        .filter(|k| *k != 3)
        .map(|k| (rows[k].mesh_um, seconds(k).log10()))
        .collect();
    let mut dots: Vec<(f64, f64, f64)> = measured.iter().map(|p| (p.0, p.1, 0.5)).collect();
    dots.sort_by(|a, b| a.1.total_cmp(&b.1));
    let curves = [
        ("method 1, (3.3)", form(one)),
        ("method 2, (3.4)", form(two)),
        ("method 3, (3.5)", form(three)),
    ];
    let orders = seconds(4) / 3.0 / seconds(0);
    let figure =
        Figure::new("3.3", "Proposed light coupling initialization methods")
            .picture(
                Picture::curves("mesh, um", "log10 of the time, s", curves)
                    .x(0.0, 20.0)
                    .y(0.0, 5.0)
                    .caption("By the closed forms, at 8 Hz and for method 2 at 100 Hz."),
            )
            .picture(
                Picture::of("mesh, um", "log10 of the time, s", Content::Dots(dots))
                    .x(0.0, 20.0)
                    .y(0.0, 5.0)
                    .caption(
                        "In which the twin covered the space: methods 3 and 2 at 5 um, method 1 at 10 um \
                         and at 5 um.",
                    ),
            )
            .result("3.3-speed", 1e6 * one.mesh * rate)
            .result("3.3-rate", one.fastest(rate))
            .result("3.3-method1", one.closed_form() / 60.0)
            .result("3.3-method1-coarse", one_coarse.closed_form() / 60.0)
            .result("3.3-method2", two.closed_form() / 60.0)
            .result("3.3-method2-fiber", two.closed_form() / 180.0)
            .result("3.3-photodiode", 1.02 * two.photodiode_rate())
            .result("3.3-faster", 1.02 * two.photodiode_rate() / rate)
            .result("3.3-method3", three.closed_form())
            .noted("3.3-method1-twin", minutes(4), note(4))
            .noted("3.3-method1-coarse-twin", minutes(1), note(1))
            .noted("3.3-method2-twin", minutes(2), note(2))
            .noted("3.3-method3-twin", seconds(0), note(0))
            .result("3.3-fourth", seconds(4) / seconds(3))
            .noted(
                "3.3-orders",
                orders,
                format!("{:.0} s and {:.1} s a fiber.", seconds(4) / 3.0, seconds(0)),
            )
            .remark(
                "The searches sweep with the micro and creep with the macro: a macro that swept 100 um \
                 back and forth would spend it winding up its transmissions.",
            );
    Ok(vec![if bench.quick {
        figure.without(&[
            "3.3-method1-twin",
            "3.3-method2-twin",
            "3.3-fourth",
            "3.3-orders",
        ])
    } else {
        figure
    }])
}

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
fn sensing(bench: &Bench, seed: u64) -> Result<(Points, f64), ReproduceError> {
    let setup = &bench.machine;
    let height = Cell::new(0.0);
    let twin = Twin::new(setup.spec.clone(), &setup.plant, seed).map_err(AlignError::from)?;
    let mut watched = Watched {
        twin,
        height: &height,
    };
    let mut heights = Heights {
        height: &height,
        looking: false,
        rise: Vec::new(),
    };
    let mut station =
        Station::new(&mut watched, &setup.calibration, &mut heights).map_err(AlignError::from)?;
    let reports = Procedure::Thesis.run(&mut station, &setup.recipe);
    station.stop();
    let reports = reports.map_err(AlignError::from)?;
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
    let rate = THESIS_STEP / (9.0 * setup.recipe.climb.dwell + setup.recipe.climb.pause);
    setup.recipe.approach.speed = 0.75 * rate / setup.recipe.ports.exit_angle.tan();
    setup
}

fn alignments(bench: &Bench) -> Result<Vec<Figure>, ReproduceError> {
    let setup = &bench.machine;
    let devices: u64 = bench.count(24, 6);
    let seed = |k: u64| bench.seed.wrapping_add(k);
    let brisk = brisk(bench);
    let many = |setup: &Setup, procedure: Procedure| {
        (0..devices)
            .into_par_iter()
            .map(|k| Ok(align(setup, procedure, seed(k), &mut Unobserved)?))
            .collect::<Result<Vec<_>, ReproduceError>>()
    };
    let thesis = many(setup, Procedure::Thesis)?;
    let fast = many(setup, Procedure::Fast)?;
    let brisk_done = many(&brisk, Procedure::Thesis)?;
    let ways = (0..devices)
        .into_par_iter()
        .map(|k| sensing(bench, seed(k)))
        .collect::<Result<Vec<_>, ReproduceError>>()?;
    let half = half_area(bench)?;
    let times = Times {
        thesis: thesis.iter().collect(),
        fast: fast.iter().collect(),
        brisk: brisk_done.iter().collect(),
        brisk_speed: brisk.recipe.approach.speed,
        half,
    };
    Ok(vec![figure_3_4(&ways), budget(bench, &times)])
}

/// Time of method 3 on the twin over that of half the area.
fn half_area(bench: &Bench) -> Result<f64, ReproduceError> {
    let setup = &bench.machine;
    let whole = Space::new(Method::Multimode, &setup.recipe);
    let half = Space {
        y: 0.5 * whole.y,
        ..whole
    };
    let seconds = |space: &Space| -> Result<f64, ReproduceError> {
        let row = search_row(setup, space, bench.seed)?;
        Ok(row.measured_seconds.unwrap_or(f64::NAN))
    };
    Ok(seconds(&whole)? / seconds(&half)?)
}

/// What was measured of whole alignments.
struct Times<'a> {
    thesis: Vec<&'a Document>,
    fast: Vec<&'a Document>,
    /// With a higher speed in z, m/s.
    brisk: Vec<&'a Document>,
    brisk_speed: f64,
    half: f64,
}

/// Mean seconds a fiber in some phases.
fn mean(documents: &[&Document], phases: &[&str]) -> f64 {
    let fibers = || documents.iter().flat_map(|d| &d.fibers);
    let seconds: f64 = fibers()
        .flat_map(|f| phases.iter().filter_map(|phase| f.seconds_in(phase)))
        .sum();
    seconds / fibers().count().max(1) as f64
}

fn figure_3_4(ways: &[(Points, f64)]) -> Figure {
    let longest = ways.iter().map(|(_, seconds)| *seconds).fold(0.0, f64::max);
    let ends: Vec<f64> = ways
        .iter()
        .filter_map(|(rise, _)| Some(rise.last()?.0.abs()))
        .collect();
    let farthest = ends.iter().copied().fold(0.0, f64::max);
    let named = ways
        .iter()
        .take(3)
        .enumerate()
        .map(|(k, (rise, _))| (format!("device {}", k + 1), thin(rise.iter().copied())));
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
        .result("3.4-time", longest)
}

fn budget(bench: &Bench, times: &Times) -> Figure {
    let (thesis, fast) = (&times.thesis[..], &times.fast[..]);
    let fibers = || thesis.iter().flat_map(|d| &d.fibers);
    let worst = |of: fn(&crate::align::Offset) -> f64| {
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
    let rate = bench.machine.spec.photodiode.rate;
    let three = Space::new(Method::Multimode, &bench.machine.recipe);
    let faster = Space {
        frequency: three.fastest(5.0 * rate),
        ..three
    };
    let aligned = |documents: &[&Document]| {
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
                    aligned(thesis),
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
                1e6 * bench.machine.recipe.approach.speed,
                mean(thesis, &["approach", "final"]),
                aligned(&times.brisk),
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
        .result("budget-half", times.half)
        .result("budget-better", better)
        .remark(
            "The time in z is the recipe's: a speed that the climb can follow while light leaves the \
             inclined facet aside.",
        )
}

fn maximization(bench: &Bench) -> Result<Vec<Figure>, ReproduceError> {
    let setup = &bench.machine;
    let climb = Climb {
        step: THESIS_STEP,
        dwell: 4e-3,
        pause: 4e-3,
        ..setup.recipe.climb
    };
    let means = Means::NinePoint(climb);
    let (tracked, (macro_moves, piezos_creep)) = rayon::join(
        || tracking(setup, bench.seed, means),
        || {
            rayon::join(
                || rejection(setup, bench.seed, Disturbance::Macro(MACRO.0), means),
                || rejection(setup, bench.seed, Disturbance::Piezos(PIEZOS.0), means),
            )
        },
    );
    let ((row, curves), macro_moves, piezos_creep) = (tracked?, macro_moves?, piezos_creep?);
    let devices: u64 = bench.count(6, 2);
    let aligned = (0..devices)
        .into_par_iter()
        .map(|k| {
            let seed = bench.seed.wrapping_add(k);
            Ok(align(setup, Procedure::Thesis, seed, &mut Unobserved)?)
        })
        .collect::<Result<Vec<_>, ReproduceError>>()?;
    let xy = mean(&aligned.iter().collect::<Vec<_>>(), &["climb"]);
    let named = curves
        .iter()
        .map(|(name, points)| (name.clone(), thin(points.iter().copied())));
    let lag: Points = row
        .trials
        .iter()
        .filter_map(|t| Some((t.speed_um_s, t.lag_um?)))
        .collect();
    let lost = row
        .lost_um_s
        .map_or_else(String::new, |lost| format!("Lost at {lost} um/s."));
    Ok(vec![
        Figure::new("3.5", "Light maximization algorithm for micro manipulator")
            .picture(
                Picture::curves("time, s", "light, % of before", named)
                    .y(0.0, 110.0)
                    .caption("Light while the peak drifts and nine-point patterns follow it."),
            )
            .picture(
                Picture::curves("drift, um/s", "distance from the peak, um", [("", lag)])
                    .x(0.0, 4.5)
                    .caption("How far the fiber trails, in truth, at the end of each drift."),
            )
            .result("3.5-period", 1.0 / (9.0 * climb.dwell + climb.pause))
            .result("3.5-closed", row.closed_form_um_s.unwrap_or(f64::NAN))
            .noted("3.5-tracking", row.limit_um_s, lost)
            .noted(
                "3.5-macro",
                macro_moves.light_percent / 100.0,
                format!("On average {:.0} %.", macro_moves.mean_light_percent),
            )
            .noted(
                "3.5-creep",
                piezos_creep.light_percent / 100.0,
                format!("On average {:.0} %.", piezos_creep.mean_light_percent),
            )
            .noted(
                "3.5-xy",
                xy,
                format!("Over {devices} devices, with the recipe's step."),
            ),
    ])
}
