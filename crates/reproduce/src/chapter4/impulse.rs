//! Figs. 4.11 to 4.24: impulse control.

use super::super::chapter2::{FIVE_BAR, Z, pid_resolution};
use super::super::noted::{FromPulse, noted, since};
use super::super::picture::{Content, Picture, Points, thin};
use super::super::{Bench, Figure};
use pigtail_control::impulse::Shape;
use pigtail_control::impulse::experiment::{MOVES, parabola};
use pigtail_control::impulse::response::Response;
use pigtail_evaluate::impulse::condition::Condition;
use pigtail_evaluate::impulse::response::{
    Form, MACHINES, PERIOD, ResponseDocument, Trace, response, single,
};
use pigtail_evaluate::impulse::run::{
    PulseDocument as Run, Resolution, Task, resolution, runs, stability,
};
use pigtail_hal::{Axis, AxisName};
use pigtail_numerics::bisection::try_onset;
use pigtail_numerics::statistics::Sorted;
use pigtail_session::impulse::{Estimator, believed};
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use rayon::prelude::*;

/// The voltage at which an axis's motor breaks away by its plant, volts: `R/k_m f_sm`. A simulation
/// knows it.
fn fsm(setup: &Setup, axis: Axis) -> f64 {
    let joint = match axis {
        Axis::A | Axis::B => &setup.plant.five_bar.joint,
        Axis::Z => &setup.plant.z_stage.joint,
    };
    joint.motor.resistance / joint.motor.torque_constant * joint.motor_friction.static_level()
}

/// Readings of the probe that make a measurement of what a pulse did.
const READINGS: u32 = 100;

/// What control has the amplifier of an axis play in a run, volts over seconds since its first pulse began.
fn played(run: &FromPulse<'_>, until: f64) -> Points {
    /// Looks within a servo cycle, in which a pulse changes by much.
    const LOOKS: u32 = 20;
    let mut playing = None;
    let mut points = Points::new();
    for cycle in run.cycles {
        if let Some(pulse) = cycle.pulse {
            playing = Some((cycle.begun, pulse));
        }
        for look in 0..LOOKS {
            let time = cycle.begun + run.period * f64::from(look) / f64::from(LOOKS);
            if time - run.begun > until {
                return points;
            }
            let voltage = match playing {
                Some((begun, pulse)) if time - begun <= pulse.period => pulse.at(time - begun),
                _ => cycle.held,
            };
            points.push((time - run.begun, voltage));
        }
    }
    points
}

/// Fig. 4.11, as the control of a run plays it.
pub(super) fn input(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.machine;
    let belief = believed(&setup.rig, Z)?;
    let pulse = Shape::second_harmonic(0.0, PERIOD).pulse(4.0 * belief.unit, true);
    let (begun, cycles) = noted(setup, bench.seed, Z, |station| {
        let impulses = belief.impulses(Z, READINGS);
        impulses.begin(station)?;
        let begun = station.time();
        // One measurement stands before it, as before any pulse of a run.
        impulses.measure(station)?;
        impulses.play(station, pulse)?;
        Ok(begun)
    })?;
    let voltages =
        FromPulse::of(since(&cycles, begun)).map_or_else(Points::new, |run| played(&run, 2e-3));
    let points = voltages
        .into_iter()
        .map(|(t, volts)| (1e3 * t, volts / belief.unit));
    Ok(vec![
        Figure::new("4.11", "Impulse control input").picture(
            Picture::curves("time, ms", "u / fsm", [("", points.collect())])
                .x(0.0, 2.0)
                .y(0.0, 5.0)
                .caption(
                    "Four times the static friction for a millisecond, here the first harmonic: what control has the \
                     amplifier play in a run, by the static friction that control believes.",
                ),
        ),
    ])
}

/// Fig. 4.12: what the stage does in a run by a pulse that displaces it by so much, metres. What control believes of pulses is what is left once the
/// transmission has been relaxed too; this is the way before that, so the amplitude is raised until the probe tells of it.
fn typical(bench: &Bench, wanted: f64) -> Result<Picture, Ended> {
    const RAISED: f64 = 1.05;
    let setup = &bench.machine;
    let belief = believed(&setup.rig, Z)?;
    let most = belief.curve.last().map_or(0.0, |last| last[0]);
    let ((moved, a1, begun), cycles) = noted(setup, bench.seed, Z, |station| {
        let impulses = belief.impulses(Z, READINGS);
        impulses.begin(station)?;
        let mut a1 = Response::curve(belief).choose(wanted, 1.0, true).a1;
        loop {
            let begun = station.time();
            let moved = impulses.respond(station, belief.shape().pulse(a1, true))?;
            if moved.displacement >= wanted || a1 >= most {
                return Ok((moved, a1, begun));
            }
            a1 = (RAISED * a1).min(most);
        }
    })?;
    let mut points = vec![(0.0, 0.0)];
    if let Some(run) = FromPulse::of(since(&cycles, begun)) {
        let ends = run.cycles.iter().map(|c| {
            let time = c.begun - run.begun + run.period;
            (1e3 * time, 1e9 * (c.output - run.from))
        });
        points.extend(ends.take_while(|(ms, _)| *ms <= 20.0));
    }
    Ok(Picture::curves("time, ms", "z, nm", [("", points)])
        .x(0.0, 20.0)
        .caption(format!(
            "The output in a run, its transmission at rest before. Control has raised the pulse until its probe tells of {:.0} nm: of {:.1} nm at \
             a1 = {:.2} fsm.",
            1e9 * wanted,
            1e9 * moved.displacement,
            a1 / belief.unit
        )))
}

fn over_time(trace: &Trace, until: f64, of: &dyn Fn(usize) -> f64) -> Points {
    thin(
        (0..trace.time.len())
            .take_while(|k| 1e3 * trace.time[*k] <= until)
            .map(|k| (1e3 * trace.time[k], of(k))),
    )
}

/// Figs. 4.13 to 4.16, simulated.
pub(super) fn single_pulse(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.nominal;
    let unit = fsm(setup, Axis::Z);
    let pulse = Shape::second_harmonic(12.5 * unit, PERIOD).pulse(1.5 * unit, true);
    let trace = single(setup, Z, bench.seed, &pulse)?;
    let last = trace.time.len() - 1;
    let end = trace.time.partition_point(|t| *t <= PERIOD);
    // The way that each goes there and back, not only where it ends.
    let way = |of: &dyn Fn(usize) -> f64, range: std::ops::Range<usize>| -> f64 {
        range.map(|k| (of(k + 1) - of(k)).abs()).sum()
    };
    let motor = |k: usize| trace.angles[k].0;
    let load = |k: usize| trace.angles[k].1;
    let motor_share = way(&motor, 0..end) / way(&motor, 0..last);
    let load_share = way(&load, end..last) / way(&load, 0..last);
    let rate = |k: usize, of: &dyn Fn(usize) -> f64| {
        let (low, high) = (k.saturating_sub(1), (k + 1).min(last));
        (of(high) - of(low)) / (trace.time[high] - trace.time[low])
    };
    let micro = |radians: f64| 1e6 * radians;
    Ok(vec![
        Figure::new(
            "4.13",
            "Impulse response input, a1 = 1.5 fsm, a2 = 12.5 fsm",
        )
        .picture(
            Picture::curves(
                "time, ms",
                "u / fsm",
                [("", over_time(&trace, 4.0, &|k| trace.voltage[k] / unit))],
            )
            .x(0.0, 4.0)
            .caption("The two harmonics of (4.7)."),
        ),
        Figure::new("4.14", "Impulse response positions").picture(
            Picture::curves(
                "time, ms",
                "angle, urad",
                [
                    ("motor x gear", over_time(&trace, 8.0, &|k| micro(motor(k)))),
                    ("load", over_time(&trace, 8.0, &|k| micro(load(k)))),
                ],
            )
            .x(0.0, 8.0)
            .caption("The motor behind its gear, and the load."),
        ),
        Figure::new("4.15", "Impulse response velocities")
            .picture(
                Picture::curves(
                    "time, ms",
                    "velocity, rad/s",
                    [
                        ("motor x gear", over_time(&trace, 8.0, &|k| rate(k, &motor))),
                        ("load", over_time(&trace, 8.0, &|k| rate(k, &load))),
                    ],
                )
                .x(0.0, 8.0)
                .caption("The motor moves within the millisecond, the load after it."),
            )
            .result("4.15-motor", motor_share)
            .result("4.15-load", load_share),
        Figure::new("4.16", "Impulse response displacement")
            .picture(
                Picture::curves(
                    "time, ms",
                    "z, nm",
                    [("", over_time(&trace, 8.0, &|k| 1e9 * trace.output[k]))],
                )
                .x(0.0, 8.0)
                .caption("The output."),
            )
            .result("4.16-displacement", 1e9 * trace.output[last]),
    ])
}

/// The dead zone at a share of the second harmonic that leaves none; 5 fsm where nothing moves.
fn dead_zone(d: &ResponseDocument, share: f64) -> f64 {
    let wanted = share * d.a2_fsm;
    d.dead_zones
        .iter()
        .min_by(|a, b| {
            (a.a2_fsm - wanted)
                .abs()
                .total_cmp(&(b.a2_fsm - wanted).abs())
        })
        .and_then(|zone| zone.dead_zone_fsm)
        .unwrap_or(5.0)
}

/// Fig. 4.17 or the first of 4.21.
fn map(d: &ResponseDocument) -> Picture {
    /// Below this, nanometres, it is the probe's noise.
    const NOISE: f64 = 4.0;
    let (columns, rows) = (&d.map.a1_fsm, &d.map.a2_fsm);
    let reached = d.map.nm.iter().flatten().flatten();
    let highest = reached.clone().fold(1.0, |h: f64, v| h.max(*v));
    let cells = rows
        .iter()
        .zip(&d.map.nm)
        .flat_map(|(y, row)| {
            columns.iter().zip(row).filter_map(|(x, nm)| {
                let nm = (*nm)?;
                let seen = if nm > NOISE { nm } else { 0.0 };
                Some((*x, *y, (seen / highest).sqrt()))
            })
        })
        .collect();
    let size = (columns[0], rows[0]);
    Picture::of("a1 / fsm", "a2 / fsm", Content::Cells(cells, size))
        .colour("root of share")
        .x(0.0, 5.0)
        .y(0.0, 20.0)
        .caption(format!(
            "Displacement over both harmonics, darkest none, brightest {highest:.0} nm."
        ))
}

/// Fig. 4.18 or the second of 4.21.
fn curve(d: &ResponseDocument) -> Picture {
    let measured: Points = d.curve.iter().map(|row| (row.a1_fsm, row.nm)).collect();
    let prediction: Points = d
        .curve
        .iter()
        .map(|row| (row.a1_fsm, d.b_nm * row.a1_fsm.powi(2)))
        .collect();
    Picture::curves(
        "a1 / fsm",
        "displacement, nm",
        [("measured", measured), ("(4.8)", prediction)],
    )
    .x(0.0, 5.0)
    .caption(format!(
        "With a2 = {:.1} fsm; b = {:.2} nm.",
        d.a2_fsm, d.b_nm
    ))
}

/// Figs. 4.17 to 4.19, simulated.
pub(super) fn z_response(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let machines = bench.count(MACHINES, 60);
    let (d, figures, _) = response(&bench.nominal, Z, &Form::THESIS, machines, bench.seed)?;
    let spread = &figures.spread;
    let of = |share: fn(&pigtail_evaluate::impulse::response::Spread) -> f64| -> Points {
        spread.iter().map(|s| (s.a1, share(s))).collect()
    };
    let (a1, medians): (Vec<f64>, Vec<f64>) = spread.iter().map(|s| (s.a1, s.p50)).unzip();
    let (_, r2) = parabola(&a1, &medians);
    // The least from which on all of them move; where the curve crosses, between its points.
    let moves = 1e9 * MOVES;
    let still = spread.iter().rposition(|s| s.p10 <= moves);
    let dead = match still {
        None => 0.0,
        Some(k) => spread.get(k + 1).map_or(5.0, |next| {
            let here = &spread[k];
            let share = (moves - here.p10) / (next.p10 - here.p10).max(f64::MIN_POSITIVE);
            here.a1 + share * (next.a1 - here.a1)
        }),
    };
    let acceptable = spread
        .last()
        .map_or(f64::NAN, |s| s.p90 / (d.b_nm * s.a1 * s.a1));
    Ok(vec![
        Figure::new("4.17", "Generalized impulse response")
            .picture(map(&d))
            .result("4.17-dead", dead_zone(&d, 0.0))
            .noted(
                "4.17-shrinks",
                dead_zone(&d, 0.5) / dead_zone(&d, 0.0),
                format!(
                    "{:.2} fsm and {:.2} fsm.",
                    dead_zone(&d, 0.0),
                    dead_zone(&d, 0.5)
                ),
            )
            .result("4.17-second", d.a2_fsm),
        Figure::new("4.18", "Generalized impulse response for a2 / fsm = 12.5")
            .picture(curve(&d))
            .result("4.18-parabola", d.r2),
        Figure::new("4.19", "Impulse response parameter sensitivity")
            .picture(
                Picture::curves(
                    "a1 / fsm",
                    "displacement, nm",
                    [
                        ("a tenth below", of(|s| s.p10)),
                        ("median", of(|s| s.p50)),
                        ("a tenth above", of(|s| s.p90)),
                    ],
                )
                .x(0.0, 5.0)
                .caption(
                    format!("Over {machines} machines whose load friction differs by 10 % and whose motor stands off by \
                     3E-4 rad."),
                ),
            )
            .result("4.19-dead", dead)
            .result("4.19-parabola", r2)
            .result("4.19-acceptable", acceptable),
    ])
}

/// Where the output is at each moment of rest, of the way that it is to go.
fn positions(run: &Run, unit: f64) -> Points {
    run.steps
        .iter()
        .enumerate()
        .map(|(k, step)| (k as f64, unit * (run.target_nm - step.error_nm)))
        .collect()
}

/// Fig. 4.20, simulated.
pub(super) fn z_control(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    const PULSES: u32 = 20;
    const LAST: usize = 10;
    /// A tolerance beside which the noise of one reading is nothing, metres.
    const ONE_READING: f64 = 100e-9;
    let mut task = Task::usual(Z, 100e-9);
    task.estimator = Estimator::Parabola;
    task.condition = Condition::Thesis;
    task.settings.pulses = PULSES;
    task.settings.stop = false;
    // So wide that control takes one reading a measurement, which errs by 4 nm: it would average as many
    // as make 10 nm sure, and the thesis's measurement errs by 4 nm. Nothing else rests on it here.
    task.settings.tolerance = ONE_READING;
    let count = bench.count(100, 12);
    let (done, gains) = rayon::join(
        || runs(&bench.nominal, &task, bench.seed, count),
        || stability(&bench.nominal, Z, bench.seed),
    );
    let (done, gains) = (done?, gains?);
    let errors = Sorted::new(done.iter().map(|run| run.error_nm.abs()).collect());
    let percentile = |share: f64| errors.percentile(share).unwrap_or(f64::NAN);
    let error = percentile(0.5);
    let pid = pid_resolution(bench, Z)?.unwrap_or(f64::NAN);
    let below = done.iter().filter(|run| run.error_nm.abs() < 10.0).count();
    let last = |gain: f64| -> f64 {
        gains
            .iter()
            .find(|run| (run.gain - gain).abs() < 1e-9)
            .map_or(f64::NAN, |run| {
                let tail = run.steps.iter().rev().take(LAST);
                tail.map(|step| step.error_nm.abs()).sum::<f64>() / LAST as f64
            })
    };
    let shown = done
        .iter()
        .take(3)
        .enumerate()
        .map(|(k, run)| (format!("machine {}", k + 1), positions(run, 1.0)));
    let by_gain = gains
        .iter()
        .map(|run| (format!("kc = {}", run.gain), run))
        .filter(|(_, run)| run.gain >= 1.0 && (run.gain - 1.5).abs() > 1e-9)
        .map(|(name, run)| {
            let points = run.steps.iter().enumerate();
            let points: Points = points.map(|(k, s)| (k as f64, s.error_nm)).collect();
            (name, points)
        });
    Ok(vec![
        Figure::new("4.20", "Impulse control response for xd = 100 nm, kc = 1")
            .picture(
                Picture::curves("pulse", "x, nm", shown)
                    .x(0.0, f64::from(PULSES))
                    .caption(
                        "By the thesis's parabola and law, on machines whose friction, internal state \
                         and sensor are uncertain as in the thesis.",
                    ),
            )
            .picture(
                Picture::curves("pulse", "error, nm", by_gain).caption(
                    "With other gains, nothing uncertain: stable below two, not above (4.12).",
                ),
            )
            .noted(
                "4.20-error",
                error,
                format!("{below} of {count} runs end below 10 nm."),
            )
                .noted(
                "4.20-factor",
                1e3 * pid / percentile(0.9),
                format!("{:.0} nm over {:.1} nm.", 1e3 * pid, percentile(0.9)),
            )
            .result("4.20-stable", last(1.9))
            .result("4.20-unstable", last(2.1)),
    ])
}

pub(super) fn five_bar_response(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    // Courses of noise: what a dead zone is told by is near the probe's noise.
    let courses: u64 = bench.count(3, 1);
    let all = (0..courses)
        .into_par_iter()
        .map(|k| {
            let seed = bench.seed.wrapping_add(k);
            // Of the spread over machines nothing is shown.
            Ok(response(&bench.machine, FIVE_BAR, &Form::THESIS, 1, seed)?.0)
        })
        .collect::<Result<Vec<ResponseDocument>, Ended>>()?;
    let d = &all[0];
    let second = Sorted::new(all.iter().map(|d| d.a2_fsm).collect());
    let found: Vec<String> = all.iter().map(|d| d.a2_fsm.to_string()).collect();
    Ok(vec![
        Figure::new("4.21", "Generalized impulse response of five-bar")
            .picture(map(d))
            .picture(curve(d))
            .noted(
                "4.21-second",
                second.percentile(0.5).unwrap_or(f64::NAN),
                format!("The median of {} fsm.", found.join(", ")),
            )
            .result("4.21-dead", dead_zone(d, 0.0))
            .result("4.21-parabola", d.r2),
    ])
}

/// A task as the thesis set it on its machine: its parabola, a pulse in 250 ms, and only what the
/// machine itself is uncertain about.
fn thesis_task(at: AxisName, target: f64) -> Task {
    let mut task = Task::usual(at, target);
    task.estimator = Estimator::Parabola;
    task.condition = Condition::Quiet;
    task.settings.stop = false;
    task.rest = Some(0.25);
    task
}

/// How alike pulses of the five-bar are with a rest after each, rms over their mean: over some courses of
/// noise. A measurement takes 40 ms besides.
fn spread(bench: &Bench, rest: f64) -> Result<f64, Ended> {
    const COURSES: u64 = 8;
    let mut task = thesis_task(FIVE_BAR, 0.0);
    task.rest = Some(rest);
    let all = (0..COURSES)
        .into_par_iter()
        .map(|k| {
            let seed = bench.seed.wrapping_add(k);
            let done = resolution(&bench.machine, &task, 0.15e-6, seed)?;
            Ok(done.deviation_nm / done.mean_nm.abs())
        })
        .collect::<Result<Vec<f64>, Ended>>()?;
    Ok(all.iter().sum::<f64>() / COURSES as f64)
}

pub(super) fn five_bar_control(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    const STARTS: [f64; 4] = [-2e-6, -1e-6, 1e-6, 2e-6];
    let setup = &bench.machine;
    believed(&setup.rig, FIVE_BAR)?;
    let done = STARTS
        .par_iter()
        .map(|target| {
            let mut task = thesis_task(FIVE_BAR, *target);
            task.settings.pulses = 16;
            pigtail_evaluate::impulse::run::run(setup, &task, bench.seed)
        })
        .collect::<Result<Vec<Run>, Ended>>()?;
    let settling = done
        .iter()
        .map(|run| run.settled_s.unwrap_or(f64::INFINITY))
        .fold(0.0, f64::max);
    let error = done
        .iter()
        .map(|run| 1e-3 * run.error_nm.abs())
        .fold(0.0, f64::max);
    let drive = setup.rig.spec.drive(FIVE_BAR.axis);
    let arm = setup.rig.spec.probe.as_ref().map_or(f64::NAN, |p| p.arm);
    let count = 1e6 * drive.count() / drive.gear_ratio * arm;
    let (slow, fast) = (spread(bench, 0.25)?, spread(bench, 0.01)?);
    let curves = done.iter().map(|run| {
        let points: Points = run
            .steps
            .iter()
            .map(|step| (step.time_s, -1e-3 * step.error_nm))
            .collect();
        (format!("{:+.0} um", -1e-3 * run.target_nm), points)
    });
    Ok(vec![
        Figure::new(
            "4.22",
            "Impulse control response of five-bar for xd = 0, kc = 1",
        )
        .picture(
            Picture::curves("time, s", "x, um", curves)
                .x(0.0, 5.0)
                .caption("From four initial positions, a pulse in 250 ms."),
        )
        .result("4.22-settling", settling)
        .result("4.22-error", error)
        .result("4.22-tic", error / count)
        .noted(
            "4.22-rate",
            fast / slow,
            format!(
                "{:.1} % and {:.1} % of a pulse, rms. A pulse of 0.15 um: {:.0} ms after its start the output \
                 is within 1 nm of where it stays.",
                100.0 * fast,
                100.0 * slow,
                1e3 * at_rest(&moving_by(bench, FIVE_BAR, 0.15e-6)?)
            ),
        ),
    ])
}

/// When the output comes to be within a nanometre of where it stays, seconds after the pulse began.
fn at_rest(trace: &Trace) -> f64 {
    let end = trace.output.last().copied().unwrap_or(0.0);
    let moved = trace.output.iter().rposition(|x| (x - end).abs() > 1e-9);
    moved.map_or(0.0, |k| trace.time[k])
}

/// Share of pulses that move the output by less than half of the mean.
fn stuck(done: &Resolution) -> f64 {
    let steps = increments(done);
    let few = steps.iter().filter(|d| **d < 0.5 * done.mean_nm).count();
    few as f64 / steps.len().max(1) as f64
}

fn increments(done: &Resolution) -> Vec<f64> {
    done.position_nm.windows(2).map(|p| p[1] - p[0]).collect()
}

fn resolution_pictures(figure: Figure, done: &Resolution, most: f64) -> Figure {
    let steps = increments(done);
    let position: Points = done
        .position_nm
        .iter()
        .enumerate()
        .map(|(k, nm)| (k as f64, 1e-3 * nm))
        .collect();
    figure
        .picture(
            Picture::of(
                "displacement, um",
                "pulses",
                Content::Bars(steps.iter().map(|nm| 1e-3 * nm).collect(), 40),
            )
            .x(0.0, most)
            .caption("What each pulse of one amplitude did."),
        )
        .picture(
            Picture::curves("pulse", "position, um", [("", position)])
                .caption("The output after each."),
        )
}

pub(super) fn five_bar_resolution(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.machine;
    let done = resolution(setup, &thesis_task(FIVE_BAR, 0.0), 0.15e-6, bench.seed)?;
    let greatest = 1e-3 * done.greatest_nm;
    let pid = pid_resolution(bench, FIVE_BAR)?.unwrap_or(f64::NAN);
    let note = format!("{pid:.2} um under PID, {greatest:.3} um under pulses.");
    let figure = Figure::new("4.23", "Impulse resolution test for five-bar")
        .result("4.23-consistent", stuck(&done))
        .noted(
            "4.23-resolution",
            greatest,
            format!(
                "Mean {:.0} nm, {:.1} nm rms.",
                done.mean_nm, done.deviation_nm
            ),
        )
        .noted("4.23-factor", pid / greatest, note.clone())
        .noted("4.23-order", pid / greatest, note);
    Ok(vec![resolution_pictures(figure, &done, 0.4)])
}

/// The trajectory of a pulse of an axis that displaces it by so much, metres: of the shape that is
/// believed, with the amplitude found by halving.
fn moving_by(bench: &Bench, at: AxisName, wanted: f64) -> Result<Trace, Ended> {
    const HALVINGS: u32 = 16;
    let setup = &bench.machine;
    let belief = believed(&setup.rig, at)?;
    let shape = belief.shape();
    let played = |a1: f64| single(setup, at, bench.seed, &shape.pulse(a1, true));
    let most = belief.curve.last().map_or(0.0, |last| last[0]);
    let (_, enough) = try_onset((0.0, most), HALVINGS, |a1| {
        let moved = played(a1)?.output.last().copied();
        Ok::<_, Ended>(moved.unwrap_or(0.0) >= wanted)
    })?;
    played(enough)
}

/// Figs. 4.12 and 4.24.
pub(super) fn z_resolution(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    const STEPS: [f64; 4] = [20e-9, 15e-9, 10e-9, 5e-9];
    let setup = &bench.machine;
    let all = STEPS
        .par_iter()
        .map(|step| resolution(setup, &thesis_task(Z, 0.0), *step, bench.seed))
        .collect::<Result<Vec<Resolution>, Ended>>()?;
    let least = all
        .iter()
        .filter(|done| stuck(done) < 0.01)
        .map(|done| done.mean_nm)
        .fold(f64::INFINITY, f64::min);
    let typical = Figure::new("4.12", "Impulse response of z-stage")
        .picture(typical(bench, 20e-9)?)
        .result("4.12-step", least);
    let done = &all[1];
    let pid = pid_resolution(bench, Z)?.unwrap_or(f64::NAN);
    let five_bar = resolution(setup, &thesis_task(FIVE_BAR, 0.0), 0.15e-6, bench.seed)?;
    let relative = |done: &Resolution| done.deviation_nm / done.mean_nm.abs();
    let steps = increments(done);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len().max(1) as f64;
    let n = steps.len();
    let figure = Figure::new("4.24", "Impulse resolution test for z-stage")
        .noted(
            "4.24-resolution",
            done.greatest_nm,
            format!(
                "Mean {:.1} nm, {:.1} nm rms.",
                done.mean_nm, done.deviation_nm
            ),
        )
        .noted(
            "4.24-factor",
            1e3 * pid / done.greatest_nm,
            format!("{:.0} nm under PID.", 1e3 * pid),
        )
        .noted(
            "4.24-uneven",
            relative(done) / relative(&five_bar),
            format!(
                "{:.1} % and {:.1} %.",
                100.0 * relative(done),
                100.0 * relative(&five_bar)
            ),
        )
        .result("4.24-trend", mean(&steps[n - 10..]) / mean(&steps[..10]));
    Ok(vec![typical, resolution_pictures(figure, done, 0.04)])
}
